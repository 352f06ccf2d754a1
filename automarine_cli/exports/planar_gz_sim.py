"""Gazebo Sim, motion in the plane: an SDF model with the Hydrodynamics system and the engine's fluid added mass.

The system adds the forces sum_j (iJ + sum_k iJabsK |nu_k|) nu_j, i of x, y, n, J and K of U, V, R: derivatives by the
velocity through the water, which are negative where drag resists. The engine makes the Coriolis and Munk forces
of the fluid's inertia itself; the system's own added mass is off. Sources: gazebosim.org/api/sim/9, class
Hydrodynamics, and src/systems/hydrodynamics/Hydrodynamics.cc; sdformat.org, element inertial/fluid_added_mass.
"""

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import Written, number, xml_comment
from automarine_cli.exports.planar import PlanarSubject, rigid_of
from automarine_cli.models.planar import FORCES, VELOCITIES

ENTRIES = (("xx", 0, 0), ("xy", 0, 1), ("xr", 0, 2), ("yy", 1, 1), ("yr", 1, 2), ("rr", 2, 2))


def write(subject: PlanarSubject) -> Written:
    """The SDF text. Raises SettingError where the vehicle's own mass is not given, or a force always acts."""
    if subject.constant.any():
        raise SettingError(
            f"{subject.origin.file}: gz-sim cannot represent a force that always acts; take --to python, which can"
        )
    rigid = rigid_of(subject)
    added = subject.inertia - rigid.matrix
    fluid = "".join(
        f"          <{tag}>{number(added[i, j])}</{tag}>\n" for tag, i, j in ENTRIES if added[i, j]
    )
    tags = []
    for _, places, value in subject.drags():
        letters = [VELOCITIES[one].upper() for one in places[1:]]
        along, size = letters[-1], f"abs{letters[0]}" if len(letters) == 2 else ""
        tag = f"{FORCES[places[0]].lower()}{along}{size}"
        tags.append(f"      <{tag}>{number(-value)}</{tag}>\n")
    moment = number(rigid.I_r)
    notes = (
        f"Mass: {number(rigid.m_u)} kg and yaw inertia {moment} kg m^2 are the vehicle's own (given); the rest of M is "
        "fluid_added_mass, which needs the DART engine.",
        "Heave, roll and pitch are not identified: merge with the values of your model, and add its buoyancy.",
        *subject.about_water(),
    )
    return Written(
        f"""<?xml version="1.0"?>
{xml_comment([*subject.head(), *notes])}<sdf version="1.10">
  <model name="vehicle">
    <link name="base_link">
      <inertial>
        <mass>{number(rigid.m_u)}</mass>
        <inertia>
          <ixx>{moment}</ixx>
          <iyy>{moment}</iyy>
          <izz>{moment}</izz>
        </inertia>
        <fluid_added_mass>
{fluid}        </fluid_added_mass>
      </inertial>
    </link>
    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
      <link_name>base_link</link_name>
      <disable_added_mass>true</disable_added_mass>
      <disable_coriolis>true</disable_coriolis>
{"".join(tags)}    </plugin>
  </model>
</sdf>
""",
        notes,
    )
