"""`compare`: differences of results with intervals that hold, words that agree with them, and refusals."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from automarine_cli.commands.compare import compare
from automarine_cli.comparison.side_by_side import (
    DIFFERS,
    MAY_DIFFER,
    NOT_SHOWN,
    ComparedResult,
    difference,
    differences,
    holm,
    p_value,
)
from automarine_cli.errors import AutomarineError, ModelError, SettingError
from automarine_cli.estimate import Estimate


def normal(value: float, stderr: float, unit: str = "nu s²") -> Estimate:
    return Estimate.from_stderr(value, stderr, 1e6, unit)


def result_file(folder: Path, name: str, content: dict[str, Any]) -> Path:
    folder.mkdir(parents=True)
    (folder / name).write_text(json.dumps({"runs": {"used": 20, "set_aside": []}} | content))
    return folder


def yaw_model(folder: Path, *, k_rr: float = 1.25, I_r: float = 1.0, unit: str = "nu", preferred: str = "3") -> Path:
    """A folder with the result file of a fit of which models 2 and 3 are known."""
    model: dict[str, Any] = {"k_rr": normal(k_rr, 0.01).to_json(), "I_r": normal(I_r, 0.02).to_json()}
    return result_file(folder, "yaw_model.json", {
        "schema": "automarine/yaw-model/1", "moment_unit": unit, "models": {"2": model, "3": model},
        "preferred": preferred, "effects": [], "heading_noise_deg": 1.0,
    })  # fmt: skip


def thruster_map(folder: Path, a: float = 2.6e-4, form: str = "square", p: float = 2.0) -> Path:
    """A folder with the result file of a bollard test."""
    side = {"a": normal(a, 1e-6, "N/n²").to_json(), "points": 30}
    return result_file(folder, "thrusters.json", {
        "schema": "automarine/thruster-map/1", "forward": side, "backward": {"a": None, "points": 0}, "form": form,
        "chosen": {"rmse_percent_of_full_scale": 0.8}, "parameters": {"forward": {"p": normal(p, 0.01, "1").to_json()}},
    })  # fmt: skip


@pytest.mark.parametrize("sign", [1, -1])
def test_difference_of_normal_estimates_is_the_textbook_one(sign: int) -> None:
    apart = difference(normal(1.2 + 0.1 * sign, 0.03), normal(1.2, 0.04))
    assert (apart.value, apart.stderr) == (pytest.approx(0.1 * sign), pytest.approx(0.05))
    assert apart.ci95 == pytest.approx((0.1 * sign - 1.95996 * 0.05, 0.1 * sign + 1.95996 * 0.05), abs=1e-5)
    assert p_value(apart) == pytest.approx(2 * stats.norm.sf(2.0), rel=1e-4)
    edge = difference(normal(sign * 1.959964 * 0.05, 0.04), normal(0.0, 0.03))  # the interval ends at zero
    assert p_value(edge) == pytest.approx(0.05, abs=1e-4)


def test_intervals_of_differences_hold_as_often_as_they_say() -> None:
    """Two positive parameters known to 20 and 10 percent on their logarithms: 95 of 100 intervals hold the truth."""
    rng, inside = np.random.default_rng(5), 0
    for _ in range(2000):
        first = Estimate.from_log(1.3 * np.exp(0.2 * rng.standard_normal()), 0.2, 1e6, "s")
        second = Estimate.from_log(0.9 * np.exp(0.1 * rng.standard_normal()), 0.1, 1e6, "s")
        low, high = difference(first, second).ci95
        inside += low <= 1.3 - 0.9 <= high
    assert stats.binomtest(inside, 2000, 0.95).pvalue > 0.001, inside


def test_words_allow_for_the_number_of_comparisons() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])  # as in the book
    assert holm([0.9, 0.9]) == [1.0, 1.0] and holm([]) == []
    base = {f"p{i}": normal(1.0, 0.01) for i in range(10)} | {"unit": normal(1.0, 0.1, "s")}
    other = base | {"p0": normal(1.2, 0.01), "p1": normal(1.031, 0.01), "p2": normal(1.01, 0.01)}
    other |= {"unit": normal(1.0, 0.1, "m"), "alone": normal(1.0, 0.1)}  # neither is compared
    result = {
        row.parameter: row for row in differences([ComparedResult("a", base, {}, 1), ComparedResult("b", other, {}, 1)])
    }
    assert set(result) == {f"p{i}" for i in range(10)}
    assert [result[f"p{i}"].verdict for i in range(4)] == [DIFFERS, MAY_DIFFER, NOT_SHOWN, NOT_SHOWN]
    assert result["p0"].relative == pytest.approx((20.0, 17.23, 22.77), abs=0.01)


def test_other_preferred_models_are_told_apart(tmp_path: Path) -> None:
    folders = [yaw_model(tmp_path / "a"), yaw_model(tmp_path / "b", preferred="2")]
    result = compare(folders)
    assert {row.parameter for row in result.differences} == {
        "k_rr, model 2", "I_r, model 2", "k_rr, model 3", "I_r, model 3",
    }  # fmt: skip
    assert result.notes == ("Not the same preferred model: a: 3; b: 2.",)


def test_thruster_maps_side_by_side(tmp_path: Path) -> None:
    result = compare([thruster_map(tmp_path / "a"), thruster_map(tmp_path / "b", a=2.5e-4)])
    assert [(row.parameter, row.verdict) for row in result.differences] == [("a forward, square law", DIFFERS)]
    result = compare([thruster_map(tmp_path / "c", form="power"), thruster_map(tmp_path / "d", form="power", p=2.2)])
    assert {row.parameter: row.verdict for row in result.differences} == {
        "a forward, square law": NOT_SHOWN, "p forward, form power": DIFFERS,
    }  # fmt: skip


def spoiled(folder: Path, change: Callable[[str], str]) -> Path:
    """The result of a fit with another text."""
    path = yaw_model(folder) / "yaw_model.json"
    path.write_text(change(path.read_text()))
    return folder


@pytest.mark.parametrize(
    ("make", "error", "says"),
    [
        (lambda at: [], SettingError, "one result was given; give two or more"),
        (lambda at: [at / "a"], SettingError, "is given twice"),
        (
            lambda at: [thruster_map(at / "b")], SettingError,
            "results of fit-yaw and fit-thrusters cannot be compared (a: fit-yaw; b: fit-thrusters); compare results",
        ),
        (
            lambda at: [yaw_model(at / "b", unit="N m")], SettingError,
            "moments in nu and N m cannot be compared (a: nu; b: N m); compare results in one unit: there is no factor",
        ),
        (lambda at: [yaw_model(at / "c" / "yaw").parent], SettingError, "of a campaign compare one step"),
        (lambda at: [at], SettingError, "holds no result of fit-thrusters, fit-yaw, validate or"),
        (lambda at: [spoiled(at / "b", lambda text: text.replace("model/1", "model/2"))], ModelError, "yaw_model.json"),
        (lambda at: [spoiled(at / "b", lambda text: "{")], ModelError, "yaw_model.json"),
        (
            lambda at: [spoiled(at / "b", lambda text: text.replace("stderr", "error"))], ModelError,
            "b/yaw_model.json: models.3.k_rr: found a number without stderr and ci95, expected an estimate",
        ),
    ],
)  # fmt: skip
def test_refusals(tmp_path: Path, make: Callable[[Path], list[Path]], error: type[AutomarineError], says: str) -> None:
    with pytest.raises(error, match=re.escape(says)):
        compare([yaw_model(tmp_path / "a"), *make(tmp_path)])


def validation(folder: Path, by_run: dict[str, float]) -> Path:
    """A folder with the result file of a validation of one model."""
    runs = {name: {"rmse_deg": error} for name, error in by_run.items()}
    return result_file(folder, "validation.json", {
        "schema": "automarine/validation/1", "models": {"3": {"rmse_deg": 1.0, "runs": runs}}, "best": "3",
        "preferred_by_fit": "3", "logs": {name: {"samples": 100} for name in runs}, "noise_floor_deg": 1.0,
    })  # fmt: skip


def test_validations_of_the_same_runs_are_compared_run_by_run(tmp_path: Path) -> None:
    good = validation(tmp_path / "good", {"a": 1.0, "b": 1.5, "c": 0.8})
    (row,) = compare([good, validation(tmp_path / "bad", {"a": 1.3, "b": 1.9, "c": 1.0, "d": 9.0})]).differences
    interval = stats.ttest_1samp([0.3, 0.4, 0.2], 0.0).confidence_interval(0.95)
    assert row.difference.value == pytest.approx(0.3)
    assert row.difference.ci95 == pytest.approx([interval.low, interval.high])
    with pytest.raises(AutomarineError, match="two runs in common"):
        compare([good, validation(tmp_path / "alone", {"a": 1.3, "d": 1.0})])
