"""`automarine export`: each file is read back without the library and moves as our own model does."""

import json
import re
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from effect_contract import unmeasured
from export_readers import MESH_TORQUE, READERS, fall_time, gz_sim, rise_time, rk4

import automarine_cli as am
from automarine_cli import exports as targets
from automarine_cli.commands.export import export
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError, OutputError, SettingError
from automarine_cli.exports.base import YAW_MODEL
from automarine_cli.exports.export import Exported
from automarine_cli.models.yaw_model import YawModel, steady_rate
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

I_R, K_R, K_RR = 1.52, 0.31, 1.87  # N m s², N m s, N m s²
SIMULATORS = sorted(READERS)
DRAGS = {"1": {"k_r": K_R}, "2": {"k_rr": K_RR, "k_r": K_R}, "3": {"k_rr": K_RR}}


def model_file(
    folder: Path, effects: Mapping[str, Mapping[str, float]] | None = None, *, unit: str = "N m", **change: float
) -> Path:
    """A yaw_model.json with all three models, model 2 preferred."""
    added = [{"name": name, "parameters": dict(values)} for name, values in (effects or {}).items()]
    models = {number: {**drags, "I_r": I_R} for number, drags in DRAGS.items()}
    models["2"] |= change
    content = {"schema": "automarine/yaw-model/1", "moment_unit": unit, "models": models, "preferred": "2"}
    path = folder / "yaw_model.json"
    path.write_text(json.dumps(content | {"effects": added}))
    return path


def exported(path: Path, target: str, form: str, **settings: Any) -> Exported:
    """The export with what the target needs to carry drag."""
    if target == "stonefish":
        settings = {"mesh_torque": MESH_TORQUE, **settings}
    return export(path, to=target, form=form, **settings)


@cache
def ours(moment: float, rate0: float, seconds: float, number: str = "2") -> tuple[Any, Any]:
    """Times and rates of our own simulation."""
    model = YawModel.base(number, I_R, list(DRAGS[number].values()), "N m", YAW)
    run = unmeasured([(moment, seconds)], 0, "N m")
    run = type(run)(run.name, run.source, run.time, run.position, np.full(len(run), moment), "N m", dof=YAW)
    found = simulate(model, make_batch([run], 0.02), start=Start(velocity=rate0))
    return run.time - run.time[0], found.velocity[0, 0]


def test_every_form_of_every_simulator_has_a_reader() -> None:
    found = {
        (name, form)
        for name in targets.names()
        if targets.get(name).takes == YAW_MODEL and name not in ("python", "card")
        for form in targets.get(name).forms
    }
    assert found == set(READERS)


@pytest.mark.parametrize("number", ["1", "2", "3"])
@pytest.mark.parametrize(("target", "form"), SIMULATORS)
def test_time_constants_are_ours_and_spin_downs_lose_energy(
    tmp_path: Path, target: str, form: str, number: str
) -> None:
    slope = READERS[target, form](exported(model_file(tmp_path), target, form, number=number).text)
    for sign in (1.0, -1.0):
        time, rate = rk4(slope, sign * 1.5, 0.0, 40.0)
        assert rise_time(time, rate) == pytest.approx(rise_time(*ours(sign * 1.5, 0.0, 40.0, number)), rel=0.01)
        k_r, k_rr = (DRAGS[number].get(name, 0.0) for name in ("k_r", "k_rr"))
        assert rate[-1] == pytest.approx(float(steady_rate(sign * 1.5, k_r, k_rr)), rel=1e-3)
        time, rate = rk4(slope, 0.0, sign * 1.2, 20.0)
        assert fall_time(time, rate) == pytest.approx(fall_time(*ours(0.0, sign * 1.2, 20.0, number)), rel=0.01)
        assert np.all(np.diff(rate**2) < 0)  # the energy of rotation, at every step


@pytest.mark.parametrize(("target", "form"), SIMULATORS)
def test_a_given_rigid_inertia_splits_the_total_and_moves_alike(tmp_path: Path, target: str, form: str) -> None:
    path = model_file(tmp_path)
    if target == "stonefish":
        with pytest.raises(SettingError, match="--rigid-inertia means nothing to stonefish; it is for"):
            exported(path, target, form, rigid_inertia=1.0)
        return
    whole, split = (exported(path, target, form, rigid_inertia=rigid) for rigid in (None, 1.0))
    assert "stands in one place" in whole.text and "1 rigid (given) + 0.52 added" in split.text
    slopes = [READERS[target, form](one.text) for one in (whole, split)]
    for rate, moment in ((0.7, 0.0), (-0.7, 1.3)):
        assert slopes[0](rate, moment) == pytest.approx(slopes[1](rate, moment), rel=1e-7)


def test_gazebos_added_inertia_is_in_one_place_only(tmp_path: Path) -> None:
    path = model_file(tmp_path)
    fluid = export(path, to="gz-sim", rigid_inertia=1.0).text
    derivative = export(path, to="gz-sim", form="added-mass-derivative", rigid_inertia=1.0).text
    whole = export(path, to="gz-sim").text
    assert "<rr>0.52</rr>" in fluid and "<disable_added_mass>true<" in fluid and "<nDotR>" not in fluid
    assert "<nDotR>-0.52</nDotR>" in derivative and "<disable_added_mass>false<" in derivative
    assert "<fluid_added_mass>" not in derivative
    assert "<izz>1.52</izz>" in whole and "<nDotR>" not in whole and "<fluid_added_mass>" not in whole
    with pytest.raises(SettingError, match=r"grows without bound where the added inertia \(1.02\) is not below"):
        export(path, to="gz-sim", form="added-mass-derivative", rigid_inertia=0.5)


def test_gazebos_explicit_added_inertia_is_stable_just_where_we_let_it_be(tmp_path: Path) -> None:
    """The system takes the acceleration of the step before: r' = (tau + nDotR r'_before) / izz."""
    text = export(model_file(tmp_path), to="gz-sim", form="added-mass-derivative", rigid_inertia=0.8).text
    (izz, added), dt = (float(re.findall(rf"<{tag}>-?([\d.]+)", text)[0]) for tag in ("izz", "nDotR")), 1e-3
    for factor, settles in ((1.0, True), (1.2, False)):
        rate, before = [0.0], 0.0
        for _ in range(2000):
            before = (1.0 - factor * added * before) / izz
            rate.append(rate[-1] + dt * before)
        assert (abs(before - 1.0 / (izz + factor * added)) < 1e-3) is settles


# Frames


def test_odd_drag_is_the_same_in_both_frames_and_asymmetry_changes_sign(tmp_path: Path) -> None:
    path = model_file(tmp_path, {"drag-asymmetry": {"e": 0.2}})
    slopes = {f: gz_sim(export(path, to="gz-sim", frame=f).text) for f in ("ENU", "NED")}
    for rate, moment in ((0.8, 1.0), (-0.8, 1.0), (0.5, -0.3)):
        assert slopes["ENU"](rate, moment) == pytest.approx(-slopes["NED"](-rate, -moment), rel=1e-7)
    assert slopes["ENU"](0.8, 0.0) != pytest.approx(slopes["NED"](0.8, 0.0), rel=1e-3)
    plain = model_file(tmp_path)
    texts = [export(plain, to="gz-sim", frame=f).text for f in ("enu", "ned")]
    assert [line for line in texts[0].splitlines() if "Frame:" not in line] == [
        line for line in texts[1].splitlines() if "Frame:" not in line
    ]


@pytest.mark.parametrize("target", ["gz-sim", "uuv", "labust", "mjcf", "mss", "stonefish", "python", "card"])
def test_every_file_is_stamped_with_its_frame_its_origin_and_its_unit(tmp_path: Path, target: str) -> None:
    path, own = model_file(tmp_path), targets.get(target)
    for frame in own.frames:
        for form in own.forms:
            text = exported(path, target, form, frame=frame).text
            assert f"Frame: {frame} world" in text.replace("\n", " ")
            other = {"NED": "ENU", "ENU": "NED"}[frame]
            assert f"Frame: {other}" not in text and "yaw_model.json" in text and "N m" in text
    missing = sorted({"NED", "ENU"} - set(own.frames))
    for frame in missing:
        with pytest.raises(SettingError, match=f"--frame of {target}: found {frame}, expected {own.frames[0]}"):
            export(path, to=target, frame=frame)


# What cannot be


def test_an_effect_without_a_term_is_refused_and_left_out_where_that_is_allowed(tmp_path: Path) -> None:
    path = model_file(tmp_path, {"bias-moment": {"b": 0.1}, "thruster-lag": {"T": 0.3}})
    with pytest.raises(SettingError) as problem:
        export(path, to="gz-sim")
    assert str(problem.value) == (
        "yaw_model.json: gz-sim cannot represent bias-moment (the target's equation has no such term); thruster-lag "
        "(it acts in the thrusters; --to thrusters has --lag for it); give --allow-partial to write the file without, "
        "or take --to python, which has them"
    )
    partly = export(path, to="gz-sim", allow_partial=True)
    assert [one.name for one in partly.left_out] == ["bias-moment", "thruster-lag"]
    assert "Left out: bias-moment: the target's equation has no such term." in partly.text
    assert gz_sim(partly.text)(0.5, 1.0) == gz_sim(export(model_file(tmp_path), to="gz-sim").text)(0.5, 1.0)


def test_an_effect_that_is_switched_off_is_nobodys_loss(tmp_path: Path) -> None:
    found = export(model_file(tmp_path, {"bias-moment": {"b": 0.0}}), to="gz-sim")
    assert found.left_out == () and found.carried == ("inertia", "quadratic-drag", "linear-drag")


def test_drag_found_twice_is_summed(tmp_path: Path) -> None:
    path = model_file(tmp_path, {"linear-drag": {"k_r": 0.2}})
    assert "<nR>-0.51</nR>" in export(path, to="gz-sim").text


def test_mss_has_terms_for_more(tmp_path: Path) -> None:
    more = {"cubic-drag": {"k_rrr": 0.4}, "bias-moment": {"b": -0.06}, "drag-asymmetry": {"e": 0.2}}
    slope = READERS["mss", "matlab"](export(model_file(tmp_path, more), to="mss", form="matlab").text)
    r, tau = -0.6, 0.4
    expected = tau - K_R * r - K_RR * abs(r) * r - 0.4 * r**3 - 0.06 - 0.2 * r**2
    assert slope(r, tau) == pytest.approx(expected / I_R, rel=1e-7)


def test_normalised_moments_need_their_size_where_the_target_is_in_si(tmp_path: Path) -> None:
    path = model_file(tmp_path, unit="nu")
    with pytest.raises(SettingError) as problem:
        export(path, to="labust")
    assert str(problem.value) == (
        "yaw_model.json: its moments are normalised (nu) and labust needs newton metres; give --newton-metres-per-nu "
        "with the moment [N m] that one nu stands for, as a bollard test and the thrusters' arm tell it"
    )
    scaled = READERS["labust", "model"](export(path, to="labust", newton_metres_per_nu=2.5).text)
    plain = READERS["mss", "python"](export(path, to="mss").text)
    assert scaled(0.4, 2.5 * 0.7) == pytest.approx(plain(0.4, 0.7), rel=1e-7)
    assert "moment nu, rate rad/s, inertia nu s^2" in export(path, to="mss").text
    with pytest.raises(SettingError, match="is in newton metres already"):
        export(model_file(tmp_path), to="labust", newton_metres_per_nu=2.5)


REFUSALS: list[tuple[dict[str, Any], str]] = [
    ({"to": "gazebo"}, "--to gazebo: no such target; known are card, gz-sim, labust, mjcf, mss, python, stonefish, "
                       "thrusters, uuv"),
    ({"to": "gz"}, "--to gz: no such target; known are card, gz-sim, labust, mjcf, mss, python, stonefish, thrusters, "
                   "uuv. Did you mean gz-sim?"),
    ({"to": "uuv", "form": "sdf"}, "--form of uuv: found sdf, expected urdf or controller"),
    ({"to": "uuv", "number": "4"}, "--number: found 4, expected 1 or 2 or 3"),
    ({"to": "uuv", "symmetrise": True}, "--symmetrise means nothing to uuv; it is for thrusters, so leave it out"),
    ({"to": "thrusters"}, "yaw_model.json is a yaw model; --to thrusters takes the thrusters.json of a fit"),
    ({"to": "uuv", "rigid_inertia": 1.6}, "--rigid-inertia: found 1.6, expected more than 0 and no more than 1.52 N m "
                                          "s², the total of rigid and added inertia in yaw_model.json; check unit "
                                          "and axis"),
    ({"to": "stonefish"}, "yaw_model.json: stonefish cannot represent quadratic-drag (its coefficient counts against "
                          "the drag of your mesh); linear-drag (its coefficient counts against the drag of your mesh); "
                          "give --mesh-torque for the drag of the mesh, or --allow-partial to write the file without, "
                          "or take --to python, which has them"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "sentence"), REFUSALS)
def test_refusals_say_what_was_found_and_what_to_do(tmp_path: Path, settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SettingError) as problem:
        export(model_file(tmp_path), **settings)
    assert str(problem.value) == sentence


@pytest.mark.parametrize("target", ["gz-sim", "uuv", "labust", "mjcf", "stonefish"])
def test_drag_that_would_drive_the_vehicle_is_refused_by_simulators(tmp_path: Path, target: str) -> None:
    path = model_file(tmp_path, k_r=-0.02)
    with pytest.raises(SettingError) as problem:
        exported(path, target, next(iter(targets.get(target).forms)))
    assert str(problem.value) == (
        f"yaw_model.json, model 2: k_r = -0.02 N m s would drive the vehicle at small rates, and {target} would not "
        "come to rest; take a model without it with --number 1 or 3"
    )
    assert "N_r = 0.02" in export(path, to="mss").text


def test_stonefish_warns_of_what_it_cannot_set(tmp_path: Path) -> None:
    drag = export(model_file(tmp_path), to="stonefish", mesh_torque=MESH_TORQUE)
    bare = export(model_file(tmp_path), to="stonefish", allow_partial=True)
    assert any("scale the drag in heave as well" in note for note in drag.written.notes)
    assert any("added inertia cannot be set" in note for note in bare.written.notes)
    assert "no drag is set; it needs" in bare.text and "<hydrodynamics" not in bare.text


# Files


@pytest.mark.parametrize("target", sorted(set(targets.names()) - {"thrusters"}))
def test_files_are_the_same_bytes_wherever_they_are_made(tmp_path: Path, target: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    shutil.copy(model_file(tmp_path), tmp_path / "elsewhere" / "yaw_model.json")
    for form, ending in targets.get(target).forms.items():
        files = []
        for folder in (tmp_path, tmp_path / "elsewhere"):
            out = folder / f"made_{form}{ending}"
            exported(folder / "yaw_model.json", target, form, out=out)
            files.append(out.read_bytes())
        assert files[0] == files[1] and str(tmp_path).encode() not in files[0]
        assert not re.search(rb"20\d\d-\d\d-\d\d|\d\d:\d\d:\d\d", files[0])
        if target != "card":
            files[0].decode("ascii")


def test_the_ending_of_the_file_chooses_the_form(tmp_path: Path) -> None:
    path = model_file(tmp_path)
    assert export(path, to="uuv", out=tmp_path / "a.yaml").form == "controller"
    assert export(path, to="mss", out=tmp_path / "a.m").form == "matlab"
    assert export(path, to="mss", out=tmp_path / "a.txt").form == "python"


def test_a_file_that_is_there_stays_until_it_may_go(tmp_path: Path) -> None:
    path, out = model_file(tmp_path), tmp_path / "made" / "vehicle.sdf"
    export(path, to="gz-sim", out=out)
    before = out.read_bytes()
    with pytest.raises(OutputError, match=r"vehicle\.sdf is there already; give --overwrite"):
        export(path, to="gz-sim", number="3", out=out)
    assert out.read_bytes() == before
    export(path, to="gz-sim", number="3", out=out, overwrite=True)
    assert out.read_bytes() != before and [p.name for p in out.parent.iterdir()] == ["vehicle.sdf"]
    with pytest.raises(OutputError, match="is a folder; give the name of a file"):
        export(path, to="gz-sim", out=out.parent)


def test_names_of_files_cannot_leave_their_comment(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    plain = model_file(tmp_path / "plain")
    strange = model_file(tmp_path).rename(tmp_path / 'a--->--> """\n x é.json')
    for target in ("gz-sim", "uuv", "stonefish", "python", "mjcf", "mss", "labust"):
        for form in targets.get(target).forms:
            text = exported(strange, target, form).text
            if target == "python":
                compile(text, "made.py", "exec")
            else:
                expected = READERS[target, form](exported(plain, target, form).text)
                assert READERS[target, form](text)(0.4, 0.7) == expected(0.4, 0.7) != 0.0


def test_a_model_that_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "broken.json"
    path.write_text('{"schema": "something"}')
    for target in targets.names():
        with pytest.raises(AutomarineError, match=r'broken\.json: schema: found "something", expected'):
            export(path, to=target)


# Command and Python


def test_the_command_writes_prints_and_lists(tmp_path: Path, run: Callable[..., Result]) -> None:
    path, out = model_file(tmp_path), tmp_path / "vehicle.sdf"
    printed = run("export", path, "--to", "gz-sim")
    assert printed.exit_code == 0 and printed.stdout == export(path, to="gz-sim").text
    written = run("export", path, "--to", "gz-sim", "-o", out)
    assert written.exit_code == 0 and f"Written: {out}" in written.stdout.replace("\n", "")
    assert out.read_text() == printed.stdout
    told = json.loads(run("export", path, "--to", "gz-sim", "--json").stdout)
    assert told["schema"] == "automarine/export/1" and told["text"] == printed.stdout
    assert told["carried"] == ["inertia", "quadratic-drag", "linear-drag"] and told["left_out"] == []
    bare = run("export", path, "--to", "stonefish", "--allow-partial")
    assert "Left out: quadratic-drag" in bare.stderr and "no drag is set" in bare.stderr
    assert run("export", path, "--to", "stonefish", "--allow-partial", "-q").stderr == ""
    listed = run("export", "--list").stdout
    assert all(name in listed for name in targets.names())
    data = json.loads(run("export", "--list", "--json").stdout)
    assert {one["name"] for one in data["targets"]} == set(targets.names())
    assert all(one["source"] for one in data["targets"])
    assert run("export", path).exit_code == 2
    refused = run("export", path, "--to", "labust", "--symmetrise")
    assert refused.exit_code == 1 and refused.stderr.startswith("Error: --symmetrise means nothing to labust")


def test_python_takes_places_and_results(tmp_path: Path) -> None:
    path = model_file(tmp_path)
    assert am.export(str(path), to="mss").to_json() == export(path, to="mss").to_json()
    out = tmp_path / "vehicle.sdf"
    am.export(path, to="gz-sim", out=str(out))
    assert out.read_text() == export(path, to="gz-sim").text


MJCF_LACKS = {
    "thruster-lag": ({"T": 0.2, "law": 0.0}, "MuJoCo's filterexact is first order in the thrust"),
    "coulomb-drag": (
        {"c": 0.1, "law": 1.0, "c_s": 0.1, "v_s": 0.2},
        "MuJoCo's frictionloss is the same at every speed",
    ),
    "saturation": ({"tau_max": 1.0, "law": 1.0}, "MuJoCo's ctrlrange is a hard limit"),
    "tether-spring": ({"kappa": 0.1, "law": 1.0, "slack": 1.0}, "the spring of a MuJoCo joint has no slack"),
    "input-delay": ({"t_d": 0.2, "law": 1.0, "t_off": 0.1}, "MuJoCo's delay is the same for rise and fall"),
    "dead-band": ({"width": 0.1}, "it acts in the thrusters, before the moment"),
}


@pytest.mark.parametrize("name", MJCF_LACKS)
def test_what_mujoco_has_no_counterpart_for_is_refused_or_listed(tmp_path: Path, name: str) -> None:
    values, why = MJCF_LACKS[name]
    path = model_file(tmp_path, {name: values})
    with pytest.raises(SettingError, match=re.escape(why)):
        export(path, to="mjcf")
    found = export(path, to="mjcf", allow_partial=True)
    assert [one.name for one in found.left_out] == [name] and f"Left out: {name}: " in found.text
