"""Parameters are addressed by name, in the letters of their motion; what people named themselves is left alone."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effect_contract import strange_to
from identified import identify
from repository import SAMPLE_RUNS

from automarine_cli.diagnosis.residual_regions import columns
from automarine_cli.diagnosis.study import study_of
from automarine_cli.dofs import DOFS, HEAVE, SURGE, YAW, Dof
from automarine_cli.errors import FitError, ModelError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.half_turns import step_data
from automarine_cli.fits.identify import YawFit, design_cautions, fit_warnings
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.store import file_and_models
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.report.diagnosis_report import general_advice
from automarine_cli.runs.half_turn import Trim
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

EVERY_MOTION = pytest.mark.parametrize("dof", DOFS.values(), ids=list(DOFS))
THEIRS = "heading turns to port/moment yaw.csv"
"""What somebody may call a run."""


def model_of(dof: Dof, number: str = "2") -> YawModel:
    """Both drags, what always acts where something does, and an effect."""
    values = [3.0, 0.5, *([-2.0] if dof.has_constant else [])]
    return YawModel.base(number, 2.0, values, dof.units.forces[0], dof)


@EVERY_MOTION
def test_parameters_have_qualified_names(dof: Dof) -> None:
    own, model = dof.symbols, model_of(dof).with_effect("sensor-lag", [0.2]).with_effect("cubic-drag", [0.1])
    base = [own.inertia, own.quadratic, own.linear, *([own.constant] if dof.has_constant else [])]
    qualified = [f"{dof.name}.{name}" for name in base]
    assert model.parameter_names == (*qualified, "sensor-lag.T_s", f"cubic-drag.{own.cubic}")
    assert model.short_names == (*base, "T_s", own.cubic)
    assert [model.theta[model.index(name)] for name in model.parameter_names] == list(model.theta)
    assert model.theta[model.index(dof.parameter("quadratic"))] == 3.0
    with pytest.raises(ModelError, match=rf"no parameter 'k'; it has {dof.name}\.{own.inertia}, "):
        model.index("k")


def test_names_that_two_effects_have_are_told_apart() -> None:
    model = YawModel.base("3", 1.0, [1.2], "nu", YAW).with_effect("linear-drag", [0.1])
    model = model.with_effect("bias-moment", [0.05]).with_effect("thrust-loss", [0.05])
    assert model.parameter_names[2:] == ("linear-drag.k_r", "bias-moment.b", "thrust-loss.b", "thrust-loss.law")
    assert model.short_names == ("I_r", "k_rr", "k_r", "b", "thrust-loss.b", "law")
    sided = YawModel.base("3", 1.0, [1.2, 0.3], "N", SURGE).with_effect("bias-moment", [0.05])
    assert sided.parameter_names == ("surge.m_u", "surge.X_uu", "surge.half_difference", "bias-moment.b")


def test_drag_of_a_model_is_what_its_effects_say_it_is() -> None:
    both = YawModel.base("3", 1.0, [1.2], "nu", YAW).with_effect("linear-drag", [0.1])
    assert both.drag() == (0.1, 1.2)
    heave = YawModel.base("3", 20.0, [45.0, -2.0, 6.0], "N", HEAVE)
    forces = np.array([-8.0, 8.0])
    moment, linear, quadratic = heave.acting(forces)
    assert np.array_equal(moment, forces - 2.0) and np.array_equal(quadratic, [39.0, 51.0])
    assert np.array_equal(linear, [0.0, 0.0])
    surge = YawModel.base("1", 20.0, [5.0, 1.0], "N", SURGE)
    assert np.array_equal(surge.acting(forces)[1], [4.0, 6.0])


def content_of(dof: Dof, entry: Mapping[str, float]) -> dict[str, Any]:
    """A file with model 3 of these parameters."""
    schema, unit = f"automarine/{dof.name}-model/1", f"{dof.words.force}_unit"
    return {"schema": schema, unit: "nu", "models": {"3": entry}, "preferred": "3"}


def model_3(dof: Dof) -> dict[str, float]:
    own = dof.symbols
    return {own.inertia: 2.0, own.quadratic: 3.0, **({own.constant: -1.0} if dof.has_constant else {})}


@EVERY_MOTION
@pytest.mark.parametrize("other", DOFS.values(), ids=list(DOFS))
def test_a_key_of_another_motion_is_unknown_and_answered_with_the_own_one(dof: Dof, other: Dof) -> None:
    if other is dof:
        return
    entry, inertia = model_3(dof), dof.symbols.inertia
    content = content_of(dof, entry)
    assert file_and_models(content, "m.json")[1].dof is dof
    theirs = {other.symbols.inertia if key == inertia else key: value for key, value in entry.items()}
    answer = rf'^m\.json: models\.3: unknown key "{other.symbols.inertia}"; did you mean "{inertia}"\?$'
    with pytest.raises(ModelError, match=answer):
        file_and_models(content_of(dof, theirs), "m.json")
    if other.words.force != dof.words.force:
        unit, foreign = f"{dof.words.force}_unit", f"{other.words.force}_unit"
        del content[unit]
        with pytest.raises(ModelError, match=rf'^m\.json: unknown key "{foreign}"; did you mean "{unit}"\?$'):
            file_and_models(content | {foreign: "nu"}, "m.json")


@EVERY_MOTION
def test_refusals_speak_of_their_motion(dof: Dof) -> None:
    """Of a model file, and of the paper's method; what drives or has no mass is told so."""
    own, good = dof.symbols, model_3(dof)
    for entry in ({**good, own.inertia: -1.0}, {**good, own.quadratic: -1.0}, {**good, own.linear: 1.0}, {}):
        with pytest.raises(ModelError) as refusal:
            file_and_models(content_of(dof, entry), THEIRS)
        rest = str(refusal.value).removeprefix(THEIRS)
        assert rest != str(refusal.value) and not strange_to(dof, rest.replace("fit-", " ")), rest
    time, moments = np.linspace(0.0, 4.0, 60), [0.5, -0.5, 1.0, -1.0]
    ahead = [np.sign(m) * (0.3 + np.sqrt(abs(m) / 1.257) * time) for m in moments]
    for few in (1, 4):
        data = step_data([str(m) for m in moments[:few]], [time] * few, ahead[:few], moments[:few], [0.1] * few, dof)
        with pytest.raises(FitError) as refused:
            fit_velocity_error(data, np.zeros(few))
        assert not strange_to(dof, str(refused.value).replace("runs ahead of", "")), refused.value


@pytest.fixture(scope="module")
def surge() -> YawFit:
    runs = load_runs([SAMPLE_RUNS / "surge"], dof=SURGE).runs
    return identify([replace(run, name=f"{THEIRS} {i}") for i, run in enumerate(runs)], trim=Trim(3.0))


def test_warnings_leave_the_names_of_runs_alone(surge: YawFit) -> None:
    fit, names = surge.output_error["3"], [turn.name for turn in surge.turns]
    left = fit.mixed.left_out.copy()
    left[3, 0] += 5.0

    def warnings(changed: OutputErrorFit, **noise: float) -> list[str]:
        return fit_warnings({**surge.output_error, "3": changed}, replace(surge.preference, number="3"), names, **noise)

    wild = replace(fit, gain_scatter=Estimate(0.5, 0.1, (0.3, 0.7), "1"))
    decided = replace(fit, mixed=replace(fit.mixed, left_out=left))
    far = replace(fit, inertial_turn_angle=Estimate(50.0, 1.0, (48.0, 52.0), "m"))
    loud = replace(fit, mixed=replace(fit.mixed, noises=10.0 * fit.mixed.noises))
    for changed in (wild, decided, far, loud):
        sentences = warnings(changed, position_noise=1e-3)
        assert sentences and not any(strange_to(SURGE, one.replace(THEIRS, "")) for one in sentences), sentences
    assert any(f"{THEIRS} " in each and each.endswith("check its force and its unit.") for each in warnings(wild))
    first = warnings(decided)[0]
    assert first.startswith(f"{THEIRS} 3 alone changes m_u of model 3 from ")
    assert first.endswith("whether its distance jumps.")
    text = json.dumps(surge.to_json()).replace(json.dumps(THEIRS)[1:-1], "")
    assert not {"moment", "heading", "k_rr", "I_r", "yaw", "deg", "rad"} & set(text.replace('"', " ").split())


@EVERY_MOTION
def test_cautions_and_advice_speak_of_the_motion(dof: Dof) -> None:
    designs = [[0.5, 0.5], [0.5, -0.5], [0.2, -1.0], [-0.2, -0.5, -1.0]]
    cautions = [one.sentence for levels in designs for one in design_cautions(levels, "nu", dof)]
    time = np.arange(0.0, 20.0, 0.1)
    runs = [
        Run(f"run {i}", "made", 50.0 * i + time, 0.1 * time, np.where(time > 2.0, size, 0.0), "nu", {}, dof=dof)
        for i, size in enumerate((0.2, 0.5, 1.0))
    ]
    advice = general_advice(study_of(runs, model_of(dof)))
    assert len(cautions) > 2 and len(advice) >= 4
    assert any("other headings" in sentence for sentence in advice) == dof.wraps
    for sentence in (*cautions, *advice):
        assert "{" not in sentence and not strange_to(dof, sentence.replace("in one direction", "")), sentence


def test_columns_that_people_named_stay_and_ours_are_the_motions() -> None:
    loaded = load_runs([SAMPLE_RUNS / "hidden_surge"], dof=SURGE).runs[:4]
    own = ("port", "turns", "heading_deg", "moment_size", "yaw")
    runs = [
        replace(run, extras={**run.extras, **{name: np.linspace(0.0, 1.0 + i, len(run)) for i, name in enumerate(own)}})
        for run in loaded
    ]  # fmt: skip
    study = study_of(runs, YawModel.base("3", 17.0, [24.0], "N", SURGE))
    found = [column.name for column in columns(study, study.batch.position)]
    assert set(own) <= set(found)
    ours = [name for name in found if name not in own]
    assert {"distance", "force", "force-size", "surge-speed", "distance-covered", "start-distance"} <= set(ours)
    for name in ours:
        assert not strange_to(SURGE, name.replace("-", " ")), name
