"""`tune --check`: did the loop do what was promised of its gains, and if not, what changed?"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from automarine_cli.control.design import EXACT, crowds_of, nominal_of
from automarine_cli.control.flown import FlownStep, flown_steps
from automarine_cli.control.search import paced
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.dofs import Dof
from automarine_cli.errors import AutomarineError, ModelError
from automarine_cli.fits.linear_mixed import in_words_of
from automarine_cli.logs import given_columns
from automarine_cli.pipeline.records import json_document, read_plain
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import tuning_check
from automarine_cli.report.diagnosis_tables import verdict_sentence
from automarine_cli.report.figures.files import write_figures
from automarine_cli.report.figures.tuning import flown_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.shown import Shown
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.workflows.command import Command, Runner
from automarine_cli.workflows.tune_options import Ready, TuneOptions, ready
from automarine_cli.workflows.view import View

SCHEMA = "automarine/tuning-check/1"
TUNING = "automarine/tuning/1"
PIECES = 8
"""Parts of all logs together that a diagnosis is made of."""


@dataclass(frozen=True, repr=False)
class TuningCheck(Shown):
    """The steps of a log beside what was promised, and what a diagnosis of the log says where it was not kept."""

    steps: tuple[FlownStep, ...]
    dof: Dof
    changed: str

    @property
    def held(self) -> bool:
        """Whether every step was as promised."""
        return all(one.held for one in self.steps)

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/tuning-check/1."""
        return {
            "schema": SCHEMA,
            "motion": self.dof.name,
            "verdict": "held" if self.held else "not-held",
            "steps": [tuning_check.to_json(one, self.dof) for one in self.steps],
            "changed": self.changed or None,
        }

    def tables(self) -> list[Table | str]:
        """What the terminal shows."""
        return tuning_check.tables(self.steps, self.dof, self.changed)


def _check(asked: TuneOptions, runner: Runner) -> TuningCheck:
    """Compare logs that were flown with the gains of a `tuning.json` with what was promised of them.

    Raises ModelError for another file, LogError or RunError for logs without a step, and OutputError.
    """
    data = read_plain(asked.model, "JSON", ModelError)
    made, gains = _made(data, asked)
    dof = made.known.model.dof
    names = given_columns(asked.columns)
    runs = load_runs(asked.check, names, dof=dof, progress=runner.progress).runs

    def work() -> TuningCheck:
        crowds = crowds_of(made.known, made.full, made.bend, made.asked.seed)
        target = paced(made.target, nominal_of(crowds[0].vehicles, made.task.step), EXACT)
        steps = tuple(flown_steps(runs, asked.reference, target, gains, crowds, made.task))
        changed = "" if all(one.held for one in steps) else _changed(runs, made)
        return TuningCheck(steps, dof, changed)

    def write(folder: ResultFolder, result: TuningCheck) -> None:
        folder.write_json("tuning_check.json", result.to_json())
        folder.write("tuning_check.md", tuning_check.page(result.steps, dof, result.changed))
        figure = {"tuning_check": lambda: flown_figure(result.steps, dof)}
        write_figures(folder, figure, asked.figure_formats)

    return runner.results(asked, work, write)


def _made(data: dict[str, object], asked: TuneOptions) -> tuple[Ready, dict[str, float]]:
    """What a tuning was made of, and the gains that it gave or left."""
    made: Any = data.get("made_from")
    if data.get("schema") != TUNING or not isinstance(made, dict):
        raise ModelError(f"{asked.model.name}: this is no tuning; give the tuning.json that `automarine tune` wrote")
    gains: Any = data.get("gains") or data.get("present_gains")
    if not gains:
        raise ModelError(f"{asked.model.name}: it gave no gains ({data.get('verdict')}); tune again, and fly those")
    settings = dict(made["settings"])
    settings |= {key: json_document(one["name"], one["content"]) for key, one in made["files"].items()}
    own = TuneOptions(**{**settings, "supply": tuple(settings["supply"])})
    flown = {name: float(one["value"] if isinstance(one, dict) else one) for name, one in gains.items()}
    return ready(own), flown


def _changed(runs: Sequence[Run], made: Ready) -> str:
    """What a diagnosis of the logs says, cut in pieces so that there is something to tell chance by, in a sentence."""
    parts = -(-PIECES // len(runs))
    ends = [np.linspace(0, len(run), parts + 1).astype(int) for run in runs]
    pieces = [
        replace(run.cut(start, stop), name=f"{run.name} {k}")
        for run, own in zip(runs, ends)
        for k, (start, stop) in enumerate(pairwise(own), 1)
    ]
    try:
        with in_words_of(made.known.model.dof):
            found = diagnose_runs(pieces, made.known.model, seed=made.asked.seed)
    except AutomarineError as problem:
        return f"The log could not be diagnosed: {problem}."
    said = verdict_sentence(found)
    return " ".join([f"A diagnosis of the log says: {said}", *(one.says for one in found.effects)])


def _lines(result: TuningCheck) -> Iterator[str]:
    yield tuning_check.verdict(result.steps)
    if result.changed:
        yield result.changed


tune_check = Command(
    "tune", TuneOptions, _check, {TuningCheck: View(TuningCheck.tables, _lines)},
    files=lambda result: ("tuning_check.json", "tuning_check.md", "tuning_check.png"), listed=False,
)  # fmt: skip
