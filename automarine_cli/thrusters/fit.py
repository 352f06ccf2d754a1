"""One direction fitted: the square law (equation 2) and the parameters of a form, with intervals."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.thrusters.curves import HIGH, LOW, Fits, fit_direction
from automarine_cli.thrusters.forms import SIDES, SQUARE, Curve, Form
from automarine_cli.thrusters.points import Ints, Points, groups_of

FEWEST_LEVELS = 3
ENOUGH_RECORDS = 4  # records from which their scatter alone carries an interval
PLAIN, UNBIASED, JACKKNIFE = 0.0, 0.5, 1.0


@dataclass(frozen=True)
class Side:
    """Points of one direction with positive thrust: |n| [unit of n], thrust [N], weights, all of shape (P,).

    `stderr` [N] is the standard error of each point's own samples, 0 where it is one reading;
    `group` numbers what counts as one independent measurement (a level, see `groups_of`); `record` numbers
    the test records or voltage steps where there are enough of them to be a second source of scatter, else
    None.
    """

    name: str
    sign: float
    magnitude: Floats
    thrust: Floats
    weight: Floats
    group: Ints
    record: Ints | None
    stderr: Floats
    tare_stderr: float

    @property
    def groups(self) -> int:
        """How many independent levels or blocks of levels."""
        return len(np.unique(self.group))


@dataclass(frozen=True)
class Parameter:
    """One parameter of a fitted curve: its estimate; or its value and `why` it has no interval; or a value that the
    form fixes. The value is None for a saturation beyond what was measured."""

    value: float | None
    unit: str = ""
    estimate: Estimate | None = None
    why: str = ""

    @classmethod
    def of(cls, estimate: Estimate) -> "Parameter":
        """One with an interval."""
        return cls(estimate.value, estimate.unit, estimate)

    @property
    def fixed(self) -> bool:
        """Whether the form says what it is."""
        return self.estimate is None and not self.why

    def to_json(self) -> object:
        """The contract's form of an estimate; a plain number where it is fixed."""
        if self.estimate is not None:
            return self.estimate.to_json()
        nothing = {"value": self.value, "stderr": None, "ci95": None, "unit": self.unit, "at_bound": self.why}
        return self.value if self.fixed else nothing


def sides_of(points: Points, step: Ints | None, tare_stderr: float) -> dict[str, Side]:
    """Both directions of the points; a direction without points is left out."""
    sides = {}
    for name, sign in SIDES:
        here = points.n * sign > 0
        if not np.any(here):
            continue
        kept = points.where(here)
        group = groups_of(np.abs(kept.n))
        record = _crossed(group, step[here] if step is not None else kept.record)
        own = np.nan_to_num(kept.stderr)
        values = (np.abs(kept.n), sign * kept.force, kept.weight, group, record, own)
        sides[name] = Side(name, sign, *values, tare_stderr)
    return sides


def _crossed(group: Ints, record: Ints) -> Ints | None:
    """Test records as a second way to cluster, where each of several covers several levels."""
    numbers = np.unique(record)
    if len(numbers) < 2 or any(len(np.unique(group[record == number])) < FEWEST_LEVELS for number in numbers):
        return None
    return record


def square_law(side: Side, unit: str) -> Estimate:
    """Coefficient a of F = a |n| n (equation 2) [`unit`] by least squares through zero."""
    x = side.magnitude**2
    value = float((side.weight * x) @ side.thrust / ((side.weight * x) @ x))
    return _estimates(side, x[:, None], side.thrust - value * x, np.array([value]), (unit,), UNBIASED)[0]


def curve_of(fits: Fits, row: int = 0) -> Curve:
    """One row of a batch of fits as a curve in the unit of the control signal."""
    amplitude, dead, power, top = (float(value) for value in fits.values[row])
    a = amplitude / ((1.0 - dead) * fits.scale) ** power
    return Curve(a, power, dead * fits.scale, None if top >= HIGH[3] else top * fits.scale)


def best_curve(side: Side, form: Form) -> tuple[Curve, tuple[str, ...]]:
    """Least-squares curve of a form, and the names of its parameters that ended at a bound."""
    fits = fit_direction(side.magnitude, side.thrust, side.weight[None, :], form)
    at_bound = []
    for index, name in ((1, "n_0"), (2, "p"), (3, "n_sat")):
        value = fits.values[0, index]
        if name in form.free and (value <= LOW[index] + 1e-9 or value >= HIGH[index] - 1e-9):
            at_bound.append(name)
    return curve_of(fits), tuple(at_bound)


def parameters(side: Side, form: Form, curve: Curve, at_bound: tuple[str, ...], n_unit: str) -> dict[str, Parameter]:
    """Estimates of the form's parameters by name; one at its bound has no standard error and says so."""
    level = side.magnitude if curve.n_sat is None else np.minimum(side.magnitude, curve.n_sat)
    above = np.maximum(level - curve.n_0, 0.0)
    on = above > 0.0
    safe = np.where(on, above, 1.0)
    slope = np.where(on, curve.a * curve.p * safe ** (curve.p - 1.0), 0.0)
    derivative = {
        "a": np.where(on, safe**curve.p, 0.0),
        "p": np.where(on, curve.a * safe**curve.p * np.log(safe), 0.0),
        "n_0": -slope,
        "n_sat": np.where(side.magnitude >= (curve.n_sat or np.inf), slope, 0.0),
    }
    values = {"a": curve.a, "p": curve.p, "n_0": curve.n_0, "n_sat": curve.n_sat}
    units = {"a": amplitude_unit(n_unit, curve.p), "p": "", "n_0": n_unit or "n", "n_sat": n_unit or "n"}
    free = [name for name in form.free if name not in at_bound and np.any(derivative[name] != 0.0)]
    residual = side.thrust - curve.thrust(side.magnitude)
    found = _estimates(
        side,
        np.stack([derivative[name] for name in free], axis=1),
        residual,
        np.array([values[name] for name in free], dtype=float),
        tuple(units[name] for name in free),
        UNBIASED if free == ["a"] else JACKKNIFE,
    )
    result = {name: Parameter(value, units[name]) for name, value in values.items()}
    result |= {name: Parameter.of(estimate) for name, estimate in zip(free, found)}
    for name in form.free:
        if name not in free:
            why = "no saturation within the measured range" if name == "n_sat" else "at the end of its range"
            result[name] = Parameter(values[name], units[name], why=why)
    return result


def amplitude_unit(n_unit: str, power: float = SQUARE) -> str:
    """Unit of the amplitude: N over the control signal's unit to the exponent."""
    base = n_unit or "n"
    base = f"({base})" if any(character in base for character in "/ ·") else base
    return f"N/{base}²" if power == SQUARE else f"N/{base}^p"


def _estimates(
    side: Side, matrix: Floats, residual: Floats, values: Floats, units: tuple[str, ...], freed_by: float
) -> tuple[Estimate, ...]:
    """Estimates with cluster-robust standard errors; `matrix` is the derivative of the thrust, shape (P, K).

    Clusters are levels; where records or voltage steps cross them, both (Cameron, Gelbach & Miller 2011,
    J. Bus. Econ. Stat. 29:238), never less than the levels alone say. The tare's own error is common to all
    points.
    """
    size = np.sqrt(np.sum(matrix**2, axis=0))
    scaled = matrix / size
    root = np.sqrt(side.weight)
    rows, errors = root[:, None] * scaled, root * residual
    inverse = np.linalg.pinv(rows.T @ rows)
    variance, dof = _clustered(rows, errors, inverse, side.group, freed_by)
    if side.record is not None:
        both = np.unique(np.stack([side.group, side.record]), axis=1, return_inverse=True)[1].ravel()
        of_both, _ = _clustered(rows, errors, inverse, both.astype(np.int64), freed_by)
        many = len(np.unique(side.record)) >= ENOUGH_RECORDS
        of_records, dof_records = _clustered(rows, errors, inverse, side.record, freed_by if many else PLAIN)
        if many:
            variance = np.maximum(variance, variance + of_records - of_both)
            dof = np.minimum(dof, dof_records)
        # Gains of two records that lie either side of their mean cancel in every level, not in these.
        variance = np.maximum(variance, np.maximum(of_records, of_both))
    # A few levels may agree by chance better than the samples behind them allow.
    variance = np.maximum(variance, (inverse @ (rows * root[:, None]).T) ** 2 @ side.stderr**2)
    tare = inverse @ (rows.T @ root) * side.tare_stderr
    stderr = np.sqrt(variance + tare**2) / size
    return tuple(Estimate.from_stderr(*column) for column in zip(values, stderr, dof, units))


def _clustered(rows: Floats, errors: Floats, inverse: Floats, group: Ints, freed_by: float) -> tuple[Floats, Floats]:
    """Variances of the parameters and their degrees of freedom, both of shape (K,).

    Each cluster's residuals are freed of their own leverage by that power of what it leaves: UNBIASED is HC2 with one
    point a cluster (MacKinnon & White 1985), else its cluster form CR2, right for a straight line; JACKKNIFE is HC3
    and CR3, wider, for forms that bend; PLAIN is the sandwich itself, for two or three clusters, of which a correction
    would say only that they are few. The degrees of freedom are Satterthwaite's for independent equal errors (Bell &
    McCaffrey 2002; Pustejovsky & Tipton 2018, J. Bus. Econ. Stat. 36:672): a square law rests on its few highest
    levels, so that they are far fewer than the levels.
    """
    variance, effects = np.zeros(len(inverse)), []
    for number in np.unique(group):
        here = group == number
        own = rows[here]
        share, axes = np.linalg.eigh(own @ inverse @ own.T)
        left = (1.0 - np.minimum(share, 0.99)) ** freed_by
        freed = (axes / left) @ axes.T @ own @ inverse  # (points here, K)
        variance += (errors[here] @ freed) ** 2
        effect = -rows @ (inverse @ (own.T @ freed))
        effect[here] += freed
        effects.append(effect)
    stacked = np.stack(effects, axis=2)  # (points, K, clusters)
    between = np.einsum("pkg,pkh->kgh", stacked, stacked)
    trace = np.einsum("kgg->k", between)
    return variance, trace**2 / np.maximum(np.sum(between**2, axis=(1, 2)), 1e-300)
