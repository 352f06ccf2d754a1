"""The state in which a simulation of a run begins: from rest where the run shows rest, else fitted locally."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.rollouts import has_sensor, roll, step_of
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.noise import heading_noise, slope
from automarine_cli.runs.run import Run
from automarine_cli.runs.steps import segments

Floats = NDArray[np.float64]

WINDOW = 1.0  # s over which a start is fitted
FEWEST = 5  # samples of such a fit, for slow loggers
SURE = 4.0  # standard errors
ENOUGH_REST = 10  # samples
SLOW = 0.02  # of the run's pace: drift that counts as standing still
NUDGE = 1e-4  # rad and rad/s, for derivatives
ROUNDS = 4


@dataclass(frozen=True)
class State:
    """Heading [rad] and yaw rate [rad/s] at the first sample, and a sentence on how they were found."""

    heading: float
    rate: float
    how: str


def rest_state(run: Run) -> State | None:
    """Heading of the rest with which the run begins, rate 0; None where it does not begin at rest.

    Rest is zero moment over two samples or more, without a slope in the heading beyond its noise.
    """
    first, stop, moment = segments(run.command)[0]
    count = stop - first
    if moment != 0 or count < 2:
        return None
    time, heading = run.time[:stop], run.heading[:stop]
    rate, error = slope(time, heading)
    doubt = SURE * error * heading_noise(run.time, run.heading)
    pace = _pace(run)
    if abs(rate) > doubt + SLOW * pace or (count < ENOUGH_REST and doubt > 0.25 * pace):
        return None
    return State(float(heading.mean()), 0.0, f"from rest: mean heading of {count} samples, rate 0")


def start_states(model: YawModel, runs: Sequence[Run], switch_offset: float = 0.0) -> list[State]:
    """The start of each run under `model`.

    A run that does not begin at rest starts with the heading and rate from which the model follows the first
    second (at least 5 samples) of the measured heading best, by least squares.
    """
    states = [rest_state(run) for run in runs]
    moving = [i for i, state in enumerate(states) if state is None]
    for i, state in zip(moving, _fitted(model, [runs[i] for i in moving], switch_offset) if moving else []):
        states[i] = state
    found = [state for state in states if state is not None]
    if not has_sensor(model):
        return found
    still = [i for i in range(len(runs)) if i not in moving]
    heads = aligned(model, [runs[i] for i in still], [found[i] for i in still]) if still else []
    for i, heading in zip(still, heads):
        found[i] = State(heading, 0.0, found[i].how)
    return found


def aligned(model: YawModel, runs: Sequence[Run], states: Sequence[State]) -> list[float]:
    """True headings [rad] at which the model's compass shows the headings of `states` at the first sample."""
    shown = np.array([state.heading for state in states])
    rate = np.array([state.rate for state in states])
    heading, begin = shown.copy(), [run.cut(0, 2) for run in runs]
    for _ in range(2 * ROUNDS):
        heading = heading + shown - roll(model, begin, heading, rate, step=np.inf).heading[0, :, 0]
    return [float(value) for value in np.where(np.isfinite(heading), heading, shown)]


def _fitted(model: YawModel, runs: Sequence[Run], switch_offset: float) -> list[State]:
    """Gauss-Newton on start heading and rate, all runs at once, from a line through the same samples."""
    begins = [run.cut(0, _window(run)) for run in runs]
    step = step_of(model, runs) / 2
    rates = np.array([slope(run.time, run.heading)[0] for run in begins])
    lead = np.array([run.time.mean() - run.time[0] for run in begins])
    guess = np.stack([np.array([run.heading.mean() for run in begins]) - rates * lead, rates])
    width = max(len(run) for run in begins)
    measured, seen = np.zeros((len(runs), width)), np.zeros((len(runs), width))
    for row, mask, run in zip(measured, seen, begins):
        row[: len(run)], mask[: len(run)] = run.heading, 1.0
    found = guess
    for _ in range(ROUNDS):
        heading = found[0] + np.array([[0.0], [NUDGE], [0.0]])
        rate = found[1] + np.array([[0.0], [0.0], [NUDGE]])
        shown = roll(model, begins, heading, rate, switch_offset, step).heading
        left = np.where(seen > 0, measured - shown[0], 0.0)
        slopes = np.where(seen > 0, (shown[1:] - shown[0]) / NUDGE, 0.0)
        square = np.einsum("irn,jrn->rij", slopes, slopes)
        side = np.einsum("irn,rn->ri", slopes, left)
        good = np.all(np.isfinite(square), axis=(1, 2)) & np.all(np.isfinite(side), axis=1)
        square = np.where(good[:, None, None], square, np.eye(2))
        move = np.linalg.solve(square + 1e-12 * np.eye(2), np.where(good[:, None], side, 0.0)[..., None])
        found = found + move[..., 0].T
    return [
        State(float(h), float(r), f"fitted: heading and rate that follow the first {len(run)} samples best")
        for h, r, run in zip(*found, begins)
    ]


def _window(run: Run) -> int:
    """Samples of the first second, 5 at least."""
    count = int(np.searchsorted(run.time, run.time[0] + WINDOW * (1 + 1e-9), side="right"))
    return min(max(count, FEWEST), len(run))


def _pace(run: Run) -> float:
    """How fast the run turns where it turns fast [rad/s]: 90th percentile of what one second turns."""
    later = np.interp(run.time + 1.0, run.time, run.heading)
    return float(np.percentile(np.abs(later - run.heading), 90))
