"""What is open and changes the answer: the runs that settle it are planned, and settle it."""

import json
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

import automarine_cli as am
from automarine_cli.control import tuning
from automarine_cli.control.knowledge import read_knowledge
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.results_folder import MANIFEST
from automarine_cli.simulation.specification import SCHEMA

Run = Callable[..., Result]


@pytest.fixture(autouse=True)
def small_crowds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer vehicles than a user gets: the verdicts here are clear ones."""
    monkeypatch.setattr(tuning, "design", partial(tuning.design, count=48))


def estimate(value: float, unit: str, share: float = 0.03) -> dict[str, object]:
    """An estimate of a file."""
    error = abs(share * value)
    return {"value": value, "stderr": error, "ci95": [value - 2 * error, value + 2 * error], "unit": unit}


def model(unit: str, full: float, effects: list[dict[str, Any]]) -> dict[str, Any]:
    """Content of a yaw model of 0.3 and 1."""
    own = {"I_r": estimate(0.3, f"{unit} s²"), "k_rr": estimate(1.0, f"{unit} s²")}
    return {
        "schema": "automarine/yaw-model/1", "moment_unit": unit, "preferred": "3", "gain_scatter": 0.03,
        "heading_noise_deg": 0.7, "models": {"3": own},
        "valid_range": {"moment": [-full, full], "yaw_rate_rad_s": None}, "effects": effects,
    }  # fmt: skip


def diagnosis(effect: str, parameters: dict[str, Any], rival: str) -> dict[str, Any]:
    """Content of a diagnosis that names one effect and leaves another open."""
    rivals = [{"name": rival, "confidence": 0.4, "split_by": "one reversal"}]
    return {
        "schema": "automarine/diagnosis/1", "verdict": "named", "moment_unit": "nu", "base": {},
        "effects": [{"name": effect, "parameters": parameters, "rivals": rivals}],
        "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}, "held_out_runs": None},
    }  # fmt: skip


def written(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content))
    return path


@pytest.mark.slow
def test_an_unknown_delay_is_planned_for(run: Run, tmp_path: Path) -> None:
    """The folder holds the plan's own files, and the line that is printed makes the same plan again."""
    path = written(tmp_path / "model.json", model("N m", 30.0, []))
    out = tmp_path / "out"
    found = run("tune", str(path), "--for", "python", "--full", "30", "-o", str(out))
    assert found.exit_code == 0, found.stderr
    said = next(line for line in found.stdout.splitlines() if line.startswith("Such runs are planned in "))
    assert str(out / "settles") in said
    line = shlex.split(said.partition("within other limits: ")[2])
    assert line[:2] == ["automarine", "plan"] and "input-delay t_d" in line
    again = run(*line[1:-1], str(tmp_path / "again"))
    assert again.exit_code == 0, again.stderr
    names = {one.relative_to(tmp_path / "again") for one in (tmp_path / "again").rglob("*") if one.is_file()}
    for name in names - {Path(MANIFEST)}:
        assert (out / "settles" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    result = json.loads((out / "tuning.json").read_text())
    assert result["vehicles"] == 48
    assert result["verdict"] == "cannot-promise" and str(tmp_path) not in json.dumps(result["plan"])
    assert "[settles/plan.md](settles/plan.md)" in (out / "tuning.md").read_text()
    planned = json.loads((out / "settles" / "plan.json").read_text())
    assert 4 <= planned["totals"]["runs"] <= 12 and set(planned["planned_for"]) == {"I_r", "input-delay t_d"}
    assert planned["parameters"]["input-delay t_d"]["new_runs"]["stderr"] < 0.02
    dry = run("tune", str(path), "--for", "python", "--full", "30")
    assert "Such runs are planned with -o DIR, into DIR/settles." in dry.stdout


def test_a_tuning_whose_plan_fails_is_written_with_a_warning(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lenient_figures: None
) -> None:
    def refuse(*files: object, **settings: object) -> None:
        raise SettingError("the limits allow no campaign")

    monkeypatch.setattr(tuning, "make_plan", refuse)
    path, out = written(tmp_path / "model.json", model("N m", 30.0, [])), tmp_path / "out"
    result = run("tune", str(path), "--for", "python", "--full", "30", "-o", str(out))
    warning = (
        "The runs that settle it could not be planned (the limits allow no campaign); everything else was written."
    )
    assert result.exit_code == 0 and f"Warning: {warning}" in result.stderr
    assert json.loads((out / MANIFEST).read_text())["warnings"] == [warning]
    assert "Such runs are planned" not in result.stdout
    assert (out / "tuning.json").is_file() and not (out / "settles").exists()
    assert "settles/plan.md" not in (out / "tuning.md").read_text()


def curve(variable: str) -> tuple[str, dict[str, Any]]:
    """A learned curve: its name and parameters."""
    knots = {f"y{i}": estimate(0.01 * i, "nu") for i in range(1, 11)}
    ends = {"low": estimate(-1.0, "", 0.0), "high": estimate(1.0, "", 0.0), "size": estimate(0.1, "nu", 0.0)}
    return f"learned:{variable}", {**ends, "spread": estimate(1.0, "1", 0.0), **knots, "kind": estimate(0.0, "", 0.0)}


@pytest.mark.parametrize("to", ["tune", "export"])
def test_a_learned_curve_over_a_column_is_read_and_told_in_a_sentence(run: Run, tmp_path: Path, to: str) -> None:
    name, parameters = curve("surge")
    extended = written(tmp_path / "extended_model.json", model("nu", 1.0, [{"name": name, "parameters": parameters}]))
    found = written(tmp_path / "diagnosis.json", diagnosis(name, parameters, "learned:stbd_cmd"))
    if to == "tune":
        made = run("tune", str(found), "--for", "python")
        said = (
            "Without learned:surge: it acts by the column 'surge', which no controller has; the gains are for the rest."
        )
        assert made.exit_code == 0 and said in " ".join(made.stdout.split())
    else:
        made = run("export", str(extended), "--to", "gz-sim", "--newton-metres-per-nu", "10")
        assert "gz-sim cannot represent learned:surge (it needs the logged surge)" in made.stderr
        assert made.exit_code == 1 and len(made.stderr.splitlines()) == 1


def test_a_learned_curve_over_the_rate_is_flown(tmp_path: Path) -> None:
    name, parameters = curve("yaw-rate")
    extended = written(tmp_path / "extended_model.json", model("nu", 1.0, [{"name": name, "parameters": parameters}]))
    found = written(tmp_path / "diagnosis.json", diagnosis(name, parameters, "learned:stbd_cmd"))
    known = read_knowledge(extended, found, None, (0.9, 1.1))
    assert [term.name for term in known.model.terms if not term.base] == [name]


def test_a_rival_is_as_unsure_as_what_it_stands_for(tmp_path: Path) -> None:
    """An exponent of one does nothing: a rival close to it is no thrust curve of any exponent."""
    fixed = {"tau_ref": estimate(1.0, "nu", 0.0), "t_ref": estimate(0.0, "s", 0.0)}
    faint = {"discharge": estimate(0.05, "1/h", 0.9), "load": estimate(0.1, "1", 0.3), **fixed}
    extended = written(
        tmp_path / "extended_model.json", model("nu", 1.0, [{"name": "battery-sag", "parameters": faint}])
    )
    known = read_knowledge(
        extended, written(tmp_path / "d.json", diagnosis("battery-sag", faint, "thrust-exponent")), None, (0.9, 1.1)
    )
    (rival,) = (one for one in known.explanations if one.instead)
    place, held = (rival.model.index(f"thrust-exponent.{name}") for name in ("p", "tau_ref"))
    error = float(rival.covariance[place, place]) ** 0.5
    assert error == pytest.approx(0.3 * abs(rival.model.theta[place] - 1.0), rel=0.1)
    assert rival.covariance[held, held] == 0.0


@pytest.mark.parametrize(("gain", "share"), [(900.0, 0.125), (20.0, 0.5)])
def test_what_gained_far_more_than_chance_is_not_open(tmp_path: Path, gain: float, share: float) -> None:
    """A standard error that reaches down to no delay contradicts an evidence that no chance reaches."""
    late = {"t_d": estimate(0.4, "s", 0.7)}
    extended = written(tmp_path / "extended.json", model("nu", 1.0, [{"name": "input-delay", "parameters": late}]))
    said = diagnosis("input-delay", late, "dead-band")
    said["effects"][0]["rivals"] = []
    tried = [{"name": "thruster-lag", "gain": 2000.0}, {"name": "input-delay", "gain": gain}]
    found = written(tmp_path / "d.json", said | {"threshold": 14.0625, "candidates": tried})
    (main,) = read_knowledge(extended, found, None, (0.9, 1.1)).explanations[:1]
    place = main.model.index("input-delay.t_d")
    own_laws = 0.03 * 0.4
    assert main.covariance[place, place] == pytest.approx((share * 0.4) ** 2 + own_laws**2)


@pytest.mark.slow
def test_the_planned_runs_settle_an_unknown_delay(tmp_path: Path) -> None:
    """The truth is 0.02 s late: its planned runs, diagnosed, give what could not be promised before."""
    path = written(tmp_path / "model.json", model("N m", 30.0, []))
    am.tune(path, target="python", full=30.0, out=tmp_path / "out")
    plan = (tmp_path / "out" / "settles" / "plan.toml").read_text()
    (tmp_path / "truth.toml").write_text(plan.replace("t_d = 0.2", "t_d = 0.02"))
    am.simulate(tmp_path / "truth.toml", out=tmp_path / "day")
    am.diagnose([str(tmp_path / "day")], model=path, out=tmp_path / "diagnosis")
    found = am.tune(tmp_path / "diagnosis" / "diagnosis.json", target="python", full=30.0)
    assert found.designed.verdict == "gains" and found.to_json()["promised"]["settles"] >= 0.95


@pytest.mark.slow
def test_the_planned_runs_settle_a_tie(tmp_path: Path) -> None:
    """The truth is 0.4 s late; steps alone left it tied with a dead-band."""
    late = {"t_d": estimate(0.4, "s")}
    written(tmp_path / "extended_model.json", model("nu", 1.0, [{"name": "input-delay", "parameters": late}]))
    path = written(tmp_path / "diagnosis.json", diagnosis("input-delay", late, "dead-band"))
    bare = written(tmp_path / "model.json", model("nu", 1.0, []))
    before = am.tune(path, target="python", out=tmp_path / "out")
    assert before.designed.verdict == "cannot-promise" and before.designed.open == "dead-band"
    planned = json.loads((tmp_path / "out" / "settles" / "plan.json").read_text())
    assert all(one["evidence"] >= 20.0 for one in planned["splits"])
    am.simulate(tmp_path / "out" / "settles" / "plan.toml", out=tmp_path / "day")
    rest = {
        "schema": SCHEMA, "seed": 3, "vehicle": {"I_r": 0.3, "k_rr": 1.0, "moment_unit": "nu"},
        "effects": [{"name": "input-delay", "t_d": 0.4}], "logger": {"rate_hz": 10.0, "noise_deg": 0.7},
        "scatter": {"gain": 0.03},
        "runs": [{"kind": "step", "moments": [0.3, -0.3, 0.6, -0.6, 1.0, -1.0], "turn_deg": 180.0}],
    }  # fmt: skip
    am.simulate(written(tmp_path / "rest.json", rest), out=tmp_path / "rest")
    am.diagnose([str(tmp_path / "day"), str(tmp_path / "rest")], model=bare, out=tmp_path / "diagnosis")
    (effect,) = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())["effects"]
    assert effect["name"] == "input-delay" and not effect["rivals"]
    after = am.tune(tmp_path / "diagnosis" / "diagnosis.json", target="python")
    assert after.designed.verdict == "gains" and after.designed.open == ""
