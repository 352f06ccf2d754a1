"""The square law and its intervals, the forms and their choice, against known truth."""

import numpy as np
import pytest
from scipy.signal import lfilter

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.thrusters.bollard_data import (
    Points,
    Series,
    flag_contradictions,
    reduce_series,
    standard_error,
    subtract_tare,
)
from automarine_cli.thrusters.curves import FORMS, PowerCurve
from automarine_cli.thrusters.fit import Shape, bollard_data, fit_shape
from automarine_cli.thrusters.result import analyse

# The source paper's equation 3 for two thrusters, halved (PHYSICS 4.5): N per control count squared.
AHEAD, ASTERN = 2.6165e-4, 0.6640e-4
LEVELS = np.arange(10.0, 151.0, 10.0)
BOTH = np.concatenate([-LEVELS[::-1], LEVELS])
EXACT = 1e-9  # algebra on data without noise


def points(n: np.ndarray, force: np.ndarray, record: int = 0) -> Points:
    return Points.measured(np.asarray(n, dtype=float), force, np.arange(float(len(n))), None, record)


def square_law(data: Points, side: str = "forward") -> Estimate:
    fit = fit_shape(bollard_data(data, 0.0, "", [side]), Shape.alike(FORMS["square"], [side]))
    law = fit.estimates[side]["a"]
    assert isinstance(law, Estimate)
    return law


def paper(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


def test_equation_three_comes_back_from_its_own_data() -> None:
    analysis = analyse(points(BOTH, paper(BOTH)), 0.0, "")
    assert analysis.square["forward"].value == pytest.approx(AHEAD, rel=EXACT)
    assert analysis.square["backward"].value == pytest.approx(ASTERN, rel=EXACT)
    assert analysis.square["forward"].value / analysis.square["backward"].value == pytest.approx(3.9405, abs=1e-4)
    assert analysis.chosen.form.name == "square"
    assert analysis.r2(analysis.law) == pytest.approx(1.0, abs=EXACT)
    assert analysis.map.force(150.0) == pytest.approx(5.89, abs=0.005)
    assert analysis.map.force(-150.0) == pytest.approx(-1.49, abs=0.005)


@pytest.mark.parametrize("proportional", [False, True])
def test_intervals_hold_the_truth_as_often_as_they_say(proportional: bool) -> None:
    """400 campaigns each; 95 % intervals within three binomial standard errors (and no wider than 99 %)."""
    held, campaigns = 0, 400
    for seed in range(campaigns):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(len(BOTH))
        force = paper(BOTH) * (1.0 + 0.05 * noise) if proportional else paper(BOTH) + 0.1 * noise
        low, high = square_law(points(BOTH, force)).ci95
        held += low <= AHEAD <= high
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / campaigns) <= held / campaigns <= 0.99


def test_repeats_of_a_level_count_once() -> None:
    """An error common to a level's repeats is not averaged away by logging it ten times."""
    rng = np.random.default_rng(4)
    force = paper(LEVELS) + 0.1 * rng.standard_normal(len(LEVELS))
    once = square_law(points(LEVELS, force))
    tenfold = square_law(points(np.tile(LEVELS, 10), np.tile(force, 10)))
    assert tenfold.value == pytest.approx(once.value, rel=EXACT)
    assert tenfold.stderr == pytest.approx(once.stderr, rel=EXACT)


def of_records(gains: np.ndarray) -> Estimate:
    """The square law ahead of whole records over the same levels, each with its gain."""
    n = np.tile(LEVELS, len(gains))
    together = points(n, np.repeat(gains, len(LEVELS)) * paper(n))
    together = Points(**{**vars(together), "record": np.repeat(np.arange(len(gains)), len(LEVELS))})
    return square_law(together)


def test_gain_that_differs_between_records_widens_the_interval() -> None:
    """The record is the unit, not the level: also where records lie either side of their mean, so that every level's
    residuals sum to nothing."""
    fits = [of_records(1.0 + 0.05 * np.random.default_rng(seed).standard_normal(6)) for seed in range(40)]
    assert 0.7 < np.std([(fit.value - AHEAD) / fit.stderr for fit in fits]) < 1.6
    assert np.mean([fit.ci95[0] <= AHEAD <= fit.ci95[1] for fit in fits]) >= 0.85
    for gains in (np.array([0.98, 1.02]), np.array([0.97, 1.0, 1.03])):
        fit = of_records(gains)
        assert fit.value == pytest.approx(AHEAD, rel=EXACT)
        assert fit.stderr == pytest.approx(AHEAD * np.std(gains) / np.sqrt(len(gains)), rel=1e-6)


def test_mirrored_data_swap_the_directions() -> None:
    force = paper(BOTH) + 0.05 * np.random.default_rng(1).standard_normal(len(BOTH))
    plain, mirrored = (analyse(points(sign * BOTH, sign * force), 0.0, "") for sign in (1.0, -1.0))
    for here, there in (("forward", "backward"), ("backward", "forward")):
        assert plain.square[here].value == pytest.approx(mirrored.square[there].value, rel=EXACT)
        assert plain.square[here].stderr == pytest.approx(mirrored.square[there].stderr, rel=EXACT)
    assert plain.chosen.form == mirrored.chosen.form
    errors = [[score.cv_rmse for score in analysis.fits] for analysis in (plain, mirrored)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)


TRUTHS = {
    "square": (PowerCurve(30.0), PowerCurve(12.0)),
    "dead-band": (PowerCurve(40.0, n_0=0.12), PowerCurve(25.0, n_0=0.08)),
    "power": (PowerCurve(30.0, 1.5), PowerCurve(20.0, 1.6)),
    "dead-band-power": (PowerCurve(40.0, 1.4, 0.08), PowerCurve(30.0, 1.3, 0.1)),
    "square-saturation": (PowerCurve(40.0, n_sat=0.7), PowerCurve(30.0, n_sat=0.6)),
    "dead-band-saturation": (PowerCurve(60.0, n_0=0.15, n_sat=0.7), PowerCurve(50.0, n_0=0.12, n_sat=0.75)),
    "power-saturation": (PowerCurve(40.0, 1.4, n_sat=0.7), PowerCurve(30.0, 1.3, n_sat=0.75)),
    "dead-band-power-saturation": (PowerCurve(50.0, 1.4, 0.12, 0.7), PowerCurve(40.0, 1.3, 0.1, 0.75)),
}


def series_of(ahead: PowerCurve, astern: PowerCurve, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    level = np.arange(1, count + 1) / count
    n = np.concatenate([-level[::-1], level])
    return n, np.where(n > 0, ahead.thrust(np.abs(n)), -astern.thrust(np.abs(n)))


QUICK = ("square", "power", "dead-band-power", "square-saturation")


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in TRUTHS if name not in QUICK)]
)
def test_cross_validation_finds_the_form_and_its_truth(name: str) -> None:
    """Exact without noise; with 1 % of full scale on 40 levels a direction parameters within 4 standard errors."""
    n, force = series_of(*TRUTHS[name])
    noisy = force + 0.01 * np.max(np.abs(force)) * np.random.default_rng(7).standard_normal(len(n))
    analysis = analyse(points(n, noisy), 0.0, "")
    assert analysis.chosen.form.name == name
    parts = bollard_data(points(n, force), 0.0, "", ["forward", "backward"]).parts(tied=False)
    for (side, (_, data)), truth in zip(parts.items(), TRUTHS[name], strict=True):
        exact, _ = FORMS[name].fit(data.n, data.force, data.weight)
        assert isinstance(exact, PowerCurve) and exact.a == pytest.approx(truth.a, rel=1e-4)
        assert (exact.p, exact.n_0) == pytest.approx((truth.p, truth.n_0), abs=1e-4)
        assert exact.n_sat == (truth.n_sat if truth.n_sat is None else pytest.approx(truth.n_sat, abs=1e-4))
        for key in FORMS[name].free(exact):
            estimate = analysis.chosen.estimates[side][key]
            assert isinstance(estimate, Estimate) and abs(estimate.value - getattr(truth, key)) < 4.0 * estimate.stderr


@pytest.mark.parametrize(
    ("n", "force", "words"),
    [
        (BOTH, np.zeros_like(BOTH), "every thrust is zero"),
        (BOTH, -paper(BOTH), r"opposite sign of the control signal.*sign = -1"),
        (BOTH, np.abs(paper(BOTH)), "logged as a magnitude"),
        (np.array([10.0, 20.0]), np.array([1.0, 4.0]), "at least 3 different commands"),
        (np.zeros(5), np.ones(5), "no direction can be fitted"),
        (BOTH + 1500.0, np.abs(paper(BOTH)), r"gives nothing at .*subtract = 1500"),
        (BOTH + 1500.0, paper(BOTH), r"push both ways.*subtract = REST"),
    ],
)
def test_bad_data_are_refused_with_what_to_write(n: np.ndarray, force: np.ndarray, words: str) -> None:
    with pytest.raises(FitError, match=words):
        analyse(points(n, force), 0.0, "")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("what", ["no thrust", "tachometer", "two side by side", "reversed"])
def test_contradictions_are_flagged_and_barely_matter(what: str, sign: float) -> None:
    n = sign * BOTH
    force = sign * paper(BOTH) + 0.03 * np.random.default_rng(3).standard_normal(len(BOTH))
    wrong = [25, 26] if what == "two side by side" else [26]
    if what == "tachometer":
        n[wrong] = 0.0
    else:
        force[wrong] = -force[wrong] if what == "reversed" else 0.0
    flagged = flag_contradictions(points(n, force))
    assert np.flatnonzero(flagged.flag != "").tolist() == wrong
    assert np.all(flagged.weight[wrong] < 0.01) and np.all(np.delete(flagged.weight, wrong) == 1.0)
    law = square_law(subtract_tare(flagged)[0], "forward" if sign > 0 else "backward")
    assert law.value == pytest.approx(AHEAD, rel=0.02)


def test_clean_data_have_no_contradictions() -> None:
    flags = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(len(BOTH))
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) + 0.2 * noise)).flag != "")
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) * (1 + 0.03 * noise))).flag != "")
    assert flags <= 4  # of 2400 points
    n = np.arange(-20, 21) / 20.0  # a dead band is no drop-out
    force = np.sign(n) * PowerCurve(30.0, 1.5, 0.12).thrust(np.abs(n))
    assert np.all(flag_contradictions(points(n, force)).flag == "")


@pytest.mark.slow
def test_scatter_that_grows_with_the_thrust_is_no_contradiction() -> None:
    """In newtons the highest levels look wild (30 % of such tests); a wild reading of an even test is still seen."""
    n = np.concatenate([np.arange(-15, 0), np.arange(1, 16)]) / 15.0
    force, blamed, wild = 25.0 * n * np.abs(n), 0, 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        blamed += np.any(flag_contradictions(points(n, force * np.exp(0.1 * random.standard_normal(30)))).flag != "")
        place, even = int(random.integers(30)), force + 0.1 * random.standard_normal(30)
        even[place] += 7.5 * random.choice([-1.0, 1.0])
        wild += bool(flag_contradictions(points(n, even)).flag[place])
    assert blamed <= 8 and wild >= 53


# Raw load-cell series: plateaus, transients, drop-outs, standard errors, tare and its drift


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
    tared, _ = subtract_tare(flag_contradictions(points))
    return square_law(tared)


def test_one_plateau_for_each_command_with_its_transient_dropped() -> None:
    points, _ = reduce_series([raw(0)])
    assert points.n == pytest.approx(COMMANDS)
    assert len(points) == len(COMMANDS) and points.raw.all()
    assert points.count.sum() < 200 * len(COMMANDS) - 10 * 15  # ten steps of up to 9 N, a lag of 8 samples each
    assert np.all(points.count >= 100)
    # Noise of 0.3 N with a memory of 0.8 leaves 0.064 N in a mean of 200 samples.
    assert np.max(np.abs(points.force - A * points.n * np.abs(points.n))) < 5 * 0.064
    assert np.sqrt(np.mean(points.stderr**2)) == pytest.approx(0.064, rel=0.3)
    measured = reduce_series([raw(3, n_noise=0.003)])[0]  # a measured speed with noise is still held
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
    points = reduce_series([raw(2, tare=(1.0, 3.0), sd=0.1)])[0]
    tared, tare = subtract_tare(points)
    assert tare.subtracted and tare.readings == 3
    assert tare.value_N == pytest.approx(2.0, abs=0.1)
    assert tare.drift_N == pytest.approx(2.0 * 12 / 13, abs=0.15)  # between the middles of first and last rest
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
    assert tare.subtracted and tare.value_N == pytest.approx(4.1) and tare.stderr_N > 0.05
    assert shifted.force == pytest.approx(force - 0.1)


def test_blinks_and_spikes_are_not_kept() -> None:
    record = raw(1)
    n, force = record.n.copy(), record.force.copy()
    n[850:853] = 0.0  # the tachometer blinks inside the plateau at 0.8
    force[1100:1102] = 500.0  # an electrical spike at 1.0
    points, _ = reduce_series([Series("test.csv", "", n, force, record.time)])
    assert np.delete(points.n, 5) == pytest.approx(COMMANDS) and points.n[5] == 0.8
    assert points.count.sum() < len(n) - 5
    assert np.max(np.abs(points.force)) < 27.0


def test_still_changing_thrust_is_said() -> None:
    n = np.repeat([0.2, 0.6, 1.0], 100)
    force = A * n * n + np.tile(np.linspace(0, 3, 100), 3) + 0.02 * np.random.default_rng(1).standard_normal(300)
    assert "still changing" in reduce_series([Series("slow.csv", "", n, force)])[1][0]


@pytest.mark.parametrize("start", [600, 1800])
def test_a_faulty_plateau_among_five_is_flagged(start: int) -> None:
    """One of five commands ahead, then one astern, hardly pulls: flagged although the table is coarse."""
    record = raw(1, tare=(1.0, 1.6))
    force = record.force.copy()
    force[start : start + 200] *= 0.02
    points = reduce_series([Series("test.csv", "", record.n, force, record.time)])[0]
    flagged = flag_contradictions(points)
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
    points, _ = reduce_series([series])
    assert points.raw.all() and len(truth) <= len(points) <= len(truth) + 3
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
        points, _ = reduce_series([Series("t.csv", "", n, n * np.abs(n))])
        assert not points.raw.any() and len(points) == len(n)
