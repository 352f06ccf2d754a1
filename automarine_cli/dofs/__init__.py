"""The degrees of freedom that are identified, one record each, and the motions made of them.

One degree of freedom is a motion of its own, positions then being the integrals of velocities. The planar motion moves
in a plane: velocities are those ahead, to starboard and in yaw, in axes that turn with the vehicle, positions those
north and east, and the heading (Fossen 2021, chapter 2).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from automarine_cli.dofs.dof import DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY, YAW, Dof

__all__ = ["ALL_BUT_YAW", "DOFS", "HEAVE", "PITCH", "PLANAR", "ROLL", "SURGE", "SWAY", "YAW", "Dof", "Motion", "alone"]

ALL_BUT_YAW: Mapping[str, Dof] = {name: dof for name, dof in DOFS.items() if dof is not YAW}


@dataclass(frozen=True)
class Motion:
    """Degrees of freedom that move together, in the order of the last axis of all states; `positions` are the
    quantities of their positions."""

    name: str
    dofs: tuple[Dof, ...]
    positions: tuple[str, ...]

    @property
    def turns(self) -> bool:
        """Whether velocities are measured in axes that turn with the vehicle."""
        return YAW in self.dofs and len(self.dofs) > 1

    def index(self, dof: Dof) -> int:
        return self.dofs.index(dof)


def alone(dof: Dof) -> Motion:
    """The motion of one degree of freedom."""
    return Motion(dof.name, (dof,), (dof.position,))


PLANAR = Motion("planar", (SURGE, SWAY, YAW), ("north", "east", YAW.position))  # motion in the plane of the water
