"""Headings that jump and stay: found, split, told; turns that vehicles make are not touched."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import mirrored, step_heading, step_run, written

from automarine_cli.dofs import YAW
from automarine_cli.runs.load import find_jumps, load_runs

WRAPPED = 2 * np.pi


def jumped(heading: np.ndarray, at: int, degrees: float) -> np.ndarray:
    """The heading with an offset after sample `at`."""
    return heading + np.where(np.arange(len(heading)) > at, np.deg2rad(degrees), 0.0)


@pytest.mark.parametrize("degrees", [-170, -51, -20, 20, 51, 170])
@pytest.mark.parametrize("rate", [-0.5, 0.0, 0.3])
def test_a_jump_that_stays_is_found_either_way(degrees: float, rate: float) -> None:
    time = 0.1 * np.arange(200)
    noise = np.deg2rad(0.3) * np.random.default_rng(1).standard_normal(200)
    heading = jumped(rate * time + noise, 80, degrees)
    assert find_jumps(time, np.mod(heading, WRAPPED), YAW).tolist() == [80]
    assert find_jumps(time, np.mod(-heading, WRAPPED), YAW).tolist() == [80]


def test_what_comes_back_is_no_jump() -> None:
    time = 0.1 * np.arange(100)
    heading = jumped(jumped(0.2 * time, 50, 60.0), 53, -60.0)
    assert not len(find_jumps(time, heading, YAW))


def test_a_compass_that_catches_up_is_no_jump() -> None:
    """It stands still for a second of a turn at 60 degrees a second, and then shows where the vehicle is."""
    time = 0.1 * np.arange(100)
    heading = np.deg2rad(60.0) * time
    heading[40:51] = heading[40]
    assert not len(find_jumps(time, heading, YAW))


@pytest.mark.parametrize("moment", [-40.0, -1.2, -0.1, 0.1, 1.2, 40.0])
@pytest.mark.parametrize("period", [0.02, 0.1, 0.2, 0.5, 1.0])
def test_a_step_from_rest_does_not_jump(moment: float, period: float) -> None:
    """The strongest is faster by ten times than the source paper's, at up to five radians a second."""
    time = np.arange(-4 * period - 1, max(6.0, 40 * period), period)
    assert not len(find_jumps(time, np.mod(step_heading(time, moment), WRAPPED), YAW))


@given(
    rate=st.floats(-3, 3),
    swing=st.floats(0, 2),
    pace=st.floats(0.2, 4),
    noise=st.floats(0, 2),
    period=st.sampled_from([0.05, 0.1, 0.2, 0.5, 1.0]),
    seed=st.integers(0, 999),
)
def test_real_turns_do_not_jump(rate: float, swing: float, pace: float, noise: float, period: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(period * (1 + 0.1 * rng.uniform(-1, 1, 200)))
    heading = rate * time + swing * np.sin(pace * time) + np.deg2rad(noise) * rng.standard_normal(200)
    assert not len(find_jumps(time, np.mod(heading, WRAPPED), YAW))


@pytest.mark.parametrize("mirror", [False, True])
def test_a_run_is_split_at_its_jump_and_says_so(tmp_path: Path, mirror: bool) -> None:
    """What is left before the jump is too short to say anything; it is set aside with the reason."""
    run = step_run(0.2, rest=3.0, length=30.0)
    run = mirrored(run) if mirror else run
    heading = np.rad2deg(jumped(run.position, 35, 51.0))
    found = load_runs([written(run, tmp_path / "a.csv", heading_deg=heading % 360)], dof=YAW)
    (part,) = found.runs
    assert part.name == "a.2" and len(part) == len(run) - 36 and part.counts["jumps"] == 1
    assert "split at 1 jump of up to 5" in part.notes[-1]
    np.testing.assert_allclose(np.diff(part.position), np.diff(run.position[36:]), atol=1e-9)
    assert [aside.run for aside in found.set_aside] == ["a.1"]
    assert found.set_aside[0].why.startswith("only 3.5 s are left beside a jump")
