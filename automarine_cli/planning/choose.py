"""Which candidates to run: the best gain for its cost, run after run, then exchanges until none is better.

Greedy choice and exchange are Fedorov's (1972) and Mitchell's (1974, Technometrics 16:203) for D-optimal designs, here
with costs: a run is worth its gain over the share of what is left that it takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SWEEPS = 8
FINALISTS = 4
"""How many of the campaigns that the search begins with are improved to the end."""
ALIKE = 1e-3
"""Worth (a thousandth of the standard errors) that is given up for as many runs to one side as to the other."""
BEGUN = (1.0, 3.0)
"""How often each pair of mirrored candidates is run in the campaigns with which the search begins."""
BETTER = 1e-9
SPLITTING = 100.0
"""Weight of splitting explanations against narrowing intervals: explanations come first, until they are split."""


@dataclass(frozen=True)
class Contest:
    """Two explanations on K candidates: one is true, the other is fitted about its parameters there.

    `square` (K,) is the squared difference of the headings in units of their noise, `gradient` (K, p) and `hessian`
    (K, p, p) what the other's parameters do to it; `ridge` (p, p) what is known of them beforehand.
    """

    square: Floats
    gradient: Floats
    hessian: Floats
    ridge: Floats

    def misfit(self, counts: Floats) -> Floats:
        """Misfit of the other explanation to campaigns, `counts` (B, K) how often each holds each candidate; (B,)."""
        square, gradient = counts @ self.square, counts @ self.gradient
        hessian = np.tensordot(counts, self.hessian, axes=1) + self.ridge
        solved = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        return np.maximum(square - np.sum(gradient * solved, axis=1), 0.0)


@dataclass(frozen=True)
class Objective:
    """What a campaign is for: explanations to split, then intervals to narrow.

    `information` (K, p, p) of the candidates, `known` (p, p) beforehand, `wanted` (p, m) the directions whose
    intervals count; a contest is settled from a misfit of `enough` on. `goal` is the largest standard error of a
    wanted direction at which nothing more is wanted, or None.
    """

    information: Floats
    known: Floats
    wanted: Floats
    contests: tuple[Contest, ...] = ()
    enough: float = 20.0
    goal: float | None = None

    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        """Worth of the campaign `counts` (K,) with one more run, each of `extras` (B,) in turn, (B,): shares of the
        contests settled, and mean logarithm by which the wanted standard errors have come down."""
        return self._worth(self._spread(counts, extras), counts + np.eye(len(counts))[extras])

    def score(self, counts: Floats) -> float:
        """Worth of the campaign `counts` (K,)."""
        return float(self._worth(self._spread(counts, None), counts[None])[0])

    def reached(self, counts: Floats) -> bool:
        """Whether nothing more is wanted."""
        if self.goal is None:
            return False
        errors = np.sqrt(np.diagonal(self._spread(counts, None)[0]))
        split = [contest.misfit(counts[None])[0] >= self.enough for contest in self.contests]
        return bool(np.all(errors <= self.goal) and all(split))

    def _worth(self, spread: Floats, counts: Floats) -> Floats:
        unit = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        logs = np.log(unit).sum(axis=1) + 0.5 * np.linalg.slogdet(spread / unit[:, :, None] / unit[:, None, :])[1]
        settled = sum(np.minimum(contest.misfit(counts) / self.enough, 1.0) for contest in self.contests)
        return np.asarray(SPLITTING * settled - logs / self.wanted.shape[1])

    def _spread(self, counts: Floats, extras: NDArray[np.int64] | None) -> Floats:
        """Covariance (B, m, m) of the wanted directions as the jackknife over runs tells it: see
        `information.reported_covariance`. A parameter that hangs on a single run is not known."""
        base = np.tensordot(counts, self.information, axes=1) + self.known
        more = np.zeros((1, *base.shape)) if extras is None else self.information[extras]
        whole = base + more
        inverse = np.linalg.inv(whole)
        ran = np.flatnonzero(counts)
        told = np.linalg.inv(whole) @ self.known
        each = np.linalg.inv(whole[:, None] - self.information[ran]) @ self.information[ran]
        told = told + np.tensordot(each, counts[ran], axes=((1,), (0,)))
        told = told + np.linalg.inv(whole - more) @ more
        covariance = told @ inverse
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return np.asarray(self.wanted.T @ covariance @ self.wanted)


def choose(
    objective: Objective, costs: Floats, room: Floats, mirrors: Sequence[int], fixed: Floats
) -> NDArray[np.int64]:
    """How often to run each candidate, (K,): never more than `room` (4,) allows at `costs` (K, 4), and at least
    `fixed` (K,), which must fit; `mirrors` (K,) is the place of the same run to the other side."""
    other, ones = np.asarray(mirrors), np.eye(len(costs))
    begun = fixed.astype(float)
    pairs = [ones[k] + ones[other[k]] for k in range(len(costs)) if k <= other[k]]
    starts = [begun, *(begun + times * pair for times in BEGUN for pair in pairs)]
    starts = [start for start in starts if np.all(start @ costs <= room + 1e-9)]
    filled = [_fill(objective, costs, room, start) for start in starts]
    best = sorted(filled, key=lambda counts: -objective.score(counts))[:FINALISTS]
    ended = [_improved(objective, costs, room, counts, fixed) for counts in best]
    counts = _pruned(objective, costs, max(ended, key=objective.score), fixed)
    return _balanced(objective, costs, room, other, counts, fixed).astype(int)


def _improved(
    objective: Objective, costs: Floats, room: Floats, counts: Floats, fixed: Floats
) -> Floats:
    """Exchange and rebuild until nothing changes."""
    for _ in range(SWEEPS):
        before = counts
        counts = _exchange(objective, costs, room, counts, fixed)
        counts = _rebuild(objective, costs, room, counts, fixed)
        if np.array_equal(before, counts):
            break
    return counts


def _fill(objective: Objective, costs: Floats, room: Floats, counts: Floats) -> Floats:
    """Add the run of the best worth for its cost until none fits or nothing more is wanted."""
    ones = np.eye(len(counts))
    while not objective.reached(counts):
        left = room - counts @ costs
        fits = np.flatnonzero(np.all(costs <= left + 1e-9, axis=1))
        if not len(fits):
            break
        gain = objective.scores(counts, fits) - objective.score(counts)
        share = np.sum(costs[fits] / np.maximum(left, 1e-12), axis=1)
        worth = gain / share
        if worth.max() <= BETTER:
            break
        counts = counts + ones[fits[int(np.argmax(worth))]]
    return counts


def _exchange(objective: Objective, costs: Floats, room: Floats, counts: Floats, fixed: Floats) -> Floats:
    """Swap a run for another while that is better and fits."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for _ in range(SWEEPS):
        swapped = False
        for out in np.flatnonzero(counts > fixed):
            without = counts - ones[out]
            fits = np.flatnonzero(np.all(without @ costs + costs <= room + 1e-9, axis=1))
            scores = objective.scores(without, fits)
            best = int(np.argmax(scores))
            if scores[best] > now + 1e-7:
                counts, now, swapped = without + ones[fits[best]], float(scores[best]), True
        if not swapped:
            break
    return counts


def _rebuild(
    objective: Objective, costs: Floats, room: Floats, counts: Floats, fixed: Floats
) -> Floats:
    """Leave out one run, or all of its like, and fill up again with what that frees, while that is better."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for out in np.flatnonzero(counts > fixed):
        for gone in dict.fromkeys((1.0, float(counts[out] - fixed[out]))):
            if counts[out] - fixed[out] < gone:
                continue
            trial = _fill(objective, costs, room, counts - gone * ones[out])
            worth = objective.score(trial)
            if worth > now + 1e-7:
                counts, now = trial, worth
    return counts


def _pruned(objective: Objective, costs: Floats, counts: Floats, fixed: Floats) -> Floats:
    """Leave out, dearest first, what the goal does not need."""
    ones = np.eye(len(counts))
    for out in sorted(np.flatnonzero(counts > fixed), key=lambda k: (-costs[k, 0], k)):
        while counts[out] > fixed[out] and objective.reached(counts - ones[out]):
            counts = counts - ones[out]
    return counts


def _balanced(
    objective: Objective, costs: Floats, room: Floats, other: NDArray[np.int64], counts: Floats, fixed: Floats
) -> Floats:
    """As many runs to one side as to the other, candidate by candidate, where that costs next to nothing."""
    least = objective.score(counts) - ALIKE
    lean = 0
    for one in (k for k in range(len(counts)) if k < other[k]):
        mirror = other[one]
        both = counts[one] + counts[mirror]
        share = (both + (1 if lean <= 0 else -1) * (both % 2)) / 2.0
        trial = counts.copy()
        trial[one] = max(share, fixed[one])
        trial[mirror] = max(both - trial[one], fixed[mirror])
        if np.all(trial @ costs <= room + 1e-9) and trial.sum() == counts.sum() and objective.score(trial) >= least:
            counts = trial
        lean += int(counts[one] - counts[mirror])
    return counts
