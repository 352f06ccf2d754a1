"""Gains: as fast and as stiff as the margin allows to all vehicles that may be the one in the pool.

First design numbers are spread over the space of gains and their disk margins worked out on three vehicles of every
explanation; all that keep the margin are flown, for no figure of a linear loop says how soon a step settles. The best
are looked at again nearby, ever nearer, and the last few are judged on the whole crowd.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.control import plant
from automarine_cli.control.actuators import dead_time, lag_of, output_slope
from automarine_cli.control.flight import Scores, scores, step_and_load
from automarine_cli.control.margins import TILT, Margins, disk_margin, frequencies, margins, stable_along
from automarine_cli.control.members import Vehicles
from automarine_cli.control.targets.base import Gains, Nominal, Target
from automarine_cli.quantities import Complexes, Floats

SHARE = 0.95
"""Of the crowd that has to keep the margin, and to settle."""
FIRST, NEAR, ELITE, FLOWN, MOST = 1500, 200, 8, 160, 40
"""Sets of gains: spread over their space, near the best so many, flown for a further explanation, found at last."""
FEW, NEARLY = 40, 0.95
"""Vehicles on which flown sets have to keep the margin; share of it that three probes have to keep before."""
NEVER = 1e6
"""What not settling costs, in lengths of a flight."""
WIDTH = 0.3
"""Of the neighbourhood of good gains, in design numbers between 0 and 1."""
ROUGH, LONGEST = 0.1, 0.02
"""Loops of flights that gains are looked for with, in shares of all that is slow in the loop; and the longest loops
and steps of a vehicle in flights that are not promised [s]."""
LONG, LEAST = 5.0, 6.0
"""Flights that gains are looked for with, in settling times and at least [s]."""
COARSE, FINE = 180, 500
"""Frequencies of the first look and of the margins that are told."""
DEGREE = np.pi / 180.0


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
class Crowd:
    """Vehicles that one explanation allows, the first as its model says."""

    name: str
    vehicles: Vehicles

    def first(self, count: int) -> "Crowd":
        """The first so many of them."""
        return Crowd(self.name, self.vehicles.pick(slice(0, count)))

    @cached_property
    def probes(self) -> Vehicles:
        """The first, one that is late and lively, and one that is sluggish."""
        reach = output_slope(self.vehicles) / self.vehicles.theta[:, 0]
        late = dead_time(self.vehicles) + lag_of(self.vehicles) + 1e-3
        lively, sluggish = np.argsort(late / late.max() + reach / reach.max()), np.argsort(-reach)
        place = int(SHARE * (len(reach) - 1))
        return self.vehicles.pick(np.array([0, lively[place], sluggish[place]]))


def grid_for(target: Target, crowds: Sequence[Crowd], count: int) -> Floats:
    """Frequencies that matter to a target on these vehicles."""
    late = max(float(np.max(dead_time(one.vehicles))) for one in crowds)
    return frequencies(min(np.pi / target.period, 60.0 / max(late, 1e-3)), count)


def loop_of(target: Target, gains: Gains, vehicles: Vehicles, s: Complexes) -> Complexes:
    """The loop cut at the output, (S, W), for one set of gains a vehicle (S, 1), or the same for all (1, 1)."""
    of_position, of_velocity = target.paths(gains, s)
    position, velocity = plant.response(_seen(target, vehicles), s)
    return of_position * position + of_velocity * velocity


def all_margins(target: Target, gains: Gains, vehicles: Vehicles, omega: Floats) -> Margins:
    """Margins of every vehicle under one set of gains."""
    poles = plant.poles(vehicles)
    return margins(lambda s: loop_of(target, gains, vehicles, s), omega, poles, target.integrators)


def _seen(target: Target, vehicles: Vehicles) -> Vehicles:
    """The vehicles without a map where the target makes up for it."""
    return replace(vehicles, bend=None) if target.linear else vehicles


def screened(target: Target, gains: dict[str, Floats], vehicles: Vehicles, omega: Floats) -> Floats:
    """Disk margins of sets of gains (C,) on vehicles (V): (C, V), zero where a loop is unstable."""
    seen, own = _seen(target, vehicles), {name: value[:, None] for name, value in gains.items()}
    poles, lines = plant.poles(seen), (omega * (1j - TILT), 1j * omega)
    ways = [(*target.paths(own, s), *plant.response(seen, s)) for s in lines]
    disk = np.zeros((len(next(iter(gains.values()))), len(seen)))
    for k in range(len(seen)):
        tilted, ratio = (x * position[k] + v * velocity[k] for x, v, position, velocity in ways)
        good = stable_along(tilted, poles[k : k + 1], target.integrators)
        disk[:, k] = np.where(good, disk_margin(ratio), 0.0)
    return disk


@dataclass(frozen=True)
class Tried:
    """Sets of gains with the design numbers they came from, and what they cost on a crowd, (C,)."""

    numbers: Floats
    gains: dict[str, Floats]
    cost: Floats

    def best(self, count: int) -> NDArray[np.int64]:
        """Places of the cheapest."""
        return np.argsort(self.cost, kind="stable")[:count]

    def first(self, count: int) -> "Tried":
        """The cheapest, in order."""
        order = self.best(count)
        return Tried(self.numbers[order], picked(self.gains, order), self.cost[order])


def cost_of(found: Scores, task: Task) -> Floats:
    """log settling + log largest error under load + 1/4 log what is left of it, (S,): half the time is worth as much as
    half the error; and 4 for each share of the step by which it is overshot, beyond a tenth."""
    settling = np.log(np.where(found.settles, found.settling, NEVER * task.seconds))
    load = np.log(np.maximum(found.error, 1e-6)) + 0.25 * np.log(found.end + task.band)
    return np.asarray(settling + load + 4.0 * np.maximum(found.overshoot - 0.1, 0.0))


def flown(target: Target, gains: dict[str, Floats], vehicles: Vehicles, task: Task) -> tuple[Floats, Scores]:
    """Cost of sets of gains (C,) on some vehicles (V): (C, V), and the scores (C V,), vehicles fastest."""
    sets, count = len(next(iter(gains.values()))), len(vehicles)
    own: Gains = {name: np.repeat(value, count)[:, None] for name, value in gains.items()}
    many = vehicles.times(sets)
    flight = step_and_load(target, own, many, task.step, task.load, task.seconds, longest=LONGEST)
    found = scores(flight, task.step, task.band)
    return cost_of(found, task).reshape(sets, count), found


def spread_numbers(count: int, size: int) -> Floats:
    """Points (count, size) that fill the unit cube evenly: the R-sequence (Roberts 2018)."""
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (size + 1))
    steps = (1.0 / root) ** np.arange(1, size + 1)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0


def picked(gains: dict[str, Floats], which: NDArray[np.int64]) -> dict[str, Floats]:
    """Some of several sets of gains."""
    return {name: value[which] for name, value in gains.items()}


def paced(target: Target, nominal: Nominal, share: float) -> Target:
    """The same stack with fewer loops a second, where those of the firmware are far shorter than all that is slow:
    `share` of it, 0.02 s at most."""
    slow = nominal.lag + target.own_lag({})
    return type(target)(float(np.clip(share * slow, target.period, max(target.period, LONGEST))), target.beyond)


def brief(target: Target, nominal: Nominal, crowds: Sequence[Crowd], task: Task) -> Task:
    """The task with flights only as long as it takes to tell good gains from bad: `LONG` times what the best of a few
    takes to settle, on the first vehicle."""
    gains = target.propose(spread_numbers(FIRST // 5, target.numbers), nominal)
    one = crowds[0].vehicles.pick(slice(0, 1))
    kept = np.flatnonzero(screened(target, gains, one, grid_for(target, crowds, COARSE))[:, 0] >= task.margin)
    if not len(kept):
        return task
    settling = flown(paced(target, nominal, ROUGH), picked(gains, kept), one, task)[1].settling.min()
    return replace(task, seconds=float(np.clip(LONG * settling, LEAST, task.seconds)))


def searched(target: Target, nominal: Nominal, crowds: Sequence[Crowd], task: Task, rounds: int = 2) -> Tried:
    """The best sets of gains that keep the margin on some vehicles of all crowds, cheapest first; none where none does.

    Margins are those of the target's own loops, flights are rough.
    """
    omega = grid_for(target, crowds, COARSE)
    found = _tried(target, nominal, crowds, task, omega, spread_numbers(FIRST, target.numbers))
    near = (spread_numbers(NEAR, target.numbers) - 0.5).reshape(ELITE, -1, target.numbers)
    for turn in range(1, rounds):
        best = found.best(ELITE)
        around = found.numbers[best][:, None, :] + WIDTH / turn * near[: len(best)]
        more = np.clip(around.reshape(-1, target.numbers), 0.0, 1.0)
        again = _tried(target, nominal, crowds, task, omega, more)
        found = Tried(
            np.concatenate([found.numbers, again.numbers]),
            {name: np.concatenate([value, again.gains[name]]) for name, value in found.gains.items()},
            np.concatenate([found.cost, again.cost]),
        )
    return found.first(MOST)


def _tried(
    target: Target, nominal: Nominal, crowds: Sequence[Crowd], task: Task, omega: Floats, numbers: Floats
) -> Tried:
    gains, places = target.propose(numbers, nominal), np.arange(len(numbers))
    for one in crowds:
        disk = screened(target, picked(gains, places), one.probes, omega)
        places = places[np.all(disk >= NEARLY * task.margin, axis=1)]
    quick, cost = paced(target, nominal, ROUGH), np.zeros(len(places))
    for one in crowds:  # what is dear for the first explanation need not be flown for the others
        if len(places):
            cost = np.maximum(cost, flown(quick, picked(gains, places), one.probes, task)[0].max(axis=1))
        best = np.argsort(cost, kind="stable")[:FLOWN]
        places, cost = places[best], cost[best]
    for one in crowds:
        disk = screened(target, picked(gains, places), one.vehicles.pick(slice(0, FEW)), omega)
        kept = np.mean(disk >= task.margin, axis=1) >= SHARE
        places, cost = places[kept], cost[kept]
    return Tried(numbers[places], picked(gains, places), cost)
