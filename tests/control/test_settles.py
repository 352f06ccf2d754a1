"""What is open and changes the answer: what is known of it, and the runs that settle it."""

import json
from pathlib import Path
from typing import Any

import pytest
import test_tune_cli
from test_tune_cli import Run, estimate, small_crowds, written

import automarine_cli as am
from automarine_cli.control.knowledge import read_knowledge
from automarine_cli.simulation.specification import SIMULATION_SCHEMA

__all__ = ["small_crowds"]  # a fixture


def model(unit: str = "nu", full: float = 1.0, effect: str = "", parameters: Any = None) -> dict[str, Any]:
    """Content of a yaw model of 0.3 and 1, with one more effect."""
    effects = [{"name": effect, "parameters": parameters}] if effect else []
    return test_tune_cli.model(0.3, 1.0, full, unit, heading_noise_deg=0.7, effects=effects)


def diagnosis(effect: str, parameters: dict[str, Any], *rivals: str, **more: Any) -> dict[str, Any]:
    """Content of a diagnosis that names one effect and leaves others open."""
    still_open = [{"name": rival, "confidence": 0.4, "split_by": "one reversal"} for rival in rivals]
    return {
        "schema": "automarine/diagnosis/1", "verdict": "named", "moment_unit": "nu", "base": {},
        "effects": [{"name": effect, "parameters": parameters, "rivals": still_open}],
        "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}, "held_out_runs": None},
        **more,
    }  # fmt: skip


def test_the_line_that_plans_what_is_open(run: Run, tmp_path: Path) -> None:
    path = written(tmp_path, model("N m", 30.0))
    printed = run("tune", path, "--for", "pid", "--full", "30")
    line = f"Next: automarine plan {path} --parameter I_r --parameter 'input-delay t_d' -o out/plan"
    assert printed.exit_code == 0 and line in printed.stdout.splitlines()


def curve(variable: str) -> tuple[str, dict[str, Any]]:
    """A learned curve: its name and parameters."""
    knots = {f"y{i}": estimate(0.01 * i, "nu") for i in range(1, 11)}
    ends = {"low": estimate(-1.0, "", 0.0), "high": estimate(1.0, "", 0.0), "size": estimate(0.1, "nu", 0.0)}
    return f"learned:{variable}", {**ends, "spread": estimate(1.0, "1", 0.0), **knots, "kind": estimate(0.0, "", 0.0)}


def test_a_learned_curve_over_a_column_is_left_out_and_one_over_the_rate_is_flown(run: Run, tmp_path: Path) -> None:
    for variable, flown in (("surge", False), ("yaw-rate", True)):
        name, parameters = curve(variable)
        extended = Path(written(tmp_path, model(effect=name, parameters=parameters), "extended_model.json"))
        file = written(tmp_path, diagnosis(name, parameters, "learned:stbd_cmd"), "diagnosis.json")
        terms = read_knowledge(extended, Path(file), None, (0.9, 1.1)).model.terms
        assert [term.name for term in terms if not term.base] == [name] * flown
        if not flown:
            printed = run("tune", file, "--for", "pid")
            left = "Without learned:surge: it acts by the column 'surge', which no controller has"
            assert printed.exit_code == 0 and left in " ".join(printed.stdout.split())


def test_a_rival_is_as_unsure_as_what_it_stands_for(tmp_path: Path) -> None:
    """An exponent of one does nothing: a rival close to it is no thrust curve of any exponent."""
    fixed = {"tau_ref": estimate(1.0, "nu", 0.0), "t_ref": estimate(0.0, "s", 0.0)}
    faint = {"discharge": estimate(0.05, "1/h", 0.9), "load": estimate(0.1, "1", 0.3), **fixed}
    extended = written(tmp_path, model(effect="battery-sag", parameters=faint), "extended_model.json")
    file = written(tmp_path, diagnosis("battery-sag", faint, "thrust-exponent"), "d.json")
    explanations = read_knowledge(Path(extended), Path(file), None, (0.9, 1.1)).explanations
    (rival,) = (explanation for explanation in explanations if explanation.instead)
    place, held = (rival.model.index(f"thrust-exponent.{name}") for name in ("p", "tau_ref"))
    error = float(rival.covariance[place, place]) ** 0.5
    assert error == pytest.approx(0.3 * abs(rival.model.theta[place] - 1.0), rel=0.1)
    assert rival.covariance[held, held] == 0.0


@pytest.mark.parametrize(("gain", "share"), [(900.0, 0.125), (20.0, 0.5)])
def test_what_gained_far_more_than_chance_is_not_open(tmp_path: Path, gain: float, share: float) -> None:
    """A standard error that reaches down to no delay contradicts an evidence that no chance reaches."""
    late = {"t_d": estimate(0.4, "s", 0.7)}
    extended = written(tmp_path, model(effect="input-delay", parameters=late), "extended.json")
    candidates = [{"name": "thruster-lag", "gain": 2000.0}, {"name": "input-delay", "gain": gain}]
    file = written(tmp_path, diagnosis("input-delay", late, threshold=14.0625, candidates=candidates), "d.json")
    (main,) = read_knowledge(Path(extended), Path(file), None, (0.9, 1.1)).explanations[:1]
    place, law_error = main.model.index("input-delay.t_d"), 0.03 * 0.4
    assert main.covariance[place, place] == pytest.approx((share * 0.4) ** 2 + law_error**2)


def planned(folder: Path, path: str, half_width: float, *parameters: str, diagnosis: str | None = None) -> Path:
    """The specification of the runs that narrow intervals to `half_width` [%]."""
    limits = folder / "limits.toml"
    limits.write_text(f'schema = "automarine/plan-limits/1"\n[goal]\nhalf_width_percent = {half_width}\n')
    am.plan(path, diagnosis=diagnosis, limits=limits, parameters=parameters, out=folder / "plan")
    return folder / "plan" / "plan.toml"


@pytest.mark.slow
def test_the_planned_runs_settle_a_tie(tmp_path: Path) -> None:
    """The truth is 0.4 s late; steps alone left it tied with a dead-band."""
    late = {"t_d": estimate(0.4, "s")}
    extended = written(tmp_path, model(effect="input-delay", parameters=late), "extended_model.json")
    path = written(tmp_path, diagnosis("input-delay", late, "dead-band"), "diagnosis.json")
    bare = written(tmp_path, model())
    before = am.tune(path, target="pid")
    assert before.verdict == "cannot-promise" and before.open == "dead-band"
    assert f"automarine plan {extended} --diagnosis {path} --parameter I_r -o" in before.plan_command
    plan = planned(tmp_path, extended, 50.0, "I_r", diagnosis=path)
    am.simulate(plan, out=tmp_path / "day")
    rest = {
        "schema": SIMULATION_SCHEMA, "seed": 3, "vehicle": {"I_r": 0.3, "k_rr": 1.0, "moment_unit": "nu"},
        "effects": [{"name": "input-delay", "t_d": 0.4}], "logger": {"rate_hz": 10.0, "noise_deg": 0.7},
        "scatter": {"gain": 0.03},
        "runs": [{"kind": "step", "moments": [0.3, -0.3, 0.6, -0.6, 1.0, -1.0], "turn_deg": 180.0}],
    }  # fmt: skip
    am.simulate(written(tmp_path, rest, "rest.json"), out=tmp_path / "rest")
    am.diagnose([str(tmp_path / "day"), str(tmp_path / "rest")], model=bare, out=tmp_path / "diagnosis")
    (effect,) = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())["effects"]
    assert effect["name"] == "input-delay" and not effect["rivals"]
    after = am.tune(tmp_path / "diagnosis" / "diagnosis.json", target="pid")
    assert after.verdict == "gains" and after.open == ""
