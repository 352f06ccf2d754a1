"""The mixed model's algebra against dense covariances, its search within bounds, and leaving runs out."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats
from tolerances import assert_close

from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.linear_mixed import Block, Gram, Grams, RunEffects, choose_variances, deviance, scored_deviance
from automarine_cli.fits.mixed_model import Problem, Slot, fit_mixed, jackknife

Floats = NDArray[np.float64]

RUNS, SAMPLES, PARAMETERS, EFFECTS = 6, 25, 2, 3
VARIANCES = np.log([0.3, 0.6, 0.2])  # noise, and the factors of the second and third effect
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

    def problem(self, low: float = -np.inf, high: float = np.inf) -> Problem:
        def response(theta: Floats, b: Floats) -> Floats:
            return np.einsum("rnp,sp->srn", self.j, theta) + np.einsum("rnq,srq->srn", self.v, b)

        bounds = np.array([(low, high), (-np.inf, np.inf)])
        slots = (Slot("heading", slice(0, SAMPLES)),)
        return Problem(
            response, self.w, self.seen, self.effects, bounds, np.zeros(2, dtype=bool), ("one", "two"), slots
        )

    def gram(self, phi: Floats | None = None, b: Floats | None = None) -> Grams:
        """Linearised about phi and b, zero where not given."""
        phi, b = np.zeros(PARAMETERS) if phi is None else phi, np.zeros((RUNS, EFFECTS)) if b is None else b
        residual = np.where(self.seen, self.w - self.j @ phi - np.einsum("rnq,rq->rn", self.v, b), 0.0)
        return Grams((Gram.of(self.j, self.v, residual, self.seen.sum(axis=1), b),))

    def dense(self, variances: Floats = VARIANCES) -> list[tuple[Floats, Floats, Floats, Floats]]:
        """(J, V, w, R) of each run, R its covariance written out."""
        scale = self.effects.deviation(variances)
        rows = []
        for i, seen in enumerate(self.seen):
            v = self.v[i, seen]
            covariance = np.exp(2 * variances[0]) * np.eye(len(v)) + v @ np.diag(scale[i] ** 2) @ v.T
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


def test_likelihood_is_that_of_the_dense_covariance() -> None:
    linear = Linear()
    _, hessian = linear.least_squares()
    constant = linear.seen.sum() * np.log(2 * np.pi)
    found = deviance(linear.gram(), linear.effects, VARIANCES, restricted=False)
    assert_close(-0.5 * (found + constant), linear.log_likelihood(), "closed form")
    restricted = deviance(linear.gram(), linear.effects, VARIANCES, restricted=True)
    assert_close(restricted - found, np.linalg.slogdet(hessian)[1], "closed form")


def test_least_squares_and_run_effects_are_those_of_the_dense_covariance() -> None:
    linear = Linear()
    theta, hessian = linear.least_squares()
    weighted = linear_mixed.weigh(linear.gram(), linear.effects, VARIANCES)
    free = np.array([(-np.inf, np.inf)] * PARAMETERS)
    assert_close(
        linear_mixed.bounded_solution(weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0), free),
        theta,
        "closed form",
    )
    assert_close(weighted.hessian.sum(axis=0), hessian, "closed form")
    scale = linear.effects.deviation(VARIANCES)
    expected = [
        np.diag(s**2) @ v.T @ np.linalg.solve(r, w - j @ theta) for s, (j, v, w, r) in zip(scale, linear.dense())
    ]
    found = linear_mixed.posterior_mean(linear.gram(), linear.effects, VARIANCES, theta)
    assert_close(found, expected, "closed form")
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


def test_the_point_of_linearisation_does_not_matter_to_a_linear_problem() -> None:
    linear = Linear()
    rng = np.random.default_rng(4)
    phi, b = rng.normal(size=PARAMETERS), rng.normal(size=(RUNS, EFFECTS))
    b[2, 1] = 0.0
    theta, _ = linear.least_squares()
    here, there = linear.gram(), linear.gram(phi, b)
    for restricted in (False, True):
        two = [deviance(g, linear.effects, VARIANCES, restricted=restricted) for g in (here, there)]
        assert_close(two[0], two[1], "closed form")
    found = linear_mixed.posterior_mean(there, linear.effects, VARIANCES, theta - phi)
    assert_close(found, linear_mixed.posterior_mean(here, linear.effects, VARIANCES, theta), "closed form")


def test_headings_of_a_hundred_radians_do_not_drown_the_likelihood() -> None:
    """The lake runs: run effects explain 1e4 times the noise, and the deviance must still be smooth."""
    linear = Linear()
    b = np.full((RUNS, EFFECTS), 1e4)
    b[2, 1] = 0.0
    linear.w = linear.w + np.where(linear.seen, np.einsum("rnq,rq->rn", linear.v, b), 0.0)
    wide = RunEffects(tuple(replace(block, scale=1e5 * block.scale) for block in linear.effects.blocks))
    points = [
        deviance(linear.gram(b=b), wide, VARIANCES + np.array([0.0, 1e-6 * i, 0.0]), restricted=True) for i in range(9)
    ]
    second = np.diff(points, 2)
    assert np.max(np.abs(second)) < 1e-8


@pytest.mark.parametrize("restricted", [False, True])
def test_the_slope_of_the_likelihood_is_exact(restricted: bool) -> None:
    linear = Linear(3)
    gram = linear.gram(b=np.where(linear.effects.scale > 0, 0.3, 0.0))

    def value(variances: Floats) -> float:
        return deviance(gram, linear.effects, variances, restricted=restricted)

    _, slope, _ = scored_deviance(gram, linear.effects, VARIANCES, restricted=restricted)
    steps = 1e-5 * np.eye(len(VARIANCES))
    numeric = [(value(VARIANCES + step) - value(VARIANCES - step)) / 2e-5 for step in steps]
    assert slope == pytest.approx(numeric, rel=1e-6, abs=1e-5)


def two_channels(seed: int) -> tuple[Linear, Grams]:
    """The first twelve readings of each run are of one sensor, the rest of another."""
    linear = Linear(seed)
    b = np.where(linear.effects.scale > 0, 0.3, 0.0)
    left = np.where(linear.seen, linear.w - np.einsum("rnq,rq->rn", linear.v, b), 0.0)
    parts = (slice(0, 12), slice(12, SAMPLES))
    channels = tuple(
        Gram.of(linear.j[:, p], linear.v[:, p], left[:, p], linear.seen[:, p].sum(axis=1), b) for p in parts
    )
    return linear, Grams(channels)


TWO_NOISES = np.log([0.3, 0.8, 0.6, 0.2])


def test_two_channels_have_the_likelihood_of_their_dense_covariance() -> None:
    linear, grams = two_channels(4)
    deviation = np.where(np.arange(SAMPLES) < 12, 0.3, 0.8)
    scale = linear.effects.deviation(TWO_NOISES)
    hessian, gradient, rows = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS), []
    for i, seen in enumerate(linear.seen):
        v, j, w = linear.v[i, seen], linear.j[i, seen], linear.w[i, seen]
        covariance = np.diag(deviation[seen] ** 2) + v @ np.diag(scale[i] ** 2) @ v.T
        hessian += j.T @ np.linalg.solve(covariance, j)
        gradient += j.T @ np.linalg.solve(covariance, w)
        rows.append((j, w, covariance))
    theta = np.linalg.solve(hessian, gradient)
    logs = [stats.multivariate_normal(j @ theta, r).logpdf(w) for j, w, r in rows]
    found = deviance(grams, linear.effects, TWO_NOISES, restricted=False)
    expected = -2.0 * np.sum(logs) - linear.seen.sum() * np.log(2 * np.pi)
    assert_close(np.array(found), np.array(expected), "closed form")
    weighted = linear_mixed.weigh(grams, linear.effects, TWO_NOISES)
    assert_close(
        linear_mixed.solve_scaled(weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)), theta, "closed form"
    )


@pytest.mark.parametrize("restricted", [False, True])
def test_the_slope_by_each_channels_noise_is_exact(restricted: bool) -> None:
    linear, grams = two_channels(5)

    def value(variances: Floats) -> float:
        return deviance(grams, linear.effects, variances, restricted=restricted)

    _, slope, _ = scored_deviance(grams, linear.effects, TWO_NOISES, restricted=restricted)
    steps = 1e-5 * np.eye(len(TWO_NOISES))
    numeric = [(value(TWO_NOISES + step) - value(TWO_NOISES - step)) / 2e-5 for step in steps]
    assert slope == pytest.approx(numeric, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("channels", [1, 2])
def test_expected_second_derivatives_are_those_of_the_dense_covariance(channels: int) -> None:
    linear, grams = two_channels(6)
    variances, noises = TWO_NOISES, [0.3, 0.8]
    if channels == 1:
        grams, variances, noises = linear.gram(), VARIANCES, [0.3, 0.3]
    scale = linear.effects.deviation(variances)
    expected = np.zeros((len(variances), len(variances)))
    for i, seen in enumerate(linear.seen):
        v, first = linear.v[i, seen], np.arange(SAMPLES)[seen] < 12
        squares = np.where(first, *np.square(noises))
        own = [np.diag(squares * one) for one in ((first, ~first) if channels == 2 else (np.ones(len(v)),))]
        slopes = [2.0 * one for one in own]
        slopes += [2.0 * v[:, k : k + 1] * scale[i, k] ** 2 @ v[:, k : k + 1].T for k in (1, 2)]
        inverse = np.linalg.inv(np.diag(squares) + v @ np.diag(scale[i] ** 2) @ v.T)
        expected += [[np.trace(inverse @ one @ inverse @ other) for one in slopes] for other in slopes]
    _, _, found = scored_deviance(grams, linear.effects, variances, restricted=False)
    assert_close(found, expected, "closed form")


def test_variances_are_those_of_greatest_restricted_likelihood() -> None:
    linear = Linear(1)

    def lost(v: Floats) -> float:
        _, hessian = linear.least_squares(v)
        return -2 * linear.log_likelihood(v) + float(np.linalg.slogdet(hessian)[1])

    best = optimize.minimize(lost, VARIANCES, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    found = choose_variances(linear.gram(), linear.effects, np.log([1.0, 1.0, 1.0]))
    assert found == pytest.approx(best.x, abs=1e-4)


def test_fit_of_a_linear_problem_is_generalised_least_squares() -> None:
    linear = Linear(1)
    fit = fit_mixed(linear.problem(), np.zeros(2), noise=1.0, factors=np.ones(2))
    variances = np.log([fit.noise, *fit.factors])
    theta, hessian = linear.least_squares(variances)
    assert fit.converged and fit.at_bound == ()
    assert_close(fit.theta, theta, "optimiser")
    assert fit.covariance == pytest.approx(np.linalg.inv(hessian), rel=1e-6, abs=1e-9)
    assert fit.fitted == pytest.approx(
        np.where(linear.seen, linear.j @ theta + np.einsum("rnq,rq->rn", linear.v, fit.run_effects), fit.fitted),
        abs=1e-6,
    )
    assert np.abs(fit.theta - TRUTH).max() < 4 * np.sqrt(np.diagonal(fit.covariance)).max()


def test_leaving_runs_out_is_exact_for_a_linear_problem() -> None:
    linear = Linear(1)
    fit = fit_mixed(linear.problem(), np.zeros(2), noise=1.0, factors=np.ones(2))
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


def test_log_likelihood_is_the_greatest_of_all_variances() -> None:
    linear = Linear(1)
    fit = fit_mixed(linear.problem(), np.zeros(2), noise=1.0, factors=np.ones(2))
    best = optimize.minimize(lambda v: -linear.log_likelihood(v), VARIANCES, method="Nelder-Mead")
    assert fit.log_likelihood == pytest.approx(-best.fun, abs=1e-4)


@pytest.mark.parametrize(("low", "high"), [(-np.inf, 0.5), (2.5, np.inf)])
def test_a_bound_is_kept_and_the_other_parameter_is_best_beside_it(low: float, high: float) -> None:
    linear = Linear(1)
    fit = fit_mixed(linear.problem(low, high), np.clip(np.zeros(2), low, high), noise=1.0, factors=np.ones(2))
    edge = high if np.isfinite(high) else low
    theta, hessian = linear.least_squares(np.log([fit.noise, *fit.factors]))
    beside = theta[1] - hessian[1, 0] / hessian[1, 1] * (edge - theta[0])
    assert fit.at_bound == (0,) and fit.theta[0] == edge
    assert fit.theta[1] == pytest.approx(beside, rel=1e-6)
    assert np.all(fit.covariance[0] == 0) and np.all(fit.left_out[:, 0] == edge)
    assert fit.covariance[1, 1] == pytest.approx(1 / hessian[1, 1], rel=1e-6)


def test_a_bound_that_is_not_in_the_way_changes_nothing() -> None:
    linear = Linear(1)
    free = fit_mixed(linear.problem(), np.zeros(2), noise=1.0, factors=np.ones(2))
    bound = fit_mixed(linear.problem(0.0, 5.0), np.ones(2), noise=1.0, factors=np.ones(2))
    assert_close(bound.theta, free.theta, "optimiser")
    assert bound.at_bound == ()


def test_an_effect_of_no_scale_stays_at_zero_and_counts_for_nothing() -> None:
    linear = Linear(1)
    without = RunEffects(linear.effects.blocks[:2])
    zero = replace(linear.problem(), effects=linear.effects.with_scale(instant=0.0))
    fit = fit_mixed(zero, np.zeros(2), noise=1.0, factors=np.ones(2))
    linear.v = linear.v[:, :, :2]
    smaller = replace(linear.problem(), effects=without)
    expected = fit_mixed(smaller, np.zeros(2), noise=1.0, factors=np.ones(1))
    assert np.all(fit.run_effects[:, 2] == 0.0)
    assert fit.theta == pytest.approx(expected.theta, rel=1e-6)
    assert fit.noise == pytest.approx(expected.noise, rel=1e-5)


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


def test_fewer_samples_than_parameters_are_refused() -> None:
    linear = Linear()
    linear.seen[:] = False
    linear.seen[0, :3] = True
    with pytest.raises(FitError, match="3 samples cannot carry 2 parameters; give more or longer runs"):
        fit_mixed(linear.problem(), np.zeros(2), noise=1.0, factors=np.ones(2))


def test_a_response_that_is_not_finite_at_the_start_is_refused() -> None:
    linear = Linear()
    broken = replace(linear.problem(), response=lambda theta, b: np.full((len(theta), RUNS, SAMPLES), np.inf))
    with np.errstate(invalid="ignore"), pytest.raises(FitError, match="no motion of a vehicle fits these runs"):
        fit_mixed(broken, np.zeros(2), noise=1.0, factors=np.ones(2))
