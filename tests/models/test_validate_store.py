"""Models from files: what is read right, and the sentence for everything that is not."""

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_runs import INERTIA, K_RR, step_run
from made_sequences import model_file

from automarine_cli.dofs import YAW
from automarine_cli.errors import ModelError, RunError
from automarine_cli.models.store import file_and_models, load_yaw_models
from automarine_cli.models.yaw_model import Term
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import Curve, ThrusterMap, drive_run_by_thrusters


@pytest.fixture
def data(tmp_path: Path) -> dict[str, Any]:
    return json.loads(model_file(tmp_path / "yaw_model.json").read_text())


def test_models_are_read(tmp_path: Path) -> None:
    stored = load_yaw_models(model_file(tmp_path / "yaw_model.json", switch_offset={"value": 0.2}))
    assert list(stored.models) == ["1", "2", "3"]
    assert (stored.preferred, stored.moment_unit, stored.switch_offset) == ("3", "nu", 0.2)
    assert (stored.source, stored.effects) == ("yaw_model.json", ())
    assert stored.models["3"].inertia == INERTIA and stored.models["3"].drag() == (0.0, K_RR)
    assert stored.models["2"].drag() == (0.03, K_RR - 0.03) and stored.models["1"].drag() == (0.9961, 0.0)
    assert pickle.loads(pickle.dumps(stored)) == stored  # it goes to other processes


def test_effects_come_with_every_model(data: dict[str, Any]) -> None:
    data["effects"] = [{"name": "bias-moment", "parameters": {"b": {"value": -0.05}}, "says": "It turns."}]
    stored = file_and_models(data, "yaw model")[1]
    assert stored.effects == ("bias-moment",)
    assert all(model.terms[-1] == Term("bias-moment", (-0.05,)) for model in stored.models.values())


def test_plain_numbers_and_a_unit_told_by_the_inertia(data: dict[str, Any]) -> None:
    del data["moment_unit"], data["effects"]
    data["models"] = {"3": {"I_r": {"value": 2, "unit": "N m s²"}, "k_rr": 3, "k_r": None}, "1": None}
    stored = file_and_models(data, "yaw model")[1]
    assert stored.moment_unit == "N m" and list(stored.models) == ["3"]
    assert stored.models["3"].theta.tolist() == [2.0, 3.0]


def put(place: str, value: object) -> Callable[[dict[str, Any]], None]:
    """A change of the value at a dotted place; a value of `put` takes the key away."""

    def change(data: dict[str, Any]) -> None:
        *path, last = place.split(".")
        for key in path:
            data = data[int(key)] if isinstance(data, list) else data[key]
        if value is put:
            del data[last]
        else:
            data[last] = value

    return change


REFUSED = {
    "models.3.k_rr.value: found \"abc\", expected a number": put("models.3.k_rr.value", "abc"),
    "models.3.k_rr.value: found true, expected a number": put("models.3.k_rr.value", True),
    "models.3.k_rr.value: found NaN, expected a finite number": put("models.3.k_rr.value", float("nan")),
    "models.1.I_r.value: found -Infinity, expected a finite number": put("models.1.I_r.value", -np.inf),
    "models.3.k_rr: key \"value\" is missing": put("models.3.k_rr.value", put),
    "models.2: key \"k_r\" is missing": put("models.2.k_r", put),
    "models.3: key \"I_r\" is missing": put("models.3.I_r", put),
    "models.3.I_r: found 0, expected an inertia above zero": put("models.3.I_r.value", 0),
    "models.3.k_rr: found -1, expected a drag of zero or more": put("models.3.k_rr.value", -1),
    "models.1.k_rr: model 1 has no such term; it has k_r": put("models.1.k_rr", 1.0),
    "models.3: found a list of 0, expected an object with named keys": put("models.3", []),
    "models.4: unknown model; known are 1, 2, 3": put("models.4", {}),
    "models: holds no model; expected one or more of 1, 2, 3": put("models", {}),
    "key \"models\" is missing": put("models", put),
    "preferred: found \"5\", expected one of the file's models (1, 2, 3)": put("preferred", "5"),
    "moment_unit: found \"kg\", expected \"nu\" or \"N m\"": put("moment_unit", "kg"),
    "switch_offset: found 0.7, expected a share of a sample interval between -0.5 and 0.5": put(
        "switch_offset", 0.7
    ),
    "effects: found an object, expected a list, each entry a table": put("effects", {}),
    "unknown key \"efects\"; did you mean \"effects\"?": lambda d: d.update(efects=d.pop("effects")),
    "effects[0]: key \"parameters\" is missing": put("effects", [{"name": "bias-moment"}]),
    "effects[0].parameters: key \"b\" is missing": put("effects", [{"name": "bias-moment", "parameters": {}}]),
    "effects[0].parameters: unknown key \"c\"; bias-moment takes b": put(
        "effects", [{"name": "bias-moment", "parameters": {"b": 0, "c": 0}}]
    ),
    "effects[0].parameters.k_r: found -1, expected 0 to inf": put(
        "effects", [{"name": "linear-drag", "parameters": {"k_r": -1}}]
    ),
    "schema: found \"automarine/yaw-model/9\", expected \"automarine/yaw-model/1\"; give the yaw_model.json that "
    "`automarine fit-yaw` writes": put("schema", "automarine/yaw-model/9"),
    "schema: found \"automarine/thruster-map/1\", expected \"automarine/yaw-model/1\"; this is a thruster map; "
    "give the yaw_model.json that `automarine fit-yaw` writes": put("schema", "automarine/thruster-map/1"),
}  # fmt: skip


@pytest.mark.parametrize("sentence", list(REFUSED))
def test_refusals_name_the_place(data: dict[str, Any], sentence: str) -> None:
    before = copy.deepcopy(data)
    REFUSED[sentence](data)
    assert data != before
    with pytest.raises(ModelError) as refusal:
        file_and_models(data, "m.json")
    then = "; give a file as `automarine fit-yaw` writes it" if sentence.endswith(" is missing") else ""
    assert str(refusal.value) == f"m.json: {sentence}{then}"


def test_an_unknown_effect_is_answered_with_the_library(data: dict[str, Any]) -> None:
    data["effects"] = [{"name": "magic", "parameters": {}}]
    with pytest.raises(ModelError, match=r'effects\[0\].name: found "magic", expected one of .*bias-moment'):
        file_and_models(data, "yaw model")


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"{", "not valid JSON"),
        (b"[1]", "expected an object with named keys"),
        (b"\xff\xfe{}", "expected UTF-8 text, found other bytes"),
        (b"[" * 100_000, "not valid JSON: nested too deep"),
    ],
)
def test_files_that_are_no_model(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "m.json"
    path.write_bytes(content)
    for load in (load_yaw_models, ThrusterMap.load):
        with pytest.raises(ModelError, match=f"^m.json: .*{why}"):
            load(path)
    with pytest.raises(ModelError, match=r"^gone\.json: cannot be read"):
        load_yaw_models(tmp_path / "gone.json")


def test_thruster_commands_become_a_moment(tmp_path: Path) -> None:
    thrusters = ThrusterMap("square", Curve(0.02), Curve(0.01))
    path = tmp_path / "thrusters.json"
    path.write_text(json.dumps(thrusters.to_json()))
    assert ThrusterMap.load(path) == thrusters
    n = np.linspace(-10, 10, 20)
    run = Run("a", "a.csv", np.arange(20.0), np.zeros(20), None, "", {"n_port": n, "n_stbd": -n}, dof=YAW)
    driven = drive_run_by_thrusters(run, thrusters, 0.4)
    expected = 0.4 * 0.03 * np.sign(n) * n**2  # one ahead, one astern
    assert driven.moment_unit == "N m" and run.moment is None
    np.testing.assert_allclose(driven.command, expected, rtol=1e-12)
    swapped = Run("a", "a.csv", run.time, run.position, None, "", {"n_port": -n, "n_stbd": n}, dof=YAW)
    np.testing.assert_array_equal(drive_run_by_thrusters(swapped, thrusters, 0.4).moment, -driven.command)


def test_runs_that_thrusters_cannot_drive() -> None:
    ahead = ThrusterMap("square", Curve(0.02), None)
    with pytest.raises(RunError, match="run 'run': no thruster command n_port or n_stbd in the log"):
        drive_run_by_thrusters(step_run(0.5), ahead, 0.4)
    n = np.ones(20)
    run = Run("a", "a.csv", np.arange(20.0), np.zeros(20), None, "", {"n_port": n, "n_stbd": -n}, dof=YAW)
    with pytest.raises(ModelError, match=r"^a\.csv, run 'a': the thruster map has no backward direction"):
        drive_run_by_thrusters(run, ahead, 0.4)
    with pytest.raises(ModelError, match=r"arm of a thruster is 0\.0; expected a positive length"):
        drive_run_by_thrusters(run, ahead, 0.0)
