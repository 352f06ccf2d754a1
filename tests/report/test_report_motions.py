"""Tables, pages, figures and views of each translation are in its own words, and what people named stays."""

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from effect_contract import strange_to
from identified import identify
from matplotlib.figure import Figure
from repository import SAMPLE_RUNS

from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import Diagnosis, MotionDiagnosis, diagnose_runs
from automarine_cli.dofs import HEAVE, SURGE, SWAY, Dof
from automarine_cli.fits.identify import YawFit
from automarine_cli.report import fit_report
from automarine_cli.report.campaign import captions
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.report.sections import sections
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import Trim
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

FORCES = {dof.name: dof for dof in (SURGE, SWAY, HEAVE)}
EVERY_FORCE = pytest.mark.parametrize("name", FORCES)
LOGS = {"surge": "surge", "sway": "surge", "heave": "heave"}  # a hull that drags abeam as it does ahead
THEIRS = "yaw turns"
"""What somebody may call a run."""
TRIED = ("thruster-lag", "bias-moment")
TOLD_ALIKE = "whole runs are turned or dealt at random"  # the signs of their gaps are


def runs_of(name: str) -> list[Run]:
    """The steps of the sample campaign, under names of another motion."""
    logged = FORCES[LOGS[name]]
    runs = load_runs([SAMPLE_RUNS / LOGS[name]], dof=logged).runs
    return [replace(run, name=f"{THEIRS} {i}", dof=FORCES[name]) for i, run in enumerate(runs)]


@pytest.fixture(scope="module")
def fits() -> dict[str, YawFit]:
    trims = {"heave": Trim(None, 0.0, 3.6)}
    return {name: identify(runs_of(name), trim=trims.get(name, Trim(3.0))) for name in FORCES}


def refuse_strange(dof: Dof, texts: Iterable[str]) -> None:
    """Every text is about this motion, whatever the runs are called."""
    for text in texts:
        assert not strange_to(dof, text.replace(THEIRS, "").replace(TOLD_ALIKE, "")), text


def labels(figure: Figure) -> list[str]:
    """Titles, labels and legends of a figure, without names of functions."""
    found = [figure.get_suptitle()]
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    found += [text.get_text() for one in legends if one is not None for text in one.get_texts()]
    for axes in figure.axes:
        found += [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]
        found += [text.get_text() for text in axes.texts]
    return [text.replace("\\cosh", "").replace("\\ln", "") for text in found]


@EVERY_FORCE
def test_a_fit_speaks_of_its_motion(fits: dict[str, YawFit], name: str) -> None:
    fit, dof = fits[name], FORCES[name]
    tables = [*fit_report.tables(fit), *fit_report.tables(fit, short=True)]
    for table in tables:
        refuse_strange(dof, [table.to_csv(), table.to_markdown()])
        assert any(sign in table.to_latex() for sign in (dof.symbols.quadratic_math, dof.symbols.inertia))
    refuse_strange(dof, [*fit_report.sentences(fit), repr(fit), *captions(dof).values()])
    keys = [key.replace("_", " ") for key in fit_report.run_rows(fit)[0]]
    refuse_strange(dof, keys)
    assert f"start {dof.words.position} m" in keys and "covered cm" in keys and dof.words.force in keys
    first = fit.turns[0]
    row = fit_report.run_rows(fit)[0]
    assert row[f"start_{dof.words.position}_m"] == pytest.approx(first.start_position)
    assert row["run"] == first.name


@EVERY_FORCE
def test_only_drag_that_may_differ_is_told_by_way(fits: dict[str, YawFit], name: str) -> None:
    one, _ = fit_report.tables(fits[name])
    text, ways = one.to_markdown(), FORCES[name].words.ways
    assert f"{ways[0].capitalize()} is positive" in text
    assert ("one drag both ways" in text) == FORCES[name].directional == ("The drag of one way" in text)


@EVERY_FORCE
def test_figures_of_a_fit_are_labelled_in_letters_and_units_of_the_motion(fits: dict[str, YawFit], name: str) -> None:
    fit, dof = fits[name], FORCES[name]
    drawn = sections(fit).figures
    assert list(drawn) == ["steps", "drag", "inertia", "collapse"]
    written = {stem: labels(draw()) for stem, draw in drawn.items()}
    for texts in written.values():
        refuse_strange(dof, texts)
    own, words = dof.symbols, dof.words
    assert f"Steady {words.rate} {own.velocity} [cm/s]" in written["drag"]
    assert f"Mass with added mass ${own.inertia}$ [kg]" in written["inertia"]
    assert (
        f"{words.position.capitalize()} moved sgn({own.force})({own.position} − {own.position}₀) [cm]"
        in (written["collapse"])
    )
    assert f"{words.to_ways[1]} (negative forces)" in written["steps"]


@pytest.fixture(scope="module")
def diagnosed(fits: dict[str, YawFit]) -> dict[str, Diagnosis]:
    found = {}
    with pytest.MonkeyPatch.context() as patch:  # a few candidates will do for drawing
        patch.setattr(
            search, "candidates",
            lambda study, model: [n for n in TRIED if n not in {term.name for term in model.terms}],
        )  # fmt: skip
        for name in ("surge", "heave"):
            found[name] = diagnose_runs(runs_of(name)[:16], fits[name].preferred.model)
    return found


@pytest.mark.parametrize("name", ["surge", "heave"])
def test_a_diagnosis_speaks_of_its_motion(diagnosed: dict[str, Diagnosis], name: str) -> None:
    diagnosis, dof = diagnosed[name], FORCES[name]
    stored: Any = SimpleNamespace(preferred="3", moment_unit="N", dof=dof, source="")
    told = sections(MotionDiagnosis(diagnosis, stored, "", ()))
    refuse_strange(dof, str(told.files["diagnosis.md"]).splitlines())
    refuse_strange(dof, [verdict_sentence(diagnosis)])
    refuse_strange(dof, [part.to_markdown() if isinstance(part, Table) else part for part in told.printed])
    figures = {name: labels(draw()) for name, draw in told.figures.items()}
    assert list(figures) == ["where", "why", "before_after"]
    for texts in figures.values():
        refuse_strange(dof, texts)
    assert any(THEIRS in text for text in figures["before_after"])
