"""Thrusters at places and angles: their forces -> surge force, sway force and yaw moment.

Source: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, second edition (control allocation:
the thrust configuration matrix).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli.dofs.motion import Motion
from automarine_cli.effects import Effect, Place
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


class Vehicle(Protocol):
    """What the simulator needs of a model: its motion, its parameters, inertia, terms, and the water's own velocity."""

    @property
    def motion(self) -> Motion:
        """The degrees of freedom that move together."""

    @property
    def theta(self) -> Floats:
        """Parameter vector, (p,)."""

    def inertia_matrix(self, theta: Floats) -> Floats:
        """Rigid and added inertia for theta (P, p): (P, D, D)."""

    def forces(self, theta: Floats) -> Sequence["Bound"]:
        """Each effect with the degree of freedom on which it acts."""

    def current(self, theta: Floats) -> Floats | None:
        """Velocity of the water north and east [m/s], (2, P, 1), constant and without swirl; None for still water."""


@dataclass(frozen=True)
class Bound:
    """An effect that acts on the degree of freedom in place `dof`, with its parameters, each (P, 1)."""

    dof: int
    effect: Effect
    values: tuple[Floats, ...]

    def wide(self) -> tuple[Floats, ...]:
        return tuple(value[..., None] for value in self.values)


def actuators(terms: Sequence[Bound]) -> list[Bound]:
    """The terms that act on commands, in the order in which they do."""
    found = [term for term in terms if term.effect.place is Place.ACTUATOR]
    return sorted(found, key=lambda term: term.effect.stage)
