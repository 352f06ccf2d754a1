"""`ThrusterMap`: signs, moment, plain data and its refusals."""

import copy
import json
from typing import Any

import numpy as np
import pytest

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.logs import ColumnMap, ColumnRule
from automarine_cli.planning.candidates import drive_of
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.curves import FORMS, PowerCurve
from automarine_cli.thrusters.map import ThrusterMap, by_two_thrusters, drive_run_by_thrusters, moment_maker

MAP = ThrusterMap("square", PowerCurve(2.6165e-4), PowerCurve(0.6640e-4))
RANGE = ThrusterMap("square", PowerCurve(2.0), PowerCurve(1.0), "us", (-300.0, 400.0))


def test_force_and_moment_keep_shape_and_sign() -> None:
    """Port ahead turns clockwise: (a_f + a_b) l n^2 of equal and opposite commands, and the same with turned sign."""
    assert MAP.force(np.array([[100.0, -100.0], [0.0, 150.0]])) == pytest.approx(
        np.array([[2.6165, -0.6640], [0.0, 5.887125]])
    )
    extras = {"n_port": np.array([100.0, -100.0, 80.0]), "n_stbd": np.array([-100.0, 100.0, 80.0])}
    run = Run("a", "a.csv", np.arange(3.0), np.zeros(3), None, "", extras, dof=YAW)
    assert drive_run_by_thrusters(run, MAP, 0.5).command == pytest.approx(0.5 * np.array([3.2805, -3.2805, 0.0]))
    planar = by_two_thrusters(run, MAP, 0.5)
    assert planar.command == pytest.approx(0.5 * np.array([3.2805, -3.2805, 0.0]))
    ahead, abeam = (planar.extras[dof.command] for dof in (SURGE, SWAY))
    assert ahead == pytest.approx([1.9525, 1.9525, 3.34912]) and not np.any(abeam)
    curve = PowerCurve(10.0, 1.5, 0.1, 0.6)
    assert curve.thrust(np.array([0.05, 0.1, 0.6, 1.0])) == pytest.approx([0.0, 0.0, 10 * 0.5**1.5, 10 * 0.5**1.5])
    assert [len(form.effects) for form in FORMS.values()] == [0, 1, 1, 2, 1, 2, 2, 3, 0]


@pytest.mark.parametrize(
    "thruster_map",
    [MAP, RANGE, ThrusterMap("dead-band-power-saturation", PowerCurve(30.0, 1.4, 0.08, 0.7), None, "rev/s")],
)
def test_json_there_and_back(thruster_map: ThrusterMap) -> None:
    text = json.dumps(thruster_map.to_json(), allow_nan=False)
    assert ThrusterMap.from_json(json.loads(text)) == thruster_map


def test_a_map_says_from_where_to_where_it_was_measured() -> None:
    used = RANGE.compared(("n_port", "n_stbd"), [np.array([0.0, 10.0]), np.array([-20.0, 0.0])])
    assert used is not None and (used.low, used.high, used.of_map, used.unit) == (-20.0, 10.0, (-300.0, 400.0), "us")
    data = RANGE.to_json()
    for wrong, words in (([1.0], "expected a list of 2 values"), ([2.0, 1.0], "expected the lower one first")):
        with pytest.raises(ModelError, match=f"n_range: found .*, {words}"):
            ThrusterMap.from_json({**data, "n_range": wrong})
    del data["n_range"]  # a map of old
    assert ThrusterMap.from_json(data).compared(("n_port",), [np.ones(3)]) is None
    assert [drive_of(RANGE, 0.2, most, False).most for most in (None, 350.0)] == [300.0, 350.0]
    with pytest.raises(SettingError, match="measured from -300 to 400 us; give it in the map's own unit"):
        drive_of(RANGE, 0.2, 1900.0, False)


@pytest.mark.parametrize(
    ("place", "wrong", "words"),
    [
        ("schema", "automarine/yaw-model/1", 'schema: found "automarine/yaw-model/1", expected "automarine/thruster-m'),
        ("parameters sideways", {}, 'parameters: unknown key "sideways"'),
        ("parameters forward a", float("nan"), r"parameters\.forward\.a: found NaN, expected a finite number"),
        ("parameters backward a", {"value": -1.0}, r"parameters\.backward\.a: found -1, expected more than 0"),
        ("parameters backward a", None, r"parameters\.backward\.a: found nothing, expected a number"),
        ("parameters forward n_0", -1.0, r"forward\.n_0: found -1, expected a dead band of zero or more"),
        ("parameters forward", {"a": 1.0, "p": 2.0, "n_0": 2.0, "n_sat": 1.0},
         r"forward\.n_sat: found 1, expected more than the dead band, 2"),
        ("form", "cubic", 'form: found "cubic", expected one of square'),
        ("parameters", {}, "neither a forward nor a backward"),
    ],
)  # fmt: skip
def test_a_broken_map_is_refused_with_the_key(place: str, wrong: object, words: str) -> None:
    """None: the key is taken away."""
    data: Any = copy.deepcopy(MAP.to_json())
    *folders, key = place.split()
    inside = data
    for folder in folders:
        inside = inside[folder]
    inside[key] = wrong
    if wrong is None:
        del inside[key]
    with pytest.raises(ModelError, match=words):
        ThrusterMap.from_json(data, "map.json")


def test_a_missing_direction_and_a_signal_that_is_not_finite_are_refused() -> None:
    one_way = ThrusterMap("square", PowerCurve(1.0), None)
    assert one_way.force(2.0) == pytest.approx(4.0)
    with pytest.raises(ModelError, match="no backward direction"):
        one_way.force(-1.0)
    with pytest.raises(ModelError, match="finite"):
        MAP.force(np.nan)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("given", ["option", "column map"])
def test_thrusters_logged_in_newtons_need_no_map(way: float, given: str) -> None:
    columns = {name: ColumnRule(name, unit="N") for name in YAW.thrusters}
    arm, defaults = (0.2, {}) if given == "option" else (None, {"arm_m": 0.2})
    forces = {"n_port": np.full(5, 4.0 * way), "n_stbd": np.full(5, -2.0 * way)}
    run = Run("a", "a.csv", np.arange(5.0), np.zeros(5), None, "", forces, dof=YAW)
    make = moment_maker(None, arm, ColumnMap(columns, defaults), YAW)
    assert make is not None
    assert make(run).command == pytest.approx(np.full(5, 0.2 * 6.0 * way)) and make(run).moment_unit == "N m"
    assert moment_maker(None, None, ColumnMap(columns), YAW) is None
    assert moment_maker(None, None, ColumnMap({**columns, "n_port": ColumnRule("n_port", unit="%")}), YAW) is None
