"""Exports in MuJoCo, of all simulators the one in the registries of Python packages.

Gazebo Sim, uuv_simulator and MSS themselves are in no registry of Python packages; with
`pip install --group simulators` these tests run, without it they are skipped.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from test_export import model_file
from test_export_motions import LINEAR, MASS, OWN, QUADRATIC, written
from test_export_vehicle import OWN as VEHICLE
from test_export_vehicle import model_files

from automarine_cli.commands.export import export
from automarine_cli.dofs import YAW
from automarine_cli.models.model import steady_rate
from automarine_cli.models.store import read_model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

Floats = NDArray[np.float64]


SEQUENCE = ((0.0, 2.0), (1.2, 8.0), (-1.2, 10.0), (0.5, 10.0), (0.0, 5.0), (-0.7, 10.0), (0.9, 15.0))  # N m, s
LAG = {"T": 0.3, "law": 1.0, "tau_ref": 1.0, "fall": 1.0}
WITH: dict[str, dict[str, dict[str, float]]] = {
    "drag": {},
    "cubic": {"cubic-drag": {"k_rrr": 0.4}},
    "delay and lag": {"input-delay": {"t_d": 0.35}, "thruster-lag": LAG},
    "dry friction": {"coulomb-drag": {"c": 0.15}},
    "limit and bias": {"saturation": {"tau_max": 0.8}, "bias-moment": {"b": 0.1}},
    "tether": {"tether-spring": {"kappa": 0.02, "law": 2.0, "kappa_3": 1e-4}},
    "all": {
        "input-delay": {"t_d": 0.2}, "thruster-lag": LAG, "cubic-drag": {"k_rrr": 0.3}, "bias-moment": {"b": -0.05},
        "tether-spring": {"kappa": 0.03}, "saturation": {"tau_max": 1.0},
    },
}  # fmt: skip


QUICK = ("drag", "dry friction", "all")


def in_mujoco(text: str, moments: Floats, step: float) -> Floats:
    """Positions of the file's joint at the ends of steps over which controls are held, in MuJoCo itself."""
    mujoco = pytest.importorskip("mujoco", minversion="3.7")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    assert model.opt.density == model.opt.viscosity == 0  # no fluid acts
    found = [0.0]
    for moment in moments:
        data.ctrl[0] = moment
        for _ in range(round(step / model.opt.timestep)):
            mujoco.mj_step(model, data)
        found.append(float(data.qpos[0]))
    return np.array(found)


def commanded(step: float) -> Floats:
    """The moments of `SEQUENCE`, 60 s, one each step."""
    return np.concatenate([np.full(round(seconds / step), moment) for moment, seconds in SEQUENCE])


@pytest.mark.parametrize(
    "case", [*QUICK, *(pytest.param(case, marks=pytest.mark.slow) for case in WITH if case not in QUICK)]
)
@pytest.mark.parametrize(("frame", "sign"), [("ENU", 1.0), pytest.param("NED", -1.0, marks=pytest.mark.slow)])
def test_mujoco_moves_the_file_as_we_do(tmp_path: Path, case: str, frame: str, sign: float) -> None:
    """Within 0.1 degrees over 60 s of steps and reversals."""
    path = model_file(tmp_path, WITH[case])
    step = 0.05
    moments = sign * commanded(step)
    turn = -1.0 if frame == "ENU" else 1.0
    text = export(path, to="mjcf", frame=frame, rigid_inertia=0.9).text
    halves = np.append(np.repeat(moments, 2)[1:], moments[-1])  # we switch in the middle between two samples
    theirs = turn * in_mujoco(text, turn * halves, step / 2)[::2]
    time = step * np.arange(len(moments) + 1)
    run = Run("run", "", time, 0 * time, np.append(moments, moments[-1]), "N m", dof=YAW)
    own = simulate(read_model(path).models["2"], make_batch([run], 0.01), start=Start()).position[0, 0]
    assert np.ptp(np.rad2deg(own)) > 60
    assert np.abs(np.rad2deg(theirs - own)).max() < 0.1


@pytest.mark.parametrize(("motion", "axis"), [("surge", "1 0 0"), ("sway", "0 1 0"), ("heave", "0 0 1")])
@pytest.mark.parametrize("frame", ["ENU", "NED"])
def test_mujoco_slides_along_the_motions_axis(motion: str, axis: str, frame: str) -> None:
    """Forces ahead push ahead, and every other one by the frame: y is to port and z up in MuJoCo."""
    mujoco = pytest.importorskip("mujoco", minversion="3.7")
    model = mujoco.MjModel.from_xml_string(written(motion, "mjcf", "joint", frame=frame).text)
    data = mujoco.MjData(model)
    data.ctrl[0] = 5.0
    mujoco.mj_step(model, data, nstep=20_000)
    steady = float(steady_rate(5.0, LINEAR, QUADRATIC))
    assert data.qvel[0] == pytest.approx(steady, rel=1e-4)
    turned = frame == "NED" and motion != "surge"
    way = np.array([float(x) for x in axis.split()]) * (-1 if turned else 1)
    np.testing.assert_allclose(data.xpos[1] / np.linalg.norm(data.xpos[1]), way, atol=1e-9)
    assert model.body_mass[1] == OWN and model.dof_armature[0] == pytest.approx(MASS - OWN)


@pytest.mark.parametrize("frame", ["ENU", "NED"])
def test_mujoco_moves_a_vehicle_of_several_motions(tmp_path: Path, frame: str) -> None:
    """Each motion by its own actuator reaches its steady speed, roll swings with its period and lists as it should."""
    mujoco = pytest.importorskip("mujoco", minversion="3.7")
    files = model_files(tmp_path, "sway", "roll", "yaw")
    model = mujoco.MjModel.from_xml_string(export(files, to="mjcf", frame=frame, **VEHICLE).text)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)]
    assert names == ["sway", "yaw", "roll"] and model.body_mass[1] == 11.0
    for control, place, force, k_r, k_rr in ((0, 0, 5.0, 0.0, 58.0), (2, 1, 1.5, 0.0, 1.5 * 1.257)):
        data = mujoco.MjData(model)
        data.ctrl[control] = force
        mujoco.mj_step(model, data, nstep=20_000)
        assert data.qvel[place] == pytest.approx(float(steady_rate(force, k_r, k_rr)), rel=1e-3)
    np.testing.assert_allclose(data.xmat[1].reshape(3, 3)[2, 2], np.cos(data.qpos[2]), atol=1e-9)
    data = mujoco.MjData(model)
    data.qpos[2] = 0.1
    angles = []
    for _ in range(60_000):
        mujoco.mj_step(model, data)
        angles.append(float(data.qpos[2]))
    rest = np.arcsin(0.2 / 12.0)
    assert np.mean(angles[-12_500:]) == pytest.approx(rest, rel=0.01)  # over five periods
    crossings = np.flatnonzero(np.diff(np.sign(np.array(angles[:20_000]) - rest)) > 0)
    assert float(np.mean(np.diff(crossings))) / 1000 == pytest.approx(2 * np.pi * np.sqrt(1.9 / 12.0), rel=0.01)
