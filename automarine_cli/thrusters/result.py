"""The result of `fit-thrusters`: the map over all points and at each voltage, thrusters compared, and its JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy import special

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.logs import ColumnRule
from automarine_cli.logs.columns import likely_column
from automarine_cli.logs.recognise import is_called
from automarine_cli.pipeline.parallel import Progress, ordered_map, silent
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.runs.run import runs_json, usual_neutral
from automarine_cli.text import listed
from automarine_cli.thrusters.bollard_data import (
    MAX_STEPS,
    Points,
    Tare,
    ThrusterLogs,
    flag_contradictions,
    levels_of,
    reduce_series,
    subtract_tare,
)
from automarine_cli.thrusters.curves import FORMS
from automarine_cli.thrusters.fit import MIN_LEVELS, BollardData, MapFit, Shape, bollard_data, fit_shape
from automarine_cli.thrusters.map import SIDES, THRUSTER_MAP, ThrusterMap
from automarine_cli.thrusters.selection import OPPOSITE, choose_form

MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median over that of a mean
CHANCE = 0.05  # that any of the thrusters of one make is told to differ
ZERO_SHARE = 1e-12  # errors below this share of full scale are zero
MIXED_SHARE = 0.2  # share of readings with thrust of either sign from which a direction is two directions
FAINT = 0.05  # thrust the wrong way that is smaller than this share of full scale is "none", not a sign error


@dataclass(frozen=True)
class Analysis:
    """What one set of points says of one thruster: the fits of all forms, the `chosen` one and why, the names of those
    within `reach` of the best, `without` why a direction has none; `spread` [N²] is the variance of the thrust."""

    points: Points
    full_scale: float
    without: dict[str, str]
    fits: tuple[MapFit, ...]
    chosen: MapFit
    because: str
    reach: frozenset[str]
    spread: float

    @property
    def law(self) -> MapFit:
        """The square law."""
        return self.fits[0]

    @property
    def square(self) -> dict[str, Estimate]:
        """Coefficient a of F = a |n| n (equation 2) by direction."""
        laws = {side: of["a"] for side, of in self.law.estimates.items()}
        return {side: law for side, law in laws.items() if isinstance(law, Estimate)}

    @property
    def n_unit(self) -> str:
        return self.chosen.data.n_unit

    def levels(self, side: str) -> int:
        n = self.law.data.n
        return len(np.unique(levels_of(np.abs(n[n * dict(SIDES)[side] > 0]))))

    @property
    def estimates(self) -> dict[tuple[str, str], Estimate | Given]:
        """The parameters that were fitted, by name and direction."""
        free = {side: self.chosen.form.free(curve) for side, curve in self.chosen.curves.items()}
        return {(key, side): of[key] for side, of in self.chosen.estimates.items() for key in free[side]}

    @property
    def map(self) -> ThrusterMap:
        return ThrusterMap(self.chosen.form.name, *self.chosen.both_ways, self.n_unit, self.points.n_range)

    def r2(self, fit: MapFit) -> float:
        """Coefficient of determination, weighted as in the fit."""
        return 1.0 - fit.rmse**2 / self.spread

    def over_all(self, fit: MapFit) -> float:
        """Root mean square error [N] of a form over all points, those that contradict their neighbours alike."""
        return float(np.sqrt(np.nanmean((self.points.force - fit.along(self.points.n)) ** 2)))

    def percent(self, value: float | None) -> float | None:
        if value is None:
            return None
        return 0.0 if value < ZERO_SHARE * self.full_scale else 100.0 * value / self.full_scale


def analyse(
    points: Points, tare_stderr: float, n_unit: str, forced: str | None = None, where: str = "the logs"
) -> Analysis:
    """Fit both directions of `points` (one thruster, tared, flagged).

    Raises FitError where no direction can be fitted: no thrust, thrust against the command, too few levels."""
    full_scale = points.full_scale
    if len(points) == 0 or full_scale == 0.0:
        check = "Check that the force column is the load cell's"
        raise FitError(f"{where}: every thrust is zero; expected pulls at several commands. {check}")
    data = bollard_data(points, tare_stderr, n_unit, [name for name, _ in SIDES])
    without = _refused_directions(data, full_scale, where)
    signs = {name: sign for name, sign in data.directions.items() if name not in without}
    if not signs:
        expected = f"expected at least {MIN_LEVELS} different commands in one direction. Pull at more levels"
        raise FitError(f"{where}: no direction can be fitted ({'; '.join(without.values())}); {expected}")
    used = points.where(np.isin(np.sign(points.n), [0.0, *signs.values()]))
    at_rest, total = used.where(used.n == 0.0), float(used.weight.sum())
    data = replace(
        data.where(np.isin(np.sign(data.n), [*signs.values()])),
        zero_squares=float(at_rest.weight @ at_rest.force**2), zero_weight=float(at_rest.weight.sum()),
    )  # fmt: skip
    fits = tuple(fit_shape(data, Shape.alike(form, signs)) for form in FORMS.values())
    spread = float(used.weight @ (used.force - float(used.weight @ used.force) / total) ** 2) / total
    return Analysis(points, full_scale, without, fits, *choose_form(fits, full_scale, forced), spread)


def _refused_directions(data: BollardData, full_scale: float, where: str) -> dict[str, str]:
    """Why a direction has no fit. Raises FitError where thrust opposes the command."""
    without, against, parts = dict[str, str](), [], data.parts(tied=False)
    for name, _ in SIDES:
        if name not in parts:
            without[name] = f"no {name} points"
            continue
        side = parts[name][1]
        n, thrust, count = side.n, side.force, len(np.unique(levels_of(side.n)))
        if min(np.mean(thrust > FAINT * full_scale), np.mean(thrust < -FAINT * full_scale)) > MIXED_SHARE:
            raise FitError(
                f"{where}: commands of one sign push both ways; the control signal looks counted from its "
                'end, not from rest, or without its sign. Write n = { from = "NAME", subtract = REST } (a pulse width '
                'rests at about 1500), or n = { from = "NAME", sign_from = "COLUMN" } where another column says the '
                "direction, under [columns] in the --columns file"
            )
        low, high, size = float(n.min()), float(n.max()), np.abs(thrust)
        if len(parts) == 1 and low > 0.5 * high and size.min() < FAINT * size.max():
            idle = usual_neutral(low, high, float(n[np.argmin(size)]))
            raise FitError(
                f"{where}: commands go from {low:.4g} to {high:.4g} and the thruster gives nothing at {idle:.4g}; the "
                'control signal looks counted from its end, not from rest. Write n = { from = "NAME", subtract = '
                f"{idle:.4g} }} under [columns] in the --columns file"
            )
        mean = float((side.weight * n**2) @ thrust / (side.weight @ n**2))
        if count < MIN_LEVELS:
            without[name] = f"{count} {name} level{'s' if count > 1 else ''}, at least {MIN_LEVELS} needed"
        elif -FAINT * full_scale <= mean <= 0.0:
            without[name] = f"no {name} thrust measured"
        elif mean < 0.0:
            against.append(name)
    if against and set(against) == set(parts) - set(without):
        raise FitError(f"{where}: {OPPOSITE}")
    if against:
        raise FitError(
            f"{where}: {against[0]} thrust has the sign of the other direction; it looks logged as a "
            'magnitude. Write force_N = { from = "NAME", sign_from = "COLUMN" } with a column that says the direction '
            "under [columns] in the --columns file, or give thrust astern a minus sign in the log"
        )
    return without


def _difference(law: Estimate, references: Sequence[Estimate]) -> tuple[float | None, float | None]:
    """Difference from the references' median [percent], and the chance of one as large; standard errors are widened for
    few levels as the 95 % intervals are."""
    if not references:
        return None, None
    error, *errors = (float(np.ptp(x.ci95) / (2.0 * special.ndtri(0.975))) for x in (law, *references))
    middle = float(np.median([other.value for other in references]))
    spread = np.hypot(error, MEDIAN * np.median(errors) / np.sqrt(len(errors)))
    gap = law.value - middle
    return 100.0 * gap / middle, float(2.0 * special.ndtr(-abs(gap) / max(spread, 1e-300)))


ONE_PULLED = (
    "One thruster is taken to have pulled in each test, as nothing else was said; if two pulled together, give "
    "--thrusters-per-test 2 (thrusters_per_test=2)."
)


@dataclass(frozen=True, repr=False)
class ThrusterFit(Shown):
    """A thruster map from bollard tests. `map` is the map, `analysis` the fit of all `points`, `compared` the forms of
    curves by their errors at levels left out, `voltages` the fits of each voltage step, `exponents` what thrust does
    with voltage. `logs` are the tests, `samples` counts their rows, `tare` is what was subtracted,
    `thrusters_per_test` how many pulled together, `notes` say how the data were treated, `place(index)` where a
    point is from. `parts` are the fits of each thruster by itself where a column names them, `without_map` why one
    has none. `to_json()` is thrusters.json.

    Frame, a row per parameter and direction: `direction`, `form`, `parameter`, `value`, `stderr`, `low`, `high`,
    `unit`.

    Keys: `schema`, `forward`, `backward`, `per_test`, `thrusters_per_test`, `r2`, `rmse_N`,
    `rmse_percent_of_full_scale`, `rmse_all_points_N`, `cv_rmse_N`, `full_scale_N`, `forms`, `form`, `chosen_because`,
    `chosen`, `parameters`, `beyond_n_range`, `n_unit`, `n_range`, `tare`, `points`, `flagged`, `notes`, `runs`.
    """

    logs: ThrusterLogs
    analysis: Analysis
    tare: Tare
    thrusters_per_test: int
    voltages: tuple[tuple[float, Analysis], ...]
    exponents: dict[str, Estimate]
    notes: tuple[str, ...]
    parts: Mapping[str, "ThrusterFit"] = field(default_factory=dict)
    without_map: Mapping[str, str] = field(default_factory=dict)

    @property
    def map(self) -> ThrusterMap:
        return self.analysis.map

    @cached_property
    def compared(self) -> list[dict[str, Any]]:
        """Each thruster against the median of the others, which one that differs does not move, as files have it; it
        `differs` beyond chance over all thrusters and directions together (Bonferroni). One without a map says `why`.
        """
        laws = {name: part.analysis.square for name, part in self.parts.items()}
        rows: list[dict[str, Any]] = []
        for name in self.logs.parts:
            if name in self.without_map:
                rows.append({"thruster": name, "why": self.without_map[name]})
            if name not in laws:
                continue
            analysis, sides, p_values = self.parts[name].analysis, dict[str, object](), []
            for side, law in laws[name].items():
                references = [of[side] for other, of in laws.items() if other != name and side in of]
                percent, p_value = _difference(law, references)
                p_values += [] if p_value is None else [p_value]
                sides[side] = {"a": law.to_json(), "differs_percent": percent, "p_value": p_value}
            rows.append({
                "thruster": name, "points": len(analysis.points), "form": analysis.chosen.form.name,
                "rmse_percent_of_full_scale": analysis.percent(analysis.chosen.error),
                "differs": min(p_values, default=1.0) < CHANCE / sum(map(len, laws.values())), **sides,
            })  # fmt: skip
        return rows

    @property
    def samples(self) -> dict[str, int]:
        """How many samples came down to how many plateaus, and how many were left out: of transients, spikes and
        commands that were held too shortly."""
        count = sum(len(record.n) for record in self.logs.records)
        plateaus, used = int(np.count_nonzero(self.points.raw)), int(self.points.count.sum())
        return {"plateaus": plateaus, "samples": count, "samples_left_out": count - used}

    @property
    def points(self) -> Points:
        return self.analysis.points

    def place(self, index: int) -> str:
        return self.logs.records[int(self.points.record[index])].place

    def document(self, option: str) -> Document:
        return json_document("thrusters.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        analysis, points, records = self.analysis, self.points, self.logs.records
        laws, count = {side: analysis.square.get(side) for side, _ in SIDES}, self.thrusters_per_test
        result: dict[str, object] = {
            "schema": THRUSTER_MAP.schema,
            **_square_json(analysis),
            "per_test": {side: {"a": law and law.scaled(count, law.unit).to_json()} for side, law in laws.items()},
            "thrusters_per_test": self.thrusters_per_test,
            **_scores_json(analysis),
            "n_unit": analysis.n_unit,
            **({} if points.n_range is None else {"n_range": list(points.n_range)}),
            "tare": vars(self.tare),
            "points": {"used": len(points), **self.samples, "rows_with_missing_values": self.logs.missing},
            "flagged": [
                {
                    "file": records[points.record[i]].source, "run": records[points.record[i]].run,
                    "n": float(points.n[i]), "force_N": float(points.force[i]), "weight": float(points.weight[i]),
                    "why": str(points.flag[i]),
                }
                for i in np.flatnonzero(points.flag != "")
            ],
        }  # fmt: skip
        if np.any(np.isfinite(points.voltage)):
            result["voltage_range_V"] = [float(np.nanmin(points.voltage)), float(np.nanmax(points.voltage))]
        if self.voltages:
            result["voltages"] = [
                {"voltage_V": volts, **_square_json(a), **_scores_json(a)} for volts, a in self.voltages
            ]
            result["voltage_exponent"] = {
                side: {"thrust_at_fixed_n": power.to_json()} for side, power in self.exponents.items()
            }
        if self.compared:
            result["by"] = {"column": self.logs.by, "thrusters": self.compared}
        return {**result, "notes": list(self.notes), "runs": runs_json(self.logs.used, self.logs.set_aside)}


def _square_json(analysis: Analysis) -> dict[str, object]:
    """`forward` and `backward`: equation 2's coefficient; null with a why where not measured."""
    laws = analysis.square
    return {
        side: {
            "a": laws[side].to_json() if side in laws else None,
            "points": int(np.count_nonzero(analysis.points.n * sign > 0)),
            "levels": analysis.levels(side),
            **({"why": analysis.without[side]} if side in analysis.without else {}),
        }
        for side, sign in SIDES
    }


def _scores_json(analysis: Analysis) -> dict[str, object]:
    """The square law's scores, all forms side by side, the chosen one and why."""
    chosen = analysis.chosen

    def errors(score: MapFit) -> dict[str, object]:
        return {
            "r2": analysis.r2(score), "rmse_N": score.rmse, "rmse_percent_of_full_scale": analysis.percent(score.rmse),
            "rmse_all_points_N": analysis.over_all(score), "cv_rmse_N": score.cv_rmse,
        }  # fmt: skip

    forms = [
        {
            "form": score.form.name, "equation": score.form.equation,
            "parameters_per_direction": score.parameters, "cv_rmse_N": score.cv_rmse,
            "cv_rmse_between_levels_N": score.between_rmse, "rmse_N": score.rmse,
            "within_reach_of_best": score.form.name in analysis.reach,
            "at_bound": {name: list(bound) for name, bound in score.at_bound.items() if bound},
        }
        for score in analysis.fits
    ]  # fmt: skip
    return {
        **errors(analysis.law),
        "full_scale_N": analysis.full_scale,
        "forms": forms,
        "form": chosen.form.name,
        "chosen_because": analysis.because,
        "chosen": {
            "form": chosen.form.name,
            **errors(chosen),
            "error_percent_of_full_scale": analysis.percent(chosen.error),
        },
        "parameters": chosen.parameters_json(),
        "beyond_n_range": chosen.form.beyond,
    }


STRONG = 0.2  # share of the largest thrust from which readings tell whether a command always gives the same
APART = 0.3  # share of a thrust by which readings at one command differ where something else changed
UNUSED = "The supply voltage is not used: it is not at every point, or drifts without steps."
ALIKE = 0.7  # cosine between force and squared command from which they have one sign
FELT = 0.2  # exponent of thrust against voltage from which one map for all voltages misleads


def fit_records(
    loaded: ThrusterLogs, thrusters: int, n_unit: str, form: str | None, jobs: int, progress: Progress
) -> ThrusterFit:
    """The map of one thruster from tests in which `thrusters` equal ones pulled; `form` None chooses by
    cross-validation, `n_unit` is the control signal's. Raises FitError where no direction can be fitted."""
    where = loaded.inputs[0].name if len(loaded.inputs) == 1 else f"{len(loaded.inputs)} logs"
    logged, unsettled = reduce_series(loaded.records, thrusters)
    _refuse_mirrored(loaded, logged, where)
    notes = _differ(loaded, logged, thrusters, where)
    points, notes = (logged, notes) if notes else _flagged(loaded, logged)
    points, tare = subtract_tare(points)
    try:
        analysis = analyse(points, tare.thrust_stderr, n_unit, form, where)
    except FitError as refusal:
        raise _with_rest(refusal, logged, thrusters, loaded.rule) from None
    notes += unsettled
    if not points.steps and np.any(np.isfinite(points.voltage)):
        notes += (UNUSED,)
    groups = [points.where(points.step == number) for number in points.steps]
    judge = partial(_one_voltage, tare_stderr=tare.thrust_stderr, n_unit=n_unit, form=form)
    outcomes = ordered_map(judge, groups, jobs, progress=progress, stage="voltages") if groups else []
    notes += tuple(f"No map at this voltage: {refusal}." for refusal in outcomes if isinstance(refusal, FitError))
    voltages = tuple(outcome for outcome in outcomes if not isinstance(outcome, FitError))
    data, exponents = analysis.chosen.data, dict[str, Estimate]()
    for side, sign in data.directions.items() if len(voltages) > 1 else ():
        if (part := data.where(data.n * sign > 0)).by_voltage:
            shape = Shape(((side, analysis.chosen.form),), voltage=True)
            exponents[side] = fit_shape(part, shape).voltage_power
    powers = [power.value for power in exponents.values()]
    if max(map(abs, powers), default=0.0) > FELT:
        notes += (
            f"Thrust at the same control signal grows with the voltage to the power {np.mean(powers):.2f}: "
            "the map over all voltages is a mean; for a known voltage use that voltage's map.",
        )
    parts, without_map = dict[str, ThrusterFit](), dict[str, str]()
    for name in loaded.parts if loaded.split else ():
        try:
            parts[name] = fit_records(loaded.of(name), thrusters, n_unit, form, 1, silent)
        except FitError as refusal:
            without_map[name] = str(refusal)
    return ThrusterFit(loaded, analysis, tare, thrusters, voltages, exponents, notes, parts, without_map)


def _one_voltage(
    points: Points, *, tare_stderr: float, n_unit: str, form: str | None
) -> tuple[float, Analysis] | FitError:
    volts = float(np.median(points.voltage))
    try:
        return volts, analyse(points, tare_stderr, n_unit, form, f"{volts:.4g} V")
    except FitError as refusal:
        return refusal


def _refuse_mirrored(loaded: ThrusterLogs, points: Points, where: str) -> None:
    """Raise FitError where some of several thrusters push against their command and others with it."""
    part, square = np.array([record.part for record in loaded.records])[points.record], points.n * np.abs(points.n)
    ways = {
        name: float(square[part == name] @ points.force[part == name])
        / (np.linalg.norm(square[part == name]) * np.linalg.norm(points.force[part == name]) + 1e-300)
        for name in loaded.parts
    }
    mirrored = [name for name, way in ways.items() if way < -ALIKE]
    if mirrored and max(ways.values()) > ALIKE:
        rule = loaded.command
        sign = f'{{ from = "{rule.source}", subtract = {rule.subtract:g} }}' if rule.subtract else f'"{rule.source}"'
        raise FitError(
            f"{where}: the force of {listed(mirrored)} is opposite to its command, unlike that of the others; it is "
            'logged or mounted the other way round. Write force_N = { from = "NAME", sign_from = '
            f"{sign} }} under [columns] in the --columns file, so that each force has the sign of its command"
        )


def _differ(loaded: ThrusterLogs, points: Points, thrusters: int, where: str) -> tuple[str, ...]:
    """What to know where one command gave very different thrusts. Raises FitError where a column may be the supply."""
    if np.any(np.isfinite(points.voltage)) or len(loaded.parts) > 1:
        return ()
    level, size = levels_of(points.n), np.abs(points.force)
    ends = []
    for number in np.unique(level[size > STRONG * size.max(initial=0.0)]):
        force = points.force[level == number]
        if len(force) > 1 and not np.any(points.raw[level == number]):
            ends.append((float(np.ptp(force)) / float(np.abs(force).max()), int(number)))
    if len(ends) < MIN_LEVELS or np.median([apart for apart, _ in ends]) < APART:
        return ()
    _, number = max(ends)
    at, force = float(np.mean(points.n[level == number])), thrusters * points.force[level == number]
    text = f"the same command {at:.4g} gave {force.min():.3g} to {force.max():.3g} N"
    extras = {name: np.concatenate([r.extras[name] for r in loaded.records]) for name in loaded.records[0].extras
              if all(name in r.extras for r in loaded.records)}  # fmt: skip
    varied = [name for name, values in extras.items() if np.nanmin(values) < (1.0 - APART) * np.nanmax(values)]
    called = next((name for name in varied if is_called("voltage", [name])), None)
    if (supply := called or likely_column("voltage", varied)) is not None:
        low, high = np.nanmin(extras[supply]), np.nanmax(extras[supply])
        raise FitError(
            f"{where}: {text}; does {supply} ({low:.4g} to {high:.4g}) hold the supply? Then write "
            f'voltage_V = "{supply}" under [columns] in a file and give it with --columns FILE.toml'
        )
    return (f"{text[0].upper()}{text[1:]}: something else changed between tests, and the map is a mean over that.",)


def _with_rest(refusal: FitError, points: Points, thrusters: int, rule: ColumnRule) -> FitError:
    """A refusal, and the force at zero command where that is none: then the sensor has an offset."""
    at_zero = points.force[points.n == 0.0]
    if not len(at_zero) or abs(float(np.median(at_zero))) <= STRONG * np.ptp(points.force):
        return refusal
    force = thrusters * float(np.median(at_zero))
    offset = rule.subtract + force / (rule.sign * rule.scale)
    return FitError(
        f"{str(refusal).partition(';')[0]}; the force at command 0 is {force:.4g} N, which looks like the offset of "
        f"the load cell. Write subtract = {offset:.4g} in the line of the force under [columns] in the --columns file"
    )


def _flagged(loaded: ThrusterLogs, points: Points) -> tuple[Points, tuple[str, ...]]:
    """Points with contradictions flagged, each thruster's among themselves: where a column names thrusters and nobody
    asked for them, if that leaves fewer, which is then told."""
    if len(loaded.parts) < 2:
        return flag_contradictions(points), ()
    names = ("", *loaded.parts)
    part = np.array([names.index(record.part) for record in loaded.records])[points.record]
    apart = flag_contradictions(points, part * (MAX_STEPS + 1) + points.step)
    if loaded.split:
        return apart, ()
    pooled = flag_contradictions(points)
    before, after = (int(np.count_nonzero(flagged.flag != "")) for flagged in (pooled, apart))
    if before <= after:
        return pooled, ()
    note = (
        f"The column {loaded.by} names {len(loaded.parts)} parts ({listed(loaded.parts)}): taken together {before} of "
        f"{len(points)} points contradict their neighbours, each by itself {after}. They may be thrusters that differ: "
        f'write by = "{loaded.by}" under [columns] in a file and give it with --columns FILE.toml for a map of each.'
    )
    return apart, (note,)
