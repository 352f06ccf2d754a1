"""What the columns of logs do: the evidence by which `recognise` takes them for something."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from automarine_cli.logs.canonical import CANONICAL, unit_in
from automarine_cli.logs.cells import read_stamps
from automarine_cli.logs.formats import RawLog
from automarine_cli.logs.mixing import WISHES

PULSES = (800, 1500, 2200)  # us: shortest, neutral, longest pulse of a hobby servo or thruster
WHOLE = (1.0, 100.0)  # the largest value of a throttle


@dataclass(frozen=True)
class Span:
    """What the values of one column do, over one log or many: ends, steps from one row to the next, and the median.

    `made_from` names the outputs that it was worked back from, where no file holds it. Of a column of times `stamps`
    says what they are (`stamps.KINDS`), and `open` that day and month may be exchanged.
    """

    low: float
    high: float
    median_step: float
    largest_step: float
    middle: float = float("nan")
    stamps: str = ""
    open: bool = False
    made_from: str = ""

    def __add__(self, other: "Span") -> "Span":
        return Span(
            min(self.low, other.low), max(self.high, other.high),
            float(np.median([self.median_step, other.median_step])), max(self.largest_step, other.largest_step),
            float(np.median([self.middle, other.middle])), self.stamps or other.stamps, self.open and other.open,
            self.made_from or other.made_from,
        )  # fmt: skip


def is_pulses(name: str, one: Span) -> bool:
    """Whether values may be what is sent to a thruster's driver: pulse lengths [us] that change, about neutral."""
    low, neutral, high = PULSES
    return unit_in(name) in ("", "us") and low <= one.low <= neutral <= one.high <= high and one.largest_step > 0


def pulses(seen: Mapping[str, Span]) -> tuple[str, ...]:
    """Columns that may be pulses to thrusters."""
    return tuple(name for name, one in seen.items() if name not in CANONICAL and is_pulses(name, one))


def spans(raw: RawLog) -> dict[str, Span]:
    """What every column of numbers or of times of a file does, in the units of the file."""
    found = {}
    for name, array in zip(raw.names, raw.arrays):
        number = pa.types.is_floating(array.type)
        stamps = None if number else read_stamps(array)
        if not name or not (number or stamps):
            continue
        values = np.asarray(array.to_numpy()) if stamps is None else stamps.seconds
        good = values[np.isfinite(values)]
        if len(good):
            steps = np.abs(np.diff(good))
            moved = steps[steps > 0]
            found[name] = Span(
                float(good.min()), float(good.max()), float(np.median(moved)) if len(moved) else 0.0,
                float(steps.max(initial=0.0)), float(np.median(good)),
                stamps.kind if stamps else "", stamps is not None and stamps.open,
                raw.origin.made_from if name in WISHES else "",
            )  # fmt: skip
    return found


def is_share(one: Span) -> bool:
    """Whether values may be a throttle, -1 to 1 or 0 to 100 and the like."""
    largest = max(abs(one.low), abs(one.high))
    return any(abs(largest - whole) <= 0.002 * whole for whole in WHOLE)
