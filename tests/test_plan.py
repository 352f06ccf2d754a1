"""`automarine plan` end to end: what it writes, that limits are kept, the same bytes each time, and what it refuses."""

import csv
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

import automarine_cli as am
from automarine_cli.errors import AutomarineError, ModelError, SettingError
from automarine_cli.pipeline.recipe import from_mapping
from automarine_cli.planning.limits import EXAMPLE, Limits, Pool
from automarine_cli.simulation.specification import read_specification
from automarine_cli.workflows.plan import Plan

Run = Callable[..., Result]

SHORT = """
schema = "automarine/plan-limits/1"
[pool]
minutes = 16
runs = 9
motion_s = 70
[moments]
largest = 1.2
levels = 3
[battery]
charge_Ah = 0.12
"""


def estimate(value: float, relative: float) -> dict[str, Any]:
    return {"value": value, "stderr": relative * value, "ci95": [0.9 * value, 1.1 * value], "unit": "nu s²"}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write(tmp_path / "yaw_model.json", {
        "schema": "automarine/yaw-model/1", "moment_unit": "nu", "preferred": "3",
        "models": {"3": {"I_r": estimate(1.018, 0.02), "k_rr": estimate(1.257, 0.02)}},
        "inertial_turn_angle_rad": estimate(0.81, 0.01), "heading_noise_deg": 1.0,
        "gain_scatter": estimate(0.03, 0.2), "runs": {"used": 12, "set_aside": []},
    })  # fmt: skip


@pytest.fixture
def diagnosis(tmp_path: Path) -> Path:
    return write(tmp_path / "diagnosis.json", {
        "schema": "automarine/diagnosis/1", "verdict": "named", "moment_unit": "nu",
        "effects": [{
            "name": "dead-band", "parameters": {"width": estimate(0.03, 0.1)},
            "rivals": [{"name": "coulomb-drag", "confidence": 0.4, "split_by": ""}],
        }],
        "base": {"I_r": {"after": estimate(1.0, 0.02)}, "k_rr": {"after": estimate(1.25, 0.02)}},
    })  # fmt: skip


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    path = tmp_path / "limits.toml"
    path.write_text(SHORT)
    return path


def write(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data))
    return path


def test_what_is_written(run: Run, model: Path, limits: Path, tmp_path: Path) -> None:
    out = tmp_path / "plan"
    done = run("plan", model, "--limits", limits, "-o", out)
    assert done.exit_code == 0, done.output
    told = json.loads((out / "plan.json").read_text())
    rows = list(csv.DictReader((out / "plan.csv").read_text().splitlines()))
    assert [row["name"] for row in rows] == [one["name"] for one in told["planned"]]
    assert rows[0]["do"] == rows[-1]["do"] == "+1.2 nu for 3.8 s"
    for one in told["planned"]:
        played = list(csv.reader((out / one["command_file"]).read_text().splitlines()))
        assert played[0] == ["time_s", "tau"]
        assert [float(cell) for cell in played[2]] == [3.0, one["commands"][0][0]]
    assert "automarine fit-yaw LOGS --fit-to whole-runs" in (out / "plan.md").read_text()
    assert (out / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((out / "manifest.json").read_text())["command"] == "plan"


def test_every_limit_is_kept_and_one_is_used_up(model: Path, limits: Path) -> None:
    told = am.plan(model, limits=limits).to_json()
    totals = told["totals"]
    assert totals["runs"] <= 9 and totals["motion_s"] <= 70 and totals["pool_min"] <= 16
    assert totals["battery_left_Ah"] >= 0.2 * 0.12
    assert totals["runs"] == 9 or totals["motion_s"] > 60 or totals["pool_min"] > 14.5
    last = told["planned"][-1]
    assert last["begins_s"] == pytest.approx(
        sum(3.0 + sum(s for _, s in one["commands"]) + one["wait_s"] for one in told["planned"][:-1])
    )


def test_new_runs_narrow_what_is_known(model: Path, limits: Path) -> None:
    told = am.plan(model, limits=limits).to_json()["parameters"]
    for name, one in told.items():
        assert one["with_earlier_runs"]["stderr"] < min(one["now"]["stderr"], one["new_runs"]["stderr"]), name


def test_one_parameter_is_narrowed_more_when_it_alone_is_wanted(model: Path, limits: Path) -> None:
    both, alone = am.plan(model, limits=limits), am.plan(model, limits=limits, parameters="k_rr")
    errors = [made.campaign.plan.percent["k_rr"][-1] for made in (alone, both)]
    assert errors[0] <= errors[1] * 1.001
    assert alone.to_json()["planned_for"] == ["k_rr"]


def test_the_same_bytes_each_time_and_another_order_for_another_seed(
    model: Path, limits: Path, tmp_path: Path
) -> None:
    for name, seed in (("one", 0), ("two", 0), ("three", 1)):
        am.plan(model, limits=limits, out=tmp_path / name, seed=seed)
    one, two, three = (
        {path.relative_to(tmp_path / name): path.read_bytes() for path in (tmp_path / name).rglob("*.*")}
        for name in ("one", "two", "three")
    )
    assert one == two
    assert one[Path("plan.csv")] != three[Path("plan.csv")]


def test_it_can_be_rehearsed(model: Path, limits: Path, tmp_path: Path) -> None:
    """The specification holds the runs of the sheet, at their times and start headings."""
    made = am.plan(model, limits=limits, out=tmp_path / "plan")
    rehearsed = am.simulate(tmp_path / "plan" / "plan.toml")
    slots = made.campaign.slots
    assert [run.plan.name for run in rehearsed.runs] == [slot.name for slot in slots]
    assert [run.plan.start for run in rehearsed.runs] == pytest.approx([slot.begins for slot in slots])
    assert read_specification(tmp_path / "plan" / "plan.toml").scatter.gain == pytest.approx(0.03)


def test_a_diagnosis_is_split_first(model: Path, diagnosis: Path, limits: Path, tmp_path: Path) -> None:
    made = am.plan(model, diagnosis=diagnosis, limits=limits, out=tmp_path / "plan")
    told = made.to_json()
    assert {(one["true"], one["other"]) for one in told["splits"]} == {
        ("dead-band", "coulomb-drag"), ("coulomb-drag", "dead-band"),
    }  # fmt: skip
    for one in told["splits"]:
        assert one["evidence"] > 20.0 > one["evidence_of_grid"]
    assert any("splits dead-band from coulomb-drag" in one["why"] for one in told["planned"])
    assert told["fit_command"].startswith("automarine diagnose")
    assert set(told["parameters"]) == {"I_r", "k_rr", "dead-band width", "inertial turn angle"}
    assert tomllib.loads((tmp_path / "plan" / "plan.toml").read_text())["effects"][0]["name"] == "dead-band"


def test_a_goal_needs_fewer_runs(model: Path) -> None:
    pool = Pool(minutes=60, runs=24)
    goal = from_mapping(Limits, {"goal": {"half_width_percent": 2.0}, "moments": {"levels": 3}}, "limits")
    made = am.plan(model, limits=Limits(pool=pool, moments=goal.moments, goal=goal.goal))
    assert len(made.campaign.slots) < 20
    for one in made.campaign.together.values():
        assert 50.0 * (one.ci95[1] - one.ci95[0]) / one.value < 2.5


def test_half_turns_are_planned_of_steps_alone(model: Path) -> None:
    runs = from_mapping(Limits, {"runs": {"fit": "half-turns"}, "moments": {"levels": 3}}, "limits")
    made = am.plan(model, limits=runs)
    assert {one.kind for one in made.campaign.candidates} == {"step"}
    assert made.to_json()["fit_command"].startswith("automarine fit-yaw LOGS --fit-to half-turns")


def test_the_example_is_the_default(run: Run) -> None:
    shown = run("plan", "--example-limits")
    assert shown.exit_code == 0 and shown.output == EXAMPLE
    assert from_mapping(Limits, tomllib.loads(EXAMPLE), "limits.toml") == Limits()
    every = EXAMPLE.replace("\n# ", "\n")
    keys = {
        f"{table}.{key}" for table, held in tomllib.loads(every.split("\n\n", 1)[1]).items()
        if isinstance(held, dict) for key in held
    }  # fmt: skip
    told = {
        f"{table}.{key}" for table, held in vars(Limits()).items() if table != "schema" for key in vars(held)
    }
    assert keys == told


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[pool]\nminuts = 3", r"limits.toml: pool: unknown key 'minuts' \(did you mean 'minutes'\?\)"),
        ("[pool]\nminutes = 1", r"the limits allow no campaign: two runs already need 1.24 of pool.minutes"),
        ("[battery]\ncharge_Ah = 0.001", r"of battery.charge_Ah \(less the reserve\)"),
        ('schema = "other/1"', "expected the line schema"),
    ],
)
def test_limits_are_refused(model: Path, tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(SettingError, match=why):
        am.plan(model, limits=path)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (
            {"schema": "automarine/yaw-model/1"},
            "expected the diagnosis.json that `automarine diagnose` writes",
        ),
        ({"moment_unit": "N m"}, "a diagnosis of moments in"),
        ({"effects": [{"name": "gremlin", "parameters": {}}]}, r'effects\[0\]: name: found "gremlin"'),
        ({"effects": [{"name": "dead-band", "parameters": {}}]}, "width has no value"),
    ],
)
def test_a_wrong_diagnosis_is_refused(
    model: Path, diagnosis: Path, change: dict[str, object], why: str
) -> None:
    write(diagnosis, json.loads(diagnosis.read_text()) | change)
    with pytest.raises(ModelError, match=why):
        am.plan(model, diagnosis=diagnosis)


def test_other_refusals(model: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no parameter 'k_r' to plan for; it has I_r, k_rr"):
        am.plan(model, parameters=["k_r"])
    with pytest.raises(SettingError, match="--arm goes with"):
        am.plan(model, arm=0.1)
    newtons = json.loads(model.read_text()) | {"moment_unit": "N m"}
    with pytest.raises(SettingError, match=r"say how large they may be with moments\.largest"):
        am.plan(write(tmp_path / "newton.json", newtons))
    with pytest.raises(AutomarineError, match="expected"):
        am.plan(write(tmp_path / "none.json", {"schema": "other"}))


def test_nothing_open_is_said(model: Path, diagnosis: Path, limits: Path) -> None:
    told = json.loads(diagnosis.read_text())
    told["effects"] = []
    made: Plan = am.plan(model, diagnosis=write(diagnosis, told), limits=limits)
    assert "leaves no rivals open" in made.to_json()["notes"][1]
    assert made.campaign.splits == ()
