"""What is hidden in the heave campaign of sample_runs is found, with the size that it has."""

from collections.abc import Sequence

import pytest
from repository import SAMPLE_RUNS
from specified import read_specification

from automarine_cli import effects
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.diagnosis.scores import candidates
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import DOFS, SURGE
from automarine_cli.models.model import Model
from automarine_cli.report.diagnosis_report import verdict_sentence
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run


def hidden(motion: str, names: Sequence[str]) -> list[Run]:
    """Runs of the hidden campaign whose names begin so."""
    loaded = load_runs([SAMPLE_RUNS / f"hidden_{motion}"], dof=DOFS[motion])
    assert loaded.set_aside == ()
    return [run for run in loaded.runs if run.name.startswith(tuple(names))]


@pytest.mark.slow
def test_what_is_hidden_is_found() -> None:
    runs = hidden("heave", ("Z_+7.0_a", "Z_+12.0_a", "Z_+30.0_a", "reversal_+15", "reversal_+28"))
    found = diagnose_runs(runs, read_specification(SAMPLE_RUNS / "heave.toml").model(), hold_out=[])
    assert found.verdict == "named" and [named.name for named in found.effects] == ["tether-spring"]
    size, sentence = found.effects[0].parameters["kappa"], verdict_sentence(found)
    assert size.ci95[0] <= 1.2 <= size.ci95[1] and size.unit == "N/m"
    assert " cm" in sentence and "deg" not in sentence


@pytest.mark.parametrize("motion", ["yaw", "surge", "heave"])
def test_effects_are_looked_for_where_they_may_act(motion: str) -> None:
    dof = DOFS[motion]
    turning = {"compass-deviation", "heading-moment", "cross-coupling", "current-deviation", "wall", "rudder-inflow"}
    turning.add("restoring-moment")  # of roll and pitch
    if motion == "heave":  # has one thruster
        turning |= {"thruster-dead-band", "thruster-imbalance", "thruster-limit", "rudder-drag"}
    elif motion == "surge":
        turning |= {"rudder", "rudder-race", "rudder-offset", "rudder-rate", "rudder-stall"}
    elsewhere = {"linear-drag-asymmetry", "restoring-moment", "rudder-drag"} if motion == "yaw" else turning
    assert {name for name in effects.names() if motion not in effects.get(name).motions} == elsewhere
    if motion == "yaw":
        return
    model = Model.base("3", 1.0, [1.0, 0.0][: 1 + dof.has_constant], dof.units.forces[0], dof)
    tried = set(candidates(study_of(hidden(motion, ("X_+8", "Z_+9")), model), model))
    assert not tried & turning and {"thruster-lag", "drag-asymmetry", "linear-drag-asymmetry"} <= tried
    assert ("bias-moment" in tried) == (dof is SURGE)
