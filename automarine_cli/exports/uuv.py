"""uuv_simulator and what grew from it (DAVE, Plankton): URDF for the Fossen plugin, YAML for the controllers.

Plugin: the torque on the link is -Ma r' + linear_damping r + quadratic_damping |r| r, so damping is negative and
added mass positive; `<added_mass>` has 36 numbers, each damping 6. Sources: uuvsimulator.github.io, class
gazebo::HMFossen; uuv_gazebo_plugins/src/HydrodynamicModel.cc. Controllers: (izz + Ma) r' = tau + linear_damping r +
quad_damping |r| r (uuv_control_interfaces/vehicle.py, which turns Gazebo's rates into SNAME's; odd drag is the same).
"""

from automarine_cli.exports.base import (
    Target,
    Written,
    YawSubject,
    at_axis,
    commented,
    head,
    number,
    row,
    xml_comment,
)

YAW = 5
EQUATION = "(izz + Ma) r' = tau + linear_damping r + quadratic_damping |r| r"
OTHERS = (
    "Only the yaw entries (the last ones) are identified: zeros, mass 1, ixx and iyy are placeholders; merge with the "
    "values of your model."
)


def write(subject: YawSubject) -> Written:
    """The URDF or the YAML text."""
    notes = (subject.about_inertia(), OTHERS)
    rigid, added = subject.inertias
    linear = at_axis(-subject.value("linear-drag"), YAW)
    quadratic = at_axis(-subject.value("quadratic-drag"), YAW)
    mass = [at_axis(added if line == YAW else 0.0, YAW) for line in range(6)]
    lines = head(subject, EQUATION, notes)
    if subject.form == "controller":
        return Written(commented(lines, "#") + _yaml(rigid, linear, quadratic, mass), notes)
    matrix = "\n".join(f"            {row(line)}" for line in mass)
    inertia = number(rigid)
    return Written(
        f"""<?xml version="1.0"?>
{xml_comment(lines)}<robot name="vehicle">
  <link name="base_link">
    <inertial>
      <mass value="1"/>
      <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/>
    </inertial>
  </link>
  <gazebo>
    <plugin name="uuv_plugin" filename="libuuv_underwater_object_ros_plugin.so">
      <link name="base_link">
        <hydrodynamic_model>
          <type>fossen</type>
          <added_mass>
{matrix}
          </added_mass>
          <linear_damping>{row(linear)}</linear_damping>
          <quadratic_damping>{row(quadratic)}</quadratic_damping>
        </hydrodynamic_model>
      </link>
    </plugin>
  </gazebo>
</robot>
""",
        notes,
    )


def _yaml(rigid: float, linear: list[float], quadratic: list[float], mass: list[list[float]]) -> str:
    matrix = "".join(f"- [{row(line, ', ')}]\n" for line in mass)
    own = number(rigid)
    return f"""inertial:
  ixx: {own}
  iyy: {own}
  izz: {own}
  ixy: 0
  ixz: 0
  iyz: 0
Ma:
{matrix}linear_damping: [{row(linear, ", ")}]
quad_damping: [{row(quadratic, ", ")}]
"""


TARGET = Target(
    name="uuv",
    says="uuv_simulator and its forks: URDF for the plugin, YAML for the controllers",
    source="uuvsimulator.github.io, class gazebo::HMFossen",
    forms={"urdf": ".urdf", "controller": ".yaml"},
    frames=("ENU", "NED"),
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
