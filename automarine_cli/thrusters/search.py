"""What a thruster map lacks: a stepwise search, judged by cross-validation over levels of the command."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from automarine_cli.fits.stepwise import Judge, discover
from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.scores import CHANCE, Scores, score
from automarine_cli.thrusters.shapes import Fitted, Shape, fit_shape, form_of
from automarine_cli.thrusters.where import broken_stretch

MOST_EFFECTS = 3
BROKEN_WEIGHT = 0.01
MOST_STRETCHES = 2
ROUNDING = 1e-6
"""Errors below this share of full scale are rounding, not evidence."""
NEEDLESS = 0.5
"""Standard errors by which cross-validation may get worse without an effect that is needless."""


@dataclass(frozen=True)
class Trial:
    """A map's shape fitted; `named` are the effects added to the base with their p-values, in the order found.

    Of the effect added last, in one place ("both", "forward", "backward"), there are its evidence and p-value, and what
    it wins in cross-validation: `gain` [N²] is the fall of the left-out squares, `stderr` its standard error over the
    groups left out.
    """

    fit: Fitted
    named: Mapping[str, float] = field(default_factory=dict)
    effect: str = ""
    where: str = ""
    evidence: float = 0.0
    p_value: float = 1.0
    gain: float = 0.0
    stderr: float = np.inf

    @property
    def convincing(self) -> bool:
        """Beyond chance, and better at levels it was not fitted to by over one standard error."""
        return self.p_value <= CHANCE and self.gain > self.stderr

    def behind(self, other: "Trial") -> tuple[float, float]:
        """Left-out squares [N²] more than those of another trial, and their standard error over groups."""
        gap = self.fit.loss - other.fit.loss
        stderr = float(np.sqrt(len(gap)) * np.std(gap, ddof=1)) if len(gap) > 1 else np.inf
        return float(gap.sum()), stderr + len(gap) * (ROUNDING * self.fit.data.full_scale) ** 2


@dataclass(frozen=True)
class Round:
    """One look for a missing effect: the map that was looked at, all trials, the scores, what is convincing best."""

    before: Trial
    trials: tuple[Trial, ...]
    scores: Scores
    taken: Trial | None


@dataclass(frozen=True)
class Rival:
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
        tail = float(special.ndtr(-max(self.behind, 0.0) / self.stderr))
        return tail / (1.0 - tail)


@dataclass(frozen=True)
class Search:
    """The base, every round, the final map, effects in the order found with their p-values, and their rivals."""

    base: Fitted
    rounds: tuple[Round, ...]
    final: Fitted
    p_values: Mapping[str, float]
    rivals: tuple[Rival, ...]

    @property
    def named(self) -> tuple[str, ...]:
        """The effects that were added."""
        return tuple(self.p_values)


@dataclass
class _Levels(Judge[Trial, Round]):
    """Candidates judged by levels left out; an effect may be added in one direction and later in the other."""

    data: BollardData
    start: Shape
    random: np.random.Generator
    known: dict[Shape, Fitted] = field(default_factory=dict)
    most = 2 * MOST_EFFECTS + 1

    def fitted(self, shape: Shape) -> Fitted:
        """Each fit is made once."""
        if shape not in self.known:
            self.known[shape] = fit_shape(self.data, shape)
        return self.known[shape]

    def judged(self, shape: Shape) -> bool:
        """Whether every direction has levels enough to leave some out."""
        parts = self.data.parts(shape.tied)
        effects = dict(shape.curves)
        return all(side.groups >= form_of(effects[name]).parameters + 2 for name, (_, side) in parts.items())

    def look(self, model: Trial, number: int) -> Round:
        data, current = self.data, model.fit
        offered = [
            (effect, where, shape)
            for effect, where, shape in current.shape.additions(data.drifts_apart(), data.step is not None)
            if self.judged(shape) and (len(model.named) < MOST_EFFECTS or effect in model.named)
        ]
        scores = score(current, [(effect, where) for effect, where, _ in offered], self.random)
        trials = []
        if np.sqrt(current.squares / len(data.points)) > ROUNDING * data.full_scale:
            for (effect, where, shape), evidence in zip(offered, scores.evidence.tolist()):
                p_value = scores.p_value(evidence)
                named = {**model.named, effect: min(p_value, model.named.get(effect, 1.0))}
                trial = Trial(self.fitted(shape), named, effect, where, evidence, p_value)
                gain, stderr = model.behind(trial)
                trials.append(replace(trial, gain=gain, stderr=stderr))
        return Round(model, tuple(trials), scores, _best(trials))

    def able(self, look: Round, first: Round) -> list[Trial]:
        return [] if look.taken is None else [look.taken]

    def added(self, model: Trial) -> tuple[str, ...]:
        return tuple(model.named)

    def without(self, model: Trial, name: str) -> Trial:
        kept = {effect: p_value for effect, p_value in model.named.items() if effect != name}
        return Trial(self.fitted(model.fit.shape.without(name, self.start)), kept)

    def better(self, current: Trial, left: Trial, look: Round, first: Round) -> Trial:
        worse, stderr = left.behind(current)
        if worse <= NEEDLESS * stderr:
            return left
        others = [(*trial.behind(current), trial) for trial in look.trials if trial.effect not in current.named]
        clearly = [(behind, trial) for behind, stderr, trial in others if behind < -stderr]
        return min(clearly, key=lambda item: item[0])[1] if clearly else current


def _best(trials: list[Trial]) -> Trial | None:
    """The convincing trial that wins most; of the same effect in fewer directions one that is as good."""
    convincing = [trial for trial in trials if trial.convincing]
    if not convincing:
        return None
    best = max(convincing, key=lambda trial: trial.gain)
    for trial in convincing:
        if trial.effect == best.effect and trial.fit.shape.parameters < best.fit.shape.parameters:
            behind, stderr = trial.behind(best)
            if behind <= stderr:
                return trial
    return best


def search(data: BollardData, start: Shape, seed: int) -> Search:
    """Add the effects that are missing from `start`, at most three, and say what else they could be."""
    judge = _Levels(data, start, np.random.default_rng(seed))
    base = Trial(judge.fitted(start))
    outcome = discover(judge, base)
    final = outcome.final
    rivals: dict[tuple[str, str], Rival] = {}
    for name, look in outcome.around.items():
        for trial in look.trials:
            behind, stderr = trial.behind(final)
            near = trial.effect not in final.named and behind <= stderr
            if near and ((name, trial.effect) not in rivals or behind < rivals[name, trial.effect].behind):
                rivals[name, trial.effect] = Rival(trial.effect, name, trial.where, trial.fit, behind, stderr)
    return Search(base.fit, outcome.looks, final.fit, final.named, tuple(rivals.values()))


def search_around_faults(data: BollardData, shape: Shape, floor: float, seed: int) -> tuple[Search, BollardData]:
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
        flag[here] = f"{abs(off):.3g} N off the curve from one reading to the next, and back again: faulty stretch"
        data = replace(data, points=replace(data.points, weight=weight, flag=flag))
        found = search(data, shape, seed)
    return found, data
