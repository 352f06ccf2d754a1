"""diagnose of planar models on campaigns of an independent solver: what is hidden is named, nothing is not."""

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_planar import HIDDEN, campaign, quadratic_drags

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.planar import FittedCandidate, base_of, diagnose_planar, find_planar_where, verdict_of
from automarine_cli.diagnosis.residual_regions import Region
from automarine_cli.fits.planar_fit import PlanarLikelihood
from automarine_cli.fits.planar_structure import Observed, observed
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels, models_of
from automarine_cli.report.diagnosis_report import candidates
from automarine_cli.report.figures.diagnosis import where_figure
from automarine_cli.runs.run import Run

GIVEN = quadratic_drags(18.0, 18.0, 2.2, drags=(15.0, 50.0, 3.0))
"""About the bare craft, as somebody would write it down."""


def stored(model: Model) -> StoredModels:
    return StoredModels({"planar": model}, "planar", 0.0, "by hand")


SPEEDS = ("heading", "surge", "sway")
LAG_S = 0.4


@cache
def searched(kind: str, seed: int = 1, mirror: bool = False) -> Diagnosis:
    """Three short runs are fitted, one is held out."""
    channels = ("heading", "north", "east") if kind == "current" else SPEEDS
    craft, lag_s = (HIDDEN["nothing"], LAG_S) if kind == "thruster-lag" else (HIDDEN[kind], 0.0)
    runs = campaign(craft, seed, 4, 6.0, channels, mirror, lag_s)
    return diagnose_planar(stored(GIVEN), runs[:3], runs[3:], observed(runs))


@pytest.mark.parametrize(
    ("kind", "added", "truth"),
    [
        ("N_v", "yaw.N_v", 4.0),
        pytest.param("N_ur", "yaw.N_ur", 2.5, marks=pytest.mark.slow),
        pytest.param("thruster-lag", "surge.thruster-lag.T", LAG_S, marks=pytest.mark.slow),
        pytest.param("Y_r", "sway.Y_r", 4.0, marks=pytest.mark.slow),
        pytest.param("munk-moment", "sway.m_v", 32.0, marks=pytest.mark.slow),
        pytest.param("current", "current.north", 0.15, marks=pytest.mark.slow),
    ],
)
def test_what_is_hidden_is_named(kind: str, added: str, truth: float) -> None:
    found = searched(kind)
    (effect,) = found.effects
    assert found.verdict == "named" and next(iter(effect.parameters)) == added and not effect.rivals
    assert effect.parameters[added].value == pytest.approx(truth, rel=0.1)


def test_nothing_hidden_nothing_named_and_a_gap_without_a_name_is_unexplained() -> None:
    found = searched("nothing")
    assert found.verdict == "nothing-missing" and not found.effects and found.where.regions == ()
    region = Region("sway", 0.1, 0.2, "m/s", 0.1, 0.004, ("run_0",), 0.3, "yaw moment")
    where: Any = SimpleNamespace(regions=(region,))
    word, why = verdict_of(found.search, where)
    assert word == "unexplained" and "where sway is 0.1 to 0.2 m/s" in why and "No candidate gains" in why
    (first,) = found.search
    most = FittedCandidate(first.promised[0][0], first.before, 163.0, False, 16.0)
    word, why = verdict_of([replace(first, tried=(most,))], where)
    assert word == "unexplained" and "gains 163 in deviance, but not in the mean of runs" in why
    word, why = verdict_of([replace(first, tried=(replace(most, steady=True, nearer=False),))], where)
    assert word == "unexplained" and "gains 163 in deviance, but predictions come nearer by less than 3 %" in why
    word, why = verdict_of([replace(first, tried=(replace(most, steady=True),))], where)
    assert word == "suspected" and why.startswith(f"The fitted runs ask for {most.candidate.label}, but")


def pushed(run: Run) -> Run:
    """The run with a moment of 1 N m beside its commands."""
    assert run.moment is not None
    return replace(run, moment=run.moment + 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("mirror", [False, True])
def test_an_effect_of_the_library_is_named_in_its_motion(mirror: bool) -> None:
    runs = campaign(HIDDEN["nothing"], 1, 4, 8.0, SPEEDS, mirror, given=pushed)
    found = diagnose_planar(stored(GIVEN), runs[:3], runs[3:], observed(runs))
    (effect,) = found.effects
    assert found.verdict == "named" and effect.label == "bias-moment b in yaw" and not effect.rivals
    assert effect.parameters["yaw.bias-moment.b"].value == pytest.approx(-1.0 if mirror else 1.0, rel=0.1)
    extended = models_of(json.loads(json.dumps(found.extended)), "").model
    assert extended.values["yaw.bias-moment.b"] == effect.parameters["yaw.bias-moment.b"].value
    status = {row["effect"]: row["is"] for row in candidates(found.to_json(), found.effects)}
    assert status["bias-moment b in yaw"] == "named" and status["bias-moment b in surge"] != "named"


@pytest.mark.slow
def test_the_mirrored_campaign_has_the_mirrored_verdict() -> None:
    one, other = (searched("N_v", mirror=mirror) for mirror in (False, True))
    assert [list(effect.parameters) for effect in other.effects] == [["yaw.N_v"]]
    surplus = [found.search[0].best.surplus for found in (one, other)]
    assert surplus[1] == pytest.approx(surplus[0], rel=1e-2)
    sizes = [found.effects[0].parameters["yaw.N_v"].value for found in (one, other)]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


@pytest.mark.slow
def test_a_missing_moment_stands_out_against_sway() -> None:
    """The filter needs -N_v v beside a model without it."""
    every = PlanarLikelihood(tuple(campaign(HIDDEN["N_v"], 3, 6, 30.0, SPEEDS)), Observed(SPEEDS))
    bare = stored(GIVEN.with_theta([20.0, 20.0, 2.6, 0.0, 0.0, 0.0, 18.0, 60.0, 4.0]))
    before = every.estimate(base_of(bare, every.observed), {"yaw.disturbance": 0.5}, 6)
    where = find_planar_where(every, before, 0)
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
