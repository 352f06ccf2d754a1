"""The result of `tune`: gains with their margins, or why none can be promised; a flown log against the promise."""

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from automarine_cli import effects
from automarine_cli.control import design
from automarine_cli.control.design import GainProblem, GainResult, Task
from automarine_cli.control.knowledge import EXTENDED, SUPPLY_SHARES, authority, read_knowledge
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import present_gains
from automarine_cli.control.vehicles import dead_time
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
MAX_SETTLING_RATIO = 2.0  # how much longer gains for all explanations may take to settle than for the right one alone
MIN_DELAY_SPREAD_S = 0.14  # of delays between quarters, from which on it is asked what knowing them is worth
Verdict = Literal["gains", "leave", "cannot-promise"]
RECORDED = (
    "target", "step", "load", "load_recovery", "margin", "full", "arm", "delay", "supply", "sample_time",
    "beyond_range", "seed",
)  # fmt: skip


def set_up(
    model: Source, *, target: str, extended: Source | None = None, step: float | None = None, load: float = 10.0,
    load_recovery: float | None = None, margin: float = 0.75, full: float | None = None,
    thrusters: Source | ThrusterMap | None = None, arm: float | None = None, columns: Source | ColumnMap | None = None,
    delay: float | None = None, supply: tuple[float, float] = SUPPLY_SHARES, sample_time: float | None = None,
    beyond_range: bool = False, seed: int = 0,
) -> GainProblem:  # fmt: skip
    """Read and check what a tuning is made of. `model` is that of a fit, or a diagnosis whose model is `extended`;
    `step` in degrees or metres, `load` [%] of the whole output, to be rejected in `load_recovery` [s]; `delay` [s] that
    the logs cannot show, `supply` voltage in shares of the logs'. Raises ModelError or SettingError."""
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
    step = step if step is not None else STEP_DEG if dof.angular else STEP_M
    band = dof.inner(BAND_DEG if dof.angular else BAND_M)
    task = Task(dof.inner(step), band, load / 100.0, margin, 0.0, load_recovery or math.inf)
    return design.problem_of(stack, task, knowledge, most, bend, seed)


@dataclass(frozen=True, kw_only=True)
class TuningFile(ResultRecord):
    """`tuning.json`: what became of the gains of a target."""

    verdict: str
    target: str


TUNING = ResultKind("tuning.json", "tuning", TuningFile, "tune")


@dataclass(frozen=True, repr=False)
class Tuning(Shown, GainProblem):
    """The `verdict` ("gains", "leave" or "cannot-promise") and `why`. `gains` has the new gains by name, each with
    `value`, `before` and `unit`; `old` and `new` are the outcomes of present and new gains, `beyond` those of gains
    beyond their documented ranges where these limit, `outcomes` all of them by name. `open` is the effect that is
    not settled, or empty; `source` the model's file; `settings` those given; `run` the run that would settle what is
    open, `plan_command` how to plan it.

    `target` is the autopilot, `task` what is demanded, `knowledge` what the model says, `nominal` the vehicle as a
    designer sees it, `crowds` the vehicles that the model allows, `at_speed(ratio)` these at another speed,
    `omega(count)` frequencies that matter and `limit_rate(share)` the same target with fewer loops a second.
    `target_text()` is the target's own file. `to_json()` is tuning.json.

    Frame, a row per gain: `parameter`, `value`, `before`, `unit`, `documented`.

    Keys: `schema`, `verdict`, `why`, `target`, `firmware`, `motion`, `model`, `moment_unit`, `full_moment`,
    `sample_time_s`, `step_deg`, `settled_within_deg`, `load_percent`, `load_recovery_s`, `margin_asked`,
    `flight_s`, `gains`, `disk_margin`, `margins`, `promised`, `present`, `at_end_of_range`, `beyond_range`,
    `vehicles`, `explanations`, `settled_by`, `notes`, `present_gains`, `made_from`.
    """

    verdict: Verdict
    why: str
    open: str = ""
    old: GainResult | None = None
    new: GainResult | None = None
    beyond: GainResult | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def source(self) -> str:
        return self.knowledge.stored.source

    @property
    def run(self) -> str:
        """The run that settles what is open, in words."""
        if not self.open:
            return ""
        card = effects.get(self.open).card(self.nominal.dof)
        return self.knowledge.splits.get(self.open) or card.separated_by

    def to_json(self) -> dict[str, Any]:
        target, nominal, task, dof = self.target, self.nominal, self.task, self.nominal.dof
        old, new, beyond = self.old, self.new, self.beyond
        sources = {key: self.settings[key] for key in ("model", "extended", "thrusters")}
        files = {key: {"name": file.name, "content": read_plain(file, "JSON", ModelError)}
                 for key, file in sources.items() if isinstance(file, Source)}  # fmt: skip
        return {
            "schema": TUNING.schema, "verdict": self.verdict, "why": self.why,
            "target": target.name, "firmware": target.firmware or None, "motion": dof.name, "model": self.source,
            f"{dof.words.force}_unit": nominal.force_unit, f"full_{dof.words.force}": nominal.full,
            "sample_time_s": target.period, f"step_{dof.units.log}": dof.logged(task.step),
            f"settled_within_{dof.units.shown}": dof.shown(task.band), "load_percent": 100.0 * task.load,
            "load_recovery_s": task.recovery if math.isfinite(task.recovery) else None,
            "margin_asked": task.margin, "flight_s": task.seconds,
            "gains": self.gains(),
            "disk_margin": None if new is None else _json(margins_of(new)["disk_margin"]),
            "margins": {
                name: {key: _json(value) for key, value in margins_of(outcome).items()} | {
                    "share_with_margin": outcome.share_with(task.margin),
                    "stable": float(outcome.margins.stable.mean()), "rejects_load": outcome.rejects(task),
                } | {
                    f"disk_margin_at_{ratio:g}_times_the_speed": _json(banded(disk, "1"))
                    for ratio, disk in outcome.at_speeds.items()
                } for name, outcome in self.outcomes()
            },
            "promised": None if new is None else self._promised(new),
            "present": None if old is None else self._promised(old),
            "at_end_of_range": [] if new is None else [gain.name for gain in target.at_ends(new.gains)],
            "beyond_range": beyond and {"gains": dict(beyond.gains), **self._promised(beyond)},
            "vehicles": sum(len(crowd) for crowd in self.crowds), "explanations": [crowd.name for crowd in self.crowds],
            "settled_by": self.run or None, "notes": list(self.knowledge.notes),
            "present_gains": None if old is None else dict(old.gains),
            "made_from": {"settings": {name: self.settings[name] for name in RECORDED}, "files": files},
        }  # fmt: skip

    def outcomes(self) -> list[tuple[str, GainResult]]:
        outcomes = ("present", self.old), ("new", self.new), ("with --beyond-range", self.beyond)
        return [(name, outcome) for name, outcome in outcomes if outcome is not None]

    def gains(self) -> dict[str, dict[str, object]]:
        new, old = self.new, self.old
        if new is None:
            return {}
        unit = self.nominal.dof.units.base
        return {
            gain.name: {
                "value": new.gains[gain.name], "before": None if old is None else old.gains.get(gain.name),
                "unit": gain.unit.replace("{x}", unit),
                "documented": [gain.low, gain.high] if math.isfinite(gain.high) else None,
            }
            for gain in self.target.parameters
        }  # fmt: skip

    def _promised(self, outcome: GainResult) -> dict[str, Any]:
        bands = {name: _json(value) for name, value in promises(outcome, self.nominal.dof).items()}
        return bands | {"settles": float(outcome.scores.settles.mean())}

    @property
    def plan_command(self) -> str:
        """The command that plans runs which settle what is open; empty where nothing is, or nothing can be planned."""
        dof, effect = self.nominal.dof, self.open
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
        assert self.new is not None
        share = f"{100 * self.new.share_with(self.task.margin):.0f} %"
        holds = f"Disk margin {self.task.margin:g} or more for {share} of the vehicles that the model allows."
        notes = [f"From {self.source} by automarine tune.", holds, *headlines(self)]
        if self.target.beyond and self.target.firmware:
            notes.append("Warning: values may lie beyond the documented ranges.")
        before = {} if self.old is None else self.old.gains
        notes += [f"{name} was {before[name]:.6g}" for name in self.target.searched if name in before]
        return self.target.text(self.new.gains, self.nominal, notes)


def make_tuning(*, present: Source | None, **settings: Any) -> Tuning:
    """Design gains by the settings of `set_up`, `present` a file of those flown. Raises as `set_up`."""
    problem = set_up(**settings)
    return replace(judge(problem, present_gains(problem.target, present)), settings=settings)


def judge(problem: GainProblem, present: Mapping[str, float] | None) -> Tuning:
    """Reach the verdict on a problem; `present` gains by name, or None. Flights take seven times the shortest turn and
    the delays many times over, and twice as long where gains do not settle in time."""
    task, nominal, settled = problem.task, problem.nominal, problem.knowledge.settled
    if settled is not None:
        return _reached(problem, "cannot-promise", *settled)
    shortest = 2.0 * np.sqrt(nominal.step * nominal.inertia) + nominal.step / nominal.fastest
    seconds = float(np.clip(7.0 * shortest + 32.0 * nominal.lag, 20.0, 60.0))
    for longer in (1.0, 2.0):
        result = _judged(replace(problem, task=replace(task, seconds=longer * seconds)), present)
        if result is not None:
            return result
    why = f"The best gains with a disk margin of {task.margin:g} do not settle for {100 * design.PASS_RATE:.0f} %"
    return _cannot(problem, f"{why} of the vehicles that the model allows.")


def _cannot(problem: GainProblem, why: str, **outcomes: Any) -> Tuning:
    remedy = f"Try {'--beyond-range or ' if problem.target.ranged else ''}a smaller --margin, or a smaller --step."
    return _reached(problem, "cannot-promise", f"{why} {remedy}", **outcomes)


def _reached(problem: GainProblem, verdict: Verdict, why: str, effect: str = "", **outcomes: Any) -> Tuning:
    return Tuning(**vars(problem), verdict=verdict, why=why, open=effect, **outcomes)


def _judged(problem: GainProblem, present: Mapping[str, float] | None) -> Tuning | None:
    """The verdict from flights of so many seconds; None where gains keep the margin and do not settle in time."""
    short, seconds = design.shorten(problem)
    task, target = replace(short.task, seconds=seconds), problem.target
    problem = replace(problem, task=task)
    old = None if present is None else design.outcome(problem, present)
    keeps = old is not None and design.keeps(old, problem)
    if old is not None and keeps and old.rejects(task):
        return _reached(problem, "leave", _leave(old, task), old=old)
    chosen = design.best_gains(short)
    dear = _price(short, chosen)
    if dear is not None:
        return _reached(problem, "cannot-promise", *dear, old=old)
    if chosen is None:
        why = f"No gains{target.within} keep a disk margin of {task.margin:g} for {100 * design.PASS_RATE:.0f} % of the"
        return _cannot(problem, f"{why} vehicles that the model allows.", old=old, beyond=_beyond(short, problem))
    new = design.outcome(problem, chosen)
    if not design.keeps(new, problem):
        return None
    if old is not None and keeps and not new.rejects(task):
        return _reached(problem, "leave", _leave(old, task), old=old)
    share = f"{100 * new.share_with(task.margin):.0f} % of the vehicles that the model allows"
    before = "" if old is None else f"; with the present ones for {100 * old.share_with(task.margin):.0f} %"
    why = f"They keep a disk margin of {task.margin:g} for {share}{before}."
    beyond = _beyond(short, problem) if target.at_ends(new.gains) else None
    return _reached(problem, "gains", why, old=old, new=new, beyond=beyond)


def _beyond(short: GainProblem, problem: GainProblem) -> GainResult | None:
    """What the best gains beyond the documented ranges do, where there are ranges and such gains."""
    if not short.target.ranged:
        return None
    wider = type(short.target)(short.target.period, beyond=True)
    chosen, problem = design.best_gains(replace(short, target=wider)), replace(problem, target=wider)
    result = None if chosen is None else design.outcome(problem, chosen)
    return result if result is not None and design.keeps(result, problem) else None


def _leave(old: GainResult, task: Task) -> str:
    share = f"{100 * old.share_with(task.margin):.0f} % of the vehicles that the model allows"
    more = "" if old.rejects(task) else " No others reject the load in time."
    return f"The present gains keep the margin of {task.margin:g} for {share}, and all but a few settle.{more}"


def _price(problem: GainProblem, chosen: Mapping[str, float] | None) -> tuple[str, str] | None:
    """What is open and dear, in a sentence, and the effect to be settled; None where knowing it would gain little."""
    crowds, knowledge = problem.crowds, problem.knowledge
    parts = list(zip(crowds, [e.instead for e in knowledge.explanations])) if len(crowds) > 1 else []
    late = dead_time(crowds[0])
    early, later = np.quantile(late, [0.25, 0.75])
    if later - early >= MIN_DELAY_SPREAD_S:
        parts.append((replace(crowds[0].pick(np.flatnonzero(late <= early)), name="a short delay"), "input-delay"))
    for part, effect in parts:
        alone = design.searched(replace(problem, crowds=(part,)), problem.task.margin, 1)["numbers"][:1]
        if not len(alone):
            continue
        gains = problem.target.propose(alone, problem.nominal)
        sets = {name: np.append(value, [] if chosen is None else chosen[name]) for name, value in gains.items()}
        quick, first = problem.limit_rate(design.ROUGH_LOOP_SHARE), part.pick(slice(0, 1))
        mine, *common = design.flown(quick, sets, first, problem.task).settling[:, 0].tolist()
        if max(common, default=math.inf) <= MAX_SETTLING_RATIO * mine:
            continue
        settled = effect or next((e.instead for e in knowledge.explanations if e.instead), "input-delay")
        instead = f"gains that settle in {common[0]:.1f} s" if math.isfinite(sum(common) or math.inf) else "no gains"
        open_still = "the delay" if settled == "input-delay" and len(crowds) == 1 else f"whether it is {settled}"
        why = f"What is open changes the answer: with {part.name} alone the step settles in {mine:.1f} s, and there are"
        return f"{why} {instead} for everything that the logs allow; {open_still} is not known well enough.", settled
    return None


def banded(values: Floats, unit: str) -> Estimate | None:
    """Median and the band of 95 % of a crowd's values, one end open where they are infinite; None without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    low, middle, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in QUANTILES)
    return Estimate(middle, float(np.std(finite)), (low, high), unit)


def promises(outcome: GainResult, dof: Dof) -> dict[str, Estimate | None]:
    """What a set of gains comes to, by key of the result file."""
    scores, unit = outcome.scores, dof.units.shown
    lengths = {"rms_after": scores.rms, "load_error": scores.error, "load_left": scores.left}
    shares = {"overshoot_percent": banded(100.0 * scores.overshoot, "%"), "settling_s": banded(scores.settling, "s")}
    return shares | {f"{name}_{unit}": banded(dof.shown(values), unit) for name, values in lengths.items()}


def margins_of(outcome: GainResult) -> dict[str, Estimate | None]:
    margins = outcome.margins
    sizes = {"gain_margin_dB": margins.gain, "phase_margin_deg": margins.phase, "delay_margin_s": margins.delay}
    bands = {name: banded(values, name.rpartition("_")[2]) for name, values in sizes.items()}
    return {"disk_margin": banded(margins.disk, "1"), **bands}


def labels(problem: GainProblem) -> dict[str, str]:
    """Return what each figure of `margins_of` and `promises` is called; the first four make the answer."""
    unit, load = problem.nominal.dof.units.shown, f"{100 * problem.task.load:g} % load"
    return {
        "disk_margin": "disk margin", "settling_s": "settles after [s]",
        f"load_error_{unit}": f"largest error under {load} [{unit}]",
        f"load_left_{unit}": f"error left {problem.task.recovery:g} s after that load began [{unit}]",
        "overshoot_percent": "overshoot [%]", f"rms_after_{unit}": f"error once settled, rms [{unit}]",
        "gain_margin_dB": "gain margin [dB]", "phase_margin_deg": "phase margin [deg]",
        "delay_margin_s": "delay margin [s]",
    }  # fmt: skip


def cell(of: Estimate | None) -> str:
    """Write a median and its band; what is infinite or missing never happens."""
    if of is None:
        return "never"
    return "{} [{}, {}]".format(*(f"{x:.3g}" if math.isfinite(x) else "never" for x in (of.value, *of.ci95)))


def headlines(tuning: Tuning) -> list[str]:
    """Say margin, settling and load error of all gains flown, whether the load is rejected, and what limits it."""
    task, dof, new = tuning.task, tuning.nominal.dof, tuning.new
    bands = {name: margins_of(outcome) | promises(outcome, dof) for name, outcome in tuning.outcomes()}
    said = []
    for key, label in list(labels(tuning).items())[: 4 if bands else 0]:
        values = ", ".join(f"{name} {cell(figures[key])}" for name, figures in bands.items())
        said.append(f"{label[0].upper()}{label[1:]}: {values}.")
    for ratio in design.SPEED_RATIOS if tuning.nominal.steered and bands else ():
        speed = f" of {ratio * tuning.nominal.speed:.3g} m/s" if tuning.nominal.speed else ""
        values = ", ".join(f"{name} {cell(banded(of.at_speeds[ratio], '1'))}" for name, of in tuning.outcomes())
        said.append(f"Disk margin at {'half' if ratio < 1 else 'twice'} the speed{speed}: {values}.")
    if new is None:
        return said
    verb = "They reject" if new.rejects(task) else f"No gains{tuning.target.within} reject"
    band = f"{dof.shown(task.band):g} {dof.units.shown}"
    said.append(f"{verb} a load of {100 * task.load:g} % to within {band} in {task.recovery:g} s.")
    if ends := tuning.target.at_ends(new.gains):
        names = " and ".join(f"{gain.name} ({gain.low:g} to {gain.high:g})" for gain in ends)
        said.append(f"At the end of its documented range: {names}. Ranges are for the sliders of ground stations.")
    return said


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    """An estimate; an end that is infinite is null."""
    if estimate is None:
        return None
    value, low, high = (None if x == math.inf else x for x in (estimate.value, *estimate.ci95))
    return {"value": value, "stderr": estimate.stderr, "ci95": [low, high], "unit": estimate.unit}


REFERENCES = ("target", "reference", "desired", "DesYaw", "YDes")  # parts of the names of columns that hold a reference
SMOOTHED_S, STEADY_S, MIN_STEP_BANDS = 0.5, 3.0, 5.0  # of readings, of a reference, of a step


@dataclass(frozen=True)
class FlownStep:
    """A step of the reference: when it `begins` [s in the log], its size, its figures beside the band of 95 % that was
    promised, and the curves (N,) less the position before: `position` as read, `low` and `high` of the promise."""

    run: str
    begins: float
    size: float
    figures: Mapping[str, dict[str, Any]]
    time: Floats
    reference: Floats
    position: Floats
    low: Floats
    high: Floats

    @property
    def held(self) -> bool:
        return all(figure["held"] for figure in self.figures.values())

    def to_json(self, dof: Dof) -> dict[str, Any]:
        step = {f"step_{dof.units.log}": dof.logged(self.size)}
        return {"run": self.run, "begins_s": self.begins, **step, "held": self.held, "figures": {**self.figures}}


@dataclass(frozen=True, repr=False)
class TuningCheck(Shown):
    """The `steps` of a log of the motion `dof` beside what was promised. `to_json()` is tuning_check.json; its `steps`
    are the rows of the frame.

    Keys: `schema`, `motion`, `verdict`, `steps`.
    """

    steps: tuple[FlownStep, ...]
    dof: Dof

    def to_json(self) -> dict[str, Any]:
        verdict = "held" if all(step.held for step in self.steps) else "not-held"
        steps = [step.to_json(self.dof) for step in self.steps]
        return {"schema": "automarine/tuning-check/1", "motion": self.dof.name, "verdict": verdict, "steps": steps}


def check_tuning(
    tuning: Source, logs: Sequence[LogFile], reference: str | None, columns: Source | ColumnMap | None,
    progress: Progress = silent,
) -> TuningCheck:  # fmt: skip
    """Compare logs flown with the gains of a `tuning.json` with what was promised of them. Raises ModelError for
    another file, LogError or RunError for logs without a step."""
    problem, gains = _of_tuning(tuning)
    dof, task = problem.nominal.dof, problem.task
    runs = load_runs(logs, given_columns(columns), dof=dof, progress=progress).runs
    target = problem.limit_rate(design.PROMISED_LOOPS)
    sets = {name: np.full((1, 1), value) for name, value in gains.items()}

    def promise(time: Floats, wish: Floats) -> tuple[Floats, Floats]:
        """Time (M,) and positions (S, M) of every vehicle that follows a reference from rest."""
        clock = np.arange(max(2, round(float(time[-1]) / target.period))) * target.period
        setpoint = np.interp(clock, time, wish)[None, None]
        flights = [design.fly(target, sets, crowd, setpoint, np.zeros((1, 1))) for crowd in problem.crowds]
        return flights[0].time, np.concatenate([flight.position[:, 0] for flight in flights])

    steps = []
    for run in runs:
        setpoint = reference_of(run, reference)
        steps += [_flown(run, setpoint, part, task, promise) for part in _steps(run.time, setpoint, task.band)]
    if not steps:
        least = f"{dof.logged(MIN_STEP_BANDS * task.band):g} {dof.units.log}"
        raise RunError(
            f"{runs[0].source}: no change of the reference of {least} or more; make one step and hold it until the "
            "vehicle is at rest"
        )
    return TuningCheck(tuple(steps), dof)


def _of_tuning(tuning: Source) -> tuple[GainProblem, dict[str, float]]:
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
        if abs(reference[after] - reference[first]) >= MIN_STEP_BANDS * band and time[end] - time[after] >= STEADY_S:
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
    kinds = (("overshoot_percent", 100.0, 3.0 * noise / abs(size)), ("settling_s", 1.0, longer),
             (f"rms_after_{dof.units.shown}", float(dof.shown(1.0)), 2.0 * noise))  # fmt: skip
    of_log = design.step_scores(time, smooth[None], size, task.band + 2.5 * noise)
    of_promise, figures = design.step_scores(clock, flown, size, task.band), {}
    for (key, unit, spare), value, values in zip(kinds, of_log, of_promise):
        low, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in QUANTILES[::2])
        held = bool(low - spare <= value[0] <= high + spare)
        measured_value, *promised = (unit * x if math.isfinite(x) else None for x in (float(value[0]), low, high))
        figures[key] = {"flown": measured_value, "promised": promised, "held": held}
    band = [np.interp(time, clock, edge) for edge in np.quantile(flown, QUANTILES[::2], axis=0)]
    return FlownStep(run.name, float(run.time[part][0] - run.time[0]), size, figures, time, wish, measured[part], *band)
