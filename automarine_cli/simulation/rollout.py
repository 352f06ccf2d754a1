"""Advance every run under every parameter set together: classical Runge-Kutta with a fixed step, blind to
the effects.

Order of the axes everywhere: parameter sets P, runs R, samples N (or steps M).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli.effects import Commands, Effect, Motion, Place
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.simulation.batch import Batch

Floats = NDArray[np.float64]
Bound = tuple[Effect, tuple[Floats, ...]]
"""An effect with the values of its parameters, each (P, 1)."""
Slope = Callable[..., tuple[Floats, Sequence[Floats]]]


@dataclass(frozen=True)
class Start:
    """What differs from run to run and is no property of the vehicle; each broadcasts to (P, R), shift to
    (P, R, E).

    `heading` [rad] and `rate` [rad/s] at the first sample, `log_gain` of the moment delivered, `shift` [s]
    of every change of command from the middle of the interval in which it happened, `disturbance` (P, R,
    windows) a moment added in each window of the batch, `own` by name the coefficients (P, R, k) of effects that
    vary from run to run.
    """

    heading: ArrayLike = 0.0
    rate: ArrayLike = 0.0
    log_gain: ArrayLike = 0.0
    shift: Floats | None = None
    disturbance: Floats | None = None
    own: Mapping[str, Floats] = field(default_factory=dict)

    def bind(self, effect: Effect, values: tuple[Floats, ...]) -> tuple[Floats, ...]:
        """An effect's values with each run's own coefficients after them."""
        own = self.own.get(effect.name, np.zeros((1, 1, effect.per_run)))
        return (*values, *np.moveaxis(own, 2, 0))


@dataclass(frozen=True)
class Trajectory:
    """Simulated heading as the sensor reads it [rad] and true yaw rate [rad/s] at the samples, both (P, R, N).

    `nodes` holds the two at all nodes of the simulation grid, (P, R, M + 1); samples are picked when asked for.
    """

    nodes: tuple[Floats, Floats] = field(repr=False)
    node: NDArray[np.int64] = field(repr=False)

    @cached_property
    def heading(self) -> Floats:
        """Headings that the sensor reads [rad], (P, R, N)."""
        return self._at_samples(self.nodes[0])

    @cached_property
    def rate(self) -> Floats:
        """True yaw rates [rad/s], (P, R, N)."""
        return self._at_samples(self.nodes[1])

    def _at_samples(self, column: Floats) -> Floats:
        return np.asarray(column[:, np.arange(len(self.node))[:, None], self.node])


def step_for(model: YawModel, moment: float) -> float:
    """Step [s] at which the error of the integrator stays below a hundredth of a degree under |moment|."""
    return float(np.clip(model.fastest(moment) / 2.0, 1e-3, 0.2))


def simulate(
    model: YawModel, batch: Batch, theta: Floats | None = None, start: Start | None = None
) -> Trajectory:
    """Simulate all runs of `batch` under all parameter sets `theta` (P, p), by default the model's own.

    Returns headings and rates of shape (P, R, N). Commands are held over each step; the order is actuators
    on the commands, sum of moments with water states, division by inertia, sensors on the heading.
    """
    theta = np.atleast_2d(model.theta if theta is None else theta)
    start = start or Start()
    shape = np.broadcast_shapes(
        (len(theta), len(batch.names)), np.shape(start.heading), np.shape(start.log_gain)
    )
    terms = [(effect, start.bind(effect, values)) for effect, values in model.unpack(theta)]
    commands = batch.commands(start.shift)
    forward = replace(
        commands, length=np.maximum(commands.length, 0.0)
    )  # for those who only know time to pass
    for effect, values in terms:
        if effect.place is Place.ACTUATOR:
            wide = tuple(v[..., None] for v in values)
            forward = replace(forward, moment=effect.deliver(forward, wide))
    commands = replace(commands, moment=forward.moment)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # a fit may try parameters that no vehicle has; it sees the infinity
        heading, rate = _integrate(theta[:, :1], terms, batch, commands, start, shape)
        time = np.concatenate(
            [np.zeros_like(commands.start[..., :1]), commands.start + commands.length], axis=2
        )
        for effect, values in terms:
            if effect.place is Place.SENSOR:
                heading = effect.read(heading, time, tuple(v[..., None] for v in values))
    return Trajectory((heading, rate), batch.node)


def _integrate(
    inertia: Floats,
    terms: Sequence[Bound],
    batch: Batch,
    commands: Commands,
    start: Start,
    shape: tuple[int, ...],
) -> tuple[Floats, Floats]:
    """Headings and rates at all M + 1 nodes, (P, R, M + 1).

    The rate and the states of the water are advanced step by step; the heading only where a moment depends on it,
    else its increments are summed at the end: numpy's cost a call, not arithmetic, is what a step costs.
    """
    movers = [(effect, values) for effect, values in terms if effect.place in (Place.MOMENT, Place.WATER)]
    steered = any(effect.steered for effect, _ in movers)
    tau = _delivered(batch, commands, start, shape)
    lengths, begins = (np.ascontiguousarray(np.moveaxis(x, 2, 0)) for x in (commands.length, commands.start))
    half, sixth, middle = 0.5 * lengths, lengths / 6.0, begins + 0.5 * lengths
    slope = _slope(movers, 1.0 / inertia)
    heading = np.array(np.broadcast_to(start.heading, shape), dtype=float)
    rate = np.array(np.broadcast_to(start.rate, shape), dtype=float)
    water = [np.zeros(shape) for effect, _ in movers for _ in effect.states]
    motion = Motion(heading, heading, rate, rate, tau[0], begins[0], {})
    steps = len(tau)
    rates, turned = np.empty((steps + 1, *shape)), np.empty((steps + 1, *shape))
    rates[0], turned[0] = rate, heading
    for m in range(steps):
        h, h2, h6 = lengths[m], half[m], sixth[m]
        motion.delivered = tau[m]
        if commands.signals:
            motion.signals = {name: column[:, m] for name, column in commands.signals.items()}
        first, water1 = slope(motion, heading, rate, water, begins[m])
        rate2 = rate + h2 * first
        at = heading + h2 * rate if steered else heading
        second, water2 = slope(motion, at, rate2, _ahead(water, h2, water1), middle[m])
        rate3 = rate + h2 * second
        at = heading + h2 * rate2 if steered else heading
        third, water3 = slope(motion, at, rate3, _ahead(water, h2, water2), middle[m])
        at = heading + h * rate3 if steered else heading
        fourth, water4 = slope(motion, at, rate + h * third, _ahead(water, h, water3), begins[m] + h)
        twice = second + third
        # The heading's own Runge-Kutta step: the mean rate of the four stages, written with their slopes.
        np.add(rate, h6 * (first + twice), out=turned[m + 1])
        rate = np.add(rate, h6 * (first + 2.0 * twice + fourth), out=rates[m + 1])
        if steered:
            heading = heading + h * turned[m + 1]
        water = [
            w + h6 * (a + 2.0 * (b + c) + d) for w, a, b, c, d in zip(water, water1, water2, water3, water4)
        ]
    turned[1:] *= lengths
    np.cumsum(turned, axis=0, out=turned)
    return np.moveaxis(turned, 0, 2), np.moveaxis(rates, 0, 2)


def _delivered(batch: Batch, commands: Commands, start: Start, shape: tuple[int, ...]) -> Floats:
    """Moment held over each step with the run's gain and disturbance, (M, P, R)."""
    delivered = commands.moment * np.exp(np.asarray(start.log_gain))[..., None]
    if start.disturbance is not None:
        index = np.broadcast_to(batch.window[None], (len(start.disturbance), *batch.window.shape))
        delivered = delivered + np.take_along_axis(start.disturbance, index, axis=2)
    wide = np.broadcast_to(delivered, (*shape, delivered.shape[2]))
    return np.ascontiguousarray(np.moveaxis(wide, 2, 0))


def _slope(movers: Sequence[Bound], per_inertia: Floats) -> Slope:
    """The right-hand side: acceleration (P, R) and the derivatives of the water's states."""

    def slope(motion: Motion, heading: Floats, rate: Floats, water: Sequence[Floats], time: Floats):  # type: ignore[no-untyped-def]
        motion.heading, motion.rate, motion.time, motion.slip = heading, rate, time, rate
        if water:
            left = iter(water)
            own = [tuple(islice(left, len(effect.states))) for effect, _ in movers]
            moving = [e.water_rate(s, v) for (e, v), s in zip(movers, own) if e.place is Place.WATER]
            motion.slip = rate - sum(moving)
        total = motion.delivered
        for effect, values in movers:
            total = total + effect.moment(motion, values)
        flow: list[Floats] = []
        if water:
            for (effect, values), states in zip(movers, own):
                flow.extend(effect.derivatives(motion, states, values) if states else ())
        return total * per_inertia, flow

    return slope


def _ahead(states: Sequence[Floats], step: Floats, slopes: Sequence[Floats]) -> list[Floats]:
    return [state + step * slope for state, slope in zip(states, slopes)]
