"""What crosses the link: a campaign, known by its SHA-256, and the vehicle's state and list of logs."""

import hashlib
import re
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Codec, Document, json_text, read_plain, to_mapping
from automarine_cli.planning.candidates import PLAN, PaperRun, Supply
from automarine_cli.simulation.specification import AboveZero, Limit, Settings, ZeroOrMore
from automarine_cli.text import format_value, printable

CAMPAIGN_SCHEMA = "automarine/link-campaign/1"
STATE_SCHEMA: Literal["automarine/link-state/1"] = "automarine/link-state/1"
RUNS_SCHEMA: Literal["automarine/link-runs/1"] = "automarine/link-runs/1"
LOG_NAME = re.compile(r"[A-Za-z0-9+_-][A-Za-z0-9+_.-]{0,140}\.(csv|part)")
SHA256 = re.compile("[0-9a-f]{64}")
MAX_LOG_BYTES = 1 << 32
MAX_CAMPAIGN_BYTES = 4_000_000
MAX_CAMPAIGN_RUNS, MAX_COMMANDS, MAX_RUN_S = 500, 1000, 3600.0
SAFE_NAME = re.compile(r"[A-Za-z0-9+_-][A-Za-z0-9+_.-]{0,99}(?<!\.)")
WHOLE, STOPPED, INTERRUPTED = "", "_stopped", "_interrupted"
RUN_ENDINGS = (WHOLE, STOPPED, INTERRUPTED)  # what the names of logs end with, by how their runs ended
MAX_LOG_HZ, MAX_LINE_BYTES, MAX_HEAD_BYTES = 100.0, 200, 4096  # lines a second, bytes of a line, of the head
ID_LETTERS = 8  # so many letters of a campaign's id begin the names of its logs


@dataclass(frozen=True)
class PlannedRun(Settings):
    """One run: `commands` (moment, seconds) follow the rest at its start; the water needs `wait_s` after it."""

    name: str
    commands: tuple[tuple[float, float], ...]
    start_heading_deg: float = 0.0
    wait_s: ZeroOrMore = 0.0

    def __post_init__(self) -> None:
        if not SAFE_NAME.fullmatch(self.name):
            raise SettingError(f"name is {self.name!r}; expected at most 100 letters, digits and - + _ .")
        if self.name.endswith(RUN_ENDINGS[1:]):
            raise SettingError(f"name is {self.name!r}; expected another end, this one marks runs that were cut short")
        super().__post_init__()
        if not 0 < len(self.commands) <= MAX_COMMANDS:
            raise SettingError(f"commands has {len(self.commands)} entries; expected 1 to {MAX_COMMANDS}")
        if min(seconds for _, seconds in self.commands) <= 0:
            raise SettingError("commands holds a time that is not above 0; expected [moment, seconds] pairs")
        if self.driven_s > MAX_RUN_S or self.wait_s > MAX_RUN_S:
            raise SettingError(f"lasts or waits {max(self.driven_s, self.wait_s):g} s; expected {MAX_RUN_S:g} at most")

    @property
    def driven_s(self) -> float:
        return self.candidate.driven_s

    @property
    def candidate(self) -> PaperRun:
        return PaperRun("planned", self.name, self.commands, start_heading=self.start_heading_deg)


@dataclass(frozen=True)
class CampaignBattery(Settings):
    """What is stored and must stay, and what is drawn: `idle_A` always, `full_A` more at the moment `at_moment`."""

    charge_Ah: AboveZero
    reserve_percent: Annotated[float, Limit(0.0, 99.0)]
    idle_A: ZeroOrMore
    full_A: ZeroOrMore
    at_moment: AboveZero

    @property
    def supply(self) -> Supply:
        return Supply(self.idle_A, self.full_A, self.at_moment)


@dataclass(frozen=True)
class LinkCampaign(Settings):
    """Runs in order, each logged at `rate_hz` from `rest_s` before its first command; moments in `moment_unit`."""

    schema: Literal["automarine/link-campaign/1"]
    moment_unit: Literal["nu", "N m"]
    rate_hz: Annotated[float, Limit(0.5, 200.0)]
    rest_s: Annotated[float, Limit(0.0, 60.0)]
    battery: CampaignBattery
    runs: tuple[PlannedRun, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < len(self.runs) <= MAX_CAMPAIGN_RUNS:
            raise SettingError(f"runs has {len(self.runs)} entries; expected 1 to {MAX_CAMPAIGN_RUNS}")
        names = [run.name for run in self.runs]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise SettingError(f"runs holds {twice!r} more than once; expected a name of its own for each run")
        for run in self.runs:
            if (largest := max(abs(moment) for moment, _ in run.commands)) > self.battery.at_moment:
                raise SettingError(
                    f"run {run.name!r} has a moment of {largest:g}; expected {self.battery.at_moment:g} at most, the "
                    "moment that battery.full_A is given for"
                )

    @property
    def text(self) -> str:
        return json_text(to_mapping(self))

    @cached_property
    def id(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()

    def log_name(self, run: PlannedRun) -> str:
        return f"{self.id[:ID_LETTERS]}_{run.name}"

    def room(self, run: PlannedRun) -> int:
        """Bytes that a run's log has at most, unless its vehicle speaks more, or more often, than any we know."""
        lines = max(MAX_LOG_HZ, self.rate_hz) * (self.rest_s + run.driven_s + 1.0)
        return int(lines * MAX_LINE_BYTES) + MAX_HEAD_BYTES

    def begins(self, number: int) -> float:
        return round(sum(self.rest_s + run.driven_s + run.wait_s for run in self.runs[:number]), 3)

    def charge(self, number: int) -> float:
        """Charge [Ah] of a battery that was full, after so many runs and the waits between them."""
        supply = self.battery.supply
        drawn = sum(supply.drawn(run.candidate, self.rest_s) for run in self.runs[:number])
        return self.battery.charge_Ah - drawn - supply.idle * sum(run.wait_s for run in self.runs[: number - 1]) / 3600

    def refuse_beyond_reserve(self) -> None:
        """Raise SettingError with the run at which the reserve of the battery would be reached."""
        reserve = self.battery.charge_Ah * self.battery.reserve_percent / 100.0
        for number, run in enumerate(self.runs, 1):
            if (charge := self.charge(number)) < reserve:
                raise SettingError(
                    f"the battery does not carry this campaign: in run {number} of {len(self.runs)}, {run.name}, it "
                    f"falls to {charge:.3g} Ah of {self.battery.charge_Ah:g}, below the reserve of {reserve:.3g} Ah; "
                    "plan fewer or shorter runs"
                )


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
            raise SettingError(f"id is {format_value(self.id)}; expected the SHA-256 of a campaign")

    @property
    def says(self) -> str:
        ended = f"campaign {self.id[:8]} ended after {self.played} of {self.runs} runs"
        return ended if self.why_stopped is None else f"{ended}: {self.why_stopped}"


@dataclass(frozen=True)
class State:
    """The open log, every campaign, and sentences on what is wrong, or is driven without being sent anew."""

    schema: Literal["automarine/link-state/1"]
    campaigns: tuple[CampaignState, ...]
    playing: str | None = None
    troubles: tuple[str, ...] = ()

    def of(self, campaign_id: str) -> CampaignState | None:
        return next((campaign for campaign in self.campaigns if campaign.id == campaign_id), None)


@dataclass(frozen=True)
class Log:
    """A log in the vehicle's folder; one that is still written has no hash."""

    name: str
    size: int
    closed: bool
    sha256: str | None = None

    def __post_init__(self) -> None:
        if not LOG_NAME.fullmatch(self.name) or not 0 <= self.size < MAX_LOG_BYTES:
            raise SettingError(
                f"a log cannot be called {format_value(self.name)} or hold {format_value(self.size)} B: check its host"
            )
        if self.closed and not (self.sha256 and SHA256.fullmatch(self.sha256) and self.name.endswith(".csv")):
            raise SettingError(
                f"{self.name} is closed and has the SHA-256 {format_value(self.sha256)}; expected 64 hex digits"
            )


@dataclass(frozen=True)
class Listing:
    schema: Literal["automarine/link-runs/1"]
    runs: tuple[Log, ...]


def read_campaign(path: Path) -> LinkCampaign:
    """The campaign in a folder that `automarine plan` wrote, its plan.json, or a document. Raises SettingError."""
    file = path / PLAN.file if path.is_dir() else path
    data = read_plain(file, "JSON", SettingError, most=MAX_CAMPAIGN_BYTES)
    where = printable(file.name)
    if data.get("schema") == PLAN.schema:
        plan = PLAN.of(data, where, SettingError)
        battery = {**plan.battery, **plan.supply}
        data = {
            "schema": CAMPAIGN_SCHEMA, "moment_unit": plan.moment_unit, "rate_hz": plan.rate_hz, "rest_s": plan.rest_s,
            "runs": [{f.name: run[f.name] for f in fields(PlannedRun) if f.name in run} for run in plan.planned],
            "battery": {f.name: battery[f.name] for f in fields(CampaignBattery) if f.name in battery},
        }  # fmt: skip
    return Codec(where).read(LinkCampaign, data)


def campaign_in(content: bytes) -> LinkCampaign:
    data = read_plain(Document("campaign", content), "JSON", SettingError, most=MAX_CAMPAIGN_BYTES)
    return Codec("campaign").read(LinkCampaign, data)
