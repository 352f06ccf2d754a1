"""How far a campaign splits two explanations: the misfit that stays when the wrong one does its best.

With one explanation true, the other is fitted to the headings that it would give, every parameter and all that differs
from run to run at its disposal. What stays, in units of the noise, is the expected difference in deviance; Atkinson and
Fedorov (1975, Biometrika 62:57) choose runs to make that largest (T-optimality).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.diagnosis.scores import fitted_parameters, penalty
from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.mixed_model import derivatives
from automarine_cli.fits.optimise import Point, maximise
from automarine_cli.models.model import Model
from automarine_cli.planning.candidates import PaperRun
from automarine_cli.planning.information import Fitting, PriorResults
from automarine_cli.quantities import Floats

MAX_FIT_ROUNDS = 20
SETTLED_MISFIT = 1e-3  # of misfit, in deviance
MIN_VISIBLE_MISFIT = 4.0  # misfit without an effect from which it counts as seen: two standard errors of its size
MAX_STARTS, FEW_CANDIDATES = 12, 8  # of the other explanation's fit, and runs on which they are compared


Pair = tuple[Fitting, Fitting]


@dataclass(frozen=True)
class Split:
    """Outcome for a pair: the expected lead in evidence of `true` (deviance, penalties included)."""

    true: str
    other: str
    evidence: float


@dataclass(frozen=True)
class ModelPair:
    """Two explanations on K candidates: one is true, the other is fitted about its parameters there.

    `square` (K,) is the squared difference of the headings in units of their noise, `gradient` (K, p) and `hessian`
    (K, p, p) what the other's parameters do to it; `ridge` (p, p) what is known of them beforehand."""

    square: Floats
    gradient: Floats
    hessian: Floats
    ridge: Floats

    def misfit(self, counts: Floats) -> Floats:
        """Return the other's misfit to campaigns, (B,); `counts` (B, K) how often each holds each candidate."""
        square, gradient = counts @ self.square, counts @ self.gradient
        hessian = np.tensordot(counts, self.hessian, axes=1) + self.ridge
        solved = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        return np.maximum(square - np.sum(gradient * solved, axis=1), 0.0)


@dataclass(frozen=True)
class Discrimination:
    """Explanations to separate: `contests`, settled from misfits of `enough` (C,) on; worth is their settled shares."""

    contests: tuple[ModelPair, ...]
    enough: Floats

    def scores(self, counts: Floats, extras: NDArray[np.int64] | None = None) -> Floats:
        runs = counts[None] if extras is None else counts + np.eye(len(counts))[extras]
        shares = [np.minimum(pair.misfit(runs) / enough, 1.0) for pair, enough in zip(self.contests, self.enough)]
        return np.asarray(np.sum(shares, axis=0))

    def reached(self, counts: Floats) -> bool:
        return self.scores(counts)[0] >= len(self.contests) - 1e-9


def pairs_of(prior: PriorResults, fitting: Fitting, grid: Sequence[PaperRun], largest: float) -> tuple[Pair, ...]:
    """Pair each doubt both ways, (true, other), the rival as like the effect named as it can be on the runs of `grid`;
    one way alone where it could imitate only by vanishing."""
    pairs: list[Pair] = []
    for doubt in prior.doubts:
        starts = with_effect(fitting, without(prior.model, doubt.effect), doubt.rival, largest)
        true = replace(fitting, fit="diagnosis", explained_by=doubt.effect)
        other = replace(closest(true, starts, grid)[0], explained_by=doubt.rival)
        pairs.append((true, other))
        if shows(other, grid):
            pairs.append((other, true))
    return tuple(pairs)


def with_effect(fitting: Fitting, model: Model, name: str, largest: float) -> list[Fitting]:
    """Add one more effect to the model, at each place from which its fit may start; `largest` moment."""
    effect = effects.get(name)
    options = []
    for parameter in effect.parameters:
        if parameter.reference:
            references = {"moment": largest, "clock": 0.0, "voltage": fitting.voltage or 1.0}
            options.append([references.get(parameter.reference, 1.0)])
        elif parameter.choices:
            options.append([float(law) for law in effect.laws_of(effect.needs)])
        else:
            values = parameter.scan or (parameter.start,)
            options.append([parameter.scaled(value, largest) for value in values])
    starts = [
        start
        for start in product(*options)
        if all(v == these[0] or effect.counts(p, start) for p, v, these in zip(effect.parameters, start, options))
    ]
    every = max(1, -(-len(starts) // MAX_STARTS))
    return [replace(fitting, model=model.with_effect(name, start), fit="diagnosis") for start in starts[::every]]


NO_CONTEST = ModelPair(np.zeros(0), np.zeros((0, 1)), np.zeros((0, 1, 1)), np.eye(1))


def contest(true: Fitting, other: Fitting, candidates: Sequence[PaperRun]) -> ModelPair:
    truth, problem = true.problem(candidates), other.problem(candidates)
    target = truth.readings(true.phi(truth), np.zeros_like(truth.effects.scale))
    headings, by_phi, by_run = derivatives(problem, other.phi(problem), np.zeros_like(problem.effects.scale))
    residual = np.where(problem.observed, target - headings, 0.0)
    gram = problem.inner(by_phi, by_run, residual).keep(other.parameters.free)
    weighted = linear_mixed.weigh(gram, problem.effects, other.variances(problem))
    square, gradient, hessian = (other.fitted * x for x in (weighted.square, weighted.gradient, weighted.hessian))
    return ModelPair(square, gradient, hessian, other.loose_information)


def fitted(true: Fitting, other: Fitting, candidates: Sequence[PaperRun]) -> tuple[Fitting, float]:
    """Return `other` with the parameters at which it comes closest to `true` on the candidates, and the misfit that
    stays (infinite where it runs away)."""
    parameters, free = other.parameters, other.parameters.free[:-1]

    def evaluate(points: Sequence[Floats], _: Sequence[int]) -> list[Point[Fitting]]:
        reached = []
        for phi in points:
            moved = replace(other, model=other.model.with_theta(parameters.natural(phi)[:-1]))
            current, misfit = _about(true, moved, candidates)
            # the common instant is free beside the others
            square, pull = current.hessian.sum(axis=0), current.gradient.sum(axis=0)
            share = square[:-1, -1] / max(square[-1, -1], 1e-12)
            gradient = pull[:-1] - share * pull[-1]
            curvature = square[:-1, :-1] - np.outer(share, square[-1, :-1])
            reached.append(Point(phi, -misfit, 2.0 * gradient, 2.0 * curvature, moved))
        return reached

    start = np.clip(other.phi(other.problem(candidates[:1])), *parameters.limits.T)
    limits = parameters.limits
    (end,) = maximise(evaluate, [start], [free], [limits], settled=SETTLED_MISFIT, iterations=MAX_FIT_ROUNDS)
    return end.point.data, -end.point.value


def _about(true: Fitting, other: Fitting, candidates: Sequence[PaperRun]) -> tuple[ModelPair, float]:
    """The contest about `other`, its misfit as it stands (infinite where it runs away), the common instant free."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            current = contest(true, other, candidates)
        except FitError:
            return NO_CONTEST, np.inf
    offset, pull = current.hessian[:, -1, -1].sum(), current.gradient[:, -1].sum()
    return current, float(current.square.sum() - pull**2 / max(offset, 1e-12))


def closest(true: Fitting, starts: Sequence[Fitting], candidates: Sequence[PaperRun]) -> tuple[Fitting, float]:
    """Return of several starts the one whose fit comes closest: the best that the other explanation can do."""
    rough, few = [], candidates[:: max(1, len(candidates) // FEW_CANDIDATES)]
    for other in starts:
        current, now = _about(true, other, few)
        rough.append(float(current.misfit(np.ones((1, len(few))))[0]) if np.isfinite(now) else np.inf)
    best = np.argsort(rough, kind="stable")[:2]
    ends = [fitted(true, starts[int(i)], candidates) for i in best]
    return min(ends, key=lambda pair: pair[1])


def splits(pairs: Sequence[Pair], candidates: Sequence[PaperRun]) -> tuple[tuple[Split, ...], tuple[Pair, ...]]:
    """Return what a campaign is expected to say of each pair (true, other), and the pairs with the other at best."""
    outcomes, moved = [], []
    for true, other in pairs:
        best, misfit = fitted(true, other, candidates)
        evidence = misfit + head_start(true, other, len(candidates))
        outcomes.append(Split(true.explained_by, other.explained_by, evidence))
        moved.append((true, best))
    return tuple(outcomes), tuple(moved)


def head_start(true: Fitting, other: Fitting, runs: int) -> float:
    """Return what the penalties for parameters give `true` over `other` before any run, in deviance."""

    def cost(fitting: Fitting) -> float:
        values = next(term.values for term in fitting.model.terms if term.name == fitting.explained_by)
        return penalty(fitted_parameters(fitting.explained_by, values), runs)

    return cost(other) - cost(true)


def shows(explanation: Fitting, candidates: Sequence[PaperRun]) -> bool:
    """Tell whether the effect is seen at all on these runs: what imitates by vanishing only is no rival."""
    bare = replace(explanation, model=without(explanation.model, explanation.explained_by))
    return fitted(explanation, bare, candidates)[1] > MIN_VISIBLE_MISFIT


def without(model: Model, effect: str) -> Model:
    return replace(model, terms=tuple(term for term in model.terms if term.name != effect))
