"""The vehicle's folder: campaigns that were accepted, logs that were closed, and the marks between its two processes.

Nothing here is ever changed once it has its name: a file is written beside its place, sent to the disk, and
renamed. What is known of a campaign is told by which logs there are, so a power cut loses no count.
"""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.errors import OutputError, SettingError
from automarine_cli.link.document import ENDS, INTERRUPTED, SHORT, LinkCampaign, PlannedRun, campaign_in
from automarine_cli.pipeline.manifest import sha256
from automarine_cli.pipeline.one_file import write_whole
from automarine_cli.pipeline.staging import sync_folder

STATE_SCHEMA = "automarine/link-state/1"
ASKED = "asked to stop"


@dataclass(frozen=True)
class Log:
    """A log in the folder; one that is still written has no hash."""

    name: str
    size: int
    sha256: str | None

    def to_json(self) -> dict[str, object]:
        """As it is listed."""
        return {"name": self.name, "size": self.size, "sha256": self.sha256, "closed": self.sha256 is not None}


@dataclass(frozen=True)
class Store:
    """A folder of campaigns and runs."""

    folder: Path

    @property
    def runs(self) -> Path:
        """Where logs are."""
        return self.folder / "runs"

    @property
    def campaigns(self) -> Path:
        """Where campaigns are, numbered in the order in which they came."""
        return self.folder / "campaigns"

    @property
    def lease(self) -> Path:
        """What the server touches while it lives; holds the word of the server that wrote it."""
        return self.folder / "lease"

    def prepare(self) -> None:
        """Make the folders. Raises OutputError."""
        try:
            for folder in (self.runs, self.campaigns):
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise OutputError(f"{self.folder} cannot be written to ({problem.strerror}); give another folder") from None

    def accepted(self) -> list[LinkCampaign]:
        """Every campaign, the first first."""
        return [campaign_in(path.read_bytes()) for path in sorted(self.campaigns.glob("*.json"))]

    def accept(self, content: bytes, name: str) -> bool:
        """Keep a campaign whose document has the hash `name`; False where it is here already.

        For one caller at a time. Raises SettingError for another hash, a document that is none, and a campaign that
        the battery does not carry.
        """
        if (found := hashlib.sha256(content).hexdigest()) != name:
            raise SettingError(f"the campaign has the SHA-256 {found[:12]}..., not {name[:12]}...; try again")
        campaign = campaign_in(content)
        if campaign.text.encode() != content:
            raise SettingError("the campaign is not written as `automarine collect` writes it; use that to send it")
        campaign.refuse_beyond_reserve()
        there = sorted(self.campaigns.glob("*.json"))
        if any(path.stem.endswith(f"_{name}") for path in there):
            return False
        if any(path.stem.partition("_")[2][:SHORT] == name[:SHORT] for path in there):
            raise SettingError("another campaign here has an id that begins alike; make the plan with another --seed")
        write_whole(self.campaigns / f"{len(there) + 1:04d}_{name}.json", campaign.text)
        sync_folder(self.campaigns)
        return True

    def stop(self, why: str = ASKED, *only: LinkCampaign) -> None:
        """Mark every campaign here, or `only` some, as stopped, for good."""
        for campaign in only or self.accepted():
            if not self.is_stopped(campaign) and self.next_run(campaign) is not None:
                write_whole(self._stop_mark(campaign), why)
        sync_folder(self.campaigns)

    def is_stopped(self, campaign: LinkCampaign) -> bool:
        """Whether it was stopped."""
        return self._stop_mark(campaign).exists()

    def ended(self, name: str) -> str | None:
        """How a run ended, its mark; None where it was not played, or is being played."""
        return next((mark for mark in ENDS if (self.runs / f"{name}{mark}.csv").exists()), None)

    def next_run(self, campaign: LinkCampaign) -> int | None:
        """Which run is the first without a closed log; None after the last."""
        played = (self.ended(campaign.log_name(run)) is not None for run in campaign.runs)
        return next((number for number, is_played in enumerate(played) if not is_played), None)

    def part(self, name: str) -> Path:
        """The log that is being written."""
        return self.runs / f"{name}.part"

    def begin(self, name: str) -> int:
        """Open a run's log, known to the disk before anything is commanded: the run will never be begun again."""
        number = os.open(self.part(name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        sync_folder(self.runs)
        return number

    def close(self, name: str, mark: str) -> None:
        """Close a run's log: its hash beside it, then its name, which nothing changes after that.

        A run that was cut before its log had a line is forgotten: nothing was commanded.
        """
        part, log = self.part(name), self.runs / f"{name}{mark}.csv"
        if mark and not part.stat().st_size:
            part.unlink()
            sync_folder(self.runs)
            return
        content = part.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]  # a power cut may leave half a line
        with part.open("r+b") as file:
            file.truncate(len(whole))
            os.fsync(file.fileno())
        write_whole(_hash_file(log), f"{hashlib.sha256(whole).hexdigest()}  {log.name}\n")
        part.replace(log)
        sync_folder(self.runs)

    def close_leftovers(self) -> None:
        """Close what a player that was killed, or a power cut, left open; for who alone plays."""
        for part in sorted(self.runs.glob("*.part")):
            self.close(part.stem, INTERRUPTED)

    def logs(self) -> Iterator[Log]:
        """Every log, closed ones with the hash that they were closed with."""
        for path in sorted((*self.runs.glob("*.csv"), *self.runs.glob("*.part"))):
            try:
                yield Log(path.name, path.stat().st_size, self._hash_of(path) if path.suffix == ".csv" else None)
            except FileNotFoundError:  # closed meanwhile; the next list has it
                continue

    def is_playing(self) -> bool:
        """Whether a log is open."""
        return any(self.runs.glob("*.part"))

    def state(self) -> dict[str, Any]:
        """What the vehicle is at: schema automarine/link-state/1."""
        playing = next((path.stem for path in self.runs.glob("*.part")), None)
        campaigns = [self._campaign_state(one) for one in self.accepted()]
        return {"schema": STATE_SCHEMA, "playing": playing, "campaigns": campaigns}

    def _campaign_state(self, campaign: LinkCampaign) -> dict[str, object]:
        ends = [self.ended(campaign.log_name(run)) for run in campaign.runs]
        played, stopped = sum(end is not None for end in ends), self.is_stopped(campaign)
        names = [campaign.log_name(run) for run in campaign.runs]
        open_run = any(self.part(name).exists() for name in names)
        return {
            "id": campaign.id,
            "runs": len(ends),
            "played": played,
            "interrupted": ends.count(INTERRUPTED),
            "over": (stopped and not open_run) or played == len(ends),
            "why_stopped": (self._stop_mark(campaign).read_text(encoding="utf-8") or ASKED) if stopped else None,
            "battery_left_Ah": round(campaign.left(played), 3) if played else campaign.battery.charge_Ah,
        }

    def _stop_mark(self, campaign: LinkCampaign) -> Path:
        return self.campaigns / f"{campaign.id}.stopped"

    def _hash_of(self, log: Path) -> str:
        try:
            return _hash_file(log).read_text(encoding="ascii")[:64]
        except FileNotFoundError:  # a log that somebody put there
            return sha256(log)


def _hash_file(log: Path) -> Path:
    return log.with_name(f"{log.name}.sha256")


def waiting(store: Store) -> Iterator[tuple[LinkCampaign, int, PlannedRun]]:
    """Campaign, number and run of what is to be played next, as long as there is something."""
    for campaign in store.accepted():
        while not store.is_stopped(campaign) and (number := store.next_run(campaign)) is not None:
            yield campaign, number, campaign.runs[number]
