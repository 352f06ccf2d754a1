"""Least squares of forecasts: known truth, disturbances that hide the response from likelihood, runs left out."""

import numpy as np
from made_driven import Sea, steered

from automarine_cli.dofs import YAW
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import follow, smoothed
from automarine_cli.fits.driven import base_starts, driven_problem
from automarine_cli.fits.forecast_error import fit_forecasts, with_chance
from automarine_cli.fits.innovations_problem import DrivenProblem
from automarine_cli.models.yaw_model import YawModel


def problem_of(free: bool, sea: Sea, count: int = 4) -> DrivenProblem:
    """Model 3 on made runs, from values that are off by half."""
    runs = steered(count, 3, sea, length=40.0, free=free)
    model = YawModel.base("3", 1.5, [0.8], "nu", YAW)
    return driven_problem(model, make_course(runs, np.zeros(count, dtype=bool)))


def begin(problem: DrivenProblem) -> np.ndarray:
    """A start with what is random in the middle of its range."""
    theta = base_starts(problem)[0]
    theta[: len(problem.model.theta)] = problem.model.theta
    return theta


def test_parameters_come_back_within_their_own_errors() -> None:
    problem = problem_of(True, Sea(size=0.1))
    start = begin(problem)
    fit = fit_forecasts(problem, problem.search(start), start[None])
    assert fit.converged and not fit.at_bound
    spread = fit.left_out[:, :2] - fit.phi[:2]
    error = np.sqrt(np.maximum((spread**2).sum(axis=0) * 0.75, np.diagonal(fit.covariance)[:2]))
    assert (np.abs(fit.phi[:2] - [0.0, 1.2]) < 3.2 * error).all()  # t with 3 degrees of freedom
    assert error[0] < 0.15


def test_what_is_random_is_fitted_beside_parameters_that_stay() -> None:
    problem = problem_of(True, Sea(size=0.1))
    start = begin(problem)
    fit = fit_forecasts(problem, problem.search(start), start[None])
    found = with_chance(problem, fit)
    assert np.array_equal(found.of_model, problem.natural(fit.phi)[:2])
    assert np.allclose(found.left_out[:, :2], fit.left_out[:, :2])
    assert 0.5 < found.of_chance["yaw.disturbance"] / 0.1 < 2.0
    assert np.isfinite(found.predictive).all()


def test_a_run_left_out_is_that_fit_to_the_others() -> None:
    problem = problem_of(True, Sea(size=0.1))
    start = begin(problem)
    phi = problem.search(start)
    fit = fit_forecasts(problem, phi, start[None])
    runs = steered(4, 3, Sea(size=0.1), length=40.0, free=True)
    others = driven_problem(problem.model, make_course(runs[1:], np.zeros(3, dtype=bool)))
    alone = fit_forecasts(others, phi, start[None])
    assert np.allclose(fit.left_out[0, :2], alone.phi[:2], atol=0.1 * np.sqrt(alone.covariance[0, 0]))


def test_states_by_later_readings_too_are_nearer_to_the_truth_and_end_as_filtered() -> None:
    problem = problem_of(True, Sea(size=0.1, noise_deg=2.0))
    theta = begin(problem)
    theta[:2] = 1.0, 1.2
    noises = problem.noises(theta[None])
    after = smoothed(problem.model, problem.course, theta[:2], noises)
    before = follow(problem.model, problem.course, theta[None, :2], noises, keep=True)
    assert after.states is not None and before.states is not None
    assert np.allclose(after.states[..., -1], before.states[..., -1])
    truth = [run.position for run in steered(4, 3, Sea(size=0.1, noise_deg=0.0), length=40.0, free=True)]
    last = min(len(one) for one in truth) - 1
    runs = steered(4, 3, Sea(size=0.1, noise_deg=2.0), length=40.0, free=True)
    at = [np.interp(problem.course.time[r], runs[r].time - runs[r].time[0], truth[r]) for r in range(4)]
    missed = [np.std((states[0, 0] - np.array(at))[:, 8:last]) for states in (after.states, before.states)]
    assert missed[0] < 0.8 * missed[1]
