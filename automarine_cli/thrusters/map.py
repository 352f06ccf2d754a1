"""`ThrusterMap`: control signal -> thrust of one thruster, forward and backward apart; plain data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Given
from automarine_cli.models.store import number_at
from automarine_cli.pipeline.records import Codec, Place, Source, read_plain, told
from automarine_cli.pipeline.result_files import THRUSTER_MAP, CurveEntry
from automarine_cli.pipeline.words import printable
from automarine_cli.quantities import Floats
from automarine_cli.runs.command_range import CommandRange
from automarine_cli.simulation.run_groups import levels_of
from automarine_cli.simulation.specification import Bollard
from automarine_cli.simulation.streams import normal, uniform
from automarine_cli.thrusters.forms import FORMS, SIDES, SQUARE, Curve, thrust_both_ways

FORCE_DECIMALS = 3


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

    @property
    def both_ways(self) -> tuple[Curve, Curve]:
        """The curves ahead and astern. Raises SettingError for a map of one direction."""
        if self.forward is None or self.backward is None:
            lacking = "forward" if self.forward is None else "backward"
            raise SettingError(
                f"the thruster map has no {lacking} direction, but one thruster pulls each way in a turn; fit the map "
                "from a test that pulls both ways"
            )
        return self.forward, self.backward

    @property
    def largest(self) -> float | None:
        """Largest control signal, either way, that it tells of: where a curve saturates, how far was measured."""
        ends = [curve.n_sat for curve in (self.forward, self.backward) if curve is not None and curve.n_sat is not None]
        measured = [] if self.n_range is None else [abs(end) for end in self.n_range if end]
        return min([*ends, *measured], default=None)

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
            "schema": THRUSTER_MAP.schema,
            "forward": _square_json(self.form, self.forward),
            "backward": _square_json(self.form, self.backward),
            "form": self.form,
            "parameters": {"forward": _curve_json(self.forward), "backward": _curve_json(self.backward)},
            "n_unit": self.n_unit,
            **({} if self.n_range is None else {"n_range": list(self.n_range)}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, object], where: str = "thruster map") -> "ThrusterMap":
        """A map from the content of `thrusters.json`; ModelError names the key that is wrong."""
        file, codec = THRUSTER_MAP.of(data, where), THRUSTER_MAP.codec(data, where)
        if file.form not in FORMS:
            raise codec.refusal(("form",), f"found {told(file.form)}, expected one of {', '.join(FORMS)}")
        low, high = file.n_range or (0.0, 1.0)
        if not low < high:
            raise codec.refusal(("n_range",), f"found {low:g} and {high:g}, expected the lower one first")
        forward, backward = (
            _curve_from(getattr(file.parameters, side), codec, ("parameters", side)) for side, _ in SIDES
        )
        if forward is None and backward is None:
            raise codec.refusal((), "parameters has neither a forward nor a backward direction; expected one or both")
        return cls(file.form, forward, backward, file.n_unit, file.n_range)

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


def _curve_from(entry: CurveEntry | None, codec: Codec, place: Place) -> Curve | None:
    if entry is None:
        return None
    a = _positive(entry.a or Given(None), codec, (*place, "a"))
    p = SQUARE if entry.p is None else _positive(entry.p, codec, (*place, "p"))
    dead_band = 0.0 if entry.n_0 is None else number_at(entry.n_0, codec, (*place, "n_0"))
    n_sat = None  # the fit found no saturation within the measured range
    if entry.n_sat is not None and entry.n_sat.value is not None:
        n_sat = _positive(entry.n_sat, codec, (*place, "n_sat"))
    if dead_band < 0:
        raise codec.refusal((*place, "n_0"), f"found {dead_band:g}, expected a dead band of zero or more")
    if n_sat is not None and n_sat <= dead_band:
        raise codec.refusal((*place, "n_sat"), f"found {n_sat:g}, expected more than the dead band, {dead_band:g}")
    return Curve(a, p, dead_band, n_sat)


def _positive(given: Given, codec: Codec, place: Place) -> float:
    """A number above zero."""
    value = number_at(given, codec, place)
    if value <= 0.0:
        raise codec.refusal(place, f"found {value:g}, expected more than 0")
    return value


def bollard_columns(bollard: Bollard, seed: int) -> dict[str, Floats]:
    """`n` and `force_N` of all thrusters of a test together, shape (levels x repeats,), in random order."""
    levels = np.repeat(np.array(levels_of(bollard.levels)), bollard.repeats)
    order = np.argsort(uniform(len(levels), seed, bollard.file, "order"), kind="stable")
    thrusters = ThrusterMap("square", Curve(bollard.a_f), Curve(bollard.a_b))
    pull = bollard.thrusters_per_test * thrusters.force(levels)
    measured = pull + bollard.noise_N * normal(len(levels), seed, bollard.file, "noise")
    return {"n": levels[order], "force_N": (np.round(measured, FORCE_DECIMALS) + 0.0)[order]}
