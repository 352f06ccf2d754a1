"""Which map: the form that cross-validation chooses, and the search for effects that a map lacks.

A candidate of the search adds one effect to a map. It is fitted by least squares, scored by its likelihood ratio beside
what chance gives, and judged by levels left out of the fit.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.errors import FitError
from automarine_cli.fits.preference import lead_of
from automarine_cli.fits.stepwise import Chance, Judge, Outcome, stepwise_search
from automarine_cli.quantities import Floats
from automarine_cli.text import plural
from automarine_cli.thrusters.bollard_data import (
    Ints,
    ThrusterLogs,
    flag_contradictions,
    left_out,
    levels_of,
    neighbour_weights,
    reduce_series,
    subtract_tare,
)
from automarine_cli.thrusters.fit import BollardData, MapFit, Shape, bollard_data, fit_shape
from automarine_cli.thrusters.map import SIDES

EQUAL = 1e-5  # errors below this share of full scale are rounding, not evidence
CLEAR_DEVIANCE = 4.0  # deviance from which a form is clearly behind: two standard errors, were the errors normal


def choose_form(
    fits: Sequence[MapFit], full_scale: float, forced: str | None = None
) -> tuple[MapFit, str, frozenset[str]]:
    """Choose among all forms, fitted in the order of FORMS: the fit, why in a sentence, and the names of the forms that
    no other is clearly better than.

    By leave-one-level-out cross-validation it is the simplest equation that is not clearly behind the best; a spline
    only where the best is clearly behind it, and by more than a standard error over levels (Breiman et al. 1984,
    section 3.4.3)."""
    by_name, judged = {fit.form.name: fit for fit in fits}, [fit for fit in fits if fit.can_leave_out]
    chosen, data = by_name[forced or "square"], fits[0].data
    if not judged:
        return chosen, f"The {chosen.form.name} form is used: too few levels to leave one out.", frozenset()
    rounding = (float(data.weight.sum()) + data.zero_weight) * (EQUAL * full_scale) ** 2

    def behind(loss: Floats, other: Floats) -> bool:
        return bool(len(loss) * np.log((loss.sum() + rounding) / (other.sum() + rounding)) > CLEAR_DEVIANCE)

    equations = [fit for fit in judged if not fit.form.interpolates]
    best = min(equations, key=lambda fit: (fit.loss.sum(), fit.parameters))
    reach = [fit for fit in equations if not behind(fit.loss, best.loss)]
    for fit in judged:
        inner, of_fit = best.left_out[1], fit.left_out[1]
        lead, stderr = lead_of(of_fit, inner)
        if fit.form.interpolates and lead > stderr and behind(inner, of_fit):
            reach = [fit]
    simplest = min(reach, key=lambda fit: (fit.parameters, fit.left_out_rmse))
    spline = simplest.form.interpolates
    errors = (fit.between_rmse if spline else fit.cv_rmse for fit in (simplest, best))
    error, least = (f"{100.0 * (value or 0.0) / full_scale:.3g}" for value in errors)
    because = f"The {simplest.form.name} form is chosen"
    if forced is not None:
        because = f"The {forced} form was asked for (--form); cross-validation would choose {simplest.form.name}."
    elif spline:
        because += (
            f", a curve through the mean of each level: at levels left out between others its error is {error} % of "
            f"full scale, that of the best equation, {best.form.name} ({best.parameters}), {least} %."
        )
    else:
        because += (
            f": {plural(simplest.parameters, 'parameter')} per direction, cross-validated error {error} % of full "
            f"scale. It is the simplest not clearly behind the best, {best.form.name} ({best.parameters}, {least} %)."
        )
    chosen = simplest if forced is None else chosen
    if chosen.form.interpolates:
        because += f" Beyond its levels it is {chosen.form.beyond}."
    return chosen, because, frozenset(fit.form.name for fit in reach)


OPPOSITE = (
    "thrust has the opposite sign of the control signal; if ahead is logged as negative force, write "
    'force_N = { from = "NAME", sign = -1 } under [columns] in the --columns file'
)
MIN_LEVELS_TO_DIAGNOSE = 5  # levels in a direction from which a curve with a second parameter can be told from chance
MIN_LEVELS_TO_HOLD_OUT = 10  # levels in a direction from which a quarter of them is held out
MIN_REPEATS = 6  # degrees of freedom among repeats from which their own scatter is the noise level
SAME_COMMAND = 1e-6  # commands that differ by less than this share of full scale are the same command
ALPHA, NULLS = 0.01, 1999
"""Share of tables without a missing effect in which one may be named; fewer cannot be told with eight levels."""
MAX_MAP_EFFECTS = 3
ROUNDING_SHARE = 1e-6  # errors below this share of full scale are rounding, not evidence
NEEDLESS = 0.5  # standard errors by which cross-validation may get worse without an effect that is needless
BROKEN_WEIGHT, MAX_STRETCHES = 0.01, 2
SHORTEST_STRETCH = 3  # readings in sequence that make a faulty stretch
STEP_SHARE, STEP_NOISES = 0.03, 6.0
"""How sharply a faulty stretch begins and ends: share of full scale, and multiples of the noise level."""


def data_of_logs(
    logs: ThrusterLogs, thrusters: int, n_unit: str, sides: Collection[str], min_levels: int = MIN_LEVELS_TO_DIAGNOSE
) -> BollardData:
    """Make data of one thruster, contradictions flagged, tare off, of the `sides` with `min_levels` levels or more.
    Raises FitError where there is none, or thrust opposes the command."""
    points, tare = subtract_tare(flag_contradictions(reduce_series(logs.records, thrusters)[0]))
    levels = {name: len(np.unique(levels_of(points.n[points.n * sign > 0]))) for name, sign in SIDES}
    enough = [name for name in sides if levels[name] >= min_levels]
    if not enough:
        raise FitError(
            f"no direction of the map has {min_levels} different commands in the logs; a diagnosis needs a curve: "
            "pull at more levels, or give a map of the direction that was measured"
        )
    data = bollard_data(points, tare.thrust_stderr, n_unit, enough, *(record.place for record in logs.records))
    if float(data.weight @ (data.n * np.abs(data.n) * data.force)) <= 0.0:
        raise FitError(OPPOSITE)
    return data


def held_out_levels(data: BollardData, seed: int) -> NDArray[np.bool_]:
    """Mark the points (P,) of the quarter of the levels that is held out: one of every four neighbours, never an end of
    the range; none where a direction has fewer than MIN_LEVELS_TO_HOLD_OUT levels."""
    random, number = np.random.default_rng(seed), levels_of(data.n)
    levels, out = [np.unique(number[data.n * sign > 0]) for _, sign in SIDES], list[int]()
    if any(0 < len(side) < MIN_LEVELS_TO_HOLD_OUT for side in levels):
        return np.zeros(len(data), dtype=bool)
    for inner in (side[1:-1] for side in levels):
        out += [int(inner[start + random.integers(4)]) for start in range(0, len(inner) - 3, 4)]
    return np.isin(number, out)


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
    for step in np.unique(data.step):
        for _, sign in SIDES:
            mask = (data.n * sign > 0) & (data.flag == "") & (data.step == step)
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


@dataclass(frozen=True, eq=False)
class MapTrial:
    """A map fitted with effects `added`, with their p-values in the order of the search. Of the last, and `where` it
    acts: the deviance that it gains, less log(groups) a parameter, and its p-value over all candidates of the step."""

    fit: MapFit
    added: Mapping[str, float] = field(default_factory=dict)
    effect: str = ""
    where: str = ""
    gain: float = 0.0
    p_value: float = 1.0

    def behind(self, other: "MapTrial") -> tuple[float, float]:
        """Left-out squares [N²] more than those of another candidate, and their standard error over groups."""
        behind, stderr = lead_of(other.fit.loss, self.fit.loss)
        return behind, stderr + len(self.fit.loss) * (ROUNDING_SHARE * self.fit.data.full_scale) ** 2


@dataclass(frozen=True)
class MapLook:
    before: MapTrial
    candidates: tuple[MapTrial, ...]
    threshold: float


def evidence_by_chance(base: MapFit, fits: Mapping[tuple[str, str], MapFit], random: np.random.Generator) -> Chance:
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
        apart = [fall for key, fall in falls.items() if key[0] == effect and key[1] != "both"]
        fall = np.sum(apart, axis=0) if where == "both" and extra > 1 else falls[effect, where]
        fall = np.minimum(fall, (1.0 - 1e-9) * squares)
        best = np.maximum(best, -count * np.log1p(-fall / squares) - extra * np.log(count))
    return Chance(best)


def _basis(fit: MapFit) -> Floats:
    """Orthonormal columns (P, K) of what the free parameters can do to the thrust, weighted as in the fit."""
    data, gain = fit.data, fit.gain(fit.data)
    blocks = [fit.multipliers[:, [fit.shape.voltage, fit.shape.sag]]]
    for name, (index, side, form) in fit.sides.items():
        slopes = fit.curves[name].slopes(side.n)
        block = np.zeros((len(gain), len(slopes)))
        block[index] = (np.sign(data.n) * gain)[index, None] * np.stack([*slopes.values()], axis=1)
        free = [parameter in form.free(fit.curves[name]) for parameter in slopes]
        blocks.append(block[:, free & np.any(block != 0.0, axis=0)])
    columns = np.sqrt(data.weight)[:, None] * np.hstack(blocks)
    axes, sizes, _ = np.linalg.svd(columns / np.sqrt(np.sum(columns**2, axis=0)), full_matrices=False)
    return axes[:, sizes > 1e-9]


@dataclass
class _Levels(Judge[MapTrial, MapLook]):
    """Candidates judged by levels left out; an effect may be added in one direction and later in the other."""

    data: BollardData
    start: Shape
    random: np.random.Generator
    fits: dict[Shape, MapFit] = field(default_factory=dict)
    most = 2 * MAX_MAP_EFFECTS + 1

    def fitted(self, shape: Shape) -> MapFit:
        if shape not in self.fits:
            self.fits[shape] = fit_shape(self.data, shape)
        return self.fits[shape]

    def look(self, model: MapTrial, number: int) -> MapLook:
        data, current, fits = self.data, model.fit, dict[tuple[str, str], MapFit]()
        rounded = np.sqrt(current.squares / len(data)) <= ROUNDING_SHARE * data.full_scale
        for effect, where, shape in () if rounded else current.shape.additions(data):
            parts = data.parts(shape.tied)
            enough = all(parts[name][1].can_leave_out(form) for name, form in shape.forms)
            if enough and (len(model.added) < MAX_MAP_EFFECTS or effect in model.added):
                fits[effect, where] = self.fitted(shape)
        chance = evidence_by_chance(current, fits, self.random) if fits else Chance(np.zeros(1))
        candidates, groups = [], len(current.loss)
        for (effect, where), fit in fits.items():
            extra = fit.shape.parameters - current.shape.parameters
            gain = float(groups * np.log(max(current.squares / fit.squares, 1.0)) - extra * np.log(groups))
            p_value = chance.p_value(gain)
            added = {**model.added, effect: min(p_value, model.added.get(effect, 1.0))}
            candidates.append(MapTrial(fit, added, effect, where, gain, p_value))
        return MapLook(model, tuple(candidates), max(chance.threshold(ALPHA), 0.0))

    def admissible(self, look: MapLook, first: MapLook) -> list[MapTrial]:
        """The candidate that wins most at levels left out; of its effect in fewer directions one that is as good."""
        gains = dict[MapTrial, float]()
        for candidate in look.candidates:
            held_out, stderr = look.before.behind(candidate)
            if candidate.p_value <= ALPHA and held_out > stderr:
                gains[candidate] = held_out
        if not gains:
            return []
        best = max(gains, key=gains.__getitem__)
        for candidate in gains:
            behind, stderr = candidate.behind(best)
            smaller = candidate.fit.shape.parameters < best.fit.shape.parameters
            if candidate.effect == best.effect and smaller and behind <= stderr:
                return [candidate]
        return [best]

    def added(self, model: MapTrial) -> tuple[str, ...]:
        return tuple(model.added)

    def without(self, model: MapTrial, name: str) -> MapTrial:
        remaining = {effect: p_value for effect, p_value in model.added.items() if effect != name}
        return MapTrial(self.fitted(model.fit.shape.without(name, self.start)), remaining)

    def better(self, current: MapTrial, reduced: MapTrial, look: MapLook, first: MapLook) -> MapTrial:
        worse, stderr = reduced.behind(current)
        if worse <= NEEDLESS * stderr:
            return reduced
        behind = {c: c.behind(current) for c in look.candidates if c.effect not in current.added}
        clearly = [candidate for candidate, (lag, stderr) in behind.items() if lag < -stderr]
        return min(clearly, key=lambda candidate: behind[candidate][0], default=current)


MapSearch = Outcome[MapTrial, MapLook]


def search_map(data: BollardData, start: Shape, seed: int) -> MapSearch:
    """Add the effects that are missing from `start`, at most three."""
    judge = _Levels(data, start, np.random.default_rng(seed))
    return stepwise_search(judge, MapTrial(judge.fitted(start)))


def rivals_of(search: MapSearch, name: str) -> dict[str, tuple[MapTrial, float]]:
    """Return what else an effect of the final map could be, by effect: the candidate that is least behind, and the odds
    that the lead over it is chance."""
    rivals, least = dict[str, tuple[MapTrial, float]](), dict[str, float]()
    for candidate in search.around[name].candidates if name in search.around else ():
        behind, stderr = candidate.behind(search.final)
        effect = candidate.effect
        if effect not in search.final.added and behind <= stderr and behind < least.get(effect, np.inf):
            tail = float(special.ndtr(-max(behind, 0.0) / stderr)) if stderr > 0.0 else 0.0
            rivals[effect], least[effect] = (candidate, tail / (1.0 - tail)), behind
    return rivals


def search_around_faults(data: BollardData, shape: Shape, floor: float, seed: int) -> MapSearch:
    """Search, and again without any stretch of readings that steps off the curve and back."""
    search = search_map(data, shape, seed)
    for _ in range(MAX_STRETCHES):
        fit = search.final.fit
        index = broken_stretch(fit, floor)
        if index is None or np.all(data.flag[index] != ""):
            break
        off = abs(float(np.mean(fit.residual[index])))
        why = f"{off:.3g} N off the curve from one reading to the next, and back again: faulty stretch"
        data = data.with_flags(index, BROKEN_WEIGHT, why)
        search = search_map(data, shape, seed)
    return search


def broken_stretch(fit: MapFit, floor: float) -> Ints | None:
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
                    edges = np.sign(off) * (inside[[0, -1]] - residual[[start - 1, stop]])
                    steady = np.min(np.sign(off) * (inside - around)) > 0.5 * abs(off)
                    clear = abs(off) * np.sqrt(stop - start)
                    if edges.min() > limit and steady and clear > clearest:
                        best, clearest = index[start:stop], clear
    return best
