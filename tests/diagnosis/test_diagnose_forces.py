"""What is hidden in the surge and heave campaigns of sample_runs is found, with the size that it has."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from repository import SAMPLE_RUNS
from specified import read_specification

from automarine_cli import effects
from automarine_cli.commands.validate import validate
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.diagnosis.scores import candidates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import DOFS, HEAVE, SURGE, Dof
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run


def hidden(motion: str, names: Sequence[str]) -> list[Run]:
    """Runs of the hidden campaign whose names begin so."""
    loaded = load_runs([SAMPLE_RUNS / f"hidden_{motion}"], dof=DOFS[motion])
    assert loaded.set_aside == ()
    return [run for run in loaded.runs if run.name.startswith(tuple(names))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "runs", "effect", "parameter", "truth"),
    [
        ("surge", ("X_+12", "X_+30", "X_-30", "reversal_+20", "reversal_-20"), "thruster-lag", "T", 0.4),
        (
            "heave", ("Z_+7.0_a", "Z_+12.0_a", "Z_+30.0_a", "reversal_+15", "reversal_+28"),
            "tether-spring", "kappa", 1.2,
        ),
    ],
)  # fmt: skip
def test_what_is_hidden_is_found(motion: str, runs: Sequence[str], effect: str, parameter: str, truth: float) -> None:
    base = read_specification(SAMPLE_RUNS / f"{motion}.toml").model()
    found = diagnose_runs(hidden(motion, runs), base, hold_out=[])
    assert found.verdict == "named" and [named.name for named in found.effects] == [effect]
    size = found.effects[0].parameters[parameter]
    assert size.ci95[0] <= truth <= size.ci95[1]
    if motion == "surge":
        sentence = verdict_sentence(found)
        assert size.stderr < 0.03 and " cm" in sentence and "deg" not in sentence
    else:
        assert size.unit == "N/m"


@pytest.mark.parametrize("motion", ["yaw", "surge", "heave"])
def test_effects_are_looked_for_where_they_may_act(motion: str) -> None:
    dof = DOFS[motion]
    turning = {"compass-deviation", "heading-moment", "cross-coupling", "current-deviation", "wall"}
    if motion == "heave":  # has one thruster
        turning |= {"thruster-dead-band", "thruster-imbalance", "thruster-limit"}
    elsewhere = {"linear-drag-asymmetry"} if motion == "yaw" else turning
    assert {name for name in effects.names() if motion not in effects.get(name).motions} == elsewhere
    if motion == "yaw":
        return
    model = YawModel.base("3", 1.0, [1.0, 0.0][: 1 + dof.has_constant], dof.units.forces[0], dof)
    tried = set(candidates(study_of(hidden(motion, ("X_+8", "Z_+9")), model), model))
    assert not tried & turning and {"thruster-lag", "drag-asymmetry", "linear-drag-asymmetry"} <= tried
    assert ("bias-moment" in tried) == (dof is SURGE)


@pytest.mark.parametrize(("dof", "letters"), [(SURGE, ("m_u", "X_uu")), (HEAVE, ("m_w", "Z_ww"))])
def test_the_truth_validates_down_to_the_scatter_of_the_thrust(
    dof: Dof, letters: tuple[str, str], tmp_path: Path
) -> None:
    vehicle = read_specification(SAMPLE_RUNS / f"{dof.name}.toml").vehicle
    entry = {letters[0]: vehicle.inertia, letters[1]: vehicle.quadratic, "half_difference": vehicle.difference}
    entry |= {"constant_force": vehicle.constant_force} if dof is HEAVE else {}
    kind = {"schema": f"automarine/{dof.name}-model/1", "motion": dof.name, "force_unit": "N", "preferred": "3"}
    contents = []
    for factor in (1, 2):
        path = tmp_path / "model.json"
        path.write_text(json.dumps(kind | {"models": {"3": entry | {letters[1]: factor * vehicle.quadratic}}}))
        contents.append(validate([SAMPLE_RUNS / f"{dof.name}_validation"], model=path).to_json())
    score, worse = (content["models"]["3"] for content in contents)
    assert contents[0]["motion"] == dof.name and 0.8 < contents[0]["noise_floor_cm"] < 1.2
    assert score["rmse_cm"] < 15 and score["restarted_rmse_cm"] < 7 and score["fit_percent"] > 90
    assert worse["rmse_cm"] > 3 * score["rmse_cm"]
