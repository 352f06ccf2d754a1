"""Simulations beside what was measured: the states in which runs begin, free runs by the commands alone, and restarted
ones.

A run begins at rest where it shows rest, else with the state that follows its first second best. Restarted, the state
is set anew from the measured position before the moment or force changes: position integrates every error, so that one
per cent of gain is several degrees after a minute of free running; restarted, the error says how well the model follows
each change of command by itself. A ramp is one change. States of the water go on as in the free run.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli import effects
from automarine_cli.dofs import PLANAR
from automarine_cli.fits.characteristics import swings_back
from automarine_cli.fits.planar_start import rough_velocities
from automarine_cli.fits.planar_structure import CHANNELS
from automarine_cli.models.model import Model
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity, velocity_noise
from automarine_cli.runs.half_turn import released, segments
from automarine_cli.runs.run import Run, position_noise, slope, summed
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, simulate, step_for

SETTLED_POSITION = 0.01  # of the unit that people see: halving the step must not move a position further than this
MAX_HALVINGS = 4
UNSTEADY_STEP_S = 0.05  # s, the step of a model without a steady rate
MAX_FINE_STEPS = 50_000  # beyond which a step is halved no more; long runs have four times their samples
GROUP_SAMPLES = 500_000  # padded samples simulated together: a few hundred megabytes at most


def step_of(model: Model, runs: Sequence[Run]) -> float:
    step = step_for(model, max(float(np.abs(run.command).max()) for run in runs))
    return step if np.isfinite(step) else UNSTEADY_STEP_S  # drag that never balances it


def roll(
    model: Model, runs: Sequence[Run], position: ArrayLike, rate: ArrayLike,
    step: float | None = None, water: ArrayLike = 0.0,
) -> Trajectory:  # fmt: skip
    """Simulate `runs` from `position` [rad or m] and `rate` [rad/s or m/s] at their first samples, (P, R) or (R,), and
    from states of the `water` (W, 1, R); not finite where the model diverges. Without a `step` [s] that is halved until
    positions settle to 0.01 degrees or cm. Raises RunError as `make_batch`."""
    signals, position, rate = model.signals, np.atleast_2d(position), np.atleast_2d(rate)

    def once(step: float) -> Trajectory:
        batch = make_batch(runs, step, signals)
        with np.errstate(over="ignore", invalid="ignore"):  # a model that runs away is told of, not warned about
            return simulate(model, batch, start=Start(position, rate, water=water))

    if step is not None:
        return once(step)
    step = step_of(model, runs)
    path = once(step)
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    most = max(MAX_FINE_STEPS, 4 * max(len(run) for run in runs))
    for _ in range(MAX_HALVINGS):
        step, coarser = step / 2, path
        if longest / step > most:
            break
        path = once(step)
        fate, before = np.isfinite(path.position), np.isfinite(coarser.position)
        moved = np.abs(path.position[fate & before] - coarser.position[fate & before]).max(initial=0.0)
        if np.array_equal(fate, before) and model.dof.shown(moved) <= SETTLED_POSITION:
            break
    return path


START_WINDOW_S = 1.0  # s over which a start is fitted
MIN_AT_START = 5  # samples of such a fit, for slow loggers
NUDGE = 1e-4  # rad and rad/s, or m and m/s, for derivatives
START_STEP = 1.5e-8  # share of a start, or of one, by which it is moved for derivatives that search it
START_ROUNDS = 4
MAX_WEIGHT = 100.0  # of a reading of a velocity [s]
MIN_SENSITIVITY = 0.1  # of what a sensor shows of a small move


@dataclass(frozen=True)
class StartState:
    """Position [rad or m] and rate [rad/s or m/s] at the first sample, three of each in the plane, and how a free
    run's were found."""

    position: Any
    rate: Any
    how: str = ""


def rest_state(run: Run) -> StartState | None:
    """Find the position of the rest with which the run begins, rate 0; None where it does not begin so."""
    count, words = released(run), run.dof.words
    if not count:
        return None
    how = f"from rest: mean {words.position} of {count} samples, {words.speed} 0"
    return StartState(float(run.position[:count].mean()), 0.0, how)


def start_states(model: Model, runs: Sequence[Run]) -> list[StartState]:
    """Find the start of each run: at rest, or with the position and rate from which the model follows the first second
    (at least 5 samples) of the measured position best, by least squares."""
    rests = [rest_state(run) for run in runs]
    resting = [run for run, rest in zip(runs, rests) if rest is not None]
    at_rest = iter(aligned(model, resting, [rest for rest in rests if rest is not None]))
    step = step_of(model, runs) / 2
    return [_fitted(model, run, step) if rest is None else next(at_rest) for run, rest in zip(runs, rests)]


def aligned(model: Model, runs: Sequence[Run], states: Sequence[StartState]) -> list[StartState]:
    """Return true states at which the model's sensor shows the positions and rates of `states` at the first sample."""
    sensors = [term for term in model.terms if effects.get(term.name).place is effects.Place.SENSOR]
    if not runs or not sensors:
        return list(states)
    targets = np.array([state.position for state in states])
    position, gain = targets, np.ones(len(runs))
    begin = [run.cut(0, 2) for run in runs]
    for _ in range(2 * START_ROUNDS):
        tried = position + NUDGE * np.array([[0.0], [1.0], [-1.0]])
        readings = roll(model, begin, tried, 0.0 * tried, step=np.inf).position[:, :, 0]
        gain = (readings[1] - readings[2]) / (2 * NUDGE)
        gain = np.where(np.isfinite(gain) & (np.abs(gain) > MIN_SENSITIVITY), gain, 1.0)
        position = position + np.nan_to_num((targets - readings[0]) / gain, posinf=0.0, neginf=0.0)
    return [StartState(float(x), s.rate / float(g), s.how) for x, g, s in zip(position, gain, states)]


def _fitted(model: Model, run: Run, step: float) -> StartState:
    """Fit start position and rate by least squares, from a line through the same samples, with steps of `step` [s].
    What a velocity sensor reads there counts with the ratio of the position's noise to its own."""
    end = int(np.searchsorted(run.time, run.time[0] + START_WINDOW_S * (1 + 1e-9), side="right"))
    begin, velocity, weight = run.cut(0, max(end, MIN_AT_START)), unbiased_velocity(run), 0.0
    if velocity is not None:
        noise = max(position_noise(run.time, run.position), 1e-9)
        weight = min(noise / max(velocity_noise(run), 1e-9), MAX_WEIGHT)
    readings = np.full(len(begin), np.nan) if velocity is None else velocity[: len(begin)]
    rate = slope(begin.time, begin.position)[0]
    line = np.array([begin.position.mean() - rate * (begin.time.mean() - begin.time[0]), rate])

    batch = make_batch([begin], step, model.signals)

    def residuals(starts: Floats) -> Floats:
        path = simulate(model, batch, start=Start(starts[:, :1], starts[:, 1:]))
        off = weight * (readings - path.velocity[:, 0])[:, np.isfinite(readings)]
        return np.concatenate([begin.position - path.position[:, 0], off], axis=1)

    (x, r), words = _least_squares(residuals, line), model.dof.words
    how = f"fitted: {words.position} and {words.speed} that follow the first {len(begin)} samples best"
    return StartState(float(x), float(r), how)


def _least_squares(residuals: Callable[[Floats], Floats], initial: Floats) -> Floats:
    """Find the start (n,) whose squares are least of the `residuals` (P, m) that starts (P, n) have; the `initial` one
    under a model that runs away."""
    from scipy.optimize import least_squares  # here, as it takes its time to import

    @np.errstate(over="ignore", invalid="ignore")
    def finite(starts: Floats) -> Floats:
        return np.nan_to_num(residuals(starts), nan=MAX_WAY, posinf=MAX_WAY, neginf=-MAX_WAY)

    def slopes(start: Floats) -> Floats:
        steps = START_STEP * np.copysign(np.maximum(np.abs(start), 1.0), start)
        here, *moved = finite(np.vstack([start, start + np.diag(steps)]))
        return (np.stack(moved, axis=1) - here[:, None]) / steps

    return np.asarray(least_squares(lambda start: finite(start[None])[0], initial, slopes, method="lm").x)


MAX_WAY = 1e6  # m, or rad: a simulation that gets there diverges


@dataclass(frozen=True)
class FreeRun:
    """One run simulated from its start to its end: `simulated` (N,) by quantity, positions as the sensors show them and
    true velocities [base units], not finite from where the model diverges; `water` (N, W) its states."""

    run: Run
    simulated: Mapping[str, Floats]
    start: StartState
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
        data = self.run.channel(channel)
        if data is None or (channel == self.run.dof.position and self.run.summed_up) or not np.isfinite(data).any():
            return None
        return np.asarray(data - self.simulated[channel])

    @property
    def distance(self) -> Floats | None:
        north, east = (self.error_of(name) for name in PLANAR.positions[:2])
        return None if north is None or east is None else np.hypot(north, east)

    @property
    def diverged(self) -> bool:
        return not all(np.all(np.abs(column) < MAX_WAY) for column in self.simulated.values())


def free_runs(model: Model, runs: Sequence[Run]) -> Iterator[FreeRun]:
    """Simulate all runs, many at a time, in their order; see `roll`."""
    states = start_states(model, runs)
    for run, state, (position, rate, water) in zip(runs, states, _paths(model, runs, states)):
        yield FreeRun(run, {model.dof.position: position, model.dof.velocity: rate}, state, water)


def _paths(
    model: Model, runs: Sequence[Run], states: Sequence[StartState], water: Sequence[Floats] = ()
) -> Iterator[tuple[Floats, ...]]:
    """Simulate each run from its state and that of the `water` (W,): position and rate (N,) and water (N, W)."""
    size = max(1, GROUP_SAMPLES // max(map(len, runs), default=1))
    for group in (slice(i, i + size) for i in range(0, len(runs), size)):
        position, rate = (np.array([getattr(state, name) for state in states[group]]) for name in ("position", "rate"))
        stirred = np.array(water[group]).T[:, None] if water else 0.0
        path = roll(model, runs[group], position, rate, water=stirred)
        for i, run in enumerate(runs[group]):
            yield tuple(x[0, i, : len(run)] for x in (path.position, path.velocity, path.water))


MIN_SMOOTHED = 4  # samples to either side over which a state is smoothed
MAX_REACH_S = 1.5  # s to either side
MIN_RESTART_S = 1.0  # s between restarts; changes that follow each other sooner are one ramp
CLOCK_RESTART_S = 15.0  # s between restarts where the command changes all the time
ALL_THE_TIME, RAMPING = 0.2, 0.5  # changes a sample, share of the time on ramps
AT_CHANGES = "before each change of {force} (a ramp is one change)"
AT_TIMES = f"every {CLOCK_RESTART_S:g} s, because the {{force}} changes all the time"
NEVER_RESTARTED = "never: the {force} does not change after the start"


@dataclass(frozen=True)
class Restarts:
    """Where a run is restarted: samples `at`, from 0 (the run's own start) to its last; `rule` says why there,
    `horizon` is the median time from one to the next [s], `states` are those in between."""

    at: tuple[int, ...]
    rule: str
    horizon: float
    states: tuple[StartState, ...]


def find_restarts(run: Run) -> Restarts:
    """Restart at the last sample before each change or ramp of the command, or every 15 s where it always changes."""
    time = run.time
    changes = np.array([first for first, _, _ in segments(run.command)[1:]], dtype=int)
    waits = np.diff(time[changes], prepend=-np.inf)
    ramping = waits < MIN_RESTART_S * (1 - 1e-9)
    begins = changes[~ramping].tolist()
    on_ramps = float(waits[ramping].sum())
    driven = len(changes) > ALL_THE_TIME * len(run) or on_ramps > RAMPING * (time[-1] - time[0])
    clock = np.searchsorted(time, np.arange(time[0] + CLOCK_RESTART_S, time[-1], CLOCK_RESTART_S)).tolist()
    at = [0]
    for i in clock if driven else (first - 1 for first in begins):
        if time[i] - time[at[-1]] >= MIN_RESTART_S and i < len(run) - 1:
            at.append(i)
    # The variance of a slope falls with the cube of the reach, the square of the parabola's bias grows with its fourth
    # power: the best reach goes with the noise to the power 2/7; about a second for a degree, or a centimetre, at 10 Hz
    noise = run.dof.shown(position_noise(time, run.position)) * np.sqrt(run.sample_period / 0.1)
    reach = float(np.clip(noise ** (2 / 7), MIN_SMOOTHED * run.sample_period, MAX_REACH_S)) * (1 + 1e-9)
    rest = rest_state(run)
    states = tuple(
        StartState(rest.position, 0.0)
        if rest is not None and begins[0] == i + 1
        else _smoothed(run, i, [] if driven else begins, reach)
        for i in at[1:]
    )
    at.append(len(run) - 1)
    rule = run.dof.fill(AT_TIMES if driven else AT_CHANGES if states else NEVER_RESTARTED)
    return Restarts(tuple(at), rule, float(np.median(np.diff(time[at]))), states)


def restarted_errors(model: Model, free: Sequence[FreeRun], restarts: Sequence[Restarts]) -> list[Floats]:
    """Return measured less restarted position [rad or m], (N,), of each run, until its first restart the free run's."""
    pieces = [(i, *piece) for i, of_run in enumerate(restarts) for piece in list(pairwise(of_run.at))[1:]]
    runs = [free[i].run.cut(first, last + 1) for i, first, last in pieces]
    states = aligned(model, runs, [state for of_run in restarts for state in of_run.states])
    water = [free[i].water[first] for i, first, _ in pieces]
    errors = [of_run.error.copy() for of_run in free]
    for (i, first, last), run, (simulated, *_) in zip(pieces, runs, _paths(model, runs, states, water)):
        errors[i][first + 1 : last + 1] = (run.position - simulated)[1:]
    return errors


def remade(model: Model, free: Sequence[FreeRun], gain: float, rng: np.random.Generator) -> list[FreeRun]:
    """Return the runs as a vehicle that is the model would have logged them, were its thrust `gain` times what it is
    commanded, read by sensors as noisy as those of the runs."""
    driven = [replace(of_run.run, moment=gain * of_run.run.command) for of_run in free]
    name, again = model.dof.velocity, list[FreeRun]()
    for of_run, (position, rate, _) in zip(free, _paths(model, driven, [of_run.start for of_run in free])):
        run, (error, unsteady) = of_run.run, rng.standard_normal((2, len(of_run.run)))
        logged = np.where(np.isnan(run.extras.get(name, np.nan)), np.nan, rate + velocity_noise(run) * unsteady)
        position = position + position_noise(run.time, run.position) * error
        again.append(replace(of_run, run=replace(run, position=position, extras={**run.extras, name: logged})))
    return again


def _smoothed(run: Run, i: int, begins: Sequence[int], reach: float) -> StartState:
    """Smooth position and rate at sample `i` by a parabola over `reach` [s] to either side, fewer samples: a line.
    Where a change or ramp `begins` right after `i`, the parabola bends differently before and after the middle of that
    interval; it does not reach across where another begins unless too few samples are left. With a velocity sensor: the
    mean of the positions carried to `i` by the velocities, and a line through these that may bend."""
    bend = i + 1 in begins
    first, stop = (int(k) for k in np.searchsorted(run.time, [run.time[i] - reach, run.time[i] + reach]))
    low = max([first, *(c for c in begins if c <= i)])
    high = min([stop, *(c for c in begins if c > i + 1)])
    if high - low < MIN_SMOOTHED:  # a command that was held for a sample or two leaves no rate
        low, high, bend = first, stop, False
    middle = 0.5 * (run.time[i] + run.time[i + 1]) if bend else run.time[i]
    t, at, count = run.time[low:high] - middle, run.time[i] - middle, high - low
    sides = [np.minimum(t, 0.0), np.maximum(t, 0.0)]
    logged = unbiased_velocity(run)
    if logged is not None and count >= MIN_SMOOTHED and np.isfinite(logged[low:high]).all():
        velocity = logged[low:high]
        way = summed(run.time[low:high], velocity)
        position = float(np.mean(run.position[low:high] - way + way[i - low]))
        lines = sides if bend and high > i + 2 and i > low else [t]
        start, by_time, *_ = np.linalg.lstsq(np.stack([np.ones_like(t), *lines], axis=1), velocity, rcond=None)[0]
        return StartState(position, float(start + by_time * at))
    after = [side**2 for side in sides] if bend else [t**2]
    powers = np.stack([np.ones_like(t), t, *after], axis=1)[:, : max(1, count - 1)]
    c = np.zeros(4)
    c[: powers.shape[1]] = np.linalg.lstsq(powers, run.position[low:high], rcond=None)[0]
    position, rate = c[0] + c[1] * at + c[2] * at**2, c[1] + 2 * c[2] * at
    return StartState(float(position), float(rate))


FREE_RUN_STEP_S = 0.05  # longest step of the simulation [s]
BEGIN_S = 2.0  # s of a run from which its start is told
MIN_IN_THE_PLANE = 3  # samples of a rest, and of a start under way
NOISE = {"heading": 0.02, "yaw_rate": 0.02, "surge": 0.03, "sway": 0.03, "north": 0.05, "east": 0.05}
"""What readings of a start count for [rad, m, s]."""
START_SD = 3.0  # m, rad, m/s, rad/s by which a start may differ from the first readings


def planar_free_runs(model: Model, runs: Sequence[Run]) -> Iterator[FreeRun]:
    """Simulate every run by its commands from the state with which its log begins."""
    for run in runs:
        start = planar_start(run, model)
        batch = make_batch([run], FREE_RUN_STEP_S, model.signals, motion=PLANAR, channels=CHANNELS)
        path = simulate(model, batch, start=Start(start[:3, None, None], start[3:, None, None]))
        simulated = {channel.quantity: path.reading(channel)[0, 0] for channel in batch.channels}
        yield FreeRun(run, simulated, StartState(start[:3], start[3:]), np.zeros((len(run), 0)))


def planar_overshoots(model: Model, run: Run) -> list[tuple[float, float]]:
    """Give overshoot angles [rad] of a zigzag whose rudder is logged, of its log and of the model from the state at
    each execute on; none for any other run."""
    pairs: list[tuple[float, float]] = []
    rudder = run.extras.get("rudder")
    for swing in () if rudder is None else swings_back(rudder, run.position):
        (free,) = planar_free_runs(model, [run.cut(swing.first, swing.last + 1)])
        pairs.append(swing.beside(free.position, run.position))
    return pairs


def planar_start(run: Run, model: Model) -> Floats:
    """Find north, east, heading and velocities (u, v, r) with which a run begins, (6,); what is not read is zero. At
    rest the means of the readings before the first command; under way the state that follows the first `BEGIN_S` best
    under the model."""
    commands = np.stack([run.command_of(dof) for dof in PLANAR.dofs])
    quiet = int(np.argmax(np.append(np.any(commands != commands[:, :1], axis=0), True)))
    at_rest = not commands[:, 0].any() and quiet >= MIN_IN_THE_PLANE
    until = run.time <= run.time[0] + BEGIN_S
    if at_rest:
        until &= np.arange(len(run)) < quiet
    data = {name: run.channel(name) for name in PLANAR.positions if name != run.dof.position or not run.summed_up}
    rough = {} if at_rest else rough_velocities(run)
    places, velocities = [data.get(name) for name in PLANAR.positions], [rough.get(dof.velocity) for dof in PLANAR.dofs]
    initial = np.array([_mean(values, until) for values in (*places, *velocities)])
    if at_rest:
        return initial
    first = run.cut(0, max(int(np.count_nonzero(until)), MIN_IN_THE_PLANE))
    batch = make_batch([first], FREE_RUN_STEP_S, model.signals, motion=PLANAR, channels=CHANNELS)
    channels = [channel for channel in batch.channels if channel.counts and channel.seen.any()]

    def residuals(states: Floats) -> Floats:
        columns = states.T[..., None]
        path = simulate(model, batch, start=Start(columns[:3], columns[3:]))
        errors = [(path.reading(of) - of.values)[:, of.seen] / NOISE[of.quantity] for of in channels]
        return np.concatenate([*errors, (states - initial) / START_SD], axis=1)

    return _least_squares(residuals, initial)


def _mean(values: Floats | None, until: NDArray[np.bool_]) -> float:
    """Average the readings at the beginning, or take the first one; zero where there is none."""
    good = np.zeros_like(until) if values is None else np.isfinite(values)
    if values is None or not good.any():
        return 0.0
    return float(np.mean(values[until & good])) if (until & good).any() else float(values[good][0])
