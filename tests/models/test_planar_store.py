"""planar_model.json: written and read back, what units its parameters have, and the sentence for what is wrong."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from made_planar import FULL, planar_model

from automarine_cli import effects
from automarine_cli.dofs import PLANAR
from automarine_cli.errors import ModelError
from automarine_cli.models.model import Term
from automarine_cli.models.store import PLANAR_MODEL, models_of, planar_json, read_model
from automarine_cli.pipeline.records import schema_in


@pytest.fixture
def data() -> dict[str, Any]:
    return json.loads(json.dumps(planar_json(FULL)))


def test_a_model_is_read_as_it_was_written(tmp_path: Path, data: dict[str, Any]) -> None:
    path = tmp_path / "planar_model.json"
    path.write_text(json.dumps(data))
    stored = read_model(path)
    assert stored.model == FULL and stored.source == "planar_model.json" and schema_in(path) == PLANAR_MODEL.schema
    assert (stored.model.fixed, stored.random) == ((), {}) and pickle.loads(pickle.dumps(stored)) == stored
    path.write_text('{"schema": "automarine/yaw-model/1"}')
    assert schema_in(path) != PLANAR_MODEL.schema and schema_in(tmp_path / "none.json") == ""
    assert {parameter.name: parameter.unit for parameter in FULL.parameters()} == {
        "surge.m_u": "kg", "sway.m_v": "kg", "yaw.I_r": "N m s²", "planar.m_vr": "kg m", "planar.m_ur": "kg m",
        "planar.m_uv": "kg", "surge.X_u": "N s/m", "surge.X_uu": "N s²/m²", "sway.Y_vv": "N s²/m²",
        "sway.Y_v": "N s/m", "yaw.k_r": "N m s", "yaw.k_rr": "N m s²", "yaw.constant_force": "N m",
        "yaw.input-delay.t_d": "s", "yaw.input-delay.law": "1",
        "yaw.input-delay.t_off": "s", "sway.Y_r": "N s", "yaw.N_v": "N s", "yaw.N_vv": "N s²/m", "sway.Y_rr": "N s²",
        "yaw.N_vr": "N s²", "sway.Y_rv": "N s²/m", "surge.X_v": "N s/m", "current.north": "m/s",
        "current.east": "m/s",
    }  # fmt: skip


@pytest.mark.parametrize("name", effects.names())
def test_an_effect_that_was_added_is_read_under_its_own_name(name: str) -> None:
    values = tuple(parameter.start for parameter in effects.get(name).parameters)
    for place, dof in enumerate(PLANAR.dofs):
        if effects.get(name).acts_in(dof):
            model = planar_model(20.0, 30.0, 2.0).with_term(Term(name, values, dof=place))
            assert models_of(json.loads(json.dumps(planar_json(model))), "").model == model


def test_estimates_orders_and_few_parameters_are_read(data: dict[str, Any]) -> None:
    estimate = {"value": 21.5, "stderr": 0.5, "ci95": [20.5, 22.5], "unit": "kg"}
    written = planar_json(FULL, {"surge.m_u": estimate})
    assert written["parameters"]["surge.m_u"] == estimate  # type: ignore[index]
    assert models_of(written, "").model.masses[0] == 21.5
    others = {name: value for name, value in data["parameters"].items() if "Y_v" not in name}
    turned = data | {"parameters": {"sway.Y_v": 5.0, "sway.Y_vv": 40.0} | others}
    assert [term.name for term in models_of(turned, "").model.terms if term.dof == 1 and not term.is_cross] == [
        "linear-drag",
        "quadratic-drag",
    ]
    least = {"surge.m_u": 20, "sway.m_v": 30.0, "yaw.I_r": {"value": 2}}
    stored = models_of({"schema": "automarine/planar-model/1", "parameters": least}, "")
    assert stored.model == planar_model(20.0, 30.0, 2.0)


def put(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    """A change of one parameter; a value of `put` takes it away."""

    def change(data: dict[str, Any]) -> None:
        data["parameters"][name] = value
        if value is put:
            del data["parameters"][name]

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(schema="automarine/yaw-model/1"), 'schema: found "automarine/yaw-model/1", expected'),
        (lambda d: d.update(force_unit="nu"), 'force_unit: found "nu", expected "N": coupled motions are in newtons'),
        (put("surge.X_uuX", 1.0), 'parameters: unknown key "surge.X_uuX"; did you mean "surge.X_uu"?'),
        (put("yaw.N_r", 1.0), 'parameters: unknown key "yaw.N_r"'),  # its own drag is k_r
        (put("sway.N_v", 1.0), "parameters.sway.N_v: N_v is no derivative of Y, the force of sway"),
        (put("surge.m_u", -3.0), "parameters.surge.m_u: found -3, expected an inertia above zero"),
        (put("sway.m_v", put), 'parameters: key "sway.m_v" is missing'),
        (put("planar.m_vr", 90.0), "parameters: found an inertia of m_u = 20, m_v = 32, I_r = 2.6, m_vr = 90"),
        (put("current.east", put), 'key "current.east" is missing; a current has current.north and current.east'),
        (put("yaw.input-delay.t_x", 0.1), 'unknown key "yaw.input-delay.t_x"; did you mean "yaw.input-delay.t_d"?'),
    ],
)  # fmt: skip
def test_refusals(data: dict[str, Any], change: Callable[[dict[str, Any]], Any], says: str) -> None:
    change(data)
    with pytest.raises(ModelError) as refusal:
        PLANAR_MODEL.of(data, "planar_model.json")
        models_of(data, "planar_model.json")
    assert str(refusal.value).startswith("planar_model.json: ") and says in str(refusal.value)


def test_linear_drag_drives_only_beside_a_quadratic_one(data: dict[str, Any]) -> None:
    put("surge.X_u", -1.0)(data)
    assert models_of(data, "").model.terms[0] == Term("linear-drag", (-1.0,), base=True)
    put("surge.X_uu", put)(data)
    with pytest.raises(ModelError, match=r"surge\.X_u: found -1, expected a drag of zero or more"):
        models_of(data, "")
