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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.errors import FitError
from automarine_cli.quantities import Floats

MIN_OWN_CURVATURE = 1e-6  # share of a parameter's curvature that the others leave it, for it to be told from them
MAX_BEYOND_STDERRS = 100.0  # beyond a bound: a maximum that lies further off says no more

START_POSITION, START_VELOCITY, GAIN = "start-position", "start-velocity", "gain"
SWITCHES, DISTURBANCE = "switch-instants", "disturbance"


def bias_of(channel: str) -> str:
    return f"{channel}-bias"


@dataclass(frozen=True)
class Block:
    """Run effects of one kind before the data: standard deviations `scale` (R, k), where they have `limits` times one
    estimated factor within these."""

    name: str
    scale: Floats
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class RunEffects:
    """What is known of the q run effects b_i before the data, kind by kind."""

    blocks: tuple[Block, ...]

    @cached_property
    def scale(self) -> Floats:
        return np.concatenate([block.scale for block in self.blocks], axis=1)

    @cached_property
    def factor_names(self) -> tuple[str, ...]:
        return tuple(block.name for block in self.blocks if block.limits is not None)

    @cached_property
    def limits(self) -> tuple[tuple[float, float], ...]:
        return tuple(block.limits for block in self.blocks if block.limits is not None)

    @cached_property
    def _factor(self) -> NDArray[np.int64]:
        """Index of the factor that multiplies each effect, -1 for none."""
        of = {name: i for i, name in enumerate(self.factor_names)}
        return np.array([of.get(block.name, -1) for block in self.blocks for _ in range(block.scale.shape[1])])

    @cached_property
    def _columns(self) -> dict[str, slice]:
        ends = np.cumsum([block.scale.shape[1] for block in self.blocks]).tolist()
        return {b.name: slice(end - b.scale.shape[1], end) for b, end in zip(self.blocks, ends)}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(block.name for block in self.blocks)

    def of(self, b: Floats, name: str) -> Floats:
        """The run effects (..., k) of one block out of all, b (..., q); a view."""
        return b[..., self._columns[name]]

    def carried(self, b: Floats, other: "RunEffects") -> Floats:
        """Run effects b (R, q) of these blocks as those of `other`: blocks that only one of them has are zero there."""
        out = np.zeros_like(other.scale)
        for name in self.names:
            if name in other.names and other.of(out, name).shape == self.of(b, name).shape:
                other.of(out, name)[...] = self.of(b, name)
        return out

    def without(self, *names: str) -> "RunEffects":
        """Return the same where the effects of some blocks can only be zero."""
        blocks = (replace(b, scale=np.zeros_like(b.scale)) if b.name in names else b for b in self.blocks)
        return RunEffects(tuple(blocks))

    def deviation(self, variances: Floats) -> Floats:
        factors = variances[len(variances) - len(self.limits) :]
        return self.scale * np.append(np.exp(factors), 1.0)[self._factor]

    @cached_property
    def members(self) -> Floats:
        """Which effects each factor multiplies, (factors, q): one where it does."""
        return np.array(self._factor == np.arange(len(self.limits))[:, None], dtype=float)


@dataclass(frozen=True)
class NormalEquations:
    """Inner products of one linearisation: parameters J, run effects V, residuals w = r; runs first.

    `present` (R, q) the run effects b0 linearised about, `count` (R,) samples, `log_scale` (R,) what samples of other
    noise than the first channel's add to the log determinant. Where w is given whole, as r + J phi0 + V b0, both phi0
    and b0 count as zero.
    """

    jj: Floats
    jv: Floats
    vv: Floats
    jw: Floats
    vw: Floats
    ww: Floats
    present: Floats
    count: NDArray[np.int64]
    log_scale: Floats | float = 0.0

    @property
    def is_finite(self) -> bool:
        return all(bool(np.all(np.isfinite(part))) for part in (self.jj, self.jv, self.vv, self.ww))

    @classmethod
    def of(
        cls, by_theta: Floats, by_run: Floats, residual: Floats, count: NDArray[np.int64],
        present: Floats | None = None,
    ) -> "NormalEquations":  # fmt: skip
        """From J (R, N, p), V (R, N, q) and r (R, N), zero in the padding; `present` zero where not given."""
        present = np.zeros((len(by_run), by_run.shape[2])) if present is None else present
        p, q = by_theta.shape[2], by_run.shape[2]
        rows = np.empty((len(by_run), p + q + 1, residual.shape[1]))
        rows[:, :p], rows[:, p:-1] = np.swapaxes(by_theta, 1, 2), np.swapaxes(by_run, 1, 2)
        rows[:, -1] = residual
        product = rows @ np.swapaxes(rows, 1, 2)
        theta, run = slice(0, p), slice(p, p + q)
        return cls(
            product[:, theta, theta], product[:, theta, run], product[:, run, run], product[:, theta, -1],
            product[:, run, -1], product[:, -1, -1], present, count
        )  # fmt: skip

    def keep(self, free: NDArray[np.int64]) -> "NormalEquations":
        """The same with only the parameters `free`; the others stay where they are, as at a bound."""
        jj = self.jj[:, free][:, :, free]
        return replace(self, jj=jj, jv=self.jv[:, free], jw=self.jw[:, free])


@dataclass(frozen=True)
class Grams:
    """The same of every channel, linearised about one point; `prior`, if anything is known beforehand, is how far the
    parameters are expected from there (p,), and its precision (p, p)."""

    channels: tuple[NormalEquations, ...]
    prior: tuple[Floats, Floats] | None = None

    @property
    def is_finite(self) -> bool:
        return all(channel.is_finite for channel in self.channels)

    @cached_property
    def count(self) -> NDArray[np.int64]:
        return np.sum([channel.count for channel in self.channels], axis=0)

    def keep(self, free: NDArray[np.int64]) -> "Grams":
        prior = None if self.prior is None else (self.prior[0][free], self.prior[1][np.ix_(free, free)])
        return Grams(tuple(channel.keep(free) for channel in self.channels), prior)

    def at(self, variances: Floats) -> NormalEquations:
        """One sum over the channels, each sample counting by its channel's noise."""
        behind = 2.0 * (variances[: len(self.channels)] - variances[0])
        share = np.exp(-behind)
        log_scale = np.sum([b * channel.count for b, channel in zip(behind, self.channels)], axis=0)
        products = zip(*((c.jj, c.jv, c.vv, c.jw, c.vw, c.ww) for c in self.channels))
        jj, jv, vv, jw, vw, ww = (np.asarray(sum(w * block for w, block in zip(share, part))) for part in products)
        return NormalEquations(jj, jv, vv, jw, vw, ww, self.channels[0].present, self.count, log_scale)


RESPONSE_DIVERGED = (
    "no motion of a vehicle fits these runs: simulated positions diverge; check the logs with `automarine check` for "
    "gaps, a wrong clock, or wrong units or signs of position and command (--columns)"
)
NO_MOTION = "the runs show no motion to fit a model to; check the logs with `automarine check`"
SMALLEST_FACTOR = 1e-5


@dataclass(frozen=True)
class Weighted:
    """Each run's share of the normal equations at given variances: H (R, p, p), h (R, p), w'w (R,), log|R_i|
    (R,), with w = r + V b0.

    Of the run effects in units of their prior deviation: `remaining` (R, q) is the share of the variance that the
    data leave, `means` (R, q) the posterior mean at phi = 0, `by_phi` (R, q, p) what it loses per phi, and `spread`
    (R, q, q) their posterior covariance.
    """

    hessian: Floats
    gradient: Floats
    square: Floats
    log_det: Floats
    remaining: Floats
    means: Floats
    by_phi: Floats
    spread: Floats


def weigh(grams: Grams, effects: RunEffects, variances: Floats) -> Weighted:
    """Apply R_i^-1 to every inner product. Raises FitError where the response was not finite."""
    if not grams.is_finite:
        raise FitError(RESPONSE_DIVERGED)
    gram = grams.at(variances)
    s2 = np.exp(2.0 * variances[0])
    scale = effects.deviation(variances)
    q = scale.shape[1]
    try:
        kernel = s2 * np.eye(q) + scale[:, :, None] * gram.vv * scale[:, None, :]
        root = np.asarray(np.linalg.cholesky(kernel), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise FitError(NO_MOTION) from None
    present = np.divide(gram.present, scale, out=np.zeros_like(scale), where=scale > 0)
    p = gram.jv.shape[1]
    right = np.empty((len(scale), q, p + 2 + q))
    right[:, :, :p] = scale[:, :, None] * np.swapaxes(gram.jv, 1, 2)
    right[:, :, p], right[:, :, p + 1], right[:, :, p + 2 :] = scale * gram.vw, present, np.eye(q)
    solved = np.linalg.solve(root, right)
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
        remaining=np.diagonal(spread, axis1=1, axis2=2),
        means=present + (product[:, unit, w] - s2 * product[:, unit, b]),
        by_phi=product[:, unit, phi],
        spread=spread,
    )


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


def covariance_within_bounds(
    hessian: Floats, gradient: Floats, free: NDArray[np.int64], at_bound: NDArray[np.bool_], log: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Covariance (p, p) by the curvature (f, f) and gradient (f,) of the `free` parameters, of which some of all (p,)
    stand `at_bound` or are searched on their `log`; and the part of it that is owed to those at a bound.

    Each of these may lie inside its bound, by the normal curve of which the bound leaves the tail: by the mean square
    distance, which is the usual variance where the maximum just reaches the bound, and nothing where it is far beyond.
    The others follow. What is searched on its logarithm has no error of its own: all that is next to nothing is alike.
    """
    inside, stopped = np.flatnonzero(~at_bound[free]), np.flatnonzero(at_bound[free])
    covariance = np.zeros((len(log), len(log)))
    conditional = covariance_of(hessian[np.ix_(inside, inside)])
    covariance[np.ix_(free[inside], free[inside])] = conditional
    across, diagonal = hessian[np.ix_(inside, stopped)], np.diagonal(hessian)[stopped]
    follows = np.zeros((len(log), len(stopped)))
    follows[free[inside]] = -conditional @ across
    follows[free[stopped], np.arange(len(stopped))] = ~log[free[stopped]]
    curvature = diagonal - np.einsum("is,ij,js->s", across, conditional, across)
    is_told = curvature > MIN_OWN_CURVATURE * diagonal
    root = np.sqrt(np.where(is_told, curvature, np.inf))
    beyond = np.minimum(np.abs(gradient[stopped]) / root, MAX_BEYOND_STDERRS)
    hazard = np.sqrt(2.0 / np.pi) / special.erfcx(beyond / np.sqrt(2.0))
    follows *= np.sqrt(1.0 - beyond * (hazard - beyond)) / root
    of_bounds = follows @ follows.T
    return covariance + of_bounds, of_bounds


def normal_equations(grams: Grams, weighted: Weighted) -> tuple[Floats, Floats]:
    """H (p, p) and h (p,) of H phi = h, of all runs and of what is known beforehand."""
    hessian, gradient = weighted.hessian.sum(axis=0), weighted.gradient.sum(axis=0)
    if grams.prior is None:
        return hessian, gradient
    expected, precision = grams.prior
    return hessian + precision, gradient + precision @ expected


def bounded_solution(hessian: Floats, gradient: Floats, bounds: Floats) -> Floats:
    """Solve H x = h; where that x is outside `bounds` (p, 2), minimise x H x / 2 - h x within them."""
    solution = solve_scaled(hessian, gradient)
    if np.all((solution >= bounds[:, 0]) & (solution <= bounds[:, 1])):
        return solution
    solution = bounds[:, 0].copy()
    free = bounds[:, 0] < bounds[:, 1]
    if not free.any():
        return solution
    push = gradient[free] - hessian[np.ix_(free, ~free)] @ solution[~free]
    inside = hessian[np.ix_(free, free)]
    scale = curvature_scale(inside)
    values, vectors = np.linalg.eigh(inside / np.outer(scale, scale))
    roots = np.sqrt(np.maximum(values, 1e-13 * max(values[-1], 1.0)))  # no information at all moves nothing
    from scipy import optimize  # here, as most solutions need none of it

    least = optimize.lsq_linear(
        roots[:, None] * vectors.T, vectors.T @ (push / scale) / roots, (bounds[free] * scale[:, None]).T, "bvls"
    )
    solution[free] = np.clip(least.x / scale, *bounds[free].T)
    return solution


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


SETTLED_STEP = 1e-3  # step of a variance, in its smallest possible standard error, after which the search for it ends
FLAT_SLOPE = 1e-4
"""Slope of the deviance, by a variance in that unit, that counts as none: where an effect is next to nothing, or a run
has none, slope and second derivatives are rounding."""
MAX_LOG_STEP = 1.0  # longest step of the logarithm of a standard deviation
MAX_VARIANCE_STEPS = 60


def scored_deviance(
    grams: Grams, effects: RunEffects, variances: Floats, *, restricted: bool
) -> tuple[float, Floats, Floats]:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi, its gradient by the variances, and its
    expected second derivatives by them.

    `restricted` as Patterson and Thompson (1971, Biometrika 58:545). The gradient rests on
    d log|R| = tr(R^-1 dR) and d(e'R^-1 e) = -e'R^-1 dR R^-1 e; phi is at its optimum and adds nothing (envelope
    theorem). For a factor dR = 2 V D V' over its effects, for the noise dR = 2 s² 1: both reduce to what
    `Weighted` holds. Of several channels each noise has its own share of the samples' sum of squares. Second
    derivatives are tr(R^-1 dR R^-1 dR), those of phi fixed.
    """
    weighted = weigh(grams, effects, variances)
    hessian, gradient = normal_equations(grams, weighted)
    phi = solve_scaled(hessian, gradient)
    misfit, of_prior, of_data = weighted.square.sum() - gradient @ phi, 0.0, hessian
    if grams.prior is not None:  # which no noise scales
        expected, precision = grams.prior
        of_data = hessian - precision
        misfit = weighted.square.sum() - (2.0 * (gradient - precision @ expected) - of_data @ phi) @ phi
        of_prior = float((phi - expected) @ precision @ (phi - expected))
    value = weighted.log_det.sum() + misfit + of_prior
    means = weighted.means - weighted.by_phi @ phi
    of_effect = 1.0 - weighted.remaining - means**2
    of_noise = grams.count.sum() - (1.0 - weighted.remaining).sum() - misfit + (means**2).sum()
    covariance = None
    if restricted:
        unit = curvature_scale(hessian)
        value += np.linalg.slogdet(hessian / np.outer(unit, unit))[1] + 2.0 * np.log(unit).sum()
        covariance = covariance_of(hessian)
        of_phi = (weighted.by_phi @ covariance * weighted.by_phi).sum(axis=2)
        of_effect -= of_phi
        of_noise += of_phi.sum() - (len(phi) if grams.prior is None else float((of_data * covariance).sum()))
    noises = [of_noise]
    if len(grams.channels) > 1:
        noises = _of_noises(grams, effects, variances, weighted, phi, means, covariance)
    slope = 2.0 * np.append(noises, effects.members @ of_effect.sum(axis=0))
    return (float(value) if np.isfinite(value) else 1e100), slope, _information(grams, effects, variances, weighted)


def _information(grams: Grams, effects: RunEffects, variances: Floats, weighted: Weighted) -> Floats:
    """Expected second derivatives of the deviance by the variances.

    With P the run effects' posterior covariance, B_c what channel c tells of them, both in units of the prior
    deviations, and T_c = B_c P (all T_c together are 1 - P): of factors the sum of (1 - P)_ij² over their effects, of
    noises n_c - 2 tr T_c + tr T_c T_c and tr T_c T_d, of both (P T_c)_ii; all of them four times.
    """
    spread, identity = weighted.spread, np.eye(weighted.spread.shape[1])
    shares = [identity - spread]
    if len(grams.channels) > 1:
        scale = effects.deviation(variances)
        precisions = [scale[:, :, None] * c.vv * scale[:, None, :] for c in grams.channels]
        shares = [(precision / np.exp(2.0 * noise)) @ spread for precision, noise in zip(precisions, variances)]
    noises = len(shares)
    hessian = np.zeros((len(variances), len(variances)))
    for c, share in enumerate(shares):
        hessian[c, :noises] = [np.einsum("rij,rji->", share, other) for other in shares]
        hessian[c, c] += grams.channels[c].count.sum() - 2.0 * np.einsum("rii->", share)
        hessian[c, noises:] = hessian[noises:, c] = effects.members @ np.einsum("rij,rji->i", spread, share)
    hessian[noises:, noises:] = effects.members @ ((identity - spread) ** 2).sum(axis=0) @ effects.members.T
    return 4.0 * hessian


def _of_noises(
    grams: Grams, effects: RunEffects, variances: Floats, weighted: Weighted, phi: Floats, means: Floats,
    covariance: Floats | None,
) -> list[float]:  # fmt: skip
    """Half the slope of the deviance by the logarithm of each channel's noise: samples less what is left of them, in
    units of that noise, at the run effects' posterior mean `means` (R, q), their spread and that of phi included."""
    scale = effects.deviation(variances)
    step = scale * means - grams.channels[0].present
    spread = weighted.spread * scale[:, :, None] * scale[:, None, :]
    follows = scale[:, :, None] * weighted.by_phi
    slopes = []
    for channel, log_noise in zip(grams.channels, variances):
        of_b = (channel.vv @ step[:, :, None])[:, :, 0]
        misfit = channel.ww.sum() - 2.0 * (channel.jw.sum(axis=0) @ phi + (channel.vw * step).sum())
        misfit += phi @ channel.jj.sum(axis=0) @ phi + (step * of_b).sum()
        misfit += 2.0 * phi @ np.einsum("rpq,rq->p", channel.jv, step)
        misfit += (channel.vv * spread).sum()
        if covariance is not None:
            cross = channel.jv @ follows
            projected = channel.jj - cross - np.swapaxes(cross, 1, 2)
            projected = (projected + np.swapaxes(follows, 1, 2) @ channel.vv @ follows).sum(axis=0)
            misfit += (covariance * projected).sum()
        slopes.append(float(channel.count.sum() - misfit / np.exp(2.0 * log_noise)))
    return slopes


def choose_variances(grams: Grams, effects: RunEffects, start: Floats, *, restricted: bool = True) -> Floats:
    """Noises and factors, as logarithms, of largest likelihood within their limits, by Fisher's scoring: steps by the
    expected second derivatives, no longer than MAX_LOG_STEP, halved while the deviance rises."""
    factors = [(np.log(max(low, SMALLEST_FACTOR)), np.log(high)) for low, high in effects.limits]
    noises = [channel.count.sum() for channel in grams.channels]
    limits = np.array([*((np.log(1e-9), np.log(1e3)) for _ in noises), *factors])
    # of a logarithm of a standard deviation that n values show: 1/sqrt(2 n)
    unit = 1.0 / np.sqrt(2.0 * np.append(noises, np.full(len(factors), len(grams.count))))
    point = np.clip(start, *limits.T)
    value, slope, information = scored_deviance(grams, effects, point, restricted=restricted)
    for _ in range(MAX_VARIANCE_STEPS):
        steep = np.abs(slope) * unit > FLAT_SLOPE
        room = np.where(steep[:, None], limits - point[:, None], 0.0)
        newton = bounded_solution(information, -slope, room)
        step = 2.0 * np.clip(newton, -MAX_LOG_STEP, MAX_LOG_STEP)
        trial, settled = (np.inf, slope, information), False
        while trial[0] > value and not settled:
            step = 0.5 * step
            settled = bool(np.all(np.abs(step) <= SETTLED_STEP * unit))
            trial = scored_deviance(grams, effects, np.clip(point + step, *limits.T), restricted=restricted)
        point, (value, slope, information) = np.clip(point + step, *limits.T), trial
        if settled:
            break
    return point
