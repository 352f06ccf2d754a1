"""The degrees of freedom that are identified, one record each, and the motions made of them.

A file of this folder with a `Dof` in it is a degree of freedom; everything that is particular to it stands there.
"""

from collections.abc import Mapping

from automarine_cli.dofs.dof import Dof
from automarine_cli.dofs.heave import HEAVE
from automarine_cli.dofs.surge import SURGE
from automarine_cli.dofs.yaw import YAW

__all__ = ["DOFS", "HEAVE", "SURGE", "YAW", "Dof"]

DOFS: Mapping[str, Dof] = {dof.name: dof for dof in (YAW, SURGE, HEAVE)}
