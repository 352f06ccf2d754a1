"""validate with a planar model: errors at the noise for the truth, starts, sides, files, figures, what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_planar import Craft, driven, quadratic_drags, solved
from repository import SAMPLE_RUNS

import automarine_cli as am
from automarine_cli.comparison.simulated_runs import FreeRun, planar_free_runs
from automarine_cli.comparison.validation import PLANAR_SCORES, Scored, compare, planar_errors, pooled
from automarine_cli.errors import RunError, SettingError
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels, planar_json
from automarine_cli.report.figures.runs import planar_figure
from automarine_cli.report.validation_report import planar_table
from automarine_cli.runs.run import Run

CRAFT = Craft(np.diag([20.0, 32.0, 2.6]), linear=np.diag([8.0, 20.0, 3.0]))
MODEL = quadratic_drags(20.0, 32.0, 2.6, drags=(8.0, 20.0, 3.0), name="linear-drag")
NAMES = ("north", "east", "heading", "surge", "sway", "yaw_rate")


def scores_of(free: FreeRun) -> dict[str, float | None]:
    return {name: pooled([planar_errors(free)], score).value for name, score in PLANAR_SCORES.items()}


def planar_scored(model: Model, runs: list[Run]) -> Scored:
    return compare(StoredModels({"planar": model}, "planar", 0.0, "planar_model.json"), runs).models["planar"]


def logged(seed: int = 0, side: float = 1.0, moving: bool = False, noise: float = 0.0) -> Run:
    """A run of the craft with every channel; `side` -1 is its mirror image."""
    run, rng = driven(seed, 20.0), np.random.default_rng(seed)
    extras = {**run.extras, "force_Y": side * run.extras["force_Y"]}
    run = replace(run, moment=side * run.command, extras=extras)
    if not moving:
        rest = run.time < run.time[0] + 2.5
        quiet = {name: np.where(rest, 0.0, column) for name, column in run.extras.items()}
        run = replace(run, moment=np.where(rest, 0.0, run.command), extras=quiet)
    start = ((1.0, 2.0 * side, 0.3 * side), (0.5, 0.1 * side, 0.2 * side) if moving else (0, 0, 0))
    truth = dict(zip(NAMES, np.column_stack(solved(CRAFT, run, *start)).T))
    read = {name: column + noise * rng.standard_normal(len(run)) for name, column in truth.items()}
    heading = read.pop("heading")
    return replace(run, position=heading, extras={**run.extras, **read})


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_true_model_makes_no_error(side: float, moving: bool) -> None:
    (free,) = planar_free_runs(MODEL, [logged(1, side, moving)])
    scores = scores_of(free)
    close = 2e-3 if moving else 2e-4  # a command that comes at once is half a sample late in a log
    assert max(value for name, value in scores.items() if value and name.endswith("m_s")) < close
    assert scores["heading_rmse_deg"] < 200 * close and scores["position_rmse_m"] < 10 * close  # type: ignore[operator]
    assert not free.diverged


def test_the_error_is_the_noise_and_a_wrong_model_s_is_more() -> None:
    runs = [logged(seed, noise=0.02) for seed in range(3)]
    lighter = replace(MODEL, masses=(20.0, 20.0, 2.6, 0.0, 0.0, 0.0))
    truth, wrong = (planar_scored(candidate, runs).overall for candidate in (MODEL, lighter))
    for name in ("surge_rmse_m_s", "sway_rmse_m_s"):
        assert truth[name].value == pytest.approx(0.02, rel=0.15)
        low, high = truth[name].ci95  # type: ignore[misc]
        assert low < truth[name].value < high
    assert truth["heading_rmse_deg"].value == pytest.approx(np.rad2deg(0.02), rel=0.3)
    assert wrong["sway_rmse_m_s"].value > 1.5 * truth["sway_rmse_m_s"].value  # type: ignore[operator]


def test_channels_that_are_not_logged_have_no_score() -> None:
    run = logged(3)
    gone = {name: column for name, column in run.extras.items() if name not in ("north", "sway", "yaw_rate")}
    holes = np.where(np.arange(len(run)) % 3, np.nan, gone["surge"])
    (free,) = planar_free_runs(MODEL, [replace(run, extras={**gone, "surge": holes})])
    scores = scores_of(free)
    assert [name for name, value in scores.items() if value is None] == [
        "position_rmse_m", "position_max_abs_m", "sway_rmse_m_s", "yaw_rate_rmse_deg_s",
    ]  # fmt: skip
    assert scores["surge_rmse_m_s"] < 1e-3 and planar_figure(free).axes


def test_a_model_that_runs_away_is_said_to() -> None:
    driving = MODEL.with_theta([*MODEL.masses, -80.0, 20.0, 3.0])
    result = compare(StoredModels({"planar": driving}, "planar", 0.0, ""), [logged(0)])
    scored = result.models["planar"]
    assert scored.free[0].diverged and planar_table(result).rows[0][2] == "diverged"
    assert {score.value for score in scored.overall.values()} == {None}
    assert result.to_json()["models"]["planar"]["diverged"]
    assert "diverges" in planar_figure(scored.free[0]).get_suptitle()


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A file with the truth of the sample campaign."""
    truth = json.loads((SAMPLE_RUNS / "planar.truth.json").read_text())
    data = {"schema": "automarine/planar-model/1", "parameters": truth["vehicle"]["parameters"] | truth["hidden"]}
    path = tmp_path / "planar_model.json"
    path.write_text(json.dumps(data))
    return path


def test_refusals(tmp_path: Path, model: Path) -> None:
    with pytest.raises(SettingError, match="every channel of its logs is compared; leave --channels out"):
        am.validate(SAMPLE_RUNS / "planar", model=model, channels="position")
    with pytest.raises(RunError, match="no usable run in"):
        am.validate(SAMPLE_RUNS / "surge", model=model)
    (tmp_path / "wrong.json").write_text(json.dumps(planar_json(MODEL) | {"force_unit": "nu"}))
    with pytest.raises(Exception, match="coupled motions are in newtons"):
        am.validate(SAMPLE_RUNS / "planar", model=tmp_path / "wrong.json")
