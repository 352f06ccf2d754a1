"""Several model files as one vehicle: what each target's file says moves as the models do, and nothing is invented."""

import json
import re
import types
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from export_readers import VEHICLES
from numpy.typing import NDArray
from repository import SAMPLE_RUNS
from scipy.integrate import solve_ivp

import automarine_cli as am
from automarine_cli.commands.export import export
from automarine_cli.comparison.simulated_runs import roll
from automarine_cli.dofs import DOFS, PLANAR, YAW
from automarine_cli.errors import SettingError
from automarine_cli.exports.vehicle import FRAME_SIGNS, MOTIONS
from automarine_cli.logs import ColumnMap, find_logs
from automarine_cli.models.store import read_model
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, load_planar

Floats = NDArray[np.float64]
NU_NM = 1.5  # N m of one normalised unit of the yaw files
MODELS: dict[str, tuple[str, dict[str, float]]] = {
    "surge": ("3", {"X_uu": 24.0, "m_u": 17.0, "half_difference": -3.0}),
    "sway": ("3", {"Y_vv": 58.0, "m_v": 24.0}),
    "heave": ("2", {"Z_ww": 45.0, "Z_w": 3.0, "m_w": 26.0, "constant_force": -2.0, "half_difference": 5.0}),
    "roll": ("2", {"k_pp": 0.9, "k_p": 0.3, "I_p": 1.9, "constant_moment": 0.2, "restoring": 12.0}),
    "pitch": ("2", {"k_qq": 1.1, "k_q": 0.4, "I_q": 2.6, "constant_moment": 0.0, "restoring": 14.0}),
    "yaw": ("3", {"k_rr": 1.257, "I_r": 1.018}),
}
LOGS = {"surge": "surge_validation", "sway": "sway_validation", "roll": "roll_validation", "yaw": "validation"}


def model_files(folder: Path, *names: str, **change: Any) -> list[Path]:
    """The files of these motions, as their fits write them; yaw is in nu."""
    paths = []
    for name in names:
        dof, (number, entry) = DOFS[name], MODELS[name]
        unit = {f"{dof.words.force}_unit": "nu" if name == "yaw" else dof.units.forces[1]}
        content = {"schema": f"automarine/{name}-model/1", **unit, "models": {number: entry}, "preferred": number}
        paths.append(folder / f"{name}_model.json")
        paths[-1].write_text(json.dumps(content | ({} if name == "yaw" else {"motion": name}) | change))
    return paths


def planar_file(folder: Path) -> Path:
    values = {
        "surge.m_u": 24.0, "surge.X_uu": 22.0, "sway.m_v": 30.0, "sway.Y_vv": 70.0, "yaw.I_r": 2.4, "yaw.k_rr": 3.2,
        "planar.m_vr": 0.8, "yaw.N_v": -7.0, "current.north": 0.1, "current.east": -0.05,
    }  # fmt: skip
    path = folder / "planar_model.json"
    content = {"schema": "automarine/planar-model/1", "force_unit": "N", "moment_unit": "N m", "parameters": values}
    path.write_text(json.dumps(content))
    return path


def module_of(text: str) -> types.ModuleType:
    module = types.ModuleType("vehicle")
    exec(text, vars(module))
    return module


def flown(text: str, run: Run, commands: Floats, state: Floats) -> Floats:
    """States (N, 12) of the file's `derivatives` at the samples, by an integrator that is not ours; a command (6, N)
    changes halfway between two samples, as in our simulator."""
    derivatives, states = module_of(text).derivatives, [state]
    for i, (begin, end) in enumerate(zip(run.time, run.time[1:])):
        middle = 0.5 * (begin + end)
        for force, span in ((commands[:, i], (begin, middle)), (commands[:, i + 1], (middle, end))):
            slope = lambda t, y, force=force: derivatives(y, force)  # noqa: E731
            state = solve_ivp(slope, span, state, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
        states.append(state)
    return np.array(states)


@pytest.mark.parametrize("frame", ["NED", pytest.param("ENU", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "motion", [pytest.param(motion, marks=[pytest.mark.slow] * (motion in ("sway", "yaw"))) for motion in LOGS]
)
def test_the_python_vehicle_flies_the_validation_logs_of_each_motion(tmp_path: Path, motion: str, frame: str) -> None:
    """As `validate` simulates them, within 1e-5 rad or m (its step is halved until 0.01 degrees or cm)."""
    files = model_files(tmp_path, "surge", "sway", "yaw", *(["roll", "pitch"] if motion == "roll" else []))
    text = export(files, to="python", frame=frame, newton_metres_per_nu=NU_NM).text
    dof, model = DOFS[motion], read_model(tmp_path / f"{motion}_model.json").model
    run = load_runs(find_logs([str(SAMPLE_RUNS / LOGS[motion])]), ColumnMap(), dof=dof).runs[0]
    run = run.cut(0, min(len(run), 150))
    first, rate, side = (0.3 if motion == "roll" else run.position[0]), 0.05, FRAME_SIGNS[frame][dof.number]
    expected = roll(model, [run], [first], [rate], step=0.002)
    commands, state = np.zeros((6, len(run))), np.zeros(12)
    commands[dof.number] = side * run.command * (NU_NM if run.moment_unit == "nu" else 1.0)
    state[dof.number], state[6 + dof.number] = side * first, side * rate
    states = flown(text, run, commands, state)
    np.testing.assert_allclose(side * states[:, dof.number], expected.position[0, 0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(side * states[:, 6 + dof.number], expected.velocity[0, 0], rtol=0, atol=1e-5)
    others = np.delete(states, [dof.number, 6 + dof.number], axis=1)
    assert not others[:, 3:].any()  # nothing else turns or moves


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["NED", "ENU"])
@pytest.mark.parametrize("log", ["zigzag", "crabwise"])
def test_a_planar_model_among_the_files_flies_its_validation_logs(tmp_path: Path, log: str, frame: str) -> None:
    """With the Munk moment, m_vr, a drag by the other velocity and the current, beside roll."""
    files = [planar_file(tmp_path), *model_files(tmp_path, "roll")]
    text, model = export(files, to="python", frame=frame).text, read_model(files[0]).model
    run = load_planar(find_logs([str(SAMPLE_RUNS / "planar_validation" / f"{log}.csv")]), ColumnMap()).runs[0]
    tau = np.stack([run.extras["force_X"], run.extras["force_Y"], run.command])
    first, moving = np.array([1.0, -2.0, 0.7]), np.array([0.2, -0.1, 0.1])
    start = Start(first.reshape(3, 1, 1), moving.reshape(3, 1, 1))
    expected = simulate(model, make_batch([run], 0.01, motion=PLANAR), start=start).positions[0, 0]
    side, planes, enu = FRAME_SIGNS[frame], [0, 1, 5], frame == "ENU"
    commands, state = np.zeros((6, len(run))), np.zeros(12)
    commands[planes] = side[planes, None] * tau
    state[[6, 7, 11]] = side[planes] * moving
    state[[0, 1, 5]] = (first[1], first[0], np.pi / 2 - first[2]) if enu else first
    states = flown(text.replace("K_0 = 0.2", "K_0 = 0"), run, commands, state)[:, planes]
    if enu:
        states = np.column_stack([states[:, 1], states[:, 0], np.pi / 2 - states[:, 2]])
    np.testing.assert_allclose(states, expected, rtol=0, atol=1e-5)


def test_its_own_integrator_and_weight_that_turns_with_the_vehicle(tmp_path: Path) -> None:
    """simulate() rises as heave's constant force says; on its side the vehicle is pushed abeam, not up."""
    module = module_of(export(model_files(tmp_path, "sway", "heave", "roll"), to="python").text)
    time = np.arange(0.0, 30.0, 0.1)
    steady = module.simulate(time, np.zeros((len(time), 6)))[-1, 8]
    assert steady == pytest.approx(-(-3 + np.sqrt(9 + 4 * 40 * 2)) / 80, rel=1e-3)  # 45 less the half difference
    state = np.zeros(12)
    state[3] = np.pi / 2
    rates = module.derivatives(state, np.zeros(6))
    assert rates[7:9] == pytest.approx([-2.0 / 24.0, 0.0], abs=1e-12)
    assert rates[9] == pytest.approx((0.2 - 12.0) / 1.9)


# What the files of other targets say


OWN = {"rigid_mass": 11.0, "rigid_inertia": {"roll": 1.2, "yaw": 0.9}, "newton_metres_per_nu": NU_NM}
STATES = np.array([[0.7, -0.3, 0.4, 0.2, 0.0, 0.5], [-0.5, 0.2, -0.6, -0.4, 0.0, -0.3]])


def truth(nu: Floats, *, asymmetric: bool, coupled: bool, names: tuple[str, ...]) -> Floats:
    """M nu' of the files at rest of commands, of the fluid's damping and M alone, by hand."""
    size = {"surge": (17.0, 0, 24.0, -3.0), "sway": (24.0, 0, 58.0, 0), "heave": (26.0, 3.0, 45.0, 5.0),
            "roll": (1.9, 0.3, 0.9, 0), "yaw": (NU_NM * 1.018, 0, NU_NM * 1.257, 0)}  # fmt: skip
    force, inertia = np.zeros(6), np.zeros(6)
    for name in names:
        i, (mass, linear, quadratic, skew) = DOFS[name].number, size[name]
        inertia[i] = mass
        force[i] = -linear * nu[i] - quadratic * abs(nu[i]) * nu[i] - asymmetric * skew * nu[i] ** 2
    p = inertia * nu
    if coupled:
        force -= np.append(np.cross(nu[3:], p[:3]), np.cross(nu[3:], p[3:]) + np.cross(nu[:3], p[:3]))
    return np.where(inertia > 0, force / np.where(inertia > 0, inertia, 1.0), 0.0)


@pytest.mark.parametrize("nu", STATES)
@pytest.mark.parametrize(("target", "form"), VEHICLES)
def test_each_file_read_back_has_our_accelerations(tmp_path: Path, target: str, form: str, nu: Floats) -> None:
    names = ("surge", "sway", "heave", "roll", "yaw")
    result = export(
        model_files(tmp_path, *names), to=target, form=form, frame="NED", allow_partial=True,
        **(OWN if target != "python" else {"newton_metres_per_nu": NU_NM}),
    )  # fmt: skip
    lacking = [effect.name for effect in result.left_out]
    skewed, coupled = "surge.drag-asymmetry" not in lacking, target != "mjcf"
    expected = truth(nu, asymmetric=skewed, coupled=coupled, names=names)
    np.testing.assert_allclose(VEHICLES[target, form](result.text, nu), expected, rtol=1e-6, atol=1e-9)
    assert result.not_identified == ("pitch", "couplings") == tuple(result.to_json()["not_identified"])
    assert "Not identified: pitch, couplings." in result.text and len(result.to_json()["sources"]) == 5


def test_the_mass_stands_once_and_what_is_not_told_is_said(tmp_path: Path) -> None:
    files = model_files(tmp_path, "surge", "heave", "roll", "yaw")
    settings = {"newton_metres_per_nu": NU_NM, "rigid_mass": 11.0}
    text = export(files, to="gz-sim", **settings, rigid_inertia={"yaw": 0.9}).text
    assert "<mass>11</mass>" in text and "<xx>6</xx>" in text and "<zz>15</zz>" in text and "<pp>" not in text
    assert "11 kg and yaw inertia 0.9 kg m^2 are the vehicle's own (given)" in text
    assert "Inertia: I_p = 1.9 N m s^2 is the identified total of rigid and added inertia and stands in one" in text
    assert "roll.restoring-moment: it is weight and buoyancy" in text and "12 N m, GM 0.1112 m" in text
    assert "heave.bias-moment" in text and ": 2 N." in text  # up in ENU
    joints = export(files, to="mjcf", **settings, allow_partial=True, frame="NED").text
    assert joints.index('name="heave"') < joints.index('name="yaw"') < joints.index('name="roll"')
    assert 'stiffness="12 0 -2"' in joints and "Joints along the axes do not turn with the hull" in joints


REFUSALS: list[tuple[tuple[str, ...], dict[str, Any], str]] = [
    (("yaw", "yaw"), {"to": "mss"}, "yaw_model.json and yaw_model.json are both of yaw; a vehicle has one"),
    (("planar", "yaw"), {"to": "mss"}, "planar_model.json and yaw_model.json are both of yaw"),
    (("planar", "roll"), {"to": "uuv"}, "together; --to uuv takes one motion: take --to gz-sim or mss or python"),
    (("surge", "yaw"), {"to": "card"}, "--to card takes one file, found 2"),
    (("surge", "yaw"), {"to": "python"}, "a vehicle of several motions needs newton metres; .*per-nu yaw=VALUE with"),
    (("surge", "roll"), {"to": "mss", "newton_metres_per_nu": 2.0}, "is in newtons already"),
    (("surge", "roll"), {"to": "uuv", "allow_partial": True}, "give the vehicle's own with --rigid-mass"),
    (("surge", "roll"), {"to": "gz-sim", "rigid_mass": 18.0}, "--rigid-mass: found 18, expected more than 0"),
    (("pitch", "roll"), {"to": "gz-sim", "rigid_inertia": 1.0}, "may be of roll or pitch; give .* roll=...,pitch=..."),
    (("surge", "roll"), {"to": "gz-sim", "rigid_mass": 9.0, "rigid_inertia": {"yaw": 1.0}}, "found yaw, expected roll"),
    (("surge", "roll"), {"to": "mss", "number": "3"}, "--number: found 3, which may be of surge or roll; give"),
    (("surge", "roll"), {"to": "uuv", "rigid_mass": 9.0}, r"surge.drag-asymmetry \(the target's equation has no such"),
]  # fmt: skip


@pytest.mark.parametrize(("names", "settings", "says"), REFUSALS)
def test_refusals(tmp_path: Path, names: tuple[str, ...], settings: dict[str, Any], says: str) -> None:
    files = [planar_file(tmp_path) if name == "planar" else model_files(tmp_path, name)[0] for name in names]
    with pytest.raises(SettingError, match=says):
        export(files, **settings)


def test_the_command_takes_several_files_and_values_by_motion(tmp_path: Path, run: Callable[..., Result]) -> None:
    files, out = model_files(tmp_path, "yaw", "surge"), tmp_path / "vehicle.sdf"
    options = ("--to", "gz-sim", "--rigid-mass", 11, "--rigid-inertia", "yaw=0.9", "--newton-metres-per-nu", "yaw=1.5")
    result = run("export", *files, *options, "-o", out)
    assert result.exit_code == 0, result.output
    text = am.export([str(file) for file in files], to="gz-sim", **OWN | {"rigid_inertia": {"yaw": 0.9}}).text
    assert out.read_text() == text and "surge_model.json, model 3" in text and "yaw_model.json, model 3" in text
    assert run("export", *files, *options, "--rigid-inertia", "yaw=-1").exit_code == 2


@pytest.mark.parametrize(("frame", "side"), [("NED", -1.0), ("ENU", 1.0)])
def test_thrusters_stand_where_their_arm_says(tmp_path: Path, frame: str, side: float) -> None:
    """Port ahead turns to starboard; without an arm the file says that the places were not told."""
    map_ = ThrusterMap("square", PowerCurve(2.6e-4), PowerCurve(0.7e-4), n_range=(-150.0, 150.0))
    path = tmp_path / "thrusters.json"
    path.write_text(json.dumps(map_.to_json()))
    files = [*model_files(tmp_path, "sway", "yaw"), path]
    text = export(files, to="python", frame=frame, newton_metres_per_nu=NU_NM, arm=0.2, n_max=150.0).text
    force = module_of(text).thruster_forces(100.0, -50.0)
    ahead, astern = 2.6e-4 * 1e4, -0.7e-4 * 2.5e3
    assert force == pytest.approx([ahead + astern, 0, 0, 0, 0, -side * 0.2 * (ahead - astern)], abs=0.01)
    root = ET.fromstring(export(files, to="mjcf", frame=frame, arm=0.2, **OWN | {"rigid_inertia": 0.9}).text)
    assert [site.attrib["pos"] for site in root.iter("site")] == ["0 0.2 0", "0 -0.2 0"]  # y is to port
    told = export(files, to="gz-sim", frame=frame, arm=0.2, **OWN | {"rigid_inertia": 0.9})
    place = f"port at y = {side * 0.2:g} m, starboard at y = {-side * 0.2:g} m"
    assert place in told.text and told.left_out[-1].name == "thrusters"
    assert "(give --arm METRES" in export(files, to="mss", newton_metres_per_nu=NU_NM).text
    with pytest.raises(SettingError, match="--arm is of the thrusters of a vehicle"):
        export(files[:2], to="mss", newton_metres_per_nu=NU_NM, arm=0.2)


# A boat with a rudder


def steered_file(folder: Path) -> Path:
    content = {
        "schema": "automarine/yaw-model/1", "moment_unit": "rad", "preferred": "1",
        "models": {"1": {"k_r": 0.8, "I_r": 0.98}},
        "effects": [{"name": "rudder-inflow", "parameters": {"race": 0.2, "U": 1.1}},
                    {"name": "cross-coupling", "parameters": {"c": -0.3}}],
    }  # fmt: skip
    path = folder / "yaw_model.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("frame", ["NED", "ENU"])
def test_a_rudder_steers_the_python_vehicle_as_it_steers_the_model(tmp_path: Path, frame: str) -> None:
    """The file of yaw alone, that of the vehicle, and our own simulation, at a speed that changes; mirrored in ENU."""
    path, side = steered_file(tmp_path), FRAME_SIGNS[frame][YAW.number]
    alone = module_of(export(path, to="python", frame=frame).text)
    vehicle = module_of(export([path, *model_files(tmp_path, "surge")], to="python", frame=frame, **{
        "newton_metres_per_nu": 4.0}).text)  # fmt: skip
    for u, r, delta in ((1.1, 0.2, 0.3), (0.6, -0.1, -0.2), (-0.4, 0.3, 0.1)):
        by_hand = (delta * (0.2 + 0.8 * u * abs(u) / 1.21) - 0.8 * r - 0.3 * u * r) / 0.98
        state = np.zeros(12)
        state[6], state[11] = u, side * r
        rates = vehicle.derivatives(state, np.zeros(6), rudder=side * delta)
        assert rates[11] == pytest.approx(side * by_hand, rel=1e-7)
        assert vehicle.derivatives(state, np.eye(6)[5])[11] - vehicle.derivatives(state, np.zeros(6))[
            11
        ] == pytest.approx(1.0 / (4.0 * 0.98), rel=1e-6)
        time = np.array([0.0, 1e-4])
        _, rate = alone.simulate(time, np.full(2, side * delta), 0.0, side * r, surge=np.full(2, u))
        assert (rate[1] - rate[0]) / 1e-4 == pytest.approx(side * by_hand, rel=1e-3)


def test_matlab_steers_the_vehicle_as_python_does(tmp_path: Path) -> None:
    files = [steered_file(tmp_path), *model_files(tmp_path, "surge")]
    text = export(files, to="mss", newton_metres_per_nu=4.0).text
    entries = re.findall(r"^tau_flow\(6\) = tau_flow\(6\) \+ (.*?);", text, re.MULTILINE)
    moment = sum(eval(entry, {"u": 0.6, "r": -0.1, "delta": -0.2, "abs": abs}) for entry in entries)
    assert moment == pytest.approx(4.0 * (-0.2 * (0.2 + 0.8 * 0.36 / 1.21) + 0.3 * 0.06), rel=1e-6)
    assert "vehicle6(nu, tau, eta, nu_c, delta)" in text and "if nargin < 5" in text


def beside_thrusters(folder: Path, motion: str, **rudder: float) -> Path:
    dof = DOFS[motion]
    constant = dict.fromkeys([dof.symbols.constant] * dof.has_constant, 0.1)
    content = {
        "schema": f"automarine/{motion}-model/1", f"{dof.words.force}_unit": dof.units.forces[1], "preferred": "1",
        "models": {"1": {dof.symbols.linear: 4.0, dof.symbols.inertia: 5.0} | constant},
        "effects": [{"name": "rudder", "parameters": rudder}],
    }  # fmt: skip
    path = folder / f"{motion}_model.json"
    path.write_text(json.dumps(content))
    return path


def test_a_rudder_beside_thrusters_of_one_motion(tmp_path: Path) -> None:
    """In Gazebo a force 1 m behind the origin, for MSS a constant; what has no counterpart is refused."""
    path = beside_thrusters(tmp_path, "yaw", N_delta=8.0, law=0.0, c=0.5)
    for frame in ("NED", "ENU"):
        root = ET.fromstring(export(path, to="gz-sim", frame=frame).text)
        lift = {entry.tag: entry.text for entry in list(root.iter("plugin"))[-1]}
        size = 0.5 * float(lift["air_density"]) * float(lift["area"]) * float(lift["control_joint_rad_to_cl"])
        assert float(lift["cp"].split()[0]) * size == pytest.approx(8.0, rel=1e-6)
    text = export(path, to="mss").text
    assert "+ N_delta delta u |u|\n" in text and "\nN_delta = 8  # N m s^2/m^2" in text and "law" not in text
    race = beside_thrusters(tmp_path, "yaw", N_delta=8.0, law=1.0, c=0.5)
    assert "\nc = 0.5  # m^2/s^2" in export(race, to="mss").text
    with pytest.raises(
        SettingError, match=r"gz-sim cannot represent rudder \(the target has no counterpart for its law"
    ):
        export(race, to="gz-sim")
    with pytest.raises(SettingError, match=r"; rudder \(it needs the logged rudder, surge\)"):
        export(beside_thrusters(tmp_path, "heave", Z_delta=8.0, law=0.0, c=0.5), to="gz-sim", rigid_mass=3.0)


def test_targets_without_the_speed_refuse_it_clearly(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"are angles of the rudder \(rad\) and gz-sim needs newton metres"):
        export(steered_file(tmp_path), to="gz-sim")
    with pytest.raises(SettingError, match=r"mss cannot represent rudder-inflow \(it needs the logged surge, rudder\)"):
        export(steered_file(tmp_path), to="mss")
    assert MOTIONS[5] is YAW
