"""uuv_simulator and what grew from it (DAVE, Plankton): URDF for the Fossen plugin, YAML for the controllers.

Plugin: the torque on the link is -Ma r' + linear_damping r + quadratic_damping |r| r, so damping is negative and
added mass positive; `<added_mass>` has 36 numbers, each damping 6. Sources: uuvsimulator.github.io, class
gazebo::HMFossen; uuv_gazebo_plugins/src/HydrodynamicModel.cc. Controllers: (izz + Ma) r' = tau + linear_damping r +
quad_damping |r| r (uuv_control_interfaces/vehicle.py, which turns Gazebo's rates into SNAME's; odd drag is the same).
"""

from automarine_cli.exports.base import Several, Target, Written, comment, filled, number, row
from automarine_cli.exports.vehicle import Vehicle


def write(subject: Vehicle) -> Written:
    law = "({entry} + Ma) {r}' = {force} + linear_damping {r} + quadratic_damping |{r}| {r}"
    lines, notes = subject.matrix_head("added mass", law, "izz")
    linear, quadratic = -subject.diagonal("linear-drag"), -subject.diagonal("quadratic-drag")
    fields = {"mass": number(subject.mass), **dict(zip(("ixx", "iyy", "izz"), map(number, subject.moments)))}
    if subject.form == "controller":
        slides = any(not axis.dof.angular for axis in subject.axes)
        fields |= {
            "head": comment(lines, "#") + (f"mass: {number(subject.mass)}\n" if slides else ""),
            "entries": "".join(f"- [{row(line, ', ')}]\n" for line in subject.added),
            "linear": row(linear, ", "), "quadratic": row(quadratic, ", "),
        }  # fmt: skip
    else:
        fields |= {
            "head": comment(lines), "entries": "\n".join(f"            {row(line)}" for line in subject.added),
            "linear": row(linear), "quadratic": row(quadratic),
        }  # fmt: skip
    return Written(filled(f"uuv_{subject.form}", fields), tuple(notes))


EXTENSIONS = {"urdf": ".urdf", "controller": ".yaml"}
TARGET = Target(
    name="uuv",
    says="uuv_simulator and its forks: URDF for the plugin, YAML for the controllers",
    forms=EXTENSIONS, frames=("ENU", "NED"), write=write, several=Several(EXTENSIONS),
)  # fmt: skip
