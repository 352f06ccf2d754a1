"""A campaign driven over CAN, on python-can's virtual bus: what is sent, what is logged, and when it ends."""

import csv
import itertools
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from can import CanOperationError, interfaces, util
from click.testing import Result
from link_requests import ask, collected, logs_in, put, until
from made_bus import COLUMNS, MOMENT, PULSES, FaultyBus, Vessel, column_map
from made_link import MODEL_FILE, handed_over, made_campaign, vehicle_at

from automarine_cli.errors import SettingError
from automarine_cli.link import server
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.player import Player
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles import can
from automarine_cli.link.vehicles.base import StuckError
from automarine_cli.link.vehicles.can import CanBus
from automarine_cli.logs import read_column_map
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import TwinThrusters

Act = Callable[[Vessel, pytest.MonkeyPatch], None]
SPEED = 20.0
PATIENCE_S = 60.0  # of this clock, for what comes soon where nobody else needs the machine


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A compass whose thread waits for the machine is not taken for one that fell silent."""
    monkeypatch.setattr(can, "MAX_MUTE_S", SPEED * PATIENCE_S)
    monkeypatch.setattr(can, "SEND_S", PATIENCE_S)
    monkeypatch.setattr(server, "QUIET_S", PATIENCE_S)


def on(vessel: Vessel, folder: Path, text: str = MOMENT, drive: TwinThrusters | None = None) -> CanBus:
    return CanBus(f"virtual:{vessel.channel}", read_column_map(column_map(folder, text)), drive, vessel.speed)


def rows_of(log: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in log.decode().splitlines() if not line.startswith("#")))


@pytest.mark.slow
def test_a_campaign_over_can_is_fitted_as_it_is(run: Callable[..., Result], tmp_path: Path) -> None:
    campaign, slower = made_campaign(8, seconds=6.0, rate=20.0), SPEED / 4  # a busy machine has time for every moment
    with Vessel(slower).afloat() as vessel, vehicle_at(tmp_path / "v", slower, on(vessel, tmp_path)) as vehicle:
        (state,) = collected(vehicle.url, tmp_path / "pool", campaign).campaigns
    assert (state.played, state.interrupted, state.why_stopped) == (8, 0, None)
    sent = sorted({moment for one in campaign.runs for moment, _ in one.commands})
    assert np.allclose(sorted(set(vessel.moments())), sent, atol=0.001, rtol=0.0)  # as the signal holds them
    assert {values["Depth"] for _, _, values in vessel.heard} == {0.5}  # its start value in the DBC
    rested = 0
    for log in logs_in(tmp_path / "pool").values():
        rows = rows_of(log)
        assert list(rows[0]) == ["time_s", "heading_deg", "yaw_rate_deg_s", "tau"]
        levels = [tau for tau, _ in itertools.groupby(float(row["tau"]) for row in rows)]
        rested += levels[0] == 0.0
        assert "".join("0" if tau == 0.0 else "1" for tau in levels) in ("01", "010", "1", "10"), levels
        assert len(rows) > 20  # how many of each is the machine's pace
    assert rested >= 6  # of 8: a rest takes 50 ms of this clock, which a machine may need for others
    fitted = run("fit-yaw", str(tmp_path / "pool"), "--fit-to", "whole-runs", "-o", str(tmp_path / "fit"))
    assert fitted.exit_code == 0, fitted.output
    model = json.loads((tmp_path / "fit" / "yaw_model.json").read_text())["models"]["3"]
    assert model["I_r"]["value"] == pytest.approx(vessel.inertia, rel=0.05)  # its clock is that of a busy machine
    assert model["k_rr"]["value"] == pytest.approx(vessel.drag, rel=0.03)


def test_frames_come_at_a_steady_rate_and_end_with_neutral(tmp_path: Path) -> None:
    campaign = made_campaign(2, seconds=10.0, rate=10.0)
    with Vessel(SPEED).afloat() as vessel, vehicle_at(tmp_path / "v", SPEED, on(vessel, tmp_path)) as vehicle:
        collected(vehicle.url, tmp_path / "pool", campaign)
        per_run = 10 * (1 + 10 + 1) + 1
        until(lambda: len(vessel.heard) >= 2 * (per_run + can.NEUTRAL_FRAMES))
        time.sleep(0.2)
        assert len(vessel.heard) == 2 * (per_run + can.NEUTRAL_FRAMES)  # silence
    assert vessel.moments()[-4:] == [0.0] * 4
    for first, right in ((0, 0.4), (per_run + can.NEUTRAL_FRAMES, -0.65)):
        moments = np.round(vessel.moments()[first : first + per_run], 3)
        assert np.array_equal(moments, np.repeat([0.0, right, 0.0], [10, 100, 11]))


def test_nothing_but_neutral_after_a_stop(tmp_path: Path) -> None:
    campaign = made_campaign(2, seconds=300.0)
    with Vessel(SPEED).afloat() as vessel, vehicle_at(tmp_path / "v", SPEED, on(vessel, tmp_path)) as vehicle:
        put(vehicle.port, campaign)
        until(lambda: any(vessel.moments()[-1:]))
        assert ask(vehicle.port, "POST", "/stop")[0] == 200
        before = len(vessel.heard)
        until(lambda: vessel.moments()[-can.NEUTRAL_FRAMES :] == [0.0] * can.NEUTRAL_FRAMES)
        time.sleep(0.3)
        assert not any(vessel.moments()[before:])
        assert vessel.moments()[-can.NEUTRAL_FRAMES :] == [0.0] * can.NEUTRAL_FRAMES
    ((name, log),) = logs_in(vehicle.store.runs).items()
    assert name.endswith("_stopped.csv") and float(rows_of(log)[-1]["tau"]) == 0.0


def fall_silent(vessel: Vessel, patch: pytest.MonkeyPatch) -> None:
    vessel.speaks = False
    patch.setattr(can, "MAX_MUTE_S", 2.0)


def intrude(vessel: Vessel, patch: pytest.MonkeyPatch) -> None:
    vessel.intrudes = True


@pytest.mark.parametrize(
    ("speaks", "act", "why"),
    [
        (True, fall_silent, "the compass fell silent; look at it before the next campaign"),
        (False, fall_silent, "no heading came from the bus; look at the compass"),
        (True, intrude, "somebody else sends 0x124, by which the run is driven; make that sender stop"),
    ],
)
def test_trouble_ends_the_campaign(
    speaks: bool, act: Act, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    vessel = Vessel(SPEED, speaks=speaks)
    with vessel.afloat(), vehicle_at(tmp_path / "v", vessel.speed, on(vessel, tmp_path)) as vehicle:
        put(vehicle.port, made_campaign(2, seconds=300.0))
        if speaks:
            until(lambda: any(vessel.moments()[-1:]))
        act(vessel, monkeypatch)
        until(lambda: vehicle.store.state().campaigns[0].over)
        until(lambda: vessel.moments()[-2:] in ([0.0] * 2, []))
        assert str(vehicle.store.state().campaigns[0].why_stopped).startswith(why)
        marks = [name.rpartition("_")[2] for name in logs_in(vehicle.store.runs)]
        assert (
            marks == ["stopped.csv"] * speaks == ["stopped.csv"] * any(vessel.moments())
        )  # without a compass: nothing


CALLS: dict[str, tuple[str, Exception, str]] = {
    "send, CanError": ("send", CanOperationError("Network is down"), "CanOperationError: Network is down"),
    "send, OSError": ("send", OSError(), "OSError"),
    "send, its own": ("send", RuntimeError("no such handle"), "RuntimeError: no such handle"),
    "receive, spoilt line": ("recv", ValueError("invalid literal for int()"), "ValueError: invalid literal"),
    "receive, unplugged": ("recv", OSError(19, "No such device"), "OSError: [Errno 19] No such device"),
    "shutdown": ("shutdown", RuntimeError("already closed"), "RuntimeError: already closed"),
}


@pytest.fixture
def faults(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Callable[[FaultyBus], object]]]:
    """What the calls of a bus `faulty:CHANNEL` do; none once the test is over."""
    monkeypatch.setitem(interfaces.BACKENDS, "faulty", ("made_bus", "FaultyBus"))
    monkeypatch.setattr(util, "VALID_INTERFACES", {*interfaces.BACKENDS})
    yield FaultyBus.faults
    FaultyBus.faults.clear()
    FaultyBus.sent.clear()


def play(vessel: Vessel, folder: Path, campaign: LinkCampaign) -> Store:
    """Play a campaign over a faulty bus until it is over."""
    store = handed_over(folder / "v", campaign)
    bus = replace(on(vessel, folder), place=f"faulty:{vessel.channel}")
    Player(store, bus, vessel.speed, lambda: bool(store.accepted())).play()
    return store


def whenever_driven(vessel: Vessel, act: Callable[[FaultyBus], object]) -> Callable[[FaultyBus], None]:
    """Do something from the first command that is not neutral on."""

    def act_then(bus: FaultyBus) -> None:
        if any(vessel.moments()):
            act(bus)

    return act_then


@pytest.mark.parametrize("case", CALLS)
def test_whatever_a_call_to_the_bus_raises_is_a_bus_that_failed(
    case: str, tmp_path: Path, faults: dict[str, Callable[[FaultyBus], object]]
) -> None:
    """Neutral is sent where that goes, the campaign is over with its reason, and the next run is not driven."""
    call, problem, says = CALLS[case]
    failures = iter([problem, problem])

    def fail(bus: FaultyBus) -> None:
        for failure in failures:
            raise failure

    vessel = Vessel(SPEED)
    faults[call] = whenever_driven(vessel, fail)
    with vessel.afloat():
        store = play(vessel, tmp_path, made_campaign(2, seconds=300.0 if call != "shutdown" else 4.0))
        (state,) = store.state().campaigns
        until(lambda: vessel.moments()[-2:] == [0.0] * 2)
    assert (state.over, state.played) == (True, 1) and str(state.why_stopped).startswith("the bus faulty:bus-")
    assert f"failed ({says}" in str(state.why_stopped) and "look at its cable and adapter" in str(state.why_stopped)
    assert [name.rpartition("_")[2] for name in logs_in(store.runs)] == ["stopped.csv"]


def test_neutral_comes_for_a_while(tmp_path: Path, faults: dict[str, Callable[[FaultyBus], object]]) -> None:
    """A plug that is loose for a moment does not swallow every frame of neutral."""
    with Vessel(1.0).afloat() as vessel:
        play(vessel, tmp_path, replace(made_campaign(1, seconds=0.2), rest_s=0.1))
        neutral = FaultyBus.sent[-can.NEUTRAL_FRAMES :]
        until(lambda: vessel.moments()[-can.NEUTRAL_FRAMES :] == [0.0] * can.NEUTRAL_FRAMES)
        assert neutral[-1] - neutral[0] > 0.3


def test_a_command_that_hangs_never_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, faults: dict[str, Callable[[FaultyBus], object]]
) -> None:
    def hang(bus: FaultyBus) -> None:
        assert bus.is_down.wait(PATIENCE_S)
        raise OSError("closed")

    monkeypatch.setattr(can, "SEND_S", 0.5)
    vessel, campaign = Vessel(SPEED), made_campaign(2, seconds=300.0)
    faults["send"] = whenever_driven(vessel, hang)
    with vessel.afloat():
        with pytest.raises(StuckError, match=r"faulty:bus-.* did not take a command in .* s; look at its cable"):
            play(vessel, tmp_path, campaign)
        store, count = Store(tmp_path / "v"), len(FaultyBus.sent)
        (state,) = store.state().campaigns
        assert (state.over, state.played) == (True, 1) and "did not take a command" in str(state.why_stopped)
        time.sleep(0.2)
        assert FaultyBus.last[0].is_down.is_set() and len(FaultyBus.sent) == count


def test_a_bus_that_hung_is_sent_nothing_that_was_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, faults: dict[str, Callable[[FaultyBus], object]]
) -> None:
    vessel, hangs = Vessel(SPEED), iter([0.5])

    def hang(bus: FaultyBus) -> None:
        monkeypatch.setattr(can, "MAX_MUTE_S", 0.3 * SPEED)  # from here on only: no pause before is taken for this one
        time.sleep(next(hangs, 0.0))

    faults["recv"] = whenever_driven(vessel, hang)
    with vessel.afloat():
        store = play(vessel, tmp_path, made_campaign(2, seconds=300.0))
    (state,) = store.state().campaigns
    assert state.over and state.played == 1 and (" hung for " in state.says or "fell silent" in state.says)


def test_two_thrusters_get_pulses(tmp_path: Path) -> None:
    curve = PowerCurve(a=1e-3, n_0=0.0, p=2.0)
    drive = TwinThrusters(curve, curve, 0.1, 100.0, True)
    campaign = replace(made_campaign(2), moment_unit="N m")
    steps = on(Vessel(SPEED), tmp_path, PULSES, drive).steps(campaign, campaign.runs[0])
    n = (0.4 / 0.1 / 2 / 1e-3) ** 0.5  # each pulls half of moment / arm
    pulse = round(1500 + 4 * n)
    still, driven = ("0", "0"), (f"{(pulse - 1500) / 4:g}", f"{(1500 - pulse) / 4:g}")
    assert [one.readings for one in steps] == [still, driven, still, still]
    ports = [int.from_bytes(one.frames[0].data[:2], "little") for one in steps]
    assert ports == [1500, pulse, 1500, 1500]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (COLUMNS, "the DBC holds no signal tau; name the signal of each command in the column map"),
        (COLUMNS + 'tau = "Drive.Nothing"\n', "the DBC holds no signal Drive.Nothing; name the signal"),
        (COLUMNS + 'tau = "Open.Moment"\n', "Open also holds Lamp, for which the DBC gives no start value; add it"),
        (MOMENT.replace("Compass.Heading", "Compass.None"), "names no signal of the DBC for the heading; write a line"),
        (MOMENT.replace('[can]\ndbc = "bus.dbc"\n', ""), "give a column map with [can] dbc ="),
    ],
)
def test_a_map_that_does_not_drive_is_refused(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(SettingError) as refused:
        on(Vessel(SPEED), tmp_path, text).refuse(made_campaign())
    assert says in str(refused.value)


def test_commands_beyond_the_signal_are_refused(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    large = replace(campaign.runs[1], commands=((2.5, 1.0),))
    campaign = replace(campaign, runs=(campaign.runs[0], large), battery=replace(campaign.battery, at_moment=3.0))
    with pytest.raises(SettingError, match=rf"run {large.name[:3]}.*2.5.*; plan smaller moments"):
        on(Vessel(SPEED), tmp_path).refuse(campaign)
    with pytest.raises(SettingError, match="plan for a model in N m, or leave --thrusters out"):
        curve = PowerCurve(a=1e-3, n_0=0.0, p=2.0)
        on(Vessel(SPEED), tmp_path, PULSES, TwinThrusters(curve, curve, 0.1, 100.0, True)).refuse(made_campaign())


def test_a_dry_run_over_can(run: Callable[..., Result], tmp_path: Path) -> None:
    campaign = tmp_path / "campaign.json"
    campaign.write_text(made_campaign(2).text)
    asked = ["serve", str(tmp_path / "v"), "--vehicle", "can", "--dry-run", "--campaign", str(campaign)]
    with_map = [*asked, "--bus", "virtual:dry", "--columns", str(column_map(tmp_path))]
    assert "2 runs in 0.2 min" in run(*with_map).stdout
    (tmp_path / "yaw_model.json").write_text(json.dumps(MODEL_FILE))
    simulated = json.loads(run(*with_map, "--model", str(tmp_path / "yaw_model.json"), "--json").stdout)["planned"]
    assert simulated[0]["turned_deg"] > 0 > simulated[1]["turned_deg"]
    assert run(*asked).exit_code == 2  # no bus
    assert "with [can] dbc" in run(*asked, "--bus", "virtual:dry").stderr


@pytest.mark.parametrize("place", ["can0", "socketcan:", ":can0", "slcan:/dev/x@fast"])
def test_a_bus_that_is_none_is_refused(place: str, tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"give python-can's INTERFACE:CHANNEL, such as socketcan:can0"):
        replace(on(Vessel(SPEED), tmp_path), place=place).refuse(made_campaign())
    with pytest.raises(SettingError, match=r"the bus slcan:/dev/none cannot be opened .*; look at the adapter"):
        replace(on(Vessel(SPEED), tmp_path), place="slcan:/dev/none").refuse(made_campaign())
