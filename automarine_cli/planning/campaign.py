"""The next campaign: the choice of its runs, their order and ways back, what to expect of it, and a rehearsal.

A run is worth its gain over the share of what is left that it takes. First come the fewest runs that split the
explanations a diagnosis left open, then what narrows the intervals most; then exchanges until none is better. Greedy
choice and exchange are Fedorov's (1972) and Mitchell's (1974, Technometrics 16:203) for D-optimal designs, here with
costs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.comparison.simulated_runs import roll
from automarine_cli.errors import SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.candidates import (
    Candidate,
    Slot,
    Supply,
    allowance,
    candidates,
    costs,
    full_step,
    in_order,
    mirrors,
    paper_grid,
    scheduled,
)
from automarine_cli.planning.information import (
    Fitting,
    Intervals,
    Logger,
    alike,
    moving,
    reported_covariance,
    stderr_along,
)
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.prior_results import (
    NOISE_DEG,
    SCATTER,
    PriorResults,
    covariance_now,
    information_now,
    lacking,
    wanted_directions,
)
from automarine_cli.planning.rivals import Pair, Split, Splitting, contest, head_start, pairs_of, splits, with_effect
from automarine_cli.quantities import Floats
from automarine_cli.simulation.specification import SCHEMA

FAR = 1.5  # a run turns far if it turns by more than this times what steps may; coasting after a step stays below it
ROUNDS = 3  # how often the wrong explanation is fitted again to the runs chosen, and the choice made again
MARGIN = 1.3
"""By how much more evidence is asked for, and again when a choice fell short: what is linear in the choice is not
quite."""
Objective = Intervals | Splitting
QUANTILE = 2.2  # half width of an interval in standard errors: Student's t where about a dozen runs carry it
SWEEPS = 8
FINALISTS = 4  # how many of the campaigns that the search begins with are improved to the end
ALIKE = 1e-3
"""Worth (a thousandth of the standard errors) that is given up for as many runs to one side as to the other."""
BEGUN = (1.0, 3.0)  # how often each pair of mirrored candidates is run in the campaigns with which the search begins
BETTER, MARKED = 1e-9, 1e-7  # gains in worth that count: of a run for its cost, and of an exchange
DRIFT = "shows drift over the day"
NARROW = "narrows the intervals"
DISTURBED = (
    "The intervals allow for the disturbance and the unsteady thrust that the model's own runs had. In still water "
    "they would be narrower."
)


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
        """Tell which candidates may still be added to `counts` (K,)."""
        left = self.room - counts @ self.costs
        rare = self.sizes @ (counts @ self.sizes) < self.alike
        return np.flatnonzero((counts < self.most) & rare & np.all(self.costs <= left + 1e-9, axis=1))

    def holds(self, counts: Floats) -> bool:
        few = np.all(counts <= np.maximum(self.most, self.fixed))
        few &= np.all(counts @ self.sizes <= np.maximum(self.alike, self.fixed @ self.sizes))
        return bool(few and np.all(counts @ self.costs <= self.room + 1e-9))

    def free(self, counts: Floats) -> NDArray[np.int64]:
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
    fitting: Fitting, limits: Limits, largest: float, supply: Supply, before: Floats, wanted: Floats,
    pairs: Sequence[Pair], progress: Progress = silent,
) -> Choice:  # fmt: skip
    """Choose within the limits: `pairs` of explanations to split, then the directions `wanted` (p, m) to narrow, with
    the information `before` (p, p) at hand. Raises SettingError where the limits allow no campaign.

    Runs that turn far are for splitting explanations only: to narrow an interval on water that turns along would be to
    narrow it about the wrong value.
    """
    found = candidates(fitting.base, limits, largest)
    most = FAR * np.deg2rad(limits.pool.turn_deg)
    furthest = (np.abs(heading).max() for heading in headings_of(fitting.model, fitting.logger, found))
    found = tuple(replace(run, turns=bool(turned > most)) for run, turned in zip(found, furthest))
    # at one of the start headings and somewhere in the campaign: what depends on either is worked out again later
    headings, minutes, count = limits.pool.start_headings_deg, limits.pool.minutes, len(found)
    spread = [
        run.at(
            start_heading=headings[(i // 2) % len(headings)], clock=round(60.0 * minutes * ((7 * i) % count) / count, 1)
        )
        for i, run in enumerate(found)
    ]
    check = full_step(fitting.base, limits, largest) if limits.runs.repeat_first_last else None
    fixed = np.array([2.0 * (check is not None and one.label == check.label) for one in found])
    cost = costs(found, limits, supply)
    room, most_alike = allowance(limits), np.full(count, float(limits.runs.most_alike))
    with np.errstate(divide="ignore"):
        runs = np.floor(np.min(room / cost.min(axis=0)))  # that there can be at all
    of_one_size = float(max(2.0, np.ceil(runs * limits.runs.of_one_size_percent / 100.0)))
    budget = PlanBudget(cost, room, fixed, most_alike, np.array(mirrors(found)), sizes_of(found), of_one_size)
    _refuse_too_little(budget, limits)
    progress("choosing runs", 0, 2)
    split = _split(pairs, spread, budget, limits) if pairs else fixed
    progress("choosing runs", 1, 2)
    each = fitting.information(spread)
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
    """Tell which size of moment each candidate has, (K, S) of ones and zeros; a rest has none."""
    largest = np.array([max(abs(moment) for moment, _ in one.commands) for one in found])
    return (largest[:, None] == np.unique(largest[largest > 0])).astype(float)


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
    """Choose how often to run each candidate, (K,): what the budget holds fixed, which must fit, and what is worth
    adding."""
    ones = np.eye(len(budget.costs))
    begun = budget.fixed.astype(float)
    pairs = [ones[k] + ones[other] for k, other in enumerate(budget.mirrors) if k <= other and budget.most[k] > 0]
    starts = [begun, *(begun + times * pair for times in BEGUN for pair in pairs)]
    filled = [_fill(objective, budget, start) for start in starts if budget.holds(start)]
    best = sorted(filled, key=lambda counts: -_score(objective, counts))[:FINALISTS]
    ended = []
    for counts in best:
        for _ in range(SWEEPS):
            before, counts = counts, _rebuild(objective, budget, _exchange(objective, budget, counts))
            if np.array_equal(before, counts):
                break
        ended.append(_pruned(objective, budget, counts))

    def worth(counts: Floats) -> tuple[bool, float]:
        enough = objective.reached(counts)
        return enough, -float(counts @ budget.costs[:, 0]) if enough else _score(objective, counts)

    return _balanced(objective, budget, max(ended, key=worth)).astype(int)


def _score(objective: Objective, counts: Floats) -> float:
    return float(objective.scores(counts)[0])


def _fill(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Add the run of the best worth for its cost until none fits or nothing more is wanted."""
    ones = np.eye(len(counts))
    while not objective.reached(counts) and len(fits := budget.fits(counts)):
        left = budget.room - counts @ budget.costs
        gain = objective.scores(counts, fits) - _score(objective, counts)
        worth = gain / np.sum(budget.costs[fits] / np.maximum(left, 1e-12), axis=1)
        if worth.max() <= BETTER:
            break
        counts = counts + ones[fits[int(np.argmax(worth))]]
    return counts


def _exchange(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Swap a run for another while that is better and fits."""
    ones = np.eye(len(counts))
    now = _score(objective, counts)
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
    now = _score(objective, counts)
    for out in budget.free(counts):
        for gone in dict.fromkeys((1.0, float(counts[out] - budget.fixed[out]))):
            if counts[out] - budget.fixed[out] < gone:
                continue
            trial = _fill(objective, budget, counts - gone * ones[out])
            worth = _score(objective, trial)
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
    least, enough = _score(objective, counts) - ALIKE, objective.reached(counts)
    lean = 0
    for one, mirror in ((k, other) for k, other in enumerate(budget.mirrors) if k < other):
        both = counts[one] + counts[mirror]
        trial = counts.copy()
        trial[one] = max((both + (1 if lean <= 0 else -1) * (both % 2)) / 2.0, budget.fixed[one])
        trial[mirror] = max(both - trial[one], budget.fixed[mirror])
        trial[one] = both - trial[mirror]
        kept = objective.reached(trial) if enough else _score(objective, trial) >= least
        if kept and budget.holds(trial):
            counts = trial
        lean += int(counts[one] - counts[mirror])
    return counts


@dataclass(frozen=True)
class Curve:
    """Standard errors in percent of each parameter by name, after so many minutes in the pool and seconds of motion."""

    campaign: str
    minutes: tuple[float, ...]
    motion_s: tuple[float, ...]
    stderr_percent: dict[str, tuple[float, ...]]


@dataclass(frozen=True)
class Campaign:
    """A campaign on paper.

    `slots` are its runs in order; `now`, `alone` and `together` the estimates by name before it, of its runs alone, and
    of these with the earlier ones (empty where these are not known or not to be used); `splits` what is expected of
    each pair of explanations, `grid_splits` of the same on the paper's grid; `plan` and `grid` the precision against
    minutes, `more` that of one run more of each kind.
    """

    fitting: Fitting
    limits: Limits
    wanted: tuple[str, ...]
    slots: tuple[Slot, ...]
    now: Mapping[str, Estimate]
    alone: Mapping[str, Estimate]
    together: Mapping[str, Estimate]
    splits: tuple[Split, ...]
    grid_splits: tuple[Split, ...]
    plan: Curve
    grid: Curve
    more: tuple[Curve, ...]
    notes: tuple[str, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        return tuple(slot.candidate for slot in self.slots)

    @property
    def motion(self) -> float:
        return float(sum(candidate.motion for candidate in self.candidates))


def plan_campaign(
    known: PriorResults, limits: Limits, largest: float, supply: Supply, *, wanted: tuple[str, ...] = (), seed: int = 0,
    progress: Progress = silent,
) -> Campaign:  # fmt: skip
    """Choose runs for what is `known` within `limits`; moments up to `largest`.

    Doubts that a diagnosis left are split first, then the intervals of the `wanted` parameters (all by default) are
    narrowed; `seed` draws the order. A wanted parameter of an effect that the model lacks is planned for as if it were
    there. Raises SettingError where the limits allow no campaign, ModelError for a parameter that there is not.
    """
    for name in dict.fromkeys(parameter.partition(" ")[0] for parameter in wanted):
        if name in effects.names() and name not in {term.name for term in known.model.terms} and not lacking(name):
            start = with_effect(fitting_of(known, limits), known.model, name, largest)[0]
            known = replace(known, model=start.model)
    fitting = fitting_of(known, limits)
    wanted_ones = wanted_directions(fitting, wanted)
    earlier = limits.goal.use_earlier_runs and covariance_now(fitting, known.now) is not None
    before = information_now(fitting, known.now, earlier)
    grid = scheduled(paper_grid(fitting.base, largest), limits, supply)
    grid_runs = [slot.candidate for slot in grid]
    pairs = pairs_of(known, fitting, grid_runs, largest)
    choice = select(fitting, limits, largest, supply, before, wanted_ones, pairs, progress)
    slots = scheduled(in_order(choice.chosen, choice.check, seed), limits, supply)
    runs = [slot.candidate for slot in slots]
    outcome = splits(pairs, runs)[0]
    per_run, of_grid = fitting.information(runs), fitting.information(grid_runs)
    turned = np.rad2deg([heading[-1] for heading in headings_of(fitting.model, fitting.logger, runs)])
    there = ways_back(turned, [run.start_heading for run in runs])
    slots = tuple(
        replace(slot, why=choice.why[slot.candidate.label], turns=float(turn), turn_there=float(back))
        for slot, turn, back in zip(slots, turned, there)
    )
    evidence = limits.goal.evidence
    short = (
        f"Not split within these limits: {split.true} from {split.other} where {split.true} is true; "
        f"{split.evidence:.1f} of the {evidence:g} asked for is expected. Allow more runs or time, or log what tells "
        "them apart directly."
        for split in outcome
        if split.evidence < evidence
    )
    together: dict[str, Estimate] = {}
    if earlier:
        new = np.linalg.pinv(reported_covariance(moving(per_run)), hermitian=True)
        dof = float(max(len(per_run) + known.used - 1, 1))
        covariance = np.asarray(np.linalg.inv(new + before))
        together = fitting.estimates(covariance, dict.fromkeys(fitting.directions, dof))
    return Campaign(
        fitting=fitting, limits=limits, wanted=wanted, slots=slots, now=known.now, alone=fitting.predicted(per_run),
        together=together, splits=outcome, grid_splits=splits(pairs, grid_runs)[0],
        plan=curve_of("this plan", fitting, slots, per_run, before, limits),
        grid=curve_of("the paper's grid", fitting, grid, of_grid, before, limits),
        more=one_more(fitting, choice, slots, per_run, before, limits),
        notes=(*known.notes, *((DISTURBED,) if fitting.random else ()), *short),
    )  # fmt: skip


def fitting_of(known: PriorResults, limits: Limits) -> Fitting:
    """Say how the campaign will be fitted: by `diagnose` where the model holds effects, else by `fit-yaw`."""
    base = Fitting(known.model, "whole-runs", 1.0, 0.0).base
    noise = limits.logger.noise_deg or known.noise_deg or NOISE_DEG
    rate_noise = limits.logger.rate_noise_deg_s or known.rate_noise_deg_s
    given = limits.logger.gain_scatter
    scatter = known.scatter if given is None else given
    names = (*(term.name for term in known.model.terms), *(doubt.rival for doubt in known.doubts))
    electric = limits.runs.voltages_V or any("voltage" in effects.get(name).needs for name in names)
    return Fitting(
        known.model,
        limits.runs.fit if known.model == base else "diagnosis",
        float(np.deg2rad(noise)),
        SCATTER if scatter is None else scatter,
        limits.logger.rate_hz,
        limits.runs.rest_before_s,
        limits.battery.volts if electric else None,
        base,
        None if rate_noise is None else float(np.deg2rad(rate_noise)),
        known.random if given is None else {**known.random, "gain-scatter": given} if known.random else {},
    )


def curve_of(
    name: str, fitting: Fitting, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> Curve:
    """Return the curve of a campaign whose runs are made in order; `per_run` (R, p, p) is their information."""
    sums = np.cumsum(per_run, axis=0) + before
    rows = [_percent(fitting, total) for total in sums]
    minutes = tuple(slot.ends(limits.runs.rest_before_s) / 60.0 for slot in slots)
    motion = tuple(float(x) for x in np.cumsum([slot.candidate.motion for slot in slots]))
    return Curve(name, minutes, motion, {key: tuple(row[key] for row in rows) for key in rows[0]})


def one_more(
    fitting: Fitting, choice: Choice, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> tuple[Curve, ...]:
    """Return what one run more, the best of each kind, adds to the plan: a curve of one point a kind."""
    total = per_run.sum(axis=0) + before
    last = slots[-1].ends(limits.runs.rest_before_s) / 60.0
    motion = float(sum(slot.candidate.motion for slot in slots))
    points = []
    for kind, places in alike(choice.candidates).items():
        gains = [np.linalg.slogdet(total + choice.each[place])[1] for place in places]
        best = places[int(np.argmax(gains))]
        percent: dict[str, tuple[float, ...]] = {
            key: (value,) for key, value in _percent(fitting, total + choice.each[best]).items()
        }
        minutes = last + float(choice.cost[best, 0])
        points.append(Curve(kind, (minutes,), (motion + choice.candidates[best].motion,), percent))
    return tuple(points)


def _percent(fitting: Fitting, information: Floats) -> dict[str, float]:
    covariance = np.asarray(np.linalg.inv(information))
    wanted = fitting.relative_directions
    return {name: 100.0 * stderr_along(covariance, direction) for name, direction in wanted.items()}


def specification(campaign: Campaign, seed: int) -> tuple[dict[str, object], str]:
    """Return plain data of the specification, and a sentence on what it leaves out; no data where it cannot be
    simulated."""
    fitting, limits = campaign.fitting, campaign.limits
    dof, (linear, quadratic) = fitting.model.dof, fitting.model.drag()
    own = dof.symbols
    if linear < 0 or quadratic < 0:
        return {}, "No plan.toml: a vehicle with negative drag cannot be simulated."
    added = fitting.model.terms[len(fitting.base.terms) :]
    can = [term for term in added if not effects.get(term.name).needs]
    left = [term.name for term in added if term not in can]
    read = fitting.rate_noise
    gyro = {} if read is None else {"rate_noise_deg_s": round(float(np.rad2deg(read)), 6)}
    return {
        "schema": SCHEMA,
        "seed": seed,
        "vehicle": {
            own.inertia: fitting.model.inertia, own.quadratic: quadratic, own.linear: linear,
            f"{dof.words.force}_unit": fitting.model.moment_unit,
        },
        "effects": [
            {"name": term.name} | dict(zip(effects.get(term.name).names_in(dof), term.values))
            for term in can
        ],
        "logger": {"rate_hz": fitting.rate, "noise_deg": round(float(np.rad2deg(fitting.noise)), 6)} | gyro,
        "scatter": {
            "gain": fitting.scatter,
            "start_heading_deg": [slot.candidate.start_heading for slot in campaign.slots],
        },
        "campaign": {
            "order": "listed", "rest_before_s": limits.runs.rest_before_s, "wait_between_s": limits.pool.wait_s,
        },
        "runs": [
            {
                "kind": "sequence", "name": slot.name, "wait_after_s": slot.wait,
                "commands": [[moment, seconds] for moment, seconds in slot.candidate.commands],
            }
            for slot in campaign.slots
        ],
    }, f"Simulated runs lack what {', '.join(left)} needs." if left else ""  # fmt: skip


def headings_of(model: YawModel, logger: Logger, candidates: Sequence[Candidate]) -> list[Floats]:
    """Return the heading of the model in each run, less that at its start [rad]."""
    headings = [np.zeros(0)] * len(candidates)
    for places in alike(candidates).values():
        runs = [logger.run(candidates[place]) for place in places]
        rolled = roll(model, runs, np.zeros(len(runs)), np.zeros(len(runs))).position[0]
        for place, run, row in zip(places, runs, rolled):
            headings[place] = row[: len(run.time)] - row[0]
    return headings


def ways_back(turned: Floats, start_headings: Sequence[float]) -> Floats:
    """Return how far [degrees] to turn to each run's start heading after the run before it, (R,), nothing before the
    first.

    Of all ways there, with whole turns or without, the one after which the tether is twisted by half a turn at most; of
    two such ways the shorter.
    """
    back, twist = [0.0], 0.0
    for turn, heading in zip(turned[:-1], start_headings[1:]):
        twist += turn
        wanted = (heading - start_headings[0] + 180.0) % 360.0 - 180.0
        ways = [wanted - twist, *([360.0 + wanted - twist] if wanted == -180.0 else [])]
        back.append(min(ways, key=abs))
        twist += back[-1]
    return np.array(back)
