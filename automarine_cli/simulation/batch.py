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
from automarine_cli.logs.columns import SIGNALS
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import commanded_before, released
from automarine_cli.runs.run import Run

WINDOW_S = 2.0  # length [s] of the windows in which a disturbance moment is held

WHITENESS_STDERRS = 2.33
"""Standard deviations of von Neumann's ratio by which neighbouring readings are more alike than white noise (1 %)."""
SETTLED_S = 1.0  # time since the last change of command [s] from which steps may be longer than a sample interval
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

    `length` (R, M) step lengths [s], 0 in the padding; `inner` (R, M, K - 1) the shares of a step after which samples
    lie inside it, 1 where none does; `stretch` (R, M) change of a length per second of delay of its switch; `switch`
    (R, M) index of that switch; `force` (D, R, M) moment or force commanded, held over each step; `node` (R, N) which
    grid node each sample is, where each step has K: its begin and the inner ones; `seen` (R, N) which samples exist;
    `channels` what was measured, the position of the first degree of freedom first; `interval` (R, E) sample interval
    [s] in which each change happened, 0 in the padding; `start` (R,) clock of the first sample [s]; `before` (D, R, 1)
    what was held before; `window` (R, M) which of the windows of `WINDOW_S` seconds each step lies in; `signals` other
    logged columns held over the steps, (R, M).

    Where a constant force acts, a vehicle that stands still before its first change of command is held: on the
    surface, by hand. Its clock begins with that change, and the steps before have no length."""

    motion: Motion
    names: tuple[str, ...]
    length: Floats
    stretch: Floats
    switch: NDArray[np.int64]
    force: Floats
    node: NDArray[np.int64]
    inner: Floats
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
        names = ("length", "stretch", "switch", "interval", "start", "inner")
        rows = {name: getattr(self, name)[self.longest_first] for name in names}
        rows |= {n: getattr(self, n)[:, self.longest_first] for n in ("force", "before")}
        signals = {name: column[self.longest_first] for name, column in self.signals.items()}
        return replace(self, window=self.window[self.longest_first], signals=signals, **rows)

    def of_runs(self, rows: NDArray[np.int64]) -> "Batch":
        """Return what a simulation needs of the runs `rows` (K,), any run any number of times."""
        names = ("length", "stretch", "switch", "interval", "start", "window", "node", "inner")
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
        begins = np.cumsum(self.length, axis=1) - self.length
        return np.take_along_axis(self.clock(begins[None])[0], self.node, axis=1)

    @cached_property
    def inner_by_step(self) -> Floats:
        """The inner shares by their place in a step, (K - 1, M, 1, 1, R)."""
        return np.ascontiguousarray(np.moveaxis(self.inner, 0, 2).swapaxes(0, 1)[:, :, None, None])

    @property
    def step(self) -> NDArray[np.int64]:
        """Which step begins at or before each sample, (R, N)."""
        return self.node // (1 + self.inner.shape[2])

    def clock(self, begins: Floats, length: Floats | None = None) -> Floats:
        """Time of all nodes, inner ones too, (P, R, K M + 1), of steps that begin at `begins` (P, R, M)."""
        length = self.length[None] if length is None else length
        shares = np.concatenate([np.zeros((*self.length.shape, 1)), self.inner], axis=2)
        nodes = begins[..., None] + shares * length[..., None]
        last = begins[..., -1:] + length[..., -1:]
        return np.concatenate([nodes.reshape(*begins.shape[:2], -1), last], axis=2)

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
    """Steps of one run. `held` (M,) is the sample whose command is held over each step, or those that are `moving` have
    the mean of, and the first of the `taken` (M,) sample intervals in it; `node` (N,) the step that begins at or before
    each sample, `inside` (N,) which of the `inner` (M, K - 1) of that step it is, 0 for its begin."""

    length: Floats
    stretch: Floats
    switch: NDArray[np.int64]
    held: NDArray[np.int64]
    moving: NDArray[np.bool_]
    taken: NDArray[np.int64]
    node: NDArray[np.int64]
    inside: NDArray[np.int64]
    inner: Floats
    interval: Floats

    def mean(self, signal: Floats) -> Floats:
        """Mean of a logged column (N,) over each step (M,), the value at the begin of each interval held over it."""
        total = np.concatenate([[0.0], np.cumsum(signal)])
        mean = (total[self.held + self.taken] - total[self.held]) / self.taken
        return np.where(self.taken == 1, signal[self.held], mean)

    def commanded(self, force: Floats) -> Floats:
        """What is held over each step (M,) of a command (N,), which changes in the middle of a sample interval."""
        total = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]))])
        mean = (total[self.held + self.taken * self.moving] - total[self.held]) / self.taken
        return np.where(self.moving, mean, force[self.held])


def make_batch(
    runs: Sequence[Run], max_step: float, signals: Sequence[str] = (), hold: bool = True, *,
    motion: Motion | None = None, channels: Sequence[str] | None = None, settled_step: float = 0.0,
    moving_step: float = 0.0,
) -> Batch:  # fmt: skip
    """Lay `runs` out for simulation with steps of at most `max_step` [s]. `motion` is by default that of the runs' one
    degree of freedom. `channels` names the quantities measured that are to be followed, by default the positions of the
    runs alone; `signals` the columns of `Run.extras` that effects need; without `hold` nobody holds a vehicle. If
    `settled_step` [s] is given, steps hold samples inside: they take that long where no command has changed for a
    while, before that `max_step`, and `moving_step` [s] where one changes all the time: what they hold is then its
    mean, which moves the vehicle aside by moving_step²/12 times what the acceleration rises by. Raises RunError for no
    runs, a run without a moment, runs with moments in different units, or a missing signal."""
    unit = unit_of(runs, signals)
    motion = motion or alone(runs[0].dof)
    commanded = [np.stack([run.command_of(dof) for dof in motion.dofs]) for run in runs]
    # a position whose slope is no velocity has no such cubic
    joined = (0.0,) * 4 if motion.turns or not settled_step else (0.0, max_step, settled_step, moving_step)
    thrusters = [signals_of(runs, name) for name in signals if name in PARTS]
    logs = zip(runs, commanded, zip(*thrusters) if thrusters else [()] * len(runs))
    grids = [_grid(run.time, force, np.vstack([force, *each]), max_step, joined) for run, force, each in logs]
    if hold and any(dof.has_constant for dof in motion.dofs):
        loose = [grid.held >= released(run) for run, grid in zip(runs, grids)]
        grids = [replace(g, length=g.length * on, stretch=g.stretch * on) for g, on in zip(grids, loose)]
    steps = max(len(g.length) for g in grids)
    samples = max(len(run) for run in runs)
    switches = max(1, *(len(g.interval) for g in grids))
    lengths, each = padded([g.length for g in grids], steps), 1 + max(g.inner.shape[1] for g in grids)
    inner = np.ones((len(runs), steps, each - 1))
    for row, grid in zip(inner, grids):
        row[: len(grid.inner), : grid.inner.shape[1]] = grid.inner
    forces = [[g.commanded(row) for row in force] for force, g in zip(commanded, grids)]
    return Batch(
        motion=motion, names=tuple(run.name for run in runs), length=lengths,
        stretch=padded([g.stretch for g in grids], steps), switch=padded([g.switch for g in grids], steps),
        force=np.stack([padded([force[d] for force in forces], steps) for d in range(len(motion.dofs))]),
        node=padded([each * g.node + g.inside for g in grids], samples), inner=inner,
        seen=padded([np.ones(len(run), dtype=bool) for run in runs], samples),
        channels=tuple(_channels(runs, motion, samples, channels)),
        interval=padded([g.interval for g in grids], switches), start=np.array([run.time[0] for run in runs]),
        before=np.array([[[commanded_before(run, dof)] for run in runs] for dof in motion.dofs]),
        window=((np.cumsum(lengths, axis=1) - 0.5 * lengths) / WINDOW_S).astype(int), moment_unit=unit,
        signals={n: padded([g.mean(s) for s, g in zip(signals_of(runs, n), grids)], steps) for n in signals},
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
    exact = name in PARTS or (name in SIGNALS and SIGNALS[name].commanded)
    return signals if exact else [without_noise(signal) for signal in signals]


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


def _grid(time: Floats, force: Floats, inputs: Floats, max_step: float, joined_steps: Sequence[float]) -> _Grid:
    """Steps between the samples of one run; one in which a command, of `force` (D, N), changes is halved there. All
    that is commanded, each thruster too, is in the `inputs` (J, N); intervals of each kind are joined to steps of at
    most so long."""
    intervals = np.diff(time)
    changed = np.any(np.diff(force, axis=1) != 0, axis=0)
    count = np.maximum(np.ceil(intervals / max_step - 1e-9).astype(int), 1)
    kind = _kinds(time, np.any(np.diff(inputs, axis=1) != 0, axis=0), count > 1)
    first, taken = _joined(time, kind, joined_steps)
    moving = (kind[first] == CHANGING) & (taken > 1)
    width = intervals[changed]
    changed &= ~np.repeat(moving, taken)
    count = np.where(changed, count + count % 2, count)
    interval, count = np.add.reduceat(intervals, first), count[first]
    which = np.repeat(np.arange(len(first)), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    changed_here = changed[first]
    late = changed_here[which] & (order >= count[which] // 2)
    switch = np.cumsum(changed_here)[which] - 1
    if len(width) > MAX_SWITCHES:
        switch, width = np.zeros_like(switch), np.array([np.median(width)])
    moves = np.where(late, -2.0, 2.0) / count[which]
    begins = np.cumsum(count) - count
    of = np.repeat(np.arange(len(first)), taken)  # which joined interval each sample interval is in
    place = np.arange(len(intervals)) - first[of] + 1  # of the sample at its end
    inside = np.where(place < taken[of], place, 0)
    inner = np.ones((len(which), int(taken.max()) - 1))  # no time passes between a node without a sample and the end
    within = np.flatnonzero(inside)
    inner[begins[of[within]], inside[within] - 1] = (time[1:] - time[first[of]])[within] / interval[of[within]]
    return _Grid(
        length=(interval / count)[which], stretch=np.where(changed_here[which], moves, 0.0),
        switch=np.where(changed_here[which], switch, 0), held=first[which] + late, moving=moving[which],
        taken=taken[which],
        node=np.concatenate([[0], np.where(inside > 0, begins[of], (begins + count)[of])]),
        inside=np.concatenate([[0], inside]), inner=inner, interval=width,
    )  # fmt: skip


ISOLATED, RESTING, STEADY, CHANGING = range(4)
"""Sample intervals that are a step or more each; such without a change of command, shortly after one or for longer; and
neighbours in which commands change, of runs whose changes have no instants of their own."""


def _kinds(time: Floats, changed: NDArray[np.bool_], is_long: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The kind of each sample interval (N - 1,) by what is commanded and whether it `is_long`, more than a step."""
    last = np.maximum.accumulate(np.where(changed, np.arange(1, len(time)), 0))  # sample after the latest change
    settled = (time[:-1] - time[last] >= SETTLED_S - 1e-9) | (last == 0)
    beside = np.append(False, changed[:-1]) | np.append(changed[1:], False)
    moving = changed & beside & (changed.sum() > MAX_SWITCHES)
    kind = np.where(changed, np.where(moving, CHANGING, ISOLATED), np.where(settled, STEADY, RESTING))
    return np.where(is_long, ISOLATED, kind)


def _joined(
    time: Floats, kind: NDArray[np.int64], joined_steps: Sequence[float]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first of each group of neighbours of one `kind` (N - 1,) that one step takes together, and how many there
    are: as many as `joined_steps` [s] of that kind hold of the longest."""
    longest, at = float(np.diff(time).max()), np.arange(len(kind))
    together = np.array([max(int(step / longest + 1e-9), 1) for step in joined_steps])[kind]
    begin = np.maximum.accumulate(np.where(np.diff(kind, prepend=-1) != 0, at, 0))
    first = np.flatnonzero((at - begin) % together == 0)
    return first, np.diff(np.append(first, len(at)))
