"""Exports of planar models: what each file says moves as our simulator does, in its frame; the rest is refused."""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from made_planar import FULL, driven
from numpy.typing import NDArray

from automarine_cli.commands.export import export
from automarine_cli.dofs import PLANAR
from automarine_cli.errors import SettingError
from automarine_cli.exports.export import export_targets
from automarine_cli.models.model import Model, Term
from automarine_cli.models.store import planar_json
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

Floats = NDArray[np.float64]
Three = tuple[float, float, float]
MODEL = replace(FULL, terms=tuple(term for term in FULL.terms if term.name != "input-delay"))
"""Every drag, coupling and current, and a moment that always acts."""
DRAGS = replace(MODEL, terms=tuple(term for term in MODEL.terms if term.name != "bias-moment"))
RUDDER = (Term("rudder", (-8.0, 0.0, 0.5), dof=1), Term("rudder", (3.0, 0.0, 0.5), dof=2))
STEERED_DRAGS = DRAGS.with_term(RUDDER[0]).with_term(RUDDER[1])
SIDES = np.array([1.0, -1.0, -1.0])


def model_file(folder: Path, model: Model = MODEL) -> Path:
    path = folder / "planar_model.json"
    path.write_text(json.dumps(planar_json(model)))
    return path


STEERED = MODEL
for steering in (
    Term("rudder-drag", (6.0,), dof=0), Term("rudder", (-8.0, 1.0, 0.5), dof=1), Term("rudder", (3.0, 0.0, 0.5), dof=2),
    Term("rudder-race", (0.2,), dof=2),
):  # fmt: skip
    STEERED = STEERED.with_term(steering)
NEUTRAL_OFF = STEERED.with_term(Term("rudder-offset", (0.1,), dof=2))


@pytest.mark.parametrize("frame", ["NED", "ENU"])
@pytest.mark.parametrize("model", [MODEL, STEERED, NEUTRAL_OFF], ids=["commands", "rudder", "neutral"])
def test_the_python_file_moves_as_the_simulator_does(tmp_path: Path, frame: str, model: Model) -> None:
    """To 1e-6, under commands that change at the samples, and a rudder that is put over."""
    space: dict[str, Any] = {}
    exec(export(model_file(tmp_path, model), to="python", frame=frame).text, space)
    run = driven(3, 12.0, 0.5)
    run = replace(run, extras={**run.extras, "rudder": np.full(len(run), 0.3)})
    tau = np.stack([run.extras["force_X"], run.extras["force_Y"], run.command])
    first, moving = np.array([1.0, -2.0, 0.7]), np.array([0.4, -0.2, 0.3])
    start = Start(first.reshape(3, 1, 1), moving.reshape(3, 1, 1))
    expected = simulate(model, make_batch([run], 0.01, model.signals, motion=PLANAR), start=start)
    changes = np.flatnonzero(np.any(np.diff(tau, axis=1), axis=0))
    middle = 0.5 * (run.time[changes] + run.time[changes + 1])  # where the simulator changes a command
    time = np.unique(np.concatenate([np.arange(run.time[0], run.time[-1], 0.01), run.time, middle]))
    enu, sides = frame == "ENU", SIDES if frame == "ENU" else np.ones(3)
    begin = np.array([*first[:2], np.pi / 2 - first[2] if enu else first[2], *(moving * sides)])
    angle = {"rudder": 0.3 * sides[2]} if model is not MODEL else {}
    moves = space["simulate"](time, *(tau[:, _sample(run.time, middle, time)] * sides[:, None]), *begin, **angle)
    positions, velocities = np.stack(moves)[:, np.isin(time, run.time)]
    if enu:
        positions[:, 2] = np.pi / 2 - positions[:, 2]
    np.testing.assert_allclose(positions, expected.positions[0, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(velocities * sides, expected.velocities[0, 0], rtol=0, atol=1e-6)


def _sample(samples: Floats, middle: Floats, time: Floats) -> NDArray[np.int64]:
    """Which sample's command holds at each time: the first one after the change before it."""
    edges = np.concatenate([[-np.inf], middle])
    first = np.searchsorted(samples, edges)
    return np.minimum(first[np.searchsorted(middle, time, side="right")], len(samples) - 1)


def accelerations(model: Model, nu: Floats, tau: Floats, delta: float = 0.0) -> Floats:
    """nu' of our simulator in still water, by a step of a microsecond."""
    still, h = replace(model, water=None), 1e-6
    forces = {"force_X": np.full(2, tau[0]), "force_Y": np.full(2, tau[1]), "rudder": np.full(2, delta)}
    run = replace(driven(0).cut(0, 2), time=np.array([0.0, h]), moment=np.full(2, tau[2]), extras=forces)
    after = simulate(
        still, make_batch([run], h, model.signals, motion=PLANAR), start=Start(velocity=nu.reshape(3, 1, 1))
    )
    return (after.velocities[0, 0, 1] - nu) / h


STATES = [
    ((0.7, -0.3, 0.4), (5.0, 2.0, -1.0)), ((-0.5, 0.2, -0.6), (0.0, -3.0, 1.0)), ((0.0, 0.0, 0.5), (1.0, 0.0, 0.0)),
]  # fmt: skip


@pytest.mark.parametrize("model", [MODEL, STEERED, NEUTRAL_OFF], ids=["commands", "rudder", "neutral"])
@pytest.mark.parametrize(("nu", "tau"), STATES)
def test_the_mss_function_has_our_accelerations(tmp_path: Path, nu: Three, tau: Three, model: Model) -> None:
    text, steered, delta = export(model_file(tmp_path, model), to="mss").text, model is not MODEL, 0.3
    numbers = {name: re.search(rf"^{name} = \[(.*)\]'?;", text, re.MULTILINE)[1] for name in ("M", "tau_0")}
    inertia = np.array([[float(x) for x in row.split()] for row in numbers["M"].split(";")])
    constant = np.array([float(x) for x in numbers["tau_0"].split()])
    velocities, drag = dict(zip("uvr", nu)), np.zeros((3, 3))
    entries = re.compile(r"^D\((\d),(\d)\) = D\(\d,\d\) \+ (\S+?)(?: \* abs\((\w)\))?;", re.MULTILINE)
    for i, j, value, along in entries.findall(text):
        drag[int(i) - 1, int(j) - 1] += float(value) * (abs(velocities[along]) if along else 1.0)
    assert "C = [0 0 -p(2); 0 0 p(1); p(2) -p(1) 0];" in text
    assert text.startswith(f"function [nu_dot, M, C, D] = vehicle3(nu, tau, nu_c{', delta' if steered else ''})")
    flow, letters = np.zeros(3), velocities | {"abs": abs, "tau": lambda i: tau[i - 1], "delta": delta}
    for i, value in re.findall(r"^tau_flow\((\d)\) = tau_flow\(\1\) \+ (.*?);", text, re.MULTILINE):
        flow[int(i) - 1] += eval(value.replace("^", "**"), letters)
    p, state = inertia @ nu, np.array(nu)
    coriolis = np.array([[0, 0, -p[1]], [0, 0, p[0]], [p[1], -p[0], 0]])
    found = np.linalg.solve(inertia, np.array(tau) + constant + flow - coriolis @ state - drag @ state)
    np.testing.assert_allclose(found, accelerations(model, state, np.array(tau), delta), rtol=1e-4, atol=1e-5)
    lines = text.splitlines()
    assert lines[-1] == "end" and text.count("\nif ") == 1 + steered and text.count("\nend") == 2 + steered
    assert ("+ tau_flow -" in text) == steered


@pytest.mark.parametrize("delta", [0.0, 0.2])
@pytest.mark.parametrize("frame", ["ENU", "NED"])
@pytest.mark.parametrize(("nu", "tau"), STATES)
def test_gazebo_has_our_accelerations(tmp_path: Path, frame: str, nu: Three, tau: Three, delta: float) -> None:
    """By the system's own sum of derivatives, the engine's inertia, and what its LiftDrag makes of a rudder."""
    model = DRAGS if delta == 0.0 else STEERED_DRAGS
    text = export(model_file(tmp_path, model), to="gz-sim", frame=frame, rigid_mass=15.0, rigid_inertia=2.0).text
    root, side = ET.fromstring(text), SIDES if frame == "ENU" else np.ones(3)
    link = root.find(".//inertial")
    fluid = np.zeros((3, 3))
    for one in link.find("fluid_added_mass"):
        i, j = ("xyr".index(letter) for letter in one.tag)
        fluid[i, j] = fluid[j, i] = float(one.text)
    rigid = np.diag([float(link.findtext("mass"))] * 2 + [float(link.findtext("inertia/izz"))])
    state, force = side * nu, side * tau
    velocity = dict(zip("UVR", state))
    plugin = root.find(".//plugin")
    assert plugin.findtext("disable_added_mass") == plugin.findtext("disable_coriolis") == "true"
    for one in plugin:
        if found := re.fullmatch(r"([xyn])([UVR])(?:abs([UVR]))?", one.tag):
            size = abs(velocity[found[3]]) if found[3] else 1.0
            force["xyn".index(found[1])] += float(one.text) * size * velocity[found[2]]
    if delta:
        force = force + lift_drag(root, state, side[2] * delta)
    inertia = rigid + fluid
    p, (u, v, r) = inertia @ state, state
    found = np.linalg.solve(inertia, force - [-p[1] * r, p[0] * r, p[1] * u - p[0] * v])
    np.testing.assert_allclose(
        side * found, accelerations(model, np.array(nu), np.array(tau), delta), rtol=1e-4, atol=1e-5
    )


def lift_drag(root: ET.Element, state: Floats, angle: float) -> Floats:
    """X, Y and N of the LiftDrag system by its documentation: in flow that meets the surface with (a, b), the lift is
    cl/2 rho area |(a, b)| (-b, a); here with the part of b left out, which our law of a rudder has not."""
    system = next(p for p in root.iter("plugin") if p.get("name") == "gz::sim::systems::LiftDrag")
    value = {entry.tag: entry.text for entry in system}
    joint, (x, y, z) = root.find(".//joint"), map(float, value["cp"].split())
    assert joint.get("name") == value["control_joint_name"] and joint.findtext("axis/xyz") == "0 0 1"
    assert value["cla"] == value["cda"] == value["cma"] == "0" and (y, z) == (0.0, 0.0)
    assert (value["forward"], value["upward"]) == ("1 0 0", "0 1 0")
    size = 0.5 * float(value["air_density"]) * float(value["area"]) * float(value["control_joint_rad_to_cl"]) * angle
    lift = size * state[0] * abs(state[0])
    return np.array([0.0, lift, x * lift])


@pytest.mark.parametrize(
    ("target", "model", "settings", "says"),
    [
        ("python", FULL, {}, "represent yaw.input-delay (it acts in the thrusters, before the moment); give"),
        ("uuv", MODEL, {}, "one motion: take --to gz-sim or mss or python, or a model of one"),
        ("gz-sim", DRAGS, {}, "give the vehicle's own with --rigid-mass"),
        ("gz-sim", DRAGS, {"rigid_mass": 25.0, "rigid_inertia": 1.0}, "found 25, expected more than 0"),
        ("gz-sim", DRAGS, {"rigid_mass": 5.0, "rigid_inertia": 3.0}, "--rigid-inertia: found 3, expected more than 0"),
        ("gz-sim", MODEL, {"rigid_mass": 5.0, "rigid_inertia": 1.0}, "yaw.bias-moment (the target's equation has no"),
        ("python", MODEL, {"newton_metres_per_nu": 2.0}, "is in newtons already"),
        ("mss", MODEL, {"form": "python"}, "--form of mss: found python, expected matlab"),
    ],
)  # fmt: skip
def test_refusals(tmp_path: Path, target: str, model: Model, settings: dict[str, object], says: str) -> None:
    with pytest.raises(SettingError) as refusal:
        export(model_file(tmp_path, model), to=target, **settings)  # type: ignore[arg-type]
    assert says in str(refusal.value)


def test_the_command_and_what_is_left_out(tmp_path: Path, run: Callable[..., Result]) -> None:
    partly = export(model_file(tmp_path, FULL), to="python", allow_partial=True)
    assert [part.name for part in partly.left_out] == ["yaw.input-delay"] and "Left out: yaw.input-delay" in partly.text
    path, out = model_file(tmp_path, DRAGS), tmp_path / "vehicle.sdf"
    result = run("export", path, "--to", "gz-sim", "--rigid-mass", 15, "--rigid-inertia", 2, "-o", out)
    assert result.exit_code == 0 and "Frame: ENU world" in out.read_text()
    assert "current of 0.25 m/s north and -0.15 m/s east" in " ".join(result.stdout.split())
    motions = {target["name"]: target["motions"] for target in export_targets().to_json()["targets"]}
    assert [name for name in motions if "planar" in motions[name]] == ["gz-sim", "mss", "python"]
