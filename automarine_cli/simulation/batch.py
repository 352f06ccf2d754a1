"""Many runs padded to one array: simulation grid, held commands, and command changes that may move, worked
out once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import YAW, Dof
from automarine_cli.effects import Commands
from automarine_cli.errors import RunError
from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import find_steps, released

Floats = NDArray[np.float64]

WINDOW = 2.0
"""Length [s] of the windows in which a disturbance moment is held."""

MOST_EDGES = 24
"""Runs with more changes of command than this (closed-loop driving) get one shift for all their changes
together."""


@dataclass(frozen=True)
class Batch:
    """R runs on a common layout: N samples, M steps and E command changes at most; shorter runs are padded.

    The command changes half a sample interval before the sample that first shows it; a shift [s] of that
    instant stretches the steps before it and shortens those after it, so that samples stay where they are
    and no step ever holds two commands.

    `length` (R, M) step lengths [s], 0 in the padding; `stretch` (R, M) change of a length per second of
    shift of its edge; `edge` (R, M) index of that edge; `moment` (R, M) command held over each step; `node`
    (R, N) which grid node each sample is; `seen` (R, N) which samples exist; `heading` (R, N) measured
    [rad], 0 in the padding; `interval` (R, E) sample interval [s] in which each change happened, 0 in the
    padding; `start` (R,) clock of the first sample [s]; `window` (R, M) which of the windows of `WINDOW`
    seconds each step lies in; `signals` other logged columns held over the steps, (R, M).

    Where a constant force acts (`dof`), a vehicle that stands still before its first change of command is held: on the
    surface, by hand. Its clock begins with that change, and the steps before have no length.
    """

    names: tuple[str, ...]
    length: Floats
    stretch: Floats
    edge: NDArray[np.int64]
    moment: Floats
    node: NDArray[np.int64]
    seen: NDArray[np.bool_]
    heading: Floats
    interval: Floats
    start: Floats
    before: Floats
    window: NDArray[np.int64]
    moment_unit: str
    signals: Mapping[str, Floats]
    dof: Dof = YAW

    @property
    def windows(self) -> int:
        """Number of windows of the longest run."""
        return int(self.window.max()) + 1

    @property
    def time(self) -> Floats:
        """Time of each sample since the run's first one [s], (R, N)."""
        clock = np.concatenate([np.zeros((len(self.names), 1)), np.cumsum(self.length, axis=1)], axis=1)
        return np.take_along_axis(clock, self.node, axis=1)

    def commands(self, shift: Floats | None = None) -> Commands:
        """Commands on the grid, (P or 1, R, M), with the instants of change moved by `shift` (P, R, E)
        [s]."""
        length = self.length[None]
        if shift is not None:
            index = np.broadcast_to(self.edge[None], (len(shift), *self.edge.shape))
            length = length + self.stretch[None] * np.take_along_axis(shift, index, axis=2)
        begins = np.cumsum(length, axis=2) - length
        return Commands(self.moment[None], begins, length, self.before, self.start[:, None], self.signals)


@dataclass(frozen=True)
class _Grid:
    """One run on its own grid."""

    length: Floats
    stretch: Floats
    edge: NDArray[np.int64]
    held: NDArray[np.int64]
    node: NDArray[np.int64]
    interval: Floats


def make_batch(runs: Sequence[Run], max_step: float, signals: Sequence[str] = (), hold: bool = True) -> Batch:
    """Lay `runs` out for simulation with steps of at most `max_step` [s].

    `signals` names the columns of `Run.extras` that effects need; without `hold` nobody holds a vehicle. Raises
    RunError for no runs, a run without a moment, runs with moments in different units, or a missing signal.
    """
    if not runs:
        raise RunError("no runs to simulate; give at least one log")
    units = {run.moment_unit for run in runs}
    if len(units) > 1:
        raise RunError(
            f"the logs give moments in different units ({', '.join(sorted(units))}); map them to one with "
            "--columns"
        )
    for run in runs:
        missing = [name for name in signals if name not in run.extras]
        if missing:
            raise RunError(
                f"{run.source}, run {run.name!r}: the model needs column {missing[0]!r}, which the log lacks"
            )
    grids = [_grid(run, max_step) for run in runs]
    if hold and runs[0].dof.has_constant:
        grids = [_held(run, grid) for run, grid in zip(runs, grids)]
    steps = max(len(g.length) for g in grids)
    samples = max(len(run) for run in runs)
    edges = max(1, *(len(g.interval) for g in grids))

    def padded(rows: Sequence[NDArray[Any]], width: int) -> NDArray[Any]:
        out = np.zeros((len(rows), width), dtype=np.result_type(*rows))
        for row, values in zip(out, rows):
            row[: len(values)] = values
        return out

    lengths = padded([g.length for g in grids], steps)
    return Batch(
        names=tuple(run.name for run in runs),
        length=lengths,
        stretch=padded([g.stretch for g in grids], steps),
        edge=padded([g.edge for g in grids], steps),
        moment=padded([run.command[g.held] for run, g in zip(runs, grids)], steps),
        node=padded([g.node for g in grids], samples),
        seen=padded([np.ones(len(run), dtype=bool) for run in runs], samples),
        heading=padded([run.position for run in runs], samples),
        interval=padded([g.interval for g in grids], edges),
        start=np.array([run.time[0] for run in runs]),
        before=np.array([[_moment_before(run)] for run in runs]),
        window=((np.cumsum(lengths, axis=1) - 0.5 * lengths) / WINDOW).astype(int),
        moment_unit=units.pop(),
        signals={n: padded([run.extras[n][g.held] for run, g in zip(runs, grids)], steps) for n in signals},
        dof=runs[0].dof,
    )


def _held(run: Run, grid: _Grid) -> _Grid:
    """The grid of a run whose vehicle is held until its first change of command, if it is."""
    first = released(run)
    if not first:
        return grid
    before = grid.held < first
    return replace(
        grid, length=np.where(before, 0.0, grid.length), stretch=np.where(before, 0.0, grid.stretch)
    )


def _grid(run: Run, max_step: float) -> _Grid:
    """Steps between the samples of one run; an interval in which the command changes is halved at the
    change."""
    intervals = np.diff(run.time)
    changed = np.diff(run.command) != 0
    count = np.maximum(np.ceil(intervals / max_step - 1e-9).astype(int), 1)
    count = np.where(changed, count + count % 2, count)
    which = np.repeat(np.arange(len(intervals)), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    late = changed[which] & (order >= count[which] // 2)
    edges = np.cumsum(changed)[which] - 1
    width = intervals[changed]
    if len(width) > MOST_EDGES:
        edges, width = np.zeros_like(edges), np.array([np.median(width)])
    moves = np.where(late, -2.0, 2.0) / count[which]
    return _Grid(
        length=(intervals / count)[which],
        stretch=np.where(changed[which], moves, 0.0),
        edge=np.where(changed[which], edges, 0),
        held=which + late,
        node=np.concatenate([[0], np.cumsum(count)]),
        interval=width,
    )


def _moment_before(run: Run) -> float:
    """Moment held before the first sample: none if the vehicle starts from rest, else what the first sample shows."""
    steps = find_steps(run)
    from_rest = bool(steps) and steps[0].begins_log and steps[0].from_rest
    return 0.0 if from_rest else float(run.command[0])
