"""Maximum likelihood for runs that differ: nonlinear mixed-effects regression, the heart of every dynamic
fit.

Reading j of channel c in run i is  y_icj = f_icj(theta, b_i) + noise,  noise ~ N(0, s_c²),  b_i ~ N(0, D_i): theta
belongs to the vehicle, b_i to the run (start position and velocity, instants of the command changes, thrust gain, bias
of a rate sensor). Every entry of b_i has a standard deviation that is either known or a known scale times one
estimated factor (the scatter of the thrust gain, say).

Estimator (Lindstrom and Bates 1990, Biometrics 46:673): linearise f at the present theta and b, which makes the
problem linear and Gaussian (see linear_mixed.py); choose the variance factors by restricted likelihood, theta by
generalised least squares, b by its posterior mean; repeat, with half the step where it turns back on the last one.
After the linearisation a run is a small Gram matrix, so resampling runs, leaving one out and comparing models cost
next to nothing.

Assumptions: noise white within a run, runs independent. The standard errors by the jackknife over runs hold without
the first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.gram import Grams
from automarine_cli.fits.linear_mixed import SMALLEST_FACTOR
from automarine_cli.fits.mixed_problem import MixedFit, Problem, with_held, without_held
from automarine_cli.fits.variances import choose_variances, deviance
from automarine_cli.quantities import Floats

__all__ = ["MixedFit", "Problem", "derivatives", "fit_mixed"]

PHI_STEP = 1e-6
"""Step of the one-sided differences by phi, as a share of it or of a tenth: truncation and rounding are then both some
1e-6 of the derivative."""

RUN_STEP = 1e-6
"""Step of the one-sided differences by run effects, whose scales are all of the order of one."""

SETTLED = 1e-2
"""A fit has converged when no parameter would move by more than this share of its standard error."""

MOST_FOLLOWING = 5
"""How often the run effects may be fitted again before a trial step is given up."""

TRIFLE = 1e-2
"""Gain in the sum of squares (of standard deviations) that is not worth a step that had to be cut short: the response
has a kink there, as that to a delay has where it is a whole number of steps."""

BOLDEST = 1.0
"""Largest change of the logarithm of a positive parameter in one step."""


def fit_mixed(
    problem: Problem,
    theta: Floats,
    *,
    noise: float | Floats,
    factors: Floats,
    run_effects: Floats | None = None,
    iterations: int = 60,
    settled: float = SETTLED,
) -> MixedFit:
    """Fit `problem` from the start values; shapes as in `Problem`, `settled` as the constant of that name.

    `noise` is that of the first channel that counts, or of all these (C,); the others' start where their slots say.

    Parameters whose bounds are one value are held there; they count as `at_bound`. Raises FitError when there are no
    more samples than parameters or the response is not finite at the start.
    """
    held = problem.bounds[:, 0] == problem.bounds[:, 1]
    if held.any():
        free = fit_mixed(
            without_held(problem, held), theta[~held], noise=noise, factors=factors, run_effects=run_effects,
            iterations=iterations, settled=settled,
        )  # fmt: skip
        return with_held(free, problem, held)
    if problem.count.sum() <= len(theta) + 1:
        raise FitError(f"{problem.count.sum()} samples cannot carry {len(theta)} parameters; give more or longer runs")
    bounds = np.stack([problem.search(problem.bounds[:, 0]), problem.search(problem.bounds[:, 1])], axis=1)
    phi = np.clip(problem.search(theta), bounds[:, 0], bounds[:, 1])
    b = np.zeros_like(problem.effects.scale) if run_effects is None else run_effects
    noises = np.atleast_1d(noise)
    noises = np.append(noises, [slot.noise for slot in problem.counted[len(noises) :]])
    variances = np.log([*noises, *np.maximum(factors, SMALLEST_FACTOR)])
    step, share, last = 0, 1.0, np.zeros_like(phi)
    converged, stuck, point = False, False, _first(problem, phi, b)
    while step < iterations and not (converged or stuck):
        step += 1
        inside = point.gram.keep(np.flatnonzero(~_at_bound(point.phi, bounds)))
        variances = choose_variances(inside, problem.effects, variances)
        weighted = linear_mixed.weigh(point.gram, problem.effects, variances)
        hessian, gradient = linear_mixed.normal_equations(point.gram, weighted)
        change = linear_mixed.bounded_solution(hessian, gradient, 0.0 * phi, bounds - point.phi[:, None])
        new_b = linear_mixed.posterior_mean(point.gram, problem.effects, variances, change)
        spread = np.diagonal(linear_mixed.covariance_of(hessian))
        precision = np.sqrt(np.maximum(spread, 1e-24))
        converged = bool(np.all(np.abs(change) <= settled * precision))
        share = share / 2.0 if change @ (last / precision**2) < 0 else min(1.0, 2.0 * share)
        last = share * change
        new_phi = np.clip(point.phi + last, bounds[:, 0], bounds[:, 1])
        old, point = (point, _line_search(problem, variances, point, new_phi, point.b + share * (new_b - point.b)))
        stuck = point is old or _stands(problem, variances, old, point, new_phi)
    return _report(problem, point, variances, bounds, step, converged)


@dataclass(frozen=True)
class _Point:
    """One point of the search: phi (p,), run effects (R, q), readings there (R, N), and the problem linearised
    about it."""

    phi: Floats
    b: Floats
    fitted: Floats
    gram: Grams


def derivatives(problem: Problem, phi: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
    """Readings (R, N), their derivatives by phi (R, N, p) and by the run effects (R, N, q); one-sided differences where
    the problem has no formula for them.

    A run effect that can only be zero is not perturbed. Steps point away from zero, so that a mirrored campaign has
    the mirrored derivatives.
    """
    if problem.slopes is not None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            theta = problem.natural(phi)
            fitted, by_theta, by_run = problem.slopes(theta, b)
            return fitted, by_theta * np.where(problem.positive, theta, 1.0), by_run
    free = np.flatnonzero(problem.effects.scale.any(axis=0))
    p, q = len(phi), len(free)
    step = PHI_STEP * np.where(phi < 0, -1.0, 1.0) * np.maximum(np.abs(phi), 1e-1)
    sets = np.tile(phi, (1 + p + q, 1))
    effects = np.tile(b, (1 + p + q, 1, 1))
    sets[np.arange(1, 1 + p), np.arange(p)] += step
    effects[np.arange(1 + p, 1 + p + q), :, free] += RUN_STEP
    by_run = np.zeros((b.shape[1], *b.shape[:1], problem.seen.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):  # parameters that no vehicle has: `weigh` sees the infinity
        out = np.where(problem.seen, problem.response(problem.natural(sets), effects), 0.0)
        by_run[free] = (out[1 + p :] - out[0]) / RUN_STEP
        by_phi = (out[1 : 1 + p] - out[0]) / step[:, None, None]
    return out[0], np.moveaxis(by_phi, 0, 2), np.moveaxis(by_run, 0, 2)


def _linearise(problem: Problem, phi: Floats, b: Floats) -> _Point:
    """The problem about (phi, b) as inner products, and the readings there."""
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    return _Point(phi, b, fitted, problem.gram(by_phi, by_run, fitted, b, phi))


def _first(problem: Problem, phi: Floats, b: Floats) -> _Point:
    """The start of the search, where the response may well be infinite: `weigh` then says so."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _linearise(problem, phi, b)


def _penalised(problem: Problem, variances: Floats, point: _Point) -> float:
    """Sum of squares that phi and b minimise together at fixed variances."""
    scale = problem.effects.deviation(variances)
    penalty = np.divide(point.b, scale, out=np.zeros_like(point.b), where=scale > 0) ** 2
    known = 0.0 if point.gram.prior is None else float(point.gram.prior[0] @ point.gram.prior[1] @ point.gram.prior[0])
    return float(problem.squares(problem.residual(point.fitted), variances).sum() + penalty.sum()) + known


def _line_search(problem: Problem, variances: Floats, here: _Point, new_phi: Floats, new_b: Floats) -> _Point:
    """Step towards the new point, halved until the penalised sum of squares does not rise.

    Every trial is linearised at once: a whole-run simulation costs as much for one parameter set as for all
    the perturbed ones, and the first trial is nearly always taken.
    """
    limit = _penalised(problem, variances, here) * (1 + 1e-12) + 1e-12
    boldest = np.max(np.abs(new_phi - here.phi)[problem.positive], initial=0.0)
    share = min(1.0, BOLDEST / max(float(boldest), 1e-300))
    for _ in range(12):
        phi, b = here.phi + share * (new_phi - here.phi), here.b + share * (new_b - here.b)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            trial = _followed(problem, variances, phi, b, limit)
        if trial is not None:
            return trial
        share /= 2.0
    return here


def _stands(problem: Problem, variances: Floats, old: _Point, new: _Point, wanted: Floats) -> bool:
    """Whether the search stands: a step cut to a quarter of the one allowed, or less, gained a trifle."""
    asked = wanted - old.phi
    allowed = min(1.0, BOLDEST / max(float(np.abs(asked)[problem.positive].max(initial=0.0)), 1e-300))
    if np.abs(new.phi - old.phi).max() > 0.25 * allowed * np.abs(asked).max():
        return False
    return _penalised(problem, variances, old) - _penalised(problem, variances, new) < TRIFLE


def _followed(problem: Problem, variances: Floats, phi: Floats, b: Floats, limit: float) -> _Point | None:
    """The point (phi, b) if its penalised sum of squares is within `limit`, else with the run effects fitted
    again at this phi while that helps, else None.

    Where a gain and the disturbances of a run make up for each other, the valley is curved: straight steps along
    it would have to be tiny, but the disturbances, which are linear, follow in a step or two.
    """
    before = np.inf
    for _ in range(MOST_FOLLOWING):
        point = _linearise(problem, phi, b)
        cost = _penalised(problem, variances, point)
        if not (np.isfinite(cost) and point.gram.is_finite):
            return None
        if cost <= limit:
            return point
        if cost > 0.5 * before:
            return None
        before = cost
        b = linear_mixed.posterior_mean(point.gram, problem.effects, variances, np.zeros_like(phi))
    return None


def _at_bound(phi: Floats, bounds: Floats) -> NDArray[np.bool_]:
    """Which parameters stand at one of their bounds, (p,)."""
    return (phi - bounds[:, 0] < 1e-9) | (bounds[:, 1] - phi < 1e-9)


def _report(
    problem: Problem, point: _Point, variances: Floats, bounds: Floats, iterations: int, converged: bool
) -> MixedFit:
    phi, gram = point.phi, point.gram
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    hessian, whole = linear_mixed.normal_equations(gram, weighted)
    at_bound = _at_bound(phi, bounds)
    free = np.flatnonzero(~at_bound)
    grid = np.ix_(free, free)
    covariance = np.zeros_like(hessian)
    covariance[grid] = linear_mixed.covariance_of(hessian[grid])
    push = weighted.gradient
    left_out = np.tile(phi, (len(problem.measured), 1))
    if len(left_out) > 1:
        rest, pull = (hessian - weighted.hessian)[:, free][:, :, free], whole - push
        left_out[:, free] += linear_mixed.solve_scaled(rest, pull[:, free])
    onward = linear_mixed.bounded_solution(hessian, whole, 0.0 * phi, bounds - phi[:, None])
    beyond = _at_bound(phi + onward, bounds)
    # what a bound stops, or would with one more step, may not be profiled out: that is the likelihood beyond it
    inside = gram.keep(np.flatnonzero(~(at_bound | beyond)))
    ml = choose_variances(inside, problem.effects, variances, restricted=False)
    ml_deviance = deviance(inside, problem.effects, ml, restricted=False)
    channels = len(problem.counted)
    return MixedFit(
        names=problem.names,
        theta=problem.natural(phi),
        phi=phi,
        positive=problem.positive,
        covariance=covariance,
        left_out=left_out,
        noises=np.exp(variances[:channels]),
        factors=np.exp(variances[channels:]),
        run_effects=point.b,
        log_likelihood=-0.5 * (ml_deviance + int(problem.count.sum()) * np.log(2 * np.pi)),
        predictive=linear_mixed.predictive(gram, weighted, left_out - phi),
        fitted=point.fitted,
        at_bound=tuple(int(i) for i in np.flatnonzero(at_bound)),
        iterations=iterations,
        converged=converged,
        slots=problem.slots,
        gram=gram.keep(free),
        effects=problem.effects,
        known=problem.known,
    )
