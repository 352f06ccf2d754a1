"""The damped search of all fits whose likelihood has slopes: Levenberg and Marquardt's, within bounds, from several
starts at a time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from automarine_cli.fits.linear_mixed import bounded_solution, covariance_within_bounds
from automarine_cli.models.parameter import Parameters
from automarine_cli.quantities import Floats

MIN_DAMPING, MAX_DAMPING = 1e-4, 1e3  # shares of the curvature that are added to it
EASED, RAISED = 0.1, 30.0  # factors of the damping after a step that was taken at once, and after one that led nowhere
MIN_STEP_SHARE = 0.1  # that a step has to make, as a share of the gain at which a search has converged
NEARLY_GAIN = 1.0  # gain still to be expected below which a search that is stuck counts as converged

Data = TypeVar("Data")


@dataclass(frozen=True)
class Point(Generic[Data]):
    """A point phi (p,) of a search: the value to be maximised, its gradient (f,) and its curvature (f, f) by the free
    parameters, and the `data` that these were made of."""

    phi: Floats
    value: float
    gradient: Floats
    curvature: Floats
    data: Data

    def spread(self, free: NDArray[np.int64], parameters: Parameters) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Say which of the `parameters` (p,) stand at a bound, and give by the curvature the covariance (p, p) of the
        others among those that are `free`, and the part of it that is owed to what a bound stopped."""
        limits = parameters.limits
        at_bound = (self.phi - limits[:, 0] < 1e-9) | (limits[:, 1] - self.phi < 1e-9)
        return at_bound, *covariance_within_bounds(self.curvature, self.gradient, free, at_bound, parameters.log)


@dataclass(frozen=True)
class Maximum(Generic[Data]):
    """Where a search ended."""

    point: Point[Data]
    iterations: int
    converged: bool


def maximise(
    evaluate: Callable[[Sequence[Floats], Sequence[int]], Sequence[Point[Data]]], starts: Sequence[Floats],
    free: Sequence[NDArray[np.int64]], limits: Sequence[Floats], *, settled: float, iterations: int,
) -> list[Maximum[Data]]:  # fmt: skip
    """Search from each of `starts` (p,), over its parameters `free` (f,) within its `limits` (p, 2); in the order of
    the starts.

    `evaluate` takes a point (p,) of each of some searches together, and which search each belongs to. A search has
    converged where a gain of less than `settled` is to be expected, and takes so many steps at most.
    """
    searches = np.arange(len(starts))
    points = list(evaluate(starts, searches.tolist()))
    damping, steps = np.full(len(starts), MIN_DAMPING), np.zeros(len(starts), dtype=int)
    converged, active = np.zeros(len(starts), dtype=bool), np.isfinite([point.value for point in points])
    at_once = np.ones(len(starts), dtype=bool)  # whether the step before was taken as it was tried first
    while (active & (steps < iterations)).any():
        trials, expected = dict[int, Floats](), dict[int, float]()
        for i in searches[active & (steps < iterations)].tolist():
            trials[i], expected[i] = _trial(points[i], free[i], limits[i], damping[i])
            converged[i], active[i] = expected[i] < settled, expected[i] >= settled
        tried = {i: trials[i] for i in trials if active[i]}
        if not tried:
            break
        for i, reached in zip(tried, evaluate([*tried.values()], [*tried])):
            if reached.value > points[i].value + MIN_STEP_SHARE * settled:
                points[i], steps[i] = reached, steps[i] + 1
                damping[i] = max(damping[i] * (EASED if at_once[i] else 1.0), MIN_DAMPING)
                at_once[i] = True
            elif damping[i] < MAX_DAMPING:
                damping[i] *= RAISED
                at_once[i] = False
            else:
                converged[i], active[i] = expected[i] < NEARLY_GAIN, False
    return [Maximum(points[i], int(steps[i]), bool(converged[i])) for i in searches]


@np.errstate(over="ignore", invalid="ignore")  # where slopes are as large as numbers go
def _trial(point: Point[Data], free: NDArray[np.int64], limits: Floats, damping: float) -> tuple[Floats, float]:
    """Where a step of this damping leads, (p,), and the gain that is expected of it; not a number where the slopes are
    none."""
    gradient, curvature, trial = point.gradient, point.curvature, point.phi.copy()
    if not (np.isfinite(gradient).all() and np.isfinite(curvature).all()):
        return trial, np.nan
    damped = curvature + damping * np.diag(np.diagonal(curvature) + 1e-12)
    trial[free] = bounded_solution(damped, gradient + damped @ point.phi[free], limits[free])
    step = trial[free] - point.phi[free]
    return trial, float(gradient @ step - 0.5 * step @ curvature @ step)
