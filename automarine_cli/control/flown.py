"""A log flown with gains against what was promised of them: the steps of its reference, each beside the same step of
every vehicle that the model allows; where the reference moves without steps, as a pilot turns it, all of it."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.control.closed_loop import fly, step_scores
from automarine_cli.control.design import EXACT, Crowd, Setup, Task, crowds_of, nominal_of, paced
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.tuning import set_up
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.dofs import Dof
from automarine_cli.errors import AutomarineError, ModelError, RunError
from automarine_cli.logs import ColumnMap, LogFile, given_columns
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Document, Shown, Source, json_document, read_plain
from automarine_cli.pipeline.result_files import TUNING
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run

PIECES = 8  # of all logs together that a diagnosis is made of
REFERENCES = ("target", "reference", "desired", "DesYaw", "YDes")  # parts of the names of columns that hold a reference
SMOOTHED_S, STEADY_S, LEAST = 0.5, 3.0, 5.0
"""Readings are averaged over so long, a reference stays for so long at least, and a step is so many bands large."""
BEFORE_S, FOLLOWED_S, FOLLOWERS = 1.0, 120.0, 60
"""A stretch without steps begins so long before the reference first moves, is followed for so long at most, and by so
many vehicles."""
KEYS = {
    "overshoot": "overshoot_percent", "settling": "settling_s", "rms": "rms_after_{unit}",
    "distance": "rms_error_{unit}", "largest": "largest_error_{unit}",
}  # fmt: skip


@dataclass(frozen=True)
class Compared:
    """One figure of a step: as flown, and the band of 95 % that was promised; infinite where it never settled."""

    value: float
    band: tuple[float, float]
    held: bool


@dataclass(frozen=True)
class FlownStep:
    """One step of the reference, or a stretch of it without steps: when it `begins` [s in the log], its size (None
    without), what came of it by name, and the curves: `time` (N,), `reference` (N,), `position` (N,) as read, `low` and
    `high` (N,) of the promise, all less the position before."""

    run: str
    begins: float
    size: float | None
    figures: Mapping[str, Compared]
    time: Floats
    reference: Floats
    position: Floats
    low: Floats
    high: Floats

    @property
    def held(self) -> bool:
        return all(one.held for one in self.figures.values())

    def to_json(self, dof: Dof) -> dict[str, Any]:
        figures = {}
        for name, figure in self.figures.items():
            values = (in_print(name, x, dof) for x in (figure.value, *figure.band))
            flown, *promised = (x if math.isfinite(x) else None for x in values)
            key = KEYS[name].format(unit=dof.units.key)
            figures[key] = {"flown": flown, "promised": promised, "held": figure.held}
        size = None if self.size is None else dof.logged(self.size)
        step = {f"step_{dof.units.log}": size, "held": self.held, "figures": figures}
        return {"run": self.run, "begins_s": self.begins, **step}


@dataclass(frozen=True)
class Promise:
    """What was promised: the stack, its gains, the vehicles that the model allows, and the step that they were judged
    by."""

    target: Target
    gains: Gains
    crowds: Sequence[Crowd]
    task: Task


def in_print(name: str, value: float, dof: Dof) -> float:
    """A figure in the units of result files: percent, seconds, degrees or centimetres."""
    return 100.0 * value if name == "overshoot" else value if name == "settling" else float(dof.shown(value))


@dataclass(frozen=True, repr=False)
class TuningCheck(Shown):
    """The steps of a log beside what was promised, and in `changed` what a diagnosis says where it was not held."""

    steps: tuple[FlownStep, ...]
    dof: Dof
    changed: str

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": "automarine/tuning-check/1",
            "motion": self.dof.name,
            "verdict": "held" if all(step.held for step in self.steps) else "not-held",
            "steps": [step.to_json(self.dof) for step in self.steps],
            "changed": self.changed or None,
        }


def check_tuning(
    tuning: Source,
    logs: Sequence[LogFile],
    reference: str | None,
    columns: Path | Document | ColumnMap | None,
    phrase: Callable[[Diagnosis], str],
    progress: Progress = silent,
) -> TuningCheck:
    """Compare logs that were flown with the gains of a `tuning.json` with what was promised of them.

    `phrase` says the verdict of a diagnosis. Raises ModelError for another file, LogError or RunError for logs without
    a step.
    """
    setup, gains = _of_tuning(tuning)
    runs = load_runs(logs, given_columns(columns), dof=setup.known.model.dof, progress=progress).runs
    crowds = crowds_of(setup.known, setup.full, setup.bend, setup.seed)
    target = paced(setup.target, nominal_of(crowds[0].vehicles, setup.task.step), EXACT)
    promise = Promise(target, {name: np.full((1, 1), value) for name, value in gains.items()}, crowds, setup.task)
    steps = tuple(step for run in runs for step in _flown_steps(run, reference_of(run, reference), promise))
    if not steps:
        dof = runs[0].dof
        least = f"{dof.logged(LEAST * setup.task.band):g} {dof.units.log}"
        raise RunError(
            f"{runs[0].source}: no change of the reference of {least} or more; make one step and hold it until the "
            "vehicle is at rest"
        )
    changed = "" if all(step.held for step in steps) else _changed(runs, setup, phrase)
    return TuningCheck(steps, setup.known.model.dof, changed)


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


def _changed(runs: Sequence[Run], setup: Setup, phrase: Callable[[Diagnosis], str]) -> str:
    """What a diagnosis of the logs says, cut in pieces so that there is something to tell chance by, in a sentence."""
    parts = -(-PIECES // len(runs))
    pieces = [
        replace(run.cut(start, stop), name=f"{run.name} {k}")
        for run in runs
        for k, (start, stop) in enumerate(pairwise(np.linspace(0, len(run), parts + 1).astype(int)), 1)
    ]
    try:
        diagnosis = diagnose_runs(pieces, setup.known.model, seed=setup.seed)
    except AutomarineError as problem:
        return f"The log could not be diagnosed: {problem}."
    effects = (effect.says for effect in diagnosis.effects)
    return " ".join([f"A diagnosis of the log says: {phrase(diagnosis)}", *effects])


def reference_of(run: Run, column: str | None) -> Floats:
    """The reference of a run in base units (N,), unwrapped. Raises RunError where no column, or not the one named,
    holds one."""
    dof = run.dof
    names = [column] if column else [n for n in run.extras if any(part.lower() in n.lower() for part in REFERENCES)]
    if not names or names[0] not in run.extras:
        asked = f"column {column!r}" if column else "column with the reference (such as target_heading_deg)"
        raise RunError(
            f"{run.source}, run {run.name!r}: there is no {asked}; name it with --reference, from "
            f"{', '.join(run.extras) or 'none'}"
        )
    values = run.extras[names[0]]
    inner = values if names[0].endswith(("_rad", "_m")) or not dof.wraps else dof.inner(values)
    return np.unwrap(inner) if dof.wraps else inner


def _flown_steps(run: Run, reference: Floats, promise: Promise) -> list[FlownStep]:
    """Every step of a run's reference, or a stretch of it, from just before it first moves, that moves without."""
    band, crowds = promise.task.band, promise.crowds
    steps = list(_steps(run.time, reference, band))
    if steps or np.ptp(reference) < LEAST * band:
        return [
            _flown(run, reference, slice(a, b + 1), reference[a], promise, float(reference[b] - reference[a]))
            for a, b in steps
        ]
    moves = np.flatnonzero(reference != reference[0])[0]
    begin = int(np.searchsorted(run.time, run.time[moves] - BEFORE_S))
    end = int(np.searchsorted(run.time, run.time[begin] + FOLLOWED_S))
    promise = replace(promise, crowds=[part.first(max(FOLLOWERS // len(crowds), 2)) for part in crowds])
    off = 2.0 * np.pi * np.round((run.position[begin] - reference[begin]) / (2.0 * np.pi)) if run.dof.wraps else 0.0
    return [_flown(run, reference + off, slice(begin, end), run.position[begin], promise, None)]


def _steps(time: Floats, reference: Floats, band: float) -> Iterator[tuple[int, int]]:
    """First sample of each step, and the last before the next one."""
    moves = np.flatnonzero(np.abs(np.diff(reference)) > 0.1 * band)
    if not len(moves):
        return
    apart = np.flatnonzero(np.diff(time[moves]) > 1.0)
    firsts = moves[np.concatenate([[0], apart + 1])]
    lasts = moves[np.concatenate([apart, [len(moves) - 1]])]
    ends = [*firsts[1:], len(time) - 1]
    for first, last, end in zip(firsts, lasts, ends):
        large = abs(reference[last + 1] - reference[first]) >= LEAST * band
        if large and time[end] - time[last + 1] >= STEADY_S:
            yield int(first), int(end)


def _flown(run: Run, reference: Floats, part: slice, start: float, promise: Promise, size: float | None) -> FlownStep:
    """Part of a run beside the same flown by every vehicle, all less the position before: a step of a `size`, else how
    far the vehicle is from the reference, on the whole and at most."""
    time = run.time[part] - run.time[part][0]
    turns = np.round((run.position[part][0] - start) / (2.0 * np.pi)) if run.dof.wraps else 0.0
    read = run.position - 2.0 * np.pi * turns
    width = max(1, round(SMOOTHED_S / float(np.median(np.diff(run.time)))))
    smooth = np.convolve(np.pad(read, width // 2, mode="edge"), np.ones(width) / width, mode="same")
    smooth = smooth[width // 2 : width // 2 + len(read)][part] - start
    noise = float(position_noise(run.time, run.position) / np.sqrt(width))
    wish, target = reference[part] - start, promise.target
    loops = max(2, round(float(time[-1]) / target.period))
    wanted = np.interp(np.arange(loops) * target.period, time, wish)[None, None]
    flights = [fly(target, promise.gains, crowd.vehicles, wanted, np.zeros((1, 1))) for crowd in promise.crowds]
    clock, flown = flights[0].time, np.concatenate([flight.position[:, 0] for flight in flights])
    names: tuple[str, ...]
    spare: tuple[float, ...]
    if size is None:
        names, spare = ("distance", "largest"), (2.0 * noise, 4.0 * noise)
        off, theirs = (smooth - wish)[None], flown - np.interp(clock, time, wish)
        did, promised = ([np.sqrt(np.mean(x**2, axis=1)), np.abs(x).max(axis=1)] for x in (off, theirs))
    else:
        names = ("overshoot", "settling", "rms")
        spare = 3.0 * noise / abs(size), 0.3 + float(np.median(np.diff(time))), 2.0 * noise
        did = list(step_scores(time, smooth[None], size, promise.task.band + 2.5 * noise))
        promised = list(step_scores(clock, flown, size, promise.task.band))
    figures = {}
    for name, value, values, more in zip(names, did, promised, spare):
        low, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in (0.025, 0.975))
        figures[name] = Compared(float(value[0]), (low, high), bool(low - more <= value[0] <= high + more))
    band = [np.interp(time, clock, edge) for edge in np.quantile(flown, [0.025, 0.975], axis=0)]
    begins = float(run.time[part][0] - run.time[0])
    return FlownStep(run.name, begins, size, figures, time, wish, read[part] - start, *band)
