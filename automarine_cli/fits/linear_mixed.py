"""The linear half of the mixed model: every run reduced to its inner products, then variances, parameters
and run effects.

About the present point (phi0, b0) run i is  r_i = J_i phi + V_i (b_i - b0_i) + noise,  noise ~ N(0, s² 1),
b_i ~ N(0, D_i), with r_i its residual and phi the change from phi0: r_i + V_i b0_i has covariance
R_i = s² 1 + V_i D_i V_i'. R_i^-1 acts through the small matrix K = s² 1 + L V'V L with D = L² (Woodbury), which also
works where an entry of D is zero. Because R^-1 V L = V L K^-1, the present b0 enters without ever being
multiplied by V: sums of squares of headings of many radians, of which nothing but noise would remain, are
never formed. Several channels, each with a noise s_c of its own, are one weighted sum of inner products: samples of
channel c count (s_1/s_c)² times.
Shapes: runs R, parameters p, run effects q, channels C. Variances are the logarithms of C noises and of the factors.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.gram import Gram, Grams
from automarine_cli.fits.run_effects import RunEffects
from automarine_cli.quantities import Floats

NO_MOTION = "the runs show no motion to fit a model to; check the logs with `automarine check`"
SMALLEST_FACTOR = 1e-5
FEW = 4
"""Run effects up to which equations are solved row by row, all runs at once."""


class NotFinite(FitError):
    """Simulations run out of all bounds. Who knows the motion says so in its words, see `in_words_of`."""


def not_finite(position: str, force: str) -> str:
    """The sentence, by what the position and what drives it are called."""
    return (
        f"no motion of a vehicle fits these runs: simulated {position}s diverge; check the logs with `automarine "
        f"check` for gaps, a wrong clock, or wrong units or signs of {position} and {force} (--columns)"
    )


@contextmanager
def in_words_of(dof: Dof) -> Iterator[None]:
    """What is refused inside as not finite is refused in the words of a motion."""
    try:
        yield
    except NotFinite:
        raise FitError(not_finite(dof.words.position, dof.words.force)) from None


@dataclass(frozen=True)
class Weighted:
    """Each run's share of the normal equations at given variances: H (R, p, p), h (R, p), w'w (R,), log|R_i|
    (R,), with w = r + V b0.

    Of the run effects in units of their prior deviation: `left` (R, q) is the share of the variance that the
    data leave, `means` (R, q) the posterior mean at phi = 0, `by_phi` (R, q, p) what it loses per phi, and `spread`
    (R, q, q) their posterior covariance.
    """

    hessian: Floats
    gradient: Floats
    square: Floats
    log_det: Floats
    left: Floats
    means: Floats
    by_phi: Floats
    spread: Floats


def weigh(grams: Grams, effects: RunEffects, variances: Floats) -> Weighted:
    """Apply R_i^-1 to every inner product. Raises FitError where the response was not finite."""
    if not grams.is_finite:
        raise NotFinite(not_finite("position", "command"))
    gram = grams.at(variances)
    s2 = np.exp(2.0 * variances[0])
    scale = effects.deviation(variances)
    q = scale.shape[1]
    try:
        root = np.asarray(np.linalg.cholesky(_kernel(gram, scale, s2)), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise FitError(NO_MOTION) from None
    present = np.divide(gram.present, scale, out=np.zeros_like(scale), where=scale > 0)
    p = gram.jv.shape[1]
    right = np.empty((len(scale), q, p + 2 + q))
    right[:, :, :p] = scale[:, :, None] * np.swapaxes(gram.jv, 1, 2)
    right[:, :, p], right[:, :, p + 1], right[:, :, p + 2 :] = scale * gram.vw, present, np.eye(q)
    solved = _forward(root, right)
    product = np.swapaxes(solved, 1, 2) @ solved
    phi, w, b, unit = slice(0, p), p, p + 1, slice(p + 2, None)
    spread = s2 * product[:, unit, unit]
    log_det = (gram.count - q) * np.log(s2) + 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    log_det += gram.log_scale
    return Weighted(
        hessian=(gram.jj - product[:, phi, phi]) / s2,
        gradient=(gram.jw - product[:, phi, w]) / s2 + product[:, phi, b],
        square=(gram.ww - product[:, w, w]) / s2
        + (2.0 * product[:, w, b] + (present**2).sum(axis=1) - s2 * product[:, b, b]),
        log_det=log_det,
        left=np.diagonal(spread, axis1=1, axis2=2),
        means=present + (product[:, unit, w] - s2 * product[:, unit, b]),
        by_phi=product[:, unit, phi],
        spread=spread,
    )


def _forward(root: Floats, right: Floats) -> Floats:
    """X of L X = B for lower triangles L (R, q, q) and B (R, q, m): with few rows one after the other for all runs."""
    q = root.shape[1]
    if q > FEW:
        return np.asarray(np.linalg.solve(root, right))
    out = right
    for i in range(q):
        for j in range(i):
            out[:, i] -= root[:, i, j, None] * out[:, j]
        out[:, i] /= root[:, i, i, None]
    return out


def _kernel(gram: Gram, scale: Floats, s2: float) -> Floats:
    return s2 * np.eye(scale.shape[1]) + scale[:, :, None] * gram.vv * scale[:, None, :]


def curvature_scale(hessian: Floats) -> Floats:
    """Square roots of the diagonal of H (..., p, p), floored so that a direction without information does no harm."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(hessian, axis1=-2, axis2=-1), 1e-24)))


def solve_scaled(hessian: Floats, gradient: Floats) -> Floats:
    """Solve H x = h, H (..., p, p) and h (..., p), with the parameters scaled to unit curvature; a direction without
    information stays at zero."""
    scale = curvature_scale(hessian)
    unit = hessian / (scale[..., :, None] * scale[..., None, :])
    inverse = np.linalg.pinv(unit, rcond=1e-13, hermitian=True)
    return np.asarray((inverse @ (gradient / scale)[..., None])[..., 0] / scale)


def covariance_of(hessian: Floats) -> Floats:
    """Inverse of H, scaled to unit curvature first."""
    scale = curvature_scale(hessian)
    return np.asarray(
        np.linalg.pinv(hessian / np.outer(scale, scale), rcond=1e-13, hermitian=True) / np.outer(scale, scale)
    )


def normal_equations(grams: Grams, weighted: Weighted) -> tuple[Floats, Floats]:
    """H (p, p) and h (p,) of H phi = h, of all runs and of what is known beforehand."""
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    if grams.prior is None:
        return hessian, gradient
    expected, precision = grams.prior
    return hessian + precision, gradient + precision @ expected


def bounded_solution(hessian: Floats, gradient: Floats, phi: Floats, bounds: Floats) -> Floats:
    """The solution of H x = h within `bounds` (p, 2), from `phi`, by an active set that starts with every parameter
    free."""
    new, free = phi.copy(), np.ones(len(phi), dtype=bool)
    while free.any():
        push = gradient[free] - hessian[np.ix_(free, ~free)] @ new[~free]
        trial = new.copy()
        trial[free] = solve_scaled(hessian[np.ix_(free, free)], push)
        outside = free & ((trial < bounds[:, 0]) | (trial > bounds[:, 1]))
        new = np.clip(trial, bounds[:, 0], bounds[:, 1])
        if not outside.any():
            break
        free &= ~outside
    return new


def posterior_mean(grams: Grams, effects: RunEffects, variances: Floats, phi: Floats) -> Floats:
    """Mean of the run effects given the data and phi, (R, q)."""
    weighted = weigh(grams, effects, variances)
    return np.asarray(effects.deviation(variances) * (weighted.means - weighted.by_phi @ phi))


def predictive(grams: Grams, weighted: Weighted, left_out: Floats) -> Floats:
    """Log density of each run under the phi fitted without it, `left_out` (R, p); shape (R,)."""
    square = (
        weighted.square
        - 2.0 * np.einsum("rp,rp->r", weighted.gradient, left_out)
        + np.einsum("rp,rpk,rk->r", left_out, weighted.hessian, left_out)
    )
    return np.asarray(-0.5 * (square + weighted.log_det + grams.count * np.log(2 * np.pi)))
