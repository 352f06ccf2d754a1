"""The family of thruster maps that a diagnosis searches: a curve in each direction, and what multiplies both.

A candidate adds one effect to a map. It is fitted by least squares, scored by its likelihood ratio beside what chance
gives, and judged by levels left out of the fit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.errors import FitError
from automarine_cli.fits.stepwise import Chance, Judge, stepwise_search
from automarine_cli.quantities import Floats
from automarine_cli.thrusters import bollard_data as bollard
from automarine_cli.thrusters.bollard_data import Ints, Points, ThrusterLogs, left_out, levels_of, neighbour_weights
from automarine_cli.thrusters.curves import CURVE_EFFECTS, Curve, Form
from automarine_cli.thrusters.fit import OPPOSITE, Side, behind_of, left_out_squares, sides_of, sums_of
from automarine_cli.thrusters.map import SIDES, thrust_both_ways

ASYMMETRY, VOLTAGE, SAG = "thrust-asymmetry", "voltage-exponent", "battery-sag"
MIN_LEVELS = 5  # levels in a direction from which a curve with a second parameter can be told from chance
MIN_LEVELS_TO_HOLD_OUT = 10  # levels in a direction from which a quarter of them is held out
MIN_REPEATS = 6  # degrees of freedom among repeats from which their own scatter is the noise level
SAME_COMMAND = 1e-6  # commands that differ by less than this share of full scale are the same command
MAX_EXPLAINED = 0.8  # share of the run order that the levels explain from which a drift cannot be told from the curve
ALPHA, NULLS = 0.01, 1999
"""Share of tables without a missing effect in which one may be named; fewer cannot be told with eight levels."""
MAX_EFFECTS = 3
ALTERNATIONS = 6  # rounds of curves and what multiplies them; they hardly depend on each other
ROUNDING = 1e-6  # errors below this share of full scale are rounding, not evidence
NEEDLESS = 0.5  # standard errors by which cross-validation may get worse without an effect that is needless
BROKEN_WEIGHT, MAX_STRETCHES = 0.01, 2
SHORTEST_STRETCH = 3  # readings in sequence that make a faulty stretch
STEP_SHARE, STEP_NOISES = 0.03, 6.0
"""How sharply a faulty stretch begins and ends: share of full scale, and multiples of the noise level."""


@dataclass(frozen=True)
class BollardData(Points):
    """Measured points of one thruster, without those at zero command; all arrays have shape (P,).

    `step` numbers the voltage steps (None with one voltage or none), `level` signed commands at one voltage: the unit
    of chance, `group` what cross-validation leaves out; `order` runs from 0 to 1; `places` are the records' names."""

    step: Ints | None
    level: Ints
    group: Ints
    order: Floats
    tare_stderr: float
    n_unit: str
    places: tuple[str, ...]

    @property
    def sides(self) -> tuple[str, ...]:
        return tuple(name for name, sign in SIDES if np.any(self.n * sign > 0))

    @property
    def levels(self) -> int:
        return len(np.unique(self.level))

    def with_flags(self, index: Ints | NDArray[np.bool_], weight: Floats | float, flag: object) -> "BollardData":
        weights, flags = self.weight.copy(), self.flag.copy()
        weights[index], flags[index] = weight, flag
        return replace(self, weight=weights, flag=flags)

    def parts(self, tied: bool) -> dict[str, Side]:
        """The points of each direction, or of both together as one curve of |n| (`tied`)."""
        if not tied:
            return sides_of(self, self.step, self.tare_stderr)
        size, thrust = np.abs(self.n), np.sign(self.n) * self.force
        group, stderr, index = bollard.groups_of(size), np.nan_to_num(self.stderr), np.arange(len(self))
        return {"both": Side("both", 1.0, size, thrust, self.weight, group, None, stderr, self.tare_stderr, index)}

    def order_is_free(self) -> bool:
        """Whether the run order can be told from the command: then a drift with it can be a candidate."""
        n = self.n
        volts = [] if self.step is None else [self.voltage]
        matrix = np.stack([np.ones(len(n)), n, np.abs(n), n**2, n * np.abs(n), *volts], axis=1)
        residual = self.order - matrix @ np.linalg.lstsq(matrix, self.order, rcond=None)[0]
        return bool(np.ptp(self.order) > 0 and 1.0 - residual.var() / self.order.var() < MAX_EXPLAINED)

    def place(self, index: int) -> str:
        return self.places[int(self.record[index])]


def bollard_data(
    logs: ThrusterLogs, thrusters: int, n_unit: str, sides: Sequence[str], min_levels: int = MIN_LEVELS
) -> BollardData:
    """Make data of one thruster, contradictions flagged, tare off, of the `sides` with `min_levels` levels or more.
    Raises FitError where there is none, or thrust opposes the command."""
    points = bollard.reduce_series(list(logs.records)).points.divided(thrusters)
    step = bollard.voltage_steps(points.voltage)
    points, tare = bollard.subtract_tare(bollard.flag_contradictions(points, step))
    order = np.arange(len(points), dtype=float) / max(len(points) - 1, 1)
    keep, group = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=np.int64)
    for offset, (name, sign) in zip((0, 1000), SIDES):  # groups of both directions are numbered apart
        mask = points.n * sign > 0
        if name in sides and len(np.unique(levels_of(points.n[mask]))) >= min_levels:
            keep |= mask
            group[mask] = bollard.groups_of(np.abs(points.n[mask])) + offset
    if not np.any(keep):
        raise FitError(
            f"no direction of the map has {min_levels} different commands in the logs; a diagnosis needs a curve: "
            "pull at more levels, or give a map of the direction that was measured"
        )
    if float(points.weight[keep] @ (points.n * np.abs(points.n) * points.force)[keep]) <= 0.0:
        raise FitError(OPPOSITE)
    step = None if step is None or step.max() == 0 else step[keep]
    level = levels_of(points.n[keep])
    if step is not None:
        level = np.unique(np.stack([level, step]), axis=1, return_inverse=True)[1].ravel().astype(np.int64)
    places = tuple(record.place for record in logs.records)
    return BollardData(
        **vars(points.where(keep)), step=step, level=level, group=group[keep], order=order[keep],
        tare_stderr=tare.thrust_stderr, n_unit=n_unit, places=places,
    )  # fmt: skip


def held_out_levels(data: BollardData, seed: int) -> NDArray[np.bool_]:
    """Mark the points (P,) of the quarter of the levels that is held out: one of every four neighbours, never an end of
    the range; none where a direction has fewer than MIN_LEVELS_TO_HOLD_OUT levels."""
    random, out = np.random.default_rng(seed), np.zeros(len(data), dtype=bool)
    number = levels_of(data.n)
    levels = [np.unique(number[data.n * sign > 0]) for _, sign in SIDES]
    if any(0 < len(side) < MIN_LEVELS_TO_HOLD_OUT for side in levels):
        return out
    for inner in (side[1:-1] for side in levels):
        for start in range(0, len(inner) - 3, 4):
            out |= number == inner[start + int(random.integers(4))]
    return out


def noise_level(data: BollardData) -> tuple[float, str]:
    """Estimate the noise of a point [N] without a model, and say where it was read: repeats at one command where there
    are enough, else each level against its neighbours; never less than the standard errors of the plateaus."""
    stderr = data.stderr[np.isfinite(data.stderr)]
    samples = float(np.sqrt(np.mean(stderr**2))) if len(stderr) else 0.0
    squares, freedom = 0.0, 0
    for number in np.unique(data.level):
        repeats = data.where((data.level == number) & (data.flag == ""))
        # A measured speed is never the same twice: its neighbours are no repeats.
        if len(repeats) > 1 and np.ptp(repeats.n) <= SAME_COMMAND * np.max(np.abs(data.n)):
            squares += float(np.sum((repeats.force - repeats.force.mean()) ** 2))
            freedom += len(repeats) - 1
    if freedom >= MIN_REPEATS:
        noise, source = float(np.sqrt(squares / freedom)), "repeats at one command"
    else:
        noise, source = _roughness(data), "neighbouring levels"
    return (noise, source) if noise >= samples else (samples, "the samples of each plateau")


def _roughness(data: BollardData) -> float:
    """Root mean square over four ranges of |n| of the robust scatter [N] about neighbours, freed of their errors."""
    off, size = [], []
    for step in [0] if data.step is None else np.unique(data.step):
        for _, sign in SIDES:
            mask = (data.n * sign > 0) & (data.flag == "")
            mask &= True if data.step is None else data.step == step
            n = np.abs(data.n[mask])
            numbers = levels_of(n)
            place, thrust = (np.bincount(numbers, x) / np.bincount(numbers) for x in (n, sign * data.force[mask]))
            with_neighbours = np.sqrt(1.0 + np.sum(neighbour_weights(place) ** 2, axis=1))
            scatter = (thrust - left_out(place, thrust)) / with_neighbours
            off.append(scatter[np.isfinite(scatter)])
            size.append(place[np.isfinite(scatter)])
    scatter, place = np.abs(np.concatenate(off)), np.concatenate(size)
    if len(scatter) == 0:
        return 0.0
    ranges = np.array_split(scatter[np.argsort(place, kind="stable")], 4 if len(scatter) >= 20 else 1)
    return float(np.sqrt(np.mean([(1.4826 * np.median(part)) ** 2 for part in ranges])))


@dataclass(frozen=True)
class Shape:
    """Which effects act where: `forms` pairs each direction ("both": one curve for both) with the form of its curve.

    `voltage`: thrust follows the voltage to a power; `sag`: it falls evenly with the run order."""

    forms: tuple[tuple[str, Form], ...]
    voltage: bool = False
    sag: bool = False

    @property
    def tied(self) -> bool:
        return self.forms[0][0] == "both"

    @property
    def form(self) -> Form:
        """The form with the effects of all directions."""
        form = self.forms[0][1]
        return form.with_effects(frozenset().union(*(form.effects for _, form in self.forms)))

    @property
    def parameters(self) -> int:
        """Free parameters, those of a spline apart, to which no curve adds any."""
        return sum(1 + len(form.effects) for _, form in self.forms) + self.voltage + self.sag

    def effects_at(self, side: str) -> frozenset[str]:
        """Return the effects of the curve of a direction."""
        forms = dict(self.forms)
        form = forms.get(side) or forms.get("both")
        return form.effects if form else frozenset()

    def without(self, effect: str, base: "Shape") -> "Shape":
        """Return the shape with one effect taken back to what it is in `base`."""
        if effect in (VOLTAGE, SAG):
            return replace(self, voltage=base.voltage) if effect == VOLTAGE else replace(self, sag=base.sag)
        if effect == ASYMMETRY:
            return replace(self, forms=(("both", self.forms[0][1]),))
        forms = []
        for side, form in self.forms:
            forms.append((side, form.with_effects((form.effects - {effect}) | ({effect} & base.effects_at(side)))))
        return replace(self, forms=tuple(forms))

    def additions(self, data: BollardData) -> Iterator[tuple[str, str, "Shape"]]:
        """List every effect that can be added once: name, where ("both", "forward", "backward"), and the new shape."""
        for effect in CURVE_EFFECTS:
            free = tuple(name for name, form in self.forms if form.can_add(effect))
            targets: list[tuple[str, tuple[str, ...]]] = [(name, (name,)) for name in free]
            if len(free) > 1:
                targets.append(("both", free))
            for where, names in targets:
                forms = tuple((s, f.with_effects(f.effects | {effect}) if s in names else f) for s, f in self.forms)
                yield effect, where, replace(self, forms=forms)
        if self.tied:
            shared = self.forms[0][1]
            yield ASYMMETRY, "both", replace(self, forms=(("forward", shared), ("backward", shared)))
        if data.step is not None and not self.voltage:
            yield VOLTAGE, "both", replace(self, voltage=True)
        if not self.sag and data.order_is_free():
            yield SAG, "both", replace(self, sag=True)


@dataclass(frozen=True)
class Fitted:
    """A shape fitted to bollard data.

    `power` is the exponent of the voltage against `reference` [V]; `sag` the share of thrust lost from the first
    reading to the last."""

    data: BollardData
    shape: Shape
    curves: dict[str, Curve]
    at_bound: dict[str, tuple[str, ...]]
    power: float
    sag: float
    reference: float

    @property
    def both_ways(self) -> tuple[Curve | None, Curve | None]:
        shared = self.curves.get("both")
        return self.curves.get("forward", shared), self.curves.get("backward", shared)

    @cached_property
    def sides(self) -> dict[str, tuple[Side, Form]]:
        """Of each direction, or of both as one: points without what multiplies the curve, and the curve's form."""
        gain, forms, parts = self.gain(self.data), dict(self.shape.forms), self.data.parts(self.shape.tied)
        return {name: (side.without(gain[side.index]), forms[name]) for name, side in parts.items()}

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
    def loss(self) -> Floats:
        """Weighted squared error [N²] of each group, predicted by a fit without it; groups in rising number."""
        squares = np.zeros(len(self.data))
        for side, form in self.sides.values():
            squares[side.index] = left_out_squares(side, form)
        return sums_of(squares, self.data.group)

    @property
    def squares(self) -> float:
        return float(self.data.weight @ self.residual**2)

    def rmse(self, held_out: bool = False) -> float:
        """Root mean square error [N], weighted as in the fit; cross-validated with `held_out`."""
        squares = float(self.loss.sum()) if held_out else self.squares
        return float(np.sqrt(squares / self.data.weight.sum()))


def fit_shape(data: BollardData, shape: Shape) -> Fitted:
    """Fit a shape by least squares: curves direction by direction, in turn with what multiplies them."""
    reference = float(np.median(data.voltage)) if data.step is not None else 1.0
    fit = Fitted(data, shape, {}, {}, 0.0, 0.0, reference)
    for _ in range(ALTERNATIONS if shape.voltage or shape.sag else 1):
        curves, at_bound = dict[str, Curve](), dict[str, tuple[str, ...]]()
        for name, (side, form) in fit.sides.items():
            curves[name], at_bound[name] = form.fit(side.magnitude, side.thrust, side.weight)
        fit = _with_multipliers(replace(fit, curves=curves, at_bound=at_bound))
    return fit


def multiplier_columns(fit: Fitted, voltage: bool, sag: bool) -> Floats:
    """Derivative of the thrust [N] by the voltage's power and the sag, those that are free; shape (P, K)."""
    order, volts = fit.data.order, fit.data.voltage
    columns = [fit.predicted * np.log(volts / fit.reference)] if voltage else []
    columns += [-fit.predicted * order / (1.0 - fit.sag * order)] if sag else []
    return np.array(columns).reshape(len(columns), len(order)).T


def _with_multipliers(fit: Fitted) -> Fitted:
    """One Gauss-Newton step of the voltage's power and the sag, with the amplitudes free beside them."""
    data, shape = fit.data, fit.shape
    columns = multiplier_columns(fit, shape.voltage, shape.sag)
    if columns.shape[1] == 0:
        return fit
    sides = [np.where(data.n * s > 0, fit.predicted, 0.0)[:, None] for s in (1.0, -1.0)]
    root = np.sqrt(data.weight)
    step = np.linalg.lstsq(root[:, None] * np.hstack([columns, *sides]), root * fit.residual, rcond=None)[0]
    power = float(np.clip(fit.power + step[0], -4.0, 4.0)) if shape.voltage else fit.power
    sag = float(np.clip(fit.sag + step[int(shape.voltage)], -0.9, 0.9)) if shape.sag else fit.sag
    return replace(fit, power=power, sag=sag)


@dataclass(frozen=True)
class CandidateFit:
    """A map fitted with effects `added`, with their p-values in the order of the search. Of the last, and `where` it
    acts: the deviance that it gains, its p-value over all candidates of the step, the fall of the left-out squares
    `held_out` [N²] and its standard error over groups."""

    fit: Fitted
    added: Mapping[str, float] = field(default_factory=dict)
    effect: str = ""
    where: str = ""
    gain: float = 0.0
    p_value: float = 1.0
    held_out: float = 0.0
    stderr: float = np.inf

    def behind(self, other: "CandidateFit") -> tuple[float, float]:
        """Left-out squares [N²] more than those of another candidate, and their standard error over groups."""
        behind, stderr = behind_of(self.fit.loss, other.fit.loss)
        return behind, stderr + len(self.fit.loss) * (ROUNDING * self.fit.data.full_scale) ** 2


@dataclass(frozen=True)
class SearchStep:
    before: CandidateFit
    candidates: tuple[CandidateFit, ...]
    threshold: float


@dataclass(frozen=True)
class Rival:
    """Something else that an effect could be: how far `behind` it is [N²], and the odds that this lead is chance."""

    candidate: CandidateFit
    behind: float
    odds: float


@dataclass(frozen=True)
class MapSearch:
    """The base, every step, the final map with its effects and their p-values in the order of the search; for each of
    these by effect what else it could be."""

    base: Fitted
    steps: tuple[SearchStep, ...]
    final: Fitted
    p_values: Mapping[str, float]
    alternatives: Mapping[str, Mapping[str, Rival]]


def evidence(base: Fitted, fit: Fitted) -> float:
    """Return the deviance that `fit` gains over `base`, groups being the units, less log(groups) a parameter."""
    groups, extra = len(base.loss), fit.shape.parameters - base.shape.parameters
    return float(groups * np.log(max(base.squares / fit.squares, 1.0)) - extra * np.log(groups))


def evidence_by_chance(base: Fitted, fits: Mapping[tuple[str, str], Fitted], random: np.random.Generator) -> Chance:
    """Return what the best of the candidates `fits`, by effect and where, gains over `base` where nothing is missing.

    Residuals get signs group by group (Wu 1986, Ann. Stat. 14:1261: the wild bootstrap), so that noise that grows with
    thrust stays where it is, and are projected on the direction in which each candidate leaves the base, freed of what
    the base's own parameters can do."""
    root, groups = np.sqrt(base.data.weight), np.unique(base.data.group, return_inverse=True)[1]
    basis = _basis(base)
    # residuals shrink where the fit leans on a level; chance gets them back at their full size (HC3)
    errors = root * base.residual / (1.0 - np.minimum(np.sum(basis**2, axis=1), 0.99))
    signs = random.choice([-1.0, 1.0], size=(NULLS, groups.max() + 1))
    nulls = signs[:, groups] * errors
    nulls -= (nulls @ basis) @ basis.T
    squares, falls, count = np.sum(nulls**2, axis=1), dict[tuple[str, str], Floats](), groups.max() + 1
    for key, fit in fits.items():
        direction = root * (fit.predicted - base.predicted)
        direction -= basis @ (basis.T @ direction)
        falls[key] = (nulls @ direction) ** 2 / max(direction @ direction, 1e-300)
    best = np.full(NULLS, -np.inf)
    for (effect, where), fit in fits.items():
        extra = fit.shape.parameters - base.shape.parameters
        single = [key for key in falls if key[0] == effect and key[1] != "both"]
        keys = single if where == "both" and extra > 1 else [(effect, where)]
        fall = np.minimum(sum(falls[key] for key in keys), (1.0 - 1e-9) * squares)
        best = np.maximum(best, -count * np.log1p(-fall / squares) - extra * np.log(count))
    return Chance(best)


def _basis(fit: Fitted) -> Floats:
    """Orthonormal columns (P, K) of what the free parameters can do to the thrust, weighted as in the fit."""
    data, gain = fit.data, fit.gain(fit.data)
    blocks = [multiplier_columns(fit, fit.shape.voltage, fit.shape.sag)]
    for name, (side, form) in fit.sides.items():
        curve = fit.curves[name]
        by_name = curve.slopes(side.magnitude)
        slopes = np.stack([by_name[parameter] for parameter in form.free(curve)], axis=1)
        block = np.zeros((len(gain), slopes.shape[1]))
        block[side.index] = (np.sign(data.n) * gain)[side.index, None] * slopes
        blocks.append(block[:, np.any(block != 0.0, axis=0)])
    columns = np.sqrt(data.weight)[:, None] * np.hstack(blocks)
    axes, sizes, _ = np.linalg.svd(columns / np.sqrt(np.sum(columns**2, axis=0)), full_matrices=False)
    return axes[:, sizes > 1e-9]


@dataclass
class _Levels(Judge[CandidateFit, SearchStep]):
    """Candidates judged by levels left out; an effect may be added in one direction and later in the other."""

    data: BollardData
    start: Shape
    random: np.random.Generator
    fits: dict[Shape, Fitted] = field(default_factory=dict)
    most = 2 * MAX_EFFECTS + 1

    def fitted(self, shape: Shape) -> Fitted:
        if shape not in self.fits:
            self.fits[shape] = fit_shape(self.data, shape)
        return self.fits[shape]

    def look(self, model: CandidateFit, number: int) -> SearchStep:
        data, current, fits = self.data, model.fit, dict[tuple[str, str], Fitted]()
        if np.sqrt(current.squares / len(data)) > ROUNDING * data.full_scale:
            for effect, where, shape in current.shape.additions(data):
                parts = data.parts(shape.tied)
                enough = all(parts[name].can_leave_out(form) for name, form in shape.forms)
                if enough and (len(model.added) < MAX_EFFECTS or effect in model.added):
                    fits[effect, where] = self.fitted(shape)
        chance = evidence_by_chance(current, fits, self.random) if fits else Chance(np.zeros(1))
        candidates = []
        for (effect, where), fit in fits.items():
            gain = evidence(current, fit)
            p_value = chance.p_value(gain)
            added = {**model.added, effect: min(p_value, model.added.get(effect, 1.0))}
            candidate = CandidateFit(fit, added, effect, where, gain, p_value)
            held_out, stderr = model.behind(candidate)
            candidates.append(replace(candidate, held_out=held_out, stderr=stderr))
        return SearchStep(model, tuple(candidates), max(chance.threshold(ALPHA), 0.0))

    def admissible(self, look: SearchStep, first: SearchStep) -> list[CandidateFit]:
        best = _best([c for c in look.candidates if c.p_value <= ALPHA and c.held_out > c.stderr])
        return [] if best is None else [best]

    def added(self, model: CandidateFit) -> tuple[str, ...]:
        return tuple(model.added)

    def without(self, model: CandidateFit, name: str) -> CandidateFit:
        remaining = {effect: p_value for effect, p_value in model.added.items() if effect != name}
        return CandidateFit(self.fitted(model.fit.shape.without(name, self.start)), remaining)

    def better(self, current: CandidateFit, left: CandidateFit, look: SearchStep, first: SearchStep) -> CandidateFit:
        worse, stderr = left.behind(current)
        if worse <= NEEDLESS * stderr:
            return left
        others = [(*other.behind(current), other) for other in look.candidates if other.effect not in current.added]
        clearly = [(behind, other) for behind, stderr, other in others if behind < -stderr]
        return min(clearly, key=lambda item: item[0])[1] if clearly else current


def _best(candidates: list[CandidateFit]) -> CandidateFit | None:
    """The candidate that wins most; of the same effect in fewer directions one that is as good."""
    best = max(candidates, key=lambda candidate: candidate.held_out, default=None)
    for candidate in candidates:
        if best and candidate.effect == best.effect and candidate.fit.shape.parameters < best.fit.shape.parameters:
            behind, stderr = candidate.behind(best)
            if behind <= stderr:
                return candidate
    return best


def search_map(data: BollardData, start: Shape, seed: int) -> MapSearch:
    """Add the effects that are missing from `start`, at most three, and list what else they could be."""
    judge = _Levels(data, start, np.random.default_rng(seed))
    base = CandidateFit(judge.fitted(start))
    outcome = stepwise_search(judge, base)
    final, alternatives = outcome.final, dict[str, dict[str, Rival]]()
    for name, step in outcome.around.items():
        rivals = alternatives.setdefault(name, {})
        for candidate in step.candidates:
            rival = _rival(candidate, final)
            if rival and (candidate.effect not in rivals or rival.behind < rivals[candidate.effect].behind):
                rivals[candidate.effect] = rival
    return MapSearch(base.fit, outcome.looks, final.fit, final.added, alternatives)


def _rival(candidate: CandidateFit, final: CandidateFit) -> Rival | None:
    """Return the candidate as what an effect of the final map could be, None where it is clearly behind."""
    behind, stderr = candidate.behind(final)
    if candidate.effect in final.added or behind > stderr:
        return None
    tail = float(special.ndtr(-max(behind, 0.0) / stderr)) if stderr > 0.0 else 0.0
    return Rival(candidate, behind, tail / (1.0 - tail))


def search_around_faults(data: BollardData, shape: Shape, floor: float, seed: int) -> MapSearch:
    """Search, and again without any stretch of readings that steps off the curve and back."""
    search = search_map(data, shape, seed)
    for _ in range(MAX_STRETCHES):
        index = broken_stretch(search.final, floor)
        if index is None or np.all(data.flag[index] != ""):
            break
        off = abs(float(np.mean(search.final.residual[index])))
        why = f"{off:.3g} N off the curve from one reading to the next, and back again: faulty stretch"
        data = data.with_flags(index, BROKEN_WEIGHT, why)
        search = search_map(data, shape, seed)
    return search


def broken_stretch(fit: Fitted, floor: float) -> Ints | None:
    """Find the clearest stretch of points that steps off the curve and back again, or None: a propeller's curve is
    continuous, and what begins and ends with a jump is the measurement."""
    data = fit.data
    limit = max(STEP_SHARE * data.full_scale, STEP_NOISES * floor)
    best, clearest = None, 0.0
    for record in np.unique(data.record):
        for _, sign in SIDES:
            index = np.flatnonzero((data.record == record) & (data.n * sign > 0))
            residual = sign * fit.residual[index]
            for start in range(1, len(index) - SHORTEST_STRETCH):
                last = min(start + len(index) // 3, len(index) - 1)
                for stop in range(start + SHORTEST_STRETCH, last + 1):
                    inside = residual[start:stop]
                    around = np.mean(np.concatenate([residual[max(start - 3, 0) : start], residual[stop : stop + 3]]))
                    off = float(np.mean(inside) - around)
                    way = np.sign(off)
                    edges = min(way * (inside[0] - residual[start - 1]), way * (inside[-1] - residual[stop]))
                    steady = np.min(way * (inside - around)) > 0.5 * abs(off)
                    clear = abs(off) * np.sqrt(stop - start)
                    if edges > limit and steady and clear > clearest:
                        best, clearest = index[start:stop], clear
    return best
