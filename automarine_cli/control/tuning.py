"""The result of `tune`: a model or a diagnosis -> gains of a controller with their margins, or why none can be promised
and the runs that would settle it."""

import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.control.design import Designed, Outcome, Setup, Task, design
from automarine_cli.control.knowledge import EXTENDED, SUPPLY, authority, read_knowledge
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import Design, present_gains
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Document, Shown, Source, read_plain, schema_in
from automarine_cli.pipeline.result_files import DIAGNOSIS, TUNING
from automarine_cli.pipeline.results_folder import Attempt, attempted
from automarine_cli.planning.limits import Goal, Limits, Moments
from automarine_cli.planning.plan import Plan, make_plan
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.propulsion import map_and_arm

BAND_DEG, BAND_M = 2.0, 0.05  # within what a step counts as settled: the field's two degrees of heading, and 5 cm
STEP_DEG, STEP_M = 90.0, 1.0
WIDE, NARROW = 50.0, 10.0
"""Half widths of intervals [%] at which nothing more is planned: where a tie alone is to be settled, and of an effect
whose size is not known."""
QUANTILES = (0.025, 0.5, 0.975)
SETTLES, LIMITS = "settles", "limits.toml"
"""Folder of the runs that settle what is open, within the folder of results, and the file of their limits."""
RECORDED = (
    "target", "step", "load", "margin", "full", "arm", "delay", "supply", "sample_time", "beyond_range", "seed",
)  # fmt: skip


def set_up(
    model: Source,
    *,
    target: str,
    extended: Source | None = None,
    step: float | None = None,
    load: float = 10.0,
    margin: float = 0.75,
    full: float | None = None,
    thrusters: Source | ThrusterMap | None = None,
    arm: float | None = None,
    columns: Path | Document | ColumnMap | None = None,
    delay: float | None = None,
    supply: tuple[float, float] = SUPPLY,
    sample_time: float | None = None,
    beyond_range: bool = False,
    seed: int = 0,
) -> Setup:
    """Read and check what a tuning is made of.

    `model` is that of a fit, or a diagnosis whose model is `extended`; `step` in degrees or metres, `load` [%] of the
    whole output, disk `margin` to keep; `full` moment or force of the whole output; `delay` [s] that the logs cannot
    show, `supply` voltage in shares of that of the logs; `seed` draws the vehicles. Raises ModelError or SettingError.
    """
    if schema_in(model) == DIAGNOSIS.schema:
        if extended is None:
            raise ModelError(f"{model.name}: its {EXTENDED} is not beside it; keep both in one folder")
        known = read_knowledge(extended, model, delay, supply)
    else:
        known = read_knowledge(model, None, delay, supply)
    stack, dof = get(target, sample_time, beyond_range), known.model.dof
    if dof.name not in stack.motions:
        raise ModelError(
            f"{known.stored.source} is a model of {dof.name}; {stack.name} controls {' or '.join(stack.motions)}"
        )
    if thrusters is not None and not dof.levered:
        raise SettingError(f"--thrusters makes turning moments; for {dof.name} give --full with the whole force")
    most, bend = authority(stack, known, full, map_and_arm(thrusters, arm, given_columns(columns), dof))
    step = step if step is not None else STEP_DEG if dof.wraps else STEP_M
    band = dof.inner(BAND_DEG if dof.wraps else BAND_M)
    return Setup(stack, known, most, bend, Task(dof.inner(step), band, load / 100.0, margin, 0.0), seed)


@dataclass(frozen=True, repr=False)
class Tuning(Shown):
    """The verdict, the name of the model's file, the `settings` of `set_up`; where something is open, the settings of
    the plan of runs that settle it, and that plan if results go into the folder `out`."""

    designed: Designed
    source: str
    settings: Mapping[str, Any]
    settling: Mapping[str, Any] | None
    plan: Attempt[Plan] | None
    out: Path | None

    def to_json(self) -> dict[str, Any]:
        designed = self.designed
        new, old, nominal, task, target = (
            designed.new, designed.old, designed.nominal, designed.task, designed.target
        )  # fmt: skip
        dof = nominal.dof
        return {
            "schema": TUNING.schema,
            "verdict": designed.verdict,
            "why": designed.why,
            "target": target.name,
            "firmware": target.firmware or None,
            "motion": dof.name,
            "model": self.source,
            f"{dof.words.force}_unit": nominal.force_unit,
            f"full_{dof.words.force}": nominal.full,
            "sample_time_s": target.period,
            f"step_{dof.units.log}": dof.logged(task.step),
            f"settled_within_{dof.units.key}": dof.shown(task.band),
            "load_percent": 100.0 * task.load,
            "margin_asked": task.margin,
            "flight_s": task.seconds,
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
            "vehicles": sum(len(crowd.vehicles) for crowd in designed.crowds),
            "explanations": [crowd.name for crowd in designed.crowds],
            "settled_by": designed.run or None,
            "plan": None if self.settling is None else self.plan_command(""),
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

    def outcomes(self) -> Iterator[tuple[str, Outcome]]:
        for name, outcome in (("present", self.designed.old), ("new", self.designed.new)):
            if outcome is not None:
                yield name, outcome

    def gains(self) -> dict[str, dict[str, object]]:
        """New gains by name, with the present ones; empty without."""
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

    def plan_command(self, out: str) -> str:
        """The line that plans the runs that settle what is open; files by their names alone where `out` is empty."""
        assert self.settling is not None
        files = {"": "model", "--diagnosis": "diagnosis", "--thrusters": "thrusters"}
        read = {key: file.name if isinstance(file, Document) or not out else str(file) for key, name in files.items()
                if isinstance(file := self.settling[name], Source)}  # fmt: skip
        words = ["automarine", "plan", *(word for pair in read.items() for word in pair if word)]
        words += [word for name in self.settling["parameters"] for word in ("--parameter", name)]
        arm = self.settling["arm"]
        words += [] if arm is None else ["--arm", f"{arm:g}"]
        return shlex.join([*words, "--limits", str(PurePosixPath(out, SETTLES, LIMITS)), "-o", "out/plan"])

    def target_text(self) -> str:
        designed = self.designed
        assert designed.new is not None
        share = f"{designed.new.share_with(designed.task.margin):.0%}"
        holds = f"Disk margin {designed.task.margin:g} or more for {share} of the vehicles that the model allows."
        notes = [f"From {self.source} by automarine tune.", holds]
        if designed.target.beyond and designed.target.firmware:
            notes.append("Warning: values may lie beyond the documented ranges.")
        before = {} if designed.old is None else designed.old.gains
        return designed.target.text(Design(designed.new.gains, before, designed.nominal, notes))


def make_tuning(
    *, present: Source | None, out: Path | None = None, progress: Progress = silent, **settings: Any
) -> Tuning:
    """Design gains by the settings of `set_up`; `present` is a file of the gains flown so far.

    Runs that settle what is open are planned if results go into a folder `out`. Raises ModelError or SettingError.
    """
    setup = set_up(**settings)
    designed = design(setup, present_gains(setup.target, present))
    settling, plan = _settling(settings, setup, designed), None
    if settling is not None and out is not None:
        plan = attempted(
            "The runs that settle it could not be planned", lambda: make_plan(**settling, progress=progress)
        )
    return Tuning(designed, setup.known.stored.source, settings, settling, plan, out)


def _settling(settings: Mapping[str, Any], setup: Setup, designed: Designed) -> dict[str, Any] | None:
    """Settings of the plan of runs that settle what changes the answer: they separate what a diagnosis left tied, or
    narrow the interval of the effect that is not known."""
    dof, effect = setup.known.model.dof, designed.open
    if not effect or not dof.wraps:
        return None
    in_newtons = setup.known.stored.moment_unit != "nu"
    thrusters, arm = (settings["thrusters"], settings["arm"]) if in_newtons else (None, None)
    largest = None if thrusters is not None else min(setup.full, setup.known.largest or setup.full)
    tied = effect in setup.known.splits
    model, extended = settings["model"], settings["extended"]
    return {
        "model": extended or model, "diagnosis": model if extended else None,
        "limits": Limits(moments=Moments(largest=largest), goal=Goal(half_width_percent=WIDE if tied else NARROW)),
        "parameters": (dof.symbols.inertia, *(() if tied else (f"{effect} {effects.get(effect).names_in(dof)[0]}",))),
        "thrusters": thrusters, "arm": arm, "columns": settings["columns"], "seed": settings["seed"],
    }  # fmt: skip


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
