"""Models from files: what is read right, and the sentence for everything that is not."""

import copy
import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from made_runs import INERTIA, K_RR
from made_sequences import model_file

from automarine_cli.errors import ModelError
from automarine_cli.estimate import Estimate
from automarine_cli.models.model import Term
from automarine_cli.models.store import file_and_models, read_model


@pytest.fixture
def data(tmp_path: Path) -> dict[str, Any]:
    return json.loads(model_file(tmp_path / "yaw_model.json").read_text())


def test_models_are_read(tmp_path: Path, data: dict[str, Any]) -> None:
    stored = read_model(model_file(tmp_path / "yaw_model.json", command_delay_s={"value": 0.2}))
    assert list(stored.models) == ["1", "2", "3"]
    assert (stored.preferred, stored.model.moment_unit, stored.command_delay) == ("3", "nu", 0.2)
    assert (stored.source, stored.effects) == ("yaw_model.json", ())
    assert stored.models["3"].inertia == INERTIA
    assert [model.drag() for model in stored.models.values()] == [(0.9961, 0.0), (0.03, K_RR - 0.03), (0.0, K_RR)]
    assert pickle.loads(pickle.dumps(stored)) == stored  # it goes to other processes
    data["effects"] = [{"name": "bias-moment", "parameters": {"b": {"value": -0.05}}, "says": "It turns."}]
    stored = file_and_models(data, "yaw model")[1]
    assert stored.effects == ("bias-moment",)
    assert all(model.terms[-1] == Term("bias-moment", (-0.05,)) for model in stored.models.values())
    del data["moment_unit"], data["effects"]
    data["models"] = {"3": {"I_r": {"value": 2, "unit": "N m s²"}, "k_rr": 3, "k_r": None}, "1": None}
    stored = file_and_models(data, "yaw model")[1]
    assert stored.model.moment_unit == "N m" and list(stored.models) == ["3"]
    assert stored.models["3"].theta.tolist() == [2.0, 3.0]


def test_a_number_that_runs_do_not_determine_is_missing_with_its_reason(data: dict[str, Any]) -> None:
    data["models"]["3"]["inertial_turn_angle_rad"] = Estimate(0.8, math.inf, (0.0, math.inf), "rad").to_json()
    ratio = file_and_models(data, "yaw model")[0].chosen.ratio
    assert ratio is not None and ratio.value == 0.8
    assert ratio.estimate is None and ratio.at_bound == "the runs do not determine it"


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
    "models.3.k_rr: key \"value\" is missing": put("models.3.k_rr.value", put),
    "models.3.I_r: found 0, expected an inertia above zero": put("models.3.I_r.value", 0),
    "models.3.k_rr: found -1, expected a drag of zero or more": put("models.3.k_rr.value", -1),
    "models.1.k_rr: model 1 has no such term; it has k_r": put("models.1.k_rr", 1.0),
    "models.4: unknown model; known are 1, 2, 3": put("models.4", {}),
    "models: holds no model; expected one or more of 1, 2, 3": put("models", {}),
    "preferred: found \"5\", expected one of the models 1, 2, 3": put("preferred", "5"),
    "moment_unit: found \"kg\", expected \"nu\" or \"N m\"": put("moment_unit", "kg"),
    "command_delay_s: found 4 s, expected at most 3 s either way": put("command_delay_s", 4.0),
    "effects[0].parameters: key \"b\" is missing": put("effects", [{"name": "bias-moment", "parameters": {}}]),
    "effects[0].parameters: unknown key \"c\"; bias-moment takes b": put(
        "effects", [{"name": "bias-moment", "parameters": {"b": 0, "c": 0}}]
    ),
    "effects[0].name: found \"magic\", expected one of": put("effects", [{"name": "magic", "parameters": {}}]),
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
    assert str(refusal.value).startswith(f"m.json: {sentence}")
    assert sentence.endswith(" is missing") == ("give a file as `automarine fit-yaw`" in str(refusal.value))
