"""Vehicles under a controller: flights of many sets of gains at once, and how far loops are from oscillating.

A formula for margins is satisfied by loops that are unstable already: what is unstable is found first, by counting how
often 1 + L goes round the origin along a line slightly to the left of the imaginary axis (Nyquist's criterion, which
thus calls what rings on and on unstable too), and has no margin.

Sources: Seiler, Packard and Gahinet (2020), An introduction to disk margins, IEEE Control Systems 40(5):78; Nyquist
(1932), Bell System Technical Journal 11:126.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.control.vehicles import Actuators, Body, Vehicles, holding, sensor_lag
from automarine_cli.quantities import Complexes, Floats

LONGEST_STEP = 0.01  # longest step [s] of a vehicle between two loops of its controller
READ = 0.1  # readings are as far off as they are for so long [s]: the pace of logs, of which their noise is known
TWO = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
"""The two flights: one with the step of the reference, one with the load."""
Loop = Callable[[Complexes], Complexes]
TILT = 0.02  # damping ratio below which a closed loop counts as unstable
LOWEST = 1e-4  # frequency [rad/s] below which a pole counts as an integrator


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

    @property
    def settles(self) -> NDArray[np.bool_]:
        return np.isfinite(self.settling)


def step_and_load(
    target: Target, gains: Gains, vehicles: Vehicles, step: float, load: float, seconds: float, every: float = 0.1,
    longest: float = LONGEST_STEP,
) -> Flight:  # fmt: skip
    """Fly every set twice: a step of the reference, and a load in shares of the whole output from rest."""
    loops = max(2, round(seconds / target.period))
    reference = np.repeat((step * TWO[0])[:, :, None], loops, axis=2)
    return fly(target, gains, vehicles, reference, load * vehicles.full * TWO[1], every=every, longest=longest)


def scores(flight: Flight, step: float, band: float) -> Scores:
    """Score two flights of every set; `band` is within what a step counts as settled."""
    overshoot, settling, rms = step_scores(flight.time, flight.position[:, 0], step, band)
    pushed = np.abs(np.nan_to_num(flight.position[:, 1], nan=1e6, posinf=1e6, neginf=1e6))
    return Scores(overshoot, settling, rms, pushed.max(axis=1), pushed[:, -1])


def step_scores(time: Floats, position: Floats, step: float, band: float) -> tuple[Floats, Floats, Floats]:
    """Return overshoot in shares of a `step`, when positions (S, N) settle within a `band` [s], and the rms from
    then."""
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


@dataclass(frozen=True)
class Margins:
    """Of S loops, (S,) each: `disk` (balanced, the diameter alpha), `gain` [dB], the smaller way, `phase` [deg],
    `delay` [s], and `stable`; zero where a loop is not."""

    disk: Floats
    gain: Floats
    phase: Floats
    delay: Floats
    stable: NDArray[np.bool_]


def frequencies(highest: float, count: int, lowest: float = LOWEST) -> Floats:
    """Return frequencies [rad/s] up to `highest`, denser where loops cross over."""
    few = max(count // 6, 8)
    start = highest * 1e-4
    if lowest >= start:
        return np.geomspace(lowest, highest, count)
    return np.concatenate([np.geomspace(lowest, start, few, endpoint=False), np.geomspace(start, highest, count - few)])


def stable_along(ratio: Complexes, poles: Complexes, integrators: int) -> NDArray[np.bool_]:
    """Tell which of S closed loops are stable, by L (S, W) at frequencies times (1j - TILT).

    `poles` (S or 1, n) are those of the vehicle, `integrators` how many the controller adds.
    """
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
    both = np.abs((angle + np.pi) % (2.0 * np.pi) - np.pi)
    phase = np.where(crosses, both, np.inf)
    delay = np.where(crosses, (angle % (2.0 * np.pi)) / at, np.inf)
    return np.rad2deg(np.min(phase, axis=1)), np.asarray(np.min(delay, axis=1))
