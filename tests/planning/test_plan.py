"""`automarine plan` end to end: what it writes, that limits are kept, the same bytes each time, and what it refuses."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from specified import read_specification

import automarine_cli as am
from automarine_cli.errors import AutomarineError, ModelError, SettingError
from automarine_cli.pipeline.records import Codec
from automarine_cli.planning.campaign import Plan
from automarine_cli.planning.candidates import Limits, Pool, example_limits

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


MODEL = {
    "schema": "automarine/yaw-model/1", "moment_unit": "nu", "preferred": "3",
    "models": {"3": {"I_r": estimate(1.018, 0.02), "k_rr": estimate(1.257, 0.02)}},
    "inertial_turn_angle_rad": estimate(0.81, 0.01), "heading_noise_deg": 1.0,
    "gain_scatter": estimate(0.03, 0.2), "runs": {"used": 12, "set_aside": []},
}  # fmt: skip
DIAGNOSIS = {
    "schema": "automarine/diagnosis/1", "verdict": "named", "moment_unit": "nu",
    "effects": [{
        "name": "dead-band", "parameters": {"width": estimate(0.03, 0.1)},
        "rivals": [{"name": "coulomb-drag", "confidence": 0.4, "split_by": ""}],
    }],
    "base": {"I_r": {"after": estimate(1.0, 0.02)}, "k_rr": {"after": estimate(1.25, 0.02)}},
    "gap": {"fitted_runs": {"before_deg": 3.0, "after_deg": 1.0, "noise_floor_deg": 0.9}, "held_out_runs": None},
}  # fmt: skip


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write(tmp_path / "yaw_model.json", MODEL)


@pytest.fixture
def diagnosis(tmp_path: Path) -> Path:
    return write(tmp_path / "diagnosis.json", DIAGNOSIS)


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    path = tmp_path / "limits.toml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Path]:
    """One plan within short limits, and the folder that holds it, its model and its limits."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "limits.toml").write_text(SHORT)
    model = write(folder / "yaw_model.json", MODEL)
    return am.plan(model, limits=folder / "limits.toml", out=folder / "plan"), folder


def write(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data))
    return path


def test_every_limit_is_kept_and_one_is_used_up(made: tuple[Plan, Path]) -> None:
    told = made[0].to_json()
    totals = told["totals"]
    assert totals["runs"] <= 9 and totals["motion_s"] <= 70 and totals["pool_min"] <= 16
    assert totals["battery_left_Ah"] >= 0.2 * 0.12
    assert totals["runs"] == 9 or totals["motion_s"] > 60 or totals["pool_min"] > 14.5
    last = told["planned"][-1]
    assert last["begins_s"] == pytest.approx(
        sum(3.0 + sum(s for _, s in one["commands"]) + one["wait_s"] for one in told["planned"][:-1])
    )


def test_new_runs_narrow_what_is_known(made: tuple[Plan, Path]) -> None:
    for name, one in made[0].to_json()["parameters"].items():
        assert one["with_earlier_runs"]["stderr"] < min(one["now"]["stderr"], one["new_runs"]["stderr"]), name


def test_one_parameter_is_narrowed_more_when_it_alone_is_wanted(made: tuple[Plan, Path]) -> None:
    folder = made[1]
    alone = am.plan(folder / "yaw_model.json", limits=folder / "limits.toml", parameters="k_rr", seed=1)
    errors = [one.campaign.plan.stderr_percent["k_rr"][-1] for one in (alone, made[0])]
    assert errors[0] <= errors[1] * 1.001
    assert alone.to_json()["planned_for"] == ["k_rr"]


def test_another_seed_draws_another_order_of_the_same_runs(made: tuple[Plan, Path]) -> None:
    folder = made[1]
    other = am.plan(folder / "yaw_model.json", limits=folder / "limits.toml", seed=1).campaign
    own = made[0].campaign
    first, second = ([one.label for one in campaign.candidates] for campaign in (own, other))
    assert first != second and sorted(first) == sorted(second)


def test_it_can_be_rehearsed(made: tuple[Plan, Path]) -> None:
    """The specification holds the runs of the sheet, at their times and start headings."""
    place = made[1] / "plan" / "plan.toml"
    rehearsed, slots = am.simulate(place), made[0].campaign.slots
    assert [run.plan.name for run in rehearsed.runs] == [slot.name for slot in slots]
    assert [run.plan.start for run in rehearsed.runs] == pytest.approx([slot.begins for slot in slots])
    assert read_specification(place).scatter.gain == pytest.approx(0.03)


def test_thrusters_and_their_current(run: Run, model: Path, tmp_path: Path) -> None:
    """Commands go through the map, moments stay within it, and the battery is counted from the tests' current."""
    curves = {
        side: {"a": a, "p": 2.0, "n_0": 0.0, "n_sat": None} for side, a in (("forward", 2.6e-4), ("backward", 0.7e-4))
    }
    thrusters = write(tmp_path / "thrusters.json", {
        "schema": "automarine/thruster-map/1", "form": "square", "forward": {"a": {"value": 2.6e-4}},
        "backward": {"a": {"value": 0.7e-4}}, "parameters": curves,
    })  # fmt: skip
    rows = ["n,force_N,current_A"]
    for n in range(-150, 151, 25):
        force = (2.6e-4 if n > 0 else -0.7e-4) * n * n
        rows.append(f"{n},{force:.6f},{(2.0 + 3.0 * abs(force) ** 1.5) / 24:.6f}")
    (tmp_path / "bollard.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "limits.toml").write_text(
        SHORT.replace("largest = 1.2\n", "") + "[thrusters]\nlargest_command = 150\nnu_in_Nm = 0.3\n"
    )
    done = run(
        "plan", model, "--limits", tmp_path / "limits.toml", "--thrusters", thrusters, "--arm", 0.11,
        "--thruster-tests", tmp_path / "bollard.csv", "-o", tmp_path / "plan",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "plan" / "plan.json").read_text())
    most = 0.11 * 2 * 0.7e-4 * 150**2 / 0.3
    sizes = [abs(moment) for one in told["planned"] for moment, _ in one["commands"]]
    assert 0.99 * most < max(sizes) <= most
    rows = (tmp_path / "plan" / told["planned"][0]["command_file"]).read_text().splitlines()
    assert rows[0] == "time_s,n_port,n_stbd"
    port, starboard = (float(cell) for cell in rows[2].split(",")[1:])
    assert 0.11 * (2.6e-4 * port**2 + 0.7e-4 * starboard**2) == pytest.approx(0.3 * max(sizes), rel=1e-4)
    force = 0.3 * max(sizes) / 0.22
    assert f"{2 * 3.0 * force**1.5 / 24:.3g} A more" in told["notes"][0]


@pytest.mark.slow
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
    goal = Codec("limits").read(Limits, {"goal": {"half_width_percent": 2.0}, "moments": {"levels": 3}})
    made = am.plan(model, limits=Limits(pool=pool, moments=goal.moments, goal=goal.goal))
    assert len(made.campaign.slots) < 20
    for one in made.campaign.together.values():
        assert 50.0 * (one.ci95[1] - one.ci95[0]) / one.value < 2.2


def test_half_turns_are_planned_of_steps_alone(model: Path) -> None:
    runs = Codec("limits").read(Limits, {"runs": {"fit": "half-turns"}, "moments": {"levels": 3}})
    made = am.plan(model, limits=runs)
    assert {one.kind for one in made.campaign.candidates} == {"step"}
    assert made.to_json()["fit_command"].startswith("automarine fit-yaw LOGS --fit-to half-turns")


def test_the_example_is_the_default(run: Run) -> None:
    shown = run("plan", "--example-limits")
    assert shown.exit_code == 0 and shown.output == example_limits()
    assert Codec("limits.toml").read(Limits, tomllib.loads(example_limits())) == Limits()
    every = example_limits().replace("\n# ", "\n")
    keys = {
        f"{table}.{key}" for table, held in tomllib.loads(every.split("\n\n", 1)[1]).items()
        if isinstance(held, dict) for key in held
    }  # fmt: skip
    told = {f"{table}.{key}" for table, held in vars(Limits()).items() if table != "schema" for key in vars(held)}
    assert keys == told


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[pool]\nminuts = 3", r'limits.toml: pool: unknown key "minuts"; did you mean "minutes"\?'),
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
        ({"schema": "automarine/yaw-model/1"}, "give the diagnosis.json that `automarine diagnose` writes"),
        ({"moment_unit": "N m"}, "a diagnosis of moments in"),
        ({"effects": [{"name": "gremlin", "parameters": {}}]}, r'effects\[0\]: name: found "gremlin"'),
        ({"effects": [{"name": "dead-band", "parameters": {}}]}, "width has no value"),
    ],
)
def test_a_wrong_diagnosis_is_refused(model: Path, diagnosis: Path, change: dict[str, object], why: str) -> None:
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


@pytest.mark.slow
def test_a_rival_that_planned_runs_cannot_show_is_left_open(model: Path, diagnosis: Path, limits: Path) -> None:
    told = json.loads(diagnosis.read_text())
    told["effects"][0]["rivals"] = [{"name": "cross-coupling"}]
    made: Plan = am.plan(model, diagnosis=write(diagnosis, told), limits=limits)
    assert "cross-coupling is left open: it needs the column 'surge'" in made.to_json()["notes"][1]
    held = json.loads(model.read_text())
    held["effects"] = [{"name": "cross-coupling", "parameters": {"c": 0.05}}]
    made = am.plan(write(model, held), limits=limits)
    assert "cross-coupling is left out: it acts by the column 'surge'" in " ".join(made.to_json()["notes"])
    assert made.campaign.slots and "cross-coupling" not in str(list(made.campaign.alone))
    estimate = {"value": 0.05, "stderr": 0.01, "ci95": [0.03, 0.07], "unit": ""}
    told["effects"].append({"name": "cross-coupling", "parameters": {"c": estimate}, "rivals": []})
    held["effects"] = []
    made = am.plan(write(model, held), diagnosis=write(diagnosis, told), limits=limits)
    assert "cross-coupling is left out: it acts by the column 'surge'" in " ".join(made.to_json()["notes"])


def test_nothing_open_is_said(model: Path, diagnosis: Path, limits: Path) -> None:
    told = json.loads(diagnosis.read_text())
    told["effects"] = []
    made: Plan = am.plan(model, diagnosis=write(diagnosis, told), limits=limits)
    assert "leaves no rivals open to split" in made.to_json()["notes"][1]
    assert made.campaign.splits == ()
