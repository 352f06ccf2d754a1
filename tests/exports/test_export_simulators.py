"""Exports in what the package registries have of the simulators: DART, Gazebo's engine, and readers of URDF and YAML.

Gazebo Sim, uuv_simulator, Stonefish and MSS themselves are in no registry of Python packages; with
`pip install --group simulators` these tests run, without it they are skipped.
"""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_readers import fall_time, number_in, rise_time, yaml_of
from numpy.typing import NDArray
from test_export import model_file, ours

from automarine_cli.workflows.export import export

Floats = NDArray[np.float64]
STEP = 1e-3  # s, Gazebo's own


def in_dart(text: str, moment: float, rate0: float, seconds: float) -> tuple[Floats, Floats]:
    """Yaw rates of the SDF's vehicle in the engine that gz-sim runs on, with the Hydrodynamics system's torque.

    The engine has the fluid's added inertia in its spatial inertia, as gz-physics gives it; the system takes the
    acceleration from the last two steps.
    """
    dart = pytest.importorskip("dartpy")
    link, plugin = ET.fromstring(text).find(".//link"), ET.fromstring(text).find(".//plugin")
    assert link is not None and plugin is not None
    rotation = [number_in(link, f"inertial/inertia/i{i}{i}") for i in "xyz"]
    rotation[2] += number_in(link, "inertial/fluid_added_mass/rr", 0.0)
    spatial = np.diag([*rotation, *[number_in(link, "inertial/mass")] * 3])  # DART's order: rotation first
    tags = ("nR", "nRabsR", "nRR", "nDotR")
    linear, absolute, square, dot = (number_in(plugin, tag, 0.0) for tag in tags)
    dot = 0.0 if plugin.findtext("disable_added_mass") == "true" else dot
    world, skeleton = dart.simulation.World(), dart.dynamics.Skeleton("vehicle")
    _, body = skeleton.createFreeJointAndBodyNodePair()
    body.setInertia(dart.dynamics.Inertia(spatial))
    world.setGravity([0.0, 0.0, 0.0])
    world.setTimeStep(STEP)
    world.addSkeleton(skeleton)
    skeleton.setVelocities(np.array([0.0, 0.0, rate0, 0.0, 0.0, 0.0]))
    rates, before = [rate0], rate0
    for _ in range(round(seconds / STEP)):
        r = rates[-1]
        torque = linear * r + absolute * abs(r) * r + square * r * r + dot * (r - before) / STEP
        before = r
        body.addExtTorque(np.array([0.0, 0.0, torque + moment]))
        world.step()
        rates.append(float(skeleton.getVelocities()[2]))
    return STEP * np.arange(len(rates)), np.array(rates)


@pytest.mark.parametrize(
    ("form", "rigid"), [("fluid-added-mass", None), ("fluid-added-mass", 0.9), ("added-mass-derivative", 1.0)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gazebos_engine_moves_the_file_as_we_do(tmp_path: Path, form: str, rigid: float | None, sign: float) -> None:
    text = export(model_file(tmp_path), to="gz-sim", form=form, rigid_inertia=rigid).text
    expected = rise_time(*ours(sign * 1.5, 0.0, 15.0))
    assert rise_time(*in_dart(text, sign * 1.5, 0.0, 15.0)) == pytest.approx(expected, rel=0.01)
    time, rate = in_dart(text, 0.0, sign * 1.2, 6.0)
    assert fall_time(time, rate) == pytest.approx(fall_time(*ours(0.0, sign * 1.2, 6.0)), rel=0.01)
    assert np.all(np.diff(rate[1:] ** 2) < 0)


def test_urdf_is_read_by_ross_own_parser(tmp_path: Path) -> None:
    parser = pytest.importorskip("urdf_parser_py.urdf")
    robot = parser.URDF.from_xml_string(export(model_file(tmp_path), to="uuv", rigid_inertia=0.9).text.encode())
    assert [link.name for link in robot.links] == ["base_link"]
    assert robot.links[0].inertial.inertia.izz == 0.9


@pytest.mark.parametrize(("target", "form"), [("uuv", "controller"), ("labust", "model")])
def test_yaml_is_read_as_we_read_it(tmp_path: Path, target: str, form: str) -> None:
    yaml: Any = pytest.importorskip("yaml")
    text = export(model_file(tmp_path), to=target, form=form, rigid_inertia=0.9).text
    assert yaml.safe_load(text) == yaml_of(text)
