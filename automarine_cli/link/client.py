"""One request to a vehicle at a time, each on a connection of its own: what is cut is asked for again."""

import hashlib
import http.client
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import NamedTuple
from urllib.parse import quote, urlsplit

from automarine_cli.errors import SettingError
from automarine_cli.link.document import Listing, State
from automarine_cli.pipeline.records import Codec, Document, read_plain
from automarine_cli.pipeline.words import printable

CONNECT_S, STALL_S = 1.0, 10.0
"""To connect, and without a byte once connected."""
PIECE = 1 << 18
"""So much of a log is asked for at once: what lies in buffers when the link is cut is little."""
MOST_ANSWER = 64_000_000


class LinkCut(Exception):
    """No contact, or the contact was lost; to be tried again."""


class WrongAnswer(SettingError):
    """An answer that makes no sense: it is believed after so many `tries` in a row, for a link may spoil or cut it."""

    tries = 20


class Refusal(WrongAnswer):
    """An answer that is whole, and refuses: only the request may have been spoilt."""

    tries = 3


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

    @property
    def url(self) -> str:
        return f"http://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    def state(self) -> State:
        return Codec("the vehicle's state", refuse=WrongAnswer, writer="serve").read(State, self._json("GET", "/state"))

    def listing(self) -> Listing:
        codec = Codec("the vehicle's list of logs", refuse=WrongAnswer, writer="serve")
        return codec.read(Listing, self._json("GET", "/runs"))

    def stop(self, ids: Sequence[str]) -> bool:
        """Stop some campaigns; whether it is silent. Raises LinkCut, WrongAnswer."""
        return self._json("POST", f"/stop/{','.join(ids)}").get("quiet") is True

    def put_campaign(self, name: str, content: bytes) -> None:
        """Hand it a campaign; twice is as good as once. Raises LinkCut, WrongAnswer with the vehicle's refusal."""
        self._json("PUT", f"/campaigns/{name}", content)

    def piece(self, name: str, first: int, size: int) -> bytes:
        """Bytes of a log from `first` on, as many as came before the link was cut. Raises LinkCut, WrongAnswer."""
        headers = {"Range": f"bytes={first}-{min(first + PIECE, size) - 1}"}
        answer = self._ask("GET", f"/runs/{quote(name)}", None, headers)
        if answer.status != HTTPStatus.PARTIAL_CONTENT or not answer.content:
            raise WrongAnswer(f"the vehicle lists {name} and does not hand it out (status {answer.status})")
        return answer.content

    def _json(self, method: str, path: str, body: bytes | None = None) -> dict[str, object]:
        answer = self._ask(method, path, body, {})
        if answer.is_cut:
            raise LinkCut("half an answer")
        if answer.tag != f'"{hashlib.sha256(answer.content).hexdigest()}"':
            raise WrongAnswer(
                f"{self.url} does not answer as a vehicle of ours; check the address, and that both sides have the "
                "same automarine"
            )
        data = read_plain(Document("the vehicle's answer", answer.content), "JSON", WrongAnswer, most=MOST_ANSWER)
        if answer.status == HTTPStatus.UNAUTHORIZED:
            raise Refusal(f"{self.url} refuses the token; give the one that serve printed with --token")
        if answer.status >= HTTPStatus.BAD_REQUEST:
            raise Refusal(f"the vehicle refuses: {printable(str(data.get('error')))[:600]}")
        return data

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> "_Answer":
        connection = http.client.HTTPConnection(self.host, self.port, timeout=CONNECT_S)
        try:
            connection.connect()
            connection.sock.settimeout(self.stall_s)
            connection.request(method, path, body, headers | {"Authorization": f"Bearer {self.token}"})
            answer = connection.getresponse()
            content = _whole_or_part(answer)
            return _Answer(answer.status, answer.getheader("ETag"), content, bool(answer.length))
        except (OSError, http.client.IncompleteRead) as problem:
            raise LinkCut(getattr(problem, "strerror", None) or printable(str(problem)) or "cut") from None
        except (http.client.HTTPException, ValueError) as problem:
            raise WrongAnswer(f"{self.url} does not speak HTTP ({printable(str(problem))[:60]}); check it") from None
        finally:
            connection.close()


class _Answer(NamedTuple):
    """One answer; `is_cut` where not all came that was announced."""

    status: int
    tag: str | None
    content: bytes
    is_cut: bool


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
