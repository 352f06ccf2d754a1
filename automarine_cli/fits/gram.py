"""A linearised problem as inner products, run by run and channel by channel."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Gram:
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
        """Whether response and derivatives were finite."""
        return all(bool(np.all(np.isfinite(part))) for part in (self.jj, self.jv, self.vv, self.ww))

    @classmethod
    def of(
        cls, by_theta: Floats, by_run: Floats, residual: Floats, count: NDArray[np.int64],
        present: Floats | None = None,
    ) -> "Gram":  # fmt: skip
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

    def keep(self, free: NDArray[np.int64]) -> "Gram":
        """The same with only the parameters `free`; the others stay where they are, as at a bound."""
        jj = self.jj[:, free][:, :, free]
        return replace(self, jj=jj, jv=self.jv[:, free], jw=self.jw[:, free])


@dataclass(frozen=True)
class Grams:
    """The same of every channel, linearised about one point; `prior`, if anything is known beforehand, is how far the
    parameters are expected from there (p,), and its precision (p, p)."""

    channels: tuple[Gram, ...]
    prior: tuple[Floats, Floats] | None = None

    @property
    def is_finite(self) -> bool:
        """Whether response and derivatives were finite."""
        return all(channel.is_finite for channel in self.channels)

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """Samples of each run, (R,)."""
        return np.sum([channel.count for channel in self.channels], axis=0)

    def keep(self, free: NDArray[np.int64]) -> "Grams":
        """The same with only the parameters `free`."""
        prior = None if self.prior is None else (self.prior[0][free], self.prior[1][np.ix_(free, free)])
        return Grams(tuple(channel.keep(free) for channel in self.channels), prior)

    def at(self, variances: Floats) -> Gram:
        """One sum over the channels, each sample counting by its channel's noise."""
        first = self.channels[0]
        if len(self.channels) == 1:
            return first
        behind = 2.0 * (variances[: len(self.channels)] - variances[0])
        share = np.exp(-behind)

        log_scale = np.sum([b * channel.count for b, channel in zip(behind, self.channels)], axis=0)
        products = zip(*((c.jj, c.jv, c.vv, c.jw, c.vw, c.ww) for c in self.channels))
        jj, jv, vv, jw, vw, ww = (np.asarray(sum(w * one for w, one in zip(share, part))) for part in products)
        return Gram(jj, jv, vv, jw, vw, ww, first.present, self.count, log_scale)
