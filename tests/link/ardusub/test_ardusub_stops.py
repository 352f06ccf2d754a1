"""What ends a run on ArduSub: sticks in the middle, disarmed, silence; the run is closed, and marked."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_ardusub import FakeSub, Packet, Station, Tank, campaign_of, flown
from made_link import handed_over

from automarine_cli.errors import SettingError
from automarine_cli.link.player import Player
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub, ArduSubLimits

LONG = campaign_of(0.6, -0.6, seconds=20.0)
NAME = LONG.log_name(LONG.runs[0])
Act = Callable[[FakeSub], object]


def in_the_run(vehicle: FakeSub, act: Act, marks: list[float]) -> Callable[[], None]:
    """Do something once, after three seconds of driving in MANUAL; `marks` gets the time."""

    def whenever() -> None:
        if not marks and vehicle.time - vehicle.driven_since > 3.0:
            marks.append(vehicle.time)
            act(vehicle)

    return whenever


def _is_command(packet: Packet, number: int) -> bool:
    return packet.name == "COMMAND_LONG" and packet.message.command == number


def assert_quiet_since(vehicle: FakeSub, time: float, within: float = 0.1) -> None:
    """From a time on [s]: no stick out of the middle, then a few in it and a word to disarm, then nothing."""
    ours = [packet for packet in vehicle.packets if packet.component == 190]
    assert max(packet.time for packet in vehicle.commanded() if packet.component == 190) <= time + within
    assert sum(packet.name == "MANUAL_CONTROL" and packet.time > time for packet in ours) >= 10
    last = [packet for packet in ours if packet.name != "HEARTBEAT"][-1]
    assert _is_command(last, 400) and last.message.param1 == 0
    before = len(vehicle.packets)
    vehicle.advance(10.0)
    assert len(vehicle.packets) == before and not vehicle.armed and abs(vehicle.rate) < 0.2


@pytest.mark.parametrize(
    ("act", "sentence", "within"),
    [
        (lambda v: setattr(v, "sinks", 1.0), "m deep, below --depth-limit; make it float", 2.0),
        (lambda v: setattr(v, "armed", False), "disarmed itself .*; correct that first", 1.2),
        (lambda v: v.disarm("Leak Detected"), r"disarmed itself \(Leak Detected\)", 1.2),
        (lambda v: setattr(v, "mode", 2), "somebody changed the mode to 2; ask who else", 1.5),
        (lambda v: Station(v, 254, 25).push(), r"somebody else sends MANUAL_CONTROL \(system 254", 0.1),
        (lambda v: setattr(v, "stray", -0.3), r"yaw output is \+0.30, and \+0.60 was sent; check who else", 1.5),
        (lambda v: setattr(v, "gain", 0.5), r"is \+0.30, and \+0.60 was sent; .* nobody changed its gain", 1.5),
        (lambda v: setattr(v, "mute", True), r"was not heard any more; check the link, and where the vehicle is", 1.5),
    ],
    ids=["depth", "disarmed", "failsafe", "mode", "pilot", "outputs", "gain", "silence"],
)
def test_what_goes_wrong_in_a_run_ends_it(act: Act, sentence: str, within: float) -> None:
    """Its own dead-man has to do it where our word to disarm is lost as well."""
    vehicle, marks = FakeSub(), list[float]()
    with pytest.raises(SettingError, match=sentence):
        flown(vehicle, LONG, in_the_run(vehicle, act, marks), limits=ArduSubLimits(depth=2.0))
    assert_quiet_since(vehicle, marks[0], within)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_run_that_turns_too_far(side: float) -> None:
    vehicle, headings = FakeSub(), list[float]()

    def look() -> None:
        if vehicle.mode == 19 and vehicle.commanded():
            headings.append(vehicle.turned)

    with pytest.raises(SettingError, match=r"turned 270 deg from where run 01_step.* began; plan shorter"):
        flown(vehicle, campaign_of(side * 0.6, seconds=20.0), look, limits=ArduSubLimits(heading=270.0))
    assert 270.0 < np.ptp(headings) < 330.0 and not vehicle.armed  # it coasts a little


def test_nothing_is_sent_when_the_vehicle_is_lost_on_the_way_to_its_heading() -> None:
    vehicle = FakeSub(heading=60.0)

    def stick() -> None:
        vehicle.stray = -0.5 if vehicle.armed else 0.0  # its gains cannot turn it against that
        vehicle.I_r = 1e6

    with pytest.raises(SettingError, match=r"did not come to the heading 90 deg in .* s; check its yaw gains"):
        flown(vehicle, LONG, stick)
    assert vehicle.mode == 0 and not vehicle.armed


class Played:
    """A campaign played from a store on a vehicle; `act` is what happens in its first run."""

    def __init__(self, folder: Path, vehicle: FakeSub, act: Callable[["Played"], object]) -> None:
        self.store, self.lives, self.marks = handed_over(folder, LONG), True, list[float]()
        clock = Tank(vehicle, [in_the_run(vehicle, lambda _: act(self), self.marks)])
        Player(self.store, ArduSub(vehicle.address, clock=clock), 1e3, self._lives).play()
        (self.state,) = self.store.state().campaigns
        self.logs = [log.name for log in self.store.listing().runs]

    def _lives(self) -> bool:
        return self.lives and (not self.store.bar(LONG, 0) or self.store.is_playing())


def test_a_stop_is_neutral_then_silence(tmp_path: Path) -> None:
    vehicle = FakeSub()
    played = Played(tmp_path, vehicle, lambda played: played.store.stop())
    assert_quiet_since(vehicle, played.marks[0])
    assert played.logs == [f"{NAME}_stopped.csv"]
    assert (played.state.over, played.state.why_stopped, played.state.played) == (True, "asked to stop", 1)
    rows = list(csv.DictReader((played.store.runs / played.logs[0]).read_text().splitlines()[1:]))
    assert {float(row["tau"]) for row in rows} == {0.0, 0.6} and float(rows[-1]["tau"]) == 0.0
    assert rows[-1]["stick"] == "0"


@pytest.mark.parametrize(
    "pattern", [pytest.param("*.json", marks=pytest.mark.slow), pytest.param("*.ready", marks=pytest.mark.slow), "*"]
)
def test_a_campaign_that_is_gone_is_neutral_then_silence(tmp_path: Path, pattern: str) -> None:
    vehicle, store, marks, looks = FakeSub(), handed_over(tmp_path, LONG), list[float](), iter(range(9))

    def delete(_: FakeSub) -> None:
        for file in store.campaigns.glob(pattern):
            file.unlink()

    clock = Tank(vehicle, [in_the_run(vehicle, delete, marks)])
    Player(store, ArduSub(vehicle.address, clock=clock), 1e3, lambda: store.is_playing() or any(looks)).play()
    assert_quiet_since(vehicle, marks[0])
    assert [log.name for log in store.listing().runs] == [f"{NAME}_stopped.csv"]


def test_a_lost_lease_is_neutral_then_silence(tmp_path: Path) -> None:
    vehicle = FakeSub()
    played = Played(tmp_path, vehicle, lambda played: setattr(played, "lives", False))
    assert_quiet_since(vehicle, played.marks[0])
    assert played.logs == [f"{NAME}_interrupted.csv"]
    assert not played.state.over and played.state.why_stopped is None


@pytest.mark.parametrize("number", [511, 176, 400])
def test_a_stop_at_any_command_leaves_it_disarmed(tmp_path: Path, number: int) -> None:
    """Also at the word to arm, before it was answered: no run began, and there is no log."""
    vehicle, store = FakeSub(), handed_over(tmp_path, LONG)

    def heard(packet: Packet) -> None:
        if _is_command(packet, number):
            store.stop()

    vehicle.heard = heard  # type: ignore[method-assign]
    sub = ArduSub(vehicle.address, clock=Tank(vehicle))
    Player(store, sub, 1e3, lambda: not store.bar(LONG, 0)).play()
    assert store.bar(LONG, 0) and list(store.runs.iterdir()) == []
    vehicle.advance(2.0)
    assert not vehicle.armed and not vehicle.disarmed_by and not vehicle.commanded()


def test_what_the_vehicle_refuses_stops_the_campaign(tmp_path: Path) -> None:
    vehicle = FakeSub()
    played = Played(tmp_path / "disarmed", vehicle, lambda played: vehicle.disarm("Leak Detected"))
    assert played.state.why_stopped == "the vehicle disarmed itself (Leak Detected); correct that first"
    assert played.logs == [f"{NAME}_stopped.csv"]
    unsafe = FakeSub(parameters={"FS_PILOT_INPUT": 0.0})
    played = Played(tmp_path / "unsafe", unsafe, lambda played: None)
    assert played.logs == [] and list(played.store.runs.iterdir()) == []
    assert played.state.over and str(played.state.why_stopped).startswith("FS_PILOT_INPUT is 0, so that")
