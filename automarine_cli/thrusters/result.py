"""The result of `fit-thrusters` and its form in JSON (the contract's section 3, with additions)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from automarine_cli.pipeline.records import Document, json_document
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import THRUSTER_MAP
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.thrusters.alike import Compared, compared
from automarine_cli.thrusters.analysis import Analysis
from automarine_cli.thrusters.fit import Parameter
from automarine_cli.thrusters.forms import SIDES
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.plateaus import Reduction
from automarine_cli.thrusters.points import Points
from automarine_cli.thrusters.records import ThrusterLogs
from automarine_cli.thrusters.selection import FormScore
from automarine_cli.thrusters.tare import Tare
from automarine_cli.thrusters.voltage import VoltageExponent

ONE_PULLED = (
    "One thruster is taken to have pulled in each test, as nothing else was said; if two pulled together, give "
    "--thrusters-per-test 2 (thrusters_per_test=2)."
)


@dataclass(frozen=True, repr=False)
class ThrusterFit(Shown):
    """The pooled analysis of one thruster, one for each voltage step, and how the data were treated.

    `parts` are the fits of each thruster by itself where a column names them (`logs.by`), or why there is none.
    """

    logs: ThrusterLogs
    reduction: Reduction
    analysis: Analysis
    tare: Tare
    thrusters_per_test: int
    voltages: tuple[tuple[float, Analysis], ...]
    exponents: dict[str, VoltageExponent | None]
    notes: tuple[str, ...]
    parts: Mapping[str, "ThrusterFit | str"] = field(default_factory=dict)

    @property
    def map(self) -> ThrusterMap:
        """The chosen map of one thruster."""
        return self.analysis.map

    @property
    def compared(self) -> tuple[Compared, ...]:
        """Each thruster that a column names, beside the others."""
        return compared({name: one if isinstance(one, str) else one.analysis for name, one in self.parts.items()})

    @property
    def points(self) -> Points:
        """Measured points of one thruster, tared and flagged."""
        return self.analysis.points

    def place(self, index: int) -> str:
        """File and run of one point, for people."""
        return self.logs.records[int(self.points.record[index])].place

    def document(self, option: str) -> Document:
        """Its result file, for a command that takes a map."""
        return json_document("thrusters.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        """Content of thrusters.json (schema automarine/thruster-map/1)."""
        analysis = self.analysis
        result: dict[str, object] = {"schema": THRUSTER_MAP.schema, **_square_json(analysis)}
        result["per_test"] = {
            name: {"a": _estimate(scaled(analysis.square.get(name), self.thrusters_per_test))} for name, _ in SIDES
        }
        result["thrusters_per_test"] = self.thrusters_per_test
        result |= _scores_json(analysis)
        result["n_unit"] = analysis.n_unit
        if analysis.points.n_range is not None:
            result["n_range"] = list(analysis.points.n_range)
        tare, reduction = self.tare, self.reduction
        result["tare"] = {
            "value_N": tare.value, "stderr_N": tare.stderr, "readings": tare.readings, "drift_N": tare.drift,
            "subtracted": tare.subtracted,
        }  # fmt: skip
        result["points"] = {
            "used": len(self.points), "plateaus": reduction.plateaus, "samples": reduction.samples,
            "samples_left_out": reduction.dropped, "rows_with_missing_values": self.logs.missing,
        }  # fmt: skip
        result["flagged"] = [self._flagged_json(int(index)) for index in np.flatnonzero(self.points.flag != "")]
        if np.any(np.isfinite(self.points.voltage)):
            ends = np.nanmin(self.points.voltage), np.nanmax(self.points.voltage)
            result["voltage_range_V"] = [float(volts) for volts in ends]
        if self.voltages:
            result["voltages"] = [
                {"voltage_V": volts, **_square_json(one), **_scores_json(one)} for volts, one in self.voltages
            ]
            result["voltage_exponent"] = {
                name: None if found is None else found.to_json() for name, found in self.exponents.items()
            }
        if self.parts:
            result["by"] = {"column": self.logs.by, "thrusters": [one.to_json() for one in self.compared]}
        result["notes"] = list(self.notes)
        result["runs"] = runs_json(self.logs.used, self.logs.set_aside)
        return result

    def _flagged_json(self, index: int) -> dict[str, object]:
        points = self.points
        record = self.logs.records[int(points.record[index])]
        return {
            "file": record.source, "run": record.run, "n": float(points.n[index]),
            "force_N": float(points.force[index]), "weight": float(points.weight[index]),
            "why": str(points.flag[index]),
        }  # fmt: skip


def scaled(estimate: Estimate | None, factor: float) -> Estimate | None:
    """An estimate times a known number."""
    if estimate is None:
        return None
    low, high = estimate.ci95
    return Estimate(factor * estimate.value, factor * estimate.stderr, (factor * low, factor * high), estimate.unit)


def _estimate(estimate: Estimate | None) -> dict[str, object] | None:
    return None if estimate is None else estimate.to_json()


def parameters_json(found: Mapping[str, Parameter] | None) -> dict[str, object] | None:
    """One direction's parameters in a map's file."""
    return None if found is None else {name: one.to_json() for name, one in found.items()}


def _square_json(analysis: Analysis) -> dict[str, object]:
    """`forward` and `backward`: equation 2's coefficient; null with a why where not measured."""
    result: dict[str, object] = {}
    for name, sign in SIDES:
        count = int(np.count_nonzero(analysis.points.n * sign > 0))
        entry: dict[str, object] = {
            "a": _estimate(analysis.square.get(name)),
            "points": count,
            "levels": analysis.levels.get(name, 0),
        }
        if name in analysis.without:
            entry["why"] = analysis.without[name]
        result[name] = entry
    return result


def _scores_json(analysis: Analysis) -> dict[str, object]:
    """The square law's scores, all forms side by side, the chosen one and why."""
    law, chosen = analysis.law, analysis.chosen
    return {
        "r2": analysis.r2,
        "rmse_N": law.rmse,
        "rmse_percent_of_full_scale": analysis.percent(law.rmse),
        "rmse_all_points_N": analysis.over_all(law),
        "cv_rmse_N": law.cv_rmse,
        "full_scale_N": analysis.full_scale,
        "forms": [_form_json(analysis, score) for score in analysis.selection.scores],
        "form": chosen.form.name,
        "chosen_because": analysis.selection.because,
        "chosen": {
            "form": chosen.form.name,
            "r2": analysis.chosen_r2,
            "rmse_N": chosen.rmse,
            "rmse_percent_of_full_scale": analysis.percent(chosen.rmse),
            "rmse_all_points_N": analysis.over_all(chosen),
            "cv_rmse_N": chosen.cv_rmse,
        },
        "parameters": {name: parameters_json(analysis.parameters.get(name)) for name, _ in SIDES},
    }


def _form_json(analysis: Analysis, score: FormScore) -> dict[str, object]:
    return {
        "form": score.form.name,
        "equation": score.form.equation,
        "parameters_per_direction": score.form.parameters,
        "cv_rmse_N": score.cv_rmse,
        "cv_rmse_percent_of_full_scale": analysis.percent(score.cv_rmse),
        "rmse_N": score.rmse,
        "rmse_percent_of_full_scale": analysis.percent(score.rmse),
        "cv_mean_square_behind_best_N2": None if score.cv_rmse is None else score.behind,
        "cv_mean_square_behind_best_stderr_N2": None if score.cv_rmse is None else score.behind_stderr,
        "within_one_stderr_of_best": score.within_reach,
        "at_bound": {name: list(bound) for name, bound in score.at_bound.items() if bound},
    }
