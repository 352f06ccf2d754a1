"""`diagnose`: where simulation and measurement disagree, which effect is missing, and the gap that it closes."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.estimates import base_estimates
from automarine_cli.diagnosis.formula_file import learned_json
from automarine_cli.diagnosis.verdict import NamedEffect
from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.fits.channel_noise import channels_json, fit_sentences
from automarine_cli.fits.linear_mixed import in_words_of
from automarine_cli.logs import ColumnMap, LogFile, given_columns
from automarine_cli.models.planar_store import is_planar
from automarine_cli.models.store import StoredModels, load_yaw_models
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.parallel import lasting_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.shown import Shown
from automarine_cli.report import diagnosis_report, diagnosis_tables, thruster_diagnosis
from automarine_cli.report.figures.files import refuse_unknown
from automarine_cli.report.tables import Table
from automarine_cli.runs.channels import AUTO, asked_channels, wanted_channels
from automarine_cli.runs.load import load_runs, refused_by_strict, told_beside
from automarine_cli.runs.run import Run, SetAside, readings
from automarine_cli.runs.stuck import without_stuck
from automarine_cli.runs.undriven import without_undriven
from automarine_cli.workflows.diagnose_planar import PlanarDiagnosis, diagnose_planar
from automarine_cli.workflows.diagnose_thrusters import ThrusterDiagnosis, diagnose_thrusters, is_thruster_map
from automarine_cli.workflows.effects import own_inputs
from automarine_cli.workflows.extended_model import extended_model
from automarine_cli.workflows.moments import with_moments

FILES = ("diagnosis.json", "extended_model.json", "diagnosis.md", "where.png", "why.png", "before_after.png")
LEARNED = "learned.png"


@dataclass(frozen=True, repr=False)
class YawDiagnosis(Shown):
    """A diagnosis with what it was asked of: the stored model, its file's hash, and the runs left out."""

    diagnosis: Diagnosis
    stored: StoredModels
    parent_sha256: str
    set_aside: tuple[SetAside, ...]

    def to_json(self) -> dict[str, Any]:
        """The result file: schema automarine/diagnosis/1."""
        found = self.diagnosis.found
        held = self.diagnosis.held_out_gap
        moved = base_estimates(self.diagnosis.study, self.diagnosis.said.leaves)
        before = base_estimates(self.diagnosis.study, found.base)
        dof = self.stored.dof
        return {
            "schema": "automarine/diagnosis/1",
            **({} if dof.wraps else {"motion": dof.name}),
            "verdict": self.diagnosis.verdict,
            **{key: text for key in ("why", "left") if (text := getattr(self.diagnosis.said, key))},
            "model": self.stored.preferred,
            f"{dof.words.force}_unit": self.stored.moment_unit,
            "effects": [
                _effect_json(effect, len(self.diagnosis.study.runs), dof) for effect in self.diagnosis.effects
            ],
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
            "base": {
                name: {"before": before[name].to_json(), "after": moved[name].to_json()} for name in before
            },
            "smallest_visible": {k: v for k, v in self.diagnosis.detectable.items() if np.isfinite(v)},
            "open_water": self.diagnosis.study.driven,
            **channels_json(self.diagnosis.channels, found.final.fit, dof),
            "held_out": []
            if self.diagnosis.held_out is None
            else [r.name for r in self.diagnosis.held_out.runs],
            "runs": {
                "used": len(self.diagnosis.study.runs),
                "set_aside": [asdict(run) for run in self.set_aside],
                **readings(self.diagnosis.study.runs),
            },
        }

    def _prediction_json(self) -> dict[str, Any]:
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
        """What the terminal shows: verdict, effects, gap, candidates."""
        lines = [diagnosis_tables.verdict_sentence(self.diagnosis)]
        for effect in self.diagnosis.effects:
            lines.append(f"{effect.name}: {effect.says}")
            lines += [
                f"Not excluded is {rival.name} (weight {rival.confidence:.0%}): {rival.split_by}"
                for rival in effect.few_rivals
            ]
            lines += filter(None, [effect.other_rivals])
        if self.diagnosis.study.cycle is not None:
            lines.append(self.diagnosis.study.cycle.sentence(self.stored.dof))
        lines += fit_sentences(self.diagnosis.channels, self.diagnosis.found.final.fit, self.stored.dof)
        return [*lines, *diagnosis_tables.tables(self.diagnosis)]

    def extended_model(self) -> dict[str, Any]:
        """The base model with the effects named, refitted together: a yaw-model that `validate` and `diagnose` take."""
        return extended_model(
            self.diagnosis.study, self.diagnosis.said.leaves, self.stored, self.parent_sha256
        )


def _effect_json(effect: NamedEffect, runs: int, dof: Dof) -> dict[str, Any]:
    return {
        "name": effect.name,
        **({"law": effect.law} if effect.law else {}),
        "says": effect.says,
        "parameters": {name: estimate.to_json() for name, estimate in effect.parameters.items()},
        "confidence": effect.confidence,
        "p_value": effect.p_value,
        "rivals": [asdict(rival) for rival in effect.rivals],
        **({} if effect.learned is None else {"learned": learned_json(effect.learned, runs, dof)}),
    }


def diagnose(
    logs: Sequence[str | Path],
    *,
    model: Path,
    hold_out: Sequence[str | Path] = (),
    columns: Path | ColumnMap | None = None,
    thrusters: Path | None = None,
    arm: float | None = None,
    out: Path | None = None,
    figure_formats: tuple[str, ...] = ("png",),
    overwrite: bool = False,
    strict: bool = False,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress = silent,
    channels: str = AUTO,
) -> YawDiagnosis:
    """Diagnose the preferred model of the file `model` on yaw logs, on `jobs` processes or a Dask `cluster`.

    `hold_out` logs are never fitted; without any a quarter of the runs, drawn with `seed`, is held out. `channels` says
    which sensors count (`runs.channels.choose_channels`). Writes the
    results if `out` is given, figures in the
    `figure_formats` (png, svg, pdf). Raises LogError, RunError, ModelError, FitError, SettingError or OutputError.
    """
    refuse_unknown(figure_formats)
    stored = load_yaw_models(model)
    wanted_channels(channels, stored.dof)
    names = given_columns(columns)
    runs, aside, files = _runs(logs, names, thrusters, arm, strict, jobs, progress, stored)
    kept, more_aside, more = (
        (None, (), ())
        if not hold_out
        else _runs(hold_out, names, thrusters, arm, strict, jobs, progress, stored)
    )
    parent = hashlib.sha256(model.read_bytes()).hexdigest()

    def work() -> YawDiagnosis:
        base = stored.models[stored.preferred]
        with (
            told_beside((*aside, *more_aside)),
            in_words_of(stored.dof),
            lasting_map(jobs, cluster=cluster, progress=progress) as each,
        ):
            found = diagnose_runs(runs, base, hold_out=kept, seed=seed, each=each, channels=channels)
        return YawDiagnosis(found, stored, parent, (*aside, *more_aside))

    if out is None:
        return work()
    inputs = [Input(file.name, file.path) for file in files]
    inputs += [Input(file.name, file.path, "hold_out") for file in more]
    inputs += given_as(model=model, columns=columns, dbc=names.database, thrusters=thrusters)
    inputs += own_inputs()
    options = {
        "model": model,
        "hold_out": [file.name for file in more],
        "columns": columns,
        "thrusters": thrusters,
        "arm": arm,
        "figure_formats": figure_formats,
        "strict": strict,
        **asked_channels(channels),
    }
    with result_folder(
        out, command="diagnose", options=options, inputs=inputs, seed=seed, overwrite=overwrite
    ) as folder:
        result = work()
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_model())
        diagnosis_report.write(folder, result.diagnosis, figure_formats)
    return result


def diagnose_any(
    logs: Sequence[str | Path],
    *,
    model: Path,
    thrusters: Path | None = None,
    arm: float | None = None,
    cluster: str | None = None,
    channels: str = AUTO,
    **settings: Any,
) -> "YawDiagnosis | ThrusterDiagnosis | PlanarDiagnosis":
    """`diagnose` for a model of one motion, `diagnose_planar` for those of three together, `diagnose_thrusters` for a
    thruster map (here, they are quick), by the schema of the file `model`.
    """
    if is_planar(model):
        if channels != AUTO:
            raise SettingError(f"{model.name} is a planar model: every channel counts; leave --channels out")
        return diagnose_planar(logs, model=model, thrusters=thrusters, arm=arm, **settings)
    if is_thruster_map(model):
        if thrusters is not None or arm is not None:
            raise SettingError(
                f"{model.name} is a thruster map: --thrusters and --arm belong to a yaw model; leave them out"
            )
        if channels != AUTO:
            raise SettingError(
                f"{model.name} is a thruster map: --channels belongs to a motion; leave it out"
            )
        return diagnose_thrusters(logs, model=model, **settings)
    return diagnose(
        logs, model=model, thrusters=thrusters, arm=arm, cluster=cluster, channels=channels, **settings
    )


def files_of(result: "YawDiagnosis | ThrusterDiagnosis | PlanarDiagnosis") -> tuple[str, ...]:
    """The files of either kind of diagnosis."""
    curve = isinstance(result, YawDiagnosis) and any(
        one.learned is not None for one in result.diagnosis.effects
    )
    return (*FILES, LEARNED) if curve else FILES


def terminal(result: "YawDiagnosis | ThrusterDiagnosis | PlanarDiagnosis") -> list[Table | str]:
    """What the terminal shows of either kind of diagnosis."""
    if isinstance(result, YawDiagnosis):
        return result.tables()
    if isinstance(result, PlanarDiagnosis):
        return result.tables()
    return [*thruster_diagnosis.sentences(result), *thruster_diagnosis.tables(result)]


def _runs(
    logs: Sequence[str | Path],
    names: ColumnMap,
    thrusters: Path | None,
    arm: float | None,
    strict: bool,
    jobs: int,
    progress: Progress,
    stored: StoredModels,
) -> tuple[list[Run], tuple[SetAside, ...], tuple[LogFile, ...]]:
    """Runs that a diagnosis can use, with their moments, in the model's unit."""
    dof = stored.dof
    campaign = load_runs(logs, names, dof=dof, strict=strict, progress=progress, jobs=jobs)
    runs = with_moments(campaign.runs, thrusters, arm, names, dof)
    units = {run.moment_unit for run in runs if run.moment is not None}
    if units - {stored.moment_unit}:
        raise SettingError(
            f"{stored.source} is a model of {dof.words.force}s in {stored.moment_unit}, the logs give "
            f"{', '.join(sorted(units))}; fit a model to these logs first, or map their {dof.words.force} with "
            "--columns"
        )
    driven, undriven = without_undriven(runs)
    moving, stuck = without_stuck(driven)
    aside = (*campaign.set_aside, *undriven, *stuck)
    if strict and aside:
        raise refused_by_strict(aside[0])
    return moving, aside, campaign.inputs
