"""`automarine init` on whole folders, of other people too: it is sure only where it can be, and its campaign runs."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from made_campaigns import campaign
from small_campaign import make_small_campaign
from test_init import AHEAD, ASTERN, CANONICAL, FORCE, HEADING, PULSES, PWM, TIME, Column, answer, started, write_table
from test_init import write_logs as write_four

from automarine_cli.commands.check import check
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs.columns import read_column_map
from automarine_cli.report.campaign import CampaignRun

ARM = 0.2  # m
MOMENTS = (0.4, -0.4, 0.7, -0.7, 1.0, -1.0)


def write_logs(folder: Path, columns: dict[str, Column]) -> Path:
    return write_four(folder, columns, MOMENTS)


def command(side: float) -> Column:
    """What the thruster of one side is sent [us about neutral]."""

    def column(run):  # type: ignore[no-untyped-def]
        force = side * run.command / ARM / 2
        return np.sign(force) * np.round(np.sqrt(np.abs(force) / np.where(force > 0, AHEAD, ASTERN)), 1)

    return column


PORT, STBD = command(1.0), command(-1.0)


def inertia(result: CampaignRun) -> float:
    return float(result.says["fit-yaw"].rpartition("I_r ")[2].split()[0])


def test_a_campaign_of_every_kind_with_one_question(tmp_path: Path, run: Callable[..., Result]) -> None:
    file = make_small_campaign(tmp_path / "pool")
    file.unlink()
    result = run("init", tmp_path / "pool")
    assert result.exit_code == 0, result.stderr
    assert "1 question to answer: thrusters.per_test." in result.stdout
    assert result.stdout.endswith(f"automarine run {file} -o results\n")
    assert tomllib.loads(file.read_text(encoding="utf-8"))["logs"] == {
        "thrusters": ["thrusters"], "steps": ["steps"], "manoeuvres": ["driving"], "validation": ["validation"],
    }  # fmt: skip
    with pytest.raises(SettingError, match=r"campaign\.toml: 1 question is still open: thrusters\.per_test"):
        run_campaign(file, until="check")
    answer(tmp_path / "pool", {"per_test": "2"})
    done = run_campaign(file, out=tmp_path / "out", until="fit-thrusters")
    assert [step.did for step in done.steps] == ["done", "done"]


def test_commands_in_newtons_need_no_bollard_test(tmp_path: Path) -> None:
    sides = {"left_N": lambda run: run.command / ARM / 2, "right_N": lambda run: -run.command / ARM / 2}
    write_logs(tmp_path / "logs", TIME | HEADING | sides)
    result, data = started(tmp_path)
    assert data["thrusters"] == {"map": "newtons"} and result.questions == ("vehicle.arm_m",)
    done = run_campaign(answer(tmp_path, {"arm_m": str(ARM)}), out=tmp_path / "out", until="fit-yaw")
    assert inertia(done) == pytest.approx(1.018, rel=0.08)


def test_results_are_no_logs_and_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    pool = tmp_path / "pool"
    write_logs(pool / "steps", CANONICAL)
    init(pool)
    run_campaign(pool / "campaign.toml", out=pool / "out", until="fit-yaw")
    assert (pool / "out" / "yaw" / "runs.parquet").exists()
    (pool / "broken.csv").write_text("time_s,heading_deg,tau\n0,x,1\n", encoding="utf-8")
    write_table(pool / "weather.csv", {"time_s": [0.0, 60.0], "air_degC": [11.0, 11.5]})
    engine = {"time_s": 0.1 * np.arange(60), "tau": np.repeat([0.0, 0.4], 30), "oil_bar": 0.0}
    write_table(pool / "engine.csv", engine)
    result, data = started(pool)
    assert data["logs"]["steps"] == ["steps"] and result.questions == ()
    assert "#   pool/broken.csv, run broken: row 2, column heading_deg: found 'x'" in result.text
    assert [file.path.name for file in result.survey.strangers] == ["weather.csv"]
    assert "Some logs are not used; the campaign file says which and why." in repr(result)
    assert "no column looks like a heading, a moment or a command" in result.text
    assert any("engine" in aside.file for aside in result.survey.set_aside)  # it has no heading
    with pytest.raises(LogError, match="the only logs here are in folders of results"):
        init(pool / "out")


def test_a_campaign_file_is_a_column_map(tmp_path: Path) -> None:
    write_logs(tmp_path / "runs", TIME | {"q7": HEADING["heading_deg"], "torque": lambda run: run.command})
    file = tmp_path / "campaign.toml"
    head = 'schema = "automarine/campaign/1"\n[vehicle]\narm_m = 0.3\n[thrusters]\nper_test = "?"\n[columns]\n'
    file.write_text(head + 'heading_deg = "q7"\ntau = "?"\n', encoding="utf-8")
    with pytest.raises(LogError, match=r"campaign\.toml: columns\.tau still open"):
        check([tmp_path / "runs"], columns=file)
    file.write_text(head + 'heading_deg = "q7"\ntau = "torque"\n', encoding="utf-8")
    assert len(check([tmp_path / "runs"], columns=file).runs) == len(MOMENTS)
    assert read_column_map(file).defaults == {"arm_m": 0.3}


def test_what_a_column_map_says_is_not_asked(tmp_path: Path) -> None:
    write_logs(
        tmp_path / "runs", TIME | {"q7": lambda run: -np.rad2deg(run.position) % 360, "torque": lambda run: run.command}
    )
    result, data = started(tmp_path)
    assert result.questions == ("columns.tau", "columns.heading_deg") and data["logs"]["steps"] == ["runs"]
    names = tmp_path / "names.toml"
    names.write_text('[columns]\nheading_deg = { from = "q7", sign = -1 }\ntau_Nm = "torque"\n', encoding="utf-8")
    result, data = started(tmp_path, columns=names)
    assert result.questions == ()
    assert data["columns"] == {"heading_deg": {"from": "q7", "sign": -1}, "tau_Nm": "torque"}
    assert "as --columns says, " in result.text and "turns with the moment in 6 of 6 steps" in result.text
    assert run_campaign(tmp_path / "campaign.toml", until="check").steps[0].did == "done"


def mixed(folder: Path) -> None:
    """Bollard tests and runs of one vehicle, whose columns share names that mean something else."""
    time = 1000.0 * np.arange(len(PWM))
    write_table(folder / "bollard" / "a.csv", {"time": time, "PWM_us": PWM, "yaw": 0.0, "force_N": FORCE})
    columns = {
        "time": TIME["time_s"], "yaw": HEADING["heading_deg"],
        "port_us": lambda run: 1500 + PORT(run), "stbd_us": lambda run: 1500 + STBD(run),
        "u_mps": lambda run: 0.1 * HEADING["heading_deg"](run),
    }  # fmt: skip
    write_logs(folder / "runs", columns)


@pytest.mark.slow
def test_a_mixed_folder_has_a_map_for_each_kind_of_file_and_runs(tmp_path: Path) -> None:
    mixed(tmp_path)
    result, data = started(tmp_path)
    assert data["columns"] == {
        "time_s": "time", "heading_deg": "yaw", "surge_m_s": "u_mps",
        "n_port": PULSES | {"from": "port_us"}, "n_stbd": PULSES | {"from": "stbd_us"},
    }  # fmt: skip
    assert data["columns_of"] == [{"logs": ["bollard"], "time_ms": "time", "n": PULSES}]
    assert data["logs"] == {"thrusters": ["bollard"], "steps": ["runs"], "manoeuvres": [], "validation": []}
    assert result.questions == ("vehicle.arm_m", "thrusters.per_test")
    file = answer(tmp_path, {"arm_m": str(ARM), "per_test": "1"})
    done = run_campaign(file, out=tmp_path / "out", until="fit-yaw")
    assert [step.did for step in done.steps] == ["done", "done", "done"]
    assert inertia(done) == pytest.approx(1.018, rel=0.05)  # the truth; the scatter of six runs


def pairs(folder: Path) -> None:
    """Navigation and commands of each run in a file each, on one clock."""
    for i, run in enumerate(campaign(MOMENTS, noise_deg=0.3, period=0.05)):
        heading = HEADING["heading_deg"](run)
        write_table(folder / f"nav_{i}.csv", {"t": run.time, "heading_deg": heading, "speed_mps": 0.0})
        sent = {"port_cmd": PORT(run)[1:-1], "stbd_cmd": STBD(run)[1:-1]}
        write_table(folder / f"cmd_{i}.csv", {"t": run.time[1:-1] - 0.01, **sent})


def test_what_is_joined_is_fitted_and_an_input_too(tmp_path: Path) -> None:
    pairs(tmp_path)
    join = 'join = { logs = "nav_*.csv", with = "cmd_*.csv" }'
    (tmp_path / "names.toml").write_text(f'[columns]\ntime_s = "t"\n[logs]\n{join}\n', encoding="utf-8")
    result, data = started(tmp_path, columns=tmp_path / "names.toml")
    assert data["logs"]["join"] == [{"logs": "nav_*.csv", "with": "cmd_*.csv", "take": "previous", "max_age_s": 5.0}]
    assert len(result.survey.placed["steps"]) == len(MOMENTS)
    assert data["columns"]["time_s"] == "t" and data["columns"]["n_port"] == "port_cmd"
    thrusters = fit_thrusters(write_table(tmp_path / "bench" / "a.txt.csv", {"n": PWM - 1500, "force_N": FORCE}))
    (tmp_path / "map.json").write_text(json.dumps(thrusters.to_json()), encoding="utf-8")
    file, out = answer(tmp_path, {"arm_m": str(ARM), "map": '"map.json"'}), tmp_path / "out"
    done = run_campaign(file, out=out, until="fit-yaw")
    assert [step.did for step in done.steps] == ["done", "skipped", "done"]
    assert done.says["check"] == f"{len(MOMENTS)} logs, {len(MOMENTS)} runs"
    assert "joined to the clock of" in (out / "check" / "check.json").read_text(encoding="utf-8")
    assert inertia(done) == pytest.approx(1.018, rel=0.08)
    assert run_campaign(file, out=out, until="check").steps[0].did == "kept"
    changed = tmp_path / "cmd_0.csv"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert run_campaign(file, out=out, until="check").steps[0].did == "done"
