"""Runs that something moved which their log does not hold: the vehicle was steered from another console, or pushed,
while the command logged is that of a controller at rest. What is fitted to such a command is nonsense.

Without a command drag only slows a vehicle down, a current carries it slowly, and a constant force takes it one way:
what gathers speed again and again with nothing commanded was moved by something else.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from automarine_cli.runs.run import Run, SetAside

PIECE_S = 3.0  # over which speeds are taken: shorter than a manoeuvre, as long as waves rock
ECHO_S = 4.0  # after a command, in which delays, thrusters and water may still act on it
OFTEN = 3  # times that speed is gathered with nothing commanded
SHARE = 0.8  # of all speed gathered
FAR = 1.5  # times the least way of a step
SURE = 8.0  # standard deviations of the position


def without_undriven(runs: Sequence[Run]) -> tuple[list[Run], tuple[SetAside, ...]]:
    """The runs that their commands may have moved, and those that something else did."""
    reasons = [undriven(run) for run in runs]
    aside = tuple(SetAside(run.source, run.name, why) for run, why in zip(runs, reasons) if why)
    return [run for run, why in zip(runs, reasons) if why is None], aside


def undriven(run: Run) -> str | None:
    """Why the commands of a run cannot be what moved it, or None. Raises RunError where it has none.

    Mean speeds of pieces are compared with those of the pieces before: speed counts as gathered with nothing commanded
    where no command acts in either or shortly before. The run went far, and nearly all its speed, gathered several
    times, and both ways where a constant force acts, is of that kind.
    """
    dof, extent = run.dof, float(np.ptp(run.position))
    pieces = max(1, int((run.time[-1] - run.time[0]) / PIECE_S))
    edges = np.linspace(run.time[0], run.time[-1], pieces + 1)
    speed = np.diff(np.interp(edges, run.time, run.position)) / np.diff(edges)
    before, after = speed[:-1], speed[1:]
    gained = np.maximum(np.abs(after) - np.maximum(before * np.sign(after), 0.0), 0.0)
    gained[gained < max(dof.limits.start, SURE * run.noise) / PIECE_S] = 0.0
    acting = run.time[run.command != 0]
    idle = np.searchsorted(acting, edges[:-2] - ECHO_S) == np.searchsorted(acting, edges[2:], side="right")
    alone = idle & (gained > 0)
    there, back = _times(alone & (after > 0)), _times(alone & (after < 0))
    one_way = dof.has_constant and min(there, back) == 0
    if extent < FAR * dof.limits.least or there + back < OFTEN or one_way or gained[alone].sum() < SHARE * gained.sum():
        return None
    words, unit = dof.words, dof.units.shown
    return (
        f"the {words.force} commanded is 0 in {100 * np.mean(run.command == 0):.3g} % of the log, while the vehicle "
        f"{words.moved} over {dof.shown(extent):.0f} {unit} at up to {dof.shown(np.abs(speed).max()):.2g} {unit}/s and "
        f"gathered speed {there + back} times with nothing commanded: something that this log does not hold moved it, "
        f"such as another console or a hand. Expected the {words.force} that moved it: log the commands that reach the "
        "thrusters, or map their columns with --columns"
    )


def _times(true: NDArray[np.bool_]) -> int:
    """How many stretches are true."""
    return int(np.sum(true[1:] & ~true[:-1]) + true[:1].sum())
