"""What ArduPilot's stacks share: the gyro's low-pass, the square-root law of its angle loops, parameter files."""

from collections.abc import Sequence

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


def root_law(error: Floats, gain: Floats | float, limit: Floats, dt: float) -> Floats:
    """Velocity towards a target: in proportion near it, further off the one from which `limit` can still stop; never
    beyond the target within one loop; without a limit in proportion everywhere."""
    size = np.abs(error)
    near = np.where(limit > 0, limit, np.inf) / (gain * gain)
    far = np.sqrt(2.0 * np.where(limit > 0, limit, 0.0) * np.maximum(size - 0.5 * np.where(limit > 0, near, 0.0), 0.0))
    return np.asarray(np.sign(error) * np.minimum(np.where(size > near, far, gain * size), size / dt))


def distance_to(velocity: Floats, gain: Floats, limit: Floats) -> Floats:
    """The error at which `root_law` asks for a velocity."""
    near = limit / np.maximum(gain, 1e-6)
    far = 0.5 * limit / np.maximum(gain, 1e-6) ** 2 + velocity**2 / (2.0 * limit)
    return np.asarray(np.where(velocity < near, velocity / np.maximum(gain, 1e-6), far))


def params(rows: Sequence[tuple[str, float]], head: Sequence[str]) -> str:
    """A parameter file as ground stations read it."""
    lines = [f"# {line}" for line in head]
    return "\n".join([*lines, *(f"{name},{value:.6g}" for name, value in rows)]) + "\n"
