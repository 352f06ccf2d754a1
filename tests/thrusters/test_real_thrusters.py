"""Bollard tests that others made (T200, VideoRay M5, Kingfisher boat): the numbers known for them."""

from pathlib import Path

import pytest
from repository import DATA

from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.logs import read_column_map
from automarine_cli.thrusters.result import ThrusterFit

TESTS = DATA / "thrusters"
pytestmark = pytest.mark.real_data(TESTS)

SPEED = """
[columns]
n = { from = "n_rev_s", unit = "rev/s" }
force_N = "force_n"
voltage_V = "nominal_voltage_V"
"""
COMMAND_AND_VOLTAGE = """
[columns]
n = "cmd"
force_N = { from = "Force_kgf", unit = "kgf" }
voltage_V = "nominal_voltage_V"
"""
COMMAND = """
[columns]
n = "cmd"
force_N = "force_n"
"""
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
    score = next(score for score in result.analysis.scores if score.form.name == form)
    return 100.0 * score.rmse / result.analysis.full_scale


def test_t200_against_speed(tmp_path: Path) -> None:
    result = fit(tmp_path, "t200_br2019_10-20V.csv", SPEED)
    analysis = result.analysis
    assert analysis.square["forward"].value == pytest.approx(0.01471, abs=5e-6)
    assert analysis.square["backward"].value == pytest.approx(0.01169, abs=5e-6)
    assert analysis.square["forward"].unit == "N/(rev/s)²"
    assert analysis.r2 == pytest.approx(0.9992, abs=5e-5)
    assert percent(result, "square") == pytest.approx(0.92, abs=0.005)
    assert analysis.chosen.form.name == "power"
    assert percent(result, "power") == pytest.approx(0.36, abs=0.005)
    for side, exponent in (("forward", 2.10), ("backward", 2.15)):
        assert analysis.parameters[side]["p"].value == pytest.approx(exponent, abs=0.005)
    drift = result.exponents["forward"]
    assert drift is not None and drift.drift_percent == pytest.approx(3.6, abs=0.2)
    assert not (result.points.flag != "").any()


def test_t200_against_command(tmp_path: Path) -> None:
    result = fit(tmp_path, "t200_br2019_10-20V.csv", COMMAND_AND_VOLTAGE)
    assert [volts for volts, _ in result.voltages] == [10.0, 12.0, 14.0, 16.0, 18.0, 20.0]
    twelve = result.voltages[1][1]
    assert twelve.percent(twelve.law.rmse) == pytest.approx(4.3, abs=0.05)
    assert twelve.chosen.form.name == "dead-band-power"
    assert twelve.percent(twelve.chosen.rmse) == pytest.approx(0.4, abs=0.05)
    for found in result.exponents.values():
        assert found is not None
        steps = {(low, high): p for low, high, p in found.between}
        full = max(found.places)[1]
        assert 1.1 < steps[14.0, 16.0] < 1.3 and 1.2 < steps[12.0, 14.0] < 1.4
        assert 1.0 < full < 1.3  # at full command; far from the V² of a speed that follows the voltage
    assert any("set to zero" in note for note in result.notes)


@pytest.mark.parametrize(
    ("name", "square", "chosen", "error"),
    [
        ("videoray_m5_nezprop.csv", 13.4, "dead-band-power-saturation", 1.3),
        ("videoray_m5_vrprop.csv", 23.4, "power", 1.3),
    ],
)
def test_videoray_m5(tmp_path: Path, name: str, square: float, chosen: str, error: float) -> None:
    """Against command the square law is wrong by 4 to 25 % of full scale."""
    result = fit(tmp_path, name, COMMAND)
    assert percent(result, "square") == pytest.approx(square, abs=0.1)
    assert result.analysis.chosen.form.name == chosen
    assert percent(result, chosen) < error


def test_kingfisher_raw_series_saturates_ahead(tmp_path: Path) -> None:
    result = fit(tmp_path, "kingfisher_heron_bollard_raw.csv", TWO_TOGETHER)
    assert result.thrusters_per_test == 2 and result.reduction.plateaus == 20
    assert result.tare.readings == 1 and abs(result.tare.value) < 0.02
    assert result.points.force.max() == pytest.approx(20.67, abs=0.1)
    assert result.analysis.chosen.form.name == "power-saturation"
    forward, backward = result.map.forward, result.map.backward
    assert forward is not None and forward.n_sat == pytest.approx(0.717, abs=0.01)
    assert backward is not None and backward.n_sat is None
    assert not (result.points.flag != "").any()


def test_kingfisher_raw_and_mean_agree(tmp_path: Path) -> None:
    raw = fit(tmp_path, "kingfisher_heron_bollard_raw.csv", TWO_TOGETHER)
    mean = fit(tmp_path, "kingfisher_heron_bollard_mean.csv", COMMAND)
    for side in ("forward", "backward"):
        assert raw.analysis.square[side].value == pytest.approx(mean.analysis.square[side].value, rel=0.005)
    assert raw.map.forward is not None and mean.map.forward is not None
    assert raw.map.forward.n_sat == pytest.approx(mean.map.forward.n_sat, abs=0.002)
