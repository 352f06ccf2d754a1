"""What runs would tell: against a dense covariance by closed form, an actual fit, mirrored runs, and one run more."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import identify
from made_sequences import model_file
from numpy.typing import NDArray
from specified import make_runs

from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel, response
from automarine_cli.planning.campaign import fitting_of, headings_of
from automarine_cli.planning.candidates import Candidate, Limits, candidates, mirrors
from automarine_cli.planning.information import ANGLE, Fitting, read_prior_results, reported_covariance
from automarine_cli.simulation.specification import Logger, Scatter, Schedule, SequenceRuns, Specification, Vehicle

Floats = NDArray[np.float64]

INERTIA, DRAG, NOISE, SCATTER = 1.018, 1.257, np.deg2rad(1.0), 0.03
MODEL = YawModel.base("3", INERTIA, [DRAG], "nu", YAW)
FITTING = Fitting(MODEL, "whole-runs", NOISE, SCATTER)
STEP = Candidate("step", "step", ((0.8, 4.0),))
MIXED = (
    STEP,
    Candidate("step", "back", ((-0.3, 8.0),)),
    Candidate("coast-down", "coast", ((1.0, 3.0), (0.0, 5.0))),
    Candidate("reversal", "reversal", ((-1.0, 3.0), (1.0, 5.0))),
)


def dense_information(moment: float, seconds: float, rest: float = 3.0, period: float = 0.1) -> Floats:
    """J' R^-1 J of one step on (ln I, ln k_rr, offset), with R written out in full."""
    time = np.arange(round((rest + seconds) / period)) * period - rest + 0.5 * period

    def heading(log_inertia: float, log_drag: float, late: float, gain: float, zero: float) -> Floats:
        drag, delivered = DRAG * np.exp(log_drag), moment * np.exp(gain)
        after = time - late * period
        return zero + response(after, delivered, INERTIA * np.exp(log_inertia), 0.0, drag)[0]

    step = 1e-6
    columns = [(heading(*(step * np.eye(5)[i])) - heading(0, 0, 0, 0, 0)) / step for i in range(5)]
    own = np.stack([columns[3], columns[4], columns[2]], axis=1) * [SCATTER, 10.0, 1.0 / np.sqrt(12.0)]
    covariance = NOISE**2 * np.eye(len(time)) + own @ own.T
    wanted = np.stack(columns[:3], axis=1)
    return np.asarray(wanted.T @ np.linalg.solve(covariance, wanted))


def test_a_step_tells_what_its_covariance_written_out_in_full_says() -> None:
    found = FITTING.information([STEP])[0]
    wanted = dense_information(0.8, 4.0)
    unit = np.sqrt(np.diagonal(wanted))
    assert found / np.outer(unit, unit) == pytest.approx(wanted / np.outer(unit, unit), abs=2e-3)


def test_equal_runs_of_one_parameter_report_the_error_of_a_mean() -> None:
    """Of R readings with variance 1/a each, the jackknife tells 1/(R a)."""
    per_run = np.full((12, 1, 1), 4.0)
    assert reported_covariance(per_run)[0, 0] == pytest.approx(1.0 / (12 * 4.0), rel=1e-12)


def test_what_hangs_on_one_run_is_reported_as_unknown() -> None:
    """The jackknife leaves that run out: its share of the variance grows without bound."""
    per_run = np.stack([np.diag([1.0, 0.0])] * 9 + [np.diag([1.0, 1.0])])
    per_run[:9, 1, 1] = 1e-4
    assert reported_covariance(per_run)[1, 1] > 100.0
    assert reported_covariance(per_run)[0, 0] == pytest.approx(0.1, rel=1e-9)


def test_mirrored_runs_tell_the_same() -> None:
    every = candidates(MODEL, Limits(), 1.2)
    told = FITTING.information(every)
    assert told[mirrors(every)] == pytest.approx(told, rel=1e-4, abs=1e-6 * float(np.abs(told).max()))
    assert [every[i].label for i in mirrors(every)] != [one.label for one in every]


@pytest.mark.parametrize("fit", ["whole-runs", "half-turns", "diagnosis"])
def test_one_run_more_never_widens(fit: str) -> None:
    fitting = Fitting(MODEL, fit, NOISE, SCATTER)  # type: ignore[arg-type]
    runs = [
        Candidate("step", str(i), ((side * size, 12.0),))
        for i, (size, side) in enumerate(((0.3, 1), (0.6, -1), (1.2, 1), (1.0, -1)))
    ]
    told = fitting.information(runs)
    for dof in np.eye(told.shape[1]):
        errors = [dof @ np.linalg.inv(told[:count].sum(axis=0)) @ dof for count in (2, 3, 4)]
        assert errors == sorted(errors, reverse=True)


def test_more_noise_and_more_scatter_tell_less() -> None:
    quiet, loud = (Fitting(MODEL, "whole-runs", noise, SCATTER).information(MIXED) for noise in (NOISE, 2 * NOISE))
    even, uneven = (Fitting(MODEL, "whole-runs", NOISE, scatter).information(MIXED) for scatter in (0.0, 0.1))
    for more, less in ((quiet, loud), (even, uneven)):
        assert np.linalg.eigvalsh((more - less).sum(axis=0)).min() > -1e-9 * np.abs(more).max()


def test_excursions_are_those_of_the_closed_form() -> None:
    turned, _ = response(3.95, 0.8, INERTIA, 0.0, DRAG)
    assert np.abs(headings_of(FITTING.model, FITTING.logger, [STEP])[0]).max() == pytest.approx(float(turned), abs=5e-3)


def test_parameters_that_are_held_are_not_planned_for() -> None:
    model = MODEL.with_effect("dead-band", (0.03, 0.0)).with_effect("input-delay", (0.2,))
    names = Fitting(model, "diagnosis", NOISE, SCATTER).names
    assert names == ("I_r", "k_rr", "dead-band width", "input-delay t_d", "switch offset")


@pytest.mark.parametrize("fit", [pytest.param("whole-runs", marks=pytest.mark.slow), "half-turns"])
def test_predicted_intervals_are_those_that_a_fit_reports(fit: str) -> None:
    """Over a few campaigns the mean square of the reported errors is the predicted one, to a fifth; over many it is
    within a tenth (tests/benchmarks/planning.py)."""
    steps = [side * size for size in (0.3, 0.6, 1.2) for side in (1, -1) for _ in range(2)]
    runs = [Candidate("step", f"{i}", ((moment, 5.0 / np.sqrt(abs(moment))),)) for i, moment in enumerate(steps)]
    fitting = Fitting(MODEL, fit, NOISE, SCATTER)  # type: ignore[arg-type]
    told = fitting.predicted(fitting.information(runs))
    squares = np.mean([reported(runs, fit, seed) for seed in range(6)], axis=0)
    wanted = [told[name].stderr / told[name].value for name in ("I_r", "k_rr", ANGLE)]
    assert np.asarray(wanted[1:2]) / np.sqrt(squares[1:2]) == pytest.approx(1.0, abs=0.25)
    assert np.asarray(wanted) / np.sqrt(squares) == pytest.approx(1.0, abs=0.35)


def reported(runs: Sequence[Candidate], fit: str, seed: int) -> list[float]:
    """Squared relative standard errors of I_r, k_rr and their ratio from one simulated campaign."""
    groups = tuple(SequenceRuns(name=one.label, commands=one.commands, dof=YAW) for one in runs)
    made = Specification(
        Vehicle(INERTIA, DRAG, dof=YAW), Logger(noise=1.0, dof=YAW), Scatter(gain=SCATTER, dof=YAW),
        campaign=Schedule(rest_before_s=3.0), runs=groups,
    )  # fmt: skip
    found = identify(make_runs(made, seed), fit).output_error["3"]
    angle = found.inertial_turn_angle
    assert angle is not None
    return [(one.stderr / one.value) ** 2 for one in (found.estimates["I_r"], found.estimates["k_rr"], angle)]


STEPS = tuple(Candidate("step", f"{side * level}", ((side * level, 9.0),)) for level in (0.6, 1.0) for side in (1, -1))
LINEAR = Fitting(YawModel.base("1", 1.3, [0.9], "nu", YAW), "whole-runs", np.deg2rad(0.3), SCATTER)
QUIET = {"yaw.disturbance": 1e-5, "yaw.disturbance-time": 2.0, "yaw.thrust-noise": 1e-3, "gain-scatter": SCATTER}


def spread_of(fitting: Fitting) -> Floats:
    """Standard errors of ln I and ln k_r of the four steps."""
    return np.asarray(np.sqrt(np.diagonal(np.linalg.inv(fitting.information(STEPS).sum(axis=0)))))[:2]


def test_without_disturbance_innovations_tell_what_whole_runs_do() -> None:
    filtered = spread_of(replace(LINEAR, random=QUIET))
    assert filtered == pytest.approx(spread_of(LINEAR), rel=0.1)


def test_unsteady_thrust_widens_the_intervals_to_what_it_leaves_of_them() -> None:
    thrust = 0.3
    found = spread_of(replace(LINEAR, random={**QUIET, "yaw.thrust-noise": thrust}))
    # the mean of the thrust over all runs, which is all that tells the drag, is off by its noise and the gains'
    assert found[1] == pytest.approx(np.hypot(thrust / np.sqrt(4 * 9.0), SCATTER / 2.0), rel=0.3)
    assert np.all(found > 2.5 * spread_of(LINEAR))
    pushed = spread_of(replace(LINEAR, random={**QUIET, "yaw.disturbance": 0.1}))
    assert np.all(pushed > 1.5 * spread_of(LINEAR))


def test_what_is_random_is_read_from_the_file_of_a_driven_fit(tmp_path: Path) -> None:
    def estimate(value: float, unit: str) -> dict[str, object]:
        return {"value": value, "stderr": 0.1 * value, "ci95": [0.8 * value, 1.2 * value], "unit": unit}

    random = {"yaw.disturbance": estimate(0.033, "rad/s²"), "yaw.thrust-noise": estimate(0.9, "s^1/2")}
    known = read_prior_results(model_file(tmp_path / "model.json", random=random), None)
    fitting = fitting_of(known, Limits())
    assert fitting.random == {"yaw.disturbance": 0.033, "yaw.thrust-noise": 0.9}
