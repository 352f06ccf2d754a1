"""`ThrusterMap`: control signal -> thrust of one thruster, forward and backward apart; plain data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from automarine_cli.errors import ModelError
from automarine_cli.models.entries import needed, number_at, object_at
from automarine_cli.pipeline.plain_data import Source, read_plain, told
from automarine_cli.pipeline.words import printable
from automarine_cli.quantities import Floats
from automarine_cli.runs.command_range import CommandRange
from automarine_cli.thrusters.forms import FORMS, SIDES, SQUARE, Curve, thrust_both_ways

SCHEMA = "automarine/thruster-map/1"
_REQUIRED = ("schema", "forward", "backward", "form", "parameters")
_ALLOWED = (
    *_REQUIRED,
    "per_test", "thrusters_per_test", "r2", "rmse_N", "rmse_percent_of_full_scale", "cv_rmse_N", "full_scale_N",
    "forms", "chosen", "chosen_because", "n_unit", "n_range", "tare", "flagged", "voltages", "voltage_range_V",
    "voltage_exponent", "notes", "runs", "points",
)  # fmt: skip


@dataclass(frozen=True)
class ThrusterMap:
    """Thrust of one thruster at rest in the water against its control signal n.

    `forward` holds for n > 0, `backward` for n < 0 (None where that direction was never measured);
    `n_unit` is the unit of n as logged ("" where the logs do not say), `n_range` from where to where it was measured
    (None in maps of old).
    """

    form: str
    forward: Curve | None
    backward: Curve | None
    n_unit: str = ""
    n_range: tuple[float, float] | None = None

    def compared(self, names: Sequence[str], commands: Sequence[Floats]) -> CommandRange | None:
        """The range of commands (N,) of thrusters beside the map's own; None for a map that does not say its own."""
        if self.n_range is None or not len(commands[0]):
            return None
        return CommandRange.of(commands, names, self.n_range, self.n_unit)

    def force(self, n: Floats | float) -> Floats:
        """Thrust [N] of one thruster, any shape of n; positive drives the vehicle ahead.

        Raises ModelError for a direction that the map does not have, and for a control signal that is not
        finite.
        """
        signal = np.asarray(n, dtype=float)
        if not np.all(np.isfinite(signal)):
            raise ModelError("the control signal of a thruster must be finite; leave out the rows without a value")
        for name, sign in SIDES:
            if getattr(self, name) is None and np.any(signal * sign > 0):
                raise ModelError(
                    f"the thruster map has no {name} direction (none was measured), but the log drives "
                    f"a thruster {name}; fit the map from a bollard test that pulls both ways"
                )
        return thrust_both_ways(self.forward, self.backward, signal)

    def moment(self, n_port: Floats | float, n_stbd: Floats | float, arm: float) -> Floats:
        """Yaw moment [N m] of two equal thrusters `arm` [m] off the centre line: arm (F_port - F_stbd).

        Positive turns clockwise seen from above: the port thruster ahead turns the vehicle to starboard.
        Raises ModelError unless the arm is a positive length.
        """
        if not (isfinite(arm) and arm > 0):
            raise ModelError(f"the arm of a thruster is {arm!r}; expected a positive length in metres")
        return np.asarray(arm * (self.force(n_port) - self.force(n_stbd)))

    def to_json(self) -> dict[str, object]:
        """The least that a map file holds: schema, form and the parameters of each direction."""
        return {
            "schema": SCHEMA,
            "forward": _square_json(self.form, self.forward),
            "backward": _square_json(self.form, self.backward),
            "form": self.form,
            "parameters": {"forward": _curve_json(self.forward), "backward": _curve_json(self.backward)},
            "n_unit": self.n_unit,
            **({} if self.n_range is None else {"n_range": list(self.n_range)}),
        }

    @classmethod
    def from_json(cls, data: object, where: str = "thruster map") -> "ThrusterMap":
        """A map from the content of `thrusters.json`; ModelError names the key that is wrong."""
        top = object_at(data, where)
        if top.get("schema") != SCHEMA:
            raise ModelError(
                f"{where}: schema: found {told(top.get('schema'))}, expected {told(SCHEMA)}; "
                "give the thrusters.json that `automarine fit-thrusters` writes"
            )
        _known(top, _ALLOWED, where)
        for key in _REQUIRED:
            needed(top, key, where, "thrusters")
        form = top["form"]
        if not isinstance(form, str) or form not in FORMS:
            raise ModelError(f"{where}: form: found {told(form)}, expected one of {', '.join(FORMS)}")
        parameters = object_at(top["parameters"], f"{where}: parameters")
        _known(parameters, ("forward", "backward"), f"{where}: parameters")
        curves = {
            side: _curve_from(parameters.get(side), f"{where}: parameters.{side}") for side in ("forward", "backward")
        }
        if curves["forward"] is None and curves["backward"] is None:
            raise ModelError(
                f"{where}: parameters has neither a forward nor a backward direction; expected one or both"
            )
        unit = top.get("n_unit", "")
        if not isinstance(unit, str):
            raise ModelError(f"{where}: n_unit: found {told(unit)}, expected text")
        return cls(form, curves["forward"], curves["backward"], unit, _range_from(top.get("n_range"), where))

    @classmethod
    def load(cls, path: Source) -> "ThrusterMap":
        """The map of a `thrusters.json`. Raises ModelError with the file and the key's path."""
        return cls.from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def _square_json(form: str, curve: Curve | None) -> dict[str, object]:
    """The contract's `forward` and `backward`: the square law's coefficient, null for another form."""
    if curve is None or form != "square":
        return {"a": None}
    return {"a": {"value": curve.a}}


def _curve_json(curve: Curve | None) -> dict[str, object] | None:
    if curve is None:
        return None
    values = {"a": curve.a, "p": curve.p, "n_0": curve.n_0, "n_sat": curve.n_sat}
    return {name: None if value is None else {"value": value} for name, value in values.items()}


def _curve_from(data: object, where: str) -> Curve | None:
    if data is None:
        return None
    entry = object_at(data, where)
    _known(entry, ("a", "p", "n_0", "n_sat"), where)
    a = _positive(entry.get("a"), f"{where}.a")
    p = _positive(entry["p"], f"{where}.p") if entry.get("p") is not None else SQUARE
    dead_band = 0.0 if entry.get("n_0") is None else number_at(entry["n_0"], f"{where}.n_0", "thrusters")
    n_sat = entry.get("n_sat")
    if isinstance(n_sat, Mapping) and n_sat.get("value") is None:
        n_sat = None  # the fit found no saturation within the measured range
    n_sat = None if n_sat is None else _positive(n_sat, f"{where}.n_sat")
    if dead_band < 0:
        raise ModelError(f"{where}.n_0: found {dead_band:g}, expected a dead band of zero or more")
    if n_sat is not None and n_sat <= dead_band:
        raise ModelError(f"{where}.n_sat: found {n_sat:g}, expected more than the dead band, {dead_band:g}")
    return Curve(a, p, dead_band, n_sat)


def _known(data: Mapping[str, object], allowed: tuple[str, ...], where: str) -> None:
    unknown = sorted(str(key) for key in data if key not in allowed)
    if unknown:
        raise ModelError(f"{where}: unknown key {told(unknown[0])}; known are {', '.join(allowed)}")


def _range_from(data: object, where: str) -> tuple[float, float] | None:
    if data is None:
        return None
    if not isinstance(data, list) or len(data) != 2:
        raise ModelError(f"{where}: n_range: found {told(data)}, expected two numbers, from the lowest to the highest")
    low, high = (number_at(one, f"{where}: n_range", "thrusters") for one in data)
    if not low < high:
        raise ModelError(f"{where}: n_range: found {low:g} and {high:g}, expected the lower one first")
    return low, high


def _positive(entry: object, where: str) -> float:
    """A number above zero, plain or as an estimate `{"value": ...}`."""
    value = number_at(entry, where, "thrusters")
    if value <= 0.0:
        where = f"{where}.value" if isinstance(entry, Mapping) else where
        raise ModelError(f"{where}: found {value:g}, expected more than 0")
    return value
