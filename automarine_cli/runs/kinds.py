"""What kind of test a run is, and whether it goes the way its command says."""

from dataclasses import dataclass
from typing import Literal

from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import find_steps, segments

Kind = Literal["step", "manoeuvre", "idle"]


@dataclass(frozen=True)
class RunKind:
    """One run: a `step` has one constant command, whether or not it serves; `idle` none at all; else a manoeuvre.

    `with_moment` and `against` count the stretches from rest that went with and against the sign of their
    command; `low` and `high` are the smallest and the largest one [`unit`].
    """

    name: str
    kind: Kind
    unit: str
    low: float
    high: float
    with_moment: int
    against: int


def kind_of(run: Run) -> RunKind:
    """The kind of one run. Thruster commands without a moment count as they add up."""
    driven = run.as_commanded()
    levels = {moment for _, _, moment in segments(driven.command) if moment != 0}
    steps = [step for step in find_steps(driven) if step.from_rest]
    ways = [(step.moment, driven.position[step.stop - 1] - driven.position[step.first]) for step in steps]
    moved = [float(moment * way) for moment, way in ways if abs(way) > run.dof.limits.still]
    return RunKind(
        name=run.name,
        kind=("idle", "step")[len(levels)] if len(levels) < 2 else "manoeuvre",
        unit=driven.moment_unit,
        low=float(driven.command.min()),
        high=float(driven.command.max()),
        with_moment=sum(one > 0 for one in moved),
        against=sum(one < 0 for one in moved),
    )
