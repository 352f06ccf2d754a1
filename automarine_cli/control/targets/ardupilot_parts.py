"""What ArduPilot's stacks share: the gyro's low-pass, the square-root law of its angle loops, parameter files."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.quantities import Complexes, Floats


def gyro(slow: Floats, slower: Floats, velocity: Floats, dt: float, cutoff: float) -> tuple[Floats, Floats]:
    """A second-order low-pass of the rate (Butterworth) as state: its slope and its value after a loop."""
    w = 2.0 * np.pi * cutoff
    slow = (slow + dt * w * w * (velocity - slower)) / (1.0 + np.sqrt(2.0) * w * dt + (w * dt) ** 2)
    return slow, slower + dt * slow


def gyro_response(z: Complexes, dt: float, cutoff: float) -> Complexes:
    """The same in frequency."""
    ratio = (1.0 - 1.0 / z) / (2.0 * np.pi * cutoff * dt)
    return np.asarray(1.0 / (1.0 + np.sqrt(2.0) * ratio + ratio * ratio))


@dataclass(frozen=True)
class RootLaw:
    """Velocity towards a target: in proportion to what is left near it, further off the one from which `limit` can
    still stop, in loops of `step` [s] never beyond the target; in proportion everywhere where the limit is 0."""

    gain: Floats
    near: Floats
    twice: Floats
    step: float

    @classmethod
    def of(cls, gain: Floats, limit: Floats, step: float) -> "RootLaw":
        """With what every loop needs worked out once."""
        gain = np.maximum(gain, 1e-6)
        return cls(gain, np.where(limit > 0, limit, np.inf) / gain**2, 2.0 * np.where(limit > 0, limit, 0.0), step)

    def __call__(self, error: Floats) -> Floats:
        """The velocity for what is left."""
        size = np.abs(error)
        far = size > self.near
        wish = self.gain * size
        if far.any():
            wish = np.where(far, np.sqrt(self.twice * np.maximum(size - 0.5 * self.near, 0.0)), wish)
        return np.copysign(np.minimum(wish, size / self.step), error)


def distance_to(velocity: Floats, gain: Floats, limit: Floats) -> Floats:
    """What is left where `RootLaw` asks for a velocity."""
    near = limit / np.maximum(gain, 1e-6)
    far = 0.5 * limit / np.maximum(gain, 1e-6) ** 2 + velocity**2 / (2.0 * limit)
    return np.asarray(np.where(velocity < near, velocity / np.maximum(gain, 1e-6), far))


def params(rows: Sequence[tuple[str, float]], head: Sequence[str]) -> str:
    """A parameter file as ground stations read it."""
    lines = [f"# {line}" for line in head]
    return "\n".join([*lines, *(f"{name},{value:.6g}" for name, value in rows)]) + "\n"
