"""The degrees of freedom that are identified, one record each, and the motions made of them.

A file of this folder with a `Dof` in it is a degree of freedom; everything that is particular to it stands there.
"""

from collections.abc import Mapping

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.heave import HEAVE
from automarine_cli.dofs.surge import SURGE
from automarine_cli.dofs.sway import SWAY
from automarine_cli.dofs.yaw import YAW

__all__ = ["DOFS", "HEAVE", "SURGE", "SWAY", "TRANSLATIONS", "YAW", "Dof"]

DOFS: Mapping[str, Dof] = {dof.name: dof for dof in (YAW, SURGE, HEAVE, SWAY)}
TRANSLATIONS: Mapping[str, Dof] = {name: dof for name, dof in DOFS.items() if not dof.wraps}
