"""A campaign's report: what its step folders hold as one document for a person, in Markdown and as a page.

What a step found stands as its command wrote it (Markdown, tables, figures); here are the summary at the top, and what
only all steps together tell.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Generic, TypeVar

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import OutputError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.innovations import sentences_of
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.result_files import (
    CheckFile,
    DiagnosisFile,
    ModelFile,
    PlanarFile,
    ResultRecord,
    RunFile,
    Score,
    StepDone,
    ThrusterFile,
    TuningFile,
    ValidationFile,
)
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.pipeline.words import listed
from automarine_cli.report.campaign_steps import STEPS, folder_of
from automarine_cli.report.diagnosis_report import escape
from automarine_cli.report.page import page
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table, interval, number

FILES = ("report.html", "report.md")
SHOWN_OPEN, MOST_SHOWN = 6, 40  # runs whose validation figure stands open, and that are in the page at all
MOST_ROWS = 1000  # of a folded table: a page of ten thousand rows opens slowly and is read by nobody
NEXT = "What to run next"


Kept = TypeVar("Kept", bound=ResultRecord, covariant=True)


@dataclass(frozen=True)
class StepResult(Generic[Kept]):
    """What one step left: its folder, what its result file holds, and its manifest (None if there is none)."""

    name: str
    folder: Path
    file: Kept
    manifest: Manifest | None

    @property
    def dof(self) -> Dof:
        """The motion that it is of."""
        return self.file.dof

    def text(self, name: str) -> str:
        """Read a text file of the folder; empty if it is not there."""
        path = self.folder / name
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


@dataclass(frozen=True)
class Steps:
    """The steps that are there, by folder name in their order."""

    found: Mapping[str, StepResult[ResultRecord]]

    def get(self, name: str, record: type[Kept]) -> StepResult[Kept] | None:
        """Give a step's result of a kind, if it is there."""
        step = self.found.get(name)
        if step is None or not isinstance(step.file, record):
            return None
        return StepResult(step.name, step.folder, step.file, step.manifest)

    @property
    def missing(self) -> list[str]:
        """Folders of every campaign that are not there."""
        return [step.folder for step in STEPS if step.always and step.folder not in self.found]


def read_steps(folder: Path) -> Steps:
    """Read the steps that are there. Raises OutputError if there is none, or for a file that automarine did not write
    so."""
    results = {}
    for step in STEPS:
        path = folder / step.folder / step.kind.file
        if path.is_file():
            file, manifest = step.kind.read(path, f"{step.folder}/{path.name}", OutputError), path.with_name(MANIFEST)
            made = read_manifest(manifest) if manifest.is_file() else None
            results[step.folder] = StepResult(step.folder, path.parent, file, made)
    if not results:
        usual = ", ".join(step.folder for step in STEPS if step.always)
        raise OutputError(
            f"{folder}: none of the folders {usual} with results is here; give a folder that "
            "automarine run made, or write the results of single commands into folders of these names"
        )
    return Steps(results)


@dataclass(frozen=True)
class Report:
    """The report's files in memory, the steps that it tells of, and the folder `out` where it is."""

    files: Mapping[str, str]
    steps: Steps
    out: Path

    def to_json(self) -> dict[str, object]:
        """Give what is in it: schema automarine/report/1."""
        told, missing = list(self.steps.found), self.steps.missing
        return {"schema": "automarine/report/1", "files": list(self.files), "steps": told, "missing": missing}


@sections.register
def _(result: Report) -> Sections:
    return Sections([], listed=tuple(result.files))


def make_report(folder: Path, title: str | None = None, ran: RunFile | None = None) -> Report:
    """Make the report of a campaign's folder from its step folders, and from what `run` says of them.

    Without a `title` it is that of what was identified. Steps without results are left out, and the report says so.
    Raises OutputError if there is none at all.
    """
    steps = read_steps(folder)
    title = title or usual_title(steps)
    text = document(steps, title, ran.cautions if ran else (), ran.steps if ran else ())
    return Report({"report.html": page(text, folder, title), "report.md": text}, steps, folder)


def alternatives(dof: Dof) -> dict[str, str]:
    """What each figure shows, in words, by its name."""
    words = dof.words
    position = words.position.capitalize()
    return {
        "thrusters": "Thrust of one thruster against its control signal: measured points, fitted curves, residuals "
        "below",
        dof.steps_key: f"{position} against time of every {words.step}: the part that was fitted in colour, what was "
        "cut in grey",
        "drag": f"Steady {words.rate} against {words.full_force}: one point a run, the curves of models 1, 2 and 3, "
        "residuals below",
        "inertia": f"{words.full_inertia.capitalize()} of each run against its {words.force}, with the overall value "
        "of both methods",
        "collapse": f"{position} against time times the root of the {words.force}: all runs on one curve if model 3 "
        "holds",
        "whole_runs": f"What the model leaves of the {words.position} of whole runs, beside the noise",
        "where": f"Where the gap between simulated and measured {words.position} is: against each variable that stands "
        "out",
        "why": "Evidence for each effect of the library",
        "learned": "Learned curve, which no effect of the library explains, with its 95 % confidence band",
        "before_after": "The gap before and after the missing effect was added, against the noise of the "
        f"{words.position}",
    }


def document(steps: Steps, title: str, cautions: Sequence[str] = (), done: Sequence[StepDone] = ()) -> str:
    """The whole report in Markdown; places of pictures are relative to the folder that holds the step folders.

    `cautions` are sentences about what does not fit together between the thruster tests and the vehicle; `done` is
    what `run` says of its steps.
    """
    sections = {
        "Thruster map": _thrusters(steps, cautions),
        **{heading: blocks for dof in DOFS.values() for heading, blocks in _of_motion(steps, dof)},
        **dict(_together(steps)),
        "Tune": _tuning(steps),
        "Logs": _logs(steps),
        "Runs set aside": _set_aside(steps),
        NEXT: _next(steps),
        "How this was made": _made(steps),
    }
    parts = [f"# {escape(title)}", *refusals(done), *summary(steps), missing_sentence(steps, done)]
    for heading, blocks in sections.items():
        parts += [f"## {heading}", *blocks] if blocks else []
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def usual_title(steps: Steps) -> str:
    """The title of who gives none: the motions of which there is something."""
    motions = [
        dof.name
        for dof in DOFS.values()
        if any(name in steps.found for name in (dof.name, folder_of(dof, "validation"), folder_of(dof, "diagnosis")))
    ]
    return f"{' and '.join(motions or [YAW.name])} identification".capitalize()


def _of_motion(steps: Steps, dof: Dof) -> Iterator[tuple[str, list[str]]]:
    """The sections of one motion; those of yaw, which every campaign has, need no name."""
    within = "" if dof is YAW else f" in {dof.name}"
    yield f"{dof.name.capitalize()} model", _model(steps, dof)
    yield f"Validation{within}", _validation(steps, folder_of(dof, "validation"))
    yield f"Diagnosis{within}", _diagnosis(steps, folder_of(dof, "diagnosis"))


def _together(steps: Steps) -> Iterator[tuple[str, list[str]]]:
    """The sections of surge, sway and yaw together."""
    if (step := steps.get("planar", PlanarFile)) is not None:
        shown = "Of each run the heading with predictions"
        yield "Planar model", [step.text("planar.md"), picture(step, "planar_runs", shown)]
    yield "Planar validation", _validation(steps, "planar_validation")
    yield "Planar diagnosis", _diagnosis(steps, "planar_diagnosis")


def picture(step: StepResult[ResultRecord], stem: str, alt: str = "") -> str:
    """The line that shows a figure of a step; nothing if it was not drawn."""
    kinds = [kind for kind in ("png", "svg") if (step.folder / f"{stem}.{kind}").is_file()]
    return f"![{escape(alt or alternatives(step.dof)[stem])}]({step.name}/{stem}.{kinds[0]})" if kinds else ""


def fold(summary: str, *blocks: str) -> list[str]:
    """Blocks that are folded away behind their summary."""
    return [f"<details><summary>{summary}</summary>", *blocks, "</details>"]


def _thrusters(steps: Steps, cautions: Sequence[str]) -> list[str]:
    if (step := steps.get("thrusters", ThrusterFile)) is None:
        return []
    body = re.sub(r"\A# .*\n", "", step.text("thrusters.md"))
    return [picture(step, "thrusters"), body, _bullets([escape(f"Caution: {line}") for line in cautions])]


def _model(steps: Steps, dof: Dof) -> list[str]:
    if (step := steps.get(dof.name, ModelFile)) is None:
        return []
    names = added_by(steps.get(folder_of(dof, "diagnosis"), DiagnosisFile))
    blocks = (
        [f"This is the model without {names}, which the diagnosis added: the final numbers are at the top."]
        if names
        else []
    )
    blocks.append(escape(step.file.preferred_because))
    if step.file.ratio is not None:
        length, own = escape(interval(step.file.ratio.known(f"{step.name}: {dof.ratio_key}"))), dof.symbols
        blocks.append(
            f"The {dof.words.inertial_length} {own.inertia}/{own.quadratic_print} is {length} {dof.units.base}, "
            f"whatever the unit of the {dof.words.force}."
        )
    blocks += [escape(line) for line in sentences_of(step.file.channels, dof)]
    if step.file.buoyancy:
        blocks.append(escape(str(step.file.buoyancy["says"])))
    tables = [re.sub(r"\A\*\*(.*)\*\*", r"### \1", step.text(f"{table}.md")) for table in ("table1", "table2")]
    noted = "\n".join(tables)
    warnings = [escape(line) for line in step.file.warnings]
    blocks += [*tables, _bullets([f"Warning: {line}" for line in warnings if line not in noted])]
    figures = ("drag", "inertia", dof.steps_key, "collapse", "whole_runs")
    shown = [picture(step, stem) for stem in figures]
    return [*blocks, "### Figures of the fit", *shown]


def _validation(steps: Steps, folder: str) -> list[str]:
    if (step := steps.get(folder, ValidationFile)) is None:
        return []
    words, names = step.dof.words, list(step.file.logs)
    shown = [
        picture(
            step,
            f"validation_{stem}",
            f"Run {one}: measured and simulated {words.position}, their difference, the {words.force}",
        )
        for one, stem in islice(zip(names, file_stems(names)), MOST_SHOWN)
    ]
    blocks = [step.text("validation.md"), "### Run by run", *shown[:SHOWN_OPEN]]
    if shown[SHOWN_OPEN:]:
        blocks += fold(f"{len(shown) - SHOWN_OPEN} more runs", *shown[SHOWN_OPEN:])
    if len(names) > MOST_SHOWN:
        blocks.append(f"The figures of {len(names) - MOST_SHOWN} more runs are in the folder {step.name}.")
    return blocks


def _diagnosis(steps: Steps, folder: str) -> list[str]:
    if (step := steps.found.get(folder)) is None:
        return []
    body, _ = _without_next(step)
    body = re.sub(r"\A# .*\n", "", body)
    body = re.sub(r"^## ", "### ", body, flags=re.MULTILINE)

    def shown(found: re.Match[str]) -> str:
        return picture(step, found[1]) if found[1] in alternatives(step.dof) else ""

    return [re.sub(r"^!\[.*\]\((\w+)\.\w+\)$", shown, body, flags=re.MULTILINE)]


def _without_next(step: StepResult[ResultRecord]) -> tuple[str, str]:
    """The page of the diagnosis without, and only, what it says to run next."""
    text = step.text("diagnosis.md")
    found = re.search(rf"^## {NEXT}\n(.*?)(?=^## |\Z)", text, flags=re.MULTILINE | re.DOTALL)
    return (text.replace(found[0], ""), found[1]) if found else (text, "")


def _tuning(steps: Steps) -> list[str]:
    if (step := steps.get("tune", TuningFile)) is None:
        return []
    text = re.sub(r"^(!\[.*\])\((\w+\.\w+)\)$", r"\1(tune/\2)", step.text("tuning.md"), flags=re.MULTILINE)
    return [re.sub(r"^## ", "### ", re.sub(r"\A# .*\n", "", text), flags=re.MULTILINE)]


def _logs(steps: Steps) -> list[str]:
    if (step := steps.get("check", CheckFile)) is None or not (body := step.text("check.md")):
        return []
    used, count = step.file.runs.used, step.file.logs
    return [
        f"{count} log{'s' * (count != 1)} with {used} run{'s' * (used != 1)} or thruster tests checked.",
        *_listed("Every run", body, "check/check.md"),
    ]


def _set_aside(steps: Steps) -> list[str]:
    rows: dict[tuple[str, str, str], list[str]] = {}
    for step in steps.found.values():
        for run in step.file.runs.set_aside:
            rows.setdefault((run.file, run.run, run.why), []).append(step.name)
    if not rows:
        return []
    table = Table(
        "", ("log", "run", "why", "left out of"), tuple((*key, ", ".join(names)) for key, names in rows.items())
    )
    return [table.to_markdown()]


def _next(steps: Steps) -> list[str]:
    """What the diagnoses ask for, and warnings of preferred models that ask for runs."""
    fits = [fit for name in DOFS if (fit := steps.get(name, ModelFile)) is not None]
    of_others = re.compile(r"Model (\d) ")
    said = [
        escape(line)
        for fit in fits
        for line in fit.file.warnings
        if re.search(r"\badd\b", line, flags=re.IGNORECASE)
        and not ((other := of_others.match(line)) and other[1] != fit.file.preferred)
    ]
    diagnoses = [step for step in steps.found.values() if isinstance(step.file, DiagnosisFile)]
    blocks = [_bullets(said), *(_without_next(step)[1] for step in diagnoses)]
    lines = [block.strip() for block in blocks if block.strip()]
    if lines:
        return ["\n".join(lines)]
    without = "" if diagnoses else "; a diagnosis would say what these runs cannot show"
    return [f"No further runs are suggested{without}."]


def _bullets(lines: Sequence[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _made(steps: Steps) -> list[str]:
    """Command, settings, versions and inputs of each step, from the manifests."""
    known = [(step, step.manifest) for step in steps.found.values() if step.manifest is not None]
    if not known:
        return []
    rows = []
    for step, made in known:
        seed, settings = "" if made.seed is None else str(made.seed), _settings(made.options)
        rows.append((step.name, f"automarine {made.command}", settings, seed, str(len(made.inputs)), made.automarine))
    header = ("folder", "command", "non-default settings", "seed", "inputs", "automarine")
    versions = {", ".join(f"{name} {one}" for name, one in made.libraries.items()) for _, made in known}
    return [
        Table("", header, tuple(rows)).to_markdown(),
        *(f"Versions: {escape(line)}." for line in sorted(versions)),
        "`automarine verify` on each folder says whether anything in it has changed.",
        *_listed("Every input and its SHA-256", _files(known), "manifest.json"),
    ]


def _files(known: Sequence[tuple[StepResult[ResultRecord], Manifest]]) -> str:
    """Every input of every step with its hash."""
    rows = [
        (step.name, entry.role, entry.file, entry.sha256 or "not readable")
        for step, made in known
        for entry in made.inputs
    ]
    return Table("", ("folder", "as", "file", "SHA-256"), tuple(rows)).to_markdown()


def _listed(summary: str, table: str, place: str) -> list[str]:
    """A long table folded away; of a very long one only where it stands."""
    return fold(summary, table) if table.count("\n") <= MOST_ROWS else [f"{summary}: see `{place}`."]


def _settings(options: Mapping[str, object]) -> str:
    """Settings that say something: not those left alone, nor how figures are stored."""
    told = {key: value for key, value in options.items() if value not in (None, False, [], "", "auto")}
    plain = {key: value for key, value in told.items() if not isinstance(value, (dict, list)) and value is not True}
    flags = [key for key, value in told.items() if value is True and key != "figures"]
    return ", ".join([*(f"{key} {value}" for key, value in plain.items()), *flags]) or "none"


MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")


def summary(steps: Steps) -> Iterator[str]:
    """A paragraph a motion: what is not to be used first, and the numbers of the final model; nothing where there is
    only a look at the logs."""
    for dof in DOFS.values():
        yield from _paragraph(steps, dof)
    yield from _paragraph_together(steps)


def _paragraph(steps: Steps, dof: Dof) -> Iterator[str]:
    """The paragraph of one motion; that of yaw tells of the thrusters too."""
    model = steps.get(dof.name, ModelFile)
    judged = steps.get(folder_of(dof, "validation"), ValidationFile)
    lacks = steps.get(folder_of(dof, "diagnosis"), DiagnosisFile)
    tested = steps.get("thrusters", ThrusterFile) if dof is YAW else None
    parts = [_unusable(one) for one in (model, judged) if one is not None]
    within = "" if dof is YAW else f"In {dof.name}, "
    found = [_law(model, lacks) if model else "", _thrust(tested) if tested else ""]
    said = within + "; ".join(one for one in found if one)
    parts.append(f"{said[:1].upper()}{said[1:]}." if any(found) else "")
    if model is not None and model.file.buoyancy:
        parts.append(escape(str(model.file.buoyancy["says"])))
    parts += [_predicts(judged, model, added_by(lacks)), _verdict(lacks)]
    if any(parts):
        yield " ".join(filter(None, parts))


def _unusable(step: StepResult[ModelFile] | StepResult[PlanarFile] | StepResult[ValidationFile]) -> str:
    """That a model is of no use, in bold."""
    use = step.file.use if isinstance(step.file, ValidationFile) else step.file.prediction
    return f"**{escape(use.refusal)}**" if use.refusal else ""


def _paragraph_together(steps: Steps) -> Iterator[str]:
    """The same of surge, sway and yaw together."""
    parts = []
    lacks = steps.get("planar_diagnosis", DiagnosisFile)
    if (model := steps.get("planar", PlanarFile)) is not None:
        fitted = {name: one.estimate for name, one in model.file.parameters.items() if name in MASSES}
        before = {name: one for name, one in fitted.items() if one is not None}
        found = [_bold(name, _after(lacks, name) or one) for name, one in before.items()]
        parts += [_unusable(model)]
        parts.append(f"Surge, sway and yaw together: {escape(model.file.structure)}, with {listed(found)}.")
        parts += [escape(line) for line in model.file.prediction.says[:1] if model.file.prediction.of_use]
    if (judged := steps.get("planar_validation", ValidationFile)) is not None:
        score, used = judged.file.models[judged.file.best], judged.file.runs.used
        if score.rmse is not None:
            parts.append(
                f"Driven by the commands of {used} run{'s' * (used != 1)} it misses the heading by "
                f"**{number(score.rmse, 3)}** degrees rms over whole runs."
            )
    parts.append(_verdict(lacks))
    if any(parts):
        yield " ".join(filter(None, parts))


def refusals(done: Sequence[StepDone]) -> Iterator[str]:
    """A line for each step that was refused: why."""
    return (f"**{one.step} was refused:** {escape(one.refused)}" for one in done if one.refused)


def missing_sentence(steps: Steps, done: Sequence[StepDone]) -> str:
    """Which steps left nothing to report, and why where that is not told as a refusal."""
    only_force = any(not step.always and step.folder in steps.found for step in STEPS) and "yaw" not in steps.found
    fates = {one.step: one for one in done}
    missing: dict[str, list[str]] = {}
    for step in STEPS:
        fate = fates.get(step.name)
        passed = only_force and step.section == YAW.name
        if step.folder in steps.missing and not passed and not (fate and fate.refused):
            words = f"no {step.kind.words.removeprefix('a ').removeprefix('an ')}"
            missing.setdefault((fate.skipped if fate else None) or "", []).append(words)
    said = []
    for why, lack in missing.items():
        lacking = listed(lack)
        why = escape(why) or ("that step was not run" if len(lack) == 1 else "those steps were not run")
        said.append(f"{lacking[0].upper()}{lacking[1:]}: {why}.")
    return " ".join(said)


def _law(step: StepResult[ModelFile], lacks: StepResult[DiagnosisFile] | None) -> str:
    """Law and parameters of the final model: with what was missing, where a diagnosis named it."""
    file, own = step.file, step.dof.symbols
    keys = {own.quadratic_print: own.quadratic}
    place = f"{step.name}: models.{file.preferred}"
    before = {name: given.known(f"{place}.{name}") for name, given in file.main_parameters()}
    linear, quadratic = f"{own.linear} {own.velocity}", f"{own.quadratic_print} |{own.velocity}| {own.velocity}"
    law = {"1": f" {linear}", "2": f" {quadratic} + {linear}", "3": f" {quadratic}"}.get(file.preferred, "")
    model = f"model {escape(file.preferred)} (drag{law})"
    final = {name: _after(lacks, keys.get(name, name)) for name in before}
    if not any(final.values()):
        return f"{model} fits {file.runs.used} runs best, with {_values(before)}"
    added = {name: one for name, one in final.items() if one is not None}
    alone = " and ".join(number(one.value) for one in before.values())
    return (
        f"with {added_by(lacks)} added, {model} has {_values(added)} (without, the fit to {file.runs.used} runs gives "
        f"{alone})"
    )


def added_by(step: StepResult[DiagnosisFile] | None) -> str:
    """What a diagnosis of a motion named and added to its model."""
    if step is None or step.file.verdict != "named" or step.file.of_thrusters:
        return ""
    return " and ".join(escape(effect.name) for effect in step.file.effects)


def _after(step: StepResult[DiagnosisFile] | None, key: str) -> Estimate | None:
    """A parameter of the model with what was missing, where that was named."""
    moved = step.file.base.get(key) if step is not None and added_by(step) else None
    return None if moved is None else moved.after.estimate


def _values(found: Mapping[str, Estimate]) -> str:
    said = " and ".join(_bold(name, one) for name, one in found.items())
    loose = [name for name, one in found.items() if not _determined(one)]
    return f"{said}; these runs do not determine {' and '.join(loose)}" if loose else said


def _determined(estimate: Estimate) -> bool:
    """Whether an interval is narrower than its number, and so tells it from zero."""
    low, high = estimate.ci95
    return low * high > 0 and high - low <= 2 * abs(estimate.value)


def _bold(name: str, estimate: Estimate) -> str:
    """A parameter with its interval, in bold where the runs determine it."""
    said = f"{name} = {escape(interval(estimate))}"
    return f"{f'**{said}**' if _determined(estimate) else said} {estimate.unit}".rstrip()


def _thrust(step: StepResult[ThrusterFile]) -> str:
    file = step.file
    if file.form == "square":
        laws = ((file.forward.a, "ahead"), (file.backward.a, "astern"))
        sides = [f"{number(a.value)} {side}" for a, side in laws if a is not None]
        return f"one thruster gives F = a |n| n with a = {' and '.join(sides)} N/n²" if sides else ""
    equation = next((one.equation for one in file.forms if one.form == file.form), file.form)
    chosen = file.chosen.rmse_percent_of_full_scale if file.chosen else None
    errors = [number(one, 2) for one in (chosen, file.rmse_percent_of_full_scale)]
    return f"one thruster gives {escape(equation)} to {errors[0]} % of full scale (the square law to {errors[1]} %)"


def _predicts(step: StepResult[ValidationFile] | None, fitted: StepResult[ModelFile] | None, added: str) -> str:
    """How far the model that was fitted is from runs, without what was `added` to it since."""
    if step is None:
        return ""
    file, words = step.file, step.dof.words
    model, used = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best, file.runs.used
    score, best = file.models[model], file.models[file.best]
    runs = f"{used} run{'s' * (used != 1)}{_seen(step, fitted)}"
    driven = f"{f'Without {added}, driven' if added else 'Driven'} by the commands of {runs}, model {escape(model)}"
    if score.rmse is None:
        return f"{driven} diverges."
    again, error = score.restarted, _bracketed(score) if added else f"**{_bracketed(score)}**"
    restarted = f", by {number(again, 3)} {words.units} when restarted within them" if again is not None else ""
    better = f" (best is model {escape(file.best)} with {_bracketed(best)})" if best is not score else ""
    return (
        f"{driven} misses the {words.position} by "
        f"{error} {words.units} rms over whole runs{better}{restarted}, where the noise is "
        f"{number(file.noise_floor, 3)}."
    )


def _bracketed(score: Score) -> str:
    """The free-run error with its interval over runs, where there is one."""
    value = number(score.rmse, 3)
    return f"{value} \\[{number(score.ci95[0], 3)}, {number(score.ci95[1], 3)}\\]" if score.ci95 else value


def _seen(step: StepResult[ValidationFile], fitted: StepResult[ModelFile] | None) -> str:
    """Whether the logs of the validation had been fitted, by their content."""
    if fitted is None or fitted.manifest is None or step.manifest is None:
        return ""
    known = {entry.sha256 for entry in fitted.manifest.inputs if entry.role == "log"}
    again = [entry for entry in step.manifest.inputs if entry.role == "log" and entry.sha256 in known]
    if again:
        return f" ({len(again)} of the logs had been fitted)"
    return " that was not fitted" if step.file.runs.used == 1 else " that were not fitted"


def _verdict(step: StepResult[DiagnosisFile] | None) -> str:
    """What a diagnosis says first on its own page."""
    return "" if step is None else re.sub(r"\A# .*\n+", "", step.text("diagnosis.md")).partition("\n\n")[0].strip()
