"""diagnose of planar models on campaigns of an independent solver: what is hidden is named, nothing is not."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from made_planar import HIDDEN, campaign, log

from automarine_cli.commands import automarine
from automarine_cli.diagnosis.planar import (
    FittedCandidate,
    PlanarDiagnosis,
    PlanarSearch,
    base_of,
    find_missing,
    find_planar_where,
    forecasts,
)
from automarine_cli.diagnosis.residual_regions import Region
from automarine_cli.fits.planar_fit import Estimated, PlanarLikelihood
from automarine_cli.fits.planar_structure import Observed, observed
from automarine_cli.logs import ColumnMap
from automarine_cli.models.planar import Inertia, PlanarModel
from automarine_cli.models.store import StoredPlanar, load_planar_model, planar_json
from automarine_cli.models.yaw_model import Term
from automarine_cli.report.diagnosis_report import planar_verdict
from automarine_cli.report.figures.diagnosis import before_after_figure, where_figure
from automarine_cli.report.sections import sections
from automarine_cli.thrusters.map import load_planar

GIVEN = PlanarModel(Inertia(18.0, 18.0, 2.2), *((Term("quadratic-drag", (drag,)),) for drag in (15.0, 50.0, 3.0)))
"""About the bare craft, as somebody would write it down."""
SPEEDS = ("heading", "surge", "sway")


@cache
def searched(kind: str, seed: int = 1, mirror: bool = False) -> PlanarSearch:
    """Three short runs are fitted, one is held out."""
    channels = ("heading", "north", "east") if kind == "current" else SPEEDS
    runs = campaign(HIDDEN[kind], seed, 4, 6.0, channels, mirror)
    return find_missing(StoredPlanar(GIVEN, "by hand"), runs[:3], runs[3:], observed(runs))


@pytest.mark.parametrize(
    ("kind", "added", "truth"),
    [
        ("N_v", "yaw.N_v", 4.0),
        pytest.param("N_ur", "yaw.N_ur", 2.5, marks=pytest.mark.slow),
        pytest.param("Y_r", "sway.Y_r", 4.0, marks=pytest.mark.slow),
        pytest.param("munk-moment", "sway.m_v", 32.0, marks=pytest.mark.slow),
        pytest.param("current", "current.north", 0.15, marks=pytest.mark.slow),
    ],
)
def test_what_is_hidden_is_named(kind: str, added: str, truth: float) -> None:
    found = searched(kind)
    assert found.verdict == "named"
    (step,) = found.steps
    assert found.named[0].candidate.added[0] == added and not step.rivals
    assert found.after.known[added] == pytest.approx(truth, rel=0.1)


def test_nothing_hidden_nothing_named_and_a_gap_without_a_name_is_unexplained() -> None:
    found = searched("nothing")
    assert found.verdict == "nothing-missing" and not found.suspected
    here = find_planar_where(found, 0)
    assert here is not None and here.regions == ()
    region = Region("sway", 0.1, 0.2, "m/s", 0.1, 0.004, ("run_0",), 0.3, "yaw moment")
    where: Any = SimpleNamespace(regions=(region,))
    open_gap = replace(found, where=where)
    assert open_gap.verdict == "unexplained"
    assert "where sway is 0.1 to 0.2 m/s" in open_gap.why and "No candidate gains" in open_gap.why
    most = FittedCandidate(found.rounds[0].promised[0][0], found.before, 163.0, False, 16.0)
    passed = replace(open_gap, rounds=(replace(found.rounds[0], tried=(most,)),))
    assert "gains 163 in deviance, but not in the mean of runs" in planar_verdict(passed)
    doubted = replace(open_gap, rounds=(replace(found.rounds[0], tried=(replace(most, steady=True),)),))
    assert planar_verdict(doubted).startswith(f"Suspected, not named: {most.candidate.label}. The fitted runs ask for")


@pytest.mark.slow
def test_the_mirrored_campaign_has_the_mirrored_verdict() -> None:
    one, other = (searched("N_v", mirror=mirror) for mirror in (False, True))
    assert [one.candidate.added for one in other.named] == [("yaw.N_v",)]
    assert other.named[0].surplus == pytest.approx(one.named[0].surplus, rel=1e-2)
    assert other.after.known["yaw.N_v"] == pytest.approx(one.after.known["yaw.N_v"], rel=1e-3)


@pytest.mark.slow
def test_a_missing_moment_stands_out_against_sway() -> None:
    """The filter needs -N_v v beside a model without it."""
    every = PlanarLikelihood(tuple(campaign(HIDDEN["N_v"], 3, 6, 30.0, SPEEDS)), Observed(SPEEDS))
    bare = StoredPlanar(GIVEN.with_theta([20.0, 20.0, 2.6, 0.0, 0.0, 0.0, 18.0, 60.0, 4.0]), "by hand")
    near = Estimated(base_of(bare, every.observed), np.zeros((0, 0)), 0.0, 0, random={"yaw.disturbance": 0.5})
    before = every.estimate(near.model, near, 6)
    search = PlanarSearch(before, (), every, 6, (forecasts(every, before),) * 2, (np.zeros(6),) * 2)
    where = find_planar_where(search, 0)
    assert where is not None
    best = min(where.variables, key=lambda one: one.p_value)
    assert best.name == "sway" and best.telling.kind == "yaw moment"
    slope = np.polyfit(best.middle, best.telling.mean, 1)[0]
    assert slope == pytest.approx(-4.0, rel=0.25)
    assert where.regions
    for region in where.regions:
        told = region.to_json("deg")
        assert {"variable", "from", "to", "unit", "gap_deg", "p_value", "runs"} <= set(told)
        assert region.p_value < 0.05 and set(region.runs) <= set(where.names)
    panel = where_figure(where, "nothing added").axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("sway [m/s]", "missing yaw moment [N m]")


@pytest.mark.parametrize("kind", ["N_v", pytest.param("current", marks=pytest.mark.slow)])
def test_before_and_after_are_drawn_beside_what_was_measured(kind: str) -> None:
    found = searched(kind)
    figure = before_after_figure(found)
    errors = [axes for axes in figure.axes if axes.get_xlabel() == "time [s]"]
    assert errors and len({axes.get_ylim() for axes in errors}) == 1
    tracks = [axes for axes in figure.axes if axes.get_xlabel() == "East [m]"]
    assert len(tracks) == (len(errors) if kind == "current" else 0)  # where places are logged
    for axes in tracks:
        measured, before, after = axes.lines
        assert len(measured.get_xdata()) > 0 and len(before.get_xdata()) == len(after.get_xdata()) > 0
        (low, high), east = axes.get_xlim(), np.asarray(measured.get_xdata())
        assert low < east.min() and east.max() < high and high - low < 2.0 * np.ptp(east) + 1.0
    (bars,) = sections(PlanarDiagnosis(found, (), "")).figures["why"]().axes
    assert len(bars.patches) == len(found.rounds[0].promised) > 8
    if kind == "N_v":
        assert bars.get_yticklabels()[-1].get_text() == "cross-coupling N_v"


@pytest.mark.slow
@pytest.mark.usefixtures("drawn_figures")
def test_logs_to_a_folder_of_results(tmp_path: Path) -> None:
    for run in campaign(HIDDEN["Y_r"], 1, 5, 8.0, SPEEDS):
        log(run, tmp_path)
    model, out = tmp_path / "given.json", tmp_path / "out"
    model.write_text(json.dumps(planar_json(GIVEN)))
    done = CliRunner().invoke(automarine, ["diagnose", str(tmp_path), "--model", str(model), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert done.output.startswith("Named: cross-coupling Y_r; the error of headings predicted 5 s ahead of the runs")
    names = {"diagnosis.json", "extended_model.json", "diagnosis.md", "where.png", "why.png", "before_after.png"}
    assert {path.name for path in out.iterdir()} == {*names, "manifest.json"}
    result = json.loads((out / "diagnosis.json").read_text())
    (effect,), gap, prediction = result["effects"], result["gap"], result["prediction"]
    assert effect["name"] == "cross-coupling"
    assert effect["parameters"]["sway.Y_r"]["value"] == pytest.approx(4.0, rel=0.1)
    for ahead in (gap["held_out_runs"], *prediction["held_out_runs"]["horizons"]):
        assert ahead["after_deg"] < ahead["before_deg"]
    fitted, floor = gap["fitted_runs"], gap["fitted_runs"]["noise_floor_deg"]
    assert max(fitted["before_deg"], fitted["after_deg"]) < 1.5 * floor  # a side force hardly moves the heading
    for which in ("fitted_runs", "held_out_runs"):
        assert prediction[which]["log_density_gain"] > 10.0 and prediction[which]["horizon_s"] == 5.0
    extended, runs = load_planar_model(out / "extended_model.json"), list(load_planar([tmp_path], ColumnMap()).runs)
    again = find_missing(extended, runs[:4], runs[4:], observed(runs))
    assert again.verdict == "nothing-missing" and set(extended.random) == set(again.after.random)
