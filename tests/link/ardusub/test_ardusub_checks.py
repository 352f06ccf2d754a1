"""What ArduSub is refused for before it is armed: one rule a test, each with its sentence, and no stick sent."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from fake_ardusub import FakeSub, Station, Tank, campaign_of, flown

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.link.vehicles.ardusub.packets import Clock, Link
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub, Limits

CAMPAIGN = campaign_of(0.5, -0.5)


def refused(vehicle: FakeSub, sentence: str, *others: Callable[[], object], **more: object) -> None:
    """The run is refused with this sentence, and the vehicle was neither armed nor commanded."""
    with pytest.raises(SettingError, match=sentence):
        flown(vehicle, CAMPAIGN, *others, **more)
    assert not vehicle.sticks()
    assert not any(packet.name == "COMMAND_LONG" and packet.message.command == 400 for packet in vehicle.packets)


def test_no_vehicle() -> None:
    refused(FakeSub(mute=True), "no autopilot was heard on udpout:.* in 5 s; check --mavlink")


def test_another_vehicle() -> None:
    refused(FakeSub(kind=2), "is MAV_AUTOPILOT 3 in a MAV_TYPE 2, expected 3 and 12 of ArduSub; check --mavlink")


def test_a_vehicle_that_is_armed() -> None:
    vehicle = FakeSub(armed=True)
    pilot = Station(vehicle)
    with pytest.raises(SettingError, match="is armed already, so somebody else drives it; make them disarm it"):
        flown(vehicle, CAMPAIGN, pilot.push, pilot.beat)
    assert vehicle.armed and {packet.component for packet in vehicle.sticks()} == {191}


@pytest.mark.parametrize("name", ["FS_PILOT_INPUT", "FS_GCS_ENABLE"])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_no_dead_man(name: str, value: float) -> None:
    refused(
        FakeSub(parameters={name: value}), f"{name} is {value:g}, so that the vehicle would drive on .* set it to 2"
    )


def test_a_dead_man_that_waits_long() -> None:
    refused(FakeSub(parameters={"FS_PILOT_TIMEOUT": 10.0}), "FS_PILOT_TIMEOUT is 10 s, .* set it to 3 or less")
    unknown = {"FS_PILOT_TIMEOUT": math.nan}
    refused(FakeSub(parameters=unknown), "FS_PILOT_TIMEOUT is unknown, so long would the vehicle drive on")


def test_sticks_that_would_be_passed_over() -> None:
    refused(FakeSub(parameters={"SYSID_MYGCS": 254.0}), "SYSID_MYGCS is 254, .* set it to 255")
    newer = {"SYSID_MYGCS": math.nan, "MAV_GCS_SYSID": 1.0}
    refused(FakeSub(parameters=newer), "MAV_GCS_SYSID is 1, .* set it to 255")
    with pytest.raises(SettingError, match="the vehicle tells no parameters"):
        flown(FakeSub(parameters={"SYSID_MYGCS": math.nan}), CAMPAIGN)


def test_a_second_sender_of_sticks() -> None:
    vehicle = FakeSub()
    station = Station(vehicle, 254, 25)
    sentence = r"somebody else sends MANUAL_CONTROL \(system 254, component 25\), and the last one wins; switch off"
    with pytest.raises(SettingError, match=sentence):
        flown(vehicle, CAMPAIGN, station.push)
    assert {packet.system for packet in vehicle.sticks()} == {254} and not vehicle.armed


def test_a_second_sender_with_our_own_numbers() -> None:
    vehicle = FakeSub()
    with pytest.raises(SettingError, match=r"somebody else sends MANUAL_CONTROL \(system 255, component 190\)"):
        flown(vehicle, CAMPAIGN, Station(vehicle, 255, 190).push)


def test_a_second_sender_of_channels() -> None:
    vehicle = FakeSub()
    station = Station(vehicle)
    send = station.mav.rc_channels_override_send
    refused(vehicle, "somebody else sends RC_CHANNELS_OVERRIDE", lambda: send(1, 1, *([1500] * 8)))


def test_a_ground_station_with_our_number() -> None:
    vehicle = FakeSub()
    refused(vehicle, r"another ground station has our number \(system 255, component 191\)", Station(vehicle).beat)


def test_who_only_looks_on_may_stay() -> None:
    vehicle = FakeSub()
    assert flown(vehicle, CAMPAIGN, Station(vehicle, 254).beat)


def test_an_input_that_is_held() -> None:
    refused(FakeSub(held=1.0), "holds an input of its pilot .* ask for its release")


def test_a_middle_that_is_none() -> None:
    refused(FakeSub(parameters={"RC4_TRIM": 1520.0}), "RC4_TRIM is 1520, .* set it to 1500")


def test_a_gain_that_does_not_reach() -> None:
    refused(
        FakeSub(gain=0.2), "a full stick gives 20 % of the yaw output at the pilot gain 0.2 .* the gain to 0.5 or more"
    )
    slow = FakeSub(parameters={"ACRO_YAW_P": 1.0})
    refused(slow, r"30 % of the yaw output at the pilot gain 1 and ACRO_YAW_P 1, .* set ACRO_YAW_P to 1.69 or more")


def test_an_attitude_that_comes_rarely() -> None:
    vehicle = FakeSub(deaf=True)
    refused(vehicle, "ATTITUDE came 4.* times a second, and 25 were asked for; use a link that carries more")


def test_a_frame_that_nobody_knows() -> None:
    refused(
        FakeSub(parameters={"FRAME_CONFIG": 7.0}),
        r"no yaw output can be read .*: FRAME_CONFIG is 7, which is custom: .*; use one of",
    )


def test_a_battery_below_the_need() -> None:
    refused(
        FakeSub(charge_percent=20.0),
        r"the battery holds 20 % or 0.58 Ah .* needs 0.01 Ah, and 0.58 Ah must stay; charge it",
    )
    refused(FakeSub(charge_percent=math.nan), "does not tell how much its battery holds; set BATT_MONITOR")
    assert flown(FakeSub(charge_percent=22.0), CAMPAIGN)


def test_a_depth_that_cannot_be_watched() -> None:
    refused(
        FakeSub(depth=2.0), r"is 2.0 m deep already, and --depth-limit is 1.5 m; bring it up", limits=Limits(depth=1.5)
    )
    refused(FakeSub(depth=0.0), "does not tell its depth; check its sensor", limits=Limits(depth=1.5))


def test_a_vehicle_that_does_not_arm() -> None:
    vehicle = FakeSub(armable=False)
    with pytest.raises(SettingError, match=r"does not arm \(Arm: Depth sensor is not connected\); correct what"):
        flown(vehicle, CAMPAIGN)
    assert not vehicle.commanded()


def test_moments_that_the_output_does_not_give() -> None:
    sub = ArduSub("udpin:127.0.0.1:0")
    sub.refuse(CAMPAIGN)
    with pytest.raises(SettingError, match="give --full with the moment"):
        sub.refuse(replace(CAMPAIGN, moment_unit="N m"))
    replace(sub, full=1.0).refuse(replace(CAMPAIGN, moment_unit="N m"))
    with pytest.raises(SettingError, match=r"asks for a moment of 0.5 nu, and the whole output gives 0.4; plan with"):
        replace(sub, full=0.4).refuse(CAMPAIGN)
    for wrong in (math.nan, 0.0, -1.0):
        with pytest.raises(SettingError, match="full"):
            replace(sub, full=wrong)


@pytest.mark.parametrize(
    "address", ["udpin:1", "log.tlog", "csv:x", "udp:1.2.3.4:5", "serial:x", "tcp:127.0.0.1:1", "serial:/no:9600"]
)
def test_an_address_that_is_none(address: str) -> None:
    sentence = r"expected udpin:|cannot be opened .* check --mavlink|say pip install 'automarine\[ardupilot\]'"
    with pytest.raises(AutomarineError, match=sentence):
        Link(address, lambda: False, Clock())


def test_a_dry_run_looks_and_commands_nothing() -> None:
    vehicle = FakeSub()
    ArduSub(vehicle.address, clock=Tank(vehicle)).look(CAMPAIGN)
    assert {packet.name for packet in vehicle.packets} == {"HEARTBEAT", "COMMAND_LONG", "PARAM_REQUEST_READ"}
    assert {packet.message.command for packet in vehicle.packets if packet.name == "COMMAND_LONG"} == {511}
