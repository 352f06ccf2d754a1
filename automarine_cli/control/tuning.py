"""The result of `tune`: a model or a diagnosis -> gains of a controller with their margins, or why none can be
promised; and a log flown with gains against what was promised of them."""

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.control.design import EXACT, Designed, Outcome, Setup, Task, design, fly, problem_of, step_scores
from automarine_cli.control.knowledge import EXTENDED, SUPPLY, Knowledge, authority, read_knowledge
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import present_gains
from automarine_cli.dofs import Dof
from automarine_cli.errors import ModelError, RunError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.logs import ColumnMap, LogFile, given_columns
from automarine_cli.models.store import DIAGNOSIS
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import Document, ResultKind, ResultRecord, Shown, Source, json_document, read_plain
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run, position_noise
from automarine_cli.thrusters.map import ThrusterMap, map_and_arm

BAND_DEG, BAND_M = 2.0, 0.05  # within what a step counts as settled: the field's two degrees of heading, and 5 cm
STEP_DEG, STEP_M = 90.0, 1.0
QUANTILES = (0.025, 0.5, 0.975)
RECORDED = (
    "target", "step", "load", "margin", "full", "arm", "delay", "supply", "sample_time", "beyond_range", "seed",
)  # fmt: skip


def set_up(
    model: Source, *, target: str, extended: Source | None = None, step: float | None = None, load: float = 10.0,
    margin: float = 0.75, full: float | None = None, thrusters: Source | ThrusterMap | None = None,
    arm: float | None = None, columns: Source | ColumnMap | None = None, delay: float | None = None,
    supply: tuple[float, float] = SUPPLY, sample_time: float | None = None, beyond_range: bool = False, seed: int = 0,
) -> Setup:  # fmt: skip
    """Read and check what a tuning is made of.

    `model` is that of a fit, or a diagnosis whose model is `extended`; `step` in degrees or metres, `load` [%] of the
    whole output, disk `margin` to keep; `full` moment or force of the whole output; `delay` [s] that the logs cannot
    show, `supply` voltage in shares of that of the logs; `seed` draws the vehicles. Raises ModelError or SettingError.
    """
    if read_plain(model, "JSON", ModelError).get("schema") != DIAGNOSIS.schema:
        knowledge = read_knowledge(model, None, delay, supply)
    elif extended is None:
        raise ModelError(f"{model.name}: its {EXTENDED} is not beside it; keep both in one folder")
    else:
        knowledge = read_knowledge(extended, model, delay, supply)
    stack, dof = get(target, sample_time, beyond_range), knowledge.model.dof
    if dof.name not in stack.motions:
        raise ModelError(
            f"{knowledge.stored.source} is a model of {dof.name}; {stack.name} controls {' or '.join(stack.motions)}"
        )
    if thrusters is not None and not dof.levered:
        raise SettingError(f"--thrusters makes turning moments; for {dof.name} give --full with the whole force")
    most, bend = authority(stack, knowledge, full, map_and_arm(thrusters, arm, given_columns(columns), dof))
    step = step if step is not None else STEP_DEG if dof.wraps else STEP_M
    band = dof.inner(BAND_DEG if dof.wraps else BAND_M)
    return Setup(stack, knowledge, most, bend, Task(dof.inner(step), band, load / 100.0, margin, 0.0), seed)


@dataclass(frozen=True, kw_only=True)
class TuningFile(ResultRecord):
    """`tuning.json`: what became of the gains of a target."""

    verdict: str
    target: str


TUNING = ResultKind("tuning.json", "tuning", TuningFile, "tune")


@dataclass(frozen=True, repr=False)
class Tuning(Shown):
    """The verdict, what it rests on, and the `settings` of `set_up`."""

    designed: Designed
    knowledge: Knowledge
    settings: Mapping[str, Any]

    @property
    def source(self) -> str:
        return self.knowledge.stored.source

    def to_json(self) -> dict[str, Any]:
        designed, new, old, task = self.designed, self.designed.new, self.designed.old, self.designed.task
        target, nominal, dof = designed.target, designed.nominal, designed.nominal.dof
        return {
            "schema": TUNING.schema, "verdict": designed.verdict, "why": designed.why,
            "target": target.name, "firmware": target.firmware or None, "motion": dof.name, "model": self.source,
            f"{dof.words.force}_unit": nominal.force_unit, f"full_{dof.words.force}": nominal.full,
            "sample_time_s": target.period, f"step_{dof.units.log}": dof.logged(task.step),
            f"settled_within_{dof.units.key}": dof.shown(task.band), "load_percent": 100.0 * task.load,
            "margin_asked": task.margin, "flight_s": task.seconds,
            "gains": self.gains(),
            "disk_margin": None if new is None else _json(margins_of(new)["disk_margin"]),
            "margins": {
                name: {key: _json(value) for key, value in margins_of(outcome).items()} | {
                    "share_with_margin": outcome.share_with(task.margin),
                    "stable": float(outcome.margins.stable.mean()),
                } for name, outcome in self.outcomes()
            },
            "promised": None if new is None else self._promised(new),
            "present": None if old is None else self._promised(old),
            "vehicles": sum(len(crowd) for crowd in designed.crowds),
            "explanations": [crowd.name for crowd in designed.crowds],
            "settled_by": designed.run or None,
            "notes": list(designed.notes),
            "present_gains": None if old is None else dict(old.gains),
            "made_from": {
                "settings": {name: self.settings[name] for name in RECORDED},
                "files": {
                    key: {"name": file.name, "content": read_plain(file, "JSON", ModelError)}
                    for key in ("model", "extended", "thrusters")
                    if isinstance(file := self.settings[key], Source)
                },
            },
        }  # fmt: skip

    def outcomes(self) -> list[tuple[str, Outcome]]:
        return [(n, x) for n, x in (("present", self.designed.old), ("new", self.designed.new)) if x is not None]

    def gains(self) -> dict[str, dict[str, object]]:
        new, old = self.designed.new, self.designed.old
        if new is None:
            return {}
        unit = self.designed.nominal.dof.units.base
        return {
            gain.name: {
                "value": new.gains[gain.name], "before": None if old is None else old.gains.get(gain.name),
                "unit": gain.unit.replace("{x}", unit),
                "documented": [gain.low, gain.high] if math.isfinite(gain.high) else None,
            }
            for gain in self.designed.target.parameters
        }  # fmt: skip

    def _promised(self, outcome: Outcome) -> dict[str, Any]:
        bands = {name: _json(value) for name, value in promises(outcome, self.designed).items()}
        return bands | {"settles": float(outcome.scores.settles.mean())}

    @property
    def plan_command(self) -> str:
        """The line that plans runs which separate what a diagnosis left tied, or narrow the effect that is not known;
        empty where nothing is open, or nothing can be planned."""
        dof, effect = self.designed.nominal.dof, self.designed.open
        if not effect or not dof.wraps:
            return ""
        model, extended = (self.settings[key] for key in ("model", "extended"))
        files = [model] if extended is None else [extended, "--diagnosis", model]
        parameters = [dof.symbols.inertia]
        if effect not in self.knowledge.splits:
            parameters.append(f"{effect} {effects.get(effect).names_in(dof)[0]}")
        wanted = [word for name in parameters for word in ("--parameter", name)]
        named = [file.name if isinstance(file, Document) else str(file) for file in files]
        return shlex.join(["automarine", "plan", *named, *wanted, "-o", "out/plan"])

    def target_text(self) -> str:
        designed = self.designed
        assert designed.new is not None
        share = f"{designed.new.share_with(designed.task.margin):.0%}"
        holds = f"Disk margin {designed.task.margin:g} or more for {share} of the vehicles that the model allows."
        notes = [f"From {self.source} by automarine tune.", holds]
        if designed.target.beyond and designed.target.firmware:
            notes.append("Warning: values may lie beyond the documented ranges.")
        before = {} if designed.old is None else designed.old.gains
        notes += [f"{name} was {before[name]:.6g}" for name in designed.target.searched if name in before]
        return designed.target.text(designed.new.gains, designed.nominal, notes)


def make_tuning(*, present: Source | None, **settings: Any) -> Tuning:
    """Design gains by the settings of `set_up`; `present` is a file of the gains flown so far.

    Raises ModelError or SettingError."""
    setup = set_up(**settings)
    return Tuning(design(setup, present_gains(setup.target, present)), setup.knowledge, settings)


def banded(values: Floats, unit: str) -> Estimate | None:
    """Median and the band of 95 % of a crowd's values, one end open where they are infinite; None without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    low, middle, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in QUANTILES)
    return Estimate(middle, float(np.std(finite)), (low, high), unit)


def promises(outcome: Outcome, designed: Designed) -> dict[str, Estimate | None]:
    """What a set of gains comes to, by key of the result file."""
    dof, scores = designed.nominal.dof, outcome.scores
    return {
        "overshoot_percent": banded(100.0 * scores.overshoot, "%"),
        "settling_s": banded(scores.settling, "s"),
        f"rms_after_{dof.units.key}": banded(dof.shown(scores.rms), dof.units.shown),
        f"load_error_{dof.units.key}": banded(dof.shown(scores.error), dof.units.shown),
    }


def margins_of(outcome: Outcome) -> dict[str, Estimate | None]:
    margins = outcome.margins
    return {
        "disk_margin": banded(margins.disk, "1"),
        "gain_margin_dB": banded(margins.gain, "dB"),
        "phase_margin_deg": banded(margins.phase, "deg"),
        "delay_margin_s": banded(margins.delay, "s"),
    }


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    """An estimate; an end that is infinite is null."""
    if estimate is None:
        return None
    value, low, high = (None if x == math.inf else x for x in (estimate.value, *estimate.ci95))
    return {"value": value, "stderr": estimate.stderr, "ci95": [low, high], "unit": estimate.unit}


REFERENCES = ("target", "reference", "desired", "DesYaw", "YDes")  # parts of the names of columns that hold a reference
SMOOTHED_S, STEADY_S, LEAST = 0.5, 3.0, 5.0
"""Readings are averaged over so long, a reference stays for so long at least, and a step is so many bands large."""


@dataclass(frozen=True)
class Compared:
    """A figure of a step as flown, and the band of 95 % that was promised; infinite where it never settled."""

    value: float
    band: tuple[float, float]
    in_band: bool


@dataclass(frozen=True)
class FlownStep:
    """A step of the reference: when it `begins` [s in the log], its size, what came of it by key of the result file
    [percent, s, degrees or centimetres], and the curves: `time` (N,), `reference` (N,), `position` (N,) as read, `low`
    and `high` (N,) of the promise, all less the position before."""

    run: str
    begins: float
    size: float
    figures: Mapping[str, Compared]
    time: Floats
    reference: Floats
    position: Floats
    low: Floats
    high: Floats

    @property
    def held(self) -> bool:
        return all(figure.in_band for figure in self.figures.values())

    def to_json(self, dof: Dof) -> dict[str, Any]:
        figures = {}
        for key, figure in self.figures.items():
            flown, *promised = (x if math.isfinite(x) else None for x in (figure.value, *figure.band))
            figures[key] = {"flown": flown, "promised": promised, "held": figure.in_band}
        step = {f"step_{dof.units.log}": dof.logged(self.size)}
        return {"run": self.run, "begins_s": self.begins, **step, "held": self.held, "figures": figures}


@dataclass(frozen=True, repr=False)
class TuningCheck(Shown):
    """The steps of a log beside what was promised."""

    steps: tuple[FlownStep, ...]
    dof: Dof

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": "automarine/tuning-check/1",
            "motion": self.dof.name,
            "verdict": "held" if all(step.held for step in self.steps) else "not-held",
            "steps": [step.to_json(self.dof) for step in self.steps],
        }


def check_tuning(
    tuning: Source, logs: Sequence[LogFile], reference: str | None, columns: Source | ColumnMap | None,
    progress: Progress = silent,
) -> TuningCheck:  # fmt: skip
    """Compare logs that were flown with the gains of a `tuning.json` with what was promised of them.

    Raises ModelError for another file, LogError or RunError for logs without a step."""
    setup, gains = _of_tuning(tuning)
    dof, task = setup.knowledge.model.dof, setup.task
    runs = load_runs(logs, given_columns(columns), dof=dof, progress=progress).runs
    problem, sets = problem_of(setup), {name: np.full((1, 1), value) for name, value in gains.items()}
    target = problem.limit_rate(EXACT)

    def promise(time: Floats, wish: Floats) -> tuple[Floats, Floats]:
        """Time (M,) and positions (S, M) of every vehicle that follows a reference from rest."""
        clock = np.arange(max(2, round(float(time[-1]) / target.period))) * target.period
        setpoint = np.interp(clock, time, wish)[None, None]
        flights = [fly(target, sets, crowd, setpoint, np.zeros((1, 1))) for crowd in problem.crowds]
        return flights[0].time, np.concatenate([flight.position[:, 0] for flight in flights])

    steps = []
    for run in runs:
        setpoint = reference_of(run, reference)
        steps += [_flown(run, setpoint, part, task, promise) for part in _steps(run.time, setpoint, task.band)]
    if not steps:
        least = f"{dof.logged(LEAST * task.band):g} {dof.units.log}"
        raise RunError(
            f"{runs[0].source}: no change of the reference of {least} or more; make one step and hold it until the "
            "vehicle is at rest"
        )
    return TuningCheck(tuple(steps), dof)


def _of_tuning(tuning: Source) -> tuple[Setup, dict[str, float]]:
    """What a tuning was made of, and the gains that it gave or left."""
    data = read_plain(tuning, "JSON", ModelError)
    recipe: Any = data.get("made_from")
    if data.get("schema") != TUNING.schema or not isinstance(recipe, dict):
        raise ModelError(f"{tuning.name}: this is no tuning; give the tuning.json that `automarine tune` wrote")
    gains: Any = data.get("gains") or data.get("present_gains")
    if not gains:
        raise ModelError(f"{tuning.name}: it gave no gains ({data.get('verdict')}); tune again, and fly those")
    files = {key: json_document(file["name"], file["content"]) for key, file in recipe["files"].items()}
    settings = {**recipe["settings"], "supply": tuple(recipe["settings"]["supply"]), **files}
    flown = {name: float(gain["value"] if isinstance(gain, dict) else gain) for name, gain in gains.items()}
    return set_up(**settings), flown


def reference_of(run: Run, column: str | None) -> Floats:
    """The reference of a run in base units (N,), unwrapped. Raises RunError where no column holds one."""
    dof = run.dof
    names = [column] if column else [n for n in run.extras if any(part.lower() in n.lower() for part in REFERENCES)]
    if not names or names[0] not in run.extras:
        description = f"column {column!r}" if column else "column with the reference (such as target_heading_deg)"
        raise RunError(
            f"{run.source}, run {run.name!r}: there is no {description}; name it with --reference, from "
            f"{', '.join(run.extras) or 'none'}"
        )
    values = run.extras[names[0]]
    inner = values if names[0].endswith(("_rad", "_m")) or not dof.wraps else dof.inner(values)
    return np.unwrap(inner) if dof.wraps else inner


def _steps(time: Floats, reference: Floats, band: float) -> Iterator[slice]:
    """Each step that is large and held, to the last sample before the next one."""
    moves = np.flatnonzero(np.abs(np.diff(reference)) > 0.1 * band)
    if not len(moves):
        return
    groups = np.split(moves, np.flatnonzero(np.diff(time[moves]) > 1.0) + 1)
    ends = [*(int(group[0]) for group in groups[1:]), len(time) - 1]
    for group, end in zip(groups, ends):
        first, after = int(group[0]), int(group[-1]) + 1
        if abs(reference[after] - reference[first]) >= LEAST * band and time[end] - time[after] >= STEADY_S:
            yield slice(first, end + 1)


def _flown(
    run: Run, reference: Floats, part: slice, task: Task, promise: Callable[[Floats, Floats], tuple[Floats, Floats]]
) -> FlownStep:
    """A step of a run beside the same flown by every vehicle, all less the position before."""
    dof, start, size = run.dof, reference[part][0], float(reference[part][-1] - reference[part][0])
    time = run.time[part] - run.time[part][0]
    turns = np.round((run.position[part][0] - start) / (2.0 * np.pi)) if dof.wraps else 0.0
    measured = run.position - 2.0 * np.pi * turns - start
    width = max(1, round(SMOOTHED_S / float(np.median(np.diff(run.time)))))
    smooth = np.convolve(np.pad(measured, width // 2, mode="edge"), np.ones(width) / width, mode="same")
    smooth = smooth[width // 2 : width // 2 + len(measured)][part]
    noise = float(position_noise(run.time, run.position) / np.sqrt(width))
    clock, flown = promise(time, wish := reference[part] - start)
    longer = 0.3 + float(np.median(np.diff(time)))
    figures = {}
    for (key, unit, spare), value, values in zip(
        (
            ("overshoot_percent", 100.0, 3.0 * noise / abs(size)),
            ("settling_s", 1.0, longer),
            (f"rms_after_{dof.units.key}", float(dof.shown(1.0)), 2.0 * noise),
        ),
        step_scores(time, smooth[None], size, task.band + 2.5 * noise),
        step_scores(clock, flown, size, task.band),
    ):
        low, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in QUANTILES[::2])
        held = bool(low - spare <= value[0] <= high + spare)
        figures[key] = Compared(unit * float(value[0]), (unit * low, unit * high), held)
    band = [np.interp(time, clock, edge) for edge in np.quantile(flown, QUANTILES[::2], axis=0)]
    return FlownStep(run.name, float(run.time[part][0] - run.time[0]), size, figures, time, wish, measured[part], *band)
