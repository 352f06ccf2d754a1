"""All files of a yaw diagnosis but its JSON: the page for a person and the three figures."""

from collections.abc import Iterator, Sequence

from automarine_cli.diagnosis.budget import budget
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.naming_key import naming_key
from automarine_cli.diagnosis.where import Where
from automarine_cli.report.diagnosis_page import page
from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure
from automarine_cli.report.figures.style import figure_files


def files(
    diagnosis: Diagnosis, where: Where, formats: Sequence[str] = ("png",)
) -> Iterator[tuple[str, str | bytes]]:
    """Name and content of each file; each figure in each of the formats."""
    found = diagnosis.found
    key, shares = naming_key(diagnosis.study, found.base, found.final), budget(diagnosis)
    yield "diagnosis.md", page(diagnosis, where, key, shares)
    yield from figure_files("where", where_figure(where, diagnosis), formats)
    yield from figure_files("why", why_figure(diagnosis, key), formats)
    yield from figure_files("before_after", before_after_figure(diagnosis, where, shares), formats)
