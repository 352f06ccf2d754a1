"""What a target of `tune` is, and the recipe for the next one.

Recipe: one file in this folder with one subclass of `Target`, listed in `__init__.py`. It has a `name`, its
`parameters` in its own names and units, and does five things: `propose` makes gains of design numbers, `start` and
`controller` are the stack as it runs, `paths` the same stack in frequency, `text` its file. Arrays are over sets (S) by
flights (R): a set is one vehicle with one set of gains. Outputs are from -1 to 1, positions and velocities in base
units [rad or m]."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Source
from automarine_cli.quantities import STEERED, Complexes, Floats
from automarine_cli.text import printable, quoted

Gains = Mapping[str, Floats]  # parameters by name, (S, 1) each
State = tuple[Floats, ...]
Controller = Callable[[State, Floats, Floats, Floats], tuple[State, Floats]]
RANGE_EXTENSION = 10.0
MAX_PARAMETER_FILE_BYTES = 2_000_000  # bytes of a parameter file; a vehicle has some thousand parameters
LINE = re.compile(r"^\s*(?:\d+[\s,]+\d+[\s,]+)?([A-Z][A-Z0-9_]*)\s*[,\s]\s*(\S+)")


@dataclass(frozen=True)
class Tunable:
    """One parameter of a stack: its default, if any, its documented range; `searched` if a design moves it."""

    name: str
    meaning: str
    unit: str
    default: float | None
    low: float = 0.0
    high: float = np.inf
    searched: bool = False


@dataclass(frozen=True)
class NominalPlant:
    """The vehicle as a designer sees it: `inertia` per moment of the whole output `full`, all its lags and delays [s],
    the `fastest` steady velocity, and the step of the reference. Of what is steered `full` is a rudder angle [rad] and
    `speed` that of its logs [m/s] (None: not logged), `side` -1 where positive rudder turns to port."""

    dof: Dof
    inertia: float
    lag: float
    fastest: float
    step: float
    full: float
    force_unit: str
    speed: float | None = None
    side: int | None = None

    @property
    def steered(self) -> bool:
        return self.force_unit == STEERED

    @property
    def authority(self) -> str:
        """What the whole output gives, in words."""
        if self.steered:
            return f"a rudder of {np.rad2deg(self.full):.4g} degrees"
        return f"{self.full:.4g} {self.force_unit}"


class Target(ABC):
    name: ClassVar[str]
    parameters: ClassVar[tuple[Tunable, ...]]
    file: ClassVar[str]
    firmware: ClassVar[str] = ""  # what the parameters are of, where names and units differ from version to version
    motions: ClassVar[tuple[str, ...]] = ("yaw",)
    numbers: ClassVar[int]  # how many design numbers `propose` takes
    period: float
    rudder: ClassVar[bool] = False  # whether it can turn a vehicle by its rudder
    timed: ClassVar[bool] = False  # whether whoever flies it may choose its sample time

    def __init__(self, period: float | None = None, beyond: bool = False) -> None:
        self.beyond = beyond
        if period is not None:
            self.period = period

    @property
    def defaults(self) -> dict[str, float]:
        return {p.name: p.default for p in self.parameters if p.default is not None}

    @property
    def searched(self) -> list[str]:
        return [p.name for p in self.parameters if p.searched]

    @property
    def ranged(self) -> bool:
        """Whether documented ranges limit the gains."""
        return bool(self.firmware) and not self.beyond

    @property
    def within(self) -> str:
        return " within the documented ranges" if self.ranged else ""

    @abstractmethod
    def propose(self, numbers: Floats, nominal: NominalPlant) -> dict[str, Floats]:
        """Make gains (C,) by name of design numbers (C, numbers) between 0 and 1; within the documented ranges."""

    @abstractmethod
    def start(self, gains: Gains, position: Floats, holding: Floats) -> State:
        """Start the stack at rest at a position (S, R), with what holds the vehicle there in its integrator."""

    @abstractmethod
    def controller(self, gains: Gains) -> Controller:
        """Return one loop: of state, reference, position and velocity the next state and the output (S, R)."""

    @abstractmethod
    def paths(self, gains: Gains, s: Complexes) -> tuple[Complexes, Complexes]:
        """Return -output per position and per velocity at s (W,), (S, W) each, with hold and the loop's delays."""

    @abstractmethod
    def text(self, gains: Mapping[str, float], nominal: NominalPlant, notes: Sequence[str]) -> str:
        """Write the file; `notes` are sentences on where it is from."""

    def steering(self, speed: float | None, usual: float | None) -> float:
        """Return how far it turns a rudder at a `speed`, by outputs that turn it all the way at rest; the parameters
        are made for the `usual` speed [m/s]."""
        return 1.0

    @property
    def own_lag(self) -> float:
        return 1.5 * self.period

    def crossover(self, nominal: NominalPlant) -> float:
        """Return the highest frequency [rad/s] at which a loop can cross over with these delays."""
        return 0.9 / (nominal.lag + self.own_lag)

    def range_of(self, name: str) -> tuple[float, float]:
        """Return the documented range of a parameter, or one ten times further where that is allowed."""
        (parameter,) = (p for p in self.parameters if p.name == name)
        further = RANGE_EXTENSION if self.beyond else 1.0
        return parameter.low / further, parameter.high * further

    def at_ends(self, gains: Mapping[str, float]) -> list[Tunable]:
        """List the parameters whose searched gains documented ranges limit; without a gain at all none does."""
        ends = [(p, gains[p.name]) for p in self.parameters if p.searched and self.ranged]
        return [p for p, gain in ends if gain >= 0.99 * p.high or 0.0 < gain <= 1.01 * p.low]

    def clipped(self, gains: dict[str, Floats]) -> dict[str, Floats]:
        return {name: np.clip(value, *self.range_of(name)) for name, value in gains.items()}


def share(step: float, cutoff: Floats | float) -> Floats:
    """Return the weight of the new value in a low-pass of `cutoff` [Hz] at loops of `step` [s]; 0 Hz is none."""
    rate = 2.0 * np.pi * step * np.asarray(cutoff, dtype=float)
    return np.where(rate > 0, rate / (1.0 + rate), 1.0)


def low_pass(weight: Floats, z: Complexes) -> Complexes:
    """Return the response of a low-pass of a `weight` at z."""
    return np.asarray(weight / (1.0 - (1.0 - weight) / z))


def hold(s: Complexes, step: float) -> Complexes:
    """Return the response at s of an output that is held over each loop of `step` [s]."""
    return np.asarray((1.0 - np.exp(-s * step)) / (s * step))


def within(value: Floats, most: Floats | float) -> Floats:
    return np.minimum(np.maximum(value, -most), most)


def summed(integral: Floats, grown: Floats, now: Floats, error: Floats) -> Floats:
    """Return the integrator after a loop: `grown`, unless the limited output would be carried further."""
    out = now + grown
    return np.where((np.abs(out) > 1.0) & (out * error > 0), integral, grown)


def spread(number: Floats, low: float, high: float) -> Floats:
    """Map a design number between 0 and 1 to one between `low` and `high`, in equal ratios."""
    return np.asarray(low * (high / low) ** number)


def leads(number: Floats) -> Floats:
    """Map a design number to a derivative's time in shares of all that is slow: none up to 0.2, then up to 1.5."""
    return np.asarray(1.5 * np.maximum(number - 0.2, 0.0) / 0.8)


def present_gains(target: Target, source: Source | None) -> Mapping[str, float] | None:
    """Read what a target flies with now: its defaults with the values of a ground station's file (NAME,VALUE or NAME
    VALUE); None where it has neither. Raises SettingError with the line for a value that is wrong."""
    complete = len(target.defaults) == len(target.parameters)
    if source is None:
        return target.defaults if complete else None
    name = printable(source.name)
    if not complete:
        raise SettingError(f"{target.name} reads no parameter file; leave out --present")
    parameters, present = {p.name: p for p in target.parameters}, {}
    with source.open("rb") as file:
        text = file.read(MAX_PARAMETER_FILE_BYTES).decode("utf-8", "replace")
    for row, line in enumerate(text.splitlines(), 1):
        match = LINE.match(line)
        if match is None or match[1] not in parameters:
            continue
        p = parameters[match[1]]
        try:
            value = float(match[2])
        except ValueError:
            raise SettingError(f"{name}, row {row}: {p.name} is {quoted(match[2])}; expected a number") from None
        low, high = target.range_of(p.name)
        if not (low <= value <= high or value == p.default):
            raise SettingError(
                f"{name}, row {row}: {p.name} is {value:g}, outside the range that {target.firmware} documents, "
                f"{p.low:g} to {p.high:g}; correct it on the vehicle, or give --beyond-range where it is meant"
            )
        present[p.name] = value
    if not present:
        raise SettingError(
            f"{name}: none of the parameters of {target.name} is in it; expected lines such as "
            f"{target.parameters[0].name},{target.parameters[0].default:g}"
        )
    return {**target.defaults, **present}
