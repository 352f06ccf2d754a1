"""Vehicles steered by a heading controller in disturbed water, with a known truth: not the library's equations.

Everything is in the vehicle's measures. Moments are shares of the largest moment M, yaw rates x = r/R shares
of the rate R that M would hold against the base drag, so that

    psi' = R x,    time x' = thrust + disturbance + hidden moments - (1 - linear) x|x| - linear x,

and I_r = M time/R, k_rr = (1 - linear) M/R^2, k_r = linear M/R. All runs advance together with a fixed step (the
midpoint rule; dry friction takes its share of the rate after each step and holds what it brings to rest). The
controller reads its sensors ten times a second; the log has these very readings and the command held until the next.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from blind_truth import Floats, compass

STEP = 0.005  # s, of the integrator
INTERVAL = 0.1  # s, of controller and logger
WITHIN = round(INTERVAL / STEP)
FLICKER = 0.3  # s, over which unsteady thrust stays alike


@dataclass(frozen=True)
class Vehicle:
    """`time` [s], `fastest` rate R [rad/s], share of drag that is `linear` at R; sizes of what is `hidden`, by law.

    Laws of the thrusters: `delay` [s], `propeller-lag` [s], `dead-band` and `limit` [share of M], `thrust-asymmetry`
    [log of the gain to starboard], `discharge` [share of thrust lost over the campaign]. Of hull and water, as shares
    of M at R: `linear`, `cubic`, `drag-asymmetry`, `thrust-loss` (at full thrust), `coupling` (at a surge of 1 m/s);
    `dry`, `bias`, `push` (towards heading `push-at` [rad]) and `spring` [1/rad]. Of the compass: `hard-iron` and
    `soft-iron` [share of the Earth's field], `sensor-lag` [s].
    """

    time: float
    fastest: float
    linear: float
    hidden: Mapping[str, float]

    def size(self, law: str) -> float:
        """Size of one law, zero where it is not hidden."""
        return self.hidden.get(law, 0.0)


@dataclass(frozen=True)
class Pilot:
    """Heading controller: shares of M by error [1/rad], by rate [s/rad], by summed error [1/(rad s)]; the rate is the
    gyro's if `gyro`, else that of the heading's differences, smoothed over `smoothing` [s]."""

    error: float
    rate: float
    summed: float
    smoothing: float
    gyro: bool


@dataclass(frozen=True)
class Voyage:
    """What is asked of R runs of N samples: `setpoint` [rad] and `surge` [m/s] (N, R), `start` heading [rad] and
    `clock` [s] (R,)."""

    setpoint: Floats
    surge: Floats
    start: Floats
    clock: Floats


@dataclass(frozen=True)
class Chance:
    """What nobody logs: disturbance (size as share of M, time constant [s]), gain scatter, unsteadiness of the thrust,
    noise of the compass [rad] and of the gyro [rad/s], largest bias of the gyro in a run [rad/s]."""

    disturbance: float
    lasting: float
    scatter: float
    unsteady: float
    compass: float
    gyro: float
    gyro_bias: float


@dataclass(frozen=True)
class Log:
    """Samples (N, R): compass [rad] and gyro [rad/s] as read, command [share of M]."""

    compass: Floats
    gyro: Floats
    command: Floats


def sail(vehicle: Vehicle, pilot: Pilot, voyage: Voyage, chance: Chance, random: np.random.Generator) -> Log:
    """Let the controller steer the vehicle through all runs."""
    samples, runs = len(voyage.setpoint), len(voyage.clock)
    thrusters = Thrusters(vehicle, np.exp(chance.scatter * random.standard_normal(runs)), voyage.clock)
    moment = chance.disturbance * wander(random, samples * WITHIN, runs, chance.lasting)
    flicker = 1.0 + chance.unsteady * wander(random, samples * WITHIN, runs, FLICKER)
    compass_noise = chance.compass * random.standard_normal((samples, runs))
    gyro_noise = chance.gyro * random.standard_normal((samples, runs))
    gyro_noise += chance.gyro_bias * random.uniform(-1.0, 1.0, runs)

    heading: Floats = voyage.start.copy()
    x: Floats = random.uniform(-0.2, 0.2, runs)
    late, iron = vehicle.size("sensor-lag"), (vehicle.size("hard-iron"), vehicle.size("soft-iron"))

    def shown() -> Floats:
        return compass(heading, *iron) if any(iron) else heading.copy()

    needle = shown() - late * vehicle.fastest * x
    summed, before, turning = np.zeros(runs), needle + compass_noise[0], np.zeros(runs)
    log = Log(*(np.zeros((samples, runs)) for _ in range(3)))
    for k in range(samples):
        log.compass[k] = (needle if late else shown()) + compass_noise[k]
        log.gyro[k] = vehicle.fastest * x + gyro_noise[k]

        turning += INTERVAL / (INTERVAL + pilot.smoothing) * ((log.compass[k] - before) / INTERVAL - turning)
        before = log.compass[k]
        error = (voyage.setpoint[k] - log.compass[k] + np.pi) % (2 * np.pi) - np.pi
        wanted = pilot.error * error - pilot.rate * (log.gyro[k] if pilot.gyro else turning) + summed
        log.command[k] = np.clip(wanted, -1.0, 1.0)
        summed += np.where(wanted == log.command[k], pilot.summed * INTERVAL * error, 0.0)

        for m in range(k * WITHIN, (k + 1) * WITHIN):
            thrust = thrusters.after_step(m, log.command) * flicker[m]
            drive = thrust + moment[m] + vehicle.size("bias")
            middle = x + STEP / 2 * slope(x, heading, drive, thrust, vehicle, voyage, k)
            halfway = heading + STEP / 2 * vehicle.fastest * x
            new = x + STEP * slope(middle, halfway, drive, thrust, vehicle, voyage, k)
            new = np.sign(new) * np.maximum(np.abs(new) - STEP * vehicle.size("dry") / vehicle.time, 0.0)
            heading, x = heading + STEP / 2 * vehicle.fastest * (x + new), new
            if late:
                needle += (shown() - needle) * -np.expm1(-STEP / late)
    return log


def slope(
    x: Floats, heading: Floats, drive: Floats, thrust: Floats, vehicle: Vehicle, voyage: Voyage, k: int
) -> Floats:
    """Time derivative of the share of the rate [1/s], (R,), dry friction apart."""
    size = vehicle.size
    total = drive - (1.0 - vehicle.linear) * x * np.abs(x) - vehicle.linear * x
    total -= size("linear") * x + size("cubic") * x**3 + size("drag-asymmetry") * x**2
    total -= size("thrust-loss") * np.sqrt(np.abs(thrust)) * x
    total += size("coupling") * voyage.surge[k] * x
    total -= size("spring") * (heading - voyage.start)
    total -= size("push") * np.sin(heading - size("push-at"))
    return total / vehicle.time


class Thrusters:
    """Delay, shape, supply and lag of the thrusters of all runs; holds the speed of the propellers, (R,)."""

    def __init__(self, vehicle: Vehicle, gain: Floats, clock: Floats) -> None:
        self.vehicle, self.gain, self.clock = vehicle, gain, clock
        self.speed = np.zeros_like(gain)
        self.late = round(vehicle.size("delay") / STEP)
        self.keep = np.exp(-STEP / max(vehicle.size("propeller-lag"), 1e-6))
        self.whole = clock.max() + 80.0  # s, of the campaign

    def after_step(self, m: int, commands: Floats) -> Floats:
        """Moment amid step `m` [share of M] under `commands` (N, R)."""
        size = self.vehicle.size
        u = commands[(m - self.late) // WITHIN] if m >= self.late else np.zeros_like(self.gain)
        if band := size("dead-band"):
            u = u - np.clip(u, -band, band)
        if limit := size("limit"):
            u = np.clip(u, -limit, limit)
        u = u * np.exp(size("thrust-asymmetry") * np.sign(u))
        wanted = np.sign(u) * np.sqrt(np.abs(u))
        gap = self.speed - wanted
        self.speed, middle = wanted + self.keep * gap, wanted + np.sqrt(self.keep) * gap
        spent = ((self.clock + m * STEP) / self.whole) ** 1.3
        return self.gain * (1.0 - size("discharge") * spent) * middle * np.abs(middle)


def wander(random: np.random.Generator, steps: int, runs: int, lasting: float) -> Floats:
    """Ornstein-Uhlenbeck processes of size one and time constant `lasting` [s], (steps, R)."""
    keep = np.exp(-STEP / lasting)
    out = np.sqrt(1.0 - keep**2) * random.standard_normal((steps, runs))
    out[0] = random.standard_normal(runs)
    for m in range(1, steps):
        out[m] += keep * out[m - 1]
    return out
