"""The next campaign: candidates, what each would tell, the choice among them, what to expect of it, and a rehearsal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.planning.candidates import Candidate, Slot, Supply, in_order, paper_grid, scheduled
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import (
    directions,
    estimates_of,
    information,
    moving,
    predicted,
    relative_directions,
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
from automarine_cli.planning.rivals import Split, pairs_of, splits, with_effect
from automarine_cli.planning.selection import Choice, select
from automarine_cli.planning.tether import turns, ways_back
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.simulation.specification import SCHEMA

DISTURBED = (
    "The intervals allow for the disturbance and the unsteady thrust that the model's own runs had. In still water "
    "they would be narrower."
)


@dataclass(frozen=True)
class Curve:
    """Standard errors in percent of each parameter, `percent` (name -> one each minute given), after `minutes` in the
    pool and `motion` seconds of motion."""

    name: str
    minutes: tuple[float, ...]
    motion: tuple[float, ...]
    percent: dict[str, tuple[float, ...]]


@dataclass(frozen=True)
class Campaign:
    """A campaign on paper.

    `slots` are its runs in order, `why` what each is for, `turns` how far [degrees] each turns the vehicle and
    `ways_back` how far to turn to its start heading, against the tether's twist; `now`, `alone` and `together` the
    estimates by name before it, of its runs alone, and of these with the earlier ones (empty where these are not known
    or not to be used); `splits` what is expected of each pair of explanations, `grid_splits` of the same on the paper's
    grid; `plan` and `grid` the precision against minutes, `more` that of one run more of each kind.
    """

    fitting: Fitting
    limits: Limits
    wanted: tuple[str, ...]
    slots: tuple[Slot, ...]
    why: tuple[str, ...]
    turns: Floats
    ways_back: Floats
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
    known: PriorResults,
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
    narrowed; `seed` draws the order. A wanted parameter of an effect that the model lacks is planned for as if it were
    there. Raises SettingError where the limits allow no campaign, ModelError for a parameter that there is not.
    """
    known = suspecting(known, limits, largest, wanted)
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
    per_run, of_grid = information(fitting, runs), information(fitting, grid_runs)
    turned = turns(fitting.model, fitting.logger, runs)
    return Campaign(
        fitting=fitting,
        limits=limits,
        wanted=wanted,
        slots=slots,
        why=tuple(choice.why[one.label] for one in runs),
        turns=turned,
        ways_back=ways_back(turned, [one.start_heading for one in runs]),
        now=known.now,
        alone=predicted(fitting, per_run),
        together=_together(fitting, per_run, before, known) if earlier else {},
        splits=outcome,
        grid_splits=splits(pairs, grid_runs)[0],
        plan=curve_of("this plan", fitting, slots, per_run, before, limits),
        grid=curve_of("the paper's grid", fitting, grid, of_grid, before, limits),
        more=one_more(fitting, choice, slots, per_run, before, limits),
        notes=(*known.notes, *((DISTURBED,) if fitting.random else ()), *_short_of(outcome, limits)),
    )


def suspecting(known: PriorResults, limits: Limits, largest: float, wanted: Sequence[str]) -> PriorResults:
    """What is known, and the effects that `wanted` parameters name and the model lacks, as a search for them begins."""
    for name in dict.fromkeys(one.partition(" ")[0] for one in wanted):
        if name in effects.names() and name not in {term.name for term in known.model.terms} and not lacking(name):
            start = with_effect(fitting_of(known, limits), known.model, name, largest)[0]
            known = replace(known, model=start.model)
    return known


def fitting_of(known: PriorResults, limits: Limits) -> Fitting:
    """How the campaign will be fitted: by `diagnose` where the model holds effects, else by `fit-yaw`."""
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


def _short_of(outcome: Sequence[Split], limits: Limits) -> tuple[str, ...]:
    """Sentences on explanations that these limits do not split."""
    asked = limits.goal.evidence
    return tuple(
        f"Not split within these limits: {one.true} from {one.other} where {one.true} is true; {one.evidence:.1f} of "
        f"the {asked:g} asked for is expected. Allow more runs or time, or log what tells them apart directly."
        for one in outcome
        if one.evidence < asked
    )


def _together(fitting: Fitting, per_run: Floats, before: Floats, known: PriorResults) -> dict[str, Estimate]:
    """Estimates of the new runs and the earlier ones fitted together."""
    new = reported_covariance(moving(per_run))
    covariance = np.asarray(np.linalg.inv(np.linalg.pinv(new, hermitian=True) + before))
    dof = float(max(len(per_run) + known.used - 1, 1))
    return estimates_of(fitting, covariance, dict.fromkeys(directions(fitting), dof))


def curve_of(
    name: str, fitting: Fitting, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> Curve:
    """The curve of a campaign whose runs are made in order; `per_run` (R, p, p) is their information."""
    sums = np.cumsum(per_run, axis=0) + before
    rows = [_percent(fitting, one) for one in sums]
    minutes = tuple(slot.ends(limits.runs.rest_before_s) / 60.0 for slot in slots)
    motion = tuple(float(x) for x in np.cumsum([slot.candidate.motion for slot in slots]))
    return Curve(name, minutes, motion, {key: tuple(row[key] for row in rows) for key in rows[0]})


def one_more(
    fitting: Fitting, choice: Choice, slots: Sequence[Slot], per_run: Floats, before: Floats, limits: Limits
) -> tuple[Curve, ...]:
    """After the plan one run more, the best of each kind: a curve of one point a kind."""
    found, each, cost = choice.candidates, choice.each, choice.cost
    whole = per_run.sum(axis=0) + before
    kinds: dict[str, list[int]] = {}
    for place, one in enumerate(found):
        kinds.setdefault(one.kind, []).append(place)
    last = slots[-1].ends(limits.runs.rest_before_s) / 60.0
    motion = float(sum(slot.candidate.motion for slot in slots))
    points = []
    for kind, places in kinds.items():
        gains = [np.linalg.slogdet(whole + each[place])[1] for place in places]
        best = places[int(np.argmax(gains))]
        row = _percent(fitting, whole + each[best])
        points.append(
            Curve(
                kind, (last + float(cost[best, 0]),), (motion + found[best].motion,),
                {key: (value,) for key, value in row.items()},
            )
        )  # fmt: skip
    return tuple(points)


def _percent(fitting: Fitting, information: Floats) -> dict[str, float]:
    """Standard error of each parameter in percent of it."""
    covariance = np.asarray(np.linalg.inv(information))
    wanted = relative_directions(fitting)
    return {name: 100.0 * stderr_along(covariance, direction) for name, direction in wanted.items()}


def specification(campaign: Campaign, seed: int) -> tuple[dict[str, object], str]:
    """Plain data of the specification, and a sentence on what it leaves out; no data where it cannot be simulated."""
    fitting, limits = campaign.fitting, campaign.limits
    dof, (linear, quadratic) = fitting.model.dof, fitting.model.drag()
    own = dof.symbols
    if linear < 0 or quadratic < 0:
        return {}, "No plan.toml: a vehicle with negative drag cannot be simulated."
    added = fitting.model.terms[len(fitting.base.terms) :]
    can = [term for term in added if not effects.get(term.name).needs]
    left = [term.name for term in added if term not in can]
    rate = fitting.rate
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
        "logger": {"rate_hz": rate, "noise_deg": round(float(np.rad2deg(fitting.noise)), 6)} | gyro,
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
