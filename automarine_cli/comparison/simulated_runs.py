"""Simulations beside what was measured: free runs from one start state by the commands alone, and restarted ones.

Restarted, the state is set anew from the measured position before the moment or force changes: position integrates
every error, so that one per cent of gain is several degrees after a minute of free running; restarted, the error says
how well the model follows each change of command by itself. A ramp is one change. States of the water go on as in the
free run.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automarine_cli.comparison.rollouts import State, aligned, groups, rest_state, roll, start_states
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import segments


@dataclass(frozen=True)
class FreeRun:
    """One run simulated from its start to its end: positions as the sensor shows them [rad or m] and true rates
    [rad/s or m/s] at the samples, (N,); not finite from where the model diverges; `water` (N, W) its states.
    """

    run: Run
    position: Floats
    rate: Floats
    start: State
    water: Floats

    @property
    def error(self) -> Floats:
        return self.run.position - self.position

    @property
    def diverged(self) -> bool:
        return not bool(np.all(np.isfinite(self.position)))


def free_runs(model: YawModel, runs: Sequence[Run], switch_offset: float = 0.0) -> Iterator[FreeRun]:
    """Simulate all runs under `model`, many at a time, in their order.

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. Raises
    RunError as `make_batch`.
    """
    for group in groups(runs, [len(run) for run in runs]):
        some = runs[group]
        states = start_states(model, some, switch_offset)
        positions, rates = (np.array([getattr(s, name) for s in states]) for name in ("position", "rate"))
        shown = roll(model, some, positions, rates, switch_offset)
        for i, (run, state) in enumerate(zip(some, states)):
            position, rate, water = (x[0, i, : len(run)] for x in (shown.position, shown.velocity, shown.water))
            yield FreeRun(run, position, rate, state, water)


FEWEST = 4  # samples to either side over which a state is smoothed
LONGEST = 1.5  # s to either side
SHORTEST = 1.0  # s between restarts; changes that follow each other sooner are one ramp
EVERY = 15.0  # s between restarts where the command changes all the time
ALL_THE_TIME, RAMPING = 0.2, 0.5  # changes a sample, share of the time on ramps
AT_CHANGES = "before each change of {force}, a ramp being one"
AT_TIMES = f"every {EVERY:g} s, because the {{force}} changes all the time"
NEVER = "never: the {force} does not change after the start"


@dataclass(frozen=True)
class Restarts:
    """Where a run is restarted: samples `at`, from 0 (the run's own start) to its last; `rule` says why there,
    `horizon` is the median time from one to the next [s], `states` are those in between.
    """

    at: tuple[int, ...]
    rule: str
    horizon: float
    states: tuple[State, ...]

    @property
    def pieces(self) -> list[tuple[int, int]]:
        """(first, last) sample of each piece; the last of one is the first of the next."""
        return list(pairwise(self.at))


def find_restarts(run: Run) -> Restarts:
    """Restart at the last sample before each change or ramp of the command, or every 15 s where it always changes."""
    changes = [first for first, _, _ in segments(run.command)[1:]]
    waits = np.diff(run.time[changes])
    ramping = waits < SHORTEST * (1 - 1e-9)
    begins = [first for first, late in zip(changes, [False, *ramping.tolist()]) if not late]
    time_on_ramps = float(waits[ramping].sum())
    driven = len(changes) > ALL_THE_TIME * len(run) or time_on_ramps > RAMPING * (run.time[-1] - run.time[0])
    if driven:
        clock = np.arange(run.time[0] + EVERY, run.time[-1], EVERY)
        wanted = [int(np.searchsorted(run.time, t)) for t in clock]
    else:
        wanted = [first - 1 for first in begins]
    at = [0]
    for i in wanted:
        if run.time[i] - run.time[at[-1]] >= SHORTEST and i < len(run) - 1:
            at.append(i)
    reach = _reach(run)
    rest = rest_state(run)
    states = tuple(
        State(rest.position, 0.0, "the rest with which the run begins")
        if rest is not None and begins[0] == i + 1
        else _smoothed(run, i, [] if driven else begins, reach)
        for i in at[1:]
    )
    at.append(len(run) - 1)
    horizon = float(np.median(np.diff(run.time[at])))
    rule = run.dof.fill(AT_TIMES if driven else AT_CHANGES if states else NEVER)
    return Restarts(tuple(at), rule, horizon, states)


def restarted_errors(
    model: YawModel, free: Sequence[FreeRun], restarts: Sequence[Restarts], switch_offset: float = 0.0
) -> Iterator[Floats]:
    """Measured less restarted position [rad or m], (N,), run by run; 0 at the first sample of all.

    The first piece of each run is that of the free run; all others are simulated many at a time.
    """
    pieces = [(i, *piece) for i, one in enumerate(restarts) for piece in one.pieces[1:]]
    states = [state for one in restarts for state in one.states]
    runs = [free[i].run.cut(first, last + 1) for i, first, last in pieces]
    errors = [one.error.copy() for one in free]
    for group in groups(pieces, [len(run) for run in runs]):
        some = runs[group]
        begin = aligned(model, some, states[group])
        positions, rates = (np.array([getattr(s, name) for s in begin]) for name in ("position", "rate"))
        water = np.array([free[i].water[first] for i, first, _ in pieces[group]]).T[:, None]
        shown = roll(model, some, positions, rates, switch_offset, water=water).position[0]
        for (i, first, last), run, position in zip(pieces[group], some, shown):
            errors[i][first + 1 : last + 1] = (run.position - position[: len(run)])[1:]
    yield from errors


def _smoothed(run: Run, i: int, begins: Sequence[int], reach: float) -> State:
    """Position and rate at sample `i` from a parabola over `reach` [s] to either side, fewer samples: a line.

    Where a change or ramp `begins` right after `i`, the parabola bends differently before and after the middle of that
    interval; it does not reach across where another begins unless too few samples are left.
    """
    bend = i + 1 in begins
    first, stop = (int(k) for k in np.searchsorted(run.time, [run.time[i] - reach, run.time[i] + reach]))
    low = max([first, *(c for c in begins if c <= i)])
    high = min([stop, *(c for c in begins if c > i + 1)])
    if high - low < FEWEST:  # a command that was held for a sample or two leaves no rate
        low, high, bend = first, stop, False
    middle = 0.5 * (run.time[i] + run.time[i + 1]) if bend else run.time[i]
    t, at = run.time[low:high] - middle, run.time[i] - middle
    after = [np.minimum(t, 0.0) ** 2, np.maximum(t, 0.0) ** 2] if bend else [t**2]
    rated = _rated(run, i, low, high, t, at, bend)
    if rated is not None:
        return rated
    powers = np.stack([np.ones_like(t), t, *after], axis=1)[:, : max(1, len(t) - 1)]
    found = np.zeros(4)
    found[: powers.shape[1]] = np.linalg.lstsq(powers, run.position[low:high], rcond=None)[0]
    position, rate = found[0] + found[1] * at + found[2] * at**2, found[1] + 2 * found[2] * at
    return State(float(position), float(rate), f"smoothed: parabola over {high - low} samples")


def _rated(run: Run, i: int, low: int, high: int, t: Floats, at: float, bend: bool) -> State | None:
    """The same with a velocity sensor, `t` times of the samples low:high and `at` that of `i`: the mean of the
    positions carried to `i` by the velocities, and a line through these that may bend; None where readings are
    missing."""
    read = unbiased_velocity(run)
    if read is None or high - low < FEWEST or not np.isfinite(read[low:high]).all():
        return None
    velocity, time = read[low:high], run.time[low:high]
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    position = float(np.mean(run.position[low:high] - way + way[i - low]))
    lines = [np.minimum(t, 0.0), np.maximum(t, 0.0)] if bend and high > i + 2 and i > low else [t]
    powers = np.stack([np.ones_like(t), *lines], axis=1)
    start, *slopes = np.linalg.lstsq(powers, velocity, rcond=None)[0]
    return State(
        position, float(start + slopes[0] * at),
        f"smoothed: {run.dof.position} carried by the {run.dof.words.rate} over {high - low} samples",
    )  # fmt: skip


def _reach(run: Run) -> float:
    """Seconds to either side over which the position is smoothed: where its noise and the parabola's bias balance.

    The variance of a slope falls with the cube of the reach, the square of the bias grows with its fourth power,
    so that the best reach goes with the noise to the power 2/7, and is about a second for a degree, or a centimetre,
    at 10 Hz.
    """
    noise = run.dof.shown(position_noise(run.time, run.position)) * np.sqrt(run.sample_period / 0.1)
    return float(np.clip(noise ** (2 / 7), FEWEST * run.sample_period, LONGEST)) * (1 + 1e-9)
