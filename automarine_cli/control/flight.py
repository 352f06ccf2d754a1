"""Flights of many vehicles under many sets of gains at once: a step of the reference, and a load at rest."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.control.actuators import Actuators
from automarine_cli.control.members import Vehicles
from automarine_cli.control.plant import Body, holding, sensor_lag
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.quantities import Floats

LONGEST_STEP = 0.01
"""Longest step [s] of a vehicle between two loops of its controller."""
READ = 0.1
"""Readings are as far off as they are for so long [s]: the pace of logs, of which their noise is known."""
TWO = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
"""The two flights: one with the step of the reference, one with the load."""


@dataclass(frozen=True)
class Flight:
    """`time` (N,) [s], `position` and `output` (S, R, N) of S sets in R flights."""

    time: Floats
    position: Floats
    output: Floats


def fly(
    target: Target, gains: Gains, vehicles: Vehicles, reference: Floats, load: Floats, *, every: float = 0.1,
    longest: float = LONGEST_STEP,
) -> Flight:  # fmt: skip
    """Fly from rest: `reference` (S or 1, R, M) at each loop of the controller from position 0, `load` (S or 1, R) a
    moment against the vehicle all along; kept `every` so many seconds, the vehicle in steps of `longest` [s] at most.
    Readings have the vehicles' noise, the same in every call."""
    if target.linear:
        vehicles = replace(vehicles, bend=None)
    step, loops = target.period, reference.shape[2]
    parts = max(1, int(np.ceil(step / longest - 1e-9)))
    flights = reference.shape[1]
    hull, drive = Body(vehicles, flights), Actuators(vehicles, flights, step / parts)
    rest = holding(vehicles)[:, None]
    drive.begin(rest + np.zeros((1, flights)))
    gains = target.prepared(gains)
    state = target.start(gains, hull.position[0], rest)
    lag, shown = sensor_lag(vehicles)[:, None], hull.position[0]
    late = np.exp(-step / np.maximum(lag, 1e-9))
    stride, pace = max(1, round(every / step)), max(1, round(READ / step))
    random, sizes = np.random.default_rng(0), np.array(vehicles.noise)[:, None, None]
    wrong = sizes * np.zeros((2, len(vehicles), flights))
    kept: list[Floats] = []
    outputs: list[Floats] = []
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable set of gains may run away
        for k in range(loops):
            position = hull.position[0]
            shown = position + late * (shown - position)
            if k % pace == 0 and any(vehicles.noise):
                wrong = sizes * random.standard_normal(wrong.shape)
            read = shown + wrong[0], hull.velocity[0] + wrong[1]
            state, output = target.step(state, gains, reference[:, :, k], *read)
            if k % stride == 0:
                kept.append(position)
                outputs.append(output)
            for _ in range(parts):
                hull.advance(drive.deliver(output) - load, step / parts)
    time = stride * step * np.arange(len(kept), dtype=np.float64)
    return Flight(time, np.stack(kept, axis=2), np.stack(outputs, axis=2))


@dataclass(frozen=True)
class Scores:
    """Of S sets, (S,) each: `overshoot` in shares of the step, `settling` [s] (infinite where it never does), `rms`
    from then on and `error` of the load [base units], and `end` what is left of the latter at the end."""

    overshoot: Floats
    settling: Floats
    rms: Floats
    error: Floats
    end: Floats

    @cached_property
    def settles(self) -> NDArray[np.bool_]:
        """Which sets settle."""
        return np.isfinite(self.settling)


def step_and_load(
    target: Target, gains: Gains, vehicles: Vehicles, step: float, load: float, seconds: float, every: float = 0.1,
    longest: float = LONGEST_STEP,
) -> Flight:  # fmt: skip
    """Two flights of every set: a step of the reference, and a load in shares of the whole output from rest."""
    loops = max(2, round(seconds / target.period))
    reference = np.repeat((step * TWO[0])[:, :, None], loops, axis=2)
    return fly(target, gains, vehicles, reference, load * vehicles.full * TWO[1], every=every, longest=longest)


def scores(flight: Flight, step: float, band: float) -> Scores:
    """What two flights of every set came to; `band` is within what a step counts as settled."""
    overshoot, settling, rms = step_scores(flight.time, flight.position[:, 0], step, band)
    pushed = np.abs(np.nan_to_num(flight.position[:, 1], nan=1e6, posinf=1e6, neginf=1e6))
    return Scores(overshoot, settling, rms, pushed.max(axis=1), pushed[:, -1])


def step_scores(time: Floats, position: Floats, step: float, band: float) -> tuple[Floats, Floats, Floats]:
    """Overshoot in shares of a `step`, when positions (S, N) settle within a `band` [s], and the rms from then on."""
    way, left = position / step, np.abs(position - step)
    with np.errstate(invalid="ignore"):
        outside = ~(left <= band)
    last = len(time) - 1 - np.argmax(outside[:, ::-1], axis=1)
    never = last > 0.9 * len(time)
    settling = np.where(never, np.inf, time[np.minimum(last + 1, len(time) - 1)])
    settled = time[None, :] >= np.where(never, 0.75 * time[-1], settling)[:, None]
    square = np.where(settled, np.nan_to_num(left, nan=1e6, posinf=1e6) ** 2, 0.0)
    rms = np.sqrt(square.sum(axis=1) / np.maximum(settled.sum(axis=1), 1))
    overshoot = np.maximum(np.nan_to_num(way, nan=1e6, posinf=1e6).max(axis=1) - 1.0, 0.0)
    return overshoot, settling, rms
