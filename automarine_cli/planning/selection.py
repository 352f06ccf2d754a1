"""Which runs: first the fewest that split the explanations a diagnosis left open, then what narrows the intervals
most."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.budget import Supply, allowance, costs
from automarine_cli.planning.candidates import Candidate, candidates, full_step, mirrors
from automarine_cli.planning.choose import Shop, choose
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import excursions, information
from automarine_cli.planning.known import Known
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.objectives import Intervals, Splitting
from automarine_cli.planning.rivals import (
    Explanation,
    closest,
    contest,
    head_start,
    shows,
    splits,
    with_effect,
)

Floats = NDArray[np.float64]
Pair = tuple[Explanation, Explanation]

FAR = 1.5
"""A run turns far if it turns by more than this times what steps may; coasting after a step stays below it."""
ROUNDS = 3
"""How often the wrong explanation is fitted again to the runs chosen, and the choice made again."""
MARGIN = 1.3
"""By how much more evidence is asked for, and again when a choice fell short: what is linear in the choice is not
quite."""

QUANTILE = 2.2
"""Half width of an interval in standard errors: Student's t where about a dozen runs carry it."""

DRIFT = "shows drift over the day"
NARROW = "narrows the intervals"


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
    found = tuple(
        replace(one, turns=bool(turned > most)) for one, turned in zip(found, excursions(fitting, found))
    )
    spread = [_somewhere(one, i, len(found), limits) for i, one in enumerate(found)]
    check = full_step(fitting.base, limits, largest) if limits.runs.repeat_first_last else None
    fixed = np.array([2.0 * (check is not None and one.label == check.label) for one in found])
    cost = costs(found, limits, supply)
    shop = Shop(
        cost,
        allowance(limits),
        fixed,
        np.full(len(found), float(limits.runs.most_alike)),
        np.array(mirrors(found)),
    )
    _refuse_too_little(shop, limits)
    progress("choosing runs", 0, 2)
    split = _split(pairs, found, spread, shop, limits) if pairs else fixed
    progress("choosing runs", 1, 2)
    each = information(fitting, spread)
    goal = limits.goal.half_width_percent
    intervals = Intervals(each, before, wanted, None if goal is None else goal / (100.0 * QUANTILE))
    near = np.where([one.turns for one in found], 0.0, shop.most)
    counts = choose(intervals, replace(shop, fixed=split, most=near))
    progress("choosing runs", 2, 2)
    chosen = tuple(one for one, count in zip(found, counts) for _ in range(count))
    names = " and ".join(dict.fromkeys(f"{a.name} from {b.name}" for a, b in pairs[::2]))
    why = {one.label: NARROW for one in chosen}
    why |= {one.label: f"splits {names}" for one, count in zip(found, split - fixed) if count > 0}
    if check is not None:
        why[check.label] = DRIFT
    return Choice(chosen, why, check, found, each, cost)


def pairs_of(known: Known, fitting: Fitting, grid: Sequence[Candidate], largest: float) -> tuple[Pair, ...]:
    """Each doubt both ways, (true, other): the rival as it would look like the effect named on the runs of `grid`.

    A rival that could imitate only by vanishing is asked for one way alone.
    """
    found: list[Pair] = []
    for doubt in known.doubts:
        terms = tuple(term for term in known.model.terms if term.name != doubt.effect)
        starts = with_effect(fitting, replace(known.model, terms=terms), doubt.rival, largest)
        true = Explanation(doubt.effect, replace(fitting, fit="diagnosis"))
        half = grid[: len(grid) // 2]
        other = Explanation(doubt.rival, closest(true.fitting, starts, half)[0])
        found.append((true, other))
        if shows(other, half):
            found.append((other, true))
    return tuple(found)


def _split(
    pairs: Sequence[Pair], found: Sequence[Candidate], spread: Sequence[Candidate], shop: Shop, limits: Limits
) -> Floats:
    """How often to run each candidate so that every pair is split, as cheaply as may be, (K,)."""
    starts = np.array([head_start(a, b, limits.pool.runs) for a, b in pairs])
    asked = np.maximum(MARGIN * limits.goal.evidence - starts, 1.0)
    about, counts = tuple(pairs), shop.fixed
    for _ in range(ROUNDS):
        contests = tuple(contest(a.fitting, b.fitting, spread) for a, b in about)
        counts = choose(Splitting(contests, asked), shop).astype(float)
        runs = [spread[i] for i, count in enumerate(counts.astype(int)) for _ in range(count)]
        outcome, about = splits(pairs, runs)
        short = np.array([one.evidence < limits.goal.evidence for one in outcome])
        if not short.any():
            break
        asked = np.where(short, MARGIN * asked, asked)
    return counts


def _somewhere(one: Candidate, place: int, count: int, limits: Limits) -> Candidate:
    """The candidate at one of the start headings and somewhere in the campaign: what depends on either is worked out
    again when the order is known."""
    headings = limits.pool.start_headings_deg
    clock = 60.0 * limits.pool.minutes * ((7 * place) % count) / count
    return one.at(start_heading=headings[(place // 2) % len(headings)], clock=round(clock, 1))


def _refuse_too_little(shop: Shop, limits: Limits) -> None:
    need = shop.fixed @ shop.costs if shop.fixed.any() else 2.0 * shop.costs.min(axis=0)
    names = ("pool.minutes", "pool.runs", "pool.motion_s", "battery.charge_Ah (less the reserve)")
    for name, asked, given in zip(names, need, shop.room):
        if asked > given + 1e-9:
            wait = limits.pool.wait_s / 60.0 if name == "pool.minutes" else 0.0
            raise SettingError(
                f"the limits allow no campaign: two runs already need {asked - wait:.3g} of {name}, and it is "
                f"{given - wait:.3g}; give more, or set runs.repeat_first_last = false"
            )
