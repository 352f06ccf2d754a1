"""What runs would tell: against a dense covariance by closed form, an actual fit, mirrored runs, and one run more. How
far they split explanations: known misfits, symmetry, and what steps cannot tell but other runs can."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified import identify
from made_sequences import model_file
from specified import make_runs

from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model, response
from automarine_cli.planning.campaign import fitting_of
from automarine_cli.planning.candidates import Limits, PaperRun, candidates, mirrors
from automarine_cli.planning.information import ANGLE, Fitting, read_prior_results, reported_covariance
from automarine_cli.planning.rivals import closest, fitted, splits, with_effect
from automarine_cli.quantities import Floats
from automarine_cli.simulation.specification import Logger, Scatter, Schedule, SequenceRuns, Specification, Vehicle

BASE = Model.base("3", 1.018, [1.257], "nu", YAW)
FITTING = Fitting(BASE, "diagnosis", np.deg2rad(1.0), 0.03, frame=BASE)
STEPS = tuple(
    PaperRun("step", f"{side * size:+g}", ((side * size, round(4.6 / np.sqrt(size), 1)),))
    for size in (0.1, 0.3, 0.6, 0.9, 1.2) for side in (1, -1)
)  # fmt: skip
COASTS = tuple(PaperRun("coast-down", f"c{side}", ((side * 1.2, 3.0), (0.0, 15.0))) for side in (1, -1))
RAMPS = tuple(
    PaperRun("slow-ramp", f"r{side}", tuple((side * round(0.12 * (i / 10 - 0.95), 4), 2.0) for i in range(20)))
    for side in (1, -1)
)  # fmt: skip


def explanation(name: str, values: tuple[float, ...]) -> Fitting:
    return replace(FITTING, model=BASE.with_effect(name, values), explained_by=name)


def rival_of(true: Fitting, name: str) -> Fitting:
    return replace(closest(true, with_effect(FITTING, BASE, name, 1.2), STEPS)[0], explained_by=name)


def test_what_is_true_fits_itself() -> None:
    true = explanation("dead-band", (0.03,))
    started = replace(true, model=BASE.with_theta([1.1, 1.2]).with_effect("dead-band", (0.05,)))
    end, misfit = fitted(true, started, STEPS)
    assert misfit < 1e-3 and end.model.theta[:3] == pytest.approx(true.model.theta[:3], rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values", "rival", "more"),
    [
        ("dead-band", (0.03,), "coulomb-drag", COASTS + RAMPS),
        ("thruster-lag", (0.15,), "sensor-lag", COASTS * 2),
        ("water-swirl", (0.03, 10.0), "tether-spring", RAMPS),
    ],
)
def test_steps_leave_a_tie(name: str, values: tuple[float, ...], rival: str, more: tuple[PaperRun, ...]) -> None:
    true = explanation(name, values)
    pair = (true, rival_of(true, rival))
    few, many = (splits([pair], runs)[0][0] for runs in (STEPS, STEPS + more))
    assert few.evidence < 10.0
    assert many.evidence > few.evidence + 8.0


def test_mirrored_runs_split_as_well() -> None:
    pair = (explanation("dead-band", (0.03,)), explanation("coulomb-drag", (0.03,)))
    here, there = (splits([pair], runs)[0][0].evidence for runs in (STEPS[::2], STEPS[1::2]))
    assert there == pytest.approx(here, rel=1e-3)


# What runs would tell: against a dense covariance by closed form, an actual fit, mirrored runs, and one run more.


INERTIA, DRAG, NOISE, SCATTER = 1.018, 1.257, np.deg2rad(1.0), 0.03

FITTED_WHOLE = Fitting(BASE, "whole-runs", NOISE, SCATTER)
STEP = PaperRun("step", "step", ((0.8, 4.0),))


def test_a_step_tells_what_its_covariance_written_out_in_full_says() -> None:
    """J' R^-1 J of one step on (ln I, ln k_rr, delay)."""
    moment, rest, period = 0.8, 3.0, 0.1
    time = np.arange(round((rest + 4.0) / period)) * period - rest + 0.5 * period

    def heading(log_inertia: float, log_drag: float, late: float, log_gain: float, zero: float) -> Floats:
        inertia, drag = INERTIA * np.exp(log_inertia), DRAG * np.exp(log_drag)
        return zero + response(time - late, moment * np.exp(log_gain), inertia, 0.0, drag)[0]

    columns = [(heading(*direction) - heading(0, 0, 0, 0, 0)) / 1e-6 for direction in 1e-6 * np.eye(5)]
    random = np.stack([columns[3], columns[4], columns[2]], axis=1) * [SCATTER, 10.0, period / np.sqrt(12.0)]
    jacobian = np.stack(columns[:3], axis=1)
    dense = jacobian.T @ np.linalg.solve(NOISE**2 * np.eye(len(time)) + random @ random.T, jacobian)
    scale = np.sqrt(np.outer(np.diagonal(dense), np.diagonal(dense)))
    assert FITTED_WHOLE.information([STEP])[0] / scale == pytest.approx(dense / scale, abs=2e-3)


def test_the_jackknife_reports_the_error_of_a_mean_and_leaves_each_run_out() -> None:
    """Of R readings with variance 1/a each it tells 1/(R a); the variance of what hangs on one run grows without
    bound."""
    assert reported_covariance(np.full((12, 1, 1), 4.0))[0, 0] == pytest.approx(1.0 / (12 * 4.0), rel=1e-12)
    per_run = np.stack([np.diag([1.0, 1e-4])] * 9 + [np.diag([1.0, 1.0])])
    variances = np.diagonal(reported_covariance(per_run))
    assert variances[1] > 100.0 and variances[0] == pytest.approx(0.1, rel=1e-9)


def test_mirrored_runs_tell_the_same() -> None:
    every = candidates(BASE, Limits(), 1.2)
    information = FITTED_WHOLE.information(every)
    limit = 1e-6 * float(np.abs(information).max())
    assert information[mirrors(every)] == pytest.approx(information, rel=1e-4, abs=limit)
    assert [every[i].label for i in mirrors(every)] != [run.label for run in every]


@pytest.mark.slow
def test_predicted_intervals_are_those_that_a_fit_reports() -> None:
    """Over a few campaigns the mean square of the reported errors is the predicted one, to a fifth; over many it is
    within a tenth."""
    steps = [side * size for size in (0.3, 0.6, 1.2) for side in (1, -1) for _ in range(2)]
    runs = [PaperRun("step", f"{i}", ((moment, 5.0 / np.sqrt(abs(moment))),)) for i, moment in enumerate(steps)]
    predicted = FITTED_WHOLE.predicted(FITTED_WHOLE.information(runs))
    squares = np.mean([reported(runs, seed) for seed in range(6)], axis=0)
    wanted = [predicted[name].stderr / predicted[name].value for name in ("I_r", "k_rr", ANGLE)]
    assert np.asarray(wanted[1:2]) / np.sqrt(squares[1:2]) == pytest.approx(1.0, abs=0.25)
    assert np.asarray(wanted) / np.sqrt(squares) == pytest.approx(1.0, abs=0.35)


def reported(runs: Sequence[PaperRun], seed: int) -> list[float]:
    """Squared relative standard errors of I_r, k_rr and their ratio from one simulated campaign."""
    campaign = Specification(
        vehicle=Vehicle(INERTIA, DRAG, dof=YAW), logger=Logger(noise=1.0, dof=YAW),
        scatter=Scatter(gain=SCATTER, dof=YAW), campaign=Schedule(rest_before_s=3.0),
        runs=tuple(SequenceRuns(kind="sequence", name=run.label, commands=run.commands, dof=YAW) for run in runs),
    )  # fmt: skip
    fit = identify(make_runs(campaign, seed), "whole-runs").output_error["3"]
    assert fit.inertial_turn_angle is not None
    estimates = (fit.estimates["I_r"], fit.estimates["k_rr"], fit.inertial_turn_angle)
    return [(estimate.stderr / estimate.value) ** 2 for estimate in estimates]


FOUR_STEPS = tuple(
    PaperRun("step", f"{side * level}", ((side * level, 9.0),)) for level in (0.6, 1.0) for side in (1, -1)
)
LINEAR = Fitting(Model.base("1", 1.3, [0.9], "nu", YAW), "whole-runs", np.deg2rad(0.3), SCATTER)
QUIET = {"yaw.disturbance": 1e-5, "yaw.disturbance-time": 2.0, "yaw.thrust-noise": 1e-3, "gain-scatter": SCATTER}


def spread_of(fitting: Fitting) -> Floats:
    """Standard errors of ln I and ln k_r of the four steps."""
    return np.asarray(np.sqrt(np.diagonal(np.linalg.inv(fitting.information(FOUR_STEPS).sum(axis=0)))))[:2]


def test_innovations_tell_what_thrust_and_disturbance_leave() -> None:
    """Without them what whole runs do."""
    quiet = spread_of(LINEAR)
    assert spread_of(replace(LINEAR, random=QUIET)) == pytest.approx(quiet, rel=0.1)
    unsteady = spread_of(replace(LINEAR, random={**QUIET, "yaw.thrust-noise": 0.3}))
    # the mean of the thrust over all runs, which is all that tells the drag, is off by its noise and the gains'
    assert unsteady[1] == pytest.approx(np.hypot(0.3 / np.sqrt(4 * 9.0), SCATTER / 2.0), rel=0.3)
    assert np.all(unsteady > 2.5 * quiet)
    assert np.all(spread_of(replace(LINEAR, random={**QUIET, "yaw.disturbance": 0.1})) > 1.5 * quiet)


def test_what_is_random_is_read_from_the_file_of_a_driven_fit(tmp_path: Path) -> None:
    values = {"yaw.disturbance": 0.033, "yaw.thrust-noise": 0.9}
    random = {
        name: {"value": x, "stderr": 0.1 * x, "ci95": [0.8 * x, 1.2 * x], "unit": ""} for name, x in values.items()
    }
    prior = read_prior_results(model_file(tmp_path / "model.json", random=random), None)
    assert fitting_of(prior, Limits()).random == values
