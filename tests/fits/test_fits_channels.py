"""Fits to heading and gyro: the truth in units of the standard error, noises, biases, and one sensor missing."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identify
from made_campaigns import PAPER, both_ways, campaign
from made_sequences import sequence_run

from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.innovations import channel_noises, channels_json
from automarine_cli.runs.run import Run

SIZES = (0.2, 0.4, 0.6, 0.8, 1.0)
SEEDS = range(6)
SURE = 4.0  # standard errors
WHAT_IS_FITTED = pytest.mark.parametrize("fit_to", ["half-turns", "whole-runs"])


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
    return [identify(campaign(both_ways(SIZES), seed=seed, gyro_deg_s=0.3, gain_scatter=0.02)) for seed in SEEDS]


def test_the_truth_is_found_within_its_errors_and_so_are_both_noises(fits: list[YawFit]) -> None:
    every = np.array([pulls(fit) for fit in fits])
    assert np.abs(every).max() < SURE
    assert 0.4 < np.sqrt((every**2).mean()) < 1.7
    for fit in fits:
        noises = channel_noises(fit.preferred.mixed, fit.dof)
        assert set(noises) == {"heading", "yaw_rate"}
        for name, truth, unit in (("heading", 1.0, "deg"), ("yaw_rate", 0.3, "deg/s")):
            assert abs(noises[name].value - truth) < SURE * noises[name].stderr and noises[name].unit == unit


def test_each_run_has_a_bias_of_its_own(fits: list[YawFit]) -> None:
    fit = fits[0]
    rest = np.array([turn.step.run.extras["yaw_rate"][turn.step.rest].mean() for turn in fit.turns])
    told = fit.preferred.mixed.own("yaw_rate-bias")[:, 0]
    assert np.rad2deg(rest.std()) > 0.5
    assert np.rad2deg(np.abs(told - rest)).max() < SURE * 0.3 / np.sqrt(15)


def test_a_gyro_narrows_what_it_shows_to_either_side() -> None:
    runs = campaign(both_ways(SIZES), seed=1, gyro_deg_s=0.3, gain_scatter=0.02)
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
    runs = campaign(both_ways(SIZES), seed=4, gyro_deg_s=0.3)
    mixed = [without(run, position=i % 3 == 1) if i % 3 else run for i, run in enumerate(runs)]
    fit = identify(mixed, fit_to)
    assert fit.channels.names == ("heading", "yaw_rate")
    assert np.abs(pulls(fit)).max() < SURE
    noises = fit.output_error["3"].mixed.noise_of
    assert np.rad2deg([noises["heading"], noises["yaw_rate"]]) == pytest.approx([1.0, 0.3], rel=0.12)


@WHAT_IS_FITTED
def test_a_gyro_alone_is_enough(fit_to: str) -> None:
    runs = [without(run, position=True) for run in campaign(both_ways(SIZES), seed=5, gyro_deg_s=0.3)]
    fit = identify(runs, fit_to)
    assert fit.channels.names == ("yaw_rate",) and fit.preferred.noise is None
    assert np.abs(pulls(fit)).max() < SURE
    heading, rate = channels_json(fit.channels, channel_noises(fit.preferred.mixed, fit.dof))["channels"]  # type: ignore[misc]
    assert heading == {"quantity": "heading", "used": False, "why": fit.channels.verdicts[0].why}
    assert "The logs hold no heading" in heading["why"] and rate["used"]
    assert fit.to_json()["heading_noise_deg"] is None


@pytest.mark.slow
def test_whole_runs_use_the_gyro_too() -> None:
    random = np.random.default_rng(8)
    runs = []
    for seed in range(4):
        run = sequence_run(seed=seed, noise_deg=1.0)
        rate = np.gradient(sequence_run(seed=seed, noise_deg=0.0).position, run.time)
        noise = np.deg2rad(0.3 * random.standard_normal(len(run)) + random.standard_normal())
        runs.append(replace(run, name=f"run {seed}", extras={"yaw_rate": rate + noise}))
    both, alone = (identify(runs, "whole-runs", channels=which) for which in ("all", "position"))
    wide, narrow = (fit.output_error["3"].inertial_turn_angle for fit in (alone, both))
    assert wide is not None and narrow is not None and narrow.stderr < wide.stderr
