"""The figures and the page of a diagnosis: what a person is shown is what was found."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import Diagnosis, MotionDiagnosis, diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report import diagnosis_report  # noqa: F401  registers what a diagnosis shows
from automarine_cli.report.figures.diagnosis import before_after_figure, where_figure
from automarine_cli.report.figures.style import FORMATS
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table, escape
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

TRUTH = YawModel.base("3", 1.018, (1.257,), "nu", YAW)
TRIED = ("thruster-lag", "input-delay", "dead-band", "bias-moment")


def campaign(model: YawModel, name: str, seed: int, runs: int = 12) -> list[Run]:
    """Short steps and coast-downs to either side, with 1 degree of noise and 2 % of scatter."""
    random = np.random.default_rng(seed)
    plans = []
    for i in range(runs):
        tau = (1 if i % 2 else -1) * (0.2 + 0.9 * ((5 * i) % 8) / 7)
        time = np.arange(0.0, 14.0, 0.2) + 60.0 * i
        into = time - time[0]
        command = np.where(into < 1.9, 0.0, np.where(into < 8.9, tau, 0.0 if i % 3 == 0 else tau))
        plans.append(Run(f"{name} {i}", "planted", time, 0 * time, command, "nu", dof=YAW))
    batch = make_batch(plans, 0.05)
    start = Start(position=random.uniform(0, 6, (1, runs)), log_gain=0.02 * random.normal(size=(1, runs)))
    heading = simulate(model, batch, start=start).position[0]
    return [
        replace(plan, position=row[: len(plan)] + np.radians(1.0) * random.normal(size=len(plan)))
        for plan, row in zip(plans, heading)
    ]


STORED: Any = SimpleNamespace(preferred="3", moment_unit="nu", dof=YAW, source="model.json")


def told(diagnosis: Diagnosis) -> Sections:
    return sections(MotionDiagnosis(diagnosis, STORED, "", ()))


def page(diagnosis: Diagnosis) -> str:
    return str(told(diagnosis).files["diagnosis.md"])


def names_of(model: YawModel) -> set[str]:
    return {term.name for term in model.terms}


def shown(model: YawModel, name: str, seed: int) -> Diagnosis:
    with pytest.MonkeyPatch.context() as patch:  # a few candidates will do for drawing
        patch.setattr(search, "candidates", lambda study, model: [n for n in TRIED if n not in names_of(model)])
        return diagnose_runs(campaign(model, name, seed), TRUTH)


@pytest.fixture(scope="module")
def lag() -> Diagnosis:
    """A thruster lag is missing; the runs have a name that Markdown and HTML would take for something else."""
    return shown(TRUTH.with_effect("thruster-lag", [0.4]), "lap|<b>_1*", 1)


@pytest.fixture(scope="module")
def nothing() -> Diagnosis:
    return shown(TRUTH, "run", 2)


def test_a_missing_lag_is_seen_and_the_page_says_so(lag: Diagnosis) -> None:
    diagnosis = lag
    assert {"time-since-command-change", "time-in-run"} & {region.variable for region in diagnosis.where.regions}
    text = page(lag)
    assert diagnosis.verdict == "named"
    for effect in diagnosis.effects:
        assert f"## {effect.name}" in text and effect.says in text
        assert all(f"Cannot be excluded: {rival.name} " in text for rival in effect.rivals)
    assert "had absorbed part of" in text  # without the lag, inertia stands in for it
    for name in ("where.png", "why.png", "before_after.png"):
        assert f"({name})" in text


def test_names_of_runs_are_shown_as_they_are(lag: Diagnosis) -> None:
    assert any(region.runs for region in lag.where.regions)
    text = page(lag)
    assert "<b>" not in text.replace("\\<b\\>", "") and "lap|" not in text
    assert escape("a|<b>_1*\n# c") == r"a\|\<b\>\_1\* # c" and escape("# c") == r"\# c"


def test_nothing_missing_says_what_would_have_been_seen(nothing: Diagnosis) -> None:
    diagnosis = nothing
    assert diagnosis.verdict == "nothing-missing" and diagnosis.where.regions == ()
    text = page(nothing)
    assert text.startswith("# Diagnosis") and "Nothing missing that these runs could show" in text
    assert "## What these runs would have shown" in text and "| dead-band | width |" in text
    assert "Add two reversals" in text


def test_the_table_of_the_gap_counts_what_was_closed(lag: Diagnosis) -> None:
    diagnosis = lag
    table = next(part for part in told(diagnosis).printed if isinstance(part, Table) and part.header[0] == "gap")
    cells = table.rows[0]
    assert float(str(cells[1])) == pytest.approx(np.degrees(diagnosis.gap.before), abs=0.006)
    assert float(str(cells[2])) == pytest.approx(np.degrees(diagnosis.gap.after), abs=0.006)
    assert int(str(cells[4]).rstrip("%")) > 80


def test_where_marks_what_stands_out_and_draws_every_variable(lag: Diagnosis) -> None:
    diagnosis = lag
    figure = where_figure(diagnosis.where, diagnosis.words)
    titles = [axes.get_title() for axes in figure.axes]
    out = sum(bool(variable.stands_out.any()) for variable in diagnosis.where.variables)
    assert sum(title.startswith("p = ") for title in titles) == out > 0
    assert sum(title == "within chance" for title in titles) == len(diagnosis.where.variables) - out
    image = next(axes for axes in figure.axes if axes.images)
    assert len(np.asarray(image.images[0].get_array())) == len(diagnosis.study.runs)


def test_why_sorts_candidates_and_marks_those_named(lag: Diagnosis) -> None:
    diagnosis = lag
    figure = told(diagnosis).figures["why"]()
    bars = max(figure.axes, key=lambda axes: len(axes.patches))
    lengths = [bar.get_width() for bar in bars.patches if isinstance(bar, Rectangle)]
    assert lengths == sorted(lengths) and len(lengths) == len(diagnosis.result.rounds[0].trials)
    bold = [label.get_text() for label in bars.get_yticklabels() if label.get_fontweight() == "bold"]
    assert set(bold) == set(diagnosis.result.final.added) & {t.added[-1] for t in diagnosis.result.rounds[0].trials}


def test_before_and_after_share_their_axes(lag: Diagnosis) -> None:
    diagnosis = lag
    figure = before_after_figure(diagnosis)
    errors = [axes for axes in figure.axes if axes.get_xlabel() == "time [s]"]
    assert len(errors) == 4 and len({axes.get_ylim() for axes in errors}) == 1
    square = next(axes for axes in figure.axes if axes.get_xlabel().startswith("gap before"))
    assert square.get_xlim() == square.get_ylim()


@pytest.mark.slow
@pytest.mark.usefixtures("drawn_figures")
def test_figures_are_the_same_bytes_each_time(nothing: Diagnosis) -> None:
    diagnosis = nothing
    assert FORMATS["png"](where_figure(diagnosis.where, diagnosis.words))[:4] == b"\x89PNG"
    for draw in (told(diagnosis).figures["why"], lambda: before_after_figure(diagnosis)):
        first = FORMATS["png"](draw())
        assert first[:4] == b"\x89PNG" and first == FORMATS["png"](draw())


def test_figures_and_page_do_without_held_out_runs(lag: Diagnosis) -> None:
    diagnosis = lag
    alone = replace(diagnosis, held_out=None, held_out_gap=None)
    assert before_after_figure(alone).axes
    assert "held out" not in page(alone)
