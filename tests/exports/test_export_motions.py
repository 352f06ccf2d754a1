"""Surge and heave in the names of each target: the writers, on models made here; reading files back by hand."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effect_contract import strange_to
from export_readers import constants_of, number_in, yaml_of

from automarine_cli import exports as targets
from automarine_cli.commands.export import export
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import SettingError
from automarine_cli.exports.base import FORCES, FRAMES, THRUSTER_MAP, Origin, Settings, Written, YawSubject
from automarine_cli.exports.export import in_enu, in_unit, refuse_inertia, split
from automarine_cli.models.store import ModelEntry, ModelFile
from automarine_cli.models.yaw_model import YawModel, steady_rate

MASS, OWN, LINEAR, QUADRATIC, SKEW = 16.0, 9.5, 4.2, 21.0, 1.5
PLACES = {"surge": 0, "sway": 1, "heave": 2, "yaw": 5}
ADDED = {"linear-drag-asymmetry": [0.5], "thruster-lag": [0.2], "sensor-lag": [0.3], "thrust-loss": [0.1],
         "periodic-disturbance": [0.4, 0.2, 6.0], "water-swirl": [0.1, 5.0], "coulomb-drag": [0.3]}  # fmt: skip


def subject(motion: str, target: str, form: str, **change: Any) -> YawSubject:
    """A model with both drags and an asymmetry, in newtons."""
    dof = DOFS[motion]
    model = replace(YawModel.base("2", MASS, [QUADRATIC, LINEAR], dof.units.forces[1], YAW), dof=dof)
    settings = Settings(rigid_inertia=OWN)
    frame = targets.get(target).frames[0]
    made = YawSubject(Origin("model.json", "0" * 64, "2"), model, frame, form, settings)
    return YawSubject(**{**vars(made), **change})


def written(motion: str, target: str, form: str, **change: Any) -> Written:
    found = targets.get(target).write(subject(motion, target, form, **change))
    assert isinstance(found, Written)
    return found


def told_by_nobody(dof: Dof) -> ModelFile:
    return ModelFile(schema="", models={"3": ModelEntry(), "2": ModelEntry()}, preferred="3", dof=dof)


def letters(motion: str) -> tuple[str, str]:
    dof = DOFS[motion]
    return FORCES[dof.number], dof.symbols.velocity


def test_every_motion_has_a_place_of_its_own() -> None:
    assert {name: dof.number for name, dof in DOFS.items()} == PLACES
    assert [letters(name) for name in PLACES] == [("X", "u"), ("Y", "v"), ("Z", "w"), ("N", "r")]


@pytest.mark.parametrize("motion", [name for name in PLACES if name != "yaw"])
def test_files_have_no_word_of_another_motion(motion: str) -> None:
    dof = DOFS[motion]
    model = subject(motion, "python", "simulate").model
    for name, values in ADDED.items():
        model = model.with_effect(name, values)
    for name in targets.names():
        target = targets.get(name)
        if target.takes == THRUSTER_MAP or motion not in target.motions:
            continue
        for form, frame in product(target.forms, target.frames):
            kept, left_out = split(target, model, Settings())
            own = replace(model, terms=kept)
            made = written(motion, name, form, model=own, frame=frame, left_out=left_out, file=told_by_nobody(dof))
            said = made.text.partition("@dataclass")[0]  # what stands behind is the library's own, in its own words
            told = said if name in ("python", "card") else "\n".join([*made.notes, *comments(made.text)])
            for text in FRAMES.values():
                told = told.replace(text, "")
            strange = strange_to(dof, told)
            assert not strange, (name, form, frame, strange)


def comments(text: str) -> list[str]:
    """What a file of numbers says of itself."""
    return re.findall(r"^(?:[#%] |  (?=[A-Z][a-z ]+:)).*$", text, flags=re.MULTILINE)


@pytest.mark.parametrize(("motion", "linear", "absolute", "dot", "fluid"), [
    ("surge", "xU", "xUabsU", "xDotU", "xx"), ("sway", "yV", "yVabsV", "yDotV", "yy"),
    ("heave", "zW", "zWabsW", "zDotW", "zz"),
])  # fmt: skip
def test_gazebo_calls_them_by_their_letters(motion: str, linear: str, absolute: str, dot: str, fluid: str) -> None:
    root = ET.fromstring(written(motion, "gz-sim", "fluid-added-mass").text)
    plugin = root.find(".//plugin")
    assert plugin is not None
    assert (number_in(plugin, linear), number_in(plugin, absolute)) == (-LINEAR, -QUADRATIC)
    assert number_in(root, f".//fluid_added_mass/{fluid}") == MASS - OWN
    assert number_in(root, ".//inertial/mass") == OWN and plugin.findtext("disable_added_mass") == "true"
    other = ET.fromstring(written(motion, "gz-sim", "added-mass-derivative").text)
    assert number_in(other, f".//plugin/{dot}") == OWN - MASS and other.find(".//fluid_added_mass") is None
    text = written(motion, "gz-sim", "fluid-added-mass").text
    letter = linear[1].lower()
    assert f"(mass + {fluid}) {letter}' = {linear[0].upper()} + {linear} {letter}" in text
    assert "speed m/s, mass kg" in text and "No axis but " + motion in text


@pytest.mark.parametrize("motion", ["surge", "sway", "heave"])
def test_vectors_have_them_in_their_place(motion: str) -> None:
    place = PLACES[motion]
    model = ET.fromstring(written(motion, "uuv", "urdf").text).find(".//hydrodynamic_model")
    assert model is not None
    for tag, value in (("linear_damping", -LINEAR), ("quadratic_damping", -QUADRATIC)):
        found = np.array(str(model.findtext(tag)).split(), float)
        assert found[place] == value and np.count_nonzero(found) == 1
    mass = np.array(str(model.findtext("added_mass")).split(), float).reshape(6, 6)
    assert mass[place, place] == MASS - OWN and np.count_nonzero(mass) == 1
    controller = yaml_of(written(motion, "uuv", "controller").text)
    assert controller["mass"] == OWN and np.array(controller["Ma"])[place, place] == MASS - OWN
    labust = yaml_of(written(motion, "labust", "model").text)
    assert labust["mass"] == OWN and "inertia_matrix" not in labust
    for key, value in (("added_mass", MASS - OWN), ("linear_damping", LINEAR), ("quadratic_damping", QUADRATIC)):
        found = np.array(labust[key], float)
        assert found[place] == value and np.count_nonzero(found) == 1


@pytest.mark.parametrize(("motion", "force", "letter"), [("surge", "X", "u"), ("sway", "Y", "v"), ("heave", "Z", "w")])
def test_derivatives_have_the_motions_letters(motion: str, force: str, letter: str) -> None:
    model = subject(motion, "mss", "python").model.with_effect("drag-asymmetry", [SKEW])
    text = written(motion, "mss", "python", model=model).text
    assert constants_of(text) == {
        "m": OWN, f"{force}_{letter}dot": OWN - MASS, f"{force}_{letter}": -LINEAR,
        f"{force}_{letter}{letter}": -QUADRATIC, f"{force}_{letter}2": -SKEW,
    }  # fmt: skip
    equation = f"(m - {force}_{letter}dot) {letter}' = {force} + {force}_{letter} {letter} + "
    assert equation in text and "N s/m, linear damping" in text and "hydrodynamic force" in text


def test_sway_and_heave_turn_over_in_enu_and_surge_does_not() -> None:
    for motion in ("sway", "heave"):
        model = subject(motion, "mss", "python").model.with_effect("bias-moment", [2.0])
        assert in_enu(model).terms[-1].values == (-2.0,)
    ahead = replace(model, dof=DOFS["surge"])
    assert in_enu(ahead) == ahead


@pytest.mark.parametrize("motion", ["surge", "sway", "heave"])
def test_a_card_speaks_of_the_motion(motion: str) -> None:
    text = written(motion, "card", "markdown", file=told_by_nobody(DOFS[motion])).text
    assert text.startswith(f"# Model of {motion}: `model.json`") and "- Unit of force: N" in text
    (force, letter), name = letters(motion), DOFS[motion].symbols.inertia
    assert re.search(rf"^\| {name} \| rigid and added together \|.*\| kg \|$", text, flags=re.MULTILINE)
    assert f"{name} {letter}' = {force} + the forces" in text and "N s²/m²" in text
    assert f"- quadratic-drag: `-{force}_{letter}{letter} |{letter}| {letter}`. Part of the drag grows" in text
    assert "yaw" not in text and "inertia" not in text and "rate" not in text


@pytest.mark.parametrize(("motion", "position", "rate"), [("surge", "x", "u"), ("sway", "y", "v"), ("heave", "z", "w")])
def test_python_has_the_motions_letters_and_moves_it(tmp_path: Path, motion: str, position: str, rate: str) -> None:
    model = (
        subject(motion, "python", "simulate")
        .model.with_effect("water-swirl", [0.1, 5.0])
        .with_effect("thruster-lag", [0.2])
    )
    text = written(motion, "python", "simulate", model=model).text
    (force, _), mass = letters(motion), DOFS[motion].symbols.inertia
    assert f"# Equation: {mass} {rate}' = {force} -{force}_{rate}{rate} |{rate}| {rate}" in text
    assert f"{position}0=0.0, {rate}0=0.0" in text and f"return {position}[node], {rate}[node]\n" in text
    assert "as it is read [m] and speed [m/s] at `time` [s] under `force` [N], all (N,)" in text
    made = tmp_path / "made.py"
    made.write_text(written(motion, "python", "simulate").text)
    call = "import made, numpy as np; t = np.arange(0, 20, 0.1); print(made.simulate(t, 0 * t + 6.0)[1][-1])"
    out = subprocess.run([sys.executable, "-c", call], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(out.stdout) == pytest.approx(float(steady_rate(6.0, LINEAR, QUADRATIC)), rel=1e-4)


def test_what_a_target_does_not_take_is_refused(tmp_path: Path) -> None:
    path = fitted(tmp_path, "surge")
    with pytest.raises(SettingError) as problem:
        export(path, to="stonefish")
    assert str(problem.value) == "surge_model.json is a model of surge; --to stonefish takes models of yaw"


def test_a_mass_that_holds_water_is_not_a_links_mass() -> None:
    one = subject("surge", "gz-sim", "fluid-added-mass")
    with pytest.raises(SettingError) as problem:
        refuse_inertia(targets.get("gz-sim"), None, one.model, one.origin)
    assert str(problem.value) == (
        "model.json: the identified mass, 16, holds the water that moves along; as a link's mass it would weigh on the "
        "vehicle: give the vehicle's own with --rigid-inertia"
    )
    refuse_inertia(targets.get("mss"), None, one.model, one.origin)


def test_the_constant_force_of_heave_is_for_mass_and_volume() -> None:
    one = subject("heave", "uuv", "urdf")
    kept, (left,) = split(targets.get("uuv"), one.model.with_effect("bias-moment", [-2.0]), Settings())
    assert kept == one.model.terms and left.name == "bias-moment"
    assert left.why == "it is the vehicle's weight less its buoyancy: set mass and volume of your model by it"


def test_normalised_forces_need_their_size_in_newtons() -> None:
    origin = Origin("surge_model.json", "0" * 64)
    model = YawModel.base("2", 2.0, [3.0, 0.5], "nu", DOFS["surge"])
    with pytest.raises(SettingError, match=r"its forces are normalised \(nu\) and uuv needs newtons; give .* \[N\]"):
        in_unit(targets.get("uuv"), model, Settings(), origin)
    found = in_unit(targets.get("uuv"), model, Settings(newton_metres_per_nu=8.0), origin)
    assert (found.inertia, found.drag(), found.moment_unit) == (16.0, (4.0, 24.0), "N")


def fitted(folder: Path, motion: str, number: str = "3", **more: float) -> Path:
    """A file as fit-surge and fit-heave write it."""
    force, letter = letters(motion)
    drag = {"1": {f"{force}_{letter}": LINEAR}, "3": {f"{force}_{letter}{letter}": QUADRATIC}}[number]
    constant = {"constant_force": 0.0} if motion == "heave" else {}
    entry = {f"m_{letter}": MASS, "half_difference": SKEW, **drag, **constant, **more}
    content = {"schema": f"automarine/{motion}-model/1", "motion": motion, "force_unit": "N"}
    path = folder / f"{motion}_model.json"
    path.write_text(json.dumps(content | {"models": {number: entry}, "preferred": number}))
    return path


@pytest.mark.parametrize(("motion", "frame", "sign"), [
    ("surge", "NED", 1.0), ("surge", "ENU", 1.0), ("heave", "NED", 1.0), ("heave", "ENU", -1.0),
])  # fmt: skip
def test_a_fitted_file_goes_out_in_both_frames(tmp_path: Path, motion: str, frame: str, sign: float) -> None:
    path = fitted(tmp_path, motion)
    found = export(path, to="gz-sim", rigid_inertia=OWN, frame=frame)
    plugin = ET.fromstring(found.text).find(".//plugin")
    assert plugin is not None and found.left_out == ()
    linear = {"surge": "xU", "heave": "zW"}[motion]
    assert number_in(plugin, f"{linear}abs{linear[1]}") == -QUADRATIC
    assert number_in(plugin, f"{linear}{linear[1]}") == -sign * SKEW
    assert export(path, to="gz-sim", rigid_inertia=OWN, frame=frame).text == found.text
    card = export(path, to="card", frame=frame).text
    assert "| drag-asymmetry e | half the difference of quadratic drag" in card
    assert f"| {sign * SKEW:.4f} | " in card


@pytest.mark.parametrize("motion", ["surge", "heave"])
def test_linear_drag_that_differs_both_ways(tmp_path: Path, motion: str) -> None:
    path, (force, letter) = fitted(tmp_path, motion, "1"), letters(motion)
    text = export(path, to="mss", rigid_inertia=OWN).text
    assert constants_of(text)[f"{force}_abs{letter}"] == -SKEW and f"{force}_abs{letter} |{letter}|" in text
    with pytest.raises(SettingError, match="uuv cannot represent linear-drag-asymmetry"):
        export(path, to="uuv", rigid_inertia=OWN)


def test_heave_without_its_constant_force_is_refused_by_a_simulator(tmp_path: Path) -> None:
    path = fitted(tmp_path, "heave", constant_force=-2.0)
    with pytest.raises(SettingError) as problem:
        export(path, to="gz-sim", rigid_inertia=OWN)
    assert str(problem.value) == (
        "heave_model.json: gz-sim cannot represent bias-moment (it is the vehicle's weight less its buoyancy: set mass "
        "and volume of your model by it); give --allow-partial to write the file without, or take --to python, which "
        "has them"
    )
    assert constants_of(export(path, to="mss", rigid_inertia=OWN).text)["Z_0"] == -2.0
