"""What the page says of a learned curve: its figure, and the formula that would do instead, with its file."""

from automarine_cli.diagnosis.formula import formula_of
from automarine_cli.diagnosis.formula_file import effect_file, equation_of, file_name
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.dofs import Dof
from automarine_cli.report.tables import interval


def learned_lines(curve: LearnedCurve, runs: int, dof: Dof) -> list[str]:
    """The paragraphs on a curve learned from so many runs of a motion."""
    lines = ["![What was learned](learned.png)", "The curve as a table is in diagnosis.json, under `learned`."]
    formula = formula_of(curve, runs)
    if formula is None:
        return [*lines, "None of the formulas tried stays within the curve's 95 % band."]
    told = "; ".join(f"{name} = {interval(estimate)}" for name, estimate in formula.parameters.items())
    return [
        *lines,
        f"The simplest formula within its band is y = `{formula.text}`, with {told}, in the equation of motion "
        f"`{dof.fill(equation_of(curve, formula))}`. It is a proposal: a curve does "
        "not show the cause. As an effect of your own it is the file below; keep it with "
        f"`automarine effects --new {file_name(curve, formula)}` and diagnose again.",
        f"```python\n{effect_file(curve, formula)}```",
    ]
