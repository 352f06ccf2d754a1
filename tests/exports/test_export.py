"""`automarine export`: each file is read back without the library and moves as our own model does."""

import json
import re
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from effect_contract import unmeasured
from export_readers import READERS, fall_time, gz_sim, moved, rise_time

import automarine_cli as am
from automarine_cli import exports as targets
from automarine_cli.commands.export import export
from automarine_cli.dofs import YAW
from automarine_cli.errors import OutputError, SettingError
from automarine_cli.models.model import Model, steady_rate
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


@cache
def ours(moment: float, rate0: float, seconds: float, number: str = "2") -> tuple[Any, Any]:
    """Times and rates of our own simulation."""
    model = Model.base(number, I_R, list(DRAGS[number].values()), "N m", YAW)
    run = unmeasured([(moment, seconds)], 0, "N m")
    run = type(run)(run.name, run.source, run.time, run.position, np.full(len(run), moment), "N m", dof=YAW)
    velocity = simulate(model, make_batch([run], 0.02), start=Start(velocity=rate0)).velocity[0, 0]
    return run.time - run.time[0], velocity


def test_every_form_of_every_simulator_has_a_reader() -> None:
    simulators = [targets.get(name) for name in targets.names() if name not in ("python", "card")]
    assert {(one.name, form) for one in simulators if one.motions for form in one.forms} == set(READERS)


@pytest.mark.parametrize("number", ["1", "2", "3"])
@pytest.mark.parametrize(("target", "form"), SIMULATORS)
def test_time_constants_are_ours_and_spinning_ends(tmp_path: Path, target: str, form: str, number: str) -> None:
    slope = READERS[target, form](export(model_file(tmp_path), to=target, form=form, number=number).text)
    k_r, k_rr = (DRAGS[number].get(name, 0.0) for name in ("k_r", "k_rr"))
    for sign in (1.0, -1.0):
        time, rate = moved(slope, sign * 1.5, 0.0, 40.0)
        assert rise_time(time, rate) == pytest.approx(rise_time(*ours(sign * 1.5, 0.0, 40.0, number)), rel=0.01)
        assert rate[-1] == pytest.approx(float(steady_rate(sign * 1.5, k_r, k_rr)), rel=1e-3)
        time, rate = moved(slope, 0.0, sign * 1.2, 20.0)
        assert fall_time(time, rate) == pytest.approx(fall_time(*ours(0.0, sign * 1.2, 20.0, number)), rel=0.01)
        assert np.all(np.diff(rate**2) < 0)  # the energy of rotation, at every step


@pytest.mark.parametrize(("target", "form"), SIMULATORS)
def test_a_given_rigid_inertia_splits_the_total_and_moves_alike(tmp_path: Path, target: str, form: str) -> None:
    path = model_file(tmp_path)
    whole, split = (export(path, to=target, form=form, rigid_inertia=rigid).text for rigid in (None, 1.0))
    assert "stands in one place" in whole and "1 rigid (given) + 0.52 added" in split
    for state in ((0.7, 0.0), (-0.7, 1.3)):
        assert READERS[target, form](split)(*state) == pytest.approx(READERS[target, form](whole)(*state), rel=1e-7)


def test_gazebos_explicit_added_inertia_is_stable_just_where_we_let_it_be(tmp_path: Path) -> None:
    """The system takes the acceleration of the step before: r' = (tau + nDotR r'_before) / izz."""
    path, dt = model_file(tmp_path), 1e-3
    text = export(path, to="gz-sim", form="added-mass-derivative", rigid_inertia=0.8).text
    izz, added = (float(re.findall(rf"<{tag}>-?([\d.]+)", text)[0]) for tag in ("izz", "nDotR"))
    for factor, settles in ((1.0, True), (1.2, False)):
        rate, before = [0.0], 0.0
        for _ in range(2000):
            before = (1.0 - factor * added * before) / izz
            rate.append(rate[-1] + dt * before)
        assert (abs(before - 1.0 / (izz + factor * added)) < 1e-3) is settles
    with pytest.raises(SettingError, match=r"grows without bound where the added inertia \(1.02\) is not below"):
        export(path, to="gz-sim", form="added-mass-derivative", rigid_inertia=0.5)


# Frames


def test_odd_drag_is_the_same_in_both_frames_and_asymmetry_changes_sign(tmp_path: Path) -> None:
    path = model_file(tmp_path, {"drag-asymmetry": {"e": 0.2}})
    enu, ned = (gz_sim(export(path, to="gz-sim", frame=frame).text) for frame in ("ENU", "NED"))
    for rate, moment in ((0.8, 1.0), (-0.8, 1.0), (0.5, -0.3)):
        assert enu(rate, moment) == pytest.approx(-ned(-rate, -moment), rel=1e-7)
    assert enu(0.8, 0.0) != pytest.approx(ned(0.8, 0.0), rel=1e-3)


@pytest.mark.parametrize("name", ["gz-sim", "uuv", "mjcf", "mss", "python", "card"])
def test_every_file_is_stamped_with_its_frame_its_origin_and_its_unit(tmp_path: Path, name: str) -> None:
    path, target = model_file(tmp_path), targets.get(name)
    for frame, form in product(target.frames, target.forms):
        text = export(path, to=name, form=form, frame=frame).text
        other = {"NED": "ENU", "ENU": "NED"}[frame]
        assert f"Frame: {frame} world" in text.replace("\n", " ") and f"Frame: {other}" not in text
        assert "yaw_model.json" in text and "N m" in text


# What cannot be


def test_normalised_moments_need_their_size_where_the_target_is_in_si(tmp_path: Path) -> None:
    path = model_file(tmp_path, unit="nu")
    with pytest.raises(SettingError, match=r"^yaw_model\.json: .* uuv needs newton metres; give --newton-metres-per"):
        export(path, to="uuv")
    scaled = READERS["uuv", "urdf"](export(path, to="uuv", newton_metres_per_nu=2.5).text)
    plain = export(path, to="mss").text
    assert scaled(0.4, 2.5 * 0.7) == pytest.approx(READERS["mss", "python"](plain)(0.4, 0.7), rel=1e-7)
    assert "moment nu, rate rad/s, inertia nu s^2" in plain
    with pytest.raises(SettingError, match="is in newton metres already"):
        export(model_file(tmp_path), to="uuv", newton_metres_per_nu=2.5)


REFUSALS: list[tuple[dict[str, Any], str]] = [
    ({"to": "gazebo"}, "--to gazebo: no such target; known are card, gz-sim, mjcf, mss, python, thr"),
    ({"to": "uuv", "form": "sdf"}, "--form of uuv: found sdf, expected urdf or controller"),
    ({"to": "mss", "frame": "ENU"}, "--frame of mss: found ENU, expected NED"),
    ({"to": "card", "rigid_inertia": 1.0}, "--rigid-inertia means nothing to card; it is for"),
    ({"to": "uuv", "number": "4"}, "--number: found 4, expected 1 or 2 or 3"),
    ({"to": "uuv", "symmetrise": True}, "--symmetrise means nothing to uuv; it is for thrusters"),
    ({"to": "thrusters"}, "yaw_model.json is a yaw model; --to thrusters takes the thrusters.json of a fit"),
    ({"to": "uuv", "rigid_inertia": 1.6}, "--rigid-inertia: found 1.6, expected .* no more than 1.52, .*; check unit"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "words"), REFUSALS)
def test_refusals_say_what_is_wrong_and_what_to_do(tmp_path: Path, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingError, match=words):
        export(model_file(tmp_path), **settings)


@pytest.mark.parametrize("target", ["gz-sim", "uuv", "mjcf"])
def test_drag_that_would_drive_the_vehicle_is_refused_by_simulators(tmp_path: Path, target: str) -> None:
    path = model_file(tmp_path, k_r=-0.02)
    with pytest.raises(SettingError, match=r"^yaw_model\.json, model 2: k_r = -0\.02 N m s .* --number 1 or 3"):
        export(path, to=target, form=next(iter(targets.get(target).forms)))
    assert "N_r = 0.02" in export(path, to="mss").text


LACKING: dict[str, tuple[str, dict[str, float], str]] = {
    "thruster-lag": ("mjcf", {"T": 0.2, "law": 0.0}, "no counterpart for its law"),
    "coulomb-drag": ("mjcf", {"c": 0.1, "law": 1.0, "c_s": 0.1, "v_s": 0.2}, "no counterpart for its law"),
    "dead-band": ("mjcf", {"width": 0.1}, "it acts in the thrusters, before the moment"),
    "bias-moment": ("gz-sim", {"b": 0.1}, "the target's equation has no such term"),
}


@pytest.mark.parametrize("name", LACKING)
def test_an_effect_without_a_term_is_refused_and_left_out_where_that_is_allowed(tmp_path: Path, name: str) -> None:
    target, values, why = LACKING[name]
    path = model_file(tmp_path, {name: values})
    with pytest.raises(SettingError, match=rf"^yaw_model\.json: .* {name} \(.*{why}\); give --allow-partial"):
        export(path, to=target)
    partly = export(path, to=target, allow_partial=True)
    assert [effect.name for effect in partly.left_out] == [name] and f"Left out: {name}: " in partly.text
    bare, form = export(model_file(tmp_path), to=target), next(iter(targets.get(target).forms))
    assert READERS[target, form](partly.text)(0.5, 1.0) == READERS[target, form](bare.text)(0.5, 1.0)


# Files


@pytest.mark.parametrize("target", sorted(set(targets.names()) - {"thrusters"}))
def test_files_are_the_same_bytes_wherever_they_are_made(tmp_path: Path, target: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    shutil.copy(model_file(tmp_path), tmp_path / "elsewhere" / "yaw_model.json")
    for form, ending in targets.get(target).forms.items():
        files = []
        for folder in (tmp_path, tmp_path / "elsewhere"):
            out = folder / f"made_{form}{ending}"
            export(folder / "yaw_model.json", to=target, form=form, out=out)
            files.append(out.read_bytes())
        assert files[0] == files[1] and str(tmp_path).encode() not in files[0]
        assert not re.search(rb"20\d\d-\d\d-\d\d|\d\d:\d\d:\d\d", files[0])
        assert target == "card" or files[0].isascii()


def test_the_ending_of_the_file_chooses_the_form_and_what_is_there_stays_until_it_may_go(tmp_path: Path) -> None:
    path, out = model_file(tmp_path), tmp_path / "made" / "vehicle.sdf"
    for name, form in (("a.m", "matlab"), ("a.txt", "python")):
        assert export(path, to="mss", out=tmp_path / name).form == form
    export(path, to="gz-sim", out=out)
    before = out.read_bytes()
    with pytest.raises(OutputError, match=r"vehicle\.sdf is there already; give --overwrite"):
        export(path, to="gz-sim", number="3", out=out)
    assert out.read_bytes() == before
    export(path, to="gz-sim", number="3", out=out, overwrite=True)
    assert out.read_bytes() != before and [p.name for p in out.parent.iterdir()] == ["vehicle.sdf"]


def test_names_of_files_cannot_leave_their_comment(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    plain = model_file(tmp_path / "plain")
    strange = model_file(tmp_path).rename(tmp_path / 'a--->--> """\n x é.json')
    compile(export(strange, to="python").text, "made.py", "exec")
    for target, form in SIMULATORS:
        expected, slope = (READERS[target, form](export(path, to=target, form=form).text) for path in (plain, strange))
        assert slope(0.4, 0.7) == expected(0.4, 0.7) != 0.0


def test_the_command_writes_prints_and_lists(tmp_path: Path, run: Callable[..., Result]) -> None:
    path, out = model_file(tmp_path), tmp_path / "vehicle.sdf"
    text = am.export(str(path), to="gz-sim", out=str(out)).text
    assert run("export", path, "--to", "gz-sim").stdout == out.read_text() == text
    written = run("export", path, "--to", "gz-sim", "-o", out, "--overwrite")
    assert written.exit_code == 0 and f"Results are in {out}" in written.stdout.replace("\n", "")
    printed = json.loads(run("export", path, "--to", "gz-sim", "--json").stdout)
    assert printed["schema"] == "automarine/export/1" and printed["text"] == text
    assert printed["carried"] == ["inertia", "quadratic-drag", "linear-drag"] and printed["left_out"] == []
    partly = ("export", model_file(tmp_path, {"bias-moment": {"b": 0.1}}), "--to", "gz-sim", "--allow-partial")
    assert "Left out: bias-moment" in run(*partly).stderr and run(*partly, "-q").stderr == ""
    data = json.loads(run("export", "--list", "--json").stdout)["targets"]
    assert {target["name"] for target in data} == set(targets.names())
    assert run("export", path).exit_code == 2
    refused = run("export", path, "--to", "uuv", "--symmetrise")
    assert refused.exit_code == 1 and refused.stderr.startswith("Error: --symmetrise means nothing to uuv")
