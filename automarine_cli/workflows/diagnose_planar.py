"""`diagnose` of a planar model: which coupling, current or actuator effect it lacks, by innovations."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from automarine_cli.comparison.result_files import of_diagnosis
from automarine_cli.diagnosis.diagnose import split_off
from automarine_cli.diagnosis.outlook import Outlook
from automarine_cli.diagnosis.planar import HEAD_START, Contender, PlanarSearch, find_missing
from automarine_cli.diagnosis.planar_where import find_planar_where
from automarine_cli.diagnosis.where import Where
from automarine_cli.dofs import YAW
from automarine_cli.errors import SettingError
from automarine_cli.fits.planar_fit import Choice, Estimated, PlanarFit, Tried
from automarine_cli.fits.planar_structure import Observed, Structure, observed
from automarine_cli.logs import Logs, given_columns
from automarine_cli.models.planar_store import load_planar_model, planar_json
from automarine_cli.pipeline.records import Document, json_document
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import outcomes, planar_diagnosis_report
from automarine_cli.report.figures.planar_diagnosis import before_after_figure, where_figure, why_figure
from automarine_cli.report.tables import Table
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import DIAGNOSIS
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.channels import AUTO
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.workflows.command import HOLD_OUT, SELDOM, Command, ReadBack, Runner, reads
from automarine_cli.workflows.planar_runs import load_planar
from automarine_cli.workflows.shared import Ending, Judged, Lever, OfLogs, aligned, numbers
from automarine_cli.workflows.view import Figures, Row, View

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
        tried = Tried(Structure.simplest(self.seen), one)
        return PlanarFit((tried,), Choice(tried), self.runs, self.seen)

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

    def document(self, option: str) -> Document:
        """The diagnosis where one is wanted, else the extended model."""
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

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
            "schema": DIAGNOSIS.schema,
            "motion": "planar",
            "verdict": found.verdict,
            **({"why": why} if why else {}),
            "effects": [self._effect(*one) for one in listed or [(suspect, ()) for suspect in found.suspected]],
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
            "runs": runs_json(len(self.runs), self.set_aside, [*self.runs, *self.kept]),
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
            **planar_json(after.model.model, {name: e.to_json() for name, e in self.fits[1].estimates.items()}),
            "effects": [one.candidate.name for one in self.found.named],
            "random": dict(after.random),
            "covariance": {"parameters": list(after.model.free), "matrix": after.covariance.tolist()},
            "parent": self.parent,
        }

    def tables(self) -> list[Table | str]:
        """The verdict, the evidence, the predictions."""
        return planar_diagnosis_report.tables(self.found)


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Logs that are never fitted (none: a quarter of the runs)."""

    hold_out: Logs = field(default=(), metadata=reads("logs", HOLD_OUT))


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(Ending, Lever, HeldOut, Judged, OfLogs):
    """Logs, the model that they are to judge, and which sensors count; `seed` draws what is held out."""

    channels: str = field(default=AUTO, metadata=SELDOM)
    seed: int = 0


def _diagnose(asked: DiagnoseOptions, runner: Runner) -> PlanarDiagnosis:
    """Name what the planar model of the file `model` lacks on planar logs.

    `hold_out` logs are never fitted; without any a quarter of the runs, drawn with `seed`, is held out. Raises
    LogError, RunError, ModelError, FitError, SettingError or OutputError.
    """
    if asked.channels != AUTO:
        raise SettingError(f"{asked.model.name} is a planar model: every channel counts; leave --channels out")
    stored, names = load_planar_model(asked.model), given_columns(asked.columns)
    load = partial(
        load_planar, columns=names, thrusters=asked.thrusters, arm=asked.arm, strict=asked.strict, jobs=runner.jobs,
        progress=runner.progress,
    )  # fmt: skip
    campaign, other = load(asked.logs), load(asked.hold_out) if asked.hold_out else None
    runs, kept = (campaign.runs, other.runs) if other else split_off(campaign.runs, asked.seed, FEWEST)
    seen = observed(campaign.runs)
    if not kept:
        raise SettingError(f"no run is held out: expected at least {FEWEST} logs, or some given with --hold-out")
    aside = (*campaign.set_aside, *(other.set_aside if other else ()))
    parent = hashlib.sha256(asked.model.read_bytes()).hexdigest()

    def work() -> PlanarDiagnosis:
        found = find_missing(stored, runs, kept, seen)
        where = find_planar_where(found, asked.seed)
        return PlanarDiagnosis(replace(found, where=where), where, tuple(runs), tuple(kept), seen, aside, parent)

    def write(folder: ResultFolder, result: PlanarDiagnosis) -> None:
        folder.write_json("diagnosis.json", result.to_json())
        folder.write_json("extended_model.json", result.extended_model())
        planar_diagnosis_report.write(folder, result.found, result.where, asked.figure_formats)

    return runner.results(asked, work, write)


def _lines(result: PlanarDiagnosis) -> Iterator[str]:
    yield planar_diagnosis_report.verdict_sentence(result.found)
    for one in result.found.named:
        yield from (f"  {line}" for line in aligned(result.estimates_of(one)))


def _rows(result: PlanarDiagnosis) -> Iterator[Row]:
    for one in result.found.named:
        for name, estimate in result.estimates_of(one).items():
            yield {"effect": one.candidate.name, "parameter": name, **numbers(estimate)}


def _figures(result: PlanarDiagnosis) -> Figures:
    found, where = result.found, result.where
    if where is None:
        return {"why": lambda: why_figure(found)}
    return {
        "before-after": lambda: before_after_figure(found),
        "where": lambda: where_figure(found, where),
        "why": lambda: why_figure(found),
    }


diagnose_planar = Command(
    "diagnose", DiagnoseOptions, _diagnose,
    {PlanarDiagnosis: View(PlanarDiagnosis.tables, _lines, _rows, _figures)},
    kept=ReadBack(DIAGNOSIS, outcomes.of_diagnosis, of_diagnosis), listed=False,
)  # fmt: skip
