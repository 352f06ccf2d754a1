"""`automarine export --to card`: parameters, intervals, signs, range, data and effects of a real fit."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from automarine_cli.commands.export import export
from automarine_cli.pipeline.results_folder import sha256


@pytest.fixture
def fitted(small_day: Path) -> Path:
    """The folder of a small yaw fit."""
    return small_day / "out" / "yaw"


def test_the_card_says_what_the_model_file_and_its_manifest_say(fitted: Path) -> None:
    text = export(fitted / "yaw_model.json", to="card", number="2").text
    data = json.loads((fitted / "yaw_model.json").read_text())
    for name in ("I_r", "k_rr", "k_r"):
        (row,) = re.findall(rf"^\| (?:[\w-]+ )?{name} \|.*$", text, flags=re.MULTILINE)
        cells, entry = [cell.strip() for cell in row.strip("|").split("|")], data["models"]["2"][name]
        assert float(cells[2]) == pytest.approx(entry["value"], rel=1e-4)
        assert float(cells[3]) == pytest.approx(entry["stderr"], rel=0.06)
        assert [float(x) for x in cells[4].split(" to ")] == pytest.approx(entry["ci95"], rel=1e-3)
        assert cells[5] == entry["unit"]
    manifest = json.loads((fitted / "manifest.json").read_text())
    assert all(entry["sha256"] in text for entry in manifest["inputs"])
    assert sha256(fitted / "yaw_model.json") in text
    low, high = data["valid_range"]["moment"]
    assert f"moment: {low:.4g}"[:11] in text and low < 0 < high
    assert "drag coefficients are positive" in text and "Frame: NED world" in text
    assert "- quadratic-drag: `-k_rr |r| r`. " in text


def test_the_covariance_of_the_file_is_that_of_its_standard_errors_and_the_range_that_of_the_runs(fitted: Path) -> None:
    """I/k_rr tells how the two go together: its relative error is that of their difference on the logarithm."""
    data = json.loads((fitted / "yaw_model.json").read_text())
    for number in ("2", "3"):
        fit = data["models"][number]
        covariance = fit["output_error"]["covariance"]
        matrix, names = np.array(covariance["matrix"]), covariance["parameters"]
        np.testing.assert_allclose(np.sqrt(np.diag(matrix)), [fit[n]["stderr"] for n in names], rtol=1e-9)
        np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
        assert np.all(np.linalg.eigvalsh(matrix) > 0)
        values = np.array([fit[n]["value"] for n in names])
        relative = matrix / np.outer(values, values)
        angle = fit["inertial_turn_angle_rad"]
        spread = np.sqrt(relative[0, 0] + relative[1, 1] - 2 * relative[0, 1])
        assert angle["stderr"] / angle["value"] == pytest.approx(spread, rel=1e-9)
    k_rr, (low, high) = data["models"]["3"]["k_rr"]["value"], data["valid_range"]["moment"]
    rates = data["valid_range"]["yaw_rate_rad_s"]
    if data["preferred"] == "3":
        assert rates == pytest.approx([-np.sqrt(-low / k_rr), np.sqrt(high / k_rr)])
    assert rates[0] < 0 < rates[1]


BARE = {
    "schema": "automarine/yaw-model/1", "moment_unit": "nu", "models": {"3": {"k_rr": 1.2, "I_r": 1.0}},
    "preferred": "3",
}  # fmt: skip


def test_units_and_frame_turn_values_and_intervals(tmp_path: Path) -> None:
    def estimate(value: float, spread: float) -> dict[str, object]:
        return {"value": value, "stderr": spread, "ci95": [value - 2 * spread, value + 2 * spread], "unit": "nu"}

    path = tmp_path / "extended_model.json"
    compass = {"B": estimate(0.05, 0.004), "C": estimate(-0.03, 0.002), "D": 0.02, "E": 0.01}
    content = BARE | {
        "models": {"3": {"k_rr": estimate(1.2, 0.1), "I_r": estimate(1.0, 0.05)}},
        "effects": [
            {"name": "bias-moment", "parameters": {"b": estimate(0.1, 0.01)}},
            {"name": "compass-deviation", "parameters": compass},
        ],
        "valid_range": {"moment": [-0.5, 1.0], "yaw_rate_rad_s": None},
        "parent": {"file": "yaw_model.json", "sha256": "ab" * 32},
    }
    path.write_text(json.dumps(content))
    text = export(path, to="card", frame="ENU", newton_metres_per_nu=2.0).text
    lines = (line.strip("|").split("|") for line in text.splitlines() if line.startswith("| "))
    rows = {name.strip(): [cell.strip() for cell in cells] for name, *cells in lines}
    assert rows["I_r"][1:] == ["2.0000", "0.10", "1.800 to 2.200", "N m s²"]
    assert rows["bias-moment b"][1:] == ["-0.20000", "0.020", "-0.2400 to -0.1600", "N m"]
    assert rows["compass-deviation B"][1:4] == ["0.030000", "0.0020", "0.02600 to 0.03400"]
    assert rows["compass-deviation C"][1:4] == ["-0.050000", "0.0040", "-0.05800 to -0.04200"]
    assert rows["compass-deviation D"][1:4] == ["-0.020000", "–", "–"]
    assert "moment: -2.000 to 1.000 N m" in text
    assert f"Grew from `yaw_model.json`, SHA-256 `{'ab' * 32}`." in text
    assert "there is no manifest.json beside the model file" in text
