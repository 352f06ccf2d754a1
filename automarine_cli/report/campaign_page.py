"""A campaign: its steps as data, what the folders of their results say, and the report of all as one page.

What a step found stands as its command wrote it (Markdown, tables, figures); here are a line a step at the top, and
what only all steps together tell.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from automarine_cli.comparison.validation import VALIDATION, ValidationFile
from automarine_cli.control.tuning import TUNING, TuningFile
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import OutputError
from automarine_cli.estimate import Given
from automarine_cli.fits.innovations import sentences_of
from automarine_cli.models.store import DIAGNOSIS, MODELS, PLANAR_MODEL, DiagnosisFile, ModelFile, PlanarFile
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.result_files import ResultKind, SetAside
from automarine_cli.pipeline.results_folder import file_stems
from automarine_cli.pipeline.words import listed
from automarine_cli.report.log_tables import CHECK, CheckFile
from automarine_cli.report.page import page
from automarine_cli.report.sections import Sections, bullets, document, sections
from automarine_cli.report.tables import Table, escape, interval, number
from automarine_cli.thrusters.map import THRUSTER_MAP, ThrusterFile

FILES = ("report.html", "report.md")
REPORT = "report"
SHOWN_OPEN, MOST_SHOWN = 6, 40  # runs whose validation figure stands open, and that are in the page at all
MOST_ROWS = 1000  # of a folded table: a page of ten thousand rows opens slowly and is read by nobody


@dataclass(frozen=True)
class StepDone:
    """A step of a campaign: its folder and the hash of its manifest, or why it was skipped or refused."""

    step: str
    folder: str | None = None
    manifest_sha256: str | None = None
    skipped: str | None = None
    refused: str | None = None


@dataclass(frozen=True)
class RunFile:
    """`run.json`: what `run` left beside the report."""

    schema: str
    title: str = ""
    campaign: str = ""
    steps: tuple[StepDone, ...] = ()
    cautions: tuple[str, ...] = ()


RUN = ResultKind("run.json", "run", RunFile, "run", YAW)


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
        return self.kind.writer

    @property
    def always(self) -> bool:
        """Whether every campaign has it."""
        return self.section in ("", "thrusters", YAW.name)


def folder_of(dof: Dof, step: str) -> str:
    """Name the folder of "validation" or "diagnosis" of a motion; yaw, which every campaign has, needs no name."""
    return step if dof is YAW else f"{dof.name}_{step}"


def _of(motion: str, fit: ResultKind[Any], fitted: tuple[tuple[str, ...], ...]) -> Iterator[Step]:
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
    Step("tune", "tune", TUNING, "tune", (), (f"diagnosis/{DIAGNOSIS.file}", "yaw/yaw_model.json")),
)
STEP_NAMES = (*(step.name for step in STEPS), REPORT)


@dataclass(frozen=True)
class StepResult:
    """What one step left: its folder, what its result file holds, and its manifest (None if there is none)."""

    name: str
    folder: Path
    file: Any
    manifest: Manifest | None

    @property
    def dof(self) -> Dof:
        return self.file.dof

    @property
    def logs(self) -> dict[str | None, str]:
        """The logs that it read, by the hash of their content."""
        inputs = () if self.manifest is None else self.manifest.inputs
        return {entry.sha256: entry.file for entry in inputs if entry.role == "log"}

    def text(self, name: str) -> str:
        """Read a text file of the folder; empty if it is not there."""
        path = self.folder / name
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""

    def picture(self, stem: str, alt: str = "") -> str:
        """Write the line that shows a figure; nothing if it was not drawn."""
        kinds = [kind for kind in ("png", "svg") if (self.folder / f"{stem}.{kind}").is_file()]
        alt = alt or alternatives(self.dof).get(stem, stem)
        return f"![{escape(alt)}]({self.name}/{stem}.{kinds[0]})" if kinds else ""


Steps = Mapping[str, StepResult]
"""The steps that are there, by the names of their folders, in their order."""


def missing(steps: Steps) -> list[str]:
    """List the folders of every campaign that are not there."""
    return [step.folder for step in STEPS if step.always and step.folder not in steps]


def read_steps(folder: Path) -> Steps:
    """Read the steps that are there. Raises OutputError if there is none, or for a file that automarine did not write
    so."""
    results = {}
    for step in STEPS:
        path = folder / step.folder / step.kind.file
        if path.is_file():
            file, manifest = step.kind.read(path, f"{step.folder}/{path.name}", OutputError), path.with_name(MANIFEST)
            record = read_manifest(manifest) if manifest.is_file() else None
            results[step.folder] = StepResult(step.folder, path.parent, file, record)
    if not results:
        raise OutputError(
            f"{folder}: none of the folders {', '.join(missing({}))} with results is here; give a folder that "
            "automarine run made, or write the results of single commands into folders of these names"
        )
    return results


@dataclass(frozen=True)
class Report:
    """The report's files in memory, the steps that it tells of, and the folder `out` where it is."""

    files: Mapping[str, str]
    steps: Steps
    out: Path

    def to_json(self) -> dict[str, object]:
        """Give what is in it: schema automarine/report/1."""
        steps = {"steps": list(self.steps), "missing": missing(self.steps)}
        return {"schema": "automarine/report/1", "files": list(self.files), **steps}


@sections.register
def _(result: Report) -> Sections:
    return Sections([], listed=tuple(result.files))


def make_report(folder: Path, title: str | None = None, ran: RunFile | None = None) -> Report:
    """Make the report of a campaign's folder from its step folders, and from what `run` says of them.

    Without a `title` it is that of what was identified. Steps without results are left out, and the report says so.
    Raises OutputError if there is none at all.
    """
    steps, done, cautions = read_steps(folder), ran.steps if ran else (), ran.cautions if ran else ()
    motions = [name for name in DOFS if any(step.section == name and step.folder in steps for step in STEPS)]
    title = title or f"{' and '.join(motions or [YAW.name])} identification".capitalize()
    parts = {"Thruster map": _embedded(steps, "thrusters")}
    for dof in DOFS.values():
        within = "" if dof is YAW else f" in {dof.name}"  # yaw, which every campaign has, needs no name
        parts |= {
            f"{dof.name.capitalize()} model": _model(steps, dof),
            f"Validation{within}": _validation(steps, folder_of(dof, "validation")),
            f"Diagnosis{within}": _embedded(steps, folder_of(dof, "diagnosis")),
        }
    parts |= {
        "Planar model": _embedded(steps, PLANAR.name, "planar_runs"),
        "Planar validation": _validation(steps, "planar_validation"),
        "Planar diagnosis": _embedded(steps, "planar_diagnosis"),
        "Tune": _embedded(steps, "tune"),
        "Logs": _folded("Every run", steps["check"].text("check.md"), "check/check.md") if "check" in steps else [],
        "Runs set aside": _set_aside(steps),
        "How this was made": _manifests(steps),
    }
    text = document(
        f"# {escape(title)}",
        *(f"**{step.step} was refused:** {escape(step.refused)}" for step in done if step.refused),
        *(f"**{escape(refusal)}**" for step in steps.values() if (refusal := _refusal(step.file))),
        Table.of("", [{"step": name, "result": line} for name, line in headlines(steps).items()]),
        bullets(escape(f"Caution: {line}") for line in cautions),
        missing_sentence(steps, done),
        *(block for heading, blocks in parts.items() if blocks for block in (f"## {heading}", *blocks)),
    )
    return Report({"report.html": page(text, folder, title), "report.md": text}, steps, folder)


def alternatives(dof: Dof) -> dict[str, str]:
    """Say what each figure shows, by its name."""
    words, position = dof.words, dof.words.position.capitalize()
    return {
        "thrusters": "Thrust of one thruster against its control signal: measured points, fitted curves, residuals "
        "below",
        dof.steps_key: f"{position} against time of every {words.step}: the part that was fitted in colour, what was "
        "cut in grey",
        "drag": f"Steady {words.rate} against {words.full_force}: one point a run, the curves of models 1, 2 and 3, "
        "residuals below",
        "inertia": f"{words.full_inertia.capitalize()} of each run against its {words.force}, with the overall value "
        "of both methods",
        "collapse": f"{position} against time times the root of the {words.force}: all runs on one curve if "
        "model 3 holds",
        "whole_runs": f"What the model leaves of the {words.position} of whole runs, beside the noise",
        "where": f"Where the gap between simulated and measured {words.position} is: against each variable that "
        "stands out",
        "why": "Evidence for each effect of the library",
        "learned": "Learned curve, which no effect of the library explains, with its 95 % confidence band",
        "before_after": f"The gap before and after the missing effect was added, against the noise of the "
        f"{words.position}",
    }


def _refusal(file: Any) -> str:
    """Why a model must not be used; empty where it may, and for results of other kinds."""
    if isinstance(file, ValidationFile):
        return file.use.refusal
    return file.prediction.refusal if isinstance(file, ModelFile | PlanarFile) else ""


def headlines(steps: Steps) -> dict[str, str]:
    """Say what each result is in a few words, by the name of its step: first that a model must not be used, where so;
    models with what a diagnosis named."""
    lines = {}
    for step in STEPS:
        if (result := steps.get(step.folder)) is not None:
            line = _HEADLINES[type(result.file)](result.file, result, steps)
            lines[step.name] = "not usable: " * bool(_refusal(result.file)) + line
    return lines


def _of_check(file: CheckFile, *_: object) -> str:
    used, aside = file.runs.used, len(file.runs.set_aside)
    idle = sum(run.get("half_turn") is None for run in file.yaw_runs)
    parts = [f"{file.logs} log{'s' * (file.logs != 1)}", f"{used} run{'s' * (used != 1)}"]
    return ", ".join([*parts, *[f"{idle} without a half-turn"] * bool(idle), *[f"{aside} set aside"] * bool(aside)])


def _of_thrusters(file: ThrusterFile, *_: object) -> str:
    laws = {"forward": file.a_forward, "backward": file.a_backward} if file.form == "square" else {}
    values = "".join(f", a {side} {_interval(a)}" for side, a in laws.items() if a is not None)
    if not file.chosen:
        return f"{file.form} law{values}"
    error = number(file.rmse_percent, 2)
    return f"{file.chosen} law{values}, R² {number(file.r2)}, error {error} % of full scale"


def _of_model(file: ModelFile, step: StepResult, steps: Steps) -> str:
    """The final model with its parameters; where a diagnosis named what is missing, those without it behind."""
    keys, before = {step.dof.symbols.quadratic_print: step.dof.symbols.quadratic}, dict(file.main_parameters())
    added, diagnosis = added_by(steps, step.dof), steps.get(folder_of(step.dof, "diagnosis"))
    base = diagnosis.file.base if diagnosis is not None and added else {}
    after = {name: base[keys.get(name, name)].after for name in before if keys.get(name, name) in base}
    if len(after) < len(before):
        return f"model {file.preferred}: {_values(before)}"
    alone = ", ".join(number(value.value) for value in before.values())
    return f"model {file.preferred} with {added}: {_values(after)} (without: {alone})"


def _of_planar(file: PlanarFile, *_: object) -> str:
    masses = {name: value for name, value in file.parameters.items() if name in MASSES}
    return f"{file.structure}: {_values(masses)}" if masses else file.structure


def _of_validation(file: ValidationFile, step: StepResult, steps: Steps) -> str:
    """How far the preferred model is from runs: those that it was fitted to are told by the content of their logs."""
    unit, planar = step.dof.units.key, file.motion == PLANAR.name
    model = file.preferred_by_fit if file.preferred_by_fit in file.models else file.best
    score, used = file.models[model], file.runs.used
    fit = steps.get(PLANAR.name if planar else step.dof.name)
    logs = {} if fit is None else fit.logs
    again = logs.keys() & step.logs.keys()
    fitted = f" ({len(again)} logs were fitted)" if again else " not fitted" if logs else ""
    low, high = score.ci95 or (None, None)
    error = f"{number(score.rmse, 3)}{f' [{number(low, 3)}, {number(high, 3)}]' if score.ci95 else ''} {unit} free run"
    over = f"{used} run{'s' * (used != 1)}{fitted}"
    if planar:
        return f"heading {error} over {over}"
    added = added_by(steps, step.dof)
    best = f" (best: model {file.best}, {number(file.models[file.best].rmse, 3)})" if model != file.best else ""
    restarted, noise = number(score.restarted, 3), number(file.noise_floor, 2)
    said = f"model {model}: {error}{best}, {restarted} {unit} restarted, noise {noise} {unit}, over {over}"
    return f"without {added}, {said}" if added else said


def _of_diagnosis(file: DiagnosisFile, *_: object) -> str:
    names = ", ".join(effect.name for effect in file.effects)
    verdict = file.verdict.replace("-", " ") + (f": {names}" if names else "")
    return f"{verdict}; gap {number(file.gap.before, 3)} to {number(file.gap.after, 3)} {file.unit}"


def _of_tuning(file: TuningFile, *_: object) -> str:
    return f"{file.verdict.replace('-', ' ')} for {file.target}"


_HEADLINES: dict[type[object], Callable[..., str]] = {
    CheckFile: _of_check, ThrusterFile: _of_thrusters, ModelFile: _of_model,
    PlanarFile: _of_planar, ValidationFile: _of_validation, DiagnosisFile: _of_diagnosis,
    TuningFile: _of_tuning,
}  # fmt: skip
MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")


def added_by(steps: Steps, dof: Dof) -> str:
    """Name what the diagnosis of a motion added to its model; empty where it named nothing."""
    step = steps.get(folder_of(dof, "diagnosis"))
    if step is None or step.file.verdict != "named" or step.file.of_thrusters:
        return ""
    return " and ".join(effect.name for effect in step.file.effects)


def _values(given: Mapping[str, Given]) -> str:
    return ", ".join(f"{name} {_interval(value)}" for name, value in given.items())


def _interval(given: Given) -> str:
    return f"{interval(given.estimate)} {given.unit}".rstrip() if given.estimate else number(given.value)


def _fold(summary: str, *blocks: str) -> list[str]:
    return [f"<details><summary>{summary}</summary>", *blocks, "</details>"]


def _embedded(steps: Steps, folder: str, *figures: str) -> list[str]:
    """The page of a step without its title, headings one level lower, pictures by their place from here."""
    if (step := steps.get(folder)) is None:
        return []
    pages = sorted(path.name for path in step.folder.glob("*.md"))
    text = re.sub(r"\A# .*\n", "", step.text(pages[0]) if pages else "")
    text = re.sub(r"^## ", "### ", text, flags=re.MULTILINE)
    shown, alts = re.compile(r"^!\[(.*)\]\((\w+)\.\w+\)$", flags=re.MULTILINE), alternatives(step.dof)
    text = shown.sub(lambda match: step.picture(match[2], alts.get(match[2], match[1])), text)
    return [text, *map(step.picture, figures)]


def _model(steps: Steps, dof: Dof) -> list[str]:
    if (step := steps.get(dof.name)) is None:
        return []
    file, symbols, blocks = step.file, dof.symbols, list[str]()
    if names := escape(added_by(steps, dof)):
        blocks.append(
            f"This is the model without {names}, which the diagnosis added: the final numbers are at the top."
        )
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
    warnings = [f"Warning: {line}" for line in map(escape, file.warnings) if line not in "\n".join(tables)]
    figures = map(step.picture, ("drag", "inertia", dof.steps_key, "collapse", "whole_runs"))
    return [*blocks, *tables, bullets(warnings), "### Figures of the fit", *figures]


def _validation(steps: Steps, folder: str) -> list[str]:
    if (step := steps.get(folder)) is None:
        return []
    words, names = step.dof.words, list(step.file.logs)
    alt = f"measured and simulated {words.position}, their difference, the {words.force}"
    stems = islice(zip(names, file_stems(names)), MOST_SHOWN)
    shown = [step.picture(f"validation_{stem}", f"Run {name}: {alt}") for name, stem in stems]
    blocks = [step.text("validation.md"), "### Run by run", *shown[:SHOWN_OPEN]]
    if shown[SHOWN_OPEN:]:
        blocks += _fold(f"{len(shown) - SHOWN_OPEN} more runs", *shown[SHOWN_OPEN:])
    if len(names) > MOST_SHOWN:
        blocks.append(f"The figures of {len(names) - MOST_SHOWN} more runs are in the folder {step.name}.")
    return blocks


def _set_aside(steps: Steps) -> list[str]:
    names: dict[SetAside, list[str]] = {}
    for step in steps.values():
        for run in step.file.runs.set_aside:
            names.setdefault(run, []).append(step.name)
    rows = [
        {"log": run.file, "run": run.run, "why": run.why, "left out of": ", ".join(folders)}
        for run, folders in names.items()
    ]
    return [Table.of("", rows).to_markdown()] if rows else []


def _manifests(steps: Steps) -> list[str]:
    manifests = {step.name: step.manifest for step in steps.values() if step.manifest is not None}
    if not manifests:
        return []
    rows = [
        {"folder": name, "command": f"automarine {manifest.command}",
         "non-default settings": _settings(manifest.options), "seed": "" if manifest.seed is None else manifest.seed,
         "inputs": len(manifest.inputs), "automarine": manifest.automarine}
        for name, manifest in manifests.items()
    ]  # fmt: skip
    versions = {", ".join(map(" ".join, manifest.libraries.items())) for manifest in manifests.values()}
    inputs = tuple(
        (name, entry.role, entry.file, entry.sha256 or "not readable")
        for name, manifest in manifests.items()
        for entry in manifest.inputs
    )
    hashes = Table("", ("folder", "as", "file", "SHA-256"), inputs).to_markdown()
    return [
        Table.of("", rows).to_markdown(),
        *(f"Versions: {escape(line)}." for line in sorted(versions)),
        "`automarine verify` on each folder says whether anything in it has changed.",
        *_folded("Every input and its SHA-256", hashes, "manifest.json"),
    ]


def _folded(summary: str, table: str, place: str) -> list[str]:
    """A long table folded away; of a very long one only where it stands."""
    if not table:
        return []
    return _fold(summary, table) if table.count("\n") <= MOST_ROWS else [f"{summary}: see `{place}`."]


def _settings(options: Mapping[str, object]) -> str:
    """Settings that say something: not those left alone, nor how figures are stored."""
    changed = {key: value for key, value in options.items() if value not in (None, False, [], "", "auto")}
    plain = [
        f"{key} {value}" for key, value in changed.items() if value is not True and not isinstance(value, dict | list)
    ]
    flags = [key for key, value in changed.items() if value is True and key != "figures"]
    return ", ".join([*plain, *flags]) or "none"


def missing_sentence(steps: Steps, done: Sequence[StepDone]) -> str:
    """Which steps left nothing to report, and why where that is not told as a refusal."""
    only_force = any(not step.always and step.folder in steps for step in STEPS) and YAW.name not in steps
    fates = {step.step: step for step in done}
    lacking: dict[str, list[str]] = {}
    for step in STEPS:
        fate = fates.get(step.name)
        passed = only_force and step.section == YAW.name
        if step.folder in missing(steps) and not passed and not (fate and fate.refused):
            words = f"no {step.kind.name.replace('-', ' ')}"
            lacking.setdefault((fate.skipped if fate else None) or "", []).append(words)
    sentences = []
    for why, results in lacking.items():
        names, several = listed(results), len(results) > 1
        why = escape(why) or ("those steps were not run" if several else "that step was not run")
        sentences.append(f"{names[0].upper()}{names[1:]}: {why}.")
    return " ".join(sentences)
