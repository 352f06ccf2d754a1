"""Noises and factors of a linearised problem: how likely they are, and where they are likeliest.

Shapes and variances as in linear_mixed.py.
"""

import numpy as np

from automarine_cli.fits.gram import Grams
from automarine_cli.fits.linear_mixed import (
    SMALLEST_FACTOR,
    Weighted,
    bounded_solution,
    covariance_of,
    curvature_scale,
    normal_equations,
    solve_scaled,
    weigh,
)
from automarine_cli.fits.run_effects import RunEffects
from automarine_cli.quantities import Floats

SETTLED = 1e-3
"""Step of a variance, in its smallest possible standard error, after which the search for it ends."""
FLAT = 1e-4
"""Slope of the deviance, by a variance in that unit, that counts as none: where an effect is next to nothing, or a run
has none, slope and second derivatives are rounding."""
BOLDEST = 1.0
"""Longest step of the logarithm of a standard deviation."""
MOST_STEPS = 60


def deviance(grams: Grams, effects: RunEffects, variances: Floats, *, restricted: bool) -> float:
    """-2 log marginal likelihood with phi profiled out, but for n log 2 pi; see `scored_deviance`."""
    return scored_deviance(grams, effects, variances, restricted=restricted)[0]


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
    misfit, known, own = weighted.square.sum() - gradient @ phi, 0.0, hessian
    if grams.prior is not None:  # which no noise scales
        expected, precision = grams.prior
        own = hessian - precision
        misfit = weighted.square.sum() - (2.0 * (gradient - precision @ expected) - own @ phi) @ phi
        known = float((phi - expected) @ precision @ (phi - expected))
    value = weighted.log_det.sum() + misfit + known
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
        of_noise += taken.sum() - (len(phi) if grams.prior is None else float((own * covariance).sum()))
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
        told = [scale[:, :, None] * c.vv * scale[:, None, :] for c in grams.channels]
        shares = [(one / np.exp(2.0 * noise)) @ spread for one, noise in zip(told, variances)]
    noises = len(shares)
    found = np.zeros((len(variances), len(variances)))
    for c, one in enumerate(shares):
        found[c, :noises] = [np.einsum("rij,rji->", one, other) for other in shares]
        found[c, c] += grams.channels[c].count.sum() - 2.0 * np.einsum("rii->", one)
        found[c, noises:] = found[noises:, c] = effects.members @ np.einsum("rij,rji->i", spread, one)
    found[noises:, noises:] = effects.members @ ((identity - spread) ** 2).sum(axis=0) @ effects.members.T
    return 4.0 * found


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
    spread = weighted.spread * scale[:, :, None] * scale[:, None, :]
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
    """Noises and factors, as logarithms, of largest likelihood within their limits, by Fisher's scoring: steps by the
    expected second derivatives, no longer than BOLDEST, halved while the deviance rises."""
    factors = [(np.log(max(low, SMALLEST_FACTOR)), np.log(high)) for low, high in effects.limits]
    noises = [channel.count.sum() for channel in grams.channels]
    limits = np.array([*((np.log(1e-9), np.log(1e3)) for _ in noises), *factors])
    # of a logarithm of a standard deviation that n values show: 1/sqrt(2 n)
    unit = 1.0 / np.sqrt(2.0 * np.append(noises, np.full(len(factors), len(grams.count))))
    here = np.clip(start, *limits.T)
    value, slope, information = scored_deviance(grams, effects, here, restricted=restricted)
    for _ in range(MOST_STEPS):
        steep = np.abs(slope) * unit > FLAT
        room = np.where(steep[:, None], limits - here[:, None], 0.0)
        wanted = bounded_solution(information, -slope, 0.0 * here, room)
        step = 2.0 * np.clip(wanted, -BOLDEST, BOLDEST)
        found, settled = (np.inf, slope, information), False
        while found[0] > value and not settled:
            step = 0.5 * step
            settled = bool(np.all(np.abs(step) <= SETTLED * unit))
            found = scored_deviance(grams, effects, np.clip(here + step, *limits.T), restricted=restricted)
        here, (value, slope, information) = np.clip(here + step, *limits.T), found
        if settled:
            break
    return here
