"""The drag of the base put right beside what is missing, and what runs held out decide."""

from dataclasses import replace

import numpy as np
import pytest
from effect_contract import base_for, measured, planted, short_plans, unmeasured
from few_candidates import few_candidates

from automarine_cli.diagnosis.diagnose import base_estimates, diagnose_runs
from automarine_cli.diagnosis.search import drag_right, without_idle_drag
from automarine_cli.diagnosis.study import DiagnosisProblem, study_of
from automarine_cli.diagnosis.trials import CandidateFit, candidate_fit
from automarine_cli.models.model import Model
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.run import Run

LINEAR = base_for("quadratic-drag")
"""Linear drag alone, where a vehicle with quadratic drag is diagnosed."""


def campaign(*names: str) -> list[Run]:
    """A small campaign of a vehicle with quadratic drag and these effects."""
    return planted(base_for(""), *names, seed=1, plans=short_plans())


@pytest.mark.slow
def test_an_effect_beside_a_wrong_drag_is_named_and_the_drag_counts_for_nothing() -> None:
    with few_candidates({"tether-spring", "quadratic-drag", "battery-sag"}, curves=False):
        found = diagnose_runs(campaign("tether-spring"), LINEAR, hold_out=[])
    with few_candidates({"quadratic-drag", "cubic-drag"}, curves=False):  # a drag missing alone has its name
        alone = diagnose_runs(campaign(), LINEAR, hold_out=[])
    assert found.verdict == "named"
    assert {effect.name for effect in found.effects} == {"tether-spring", "quadratic-drag"}
    assert found.search.final.counted == ("tether-spring",)
    assert found.fitted.gap.after < 1.05 * found.fitted.gap.floor
    assert "drag of the base" in verdict_sentence(found)
    assert alone.verdict == "named" and [effect.name for effect in alone.effects] == ["quadratic-drag"]


def trial(study: DiagnosisProblem, model: Model, *added: str) -> CandidateFit:
    return candidate_fit(study, model, added, study.fit(model))


@pytest.mark.slow
def test_drag_that_nothing_asks_for_is_dropped_and_what_is_lacking_added() -> None:
    runs = campaign("bias-moment")
    study, model = study_of(runs, base_for("")), base_for("").with_effect("bias-moment", [0.05])
    right = trial(study, model, "bias-moment")
    assert drag_right(study, right) is right
    both = trial(study, model.with_effect("linear-drag", [0.01]), "bias-moment", "linear-drag")
    assert drag_right(study, both).added == ("bias-moment",)
    wrong = study_of(runs, LINEAR)
    bare = trial(wrong, LINEAR.with_effect("bias-moment", [0.05]), "bias-moment")
    mended = drag_right(wrong, bare)
    assert mended.added == ("bias-moment", "quadratic-drag") and mended.counted == ("bias-moment",)
    assert without_idle_drag(wrong, bare) is bare
    lean = without_idle_drag(wrong, mended)
    assert lean.added == mended.added and lean.model.drag()[0] == 0.0
    estimates = base_estimates(wrong, lean)
    assert estimates["k_r"].value == estimates["k_r"].ci95[1] == 0.0
    assert estimates["I_r"].ci95[0] < LINEAR.inertia < estimates["I_r"].ci95[1]
    assert replace(bare, added=("quadratic-drag",)).counted == ("quadratic-drag",)  # where nothing else was added
    assert replace(bare, added=()).counted == ()
    truth = LINEAR.with_effect("quadratic-drag", [0.8])  # drag of the base that has something to do stays
    needed = study_of(planted(truth, "bias-moment", seed=1, plans=short_plans()), LINEAR)
    both = trial(needed, truth.with_effect("bias-moment", [0.05]), "quadratic-drag", "bias-moment")
    assert without_idle_drag(needed, both) is both


@pytest.mark.slow
def test_runs_held_out_place_an_edge_that_no_fitted_command_lies_near() -> None:
    """Fitted are moments of 0.1 and of 0.3 and more; the cut is at 0.24, and held out is one of 0.2."""
    truth = base_for("").with_effect("dead-band", [0.24, 1.0, 0.5])
    sizes = (0.1, 0.3, 0.7, 1.2)
    plans = [[(side * size, 8.0)] for size in sizes for side in (1.0, -1.0) for _ in range(2)]
    runs = measured(truth, [unmeasured(plan, i) for i, plan in enumerate(plans)], seed=3)
    between = [[(side * 0.2, 8.0), (side * 0.8, 6.0)] for side in (1.0, -1.0)] * 2
    kept = measured(truth, [unmeasured(plan, i) for i, plan in enumerate(between)], seed=4)
    kept = [replace(run, name=f"kept {run.name}") for run in kept]
    with few_candidates({"dead-band", "coulomb-drag"}, curves=False):
        found = diagnose_runs(runs, base_for(""), hold_out=kept)
    assert found.verdict == "named" and [one.name for one in found.effects] == ["dead-band"]
    assert found.held_out is not None and found.held_out.gap.after < 1.1 * found.held_out.gap.floor
    assert 0.2 < found.effects[0].parameters["width"].value < 0.3
    assert "runs held out" in found.remainder and not np.isnan(found.fitted.gap.after)
