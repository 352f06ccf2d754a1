"""A whole diagnosis of a thruster map: base refitted, effects searched, gap on levels fitted and held out, verdict."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.errors import FitError, RunError
from automarine_cli.quantities import Floats
from automarine_cli.results.kinds import DIAGNOSIS
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.run import SetAside
from automarine_cli.thrusters.bollard_data import BollardData, bollard_data, held_out_levels, noise_level
from automarine_cli.thrusters.forms import SIDES, SQUARE, Curve
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.thrusters.records import ThrusterLogs
from automarine_cli.thrusters.result import parameters_json
from automarine_cli.thrusters.search import Round, Search, Trial, search_around_faults
from automarine_cli.thrusters.shapes import Fitted, Shape, effects_of, form_of
from automarine_cli.thrusters.verdict import Named, curve_parameters, named_effects, verdict_of
from automarine_cli.thrusters.where import Fault, Region, faults, regions


@dataclass(frozen=True)
class ThrusterGap:
    """Root mean square of measured less fitted thrust [N] of one thruster: base, extended, noise level."""

    before: float
    after: float
    floor: float

    def to_json(self) -> dict[str, float]:
        """The contract's form, in newtons."""
        return {"before_N": self.before, "after_N": self.after, "noise_floor_N": self.floor}


@dataclass(frozen=True, repr=False)
class ThrusterDiagnosis(Shown):
    """What the diagnosis of a thruster map found.

    `data` holds every point, `search.base.data` those fitted, `held_out` the rest (None where too few levels were
    there to hold any out). `final` is the extended model: the base refitted unless effects are named. `closest` is the
    effect that an unexplained gap resembles most, which is not a name for it. `cross` is the gap by leaving out
    levels; `smallest` the smallest size of each effect that these levels would have shown.
    """

    verdict: str
    given: ThrusterMap
    data: BollardData
    held_out: BollardData | None
    search: Search
    final: Fitted
    effects: tuple[Named, ...]
    closest: str | None
    where: tuple[Region, ...]
    faults: tuple[Fault, ...]
    gap: ThrusterGap
    held_out_gap: ThrusterGap | None
    cross: ThrusterGap
    given_rmse: float
    floor_from: str
    smallest: dict[str, float | None]
    set_aside: tuple[SetAside, ...] = ()

    @property
    def base(self) -> Fitted:
        """The map given, its form refitted on the fitted levels."""
        return self.search.base

    def percent(self, value: float) -> float:
        """Newtons as a percentage of full scale."""
        return 100.0 * value / self.data.full_scale

    @property
    def extended_map(self) -> dict[str, object]:
        """Content of extended_model.json: a thruster map (schema automarine/thruster-map/1)."""
        found = self.final
        form = form_of(frozenset().union(*(effects for _, effects in found.shape.curves))).name
        result = ThrusterMap(form, *found.both_ways, self.data.n_unit, self.data.points.n_range).to_json()
        estimates = curve_parameters(found)
        result["parameters"] = {name: parameters_json(estimates.get(name)) for name in ("forward", "backward")}
        result |= {
            "rmse_N": self.gap.after,
            "cv_rmse_N": self.cross.after,
            "full_scale_N": self.data.full_scale,
            "notes": list(self._notes()),
        }
        if found.shape.voltage:
            result["voltage_exponent"] = {"p": found.power, "reference_V": found.reference}
        return result

    def _notes(self) -> tuple[str, ...]:
        names = ", ".join(effect.name for effect in self.effects)
        notes = [f"The {self.given.form} map refitted" + (f", with {names} added." if names else ".")]
        if self.final.shape.voltage:
            notes.append(
                f"Thrust holds at {self.final.reference:.4g} V; at another voltage V multiply it by "
                f"(V/{self.final.reference:.4g})^{self.final.power:.3g}."
            )
        if self.final.shape.sag:
            notes.append("Thrust holds at the first reading, before the supply sagged.")
        return tuple(notes)

    def to_json(self) -> dict[str, object]:
        """Content of diagnosis.json (schema automarine/diagnosis/1)."""
        held = self.held_out_gap
        return {
            "schema": DIAGNOSIS.schema,
            "model": "thruster-map",
            "verdict": self.verdict,
            "effects": [effect.to_json() for effect in self.effects],
            "closest": self.closest,
            "where": [region.to_json() for region in self.where],
            "faulty": [fault.to_json() for fault in self.faults],
            "gap": {
                "fitted_runs": self.gap.to_json(),
                "held_out_runs": None if held is None else held.to_json(),
                "cross_validation": self.cross.to_json(),
            },
            "full_scale_N": self.data.full_scale,
            "noise_floor_from": self.floor_from,
            "model_as_given_N": self.given_rmse,
            "levels": {
                "fitted": self.base.data.levels,
                "held_out": 0 if self.held_out is None else self.held_out.levels,
            },
            "smallest_detectable": self.smallest,
            "candidates": [
                _candidate_json(number, look, trial)
                for number, look in enumerate(self.search.rounds, 1)
                for trial in look.trials
            ],
            "runs": runs_json(len({int(number) for number in self.data.points.record}), self.set_aside),
        }


def _candidate_json(number: int, look: Round, trial: Trial) -> dict[str, object]:
    return {
        "round": number, "name": trial.effect, "where": trial.where, "evidence": trial.evidence,
        "threshold": look.scores.least_evidence, "p_value": trial.p_value,
        "cv_rmse_N": trial.fit.rmse(left_out=True), "taken": trial is look.taken,
    }  # fmt: skip


def start_shape(base: ThrusterMap, data: BollardData, voltage: bool = False) -> Shape:
    """The base map as a shape: its form in each direction that was measured, tied where both curves are one."""
    with_voltage = voltage and data.step is not None
    if base.forward == base.backward and len(data.sides) == 2:
        return Shape((("both", _used(base, base.forward)),), with_voltage)
    return Shape(tuple((name, _used(base, getattr(base, name))) for name in data.sides), with_voltage)


def _used(base: ThrusterMap, curve: Curve | None) -> frozenset[str]:
    """The effects of the form that one direction makes use of: a map may be extended in one direction only."""
    if curve is None:
        return frozenset()
    used = {"dead-band": curve.n_0 > 0.0, "thrust-exponent": curve.p != SQUARE, "saturation": curve.n_sat is not None}
    return frozenset(name for name in effects_of(base.form) if used[name])


def diagnose_thrusters(
    logs: ThrusterLogs,
    base: ThrusterMap,
    *,
    hold_out: ThrusterLogs | None = None,
    thrusters: int = 1,
    n_unit: str = "",
    voltage: bool = False,
    seed: int = 0,
) -> ThrusterDiagnosis:
    """Diagnose `base` on bollard tests in which `thrusters` equal thrusters pulled together.

    `hold_out` None holds out a quarter of the levels; `voltage` says that the map was made with a power of the voltage.
    Raises FitError where the logs cannot carry a curve, RunError where the unit of the control signal is another one.
    """
    if base.n_unit and n_unit and base.n_unit != n_unit:
        raise RunError(
            f"the map's control signal is in {base.n_unit}, the logs' in {n_unit}; give logs and map of one signal"
        )
    sides = tuple(name for name, _ in SIDES if getattr(base, name) is not None)
    whole = bollard_data(logs, thrusters, n_unit or base.n_unit, sides)
    out = held_out_levels(whole, seed) & (hold_out is None)
    fitted, kept = whole.where(~out), whole.where(out) if np.any(out) else None
    if hold_out is not None:
        kept = _kept(hold_out, whole, thrusters)
    floor, floor_from = noise_level(whole)
    shape = start_shape(base, fitted, voltage)
    found, fitted = search_around_faults(fitted, shape, floor, seed)
    word = verdict_of(found, floor, seed)
    effects = named_effects(found, floor) if word == "named" else ()
    final = found.final if word == "named" else found.base
    closest = found.named[0] if word == "unexplained" and found.named else None
    whole = _flagged(whole, ~out, fitted)
    return ThrusterDiagnosis(
        verdict=word,
        given=base,
        data=whole,
        held_out=kept,
        search=found,
        final=final,
        effects=effects,
        closest=closest,
        where=regions(found.base, seed),
        faults=faults(whole, final),
        gap=ThrusterGap(found.base.rmse(), final.rmse(), floor),
        held_out_gap=None if kept is None else _gap_on(kept, found.base, final, floor),
        cross=ThrusterGap(found.base.rmse(left_out=True), final.rmse(left_out=True), floor),
        given_rmse=_rms(fitted, base.force(fitted.points.n)),
        floor_from=floor_from,
        smallest=found.rounds[-1].scores.smallest,
        set_aside=logs.set_aside,
    )


def _kept(logs: ThrusterLogs, fitted: BollardData, thrusters: int) -> BollardData:
    """Logs held out as bollard data with nothing the fitted levels do not have."""
    try:
        return bollard_data(logs, thrusters, fitted.n_unit, fitted.sides, fewest=1)
    except FitError:
        raise FitError(
            "the logs held out have no command in a direction that was fitted; hold out logs like those fitted"
        ) from None


def _flagged(whole: BollardData, here: np.ndarray, fitted: BollardData) -> BollardData:
    """All the data with the weights and flags that its fitted points were given."""
    weight, flag = whole.points.weight.copy(), whole.points.flag.copy()
    weight[here], flag[here] = fitted.points.weight, fitted.points.flag
    return replace(whole, points=replace(whole.points, weight=weight, flag=flag))


def _gap_on(kept: BollardData, base: Fitted, final: Fitted, floor: float) -> ThrusterGap:
    return ThrusterGap(_rms(kept, base.thrust(kept)), _rms(kept, final.thrust(kept)), floor)


def _rms(data: BollardData, thrust: Floats) -> float:
    """Gap [N] of a thrust at the points, weighted as in the fit."""
    rest = data.points.force - thrust
    return float(np.sqrt(data.points.weight @ rest**2 / data.points.weight.sum()))
