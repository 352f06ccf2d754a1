"""Flights under a controller, margins of its loops, and gains as fast and stiff as the margin allows to all vehicles
that a model allows.

Margins mean nothing for unstable loops, which are found first: by counting how often 1 + L goes round the origin along
a line slightly to the left of the imaginary axis (Nyquist), so that what rings on and on is unstable too.

Design numbers are spread over the space of gains; all that keep the disk margin on some vehicles of every explanation
are flown, for no linear figure says how soon a step settles. The best are looked at again nearby, ever nearer, and the
last few are judged on the whole crowd: the quickest of those that bring the vehicle back from a load that stays; where
none does, settling and what is left of the load weigh equally.

Sources: Seiler, Packard and Gahinet (2020), An introduction to disk margins, IEEE Control Systems 40(5):78; Nyquist
(1932), Bell System Technical Journal 11:126."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.control import vehicles as plant
from automarine_cli.control.knowledge import Knowledge
from automarine_cli.control.targets.base import Gains, NominalPlant, Target
from automarine_cli.control.vehicles import Vehicles, dead_time, lag_of
from automarine_cli.models.model import steady_rate
from automarine_cli.quantities import STEERED, Complexes, Floats
from automarine_cli.thrusters.map import TwinThrusters

MAX_VEHICLE_STEP_S = 0.01  # longest step [s] of a vehicle between two loops of its controller
FLIGHT_SAMPLE_S = 0.1  # flights are kept, and readings as far off as they are, for so long [s]: the pace of logs
Loop = Callable[[Complexes], Complexes]
Trials = NDArray[Any]  # of C sets of gains on some vehicles, (C,): `numbers` of the design, `disk` margin, worst scores
MIN_DAMPING_RATIO = 0.02  # damping ratio below which a closed loop counts as unstable
MIN_RAD_S = 1e-4  # frequency [rad/s] below which a pole counts as an integrator


@dataclass(frozen=True)
class ClosedLoopRun:
    """`time` (N,) [s] and `position` (S, R, N) of S sets in R flights."""

    time: Floats
    position: Floats


def fly(
    target: Target, gains: Gains, vehicles: Vehicles, reference: Floats, load: Floats, *,
    longest: float = MAX_VEHICLE_STEP_S, sets: int = 1,
) -> ClosedLoopRun:  # fmt: skip
    """Fly from rest: `reference` (S or 1, R, M) at each loop of the controller from position 0, `load` (S or 1, R) a
    moment against the vehicle all along, the vehicle in steps of `longest` [s] at most; kept ten times a second.
    Readings have the vehicles' noise, the same in every call, and for each of several `sets` of gains on a crowd."""
    step, loops = target.period, reference.shape[2]
    parts = max(1, int(np.ceil(step / longest - 1e-9)))
    flights = reference.shape[1]
    hull, drive = plant.Body(vehicles, flights), plant.Actuators(vehicles, flights, step / parts)
    holding = plant.holding(vehicles)[:, None]
    drive.begin(holding + np.zeros((1, flights)))
    state, controller = target.start(gains, hull.position[0], holding), target.controller(gains)
    lag, sensed = plant.sensor_lag(vehicles)[:, None], hull.position[0]
    late = np.exp(-step / np.maximum(lag, 1e-9))
    pace = max(1, round(FLIGHT_SAMPLE_S / step))
    random, sizes = np.random.default_rng(0), np.array(vehicles.noise)[:, None, None]
    drawn = (2, len(vehicles) // sets, flights)
    wrong = np.zeros((2, len(vehicles), flights))
    positions: list[Floats] = []
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable set of gains may run away
        for k in range(loops):
            position = hull.position[0]
            sensed = position + late * (sensed - position)
            if k % pace == 0 and any(vehicles.noise):
                wrong = np.tile(sizes * random.standard_normal(drawn), (1, sets, 1))
            readings = sensed + wrong[0], hull.velocity[0] + wrong[1]
            state, output = controller(state, reference[:, :, k], *readings)
            if k % pace == 0:
                positions.append(position)
            for _ in range(parts):
                hull.advance(drive.deliver(output) - load, step / parts)
    return ClosedLoopRun(pace * step * np.arange(len(positions), dtype=np.float64), np.stack(positions, axis=2))


@dataclass(frozen=True)
class FlightScores:
    """Of S sets, (S,) each: `overshoot` in shares of the step, `settling` [s] (or infinite), `rms` from then on,
    `error` of the load [base units], and what is `left` of it after the time of recovery."""

    overshoot: Floats
    settling: Floats
    rms: Floats
    error: Floats
    left: Floats

    @property
    def settles(self) -> NDArray[np.bool_]:
        return np.isfinite(self.settling)


def step_and_load(
    target: Target, gains: Gains, vehicles: Vehicles, step: float, load: float, seconds: float,
    longest: float = MAX_VEHICLE_STEP_S, sets: int = 1,
) -> ClosedLoopRun:  # fmt: skip
    """Fly every set twice: a step of the reference, and a load in shares of the whole output from rest."""
    reference = np.zeros((1, 2, max(2, round(seconds / target.period))))
    reference[:, 0] = step
    loads = np.array([[0.0, load * vehicles.full]])
    return fly(target, gains, vehicles, reference, loads, longest=longest, sets=sets)


def scores(flight: ClosedLoopRun, step: float, band: float, recovery: float = np.inf) -> FlightScores:
    """Score flights of a `step`, settled within a `band`, and of a load; what is left of that is the mean over the
    second before the time of `recovery` [s] or the end."""
    overshoot, settling, rms = step_scores(flight.time, flight.position[:, 0], step, band)
    pushed = np.nan_to_num(flight.position[:, 1], nan=1e6, posinf=1e6, neginf=1e6)
    last = max(10, int(np.searchsorted(flight.time, recovery)))
    left = np.abs(pushed[:, last - 10 : last].mean(axis=1))
    return FlightScores(overshoot, settling, rms, np.abs(pushed).max(axis=1), left)


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
    low = np.geomspace(MIN_RAD_S, start, few, endpoint=False)
    return np.concatenate([low, np.geomspace(start, highest, count - few)])


def stable_along(ratio: Complexes, poles: Complexes, integrators: int) -> NDArray[np.bool_]:
    """Tell which of S closed loops are stable, by L (S, W) at frequencies times (1j - MIN_DAMPING_RATIO), the `poles`
    (S or 1, n) of the vehicle and the number of the controller's `integrators`."""
    curve = 1.0 + ratio
    turned = np.sum(np.angle(curve[:, 1:] / curve[:, :-1]), axis=1)
    origin = np.abs(poles) < MIN_RAD_S
    ahead = (np.abs(np.angle(poles)) < np.pi / 2 + np.arctan(MIN_DAMPING_RATIO)) & ~origin
    count = integrators + origin.sum(axis=1)
    expected = count * (np.pi / 2 + np.arctan(MIN_DAMPING_RATIO)) + np.pi * ahead.sum(axis=1)
    right = np.round((expected - turned) / np.pi)
    return np.asarray((right == 0) & (np.abs(ratio[:, -1]) < 1.0) & np.all(np.isfinite(ratio), axis=1))


def disk_margin(ratio: Complexes) -> Floats:
    """Return 2 / max |S - T| of loops L (S, W), (S,)."""
    return np.asarray(2.0 / np.max(np.abs((1.0 - ratio) / (1.0 + ratio)), axis=1))


def margins(loop: Loop, omega: Floats, poles: Complexes, integrators: int) -> Margins:
    """Return all margins of S loops, where `loop` gives L (S, W) at s (W,); see `stable_along` for the rest."""
    good = stable_along(loop(omega * (1j - MIN_DAMPING_RATIO)), poles, integrators)
    ratio = loop(1j * omega)
    disk, gain = disk_margin(ratio), _gain_margin(ratio)
    phase, delay = _phase_margin(ratio, omega)
    disk, gain, phase, delay = (np.where(good, margin, 0.0) for margin in (disk, gain, phase, delay))
    return Margins(disk, gain, phase, delay, good)


def _crossings(values: NDArray[Any], *others: NDArray[Any]) -> tuple[NDArray[np.bool_], list[Floats]]:
    """Where values (S, W) pass zero, (S, W - 1), and others, (S or 1, W) each, at these places."""
    crosses = values[:, 1:] * values[:, :-1] < 0
    share = np.where(crosses, values[:, :-1] / np.where(crosses, values[:, :-1] - values[:, 1:], 1.0), 0.0)
    return crosses, [other[:, :-1] + share * np.diff(other, axis=1) for other in others]


def _gain_margin(ratio: Complexes) -> Floats:
    """Smallest change of gain, up or down [dB], that brings a loop to -1."""
    crosses, (at,) = _crossings(ratio.imag, ratio.real)
    with np.errstate(divide="ignore"):
        size = np.where(crosses & (at < 0), np.abs(20.0 * np.log10(np.abs(np.where(at < 0, at, 1.0)))), np.inf)
    return np.asarray(np.min(size, axis=1))


def _phase_margin(ratio: Complexes, omega: Floats) -> tuple[Floats, Floats]:
    """Smallest phase [deg], and smallest delay [s], that brings a loop to -1."""
    size, turn = np.log(np.maximum(np.abs(ratio), np.finfo(float).tiny)), np.unwrap(np.angle(ratio), axis=1)
    crosses, (angle, at) = _crossings(size, turn + np.pi, np.log(omega)[None])
    phase = np.where(crosses, np.abs((angle + np.pi) % (2.0 * np.pi) - np.pi), np.inf)
    delay = np.where(crosses, (angle % (2.0 * np.pi)) / np.exp(at), np.inf)
    return np.rad2deg(np.min(phase, axis=1)), np.asarray(np.min(delay, axis=1))


SPEED_RATIOS = (0.5, 2.0)  # at which margins of what is steered are computed beside those at the speed of its logs
CROWD_VEHICLES, JUDGED_FEW = 180, 20
SEARCH_ROUNDS, LAST_SETS = 5, 20  # looks at the space of gains, each nearer to the best; sets judged by the crowd
PROMISED_LOOPS, CHOSEN_LOOPS = 0.02, 0.05  # loops of flights that are promised, and of those that gains are chosen by
PASS_RATE = 0.95  # of the crowd that has to keep the margin, and to settle
FIRST_SETS, NEIGHBOUR_SETS, ELITE_SETS = 1500, 30, 3  # spread over their space, near each of the best, best by a rule
FEW_VEHICLES = 40  # vehicles on which sets have to keep the margin before they are flown
MAX_COST_RATIO = 1.1  # how much more than the best gains may cost that have more margin, or move less under a load
RECOVERY_SETTLINGS, MIN_RECOVERY_S = 4.0, 20.0  # in which a load is to be rejected where nobody sets a time
LOAD_WEIGHTS = (0.0, 0.3, 3.0)  # further weights of a load that is not rejected, for what may lead to better gains
LOAD_BANDS = 0.9  # bands within which the worst of a few have to be, so that all but a twentieth of all are within one
MAX_REST_BANDS = 2.0  # bands by which a vehicle that rests is off at most: noise moves it less
UNSETTLED_COST = 1e6  # what not settling costs, in lengths of a flight
NEIGHBOURHOOD_WIDTH = 0.3  # of the neighbourhood of good gains, in design numbers between 0 and 1
ROUGH_LOOP_SHARE, MAX_LOOP_S = 0.1, 0.02  # loops of rough flights, in shares of the quickest loop's time; the longest
FLIGHT_SETTLINGS, MIN_FLIGHT_S = 5.0, 6.0  # flights that gains are looked for with, in settling times and at least [s]
COARSE_FREQUENCIES, FINE_FREQUENCIES = 180, 500  # frequencies of the first look and of the margins that are told


@dataclass(frozen=True)
class Task:
    """What gains are for: `step` of the reference, `band` of what is settled [base units], `load` in shares of the
    whole output, disk `margin`, `seconds` of a flight, time of `recovery` [s] from the load (infinite: not set)."""

    step: float
    band: float
    load: float
    margin: float
    seconds: float
    recovery: float = np.inf


def probes(vehicles: Vehicles) -> Vehicles:
    """The first, one that is late and lively, and one that is sluggish, where there are more."""
    reach = plant.output_slope(vehicles) / vehicles.theta[:, 0]
    late = dead_time(vehicles) + lag_of(vehicles) + 1e-3
    lively, sluggish = np.argsort(late / late.max() + reach / reach.max()), np.argsort(-reach)
    place = int(PASS_RATE * (len(reach) - 1))
    return vehicles.pick(np.array([0, lively[place], sluggish[place]]))


@dataclass(frozen=True)
class GainResult:
    """Margins, scores and flights of the whole crowd, which vehicles rest in a further flight, and disk margins of what
    is steered at further speeds, by their ratio to that of the logs."""

    gains: Mapping[str, float]
    margins: Margins
    scores: FlightScores
    flight: ClosedLoopRun
    rest: NDArray[np.bool_]
    at_speeds: Mapping[float, Floats] = field(default_factory=dict)

    def share_with(self, margin: float) -> float:
        return float(np.mean(self.margins.disk >= margin))

    def rejects(self, task: Task) -> bool:
        """Tell whether all but a twentieth are back within the band after the time of recovery."""
        return bool(np.mean(self.scores.left <= task.band) >= PASS_RATE)


@dataclass(frozen=True)
class GainProblem:
    """What gains are looked for: stack, task, knowledge, the designer's view of the vehicle, the crowds."""

    target: Target
    task: Task
    knowledge: Knowledge
    nominal: NominalPlant
    crowds: tuple[Vehicles, ...]

    def limit_rate(self, share: float) -> Target:
        """Give the same stack fewer loops a second, a `share` of the quickest loop's time long, 0.02 s at most."""
        target, loop = self.target, share / self.target.crossover(self.nominal)
        return type(target)(float(np.clip(loop, target.period, max(target.period, MAX_LOOP_S))), target.beyond)

    def at_speed(self, ratio: float) -> list[Vehicles]:
        """Return the crowds of what is steered at `ratio` times the speed of its logs."""
        usual, steering = self.knowledge.speed, self.target.steering
        change = steering(ratio * usual, usual) / steering(usual, usual) if usual else 1.0
        return [part.at_speed(ratio, change) for part in self.crowds]

    def omega(self, count: int) -> Floats:
        """Return `count` frequencies [rad/s] that matter to the target on these vehicles."""
        late = max(float(np.max(dead_time(part))) for part in self.crowds)
        return frequencies(min(np.pi / self.target.period, 60.0 / max(late, 1e-3)), count)


def nominal_of(vehicles: Vehicles, step: float) -> NominalPlant:
    """Describe the first of several vehicles as a designer sees it, for a `step` of the reference [base unit]."""
    first, model, full = vehicles.pick(slice(0, 1)), vehicles.model, vehicles.full
    linear, quadratic = model.with_theta(first.theta[0]).drag()
    linear -= vehicles.speed * sum(term.values[0] for term in model.terms if term.name == "cross-coupling")
    lag = float((dead_time(first) + lag_of(first) + plant.sensor_lag(first))[0])
    most = full * float(first.gain[0])
    fastest = float(steady_rate(most, linear, max(quadratic, 1e-9 * full)))
    return NominalPlant(model.dof, float(first.theta[0, 0]) / most, lag, fastest, step, full, model.moment_unit)


def problem_of(
    target: Target, task: Task, knowledge: Knowledge, full: float, bend: TwinThrusters | None, seed: int
) -> GainProblem:
    """Draw vehicles of every explanation, `full` the moment at the whole output, `bend` the map to it or None."""
    rng, crowds = np.random.default_rng(seed), []
    size = max(CROWD_VEHICLES // len(knowledge.explanations), FEW_VEHICLES)
    for explanation in knowledge.explanations:
        crowd = plant.crowd(explanation.model, explanation.covariance, knowledge.spread, full, bend, size, rng)
        crowd = replace(crowd, name=explanation.name, speed=knowledge.speed or 1.0)
        if knowledge.model.moment_unit == STEERED:
            crowd = crowd.at_speed(1.0, target.steering(knowledge.speed, knowledge.speed))
        crowds.append(crowd)
    nominal = replace(nominal_of(crowds[0], task.step), speed=knowledge.speed, side=knowledge.side)
    return GainProblem(target, task, knowledge, nominal, tuple(crowds))


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
    poles, lines = plant.poles(vehicles), (omega * (1j - MIN_DAMPING_RATIO), 1j * omega)
    paths = [(*target.paths(columns, s), *plant.response(vehicles, s)) for s in lines]
    disk = np.zeros((len(next(iter(gains.values()))), len(vehicles)))
    for k in range(len(vehicles)):
        tilted, ratio = (x * position[k] + v * velocity[k] for x, v, position, velocity in paths)
        disk[:, k] = np.where(stable_along(tilted, poles[k : k + 1], 1), disk_margin(ratio), 0.0)
    return disk


def flown(target: Target, gains: Mapping[str, Floats], vehicles: Vehicles, task: Task) -> FlightScores:
    """Fly sets of gains (C,) on some vehicles (V) and return their scores, (C, V) each."""
    sets, count = len(next(iter(gains.values()))), len(vehicles)
    repeated: Gains = {name: np.repeat(value, count)[:, None] for name, value in gains.items()}
    many = vehicles.pick(np.tile(np.arange(count), sets))
    flight = step_and_load(target, repeated, many, task.step, task.load, task.seconds, MAX_LOOP_S, sets)
    result = scores(flight, task.step, task.band, task.recovery)
    return FlightScores(*(value.reshape(sets, count) for value in vars(result).values()))


def tried(
    problem: GainProblem, margin: float, numbers: Floats, vehicles: int, count: int,
    few: Callable[[Vehicles], Vehicles], loops: float,
) -> Trials:  # fmt: skip
    """Fly a few vehicles of every crowd, with `loops` as for `limit_rate`, under those gains of design numbers (C, n)
    that keep the disk margin on 95 % of the first `vehicles`, from `count` frequencies: the worst of them."""
    target, crowds, omega = problem.target, problem.crowds, problem.omega(count)
    gains = target.propose(numbers, problem.nominal)
    disks = [screened(target, gains, part.pick(slice(0, vehicles)), omega) for part in crowds]
    least = np.min([np.sort(disk)[:, int((1.0 - PASS_RATE) * disk.shape[1] + 1e-9)] for disk in disks], axis=0)
    good, columns = least >= margin, [(field.name, float) for field in fields(FlightScores)]
    trials = np.empty(np.count_nonzero(good), [("numbers", float, target.numbers), ("disk", float), *columns])
    trials["numbers"], trials["disk"] = numbers[good], least[good]
    if good.any():
        keeping = {name: value[good] for name, value in gains.items()}
        parts = [vars(flown(problem.limit_rate(loops), keeping, few(part), problem.task)) for part in crowds]
        for name, _ in columns:
            trials[name] = np.max(np.concatenate([part[name] for part in parts], axis=1), axis=1)
    return trials


def leaders(trials: Trials, task: Task, count: int) -> Trials:
    """Return the best `count` sets, best first, then some that may lead to better ones.

    The cost is log settling + log of what is left of the load beyond the band, and 4 for each share of the step by
    which it is overshot beyond a tenth. Among nearly as good sets, the largest margin and the least error under the
    load count."""
    time = np.log(np.where(np.isfinite(trials["settling"]), trials["settling"], UNSETTLED_COST * task.seconds))
    time = time + 4.0 * np.maximum(trials["overshoot"] - 0.1, 0.0)
    excess = np.log(np.maximum(trials["left"] / (LOAD_BANDS * task.band), 1.0))
    costs = [time + weight * excess for weight in (1.0, *LOAD_WEIGHTS)]
    worse = np.maximum(costs[0] - np.min(costs[0], initial=np.inf) - np.log(MAX_COST_RATIO), 0.0)
    orders = [
        np.lexsort((np.maximum(trials["error"], task.band) / trials["disk"], worse)),
        *(np.argsort(c, kind="stable") for c in costs),
    ]
    return trials[list(dict.fromkeys(np.concatenate([order[:count] for order in orders]).tolist()))]


def spread_numbers(count: int, size: int) -> Floats:
    """Return points (count, size) that fill the unit cube evenly: the R-sequence (Roberts 2018)."""
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (size + 1))
    steps = (1.0 / root) ** np.arange(1, size + 1)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0


def shorten(problem: GainProblem) -> tuple[GainProblem, float]:
    """Shorten the flights to `FLIGHT_SETTLINGS` times the quickest settling time on the first vehicle, and set the time
    of recovery where none is set. Return also how long flights that are promised take [s]."""
    task = problem.task
    alone = replace(problem, crowds=(problem.crowds[0].pick(slice(0, 1)),))
    settling = searched(alone, task.margin, 3, FIRST_SETS // 5)["settling"]
    quickest = np.min(settling) if np.any(np.isfinite(settling)) else task.seconds / RECOVERY_SETTLINGS
    quiet = float(np.ceil(RECOVERY_SETTLINGS * quickest))
    recovery = task.recovery if np.isfinite(task.recovery) else max(quiet, MIN_RECOVERY_S)
    seconds = max(float(np.clip(FLIGHT_SETTLINGS * quickest, MIN_FLIGHT_S, task.seconds)), recovery)
    short = replace(problem, task=replace(task, seconds=seconds, recovery=recovery))
    return short, 2.0 * max(task.seconds, recovery, quiet)


def searched(problem: GainProblem, margin: float, rounds: int, first: int = FIRST_SETS) -> Trials:
    """Find, from `first` sets of gains, the best that keep the margin on some vehicles of all crowds, if any."""
    size, task = problem.target.numbers, problem.task
    rough = FEW_VEHICLES, COARSE_FREQUENCIES, probes, ROUGH_LOOP_SHARE
    trials = tried(problem, margin, spread_numbers(first, size), *rough)
    offsets = spread_numbers(NEIGHBOUR_SETS, size) - 0.5
    for turn in range(1, rounds):
        best = leaders(trials, task, ELITE_SETS)["numbers"]
        around = np.clip(best[:, None, :] + NEIGHBOURHOOD_WIDTH / turn * offsets, 0.0, 1.0)
        trials = np.concatenate([trials, tried(problem, margin, around.reshape(-1, size), *rough)])
    return leaders(trials, task, LAST_SETS)


def outcome(problem: GainProblem, gains: Mapping[str, float]) -> GainResult:
    sets: Gains = {name: np.full((1, 1), value) for name, value in gains.items()}
    omega, task, crowds = problem.omega(FINE_FREQUENCIES), problem.task, problem.crowds
    parts = [all_margins(problem.target, sets, part, omega) for part in crowds]
    at_speeds = {
        ratio: np.concatenate([all_margins(problem.target, sets, part, omega).disk for part in problem.at_speed(ratio)])
        for ratio in (SPEED_RATIOS if problem.nominal.steered else ())
    }
    exact = problem.limit_rate(PROMISED_LOOPS)
    flights = [step_and_load(exact, sets, part, task.step, task.load, task.seconds) for part in crowds]
    position, half = np.concatenate([flight.position for flight in flights]), len(flights[0].time) // 2
    flight = ClosedLoopRun(flights[0].time[:half], position[:, :, :half])
    rest = np.all(np.abs(position[:, 0, half:] - task.step) <= MAX_REST_BANDS * task.band, axis=1)
    every = Margins(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Margins)))
    return GainResult(dict(gains), every, scores(flight, task.step, task.band, task.recovery), flight, rest, at_speeds)


def keeps(result: GainResult, problem: GainProblem) -> bool:
    """Tell whether 95 % of every explanation's vehicles keep the margin, settle and rest (none may hunt)."""
    good = (result.margins.disk >= problem.task.margin) & result.scores.settles & result.rest
    ends = np.cumsum([len(part) for part in problem.crowds])[:-1]
    return all(np.mean(part) >= PASS_RATE for part in np.split(good, ends))


def best_gains(problem: GainProblem) -> dict[str, float] | None:
    """Find the best gains that all crowds can live with; looked for with more margin on the few where that fails."""
    crowd = CROWD_VEHICLES, FINE_FREQUENCIES, lambda part: part.pick(slice(0, JUDGED_FEW)), CHOSEN_LOOPS
    for more in (1.0, 1.12, 1.3):
        numbers = searched(problem, more * problem.task.margin, SEARCH_ROUNDS)["numbers"]
        trials = tried(problem, problem.task.margin, numbers, *crowd)
        if len(trials):
            best = leaders(trials, problem.task, 1)["numbers"][:1]
            return {name: float(value[0]) for name, value in problem.target.propose(best, problem.nominal).items()}
    return None
