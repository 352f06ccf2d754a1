"""A campaign: its steps as data, what `run` made of them, what the folders of their results say, and all as one page.

What a step found stands as its command wrote it (Markdown, tables, figures); here are a line a step at the top, and
what only all steps together tell.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from automarine_cli import effects
from automarine_cli.comparison.validation import VALIDATION, ForecastEntry, ValidationFile
from automarine_cli.control.tuning import TUNING
from automarine_cli.diagnosis.diagnose import MIN_RUNS
from automarine_cli.diagnosis.verdict import NAMED, NOTHING, SUSPECTED, UNEXPLAINED
from automarine_cli.dofs import DOFS, PLANAR, YAW, Dof
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import ExcludedRun, OutputError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.fits.driven import JUDGED_HORIZON_S
from automarine_cli.models import store
from automarine_cli.models.store import DIAGNOSIS, DiagnosisFile, ModelFile, PlanarFile, named_model
from automarine_cli.pipeline.records import ResultKind, RunsUsed, Shown, to_mapping
from automarine_cli.pipeline.results_folder import MANIFEST, Manifest, read_manifest
from automarine_cli.report.log_tables import CHECK, CheckFile, sensor_sentences
from automarine_cli.report.page import page, plain
from automarine_cli.report.sections import Content, Sections, bullets, document, file_stems, sections
from automarine_cli.report.tables import MISSING, Table, escape, interval, number, with_band
from automarine_cli.text import listed, plural
from automarine_cli.thrusters.map import THRUSTER_MAP, ThrusterFile

REPORT_FILES = ("report.html", "report.md")
REPORT = "report"
MAX_FIGURES, MAX_CAMPAIGNS_LISTED = 24, 12  # Of a step in the page, and at the end; all are in their folders
SAME_VOLTAGE = 1.03  # voltages that differ by less are one, as in the thruster fit
MADE = (
    "The `manifest.json` of each folder holds the command, every setting, the seed and the SHA-256 of every input; "
    "`automarine verify` says whether anything in the folder has changed."
)
FIRST_DATE_S = 946_684_800.0  # 2000, in seconds since 1970: clocks that show less know no date
MISSES = "Missing"
BOX_LABELS = {VALIDATION.name: "Error", DIAGNOSIS.name: MISSES, TUNING.name: "Gains"}  # in the box at the top
CAPTIONS = {
    "collapse": "All runs on one curve, scaled by the fitted model: what is off the curve is thrust scatter or missing",
    "drag": "Steady rate of each run and the drag that the models give it",
    "half_turns": "Measured and fitted half-turns, one a run",
    "steps": "Measured and fitted steps, one a run",
    "inertia": "Inertia of each run beside the fitted one: runs that disagree stand out",
    "whole_runs": "Whole runs, measured and simulated",
    "planar_runs": "Whole runs, measured and predicted",
    "planar_tracks": "Tracks and speeds, measured and simulated by the commands alone",
    "residuals": "What the fit leaves, in units of the noise, and how the errors of its parameters hang together",
    "tuning": "Loop with the present and the new gains: steps of the heading, and what a load does",
}
"""Of figures that no page of a step shows, by their files."""
AS_LOGGED = "{}: the usable part of steps in blue, manoeuvres in orange, the rest in grey"
OF_A_RUN = "Run {}, off by {}: measured, and simulated by its commands alone"
USE_EXTENDED = "Use `{1}`, the model with it. {2}"
NOT_BETTER = "On runs not fitted the error does not fall with {0}: confirm it with new runs before you use `{1}`. {2}"
DIAGNOSE = "`automarine diagnose` says what the model lacks."
USE = "`automarine tune` and `automarine export` use the model."
MORE_RUNS = f"Drive more runs: a diagnosis needs {MIN_RUNS} and more."
PLAN_RUNS = "`automarine plan` plans the runs that tell what is missing."
FREE_RUN, RESTARTED, FORECAST = "free run", "restarted", f"{JUDGED_HORIZON_S:g} s ahead"
WORST = "The worst verdict decides. More: `automarine guide good-enough`."
WITHOUT = "This is the model without {}, which the diagnosis added: the final numbers are at the top."
SECTIONS = (*DOFS, PLANAR.name, "tune", "thrusters")  # in the order of the page
MASSES = ("surge.m_u", "sway.m_v", "yaw.I_r")
GOOD, CLOSER, UNFIT = GRADES = "good", "look closer", "do not use"
MIN_RUNS_USED, MAX_SET_ASIDE_SHARE = 6, 0.1  # runs; share of them
RELATIVE_HALF_WIDTHS = (0.05, 1.0)  # of the interval, as a share of the number; beyond 1 it contains zero
RESTARTED_ERROR_RATIOS = (1.5, 3.0)  # times the error of a right model
AHEAD_ERROR_RATIOS = (0.5, 1.0)  # of the error of the better constant
DIAGNOSED = {NOTHING: GOOD, NAMED: GOOD, SUSPECTED: CLOSER, UNEXPLAINED: UNFIT}
GRADE_LIMITS = {
    "runs used": (f"{MIN_RUNS_USED} or more, nearly all", MISSING),
    "95 % intervals": ("within ± 5 %", "zero inside, or at a bound"),
    "restarted error": (f"below {RESTARTED_ERROR_RATIOS[0]:g} times", f"above {RESTARTED_ERROR_RATIOS[1]:g} times"),
    f"error {JUDGED_HORIZON_S:g} s ahead": ("half of the better constant's", "above it"),
    "diagnosis": ("nothing missing, or named", "unexplained"),
}
"""What is looked at: when it is good, and when the model must not be used."""
*MEASURED, DIAGNOSIS_ROW = [*GRADE_LIMITS][2:]
MEASURES = (("error", *MEASURED), (DIAGNOSIS_ROW, DIAGNOSIS_ROW))


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
    schema: str
    title: str = ""
    campaign: str = ""
    steps: tuple[StepDone, ...] = ()
    cautions: tuple[str, ...] = ()
    vehicle: str = ""


RUN_RESULT = ResultKind("run.json", "run", RunFile, "run", YAW)


@dataclass(frozen=True)
class CampaignStep:
    """A step: its name, its folder, the kind of its result, and the section of the campaign file with its settings.
    `logs` are kinds of logs: those of the first tuple of which there are any are taken, or all logs where there is no
    section. `models` are files of results before it, of which it takes the first that is there; it is of the `final`
    model, which there is where a diagnosis named an effect."""

    name: str
    folder: str
    kind: ResultKind[Any]
    section: str = ""
    logs: tuple[tuple[str, ...], ...] = ()
    models: tuple[str, ...] = ()
    final: bool = False

    @property
    def always(self) -> bool:
        return self.section in ("", "thrusters", YAW.name) and not self.final

    @property
    def title(self) -> str:
        words = self.kind.name.replace("-", " ")
        return (self.folder.replace("_", " ") if self.folder.endswith(words) else words).capitalize()


def _of(motion: str, fit: ResultKind[Any], fitted: tuple[tuple[str, ...], ...]) -> Iterator[CampaignStep]:
    after, before = ("", "") if motion == YAW.name else (f"-{motion}", f"{motion}_")
    models = (f"{motion}/{fit.file}",)
    yield CampaignStep(f"fit-{motion}", motion, fit, motion, fitted)
    yield CampaignStep(f"validate{after}", f"{before}validation", VALIDATION, motion, (("validation",),), models)
    everything = tuple(kind for kinds in fitted for kind in kinds)
    yield CampaignStep(f"diagnose{after}", f"{before}diagnosis", DIAGNOSIS, motion, (everything,), models)
    models, folder = (f"{before}diagnosis/extended_model.json",), f"{before}final_validation"
    yield CampaignStep(f"validate-final{after}", folder, VALIDATION, motion, (("validation",),), models, final=True)


STEPS = (
    CampaignStep("check", "check", CHECK),
    CampaignStep("fit-thrusters", "thrusters", THRUSTER_MAP, "thrusters", (("thrusters",),)),
    *(step for motion in DOFS for step in _of(motion, store.MODELS[motion], (("steps",), ("manoeuvres",)))),
    *_of(PLANAR.name, store.PLANAR_MODEL, (("runs",),)),
    CampaignStep("tune", "tune", TUNING, "tune", (), (f"diagnosis/{DIAGNOSIS.file}", "yaw/yaw_model.json")),
)
STEP_NAMES = (*(step.name for step in STEPS), REPORT)


@dataclass(frozen=True)
class StepResult:
    """What a step left: its folder, what its result file holds, and its manifest (None if there is none)."""

    step: CampaignStep
    folder: Path
    file: Any
    manifest: Manifest | None

    @property
    def dof(self) -> Dof:
        return self.file.dof

    @property
    def logs(self) -> set[str | None]:
        return {entry.sha256 for entry in self.manifest.inputs if entry.role == "log"} if self.manifest else set()

    def markdown(self) -> str:
        paths = sorted(self.folder.glob("*.md"))
        return "\n\n".join(path.read_text(encoding="utf-8", errors="replace") for path in paths)

    @property
    def stems(self) -> list[str]:
        """Names of the figures, without those of slides."""
        stems = {path.stem for kind in ("png", "svg") for path in self.folder.glob(f"*.{kind}")}
        return sorted(stem for stem in stems if not stem.endswith(".slide"))

    def picture(self, stem: str, caption: str) -> str:
        kinds = [kind for kind in ("png", "svg") if (self.folder / f"{stem}.{kind}").is_file()]
        return f"![{escape(caption)}]({self.step.folder}/{stem}.{kinds[0]})" if kinds else ""


Steps = Mapping[str, StepResult]
"""The steps that are there, by the names of their folders, in their order."""


class MotionResults:
    """What the steps of one motion left, None where one left nothing; the names of the effects that the diagnosis
    `added` to the model (empty for none), and the parameters of the `base` that this moved."""

    def __init__(self, steps: Steps, motion: str) -> None:
        before = "" if motion in (YAW.name, "tune") else f"{motion}_"
        self.fit, self.validation = steps.get(motion), steps.get(f"{before}validation")
        self.diagnosis, self.final = steps.get(f"{before}diagnosis"), steps.get(f"{before}final_validation")
        file: DiagnosisFile | None = self.diagnosis.file if self.diagnosis else None
        self.added, self.base = "", dict[str, store.Moved]()
        if file is not None and file.verdict == NAMED and not file.of_thrusters:
            self.added, self.base = " and ".join(effect.name for effect in file.effects), dict(file.base)

    @property
    def superseded(self) -> StepResult | None:
        """The validation of a model that a diagnosis replaced by the final one, which was validated too."""
        return self.validation if self.final else None


def read_steps(folder: Path, steps: Iterable[CampaignStep] = STEPS) -> Steps:
    """Read those of the steps that are there. Raises OutputError for a file that automarine did not write so."""
    results = {}
    for step in steps:
        path = folder / step.folder / step.kind.file
        if path.is_file():
            file, manifest = step.kind.read(path, f"{step.folder}/{path.name}", OutputError), path.with_name(MANIFEST)
            record = read_manifest(manifest) if manifest.is_file() else None
            results[step.folder] = StepResult(step, path.parent, file, record)
    return results


@dataclass(frozen=True)
class StepOutcome:
    """What became of a step: it was "done", "kept", "skipped" or "refused", and why."""

    step: str
    did: str
    why: str = ""


@dataclass(frozen=True, repr=False)
class CampaignRun(Shown):
    """What `run` did in the folder `out`: its result file, its steps and their results; or why the campaign as a whole
    was refused."""

    out: Path
    content: RunFile
    steps: tuple[StepOutcome, ...] = ()
    results: Steps = field(default_factory=dict)
    refusal: str = ""

    @property
    def says(self) -> dict[str, str]:
        return headlines(self.results)

    @property
    def refused(self) -> tuple[str, ...]:
        steps = (f"{step.step}: {step.why}" for step in self.steps if step.did == "refused")
        return tuple(filter(None, [self.refusal, *steps]))

    @property
    def warnings(self) -> tuple[str, ...]:
        manifests = {result.step.name: result.manifest for result in self.results.values()}
        return tuple(f"{name}: {line}" for name, there in manifests.items() if there for line in there.warnings)

    def to_json(self) -> dict[str, object]:
        """Give the result file: schema automarine/run/1. It does not say what was kept: the bytes are the same."""
        return to_mapping(self.content)


@dataclass(frozen=True, repr=False)
class Campaigns(Shown):
    out: Path
    campaigns: Mapping[str, CampaignRun]

    @property
    def refused(self) -> tuple[str, ...]:
        return tuple(f"{name}: {why}" for name, run in self.campaigns.items() for why in run.refused)

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(f"{name}: {warning}" for name, run in self.campaigns.items() for warning in run.warnings)

    def to_json(self) -> dict[str, object]:
        entries = []
        for name, run in self.campaigns.items():
            says, content = run.says, run.content
            steps = [to_mapping(step) | {"says": says.get(step.step, "")} for step in content.steps]
            about = {"name": name, "title": content.title, "steps": steps, "cautions": list(content.cautions)}
            entries.append(about | {"refused": list(run.refused)})
        return {"schema": "automarine/campaigns/1", "campaigns": entries}


@sections.register
def _(result: CampaignRun) -> Sections:
    says, did = result.says, {step.step: step.did for step in result.steps}
    rows = [
        {"step": step.step, "": step.did, "because": (step.did == "done" and step.why) or MISSING,
         "result": says.get(step.step) or (step.why if step.did == "skipped" else MISSING)}
        for step in result.steps if step.did == "skipped" or step.step != REPORT
        if step.did != "skipped" or "-final" not in step.step  # where nothing was named, there is none
    ]  # fmt: skip
    written: tuple[str, ...] = ()
    if REPORT in did:
        written = REPORT_FILES if did[REPORT] in ("done", "kept") else (RUN_RESULT.file,)
    folders = [f"{folder}/" for folder in result.results]
    table = Table.of("", rows, header=("step",)).without_empty_columns()
    return Sections([table, *_sentences(result.results), *result.content.cautions], listed=(*written, *folders))


@sections.register
def _(result: Campaigns) -> Sections:
    rows = []
    for name, run in result.campaigns.items():
        cells = {step: run.says.get(step, MISSING) for step in ("fit-yaw", "validate", "diagnose")}
        cells["validate"] = run.says.get("validate-final", cells["validate"])
        rows.append({"campaign": name} | cells | {"refused": "; ".join(run.refused) or MISSING})
    table = Table.of("", rows)
    written: dict[str, Content] = {"campaigns.json": result.to_json(), "campaigns.csv": table.to_csv()}
    folders = [f"{name}/" for name in list(result.campaigns)[:MAX_CAMPAIGNS_LISTED]]
    return Sections([table], written, listed=("campaigns.csv", "campaigns.json", *folders))


def cautions(thrusters: ThrusterFile | None, supply: float | None) -> list[str]:
    """Say what does not fit together between the thruster tests and the vehicle: other voltages than its supply."""
    if supply is None or thrusters is None or thrusters.voltage_range_V is None:
        return []
    low, high = thrusters.voltage_range_V
    if low / SAME_VOLTAGE <= supply <= high * SAME_VOLTAGE:
        return []
    tested = " to ".join(dict.fromkeys(number(end, 3) for end in (low, high)))
    return [
        f"The thrusters were tested at {tested} V, the vehicle's supply is {number(supply, 3)} V: the map is "
        "extrapolated. Test at the supply voltage."
    ]


@dataclass(frozen=True)
class Report:
    """The report's files in memory, the steps that it tells of, and the folder `out` where it is."""

    files: Mapping[str, str]
    steps: Steps
    out: Path

    def to_json(self) -> dict[str, object]:
        missing = [step.folder for step in STEPS if step.always and step.folder not in self.steps]
        return {"schema": "automarine/report/1", "files": list(self.files), "steps": list(self.steps),
                "missing": missing}  # fmt: skip


@sections.register
def _(result: Report) -> Sections:
    return Sections([], listed=tuple(result.files))


def make_report(folder: Path, title: str | None = None, ran: RunFile | None = None) -> Report:
    """Make the report of a campaign's folder from its step folders, and from what `run` says of them. Steps that have
    no result have a line that says why. Raises OutputError if there is none at all."""
    steps, ran = read_steps(folder), ran or RunFile("")
    if not steps:
        raise OutputError(
            f"{folder}: none of the folders {', '.join(step.folder for step in STEPS if step.always)} with results is "
            "here; give a folder that automarine run made, or write the results of single commands into folders of "
            "these names"
        )
    title = title or ran.title or "Identification"
    lines = {step.name: "not run" for step in STEPS if step.always}
    lines |= {step.step: f"skipped: {step.skipped}" if step.skipped else "refused" for step in ran.steps}
    lines |= headlines(steps)
    numbers = {motion: rows for motion in (*DOFS, PLANAR.name) if (rows := _numbers(MotionResults(steps, motion)))}
    several = len(numbers) > 1
    grades = [{"motion": motion} | row if several else row for motion, rows in numbers.items() for row in rows]
    good_enough: list[Table | str] = ["## Is it good enough?", Table.of("", grades), WORST] if grades else []
    pages = [result for result in reversed(list(steps.values())) if result.step.section]
    motions = (MotionResults(steps, result.step.section) for result in pages)
    heroes = [of.final or (None if of.added else of.validation) for of in motions]  # first: of the final model
    pages.sort(key=lambda result: (SECTIONS.index(result.step.section), result not in heroes))
    manifests = [result.manifest for result in steps.values() if result.manifest]
    versions = {", ".join(map(" ".join, [("automarine", of.automarine), *of.libraries.items()])) for of in manifests}
    text = document(
        f"# {escape(title)}",
        *(f"**{step.step} was refused:** {escape(step.refused)}" for step in ran.steps if step.refused),
        *(f"**{escape(refusal)}**" for step in steps.values() if (refusal := _refusal(step.file))),
        _result_box(steps, ran, {motion: worst(rows) for motion, rows in numbers.items()}),
        bullets(escape(f"Caution: {line}") for line in ran.cautions),
        *good_enough,
        _set_aside(steps),
        *(block for result in pages for block in _page(result, MotionResults(steps, result.step.section))),
        *(_logs(steps["check"]) if "check" in steps else []),
        "## How this was made",
        Table.of("", [{"step": name, "result": lines[name]} for name in STEP_NAMES if name in lines]),
        *(f"Versions: {escape(line)}." for line in sorted(versions)),
        MADE if versions else None,
    )
    return Report({"report.html": page(text, folder, title), "report.md": text}, steps, folder)


def _result_box(steps: Steps, ran: RunFile, verdict: Mapping[str, str]) -> str:
    """The result in a few lines: what was tested, the final model, how far it is off, what is missing, the `verdict` by
    motion, what is next."""
    says, after, lines = headlines(steps), dict[str, str](), dict[str, dict[str, str]]()
    for result in steps.values():
        file, motion = result.file, result.step.section
        of_motion = MotionResults(steps, motion)
        if motion in ("", "thrusters") or result is of_motion.superseded:
            continue
        text = says[result.step.name].removeprefix("named: ").replace("nothing missing that", "nothing that")
        if isinstance(file, ModelFile | PlanarFile):
            after[motion] = DIAGNOSE if file.runs.used >= MIN_RUNS else MORE_RUNS
        if isinstance(file, ModelFile) and file.proposed and of_motion.diagnosis is None:
            asks = ", ".join(f"{name} (gains {number(gain, 3)} in deviance)" for name, gain in file.proposed.items())
            lines.setdefault(MISSES, {})[motion] = f"the fit itself asks for {asks}"
            after[motion] = f"Fit again with {' and '.join(file.proposed)}: `--with {','.join(file.proposed)}`."
        if isinstance(file, DiagnosisFile):
            sizes = (_values(effect.parameters) for effect in file.effects if not effect.name.startswith(PREFIX))
            text = "; ".join([text, *filter(None, sizes)])
            there = [effect.name for effect in file.effects if motion in DOFS and effects.known(effect.name)]
            advice = " ".join(effects.get(name).card(result.dof).better for name in there)
            after[motion] = advice or (USE if file.verdict == NOTHING else PLAN_RUNS)
            if file.verdict == NAMED:
                place, says_use = f"{result.step.folder}/extended_model.json", USE_EXTENDED
                if of_motion.added and _not_better(of_motion):
                    says_use = NOT_BETTER
                after[motion] = says_use.format(of_motion.added, place, after[motion])
        lines.setdefault(BOX_LABELS.get(result.step.kind.name, result.step.title), {})[motion] = text
    tested = ", ".join(filter(None, [ran.vehicle, says.get("check"), _dates(steps)]))
    lines |= {label: lines.pop(label, {}) for label in BOX_LABELS.values()}  # in this order, whatever was done first
    texts = {label: _of_motions(texts, "; ") for label, texts in {**lines, "Verdict": verdict}.items()}
    box = [f"**{label}:** {escape(text)}" for label, text in {"Tested": tested, **texts}.items() if text]
    return bullets([*box, *(f"**Next:** {text}" for text in [_of_motions(after, " ")] if text)])


def _of_motions(texts: Mapping[str, str], between: str) -> str:
    """Texts by motion in a line, with its name before each where there are several."""
    several = len(texts) > 1
    return between.join(f"{motion}: {text}" if several else text for motion, text in texts.items() if text)


def _numbers(of_motion: MotionResults) -> list[dict[str, str]]:
    """Rows of what says whether the final model of a motion is good enough; none where there is no model."""
    fit, diagnosis, base = of_motion.fit, of_motion.diagnosis, of_motion.base
    if fit is None:
        return []
    validation = of_motion.final if of_motion.added else of_motion.validation
    values = {name: base[name].after if name in base else value for name, value in _main(fit.file).items()}
    estimates = {name: value.estimate for name, value in values.items() if value.stderr != 0}
    runs = (diagnosis if diagnosis and of_motion.added else fit).file.runs
    return list(five_numbers(runs, estimates, *(step.file if step else None for step in (validation, diagnosis))))


def _main(file: ModelFile | PlanarFile) -> dict[str, Given]:
    """Inertia and main drag of a model, by their names."""
    if isinstance(file, PlanarFile):
        return {name: value for name, value in file.parameters.items() if name in MASSES}
    values, names = dict(file.main_parameters()), file.dof.symbols
    return {name: value for name, value in values.items() if name != names.linear or names.quadratic not in values}


def five_numbers(
    runs: RunsUsed, estimates: Mapping[str, Estimate | None], validation: ValidationFile | None,
    diagnosis: DiagnosisFile | None,
) -> Iterator[dict[str, str]]:  # fmt: skip
    """Give a row of each number with its verdict, a dash for what was not measured."""
    of_restarts, of_ahead = _errors(validation) if validation else (("not validated", ""),) * 2
    every, aside = runs.used + len(runs.set_aside), len(runs.set_aside)
    few = runs.used < MIN_RUNS_USED or aside > MAX_SET_ASIDE_SHARE * every
    of_runs = f"{runs.used} of {every}", CLOSER if few else GOOD
    found = (of_runs, _widest(estimates), of_restarts, of_ahead, _diagnosis(diagnosis))
    for (name, (good, unfit)), (value, verdict) in zip(GRADE_LIMITS.items(), found):
        row = {"look at": name, "verdict": verdict or MISSING, "value": value}
        yield {**row, f"{GOOD} if": good, f"{UNFIT} if": unfit}


def worst(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the verdict that decides, and what it is for or what was not measured; empty where there are no rows."""
    grades = {row["look at"]: row["verdict"] for row in rows}
    for grade in (UNFIT, CLOSER):
        if bad := [name for name, verdict in grades.items() if verdict == grade]:
            return f"{grade} ({', '.join(bad)})"
    unknown = [name for name, *ways in MEASURES if rows and all(grades[way] == MISSING for way in ways)]
    if unknown:
        return f"{GOOD}, but not known: {', '.join(unknown)}"
    return GOOD if rows else ""


def _graded(value: float, limits: tuple[float, float]) -> str:
    return GRADES[sum(value > limit for limit in limits)]


def _widest(estimates: Mapping[str, Estimate | None]) -> tuple[str, str]:
    """Judge the widest interval."""
    widths = [(max(e.ci95[1] - e.value, e.value - e.ci95[0]) / max(abs(e.value), 1e-300), name)
              for name, e in estimates.items() if e is not None]  # fmt: skip
    if bound := [name for name, e in estimates.items() if e is not None and e.at_bound]:
        return f"{bound[0]} at its bound", UNFIT
    if not widths:
        return MISSING, ""
    width, name = max(widths)
    return f"± {number(100 * width, 2)} % ({name})", _graded(width, RELATIVE_HALF_WIDTHS)


def _ahead(file: ValidationFile) -> ForecastEntry | None:
    """What the filter predicts of driven runs, as far ahead as it is judged; None for other runs."""
    entries = {entry.horizon_s: entry for entry in file.prediction.get(file.judged, ()) if entry.rmse is not None}
    return entries.get(JUDGED_HORIZON_S)


def _better_constant(ahead: ForecastEntry) -> float:
    return min(size for size in (ahead.constant_rate, ahead.constant, math.inf) if size is not None)


def _errors(file: ValidationFile) -> tuple[tuple[str, str], tuple[str, str]]:
    """Judge the restarted error, of driven runs that of predictions instead."""
    score, unit = file.models[file.judged], file.dof.units.shown
    if (ahead := _ahead(file)) and ahead.rmse is not None:
        constant = _better_constant(ahead)
        value = f"{number(ahead.rmse, 3)} {unit}, the better constant's {number(constant, 3)} {unit}"
        grade = _graded(ahead.rmse / max(constant, 1e-9), AHEAD_ERROR_RATIOS)
        if grade == UNFIT and file.use.of_use:
            value, grade = f"{value}, flattered by commands that answer disturbances", CLOSER
        return ("driven runs", ""), (value, grade)
    if score.restarted is None or not file.expected:
        return (MISSING if score.restarted is None else f"{number(score.restarted, 3)} {unit}", ""), (MISSING, "")
    ratio = score.restarted / file.expected
    right = f"{number(ratio, 2)} times the {number(file.expected, 2)} {unit} of a right model"
    value = f"{number(score.restarted, 3)} {unit}, {right}"
    return (value, _graded(ratio, RESTARTED_ERROR_RATIOS)), ("not of driven runs", "")


def _diagnosis(file: DiagnosisFile | None) -> tuple[str, str]:
    if file is None:
        return "not diagnosed", ""
    rivals = sum(len(effect.rivals) for effect in file.effects)
    names = ", ".join(effect.name for effect in file.effects)
    value = file.verdict.replace("-", " ") + (f": {names}" if names else "")
    verdict = DIAGNOSED.get(file.verdict, CLOSER)
    if file.verdict == NAMED and rivals:
        return f"{value}, {plural(rivals, 'rival')} not excluded", CLOSER
    return value, verdict


def _sentences(steps: Steps) -> list[str]:
    """What the validations of the final models and the diagnoses say first."""
    says, sentences = headlines(steps), list[str]()
    for result in steps.values():
        motion, text = result.step.section, ""
        if isinstance(result.file, DiagnosisFile):
            text = plain(next((line for line in result.markdown().splitlines()[1:] if line), ""))
        elif isinstance(result.file, ValidationFile) and result is not MotionResults(steps, motion).superseded:
            use = result.file.use.says
            text = use if isinstance(use, str) else " ".join(use)
            error = "" if motion == PLANAR.name else f"{result.dof.position} error of "
            text = " ".join(filter(None, [result.file.contradiction, text or f"{error}{says[result.step.name]}."]))
        if text:
            text = text if motion == YAW.name else f"{motion}: {text}"
            sentences.append(text[0].upper() + text[1:])
    return sentences


def _dates(steps: Steps) -> str:
    """The days of the runs, where their clocks know them."""
    runs = steps["check"].file.yaw_runs if "check" in steps else ()
    begins = [float(run["begins_s"]) for run in runs if run.get("begins_s")]
    days = sorted({datetime.fromtimestamp(at, UTC).date().isoformat() for at in begins if at > FIRST_DATE_S})
    return " to ".join(dict.fromkeys(days[:: max(len(days) - 1, 1)]))


def _refusal(file: Any) -> str:
    """Why a model must not be used; empty where it may, and for results of other kinds."""
    if isinstance(file, ValidationFile):
        return file.use.refusal
    inertia = isinstance(file, ModelFile) and file.chosen.inertia and file.chosen.inertia.estimate
    if inertia and inertia.ci95[1] - inertia.ci95[0] > 2.0 * abs(inertia.value):
        return f"These runs do not determine {file.dof.symbols.inertia}; add runs from rest at larger commands."
    return file.prediction.refusal if isinstance(file, ModelFile | PlanarFile) else ""


def headlines(steps: Steps) -> dict[str, str]:
    """Say what each result is in a few words, by the name of its step: first that a model must not be used, where so;
    models with what a diagnosis named."""
    texts = {}
    for result in steps.values():
        text = _headline(result, MotionResults(steps, result.step.section))
        texts[result.step.name] = f"not usable: {text}" if _refusal(result.file) else text
    return texts


def _headline(result: StepResult, of_motion: MotionResults) -> str:
    file = result.file
    match file:
        case CheckFile():
            idle = [str(run.get("run")) for run in file.yaw_runs if run.get("half_turn") is None]
            without = f"{len(idle)} without a half-turn ({listed(idle)})" if idle else ""
            aside = f"{len(file.runs.set_aside)} set aside" if file.runs.set_aside else ""
            return ", ".join(filter(None, [plural(file.logs, "log"), plural(file.runs.used, "run"), without, aside]))
        case ThrusterFile():
            laws = {"forward": file.a_forward, "backward": file.a_backward} if file.form == "square" else {}
            values = "".join(f", a {side} {_interval(a)}" for side, a in laws.items() if a is not None)
            error = f"R² {number(file.r2)}, error {number(file.error_percent, 2)} % of full scale"
            return f"{file.chosen or file.form} law{values}, {error}"
        case ModelFile():
            before, base = dict(file.main_parameters()), of_motion.base
            after, model = {name: base[name].after for name in before if name in base}, named_model(file.preferred)
            if len(after) < len(before):
                return f"{model}: {_values(before)}"
            alone = ", ".join(number(value.value) for value in before.values())
            return f"{model} with {of_motion.added}: {_values(after)} (without: {alone})"
        case PlanarFile():
            return f"{file.structure}: {_values(masses)}" if (masses := _main(file)) else file.structure
        case ValidationFile():
            return _of_validation(file, result, of_motion)
        case DiagnosisFile():
            if file.verdict == NOTHING:
                return f"nothing missing that these {'levels' if file.of_thrusters else 'runs'} could show"
            names = ", ".join(effect.name for effect in file.effects)
            verdict = file.verdict.replace("-", " ") + (f": {names}" if names else "")
            gap, of = (file.gap, "") if file.gap_held_out is None else (file.gap_held_out, " of runs held out")
            sizes = f"error{of} {number(gap.before, 3)} to {number(gap.after, 3)} {file.unit}"
            if free := file.from_commands:
                commands = f"{number(free.before, 3)} to {number(free.after, 3)} from commands"
                sizes += f" with own thrust and start, {commands}"
            return f"{verdict}; {sizes}"
    return f"{file.verdict.replace('-', ' ')} for {file.target}"


def _of_validation(file: ValidationFile, result: StepResult, of_motion: MotionResults) -> str:
    """How far the preferred model is from runs: those that it was fitted to are told by the content of their logs."""
    final, score, unit = result.step.final, file.models[file.judged], result.dof.units.shown
    fit = of_motion.diagnosis if final else of_motion.fit
    again = len(fit.logs & result.logs) if fit else 0
    fitted = " not fitted" if fit and fit.logs else ""
    if again:
        fitted = f" ({again} logs were fitted)"
    name = of_motion.added and f"{'the model with' if final else 'without'} {of_motion.added}"
    plane, sizes = file.motion == PLANAR.name, _sizes(file)
    errors = [f"{number(size, 3)} {unit} {what}" for what, size in sizes.items() if not plane or what == FREE_RUN]
    errors[[*sizes].index(FREE_RUN)] = (
        f"{'heading ' if plane else ''}{with_band(score.rmse, score.ci95)} {unit} {FREE_RUN}"
    )
    if not plane and not final:
        name = ", ".join(filter(None, [name, named_model(file.judged)]))
    if final and of_motion.validation is not None:
        without = [number(size, 3) for size in _sizes(of_motion.validation.file).values()][: len(errors)]
        errors[-1] += f" (without: {', '.join(without)})"
    if file.motion != PLANAR.name:
        errors.append(f"noise {number(file.noise_floor, 2)} {unit}")
    text = ", ".join([*errors, f"over {plural(file.runs.used, 'run')}{fitted}"])
    return f"{name}: {text}" if name else text


def _sizes(file: ValidationFile) -> dict[str, float | None]:
    """Give the errors of the model that counts, of driven runs first what its predictions miss."""
    score, ahead = file.models[file.judged], _ahead(file)
    return ({FORECAST: ahead.rmse} if ahead else {}) | {FREE_RUN: score.rmse, RESTARTED: score.restarted}


def _not_better(of_motion: MotionResults) -> bool:
    """Whether what a diagnosis named leaves the error that counts on runs not fitted as large as it was."""
    if of_motion.final is None or of_motion.validation is None:
        return False
    counts = FORECAST if _ahead(of_motion.final.file) else FREE_RUN
    after, before = (_sizes(result.file).get(counts) for result in (of_motion.final, of_motion.validation))
    return after is None or (before is not None and after >= before)


def _values(parameters: Mapping[str, Given]) -> str:
    """Sizes with their intervals; what a fit did not move is left out."""
    return ", ".join(f"{name} {_interval(value)}" for name, value in parameters.items() if value.stderr != 0)


def _interval(value: Given) -> str:
    unit = value.unit.removeprefix("1")  # without one
    return f"{interval(value.estimate)} {unit}".rstrip() if value.estimate else number(value.value)


def _logs(result: StepResult) -> list[str]:
    """Every run as it was logged, and its row in the table of `check`."""
    pages = {stem: stem.replace("_", " ").replace("runs ", "runs, page ").capitalize() for stem in result.stems}
    pictures = [result.picture(stem, AS_LOGGED.format(page)) for stem, page in pages.items()]
    return ["## Logs", "\n".join(pictures), _folded("Every run", result.markdown().strip())]


def _runs(result: StepResult) -> str:
    """Pictures of the runs of a validation, the worst first, in one block: the page shows one of them, which is
    chosen by its name."""
    score, ahead, unit = result.file.models[result.file.judged], _ahead(result.file), result.dof.units.shown
    errors = {name: of_run.rmse for name, of_run in score.runs.items()} | (dict(ahead.runs) if ahead else {})
    sizes = {name: math.inf if size is None else size for name, size in errors.items()}  # those that diverge
    order = sorted(zip(sizes, file_stems(list(sizes))), key=lambda run: -sizes[run[0]])
    after = f" {unit}" + (f" {FORECAST}" if ahead else "")
    drawn = [
        result.picture(f"validation_{stem}", OF_A_RUN.format(name, f"{sizes[name]:.3g}{after}")) for name, stem in order
    ]
    more = len(drawn) - MAX_FIGURES
    tail = f"\n\nThe figures of {more} more runs are in the folder {result.step.folder}." if more > 0 else ""
    return "\n".join(filter(None, drawn[:MAX_FIGURES])) + tail


def _page(result: StepResult, of_motion: MotionResults) -> list[str]:
    """The page of a step: its Markdown with headings a level lower and pictures by their place from here, and the
    figures that it does not show. What was rejected is folded, and so is where nothing missing was looked for."""
    file, title, added = result.file, f"## {result.step.title}", of_motion.added
    text = re.sub(r"^## ", "### ", re.sub(r"\A# .*\n", "", result.markdown()), flags=re.MULTILINE)
    inside = re.compile(r"^!\[(.*)\]\((\w+)\.\w+\)$", flags=re.MULTILINE)
    text = inside.sub(lambda match: result.picture(match[2], match[1]), text)
    if result is of_motion.superseded:
        return [f"{title} without {added}", _folded("Tables of the models without it", text)]
    apart = [stem for stem in result.stems if f"/{stem}." not in text]
    if isinstance(file, DiagnosisFile) and file.verdict == NOTHING:
        apart = [stem for stem in apart if stem != "before_after"]
        begin, heading, tried = text.partition("### Where")
        text = begin + _folded("What was tried", heading + tried)
    words = {stem: CAPTIONS.get(stem) or CAPTIONS.get(stem.partition("_")[0], stem) for stem in apart}
    pictures = [result.picture(stem, words[stem]) for stem in apart]
    if isinstance(file, ModelFile):
        rejected = tuple(f"Model {number}" for number in file.models if number != file.preferred)
        used, buoyancy = sensor_sentences(file.channels, result.dof), str(file.buoyancy.get("says", ""))
        lines = [file.preferred_because, *used, buoyancy]
        if added:
            lines.insert(0, WITHOUT.format(added))
        lines += [f"Warning: {line}" for line in file.warnings if not line.startswith(rejected)]
        rows = [{"parameter": name, "value [95 % interval]": _interval(e)} for name, e in file.main_parameters()]
        table = Table.of(named_model(file.preferred).capitalize(), rows).to_markdown()
        return [title, *map(escape, lines), table, *pictures, _folded("Tables 1 and 2: all models", text)]
    if isinstance(file, ValidationFile):
        table = _compared(result, of_motion).to_markdown()
        scores = text if file.motion == PLANAR.name else _folded("Every score and run", text)
        return [title, escape(file.contradiction), _runs(result), table, scores]
    return [title, text, *pictures]


def _compared(result: StepResult, of_motion: MotionResults) -> Table:
    """Lay out the errors of the final model, of the one without what was named, and those to be compared with."""
    file, added, unit = result.file, of_motion.added, result.dof.units.shown
    of = {f"final, with {added}" if result.step.final else named_model(file.judged): _sizes(file)}
    if result.step.final and of_motion.validation is not None:
        of[f"without {added}"] = _sizes(of_motion.validation.file)
    if file.expected is not None:
        of["noise and unsteady thrust alone"] = {RESTARTED: file.expected}
    if ahead := _ahead(file):
        of[f"a constant {file.dof.words.position} or {file.dof.words.speed}"] = {FORECAST: _better_constant(ahead)}
    rows = [
        {"model": name} | {f"{what} [{unit}]": number(sizes.get(what), 3) for what in (FORECAST, FREE_RUN, RESTARTED)}
        for name, sizes in of.items()
    ]
    note = f"Errors over {plural(file.runs.used, 'run')}."
    return Table.of("", rows, [note]).without_empty_rows().without_empty_columns()


def _folded(summary: str, text: str) -> str:
    return f"<details><summary>{summary}</summary>\n\n{text}\n\n</details>" if text else ""


def _set_aside(steps: Steps) -> str:
    folders: dict[ExcludedRun, list[str]] = {}
    for folder, result in steps.items():
        for run in result.file.runs.set_aside:
            folders.setdefault(run, []).append(folder)
    rows = [
        {"log": run.file, "run": run.run, "why": run.why, "left out of": ", ".join(names)}
        for run, names in folders.items()
    ]
    return _folded(f"{plural(len(rows), 'run')} set aside", Table.of("", rows).to_markdown()) if rows else ""
