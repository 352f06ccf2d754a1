"""Runs simulated under one model, with steps halved until they no longer matter, and the states in which they begin:
at rest where the run shows rest, else fitted locally."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli import effects
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity, velocity_noise
from automarine_cli.runs.noise import position_noise, slope
from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import segments
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
    model: YawModel,
    runs: Sequence[Run],
    position: ArrayLike,
    rate: ArrayLike,
    switch_offset: float = 0.0,
    step: float | None = None,
    water: ArrayLike = 0.0,
) -> Trajectory:
    """Simulate `runs` from `position` [rad or m] and `rate` [rad/s or m/s] at their first samples, (P, R) or (R,), and
    from states of the `water` (W, 1, R).

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. With `step`
    [s] that step is used as it is; without it the step is halved until positions settle to 0.01 degrees or cm, four
    times at most. Returns
    positions and rates (P, R, N), padded; not finite where the model diverges. Raises RunError as `make_batch`.
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
FEWEST = 5  # samples of such a fit, for slow loggers
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
    """Position [rad or m] and rate [rad/s or m/s] at the first sample, and a sentence on how they were found."""

    position: float
    rate: float
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
    found, rated = guess, _rated(begins, runs, width)
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


def _rated(begins: Sequence[Run], runs: Sequence[Run], width: int) -> tuple[Floats, Floats] | None:
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
    return min(max(count, FEWEST), len(run))


def _pace(run: Run) -> float:
    """How fast the run moves where it moves fast [rad/s or m/s]: 90th percentile of the way of one second."""
    later = np.interp(run.time + 1.0, run.time, run.position)
    return float(np.percentile(np.abs(later - run.position), 90))
