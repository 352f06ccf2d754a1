"""Maximum likelihood of driven and disturbed runs by the innovations of a filter (see filters/kalman.py).

Each reading is compared with what all readings before it let expect; that holds for commands that answer the readings
too, as those of a controller do. Everything random has its size estimated with the model: the disturbing acceleration
and its time constant, noise in proportion to the thrust, scatter of the thrust from run to run, noise of each sensor.
Fisher scoring on innovations and their variances (Ljung 1999, System Identification, chapter 7; Åström 1980, Automatica
16:551), damped; differences of all parameters are filtered together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import MAX_Z, FilterResult, Noises, follow, follow_all
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.mixed_model import MixedFit, Outcome
from automarine_cli.fits.optimise import Maximum, Point, maximise
from automarine_cli.models.model import COMMAND_DELAY, MAX_DELAY_S, MAX_EARLY_HALF_SAMPLES, Model
from automarine_cli.models.parameter import NUISANCE, Parameter, Parameters, Prior, Priors
from automarine_cli.models.store import Sensor
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import ChannelChoice
from automarine_cli.runs.run import Run, position_noise

DERIVATIVE_STEP = 1e-5  # share of a parameter by which it is moved for its derivative
MIN_SIZE = 1e-4  # smallest disturbance, as a share of the acceleration that the largest command gives


@dataclass(frozen=True)
class DrivenProblem:
    """Likelihood of a model on a course. theta is the model's parameters, then those of what is random, in the order
    that `noises` takes them."""

    model: Model
    course: Course
    parameters: Parameters

    def informed(self, priors: Priors) -> "DrivenProblem":
        return replace(self, parameters=self.parameters.informed(priors))

    @property
    def free(self) -> NDArray[np.int64]:
        return self.parameters.free

    @cached_property
    def prior_information(self) -> Floats:
        """What the prior says of the free parameters, (f, f)."""
        return self.parameters.prior[1][np.ix_(self.free, self.free)]

    def prior_gradient(self, phi: Floats) -> Floats:
        """Slope of the prior's log density by the free parameters at phi (p,), (f,)."""
        mean, precision = self.parameters.prior
        return np.asarray(-(precision @ (phi - mean))[self.free])

    def noises(self, theta: Floats) -> Noises:
        """Sizes of what is random under full theta (P, p)."""
        values, dofs = dict(zip(self.parameters.names, theta.T)), self.course.motion.dofs
        size, time, thrust = (
            np.array([values[f"{dof.name}.{kind}"] for dof in dofs])
            for kind in ("disturbance", "disturbance-time", "thrust-noise")
        )
        reading = np.array([values[f"noise.{channel.quantity}"] for channel in self.course.channels])
        spreads = {name: of_runs for name, of_runs in values.items() if name.endswith(".spread")}
        per_run = {name.partition(".")[0]: of_runs for name, of_runs in spreads.items()}
        return Noises(size, time, thrust, values["gain-scatter"], values[COMMAND_DELAY], reading, per_run)

    def follow(self, phi: Floats, keep: bool = False, course: Course | None = None) -> FilterResult:
        """Filter the runs under phi (P, p), or those of another course."""
        theta = self.parameters.natural(phi)
        return follow(self.model, course or self.course, theta[:, self.parameters.of_model], self.noises(theta), keep)

    def unexplained(self, phi: Floats) -> float:
        """Log density that the runs would gain under phi (p,) if all that their readings foretell were explained."""
        followed = self.follow(phi[None])
        channels = zip(followed.innovation[:, 0], followed.variance[:, 0])
        return sum(whitening_gain(*channel, self.course.time) for channel in channels)

    def value(self, phi: Floats) -> Floats:
        """Log density of all runs with the prior, (P,); minus infinity where a filter diverges."""
        return values_of([self], [phi])[0]

    def prior(self, phi: Floats) -> Floats:
        """Log density of phi (..., p) before the data, up to a constant."""
        mean, precision = self.parameters.prior
        return np.asarray(-0.5 * np.einsum("...i,ij,...j->...", phi - mean, precision, phi - mean))

    def steps(self, phi: Floats) -> Floats:
        """By how much each free parameter is moved for its derivative, (f,)."""
        size = np.where(self.parameters.log, 1.0, np.maximum(np.abs(phi), self.parameters.steps))
        return DERIVATIVE_STEP * size[self.free]

    def moved(self, phi: Floats) -> Floats:
        """phi (p,) itself and with each free parameter moved by its step, (1 + f, p)."""
        moved = np.tile(phi, (1 + len(self.free), 1))
        moved[np.arange(1, len(moved)), self.free] += self.steps(phi)
        return moved

    def slopes(self, phi: Floats) -> list["Slopes"]:
        """Each run's gradient and information by the free parameters at each phi (P, p), all filtered together."""
        return slopes_of([self] * len(phi), list(phi))

    @np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
    def point(self, phi: Floats, slopes: "Slopes") -> "Point[Slopes]":
        """Give a point of the search: log density of the runs of `slopes` with the prior, minus infinity where a filter
        or its curvature diverges, and its slope and curvature."""
        value = float(slopes.density.sum() + self.prior(phi))
        gradient = slopes.gradient.sum(axis=0) + self.prior_gradient(phi)
        curvature = slopes.information.sum(axis=0) + self.prior_information
        finite = np.isfinite(value) and np.isfinite(curvature).all()
        return Point(phi, value if finite else -np.inf, gradient, curvature, slopes)


def filtered(problems: Sequence[DrivenProblem], phis: Sequence[Floats]) -> list[FilterResult]:
    """Filter the runs, which are the same, under phi (P, p) of each of several problems."""
    if not problems:
        return []
    thetas = [problem.parameters.natural(phi) for problem, phi in zip(problems, phis)]
    of_models = [theta[:, problem.parameters.of_model] for problem, theta in zip(problems, thetas)]
    noises = [problem.noises(theta) for problem, theta in zip(problems, thetas)]
    return follow_all([problem.model for problem in problems], problems[0].course, of_models, noises)


def values_of(problems: Sequence[DrivenProblem], phis: Sequence[Floats]) -> list[Floats]:
    """Log density of all runs with the prior under phi (P, p) of each of several problems, (P,); minus infinity where a
    filter diverges."""
    followed = zip(problems, phis, filtered(problems, phis))
    values = [runs.log_density.sum(axis=1) + problem.prior(phi) for problem, phi, runs in followed]
    return [np.where(np.isfinite(density), density, -np.inf) for density in values]


def slopes_of(problems: Sequence[DrivenProblem], phis: Sequence[Floats]) -> list["Slopes"]:
    """Each run's gradient and information by the free parameters of each of several problems at its phi (p,)."""
    followed = filtered(problems, [problem.moved(phi) for problem, phi in zip(problems, phis)])
    steps = [problem.steps(phi) for problem, phi in zip(problems, phis)]
    return [Slopes.of([innovations_of(runs, slice(None), step)]) for runs, step in zip(followed, steps)]


@dataclass(frozen=True)
class Innovations:
    """Innovations `error` (C, R, K), their `variance`, one where nothing was `observed`, the derivatives of both by
    some parameters, (C, f, R, K), none where a filter runs away, the log density of each run (R,) and its log gain
    (R,)."""

    error: Floats
    variance: Floats
    observed: NDArray[np.bool_]
    by: Floats
    spread: Floats
    density: Floats
    gain: Floats


@np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
def innovations_of(
    runs: FilterResult, part: slice, steps: Floats | float, base: Innovations | None = None
) -> Innovations:
    """Innovations at a point, and how they change per step from there to the parameter sets `part` of what was
    filtered. The point is that of `base` if it is given, else the first of them."""
    error, variance = runs.innovation[:, part], runs.variance[:, part]
    if base is None:
        observed = variance[:, 0] > 0
        base = Innovations(
            error[:, 0], np.where(observed, variance[:, 0], 1.0), observed, error[:, :0], error[:, :0],
            runs.log_density[part][0], runs.gain[part][0],
        )  # fmt: skip
        error, variance = error[:, 1:], variance[:, 1:]
    step = np.broadcast_to(steps, error.shape[1])[:, None, None]
    by = np.where(base.observed[:, None], (error - base.error[:, None]) / step, 0.0)
    spread = np.where(base.observed[:, None], (variance - base.variance[:, None]) / step, 0.0)
    sane = np.isfinite(np.sum(by + spread, axis=(0, 2, 3), keepdims=True))[0]
    return replace(base, by=np.where(sane, by, 0.0), spread=np.where(sane, spread, 0.0))


@dataclass(frozen=True)
class Slopes:
    """Each run's log density (R,), its gradient (R, f) and Fisher information (R, f, f) by f parameters; and its log
    gain (R,)."""

    density: Floats
    gradient: Floats
    information: Floats
    gain: Floats

    def without(self, run: int) -> "Slopes":
        remaining = np.arange(len(self.density)) != run
        return Slopes(*(part[remaining] for part in (self.density, self.gradient, self.information, self.gain)))

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
    def of(cls, parts: Sequence[Innovations]) -> "Slopes":
        """From innovations about one point, with derivatives by different parameters, in their order."""
        base = parts[0]
        by, spread = (np.concatenate(list(blocks), axis=1) for blocks in zip(*((p.by, p.spread) for p in parts)))
        root = np.sqrt(base.variance)
        z = np.where(base.observed, base.error / root, 0.0)
        bounded = np.clip(z, -MAX_Z, MAX_Z)
        columns, spreads = by / root[:, None], spread / base.variance[:, None]
        gradient = -np.einsum("crk,cfrk->rf", bounded, columns)
        gradient += 0.5 * np.einsum("crk,cfrk->rf", np.where(base.observed, bounded * z - 1.0, 0.0), spreads)
        c, f, r, k = columns.shape
        flat, wide = (np.moveaxis(x, 2, 0).swapaxes(1, 2).reshape(r, f, c * k) for x in (columns, spreads))
        information = flat @ flat.swapaxes(1, 2) + 0.5 * wide @ wide.swapaxes(1, 2)
        return cls(base.density, gradient, information, base.gain)


def randomness(
    course: Course, accelerations: Sequence[float], varying: Sequence[str], quiet: bool, latest: float = MAX_DELAY_S
) -> tuple[Parameter, ...]:
    """What is random on a course, in the order of `DrivenProblem.noises`.

    `accelerations` (D,) are those that the largest commands give. A `quiet` course has no disturbance and no unsteady
    thrust: the limit of a pool. Commands act at most `latest` [s] after the middle of the sample interval in which
    they changed; where that is 0, an effect of the model says how late they are.
    """
    chances: list[Parameter] = []

    def add(name: str, lower: float, upper: float, median: float, spread: float) -> None:
        """Add a size with a log-normal prior of this spread of the logarithm."""
        prior = Prior(median, spread * median)
        chances.append(Parameter(name, median, lower, upper, log=True, role=NUISANCE, prior=prior))

    for dof, push in zip(course.motion.dofs, accelerations):
        least, most = MIN_SIZE * push, 3.0 * push
        size = (0.0, 0.0) if quiet else (least, most)
        add(f"{dof.name}.disturbance", *size, 0.05 * push, 3.0)
        time = (2.0, 2.0) if quiet else (0.3, 60.0)
        add(f"{dof.name}.disturbance-time", *time, 2.0, 1.0)
        thrust = (0.0, 0.0) if quiet else (1e-3, 3.0)
        add(f"{dof.name}.thrust-noise", *thrust, 0.03, 2.0)
    add("gain-scatter", 1e-3, 0.3, 0.04, 0.5)
    earliest = -MAX_EARLY_HALF_SAMPLES * course.half_width if latest else 0.0
    anywhere = Prior(0.0, MAX_DELAY_S)
    chances.append(Parameter(COMMAND_DELAY, 0.0, earliest, latest, role=NUISANCE, unit="s", prior=anywhere))
    for sensor, noise in zip(course.sensors, course.noise):
        middle = max(noise, 1.5 * sensor.floor)
        add(f"noise.{sensor.quantity}", sensor.floor, 100.0 * middle, middle, 0.7)
    largest = float(np.abs(course.commanded).max()) or 1.0
    for name in varying:
        add(f"{name}.spread", 1e-4 * largest, largest, 0.05 * largest, 2.0)
    return tuple(chances)


SETTLED_GAIN = 0.02  # gain in log likelihood still to be expected below which a fit has converged
ITERATIONS = 60
FEW_RUNS = 6
"""Up to so many runs a fit without one of them is made anew, as one step from the fit to all may miss it by far."""
LOOK_STEPS, MAX_INERTIAS = 6, 3
"""Iterations from each of so many starting inertias, before the best goes on to the end: filters have wrong summits."""
SPREAD_NAMES = {GAIN: "gain-scatter"}  # what run effects are called whose sizes are parameters
NO_START = "no starting point of the fit has a finite likelihood; check the units of command, position and time"


MEMORY_S = 2.0
"""Time over which innovations are predicted from those before. Where they are white, all that is left is chance, and
likelihoods are what they say. Forecasts along commands that answer disturbances are biased against the truth,
innovations are not (Forssell, Ljung 1999, Automatica 35:1215)."""


def whitening_gain(innovation: Floats, variance: Floats, time: Floats) -> float:
    """Give the log density that innovations (R, K) with their variance, zero where nothing was read, would gain if each
    were predicted from those of MEMORY_S before it, less one for each coefficient (Akaike 1974, IEEE Trans. Automat.
    Contr. 19:716). White ones gain nothing, or less."""
    runs, steps = [], [MEMORY_S]
    for errors, variances, clock in zip(innovation, variance, time):
        at = np.flatnonzero(variances > 0)
        runs.append(np.clip(errors[at] / np.sqrt(variances[at]), -MAX_Z, MAX_Z))
        steps.extend(np.diff(clock[at]))
    order = max(round(MEMORY_S / float(np.median(steps))), 1)
    windows = [np.lib.stride_tricks.sliding_window_view(white, order + 1) for white in runs if len(white) > order]
    if not windows:
        return 0.0
    before, now = np.split(np.concatenate(windows), [order], axis=1)
    if len(now) <= 2 * order:  # too few to tell
        return np.inf
    remaining = now - before @ np.linalg.lstsq(before, now, rcond=None)[0]
    return 0.5 * len(now) * float(np.log((now**2).sum() / (remaining**2).sum())) - order


@dataclass(frozen=True, eq=False)
class InnovationsFit(Outcome):
    """Outcome of a fit by innovations: `theta` ends with the parameters of what is random; `gains` (R,) are the
    runs' log gains as filtered, `forecasts` how many there are that do not overlap, where the model's parameters are
    of least squares of them."""

    driven: ClassVar[Literal[True]] = True
    promised: ClassVar[float] = 0.0  # a filter's equations promise nothing beyond where it stopped

    gains: Floats
    forecasts: float = 0.0

    def factor(self, block: str) -> float:
        """Size of what differs from run to run: of the gain, or of what an effect lets vary."""
        return self.value(SPREAD_NAMES.get(block, f"{block}.spread"))

    def factor_interval(self, block: str) -> tuple[float, float]:
        """95 % interval of that size."""
        place = self.names.index(SPREAD_NAMES.get(block, f"{block}.spread"))
        half = float(special.ndtri(0.975) * np.sqrt(max(self.covariance[place, place], 0.0)))
        middle = float(self.theta[place])
        return middle * float(np.exp(-half)), middle * float(np.exp(half))

    def effects_of(self, block: str) -> Floats:
        """Each run's own effects (R, k) of one block, of which the filter keeps the gains."""
        return self.gains[:, None] if block == GAIN else np.zeros((len(self.gains), 1))

    def reading(self, channel: str) -> Floats:
        return np.zeros((len(self.gains), 0))


Fit = MixedFit | InnovationsFit


def fit_innovations(
    problem: DrivenProblem, starts: Floats, iterations: int = ITERATIONS, brief: bool = False,
    settled: float = SETTLED_GAIN,
) -> InnovationsFit:  # fmt: skip
    """Fit from the best of `starts` (S, p) in theta; a `brief` one leaves no run out, and predicts none; `settled` as
    the constant of that name.

    Raises FitError where no start leads anywhere.
    """
    (fit,) = fits_of([problem], [starts], iterations, brief, settled)
    if fit is None:
        raise FitError(NO_START)
    return fit


def fits_of(
    problems: Sequence[DrivenProblem], starts: Sequence[Floats], iterations: int = ITERATIONS, brief: bool = False,
    settled: float = SETTLED_GAIN,
) -> list[InnovationsFit | None]:  # fmt: skip
    """Fit several problems on the same runs side by side, each from its starts (S, p) as `fit_innovations` does; None
    where none leads anywhere."""
    ends = _climbed(problems, _begins(problems, starts), iterations, settled)
    fitted = [i for i, end in enumerate(ends) if np.isfinite(end.point.value)]
    good, reached = [problems[i] for i in fitted], [ends[i] for i in fitted]
    left_out = zip(fitted, _left_out(good, reached, brief))
    fits = {i: _report(problems[i], ends[i], without, brief) for i, without in left_out}
    return [fits.get(i) for i in range(len(ends))]


def _begins(problems: Sequence[DrivenProblem], starts: Sequence[Floats]) -> list[Floats]:
    """Where the search of each problem begins, phi (p,): the only start, or the best after a few steps from each of
    several inertias."""
    limits = [problem.parameters.limits.T for problem in problems]
    phis = [np.clip(of.parameters.search(theta), *within) for of, theta, within in zip(problems, starts, limits)]
    several = [i for i, of_problem in enumerate(phis) if len(of_problem) > 1]
    looks: list[tuple[int, Floats]] = []
    for i, values in zip(several, values_of([problems[i] for i in several], [phis[i] for i in several])):
        firsts = dict.fromkeys(phis[i][np.argsort(-values, kind="stable"), 0])  # distinct inertias, the best one first
        best = [int(np.argmax(np.where(phis[i][:, 0] == first, values, -np.inf))) for first in firsts]
        looks += [(i, phis[i][k]) for k in best[:MAX_INERTIAS] if np.isfinite(values[k])]
    begins, reached = [of_problem[0] for of_problem in phis], dict[int, float]()
    for (i, _), climb in zip(looks, _climbed([problems[i] for i, _ in looks], [phi for _, phi in looks], LOOK_STEPS)):
        if climb.point.value > reached.get(i, -np.inf):
            begins[i], reached[i] = climb.point.phi, climb.point.value
    return begins


def _climbed(
    problems: Sequence[DrivenProblem], starts: Sequence[Floats], iterations: int, settled: float = SETTLED_GAIN,
    left_out: Sequence[int] = (),
) -> list[Maximum[Slopes]]:  # fmt: skip
    """Climb from the start (p,) of each problem by Fisher scoring, without the run that is `left_out` of each, if any
    is; what is asked for at a time is filtered together."""

    def evaluate(phis: Sequence[Floats], searches: Sequence[int]) -> list[Point[Slopes]]:
        of_searches = [problems[i] for i in searches]
        slopes = slopes_of(of_searches, phis)
        if left_out:
            slopes = [of_point.without(left_out[i]) for of_point, i in zip(slopes, searches)]
        return [problem.point(phi, of_point) for problem, phi, of_point in zip(of_searches, phis, slopes)]

    free, limits = [problem.free for problem in problems], [problem.parameters.limits for problem in problems]
    return maximise(evaluate, starts, free, limits, settled=settled, iterations=iterations)


def _left_out(problems: Sequence[DrivenProblem], ends: Sequence[Maximum[Slopes]], brief: bool) -> list[Floats]:
    """Where each fit ends without each run, phi (R, p): a step from its own end, or as many as it takes of few runs."""
    by_problem, again = list[Floats](), list[tuple[int, int]]()
    for i, (problem, end) in enumerate(zip(problems, ends)):
        point, slopes, runs = end.point, end.point.data, len(problem.course.names)
        free, limits = problem.free, problem.parameters.limits
        at_bound, covariance, _ = point.spread(free, problem.parameters)
        left_out = np.tile(point.phi, (runs, 1))
        if runs > 1:
            inside = ~at_bound[free]
            remaining = (point.curvature - slopes.information)[:, inside][:, :, inside]
            moved = linear_mixed.solve_scaled(remaining, -slopes.gradient[:, inside])
            most = 5.0 * np.sqrt(np.maximum(np.diagonal(covariance)[free[inside]], 0.0))
            left_out[:, free[inside]] += np.clip(moved, -most, most)
            left_out = np.clip(left_out, limits[:, 0], limits[:, 1])
        by_problem.append(left_out)
        if 1 < runs <= FEW_RUNS and not brief and len(problem.course.motion.dofs) == 1:
            again += [(i, run) for run in range(runs)]
    little = 0.02 * SETTLED_GAIN  # a run left out moves a fit by little
    starts, of = [by_problem[i][run] for i, run in again], [problems[i] for i, _ in again]
    for (i, run), climb in zip(again, _climbed(of, starts, LOOK_STEPS, little, [run for _, run in again])):
        by_problem[i][run] = climb.point.phi
    return by_problem


def _report(problem: DrivenProblem, reached: Maximum[Slopes], left_out: Floats, brief: bool) -> InnovationsFit:
    point, slopes = reached.point, reached.point.data
    phi, runs, free = point.phi, len(problem.course.names), problem.free
    at_bound, covariance, of_bounds = point.spread(free, problem.parameters)
    information = np.zeros((runs, *covariance.shape))
    information[:, free[:, None], free] = slopes.information
    smooth = problem.parameters.smooth
    information += 0.0 if smooth is None else smooth / runs
    predictive = slopes.density
    if not brief:
        density = np.diagonal(problem.follow(left_out).log_density)
        predictive = np.where(np.isfinite(density), density, -1e9)  # next to nothing where a filter ran away
    theta, readings = problem.parameters.natural(phi), {c.quantity: int(c.seen.sum()) for c in problem.course.channels}
    return InnovationsFit(
        parameters=problem.parameters,
        theta=theta,
        phi=phi,
        covariance=covariance,
        of_bounds=of_bounds,
        left_out=left_out,
        log_likelihood=float(slopes.density.sum()),
        predictive=predictive,
        at_bound=tuple(np.flatnonzero(at_bound).tolist()),
        iterations=reached.iterations,
        converged=reached.converged,
        density=slopes.density,
        gains=slopes.gain,
        information=information,
        noise_of={name: float(theta[problem.parameters.names.index(f"noise.{name}")]) for name in readings},
        readings=readings,
    )


def random_estimates(fit: Fit, covariance: Floats, dof: Dof) -> dict[str, dict[str, object]]:
    """What is random in a fit, for a result file: sizes with their intervals, in the units of the arithmetic."""
    base = dof.units.base
    units = {"disturbance": f"{base}/s²", "disturbance-time": "s", "thrust-noise": "s^1/2", "gain-scatter": "1"}
    stored: dict[str, dict[str, object]] = {}
    for i, name in enumerate(fit.of_chance, len(fit.of_model)):
        value, stderr = float(fit.theta[i]), float(np.sqrt(max(covariance[i, i], 0.0)))
        kind = name.rpartition(".")[2]
        if name == COMMAND_DELAY:  # a parameter of the fit itself
            continue
        unit = units.get(kind, f"{base}/s" if kind == dof.velocity else base)
        estimate = Estimate.from_log(value, stderr, max(len(fit.left_out) - 1.0, 1.0), unit)
        stored[name] = replace(estimate, at_bound=i in fit.at_bound).to_json()
    return stored


ROBUST = 1.65  # error of a standard deviation told by a median, over that of the usual one


def channel_noises(fit: Fit, dof: Dof) -> dict[str, Estimate]:
    """Noise of each channel that counts, in the units in which people see it.

    The relative error is that of the standard deviation of so many white residuals.
    """
    noises = {}
    for name, noise in fit.noise_of.items():
        count = max(float(fit.readings[name]) - len(fit.theta), 1.0)
        unit = f"{dof.units.shown}/s" if name == dof.velocity else dof.units.shown
        estimate = Estimate.from_log(float(dof.shown(noise)), 1.0 / np.sqrt(2.0 * count), count, unit)
        bound = f"noise.{name}" in fit.names and fit.names.index(f"noise.{name}") in fit.at_bound
        noises[name] = replace(estimate, at_bound=bound)
    return noises


def measured_noises(runs: Sequence[Run], dof: Dof) -> dict[str, Estimate]:
    """Noise of each sensor estimated without a model, pooled over the runs that have it."""
    noises = {}
    for name in dof.channels:
        squares, count = 0.0, 0
        for run in runs:
            readings = run.channel(name)
            if readings is None or (name == dof.position and run.summed_up):
                continue
            good = np.isfinite(readings)
            squares += float(good.sum()) * position_noise(run.time[good], readings[good]) ** 2
            count += int(good.sum())
        if count:
            unit = f"{dof.units.shown}/s" if name == dof.velocity else dof.units.shown
            error = ROBUST / np.sqrt(2.0 * count)
            noises[name] = Estimate.from_log(float(dof.shown(np.sqrt(squares / count))), error, count, unit)
    return noises


def channels_json(choice: ChannelChoice, noises: Mapping[str, Estimate]) -> dict[str, object]:
    """`{"channels": [{"quantity", "used", "noise" or "why"}]}` for a result; {} where only positions are logged."""
    sensors = [to_mapping(sensor) for sensor in sensors_of(choice, noises)]
    return {"channels": sensors} if sensors else {}


def sensors_of(choice: ChannelChoice, noises: Mapping[str, Estimate]) -> list[Sensor]:
    noise_of = {verdict: noises.get(verdict.quantity) if verdict.used else None for verdict in choice.verdicts}
    return [Sensor(verdict.quantity, verdict.used, noise, verdict.why or None) for verdict, noise in noise_of.items()]
