"""All files of a yaw diagnosis but its JSON: the page for a person and the three figures."""

from collections.abc import Sequence

from automarine_cli.diagnosis.budget import budget
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.naming_key import naming_key
from automarine_cli.pipeline.outputs import ResultFolder
from automarine_cli.report.diagnosis_page import page
from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure
from automarine_cli.report.figures.files import write_figures


def write(folder: ResultFolder, diagnosis: Diagnosis, formats: Sequence[str] = ("png",)) -> None:
    """The page, then each figure in each of the formats. Page and figures do without naming key or budget of the gap
    where these cannot be worked out: the verdict does not hang on them."""
    found = diagnosis.found
    key = folder.attempt(
        "The naming key could not be formed",
        lambda: naming_key(diagnosis.study, found.base, found.final),
    )
    shares = folder.attempt("The budget of the gap could not be worked out", lambda: budget(diagnosis))
    folder.write("diagnosis.md", page(diagnosis, key, shares))
    drawings = {
        "where": lambda: where_figure(diagnosis),
        "why": lambda: why_figure(diagnosis, key),
        "before_after": lambda: before_after_figure(diagnosis, shares),
    }
    write_figures(folder, drawings, formats)
