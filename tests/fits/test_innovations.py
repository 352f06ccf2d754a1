"""Likelihood of driven and disturbed runs: its slopes, its limit in a quiet pool, known truths, and what it refuses."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from identified import driven_fit, identify
from made_campaigns import shifted
from made_driven import Sea, steered, turned
from made_runs import written
from made_sequences import model_file
from stirred import INERTIA, K_R, K_RR, controlled, steps_in_water

from automarine_cli.dofs import YAW
from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits import driven as driven_module
from automarine_cli.fits.driven import (
    base_starts,
    driven_fits,
    driven_problem,
    left_out_predictions,
    mostly_steps,
    shows_disturbance,
    starts_near,
)
from automarine_cli.fits.identify import identify_turns
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit, fit_innovations
from automarine_cli.fits.mixed_model import fit_mixed
from automarine_cli.fits.optimise import Point, maximise
from automarine_cli.fits.whole_runs import OutputErrorFit, rough_model, whole_run_problem
from automarine_cli.models.model import Model
from automarine_cli.models.parameter import Priors
from automarine_cli.report.fit_report import tables, warnings_of
from automarine_cli.report.sections import sections
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

RUNS = 5
RANDOM = {
    "yaw.disturbance": 0.1, "yaw.disturbance-time": 2.0, "yaw.thrust-noise": 0.02, "gain-scatter": 0.03,
    "noise.heading": np.deg2rad(1.0),
}  # fmt: skip


def quantity(value: float, unit: str) -> dict[str, object]:
    return {"value": value, "stderr": 0.01, "ci95": [0.9 * value, 1.1 * value], "unit": unit}


DRAGS = {"1": {"k_r": quantity(0.8, "nu s")}, "3": {"k_rr": quantity(1.2, "nu s²")}}


def problem_of(runs: list[Run], model: Model, *, quiet: bool = False) -> DrivenProblem:
    return driven_problem(model, make_course(runs, np.ones(len(runs), dtype=bool)), quiet=quiet)


def base(number: str = "3", inertia: float = 1.0, *drag: float) -> Model:
    """A model of the paper near the truth of `Sea`."""
    return Model.base(number, inertia, drag or (1.2,), "nu", YAW)


def fitted(runs: list[Run], model: Model) -> InnovationsFit:
    """The fit from values near the truth."""
    return fitted_on(make_course(runs, np.ones(len(runs), dtype=bool)), model)


def fitted_on(course: Course, model: Model) -> InnovationsFit:
    problem = driven_problem(model, course)
    return fit_innovations(problem, starts_near(problem, [model.theta], {}), brief=True)


def stderr(found: InnovationsFit, name: str) -> float:
    """Reported standard error in the search's coordinate: of the logarithm, of what is positive."""
    place = found.names.index(name)
    return float(np.sqrt(found.covariance[place, place]))


def test_a_log_that_begins_with_its_command_tells_the_inertia() -> None:
    sea, z = Sea(delay=0.4, noise_deg=0.2, size=0.15, lasting=8.0), []
    for seed in range(3):
        runs = [run.cut(1, len(run)) for run in steered(8, seed, sea, length=12.0, period=0.1, held=4.0)]
        course = make_course(runs, np.zeros(len(runs), dtype=bool))
        assert np.mean(course.before == 0.0) > 0.8  # the vehicle rests; one or two hardly turn at first
        fit = fitted_on(course, base())
        z.append(np.log(fit.theta[0]) / stderr(fit, "yaw.I_r"))
    assert abs(np.mean(z)) < 2.0 / np.sqrt(len(z))  # above 1.7 each with the first command held before


@pytest.mark.parametrize("number, drag", [("1", (0.9,)), ("3", (1.2,))])
def test_slopes_are_those_of_the_value(number: str, drag: tuple[float, ...]) -> None:
    model = base(number, 1.1, *drag).with_effect("input-delay", [0.12]).with_effect("dead-band", [0.08])
    problem = problem_of(steered(3, 1, length=20.0), model)
    (start,) = starts_near(problem, [model.theta], RANDOM)
    phi = problem.parameters.search(start)
    (slopes,) = problem.slopes(phi[None])
    gradient = slopes.gradient.sum(axis=0) + problem.prior_gradient(phi)
    step = 1e-4 * np.maximum(np.abs(phi[problem.free]), 0.1)
    moved = np.tile(phi, (2 * len(step), 1))
    moved[np.arange(len(step)), problem.free] += step
    moved[np.arange(len(step), 2 * len(step)), problem.free] -= step
    up, down = np.split(problem.value(moved), 2)
    np.testing.assert_allclose(gradient, (up - down) / (2 * step), rtol=5e-3, atol=0.02)
    assert problem.point(phi, slopes).value == pytest.approx(float(problem.value(phi[None])[0]), abs=1e-9)


def test_information_is_the_scatter_of_scores() -> None:
    """Of two hundred linear runs at the truth: the mean score is none, its scatter the information."""
    sea = Sea(k_r=0.9, k_rr=0.0, scatter=0.0, thrust=0.05)
    problem = problem_of(steered(200, 7, sea, length=25.0, free=True, held=3.0), base("1", 1.0, 0.9))
    named = {**RANDOM, "yaw.thrust-noise": 0.05, "gain-scatter": 1e-3}
    (start,) = starts_near(problem, [problem.model.theta], named)  # type: ignore[attr-defined]
    (slopes,) = problem.slopes(problem.parameters.search(start)[None])
    own = [i for i, at in enumerate(problem.free) if problem.parameters.names[at] != "gain-scatter"]
    scores, information = slopes.gradient[:, own], slopes.information[:, own][:, :, own].mean(axis=0)
    drift = np.abs(scores.mean(axis=0)) / (scores.std(axis=0) / np.sqrt(len(scores)))
    size = [problem.parameters.names[problem.free[i]] for i in own].index("yaw.disturbance")
    assert np.delete(drift, size).max() < 3.5, drift
    assert drift[size] < 6.0, drift  # what a disturbance does within the step in which it changes is left out: 3 %
    ratio = scores.var(axis=0) / np.diagonal(information)
    assert ratio.min() > 0.6 and ratio.max() < 1.6, ratio


def test_a_quiet_course_is_a_pool() -> None:
    """Steps from rest in still water: the same estimates, and the same evidence between models, as the mixed model."""
    runs = steered(8, 3, Sea(k_r=0.004, size=0.0, thrust=0.0), length=20.0, free=True, held=7.0)
    rest, gains = np.ones(8, dtype=bool), list[tuple[float, float]]()
    course, batch = make_course(runs, rest), make_batch(runs, 0.05)
    assert course.channels[0].seen.sum() == sum(map(len, runs))
    for model in (base("3"), base("2", 1.0, 1.2, 0.05)):
        problem = driven_problem(model, course, quiet=True)
        found = fit_innovations(problem, starts_near(problem, [model.theta], {}), brief=True)
        whole = whole_run_problem(model, model.parameters(log_drag=True, signed_drag=True), batch, rest)
        still = whole.effects.without("disturbance", "switch-instants")
        whole = replace(whole, effects=still)
        factors = np.array([0.03 if name == "gain" else 0.5 for name in still.factor_names])
        mixed = fit_mixed(whole, np.append(model.theta, 0.0), noise=0.02, factors=factors)
        for i, name in enumerate(model.parameter_names):
            own = stderr(found, name) * (found.value(name) if found.parameters.log[i] else 1.0)
            other = float(np.sqrt(mixed.covariance[i, i])) * (mixed.value(name) if mixed.parameters.log[i] else 1.0)
            assert found.value(name) == pytest.approx(mixed.value(name), abs=0.1 * own), name
            assert own == pytest.approx(other, rel=0.3), name
        gains.append((found.log_likelihood, mixed.log_likelihood))
    filtered, whole_runs = np.diff(gains, axis=0)[0]
    assert whole_runs > 0.5 and filtered == pytest.approx(whole_runs, abs=0.3)


@cache
def driven(seed: int) -> InnovationsFit:
    """A fit of six runs with a delay, which the model has."""
    runs = steered(RUNS, seed, Sea(delay=0.2), length=40.0)
    return fitted(runs, base().with_effect("input-delay", [0.1]))


@pytest.mark.slow
def test_runs_left_out_are_predicted_alike_however_many_one_filter_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    runs, fit = steered(RUNS, 0, Sea(delay=0.2), length=40.0), driven(0)
    problem = driven_problem(base().with_effect("input-delay", [0.1]), make_course(runs, np.zeros(RUNS, dtype=bool)))
    together = left_out_predictions(problem, fit)[0]
    monkeypatch.setattr(driven_module, "RUNS_A_PASS", 2)
    for some, every in zip(left_out_predictions(problem, fit)[0], together):
        assert set(every.run) == set(range(RUNS))
        np.testing.assert_allclose(some.error, every.error, atol=1e-12)
        np.testing.assert_array_equal(some.run, every.run)


def test_the_truth_is_found() -> None:
    truth = {"yaw.I_r": 1.0, "yaw.k_rr": 1.2, "input-delay.t_d": 0.2}
    off = []
    for seed in range(6):
        found = driven(seed)
        assert found.converged
        for name, value in truth.items():
            place = found.names.index(name)
            error = found.value(name) - value
            scale = value if found.parameters.log[place] else 1.0
            off.append(error / scale / stderr(found, name))
        assert found.value("input-delay.t_d") == pytest.approx(0.2, abs=0.05)
        assert 0.5 < found.value("yaw.disturbance") / 0.1 < 2.0
        assert 0.5 < found.value("yaw.disturbance-time") / 2.0 < 2.0
        assert found.value("noise.heading") == pytest.approx(np.deg2rad(1.0), rel=0.15)
    assert np.abs(off).max() < 3.5, off
    assert np.abs(np.mean(np.reshape(off, (6, 3)), axis=0)).max() < 3.5 / np.sqrt(6), off


def test_the_same_to_the_other_side_and_by_another_clock() -> None:
    runs, found = steered(RUNS, 0, Sea(delay=0.2), length=40.0), driven(0)
    model = base().with_effect("input-delay", [0.1])
    others = shifted([turned(run) for run in runs], 1000.0)
    np.testing.assert_allclose(fitted(others, model).theta, found.theta, rtol=1e-5, atol=1e-9)


def test_where_the_curvature_overflows_no_search_ends() -> None:
    """A filter that runs away may have a density; the errors of a fit there made a warning of numpy's and no number."""
    course = make_course(steered(2, 0, Sea(), length=20.0), np.ones(2, dtype=bool))
    problem = driven_problem(base(), course)
    phi = problem.parameters.search(starts_near(problem, [base().theta], {})[0])
    (slopes,) = problem.slopes(phi[None])
    away = replace(slopes, information=np.where(np.arange(2)[:, None, None] == 1, np.inf, slopes.information))
    assert np.isfinite(problem.point(phi, slopes).value) and problem.point(phi, away).value == -np.inf


def test_the_evidence_asks_for_a_disturbance_where_there_is_one() -> None:
    for sea, asked in ((Sea(), True), (Sea(size=0.0, thrust=0.0), False)):
        runs = steered(3, 1, sea, length=20.0)
        rough = rough_model("2", make_batch(runs, 0.1))
        assert shows_disturbance(runs, rough, np.ones(3, dtype=bool), None) is asked


LEVELS = Sea(k_r=0.3, noise_deg=0.2, size=0.05)


def test_a_few_levels_are_steps_and_many_are_none() -> None:
    levels = steered(3, 1, LEVELS, length=30.0, period=0.1, held=4.0, free=True)
    assert not mostly_steps(levels) and mostly_steps([run.cut(0, 120) for run in levels])
    assert shows_disturbance(levels, base(), np.ones(3, dtype=bool), None)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_runs_of_many_levels_are_fitted_whole(seed: int) -> None:
    """Their first levels passed for steps, and nine tenths of the data were laid aside."""
    fit = identify(steered(8, seed, LEVELS, period=0.1, held=4.0, free=True))
    assert fit.turns == () and fit.preferred.mixed.driven and "by a filter" in fit.why_no_velocity_error
    for name, truth in (("I_r", LEVELS.inertia), ("k_rr", LEVELS.k_rr), ("k_r", LEVELS.k_r)):
        estimate = fit.output_error["2"].estimates[name]
        assert abs(estimate.value - truth) < 3.0 * estimate.stderr < (0.09 if name == "I_r" else 0.3), name


def test_commands_that_move_nothing_give_no_model() -> None:
    """Runs whose logged commands are those of other runs: nothing in the motion answers them."""
    runs, others = steered(3, 3, Sea(size=1.0), length=33.0), steered(3, 4, length=33.0, free=True, held=0.5)
    unrelated = [run.with_moment(other.command, "nu").cut(12, len(run)) for run, other in zip(runs, others)]
    course = make_course(unrelated, np.zeros(3, dtype=bool))
    with pytest.raises(FitError, match=r"these runs do not determine the model: .* add runs with larger and quicker"):
        driven_fit(course, base(), "3")


@pytest.mark.slow
def test_validate_predicts_from_filtered_states_of_driven_runs(run: Callable[..., Result], tmp_path: Path) -> None:
    for i, one in enumerate(steered(3, 30, length=30.0)):
        written(one, tmp_path / "logs" / f"{i}.csv")
    for inertia, says in ((1.0, "predicts 5 s ahead to "), (60.0, "is not usable (on these runs). It predicts 5 s")):
        models = {number: {"I_r": quantity(inertia, "nu s²"), **drag} for number, drag in DRAGS.items()}
        model, out = model_file(tmp_path / f"{inertia:g}.json", models=models), tmp_path / f"out_{inertia:g}"
        result = run("validate", tmp_path / "logs", "--model", model, "-o", out, "--figures", "none")
        assert result.exit_code == 0, result.output
        text = (out / "validation.md").read_text()
        assert text.startswith(f"Model 3, which the fit preferred, {says}") and "from the filtered state" in text
        data = json.loads((out / "validation.json").read_text())["prediction"]
        assert list(data) == ["1", "3"]
        for each in data.values():
            assert [one["horizon_s"] for one in each] == [2.0, 5.0, 15.0]
            for one in each:
                still = min(one["constant_rate_deg"], one["constant_heading_deg"])
                assert one["horizon_s"] > 5.0 or (one["rmse_deg"] < still) == (inertia == 1.0)
                assert one["predictions"] > 100


@pytest.mark.parametrize("number", ["1", "3"])
def test_rough_values_faster_than_the_filter_leave_a_start(number: str) -> None:
    """Logs at 110 Hz whose heading was filtered, so that the filter takes its longest steps."""
    time = np.arange(0, 12, 1 / 110)
    runs = [Run(f"{i}", "fast.csv", time, np.sin(time + i), np.cos(time + i), "nu", dof=YAW) for i in range(3)]
    problem = problem_of(runs, base(number, 0.001, 0.5))
    values = problem.value(problem.parameters.search(base_starts(problem)))  # warnings are errors here
    assert np.isfinite(values).mean() > 0.5


@pytest.mark.slow
def test_what_cannot_be_fitted_and_how_fast_logs_are_read_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def refusing(
        course: Course, numbers: Sequence[str], priors: Priors, roughs: Sequence[Model]
    ) -> list[tuple[OutputErrorFit | None, str]]:
        attempts = driven_fits(course, numbers, priors, roughs)
        why = "these runs do not determine the model: it has no end"
        return [attempt if number == "1" else (None, why) for number, attempt in zip(numbers, attempts)]

    monkeypatch.setattr(driven_module, "driven_fits", refusing)
    runs = steered(3, 1, length=12.0, period=0.02)
    fit = identify_turns(YAW, (), (), runs, with_effects=("input-delay",))
    assert list(fit.output_error) == ["1"]
    for number in "23":
        assert f"Model {number} could not be fitted: these runs do not determine the model: it has no end." in (
            warnings_of(fit)
        )
    assert "readings at 50 Hz were averaged over 0.06 s, commands count exactly" in fit.why_no_velocity_error


@pytest.mark.slow
def test_a_fit_chooses_the_law_of_its_effect() -> None:
    """In the propeller's law the lag of the thrust ended as a delay."""
    fit = identify_turns(YAW, (), (), steps_in_water(thrust_lag=0.4, seed=2), with_effects=("thruster-lag",))
    (effect,) = fit.to_json()["models"][fit.preference.number]["effects"]  # type: ignore[index]
    lag, law = (effect["parameters"][name] for name in ("T", "law"))
    assert law["value"] == 1.0 and abs(lag["value"] - 0.4) < 3.0 * lag["stderr"] < 0.3


@pytest.mark.slow
def test_a_long_delay_in_a_closed_loop_is_reached() -> None:
    """From no delay the search ended at half of it, with an inertia a quarter too large and a tenth of it wide."""
    fit = identify_turns(YAW, (), (), controlled(delay=0.3, length=40.0)).preferred
    for name, truth in (("I_r", INERTIA), ("k_rr", K_RR), ("k_r", K_R)):
        assert abs(fit.estimates[name].value - truth) < 3.0 * fit.estimates[name].stderr < 0.3 * truth, name
    assert fit.delay.value == pytest.approx(0.35, abs=0.02) and not fit.proposed


@pytest.mark.slow
def test_a_lag_in_a_closed_loop_is_allowed_for_and_found() -> None:
    runs = controlled(thrust_lag=0.4, length=40.0)
    plain, lagging = (
        identify_turns(YAW, (), (), runs, with_effects=names).preferred for names in ((), ("thruster-lag",))
    )
    low, high = plain.estimates["I_r"].ci95
    assert "thruster-lag" in plain.proposed and low < INERTIA < high
    inertia = lagging.estimates["I_r"]
    assert abs(inertia.value - INERTIA) < 3.0 * inertia.stderr < 0.2 * INERTIA


@pytest.mark.slow
def test_results_of_driven_runs_show_effects() -> None:
    """Of a vehicle that answers 0.3 s late, fitted with that effect."""
    runs = steered(3, 1, Sea(delay=0.3), length=15.0)
    fit = identify_turns(YAW, (), (), runs, with_effects=("input-delay",))
    assert all(draw().axes for draw in sections(fit).figures.values())
    (row,) = (row for row in tables(fit)[0].rows if str(row[0]).startswith("input-delay t_d"))
    assert all("[" in str(cell) for cell in row[1:]) and "[s]" in str(row[0])
    values = {row["model"]: row["value"] for row in sections(fit).rows if row["parameter"] == "input-delay t_d"}
    (effect,) = fit.to_json()["models"]["3"]["effects"]  # type: ignore[index]
    assert values["3"] == effect["parameters"]["t_d"]["value"] == pytest.approx(0.3, abs=0.2)
    linear = replace(fit, preference=replace(fit.preference, number="1"))
    assert linear.to_json()["proposed"] == dict(linear.preferred.proposed)


def test_a_search_ends_quietly_where_slopes_are_as_large_as_numbers_go() -> None:
    def evaluate(phis: np.ndarray, searches: np.ndarray) -> list[Point[None]]:
        return [Point(phi, -float(phi @ phi), np.array([1e200, -1e200]), np.eye(2), None) for phi in phis]

    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    (end,) = maximise(evaluate, [np.array([0.5, 0.5])], [np.arange(2)], [limits], settled=0.1, iterations=3)
    assert np.isfinite(end.point.phi).all() and not end.converged
