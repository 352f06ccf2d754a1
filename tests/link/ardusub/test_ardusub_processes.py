"""`serve --vehicle ardusub` as processes of its own, by the clock: killed, and met by an independent MAVLink stack."""

import contextlib
import os
import signal
import socket
import subprocess
from pathlib import Path

import pytest
from fake_ardusub import FakeSub, alive, campaign_of
from link_processes import children_of, collecting, ended, free_port, served, token_in
from link_requests import until

from automarine_cli.errors import SettingError
from automarine_cli.link.document import LinkCampaign
from automarine_cli.link.vehicles.ardusub.packets import Clock, Link
from automarine_cli.link.vehicles.ardusub.vehicle import ArduSub

pytestmark = pytest.mark.slow


def begun(tmp_path: Path, vehicle: FakeSub, campaign: LinkCampaign) -> list[subprocess.Popen[bytes]]:
    """Server and collector, which hands the campaign over."""
    port = free_port(os.getpid())
    (tmp_path / "campaign.json").write_text(campaign.text)
    options = ("--vehicle", "ardusub", "--mavlink", vehicle.address)
    server = served(tmp_path / "vehicle", port, *options)
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
            until(lambda: not vehicle.armed)  # by its own dead-man, three seconds after the last stick or heartbeat
            assert vehicle.disarmed_by in ("Lost manual control", "MYGCS: 255, heartbeat lost")
            sent, disarmed = len(vehicle.sticks()), vehicle.time
            until(lambda: vehicle.time > disarmed + 3.0)
            assert len(vehicle.sticks()) == sent and not vehicle.armed
            if victims == "player":
                until(lambda: list((tmp_path / "vehicle/runs").glob("*.csv")))
                (log,) = (tmp_path / "vehicle/runs").glob("*.csv")
                assert log.name.endswith("_interrupted.csv") and len(log.read_text().splitlines()) > 50


def test_an_independent_autopilot_understands_us() -> None:
    """MAVSDK is the autopilot: its parameters are read, it arms and disarms, and is refused, for it is no ArduSub."""
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action_server import ActionServer
    from mavsdk.plugins.param_server import ParamServer

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    peer = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.AUTOPILOT))
    address = f"udpout:127.0.0.1:{port}"
    try:
        assert peer.add_any_connection(f"udpin://127.0.0.1:{port}") == mavsdk.ConnectionResult.SUCCESS
        component, told = peer.server_component(), list[bool]()
        parameters, action = ParamServer(component), ActionServer(component)
        parameters.provide_param_float("ACRO_YAW_P", 3.375)
        action.set_armable(True, True)
        action.set_disarmable(True, True)
        action.subscribe_arm_disarm(lambda result, asked, _: told.append(asked.arm))
        with contextlib.closing(Link(address, lambda: False, Clock())) as link:
            assert link.wait(10.0, lambda: link.heard.system is not None)
            link.ask(("ACRO_YAW_P", "NOT_THERE"))
            assert link.wait(10.0, lambda: "ACRO_YAW_P" in link.heard.parameters)
            assert link.heard.parameters == {"ACRO_YAW_P": 3.375}
            assert link.command(400, 1.0) and link.wait(10.0, lambda: link.heard.armed)
            assert link.command(400, 0.0) and link.wait(10.0, lambda: not link.heard.armed)
            assert told == [True, False]
            assert [one.component_ids() for one in peer.get_systems()] == [[190]]
        with pytest.raises(SettingError, match="expected 3 and 12 of ArduSub; check --mavlink"):
            ArduSub(address).look(campaign_of(0.5))
    finally:
        peer.destroy()
