"""Many runs padded to one array: simulation grid, held commands, and command changes that may move."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof, Motion, alone
from automarine_cli.effects import Commands
from automarine_cli.effects.input_delay import delayed
from automarine_cli.effects.thruster_imbalance import PARTS, lacking_signal
from automarine_cli.errors import RunError
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import commanded_before, released
from automarine_cli.runs.run import Run

WINDOW_S = 2.0  # length [s] of the windows in which a disturbance moment is held

WHITENESS_STDERRS = 2.33
"""Standard deviations of von Neumann's ratio by which neighbouring readings are more alike than white noise (1 %)."""
MAX_SWITCHES = 24
"""Runs with more changes of command than this (closed-loop driving) get one delay for all changes together."""


@dataclass(frozen=True)
class Channel:
    """What one kind of sensor logged of all runs: `quantity` is that of the records, of the degree of freedom in place
    `dof` of the motion, its `velocity` or its position. `values` (R, N) [base units], zero where not `seen` (R, N). One
    that does not `count` stands in for a sensor that the log lacks (a heading summed up from a gyro): it is shown, and
    no evidence."""

    quantity: str
    dof: int
    velocity: bool
    values: Floats
    seen: NDArray[np.bool_]
    counts: bool = True


@dataclass(frozen=True)
class Batch:
    """R runs of one motion on a common layout: N samples, M steps and E command changes at most; shorter runs are
    padded. D degrees of freedom.

    The command changes half a sample interval before the sample that first shows it; a delay [s] of that
    instant stretches the steps before it and shortens those after it, so that samples stay where they are
    and no step ever holds two commands.

    `length` (R, M) step lengths [s], 0 in the padding; `stretch` (R, M) change of a length per second of
    delay of its switch; `switch` (R, M) index of that switch; `force` (D, R, M) moment or force commanded, held over
    each step; `node` (R, N) which grid node each sample is; `seen` (R, N) which samples exist; `channels` what was
    measured, the position of the first degree of freedom first; `interval` (R, E) sample interval [s] in which each
    change happened, 0 in the padding; `start` (R,) clock of the first sample [s]; `before` (D, R, 1) what was held
    before; `window` (R, M) which of the windows of `WINDOW_S` seconds each step lies in; `signals` other logged columns
    held over the steps, (R, M).

    Where a constant force acts, a vehicle that stands still before its first change of command is held: on the
    surface, by hand. Its clock begins with that change, and the steps before have no length."""

    motion: Motion
    names: tuple[str, ...]
    length: Floats
    stretch: Floats
    switch: NDArray[np.int64]
    force: Floats
    node: NDArray[np.int64]
    seen: NDArray[np.bool_]
    channels: tuple[Channel, ...]
    interval: Floats
    start: Floats
    before: Floats
    window: NDArray[np.int64]
    moment_unit: str
    signals: Mapping[str, Floats]

    @property
    def dof(self) -> Dof:
        (only,) = self.motion.dofs
        return only

    @cached_property
    def longest_first(self) -> NDArray[np.int64]:
        """Order (R,) of the runs by their steps."""
        return np.argsort(-steps_of(self.length), kind="stable")

    @cached_property
    def sorted(self) -> "Batch":
        """What a simulation needs, the longest run first."""
        rows = {n: getattr(self, n)[self.longest_first] for n in ("length", "stretch", "switch", "interval", "start")}
        rows |= {n: getattr(self, n)[:, self.longest_first] for n in ("force", "before")}
        signals = {name: column[self.longest_first] for name, column in self.signals.items()}
        return replace(self, window=self.window[self.longest_first], signals=signals, **rows)

    def of_runs(self, rows: NDArray[np.int64]) -> "Batch":
        """Return what a simulation needs of the runs `rows` (K,), any run any number of times."""
        names = ("length", "stretch", "switch", "interval", "start", "window", "node")
        of_rows = {name: getattr(self, name)[rows] for name in names}
        of_rows |= {name: getattr(self, name)[:, rows] for name in ("force", "before")}
        signals = {name: column[rows] for name, column in self.signals.items()}
        return replace(self, names=tuple(self.names[row] for row in rows), signals=signals, **of_rows)

    @property
    def position(self) -> Floats:
        """Measured positions of the first degree of freedom (R, N), 0 in the padding."""
        return self.channels[0].values

    @property
    def half_interval(self) -> float:
        """Half the usual sample interval in which commands change [s]; 0 where none does."""
        intervals = self.interval[self.interval > 0]
        return 0.5 * float(np.median(intervals)) if len(intervals) else 0.0

    @property
    def windows(self) -> int:
        return int(self.window.max()) + 1

    @property
    def time(self) -> Floats:
        """Time of each sample since the run's first one [s], (R, N)."""
        clock = np.concatenate([np.zeros((len(self.names), 1)), np.cumsum(self.length, axis=1)], axis=1)
        return np.take_along_axis(clock, self.node, axis=1)

    def commands(self, switch_delay: Floats | None = None, command_delay: Floats | None = None) -> tuple[Commands, ...]:
        """Commands of each degree of freedom, (P or 1, R, M): changes moved within their intervals by `switch_delay`
        (P, R, E) [s], and all later by `command_delay` (P, 1, 1) [s], which is exact as far as it moves them so."""
        length, remaining = self.length[None], np.zeros(())
        if command_delay is not None:
            within = np.clip(command_delay, -self.half_interval, self.half_interval)
            remaining = command_delay - within
            switch_delay = within + (np.zeros((1, *self.interval.shape)) if switch_delay is None else switch_delay)
        if switch_delay is not None:
            index = np.broadcast_to(self.switch[None], (len(switch_delay), *self.switch.shape))
            length = length + self.stretch[None] * np.take_along_axis(switch_delay, index, axis=2)
        begins, clock = np.cumsum(length, axis=2) - length, self.start[:, None]
        commands = [
            Commands(force[None], begins, length, before, clock, self.signals)
            for force, before in zip(self.force, self.before)
        ]
        if not remaining.any():
            return tuple(commands)
        return tuple(replace(command, force=delayed(command, remaining)) for command in commands)


def steps_of(length: Floats) -> NDArray[np.int64]:
    """How many steps of `length` (R, M) each run has until its last one, (R,)."""
    moves = length > 0
    return np.where(moves.any(axis=1), length.shape[1] - moves[:, ::-1].argmax(axis=1), 0)


@dataclass(frozen=True)
class _Grid:
    length: Floats
    stretch: Floats
    switch: NDArray[np.int64]
    held: NDArray[np.int64]
    node: NDArray[np.int64]
    interval: Floats


def make_batch(
    runs: Sequence[Run], max_step: float, signals: Sequence[str] = (), hold: bool = True, *,
    motion: Motion | None = None, channels: Sequence[str] | None = None,
) -> Batch:  # fmt: skip
    """Lay `runs` out for simulation with steps of at most `max_step` [s]. `motion` is by default that of the runs' one
    degree of freedom. `channels` names the quantities measured that are to be followed, by default the positions of the
    runs alone; `signals` the columns of `Run.extras` that effects need; without `hold` nobody holds a vehicle. Raises
    RunError for no runs, a run without a moment, runs with moments in different units, or a missing signal."""
    unit = unit_of(runs, signals)
    motion = motion or alone(runs[0].dof)
    commanded = [np.stack([run.command_of(dof) for dof in motion.dofs]) for run in runs]
    grids = [_grid(run, force, max_step) for run, force in zip(runs, commanded)]
    if hold and any(dof.has_constant for dof in motion.dofs):
        loose = [grid.held >= released(run) for run, grid in zip(runs, grids)]
        grids = [replace(g, length=g.length * on, stretch=g.stretch * on) for g, on in zip(grids, loose)]
    steps = max(len(g.length) for g in grids)
    samples = max(len(run) for run in runs)
    switches = max(1, *(len(g.interval) for g in grids))
    lengths = padded([g.length for g in grids], steps)
    forces = [force[:, g.held] for force, g in zip(commanded, grids)]
    return Batch(
        motion=motion, names=tuple(run.name for run in runs), length=lengths,
        stretch=padded([g.stretch for g in grids], steps), switch=padded([g.switch for g in grids], steps),
        force=np.stack([padded([force[d] for force in forces], steps) for d in range(len(motion.dofs))]),
        node=padded([g.node for g in grids], samples),
        seen=padded([np.ones(len(run), dtype=bool) for run in runs], samples),
        channels=tuple(_channels(runs, motion, samples, channels)),
        interval=padded([g.interval for g in grids], switches), start=np.array([run.time[0] for run in runs]),
        before=np.array([[[commanded_before(run, dof)] for run in runs] for dof in motion.dofs]),
        window=((np.cumsum(lengths, axis=1) - 0.5 * lengths) / WINDOW_S).astype(int), moment_unit=unit,
        signals={n: padded([s[g.held] for s, g in zip(signals_of(runs, n), grids)], steps) for n in signals},
    )  # fmt: skip


def unit_of(runs: Sequence[Run], signals: Sequence[str] = ()) -> str:
    """The one unit of the runs' moments. Raises RunError for no runs, several units, or a signal that a run lacks."""
    if not runs:
        raise RunError("no runs to simulate; give at least one log")
    units = {run.moment_unit for run in runs}
    if len(units) > 1:
        several = ", ".join(sorted(units))
        raise RunError(f"the logs give moments in different units ({several}); map them to one with --columns")
    for run in runs:
        if missing := [name for name in signals if run.signal(name) is None]:
            raise RunError(f"{run.source}, run {run.name!r}: the model needs {lacking_signal(missing[0])}")
    return units.pop()


def signals_of(runs: Sequence[Run], name: str) -> list[Floats]:
    """A signal of every run that has it, (N,) each; measured ones without noise where they are nothing else."""
    signals = [signal for run in runs if (signal := run.signal(name)) is not None]
    return signals if name in PARTS else [without_noise(signal) for signal in signals]


def without_noise(values: Floats) -> Floats:
    """A column of a run (N,), or its mean in every row where it scatters about that like white noise: a simulation sums
    up what it reads, and steep dependences would wander with the noise. Von Neumann's ratio, below one by more than
    WHITE of its standard deviations where neighbours are alike."""
    if len(values) < 2 or not np.ptp(values) > 0:
        return values
    alike = 1.0 - 0.5 * float(np.mean(np.diff(values) ** 2) / np.var(values))
    return values if alike * np.sqrt(len(values)) > WHITENESS_STDERRS else np.full_like(values, values.mean())


def padded(rows: Sequence[NDArray[Any]], width: int) -> NDArray[Any]:
    """Rows (n,) of different lengths as one array (R, width), zero behind their ends."""
    out = np.zeros((len(rows), width), dtype=np.result_type(*rows))
    for row, values in zip(out, rows):
        row[: len(values)] = values
    return out


def _channels(runs: Sequence[Run], motion: Motion, samples: int, quantities: Sequence[str] | None) -> Iterator[Channel]:
    """The channels of the motion that are wanted, without readings where no run has any; by default its positions that
    any run has. The first position stands there always, if only to show."""
    for d, (dof, position) in enumerate(zip(motion.dofs, motion.positions)):
        for quantity in (position, dof.velocity):
            first = d == 0 and quantity == position
            counts = quantity == position if quantities is None else quantity in quantities
            columns = [run.channel(quantity) for run in runs]
            if not (first or counts) or (quantities is None and all(column is None for column in columns)):
                continue
            values = [np.full(len(run), np.nan) if c is None else c for run, c in zip(runs, columns)]
            mask = padded([np.isfinite(column) for column in values], samples)
            filled = padded([np.nan_to_num(column) for column in values], samples)
            if counts and quantity == position:
                mask &= np.array([[not run.summed_up] for run in runs])
            yield Channel(quantity, d, quantity == dof.velocity, filled, mask, counts=counts)


def _grid(run: Run, force: Floats, max_step: float) -> _Grid:
    """Steps between the samples of one run; one in which a command, of `force` (D, N), changes is halved there."""
    intervals = np.diff(run.time)
    changed = np.any(np.diff(force, axis=1) != 0, axis=0)
    count = np.maximum(np.ceil(intervals / max_step - 1e-9).astype(int), 1)
    count = np.where(changed, count + count % 2, count)
    which = np.repeat(np.arange(len(intervals)), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    late = changed[which] & (order >= count[which] // 2)
    switch = np.cumsum(changed)[which] - 1
    width = intervals[changed]
    if len(width) > MAX_SWITCHES:
        switch, width = np.zeros_like(switch), np.array([np.median(width)])
    moves = np.where(late, -2.0, 2.0) / count[which]
    return _Grid(
        length=(intervals / count)[which], stretch=np.where(changed[which], moves, 0.0),
        switch=np.where(changed[which], switch, 0), held=which + late, node=np.concatenate([[0], np.cumsum(count)]),
        interval=width,
    )  # fmt: skip
