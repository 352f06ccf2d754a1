"""`collect`: on the surface, hands a campaign to the vehicle and fetches its logs, over any link that is cut; then,
if it is asked to, has them analysed."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from automarine_cli.errors import SettingError
from automarine_cli.link.answers import State
from automarine_cli.link.client import Client
from automarine_cli.link.collector import Collector
from automarine_cli.link.document import SHORT, read_campaign
from automarine_cli.pipeline.words import printable
from automarine_cli.report.tables import Table
from automarine_cli.workflows.campaign_file import read_campaign as read_analysis
from automarine_cli.workflows.command import Command, Runner
from automarine_cli.workflows.init import NAME, InitOptions, init
from automarine_cli.workflows.run import CampaignRun, RunOptions, run_campaign
from automarine_cli.workflows.view import View

SCHEMA = "automarine/collected/1"
ANALYSIS = "analysis"
"""Where in the folder of logs the results are."""


@dataclass(frozen=True)
class Collected:
    """The vehicle's last state, name and SHA-256 of every log that is here, how many came now, bytes and cuts; what
    the `analysis` of the logs did, or why there is none yet, if one was asked for; how the campaign that was handed
    over ended, if that was before its last run."""

    state: State
    runs: dict[str, str]
    new: int
    bytes_in: int
    cuts: int
    analysis: CampaignRun | None = None
    no_analysis: str = ""
    ended_early: str = ""

    def to_json(self) -> dict[str, Any]:
        """Schema automarine/collected/1."""
        return {
            "schema": SCHEMA, "state": asdict(self.state), "logs": self.runs, "new": self.new, "bytes": self.bytes_in,
            "cuts": self.cuts, "analysis": None if self.analysis is None else self.analysis.to_json(),
        }  # fmt: skip

    def tables(self) -> tuple[Table | str, ...]:
        """How far each campaign is, and what was fetched."""
        rows = tuple(
            (one.id[:SHORT], f"{one.played} of {one.runs}", str(one.interrupted),
             printable(one.why_stopped or ("over" if one.over else "going on")), f"{one.battery_left_Ah:g}")
            for one in self.state.campaigns
        )  # fmt: skip
        table = Table("Campaigns", ("campaign", "runs", "interrupted", "state", "battery left Ah"), rows)
        came = f"{self.new} logs fetched, {self.bytes_in} bytes, {self.cuts} cuts; {len(self.runs)} are here."
        run = () if self.analysis is None else self.analysis.tables()
        troubles = (f"On the vehicle {printable(trouble)}." for trouble in self.state.troubles)
        return (*([table] if rows else []), came, *troubles, *run, *([self.no_analysis] if self.no_analysis else []))


@dataclass(frozen=True)
class CollectOptions:
    """The vehicle's address and token; a campaign for it, whether it is to stop first, how long [s] to go without
    contact (None: as long as it takes), and what comes `then`, when all campaigns are over."""

    url: str
    token: str = ""
    campaign: Path | None = None
    stop: bool = False
    wait: float | None = None
    then: Literal["run"] | None = None


def _collect(asked: CollectOptions, runner: Runner) -> Collected:
    """Fetch the logs of the vehicle at `url` into the folder `out`, after it was handed a `campaign`, if any, and has
    played it; then run the campaign file `campaign.toml` in that folder, which is made where there is none.

    Raises SettingError, OutputError, and what `init` and `run` raise."""
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
    found = Collected(state, runs, len(runs) - before, collector.crossing.bytes_in, collector.crossing.cuts)
    last = None if campaign is None else state.of(campaign.id)
    if last is not None and last.played < last.runs:
        found = replace(found, ended_early=printable(last.says))
    if asked.then is None:
        return found
    if waits_for := _waits_for(state):
        return replace(found, no_analysis=f"No analysis was started: {waits_for}.")
    return replace(found, analysis=_analysed(runner.out, runs, runner))


def _waits_for(state: State) -> str:
    """What is missing before the logs can be analysed; empty where nothing is."""
    if not state.campaigns:
        return "the vehicle has no campaign; hand it one with --campaign"
    if not all(one.over for one in state.campaigns):
        return "a campaign is still played; run the same command again when it is over"
    if state.campaigns[-1].why_stopped:
        return "the last campaign was stopped; analyse what there is with `automarine init` and `automarine run`"
    return ""


def _analysed(folder: Path, logs: Iterable[str], runner: Runner) -> CampaignRun:
    """What `run` makes of the logs. Raises SettingError for a campaign file that leaves some of them out."""
    file = folder / NAME
    if not file.exists():
        init.run(InitOptions(folder), replace(runner, out=file))
    named = {log.path.name for log in read_analysis(file).every_log()}
    if left := sorted(set(logs) - named):
        raise SettingError(
            f"{NAME} in {folder} leaves out {len(left)} of {len(set(logs))} logs, such as {left[0]}; add them, or move "
            "the file away, and it is written anew"
        )
    return run_campaign.run(RunOptions(file), replace(runner, out=folder / ANALYSIS))


collect = Command(
    "collect", CollectOptions, _collect, {Collected: View(Collected.tables, lambda result: iter(result.runs))},
)  # fmt: skip
