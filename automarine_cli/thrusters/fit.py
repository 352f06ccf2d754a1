"""Points of a bollard test by direction, and maps fitted to them: a curve each way, and what multiplies both."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.estimate import Estimate, Given
from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import Ints, Points, folds_of, groups_of, levels_of
from automarine_cli.thrusters.curves import EFFECT_PARAMETERS, Curve, Form
from automarine_cli.thrusters.map import SIDES, thrust_both_ways

MIN_LEVELS = 3
ENOUGH_RECORDS = 4  # records from which their scatter alone carries an interval
ENOUGH_REPEATS = 6  # degrees of freedom among repeats from which their scatter does
PLAIN, UNBIASED, JACKKNIFE = 0.0, 0.5, 1.0
ASYMMETRY, VOLTAGE, SAG = "thrust-asymmetry", "voltage-exponent", "battery-sag"
ALTERNATIONS = 6  # rounds of curves and what multiplies them; they hardly depend on each other
MAX_EXPLAINED = 0.8  # share of the run order that the levels explain from which a drift cannot be told from the curve


@dataclass(frozen=True)
class BollardData(Points):
    """Measured points of one thruster, without those at zero command; all arrays have shape (P,).

    `level` numbers signed commands at one voltage: the unit of chance, `group` what cross-validation leaves out;
    `order` runs from 0 to 1; `places` are the records' names. Errors may count points at zero command, where every map
    says zero, with a sum of squares [N²] and a weight."""

    level: Ints
    group: Ints
    order: Floats
    tare_stderr: float
    n_unit: str
    places: tuple[str, ...] = ()
    zero_squares: float = 0.0
    zero_weight: float = 0.0

    @property
    def directions(self) -> dict[str, float]:
        """Names and signs of the directions that have points."""
        return {name: sign for name, sign in SIDES if np.any(self.n * sign > 0)}

    @property
    def levels(self) -> int:
        return len(np.unique(self.level))

    @property
    def by_voltage(self) -> bool:
        return len(self.steps) > 1

    def with_flags(self, index: Ints | NDArray[np.bool_], weight: Floats | float, flag: object) -> "BollardData":
        weights, flags = self.weight.copy(), self.flag.copy()
        weights[index], flags[index] = weight, flag
        return replace(self, weight=weights, flag=flags)

    def parts(self, tied: bool) -> dict[str, tuple[Ints, "BollardData"]]:
        """Places and points of each direction, or of both together as one curve (`tied`), with positive n and force;
        groups as standard errors count them."""
        parts = {}
        for name, sign in {"both": 0.0}.items() if tied else self.directions.items():
            inside = np.flatnonzero(self.n * sign >= 0)
            part, size = self.where(inside), np.abs(self.n[inside])
            part = replace(part, n=size, force=np.sign(part.n) * part.force, group=groups_of(size))
            alike = np.zeros(len(part), dtype=np.int64)
            parts[name] = inside, replace(part, record=alike, step=alike) if tied else part
        return parts

    @property
    def is_between(self) -> NDArray[np.bool_]:
        """Which points of one direction are of any level but the highest, (P,)."""
        level = levels_of(self.n)
        return np.asarray(level < level.max())

    def can_leave_out(self, form: Form) -> bool:
        return len(np.unique(self.group)) >= form.least_groups

    def without(self, gain: Floats) -> "BollardData":
        """The points as they would have been without what multiplies their thrust."""
        return replace(self, force=self.force / gain, weight=self.weight * gain**2)

    def order_is_free(self) -> bool:
        """Whether the run order can be told from the command: then a drift with it can be a candidate."""
        n = self.n
        volts = [self.voltage] if self.by_voltage else []
        matrix = np.stack([np.ones(len(n)), n, np.abs(n), n**2, n * np.abs(n), *volts], axis=1)
        residual = self.order - matrix @ np.linalg.lstsq(matrix, self.order, rcond=None)[0]
        return bool(np.ptp(self.order) > 0 and 1.0 - residual.var() / self.order.var() < MAX_EXPLAINED)

    def place(self, index: int) -> str:
        return self.places[int(self.record[index])]


def bollard_data(points: Points, tare_stderr: float, n_unit: str, sides: Collection[str], *places: str) -> BollardData:
    """Make data of the points in the directions `sides`, tared and flagged."""
    group = np.zeros(len(points), dtype=np.int64)
    for first, (name, sign) in zip((1, 1001), SIDES):  # groups of both directions are numbered apart
        if name in sides:
            mask = points.n * sign > 0
            group[mask] = groups_of(np.abs(points.n[mask])) + first
    inside, order = group > 0, np.arange(len(points), dtype=float) / max(len(points) - 1, 1)
    data = points.where(inside)
    level = np.unique(np.stack([levels_of(data.n), data.step]), axis=1, return_inverse=True)[1].ravel()
    return BollardData(
        **vars(data), level=level, group=group[inside], order=order[inside], tare_stderr=tare_stderr, n_unit=n_unit,
        places=places,
    )  # fmt: skip


def curve_estimates(
    side: BollardData, form: Form, curve: Curve, at_bound: tuple[str, ...]
) -> dict[str, Estimate | Given]:
    """Return estimates of a curve's parameters by name, of points of one direction; one at its bound has no standard
    error and says so, one that the form fixes is a plain number (None: no saturation)."""
    values, units, slopes = curve.values, curve.units(side.n_unit), curve.slopes(side.n)
    free = [name for name in form.free(curve) if name not in at_bound and np.any(slopes[name] != 0.0)]
    matrix = np.stack([slopes[name] for name in free], axis=1)
    if form.interpolates:
        stderr, dof = _level_errors(side, matrix, form)
    else:
        freed_by = UNBIASED if free == ["a"] else JACKKNIFE
        stderr, dof = _robust_errors(side, matrix, side.force - curve.thrust(side.n), freed_by)
    result: dict[str, Estimate | Given] = {name: Given(value, unit=units[name]) for name, value in values.items()}
    for name in form.free(curve):
        why = "no saturation within the measured range" if name == "n_sat" else "at the end of its range"
        result[name] = Given(values[name], unit=units[name], at_bound=why)
    for name, error, freedom in zip(free, stderr, dof):
        result[name] = Estimate.from_stderr(values[name] or 0.0, error, freedom, units[name])
    return result


def _level_errors(side: BollardData, matrix: Floats, form: Form) -> tuple[Floats, Floats]:
    """Standard errors [N] of means of levels and their degrees of freedom, (K,); `matrix` (P, K) says whose a point is.
    Scatter is pooled over repeats at one command, with too few of them over levels left out between others, which
    misses by the bend of the curve too."""
    level = levels_of(side.n)
    mean = np.bincount(level, side.weight * side.force) / np.bincount(level, side.weight)
    squares, dof = side.weight * (side.force - mean[level]) ** 2, len(level) - len(mean)
    if dof < ENOUGH_REPEATS:
        squares, dof = left_out_squares(side, form) * side.is_between, max(len(mean) - 1, 1)
    variance = squares.sum() / dof / np.maximum(side.weight @ matrix, 1e-300)
    samples = (side.weight * np.nan_to_num(side.stderr)) ** 2 @ matrix / (side.weight @ matrix) ** 2
    variance = np.maximum(variance, samples)
    return np.sqrt(variance + side.tare_stderr**2), np.full(matrix.shape[1], float(dof))


def _robust_errors(side: BollardData, matrix: Floats, residual: Floats, freed_by: float) -> tuple[Floats, Floats]:
    """Cluster-robust standard errors and their degrees of freedom, (K,); `matrix` (P, K): derivative of the thrust.

    Clusters are levels; where records or voltage steps cross them, both (Cameron, Gelbach & Miller 2011, J. Bus. Econ.
    Stat. 29:238), never less than the levels alone say. The tare's own error is common to all points."""
    size, root = np.sqrt(np.sum(matrix**2, axis=0)), np.sqrt(side.weight)
    rows, errors = root[:, None] * (matrix / size), root * residual
    inverse = np.linalg.pinv(rows.T @ rows)
    variance, dof = _clustered(rows, errors, inverse, side.group, freed_by)
    record = side.step if side.by_voltage else side.record
    levels = [len(np.unique(side.group[record == number])) for number in np.unique(record)]
    if len(levels) > 1 and min(levels) >= MIN_LEVELS:
        crossed = np.unique(np.stack([side.group, record]), axis=1, return_inverse=True)[1].ravel()
        of_both, _ = _clustered(rows, errors, inverse, crossed.astype(np.int64), freed_by)
        many = len(levels) >= ENOUGH_RECORDS
        of_records, dof_records = _clustered(rows, errors, inverse, record, freed_by if many else PLAIN)
        if many:
            variance = np.maximum(variance, variance + of_records - of_both)
            dof = np.minimum(dof, dof_records)
        # Gains of two records that lie either side of their mean cancel in every level, not in these.
        variance = np.maximum(variance, np.maximum(of_records, of_both))
    # A few levels may agree by chance better than the samples behind them allow.
    variance = np.maximum(variance, (inverse @ (rows * root[:, None]).T) ** 2 @ np.nan_to_num(side.stderr) ** 2)
    tare = inverse @ (rows.T @ root) * side.tare_stderr
    return np.sqrt(variance + tare**2) / size, dof


def _clustered(rows: Floats, errors: Floats, inverse: Floats, group: Ints, freed_by: float) -> tuple[Floats, Floats]:
    """Variances of the parameters and their degrees of freedom, both of shape (K,).

    Each cluster's residuals are freed of their own leverage by that power of what it leaves: UNBIASED is HC2 with one
    point a cluster (MacKinnon & White 1985), else its cluster form CR2, right for a straight line; JACKKNIFE is HC3 and
    CR3, wider, for forms that bend; PLAIN is the sandwich itself, for two or three clusters, of which a correction
    would say only that they are few. The degrees of freedom are Satterthwaite's for independent equal errors (Bell &
    McCaffrey 2002; Pustejovsky & Tipton 2018, J. Bus. Econ. Stat. 36:672): a square law rests on its few highest
    levels, so that they are far fewer than the levels."""
    variance, effects = np.zeros(len(inverse)), []
    for number in np.unique(group):
        members = group == number
        block = rows[members]
        share, axes = np.linalg.eigh(block @ inverse @ block.T)
        shrunk = (1.0 - np.minimum(share, 0.99)) ** freed_by
        freed = (axes / shrunk) @ axes.T @ block @ inverse  # (points here, K)
        variance += (errors[members] @ freed) ** 2
        effect = -rows @ (inverse @ (block.T @ freed))
        effect[members] += freed
        effects.append(effect)
    stacked = np.stack(effects, axis=2)  # (points, K, clusters)
    between = np.einsum("pkg,pkh->kgh", stacked, stacked)
    trace = np.einsum("kgg->k", between)
    return variance, trace**2 / np.maximum(np.sum(between**2, axis=(1, 2)), 1e-300)


@dataclass(frozen=True)
class Shape:
    """Which effects act where: `forms` pairs each direction ("both": one curve for both) with the form of its curve.

    `voltage`: thrust follows the voltage to a power; `sag`: it falls evenly with the run order."""

    forms: tuple[tuple[str, Form], ...]
    voltage: bool = False
    sag: bool = False

    @classmethod
    def alike(cls, form: Form, sides: Iterable[str]) -> "Shape":
        """One form in all directions."""
        return cls(tuple((side, form) for side in sides))

    @property
    def tied(self) -> bool:
        return self.forms[0][0] == "both"

    @property
    def form(self) -> Form:
        """The form with the effects of all directions."""
        return self.forms[0][1].with_effects(frozenset().union(*(form.effects for _, form in self.forms)))

    @property
    def parameters(self) -> int:
        """Free parameters, those of a spline apart, to which no curve adds any."""
        return sum(1 + len(form.effects) for _, form in self.forms) + self.voltage + self.sag

    def with_forms(self, forms: dict[str, Form]) -> "Shape":
        """Return the shape with other forms in some directions."""
        return replace(self, forms=tuple((dict(self.forms) | forms).items()))

    def effects_at(self, side: str) -> frozenset[str]:
        """Return the effects of the curve in one direction, or of that for both."""
        forms = dict(self.forms)
        form = forms.get(side) or forms.get("both")
        return form.effects if form else frozenset()

    def without(self, effect: str, base: "Shape") -> "Shape":
        """Return the shape with one effect taken back to what it is in `base`."""
        if effect in (VOLTAGE, SAG):
            return replace(self, voltage=base.voltage) if effect == VOLTAGE else replace(self, sag=base.sag)
        if effect == ASYMMETRY:
            return replace(self, forms=(("both", self.forms[0][1]),))
        return self.with_forms({
            side: form.with_effects((form.effects - {effect}) | (base.effects_at(side) & {effect}))
            for side, form in self.forms
        })  # fmt: skip

    def additions(self, data: BollardData) -> Iterator[tuple[str, str, "Shape"]]:
        """List every effect that can be added once: name, where ("both", "forward", "backward"), and the new shape."""
        for effect in EFFECT_PARAMETERS:
            more = {side: f.with_effects(f.effects | {effect}) for side, f in self.forms if effect in f.can_add}
            for side, form in more.items():
                yield effect, side, self.with_forms({side: form})
            if len(more) > 1:
                yield effect, "both", self.with_forms(more)
        if self.tied:
            split = (("forward", self.forms[0][1]), ("backward", self.forms[0][1]))
            yield ASYMMETRY, "both", replace(self, forms=split)
        if data.by_voltage and not self.voltage:
            yield VOLTAGE, "both", replace(self, voltage=True)
        if not self.sag and data.order_is_free():
            yield SAG, "both", replace(self, sag=True)


@dataclass(frozen=True)
class MapFit:
    """A shape fitted to bollard data.

    `power` is the exponent of the voltage against `reference` [V]; `sag` the share of thrust lost from the first
    reading to the last."""

    data: BollardData
    shape: Shape
    curves: dict[str, Curve]
    at_bound: dict[str, tuple[str, ...]]
    power: float = 0.0
    sag: float = 0.0
    reference: float = 1.0

    @property
    def form(self) -> Form:
        return self.shape.form

    @property
    def both_ways(self) -> tuple[Curve | None, Curve | None]:
        shared = self.curves.get("both")
        return self.curves.get("forward", shared), self.curves.get("backward", shared)

    @cached_property
    def sides(self) -> dict[str, tuple[Ints, BollardData, Form]]:
        """Of each direction, or of both as one: places and points without what multiplies the curve, and its form."""
        gain, forms, parts = self.gain(self.data), dict(self.shape.forms), self.data.parts(self.shape.tied)
        return {name: (index, side.without(gain[index]), forms[name]) for name, (index, side) in parts.items()}

    @cached_property
    def predicted(self) -> Floats:
        return self.thrust(self.data)

    @cached_property
    def residual(self) -> Floats:
        """Measured less fitted [N], (P,)."""
        return self.data.force - self.predicted

    def gain(self, data: BollardData) -> Floats:
        """What multiplies the curves at each point [1]."""
        gain = 1.0 - self.sag * data.order
        return gain * (data.voltage / self.reference) ** self.power if self.power else gain

    def thrust(self, data: BollardData) -> Floats:
        """Thrust [N] at the points of any bollard data."""
        return self.along(data.n) * self.gain(data)

    def along(self, n: Floats) -> Floats:
        """Thrust [N] of the curves alone; NaN in a direction without a curve."""
        return thrust_both_ways(*self.both_ways, n)

    @cached_property
    def estimates(self) -> dict[str, dict[str, Estimate | Given]]:
        """Estimates of every direction's curve ("both" where they share one), by parameter."""
        return {
            name: curve_estimates(side, form, self.curves[name], self.at_bound[name])
            for name, (_, side, form) in self.sides.items()
        }

    def parameters_json(self) -> dict[str, object]:
        """Lay out the parameters of both directions, or those of "both" for each; null for one without."""
        result: dict[str, object] = {}
        for (side, _), curve in zip(SIDES, self.both_ways):
            values = self.estimates.get(side) or self.estimates.get("both", {})
            result[side] = curve and curve.layout({name: value.to_json() for name, value in values.items()})
        return result

    @property
    def multipliers(self) -> Floats:
        """Derivatives of the thrust [N] by the voltage's power and by the sag, (P, 2)."""
        data = self.data
        volts = np.log(data.voltage / self.reference) if data.by_voltage else np.zeros(len(data))
        return np.stack([self.predicted * volts, -self.predicted * data.order / (1.0 - self.sag * data.order)], axis=1)

    def stderr(self, column: Floats, steps: bool = False) -> tuple[float, float]:
        """Return the standard error of one parameter by its own derivative (P,) and its degrees of freedom: by levels,
        or by voltage `steps` if that is more."""
        data, errors = self.data, list[tuple[float, float]]()
        for unit, fitted in ((data.level, 1), *([(data.step, 2)] if steps else [])):
            total = sums_of(data.weight * column * self.residual, unit)
            size = np.sqrt(total @ total * len(total) / max(len(total) - 1, 1)) / (data.weight @ column**2)
            errors.append((float(size), len(total) - fitted))
        return max(errors)

    @property
    def voltage_power(self) -> Estimate:
        """Power of the voltage that thrust follows at a fixed command."""
        return Estimate.from_stderr(self.power, *self.stderr(self.multipliers[:, 0], steps=True), "1")

    @property
    def squares(self) -> float:
        return float(self.data.weight @ self.residual**2)

    @property
    def can_leave_out(self) -> bool:
        return all(side.can_leave_out(form) for _, side, form in self.sides.values())

    @cached_property
    def left_out(self) -> tuple[Floats, Floats, float]:
        """Squares [N²] of each group, in rising number, predicted by fits without its level; of points between others
        alone, as beyond its ends a spline cannot know more than a straight line; and the weight of these points."""
        squares, between = np.zeros((2, len(self.data)))
        for index, side, form in self.sides.values():
            squares[index], between[index] = left_out_squares(side, form), side.is_between
        every, inner = (sums_of(x, self.data.group) for x in (squares, squares * between))
        return every, inner, float(self.data.weight @ between)

    @property
    def loss(self) -> Floats:
        return self.left_out[0]

    def _root_mean(self, squares: float) -> float:
        data = self.data
        return float(np.sqrt((squares + data.zero_squares) / (data.weight.sum() + data.zero_weight)))

    @property
    def rmse(self) -> float:
        """Root mean square error [N], weighted as in the fit."""
        return self._root_mean(self.squares)

    @property
    def left_out_rmse(self) -> float:
        """The same at levels left out."""
        return self._root_mean(float(self.loss.sum()))

    @property
    def cv_rmse(self) -> float | None:
        """`left_out_rmse`, None where a direction has few levels."""
        return self.left_out_rmse if self.can_leave_out else None

    @property
    def between_rmse(self) -> float | None:
        """Error [N] at levels left out between others, None where a direction has few levels."""
        return float(np.sqrt(self.left_out[1].sum() / self.left_out[2])) if self.can_leave_out else None

    @property
    def error(self) -> float:
        """Error [N] to tell: of a form that passes through each level that at levels left out."""
        between = self.between_rmse if self.form.interpolates else None
        return self.rmse if between is None else between

    @property
    def parameters(self) -> int:
        """Fitted parameters in a direction; of a spline in the one with more levels."""
        return max(len(form.free(self.curves[name])) for name, form in self.shape.forms)


def fit_shape(data: BollardData, shape: Shape) -> MapFit:
    """Fit a shape by least squares: curves direction by direction, in turn with what multiplies them, which takes a
    Gauss-Newton step with the amplitudes free beside it."""
    fit = MapFit(data, shape, {}, {}, reference=float(np.median(data.voltage)) if data.by_voltage else 1.0)
    free, root = [shape.voltage, shape.sag], np.sqrt(data.weight)
    for _ in range(ALTERNATIONS if any(free) else 1):
        curves, at_bound = dict[str, Curve](), dict[str, tuple[str, ...]]()
        for name, (_, side, form) in fit.sides.items():
            curves[name], at_bound[name] = form.fit(side.n, side.force, side.weight)
        fit, step = replace(fit, curves=curves, at_bound=at_bound), np.zeros(2)
        if any(free):
            sides = [np.where(data.n * sign > 0, fit.predicted, 0.0)[:, None] for _, sign in SIDES]
            columns = np.hstack([fit.multipliers[:, free], *sides])
            step[free] = np.linalg.lstsq(root[:, None] * columns, root * fit.residual, rcond=None)[0][: sum(free)]
            power, sag = np.clip(np.array([fit.power, fit.sag]) + step, [-4.0, -0.9], [4.0, 0.9])
            fit = replace(fit, power=float(power), sag=float(sag))
    return fit


def left_out_squares(side: BollardData, form: Form) -> Floats:
    """Weighted squared error [N²] of each point of a direction, (P,), predicted by a fit without its fold."""
    numbers, place = np.unique(folds_of(side.n), return_inverse=True)
    weights = np.where(place == np.arange(len(numbers))[:, None], 0.0, side.weight)
    predicted = form.predictions(side.n, side.force, weights)
    return side.weight * (side.force - predicted[place, np.arange(len(place))]) ** 2


def sums_of(values: Floats, group: Ints) -> Floats:
    """Sum of what each group has of `values` (P,), by rising number, (G,)."""
    return np.bincount(np.unique(group, return_inverse=True)[1], weights=values).astype(np.float64)
