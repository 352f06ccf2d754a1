"""LABUST's simulator and controllers (labust-ros-pkg, University of Zagreb): a model YAML with positive coefficients.

The uncoupled model steps (Io + Ma) r' = tau - (linear_damping + quadratic_damping |r|) r by backward Euler. Sources:
labust_sim/config/model_example.yaml and labust_sim/src/labust_sim/RBModel.cpp of that package.
"""

from automarine_cli.exports.base import MATRICES, Several, Target, Written, comment, head, number, row
from automarine_cli.exports.vehicle import Vehicle


def write(subject: Vehicle) -> Written:
    if subject.several:
        notes = (*subject.about_own("the rest of M is added_mass"), MATRICES)
        lines = subject.head(*notes, coupled=False)
    else:
        axis, r = subject.axis, subject.axis.dof.symbols.velocity
        notes = (axis.about_inertia(), axis.about_entries())
        rigid_entry = "inertia_matrix" if axis.dof.angular else "mass"
        drag = f"linear_damping {r} - quadratic_damping |{r}| {r}"
        lines = head(axis, f"({rigid_entry} + added_mass) {r}' = {axis.force} - {drag}", notes)
    turns = {axis.dof.angular for axis in subject.axes}
    mass = f"mass: {number(subject.mass)}\n" * (False in turns)
    moments = f"inertia_matrix: [{row((x or 1.0 for x in subject.rigid[3:]), ', ')}]\n" * (True in turns)
    text = f"""{mass}{moments}added_mass: [{row(subject.added.diagonal(), ", ")}]
linear_damping: [{row(subject.diagonal("linear-drag"), ", ")}]
quadratic_damping: [{row(subject.diagonal("quadratic-drag"), ", ")}]
coupled: false
"""
    return Written(comment(lines, "#") + text, notes)


TARGET = Target(
    name="labust",
    says="LABUST's simulator and controllers: model YAML, positive coefficients",
    forms={"model": ".yaml"}, frames=("NED",), write=write, several=Several({"model": ".yaml"}),
)  # fmt: skip
