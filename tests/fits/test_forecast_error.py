"""Least squares of forecasts beside likelihood: known truth, derived sensors, runs left out, what is preferred and
said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_driven import Sea, steered

from automarine_cli.dofs import SURGE, YAW
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import Predicted, follow, predict, smoothed
from automarine_cli.fits.driven import (
    ForecastScore,
    Judgement,
    base_starts,
    driven_problem,
    fit_driven,
    large_disturbance,
    prefer_driven,
    widened,
)
from automarine_cli.fits.forecast_error import ForecastFit, fit_forecasts, with_chance
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit, fit_innovations
from automarine_cli.fits.whole_runs import OutputErrorFit, rough_model
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.tables import interval
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

NOTHING = Estimate(0.0, 0.0, (0.0, 0.0), "1")


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


@cache
def forecasts() -> tuple[DrivenProblem, ForecastFit]:
    """Runs of commands that no controller sent, and their fit."""
    problem = problem_of(True, Sea(size=0.1))
    start = begin(problem)
    return problem, fit_forecasts(problem, problem.search(start), start[None])


@cache
def complete() -> InnovationsFit:
    return with_chance(*forecasts())


def test_parameters_come_back_within_their_own_errors() -> None:
    _, fit = forecasts()
    assert fit.converged and not fit.at_bound
    spread = fit.left_out[:, :2] - fit.phi[:2]
    error = np.sqrt(np.maximum((spread**2).sum(axis=0) * 0.75, np.diagonal(fit.covariance)[:2]))
    assert (np.abs(fit.phi[:2] - [0.0, 1.2]) < 3.2 * error).all()  # t with 3 degrees of freedom
    assert error[0] < 0.15


def test_what_is_random_is_fitted_beside_parameters_that_stay() -> None:
    (problem, fit), found = forecasts(), complete()
    assert np.array_equal(found.of_model, problem.natural(fit.phi)[:2])
    assert np.allclose(found.left_out[:, :2], fit.left_out[:, :2])
    assert 0.5 < found.of_chance["yaw.disturbance"] / 0.1 < 2.0
    assert np.isfinite(found.predictive).all()


def test_a_run_left_out_is_that_fit_to_the_others() -> None:
    problem, fit = forecasts()
    start = begin(problem)
    runs = steered(4, 3, Sea(size=0.1), length=40.0, free=True)
    others = driven_problem(problem.model, make_course(runs[1:], np.zeros(3, dtype=bool)))
    alone = fit_forecasts(others, problem.search(start), start[None])
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


def by_run(number: str, sizes: np.ndarray) -> tuple[str, tuple[Predicted, ...]]:
    """Errors of model `number` by run [rad], the same ones 2 and 5 s ahead."""
    run = np.arange(len(sizes))
    return number, tuple(Predicted(h, run, run, run, sizes, 9.0 * sizes, 9.0 * sizes) for h in (2.0, 5.0))


def three_models() -> dict[str, OutputErrorFit]:
    """With one outcome: only their numbers of parameters count."""
    found, start = complete(), begin(forecasts()[0])
    one = OutputErrorFit(
        "3", YawModel.base("3", 1.0, [1.0], "nu", YAW), {}, None, NOTHING, NOTHING, None, found, found.covariance, start
    )
    two = replace(one, number="2", model=YawModel.base("2", 1.0, [1.0, 1.0], "nu", YAW))
    return {"1": replace(one, number="1"), "2": two, "3": one}


def test_of_equally_simple_models_the_smaller_error_wins() -> None:
    """Model 3 is worse than model 1 in one run by far and so passes as level; model 1 is worse by a sure little."""
    ahead = dict([
        by_run("1", np.array([1.01, 1.02, 1.01, 1.02])), by_run("2", np.array([1.0, 1.0, 1.0, 1.0])),
        by_run("3", np.array([0.9, 1.0, 1.0, 1.6])),
    ])  # fmt: skip
    preference = prefer_driven(three_models(), ahead, YAW)
    assert preference is not None and preference.number == "1"


def test_a_disturbance_as_large_as_the_commands_is_said() -> None:
    course, fit = forecasts()[0].course, three_models()["3"]
    assert large_disturbance(course, fit) == ""
    found = fit.mixed
    theta = found.theta.copy()
    theta[found.names.index("yaw.disturbance")] = 2.0
    said = large_disturbance(course, replace(fit, mixed=replace(found, theta=theta)))
    assert said.startswith("The disturbance is as large as the commands: a moment of 2 nu where")


def test_a_fit_that_constants_beat_is_not_usable_whatever_fitted_it() -> None:
    worth = (ForecastScore(2.0, 1.0, 0.5, 2.0, 10), ForecastScore(5.0, 3.0, 4.0, 2.0, 10))
    judged = Judgement({"heading": worth}, 4)
    assert judged.warnings(YAW) == (judged.sentence(YAW),)
    assert judged.sentence(YAW).startswith("This model is not usable: it predicts 5 s ahead to")


def test_a_parameter_at_its_bound_has_no_interval() -> None:
    one = Estimate(0.3, 0.0, (0.3, 0.3), "1", at_bound=True)
    assert interval(one) == "0.3000 (at its bound)"
    assert one.to_json()["at_bound"] is True
    assert "at_bound" not in Estimate(0.3, 0.1, (0.1, 0.5), "1").to_json()


def test_a_velocity_alone_has_no_bias_and_its_sum_is_predicted() -> None:
    """Logged is a velocity that is 0.1 m/s throughout: two seconds ahead the vehicle is 0.2 m on, not nearer."""
    time = np.arange(0.0, 30.0, 0.25)
    speed = 0.1 + 0.002 * np.random.default_rng(0).standard_normal(len(time))
    run = Run(
        "drift", "", time, np.cumsum(speed) * 0.25, np.full(len(time), 0.1), "N", {SURGE.velocity: speed}, dof=SURGE
    )
    course = make_course([run], np.array([False]), channels=(SURGE.velocity,))
    model = YawModel.base("1", 1.0, [1.0], "N", SURGE)
    problem = driven_problem(model, course)
    theta = np.append(model.theta, [one.median for one in problem.random])
    predicted = predict(model, course, model.theta, problem.noises(theta[None]))
    assert predicted[0].rmse() < 0.01


def averaged_compass(run: Run) -> Run:
    """The run as a compass shows it that averages its last three readings."""
    total = np.cumsum(np.pad(run.position, (3, 0), mode="edge"))
    return replace(run, position=(total[3:] - total[:-3]) / 3)


@pytest.mark.slow
def test_intervals_hold_what_a_missing_delay_does() -> None:
    """A compass that averages delays what it shows: the truth lies beside the plain interval and within the wider."""
    runs = [averaged_compass(run) for run in steered(5, 1002, Sea(size=0.1), length=40.0)]
    course = make_course(runs, np.ones(5, dtype=bool))
    plain = fit_driven(course, rough_model("3", make_batch(runs, 0.1)), "3")
    wider, gains = widened(course, plain)
    assert list(gains) == ["input-delay"] and gains["input-delay"] > 50.0
    low, high = plain.estimates["I_r"].ci95
    assert not low < 1.0 < high
    for name, truth in (("I_r", 1.0), ("k_rr", 1.2)):
        low, high = wider.estimates[name].ci95
        assert low < truth < high and wider.estimates[name].value == plain.estimates[name].value


@pytest.mark.slow
def test_intervals_of_a_complete_model_stay() -> None:
    runs = steered(5, 1000, Sea(size=0.1), length=40.0)
    course = make_course(runs, np.ones(5, dtype=bool))
    plain = fit_driven(course, rough_model("3", make_batch(runs, 0.1)), "3")
    assert widened(course, plain) == (plain, {})


def test_left_out_fits_made_together_are_those_made_alone() -> None:
    problem = forecasts()[0]
    fit = fit_innovations(problem, begin(problem)[None])
    for r in (0, 3):
        others = replace(problem, course=problem.course.some(np.arange(4) != r))
        alone = fit_innovations(others, fit.theta[None], brief=True)
        assert np.allclose(fit.left_out[r, :2], alone.phi[:2], atol=0.02)
