"""The figures and the page of a diagnosis: what a person is shown is what was found."""

from dataclasses import replace

import numpy as np
import pytest
from effect_contract import base_for, planted, short_plans
from few_candidates import few_candidates

from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.residual_regions import ResidualRegions
from automarine_cli.report import diagnosis_report  # noqa: F401  registers what a diagnosis shows
from automarine_cli.report.figures.diagnosis import before_after, where_figure
from automarine_cli.report.sections import sections

BASE = base_for("")
TRIED = {"thruster-lag", "input-delay", "dead-band", "bias-moment"}


def diagnosed(*names: str, seed: int) -> Diagnosis:
    """A small campaign with these effects in it; its runs are called what Markdown and HTML take for something else."""
    runs = planted(BASE, *names, seed=seed, plans=short_plans(), noise_deg=1.0)
    with few_candidates(TRIED, curves=False):  # a few will do for drawing
        return diagnose_runs([replace(run, name=f"lap|<b>_1* {run.name}", extras={}) for run in runs], BASE)


def page(diagnosis: Diagnosis) -> str:
    return str(sections(diagnosis).files["diagnosis.md"])


@pytest.fixture(scope="module")
def lag() -> Diagnosis:
    return diagnosed("thruster-lag", seed=1)


@pytest.fixture(scope="module")
def nothing() -> Diagnosis:
    return diagnosed(seed=2)


def test_nothing_missing_says_what_would_have_been_seen(nothing: Diagnosis) -> None:
    assert nothing.verdict == "nothing-missing" and nothing.where.regions == ()
    text = page(nothing)
    assert text.startswith("# Diagnosis") and "Nothing missing that these runs could show" in text
    first, _, tried = text.partition("## Where the gap is")
    assert "**Smallest effects that these runs would have shown**" in first and "| dead-band | width |" in first
    assert "## Why" in tried and "before" not in text and "What it does" not in text


def test_where_draws_what_stands_out_and_lists_the_rest(lag: Diagnosis, nothing: Diagnosis) -> None:
    figure, variables = where_figure(lag.where), lag.where.variables
    out = {variable.column.name.replace("-", " ") for variable in variables if variable.stands_out.any()}
    drawn = {axes.get_xlabel().partition(" [")[0] for axes in figure.axes if axes.axison}
    assert drawn == out and all(axes.patches for axes in figure.axes if axes.axison)
    rest = {variable.column.name.replace("-", " ") for variable in variables} - out
    assert all(name in figure.get_suptitle().replace("\n", " ") for name in rest)
    assert len(where_figure(nothing.where).axes) == len(where_figure(ResidualRegions()).axes) == 1


def test_before_and_after_share_their_axes_and_do_without_held_out_runs(lag: Diagnosis) -> None:
    alone = replace(lag, held_out=None, from_commands=None)
    for diagnosis, part in ((lag, lag.held_out), (alone, lag.fitted)):
        assert part is not None
        sizes, *errors = sorted(before_after(diagnosis).axes, key=lambda axes: bool(axes.get_title()))
        assert len(errors) == min(len(part.runs), 3) and len({axes.get_ylim() for axes in errors}) == 1
        before, after = (np.asarray(line.get_xdata(), float) for line in sizes.lines[:2])
        assert len(before) == len(part.runs) and list(before) == sorted(before, reverse=True)
        assert after.mean() < before.mean()
    assert "held out" not in page(alone)
