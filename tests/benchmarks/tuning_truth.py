"""Vehicles with a known truth for the benchmark of `tune`: nothing here knows the library's equations.

Its integrator (Heun, 5 ms, all runs at once) and its laws take other forms than the library's where nature allows: a
propeller that follows its speed, a dead-band that cuts, dry friction that sticks, water stirred up by a turbulent law,
a saturation that bends, thrust that falls with the charge drawn, a speed controller with a dead-band and a power law.
Moments are outputs from -1 to 1.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
STEP = 0.005  # s
SIZES: dict[str, tuple[float, float]] = {
    "propeller-lag": (0.08, 0.4), "delay": (0.08, 0.4), "cut": (0.04, 0.12), "sticks": (0.01, 0.04),
    "swirl": (0.05, 0.15), "cubic": (0.1, 0.8), "bends": (0.2, 0.6), "uneven": (0.05, 0.2), "spring": (0.005, 0.03),
    "charge": (0.05, 0.2), "sensor-lag": (0.1, 0.3), "thrust-lag": (0.08, 0.4),
}  # fmt: skip
"""What may be hidden, and its smallest and largest size."""


@dataclass(frozen=True)
class Truth:
    """A vehicle: inertia and drag per moment of the whole output, what is hidden with its size, scatter of thrust."""

    inertia: float
    quadratic: float
    linear: float
    hidden: Mapping[str, float]
    scatter: float = 0.03

    @classmethod
    def drawn(cls, number: int) -> "Truth":
        """A vehicle with one or two things hidden."""
        random = np.random.default_rng([number, 18])
        names = random.choice(list(SIZES), size=int(random.integers(1, 3)), replace=False)
        sizes = {str(name): float(random.uniform(*SIZES[name])) for name in names}
        inertia = float(np.exp(random.uniform(np.log(0.1), np.log(1.2))))
        return cls(inertia, float(random.uniform(0.4, 1.6)), float(random.choice([0.0, 0.1])), sizes)

    @classmethod
    def late(cls, number: int) -> "Truth":
        """A vehicle that is late by a lag and a delay and hides nothing else; the odd ones are quick and light."""
        random, quick = np.random.default_rng([number, 20]), number % 2
        inertia = float(np.exp(random.uniform(*np.log((0.06, 0.3) if quick else (0.2, 1.2)))))
        late = random.uniform(0.05, 0.12, 2) if quick else random.uniform(0.08, 0.24, 2)
        drag = float(random.uniform(0.15, 0.6) if quick else random.uniform(0.4, 1.6))
        hidden = {"thrust-lag": float(late[0]), "delay": float(late[1])}
        return cls(inertia, drag, float(random.choice([0.0, 0.1])), hidden, float(random.uniform(0.0, 0.03)))

    @classmethod
    def driven(cls, number: int) -> "Truth":
        """A small vehicle behind speed controllers: thrust as a power of the command beyond a dead-band."""
        random = np.random.default_rng([number, 21])
        power, idle = ((2.0, 0.1), (1.6, 0.06), (2.0, 0.0), (1.8, 0.08))[number % 4]
        inertia, drag = float(random.uniform(0.05, 0.1)), float(random.uniform(0.08, 0.2))
        hidden = {"power": power, "idle": idle, "thrust-lag": float(random.uniform(0.05, 0.08))}
        return cls(inertia, drag, 0.0, hidden | {"delay": float(random.uniform(0.05, 0.08))}, 0.02)

    @classmethod
    def limited(cls, number: int) -> "Truth":
        """A vehicle that is late, has a dead-band, a curved thrust or little authority, by turns."""
        random, kind = np.random.default_rng([number, 23]), number % 4
        heavy = random.uniform(*np.log((1.5, 5.0) if kind == 3 else (0.1, 1.0)))
        delay = random.uniform(*((0.1, 0.4) if kind == 0 else (0.04, 0.1)))
        hidden = {"delay": float(delay), "thrust-lag": float(random.uniform(0.05, 0.15))}
        idle, power = float(random.uniform(0.02, 0.08)), float(random.uniform(1.3, 2.0))
        curve = {1: {"power": 1.0, "idle": idle}, 2: {"power": power, "idle": 0.0}}.get(kind, {})
        return cls(float(np.exp(heavy)), float(random.uniform(0.3, 1.5)), 0.0, hidden | curve, 0.02)

    def size(self, law: str) -> float:
        """Size of one law, zero where it is not hidden."""
        return self.hidden.get(law, 0.0)


class Vehicle:
    """R runs of one vehicle, advanced together from rest."""

    def __init__(self, truth: Truth, gain: Floats) -> None:
        self.truth, self.gain = truth, gain
        zero = np.zeros(len(gain))
        self.heading, self.rate, self.shown = zero, zero, zero
        self._speed, self._water, self._charge = zero, zero, zero
        self._late = [zero] * (round(truth.size("delay") / STEP) + 1)

    def advance(self, output: Floats, load: Floats | float = 0.0) -> None:
        """One step under an output held over it, against a `load`."""
        size = self.truth.size
        self._late = [*self._late[1:], np.clip(output, -1.0, 1.0)]
        thrust = self._late[0]
        if cut := size("cut"):
            thrust = np.where(np.abs(thrust) > cut, thrust, 0.0)
        if power := size("power"):
            rest = np.maximum(np.abs(thrust) - size("idle"), 0.0) / (1.0 - size("idle"))
            thrust = np.sign(thrust) * rest**power
        if bends := size("bends"):
            thrust = np.tanh(bends * thrust * 2.0) / np.tanh(bends * 2.0)
        thrust = thrust * (1.0 + np.where(thrust > 0, 0.5, -0.5) * size("uneven"))
        self._charge = self._charge + np.abs(thrust) ** 1.5 * STEP / 60.0
        thrust = thrust * np.exp(-size("charge") * self._charge)
        if lag := size("propeller-lag"):
            wanted = np.sign(thrust) * np.sqrt(np.abs(thrust))
            self._speed = self._speed + (wanted - self._speed) * -np.expm1(-STEP / lag)
            thrust = self._speed * np.abs(self._speed)
        elif lag := size("thrust-lag"):
            thrust = self._speed = self._speed + (thrust - self._speed) * -np.expm1(-STEP / lag)
        moment = self.gain * thrust - load
        first = self._acceleration(self.heading, self.rate, moment)
        there = self.rate + STEP * first
        second = self._acceleration(self.heading + STEP * self.rate, there, moment)
        after = self.rate + 0.5 * STEP * (first + second)
        if stick := size("sticks"):  # dry friction takes at most all of the rate, and holds what does not push harder
            after = np.sign(after) * np.maximum(np.abs(after) - STEP * stick / self.truth.inertia, 0.0)
        self.heading = self.heading + 0.5 * STEP * (self.rate + after)
        self.rate = after
        self._water = self._water + STEP * size("swirl") * np.abs(self.rate) * (self.rate - 3.0 * self._water)
        lag = size("sensor-lag")
        self.shown = self.heading if not lag else self.shown + (self.heading - self.shown) * -np.expm1(-STEP / lag)

    def _acceleration(self, heading: Floats, rate: Floats, moment: Floats) -> Floats:
        truth, through = self.truth, rate - self._water
        drag = truth.linear * through + truth.quadratic * np.abs(through) * through + truth.size("cubic") * through**3
        return (moment - drag - truth.size("spring") * heading) / truth.inertia


Plans = list[tuple[str, float, Callable[..., Floats]]]


def write_logs(
    truth: Truth, folder: Path, random: np.random.Generator, noise_deg: float = 0.7, steps: bool = False
) -> None:
    """A pool day of 24 runs at 10 Hz, to both sides: steps and their coasts, reversals, square waves, ramps; or steps
    alone."""
    folder.mkdir(parents=True, exist_ok=True)
    clock = 0.0
    for name, seconds, command in _steps() if steps else _pool_day():
        time = np.arange(0.0, seconds, 0.1)
        vehicle, headings = Vehicle(truth, np.exp(truth.scatter * random.standard_normal(1))), []
        outputs = command(time)
        for output in outputs:
            headings.append(float(vehicle.shown[0]))
            for _ in range(20):
                vehicle.advance(np.array([output]))
        read = np.rad2deg(headings) + noise_deg * random.standard_normal(len(time))
        rows = [f"{clock + t:.3f},{h:.3f},{u:.6g}" for t, h, u in zip(time, read, outputs)]
        (folder / f"{name}.csv").write_text("\n".join(["time_s,heading_deg,tau", *rows]) + "\n")
        clock += seconds + 90.0


def _steps() -> Plans:
    sizes = (0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
    return [
        (f"step_{again}_{side * size:+g}", 10.0, lambda t, m=side * size: m * (t >= 1.0))
        for again in (0, 1)
        for side in (1.0, -1.0)
        for size in sizes
    ]


def _pool_day() -> Plans:
    plans: Plans = []
    for side, name in ((1.0, "+"), (-1.0, "-")):
        for size in (0.1, 0.2, 0.35, 0.5, 0.75, 1.0):
            plans.append((f"step_{name}{size}", 12.0, lambda t, m=side * size: m * ((t >= 2) & (t < 8))))
        for size in (0.3, 0.6, 0.9):
            back = f"back_{name}{size}"
            plans.append((back, 14.0, lambda t, m=side * size: m * ((t >= 2) & (t < 6)) - m * ((t >= 6) & (t < 9))))
        for size, beat in ((0.8, 1.0), (0.4, 2.0)):
            plans.append((f"square_{name}{size}", 16.0, lambda t, m=side * size, b=beat: _square(t, m, b)))
        plans.append((f"ramp_{name}", 20.0, lambda t, m=side: m * np.round(np.clip((t - 2) / 16, 0.0, 1.0) * 0.6, 2)))
    return plans


def _square(t: Floats, moment: float, beat: float) -> Floats:
    return moment * np.sign(np.sin(np.pi * (t - 2.0) / beat) + 1e-9) * (t >= 2.0)
