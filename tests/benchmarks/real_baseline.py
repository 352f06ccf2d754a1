"""What a fitted model has to beat: plain least squares of the same structure, a constant rate, a constant position.

Written in numpy and scipy alone, apart from the library's fits: of the library only the cleaned runs are used. From an
anchor every second on, the state known by then (a parabola over the second before; the rate by the gyro or speed log
where there is one) is taken ahead by

    I v' = F - k_rr |v| v - k_r v (+ a constant force),

driven by the logged commands, and the parameters are those that miss the measured positions least at one horizon.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.polynomial.polynomial import polyfit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

HORIZONS = (2.0, 5.0, 15.0)  # s
EVERY = 1.0  # s between anchors
BEFORE = 1.0  # s before an anchor from which its state is told
FEWEST = 4  # readings of a line or parabola
STEP = 0.1  # s, of the simulation
TIME_CONSTANTS = (0.5, 3.0, 20.0)  # s, where searches begin
SPAN = 12.0  # a parameter may leave its start by this factor's logarithm


@dataclass(frozen=True)
class Anchors:
    """A states, from which predictions begin: `run` and `sample` say where, `position` and `rate` what was known there
    [base units], all (A,); `force` (A, M) the mean command over each `STEP` after it, NaN past the run's end;
    `reached` (A, H) the position measured after each of `HORIZONS`, NaN past the run's end."""

    run: NDArray[np.int64]
    sample: NDArray[np.int64]
    position: Floats
    rate: Floats
    force: Floats
    reached: Floats


def anchors_of(runs: Sequence[Run]) -> Anchors:
    """Anchors every second of all runs that have the shortest horizon left."""
    return Anchors(*map(np.array, zip(*((i, *anchor) for i, run in enumerate(runs) for anchor in _anchors(run)))))


def _anchors(run: Run) -> Iterator[tuple[int, float, float, Floats, Floats]]:
    clock = np.arange(run.time[0] + BEFORE, run.time[-1] - HORIZONS[0], EVERY)
    for k in np.unique(np.searchsorted(run.time, clock)):
        ends = run.time[k] + np.array(HORIZONS)
        if ends[0] <= run.time[-1]:
            reached = np.where(ends <= run.time[-1], np.interp(ends, run.time, run.position), np.nan)
            grid, force = mean_force(run, k, run.command)
            yield int(k), *causal_state(run, k), np.where(grid <= run.time[-1], force, np.nan), reached


def mean_force(run: Run, k: int, command: Floats) -> tuple[Floats, Floats]:
    """Ends of the STEPs after sample `k` up to the last horizon, and the mean of a command (N,) over each, (M,)."""
    impulse = np.concatenate([[0.0], np.cumsum(command[:-1] * np.diff(run.time))])
    grid = run.time[k] + STEP * np.arange(round(HORIZONS[-1] / STEP) + 1)
    return grid[1:], np.diff(np.interp(grid, run.time, impulse)) / STEP


def causal_state(run: Run, k: int) -> tuple[float, float]:
    """Position and rate at sample `k` from the second up to it."""
    first = min(int(np.searchsorted(run.time, run.time[k] - BEFORE)), max(k - FEWEST, 0))
    time, shown = run.time[first : k + 1] - run.time[k], run.position[first : k + 1]
    line = polyfit(time, shown, min(2, len(time) - 1))
    read = run.extras.get(run.dof.velocity)
    if read is None:
        return float(line[0]), float(line[1])
    read = read[first : k + 1]
    new = np.isfinite(read) & (np.diff(read, prepend=np.nan) != 0)  # a held value is one reading
    if run.summed_up or new.sum() < FEWEST:
        finite = read[np.isfinite(read)]
        return float(shown[-1]), float(finite[-1] if len(finite) else line[1])
    return float(line[0]), float(polyfit(time[new], read[new], 1)[0])


@dataclass(frozen=True)
class Plain:
    """Inertia, drag by model `number` and a constant force [base units] of one least-squares fit."""

    number: str
    inertia: float
    linear: float
    quadratic: float
    constant: float = 0.0

    def ahead(self, anchors: Anchors) -> Floats:
        """Predicted positions at the horizons (A, H): each step is exact for the drag that it begins with."""
        position, rate, shown = anchors.position.copy(), anchors.rate.copy(), []
        for i in range(anchors.force.shape[1]):
            fade = np.maximum((self.quadratic * np.abs(rate) + self.linear) / self.inertia, 1e-12)
            steady = (anchors.force[:, i] + self.constant) / self.inertia / fade
            left = -np.expm1(-fade * STEP)
            position = position + steady * STEP + (rate - steady) * left / fade
            rate = rate + (steady - rate) * left
            shown.append(position)
        return np.stack([shown[round(h / STEP) - 1] for h in HORIZONS], axis=1)


def fit_plain(anchors: Anchors, number: str, horizon: float, constant: bool = False) -> Plain:
    """The parameters that miss the positions `horizon` seconds ahead least, from several starts."""
    column = HORIZONS.index(horizon)
    use = np.isfinite(anchors.reached[:, column])
    if not use.any():  # the runs are shorter
        return Plain(number, *[float("nan")] * 3)
    last = round(horizon / STEP)
    some = Anchors(*(getattr(anchors, each.name)[use] for each in fields(anchors)))
    some.force[:, last:] = 0.0
    push = float(np.nanmax(np.abs(anchors.force))) or 1.0
    force, pace = _rms(some.force[:, :last]) or 1.0, _rms(some.rate) or 1.0
    drags = {"1": 1, "2": 2, "3": 1}[number]

    def model(z: Floats) -> Plain:
        inertia, *drag = np.exp(z[: 1 + drags])
        linear, quadratic = {"1": (drag[0], 0.0), "2": tuple(drag), "3": (0.0, drag[0])}[number][:2]
        return Plain(number, inertia, linear, quadratic, push * z[-1] if constant else 0.0)

    def misses(z: Floats) -> Floats:
        return np.asarray(model(z).ahead(some) - some.reached)[:, column]

    solutions = []
    for time_constant in TIME_CONSTANTS:
        linear, quadratic = force / pace, force / pace**2
        drag = {"1": [linear], "2": [quadratic / 2, linear / 2][::-1], "3": [quadratic]}[number]
        begin = np.append(np.log([time_constant * linear, *drag]), [0.0] * constant)
        solutions.append(least_squares(misses, begin, bounds=(begin - SPAN, begin + SPAN), x_scale="jac"))
    return model(min(solutions, key=lambda solution: float(solution.cost)).x)


def by_horizon(errors: Floats) -> list[float]:
    """Root mean square of errors (A, H) at each horizon, of those that were measured."""
    return [_rms(column[np.isfinite(column)]) for column in errors.T]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")
