"""Curves over one variable: the spline, the fit under its prior, the search and the files."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from click.testing import CliRunner, Result
from few_candidates import few_candidates
from figures import drawn
from made_driven import Sea, steered
from made_learned import BASE, LAWS, campaign, true_curve, true_gap, written

from automarine_cli import effects
from automarine_cli.commands import automarine
from automarine_cli.commands.diagnose import diagnose
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.learned_curve import ties
from automarine_cli.diagnosis.search import SearchResult
from automarine_cli.diagnosis.study import DiagnosisProblem, places, precision, smoothed
from automarine_cli.diagnosis.trials import CandidateFit, variants
from automarine_cli.dofs import DOFS, YAW
from automarine_cli.effects import State
from automarine_cli.effects.learned import KNOTS, basis, roughness
from automarine_cli.errors import ModelError
from automarine_cli.fits.mixed_model import MixedFit
from automarine_cli.models.model import Model

EVERY_VARIABLE = ["yaw-rate", "heading", "turned-angle", "moment", "time-in-run", "campaign-clock", "depth_m", "a {b}"]


def test_the_curve_is_exact_for_cubics_and_constant_beyond_or_comes_back_to_itself() -> None:
    knots, x = np.linspace(-1.0, 3.0, KNOTS), np.linspace(-1.0, 3.0, 41)
    values = 0.3 - knots + 0.7 * knots**2 - 0.2 * knots**3
    inside = basis(x, -1.0, 3.0, closed=False) @ values
    np.testing.assert_allclose(inside, 0.3 - x + 0.7 * x**2 - 0.2 * x**3, atol=1e-9)
    outside = basis(np.array([-9.0, 12.0]), -1.0, 3.0, closed=False) @ values
    np.testing.assert_allclose(outside, values[[0, -1]], atol=1e-9)
    values, x = np.cos(2.0 * np.pi * np.arange(KNOTS) / KNOTS), np.linspace(0.0, 6.0, 50)
    once, again = (basis(x + turns * 6.0, 0.0, 6.0, closed=True) @ values for turns in (0, 2))
    np.testing.assert_allclose(once, again, atol=1e-9)
    np.testing.assert_allclose(once, np.cos(2.0 * np.pi * x / 6.0), atol=2e-3)


@pytest.mark.parametrize("closed", [False, True])
def test_smooth_curves_are_likelier_than_rough_ones(closed: bool) -> None:
    """And where a simulation runs away the curve is no number: a fit may try what no vehicle is, and goes back."""
    at, stiff = np.arange(KNOTS), roughness(closed)
    smooth, rough = np.cos(2.0 * np.pi * at / KNOTS), (-1.0) ** at
    assert np.linalg.eigvalsh(stiff).min() > 0.0
    assert 10.0 * smooth @ stiff @ smooth < rough @ stiff @ rough
    away = basis(np.array([np.nan, 0.5]), 0.0, 1.0, closed=closed)
    assert np.all(np.isnan(away[0])) and np.all(np.isfinite(away[1]))


@pytest.mark.parametrize("name", EVERY_VARIABLE)
def test_a_curve_at_zero_adds_exactly_nothing(name: str) -> None:
    effect = effects.get(f"learned:{name}")
    random, values = np.random.default_rng(0), tuple(np.full((2, 1), value) for value in effect.off)
    drawn = [random.normal(size=(2, 3)) for _ in range(5)]
    state = State(*drawn, np.arange(3.0), {name: np.arange(3.0)})
    assert np.all(np.asarray(effect.moment(state, values)) == 0.0)
    assert f"learned:{name}" not in effects.names() and effects.known(f"learned:{name}")
    assert all(name in effect.card(dof).says for dof in DOFS.values() if effect.acts_in(dof))


def test_over_the_speed_a_moment_has_its_sign_and_a_variable_it_needs() -> None:
    effect, rates = effects.get("learned:yaw-rate"), np.array([[-0.7, 0.7]])
    values = tuple(np.full((1, 1), value) for value in [0.0, 1.0, 1.2, 0.1, *[0.5] * KNOTS, 0.0])
    moment = np.asarray(effect.moment(State(rates, rates, rates, rates, rates, rates, {}), values))
    np.testing.assert_allclose(moment, [[-0.6, 0.6]], atol=1e-9)
    assert not effects.known("learned:")
    with pytest.raises(ModelError, match="expected learned: and a variable"):
        effects.get("learned:")


def test_the_prior_holds_what_the_data_do_not_show() -> None:
    """Without any such effect a stiff curve is nothing, and a free one costs what it can follow."""
    runs = campaign("nothing", repeats=1)
    study = DiagnosisProblem(tuple(runs), BASE, False, ("water_temp_C",))
    base = study.fit(BASE)
    count = []
    for spread in (1e-4, 1.0):
        model = BASE.with_effect("learned:water_temp_C", [4.0, 24.0, 1.2, spread, *[0.0] * KNOTS, 1.0])
        fit = study.fit(model, np.append(base.of_model, model.terms[-1].values), base)
        assert isinstance(fit, MixedFit) and fit.left_out.shape[0] == len(runs) == len(fit.predictive)
        count.append(smoothed(fit, model)[1])
        own = fit.covariance[np.ix_(places(model), places(model))]
        assert np.all(np.linalg.eigvalsh(np.linalg.inv(own) - precision(model)) > -1e-2 / own.max())
        if spread < 1e-3:
            np.testing.assert_allclose(fit.theta[places(model)], 0.0, atol=2e-3)
            assert abs(fit.log_likelihood - base.log_likelihood) < 0.5
    assert count[0] < 0.2 and 3.0 < count[1] < KNOTS


@pytest.fixture(scope="module")
def few() -> Iterator[None]:
    with few_candidates({"linear-drag", "bias-moment"}):
        yield


def run(*words: object) -> Result:
    return CliRunner().invoke(automarine, [str(word) for word in words])


@pytest.fixture(scope="module")
def by_command(tmp_path_factory: pytest.TempPathFactory, few: None) -> tuple[Path, Diagnosis]:
    """Logs of a campaign in which thrust follows the temperature, fitted and diagnosed into a folder."""
    folder = tmp_path_factory.mktemp("learned")
    logs = written(campaign("temperature", repeats=1), folder / "logs")
    assert run("fit-yaw", logs, "--fit-to", "whole-runs", "-o", folder / "fit").exit_code == 0
    with drawn():
        return folder, diagnose([logs], model=folder / "fit" / "yaw_model.json", out=folder / "diagnosis")


@pytest.fixture(scope="module", params=["temperature", "rate", "product"])
def found(request: pytest.FixtureRequest, few: None) -> tuple[str, Diagnosis]:
    """A law, and the diagnosis of a campaign with it."""
    if request.param == "temperature":
        return request.param, request.getfixturevalue("by_command")[1]
    return request.param, diagnose_runs(campaign(request.param, repeats=1), BASE)


@pytest.mark.slow
def test_the_right_variable_is_named_and_the_band_holds_the_truth(found: tuple[str, Diagnosis]) -> None:
    name, diagnosis = found
    variable, kind, _ = LAWS[name]
    assert (diagnosis.verdict, diagnosis.search.final.added) == ("named", (f"learned:{variable}",))
    assert diagnosis.held_out is not None and not any(diagnosis.search.rivals.values())
    assert diagnosis.held_out.gap.after < 1.1 * true_gap(name, diagnosis)
    curve, truth = diagnosis.effects[0].learned, true_curve(name, diagnosis)
    assert curve.kind == kind and kind.replace("gain", "thrust") in diagnosis.effects[0].says
    assert np.mean((truth > curve.low) & (truth < curve.high)) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_column_that_alone_leaves_noise_ends_the_search_at_its_first_look(side: float) -> None:
    """Mirrored too: with all effects to choose from, of which several gain beyond chance."""
    runs = [replace(r, position=side * r.position, moment=side * r.moment) for r in campaign("depth", repeats=1)]
    further: list[str] = []
    diagnosis = diagnose_runs(runs, BASE, goes_on=lambda: further.append("look"))
    (first,) = diagnosis.search.rounds
    assert first.gain(first.trials[0]) > first.threshold and not further
    assert (diagnosis.verdict, diagnosis.search.final.added) == ("named", ("learned:depth_below_m",))


@pytest.mark.slow
def test_of_driven_runs_a_gain_on_the_temperature_is_learned(few: None) -> None:
    runs = steered(6, sea=Sea(warmth=0.4), length=40.0)
    diagnosis = diagnose_runs(runs, Model.base("3", 1.0, (1.2,), "nu", YAW))
    assert diagnosis.driven and diagnosis.search.final.added == ("learned:water_temp_C",)
    curve = diagnosis.effects[0].learned
    truth = 0.2 * np.tanh((curve.x - 14.0) / 4.0)
    miss = truth - truth.mean() - (curve.y - curve.y.mean())
    assert curve.kind == "gain" and np.abs(miss).max() < 0.5 * np.ptp(truth)


def test_a_curve_has_no_other_law_to_choose_by_runs_held_out() -> None:
    study = DiagnosisProblem(tuple(campaign("nothing", repeats=1)), BASE, False, ("water_temp_C",))
    values = [4.0, 24.0, 1.2, 1.0, *[0.0] * KNOTS, 1.0]
    model = BASE.with_effect("learned:water_temp_C", values)
    trial = CandidateFit(("learned:water_temp_C",), model, cast(MixedFit, None), 0.0)
    assert variants(study, trial) == []


def test_a_curve_that_does_as_well_as_an_effect_is_its_rival() -> None:
    base = CandidateFit((), BASE, cast(MixedFit, None), 100.0)
    named = replace(base, added=("battery-sag",), evidence=40.0)
    found = SearchResult(cast(DiagnosisProblem, None), base, named, (), {}, {})
    for evidence, rivals in ((45.0, {"learned:campaign-clock": 5.0}), (60.0, {})):
        curve = replace(base, added=("learned:campaign-clock",), evidence=evidence)
        assert ties(found, curve) == {"battery-sag": rivals}


@pytest.mark.slow
def test_clean_campaigns_stay_silent(few: None) -> None:
    for seed in (1, 2):
        assert diagnose_runs(campaign("nothing", seed, repeats=1), BASE, seed=seed).verdict == "nothing-missing"


@pytest.mark.slow
def test_the_curve_is_in_the_result_and_its_model_is_better(by_command: tuple[Path, Diagnosis], tmp_path: Path) -> None:
    folder = by_command[0]
    (effect,) = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())["effects"]
    assert effect["name"] == "learned:water_temp_C" and effect["says"].startswith("The thrust depends on")
    entry = effect["learned"]
    x, y, low, high = (np.array(entry[key]) for key in ("x", "y", "low", "high"))
    assert entry["variable"] == "water_temp_C" and entry["kind"] == "gain"
    assert len(x) == len(y) and np.all((low < y) & (y < high)) and np.all(np.diff(x) > 0)
    assert (folder / "diagnosis" / "learned.png").stat().st_size > 1000
    assert "![What was learned](learned.png)" in (folder / "diagnosis" / "diagnosis.md").read_text()
    model, errors = folder / "diagnosis" / "extended_model.json", []
    for number, path in enumerate([folder / "fit" / "yaw_model.json", model]):
        out = tmp_path / str(number)
        assert run("validate", folder / "logs", "--model", path, "-o", out, "--figures", "none").exit_code == 0
        errors.append(json.loads((out / "validation.json").read_text())["models"]["3"]["rmse_deg"])
    assert errors[1] < 0.5 * errors[0]
    assert run("export", model, "--to", "card", "-o", tmp_path / "card.md").exit_code == 0
    assert "learned:water_temp_C" in (tmp_path / "card.md").read_text()
    assert run("export", model, "--to", "python", "-o", tmp_path / "sim.py").exit_code == 0
