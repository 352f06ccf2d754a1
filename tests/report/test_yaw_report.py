"""Figures of a fit by their structure; `tests/golden` has its tables."""

import re
from dataclasses import replace

import numpy as np
import pytest
from identified import identify
from made_campaigns import both_ways, campaign, moving_run
from matplotlib.figure import Figure

from automarine_cli.fits.identify import YawFit
from automarine_cli.report import fit_report  # noqa: F401  registers what a fit shows
from automarine_cli.report.figures import runs as figures
from automarine_cli.report.figures.style import FIGURE_WRITERS
from automarine_cli.report.sections import sections

pytestmark = pytest.mark.usefixtures("drawn_figures")


@pytest.fixture(scope="module")
def whole() -> YawFit:
    return identify([moving_run(seed, length=15.0)[0] for seed in range(2)], "whole-runs")


def is_complete(figure: Figure) -> None:
    """Labels with units on the outer axes, all data finite."""
    panels = [ax for ax in figure.axes if ax.axison]
    labels = [label for ax in panels for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
    assert labels and all(re.search(r"\[.+\]", label) for label in labels), labels
    for line in (line for ax in panels for line in ax.lines):
        assert np.isfinite(np.asarray(line.get_xydata(), float)).all()
    assert FIGURE_WRITERS["png"](figure).startswith(b"\x89PNG")


def test_whole_runs_stand_with_their_fit_the_worst_first(whole: YawFit) -> None:
    """A run with thrust of its own is followed well and predicted badly: the figure shows both."""
    late = whole.runs[1]
    run = replace(late, moment=1.3 * late.command, position=late.position.copy())
    for fit in (whole, replace(whole, runs=(whole.runs[0], run))):
        figure = figures.whole_runs_figure(fit)
        is_complete(figure)
        every, *panels = sorted(figure.axes, key=lambda axes: bool(axes.get_title()))
        assert {ax.get_title() for ax in panels} == {"moving_0", "moving_1"}
        sizes = [[np.sqrt(np.mean(np.asarray(line.get_ydata(), float) ** 2)) for line in ax.lines] for ax in panels]
        assert [list(np.asarray(line.get_xdata())) for line in every.lines[:2]] == [list(of) for of in zip(*sizes)]
        assert sizes == sorted(sizes, reverse=True)
        if fit is whole:
            assert all(fitted < 1.0 and fitted <= free * 1.01 for free, fitted in sizes)
    assert panels[0].get_title() == run.name and sizes[0][0] > 5.0 * sizes[0][1]


@pytest.mark.parametrize("moments", [both_ways((0.2, 0.5, 0.8, 1.1)), [-0.3, -0.6, -0.9]])
def test_figures_of_half_turns_are_complete(moments: list[float]) -> None:
    fit = identify(campaign(moments, seed=1, gain_scatter=0.02))
    drawn = {name: draw() for name, draw in sections(fit).figures.items()}
    assert drawn.keys() >= {"half_turns", "drag", "inertia", "collapse"}
    for figure in drawn.values():
        is_complete(figure)
