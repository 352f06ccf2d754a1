"""Least squares of forecasts beside likelihood: known truth, derived sensors, runs left out, what is preferred and
said."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from identified import driven_fit, identify
from made_driven import Sea, steered

from automarine_cli.comparison.validation import compare, with_predictions
from automarine_cli.dofs import YAW
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.kalman import Predicted, follow, predict, smoothed
from automarine_cli.fits import driven
from automarine_cli.fits.driven import FLATTERED, base_starts, driven_problem, inflate_for_missing, large_disturbance
from automarine_cli.fits.forecast_error import ForecastFit, fit_forecasts, with_chance
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit, fit_innovations
from automarine_cli.fits.preference import prefer_driven
from automarine_cli.fits.whole_runs import OutputErrorFit, rough_model, run_covariance, run_dof
from automarine_cli.models.model import Model
from automarine_cli.models.store import read_model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate


def problem_of(runs: Sequence[Run]) -> DrivenProblem:
    """Model 3 on made runs, from values that are off by half."""
    model = Model.base("3", 1.5, [0.8], "nu", YAW)
    return driven_problem(model, make_course(runs, np.zeros(len(runs), dtype=bool)))


@cache
def free_runs(sea: Sea | None = None) -> list[Run]:
    """Runs of commands that no controller sent."""
    return steered(4, 3, sea, length=40.0, free=True)


def begin(problem: DrivenProblem) -> np.ndarray:
    """A start with what is random in the middle of its range."""
    theta = base_starts(problem)[0]
    theta[: len(problem.model.theta)] = problem.model.theta
    return theta


@cache
def forecasts() -> tuple[DrivenProblem, ForecastFit]:
    problem = problem_of(free_runs())
    start = begin(problem)
    return problem, fit_forecasts(problem, problem.parameters.search(start), start[None])


@cache
def complete() -> InnovationsFit:
    problem, fit = forecasts()
    (mixed,) = with_chance([problem], [fit])
    assert mixed is not None
    return mixed


def test_parameters_come_back_within_their_own_errors_and_stay_beside_what_is_random() -> None:
    problem, fit = forecasts()
    assert fit.converged and not fit.at_bound
    spread = fit.left_out[:, :2] - fit.phi[:2]
    error = np.sqrt(np.maximum((spread**2).sum(axis=0) * 0.75, np.diagonal(fit.covariance)[:2]))
    assert (np.abs(fit.phi[:2] - [0.0, 1.2]) < 3.2 * error).all()  # t with 3 degrees of freedom
    assert error[0] < 0.15
    whole = complete()
    assert np.array_equal(whole.of_model, problem.parameters.natural(fit.phi)[:2])
    assert np.allclose(whole.left_out[:, :2], fit.left_out[:, :2]) and np.isfinite(whole.predictive).all()
    assert 0.5 < whole.of_chance["yaw.disturbance"] / 0.1 < 2.0


def test_few_runs_that_scatter_no_more_than_their_forecasts_count_by_these() -> None:
    fit, axis = complete(), np.eye(len(complete().phi))[0]
    assert fit.forecasts == 32.0  # four runs of 40 s, five seconds each
    for scatter, dof in ((0.1, fit.forecasts), (3.0, 3.0)):
        moved = np.outer([1.0, -1.0, 1.0, -1.0], scatter * np.sqrt(fit.covariance[0, 0] / 3.0) * axis)
        few = replace(fit, left_out=fit.phi + moved)
        assert run_dof(few, axis) == dof
        assert run_covariance(few)[0, 0] == pytest.approx(max(scatter, 1.0) ** 2 * fit.covariance[0, 0])


@pytest.mark.slow
def test_the_covariance_of_forecasts_that_overlap_is_that_of_the_spread_over_seeds() -> None:
    """The variance, and not the inverse curvature, which takes the noise of readings for what lasts."""
    missed = []
    for seed in range(20):
        problem = problem_of(steered(3, 100 + seed, None, length=40.0, free=True))
        start = begin(problem)
        fit = fit_forecasts(problem, problem.parameters.search(start), start[None])
        missed.append((fit.phi[:2] - [0.0, 1.2]) / np.sqrt(np.diagonal(fit.covariance)[:2]))
    assert (np.abs(np.sqrt(np.mean(np.square(missed), axis=0)) - 1.0) < 0.5).all()  # 1 expected, with an error of 0.16


def test_a_run_left_out_is_that_fit_to_the_others() -> None:
    problem, fit = forecasts()
    start = begin(problem)
    others = problem_of(free_runs()[1:])
    alone = fit_forecasts(others, problem.parameters.search(start), start[None])
    assert np.allclose(fit.left_out[0, :2], alone.phi[:2], atol=0.1 * np.sqrt(alone.covariance[0, 0]))
    likely = fit_innovations(problem, begin(problem)[None])
    alone = fit_innovations(others, likely.theta[None], brief=True)
    assert np.allclose(likely.left_out[0, :2], alone.phi[:2], atol=0.02)


def test_states_by_later_readings_too_are_nearer_to_the_truth_and_end_as_filtered() -> None:
    runs = free_runs(Sea(noise_deg=2.0))
    problem = problem_of(runs)
    theta = begin(problem)
    theta[:2] = 1.0, 1.2
    noises = problem.noises(theta[None])
    after = smoothed(problem.model, problem.course, theta[:2], noises).states
    before = follow(problem.model, problem.course, theta[None, :2], noises, keep=True).states
    assert after is not None and before is not None and np.allclose(after[..., -1], before[..., -1])
    truth, last = free_runs(Sea(noise_deg=0.0)), len(runs[0]) - 1
    at = [np.interp(problem.course.time[r], runs[r].time - runs[r].time[0], truth[r].position) for r in range(4)]
    missed = [np.std((states[0, 0] - np.array(at))[:, 8:last]) for states in (after, before)]
    assert missed[0] < 0.8 * missed[1]


def test_of_models_that_forecast_alike_likelihood_decides_and_a_large_disturbance_is_said() -> None:
    """Model 2 has one parameter more; model 3 forecasts worse by a sure little."""
    fitted, (problem, _), run = complete(), forecasts(), np.arange(4)
    sizes = {"1": [1.01, 0.98, 1.01, 1.02], "2": [1.0] * 4, "3": [1.02, 1.03, 1.02, 1.03]}
    errors = {number: np.array(row) for number, row in sizes.items()}
    ahead = {
        number: tuple(Predicted(h, run, run, run, error, 9.0 * error, 9.0 * error) for h in (2.0, 5.0))
        for number, error in errors.items()
    }
    for likelier, chosen in (("", "1"), ("1", "1"), ("2", "2"), ("3", "1")):
        models = {}
        for n in "123":
            base = Model.base(n, 1.0, [1.0] * (1 + (n == "2")), "nu", YAW)
            outcome = replace(fitted, predictive=np.array([5.0, 4.0, 6.0, 5.0]) * (n == likelier))
            models[n] = OutputErrorFit(n, base, outcome, fitted.covariance)
        preference = prefer_driven(models, ahead, YAW)
        assert preference is not None and preference.number == chosen and not preference.biased
    for size, chosen in ((19.0, "3"), (21.0, "1")):  # of 20 that model 3 gains, white innovations leave nothing
        preference = prefer_driven(models, ahead, YAW, unexplained=lambda fit, size=size: size)
        assert preference is not None and (preference.number, preference.biased) == (chosen, chosen == "3")
    assert large_disturbance(problem.course, np.ones(1), fitted.of_chance) == ""
    sentence = large_disturbance(problem.course, np.ones(1), {"yaw.disturbance": 2.0})
    assert sentence.startswith("The disturbance is as large as the commands: yaw moment 2 of ")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_commands_that_answer_disturbances_choose_no_drag(seed: int, tmp_path: Path) -> None:
    """Quadratic drag under a controller: linear drag predicts better, and a constant best of all."""
    sea = Sea(size=0.2, lasting=3.0, noise_deg=0.5)
    runs, others = (steered(6, number, sea, length=40.0, held=16.0) for number in (seed, seed + 10))
    fit = identify(runs)
    assert fit.preference.number == "3" and fit.preference.biased
    assert "Commands that answer disturbances flatter model 1: " in fit.preference.because
    for name, true in (("I_r", 1.0), ("k_rr", 1.2)):
        assert abs(fit.preferred.estimates[name].value - true) < 3.0 * fit.preferred.estimates[name].stderr
    assert fit.use is not None and fit.use.of_use and fit.use.beaten and FLATTERED in fit.use.sentence(YAW)
    file = tmp_path / "yaw_model.json"
    file.write_text(json.dumps(fit.to_json()))
    validation = with_predictions(compare(read_model(file), others), None)
    assert "1" in validation.outweighed and validation.contradiction == "" and validation.expected is None
    assert validation.use is not None and validation.use.of_use and FLATTERED in validation.says


@pytest.mark.slow
@pytest.mark.parametrize("better", [True, False])
def test_of_too_few_steps_forecasts_choose_the_likelihood(better: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both runs are steps, too few to be fitted as such: the preferred fit of either kind is compared."""
    compared: list[bool] = []

    def predicts_better(course: Course, quiet: OutputErrorFit, fit: OutputErrorFit) -> bool:
        compared.append(fit.mixed.driven and not quiet.mixed.driven)
        return better

    monkeypatch.setattr(driven, "predicts_better", predicts_better)
    fit = identify(steered(2, 0, Sea(size=0.15), length=20.0, period=0.5, free=True))
    assert compared == [True] and {of.mixed.driven for of in fit.output_error.values()} == {better}
    assert ("by output error" in fit.why_no_velocity_error) != better


def test_only_the_model_alone_forecasts_under_commands_that_are_held() -> None:
    """Not under a controller, and not under a rudder, which answers the heading; what validation reads is the same."""
    held = steered(3, 0, Sea(size=0.15), length=30.0, period=0.5, free=True)
    assert driven.by_model_alone(held) and not driven.by_model_alone(steered(2, 0, Sea(size=0.15), length=30.0))
    assert not driven.by_model_alone([run.with_moment(run.command, "rad") for run in held])
    course = make_course(held, np.ones(3, dtype=bool))
    fit = driven_fit(course, rough_model("3", make_batch(held, 0.1)), "3")
    course = course.unthinned
    problem, theta = driven_problem(fit.model, course), fit.mixed.theta.copy()
    theta[[p.name for p in problem.parameters.entries].index("command_delay_s")] = 0.0
    noises = problem.noises(theta[None])
    carried, alone = (predict(fit.model, course, fit.model.theta, noises, alone=alone)[0][1] for alone in (False, True))
    followed = follow(fit.model, course, fit.model.theta[None], noises, keep=True)
    assert followed.states is not None and carried.error.shape == alone.error.shape
    for r, o, t, error in list(zip(alone.run, alone.origin, alone.target, alone.error))[::9]:
        first, last = np.searchsorted(held[r].time - held[r].time[0], course.time[r, [o, t]] - 1e-6)
        run, (way, rate) = held[r].cut(first, last + 1), followed.states[:2, 0, r, o]
        rolled = simulate(fit.model, make_batch([run], 0.01), start=Start(way, rate)).position[0, 0, len(run) - 1]
        assert run.position[-1] - rolled == pytest.approx(error, abs=0.005)
    assert np.abs(carried.error - alone.error).max() > 0.1


@pytest.mark.slow
def test_intervals_hold_what_a_missing_dead_band_does_and_else_stay() -> None:
    """A dead band of 0.1 nu: the truth lies beside the plain interval and within the wider."""
    for seed, band in ((1002, 0.1), (1000, 0.0)):
        runs = [replace(run, moment=run.command + band * np.sign(run.command)) for run in steered(5, seed, length=40.0)]
        course = make_course(runs, np.ones(5, dtype=bool))
        plain = driven_fit(course, rough_model("3", make_batch(runs, 0.1)), "3")
        wider = inflate_for_missing(course, plain)
        if not band:
            assert wider == plain and not wider.proposed
            continue
        assert list(wider.proposed) == ["dead-band"] and wider.proposed["dead-band"] > 20.0
        low, high = plain.estimates["I_r"].ci95
        assert not low < 1.0 < high
        problem, innovations = driven_problem(plain.model, course), plain.mixed
        assert isinstance(innovations, InnovationsFit)
        forecasts = fit_forecasts(problem, innovations.phi, innovations.theta[None])
        (mixed,) = with_chance([problem], [forecasts.towards(innovations)])
        assert mixed is not None
        middle = replace(plain, mixed=mixed, model=plain.model.with_theta(mixed.of_model), to_forecasts=0.5)
        ways = list[float]()
        for fit, widened, most in ((plain, wider, 0.2), (middle, inflate_for_missing(course, middle), 0.4)):
            for name, truth in (("I_r", 1.0), ("k_rr", 1.2)):
                low, high = widened.estimates[name].ci95
                assert low < truth < high and widened.estimates[name].value == fit.estimates[name].value
            assert np.sqrt(widened.covariance[0, 0] - fit.covariance[0, 0]) < most
            ways.append(np.sqrt(widened.covariance[0, 0] - fit.covariance[0, 0]))
        # both intervals reach to where innovations put the inertia beside the dead band
        assert abs(plain.mixed.phi[0] - np.sign(plain.mixed.phi[0]) * ways[0] - mixed.phi[0]) == pytest.approx(
            ways[1], rel=0.15
        )


@pytest.mark.slow
def test_a_compass_that_is_late_moves_the_delay_alone() -> None:
    scores, truths = [], {"I_r": 1.0, "k_rr": 1.2}
    for seed in range(1000, 1006):
        runs = steered(5, seed, length=40.0)
        late = [replace(run, position=np.append(run.position[:1], run.position[:-1])) for run in runs]
        course = make_course(late, np.ones(5, dtype=bool))
        fit = driven_fit(course, rough_model("3", make_batch(late, 0.1)), "3")
        scores += [(fit.estimates[name].value - truth) / fit.estimates[name].stderr for name, truth in truths.items()]
        assert fit.mixed.of_chance["command_delay_s"] == pytest.approx(runs[0].sample_period, abs=0.05)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
