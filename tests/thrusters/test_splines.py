"""Splines through the levels of a bollard test: monotone, inverted, written and read, chosen where no equation fits."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.errors import ModelError
from automarine_cli.estimate import Estimate
from automarine_cli.planning.candidates import drive_of
from automarine_cli.thrusters.curves import FORMS, SplineCurve
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.result import ThrusterFit

LEVELS = np.arange(10.0, 101.0, 10.0)
N = np.concatenate([-LEVELS[::-1], [0.0], LEVELS])
CURVE = SplineCurve((0.0, 10.0, 20.0, 40.0, 60.0, 80.0), (0.0, 0.0, 1.0, 9.0, 9.5, 14.0))
FLAT = SplineCurve((0.0, 10.0, 20.0, 30.0), (0.0, 2.0, 5.0, 5.0))
MAP = ThrusterMap("spline", CURVE, FLAT, "%", (-30.0, 80.0))


def s_shaped(n: np.ndarray) -> np.ndarray:
    """Thrust [N] that starts late and levels off, by 40 N forward and 25 N backward."""
    share = 1.0 / (1.0 + np.exp(-12.0 * (np.abs(n) / 100.0 - 0.5))) - 1.0 / (1.0 + np.exp(6.0))
    return np.asarray(np.sign(n) * np.where(n > 0, 40.0, 25.0) * share)


def square(n: np.ndarray) -> np.ndarray:
    return np.asarray(np.where(n > 0, 4e-3, 2.5e-3) * n * np.abs(n))


def bollard_test(folder: Path, force: np.ndarray, n: np.ndarray = N, seed: int = 0) -> ThrusterFit:
    noise = 0.2 * np.random.default_rng(seed).standard_normal(len(n)) * (n != 0.0)
    log = folder / f"bollard_{seed}.csv"
    pd.DataFrame({"n": n, "force_N": force + noise}).to_csv(log, index=False)
    return fit_thrusters([log])


def test_it_rises_through_its_levels_and_is_straight_beyond() -> None:
    along = np.linspace(0.0, 120.0, 2401)
    assert CURVE.thrust(np.array(CURVE.n)) == pytest.approx(CURVE.force)
    assert np.all(np.diff(CURVE.thrust(along)) >= 0.0)
    slopes = np.diff(CURVE.thrust(along)) / np.diff(along)
    assert slopes[along[1:] > 80.0] == pytest.approx(slopes[along[1:] <= 80.0][-1], rel=0.01) and slopes[-1] > 0.2
    assert (CURVE.n_0, CURVE.n_sat, FLAT.n_0, FLAT.n_sat) == (10.0, None, 0.0, 20.0)
    assert FLAT.thrust(np.array([20.0, 30.0, 99.0])) == pytest.approx(5.0)


def test_the_inverse_gives_the_command_back() -> None:
    for n in (10.5, 20.0, 33.0, 59.0, 80.0, 95.0):
        assert CURVE.signal(float(CURVE.thrust(np.array(n)))) == pytest.approx(n, rel=1e-9)
    assert (CURVE.signal(0.0), FLAT.signal(5.0), FLAT.signal(6.0)) == (10.0, pytest.approx(20.0), 20.0)
    drive = drive_of(MAP, 0.5, 30.0, True)
    ahead, astern = drive.commands(3.0)
    assert 0.5 * (MAP.force(ahead) - MAP.force(astern)) == pytest.approx(3.0)


def test_json_there_and_back(tmp_path: Path) -> None:
    assert ThrusterMap.from_json(json.loads(json.dumps(MAP.to_json()))) == MAP
    fit = bollard_test(tmp_path, s_shaped(N))
    read = ThrusterMap.from_json(json.loads(json.dumps(fit.to_json())))
    assert read == fit.map and read.form == "spline"


@pytest.mark.parametrize("levels", [[], [(10.0, 0.0)], [(10.0, 2.0), (10.0, 3.0)], [(10.0, 2.0), (20.0, 1.0)]])
def test_levels_that_fall_are_refused(levels: list[tuple[float, float]]) -> None:
    data = MAP.to_json()
    wrong = {"levels": [{"n": n, "thrust_N": force} for n, force in levels]}
    with pytest.raises(ModelError, match=r"parameters\.forward\.levels: expected levels of rising n > 0"):
        ThrusterMap.from_json({**data, "parameters": {"forward": wrong}})


@pytest.mark.slow
def test_an_s_shape_takes_the_spline_and_a_square_law_does_not(tmp_path: Path) -> None:
    forms = [bollard_test(tmp_path, square(N), seed=seed).map.form for seed in range(5)]
    assert forms.count("square") >= 4 and "spline" not in forms
    fits = [bollard_test(tmp_path, s_shaped(N), seed=seed) for seed in range(5)]
    assert all(fit.map.form == "spline" for fit in fits)
    assert "a curve through the mean of each level" in fits[0].analysis.because
    within = [
        estimate.ci95[0] <= abs(s_shaped(sign * LEVELS[k : k + 1])[0]) <= estimate.ci95[1]
        for fit in fits
        for side, sign in (("forward", 1.0), ("backward", -1.0))
        for k, estimate in enumerate(fit.analysis.chosen.estimates[side].values())
        if isinstance(estimate, Estimate)
    ]
    assert len(within) == 100 and np.mean(within) > 0.93


def test_both_directions_are_alike_and_falls_are_evened_out() -> None:
    force, weights = np.array([1.0, 3.0, 2.0, 6.0, 5.0]), np.array([1.0, 1.0, 3.0, 1.0, 1.0])
    curve, at_bound = FORMS["spline"].fit(np.arange(1.0, 6.0), force, weights)
    assert curve == SplineCurve((0.0, 1.0, 2.0, 3.0, 4.0, 5.0), (0.0, 1.0, 2.25, 2.25, 5.5, 5.5)) and at_bound == ()
    even = ThrusterMap("spline", curve, curve)
    n = np.linspace(0.0, 7.0, 50)
    assert even.force(-n) == pytest.approx(-even.force(n))
    passed_by, _ = FORMS["spline"].fit(np.arange(1.0, 6.0), force, np.array([1.0, 1.0, 0.01, 1.0, 1.0]))
    assert passed_by.thrust(np.array(3.0)) > 3.0


def test_a_diagnosis_names_what_a_spline_cannot_follow(tmp_path: Path) -> None:
    n = np.concatenate([N, N])
    fit = bollard_test(tmp_path, s_shaped(n) * (1.0 - 0.2 * np.arange(len(n)) / len(n)), n)
    (tmp_path / "map.json").write_text(json.dumps(ThrusterMap("spline", *fit.analysis.fits[-1].both_ways).to_json()))
    result = diagnose([tmp_path / "bollard_0.csv"], model=tmp_path / "map.json")
    assert result.verdict == "named" and [effect.name for effect in result.effects] == ["battery-sag"]
    extended = ThrusterMap.from_json(result.extended_map)
    assert extended.form == "spline" and extended.force(100.0) == pytest.approx(40.0, rel=0.03)
