"""Raw load-cell series: plateaus, transients, drop-outs, standard errors, tare and its drift."""

import numpy as np
import pytest
from scipy.signal import lfilter

from automarine_cli.estimate import Estimate
from automarine_cli.thrusters.bollard_data import (
    Points,
    Series,
    flag_contradictions,
    reduce_series,
    standard_error,
    subtract_tare,
)
from automarine_cli.thrusters.fit import sides_of, square_law

A = 25.0  # N at full command, square law both ways
COMMANDS = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.0, -0.2, -0.4, -0.6, -0.8, -1.0, 0.0])


def red_noise(rng: np.random.Generator, size: int, sd: float, memory: float = 0.8) -> np.ndarray:
    """First-order autoregressive noise of standard deviation `sd`."""
    white = rng.standard_normal(size) * sd * np.sqrt(1 - memory**2)
    white[0] = sd * rng.standard_normal()
    return lfilter([1.0], [1.0, -memory], white)


def followed(target: np.ndarray, lag: float) -> np.ndarray:
    """A first-order lag [samples] behind a target, from zero."""
    target = np.concatenate([[0.0], target[1:]])
    return lfilter([1.0 / lag], [1.0, 1.0 / lag - 1.0], target)


def raw(
    seed: int, *, hold: int = 200, sd: float = 0.3, tare: tuple[float, float] = (0.0, 0.0), n_noise: float = 0.0
) -> Series:
    """Commands held for `hold` samples, thrust following with a lag of 8 samples, a tare that drifts."""
    rng = np.random.default_rng(seed)
    n = np.repeat(COMMANDS, hold)
    force = followed(A * n * np.abs(n), 8.0) + np.linspace(*tare, len(n)) + red_noise(rng, len(n), sd)
    return Series("test.csv", "", n + n_noise * rng.standard_normal(len(n)), force, 0.1 * np.arange(len(n)))


def fitted(points: Points) -> Estimate:
    """The square law ahead."""
    tared, _ = subtract_tare(flag_contradictions(points, None))
    return square_law(sides_of(tared, None, 0.0)["forward"], "N")


def test_one_plateau_for_each_command_with_its_transient_dropped() -> None:
    reduction = reduce_series([raw(0)])
    points = reduction.points
    assert points.n == pytest.approx(COMMANDS)
    assert reduction.plateaus == len(COMMANDS) and reduction.samples == 200 * len(COMMANDS)
    assert reduction.left_out > 10 * 15  # ten steps of up to 9 N, a lag of 8 samples each
    assert np.all(points.count >= 100)
    # Noise of 0.3 N with a memory of 0.8 leaves 0.064 N in a mean of 200 samples.
    assert np.max(np.abs(points.force - A * points.n * np.abs(points.n))) < 5 * 0.064
    assert np.sqrt(np.mean(points.stderr**2)) == pytest.approx(0.064, rel=0.3)
    measured = reduce_series([raw(3, n_noise=0.003)]).points  # a measured speed with noise is still held
    assert measured.n == pytest.approx(COMMANDS, abs=0.002) and np.count_nonzero(measured.n == 0.0) == 3


def test_standard_error_allows_for_autocorrelation() -> None:
    """The spread of means over 200 records against their standard errors; the naive one is a third."""
    means, errors, naive = [], [], []
    for seed in range(200):
        noise = red_noise(np.random.default_rng(seed), 400, 1.0)
        means.append(noise.mean())
        errors.append(standard_error(noise))
        naive.append(noise.std(ddof=1) / 20.0)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(means), rel=0.2)
    assert np.mean(naive) < 0.5 * np.std(means)


def test_a_drifting_tare_is_followed() -> None:
    points = reduce_series([raw(2, tare=(1.0, 3.0), sd=0.1)]).points
    tared, tare = subtract_tare(points)
    assert tare.subtracted and tare.readings == 3
    assert tare.value == pytest.approx(2.0, abs=0.1)
    assert tare.drift == pytest.approx(2.0 * 12 / 13, abs=0.15)  # between the middles of first and last rest
    assert np.all(np.abs(tared.force - A * tared.n * np.abs(tared.n)) < 0.15)
    assert "drifting" in tare.says


def test_a_tare_within_its_scatter_is_left_alone() -> None:
    """A table with one zero row as noisy as the others: subtracting it would add its error to every point."""
    n = np.arange(-15.0, 16.0)
    force = 0.1 * n * np.abs(n) + 0.2 * np.random.default_rng(5).standard_normal(31)
    force[15] = 0.1
    points = Points.measured(n, force, n, None, 0)
    assert not subtract_tare(points)[1].subtracted
    shifted, tare = subtract_tare(Points.measured(n, force + 4.0, n, None, 0))
    assert tare.subtracted and tare.value == pytest.approx(4.1) and tare.stderr > 0.05
    assert shifted.force == pytest.approx(force - 0.1)


def test_blinks_and_spikes_are_not_kept() -> None:
    record = raw(1)
    n, force = record.n.copy(), record.force.copy()
    n[850:853] = 0.0  # the tachometer blinks inside the plateau at 0.8
    force[1100:1102] = 500.0  # an electrical spike at 1.0
    reduction = reduce_series([Series("test.csv", "", n, force, record.time)])
    assert np.delete(reduction.points.n, 5) == pytest.approx(COMMANDS) and reduction.points.n[5] == 0.8
    assert reduction.left_out > 5
    assert np.max(np.abs(reduction.points.force)) < 27.0


def test_still_changing_thrust_is_said() -> None:
    n = np.repeat([0.2, 0.6, 1.0], 100)
    force = A * n * n + np.tile(np.linspace(0, 3, 100), 3) + 0.02 * np.random.default_rng(1).standard_normal(300)
    assert "still changing" in reduce_series([Series("slow.csv", "", n, force)]).notes[0]


def test_a_long_sweep_goes_in_means_of_neighbours() -> None:
    n = np.sin(np.linspace(0, 2 * np.pi, 20000))
    force = A * n * np.abs(n) + 0.5 * np.random.default_rng(0).standard_normal(20000)
    reduction = reduce_series([Series("sweep.csv", "", n, force)])
    points = reduction.points
    assert reduction.plateaus == 0 and len(points) == 2000 and points.count.sum() == 20000
    assert points.force - A * points.n * np.abs(points.n) == pytest.approx(0.0, abs=5 * 0.5 / np.sqrt(10))


@pytest.mark.parametrize("start", [600, 1800])
def test_a_faulty_plateau_among_five_is_flagged(start: int) -> None:
    """One of five commands ahead, then one astern, hardly pulls: flagged although the table is coarse."""
    record = raw(1, tare=(1.0, 1.6))
    force = record.force.copy()
    force[start : start + 200] *= 0.02
    points = reduce_series([Series("test.csv", "", record.n, force, record.time)]).points
    flagged = flag_contradictions(points, None)
    assert np.flatnonzero(flagged.flag != "").tolist() == [start // 200]


def measured_speed(seed: int, refresh: int, hold: int, levels: int, sign: float) -> tuple[np.ndarray, Series]:
    """Levels of a propeller speed in random order [rpm], and a series at 50 Hz with its lag and noise; the tachometer
    reads in steps of 5 rpm once in `refresh` samples."""
    rng = np.random.default_rng(seed)
    top = 3800.0
    level = np.concatenate([[0.0], rng.permutation(np.linspace(-top, top, levels)), [0.0]])
    speed = followed(np.repeat(level, hold), 15.0)
    force = A * speed * np.abs(speed) / top**2 + 0.3 * rng.standard_normal(len(speed))
    read = speed + 0.01 * top * rng.standard_normal(len(speed)) * (np.abs(speed) > 50.0)
    read = np.repeat((np.round(read / 5.0) * 5.0)[::refresh], refresh)[: len(speed)]
    return sign * level, Series("rpm.csv", "", sign * read, sign * force, 0.02 * np.arange(len(speed)))


@pytest.mark.parametrize(
    ("refresh", "hold", "levels", "sign"), [(1, 500, 13, 1.0), (1, 500, 13, -1.0), (5, 600, 13, 1.0), (1, 250, 25, 1.0)]
)
def test_a_measured_speed_is_reduced_by_its_own_steadiness(refresh: int, hold: int, levels: int, sign: float) -> None:
    truth, series = measured_speed(4, refresh, hold, levels, sign)
    reduction = reduce_series([series])
    points = reduction.points
    assert len(truth) <= reduction.plateaus == len(points) <= len(truth) + 3
    apart = np.abs(points.n[:, None] - truth[None, :])
    assert max(apart.min(axis=1).max(), apart.min(axis=0).max()) < 0.01 * np.abs(truth).max()
    law = fitted(points)
    assert abs(law.value * 3800.0**2 - A) < max(0.02 * A, 4.0 * law.stderr * 3800.0**2)


def test_tables_and_sweeps_have_no_steady_speed() -> None:
    """Fine sorted, shuffled, noisy and repeated tables are no raw series, also with many zeros in a row."""
    rng = np.random.default_rng(5)
    fine = np.linspace(-1, 1, 201)
    fine[np.abs(fine) < 0.085] = 0.0
    noisy = rng.permutation(np.repeat(np.linspace(-1, 1, 40), 10)) + 0.005 * rng.standard_normal(400)
    shuffled, repeated = rng.permutation(np.linspace(-1, 1, 41)), np.repeat([0.2, 0.4, 0.6, 0.8], 3)
    for n in (fine, noisy, shuffled, repeated, np.linspace(-1, 1, 1500)):
        reduction = reduce_series([Series("t.csv", "", n, n * np.abs(n))])
        assert reduction.plateaus == 0 and len(reduction.points) == len(n)


def test_a_record_without_rest_takes_the_tare_of_the_others() -> None:
    def held(run: str, n: float, force: float, seed: int) -> Series:
        noise = 0.05 * np.random.default_rng(seed).standard_normal(50)
        return Series("log.csv", run, np.full(50, n), force + noise)

    records = [held("tare", 0.0, 1.5, 0)] + [held(f"{n}", n, A * n * n + 1.5, i) for i, n in enumerate((0.3, 0.6, 1.0))]
    tared, tare = subtract_tare(reduce_series(records).points)
    assert tare.value == pytest.approx(1.5, abs=0.05)
    assert tared.force == pytest.approx([0.0, A * 0.09, A * 0.36, A], abs=0.05)
