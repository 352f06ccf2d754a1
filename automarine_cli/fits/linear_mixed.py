"""The linear half of the mixed model: every run reduced to its inner products, then variances, parameters
and run effects.

About the present point (phi0, b0) run i is  r_i = J_i phi + V_i (b_i - b0_i) + noise,  noise ~ N(0, s² 1),
b_i ~ N(0, D_i), with r_i its residual and phi the change from phi0: r_i + V_i b0_i has covariance
R_i = s² 1 + V_i D_i V_i'. R_i^-1 acts through the small matrix K = s² 1 + L V'V L with D = L² (Woodbury), which also
works where an entry of D is zero. Because R^-1 V L = V L K^-1, the present b0 enters without ever being
multiplied by V: sums of squares of headings of many radians, of which nothing but noise would remain, are
never formed.
Shapes: runs R, parameters p, run effects q.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from automarine_cli.errors import FitError

Floats = NDArray[np.float64]

NOT_FINITE = (
    "no motion of a vehicle fits these runs: simulated headings run out of all bounds; look at the logs with "
    "`automarine check` for gaps, a wrong clock, or wrong units or signs of heading and moment (--columns)"
)
NO_MOTION = (
    "the runs show no motion that a model could be fitted to; look at the logs with `automarine check`"
)
SMALLEST_FACTOR = 1e-5
FEW = 4
"""Run effects up to which equations are solved row by row, all runs at once."""
FLAT = 1e-4
"""Slope of the deviance that counts as none, by variances in units of their own standard errors."""


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
    """Inner products of one linearisation: parameters J, run effects V, residuals w = r; runs first.

    `present` (R, q) the run effects b0 linearised about, `count` (R,) samples. Where w is given whole, as
    r + J phi0 + V b0, both phi0 and b0 count as zero.
    """

    jj: Floats
    jv: Floats
    vv: Floats
    jw: Floats
    vw: Floats
    ww: Floats
    present: Floats
    count: NDArray[np.int64]

    @property
    def is_finite(self) -> bool:
        """Whether response and derivatives were finite."""
        return all(bool(np.all(np.isfinite(part))) for part in (self.jj, self.jv, self.vv, self.ww))

    @classmethod
    def of(
        cls, by_theta: Floats, by_run: Floats, residual: Floats, count: NDArray[np.int64],
        present: Floats | None = None,
    ) -> "Gram":  # fmt: skip
        """From J (R, N, p), V (R, N, q) and r (R, N), zero in the padding; `present` zero where not given."""
        present = np.zeros((len(by_run), by_run.shape[2])) if present is None else present
        left, right, w = np.swapaxes(by_theta, 1, 2), np.swapaxes(by_run, 1, 2), residual[:, :, None]
        return cls(
            left @ by_theta, left @ by_run, right @ by_run, (left @ w)[..., 0], (right @ w)[..., 0],
            (residual**2).sum(axis=1), present, count
        )  # fmt: skip

    def keep(self, free: NDArray[np.int64]) -> "Gram":
        """The same with only the parameters `free`; the others stay where they are, as at a bound."""
        jj = self.jj[:, free][:, :, free]
        return replace(self, jj=jj, jv=self.jv[:, free], jw=self.jw[:, free])


@dataclass(frozen=True)
class Weighted:
    """Each run's share of the normal equations at given variances: H (R, p, p), h (R, p), w'w (R,), log|R_i|
    (R,), with w = r + V b0.

    Of the run effects in units of their prior deviation: `left` (R, q) is the share of the variance that the
    data leave, `means` (R, q) the posterior mean at phi = 0, and `by_phi` (R, q, p) what it loses per phi.
    """

    hessian: Floats
    gradient: Floats
    square: Floats
    log_det: Floats
    left: Floats
    means: Floats
    by_phi: Floats


def weigh(gram: Gram, effects: RunEffects, variances: Floats) -> Weighted:
    """Apply R_i^-1 to every inner product. Raises FitError where the response was not finite."""
    if not gram.is_finite:
        raise FitError(NOT_FINITE)
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
    of_phi, of_w, of_present, inverse = np.split(solved, [p, p + 1, p + 2], axis=2)
    of_w, of_present = of_w[:, :, 0], of_present[:, :, 0]
    back = np.swapaxes(inverse, 1, 2)
    log_det = (gram.count - q) * np.log(s2) + 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    return Weighted(
        hessian=(gram.jj - np.swapaxes(of_phi, 1, 2) @ of_phi) / s2,
        gradient=(gram.jw - _dot(of_phi, of_w)) / s2 + _dot(of_phi, of_present),
        square=(gram.ww - (of_w**2).sum(axis=1)) / s2
        + (2.0 * of_w * of_present + present**2 - s2 * of_present**2).sum(axis=1),
        log_det=log_det,
        left=s2 * (inverse**2).sum(axis=1),
        means=present + (back @ (of_w - s2 * of_present)[:, :, None])[:, :, 0],
        by_phi=back @ of_phi,
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


def _dot(by_phi: Floats, vector: Floats) -> Floats:
    """Columns of (R, q, p) times (R, q): (R, p)."""
    return np.asarray(np.einsum("rqp,rq->rp", by_phi, vector))


def _kernel(gram: Gram, scale: Floats, s2: float) -> Floats:
    return s2 * np.eye(scale.shape[1]) + scale[:, :, None] * gram.vv * scale[:, None, :]


def deviance(gram: Gram, effects: RunEffects, variances: Floats, *, restricted: bool) -> float:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi; see `deviance_and_slope`."""
    return deviance_and_slope(gram, effects, variances, restricted=restricted)[0]


def deviance_and_slope(
    gram: Gram, effects: RunEffects, variances: Floats, *, restricted: bool
) -> tuple[float, Floats]:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi, and its gradient by the variances.

    `restricted` as Patterson and Thompson (1971, Biometrika 58:545). The gradient rests on
    d log|R| = tr(R^-1 dR) and d(e'R^-1 e) = -e'R^-1 dR R^-1 e; phi is at its optimum and adds nothing (envelope
    theorem). For a factor dR = 2 V D V' over its effects, for the noise dR = 2 s² 1: both reduce to what
    `Weighted` holds.
    """
    weighted = weigh(gram, effects, variances)
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    phi = solve_scaled(hessian, gradient)
    misfit = weighted.square.sum() - gradient @ phi
    value = weighted.log_det.sum() + misfit
    means = weighted.means - weighted.by_phi @ phi
    of_effect = 1.0 - weighted.left - means**2
    of_noise = gram.count.sum() - (1.0 - weighted.left).sum() - misfit + (means**2).sum()
    if restricted:
        unit = curvature_scale(hessian)
        value += np.linalg.slogdet(hessian / np.outer(unit, unit))[1] + 2.0 * np.log(unit).sum()
        taken = (weighted.by_phi @ covariance_of(hessian) * weighted.by_phi).sum(axis=2)
        of_effect -= taken
        of_noise += taken.sum() - len(phi)
    of_factor = [of_effect[:, effects.factor == k].sum() for k in range(len(variances) - 1)]
    return (float(value) if np.isfinite(value) else 1e100), 2.0 * np.array([of_noise, *of_factor])


def choose_variances(gram: Gram, effects: RunEffects, start: Floats, *, restricted: bool = True) -> Floats:
    """Noise and factors, (log s, log factors), of largest likelihood within their limits."""
    factors = ((np.log(max(low, SMALLEST_FACTOR)), np.log(high)) for low, high in effects.limits)
    limits = np.array([(np.log(1e-9), np.log(1e3)), *factors])
    # of a logarithm of a standard deviation that n values show: 1/sqrt(2 n)
    unit = 1.0 / np.sqrt(2.0 * np.append(gram.count.sum(), np.full(len(limits) - 1, len(gram.count))))

    def scaled(x: Floats) -> tuple[float, Floats]:
        value, slope = deviance_and_slope(gram, effects, unit * x, restricted=restricted)
        return value, unit * slope

    best = optimize.minimize(
        scaled, np.clip(start, *limits.T) / unit, jac=True, bounds=limits / unit[:, None], method="L-BFGS-B",
        options={"ftol": 1e-13, "gtol": FLAT},
    )  # fmt: skip
    return np.clip(unit * best.x, *limits.T)


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


def least_squares(weighted: Weighted, phi: Floats, bounds: Floats) -> Floats:
    """Generalised least squares for phi within `bounds` (p, 2)."""
    return bounded_solution(weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0), phi, bounds)


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


def posterior_mean(gram: Gram, effects: RunEffects, variances: Floats, phi: Floats) -> Floats:
    """Mean of the run effects given the data and phi, (R, q)."""
    weighted = weigh(gram, effects, variances)
    return np.asarray(effects.deviation(variances) * (weighted.means - weighted.by_phi @ phi))


def predictive(gram: Gram, weighted: Weighted, left_out: Floats) -> Floats:
    """Log density of each run under the phi fitted without it, `left_out` (R, p); shape (R,)."""
    square = (
        weighted.square
        - 2.0 * np.einsum("rp,rp->r", weighted.gradient, left_out)
        + np.einsum("rp,rpk,rk->r", left_out, weighted.hessian, left_out)
    )
    return np.asarray(-0.5 * (square + weighted.log_det + gram.count * np.log(2 * np.pi)))
