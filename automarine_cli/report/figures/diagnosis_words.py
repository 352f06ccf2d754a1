"""What the figures of a diagnosis share: colours, and names of variables."""

from automarine_cli.diagnosis.residual_regions import Variable
from automarine_cli.dofs import Dof
from automarine_cli.report.figures.style import COLOURS

BEFORE, AFTER, MARK = COLOURS["vermilion"], COLOURS["blue"], COLOURS["yellow"]


def in_words(variable: Variable, dof: Dof) -> str:
    """The variable's name and unit for an axis."""
    force = dof.words.force
    others = {
        "time-since-command-change": "time since command changed",
        "time-in-run": "time in the run",
        f"{force}-size": f"size of the {force}",
    }
    name = variable.name if variable.logged else others.get(variable.name, variable.name.replace("-", " "))
    name += ", by run" if variable.of_the_run else ""
    return name + (f" [{variable.unit}]" if variable.unit else "")
