"""The surface's side: on contact state, stop, campaign, then logs; goes on after any cut where it was."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.link.client import PIECE, Client, LinkCut, WrongAnswer
from automarine_cli.link.document import SHORT, LinkCampaign, Log, State
from automarine_cli.link.store import sync_folder
from automarine_cli.pipeline.manifest import sha256
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import json_text, read_plain
from automarine_cli.pipeline.results_folder import one_sentence, write_whole
from automarine_cli.pipeline.words import printable

LEDGER, LEDGER_SCHEMA = "ledger.json", "automarine/link-ledger/1"
POLL_S = 1.0
TRIES = 3
"""How often a log with a wrong hash is fetched again."""

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Collected:
    """The vehicle's last state, name and SHA-256 of every log that is here, how many came now, bytes and cuts; how the
    campaign that was handed over ended, if that was before its last run; what `run` made of the logs, or why there is
    no analysis yet, if one was asked for."""

    state: State
    logs: dict[str, str]
    new: int
    bytes_in: int
    cuts: int
    ended_early: str = ""
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
        return ""

    def to_json(self) -> dict[str, Any]:
        counts = {"new": self.new, "bytes": self.bytes_in, "cuts": self.cuts}
        analysis = None if self.analysis is None else self.analysis.to_json()
        state = {"schema": "automarine/collected/1", "state": asdict(self.state), "logs": self.logs}
        return state | counts | {"analysis": analysis}


@dataclass
class Collector:
    """Fetches the logs of a vehicle into `folder`; gives up after `wait_s` without contact (None: never).

    A log that was changed here is fetched again with `overwrite`, else refused. `cuts` and `bytes_in` count what
    crossed the link."""

    client: Client
    folder: Path
    wait_s: float | None = None
    progress: Progress = silent
    overwrite: bool = False
    poll_s: float = POLL_S
    cuts: int = 0
    bytes_in: int = 0

    def collected(self, campaign: LinkCampaign | None, stop: bool) -> Collected:
        before = len(self.ledger())
        state = self.collect(campaign, stop)
        logs, last = self.ledger(), None if campaign is None else state.of(campaign.id)
        early = printable(last.says) if last is not None and last.played < last.runs else ""
        return Collected(state, logs, len(logs) - before, self.bytes_in, self.cuts, early)

    def collect(self, campaign: LinkCampaign | None, stop: bool) -> State:
        """The vehicle's last state, after the `campaign` is over (None: as it is now) and its logs are here.

        Raises SettingError for no contact, a wrong token, a refused campaign, an answer that makes no sense and a log
        that is not what it was closed as, OutputError for a folder that cannot be written.
        """
        with one_sentence(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        going = [one.id for one in self._until_done(self.client.state).campaigns if not one.over]
        if stop and going and not self._until_done(lambda: self.client.stop(going)):
            raise SettingError(
                "the vehicle has stopped its campaigns but is not silent yet; check the vehicle, and stop it by hand"
            )
        if campaign is not None:
            content = campaign.text.encode()
            self._until_done(lambda: self.client.put_campaign(campaign.id, content))
        ledger, here = self.ledger(), set[Log]()
        while True:
            state = self._until_done(self.client.state)
            logs = {log for log in self._until_done(self.client.listing).runs if log.closed}
            for log in sorted(logs - here, key=lambda one: one.name):
                self._fetch(log, ledger)
            here |= logs
            if campaign is None:
                return state
            if (found := state.of(campaign.id)) is None:
                why = "".join(f"; {trouble}" for trouble in state.troubles)
                raise SettingError(
                    f"the vehicle does not know campaign {campaign.id[:SHORT]} any more; send it again{why}"
                )
            if found.over:
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
        return {str(name): str(found) for name, found in data.items()}

    def _fetch(self, log: Log, ledger: dict[str, str]) -> None:
        """One log, whole and with its hash, under its name; nothing to do where it is here."""
        name, wanted, target = log.name, str(log.sha256), self.folder / log.name
        if ledger.get(name, wanted) != wanted:
            raise SettingError(
                f"{name} is another log now than when it was fetched; compare both, for logs never change"
            )
        changed = target.exists() and sha256(target) != wanted
        if changed and not self.overwrite:
            raise SettingError(f"{name} was changed here since it was fetched; move it away, or give --overwrite")
        if changed or not target.exists():
            self._fetch_whole(target, log.size, wanted)
        if name not in ledger:
            ledger[name] = wanted
            runs = dict(sorted(ledger.items()))
            write_whole(self.folder / LEDGER, json_text({"schema": LEDGER_SCHEMA, "runs": runs}))

    def _fetch_whole(self, target: Path, size: int, wanted: str) -> None:
        part = self.folder / f".{target.name}.part"
        for _ in range(TRIES):
            self._fetch_rest(part, target.name, size)
            if sha256(part) == wanted:
                with one_sentence(self.folder):
                    part.replace(target)
                    sync_folder(self.folder)
                return
            part.unlink()
        raise SettingError(
            f"{target.name} came {TRIES} times with another SHA-256 than it was closed with; its file on the vehicle "
            "is damaged, or it is not the vehicle that answers"
        )

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
                self.cuts += len(came) < min(PIECE, size - have)
                self.progress(f"fetching {name}", have + len(came), size)

    def _until_done(self, ask: Callable[[], Answer]) -> Answer:
        """The answer, however often the link is cut before it comes; SettingError after `wait_s` without any, and for
        one that makes no sense, or refuses, again and again."""
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
                        f"no contact with {self.client.url} for {self.wait_s:g} s ({cut}); "
                        "what came is kept, run the same command again to go on"
                    ) from None
            self.cuts += 1
            time.sleep(min(self.poll_s, 0.2))
