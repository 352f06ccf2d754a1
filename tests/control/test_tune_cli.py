"""`automarine tune`: verdicts, files, refusals."""

import csv
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from made_rudder import estimate

import automarine_cli as am
from automarine_cli.control import design as designing
from automarine_cli.control.design import fly
from automarine_cli.control.knowledge import read_knowledge
from automarine_cli.pipeline.results_folder import MANIFEST
from automarine_cli.thrusters.curves import PowerCurve
from automarine_cli.thrusters.map import ThrusterMap

Run = Callable[..., Result]


def smaller(patch: pytest.MonkeyPatch) -> None:
    """Fewer vehicles than a user gets: the verdicts here are clear ones."""
    patch.setattr(designing, "CROWD_VEHICLES", 72)
    patch.setattr(designing, "FEW_VEHICLES", 16)


@pytest.fixture(autouse=True)
def small_crowds(monkeypatch: pytest.MonkeyPatch) -> None:
    smaller(monkeypatch)


def model(
    inertia: float, drag: float, full: float, unit: str = "N m", lag: float = 0.0, delay: float = 0.0, **more: Any
) -> dict[str, Any]:
    """Content of a yaw model; `more` are further keys."""
    effects: list[dict[str, Any]] = []
    if lag:
        parameters = {"T": estimate(lag, "s"), "law": 1.0, "tau_ref": full, "fall": 1.0}
        effects.append({"name": "thruster-lag", "parameters": parameters})
    if delay:
        effects.append({"name": "input-delay", "parameters": {"t_d": estimate(delay, "s")}})
    return {
        "schema": "automarine/yaw-model/1", "moment_unit": unit, "preferred": "3", "gain_scatter": 0.03,
        "models": {"3": {"I_r": estimate(inertia, f"{unit} s²"), "k_rr": estimate(drag, f"{unit} s²")}},
        "valid_range": {"moment": [-full, full], "yaw_rate_rad_s": None}, "effects": effects, **more,
    }  # fmt: skip


def written(folder: Path, content: Mapping[str, Any], name: str = "model.json") -> str:
    path = folder / name
    path.write_text(json.dumps(content))
    return str(path)


def twin_map(a: float, dead: float) -> dict[str, Any]:
    """Content of a map of thrusters alike both ways, with a dead-band, up to a control signal of 1."""
    curve = PowerCurve(a, 2.0, dead, 1.0)
    return ThrusterMap("dead-band-saturation", curve, curve, "").to_json()


@pytest.mark.slow
def test_gains_are_better_than_the_defaults_that_swing(tmp_path: Path) -> None:
    path, out = written(tmp_path, model(0.59, 1.5, 30.0, lag=0.1, delay=0.05)), tmp_path / "out"
    tuning_result = am.tune(path, target="ardusub", full=30.0, out=out)
    result = json.loads((out / "tuning.json").read_text())
    assert result == json.loads(json.dumps(tuning_result.to_json()))
    assert result["schema"] == "automarine/tuning/1" and result["verdict"] == "gains"
    assert result["margins"]["present"]["stable"] == 0.0 and result["margins"]["new"]["share_with_margin"] >= 0.95
    assert result["promised"]["settles"] >= 0.95 and result["present"]["settles"] == 0.0
    low, high = result["promised"]["settling_s"]["ci95"]
    assert 2.0 * np.sqrt(0.5 * np.pi * 0.59 / 30.0) < low <= high < 6.0  # no turn of 90 degrees is shorter
    assert result["margins"]["new"]["rejects_load"] and not result["margins"]["present"]["share_with_margin"]
    for name, gain in result["gains"].items():
        ends = gain["documented"]
        assert name.startswith("ATC_") and ends[0] <= gain["value"] <= max(ends[1], gain["before"])
    values = dict(line.split(",") for line in (out / "ardusub.param").read_text().splitlines() if line[0] != "#")
    assert set(values) < set(result["gains"]) and "ATC_RAT_YAW_FF" not in values
    assert float(values["ATC_RAT_YAW_P"]) == pytest.approx(result["gains"]["ATC_RAT_YAW_P"]["value"], rel=1e-5)
    files = {"ardusub.param", "gains.csv", MANIFEST, *(f"tuning.{kind}" for kind in ("json", "md", "csv", "png"))}
    assert {file.name for file in out.iterdir()} == files and "roll, pitch" in (out / "tuning.md").read_text()
    assert "settles after [s]" in repr(tuning_result) and len(tuning_result.to_frame()) == len(result["gains"])
    table = list(csv.reader(io.StringIO((out / "gains.csv").read_text())))
    assert table[0][:3] == ["parameter", "present", "new"] and len(table) == 9


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "margin"), [(0.01, 0.75), (0.02, 0.6)])
def test_a_fast_vehicle_keeps_its_defaults(delay: float, margin: float, run: Run, tmp_path: Path) -> None:
    """So much moment for so little inertia, and hardly late: the defaults keep the margin. At 0.02 s they keep 0.74 at
    best, whatever the inertia."""
    path, out = written(tmp_path, model(0.375, 1.5, 30.0, delay=delay)), tmp_path / "out"
    found = run("tune", path, "--for", "ardusub", "--full", "30", "--margin", str(margin), "-o", str(out))
    assert found.exit_code == 0, found.stderr
    assert found.stdout.startswith(f"Leave the gains as they are. The present gains keep the margin of {margin} for")
    assert json.loads((out / "tuning.json").read_text())["verdict"] == "leave"
    assert not (out / "ardusub.param").exists()


@pytest.mark.slow
def test_a_plain_fit_promises_gains_with_the_delay_that_it_estimated(run: Run, tmp_path: Path) -> None:
    late = estimate(0.1, "s", 0.01)
    path = written(tmp_path, model(0.3, 1.0, 30.0) | {"command_delay_s": late})
    knowledge = read_knowledge(Path(path), None, None, (1.0, 1.0))
    assert knowledge.model.theta[knowledge.model.index("input-delay.t_d")] == 0.1 and knowledge.spread.late == 0.0
    place = knowledge.model.index("input-delay.t_d")
    assert knowledge.explanations[0].covariance[place, place] >= 0.001**2
    tuned = run("tune", path, "--for", "pid", "--full", "30", "--json")
    assert json.loads(tuned.stdout)["verdict"] == "gains"


def test_nothing_is_promised_where_the_delay_is_not_known(run: Run, tmp_path: Path) -> None:
    """A file written by hand, without the delay that every fit estimates."""
    path, out = written(tmp_path, model(0.3, 1.0, 30.0)), tmp_path / "out"
    tuned = run("tune", path, "--for", "pid", "--full", "30", "-o", str(out))
    assert tuned.exit_code == 0, tuned.stderr
    assert tuned.stdout.startswith("No promise can be made. How late the vehicle answers is not known")
    assert "Fit its logs again" in tuned.stdout and "What would settle it: a fast square wave" in tuned.stdout
    result = json.loads((out / "tuning.json").read_text())
    assert result["verdict"] == "cannot-promise" and result["gains"] == {} and result["promised"] is None
    assert not (out / "pid.json").exists()


@pytest.mark.slow
def test_what_the_fit_itself_asks_for_is_settled_first(run: Run, tmp_path: Path) -> None:
    content = model(0.375, 1.5, 30.0, delay=0.01, driven=True, proposed={"dead-band": 172.3})
    result = run("tune", written(tmp_path, content), "--for", "ardusub", "--full", "30")
    assert result.exit_code == 0, result.stderr
    answer = " ".join(result.stdout.split())
    assert answer.startswith("No promise can be made. The fit's own evidence asks for dead-band (172 in deviance)")
    assert "Fit it with --with dead-band, and tune that model." in answer


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"gain_scatter": 0.3}, "The thrust seems to scatter by 30 % from run to run"),
        ({"gain_exponent": estimate(0.9, "1")}, "The gain of the thrust goes with the size of the command"),
        pytest.param({"gain_scatter": 0.02, "gain_exponent": estimate(0.04, "1", 1.0)}, "", marks=pytest.mark.slow),
    ],
)
def test_nothing_is_promised_of_a_thrust_that_is_not_known(more: dict[str, Any], why: str, tmp_path: Path) -> None:
    """A scatter at the bound of its fit, or a gain that goes with the command: a dead-band may hide in it."""
    content = model(0.05, 0.08, 1.0, "nu", lag=0.05, delay=0.05) | more
    design = am.tune(written(tmp_path, content), target="ardusub", full=1.0)
    assert design.verdict == ("cannot-promise" if why else "gains")
    assert not why or (design.why.startswith(why) and design.open == "dead-band")


def test_a_curve_of_the_thrust_is_flown_with_the_dead_band_that_it_may_hide(tmp_path: Path) -> None:
    """An exponent that was found without a dead-band: the largest that the diagnosis would not have seen is flown."""
    curve = {"p": estimate(1.6, "1"), "tau_ref": estimate(1.0, "nu", 0.0)}
    content = model(0.1, 0.2, 1.0, "nu", effects=[{"name": "thrust-exponent", "parameters": curve}])
    path, diagnosis = Path(written(tmp_path, content, "extended_model.json")), {
        "schema": "automarine/diagnosis/1", "verdict": "named", "moment_unit": "nu", "base": {}, "effects": [],
        "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}},
    }  # fmt: skip
    for visible, width in (({}, 0.1), ({"dead-band": 0.004}, 0.004)):
        file = Path(written(tmp_path, diagnosis | {"smallest_visible": visible}, "d.json"))
        explanations = read_knowledge(path, file, None, (0.9, 1.1)).explanations
        (other,) = (explanation for explanation in explanations if explanation.instead)
        assert other.model.theta[other.model.index("dead-band.width")] == pytest.approx(width)


@pytest.mark.slow
def test_present_gains_that_are_as_good_are_left(tmp_path: Path) -> None:
    """What `tune` found is given back to it as the present gains, also where two explanations are open."""
    path = written(tmp_path, model(0.3, 0.5, 1.0, "nu", lag=0.1, delay=0.1))
    assert am.tune(path, target="ardusub", full=1.0, out=tmp_path / "out").verdict == "gains"
    again = am.tune(path, target="ardusub", full=1.0, present=tmp_path / "out" / "ardusub.param")
    assert again.verdict == "leave" and again.why.startswith("The present gains keep the margin of 0.75")


@pytest.mark.slow
def test_what_a_dead_band_does_after_a_while_is_seen(tmp_path: Path) -> None:
    """Thrusters that give nothing below an eighth of their output, and a sluggish compass: a slow loop comes to rest
    within 2 degrees late in its flight, and leaves them again when its sum has grown; so it is flown for longer."""
    effects = [
        {"name": "dead-band", "parameters": {"width": estimate(0.117, "nu", 0.003), "law": 1.0, "stall": 0.5}},
        {"name": "sensor-lag", "parameters": {"T_s": estimate(0.168, "s", 0.01)}},
    ]
    path = written(tmp_path, model(0.16, 1.47, 1.0, "nu", effects=effects))
    design = am.tune(path, target="pid", full=1.0, beyond_range=True)
    assert design.verdict == "cannot-promise" and "do not settle for 95 %" in design.why


@pytest.mark.slow
def test_no_gains_keep_a_margin_that_none_can_keep(run: Run, tmp_path: Path) -> None:
    path = written(tmp_path, model(29.0, 30.0, 40.0, lag=0.2, delay=0.5))
    found = run("tune", path, "--for", "ardurover", "--full", "40")
    assert found.exit_code == 0
    assert "No gains within the documented ranges keep a disk margin of 0.75 for 95 % of" in found.stdout


@pytest.mark.slow
def test_depth_is_designed_by_the_same_code(run: Run, tmp_path: Path) -> None:
    """Heave: weight less buoyancy is held, the step is in metres."""
    entry = {"m_w": estimate(30.0, "kg"), "Z_ww": estimate(60.0, "N s²/m²"), "constant_force": estimate(-2.0, "N")}
    content = {"schema": "automarine/heave-model/1", "motion": "heave", "force_unit": "N", "preferred": "3"}
    content |= {"models": {"3": entry}, "valid_range": {"force": [-60.0, 60.0]}}
    out = tmp_path / "out"
    options = ["--for", "pid", "--full", "60", "--delay", "0.05", "-o", str(out)]
    printed = run("tune", written(tmp_path, content, "heave_model.json"), *options)
    assert printed.exit_code == 0, printed.stderr
    result = json.loads((out / "tuning.json").read_text())
    assert result["verdict"] == "gains" and result["motion"] == "heave" and result["step_m"] == 1.0
    assert result["promised"]["load_error_cm"]["unit"] == "cm" and "heave" in (out / "pid.json").read_text()


PLAIN = model(1.0, 1.2, 9.0)
DRIVING = PLAIN | {"preferred": "2", "models": {"2": PLAIN["models"]["3"] | {"k_r": estimate(-0.4, "N m s")}}}
TWINS = ["--thrusters", "map.json", "--arm"]
REFUSALS: list[tuple[dict[str, Any], list[str], str]] = [
    (model(1.0, 1.2, 1.2, "nu"), [], "its moments reach 1.2 nu, which is no output of ardusub"),
    (PLAIN, [], "its moments are in N m, and ardusub commands outputs from -1 to 1; give --full"),
    (PLAIN, ["--full", "4"], "it was fitted to moments up to 9 N m, and --full is 4 N m at the"),
    (model(1.0, -1.2, 9.0), ["--full", "9"], "models.3.k_rr: found -1.2, expected a drag of zero or more"),
    (DRIVING, ["--full", "9"], "model.json: k_r is -0.4, drag that drives the vehicle; expected zero or more"),
    (PLAIN, ["--full", "9", "--sample-time", "0.1"], "ardusub runs at its firmware's own rate"),
    (PLAIN, [*TWINS, "0.3"], "fitted to moments up to 9 N m, and the thruster map gives 4.332 N m at the whole"),
    (PLAIN, [*TWINS, "0.7", "--full", "14"], "--full is 14 N m, and the thruster map gives 10.11 N m at the whole"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "more", "sentence"), REFUSALS)
def test_refusals(content: dict[str, Any], more: list[str], sentence: str, run: Run, tmp_path: Path) -> None:
    path, out = written(tmp_path, content), tmp_path / "out"
    thrusters = written(tmp_path, twin_map(8.0, 0.05), "map.json")
    options = [thrusters if option == "map.json" else option for option in more]
    printed = run("tune", path, "--for", "ardusub", "-o", str(out), *options)
    assert printed.exit_code == 1 and len(printed.stderr.splitlines()) == 1
    assert sentence in printed.stderr and not out.exists()


def test_present_gains_are_checked(run: Run, tmp_path: Path) -> None:
    path = written(tmp_path, model(0.375, 1.5, 30.0, delay=0.01))
    for text, sentence in (
        ("ATC_RAT_YAW_P,0.9\n", "row 1: ATC_RAT_YAW_P is 0.9, outside the range that ArduSub 4.1 to 4.5 documents"),
        ("# x\nATC_RAT_YAW_I abc\n", "row 2: ATC_RAT_YAW_I is 'abc'; expected a number"),
        ("OTHER,1\n", "none of the parameters of ardusub is in it; expected lines such as ATC_ANG_YAW_P,6"),
    ):
        (tmp_path / "sub.param").write_text(text)
        found = run("tune", path, "--for", "ardusub", "--full", "30", "--present", str(tmp_path / "sub.param"))
        assert found.exit_code == 1 and sentence in found.stderr


@pytest.mark.slow
def test_present_gains_come_from_the_vehicle_s_file(tmp_path: Path) -> None:
    path = written(tmp_path, model(0.375, 1.5, 30.0, delay=0.01))
    (tmp_path / "sub.param").write_text("ATC_ANG_YAW_P,5\nATC_ACCEL_Y_MAX,110000\nFOO,3\n")
    result = am.tune(path, target="ardusub", full=30.0, present=tmp_path / "sub.param").to_json()
    assert result["verdict"] == "leave" and result["present"]["settles"] == 1.0
    assert result["present_gains"]["ATC_ANG_YAW_P"] == 5.0  # the firmware begins with 6


def flown_log(folder: Path, found: Any, noise_deg: float, later: float = 0.0) -> str:
    """A log of two steps, there and back, of the vehicle that was tuned or of one that answers later."""
    made = found
    one = made.crowds[0].pick(slice(0, 1))
    one = replace(one, late=one.late + later)
    target, random = made.target, np.random.default_rng(2)
    own = {name: np.full((1, 1), value) for name, value in made.new.gains.items()}
    loops = round(60.0 / target.period)
    clock = np.arange(loops) * target.period
    reference = np.where(clock < 2.0, 0.0, np.where(clock < 30.0, np.pi / 2, -np.pi / 6))
    flight = fly(target, own, one, reference[None, None], np.zeros((1, 1)))
    asked = np.interp(flight.time, clock, reference)
    heading = np.rad2deg(flight.position[0, 0]) + noise_deg * random.standard_normal(len(flight.time))
    rows = zip(flight.time, heading % 360.0, 0.0 * heading, np.rad2deg(asked) % 360.0)  # its moment is not looked at
    lines = ["time_s,heading_deg,tau_Nm,target_heading_deg", *(",".join(f"{x:.4f}" for x in row) for row in rows)]
    path = folder / "flown.csv"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Any]:
    """A tuning for `pid`: its file, and the result."""
    folder = tmp_path_factory.mktemp("tuned")
    path = written(folder, model(0.59, 1.5, 30.0, lag=0.1, delay=0.05))
    with pytest.MonkeyPatch.context() as patch:
        smaller(patch)
        found = am.tune(path, target="pid", full=30.0, out=folder / "out")
    return str(folder / "out" / "tuning.json"), found


def test_a_log_of_the_tuned_vehicle_holds_the_promise(tuned: tuple[str, Any], run: Run, tmp_path: Path) -> None:
    path = written(tmp_path, model(0.59, 1.5, 30.0, lag=0.1, delay=0.05))
    tuning_file, found = tuned
    log = flown_log(tmp_path, found, 0.5)
    checked = run("tune", tuning_file, "--check", log, "-o", str(tmp_path / "check"))
    assert checked.exit_code == 0, checked.stderr
    assert checked.stdout.startswith("As promised: all 2 steps are within the bands.")
    result = json.loads((tmp_path / "check" / "tuning_check.json").read_text())
    assert result["schema"] == "automarine/tuning-check/1" and result["verdict"] == "held"
    assert [round(one["step_deg"]) for one in result["steps"]] == [90, -120]
    assert (tmp_path / "check" / "tuning_check.png").is_file()
    bare = run("tune", tuning_file, "--check", log, "--reference", "setpoint")
    assert bare.exit_code == 1 and "there is no column 'setpoint'; name it with --reference, from" in bare.stderr
    wrong = run("tune", path, "--check", log)
    assert (
        wrong.exit_code == 1 and "this is no tuning; give the tuning.json that `automarine tune` wrote" in wrong.stderr
    )
    assert run("tune", path).exit_code == 2


def test_a_log_of_a_vehicle_that_answers_later_does_not(tuned: tuple[str, Any], run: Run, tmp_path: Path) -> None:
    tuning_file, found = tuned
    checked = run("tune", tuning_file, "--check", flown_log(tmp_path, found, 0.5, later=1.0))
    assert checked.exit_code == 0, checked.stderr
    assert checked.stdout.startswith("Not as promised: 2 of 2 steps leave the bands of 95 %.\n")
