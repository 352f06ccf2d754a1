"""A position where the log has only a velocity: the sum of it, less what the sensor reads at standstill."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.runs.noise import NORMAL, median, slope

Floats = NDArray[np.float64]

FEWEST = 5
"""Samples of a standstill."""
SURE = 4.0
"""Standard errors within which the readings of a standstill show no trend."""


def summed_position(time: Floats, velocity: Floats, command: Floats, dof: Dof) -> Floats:
    """Positions (N,) from zero on, by the trapezium over the samples; all arguments (N,)."""
    still = velocity - standstill(time, velocity, command, dof)
    steps = 0.5 * (still[1:] + still[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def standstill(time: Floats, velocity: Floats, command: Floats, dof: Dof) -> float:
    """What the sensor reads before the first command, if the vehicle stands still there; else zero.

    It does if the readings have no trend, and are of a size that a sensor may have as a bias.
    """
    acting = command != (command[0] if dof.has_constant else 0.0)
    first = int(np.argmax(acting)) if acting.any() else 0
    if first < FEWEST:
        return 0.0
    read = velocity[:first]
    trend, doubt = slope(time[:first], read)
    steps = np.diff(read)
    noise = NORMAL * median(np.abs(steps - np.median(steps))) / np.sqrt(2.0)
    level = float(np.median(read))
    return (
        level
        if abs(trend) <= SURE * doubt * noise + 1e-12 and abs(level) <= 3.0 * dof.limits.bias_sd
        else 0.0
    )
