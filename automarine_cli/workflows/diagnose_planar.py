"""`diagnose` of a planar model: which coupling, current or actuator effect it lacks, by innovations."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.diagnosis.diagnose import split_off
from automarine_cli.diagnosis.outlook import Outlook
from automarine_cli.diagnosis.planar import HEAD_START, Contender, PlanarSearch, find_missing
from automarine_cli.diagnosis.planar_where import find_planar_where
from automarine_cli.diagnosis.where import Where
from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.planar_fit import Estimated, PlanarFit, Tried
from automarine_cli.fits.planar_structure import Observed, Structure, observed
from automarine_cli.logs import ColumnMap, given_columns
from automarine_cli.models.planar_store import load_planar_model, planar_json
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.shown import Shown
from automarine_cli.report import planar_diagnosis_report
from automarine_cli.report.figures.files import refuse_unknown
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run, SetAside, readings
from automarine_cli.workflows.planar_runs import load_planar

SCHEMA = "automarine/diagnosis/1"
FEWEST = 4
"""Runs of which one is held out: those of motion in the plane are few and long."""


@dataclass(frozen=True, repr=False)
class PlanarDiagnosis(Shown):
    """What was found of a planar model on `runs`, with `kept` held out, and where it goes wrong; what was set aside,
    and the file's hash."""

    found: PlanarSearch
    where: Where | None
    runs: tuple[Run, ...]
    kept: tuple[Run, ...]
    seen: Observed
    set_aside: tuple[SetAside, ...]
    parent: str

    @cached_property
    def fits(self) -> tuple[PlanarFit, PlanarFit]:
        """The first and the last model, as a fit shows them."""
        return self._as_fit(self.found.before), self._as_fit(self.found.after)

    def _as_fit(self, one: Estimated) -> PlanarFit:
        return PlanarFit((Tried(Structure.simplest(self.seen), one),), self.runs, self.seen)

    def estimates_of(self, one: Contender) -> dict[str, Estimate]:
        """The parameters that an effect adds."""
        known = self._as_fit(one.found).estimates
        return {name: known[name] for name in one.candidate.added}

    def _effect(self, one: Contender, rivals: Sequence[Contender]) -> dict[str, object]:
        """A named or suspected effect, with its odds among its rivals."""
        weights = np.exp([0.5 * (rival.surplus - one.surplus) for rival in rivals])
        total = 1.0 + float(np.sum(weights))
        return {
            "name": one.candidate.name,
            "law": "surge, sway and yaw",
            "says": planar_diagnosis_report.says(one.candidate),
            "parameters": {name: e.to_json() for name, e in self.estimates_of(one).items()},
            "confidence": 1.0 / total,
            "deviance_gained": one.surplus,
            "held_out_log_likelihood_gained": one.held_out,
            "rivals": [
                {
                    "name": rival.candidate.name,
                    "confidence": float(weight) / total,
                    "says": planar_diagnosis_report.says(rival.candidate),
                    "split_by": planar_diagnosis_report.split_by(rival.candidate),
                }
                for rival, weight in zip(rivals, weights)
            ],
        }

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/diagnosis/1."""
        found, (before, after) = self.found, (one.estimates for one in self.fits)
        listed = [(one.best, one.rivals) for one in found.steps if one.best is not None]
        why = planar_diagnosis_report.why(found)
        first = found.rounds[0]
        fitted = {one.candidate.added: one.surplus for one in first.tried}
        gains = [(one, fitted.get(one.added, promised)) for one, promised in first.promised]
        outlooks = {"fitted_runs": found.outlook(False), "held_out_runs": found.outlook(True)}
        return {
            "schema": SCHEMA,
            "motion": "planar",
            "verdict": found.verdict,
            **({"why": why} if why else {}),
            "effects": [
                self._effect(*one) for one in listed or [(suspect, ()) for suspect in found.suspected]
            ],
            "where": [region.to_json(YAW) for region in self.where.regions] if self.where else [],
            "gap": {name: self._gap(one) for name, one in outlooks.items()},
            "prediction": {name: None if one is None else one.to_json(YAW) for name, one in outlooks.items()},
            "candidates": [
                {"name": one.name, "parameters": list(one.added), "gain": gain, "fitted": one.added in fitted}
                for one, gain in sorted(gains, key=lambda each: -each[1])
            ],
            "threshold": HEAD_START,
            "base": {
                name: {"before": before[name].to_json(), "after": after[name].to_json()}
                for name in before
                if name in after
            },
            "held_out": [run.name for run in self.kept],
            "runs": {
                "used": len(self.runs),
                "set_aside": [asdict(one) for one in self.set_aside],
                **readings([*self.runs, *self.kept]),
            },
        }

    def _gap(self, one: Outlook | None) -> dict[str, float] | None:
        """The error of the heading over the horizon that decides, beside the noise of its readings."""
        if one is None:
            return None
        judged = one.judged or one.ahead[-1]
        return {
            "before_deg": float(YAW.shown(judged.before)),
            "after_deg": float(YAW.shown(judged.after)),
            "noise_floor_deg": float(YAW.shown(self.found.after.noises[YAW.position])),
            "horizon_s": judged.horizon,
        }

    def extended_model(self) -> dict[str, object]:
        """The model with what was named, and what is random as fitted: schema automarine/planar-model/1."""
        after = self.found.after
        return {
            **planar_json(
                after.model.model, {name: e.to_json() for name, e in self.fits[1].estimates.items()}
            ),
            "effects": [one.candidate.name for one in self.found.named],
            "random": dict(after.random),
            "covariance": {"parameters": list(after.model.free), "matrix": after.covariance.tolist()},
            "parent": self.parent,
        }

    def tables(self) -> list[Table | str]:
        """The verdict, the evidence, the predictions."""
        return planar_diagnosis_report.tables(self.found)


def diagnose_planar(
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
    progress: Progress = silent,
) -> PlanarDiagnosis:
    """Name what the planar model of the file `model` lacks on planar logs; writes the results if `out` is given.

    `hold_out` logs are never fitted; without any a quarter of the runs, drawn with `seed`, is held out. Figures are
    drawn in the `figure_formats` (png, svg, pdf). Raises LogError, RunError, ModelError, FitError, SettingError or
    OutputError.
    """
    refuse_unknown(figure_formats)
    stored, names = load_planar_model(model), given_columns(columns)
    campaign = load_planar(logs, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
    other = (
        load_planar(hold_out, names, thrusters, arm, strict=strict, jobs=jobs, progress=progress)
        if hold_out
        else None
    )
    runs, kept = (campaign.runs, other.runs) if other else split_off(campaign.runs, seed, FEWEST)
    seen = observed(campaign.runs)
    if not kept:
        raise SettingError(
            f"no run is held out: expected at least {FEWEST} logs, or some given with --hold-out"
        )
    aside = (*campaign.set_aside, *(other.set_aside if other else ()))
    parent = hashlib.sha256(model.read_bytes()).hexdigest()

    def work() -> PlanarDiagnosis:
        found = find_missing(stored, runs, kept, seen)
        where = find_planar_where(found, seed)
        return PlanarDiagnosis(found, where, tuple(runs), tuple(kept), seen, aside, parent)

    if out is None:
        return work()
    more = other.inputs if other else ()
    inputs = [Input(file.name, file.path) for file in campaign.inputs]
    inputs += [Input(file.name, file.path, "hold_out") for file in more]
    inputs += given_as(model=model, columns=columns, dbc=names.database, thrusters=thrusters)
    options: dict[str, Any] = {
        "model": model, "hold_out": [file.name for file in more], "columns": columns, "thrusters": thrusters,
        "arm": arm, "figure_formats": figure_formats, "strict": strict,
    }  # fmt: skip
    with result_folder(
        out, command="diagnose", options=options, inputs=inputs, seed=seed, overwrite=overwrite
    ) as folder:
        result = work()
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_model())
        planar_diagnosis_report.write(folder, result.found, result.where, figure_formats)
    return result
