"""`ThrusterMap`: signs, moment, plain data and its refusals."""

import copy
import json

import numpy as np
import pytest

from automarine_cli.dofs import YAW
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.planning.candidates import drive_of
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import FORMS, Curve, ThrusterMap, drive_run_by_thrusters

MAP = ThrusterMap("square", Curve(2.6165e-4), Curve(0.6640e-4))


def test_force_keeps_shape_and_sign() -> None:
    assert MAP.force(np.array([[100.0, -100.0], [0.0, 150.0]])) == pytest.approx(
        np.array([[2.6165, -0.6640], [0.0, 5.887125]])
    )


def test_port_ahead_turns_clockwise() -> None:
    """Equal and opposite commands: (a_f + a_b) l n^2; the same both ways with the sign turned."""
    extras = {"n_port": np.array([100.0, -100.0, 80.0]), "n_stbd": np.array([-100.0, 100.0, 80.0])}
    run = Run("a", "a.csv", np.arange(3.0), np.zeros(3), None, "", extras, dof=YAW)
    assert drive_run_by_thrusters(run, MAP, 0.5).command == pytest.approx(0.5 * np.array([3.2805, -3.2805, 0.0]))


def test_dead_band_and_saturation() -> None:
    curve = Curve(10.0, 1.5, 0.1, 0.6)
    assert curve.thrust(np.array([0.05, 0.1, 0.6, 1.0])) == pytest.approx([0.0, 0.0, 10 * 0.5**1.5, 10 * 0.5**1.5])
    assert len(FORMS) == 8 and [form.parameters for form in FORMS.values()] == [1, 2, 2, 3, 2, 3, 3, 4]


@pytest.mark.parametrize(
    "thruster_map", [MAP, ThrusterMap("dead-band-power-saturation", Curve(30.0, 1.4, 0.08, 0.7), None, "rev/s")]
)
def test_json_there_and_back(thruster_map: ThrusterMap) -> None:
    text = json.dumps(thruster_map.to_json(), allow_nan=False)
    assert ThrusterMap.from_json(json.loads(text)) == thruster_map


@pytest.mark.parametrize("ends", [(-400.0, 400.0), (-300.0, 400.0), (0.0, 150.0)])
def test_a_map_says_from_where_to_where_it_was_measured(ends: tuple[float, float]) -> None:
    known = ThrusterMap("square", Curve(2.0), Curve(1.0), "us", ends)
    data = json.loads(json.dumps(known.to_json()))
    assert data["n_range"] == list(ends) and ThrusterMap.from_json(data) == known
    seen = known.compared(("n_port", "n_stbd"), [np.array([0.0, 10.0]), np.array([-20.0, 0.0])])
    assert seen is not None
    assert (seen.low, seen.high, seen.of_map, seen.unit) == (-20.0, 10.0, ends, "us")
    del data["n_range"]  # a map of old
    assert ThrusterMap.from_json(data).compared(("n_port",), [np.ones(3)]) is None
    for wrong, words in (([1.0], "expected a list of 2 values"), ([2.0, 1.0], "expected the lower one first")):
        with pytest.raises(ModelError, match=f"n_range: found .*, {words}"):
            ThrusterMap.from_json({**data, "n_range": wrong})


def test_a_plan_goes_as_far_as_the_map_was_measured() -> None:
    known = ThrusterMap("square", Curve(2.0), Curve(1.0), "us", (-300.0, 400.0))
    assert drive_of(known, 0.2, None, False, 1.0).most == 300.0
    assert drive_of(known, 0.2, 350.0, False, 1.0).most == 350.0
    with pytest.raises(SettingError, match="measured from -300 to 400 us; give it in the map's own unit"):
        drive_of(known, 0.2, 1900.0, False, 1.0)


BREAKAGES = {
    r"schema: found \"automarine/yaw-model/1\", expected \"automarine/thruster-map/1\"": lambda d: d.update(
        schema="automarine/yaw-model/1"
    ),
    r"unknown key \"thrust\"": lambda d: d.update(thrust=1),
    r"parameters: unknown key \"sideways\"": lambda d: d["parameters"].update(sideways={}),
    r"parameters\.forward: unknown key \"b\"": lambda d: d["parameters"]["forward"].update(b=1.0),
    r"parameters\.forward\.a: found NaN, expected a finite number": lambda d: d["parameters"]["forward"].update(
        a=float("nan")
    ),
    r"parameters\.backward\.a: found -1, expected more than 0": lambda d: d["parameters"]["backward"].update(
        a={"value": -1.0}
    ),
    r"parameters\.backward\.a: found nothing, expected a number": lambda d: d["parameters"]["backward"].pop("a"),
    r"parameters\.forward\.n_0: found -1, expected a dead band of zero or more": lambda d: d["parameters"][
        "forward"
    ].update(n_0=-1.0),
    r"parameters\.forward\.n_sat: found 1, expected more than the dead band, 2": lambda d: d["parameters"][
        "forward"
    ].update(n_0=2.0, n_sat=1.0),
    r"parameters\.forward\.p: found \"two\", expected a number": lambda d: d["parameters"]["forward"].update(p="two"),
    r"form: found \"cubic\", expected one of square": lambda d: d.update(form="cubic"),
    r"key \"parameters\" is missing": lambda d: d.pop("parameters"),
    r"neither a forward nor a backward": lambda d: d.update(parameters={}),
    r"n_unit: found 3, expected a text in quotes": lambda d: d.update(n_unit=3),
}


@pytest.mark.parametrize("words", BREAKAGES)
def test_a_broken_map_is_refused_with_the_key(words: str) -> None:
    data = copy.deepcopy(MAP.to_json())
    BREAKAGES[words](data)
    with pytest.raises(ModelError, match=words):
        ThrusterMap.from_json(data, "map.json")


def test_not_an_object_missing_direction_and_bad_input() -> None:
    with pytest.raises(ModelError, match="expected an object"):
        ThrusterMap.from_json([1, 2])
    one_way = ThrusterMap("square", Curve(1.0), None)
    assert one_way.force(2.0) == pytest.approx(4.0)
    with pytest.raises(ModelError, match="no backward direction"):
        one_way.force(-1.0)
    with pytest.raises(ModelError, match="finite"):
        MAP.force(np.nan)
