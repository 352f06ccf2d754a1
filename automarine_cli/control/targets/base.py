"""What a target of `tune` is, and the recipe for the next one.

Recipe: one file in this folder with one subclass of `Target` that says what it is called (`name`, `says`, `source`),
its `parameters` in its own names and units, and does five things: `propose` makes gains of design numbers, `start` and
`step` are the stack as it runs, loop by loop, `paths` the same stack in frequency, `text` its file. The folder is the
registry. All arrays are over sets (S) by flights (R): a set is one vehicle with one set of gains.

Outputs are from -1 to 1, positions and velocities in base units [rad or m].
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from automarine_cli.control.members import Bend
from automarine_cli.dofs import Dof
from automarine_cli.quantities import Complexes, Floats

Gains = Mapping[str, Floats]
"""Parameters by name, (S, 1) each."""
State = tuple[Floats, ...]
BEYOND = 10.0


@dataclass(frozen=True)
class Parameter:
    """One parameter of a stack: what it is in `unit`, its default (None where there is none), and the range that its
    maker documents; `searched` if a design moves it."""

    name: str
    meaning: str
    unit: str
    default: float | None
    low: float = 0.0
    high: float = np.inf
    searched: bool = False


@dataclass(frozen=True)
class Nominal:
    """The vehicle as a designer sees it: `inertia`, `linear` and `quadratic` drag per moment at the whole output, all
    lags and delays of the vehicle together [s], the `fastest` steady velocity, and the step of the reference."""

    dof: Dof
    inertia: float
    linear: float
    quadratic: float
    lag: float
    fastest: float
    step: float
    full: float
    force_unit: str
    bend: Bend | None = None

    def model(self, count: int) -> dict[str, Floats]:
        """The values of `MODEL`, (count,) each."""
        same = np.ones(count)
        return {"inertia": same * self.inertia, "drag": same * self.linear, "squared": same * self.quadratic}


@dataclass(frozen=True)
class Design:
    """What a file is written of: gains, those of before, the vehicle, and sentences on where it is from."""

    gains: Mapping[str, float]
    before: Mapping[str, float]
    nominal: Nominal
    notes: Sequence[str] = field(default_factory=tuple)


MODEL = (
    Parameter("inertia", "inertia per moment of the whole output", "s²/{x}", None),
    Parameter("drag", "its linear drag", "s/{x}", None),
    Parameter("squared", "its quadratic drag", "s²/{x}²", None),
)
"""What controllers made of the identified model take from it."""


class Target(ABC):
    """One stack; see the module's docstring."""

    name: ClassVar[str]
    says: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    file: ClassVar[str]
    firmware: ClassVar[str] = ""
    """What the parameters are of, where names and units differ from version to version."""
    motions: ClassVar[tuple[str, ...]] = ("yaw",)
    integrators: ClassVar[int] = 1
    """How many integrators a position goes through on its way to the output."""
    numbers: ClassVar[int]
    """How many design numbers `propose` takes."""
    linear: ClassVar[bool] = False
    """Whether it, or what stands behind it, makes up for the map from output to moment."""
    period: float
    timed: ClassVar[bool] = False
    """Whether whoever flies it may choose its sample time."""

    def __init__(self, period: float | None = None, beyond: bool = False) -> None:
        """Loops of `period` [s] where one is given; gains `beyond` the documented ranges where that is allowed."""
        self.beyond = beyond
        if period is not None:
            self.period = period

    @property
    def defaults(self) -> dict[str, float]:
        """Default values by name."""
        return {one.name: one.default for one in self.parameters if one.default is not None}

    @property
    def has_defaults(self) -> bool:
        """Whether a vehicle flies with something before it was tuned."""
        return len(self.defaults) == len(self.parameters)

    @abstractmethod
    def propose(self, numbers: Floats, nominal: Nominal) -> dict[str, Floats]:
        """Gains (C,) by name of design numbers (C, numbers) between 0 and 1; within the documented ranges."""

    def prepared(self, gains: Gains) -> Gains:
        """The gains with what `step` needs of them at every loop, worked out once."""
        return gains

    @abstractmethod
    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        """The stack at rest at a position (S, R), with what holds the vehicle there in its integrator."""

    @abstractmethod
    def step(
        self, state: State, gains: Gains, reference: Floats, position: Floats, velocity: Floats
    ) -> tuple[State, Floats]:
        """One loop: the next state, and the output (S, R) held until the next loop."""

    @abstractmethod
    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        """-output per position and per velocity at s (W,), (S, W) each, with the hold and the loop's own delays."""

    @abstractmethod
    def text(self, design: Design) -> str:
        """The file."""

    def own_lag(self, gains: Gains) -> float:
        """Delay [s] of the stack itself, about."""
        return 1.5 * self.period

    def clipped(self, gains: dict[str, Floats]) -> dict[str, Floats]:
        """Gains within their documented ranges, or ten times further where that is allowed."""
        own, further = {one.name: one for one in self.parameters}, BEYOND if self.beyond else 1.0
        return {
            name: np.clip(value, own[name].low / further, own[name].high * further) for name, value in gains.items()
        }


def share(step: float, cutoff: Floats | float) -> Floats:
    """Weight of the new value in a first-order low-pass of `cutoff` [Hz] at loops of `step` [s]; 0 Hz is none."""
    rate = 2.0 * np.pi * step * np.asarray(cutoff, dtype=float)
    return np.where(rate > 0, rate / (1.0 + rate), 1.0)


def low_pass(weight: Floats, z: Complexes) -> Complexes:
    """The same in frequency."""
    return np.asarray(weight / (1.0 - (1.0 - weight) / z))


def hold(s: Complexes, step: float) -> Complexes:
    """An output that is held over each loop."""
    return np.asarray((1.0 - np.exp(-s * step)) / (s * step))


def within(value: Floats, most: Floats | float) -> Floats:
    """`value` no larger than `most` on either side."""
    return np.minimum(np.maximum(value, -most), most)


def summed(integral: Floats, grown: Floats, now: Floats, error: Floats) -> Floats:
    """The integrator after a loop: `grown`, unless the output is at its limit and the error would carry it further."""
    out = now + grown
    return np.where((np.abs(out) > 1.0) & (out * error > 0), integral, grown)


def spread(number: Floats, low: float, high: float) -> Floats:
    """A design number between 0 and 1 as one between `low` and `high`, in equal ratios."""
    return np.asarray(low * (high / low) ** number)


def leads(number: Floats) -> Floats:
    """A design number as the time of a derivative, in shares of all that is slow: none up to a fifth, then up to one
    and a half times as long."""
    return np.asarray(1.5 * np.maximum(number - 0.2, 0.0) / 0.8)
