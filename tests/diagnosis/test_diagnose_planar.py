"""diagnose of planar models on campaigns of an independent solver: what is hidden is named, nothing is not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_planar import HIDDEN, campaign, quadratic_drags

from automarine_cli.diagnosis.planar import (
    FittedCandidate,
    PlanarDiagnosis,
    base_of,
    find_missing,
    find_planar_where,
    forecasts,
)
from automarine_cli.diagnosis.residual_regions import Region
from automarine_cli.fits.planar_fit import Observed, PlanarLikelihood, observed
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.report.diagnosis_report import planar_verdict
from automarine_cli.report.figures.diagnosis import where_figure

GIVEN = quadratic_drags(18.0, 18.0, 2.2, drags=(15.0, 50.0, 3.0))
"""About the bare craft, as somebody would write it down."""


def stored(model: Model) -> StoredModels:
    return StoredModels({"planar": model}, "planar", 0.0, "by hand")


SPEEDS = ("heading", "surge", "sway")


@cache
def searched(kind: str, seed: int = 1, mirror: bool = False) -> PlanarDiagnosis:
    """Three short runs are fitted, one is held out."""
    channels = ("heading", "north", "east") if kind == "current" else SPEEDS
    runs = campaign(HIDDEN[kind], seed, 4, 6.0, channels, mirror)
    return find_missing(stored(GIVEN), runs[:3], runs[3:], observed(runs))


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
    step = found.rounds[0]
    assert len(found.named) == 1
    assert found.named[0].candidate.added[0] == added and not step.rivals
    assert found.after.values[added] == pytest.approx(truth, rel=0.1)


def test_nothing_hidden_nothing_named_and_a_gap_without_a_name_is_unexplained() -> None:
    found = searched("nothing")
    assert found.verdict == "nothing-missing" and not found.suspected
    assert find_planar_where(found, 0).regions == ()
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
    assert other.after.values["yaw.N_v"] == pytest.approx(one.after.values["yaw.N_v"], rel=1e-3)


@pytest.mark.slow
def test_a_missing_moment_stands_out_against_sway() -> None:
    """The filter needs -N_v v beside a model without it."""
    every = PlanarLikelihood(tuple(campaign(HIDDEN["N_v"], 3, 6, 30.0, SPEEDS)), Observed(SPEEDS))
    bare = stored(GIVEN.with_theta([20.0, 20.0, 2.6, 0.0, 0.0, 0.0, 18.0, 60.0, 4.0]))
    before = every.estimate(base_of(bare, every.observed), {"yaw.disturbance": 0.5}, 6)
    search = PlanarDiagnosis(before, (), every, 6, (forecasts(every, before),) * 2, (np.zeros(6),) * 2)
    where = find_planar_where(search, 0)
    best = min(where.variables, key=lambda one: one.p_value)
    assert best.column.name == "sway" and best.telling.kind == "yaw moment"
    slope = np.polyfit(best.middle, best.telling.mean, 1)[0]
    assert slope == pytest.approx(-4.0, rel=0.25)
    assert where.regions
    for region in where.regions:
        told = region.to_json("deg")
        assert {"variable", "from", "to", "unit", "gap_deg", "p_value", "runs"} <= set(told)
        assert region.p_value < 0.05 and set(region.runs) <= set(every.course.names)
    panel = where_figure(where).axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("sway [m/s]", "gap in yaw moment [N m]")
