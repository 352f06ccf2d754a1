"""What a mixed regression is asked and what it answers: `Problem` and `MixedFit`; see mixed_model.py for the method."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from automarine_cli.fits import linear_mixed
from automarine_cli.fits.linear_mixed import SMALLEST_FACTOR, Gram, RunEffects

Floats = NDArray[np.float64]

Response = Callable[[Floats, Floats], Floats]
"""Headings (P, R, N) for theta (P, p) and run effects (P, R, q)."""

SMALLEST = 1e-9
"""What a positive parameter may fall to: nothing, for all that a log can show."""


@dataclass(frozen=True)
class Problem:
    """Measured headings (R, N) with their mask, the response, the run effects, and bounds of theta (p, 2).

    `positive` (p,) marks the parameters that are searched, and whose intervals are formed, on the logarithm. Where
    runs were reduced (see nodes.py) `samples` (R,) is how many they had and `left` (R,) [rad²] the part of their sums
    of squares that no parameters change.
    """

    response: Response
    measured: Floats
    seen: NDArray[np.bool_]
    effects: RunEffects
    bounds: Floats
    positive: NDArray[np.bool_]
    samples: NDArray[np.int64] | None = None
    left: Floats | None = None

    @property
    def count(self) -> NDArray[np.int64]:
        """Samples of each run, (R,)."""
        return self.seen.sum(axis=1) if self.samples is None else self.samples

    def residual(self, fitted: Floats) -> Floats:
        """What headings (R, N) leave of the measured ones, zero in the padding."""
        return np.where(self.seen, self.measured - fitted, 0.0)

    def gram(self, by_phi: Floats, by_run: Floats, fitted: Floats, b: Floats) -> Gram:
        """Inner products of the problem linearised about headings `fitted` (R, N) at run effects `b` (R, q)."""
        gram = Gram.of(by_phi, by_run, self.residual(fitted), self.count, b)
        return gram if self.left is None else replace(gram, ww=gram.ww + self.left)

    def natural(self, phi: Floats) -> Floats:
        """theta (..., p) of the search's coordinates phi."""
        return np.where(self.positive, np.exp(np.where(self.positive, phi, 0.0)), phi)

    def search(self, theta: Floats) -> Floats:
        """phi (..., p) of theta; a positive parameter at zero counts as `SMALLEST`."""
        return np.where(
            self.positive, np.log(np.maximum(np.where(self.positive, theta, 1.0), SMALLEST)), theta
        )

    def headings(self, phi: Floats, b: Floats) -> Floats:
        """Headings (R, N) at one phi (p,) and b (R, q)."""
        return self.response(self.natural(phi)[None], b[None])[0]


@dataclass(frozen=True)
class MixedFit:
    """Outcome of one fit.

    `theta` (p,) and `phi` (p,), the same in the search's coordinates, in which are `covariance` (p, p) from
    the likelihood and `left_out` (R, p), phi without each run; `noise` s [rad], `factors` of the run
    effects, `run_effects` (R, q), `log_likelihood` (marginal, maximum likelihood), `predictive` (R,) log
    density of each run predicted from the others, `fitted` (R, N) headings, `at_bound` indices of the
    parameters that a bound stopped.
    """

    theta: Floats
    phi: Floats
    positive: NDArray[np.bool_]
    covariance: Floats
    left_out: Floats
    noise: float
    factors: Floats
    run_effects: Floats
    log_likelihood: float
    predictive: Floats
    fitted: Floats
    at_bound: tuple[int, ...]
    iterations: int
    converged: bool
    gram: Gram = field(repr=False)
    effects: RunEffects = field(repr=False)

    @property
    def jackknife_covariance(self) -> Floats:
        """Covariance of phi from leaving each run out, (p, p); needs no assumption on the noise within a
        run."""
        count = len(self.left_out)
        spread = self.left_out - self.left_out.mean(axis=0)
        return (count - 1) / count * spread.T @ spread

    def factor_interval(self, index: int) -> tuple[float, float]:
        """95 % interval of one variance factor: where the restricted deviance rises by 3.84, the other
        variances fixed."""
        best = np.append(np.log(self.noise), np.log(np.maximum(self.factors, SMALLEST_FACTOR)))
        limits = self.effects.limits[index]
        level = self._deviance(best) + float(stats.chi2.ppf(0.95, 1))

        def above(log_factor: float) -> float:
            trial = best.copy()
            trial[1 + index] = log_factor
            return self._deviance(trial) - level

        ends = []
        for limit in limits:
            edge = float(np.log(max(limit, SMALLEST_FACTOR)))
            inside = above(edge) <= 0 or abs(edge - best[1 + index]) < 1e-9
            ends.append(edge if inside else float(optimize.brentq(above, edge, best[1 + index], xtol=1e-6)))
        low, high = np.exp(ends)
        return (0.0 if low <= max(limits[0], SMALLEST_FACTOR) * (1 + 1e-9) else float(low)), float(high)

    def _deviance(self, variances: Floats) -> float:
        return linear_mixed.deviance(self.gram, self.effects, variances, restricted=True)


def without_held(problem: Problem, held: NDArray[np.bool_]) -> Problem:
    """The problem without the parameters that are held: their direction may be that of others (the moment at which a
    loss is told, and the loss), and would take the search with it."""
    values = problem.bounds[:, 0]

    def response(theta: Floats, b: Floats) -> Floats:
        whole = np.tile(values, (len(theta), 1))
        whole[:, ~held] = theta
        return problem.response(whole, b)

    return replace(problem, response=response, bounds=problem.bounds[~held], positive=problem.positive[~held])


def with_held(fit: MixedFit, problem: Problem, held: NDArray[np.bool_]) -> MixedFit:
    """The fit with the held parameters put back, without any spread."""
    free = np.flatnonzero(~held)
    phi, left_out = problem.search(problem.bounds[:, 0]), np.zeros((len(fit.left_out), len(held)))
    phi[free] = fit.phi
    left_out[:] = phi
    left_out[:, free] = fit.left_out
    covariance = np.zeros((len(held), len(held)))
    covariance[np.ix_(free, free)] = fit.covariance
    theta = problem.bounds[:, 0].copy()
    theta[free] = fit.theta
    at_bound = tuple(sorted([*np.flatnonzero(held).tolist(), *(int(free[i]) for i in fit.at_bound)]))
    return replace(
        fit, theta=theta, phi=phi, positive=problem.positive, covariance=covariance, left_out=left_out,
        at_bound=at_bound,
    )  # fmt: skip
