"""Simulations beside what was measured: the states in which runs begin, free runs by the commands alone, and restarted
ones.

A run begins at rest where it shows rest, else with the state that follows its first second best. Restarted, the state
is set anew from the measured position before the moment or force changes: position integrates every error, so that one
per cent of gain is several degrees after a minute of free running; restarted, the error says how well the model follows
each change of command by itself. A ramp is one change. States of the water go on as in the free run.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from automarine_cli import effects
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.planar_structure import CHANNELS, rough_velocities
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity, velocity_noise
from automarine_cli.runs.half_turn import segments
from automarine_cli.runs.run import Run, position_noise, slope
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, simulate, step_for

Item = TypeVar("Item")

SETTLED = 0.01  # of the unit that people see: halving the step must not move a position further than this
MOST_HALVINGS = 4
UNSTEADY = 0.05  # s, the step of a model without a steady rate
MOST_STEPS = 50_000  # beyond which a step is halved no more; long runs have four times their samples
GROUP_SAMPLES = 500_000  # padded samples simulated together: a few hundred megabytes at most


def needed_signals(model: YawModel) -> tuple[str, ...]:
    """Columns of `Run.extras` that the model's effects read, in the order of its terms."""
    return tuple(dict.fromkeys(name for term in model.terms for name in effects.get(term.name).needs))


def has_sensor(model: YawModel) -> bool:
    return any(effects.get(term.name).place is effects.Place.SENSOR for term in model.terms)


def step_of(model: YawModel, runs: Sequence[Run]) -> float:
    """Step [s] to begin with: fit for the drag under the largest command."""
    step = step_for(model, max(float(np.abs(run.command).max()) for run in runs))
    return step if np.isfinite(step) else UNSTEADY  # drag that never balances it


def roll(
    model: YawModel, runs: Sequence[Run], position: ArrayLike, rate: ArrayLike, switch_offset: float = 0.0,
    step: float | None = None, water: ArrayLike = 0.0,
) -> Trajectory:  # fmt: skip
    """Simulate `runs` from `position` [rad or m] and `rate` [rad/s or m/s] at their first samples, (P, R) or (R,), and
    from states of the `water` (W, 1, R).

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. Without a `step`
    [s] that is halved until positions settle to 0.01 degrees or cm, four times at most. Returns positions and rates
    (P, R, N), padded; not finite where the model diverges. Raises RunError as `make_batch`.
    """
    signals, position, rate = needed_signals(model), np.atleast_2d(position), np.atleast_2d(rate)

    def once(step: float) -> Trajectory:
        batch = make_batch(runs, step, signals)
        delay = switch_offset * batch.interval[None] if switch_offset else None
        with np.errstate(over="ignore", invalid="ignore"):  # a model that runs away is told of, not warned about
            return simulate(model, batch, start=Start(position, rate, switch_delay=delay, water=water))

    if step is not None:
        return once(step)
    step = step_of(model, runs)
    best = once(step)
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    most = max(MOST_STEPS, 4 * max(len(run) for run in runs))
    for _ in range(MOST_HALVINGS):
        step /= 2
        if longest / step > most:
            break
        finer = once(step)
        both = np.isfinite(finer.position) & np.isfinite(best.position)
        moved = np.abs(np.where(both, finer.position, 0.0) - np.where(both, best.position, 0.0)).max()
        same_fate = bool(np.all(np.isfinite(finer.position) == np.isfinite(best.position)))
        best = finer
        if same_fate and model.dof.shown(moved) <= SETTLED:
            break
    return best


def groups(items: Sequence[Item], sizes: Sequence[int]) -> Iterator[slice]:
    """Slices of consecutive items whose padded size stays within reach of the memory."""
    begin, longest = 0, 0
    for i, size in enumerate(sizes):
        longest = max(longest, size)
        if i > begin and longest * (i + 1 - begin) > GROUP_SAMPLES:
            yield slice(begin, i)
            begin, longest = i, size
    if items:
        yield slice(begin, len(items))


WINDOW = 1.0  # s over which a start is fitted
FEWEST_AT_START = 5  # samples of such a fit, for slow loggers
SURE = 4.0  # standard errors
ENOUGH_REST = 10  # samples
SLOW = 0.02  # of the run's pace: drift that counts as standing still
NUDGE = 1e-4  # rad and rad/s, or m and m/s, for derivatives
ROUNDS = 4
RUNAWAY = 1e6  # no slope of a position that a vehicle could have
MOST_WEIGHT = 100.0  # of a reading of a velocity [s]
LEAST_GAIN = 0.1  # of what a sensor shows of a small move


@dataclass(frozen=True)
class State:
    """Position [rad or m] and rate [rad/s or m/s] at the first sample, three of each in the plane, and how they were
    found."""

    position: Any
    rate: Any
    how: str


def rest_state(run: Run) -> State | None:
    """Position of the rest with which the run begins, rate 0; None where it does not begin at rest.

    Rest is no command over two samples or more, without a slope in the position beyond its noise.
    """
    first, stop, moment = segments(run.command)[0]
    count = stop - first
    if moment != 0 or count < 2:
        return None
    time, position = run.time[:stop], run.position[:stop]
    rate, error = slope(time, position)
    doubt = SURE * error * position_noise(run.time, run.position)
    pace = _pace(run)
    if abs(rate) > doubt + SLOW * pace or (count < ENOUGH_REST and doubt > 0.25 * pace):
        return None
    words = run.dof.words
    how = f"from rest: mean {words.position} of {count} samples, {words.speed} 0"
    return State(float(position.mean()), 0.0, how)


def start_states(model: YawModel, runs: Sequence[Run], switch_offset: float = 0.0) -> list[State]:
    """The start of each run under `model`.

    A run that does not begin at rest starts with the position and rate from which the model follows the first
    second (at least 5 samples) of the measured position best, by least squares.
    """
    states = [rest_state(run) for run in runs]
    moving = [i for i, state in enumerate(states) if state is None]
    for i, state in zip(moving, _fitted(model, [runs[i] for i in moving], switch_offset) if moving else []):
        states[i] = state
    found = [state for state in states if state is not None]
    if not has_sensor(model):
        return found
    still = [i for i in range(len(runs)) if i not in moving]
    for i, state in zip(still, aligned(model, [runs[i] for i in still], [found[i] for i in still])):
        found[i] = state
    return found


def aligned(model: YawModel, runs: Sequence[Run], states: Sequence[State]) -> list[State]:
    """True states at which the model's sensor shows the positions and rates of `states` at the first sample."""
    if not runs or not has_sensor(model):
        return list(states)
    shown = np.array([state.position for state in states])
    position, gain = shown.copy(), np.ones(len(runs))
    begin = [run.cut(0, 2) for run in runs]
    for _ in range(2 * ROUNDS):
        tried = position + NUDGE * np.array([[0.0], [1.0], [-1.0]])
        read = roll(model, begin, tried, 0.0 * tried, step=np.inf).position[:, :, 0]
        gain = (read[1] - read[2]) / (2 * NUDGE)
        gain = np.where(np.isfinite(gain) & (np.abs(gain) > LEAST_GAIN), gain, 1.0)
        position = position + np.nan_to_num((shown - read[0]) / gain, posinf=0.0, neginf=0.0)
    return [State(float(x), s.rate / float(g), s.how) for x, g, s in zip(position, gain, states)]


def _fitted(model: YawModel, runs: Sequence[Run], switch_offset: float) -> list[State]:
    """Gauss-Newton on start position and rate, all runs at once, from a line through the same samples."""
    begins = [run.cut(0, _window(run)) for run in runs]
    step = step_of(model, runs) / 2
    rates = np.array([slope(run.time, run.position)[0] for run in begins])
    lead = np.array([run.time.mean() - run.time[0] for run in begins])
    guess = np.stack([np.array([run.position.mean() for run in begins]) - rates * lead, rates])
    width = max(len(run) for run in begins)
    measured, seen = np.zeros((len(runs), width)), np.zeros((len(runs), width))
    for row, mask, run in zip(measured, seen, begins):
        row[: len(run)], mask[: len(run)] = run.position, 1.0
    found, rated = guess, _velocities_at_start(begins, runs, width)
    for _ in range(ROUNDS):
        position = found[0] + NUDGE * np.array([[0.0], [1.0], [-1.0], [0.0], [0.0]])
        rate = found[1] + NUDGE * np.array([[0.0], [0.0], [0.0], [1.0], [-1.0]])
        states = roll(model, begins, position, rate, switch_offset, step)
        shown, read, there = states.position, measured, seen
        if rated is not None:
            shown = np.concatenate([shown, rated[1] * states.velocity], axis=2)
            read = np.concatenate([measured, rated[1] * rated[0]], axis=1)
            there = np.concatenate([seen, (rated[1] > 0).astype(float)], axis=1)
        with np.errstate(invalid="ignore"):  # a model that runs away within a second keeps the line
            left = np.where(there > 0, read - shown[0], 0.0)
            slopes = np.where(there > 0, (shown[1::2] - shown[2::2]) / (2 * NUDGE), 0.0)
        good = np.all(np.abs(slopes) < RUNAWAY, axis=(0, 2)) & np.all(np.abs(left) < RUNAWAY, axis=1)
        slopes, left = np.where(good[:, None], slopes, 0.0), np.where(good[:, None], left, 0.0)
        square = np.einsum("irn,jrn->rij", slopes, slopes) + 1e-12 * np.eye(2)
        found = found + np.linalg.solve(square, np.einsum("irn,rn->ri", slopes, left)[..., None])[..., 0].T
    words = model.dof.words
    both = f"{words.position} and {words.speed}"
    return [
        State(float(x), float(r), f"fitted: {both} that follow the first {len(run)} samples best")
        for x, r, run in zip(*found, begins)
    ]


def _velocities_at_start(begins: Sequence[Run], runs: Sequence[Run], width: int) -> tuple[Floats, Floats] | None:
    """What velocity sensors read at the starts, less their bias, and the weight of each reading, both (R, width): how
    many times the position's noise is the sensor's; None where no run has one."""
    if all(run.dof.velocity not in run.extras for run in begins):
        return None
    values, weights = np.zeros((2, len(begins), width))
    for value, weight, begin, run in zip(values, weights, begins, runs):
        read = unbiased_velocity(run)
        if read is None:
            continue
        read = read[: len(begin)]
        good = np.isfinite(read)
        value[: len(begin)] = np.where(good, read, 0.0)
        ratio = max(position_noise(run.time, run.position), 1e-9) / max(velocity_noise(run), 1e-9)
        weight[: len(begin)] = np.where(good, min(ratio, MOST_WEIGHT), 0.0)
    return values, weights


def _window(run: Run) -> int:
    count = int(np.searchsorted(run.time, run.time[0] + WINDOW * (1 + 1e-9), side="right"))
    return min(max(count, FEWEST_AT_START), len(run))


def _pace(run: Run) -> float:
    """How fast the run moves where it moves fast [rad/s or m/s]: 90th percentile of the way of one second."""
    later = np.interp(run.time + 1.0, run.time, run.position)
    return float(np.percentile(np.abs(later - run.position), 90))


FAR = 1e6  # m, or rad: a simulation that gets there diverges


@dataclass(frozen=True)
class FreeRun:
    """One run simulated from its start to its end: `simulated` (N,) by quantity, positions as the sensors show them and
    true velocities [base units], not finite from where the model diverges; `water` (N, W) its states.
    """

    run: Run
    simulated: Mapping[str, Floats]
    start: State
    water: Floats

    @property
    def position(self) -> Floats:
        return self.simulated[self.run.dof.position]

    @property
    def rate(self) -> Floats:
        return self.simulated[self.run.dof.velocity]

    @property
    def error(self) -> Floats:
        return self.run.position - self.position

    def error_of(self, channel: str) -> Floats | None:
        """Measured less simulated, (N,), NaN where nothing was read; None where the log has no such channel."""
        read = self.run.channel(channel)
        unread = read is None or (channel == self.run.dof.position and self.run.summed_up)
        if unread or read is None or not np.isfinite(read).any():
            return None
        return np.asarray(read - self.simulated[channel])

    @property
    def distance(self) -> Floats | None:
        north, east = (self.error_of(name) for name in PLANAR.positions[:2])
        return None if north is None or east is None else np.hypot(north, east)

    @property
    def diverged(self) -> bool:
        return not all(np.all(np.abs(column) < FAR) for column in self.simulated.values())


def free_runs(model: YawModel, runs: Sequence[Run], switch_offset: float = 0.0) -> Iterator[FreeRun]:
    """Simulate all runs under `model`, many at a time, in their order.

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. Raises
    RunError as `make_batch`.
    """
    for group in groups(runs, [len(run) for run in runs]):
        some = runs[group]
        states = start_states(model, some, switch_offset)
        positions, rates = (np.array([getattr(s, name) for s in states]) for name in ("position", "rate"))
        path = roll(model, some, positions, rates, switch_offset)
        for i, (run, state) in enumerate(zip(some, states)):
            position, rate, water = (x[0, i, : len(run)] for x in (path.position, path.velocity, path.water))
            yield FreeRun(run, {model.dof.position: position, model.dof.velocity: rate}, state, water)


FEWEST_SMOOTHED = 4  # samples to either side over which a state is smoothed
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
    if high - low < FEWEST_SMOOTHED:  # a command that was held for a sample or two leaves no rate
        low, high, bend = first, stop, False
    middle = 0.5 * (run.time[i] + run.time[i + 1]) if bend else run.time[i]
    t, at = run.time[low:high] - middle, run.time[i] - middle
    after = [np.minimum(t, 0.0) ** 2, np.maximum(t, 0.0) ** 2] if bend else [t**2]
    rated = _smoothed_by_velocity(run, i, low, high, t, at, bend)
    if rated is not None:
        return rated
    powers = np.stack([np.ones_like(t), t, *after], axis=1)[:, : max(1, len(t) - 1)]
    found = np.zeros(4)
    found[: powers.shape[1]] = np.linalg.lstsq(powers, run.position[low:high], rcond=None)[0]
    position, rate = found[0] + found[1] * at + found[2] * at**2, found[1] + 2 * found[2] * at
    return State(float(position), float(rate), f"smoothed: parabola over {high - low} samples")


def _smoothed_by_velocity(run: Run, i: int, low: int, high: int, t: Floats, at: float, bend: bool) -> State | None:
    """The same with a velocity sensor, `t` times of the samples low:high and `at` that of `i`: the mean of the
    positions carried to `i` by the velocities, and a line through these that may bend; None where readings are
    missing."""
    read = unbiased_velocity(run)
    if read is None or high - low < FEWEST_SMOOTHED or not np.isfinite(read[low:high]).all():
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
    return float(np.clip(noise ** (2 / 7), FEWEST_SMOOTHED * run.sample_period, LONGEST)) * (1 + 1e-9)


PLANAR_STEP = 0.05  # longest step of the simulation [s]
BEGINNING = 2.0  # s of a run from which its start is told
FEWEST_IN_THE_PLANE = 3  # samples of a rest, and of a start under way
NOISE = {"heading": 0.02, "yaw_rate": 0.02, "surge": 0.03, "sway": 0.03, "north": 0.05, "east": 0.05}
"""What readings of a start count for [rad, m, s]."""
LOOSE = 3.0  # m, rad, m/s, rad/s by which a start may differ from the first readings


def planar_free_runs(model: PlanarModel, runs: Sequence[Run]) -> Iterator[FreeRun]:
    """Every run simulated by its commands from the state with which its log begins."""
    for run in runs:
        start = planar_start(run, model)
        batch = make_batch([run], PLANAR_STEP, motion=PLANAR, channels=CHANNELS)
        path = simulate(model, batch, start=_start(start))
        simulated = {channel.quantity: path.reading(channel)[0, 0] for channel in batch.channels}
        yield FreeRun(run, simulated, State(start[:3], start[3:], ""), np.zeros((len(run), 0)))


def _start(state: Floats) -> Start:
    return Start(state[:3, None, None], state[3:, None, None])


def planar_start(run: Run, model: PlanarModel) -> Floats:
    """North, east, heading and velocities (u, v, r) with which a run begins, (6,); what is not read is zero.

    At rest the means of the readings before the first command; under way the state that follows the first `BEGINNING`
    best under the model.
    """
    commands = np.stack([run.command_of(dof) for dof in PLANAR.dofs])
    quiet = int(np.argmax(np.append(np.any(commands != commands[:, :1], axis=0), True)))
    still = not commands[:, 0].any() and quiet >= FEWEST_IN_THE_PLANE
    until = run.time <= run.time[0] + BEGINNING
    if still:
        until &= np.arange(len(run)) < quiet
    place = [
        0.0 if run.summed_up and name == run.dof.position else _mean(run.channel(name), until)
        for name in PLANAR.positions
    ]
    if still:
        return np.array([*place, 0.0, 0.0, 0.0])
    rough = rough_velocities(run)
    velocity = [_mean(rough.get(dof.velocity), until) for dof in PLANAR.dofs]
    first = run.cut(0, max(int(np.count_nonzero(until)), FEWEST_IN_THE_PLANE))
    return _followed(model, first, np.array([*place, *velocity]))


def _followed(model: PlanarModel, run: Run, near: Floats) -> Floats:
    """The start (6,) that follows a run best; what is not read stays `near`."""
    batch = make_batch([run], PLANAR_STEP, motion=PLANAR, channels=CHANNELS)
    channels = [channel for channel in batch.channels if channel.counts and channel.seen.any()]

    def residuals(state: Floats) -> Floats:
        path = simulate(model, batch, start=_start(state))
        errors = [(path.reading(of)[0] - of.values)[of.seen] / NOISE[of.quantity] for of in channels]
        return np.nan_to_num(np.concatenate([*errors, (state - near) / LOOSE]), nan=FAR, posinf=FAR, neginf=-FAR)

    return np.asarray(least_squares(residuals, near, method="lm").x)


def _mean(values: Floats | None, until: NDArray[np.bool_]) -> float:
    """Mean of the readings at the beginning, or the first reading; zero where there is none."""
    if values is None or not np.isfinite(values).any():
        return 0.0
    here = values[until & np.isfinite(values)]
    return float(np.mean(here)) if len(here) else float(values[np.isfinite(values)][0])
