"""`serve --vehicle ardusub` as processes of its own, by the clock: killed, and seen by an independent MAVLink stack."""

import json
import os
import signal
import subprocess
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_ardusub import FakeSub, alive, campaign_of
from link_processes import ALONE, children_of, collecting, ended, token_in

from automarine_cli.link.document import LinkCampaign

pytestmark = pytest.mark.slow


def served(folder: Path, vehicle: FakeSub, port: int) -> subprocess.Popen[bytes]:
    """The vehicle's computer."""
    options = ["--vehicle", "ardusub", "--mavlink", vehicle.address, "--address", f"127.0.0.1:{port}"]
    return subprocess.Popen([*ALONE, "serve", str(folder), *options], stdout=subprocess.DEVNULL)


def until(what: Any, seconds: float = 60.0) -> None:
    """Wait until something is so."""
    ends = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < ends
        time.sleep(0.02)


def begun(tmp_path: Path, vehicle: FakeSub, campaign: LinkCampaign) -> list[subprocess.Popen[bytes]]:
    """Server and collector, which hands the campaign over."""
    port = 40000 + os.getpid() % 20000
    (tmp_path / "campaign.json").write_text(campaign.text)
    server = served(tmp_path / "vehicle", vehicle, port)
    token = token_in(tmp_path / "vehicle")
    return [server, collecting(tmp_path / "pool", token, port, tmp_path / "campaign.json")]


@pytest.mark.parametrize("victims", ["player", "player and server"])
def test_killed_in_a_run_there_is_silence_and_the_dead_man_disarms(tmp_path: Path, victims: str) -> None:
    with alive(FakeSub()) as vehicle:
        processes = begun(tmp_path, vehicle, campaign_of(0.5, seconds=600.0))
        with ended(processes):
            until(lambda: vehicle.time - vehicle.driven_since > 1.0)
            player = children_of(processes[0])[-1]
            if "server" in victims:
                processes[0].kill()
            os.kill(player, signal.SIGKILL)
            killed = vehicle.time
            until(lambda: not vehicle.armed)
            assert vehicle.disarmed_by in ("Lost manual control", "MYGCS: 255, heartbeat lost")
            assert vehicle.time - killed < 3.5
            time.sleep(3.0)
            assert not [one for one in vehicle.sticks() if one.time > killed + 0.5] and not vehicle.armed
            if victims == "player":
                until(lambda: list((tmp_path / "vehicle/runs").glob("*.csv")))
                (log,) = (tmp_path / "vehicle/runs").glob("*.csv")
                assert log.name.endswith("_interrupted.csv") and len(log.read_text().splitlines()) > 50


@dataclass
class Peer:
    """What MAVSDK sees on the vehicle's link: when [s], and what each message says."""

    seen: dict[str, list[tuple[float, dict[str, Any]]]] = field(default_factory=dict)
    _kept: list[Any] = field(default_factory=list)

    def join(self, vehicle: FakeSub) -> Any:
        """Connect; the library's own object, for its questions."""
        mavsdk = pytest.importorskip("mavsdk")
        peer = mavsdk.Mavsdk(mavsdk.Configuration.create_manual(246, 195, True))
        result = peer.add_any_connection(f"udpout://{vehicle.address.removeprefix('udpout:')}")
        assert result == mavsdk.ConnectionResult.SUCCESS
        return peer

    def listen(self, peer: Any, system: int) -> Any:
        """Hear all of a system's messages; the system."""
        from mavsdk.plugins.mavlink_direct import MavlinkDirect

        until(lambda: any(one.get_system_id() == system for one in peer.get_systems()))
        found = next(one for one in peer.get_systems() if one.get_system_id() == system)
        direct = MavlinkDirect(found)
        direct.subscribe_message("", self._hear)
        self._kept += [found, direct]
        return found

    def _hear(self, message: Any, _: Any = None) -> None:
        if message.component_id == 190:
            told = (time.monotonic(), json.loads(message.fields_json))
            self.seen.setdefault(message.message_name, []).append(told)


def test_an_independent_stack_sees_a_well_behaved_sender(tmp_path: Path) -> None:
    """MAVSDK is a ground station on the same link; what it says of us is its own parsing, not pymavlink's."""
    with alive(FakeSub()) as vehicle:
        watch = Peer()
        peer = watch.join(vehicle)
        processes = begun(tmp_path, vehicle, campaign_of(0.5, seconds=6.0))
        try:
            with ended(processes):
                us = watch.listen(peer, 255)
                assert us.component_ids() == [190] and not us.has_autopilot() and us.is_connected()
                (sub,) = [one for one in peer.get_systems() if one.has_autopilot()]
                assert sub.get_system_id() == 1
                assert processes[1].wait(timeout=120) == 0
        finally:
            peer.destroy()
    beats = [when for when, _ in watch.seen["HEARTBEAT"]]
    told = {(one["type"], one["autopilot"]) for _, one in watch.seen["HEARTBEAT"]}
    assert told == {(6, 8)}  # a ground station
    assert np.diff(beats).max() < 2.0
    sticks = [(when, one) for when, one in watch.seen["MANUAL_CONTROL"]]
    assert {(one["x"], one["y"], one["z"], one["buttons"], one["target"]) for _, one in sticks} == {(0, 0, 500, 0, 1)}
    assert max(abs(one["r"]) for _, one in sticks) <= 1000 and {500} <= {one["r"] for _, one in sticks}
    assert [one["r"] for _, one in sticks[-10:]] == [0] * 10
    gaps = np.diff([when for when, one in sticks if one["r"] == 500])
    assert 1 / 50 < np.median(gaps) < 1 / 20
    asked = Counter(one.message.command for one in vehicle.packets if one.name == "COMMAND_LONG")
    assert set(asked) == {511, 176, 400} and asked[400] == 2  # MAVSDK does not tell what is meant for another system
    assert len(list((tmp_path / "pool").glob("*.csv"))) == 1
