"""Commands worked back from what a vehicle's software sent to its motors: every frame, both ways, and refusals."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_outputs import WISHED, mixed, sub_dive, sub_parameters, told, wishes
from reader_contract import log
from repository import DATA
from tolerances import assert_close
from vehicle_logs import Dive, dataflash, dive, telemetry

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, read_log, require_motion
from automarine_cli.logs.mixing import FRAME_MIXING, part_of, worked_back

pytest.importorskip("pymavlink", reason="the extra automarine[ardupilot] is not installed")
REAL = DATA / "ardusub"
PULSE = 1 / 400  # of a wish: pulses are whole microseconds
WRITERS: dict[str, Callable[[Dive], bytes]] = {"dive.bin": dataflash, "dive.tlog": telemetry}
DIVE = dive()
COUNT = len(DIVE.command_time)
ROWS = np.searchsorted(DIVE.command_time, DIVE.time, side="right") - 1
"""The command that each row of the table holds."""


def read(folder: Path, made: Dive, name: str = "dive.bin", columns: ColumnMap | None = None) -> LogTable:
    return read_log(log(folder, WRITERS[name](made), name), columns, dof=YAW)


def commands(table: LogTable) -> dict[str, np.ndarray]:
    return {"tau": table.columns["moment"], **{name: table.extras[name] for name in WISHED[1:] if name in table.extras}}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("frame", FRAME_MIXING)
def test_what_was_wished_comes_back(tmp_path: Path, frame: int, name: str) -> None:
    wished = wishes(COUNT, frame)
    table = read(tmp_path, sub_dive(wished, frame), name)
    assert set(commands(table)) == {"tau", "X", "Z"} | ({"Y"} if frame not in (4, 5) else set())
    for key, values in commands(table).items():
        np.testing.assert_allclose(values, wished[key][ROWS], atol=2.5 * PULSE, err_msg=key)
    assert table.moment_unit == "nu"
    assert any(f"(FRAME_CONFIG {frame})" in note and "worked back from" in note for note in table.notes)


def test_the_frames_push_as_their_drawings_show() -> None:
    """The vectored frame: to starboard by motors 1 and 4 ahead of the others, ahead by the rear ones (ArduSub)."""
    wished = {"tau": np.array([0.25, 0, 0]), "X": np.array([0, 0.25, 0]), "Z": np.array([0, 0, 0.25])}
    pulses = mixed(wished, 1, (1,) * 8)
    assert pulses[:6].T.tolist() == [
        [1600, 1400, 1400, 1600, 1500, 1500], [1400, 1400, 1600, 1600, 1500, 1500], [1500] * 4 + [1600] * 2,
    ]  # fmt: skip
    parameters = [(0.0, name, value) for name, value in sub_parameters(1, (1,) * 8).items()]
    back = worked_back("RCOU", np.arange(3.0), {n + 1: pulses[n] for n in range(6)}, parameters, part_of)
    for key, values in wished.items():
        assert_close(back.columns[key], values, "same arithmetic")


def test_motors_at_their_end_count_as_they_were_sent(tmp_path: Path) -> None:
    nine, none = np.full(COUNT, 0.9), np.zeros(COUNT)
    table = read(tmp_path, sub_dive({"tau": nine, "X": nine, "Y": none, "Z": none}))
    np.testing.assert_allclose(table.columns["moment"], 0.5, atol=PULSE)  # two motors at the end, two at rest
    np.testing.assert_allclose(table.extras["X"], 0.5, atol=PULSE)


def test_a_parameter_that_changes_is_followed(tmp_path: Path) -> None:
    made = sub_dive(wishes(COUNT, 5))
    assert made.outputs is not None
    turned = made.outputs.copy()
    turned[0, made.command_time >= 10] = 3000 - turned[0, made.command_time >= 10]
    changed = replace(made, outputs=turned, parameters=(*made.parameters, (9.99, "MOT_1_DIRECTION", 1.0)))
    table, plain = read(tmp_path, changed), read(tmp_path, made)
    np.testing.assert_allclose(table.columns["moment"], plain.columns["moment"], atol=PULSE)
    assert "(MOT_1_DIRECTION from -1 to 1 at 9.1 s)" in " ".join(table.notes)


LIMITS = {"MIN": 1000.0, "TRIM": 1550.0, "MAX": 2000.0, "REVERSED": 0.0}


def boat(functions: dict[int, int], pulses: dict[int, object], **changed: float) -> Dive:
    """A boat or rover with these functions of its outputs, and their pulses [us]."""
    parameters = {f"SERVO{n}_FUNCTION": float(functions.get(n, 0)) for n in range(1, 9)}
    parameters |= {f"SERVO{n}_{key}": value for n in functions for key, value in LIMITS.items()} | changed
    outputs = np.zeros((8, COUNT))
    for n, values in pulses.items():
        outputs[n - 1] = values
    return replace(DIVE, outputs=outputs, parameters=told(parameters))


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("side", [1, -1])
def test_skid_steering_is_half_the_difference_and_half_the_sum(tmp_path: Path, side: int, name: str) -> None:
    draw = np.random.default_rng(1)
    steer, throttle = side * draw.uniform(0.0, 0.5, COUNT), draw.uniform(-0.5, 0.5, COUNT)

    def pulse(value: np.ndarray) -> np.ndarray:
        return np.round(1550 + value * np.where(value > 0, 450, 550))

    made = boat({3: 73, 1: 74}, {3: pulse(throttle + steer), 1: pulse(-(throttle - steer))}, SERVO1_REVERSED=1.0)
    table = read(tmp_path, made, name)
    assert set(commands(table)) == {"tau", "X"}
    np.testing.assert_allclose(table.columns["moment"], steer[ROWS], atol=PULSE)
    np.testing.assert_allclose(table.extras["X"], throttle[ROWS], atol=PULSE)
    assert any("skid steering (SERVOn_FUNCTION 73 and 74)" in note for note in table.notes)


def test_steering_and_throttle_of_a_boat(tmp_path: Path) -> None:
    table = read(tmp_path, boat({1: 26, 3: 70}, {1: 1775.0, 3: 1275.0}))
    np.testing.assert_allclose(table.columns["moment"], 0.5)
    np.testing.assert_allclose(table.extras["X"], -0.5)


def lacking(*names: str) -> Dive:
    """A dive of which the log does not hold these parameters."""
    made = sub_dive(wishes(COUNT, 1))
    return replace(made, parameters=tuple(row for row in made.parameters if row[1] not in names))


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    ("made", "parts"),
    [
        (replace(lacking(), parameters=()), ("FRAME_CONFIG, SERVOn_FUNCTION, MOT_n_DIRECTION; record again",)),
        (lacking("MOT_3_DIRECTION"), ("does not hold the parameter MOT_3_DIRECTION; record again",)),
        (lacking("FRAME_CONFIG"), ("does not hold the parameter FRAME_CONFIG; record again",)),
        (sub_dive(wishes(COUNT, 1), FRAME_CONFIG=7.0), ("FRAME_CONFIG is 7", "in a column map")),
        (sub_dive(wishes(COUNT, 1), SERVO9_FUNCTION=38.0), ("holds no pulses of output 9, which drives",)),
        (boat({1: 26, 3: 70}, {1: 1775.0, 3: 1275.0}, SERVO3_TRIM=1000.0), ("not between SERVOn_MIN and SERVOn_MAX",)),
        (boat({1: 1, 3: 4}, {1: 1775.0}), ("is a motor of ArduSub",)),
    ],
)
def test_what_cannot_be_worked_back_is_refused(tmp_path: Path, name: str, made: Dive, parts: tuple[str, ...]) -> None:
    with pytest.raises(LogError) as caught:
        require_motion(read(tmp_path, made, name))
    assert str(caught.value).startswith(f"{name}: no yaw moment; ")
    assert [part for part in (*parts, "--columns FILE.toml") if part not in str(caught.value)] == []


@pytest.mark.real_data(REAL)
@pytest.mark.parametrize(("name", "frame"), [("small.tlog", 2), ("small.BIN", 1)])
def test_a_real_dive_needs_no_column_map(name: str, frame: int) -> None:
    table = read_log(LogFile(REAL / name, name, True), dof=YAW)
    require_motion(table)
    assert set(commands(table)) == set(WISHED) and f"(FRAME_CONFIG {frame})" in table.origin.made_from
    assert np.nanmax(np.abs(table.columns["moment"])) < 0.2
