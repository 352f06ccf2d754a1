"""Plans for a rudder: zigzags that go over where they should, within the limits, and what they would tell."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_rudder import SPEED, Boat
from scipy import integrate

import automarine_cli as am
from automarine_cli.errors import SettingError
from automarine_cli.planning.campaign import Plan

TRUE = {"effect": 0.8, "damping": 0.9, "quadratic": 0.4}


def planned(folder: Path, side: int = 1, limits: str = "pool = { runs = 8 }", **change: Any) -> Plan:
    folder.mkdir(exist_ok=True)
    (folder / "model.json").write_text(
        json.dumps(Boat(**TRUE, side=side).model() | {"heading_noise_deg": 0.5} | change)
    )
    (folder / "limits.toml").write_text(limits)
    result: Plan = am.plan(folder / "model.json", limits=folder / "limits.toml", out=folder / "out")
    return result


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return planned(tmp_path_factory.mktemp("plan"))


def test_a_zigzag_goes_over_where_the_heading_is_off_by_its_angle(plan: Plan) -> None:
    """By scipy's integrator, of the model that was planned with."""
    zigzags = [run for run in plan.candidates if run.kind == "zigzag"]
    assert zigzags and {run.kind for run in plan.candidates} <= {"zigzag", "turning-circle"}
    model = plan.fitting.model
    inertia, quadratic, _, _, coupling = model.theta
    for run in zigzags:
        speed, state = run.speed or SPEED, np.zeros(2)
        size = abs(run.commands[0][0])

        def slope(_: float, x: Any, rudder: float, speed: float) -> list[float]:
            damping = coupling * speed * x[1] - quadratic * x[1] * abs(x[1])
            return [x[1], (rudder * (speed / SPEED) ** 2 + damping) / inertia]

        for rudder, seconds in run.commands:
            assert abs(rudder) == pytest.approx(size)
            solved = integrate.solve_ivp(slope, (0.0, seconds), state, args=(rudder, speed), rtol=1e-9, atol=1e-9)
            state = solved.y[:, -1]
            # rows and the log's own convention hold an instant to two samples
            assert math.copysign(1.0, rudder) * state[0] == pytest.approx(size, abs=0.2 * abs(state[1]) + 0.01)


def test_the_command_files_hold_the_angle_as_it_is_logged(tmp_path: Path) -> None:
    rows = {}
    for side in (1, -1):
        plan = planned(tmp_path / str(side), side)
        files = sorted((tmp_path / str(side) / "out" / "commands").iterdir())
        rows[side] = [list(csv.reader(file.read_text().splitlines())) for file in files]
        assert len(files) == len(plan.slots) == 8 and not (tmp_path / str(side) / "out" / "plan.toml").exists()
    for starboard, port in zip(rows[1], rows[-1]):
        assert starboard[0] == port[0] == ["time_s", "rudder_deg"]
        angles = np.array([float(row[1]) for row in starboard[1:]])
        np.testing.assert_allclose([float(row[1]) for row in port[1:]], -angles)
        assert 10.0 <= np.abs(angles).max() <= np.rad2deg(0.35) + 1e-3


def test_the_limits_bound_the_rudder(tmp_path: Path) -> None:
    plan = planned(tmp_path, limits="moments = { largest = 12.0 }\npool = { runs = 6 }")
    angles = {round(float(np.rad2deg(abs(angle))), 6) for run in plan.candidates for angle, _ in run.commands}
    assert angles <= {10.0, 12.0}
    with pytest.raises(SettingError, match=r"largest angle in degrees, up to 90"):
        planned(tmp_path / "far", limits="moments = { largest = 120.0 }")


def test_gain_and_time_are_as_sure_as_what_they_are_made_of(plan: Plan, tmp_path: Path) -> None:
    """Beside quadratic drag the damping about rest is all coupling: K is as sure as that, and is its inverse."""
    inertia, *_, coupling = plan.fitting.model.theta
    gain, time, c = (plan.alone[name] for name in ("K", "T", "cross-coupling c"))
    assert gain.value == pytest.approx(-1.0 / (coupling * SPEED)) and time.value == pytest.approx(inertia * gain.value)
    assert plan.errors["K"][-1] == pytest.approx(plan.errors["cross-coupling c"][-1], rel=1e-6)
    assert np.all(np.diff(plan.errors["K"]) <= 1e-12) and c.stderr > 0
    more = planned(tmp_path / "more", limits="pool = { runs = 20 }")
    assert more.alone["K"].stderr < gain.stderr and more.alone["T"].stderr < time.stderr


def test_several_speeds_are_asked_for_only_where_the_model_depends_on_them(plan: Plan, tmp_path: Path) -> None:
    assert len({run.speed for run in plan.candidates}) > 1
    damping = {"value": 0.9, "stderr": 0.03, "ci95": [0.84, 0.96], "unit": "rad s"}
    models = {"1": {"I_r": {"value": 0.9, "stderr": 0.03, "ci95": [0.84, 0.96], "unit": "rad s²"}, "k_r": damping}}
    nomoto = {"positive_rudder_turns_to": "port"}
    plain = planned(tmp_path / "plain", preferred="1", models=models, effects=[], nomoto=nomoto)
    assert {run.speed for run in plain.candidates} == {None}
    assert plain.alone["K"].value == pytest.approx(1.0 / 0.9) and plain.alone["T"].value == pytest.approx(1.0)
