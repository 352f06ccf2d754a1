"""Bollard tests that others made (T200, VideoRay M5, Kingfisher boat): the numbers known for them."""

import csv
import json
from pathlib import Path

import pytest
from repository import DATA

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.logs import read_column_map
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.result import ThrusterFit

TESTS = DATA / "thrusters"
pytestmark = pytest.mark.real_data(TESTS)

T200, KINGFISHER = "t200_br2019_10-20V.csv", "kingfisher_heron_bollard_{}.csv"
COMMAND = '[columns]\nn = "cmd"\nforce_N = "force_n"\n'
SPEED = '[columns]\nn = { from = "n_rev_s", unit = "rev/s" }\nforce_N = "force_n"\n'
VOLTAGE = 'voltage_V = "nominal_voltage_V"\n'
TWO_TOGETHER = """
[columns]
n = "cmd"
run = "file"
force_N = "force_two_thrusters_n"
[defaults]
thrusters_per_test = 2
"""


def fit(tmp_path: Path, name: str, columns: str) -> ThrusterFit:
    path = tmp_path / "columns.toml"
    path.write_text(columns, encoding="utf-8")
    return fit_thrusters([TESTS / name], columns=read_column_map(path))


def percent(result: ThrusterFit, form: str) -> float:
    score = next(score for score in result.analysis.fits if score.form.name == form)
    return 100.0 * score.rmse / result.analysis.full_scale


def test_t200_against_speed(tmp_path: Path) -> None:
    result = fit(tmp_path, T200, SPEED + VOLTAGE)
    analysis = result.analysis
    assert analysis.square["forward"].value == pytest.approx(0.01471, abs=5e-6)
    assert analysis.square["backward"].value == pytest.approx(0.01169, abs=5e-6)
    assert analysis.square["forward"].unit == "N/(rev/s)²"
    assert analysis.r2(analysis.law) == pytest.approx(0.9992, abs=5e-5)
    assert percent(result, "square") == pytest.approx(0.92, abs=0.005)
    assert analysis.chosen.form.name == "spline"
    assert percent(result, "power") == pytest.approx(0.36, abs=0.005)
    power = next(score for score in analysis.fits if score.form.name == "power")
    for side, exponent in (("forward", 2.10), ("backward", 2.15)):
        assert power.curves[side].values["p"] == pytest.approx(exponent, abs=0.005)
    assert not (result.points.flag != "").any()


def test_kingfisher_saturates_ahead_raw_and_mean(tmp_path: Path) -> None:
    raw, mean = (fit(tmp_path, KINGFISHER.format(of), by) for of, by in (("raw", TWO_TOGETHER), ("mean", COMMAND)))
    assert raw.thrusters_per_test == 2 and raw.samples["plateaus"] == 20
    assert raw.tare.readings == 1 and abs(raw.tare.value_N) < 0.02
    assert raw.points.force.max() == pytest.approx(20.67, abs=0.1)
    assert raw.analysis.chosen.form.name == "power-saturation"
    assert raw.map.forward is not None and raw.map.backward is not None and mean.map.forward is not None
    assert raw.map.forward.n_sat == pytest.approx(0.717, abs=0.01)
    assert raw.map.backward.n_sat is None and not (raw.points.flag != "").any()
    for side in ("forward", "backward"):
        assert raw.analysis.square[side].value == pytest.approx(mean.analysis.square[side].value, rel=0.005)
    assert raw.map.forward.n_sat == pytest.approx(mean.map.forward.n_sat, abs=0.002)


@pytest.mark.parametrize(
    ("name", "columns", "volts", "expected", "before", "after"),
    [
        (T200, COMMAND, 12.0, ["dead-band", "thrust-exponent"], 4.3, 0.6),
        (T200, SPEED, 12.0, ["thrust-exponent"], 0.9, 0.5),
        ("videoray_m5_nezprop.csv", COMMAND, None, ["dead-band", "saturation", "thrust-exponent"], 13.4, 3.0),
        ("videoray_m5_vrprop.csv", COMMAND, None, ["thrust-exponent"], 23.4, 1.6),
        (KINGFISHER.format("mean"), COMMAND, None, ["saturation"], 13.5, 4.6),
    ],
)
def test_what_the_square_law_lacks(
    tmp_path: Path, name: str, columns: str, volts: float | None, expected: list[str], before: float, after: float
) -> None:
    """Against a command an exponent and often more; against speed hardly anything."""
    with (TESTS / name).open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    with (tmp_path / "table.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([head, *(row for row in rows if volts is None or float(row[0]) == volts)])
    square = ThrusterMap("square", PowerCurve(30.0), PowerCurve(30.0 / 1.3))
    (tmp_path / "map.json").write_text(json.dumps(square.to_json()), encoding="utf-8")
    (tmp_path / "columns.toml").write_text(columns, encoding="utf-8")
    result = diagnose([tmp_path / "table.csv"], model=tmp_path / "map.json", columns=tmp_path / "columns.toml")
    assert result.verdict == "named" and sorted(effect.name for effect in result.effects) == expected
    assert 100.0 * result.gap.before / result.data.full_scale == pytest.approx(before, rel=0.03)
    assert 100.0 * result.cross.after / result.data.full_scale < after
    assert result.held_out_gap is not None and result.held_out_gap.after < 0.5 * result.held_out_gap.before
