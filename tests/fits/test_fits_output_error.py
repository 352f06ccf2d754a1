"""Maximum likelihood on half-turns and on whole runs, by heading and gyro: known truth in units of the standard error,
invariances, choice of the model."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from identified import identify
from made_campaigns import PAPER, Vehicle, both_ways, campaign, moving_run, rescaled, shifted
from made_runs import mirrored, step_run
from repository import SAMPLE_RUNS
from scipy import stats
from step_fits import fitted_steps

from automarine_cli.dofs import YAW
from automarine_cli.errors import FitError, RunError
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.innovations import channel_noises, channels_json
from automarine_cli.fits.linear_mixed import START_VELOCITY
from automarine_cli.fits.mixed_model import MixedFit, fit_mixed, jackknife
from automarine_cli.fits.preference import Preference
from automarine_cli.fits.steps import StepData, data_of_steps
from automarine_cli.fits.whole_runs import START_SCATTERS, OutputErrorFit, whole_run_problem
from automarine_cli.logs.find import find_logs
from automarine_cli.models.model import Model
from automarine_cli.models.parameter import NOTHING_KNOWN, Prior, Priors
from automarine_cli.report.fit_report import fit_warnings
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

TRUTH = {"I_r": PAPER.inertia, "k_rr": PAPER.k_rr}
SEEDS = range(24)
SEED_MODEL = Model.base("3", PAPER.inertia, [PAPER.k_rr], "nu", YAW)


def data_of(runs: Sequence[Run]) -> StepData:
    turns, set_aside = half_turns(runs)
    assert not set_aside
    return data_of_steps(turns)


def fitted(runs: Sequence[Run], number: str = "3", known: Priors = NOTHING_KNOWN) -> OutputErrorFit:
    """One model alone, from start values that are off by a fifth."""
    return fitted_steps(data_of(runs), number, (1.2, 1.0, 1.0), known)


def values(fit: OutputErrorFit) -> np.ndarray:
    return np.array([estimate.value for estimate in fit.estimates.values()])


@cache
def many(gain_scatter: float) -> tuple[OutputErrorFit, ...]:
    return tuple(fitted(campaign(seed=seed, gain_scatter=gain_scatter)) for seed in SEEDS)


def off_by(fits: Sequence[OutputErrorFit], name: str) -> np.ndarray:
    """Relative errors of a parameter, or of the inertial turn angle."""
    if name != "angle":
        return np.array([fit.estimates[name].value / TRUTH[name] - 1 for fit in fits])
    angles = [fit.inertial_turn_angle for fit in fits]
    return np.array([angle.value * PAPER.k_rr / PAPER.inertia - 1 for angle in angles if angle is not None])


@pytest.mark.parametrize("gain_scatter", [0.0, 0.05])
def test_truth_is_found_in_units_of_the_standard_error_and_held_by_the_intervals(gain_scatter: float) -> None:
    """24 campaigns of 12 runs: the squared errors, divided by their own variances, add up to chi-square.

    Variances from 12 runs scatter by 40 %, so the upper limit allows for Student's t.
    """
    fits = many(gain_scatter)
    low, high = stats.chi2.ppf([0.005, 0.995], len(fits))
    for name, true in TRUTH.items():
        every = [fit.estimates[name] for fit in fits]
        z = np.array([(estimate.value - true) / estimate.stderr for estimate in every])
        assert low * 0.7 < np.sum(z**2) < high * 11 / 9, name
        assert abs(z.mean()) < 3.0 / np.sqrt(len(z)) * 1.2, name
        assert sum(estimate.ci95[0] <= true <= estimate.ci95[1] for estimate in every) >= 20, name  # 22.8 expected
    angle, turns = PAPER.inertia / PAPER.k_rr, [fit.inertial_turn_angle for fit in fits]
    assert sum(turn is not None and turn.ci95[0] <= angle <= turn.ci95[1] for turn in turns) >= 20


def test_scatter_of_the_gain_and_noise_are_found_and_none_is_invented() -> None:
    """PHYSICS 0.10: scatter spoils inertia and drag, but theta_c is free of it."""
    without, scattered = many(0.0), many(0.05)
    found = np.array([fit.gain_scatter.value for fit in scattered])
    assert np.sqrt(np.mean(found**2)) == pytest.approx(0.05, rel=0.15)
    assert sum(fit.gain_scatter.ci95[0] <= 0.05 <= fit.gain_scatter.ci95[1] for fit in scattered) >= 20
    for fit in without:
        assert fit.gain_scatter.value < 0.01 and fit.gain_scatter.ci95[0] < 0.005
        assert np.degrees(fit.noise) == pytest.approx(1.0, rel=0.1)
    drag, angle = ([float(np.sqrt(np.mean(off_by(fits, name) ** 2))) for fits in (without, scattered)]
                   for name in ("k_rr", "angle"))  # fmt: skip
    assert drag[1] > 3 * drag[0] and angle[1] < 1.3 * angle[0]
    for i in range(2):
        likely = np.mean([fit.mixed.covariance[i, i] for fit in scattered])
        left_out = np.mean([jackknife(fit.mixed.left_out)[i, i] for fit in scattered])
        assert left_out == pytest.approx(likely, rel=0.3)


def test_the_same_runs_told_otherwise_give_the_same_parameters() -> None:
    """Mirrored, by a clock that runs ahead, in another order, each with another zero of the heading."""
    runs = campaign(seed=5, gain_scatter=0.03)
    others = [
        replace(run, position=run.position + 0.9 * i)
        for i, run in enumerate(shifted([mirrored(run) for run in runs], 86_400.0))
    ]
    order = np.random.default_rng(0).permutation(len(runs))
    there, back = fitted(runs), fitted([others[i] for i in order])
    assert values(back) == pytest.approx(values(there), rel=1e-6)  # both settle within 1 % of a standard error
    assert back.gain_scatter.value == pytest.approx(there.gain_scatter.value, rel=1e-6)


@pytest.mark.parametrize("number", ["1", "2", "3"])
def test_another_unit_of_the_moment_scales_inertia_and_drag_alike(number: str) -> None:
    runs = campaign(both_ways((0.2, 0.5, 0.8, 1.1)), seed=6)
    there = fitted(runs, number)
    other = fitted_steps(data_of(rescaled(runs, 0.36)), number, (0.36 * 1.2, 0.36, 0.36))
    # Model 1 is wrong here and its likelihood flat; its search may stop a hundredth of a standard error apart.
    near = {"1": 1e-3, "2": 1e-3, "3": 1e-6}[number]
    assert values(other) == pytest.approx(0.36 * values(there), rel=near, abs=1e-4)


@pytest.mark.parametrize(
    ("vehicle", "how", "precise"),
    [
        (PAPER, {"period": 0.5, "uneven": 0.6}, 0.06),
        (PAPER, {"period": 0.02, "uneven": 0.6}, 0.015),
        (PAPER, {"rest": 0.0, "noise_deg": 0.5}, 0.15),  # logs that begin with the step
        (Vehicle(2.0, 0.0, 1.0), {}, 0.15),
        (Vehicle(1.0, 0.5, 0.8), {}, 0.15),
        (Vehicle(1.0, 2.0, 0.0), {}, 0.15),
    ],
)
def test_truth_is_found_at_any_rate_and_of_other_vehicles(
    vehicle: Vehicle, how: dict[str, Any], precise: float
) -> None:
    number = "1" if vehicle.k_rr == 0 else "3" if vehicle.k_r == 0 else "2"
    fit = fitted(campaign(seed=8 if how else 10, vehicle=vehicle, **how), number)
    truth = {"I_r": vehicle.inertia, "k_r": vehicle.k_r, "k_rr": vehicle.k_rr}
    for name, estimate in fit.estimates.items():
        assert abs(estimate.value - truth[name]) < (3.5 if how else 4.0) * estimate.stderr, name
        assert estimate.stderr < precise * (truth[name] + (0.0 if how else 0.2)), name


@cache
def chosen(truth: Vehicle, seed: int) -> YawFit:
    return identify(campaign(seed=seed, vehicle=truth, gain_scatter=0.02))


@pytest.mark.parametrize(
    ("truth", "number"),
    [
        (PAPER, "3"),
        pytest.param(Vehicle(1.0, 1.2, 0.0), "1", marks=pytest.mark.slow),
        pytest.param(Vehicle(1.0, 0.6, 0.8), "2", marks=pytest.mark.slow),
    ],
)
def test_the_true_model_is_preferred(truth: Vehicle, number: str) -> None:
    fits = [chosen(truth, seed) for seed in range(5)]
    assert sum(fit.preference.number == number for fit in fits) >= 4
    for fit in fits:
        assert fit.preference.because.startswith(f"Preferred: model {fit.preference.number}. ")
        assert fit.preference.because.count("model") == 3  # the other two as well
    if truth is PAPER:
        assert fits[2].warnings == ()
        for fit in fits:  # model 2 costs nothing where it is not needed
            k_r = fit.output_error["2"].estimates["k_r"]
            assert abs(k_r.value) < 4 * k_r.stderr


@cache
def moving(count: int) -> tuple[list[Run], np.ndarray, np.ndarray]:
    """Runs that move from the start, with the heading and the rate there."""
    runs, start, rate = zip(*(moving_run(seed) for seed in range(count)))
    return list(runs), np.array(start), np.array(rate)


@pytest.mark.slow
def test_runs_that_move_from_the_start_are_fitted_whole() -> None:
    runs, start, rate = moving(4)
    fit = identify(runs, fit_to="whole-runs")
    model = fit.output_error["3"]
    for name, true in TRUTH.items():
        assert abs(model.estimates[name].value - true) < 4 * model.estimates[name].stderr < 0.2 * true
    assert fit.preference.number == "3" and all(one.mixed.converged for one in fit.output_error.values())
    first = np.array([run.position[0] for run in runs])
    assert first + model.mixed.run_effects[:, 0] == pytest.approx(start, abs=np.radians(1.0))
    assert model.mixed.run_effects[:, 1] == pytest.approx(rate, abs=0.03)
    content: Any = fit.to_json()
    assert content["fitted_to"] == "whole runs"
    for entry in content["models"].values():
        assert entry["velocity_error"] is None and entry["sse"] is None and "(--fit-to whole-runs)" in entry["why"]


PUSHED = "Noise and thrust scatter do not explain these runs: a push of "


@pytest.mark.slow
def test_scattered_thrust_is_no_unknown_push() -> None:
    clean = [*campaign(seed=2, gain_scatter=0.05)[::3], *moving(4)[0]]
    assert not [says for says in identify(clean, fit_to="whole-runs").warnings if says.startswith(PUSHED)]


@pytest.mark.slow
def test_water_that_turns_along_is_an_unknown_push_and_the_warning_names_the_command() -> None:
    hidden = [
        SAMPLE_RUNS / "hidden_one" / f"{name}.csv" for name in ("falling", "reversal_+0.8", "reversal_-0.8", "rising")
    ]
    runs = load_runs(find_logs(hidden), dof=YAW).runs
    (says,) = (says for says in identify(runs, fit_to="whole-runs").warnings if says.startswith(PUSHED))
    assert says.endswith("`automarine diagnose LOGS --model yaw_model.json`.")


def test_runs_that_move_are_fitted_whole_without_being_told_and_never_as_half_turns() -> None:
    fit = identify([run.cut(0, len(run) // 2) for run in moving(2)[0]])
    assert fit.velocity_error_fit is None
    assert fit.why_no_velocity_error.startswith("0 of 2 runs hold a constant moment from rest through a half-turn, ")
    with pytest.raises(RunError, match=r"half-turns at \d sizes? of moment are usable, .*--fit-to whole-runs"):
        identify(moving(2)[0], fit_to="half-turns")


def test_runs_that_no_moment_moves_or_the_wrong_way_are_refused() -> None:
    still = [run.with_moment(np.zeros(len(run)), "nu") for run in campaign([0.5])]
    with pytest.raises(RunError, match=r"none of 1 run can be fitted.*no moment acts in this run"):
        identify(still, fit_to="whole-runs")
    against = [mirrored(run).with_moment(run.command, "nu") for run in moving(3)[0]]
    with pytest.raises(FitError, match=r"turn against the moment: .* map it with sign = -1 in the --columns"):
        identify(against, "whole-runs")


# What a person is warned of


def said(fit: YawFit, *parts: str) -> bool:
    return any(all(part in warning for part in parts) for warning in fit.warnings)


@pytest.mark.slow
def test_one_run_is_judged_by_akaikes_criterion_and_has_no_scatter() -> None:
    fit = identify(moving(2)[0][1:], "whole-runs")
    assert fit.preference.number == "3"
    assert fit.preference.because.startswith(
        "With one run there is no cross-validation; by Akaike's criterion model 3 is best"
    )
    assert fit.preferred.gain_scatter.ci95 == (0.0, 0.0)
    for name, true in TRUTH.items():
        assert abs(fit.preferred.estimates[name].value - true) < 4 * fit.preferred.estimates[name].stderr


def test_a_run_that_decides_alone_is_named() -> None:
    """As one of the lake runs does, whose compass jumps; here the fit without one run is moved by hand."""
    fit = many(0.0)[0]
    size = np.sqrt(np.diagonal(fit.covariance))
    left_out = fit.mixed.left_out.copy()
    left_out[4, 0] += 20 * size[0]
    moved = replace(fit, mixed=replace(fit.mixed, left_out=left_out))
    names = [f"run_{i:02d}" for i in range(12)]
    preference = Preference("3", "")
    assert not any("alone" in warning for warning in fit_warnings({"3": fit}, preference, names))
    (found,) = [warning for warning in fit_warnings({"3": moved}, preference, names) if "alone" in warning]
    assert found.startswith("run_04 alone changes I_r of model 3 from ") and "check its log" in found


@pytest.mark.parametrize(
    "fit_to", ["half-turns", *(pytest.param(x, marks=pytest.mark.slow) for x in ("auto", "whole-runs"))]
)
def test_a_delay_is_a_parameter_of_every_fit(fit_to: str) -> None:
    runs = campaign(both_ways((0.2, 0.4, 0.8, 1.1)), seed=1)
    late = [replace(run, position=np.interp(run.time - 0.5, run.time, run.position)) for run in runs]
    fit = identify(late, fit_to=fit_to)
    assert fit.is_late and fit.preferred.delay.value == pytest.approx(0.5, abs=0.05)
    for name, truth in TRUTH.items():
        assert fit.preferred.estimates[name].value == pytest.approx(truth, rel=0.05)
    assert not identify(runs, fit_to=fit_to).is_late


def test_commands_that_the_log_shows_a_message_late_act_before() -> None:
    """As in an autopilot's log, which holds what was sent last: with half a sample at most the inertia was wrong."""
    runs = campaign(both_ways((0.2, 0.4, 0.8, 1.1)), seed=1)
    early = [replace(run, position=np.interp(run.time + 0.1, run.time, run.position)) for run in runs]
    together, apart = (identify(logged, "whole-runs").preferred for logged in (runs, early))
    assert apart.delay.value - together.delay.value == pytest.approx(-0.1, abs=0.02) and not apart.delay.at_bound
    for name in TRUTH:
        error = apart.estimates[name].value - together.estimates[name].value
        assert abs(error) < 2 * apart.estimates[name].stderr, name


def test_vehicles_of_hardly_any_drag_or_inertia_are_warned_of() -> None:
    fit = identify(campaign(both_ways((0.2, 0.5, 0.8)), vehicle=Vehicle(1.0, 0.0, 0.001), seed=1))
    assert said(fit, "Half a turn is too short for a steady speed")
    assert said(fit, "inertial turn angle", "outside 0.05 to 3 rad")
    fit = identify(campaign(vehicle=Vehicle(0.03, 0.0, 1.0), seed=1))
    assert said(fit, "inertial turn angle of 0.0", "check the units of time and heading")


# Heading and gyro

GYRO_SIZES = (0.2, 0.4, 0.6, 0.8, 1.0)
SURE = 4.0  # standard errors
WHAT_IS_FITTED = pytest.mark.parametrize("fit_to", ["half-turns", pytest.param("whole-runs", marks=pytest.mark.slow)])


def without(run: Run, position: bool) -> Run:
    """The run without its gyro, or with the sum of that for a heading."""
    if not position:
        return replace(run, extras={})
    rate = run.extras["yaw_rate"] - run.extras["yaw_rate"][run.command == 0].mean()
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(run.time))])
    return replace(run, position=summed, summed_up=True)


def pulls(fit: YawFit) -> list[float]:
    """How far inertia, drag and their ratio are from the truth, in standard errors."""
    model = fit.output_error["3"]
    ratio = model.inertial_turn_angle
    assert ratio is not None
    truths = (PAPER.inertia, PAPER.k_rr, PAPER.inertia / PAPER.k_rr)
    estimates = (model.estimates["I_r"], model.estimates["k_rr"], ratio)
    return [(estimate.value - truth) / estimate.stderr for estimate, truth in zip(estimates, truths)]


@pytest.fixture(scope="module")
def fits() -> list[YawFit]:
    return [
        identify(campaign(both_ways(GYRO_SIZES), seed=seed, gyro_deg_s=0.3, gain_scatter=0.02)) for seed in range(6)
    ]


def test_the_truth_is_found_within_its_errors_and_so_are_both_noises(fits: list[YawFit]) -> None:
    every = np.array([pulls(fit) for fit in fits])
    assert np.abs(every).max() < SURE
    assert 0.4 < np.sqrt((every**2).mean()) < 1.7
    for fit in fits:
        noises = channel_noises(fit.preferred.mixed, fit.dof)
        assert set(noises) == {"heading", "yaw_rate"}
        for name, truth, unit in (("heading", 1.0, "deg"), ("yaw_rate", 0.3, "deg/s")):
            assert abs(noises[name].value - truth) < SURE * noises[name].stderr and noises[name].unit == unit


def test_a_gyro_narrows_what_it_shows_to_either_side() -> None:
    runs = campaign(both_ways(GYRO_SIZES), seed=1, gyro_deg_s=0.3, gain_scatter=0.02)
    with_gyro = identify(runs)
    both, alone = with_gyro.output_error["3"], identify(runs, channels="position").output_error["3"]
    assert both.inertial_turn_angle is not None and alone.inertial_turn_angle is not None
    assert both.inertial_turn_angle.stderr < 0.5 * alone.inertial_turn_angle.stderr
    bare = identify([without(run, position=False) for run in runs])
    assert bare.output_error["3"].mixed.theta.tolist() == alone.mixed.theta.tolist()
    assert "channels" in with_gyro.to_json() and "channels" not in bare.to_json()
    mirrored = [
        replace(run, position=-run.position, moment=-run.command, extras={"yaw_rate": -run.extras["yaw_rate"]})
        for run in runs
    ]
    there = identify(mirrored).output_error["3"].mixed.theta
    np.testing.assert_allclose(there, both.mixed.theta, rtol=1e-4, atol=1e-3)


@WHAT_IS_FITTED
def test_some_runs_lack_the_gyro_and_some_the_heading(fit_to: str) -> None:
    runs = campaign(both_ways(GYRO_SIZES), seed=4, gyro_deg_s=0.3)
    mixed = [without(run, position=i % 3 == 1) if i % 3 else run for i, run in enumerate(runs)]
    fit = identify(mixed, fit_to)
    assert fit.channels.names == ("heading", "yaw_rate")
    assert np.abs(pulls(fit)).max() < SURE
    noises = fit.output_error["3"].mixed.noise_of
    assert np.rad2deg([noises["heading"], noises["yaw_rate"]]) == pytest.approx([1.0, 0.3], rel=0.12)


@WHAT_IS_FITTED
def test_a_gyro_alone_is_enough(fit_to: str) -> None:
    runs = [without(run, position=True) for run in campaign(both_ways(GYRO_SIZES), seed=5, gyro_deg_s=0.3)]
    fit = identify(runs, fit_to)
    assert fit.channels.names == ("yaw_rate",) and fit.preferred.noise is None
    assert np.abs(pulls(fit)).max() < SURE
    heading, rate = channels_json(fit.channels, channel_noises(fit.preferred.mixed, fit.dof))["channels"]  # type: ignore[misc]
    assert heading == {"quantity": "heading", "used": False, "why": fit.channels.verdicts[0].why}
    assert "The logs hold no heading" in heading["why"] and rate["used"]
    assert fit.to_json()["heading_noise_deg"] is None


def free_start(model: Model, rates: Sequence[float], rest: float) -> MixedFit:
    """Fit a model, and any friction as given, to steps of runs that begin at these rates, which it does not know."""
    moments = both_ways([0.2, 0.3, 0.45, 0.6, 0.8, 1.1])
    runs = [step_run(m, rest=rest, length=8.0, rate0=rate, seed=i) for i, (m, rate) in enumerate(zip(moments, rates))]
    known = {name: Prior(value) for name, value in model.values.items() if name.startswith("coulomb")}
    parameters, moves = model.parameters(log_drag=True), np.zeros(len(runs), dtype=bool)
    problem = whole_run_problem(model, parameters, make_batch(runs, 0.1), moves, confined=True).informed(known)
    factors = np.array([START_SCATTERS[name] for name in problem.effects.factor_names])
    return fit_mixed(problem, np.append(model.theta, 0.0), noise=0.02, factors=factors)


def test_how_fast_runs_begin_is_estimated() -> None:
    rates = 0.2 * np.random.default_rng(8).standard_normal(12)
    scatter = free_start(SEED_MODEL, rates.tolist(), 0.2).factor(START_VELOCITY)
    assert scatter == pytest.approx(np.sqrt(np.mean(rates**2)), rel=0.1)


def test_a_law_that_forgets_how_runs_began_gains_nothing_by_that() -> None:
    """It did by every run that begins at rest, where each start was as likely as any."""
    plain = free_start(SEED_MODEL, 12 * [0.0], 4.0)
    sticky = free_start(SEED_MODEL.with_effect("coulomb-drag", [1e-4, 1.0, 0.03, 0.02]), 12 * [0.0], 4.0)
    assert max(fit.factor(START_VELOCITY) for fit in (plain, sticky)) < 0.005
    assert sticky.log_likelihood < plain.log_likelihood + 1.0
