"""How far each run pulls the parameters: against refits without it, and against algebra where the problem is linear."""

from dataclasses import replace

import numpy as np
import pytest
from made_campaigns import both_ways, campaign
from made_runs import mirrored

from automarine_cli.fits.half_turns import half_turn_data, step_problem
from automarine_cli.fits.linear_mixed import Block, RunEffects
from automarine_cli.fits.mixed_model import MixedFit, Problem, Slot, fit_mixed, jackknife
from automarine_cli.fits.whole_runs import degrees_of_freedom, left_out_changes, run_covariance
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run

RUNS = 10


WHOLE = (Slot("heading", slice(0, 30)),)


def linear_problem(seed: int = 0) -> Problem:
    """Lines with a slope and a common offset, and an offset of each run that scatters."""
    random = np.random.default_rng(seed)
    x = random.uniform(size=(RUNS, 30))
    measured = 2.0 * x + 0.5 + 0.3 * random.standard_normal((RUNS, 1)) + 0.1 * random.standard_normal(x.shape)

    def response(theta: np.ndarray, b: np.ndarray) -> np.ndarray:
        return theta[:, 0, None, None] * x + theta[:, 1, None, None] + b[:, :, :1]

    effects = RunEffects((Block("offset", np.ones((RUNS, 1)), (1e-3, 2.0)),))
    free = np.array([[-np.inf, np.inf]] * 2)
    return Problem(
        response, measured, np.ones(x.shape, dtype=bool), effects, free, np.zeros(2, dtype=bool), ("a", "b"), WHOLE
    )


def test_of_a_linear_problem_it_is_the_linearised_jackknife() -> None:
    problem = linear_problem()
    fit = fit_mixed(problem, np.zeros(2), noise=0.2, factors=np.array([0.2]))
    moved = left_out_changes(problem, fit)
    expected = fit.left_out - fit.phi
    np.testing.assert_allclose(moved, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    np.testing.assert_allclose(run_covariance(fit, problem), jackknife(fit.left_out), rtol=1e-2, atol=1e-9)


def fitted(runs: list[Run], of: MixedFit | None = None) -> tuple[Problem, MixedFit]:
    """Model 3 on half-turns, well settled; with the scatter of another fit held where one is given."""
    problem = step_problem(half_turn_data(half_turns(runs)[0]), "3")
    begin, noise, factors = np.array([1.2, 1.0, 0.0]), 0.02, np.array([0.03, 0.5])
    if of is not None:
        held = tuple((f, f * (1 + 1e-9)) for f in of.factors)
        limits = dict(zip(problem.effects.factor_names, held))
        blocks = tuple(replace(block, limits=limits.get(block.name)) for block in problem.effects.blocks)
        problem = replace(problem, effects=RunEffects(blocks))
        begin, noise, factors = of.theta, of.noise, of.factors
    return problem, fit_mixed(problem, begin, noise=noise, factors=factors, settled=1e-5)


def test_a_refit_without_a_run_moves_as_far_as_foreseen() -> None:
    """Quiet runs whose instants are uniform in their sample intervals: the linearised change is often far off."""
    runs = campaign(both_ways((0.3, 0.5, 0.7, 0.9, 1.1)), seed=4)
    problem, fit = fitted(runs)
    foreseen, linearised = left_out_changes(problem, fit), fit.left_out - fit.phi
    found = np.array(
        [fitted([r for j, r in enumerate(runs) if j != i], of=fit)[1].phi - fit.phi for i in range(len(runs))]
    )
    for i in range(2):
        size = np.sqrt(np.mean(found[:, i] ** 2))
        assert np.sqrt(np.mean((foreseen - found)[:, i] ** 2)) < 0.35 * size
    wrong, right = (np.linalg.norm((one - found)[:, 0]) for one in (linearised, foreseen))
    assert right < 0.6 * wrong


def test_mirrored_runs_have_the_same_covariance() -> None:
    runs = campaign(both_ways((0.4, 0.7, 1.0, 1.2)), seed=5, gain_scatter=0.03)
    there, back = (run_covariance(fit, problem) for problem, fit in (fitted(runs), fitted([mirrored(r) for r in runs])))
    np.testing.assert_allclose(back, there, rtol=1e-3, atol=1e-3 * there[:2, :2].max())


def test_a_parameter_at_its_bound_does_not_move() -> None:
    problem = linear_problem()
    kept = replace(problem, bounds=np.array([[-np.inf, 1.5], [-np.inf, np.inf]]))
    fit = fit_mixed(kept, np.zeros(2), noise=0.2, factors=np.array([0.2]))
    assert fit.at_bound == (0,)
    moved = left_out_changes(kept, fit)
    assert np.all(moved[:, 0] == 0.0) and np.ptp(moved[:, 1]) > 0.0


def test_jackknife_of_means_is_the_error_of_the_mean() -> None:
    values = np.random.default_rng(3).standard_normal(40)
    without = (values.sum() - values) / 39 - values.mean()
    assert jackknife(without[:, None])[0, 0] == pytest.approx(values.var(ddof=1) / 40)


def lines(steep: np.ndarray) -> MixedFit:
    """One common slope through runs whose abscissae reach as far as `steep` says."""
    x = steep[:, None] * np.linspace(0.1, 1.0, 30)
    noise = 0.1 * np.random.default_rng(1).standard_normal(x.shape)
    problem = Problem(
        lambda theta, b: theta[:, 0, None, None] * x + b[:, :, :1], 2.0 * x + noise, np.ones(x.shape, dtype=bool),
        RunEffects((Block("offset", np.zeros((len(steep), 1))),)), np.array([[-np.inf, np.inf]]),
        np.zeros(1, dtype=bool), ("slope",), WHOLE,
    )  # fmt: skip
    return fit_mixed(problem, np.ones(1), noise=0.2, factors=np.array([]))


def test_equal_runs_all_count() -> None:
    assert degrees_of_freedom(lines(np.ones(RUNS)), np.ones(1)) == pytest.approx(RUNS - 1)


def test_two_runs_that_carry_a_parameter_count_as_two() -> None:
    """Ten runs, of which eight show next to nothing of the slope."""
    steep = np.full(RUNS, 0.01)
    steep[[2, 7]] = 1.0
    assert degrees_of_freedom(lines(steep), np.ones(1)) == pytest.approx(2 * (RUNS - 1) / RUNS, rel=1e-2)


def test_a_direction_that_cannot_move_has_the_runs_less_one() -> None:
    problem = linear_problem()
    fit = fit_mixed(replace(problem, bounds=np.array([[-1.0, 1.5], [-1.0, -0.5]])), np.zeros(2), noise=1.0,
                    factors=np.array([0.2]))  # fmt: skip
    assert fit.at_bound == (0, 1)
    assert degrees_of_freedom(fit, np.array([1.0, 0.0])) == RUNS - 1
    assert np.all(run_covariance(fit, problem) == 0.0)
