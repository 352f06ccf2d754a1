"""What is hidden in the surge and heave campaigns of sample_runs is found, with the size that it has."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from repository import SAMPLE_RUNS
from specified import read_specification

from automarine_cli import effects
from automarine_cli.commands.validate import validate
from automarine_cli.diagnosis.diagnose import Diagnosis, diagnose_runs
from automarine_cli.diagnosis.scores import candidates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import DOFS, HEAVE, SURGE
from automarine_cli.models.store import load_yaw_models
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run


def hidden(motion: str, names: Sequence[str]) -> list[Run]:
    """Runs of the hidden campaign whose names begin so."""
    loaded = load_runs([SAMPLE_RUNS / f"hidden_{motion}"], dof=DOFS[motion])
    assert loaded.set_aside == ()
    return [run for run in loaded.runs if run.name.startswith(tuple(names))]


def base_of(motion: str) -> YawModel:
    """The vehicle of the campaign without what is hidden."""
    specification = read_specification(SAMPLE_RUNS / f"{motion}.toml")
    return specification.model()


def found_in(motion: str, names: Sequence[str]) -> Diagnosis:
    return diagnose_runs(hidden(motion, names), base_of(motion), hold_out=[])


@pytest.mark.slow
def test_the_lag_hidden_in_surge_is_found() -> None:
    found = found_in("surge", ("X_+12", "X_+30", "X_-30", "reversal_+20", "reversal_-20"))
    assert found.verdict == "named" and [one.name for one in found.effects] == ["thruster-lag"]
    lag = found.effects[0].parameters["T"]
    assert lag.ci95[0] <= 0.4 <= lag.ci95[1] and lag.stderr < 0.03
    sentence = verdict_sentence(found)
    assert "noise of the distance" in sentence and " cm" in sentence and "deg" not in sentence


@pytest.mark.slow
def test_the_tether_hidden_in_heave_is_found() -> None:
    found = found_in("heave", ("Z_+7.0_a", "Z_+12.0_a", "Z_+30.0_a", "reversal_+15", "reversal_+28"))
    assert found.verdict == "named" and [one.name for one in found.effects] == ["tether-spring"]
    stiffness = found.effects[0].parameters["kappa"]
    assert stiffness.ci95[0] <= 1.2 <= stiffness.ci95[1] and stiffness.unit == "N/m"


@pytest.mark.parametrize("motion", ["yaw", "surge", "heave"])
def test_effects_are_looked_for_where_they_may_act(motion: str) -> None:
    dof = DOFS[motion]
    runs = [] if motion == "yaw" else hidden(motion, ("X_+8", "Z_+9"))
    model = YawModel.base("3", 1.0, [1.0, 0.0][: 1 + dof.has_constant], dof.units.forces[0], dof)
    tried = set(candidates(study_of(runs, model), model)) if runs else None
    turning = {"compass-deviation", "heading-moment", "cross-coupling", "current-deviation", "wall"}
    if motion == "heave":  # has one thruster
        turning |= {"thruster-dead-band", "thruster-imbalance", "thruster-limit"}
    for name in effects.names():
        assert (motion in effects.get(name).motions) == (motion == "yaw" or name not in turning) or (
            name == "linear-drag-asymmetry" and motion == "yaw"
        )
    if tried is not None:
        assert not tried & turning and {"thruster-lag", "drag-asymmetry", "linear-drag-asymmetry"} <= tried
        assert ("bias-moment" in tried) == (dof is SURGE)


@pytest.mark.parametrize(("dof", "letters"), [(SURGE, ("m_u", "X_uu", "X_u")), (HEAVE, ("m_w", "Z_ww", "Z_w"))])
def test_the_truth_validates_down_to_the_scatter_of_the_thrust(dof, letters, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    vehicle = read_specification(SAMPLE_RUNS / f"{dof.name}.toml").vehicle
    entry = {letters[0]: vehicle.inertia, letters[1]: vehicle.quadratic, "half_difference": vehicle.difference}
    entry |= {"constant_force": vehicle.constant_force} if dof is HEAVE else {}
    model = {
        "schema": f"automarine/{dof.name}-model/1", "motion": dof.name, "force_unit": "N", "models": {"3": entry},
        "preferred": "3",
    }  # fmt: skip
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model))
    assert load_yaw_models(path).dof is dof
    found = validate([SAMPLE_RUNS / f"{dof.name}_validation"], model=path)
    content = found.to_json()
    score = content["models"]["3"]
    assert content["motion"] == dof.name and 0.8 < content["noise_floor_cm"] < 1.2
    assert score["rmse_cm"] < 15 and score["restarted_rmse_cm"] < 7 and score["fit_percent"] > 90
    wrong = {**entry, letters[1]: 2 * vehicle.quadratic}
    path.write_text(json.dumps({**model, "models": {"3": wrong}}))
    worse = validate([SAMPLE_RUNS / f"{dof.name}_validation"], model=path).to_json()["models"]["3"]
    assert worse["rmse_cm"] > 3 * score["rmse_cm"]


def test_a_key_of_yaw_in_a_surge_model_is_refused_in_the_words_of_surge(tmp_path: Path) -> None:
    path = tmp_path / "surge_model.json"
    path.write_text(json.dumps({
        "schema": "automarine/surge-model/1", "motion": "surge", "force_unit": "N", "preferred": "3",
        "models": {"3": {"m_u": -1.0, "X_uu": 24.0}},
    }))  # fmt: skip
    with pytest.raises(Exception, match=r"surge_model.json: models.3.m_u: found -1, expected a mass above zero"):
        load_yaw_models(path)
