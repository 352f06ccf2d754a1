"""The turn about the vertical axis that a quaternion holds."""

import numpy as np

from automarine_cli.logs.table import Floats


def yaw_of(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Yaw [rad] of unit quaternions, shape (N,), from -pi to pi: the last of the turns z-y-x (Diebel 2006, eq. 290).

    NaN where there is no direction: PX4 and ROS say so by zeros or NaN.
    """
    yaw = np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)
    with np.errstate(invalid="ignore"):
        return np.where(w**2 + x**2 + y**2 + z**2 > 0.5, yaw, np.nan)
