"""PX4 logs: drop-outs told, older messages, stopped motors, the instant at which a sensor was read."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from made_outputs import told
from reader_contract import table_of
from vehicle_logs import Dive, dive
from vehicle_ulog import ulog

from automarine_cli.errors import LogError
from automarine_cli.logs import require_motion

pytest.importorskip("pyulog", reason="the extra automarine[px4] is not installed")


read = partial(table_of, "dive.ulg")


def test_drop_outs_and_damage_are_told_and_the_clock_is_that_of_the_sensor(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive(), dropouts=((3.01, 120), (9.01, 35)), delay=0.04))
    assert "drop-outs of the logger: 2, the longest 120 ms" in table.notes[0]
    np.testing.assert_allclose(table.columns["time"], dive().time, atol=1e-6)
    good = bytearray(ulog(dive()))
    at = good.find(b"D\x00\x00", 5000)
    good[at + 1 : at + 3] = b"\xee\xee"  # data of a topic that nobody announced
    notes = " ".join(read(tmp_path, bytes(good)).notes)
    assert "damaged data were skipped" in notes and "drop-out" not in notes


def test_stopped_motors_are_at_zero_and_absent_ones_no_columns(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive()))
    assert set(np.round(table.extras["actuator_motors.control[0]"][1:], 6)) == {0.0, 0.25}
    assert "actuator_motors.control[2]" not in table.names and "actuator_outputs.output[0]" not in table.names


def test_older_logs_have_outputs_and_any_field_can_be_named(tmp_path: Path) -> None:
    port, stbd = dive().commands_at(dive().time)
    table = read(tmp_path, ulog(dive(), without=("actuator_motors",)))
    np.testing.assert_allclose(table.extras["actuator_outputs.output[1]"], stbd)
    table = read(tmp_path, ulog(dive()), n="actuator_outputs.output[0]")
    np.testing.assert_allclose(table.columns["n"], port)


# A BlueROV2 Heavy in PX4's axes: places [m], directions of thrust; four vectored motors, then four vertical ones.
PLACES = [(x, y, 0) for ahead, abeam in ((0.14, 0.1), (0.12, 0.22)) for x in (ahead, -ahead) for y in (abeam, -abeam)]
AXES = [(1, -1, 0), (1, 1, 0), (1, 1, 0), (1, -1, 0), *[(0, 0, -1)] * 4]
RATIOS = [0.0] * 4 + [0.05, -0.05, -0.05, 0.05]


def px4(side: int = 1, **changed: float) -> tuple[Dive, np.ndarray]:
    """A dive whose motors PX4 drove by its published pseudo-inverse, and the wishes (yaw, ahead, abeam, down)."""
    first = dive()
    wished = np.random.default_rng(3).uniform(-0.15, 0.15, (6, len(first.command_time)))
    wished[[0, 2, 4]] *= side  # roll, yaw, abeam
    axes = np.array(AXES, dtype=float)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    torques = 6.5 * (np.cross(PLACES, axes) - np.array(RATIOS)[:, None] * axes)
    mix = np.linalg.pinv(np.hstack([torques, 6.5 * axes]).T)
    turning = max(np.linalg.norm(mix[:, i]) * np.sqrt(2 / np.count_nonzero(np.abs(mix[:, i]) > 1e-3)) for i in (0, 1))
    pushing = np.mean(np.linalg.norm(mix[:, 3:], axis=1))
    motors = mix / np.array([turning, turning, mix[:, 2].max(), pushing, pushing, pushing]) @ wished
    assert np.abs(motors).max() < 1
    parameters: dict[str, float] = {"CA_ROTOR_COUNT": 8}
    for i, (place, axis, ratio) in enumerate(zip(PLACES, AXES, RATIOS)):
        rotor = zip(("PX", "PY", "PZ", "AX", "AY", "AZ", "CT", "KM"), (*place, *axis, 6.5, ratio))
        parameters |= {f"CA_ROTOR{i}_{key}": value for key, value in rotor}
    return replace(first, outputs=motors, parameters=told(parameters | changed)), wished[2:]


@pytest.mark.parametrize("side", [1, -1])
def test_commands_are_worked_back_from_the_motors(tmp_path: Path, side: int) -> None:
    made, wished = px4(side)
    table = read(tmp_path, ulog(made))
    rows = np.searchsorted(made.command_time, made.time, side="right") - 1
    for name, values in zip(("tau", "X", "Y", "Z"), wished):
        back = table.columns["moment"] if name == "tau" else table.extras[name]
        np.testing.assert_allclose(back, values[rows], atol=1e-5, err_msg=name)  # floats of 32 bits
    assert table.origin.made_from == "actuator_motors by PX4's mixing of motors at their places (CA_ROTORn)"


def test_setpoints_stand_in_where_the_places_are_not_known(tmp_path: Path) -> None:
    made, wished = px4()
    table = read(tmp_path, ulog(replace(made, parameters=()), without=(), setpoints=wished))
    rows = np.searchsorted(made.command_time, made.time, side="right") - 1
    np.testing.assert_allclose(table.columns["moment"], wished[0, rows], atol=1e-6)
    np.testing.assert_allclose(table.extras["Z"], wished[3, rows], atol=1e-6)
    assert any("are vehicle_torque_setpoint and vehicle_thrust_setpoint, before limits" in note for note in table.notes)


def test_without_places_and_setpoints_the_remedy_is_told(tmp_path: Path) -> None:
    made, _ = px4()
    with pytest.raises(LogError, match="does not hold the parameter CA_ROTOR_COUNT; record again"):
        require_motion(read(tmp_path, ulog(replace(made, parameters=()))))
    with pytest.raises(LogError, match="no motors by their places here"):
        require_motion(read(tmp_path, ulog(px4(CA_ROTOR_COUNT=0.0)[0])))
