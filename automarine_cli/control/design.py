"""Gains as fast and as stiff as the margin allows to all vehicles that a model allows, and the verdict on them.

First design numbers are spread over the space of gains and their disk margins worked out on three vehicles of every
explanation; all that keep the margin are flown, for no figure of a linear loop says how soon a step settles. The best
are looked at again nearby, ever nearer, and the last few are judged on the whole crowd.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.control import vehicles as plant
from automarine_cli.control.closed_loop import (
    TILT,
    Flight,
    Margins,
    Scores,
    disk_margin,
    frequencies,
    margins,
    scores,
    stable_along,
    step_and_load,
)
from automarine_cli.control.knowledge import Knowledge
from automarine_cli.control.targets.base import Gains, Nominal, Target
from automarine_cli.control.vehicles import Bend, Vehicles, crowd, dead_time, lag_of, output_slope, sensor_lag
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Complexes, Floats

Verdict = Literal["gains", "leave", "cannot-promise"]
CROWD, PRESENT, JUDGED = 180, 60, 12
ROUNDS, LAST = 5, 20  # looks at the space of gains, each nearer to the best; sets that are judged by the crowd
EXACT, STEADY = 0.02, 0.05  # loops of the flights that are promised, and of those that gains are chosen by: see `paced`
DEAREST = 2.0  # how much longer gains for all explanations may take to settle than gains for the right one alone
LONG_DELAY = 0.14
"""Spread of delays [s], between their quarters, from which on it is asked what knowing them would be worth: that of
delays anywhere within 0.3 s."""
SHARE = 0.95  # of the crowd that has to keep the margin, and to settle
FIRST, NEAR, ELITE, FLOWN, MOST = 1500, 200, 8, 160, 40
"""Sets of gains: spread over their space, near the best so many, flown for a further explanation, found at last."""
FEW, NEARLY = 40, 0.95
"""Vehicles on which flown sets have to keep the margin; share of it that three probes have to keep before."""
NEVER = 1e6  # what not settling costs, in lengths of a flight
WIDTH = 0.3  # of the neighbourhood of good gains, in design numbers between 0 and 1
ROUGH, LONGEST = 0.1, 0.02
"""Loops of flights that gains are looked for with, in shares of all that is slow in the loop; and the longest loops
and steps of a vehicle in flights that are not promised [s]."""
LONG, LEAST = 5.0, 6.0  # flights that gains are looked for with, in settling times and at least [s]
COARSE, FINE = 180, 500  # frequencies of the first look and of the margins that are told


@dataclass(frozen=True)
class Task:
    """What gains are for: `step` of the reference and `band` within which it counts as settled [base units], `load` in
    shares of the whole output, disk `margin` to keep, how long a flight takes [s]."""

    step: float
    band: float
    load: float
    margin: float
    seconds: float


@dataclass(frozen=True)
class Setup:
    """Everything that a tuning is made of, read and checked: `full` is the moment or force at the whole output, `bend`
    the map to it where that is no straight line, `seed` draws the vehicles."""

    target: Target
    known: Knowledge
    full: float
    bend: Bend | None
    task: Task
    seed: int


@dataclass(frozen=True)
class Crowd:
    """Vehicles that one explanation allows, the first as its model says."""

    name: str
    vehicles: Vehicles

    def first(self, count: int) -> "Crowd":
        return Crowd(self.name, self.vehicles.pick(slice(0, count)))

    @cached_property
    def probes(self) -> Vehicles:
        """The first, one that is late and lively, and one that is sluggish."""
        reach = output_slope(self.vehicles) / self.vehicles.theta[:, 0]
        late = dead_time(self.vehicles) + lag_of(self.vehicles) + 1e-3
        lively, sluggish = np.argsort(late / late.max() + reach / reach.max()), np.argsort(-reach)
        place = int(SHARE * (len(reach) - 1))
        return self.vehicles.pick(np.array([0, lively[place], sluggish[place]]))


@dataclass(frozen=True)
class Candidates:
    """Sets of gains with the design numbers they came from, and what they cost on a crowd, (C,)."""

    numbers: Floats
    gains: dict[str, Floats]
    cost: Floats

    def pick(self, places: NDArray[np.int64] | NDArray[np.bool_]) -> "Candidates":
        return Candidates(self.numbers[places], select(self.gains, places), self.cost[places])

    def first(self, count: int) -> "Candidates":
        """Keep the cheapest, in order."""
        return self.pick(np.argsort(self.cost, kind="stable")[:count])


@dataclass(frozen=True)
class Outcome:
    """What a set of gains does over the whole crowd: margins and scores of every vehicle, flights of every vehicle."""

    gains: Mapping[str, float]
    margins: Margins
    scores: Scores
    flight: Flight

    def share_with(self, margin: float) -> float:
        return float(np.mean(self.margins.disk >= margin))


@dataclass(frozen=True)
class Problem:
    """What gains are looked for: the stack, the task, the vehicle as the designer sees it, and the crowds."""

    target: Target
    task: Task
    nominal: Nominal
    crowds: tuple[Crowd, ...]

    @property
    def rough(self) -> Target:
        return paced(self.target, self.nominal, ROUGH)

    @property
    def exact(self) -> Target:
        return paced(self.target, self.nominal, EXACT)

    def omega(self, count: int) -> Floats:
        return grid_for(self.target, self.crowds, count)


@dataclass(frozen=True)
class Designed(Problem):
    """The verdict and why; `new` and `old` outcomes where there are any; the effect that is open and changes the answer
    (empty for none), and the run that settles it."""

    verdict: Verdict
    why: str
    new: Outcome | None
    old: Outcome | None
    open: str
    run: str
    notes: tuple[str, ...]


def nominal_of(vehicles: Vehicles, step: float) -> Nominal:
    """Describe the first of several vehicles as a designer sees it, for a `step` of the reference [base unit]."""
    first, full, dof = vehicles.pick(slice(0, 1)), vehicles.full, vehicles.model.dof
    linear, quadratic = vehicles.model.with_theta(first.theta[0]).drag()
    lag = float((dead_time(first) + lag_of(first) + sensor_lag(first))[0])
    fastest = float(steady_rate(full, linear, max(quadratic, 1e-9 * full)))
    return Nominal(
        dof, float(first.theta[0, 0]) / full, linear / full, quadratic / full, lag, fastest, step, full,
        vehicles.model.moment_unit, vehicles.bend,
    )  # fmt: skip


def crowds_of(known: Knowledge, full: float, bend: Bend | None, seed: int, count: int = CROWD) -> tuple[Crowd, ...]:
    """Draw vehicles of every explanation, the same count of each."""
    rng, size = np.random.default_rng(seed), max(count // len(known.explanations), FEW)
    return tuple(
        Crowd(e.name, crowd(e.model, replace(known.spread, covariance=e.covariance), full, bend, size, rng))
        for e in known.explanations
    )


def select(gains: Mapping[str, Floats], which: NDArray[Any]) -> dict[str, Floats]:
    return {name: value[which] for name, value in gains.items()}


def paced(target: Target, nominal: Nominal, share: float) -> Target:
    """Give the same stack fewer loops a second, where those of the firmware are far shorter than all that is slow:
    `share` of it, 0.02 s at most."""
    slow = nominal.lag + target.own_lag({})
    return type(target)(float(np.clip(share * slow, target.period, max(target.period, LONGEST))), target.beyond)


def grid_for(target: Target, crowds: Sequence[Crowd], count: int) -> Floats:
    """Return `count` frequencies [rad/s] that matter to a target on these vehicles."""
    late = max(float(np.max(dead_time(part.vehicles))) for part in crowds)
    return frequencies(min(np.pi / target.period, 60.0 / max(late, 1e-3)), count)


def _unbent(target: Target, vehicles: Vehicles) -> Vehicles:
    return replace(vehicles, bend=None) if target.linear else vehicles


def all_margins(target: Target, gains: Gains, vehicles: Vehicles, omega: Floats) -> Margins:
    """Return margins of every vehicle (S,) under gains (S, 1), or the same for all (1, 1), from frequencies (W,)."""

    def loop(s: Complexes) -> Complexes:
        of_position, of_velocity = target.paths(gains, s)
        position, velocity = plant.response(_unbent(target, vehicles), s)
        return of_position * position + of_velocity * velocity

    return margins(loop, omega, plant.poles(vehicles), 1)


def screened(target: Target, gains: dict[str, Floats], vehicles: Vehicles, omega: Floats) -> Floats:
    """Return disk margins of sets of gains (C,) on vehicles (V): (C, V), zero where a loop is unstable."""
    linear, columns = _unbent(target, vehicles), {name: value[:, None] for name, value in gains.items()}
    poles, lines = plant.poles(linear), (omega * (1j - TILT), 1j * omega)
    paths = [(*target.paths(columns, s), *plant.response(linear, s)) for s in lines]
    disk = np.zeros((len(next(iter(gains.values()))), len(linear)))
    for k in range(len(linear)):
        tilted, ratio = (x * position[k] + v * velocity[k] for x, v, position, velocity in paths)
        disk[:, k] = np.where(stable_along(tilted, poles[k : k + 1], 1), disk_margin(ratio), 0.0)
    return disk


def flown(target: Target, gains: Mapping[str, Floats], vehicles: Vehicles, task: Task) -> tuple[Floats, Scores]:
    """Fly sets of gains (C,) on some vehicles (V) and return their cost (C, V), and the scores (C V,).

    The cost is log settling + log largest error under load + 1/4 log what is left of it: half the time is worth as much
    as half the error; and 4 for each share of the step by which it is overshot, beyond a tenth.
    """
    sets, count = len(next(iter(gains.values()))), len(vehicles)
    repeated: Gains = {name: np.repeat(value, count)[:, None] for name, value in gains.items()}
    many = vehicles.pick(np.tile(np.arange(count), sets))
    flight = step_and_load(target, repeated, many, task.step, task.load, task.seconds, longest=LONGEST)
    result = scores(flight, task.step, task.band)
    settling = np.log(np.where(result.settles, result.settling, NEVER * task.seconds))
    load = np.log(np.maximum(result.error, 1e-6)) + 0.25 * np.log(result.end + task.band)
    cost = settling + load + 4.0 * np.maximum(result.overshoot - 0.1, 0.0)
    return cost.reshape(sets, count), result


def spread_numbers(count: int, size: int) -> Floats:
    """Return points (count, size) that fill the unit cube evenly: the R-sequence (Roberts 2018)."""
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (size + 1))
    steps = (1.0 / root) ** np.arange(1, size + 1)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0


def brief(problem: Problem) -> Problem:
    """Shorten the flights to what it takes to tell good gains from bad: `LONG` times what the best of a few takes to
    settle, on the first vehicle."""
    target, task = problem.target, problem.task
    gains = target.propose(spread_numbers(FIRST // 5, target.numbers), problem.nominal)
    first = problem.crowds[0].vehicles.pick(slice(0, 1))
    good = np.flatnonzero(screened(target, gains, first, problem.omega(COARSE))[:, 0] >= task.margin)
    if not len(good):
        return problem
    settling = flown(problem.rough, select(gains, good), first, task)[1].settling.min()
    return replace(problem, task=replace(task, seconds=float(np.clip(LONG * settling, LEAST, task.seconds))))


def searched(problem: Problem, margin: float, rounds: int) -> Candidates:
    """Find the best sets of gains that keep the margin on some vehicles of all crowds, cheapest first; none where none
    does. Margins are those of the target's own loops, flights are rough."""
    size, omega = problem.target.numbers, problem.omega(COARSE)
    result = _tried(problem, margin, omega, spread_numbers(FIRST, size))
    near = (spread_numbers(NEAR, size) - 0.5).reshape(ELITE, -1, size)
    for turn in range(1, rounds):
        best = result.first(ELITE).numbers
        around = np.clip(best[:, None, :] + WIDTH / turn * near[: len(best)], 0.0, 1.0).reshape(-1, size)
        more = _tried(problem, margin, omega, around)
        result = Candidates(
            np.concatenate([result.numbers, more.numbers]),
            {name: np.concatenate([value, more.gains[name]]) for name, value in result.gains.items()},
            np.concatenate([result.cost, more.cost]),
        )
    return result.first(MOST)


def _tried(problem: Problem, margin: float, omega: Floats, numbers: Floats) -> Candidates:
    target, quick = problem.target, problem.rough
    sets = Candidates(numbers, target.propose(numbers, problem.nominal), np.zeros(len(numbers)))
    for part in problem.crowds:
        disk = screened(target, sets.gains, part.probes, omega)
        sets = sets.pick(np.all(disk >= NEARLY * margin, axis=1))
    for part in problem.crowds:  # what is dear for the first explanation need not be flown for the others
        if len(sets.cost):
            cost = flown(quick, sets.gains, part.probes, problem.task)[0].max(axis=1)
            sets = replace(sets, cost=np.maximum(sets.cost, cost)).first(FLOWN)
    for part in problem.crowds:
        disk = screened(target, sets.gains, part.vehicles.pick(slice(0, FEW)), omega)
        sets = sets.pick(np.mean(disk >= margin, axis=1) >= SHARE)
    return sets


def design(setup: Setup, present: Mapping[str, float] | None, count: int = CROWD) -> Designed:
    """Reach the verdict of a target on `count` vehicles; `present` gains by name, None where there are none.

    A flight takes seven times the shortest turn and the delays many times over, and twice as long where gains keep the
    margin and do not settle in time.
    """
    known, task = setup.known, setup.task
    crowds = crowds_of(known, setup.full, setup.bend, setup.seed, count)
    nominal = nominal_of(crowds[0].vehicles, task.step)
    problem = Problem(setup.target, task, nominal, crowds)
    if known.settled is not None:
        return _designed(problem, known, "cannot-promise", *known.settled)
    shortest = 2.0 * np.sqrt(nominal.step * nominal.inertia) + nominal.step / nominal.fastest
    seconds = float(np.clip(7.0 * shortest + 32.0 * nominal.lag, 20.0, 60.0))
    for longer in (1.0, 2.0):
        result = _judged(replace(problem, task=replace(task, seconds=longer * seconds)), known, present)
        if result is not None:
            return result
    why = f"The best gains that keep a disk margin of {task.margin:g} do not settle for {SHARE:.0%} of the vehicles"
    return _designed(problem, known, "cannot-promise", f"{why} that the model allows. {_more(setup.target)}")


def _designed(
    problem: Problem, known: Knowledge, verdict: Verdict, why: str, effect: str = "", old: Outcome | None = None,
    new: Outcome | None = None,
) -> Designed:  # fmt: skip
    run = effect and (known.splits.get(effect) or effects.get(effect).card(known.model.dof).separated_by)
    return Designed(
        **vars(problem), verdict=verdict, why=why, new=new, old=old, open=effect, run=run, notes=known.notes
    )


def _judged(problem: Problem, known: Knowledge, present: Mapping[str, float] | None) -> Designed | None:
    """The verdict from flights of so many seconds; None where gains keep the margin and do not settle in time."""
    task, target, crowds = problem.task, problem.target, problem.crowds
    some = replace(problem, crowds=tuple(part.first(PRESENT // len(crowds)) for part in crowds))
    old = None if present is None else outcome(some, present)
    if old is not None and _keeps(old, some):
        return _designed(problem, known, "leave", _leave(old, task), old=old)
    short = brief(problem)
    chosen = _chosen(short)
    dear = _price(short, known, chosen)
    if dear is not None:
        return _designed(problem, known, "cannot-promise", *dear, old=old)
    if chosen is None:
        within = "" if target.beyond or not target.firmware else " within the documented ranges"
        why = f"No gains{within} keep a disk margin of {task.margin:g} for {SHARE:.0%} of the vehicles"
        return _designed(problem, known, "cannot-promise", f"{why} that the model allows. {_more(target)}", old=old)
    new = outcome(problem, chosen)
    # too little is seen after the vehicles settled: in a dead-band a loop may rest for a while and swing out again
    late = np.mean(new.scores.settling > 0.5 * task.seconds) > 1.0 - SHARE
    if late and _keeps(new, problem):
        task = replace(task, seconds=2.0 * task.seconds)
        problem, some = replace(problem, task=task), replace(some, task=task)
        new = outcome(problem, chosen)
        old = None if present is None else outcome(some, present)
    if not _keeps(new, problem):
        return None
    if old is not None and (_keeps(old, some) or _no_worse(old, new, task)):
        return _designed(problem, known, "leave", _leave(old, task), old=old)
    share = f"{new.share_with(task.margin):.0%} of the vehicles that the model allows"
    before = "" if old is None else f"; with the present ones for {old.share_with(task.margin):.0%}"
    why = f"They keep a disk margin of {task.margin:g} for {share}{before}."
    return _designed(problem, known, "gains", why, old=old, new=new)


def outcome(problem: Problem, gains: Mapping[str, float]) -> Outcome:
    """Work out what gains do over all crowds."""
    arrays: Gains = {name: np.full((1, 1), value) for name, value in gains.items()}
    omega, task, vehicles = problem.omega(FINE), problem.task, [part.vehicles for part in problem.crowds]
    parts = [all_margins(problem.target, arrays, some, omega) for some in vehicles]
    flights = [step_and_load(problem.exact, arrays, some, task.step, task.load, task.seconds) for some in vehicles]
    joined = (np.concatenate([getattr(f, name) for f in flights]) for name in ("position", "output"))
    flight = Flight(flights[0].time, *joined)
    every = Margins(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Margins)))
    return Outcome(dict(gains), every, scores(flight, task.step, task.band), flight)


def _keeps(result: Outcome, problem: Problem) -> bool:
    """Whether every explanation's vehicles keep the margin and settle, all but a twentieth."""
    good = (result.margins.disk >= problem.task.margin) & result.scores.settles
    ends = np.cumsum([len(part.vehicles) for part in problem.crowds])[:-1]
    return all(np.mean(part) >= SHARE for part in np.split(good, ends))


def _no_worse(old: Outcome, new: Outcome, task: Task) -> bool:
    def figures(result: Outcome) -> list[float]:
        s = result.scores
        least = [-result.share_with(task.margin), -float(s.settles.mean()), -float(np.median(result.margins.disk))]
        return [*least, *(float(np.median(x)) for x in (s.overshoot, s.settling, s.rms, s.error))]

    return all(before <= after for before, after in zip(figures(old), figures(new)))


def _leave(old: Outcome, task: Task) -> str:
    share = f"{old.share_with(task.margin):.0%} of the vehicles that the model allows"
    return f"The present gains keep the margin of {task.margin:g} for {share}, and all but a few settle."


def _chosen(problem: Problem) -> dict[str, float] | None:
    """The best gains that all crowds can live with; looked for with more margin on the probes where that fails.

    Of several sets it is the one whose cost is least for all but a tenth of the vehicles.
    """
    target, task, omega = problem.target, problem.task, problem.omega(FINE // 2)
    for more in (1.0, 1.12, 1.3):
        gains = searched(problem, more * task.margin, ROUNDS).gains
        good = [screened(target, gains, part.vehicles, omega) >= task.margin for part in problem.crowds]
        able = np.flatnonzero(np.min([part.mean(axis=1) for part in good], axis=0) >= SHARE)[:LAST]
        if len(able):
            gains, quick = select(gains, able), paced(target, problem.nominal, STEADY)
            costs = [flown(quick, gains, part.vehicles.pick(slice(0, JUDGED)), task)[0] for part in problem.crowds]
            best = int(np.argmin(np.quantile(np.concatenate(costs, axis=1), 0.9, axis=1)))
            return {name: float(value[best]) for name, value in gains.items()}
    return None


def _price(problem: Problem, known: Knowledge, chosen: Mapping[str, float] | None) -> tuple[str, str] | None:
    """What is open and dear, in a sentence, and the effect to be settled; None where knowing it would gain little."""
    crowds = problem.crowds
    parts = list(zip(crowds, [e.instead for e in known.explanations])) if len(crowds) > 1 else []
    late = dead_time(crowds[0].vehicles)
    early, later = np.quantile(late, [0.25, 0.75])
    if later - early >= LONG_DELAY:
        prompt = crowds[0].vehicles.pick(np.flatnonzero(late <= early))
        parts.append((Crowd("a short delay", prompt), "input-delay"))
    for part, effect in parts:
        alone = searched(replace(problem, crowds=(part,)), problem.task.margin, 1)
        if not len(alone.cost):
            continue
        both = {
            name: np.append(value[:1], [] if chosen is None else [chosen[name]]) for name, value in alone.gains.items()
        }
        settling = flown(problem.rough, both, part.vehicles.pick(slice(0, 1)), problem.task)[1].settling
        mine, ours = settling[0], np.inf if chosen is None else settling[1]
        if ours > DEAREST * mine:
            settled = effect or next((e.instead for e in known.explanations if e.instead), "input-delay")
            what = "no gains" if not np.isfinite(ours) else f"gains that settle in {ours:.1f} s"
            open_still = "the delay" if settled == "input-delay" and len(crowds) == 1 else f"whether it is {settled}"
            return (
                f"What is open changes the answer: with {part.name} alone the step settles in {mine:.1f} s, and there "
                f"are {what} for everything that the logs allow; {open_still} is not known well enough.",
                settled,
            )
    return None


def _more(target: Target) -> str:
    wider = "" if target.beyond or not target.firmware else "--beyond-range or "
    return f"Try {wider}a smaller --margin, or a smaller --step."
