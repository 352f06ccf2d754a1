"""The likelihood of driven and disturbed runs, and what is random in it; see innovations.py for the method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import FAR, Followed, Noises, follow
from automarine_cli.filters.nodes import least_noise
from automarine_cli.fits.known import Prior, bounds_of, prior_of
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.fits.outcome import natural_of, search_of
from automarine_cli.models.vehicle import Vehicle
from automarine_cli.quantities import Floats

DIFFERENCE = 1e-5
"""Share of a parameter by which it is moved for its derivative."""
LEAST_SIZE = 1e-4
"""Smallest disturbance, as a share of the acceleration that the largest command gives."""


@dataclass(frozen=True)
class Randomness:
    """One parameter of what is random: its name, limits, and a log-normal prior (median, spread of the logarithm), or
    a normal one where it may be negative (`signed`)."""

    name: str
    lower: float
    upper: float
    median: float
    spread: float
    signed: bool = False


@dataclass(frozen=True)
class DrivenProblem:
    """Likelihood of a model on a course. theta is the model's parameters, then those of `random`, in the order that
    `noises` takes them; `bounds` (p, 2) and `positive` (p,) are those of theta, `scale` (p,) what is a small step.
    `smooth` (p, p) is the precision about zero of parameters that are not positive, as of a smooth curve; `known` are
    parameters that are known beforehand.
    """

    model: Vehicle
    course: Course
    names: tuple[str, ...]
    bounds: Floats
    positive: NDArray[np.bool_]
    scale: Floats
    random: tuple[Randomness, ...]
    smooth: Floats | None = None
    known: Mapping[str, Prior] = field(default_factory=dict)

    def informed(self, known: Mapping[str, Prior]) -> "DrivenProblem":
        """The same problem with parameters that are `known` beforehand, by name."""
        return replace(self, known=known, bounds=bounds_of(known, self.names, self.bounds))

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Parameters that are not held."""
        return np.flatnonzero(self.bounds[:, 0] < self.bounds[:, 1])

    @cached_property
    def limits(self) -> Floats:
        """Bounds in the search's coordinates, (p, 2)."""
        return np.stack([self.search(end) for end in self.bounds.T], axis=1)

    @cached_property
    def priors(self) -> tuple[Floats, Floats]:
        """Mean (p,) and precision (p, p) of phi before the data; no precision where nothing is known."""
        count = len(self.names)
        mean, precision = np.zeros(count), np.zeros((count, count))
        for i, one in enumerate(self.random, count - len(self.random)):
            mean[i] = one.median if one.signed else np.log(one.median)
            precision[i, i] = one.spread**-2
        if (known := prior_of(self.known, self.names, self.positive)) is not None:
            mean, precision = mean + known[0], precision + known[1]
        return mean, precision if self.smooth is None else precision + self.smooth

    @cached_property
    def prior_information(self) -> Floats:
        """What the prior says of the free parameters, (f, f)."""
        return self.priors[1][np.ix_(self.free, self.free)]

    def prior_gradient(self, phi: Floats) -> Floats:
        """Slope of the prior's log density by the free parameters at phi (p,), (f,)."""
        mean, precision = self.priors
        return np.asarray(-(precision @ (phi - mean))[self.free])

    def natural(self, phi: Floats) -> Floats:
        """theta (..., p) of the search's coordinates phi."""
        return natural_of(phi, self.positive)

    def search(self, theta: Floats) -> Floats:
        """phi (..., p) of theta."""
        return search_of(theta, self.positive)

    def noises(self, theta: Floats) -> Noises:
        """The sizes of what is random in theta (P, p)."""
        dofs, channels = len(self.course.motion.dofs), len(self.course.channels)
        rest = list(theta[:, len(self.names) - len(self.random) :].T)
        size, time, thrust = (np.array([rest[3 * d + i] for d in range(dofs)]) for i in range(3))
        gain, late, at = rest[3 * dofs], rest[3 * dofs + 1], 3 * dofs + 2
        own = {one.name.partition(".")[0]: rest[i] for i, one in enumerate(self.random[at + channels :], at + channels)}
        return Noises(size, time, thrust, gain, late, np.array(rest[at : at + channels]), own)

    def follow(self, phi: Floats, keep: bool = False, course: Course | None = None) -> Followed:
        """Filter the runs under phi (P, p), or those of another course."""
        theta = self.natural(phi)
        own = len(self.names) - len(self.random)
        return follow(self.model, course or self.course, theta[:, :own], self.noises(theta), keep)

    def value(self, phi: Floats) -> Floats:
        """Log density of all runs with the prior, (P,); minus infinity where a filter diverges."""
        density = self.follow(phi).log_density.sum(axis=1) + self.prior(phi)
        return np.where(np.isfinite(density), density, -np.inf)

    def prior(self, phi: Floats) -> Floats:
        """Log density of phi (..., p) before the data, up to a constant."""
        mean, precision = self.priors
        return np.asarray(-0.5 * np.einsum("...i,ij,...j->...", phi - mean, precision, phi - mean))

    def steps(self, phi: Floats) -> Floats:
        """By how much each free parameter is moved for its derivative, (f,)."""
        size = np.where(self.positive, 1.0, np.maximum(np.abs(phi), self.scale))
        return DIFFERENCE * size[self.free]

    def moved(self, phi: Floats) -> Floats:
        """phi (p,) itself and with each free parameter moved by its step, (1 + f, p)."""
        moved = np.tile(phi, (1 + len(self.free), 1))
        moved[np.arange(1, len(moved)), self.free] += self.steps(phi)
        return moved

    def slopes(self, phi: Floats) -> list["Slopes"]:
        """Each run's gradient and information by the free parameters at each phi (P, p), all filtered together."""
        found, count = self.follow(np.concatenate([self.moved(one) for one in phi])), 1 + len(self.free)
        parts = [slice(i * count, (i + 1) * count) for i in range(len(phi))]
        return [Slopes.of([innovations_of(found, part, self.steps(one))]) for part, one in zip(parts, phi)]


@dataclass(frozen=True)
class Innovations:
    """Innovations `error` (C, R, K), their `variance`, one where nothing was `read`, the derivatives of both by some
    parameters, (C, f, R, K), none where a filter runs away, and the log density of each run (R,)."""

    error: Floats
    variance: Floats
    read: NDArray[np.bool_]
    by: Floats
    spread: Floats
    density: Floats


@np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
def innovations_of(found: Followed, part: slice, steps: Floats | float, base: Innovations | None = None) -> Innovations:
    """Innovations at a point, and how they change per step from there to the parameter sets `part` of what was
    filtered. The point is that of `base` if it is given, else the first of them."""
    error, variance, density = found.innovation[:, part], found.variance[:, part], found.log_density[part]
    if base is None:
        read = variance[:, 0] > 0
        base = Innovations(
            error[:, 0], np.where(read, variance[:, 0], 1.0), read, error[:, :0], error[:, :0], density[0]
        )
        error, variance = error[:, 1:], variance[:, 1:]
    step = np.broadcast_to(steps, error.shape[1])[:, None, None]
    by = np.where(base.read[:, None], (error - base.error[:, None]) / step, 0.0)
    spread = np.where(base.read[:, None], (variance - base.variance[:, None]) / step, 0.0)
    sane = np.isfinite(np.sum(by + spread, axis=(0, 2, 3), keepdims=True))[0]
    return replace(base, by=np.where(sane, by, 0.0), spread=np.where(sane, spread, 0.0))


@dataclass(frozen=True)
class Slopes:
    """Each run's log density (R,), its gradient (R, f) and Fisher information (R, f, f) by f parameters."""

    density: Floats
    gradient: Floats
    information: Floats

    def value(self, problem: DrivenProblem, phi: Floats) -> float:
        """Log density of all runs with the prior; minus infinity where a filter diverges."""
        total = float(self.density.sum() + problem.prior(phi))
        return total if np.isfinite(total) else -np.inf

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # where a filter runs away
    def of(cls, parts: Sequence[Innovations]) -> "Slopes":
        """From innovations about one point, with derivatives by different parameters, in their order."""
        base = parts[0]
        by, spread = (np.concatenate(list(one), axis=1) for one in zip(*((p.by, p.spread) for p in parts)))
        root = np.sqrt(base.variance)
        z = np.where(base.read, base.error / root, 0.0)
        bounded = np.clip(z, -FAR, FAR)
        columns, spreads = by / root[:, None], spread / base.variance[:, None]
        gradient = -np.einsum("crk,cfrk->rf", bounded, columns)
        gradient += 0.5 * np.einsum("crk,cfrk->rf", np.where(base.read, bounded * z - 1.0, 0.0), spreads)
        c, f, r, k = columns.shape
        flat, wide = (np.moveaxis(x, 2, 0).swapaxes(1, 2).reshape(r, f, c * k) for x in (columns, spreads))
        information = flat @ flat.swapaxes(1, 2) + 0.5 * wide @ wide.swapaxes(1, 2)
        return cls(base.density, gradient, information)


def randomness(
    course: Course, accelerations: Sequence[float], varying: Sequence[str], quiet: bool, delayed: bool = False
) -> tuple[Randomness, ...]:
    """What is random on a course, in the order of `DrivenProblem.noises`.

    `accelerations` (D,) are those that the largest commands give. A `quiet` course has no disturbance and no unsteady
    thrust: the limit of a pool. Where a model is `delayed`, the logger's own delay is part of that.
    """
    found = []
    for dof, push in zip(course.motion.dofs, accelerations):
        least, most = LEAST_SIZE * push, 3.0 * push
        size = (0.0, 0.0) if quiet else (least, most)
        found.append(Randomness(f"{dof.name}.disturbance", *size, 0.05 * push, 3.0))
        time = (2.0, 2.0) if quiet else (0.3, 60.0)
        found.append(Randomness(f"{dof.name}.disturbance-time", *time, 2.0, 1.0))
        thrust = (0.0, 0.0) if quiet else (1e-3, 3.0)
        found.append(Randomness(f"{dof.name}.thrust-noise", *thrust, 0.03, 2.0))
    found.append(Randomness("gain-scatter", 1e-3, 0.3, 0.04, 0.5))
    most = 0.0 if delayed else 0.5
    found.append(Randomness(SWITCH, -most, most, 0.0, 3.0, signed=True))
    for channel, noise in zip(course.channels, course.noise):
        floor = least_noise(course.motion.dofs[channel.dof], channel.velocity)
        middle = max(noise, 1.5 * floor)
        found.append(Randomness(f"noise.{channel.quantity}", floor, 100.0 * middle, middle, 0.7))
    largest = float(np.abs(course.held).max())
    found += [Randomness(f"{name}.spread", 1e-4 * largest, largest, 0.05 * largest, 2.0) for name in varying]
    return tuple(found)
