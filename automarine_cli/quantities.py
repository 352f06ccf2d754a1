"""The nomenclature: names, symbols, units and signs used everywhere (SNAME 1950; Fossen 2011).

Inside automarine angles are radians, times seconds, forces newtons; degrees appear only at the edges
(columns and keys whose name ends in `_deg`, and every figure). Yaw is positive clockwise seen from above.
The yaw moment carries the unit of the logs: "nu", the normalised moment unit of the source paper, or "N m".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating[Any, Any]]

STEERED = "rad"
"""Unit of the command of a vehicle that is steered: the angle of its rudder stands for the moment, up to its scale."""
CLOCK, SINCE = "campaign-clock", "time-since-command-change"
"""Signals that every log has beside its columns: its clock, and the time since its command last changed, both [s]."""


@dataclass(frozen=True)
class Signal:
    """A logged column that effects may read: its `usual` value, how far it goes to both sides of that (`swing`), and
    its `sign` in a mirrored run, -1 of what changes sides."""

    usual: float
    swing: float
    sign: int = 1


SIGNALS: Mapping[str, Signal] = {
    "voltage": Signal(12.0, 1.9),  # V
    "surge": Signal(0.0, 0.4),  # m/s
    "sway": Signal(0.0, 0.2, -1),  # m/s
    "rudder": Signal(0.0, 0.5, -1),  # rad
    "force_X": Signal(0.0, 0.6),  # N
}
"""Signals by their quantities, in the units of all arithmetic."""
