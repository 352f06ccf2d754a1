"""Advance every run under every parameter set together: classical Runge-Kutta with a fixed step, blind to
the effects.

In the plane axes are those of SNAME (1950): x ahead and north, y to starboard and east, z down, so that yaw is positive
clockwise seen from above. Source: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, second
edition, chapters 2, 3 and 6.

Order of the axes of what is returned: parameter sets P, runs R, samples N, degrees of freedom D. Inside, the degrees of
freedom come first, so that one alone is a plain array of sets by runs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli.effects import Commands, Place, State
from automarine_cli.models.model import Bound, Model, actuators, turned
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Batch, Channel, steps_of

Slope = Callable[..., tuple[Floats, Floats, Sequence[Floats]]]


@dataclass(frozen=True)
class Start:
    """What differs from run to run and is no property of the vehicle; each broadcasts to (P, R), switch_delay to (P, R,
    E). `position` and `velocity` at the first sample, of several degrees of freedom (D, P, R), or (D, 1, 1) for all
    runs alike: in the plane north, east and heading, and the velocities over ground in the vehicle's axes. `log_gain`
    is that of everything delivered, `switch_delay` [s] of every change of command from the middle of the interval in
    which it happened, `disturbance` (D, P, R, windows), of one degree of freedom (P, R, windows), a moment or force in
    each window of the batch, `own` by name the coefficients (P, R, k) of effects that vary from run to run, `water` the
    states of the water, (W, P, R), in the order of the model's terms, `command_delay` (P, R, 1) [s] that of all
    commands after that middle."""

    position: ArrayLike = 0.0
    velocity: ArrayLike = 0.0
    log_gain: ArrayLike = 0.0
    switch_delay: Floats | None = None
    disturbance: Floats | None = None
    own: Mapping[str, Floats] = field(default_factory=dict)
    water: ArrayLike = 0.0
    command_delay: Floats | None = None

    def of_runs(self, order: NDArray[np.int64]) -> "Start":
        """The same with the runs in another order (R,)."""

        def rows(values: ArrayLike, behind: int = 0) -> Floats:
            array = np.asarray(values)
            return array if array.ndim <= behind or array.shape[-1 - behind] == 1 else array.take(order, -1 - behind)

        moving = {name: rows(getattr(self, name)) for name in ("position", "velocity", "log_gain", "water")}
        stored = {name: getattr(self, name) for name in ("switch_delay", "disturbance", "command_delay")}
        moving |= {name: rows(values, 1) for name, values in stored.items() if values is not None}
        return replace(self, own={name: rows(values, 1) for name, values in self.own.items()}, **moving)

    def bind(self, term: Bound) -> Bound:
        if not term.effect.per_run:
            return term
        coefficients = self.own.get(term.effect.name, np.zeros((1, 1, term.effect.per_run)))
        return replace(term, values=(*term.values, *np.moveaxis(coefficients, 2, 0)))


@dataclass(frozen=True)
class Trajectory:
    """Simulated states at the samples: positions as the sensors show them, true positions and velocities. In the plane
    positions are north, east and heading, velocities those over ground in the vehicle's axes. `places` holds the first
    two at all nodes of the `grid`, the runs in its order, (D, P, R, K M + 1) each; `states` positions, velocities and
    the W states of the water where steps begin and end, (D or W, P, R, M + 1); samples are picked when asked for, each
    from its run's `row` (R,) of these and from its `node` (R, N)."""

    grid: Batch = field(repr=False)
    places: tuple[Floats, Floats] = field(repr=False)
    states: tuple[Floats, Floats, Floats] = field(repr=False)
    node: NDArray[np.int64] = field(repr=False)
    row: NDArray[np.int64] = field(repr=False)

    @cached_property
    def position(self) -> Floats:
        """Of the first degree of freedom as its sensor reads it, (P, R, N)."""
        return self._at_samples(self.places[0][0])

    @cached_property
    def velocity(self) -> Floats:
        """True velocities of the first degree of freedom, (P, R, N)."""
        return self.velocities[..., 0]

    @cached_property
    def positions(self) -> Floats:
        return np.stack([self._at_samples(column) for column in self.places[1]], axis=-1)

    @cached_property
    def velocities(self) -> Floats:
        moving = _between(self.grid, *self.states[:2], slope=True)
        return np.stack([self._at_samples(column) for column in moving], axis=-1)

    @cached_property
    def water(self) -> Floats:
        """States of the water, (P, R, N, W)."""
        none = np.zeros((*self.position.shape, 0))
        stirred = (np.repeat(column, 1 + self.grid.inner.shape[2], axis=2) for column in self.states[2])
        return np.concatenate([none, *(self._at_samples(column)[..., None] for column in stirred)], axis=-1)

    def reading(self, channel: Channel) -> Floats:
        if channel.velocity:
            return self.velocities[..., channel.dof]
        return self.position if channel.dof == 0 else self._at_samples(self.places[0][channel.dof])

    def _at_samples(self, column: Floats) -> Floats:
        return np.asarray(column[:, self.row[:, None], self.node])


def step_for(model: Model, moment: float) -> float:
    """Step [s] at which the error of the integrator stays below a hundredth of a degree under |moment|."""
    return float(np.clip(model.fastest(moment) / 2.0, 1e-3, 0.2))


def simulate(
    model: Model, batch: Batch, theta: Floats | None = None, start: Start | None = None, own: bool = False
) -> Trajectory:
    """Simulate all runs of `batch` under all parameter sets `theta` (P, p), by default the model's own, or, of one
    degree of freedom, each run under its `own` of them (R, p), as one set. Commands are held over each step; the order
    is actuators on the commands, sum of forces with water states, division by inertia, sensors on the positions."""
    theta = np.atleast_2d(model.theta if theta is None else theta)
    theta = theta[batch.longest_first] if own else theta
    node, row, start = batch.node, np.argsort(batch.longest_first), (start or Start()).of_runs(batch.longest_first)
    batch = batch.sorted
    starts = map(np.shape, (start.position, start.velocity, start.log_gain))
    shape = np.broadcast_shapes((len(model.motion.dofs), 1 if own else len(theta), len(batch.names)), *starts)
    forces, inertia = model.forces(theta), model.inertia_matrix(theta)
    if own:
        forces, inertia = [replace(term, values=tuple(v.T for v in term.values)) for term in forces], inertia.T
    terms = [start.bind(term) for term in forces]
    commands = list(batch.commands(start.switch_delay, start.command_delay))
    for term in actuators(terms):
        commanded = commands[term.dof]
        forward = replace(commanded, length=np.maximum(commanded.length, 0.0))  # it only knows time to pass
        commands[term.dof] = replace(commanded, force=term.effect.deliver(forward, term.wide()))
    # a fit may try parameters that no vehicle has; it sees the infinity
    with np.errstate(over="ignore", invalid="ignore"):
        states = _integrate(model, inertia, model.current(theta), terms, batch, commands, start, shape)
        true = _between(batch, *states[:2])
        readings, clock = true, commands[0]
        for term in terms:
            if term.effect.place is Place.SENSOR:
                time = batch.clock(clock.start, clock.length)
                fed: tuple[Floats, ...] = ()
                if term.effect.reads_force:  # what is delivered as each node is reached
                    force, before = commands[term.dof].force, commands[term.dof].before
                    reached = np.repeat(force, 1 + batch.inner.shape[2], axis=2)
                    fed = (np.concatenate([np.broadcast_to(before, (*force.shape[:2], 1)), reached], axis=2),)
                reading = term.effect.read(readings[term.dof], time, (*term.wide(), *fed))
                readings = reading[None] if len(readings) == 1 else np.stack(
                    [reading if d == term.dof else other for d, other in enumerate(readings)]
                )  # fmt: skip
    return Trajectory(batch, (readings, true), states, node, row)


def _integrate(
    model: Model, inertia: Floats, current: Floats | None, terms: Sequence[Bound], batch: Batch,
    commands: Sequence[Commands], start: Start, shape: tuple[int, ...],
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """True positions and velocities at all M + 1 nodes, (D, P, R, M + 1), and the water's states, (W, P, R, M + 1).
    Positions are followed only where something depends on them: numpy's cost a call, not arithmetic, is what a step
    costs. In a current the velocities that are advanced are those through the water."""
    motion, movers = model.motion, [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    followed = motion.turns or any(term.effect.uses_position for term in movers)
    tau = _delivered(batch, commands, start, shape)
    clock = commands[0]
    signals = {**clock.signals, **turned(terms, clock.signals, clock)}
    curves = foreknown(movers, clock.signals)
    lengths, begins = (np.ascontiguousarray(np.moveaxis(x, 2, 0)) for x in (clock.length, clock.start))
    position = np.array(np.broadcast_to(start.position, shape), dtype=float)
    velocity = np.array(np.broadcast_to(start.velocity, shape), dtype=float)
    if current is not None:
        velocity = velocity - in_body_axes(current, position[2])
    count = sum(len(term.effect.states) for term in movers)
    steps, own = len(tau), inertia.shape[2] > len(motion.dofs)
    velocities, travelled = np.empty((steps + 1, *shape)), np.zeros((steps + 1, *shape))
    stirred = np.empty((steps + 1, count, *shape[1:]))
    velocities[0], travelled[0], stirred[0] = velocity, position, start.water
    columns = {name: np.ascontiguousarray(np.moveaxis(column, -1, 0)) for name, column in signals.items()}
    columns |= {name: curve.swapaxes(0, 1) for name, curve in curves.items()}
    logged: Mapping[str, Floats] = {}
    for first, last, on in _stretches(batch.length):
        there, now, water = position[..., :on], velocities[first, ..., :on], list(stirred[first, ..., :on])
        running = [replace(t, values=tuple(v[:, :on] if v.shape[1] > 1 else v for v in t.values)) for t in movers]
        of_these = inertia[..., :on] if own else inertia
        slope = right_hand_side(model, running, of_these, current, travelled[0, ..., :on])
        for m in range(first, last):
            h, begin = lengths[m, :, :on], begins[m, :, :on]
            if columns:
                logged = {name: column[m, ..., :on] for name, column in columns.items()}
            times = begin, begin + 0.5 * h, begin + h
            force = (tuple(tau[m, ..., :on]),) * 3
            way, now, water = rk4(slope, there, now, water, force, times, h, logged, followed)
            there = there + way if followed else there
            travelled[m + 1, ..., :on], velocities[m + 1, ..., :on] = way, now
            if water:
                stirred[m + 1, ..., :on] = water
        position[..., :on] = there
        for nodes in (velocities, stirred):
            nodes[first + 1 : last + 1, ..., on:] = nodes[first, ..., on:]
    np.cumsum(travelled, axis=0, out=travelled)
    if current is not None:
        velocities += np.moveaxis(in_body_axes(current, travelled[:, 2]), 0, 1)
    return np.moveaxis(travelled, 0, 3), np.moveaxis(velocities, 0, 3), np.moveaxis(stirred, 0, 3)


def _between(batch: Batch, position: Floats, velocity: Floats, slope: bool = False) -> Floats:
    """Positions (D, P, R, M + 1) with those at the inner nodes of each step, (D, P, R, K M + 1), on the cubic of
    Hermite; or the `slope` of that."""
    shares, count = batch.inner_by_step, 1 + batch.inner.shape[2]
    if count == 1:
        return velocity if slope else position
    h = np.where(batch.length > 0, batch.length, 1.0).T[:, None, None]
    x, v = np.moveaxis(position, 3, 0), np.moveaxis(velocity, 3, 0)
    spread = np.empty((count * len(h) + 1, *x.shape[1:]))
    spread[::count] = v if slope else x
    way = x[1:] - x[:-1]
    before = h * v[:-1]
    twist = before + h * v[1:] - 2.0 * way
    bend = way - before - twist
    for k, share in enumerate(shares, start=1):
        if slope:
            spread[k::count] = (before + share * (2.0 * bend + 3.0 * share * twist)) / h
        else:
            spread[k::count] = x[:-1] + share * (before + share * (bend + share * twist))
    return np.moveaxis(spread, 0, 3)


SHRINKS = 0.75  # share of the runs that may be left when those that have ended are no longer integrated


def _stretches(length: Floats) -> Iterator[tuple[int, int, int]]:
    """Begin and end of stretches of the steps of `length` (R, M), the longest run first, and how many runs have not
    ended before: padding costs as much as motion."""
    ends, first = steps_of(length), 0
    while first < length.shape[1]:
        on = int((ends > first).sum())
        last = int(ends[:on][::-1][int((1.0 - SHRINKS) * on)]) if on else length.shape[1]
        yield first, last, on
        first = last


def _delivered(batch: Batch, commands: Sequence[Commands], start: Start, shape: tuple[int, ...]) -> Floats:
    """What is held over each step with the run's gain and disturbance, (M, D, P, R)."""
    gain, pushed = np.exp(np.asarray(start.log_gain)), start.disturbance
    if pushed is not None and pushed.ndim == 3:
        pushed = pushed[None]
    delivered = np.empty((batch.length.shape[1], *shape))
    for d, command in enumerate(commands):
        np.multiply(np.moveaxis(command.force, 2, 0), gain, out=delivered[:, d])
        if pushed is not None:
            index = np.broadcast_to(batch.window, (*pushed.shape[1:2], *batch.window.shape))
            delivered[:, d] += np.moveaxis(np.take_along_axis(pushed[d], index, axis=2), 2, 0)
    return delivered


def foreknown(terms: Sequence[Bound], signals: Mapping[str, Floats]) -> dict[str, Floats]:
    """What logged columns (R, M) alone make of effects, whatever the motion, by their names, (P, M, R)."""
    curves = {term.effect.name: term.effect.foreknown(signals, term.values) for term in terms}
    return {name: curve for name, curve in curves.items() if curve is not None}


def right_hand_side(
    model: Model, movers: Sequence[Bound], inertia: Floats, current: Floats | None, origin: Floats, placed: bool = True
) -> Slope:
    """The right-hand side: accelerations and rates of the positions (D, P, R), derivatives of the water's states. In
    the plane of which nobody reads where a vehicle is (not `placed`), places are sums along its own axes."""
    motion = model.motion
    single, turns = len(motion.dofs) == 1, motion.turns
    if single:
        inverse = 1.0 / inertia[:, 0]
    else:
        momentum, accelerated = map(product_with, (inertia, np.asarray(np.linalg.inv(inertia), dtype=np.float64)))
    none = np.zeros(())
    flow = [none] * len(motion.dofs)
    states = [State(none, start, none, none, none, none, {}, flow) for start in origin]

    pushes = [(term.dof, term.effect.moment, term.values) for term in movers]
    # signals that are states of this motion: through the water, whatever a log says
    read = {name for term in movers for name in term.effect.needs}
    stated = [(dof.velocity, d) for d, dof in enumerate(motion.dofs) if dof.velocity in read]
    steered = model.steered and "rudder" in read  # the angle at which it is, when it is there
    first = states[0]

    def slope(  # type: ignore[no-untyped-def]
        position: Floats, velocity: Floats, water: Sequence[Floats], force: Sequence[Floats], time: Floats, signals
    ):
        if steered:
            signals = {**signals, "rudder": force[0]}
        if stated:
            signals = {**signals, **{name: velocity[d] for name, d in stated}}
        if single:  # the same as below, without the loops that one degree of freedom has no need of
            first.position = position[0]
            first.velocity = first.relative = flow[0] = velocity[0]
            first.delivered, first.time, first.signals = force[0], time, signals
        else:
            over_ground = velocity if current is None else velocity + in_body_axes(current, position[2])
            for d, state in enumerate(states):
                state.position, state.velocity = position[d], over_ground[d]
                state.relative = flow[d] = velocity[d]
                state.delivered, state.time, state.signals = force[d], time, signals
        if water:
            remaining = iter(water)
            by_term = [tuple(islice(remaining, len(term.effect.states))) for term in movers]
            for term, stored in zip(movers, by_term):
                if term.effect.place is Place.WATER:
                    state = states[term.dof]
                    state.relative = flow[term.dof] = state.relative - term.effect.water_rate(stored, term.values)
        total = [*force]
        for k, (d, moment, values) in enumerate(pushes):
            if water:
                states[d].stored = by_term[k]
            total[d] = total[d] + moment(states[d], values)
        stirred: list[Floats] = []
        if water:
            for term, stored in zip(movers, by_term):
                stirred.extend(term.effect.derivatives(states[term.dof], stored, term.values) if stored else ())
        if single:
            return (total[0] * inverse)[None], velocity, stirred
        if not turns:
            return np.array(accelerated(total)), velocity, stirred
        turning = turning_of(momentum(velocity), velocity)
        moved = in_earth_axes(over_ground, position[2]) if placed else over_ground
        return np.array(accelerated([a - b for a, b in zip(total, turning)])), moved, stirred

    return slope


def rk4(
    slope: Slope, position: Floats, velocity: Floats, water: Sequence[Floats],
    force: Sequence[Floats | Sequence[Floats]], time: Sequence[Floats], h: Floats, signals: Mapping[str, Floats],
    followed: bool = True,
) -> tuple[Floats, Floats, list[Floats]]:  # fmt: skip
    """Give the way of a step of `h` [s] by Runge and Kutta's method, and the velocity (both D, P, R) and the states of
    the water at its end. `force` and `time` are those at its begin, middle and end; a position on which nothing depends
    need not be `followed`."""
    half, sixth = 0.5 * h, h / 6.0

    def stage(step: Floats, moved: Floats, rise: Floats, stirring: Sequence[Floats], at: int):  # type: ignore[no-untyped-def]
        there = position + step * moved if followed else position
        stirred = [state + step * rate for state, rate in zip(water, stirring)]
        return slope(there, velocity + step * rise, stirred, force[at], time[at], signals)

    rise1, move1, water1 = slope(position, velocity, water, force[0], time[0], signals)
    rise2, move2, water2 = stage(half, move1, rise1, water1, 1)
    rise3, move3, water3 = stage(half, move2, rise2, water2, 1)
    rise4, move4, water4 = stage(h, move3, rise3, water3, 2)
    way = sixth * (move1 + 2.0 * (move2 + move3) + move4)
    reached = velocity + sixth * (rise1 + 2.0 * (rise2 + rise3) + rise4)
    rates = zip(water, water1, water2, water3, water4)
    return way, reached, [w + sixth * (a + 2.0 * (b + c) + d) for w, a, b, c, d in rates]


def product_with(matrices: Floats) -> Callable[[Sequence[Floats] | Floats], list[Floats]]:
    """What multiplies vectors (D, P, R) by matrices (P, D, D). Entries that are zero in every set cost nothing: most
    hulls couple few motions, and numpy's own products of so small matrices are several times slower."""
    dofs = range(matrices.shape[1])
    rows = [
        [(j, np.ascontiguousarray(matrices[:, i, j, None])) for j in dofs if i == j or matrices[:, i, j].any()]
        for i in dofs
    ]

    def product(vectors: Sequence[Floats] | Floats) -> list[Floats]:
        return [reduce(np.add, [entry * vectors[j] for j, entry in row]) for row in rows]

    return product


def turning_of(momentum: Sequence[Floats], velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Coriolis and centripetal force C(nu) nu [N, N, N m], each (P, R), of velocities (3, P, R) with momentum p = M nu.
    It is (-p_y r, p_x r, p_y u - p_x v): the axes turn with the vehicle (Fossen 2021, chapter 3 for the rigid body,
    chapter 6 for added mass). It does no work. The last entry holds (m_v - m_u) u v, the moment that keeps a vehicle on
    an oblique course: the water's own, the Munk moment, is its opposite and turns it broadside."""
    along, abeam, _ = momentum
    u, v, r = velocity
    return -abeam * r, along * r, abeam * u - along * v


def in_earth_axes(velocity: Floats, heading: Floats) -> Floats:
    """Rates of north, east [m/s] and heading [rad/s] of velocities in the vehicle's axes, both (3, P, R)."""
    u, v, r = velocity
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array([cosine * u - sine * v, sine * u + cosine * v, r])


def in_body_axes(current: Floats, heading: Floats) -> Floats:
    """A current (2, P, 1) [m/s] in the vehicle's axes at `heading` (..., P, R), as velocities (3, ..., P, R)."""
    north, east = current
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([cosine * north + sine * east, cosine * east - sine * north, np.zeros_like(heading)])
