"""The figures of `diagnose`: where the gap is, why (evidence and naming key), and before and after."""

from automarine_cli.report.figures.diagnosis_gap import before_after_figure
from automarine_cli.report.figures.diagnosis_where import where_figure
from automarine_cli.report.figures.diagnosis_why import why_figure

__all__ = ["before_after_figure", "where_figure", "why_figure"]
