"""The diagnosis of a thruster map on bollard tests: its gap by regions, what is missing, how sure that is."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from automarine_cli.diagnosis.diagnose import NamedEffect, diagnosis_json, listed_rivals
from automarine_cli.diagnosis.residual_regions import Factor, Gap, ResidualGrid, ResidualRegions, find_regions, stretch
from automarine_cli.diagnosis.verdict import ASTRAY, LEFT_OVER, NAMED, NOTHING, SUSPECTED, TIE_WEIGHT, UNEXPLAINED
from automarine_cli.errors import FitError, RunError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.fits.stepwise import NamedRival
from automarine_cli.pipeline.records import Shown
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ExcludedRun, runs_json
from automarine_cli.thrusters import selection
from automarine_cli.thrusters.bollard_data import Ints, ThrusterLogs
from automarine_cli.thrusters.curves import EFFECT_PARAMETERS, FORMS
from automarine_cli.thrusters.fit import ASYMMETRY, SAG, VOLTAGE, BollardData, MapFit, Shape
from automarine_cli.thrusters.map import SIDES, ThrusterMap

MIN_FLOOR_RATIO = 1.5
"""Residual over the noise level from which a map may lack something; the floor itself is known to some 20 %."""
MATERIAL = 0.005  # share of full scale below which what remains is not worth a verdict: bollard tests repeat no better
STRUCTURED, THROWS = 0.01, 999
SWEEP = 0.98  # correlation of run order and command from which they are the same variable
THRUST_SAYS = {
    "dead-band": "The thruster gives nothing below a smallest command",
    "thrust-exponent": "Thrust grows with another power of the command than the map's",
    "saturation": "Thrust stops rising above a largest command",
    ASYMMETRY: "At full command the thruster pulls differently forward and backward",
    VOLTAGE: "Thrust at the same command follows the supply voltage",
    SAG: "Thrust falls from the first reading to the last, as with a battery that empties",
}
THRUST_SPLIT_BY = {
    SAG: "the first command repeated last: a sag shows as less thrust at the same command",
    VOLTAGE: "three commands repeated at another voltage",
    ASYMMETRY: "pulls at the same commands forward and backward, five times each",
}


@dataclass(frozen=True, repr=False)
class ThrusterDiagnosis(Shown):
    """What a diagnosis of a thruster map found: its `verdict` and `why`, the `effects` named or suspected, `where` the
    map errs, and `faults` of the data.

    `given` is the map diagnosed, `given_rmse` its error, `data` every point, `base` the fit before (`base.data` are the
    points fitted), `held_out` the rest, None where levels are too few; `search` is how effects were looked for. `final`
    is the extended model: the base refitted unless effects are named, and `extended_map` the file that it makes. Errors
    are in newtons of one thruster: `gap` of the points fitted, `held_out_gap` of the rest, `cross` by leaving out
    levels; `decisive_gap` is the one that decides, `floor_from` says what the noise is from. `set_aside` are the tests
    left out. `to_json()` is diagnosis.json.

    Frame, a row per effect and parameter: `effect`, `confidence`, `parameter`, `value`, `stderr`, `low`, `high`,
    `unit`.

    Keys: `schema`, `model`, `verdict`, `effects`, `where`, `gap`, `faulty`, `candidates`, `threshold`,
    `full_scale_N`, `noise_floor_from`, `levels`, `runs`.
    """

    verdict: str
    why: str
    given: ThrusterMap
    data: BollardData
    held_out: BollardData | None
    search: selection.MapSearch
    final: MapFit
    effects: tuple[NamedEffect, ...]
    where: ResidualRegions
    faults: tuple[dict[str, Any], ...]
    gap: Gap
    held_out_gap: Gap | None
    cross: Gap
    given_rmse: float
    floor_from: str
    set_aside: tuple[ExcludedRun, ...] = ()

    @property
    def base(self) -> MapFit:
        return self.search.looks[0].before.fit

    @property
    def extended_map(self) -> dict[str, object]:
        """Content of extended_model.json: a thruster map (schema automarine/thruster-map/1)."""
        final = self.final
        result = ThrusterMap(final.form.name, *final.both_ways, self.data.n_unit, self.data.n_range).to_json()
        result["parameters"] = final.parameters_json()
        names = ", ".join(effect.name for effect in self.effects) if self.verdict == NAMED else ""
        notes = [f"The {self.given.form} map refitted" + (f", with {names} added." if names else ".")]
        if final.shape.voltage:
            volts, power = f"{final.reference:.4g}", f"{final.power:.3g}"
            notes.append(f"Thrust holds at {volts} V; at another voltage V multiply it by (V/{volts})^{power}.")
            result["voltage_exponent"] = {"p": final.power, "reference_V": final.reference}
        if final.shape.sag:
            notes.append("Thrust holds at the first reading, before the supply sagged.")
        scores = {"rmse_N": self.gap.after, "cv_rmse_N": self.cross.after, "full_scale_N": self.data.full_scale}
        return {**result, **scores, "notes": notes}

    def to_json(self) -> dict[str, object]:
        gaps = {"fitted_runs": self.gap, "held_out_runs": self.held_out_gap, "cross_validation": self.cross}
        first = self.search.looks[0]
        of = {"model": "thruster-map", "verdict": self.verdict}
        return {
            **diagnosis_json(of, self.why, self.effects, self.where, gaps, "N"),
            "faulty": list(self.faults),
            "candidates": [
                {
                    "name": candidate.effect, "where": candidate.where, "gain": candidate.gain,
                    "p_value": candidate.p_value, "cv_rmse_N": candidate.fit.left_out_rmse,
                }
                for candidate in sorted(first.candidates, key=lambda candidate: -candidate.gain)
            ],
            "threshold": first.threshold,
            "full_scale_N": self.data.full_scale,
            "noise_floor_from": self.floor_from,
            "levels": {"fitted": self.base.data.levels, "held_out": self.held_out.levels if self.held_out else 0},
            "runs": runs_json(len(np.unique(self.data.record)), self.set_aside),
        }  # fmt: skip


def start_shape(base: ThrusterMap, data: BollardData, voltage: bool = False) -> Shape:
    """Make a shape of the base map in the directions measured, tied where both curves are equal, each with the effects
    that its curve makes use of: a map may have been extended in one direction only."""
    tied = base.forward == base.backward and len(data.directions) == 2
    curves = {"both": base.forward} if tied else {name: getattr(base, name) for name in data.directions}
    forms = tuple((name, FORMS[base.form].used_by(curve)) for name, curve in curves.items() if curve is not None)
    return Shape(forms, voltage and data.by_voltage)


def diagnose_thrusters(
    logs: ThrusterLogs, base: ThrusterMap, *, hold_out: ThrusterLogs | None = None, thrusters: int = 1,
    n_unit: str = "", voltage: bool = False, seed: int = 0,
) -> ThrusterDiagnosis:  # fmt: skip
    """Diagnose `base` on bollard tests in which `thrusters` equal thrusters pulled together.

    `hold_out` None holds out a quarter of the levels; `voltage` says that the map was made with a power of the voltage.
    Raises FitError where the logs cannot carry a curve, RunError where the control signal is in another unit."""
    if base.n_unit and n_unit and base.n_unit != n_unit:
        raise RunError(
            f"the map's control signal is in {base.n_unit}, the logs' in {n_unit}; give logs and map of one signal"
        )
    sides = [name for name, _ in SIDES if getattr(base, name) is not None]
    data = selection.data_of_logs(logs, thrusters, n_unit or base.n_unit, sides)
    out = selection.held_out_levels(data, seed) & (hold_out is None)
    held_out = data.where(out) if np.any(out) else None
    if hold_out is not None:
        try:
            held_out = selection.data_of_logs(hold_out, thrusters, data.n_unit, data.directions, min_levels=1)
        except FitError:
            raise FitError(
                "the logs held out have no command in a direction that was fitted; hold out logs like those fitted"
            ) from None
    floor, floor_from = selection.noise_level(data)
    fitted = data.where(~out)
    search = selection.search_around_faults(fitted, start_shape(base, fitted, voltage), floor, seed)
    before, after = search.looks[0].before.fit, search.final.fit
    fitted, where = before.data, _regions(before, floor, seed)

    def gap(fit: MapFit) -> Gap | None:
        if held_out is None:
            return None
        return Gap(_rms(held_out, before.thrust(held_out)), _rms(held_out, fit.thrust(held_out)), floor)

    effects = _named_effects(search, floor)
    verdict, why = _verdict(before, search.final, effects, where, gap(after), floor, seed)
    final = after if verdict == NAMED else before
    data = data.with_flags(~out, fitted.weight, fitted.flag)
    return ThrusterDiagnosis(
        verdict, why, base, data, held_out, search, final, effects if verdict in (NAMED, SUSPECTED) else (), where,
        _faults(data, final), Gap(before.rmse, final.rmse, floor), gap(final),
        Gap(before.left_out_rmse, final.left_out_rmse, floor),
        _rms(fitted, base.force(fitted.n)), floor_from, logs.set_aside,
    )  # fmt: skip


def _rms(data: BollardData, thrust: Floats) -> float:
    """Root mean square residual [N] of a thrust at the points, weighted as in the fit."""
    return float(np.sqrt(np.average((data.force - thrust) ** 2, weights=data.weight)))


def _verdict(
    base: MapFit, final: selection.MapTrial, effects: tuple[NamedEffect, ...], where: ResidualRegions,
    held_out: Gap | None, floor: float, seed: int,
) -> tuple[str, str]:  # fmt: skip
    """What may be said, and why no more: the rules of the diagnosis of a motion, with levels for runs."""
    scale, fit = base.data.full_scale, final.fit
    floor = max(floor, 1e-9 * scale)
    before, after = (max((fit.rmse / floor) ** 2 - 1.0, 0.0) for fit in (base, fit))
    well_above = fit.rmse > max(MIN_FLOOR_RATIO * floor, MATERIAL * scale)
    names = " and ".join(final.added)
    if well_above and after > LEFT_OVER * before and _neighbours_p_value(fit, seed) <= STRUCTURED:
        best = "No effect of the library gains more than chance."
        if names:
            sizes = f"{fit.rmse:.3g} instead of {base.rmse:.3g} N"
            best = f"The best candidate is {names}, with which the residual is {sizes}."
        times = f"The residual is correlated along the control signal and is {fit.rmse / floor:.2f} times"
        return UNEXPLAINED, f"{times} the noise. {best}"
    if names and held_out is not None and held_out.after > ASTRAY * max(held_out.before, floor):
        return UNEXPLAINED, f"What explains the fitted levels ({names}) makes the held-out levels worse."
    if not names and where.regions and base.rmse > MATERIAL * scale:
        return UNEXPLAINED, f"The error is beyond chance {stretch(where.regions[0])}."
    if not names:
        return NOTHING, ""
    tied = next((effect for effect in effects if effect.confidence < TIE_WEIGHT), None)
    if tied is not None:
        alternatives = " or ".join(rival.name for rival in tied.rivals)
        share = f"{100 * tied.confidence:.0f} %"
        return SUSPECTED, f"A tie: the levels do not tell {tied.name} ({share}) from {alternatives}."
    return NAMED, ""


def _neighbours_p_value(fit: MapFit, seed: int) -> float:
    """p-value of neighbouring levels' residuals being alike: products of neighbours, against signs thrown."""
    data, random = fit.data, np.random.default_rng(seed)
    order = np.lexsort((data.n, np.sign(data.n), data.step))
    residual = (np.sqrt(data.weight) * fit.residual)[order]
    together = residual[1:] * residual[:-1]
    signs = random.choice([-1.0, 1.0], size=(THROWS, len(together)))
    return float((1.0 + np.sum(signs @ together >= together.sum())) / (1.0 + THROWS))


def _named_effects(search: selection.MapSearch, floor: float) -> tuple[NamedEffect, ...]:
    effects = []
    for name, p_value in search.final.added.items():
        odds = [
            NamedRival(rival, chance, _split_by(search.final.fit, name, candidate, floor))
            for rival, (candidate, chance) in selection.rivals_of(search, name).items()
        ]
        weight, rivals = listed_rivals(odds, 1.0 - p_value)
        values = effect_parameters(search.final.fit, name, search.looks[0].before.fit)
        effects.append(NamedEffect(name, "", f"{THRUST_SAYS[name]}.", values, weight, p_value, rivals))
    return tuple(effects)


def _split_by(fit: MapFit, effect: str, rival: selection.MapTrial, floor: float) -> str:
    """The pull that tells the named effect from its rival: where both fitted curves differ most."""
    for name in (rival.effect, effect):
        if name in THRUST_SPLIT_BY:
            return THRUST_SPLIT_BY[name]
    n = fit.data.n
    along = np.linspace(min(float(n.min()), 0.0), max(float(n.max()), 0.0), 801)
    mine, other = (np.nan_to_num(curves.along(along)) for curves in (fit, rival.fit))
    at = int(np.argmax(np.abs(mine - other)))
    apart_N = max(abs(float(mine[at] - other[at])), 1e-12)
    times = int(np.ceil((3.0 * floor / apart_N) ** 2))
    often = f"{times} pulls" if times > 1 else "a pull"
    thrusts = f"{mine[at]:.3g} N with {effect}, {other[at]:.3g} N with {rival.effect}"
    return f"{often} at n = {along[at]:.3g}: {thrusts}"


def effect_parameters(fit: MapFit, effect: str, base: MapFit) -> dict[str, Estimate | Given]:
    """Estimate the parameters of one effect; that of one direction says so in its name."""
    data = fit.data
    if effect == VOLTAGE:
        return {"p": fit.voltage_power}
    if effect == SAG:
        return {"share_lost": Estimate.from_stderr(fit.sag, *fit.stderr(fit.multipliers[:, 1]), "1")}
    if effect == ASYMMETRY:
        sides = [np.where(data.n * sign > 0, fit.predicted, 0.0) for sign in (1.0, -1.0)]
        ends = [fit.along(np.array([sign * np.max(np.abs(data.n))]))[0] for sign in (1.0, -1.0)]
        relative = float(np.linalg.norm([fit.stderr(side)[0] for side in sides]))
        dof = min(int(np.count_nonzero(side)) for side in sides) - 1
        return {"backward_over_forward": Estimate.from_log(float(abs(ends[1] / ends[0])), relative, dof, "1")}
    name = EFFECT_PARAMETERS[effect]
    return {
        name + ("" if where == "both" else f"_{where}"): fit.estimates[where][name]
        for where, form in fit.shape.forms
        if effect in form.effects - base.shape.effects_at(where)
    }  # fmt: skip


def _regions(fit: MapFit, floor: float, seed: int) -> ResidualRegions:
    """Regions in which the residuals of a fit stand out against dealing the points in another order."""
    data, count = fit.data, len(fit.data)
    if not np.any(np.abs(fit.residual) > 1e-9 * data.full_scale):
        return ResidualRegions()
    columns = [Factor("n", data.n_unit, data.n)]
    if data.by_voltage:
        columns.append(Factor("voltage", "V", data.voltage))
    if abs(np.corrcoef(data.order, data.n)[0, 1]) < SWEEP:
        columns.append(Factor("run-order", "", np.arange(1.0, count + 1.0)))
    residual = (np.sqrt(data.weight) * fit.residual)[:, None]
    sign = np.sign(data.n)[:, None]
    gap = ResidualGrid(
        names=tuple(data.place(i) for i in range(count)), residual=residual, raw=residual, sign=sign,
        observed=np.ones((count, 1), bool), gain=residual[:, 0], floor=floor, gain_unit="N",
    )  # fmt: skip
    return find_regions(columns, {}, gap, seed)


def _faults(data: BollardData, fit: MapFit) -> tuple[dict[str, Any], ...]:
    """Stretches of the data that are not to be trusted, the worst first."""
    flagged = np.flatnonzero(data.flag != "")
    new = (np.diff(flagged) > 1) | (np.diff(data.record[flagged]) != 0)
    faults = [_fault(data, fit, index) for index in np.split(flagged, np.flatnonzero(new) + 1) if len(index)]
    return tuple(sorted(faults, key=lambda fault: -float(fault["gap_N"])))


def _fault(data: BollardData, fit: MapFit, index: Ints) -> dict[str, Any]:
    """One stretch as files have it; readings are counted from 1 in each record."""
    n, place = data.n[index], data.place(int(index[0]))
    record = np.flatnonzero(data.record == data.record[index[0]])
    first, last = (int(np.searchsorted(record, index[end])) + 1 for end in (0, -1))
    gap = float(np.sqrt(np.mean((data.force[index] - fit.thrust(data)[index]) ** 2)))
    low, high = float(n.min()), float(n.max())
    several = f"{len(index)} readings from n = {low:.4g} to {high:.4g}"
    description = several if len(index) > 1 else f"1 reading at n = {low:.4g}"
    return {
        "file": place, "readings": [first, last], "from_n": low, "to_n": high, "points": len(index), "gap_N": gap,
        "says": f"{place}: {description}: {data.flag[index[0]]}.",
    }  # fmt: skip
