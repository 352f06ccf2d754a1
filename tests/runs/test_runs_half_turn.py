"""The first half-turn: what is kept, what cut it, and the sentence where nothing serves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_runs import mirrored, step_heading, step_run
from stirred import steps_in_water

from automarine_cli.dofs import YAW
from automarine_cli.runs.half_turn import HalfTurn, all_half_turns, find_steps, half_turns, start_position
from automarine_cli.runs.look import look_at_run
from automarine_cli.runs.run import Run

MOMENTS = [-1.2, -0.5, -0.1, 0.1, 0.5, 1.2]


def trimmed(run: Run) -> HalfTurn:
    (turn,) = all_half_turns(run)
    return turn


@pytest.mark.parametrize("moment", [-1.2, -0.1, 0.5])
@pytest.mark.parametrize("rest", [0.0, 2.0])
def test_half_a_turn_is_kept(moment: float, rest: float) -> None:
    run = step_run(moment, rest=rest, noise_deg=0.2)
    turn = trimmed(run)
    assert not turn.why and turn.steady and turn.cut_by == "half a turn"
    assert np.sign(turn.turned) == np.sign(moment)
    assert 168 < abs(np.rad2deg(turn.turned)) <= 180
    assert turn.kept.start == turn.step.first
    np.testing.assert_array_equal(turn.position, run.position[turn.kept])
    assert np.rad2deg(turn.step.run.noise) == pytest.approx(0.2, rel=0.5)


def test_noise_does_not_choose_the_last_sample() -> None:
    """Cut at the first noisy sample beyond pi, the last samples lie low; with the margin they do not."""
    residual, naive = [], []
    for seed in range(400):
        quiet, noisy = step_run(0.3, noise_deg=0.0), step_run(0.3, noise_deg=2.0, seed=seed)
        turn = trimmed(noisy)
        noise = noisy.position - quiet.position
        residual.append(noise[turn.kept.stop - 1])
        naive.append(noise[np.flatnonzero(np.abs(noisy.position - turn.start_position) > np.pi)[0] - 1])
    standard_error = np.deg2rad(2) / np.sqrt(400)
    assert abs(np.mean(residual)) < 3.5 * standard_error
    assert np.mean(naive) < -3.5 * standard_error  # what the margin is for


@settings(max_examples=40)
@given(
    moment=st.sampled_from(MOMENTS),
    rest=st.sampled_from([0.0, 0.5, 2.0]),
    noise=st.sampled_from([0.0, 0.3, 1.0, 2.0]),
    seed=st.integers(0, 9999),
    shift=st.floats(-1e5, 1e5),
    turns=st.integers(-3, 3),
)
def test_trimmed_twice_mirrored_or_shifted_it_is_the_same_turn(
    moment: float, rest: float, noise: float, seed: int, shift: float, turns: int
) -> None:
    run = step_run(moment, rest=rest, noise_deg=noise, seed=seed)
    first = trimmed(run)
    again = trimmed(run.cut(0, first.kept.stop))
    assert again.kept == first.kept
    np.testing.assert_array_equal(again.position, first.position)
    moved = replace(run, time=run.time + shift, position=run.position + 2 * np.pi * turns)
    for other, sign, start in ((trimmed(mirrored(run)), -1, 0.0), (trimmed(moved), 1, 2 * np.pi * turns)):
        assert (other.kept, other.cut_by, other.steady) == (first.kept, first.cut_by, first.steady)
        assert other.why == first.why and sign * other.turned == pytest.approx(first.turned, abs=1e-9)
        assert other.start_position == pytest.approx(sign * first.start_position + start, abs=1e-9)
        step, like = first.step, other.step
        assert (like.rest, like.from_rest, like.moment) == (step.rest, step.from_rest, sign * step.moment)
        assert like.switch_to - like.switch_from == pytest.approx(step.switch_to - step.switch_from, abs=1e-8)
        assert like.start_rate == pytest.approx(sign * step.start_rate, abs=1e-7)


def reason(run: Run) -> str:
    good, aside = half_turns([run])
    assert not good and len(aside) == 1 and (aside[0].file, aside[0].run) == ("run.csv", "run")
    return aside[0].why


STEP, SHORT = step_run(0.5, length=4.0), step_run(0.5, length=1.2)
NOISE = np.deg2rad(np.random.default_rng(1).standard_normal(len(STEP)))
REASONS = {  # run -> cause and remedy
    "ends": (SHORT, ("ended before steady", "after 16 degrees", "Hold each moment for half a turn")),
    "changes": (
        replace(STEP, moment=np.where(STEP.time > 101.2, -0.1, STEP.command)),
        ("moment changed before steady: the moment changed after 1",),
    ),
    "still": (replace(STEP, position=NOISE), ("never moved: 1 degree", "larger moment", "name it heading_rad")),
    "stuck": (replace(STEP, position=0 * STEP.position + 1.25), ("compass stuck: 40 of 40", "Check the compass")),
    "against": (replace(STEP, position=-STEP.position), ("units look wrong", "110 degrees against", "sign = -1")),
    "turning": (
        step_run(0.5, rest=0.0, rate0=0.4, noise_deg=0.0),
        ("not from rest: ", "23.9 degrees/s", "come to rest"),
    ),
    "short": (step_run(0.5, length=0.6), ("too short: ", "has 6 samples", "at least 8", "Log faster")),
    "no step": (replace(STEP, moment=np.sin(STEP.time)), ("no step: no constant moment", "fit whole runs")),
}


@pytest.mark.parametrize("seed", [1, 2])
def test_logs_that_begin_under_way_are_told_together(seed: int) -> None:
    """Half of them are each too noisy to show that they do not begin from rest."""
    whole = steps_in_water(seed=seed)
    at_once, later = ([run.cut(first, len(run)) for run in whole] for first in (10, 13))
    assert len(half_turns(at_once)[0]) == len(at_once)
    good, aside = half_turns(later)
    assert not good and sum("logs that begin with the moment on begin at" in run.why for run in aside) > 4
    assert len(half_turns([*later, *whole])[0]) == len(whole)


@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize("name", REASONS)
def test_reasons(name: str, way: int) -> None:
    run, parts = REASONS[name]
    why = reason(run if way > 0 else mirrored(run))
    assert why.startswith(parts[0]) and [part for part in parts if part not in why] == []


@pytest.mark.parametrize("way", [-1, 1])
def test_a_sensor_that_answers_seldom_is_not_stuck(way: int) -> None:
    """A compass of 0.5 Hz in a log of 10 Hz repeats each value for 2 s; one that stops for good is stuck."""
    run = step_run(0.1 * way, noise_deg=0.3)
    slow = replace(run, position=np.repeat(run.position[::20], 20)[: len(run)])
    assert "stuck" not in reason(slow)
    first = int(np.argmax(run.command != 0))
    stopped = np.where(np.arange(len(run)) < first, run.position, run.position[first])
    assert reason(replace(run, position=stopped)).startswith("compass stuck: ")


@pytest.mark.parametrize("way", [-1, 1])
def test_a_driven_run_is_told_by_what_moved_it(way: int) -> None:
    """A trifle of a moment before a vehicle is steered through a turn: not that trifle is what the run is about."""
    time = np.arange(0, 40, 0.1)
    moment = np.where(time < 2, 0.0023, 0.5 * np.sin(0.9 * time)) * way
    heading = np.where(time < 2, 0.0, way * (1 - np.cos(0.12 * (time - 2))))
    run = Run("driven", "driven.csv", time, heading, moment, "N m", dof=YAW)
    turns, (aside,) = half_turns([run])
    assert turns == () and aside.why.startswith("no step: the vehicle turned over 115 deg, but under a changing moment")


# Steps: the instant is bounded, and rest is told from motion


EVERY = pytest.mark.parametrize("moment", [-1.2, -0.1, 0.5])


@EVERY
@pytest.mark.parametrize("phase", [0.01, 0.5, 0.99])
def test_the_switch_is_bounded_by_two_samples(moment: float, phase: float) -> None:
    run = step_run(moment, phase=phase, clock=1234.5)
    (step,) = find_steps(run)
    assert step.switch_from < 1234.5 < step.switch_to
    assert step.switch_to - step.switch_from == pytest.approx(0.1)
    assert step.switch_to == run.time[step.first] and step.switch_from == run.time[step.first - 1]
    assert step.moment == moment and step.stop == len(run) and not step.begins_log


@EVERY
def test_the_start_heading_is_the_mean_of_the_rest(moment: float) -> None:
    errors = []
    for seed in range(30):
        run = step_run(moment, seed=seed)
        (step,) = find_steps(run)
        assert step.from_rest and step.rest is not None and step.start_rate == 0
        assert step.start_position == run.position[step.rest].mean()
        errors.append(np.rad2deg(step.start_position - 0.7))
    # mean of up to 20 samples of 1 degree: 0.22 degrees; a few runs keep only a part of the rest
    assert abs(np.mean(errors)) < 0.2 and np.std(errors) < 0.4


@EVERY
def test_a_log_that_begins_with_the_moment_on(moment: float) -> None:
    rest, errors = [], []
    for seed in range(30):
        run = step_run(moment, rest=0.0, seed=seed)
        (step,) = find_steps(run)
        assert step.begins_log and step.rest is None and step.start_position is None
        assert step.switch_from == pytest.approx(run.time[0] - 0.1) and len(look_at_run(run).notes) == 1
        rest.append(step.from_rest)
        errors.append(np.rad2deg(start_position(step) - 0.7))
    assert np.mean(rest) > 0.9
    assert abs(np.mean(errors)) < 0.5 and np.std(errors) < 1.2


@EVERY
@pytest.mark.parametrize("against", [-1, 1])
def test_a_vehicle_that_turns_already_is_not_at_rest(moment: float, against: int) -> None:
    rate = against * 0.6 * np.sqrt(abs(moment) / 1.257)
    for rest in (0.0, 2.0):
        run = step_run(moment, rest=rest, rate0=rate, noise_deg=0.3)
        (step,) = find_steps(run)
        assert not step.from_rest and step.rest is None
    (step,) = find_steps(step_run(moment, rest=0.0, rate0=rate, noise_deg=0.0))
    assert step.start_rate == pytest.approx(rate, rel=0.25)
    assert np.rad2deg(start_position(step) - 0.7) == pytest.approx(0, abs=2.5)


def test_coasting_is_no_rest_until_it_is_over() -> None:
    """A vehicle coasts after a step; the next step follows while it still turns."""
    time = 0.1 * np.arange(200)
    moment = np.where(time < 6, 0.8, np.where(time < 8, 0.0, -0.8))
    coast = step_heading(np.minimum(time, 6), 0.8)
    rate = np.sqrt(0.8 / 1.257)
    slowed = 1.018 / 1.257 * np.log1p(1.257 / 1.018 * rate * np.clip(time - 6, 0, None))
    run = Run("run", "run.csv", time, coast + slowed, moment, "nu", dof=YAW)
    first, second = find_steps(run)
    assert first.from_rest and not second.from_rest and second.rest is None
