"""Noise of a position measured from the log alone, without any model of the vehicle."""

import math

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

NORMAL = 1.4826  # median absolute value of a normal variable -> its standard deviation
SAME = 1e-9  # rad or m; positions closer than this are one
HELD = 0.2  # Share of exact repeats from which on a sensor is slower than the log, and its repeats are no readings
FLAT = 3.0
"""Times the smallest step of a quantised sensor that its usual steps have to have for repeats to be held values."""


def position_noise(time: Floats, position: Floats) -> float:
    """Estimate the standard deviation [rad or m] of the white noise on a position of shape (N,); 0 if N < 7.

    Each sample is compared with the cubic through two neighbours on either side at their true times, which
    removes any smooth motion and any clock jitter; the median makes glitches harmless. A quantised position that
    often repeats itself has at least its quantum / sqrt(12).
    """
    if len(time) < 7:
        return 0.0
    last, step = len(time) - 2, time[1:] - time[:-1]
    # from each of the four neighbours to the sample, and between neighbours
    near, far = step[1:-2], step[2:-1]
    off = (step[:-3] + near, near, -far, -(far + step[3:]))
    apart = {(j, m): off[j] - off[m] for j in range(4) for m in range(j + 1, 4)}
    before, after = off[0] * off[1], off[2] * off[3]
    weights = (
        off[1] * after / (-apart[0, 1] * apart[0, 2] * apart[0, 3]),
        off[0] * after / (apart[0, 1] * apart[1, 2] * apart[1, 3]),
        before * off[3] / (-apart[0, 2] * apart[1, 2] * apart[2, 3]),
        before * off[2] / (apart[0, 3] * apart[1, 3] * apart[2, 3]),
    )
    residual, square = position[2:last].copy(), np.ones(len(time) - 4)
    for weight, k in zip(weights, (-2, -1, 1, 2)):
        residual -= weight * position[2 + k : last + k]
        square += weight * weight
    sigma = NORMAL * median(np.abs(residual) / np.sqrt(square))
    moved = np.abs(position[1:] - position[:-1])
    still = moved < SAME
    if np.count_nonzero(still) >= len(still) / 3 and not still.all():
        sigma = max(sigma, float(moved[~still].min()) / np.sqrt(12))
    return sigma


def median(values: Floats) -> float:
    return float(np.median(values))


def slope(time: Floats, position: Floats) -> tuple[float, float]:
    """Least-squares slope [rad/s or m/s] and its standard error for a noise of 1 rad or m a sample; (0, inf) for one
    sample.
    """
    centred = time - np.add.reduce(time) / len(time)
    square = float(centred @ centred)
    if square == 0:
        return 0.0, math.inf
    return float(centred @ (position - np.add.reduce(position) / len(time))) / square, 1 / math.sqrt(square)


def fresh_readings(read: Floats) -> NDArray[np.bool_]:
    """The samples (N,) whose readings do not only hold the one before, because the sensor is slower than the log.

    A quantised sensor repeats itself honestly; its steps are then mostly of one quantum.
    """
    found = np.isfinite(read)
    at = np.flatnonzero(found)
    if len(at) < 3:
        return found
    moved = np.abs(np.diff(read[at]))
    same = moved < 1e-9
    if same.mean() < HELD or same.all() or np.median(moved[~same]) < FLAT * moved[~same].min():
        return found
    found[at[1:][same]] = False
    return found
