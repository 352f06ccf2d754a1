"""ArduPilot's two kinds of logs: what stands in for what, damage that is told, and the vehicle's own clock."""

import struct
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from reader_contract import table_of
from vehicle_logs import Dive, dataflash, dive, telemetry

pytest.importorskip("pymavlink", reason="the extra automarine[ardupilot] is not installed")


flash, link = partial(table_of, "dive.bin"), partial(table_of, "dive.tlog")


def later(first: Dive, seconds: float, command: float = 0.0) -> Dive:
    """The dive so much later, its commands later still; modes and arming are told as well."""
    return replace(
        first, time=first.time + seconds, command_time=first.command_time + seconds + command,
        voltage_time=first.voltage_time + seconds, modes=tuple((t + seconds, mode) for t, mode in first.modes),
        arming=tuple((t + seconds, armed) for t, armed in first.arming),
    )  # fmt: skip


def test_pymavlink_reads_the_same_headings(tmp_path: Path) -> None:
    from pymavlink.DFReader import DFReader_binary

    table = flash(tmp_path, dataflash(dive()))
    theirs = DFReader_binary(str(tmp_path / "dive.bin"))
    yaw = [theirs.recv_match(type="ATT").Yaw for _ in range(len(table))]
    theirs.close()
    np.testing.assert_allclose(np.rad2deg(table.columns["heading"]), yaw, atol=1e-9)


def test_the_gyro_stands_in_for_rate_and_events_for_arm(tmp_path: Path) -> None:
    table = flash(tmp_path, dataflash(dive(), without=("RATE", "ARM")))
    usual = flash(tmp_path, dataflash(dive()))
    np.testing.assert_allclose(table.columns["yaw_rate"], usual.columns["yaw_rate"], atol=1e-6)
    np.testing.assert_array_equal(table.labels["armed"].code, usual.labels["armed"].code)
    assert "IMU[1] (200)" in table.holds and "IMU[1].GyrZ" not in table.names
    assert "RCOU.C3" in table.names and "RCOU.C4" not in table.names


def test_damage_is_passed_over_and_told(tmp_path: Path) -> None:
    good = dataflash(dive())
    table = flash(tmp_path, good[:2000] + b"\x07" * 17 + good[2000:])
    assert any("skipped: not a message" in note for note in table.notes) and len(table) >= 199
    packets = bytearray(telemetry(dive()))
    at = packets.find(struct.pack("<I", 8000), 2000)  # the stamp of an attitude
    packets[at + 12] ^= 0x55
    table = link(tmp_path, bytes(packets))
    assert len(table) == 199 and "1 packet skipped: wrong checksum" in table.notes


def test_a_vehicle_that_starts_anew_in_one_log_goes_on_in_time(tmp_path: Path) -> None:
    table = link(tmp_path, telemetry(dive(), delay=0.3) + telemetry(dive(), delay=0.3, start=1.7e9 + 60))
    assert len(table) == 400
    np.testing.assert_allclose(np.diff(table.columns["time"][:200]), 0.1, atol=1e-5)  # not when they came
    np.testing.assert_allclose(table.columns["time"][200:] - table.columns["time"][:200], 60, atol=2e-3)


def test_a_counter_of_microseconds_that_is_full_begins_anew(tmp_path: Path) -> None:
    """SERVO_OUTPUT_RAW counts in 32 bits, for 71.6 minutes."""
    first = dive()
    table = link(tmp_path, telemetry(later(first, 2**32 / 1e6 - 10)))
    np.testing.assert_allclose(table.extras["SERVO_OUTPUT_RAW.servo1_raw"], first.commands_at(first.time)[0])


def test_what_was_sent_before_the_recording_paused_says_nothing_of_after(tmp_path: Path) -> None:
    """Two stretches of one log, 400 s apart; the mode, told when it changes, lasts."""
    first = dataflash(dive(), without=("EV", "IMU"))
    at = first.find(b"\xa3\x95\x10")  # what follows the FMT messages
    second = dataflash(replace(later(dive(), 400, command=0.2), modes=(), arming=()), without=("EV", "IMU"))
    table = flash(tmp_path, first + second[at:], n="RCOU.C1")
    assert len(table) == 400
    assert np.flatnonzero(np.isnan(table.columns["n"])).tolist() == [200, 201]
    assert not np.isnan(table.columns["voltage"]).any()
    assert table.labels["mode"].names[table.labels["mode"].code[200]] == "ALT_HOLD"
    assert "RCOU 0.13 s old in the median, 0.23 s at most" in table.notes[0]
