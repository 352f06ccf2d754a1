"""From what is known of a vehicle to a verdict: gains with their margins, the present ones kept, or no promise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from automarine_cli import effects
from automarine_cli.control.actuators import dead_time, lag_of
from automarine_cli.control.flight import Flight, Scores, scores, step_and_load
from automarine_cli.control.knowledge import Knowledge
from automarine_cli.control.margins import Margins
from automarine_cli.control.members import Bend, Vehicles, crowd
from automarine_cli.control.plant import sensor_lag
from automarine_cli.control.search import (
    FINE,
    ROUGH,
    SHARE,
    Crowd,
    Task,
    all_margins,
    brief,
    flown,
    grid_for,
    paced,
    picked,
    screened,
    searched,
)
from automarine_cli.control.targets.base import Gains, Nominal, Target
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Floats

Verdict = Literal["gains", "leave", "cannot-promise"]
CROWD, PRESENT, JUDGED = 180, 60, 12
ROUNDS, LAST = 5, 20
"""Looks at the space of gains, each nearer to the best; sets that are judged by the crowd."""
EXACT, STEADY = 0.02, 0.05
"""Loops of the flights that are promised, and of those that gains are chosen by: see `paced`."""
DEAREST = 2.0
"""How much longer gains for all explanations may take to settle than gains for the right one alone."""
LONG_DELAY = 0.14
"""Spread of delays [s], between their quarters, from which on it is asked what knowing them would be worth: that of
delays anywhere within 0.3 s."""


@dataclass(frozen=True)
class Outcome:
    """What a set of gains does over the whole crowd: margins and scores of every vehicle, flights of every vehicle."""

    gains: Mapping[str, float]
    margins: Margins
    scores: Scores
    flight: Flight

    def share_with(self, margin: float) -> float:
        """Share of the crowd that keeps a disk margin."""
        return float(np.mean(self.margins.disk >= margin))


@dataclass(frozen=True)
class Designed:
    """The verdict and why; `new` and `old` outcomes where there are any; the crowds, the task, the vehicle as the
    designer saw it, the effect that is open and changes the answer (empty for none), and the run that settles it."""

    verdict: Verdict
    why: str
    target: Target
    task: Task
    nominal: Nominal
    crowds: tuple[Crowd, ...]
    new: Outcome | None
    old: Outcome | None
    open: str
    run: str
    notes: tuple[str, ...]


def nominal_of(vehicles: Vehicles, step: float) -> Nominal:
    """The first of several vehicles as a designer sees it."""
    one, full, dof = vehicles.pick(slice(0, 1)), vehicles.full, vehicles.model.dof
    linear, quadratic = vehicles.model.with_theta(one.theta[0]).drag()
    lag = float((dead_time(one) + lag_of(one) + sensor_lag(one))[0])
    fastest = float(steady_rate(full, linear, max(quadratic, 1e-9 * full)))
    return Nominal(
        dof, float(one.theta[0, 0]) / full, linear / full, quadratic / full, lag, fastest, step, full,
        vehicles.model.moment_unit, vehicles.bend,
    )  # fmt: skip


def seconds_for(nominal: Nominal) -> float:
    """How long a flight is to take [s]: seven times the shortest turn, and the delays many times over."""
    shortest = 2.0 * np.sqrt(nominal.step * nominal.inertia) + nominal.step / nominal.fastest
    return float(np.clip(7.0 * shortest + 32.0 * nominal.lag, 20.0, 60.0))


def crowds_of(known: Knowledge, full: float, bend: Bend | None, seed: int, count: int = CROWD) -> tuple[Crowd, ...]:
    """Vehicles of every explanation, the same count of each."""
    rng = np.random.default_rng(seed)
    each = max(count // len(known.explanations), 40)
    return tuple(
        Crowd(one.name, crowd(one.model, replace(known.spread, covariance=one.covariance), full, bend, each, rng))
        for one in known.explanations
    )


def design(
    target: Target, known: Knowledge, full: float, bend: Bend | None, task: Task, present: Mapping[str, float] | None,
    seed: int,
) -> Designed:  # fmt: skip
    """The verdict of a target on a vehicle; `present` gains by name, None where there are none."""
    crowds = crowds_of(known, full, bend, seed)
    nominal = nominal_of(crowds[0].vehicles, task.step)
    if known.settled is not None:
        why, effect = known.settled
        run = _run(known, effect)
        return Designed("cannot-promise", why, target, task, nominal, crowds, None, None, effect, run, known.notes)
    for longer in (1.0, 2.0):
        found = _designed(target, known, crowds, nominal, replace(task, seconds=longer * seconds_for(nominal)), present)
        if found is not None:
            return found
    why = f"The best gains that keep a disk margin of {task.margin:g} do not settle for {SHARE:.0%} of the vehicles"
    why = f"{why} that the model allows. {_more(target)}"
    return Designed("cannot-promise", why, target, task, nominal, crowds, None, None, "", "", known.notes)


def _designed(
    target: Target, known: Knowledge, crowds: tuple[Crowd, ...], nominal: Nominal, task: Task,
    present: Mapping[str, float] | None,
) -> Designed | None:  # fmt: skip
    """The verdict from flights of so many seconds; None where gains keep the margin and do not settle in time."""
    some = [one.first(PRESENT // len(crowds)) for one in crowds]
    exact = paced(target, nominal, EXACT)
    old = None if present is None else outcome(target, present, some, task, exact)

    def said(verdict: Verdict, why: str, new: Outcome | None = None, left: str = "") -> Designed:
        run = _run(known, left) if left else ""
        return Designed(verdict, why, target, task, nominal, crowds, new, old, left, run, known.notes)

    if old is not None and _keeps(old, some, task):
        return said("leave", _kept(old, task))
    short = brief(target, nominal, crowds, task)
    chosen = _chosen(target, nominal, crowds, short)
    dear = _price(target, nominal, known, crowds, short, chosen)
    if chosen is None and not dear:
        where = "" if target.beyond or not target.firmware else " within the documented ranges"
        return said("cannot-promise", f"No gains{where} keep a disk margin of {task.margin:g} for {SHARE:.0%} of the "
                                      f"vehicles that the model allows. {_more(target)}")  # fmt: skip
    if dear:
        return said("cannot-promise", dear[0], left=dear[1])
    assert chosen is not None
    new = outcome(target, chosen, crowds, task, exact)
    if _is_late(new, task) and _keeps(new, crowds, task):
        task = replace(task, seconds=2.0 * task.seconds)
        new = outcome(target, chosen, crowds, task, exact)
        old = None if present is None else outcome(target, present, some, task, exact)
    if not _keeps(new, crowds, task):
        return None
    if old is not None and (_keeps(old, some, task) or _no_worse(old, new, task)):
        return said("leave", _kept(old, task))
    return said("gains", _why(new, old, task), new)


def outcome(
    target: Target, gains: Mapping[str, float], crowds: Sequence[Crowd], task: Task, paced: Target | None = None
) -> Outcome:
    """What gains do over all crowds, flown with the loops of `paced` where that is given."""
    own: Gains = {name: np.full((1, 1), value) for name, value in gains.items()}
    omega = grid_for(target, crowds, FINE)
    found = [all_margins(target, own, one.vehicles, omega) for one in crowds]
    flights = [step_and_load(paced or target, own, one.vehicles, task.step, task.load, task.seconds) for one in crowds]
    flight = Flight(
        flights[0].time, *(np.concatenate([getattr(f, k) for f in flights]) for k in ("position", "output"))
    )
    names = ("disk", "gain", "phase", "delay", "stable")
    whole = Margins(*(np.concatenate([getattr(one, name) for one in found]) for name in names))
    return Outcome(dict(gains), whole, scores(flight, task.step, task.band), flight)


def _keeps(found: Outcome, crowds: Sequence[Crowd], task: Task) -> bool:
    """Whether every explanation's vehicles keep the margin and settle, all but a twentieth."""
    good = (found.margins.disk >= task.margin) & found.scores.settles
    ends = np.cumsum([len(one.vehicles) for one in crowds])[:-1]
    return all(np.mean(part) >= SHARE for part in np.split(good, ends))


def _no_worse(old: Outcome, new: Outcome, task: Task) -> bool:
    """Whether old gains are as good as new ones in all that is told of them."""

    def told(one: Outcome) -> list[float]:
        own = one.scores
        least = [-one.share_with(task.margin), -float(own.settles.mean()), -float(np.median(one.margins.disk))]
        return [*least, *(float(np.median(x)) for x in (own.overshoot, own.settling, own.rms, own.error))]

    return all(before <= after for before, after in zip(told(old), told(new)))


def _kept(old: Outcome, task: Task) -> str:
    share = f"{old.share_with(task.margin):.0%} of the vehicles that the model allows"
    return f"The present gains keep the margin of {task.margin:g} for {share}, and all but a few settle."


def _is_late(found: Outcome, task: Task) -> bool:
    """Whether too little of the flights is seen after the vehicles settled: in a dead-band a loop may rest for a while
    and then swing out again."""
    return bool(np.mean(found.scores.settling > 0.5 * task.seconds) > 1.0 - SHARE)


def _chosen(target: Target, nominal: Nominal, crowds: Sequence[Crowd], task: Task) -> dict[str, float] | None:
    """The best gains that all crowds can live with; looked for with more margin on the probes where that fails."""
    omega = grid_for(target, crowds, FINE // 2)
    for more in (1.0, 1.12, 1.3):
        found = searched(target, nominal, crowds, replace(task, margin=more * task.margin), ROUNDS)
        kept = [screened(target, found.gains, one.vehicles, omega) >= task.margin for one in crowds]
        able = np.flatnonzero(np.min([one.mean(axis=1) for one in kept], axis=0) >= SHARE)[:LAST]
        if len(able):
            return _steadiest(paced(target, nominal, STEADY), picked(found.gains, able), crowds, task)
    return None


def _steadiest(quick: Target, gains: dict[str, Floats], crowds: Sequence[Crowd], task: Task) -> dict[str, float]:
    """Of several sets the one whose cost is least for all but a tenth of the vehicles."""
    each = [flown(quick, gains, one.vehicles.pick(slice(0, JUDGED)), task)[0] for one in crowds]
    best = int(np.argmin(np.quantile(np.concatenate(each, axis=1), 0.9, axis=1)))
    return {name: float(value[best]) for name, value in gains.items()}


def _price(
    target: Target, nominal: Nominal, known: Knowledge, crowds: Sequence[Crowd], task: Task,
    chosen: Mapping[str, float] | None,
) -> tuple[str, str] | None:  # fmt: skip
    """What is open and dear, in a sentence, and the effect to be settled; None where knowing it would gain little."""
    quick = paced(target, nominal, ROUGH)
    parts = list(zip(crowds, [one.instead for one in known.explanations])) if len(crowds) > 1 else []
    late = dead_time(crowds[0].vehicles)
    early, later = np.quantile(late, [0.25, 0.75])
    if later - early >= LONG_DELAY:
        prompt = crowds[0].vehicles.pick(np.flatnonzero(late <= early))
        parts.append((Crowd("a short delay", prompt), "input-delay"))
    for part, effect in parts:
        alone = searched(target, nominal, [part], task, 1)
        if not len(alone.cost):
            continue
        both = {
            name: np.append(value[:1], [] if chosen is None else [chosen[name]]) for name, value in alone.gains.items()
        }
        settling = flown(quick, both, part.vehicles.pick(slice(0, 1)), task)[1].settling
        mine, ours = settling[0], np.inf if chosen is None else settling[1]
        if ours > DEAREST * mine:
            settled = effect or next((one.instead for one in known.explanations if one.instead), "input-delay")
            what = "no gains" if not np.isfinite(ours) else f"gains that settle in {ours:.1f} s"
            open_still = "the delay" if settled == "input-delay" and len(crowds) == 1 else f"whether it is {settled}"
            return (
                f"What is open changes the answer: with {part.name} alone the step settles in {mine:.1f} s, and there "
                f"are {what} for everything that the logs allow; {open_still} is not known well enough.",
                settled,
            )
    return None


def _run(known: Knowledge, effect: str) -> str:
    """The run that settles what is open."""
    return known.splits.get(effect) or effects.get(effect).card(known.model.dof).separated_by


def _more(target: Target) -> str:
    """What may be tried where nothing is open."""
    wider = "" if target.beyond or not target.firmware else "--beyond-range or "
    return f"Try {wider}a smaller --margin, or a smaller --step."


def _why(new: Outcome, old: Outcome | None, task: Task) -> str:
    share = f"{new.share_with(task.margin):.0%} of the vehicles that the model allows"
    before = "" if old is None else f"; with the present ones for {old.share_with(task.margin):.0%}"
    return f"They keep a disk margin of {task.margin:g} for {share}{before}."
