"""A run on ArduSub: the way of its sticks, its log, its heading and its tether."""

import csv
import json
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_ardusub import FakeSub, Tank, campaign_of, flown

from automarine_cli.link.vehicles.ardusub.packets import Heard
from automarine_cli.link.vehicles.ardusub.preflight import Stick, authority
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap

TOLD = [
    ({}, 1.0), ({}, 0.2), ({"ACRO_YAW_P": 1.7}, 0.7), ({"RC4_REVERSED": 1.0}, 0.5),
    ({"RC4_MIN": 1050.0, "RC4_MAX": 1900.0, "ACRO_YAW_P": 5.0}, 0.9),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "gain"), TOLD)
def test_a_stick_makes_the_output_that_was_asked_for(changed: dict[str, float], gain: float) -> None:
    """By the firmware's own steps, written down a second time in the fake."""
    vehicle = FakeSub(gain=gain, parameters=changed)
    stick = Stick.of(Heard(parameters=vehicle.parameters, named_values={"PilotGain": gain}))
    for yaw in range(-1000, 1001, 50):
        assert stick.output(yaw) == vehicle.manual_output(yaw)
    for output in np.linspace(-stick.reach, stick.reach, 21):
        assert vehicle.manual_output(stick.manual(output)) == pytest.approx(output, abs=1.1 / 400 * stick.yaw_p / 3.375)
    assert stick.manual(0.0) == stick.turn(0.0) == 0
    most = gain * stick.yaw_p / 3.375
    assert stick.reach == pytest.approx(min(1.0, most), abs=0.1 * most)


@pytest.mark.parametrize("side", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("changed", "gain"), TOLD[::2])
def test_a_run_is_logged_as_the_outputs_were(changed: dict[str, float], gain: float, side: float) -> None:
    vehicle = FakeSub(gain=gain, parameters=changed)
    lines = flown(vehicle, campaign_of(side * 0.3))
    rows = list(csv.DictReader(line.strip() for line in lines[0].splitlines()[1:] + lines[1:]))
    time, heading, tau = (np.array([float(row[key]) for row in rows]) for key in ("time_s", "heading_deg", "tau"))
    assert 0.95 < time[np.flatnonzero(tau)[0]] - time[0] < 1.2 and len(rows) > 7 * 20
    assert np.ptp(time[np.flatnonzero(tau)]) == pytest.approx(4.0, abs=0.15)
    assert set(np.round(tau, 2)) == {0.0, side * 0.3} and tau[-1] == 0.0
    assert np.all((heading >= 0) & (heading < 360)) and abs(heading[0] - 90.0) < 5.0
    unwrapped = np.unwrap(heading, period=360.0)
    assert side * (unwrapped[-1] - unwrapped[0]) > 45.0
    assert float(rows[0]["voltage_V"]) == 15.8 and float(rows[0]["depth_m"]) == 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_sticks_come_steadily_and_push_nowhere_else(side: float) -> None:
    vehicle = FakeSub()
    flown(vehicle, campaign_of(side * 0.5))
    sticks = vehicle.sticks()
    assert {(one.message.x, one.message.y, one.message.z, one.message.buttons) for one in sticks} == {(0, 0, 500, 0)}
    assert {(one.message.target, one.system, one.component) for one in sticks} == {(1, 255, 190)}
    gaps = np.diff([one.time for one in sticks if one.time >= vehicle.driven_since])
    assert np.median(gaps) == pytest.approx(1 / 40, abs=0.006) and gaps.max() < 0.1
    beats = [one for one in vehicle.packets if one.name == "HEARTBEAT"]
    assert {(one.message.type, one.message.autopilot) for one in beats} == {(6, 8)}  # a ground station
    gaps = np.diff([one.time for one in beats])
    assert gaps.max() < 1.2 and gaps.min() > 0.8
    asked = [one.message.command for one in vehicle.packets if one.name == "COMMAND_LONG"]
    assert set(asked) == {511, 176, 400} and asked.count(400) == 2


def test_the_quickest_dead_man_is_kept_awake() -> None:
    """Sticks come while the vehicle arms and changes its mode, too, which its heartbeat tells once a second only."""
    vehicle = FakeSub(parameters={"FS_PILOT_TIMEOUT": 0.1})
    flown(vehicle, campaign_of(0.8, seconds=8.0))
    sticks = np.array([one.time for one in vehicle.sticks()])
    assert not vehicle.disarmed_by and np.diff(sticks).max() < 0.1


def test_a_vehicle_that_calls_is_driven_as_well() -> None:
    """Its router sends to a port of ours, and is answered where it sends from."""
    vehicle = FakeSub()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    vehicle.call(port)
    sub = ArduSub(f"udpin:127.0.0.1:{port}", clock=Tank(vehicle))
    assert len(list(sub.drive(campaign_of(0.5), 0, lambda: False))) > 100 and vehicle.commanded()


def test_what_a_busy_computer_missed_is_not_sent_in_a_burst() -> None:
    vehicle, late = FakeSub(), list[float]()

    def hang() -> None:
        if not late and vehicle.time - vehicle.driven_since > 1.0:
            late.append(vehicle.time)
            vehicle.advance(0.6)

    flown(vehicle, campaign_of(0.5), hang)
    gaps = np.diff([one.time for one in vehicle.sticks() if one.time >= vehicle.driven_since])
    assert np.count_nonzero(gaps > 0.3) == 1 and np.count_nonzero(gaps < 0.01) <= 1


@pytest.mark.parametrize("turns", [2.3, pytest.param(-2.3, marks=pytest.mark.slow)])
def test_the_tether_is_unwound(turns: float) -> None:
    """What the vehicle counted before the run is taken back on the way to the start heading."""
    vehicle = FakeSub(tether=turns)
    flown(vehicle, campaign_of(0.2))
    assert abs(vehicle.tether + vehicle.turned / 360.0) <= 0.5 and abs(vehicle.turned) > 360.0


@pytest.mark.parametrize("side", [pytest.param(1.0, marks=pytest.mark.slow), -1.0])
def test_the_turns_of_a_run_are_taken_back(side: float) -> None:
    vehicle, most = FakeSub(), list[float]()
    flown(vehicle, campaign_of(side * 0.8, seconds=10.0), lambda: most.append(side * vehicle.turned))
    assert max(most) > 400.0 and abs(vehicle.turned / 360.0) <= 0.5 and not vehicle.armed


def test_moments_become_outputs_and_outputs_moments(tmp_path: Path) -> None:
    whole = authority(campaign_of(0.5), 2.0, None, None)
    assert (whole.largest, whole.output(-0.5), whole.moment(np.array(-0.25))) == pytest.approx((2.0, -0.25, -0.5))
    file = tmp_path / "thrusters.json"
    map_ = ThrusterMap("square", PowerCurve(8.0, 2.0, 0.05, None), PowerCurve(6.0, 2.0, 0.05, None), "", (-1.0, 1.0))
    file.write_text(json.dumps(map_.to_json()))
    bent = authority(replace(campaign_of(0.5), moment_unit="N m"), None, file, 0.2)
    assert bent.largest == pytest.approx(0.2 * 14.0 * 0.95**2)
    for moment in (-2.0, -0.5, 0.0, 0.1, 1.5):
        assert bent.moment(np.array(bent.output(moment))) == pytest.approx(moment, abs=1e-9)
    assert bent.output(1.0) == pytest.approx(0.05 + np.sqrt(1.0 / 2.8), abs=1e-9)
