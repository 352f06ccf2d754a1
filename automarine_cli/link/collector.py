"""The surface's side: on contact state, stop, campaign, then logs; what is cut is asked for again."""

import hashlib
import http.client
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from http import HTTPStatus
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from urllib.parse import quote, urlsplit

from automarine_cli.errors import SettingError, one_sentence
from automarine_cli.link.document import ID_LETTERS, LinkCampaign, Listing, Log, State
from automarine_cli.link.store import HeldElsewhereError, held, sync_folder
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import Codec, Document, json_text, read_plain
from automarine_cli.pipeline.results_folder import sha256, write_whole
from automarine_cli.text import printable

CONNECT_S, STALL_S = 1.0, 10.0  # to connect, and without a byte once connected
LOG_PIECE_BYTES = 1 << 18  # so much of a log is asked for at once: what lies in buffers when the link is cut is little
MAX_ANSWER = 64_000_000


class LinkCut(Exception):
    """No contact, or the contact was lost; to be tried again."""


class WrongAnswer(SettingError):
    """An answer that makes no sense: it is believed after so many `tries` in a row, for a link may spoil or cut it."""

    tries = 20


class DamagedLogError(WrongAnswer):
    """A log that does not come as it was closed; others may."""


class Refusal(WrongAnswer):
    """An answer that is whole, and refuses: only the request may have been spoilt."""

    tries = 3


@dataclass(frozen=True)
class Client:
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
        """Stop some campaigns, without `ids` all; whether it is silent. Raises LinkCut, WrongAnswer."""
        return self._json("POST", f"/stop/{','.join(ids)}".removesuffix("/")).get("quiet") is True

    def put_campaign(self, name: str, content: bytes) -> None:
        """Hand it a campaign; twice is as good as once. Raises LinkCut, WrongAnswer with the vehicle's refusal."""
        self._json("PUT", f"/campaigns/{name}", content)

    def piece(self, name: str, first: int, size: int) -> bytes:
        """Bytes of a log from `first` on, as many as came before the link was cut. Raises LinkCut, WrongAnswer."""
        headers = {"Range": f"bytes={first}-{min(first + LOG_PIECE_BYTES, size) - 1}"}
        answer = self._ask("GET", f"/runs/{quote(name)}", None, headers)
        if answer.status != HTTPStatus.PARTIAL_CONTENT or not answer.content:
            why = f"and does not hand it out (status {answer.status}); check the vehicle's disk"
            raise DamagedLogError(f"the vehicle lists {name} {why}")
        return answer.content

    def _json(self, method: str, path: str, body: bytes | None = None) -> dict[str, object]:
        answer = self._ask(method, path, body, {})
        if answer.is_cut:
            raise LinkCut("half an answer")
        if answer.tag != f'"{hashlib.sha256(answer.content).hexdigest()}"':
            remedy = "check the address, and that both sides have the same automarine"
            raise WrongAnswer(f"{self.url} does not answer as a vehicle of ours; {remedy}")
        data = read_plain(Document("the vehicle's answer", answer.content), "JSON", WrongAnswer, most=MAX_ANSWER)
        if answer.status == HTTPStatus.UNAUTHORIZED:
            raise Refusal(f"{self.url} refuses the token; give the one that serve printed with --token or --token-file")
        if answer.status >= HTTPStatus.BAD_REQUEST:
            raise Refusal(f"the vehicle refuses: {printable(str(data.get('error')))[:600]}")
        return data

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> "_Answer":
        connection = http.client.HTTPConnection(self.host, self.port, timeout=CONNECT_S)
        try:
            connection.connect()
            connection.sock.settimeout(self.stall_s)
            connection.request(method, path, body, headers | {"Authorization": f"Bearer {self.token}"})
            answer, content = connection.getresponse(), b""
            try:
                while len(content) < MAX_ANSWER and (block := answer.read1(1 << 16)):
                    content += block
            except (OSError, http.client.HTTPException):
                if not content:  # what came before the link was cut is good
                    raise
            return _Answer(answer.status, answer.getheader("ETag"), content, bool(answer.length))
        except (OSError, http.client.IncompleteRead) as problem:
            raise LinkCut(getattr(problem, "strerror", None) or printable(str(problem)) or "cut") from None
        except (http.client.HTTPException, ValueError) as problem:
            raise WrongAnswer(f"{self.url} does not speak HTTP ({printable(str(problem))[:60]}); check it") from None
        finally:
            connection.close()


class _Answer(NamedTuple):
    status: int
    tag: str | None
    content: bytes
    is_cut: bool


LEDGER, LEDGER_SCHEMA = "ledger.json", "automarine/link-ledger/1"
STATE_POLL_S = 1.0
SAME_HASH_TRIES = 3  # A log that comes so often with the same wrong hash is damaged where it comes from

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Collected:
    """The vehicle's last state, SHA-256 of every log that is here by name, how many are new, bytes and cuts; how the
    campaign ended early; why logs could not be fetched; what `run` made of them, or why there is no analysis."""

    state: State
    logs: dict[str, str]
    new: int
    bytes_in: int
    cuts: int
    ended_early: str = ""
    damaged: tuple[str, ...] = ()
    analysis: Any = None
    no_analysis: str = ""

    @property
    def waits_for(self) -> str:
        """What is missing before the logs can be analysed; empty where nothing is."""
        if not self.state.campaigns:
            return "the vehicle has no campaign; hand it one with --campaign"
        if not all(campaign.over for campaign in self.state.campaigns):
            return "a campaign is still played; run the same command again when it is over"
        if self.state.campaigns[-1].why_stopped:
            return "the last campaign was stopped; analyse what there is with `automarine init` and `automarine run`"
        return "a log could not be fetched; run the same command again when its cause is mended" if self.damaged else ""

    def to_json(self) -> dict[str, Any]:
        counts = {"new": self.new, "bytes": self.bytes_in, "cuts": self.cuts, "damaged": [*self.damaged]}
        analysis = None if self.analysis is None else self.analysis.to_json()
        state = {"schema": "automarine/collected/1", "state": asdict(self.state), "logs": self.logs}
        return state | counts | {"analysis": analysis}


@dataclass
class Collector:
    """Fetches the logs of a vehicle into `folder`; gives up after `wait_s` without contact (None: never). A log that
    was changed here is fetched again with `overwrite`, else refused."""

    client: Client
    folder: Path
    wait_s: float | None = None
    progress: Progress = silent
    overwrite: bool = False
    poll_s: float = STATE_POLL_S
    cuts: int = 0
    bytes_in: int = 0
    damaged: list[str] = field(default_factory=list)

    def collected(self, campaign: LinkCampaign | None, stop: bool) -> Collected:
        before = len(self.ledger())
        state = self.collect(campaign, stop)
        logs, last = self.ledger(), None if campaign is None else state.of(campaign.id)
        early = printable(last.says) if last is not None and last.played < last.runs else ""
        return Collected(state, logs, len(logs) - before, self.bytes_in, self.cuts, early, tuple(self.damaged))

    def collect(self, campaign: LinkCampaign | None, stop: bool) -> State:
        """Return the vehicle's last state, after the `campaign` is over (None: as it is now) and its logs are here.

        A damaged log keeps no other from being fetched. Raises SettingError for no contact, a wrong token, a refused
        campaign and an answer that makes no sense, OutputError for a folder that cannot be written."""
        with one_sentence(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        before = self._until_done(self.client.state)
        going = [campaign.id for campaign in before.campaigns if not campaign.over]
        if before.playing is not None and not any(before.playing.startswith(name[:ID_LETTERS]) for name in going):
            going = []  # its campaign is damaged, so that all are stopped
        if stop and (going or before.playing) and not self._until_done(lambda: self.client.stop(going)):
            remedy = "check the vehicle, and stop it by hand"
            raise SettingError(f"the vehicle has stopped its campaigns but is not silent yet; {remedy}")
        if campaign is not None:
            self._until_done(lambda: self.client.put_campaign(campaign.id, campaign.text.encode()))
        fetched = set[Log]()
        while True:
            state = self._until_done(self.client.state)
            logs = {log for log in self._until_done(self.client.listing).runs if log.closed}
            if new := sorted(logs - fetched, key=lambda log: log.name):
                self._fetch_all(new)
            fetched |= logs
            if campaign is None:
                return state
            if (answer := state.of(campaign.id)) is None:
                why = "".join(f"; {trouble}" for trouble in state.troubles)
                raise SettingError(
                    f"the vehicle does not know campaign {campaign.id[:ID_LETTERS]} any more; send it again{why}"
                )
            if answer.over:
                return state
            time.sleep(self.poll_s)

    def ledger(self) -> dict[str, str]:
        """Name and SHA-256 of every log that is here. Raises SettingError."""
        file = self.folder / LEDGER
        if not file.exists():
            return {}
        data = read_plain(file, "JSON", SettingError).get("runs")
        if not isinstance(data, Mapping):
            raise SettingError(f"{LEDGER}: no table of runs; rename the file, and the logs are looked at again")
        return {str(name): str(digest) for name, digest in data.items()}

    def _fetch_all(self, logs: Sequence[Log]) -> None:
        """Fetch logs, while no other `collect` writes to this folder; what is `damaged` comes after all others."""
        with ExitStack() as stack:
            for tries in count():
                try:
                    with one_sentence(self.folder):
                        stack.enter_context(held(self.folder / ".collect"))
                    break
                except HeldElsewhereError:
                    if not tries:
                        self.progress(f"another collect writes to {self.folder}, and is waited for", 0, 0)
                    time.sleep(self.poll_s)
            ledger = self.ledger()
            for log in logs:
                try:
                    self._fetch(log, ledger)
                except DamagedLogError as why:
                    self.damaged.append(str(why))

    def _fetch(self, log: Log, ledger: dict[str, str]) -> None:
        """One log, whole and with its hash, under its name; nothing to do where it is here."""
        name, digest, target = log.name, str(log.sha256), self.folder / log.name
        if ledger.get(name, digest) != digest:
            why = "compare both, for logs never change"
            raise DamagedLogError(f"{name} is another log now than when it was fetched; {why}")
        changed = target.exists() and sha256(target) != digest
        if changed and not self.overwrite:
            raise DamagedLogError(f"{name} was changed here since it was fetched; move it away, or give --overwrite")
        if changed or not target.exists():
            self._fetch_whole(target, log.size, digest)
        if name not in ledger:
            ledger[name] = digest
            runs = dict(sorted(ledger.items()))
            write_whole(self.folder / LEDGER, json_text({"schema": LEDGER_SCHEMA, "runs": runs}))

    def _fetch_whole(self, target: Path, size: int, digest: str) -> None:
        part, wrong = self.folder / f".{target.name}.part", Counter[str]()
        while wrong.total() < WrongAnswer.tries and SAME_HASH_TRIES not in wrong.values():
            self._fetch_rest(part, target.name, size)
            if (came := sha256(part)) == digest:
                with one_sentence(self.folder):
                    part.replace(target)
                    sync_folder(self.folder)
                return
            wrong[came] += 1
            part.unlink()
        if SAME_HASH_TRIES in wrong.values():
            blame = "always the same, so that its file on the vehicle is damaged; check the vehicle's disk"
        else:
            blame = "never the same, so that the link spoils it; look at the link, then run the same command again"
        times = f"{wrong.total()} times with another SHA-256 than it was closed with"
        raise DamagedLogError(f"{target.name} came {times}, {blame}")

    def _fetch_rest(self, part: Path, name: str, size: int) -> None:
        """What is missing of a log, piece by piece; what came stays, whatever happens."""
        with one_sentence(self.folder):
            file = part.open("ab")
        with file:
            if file.tell() > size:
                file.truncate(0)
            while (have := file.tell()) < size:
                came = self._until_done(lambda: self.client.piece(name, have, size))[: size - have]
                with one_sentence(self.folder):
                    file.write(came)
                    file.flush()
                self.bytes_in += len(came)
                self.cuts += len(came) < min(LOG_PIECE_BYTES, size - have)
                self.progress(f"fetching {name}", have + len(came), size)

    def _until_done(self, ask: Callable[[], Answer]) -> Answer:
        """The answer, however often the link is cut; SettingError after `wait_s`, and for senseless answers."""
        ends, wrong = None if self.wait_s is None else time.monotonic() + self.wait_s, 0
        while True:
            try:
                return ask()
            except WrongAnswer as answer:
                wrong += 1
                if wrong >= answer.tries:
                    raise
            except LinkCut as cut:
                if ends is not None and time.monotonic() >= ends:
                    raise SettingError(
                        f"no contact with {self.client.url} for {self.wait_s:g} s ({cut}); what came is kept, run the "
                        "same command again to go on"
                    ) from None
            self.cuts += 1
            time.sleep(min(self.poll_s, 0.2))
