"""Runs simulated under one model, with steps halved until they no longer matter."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli import effects
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, Trajectory, simulate, step_for

Floats = NDArray[np.float64]
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
    """Whether what the sensor shows differs from the true position under this model."""
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
) -> Trajectory:
    """Simulate `runs` from `position` [rad or m] and `rate` [rad/s or m/s] at their first samples, (P, R) or (R,).

    `switch_offset` is the share of a sample interval by which commands act later than mid-interval. With `step`
    [s] that step is used as it is; without it the step is halved until positions settle to 0.01 degrees or cm, four
    times at most. Returns
    positions and rates (P, R, N), padded; not finite where the model runs away. Raises RunError as `make_batch`.
    """
    if step is not None:
        return _once(model, runs, position, rate, switch_offset, step)
    step = step_of(model, runs)
    best = _once(model, runs, position, rate, switch_offset, step)
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    most = max(MOST_STEPS, 4 * max(len(run) for run in runs))
    for _ in range(MOST_HALVINGS):
        step /= 2
        if longest / step > most:
            break
        finer = _once(model, runs, position, rate, switch_offset, step)
        both = np.isfinite(finer.position) & np.isfinite(best.position)
        moved = np.abs(np.where(both, finer.position, 0.0) - np.where(both, best.position, 0.0)).max()
        same_fate = bool(np.all(np.isfinite(finer.position) == np.isfinite(best.position)))
        best = finer
        if same_fate and model.dof.shown(moved) <= SETTLED:
            break
    return best


def _once(
    model: YawModel,
    runs: Sequence[Run],
    position: ArrayLike,
    rate: ArrayLike,
    switch_offset: float,
    step: float,
) -> Trajectory:
    batch = make_batch(runs, step, needed_signals(model))
    delay = switch_offset * batch.interval[None] if switch_offset else None
    position, rate = np.atleast_2d(position), np.atleast_2d(rate)
    with np.errstate(over="ignore", invalid="ignore"):  # a model that runs away is told of, not warned about
        return simulate(model, batch, start=Start(position, rate, switch_delay=delay))


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
