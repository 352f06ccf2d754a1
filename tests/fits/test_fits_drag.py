"""Table 1: least squares of the moment on the steady rate, its intervals, tests and the identity that binds its
columns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from tolerances import assert_close

from automarine_cli.dofs import SURGE, YAW
from automarine_cli.errors import FitError
from automarine_cli.fits import paper
from automarine_cli.fits.paper import DragFit, nested_test, without_noise

Floats = NDArray[np.float64]

GRID = np.array([0.1 * i for i in range(-12, 13) if i])  # the paper's moments
COLUMNS = {"1": ("k_r",), "2": ("k_rr", "k_r"), "3": ("k_rr",)}
PRINTED = {"k3": 1.257, "k2": 1.259, "k_r": 0.02753}  # its Table 1


def fit_drag(moment: Floats, rate: Floats, model: str, unit: str = "nu", variance: Floats | float = 0.0) -> DragFit:
    """A reading of Table 1 of yaw."""
    return paper.fit_drag(moment, rate, model, unit, YAW, variance=variance)


def identity_gap(rate: Floats, k3: float, k2: float, k_r: float, variance: Floats | float = 0.0) -> float:
    """k3 - (k2 + k_r sum|r|³/sum r⁴): zero for any least-squares pair of models 3 and 2, whatever the data."""
    cubes, fourths = without_noise(rate, variance)[:, 3:].sum(axis=0)
    return float(k3 - k2 - k_r * cubes / fourths)


def regressors(rate: Floats, model: str) -> Floats:
    return paper.regressors(rate, paper.powers_of(model, YAW))


def points(seed: int = 0, k_r: float = 0.1, k_rr: float = 1.2, noise: float = 0.05) -> tuple[Floats, Floats]:
    """Moments (24,) with noise and steady rates (24,) of a vehicle with both kinds of drag."""
    rate = np.sign(GRID) * (np.sqrt(k_r**2 + 4 * k_rr * np.abs(GRID)) - k_r) / (2 * k_rr)
    return GRID + noise * np.random.default_rng(seed).standard_normal(len(GRID)), rate


@pytest.mark.parametrize("model", COLUMNS)
def test_values_and_sum_of_squares_are_those_of_numpy(model: str) -> None:
    """And Akaike's criterion counts the noise as a parameter; of as few points as it can bear it is infinite."""
    moment, rate = points()
    fit, k, n = fit_drag(moment, rate, model), len(COLUMNS[model]) + 1, len(moment)
    expected, sse, *_ = np.linalg.lstsq(regressors(rate, model), moment, rcond=None)
    assert_close([fit.estimates[name].value for name in COLUMNS[model]], expected, "closed form")
    assert_close(fit.sse, sse[0], "closed form")
    assert_close(fit.residuals @ fit.residuals, fit.sse, "same arithmetic")
    assert_close(fit.aicc, n * np.log(fit.sse / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1), "closed form")
    few = np.array([0.5, -0.6, 1.0, -1.2])[: k + 1]
    assert fit_drag(few, 1.2 * few + 0.05, model).aicc == np.inf


@pytest.mark.parametrize("model", COLUMNS)
def test_standard_errors_are_hc3_from_actual_refits_without_each_point(model: str) -> None:
    """The HC3 residual e/(1 - h) is the error of predicting a point from all others."""
    moment, rate = points(3)
    x = regressors(rate, model)
    meat = np.zeros((x.shape[1], x.shape[1]))
    for i in range(len(moment)):
        others = np.arange(len(moment)) != i
        missed = moment[i] - x[i] @ np.linalg.lstsq(x[others], moment[others], rcond=None)[0]
        meat += missed**2 * np.outer(x[i], x[i])
    bread = np.linalg.inv(x.T @ x)
    expected = np.sqrt(np.diagonal(bread @ meat @ bread))
    fit = fit_drag(moment, rate, model)
    for name, error in zip(COLUMNS[model], expected):
        estimate = fit.estimates[name]
        half = stats.t.ppf(0.975, len(moment) - x.shape[1]) * error
        assert_close(estimate.stderr, error, "closed form")
        assert_close(estimate.ci95, (estimate.value - half, estimate.value + half), "closed form")


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """400 campaigns whose scatter grows with the moment, where ordinary intervals would be too short."""
    rng, held = np.random.default_rng(11), 0
    for _ in range(400):
        moment = GRID * (1.0 + 0.1 * rng.standard_normal(len(GRID)))
        low, high = fit_drag(moment, np.sign(GRID) * np.sqrt(np.abs(GRID) / 1.257), "3").estimates["k_rr"].ci95
        held += low <= 1.257 <= high
    assert 0.92 <= held / 400 <= 0.98


def test_nested_test_is_the_f_test_and_for_one_parameter_the_square_of_students() -> None:
    moment, rate = points()
    small, large = fit_drag(moment, rate, "3"), fit_drag(moment, rate, "2")
    found = nested_test(small, large)
    assert found is not None
    x = regressors(rate, "2")
    s2 = large.sse / (len(moment) - 2)
    t = large.estimates["k_r"].value / np.sqrt(s2 * np.linalg.inv(x.T @ x)[1, 1])
    assert found["dof"] == (1, len(moment) - 2)
    assert_close(found["f"], t**2, "closed form")
    assert_close(found["p_value"], 2 * stats.t.sf(abs(t), len(moment) - 2), "closed form")


def test_models_of_which_one_has_a_drag_for_each_way_are_not_nested() -> None:
    moment = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
    rate = np.sign(moment) * np.sqrt(np.abs(moment) / np.where(moment > 0, 2.0, 1.5))
    small, large, both = (
        paper.fit_drag(moment, rate, number, "N", SURGE, sided=sided)
        for number, sided in (("3", True), ("2", False), ("2", True))
    )
    assert nested_test(small, large) is None and nested_test(small, both) is not None


@given(st.integers(0, 10_000), st.integers(4, 60), st.floats(0.001, 0.1))
def test_identity_of_models_2_and_3_holds_for_any_data(seed: int, count: int, noise: float) -> None:
    """Even where the moments have nothing to do with the rates, and where noise of the rates was taken off."""
    rng = np.random.default_rng(seed)
    moment, rate = rng.normal(size=count), rng.normal(size=count)
    (_, k3), (k_r, k2) = fit_drag(moment, rate, "3").drag, fit_drag(moment, rate, "2").drag
    scale = abs(k2) + abs(k_r) * np.sum(np.abs(rate) ** 3) / np.sum(rate**4)
    assert abs(identity_gap(rate, k3, k2, k_r)) <= 1e-10 * scale
    rate = points()[1] + noise * rng.standard_normal(len(GRID))
    two = fit_drag(GRID, rate, "2", variance=noise**2)
    (_, k3), (k_r, k2) = fit_drag(GRID, rate, "3", variance=two.variance).drag, two.drag
    assert abs(identity_gap(rate, k3, k2, k_r, two.variance)) <= 1e-9 * (abs(k2) + abs(k_r))


@pytest.mark.parametrize("model", COLUMNS)
def test_dilution_is_taken_off(model: str) -> None:
    """500 campaigns with noise in the rates: the mean comes out right, and plain least squares do not."""
    rate = GRID if model == "1" else points(k_r=0.0)[1]
    rng, sd = np.random.default_rng(2), 0.06
    fits = [fit_drag(GRID, rate + sd * rng.standard_normal(len(GRID)), model, variance=sd**2) for _ in range(500)]
    name = "k_rr" if model == "3" else "k_r"
    true = {"1": 1.0, "2": 0.0}.get(model, 1.2)
    values = np.array([fit.estimates[name].value for fit in fits])
    plain = values - [fit.dilution[name] for fit in fits]
    error = values.std(ddof=1) / np.sqrt(len(fits))
    # what is left is of second order: a quotient of sums that are right on the mean is not
    assert abs(values.mean() - true) < 0.25 * abs(plain.mean() - true) > 1.5 * error


def test_the_printed_pair_breaks_the_identity() -> None:
    """PHYSICS 4.3: with k_r = +0.0275 the column of model 3 must exceed that of model 2 by 0.028 at least."""
    rate = np.sign(GRID) * np.sqrt(np.abs(GRID) / PRINTED["k3"])
    gap = identity_gap(rate, **PRINTED)
    assert gap < -0.002 - 0.028
    rounding = identity_gap(rate, PRINTED["k3"] + 0.001, PRINTED["k2"] - 0.001, PRINTED["k_r"])
    assert rounding < -0.028


@pytest.mark.parametrize("model", COLUMNS)
def test_mirrored_turns_give_the_same_table_and_units_follow_the_moment(model: str) -> None:
    moment, rate = points(7)
    there, mirrored = fit_drag(moment, rate, model), fit_drag(-moment, -rate, model, "N m")
    assert there.sse == mirrored.sse and there.aicc == mirrored.aicc
    for name, estimate in there.estimates.items():
        back = mirrored.estimates[name]
        assert back.value == pytest.approx(estimate.value, rel=1e-14)
        assert back.stderr == pytest.approx(estimate.stderr, rel=1e-13)
        assert back.unit == {"k_rr": "N m s²", "k_r": "N m s"}[name]
        assert estimate.unit == back.unit.replace("N m", "nu")


@pytest.mark.parametrize(
    ("moment", "model", "sizes"),
    [([0.5], "1", 1), ([0.5, -0.5], "2", 1), ([0.5, -0.5, 0.5, -0.5], "2", 1)],  # of one size: no two terms
)
def test_too_few_points_are_refused_with_what_to_do(moment: list[float], model: str, sizes: int) -> None:
    sentence = rf"model {model} of Table 1 needs .*there are {len(moment)} at {sizes}: run more moments"
    with pytest.raises(FitError, match=sentence):
        fit_drag(np.array(moment), 1.2 * np.array(moment), model)
