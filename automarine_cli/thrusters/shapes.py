"""The models that a thruster diagnosis compares: a curve in each direction, and what multiplies both."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.curves import fit_direction
from automarine_cli.thrusters.fit import Side, best_curve
from automarine_cli.thrusters.forms import FORMS, SUFFIX, Curve, Form, thrust_both_ways

CURVE_EFFECTS = ("dead-band", "thrust-exponent", "saturation")
ASYMMETRY, VOLTAGE, SAG = "thrust-asymmetry", "voltage-exponent", "battery-sag"
ROUNDS = 6
"""Alternations between the curves and what multiplies them; they hardly depend on each other."""


@dataclass(frozen=True)
class Shape:
    """Which effects act where: `curves` pairs each direction ("both": one curve for both) with its effects.

    `voltage`: thrust follows the voltage to a power; `sag`: it falls evenly with the run order.
    """

    curves: tuple[tuple[str, frozenset[str]], ...]
    voltage: bool = False
    sag: bool = False

    @property
    def tied(self) -> bool:
        """Whether both directions share one curve."""
        return self.curves[0][0] == "both"

    @property
    def parameters(self) -> int:
        """Free parameters."""
        return sum(1 + len(effects) for _, effects in self.curves) + self.voltage + self.sag

    def on(self, effect: str) -> tuple[str, ...]:
        """Where an effect acts: directions, or "both"."""
        if effect in CURVE_EFFECTS:
            return tuple(name for name, effects in self.curves if effect in effects)
        present = {VOLTAGE: self.voltage, SAG: self.sag, ASYMMETRY: not self.tied and len(self.curves) == 2}
        return ("both",) if present[effect] else ()

    def without(self, effect: str, base: "Shape") -> "Shape":
        """The shape with one effect taken back to what it is in `base`."""
        own = dict(base.curves)
        if effect == VOLTAGE:
            return replace(self, voltage=base.voltage)
        if effect == SAG:
            return replace(self, sag=base.sag)
        if effect == ASYMMETRY:
            return replace(self, curves=(("both", self.curves[0][1]),))
        kept = ((s, (e - {effect}) | ({effect} & own.get(s, own.get("both", frozenset())))) for s, e in self.curves)
        return replace(self, curves=tuple(kept))

    def additions(self, sags: bool, voltages: bool) -> Iterator[tuple[str, str, "Shape"]]:
        """Every effect that can be added once: name, where ("both", "forward", "backward"), and the new shape."""
        for effect in CURVE_EFFECTS:
            free = [name for name, effects in self.curves if effect not in effects]
            wheres = [(name, (name,)) for name in free] + ([("both", tuple(free))] if len(free) > 1 else [])
            for where, names in wheres:
                curves = tuple((s, e | {effect} if s in names else e) for s, e in self.curves)
                yield effect, where, replace(self, curves=curves)
        if self.tied:
            shared = self.curves[0][1]
            yield ASYMMETRY, "both", replace(self, curves=(("forward", shared), ("backward", shared)))
        if voltages and not self.voltage:
            yield VOLTAGE, "both", replace(self, voltage=True)
        if sags and not self.sag:
            yield SAG, "both", replace(self, sag=True)


def form_of(effects: frozenset[str]) -> Form:
    """The form of the family that frees these effects."""
    names = {(False, False): "square", (True, False): "dead-band", (False, True): "power"}
    base = names.get(("dead-band" in effects, "thrust-exponent" in effects), "dead-band-power")
    return FORMS[base + (SUFFIX if "saturation" in effects else "")]


def effects_of(form: str) -> frozenset[str]:
    """The effects that a form frees; inverse of `form_of`."""
    kind = FORMS[form]
    return frozenset(name for name, on in zip(CURVE_EFFECTS, (kind.dead_band, kind.exponent, kind.saturation)) if on)


@dataclass(frozen=True)
class Fitted:
    """A shape fitted to bollard data; `predicted` and `left_out` [N] have shape (P,).

    `left_out` is what a fit without the point's group of levels says of it; `power` the exponent of the voltage
    against `reference` [V]; `sag` the share of thrust lost from the first reading to the last.
    """

    data: BollardData
    shape: Shape
    curves: dict[str, Curve]
    at_bound: dict[str, tuple[str, ...]]
    power: float
    sag: float
    reference: float

    @property
    def both_ways(self) -> tuple[Curve | None, Curve | None]:
        """The curves forward and backward."""
        shared = self.curves.get("both")
        return self.curves.get("forward", shared), self.curves.get("backward", shared)

    @cached_property
    def predicted(self) -> Floats:
        """Thrust [N] of every point."""
        return self.thrust(self.data)

    @cached_property
    def residual(self) -> Floats:
        """Measured less fitted [N]."""
        return self.data.points.force - self.predicted

    def gain(self, data: BollardData) -> Floats:
        """What multiplies the curves at each point [1]."""
        return _gain(data, self.power, self.sag, self.reference)

    def thrust(self, data: BollardData) -> Floats:
        """Thrust [N] at the points of any bollard data."""
        return self.along(data.points.n) * self.gain(data)

    def along(self, n: Floats) -> Floats:
        """Thrust [N] of the curves alone; NaN in a direction without a curve."""
        return thrust_both_ways(*self.both_ways, n)

    @cached_property
    def left_out(self) -> Floats:
        """Thrust [N] of every point by a fit without its group."""
        total, gain = np.zeros(len(self.data.points)), self.gain(self.data)
        for name, (index, side) in self.data.parts(self.shape.tied).items():
            level = _levelled(side, gain[index])
            numbers = np.unique(side.group)
            out = side.group[None, :] == numbers[:, None]
            weights = np.where(out, 0.0, level.weight[None, :])
            fits = fit_direction(level.magnitude, level.thrust, weights, form_of(dict(self.shape.curves)[name]))
            rows = np.searchsorted(numbers, side.group)
            thrust = fits.thrust(side.magnitude)[rows, np.arange(len(index))]
            total[index] = np.sign(self.data.points.n[index]) * thrust * gain[index]
        return total

    @cached_property
    def loss(self) -> Floats:
        """Weighted squared error [N²] of each group when it is left out, groups in rising number."""
        error = self.data.points.weight * (self.data.points.force - self.left_out) ** 2
        numbers = np.unique(self.data.group)
        return np.array([error[self.data.group == number].sum() for number in numbers])

    @property
    def squares(self) -> float:
        """Weighted sum of squared residuals [N²]."""
        return float(self.data.points.weight @ self.residual**2)

    def rmse(self, left_out: bool = False) -> float:
        """Root mean square error [N], weighted as in the fit; cross-validated with `left_out`."""
        squares = float(self.loss.sum()) if left_out else self.squares
        return float(np.sqrt(squares / self.data.points.weight.sum()))


def fit_shape(data: BollardData, shape: Shape) -> Fitted:
    """Least squares of a shape: curves direction by direction, in turn with what multiplies them."""
    reference = float(np.median(data.points.voltage)) if data.step is not None else 1.0
    power, sag = 0.0, 0.0
    parts = data.parts(shape.tied)
    effects = dict(shape.curves)
    curves: dict[str, Curve] = {}
    bounds: dict[str, tuple[str, ...]] = {}
    for _ in range(ROUNDS if shape.voltage or shape.sag else 1):
        gain = _gain(data, power, sag, reference)
        for name, (index, side) in parts.items():
            curves[name], bounds[name] = best_curve(_levelled(side, gain[index]), form_of(effects[name]))
        found = Fitted(data, shape, dict(curves), dict(bounds), power, sag, reference)
        power, sag = _multipliers(data, shape, found)
    return replace(found, power=power, sag=sag) if shape.voltage or shape.sag else found


def multiplier_columns(found: Fitted, shape: Shape) -> Floats:
    """Derivative of the thrust [N] by the voltage's power and the sag, those that are free; shape (P, K)."""
    data, columns = found.data, []
    if shape.voltage:
        columns.append(found.predicted * np.log(data.points.voltage / found.reference))
    if shape.sag:
        columns.append(-found.predicted * data.order / (1.0 - found.sag * data.order))
    return np.stack(columns, axis=1) if columns else np.zeros((len(data.points), 0))


def _multipliers(data: BollardData, shape: Shape, found: Fitted) -> tuple[float, float]:
    """One Gauss-Newton step of the voltage's power and the sag, with the amplitudes free beside them."""
    columns = multiplier_columns(found, shape)
    if columns.shape[1] == 0:
        return found.power, found.sag
    sides = [np.where(data.points.n * s > 0, found.predicted, 0.0)[:, None] for s in (1.0, -1.0)]
    matrix = np.hstack([columns, *sides])
    root = np.sqrt(data.points.weight)
    step = np.linalg.lstsq(root[:, None] * matrix, root * found.residual, rcond=None)[0]
    power = float(np.clip(found.power + step[0], -4.0, 4.0)) if shape.voltage else found.power
    sag = float(np.clip(found.sag + step[int(shape.voltage)], -0.9, 0.9)) if shape.sag else found.sag
    return power, sag


def _gain(data: BollardData, power: float, sag: float, reference: float) -> Floats:
    gain = 1.0 - sag * data.order
    return gain * (data.points.voltage / reference) ** power if power else gain


def _levelled(side: Side, gain: Floats) -> Side:
    """A side as it would have been without what multiplies its thrust."""
    return replace(side, thrust=side.thrust / gain, weight=side.weight * gain**2)
