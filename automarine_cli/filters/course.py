"""Runs laid out for the filter: steps between readings, commands held finely, readings thinned to independent ones."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof, Motion, alone
from automarine_cli.effects import Commands
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.filters.readings import MIN_STEP_S, Readings, averaged_over, readings_of
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import commanded_before
from automarine_cli.runs.run import Run, filled, fresh_readings, summed
from automarine_cli.simulation.batch import Channel, padded, signals_of, unit_of

MAX_STEP_S, USUAL_STEP_S = 0.25, 0.1
"""Steps of the filter [s]: the longest, where readings hang together, and where they are as noisy as sensors are; the
shortest is of readings that each tell something new."""
SLOW_STEP_S, SLOW_ANSWER_S = 0.5, 3.0
"""Longest step [s] of a vehicle that answers slowly, and the time from which on an answer is slow."""
SWING_STEP_SHARE = (
    0.05  # of the time in which a rate changes by its own size: the step of a quiet gyro, between the two above
)
MAX_JUMP_STEP_S, MIN_JUMP = 0.15, 0.2
"""Longest step [s] between samples in which a command jumps by more than this share of its usual size: longer ones are
divided."""


def step_of(runs: Sequence[Run], motion: Motion, sensors: Sequence[Readings]) -> float:
    """Choose the step [s] that the readings ask for: the shortest that any of their sensors does; a vehicle that
    answers slowly has time for SLOW_STEP_S."""
    quantities = [sensor.quantity for sensor in sensors]
    answers = [a for dof, place in zip(motion.dofs, motion.positions) for a in _answers(runs, place, dof, quantities)]
    slow = min(answers, default=0.0) > SLOW_ANSWER_S
    steps = [SLOW_STEP_S if slow else MAX_STEP_S]
    for sensor in sensors:
        if not sensor.thinned:
            steps.append(MIN_STEP_S if sensor.independent else USUAL_STEP_S)
        elif motion.dofs[sensor.dof].angular and sensor.velocity and not slow:  # a gyro, however quiet
            steps.append(max(USUAL_STEP_S, SWING_STEP_SHARE * sensor.swing))
    return min(steps)


def _answers(runs: Sequence[Run], position: str, dof: Dof, quantities: Sequence[str]) -> Iterator[float]:
    """Give the time [s] in which each reading's velocity at most changes by half of its range in these runs, told from
    differences over SLOW_STEP_S."""
    for quantity in {position, dof.velocity} & {*quantities}:
        speeds, swings = list[Floats](), list[Floats]()
        for run in runs:
            readings, clock = run.channel(quantity), np.arange(run.time[0], run.time[-1], SLOW_STEP_S)
            if readings is not None and np.isfinite(readings).any() and len(clock) > 2:
                values = np.interp(clock, run.time, filled(run.time, readings))
                speed = values if quantity == dof.velocity else np.diff(values) / SLOW_STEP_S
                speeds.append(speed)
                swings.append(np.diff(speed) / SLOW_STEP_S)
        if speeds and (largest := max(float(np.abs(swing).max()) for swing in swings)) > 0.0:
            yield 0.5 * float(np.ptp(np.concatenate(speeds))) / largest


def nodes_of(run: Run, step: float, longest: float, jumps: Floats, quantities: Sequence[str]) -> Floats:
    """Clock of the filter's nodes: samples about `step` apart, intervals divided about `longest`, or shorter where
    a command jumps: `jumps` (N,) are in shares of its usual size. Where a sensor is slower than the log, the samples of
    the slowest come first."""
    if step == MIN_STEP_S:  # no reading is left out: each counts alone, or in the mean of its node
        step = (averaged_over(run.sample_period) - 0.5) * run.sample_period
    fresh = [fresh_readings(channel) for channel in map(run.channel, quantities) if channel is not None]
    slow = min(fresh, key=np.count_nonzero, default=np.ones(len(run), dtype=bool))
    times = np.append(run.time[slow], np.inf)
    wait = times[np.searchsorted(times, run.time, side="right")] - run.time
    chosen, last, firm = [0], run.time[0], run.time[0]
    for i in range(1, len(run)):
        now = run.time[i]
        first = slow[i] and now - firm > 0.999 * step
        if first or (now - last > 0.999 * step and wait[i] > 0.5 * step) or i == len(run) - 1:
            chosen.append(i)
            last, firm = now, now if first else firm
    gaps = np.diff(run.time[chosen])
    jumping = np.maximum.reduceat(jumps, np.array(chosen[:-1]) + 1) > MIN_JUMP
    most = np.where(jumping, min(longest, max(step, MAX_JUMP_STEP_S)), longest)
    count = np.maximum(np.ceil(gaps / most - 0.25).astype(int), 1)
    which = np.repeat(np.arange(len(gaps)), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.append(run.time[chosen][which] + order * (gaps / count)[which], run.time[-1])


MAX_LEAD_S = 2.0  # before a log that begins with a command, longer than commands are late
MIN_HOLD_S = 0.05  # that a fine step takes, about: faster logs are averaged over that, intervals of slower ones divided


@dataclass(frozen=True)
class Course:
    """R runs of one motion of D degrees of freedom on the filter's layout; K steps at most, shorter ones are padded.

    `length` (R, K) of the steps [s], 0 in the padding. `commanded` (D, R, M) are the commands on a finer grid of steps
    of `width` (R, M), each held over its own, that begin `early` (R,) before the first sample [s]; node k of the filter
    lies in fine step `at` (R, K + 1), at the share `part` of it. `before` (D, R, 1) was held before, `start` (R,) is
    the clock of the first sample [s], `signals` (R, M) other logged columns on the fine grid. `channels` are the
    readings that count as independent, (R, K + 1) each, `often` all readings of positions in their place, `at_rest`
    (R,) which runs begin at rest, `fastest` (D,) the largest velocities [per s], as means over a second, and `noise`
    (C,) of each channel, estimated without a model; `sensors` (C,) say what its readings are like. `half_width` is half
    the usual time that a command is held [s]: what a command delay may be by the logger's convention alone.
    """

    motion: Motion
    names: tuple[str, ...]
    length: Floats
    commanded: Floats
    width: Floats
    early: Floats
    at: NDArray[np.int64]
    part: Floats
    before: Floats
    start: Floats
    signals: Mapping[str, Floats]
    channels: tuple[Channel, ...]
    often: tuple[Channel, ...]
    at_rest: NDArray[np.bool_]
    fastest: Floats
    noise: Floats
    sensors: tuple[Readings, ...]
    moment_unit: str
    half_width: float

    @cached_property
    def time(self) -> Floats:
        """Time of the nodes since the run's first sample [s], (R, K + 1)."""
        return np.concatenate([np.zeros((len(self.names), 1)), np.cumsum(self.length, axis=1)], axis=1)

    @cached_property
    def commands(self) -> tuple[Commands, ...]:
        begins = np.cumsum(self.width, axis=1) - self.width - self.early[:, None]
        return tuple(
            Commands(force[None], begins[None], self.width[None], before, self.start[:, None], self.signals)
            for force, before in zip(self.commanded, self.before)
        )

    def averaged(self, delivered: Floats, late: Floats | None = None) -> tuple[Floats, Floats]:
        """What is held on the fine grid (P, R, M) as a straight line over each of the filter's steps: its means and its
        slopes [per s], (P, R, K), which give every rate and position at their ends as what is held does. `late` (P,)
        [s] is by how much all of it acts after it is held."""
        sets = len(delivered) if late is None else max(len(delivered), len(late))
        delivered = np.broadcast_to(delivered, (sets, *delivered.shape[1:]))
        place = np.broadcast_to(self.at + self.part if late is None else self._earlier(late), (sets, *self.at.shape))
        at = np.clip(np.floor(place).astype(np.int64), 0, delivered.shape[2] - 1)
        width = np.broadcast_to(self.width, delivered.shape)
        impulse, twice = np.zeros((2, *delivered.shape[:2], delivered.shape[2] + 1))
        np.cumsum(delivered * width, axis=2, out=impulse[..., 1:])
        np.cumsum((impulse[..., :-1] + 0.5 * delivered * width) * width, axis=2, out=twice[..., 1:])
        force, passed = np.take_along_axis(delivered, at, axis=2), place - at
        passed = passed * np.take_along_axis(width, at, axis=2)
        reached = np.take_along_axis(impulse, at, axis=2)
        way = np.take_along_axis(twice, at, axis=2) + (reached + 0.5 * force * passed) * passed
        reached = reached + force * passed
        length = np.maximum(self.length, 1e-12)
        mean = np.diff(reached, axis=2) / length * (self.length > 0)
        behind = np.diff(way, axis=2) - reached[..., :-1] * self.length
        return mean, 12.0 * (0.5 * mean * length**2 - behind) / length**3 * (self.length > 0)

    def _earlier(self, late: Floats) -> Floats:
        """Places on the fine grid, (P, R, K + 1), `late` (P,) [s] before the nodes."""
        places = np.empty((len(late), *self.at.shape))
        for r, width in enumerate(self.width):
            begins = np.append(0.0, np.cumsum(width))
            nodes = begins[self.at[r]] + self.part[r] * np.append(width, 0.0)[self.at[r]]  # padding lies at the end
            times = nodes - late[:, None]
            at = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(width) - 1)
            places[:, r] = at + (times - begins[at]) / np.where(width > 0, width, 1.0)[at]
        return places

    def some(self, runs: NDArray[np.bool_]) -> "Course":
        """Some of the runs (R,), without what only others need."""
        steps = int((self.length[runs] > 0).sum(axis=1).max())
        rows = {name: getattr(self, name)[runs] for name in ("width", "early", "start", "at_rest")}
        rows |= {name: getattr(self, name)[:, runs] for name in ("commanded", "before")}
        rows |= {name: getattr(self, name)[runs, : steps + 1] for name in ("at", "part")}
        return replace(
            self, names=tuple(name for name, stays in zip(self.names, runs) if stays), length=self.length[runs, :steps],
            signals={name: column[runs] for name, column in self.signals.items()},
            channels=_rows(self.channels, runs, steps), often=_rows(self.often, runs, steps), **rows,
        )  # fmt: skip

    @cached_property
    def unthinned(self) -> "Course":
        """The same with every reading: what a state is told from, which is no evidence on noise."""
        return replace(self, channels=self.often)

    @cached_property
    def averaged_signals(self) -> dict[str, Floats]:
        return {name: self.averaged(column[None])[0][0] for name, column in self.signals.items()}


def make_course(
    runs: Sequence[Run], at_rest: NDArray[np.bool_], signals: Sequence[str] = (), *, motion: Motion | None = None,
    channels: Sequence[str] | None = None, step: float | None = None,
) -> Course:  # fmt: skip
    """Lay `runs` out with steps of about `step` [s], by default as their sensors ask; those `at_rest` (R,) begin so.

    `motion` is by default that of the runs' one degree of freedom; `channels` names the quantities that count, by
    default the positions. Raises RunError for no runs, a run without a command, commands in different units, or a
    missing signal.
    """
    unit = unit_of(runs, signals)
    motion = motion or alone(runs[0].dof)
    sensors = [
        Readings.of(runs, quantity, d, motion)
        for d, (dof, position) in enumerate(zip(motion.dofs, motion.positions))
        for quantity in (position, dof.velocity)
        if (quantity in channels if channels is not None else quantity == position)
    ]
    quantities = [sensor.quantity for sensor in sensors]
    spacing = step_of(runs, motion, sensors) if step is None else step
    longest = step or max(spacing, MAX_STEP_S)
    acting = [[*map(run.command_of, motion.dofs), *map(np.asarray, map(run.signal, signals))] for run in runs]
    usual = [float(np.sqrt(np.mean(np.concatenate(column) ** 2))) or 1.0 for column in zip(*acting)]
    layouts = []
    for run, columns in zip(runs, acting):
        jumps = np.max([np.abs(np.diff(x, prepend=x[0])) / size for x, size in zip(columns, usual)], axis=0)
        layouts.append(_lay(run, nodes_of(run, spacing, longest, jumps, quantities), motion, signals, sensors))
    nodes, fine = max(len(layout.at) for layout in layouts), max(len(layout.width) for layout in layouts)
    at = padded([layout.at for layout in layouts], nodes)
    for row, layout in zip(at, layouts):
        row[len(layout.at) :] = len(layout.width)  # nodes behind the end lie there
    noise = np.array([layout.noise for layout in layouts])
    thinned, often = list[Channel](), list[Channel]()
    for c, sensor in enumerate(sensors):
        for k, channels_of in enumerate((thinned, often)):
            values = padded([layout.values[k, c] for layout in layouts], nodes)
            observed = padded([layout.seen[k, c] for layout in layouts], nodes)
            channels_of.append(Channel(sensor.quantity, sensor.dof, sensor.velocity, values, observed))
    return Course(
        motion=motion, names=tuple(run.name for run in runs),
        length=padded([layout.length for layout in layouts], nodes - 1),
        commanded=np.stack([padded([x.commanded[d] for x in layouts], fine) for d in range(len(motion.dofs))]),
        width=padded([layout.width for layout in layouts], fine), early=np.array([layout.early for layout in layouts]),
        at=at, part=padded([layout.part for layout in layouts], nodes),
        before=np.array([layout.before for layout in layouts]).T[..., None],
        start=np.array([run.time[0] for run in runs]),
        signals={name: padded([layout.signals[name] for layout in layouts], fine) for name in signals},
        channels=tuple(thinned), often=tuple(often), at_rest=at_rest,
        fastest=np.array([_fastest(runs, position, dof) for position, dof in zip(motion.positions, motion.dofs)]),
        noise=np.array([float(np.median(n[np.isfinite(n)])) if np.isfinite(n).any() else 0.0 for n in noise.T]),
        sensors=tuple(sensors), moment_unit=unit,
        half_width=0.5 * float(np.median([_held(run) * run.sample_period for run in runs])),
    )  # fmt: skip


def _rows(channels: Sequence[Channel], rows: NDArray[np.bool_], steps: int) -> tuple[Channel, ...]:
    at = rows, slice(steps + 1)
    return tuple(replace(channel, values=channel.values[at], seen=channel.seen[at]) for channel in channels)


def _lay(
    run: Run, node: Floats, motion: Motion, signals: Sequence[str], sensors: Sequence[Readings]
) -> SimpleNamespace:
    edges, mean = _fine(run)
    commanded, logged = (
        [mean(run.command_of(dof)) for dof in motion.dofs],
        [mean(signals_of([run], name)[0]) for name in signals],
    )
    before = [commanded_before(run, dof) for dof in motion.dofs]
    if any(held != forces[0] for held, forces in zip(before, commanded)):  # what a late command follows on
        edges = np.append(edges[0] - MAX_LEAD_S, edges)
        commanded = [np.append(held, forces) for held, forces in zip(before, commanded)]
        logged = [np.append(0.0 if name in PARTS else column[0], column) for name, column in zip(signals, logged)]
    at = np.clip(np.searchsorted(edges, node, side="right") - 1, 0, len(edges) - 2)
    values, noise = np.zeros((2, len(sensors), len(node))), np.full((2, len(sensors)), np.nan)
    observed = np.zeros(values.shape, dtype=bool)  # of the readings that count as independent, and of all of them
    for c, sensor in enumerate(sensors):
        readings = run.channel(sensor.quantity)
        if readings is None or (run.summed_up and sensor.quantity == run.dof.position):
            continue
        for k, floor in enumerate((sensor.floor, 0.0)):
            at_nodes, averages, noise[k, c] = readings_of(run.time, readings, node, floor)
            values[k, c, at_nodes], observed[k, c, at_nodes] = averages, True
    return SimpleNamespace(
        length=np.diff(node), commanded=np.stack(commanded), before=before, width=np.diff(edges),
        early=float(run.time[0] - edges[0]), at=at, part=np.clip((node - edges[at]) / np.diff(edges)[at], 0.0, 1.0),
        signals=dict(zip(signals, logged)), values=values, seen=observed, noise=noise[0],
    )  # fmt: skip


def _held(run: Run) -> int:
    """Samples over which commands are averaged: those of a fast log."""
    every = max(1, round(MIN_HOLD_S / max(run.sample_period, 1e-9)))
    return every if len(run.time) >= 2 * every else 1


def _fine(run: Run):  # type: ignore[no-untyped-def]
    """Edges of the fine steps, which divide from middle to middle between samples and as far beyond the first and the
    last, and what averages a held column over them.

    A command is first seen by the sample after its change, which happened anywhere in the interval before: on average
    in its middle. What lags behind it changes within a sample of a slow log.
    """
    time = run.time
    middle = 0.5 * (time[1:] + time[:-1])
    edges = np.concatenate([[2.0 * time[0] - middle[0]], middle, [2.0 * time[-1] - middle[-1]]])
    if (every := _held(run)) == 1:
        parts = max(1, round(run.sample_period / MIN_HOLD_S))
        finer = np.interp(np.arange(parts * len(time) + 1) / parts, np.arange(len(edges)), edges)
        return finer, lambda column: np.repeat(column, parts)
    coarse = np.append(edges[:-1:every], edges[-1])

    def mean(column: Floats) -> Floats:
        passed = np.concatenate([[0.0], np.cumsum(column * np.diff(edges))])
        return np.asarray(np.diff(np.interp(coarse, edges, passed)) / np.diff(coarse))

    return coarse, mean


def _fastest(runs: Sequence[Run], position: str, dof: Dof) -> float:
    """Largest velocity of the runs [per s], each as the mean over a second: of the position or, where that is not
    logged, of the velocity; 0 where neither is."""
    fastest = 0.0
    for run in runs:
        way, velocity = run.channel(position), run.channel(dof.velocity)
        if way is None and velocity is not None:
            way = summed(run.time, filled(run.time, velocity))
        if way is None or np.isfinite(way).sum() < 2:
            continue
        have = np.isfinite(way)
        grid = np.arange(run.time[0], run.time[-1], 1.0)
        fastest = max(fastest, float(np.abs(np.diff(np.interp(grid, run.time[have], way[have]))).max(initial=0.0)))
    return fastest
