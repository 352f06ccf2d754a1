"""Thruster commands of a log -> yaw moment, or force, through a thruster map; knows of a run only what it needs."""

from collections.abc import Mapping, Sequence
from typing import Protocol, Self, TypeVar

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import ModelError, RunError
from automarine_cli.quantities import Floats
from automarine_cli.runs.command_range import CommandRange
from automarine_cli.thrusters.map import ThrusterMap


class Driven(Protocol):
    """A run with thruster commands among its `extras`: `runs.run.Run`."""

    @property
    def name(self) -> str:
        """Name of the run."""
        ...

    @property
    def source(self) -> str:
        """File that it is from."""
        ...

    @property
    def dof(self) -> Dof:
        """The motion that it is of."""
        ...

    @property
    def extras(self) -> Mapping[str, Floats]:
        """Logged columns by name, each (N,)."""
        ...

    def with_moment(
        self, moment: Floats, unit: str, parts: Mapping[str, Floats] | None = None,
        commanded: CommandRange | None = None,
    ) -> Self:  # fmt: skip
        """The same run driven by another moment, of which single thrusters make the parts."""
        ...


RunLike = TypeVar("RunLike", bound=Driven)


def drive_run_by_thrusters(run: RunLike, thrusters: ThrusterMap, arm: float) -> RunLike:
    """The run with the moment [N m] that two equal thrusters `arm` [m] off the centre line make of their commands; in
    surge and heave with the force [N], whatever the arm.

    A moment that is in the log gives way. Raises RunError for a run without `n_port` and `n_stbd`, and
    ModelError for an arm that is no length or a direction that the map lacks.
    """
    names = run.dof.thrusters
    lacking = [name for name in names if name not in run.extras]
    if lacking:
        raise RunError(
            f"{run.source}, run {run.name!r}: no thruster command {' or '.join(lacking)} in the log, which "
            f"--thrusters needs; map the log's columns to {' and '.join(names)} with --columns, or leave "
            "--thrusters out"
        )
    lever = arm if run.dof.levered else 1.0
    try:
        moment = thrusters.moment(run.extras["n_port"], run.extras["n_stbd"], arm) if run.dof.levered else None
        thrust = [thrusters.force(run.extras[name]) for name in names]
    except ModelError as error:
        raise ModelError(f"{run.source}, run {run.name!r}: {error}") from None
    if moment is None:
        moment = np.asarray(sum(side * one for side, one in zip(run.dof.sides, thrust)))
    shares = [side * lever * one for side, one in zip(run.dof.sides, thrust)]
    given = thrusters.compared(names, [run.extras[name] for name in names])
    return run.with_moment(moment, run.dof.units.forces[1], parts_of(shares, run.dof), given)


def parts_of(shares: Sequence[Floats], dof: Dof) -> dict[str, Floats]:
    """What each thruster gives forward and backward, by the names of PARTS, of its share (N,) of the moment or force;
    none for a motion of another number of thrusters than two."""
    ways = [side * way(side * one, 0.0) for side, one in zip(dof.sides, shares) for way in (np.maximum, np.minimum)]
    return dict(zip(PARTS, ways)) if len(ways) == len(PARTS) else {}
