"""Fits of driven runs: runs left out, what is preferred and said, intervals that allow for what a model lacks."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_driven import Sea, steered

from automarine_cli.dofs import YAW
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.driven import base_starts, driven_problem, fit_driven, inflate_for_missing, large_disturbance
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit, fit_innovations
from automarine_cli.fits.preference import prefer_driven
from automarine_cli.fits.whole_runs import OutputErrorFit, rough_model
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch


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
def fitted() -> tuple[DrivenProblem, InnovationsFit]:
    problem = problem_of(free_runs())
    return problem, fit_innovations(problem, begin(problem)[None])


def test_a_run_left_out_is_that_fit_to_the_others() -> None:
    _, likely = fitted()
    alone = fit_innovations(problem_of(free_runs()[1:]), likely.theta[None], brief=True)
    assert np.allclose(likely.left_out[0, :2], alone.phi[:2], atol=0.02)


def test_of_equally_simple_models_the_smaller_error_wins_and_a_large_disturbance_is_said() -> None:
    """Model 3 is worse than model 1 in one run by far and so passes as level; model 1 is worse by a sure little."""
    (problem, found), run = fitted(), np.arange(4)
    bases = {n: Model.base(n, 1.0, [1.0] * (1 + (n == "2")), "nu", YAW) for n in "123"}
    covariance = found.covariance  # one outcome: only the numbers of parameters count
    models = {n: OutputErrorFit(n, base, found, covariance) for n, base in bases.items()}
    sizes = {"1": [1.01, 1.02, 1.01, 1.02], "2": [1.0] * 4, "3": [0.9, 1.0, 1.0, 1.6]}
    errors = {number: np.array(row) for number, row in sizes.items()}
    ahead = {
        number: tuple(Predicted(h, run, run, run, error, 9.0 * error, 9.0 * error) for h in (2.0, 5.0))
        for number, error in errors.items()
    }
    preference = prefer_driven(models, ahead, YAW)
    assert preference is not None and preference.number == "1"
    assert large_disturbance(problem.course, np.ones(1), found.of_chance) == ""
    sentence = large_disturbance(problem.course, np.ones(1), {"yaw.disturbance": 2.0})
    assert sentence.startswith("The disturbance is as large as the commands: yaw moment 2 of ")


@pytest.mark.slow
def test_intervals_hold_what_a_missing_dead_band_does_and_else_stay() -> None:
    """A dead band of 0.1 nu: the truth lies beside the plain interval and within the wider."""
    for seed, band in ((1002, 0.1), (1000, 0.0)):
        runs = [replace(run, moment=run.command + band * np.sign(run.command)) for run in steered(5, seed, length=40.0)]
        course = make_course(runs, np.ones(5, dtype=bool))
        plain = fit_driven(course, rough_model("3", make_batch(runs, 0.1)), "3")
        wider, gains = inflate_for_missing(course, plain)
        if not band:
            assert (wider, gains) == (plain, {})
            continue
        assert list(gains) == ["dead-band"] and gains["dead-band"] > 20.0
        low, high = plain.estimates["I_r"].ci95
        assert not low < 1.0 < high
        for name, truth in (("I_r", 1.0), ("k_rr", 1.2)):
            low, high = wider.estimates[name].ci95
            assert low < truth < high and wider.estimates[name].value == plain.estimates[name].value


@pytest.mark.slow
def test_a_compass_that_is_late_moves_the_delay_alone() -> None:
    scores, truths = [], {"I_r": 1.0, "k_rr": 1.2}
    for seed in range(1000, 1006):
        runs = steered(5, seed, length=40.0)
        late = [replace(run, position=np.append(run.position[:1], run.position[:-1])) for run in runs]
        course = make_course(late, np.ones(5, dtype=bool))
        fit = fit_driven(course, rough_model("3", make_batch(late, 0.1)), "3")
        scores += [(fit.estimates[name].value - truth) / fit.estimates[name].stderr for name, truth in truths.items()]
        assert fit.mixed.of_chance["command_delay_s"] == pytest.approx(runs[0].sample_period, abs=0.05)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
