"""ArduSub's yaw stack and a vehicle for the benchmark of `tune`, written from ArduPilot's sources and a few laws of
motion; nothing here is the library's.

Arrays are over S sets of gains, V vehicles and two flights: a step of the heading, and a load from rest.
Sources: ArduPilot, AC_AttitudeControl.cpp (input_euler_angle_roll_pitch_yaw, sqrt_controller), AC_PID.cpp,
AP_MotorsMatrix.cpp; margins are those of Seiler, Packard and Gahinet (2020), IEEE Control Systems 40(5):78.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Gains = Mapping[str, Floats]
LOOP_S = 0.005  # boards with 200 loops a second
LOG_S = 0.1
GYRO_HZ = 20.0
RANGES = {
    "ATC_ANG_YAW_P": (0.05, 6.0), "ATC_RAT_YAW_P": (0.01, 0.5), "ATC_RAT_YAW_I": (1e-4, 0.05),
    "ATC_RAT_YAW_D": (1e-4, 0.02), "ATC_SLEW_YAW": (500.0, 18000.0), "ATC_ACCEL_Y_MAX": (200.0, 72000.0),
}  # fmt: skip
"""What is searched, within its documented range."""
DEFAULTS = {
    "ATC_ANG_YAW_P": 6.0, "ATC_RAT_YAW_P": 0.18, "ATC_RAT_YAW_I": 0.018, "ATC_RAT_YAW_D": 0.0,
    "ATC_RAT_YAW_IMAX": 0.222, "ATC_RAT_YAW_FLTT": 5.0, "ATC_RAT_YAW_FLTD": 5.0, "ATC_SLEW_YAW": 6000.0,
    "ATC_ACCEL_Y_MAX": 110000.0, "ATC_INPUT_TC": 0.15,
}  # fmt: skip
SWING = 1e-6  # rate [rad/s] about rest over which quadratic drag is taken as straight


@dataclass(frozen=True)
class Fleet:
    """V vehicles alike but for `gain` of the thrust (V,) and `delay` [s] (V,); all else per moment of the whole output.

    `lag` [s] of the thrust; thrust is a `power` of the command beyond an `idle` share; `swirl` is the share of its rate
    that the water reaches in `calm` [s]."""

    gain: Floats
    delay: Floats
    inertia: float
    quadratic: float
    linear: float = 0.0
    lag: float = 0.0
    idle: float = 0.0
    power: float = 1.0
    swirl: float = 0.0
    calm: float = 10.0

    def thrust(self, output: Floats) -> Floats:
        beyond = np.maximum(np.abs(output) - self.idle, 0.0) / (1.0 - self.idle)
        return np.sign(output) * (beyond if self.power == 1.0 else beyond**self.power)

    def slope(self, output: float) -> float:
        """Thrust per output, about an output."""
        low, high = self.thrust(np.array([output - 0.01, output + 0.01]))
        return float(high - low) / 0.02


def root(error: Floats, gain: Floats, limit: Floats) -> Floats:
    """ArduPilot's sqrt_controller without its last loop: a straight line, continued by a root."""
    turn = limit / gain**2
    far = np.sqrt(2.0 * limit * np.maximum(np.abs(error) - 0.5 * turn, 0.0))
    return np.where(np.abs(error) <= turn, gain * error, np.sign(error) * far)


def fly(
    gains: Gains, fleet: Fleet, seconds: float, step: float = np.pi / 2, load: float = 0.1, noise: float = 0.0
) -> Floats:
    """Fly a step of the heading [rad] and a load in shares of the whole output: headings (S, V, 2, N) each `LOG_S`.

    `noise` [rad] is that of the compass, held for 0.1 s."""
    k = {name: np.asarray(value, dtype=float).reshape(-1, 1, 1) for name, value in {**DEFAULTS, **gains}.items()}
    shape = (max(value.shape[0] for value in k.values()), len(fleet.gain), 2)
    dt, random = LOOP_S, np.random.default_rng(7)
    degree = np.pi / 180.0
    accel, slew = k["ATC_ACCEL_Y_MAX"] * degree / 100.0, k["ATC_SLEW_YAW"] * degree / 100.0
    brake = np.clip(accel / 2.0, 10.0 * degree, 120.0 * degree)
    angle_p, p, i, d, imax = (
        k[f"ATC_{n}"] for n in ("ANG_YAW_P", "RAT_YAW_P", "RAT_YAW_I", "RAT_YAW_D", "RAT_YAW_IMAX")
    )
    alpha_t, alpha_d = (1.0 / (1.0 + 1.0 / (2.0 * np.pi * k[f"ATC_RAT_YAW_{n}"] * dt)) for n in ("FLTT", "FLTD"))
    tan = np.tan(np.pi * GYRO_HZ * dt)
    a0 = 1.0 + np.sqrt(2.0) * tan + tan**2
    b, a1, a2 = tan**2 / a0, 2.0 * (tan**2 - 1.0) / a0, (1.0 - np.sqrt(2.0) * tan + tan**2) / a0
    reference, loads = np.array([step, 0.0]), np.array([0.0, load])
    heading, rate, water, thrust, output = (np.zeros(shape) for _ in range(5))
    x1, x2, y1, y2 = (np.zeros(shape) for _ in range(4))
    target, turn, wish, filtered, before, change, integral = (np.zeros(shape) for _ in range(7))
    rate_of_whole = 1.0 / p  # thrust_heading_rotation_angles: the error whose rate the rate controller's P can ask for
    straight = rate_of_whole / angle_p
    rooted = 0.5 * brake / angle_p**2 + 0.5 * rate_of_whole**2 / brake
    furthest = np.minimum(np.where(rate_of_whole < brake / angle_p, straight, rooted), 45.0 * degree)
    steps = fleet.delay / dt
    whole, part = np.floor(steps).astype(int), (steps - np.floor(steps))[:, None]
    past = np.zeros((int(whole.max()) + 2, *shape))
    rows = np.arange(len(fleet.gain))
    settle = -np.expm1(-dt / fleet.lag) if fleet.lag else 1.0
    every, wrong, kept = round(LOG_S / dt), np.zeros(shape), list[Floats]()
    for n in range(round(seconds / dt)):
        if n % every == 0:
            kept.append(heading)
            wrong = noise * random.standard_normal(shape)
        gyro = b * (rate + 2.0 * x1 + x2) - a1 * y1 - a2 * y2
        x1, x2, y1, y2 = rate, x1, gyro, y1
        filtered = filtered + alpha_t * (wish - filtered)
        error = filtered - gyro
        change = change + alpha_d * ((error - before) / dt - change)
        before = error
        grows = (np.abs(output) >= 1.0) & (integral * error >= 0.0)
        integral = np.clip(integral + np.where(grows, 0.0, i * error * dt), -imax, imax)
        output = p * error + integral + d * change
        wanted = np.clip(root(reference - target, 1.0 / k["ATC_INPUT_TC"], accel), -slew, slew)
        turn = turn + np.clip(wanted - turn, -accel * dt, accel * dt)
        target = target + turn * dt
        off = np.clip(target - (heading + wrong), -furthest, furthest)
        target = heading + wrong + off
        wish = root(off, angle_p, brake) + turn
        past[n % len(past)] = np.clip(output, -1.0, 1.0)
        late = past[(n - whole) % len(past), :, rows].swapaxes(0, 1)
        later = past[(n - whole - 1) % len(past), :, rows].swapaxes(0, 1)
        thrust = thrust + settle * (fleet.thrust(late + part * (later - late)) - thrust)
        slip = rate - water
        drag = fleet.linear * slip + fleet.quadratic * np.abs(slip) * slip
        rate_after = rate + dt * (fleet.gain[:, None] * thrust - loads - drag) / fleet.inertia
        heading = heading + 0.5 * dt * (rate + rate_after)
        water = water + dt / fleet.calm * (fleet.swirl * slip - (1.0 - fleet.swirl) * water)
        rate = rate_after
    return np.stack(kept, axis=-1)


def figures(
    heading: Floats, recovery: float, step: float = np.pi / 2, band: float = np.deg2rad(2.0)
) -> dict[str, Floats]:
    """Worst of the vehicles, (S,) each: settling [s], overshoot [%], load peak and load left [deg], the mean of the
    second before the `recovery` time [s]; `swing` [deg] is the largest error of the last quarter of the step."""
    error = np.abs(np.nan_to_num(heading[:, :, 0], nan=1e6) - step)
    outside = error > band
    last = error.shape[2] - 1 - np.argmax(outside[:, :, ::-1], axis=2)
    settling = np.where(last > 0.9 * error.shape[2], np.inf, LOG_S * (last + 1))
    push = np.nan_to_num(heading[:, :, 1], nan=1e6)
    end = round(recovery / LOG_S)
    left = np.abs(push[:, :, max(0, end - 10) : end].mean(axis=2))
    quarter = 3 * error.shape[2] // 4
    return {
        "settling": settling.max(axis=1),
        "overshoot": 100.0 * np.maximum(heading[:, :, 0].max(axis=2) / step - 1.0, 0.0).max(axis=1),
        "peak": np.rad2deg(np.abs(push).max(axis=2).max(axis=1)),
        "left": np.rad2deg(left.max(axis=1)),
        "swing": np.rad2deg(error[:, :, quarter:].max(axis=2).max(axis=1)),
    }


def disk_margins(gains: Gains, fleet: Fleet, slopes: tuple[float, ...] = (1.0,)) -> Floats:
    """Disk margin of each set, (S,), the least over the vehicles and slopes of the thrust; zero where unstable."""
    k = {name: np.asarray(value, dtype=float).reshape(-1, 1) for name, value in {**DEFAULTS, **gains}.items()}
    w = np.geomspace(1e-4, 200.0, 900)
    s: NDArray[Any] = 1j * w
    pid: NDArray[Any] = k["ATC_RAT_YAW_P"] + k["ATC_RAT_YAW_I"] / s
    pid = pid + k["ATC_RAT_YAW_D"] * s / (1.0 + s / (2.0 * np.pi * k["ATC_RAT_YAW_FLTD"]))
    gyro = 1.0 / (1.0 + np.sqrt(2.0) * s / (2.0 * np.pi * GYRO_HZ) + (s / (2.0 * np.pi * GYRO_HZ)) ** 2)
    demand = k["ATC_ANG_YAW_P"] * np.exp(-s * LOOP_S) / (1.0 + s / (2.0 * np.pi * k["ATC_RAT_YAW_FLTT"]))
    drag = fleet.linear + 2.0 * fleet.quadratic * SWING
    slip = (s * fleet.calm + 1.0 - fleet.swirl) / (s * fleet.calm + 1.0)  # of the rate, where water follows
    plant = 1.0 / (s * (fleet.inertia * s + drag * slip)) / (1.0 + s * fleet.lag)
    least = np.full(len(pid), np.inf)
    for gain, delay in zip(fleet.gain, fleet.delay):
        for slope in slopes:
            loop = pid * (demand + s * gyro) * plant * gain * slope * np.exp(-s * (delay + 0.5 * LOOP_S))
            around = np.unwrap(np.angle(1.0 + loop), axis=1)
            poles = 1 + 1 + (drag < 1e-3)  # at the origin: heading, integrator, and a rate that nothing damps
            stable = np.abs(around[:, -1] - around[:, 0] - 0.5 * np.pi * poles) < 1.5
            margin = 2.0 / np.max(np.abs((1.0 - loop) / (1.0 + loop)), axis=1)
            least = np.minimum(least, np.where(stable, margin, 0.0))
    return least


def random_sets(count: int, seed: int, fastest: Mapping[str, tuple[float, float]] = RANGES) -> dict[str, Floats]:
    """Draw sets of gains, each gain in equal ratios over its range."""
    random = np.random.default_rng(seed)
    sets = {name: np.exp(random.uniform(np.log(ends[0]), np.log(ends[1]), count)) for name, ends in fastest.items()}
    return sets | {"ATC_RAT_YAW_FLTD": np.full(count, 20.0), "ATC_RAT_YAW_IMAX": np.full(count, 0.5)}
