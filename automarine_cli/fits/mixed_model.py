"""Maximum likelihood for runs that differ: nonlinear mixed-effects regression, the heart of every dynamic
fit.

Reading j of channel c in run i is  y_icj = f_icj(theta, b_i) + noise,  noise ~ N(0, s_c²),  b_i ~ N(0, D_i): theta
belongs to the vehicle, b_i to the run (start position and velocity, instants of the command changes, thrust gain, bias
of a rate sensor). Every entry of b_i has a standard deviation that is either known or a known scale times one
estimated factor (the scatter of the thrust gain, say).

Estimator (Lindstrom and Bates 1990, Biometrics 46:673): linearise f at the present theta and b, which makes the
problem linear and Gaussian (see linear_mixed.py); choose the variance factors by restricted likelihood, theta by
generalised least squares, b by its posterior mean; repeat, with half the step where it turns back on the last one.
After the linearisation a run is a small Gram matrix, so resampling runs, leaving one out and comparing models cost next
to nothing.

Assumptions: noise white within a run, runs independent. The standard errors by the jackknife over runs hold without
the first.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.linear_mixed import (
    SMALLEST_FACTOR,
    Grams,
    NormalEquations,
    RunEffects,
    choose_variances,
    scored_deviance,
)
from automarine_cli.models.parameter import Parameters, Priors
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel


@dataclass(frozen=True, eq=False)
class Outcome:
    """What every fit gives.

    `theta` (p,) and `phi` (p,), the same on the scales of the search, on which are `covariance` (p, p) from the
    likelihood, with the part `of_bounds` (see `covariance_within_bounds`), and `left_out` (R, p), phi without each
    run; `log_likelihood` (marginal), `predictive` (R,) log density of each run predicted from the others, `at_bound`
    indices of the parameters that a bound stopped, `information` (R, p, p) what each run says of phi, `noise_of` each
    channel that counts by its quantity [its unit] with the number of its `readings`, `density` (R,) the log density of
    each run; `driven` says whether a filter followed the runs, else they were simulated.
    """

    parameters: Parameters
    theta: Floats
    phi: Floats
    covariance: Floats
    of_bounds: Floats
    left_out: Floats
    log_likelihood: float
    predictive: Floats
    at_bound: tuple[int, ...]
    iterations: int
    converged: bool
    information: Floats = field(repr=False)
    noise_of: Mapping[str, float]
    readings: Mapping[str, int]
    density: Floats

    @property
    def names(self) -> tuple[str, ...]:
        return self.parameters.names

    @property
    def of_model(self) -> Floats:
        """The model's own entries of theta, which come first."""
        return self.theta[self.parameters.of_model]

    @property
    def of_chance(self) -> dict[str, float]:
        """What was estimated beside the model, by name."""
        return {parameter.name: self.value(parameter.name) for parameter in self.parameters.nuisance}

    def value(self, name: str) -> float:
        return float(self.theta[self.names.index(name)])

    @property
    def noise(self) -> float:
        return next(iter(self.noise_of.values()))

    @property
    def inside_bounds(self) -> Floats:
        """Covariance of phi (p, p) with what a bound stopped as known."""
        return self.covariance - self.of_bounds

    @property
    def error_of_known(self) -> Floats:
        """Covariance of phi that the errors of what was known make, (p, p): no run that is left out shows it."""
        erring = [name in self.parameters.priors for name in self.names]  # what is known exactly has no precision
        return self.inside_bounds @ np.diag(np.diagonal(self.parameters.prior[1]) * erring) @ self.inside_bounds


def jackknife(left_out: Floats) -> Floats:
    """Covariance (p, p) of phi from leaving each run out, (R, p); assumes nothing of the noise within a run."""
    count, spread = len(left_out), left_out - left_out[0]
    spread = spread - spread.mean(axis=0)  # without rounding where a parameter stands still
    return np.asarray((count - 1) / count * spread.T @ spread)


Response = Callable[[Floats, Floats], Floats]
"""Readings (P, R, N) of all channels one after the other, for theta (P, p) and run effects (P, R, q)."""
ReadingSlopes = Callable[[Floats, Floats], tuple[Floats, Floats, Floats]]
"""Readings (R, N) for theta (p,) and run effects (R, q), and their derivatives by both, (R, N, p) and (R, N, q)."""

PairedResponse = Callable[[Floats, Floats, NDArray[np.int64]], Floats]
"""Readings (K, N) of runs `rows` (K,), each for its own theta (K, p) and run effects (K, q)."""

MIN_NOISE = 1e-4  # where the fit of a channel's noise starts at least [its unit]

CHI2_95 = float(2.0 * special.gammaincinv(0.5, 0.95))  # rise of a deviance at the ends of a 95 % interval

MAX_RUNS_FOR_NOISE = 100
MIN_READINGS = 8  # readings from which on their noise can be told roughly


@dataclass(frozen=True)
class Slot:
    """One channel's place among the readings: columns `part` of the N. `noise` is where a fit of its noise starts [its
    unit]; one that does not `count` is simulated for people to look at, and no evidence."""

    name: str
    part: slice
    noise: float = 0.0
    counts: bool = True


def slots_of(channels: Sequence[Channel]) -> tuple[Slot, ...]:
    """The places of channels whose readings stand one after the other."""
    slots, at = [], 0
    for channel in channels:
        width = channel.values.shape[1]
        some = slice(None, None, 1 + len(channel.values) // MAX_RUNS_FOR_NOISE)  # enough for a start
        noises = [series_noise(v[s]) for v, s in zip(channel.values[some], channel.seen[some]) if s.any()]
        noise = float(np.median(noises)) if noises else 0.0
        slots.append(Slot(channel.quantity, slice(at, at + width), max(noise, MIN_NOISE), channel.counts))
        at += width
    return tuple(slots)


def series_noise(values: Floats) -> float:
    """A rough standard deviation of the noise on readings (n,): of their second differences."""
    if len(values) < MIN_READINGS:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 2)))) / 0.6745 / np.sqrt(6.0)


@dataclass(frozen=True)
class Problem:
    """Measured readings (R, N) with their mask, the response to theta (p,), the run effects, and the `parameters`.

    `slots` are the channels, the first that counts first. `slopes` are the derivatives of the response where a formula
    has them, `paired` the response of single runs where it can be had.
    """

    response: Response
    measured: Floats
    observed: NDArray[np.bool_]
    effects: RunEffects
    parameters: Parameters
    slots: tuple[Slot, ...]
    slopes: ReadingSlopes | None = None
    paired: PairedResponse | None = None

    def informed(self, priors: Priors) -> "Problem":
        return replace(self, parameters=self.parameters.informed(priors))

    @cached_property
    def prior(self) -> tuple[Floats, Floats] | None:
        """Mean (p,) and precision (p, p) of phi before the data; None where nothing is known."""
        return self.parameters.prior if self.parameters.prior[1].any() else None

    @cached_property
    def counted(self) -> tuple[Slot, ...]:
        return tuple(slot for slot in self.slots if slot.counts)

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """Samples of each run and counted channel, (R, C)."""
        return np.stack([self.observed[:, slot.part].sum(axis=1) for slot in self.counted], axis=1)

    def residual(self, fitted: Floats) -> Floats:
        """What readings (..., R, N) leave of the measured ones, zero in the padding."""
        return np.where(self.observed, self.measured - fitted, 0.0)

    @np.errstate(over="ignore")  # of a trial that runs away
    def squares(self, residual: Floats, variances: Floats) -> Floats:
        """Each run's sum of squares of residuals (..., R, N) in units of their channels' noise, (..., R)."""
        total = np.zeros(residual.shape[:-1])
        for slot, log_noise in zip(self.counted, variances):
            total = total + (residual[..., slot.part] ** 2).sum(axis=-1) / np.exp(2.0 * log_noise)
        return total

    def gram(self, by_phi: Floats, by_run: Floats, fitted: Floats, b: Floats, phi: Floats | None = None) -> Grams:
        """Inner products of the problem linearised about readings `fitted` (R, N) at run effects `b` (R, q); what is
        known beforehand is about phi (p,)."""
        grams, prior = self.inner(by_phi, by_run, self.residual(fitted), b), self.prior
        return grams if prior is None or phi is None else replace(grams, prior=(prior[0] - phi, prior[1]))

    def inner(self, by_phi: Floats, by_run: Floats, residual: Floats, b: Floats | None = None) -> Grams:
        """The same of any residuals (R, N), zero in the padding; b zero where not given."""
        parts = [(slot.part, count) for slot, count in zip(self.counted, self.count.T)]
        return Grams(
            tuple(NormalEquations.of(by_phi[:, x], by_run[:, x], residual[:, x], count, b) for x, count in parts)
        )

    @np.errstate(over="ignore", invalid="ignore")  # of a trial that runs away
    def readings(self, phi: Floats, b: Floats) -> Floats:
        """Readings (R, N) for phi (p,) and run effects b (R, q)."""
        return self.response(self.parameters.natural(phi)[None], b[None])[0]


@dataclass(frozen=True, eq=False)
class MixedFit(Outcome):
    """Outcome of a fit of the mixed model: also `noises` (C,) of the counted channels, `factors` of the run effects,
    `run_effects` (R, q), and the `fitted` readings (R, N)."""

    driven: ClassVar[Literal[False]] = False

    noises: Floats
    factors: Floats
    run_effects: Floats
    fitted: Floats
    slots: tuple[Slot, ...]
    gram: Grams = field(repr=False)
    effects: RunEffects = field(repr=False)

    def reading(self, channel: str) -> Floats:
        """Readings (R, N) of one channel as they were fitted."""
        return self.fitted[:, next(slot.part for slot in self.slots if slot.name == channel)]

    @property
    def variances(self) -> Floats:
        """Logarithms of noises and factors, as `linear_mixed` takes them."""
        return np.log([*self.noises, *np.maximum(self.factors, SMALLEST_FACTOR)])

    @cached_property
    def promised(self) -> float:
        """What the linear equations promise beyond the point at which the fit stopped, in deviance: `log_likelihood`
        is that of their solution, where nobody has been."""
        weighted = linear_mixed.weigh(self.gram, self.effects, self.variances)
        hessian, pull = linear_mixed.normal_equations(self.gram, weighted)
        return float(pull @ linear_mixed.covariance_of(hessian) @ pull)

    def factor(self, block: str) -> float:
        """Estimated size of one kind of run effect."""
        return float(self.factors[self.effects.factor_names.index(block)])

    def effects_of(self, block: str) -> Floats:
        """Each run's own effects (R, k) of one kind."""
        return self.effects.of(self.run_effects, block)

    def factor_interval(self, block: str) -> tuple[float, float]:
        """95 % interval of a factor: where the restricted deviance rises by 3.84, the other variances fixed."""
        index = self.effects.factor_names.index(block)
        best, limits = self.variances, self.effects.limits[index]
        place = len(self.noises) + index
        level = self._deviance(best) + CHI2_95

        def above(log_factor: float) -> float:
            trial = best.copy()
            trial[place] = log_factor
            return self._deviance(trial) - level

        ends = []
        for limit in limits:
            edge = float(np.log(max(limit, SMALLEST_FACTOR)))
            inside = above(edge) <= 0 or abs(edge - best[place]) < 1e-9
            ends.append(edge if inside else float(optimize.brentq(above, edge, best[place], xtol=1e-6)))
        low, high = np.exp(ends)
        return (0.0 if low <= max(limits[0], SMALLEST_FACTOR) * (1 + 1e-9) else float(low)), float(high)

    def _deviance(self, variances: Floats) -> float:
        return scored_deviance(self.gram, self.effects, variances, restricted=True)[0]


PHI_STEP = 1e-6
"""Step of the one-sided differences by phi, as a share of it or of a tenth: truncation and rounding are then both some
1e-6 of the derivative."""

RUN_STEP = 1e-6  # step of the one-sided differences by run effects, whose scales are all of the order of one
SETTLED_STDERRS = 1e-2  # a fit has converged when no parameter would move by more than this share of its standard error
MAX_TRIALS, LINEARISED_TRIALS = 12, 4  # of a step, halved each time, and those of them that are linearised at once
MAX_FOLLOWING = 5  # how often the run effects may be fitted again before a trial step is given up
CUT_SHARE = 0.25  # share of a step, or less, that counts as cut short
MIN_CUT_GAIN = 1e-2
"""Gain in the sum of squares (of standard deviations) that is not worth a step that had to be cut short: the response
has a kink there, as that to a delay has where it is a whole number of steps."""
LAST_CUT_SHARE = 0.3  # the same as a share of `least_gain`: each further cut step gains about half as much
NEARLY_STDERRS = 0.3  # still to go, of each standard error, within which a search that is stuck counts as converged

FAR_FROM_IT = 10.0  # times the least gain: a step that promised more and gained less ends no fit
MAX_PHI_STEP = 1.0  # largest change of the logarithm of a positive parameter in one step


def fit_mixed(
    problem: Problem, theta: Floats, *, noise: float | Floats, factors: Floats, run_effects: Floats | None = None,
    iterations: int = 60, settled: float = SETTLED_STDERRS, least_gain: float = 0.0,
) -> MixedFit:  # fmt: skip
    """Fit `problem` from the start values; shapes as in `Problem`, `settled` as the constant of that name. The fit also
    ends with a whole step that gains less than `least_gain` in the sum of squares (of standard deviations), unless it
    promised far more.

    `noise` is that of the first channel that counts, or of all these (C,); the others' start where their slots say.

    Parameters whose bounds are one value are held there; they count as `at_bound`. Raises FitError when there are no
    more samples than parameters or the response is not finite at the start.
    """
    bounds, free = problem.parameters.limits, problem.parameters.free
    if problem.count.sum() <= len(free) + 1:
        raise FitError(f"{problem.count.sum()} samples cannot carry {len(free)} parameters; give more or longer runs")
    phi = np.clip(problem.parameters.search(theta), bounds[:, 0], bounds[:, 1])
    b = np.zeros_like(problem.effects.scale) if run_effects is None else run_effects
    noises = np.atleast_1d(noise)
    noises = np.append(noises, [slot.noise for slot in problem.counted[len(noises) :]])
    variances = np.log([*noises, *np.maximum(factors, SMALLEST_FACTOR)])
    step, share, last = 0, 1.0, np.zeros_like(phi)
    converged, stuck, point = False, False, _linearise(problem, phi, b)
    while step < iterations and not (converged or stuck):
        step += 1
        inside = point.gram.keep(np.flatnonzero(~_at_bound(point.phi, bounds)))
        variances = choose_variances(inside, problem.effects, variances)
        weighted = linear_mixed.weigh(point.gram, problem.effects, variances)
        hessian, pull = linear_mixed.normal_equations(point.gram, weighted)
        change = _bounded_step(problem, hessian, pull, point.phi)
        new_b = linear_mixed.posterior_mean(point.gram, problem.effects, variances, change)
        spread = np.zeros_like(change)
        spread[free] = np.diagonal(linear_mixed.covariance_of(hessian[np.ix_(free, free)]))
        precision = np.sqrt(np.maximum(spread, 1e-24))
        converged = bool(np.all(np.abs(change) <= settled * precision))
        share = share / 2.0 if change @ (last / precision**2) < 0 else min(1.0, 2.0 * share)
        last = share * change
        new_phi = np.clip(point.phi + last, bounds[:, 0], bounds[:, 1])
        old, point = (point, _line_search(problem, variances, point, new_phi, point.b + share * (new_b - point.b)))
        before, after = (_penalised(problem, variances, p.phi, p.b, p.fitted) for p in (old, point))
        gain = before - after
        taken = _taken(problem, old, point, new_phi)
        is_cut = taken <= CUT_SHARE
        stuck = is_cut and gain < max(MIN_CUT_GAIN, LAST_CUT_SHARE * least_gain)
        ends = gain < least_gain and float(pull @ change) < FAR_FROM_IT * least_gain
        converged |= ends and share == 1.0 and not is_cut
        converged |= stuck and bool(np.all(np.abs(change) <= NEARLY_STDERRS * precision))
        share *= min(1.0, taken / (2.0 * CUT_SHARE))  # in a curved valley the next step is cut as short as this one
    return _report(problem, point, variances, bounds, step, converged)


@dataclass(frozen=True)
class _Point:
    """One point of the search: phi (p,), run effects (R, q), readings (R, N), and the problem linearised there."""

    phi: Floats
    b: Floats
    fitted: Floats
    gram: Grams


def derivatives(problem: Problem, phi: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
    """Readings (R, N), their derivatives by phi (R, N, p) and by the run effects (R, N, q).

    By the problem's formula, else as one-sided differences. Those by parameters that are fixed count as zero: their
    direction may be that of others (the moment at which a loss is told, and the loss), and would take a search with it.

    A run effect that can only be zero is not perturbed, where the response of single runs can be had in no run in
    which it can. Steps point away from zero, so that a mirrored campaign has the mirrored derivatives.
    """
    free = problem.parameters.free
    if problem.slopes is not None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            theta = problem.parameters.natural(phi)
            fitted, by_theta, by_run = problem.slopes(theta, b)
        there = problem.observed[:, :, None]
        by_theta = by_theta * np.where(problem.parameters.log, theta, 1.0) * np.isin(np.arange(len(phi)), free)
        fitted = np.where(problem.observed, fitted, 0.0)
        return fitted, np.where(there, by_theta, 0.0), np.where(there, by_run, 0.0)
    step = PHI_STEP * np.where(phi < 0, -1.0, 1.0)[free] * np.maximum(np.abs(phi[free]), 1e-1)
    if problem.paired is not None:
        return _paired_derivatives(problem, phi, b, step)
    acts = np.flatnonzero(problem.effects.scale.any(axis=0))
    p, q = len(free), len(acts)
    sets = np.tile(phi, (1 + p + q, 1))
    effects = np.tile(b, (1 + p + q, 1, 1))
    sets[np.arange(1, 1 + p), free] += step
    effects[np.arange(1 + p, 1 + p + q), :, acts] += RUN_STEP
    by_phi, by_run = (np.zeros((count, *problem.observed.shape)) for count in (len(phi), b.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):  # parameters that no vehicle has: `weigh` sees the infinity
        out = np.where(problem.observed, problem.response(problem.parameters.natural(sets), effects), 0.0)
        by_run[acts] = (out[1 + p :] - out[0]) / RUN_STEP
        by_phi[free] = (out[1 : 1 + p] - out[0]) / step[:, None, None]
    return out[0], np.moveaxis(by_phi, 0, 2), np.moveaxis(by_run, 0, 2)


def _paired_derivatives(problem: Problem, phi: Floats, b: Floats, step: Floats) -> tuple[Floats, Floats, Floats]:
    """The same of single runs: few have as many run effects as the one with most."""
    assert problem.paired is not None
    free = problem.parameters.free
    (runs, samples), p = problem.observed.shape, len(free)
    column, row = np.nonzero(problem.effects.scale.T)
    rows = np.concatenate([np.tile(np.arange(runs), 1 + p), row])
    sets = np.tile(phi, (1 + p, 1))
    sets[np.arange(1, 1 + p), free] += step
    sets = problem.parameters.natural(sets)
    effects, moved = b[rows], runs * (1 + p) + np.arange(len(row))
    effects[moved, column] += RUN_STEP
    theta = sets[np.concatenate([np.repeat(np.arange(1 + p), runs), np.zeros(len(row), dtype=int)])]
    by_phi, by_run = np.zeros((len(phi), runs, samples)), np.zeros((runs, samples, b.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        out = np.where(problem.observed[rows], problem.paired(theta, effects, rows), 0.0)
        fitted = out[:runs]
        by_run[row, :, column] = (out[moved] - fitted[row]) / RUN_STEP
        by_phi[free] = (out[runs : runs * (1 + p)].reshape(p, runs, samples) - fitted) / step[:, None, None]
    return fitted, np.moveaxis(by_phi, 0, 2), by_run


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # where the response is infinite, `weigh` says so
def _linearise(problem: Problem, phi: Floats, b: Floats) -> _Point:
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    return _Point(phi, b, fitted, problem.gram(by_phi, by_run, fitted, b, phi))


def _penalised(problem: Problem, variances: Floats, phi: Floats, b: Floats, fitted: Floats) -> float:
    """Sum of squares that phi and b minimise together at fixed variances, of the readings `fitted` there."""
    scale, (mean, precision) = problem.effects.deviation(variances), problem.parameters.prior
    penalty = np.divide(b, scale, out=np.zeros_like(b), where=scale > 0) ** 2
    squares = float(problem.squares(problem.residual(fitted), variances).sum() + penalty.sum())
    return squares + float((mean - phi) @ precision @ (mean - phi))


def _line_search(problem: Problem, variances: Floats, current: _Point, new_phi: Floats, new_b: Floats) -> _Point:
    """Step towards the new point, halved until the penalised sum of squares does not rise.

    The first trials are linearised at once, as they are nearly always taken, later ones only where they are.
    """
    limit = _penalised(problem, variances, current.phi, current.b, current.fitted) * (1 + 1e-12) + 1e-12
    boldest = np.max(np.abs(new_phi - current.phi)[problem.parameters.log], initial=0.0)
    share = min(1.0, MAX_PHI_STEP / max(float(boldest), 1e-300))
    for trials in range(MAX_TRIALS):
        phi, b = current.phi + share * (new_phi - current.phi), current.b + share * (new_b - current.b)
        worth = trials < LINEARISED_TRIALS or _penalised(problem, variances, phi, b, problem.readings(phi, b)) <= limit
        if worth and (trial := _followed(problem, variances, phi, b, limit)) is not None:
            return trial
        share /= 2.0
    return current


def _taken(problem: Problem, old: _Point, new: _Point, target: Floats) -> float:
    """Give the share that was taken of the step towards `target`, as far as one may go at once."""
    proposed = target - old.phi
    allowed = min(1.0, MAX_PHI_STEP / max(float(np.abs(proposed)[problem.parameters.log].max(initial=0.0)), 1e-300))
    return float(np.abs(new.phi - old.phi).max() / max(allowed * np.abs(proposed).max(), 1e-300))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _followed(problem: Problem, variances: Floats, phi: Floats, b: Floats, limit: float) -> _Point | None:
    """The point (phi, b) if its penalised sum of squares is within `limit`, else with the run effects fitted
    again at this phi while that helps, else None.

    Where a gain and the disturbances of a run make up for each other, the valley is curved: straight steps along
    it would have to be tiny, but the disturbances, which are linear, follow in a step or two.
    """
    before = np.inf
    for _ in range(MAX_FOLLOWING):
        point = _linearise(problem, phi, b)
        cost = _penalised(problem, variances, phi, b, point.fitted)
        if not (np.isfinite(cost) and point.gram.is_finite):
            return None
        if cost <= limit:
            return point
        weighted = linear_mixed.weigh(point.gram, problem.effects, variances)
        if cost > 0.5 * before or float(weighted.square.sum()) > limit:  # the least that following promises
            return None
        before, b = cost, problem.effects.deviation(variances) * weighted.means
    return None


def _bounded_step(problem: Problem, hessian: Floats, gradient: Floats, phi: Floats) -> Floats:
    """Change of phi (p,) that solves the equations within the bounds; what is fixed stays."""
    free, step = problem.parameters.free, np.zeros_like(phi)
    room = (problem.parameters.limits - phi[:, None])[free]
    step[free] = linear_mixed.bounded_solution(hessian[np.ix_(free, free)], gradient[free], room)
    return step


def _at_bound(phi: Floats, bounds: Floats) -> NDArray[np.bool_]:
    return (phi - bounds[:, 0] < 1e-9) | (bounds[:, 1] - phi < 1e-9)


def _report(
    problem: Problem, point: _Point, variances: Floats, bounds: Floats, iterations: int, converged: bool
) -> MixedFit:
    phi, gram = point.phi, point.gram
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    hessian, gradient = linear_mixed.normal_equations(gram, weighted)
    at_bound = _at_bound(phi, bounds)
    free = np.flatnonzero(~at_bound)
    searched, information = problem.parameters.free, np.zeros_like(weighted.hessian)
    covariance, of_bounds = linear_mixed.covariance_within_bounds(
        hessian[np.ix_(searched, searched)], gradient[searched], searched, at_bound, problem.parameters.log
    )
    information[:, free[:, None], free] = weighted.hessian[:, free[:, None], free]
    push = weighted.gradient
    left_out = np.tile(phi, (len(problem.measured), 1))
    if len(left_out) > 1:
        remaining, pull = (hessian - weighted.hessian)[:, free][:, :, free], gradient - push
        left_out[:, free] += linear_mixed.solve_scaled(remaining, pull[:, free])
    onward = _bounded_step(problem, hessian, gradient, phi)
    beyond = _at_bound(phi + onward, bounds)
    # what a bound stops, or would with one more step, may not be profiled out: that is the likelihood beyond it
    inside = gram.keep(np.flatnonzero(~(at_bound | beyond)))
    ml = choose_variances(inside, problem.effects, variances, restricted=False)
    ml_deviance, *_ = scored_deviance(inside, problem.effects, ml, restricted=False)
    smooth = problem.parameters.smooth
    if smooth is not None:  # the likelihood told is that of the readings alone
        ml_deviance -= float(phi @ smooth @ phi)
        information += smooth / len(information)
    quantities, channels = [slot.name for slot in problem.counted], len(problem.counted)
    return MixedFit(
        parameters=problem.parameters, theta=problem.parameters.natural(phi), phi=phi, covariance=covariance,
        of_bounds=of_bounds, left_out=left_out, noises=np.exp(variances[:channels]),
        factors=np.exp(variances[channels:]), run_effects=point.b,
        log_likelihood=-0.5 * (ml_deviance + int(problem.count.sum()) * np.log(2 * np.pi)),
        predictive=linear_mixed.predictive(gram, weighted, left_out - phi), fitted=point.fitted,
        at_bound=tuple(int(i) for i in np.flatnonzero(at_bound)), iterations=iterations, converged=converged,
        information=information, noise_of=dict(zip(quantities, np.exp(variances[:channels]).tolist())),
        readings=dict(zip(quantities, problem.count.sum(axis=0).tolist())),
        density=linear_mixed.predictive(gram, weighted, np.zeros_like(left_out)), slots=problem.slots,
        gram=gram.keep(free), effects=problem.effects,
    )  # fmt: skip
