"""Vehicles that a model allows: their draw, actuators and bodies step by step, and their response in frequency."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.effects import Commands, Effect, Place
from automarine_cli.effects.input_delay import InputDelay
from automarine_cli.effects.sensor_lag import SensorLag
from automarine_cli.effects.thruster_lag import ADVANCES, MIN_LAG_S, Advance, ThrusterLag, speed_of
from automarine_cli.models.model import Bound, Model, actuators
from automarine_cli.quantities import STEERED, Complexes, Floats
from automarine_cli.simulation.rollout import Slope, right_hand_side
from automarine_cli.thrusters.map import TwinThrusters

THRUST_BY_VOLTAGE = 1.2  # exponent at a fixed command: Blue Robotics, T200 performance data (2019)
MIN_LAG_MOMENT_SHARE = 0.1  # share of the reference moment at which a lag that depends on the speed counts in margins
# Velocities [base unit/s] over which drag is taken as straight: quadratic drag damps least at rest, dry friction in a
# brisk turn; moving water is looked at over a slow one.
REST_SWING, SLOW_SWING, BRISK_SWING = 1e-6, 0.02, 0.3


@dataclass(frozen=True)
class Vehicles:
    """S vehicles that one explanation allows; the first of a crowd is as its model says. `theta` (S, p) of `model`;
    `full` moment or force of the whole output; `gain` (S,) of the thrust, `late` (S,) [s] beyond the model's delay,
    `volts` (S,) of the supply, `at` (S,) the output about which its slope counts in margins; `bend` the thrusters where
    moment is not in proportion to output; `noise` of position and velocity read [base units]; `speed` [m/s] of what is
    steered, which it keeps."""

    model: Model
    theta: Floats
    full: float
    gain: Floats
    late: Floats
    volts: Floats
    at: Floats
    bend: TwinThrusters | None = None
    noise: tuple[float, float] = (0.0, 0.0)
    name: str = ""
    speed: float = 1.0

    def __len__(self) -> int:
        return len(self.theta)

    def pick(self, which: NDArray[np.int64] | slice) -> "Vehicles":
        arrays = ("theta", "gain", "late", "volts", "at")
        return replace(self, **{name: getattr(self, name)[which] for name in arrays})

    @property
    def signals(self) -> dict[str, Floats]:
        """What effects read beside the motion, (S, 1) or for all."""
        return {"voltage": self.volts[:, None], "surge": np.array(self.speed)}

    def at_speed(self, ratio: float, steering: float) -> "Vehicles":
        """Return the same at `ratio` times the speed, where the autopilot turns the rudder by `steering` as much for
        the same output. What its logs do not show of the speed goes as in the prime system: the rudder's moment with
        its square, linear drag in proportion (Norrbin 1971)."""
        names = {term.name for term in self.model.terms}
        linear = np.array(self.model.parameter_names) == self.model.dof.parameter("linear")
        theta = self.theta * np.where(linear & ("cross-coupling" not in names), ratio, 1.0)
        gain = self.gain * steering * (1.0 if "rudder-inflow" in names else ratio**2)
        return replace(self, theta=theta, gain=gain, speed=ratio * self.speed)


@dataclass(frozen=True)
class Spread:
    """What is uncertain beside theta: `scatter` of the thrust from run to run, the longest `late` [s] that the logs
    cannot show, `volts` logged, lowest and highest, `noise` of position and velocity [base units]."""

    scatter: float
    late: float
    volts: tuple[float, float, float]
    noise: tuple[float, float] = (0.0, 0.0)


def crowd(
    model: Model, covariance: Floats, spread: Spread, full: float, bend: TwinThrusters | None, count: int,
    rng: np.random.Generator,
) -> Vehicles:  # fmt: skip
    """Draw `count` vehicles about a model whose theta has a `covariance` (p, p); the first is the model's."""
    theta = model.drawn(covariance, count, rng)
    logged, low, high = spread.volts
    volts = np.append(logged, rng.uniform(low, high, count - 1))
    gain = np.exp(spread.scatter * np.append(0.0, rng.standard_normal(count - 1)))
    if model.moment_unit != STEERED and not any("voltage" in effects.get(term.name).needs for term in model.terms):
        gain = gain * (volts / logged) ** THRUST_BY_VOLTAGE
    late = np.append(0.5 * spread.late, rng.uniform(0.0, spread.late, count - 1))
    at = np.append(0.5, rng.uniform(0.2, 1.0, count - 1))
    return Vehicles(model, theta, full, gain, late, volts, at, bend, spread.noise)


class Actuators:
    """The actuators of S vehicles in R flights, advanced in steps of `step` [s]; it remembers what they do."""

    def __init__(self, vehicles: Vehicles, flights: int, step: float) -> None:
        self.vehicles, self.step = vehicles, step
        terms, shape = actuators(vehicles.model.forces(vehicles.theta)), (len(vehicles), flights)
        late = dead_time(vehicles) / step
        self._whole, self._share = late.astype(int), (late - late.astype(int))[:, None]
        self._ring = np.zeros((int(self._whole.max(initial=0)) + 2, *shape))
        self._rows, self._at = np.arange(len(vehicles)), 0
        self._now = [term for term in terms if not isinstance(term.effect, InputDelay | ThrusterLag)]
        self._before = [np.zeros(shape) for _ in self._now]
        self._speed, self._time = np.zeros(shape), np.zeros((1, 1, 1))
        self._lag: tuple[Advance, tuple[Floats, ...]] | None = None
        lag_term = next((term for term in terms if isinstance(term.effect, ThrusterLag)), None)
        if lag_term is not None:
            lag, law, largest, fall = lag_term.values
            values = (np.maximum(lag, MIN_LAG_S), np.sqrt(np.maximum(largest, 1e-12)), fall)
            self._lag = ADVANCES[round(float(law[0, 0]))], values

    def begin(self, output: Floats) -> None:
        moment = self._ideal(output)
        self._ring[:] = moment
        for place, term in enumerate(self._now):
            self._before[place] = moment
            moment = self._at_once(term, moment, moment)
        self._speed = speed_of(moment)

    def deliver(self, output: Floats) -> Floats:
        """Return the mean moment (S, R) over the next step, for the output held over it."""
        ring, at, count = self._ring, self._at, len(self._ring)
        ring[at % count] = self._ideal(output)
        delayed = ring[(at - self._whole) % count, self._rows]
        moment = delayed + self._share * (ring[(at - self._whole - 1) % count, self._rows] - delayed)
        self._at = at + 1
        for place, term in enumerate(self._now):
            before, self._before[place] = self._before[place], moment
            moment = self._at_once(term, moment, before)
        if self._lag is not None:
            advance, values = self._lag
            impulse, self._speed = advance(speed_of(moment), self._speed, np.full((1, 1), self.step), values)
            moment = impulse / self.step
        self._time = self._time + self.step
        return self.vehicles.gain[:, None] * moment

    def slope(self, output: Floats) -> Floats:
        moment = output[:, None] * np.array([[1.0, -1.0]]) * self.vehicles.full
        for term in self._now:
            moment = self._at_once(term, moment, moment)
        return (moment[:, 0] - moment[:, 1]) / (2.0 * output)

    def _ideal(self, output: Floats) -> Floats:
        bend = self.vehicles.bend
        return self.vehicles.full * output if bend is None else bend.moment(output)

    def _at_once(self, term: Bound, moment: Floats, before: Floats) -> Floats:
        length = np.full((1, 1, 1), self.step)
        signals = {name: value[..., None] for name, value in self.vehicles.signals.items()}
        signals["rudder"] = moment[..., None]
        commands = Commands(moment[..., None], self._time, length, before[..., None], np.zeros((1, 1)), signals)
        return term.effect.deliver(commands, term.wide())[..., 0]


def _parameters(vehicles: Vehicles, effect: type[Effect]) -> list[Floats] | None:
    """The parameters (S,) of an effect; None where the model is without it."""
    terms = (term for term in vehicles.model.forces(vehicles.theta) if isinstance(term.effect, effect))
    return next(([value[:, 0] for value in term.values] for term in terms), None)


def dead_time(vehicles: Vehicles) -> Floats:
    """Return the delay of each vehicle's commands [s], (S,): the longer where rises and falls differ."""
    if (parameters := _parameters(vehicles, InputDelay)) is None:
        return vehicles.late
    rise, law, fall = parameters
    return vehicles.late + np.where(law == 1.0, np.maximum(rise, fall), rise)


def lag_of(vehicles: Vehicles) -> Floats:
    """Return the time constant [s] of the thrust of each vehicle for small changes, (S,)."""
    if (parameters := _parameters(vehicles, ThrusterLag)) is None:
        return np.zeros(len(vehicles))
    lag, law, largest, fall = parameters
    slower = np.sqrt(largest / np.maximum(MIN_LAG_MOMENT_SHARE * vehicles.full, 1e-12))
    return cast(Floats, np.select([law == 2.0, law == 4.0], [lag * slower, lag * np.maximum(fall, 1.0)], lag))


def sensor_lag(vehicles: Vehicles) -> Floats:
    """Return the time constant [s] of each vehicle's position sensor, (S,)."""
    parameters = _parameters(vehicles, SensorLag)
    return np.zeros(len(vehicles)) if parameters is None else parameters[0]


def output_slope(vehicles: Vehicles) -> Floats:
    """Return the change of moment per change of output about the output at which each vehicle is looked at, (S,)."""
    bent = 1.0 if vehicles.bend is None else vehicles.bend.slope(vehicles.at) / vehicles.full
    return vehicles.gain * Actuators(vehicles, 2, 1.0).slope(vehicles.at) * bent


class Body:
    """S vehicles in R flights: position, velocity and the water's states, advanced by a midpoint step."""

    def __init__(self, vehicles: Vehicles, flights: int) -> None:
        shape = (1, len(vehicles), flights)
        self.position, self.velocity, self.time = np.zeros(shape), np.zeros(shape), 0.0
        self._slope, states = _slope_of(vehicles)
        self._water = [np.zeros(shape[1:]) for _ in range(states)]
        self._signals = vehicles.signals

    def advance(self, force: Floats, step: float) -> None:
        half = 0.5 * step
        at = self.position, self.velocity, self._water, (force,)
        first, move, stir = self._slope(*at, self.time, self._signals)
        there = self.position + half * move, self.velocity + half * first
        water = [w + half * d for w, d in zip(self._water, stir)]
        second, move, stir = self._slope(*there, water, (force,), self.time + half, self._signals)
        self.position = self.position + step * move
        self.velocity = self.velocity + step * second
        self._water = [w + step * d for w, d in zip(self._water, stir)]
        self.time += step


def _slope_of(vehicles: Vehicles) -> tuple[Slope, int]:
    """The right-hand side of the equation of motion, and how many states the water has."""
    model, theta = vehicles.model, vehicles.theta
    terms = [replace(t, values=(*t.values, *[np.zeros((1, 1))] * t.effect.per_run)) for t in model.forces(theta)]
    movers = [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    states = sum(len(term.effect.states) for term in movers)
    return right_hand_side(model, movers, model.inertia_matrix(theta), None, np.zeros((1, 1, 1))), states


def holding(vehicles: Vehicles) -> Floats:
    """Return the share of the full output that holds each vehicle at rest at its start, (S,)."""
    slope, states = _slope_of(vehicles)
    zero = np.zeros((1, len(vehicles), 1))
    pushed, _, _ = slope(zero, zero, [zero[0]] * states, (zero[0],), 0.0, vehicles.signals)
    needed = -np.broadcast_to(pushed[0], zero[0].shape)[:, 0] * vehicles.theta[:, 0]
    return np.asarray(np.clip(needed / vehicles.full, -1.0, 1.0))


def linear(vehicles: Vehicles, swing: float) -> Floats:
    """Return A (S, n, n) of x' = A x about rest, states position, velocity, water; drag straight over a `swing`."""
    slope, states = _slope_of(vehicles)
    size, count = 2 + states, len(vehicles)

    def derivative(column: int, by: float) -> Floats:
        x = np.zeros((size, count, 1))
        x[column] += by
        moved, move, stir = slope(x[:1], x[1:2], list(x[2:]), (0.0 * x[0],), 0.0, vehicles.signals)
        rows = [move[0], moved[0], *stir]
        return np.stack([np.broadcast_to(row, (count, 1))[:, 0] for row in rows], axis=1)

    return np.stack([(derivative(k, swing) - derivative(k, -swing)) / (2.0 * swing) for k in range(size)], axis=2)


def least_damped(vehicles: Vehicles) -> Floats:
    """Return `linear` with what drives the velocity as over the swing that damps it least."""
    a = linear(vehicles, SLOW_SWING)
    for swing in (REST_SWING, BRISK_SWING):
        row = linear(vehicles, swing)[:, 1]
        a[:, 1] = np.where(row[:, 1:2] > a[:, 1, 1:2], row, a[:, 1])
    return a


def response(vehicles: Vehicles, s: Complexes) -> tuple[Complexes, Complexes]:
    """Return position as the sensor reads it and velocity per output at each s (W,), (S, W) each, with all delays."""
    a, mobility = least_damped(vehicles), 1.0 / vehicles.theta[:, 0]
    late = np.exp(-s * dead_time(vehicles)[:, None]) / (1.0 + s * lag_of(vehicles)[:, None])
    reach: Complexes = output_slope(vehicles)[:, None] * late
    lead = s[None, :, None, None] * np.eye(a.shape[1]) - a[:, None]
    right = np.zeros((*lead.shape[:3], 1), dtype=complex)
    right[:, :, 1, 0] = mobility[:, None]
    position: Complexes = np.linalg.solve(lead, right)[..., 0, 0] * reach
    return position / (1.0 + s * sensor_lag(vehicles)[:, None]), s * position


def poles(vehicles: Vehicles) -> Complexes:
    return np.asarray(np.linalg.eigvals(least_damped(vehicles)).astype(complex))
