"""What stacks are made of: filters, holds and limits of a loop, and the maps from design numbers to gains."""

import numpy as np

from automarine_cli.quantities import Complexes, Floats


def share(step: float, cutoff: Floats | float) -> Floats:
    """Return the weight of the new value in a low-pass of `cutoff` [Hz] at loops of `step` [s]; 0 Hz is none."""
    rate = 2.0 * np.pi * step * np.asarray(cutoff, dtype=float)
    return np.where(rate > 0, rate / (1.0 + rate), 1.0)


def low_pass(weight: Floats, z: Complexes) -> Complexes:
    """Return the response of a low-pass of a `weight` at z."""
    return np.asarray(weight / (1.0 - (1.0 - weight) / z))


def hold(s: Complexes, step: float) -> Complexes:
    """Return the response at s of an output that is held over each loop of `step` [s]."""
    return np.asarray((1.0 - np.exp(-s * step)) / (s * step))


def within(value: Floats, most: Floats | float) -> Floats:
    return np.minimum(np.maximum(value, -most), most)


def summed(integral: Floats, grown: Floats, now: Floats, error: Floats) -> Floats:
    """Return the integrator after a loop: `grown`, unless the limited output would be carried further."""
    out = now + grown
    return np.where((np.abs(out) > 1.0) & (out * error > 0), integral, grown)


def spread(number: Floats, low: float, high: float) -> Floats:
    """Map a design number between 0 and 1 to one between `low` and `high`, in equal ratios."""
    return np.asarray(low * (high / low) ** number)


def leads(number: Floats) -> Floats:
    """Map a design number to the time of a derivative, in shares of all that is slow: none up to a fifth, then up to
    one and a half times as long."""
    return np.asarray(1.5 * np.maximum(number - 0.2, 0.0) / 0.8)
