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
from scipy import optimize

from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.fits.gram import Gram, Grams
from automarine_cli.fits.run_effects import RunEffects
from automarine_cli.quantities import Floats

NO_MOTION = "the runs show no motion to fit a model to; check the logs with `automarine check`"
SMALLEST_FACTOR = 1e-5
FEW = 4
"""Run effects up to which equations are solved row by row, all runs at once."""
FLAT = 1e-4
"""Slope of the deviance that counts as none, by variances in units of their own standard errors."""


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
    data leave, `means` (R, q) the posterior mean at phi = 0, and `by_phi` (R, q, p) what it loses per phi; their
    posterior covariance is s² A'A with A = `inverse` (R, q, q).
    """

    hessian: Floats
    gradient: Floats
    square: Floats
    log_det: Floats
    left: Floats
    means: Floats
    by_phi: Floats
    inverse: Floats


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
    of_phi, of_w, of_present, inverse = np.split(solved, [p, p + 1, p + 2], axis=2)
    of_w, of_present = of_w[:, :, 0], of_present[:, :, 0]
    back = np.swapaxes(inverse, 1, 2)
    log_det = (gram.count - q) * np.log(s2) + 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    log_det += gram.log_scale
    return Weighted(
        hessian=(gram.jj - np.swapaxes(of_phi, 1, 2) @ of_phi) / s2,
        gradient=(gram.jw - _dot(of_phi, of_w)) / s2 + _dot(of_phi, of_present),
        square=(gram.ww - (of_w**2).sum(axis=1)) / s2
        + (2.0 * of_w * of_present + present**2 - s2 * of_present**2).sum(axis=1),
        log_det=log_det,
        left=s2 * (inverse**2).sum(axis=1),
        means=present + (back @ (of_w - s2 * of_present)[:, :, None])[:, :, 0],
        by_phi=back @ of_phi,
        inverse=inverse,
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


def deviance(grams: Grams, effects: RunEffects, variances: Floats, *, restricted: bool) -> float:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi; see `deviance_and_slope`."""
    return deviance_and_slope(grams, effects, variances, restricted=restricted)[0]


def deviance_and_slope(
    grams: Grams, effects: RunEffects, variances: Floats, *, restricted: bool
) -> tuple[float, Floats]:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi, and its gradient by the variances.

    `restricted` as Patterson and Thompson (1971, Biometrika 58:545). The gradient rests on
    d log|R| = tr(R^-1 dR) and d(e'R^-1 e) = -e'R^-1 dR R^-1 e; phi is at its optimum and adds nothing (envelope
    theorem). For a factor dR = 2 V D V' over its effects, for the noise dR = 2 s² 1: both reduce to what
    `Weighted` holds. Of several channels each noise has its own share of the samples' sum of squares.
    """
    weighted = weigh(grams, effects, variances)
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    phi = solve_scaled(hessian, gradient)
    misfit = weighted.square.sum() - gradient @ phi
    value = weighted.log_det.sum() + misfit
    means = weighted.means - weighted.by_phi @ phi
    of_effect = 1.0 - weighted.left - means**2
    of_noise = grams.count.sum() - (1.0 - weighted.left).sum() - misfit + (means**2).sum()
    covariance = None
    if restricted:
        unit = curvature_scale(hessian)
        value += np.linalg.slogdet(hessian / np.outer(unit, unit))[1] + 2.0 * np.log(unit).sum()
        covariance = covariance_of(hessian)
        taken = (weighted.by_phi @ covariance * weighted.by_phi).sum(axis=2)
        of_effect -= taken
        of_noise += taken.sum() - len(phi)
    noises = [of_noise]
    if len(grams.channels) > 1:
        noises = _of_noises(grams, effects, variances, weighted, phi, means, covariance)
    slope = 2.0 * np.array([*noises, *effects.sums(of_effect)])
    return (float(value) if np.isfinite(value) else 1e100), slope


def _of_noises(
    grams: Grams,
    effects: RunEffects,
    variances: Floats,
    weighted: Weighted,
    phi: Floats,
    means: Floats,
    covariance: Floats | None,
) -> list[float]:
    """Half the slope of the deviance by the logarithm of each channel's noise: samples less what is left of them, in
    units of that noise, at the run effects' posterior mean `means` (R, q), their spread and that of phi included."""
    scale = effects.deviation(variances)
    step = scale * means - grams.channels[0].present
    spread = np.exp(2.0 * variances[0]) * np.swapaxes(weighted.inverse, 1, 2) @ weighted.inverse
    spread *= scale[:, :, None] * scale[:, None, :]
    follows = scale[:, :, None] * weighted.by_phi
    found = []
    for channel, log_noise in zip(grams.channels, variances):
        of_b = (channel.vv @ step[:, :, None])[:, :, 0]
        left = channel.ww.sum() - 2.0 * (channel.jw.sum(axis=0) @ phi + (channel.vw * step).sum())
        left += phi @ channel.jj.sum(axis=0) @ phi + (step * of_b).sum()
        left += 2.0 * phi @ np.einsum("rpq,rq->p", channel.jv, step)
        left += (channel.vv * spread).sum()
        if covariance is not None:
            cross = channel.jv @ follows
            own = channel.jj - cross - np.swapaxes(cross, 1, 2)
            own = (own + np.swapaxes(follows, 1, 2) @ channel.vv @ follows).sum(axis=0)
            left += (covariance * own).sum()
        found.append(float(channel.count.sum() - left / np.exp(2.0 * log_noise)))
    return found


def choose_variances(grams: Grams, effects: RunEffects, start: Floats, *, restricted: bool = True) -> Floats:
    """Noises and factors, as logarithms, of largest likelihood within their limits."""
    factors = [(np.log(max(low, SMALLEST_FACTOR)), np.log(high)) for low, high in effects.limits]
    noises = [channel.count.sum() for channel in grams.channels]
    limits = np.array([*((np.log(1e-9), np.log(1e3)) for _ in noises), *factors])
    # of a logarithm of a standard deviation that n values show: 1/sqrt(2 n)
    unit = 1.0 / np.sqrt(2.0 * np.append(noises, np.full(len(factors), len(grams.count))))

    def scaled(x: Floats) -> tuple[float, Floats]:
        value, slope = deviance_and_slope(grams, effects, unit * x, restricted=restricted)
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
