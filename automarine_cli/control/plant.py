"""How a vehicle answers its moment: step by step, and in frequency about rest."""

from dataclasses import replace

import numpy as np

from automarine_cli import effects
from automarine_cli.control.actuators import dead_time, lag_of, output_slope
from automarine_cli.control.members import Vehicles
from automarine_cli.effects import Place
from automarine_cli.effects.sensor_lag import SensorLag
from automarine_cli.quantities import Complexes, Floats
from automarine_cli.simulation.rollout import Slope, right_hand_side

REST, SLOW, BRISK = 1e-6, 0.02, 0.3
"""Velocities [base unit/s] over whose swing drag is taken as straight: the least damping of all counts, which of
quadratic drag is that at rest, of dry friction that of a brisk turn. Water that moves is looked at over a slow one."""


class Body:
    """S vehicles in R flights: position, velocity and the water's states, advanced by a midpoint step."""

    def __init__(self, vehicles: Vehicles, flights: int) -> None:
        shape = (1, len(vehicles), flights)
        self.position, self.velocity, self.time = np.zeros(shape), np.zeros(shape), 0.0
        self._slope, states = slope_of(vehicles)
        self._water = [np.zeros(shape[1:]) for _ in range(states)]
        self._signals = {"voltage": vehicles.volts[:, None]}

    def advance(self, force: Floats, step: float) -> None:
        """One step of `step` [s] under a moment (S, R)."""
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


def slope_of(vehicles: Vehicles) -> tuple[Slope, int]:
    """The right-hand side of the equation of motion, and how many states the water has."""
    model, theta = vehicles.model, vehicles.theta
    terms = [
        replace(term, values=(*term.values, *[np.zeros((1, 1))] * term.effect.per_run)) for term in model.forces(theta)
    ]
    movers = [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    states = sum(len(term.effect.states) for term in movers)
    return right_hand_side(model.motion, movers, model.inertia_matrix(theta), None, np.zeros((1, 1, 1))), states


def holding(vehicles: Vehicles) -> Floats:
    """The share of the full output that holds each vehicle at rest at its start, (S,)."""
    slope, states = slope_of(vehicles)
    zero = np.zeros((1, len(vehicles), 1))
    water = [zero[0]] * states
    pushed, _, _ = slope(zero, zero, water, (zero[0],), 0.0, {"voltage": vehicles.volts[:, None]})
    needed = -np.broadcast_to(pushed[0], zero[0].shape)[:, 0] * vehicles.theta[:, 0]
    return np.asarray(np.clip(needed / vehicles.full, -1.0, 1.0))


def linear(vehicles: Vehicles, swing: float) -> tuple[Floats, Floats]:
    """A (S, n, n) and b (S, n) of x' = A x + b moment about rest, states position, velocity, water; drag straight over
    a `swing` of velocity."""
    slope, states = slope_of(vehicles)
    size, count = 2 + states, len(vehicles)
    signals = {"voltage": vehicles.volts[:, None]}

    def derivative(column: int, by: float) -> Floats:
        x = np.zeros((size, count, 1))
        x[column] += by
        moved, move, stir = slope(x[:1], x[1:2], list(x[2:]), (0.0 * x[0],), 0.0, signals)
        rows = [move[0], moved[0], *stir]
        return np.stack([np.broadcast_to(row, (count, 1))[:, 0] for row in rows], axis=1)

    steps = [swing] * size
    columns = [(derivative(k, by) - derivative(k, -by)) / (2.0 * by) for k, by in enumerate(steps)]
    b = np.zeros((count, size))
    b[:, 1] = 1.0 / vehicles.theta[:, 0]
    return np.stack(columns, axis=2), b


def least_damped(vehicles: Vehicles) -> tuple[Floats, Floats]:
    """`linear` with what drives the velocity as over the swing that damps it least."""
    a, b = linear(vehicles, SLOW)
    for swing in (REST, BRISK):
        row = linear(vehicles, swing)[0][:, 1]
        a[:, 1] = np.where(row[:, 1:2] > a[:, 1, 1:2], row, a[:, 1])
    return a, b


def response(vehicles: Vehicles, s: Complexes) -> tuple[Complexes, Complexes]:
    """Position as the sensor reads it and velocity per output at each s (W,), (S, W) each, delay and lag included."""
    a, b = least_damped(vehicles)
    late = np.exp(-s * dead_time(vehicles)[:, None]) / (1.0 + s * lag_of(vehicles)[:, None])
    reach: Complexes = output_slope(vehicles)[:, None] * late
    position: Complexes
    if a.shape[1] == 2:
        position = b[:, 1:] / (s * s - a[:, 1, 1:] * s - a[:, 1, :1])
    else:
        eye = np.eye(a.shape[1])
        lead = s[None, :, None, None] * eye - a[:, None]
        right = np.broadcast_to(b[:, None, :, None].astype(complex), (*lead.shape[:3], 1))
        position = np.linalg.solve(lead, right)[..., 0, 0]
    position = position * reach
    return position / (1.0 + s * sensor_lag(vehicles)[:, None]), s * position


def sensor_lag(vehicles: Vehicles) -> Floats:
    """Time constant [s] of each vehicle's position sensor, (S,)."""
    for term in vehicles.model.forces(vehicles.theta):
        if isinstance(term.effect, SensorLag):
            return term.values[0][:, 0]
    return np.zeros(len(vehicles))


def poles(vehicles: Vehicles) -> Complexes:
    """Roots of the equation of motion about rest, (S, n)."""
    return np.asarray(np.linalg.eigvals(least_damped(vehicles)[0]).astype(complex))


def left_out(vehicles: Vehicles) -> tuple[str, ...]:
    """Sensor effects of the model that no loop here has."""
    names = [term.name for term in vehicles.model.terms]
    return tuple(n for n in names if effects.get(n).place is Place.SENSOR and n != SensorLag.name)
