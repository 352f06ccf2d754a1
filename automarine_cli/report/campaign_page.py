"""A campaign: its steps as data, what the folders of their results say, and the report of all as one page.

What a step found stands as its command wrote it (Markdown, tables, figures); here are a line a step at the top, and
what only all steps together tell.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Generic, TypeVar

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import OutputError
from automarine_cli.fits.innovations import sentences_of
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.result_files import (
    CHECK,
    DIAGNOSIS,
    MODELS,
    PLANAR_MODEL,
    THRUSTER_MAP,
    TUNING,
    VALIDATION,
    CheckFile,
    DiagnosisFile,
    Given,
    ModelFile,
    PlanarFile,
    ResultKind,
    ResultRecord,
    RunFile,
    StepDone,
    ThrusterFile,
    TuningFile,
    ValidationFile,
)
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.pipeline.words import listed
from automarine_cli.report.page import page
from automarine_cli.report.sections import Sections, bullets, sections
from automarine_cli.report.sections import document as markdown
from automarine_cli.report.tables import Table, escape, interval, number

FILES = ("report.html", "report.md")
REPORT = "report"
SHOWN_OPEN, MOST_SHOWN = 6, 40  # runs whose validation figure stands open, and that are in the page at all
MOST_ROWS = 1000  # of a folded table: a page of ten thousand rows opens slowly and is read by nobody


@dataclass(frozen=True)
class Step:
    """A step: its name, its folder, the kind of its result, and the section of the campaign file with its settings.

    `logs` are kinds of logs: those of the first tuple of which there are any are taken, or all logs where there is no
    section. `models` are files of results before it, of which it takes the first that is there.
    """

    name: str
    folder: str
    kind: ResultKind[Any]
    section: str = ""
    logs: tuple[tuple[str, ...], ...] = ()
    models: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command that it runs."""
        return self.kind.writer

    @property
    def always(self) -> bool:
        """Whether every campaign has it."""
        return self.section in ("", "thrusters", YAW.name)


def folder_of(dof: Dof, step: str) -> str:
    """Name the folder of "validation" or "diagnosis" of a motion; yaw, which every campaign has, needs no name."""
    return step if dof is YAW else f"{dof.name}_{step}"


def _of(motion: str, fit: ResultKind[Any], fitted: tuple[tuple[str, ...], ...]) -> Iterator[Step]:
    """The steps of one motion, or of surge, sway and yaw together."""
    after, before = ("", "") if motion == YAW.name else (f"-{motion}", f"{motion}_")
    models = (f"{motion}/{fit.file}",)
    yield Step(f"fit-{motion}", motion, fit, motion, fitted)
    yield Step(f"validate{after}", f"{before}validation", VALIDATION, motion, (("validation",),), models)
    everything = tuple(kind for kinds in fitted for kind in kinds)
    yield Step(f"diagnose{after}", f"{before}diagnosis", DIAGNOSIS, motion, (everything,), models)


STEPS = (
    Step("check", "check", CHECK),
    Step("fit-thrusters", "thrusters", THRUSTER_MAP, "thrusters", (("thrusters",),)),
    *(step for motion in DOFS for step in _of(motion, MODELS[motion], (("steps",), ("manoeuvres",)))),
    *_of(PLANAR.name, PLANAR_MODEL, (("runs",),)),
    Step("tune", "tune", TUNING, "tune", models=(f"diagnosis/{DIAGNOSIS.file}", f"yaw/{MODELS[YAW.name].file}")),
)
STEP_NAMES = (*(step.name for step in STEPS), REPORT)


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
        found, missing = list(self.steps.found), self.steps.missing
        return {"schema": "automarine/report/1", "files": list(self.files), "steps": found, "missing": missing}


@sections.register
def _(result: Report) -> Sections:
    return Sections([], listed=tuple(result.files))


def make_report(folder: Path, title: str | None = None, ran: RunFile | None = None) -> Report:
    """Make the report of a campaign's folder from its step folders, and from what `run` says of them.

    Without a `title` it is that of what was identified. Steps without results are left out, and the report says so.
    Raises OutputError if there is none at all.
    """
    steps = read_steps(folder)
    folders = {
        dof: {dof.name, *(folder_of(dof, step) for step in ("validation", "diagnosis"))} for dof in DOFS.values()
    }
    motions = [dof.name for dof, names in folders.items() if names & steps.found.keys()]
    title = title or f"{' and '.join(motions or [YAW.name])} identification".capitalize()
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
    """Write the whole report in Markdown; places of pictures are relative to the folder that holds the step folders.

    `cautions` are sentences about what does not fit together between the thruster tests and the vehicle; `done` is
    what `run` says of its steps.
    """
    parts = {
        "Thruster map": _embedded(steps, "thrusters"),
        **{heading: blocks for dof in DOFS.values() for heading, blocks in _of_motion(steps, dof)},
        "Planar model": _embedded(steps, PLANAR.name, "planar_runs"),
        "Planar validation": _validation(steps, "planar_validation"),
        "Planar diagnosis": _embedded(steps, "planar_diagnosis"),
        "Tune": _embedded(steps, "tune"),
        "Logs": _logs(steps),
        "Runs set aside": _set_aside(steps),
        "How this was made": _made(steps),
    }
    lines = headlines(steps)
    return markdown(
        f"# {escape(title)}",
        *(f"**{step.step} was refused:** {escape(step.refused)}" for step in done if step.refused),
        *(f"**{escape(refusal)}**" for step in steps.found.values() if (refusal := _refusal(step.file))),
        Table.of("", [{"step": name, "result": line} for name, line in lines.items()]) if lines else None,
        bullets(escape(f"Caution: {line}") for line in cautions),
        missing_sentence(steps, done),
        *(block for heading, blocks in parts.items() if blocks for block in (f"## {heading}", *blocks)),
    )


def _refusal(file: ResultRecord) -> str:
    """Why a model must not be used; empty where it may, and for results of other kinds."""
    if isinstance(file, ValidationFile):
        return file.use.refusal
    return file.prediction.refusal if isinstance(file, ModelFile | PlanarFile) else ""


def headlines(steps: Steps) -> dict[str, str]:
    """Say what each result is in a few words, by the name of its step: first that a model must not be used, where so;
    models with what a diagnosis named."""
    lines = {}
    for step in STEPS:
        if (result := steps.found.get(step.folder)) is not None:
            line = _HEADLINES[type(result.file)](result, steps)
            lines[step.name] = "not usable: " * bool(_refusal(result.file)) + line
    return lines


def _of_check(step: StepResult[CheckFile], _: Steps) -> str:
    file, used, aside = step.file, step.file.runs.used, len(step.file.runs.set_aside)
    idle = sum(run.get("half_turn") is None for run in file.yaw_runs)
    parts = [f"{file.logs} log{'s' * (file.logs != 1)}", f"{used} run{'s' * (used != 1)}"]
    return ", ".join([*parts, *[f"{idle} without a half-turn"] * bool(idle), *[f"{aside} set aside"] * bool(aside)])


def _of_thrusters(step: StepResult[ThrusterFile], _: Steps) -> str:
    file = step.file
    laws = {"forward": file.a_forward, "backward": file.a_backward} if file.form == "square" else {}
    values = [f", a {side} {_interval(a)}" for side, a in laws.items() if a is not None]
    if not file.chosen:
        return f"{file.form} law{''.join(values)}"
    error = number(file.rmse_percent, 2)
    return f"{file.chosen} law{''.join(values)}, R² {number(file.r2)}, error {error} % of full scale"


def _of_model(step: StepResult[ModelFile], steps: Steps) -> str:
    """The final model with its parameters; where a diagnosis named what is missing, those without it behind."""
    file, keys = step.file, {step.dof.symbols.quadratic_print: step.dof.symbols.quadratic}
    before = dict(file.main_parameters())
    lacks = steps.get(folder_of(step.dof, "diagnosis"), DiagnosisFile)
    base = lacks.file.base if lacks is not None and added_by(lacks) else {}
    after = {name: base[keys.get(name, name)].after for name in before if keys.get(name, name) in base}
    if len(after) < len(before):
        return f"model {file.preferred}: {_values(before)}"
    alone = ", ".join(number(given.value) for given in before.values())
    return f"model {file.preferred} with {added_by(lacks)}: {_values(after)} (without: {alone})"


def _of_planar(step: StepResult[PlanarFile], _: Steps) -> str:
    masses = {name: given for name, given in step.file.parameters.items() if name in MASSES}
    return f"{step.file.structure}: {_values(masses)}" if masses else step.file.structure


def _of_validation(step: StepResult[ValidationFile], steps: Steps) -> str:
    """How far the preferred model is from runs: those that it was fitted to are told by the content of their logs."""
    file, unit = step.file, step.dof.units.key
    planar = file.motion == PLANAR.name
    model = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best
    score, used = file.models[model], file.runs.used
    fit = steps.found.get(PLANAR.name if planar else step.dof.name)
    seen = {entry.sha256 for entry in _logs_of(fit)} & {entry.sha256 for entry in _logs_of(step)}
    fitted = f" ({len(seen)} logs were fitted)" if seen else " not fitted" if _logs_of(fit) else ""
    low, high = score.ci95 or (None, None)
    error = f"{number(score.rmse, 3)}{f' [{number(low, 3)}, {number(high, 3)}]' if score.ci95 else ''} {unit} free run"
    over = f"{used} run{'s' * (used != 1)}{fitted}"
    if planar:
        return f"heading {error} over {over}"
    lacks = added_by(steps.get(folder_of(step.dof, "diagnosis"), DiagnosisFile))
    best = f" (best: model {file.best}, {number(file.models[file.best].rmse, 3)})" if model != file.best else ""
    again, noise = number(score.restarted, 3), number(file.noise_floor, 2)
    said = f"model {model}: {error}{best}, {again} {unit} restarted, noise {noise} {unit}, over {over}"
    return f"without {lacks}, {said}" if lacks else said


def _of_diagnosis(step: StepResult[DiagnosisFile], _: Steps) -> str:
    file = step.file
    names = ", ".join(effect.name for effect in file.effects)
    verdict = file.verdict.replace("-", " ") + (f": {names}" if names else "")
    return f"{verdict}; gap {number(file.before, 3)} to {number(file.after, 3)} {file.unit}"


def _of_tuning(step: StepResult[TuningFile], _: Steps) -> str:
    return f"{step.file.verdict.replace('-', ' ')} for {step.file.target}"


_HEADLINES: dict[type[ResultRecord], Any] = {
    CheckFile: _of_check, ThrusterFile: _of_thrusters, ModelFile: _of_model, PlanarFile: _of_planar,
    ValidationFile: _of_validation, DiagnosisFile: _of_diagnosis, TuningFile: _of_tuning,
}  # fmt: skip
MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")


def added_by(step: StepResult[DiagnosisFile] | None) -> str:
    """What a diagnosis of a motion named and added to its model."""
    if step is None or step.file.verdict != "named" or step.file.of_thrusters:
        return ""
    return " and ".join(effect.name for effect in step.file.effects)


def _logs_of(step: StepResult[Any] | None) -> list[Any]:
    inputs = step.manifest.inputs if step is not None and step.manifest is not None else ()
    return [entry for entry in inputs if entry.role == "log"]


def _values(given: Mapping[str, Given]) -> str:
    return ", ".join(f"{name} {_interval(value)}" for name, value in given.items())


def _interval(given: Given) -> str:
    """A number with its interval and unit; alone where the file has none."""
    if given.estimate is None:
        return number(given.value)
    return f"{interval(given.estimate)} {given.unit}".rstrip()


def _of_motion(steps: Steps, dof: Dof) -> Iterator[tuple[str, list[str]]]:
    """The sections of one motion; those of yaw, which every campaign has, need no name."""
    within = "" if dof is YAW else f" in {dof.name}"
    yield f"{dof.name.capitalize()} model", _model(steps, dof)
    yield f"Validation{within}", _validation(steps, folder_of(dof, "validation"))
    yield f"Diagnosis{within}", _embedded(steps, folder_of(dof, "diagnosis"))


def picture(step: StepResult[ResultRecord], stem: str, alt: str = "") -> str:
    """The line that shows a figure of a step; nothing if it was not drawn."""
    kinds = [kind for kind in ("png", "svg") if (step.folder / f"{stem}.{kind}").is_file()]
    alt = alt or alternatives(step.dof).get(stem, stem)
    return f"![{escape(alt)}]({step.name}/{stem}.{kinds[0]})" if kinds else ""


def fold(summary: str, *blocks: str) -> list[str]:
    """Blocks that are folded away behind their summary."""
    return [f"<details><summary>{summary}</summary>", *blocks, "</details>"]


def _embedded(steps: Steps, folder: str, *figures: str) -> list[str]:
    """The page of a step without its title, headings one level lower, pictures by their place from here."""
    if (step := steps.found.get(folder)) is None:
        return []
    pages = sorted(path.name for path in step.folder.glob("*.md"))
    text = re.sub(r"\A# .*\n", "", step.text(pages[0]) if pages else "")
    text = re.sub(r"^## ", "### ", text, flags=re.MULTILINE)
    shown = re.compile(r"^!\[(.*)\]\((\w+)\.\w+\)$", flags=re.MULTILINE)
    alts = alternatives(step.dof)
    return [
        shown.sub(lambda found: picture(step, found[2], alts.get(found[2], found[1])), text),
        *(picture(step, stem) for stem in figures),
    ]


def _model(steps: Steps, dof: Dof) -> list[str]:
    if (step := steps.get(dof.name, ModelFile)) is None:
        return []
    file, symbols, blocks = step.file, dof.symbols, list[str]()
    if names := added_by(steps.get(folder_of(dof, "diagnosis"), DiagnosisFile)):
        added = (
            f"This is the model without {escape(names)}, which the diagnosis added: the final numbers are at the top."
        )
        blocks.append(added)
    blocks.append(escape(file.preferred_because))
    if file.ratio is not None:
        length = escape(interval(file.ratio.known(f"{step.name}: {dof.ratio_key}")))
        blocks.append(
            f"The {dof.words.inertial_length} {symbols.inertia}/{symbols.quadratic_print} is {length} "
            f"{dof.units.base}, whatever the unit of the {dof.words.force}."
        )
    blocks += [escape(line) for line in sentences_of(file.channels, dof)]
    blocks.append(escape(str(file.buoyancy.get("says", ""))))
    tables = [re.sub(r"\A\*\*(.*)\*\*", r"### \1", step.text(f"{table}.md")) for table in ("table1", "table2")]
    noted = "\n".join(tables)
    warnings = [line for line in map(escape, file.warnings) if line not in noted]
    figures = ("drag", "inertia", dof.steps_key, "collapse", "whole_runs")
    shown = [picture(step, stem) for stem in figures]
    return [*blocks, *tables, bullets(f"Warning: {line}" for line in warnings), "### Figures of the fit", *shown]


def _validation(steps: Steps, folder: str) -> list[str]:
    if (step := steps.get(folder, ValidationFile)) is None:
        return []
    words, names = step.dof.words, list(step.file.logs)
    alt = f"measured and simulated {words.position}, their difference, the {words.force}"
    stems = islice(zip(names, file_stems(names)), MOST_SHOWN)
    shown = [picture(step, f"validation_{stem}", f"Run {name}: {alt}") for name, stem in stems]
    blocks = [step.text("validation.md"), "### Run by run", *shown[:SHOWN_OPEN]]
    if shown[SHOWN_OPEN:]:
        blocks += fold(f"{len(shown) - SHOWN_OPEN} more runs", *shown[SHOWN_OPEN:])
    if len(names) > MOST_SHOWN:
        blocks.append(f"The figures of {len(names) - MOST_SHOWN} more runs are in the folder {step.name}.")
    return blocks


def _logs(steps: Steps) -> list[str]:
    if (step := steps.get("check", CheckFile)) is None or not (body := step.text("check.md")):
        return []
    return _folded("Every run", body, "check/check.md")


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
        *_folded("Every input and its SHA-256", _files(known), "manifest.json"),
    ]


def _files(known: Sequence[tuple[StepResult[ResultRecord], Manifest]]) -> str:
    """Every input of every step with its hash."""
    rows = [
        (step.name, entry.role, entry.file, entry.sha256 or "not readable")
        for step, made in known
        for entry in made.inputs
    ]
    return Table("", ("folder", "as", "file", "SHA-256"), tuple(rows)).to_markdown()


def _folded(summary: str, table: str, place: str) -> list[str]:
    """A long table folded away; of a very long one only where it stands."""
    return fold(summary, table) if table.count("\n") <= MOST_ROWS else [f"{summary}: see `{place}`."]


def _settings(options: Mapping[str, object]) -> str:
    """Settings that say something: not those left alone, nor how figures are stored."""
    told = {key: value for key, value in options.items() if value not in (None, False, [], "", "auto")}
    plain = {key: value for key, value in told.items() if not isinstance(value, (dict, list)) and value is not True}
    flags = [key for key, value in told.items() if value is True and key != "figures"]
    return ", ".join([*(f"{key} {value}" for key, value in plain.items()), *flags]) or "none"


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
