"""What ArduPilot's stacks share: the gyro's low-pass, the square-root law of its angle loops, parameter files."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from automarine_cli.control.targets.base import Design, Target
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


class ParameterFile(Target):
    """A target whose file is what ground stations read; `of` says whose gains are in it."""

    of: ClassVar[str]

    def text(self, design: Design) -> str:
        """What is searched, with what it was before."""
        names = [one.name for one in self.parameters if one.searched]
        before = [f"{name} was {design.before[name]:.6g}" for name in names if name in design.before]
        head = f"{self.of} gains for {self.firmware}; names and units may differ in other versions."
        lines = [f"# {line}" for line in (head, *design.notes, *before)]
        return "\n".join([*lines, *(f"{name},{design.gains[name]:.6g}" for name in names)]) + "\n"
