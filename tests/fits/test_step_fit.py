"""The default estimate of step runs: whole steps with a delay where they agree with their first half-turns."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identify
from made_campaigns import campaign
from made_runs import INERTIA, K_RR, mirrored
from stirred import INERTIA as WATER_INERTIA
from stirred import K_R, steps_in_water
from stirred import K_RR as WATER_K_RR
from tank import pool_campaign

from automarine_cli.estimate import Estimate
from automarine_cli.fits.preference import prefer
from automarine_cli.runs.run import Run

LATE = 3  # samples of 0.1 s
TWO_TURNS = 4.0 * np.pi


def commanded_early(run: Run) -> Run:
    """The same run of a vehicle that answers 0.3 s later than its log says."""
    return run.with_moment(np.append(run.command[LATE:], np.repeat(run.command[-1:], LATE)), run.moment_unit)


def errors(estimate: Estimate, truth: float) -> float:
    return (estimate.value - truth) / estimate.stderr


@pytest.mark.slow
def test_whole_steps_with_a_delay_hold_the_truth() -> None:
    scores = []
    for seed in range(4):
        runs = [commanded_early(run) for run in campaign(seed=seed, gain_scatter=0.03, turn=TWO_TURNS)]
        fit = identify(runs)
        assert fit.whole_steps and fit.consistency is not None and fit.consistency.agrees
        best = fit.preferred
        values = (best.estimates["I_r"], best.estimates["k_rr"], best.delay)
        scores += [errors(value, truth) for value, truth in zip(values, (INERTIA, K_RR, 0.3))]
    other = identify([mirrored(run) for run in runs]).preferred
    assert other.delay.value == pytest.approx(best.delay.value, abs=1e-6)
    assert other.estimates["I_r"].value == pytest.approx(best.estimates["I_r"].value, rel=1e-6)
    assert np.sqrt(np.mean(np.square(scores))) < 1.6 and np.abs(scores).max() < 3.5


def test_in_stirred_water_predictions_choose_the_model_of_half_turns() -> None:
    """Likelihood takes the pushes for noise from reading to reading."""
    fit = identify(steps_in_water(0.1, seed=5), "half-turns")
    assert prefer(fit.output_error).number == "3" and fit.preference.number == "2"
    assert fit.preference.because.startswith("Model 2 predicts runs left out of the fit")
    low, high = fit.output_error["3"].estimates["k_rr"].ci95
    assert not fit.preferred.mixed.driven and not low < WATER_K_RR < high


@pytest.mark.slow
def test_in_stirred_water_steps_are_fitted_by_a_filter() -> None:
    """By likelihood of steps the drag was up to 17 standard errors off."""
    truth, scores = {"I_r": WATER_INERTIA, "k_rr": WATER_K_RR, "k_r": K_R}, []
    for seed in range(4, 8):
        runs = steps_in_water(0.1, seed=seed)
        fit = identify(runs)
        assert fit.preferred.mixed.driven and fit.preference.number == "2" and fit.fitted_to == "whole steps"
        assert fit.velocity_error_fit is not None and fit.use is not None and fit.use.of_use
        scores += [errors(fit.preferred.estimates[name], value) for name, value in truth.items()]
    assert np.sqrt(np.mean(np.square(scores))) < 1.6 and np.abs(scores).max() < 3.5
    gyro = [{"yaw_rate": -run.extras["yaw_rate"]} for run in runs]
    other = identify([replace(mirrored(run), extras=of) for run, of in zip(runs, gyro)]).preferred.estimates
    for name in truth:
        assert other[name].value == pytest.approx(fit.preferred.estimates[name].value, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "asks"), [({"thrust_lag": 0.4}, True), ({"heading_late": 0.3, "gyro_late": 0.3}, False)]
)
def test_thrust_that_lags_is_told_from_commands_that_act_late(late: dict[str, float], asks: bool) -> None:
    """With a delay in place of the lag the inertia was an eighth too large, its interval a fiftieth wide."""
    fit = identify(steps_in_water(seed=3, **late)).preferred
    inertia = fit.estimates["I_r"]
    assert [*fit.proposed] == ["thruster-lag"] * asks and inertia.ci95[0] < WATER_INERTIA < inertia.ci95[1]
    assert (inertia.stderr > 0.05 * WATER_INERTIA) == asks


@pytest.mark.slow
def test_half_turns_answer_where_the_water_turns_with_the_vehicle() -> None:
    """Whole steps alone put the drag of a swirl into the vehicle's own."""
    swirl = {"name": "water-swirl", "chi": 0.15, "T_w": 10.0}
    runs = pool_campaign(seed=2, turn_deg=720.0, effects=[swirl])
    fit, whole = identify(runs), identify(runs, "whole-runs")
    assert fit.consistency is not None and not fit.consistency.agrees and not fit.whole_steps
    half, far = (abs(answer.output_error["3"].estimates["k_rr"].value / K_RR - 1.0) for answer in (fit, whole))
    assert half < 0.1 and half < 0.6 * far
