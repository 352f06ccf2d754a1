"""Parameters are addressed by name, in the letters of their motion; what people named themselves is left alone."""

import json
from dataclasses import replace
from pathlib import Path

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
from automarine_cli.fits.identify import EARLY, LATE, YawFit, design_cautions, fit_warnings
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.whole_runs import prefer
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
    assert model.parameter_names == (
        *(f"{dof.name}.{name}" for name in base), "sensor-lag.T_s", f"cubic-drag.{own.cubic}",
    )  # fmt: skip
    assert model.short_names == (*base, "T_s", own.cubic)
    for name, value in zip(model.parameter_names, model.theta, strict=True):
        assert model.theta[model.index(name)] == value
    assert model.theta[model.index(dof.parameter("quadratic"))] == 3.0
    with pytest.raises(ModelError, match=rf"no parameter 'k'; it has {dof.name}\.{own.inertia}, "):
        model.index("k")


def test_names_that_two_effects_have_are_told_apart() -> None:
    model = YawModel.base("3", 1.0, [1.2], "nu", YAW).with_effect("linear-drag", [0.1])
    for name in ("bias-moment", "thrust-loss"):
        model = model.with_effect(name, [0.05])
    assert model.parameter_names[2:] == (
        "linear-drag.k_r", "bias-moment.b", "thrust-loss.b", "thrust-loss.law",
    )  # fmt: skip
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


@EVERY_MOTION
@pytest.mark.parametrize("other", DOFS.values(), ids=list(DOFS))
def test_a_key_of_another_motion_is_unknown_and_answered_with_the_own_one(dof: Dof, other: Dof) -> None:
    if other is dof:
        return
    own, theirs = dof.symbols, other.symbols
    entry = {own.inertia: 2.0, own.quadratic: 3.0, own.constant: -1.0} if dof.has_constant else {
        own.inertia: 2.0, own.quadratic: 3.0,
    }  # fmt: skip
    content = {
        "schema": f"automarine/{dof.name}-model/1", f"{dof.words.force}_unit": "nu", "models": {"3": entry},
        "preferred": "3",
    }  # fmt: skip
    assert file_and_models(content, "m.json")[1].dof is dof
    with pytest.raises(ModelError) as refusal:
        lacking = {key: value for key, value in entry.items() if key != own.inertia}
        file_and_models(content | {"models": {"3": {**lacking, theirs.inertia: 2.0}}}, "m.json")
    assert str(refusal.value) == (f'm.json: models.3: unknown key "{theirs.inertia}"; did you mean "{own.inertia}"?')
    if other.words.force != dof.words.force:
        with pytest.raises(ModelError) as refusal:
            unit = {f"{dof.words.force}_unit": None, f"{other.words.force}_unit": "nu"}
            told = {key: value for key, value in (content | unit).items() if value is not None}
            file_and_models(told, "m.json")
        assert str(refusal.value) == (
            f'm.json: unknown key "{other.words.force}_unit"; did you mean "{dof.words.force}_unit"?'
        )


@EVERY_MOTION
def test_refusals_of_a_model_file_speak_of_its_motion(dof: Dof) -> None:
    own = dof.symbols
    good = {own.inertia: 2.0, own.quadratic: 3.0, **({own.constant: -1.0} if dof.has_constant else {})}
    for entry in ({**good, own.inertia: -1.0}, {**good, own.quadratic: -1.0}, {**good, own.linear: 1.0}, {}):
        content = {
            "schema": f"automarine/{dof.name}-model/1", f"{dof.words.force}_unit": "nu", "models": {"3": entry},
            "preferred": "3",
        }  # fmt: skip
        with pytest.raises(ModelError) as refusal:
            file_and_models(content, THEIRS)
        rest = str(refusal.value).removeprefix(THEIRS)
        assert rest != str(refusal.value) and not strange_to(dof, rest.replace("fit-", " ")), rest


# Sentences


@pytest.fixture(scope="module")
def surge() -> YawFit:
    runs = load_runs([SAMPLE_RUNS / "surge"], dof=SURGE).runs
    return identify([replace(run, name=f"{THEIRS} {i}") for i, run in enumerate(runs)], trim=Trim(3.0))


def test_warnings_leave_the_names_of_runs_alone(surge: YawFit) -> None:
    fit = surge.output_error["3"]
    names = [turn.name for turn in surge.turns]
    wild = replace(fit, gain_scatter=Estimate(0.5, 0.1, (0.3, 0.7), "1"))
    left = fit.mixed.left_out.copy()
    left[3, 0] += 5.0
    decided = replace(fit, mixed=replace(fit.mixed, left_out=left))
    far = replace(fit, inertial_turn_angle=Estimate(50.0, 1.0, (48.0, 52.0), "m"))
    loud = replace(fit, mixed=replace(fit.mixed, noises=10.0 * fit.mixed.noises))
    for changed in (wild, decided, far, loud):
        fits = {**surge.output_error, "3": changed}
        found = fit_warnings(fits, replace(surge.preference, number="3"), names, position_noise=1e-3)
        assert found
        for sentence in found:
            assert not strange_to(SURGE, sentence.replace(THEIRS, "")), sentence
    told = fit_warnings({**surge.output_error, "3": wild}, replace(surge.preference, number="3"), names)
    assert any(f"{THEIRS} " in sentence and sentence.endswith("check its force and its unit.") for sentence in told)
    told = fit_warnings({**surge.output_error, "3": decided}, replace(surge.preference, number="3"), names)
    assert told[0].startswith(f"{THEIRS} 3 alone changes m_u of model 3 from ") and told[0].endswith(
        "whether its distance jumps."
    )


@EVERY_MOTION
def test_cautions_and_templates_speak_of_the_motion(dof: Dof) -> None:
    designs = [[0.5, 0.5], [0.5, -0.5], [0.2, -1.0], [-0.2, -0.5, -1.0]]
    said = [one.sentence for levels in designs for one in design_cautions(levels, "nu", dof, of_steps=True)]
    said += [dof.fill(text) for text in (EARLY, LATE)]
    assert len(said) > 6
    for sentence in said:
        assert "{" not in sentence and not strange_to(dof, sentence.replace("in one direction", "")), sentence


@EVERY_MOTION
def test_refusals_of_the_papers_method_speak_of_the_motion(dof: Dof) -> None:
    time = np.linspace(0.0, 4.0, 60)
    moments = [0.5, -0.5, 1.0, -1.0]
    ahead = [np.sign(m) * (0.3 + np.sqrt(abs(m) / 1.257) * time) for m in moments]
    for few in (1, 4):
        data = step_data([str(m) for m in moments[:few]], [time] * few, ahead[:few], moments[:few], [0.1] * few, dof)
        with pytest.raises(FitError) as refusal:
            fit_velocity_error(data, np.zeros(few))
        assert not strange_to(dof, str(refusal.value).replace("runs ahead of", "")), refusal.value


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


@EVERY_MOTION
def test_advice_speaks_of_the_motion(dof: Dof) -> None:
    time = np.arange(0.0, 20.0, 0.1)
    runs = [
        Run(f"run {i}", "made", 50.0 * i + time, 0.1 * time, np.where(time > 2.0, size, 0.0), "nu", {}, dof=dof)
        for i, size in enumerate((0.2, 0.5, 1.0))
    ]
    study = study_of(runs, model_of(dof))
    said = general_advice(study)
    assert len(said) >= 4
    for sentence in said:
        assert not strange_to(dof, sentence), sentence
    assert any("other headings" in sentence for sentence in said) == dof.wraps


def test_every_parameter_of_a_fit_is_named_by_the_record(surge: YawFit, tmp_path: Path) -> None:
    assert list(surge.preferred.estimates)[:2] == ["m_u", "X_uu"]
    text = json.dumps(surge.to_json()).replace(json.dumps(THEIRS)[1:-1], "")
    assert not {"moment", "heading", "k_rr", "I_r", "yaw", "deg", "rad"} & set(text.replace('"', " ").split())
    assert prefer(surge.output_error).number == surge.preference.number
