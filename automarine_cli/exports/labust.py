"""LABUST's simulator and controllers (labust-ros-pkg, University of Zagreb): a model YAML with positive coefficients.

The uncoupled model steps (Io + Ma) r' = tau - (linear_damping + quadratic_damping |r|) r by backward Euler. Sources:
labust_sim/config/model_example.yaml and labust_sim/src/labust_sim/RBModel.cpp of that package.
"""

from automarine_cli.exports.base import Several, Target, Written, comment, number, row
from automarine_cli.exports.vehicle import Vehicle


def write(subject: Vehicle) -> Written:
    law = "({entry} + added_mass) {r}' = {force} - linear_damping {r} - quadratic_damping |{r}| {r}"
    lines, notes = subject.matrix_head("added_mass", law, "inertia_matrix", coupled=False)
    turns = {axis.dof.angular for axis in subject.axes}
    mass = f"mass: {number(subject.mass)}\n" * (False in turns)
    moments = f"inertia_matrix: [{row((x or 1.0 for x in subject.rigid[3:]), ', ')}]\n" * (True in turns)
    text = f"""{mass}{moments}added_mass: [{row(subject.added.diagonal(), ", ")}]
linear_damping: [{row(subject.diagonal("linear-drag"), ", ")}]
quadratic_damping: [{row(subject.diagonal("quadratic-drag"), ", ")}]
coupled: false
"""
    return Written(comment(lines, "#") + text, tuple(notes))


TARGET = Target(
    name="labust",
    says="LABUST's simulator and controllers: model YAML, positive coefficients",
    forms={"model": ".yaml"}, frames=("NED",), write=write, several=Several({"model": ".yaml"}),
)  # fmt: skip
