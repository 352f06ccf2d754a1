"""Points of a bollard test -> square law (equation 2), the form chosen by cross-validation, its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import usual_neutral
from automarine_cli.text import plural
from automarine_cli.thrusters.bollard_data import Ints, Points, folds_of, groups_of, levels_of
from automarine_cli.thrusters.curves import FORMS, Curve, Form, amplitude_unit
from automarine_cli.thrusters.map import SIDES, ThrusterMap, thrust_both_ways

MIN_LEVELS = 3
ENOUGH_RECORDS = 4  # records from which their scatter alone carries an interval
ENOUGH_REPEATS = 6  # degrees of freedom among repeats from which their scatter does
PLAIN, UNBIASED, JACKKNIFE = 0.0, 0.5, 1.0


@dataclass(frozen=True)
class Side:
    """Points of one direction with positive thrust: |n| [unit of n], thrust [N], weights, all of shape (P,).

    `index` is their place among all points; `stderr` [N] is of each point's own samples, 0 for one reading; `group`
    numbers what counts as one independent measurement (see `groups_of`); `record` the test records or voltage steps,
    where these are a second source of scatter, else None."""

    name: str
    sign: float
    magnitude: Floats
    thrust: Floats
    weight: Floats
    group: Ints
    record: Ints | None
    stderr: Floats
    tare_stderr: float
    index: Ints

    @property
    def levels(self) -> int:
        return int(levels_of(self.magnitude).max()) + 1

    @property
    def is_between(self) -> Floats:
        """1 for a point of any level but the highest, else 0, (P,)."""
        level = levels_of(self.magnitude)
        return np.asarray(level < level.max(), dtype=float)

    def can_leave_out(self, form: Form) -> bool:
        return len(np.unique(self.group)) >= form.least_groups

    def without(self, gain: Floats) -> "Side":
        """The side as it would have been without what multiplies its thrust."""
        return replace(self, thrust=self.thrust / gain, weight=self.weight * gain**2)


def value_json(value: Estimate | Given) -> object:
    """The contract's form; a plain number where nothing says why it has no interval."""
    if isinstance(value, Estimate):
        return value.to_json()
    nothing = {"value": value.value, "stderr": None, "ci95": None, "unit": value.unit, "at_bound": value.at_bound}
    return nothing if value.at_bound else value.value


def parameters_json(
    parameters: Mapping[str, Mapping[str, Estimate | Given]], curves: Sequence[Curve | None]
) -> dict[str, object]:
    """Lay out the parameters of both directions, null for one without."""
    return {
        side: curve and curve.layout({name: value_json(value) for name, value in parameters[side].items()})
        for (side, _), curve in zip(SIDES, curves)
    }


def sides_of(points: Points, step: Ints | None, tare_stderr: float) -> dict[str, Side]:
    """Both directions of the points; a direction without points is left out."""
    sides = {}
    for name, sign in SIDES:
        inside = points.n * sign > 0
        if np.any(inside):
            part = points.where(inside)
            group, record = groups_of(np.abs(part.n)), part.record if step is None else step[inside]
            levels = [len(np.unique(group[record == number])) for number in np.unique(record)]
            crossed = len(levels) > 1 and min(levels) >= MIN_LEVELS
            sides[name] = Side(
                name, sign, magnitude=np.abs(part.n), thrust=sign * part.force, weight=part.weight, group=group,
                record=record if crossed else None, stderr=np.nan_to_num(part.stderr), tare_stderr=tare_stderr,
                index=np.flatnonzero(inside),
            )  # fmt: skip
    return sides


def square_law(side: Side, unit: str) -> Estimate:
    """Coefficient a of F = a |n| n (equation 2) [`unit`] by least squares through zero."""
    x = side.magnitude**2
    value = float((side.weight * x) @ side.thrust / ((side.weight * x) @ x))
    return _estimates(side, x[:, None], side.thrust - value * x, np.array([value]), (unit,), UNBIASED)[0]


def curve_estimates(
    side: Side, form: Form, curve: Curve, at_bound: tuple[str, ...], n_unit: str
) -> dict[str, Estimate | Given]:
    """Return estimates of a curve's parameters by name; one at its bound has no standard error and says so, one that
    the form fixes is a plain number (None: no saturation)."""
    values, units, slopes = curve.values, curve.units(n_unit), curve.slopes(side.magnitude)
    free = [name for name in form.free(curve) if name not in at_bound and np.any(slopes[name] != 0.0)]
    matrix, fitted = np.stack([slopes[name] for name in free], axis=1), np.array([values[name] for name in free])
    of_units = tuple(units[name] for name in free)
    if form.interpolates:
        estimates = _level_estimates(side, matrix, fitted, of_units, form)
    else:
        residual, freed_by = side.thrust - curve.thrust(side.magnitude), UNBIASED if free == ["a"] else JACKKNIFE
        estimates = _estimates(side, matrix, residual, fitted, of_units, freed_by)
    result: dict[str, Estimate | Given] = {name: Given(value, unit=units[name]) for name, value in values.items()}
    result |= zip(free, estimates)
    for name in set(form.free(curve)) - set(free):
        why = "no saturation within the measured range" if name == "n_sat" else "at the end of its range"
        result[name] = Given(values[name], unit=units[name], at_bound=why)
    return result


def _level_estimates(
    side: Side, matrix: Floats, values: Floats, units: tuple[str, ...], form: Form
) -> tuple[Estimate, ...]:
    """Estimates of means of levels (K,); `matrix` (P, K) says whose a point is. Scatter is pooled over repeats at one
    command, with too few of them over levels left out between others, which misses by the bend of the curve too."""
    level = levels_of(side.magnitude)
    mean = np.bincount(level, side.weight * side.thrust) / np.bincount(level, side.weight)
    squares, dof = side.weight * (side.thrust - mean[level]) ** 2, len(level) - len(mean)
    if dof < ENOUGH_REPEATS:
        squares, dof = left_out_squares(side, form) * side.is_between, max(len(mean) - 1, 1)
    variance = squares.sum() / dof / np.maximum(side.weight @ matrix, 1e-300)
    variance = np.maximum(variance, (side.weight * side.stderr) ** 2 @ matrix / (side.weight @ matrix) ** 2)
    stderr = np.sqrt(variance + side.tare_stderr**2)
    return tuple(Estimate.from_stderr(value, error, dof, unit) for value, error, unit in zip(values, stderr, units))


def _estimates(
    side: Side, matrix: Floats, residual: Floats, values: Floats, units: tuple[str, ...], freed_by: float
) -> tuple[Estimate, ...]:
    """Estimates with cluster-robust standard errors; `matrix` is the derivative of the thrust, shape (P, K).

    Clusters are levels; where records or voltage steps cross them, both (Cameron, Gelbach & Miller 2011, J. Bus. Econ.
    Stat. 29:238), never less than the levels alone say. The tare's own error is common to all points."""
    size = np.sqrt(np.sum(matrix**2, axis=0))
    scaled = matrix / size
    root = np.sqrt(side.weight)
    rows, errors = root[:, None] * scaled, root * residual
    inverse = np.linalg.pinv(rows.T @ rows)
    variance, dof = _clustered(rows, errors, inverse, side.group, freed_by)
    if side.record is not None:
        crossed = np.unique(np.stack([side.group, side.record]), axis=1, return_inverse=True)[1].ravel()
        of_both, _ = _clustered(rows, errors, inverse, crossed.astype(np.int64), freed_by)
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


EQUAL = 1e-5  # errors below this share of full scale are rounding, not evidence
CLEAR = 4.0  # deviance from which a form is clearly behind: two standard errors, were the errors normal


@dataclass(frozen=True)
class FormScore:
    """One form; errors [N] over all points, weighted as in the fit; `cv_rmse` at levels left out, `between_rmse` at
    those between others, None where a direction has few levels; `within_reach`: no other form is clearly better."""

    form: Form
    curves: dict[str, Curve]
    at_bound: dict[str, tuple[str, ...]]
    rmse: float
    cv_rmse: float | None
    between_rmse: float | None
    within_reach: bool = False

    @property
    def both_ways(self) -> tuple[Curve | None, Curve | None]:
        return self.curves.get("forward"), self.curves.get("backward")

    @property
    def error(self) -> float:
        """Error [N] to tell: of a form that passes through each level that at levels left out."""
        return self.between_rmse if self.form.interpolates and self.between_rmse is not None else self.rmse

    @property
    def parameters(self) -> int:
        """Fitted parameters in a direction; of a spline in the one with more levels."""
        return max(len(self.form.free(curve)) for curve in self.curves.values())


def select_form(
    sides: dict[str, Side], zero_squares: float, total_weight: float, full_scale: float, forced: str | None = None
) -> tuple[tuple[FormScore, ...], FormScore, str]:
    """All forms in the order of the family, the one that is chosen, and why in a sentence, by leave-one-level-out
    cross-validation: the simplest equation that is not clearly behind the best; a spline only where the best is clearly
    behind it, and by more than a standard error over levels (Breiman et al. 1984, section 3.4.3).

    The spline is compared at levels between others: beyond its ends it cannot know more than a straight line.
    `zero_squares` [N^2] and `total_weight` carry the points at zero command, where every form says zero."""
    scores, every, inner = dict[str, FormScore](), dict[str, Floats](), dict[str, Floats]()
    inner_weight = sum(float(side.weight @ side.is_between) for side in sides.values())
    for form in FORMS.values():
        curves, bounds, squares, cross, between = {}, {}, zero_squares, None, None
        for name, side in sides.items():
            curves[name], bounds[name] = form.fit(side.magnitude, side.thrust, side.weight)
            squares += float(side.weight @ (side.thrust - curves[name].thrust(side.magnitude)) ** 2)
        if all(side.can_leave_out(form) for side in sides.values()):
            every[form.name], inner[form.name] = _losses(sides, form)
            cross = float(np.sqrt((zero_squares + every[form.name].sum()) / total_weight))
            between = float(np.sqrt(inner[form.name].sum() / inner_weight))
        rmse = float(np.sqrt(squares / total_weight))
        scores[form.name] = FormScore(form, curves, bounds, rmse, cross, between)
    if not every:
        chosen = scores[forced or next(iter(scores))]
        return tuple(scores.values()), chosen, f"The {chosen.form.name} form is used: too few levels to leave one out."
    rounding = total_weight * (EQUAL * full_scale) ** 2
    equations = [name for name in every if not FORMS[name].interpolates]
    best = min(equations, key=lambda name: (every[name].sum(), scores[name].parameters))
    reach = [name for name in equations if _deviance(every[name], every[best], rounding) <= CLEAR]
    for name in every.keys() - equations:
        behind, stderr = behind_of(inner[best], inner[name])
        if behind > stderr and _deviance(inner[best], inner[name], rounding) > CLEAR:
            reach = [name]
    scores = {name: replace(score, within_reach=name in reach) for name, score in scores.items()}
    simplest = min((scores[name] for name in reach), key=lambda score: (score.parameters, score.cv_rmse))
    chosen = scores[forced or simplest.form.name]
    because = f"The {forced} form was asked for (--form); cross-validation would choose {simplest.form.name}."
    if forced is None:
        because = _sentence(simplest, scores[best], full_scale)
    if chosen.form.interpolates:
        because += f" Beyond its levels it is {chosen.form.beyond}."
    return tuple(scores.values()), chosen, because


def _losses(sides: Mapping[str, Side], form: Form) -> tuple[Floats, Floats]:
    """Left-out squares [N²] by groups, (G,): of all levels, and of those between others."""
    of_sides = [(side, left_out_squares(side, form)) for side in sides.values()]
    every = np.concatenate([sums_of(squares, side.group) for side, squares in of_sides])
    return every, np.concatenate([sums_of(squares * side.is_between, side.group) for side, squares in of_sides])


def _deviance(loss: Floats, other: Floats, rounding: float) -> float:
    """Deviance by which left-out squares of groups, (G,), are behind another form's; `rounding` [N²] is no evidence."""
    return float(len(loss) * np.log((loss.sum() + rounding) / (other.sum() + rounding)))


def left_out_squares(side: Side, form: Form) -> Floats:
    """Weighted squared error [N²] of each point, (P,), predicted by a fit without its fold."""
    numbers, place = np.unique(folds_of(side.magnitude), return_inverse=True)
    weights = np.where(place == np.arange(len(numbers))[:, None], 0.0, side.weight)
    predicted = form.predictions(side.magnitude, side.thrust, weights)
    return side.weight * (side.thrust - predicted[place, np.arange(len(place))]) ** 2


def sums_of(values: Floats, group: Ints) -> Floats:
    """Sum of what each group has of `values` (P,), by rising number, (G,)."""
    return np.bincount(np.unique(group, return_inverse=True)[1], weights=values).astype(np.float64)


def behind_of(loss: Floats, other: Floats) -> tuple[float, float]:
    """Left-out squares [N²] more than another fit's, by groups (G,), and the standard error of that over groups."""
    gap = loss - other
    return float(gap.sum()), float(np.sqrt(len(gap)) * np.std(gap, ddof=1)) if len(gap) > 1 else np.inf


def _sentence(chosen: FormScore, best: FormScore, full_scale: float) -> str:
    """Why a form is chosen; `best` is the best equation."""
    spline = chosen.form.interpolates
    errors = (score.between_rmse if spline else score.cv_rmse for score in (chosen, best))
    error, least = (f"{100.0 * (value or 0.0) / full_scale:.3g}" for value in errors)
    if spline:
        return (
            f"The {chosen.form.name} form is chosen, a curve through the mean of each level: at levels left out "
            f"between others its error is {error} % of full scale, that of the best equation, {best.form.name} "
            f"({best.parameters}), {least} %."
        )
    parameters = f"{plural(chosen.parameters, 'parameter')} per direction"
    return (
        f"The {chosen.form.name} form is chosen: {parameters}, cross-validated error {error} % of full scale. It is "
        f"the simplest not clearly behind the best, {best.form.name} ({best.parameters}, {least} %)."
    )


OPPOSITE = (
    "thrust has the opposite sign of the control signal; if ahead is logged as negative force, write "
    'force_N = { from = "NAME", sign = -1 } under [columns] in the --columns file'
)
ROUNDING = 1e-12  # errors below this share of full scale are zero
MIXED = 0.2  # share of readings with thrust of either sign from which a direction is two directions
FAINT = 0.05  # thrust the wrong way that is smaller than this share of full scale is "none", not a sign error


@dataclass(frozen=True)
class Analysis:
    """What one set of points says of one thruster: `square` law (equation 2) and the chosen form's `parameters` by
    direction, `without` why a direction has none; `r2` is the square law's, weighted as in the fit."""

    points: Points
    n_unit: str
    full_scale: float
    sides: dict[str, Side]
    square: dict[str, Estimate]
    without: dict[str, str]
    scores: tuple[FormScore, ...]
    chosen: FormScore
    because: str
    parameters: dict[str, dict[str, Estimate | Given]]
    r2: float
    chosen_r2: float

    @property
    def law(self) -> FormScore:
        """The square law."""
        return self.scores[0]

    @property
    def levels(self) -> dict[str, int]:
        return {name: side.levels for name, side in self.sides.items()}

    @property
    def estimates(self) -> dict[tuple[str, str], Estimate | Given]:
        free = {side: self.chosen.form.free(curve) for side, curve in self.chosen.curves.items()}
        return {(key, side): of[key] for side, of in self.parameters.items() for key in free[side]}

    @property
    def map(self) -> ThrusterMap:
        return ThrusterMap(self.chosen.form.name, *self.chosen.both_ways, self.n_unit, self.points.n_range)

    def fitted(self, n: Floats, square: bool = False) -> Floats:
        """Thrust [N] by the chosen form or the square law, shape of n; NaN in a direction that has no fit."""
        return thrust_both_ways(*(self.law if square else self.chosen).both_ways, n)

    def over_all(self, score: FormScore) -> float:
        """Root mean square error [N] of a form over all points, those that contradict their neighbours alike."""
        off = self.points.force - thrust_both_ways(*score.both_ways, self.points.n)
        return float(np.sqrt(np.nanmean(off**2)))

    def percent(self, value: float | None) -> float | None:
        if value is None:
            return None
        return 0.0 if value < ROUNDING * self.full_scale else 100.0 * value / self.full_scale


def analyse(
    points: Points, step: Ints | None, tare_stderr: float, n_unit: str, forced: str | None = None,
    where: str = "the logs",
) -> Analysis:  # fmt: skip
    """Fit both directions of `points` (one thruster, tared, flagged); `step` numbers the voltage steps, (P,).

    Raises FitError where no direction can be fitted: no thrust, thrust against the command, too few levels."""
    full_scale = points.full_scale
    if len(points) == 0 or full_scale == 0.0:
        check = "Check that the force column is the load cell's"
        raise FitError(f"{where}: every thrust is zero; expected pulls at several commands. {check}")
    sides = sides_of(points, step, tare_stderr)
    without = _refused_directions(sides, full_scale, where)
    sides = {name: side for name, side in sides.items() if name not in without}
    if not sides:
        expected = f"expected at least {MIN_LEVELS} different commands in one direction. Pull at more levels"
        raise FitError(f"{where}: no direction can be fitted ({'; '.join(without.values())}); {expected}")
    square = {name: square_law(side, amplitude_unit(n_unit)) for name, side in sides.items()}
    used = points.where(np.isin(np.sign(points.n), [0.0, *(side.sign for side in sides.values())]))
    zero = used.n == 0.0
    zero_squares = float(used.weight[zero] @ used.force[zero] ** 2)
    total = float(used.weight.sum())
    scores, chosen, because = select_form(sides, zero_squares, total, full_scale, forced)
    estimates = {
        name: curve_estimates(side, chosen.form, chosen.curves[name], chosen.at_bound[name], n_unit)
        for name, side in sides.items()
    }
    mean = float(used.weight @ used.force) / total
    spread = float(used.weight @ (used.force - mean) ** 2) / total
    r2 = (1.0 - score.rmse**2 / spread for score in (scores[0], chosen))
    return Analysis(points, n_unit, full_scale, sides, square, without, scores, chosen, because, estimates, *r2)


def _refused_directions(sides: dict[str, Side], full_scale: float, where: str) -> dict[str, str]:
    """Why a direction has no fit. Raises FitError where thrust opposes the command."""
    without, against = {}, []
    for name, _ in SIDES:
        if name not in sides:
            without[name] = f"no {name} points"
            continue
        side = sides[name]
        count = side.levels
        ahead, astern = (np.mean(sign * side.thrust > FAINT * full_scale) for sign in (1.0, -1.0))
        if min(ahead, astern) > MIXED:
            raise FitError(
                f"{where}: commands of one sign push both ways; the control signal looks counted from its "
                'end, not from rest, or without its sign. Write n = { from = "NAME", subtract = REST } (a pulse width '
                'rests at about 1500), or n = { from = "NAME", sign_from = "COLUMN" } where another column says the '
                "direction, under [columns] in the --columns file"
            )
        low, high, thrust = float(side.magnitude.min()), float(side.magnitude.max()), np.abs(side.thrust)
        if len(sides) == 1 and low > 0.5 * high and thrust.min() < FAINT * thrust.max():
            idle = usual_neutral(low, high, float(side.magnitude[np.argmin(thrust)]))
            raise FitError(
                f"{where}: commands go from {low:.4g} to {high:.4g} and the thruster gives nothing at {idle:.4g}; the "
                'control signal looks counted from its end, not from rest. Write n = { from = "NAME", subtract = '
                f"{idle:.4g} }} under [columns] in the --columns file"
            )
        mean = float((side.weight * side.magnitude**2) @ side.thrust / (side.weight @ side.magnitude**2))
        if count < MIN_LEVELS:
            without[name] = f"{count} {name} level{'s' if count > 1 else ''}, at least {MIN_LEVELS} needed"
        elif -FAINT * full_scale <= mean <= 0.0:
            without[name] = f"no {name} thrust measured"
        elif mean < 0.0:
            against.append(name)
    if against and set(against) == set(sides) - set(without):
        raise FitError(f"{where}: {OPPOSITE}")
    if against:
        raise FitError(
            f"{where}: {against[0]} thrust has the sign of the other direction; it looks logged as a "
            'magnitude. Write force_N = { from = "NAME", sign_from = "COLUMN" } with a column that says the direction '
            "under [columns] in the --columns file, or give thrust astern a minus sign in the log"
        )
    return without
