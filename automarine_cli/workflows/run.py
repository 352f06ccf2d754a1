"""`run`: every step of a campaign in order, each kept if nothing that it depends on has changed, and one report."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import AutomarineError, OutputError, SettingError, TooFewRunsError
from automarine_cli.logs import with_joined
from automarine_cli.pipeline.manifest import MANIFEST, Input, given_as, manifest_of, sha256, why_made_again
from automarine_cli.pipeline.records import json_text, to_mapping
from automarine_cli.pipeline.results_folder import refuse_unfit, result_folder
from automarine_cli.report.campaign_steps import folder_of
from automarine_cli.report.campaign_tables import cautions, steps_table
from automarine_cli.report.outcomes import of_final
from automarine_cli.report.tables import Table
from automarine_cli.results.judged import RunFile, StepDone
from automarine_cli.results.kinds import DIAGNOSIS, MODELS, RUN, THRUSTER_MAP
from automarine_cli.runs.load import has_bytes
from automarine_cli.workflows.campaign_file import Campaign, read_campaign
from automarine_cli.workflows.campaign_steps import NAMES, REPORT, STEPS, Step
from automarine_cli.workflows.command import UNRECORDED, Command, Runner, reads
from automarine_cli.workflows.report import report_files
from automarine_cli.workflows.view import View

COMMAND = "run"

RESULTS = "results"
"""The folder beside the campaign file that takes the results of who names none."""
NO_PAGE = "no step has a result to show"

Did = Literal["starts", "made", "kept", "skipped", "refused"]


@dataclass(frozen=True)
class News:
    """What becomes of a step: told when it `starts` (with why it must run) and when it is over."""

    step: str
    number: int
    total: int
    did: Did
    why: str = ""


Tell = Callable[[News], None]


@dataclass(frozen=True)
class CampaignRun:
    """What `run` did: the news of every step that is over, what each result says, the result file, and what the
    steps' manifests warn of."""

    news: tuple[News, ...]
    says: Mapping[str, str]
    content: RunFile
    warnings: tuple[str, ...] = ()

    @property
    def cautions(self) -> tuple[str, ...]:
        """What does not fit together in the whole campaign."""
        return self.content.cautions

    @property
    def refused(self) -> tuple[News, ...]:
        """Steps whose data or fit was refused."""
        return tuple(one for one in self.news if one.did == "refused")

    @property
    def files(self) -> tuple[str, ...]:
        """Folders and files that a person may want to open, the report first."""
        folders = {step.name: f"{step.folder}/" for step in STEPS}
        done = [one.step for one in self.news if one.did in ("made", "kept")]
        pages = (
            ("report.html", "report.md") if REPORT in done else (RUN.file,) * (REPORT in {n.step for n in self.news})
        )
        return (*pages, *(folders[s] for s in done if s in folders))

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/run/1. It does not say what was kept: the bytes are the same."""
        return to_mapping(self.content)

    def tables(self) -> tuple[Table | str, ...]:
        """One line a step: what was done, why, and what its result says."""
        rows = [
            (one.step, one.did, "" if one.did == "refused" else one.why, self.says.get(one.step, ""))
            for one in self.news
        ]
        return (steps_table(rows), *self.cautions)


def _silent(news: News) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class RunOptions:
    """The campaign file; `until` names the last step to do, with `force` every step is done again, and `tell` hears
    what becomes of each."""

    campaign: Path = field(metadata=reads("file", recorded=False))
    force: bool = field(default=False, metadata=UNRECORDED)
    until: str | None = field(default=None, metadata=UNRECORDED)
    tell: Tell = field(default=_silent, metadata=UNRECORDED)


def _run_campaign(asked: RunOptions, runner: Runner) -> CampaignRun:
    """Run the steps of a campaign file into the folder `out` (by default `results` beside the file), each into a folder
    of its own, then the report.

    A step whose inputs, settings and versions are those of the result that is there is not run again, unless
    `force`; `until` names the last step to do. A step that is refused is told, and so are those that need it; the
    others go on. Raises SettingError for a campaign file that makes no sense and OutputError.
    """
    if asked.until is not None and asked.until not in NAMES:
        raise SettingError(f"no step is called {asked.until!r}; give one of {', '.join(NAMES)}")
    known = read_campaign(asked.campaign)
    if runner.out is None:
        runner = replace(runner, out=asked.campaign.parent / RESULTS)
    assert runner.out is not None
    refuse_unfit(runner.out)
    _refuse_others(known, runner.out, runner.overwrite)
    return _run(known, asked, runner)


def _run(campaign: Campaign, asked: RunOptions, runner: Runner) -> CampaignRun:
    out, news = runner.out, list[News]()
    assert out is not None
    ours = {step.name for step in STEPS if step.belongs_to(campaign)} | {REPORT}
    wanted = NAMES if asked.until is None else NAMES[: NAMES.index(asked.until) + 1]
    names = [name for name in wanted if name in ours]
    for number, step in enumerate((one for one in STEPS if one.name in names), 1):

        def said(did: Did, why: str = "", number: int = number, name: str = step.name) -> News:
            one = News(name, number, len(names), did, why)
            asked.tell(one)
            return one

        news.append(_do(step, campaign, out, runner, asked.force, said))
    done = {one.step: one for one in news}
    content = _content(campaign, out, done)
    if REPORT in names:
        news.append(_report(campaign, out, content, asked.force, len(names), asked.tell))
    says = {
        step.name: step.work.kept.outcome(out / step.folder)
        for step in STEPS
        if step.work.kept is not None and step.name in done and done[step.name].did in ("made", "kept")
    }
    for dof in DOFS.values():
        says |= _final(out, dof, says)
    warnings = [
        f"{step.name}: {warning}"
        for step in STEPS
        if step.name in says and (manifest := manifest_of(out / step.folder)) is not None
        for warning in manifest.warnings
    ]
    return CampaignRun(tuple(news), says, content, tuple(warnings))


def _final(out: Path, dof: Dof, says: Mapping[str, str]) -> dict[str, str]:
    """What fit and validation of a motion say where its diagnosis named what the model lacked."""
    fit, validation, diagnosis = (
        next(one for one in STEPS if one.folder == folder)
        for folder in (dof.name, folder_of(dof, "validation"), folder_of(dof, "diagnosis"))
    )
    if fit.name not in says or diagnosis.name not in says:
        return {}
    model, found = MODELS[dof.name], DIAGNOSIS.read(out / diagnosis.folder / DIAGNOSIS.file)
    final = of_final(model.read(out / fit.folder / model.file), found)
    if not final or validation.name not in says:
        return {fit.name: final} if final else {}
    names = ", ".join(effect.name for effect in found.effects)
    return {fit.name: final, validation.name: f"without {names}, {says[validation.name]}"}


def _do(step: Step, campaign: Campaign, out: Path, runner: Runner, force: bool, said: Callable[..., News]) -> News:
    """One step: skipped, kept, made or refused; a result that is no longer of this campaign is taken away."""
    folder = out / step.folder
    plan = step.plan(campaign, out)
    if isinstance(plan, str):
        gone = _remove_results(folder, step.command)
        return said("skipped", plan + ("; its former result was removed" if gone else ""))
    why = plan.why(folder)
    if why is None and not force:
        return said("kept", "inputs, settings and versions unchanged")
    why = why or "--force"
    said("starts", why)
    ours = (found := manifest_of(folder)) is not None and found.command == step.command
    try:
        plan.run(folder, runner.overwrite or ours, runner.jobs, runner.progress)
    except OutputError:
        raise
    except TooFewRunsError as refusal:  # nothing that could be corrected
        gone = _remove_results(folder, step.command)
        return said("skipped", str(refusal) + ("; its former result was removed" if gone else ""))
    except AutomarineError as refusal:
        _remove_results(folder, step.command)
        return said("refused", str(refusal))
    return said("made", why)


def _remove_results(folder: Path, command: str) -> bool:
    """Remove what `command` wrote into `folder`, and the folder if that is all; return whether it was there."""
    manifest = manifest_of(folder)
    if manifest is None or manifest.command != command:
        return False
    for name in [*(entry.file for entry in manifest.outputs), MANIFEST]:
        (folder / name).unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()
    return True


def _content(campaign: Campaign, out: Path, done: Mapping[str, News]) -> RunFile:
    """The result file."""
    steps = []
    for step in STEPS:
        one = done.get(step.name)
        if one is None:
            continue
        if one.did in ("made", "kept"):
            steps.append(StepDone(step.name, step.folder, sha256(out / step.folder / MANIFEST)))
        elif one.did == "skipped":
            steps.append(StepDone(step.name, skipped=one.why.partition("; its former")[0]))
        else:
            steps.append(StepDone(step.name, refused=one.why))
    supply, tested = campaign.asked.vehicle.supply_V, out / "thrusters" / THRUSTER_MAP.file
    cautioned = cautions(THRUSTER_MAP.read(tested) if tested.is_file() else None, supply)
    return RunFile(RUN.schema, campaign.title, campaign.path.name, tuple(steps), tuple(cautioned))


def _report(campaign: Campaign, out: Path, content: RunFile, force: bool, number: int, tell: Tell) -> News:
    """The last step: one page of what is in the step folders, and the record of the whole run."""
    logs = with_joined(campaign.every_log(), campaign.columns)
    inputs = [Input(campaign.path.name, campaign.path, "campaign")]
    inputs += [Input(file.name, file.path) for file in logs if has_bytes(file)]
    inputs += given_as(**campaign.beside)
    why = why_made_again(out, command=COMMAND, options={}, seed=None, inputs=inputs)
    if why is None and (out / RUN.file).read_text(encoding="utf-8") != json_text(to_mapping(content)):
        why = "results of the steps changed"
    if why is None and not force:
        kept = any(step.folder for step in content.steps)
        unchanged = "results of the steps unchanged"
        last = News(REPORT, number, number, *(("kept", unchanged) if kept else ("skipped", NO_PAGE)))
        tell(last)
        return last
    why = why or "--force"
    tell(News(REPORT, number, number, "starts", why))
    with result_folder(out, command=COMMAND, options={}, inputs=inputs, seed=None, overwrite=True) as folder:
        folder.write_json(RUN.file, to_mapping(content))
        pages = _pages(out, campaign.title, content)
        for name, page in pages.items():
            folder.write(name, page)
    last = News(REPORT, number, number, "made", why) if pages else News(REPORT, number, number, "skipped", NO_PAGE)
    tell(last)
    return last


def _pages(out: Path, title: str, content: RunFile) -> Mapping[str, str]:
    """Name and content of the files of the report; none where no step has a result."""
    if not any(step.folder for step in content.steps):
        return {}
    return report_files(out, title=title, ran=content)


def _refuse_others(campaign: Campaign, out: Path, overwrite: bool) -> None:
    """Results of another command or campaign are not replaced without --overwrite."""
    manifest = manifest_of(out)
    if manifest is None or overwrite:
        return
    if manifest.command != COMMAND:
        raise OutputError(
            f"{out} already holds results of {manifest.command}; give --overwrite to put these beside them, or "
            "another folder with -o"
        )
    theirs = next((entry.file for entry in manifest.inputs if entry.role == "campaign"), "")
    if theirs != campaign.path.name:
        raise OutputError(
            f"{out} already holds results of the campaign {theirs}; give --overwrite to replace them, or another "
            "folder with -o"
        )


run_campaign = Command(
    COMMAND, RunOptions, _run_campaign, {CampaignRun: View(CampaignRun.tables, lambda result: iter(result.cautions))},
    files=lambda result: result.files, python="run_campaign",
)  # fmt: skip
