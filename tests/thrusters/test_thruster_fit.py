"""The square law and its intervals, the forms and their choice, against known truth."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from automarine_cli.errors import FitError
from automarine_cli.thrusters.bollard_data import (
    Points,
    flag_contradictions,
    groups_of,
    levels_of,
    subtract_tare,
    voltage_steps,
)
from automarine_cli.thrusters.fit import analyse, best_curve, sides_of, square_law
from automarine_cli.thrusters.map import FORMS, Curve, fit_direction

# The source paper's equation 3 for two thrusters, halved (PHYSICS 4.5): N per control count squared.
AHEAD, ASTERN = 2.6165e-4, 0.6640e-4
LEVELS = np.arange(10.0, 151.0, 10.0)
BOTH = np.concatenate([-LEVELS[::-1], LEVELS])
EXACT = 1e-9  # algebra on data without noise


def points(n: np.ndarray, force: np.ndarray, record: int = 0) -> Points:
    return Points.measured(np.asarray(n, dtype=float), force, np.arange(float(len(n))), None, record)


def paper(n: np.ndarray) -> np.ndarray:
    return np.where(n > 0, AHEAD, ASTERN) * n * np.abs(n)


def test_equation_three_comes_back_from_its_own_data() -> None:
    analysis = analyse(points(BOTH, paper(BOTH)), None, 0.0, "")
    assert analysis.square["forward"].value == pytest.approx(AHEAD, rel=EXACT)
    assert analysis.square["backward"].value == pytest.approx(ASTERN, rel=EXACT)
    assert analysis.square["forward"].value / analysis.square["backward"].value == pytest.approx(3.9405, abs=1e-4)
    assert analysis.chosen.form.name == "square"
    assert analysis.r2 == pytest.approx(1.0, abs=EXACT)
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
        low, high = square_law(sides_of(points(BOTH, force), None, 0.0)["forward"], "N").ci95
        held += low <= AHEAD <= high
    assert 0.95 - 3 * np.sqrt(0.95 * 0.05 / campaigns) <= held / campaigns <= 0.99


def test_repeats_of_a_level_count_once() -> None:
    """An error common to a level's repeats is not averaged away by logging it ten times."""
    rng = np.random.default_rng(4)
    force = paper(LEVELS) + 0.1 * rng.standard_normal(len(LEVELS))
    once = square_law(sides_of(points(LEVELS, force), None, 0.0)["forward"], "N")
    tenfold = square_law(sides_of(points(np.tile(LEVELS, 10), np.tile(force, 10)), None, 0.0)["forward"], "N")
    assert tenfold.value == pytest.approx(once.value, rel=EXACT)
    assert tenfold.stderr == pytest.approx(once.stderr, rel=EXACT)


def test_gain_that_differs_between_records_widens_the_interval() -> None:
    """Six records over the same levels, each with its own gain: the record is the unit, not the level."""
    scatter, inside = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = np.tile(LEVELS, 6)
        gain = np.repeat(1.0 + 0.05 * rng.standard_normal(6), len(LEVELS))
        parts = points(n, gain * paper(n))
        parts = Points(**{**vars(parts), "record": np.repeat(np.arange(6), len(LEVELS))})
        estimate = square_law(sides_of(parts, None, 0.0)["forward"], "N")
        scatter.append((estimate.value - AHEAD) / estimate.stderr)
        inside.append(estimate.ci95[0] <= AHEAD <= estimate.ci95[1])
    assert 0.7 < np.std(scatter) < 1.6
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize("gains", [(0.98, 1.02), (0.97, 1.0, 1.03)])
def test_gains_that_cancel_within_levels_are_still_scatter(gains: tuple[float, ...]) -> None:
    """Two or three whole records either side of their mean: every level's residuals sum to nothing."""
    n = np.tile(LEVELS, len(gains))
    both = points(n, np.repeat(gains, len(LEVELS)) * paper(n))
    both = Points(**{**vars(both), "record": np.repeat(np.arange(len(gains)), len(LEVELS))})
    estimate = square_law(sides_of(both, None, 0.0)["forward"], "N")
    assert estimate.value == pytest.approx(AHEAD, rel=EXACT)
    assert estimate.stderr == pytest.approx(AHEAD * np.std(gains) / np.sqrt(len(gains)), rel=1e-6)


def test_mirrored_data_swap_the_directions() -> None:
    rng = np.random.default_rng(1)
    force = paper(BOTH) + 0.05 * rng.standard_normal(len(BOTH))
    one = analyse(points(BOTH, force), None, 0.0, "")
    other = analyse(points(-BOTH[::-1], -force[::-1]), None, 0.0, "")
    for here, there in (("forward", "backward"), ("backward", "forward")):
        assert one.square[here].value == pytest.approx(other.square[there].value, rel=EXACT)
        assert one.square[here].stderr == pytest.approx(other.square[there].stderr, rel=EXACT)
    assert one.chosen.form == other.chosen.form
    for mine, theirs in zip(one.scores, other.scores):
        assert mine.cv_rmse == pytest.approx(theirs.cv_rmse, rel=1e-6)


TRUTHS = {
    "square": (Curve(30.0), Curve(12.0)),
    "dead-band": (Curve(40.0, n_0=0.12), Curve(25.0, n_0=0.08)),
    "power": (Curve(30.0, 1.5), Curve(20.0, 1.6)),
    "dead-band-power": (Curve(40.0, 1.4, 0.08), Curve(30.0, 1.3, 0.1)),
    "square-saturation": (Curve(40.0, n_sat=0.7), Curve(30.0, n_sat=0.6)),
    "dead-band-saturation": (Curve(60.0, n_0=0.15, n_sat=0.7), Curve(50.0, n_0=0.12, n_sat=0.75)),
    "power-saturation": (Curve(40.0, 1.4, n_sat=0.7), Curve(30.0, 1.3, n_sat=0.75)),
    "dead-band-power-saturation": (Curve(50.0, 1.4, 0.12, 0.7), Curve(40.0, 1.3, 0.1, 0.75)),
}


def series_of(ahead: Curve, astern: Curve, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    level = np.arange(1, count + 1) / count
    n = np.concatenate([-level[::-1], level])
    return n, np.where(n > 0, ahead.thrust(np.abs(n)), -astern.thrust(np.abs(n)))


@pytest.mark.parametrize("name", TRUTHS)
def test_every_form_recovers_its_own_truth(name: str) -> None:
    n, force = series_of(*TRUTHS[name])
    for side, truth in zip(sides_of(points(n, force), None, 0.0).values(), TRUTHS[name]):
        curve, _ = best_curve(side, FORMS[name])
        assert curve.a == pytest.approx(truth.a, rel=1e-4)
        assert curve.p == pytest.approx(truth.p, abs=1e-4)
        assert curve.n_0 == pytest.approx(truth.n_0, abs=1e-4)
        assert (curve.n_sat is None) == (truth.n_sat is None)
        if truth.n_sat is not None:
            assert curve.n_sat == pytest.approx(truth.n_sat, abs=1e-4)


@pytest.mark.parametrize("name", TRUTHS)
def test_cross_validation_finds_the_form_in_noise(name: str) -> None:
    """1 % of full scale of noise on 40 levels a direction: the true form, its parameters within 4 errors."""
    n, force = series_of(*TRUTHS[name])
    noisy = force + 0.01 * np.max(np.abs(force)) * np.random.default_rng(7).standard_normal(len(n))
    analysis = analyse(points(n, noisy), None, 0.0, "")
    assert analysis.chosen.form.name == name
    for side, truth in zip(("forward", "backward"), TRUTHS[name]):
        for key in FORMS[name].free:
            found = analysis.parameters[side][key].estimate
            assert found is not None and abs(found.value - getattr(truth, key)) < 4.0 * found.stderr


@pytest.mark.slow
def test_twenty_points_refuse_four_parameters() -> None:
    """The full form always fits 20 noisy square-law points better, and predicts left-out levels worse."""
    level = np.arange(1, 11) / 10.0
    n = np.concatenate([-level[::-1], level])
    chosen, worse = [], 0
    for seed in range(12):
        noise = 0.4 * np.random.default_rng(seed).standard_normal(len(n))
        analysis = analyse(points(n, np.where(n > 0, 30.0, 12.0) * n * np.abs(n) + noise), None, 0.0, "")
        scores = {score.form.name: score for score in analysis.scores}
        square, full = scores["square"], scores["dead-band-power-saturation"]
        assert full.rmse <= square.rmse
        assert full.cv_rmse is not None and square.cv_rmse is not None
        worse += full.cv_rmse > square.cv_rmse
        chosen.append(analysis.chosen.form.parameters)
    assert worse >= 11
    assert max(chosen) <= 2
    assert chosen.count(1) >= 10


def test_the_fitter_reaches_scipys_minimum() -> None:
    """Batched Levenberg-Marquardt against scipy from the truth: never a worse sum of squares."""
    truth = TRUTHS["dead-band-power-saturation"][0]
    n = np.arange(1, 31) / 30.0
    for seed in range(6):
        y = truth.thrust(n) + 0.3 * np.random.default_rng(seed).standard_normal(len(n))
        mine = fit_direction(n, y, np.ones((1, len(n))), FORMS["dead-band-power-saturation"])
        ours = float(np.sum((y - mine.thrust(n)[0]) ** 2))

        def residual(theta: np.ndarray, y: np.ndarray = y) -> np.ndarray:
            return y - Curve(*theta).thrust(n)

        start = [truth.a, truth.p, truth.n_0, truth.n_sat]
        theirs = least_squares(residual, start, bounds=([0, 0.3, 0, 0.3], [np.inf, 4.0, 0.8, 1.0]))
        assert ours <= 2.0 * theirs.cost * (1 + 1e-6)


def test_left_out_levels_get_no_weight() -> None:
    """A row of weights with zeros is the fit without those points."""
    n, force = series_of(*TRUTHS["power"], count=12)
    side = sides_of(points(n, force + 0.2 * np.sin(9 * n)), None, 0.0)["forward"]
    weights = np.ones((2, 12))
    weights[1, 4] = 0.0
    both = fit_direction(side.magnitude, side.thrust, weights, FORMS["power"])
    kept = np.arange(12) != 4
    alone = fit_direction(side.magnitude[kept], side.thrust[kept], np.ones((1, 11)), FORMS["power"])
    assert both.values[1] == pytest.approx(alone.values[0], rel=1e-6)


def test_choice_is_explained_and_can_be_forced() -> None:
    n, force = series_of(*TRUTHS["power"])
    analysis = analyse(points(n, force), None, 0.0, "", "dead-band")
    assert analysis.chosen.form.name == "dead-band"
    assert "asked for" in analysis.because and "power" in analysis.because
    free = analyse(points(n, force), None, 0.0, "")
    assert "one standard error" in free.because
    with pytest.raises(FitError, match="choose one of square, dead-band"):
        analyse(points(n, force), None, 0.0, "", "cubic")


def test_a_direction_that_was_not_measured_has_a_why() -> None:
    analysis = analyse(points(LEVELS, paper(LEVELS)), None, 0.0, "")
    assert analysis.without == {"backward": "no backward points"}
    assert "backward" not in analysis.square
    few = np.concatenate([[-20.0, -10.0], LEVELS])
    analysis = analyse(points(few, paper(few)), None, 0.0, "")
    assert analysis.without["backward"] == "2 backward levels, at least 3 needed"


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
def test_bad_data_are_refused_in_one_sentence(n: np.ndarray, force: np.ndarray, words: str) -> None:
    with pytest.raises(FitError, match=words) as refusal:
        analyse(points(n, force), None, 0.0, "")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("what", ["no thrust", "tachometer", "two side by side", "reversed"])
def test_contradictions_are_flagged_and_barely_matter(what: str, sign: float) -> None:
    rng = np.random.default_rng(3)
    n = sign * BOTH
    force = sign * paper(BOTH) + 0.03 * rng.standard_normal(len(BOTH))
    wrong = [25, 26] if what == "two side by side" else [26]
    if what == "tachometer":
        n[wrong] = 0.0
    else:
        force[wrong] = -force[wrong] if what == "reversed" else 0.0
    flagged = flag_contradictions(points(n, force), None)
    assert np.flatnonzero(flagged.flag != "").tolist() == wrong
    assert len(flagged) == len(BOTH)
    assert np.all(flagged.weight[wrong] < 0.01) and np.all(np.delete(flagged.weight, wrong) == 1.0)
    if what == "tachometer":
        assert "tachometer" in flagged.flag[wrong[0]]
    tared, _ = subtract_tare(flagged)
    analysis = analyse(tared, None, 0.0, "")
    assert analysis.square["forward" if sign > 0 else "backward"].value == pytest.approx(AHEAD, rel=0.02)


def test_clean_noisy_data_have_no_contradictions() -> None:
    flags = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(len(BOTH))
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) + 0.2 * noise), None).flag != "")
        flags += np.count_nonzero(flag_contradictions(points(BOTH, paper(BOTH) * (1 + 0.03 * noise)), None).flag != "")
    assert flags <= 4  # of 2400 points


def test_a_dead_band_is_no_drop_out() -> None:
    n = np.arange(-20, 21) / 20.0
    force = np.sign(n) * Curve(30.0, 1.5, 0.12).thrust(np.abs(n))
    assert np.all(flag_contradictions(points(n, force), None).flag == "")


def test_levels_blocks_and_voltage_steps() -> None:
    n = np.array([0.0, 0.001, 0.5, 0.501, 1.0, -1.0])
    level = levels_of(n)
    assert level[0] != level[1] and level[2] == level[3] and len(np.unique(level)) == 5
    assert len(np.unique(groups_of(np.arange(1.0, 101.0)))) == 20
    assert len(np.unique(groups_of(np.arange(1.0, 19.0)))) == 18
    steps = voltage_steps(np.array([12.0, 12.1, 16.2, 11.95, 16.0]))
    assert steps is not None and steps.tolist() == [0, 0, 1, 0, 1]
    assert voltage_steps(np.array([12.0, np.nan])) is None
