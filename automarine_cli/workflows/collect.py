"""`collect`: on the surface, hands a campaign to the vehicle and fetches its logs, over any link that is cut."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.errors import SettingError
from automarine_cli.link.client import Client
from automarine_cli.link.collector import Collector
from automarine_cli.link.document import read_campaign
from automarine_cli.report.tables import Table
from automarine_cli.workflows.command import Command, Runner
from automarine_cli.workflows.view import View

SCHEMA = "automarine/collected/1"


@dataclass(frozen=True)
class Collected:
    """The vehicle's last state, name and SHA-256 of every log that is here, how many came now, bytes and cuts."""

    state: dict[str, Any]
    runs: dict[str, str]
    new: int
    bytes_in: int
    cuts: int

    def to_json(self) -> dict[str, Any]:
        """Schema automarine/collected/1."""
        return {
            "schema": SCHEMA, "state": self.state, "logs": self.runs, "new": self.new, "bytes": self.bytes_in,
            "cuts": self.cuts,
        }  # fmt: skip

    def tables(self) -> tuple[Table | str, ...]:
        """How far each campaign is, and what was fetched."""
        rows = tuple(
            (str(one["id"])[:8], f"{one['played']} of {one['runs']}", str(one["interrupted"]),
             str(one["why_stopped"] or ("over" if one["over"] else "going on")), f"{one['battery_left_Ah']:g}")
            for one in self.state["campaigns"]
        )  # fmt: skip
        table = Table("Campaigns", ("campaign", "runs", "interrupted", "state", "battery left Ah"), rows)
        came = f"{self.new} logs fetched, {self.bytes_in} bytes, {self.cuts} cuts; {len(self.runs)} are here."
        return (*([table] if rows else []), came)


@dataclass(frozen=True)
class CollectOptions:
    """The vehicle's address and token; a campaign for it, whether it is to stop first, and how long [s] to go without
    contact (None: as long as it takes)."""

    url: str
    token: str = ""
    campaign: Path | None = None
    stop: bool = False
    wait: float | None = None


def _collect(asked: CollectOptions, runner: Runner) -> Collected:
    """Fetch the logs of the vehicle at `url` into the folder `out`, after it was handed a `campaign`, if any, and has
    played it. Raises SettingError, OutputError."""
    if runner.out is None:
        raise SettingError("logs need a folder; give one with -o DIR")
    campaign = None if asked.campaign is None else read_campaign(Path(asked.campaign))
    if campaign is not None:
        campaign.refuse_beyond_reserve()
    client = Client.of(asked.url, asked.token)
    collector = Collector(client, runner.out, asked.wait, runner.progress, runner.overwrite)
    before = len(collector.ledger())
    state = collector.collect(campaign, asked.stop)
    runs = collector.ledger()
    return Collected(state, runs, len(runs) - before, collector.crossing.bytes_in, collector.crossing.cuts)


collect = Command(
    "collect", CollectOptions, _collect, {Collected: View(Collected.tables, lambda result: iter(result.runs))},
    repeats=False,
)  # fmt: skip
