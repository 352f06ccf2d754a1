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
    last = len(time) - 2
    off = [time[2 + k : last + k] - time[2:last] for k in (-2, -1, 1, 2)]  # from the sample to its four neighbours
    residual, square = position[2:last].copy(), np.ones(len(time) - 4)
    for k, at in zip((-2, -1, 1, 2), off):  # Lagrange's weights
        weight = np.prod([other / (other - at) for other in off if other is not at], axis=0)
        residual -= weight * position[2 + k : last + k]
        square += weight**2
    sigma = NORMAL * median(np.abs(residual) / np.sqrt(square))
    moved = np.abs(np.diff(position))
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
    centred = time - time.mean()
    square = float(centred @ centred)
    return (float(centred @ (position - position.mean())) / square, square**-0.5) if square else (0.0, math.inf)


def summed(time: Floats, velocity: Floats) -> Floats:
    """Positions (N,) from zero on, by the trapezium over the samples."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])


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
