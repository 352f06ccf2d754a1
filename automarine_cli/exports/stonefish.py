"""Stonefish: what of its geometry's hydrodynamics can be set for one axis, and a warning for the rest.

Stonefish sums drag over the faces of the mesh and multiplies the sums by coefficients along the body's axes: the torque
about z is -quadratic_drag_z Q |r| r - viscous_drag_z V r, where Q and V [N m at 1 rad/s] are the mesh's own. They are
not known here: let the vehicle turn at 1 rad/s with quadratic_drag="1 1 1" viscous_drag="0 0 0", read the torque, then
the other way about, and give both with --mesh-torque. Sources: stonefish.readthedocs.io, "Theory" (drag, added mass)
and "Dynamic bodies" (physics modes, <inertia>); attributes viscous_drag and quadratic_drag of <hydrodynamics> in
Library/src/core/ScenarioParser.cpp and SolidEntity::CorrectHydrodynamicForces. The form drag is documented as
quadratic; a user of a release of 2024 or later has measured the cube of the speed, where Q holds at the rate at which
it was read.

Added inertia cannot be set: it is approximated from the geometry where physics="submerged", and is nothing where
physics="floating", which is why the total stands in one place there.
"""

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import Target, Written, YawSubject, comment, head, number

EQUATION = "I r' = tau - quadratic_drag_z Q |r| r - viscous_drag_z V r"
HEAVE = (
    "Warning: the z entries of quadratic_drag and viscous_drag scale the drag in heave as well; check heave after "
    "setting them."
)
ADDED = (
    'Warning: added inertia cannot be set in Stonefish; the total stands in <inertia> and physics is "floating", '
    "which adds none of its own in any direction."
)
POWER = (
    "Check with your release that the form drag grows with the square of the rate; where it does not, Q holds at the "
    "rate at which it was read."
)
OTHERS = "The x and y entries of inertia and drag are placeholders: put your own."


def write(subject: YawSubject) -> Written:
    """The text. Raises SettingError where the drag of the mesh is not given."""
    if subject.settings.mesh_torque is None:
        raise SettingError(
            f"{subject.origin.file}: Stonefish's coefficients of drag count against the drag of your mesh; give that "
            "with --mesh-torque"
        )
    quadratic, viscous = subject.settings.mesh_torque
    total, form = number(subject.model.inertia), number(subject.value("quadratic-drag") / quadratic)
    friction = number(subject.value("linear-drag") / viscous)
    mesh = f"Mesh: Q = {number(quadratic)} N m, V = {number(viscous)} N m at 1 rad/s (given)."
    notes = (ADDED, HEAVE, mesh, POWER, OTHERS)
    return Written(
        f"""<?xml version="1.0"?>
{comment(head(subject, EQUATION, notes))}<base_link name="base_link" physics="floating">
  <inertia xyz="{total} {total} {total}"/>
  <hydrodynamics viscous_drag="1 1 {friction}" quadratic_drag="1 1 {form}"/>
</base_link>
""",
        notes,
    )


TARGET = Target(
    name="stonefish",
    says="Stonefish: inertia, and drag coefficients where the mesh's own drag is given",
    forms={"body": ".scn"},
    frames=("NED",),
    uses=frozenset({"newton_metres_per_nu", "mesh_torque"}),
    motions=("yaw",),
    write=write,
)
