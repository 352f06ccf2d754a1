"""Pool campaigns with a known truth, for the blind benchmark: nothing here knows the library's equations.

Its integrator (Runge-Kutta 4, fixed fine step, all runs at once) and its laws take other forms than the library's where
nature allows: a dead-band that cuts, a battery that sags by the charge drawn, water stirred up by a turbulent law, dry
friction that sticks, waves that meet every run at another phase. Moments are in units `scale`; all sizes below are for
a scale of one and a largest moment of LARGEST.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LARGEST = 1.2
SMALLEST = 0.12
STEP = 0.01  # s, of the integrator
MEMORY = 0.03 * 3.0 ** np.arange(7)  # s, times whose exponentials together make the kernel 1/sqrt(t)


@dataclass(frozen=True)
class Plan:
    """What is commanded: per run the instants of change [s in the run] and the moments from then on; `length` (R,) [s],
    `clock` (R,) [s] and `heading` (R,) [rad] at the start, `rate` [Hz]."""

    instants: tuple[Floats, ...]
    moments: tuple[Floats, ...]
    length: Floats
    clock: Floats
    heading: Floats
    rate: float


@dataclass(frozen=True)
class Vehicle:
    """Inertia, quadratic and linear drag in units `scale`, and the sizes of the laws that are hidden, by name: those of
    `delivered` (thrusters), `_slope` (moments and water) and `_read` (sensor)."""

    inertia: float
    quadratic: float
    linear: float
    scale: float
    hidden: Mapping[str, float]

    def size(self, law: str) -> float:
        """Size of one law, zero where it is not hidden."""
        return self.hidden.get(law, 0.0)


@dataclass(frozen=True)
class Chance:
    """What differs from run to run: gain of thrust, phase of waves, surge, snags (R, 6) at instants (R, 6)."""

    gain: Floats
    phase: Floats
    surge: Floats
    snag: Floats
    snag_at: Floats

    @classmethod
    def draw(cls, random: np.random.Generator, length: Floats, scatter: float) -> "Chance":
        """Draw for runs of `length` (R,) [s] with log-normal `scatter` of the thrust."""
        runs = len(length)
        return cls(
            np.exp(scatter * random.standard_normal(runs)),
            random.uniform(0, 2 * np.pi, runs),
            random.uniform(-0.4, 0.4, runs),
            random.choice([-1.0, 1.0], (runs, 6)) * random.uniform(0.5, 1.5, (runs, 6)),
            random.uniform(0, 1, (runs, 6)) * length[:, None],
        )


def commanded(plan: Plan, step: float, delay: float) -> Floats:
    """Mean moment over every fine step (R, M): a change inside a step counts for its share; `delay` is a shift."""
    edges = step * np.arange(round(plan.length.max() / step) + 1)
    rows = []
    for at, level in zip(plan.instants, plan.moments):
        nodes = np.concatenate([[-1e3], at + delay, [1e4]])
        impulse = np.concatenate([[0.0, 0.0], np.cumsum(level * np.diff(nodes[1:]))])
        rows.append(np.diff(np.interp(edges, nodes, impulse)) / step)
    return np.array(rows)


def delivered(plan: Plan, vehicle: Vehicle, step: float) -> Floats:
    """Moment that the thrusters aim at, (R, M), before propeller lag and the runs' own gains."""
    u = commanded(plan, step, vehicle.size("delay")) / vehicle.scale
    if late := vehicle.size("delay-off"):
        u = _released(u, max(round(late / step), 1))
    if stall := vehicle.size("stall"):
        u = _stalling(u, stall)
    if cut := vehicle.size("cut"):
        u = np.where(np.abs(u) < cut, 0.0, u)
    if band := vehicle.size("dead-band"):
        u = u - np.clip(u, -band, band)
    if bend := vehicle.size("exponent"):
        u = u * (np.maximum(np.abs(u), 1e-12) / LARGEST) ** -bend
    if play := vehicle.size("hysteresis"):  # what is delivered follows once the command has moved by `play`
        u = _followed(u, lambda now, aim: np.clip(now, aim - play, aim + play))
    if short := vehicle.size("saturation"):
        u = np.clip(u, -LARGEST * (1 - short), LARGEST * (1 - short))
    if short := vehicle.size("soft-saturation"):
        u = u / (1.0 + (np.abs(u) / (LARGEST * (1 - short))) ** 8) ** 0.125
    if short := vehicle.size("smooth-saturation"):
        most = LARGEST / short
        u = most * (1.0 - np.exp(-2.0 * u / most)) / (1.0 + np.exp(-2.0 * u / most))
    if odd := vehicle.size("thrust-asymmetry"):
        u = u * np.exp(odd * np.sign(u))
    if droop := vehicle.size("sag-load"):
        u = u / (1.0 + droop * np.abs(u) / LARGEST)
    if spent := vehicle.size("sag-charge"):
        u = u * (1.0 - spent * _charge(u, plan))
    if droop := vehicle.size("sag-slow"):  # a capacitor of 4 s follows the load, at the end of each step
        u = u * (1.0 - droop * _followed(np.abs(u) / LARGEST, lambda now, load: now + step / 4.0 * (load - now)))
    if warm := vehicle.size("temperature"):
        clock = plan.clock[:, None] + step * np.arange(u.shape[1])
        u = u * (1.0 + warm * np.sin(2 * np.pi * clock / (0.6 * plan.clock.max())))
    return vehicle.scale * u


def _charge(u: Floats, plan: Plan) -> Floats:
    """Charge drawn since the campaign began as a share of all of it: current goes as moment to the 3/2."""
    own = np.cumsum(np.abs(u) ** 1.5, axis=1)
    order = np.argsort(plan.clock)
    before = np.zeros(len(u))
    before[order[1:]] = np.cumsum(own[order, -1])[:-1]
    return (before[:, None] + own) / own[:, -1].sum()


def _released(u: Floats, late: int) -> Floats:
    """Thrust that is let go `late` steps after it was told to, on either side."""
    out = u.copy()
    for k in range(1, late + 1):
        past = np.concatenate([np.zeros((len(u), k)), u[:, :-k]], axis=1)
        grown = np.where(np.sign(past) == np.sign(out), np.maximum(np.abs(past), np.abs(out)), np.abs(past))
        out = np.where((past != 0) & (np.sign(past) * out >= 0), np.sign(past) * grown, out)
    return out


def _stalling(u: Floats, width: float) -> Floats:
    """A propeller that starts above `width` and stalls below 0.45 of it."""
    out, runs = np.zeros_like(u), np.zeros(len(u), dtype=bool)
    for m in range(u.shape[1]):
        turned = m > 0 and u[:, m] * u[:, m - 1] < 0
        runs = np.where(np.abs(u[:, m]) > width, True, runs & (np.abs(u[:, m]) > 0.45 * width) & ~turned)
        out[:, m] = np.where(runs, u[:, m], 0.0)
    return out


def _followed(u: Floats, step: Callable[[Floats, Floats], Floats]) -> Floats:
    """What follows `u` (R, M) from zero on, column by column."""
    out, now = np.empty_like(u), np.zeros(len(u))
    for m in range(u.shape[1]):
        out[:, m] = now = step(now, u[:, m])
    return out


def headings(plan: Plan, vehicle: Vehicle, chance: Chance, step: float = STEP) -> Floats:
    """Headings (R, M + 1) that the sensor would read without noise, on the fine grid [rad]."""
    u = delivered(plan, vehicle, step)
    runs, steps = u.shape
    lag = next((vehicle.size(law) for law in LAGS if vehicle.size(law)), 0.0)
    kept = len(MEMORY) if vehicle.size("history") else 0
    y = np.zeros((4 + kept, runs))  # heading, rate, propeller, water, memory of the water
    y[0] = plan.heading
    out = np.empty((runs, steps + 1))
    out[:, 0] = y[0]
    dry = vehicle.scale * vehicle.size("coulomb")
    for m in range(steps):
        t, rest = m * step, (u[:, m], lag, plan, vehicle, chance, dry)
        k1 = _slope(t, y, *rest)
        k2 = _slope(t + step / 2, y + step / 2 * k1, *rest)
        k3 = _slope(t + step / 2, y + step / 2 * k2, *rest)
        k4 = _slope(t + step, y + step * k3, *rest)
        new = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if dry:  # what crosses rest within a step sticks there until the moment overcomes the friction
            new[1] = np.where(y[1] * new[1] < 0, 0.0, new[1])
        y = new
        out[:, m + 1] = y[0]
    read = _read(out, vehicle, step)
    if pull := vehicle.size("current-pull"):
        read[:, 1:] += pull * u / (LARGEST * vehicle.scale)
    return read


def _slope(
    t: float, y: Floats, aim: Floats, lag: float, plan: Plan, vehicle: Vehicle, chance: Chance, dry: float
) -> Floats:
    """Time derivative of the state (S, R)."""
    size, scale = vehicle.size, vehicle.scale
    psi, rate, propeller, water, memory = y[0], y[1], y[2], y[3], y[4:]
    d = np.zeros_like(y)
    wanted = np.sign(aim) * np.sqrt(np.abs(aim))
    speed = propeller if lag else wanted
    thrust = chance.gain * speed * np.abs(speed)
    if vehicle.size("thrust-lag"):
        thrust = chance.gain * propeller
    slip = rate - water
    drag = (vehicle.quadratic + size("quadratic")) * slip * np.abs(slip) + vehicle.linear * slip
    if wall := size("wall"):
        drag = drag * (1.0 + wall * np.cos(2 * psi))
    drag = drag + size("linear") * slip + size("cubic") * slip**3 + size("drag-asymmetry") * slip**2
    turned = psi - plan.heading
    moment = size("bias") - size("spring") * turned - size("hard-spring") * turned**3
    if taut := size("slack-spring"):
        moment = moment - taut * (np.maximum(turned - 2.0, 0.0) + np.minimum(turned + 2.0, 0.0))
    if push := size("heading-moment"):
        moment = moment + push * np.sin(psi - 0.9)
    if wave := size("waves"):
        moment = moment + wave * np.sin(2 * np.pi * t / size("wave-period") + chance.phase)
    if couple := size("surge"):
        moment = moment + couple * surge(chance.surge, np.asarray(t)) * rate
    if snag := size("snags"):
        near = np.exp(-0.5 * ((t - chance.snag_at) / 0.2) ** 2)
        moment = moment + snag * (chance.snag * near).sum(axis=1)
    total = thrust + scale * (moment - drag)
    total = total - np.sqrt(scale) * size("thrust-loss") * np.sqrt(np.abs(thrust)) * rate
    if feed := size("advance-loss"):
        fed = np.maximum(np.sign(thrust) * rate, 0.0)
        total = total - np.sqrt(scale) * feed * np.sqrt(np.abs(thrust)) * np.sign(thrust) * fed
    if stick := size("stribeck"):
        total = total - scale * stick * (0.4 + np.exp(-((rate / 0.12) ** 2))) * np.tanh(rate / 0.02)
    if history := size("history"):
        total = total - scale * history * (memory * 0.62 / np.sqrt(MEMORY)[:, None]).sum(axis=0)
    if dry:
        held = np.sign(total) * np.maximum(np.abs(total) - dry, 0.0)
        total = np.where(rate == 0, held, total - dry * np.sign(rate))
    d[0] = rate
    d[1] = total / (scale * vehicle.inertia)
    if lag:
        d[2] = _spun(vehicle, aim, wanted, propeller, lag)
    if stir := size("swirl"):
        d[3] = stir * slip * np.abs(slip) - water / 20.0
    if stir := size("swirl-passing"):
        d[3] = stir * slip * np.abs(rate) - water / 20.0
    if stir := size("swirl-jets"):
        d[3] = stir * thrust / scale - water / 20.0
    if stir := size("swirl-settling"):
        d[3] = stir * slip - water / np.where(stir * slip * water > water**2 / 8.0, 8.0, 25.0)
    if len(memory):
        d[4:] = d[1] - memory / MEMORY[:, None]
    return d


LAGS = ("propeller-lag", "thrust-lag", "loaded-lag", "slew", "lag-down")
"""Laws of the thrusters' state: of each campaign at most one."""


def _spun(vehicle: Vehicle, aim: Floats, wanted: Floats, propeller: Floats, lag: float) -> Floats:
    """Time derivative of the propeller's speed, or of the thrust, under the law that is hidden."""
    fastest = np.sqrt(LARGEST * vehicle.scale)
    if vehicle.size("thrust-lag"):
        return (aim - propeller) / lag
    if vehicle.size("loaded-lag"):  # a torque that spins it up, and the water's square that brakes it
        return (aim - propeller * np.abs(propeller)) / (2.0 * lag * fastest)
    if vehicle.size("slew"):
        return np.clip((wanted - propeller) / 0.02, -fastest / lag, fastest / lag)
    if vehicle.size("lag-down"):
        falls = (wanted - propeller) * propeller < 0
        return (wanted - propeller) / np.where(falls, 3.0 * lag, lag)
    return (wanted - propeller) / lag


def surge(last: Floats, time: Floats) -> Floats:
    """Surge speed [m/s] of vehicles that get under way to `last` [m/s] in some seconds."""
    return last * (1.0 - np.exp(-time / 3.0))


def _read(psi: Floats, vehicle: Vehicle, step: float) -> Floats:
    """What the sensor makes of true headings (R, M + 1)."""
    hard, soft = vehicle.size("hard-iron"), vehicle.size("soft-iron")
    if hard or soft:
        psi = compass(psi, hard, soft)
    if late := vehicle.size("sensor-lag"):
        out, now = psi.copy(), psi[:, 0].copy()
        keep = np.exp(-step / late)
        for m in range(1, psi.shape[1]):
            now = keep * now + (1 - keep) * 0.5 * (psi[:, m] + psi[:, m - 1])
            out[:, m] = now
        psi = out
    return psi + vehicle.size("gyro-drift") * step * np.arange(psi.shape[1])


def compass(heading: Floats, hard: float, soft: float) -> Floats:
    """What two magnetometers make of true headings [rad] with iron on board: each has an offset and its own gain."""
    x, y = (1 + soft) * np.cos(heading) + 0.6 * hard, (1 - soft) * np.sin(heading) + hard
    return heading + np.angle(np.exp(1j * (np.arctan2(y, x) - heading)))
