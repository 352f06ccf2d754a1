"""`diagnose`: where simulation and measurement disagree, which effect is missing, and the gap that it closes."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.budget import budget
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.estimates import base_estimates
from automarine_cli.diagnosis.extended_model import extended_model
from automarine_cli.diagnosis.naming_key import naming_key
from automarine_cli.diagnosis.verdict import NamedEffect
from automarine_cli.errors import SettingError
from automarine_cli.filters.nodes import LEAST_STEP
from automarine_cli.fits.channel_noise import channels_json, fit_sentences
from automarine_cli.fits.driven import stepped
from automarine_cli.fits.linear_mixed import in_words_of
from automarine_cli.logs import ColumnMap, Logs, given_columns
from automarine_cli.models.store import StoredModels, load_yaw_models
from automarine_cli.pipeline.parallel import Each, lasting_map
from automarine_cli.pipeline.progress import foretell
from automarine_cli.pipeline.records import Document, json_document, schema_in
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import diagnosis_report, diagnosis_tables
from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import DIAGNOSIS, PLANAR_MODEL, THRUSTER_MAP
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.channels import wanted_channels
from automarine_cli.runs.load import load_runs, refused_by_strict, told_beside
from automarine_cli.runs.run import Run, SetAside, command_warnings
from automarine_cli.runs.stuck import without_stuck
from automarine_cli.runs.undriven import without_undriven
from automarine_cli.workflows.command import Command, Runner
from automarine_cli.workflows.diagnose_planar import DiagnoseOptions, PlanarDiagnosis, diagnose_planar
from automarine_cli.workflows.diagnose_thrusters import FILES, ThrusterDiagnosis, diagnose_thrusters
from automarine_cli.workflows.moments import with_moments
from automarine_cli.workflows.shared import numbers
from automarine_cli.workflows.view import Figures, Row, View

LEARNED = "learned.png"
DRIVEN_S, STEPPED_S = 3e-4, 1e-4
"""Seconds for each reading and effect of a diagnosis of driven runs, and of others, on a machine of 2020; roughly."""


@dataclass(frozen=True, repr=False)
class YawDiagnosis(Shown):
    """A diagnosis with what it was asked of: the stored model, its file's hash, and the runs left out."""

    diagnosis: Diagnosis
    stored: StoredModels
    parent_sha256: str
    set_aside: tuple[SetAside, ...]

    def document(self, option: str) -> Document:
        """The diagnosis where one is wanted, else the extended model."""
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def to_json(self) -> dict[str, object]:
        """The result file: schema automarine/diagnosis/1."""
        found = self.diagnosis.found
        held = self.diagnosis.held_out_gap
        moved = base_estimates(self.diagnosis.study, self.diagnosis.said.leaves)
        before = base_estimates(self.diagnosis.study, found.base)
        dof = self.stored.dof
        return {
            "schema": DIAGNOSIS.schema,
            **({} if dof.wraps else {"motion": dof.name}),
            "verdict": self.diagnosis.verdict,
            **{key: text for key in ("why", "left") if (text := getattr(self.diagnosis.said, key))},
            "model": self.stored.preferred,
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "effects": [_effect_json(effect) for effect in self.diagnosis.effects],
            "where": [region.to_json(dof) for region in self.diagnosis.where.regions],
            "gap": {
                "fitted_runs": self.diagnosis.gap.to_json(dof),
                "held_out_runs": None if held is None else held.to_json(dof),
            },
            **self._prediction_json(),
            "candidates": [
                {"name": trial.added[-1], "gain": found.rounds[0].gain(trial)}
                for trial in sorted(found.rounds[0].trials, key=lambda trial: trial.evidence)
            ],
            "threshold": found.rounds[0].threshold,
            "base": {name: {"before": before[name].to_json(), "after": moved[name].to_json()} for name in before},
            "smallest_visible": {k: v for k, v in self.diagnosis.detectable.items() if np.isfinite(v)},
            "open_water": self.diagnosis.study.driven,
            **channels_json(self.diagnosis.channels, found.final.fit, dof),
            "held_out": [] if self.diagnosis.held_out is None else [r.name for r in self.diagnosis.held_out.runs],
            "runs": runs_json(len(self.diagnosis.study.runs), self.set_aside, self.diagnosis.study.runs),
        }

    def _prediction_json(self) -> dict[str, object]:
        """What driven runs are judged by: predictions from the filtered state."""
        fitted, held = self.diagnosis.outlook, self.diagnosis.held_out_outlook
        if fitted is None:
            return {}
        dof = self.stored.dof
        cycle = self.diagnosis.study.cycle
        return {
            **({} if cycle is None else {"limit_cycle": cycle.to_json()}),
            "prediction": {
                "fitted_runs": fitted.to_json(dof),
                "held_out_runs": None if held is None else held.to_json(dof),
            },
        }

    def tables(self) -> list[Table | str]:
        """What the terminal shows: how commands do not fit their map, verdict, effects, gap, candidates."""
        lines: list[Table | str] = [f"Warning: {one}" for one in command_warnings(self.diagnosis.study.runs)]
        lines += [diagnosis_tables.verdict_sentence(self.diagnosis)]
        for effect in self.diagnosis.effects:
            lines.append(f"{effect.name}: {effect.says}")
            lines += [
                f"Cannot be excluded: {rival.name} (weight {rival.confidence:.0%}): {rival.split_by}"
                for rival in effect.few_rivals
            ]
            lines += filter(None, [effect.other_rivals])
        if self.diagnosis.study.cycle is not None:
            lines.append(self.diagnosis.study.cycle.sentence(self.stored.dof))
        lines += fit_sentences(self.diagnosis.channels, self.diagnosis.found.final.fit, self.stored.dof)
        return [*lines, *diagnosis_tables.tables(self.diagnosis)]

    def extended_model(self) -> dict[str, object]:
        """The base model with the effects named, refitted together: a yaw-model that `validate` and `diagnose` take."""
        return extended_model(self.diagnosis.study, self.diagnosis.said.leaves, self.stored, self.parent_sha256)


def _effect_json(effect: NamedEffect) -> dict[str, object]:
    return {
        "name": effect.name,
        **({"law": effect.law} if effect.law else {}),
        "says": effect.says,
        "parameters": {name: estimate.to_json() for name, estimate in effect.parameters.items()},
        "confidence": effect.confidence,
        "p_value": effect.p_value,
        "rivals": [asdict(rival) for rival in effect.rivals],
        **({} if effect.learned is None else {"learned": effect.learned.to_json()}),
    }


@dataclass(frozen=True, kw_only=True)
class DiagnoseMotionOptions(DiagnoseOptions):
    """The same; the effects of one's own are read too."""

    by_effects = True


def _diagnose(asked: DiagnoseMotionOptions, runner: Runner) -> YawDiagnosis:
    """Diagnose the preferred model of the file `model` on logs of its motion, on `jobs` processes or a Dask `cluster`.

    `hold_out` logs are never fitted; without any a quarter of the runs, drawn with `seed`, is held out. `channels` says
    which sensors count (`runs.channels.choose_channels`). A planar model is diagnosed on logs of motion in the plane, a
    thruster map on bollard tests. Raises LogError, RunError, ModelError, FitError, SettingError or OutputError.
    """
    stored = load_yaw_models(asked.model)
    wanted_channels(asked.channels, stored.dof)
    with lasting_map(runner.jobs, cluster=runner.cluster, progress=runner.progress) as each:
        return _diagnosed(asked, runner, stored, each)


def _diagnosed(asked: DiagnoseMotionOptions, runner: Runner, stored: StoredModels, each: Each) -> YawDiagnosis:
    names = given_columns(asked.columns)
    runs, aside = _runs(asked.logs, asked, names, runner, stored)
    kept, more_aside = _runs(asked.hold_out, asked, names, runner, stored) if asked.hold_out else (None, ())
    parent = hashlib.sha256(asked.model.read_bytes()).hexdigest()
    foretell(runner.progress, "the diagnosis", _seconds(runs) / max(runner.jobs, 1))

    def work() -> YawDiagnosis:
        base = stored.models[stored.preferred]
        with told_beside((*aside, *more_aside)), in_words_of(stored.dof):
            found = diagnose_runs(runs, base, hold_out=kept, seed=asked.seed, each=each, channels=asked.channels)
        return YawDiagnosis(found, stored, parent, (*aside, *more_aside))

    def write(folder: ResultFolder, result: YawDiagnosis) -> None:
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_model())
        diagnosis_report.write(folder, result.diagnosis, asked.figure_formats, each)

    return runner.results(asked, work, write)


def _seconds(runs: Sequence[Run]) -> float:
    """How long a diagnosis takes one process, roughly: it fits every effect of the library to all runs."""
    readings = sum(min(len(run), (run.time[-1] - run.time[0]) / LEAST_STEP) for run in runs)
    driven = 2 * sum(stepped(run) for run in runs) < len(runs)
    return float(readings) * len(effects.names()) * (DRIVEN_S if driven else STEPPED_S)


def _runs(
    logs: Logs, asked: DiagnoseOptions, names: ColumnMap, runner: Runner, stored: StoredModels
) -> tuple[list[Run], tuple[SetAside, ...]]:
    """Runs that a diagnosis can use, with their moments, in the model's unit."""
    dof, strict = stored.dof, asked.strict
    campaign = load_runs(logs, names, dof=dof, strict=strict, progress=runner.progress, jobs=runner.jobs)
    runs = with_moments(campaign.runs, asked.thrusters, asked.arm, names, dof)
    units = {run.moment_unit for run in runs if run.moment is not None}
    if units - {stored.moment_unit}:
        raise SettingError(
            f"{stored.source} is a model of {dof.words.force}s in {stored.moment_unit}, the logs give "
            f"{', '.join(sorted(units))}; fit a model to these logs first, or map their {dof.words.force} with "
            "--columns"
        )
    command_warnings(runs)  # refused where they cannot be of this map
    driven, undriven = without_undriven(runs)
    moving, stuck = without_stuck(driven)
    aside = (*campaign.set_aside, *undriven, *stuck)
    if strict and aside:
        raise refused_by_strict(aside[0])
    return moving, aside


def _files(result: YawDiagnosis | ThrusterDiagnosis | PlanarDiagnosis) -> tuple[str, ...]:
    """The files of any kind of diagnosis."""
    curve = isinstance(result, YawDiagnosis) and any(one.learned is not None for one in result.diagnosis.effects)
    return (*FILES, LEARNED) if curve else FILES


def _lines(result: YawDiagnosis) -> Iterator[str]:
    yield diagnosis_tables.verdict_sentence(result.diagnosis)
    for effect in result.diagnosis.effects:
        yield f"  {effect.name}, confidence {effect.confidence:.0%}"
        if (curve := effect.learned) is not None:
            yield f"    curve of {diagnosis_tables.OF[curve.kind]}  {diagnosis_tables.curve_cell(curve)}"
            continue
        named = {name: (i, one) for i, name, one in diagnosis_tables.counting(effect.name, effect.parameters)}
        width = max(map(len, named), default=0)
        for name, (i, one) in named.items():
            yield f"    {name:<{width}}  {diagnosis_tables.parameter_cell(effect.name, i, one)} {one.unit}".rstrip()
        yield from (f"    or {rival.name}, {rival.confidence:.0%}" for rival in effect.rivals)


def _rows(result: YawDiagnosis) -> Iterator[Row]:
    for effect in result.diagnosis.effects:
        for name, one in effect.parameters.items():
            yield {"effect": effect.name, "confidence": effect.confidence, "parameter": name} | numbers(one)


def _figures(result: YawDiagnosis) -> Figures:
    found = result.diagnosis
    last = found.found
    return {
        "before-after": lambda: before_after_figure(found, budget(found)),
        "where": lambda: where_figure(found),
        "why": lambda: why_figure(found, naming_key(found.study, last.base, last.final)),
    }


def _instead(settings: Mapping[str, object]) -> Command[Any, Any] | None:
    """The diagnosis of a planar model or of a thruster map."""
    model = schema_in(settings.get("model"))
    return (
        diagnose_planar
        if model == PLANAR_MODEL.schema
        else diagnose_thrusters
        if model == THRUSTER_MAP.schema
        else None
    )


diagnose: Command[DiagnoseMotionOptions, YawDiagnosis | PlanarDiagnosis | ThrusterDiagnosis] = Command(
    "diagnose", DiagnoseMotionOptions, _diagnose,
    {YawDiagnosis: View(YawDiagnosis.tables, _lines, _rows, _figures), **diagnose_planar.views,
     **diagnose_thrusters.views},
    _files, diagnose_planar.kept, instead=_instead,
)  # fmt: skip
