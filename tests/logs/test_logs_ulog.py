"""PX4 logs: drop-outs told, older messages, stopped motors, the instant at which a sensor was read."""

from pathlib import Path

import numpy as np
import pytest
from reader_contract import log
from vehicle_logs import dive
from vehicle_ulog import ulog

from automarine_cli.dofs import YAW
from automarine_cli.logs import ColumnMap, ColumnRule, LogTable, read_log

pytest.importorskip("pyulog", reason="the extra automarine[px4] is not installed")


def read(folder: Path, content: bytes, **columns: str) -> LogTable:
    """A PX4 log of these bytes, read with columns by these names."""
    rules = {name: ColumnRule(source) for name, source in columns.items()}
    return read_log(log(folder, content, "dive.ulg"), ColumnMap(rules), dof=YAW)


def test_pyulog_reads_the_same_file(tmp_path: Path) -> None:
    from pyulog import ULog

    read(tmp_path, ulog(dive()))
    theirs = ULog(str(tmp_path / "dive.ulg"))
    assert not theirs.file_corruption
    assert len(theirs.get_dataset("vehicle_attitude").data["timestamp"]) == 200


def test_drop_outs_are_told(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive(), dropouts=((3.01, 120), (9.01, 35))))
    assert table.notes[0] == "2 drop-outs of the logger of up to 120 ms, 155 ms in all"
    assert not any("drop-out" in note for note in read(tmp_path, ulog(dive())).notes)


def test_the_clock_is_that_of_the_sensor(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive(), delay=0.04))
    np.testing.assert_allclose(table.columns["time"], dive().time, atol=1e-6)


def test_stopped_motors_are_at_zero_and_absent_ones_no_columns(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive()))
    assert set(np.round(table.extras["actuator_motors.control[0]"][1:], 6)) == {0.0, 0.25}
    assert "actuator_motors.control[2]" not in table.names and "actuator_outputs.output[0]" not in table.names


def test_older_logs_have_outputs(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive(), without=("actuator_motors",)))
    np.testing.assert_allclose(table.extras["actuator_outputs.output[1]"], dive().commands_at(dive().time)[1])


def test_any_field_can_be_named(tmp_path: Path) -> None:
    table = read(tmp_path, ulog(dive()), n="actuator_outputs.output[0]")
    np.testing.assert_allclose(table.columns["n"], dive().commands_at(dive().time)[0])


def test_damaged_data_are_told(tmp_path: Path) -> None:
    good = bytearray(ulog(dive()))
    at = good.find(b"D\x00\x00", 5000)
    good[at + 1 : at + 3] = b"\xee\xee"  # data of a topic that nobody announced
    assert "damaged data were skipped" in read(tmp_path, bytes(good)).notes
