"""Which runs to make: the best gain for its cost, run after run, then exchanges until none is better.

First come the fewest runs that split the explanations a diagnosis left open, then what narrows the intervals most.
Greedy choice and exchange are Fedorov's (1972) and Mitchell's (1974, Technometrics 16:203) for D-optimal designs, here
with costs: a run is worth its gain over the share of what is left that it takes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.candidates import Candidate, Supply, allowance, candidates, costs, full_step, mirrors
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import Intervals, Objective, excursions, information
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.rivals import Pair, Splitting, contest, head_start, splits
from automarine_cli.quantities import Floats

FAR = 1.5
"""A run turns far if it turns by more than this times what steps may; coasting after a step stays below it."""
ROUNDS = 3
"""How often the wrong explanation is fitted again to the runs chosen, and the choice made again."""
MARGIN = 1.3
"""By how much more evidence is asked for, and again when a choice fell short: what is linear in the choice is not
quite."""
QUANTILE = 2.2
"""Half width of an interval in standard errors: Student's t where about a dozen runs carry it."""
SWEEPS = 8
FINALISTS = 4
"""How many of the campaigns that the search begins with are improved to the end."""
ALIKE = 1e-3
"""Worth (a thousandth of the standard errors) that is given up for as many runs to one side as to the other."""
BEGUN = (1.0, 3.0)
"""How often each pair of mirrored candidates is run in the campaigns with which the search begins."""
BETTER, MARKED = 1e-9, 1e-7
"""Gains in worth that count: of a run for its cost, and of an exchange."""
DRIFT = "shows drift over the day"
NARROW = "narrows the intervals"


@dataclass(frozen=True)
class PlanBudget:
    """What may be chosen: `costs` (K, 4) of the candidates, `room` (4,) for all runs together, `fixed` (K,) runs that
    are in any case, `most` (K,) how often each may be run at most, `mirrors` (K,) the place of the same run to the
    other side; `sizes` (K, S) says which size of moment each has, and of one size are at most `alike` runs."""

    costs: Floats
    room: Floats
    fixed: Floats
    most: Floats
    mirrors: NDArray[np.int64]
    sizes: Floats
    alike: float

    def fits(self, counts: Floats) -> NDArray[np.int64]:
        """Which candidates may still be added to `counts` (K,)."""
        left = self.room - counts @ self.costs
        rare = self.sizes @ (counts @ self.sizes) < self.alike
        return np.flatnonzero((counts < self.most) & rare & np.all(self.costs <= left + 1e-9, axis=1))

    def holds(self, counts: Floats) -> bool:
        """Whether `counts` (K,) is within the room."""
        few = np.all(counts <= np.maximum(self.most, self.fixed))
        few &= np.all(counts @ self.sizes <= np.maximum(self.alike, self.fixed @ self.sizes))
        return bool(few and np.all(counts @ self.costs <= self.room + 1e-9))

    def free(self, counts: Floats) -> NDArray[np.int64]:
        """Candidates of which a run may be taken out again."""
        return np.flatnonzero(counts > self.fixed)


@dataclass(frozen=True)
class Choice:
    """The runs chosen, `why` by label; the `check` run among them, which comes first and last, or None; and what they
    were chosen from: candidates with their information (K, p, p) and `cost` (K, 4)."""

    chosen: tuple[Candidate, ...]
    why: Mapping[str, str]
    check: Candidate | None
    candidates: tuple[Candidate, ...]
    each: Floats
    cost: Floats


def select(
    fitting: Fitting,
    limits: Limits,
    largest: float,
    supply: Supply,
    before: Floats,
    wanted: Floats,
    pairs: Sequence[Pair],
    progress: Progress = silent,
) -> Choice:
    """Choose within the limits: `pairs` of explanations to split, then the directions `wanted` (p, m) to narrow, with
    the information `before` (p, p) at hand. Raises SettingError where the limits allow no campaign.

    Runs that turn far are for splitting explanations only: to narrow an interval on water that turns along would be to
    narrow it about the wrong value.
    """
    found = candidates(fitting.base, limits, largest)
    most = FAR * np.deg2rad(limits.pool.turn_deg)
    found = tuple(replace(one, turns=bool(turned > most)) for one, turned in zip(found, excursions(fitting, found)))
    spread = [_somewhere(one, i, len(found), limits) for i, one in enumerate(found)]
    check = full_step(fitting.base, limits, largest) if limits.runs.repeat_first_last else None
    fixed = np.array([2.0 * (check is not None and one.label == check.label) for one in found])
    cost = costs(found, limits, supply)
    room, sizes = allowance(limits), sizes_of(found)
    budget = PlanBudget(
        cost, room, fixed, np.full(len(found), float(limits.runs.most_alike)), np.array(mirrors(found)), sizes,
        _most_alike(cost, room, limits),
    )  # fmt: skip
    _refuse_too_little(budget, limits)
    progress("choosing runs", 0, 2)
    split = _split(pairs, spread, budget, limits) if pairs else fixed
    progress("choosing runs", 1, 2)
    each = information(fitting, spread)
    goal = limits.goal.half_width_percent
    intervals = Intervals(each, before, wanted, None if goal is None else goal / (100.0 * QUANTILE))
    near = np.where([one.turns for one in found], 0.0, budget.most)
    counts = choose(intervals, replace(budget, fixed=split, most=near))
    progress("choosing runs", 2, 2)
    chosen = tuple(one for one, count in zip(found, counts) for _ in range(count))
    names = " and ".join(dict.fromkeys(f"{a.name} from {b.name}" for a, b in pairs[::2]))
    why = {one.label: NARROW for one in chosen}
    why |= {one.label: f"splits {names}" for one, count in zip(found, split - fixed) if count > 0}
    if check is not None:
        why[check.label] = DRIFT
    return Choice(chosen, why, check, found, each, cost)


def _split(pairs: Sequence[Pair], spread: Sequence[Candidate], budget: PlanBudget, limits: Limits) -> Floats:
    """How often to run each candidate so that every pair is split, as cheaply as may be, (K,)."""
    starts = np.array([head_start(a, b, limits.pool.runs) for a, b in pairs])
    asked = np.maximum(MARGIN * limits.goal.evidence - starts, 1.0)
    about, counts = tuple(pairs), budget.fixed
    for _ in range(ROUNDS):
        contests = tuple(contest(a.fitting, b.fitting, spread) for a, b in about)
        counts = choose(Splitting(contests, asked), budget).astype(float)
        runs = [spread[i] for i, count in enumerate(counts.astype(int)) for _ in range(count)]
        outcome, about = splits(pairs, runs)
        short = np.array([one.evidence < limits.goal.evidence for one in outcome])
        if not short.any():
            break
        asked = np.where(short, MARGIN * asked, asked)
    return counts


def sizes_of(found: Sequence[Candidate]) -> Floats:
    """Which size of moment each candidate has, (K, S) of ones and zeros; a rest has none."""
    largest = np.array([max(abs(moment) for moment, _ in one.commands) for one in found])
    return (largest[:, None] == np.unique(largest[largest > 0])).astype(float)


def _most_alike(cost: Floats, room: Floats, limits: Limits) -> float:
    """How many runs may be of one size of moment, by how many there can be at all."""
    with np.errstate(divide="ignore"):
        runs = np.floor(np.min(room / cost.min(axis=0)))
    return float(max(2.0, np.ceil(runs * limits.runs.of_one_size_percent / 100.0)))


def _somewhere(one: Candidate, place: int, count: int, limits: Limits) -> Candidate:
    """The candidate at one of the start headings and somewhere in the campaign: what depends on either is worked out
    again when the order is known."""
    headings = limits.pool.start_headings_deg
    clock = 60.0 * limits.pool.minutes * ((7 * place) % count) / count
    return one.at(start_heading=headings[(place // 2) % len(headings)], clock=round(clock, 1))


def _refuse_too_little(budget: PlanBudget, limits: Limits) -> None:
    need = budget.fixed @ budget.costs if budget.fixed.any() else 2.0 * budget.costs.min(axis=0)
    names = ("pool.minutes", "pool.runs", "pool.motion_s", "battery.charge_Ah (less the reserve)")
    for name, asked, given in zip(names, need, budget.room):
        if asked > given + 1e-9:
            wait = limits.pool.wait_s / 60.0 if name == "pool.minutes" else 0.0
            raise SettingError(
                f"the limits allow no campaign: two runs already need {asked - wait:.3g} of {name}, and it is "
                f"{given - wait:.3g}; give more, or set runs.repeat_first_last = false"
            )


def choose(objective: Objective, budget: PlanBudget) -> NDArray[np.int64]:
    """How often to run each candidate, (K,): what the budget holds fixed, which must fit, and what is worth adding."""
    ones = np.eye(len(budget.costs))
    begun = budget.fixed.astype(float)
    pairs = [ones[k] + ones[other] for k, other in enumerate(budget.mirrors) if k <= other and budget.most[k] > 0]
    starts = [begun, *(begun + times * pair for times in BEGUN for pair in pairs)]
    filled = [_fill(objective, budget, start) for start in starts if budget.holds(start)]
    best = sorted(filled, key=lambda counts: -objective.score(counts))[:FINALISTS]
    ended = [_pruned(objective, budget, _improved(objective, budget, counts)) for counts in best]

    def worth(counts: Floats) -> tuple[bool, float]:
        enough = objective.reached(counts)
        return enough, -float(counts @ budget.costs[:, 0]) if enough else objective.score(counts)

    return _balanced(objective, budget, max(ended, key=worth)).astype(int)


def _improved(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Exchange and rebuild until nothing changes."""
    for _ in range(SWEEPS):
        before = counts
        counts = _rebuild(objective, budget, _exchange(objective, budget, counts))
        if np.array_equal(before, counts):
            break
    return counts


def _fill(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Add the run of the best worth for its cost until none fits or nothing more is wanted."""
    ones = np.eye(len(counts))
    while not objective.reached(counts) and len(fits := budget.fits(counts)):
        left = budget.room - counts @ budget.costs
        gain = objective.scores(counts, fits) - objective.score(counts)
        worth = gain / np.sum(budget.costs[fits] / np.maximum(left, 1e-12), axis=1)
        if worth.max() <= BETTER:
            break
        counts = counts + ones[fits[int(np.argmax(worth))]]
    return counts


def _exchange(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Swap a run for another while that is better and fits."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for _ in range(SWEEPS):
        swapped = False
        for out in budget.free(counts):
            without = counts - ones[out]
            if not len(fits := budget.fits(without)):
                continue
            scores = objective.scores(without, fits)
            best = int(np.argmax(scores))
            if scores[best] > now + MARKED:
                counts, now, swapped = without + ones[fits[best]], float(scores[best]), True
        if not swapped:
            break
    return counts


def _rebuild(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Leave out one run, or all of its like, and fill up again with what that frees, while that is better."""
    ones = np.eye(len(counts))
    now = objective.score(counts)
    for out in budget.free(counts):
        for gone in dict.fromkeys((1.0, float(counts[out] - budget.fixed[out]))):
            if counts[out] - budget.fixed[out] < gone:
                continue
            trial = _fill(objective, budget, counts - gone * ones[out])
            worth = objective.score(trial)
            if worth > now + MARKED:
                counts, now = trial, worth
    return counts


def _pruned(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Leave out, dearest first, what is not needed once nothing more is wanted."""
    ones = np.eye(len(counts))
    for out in sorted(budget.free(counts), key=lambda k: (-budget.costs[k, 0], k)):
        while counts[out] > budget.fixed[out] and objective.reached(counts - ones[out]):
            counts = counts - ones[out]
    return counts


def _balanced(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """As many runs to one side as to the other, candidate by candidate, where that costs next to nothing."""
    least, enough = objective.score(counts) - ALIKE, objective.reached(counts)
    lean = 0
    for one, mirror in ((k, other) for k, other in enumerate(budget.mirrors) if k < other):
        both = counts[one] + counts[mirror]
        trial = counts.copy()
        trial[one] = max((both + (1 if lean <= 0 else -1) * (both % 2)) / 2.0, budget.fixed[one])
        trial[mirror] = max(both - trial[one], budget.fixed[mirror])
        trial[one] = both - trial[mirror]
        kept = objective.reached(trial) if enough else objective.score(trial) >= least
        if kept and budget.holds(trial):
            counts = trial
        lean += int(counts[one] - counts[mirror])
    return counts
