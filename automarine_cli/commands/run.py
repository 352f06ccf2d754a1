"""`run`: every step of a campaign in order, each kept if nothing that it depends on has changed, and one report; of
several campaigns side by side, with an overview of all."""

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import load, options
from automarine_cli.commands.campaign import Campaign, NothingToDoError, read_campaign
from automarine_cli.commands.command import OUTPUT, argument, command, given_as, option
from automarine_cli.commands.terminal import echo_warnings, end_with
from automarine_cli.errors import AutomarineError, OutputError, SettingError, TooFewRunsError
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.text import listed

if TYPE_CHECKING:
    from automarine_cli.report.campaign import CampaignRun, Campaigns, CampaignStep, RunFile, StepOutcome

RESULTS = "results"
"""The folder beside the campaign file that takes the results of who names none."""
PAGE = "svg"  # the figures of the report
NO_PAGE = "no step has a result to show"


def _steps() -> tuple[str, ...]:
    from automarine_cli.report.campaign import STEP_NAMES

    return STEP_NAMES


@command("run", report="campaign", saves=False)
@argument(
    "campaigns", nargs=-1, required=True, metavar="CAMPAIGN.toml...", type=options.FILE, reads="files", role="campaign"
)
@option(
    "--until", type=options.OneOf(_steps), metavar="STEP",
    help="Stop after this step, by its name in the table of results, such as fit-yaw.",
)  # fmt: skip
@option("--force", is_flag=True, help="Run every step again, even if nothing has changed.")
@options.out
@option(
    "--overwrite", is_flag=True, group=OUTPUT,
    help="Use DIR although it contains results of another command or campaign, and replace them.",
)  # fmt: skip
@options.together(options.jobs, options.cluster, options.as_json, options.verbosity)
def run_campaign(
    campaigns: Sequence[Path], until: str | None, force: bool, out: Path | None, overwrite: bool,
    figure_formats: Sequence[str], jobs: int, cluster: str | None, progress: Progress,
) -> "CampaignRun | Campaigns":  # fmt: skip
    """Run every step of a campaign file: check, fit-thrusters, fit-yaw, validate, diagnose, validate-final, report.

    Sections [surge], [sway], [heave] and [planar] add a fit, a validation and a diagnosis, [tune] a controller.
    Each step has a folder in DIR, by default "results" next to the campaign file. A step is kept if its inputs,
    settings and versions have not changed; otherwise the reason is printed. `automarine init` writes a campaign file.

    Several campaigns have a folder each in DIR and an overview of all. One that fails does not stop the others.
    --jobs N runs N at a time. --cluster ADDRESS sends them to a Dask scheduler, whose workers need the same disk under
    the same paths.

    \b
    Example:
      automarine run sample_runs/pool_day.toml --until fit-yaw -o out/pool_day
    """
    kinds = tuple(dict.fromkeys((*figure_formats, PAGE))) if figure_formats else ()
    how: dict[str, Any] = {"until": until, "force": force, "overwrite": overwrite, "kinds": kinds}
    if len(campaigns) == 1 and cluster is None:
        place = campaigns[0].parent / RESULTS if out is None else out
        return _run(campaigns[0], place, **how, jobs=jobs, progress=progress)
    if out is None:
        raise click.UsageError("several campaigns need a folder for their results; give one with -o DIR")
    from automarine_cli.pipeline.parallel import ordered_map
    from automarine_cli.pipeline.results_folder import Input, refuse_unfit, result_folder
    from automarine_cli.report.campaign import Campaigns
    from automarine_cli.report.sections import sections

    refuse_unfit(out)
    tasks = [(name, path.absolute(), out.absolute() / name) for name, path in zip(names_of(campaigns), campaigns)]
    outcomes = ordered_map(
        partial(_outcome, how=how), tasks, jobs, cluster=cluster, progress=progress, stage="running campaigns"
    )
    result = Campaigns(out, dict(outcomes))
    inputs = [Input(name, path, "campaign") for name, path in zip(_below(campaigns), campaigns)]
    manifest: dict[str, Any] = {"command": "campaigns", "options": {"until": until}, "inputs": inputs, "seed": None}
    with result_folder(out, **manifest, overwrite=True) as folder:
        sections(result).save(folder)
    return result


def _outcome(task: tuple[str, Path, Path], how: dict[str, Any]) -> "tuple[str, CampaignRun]":
    from automarine_cli.report.campaign import CampaignRun, RunFile

    name, campaign, out = task
    try:
        return name, _run(campaign, out, **how)
    except AutomarineError as refusal:
        return name, CampaignRun(out, RunFile("", name), refusal=str(refusal))


def names_of(campaigns: Sequence[Path]) -> list[str]:
    """Give each campaign a folder name: its path below what all share, without ending; a file called campaign.toml goes
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


def _below(campaigns: Sequence[Path]) -> list[str]:
    """The path of each campaign file below the folder that they share."""
    files = [Path(os.path.normpath(path.absolute())) for path in campaigns]
    shared = os.path.commonpath([path.parent for path in files])
    return [path.relative_to(shared).as_posix() for path in files]


def _run(
    path: Path, out: Path, *, until: str | None, force: bool, overwrite: bool, kinds: Sequence[str], jobs: int = 1,
    progress: Progress = silent,
) -> "CampaignRun":  # fmt: skip
    """Run the steps of a campaign file into folders of `out`, then the report. A step that is refused is told, and so
    are those that need it; the others go on. Raises SettingError for a campaign file that makes no sense and
    OutputError."""
    from automarine_cli.pipeline.results_folder import refuse_unfit
    from automarine_cli.report.campaign import REPORT, STEP_NAMES, STEPS, CampaignRun, StepOutcome, read_steps

    campaign = read_campaign(path)
    refuse_unfit(out)
    _refuse_others(campaign, out, overwrite)
    names = STEP_NAMES if until is None else STEP_NAMES[: STEP_NAMES.index(until) + 1]
    steps = [step for step in STEPS if step.name in names and campaign.has(step)]
    total = len(steps) + (REPORT in names)
    outcomes: list[StepOutcome] = []

    def add(name: str, work: Callable[[Progress], tuple[str, str]]) -> None:
        place = f"{len(outcomes) + 1}/{total} {name}"
        progress(place, len(outcomes), total)
        begun = time.monotonic()
        did, why = work(lambda stage, done, items: progress(f"{place}: {stage}" if items else stage, done, items))
        took = f", {time.monotonic() - begun:.0f} s" if did in ("done", "refused") else ""
        progress(f"{place}: {did}{took}" + (f" ({why})" if why else ""), 0, 0)
        outcomes.append(StepOutcome(name, did, why))

    for step in steps:
        add(step.name, partial(_do, step, campaign, out, force, overwrite, kinds, jobs))
    content = _content(campaign, out, steps, outcomes)
    if REPORT in names:
        add(REPORT, lambda _: _report(campaign, out, content, force))
    done = [step for step, outcome in zip(steps, outcomes) if outcome.did in ("done", "kept")]
    return CampaignRun(out, content, tuple(outcomes), read_steps(out, done))


def _do(
    step: "CampaignStep", campaign: Campaign, out: Path, force: bool, overwrite: bool, kinds: Sequence[str], jobs: int,
    progress: Progress,
) -> tuple[str, str]:  # fmt: skip
    """Do a step, and say what became of it and why; a result that is no longer of this campaign is taken away."""
    from automarine_cli.pipeline.results_folder import MANIFEST, manifest_of

    def without_result(did: str, why: str) -> tuple[str, str]:
        if outputs is None:
            return did, why
        for name in [*(entry.file for entry in outputs), MANIFEST]:
            (folder / name).unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()
        return did, f"{why}; its former result was removed" if did == "skipped" else why

    folder, work = out / step.folder, load(step.kind.writer)
    former = manifest_of(folder)
    outputs = former.outputs if former is not None and former.command == step.kind.writer else None
    how: dict[str, Any] = {"jobs": jobs, "progress": progress, "figure_formats": kinds}
    try:
        settings = campaign.plan(step, out)
    except NothingToDoError as reason:
        return without_result("skipped", str(reason))
    why = why_made_again(folder, **work.manifest(settings, kinds))
    if why is None and not force:
        return "kept", "inputs, settings and versions unchanged"
    try:
        work.run(settings, out=folder, overwrite=overwrite or outputs is not None, **how)
    except OutputError:
        raise
    except TooFewRunsError as refusal:  # nothing that could be corrected
        return without_result("skipped", str(refusal))
    except AutomarineError as refusal:
        return without_result("refused", str(refusal))
    return "done", "--force" if why is None else why


def _content(
    campaign: Campaign, out: Path, steps: "Sequence[CampaignStep]", outcomes: "Sequence[StepOutcome]"
) -> "RunFile":
    from automarine_cli.pipeline.results_folder import MANIFEST, sha256
    from automarine_cli.report.campaign import RUN_RESULT, RunFile, StepDone, cautions
    from automarine_cli.thrusters.map import THRUSTER_MAP

    entries = []
    for step, outcome in zip(steps, outcomes):
        if outcome.did in ("done", "kept"):
            entries.append(StepDone(step.name, step.folder, sha256(out / step.folder / MANIFEST)))
        else:
            entries.append(StepDone(step.name, **{outcome.did: outcome.why.partition("; its former")[0]}))
    place = out / "thrusters" / THRUSTER_MAP.file
    tested = THRUSTER_MAP.read(place) if place.is_file() else None
    cautioned = tuple(cautions(tested, campaign.sections["vehicle"].get("supply_V")))
    vehicle = campaign.sections["vehicle"].get("name", "")
    return RunFile(RUN_RESULT.schema, campaign.title, campaign.path.name, tuple(entries), cautioned, vehicle)


def _report(campaign: Campaign, out: Path, content: "RunFile", force: bool) -> tuple[str, str]:
    """The last step: one page of what is in the step folders, and the record of the whole run."""
    from automarine_cli.logs import with_joined
    from automarine_cli.pipeline.records import json_text, to_mapping
    from automarine_cli.pipeline.results_folder import Input, result_folder
    from automarine_cli.report.campaign import RUN_RESULT, make_report
    from automarine_cli.runs.load import has_bytes

    logs = with_joined(campaign.every_log(), campaign.columns)
    inputs = [Input(campaign.path.name, campaign.path, "campaign")]
    inputs += [Input(file.name, file.path) for file in logs if has_bytes(file)]
    inputs += given_as(**campaign.beside)
    manifest: dict[str, Any] = {"command": "run", "options": {}, "inputs": inputs, "seed": None}
    why = why_made_again(out, **manifest)
    record = to_mapping(content)
    if why is None and (out / RUN_RESULT.file).read_text(encoding="utf-8") != json_text(record):
        why = "results of the steps changed"
    to_show = any(step.folder for step in content.steps)
    if why is None and not force:
        return ("kept", "results of the steps unchanged") if to_show else ("skipped", NO_PAGE)
    with result_folder(out, **manifest, overwrite=True) as folder:
        folder.write(RUN_RESULT.file, record)
        for name, page in make_report(out, campaign.title, content).files.items() if to_show else ():
            folder.write(name, page)
    return ("done", "--force" if why is None else why) if to_show else ("skipped", NO_PAGE)


def _refuse_others(campaign: Campaign, out: Path, overwrite: bool) -> None:
    from automarine_cli.pipeline.results_folder import manifest_of

    if (manifest := manifest_of(out)) is None or overwrite:
        return
    theirs = next((entry.file for entry in manifest.inputs if entry.role == "campaign"), "")
    if (manifest.command, theirs) != ("run", campaign.path.name):
        of, do = manifest.command, "put these beside them"
        if of == "run":
            of, do = f"the campaign {theirs}", "replace them"
        raise OutputError(f"{out} already holds results of {of}; give --overwrite to {do}, or another folder with -o")


def _finish(ctx: click.Context, result: "CampaignRun | Campaigns") -> None:
    echo_warnings(result.warnings)
    end_with(ctx, list(result.refused))


run_campaign.finish = _finish
run_campaign.then = lambda result: next(
    (f"open {{out}}/{page}" for page in ("report.html", "campaigns.csv") if (result.out / page).is_file()),
    "" if result.refused else "automarine report {out}",
)


def why_made_again(folder: Path, **manifest: Any) -> str | None:
    """Return why a command of this `manifest` must run although there is `folder`; None if that holds its results."""
    from automarine_cli.pipeline.records import Codec, json_text
    from automarine_cli.pipeline.results_folder import MANIFEST, Manifest, manifest_of, recorded, sha256

    then = manifest_of(folder)
    if then is None or then.command != manifest["command"]:
        return ""  # done for the first time
    now = Codec(MANIFEST).read(Manifest, json.loads(json_text(recorded(**manifest))))
    before, after = ({"automarine": run.automarine, **run.libraries} for run in (then, now))
    inputs = [
        {e.file if e.role == "log" else f"{e.file} as {e.role}": e.sha256 for e in run.inputs} for run in (then, now)
    ]
    hashes = {entry.file: sha256(folder / entry.file) for entry in then.outputs}
    changes = {
        "version": [f"{n} {before.get(n, 'none')} then, {after.get(n, 'none')} now" for n in _changed(before, after)],
        "settings changed": _changed({**then.options, "seed": then.seed}, {**now.options, "seed": now.seed}),
        "inputs changed": _changed(*inputs),
        "results changed since they were written": _changed({e.file: e.sha256 for e in then.outputs}, hashes),
    }
    return next((f"{what}: {listed(names)}" for what, names in changes.items() if names), None)


def _changed(then: Mapping[str, object], now: Mapping[str, object]) -> list[str]:
    """Return the names of what is not the same, and which of them are new or gone."""
    changed = [name if name in now else f"{name} (gone)" for name in then if name not in now or then[name] != now[name]]
    return [*changed, *(f"{name} (new)" for name in now if name not in then)]
