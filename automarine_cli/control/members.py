"""What is uncertain of a vehicle, as a crowd of vehicles each of which may be the one in the pool."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats

THRUST_BY_VOLTAGE = 1.2
"""Exponent of thrust against supply voltage at a fixed command: Blue Robotics, T200 performance data (2019)."""
LIGHTEST = 0.2
"""Share of the inertia that a delay which was never looked for leaves at least."""
UNKNOWN = 0.1
"""Standard error, as a share, of a parameter of which the file tells none."""


@dataclass(frozen=True)
class Bend:
    """What share of the full moment an output gives, odd: `output` (K,) from 0 to 1 and `share` (K,), which rises."""

    output: Floats
    share: Floats

    def of(self, output: Floats) -> Floats:
        """Share of the full moment at an output, arrays of any shape."""
        return np.asarray(np.sign(output) * np.interp(np.abs(output), self.output, self.share))

    def inverse(self, share: Floats) -> Floats:
        """The output that gives a share of the full moment; within the dead-band it jumps to its edge."""
        first = int(np.searchsorted(self.share, 0.0, side="right")) - 1
        edge = np.interp(np.abs(share), self.share[first:], self.output[first:])
        return np.asarray(np.sign(share) * edge)

    def slope(self, output: Floats) -> Floats:
        """How the share grows with the output, at outputs of any shape."""
        here = np.clip(np.searchsorted(self.output, np.abs(output)), 1, len(self.output) - 1)
        return np.asarray(np.diff(self.share)[here - 1] / np.diff(self.output)[here - 1])


@dataclass(frozen=True)
class Vehicles:
    """S vehicles of one form.

    `theta` (S, p) parameters of `model`; `full` the moment or force of the whole output; `gain` (S,) of the thrust,
    `late` (S,) [s] a delay beyond the model's, `volts` (S,) [V] of the supply, `at` (S,) the output about which its
    slope counts in margins; `bend` the map from output to moment where that is no straight line; `noise` of the
    readings of position and velocity [base units].
    """

    model: YawModel
    theta: Floats
    full: float
    gain: Floats
    late: Floats
    volts: Floats
    at: Floats
    bend: Bend | None = None
    noise: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.theta)

    def pick(self, which: NDArray[np.int64] | slice) -> "Vehicles":
        """Some of them."""
        own = ("theta", "gain", "late", "volts", "at")
        return replace(self, **{name: getattr(self, name)[which] for name in own})

    def times(self, count: int) -> "Vehicles":
        """Each of them again for each of `count` sets of gains, the sets slowest."""
        return self.pick(np.tile(np.arange(len(self)), count))


@dataclass(frozen=True)
class Spread:
    """How uncertain a model is: `covariance` of theta (p, p), `scatter` of the thrust from run to run, `late` the
    longest delay [s] that the logs cannot show, `volts` of the logs and of the supply when it is lowest and highest,
    `noise` of the readings of position and velocity [base units], `heavy` what each second of delay beyond the model's
    has added to its inertia."""

    covariance: Floats
    scatter: float
    late: float
    volts: tuple[float, float, float]
    noise: tuple[float, float] = (0.0, 0.0)
    heavy: float = 0.0


def crowd(
    model: YawModel, spread: Spread, full: float, bend: Bend | None, count: int, rng: np.random.Generator
) -> Vehicles:
    """`count` vehicles, the first of them as the model says."""
    theta = _drawn(model, spread.covariance, count, rng)
    logged, low, high = spread.volts
    volts = np.append(logged, rng.uniform(low, high, count - 1))
    gain = np.exp(spread.scatter * np.append(0.0, rng.standard_normal(count - 1)))
    if not any("voltage" in effects.get(term.name).needs for term in model.terms):
        gain = gain * (volts / logged) ** THRUST_BY_VOLTAGE
    late = np.append(0.5 * spread.late, rng.uniform(0.0, spread.late, count - 1))
    at = np.append(0.5, rng.uniform(0.2, 1.0, count - 1))
    theta[:, 0] = np.maximum(theta[:, 0] - spread.heavy * late, LIGHTEST * theta[:, 0])
    return Vehicles(model, theta, full, gain, late, volts, at, bend, spread.noise)


def _drawn(model: YawModel, covariance: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Parameters (count, p) about the model's; those of the sign-definite base on the logarithm, all within bounds.

    What has no variance is exactly the model's: which law acts is a number that others are compared with.
    """
    theta = model.theta
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    moved = rng.standard_normal((count, len(theta))) @ root.T
    moved[0] = 0.0
    positive = (theta > 0) & (np.sqrt(np.diagonal(covariance)) < theta)
    size = np.where(positive, theta, 1.0)
    drawn = np.where(positive, size * np.exp(moved / size), theta + moved)
    lower, upper = bounds(model)
    return np.where(np.diagonal(covariance) > 0, np.clip(drawn, lower, upper), theta)


def bounds(model: YawModel) -> tuple[Floats, Floats]:
    """Smallest and largest values of theta (p,) that its terms allow."""
    own = [parameter for term in model.terms for parameter in effects.get(term.name).parameters]
    lower = np.array([1e-9, *(one.lower for one in own)])
    return lower, np.array([np.inf, *(one.upper for one in own)])


def together(groups: Sequence[Floats]) -> Floats:
    """What was worked out of several groups of vehicles, as of one."""
    return np.concatenate(list(groups), axis=0)
