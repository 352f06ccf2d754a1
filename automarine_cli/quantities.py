"""The nomenclature: names, symbols, units and signs used everywhere (SNAME 1950; Fossen 2011).

Inside automarine angles are radians, times seconds, forces newtons; degrees appear only at the edges
(columns and keys whose name ends in `_deg`, and every figure). Yaw is positive clockwise seen from above.
The yaw moment carries the unit of the logs: "nu", the normalised moment unit of the source paper, or "N m".
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating[Any, Any]]

STEERED = "rad"
"""Unit of the command of a vehicle that is steered: the angle of its rudder stands for the moment, up to its scale."""
RUDDER_COLUMN = "rudder_deg"  # in which that is logged
CLOCK, SINCE = "campaign-clock", "time-since-command-change"
"""Signals that every log has beside its columns: its clock, and the time since its command last changed, both [s]."""
