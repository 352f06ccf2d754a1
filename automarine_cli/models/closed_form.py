"""Exact response of models 1, 2 and 3 to a constant moment, from any start rate.

With a = |tau|/I, b = k_r/I, c = k_rr/I the rate obeys, once it has the moment's sign, the Riccati equation
r' = a - b r - c r². Its solution needs one formula for all three models:

    delta = sqrt(b²/4 + a c),   r_inf = a/(delta + b/2),   z(t) = (r_inf - r0) (1 - exp(-2 delta t))/(2 delta)
    psi(t) = psi0 + r_inf t + ln(1 - c z)/c,    r(t) = r_inf - (r_inf - r0) exp(-2 delta t)/(1 - c z)

For c = 0 the logarithm becomes -z, the paper's equation 6; for b = 0 and r0 = 0 it is the paper's ln cosh
(equation 8). From rest the heading ends on a line through eps = psi0 - sgn(tau) (I/k_rr) ln(1 + r_inf/r_2) at the
instant of the step, where r_2 = (delta + b/2)/c is the size of the other root: equation 9 for k_r = 0, equation 7 for
k_rr = 0. While the vehicle still turns against the moment drag helps the moment: the same formula holds for the size
of the rate with a replaced by -a (delta may become imaginary), until the rate is zero.
"""

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli.quantities import Floats


def response(
    time: ArrayLike,
    moment: ArrayLike,
    inertia: ArrayLike,
    k_r: ArrayLike = 0.0,
    k_rr: ArrayLike = 0.0,
    heading0: ArrayLike = 0.0,
    rate0: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Heading [rad] and rate [rad/s] at `time` [s] after a constant moment was switched on.

    All inputs broadcast. Before the switch (time < 0) the vehicle is taken to turn on at `rate0`.
    Drag must be positive somewhere (k_r > 0 or k_rr > 0). Source: module docstring.
    """
    time, moment, rate0 = (np.asarray(x, dtype=float) for x in (time, moment, rate0))
    forward = np.where(moment != 0, np.sign(moment), np.sign(rate0))
    t = np.maximum(time, 0.0)
    a, b, c = _scaled(moment, inertia, k_r, k_rr)
    start = forward * rate0
    if np.any(start < 0):
        turned, rate = _against(t, a, b, c, start)
    else:
        turned, rate = _with(t, a, b, c, start)
    early = np.minimum(time, 0.0)
    return heading0 + forward * turned + early * rate0, np.where(time < 0, rate0, forward * rate)


def velocity_error(moment: ArrayLike, inertia: ArrayLike, k_r: ArrayLike = 0.0, k_rr: ArrayLike = 0.0) -> Floats:
    """Intercept at the step's instant of the line on which the heading ends, start heading removed [rad].

    -sgn(tau) (I/k_rr) ln(1 + r_inf/r_2); equation 7 for k_rr = 0, equation 9 for k_r = 0. Not a number where a
    negative k_rr leaves no steady rate.
    """
    a, b, c = _scaled(moment, inertia, k_r, k_rr)
    with np.errstate(divide="ignore", invalid="ignore"):
        delta = np.sqrt(b * b / 4 + a * c)
        gap = np.where(a > 0, a / (delta + b / 2) / (2 * delta), 0.0)
        return np.sign(moment) * _log_ratio(c, gap)


def inertia_from_velocity_error(eps: ArrayLike, moment: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> Floats:
    """Inertia that gives the velocity error `eps` [rad] of the size expected for `moment`; inverse of
    `velocity_error`.

    eps is proportional to the inertia: I = |eps| k_r²/|tau| (equation 7), |eps| k_rr/ln 2 (equation 9), and
    between them for model 2. The sign is kept: a velocity error on the wrong side gives a negative inertia.
    """
    return np.asarray(eps) / velocity_error(moment, 1.0, k_r, k_rr)


def _scaled(moment: ArrayLike, inertia: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> tuple[Floats, Floats, Floats]:
    size, linear, quadratic = (np.asarray(x, dtype=float) for x in (np.abs(moment), k_r, k_rr))
    mass = np.asarray(inertia, dtype=float)
    return size / mass, linear / mass, quadratic / mass


def _with(t: Floats, a: Floats, b: Floats, c: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Angle turned and rate, in the moment's direction, once the rate has the moment's sign."""
    delta, final = _roots(a, b, c)
    decayed = np.expm1(-2 * delta * t)
    with np.errstate(divide="ignore", invalid="ignore"):
        # (1 - exp(-2 delta t))/(2 delta), and t where delta is zero (coasting with quadratic drag alone)
        mean_decay = decayed * (-0.5 / delta) if np.all(delta > 0) else np.where(delta > 0, decayed / (-2 * delta), t)
    z = (final - start) * mean_decay
    return final * t + _log_ratio(c, z), final - (final - start) * (1 + decayed) / (1 - c * z)


def _roots(a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats]:
    delta = np.sqrt(b * b / 4 + a * c)
    with np.errstate(divide="ignore", invalid="ignore"):
        final = np.where(a > 0, a / (delta + b / 2), 0.0)
        return delta, np.where((b < 0) & (c > 0), (delta - b / 2) / c, final)  # standstill repels where drag drives


def _against(t: Floats, a: Floats, b: Floats, c: Floats, start: Floats) -> tuple[Floats, Floats]:
    """As `_with`, for starts that turn against the moment: first to standstill, then on as from rest."""
    t, a, b, c, start = (np.array(x) for x in np.broadcast_arrays(t, a, b, c, start))
    speed = np.maximum(-start, 0.0)
    delta = np.sqrt((b * b / 4 - a * c).astype(complex))
    delta = np.where(np.abs(delta) < 1e-9, 1e-9, delta)
    resisted = np.where(a + b * speed / 2 > 0, a + b * speed / 2, 1.0)  # only coasting has none, and it never brakes
    stop = np.real(np.arctanh(delta * speed / resisted) / delta)
    braking = np.minimum(t, stop)
    final = -a / (delta + b / 2)
    z = (final - speed) * -np.expm1(-2 * delta * braking) / (2 * delta)
    c_safe = np.where(np.abs(c) * np.abs(z) < 1e-8, 1.0, c)
    logarithm = np.where(np.abs(c) * np.abs(z) < 1e-8, -z - c * z * z / 2, np.log1p(-c_safe * z) / c_safe)
    angle = np.real(final * braking + logarithm)
    rate = np.real(final - (final - speed) * np.exp(-2 * delta * braking) / (1 - c * z))
    onward, onward_rate = _with(t - braking, a, b, c, np.maximum(start, 0.0))
    return onward - angle, np.where(t < stop, -rate, onward_rate)


def _log_ratio(c: Floats, z: Floats) -> Floats:
    """ln(1 - c z)/c, by its series where c z is tiny (no quadratic drag)."""
    product = np.asarray(c * z)
    tiny = np.abs(product) < 1e-7
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.asarray(np.log1p(-product) / c)
    ratio[tiny] = -np.broadcast_to(z, product.shape)[tiny] * (1 + product[tiny] / 2)
    return ratio
