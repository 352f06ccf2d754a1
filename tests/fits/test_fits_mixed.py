"""The mixed model's algebra against dense covariances, its search within bounds, and leaving runs out."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, optimize, special, stats
from tolerances import assert_close

from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed, whole_runs
from automarine_cli.fits.linear_mixed import (
    Block,
    Grams,
    NormalEquations,
    RunEffects,
    choose_variances,
    scored_deviance,
)
from automarine_cli.fits.mixed_model import MixedFit, Problem, Slot, fit_mixed, jackknife
from automarine_cli.fits.whole_runs import ENOUGH_RUNS, degrees_of_freedom, left_out_changes, run_covariance, run_dof
from automarine_cli.models.parameter import Parameter, Parameters

Floats = NDArray[np.float64]

RUNS, SAMPLES, PARAMETERS, EFFECTS = 10, 25, 2, 3
NOISES = {1: np.log([0.3, 0.6, 0.2]), 2: np.log([0.3, 0.8, 0.6, 0.2])}
"""By the number of sensors: the noise of each, and the factors of the second and third effect."""
VARIANCES = NOISES[1]
FREE = ((-np.inf, np.inf), (-np.inf, np.inf))
SENSORS = pytest.mark.parametrize("sensors", NOISES)
TRUTH = np.array([1.5, -0.8])


class Linear:
    """A linear problem whose answer dense matrices give: w = J theta + V b + noise, runs of unequal length."""

    def __init__(self, seed: int = 0, limits: tuple[tuple[float, float], ...] = ((1e-4, 10.0), (1e-4, 10.0))) -> None:
        rng = np.random.default_rng(seed)
        self.j = rng.normal(size=(RUNS, SAMPLES, PARAMETERS))
        self.v = rng.normal(size=(RUNS, SAMPLES, EFFECTS))
        self.seen = np.arange(SAMPLES) < rng.integers(15, SAMPLES + 1, RUNS)[:, None]
        scale = rng.uniform(0.5, 1.5, (RUNS, EFFECTS))
        scale[:, 0] = 10.0
        scale[2, 1] = 0.0  # one effect that one run does not have
        self.effects = RunEffects(
            (
                Block("start", scale[:, :1]),
                Block("gain", scale[:, 1:2], limits[0]),
                Block("instant", scale[:, 2:], limits[1]),
            )
        )
        b = self.effects.deviation(VARIANCES) * rng.normal(size=scale.shape)
        noise = np.exp(VARIANCES[0]) * rng.normal(size=self.seen.shape)
        self.w = self.j @ TRUTH + np.einsum("rnq,rq->rn", self.v, b) + noise
        for array in (self.j, self.v, self.w):
            array[~self.seen] = 0.0

    def problem(self, bounds: Sequence[tuple[float, float]] = FREE) -> Problem:
        def response(theta: Floats, b: Floats) -> Floats:
            return np.einsum("rnp,sp->srn", self.j, theta) + np.einsum("rnq,srq->srn", self.v, b)

        slots = (Slot("heading", slice(0, SAMPLES)),)
        parameters = Parameters(tuple(Parameter(name, 0.0, *ends) for name, ends in zip("ab", bounds)))
        return Problem(response, self.w, self.seen, self.effects, parameters, slots)

    def fit(self, bounds: Sequence[tuple[float, float]] = FREE, start: Sequence[float] = (0.0, 0.0)) -> MixedFit:
        return fit_mixed(self.problem(bounds), np.array(start), noise=1.0, factors=np.ones(2))

    def gram(self, phi: Floats | None = None, b: Floats | None = None, sensors: int = 1) -> Grams:
        """Linearised about phi and b, zero where not given; a second sensor reads all but the first twelve samples."""
        phi, b = np.zeros(PARAMETERS) if phi is None else phi, np.zeros((RUNS, EFFECTS)) if b is None else b
        residual = np.where(self.seen, self.w - self.j @ phi - np.einsum("rnq,rq->rn", self.v, b), 0.0)
        parts = (slice(0, 12), slice(12, SAMPLES)) if sensors == 2 else (slice(0, SAMPLES),)
        return Grams(
            tuple(
                NormalEquations.of(self.j[:, p], self.v[:, p], residual[:, p], self.seen[:, p].sum(axis=1), b)
                for p in parts
            )
        )

    def deviation(self, variances: Floats) -> Floats:
        """Noise (N,) of each sample, by its sensor."""
        return np.exp(variances[:-2])[np.minimum(np.arange(SAMPLES) // 12, len(variances) - 3)]

    def dense(self, variances: Floats = VARIANCES) -> list[tuple[Floats, Floats, Floats, Floats]]:
        """(J, V, w, R) of each run, R its covariance written out."""
        scale = self.effects.deviation(variances)
        rows = []
        for i, seen in enumerate(self.seen):
            v = self.v[i, seen]
            covariance = np.diag(self.deviation(variances)[seen] ** 2) + v @ np.diag(scale[i] ** 2) @ v.T
            rows.append((self.j[i, seen], v, self.w[i, seen], covariance))
        return rows

    def least_squares(self, variances: Floats = VARIANCES, without: int | None = None) -> tuple[Floats, Floats]:
        """Generalised least squares from dense covariances: theta and its information matrix."""
        used = [row for i, row in enumerate(self.dense(variances)) if i != without]
        hessian = sum((j.T @ np.linalg.solve(r, j) for j, _, _, r in used), np.zeros((PARAMETERS, PARAMETERS)))
        gradient = sum((j.T @ np.linalg.solve(r, w) for j, _, w, r in used), np.zeros(PARAMETERS))
        return np.linalg.solve(hessian, gradient), hessian

    def log_likelihood(self, variances: Floats = VARIANCES) -> float:
        theta, _ = self.least_squares(variances)
        parts = [stats.multivariate_normal(j @ theta, r).logpdf(w) for j, _, w, r in self.dense(variances)]
        return float(np.sum(parts))


@cache
def linear_fit() -> tuple[Linear, MixedFit]:
    linear = Linear(1)
    return linear, linear.fit()


@SENSORS
def test_likelihood_and_least_squares_are_those_of_the_dense_covariance(sensors: int) -> None:
    """Wherever it was linearised."""
    linear, variances, rng = Linear(4), NOISES[sensors], np.random.default_rng(4)
    theta, hessian = linear.least_squares(variances)
    scale, rows = linear.effects.deviation(variances), linear.dense(variances)
    effects = [np.diag(s**2) @ v.T @ np.linalg.solve(r, w - j @ theta) for s, (j, v, w, r) in zip(scale, rows)]
    for size in (0.0, 1.0):
        phi, b = size * rng.normal(size=PARAMETERS), size * rng.normal(size=(RUNS, EFFECTS))
        b[2, 1] = 0.0
        grams = linear.gram(phi, b, sensors)
        plain, restricted = (
            scored_deviance(grams, linear.effects, variances, restricted=own)[0] for own in (False, True)
        )
        constant = linear.seen.sum() * np.log(2 * np.pi)
        assert_close(-0.5 * (plain + constant), linear.log_likelihood(variances), "closed form")
        assert_close(restricted - plain, np.linalg.slogdet(hessian)[1], "closed form")
        weighted = linear_mixed.weigh(grams, linear.effects, variances)
        assert_close(weighted.hessian.sum(axis=0), hessian, "closed form")
        normal = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
        assert_close(phi + linear_mixed.bounded_solution(*normal, np.array(FREE)), theta, "closed form")
        assert_close(phi + linear_mixed.solve_scaled(*normal), theta, "closed form")
        found = linear_mixed.posterior_mean(grams, linear.effects, variances, theta - phi)
        assert_close(found, effects, "closed form")
        assert found[2, 1] == 0.0


def test_a_bounded_solution_is_the_best_of_all_active_sets() -> None:
    """Of curvatures that two parameters nearly share, as a delay and the common instant of the commands do."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        columns = rng.normal(size=(12, 4))
        columns[:, 3] = columns[:, 2] + 1e-4 * rng.normal(size=12)
        hessian, gradient = columns.T @ columns, 5.0 * rng.normal(size=4)
        bounds = np.stack([-rng.uniform(0.1, 2.0, 4), rng.uniform(0.1, 2.0, 4)], axis=1)
        bounds[0] = (-np.inf, np.inf)
        able = []
        for where in product((None, 0, 1), repeat=3):
            held = np.array([False, *(side is not None for side in where)])
            x = np.array([0.0, *(bounds[i + 1, side] if side is not None else 0.0 for i, side in enumerate(where))])
            push = gradient[~held] - hessian[np.ix_(~held, held)] @ x[held]
            x[~held] = np.linalg.solve(hessian[np.ix_(~held, ~held)], push)
            able += [float(0.5 * x @ hessian @ x - gradient @ x)] * bool(
                np.all((x >= bounds[:, 0] - 1e-12) & (x <= bounds[:, 1] + 1e-12))
            )
        solution = linear_mixed.bounded_solution(hessian, gradient, bounds)
        assert np.all((solution >= bounds[:, 0]) & (solution <= bounds[:, 1]))
        assert 0.5 * solution @ hessian @ solution - gradient @ solution == pytest.approx(min(able), rel=1e-6)


def test_headings_of_a_hundred_radians_do_not_drown_the_likelihood() -> None:
    """The lake runs: run effects explain 1e4 times the noise, and the deviance must still be smooth."""
    linear = Linear()
    b = np.full((RUNS, EFFECTS), 1e4)
    b[2, 1] = 0.0
    linear.w = linear.w + np.where(linear.seen, np.einsum("rnq,rq->rn", linear.v, b), 0.0)
    wide = RunEffects(tuple(replace(block, scale=1e5 * block.scale) for block in linear.effects.blocks))
    points = [
        scored_deviance(linear.gram(b=b), wide, VARIANCES + np.array([0.0, 1e-6 * i, 0.0]), restricted=True)[0]
        for i in range(9)
    ]
    second = np.diff(points, 2)
    assert np.max(np.abs(second)) < 1e-8


@SENSORS
@pytest.mark.parametrize("restricted", [False, True])
def test_the_slope_of_the_likelihood_is_exact(restricted: bool, sensors: int) -> None:
    linear, variances = Linear(3), NOISES[sensors]
    gram = linear.gram(b=np.where(linear.effects.scale > 0, 0.3, 0.0), sensors=sensors)

    def value(variances: Floats) -> float:
        return scored_deviance(gram, linear.effects, variances, restricted=restricted)[0]

    _, slope, _ = scored_deviance(gram, linear.effects, variances, restricted=restricted)
    steps = 1e-5 * np.eye(len(variances))
    numeric = [(value(variances + step) - value(variances - step)) / 2e-5 for step in steps]
    assert slope == pytest.approx(numeric, rel=1e-6, abs=1e-5)


def test_variances_are_those_of_greatest_restricted_likelihood() -> None:
    linear = Linear(1)

    def lost(v: Floats) -> float:
        _, hessian = linear.least_squares(v)
        return -2 * linear.log_likelihood(v) + float(np.linalg.slogdet(hessian)[1])

    best = optimize.minimize(lost, VARIANCES, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    found = choose_variances(linear.gram(), linear.effects, np.log([1.0, 1.0, 1.0]))
    assert found == pytest.approx(best.x, abs=1e-4)


def test_fit_of_a_linear_problem_is_generalised_least_squares() -> None:
    linear, fit = linear_fit()
    theta, hessian = linear.least_squares(np.log([fit.noise, *fit.factors]))
    assert fit.converged and fit.at_bound == ()
    assert_close(fit.theta, theta, "optimiser")
    assert_close(linear.fit(((0.0, 5.0), FREE[1]), (1.0, 1.0)).theta, theta, "optimiser")  # a bound not in the way
    assert fit.covariance == pytest.approx(np.linalg.inv(hessian), rel=1e-6, abs=1e-9)
    response = linear.j @ theta + np.einsum("rnq,rq->rn", linear.v, fit.run_effects)
    assert fit.fitted == pytest.approx(np.where(linear.seen, response, fit.fitted), abs=1e-6)
    assert np.abs(fit.theta - TRUTH).max() < 4 * np.sqrt(np.diagonal(fit.covariance)).max()
    best = optimize.minimize(lambda v: -linear.log_likelihood(v), VARIANCES, method="Nelder-Mead")
    assert fit.log_likelihood == pytest.approx(-best.fun, abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_a_fit_that_ends_with_a_small_gain_is_shorter_and_as_likely(seed: int) -> None:
    """Of a curved response, from far off: the likelihood lacks less than the least gain."""
    linear = Linear(seed)
    straight = linear.problem()

    def curved(theta: Floats, b: Floats) -> Floats:
        there = straight.response(theta, b)
        return np.asarray(there + 0.1 * there**2 + 0.05 * there**3)

    noise = linear.w - linear.j @ TRUTH
    measured = np.where(linear.seen, curved(TRUTH[None], np.zeros((1, RUNS, EFFECTS)))[0] + noise, 0.0)
    problem = replace(straight, response=curved, measured=measured)
    ends = [
        fit_mixed(problem, 3.0 * TRUTH, noise=1.0, factors=np.ones(2), settled=1e-6, least_gain=gain)
        for gain in (0.0, 0.5)
    ]
    assert ends[1].converged and ends[1].iterations < ends[0].iterations
    assert abs(ends[1].log_likelihood - ends[0].log_likelihood) < 0.5


def test_a_fit_promises_what_the_solution_of_its_equations_gains() -> None:
    linear = Linear(3)
    begun = fit_mixed(linear.problem(), 3.0 * TRUTH, noise=0.5, factors=np.ones(2), iterations=0)
    solution, _ = linear.least_squares(begun.variances)
    rows = linear.dense(begun.variances)
    there, reached = (
        sum(float((w - j @ theta) @ np.linalg.solve(r, w - j @ theta)) for j, _, w, r in rows)
        for theta in (begun.theta, solution)
    )
    assert_close(begun.promised, there - reached, "closed form")
    assert begun.promised > 100.0 and linear.fit().promised < 1e-3


def test_leaving_runs_out_is_exact_for_a_linear_problem() -> None:
    linear, fit = linear_fit()
    variances = np.log([fit.noise, *fit.factors])
    refits = np.array([linear.least_squares(variances, without=i)[0] for i in range(RUNS)])
    assert fit.left_out == pytest.approx(refits, abs=1e-7)
    densities = [
        stats.multivariate_normal(j @ theta, r).logpdf(w)
        for theta, (j, _, w, r) in zip(refits, linear.dense(variances))
    ]
    assert fit.predictive == pytest.approx(densities, abs=1e-5)
    spread = refits - refits.mean(axis=0)
    assert jackknife(fit.left_out) == pytest.approx((RUNS - 1) / RUNS * spread.T @ spread, rel=1e-5)


@pytest.mark.parametrize(("low", "high"), [(-np.inf, 0.5), (2.5, np.inf)])
def test_a_bound_is_kept_and_the_other_parameter_is_best_beside_it(low: float, high: float) -> None:
    linear, bounds = Linear(1), ((low, high), FREE[1])
    fit = linear.fit(bounds, np.clip([0.0, 0.0], low, high))
    edge = high if np.isfinite(high) else low
    theta, hessian = linear.least_squares(np.log([fit.noise, *fit.factors]))
    beside = theta[1] - hessian[1, 0] / hessian[1, 1] * (edge - theta[0])
    assert fit.at_bound == (0,) and fit.theta[0] == edge
    assert fit.theta[1] == pytest.approx(beside, rel=1e-6)
    assert np.all(fit.left_out[:, 0] == edge)
    curvature, follows = hessian[0, 0] - hessian[0, 1] ** 2 / hessian[1, 1], -hessian[0, 1] / hessian[1, 1]
    beyond = abs(theta[0] - edge) * np.sqrt(curvature)
    x = np.linspace(0.0, 40.0 / beyond, 100_001)
    tail = np.exp(-beyond * x - 0.5 * x**2)
    own = integrate.simpson(x**2 * tail, x=x) / integrate.simpson(tail, x=x) / curvature
    assert fit.of_bounds == pytest.approx(own * np.outer([1.0, follows], [1.0, follows]), rel=1e-6)
    assert fit.covariance - fit.of_bounds == pytest.approx(np.diag([0.0, 1 / hessian[1, 1]]), rel=1e-6)
    moved = left_out_changes(linear.problem(bounds), fit)
    assert np.all(moved[:, 0] == 0.0) and np.ptp(moved[:, 1]) > 0.0


def test_a_factor_stops_at_its_limits_and_its_interval_says_so() -> None:
    """The third effect scatters by 0.2: within limits below it the fit stands at the upper, above it at the lower."""
    below = fit_mixed(
        Linear(1, ((1e-4, 10.0), (1e-4, 0.02))).problem(), np.zeros(2), noise=1.0, factors=np.array([1.0, 0.01])
    )
    assert below.factors[1] == pytest.approx(0.02)
    assert below.factor_interval("instant")[1] == pytest.approx(0.02)
    above = fit_mixed(
        Linear(1, ((1e-4, 10.0), (5.0, 9.0))).problem(), np.zeros(2), noise=1.0, factors=np.array([1.0, 6.0])
    )
    assert above.factors[1] == pytest.approx(5.0)
    assert above.factor_interval("instant")[0] == 0.0  # nothing between the limit and zero was looked at


def test_interval_of_a_factor_holds_the_truth() -> None:
    held = 0
    for seed in range(30):
        fit = fit_mixed(Linear(seed).problem(), np.zeros(2), noise=0.5, factors=np.full(2, 0.5))
        low, high = fit.factor_interval("gain")
        assert low <= fit.factors[0] <= high
        held += low <= 0.6 <= high
    assert held >= 25  # 28.5 expected; fewer than 25 has one chance in a hundred


def test_what_cannot_be_fitted_is_refused() -> None:
    linear = Linear()
    broken = replace(linear.problem(), response=lambda theta, b: np.full((len(theta), RUNS, SAMPLES), np.inf))
    with np.errstate(invalid="ignore"), pytest.raises(FitError, match="no motion of a vehicle fits these runs"):
        fit_mixed(broken, np.zeros(2), noise=1.0, factors=np.ones(2))
    linear.seen[:] = False
    linear.seen[0, :3] = True
    with pytest.raises(FitError, match="3 samples cannot carry 2 parameters; give more or longer runs"):
        linear.fit()


# How far each run pulls the parameters


def test_of_a_linear_problem_it_is_the_linearised_jackknife(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_runs, "ENOUGH_RUNS", RUNS)
    linear, fit = linear_fit()
    moved, expected = left_out_changes(linear.problem(), fit), fit.left_out - fit.phi
    np.testing.assert_allclose(moved, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    np.testing.assert_allclose(
        run_covariance(fit, left_out_changes(linear.problem(), fit)), jackknife(fit.left_out), rtol=1e-2, atol=1e-9
    )


def slope_fit(steep: Floats, seed: int = 1) -> MixedFit:
    """One common slope of 2 through runs of such reach (R,)."""
    x = steep[:, None] * np.linspace(0.1, 1.0, 30)
    noise = 0.1 * np.random.default_rng(seed).standard_normal(x.shape)
    problem = Problem(
        lambda theta, b: theta[:, 0, None, None] * x + b[:, :, :1], 2.0 * x + noise, np.ones(x.shape, dtype=bool),
        RunEffects((Block("offset", np.zeros((len(x), 1))),)), Parameters((Parameter("slope", 0.0),)),
        (Slot("heading", slice(0, 30)),),
    )  # fmt: skip
    return fit_mixed(problem, np.ones(1), noise=0.2, factors=np.array([]))


def test_two_runs_that_carry_a_parameter_count_as_two() -> None:
    """Runs of equal reach, and runs of which all but two show next to nothing."""
    few = np.full(10, 0.01)
    few[[2, 7]] = 1.0
    for steep, expected in ((np.ones(10), 9.0), (few, 2 * 9 / 10)):
        fit = slope_fit(steep)
        assert degrees_of_freedom(fit, np.ones(1)) == pytest.approx(expected, rel=1e-2 if expected < 9.0 else 1e-6)


def test_what_one_run_shows_has_the_error_of_its_readings() -> None:
    """Leaving out any of the nine others moves the slope by nothing, and says nothing of its error."""
    steep = np.where(np.arange(10) == 3, 1.0, 0.0)
    fits = [slope_fit(steep, seed) for seed in range(40)]
    errors = np.array([fit.theta[0] - 2.0 for fit in fits])
    stderrs = np.sqrt([run_covariance(fit)[0, 0] for fit in fits])
    reach = special.stdtrit([run_dof(fit, np.ones(1)) for fit in fits], 0.975)
    assert 0.75 < np.sqrt(np.mean((errors / stderrs) ** 2)) < 1.25  # 1 expected, with an error of 0.11
    assert np.mean(np.abs(errors) < reach * stderrs) >= 0.875
    assert np.all(reach < 2.3)
    alike = [slope_fit(np.ones(ENOUGH_RUNS), seed) for seed in range(40)]
    spreads = np.array([(jackknife(fit.left_out)[0, 0], fit.inside_bounds[0, 0]) for fit in alike])
    assert [run_covariance(fit)[0, 0] for fit in alike] == pytest.approx(spreads[:, 0])
    few = [slope_fit(np.ones(ENOUGH_RUNS - 1), seed) for seed in range(40)]
    spreads = np.array([(jackknife(fit.left_out)[0, 0], fit.inside_bounds[0, 0]) for fit in few])
    assert [run_covariance(fit)[0, 0] for fit in few] == pytest.approx(spreads.max(axis=1))
    assert 0 < np.mean(spreads[:, 0] < spreads[:, 1]) < 1
