"""uuv_simulator and what grew from it (DAVE, Plankton): URDF for the Fossen plugin, YAML for the controllers.

Plugin: the torque on the link is -Ma r' + linear_damping r + quadratic_damping |r| r, so damping is negative and
added mass positive; `<added_mass>` has 36 numbers, each damping 6. Sources: uuvsimulator.github.io, class
gazebo::HMFossen; uuv_gazebo_plugins/src/HydrodynamicModel.cc. Controllers: (izz + Ma) r' = tau + linear_damping r +
quad_damping |r| r (uuv_control_interfaces/vehicle.py, which turns Gazebo's rates into SNAME's; odd drag is the same).
"""

from automarine_cli.exports.base import Target, Written, YawSubject, at_place, commented, head, number, row, xml_comment


def write(subject: YawSubject) -> Written:
    index, turns, r = subject.dof.number, subject.dof.wraps, subject.dof.symbols.velocity
    notes = (subject.about_inertia(), subject.about_entries())
    rigid, added = subject.inertias
    linear = at_place(-subject.value("linear-drag"), index)
    quadratic = at_place(-subject.value("quadratic-drag"), index)
    matrix = [at_place(added if line == index else 0.0, index) for line in range(6)]
    own = "izz" if turns else "mass"
    equation = f"({own} + Ma) {r}' = {subject.force} + linear_damping {r} + quadratic_damping |{r}| {r}"
    lines = head(subject, equation, notes)
    inertia, mass = number(rigid if turns else 1.0), number(1.0 if turns else rigid)
    if subject.form == "controller":
        head_of = "" if turns else f"mass: {mass}\n"
        return Written(commented(lines, "#") + head_of + _yaml(inertia, linear, quadratic, matrix), notes)
    entries = "\n".join(f"            {row(line)}" for line in matrix)
    return Written(
        f"""<?xml version="1.0"?>
{xml_comment(lines)}<robot name="vehicle">
  <link name="base_link">
    <inertial>
      <mass value="{mass}"/>
      <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/>
    </inertial>
  </link>
  <gazebo>
    <plugin name="uuv_plugin" filename="libuuv_underwater_object_ros_plugin.so">
      <link name="base_link">
        <hydrodynamic_model>
          <type>fossen</type>
          <added_mass>
{entries}
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


def _yaml(own: str, linear: list[float], quadratic: list[float], matrix: list[list[float]]) -> str:
    entries = "".join(f"- [{row(line, ', ')}]\n" for line in matrix)
    return f"""inertial:
  ixx: {own}
  iyy: {own}
  izz: {own}
  ixy: 0
  ixz: 0
  iyz: 0
Ma:
{entries}linear_damping: [{row(linear, ", ")}]
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
