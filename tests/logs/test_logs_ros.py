"""ROS bags: signs turned and told, stamps or the recorder's clock, any field of any type, several topics that turn."""

import contextlib
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reader_contract import log, refusal, table_of
from vehicle_bags import bag
from vehicle_logs import dive

from automarine_cli.logs import ColumnRule

pytest.importorskip("rosbags", reason="the extra automarine[ros] is not installed")
EVERY = pytest.mark.parametrize("suffix", [".bag", ".mcap"])  # .db3 as all recordings, and below


@EVERY
def test_signs_are_turned_and_told(tmp_path: Path, suffix: str) -> None:
    table = table_of(f"dive{suffix}", tmp_path, bag(suffix, dive()))
    assert table.notes[0].startswith("heading of /imu/data, not of /odom, turned from ROS's east, north, up")
    assert "without stamps of their own, at the time of recording: /thruster/port, /thrusters" in table.notes
    np.testing.assert_allclose(table.columns["surge"], 0.5)
    np.testing.assert_allclose(table.columns["sway"], 0.25)  # 0.25 m/s to the right, which is -y in ROS
    turning = table.columns["yaw_rate"] > 0.1
    assert turning.sum() == 100 and np.all(np.diff(np.unwrap(table.columns["heading"]))[turning[1:]] > 0)


@EVERY
def test_a_recorder_s_clock_that_is_another_is_moved_and_told(tmp_path: Path, suffix: str) -> None:
    table = table_of(f"dive{suffix}", tmp_path, bag(suffix, dive(), skew=-3600.0))
    np.testing.assert_allclose(table.extras["/thruster/port.data"], dive().commands_at(dive().time)[0])
    np.testing.assert_allclose(table.columns["time"], dive().time + 1.7e9, atol=1e-6)
    assert any("+3599.996 s from the recorder's clock" in note for note in table.notes)


@EVERY
def test_another_topic_may_be_the_heading(tmp_path: Path, suffix: str) -> None:
    content = bag(suffix, dive())
    table = table_of(f"dive{suffix}", tmp_path, content, heading_rad=ColumnRule("/odom.heading", sign=-1))
    assert len(table) == 200 and "/odom" in table.notes[-1]
    np.testing.assert_allclose(np.sin(table.columns["heading"] + np.deg2rad(dive().heading)), 0, atol=1e-12)
    np.testing.assert_allclose(table.columns["time"], dive().time + 1.7e9 - 0.03, atol=1e-6)
    without = table_of(f"dive{suffix}", tmp_path, bag(suffix, dive(), without=("/imu/data",)))
    assert without.notes[0].startswith("heading of /odom, turned")
    silent = bag(suffix, replace(dive(), modes=(), arming=()), without=("/imu/data", "/odom"))
    sentence = refusal(log(tmp_path, silent, f"dive{suffix}"))
    assert "/thruster/port (std_msgs/Float64)" in sentence and "/battery (sensor_msgs/BatteryState)" in sentence


@EVERY
def test_any_field_of_any_type_can_be_named(tmp_path: Path, suffix: str) -> None:
    rules = {
        "voltage_V": "/mavros/state.system_status", "n_port": "/imu/data.linear_acceleration.z",
        "mode": "/mavros/state.mode", "n_stbd": "/thrusters.data[9]",
    }  # fmt: skip
    table = table_of(f"dive{suffix}", tmp_path, bag(suffix, dive()), **rules)
    assert set(table.columns["voltage"]) == {0.0}
    np.testing.assert_allclose(table.columns["n_port"], 9.8)
    assert table.labels["mode"].names == ("MANUAL", "ALT_HOLD") and "n_stbd" not in table.columns
    assert any("'/thrusters.data[9]' for n_stbd; the file has no such column" in note for note in table.notes)


def test_an_older_bag_that_does_not_define_its_types(tmp_path: Path) -> None:
    path = tmp_path / "old.db3"
    path.write_bytes(bag(".db3", dive()))
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("delete from message_definitions")
    table = table_of("dive.db3", tmp_path, path.read_bytes())
    assert "voltage" in table.columns and "mode" not in table.labels
    assert "/mavros/state (mavros_msgs/State)" in table.holds
