"""Effects added to a thruster map one at a time, pruned and swapped; judged by cross-validation over levels."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.points import Floats
from automarine_cli.thrusters.scores import CHANCE, Scores, score
from automarine_cli.thrusters.shapes import Fitted, Shape, fit_shape, form_of
from automarine_cli.thrusters.where import broken_stretch

MOST_EFFECTS = 3
BROKEN_WEIGHT = 0.01
MOST_STRETCHES = 2
ROUNDING = 1e-6
"""Errors below this share of full scale are rounding, not evidence."""


@dataclass(frozen=True)
class Trial:
    """One effect added in one place: its fit, its evidence, and what it wins in cross-validation.

    `gain` [N²] is the fall of the left-out squares and `stderr` its standard error over the groups left out.
    """

    effect: str
    where: str
    fit: Fitted
    evidence: float
    p_value: float
    gain: float
    stderr: float

    @property
    def convincing(self) -> bool:
        """Beyond chance, and better at levels it was not fitted to by over one standard error."""
        return self.p_value <= CHANCE and self.gain > self.stderr


@dataclass(frozen=True)
class Round:
    """One look for a missing effect: the model that was looked at, all trials, the scores, what was taken."""

    current: Fitted
    trials: tuple[Trial, ...]
    scores: Scores
    taken: Trial | None


@dataclass(frozen=True)
class Swap:
    """Another effect in the place of one that was named: left-out squares `behind` [N²] and standard error."""

    name: str
    instead_of: str
    where: str
    fit: Fitted
    behind: float
    stderr: float

    @property
    def odds(self) -> float:
        """Odds against the named effect: that the difference in cross-validation is chance."""
        if self.stderr <= 0.0:
            return 0.0
        tail = float(stats.norm.sf(max(self.behind, 0.0) / self.stderr))
        return tail / (1.0 - tail)


@dataclass(frozen=True)
class Search:
    """The base, every round, the final model, effects in the order found with their p-values, and their rivals."""

    base: Fitted
    rounds: tuple[Round, ...]
    final: Fitted
    named: tuple[str, ...]
    p_values: dict[str, float]
    rivals: tuple[Swap, ...]


@dataclass
class _Fits:
    """Fits of the same data, each made once."""

    data: BollardData
    known: dict[Shape, Fitted] = field(default_factory=dict)

    def of(self, shape: Shape) -> Fitted:
        if shape not in self.known:
            self.known[shape] = fit_shape(self.data, shape)
        return self.known[shape]

    def judged(self, shape: Shape) -> bool:
        """Whether every direction has levels enough to leave some out."""
        parts = self.data.parts(shape.tied)
        effects = dict(shape.curves)
        return all(side.groups >= form_of(effects[name]).parameters + 2 for name, (_, side) in parts.items())


def search(data: BollardData, start: Shape, seed: int) -> Search:
    """Add the effects that are missing from `start`, at most three, and say what else they could be."""
    random = np.random.default_rng(seed)
    fits = _Fits(data)
    base = current = fits.of(start)
    named: dict[str, float] = {}
    rounds: list[Round] = []
    while True:
        look = _round(fits, current, tuple(named), random)
        rounds.append(look)
        if look.taken is None:
            break
        named[look.taken.effect] = min(look.taken.p_value, named.get(look.taken.effect, 1.0))
        current = look.taken.fit
    current, named = _pruned(fits, base, current, named)
    current, named, rivals = _swapped(fits, base, current, named)
    return Search(base, tuple(rounds), current, tuple(named), named, rivals)


def search_around_faults(
    data: BollardData, shape: Shape, floor: float, seed: int
) -> tuple[Search, BollardData]:
    """The search, again without any stretch of readings that steps off the curve and back."""
    found = search(data, shape, seed)
    for _ in range(MOST_STRETCHES):
        here = broken_stretch(found.final, floor)
        if here is None:
            break
        weight, flag = data.points.weight.copy(), data.points.flag.copy()
        if np.all(flag[here] != ""):
            break
        weight[here] = BROKEN_WEIGHT
        off = float(np.mean(found.final.residual[here]))
        flag[here] = (
            f"{abs(off):.3g} N off the curve from one reading to the next, and back again: faulty stretch"
        )
        data = replace(data, points=replace(data.points, weight=weight, flag=flag))
        found = search(data, shape, seed)
    return found, data


def difference(worse: Floats, better: Floats, scale: float) -> tuple[float, float]:
    """Sum over groups of one loss less another [N²], and its standard error."""
    gap = worse - better
    stderr = float(np.sqrt(len(gap)) * np.std(gap, ddof=1)) if len(gap) > 1 else np.inf
    return float(gap.sum()), stderr + len(gap) * (ROUNDING * scale) ** 2


def _round(fits: _Fits, current: Fitted, named: tuple[str, ...], random: np.random.Generator) -> Round:
    """One look; an effect that is named already may be added in the other direction too."""
    data = fits.data
    offered = [
        (effect, where, shape)
        for effect, where, shape in current.shape.additions(data.drifts_apart(), data.step is not None)
        if fits.judged(shape) and (len(named) < MOST_EFFECTS or effect in named)
    ]
    scores = score(current, [(effect, where) for effect, where, _ in offered], random)
    trials = []
    if np.sqrt(current.squares / len(data.points)) > ROUNDING * data.full_scale:
        for (effect, where, shape), evidence, p in zip(offered, scores.evidence, scores.p_values):
            found = fits.of(shape)
            gain, stderr = difference(current.loss, found.loss, data.full_scale)
            trials.append(Trial(effect, where, found, float(evidence), float(p), gain, stderr))
    return Round(current, tuple(trials), scores, _best(trials, data.full_scale))


def _best(trials: list[Trial], scale: float) -> Trial | None:
    """The convincing trial that wins most; of the same effect in fewer directions one that is as good."""
    convincing = [trial for trial in trials if trial.convincing]
    if not convincing:
        return None
    best = max(convincing, key=lambda trial: trial.gain)
    for trial in convincing:
        if trial.effect == best.effect and trial.fit.shape.parameters < best.fit.shape.parameters:
            behind, stderr = difference(trial.fit.loss, best.fit.loss, scale)
            if behind <= stderr:
                return trial
    return best


def _pruned(
    fits: _Fits, base: Fitted, current: Fitted, named: dict[str, float]
) -> tuple[Fitted, dict[str, float]]:
    """Without the effects that the later ones made needless."""
    for effect in list(named) if len(named) > 1 else []:
        less = fits.of(current.shape.without(effect, base.shape))
        worse, stderr = difference(less.loss, current.loss, fits.data.full_scale)
        if worse <= 0.5 * stderr and len(named) > 1:
            current, named = less, {name: p for name, p in named.items() if name != effect}
    return current, named


def _swapped(
    fits: _Fits, base: Fitted, current: Fitted, named: dict[str, float]
) -> tuple[Fitted, dict[str, float], tuple[Swap, ...]]:
    """The final model after exchanging what another effect does clearly better; and every effect's rivals."""
    swaps = _swaps(fits, base, current, named)
    better = [swap for swap in swaps if swap.behind < -swap.stderr]
    if better:
        best = min(better, key=lambda swap: swap.behind)
        named = {best.name if name == best.instead_of else name: p for name, p in named.items()}
        current = best.fit
        swaps = _swaps(fits, base, current, named)
    near = [swap for swap in swaps if swap.behind <= swap.stderr]
    nearest: dict[tuple[str, str], Swap] = {}
    for swap in near:
        key = (swap.instead_of, swap.name)
        if key not in nearest or swap.behind < nearest[key].behind:
            nearest[key] = swap
    return current, named, tuple(nearest.values())


def _swaps(fits: _Fits, base: Fitted, current: Fitted, named: dict[str, float]) -> list[Swap]:
    data, found = fits.data, []
    for effect in named:
        less = current.shape.without(effect, base.shape)
        for other, where, shape in less.additions(data.drifts_apart(), data.step is not None):
            if other in named or not fits.judged(shape):
                continue
            instead = fits.of(shape)
            behind, stderr = difference(instead.loss, current.loss, data.full_scale)
            found.append(Swap(other, effect, where, instead, behind, stderr))
    return found
