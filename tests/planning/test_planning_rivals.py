"""How far runs split explanations: known misfits, symmetry, and what steps cannot tell but other runs can."""

from dataclasses import replace

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.planning.candidates import Candidate
from automarine_cli.planning.information import Fitting
from automarine_cli.planning.rivals import closest, fitted, splits, with_effect

BASE = Model.base("3", 1.018, [1.257], "nu", YAW)
FITTING = Fitting(BASE, "diagnosis", np.deg2rad(1.0), 0.03, frame=BASE)
STEPS = tuple(
    Candidate("step", f"{side * size:+g}", ((side * size, round(4.6 / np.sqrt(size), 1)),))
    for size in (0.1, 0.3, 0.6, 0.9, 1.2) for side in (1, -1)
)  # fmt: skip
COASTS = tuple(Candidate("coast-down", f"c{side}", ((side * 1.2, 3.0), (0.0, 15.0))) for side in (1, -1))
RAMPS = tuple(
    Candidate("slow-ramp", f"r{side}", tuple((side * round(0.12 * (i / 10 - 0.95), 4), 2.0) for i in range(20)))
    for side in (1, -1)
)  # fmt: skip


def explanation(name: str, values: tuple[float, ...]) -> Fitting:
    return replace(FITTING, model=BASE.with_effect(name, values), explained_by=name)


def rival_of(true: Fitting, name: str) -> Fitting:
    return replace(closest(true, with_effect(FITTING, BASE, name, 1.2), STEPS)[0], explained_by=name)


def test_what_is_true_fits_itself() -> None:
    true = explanation("dead-band", (0.03,))
    started = replace(true, model=BASE.with_theta([1.1, 1.2]).with_effect("dead-band", (0.05,)))
    end, misfit = fitted(true, started, STEPS)
    assert misfit < 1e-3 and end.model.theta[:3] == pytest.approx(true.model.theta[:3], rel=2e-3)


@pytest.mark.parametrize(
    ("name", "values", "rival", "more"),
    [
        ("dead-band", (0.03,), "coulomb-drag", COASTS + RAMPS),
        pytest.param("thruster-lag", (0.15,), "sensor-lag", COASTS * 2, marks=pytest.mark.slow),
        pytest.param("water-swirl", (0.03, 10.0), "tether-spring", RAMPS, marks=pytest.mark.slow),
    ],
)
def test_steps_leave_a_tie(name: str, values: tuple[float, ...], rival: str, more: tuple[Candidate, ...]) -> None:
    true = explanation(name, values)
    pair = (true, rival_of(true, rival))
    few, many = (splits([pair], runs)[0][0] for runs in (STEPS, STEPS + more))
    assert few.evidence < 10.0
    assert many.evidence > few.evidence + 8.0


def test_mirrored_runs_split_as_well() -> None:
    pair = (explanation("dead-band", (0.03,)), explanation("coulomb-drag", (0.03,)))
    here, there = (splits([pair], runs)[0][0].evidence for runs in (STEPS[::2], STEPS[1::2]))
    assert there == pytest.approx(here, rel=1e-3)
