"""The linear half of the mixed model: every run reduced to its inner products, then variances, parameters
and run effects.

Run i is  w_i = J_i phi + V_i b_i + noise,  noise ~ N(0, s² 1),  b_i ~ N(0, D_i), so that w_i has covariance
R_i = s² 1 + V_i D_i V_i'. R_i^-1 acts through the small matrix K = s² 1 + L V'V L with D = L² (Woodbury), which
also
works where an entry of D is zero. Shapes: runs R, parameters p, run effects q.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from automarine_cli.errors import FitError

Floats = NDArray[np.float64]

SMALLEST_FACTOR = 1e-5


@dataclass(frozen=True)
class RunEffects:
    """What is known of the q run effects b_i before the data.

    `scale` (R, q) standard deviations; `factor` (q,) index of the estimated factor that multiplies each, -1
    for none; `limits` (lower, upper) of each factor.
    """

    scale: Floats
    factor: NDArray[np.int64]
    limits: tuple[tuple[float, float], ...] = ()

    def deviation(self, variances: Floats) -> Floats:
        """Standard deviations (R, q) for `variances` = (log s, log factors)."""
        return self.scale * np.append(np.exp(variances[1:]), 1.0)[self.factor]


@dataclass(frozen=True)
class Gram:
    """Inner products of one linearisation: parameters J, run effects V, data w; runs first. `count` (R,)
    samples."""

    jj: Floats
    jv: Floats
    vv: Floats
    jw: Floats
    vw: Floats
    ww: Floats
    count: NDArray[np.int64]

    @classmethod
    def of(cls, by_theta: Floats, by_run: Floats, data: Floats, count: NDArray[np.int64]) -> "Gram":
        """From J (R, N, p), V (R, N, q) and w (R, N), zero in the padding."""
        left, right, w = np.swapaxes(by_theta, 1, 2), np.swapaxes(by_run, 1, 2), data[:, :, None]
        return cls(
            left @ by_theta, left @ by_run, right @ by_run, (left @ w)[..., 0], (right @ w)[..., 0],
            (data**2).sum(axis=1), count
        )  # fmt: skip


@dataclass(frozen=True)
class Weighted:
    """Each run's share of the normal equations at given variances: H (R, p, p), h (R, p), w'w (R,), log|R_i|
    (R,)."""

    hessian: Floats
    gradient: Floats
    square: Floats
    log_det: Floats


def weigh(gram: Gram, effects: RunEffects, variances: Floats) -> Weighted:
    """Apply R_i^-1 to every inner product. Raises FitError where the response was not finite."""
    if not np.all(np.isfinite(gram.ww)):
        raise FitError(
            "the model's response is not finite on these runs; look at the logs with `automarine check`"
        )
    s2 = np.exp(2.0 * variances[0])
    scale = effects.deviation(variances)
    q = scale.shape[1]
    root = np.linalg.cholesky(_kernel(gram, scale, s2))
    both = np.concatenate([np.swapaxes(gram.jv, 1, 2), gram.vw[:, :, None]], axis=2) * scale[:, :, None]
    half = np.linalg.solve(root, both)
    inner = np.swapaxes(half, 1, 2) @ half
    log_det = (gram.count - q) * np.log(s2) + 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    return Weighted(
        (gram.jj - inner[:, :-1, :-1]) / s2, (gram.jw - inner[:, :-1, -1]) / s2, (gram.ww - inner[:, -1, -1])
        / s2, log_det
    )  # fmt: skip


def _kernel(gram: Gram, scale: Floats, s2: float) -> Floats:
    return s2 * np.eye(scale.shape[1]) + scale[:, :, None] * gram.vv * scale[:, None, :]


def deviance(gram: Gram, effects: RunEffects, variances: Floats, *, restricted: bool) -> float:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi; `restricted` as Patterson and
    Thompson (1971)."""
    weighted = weigh(gram, effects, variances)
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    value = weighted.log_det.sum() + weighted.square.sum() - gradient @ solve_scaled(hessian, gradient)
    if restricted:
        scale = curvature_scale(hessian)
        value += np.linalg.slogdet(hessian / np.outer(scale, scale))[1] + 2.0 * np.log(scale).sum()
    return float(value) if np.isfinite(value) else 1e100


def choose_variances(gram: Gram, effects: RunEffects, start: Floats, *, restricted: bool = True) -> Floats:
    """Noise and factors, (log s, log factors), of largest likelihood within their limits."""
    factors = ((np.log(max(low, SMALLEST_FACTOR)), np.log(high)) for low, high in effects.limits)
    limits = [(np.log(1e-9), np.log(1e3)), *factors]
    best = optimize.minimize(
        lambda v: deviance(gram, effects, v, restricted=restricted), np.clip(start, *np.transpose(limits)),
        bounds=limits, method="L-BFGS-B", options={"ftol": 1e-12, "gtol": 1e-6},
    )  # fmt: skip
    return np.asarray(best.x)


def curvature_scale(hessian: Floats) -> Floats:
    """Square roots of the diagonal, floored so that a direction without information does no harm."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(hessian), 1e-24)))


def solve_scaled(hessian: Floats, gradient: Floats) -> Floats:
    """Solve H x = h with the parameters scaled to unit curvature; a direction without information stays at
    zero."""
    scale = curvature_scale(hessian)
    return np.asarray(
        np.linalg.lstsq(hessian / np.outer(scale, scale), gradient / scale, rcond=1e-13)[0] / scale
    )


def covariance_of(hessian: Floats) -> Floats:
    """Inverse of H, scaled to unit curvature first."""
    scale = curvature_scale(hessian)
    return np.asarray(
        np.linalg.pinv(hessian / np.outer(scale, scale), rcond=1e-13, hermitian=True) / np.outer(scale, scale)
    )


def least_squares(weighted: Weighted, phi: Floats, bounds: Floats) -> Floats:
    """Generalised least squares for phi within `bounds` (p, 2), by an active set that starts with every
    parameter free."""
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
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


def posterior_mean(gram: Gram, effects: RunEffects, variances: Floats, phi: Floats) -> Floats:
    """Mean of the run effects given the data and phi, (R, q)."""
    scale = effects.deviation(variances)
    kernel = _kernel(gram, scale, np.exp(2.0 * variances[0]))
    right = scale * (gram.vw - np.einsum("rpq,p->rq", gram.jv, phi))
    return np.asarray(scale * np.linalg.solve(kernel, right[:, :, None])[:, :, 0])


def predictive(gram: Gram, weighted: Weighted, left_out: Floats) -> Floats:
    """Log density of each run under the phi fitted without it, `left_out` (R, p); shape (R,)."""
    square = (
        weighted.square
        - 2.0 * np.einsum("rp,rp->r", weighted.gradient, left_out)
        + np.einsum("rp,rpk,rk->r", left_out, weighted.hessian, left_out)
    )
    return np.asarray(-0.5 * (square + weighted.log_det + gram.count * np.log(2 * np.pi)))
