"""Thrusters at places and angles: their forces -> surge force, sway force and yaw moment.

Source: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, second edition (control allocation:
the thrust configuration matrix).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli.errors import ModelError
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Thruster:
    """One thruster `x` ahead of the vehicle's origin and `y` to starboard of it [m]; its force points `angle` [rad]
    clockwise from ahead."""

    name: str
    x: float
    y: float
    angle: float = 0.0


@dataclass(frozen=True)
class Allocation:
    """The thrusters of one vehicle that act in the plane."""

    thrusters: tuple[Thruster, ...]

    @classmethod
    def twin(cls, arm: float) -> "Allocation":
        """Two thrusters that push ahead, `arm` [m] to port and to starboard: X = F_port + F_stbd,
        N = arm (F_port - F_stbd), clockwise."""
        return cls((Thruster("port", 0.0, -arm), Thruster("starboard", 0.0, arm)))

    @property
    def matrix(self) -> Floats:
        """B of (X, Y, N) = B f, (3, thrusters): cos a, sin a and the arm x sin a - y cos a [m]."""
        x, y, angle = np.array([(one.x, one.y, one.angle) for one in self.thrusters], dtype=float).T
        along, abeam = np.cos(angle), np.sin(angle)
        return np.stack([along, abeam, x * abeam - y * along])

    def forces(self, thrust: ArrayLike) -> Floats:
        """X [N], Y [N] and N [N m], (3, ...), of the force [N] of each thruster, (thrusters, ...).

        Raises ModelError unless there is one for each thruster.
        """
        thrust = np.asarray(thrust, dtype=float)
        if thrust.ndim == 0 or len(thrust) != len(self.thrusters):
            names = ", ".join(one.name for one in self.thrusters)
            raise ModelError(
                f"thrust of shape {thrust.shape} for {len(self.thrusters)} thrusters ({names}); expected a row for each"
            )
        return np.asarray(np.tensordot(self.matrix, thrust, axes=1))
