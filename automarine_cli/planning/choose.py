"""Which candidates to run: the best gain for its cost, run after run, then exchanges until none is better.

Greedy choice and exchange are Fedorov's (1972) and Mitchell's (1974, Technometrics 16:203) for D-optimal designs, here
with costs: a run is worth its gain over the share of what is left that it takes.
"""

from dataclasses import dataclass
from typing import Protocol

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
BETTER, MARKED = 1e-9, 1e-7
"""Gains in worth that count: of a run for its cost, and of an exchange."""


class Objective(Protocol):
    """What a campaign is for: what it is worth, and when it is enough."""

    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        """Worth of the campaign `counts` (K,) with one more run, each of `extras` (B,) in turn, (B,)."""
        ...

    def score(self, counts: Floats) -> float:
        """Worth of the campaign `counts` (K,)."""
        ...

    def reached(self, counts: Floats) -> bool:
        """Whether nothing more is wanted."""
        ...


@dataclass(frozen=True)
class Shop:
    """What may be chosen: `costs` (K, 4) of the candidates, `room` (4,) for all runs together, `fixed` (K,) runs that
    are in any case, `most` (K,) how often each may be run at most, `mirrors` (K,) the place of the same run to the
    other side."""

    costs: Floats
    room: Floats
    fixed: Floats
    most: Floats
    mirrors: NDArray[np.int64]

    def fits(self, counts: Floats) -> NDArray[np.int64]:
        """Which candidates may still be added to `counts` (K,)."""
        left = self.room - counts @ self.costs
        return np.flatnonzero((counts < self.most) & np.all(self.costs <= left + 1e-9, axis=1))

    def holds(self, counts: Floats) -> bool:
        """Whether `counts` (K,) is within the room."""
        few = np.all(counts <= np.maximum(self.most, self.fixed))
        return bool(few and np.all(counts @ self.costs <= self.room + 1e-9))

    def free(self, counts: Floats) -> NDArray[np.int64]:
        """Candidates of which a run may be taken out again."""
        return np.flatnonzero(counts > self.fixed)


def choose(objective: Objective, shop: Shop) -> NDArray[np.int64]:
    """How often to run each candidate, (K,): what the shop holds fixed, which must fit, and what is worth adding."""
    ones = np.eye(len(shop.costs))
    begun = shop.fixed.astype(float)
    pairs = [ones[k] + ones[other] for k, other in enumerate(shop.mirrors) if k <= other and shop.most[k] > 0]
    starts = [begun, *(begun + times * pair for times in BEGUN for pair in pairs)]
    filled = [_fill(objective, shop, start) for start in starts if shop.holds(start)]
    best = sorted(filled, key=lambda counts: -objective.score(counts))[:FINALISTS]
    ended = [_pruned(objective, shop, _improved(objective, shop, counts)) for counts in best]

    def worth(counts: Floats) -> tuple[bool, float]:
        enough = objective.reached(counts)
        return enough, -float(counts @ shop.costs[:, 0]) if enough else objective.score(counts)

    return _balanced(objective, shop, max(ended, key=worth)).astype(int)


def _improved(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """Exchange and rebuild until nothing changes."""
    for _ in range(SWEEPS):
        before = counts
        counts = _rebuild(objective, shop, _exchange(objective, shop, counts))
        if np.array_equal(before, counts):
            break
    return counts


def _fill(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """Add the run of the best worth for its cost until none fits or nothing more is wanted."""
    ones = np.eye(len(counts))
    while not objective.reached(counts) and len(fits := shop.fits(counts)):
        left = shop.room - counts @ shop.costs
        gain = objective.scores(counts, fits) - objective.score(counts)
        worth = gain / np.sum(shop.costs[fits] / np.maximum(left, 1e-12), axis=1)
        if worth.max() <= BETTER:
            break
        counts = counts + ones[fits[int(np.argmax(worth))]]
    return counts


def _exchange(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """Swap a run for another while that is better and fits."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for _ in range(SWEEPS):
        swapped = False
        for out in shop.free(counts):
            without = counts - ones[out]
            if not len(fits := shop.fits(without)):
                continue
            scores = objective.scores(without, fits)
            best = int(np.argmax(scores))
            if scores[best] > now + MARKED:
                counts, now, swapped = without + ones[fits[best]], float(scores[best]), True
        if not swapped:
            break
    return counts


def _rebuild(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """Leave out one run, or all of its like, and fill up again with what that frees, while that is better."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for out in shop.free(counts):
        for gone in dict.fromkeys((1.0, float(counts[out] - shop.fixed[out]))):
            if counts[out] - shop.fixed[out] < gone:
                continue
            trial = _fill(objective, shop, counts - gone * ones[out])
            worth = objective.score(trial)
            if worth > now + MARKED:
                counts, now = trial, worth
    return counts


def _pruned(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """Leave out, dearest first, what is not needed once nothing more is wanted."""
    ones = np.eye(len(counts))
    for out in sorted(shop.free(counts), key=lambda k: (-shop.costs[k, 0], k)):
        while counts[out] > shop.fixed[out] and objective.reached(counts - ones[out]):
            counts = counts - ones[out]
    return counts


def _balanced(objective: Objective, shop: Shop, counts: Floats) -> Floats:
    """As many runs to one side as to the other, candidate by candidate, where that costs next to nothing."""
    least, enough = objective.score(counts) - ALIKE, objective.reached(counts)
    lean = 0
    for one, mirror in ((k, other) for k, other in enumerate(shop.mirrors) if k < other):
        both = counts[one] + counts[mirror]
        trial = counts.copy()
        trial[one] = max((both + (1 if lean <= 0 else -1) * (both % 2)) / 2.0, shop.fixed[one])
        trial[mirror] = max(both - trial[one], shop.fixed[mirror])
        trial[one] = both - trial[mirror]
        kept = objective.reached(trial) if enough else objective.score(trial) >= least
        if kept and shop.holds(trial):
            counts = trial
        lean += int(counts[one] - counts[mirror])
    return counts
