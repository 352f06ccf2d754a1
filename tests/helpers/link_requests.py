"""What a surface asks of a vehicle, and what it gets."""

import contextlib
import http.client
import time
from collections.abc import Callable
from pathlib import Path

from made_link import TOKEN

from automarine_cli.link.collector import Client, Collector
from automarine_cli.link.document import LinkCampaign, State


def until(what: Callable[[], object], seconds: float = 600.0) -> None:
    """Wait until something is so."""
    ends = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < ends
        time.sleep(0.01)


def logs_in(folder: Path) -> dict[str, bytes]:
    """Name and bytes of the logs."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.csv"))}


def ask(port: int, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
    """Status and content of one request."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=600)) as connection:
        token = {"Authorization": f"Bearer {TOKEN}"}
        connection.request(method, path, body, token | {key.capitalize(): value for key, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read()


def put(port: int, campaign: LinkCampaign) -> int:
    """Status of putting a campaign."""
    return ask(port, "PUT", f"/campaigns/{campaign.id}", campaign.text.encode())[0]


def collected(url: str, folder: Path, campaign: LinkCampaign | None = None, *, stop: bool = False) -> State:
    """What a patient collector brings."""
    return Collector(Client.of(url, TOKEN), folder, 600.0, poll_s=0.02).collect(campaign, stop=stop)
