"""What ArduPilot's dataflash and telemetry logs share: the names of modes, and of arming."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def mode_names(codes: NDArray[Any], vehicle: int) -> NDArray[np.str_]:
    """Names of flight modes, shape (N,), for a MAV_TYPE; a mode without a name keeps its number."""
    from pymavlink.mavutil import mode_mapping_bynumber

    if codes.dtype.kind not in "iuf":
        return codes.astype(str)
    known = mode_mapping_bynumber(vehicle) or {}
    found, at = np.unique(codes, return_inverse=True)
    return np.array([known.get(int(code), f"mode {int(code)}") for code in found], dtype=str)[at]


def arming(armed: NDArray[np.bool_]) -> NDArray[np.str_]:
    """`armed` or `disarmed`, shape (N,)."""
    return np.where(armed, "armed", "disarmed")
