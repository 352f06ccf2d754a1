"""The result of `fit-thrusters`: the map over all points and at each voltage, thrusters compared, and its JSON."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy import special

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.logs import ColumnRule
from automarine_cli.logs.canonical import likely_column
from automarine_cli.logs.recognise import is_called
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.pipeline.result_files import THRUSTER_MAP
from automarine_cli.pipeline.words import listed
from automarine_cli.runs.run import runs_json
from automarine_cli.thrusters.bollard_data import (
    Ints,
    Points,
    Tare,
    ThrusterLogs,
    flag_contradictions,
    levels_of,
    subtract_tare,
    voltage_steps,
)
from automarine_cli.thrusters.fit import FEWEST_LEVELS, Analysis, FormScore, Side, analyse, parameters_json
from automarine_cli.thrusters.forms import SIDES
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.plateaus import Reduction, reduce_series
from automarine_cli.thrusters.voltage import VoltageExponent, voltage_exponents

MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median over that of a mean
CHANCE = 0.05  # that any of the thrusters of one make is told to differ


@dataclass(frozen=True)
class Compared:
    """One thruster beside the others: its square law by direction, by how much its thrust differs from their median
    [percent], the chance of a difference as large, and whether that is beyond chance; or `why` it has no map.
    """

    name: str
    points: int
    law: Mapping[str, Estimate]
    percent: Mapping[str, float]
    p_value: Mapping[str, float]
    differs: bool
    form: str = ""
    rmse_percent: float = 0.0
    why: str = ""

    def to_json(self) -> dict[str, object]:
        """One entry under `by` of thrusters.json."""
        if self.why:
            return {"thruster": self.name, "why": self.why}
        sides = {
            side: {"a": law.to_json(), "differs_percent": self.percent.get(side), "p_value": self.p_value.get(side)}
            for side, law in self.law.items()
        }
        return {
            "thruster": self.name, "points": self.points, "form": self.form,
            "rmse_percent_of_full_scale": self.rmse_percent, "differs": self.differs, **sides,
        }  # fmt: skip


def compared(parts: Mapping[str, Analysis | str]) -> tuple[Compared, ...]:
    """Each thruster, or why it has no map, against the median of the others, which one that differs does not move;
    beyond chance over all thrusters and directions together (Bonferroni)."""
    laws = {name: one.square for name, one in parts.items() if not isinstance(one, str)}
    tests = sum(len(law) for law in laws.values())
    found = []
    for name, one in parts.items():
        if isinstance(one, str):
            found.append(Compared(name, 0, {}, {}, {}, False, why=one))
            continue
        percent, chance = {}, {}
        for side, _ in SIDES:
            others = [law[side] for other, law in laws.items() if other != name and side in law]
            if side in laws[name] and others:
                percent[side], chance[side] = _against(laws[name][side], others)
        differs = any(p < CHANCE / tests for p in chance.values())
        chosen = one.chosen
        error = one.percent(chosen.rmse) or 0.0
        found.append(
            Compared(name, len(one.points), laws[name], percent, chance, differs, chosen.form.name, float(error))
        )
    return tuple(found)


def _against(own: Estimate, others: list[Estimate]) -> tuple[float, float]:
    """Difference from the others' median [percent], and the chance of one as large."""
    middle = float(np.median([one.value for one in others]))
    spread = MEDIAN * float(np.median([_error(one) for one in others])) / np.sqrt(len(others))
    off = own.value - middle
    return 100.0 * off / middle, float(2.0 * special.ndtr(-abs(off) / max(np.hypot(_error(own), spread), 1e-300)))


def _error(one: Estimate) -> float:
    """Standard error, widened for few levels as the 95 % interval is."""
    return float((one.ci95[1] - one.ci95[0]) / (2.0 * special.ndtri(0.975)))


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


STRONG = 0.2
"""Share of the largest thrust from which readings tell whether a command always gives the same."""
APART = 0.3
"""Share of a thrust by which readings at one command differ where something else changed."""
FELT = 0.2  # exponent of thrust against voltage from which one map for all voltages misleads


def fit_records(
    loaded: ThrusterLogs, thrusters: int, n_unit: str, form: str | None, jobs: int, progress: Progress
) -> ThrusterFit:
    """The map of one thruster from tests in which `thrusters` equal ones pulled; `form` None chooses by
    cross-validation, `n_unit` is the control signal's. Raises FitError where no direction can be fitted."""
    where = loaded.inputs[0].name if len(loaded.inputs) == 1 else f"{len(loaded.inputs)} logs"
    reduction = reduce_series(list(loaded.records))
    points = reduction.points.divided(thrusters)
    step = voltage_steps(points.voltage)
    unsorted = _without_voltages(points, step)
    differ = _differ(loaded, points, thrusters, where)
    logged = points
    points, apart = (points, differ) if differ else _flagged(loaded, points, step)
    points, tare = subtract_tare(points)
    varied = step if step is not None and step.max() > 0 else None
    try:
        analysis, _ = analyse(points, varied, tare.stderr if tare.subtracted else 0.0, n_unit, form, where)
    except FitError as refusal:
        raise _with_rest(refusal, logged, thrusters, loaded.rule) from None
    voltages, exponents, notes = _by_voltage(points, step, tare, n_unit, form, jobs, progress)
    return ThrusterFit(
        loaded,
        reduction,
        analysis,
        tare,
        thrusters,
        voltages,
        exponents,
        (*apart, *reduction.notes, *unsorted, *_notes(points), *notes),
        _by_part(loaded, thrusters, n_unit, form) if loaded.asked else {},
    )


def _differ(loaded: ThrusterLogs, points: Points, thrusters: int, where: str) -> tuple[str, ...]:
    """What to know where one command gave very different thrusts and no voltage tells why. Raises FitError where a
    column may hold the supply."""
    if np.any(np.isfinite(points.voltage)) or len(loaded.parts) > 1:
        return ()
    level, size = levels_of(points.n), np.abs(points.force)
    ends = []
    for number in np.unique(level[size > STRONG * size.max(initial=0.0)]):
        force = points.force[level == number]
        if len(force) > 1 and not np.any(points.raw[level == number]):
            ends.append((float(np.ptp(force)) / float(np.abs(force).max()), int(number)))
    if len(ends) < FEWEST_LEVELS or np.median([apart for apart, _ in ends]) < APART:
        return ()
    _, number = max(ends)
    at, force = float(np.mean(points.n[level == number])), thrusters * points.force[level == number]
    said = f"the same command {at:.4g} gave {force.min():.3g} to {force.max():.3g} N"
    others = {name: np.concatenate([r.extras[name] for r in loaded.records]) for name in loaded.records[0].extras
              if all(name in r.extras for r in loaded.records)}  # fmt: skip
    varied = [name for name, values in others.items() if np.nanmin(values) < (1.0 - APART) * np.nanmax(values)]
    called = next((name for name in varied if is_called("voltage", [name])), None)
    if (supply := called or likely_column("voltage", varied)) is not None:
        low, high = np.nanmin(others[supply]), np.nanmax(others[supply])
        raise FitError(
            f"{where}: {said}; does {supply} ({low:.4g} to {high:.4g}) hold the supply? Then write "
            f'voltage_V = "{supply}" under [columns] in a file and give it with --columns FILE.toml'
        )
    return (f"{said[0].upper()}{said[1:]}: something else changed between tests, and the map is a mean over that.",)


def _with_rest(refusal: FitError, points: Points, thrusters: int, rule: ColumnRule | None) -> FitError:
    """A refusal, and the force at zero command where that is none: then the sensor has an offset."""
    rest = points.force[points.n == 0.0]
    if not len(rest) or abs(float(np.median(rest))) <= STRONG * np.ptp(points.force):
        return refusal
    force = thrusters * float(np.median(rest))
    read = ColumnRule("NAME") if rule is None else rule
    offset = read.subtract + force / (read.sign * read.scale)
    return FitError(
        f"{str(refusal).partition(';')[0]}; the force at command 0 is {force:.4g} N, which looks like the offset of "
        f"the load cell. Write subtract = {offset:.4g} in the line of the force under [columns] in the --columns file"
    )


def _flagged(loaded: ThrusterLogs, points: Points, step: Ints | None) -> tuple[Points, tuple[str, ...]]:
    """Points with contradictions flagged, each thruster's among themselves: where a column names thrusters and nobody
    asked for them, if that leaves fewer, which is then told."""
    if len(loaded.parts) < 2:
        return flag_contradictions(points, step), ()
    number = {name: i for i, name in enumerate(("", *loaded.parts))}
    part = np.array([number[record.part] for record in loaded.records])[points.record]
    apart = flag_contradictions(points, part if step is None else part * (int(step.max()) + 1) + step)
    if loaded.asked:
        return apart, ()
    pooled = flag_contradictions(points, step)
    before, after = (int(np.count_nonzero(one.flag != "")) for one in (pooled, apart))
    if before <= after:
        return pooled, ()
    told = (
        f"The column {loaded.by} names {len(loaded.parts)} parts ({listed(loaded.parts)}): taken together {before} of "
        f"{len(points)} points contradict their neighbours, each by itself {after}. They may be thrusters that differ: "
        f'write by = "{loaded.by}" under [columns] in a file and give it with --columns FILE.toml for a map of each.'
    )
    return apart, (told,)


def _by_part(loaded: ThrusterLogs, thrusters: int, n_unit: str, form: str | None) -> dict[str, ThrusterFit | str]:
    """The fit of each thruster by itself, or why there is none."""
    found: dict[str, ThrusterFit | str] = {}
    for name in loaded.parts:
        try:
            found[name] = fit_records(loaded.of(name), thrusters, n_unit, form, 1, silent)
        except FitError as refusal:
            found[name] = str(refusal)
    return found


def _by_voltage(
    points: Points, step: Ints | None, tare: Tare, n_unit: str, form: str | None, jobs: int, progress: Progress
) -> tuple[tuple[tuple[float, Analysis], ...], dict[str, VoltageExponent | None], tuple[str, ...]]:
    """A map for each voltage step, and the exponents of thrust against voltage."""
    if step is None or step.max() == 0:
        return (), {}, ()
    stderr = tare.stderr if tare.subtracted else 0.0
    groups = [points.where(step == number) for number in np.unique(step)]
    judge = partial(_one_voltage, tare_stderr=stderr, n_unit=n_unit, form=form)
    found = ordered_map(judge, groups, jobs, progress=progress, stage="voltages")
    notes = [f"No map at this voltage: {one}." for one in found if isinstance(one, str)]
    fits = [(volts, analysis) for volts, analysis, _ in (one for one in found if not isinstance(one, str))]
    sides = [one[2] for one in found if not isinstance(one, str)]
    laws = [{name: estimate.value for name, estimate in analysis.square.items()} for _, analysis in fits]
    exponents = voltage_exponents(np.array([volts for volts, _ in fits]), sides, laws) if len(fits) > 1 else {}
    powers = [found.exponent.value for found in exponents.values() if found and found.exponent]
    if powers and max(abs(power) for power in powers) > FELT:
        notes.append(
            f"Thrust at the same control signal grows with the voltage to the power {np.mean(powers):.2f}: "
            "the map over all voltages is a mean; for a known voltage use that voltage's map."
        )
    return tuple(fits), exponents, tuple(notes)


def _one_voltage(
    points: Points, *, tare_stderr: float, n_unit: str, form: str | None
) -> tuple[float, Analysis, dict[str, Side]] | str:
    """Voltage, analysis and sides of one step, or why there is none."""
    volts = float(np.median(points.voltage))
    try:
        analysis, sides = analyse(points, None, tare_stderr, n_unit, form, f"{volts:.4g} V")
    except FitError as refusal:
        return str(refusal)
    return volts, analysis, sides


def _without_voltages(points: Points, step: Ints | None) -> tuple[str, ...]:
    """Why there is no map for each voltage although voltages were logged."""
    if step is not None or not np.any(np.isfinite(points.voltage)):
        return ()
    missing = int(np.count_nonzero(~np.isfinite(points.voltage)))
    why = f"{missing} of {len(points)} points have none" if missing else "it drifts without steps"
    return (f"The supply voltage is not used: {why}.",)


def _notes(points: Points) -> tuple[str, ...]:
    """What a person should know of the points: exact zeros at a command may never have been measured."""
    silent_points = (points.n != 0.0) & (points.force == 0.0) & (points.flag == "")
    count = int(np.count_nonzero(silent_points))
    if count == 0:
        return ()
    largest = float(np.max(np.abs(points.n[silent_points])))
    return (
        f"{count} point{'s have' if count > 1 else ' has'} exactly zero thrust at a command (up to |n| = "
        f"{largest:.4g}): a dead band, or readings that were set to zero or never taken; they are kept.",
    )
