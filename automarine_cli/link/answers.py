"""What the vehicle answers: its state and its list of logs, as both sides know them; plain data, and checked."""

import re
from dataclasses import dataclass
from typing import Literal

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import told

STATE_SCHEMA: Literal["automarine/link-state/1"] = "automarine/link-state/1"
RUNS_SCHEMA: Literal["automarine/link-runs/1"] = "automarine/link-runs/1"
LOG_NAME = re.compile(r"[A-Za-z0-9+_-][A-Za-z0-9+_.-]{0,140}\.(csv|part)")
SHA256 = re.compile("[0-9a-f]{64}")
LARGEST_LOG = 1 << 32


@dataclass(frozen=True)
class CampaignState:
    """How far a campaign is; `why_stopped` where somebody or something stopped it."""

    id: str
    runs: int
    played: int
    interrupted: int
    over: bool
    battery_left_Ah: float
    why_stopped: str | None = None

    def __post_init__(self) -> None:
        if not SHA256.fullmatch(self.id):
            raise SettingError(f"id is {told(self.id)}; expected the SHA-256 of a campaign")

    @property
    def says(self) -> str:
        ended = f"campaign {self.id[:8]} ended after {self.played} of {self.runs} runs"
        return ended if self.why_stopped is None else f"{ended}: {self.why_stopped}"


@dataclass(frozen=True)
class State:
    """What the vehicle is at: the open log, every campaign, and sentences on what in its folder is not right."""

    schema: Literal["automarine/link-state/1"]
    campaigns: tuple[CampaignState, ...]
    playing: str | None = None
    troubles: tuple[str, ...] = ()

    def of(self, campaign_id: str) -> CampaignState | None:
        return next((one for one in self.campaigns if one.id == campaign_id), None)


@dataclass(frozen=True)
class Log:
    """A log in the vehicle's folder; one that is still written has no hash."""

    name: str
    size: int
    closed: bool
    sha256: str | None = None

    def __post_init__(self) -> None:
        if not LOG_NAME.fullmatch(self.name) or not 0 <= self.size < LARGEST_LOG:
            raise SettingError(f"a log cannot be called {told(self.name)} and have {told(self.size)} bytes")
        if self.closed and not (self.sha256 and SHA256.fullmatch(self.sha256) and self.name.endswith(".csv")):
            raise SettingError(f"{self.name} is closed and has the SHA-256 {told(self.sha256)}; expected 64 hex digits")


@dataclass(frozen=True)
class Listing:
    schema: Literal["automarine/link-runs/1"]
    runs: tuple[Log, ...]
