"""Least squares of forecasts: the parameters that predict the readings of the next seconds best, in any motion.

About once a second the model is restarted from the smoothed state and follows the logged commands, without a
disturbance, for `FORECAST_S`; its misses after each of these seconds are squared. What happens within a reading or
two hardly counts, so that neither the noise of a sensor nor a disturbance that answers the commands can take the
response away (Farina and Piroddi 2011, International Journal of Adaptive Control and Signal Processing 25:389).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import FitError
from automarine_cli.filters.kalman import Noises, carried, shown_channel, smoothed, targets_of
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit, fits_of
from automarine_cli.fits.mixed_model import jackknife
from automarine_cli.fits.optimise import Maximum, Point, maximise
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.simulation.batch import Channel

FORECAST_S = 5  # seconds of a forecast; misses are taken after each of them
EVERY = 1.0  # seconds between the starts of forecasts
STEERED_PACE = 3.0  # times as long and as rare are forecasts of what is steered: hulls answer slowly
FORECAST_ITERATIONS, LEFT_OUT_ITERATIONS = 40, 6  # of a search, and of one without a run, which begins near its end
SETTLED_DECREASE = 1e-3  # decrease of half the sum of squares still to be expected below which a search has converged
BLOCKS = 8  # pieces of a single run that are left out in turn
# Sum of weights 1 - |l|/H of lags l over that of squares, over H
OVERLAP = 3.0 * FORECAST_S / (2.0 * FORECAST_S**2 + 1.0)
RUNAWAY_RATIO = 1e3  # times the largest reading beyond which a forecast has run away


@dataclass(frozen=True)
class ForecastProblem:
    """Forecasts of a model on the course of `driven`, with the model's own parameters, from smoothed `states`
    (n, R, K + 1): of each of A windows the `run`, the `origin` node and the `unit` that is left out with it; `channels`
    are the C that are predicted, `target` (C, H, A) the nodes after each second, -1 where there is none. `scale` (C,)
    is what a channel misses by, which puts all on one scale."""

    driven: DrivenProblem
    noises: Noises
    states: Floats = field(repr=False)
    channels: tuple[Channel, ...] = field(repr=False)
    run: NDArray[np.int64] = field(repr=False)
    origin: NDArray[np.int64] = field(repr=False)
    unit: NDArray[np.int64] = field(repr=False)
    target: NDArray[np.int64] = field(repr=False)
    scale: Floats

    @property
    def count(self) -> int:
        return self.driven.parameters.of_model.stop

    @cached_property
    def free(self) -> NDArray[np.int64]:
        return self.driven.free[self.driven.free < self.count]

    @property
    def prior_information(self) -> Floats:
        """What is known beforehand of the free parameters, (f, f)."""
        return self.driven.prior_information[: len(self.free), : len(self.free)]

    @cached_property
    def measured(self) -> Floats:
        """Readings at the targets (C, H, A), not a number where there are none."""
        values = [of.values[self.run, at] for of, at in zip(self.channels, np.maximum(self.target, 0))]
        return np.where(self.target >= 0, np.array(values), np.nan)

    def misses(self, phi: Floats) -> Floats:
        """Forecast less measured (P, C, H, A) under phi (P, p), zero where nothing was measured."""
        theta = self.driven.parameters.natural(phi)[:, : self.count]
        path = carried(
            self.driven.model, self.driven.course, theta, self.noises, self.states, self.channels, self.run,
            self.origin, self.target.max(axis=(0, 1)),
        )  # fmt: skip
        place = np.maximum(self.target - self.origin, 0)
        window = np.arange(len(self.run))
        forecast = np.stack([of_channel[:, window, at] for of_channel, at in zip(path, place)], axis=1)
        most = RUNAWAY_RATIO * max(float(np.nanmax(np.abs(self.measured))), 1e-9)
        error = np.clip(np.nan_to_num(forecast - self.measured, nan=most), -most, most)
        return np.where(self.target >= 0, error, 0.0)

    def scaled(self, phi: Floats) -> Floats:
        """Misses on one scale (P, C, H, A), whose squares sum up to about the number of windows that do not overlap."""
        return np.asarray(self.misses(phi) / (FORECAST_S * self.scale[:, None, None]))

    def rms(self, phi: Floats) -> Floats:
        """Root mean square miss of each channel (C,) under phi (p,)."""
        have = (self.target >= 0).sum(axis=(1, 2))
        return np.asarray(np.sqrt((self.misses(phi[None])[0] ** 2).sum(axis=(1, 2)) / np.maximum(have, 1)))

    def some(self, windows: NDArray[np.bool_]) -> "ForecastProblem":
        return replace(
            self, run=self.run[windows], origin=self.origin[windows], unit=self.unit[windows],
            target=self.target[..., windows],
        )  # fmt: skip


@dataclass(frozen=True)
class ForecastFit:
    """Parameters of least misses: `phi` (p,) with those of what is random as they came, `left_out` (U, p) without each
    unit (a run, or a piece of a single one), `covariance` (p, p) by the scatter of the windows' slopes with the part
    `of_bounds` (see `covariance_within_bounds`), `by_unit` (U, p, p) what each unit says of phi, `forecasts` how many
    windows there are that do not overlap."""

    phi: Floats
    left_out: Floats
    covariance: Floats
    of_bounds: Floats
    by_unit: Floats
    forecasts: float
    at_bound: tuple[int, ...]
    iterations: int
    converged: bool

    def towards(self, rival: InnovationsFit) -> "ForecastFit":
        """Give the middle of this fit and another one to the same runs, with the mean of their errors' squares."""
        count = rival.parameters.of_model.stop
        phi, left_out, covariance = self.phi.copy(), self.left_out.copy(), self.covariance.copy()
        phi[:count] = 0.5 * (phi + rival.phi)[:count]
        left_out[:, :count] = 0.5 * (left_out + rival.left_out)[:, :count]
        covariance[:count, :count] = 0.5 * (covariance + rival.covariance)[:count, :count]
        of_bounds = 0.5 * (self.of_bounds + rival.of_bounds)
        return replace(self, phi=phi, left_out=left_out, covariance=covariance, of_bounds=of_bounds)


def forecast_problem(driven: DrivenProblem, phi: Floats) -> ForecastProblem:
    """Forecasts on the course of `driven`, from states that are smoothed under phi (p,).

    Raises FitError where no run is long enough.
    """
    course, count = driven.course, driven.parameters.of_model.stop
    theta = driven.parameters.natural(phi)
    noises = driven.noises(theta[None])
    followed = smoothed(driven.model, course.unthinned, theta[:count], noises)
    assert followed.states is not None
    states = followed.states[:, 0]
    states[[*followed.places.pushed, followed.places.gain]] = 0.0
    channels = _predicted(driven)
    time, observed = course.time, np.any([of.seen for of in channels], axis=0)
    pace = STEERED_PACE if course.moment_unit == STEERED else 1.0
    starts = [(r, int(i)) for r in range(len(course.names)) for i in _origins(time[r], observed[r], pace * EVERY)]
    run, origin = np.array(starts, dtype=np.int64).reshape(-1, 2).T
    seconds = pace * np.arange(1.0, FORECAST_S + 1.0)
    target = np.array([[targets_of(of.seen, time, run, origin, h) for h in seconds] for of in channels])
    have: NDArray[np.bool_] = np.any(target >= 0, axis=(0, 1))
    if not have.any():
        raise FitError("no run is long enough to forecast a second of it; give longer runs")
    unit = run if len(course.names) > 1 else (np.arange(len(run)) * BLOCKS) // len(run)
    every = ForecastProblem(driven, noises, states, channels, run, origin, unit, target, np.ones(len(channels)))
    return every.some(have)


def _predicted(driven: DrivenProblem) -> tuple[Channel, ...]:
    """Every position that is read, and in place of others their velocities."""
    course = driven.course
    names, places = [of.quantity for of in course.channels], course.motion.positions
    main = [c for c, of in enumerate(course.channels) if not of.velocity or places[of.dof] not in names]
    return tuple(shown_channel(course, c) for c in main)


def _origins(time: Floats, observed: NDArray[np.bool_], every: float) -> NDArray[np.int64]:
    readings = np.flatnonzero(observed)
    if len(readings) < 2:
        return readings[:0]
    clock = np.arange(time[readings[0]], time[readings[-1]], every)
    return np.unique(readings[np.minimum(np.searchsorted(time[readings], clock), len(readings) - 1)])


def fit_forecasts(driven: DrivenProblem, phi: Floats, starts: Floats) -> ForecastFit:
    """Fit the model's parameters from the best of `starts` (S, p) in theta, with states smoothed under phi (p,).

    Raises FitError where no run is long enough, or no start leads anywhere.
    """
    problem = forecast_problem(driven, phi)
    begins = np.clip(driven.parameters.search(starts), *driven.parameters.limits.T)
    begins[:, problem.count :] = phi[problem.count :]
    problem = replace(problem, scale=np.maximum(problem.rms(phi), 1e-12))
    costs = (problem.scaled(begins) ** 2).sum(axis=(1, 2, 3))
    phi = _descend(problem, begins[int(np.argmin(costs))], FORECAST_ITERATIONS).point.phi
    problem = replace(problem, scale=np.maximum(problem.rms(phi), 1e-12))
    end = _descend(problem, phi, FORECAST_ITERATIONS)
    phi, units = end.point.phi, int(problem.unit.max()) + 1
    left_out = np.tile(phi, (units, 1))
    for unit, row in enumerate(left_out):
        windows = problem.unit != unit
        if windows.any() and not windows.all():
            row[:] = _descend(problem.some(windows), phi, LEFT_OUT_ITERATIONS).point.phi
    at_bound, likely, of_bounds = end.point.spread(problem.free, driven.parameters)
    likely = likely - of_bounds
    covariance, inside = _by_pieces(problem, phi, likely), np.diagonal(likely) > 0
    grown = float(np.median(np.diagonal(covariance)[inside] / np.diagonal(likely)[inside])) if inside.any() else 1.0
    point = replace(end.point, gradient=end.point.gradient / grown, curvature=end.point.curvature / grown)
    of_bounds = point.spread(problem.free, driven.parameters)[2]  # of windows that overlap, as the others' errors
    by_unit = np.zeros((units, *covariance.shape))
    by_unit[:, problem.free[:, None], problem.free] = end.point.data + problem.prior_information / units
    places = tuple(np.flatnonzero(at_bound[: problem.count]).tolist())
    forecasts = len(problem.run) / FORECAST_S
    return ForecastFit(
        phi, left_out, covariance + of_bounds, of_bounds, by_unit, forecasts, places, end.iterations, end.converged
    )


def _by_pieces(problem: ForecastProblem, phi: Floats, bread: Floats) -> Floats:
    """Covariance (p, p) of phi (p,) by leaving out, in one linear step from the inverse curvature `bread` (p, p), each
    piece of a run that FORECAST_S windows reach over: the jackknife of moving blocks, Künsch (1989), Annals of
    Statistics 17:1217. Scaled so that what is alike by as much as windows overlap counts whole."""
    likely, (errors, by) = bread[np.ix_(problem.free, problem.free)], _slopes(problem, phi)
    spread = likely @ problem.prior_information @ likely
    for run in range(int(problem.run.max()) + 1):
        of_run = problem.run == run
        begin = np.subtract.outer(np.arange(of_run.sum()), np.arange(1 - FORECAST_S, of_run.sum()))
        inside = ((begin >= 0) & (begin < FORECAST_S)).astype(float)
        slope = np.einsum("cha,fcha,ab->bf", errors[..., of_run], by[..., of_run], inside)
        curves = np.einsum("fcha,gcha,ab->bfg", by[..., of_run], by[..., of_run], inside)
        remaining = np.eye(len(likely)) - curves @ likely
        moved = likely @ np.linalg.pinv(remaining) @ slope[..., None]
        spread += np.einsum("bf,bg->fg", moved[..., 0], moved[..., 0]) * OVERLAP
    covariance = np.zeros_like(bread)
    covariance[np.ix_(problem.free, problem.free)] = spread
    return covariance


def _slopes(problem: ForecastProblem, phi: Floats) -> tuple[Floats, Floats]:
    """Scaled misses (C, H, A) under phi (p,) and their derivatives by the free parameters, (f, C, H, A)."""
    steps = problem.driven.steps(phi)[: len(problem.free)]
    moved = np.tile(phi, (1 + len(steps), 1))
    moved[np.arange(1, len(moved)), problem.free] += steps
    errors = problem.scaled(moved)
    return errors[0], (errors[1:] - errors[0]) / steps[:, None, None, None]


def _descend(problem: ForecastProblem, phi: Floats, iterations: int) -> Maximum[Floats]:
    """Search from phi (p,) within the bounds; the data of a point are the curvatures of the units there (U, f, f)."""
    driven, free = problem.driven, problem.free

    def evaluate(phis: Sequence[Floats], _: Sequence[int]) -> list[Point[Floats]]:
        return [point(phi) for phi in phis]

    def point(phi: Floats) -> Point[Floats]:
        errors, by = _slopes(problem, phi)
        curves = np.zeros((int(problem.unit.max()) + 1, len(free), len(free)))
        np.add.at(curves, problem.unit, np.einsum("fcha,gcha->afg", by, by))
        value = float(driven.prior(phi) - 0.5 * (errors**2).sum())
        gradient = driven.prior_gradient(phi)[: len(free)] - np.einsum("cha,fcha->f", errors, by)
        return Point(phi, value, gradient, curves.sum(axis=0) + problem.prior_information, curves)

    limits = driven.parameters.limits
    (end,) = maximise(evaluate, [phi], [free], [limits], settled=SETTLED_DECREASE, iterations=iterations)
    return end


def with_chance(problems: Sequence[DrivenProblem], fits: Sequence[ForecastFit]) -> list[InnovationsFit | None]:
    """The fits as diagnosis, plans and reports ask for them: what is random is fitted by innovations beside the model's
    parameters, which stay as they are, side by side. None where no filter follows the runs."""
    thetas = [problem.parameters.natural(fit.phi) for problem, fit in zip(problems, fits)]
    fixed = [
        replace(problem, parameters=problem.parameters.fixed_at(theta[: problem.parameters.of_model.stop]))
        for problem, theta in zip(problems, thetas)
    ]
    chances = fits_of(fixed, [theta[None] for theta in thetas], brief=True)
    return [chance and _beside_chance(of, fit, chance) for of, fit, chance in zip(problems, fits, chances)]


def _beside_chance(driven: DrivenProblem, fit: ForecastFit, chance: InnovationsFit) -> InnovationsFit:
    """A fit of a model's parameters with that of what is random beside them."""
    count, runs = driven.parameters.of_model.stop, len(driven.course.names)
    phi = np.append(fit.phi[:count], chance.phi[count:])
    theta = np.append(driven.parameters.natural(fit.phi)[:count], chance.theta[count:])
    left_out, covariance, by_run = chance.left_out.copy(), chance.covariance.copy(), chance.information.copy()
    of_bounds, of_model = chance.of_bounds.copy(), np.s_[:count, :count]
    covariance[of_model], of_bounds[of_model] = fit.covariance[of_model], fit.of_bounds[of_model]
    if runs > 1:
        left_out[:, :count] = fit.left_out[:, :count]
        by_run[:, :count, :count] = fit.by_unit[:, :count, :count]
    else:
        left_out[:, :count] = fit.phi[:count]
        between = np.diagonal(jackknife(fit.left_out[:, :count]))
        inside = (covariance - of_bounds)[of_model]
        likely = np.diagonal(inside)
        grow = np.sqrt(np.maximum(np.divide(between, likely, out=np.ones(count), where=likely > 0), 1.0))
        covariance[of_model] = inside * np.outer(grow, grow) + of_bounds[of_model]
        by_run[0, :count, :count] = fit.by_unit.sum(axis=0)[:count, :count]
    density = driven.follow(left_out).log_density if runs > 1 else chance.density[None]
    return replace(
        chance, parameters=driven.parameters, theta=theta, phi=phi, covariance=covariance, of_bounds=of_bounds,
        left_out=left_out, predictive=np.where(np.isfinite(density), density, -1e9)[np.arange(runs), np.arange(runs)],
        at_bound=tuple(sorted({*fit.at_bound, *(i for i in chance.at_bound if i >= count)})), information=by_run,
        converged=fit.converged and chance.converged, iterations=fit.iterations + chance.iterations,
        forecasts=fit.forecasts,
    )  # fmt: skip
