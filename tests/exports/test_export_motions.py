"""Surge and heave in the names of each target: the writers, on models made here; reading files back by hand."""

import json
import re
import types
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from export_readers import constants_of, number_in

from automarine_cli import exports as targets
from automarine_cli.commands.export import export
from automarine_cli.dofs import DOFS, YAW, alone
from automarine_cli.errors import SettingError
from automarine_cli.exports.base import ModelOrigin, MotionSubject, Options, Written
from automarine_cli.exports.export import in_enu
from automarine_cli.exports.vehicle import Vehicle
from automarine_cli.models.model import Model, steady_rate

MASS, OWN, LINEAR, QUADRATIC, SKEW = 16.0, 9.5, 4.2, 21.0, 1.5
AXES = {"surge": (0, "X", "u", "x"), "sway": (1, "Y", "v", "y"), "heave": (2, "Z", "w", "z")}
"""Place among six axes, and the letters of force, velocity and position."""


def subject(motion: str, target: str, form: str, **change: Any) -> MotionSubject:
    """A model with both drags and an asymmetry, in newtons."""
    dof = DOFS[motion]
    model = replace(Model.base("2", MASS, [QUADRATIC, LINEAR], dof.units.forces[1], YAW), motion=alone(dof))
    frame, origin = targets.get(target).frames[0], ModelOrigin("model.json", "0" * 64, "2")
    return replace(MotionSubject((origin,), frame, form, Options(rigid_inertia=OWN), (), model), **change)


def written(motion: str, target: str, form: str, **change: Any) -> Written:
    axis = subject(motion, target, form, **change)
    file = targets.get(target).write(Vehicle(axis.origins, axis.frame, form, axis.settings, (), (axis,)))
    assert isinstance(file, Written)
    return file


@pytest.mark.parametrize("motion", AXES)
def test_gazebo_calls_them_by_their_letters(motion: str) -> None:
    _, force, letter, axis = AXES[motion]
    linear, fluid = f"{axis}{letter.upper()}", 2 * axis
    text = written(motion, "gz-sim", "fluid-added-mass").text
    root = ET.fromstring(text)
    assert number_in(root, f".//plugin/{linear}") == -LINEAR
    assert number_in(root, f".//plugin/{linear}abs{letter.upper()}") == -QUADRATIC
    assert number_in(root, f".//fluid_added_mass/{fluid}") == MASS - OWN
    assert number_in(root, ".//inertial/mass") == OWN and root.findtext(".//plugin/disable_added_mass") == "true"
    other = ET.fromstring(written(motion, "gz-sim", "added-mass-derivative").text)
    assert number_in(other, f".//plugin/{axis}Dot{letter.upper()}") == OWN - MASS
    assert other.find(".//fluid_added_mass") is None
    assert f"(mass + {fluid}) {letter}' = {force} + {linear} {letter}" in text and "speed m/s, mass kg" in text


@pytest.mark.parametrize("motion", AXES)
def test_vectors_have_them_in_their_place(motion: str) -> None:
    place = np.eye(6)[AXES[motion][0]]
    model = ET.fromstring(written(motion, "uuv", "urdf").text).find(".//hydrodynamic_model")
    assert model is not None
    for tag, expected in (
        ("linear_damping", -LINEAR * place), ("quadratic_damping", -QUADRATIC * place),
        ("added_mass", (MASS - OWN) * np.diag(place).ravel()),
    ):  # fmt: skip
        assert np.array_equal(np.array(str(model.findtext(tag)).split(), float), expected)
    controller = yaml.safe_load(written(motion, "uuv", "controller").text)
    assert controller["mass"] == OWN and np.array_equal(controller["Ma"], (MASS - OWN) * np.diag(place))


@pytest.mark.parametrize("motion", AXES)
def test_derivatives_have_the_motions_letters(motion: str) -> None:
    _, force, letter, _ = AXES[motion]
    model = subject(motion, "mss", "python").model.with_effect("drag-asymmetry", [SKEW])
    text = written(motion, "mss", "python", model=model).text
    assert constants_of(text) == {
        "m": OWN, f"{force}_{letter}dot": OWN - MASS, f"{force}_{letter}": -LINEAR,
        f"{force}_{letter}{letter}": -QUADRATIC, f"{force}_{letter}2": -SKEW,
    }  # fmt: skip
    equation = f"(m - {force}_{letter}dot) {letter}' = {force} + {force}_{letter} {letter} + "
    assert equation in text and "N s/m, linear damping" in text and "hydrodynamic force" in text


def test_sway_turns_over_in_enu() -> None:
    model = subject("sway", "mss", "python").model.with_effect("bias-moment", [2.0])
    assert in_enu(model).terms[-1].values == (-2.0,)


@pytest.mark.parametrize("motion", AXES)
def test_python_has_the_motions_letters_and_moves_it(motion: str) -> None:
    text, (_, force, rate, position) = written(motion, "python", "simulate").text, AXES[motion]
    assert f"# Equation: {DOFS[motion].symbols.inertia} {rate}' = {force} -{force}_{rate}{rate} |{rate}| {rate}" in text
    assert f"{position}0=0.0, {rate}0=0.0" in text and f"return {position}[node], {rate}[node]\n" in text
    module, time = types.ModuleType("exported"), np.arange(0, 20, 0.1)
    exec(text, vars(module))
    speed = module.simulate(time, 0 * time + 6.0)[1][-1]
    assert speed == pytest.approx(float(steady_rate(6.0, LINEAR, QUADRATIC)), rel=1e-4)


# Of files


def fitted(folder: Path, motion: str, number: str = "3", **more: float) -> Path:
    """A file as fit-surge and fit-heave write it."""
    _, force, letter, _ = AXES[motion]
    drag = {"1": {f"{force}_{letter}": LINEAR}, "3": {f"{force}_{letter}{letter}": QUADRATIC}}[number]
    constant = {"constant_force": 0.0} if motion == "heave" else {}
    entry = {f"m_{letter}": MASS, "half_difference": SKEW, **drag, **constant, **more}
    content = {"schema": f"automarine/{motion}-model/1", "motion": motion, "force_unit": "N"}
    path = folder / f"{motion}_model.json"
    path.write_text(json.dumps(content | {"models": {number: entry}, "preferred": number}))
    return path


def test_what_a_target_does_not_take_is_refused(tmp_path: Path) -> None:
    path = fitted(tmp_path, "surge")
    water = "^surge_model.json: the identified mass, 16, holds the water that moves along; .* with --rigid-inertia"
    with pytest.raises(SettingError, match=water):
        export(path, to="gz-sim")
    assert constants_of(export(path, to="mss").text)["m"] == MASS
    path = fitted(tmp_path, "heave", constant_force=-2.0)
    weight = (
        r"^heave_model.json: gz-sim cannot represent bias-moment \(it is the vehicle's weight less its buoyancy: set"
    )
    with pytest.raises(SettingError, match=weight):
        export(path, to="gz-sim", rigid_inertia=OWN)
    assert constants_of(export(path, to="mss", rigid_inertia=OWN).text)["Z_0"] == -2.0


@pytest.mark.parametrize(("motion", "frame", "sign"), [
    ("surge", "NED", 1.0), ("surge", "ENU", 1.0), ("heave", "NED", 1.0), ("heave", "ENU", -1.0),
])  # fmt: skip
def test_a_fitted_file_goes_out_in_both_frames(tmp_path: Path, motion: str, frame: str, sign: float) -> None:
    path, (_, force, letter, axis) = fitted(tmp_path, motion), AXES[motion]
    file, rate = export(path, to="gz-sim", rigid_inertia=OWN, frame=frame), letter.upper()
    root = ET.fromstring(file.text)
    assert number_in(root, f".//plugin/{axis}{rate}abs{rate}") == -QUADRATIC and file.left_out == ()
    assert number_in(root, f".//plugin/{axis}{rate}{rate}") == -sign * SKEW
    card = export(path, to="card", frame=frame).text
    assert card.startswith(f"# Model of {motion}: `{motion}_model.json`") and "- Unit of force: N" in card
    assert re.search(rf"^\| drag-asymmetry e \| .*\| {sign * SKEW:.4f} \| .* N s²/m² \|$", card, flags=re.MULTILINE)
    assert re.search(rf"^\| m_{letter} \| rigid and added together \|.*\| kg \|$", card, flags=re.MULTILINE)
    assert f"- quadratic-drag: `-{force}_{letter}{letter} |{letter}| {letter}`. Part of the drag grows" in card


@pytest.mark.parametrize("motion", ["surge", "heave"])
def test_linear_drag_that_differs_both_ways(tmp_path: Path, motion: str) -> None:
    path, (_, force, letter, _) = fitted(tmp_path, motion, "1"), AXES[motion]
    text = export(path, to="mss", rigid_inertia=OWN).text
    assert constants_of(text)[f"{force}_abs{letter}"] == -SKEW and f"{force}_abs{letter} |{letter}|" in text
    with pytest.raises(SettingError, match="uuv cannot represent linear-drag-asymmetry"):
        export(path, to="uuv", rigid_inertia=OWN)
