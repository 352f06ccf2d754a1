"""The next campaign: the choice of its runs, their order and ways back, what to expect of it, and a rehearsal.

A run is worth its gain over the share of what is left that it takes. First come the fewest runs that split the
explanations a diagnosis left open, then what narrows the intervals most; then exchanges until none is better (Fedorov
1972; Mitchell 1974, Technometrics 16:203, for D-optimal designs; here with costs).
"""

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import floor, log10, radians
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.comparison.simulated_runs import roll
from automarine_cli.dofs import YAW
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, given_columns
from automarine_cli.models.model import Model
from automarine_cli.models.store import model_head
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import Codec, Document, Shown, Source, read_mapping, to_mapping
from automarine_cli.planning import candidates as pool
from automarine_cli.planning import information as info
from automarine_cli.planning import rivals
from automarine_cli.planning.candidates import PLAN, Limits, PaperRun, Supply, TimedRun, consumption, drive_of
from automarine_cli.planning.information import Fitting, Intervals, PlannedLog, PriorResults
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.simulation.specification import SIMULATION_SCHEMA, time_to_turn, zigzags
from automarine_cli.thrusters.bollard_data import Series, load_thruster_logs
from automarine_cli.thrusters.map import ThrusterMap, TwinThrusters, map_and_arm

FAR_TURN_RATIO = 1.5  # a run turns far if it turns by more than this times what steps may; coasting stays below it
MAX_SPLIT_ROUNDS = 3  # how often the wrong explanation is fitted again to the runs chosen, and the choice made again
EVIDENCE_MARGIN = 1.3
"""By how much more evidence is asked for, and again when a choice fell short: it is not quite linear."""
Objective = Intervals | rivals.Discrimination
HALF_WIDTH_STDERRS = 2.2  # half width of an interval in standard errors: Student's t where about a dozen runs carry it
MAX_SWEEPS = 8
BALANCE_WORTH = 1e-3
"""Worth (a thousandth of the standard errors) that is given up for as many runs to one side as to the other."""
MIN_WORTH_GAIN, MIN_EXCHANGE_GAIN = 1e-9, 1e-7  # gains in worth that count: of a run for its cost, and of an exchange
SHOWS_DRIFT = "shows drift over the day"
NARROWS_INTERVALS = "narrows the intervals"
TELLS_INERTIA_AND_DRAG = "tells inertia and drag"
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
        room = self.room - counts @ self.costs
        rare = self.sizes @ (counts @ self.sizes) < self.alike
        return np.flatnonzero((counts < self.most) & rare & np.all(self.costs <= room + 1e-9, axis=1))

    def holds(self, counts: Floats) -> bool:
        few = np.all(counts <= np.maximum(self.most, self.fixed))
        few &= np.all(counts @ self.sizes <= np.maximum(self.alike, self.fixed @ self.sizes))
        return bool(few and np.all(counts @ self.costs <= self.room + 1e-9))

    def free(self, counts: Floats) -> NDArray[np.int64]:
        return np.flatnonzero(counts > self.fixed)


def select(
    fitting: Fitting, limits: Limits, largest: float, supply: Supply, before: Floats, wanted: Floats,
    pairs: Sequence[rivals.Pair], progress: Progress = silent,
) -> tuple[list[PaperRun], dict[str, str], PaperRun | None]:  # fmt: skip
    """Choose runs within the limits, say why by label, and which of them is the check that comes first and last.

    `pairs` of explanations are split first, then the directions `wanted` (p, m) are narrowed, with the information
    `before` (p, p) at hand. Runs that turn far only split explanations: on water that turns along they would narrow an
    interval about the wrong value. Raises SettingError where the limits allow no campaign."""
    candidates = runs_of(fitting, limits, largest)
    # a vehicle with way on leaves the water that it turned
    most = np.inf if fitting.steered else FAR_TURN_RATIO * np.deg2rad(limits.pool.turn_deg)
    furthest = (np.abs(heading).max() for heading in headings_of(fitting.model, fitting.logger, candidates))
    candidates = tuple(replace(run, turns=bool(turned > most)) for run, turned in zip(candidates, furthest))
    # at one of the start headings and somewhere in the campaign: what depends on either is worked out again later
    headings, seconds, count = limits.pool.start_headings_deg, 60.0 * limits.pool.minutes, len(candidates)
    spread = [
        replace(run, start_heading=headings[i // 2 % len(headings)], clock=round(seconds * (7 * i % count) / count, 1))
        for i, run in enumerate(candidates)
    ]
    check = None
    if limits.runs.repeat_first_last:
        check = candidates[0] if fitting.steered else pool.step_of(fitting.base, largest, limits.pool.turn_deg)
    fixed = np.array([2.0 * (check is not None and candidate.label == check.label) for candidate in candidates])
    cost = pool.costs(candidates, limits, supply)
    room, most_alike = pool.allowance(limits), np.full(count, float(limits.runs.most_alike))
    with np.errstate(divide="ignore"):
        runs = np.floor(np.min(room / cost.min(axis=0)))  # that there can be at all
    of_one_size = float(max(2.0, np.ceil(runs * limits.runs.of_one_size_percent / 100.0)))
    mirrors = np.array(pool.mirrors(candidates))
    sizes = np.array([max(abs(moment) for moment, _ in candidate.commands) for candidate in candidates])
    of_size = (sizes[:, None] == np.unique(sizes[sizes > 0])).astype(float)  # a rest is of none
    budget = PlanBudget(cost, room, fixed, most_alike, mirrors, of_size, of_one_size)
    _refuse_too_little(2, fixed @ cost if fixed.any() else 2.0 * cost.min(axis=0), limits)
    progress("choosing runs", 0, 2)
    split = _split(pairs, spread, budget, limits) if pairs else fixed
    progress("choosing runs", 1, 2)
    goal = limits.goal.half_width_percent
    goal = None if goal is None else goal / (100.0 * HALF_WIDTH_STDERRS)
    intervals = Intervals(fitting.information(spread), before, wanted, goal)
    most_each = np.where([candidate.turns for candidate in candidates], 0.0, budget.most)
    counts = choose(intervals, replace(budget, fixed=split, most=most_each))
    progress("choosing runs", 2, 2)
    chosen = [candidate for candidate, count in zip(candidates, counts) for _ in range(count)]
    names = " and ".join(dict.fromkeys(f"{a.explained_by} from {b.explained_by}" for a, b in pairs[::2]))
    why = {candidate.label: NARROWS_INTERVALS for candidate in chosen}
    why |= {candidate.label: f"splits {names}" for candidate, count in zip(candidates, split - fixed) if count > 0}
    if check is not None:
        why[check.label] = SHOWS_DRIFT
    return chosen, why, check


def runs_of(fitting: Fitting, limits: Limits, largest: float) -> tuple[PaperRun, ...]:
    """List the runs that a campaign may be made of: of a steered vehicle zigzags and turning circles, both ways first,
    at several speeds where its model depends on that. Commands change when the model's heading says so."""
    if not fitting.steered:
        return pool.candidates(fitting.base, limits, largest)
    usual = None if fitting.speed is None or not fitting.model.signals else fitting.speed
    speeds = [None] if usual is None else [float(f"{share * usual:.3g}") for share in pool.SPEED_SHARES]
    angles = [angle for angle in pool.ZIGZAG_DEG if np.deg2rad(angle) <= largest] or [float(np.rad2deg(largest))]
    kinds = [(pool.ZIGZAG, pool.SWINGS, angle, angle) for angle in angles]
    kinds.append(("turning-circle", 1, float(f"{np.rad2deg(largest):.4g}"), pool.CIRCLE_DEG))
    every = [(speed, *kind, side) for speed in speeds for kind in kinds for side in (1, -1)]
    logged = {"voltage": fitting.voltage or 0.0, "surge": fitting.speed or 0.0}
    cases = [
        (side * radians(angle), radians(until), count, logged | ({} if speed is None else {"surge": speed}))
        for speed, _, count, angle, until, side in every
    ]
    runs = tuple(
        PaperRun(
            kind, f"{kind}_{side * angle:+g}{'' if speed is None else f'_{speed:g}m-s'}",
            tuple((rudder, round(seconds, 1)) for rudder, seconds in commands), speed=speed,
        )
        for (speed, kind, _, angle, _, side), commands in zip(every, zigzags(fitting.model, fitting.rate, cases))
        if commands
    )  # fmt: skip
    if not runs:
        raise SettingError("the limits allow no campaign: no zigzag ends in time; allow larger rudder angles")
    return runs


def _split(pairs: Sequence[rivals.Pair], spread: Sequence[PaperRun], budget: PlanBudget, limits: Limits) -> Floats:
    """How often to run each candidate so that every pair is split, as cheaply as may be, (K,)."""
    starts = np.array([rivals.head_start(a, b, limits.pool.runs) for a, b in pairs])
    required = np.maximum(EVIDENCE_MARGIN * limits.goal.evidence - starts, 1.0)
    about, counts = tuple(pairs), budget.fixed
    for _ in range(MAX_SPLIT_ROUNDS):
        contests = tuple(rivals.contest(a, b, spread) for a, b in about)
        counts = choose(rivals.Discrimination(contests, required), budget).astype(float)
        runs = [spread[i] for i, count in enumerate(counts.astype(int)) for _ in range(count)]
        outcome, about = rivals.splits(pairs, runs)
        short = np.array([split.evidence < limits.goal.evidence for split in outcome])
        if not short.any():
            break
        required = np.where(short, EVIDENCE_MARGIN * required, required)
    return counts


def _refuse_too_little(runs: int, need: Floats, limits: Limits) -> None:
    names = ("pool.minutes", "pool.runs", "pool.motion_s", "battery.charge_Ah (less the reserve)")
    for name, needed, allowed in zip(names, need, pool.allowance(limits)):
        if needed > allowed + 1e-9:
            wait = limits.pool.wait_s / 60.0 if name == "pool.minutes" else 0.0
            raise SettingError(
                f"the limits allow no campaign: {runs} runs already need {needed - wait:.3g} of {name}, and it is "
                f"{allowed - wait:.3g}; give more"
            )


def choose(objective: Objective, budget: PlanBudget) -> NDArray[np.int64]:
    """Choose how often to run each candidate, (K,): what the budget holds fixed, and what is worth adding."""
    ones = np.eye(len(budget.costs))
    pairs = [ones[k] + ones[other] for k, other in enumerate(budget.mirrors) if k <= other and budget.most[k] > 0]
    starts = [budget.fixed, *(budget.fixed + pair for pair in pairs)]
    filled = [_fill(objective, budget, start) for start in starts if budget.holds(start)]

    def worth(counts: Floats) -> tuple[bool, float]:
        enough = objective.reached(counts)
        return enough, -float(counts @ budget.costs[:, 0]) if enough else _score(objective, counts)

    ended = _pruned(objective, budget, _exchange(objective, budget, max(filled, key=worth)))
    return _balanced(objective, budget, ended).astype(int)


def _score(objective: Objective, counts: Floats) -> float:
    return float(objective.scores(counts)[0])


def _fill(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    """Add the run of the best worth for its cost until none fits or nothing more is wanted."""
    ones = np.eye(len(counts))
    while not objective.reached(counts) and len(fits := budget.fits(counts)):
        room = budget.room - counts @ budget.costs
        gain = objective.scores(counts, fits) - _score(objective, counts)
        worth = gain / np.sum(budget.costs[fits] / np.maximum(room, 1e-12), axis=1)
        if worth.max() <= MIN_WORTH_GAIN:
            break
        counts = counts + ones[fits[int(np.argmax(worth))]]
    return counts


def _exchange(objective: Objective, budget: PlanBudget, counts: Floats) -> Floats:
    ones = np.eye(len(counts))
    now = _score(objective, counts)
    for _ in range(MAX_SWEEPS):
        before = now
        for out in budget.free(counts):
            without = counts - ones[out]
            if not len(fits := budget.fits(without)):
                continue
            scores = objective.scores(without, fits)
            best = int(np.argmax(scores))
            if scores[best] > now + MIN_EXCHANGE_GAIN:
                counts, now = without + ones[fits[best]], float(scores[best])
        if now == before:
            break
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
    least, enough = _score(objective, counts) - BALANCE_WORTH, objective.reached(counts)
    lean = 0
    for place, mirror in ((k, other) for k, other in enumerate(budget.mirrors) if k < other):
        total = counts[place] + counts[mirror]
        trial = counts.copy()
        trial[place] = max((total + (1 if lean <= 0 else -1) * (total % 2)) / 2.0, budget.fixed[place])
        trial[mirror] = max(total - trial[place], budget.fixed[mirror])
        trial[place] = total - trial[mirror]
        acceptable = objective.reached(trial) if enough else _score(objective, trial) >= least
        if acceptable and budget.holds(trial):
            counts = trial
        lean += int(counts[place] - counts[mirror])
    return counts


ROUND_DOWN = 1e-6  # share of the largest moment that is left, so that rounding asks for no more
LARGEST_NU = 1.0  # largest moment of a normalised model where the limits do not say
STEP_REPEATS, MIN_SIZES, MAX_SIZES = 2, 2, 12  # how often the first campaign makes each step, and at how many moments
PAPER = {"I_r": 1.018, "k_rr": 1.257}
"""Inertia and drag of the paper's vehicle; the first campaign has both scaled by the time of its half turn."""
NO_MODEL = (
    "No intervals can be foretold without a model. Steps are as long as they must be if half a turn at {:.4g} {} takes "
    "{:g} s. Time yours, and state it as half_turn_s under [pool] of the limits."
)
FIT_COMMANDS = {
    "half-turns": "automarine fit-yaw LOGS -o out/yaw",
    "whole-runs": "automarine fit-yaw LOGS --fit-to whole-runs -o out/yaw",
    "diagnosis": "automarine diagnose LOGS --model {model} -o out/diagnosis",
}
"""What the runs are for, by fit."""


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """A campaign on paper for the file `model` (the first one, of steps alone, has none: ""), planned for the method
    `fitting` within `limits`, with `seed`.

    `slots` are its runs in order, `candidates` the runs without their places, `runs` the same as plain mappings;
    `minutes` is how long it takes, `motion` how long the vehicle moves [s], `supply` the battery and `source` where its
    current is from, `drive` the thruster map or None, `columns` the names in the logs, `fit_command` how to fit it.
    `wanted` are the parameters to narrow: `now`, `alone` and `together` are the estimates by name before it, of its
    runs alone, and of these with the earlier ones (empty where not known or not to be used); `errors` (R,) the standard
    errors in percent of each parameter after each run; `splits` what is expected of each pair of explanations; `notes`
    what must be known. `to_json()` is plan.json.

    Frame, a row per run: `number`, `name`, `kind`, `begins_s`, `start_heading_deg`, `turn_there_deg`, `turns_deg`,
    `voltage_V`, `commands` (moment and seconds), `wait_s`, `battery_left_Ah`, `command_file`, `why`.

    Keys: `schema`, `model`, `moment_unit`, `fit`, `fit_command`, `planned_for`, `heading_noise_rad`, `gain_scatter`,
    `limits`, `supply`, `totals`, `planned`, `parameters`, `splits`, `curves`, `notes`.
    """

    model: str
    fitting: Fitting
    limits: Limits
    supply: Supply
    seed: int
    wanted: tuple[str, ...]
    slots: tuple[TimedRun, ...]
    now: Mapping[str, Estimate]
    alone: Mapping[str, Estimate]
    together: Mapping[str, Estimate]
    splits: tuple[rivals.Split, ...]
    errors: Mapping[str, Floats]
    notes: tuple[str, ...]
    drive: TwinThrusters | None = None
    columns: ColumnMap = field(default_factory=ColumnMap)
    source: str = ""
    """Where the current is from, in a sentence."""

    @property
    def candidates(self) -> tuple[PaperRun, ...]:
        return tuple(slot.candidate for slot in self.slots)

    @property
    def minutes(self) -> list[float]:
        """Minutes in the pool at the end of each run."""
        return [slot.ends(self.limits.runs.rest_before_s) / 60.0 for slot in self.slots]

    @property
    def motion(self) -> float:
        return float(sum(candidate.motion for candidate in self.candidates))

    @property
    def fit_command(self) -> str:
        fit = self.fitting.fit if self.model else "half-turns"
        return FIT_COMMANDS[fit].format(model=shlex.quote(self.model or ""))

    def to_json(self) -> dict[str, Any]:
        fitting, limits, supply, last = self.fitting, self.limits, self.supply, self.slots[-1]
        return {
            "schema": PLAN.schema, "model": self.model, "moment_unit": fitting.model.moment_unit,
            "fit": fitting.fit, "fit_command": self.fit_command,
            "planned_for": list(self.wanted) or list(self.alone), "heading_noise_rad": fitting.noise,
            **({} if fitting.rate_noise is None else {"rate_noise_rad_s": fitting.rate_noise}),
            "gain_scatter": fitting.scatter, "limits": to_mapping(limits),
            "supply": {"idle_A": supply.idle, "full_A": supply.full, "at_moment": supply.largest},
            "totals": {
                "runs": len(self.slots), "pool_min": self.minutes[-1],
                "motion_s": self.motion, "battery_left_Ah": last.left,
                "battery_left_percent": 100.0 * last.left / limits.battery.charge_Ah,
            },
            "planned": self.runs(),
            "parameters": {
                name: {
                    "now": None if name not in self.now else self.now[name].to_json(),
                    "new_runs": alone.to_json(),
                    "with_earlier_runs": self.together[name].to_json() if name in self.together else None,
                }
                for name, alone in self.alone.items()
            },
            "splits": [to_mapping(split) for split in self.splits],
            "curves": [{
                "minutes": self.minutes, "motion_s": np.cumsum([run.motion for run in self.candidates]).tolist(),
                "stderr_percent": {name: errors.tolist() for name, errors in self.errors.items()},
            }],
            "notes": [self.source, *self.notes],
        }  # fmt: skip

    def runs(self) -> list[dict[str, object]]:
        return [
            {
                "number": slot.number, "name": slot.name, "kind": slot.candidate.kind, "begins_s": slot.begins,
                "start_heading_deg": slot.candidate.start_heading, "turn_there_deg": slot.turn_there,
                "turns_deg": slot.turns, "voltage_V": slot.candidate.voltage,
                "commands": [[moment, seconds] for moment, seconds in slot.candidate.commands], "wait_s": slot.wait,
                "battery_left_Ah": slot.left, "command_file": command_path(slot), "why": slot.why,
            }
            for slot in self.slots
        ]  # fmt: skip


def plan_campaign(
    prior: PriorResults, limits: Limits, largest: float, supply: Supply, *, wanted: tuple[str, ...] = (), seed: int = 0,
    progress: Progress = silent,
) -> Plan:  # fmt: skip
    """Choose runs within `limits`, moments up to `largest`, that split the doubts of the `prior` results and narrow
    the `wanted` intervals (all by default); a wanted effect that the model lacks is planned for as if it were there.
    Raises SettingError where the limits allow no campaign, ModelError for a parameter that there is not."""
    there, unit = {term.name for term in prior.model.terms}, prior.stored.model.moment_unit
    for name in dict.fromkeys(parameter.partition(" ")[0] for parameter in wanted):
        if name in effects.names() and name not in there and not info.lacking(name, unit):
            start = rivals.with_effect(fitting_of(prior, limits), prior.model, name, largest)[0]
            prior = replace(prior, model=start.model)
    fitting = fitting_of(prior, limits)
    wanted_ones = info.wanted_directions(fitting, wanted)
    earlier = info.covariance_now(fitting, prior.now) if limits.goal.use_earlier_runs else None
    before = info.information_now(fitting, earlier)
    like: Sequence[PaperRun] = ()
    if prior.doubts:
        like = runs_of(fitting, limits, largest) if fitting.steered else pool.paper_grid(fitting.base, largest)
    grid = pool.scheduled(like, limits, supply)
    pairs = rivals.pairs_of(prior, fitting, [slot.candidate for slot in grid], largest)
    chosen, why, check = select(fitting, limits, largest, supply, before, wanted_ones, pairs, progress)
    slots = pool.scheduled(pool.in_order(chosen, check, seed), limits, supply)
    runs = [slot.candidate for slot in slots]
    outcome = rivals.splits(pairs, runs)[0]
    per_run = fitting.information(runs)
    short = (
        f"Not split within these limits: {split.true} from {split.other} where {split.true} is true; "
        f"{split.evidence:.1f} of the {limits.goal.evidence:g} asked for is expected. Allow more runs or time, or log "
        "what tells them apart directly."
        for split in outcome
        if split.evidence < limits.goal.evidence
    )
    together, covariances = dict[str, Estimate](), np.linalg.inv(np.cumsum(per_run, axis=0) + before)
    if earlier is not None:
        new = np.linalg.pinv(info.reported_covariance(info.moving(per_run)), hermitian=True)
        dof = float(max(len(per_run) + prior.used - 1, 1))
        together = fitting.estimates(np.asarray(np.linalg.inv(new + before)), dict.fromkeys(fitting.estimands, dof))
    return Plan(
        model=prior.stored.source, fitting=fitting, limits=limits, supply=supply, seed=seed, wanted=wanted,
        slots=_with_ways(slots, why, fitting), now=prior.now, alone=fitting.predicted(per_run), together=together,
        splits=outcome,
        errors={
            name: np.array([100.0 * info.stderr_along(c, of.relative) for c in covariances])
            for name, of in fitting.estimands.items()
        },
        notes=(*prior.notes, *((DISTURBED,) if fitting.random else ()), *short),
    )  # fmt: skip


def first_campaign(prior: PriorResults, limits: Limits, largest: float, supply: Supply, seed: int) -> Plan:
    """Lay out the paper's steps, each twice and to both sides, at as many sizes of moment as the limits allow.

    The model of `prior` says how long they last. Raises SettingError where the limits allow no campaign."""
    longer = limits.pool.half_turn_s / time_to_turn(np.pi, largest, prior.model)
    model = prior.model.with_theta(longer**2 * prior.model.theta)
    fitting = fitting_of(replace(prior, model=model), limits)
    for count in range(MAX_SIZES, MIN_SIZES - 1, -1):
        sizes = (min(float(f"{largest * i / count:.3g}"), largest) for i in range(1, count + 1))
        moments = [side * size for size in sizes for side in (1, -1)]
        chosen = STEP_REPEATS * [pool.step_of(model, moment, limits.pool.turn_deg) for moment in moments]
        needs = pool.costs(chosen, limits, supply).sum(axis=0)
        if np.all(needs <= pool.allowance(limits) + 1e-9):
            break
    else:
        _refuse_too_little(len(chosen), needs, limits)
    check = chosen[-2] if limits.runs.repeat_first_last else None
    slots = pool.scheduled(pool.in_order(chosen, check, seed), limits, supply)
    why = {run.label: SHOWS_DRIFT if run == check else TELLS_INERTIA_AND_DRAG for run in chosen}
    return Plan(
        model="", fitting=fitting, limits=limits, supply=supply, seed=seed, wanted=(),
        slots=_with_ways(slots, why, fitting), now={}, alone={}, together={}, splits=(), errors={},
        notes=(NO_MODEL.format(largest, model.moment_unit, limits.pool.half_turn_s),),
    )  # fmt: skip


def _with_ways(slots: Sequence[TimedRun], why: Mapping[str, str], fitting: Fitting) -> tuple[TimedRun, ...]:
    """The runs with what they are for, how far they turn, and the way to the start heading before each."""
    runs = [slot.candidate for slot in slots]
    turned = np.rad2deg([heading[-1] for heading in headings_of(fitting.model, fitting.logger, runs)])
    there = ways_back(turned, [run.start_heading for run in runs])
    return tuple(
        replace(slot, why=why[slot.candidate.label], turns=float(turn), turn_there=float(back))
        for slot, turn, back in zip(slots, turned, there)
    )


def fitting_of(prior: PriorResults, limits: Limits) -> Fitting:
    """Say how the campaign will be fitted: by `diagnose` where the model holds effects, else by `fit-yaw`."""
    base = Fitting(prior.model, "whole-runs", 1.0, 0.0).base
    noise = limits.logger.noise_deg or prior.noise_deg
    rate_noise = limits.logger.rate_noise_deg_s or prior.rate_noise_deg_s
    gain = limits.logger.gain_scatter
    by_fit = prior.diagnosis is None and prior.stored.model.moment_unit == STEERED  # fit-yaw fits what the speed does
    names = (*(term.name for term in prior.model.terms), *(doubt.rival for doubt in prior.doubts))
    electric = limits.runs.voltages_V or any("voltage" in effects.get(name).needs for name in names)
    random = prior.random if gain is None else {**prior.random, "gain-scatter": gain} if prior.random else {}
    return Fitting(
        prior.model, "whole-runs" if prior.model == base or by_fit else "diagnosis", float(np.deg2rad(noise)),
        prior.scatter if gain is None else gain, limits.logger.rate_hz, limits.runs.rest_before_s,
        limits.battery.volts if electric else None, base,
        None if rate_noise is None else float(np.deg2rad(rate_noise)), random,
        command_delay=prior.command_delay, speed=prior.speed,
    )  # fmt: skip


def specification(plan: Plan) -> tuple[dict[str, object], str]:
    """Return plain data of the specification (none where it cannot be simulated), and what it leaves out."""
    fitting, limits, model = plan.fitting, plan.limits, plan.fitting.model
    symbols, (linear, quadratic) = model.dof.symbols, model.drag()
    if fitting.steered:
        return {}, "No plan.toml: simulate makes no logs of a rudder."
    if linear < 0 or quadratic < 0:
        return {}, "No plan.toml: a vehicle with negative drag cannot be simulated."
    delayed = model.delayed(fitting.command_delay) if fitting.command_delay * fitting.rate > 0.5 else model
    added = delayed.terms[len(fitting.base.terms) :]
    needy = [term.name for term in added if effects.get(term.name).needs]
    noises = {"noise_deg": fitting.noise, "rate_noise_deg_s": fitting.rate_noise}
    return {
        "schema": SIMULATION_SCHEMA, "seed": plan.seed,
        "vehicle": {
            symbols.inertia: model.inertia, symbols.quadratic: quadratic, symbols.linear: linear,
            f"{model.dof.words.force}_unit": model.moment_unit,
        },
        "effects": [
            {"name": term.name} | dict(zip(effects.get(term.name).names_in(model.dof), term.values))
            for term in added if term.name not in needy
        ],
        "logger": {"rate_hz": fitting.rate} | {
            key: round(float(np.rad2deg(noise)), 6) for key, noise in noises.items() if noise is not None
        },
        "scatter": {"gain": fitting.scatter, "start_heading_deg": [run.start_heading for run in plan.candidates]},
        "campaign": {
            "order": "listed", "rest_before_s": limits.runs.rest_before_s, "wait_between_s": limits.pool.wait_s,
        },
        "runs": [
            {
                "kind": "sequence", "name": slot.name, "wait_after_s": slot.wait,
                "commands": [[moment, seconds] for moment, seconds in slot.candidate.commands],
            }
            for slot in plan.slots
        ],
    }, f"Simulated runs lack what {', '.join(needy)} needs." if needy else ""  # fmt: skip


def headings_of(model: Model, logger: PlannedLog, candidates: Sequence[PaperRun]) -> list[Floats]:
    """Return the heading of the model in each run, less that at its start [rad]."""
    runs = [logger.run(candidate) for candidate in candidates]
    rolled = roll(model, runs, np.zeros(len(runs)), np.zeros(len(runs))).position[0]
    return [row[: len(run.time)] - row[0] for run, row in zip(runs, rolled)]


def ways_back(turned: Floats, start_headings: Sequence[float]) -> Floats:
    """Return how far [degrees] to turn to each run's start heading after the run before it, (R,): the way after which
    the tether is twisted by half a turn at most; of two such ways the shorter."""
    back, twist = [0.0], 0.0
    for turn, heading in zip(turned[:-1], start_headings[1:]):
        twist += turn
        target = (heading - start_headings[0] + 180.0) % 360.0 - 180.0
        ways = [target - twist, *([360.0 + target - twist] if target == -180.0 else [])]
        back.append(min(ways, key=abs))
        twist += back[-1]
    return np.array(back)


def command_path(slot: TimedRun) -> str:
    return f"commands/{slot.name}.csv"


def make_plan(
    model: Source | None = None, *, diagnosis: Source | None = None, limits: Path | Limits | None = None,
    parameters: tuple[str, ...] = (), thruster_tests: Sequence[LogFile] = (),
    thrusters: Source | ThrusterMap | None = None, arm: float | None = None,
    columns: Path | Document | ColumnMap | None = None, seed: int = 0, progress: Progress = silent,
) -> Plan:  # fmt: skip
    """Plan the next campaign for the preferred model of the file `model` (else the first one), and for a `diagnosis`.

    `parameters` are those whose intervals are to shrink (all by default); `thrusters` and `arm` [m] make commands of
    moments, and with `thruster_tests` the battery's use. Raises ModelError, SettingError, LogError or RunError."""
    if model is None and (diagnosis is not None or parameters):
        raise SettingError("--diagnosis and --parameter go with a model; give MODEL.json")
    prior = info.read_prior_results(model or _paper("nu" if thrusters is None else "N m"), diagnosis)
    if not prior.model.dof.wraps:
        source, motion = prior.stored.source, prior.model.dof.name
        raise ModelError(f"{source} is a model of {motion}; give a model of yaw, for no other campaigns are planned")
    if not isinstance(limits, Limits):
        limits = Limits() if limits is None else Codec(limits.name).read(Limits, read_mapping(limits))
    names = given_columns(columns)
    if prior.stored.model.moment_unit == STEERED:  # the model's rudder is positive to starboard
        rule = names.columns.get(pool.MOMENT_COLUMNS[STEERED], ColumnRule(pool.MOMENT_COLUMNS[STEERED]))
        rule = replace(rule, sign=-rule.sign) if prior.side == -1 else rule
        names = replace(names, columns={**names.columns, pool.MOMENT_COLUMNS[STEERED]: rule})
    drive = _drive(thrusters, arm, names, prior, limits)
    largest = _largest_moment(prior, limits, drive)
    records = load_thruster_logs(thruster_tests, names, progress=progress).records if thruster_tests else None
    per_test = int(names.defaults.get("thrusters_per_test", 1))
    supply, source = _supply(limits, largest, prior.stored.model.moment_unit, drive, per_test, records)
    if model is None:
        plan = first_campaign(prior, limits, largest, supply, seed)
    else:
        plan = plan_campaign(prior, limits, largest, supply, wanted=parameters, seed=seed, progress=progress)
    return replace(plan, drive=drive, columns=names, source=source)


def _paper(unit: str) -> Document:
    """The paper's vehicle as a model file, in a unit of the moment that is to be scaled."""
    models = {"3": {name: {"value": value} for name, value in PAPER.items()}}
    return Document("no model", json.dumps(model_head(YAW, unit) | {"preferred": "3", "models": models}).encode())


def _drive(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, prior: PriorResults, limits: Limits
) -> TwinThrusters | None:
    """How the thrusters make the model's moments, or None without a map. Raises SettingError, ModelError."""
    levered = map_and_arm(thrusters, arm, columns, YAW)
    if levered is None:
        return None
    unit = 1.0 if prior.stored.model.moment_unit != "nu" else limits.thrusters.nu_in_Nm
    if unit is None:
        raise SettingError(
            f"{prior.stored.source} is a model of normalised moments, the thruster map gives N m; say what one unit is "
            "with thrusters.nu_in_Nm in the limits"
        )
    thruster_map, length = levered
    equal_thrust = limits.thrusters.pairing == "equal-thrust"
    return drive_of(thruster_map, length / unit, limits.thrusters.largest_command, equal_thrust)


def _largest_moment(prior: PriorResults, limits: Limits, drive: TwinThrusters | None) -> float:
    """The largest moment of runs, in the model's unit. Raises SettingError where none is told or it is too large."""
    largest, unit = limits.moments.largest, prior.stored.model.moment_unit
    if unit == STEERED:
        logged = max(map(abs, prior.file.force_range)) if prior.file and prior.file.force_range else None
        angle = np.deg2rad(largest) if largest is not None else logged
        if drive is not None or angle is None or angle > np.pi / 2:
            raise SettingError(
                f"{prior.stored.source} is a model of a rudder; give its largest angle in degrees, up to 90, with "
                "moments.largest in the limits, and no --thrusters"
            )
        return float(angle)
    if drive is None:
        if largest is None and unit != "nu":
            raise SettingError(
                f"{prior.stored.source} is a model of moments in {unit}; say how large they may be with "
                "moments.largest in the limits (--limits), or give --thrusters and --arm"
            )
        return LARGEST_NU if largest is None else largest
    most = drive.largest * (1.0 - ROUND_DOWN)
    if largest is not None and largest > most:
        raise SettingError(
            f"moments.largest is {largest:g} {unit}; the thrusters give at most {most:.4g} {unit} as they are "
            "paired; ask for less, or pair them by equal commands"
        )
    step = 10.0 ** (floor(log10(most)) - 2)
    return float(f"{floor(most / step) * step:.3g}") if largest is None else largest


def _supply(
    limits: Limits, largest: float, unit: str, drive: TwinThrusters | None, per_test: int,
    records: Sequence[Series] | None,
) -> tuple[Supply, str]:  # fmt: skip
    """What is drawn from the battery, and a sentence on where that is from: `records` of thruster tests, else the
    limits. Raises SettingError for tests without a drive, RunError for tests without a current or power."""
    battery = limits.battery
    if unit == STEERED:
        drawn = f"{battery.idle_A:g} A always and {battery.full_A:g} A more under way, as stated in the limits."
        source = f"Battery: {battery.volts:g} V, {battery.charge_Ah:g} Ah; {drawn}"
        return Supply(battery.idle_A, battery.full_A, largest, 0.0), source
    stated = f"Battery: {battery.volts:g} V, {battery.charge_Ah:g} Ah; {battery.idle_A:g} A always"
    if records is None:
        source = f"{stated} and {battery.full_A:g} A more at {largest:.4g} {unit}, as stated in the limits."
        return Supply(battery.idle_A, battery.full_A, largest), source
    if drive is None:
        raise SettingError(
            "thruster tests give the current only with the thrusters' map; give --thrusters MAP.json and --arm METRES"
        )
    powers = zip(consumption(records, per_test, battery.volts)[1:], drive.thrusts(*drive.signals(largest)))
    full = sum(c * force**pool.POWER_LAW for c, force in powers) / battery.volts
    source = f"{stated}, as stated, and {full:.3g} A more at {largest:.4g} {unit}, from the thruster tests."
    return Supply(battery.idle_A, full, largest), source
