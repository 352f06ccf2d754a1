"""The next campaign: candidates, what each would tell, the choice among them, and what to expect of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import SettingError
from automarine_cli.fits.estimate import Estimate
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.budget import Supply, allowance, costs
from automarine_cli.planning.candidates import Candidate, candidates, full_step, mirrors, paper_grid
from automarine_cli.planning.choose import Objective, choose
from automarine_cli.planning.comparison import Curve, curve_of, one_more
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import excursions, information, predicted, reported_covariance, told
from automarine_cli.planning.known import (
    NOISE_DEG,
    SCATTER,
    Known,
    covariance_now,
    information_now,
    wanted_directions,
)
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.rivals import Explanation, Split, closest, contest, splits, with_effect
from automarine_cli.planning.schedule import Slot, in_order, scheduled

Floats = NDArray[np.float64]

FAR = 1.5
"""A run turns far if it turns by more than this times what steps may; coasting after a step stays below it."""
ROUNDS = 2
"""How often rivals are fitted again to the runs chosen, and the choice made again."""


@dataclass(frozen=True)
class Campaign:
    """A campaign on paper.

    `slots` are its runs in order; `now`, `alone` and `together` the estimates by name before it, of its runs alone, and
    of these with the earlier ones (empty where these are not known or not to be used); `splits` what is expected of each
    pair of explanations, `grid_splits` of the same on the paper's grid; `plan` and `grid` the precision against minutes,
    `more` that of one run more of each kind.
    """

    fitting: Fitting
    limits: Limits
    supply: Supply
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
        """The runs in order."""
        return tuple(slot.candidate for slot in self.slots)

    @property
    def motion(self) -> float:
        """Time in motion over all runs [s]."""
        return float(sum(one.motion for one in self.candidates))


def plan_campaign(
    known: Known,
    limits: Limits,
    largest: float,
    supply: Supply,
    *,
    wanted: tuple[str, ...] = (),
    seed: int = 0,
    progress: Progress = silent,
) -> Campaign:
    """Choose runs for what is `known` within `limits`; moments up to `largest`.

    Doubts that a diagnosis left are split first, then the intervals of the `wanted` parameters (all by default) are
    narrowed; `seed` draws the order. Raises SettingError where the limits allow no campaign, ModelError for a parameter
    that the model does not have.
    """
    fitting = fitting_of(known, limits)
    directions = wanted_directions(fitting, wanted)
    found = _within_reach(fitting, candidates(fitting.base, limits, largest), limits, bool(known.doubts))
    spread = [one.at(start_heading=_heading(limits, i), clock=_clock(limits, i, len(found))) for i, one in enumerate(found)]
    cost, room = costs(found, limits, supply), allowance(limits)
    check = full_step(fitting.base, limits, largest) if limits.runs.repeat_first_last else None
    fixed = np.array([2.0 * (check is not None and one.label == check.label) for one in found])
    _refuse_too_little(cost, room, fixed, limits)
    before = information_now(fitting, known.now, limits.goal.use_earlier_runs)
    goal = limits.goal.half_width_percent
    grid_runs = scheduled(paper_grid(fitting.base, limits, largest), limits, supply)
    pairs = _pairs(known, fitting, [slot.candidate for slot in grid_runs], largest)
    objective = Objective(
        information(fitting, spread), before, directions, (), limits.goal.evidence, None if goal is None else goal / 196.0
    )
    at_grid = pairs
    for again in range(ROUNDS if pairs else 1):
        progress("choosing runs", again, ROUNDS)
        contests = tuple(contest(a.fitting, b.fitting, spread) for a, b in pairs)
        counts = choose(replace(objective, contests=contests), cost, room, mirrors(found), fixed)
        chosen = [one for one, count in zip(found, counts) for _ in range(count)]
        slots = scheduled(in_order(chosen, check, seed), limits, supply)
        outcome, pairs = splits(at_grid, [slot.candidate for slot in slots])
    progress("choosing runs", ROUNDS, ROUNDS)
    grid_outcome, _ = splits(at_grid, [slot.candidate for slot in grid_runs])
    per_run = information(fitting, [slot.candidate for slot in slots])
    alone = predicted(fitting, _of_moving(per_run))
    together = _together(fitting, per_run, before, known) if _uses_earlier(known, fitting, limits) else {}
    curves = (
        curve_of("this plan", fitting, slots, per_run, before, limits),
        curve_of("the paper's grid", fitting, grid_runs, information(fitting, [s.candidate for s in grid_runs]), before, limits),
    )
    more = one_more(fitting, found, objective.information, cost, slots, per_run, before, limits)
    return Campaign(
        fitting, limits, supply, wanted, slots, known.now, alone, together, outcome, grid_outcome, *curves, more, known.notes
    )


def _within_reach(
    fitting: Fitting, found: Sequence[Candidate], limits: Limits, splitting: bool
) -> list[Candidate]:
    """The candidates, each told whether it turns FAR; such runs are for splitting explanations only: to narrow an
    interval on water that turns along would be to narrow it about the wrong value."""
    most = FAR * np.deg2rad(limits.pool.turn_deg)
    told_so = [replace(one, turns=bool(turned > most)) for one, turned in zip(found, excursions(fitting, found))]
    return [one for one in told_so if splitting or not one.turns]


def fitting_of(known: Known, limits: Limits) -> Fitting:
    """How the campaign will be fitted: by `diagnose` where the model holds effects, else by `fit-yaw`."""
    plain = known.model.terms == _base_of(known.model).terms
    noise = limits.logger.noise_deg or known.noise_deg or NOISE_DEG
    given = limits.logger.gain_scatter
    scatter = known.scatter if given is None else given
    return Fitting(
        known.model,
        limits.runs.fit if plain else "diagnosis",
        float(np.deg2rad(noise)),
        SCATTER if scatter is None else scatter,
        limits.logger.rate_hz,
        limits.runs.rest_before_s,
        limits.battery.volts if limits.runs.voltages_V else None,
    )


def _base_of(model: YawModel) -> YawModel:
    return Fitting(model, "whole-runs", 1.0, 0.0).base


def _pairs(
    known: Known, fitting: Fitting, grid: Sequence[Candidate], largest: float
) -> tuple[tuple[Explanation, Explanation], ...]:
    """Each doubt both ways, (true, other): the other as it would look like the true one on the paper's grid."""
    found = []
    for doubt in known.doubts:
        true = replace(fitting, fit="diagnosis")
        terms = tuple(term for term in known.model.terms if term.name != doubt.effect)
        starts = with_effect(fitting, replace(known.model, terms=terms), doubt.rival, largest)
        other, _ = closest(true, starts, grid)
        found.append((Explanation(doubt.effect, true), Explanation(doubt.rival, other)))
        found.append((Explanation(doubt.rival, other), Explanation(doubt.effect, true)))
    return tuple(found)


def _uses_earlier(known: Known, fitting: Fitting, limits: Limits) -> bool:
    return limits.goal.use_earlier_runs and covariance_now(fitting, known.now) is not None


def _together(fitting: Fitting, per_run: Floats, before: Floats, known: Known) -> dict[str, Estimate]:
    """Estimates of the new runs and the earlier ones fitted together."""
    alone = _of_moving(per_run)
    covariance = np.linalg.inv(np.linalg.pinv(reported_covariance(alone), hermitian=True) + before)
    dof = float(max(len(alone) + known.used - 1, 1))
    names = predicted(fitting, alone)
    return told(fitting, covariance, dict.fromkeys(names, dof))


def _of_moving(per_run: Floats) -> Floats:
    """The runs that say anything: fits set rest records aside."""
    return per_run[np.array([bool(np.any(one)) for one in per_run])]


def _heading(limits: Limits, place: int) -> float:
    headings = limits.pool.start_headings_deg
    return headings[(place // 2) % len(headings)]


def _clock(limits: Limits, place: int, count: int) -> float:
    """Somewhere in the campaign: what depends on the clock is worked out again when the order is known."""
    return round(60.0 * limits.pool.minutes * ((7 * place) % count) / count, 1)


def _refuse_too_little(cost: Floats, room: Floats, fixed: Floats, limits: Limits) -> None:
    need = fixed @ cost if fixed.any() else 2.0 * cost.min(axis=0)
    names = ("pool.minutes", "pool.runs", "pool.motion_s", "battery.charge_Ah (less the reserve)")
    wait = limits.pool.wait_s / 60.0
    for name, asked, given in zip(names, need, room):
        if asked > given + 1e-9:
            less = wait if name == "pool.minutes" else 0.0
            raise SettingError(
                f"the limits allow no campaign: two runs already need {asked - less:.3g} of {name}, which is {given - less:.3g}; "
                "give more, or set runs.repeat_first_last = false"
            )
