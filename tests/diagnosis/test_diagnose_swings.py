"""diagnose of free decays in roll, which show ratios to an inertia that nothing shows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_swings import TRUTH, decays

from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.dofs import ROLL
from automarine_cli.models.model import Model
from automarine_cli.models.store import models_of

ABOUT = [0.4, 0.6, 0.0, 11.0]  # quadratic and linear drag, constant, what turns back


@cache
def diagnosed(stiffening: float, side: float = 1.0, inertia: float = 1.0) -> Diagnosis:
    size = inertia / TRUTH["inertia"]
    base = Model.base("2", inertia, [size * value for value in ABOUT], "N m", ROLL)
    runs = [
        replace(run, position=side * run.position)
        for seed in (1, 2) for run in decays(seed, stiffening=stiffening)
    ]  # fmt: skip
    return diagnose_runs(runs, base, number="2")


def test_nothing_is_missing_and_the_inertia_stays() -> None:
    found = diagnosed(0.0)
    assert found.verdict == "nothing-missing" and not found.effects
    model = models_of(found.extended, "extended").model
    assert model.inertia == 1.0 and model.fixed == (ROLL.parameter("inertia"),)
    ratio = found.base["restoring"][1]
    truth = TRUTH["restoring"] / TRUTH["inertia"]
    assert abs(ratio.value - truth) < 3.5 * ratio.stderr < 0.01 * truth
    assert found.base["I_p"][1].known
    assert not {"dead-band", "saturation", "thruster-lag"} & {entry["name"] for entry in found.candidates}


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_arm_that_is_no_sine_is_learned_over_the_angle(side: float) -> None:
    found = diagnosed(1.5, side)
    (effect,) = found.effects
    assert (found.verdict, effect.name) == ("named", "learned:roll")
    free = found.from_commands
    assert free is not None and free.after < 1.1 * free.floor < 0.5 * free.before
    model = models_of(found.extended, "extended").model
    angle = np.radians([-25.0, -15.0, 15.0, 25.0])
    (curve,) = [term for term in model.terms if term.name == "learned:roll"]
    low, high, size, _, *values, _ = curve.values
    at = np.interp(angle, np.linspace(low, high, len(values)), size * np.array(values))
    back = model.restoring * np.sin(angle) - at
    truth = TRUTH["restoring"] / TRUTH["inertia"] * np.sin(angle) * (1.0 + 1.5 * angle**2)
    np.testing.assert_allclose(back, truth, rtol=0.03, atol=0.03)


@pytest.mark.slow
def test_another_inertia_gives_the_same_verdict_in_its_unit() -> None:
    ours, other = diagnosed(0.0), diagnosed(0.0, inertia=7.0)
    assert other.verdict == ours.verdict
    assert other.base["k_p"][1].value == pytest.approx(7.0 * ours.base["k_p"][1].value, rel=1e-3)
