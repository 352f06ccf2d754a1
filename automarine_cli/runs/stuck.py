"""Runs that stood still under a command that moves the vehicle in other runs: a thruster that did not start, a tether
that held. They say nothing of drag or inertia; a model that is made to follow them finds effects that are not there.
"""

from collections.abc import Sequence

import numpy as np

from automarine_cli.runs.run import Run, SetAside

ALIKE = 1.25  # pushes of one size: steps that end at one angle are logged a sample more or less
PIECE_S = 1.0  # positions are averaged over pieces of about this length, so that noise is no motion


def without_stuck(runs: Sequence[Run]) -> tuple[list[Run], tuple[SetAside, ...]]:
    """The runs that may be modelled, and those that stood still though another run was moved by no more.

    Stuck is a run of one constant moment that never moved, where a run that did was pushed no harder to that side and
    no further: so a command within a dead band, which moves nothing in any run, is none.
    """
    moved = [run for run in runs if _moved(run)]
    kept, aside = [], []
    for run in runs:
        free = run.dof.has_constant or _moved(run)  # under a constant force the smaller command may be what moves
        other = None if free else _moved_by_no_more(run, moved)
        if other is None:
            kept.append(run)
        else:
            aside.append(SetAside(run.source, run.name, _why(run, other)))
    return kept, tuple(aside)


def _moved(run: Run) -> bool:
    """Whether the mean positions of its pieces differ by more than noise would make them."""
    count = max(1, min(len(run) // 3, int((run.time[-1] - run.time[0]) / PIECE_S)))
    means = [float(piece.mean()) for piece in np.array_split(run.position, count)]
    return max(means) - min(means) >= max(run.dof.limits.still, 5 * run.noise)


def _push(run: Run) -> float:
    """Largest moment times the squared time that one acts: how far it would turn a vehicle without drag, but for its
    inertia."""
    acting = float(np.sum(np.diff(run.time)[run.command[:-1] != 0]))
    return float(np.abs(run.command).max()) * acting**2


def _moved_by_no_more(run: Run, moved: Sequence[Run]) -> Run | None:
    """A run that moved under moments to the side of this run's only, none larger, that push it no further."""
    acting = np.unique(run.command[run.command != 0])
    if len(acting) != 1:
        return None
    size, side = abs(acting[0]), float(np.sign(acting[0]))
    for other in moved:
        same = other.moment_unit == run.moment_unit and np.abs(other.command).max() <= size * (1 + 1e-9)
        if same and np.all(side * other.command >= 0) and 0 < _push(other) <= ALIKE * _push(run):
            return other
    return None


def _why(run: Run, other: Run) -> str:
    size = np.abs(run.command).max() * np.sign(run.command.sum())
    return (
        f"never moved under a {run.dof.words.force} of {size:.4g} {run.moment_unit}, though run {other.name} did under "
        "no more; check thrusters and tether, and make the run again"
    )
