"""`run` of several campaigns, a fleet or a season: each by itself on a process or a worker, and an overview of all."""

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.pipeline.manifest import Input
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.records import to_mapping
from automarine_cli.pipeline.results_folder import ResultFolder, refuse_unfit
from automarine_cli.report.campaign_tables import campaigns_table
from automarine_cli.report.tables import Table
from automarine_cli.results.judged import StepDone
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
    """One campaign to be run."""

    name: str
    campaign: Path
    out: Path
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class CampaignsOptions:
    """Campaign files; `until` names the last step to do, with `force` every step is done again."""

    campaigns: Sequence[Path] = field(metadata=reads("files", "campaign"))
    force: bool = field(default=False, metadata=UNRECORDED)
    until: str | None = None


def _run_campaigns(asked: CampaignsOptions, runner: Runner) -> Campaigns:
    """Run each campaign as `run_campaign` does, into a folder of its own in `out`, and write an overview of all.

    The campaigns go side by side to `jobs` processes, or to the workers of the Dask scheduler at `cluster`, which need
    a disk in common with this machine; the results are the same bytes. A campaign that is refused is told in the
    overview; the others go on. Raises SettingError for campaigns given twice, for no
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
    tasks = [_Task(name, path.absolute(), (out / name).absolute(), settings) for name, path in named]
    work = _done if cluster is None else _done_elsewhere
    outcomes = ordered_map(work, tasks, runner.jobs, cluster=cluster, progress=runner.progress, stage=STAGE)
    result = Campaigns(tuple(outcomes))
    inputs = [Input(name, path, "campaign") for name, path in zip(_below(campaigns), campaigns)]
    return replace(runner, overwrite=True).results(asked, lambda: result, _write, inputs)


def _write(folder: ResultFolder, result: Campaigns) -> None:
    folder.write_json("campaigns.json", result.to_json())
    folder.write("campaigns.csv", result.table().to_csv())


def _below(campaigns: Sequence[Path]) -> list[str]:
    """The path of each campaign file below the folder that they share."""
    whole = [Path(os.path.abspath(path)) for path in campaigns]  # noqa: PTH100, links stay
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


def _done_elsewhere(task: _Task) -> Outcome:
    """Run a campaign on a worker, perhaps after another worker died of it."""
    for begun in task.out.rglob(".*.automarine-new"):
        shutil.rmtree(begun)
    return _done(task)


def _done(task: _Task) -> Outcome:
    try:
        run = run_campaign(task.campaign, out=task.out, **task.settings)
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
