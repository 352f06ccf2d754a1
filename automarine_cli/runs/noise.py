"""Heading noise measured from the log alone, without any model of the vehicle."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NORMAL = 1.4826  # median absolute value of a normal variable -> its standard deviation


def heading_noise(time: Floats, heading: Floats) -> float:
    """Standard deviation [rad] of the white noise on a heading of shape (N,); 0 for fewer than 7 samples.

    Each sample is compared with the cubic through two neighbours on either side at their true times, which
    removes any smooth turn and any clock jitter; the median makes glitches harmless. A quantised heading that
    often repeats itself has at least its quantum / sqrt(12).
    """
    if len(time) < 7:
        return 0.0
    offsets, centre = (-2, -1, 1, 2), slice(2, len(time) - 2)
    at = [time[2 + k : len(time) - 2 + k] for k in offsets]
    weights = []
    for j in range(4):
        weight = np.ones(len(time) - 4)
        for m in range(4):
            if m != j:
                weight = weight * (time[centre] - at[m]) / (at[j] - at[m])
        weights.append(weight)
    predicted = sum(w * heading[2 + k : len(time) - 2 + k] for w, k in zip(weights, offsets))
    spread = np.sqrt(1.0 + sum(w**2 for w in weights))
    sigma = NORMAL * float(np.median(np.abs((heading[centre] - predicted) / spread)))
    return max(sigma, _quantum(heading) / np.sqrt(12))


def _quantum(heading: Floats) -> float:
    """Smallest step of a heading that repeats itself in a third of its samples or more, else 0 [rad]."""
    steps = np.abs(np.diff(heading))
    still = steps < 1e-9
    if still.mean() < 1 / 3 or still.all():
        return 0.0
    return float(steps[~still].min())


def slope(time: Floats, heading: Floats) -> tuple[float, float]:
    """Least-squares slope [rad/s] and its standard error for a noise of 1 rad a sample; (0, inf) for one
    sample.
    """
    centred = time - time.mean()
    square = float(centred @ centred)
    if square == 0:
        return 0.0, np.inf
    return float(centred @ (heading - heading.mean())) / square, 1 / np.sqrt(square)
