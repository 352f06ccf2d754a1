"""Vehicles that a rudder steers: the sign of the rudder, K and T against boats of known truth, overshoot angles."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_rudder import MEMORY_TIME, QUICK_INERTIA, QUICK_LINEAR, QUICK_QUADRATIC, Boat, quick_zigzag
from scipy import integrate

from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.validate import validate
from automarine_cli.comparison.validation import compare
from automarine_cli.dofs import PLANAR, YAW, alone
from automarine_cli.fits.characteristics import executes, overshoots
from automarine_cli.fits.identify import effect_estimates, effects_of_rudder, usable_runs
from automarine_cli.fits.planar_fit import PlanarLikelihood, with_actuators
from automarine_cli.fits.planar_structure import observed, with_rudder
from automarine_cli.models.model import Model, Term
from automarine_cli.models.parameter import Prior
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import STEERED
from automarine_cli.report.figures.runs import planar_figure
from automarine_cli.report.fit_report import sentences
from automarine_cli.report.validation_report import planar_table
from automarine_cli.runs.load import TO_PORT, load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch, signals_of
from automarine_cli.simulation.rollout import simulate


@pytest.mark.parametrize("side", [1, -1])
def test_the_rudder_is_the_command_to_starboard_however_it_is_signed(side: int, tmp_path: Path) -> None:
    runs = load_runs([Boat(side=side).write(tmp_path)], dof=YAW).runs
    plain = load_runs([Boat().write(tmp_path / "plain")], dof=YAW).runs
    for run, other in zip(runs, plain):
        assert run.moment_unit == STEERED and (TO_PORT in run.reading) == (side < 0)
        np.testing.assert_allclose(run.command, other.command, atol=1e-12)
        np.testing.assert_allclose(run.extras["rudder"], side * other.command, atol=1e-12)


def test_a_moment_in_the_log_goes_first(tmp_path: Path) -> None:
    log = Boat().zigzag(1.2, 10.0, 0).assign(tau=0.5)
    log.to_csv(tmp_path / "log.csv", index=False)
    (run,) = load_runs([tmp_path], dof=YAW).runs
    assert run.moment_unit == "nu" and np.all(run.command == 0.5) and "rudder" in run.extras


@pytest.mark.parametrize("memory", [0.0, 1.5])
def test_overshoots_of_the_model_that_made_the_log_are_those_of_the_log(memory: float, tmp_path: Path) -> None:
    boat = Boat(effect=0.8, damping=0.75, memory=memory)
    boat.zigzag(1.2, 10.0, 0).to_csv(tmp_path / "log.csv", index=False)
    (run,) = load_runs([tmp_path], dof=YAW).runs
    inertia = 1.0 / (boat.effect * 1.2**2)
    model = Model.base("1", inertia, (boat.damping * 1.2 * inertia,), STEERED, YAW)
    if memory:
        model = model.with_effect("history-force", (memory * inertia, MEMORY_TIME, 0.0))
    pairs = np.rad2deg(overshoots(model, run))
    assert len(pairs) >= 5 and len(executes(run.command)) >= len(pairs)
    assert np.sqrt(np.mean((pairs[:, 0] - pairs[:, 1]) ** 2)) < 2.0 and abs(np.diff(pairs).mean()) < 1.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_overshoots_begin_with_the_logged_rate(side: float) -> None:
    """Of a boat that answers in half a second, the rate of the headings about the execute took 1.4 of 10 degrees."""
    model = Model.base("2", QUICK_INERTIA, (QUICK_QUADRATIC, QUICK_LINEAR), STEERED, YAW).delayed(0.1)
    pairs = np.rad2deg([pair for seed in range(3) for pair in overshoots(model, quick_zigzag(seed, side))])
    assert len(pairs) > 30 and pairs[:, 0].mean() > 6.0
    assert np.sqrt(np.mean((pairs[:, 0] - pairs[:, 1]) ** 2)) < 0.7 and abs(np.diff(pairs).mean()) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(("side", "speed"), [(-1, True), (1, False)])
def test_gain_and_time_are_within_their_errors(side: int, speed: bool, tmp_path: Path) -> None:
    boat = Boat(side=side)
    fit = fit_yaw([boat.write(tmp_path, speed, seed=3)], length=2.0)
    nomoto = fit.nomoto
    assert nomoto is not None and nomoto.side == side and (nomoto.speed is None) == (not speed)
    u = nomoto.speed or 1.17  # it falls in turns
    truth = {"gain": side * boat.effect * u / boat.damping, "time": 1.0 / (boat.damping * u)}
    for name, value in truth.items():
        estimate = getattr(nomoto, name)
        allowed = 4.0 * estimate.stderr + (0.0 if speed else 0.05 * abs(value))
        assert 0.0 < estimate.stderr < 0.25 * abs(value) and abs(estimate.value - value) < allowed, name
    if speed:
        assert nomoto.prime["K'"].value == pytest.approx(2.0 / u * nomoto.gain.value)
        assert nomoto.prime["T'"].value == pytest.approx(u / 2.0 * nomoto.time.value)
    cubic = nomoto.cubic["n3"]  # without a logged speed, what a turn takes off it looks like a cubic
    assert abs(cubic.value) < 4.0 * cubic.stderr + 1e-6
    path = tmp_path / "yaw_model.json"
    path.write_text(json.dumps(fit.to_json()), encoding="utf-8")
    assert validate([tmp_path], model=path).runs


INERTIA, LINEAR, QUADRATIC, N_DELTA, AHEAD = 5.0, 3.0, 4.0, 8.0, 1.2  # of a boat with thrusters and a rudder


def with_thrusters(seed: int, side: int, rate: float) -> pd.DataFrame:
    """Log a boat whose thrusters and rudder, with a gear of this largest rate [rad/s], turn it by turns."""
    random, step, rows = np.random.default_rng(seed), 0.01, []
    psi = r = angle = moment = asked = 0.0
    for k in range(4000):
        if k % 500 == 100:
            moment = random.choice([-3.0, -1.5, 0.0, 1.5, 3.0])
        if k % 700 == 200:
            asked = np.deg2rad(random.choice([-25.0, -10.0, 0.0, 10.0, 25.0]))
        angle += float(np.clip(asked - angle, -rate * step, rate * step))
        if k % 10 == 0:
            heading = np.rad2deg(psi) + 0.3 * random.standard_normal()
            rows.append((k * step, moment, side * np.rad2deg(asked), heading % 360, AHEAD))
        drive = moment + N_DELTA * angle * AHEAD**2
        middle = r + 0.5 * step * (drive - LINEAR * r - QUADRATIC * r * abs(r)) / INERTIA
        before, r = r, r + step * (drive - LINEAR * middle - QUADRATIC * middle * abs(middle)) / INERTIA
        psi += 0.5 * step * (before + r)
    return pd.DataFrame(rows, columns=["time_s", "tau_Nm", "rudder_deg", "heading_deg", "surge_m_s"]).round(4)


@pytest.mark.slow
@pytest.mark.parametrize(("side", "gear", "without"), [(1, 99.0, []), (-1, 0.15, ["surge_m_s"])])
def test_a_rudder_beside_thrusters_has_a_moment_without_being_asked_for(
    side: int, gear: float, without: list[str], tmp_path: Path
) -> None:
    """Without a logged speed at that of all runs; a slow gear is proposed, and with it nothing else is amiss."""
    for seed in range(4):
        log = with_thrusters(seed, side, gear).drop(columns=without)
        log.to_csv(tmp_path / f"run_{seed}.csv", index=False)
    slow = gear < 1.0
    if slow:
        assert "rudder-rate" in fit_yaw([tmp_path]).preferred.proposed
    fit = fit_yaw([tmp_path], with_effects=("rudder-rate",) if slow else ())
    estimates = fit.preferred.estimates
    for group in effect_estimates(fit.preferred).values():
        estimates = {**estimates, **group}
    expected = {"I_r": INERTIA, "N_delta": side * N_DELTA * (AHEAD**2 if without else 1.0)}
    expected |= {"rate": gear} if slow else {}
    for name, value in expected.items():
        estimate = estimates[name]
        assert abs(estimate.value - value) < 4.0 * estimate.stderr + 0.01 * abs(value), name
        assert estimate.stderr < 0.1 * abs(value), name
    assert ("constant speed" in sentences(fit)[0]) == bool(without)


@pytest.mark.parametrize(("moment_Nm", "beside"), [(2.0, True), (0.0, False)])
def test_a_rudder_that_is_the_moment_is_not_beside_it(moment_Nm: float, beside: bool, tmp_path: Path) -> None:
    """Logs whose map makes the moment of the rudder, up to its scale, hold it twice."""
    log = Boat().zigzag(1.2, 10.0, 0)
    turned = moment_Nm * np.sign(np.sin(log["time_s"]))
    log.assign(tau_Nm=turned - 0.02 * log["rudder_deg"]).to_csv(tmp_path / "log.csv", index=False)
    runs = load_runs([tmp_path], dof=YAW).runs
    assert effects_of_rudder(runs) == (("rudder",) if beside else ())


def test_runs_by_the_rudder_alone_count_beside_those_by_thrusters(tmp_path: Path) -> None:
    for seed, still in enumerate(("rudder_deg", "tau_Nm")):
        with_thrusters(seed, 1, 99.0).assign(**{still: 0.0}).to_csv(tmp_path / f"{still}.csv", index=False)
    used, _, set_aside = usable_runs(load_runs([tmp_path], dof=YAW).runs, "auto")
    assert len(used) == 2 and not set_aside and effects_of_rudder(used) == ("rudder",)


@pytest.mark.parametrize("planar", [False, True])
def test_a_moment_of_another_name_beside_a_rudder_is_asked_for(planar: bool, tmp_path: Path) -> None:
    log = Boat().zigzag(1.2, 10.0, 0).assign(moment_Nm=0.5, force_X_N=1.0)
    log.to_csv(tmp_path / "log.csv", index=False)
    (run,) = load_runs([tmp_path], dof=YAW, planar=planar).runs
    (note,) = (note for note in run.reading if "moment_Nm" in note)
    assert 'write tau_Nm = "moment_Nm"' in note


def planar_boat() -> Model:
    """A boat with thrust ahead, and a rudder that turns it, pushes its stern aside and holds it back."""
    drags = [Term("quadratic-drag", (k,), True, place) for place, k in enumerate((4.0, 30.0, 5.0))]
    rudder = [Term("rudder-drag", (6.0,), dof=0), Term("rudder", (-8.0, 0.0, 0.5), dof=1)]
    return Model(
        PLANAR, (20.0, 30.0, 4.0, 0.0, 0.0, 0.0), (*drags, *rudder, Term("rudder", (3.0, 0.0, 0.5), dof=2)), "N m"
    )


def steered_runs(thrusts: Sequence[float], length_s: float = 30.0) -> list[Run]:
    """Runs under thrust ahead with the rudder to both sides by turns; what is logged as surge is not to be used."""
    time = np.arange(0.0, length_s, 0.1)
    runs = []
    for i, thrust in enumerate(thrusts):
        rudder = 0.4 * np.sign(np.sin(2.0 * np.pi * time / (6.0 + 2.0 * i))) * (time > 3.0)
        forces = {"force_X": np.full(len(time), thrust), "force_Y": 0.0 * time}
        extras = {**forces, "rudder": rudder, "surge": np.full(len(time), 99.0)}
        runs.append(Run(f"run_{i}", f"run_{i}.csv", time, 0.0 * time, 0.0 * time, "N m", extras, dof=YAW))
    return runs


def measured(model: Model, runs: Sequence[Run]) -> list[Run]:
    """The runs as the model makes them, with noise of 1 cm/s and 0.005 rad."""
    random, noisy = np.random.default_rng(0), list[Run]()
    path = simulate(model, make_batch(runs, 0.05, model.signals, motion=PLANAR))
    for i, run in enumerate(runs):
        u, v, _ = path.velocities[0, i].T + 0.01 * random.standard_normal((3, len(run)))
        heading = path.positions[0, i, :, 2] + 0.005 * random.standard_normal(len(run))
        noisy.append(replace(run, position=heading, extras={**run.extras, "surge": u, "sway": v}))
    return noisy


def test_in_the_plane_a_rudder_is_driven_by_the_speed_of_the_model() -> None:
    model, (run,) = planar_boat(), steered_runs([12.0])
    assert model.signals == ("rudder",)
    path = simulate(model, make_batch([run], 0.01, model.signals, motion=PLANAR))
    u = v = r = 0.0
    for k, delta in enumerate(run.extras["rudder"][:-1]):
        np.testing.assert_allclose(path.velocities[0, 0, k], (u, v, r), atol=0.02)
        for _ in range(100):  # the momentum of Fossen's chapter 6, by small steps of Euler's
            p = u * abs(u)
            du = 12.0 - (4.0 + 6.0 * delta**2) * p + 30.0 * v * r
            dv = -8.0 * delta * p - 30.0 * v * abs(v) - 20.0 * u * r
            dr = 3.0 * delta * p - 5.0 * r * abs(r) - (30.0 - 20.0) * u * v
            u, v, r = u + 0.001 * du / 20.0, v + 0.001 * dv / 30.0, r + 0.001 * dr / 4.0


def test_a_rudder_is_no_noise_about_its_mean() -> None:
    """Not where it goes over once in a short log either; a voltage that scatters is."""
    (run,) = steered_runs((12.0,))
    short = run.cut(60, 81)
    (rudder,), (force,) = signals_of([short], "rudder"), signals_of([short], "force_X")
    np.testing.assert_array_equal(rudder, short.extras["rudder"])
    np.testing.assert_array_equal(force, short.extras["force_X"])
    noisy = replace(short, extras={**short.extras, "voltage": 12.0 + (-1.0) ** np.arange(len(short))})
    assert np.ptp(np.array(signals_of([noisy], "voltage"))) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("rudder", "at_most"), [(3.0, 0.01), (2.0, 0.6)])
def test_validate_tells_overshoot_angles_in_the_plane(rudder: float, at_most: float) -> None:
    """Those of the model that made the log are those of the log; with less rudder they differ."""
    truth, runs = planar_boat(), steered_runs((12.0,))
    for name, value in (("N_uv", -10.0), ("N_ur", 5.0)):  # that make it keep its course
        truth = truth.with_term(Term.cross(name, value))
    path = simulate(truth, make_batch(runs, 0.05, truth.signals, motion=PLANAR))
    logs = []
    for i, run in enumerate(runs):
        u, v, r = path.velocities[0, i].T
        speeds = {"surge": u, "sway": v, "yaw_rate": r}
        logs.append(replace(run, position=path.positions[0, i, :, 2], extras={**run.extras, **speeds}))
    model = truth.with_theta([rudder if name == "yaw.rudder.N_delta" else x for name, x in truth.values.items()])
    result = compare(StoredModels({"planar": model}, "planar", 0.0, "planar_model.json"), logs)
    logged, modelled = np.rad2deg(np.array(result.overshoots).T)
    assert len(logged) >= 6 and logged.min() > 1.0
    miss = float(np.sqrt(np.mean((modelled / logged - 1.0) ** 2)))
    assert (miss < at_most) if rudder == 3.0 else (0.05 < miss < at_most)
    assert result.to_json()["overshoot_deg"] == {"logs": logged.tolist(), "model": modelled.tolist()}
    says = f"Overshoot angles of {len(logged)} swings are "
    assert any(note.startswith(says) for note in planar_table(result).notes)
    drawn = [line.get_label() for panel in planar_figure(result.models["planar"].free[0]).axes for line in panel.lines]
    assert "rudder [deg]" in drawn


@pytest.mark.slow
def test_fit_planar_finds_the_rudder() -> None:
    noisy = measured(planar_boat(), steered_runs((6.0, 12.0, 20.0, 9.0)))
    scale = {"sway.m_v": Prior(30.0, 0.3), "yaw.I_r": Prior(4.0, 0.04)}  # no force abeam and no moment is logged
    likelihood = PlanarLikelihood(tuple(noisy), observed(noisy), scale, ("rudder", "rudder-drag"))
    found = likelihood.estimate(likelihood.simplest).by_name
    for name, value in (
        ("yaw.rudder.N_delta", 3.0),
        ("sway.rudder.Y_delta", -8.0),
        ("surge.rudder-drag.X_deltadelta", 6.0),
    ):
        assert abs(found[name].value - value) < 4.0 * found[name].stderr + 0.03 * abs(value), (name, found[name])
        assert found[name].stderr < 0.5 * abs(value)


RATE = 0.5  # rad/s


def put_over(run: Run, rate: float = RATE) -> Run:
    """The run with the angle that a gear of this largest rate gives its rudder, from row to row."""
    angle, angles = 0.0, list[float]()
    for asked, step in zip(run.extras["rudder"], np.diff(run.time, append=run.time[-1])):
        angles.append(angle)
        angle += float(np.clip(asked - angle, -rate * step, rate * step))
    return replace(run, extras={**run.extras, "rudder": np.array(angles)})


@pytest.mark.parametrize("beside_thrusters", [False, True])
def test_a_gear_turns_the_logged_rudder_and_no_thruster(beside_thrusters: bool) -> None:
    runs, motion, model = [*map(every_hundredth, steered_runs((12.0,)))], PLANAR, planar_boat()
    if beside_thrusters:  # in yaw alone
        runs = [replace(run, moment=np.sign(np.sin(run.time)), extras=run.extras | {"surge": 1.0 + 0.0 * run.time})
                for run in runs]  # fmt: skip
        motion, model = alone(YAW), Model.base("3", 4.0, (5.0,), "N m", YAW).with_effect("rudder", (3.0,))
    place = motion.index(YAW)
    geared = model.with_term(Term("rudder-rate", (RATE, 0.0, 1.0), dof=place))
    path, same = (
        simulate(of, make_batch(logs, 0.01, model.signals, motion=motion)).positions[0, 0, :, place]
        for of, logs in ((geared, runs), (model, [*map(put_over, runs)]))
    )
    np.testing.assert_allclose(path, same, rtol=0, atol=0.01)
    asked = simulate(model, make_batch(runs, 0.01, model.signals, motion=motion)).positions[0, 0, :, place]
    assert np.abs(path - asked).max() > 0.1


def every_hundredth(run: Run) -> Run:
    """The run with a hundred rows a second, which hold what is commanded."""
    time = np.arange(0.0, run.time[-1], 0.01)
    held = np.searchsorted(run.time, time + 1e-9, side="right") - 1
    extras = {name: column[held] for name, column in run.extras.items()}
    return replace(run, time=time, position=0.0 * time, moment=0.0 * time, extras=extras)


@pytest.mark.slow
def test_fit_planar_finds_a_slow_steering_gear_without_being_asked() -> None:
    """Where the log holds the angle commanded, a slow gear is not taken for a hull that turns about by itself; where it
    holds the angle itself, no gear is found."""
    truth, asked = planar_boat(), steered_runs((6.0, 12.0, 20.0, 9.0))
    for name, value in (("N_uv", -10.0), ("N_ur", 5.0)):  # that make it keep its course
        truth = truth.with_term(Term.cross(name, value))
    geared = truth.with_term(Term("rudder-rate", (RATE, 0.0, 1.0), dof=2))
    scale = {"sway.m_v": Prior(30.0, 0.3), "yaw.I_r": Prior(4.0, 0.04)}
    for model, logs in ((geared, asked), (truth, [*map(put_over, asked)])):
        runs = measured(model, logs)
        seen = observed(runs)
        assert with_rudder((), runs, seen) == ("rudder", "rudder-drag")
        likelihood = PlanarLikelihood(tuple(runs), seen, scale, with_rudder((), runs, seen))
        fit = with_actuators(likelihood, likelihood.estimate(likelihood.simplest))
        gear = [name for name in fit.model.free if "rudder-rate" in name]
        assert gear == (["yaw.rudder-rate.rate"] if model is geared else [])
        expected = {"yaw.rudder.N_delta": 3.0, **dict.fromkeys(gear, RATE)}
        for name, value in expected.items():
            assert abs(fit.by_name[name].value - value) < 4.0 * fit.by_name[name].stderr + 0.03 * value, name
        assert not gear or fit.by_name[gear[0]].unit == "rad/s"


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 1.5])
def test_the_drift_of_the_hull_is_found_where_there_is_one(memory: float, tmp_path: Path) -> None:
    fit = fit_yaw([Boat(effect=1.6, memory=memory).write(tmp_path, seed=2)])
    assert fit.nomoto is not None
    assert ("history-force" in {term.name for term in fit.preferred.model.terms}) == (memory > 0.0)
    logged, modelled = np.rad2deg(np.array(fit.nomoto.overshoots).T)
    assert np.sqrt(np.mean((logged - modelled) ** 2)) < max(1.0, 0.05 * logged.mean()) + 0.5  # of the log's own noise


@pytest.mark.slow
def test_the_time_of_a_hull_that_drifts_is_that_of_slow_turns(tmp_path: Path) -> None:
    """Water that remembers for T adds h T to the inertia of turns that are slow beside T."""
    boat = Boat(effect=1.6, memory=1.5)
    nomoto = fit_yaw([boat.write(tmp_path, seed=2)], with_effects="history-force").nomoto
    assert nomoto is not None and nomoto.speed is not None
    slowness = 1.0 / (boat.damping * nomoto.speed)
    truth = {"time": (1.0 + boat.memory * MEMORY_TIME) * slowness, "gain": boat.effect * nomoto.speed**2 * slowness}
    for name, value in truth.items():
        estimate = getattr(nomoto, name)
        assert abs(estimate.value - value) < 4.0 * estimate.stderr < value, name


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "side"), [(1, 1.0), (2, -1.0)])
def test_a_slow_steering_gear_is_found_where_the_command_is_logged(seed: int, side: float, tmp_path: Path) -> None:
    """Logs of the commanded angle at one speed: Nomoto's first order by Euler steps of 0.01 s, the rudder limited."""
    random, gain, time, limit, step = np.random.default_rng(seed), 1.0, 1.2, 0.25, 0.01
    for number in range(4):
        angles = np.deg2rad(random.choice([-20.0, -10.0, 10.0, 20.0], 12))
        thrust, rudder, heading, rate, rows = 1.0 + 0.02 * random.standard_normal(), 0.0, 0.0, 0.0, []
        for k in range(3600):
            angle = angles[k // 300]
            if k % 20 == 0:
                rows.append((k * step, np.rad2deg(heading) + random.normal(0.0, 0.3), side * np.rad2deg(angle)))
            rudder += np.clip(angle - rudder, -limit * step, limit * step)
            rate += step * (thrust * gain * rudder - rate) / time
            heading += step * rate
        header = "time_s,heading_deg,rudder_deg"
        np.savetxt(tmp_path / f"{number}.csv", rows, delimiter=",", header=header, comments="", fmt="%.4f")
    fit = fit_yaw([tmp_path], with_effects="rudder-rate")
    estimates = fit.preferred.by_name
    for name, truth in (("rudder-rate.rate", limit), ("yaw.I_r", time / gain), ("yaw.k_r", 1.0 / gain)):
        assert abs(estimates[name].value - truth) < 4.0 * estimates[name].stderr < 0.4 * truth  # of four runs
    assert estimates["rudder-rate.rate"].unit == "rad/s" and fit.nomoto is not None and fit.nomoto.side == side


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "side"), [(1, -1.0), (2, 1.0)])
def test_a_rudder_that_stalls_is_found_with_its_boat(seed: int, side: float, tmp_path: Path) -> None:
    """Nomoto's first order by scipy's integrator, under a rudder that loses lift beyond 0.35 rad."""
    random, gain, time, stall, fall = np.random.default_rng(seed), 1.0, 1.2, 0.35, 0.6
    clock = np.arange(0.0, 40.0, 0.2)
    for number in range(5):
        angles = np.deg2rad(random.permutation([-35.0, -30.0, -25.0, -18.0, -8.0, 8.0, 18.0, 25.0, 30.0, 35.0]))
        sizes, thrust = np.abs(angles), 1.0 + 0.02 * random.standard_normal()
        lifts = np.sign(angles) * np.where(sizes < stall, sizes, stall - fall * (sizes - stall))

        def slope(t: float, x: np.ndarray, lifts: np.ndarray = thrust * lifts) -> list[float]:
            return [x[1], (gain * lifts[min(int(t / 4.0), 9)] - x[1]) / time]

        path = integrate.solve_ivp(slope, (0.0, 40.0), [0.0, 0.0], t_eval=clock, max_step=0.02).y[0]
        heading = np.rad2deg(path) + random.normal(0.0, 0.3, len(clock))
        rows = np.column_stack([clock, heading, side * np.rad2deg(angles[(clock / 4.0 + 1e-9).astype(int)])])
        header = "time_s,heading_deg,rudder_deg"
        np.savetxt(tmp_path / f"{number}.csv", rows, delimiter=",", header=header, comments="", fmt="%.4f")
    fit = fit_yaw([tmp_path], with_effects="rudder-stall")
    estimates, truths = fit.preferred.by_name, {"rudder-stall.stall": stall, "rudder-stall.fall": fall}
    assert fit.preference.number == "1" and fit.nomoto is not None and fit.nomoto.side == side
    for name, truth in {**truths, "yaw.I_r": time / gain, "yaw.k_r": 1.0 / gain}.items():
        assert abs(estimates[name].value - truth) < min(3.0 * estimates[name].stderr, 0.1 * truth), name
