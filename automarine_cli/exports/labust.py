"""LABUST's simulator and controllers (labust-ros-pkg, University of Zagreb): a model YAML with positive coefficients.

The uncoupled model steps (Io + Ma) r' = tau - (linear_damping + quadratic_damping |r|) r by backward Euler. Sources:
labust_sim/config/model_example.yaml and labust_sim/src/labust_sim/RBModel.cpp of that package.
"""

from automarine_cli.exports.base import Target, Written, YawSubject, at_axis, commented, head, row

YAW = 5
EQUATION = "(inertia_matrix + added_mass) r' = tau - linear_damping r - quadratic_damping |r| r"
OTHERS = (
    "Only the yaw entries (the last ones) are identified: zeros and the two ones before the inertia are placeholders; "
    "merge with the values of your model."
)


def write(subject: YawSubject) -> Written:
    """The YAML text."""
    notes = (subject.about_inertia(), OTHERS)
    rigid, added = subject.inertias
    linear, quadratic = subject.value("linear-drag"), subject.value("quadratic-drag")
    text = f"""inertia_matrix: [{row([1.0, 1.0, rigid], ", ")}]
added_mass: [{row(at_axis(added, YAW), ", ")}]
linear_damping: [{row(at_axis(linear, YAW), ", ")}]
quadratic_damping: [{row(at_axis(quadratic, YAW), ", ")}]
coupled: false
"""
    return Written(commented(head(subject, EQUATION, notes), "#") + text, notes)


TARGET = Target(
    name="labust",
    says="LABUST's simulator and controllers: model YAML, positive coefficients",
    source="labust-ros-pkg, labust_sim/config/model_example.yaml",
    forms={"model": ".yaml"},
    frames=("NED",),
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
