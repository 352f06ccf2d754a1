"""Flights of vehicles under a controller, how far its loops are from oscillating, and gains as fast and as stiff as the
margin allows to all vehicles that a model allows.

A formula for margins is satisfied by loops that are unstable already: what is unstable is found first, by counting how
often 1 + L goes round the origin along a line slightly to the left of the imaginary axis (Nyquist's criterion, which
thus calls what rings on and on unstable too), and has no margin.

First design numbers are spread over the space of gains and their disk margins worked out on three vehicles of every
explanation; all that keep the margin are flown, for no figure of a linear loop says how soon a step settles. The best
are looked at again nearby, ever nearer, and the last few are judged on the whole crowd.

Sources: Seiler, Packard and Gahinet (2020), An introduction to disk margins, IEEE Control Systems 40(5):78; Nyquist
(1932), Bell System Technical Journal 11:126.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.control import vehicles as plant
from automarine_cli.control.knowledge import Knowledge
from automarine_cli.control.targets.base import Gains, NominalPlant, Target
from automarine_cli.control.vehicles import ThrustCurve, Vehicles, dead_time, lag_of
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Complexes, Floats

LONGEST_STEP = 0.01  # longest step [s] of a vehicle between two loops of its controller
READ = 0.1  # flights are kept, and readings as far off as they are, for so long [s]: the pace of logs
Loop = Callable[[Complexes], Complexes]
TILT = 0.02  # damping ratio below which a closed loop counts as unstable
LOWEST = 1e-4  # frequency [rad/s] below which a pole counts as an integrator


@dataclass(frozen=True)
class ClosedLoopRun:
    """`time` (N,) [s] and `position` (S, R, N) of S sets in R flights."""

    time: Floats
    position: Floats


def fly(
    target: Target, gains: Gains, vehicles: Vehicles, reference: Floats, load: Floats, *, longest: float = LONGEST_STEP
) -> ClosedLoopRun:
    """Fly from rest: `reference` (S or 1, R, M) at each loop of the controller from position 0, `load` (S or 1, R) a
    moment against the vehicle all along, the vehicle in steps of `longest` [s] at most; kept ten times a second.
    Readings have the vehicles' noise, the same in every call."""
    step, loops = target.period, reference.shape[2]
    parts = max(1, int(np.ceil(step / longest - 1e-9)))
    flights = reference.shape[1]
    hull, drive = plant.Body(vehicles, flights), plant.Actuators(vehicles, flights, step / parts)
    holding = plant.holding(vehicles)[:, None]
    drive.begin(holding + np.zeros((1, flights)))
    state, controller = target.start(gains, hull.position[0], holding), target.controller(gains)
    lag, sensed = plant.sensor_lag(vehicles)[:, None], hull.position[0]
    late = np.exp(-step / np.maximum(lag, 1e-9))
    pace = max(1, round(READ / step))
    random, sizes = np.random.default_rng(0), np.array(vehicles.noise)[:, None, None]
    wrong = sizes * np.zeros((2, len(vehicles), flights))
    positions: list[Floats] = []
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable set of gains may run away
        for k in range(loops):
            position = hull.position[0]
            sensed = position + late * (sensed - position)
            if k % pace == 0 and any(vehicles.noise):
                wrong = sizes * random.standard_normal(wrong.shape)
            readings = sensed + wrong[0], hull.velocity[0] + wrong[1]
            state, output = controller(state, reference[:, :, k], *readings)
            if k % pace == 0:
                positions.append(position)
            for _ in range(parts):
                hull.advance(drive.deliver(output) - load, step / parts)
    time = pace * step * np.arange(len(positions), dtype=np.float64)
    return ClosedLoopRun(time, np.stack(positions, axis=2))


@dataclass(frozen=True)
class Scores:
    """Of S sets, (S,) each: `overshoot` in shares of the step, `settling` [s] (infinite where it never does), `rms`
    from then on and `error` of the load [base units], and `end` what is left of the latter at the end."""

    overshoot: Floats
    settling: Floats
    rms: Floats
    error: Floats
    end: Floats

    @property
    def settles(self) -> NDArray[np.bool_]:
        return np.isfinite(self.settling)


def step_and_load(
    target: Target, gains: Gains, vehicles: Vehicles, step: float, load: float, seconds: float,
    longest: float = LONGEST_STEP,
) -> ClosedLoopRun:  # fmt: skip
    """Fly every set twice: a step of the reference, and a load in shares of the whole output from rest."""
    reference = np.zeros((1, 2, max(2, round(seconds / target.period))))
    reference[:, 0] = step
    loads = np.array([[0.0, load * vehicles.full]])
    return fly(target, gains, vehicles, reference, loads, longest=longest)


def scores(flight: ClosedLoopRun, step: float, band: float) -> Scores:
    overshoot, settling, rms = step_scores(flight.time, flight.position[:, 0], step, band)
    pushed = np.abs(np.nan_to_num(flight.position[:, 1], nan=1e6, posinf=1e6, neginf=1e6))
    return Scores(overshoot, settling, rms, pushed.max(axis=1), pushed[:, -1])


def step_scores(time: Floats, position: Floats, step: float, band: float) -> tuple[Floats, Floats, Floats]:
    """Return overshoot in shares of a `step`, when positions (S, N) settle in a `band` [s], and the rms from then."""
    way, error = position / step, np.abs(position - step)
    with np.errstate(invalid="ignore"):
        outside = ~(error <= band)
    last = len(time) - 1 - np.argmax(outside[:, ::-1], axis=1)
    never = last > 0.9 * len(time)
    settling = np.where(never, np.inf, time[np.minimum(last + 1, len(time) - 1)])
    settled = time[None, :] >= np.where(never, 0.75 * time[-1], settling)[:, None]
    square = np.where(settled, np.nan_to_num(error, nan=1e6, posinf=1e6) ** 2, 0.0)
    rms = np.sqrt(square.sum(axis=1) / np.maximum(settled.sum(axis=1), 1))
    overshoot = np.maximum(np.nan_to_num(way, nan=1e6, posinf=1e6).max(axis=1) - 1.0, 0.0)
    return overshoot, settling, rms


@dataclass(frozen=True)
class Margins:
    """Of S loops, (S,) each: `disk` (balanced, the diameter alpha), `gain` [dB], the smaller way, `phase` [deg],
    `delay` [s], and `stable`; zero where a loop is not."""

    disk: Floats
    gain: Floats
    phase: Floats
    delay: Floats
    stable: NDArray[np.bool_]


def frequencies(highest: float, count: int) -> Floats:
    """Return frequencies [rad/s] up to `highest`, which is above 1, denser where loops cross over."""
    few, start = max(count // 6, 8), highest * 1e-4
    return np.concatenate([np.geomspace(LOWEST, start, few, endpoint=False), np.geomspace(start, highest, count - few)])


def stable_along(ratio: Complexes, poles: Complexes, integrators: int) -> NDArray[np.bool_]:
    """Tell which of S closed loops are stable, by L (S, W) at frequencies times (1j - TILT).

    `poles` (S or 1, n) are those of the vehicle, `integrators` how many the controller adds."""
    curve = 1.0 + ratio
    turned = np.sum(np.angle(curve[:, 1:] / curve[:, :-1]), axis=1)
    origin = np.abs(poles) < LOWEST
    ahead = (np.abs(np.angle(poles)) < np.pi / 2 + np.arctan(TILT)) & ~origin
    count = integrators + origin.sum(axis=1)
    expected = count * (np.pi / 2 + np.arctan(TILT)) + np.pi * ahead.sum(axis=1)
    right = np.round((expected - turned) / np.pi)
    return np.asarray((right == 0) & (np.abs(ratio[:, -1]) < 1.0) & np.all(np.isfinite(ratio), axis=1))


def disk_margin(ratio: Complexes) -> Floats:
    """Return 2 / max |S - T| of loops L (S, W), (S,)."""
    return np.asarray(2.0 / np.max(np.abs((1.0 - ratio) / (1.0 + ratio)), axis=1))


def margins(loop: Loop, omega: Floats, poles: Complexes, integrators: int) -> Margins:
    """Return all margins of S loops, where `loop` gives L (S, W) at s (W,); see `stable_along` for the rest."""
    good = stable_along(loop(omega * (1j - TILT)), poles, integrators)
    ratio = loop(1j * omega)
    disk, gain = disk_margin(ratio), _gain_margin(ratio)
    phase, delay = _phase_margin(ratio, omega)
    disk, gain, phase, delay = (np.where(good, margin, 0.0) for margin in (disk, gain, phase, delay))
    return Margins(disk, gain, phase, delay, good)


def _gain_margin(ratio: Complexes) -> Floats:
    """Smallest change of gain, up or down [dB], that brings a loop to -1."""
    side, real = ratio.imag, ratio.real
    crosses = side[:, 1:] * side[:, :-1] < 0
    share = np.where(crosses, side[:, :-1] / np.where(crosses, side[:, :-1] - side[:, 1:], 1.0), 0.0)
    at = real[:, :-1] + share * (real[:, 1:] - real[:, :-1])
    with np.errstate(divide="ignore"):
        size = np.where(crosses & (at < 0), np.abs(20.0 * np.log10(np.abs(np.where(at < 0, at, 1.0)))), np.inf)
    return np.asarray(np.min(size, axis=1))


def _phase_margin(ratio: Complexes, omega: Floats) -> tuple[Floats, Floats]:
    """Smallest phase [deg], and smallest delay [s], that brings a loop to -1."""
    size, turn = np.log(np.maximum(np.abs(ratio), np.finfo(float).tiny)), np.unwrap(np.angle(ratio), axis=1)
    crosses = size[:, 1:] * size[:, :-1] < 0
    share = np.where(crosses, size[:, :-1] / np.where(crosses, size[:, :-1] - size[:, 1:], 1.0), 0.0)
    angle = turn[:, :-1] + share * np.diff(turn, axis=1) + np.pi
    at = np.exp(np.log(omega[:-1]) + share * np.diff(np.log(omega)))
    distance = np.abs((angle + np.pi) % (2.0 * np.pi) - np.pi)
    phase = np.where(crosses, distance, np.inf)
    delay = np.where(crosses, (angle % (2.0 * np.pi)) / at, np.inf)
    return np.rad2deg(np.min(phase, axis=1)), np.asarray(np.min(delay, axis=1))


CROWD, JUDGED = 180, 12
ROUNDS, LAST = 5, 20  # looks at the space of gains, each nearer to the best; sets that are judged by the crowd
EXACT, STEADY = (0.02, 0.05)  # loops of the flights that are promised, and of those that gains are chosen by
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


def probes(vehicles: Vehicles) -> Vehicles:
    """The first, one that is late and lively, and one that is sluggish."""
    reach = plant.output_slope(vehicles) / vehicles.theta[:, 0]
    late = dead_time(vehicles) + lag_of(vehicles) + 1e-3
    lively, sluggish = np.argsort(late / late.max() + reach / reach.max()), np.argsort(-reach)
    place = int(SHARE * (len(reach) - 1))
    return vehicles.pick(np.array([0, lively[place], sluggish[place]]))


@dataclass(frozen=True)
class Outcome:
    """What a set of gains does over the whole crowd: margins and scores of every vehicle, flights of every vehicle."""

    gains: Mapping[str, float]
    margins: Margins
    scores: Scores
    flight: ClosedLoopRun

    def share_with(self, margin: float) -> float:
        return float(np.mean(self.margins.disk >= margin))


@dataclass(frozen=True)
class Problem:
    """What gains are looked for: the stack, the task, what is known of the vehicle, it as the designer sees it, and the
    crowds that are flown."""

    target: Target
    task: Task
    knowledge: Knowledge
    nominal: NominalPlant
    crowds: tuple[Vehicles, ...]

    def limit_rate(self, share: float) -> Target:
        """Give the same stack fewer loops a second, a `share` of all that is slow long, 0.02 s at most."""
        slow, target = self.nominal.lag + self.target.own_lag, self.target
        return type(target)(float(np.clip(share * slow, target.period, max(target.period, LONGEST))), target.beyond)

    def omega(self, count: int) -> Floats:
        """Return `count` frequencies [rad/s] that matter to the target on these vehicles."""
        late = max(float(np.max(dead_time(part))) for part in self.crowds)
        return frequencies(min(np.pi / self.target.period, 60.0 / max(late, 1e-3)), count)


def nominal_of(vehicles: Vehicles, step: float) -> NominalPlant:
    """Describe the first of several vehicles as a designer sees it, for a `step` of the reference [base unit]."""
    first, full, dof = vehicles.pick(slice(0, 1)), vehicles.full, vehicles.model.dof
    linear, quadratic = vehicles.model.with_theta(first.theta[0]).drag()
    lag = float((dead_time(first) + lag_of(first) + plant.sensor_lag(first))[0])
    fastest = float(steady_rate(full, linear, max(quadratic, 1e-9 * full)))
    inertia, unit = float(first.theta[0, 0]) / full, vehicles.model.moment_unit
    return NominalPlant(dof, inertia, lag, fastest, step, full, unit)


def problem_of(
    target: Target, task: Task, knowledge: Knowledge, full: float, bend: ThrustCurve | None, seed: int
) -> Problem:
    """Draw vehicles of every explanation, the same count of each: `full` is the moment or force at the whole output,
    `bend` the map to it where that is no straight line."""
    rng, crowds = np.random.default_rng(seed), []
    size = max(CROWD // len(knowledge.explanations), FEW)
    for explanation in knowledge.explanations:
        crowd = plant.crowd(explanation.model, explanation.covariance, knowledge.spread, full, bend, size, rng)
        crowds.append(replace(crowd, name=explanation.name))
    return Problem(target, task, knowledge, nominal_of(crowds[0], task.step), tuple(crowds))


def select(gains: Mapping[str, Floats], which: NDArray[Any]) -> dict[str, Floats]:
    return {name: value[which] for name, value in gains.items()}


def all_margins(target: Target, gains: Gains, vehicles: Vehicles, omega: Floats) -> Margins:
    """Return margins of every vehicle (S,) under gains (S, 1), or the same for all (1, 1), from frequencies (W,)."""

    def loop(s: Complexes) -> Complexes:
        of_position, of_velocity = target.paths(gains, s)
        position, velocity = plant.response(vehicles, s)
        return of_position * position + of_velocity * velocity

    return margins(loop, omega, plant.poles(vehicles), 1)


def screened(target: Target, gains: dict[str, Floats], vehicles: Vehicles, omega: Floats) -> Floats:
    """Return disk margins of sets of gains (C,) on vehicles (V): (C, V), zero where a loop is unstable."""
    columns = {name: value[:, None] for name, value in gains.items()}
    poles, lines = plant.poles(vehicles), (omega * (1j - TILT), 1j * omega)
    paths = [(*target.paths(columns, s), *plant.response(vehicles, s)) for s in lines]
    disk = np.zeros((len(next(iter(gains.values()))), len(vehicles)))
    for k in range(len(vehicles)):
        tilted, ratio = (x * position[k] + v * velocity[k] for x, v, position, velocity in paths)
        disk[:, k] = np.where(stable_along(tilted, poles[k : k + 1], 1), disk_margin(ratio), 0.0)
    return disk


def flown(target: Target, gains: Mapping[str, Floats], vehicles: Vehicles, task: Task) -> tuple[Floats, Scores]:
    """Fly sets of gains (C,) on some vehicles (V) and return their cost (C, V), and the scores (C V,).

    The cost is log settling + log largest error under load + 1/4 log what is left of it: half the time is worth as much
    as half the error; and 4 for each share of the step by which it is overshot, beyond a tenth."""
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


def shorten(problem: Problem) -> Problem:
    """Shorten the flights to `LONG` times what the best of a few takes to settle, on the first vehicle."""
    target, task = problem.target, problem.task
    gains = target.propose(spread_numbers(FIRST // 5, target.numbers), problem.nominal)
    first = problem.crowds[0].pick(slice(0, 1))
    good = np.flatnonzero(screened(target, gains, first, problem.omega(COARSE))[:, 0] >= task.margin)
    if not len(good):
        return problem
    settling = flown(problem.limit_rate(ROUGH), select(gains, good), first, task)[1].settling.min()
    return replace(problem, task=replace(task, seconds=float(np.clip(LONG * settling, LEAST, task.seconds))))


def searched(problem: Problem, margin: float, rounds: int) -> Floats:
    """Find design numbers of the best sets of gains that keep the margin on some vehicles of all crowds, cheapest
    first; none where none does. Margins are those of the target's own loops, flights are rough."""
    size, omega = problem.target.numbers, problem.omega(COARSE)
    numbers, cost = _tried(problem, margin, omega, spread_numbers(FIRST, size))
    offsets = (spread_numbers(NEAR, size) - 0.5).reshape(ELITE, -1, size)
    for turn in range(1, rounds):
        best = numbers[_cheapest(cost, ELITE)]
        around = np.clip(best[:, None, :] + WIDTH / turn * offsets[: len(best)], 0.0, 1.0).reshape(-1, size)
        nearby = _tried(problem, margin, omega, around)
        numbers, cost = np.concatenate([numbers, nearby[0]]), np.concatenate([cost, nearby[1]])
    return numbers[_cheapest(cost, MOST)]


def _cheapest(cost: Floats, count: int) -> NDArray[np.int64]:
    return np.argsort(cost, kind="stable")[:count]


def _tried(problem: Problem, margin: float, omega: Floats, numbers: Floats) -> tuple[Floats, Floats]:
    """The design numbers whose gains keep the margin, and what these cost on a few vehicles, (C,)."""
    target, quick = problem.target, problem.limit_rate(ROUGH)
    gains = target.propose(numbers, problem.nominal)
    places, cost = np.arange(len(numbers)), np.zeros(len(numbers))
    for part in problem.crowds:
        disk = screened(target, select(gains, places), probes(part), omega)
        places = places[np.all(disk >= NEARLY * margin, axis=1)]
    for part in problem.crowds:  # what is dear for the first explanation need not be flown for the others
        if len(places):
            flights = flown(quick, select(gains, places), probes(part), problem.task)[0].max(axis=1)
            cost[places] = np.maximum(cost[places], flights)
            places = places[_cheapest(cost[places], FLOWN)]
    for part in problem.crowds:
        disk = screened(target, select(gains, places), part.pick(slice(0, FEW)), omega)
        places = places[np.mean(disk >= margin, axis=1) >= SHARE]
    return numbers[places], cost[places]


def outcome(problem: Problem, gains: Mapping[str, float]) -> Outcome:
    sets: Gains = {name: np.full((1, 1), value) for name, value in gains.items()}
    omega, task, crowds = problem.omega(FINE), problem.task, problem.crowds
    parts = [all_margins(problem.target, sets, part, omega) for part in crowds]
    exact = problem.limit_rate(EXACT)
    flights = [step_and_load(exact, sets, part, task.step, task.load, task.seconds) for part in crowds]
    flight = ClosedLoopRun(flights[0].time, np.concatenate([flight.position for flight in flights]))
    every = Margins(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Margins)))
    return Outcome(dict(gains), every, scores(flight, task.step, task.band), flight)


def keeps(result: Outcome, problem: Problem) -> bool:
    """Whether every explanation's vehicles keep the margin and settle, all but a twentieth."""
    good = (result.margins.disk >= problem.task.margin) & result.scores.settles
    ends = np.cumsum([len(part) for part in problem.crowds])[:-1]
    return all(np.mean(part) >= SHARE for part in np.split(good, ends))


def best_gains(problem: Problem) -> dict[str, float] | None:
    """The best gains that all crowds can live with; looked for with more margin on the probes where that fails.

    Of several sets it is the one whose cost is least for all but a tenth of the vehicles."""
    target, task, omega = problem.target, problem.task, problem.omega(FINE // 2)
    for more in (1.0, 1.12, 1.3):
        gains = target.propose(searched(problem, more * task.margin, ROUNDS), problem.nominal)
        good = [screened(target, gains, part, omega) >= task.margin for part in problem.crowds]
        admissible = np.flatnonzero(np.min([part.mean(axis=1) for part in good], axis=0) >= SHARE)[:LAST]
        if len(admissible):
            gains, quick = select(gains, admissible), problem.limit_rate(STEADY)
            costs = [flown(quick, gains, part.pick(slice(0, JUDGED)), task)[0] for part in problem.crowds]
            best = int(np.argmin(np.quantile(np.concatenate(costs, axis=1), 0.9, axis=1)))
            return {name: float(value[best]) for name, value in gains.items()}
    return None
