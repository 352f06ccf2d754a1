"""Unwrapping: the true heading comes back whatever the compass did, and real turns are left alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import step_heading

from automarine_cli.dofs import YAW
from automarine_cli.runs.load import find_glitches, unwrap, wrapped
from automarine_cli.runs.run import position_noise

NO_GAPS = np.array([], dtype=np.int64)


def whole_turns_off(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Difference of two headings less its first value: 0 where no turn was invented or lost."""
    return (found - found[0]) - (true - true[0])


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
    logged = np.mod(true, 2 * np.pi)
    for place, width, value in spikes:
        logged[12 * place + 5 : 12 * place + 5 + width] = value
    kept = np.ones(150, dtype=bool)
    if gap is not None:
        kept[gap : gap + 8] = False
    time, true, logged = time[kept], true[kept], logged[kept]
    bad = find_glitches(time, logged, YAW)
    time, true, logged = time[~bad], true[~bad], logged[~bad]
    gaps = np.flatnonzero(np.diff(time) > 0.31)
    position, broken_after = unwrap(time, logged, gaps, YAW)
    whole = np.round(whole_turns_off(position, true) / (2 * np.pi))
    assert broken_after == () and not whole.any()
    left = np.abs(whole_turns_off(position, true))
    assert left.max() < np.deg2rad(45)  # what is left of a spike is too small to matter for the turns


@given(
    rate=st.floats(-2, 2),
    swing=st.floats(0, 1.5),
    pace=st.floats(0.2, 2),
    noise=st.floats(0, 2),
    seed=st.integers(0, 999),
)
def test_real_turns_lose_no_sample(rate: float, swing: float, pace: float, noise: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.1 * (1 + 0.1 * rng.uniform(-1, 1, 200)))
    heading = rate * time + swing * np.sin(pace * time) + np.deg2rad(noise) * rng.standard_normal(200)
    assert not find_glitches(time, np.mod(heading, 2 * np.pi), YAW).any()


@pytest.mark.parametrize("moment", [-1.2, -0.1, 0.1, 1.2])
@pytest.mark.parametrize("period", [0.02, 0.1, 0.5, 1.0])
def test_a_step_from_rest_loses_no_sample(moment: float, period: float) -> None:
    time = np.arange(-2, max(6.0, 40 * period), period)
    heading = step_heading(time, moment)
    assert not find_glitches(time, np.mod(heading, 2 * np.pi), YAW).any()


def test_a_jump_that_stays_is_no_spike() -> None:
    """The Kingfisher's compass holds its last value and catches up by 48 degrees: that is no glitch."""
    time = 0.1 * np.arange(60)
    heading = np.where(np.arange(60) < 30, 0.02, 0.02 + np.deg2rad(48)) + 0.001 * np.arange(60)
    assert not find_glitches(time, heading, YAW).any()


@pytest.mark.parametrize("where", [[0], [0, 1], [59], [58, 59], [20], [30, 31]])
def test_spikes_are_found_where_they_are(where: list[int]) -> None:
    time = 0.1 * np.arange(60)
    heading = 0.5 * time
    heading[where] += 2.5
    assert np.flatnonzero(find_glitches(time, heading, YAW)).tolist() == where


def test_a_log_that_counts_its_turns_is_taken_as_it_is() -> None:
    time = 0.1 * np.arange(300)
    heading = 0.9 * time
    gaps = np.array([99])
    time[100:] += 50
    position, broken_after = unwrap(time, heading, gaps, YAW)
    np.testing.assert_array_equal(position, heading)
    assert broken_after == ()


def test_a_gap_is_bridged_by_the_rates_beside_it() -> None:
    """Steady turning at 1 rad/s: seven seconds are missing, more than a whole turn."""
    time = np.concatenate([np.arange(0, 5, 0.1), np.arange(12, 17, 0.1)])
    position, _ = unwrap(time, np.mod(time, 2 * np.pi), np.array([49]), YAW)
    np.testing.assert_allclose(position, time, atol=1e-9)


@pytest.mark.parametrize(("rate_after", "hole"), [(-1.0, 7.0), (1.0, 3600.0)])
def test_a_gap_that_leaves_it_open_breaks_the_run(rate_after: float, hole: float) -> None:
    before = np.arange(0, 5, 0.1)
    time = np.concatenate([before, before + 5 + hole])
    heading = np.concatenate([before, rate_after * before])
    assert unwrap(time, np.mod(heading, 2 * np.pi), np.array([49]), YAW)[1] == (49,)


@pytest.mark.parametrize("way", [-1, 1])
def test_short_gaps_in_a_row_break_no_run(way: int) -> None:
    """A logger that drops samples every now and then: 0.225 s in a log of 20 Hz, no rate between two such gaps, and
    never 3 degrees from one sample to the next."""
    time = np.delete(np.arange(0, 20, 0.025), np.s_[202:600:10])
    time = np.concatenate([time[:200], time[200:240:9], time[240:]])
    heading = way * np.deg2rad(12) * np.clip(time - 3, 0, None)
    gaps = np.flatnonzero(np.diff(time) > 3 * np.median(np.diff(time)))
    assert len(gaps) >= 4 and np.diff(time).max() == pytest.approx(0.25, abs=0.03)
    position, broken_after = unwrap(time, np.mod(heading, 2 * np.pi), gaps, YAW)
    assert broken_after == ()
    np.testing.assert_allclose(position - position[0], heading, atol=1e-9)


def test_wrapped_is_within_half_a_turn() -> None:
    angles = np.linspace(-20, 20, 401)
    assert (np.abs(wrapped(angles)) <= np.pi).all()
    np.testing.assert_allclose(np.exp(1j * wrapped(angles)), np.exp(1j * angles), atol=1e-12)


@pytest.mark.parametrize("moment", [-1.2, 0.1, 1.2])
@pytest.mark.parametrize("sigma_deg", [0.1, 1.0, 3.0])
def test_noise_is_measured_whatever_the_turn_and_the_clock(moment: float, sigma_deg: float) -> None:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(40):
        time = np.cumsum(0.1 * (1 + 0.3 * rng.uniform(-1, 1, 120))) - 2
        noise = np.deg2rad(sigma_deg) * rng.standard_normal(120)
        found.append(np.rad2deg(position_noise(time, step_heading(time, moment) + noise)))
    assert abs(np.mean(found) / sigma_deg - 1) < 0.05


def test_a_coarse_compass_has_at_least_its_quantum() -> None:
    time = 0.1 * np.arange(200)
    heading = np.deg2rad(np.round(2 * time))
    assert np.rad2deg(position_noise(time, heading)) == pytest.approx(1 / np.sqrt(12))
