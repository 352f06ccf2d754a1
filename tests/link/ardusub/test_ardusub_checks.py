"""What ArduSub is refused for before it is armed: one rule a line, each with its sentence, and no stick sent."""

import math
from dataclasses import replace
from typing import Any

import pytest
from fake_ardusub import FakeSub, Station, Tank, campaign_of, flown

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.link.vehicles.ardusub.packets import Clock, Link
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub, ArduSubLimits

CAMPAIGN = campaign_of(0.5, -0.5)


def with_parameters(**parameters: float) -> dict[str, Any]:
    return {"parameters": parameters}


RULES: dict[str, tuple[dict[str, Any], str]] = {
    "no vehicle": ({"mute": True}, "no autopilot was heard on udpout:.* in 5 s; check --mavlink"),
    "another vehicle": ({"kind": 2}, "is MAV_AUTOPILOT 3 in a MAV_TYPE 2, expected 3 and 12 of ArduSub; check --mavl"),
    **{
        f"no dead-man: {name} {value:g}": (
            with_parameters(**{name: value}),
            f"{name} is {value:g}, so that the vehicle would drive on .* set it to 2",
        )
        for name in ("FS_PILOT_INPUT", "FS_GCS_ENABLE")
        for value in (0.0, 1.0)
    },
    "slow dead-man": (with_parameters(FS_PILOT_TIMEOUT=10.0), "FS_PILOT_TIMEOUT is 10 s, .* set it to 3 or less"),
    "unknown dead-man": (with_parameters(FS_PILOT_TIMEOUT=math.nan), "FS_PILOT_TIMEOUT is unknown, so long would the"),
    "sticks passed over": (with_parameters(SYSID_MYGCS=254.0), "SYSID_MYGCS is 254, .* set it to 255"),
    "newer name": (
        with_parameters(SYSID_MYGCS=math.nan, MAV_GCS_SYSID=1.0), "MAV_GCS_SYSID is 1, .* set it to 255"),
    "no parameters": (with_parameters(SYSID_MYGCS=math.nan), "the vehicle tells no parameters"),
    "input held": ({"held": 1.0}, "holds an input of its pilot .* ask for its release"),
    "no middle": (with_parameters(RC4_TRIM=1520.0), "RC4_TRIM is 1520, .* set it to 1500"),
    "small gain": ({"gain": 0.2}, "a full stick gives 20 % of the yaw output at the pilot gain 0.2 .* the gain to 0.5"),
    "small yaw gain": (with_parameters(ACRO_YAW_P=1.0), r"30 % .* ACRO_YAW_P 1, .* set ACRO_YAW_P to 1.69 or more"),
    "rare attitude": ({"deaf": True}, "ATTITUDE came 4.* times a second, and 25 were asked for; use a link that carr"),
    "custom frame": (
        with_parameters(FRAME_CONFIG=7.0), r"no yaw output can be read .*: FRAME_CONFIG is 7: .*; use one of"),
    "low battery": ({"charge_percent": 20.0}, "holds 20 % or 0.58 Ah .* needs 0.01 Ah, and 0.58 Ah must stay; charge"),
    "unknown battery": ({"charge_percent": math.nan}, "does not tell how much its battery holds; set BATT_MONITOR"),
    "deep": ({"depth": 2.0}, r"is 2.0 m deep already, and --depth-limit is 1.5 m; bring it up"),
    "unknown depth": ({"depth": 0.0}, "does not tell its depth; check its sensor"),
}  # fmt: skip


def assert_untouched(vehicle: FakeSub) -> None:
    """We neither armed nor commanded it."""
    assert not [stick for stick in vehicle.sticks() if stick.component == 190]
    assert not any(packet.name == "COMMAND_LONG" and packet.message.command == 400 for packet in vehicle.packets)


@pytest.mark.parametrize("rule", RULES)
def test_a_vehicle_that_is_refused_is_not_armed(rule: str) -> None:
    state, sentence = RULES[rule]
    vehicle, limits = FakeSub(**state), ArduSubLimits(depth=1.5) if "depth" in state else ArduSubLimits()
    with pytest.raises(SettingError, match=sentence):
        flown(vehicle, CAMPAIGN, limits=limits)
    assert_untouched(vehicle)


def test_a_vehicle_that_is_armed() -> None:
    vehicle = FakeSub(armed=True)
    pilot = Station(vehicle)
    with pytest.raises(SettingError, match="is armed already, so somebody else drives it; make them disarm it"):
        flown(vehicle, CAMPAIGN, pilot.push, pilot.beat)
    assert vehicle.armed and {packet.component for packet in vehicle.sticks()} == {191}


def channels(station: Station) -> None:
    station.mav.rc_channels_override_send(1, 1, *([1500] * 8))


@pytest.mark.parametrize(
    ("numbers", "act", "sentence"),
    [
        ((254, 25), Station.push, r"somebody else sends MANUAL_CONTROL \(system 254, component 25\), and the last one"),
        ((255, 191), channels, "somebody else sends RC_CHANNELS_OVERRIDE"),
        ((255, 191), Station.beat, r"another ground station has our number \(system 255, component 191\)"),
    ],
)
def test_a_second_sender(numbers: tuple[int, int], act: Any, sentence: str) -> None:
    vehicle = FakeSub()
    station = Station(vehicle, *numbers)
    with pytest.raises(SettingError, match=sentence):
        flown(vehicle, CAMPAIGN, lambda: act(station))
    assert_untouched(vehicle)


def test_a_second_sender_with_our_own_numbers() -> None:
    vehicle = FakeSub()
    with pytest.raises(SettingError, match=r"somebody else sends MANUAL_CONTROL \(system 255, component 190\)"):
        flown(vehicle, CAMPAIGN, Station(vehicle, 255, 190).push)
    assert not vehicle.armed


def test_who_only_looks_on_may_stay_and_a_battery_above_the_need_will_do() -> None:
    vehicle = FakeSub(charge_percent=22.0)
    assert flown(vehicle, CAMPAIGN, Station(vehicle, 254).beat)


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
