"""What a bollard test comes down to: one point for each constant command; which share a level or a voltage."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

Ints = NDArray[np.int64]

SAME = 0.004  # commands within this share of full scale are one level
MANY = 24  # more levels than this in a direction are left out in blocks of neighbours
BLOCKS = 20
STEP = 0.03  # voltages further apart than this share are two nominal steps
MOST_STEPS = 12  # more voltage steps than this are a drifting supply, not steps


@dataclass(frozen=True)
class Points:
    """Measured points of one thruster, arrays of shape (P,).

    `n` [unit as logged]; `force` [N] of one thruster; `spread` [N] is the standard deviation of the samples
    behind a point, `count` their number, `stderr` [N] the standard error of their mean (both NaN for a single
    reading); `when` is the time [s] or sample number in the record, `record` numbers the test records,
    `voltage` [V] is NaN where it was not logged; `raw` says that the point is the mean of a plateau; `flag`
    is "" or the reason why a point weighs less, `weight` lies in (0, 1].
    """

    n: Floats
    force: Floats
    spread: Floats
    count: Ints
    stderr: Floats
    when: Floats
    record: Ints
    voltage: Floats
    raw: NDArray[np.bool_]
    weight: Floats
    flag: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.n)

    @classmethod
    def measured(cls, n: Floats, force: Floats, when: Floats, voltage: Floats | None, record: int) -> "Points":
        """Single readings of one record, none of them flagged."""
        size = len(n)
        nothing = np.full(size, np.nan)
        return cls(
            n=n, force=force, spread=nothing, count=np.ones(size, dtype=np.int64), stderr=nothing, when=when,
            record=np.full(size, record, dtype=np.int64), voltage=nothing if voltage is None else voltage,
            raw=np.zeros(size, dtype=bool), weight=np.ones(size), flag=np.full(size, "", dtype="<U120"),
        )  # fmt: skip

    def where(self, mask: NDArray[np.bool_]) -> "Points":
        """The points that `mask`, shape (P,), keeps."""
        return replace(self, **{name: getattr(self, name)[mask] for name in self.__dataclass_fields__})

    def divided(self, thrusters: int) -> "Points":
        """Thrust of one of `thrusters` equal thrusters that pulled together (equation 3)."""
        names = ("force", "spread", "stderr")
        return replace(self, **{name: getattr(self, name) / thrusters for name in names})

    @property
    def n_range(self) -> tuple[float, float] | None:
        """The lowest and the highest control signal, None where there is one only."""
        low, high = float(np.min(self.n, initial=np.inf)), float(np.max(self.n, initial=-np.inf))
        return (low, high) if low < high else None

    @property
    def full_scale(self) -> float:
        """Largest thrust measured [N], flagged points left out."""
        return float(np.max(np.abs(self.force[self.flag == ""]), initial=0.0))


def join(parts: list[Points]) -> Points:
    """All points one after the other."""
    return Points(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in Points.__annotations__})


def levels_of(n: Floats) -> Ints:
    """Number of each control signal's level, shape (P,): equal to 0.4 % of full scale is one level."""
    order = np.argsort(n, kind="stable")
    width = SAME * float(np.max(np.abs(n), initial=0.0))
    level, first = np.zeros(len(n), dtype=np.int64), -np.inf
    number = -1
    for index in order:
        # Zero is a level of its own: a small command is not a tare reading.
        if n[index] - first > width or (n[index] == 0.0) != (first == 0.0):
            number, first = number + 1, float(n[index])
        level[index] = number
    return level


def groups_of(n: Floats) -> Ints:
    """What cross-validation leaves out together and what standard errors count as one: a level, shape (P,).

    Closely spaced tables (over 24 levels in a direction) go in 20 blocks of neighbouring levels: a misfit is
    alike in neighbours, so that one level of 100 is no independent witness.
    """
    level = levels_of(n)
    count = int(level.max(initial=-1)) + 1
    if count <= MANY:
        return level
    block = np.repeat(np.arange(BLOCKS), [len(part) for part in np.array_split(np.arange(count), BLOCKS)])
    return block[level].astype(np.int64)


def voltage_steps(voltage: Floats) -> Ints | None:
    """Number of the nominal supply step of each point, shape (P,), rising with the voltage.

    A new step starts where the sorted voltages jump by over 3 %; None without a voltage at every point, or
    where the supply drifts without steps.
    """
    if len(voltage) == 0 or not np.all(np.isfinite(voltage)) or np.any(voltage <= 0):
        return None
    order = np.argsort(voltage, kind="stable")
    jumps = np.diff(np.log(voltage[order])) > STEP
    step = np.zeros(len(voltage), dtype=np.int64)
    step[order[1:]] = np.cumsum(jumps)
    return step if int(step.max()) < MOST_STEPS else None
