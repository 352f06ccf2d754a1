"""One request to a vehicle at a time, each on a connection of its own: what is cut is asked for again."""

import http.client
import json
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import quote, urlsplit

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.words import printable

CONNECT_S, STALL_S = 1.0, 10.0
"""To connect, and without a byte once connected."""
PIECE = 1 << 18
"""So much of a log is asked for at once: what lies in buffers when the link is cut is little."""
MOST_ANSWER = 64_000_000


class LinkCut(Exception):
    """No contact, or the contact was lost; to be tried again."""


class WrongAnswer(Exception):
    """An answer that is none of ours."""


@dataclass(frozen=True)
class Client:
    """A vehicle's address and the word that it wants to hear."""

    host: str
    port: int
    token: str
    stall_s: float = STALL_S

    @classmethod
    def of(cls, url: str, token: str) -> "Client":
        """The client for `http://HOST:PORT`. Raises SettingError."""
        try:
            parts = urlsplit(url if "//" in url else f"http://{url}")
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if not host or port is None or parts.scheme != "http" or parts.path not in ("", "/"):
            raise SettingError(f"found the address {printable(url)!r}, expected http://HOST:PORT as serve prints it")
        if not token.isascii() or not token.isprintable():
            raise SettingError("the token holds letters that no token has; copy it as serve printed it")
        return cls(host, port, token)

    def state(self) -> dict[str, Any]:
        """What the vehicle is at. Raises LinkCut, SettingError."""
        return self._json("GET", "/state")

    def logs(self) -> list[dict[str, Any]]:
        """Its logs. Raises LinkCut, SettingError."""
        return list(self._json("GET", "/runs")["runs"])

    def stop(self) -> bool:
        """Stop it; whether it is silent. Raises LinkCut, SettingError."""
        return bool(self._json("POST", "/stop")["quiet"])

    def put_campaign(self, name: str, content: bytes) -> None:
        """Hand it a campaign; twice is as good as once. Raises LinkCut, SettingError with the vehicle's refusal."""
        self._json("PUT", f"/campaigns/{name}", content)

    def piece(self, name: str, first: int, size: int) -> bytes:
        """Bytes of a log from `first` on, as many as came before the link was cut. Raises LinkCut where none came."""
        headers = {"Range": f"bytes={first}-{min(first + PIECE, size) - 1}"}
        status, content = self._ask("GET", f"/runs/{quote(name)}", None, headers)
        if status != HTTPStatus.PARTIAL_CONTENT:
            raise LinkCut(f"status {status}")
        return content

    def _json(self, method: str, path: str, body: bytes | None = None) -> dict[str, Any]:
        status, content = self._ask(method, path, body, {})
        try:
            data = json.loads(content)
        except ValueError:  # cut short
            raise LinkCut("half an answer") from None
        if not isinstance(data, dict):
            raise SettingError(f"http://{self.host}:{self.port} is no vehicle of ours; check the address")
        if status == HTTPStatus.UNAUTHORIZED:
            raise SettingError(
                f"http://{self.host}:{self.port} refuses the token; give the one that serve printed with --token"
            )
        if status >= HTTPStatus.BAD_REQUEST:
            raise SettingError(f"the vehicle refuses: {printable(str(data.get('error')))[:600]}")
        return data

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection(self.host, self.port, timeout=CONNECT_S)
        try:
            connection.connect()
            connection.sock.settimeout(self.stall_s)
            connection.request(method, path, body, headers | {"Authorization": f"Bearer {self.token}"})
            answer = connection.getresponse()
            return answer.status, _whole_or_part(answer)
        except (OSError, http.client.HTTPException) as problem:
            raise LinkCut(getattr(problem, "strerror", None) or str(problem) or type(problem).__name__) from None
        finally:
            connection.close()


def _whole_or_part(answer: http.client.HTTPResponse) -> bytes:
    """What came of an answer before the link was cut; of nothing at all the cut is told."""
    content = b""
    try:
        while len(content) < MOST_ANSWER and (block := answer.read1(1 << 16)):
            content += block
    except (OSError, http.client.HTTPException):
        if not content:
            raise
    return content
