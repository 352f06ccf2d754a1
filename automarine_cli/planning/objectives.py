"""What a campaign may be for: narrow intervals, or split explanations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Intervals:
    """Intervals to narrow.

    `information` (K, p, p) of the candidates, `known` (p, p) beforehand, `wanted` (p, m) the directions whose
    intervals count. `goal` is the largest standard error of a wanted direction at which nothing more is wanted, or
    None.
    """

    information: Floats
    known: Floats
    wanted: Floats
    goal: float | None = None

    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        """Worth of the campaign `counts` (K,) with one more run, each of `extras` (B,) in turn, (B,): the mean
        logarithm by which the wanted standard errors have come down."""
        return self._worth(self._spread(counts, extras))

    def score(self, counts: Floats) -> float:
        """Worth of the campaign `counts` (K,)."""
        return float(self._worth(self._spread(counts, None))[0])

    def reached(self, counts: Floats) -> bool:
        """Whether nothing more is wanted."""
        if self.goal is None:
            return False
        return bool(np.all(np.sqrt(np.diagonal(self._spread(counts, None)[0])) <= self.goal))

    def _worth(self, spread: Floats) -> Floats:
        unit = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        shape = np.linalg.slogdet(spread / unit[:, :, None] / unit[:, None, :])[1]
        return np.asarray(-(np.log(unit).sum(axis=1) + 0.5 * shape) / self.wanted.shape[1])

    def _spread(self, counts: Floats, extras: NDArray[np.int64] | None) -> Floats:
        """Covariance (B, m, m) of the wanted directions as the jackknife over runs tells it: see
        `information.reported_covariance`. A parameter that hangs on a single run is not known."""
        base = np.tensordot(counts, self.information, axes=1) + self.known
        more = np.zeros((1, *base.shape)) if extras is None else self.information[extras]
        whole = base + more
        inverse = np.linalg.inv(whole)
        ran = np.flatnonzero(counts)
        told = inverse @ self.known
        each = np.linalg.inv(whole[:, None] - self.information[ran]) @ self.information[ran]
        told = told + np.tensordot(each, counts[ran], axes=((1,), (0,)))
        told = told + np.linalg.inv(whole - more) @ more
        covariance = told @ inverse
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return np.asarray(self.wanted.T @ covariance @ self.wanted)


@dataclass(frozen=True)
class Contest:
    """Two explanations on K candidates: one is true, the other is fitted about its parameters there.

    `square` (K,) is the squared difference of the headings in units of their noise, `gradient` (K, p) and `hessian`
    (K, p, p) what the other's parameters do to it; `ridge` (p, p) what is known of them beforehand.
    """

    square: Floats
    gradient: Floats
    hessian: Floats
    ridge: Floats

    def misfit(self, counts: Floats) -> Floats:
        """Misfit of the other explanation to campaigns, `counts` (B, K) how often each holds each candidate; (B,)."""
        square, gradient = counts @ self.square, counts @ self.gradient
        hessian = np.tensordot(counts, self.hessian, axes=1) + self.ridge
        solved = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        return np.maximum(square - np.sum(gradient * solved, axis=1), 0.0)


@dataclass(frozen=True)
class Splitting:
    """Explanations to split: `contests`, each settled from its misfit of `enough` (C,) on."""

    contests: tuple[Contest, ...]
    enough: Floats

    def scores(self, counts: Floats, extras: NDArray[np.int64]) -> Floats:
        """Worth of the campaign `counts` (K,) with one more run, each of `extras` (B,) in turn, (B,): the shares of the
        contests that are settled."""
        return self._worth(counts + np.eye(len(counts))[extras])

    def score(self, counts: Floats) -> float:
        """Worth of the campaign `counts` (K,)."""
        return float(self._worth(counts[None])[0])

    def reached(self, counts: Floats) -> bool:
        """Whether all are settled."""
        return self.score(counts) >= len(self.contests) - 1e-9

    def _worth(self, counts: Floats) -> Floats:
        shares = [
            np.minimum(one.misfit(counts) / enough, 1.0) for one, enough in zip(self.contests, self.enough)
        ]
        return np.asarray(np.sum(shares, axis=0))
