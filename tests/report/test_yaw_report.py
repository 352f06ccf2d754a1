"""Figures of a fit by their structure; `tests/golden` has its tables."""

import re

import numpy as np
import pytest
from identified import identify
from made_campaigns import both_ways, campaign
from matplotlib.figure import Figure

from automarine_cli.report import fit_report  # noqa: F401  registers what a fit shows
from automarine_cli.report.figures.style import FORMATS
from automarine_cli.report.sections import sections

pytestmark = pytest.mark.usefixtures("drawn_figures")


def is_complete(figure: Figure) -> None:
    """Labels with units on the outer axes, all data finite."""
    panels = [ax for ax in figure.axes if ax.axison]
    labels = [label for ax in panels for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
    assert labels and all(re.search(r"\[.+\]", label) for label in labels), labels
    for line in (line for ax in panels for line in ax.lines):
        assert np.isfinite(np.asarray(line.get_xydata(), float)).all()
    assert FORMATS["png"](figure).startswith(b"\x89PNG")


@pytest.mark.parametrize("moments", [both_ways((0.2, 0.5, 0.8, 1.1)), [-0.3, -0.6, -0.9]])
def test_figures_of_half_turns_are_complete(moments: list[float]) -> None:
    fit = identify(campaign(moments, seed=1, gain_scatter=0.02))
    drawn = {name: draw() for name, draw in sections(fit).figures.items()}
    assert drawn.keys() >= {"half_turns", "drag", "inertia", "collapse"}
    for figure in drawn.values():
        is_complete(figure)
