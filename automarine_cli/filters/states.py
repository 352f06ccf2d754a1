"""What the filter's state holds, and how it moves over one step: places of the states, the step, the readings."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.effects import Place
from automarine_cli.filters.course import Course
from automarine_cli.models.vehicle import Bound, Vehicle, actuators
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel
from automarine_cli.simulation.plane import in_body_axes
from automarine_cli.simulation.rollout import right_hand_side

SMALL = 1e-3
"""Least difference [rad, m, per s] by which a state is moved to see what depends on it."""
SHARE = 0.02
"""Difference of the log gain, likewise."""


@dataclass(frozen=True)
class States:
    """Places of the n states of a run. The first `dynamic` of them are advanced by the equation of motion: positions,
    velocities, states of the water, and what slow sensors show (`memory`, each with the position `remembered`). Then
    come the disturbing accelerations `pushed`, the log `gain`, what effects let vary (`own`), and each velocity
    channel's `bias`, with its degree of freedom, where its position is read too."""

    position: tuple[int, ...]
    velocity: tuple[int, ...]
    water: tuple[int, ...]
    memory: tuple[int, ...]
    remembered: Mapping[int, int]
    dynamic: int
    pushed: tuple[int, ...]
    gain: int
    own: Mapping[str, tuple[int, ...]]
    bias: Mapping[str, tuple[int, int]]
    count: int


def _places(dofs: int, terms: list[Bound], course: Course) -> States:
    movers = [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    slow = [term for term in terms if term.effect.place is Place.SENSOR and term.effect.remembers]
    water = sum(len(term.effect.states) for term in movers)
    first = 2 * dofs
    memory = tuple(range(first + water, first + water + len(slow)))
    dynamic = first + water + len(slow)
    gain = dynamic + dofs
    own, at = {}, gain + 1
    for term in terms:
        if term.effect.varies(tuple(float(value.flat[0]) for value in term.values)):
            own[term.effect.name] = tuple(range(at, at + term.effect.per_run))
            at += term.effect.per_run
    bias, read = {}, {channel.quantity for channel in course.channels}
    for channel in course.channels:
        if channel.velocity and course.motion.positions[channel.dof] in read:  # else nothing tells it from the velocity
            bias[channel.quantity] = (at, channel.dof)
            at += 1
    return States(
        position=tuple(range(dofs)),
        velocity=tuple(range(dofs, first)),
        water=tuple(range(first, first + water)),
        memory=memory,
        remembered={place: term.dof for place, term in zip(memory, slow)},
        dynamic=dynamic,
        pushed=tuple(range(dynamic, gain)),
        gain=gain,
        own=own,
        bias=bias,
        count=at,
    )


class Step:
    """One model on one course for P parameter sets: commands delivered, steps, readings.

    `delivered` (D, P, R, K) is what the actuators give without the runs' gain, the mean over each step, and `tilt` how
    it rises over the step [per s]; `inverse` (P, D, D) is that of the inertia, `columns` are the states on which the
    dynamic ones depend nonlinearly, or that push them.
    """

    def __init__(self, model: Vehicle, course: Course, theta: Floats, late: Floats) -> None:
        self.course, self.sets, self.runs = course, len(theta), len(course.names)
        dofs, terms = len(model.motion.dofs), list(model.forces(theta))
        self.places = _places(dofs, terms, course)
        self.origin = _first_readings(course)
        self.sensors = [t for t in terms if t.effect.place is Place.SENSOR and not t.effect.remembers]
        self.clock, self.signals = course.time, course.averaged_signals
        self.inverse = np.linalg.inv(model.inertia_matrix(theta))
        self.delivered, self.tilt = _delivered(terms, course, late)
        self.water_moves = model.current(theta)
        places = self.places
        placed = bool(self.places.memory) or any(t.effect.steered for t in terms)
        turning = places.position[-1:] if model.motion.turns else ()
        own = [place for group in places.own.values() for place in group]
        self.columns = np.array([
            *(places.position if placed else turning), *places.velocity, *places.water, *places.memory,
            *places.pushed, places.gain, *own,
        ])  # fmt: skip
        self._pushed = np.array(places.pushed)
        self._model, self._theta = model, theta
        count = len(self.columns)
        self._ahead, self._behind = 1 + np.arange(count), 1 + count + np.arange(count)
        self._least = np.array([SHARE if c == places.gain else SMALL for c in self.columns])[:, None, None] ** 2
        self._build(model, theta, 1 + 2 * count, self.origin)

    def _bound(self, term: Bound) -> Bound:
        """A term with the coefficients that each run has of its own; these arrays are filled anew in every step."""
        if term.effect.name not in self._own:
            return replace(term, values=(*term.values, *[np.zeros((1, 1))] * term.effect.per_run))
        return replace(term, values=(*term.values, *self._own[term.effect.name]))

    def of_pieces(self, cut: Course, begin: Floats, run: NDArray[np.int64], at: NDArray[np.int64]) -> "Step":
        """The same for A pieces of the runs as runs of their own: `cut` has their names and lengths, `begin` (A,) [s]
        is when they begin in their `run` (A,), and `at` (A, K) are the steps that they are made of."""
        own = copy(self)
        own.course, own.runs = cut, len(run)
        own.delivered, own.tilt = (x[:, :, run[:, None], at] for x in (self.delivered, self.tilt))
        own.clock = begin[:, None] + np.concatenate([0.0 * begin[:, None], np.cumsum(cut.length, axis=1)], axis=1)
        own.signals = {name: column[run[:, None], at] for name, column in self.signals.items()}
        own._build(self._model, self._theta, 1, self.origin[:, run])
        return own

    def _build(self, model: Vehicle, theta: Floats, copies: int, origin: Floats) -> None:
        """The right-hand side for so many copies of every run."""
        wide = np.tile(theta, (copies, 1))
        self._copies = copies
        self._own = {name: np.zeros((len(group), len(wide), self.runs)) for name, group in self.places.own.items()}
        terms = model.forces(wide)
        movers = [self._bound(term) for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
        self._slow = [t for t in terms if t.effect.place is Place.SENSOR and t.effect.remembers]
        inertia, current = model.inertia_matrix(wide), model.current(wide)
        self._slope = right_hand_side(model.motion, movers, inertia, current, origin[:, None])

    def moved(self, m: int, mean: Floats, ramp: Floats) -> Floats:
        """The state (n, P, R) at the end of step m, without derivatives, if it was built for one copy."""
        every = mean.copy()
        every[self._pushed] *= ramp
        after = mean.copy()
        after[: self.places.dynamic] = self._moved(m, every[:, None])
        return after

    def advance(self, m: int, mean: Floats, covariance: Floats, ramp: Floats) -> tuple[Floats, Floats]:
        """The state at the end of step m, (n, P, R), and the derivatives (dynamic, columns, P, R) of its dynamic part
        by the states of `columns`; `ramp` (D, P, R) is the mean of a disturbance over the step as a share of what it
        begins with, and those by disturbances are by such a mean."""
        places, columns, count = self.places, self.columns, len(self.columns)
        every = np.repeat(mean[:, None], self._copies, axis=1)
        every[self._pushed] *= ramp[:, None]
        sizes = np.sqrt(np.maximum(covariance[..., columns, columns].transpose(2, 0, 1), self._least))
        every[columns, self._ahead] += sizes
        every[columns, self._behind] -= sizes
        moved = self._moved(m, every).reshape(places.dynamic, self._copies, self.sets, self.runs)
        after = mean.copy()
        after[: places.dynamic] = moved[:, 0]
        return after, (moved[:, 1 : 1 + count] - moved[:, 1 + count :]) / (2.0 * sizes)

    def _moved(self, m: int, every: Floats) -> Floats:
        """The dynamic states of all copies after step m, (dynamic, copies P, R), by Runge and Kutta's method."""
        places, dofs = self.places, len(self.places.position)
        flat = every.reshape(len(every), self._copies * self.sets, self.runs)
        for name, group in places.own.items():
            np.copyto(self._own[name], flat[list(group)])
        h = self.course.length[:, m]
        begin, end = self.clock[:, m], self.clock[:, m + 1]
        half = 0.5 * (begin + end)
        signals = {name: column[:, m] for name, column in self.signals.items()}
        gain = np.exp(every[places.gain])
        force = [(one[:, :, m] * gain).reshape(flat.shape[1:]) for one in self.delivered]
        rise = [(0.5 * h * one[:, :, m] * gain).reshape(flat.shape[1:]) for one in self.tilt]
        first = tuple(middle - half for middle, half in zip(force, rise))
        last = tuple(middle + half for middle, half in zip(force, rise))
        pushed = flat[self._pushed]
        x, v, w = flat[:dofs], flat[dofs : 2 * dofs], [flat[place] for place in places.water]

        def slope(x, v, w, force, time):  # type: ignore[no-untyped-def]
            swing, move, stirred = self._slope(x, v, w, force, time, signals)
            return swing + pushed, move, stirred

        def ahead(w, step, slopes):  # type: ignore[no-untyped-def]
            return [a + step * b for a, b in zip(w, slopes)]

        a1, m1, w1 = slope(x, v, w, first, begin)
        a2, m2, w2 = slope(x + 0.5 * h * m1, v + 0.5 * h * a1, ahead(w, 0.5 * h, w1), force, half)
        a3, m3, w3 = slope(x + 0.5 * h * m2, v + 0.5 * h * a2, ahead(w, 0.5 * h, w2), force, half)
        a4, m4, w4 = slope(x + h * m3, v + h * a3, ahead(w, h, w3), last, end)
        out = np.empty((places.dynamic, *flat.shape[1:]))
        out[:dofs] = x + h / 6.0 * (m1 + 2.0 * (m2 + m3) + m4)
        out[dofs : 2 * dofs] = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        for place, old, s1, s2, s3, s4 in zip(places.water, w, w1, w2, w3, w4):
            out[place] = old + h / 6.0 * (s1 + 2.0 * (s2 + s3) + s4)
        for place, term in zip(places.memory, self._slow):
            of = places.remembered[place]
            out[place] = term.effect.remember(flat[place], x[of], out[of], h, term.values)
        return out

    def _delivered_at(self, dof: int, m: int) -> Floats:
        """What the actuators give as node m is reached, (P, R, 1)."""
        step, half = max(m - 1, 0), 0.5 if m else -0.5
        rise = half * self.course.length[:, step] * self.tilt[dof, :, :, step]
        return np.asarray((self.delivered[dof, :, :, step] + rise)[..., None])

    def reading(
        self, channel: Channel, m: int, mean: Floats, covariance: Floats
    ) -> tuple[Floats, list[tuple[int, Floats]]]:
        """What a channel shows at node m, (P, R), and its derivatives by the states that it depends on."""
        places, one = self.places, np.ones(mean.shape[1:])
        if channel.velocity:
            at = [places.velocity[channel.dof], *places.bias.get(channel.quantity, ())[:1]]
            shown = sum(mean[place] for place in at)
            if self.water_moves is not None:
                shown = shown + in_body_axes(self.water_moves, mean[places.position[-1]])[channel.dof]
            return shown, [(place, one) for place in at]
        place = next((k for k, of in places.remembered.items() if of == channel.dof), channel.dof)
        own = [term for term in self.sensors if term.dof == channel.dof]
        if not own:
            return mean[place], [(place, one)]
        size = np.sqrt(np.maximum(covariance[..., place, place], SMALL**2))
        tried = mean[place] + np.stack([0.0 * size, size, -size])
        time = self.clock[:, m, None]
        for term in own:
            values = (*term.wide(), *((self._delivered_at(channel.dof, m),) if term.effect.fed else ()))
            tried = np.stack([term.effect.read(x[..., None], time, values)[..., 0] for x in tried])
        return tried[0], [(place, (tried[1] - tried[2]) / (2.0 * size))]


def _first_readings(course: Course) -> Floats:
    """The first reading of each position, (D, R); zero where it is not logged."""
    first = np.zeros((len(course.motion.dofs), len(course.names)))
    for channel in course.channels:
        if not channel.velocity:
            at = channel.seen.argmax(axis=1)
            first[channel.dof] = channel.values[np.arange(len(at)), at]
    return first


def _delivered(terms: list[Bound], course: Course, late: Floats) -> tuple[Floats, Floats]:
    """What the actuators deliver over the filter's steps, `late` (P,) fine steps after the log has it: means and
    slopes, (D, P, R, K)."""
    commands = list(course.commands)
    for term in actuators(terms):
        here = commands[term.dof]
        commands[term.dof] = replace(here, force=term.effect.deliver(here, term.wide()))
    lines = [course.averaged(one.force, late) for one in commands]
    return np.stack([mean for mean, _ in lines]), np.stack([slope for _, slope in lines])
