"""The error of runs held out is said twice: with each run's own thrust and start, and from the commands alone."""

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from effect_contract import base_for, short_plans, unmeasured, with_planted
from few_candidates import few_candidates

from automarine_cli.comparison.validation import compare
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.models.store import DIAGNOSIS, StoredModels, read_model
from automarine_cli.report.diagnosis_report import ERRORS, verdict_sentence
from automarine_cli.report.sections import sections
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

BASE, NAME, NOISE_DEG, SEED = base_for(""), "thruster-lag", 0.5, 3


def campaign(scatter: float) -> list[Run]:
    """Runs of a vehicle whose thrust lags and differs from run to run by that share; nothing else does."""
    runs, random = [unmeasured(plan, i) for i, plan in enumerate(short_plans())], np.random.default_rng(1)
    start = Start(np.zeros((1, len(runs))), log_gain=scatter * random.standard_normal((1, len(runs))))
    headings = simulate(with_planted(BASE, NAME), make_batch(runs, 0.05), start=start).position[0]
    headings += np.radians(NOISE_DEG) * random.standard_normal(headings.shape)
    return [replace(run, position=row[: len(run)], extras={}) for run, row in zip(runs, headings)]


@cache
def diagnosed(scatter: float) -> Diagnosis:
    with few_candidates({NAME, "bias-moment"}, curves=False):
        return diagnose_runs(campaign(scatter), BASE, seed=SEED)


def errors(diagnosis: Diagnosis) -> tuple[dict[str, Any], dict[str, Any]]:
    """Of the runs held out: with their own thrust and start, and from the commands alone."""
    data: dict[str, Any] = diagnosis.to_json()
    return data["gap"]["held_out_runs"], data["from_commands"]["held_out_runs"]


@pytest.mark.parametrize("scatter", [pytest.param(0.0, marks=pytest.mark.slow), 0.05])
def test_both_are_equal_where_thrust_is_and_apart_where_it_scatters(scatter: float) -> None:
    diagnosis = diagnosed(scatter)
    own, free = errors(diagnosis)
    assert diagnosis.verdict == "named" and own["after_deg"] == pytest.approx(NOISE_DEG, rel=0.1)
    assert free["after_ci95"][0] < free["after_deg"] < free["after_ci95"][1]
    if scatter:
        assert free["after_deg"] > 4.0 * own["after_deg"]
    else:
        assert free["before_deg"] > 1.2 * free["after_deg"]
        assert free["after_deg"] == pytest.approx(own["after_deg"], rel=0.2)  # the start is a mean of few


def test_the_numbers_are_those_of_validate() -> None:
    """The model after is that of the file, the one before the base as it was refitted."""
    diagnosis = diagnosed(0.05)
    assert diagnosis.held_out is not None
    free, base = errors(diagnosis)[1], diagnosis.to_json()["base"]
    inertia, drag = (base[name]["before"]["value"] for name in ("I_r", "k_rr"))  # type: ignore[index]
    delay = diagnosis.search.study.command_delay(diagnosis.search.base.fit)
    first = Model.base("3", inertia, (drag,), BASE.moment_unit, YAW).delayed(delay)
    files = {
        "before": StoredModels({"3": first}, "3", 0.0, ""),
        "after": read_model(diagnosis.document("extended_model")),
    }
    for word, stored in files.items():
        validation = compare(stored, diagnosis.held_out.runs, SEED)
        rmse = validation.models["3"].overall["rmse"]
        assert rmse.value == pytest.approx(free[f"{word}_deg"], rel=1e-9)
        assert rmse.ci95 == pytest.approx(free[f"{word}_ci95"], rel=1e-9)
        assert validation.floor == free["noise_floor_deg"]


def test_they_stand_together_and_are_read_back() -> None:
    diagnosis = diagnosed(0.05)
    own, free = errors(diagnosis)
    low, high = (f"{end:.3g}" for end in free["after_ci95"])
    shown = sections(diagnosis)
    title = shown.figures["before_after"]().get_suptitle()
    for text in (verdict_sentence(diagnosis), title, str(shown.files["diagnosis.md"]).replace("\\", "")):
        assert f"{own['after_deg']:.3g}" in text and f"{free['after_deg']:.3g} [{low}, {high}]" in text
    caption = re.search(rf"!\[{ERRORS}(.*)\]\(before_after.png\)", str(shown.files["diagnosis.md"]))
    assert caption is not None and f"{free['after_deg']:.3g} ({low}, {high})" in caption[1] and "\\" not in caption[1]
    data: dict[str, Any] = diagnosis.to_json()
    read = DIAGNOSIS.of(data, "diagnosis.json").from_commands
    assert read is not None and read.after == free["after_deg"]
    assert DIAGNOSIS.of({**data, "from_commands": {"held_out_runs": None}}, "").from_commands is None
    del data["from_commands"]  # as earlier versions wrote it
    assert DIAGNOSIS.of(data, "").from_commands is None
