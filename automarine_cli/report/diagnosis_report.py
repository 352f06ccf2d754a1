"""All files of a yaw diagnosis but its JSON: the page for a person and the three figures."""

from collections.abc import Sequence
from functools import partial

from automarine_cli.diagnosis.budget import budget
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.naming_key import naming_key
from automarine_cli.pipeline.parallel import Each
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report.diagnosis_page import page
from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure
from automarine_cli.report.figures.files import Draw, write_figures
from automarine_cli.report.figures.learned import learned_figure


def write(
    folder: ResultFolder, diagnosis: Diagnosis, formats: Sequence[str] = ("png",), each: Each | None = None
) -> None:
    """The page, then each figure in each of the formats; one more where a curve was learned. Page and figures do
    without naming key or budget of the gap where these cannot be worked out: the verdict does not hang on them.
    `each` maps a function over the figures, in processes or not."""
    found = diagnosis.found
    key = folder.attempt(
        "The naming key could not be computed", lambda: naming_key(diagnosis.study, found.base, found.final)
    )
    shares = folder.attempt("The budget of the gap could not be computed", lambda: budget(diagnosis))
    folder.write("diagnosis.md", page(diagnosis, key, shares))
    drawings: dict[str, Draw] = {
        "where": partial(where_figure, diagnosis),
        "why": partial(why_figure, diagnosis, key),
        "before_after": partial(before_after_figure, diagnosis, shares),
    }
    for curve in (effect.learned for effect in diagnosis.effects if effect.learned is not None):
        drawings["learned"] = partial(learned_figure, diagnosis, curve)
    write_figures(folder, drawings, formats, each)
