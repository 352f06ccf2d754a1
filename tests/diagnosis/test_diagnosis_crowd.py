"""Several effects that are one in disguise, and effects that undo each other."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effect_contract import base_for, long_plans, measured, unmeasured

from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.scores import score
from automarine_cli.diagnosis.search import (
    CandidateFit,
    SearchStep,
    add_effect,
    candidate_fit,
    compensating,
    single_effect_alternative,
)
from automarine_cli.diagnosis.study import DiagnosisProblem, study_of
from automarine_cli.models.yaw_model import YawModel

BASE = base_for("")
PLANS = [[(sign * size, 4.0 + 3.0 / size**0.5)] for size in (0.25, 0.4, 0.7, 1.2) for sign in (1.0, -1.0)]


def each(function: Callable[[Any], Any], work: Sequence[Any], label: str) -> list[Any]:
    return [function(one) for one in work]


def study_with(truth: YawModel, plans: Sequence[Any], noise_deg: float = 0.5) -> DiagnosisProblem:
    """Runs of a vehicle of that truth."""
    runs = [unmeasured(plan, i) for i, plan in enumerate(plans)]
    return study_of(measured(truth, runs, seed=4, noise_deg=noise_deg, gain=0.005), BASE)


def grown(study: DiagnosisProblem, base: CandidateFit, *added: tuple[str, tuple[float, ...]]) -> CandidateFit:
    trial: CandidateFit | None = base
    for name, start in added:
        assert trial is not None
        trial = add_effect(study, trial, (name, np.array(start)))
    assert trial is not None
    return trial


@pytest.mark.slow
def test_a_lag_of_the_thrust_takes_the_place_of_what_imitates_it() -> None:
    truth = BASE.with_effect("thruster-lag", (0.4, 1.0))
    study = study_with(truth, [[(-m, s) for m, s in plan] for plan in long_plans()[::2]])
    base = candidate_fit(study, BASE, (), study.fit(BASE))
    delay, slow = ("input-delay", (0.2, 0.0, 0.1)), ("sensor-lag", (0.2,))
    several = grown(study, base, delay, slow)
    scores = score(study, BASE, base.fit, ["input-delay", "sensor-lag", "thruster-lag"], 0)
    first = SearchStep(base, scores, (grown(study, base, delay), grown(study, base, slow)), 0.0)
    found, says = single_effect_alternative(study, several, first, each)
    assert found.added == ("thruster-lag",) and found.model.terms[-1].values[1] == 1.0
    assert found.model.terms[-1].values[0] == pytest.approx(0.4, abs=0.05)
    assert says == "thruster-lag alone does as well as input-delay and sensor-lag together."
    assert single_effect_alternative(study, found, first, each) == (found, "")


@pytest.mark.slow
def test_two_that_are_both_there_stay() -> None:
    study = study_with(BASE.with_effect("thruster-lag", (0.4,)).with_effect("bias-moment", (0.08,)), long_plans()[1::4])
    base = candidate_fit(study, BASE, (), study.fit(BASE))
    lag, bias = ("thruster-lag", (0.2, 0.0, 1.2, 1.0)), ("bias-moment", (0.03,))
    both = grown(study, base, lag, bias)
    scores = score(study, BASE, base.fit, ["bias-moment", "thruster-lag", "input-delay"], 0)
    first = SearchStep(base, scores, (grown(study, base, lag), grown(study, base, bias)), 0.0)
    assert single_effect_alternative(study, both, first, each) == (both, "")
    assert compensating(study, base, both) == ()


@pytest.mark.parametrize(
    ("correlation", "alone", "told"), [(0.95, 20.0, True), (0.3, 20.0, False), (0.95, 70.0, False)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_effects_that_undo_each_other_are_told(
    correlation: float, alone: float, told: bool, sign: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes of opposite pull, 100 in deviance gained together: told where neither gains half of it alone."""
    study = study_with(BASE, PLANS)
    base = candidate_fit(study, BASE, (), study.fit(BASE))
    model = BASE.with_effect("bias-moment", (0.1 * sign,)).with_effect("gyro-drift", (-0.05 * sign,))
    both = CandidateFit(("bias-moment", "gyro-drift"), model, base.fit, base.evidence - 100.0)
    one = replace(both, evidence=base.evidence - alone)
    covariance = np.eye(4)
    covariance[2, 3] = covariance[3, 2] = -correlation  # the more bias, the more drift has to hide it
    monkeypatch.setattr(search, "without", lambda *_: one)
    monkeypatch.setattr(DiagnosisProblem, "covariance", lambda *_: covariance)
    found = compensating(study, base, both)
    assert bool(found) == told
    if told:
        assert found[0].says == (
            "bias-moment and gyro-drift undo each other (correlation 0.95; alone either gains at most 20% of what both "
            "do): together they may stand for one law that is not in the library."
        )
    assert compensating(study, base, replace(both, added=("bias-moment",))) == ()
