"""`run` of several campaigns, a fleet or a season: each by itself on a process or a worker, and an overview of all."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.logs import with_joined
from automarine_cli.pipeline.codec import to_mapping
from automarine_cli.pipeline.manifest import Input
from automarine_cli.pipeline.outputs import ResultFolder, refuse_unfit
from automarine_cli.pipeline.parallel import ordered_stream
from automarine_cli.pipeline.parcel import Parcel, content_of, install, packed, place_of, without_dots
from automarine_cli.report.campaign_tables import campaigns_table
from automarine_cli.report.tables import Table
from automarine_cli.results.judged import StepDone
from automarine_cli.workflows.campaign_file import read_campaign
from automarine_cli.workflows.campaign_steps import NAMES
from automarine_cli.workflows.command import UNRECORDED, Command, Runner, reads
from automarine_cli.workflows.run import run_campaign
from automarine_cli.workflows.view import View

SCHEMA = "automarine/campaigns/1"
COMMAND = "campaigns"
STAGE = "running campaigns"


@dataclass(frozen=True)
class Outcome:
    """What became of one campaign: its name here and its title, the steps of its result file with what each says,
    whatever was refused, and what the steps' manifests warn of."""

    name: str
    title: str
    steps: tuple[StepDone, ...]
    says: Mapping[str, str]
    cautions: tuple[str, ...]
    refused: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """One entry of the overview."""
        return {
            "name": self.name,
            "title": self.title,
            "steps": [to_mapping(one) | {"says": self.says.get(one.step, "")} for one in self.steps],
            "cautions": list(self.cautions),
            "refused": list(self.refused),
        }


@dataclass(frozen=True)
class Campaigns:
    """What `run` of several campaigns did, in the order in which they were given."""

    outcomes: tuple[Outcome, ...]

    @property
    def refused(self) -> tuple[Outcome, ...]:
        """Campaigns of which something was refused."""
        return tuple(one for one in self.outcomes if one.refused)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the campaigns warn of, each with its name."""
        return tuple(f"{one.name}: {warning}" for one in self.outcomes for warning in one.warnings)

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/campaigns/1."""
        return {"schema": SCHEMA, "campaigns": [one.to_json() for one in self.outcomes]}

    def table(self) -> Table:
        """One line a campaign: the model, what validation and diagnosis say, what was refused."""
        return campaigns_table([(one.name, one.says, one.refused) for one in self.outcomes])


@dataclass(frozen=True)
class _Task:
    """One campaign on its way: where it is and, on its way to another machine, the bytes it needs."""

    name: str
    campaign: Path
    out: Path
    settings: Mapping[str, Any]
    parcel: Parcel | None = None
    refused: str = ""


@dataclass(frozen=True)
class CampaignsOptions:
    """Campaign files; `until` names the last step to do, with `force` every step is done again."""

    campaigns: Sequence[Path] = field(metadata=reads("files", "campaign"))
    force: bool = field(default=False, metadata=UNRECORDED)
    until: str | None = None


def _run_campaigns(asked: CampaignsOptions, runner: Runner) -> Campaigns:
    """Run each campaign as `run_campaign` does, into a folder of its own in `out`, and write an overview of all.

    The campaigns go side by side to `jobs` processes, or to the workers of the Dask scheduler at `cluster`, with their
    logs and with the results that are there: no common disk is needed, and the results are the same bytes. A campaign
    that is refused is told in the overview; the others go on. Raises SettingError for campaigns given twice, for no
    folder, and for a cluster that cannot be reached, and OutputError.
    """
    campaigns, until, out, cluster = asked.campaigns, asked.until, runner.out, runner.cluster
    if until is not None and until not in NAMES:
        raise SettingError(f"no step is called {until!r}; give one of {', '.join(NAMES)}")
    if out is None:
        raise SettingError("several campaigns need a folder for their results; give one")
    refuse_unfit(out)
    settings = {"overwrite": runner.overwrite, "force": asked.force, "until": until}
    named = zip(names_of(campaigns), campaigns)
    tasks = [_Task(name, path, out / name, settings) for name, path in named]
    prepare, work = (None, _done) if cluster is None else (_packed, _done_elsewhere)
    outcomes = []
    found = ordered_stream(
        work, tasks, runner.jobs, cluster=cluster, progress=runner.progress, stage=STAGE, prepare=prepare, at_once=1
    )
    for (outcome, content), task in zip(found, tasks):  # in this order the stream is taken to its end
        if content is not None:
            install(content, task.out)
        outcomes.append(outcome)
    result = Campaigns(tuple(outcomes))
    inputs = [Input(name, path, "campaign") for name, path in zip(_below(campaigns), campaigns)]
    return replace(runner, overwrite=True).results(asked, lambda: result, _write, inputs)


def _write(folder: ResultFolder, result: Campaigns) -> None:
    folder.write_json("campaigns.json", result.to_json())
    folder.write("campaigns.csv", result.table().to_csv())


def _below(campaigns: Sequence[Path]) -> list[str]:
    """The path of each campaign file below the folder that they share."""
    whole = [without_dots(path) for path in campaigns]
    shared = os.path.commonpath([path.parent for path in whole])
    return [path.relative_to(shared).as_posix() for path in whole]


def names_of(campaigns: Sequence[Path]) -> list[str]:
    """A folder name for each campaign: its path below what all share, without ending; a file called campaign.toml goes
    by its folder. Raises SettingError where one is given twice."""
    below = _below(campaigns)
    twice = next((name for name in below if below.count(name) > 1), None)
    if twice is not None:
        raise SettingError(f"{twice} is given twice; name each campaign once")
    names = [name.removesuffix("/campaign.toml").removesuffix(".toml") for name in below]
    for name in names:
        inside = [other for other in names if other == name or other.startswith(f"{name}/")]
        if len(inside) > 1:
            raise SettingError(
                f"the results of {inside[0]} and {inside[1]} would share a folder; give the campaign files other names"
            )
    return names


def _done(task: _Task) -> tuple[Outcome, None]:
    """Run a campaign on this machine."""
    return _outcome(task, task.campaign, task.out), None


def _packed(task: _Task) -> _Task:
    """The task with the bytes of its campaign: its file, logs and what they need, and the results so far."""
    try:
        campaign = read_campaign(task.campaign)
        logs = with_joined(campaign.every_log(), campaign.columns)
        paths = [task.campaign, *(log.path for log in logs), *campaign.beside.values()]
        before = [path for path in task.out.rglob("*") if path.is_file()]
        return replace(task, parcel=packed([*paths, *before]))
    except AutomarineError as refusal:
        return replace(task, refused=str(refusal))
    except OSError as problem:
        return replace(task, refused=f"{problem.filename}: cannot be read ({problem.strerror}); make it readable")


def _done_elsewhere(task: _Task) -> tuple[Outcome, dict[str, bytes] | None]:
    """Run a campaign from its parcel; with what its folder then holds."""
    if task.parcel is None:
        return Outcome(task.name, task.name, (), {}, (), (task.refused,)), None
    with tempfile.TemporaryDirectory(prefix="automarine-") as spare:
        root = Path(spare)
        task.parcel.unpack(root)
        out = root / place_of(task.out)
        return _outcome(task, root / place_of(task.campaign), out), content_of(out)


def _outcome(task: _Task, campaign: Path, out: Path) -> Outcome:
    try:
        run = run_campaign(campaign, out=out, **task.settings)
    except AutomarineError as refusal:
        return Outcome(task.name, task.name, (), {}, (), (str(refusal),))
    refused = tuple(f"{one.step}: {one.why}" for one in run.refused)
    found = run.content
    return Outcome(task.name, found.title, found.steps, run.says, found.cautions, refused, run.warnings)


MOST_NAMED = 12  # campaigns whose folders are named at the end

run_campaigns = Command(
    COMMAND, CampaignsOptions, _run_campaigns,
    {Campaigns: View(lambda result: [result.table()], lambda result: iter(result.warnings))},
    files=lambda result: ["campaigns.csv", "campaigns.json", *(f"{one.name}/" for one in result.outcomes[:MOST_NAMED])],
    python="run_campaigns",
)  # fmt: skip
