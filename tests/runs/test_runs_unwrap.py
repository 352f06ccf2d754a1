"""Positions from sample to sample: headings unwrapped, spikes dropped, jumps split, in degrees and in metres; what
vehicles do is left alone."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import mirrored, step_heading, step_run, written

from automarine_cli.dofs import DOFS, SURGE, YAW, Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import position_trouble
from automarine_cli.runs.load import find_glitches, find_jumps, load_runs, unwrap
from automarine_cli.runs.run import position_noise

WRAPPED = 2 * np.pi
VEHICLES = {"small ROV": (0.4, 0.5), "ROV": (1.0, 1.5), "boat": (10.0, 3.0)}  # m/s, m/s²
TRANSLATIONS = [dof for dof in DOFS.values() if not dof.angular]


def whole_turns_off(unwrapped: Floats, true: Floats) -> Floats:
    """Difference of two headings less its first value: 0 where no turn was invented or lost."""
    return (unwrapped - unwrapped[0]) - (true - true[0])


@given(
    moment=st.sampled_from([-1.2, -0.4, 0.1, 0.7, 1.2]),
    start=st.floats(-10, 10),
    noise=st.sampled_from([0.0, 0.2, 1.0]),
    spikes=st.lists(
        st.tuples(st.integers(0, 11), st.integers(1, 2), st.floats(0, 2 * np.pi)), max_size=4, unique_by=lambda s: s[0]
    ),
    gap=st.none() | st.integers(20, 120),
    seed=st.integers(0, 10_000),
)
def test_true_heading_comes_back(
    moment: float, start: float, noise: float, spikes: list[tuple[int, int, float]], gap: int | None, seed: int
) -> None:
    """Wraps, spikes of one or two samples and a hole of eight samples: no turn is invented or lost."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.1 * (1 + 0.05 * rng.uniform(-1, 1, 150)))
    true = step_heading(time - 2, moment, heading0=start) + np.deg2rad(noise) * rng.standard_normal(150)
    logged = np.mod(true, WRAPPED)
    for place, width, value in spikes:
        logged[12 * place + 5 : 12 * place + 5 + width] = value
    present = np.ones(150, dtype=bool)
    if gap is not None:
        present[gap : gap + 8] = False
    time, true, logged = time[present], true[present], logged[present]
    bad = find_glitches(time, logged, YAW)
    time, true, logged = time[~bad], true[~bad], logged[~bad]
    position, broken_after = unwrap(time, logged, np.flatnonzero(np.diff(time) > 0.31), YAW)
    off = whole_turns_off(position, true)
    assert broken_after == () and not np.round(off / WRAPPED).any()
    assert np.abs(off).max() < np.deg2rad(45)  # what is left of a spike is too small to matter for the turns


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
    if period == 0.1 and abs(rate) <= 2 and swing <= 1.5 and pace <= 2:
        assert not find_glitches(time, np.mod(heading, WRAPPED), YAW).any()


def jumped(heading: Floats, at: int, degrees: float) -> Floats:
    """The heading with an offset after sample `at`."""
    return heading + np.where(np.arange(len(heading)) > at, np.deg2rad(degrees), 0.0)


@pytest.mark.parametrize("degrees", [-170, -51, -20, 20, 51, 170])
@pytest.mark.parametrize("rate", [-0.5, 0.0, 0.3])
def test_a_jump_that_stays_is_found_either_way(degrees: float, rate: float) -> None:
    time = 0.1 * np.arange(200)
    noise = np.deg2rad(0.3) * np.random.default_rng(1).standard_normal(200)
    heading = jumped(rate * time + noise, 80, degrees)
    for way in (1, -1):
        assert find_jumps(time, np.mod(way * heading, WRAPPED), YAW).tolist() == [80]


def test_what_comes_back_or_catches_up_is_no_jump() -> None:
    """A compass stands still for a second of a turn at 60 degrees a second, and then shows where the vehicle is."""
    time = 0.1 * np.arange(100)
    assert not len(find_jumps(time, jumped(jumped(0.2 * time, 50, 60.0), 53, -60.0), YAW))
    heading = np.deg2rad(60.0) * time
    heading[40:51] = heading[40]
    assert not len(find_jumps(time, heading, YAW))


@pytest.mark.parametrize("mirror", [False, True])
def test_a_run_is_split_at_its_jump_and_says_so(tmp_path: Path, mirror: bool) -> None:
    """What is left before the jump is too short to say anything; it is set aside with the reason."""
    run = step_run(0.2, rest=3.0, length=30.0)
    run = mirrored(run) if mirror else run
    heading = np.rad2deg(jumped(run.position, 35, 51.0))
    campaign = load_runs([written(run, tmp_path / "a.csv", heading_deg=heading % 360)], dof=YAW)
    (part,) = campaign.runs
    assert part.name == "a.2" and len(part) == len(run) - 36 and part.counts["jumps"] == 1
    assert "split at 1 jump of up to 5" in part.notes[-1]
    np.testing.assert_allclose(np.diff(part.position), np.diff(run.position[36:]), atol=1e-9)
    (aside,) = campaign.set_aside
    assert aside.run == "a.1" and aside.why.startswith("only 3.5 s are left beside a jump")


def test_a_gap_is_bridged_by_the_rates_beside_it() -> None:
    """Steady turning at 1 rad/s: seven seconds are missing, more than a whole turn."""
    time = np.concatenate([np.arange(0, 5, 0.1), np.arange(12, 17, 0.1)])
    position, _ = unwrap(time, np.mod(time, WRAPPED), np.array([49]), YAW)
    np.testing.assert_allclose(position, time, atol=1e-9)


@pytest.mark.parametrize(("rate_after", "hole"), [(-1.0, 7.0), (1.0, 3600.0)])
def test_a_gap_that_leaves_it_open_breaks_the_run(rate_after: float, hole: float) -> None:
    before = np.arange(0, 5, 0.1)
    time = np.concatenate([before, before + 5 + hole])
    heading = np.concatenate([before, rate_after * before])
    assert unwrap(time, np.mod(heading, WRAPPED), np.array([49]), YAW)[1] == (49,)


@pytest.mark.parametrize("way", [-1, 1])
def test_short_gaps_in_a_row_break_no_run(way: int) -> None:
    """A logger that drops samples every now and then: 0.225 s in a log of 20 Hz, no rate between two such gaps, and
    never 3 degrees from one sample to the next."""
    time = np.delete(np.arange(0, 20, 0.025), np.s_[202:600:10])
    time = np.concatenate([time[:200], time[200:240:9], time[240:]])
    heading = way * np.deg2rad(12) * np.clip(time - 3, 0, None)
    gaps = np.flatnonzero(np.diff(time) > 3 * np.median(np.diff(time)))
    assert len(gaps) >= 4 and np.diff(time).max() == pytest.approx(0.25, abs=0.03)
    position, broken_after = unwrap(time, np.mod(heading, WRAPPED), gaps, YAW)
    assert broken_after == ()
    np.testing.assert_allclose(position - position[0], heading, atol=1e-9)


@pytest.mark.parametrize("moment", [-1.2, 0.1])
@pytest.mark.parametrize("sigma_deg", [0.1, 1.0, 3.0])
def test_noise_is_measured_whatever_the_turn_and_the_clock(moment: float, sigma_deg: float) -> None:
    rng = np.random.default_rng(3)
    measured = []
    for _ in range(40):
        time = np.cumsum(0.1 * (1 + 0.3 * rng.uniform(-1, 1, 120))) - 2
        noise = np.deg2rad(sigma_deg) * rng.standard_normal(120)
        measured.append(np.rad2deg(position_noise(time, step_heading(time, moment) + noise)))
    assert abs(np.mean(measured) / sigma_deg - 1) < 0.05


def driven(vehicle: str, rate: float, noise: float, seed: int) -> tuple[Floats, Floats, Floats]:
    """Clock, position [m] and command of a vehicle that starts from rest, stops, and comes back, for a minute."""
    speed, acceleration = VEHICLES[vehicle]
    time = np.arange(0.0, 60.0, 1 / rate)
    command = np.where(time < 5, 0.0, np.where(time < 30, 1.0, np.where(time < 40, 0.0, -1.0)))
    lag, velocity = speed / acceleration, np.zeros(len(time))
    for i in range(1, len(time)):
        velocity[i] = velocity[i - 1] + (speed * command[i] - velocity[i - 1]) / (lag * rate)
    way = np.cumsum(velocity) / rate
    return time, way + noise * np.random.default_rng(seed).standard_normal(len(time)), command


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("rate", [2.0, 10.0, 50.0])
@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_what_vehicles_do_passes_and_what_none_does_is_found(vehicle: str, rate: float, noise: float) -> None:
    """A spike of ten times the noise and twice what the vehicle moves between samples, and a jump much larger."""
    for seed in range(4):
        time, position, _ = driven(vehicle, rate, noise, seed)
        assert position_trouble(time, position, SURGE) is None
        assert not find_glitches(time, position, SURGE).any() and not len(find_jumps(time, position, SURGE))
    time, position, _ = driven(vehicle, rate, noise, 1)
    at = int(np.searchsorted(time, 22.0))  # in steady motion
    step = VEHICLES[vehicle][0] / rate
    spiked = position.copy()
    spiked[at] += 12 * noise + 2.5 * step
    assert np.flatnonzero(find_glitches(time, spiked, SURGE)).tolist() == [at]
    further = position.copy()
    further[at:] += 60 * noise + 8 * step + SURGE.limits.acceleration / rate**2
    assert find_jumps(time, further, SURGE).tolist() == [at - 1]


@pytest.mark.parametrize("dof", TRANSLATIONS, ids=lambda dof: dof.name)
@pytest.mark.parametrize("factor", [100.0, 1000.0])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_centimetres_and_millimetres_are_told(vehicle: str, factor: float, dof: Dof) -> None:
    time, position, _ = driven(vehicle, 10.0, 0.01, 2)
    why = position_trouble(time, factor * position, dof)
    assert why is not None and why.startswith("units look wrong: ")
    assert why.endswith(f'such as {dof.position}_m = {{ from = "{dof.position}", unit = "mm" }}')
