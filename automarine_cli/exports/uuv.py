"""uuv_simulator and what grew from it (DAVE, Plankton): URDF for the Fossen plugin, YAML for the controllers.

Plugin: the torque on the link is -Ma r' + linear_damping r + quadratic_damping |r| r, so damping is negative and
added mass positive; `<added_mass>` has 36 numbers, each damping 6. Sources: uuvsimulator.github.io, class
gazebo::HMFossen; uuv_gazebo_plugins/src/HydrodynamicModel.cc. Controllers: (izz + Ma) r' = tau + linear_damping r +
quad_damping |r| r (uuv_control_interfaces/vehicle.py, which turns Gazebo's rates into SNAME's; odd drag is the same).
"""

from automarine_cli.exports.base import Target, Written, YawSubject, at_place, comment, filled, head, number, row


def write(subject: YawSubject) -> Written:
    index, turns, r = subject.dof.number, subject.dof.angular, subject.dof.symbols.velocity
    notes = (subject.about_inertia(), subject.about_entries())
    rigid, added = subject.inertias
    linear = at_place(-subject.value("linear-drag"), index)
    quadratic = at_place(-subject.value("quadratic-drag"), index)
    matrix = [at_place(added if line == index else 0.0, index) for line in range(6)]
    rigid_entry = "izz" if turns else "mass"
    equation = f"({rigid_entry} + Ma) {r}' = {subject.force} + linear_damping {r} + quadratic_damping |{r}| {r}"
    lines = head(subject, equation, notes)
    inertia, mass = number(rigid if turns else 1.0), number(1.0 if turns else rigid)
    fields = {"inertia": inertia, "mass": mass}
    if subject.form == "controller":
        fields |= {
            "head": comment(lines, "#") + ("" if turns else f"mass: {mass}\n"),
            "entries": "".join(f"- [{row(line, ', ')}]\n" for line in matrix),
            "linear": row(linear, ", "), "quadratic": row(quadratic, ", "),
        }  # fmt: skip
    else:
        fields |= {
            "head": comment(lines), "entries": "\n".join(f"            {row(line)}" for line in matrix),
            "linear": row(linear), "quadratic": row(quadratic),
        }  # fmt: skip
    return Written(filled(f"uuv_{subject.form}", fields), notes)


TARGET = Target(
    name="uuv",
    says="uuv_simulator and its forks: URDF for the plugin, YAML for the controllers",
    forms={"urdf": ".urdf", "controller": ".yaml"},
    frames=("ENU", "NED"),
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
