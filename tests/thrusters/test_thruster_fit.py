"""The square law and its intervals, the forms and their choice, against known truth."""

import numpy as np
import pytest

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.thrusters.bollard_data import Points, flag_contradictions, subtract_tare
from automarine_cli.thrusters.curves import FORMS, PowerCurve
from automarine_cli.thrusters.fit import analyse, sides_of, square_law

# The source paper's equation 3 for two thrusters, halved (PHYSICS 4.5): N per control count squared.
AHEAD, ASTERN = 2.6165e-4, 0.6640e-4
LEVELS = np.arange(10.0, 151.0, 10.0)
BOTH = np.concatenate([-LEVELS[::-1], LEVELS])
EXACT = 1e-9  # algebra on data without noise


def points(n: np.ndarray, force: np.ndarray, record: int = 0) -> Points:
    return Points.measured(np.asarray(n, dtype=float), force, np.arange(float(len(n))), None, record)


def paper(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


def test_equation_three_comes_back_from_its_own_data() -> None:
    analysis = analyse(points(BOTH, paper(BOTH)), None, 0.0, "")
    assert analysis.square["forward"].value == pytest.approx(AHEAD, rel=EXACT)
    assert analysis.square["backward"].value == pytest.approx(ASTERN, rel=EXACT)
    assert analysis.square["forward"].value / analysis.square["backward"].value == pytest.approx(3.9405, abs=1e-4)
    assert analysis.chosen.form.name == "square"
    assert analysis.r2 == pytest.approx(1.0, abs=EXACT)
    assert analysis.map.force(150.0) == pytest.approx(5.89, abs=0.005)
    assert analysis.map.force(-150.0) == pytest.approx(-1.49, abs=0.005)


@pytest.mark.parametrize("proportional", [False, True])
def test_intervals_hold_the_truth_as_often_as_they_say(proportional: bool) -> None:
    """400 campaigns each; 95 % intervals within three binomial standard errors (and no wider than 99 %)."""
    held, campaigns = 0, 400
    for seed in range(campaigns):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(len(BOTH))
        force = paper(BOTH) * (1.0 + 0.05 * noise) if proportional else paper(BOTH) + 0.1 * noise
        low, high = square_law(sides_of(points(BOTH, force), None, 0.0)["forward"], "N").ci95
        held += low <= AHEAD <= high
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / campaigns) <= held / campaigns <= 0.99


def test_repeats_of_a_level_count_once() -> None:
    """An error common to a level's repeats is not averaged away by logging it ten times."""
    rng = np.random.default_rng(4)
    force = paper(LEVELS) + 0.1 * rng.standard_normal(len(LEVELS))
    once = square_law(sides_of(points(LEVELS, force), None, 0.0)["forward"], "N")
    tenfold = square_law(sides_of(points(np.tile(LEVELS, 10), np.tile(force, 10)), None, 0.0)["forward"], "N")
    assert tenfold.value == pytest.approx(once.value, rel=EXACT)
    assert tenfold.stderr == pytest.approx(once.stderr, rel=EXACT)


def of_records(gains: np.ndarray) -> Estimate:
    """The square law ahead of whole records over the same levels, each with its gain."""
    n = np.tile(LEVELS, len(gains))
    together = points(n, np.repeat(gains, len(LEVELS)) * paper(n))
    together = Points(**{**vars(together), "record": np.repeat(np.arange(len(gains)), len(LEVELS))})
    return square_law(sides_of(together, None, 0.0)["forward"], "N")


def test_gain_that_differs_between_records_widens_the_interval() -> None:
    """The record is the unit, not the level: also where records lie either side of their mean, so that every level's
    residuals sum to nothing."""
    fits = [of_records(1.0 + 0.05 * np.random.default_rng(seed).standard_normal(6)) for seed in range(40)]
    assert 0.7 < np.std([(fit.value - AHEAD) / fit.stderr for fit in fits]) < 1.6
    assert np.mean([fit.ci95[0] <= AHEAD <= fit.ci95[1] for fit in fits]) >= 0.85
    for gains in (np.array([0.98, 1.02]), np.array([0.97, 1.0, 1.03])):
        fit = of_records(gains)
        assert fit.value == pytest.approx(AHEAD, rel=EXACT)
        assert fit.stderr == pytest.approx(AHEAD * np.std(gains) / np.sqrt(len(gains)), rel=1e-6)


def test_mirrored_data_swap_the_directions() -> None:
    force = paper(BOTH) + 0.05 * np.random.default_rng(1).standard_normal(len(BOTH))
    plain, mirrored = (analyse(points(sign * BOTH, sign * force), None, 0.0, "") for sign in (1.0, -1.0))
    for here, there in (("forward", "backward"), ("backward", "forward")):
        assert plain.square[here].value == pytest.approx(mirrored.square[there].value, rel=EXACT)
        assert plain.square[here].stderr == pytest.approx(mirrored.square[there].stderr, rel=EXACT)
    assert plain.chosen.form == mirrored.chosen.form
    errors = [[score.cv_rmse for score in analysis.scores] for analysis in (plain, mirrored)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)


TRUTHS = {
    "square": (PowerCurve(30.0), PowerCurve(12.0)),
    "dead-band": (PowerCurve(40.0, n_0=0.12), PowerCurve(25.0, n_0=0.08)),
    "power": (PowerCurve(30.0, 1.5), PowerCurve(20.0, 1.6)),
    "dead-band-power": (PowerCurve(40.0, 1.4, 0.08), PowerCurve(30.0, 1.3, 0.1)),
    "square-saturation": (PowerCurve(40.0, n_sat=0.7), PowerCurve(30.0, n_sat=0.6)),
    "dead-band-saturation": (PowerCurve(60.0, n_0=0.15, n_sat=0.7), PowerCurve(50.0, n_0=0.12, n_sat=0.75)),
    "power-saturation": (PowerCurve(40.0, 1.4, n_sat=0.7), PowerCurve(30.0, 1.3, n_sat=0.75)),
    "dead-band-power-saturation": (PowerCurve(50.0, 1.4, 0.12, 0.7), PowerCurve(40.0, 1.3, 0.1, 0.75)),
}


def series_of(ahead: PowerCurve, astern: PowerCurve, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    level = np.arange(1, count + 1) / count
    n = np.concatenate([-level[::-1], level])
    return n, np.where(n > 0, ahead.thrust(np.abs(n)), -astern.thrust(np.abs(n)))


@pytest.mark.parametrize("name", TRUTHS)
def test_cross_validation_finds_the_form_and_its_truth(name: str) -> None:
    """Exact without noise; with 1 % of full scale on 40 levels a direction parameters within 4 standard errors."""
    n, force = series_of(*TRUTHS[name])
    noisy = force + 0.01 * np.max(np.abs(force)) * np.random.default_rng(7).standard_normal(len(n))
    analysis = analyse(points(n, noisy), None, 0.0, "")
    assert analysis.chosen.form.name == name
    for (side, data), truth in zip(sides_of(points(n, force), None, 0.0).items(), TRUTHS[name], strict=True):
        exact, _ = FORMS[name].fit(data.magnitude, data.thrust, data.weight)
        assert isinstance(exact, PowerCurve) and exact.a == pytest.approx(truth.a, rel=1e-4)
        assert (exact.p, exact.n_0) == pytest.approx((truth.p, truth.n_0), abs=1e-4)
        assert exact.n_sat == (truth.n_sat if truth.n_sat is None else pytest.approx(truth.n_sat, abs=1e-4))
        for key in FORMS[name].free(exact):
            estimate = analysis.parameters[side][key]
            assert isinstance(estimate, Estimate) and abs(estimate.value - getattr(truth, key)) < 4.0 * estimate.stderr


@pytest.mark.parametrize(
    ("n", "force", "words"),
    [
        (BOTH, np.zeros_like(BOTH), "every thrust is zero"),
        (BOTH, -paper(BOTH), r"opposite sign of the control signal.*sign = -1"),
        (BOTH, np.abs(paper(BOTH)), "logged as a magnitude"),
        (np.array([10.0, 20.0]), np.array([1.0, 4.0]), "at least 3 different commands"),
        (np.zeros(5), np.ones(5), "no direction can be fitted"),
        (BOTH + 1500.0, np.abs(paper(BOTH)), r"gives nothing at .*subtract = 1500"),
        (BOTH + 1500.0, paper(BOTH), r"push both ways.*subtract = REST"),
    ],
)
def test_bad_data_are_refused_with_what_to_write(n: np.ndarray, force: np.ndarray, words: str) -> None:
    with pytest.raises(FitError, match=words):
        analyse(points(n, force), None, 0.0, "")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("what", ["no thrust", "tachometer", "two side by side", "reversed"])
def test_contradictions_are_flagged_and_barely_matter(what: str, sign: float) -> None:
    n = sign * BOTH
    force = sign * paper(BOTH) + 0.03 * np.random.default_rng(3).standard_normal(len(BOTH))
    wrong = [25, 26] if what == "two side by side" else [26]
    if what == "tachometer":
        n[wrong] = 0.0
    else:
        force[wrong] = -force[wrong] if what == "reversed" else 0.0
    flagged = flag_contradictions(points(n, force), None)
    assert np.flatnonzero(flagged.flag != "").tolist() == wrong
    assert np.all(flagged.weight[wrong] < 0.01) and np.all(np.delete(flagged.weight, wrong) == 1.0)
    side = sides_of(subtract_tare(flagged)[0], None, 0.0)["forward" if sign > 0 else "backward"]
    assert square_law(side, "N").value == pytest.approx(AHEAD, rel=0.02)


def test_clean_data_have_no_contradictions() -> None:
    flags = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(len(BOTH))
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) + 0.2 * noise), None).flag != "")
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) * (1 + 0.03 * noise)), None).flag != "")
    assert flags <= 4  # of 2400 points
    n = np.arange(-20, 21) / 20.0  # a dead band is no drop-out
    force = np.sign(n) * PowerCurve(30.0, 1.5, 0.12).thrust(np.abs(n))
    assert np.all(flag_contradictions(points(n, force), None).flag == "")
