"""Three lags that look alike in headings of steps, and what a gyro makes of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from few_candidates import few_candidates
from identified import identify
from made_rudder import QUICK_INERTIA, QUICK_LINEAR, QUICK_QUADRATIC, quick_zigzag
from made_runs import INERTIA, K_RR
from stirred import INERTIA as WATER_INERTIA
from stirred import K_R, controlled, steps_in_water
from stirred import K_RR as WATER_K_RR
from tank import pool_campaign

from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs, parameter_estimates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.diagnosis.trials import attempt_with, candidate_fit, refitted
from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.quantities import STEERED
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

BASE = Model.base("3", INERTIA, [K_RR], "nu", YAW)
IN_WATER = Model.base("2", 4.0, [6.0, 1.2], "N m", YAW)
LAGS = {"input-delay": 0.15, "thruster-lag": 0.2, "sensor-lag": 0.2}
SIZES = (0.15, 0.3, 0.45, 0.6, 0.8)
PERIOD, REST = 0.1, 2.0


def steps(effect: str, seed: int = 1) -> list[Run]:
    """Two steps of each moment to either side with the effect, by a compass of 1 degree and a gyro of 0.3 degrees/s."""
    random, runs = np.random.default_rng(seed), []
    for i, moment in enumerate(side * size for _ in range(2) for size in SIZES for side in (1, -1)):
        time = np.arange(0.0, REST + 1.2 * np.pi * np.sqrt(K_RR / abs(moment)) + 1.0, PERIOD)
        start = np.full(len(time), random.uniform(-3.0, 3.0))
        command = np.where(time >= REST, moment, 0.0)
        runs.append(Run(f"run_{i:02d}", "made.csv", 60.0 * i + time, start, command, "nu", dof=YAW))
    start = Start(
        np.array([[run.position[0] for run in runs]]),
        log_gain=0.03 * random.standard_normal((1, len(runs))),
        switch_delay=PERIOD * (random.uniform(size=(1, len(runs), 1)) - 0.5),
    )
    truth = simulate(BASE.with_effect(effect, (LAGS[effect],)), make_batch(runs, 0.02), start=start)
    noise = np.deg2rad([1.0, 0.3, 1.0])
    for i, run in enumerate(runs):
        heading, rate = truth.position[0, i, : len(run)], truth.velocity[0, i, : len(run)]
        read = rate + noise[1] * random.standard_normal(len(run)) + noise[2] * random.standard_normal()
        heading = heading + noise[0] * random.standard_normal(len(run))
        runs[i] = replace(run, position=heading, extras={"yaw_rate": read})
    return runs


def format_value(runs: list[Run], channels: str = "auto", hold_out: Sequence[Run] = ()) -> Diagnosis:
    """A diagnosis that tries the three lags only."""
    with few_candidates(LAGS, curves=False):
        return diagnose_runs(runs, BASE, hold_out=hold_out, channels=channels)


@pytest.mark.slow
@pytest.mark.parametrize("lag", LAGS)
def test_with_a_gyro_each_lag_is_named_from_steps_alone(lag: str) -> None:
    found = format_value(steps(lag))
    assert found.channels.names == ("heading", "yaw_rate") and found.verdict == "named"
    (named,) = found.effects
    assert (named.name, named.rivals) == (lag, ())
    size, *_ = named.parameters.values()
    assert abs(size.value - LAGS[lag]) < 4.0 * size.stderr
    shared = 0.05 * PERIOD if lag == "input-delay" else 0.0  # with the common instant in its sample interval
    assert size.stderr < 0.05 * LAGS[lag] + shared
    assert found.fitted.gap.before > found.fitted.gap.after and found.fitted.gap.after < 1.05 * found.fitted.gap.floor


@pytest.mark.slow
def test_without_it_they_are_rivals() -> None:
    def tied(lag: str) -> bool:
        found = format_value(steps(lag), channels="position")
        return found.channels.names == ("heading",) and any(named.rivals for named in found.effects)

    assert any(map(tied, LAGS))  # the first will do


def test_a_gyro_alone_sees_no_lag_of_the_compass() -> None:
    found = format_value(steps("sensor-lag"), channels="yaw_rate")
    assert found.verdict == "nothing-missing" and "sensor-lag" not in found.detectable


@pytest.mark.slow
def test_runs_held_out_may_lack_the_gyro() -> None:
    runs = steps("thruster-lag")
    found = format_value(runs[:14], hold_out=[replace(run, extras={}) for run in runs[14:]])
    assert [named.name for named in found.effects] == ["thruster-lag"]
    assert found.held_out is not None and found.held_out.gap.after < found.held_out.gap.before


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("sensors", "late"),
    [
        ({"gyro_late": 0.03}, 0.0),
        ({"gyro_late": 0.09}, 0.0),
        ({"gyro_scale": 0.985}, 0.0),
        ({"heading_late": 0.03}, 0.0),  # the later of two sensors is put right
        ({"heading_late": 0.04, "gyro_late": 0.04}, 0.04),  # as late as the half of a sample that a logger makes
    ],
)
def test_what_loggers_and_gyros_do_is_no_effect(sensors: dict[str, float], late: float, seed: int) -> None:
    """Such sensors were called current-deviation, tether-spring, or three effects."""
    found = diagnose_runs(steps_in_water(seed=seed, **sensors), IN_WATER, number="2")
    assert found.verdict == "nothing-missing"
    assert found.extended["command_delay_s"] == pytest.approx(0.05 + late, abs=0.006)  # since the middle of a sample
    assert all(
        abs(after.value - truth) < 4.0 * after.stderr
        for truth, (_, after) in zip((WATER_INERTIA, WATER_K_RR, K_R), found.base.values())
    )


@pytest.mark.slow
@pytest.mark.parametrize("push", [0.15, -0.15])
def test_what_pushes_before_the_log_begins_is_named_alone(push: float) -> None:
    """Held to be at rest, vehicles under way got a drift and an asymmetry beside a bias that was too small."""
    found = diagnose_runs(steps_in_water(constant=push, seed=3), IN_WATER, number="2")
    (named,) = found.effects
    size = named.parameters["b"]
    assert (found.verdict, named.name) == ("named", "bias-moment") and abs(size.value - push) < 3.0 * size.stderr


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_dead_time_in_a_closed_loop_is_named_alone(seed: int) -> None:
    """Smeared over two samples, it got a history-force and a learned curve beside it."""
    found = diagnose_runs(controlled(delay=0.3, seed=seed), IN_WATER, number="2")
    (named,) = found.effects
    on, off = (named.parameters[name] for name in ("t_d", "t_off"))
    assert (found.verdict, named.name) == ("named", "input-delay")
    assert on.value == pytest.approx(0.35, abs=0.01)  # since the middle of a sample
    assert named.law == "every change" or abs(off.value - on.value) < 2.0 * off.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "noise"), [(1, 0.1), (2, 0.15), (3, 0.02)])
def test_a_controller_that_answers_quiet_headings_is_no_effect(seed: int, noise: float) -> None:
    """Thinned, they knew less than the commands, which got a backlash, a dead-band or a coulomb-drag for that."""
    found = diagnose_runs(controlled(seed=seed, noise=noise, gyro=False), IN_WATER, number="2")
    assert found.verdict == "nothing-missing"
    assert all(
        abs(after.value - truth) < 3.0 * after.stderr < 0.1 * truth
        for truth, (_, after) in zip((WATER_INERTIA, WATER_K_RR), found.base.values())
    )


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lag_of_the_steering_gear_is_named_alone_in_a_slow_log(side: float) -> None:
    """Held over each sample, what lags got a deviation of the compass beside it."""
    runs = [quick_zigzag(seed, side * (-1.0) ** seed, gear=0.7) for seed in range(12)]
    model = Model.base("2", QUICK_INERTIA, [QUICK_QUADRATIC, QUICK_LINEAR], STEERED, YAW)
    found = diagnose_runs(runs, model, number="2")
    (named,) = found.effects
    assert found.verdict == "named" and named.name in ("thruster-lag", "rudder-rate")
    assert abs(named.parameters["T"].value - 0.7) < 3.0 * named.parameters["T"].stderr < 0.07


@pytest.mark.slow
def test_a_delay_is_found_from_every_start() -> None:
    """It shares its direction with the instants at which commands switch."""
    delay = {"name": "input-delay", "t_d": 0.25}
    runs = pool_campaign(seed=3, noise_deg=2.0, gain=0.05, repeats=1, turn_deg=400.0, effects=[delay])
    study = study_of(runs, Model.base("3", 1.0, [1.2], runs[0].moment_unit, YAW))
    base, evidence = candidate_fit(study, study.base, (), study.fit(study.base)), []
    for start in (0.05, 0.1, 0.2, 0.4):
        trial = refitted(study, *attempt_with(base, ("input-delay", np.array([start, 0.0, 0.1]))))
        assert trial is not None
        estimate = parameter_estimates(study, trial, "input-delay")["t_d"]
        assert abs(estimate.value - 0.25) < 3.0 * estimate.stderr < 3.0 * 0.05
        evidence.append(trial.evidence)
    assert np.ptp(evidence) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "lag"), [(4, 0.0), (6, 0.4)])
def test_steps_in_stirred_water_are_diagnosed_beside_their_pushes(seed: int, lag: float) -> None:
    """Without a disturbance the answer was *unexplained*."""
    runs = steps_in_water(0.1, thrust_lag=lag, seed=seed)
    fit = identify(runs)
    model, driven = fit.preferred.model, fit.preferred.mixed.driven
    found = diagnose_runs(runs, model, number=fit.preference.number, driven=driven)
    assert driven and [effect.name for effect in found.effects] == ["thruster-lag"] * (lag > 0)
    assert found.verdict == ("named" if lag else "nothing-missing")
    if lag:
        size = found.effects[0].parameters["T"]
        assert abs(size.value - lag) < 3.0 * size.stderr
