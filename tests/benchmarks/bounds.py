"""The Cramer-Rao bound of model 3's inertia and drag from half-turn headings, by its own algebra.

With x = sqrt(|tau| k) t/I the heading is psi0 + sgn(tau) (I/k) ln cosh x, so that

    dpsi/dI = sgn(tau) (ln cosh x - x tanh x)/k,       dpsi/dk = sgn(tau) (I/k²) (x tanh x/2 - ln cosh x),
    dpsi/dt0 = -sgn(tau) sqrt(|tau|/k) tanh x,         all zero before the step; the rate's are their derivatives,

    dr/dI = -sgn(tau) sqrt(|tau|/k) sech² x x/I,       dr/dk = sgn(tau) sqrt(|tau|/k) (sech² x x - tanh x)/(2 k),
    dr/dt0 = -tau/I sech² x.

Nothing here comes from the package: the samples are given as plain arrays.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

Floats = NDArray[np.float64]

Instants = Literal["known", "uniform", "gaussian"]


def fisher_information(
    time: Floats,
    seen: NDArray[np.bool_],
    moment: Floats,
    truth: tuple[float, float],
    noise: float,
    *,
    instants: Instants = "known",
    interval: float = 0.1,
    rate_noise: float | None = None,
) -> Floats:
    """Information on (I, k), and on the common offset [s] of the instants unless they are known.

    `time` (R, N) [s] since the true switch, `seen` (R, N), `moment` (R,), `noise` [rad]. With `instants`
    known so are the start headings. Otherwise each run's start heading is free (samples with negative time
    are its rest), and its own instant lies in an `interval` [s]: "uniform" is the information in the marginal
    density with the response linear in the instant, "gaussian" that with a normal density of equal variance.
    `rate_noise` [rad/s] is that of a gyro with a bias of its own in each run, read at the same samples.
    """
    inertia, k = truth
    t = np.maximum(time, 0.0)
    side = np.sign(moment)[:, None] * seen
    size = np.abs(moment)[:, None]
    x = np.sqrt(size * k) * t / inertia
    log_cosh = x - np.log(2.0) + np.log1p(np.exp(-2.0 * x))
    by_inertia = side * (log_cosh - x * np.tanh(x)) / k
    by_drag = side * inertia / k**2 * (x * np.tanh(x) / 2.0 - log_cosh)
    columns = np.stack([by_inertia, by_drag], axis=2)
    by_instant = -side * np.sqrt(size / k) * np.tanh(x)
    channels = [(columns / noise, by_instant / noise, instants != "known")]
    if rate_noise is not None:
        bend = side * np.where(time > 0, 1.0 / np.cosh(np.minimum(x, 300.0)) ** 2, 0.0)
        pace = np.sqrt(size / k)
        of_drag = -0.5 * pace / k * side * np.tanh(x) + pace * bend * x / (2.0 * k)
        of_rate = np.stack([-pace * bend * x / inertia, of_drag], axis=2)
        channels.append((of_rate / rate_noise, -size / inertia * bend / rate_noise, True))
    total = np.zeros((3, 3))
    for i, mask in enumerate(seen):
        rows = [(_free(j[i][mask], free), _free(v[i][mask], free)) for j, v, free in channels]
        j, v = (np.concatenate(part) for part in zip(*rows))
        if instants == "known":
            total[:2, :2] += j.T @ j
            continue
        slope = j.T @ v / (v @ v)
        rest = j - np.outer(v, slope)
        total[:2, :2] += rest.T @ rest
        reading = np.append(slope, 1.0)  # how the run's estimated instant moves with (I, k, offset)
        total += location_information(1.0 / np.sqrt(v @ v), interval, instants) * np.outer(reading, reading)
    return total[:2, :2] if instants == "known" else total


def _free(column: Floats, free: bool) -> Floats:
    """A column (n, ...) without what a constant of the run takes of it, if there is a free one."""
    return column - column.mean(axis=0) if free else column


def location_information(sd: float, width: float, instants: Instants) -> float:
    """Information on the centre in one reading with normal error `sd` of a point drawn around that centre.

    For "uniform" on `width`, the integral of g'²/g of the density g = (Phi(a) - Phi(b))/width.
    """
    if instants == "gaussian":
        return 1.0 / (sd**2 + width**2 / 12.0)
    x = np.linspace(-8.0 * sd, width / 2.0 + 8.0 * sd, 20001) - width / 2.0  # the left edge is enough
    x = x[x <= 0.0]
    low, high = (x + width / 2.0) / sd, (x - width / 2.0) / sd
    density = np.exp(log_ndtr(low)) - ndtr(high)
    slope = (np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)) / np.sqrt(2.0 * np.pi) / sd
    return float(2.0 * np.trapezoid(slope**2 / np.maximum(density, 1e-300), x) / width)


def bound(information: Floats, *, offset_known: bool = False) -> Floats:
    """Smallest variances of unbiased estimates of I and k, (2,)."""
    kept = information[:2, :2] if offset_known else information
    return np.asarray(np.diagonal(np.linalg.inv(kept))[:2])
