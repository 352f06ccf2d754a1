"""Gazebo Sim: an SDF model with the Hydrodynamics system.

The system adds to the link the torque nR r + nRabsR |r| r + nRR r^2 + nDotR r' (Fossen's derivatives: damping and
added inertia are negative); `<fluid_added_mass><rr>` adds a positive inertia inside the physics engine instead, and
then the system's own must be off. Sources: gazebosim.org/api/sim/9, class Hydrodynamics ("System Parameters") and
src/systems/hydrodynamics/Hydrodynamics.cc; sdformat.org, element inertial/fluid_added_mass (since SDF 1.10); gz-sim's
tutorial on migrating added mass to that tag, which is why it is the first form. `<nRabsR>` is what gz-sim has read
since its pull request 1888 (2023); before, `<nRR>` meant that.

The system makes nDotR r' from the last step's acceleration, so r' grows without bound where the added inertia is not
below the rigid one: r_k+1 - r_k = -(added/rigid) (r_k - r_k-1).
"""

from automarine_cli.errors import SettingError
from automarine_cli.exports.base import DRAG, Target, Written, YawSubject, head, number, xml_comment

EQUATION = "izz r' + rr r' = tau + nR r + nRabsR |r| r + nRR r^2 + nDotR r'"
OTHERS = (
    "Mass, ixx and iyy are placeholders and no axis but yaw has drag here: merge with the values of your model. "
    "Needs a gz-sim that reads nRabsR (since 2023) and, for fluid_added_mass, the DART engine."
)
FLUID, DERIVATIVE = "fluid-added-mass", "added-mass-derivative"


def write(subject: YawSubject) -> Written:
    """The SDF text. Raises SettingError where the added inertia would make the simulation unstable."""
    rigid, added = subject.inertias
    if subject.form == DERIVATIVE and added >= rigid:
        raise SettingError(
            f"gz-sim takes <nDotR> from the last step's acceleration, which grows without bound where the added "
            f"inertia ({number(added)}) is not below the rigid one ({number(rigid)}); give --form {FLUID}"
        )
    fluid = ""
    if added and subject.form == FLUID:
        fluid = (
            f"\n        <fluid_added_mass>\n          <rr>{number(added)}</rr>\n        </fluid_added_mass>"
        )
    tags = {
        "nR": -subject.value("linear-drag"),
        "nRabsR": -subject.value("quadratic-drag"),
        "nRR": -subject.value("drag-asymmetry"),
        "nDotR": -added if subject.form == DERIVATIVE else 0.0,
    }
    shown = "".join(
        f"      <{tag}>{number(value)}</{tag}>\n"
        for tag, value in tags.items()
        if value or tag in ("nR", "nRabsR")
    )
    off = "false" if tags["nDotR"] else "true"
    notes = (subject.about_inertia(), OTHERS)
    inertia = number(rigid)
    return Written(
        f"""<?xml version="1.0"?>
{xml_comment(head(subject, EQUATION, notes))}<sdf version="1.10">
  <model name="vehicle">
    <link name="base_link">
      <inertial>
        <mass>1</mass>
        <inertia>
          <ixx>{inertia}</ixx>
          <iyy>{inertia}</iyy>
          <izz>{inertia}</izz>
        </inertia>{fluid}
      </inertial>
    </link>
    <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
      <link_name>base_link</link_name>
      <disable_added_mass>{off}</disable_added_mass>
{shown}    </plugin>
  </model>
</sdf>
""",
        notes,
    )


TARGET = Target(
    name="gz-sim",
    says="Gazebo Sim: SDF for the Hydrodynamics system",
    source="gazebosim.org/api/sim/9, class Hydrodynamics",
    forms={FLUID: ".sdf", DERIVATIVE: ".sdf"},
    frames=("ENU", "NED"),
    carries=frozenset({*DRAG, "drag-asymmetry"}),
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
