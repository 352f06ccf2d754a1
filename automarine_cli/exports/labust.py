"""LABUST's simulator and controllers (labust-ros-pkg, University of Zagreb): a model YAML with positive coefficients.

The uncoupled model steps (Io + Ma) r' = tau - (linear_damping + quadratic_damping |r|) r by backward Euler. Sources:
labust_sim/config/model_example.yaml and labust_sim/src/labust_sim/RBModel.cpp of that package.
"""

from automarine_cli.exports.base import Target, Written, YawSubject, at_place, comment, head, number, row


def write(subject: YawSubject) -> Written:
    index, turns, r = subject.dof.number, subject.dof.angular, subject.dof.symbols.velocity
    notes = (subject.about_inertia(), subject.about_entries())
    rigid, added = subject.inertias
    linear, quadratic = subject.value("linear-drag"), subject.value("quadratic-drag")
    rigid_entry = "inertia_matrix" if turns else "mass"
    equation = f"({rigid_entry} + added_mass) {r}' = {subject.force} - linear_damping {r} - quadratic_damping |{r}| {r}"
    first = f"inertia_matrix: [{row([1.0, 1.0, rigid], ', ')}]" if turns else f"mass: {number(rigid)}"
    text = f"""{first}
added_mass: [{row(at_place(added, index), ", ")}]
linear_damping: [{row(at_place(linear, index), ", ")}]
quadratic_damping: [{row(at_place(quadratic, index), ", ")}]
coupled: false
"""
    return Written(comment(head(subject, equation, notes), "#") + text, notes)


TARGET = Target(
    name="labust",
    says="LABUST's simulator and controllers: model YAML, positive coefficients",
    forms={"model": ".yaml"},
    frames=("NED",),
    uses=frozenset({"rigid_inertia", "newton_metres_per_nu"}),
    write=write,
)
