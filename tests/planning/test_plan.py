"""`automarine plan` end to end: what it writes, that limits are kept, the same bytes each time, and what it refuses."""

import json
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from specified import read_specification

import automarine_cli as am
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.pipeline.records import Codec
from automarine_cli.planning.campaign import Plan
from automarine_cli.planning.candidates import Limits, example_limits

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


def write(path: Path, data: object) -> Path:
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write(tmp_path / "yaw_model.json", MODEL)


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    return write(tmp_path / "limits.toml", SHORT)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Short limits and a model, to be read."""
    folder = tmp_path_factory.mktemp("planned")
    write(folder / "limits.toml", SHORT)
    write(folder / "yaw_model.json", MODEL)
    return folder


@pytest.fixture(scope="module")
def plan(folder: Path) -> Plan:
    return am.plan(folder / "yaw_model.json", limits=folder / "limits.toml", out=folder / "plan")


def test_every_limit_is_kept_and_one_is_used_up(plan: Plan) -> None:
    data = plan.to_json()
    totals = data["totals"]
    assert totals["runs"] <= 9 and totals["motion_s"] <= 70 and totals["pool_min"] <= 16
    assert totals["battery_left_Ah"] >= 0.2 * 0.12
    assert totals["runs"] == 9 or totals["motion_s"] > 60 or totals["pool_min"] > 14.5
    *before, last = data["planned"]
    spent = sum(3.0 + sum(s for _, s in run["commands"]) + run["wait_s"] for run in before)
    assert last["begins_s"] == pytest.approx(spent)
    for name, errors in data["parameters"].items():
        assert errors["with_earlier_runs"]["stderr"] < min(errors[of]["stderr"] for of in ("now", "new_runs")), name


@pytest.mark.parametrize(("minutes", "runs", "sizes"), [(60, 48, 12), (60, 24, 6), (14, 24, 3), (9, 24, 2)])
def test_the_first_campaign_needs_no_model(tmp_path: Path, minutes: int, runs: int, sizes: int) -> None:
    """The paper's steps, each twice and to both sides, at as many sizes as the limits allow; nothing is foretold."""
    limits = write(tmp_path / "limits.toml", f"pool = {{ minutes = {minutes}, runs = {runs}, half_turn_s = 6 }}")
    first = am.plan(limits=limits, out=tmp_path / "plan")
    moments = Counter(moment for run in first.candidates for moment, _ in run.commands)
    assert moments == {float(f"{side * i / sizes:.3g}"): 2 for i in range(1, sizes + 1) for side in (1, -1)}
    assert first.candidates[0].label == first.candidates[-1].label == "step_+1.0_180deg"
    assert first.candidates[0].driven_s == 6.0 and first.minutes[-1] <= minutes
    assert [abs(slot.turns) for slot in first.slots] == pytest.approx([180.0] * len(first.slots), abs=5.0)
    data = first.to_json()
    assert data["parameters"] == {} and data["fit_command"] == "automarine fit-yaw LOGS -o out/yaw"
    page = (tmp_path / "plan" / "plan.md").read_text()
    assert "No intervals can be foretold without a model" in page and "plan.png" not in page
    assert not (tmp_path / "plan" / "plan.png").exists()
    assert len(am.simulate(tmp_path / "plan" / "plan.toml").runs) == 4 * sizes


def test_it_can_be_rehearsed(plan: Plan, folder: Path) -> None:
    """The specification holds the runs of the sheet, at their times and start headings."""
    place = folder / "plan" / "plan.toml"
    rehearsed, slots = am.simulate(place), plan.slots
    assert [run.plan.name for run in rehearsed.runs] == [slot.name for slot in slots]
    assert [run.plan.start for run in rehearsed.runs] == pytest.approx([slot.begins for slot in slots])
    assert read_specification(place).scatter.gain == pytest.approx(0.03)


def test_commands_go_through_the_map_and_moments_stay_within_it(run: Run, model: Path, tmp_path: Path) -> None:
    curves = {
        side: {"a": a, "p": 2.0, "n_0": 0.0, "n_sat": None} for side, a in (("forward", 2.6e-4), ("backward", 0.7e-4))
    }
    thrusters = write(tmp_path / "thrusters.json", {
        "schema": "automarine/thruster-map/1", "form": "square", "forward": {"a": {"value": 2.6e-4}},
        "backward": {"a": {"value": 0.7e-4}}, "parameters": curves,
    })  # fmt: skip
    largest = SHORT.replace("largest = 1.2\n", "") + "[thrusters]\nlargest_command = 150\nnu_in_Nm = 0.3\n"
    limits = write(tmp_path / "limits.toml", largest)
    planned = run("plan", model, "--limits", limits, "--thrusters", thrusters, "--arm", 0.11, "-o", tmp_path / "plan")
    assert planned.exit_code == 0, planned.output
    data = json.loads((tmp_path / "plan" / "plan.json").read_text())
    most = 0.11 * 2 * 0.7e-4 * 150**2 / 0.3
    sizes = [abs(moment) for each in data["planned"] for moment, _ in each["commands"]]
    assert 0.99 * most < max(sizes) <= most
    rows = (tmp_path / "plan" / data["planned"][0]["command_file"]).read_text().splitlines()
    assert rows[0] == "time_s,n_port,n_stbd"
    port, starboard = (float(cell) for cell in rows[2].split(",")[1:])
    assert 0.11 * (2.6e-4 * port**2 + 0.7e-4 * starboard**2) == pytest.approx(0.3 * max(sizes), rel=1e-4)


@pytest.mark.slow
def test_a_diagnosis_is_split_first(model: Path, limits: Path, tmp_path: Path) -> None:
    diagnosis = write(tmp_path / "diagnosis.json", DIAGNOSIS)
    data = am.plan(model, diagnosis=diagnosis, limits=limits, out=tmp_path / "plan").to_json()
    pair = ("dead-band", "coulomb-drag")
    assert {(split["true"], split["other"]) for split in data["splits"]} == {pair, pair[::-1]}
    assert all(split["evidence"] > 20.0 for split in data["splits"])
    assert any("splits dead-band from coulomb-drag" in run["why"] for run in data["planned"])
    assert data["fit_command"].startswith("automarine diagnose")
    assert set(data["parameters"]) == {"I_r", "k_rr", "dead-band width", "inertial turn angle"}
    assert tomllib.loads((tmp_path / "plan" / "plan.toml").read_text())["effects"][0]["name"] == "dead-band"


def test_the_example_is_the_default(run: Run) -> None:
    shown = run("plan", "--example-limits")
    assert shown.exit_code == 0 and shown.output == example_limits()
    assert Codec("limits.toml").read(Limits, tomllib.loads(example_limits())) == Limits()
    every = tomllib.loads(example_limits().replace("\n# ", "\n").split("\n\n", 1)[1])
    listed = {f"{table}.{key}" for table, keys in every.items() if isinstance(keys, dict) for key in keys}
    tables = {table: settings for table, settings in vars(Limits()).items() if table != "schema"}
    assert listed == {f"{table}.{key}" for table, settings in tables.items() for key in vars(settings)}


@pytest.mark.parametrize(
    ("key", "content", "why"),
    [
        ("limits", "[pool]\nminuts = 3", r'limits.toml: pool: unknown key "minuts"; did you mean "minutes"\?'),
        ("limits", "[pool]\nminutes = 1", "the limits allow no campaign: 2 runs already need 1.24 of pool.minutes"),
        ("limits", "[battery]\ncharge_Ah = 0.001", r"of battery.charge_Ah \(less the reserve\)"),
        ("limits", 'schema = "other/1"', "expected the line schema"),
        ("limits", '[runs]\nkinds = ["coast-down"]', "runs: kinds .* expected 'step' among them"),
        ("limits", '[runs]\nkinds = ["step", "spiral"]', "kinds names 'spiral'"),
        ("limits", "[runs]\nvoltages_V = [24, -1]", "voltages_V holds -1"),
        ("limits", "[pool]\nruns = 1", "pool: runs is 1; expected 2 to 500"),
        ("limits", "[pool]\nstart_headings_deg = []", "empty list"),
        ("diagnosis", {"schema": "automarine/yaw-model/1"}, "give the diagnosis.json that `automarine diagnose` writ"),
        ("diagnosis", {"moment_unit": "N m"}, "a diagnosis of moments in"),
        ("diagnosis", {"effects": [{"name": "gremlin", "parameters": {}}]}, r'effects\[0\]: name: found "gremlin"'),
        ("diagnosis", {"effects": [{"name": "dead-band", "parameters": {}}]}, "width has no value"),
        ("model", {"moment_unit": "N m"}, r"say how large they may be with moments\.largest"),
        ("model", {"schema": "other"}, "expected"),
        ("parameters", ["k_r"], "no parameter 'k_r' to plan for; it has I_r, k_rr"),
        ("arm", 0.1, "--arm goes with"),
        ("model", None, "--diagnosis and --parameter go with a model"),
    ],
)
def test_refusals(model: Path, tmp_path: Path, key: str, content: Any, why: str) -> None:
    if key == "limits":
        content = write(tmp_path / "limits.toml", content)
    elif isinstance(content, dict):
        content = write(tmp_path / f"{key}.json", {"model": MODEL, "diagnosis": DIAGNOSIS}[key] | content)
    with pytest.raises((ModelError, SettingError), match=why):
        am.plan(**{"model": model, **({} if content else {"parameters": ["k_rr"]}), key: content})


@pytest.mark.slow
def test_what_planned_runs_cannot_show_is_left_out(model: Path, limits: Path, tmp_path: Path) -> None:
    value = {"value": 0.05, "stderr": 0.01, "ci95": [0.03, 0.07], "unit": ""}
    coupling = {"name": "cross-coupling", "parameters": {"c": value}, "rivals": []}
    (band,) = DIAGNOSIS["effects"]
    rival = DIAGNOSIS | {"effects": [band | {"rivals": [{"name": "cross-coupling"}]}]}
    plan = am.plan(model, diagnosis=write(tmp_path / "rival.json", rival), limits=limits)
    assert "cross-coupling is left open: it needs the column 'surge'" in plan.to_json()["notes"][1]
    both = write(tmp_path / "both.json", DIAGNOSIS | {"effects": [band | {"rivals": []}, coupling]})
    coupled = MODEL | {"effects": [{"name": "cross-coupling", "parameters": {"c": 0.05}}]}
    of_diagnosis = am.plan(model, diagnosis=both, limits=limits)
    of_model = am.plan(write(tmp_path / "coupled.json", coupled), limits=limits)
    for plan in (of_diagnosis, of_model):
        assert "cross-coupling is left out: it acts by the column 'surge'" in " ".join(plan.to_json()["notes"])
    assert of_model.slots and "cross-coupling" not in str(list(of_model.alone))
