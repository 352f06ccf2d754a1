"""The damped search of all fits whose likelihood has slopes: Levenberg and Marquardt's, within bounds, from several
starts at a time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from automarine_cli.fits.linear_mixed import bounded_solution, covariance_of
from automarine_cli.quantities import Floats

MIN_DAMPING, MAX_DAMPING = 1e-4, 1e3  # shares of the curvature that are added to it
EASED, RAISED = 0.1, 30.0  # factors of the damping after a step that was taken at once, and after one that led nowhere
LEAST_GAIN = 0.1  # that a step has to make, as a share of the gain at which a search has converged
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

    def spread(self, free: NDArray[np.int64], limits: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """Say which parameters (p,) stand at one of their `limits` (p, 2), and give the covariance (p, p) of the `free`
        others by the curvature."""
        at_bound = (self.phi - limits[:, 0] < 1e-9) | (limits[:, 1] - self.phi < 1e-9)
        inside, covariance = ~at_bound[free], np.zeros((len(self.phi), len(self.phi)))
        covariance[np.ix_(free[inside], free[inside])] = covariance_of(self.curvature[np.ix_(inside, inside)])
        return at_bound, covariance


@dataclass(frozen=True)
class Maximum(Generic[Data]):
    """Where a search ended."""

    point: Point[Data]
    iterations: int
    converged: bool


def maximise(
    evaluate: Callable[[Floats, NDArray[np.int64]], Sequence[Point[Data]]], starts: Floats, free: NDArray[np.int64],
    limits: Floats, *, settled: float, iterations: int, shares: Sequence[float] = (1.0,),
) -> list[Maximum[Data]]:  # fmt: skip
    """Search from each of `starts` (S, p), over the parameters `free` (f,) within `limits` (p, 2); in the order of the
    starts.

    `evaluate` takes points (P, p) of all searches together, and which search (P,) each belongs to. A search has
    converged where a gain of less than `settled` is to be expected, and takes so many steps at most. `shares` are
    multiples of the damping that are tried together.
    """
    searches = np.arange(len(starts))
    points = list(evaluate(starts, searches))
    damping, steps = np.full(len(starts), MIN_DAMPING), np.zeros(len(starts), dtype=int)
    converged, active = np.zeros(len(starts), dtype=bool), np.isfinite([point.value for point in points])
    at_once = np.ones(len(starts), dtype=bool)
    while (active & (steps < iterations)).any():
        trials, expected = dict[int, Floats](), dict[int, float]()
        for i in searches[active & (steps < iterations)].tolist():
            trials[i], expected[i] = _trials(points[i], free, limits, damping[i] * np.array(shares))
            converged[i], active[i] = expected[i] < settled, expected[i] >= settled
        tried = {i: trials[i] for i in trials if active[i]}
        if not tried:
            break
        reached = evaluate(np.concatenate([*tried.values()]), np.repeat([*tried], len(shares)))
        for k, i in enumerate(tried):
            of_search = reached[k * len(shares) : (k + 1) * len(shares)]
            best = int(np.argmax([point.value for point in of_search]))
            if of_search[best].value > points[i].value + LEAST_GAIN * settled:
                points[i], steps[i] = of_search[best], steps[i] + 1
                damping[i] = max(damping[i] * (EASED if best == 0 and at_once[i] else shares[best]), MIN_DAMPING)
                at_once[i] = True
            elif damping[i] < MAX_DAMPING:
                damping[i] *= max(RAISED, 10.0 * shares[-1])
                at_once[i] = False
            else:
                converged[i], active[i] = expected[i] < NEARLY_GAIN, False
    return [Maximum(points[i], int(steps[i]), bool(converged[i])) for i in searches]


def _trials(point: Point[Data], free: NDArray[np.int64], limits: Floats, dampings: Floats) -> tuple[Floats, float]:
    """Where steps of these dampings (T,) lead, (T, p), and the gain that is expected of the first; not a number where
    the slopes are none."""
    gradient, curvature, trials = point.gradient, point.curvature, np.tile(point.phi, (len(dampings), 1))
    if not (np.isfinite(gradient).all() and np.isfinite(curvature).all()):
        return trials, np.nan
    for trial, damping in zip(trials, dampings):
        damped = curvature + damping * np.diag(np.diagonal(curvature) + 1e-12)
        trial[free] = bounded_solution(damped, gradient + damped @ point.phi[free], limits[free])
    step = trials[0, free] - point.phi[free]
    return trials, float(gradient @ step - 0.5 * step @ curvature @ step)
