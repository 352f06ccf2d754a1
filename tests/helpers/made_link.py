"""A vehicle on the loopback, campaigns for it, and a link that is cut."""

import contextlib
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.dofs import YAW
from automarine_cli.link.document import CampaignBattery, LinkCampaign, PlannedRun
from automarine_cli.link.player import Player
from automarine_cli.link.server import LinkServer
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles.base import Vehicle as Drives
from automarine_cli.link.vehicles.simulated import Simulated
from automarine_cli.models.model import Model

TOKEN = "a-token-of-tests"
MODEL = Model.base("3", 1.0, [1.25], "nu", YAW)
MODEL_FILE = {
    "schema": "automarine/yaw-model/1", "moment_unit": "nu", "preferred": "3", "effects": [],
    "models": {"3": {"I_r": {"value": 1.0, "unit": "nu s²"}, "k_rr": {"value": 1.25, "unit": "nu s²"}}},
}  # fmt: skip
"""Content of the file of `MODEL`."""
BATTERY = CampaignBattery(charge_Ah=2.9, reserve_percent=20.0, idle_A=0.3, full_A=6.0, at_moment=1.0)


def made_campaign(runs: int = 4, *, seconds: float = 4.0, wait: float = 1.0, rate: float = 10.0) -> LinkCampaign:
    moments = [(-1) ** i * (0.4 + 0.5 * i / runs) for i in range(runs)]
    planned = tuple(
        PlannedRun(f"{i + 1:02d}_step_{moment:+.3f}", ((moment, seconds), (0.0, 1.0)), 90.0 * (i % 4), wait)
        for i, moment in enumerate(moments)
    )
    return LinkCampaign("automarine/link-campaign/1", "nu", rate, 1.0, BATTERY, planned)


def expected_logs(campaign: LinkCampaign) -> dict[str, bytes]:
    """Name and bytes of every log of a campaign that nothing disturbs."""
    vehicle = Simulated(MODEL, speed=1e9)
    return {
        f"{campaign.log_name(run)}.csv": "".join(vehicle.drive(campaign, number, lambda: False)).encode()
        for number, run in enumerate(campaign.runs)
    }


def handed_over(folder: Path, campaign: LinkCampaign, kind: type[Store] = Store) -> Store:
    """A store that has accepted a campaign."""
    store = kind(folder)
    store.prepare()
    store.accept(campaign.text.encode(), campaign.id)
    return store


@dataclass
class Vehicle:
    """A vehicle whose server and player are threads of the test."""

    store: Store
    server: LinkServer
    alive: threading.Event

    @property
    def port(self) -> int:
        return int(self.server.server_address[1])

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"


@contextlib.contextmanager
def vehicle_at(folder: Path, speed: float = 500.0, drives: Drives | None = None) -> Iterator[Vehicle]:
    """A vehicle, simulated unless one is given, that plays what it gets as long as the block lasts."""
    store, alive = Store(folder), threading.Event()
    driven = Simulated(MODEL, speed) if drives is None else drives
    store.prepare()
    alive.set()
    server = LinkServer(("127.0.0.1", 0), store, driven, TOKEN)
    player = threading.Thread(target=Player(store, driven, speed, alive.is_set).play)
    answers = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    player.start()
    answers.start()
    try:
        yield Vehicle(store, server, alive)
    finally:
        alive.clear()
        server.shutdown()
        server.server_close()
        player.join()
        answers.join()


@dataclass
class CuttingProxy:
    """Passes bytes between a client and `port`, and spoils connections: `reset` after some bytes, `stall` (nothing
    more comes), `half-open` (what the client says is lost), `slow`, or nothing. `bytes_down` is what reached the
    client's side, `cuts` how many connections were spoilt."""

    port: int
    ways: tuple[str, ...]
    mean_bytes: int
    seed: int
    bytes_down: int = 0
    cuts: int = 0
    _open: list[socket.socket] = field(default_factory=list)

    @contextlib.contextmanager
    def running(self) -> Iterator[str]:
        """The address under which the vehicle is reached through it."""
        listener = socket.create_server(("127.0.0.1", 0))
        accepts = threading.Thread(target=self._accept, args=(listener,), daemon=True)
        accepts.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            with contextlib.suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)  # or who waits for a call goes on waiting
            accepts.join()
            for one in (listener, *self._open):
                one.close()

    def _accept(self, listener: socket.socket) -> None:
        drawn = random.Random(self.seed)
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                vehicle = socket.create_connection(("127.0.0.1", self.port))
                self._open += [client, vehicle]
                way, after = drawn.choice(self.ways), int(drawn.expovariate(1.0 / self.mean_bytes))
                threading.Thread(target=self._down, args=(client, vehicle, way, after), daemon=True).start()
                if way != "half-open":
                    threading.Thread(target=self._up, args=(client, vehicle), daemon=True).start()
                else:
                    self.cuts += 1

    def _up(self, client: socket.socket, vehicle: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while block := client.recv(4096):
                vehicle.sendall(block)

    def _down(self, client: socket.socket, vehicle: socket.socket, way: str, after: int) -> None:
        passed = 0
        with contextlib.suppress(OSError):
            while block := vehicle.recv(1024 if way == "slow" else 4096):
                if way == "slow":
                    time.sleep(len(block) / 50_000.0)
                if way in ("reset", "stall") and passed + len(block) > after:
                    block = block[: max(after - passed, 0)]
                    way = f"{way} now"
                client.sendall(block)
                passed += len(block)
                self.bytes_down += len(block)
                if way.endswith("now"):
                    self.cuts += 1
                    if way.startswith("reset"):
                        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                        for one in (client, vehicle):
                            one.shutdown(socket.SHUT_RD)  # or who reads it in the other thread keeps it open
                            one.close()
                    return
            client.close()
