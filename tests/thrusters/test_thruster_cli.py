"""`automarine fit-thrusters` from end to end: options, files, terminal, refusals."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from automarine_cli.commands.compare import compare
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.thrusters.map import ThrusterMap

Run = Callable[..., Result]
AHEAD, ASTERN = 5.233e-4, 1.328e-4  # the source paper's equation 3, two thrusters together
LEVELS = np.arange(-150.0, 151.0, 10.0)


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = "\n".join(",".join(f"{value:.10g}" for value in row) for row in zip(*columns))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


def text(path: Path, content: str) -> Path:
    path.write_text(content, encoding="utf-8")
    return path


def two_thrusters(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(LEVELS))
    noise[LEVELS == 0] = 0.0
    return write(tmp_path / "bollard.csv", "n,force_N", LEVELS, two_thrusters(LEVELS) + noise)


def test_how_many_pulled_is_an_option_or_in_the_column_map(run: Run, log: Path, tmp_path: Path) -> None:
    assert "One thruster is taken to have pulled in each test" in " ".join(run("fit-thrusters", log).stdout.split())
    columns = text(tmp_path / "map.toml", "[defaults]\nthrusters_per_test = 2\n")
    pair, single = (
        json.loads(run("fit-thrusters", log, "--columns", columns, *more, "--json").stdout)
        for more in ((), ("--thrusters-per-test", 1))
    )
    assert (pair["thrusters_per_test"], single["thrusters_per_test"]) == (2, 1)
    assert not any("is taken to have pulled" in note for data in (pair, single) for note in data["notes"])
    assert single["forward"]["a"]["value"] == pytest.approx(2 * pair["forward"]["a"]["value"])
    for side, truth in (("forward", AHEAD), ("backward", ASTERN)):
        together = pair["per_test"][side]["a"]
        assert together["value"] == pytest.approx(2 * pair[side]["a"]["value"], rel=1e-12)
        assert together["ci95"][0] < truth < together["ci95"][1]
    assert ThrusterMap.from_json(pair).force(100.0) == pytest.approx(1e4 * pair["forward"]["a"]["value"])


def test_a_command_that_never_rests_is_no_static_test(run: Run, tmp_path: Path) -> None:
    fast, slow = np.arange(0.0, 30.0, 0.02), np.arange(0.0, 30.0, 0.1)
    chirp, steps = 150 * np.sin(np.pi * fast**2 / 6), 25.0 * np.floor(fast / 2) - 175
    square = np.where(chirp > 0, 150.0, -150.0)
    for time, n, status in ((fast, chirp, 1), (fast, square, 1), (fast, steps, 0), (slow, 10 * slow - 150, 0)):
        file = write(tmp_path / "test.csv", "time_s,n,force_N", time, n, two_thrusters(n))
        result = run("fit-thrusters", file, "-o", tmp_path / "out", "--overwrite")
        assert result.exit_code == status, result.stderr
        if status:
            assert "a dynamic test: in " in result.stderr and "hold each of eight or more" in result.stderr
            assert not (tmp_path / "out").exists()


def supplies(path: Path, header: str) -> Path:
    """A test at five voltages: at one command thrust goes with the square of the voltage."""
    volts, n = np.meshgrid([10.0, 12.0, 14.0, 16.0, 20.0], np.arange(-100.0, 101.0, 10.0))
    force = 0.004 * n * np.abs(n) * (volts / 16.0) ** 2
    return write(path, header, n.ravel(), force.ravel(), volts.ravel())


def test_one_command_with_many_thrusts_asks_for_the_supply(run: Run, tmp_path: Path) -> None:
    log = supplies(tmp_path / "volts.csv", "n,force_N,nominal_supply_volts")
    refused = run("fit-thrusters", log)
    assert refused.exit_code == 1 and "does nominal_supply_volts (10 to 20) hold the supply?" in refused.stderr
    columns = text(tmp_path / "map.toml", '[columns]\nvoltage_V = "nominal_supply_volts"\n')
    assert "A map for each voltage" in run("fit-thrusters", log, "--columns", columns).stdout
    fit = fit_thrusters([supplies(tmp_path / "other.csv", "n,force_N,seen_by")], thrusters_per_test=1)
    assert set(fit.points.flag) == {""}  # what changed for another reason throws no point out
    assert any("something else changed between tests, and the map is a mean" in note for note in fit.notes)


def test_points_of_less_weight_are_printed_and_counted_beside(run: Run, tmp_path: Path) -> None:
    force = two_thrusters(LEVELS) + 0.02 * np.random.default_rng(1).standard_normal(len(LEVELS))
    force[26] = 0.0  # the load cell dropped out
    log = write(tmp_path / "faulty.csv", "n,force_N", LEVELS, force)
    assert "outlier: " in run("fit-thrusters", log).stdout
    fit = fit_thrusters([log], thrusters_per_test=1)
    data = json.loads(json.dumps(fit.to_json()))
    assert data["flagged"][0]["n"] == 110.0 and data["flagged"][0]["weight"] < 0.01
    assert data["forward"]["points"] == 15
    assert data["forward"]["a"]["value"] == pytest.approx(AHEAD, rel=0.01)
    off = fit.points.force - fit.analysis.law.along(fit.points.n)
    assert data["rmse_all_points_N"] == pytest.approx(np.sqrt(np.mean(off**2)))
    assert data["rmse_all_points_N"] > 3 * data["rmse_N"]


def test_signs_and_offsets_are_refused_with_what_to_write(run: Run, tmp_path: Path) -> None:
    log, out = write(tmp_path / "wrong.csv", "n,force_N", LEVELS, -two_thrusters(LEVELS)), tmp_path / "out"
    refused = run("fit-thrusters", log, "-o", out)
    assert refused.exit_code == 1 and "sign = -1" in refused.stderr and not out.exists()
    columns = text(tmp_path / "sign.toml", '[columns]\nforce_N = { from = "force_N", sign = -1 }\n')
    assert run("fit-thrusters", log, "--columns", columns).exit_code == 0
    volts = 0.0175 - np.abs(two_thrusters(LEVELS)) / 5209.0  # fall with thrust either way, 0.0175 at rest
    cell = write(tmp_path / "cell.csv", "n,v_load_V", LEVELS, volts)
    columns = text(tmp_path / "cell.toml", '[columns]\nforce_N = { from = "v_load_V", scale = -5209 }\n')
    refused = run("fit-thrusters", cell, "--columns", columns)
    assert refused.exit_code == 1 and "Write subtract = 0.0175 in the line of the force" in refused.stderr


@pytest.mark.slow
def test_voltage_gives_a_map_each_and_the_exponent(run: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    volts = np.repeat([10.0, 12.0, 14.0, 16.0], len(LEVELS))
    n = np.tile(LEVELS, 4)
    force = two_thrusters(n) * (volts / 12.0) ** 1.2 * (1 + 0.003 * rng.standard_normal(len(n)))
    sagging = volts * (1 - 0.002 * np.abs(n) / 150)
    log = write(tmp_path / "volts.csv", "n,force_N,voltage_V", n, force, sagging)
    data = json.loads(run("fit-thrusters", log, "--json").stdout)
    assert data == json.loads(run("fit-thrusters", log, "--json", "--jobs", 2).stdout)
    for entry, step in zip(data["voltages"], (10.0, 12.0, 14.0, 16.0), strict=True):
        assert entry["voltage_V"] == pytest.approx(step, rel=0.003)
        assert entry["forward"]["a"]["value"] == pytest.approx(AHEAD * (step / 12) ** 1.2, rel=0.01)
    for side in ("forward", "backward"):
        estimate = data["voltage_exponent"][side]["thrust_at_fixed_n"]
        assert abs(estimate["value"] - 1.2) < 4 * estimate["stderr"] + 0.01
    assert any("that voltage's map" in note for note in data["notes"])


def test_one_direction_and_missing_values(run: Run, tmp_path: Path) -> None:
    log = text(tmp_path / "ahead.csv", "n,force_N\n1,2\n2,8\n,3\n3,18\n4,\n5,50\n6,72\n")
    assert "2 rows without a control signal or a force" in run("fit-thrusters", log).stdout
    data = json.loads(run("fit-thrusters", log, "--json").stdout)
    assert data["backward"] == {"a": None, "points": 0, "levels": 0, "why": "no backward points"}
    assert data["forward"]["a"]["value"] == pytest.approx(2.0)
    assert ThrusterMap.from_json(data).force(2.0) == pytest.approx(8.0, rel=1e-6)


@pytest.fixture
def throttle(tmp_path: Path) -> Path:
    """Thrust against a throttle: far from the square law, with a dead band and no saturation."""
    n = np.arange(-20, 21) / 20.0
    thrust = 60.0 * np.sign(n) * np.maximum(np.abs(n) - 0.1, 0.0) ** 1.2
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(n))
    return write(tmp_path / "throttle.csv", "n,force_N", n, thrust + noise)


def test_maps_with_a_parameter_at_its_bound_are_shown_and_compared(throttle: Path, tmp_path: Path) -> None:
    form = "dead-band-power-saturation"
    fits = [fit_thrusters([throttle], out=tmp_path / name, form=form) for name in ("a", "b")]
    assert "no saturation within the measured range" in repr(fits[0])
    frame = fits[0].to_frame().set_index(["form", "parameter", "direction"])
    assert np.isnan(frame.loc[(form, "n_sat", "forward"), "value"])
    comparison = compare([tmp_path / "a", tmp_path / "b"])
    names = [difference.parameter for difference in comparison.differences]
    assert f"p forward, form {form}" in names and f"n_sat forward, form {form}" not in names
    assert comparison.sides[0].facts[f"n_sat forward, form {form}"] == "no saturation within the measured range"
