"""What a mixed regression is asked and what it answers: `Problem` and `MixedFit`; see mixed_model.py for the method."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from automarine_cli.fits import linear_mixed
from automarine_cli.fits.gram import Gram, Grams
from automarine_cli.fits.known import Prior, bounds_of, prior_of
from automarine_cli.fits.linear_mixed import SMALLEST_FACTOR
from automarine_cli.fits.outcome import Outcome, natural_of, search_of
from automarine_cli.fits.run_effects import RunEffects
from automarine_cli.fits.variances import deviance
from automarine_cli.quantities import Floats
from automarine_cli.simulation.batch import Channel

Response = Callable[[Floats, Floats], Floats]
"""Readings (P, R, N) of all channels one after the other, for theta (P, p) and run effects (P, R, q)."""

LEAST_NOISE = 1e-4
"""Where the fit of a channel's noise starts at least [its unit]."""

CHI2_95 = float(2.0 * special.gammaincinv(0.5, 0.95))
"""Rise of a deviance at the ends of a 95 % interval."""

FEWEST_READINGS = 8
"""Readings from which on their noise can be told roughly."""

Slopes = Callable[[Floats, Floats], tuple[Floats, Floats, Floats]]
"""Readings (R, N) for one theta (p,) and run effects (R, q), and their derivatives, (R, N, p) and (R, N, q); zero in
the padding."""

SWITCH = "switch-instant"
"""Name of the last entry of theta: where in their sample intervals the commands of all runs change."""


@dataclass(frozen=True)
class Slot:
    """One channel's place among the readings: columns `part` of the N. `noise` is where a fit of its noise starts [its
    unit]; one that does not `count` is simulated for people to look at, and no evidence."""

    name: str
    part: slice
    noise: float = 0.0
    counts: bool = True


def slots_of(channels: Sequence[Channel]) -> tuple[Slot, ...]:
    """The places of channels whose readings stand one after the other."""
    found, at = [], 0
    for channel in channels:
        width = channel.values.shape[1]
        read = [series_noise(v[s]) for v, s in zip(channel.values, channel.seen) if s.any()]
        noise = float(np.median(read)) if read else 0.0
        found.append(Slot(channel.quantity, slice(at, at + width), max(noise, LEAST_NOISE), channel.counts))
        at += width
    return tuple(found)


def series_noise(values: Floats) -> float:
    """A rough standard deviation of the noise on readings (n,): of their second differences."""
    if len(values) < FEWEST_READINGS:
        return 0.0
    return float(np.median(np.abs(np.diff(values, 2)))) / 0.6745 / np.sqrt(6.0)


@dataclass(frozen=True)
class Problem:
    """Measured readings (R, N) with their mask, the response, the run effects, and bounds of theta (p, 2).

    `names` are those of theta's entries. `positive` (p,) marks the parameters that are searched, and whose intervals
    are formed, on the logarithm. `slots` are the channels, the first that counts first. Where runs were reduced (see
    nodes.py) `samples` (R, C) is how many each counted channel had and `left` (R, C) the part of their sums of squares
    that no parameters change. Without `slopes` derivatives are differences. `known` are parameters that are known
    beforehand.
    """

    response: Response
    measured: Floats
    seen: NDArray[np.bool_]
    effects: RunEffects
    bounds: Floats
    positive: NDArray[np.bool_]
    names: tuple[str, ...]
    slots: tuple[Slot, ...]
    samples: NDArray[np.int64] | None = None
    left: Floats | None = None
    slopes: Slopes | None = None
    known: Mapping[str, Prior] = field(default_factory=dict)

    def informed(self, known: Mapping[str, Prior]) -> "Problem":
        """The same problem with parameters that are `known` beforehand, by name."""
        return replace(self, known=known, bounds=bounds_of(known, self.names, self.bounds))

    @cached_property
    def prior(self) -> tuple[Floats, Floats] | None:
        """Mean (p,) and precision (p, p) of phi before the data; None where nothing is known."""
        return prior_of(self.known, self.names, self.positive)

    @cached_property
    def counted(self) -> tuple[Slot, ...]:
        """The channels whose readings are evidence."""
        return tuple(slot for slot in self.slots if slot.counts)

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """Samples of each run and counted channel, (R, C)."""
        if self.samples is not None:
            return self.samples
        return np.stack([self.seen[:, slot.part].sum(axis=1) for slot in self.counted], axis=1)

    def of(self, readings: NDArray[Any], channel: str) -> NDArray[Any]:
        """The readings (..., n) of one channel out of all, (..., N)."""
        return readings[..., next(slot.part for slot in self.slots if slot.name == channel)]

    def residual(self, fitted: Floats) -> Floats:
        """What readings (..., R, N) leave of the measured ones, zero in the padding."""
        return np.where(self.seen, self.measured - fitted, 0.0)

    def squares(self, residual: Floats, variances: Floats) -> Floats:
        """Each run's sum of squares of residuals (..., R, N) in units of their channels' noise, (..., R)."""
        total = np.zeros(residual.shape[:-1])
        for slot, log_noise in zip(self.counted, variances):
            total = total + (residual[..., slot.part] ** 2).sum(axis=-1) / np.exp(2.0 * log_noise)
        return total

    def precision(self, noises: Floats) -> Floats:
        """One over the noise of each reading, (N,); zero for those that do not count."""
        found = np.zeros(self.seen.shape[1])
        for slot, noise in zip(self.counted, noises):
            found[slot.part] = 1.0 / noise
        return found

    def gram(self, by_phi: Floats, by_run: Floats, fitted: Floats, b: Floats, phi: Floats | None = None) -> Grams:
        """Inner products of the problem linearised about readings `fitted` (R, N) at run effects `b` (R, q); what is
        known beforehand is about phi (p,)."""
        found, prior = self.inner(by_phi, by_run, self.residual(fitted), b), self.prior
        return found if prior is None or phi is None else replace(found, prior=(prior[0] - phi, prior[1]))

    def inner(self, by_phi: Floats, by_run: Floats, residual: Floats, b: Floats | None = None) -> Grams:
        """The same of any residuals (R, N), zero in the padding; b zero where not given."""
        parts = []
        for c, slot in enumerate(self.counted):
            here = slot.part
            gram = Gram.of(by_phi[:, here], by_run[:, here], residual[:, here], self.count[:, c], b)
            parts.append(gram if self.left is None else replace(gram, ww=gram.ww + self.left[:, c]))
        return Grams(tuple(parts))

    def natural(self, phi: Floats) -> Floats:
        """theta (..., p) of the search's coordinates phi."""
        return natural_of(phi, self.positive)

    def search(self, theta: Floats) -> Floats:
        """phi (..., p) of theta; a positive parameter at zero counts as `SMALLEST`."""
        return search_of(theta, self.positive)

    def readings(self, phi: Floats, b: Floats) -> Floats:
        """Readings (R, N) at one phi (p,) and b (R, q)."""
        return self.response(self.natural(phi)[None], b[None])[0]


@dataclass(frozen=True)
class MixedFit(Outcome):
    """Outcome of a fit of the mixed model: also `noises` (C,) of the counted channels, `factors` of the run effects,
    `run_effects` (R, q), and the `fitted` readings (R, N)."""

    noises: Floats
    factors: Floats
    run_effects: Floats
    fitted: Floats
    slots: tuple[Slot, ...]
    gram: Grams = field(repr=False)
    effects: RunEffects = field(repr=False)

    def reading(self, channel: str) -> Floats:
        """The fitted readings (R, n) of one channel."""
        return self.fitted[:, next(slot.part for slot in self.slots if slot.name == channel)]

    @property
    def noise_of(self) -> dict[str, float]:
        """Noise of each counted channel by its quantity [its unit]."""
        counted = [slot.name for slot in self.slots if slot.counts]
        return {name: float(noise) for name, noise in zip(counted, self.noises)}

    @property
    def of_model(self) -> Floats:
        """The model's own entries of theta: all but the instant of the switches."""
        return self.theta[[name != SWITCH for name in self.names]]

    @property
    def read(self) -> dict[str, int]:
        """How many readings each counted channel has."""
        return {name: int(gram.count.sum()) for name, gram in zip(self.noise_of, self.gram.channels)}

    @property
    def information(self) -> Floats:
        """What each run says of phi, (R, p, p)."""
        free = np.setdiff1d(np.arange(len(self.phi)), self.at_bound)
        found = np.zeros((len(self.left_out), len(self.phi), len(self.phi)))
        found[:, free[:, None], free] = linear_mixed.weigh(self.gram, self.effects, self.variances).hessian
        return found

    @property
    def variances(self) -> Floats:
        """Logarithms of noises and factors, as `linear_mixed` takes them."""
        return np.log([*self.noises, *np.maximum(self.factors, SMALLEST_FACTOR)])

    def factor(self, block: str) -> float:
        """The estimated factor of a block of run effects."""
        return float(self.factors[self.effects.factor_names.index(block)])

    def own(self, block: str) -> Floats:
        """Each run's own effects (R, k) of one block."""
        return self.effects.of(self.run_effects, block)

    def factor_interval(self, block: str) -> tuple[float, float]:
        """95 % interval of one block's factor: where the restricted deviance rises by 3.84, the other
        variances fixed."""
        index = self.effects.factor_names.index(block)
        best, limits = self.variances, self.effects.limits[index]
        place = len(self.noises) + index
        level = self._deviance(best) + CHI2_95

        def above(log_factor: float) -> float:
            trial = best.copy()
            trial[place] = log_factor
            return self._deviance(trial) - level

        ends = []
        for limit in limits:
            edge = float(np.log(max(limit, SMALLEST_FACTOR)))
            inside = above(edge) <= 0 or abs(edge - best[place]) < 1e-9
            ends.append(edge if inside else float(optimize.brentq(above, edge, best[place], xtol=1e-6)))
        low, high = np.exp(ends)
        return (0.0 if low <= max(limits[0], SMALLEST_FACTOR) * (1 + 1e-9) else float(low)), float(high)

    def _deviance(self, variances: Floats) -> float:
        return deviance(self.gram, self.effects, variances, restricted=True)


def without_held(problem: Problem, held: NDArray[np.bool_]) -> Problem:
    """The problem without the parameters that are held: their direction may be that of others (the moment at which a
    loss is told, and the loss), and would take the search with it."""
    values = problem.bounds[:, 0]

    def response(theta: Floats, b: Floats) -> Floats:
        whole = np.tile(values, (len(theta), 1))
        whole[:, ~held] = theta
        return problem.response(whole, b)

    def slopes(theta: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
        assert problem.slopes is not None
        whole = values.copy()
        whole[~held] = theta
        readings, by_theta, by_run = problem.slopes(whole, b)
        return readings, by_theta[:, :, ~held], by_run

    names = tuple(name for name, h in zip(problem.names, held) if not h)
    known = {name: one for name, one in problem.known.items() if name in names}
    return replace(
        problem, response=response, bounds=problem.bounds[~held], positive=problem.positive[~held], names=names,
        slopes=None if problem.slopes is None else slopes, known=known,
    )  # fmt: skip


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
        fit, names=problem.names, theta=theta, phi=phi, positive=problem.positive, covariance=covariance,
        left_out=left_out, at_bound=at_bound, known=problem.known,
    )  # fmt: skip
