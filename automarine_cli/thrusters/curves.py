"""Curves of thrust in one direction against |n|, and their forms: which are fitted, written and read.

Eight forms are special cases of `f(u) = a max(min(u, n_sat) - n_0, 0)^p` with `u = |n|`: the square law (the source
paper's equation 2) has p = 2, no dead band (n_0 = 0) and no saturation; the others free one, two or three of them. The
ninth is a monotone spline through the mean of each level, for curves that no equation of these follows.

A further form is a class like `SplineForm` with a curve like `SplineCurve`, in `Form`, `Curve` and `FORMS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from automarine_cli.estimate import Given
from automarine_cli.models.store import number_at
from automarine_cli.pipeline.records import Codec
from automarine_cli.quantities import Floats
from automarine_cli.text import Place
from automarine_cli.thrusters.bollard_data import levels_of

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

SQUARE = 2.0
Number = Floats | float
EFFECT_PARAMETERS = {"dead-band": "n_0", "thrust-exponent": "p", "saturation": "n_sat"}
"""Effects on a curve, by the parameter that each frees."""


@dataclass(frozen=True)
class LevelEntry:
    unread: ClassVar[tuple[str, ...]] = ()
    n: float
    thrust_N: Given


@dataclass(frozen=True)
class CurveEntry:
    """A curve as a file has it: the parameters of an equation, or the levels of a spline."""

    unread: ClassVar[tuple[str, ...]] = ()
    a: Given | None = None
    p: Given | None = None
    n_0: Given | None = None
    n_sat: Given | None = None
    levels: tuple[LevelEntry, ...] = ()

    @property
    def values(self) -> dict[str, Given | None]:
        equation = {"a": self.a, "p": self.p, "n_0": self.n_0, "n_sat": self.n_sat}
        return equation | {at_level(level.n): level.thrust_N for level in self.levels}


def power_law(n: Floats, a: Number, n_0: Number, p: Number, n_sat: Number) -> Floats:
    """Return a max(min(n, n_sat) - n_0, 0)^p for |n| and parameters that broadcast with each other."""
    return np.asarray(a * np.maximum(np.minimum(n, n_sat) - n_0, 0.0) ** p)


def power_slopes(n: Floats, a: Number, n_0: Number, p: Number, n_sat: Number) -> tuple[Floats, ...]:
    """Return the derivatives of `power_law` by a, n_0, p and n_sat."""
    above = np.maximum(np.minimum(n, n_sat) - n_0, 0.0)
    on = above > 0.0
    safe = np.where(on, above, 1.0)
    unit = np.where(on, safe**p, 0.0)
    # at the edge of the dead band a power below 1 rises without limit
    slope = np.where(on, a * p * np.maximum(safe, 1e-6 * np.max(n, initial=0.0)) ** (p - 1.0), 0.0)
    return unit, -slope, a * unit * np.log(safe), np.where(n >= n_sat, slope, 0.0)


@dataclass(frozen=True)
class PowerCurve:
    """F = a max(min(|n|, n_sat) - n_0, 0)^p: a [N/n^p], p [1], n_0 and n_sat [unit of n]."""

    a: float
    p: float = SQUARE
    n_0: float = 0.0
    n_sat: float | None = None

    @property
    def values(self) -> dict[str, float | None]:
        """Values of all parameters by name."""
        return dict(vars(self))

    def units(self, n_unit: str) -> dict[str, str]:
        """Return the units of all parameters for a control signal in `n_unit`."""
        return {"a": amplitude_unit(n_unit, self.p), "p": "", "n_0": n_unit or "n", "n_sat": n_unit or "n"}

    @property
    def _law(self) -> tuple[float, float, float, float]:
        return self.a, self.n_0, self.p, np.inf if self.n_sat is None else self.n_sat

    def thrust(self, magnitude: Floats) -> Floats:
        """Return the size of the thrust [N] for |n| of any shape."""
        return power_law(magnitude, *self._law)

    def signal(self, thrust: float) -> float:
        """Return |n| that gives a thrust [N], if it does not saturate before; the edge of the dead band for none."""
        return float(self.n_0 + (thrust / self.a) ** (1.0 / self.p))

    def slopes(self, magnitude: Floats) -> dict[str, Floats]:
        """Return the derivative of the thrust by each parameter at |n| of shape (N,)."""
        return dict(zip(("a", "n_0", "p", "n_sat"), power_slopes(magnitude, *self._law)))

    def layout(self, values: Mapping[str, object]) -> object:
        """Lay out what a file says of each parameter, by name."""
        return dict(values)


@dataclass(frozen=True)
class SplineCurve:
    """Monotone cubic spline (Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5:300) through |n| of levels `n` (K,)
    and their thrust `force` [N] (K,), which begin at 0 and never fall; straight on beyond the highest level."""

    n: tuple[float, ...]
    force: tuple[float, ...]

    @cached_property
    def _spline(self) -> "PPoly":
        from scipy.interpolate import PchipInterpolator, PPoly  # take long to import: only where a map has a spline

        inner = PchipInterpolator(self.n, self.force)
        straight = np.array([[0.0], [0.0], [float(inner(self.n[-1], 1))], [self.force[-1]]])
        return PPoly(np.hstack([inner.c, straight]), [*self.n, 1e6 * self.n[-1]])

    @property
    def n_0(self) -> float:
        return self.n[sum(force <= 0.0 for force in self.force) - 1]

    @property
    def n_sat(self) -> float | None:
        first = self.force.index(self.force[-1])
        return self.n[first] if first < len(self.n) - 1 else None

    @property
    def values(self) -> dict[str, float | None]:
        return {at_level(n): force for n, force in zip(self.n[1:], self.force[1:])}

    def units(self, n_unit: str) -> dict[str, str]:
        return dict.fromkeys(self.values, "N")

    def thrust(self, magnitude: Floats) -> Floats:
        return np.asarray(np.maximum(self._spline(magnitude), 0.0))

    def signal(self, thrust: float) -> float:
        if thrust <= 0.0:
            return self.n_0
        reached = self._spline.solve(thrust, extrapolate=False)
        return float(reached[0]) if len(reached) else self.n_sat or self.n[-1]

    def slopes(self, magnitude: Floats) -> dict[str, Floats]:
        nearest = np.argmin(np.abs(magnitude[:, None] - np.array(self.n[1:])), axis=1)
        return {name: np.asarray(nearest == k, dtype=float) for k, name in enumerate(self.values)}

    def layout(self, values: Mapping[str, object]) -> object:
        return {"levels": [{"n": n, "thrust_N": value} for n, value in zip(self.n[1:], values.values())]}


Curve = PowerCurve | SplineCurve


def at_level(n: float) -> str:
    """Name the thrust at a level, a parameter of a spline."""
    return f"F({n:.6g})"


def amplitude_unit(n_unit: str, power: float = SQUARE) -> str:
    """Return the unit of the amplitude: N over the control signal's unit to the exponent."""
    base = n_unit or "n"
    base = f"({base})" if any(character in base for character in "/ ·") else base
    return f"N/{base}²" if power == SQUARE else f"N/{base}^p"


# Bounds of (amplitude, dead band, exponent, saturation), the second and fourth as shares of the largest command.
LOW = np.array([0.0, 0.0, 0.3, 0.3])
HIGH = np.array([np.inf, 0.8, 4.0, 1.0])
LOW_BEYOND_DEAD_BAND = np.array([0.0, 0.0, 1.0, 0.3])
"""Thrust that begins with a jump (p < 1) where no level shows it is no dead band, but a curve that bends."""
AS_GOOD = 1e-6  # relative difference of sums of squares that counts as none
GRID_STARTS = 5
MAX_FIT_STEPS = 60
LEAST_SHARE = 1e-9


@dataclass(frozen=True)
class PowerForm:
    """Which of dead band, exponent and saturation are free beside the amplitude."""

    name: str
    effects: frozenset[str]
    interpolates: ClassVar[bool] = False  # true of a form that passes through each level: only left out do they err
    beyond: ClassVar[str] = "its equation"  # what it is beyond the highest level

    @property
    def can_add(self) -> tuple[str, ...]:
        """The effects of a curve that the form lacks."""
        return tuple(effect for effect in EFFECT_PARAMETERS if effect not in self.effects)

    @property
    def least_groups(self) -> int:
        """Groups of levels from which one can be left out."""
        return len(self.effects) + 3

    @property
    def equation(self) -> str:
        level = "min(|n|, n_sat)" if "saturation" in self.effects else "|n|"
        inner = f"max({level} - n_0, 0)" if "dead-band" in self.effects else level
        return f"|F| = a {inner}^{'p' if 'thrust-exponent' in self.effects else '2'}"

    def free(self, curve: Curve | None = None) -> tuple[str, ...]:
        """Return the names of the parameters that are fitted."""
        return ("a", *(name for effect, name in EFFECT_PARAMETERS.items() if effect in self.effects))

    def with_effects(self, effects: frozenset[str]) -> "Form":
        """Return the form with exactly these effects."""
        return next(form for form in POWER_FORMS if form.effects == effects)

    def used_by(self, curve: Curve) -> "Form":
        """Return the form without the effects that a curve makes no use of."""
        idle = PowerCurve(1.0).values
        acting = {effect for effect, name in EFFECT_PARAMETERS.items() if curve.values[name] != idle[name]}
        return self.with_effects(self.effects & acting)

    def fit(self, magnitude: Floats, thrust: Floats, weights: Floats) -> tuple[Curve, tuple[str, ...]]:
        """Return the curve by weighted least squares of `thrust` [N] on |n|, all of shape (N,), and the names of its
        parameters that ended at a bound."""
        scale, values = float(np.max(magnitude)), self._fits(magnitude, thrust, weights[None, :])[0]
        amplitude, dead, power, top = map(float, values)
        at_bound = dict(zip(("a", "n_0", "p", "n_sat"), (values <= self._lowest + 1e-9) | (values >= HIGH - 1e-9)))
        curve = PowerCurve(amplitude / scale**power, power, dead * scale, None if top >= HIGH[3] else top * scale)
        return curve, tuple(name for name in self.free() if at_bound[name] and name != "a")

    def predictions(self, magnitude: Floats, thrust: Floats, weights: Floats) -> Floats:
        """Return the thrust [N] at |n|, (N,), by a fit with each row of `weights`; both of shape (B, N)."""
        values = self._fits(magnitude, thrust, weights)
        return power_law(magnitude / np.max(magnitude), *values.T[:, :, None])

    @property
    def _lowest(self) -> Floats:
        return LOW_BEYOND_DEAD_BAND if {"dead-band", "thrust-exponent"} <= self.effects else LOW

    def _fits(self, magnitude: Floats, thrust: Floats, weights: Floats) -> Floats:
        """Parameters of B weighted fits, (B, 4), of |n| as a share of the largest: amplitude [N], dead band, exponent,
        saturation.

        A grid over dead band, exponent and saturation with the amplitude solved for, then bounded Levenberg-Marquardt
        steps from its best points."""
        x = magnitude / np.max(magnitude)
        starts = self._starts(x, thrust, weights)  # (B, S, 4)
        values, sse = self._refined(x, thrust, np.repeat(weights, starts.shape[1], axis=0), starts.reshape(-1, 4))
        values, sse = values.reshape(starts.shape), sse.reshape(starts.shape[:2])
        # of those as good as the best the one with least dead band and saturation: levels left out may not show either
        as_good = sse <= sse.min(axis=1, keepdims=True) * (1.0 + AS_GOOD)
        best = np.argmax(np.where(as_good, values[:, :, 3] - values[:, :, 1], -np.inf), axis=1)
        return np.asarray(values[np.arange(len(weights)), best])

    def _starts(self, x: Floats, y: Floats, weights: Floats) -> Floats:
        """Best grid points with their amplitudes, shape (B, S, 4)."""
        dead, power, top = [0.0], np.array([SQUARE]), [1.0]
        if "dead-band" in self.effects:
            dead = np.linspace(0.0, min(0.6, 0.95 * float(np.sort(x)[-2])), 16).tolist()
        if "thrust-exponent" in self.effects:
            power = np.array([0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 1.8, 2.0, 2.2, 2.6, 3.2])
        if "saturation" in self.effects:
            top = np.linspace(0.35, 1.0, 14).tolist()
        power = power[power >= self._lowest[2]]
        grid = np.stack(np.meshgrid([1.0], dead, power, top, indexing="ij"), axis=-1).reshape(-1, 4)
        grid = grid[grid[:, 3] > grid[:, 1] + 0.1]
        shape = power_law(x, *grid.T[:, :, None])  # (G, N)
        cross, square = (weights * y) @ shape.T, weights @ (shape**2).T  # (B, G)
        amplitude = np.maximum(cross / np.maximum(square, 1e-300), LEAST_SHARE)
        sse = (weights @ y**2)[:, None] - 2.0 * amplitude * cross + amplitude**2 * square
        order = np.argsort(sse, axis=1, kind="stable")[:, :GRID_STARTS]
        starts = grid[order]
        starts[:, :, 0] = np.take_along_axis(amplitude, order, axis=1)
        return np.asarray(starts)

    def _refined(self, x: Floats, y: Floats, weights: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Parameters (B, 4) and sums of squares (B,) by Levenberg-Marquardt within bounds, of all rows at once; no step
        makes a fit worse."""
        free = np.array([True, *(effect in self.effects for effect in EFFECT_PARAMETERS)])
        low, high, root, unit = self._lowest[free], HIGH[free], np.sqrt(weights), np.eye(int(free.sum()))

        def errors(values: Floats) -> Floats:
            return np.asarray(root * (y - power_law(x, *values.T[:, :, None])))

        values = np.clip(values, self._lowest, HIGH)
        residual, damping = errors(values), np.full(len(values), 1e-3)
        for _ in range(MAX_FIT_STEPS if self.effects else 0):
            sse, at = np.sum(residual**2, axis=1), values[:, free]
            matrix = root[:, :, None] * np.stack(power_slopes(x, *values.T[:, :, None]), axis=-1)[:, :, free]
            gradient = np.einsum("bnk,bn->bk", matrix, residual)
            # A parameter that stands at its bound and is pushed outwards stays there.
            fixed = ((at <= low) & (gradient < 0)) | ((at >= high) & (gradient > 0))
            matrix, gradient = np.where(fixed[:, None], 0.0, matrix), np.where(fixed, 0.0, gradient)
            normal = np.swapaxes(matrix, 1, 2) @ matrix
            diagonal = np.einsum("bkk->bk", normal)
            damped = damping[:, None] * diagonal + LEAST_SHARE * diagonal.max(axis=1, keepdims=True) + 1e-300
            step = np.linalg.solve(normal + unit * damped[:, :, None], gradient[:, :, None])[:, :, 0]
            trial = values.copy()
            trial[:, free] = np.clip(at + step, low, high)
            after = errors(trial)
            gain = sse - np.sum(after**2, axis=1)
            better = (gain > 0.0)[:, None]
            values, residual = np.where(better, trial, values), np.where(better, after, residual)
            if np.all(np.where(gain > 0.0, gain <= 1e-12 * sse, damping > 1e8)):
                break
            damping = np.clip(np.where(gain > 0.0, damping / 5.0, damping * 4.0), 1e-12, 1e12)
        return values, np.sum(residual**2, axis=1)

    def read(self, entry: CurveEntry, codec: Codec, place: Place) -> Curve:
        """Return the curve that a file holds. Raises the codec's refusal with the key that is wrong."""
        values = dict[str, float]()
        for name, stored in (entry.values | {"a": entry.a or Given(None)}).items():
            if stored is None or (stored.value is None and name == "n_sat"):  # no saturation within the measured range
                continue
            values[name] = number_at(stored, codec, (*place, name))
            if values[name] < 0.0 and name == "n_0":
                raise codec.refusal((*place, name), f"found {values[name]:g}, expected a dead band of zero or more")
            if values[name] <= 0.0 and name != "n_0":
                raise codec.refusal((*place, name), f"found {values[name]:g}, expected more than 0")
        curve = PowerCurve(**values)
        if curve.n_sat is not None and curve.n_sat <= curve.n_0:
            why = f"found {curve.n_sat:g}, expected more than the dead band, {curve.n_0:g}"
            raise codec.refusal((*place, "n_sat"), why)
        return curve


TRUSTED = 0.5  # weight of a level, of the usual level's, below which the spline passes it by: it is an outlier


@dataclass(frozen=True)
class SplineForm:
    """A monotone spline through the mean of each level, and through zero at rest; neighbours whose means fall share
    theirs (isotonic regression). A diagnosis can add nothing to it that it does not follow by itself."""

    name: str = "spline"
    effects: frozenset[str] = frozenset()
    equation: ClassVar[str] = "|F| a monotone cubic spline through the mean of each level"
    least_groups: ClassVar[int] = 5
    interpolates: ClassVar[bool] = True
    beyond: ClassVar[str] = "a straight line with the slope at the highest"
    can_add: ClassVar[tuple[str, ...]] = ()

    def with_effects(self, effects: frozenset[str]) -> "Form":
        return self

    def used_by(self, curve: Curve) -> "Form":
        return self

    def fit(self, magnitude: Floats, thrust: Floats, weights: Floats) -> tuple[Curve, tuple[str, ...]]:
        return _through_levels(levels_of(magnitude), magnitude, thrust, weights), ()

    def predictions(self, magnitude: Floats, thrust: Floats, weights: Floats) -> Floats:
        level = levels_of(magnitude)
        return np.stack([_through_levels(level, magnitude, thrust, row).thrust(magnitude) for row in weights])

    def free(self, curve: Curve) -> tuple[str, ...]:
        return tuple(curve.values)

    def read(self, entry: CurveEntry, codec: Codec, place: Place) -> Curve:
        place = (*place, "levels")
        n = (0.0, *(level.n for level in entry.levels))
        force = (0.0, *(number_at(level.thrust_N, codec, (*place, i)) for i, level in enumerate(entry.levels)))
        if np.any(np.diff(n) <= 0.0) or np.any(np.diff(force) < 0.0) or force[-1] <= 0.0:
            raise codec.refusal(place, "expected levels of rising n > 0 with a thrust_N that never falls")
        return SplineCurve(n, force)


def _through_levels(level: np.ndarray, magnitude: Floats, thrust: Floats, weights: Floats) -> SplineCurve:
    from scipy.optimize import isotonic_regression

    total = np.bincount(level, weights)
    usual = total / np.bincount(level)
    there = usual >= TRUSTED * np.median(usual[usual > 0.0])
    n, force = (np.bincount(level, weights * x)[there] / total[there] for x in (magnitude, thrust))
    force = isotonic_regression(np.maximum(force, 0.0), weights=total[there]).x
    return SplineCurve((0.0, *n.tolist()), (0.0, *force.tolist()))


Form = PowerForm | SplineForm
_BASE: dict[str, set[str]] = {
    "square": set(), "dead-band": {"dead-band"}, "power": {"thrust-exponent"},
    "dead-band-power": {"dead-band", "thrust-exponent"},
}  # fmt: skip
POWER_FORMS = (
    *(PowerForm(name, frozenset(effects)) for name, effects in _BASE.items()),
    *(PowerForm(f"{name}-saturation", frozenset(effects | {"saturation"})) for name, effects in _BASE.items()),
)
FORMS: dict[str, Form] = {form.name: form for form in POWER_FORMS} | {"spline": SplineForm()}
