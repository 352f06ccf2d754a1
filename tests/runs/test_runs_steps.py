"""Steps: the instant is bounded, and rest is told from motion."""

from dataclasses import replace

import numpy as np
import pytest
from made_runs import step_heading, step_run

from automarine_cli.dofs import YAW
from automarine_cli.runs.half_turn import find_steps, start_position
from automarine_cli.runs.run import Run

EVERY = pytest.mark.parametrize("moment", [-1.2, -0.1, 0.5])


@EVERY
@pytest.mark.parametrize("phase", [0.01, 0.5, 0.99])
def test_the_switch_is_bounded_by_two_samples(moment: float, phase: float) -> None:
    run = step_run(moment, phase=phase, clock=1234.5)
    (step,) = find_steps(run)
    assert step.switch_from < 1234.5 < step.switch_to
    assert step.switch_to - step.switch_from == pytest.approx(0.1)
    assert step.switch_to == run.time[step.first] and step.switch_from == run.time[step.first - 1]
    assert step.moment == moment and step.stop == len(run) and step.ends_log and not step.begins_log


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
        assert step.switch_from == pytest.approx(run.time[0] - 0.1) and len(step.notes) == 1
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


def test_drifting_rest_is_cut_down_to_the_still_part() -> None:
    run = step_run(0.5, rest=6.0, noise_deg=0.1)
    drift = np.where(run.time < 97, 0.4 * (97 - run.time), 0.0)
    (step,) = find_steps(replace(run, position=run.position - drift))
    assert step.rest is not None and run.time[step.rest.start] >= 96.5
    assert step.start_position == pytest.approx(0.7, abs=0.01)
