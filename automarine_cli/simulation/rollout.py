"""Advance every run under every parameter set together: classical Runge-Kutta with a fixed step, blind to
the effects.

Order of the axes of what is returned: parameter sets P, runs R, samples N, degrees of freedom D. Inside, the degrees of
freedom come first, so that one alone is a plain array of sets by runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli.dofs.motion import Motion
from automarine_cli.effects import Commands, Place, State
from automarine_cli.models.vehicle import Bound, Vehicle
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.simulation.batch import Batch, Channel

Floats = NDArray[np.float64]
Slope = Callable[..., tuple[Floats, Floats, Sequence[Floats]]]


@dataclass(frozen=True)
class Start:
    """What differs from run to run and is no property of the vehicle; each broadcasts to (P, R), switch_delay to
    (P, R, E).

    `position` and `velocity` at the first sample, of several degrees of freedom (D, P, R); `log_gain` of what is
    delivered, `switch_delay` [s] of every change of command from the middle of the interval in which it happened,
    `disturbance` (P, R, windows) a moment or force on the first degree of freedom in each window of the batch, `own` by
    name the coefficients (P, R, k) of effects that vary from run to run.
    """

    position: ArrayLike = 0.0
    velocity: ArrayLike = 0.0
    log_gain: ArrayLike = 0.0
    switch_delay: Floats | None = None
    disturbance: Floats | None = None
    own: Mapping[str, Floats] = field(default_factory=dict)

    def bind(self, term: Bound) -> Bound:
        """A term with each run's own coefficients after its values."""
        if not term.effect.per_run:
            return term
        own = self.own.get(term.effect.name, np.zeros((1, 1, term.effect.per_run)))
        return replace(term, values=(*term.values, *np.moveaxis(own, 2, 0)))


@dataclass(frozen=True)
class Trajectory:
    """Simulated states at the samples: `read` positions as the sensors show them, true positions and velocities.

    `nodes` holds the three at all nodes of the simulation grid, (D, P, R, M + 1) each; samples are picked when asked
    for.
    """

    nodes: tuple[Floats, Floats, Floats] = field(repr=False)
    node: NDArray[np.int64] = field(repr=False)

    @cached_property
    def position(self) -> Floats:
        """Positions of the first degree of freedom as its sensor reads them, (P, R, N)."""
        return self._at_samples(self.nodes[0][0])

    @cached_property
    def velocity(self) -> Floats:
        """True velocities of the first degree of freedom, (P, R, N)."""
        return self._at_samples(self.nodes[2][0])

    @cached_property
    def positions(self) -> Floats:
        """True positions, (P, R, N, D)."""
        return np.stack([self._at_samples(one) for one in self.nodes[1]], axis=-1)

    @cached_property
    def velocities(self) -> Floats:
        """True velocities, (P, R, N, D)."""
        return np.stack([self._at_samples(one) for one in self.nodes[2]], axis=-1)

    def reading(self, channel: Channel) -> Floats:
        """What a channel's sensor reads, (P, R, N)."""
        if channel.dof == 0:
            return self.velocity if channel.velocity else self.position
        return self._at_samples(self.nodes[2 if channel.velocity else 0][channel.dof])

    def _at_samples(self, column: Floats) -> Floats:
        return np.asarray(column[:, np.arange(len(self.node))[:, None], self.node])


def step_for(model: YawModel, moment: float) -> float:
    """Step [s] at which the error of the integrator stays below a hundredth of a degree under |moment|."""
    return float(np.clip(model.fastest(moment) / 2.0, 1e-3, 0.2))


def simulate(
    model: Vehicle, batch: Batch, theta: Floats | None = None, start: Start | None = None
) -> Trajectory:
    """Simulate all runs of `batch` under all parameter sets `theta` (P, p), by default the model's own.

    Commands are held over each step; the order is actuators on the commands, sum of forces with water states, division
    by inertia, sensors on the positions.
    """
    theta = np.atleast_2d(model.theta if theta is None else theta)
    start = start or Start()
    shape = np.broadcast_shapes(
        (len(model.motion.dofs), len(theta), len(batch.names)),
        np.shape(start.position),
        np.shape(start.log_gain),
    )
    terms = [start.bind(term) for term in model.forces(theta)]
    commands = list(batch.commands(start.switch_delay))
    for term in terms:
        if term.effect.place is Place.ACTUATOR:
            commands[term.dof] = _actuated(commands[term.dof], term)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # a fit may try parameters that no vehicle has; it sees the infinity
        true, velocities = _integrate(model, theta, terms, batch, commands, start, shape)
        clock = commands[0]
        time = np.concatenate([np.zeros_like(clock.start[..., :1]), clock.start + clock.length], axis=2)
        read = true
        for term in terms:
            if term.effect.place is Place.SENSOR:
                shown = term.effect.read(read[term.dof], time, term.wide())
                read = shown[None] if len(read) == 1 else np.stack(
                    [shown if d == term.dof else one for d, one in enumerate(read)]
                )  # fmt: skip
    return Trajectory((read, true, velocities), batch.node)


def _actuated(commands: Commands, term: Bound) -> Commands:
    """The commands as an actuator effect delivers them."""
    forward = replace(commands, length=np.maximum(commands.length, 0.0))  # it only knows time to pass
    return replace(commands, force=term.effect.deliver(forward, term.wide()))


def _integrate(
    model: Vehicle,
    theta: Floats,
    terms: Sequence[Bound],
    batch: Batch,
    commands: Sequence[Commands],
    start: Start,
    shape: tuple[int, ...],
) -> tuple[Floats, Floats]:
    """True positions and velocities at all M + 1 nodes, (D, P, R, M + 1).

    Velocities and the states of the water are advanced step by step; positions only where something depends on them,
    else their increments are summed at the end: numpy's cost a call, not arithmetic, is what a step costs. In a
    current the velocities that are advanced are those through the water.
    """
    movers = [term for term in terms if term.effect.place in (Place.MOMENT, Place.WATER)]
    followed = model.motion.turns or any(term.effect.steered for term in movers)
    tau = _delivered(batch, commands, start, shape)
    clock, signals = commands[0], commands[0].signals
    lengths, begins = (np.ascontiguousarray(np.moveaxis(x, 2, 0)) for x in (clock.length, clock.start))
    half, sixth, middle = 0.5 * lengths, lengths / 6.0, begins + 0.5 * lengths
    position = np.array(np.broadcast_to(start.position, shape), dtype=float)
    velocity = np.array(np.broadcast_to(start.velocity, shape), dtype=float)
    current = model.current(theta)
    if current is not None:
        velocity = velocity - in_body_axes(current, position[2])
    water = [np.zeros(shape[1:]) for term in movers for _ in term.effect.states]
    slope = _slope(model.motion, movers, model.inertia_matrix(theta), current, position)
    steps = len(tau)
    velocities, travelled = np.empty((steps + 1, *shape)), np.empty((steps + 1, *shape))
    velocities[0], travelled[0] = velocity, position
    held: Mapping[str, Floats] = {}
    for m in range(steps):
        h, h2, h6, force = lengths[m], half[m], sixth[m], tau[m]
        if signals:
            held = {name: column[:, m] for name, column in signals.items()}
        first, move1, water1 = slope(position, velocity, water, force, begins[m], held)
        there = position + h2 * move1 if followed else position
        velocity2 = velocity + h2 * first
        second, move2, water2 = slope(there, velocity2, _ahead(water, h2, water1), force, middle[m], held)
        there = position + h2 * move2 if followed else position
        velocity3 = velocity + h2 * second
        third, move3, water3 = slope(there, velocity3, _ahead(water, h2, water2), force, middle[m], held)
        there = position + h * move3 if followed else position
        velocity4 = velocity + h * third
        fourth, move4, water4 = slope(there, velocity4, _ahead(water, h, water3), force, begins[m] + h, held)
        twice = second + third
        if move1 is velocity:
            # The position's own Runge-Kutta step: the mean velocity of the four stages, written with their slopes.
            np.add(velocity, h6 * (first + twice), out=travelled[m + 1])
            if followed:
                position = position + h * travelled[m + 1]
        else:
            position = position + h6 * (move1 + 2.0 * (move2 + move3) + move4)
            travelled[m + 1] = position
        velocity = np.add(velocity, h6 * (first + 2.0 * twice + fourth), out=velocities[m + 1])
        water = [
            w + h6 * (a + 2.0 * (b + c) + d) for w, a, b, c, d in zip(water, water1, water2, water3, water4)
        ]
    if not model.motion.turns:
        travelled[1:] *= lengths[:, None]
        np.cumsum(travelled, axis=0, out=travelled)
    elif current is not None:
        velocities += np.stack([in_body_axes(current, one[2]) for one in travelled])
    return np.moveaxis(travelled, 0, 3), np.moveaxis(velocities, 0, 3)


def _delivered(batch: Batch, commands: Sequence[Commands], start: Start, shape: tuple[int, ...]) -> Floats:
    """What is held over each step with the run's gain and disturbance, (M, D, P, R)."""
    gain, rows = np.exp(np.asarray(start.log_gain))[..., None], []
    for d, one in enumerate(commands):
        force = one.force * gain
        if d == 0 and start.disturbance is not None:
            index = np.broadcast_to(batch.window[None], (len(start.disturbance), *batch.window.shape))
            force = force + np.take_along_axis(start.disturbance, index, axis=2)
        rows.append(np.broadcast_to(force, (*shape[1:], force.shape[2])))
    together = rows[0][None] if len(rows) == 1 else np.stack(rows)
    return np.ascontiguousarray(np.moveaxis(together, 3, 0))


def _slope(
    motion: Motion, movers: Sequence[Bound], inertia: Floats, current: Floats | None, origin: Floats
) -> Slope:
    """The right-hand side: accelerations and rates of the positions (D, P, R), derivatives of the water's states."""
    single = not motion.turns
    inverse = 1.0 / inertia[:, 0, :1] if single else np.linalg.inv(inertia)
    count, none = len(motion.dofs), np.zeros(())
    states = [State(none, origin[d], none, none, none, none, {}) for d in range(count)]

    def slope(  # type: ignore[no-untyped-def]
        position: Floats, velocity: Floats, water: Sequence[Floats], force: Floats, time: Floats, signals
    ):
        for d, state in enumerate(states):
            state.position, state.velocity, state.relative = position[d], velocity[d], velocity[d]
            state.delivered, state.time, state.signals = force[d], time, signals
        if water:
            left = iter(water)
            own = [tuple(islice(left, len(term.effect.states))) for term in movers]
            for term, stored in zip(movers, own):
                if term.effect.place is Place.WATER:
                    states[term.dof].relative = states[term.dof].relative - term.effect.water_rate(
                        stored, term.values
                    )
        total = list(force)
        for term in movers:
            total[term.dof] = total[term.dof] + term.effect.moment(states[term.dof], term.values)
        flow: list[Floats] = []
        if water:
            for term, stored in zip(movers, own):
                flow.extend(term.effect.derivatives(states[term.dof], stored, term.values) if stored else ())
        if single:
            return (total[0] * inverse)[None], velocity, flow
        turning = np.stack(total) - coriolis(inertia, velocity)
        moved = over_ground(velocity, position[2], current)
        return np.einsum("pij,jpr->ipr", inverse, turning), moved, flow

    return slope


def coriolis(inertia: Floats, velocity: Floats) -> Floats:
    """Coriolis and centripetal force C(nu) nu of surge, sway and yaw (3, P, R), of rigid and added inertia (P, 3, 3).

    With momentum p = M nu it is (-p_y r, p_x r, p_y u - p_x v): the axes turn with the vehicle (Fossen 2021, equation
    3.64 and chapter 6.3 for the added part), and does no work.
    """
    along, abeam, _ = np.einsum("pij,jpr->ipr", inertia, velocity)
    u, v, r = velocity
    return np.stack([-abeam * r, along * r, abeam * u - along * v])


def over_ground(velocity: Floats, heading: Floats, current: Floats | None) -> Floats:
    """Rates of north, east and heading (3, P, R) for velocities through the water in the vehicle's axes."""
    u, v, r = velocity
    north, east = np.cos(heading) * u - np.sin(heading) * v, np.sin(heading) * u + np.cos(heading) * v
    if current is not None:
        north, east = north + current[0], east + current[1]
    return np.stack([north, east, r])


def in_body_axes(current: Floats, heading: Floats) -> Floats:
    """A current (2, P, 1) north and east in axes at `heading` (P, R): its part of the velocities (3, P, R)."""
    north, east = current
    u, v = north * np.cos(heading) + east * np.sin(heading), east * np.cos(heading) - north * np.sin(heading)
    return np.stack([u, v, np.zeros_like(u)])


def _ahead(states: Sequence[Floats], step: Floats, slopes: Sequence[Floats]) -> list[Floats]:
    return [state + step * slope for state, slope in zip(states, slopes)]
