"""What a bollard test comes down to: one point for each constant command, frozen."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
    def measured(
        cls, n: Floats, force: Floats, when: Floats, voltage: Floats | None, record: int
    ) -> "Points":
        """Single readings of one record, none of them flagged."""
        size = len(n)
        nothing = np.full(size, np.nan)
        return cls(
            n=n,
            force=force,
            spread=nothing,
            count=np.ones(size, dtype=np.int64),
            stderr=nothing,
            when=when,
            record=np.full(size, record, dtype=np.int64),
            voltage=nothing if voltage is None else voltage,
            raw=np.zeros(size, dtype=bool),
            weight=np.ones(size),
            flag=np.full(size, "", dtype="<U120"),
        )

    def where(self, mask: NDArray[np.bool_]) -> "Points":
        """The points that `mask`, shape (P,), keeps."""
        return replace(self, **{name: getattr(self, name)[mask] for name in self.__dataclass_fields__})

    def divided(self, thrusters: int) -> "Points":
        """Thrust of one of `thrusters` equal thrusters that pulled together (equation 3)."""
        names = ("force", "spread", "stderr")
        return replace(self, **{name: getattr(self, name) / thrusters for name in names})

    @property
    def full_scale(self) -> float:
        """Largest thrust measured [N], flagged points left out."""
        return float(np.max(np.abs(self.force[self.flag == ""]), initial=0.0))


def join(parts: list[Points]) -> Points:
    """All points one after the other."""
    return Points(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in Points.__annotations__}
    )
