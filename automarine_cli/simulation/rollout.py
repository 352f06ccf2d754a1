"""Advance every run under every parameter set together: classical Runge-Kutta with a fixed step, blind to
the effects.

Order of the axes everywhere: parameter sets P, runs R, samples N (or steps M).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automarine_cli.effects import Motion, Place
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.simulation.batch import Batch

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """What differs from run to run and is no property of the vehicle; each broadcasts to (P, R), shift to
    (P, R, E).

    `heading` [rad] and `rate` [rad/s] at the first sample, `log_gain` of the moment delivered, `shift` [s]
    of every change of command from the middle of the interval in which it happened, `disturbance` (P, R,
    windows) a moment added in each window of the batch.
    """

    heading: ArrayLike = 0.0
    rate: ArrayLike = 0.0
    log_gain: ArrayLike = 0.0
    shift: Floats | None = None
    disturbance: Floats | None = None


@dataclass(frozen=True)
class Trajectory:
    """Simulated heading as the sensor reads it [rad] and true yaw rate [rad/s] at the samples, both (P, R,
    N)."""

    heading: Floats
    rate: Floats


def step_for(model: YawModel, moment: float) -> float:
    """Step [s] at which the error of the integrator stays below a hundredth of a degree under |moment|."""
    return float(np.clip(model.fastest(moment) / 4.0, 1e-3, 0.2))


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
    terms = list(model.unpack(theta))
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
    time = np.concatenate([np.zeros_like(commands.start[..., :1]), commands.start + commands.length], axis=2)
    for effect, values in terms:
        if effect.place is Place.SENSOR:
            heading = effect.read(heading, time, tuple(v[..., None] for v in values))
    index = np.broadcast_to(batch.node[None], (shape[0], *batch.node.shape))
    return Trajectory(np.take_along_axis(heading, index, axis=2), np.take_along_axis(rate, index, axis=2))


def _integrate(inertia, terms, batch, commands, start, shape):  # type: ignore[no-untyped-def]
    """Headings and rates at all M + 1 nodes, (P, R, M + 1)."""
    movers = [(e, v) for e, v in terms if e.place in (Place.MOMENT, Place.WATER)]
    slots, used = [], 2
    for effect, _ in movers:
        slots.append(slice(used, used + len(effect.states)))
        used += len(effect.states)
    delivered = commands.moment * np.exp(np.asarray(start.log_gain))[..., None]
    if start.disturbance is not None:
        index = np.broadcast_to(batch.window[None], (len(start.disturbance), *batch.window.shape))
        delivered = delivered + np.take_along_axis(start.disturbance, index, axis=2)
    delivered = np.ascontiguousarray(
        np.moveaxis(np.broadcast_to(delivered, (*shape, delivered.shape[2])), 2, 0)
    )
    lengths, begins = np.moveaxis(commands.length, 2, 0), np.moveaxis(commands.start, 2, 0)
    state = np.zeros((used, *shape))
    state[0], state[1] = start.heading, start.rate
    steps = len(delivered)
    nodes = np.empty((steps + 1, 2, *shape))
    nodes[0] = state[:2]
    heading0 = state[0].copy()

    def slope(state, time, tau, signals):  # type: ignore[no-untyped-def]
        water = 0.0
        for (effect, values), slot in zip(movers, slots):
            if effect.place is Place.WATER:
                water = water + effect.water_rate(tuple(state[slot]), values)
        motion = Motion(state[0], state[0] - heading0, state[1], water, tau, time, signals)
        out = np.empty_like(state)
        out[0] = state[1]
        total = tau
        for (effect, values), slot in zip(movers, slots):
            total = total + effect.moment(motion, values)
            if effect.states:
                out[slot] = np.broadcast_arrays(*effect.derivatives(motion, tuple(state[slot]), values))
        out[1] = total / inertia
        return out

    for m in range(steps):
        h, t, tau = lengths[m], begins[m], delivered[m]
        signals = {name: column[:, m] for name, column in commands.signals.items()}
        first = slope(state, t, tau, signals)
        second = slope(state + 0.5 * h * first, t + 0.5 * h, tau, signals)
        third = slope(state + 0.5 * h * second, t + 0.5 * h, tau, signals)
        fourth = slope(state + h * third, t + h, tau, signals)
        state = state + h / 6.0 * (first + 2.0 * (second + third) + fourth)
        nodes[m + 1] = state[:2]
    return np.moveaxis(nodes[:, 0], 0, 2), np.moveaxis(nodes[:, 1], 0, 2)
