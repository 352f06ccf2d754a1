"""The degrees of freedom that are identified, one record each, and the motions made of them."""

from collections.abc import Mapping

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.rotations import PITCH, ROLL
from automarine_cli.dofs.translations import HEAVE, SURGE, SWAY
from automarine_cli.dofs.yaw import YAW

__all__ = ["ALL_BUT_YAW", "DOFS", "HEAVE", "PITCH", "ROLL", "SURGE", "SWAY", "YAW", "Dof"]

DOFS: Mapping[str, Dof] = {dof.name: dof for dof in (YAW, SURGE, HEAVE, SWAY, ROLL, PITCH)}
ALL_BUT_YAW: Mapping[str, Dof] = {name: dof for name, dof in DOFS.items() if dof is not YAW}
