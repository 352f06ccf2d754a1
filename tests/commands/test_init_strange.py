"""`automarine init` on files of other people: it is sure only where it can be, and its campaign runs."""

import json
import os
import pty
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from made_campaigns import campaign
from repository import ROOT

from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import RunError, SettingError
from automarine_cli.report.campaign_file import NewCampaign, answered

PWM = np.arange(1100.0, 1901.0, 25.0)
AHEAD, ASTERN, ARM = 3.0e-4, 2.3e-4, 0.2  # N per us squared; m
FORCE = np.where(PWM > 1500, AHEAD, -ASTERN) * (PWM - 1500) ** 2
RPM = np.round(9.5 * np.abs(PWM - 1500))
MOMENTS = (0.4, -0.4, 0.7, -0.7, 1.0, -1.0)


def table(path: Path, columns: Mapping[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values()))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def command(force: np.ndarray) -> np.ndarray:
    """What makes one thruster give a force [us about neutral]."""
    return np.sign(force) * np.round(np.sqrt(np.abs(force) / np.where(force > 0, AHEAD, ASTERN)), 1)


def steps(
    folder: Path, columns: Callable[[Any, np.ndarray, np.ndarray], Mapping[str, Any]], start: float = 0.0
) -> None:
    """Step runs of known truth as CSV files, each of the columns that are made of the run and both commands."""
    for run in campaign(MOMENTS, noise_deg=0.3):
        each = run.command / ARM / 2
        table(folder / f"{run.name}.csv", columns(run, command(each), command(-each)))


def asked(folder: Path, **how: Any) -> tuple[NewCampaign, dict[str, Any]]:
    """What `init` makes of a folder, and the data in its campaign file."""
    found = init(folder, overwrite=True, **how)
    return found, tomllib.loads(found.text)


def answer(folder: Path, answers: Mapping[str, str]) -> Path:
    file = folder / "campaign.toml"
    file.write_text(answered(file.read_text(encoding="utf-8"), lambda key, _: answers[key]), encoding="utf-8")
    return file


PULSES = {"from": "PWM_us", "unit": "us", "subtract": 1500}
SIGNALS: list[tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]] = [
    # pulses; the neutral by the sign of the force
    ({"PWM_us": PWM, "force_kgf": FORCE / 9.80665}, {"n": {"from": "PWM_us", "unit": "us", "subtract": 1500}}, ()),
    # the same under a name without a unit
    ({"cmd": PWM, "force_N": FORCE}, {"n": {"from": "cmd", "unit": "us", "subtract": 1500}}, ()),
    # unsigned speed, directed by the force
    ({"rpm": RPM, "force_N": FORCE}, {"n": {"from": "rpm", "sign_from": "force_N"}}, ()),
    # a force of one sign, directed by the command
    (
        {"PWM_us": PWM, "thrust_kg": np.abs(FORCE) / 9.80665},
        {
            "n": {"from": "PWM_us", "unit": "us", "subtract": 1500},
            "force_kgf": {"from": "thrust_kg", "sign_from": {"from": "PWM_us", "subtract": 1500}},
        },
        (),
    ),
    # percent about 50
    (
        {"throttle_pct": (PWM - 1100) / 8, "load_N": FORCE},
        {"n": {"from": "throttle_pct", "subtract": 50.0}, "force_N": "load_N"},
        (),
    ),
    # percent from 0, ahead only; and of both ways with a force of one sign
    (
        {"throttle_pct": (PWM - 1100) / 8, "load_N": (PWM - 1100) ** 2 / 5e3},
        {"n": "throttle_pct", "force_N": "load_N"},
        (),
    ),
    (
        {"throttle_pct": (PWM - 1100) / 8, "load_N": np.abs(FORCE)},
        {
            "n": {"from": "throttle_pct", "subtract": 50.0},
            "force_N": {"from": "load_N", "sign_from": {"from": "throttle_pct", "subtract": 50.0}},
        },
        (),
    ),
    # thrust is a throttle where another column is the force
    ({"thrust": (PWM - 1500) / 400, "load_kg": FORCE / 9.80665}, {"n": "thrust", "force_kgf": "load_kg"}, ()),
    # and asked about where none is
    ({"PWM_us": PWM, "thrust": (PWM - 1500) / 400}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    # volts of a load cell are no supply and no force
    ({"PWM_us": PWM, "load_V": 0.013 + 1e-4 * FORCE}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    # a supply under load is
    (
        {"PWM_us": PWM, "force_N": FORCE, "v_load_V": 16 - 0.01 * np.abs(FORCE)},
        {"n": PULSES, "voltage_V": "v_load_V"},
        (),
    ),
    # ahead is logged as negative force
    (
        {"PWM_us": PWM, "force_N": -FORCE},
        {"n": PULSES, "force_N": {"from": "force_N", "sign": "?"}},
        ("columns.force_N.sign",),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("columns", "rules", "questions"), SIGNALS, ids=[" ".join(one[0]) for one in SIGNALS])
def test_what_commands_a_thruster_is_read_from_its_neutral(
    tmp_path: Path, columns: dict[str, Any], rules: dict[str, Any], questions: tuple[str, ...]
) -> None:
    table(tmp_path / "bench" / "a.csv", columns)
    found, data = asked(tmp_path)
    assert data["columns"] == rules
    assert found.questions == (*questions, "thrusters.per_test")
    file = answer(tmp_path, {"per_test": "1", 'force_N, from "force_N", sign': "-1", "force_N": "thrust"})
    if questions == ("columns.force_N",):
        return  # there is no force
    done = run_campaign(file, out=tmp_path / "out", until="fit-thrusters")
    assert [one.did for one in done.steps] == ["done", "done"]
    assert "R² 1.000" in done.says["fit-thrusters"] or "R² 0.99" in done.says["fit-thrusters"]


def mixed(folder: Path) -> None:
    """Bollard tests and runs of one vehicle, whose columns share names that mean something else."""
    time = 1000.0 * np.arange(len(PWM))
    table(folder / "bollard" / "a.csv", {"time": time, "PWM_us": PWM, "yaw": 0 * PWM, "force_N": FORCE})

    def columns(run: Any, port: np.ndarray, stbd: np.ndarray) -> Mapping[str, Any]:
        heading = np.rad2deg(run.position) % 360
        return {
            "time": run.time,
            "yaw": heading,
            "port_us": 1500 + port,
            "stbd_us": 1500 + stbd,
            "u_mps": 0.1 * heading,
        }

    steps(folder / "runs", columns)


@pytest.mark.slow
def test_a_mixed_folder_has_a_map_for_each_kind_of_file_and_runs(tmp_path: Path) -> None:
    mixed(tmp_path)
    found, data = asked(tmp_path)
    assert data["columns"] == {
        "time_s": "time", "heading_deg": "yaw", "surge_m_s": "u_mps",
        "n_port": {"from": "port_us", "unit": "us", "subtract": 1500},
        "n_stbd": {"from": "stbd_us", "unit": "us", "subtract": 1500},
    }  # fmt: skip
    (tests,) = data["columns_of"]
    assert tests == {"logs": ["bollard"], "time_ms": "time", "n": {"from": "PWM_us", "unit": "us", "subtract": 1500}}
    assert data["logs"] == {"thrusters": ["bollard"], "steps": ["runs"], "manoeuvres": [], "validation": []}
    assert found.questions == ("vehicle.arm_m", "thrusters.per_test")
    file = answer(tmp_path, {"arm_m": str(ARM), "per_test": "1"})
    done = run_campaign(file, out=tmp_path / "out", until="fit-yaw")
    assert [one.did for one in done.steps] == ["done", "done", "done"]
    fitted = tomllib.loads(f"x = {(tmp_path / 'out' / 'thrusters' / 'thrusters.json').read_text().count('n_range')}")
    assert fitted["x"] == 1
    inertia = float(done.says["fit-yaw"].rpartition("I_r ")[2].split()[0])
    assert inertia == pytest.approx(1.018, rel=0.05)  # the truth; the scatter of six runs


@pytest.mark.slow
def test_normalised_commands_do_not_fit_a_map_of_pulses(tmp_path: Path) -> None:
    """The commands beside a logged moment are seen, and told where they do not fit the tests."""
    table(tmp_path / "bollard" / "a.csv", {"PWM_us": PWM, "force_N": FORCE})

    def columns(run: Any, port: np.ndarray, stbd: np.ndarray) -> Mapping[str, Any]:
        heading = np.rad2deg(run.position) % 360
        return {
            "time_s": run.time,
            "heading_deg": heading,
            "tau": run.command,
            "port_cmd": port / 400,
            "stbd_cmd": stbd / 400,
        }

    steps(tmp_path / "runs", columns)
    found, data = asked(tmp_path)
    assert data["columns"]["n_port"] == "port_cmd" and data["columns"]["n_stbd"] == "stbd_cmd"
    assert data["yaw"]["moment"] == "logged"
    assert "the logs hold a moment, and the commands port_cmd, stbd_cmd beside it" in found.text
    assert "they look normalised (-1 to 1)" in found.survey.misfit
    names = tmp_path / "columns.toml"
    names.write_text('[columns]\nn = { from = "PWM_us", subtract = 1500 }\nn_port = "port_cmd"\nn_stbd = "stbd_cmd"\n')
    made = fit_thrusters(tmp_path / "bollard", columns=names)
    assert made.to_json()["n_range"] == [-400.0, 400.0] and made.to_json()["n_unit"] == "us"
    with pytest.raises(RunError, match=r"-400 to 400 us: they look normalised \(-1 to 1\)"):
        fit_yaw(tmp_path / "runs", columns=names, thrusters=made, arm=ARM)
    names.write_text(
        '[columns]\nn_port = { from = "port_cmd", scale = 400 }\nn_stbd = { from = "stbd_cmd", scale = 400 }\n'
    )
    fit = fit_yaw(tmp_path / "runs", columns=names, thrusters=made, arm=ARM)
    assert not any("thruster map" in warning for warning in fit.warnings)
    assert fit.preferred.estimates["I_r"].value == pytest.approx(1.018, rel=0.05)


def pairs(folder: Path, nav: str = "nav_{}", cmd: str = "cmd_{}") -> None:
    """Navigation and commands of each run in files of their own, on one clock."""
    for i, run in enumerate(campaign(MOMENTS, noise_deg=0.3, period=0.05)):
        each = run.command / ARM / 2
        heading = np.rad2deg(run.position) % 360
        table(folder / f"{nav.format(i)}.csv", {"t": run.time, "heading_deg": heading, "speed_mps": 0 * run.time})
        sent = {"port_cmd": command(each)[1:-1], "stbd_cmd": command(-each)[1:-1]}
        table(folder / f"{cmd.format(i)}.csv", {"t": run.time[1:-1] - 0.01, **sent})


@pytest.mark.parametrize(
    ("nav", "cmd", "join", "found_in"),
    [
        ("nav_{}", "cmd_{}", {"logs": "nav_*.csv", "with": "cmd_*.csv"}, "nav_*"),
        ("day_{}_nav", "day_{}_cmd", {"logs": "*_nav.csv", "with": "*_cmd.csv"}, None),
        ("nav/{}", "cmd/{}", {"logs": "nav/*.csv", "with": "cmd/*.csv"}, "nav"),
    ],
)
def test_files_that_are_one_log_are_joined(
    tmp_path: Path, nav: str, cmd: str, join: dict[str, str], found_in: str | None
) -> None:
    pairs(tmp_path, nav, cmd)
    found, data = asked(tmp_path)
    assert data["logs"]["join"] == [{**join, "take": "previous", "max_age_s": 5.0}]
    assert found_in is None or data["logs"]["steps"] == [found_in]
    assert len(found.survey.placed["steps"]) == len(MOMENTS)
    assert data["columns"]["time_s"] == "t" and data["columns"]["n_port"] == "port_cmd"
    assert 'surge_m_s = "speed_mps"' in found.text and "surge_m_s" not in data["columns"]  # offered
    if nav != "nav_{}":
        return
    maps = {"vehicle.arm_m": str(ARM), "arm_m": str(ARM), "map": "map.json"}
    made = fit_thrusters(table(tmp_path / "bench" / "a.txt.csv", {"n": PWM - 1500, "force_N": FORCE}))
    (tmp_path / "map.json").write_text(json.dumps(made.to_json()), encoding="utf-8")
    done = run_campaign(answer(tmp_path, maps), out=tmp_path / "out", until="fit-yaw")
    assert [one.did for one in done.steps] == ["done", "skipped", "done"]
    assert done.says["check"] == f"{len(MOMENTS)} logs, {len(MOMENTS)} runs"
    assert "joined to the clock of" in (tmp_path / "out" / "check" / "check.json").read_text(encoding="utf-8")
    assert float(done.says["fit-yaw"].rpartition("I_r ")[2].split()[0]) == pytest.approx(1.018, rel=0.08)
    again = run_campaign(tmp_path / "campaign.toml", out=tmp_path / "out", until="check")
    assert again.steps[0].did == "kept"
    changed = tmp_path / "cmd_0.csv"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    again = run_campaign(tmp_path / "campaign.toml", out=tmp_path / "out", until="check")
    assert again.steps[0].did == "done"  # what is joined is an input too


def test_what_a_column_map_says_is_not_asked(tmp_path: Path) -> None:
    def columns(run: Any, port: np.ndarray, stbd: np.ndarray) -> Mapping[str, Any]:
        return {"time_s": run.time, "q7": -np.rad2deg(run.position) % 360, "torque": run.command}

    steps(tmp_path / "runs", columns)
    found, data = asked(tmp_path)
    assert found.questions == ("columns.tau", "columns.heading_deg")
    assert data["logs"]["steps"] == ["runs"]
    names = tmp_path / "names.toml"
    names.write_text('[columns]\nheading_deg = { from = "q7", sign = -1 }\ntau_Nm = "torque"\n', encoding="utf-8")
    found, data = asked(tmp_path, columns=names)
    assert found.questions == ()
    assert data["columns"] == {"heading_deg": {"from": "q7", "sign": -1}, "tau_Nm": "torque"}
    assert "as --columns says, " in found.text and "turns with the moment in 6 of 6 steps" in found.text
    assert run_campaign(tmp_path / "campaign.toml", until="check").steps[0].did == "done"


def test_files_of_no_vehicle_are_told_and_left(tmp_path: Path) -> None:
    def columns(run: Any, port: np.ndarray, stbd: np.ndarray) -> Mapping[str, Any]:
        return {"time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, "tau": run.command}

    steps(tmp_path / "runs", columns)
    table(tmp_path / "weather.csv", {"time_s": [0.0, 60.0], "air_degC": [11.0, 11.5]})
    found, data = asked(tmp_path)
    assert found.questions == ()
    assert data["logs"]["steps"] == ["runs"]
    assert found.survey.strangers[0].path.name == "weather.csv"
    assert "no column looks like a heading, a moment or a command" in found.text


def test_a_run_of_which_every_step_is_refused_names_no_report(tmp_path: Path, run: Callable[..., Result]) -> None:
    mixed(tmp_path)
    asked(tmp_path)
    file = answer(tmp_path, {"arm_m": str(ARM), "per_test": "1"})
    text = file.read_text(encoding="utf-8").replace('"yaw"', '"nope"').replace('"PWM_us"', '"nope"')
    file.write_text(text, encoding="utf-8")
    said = run("run", file, "-o", tmp_path / "out")
    assert said.exit_code == 1
    assert "report.html" not in said.stdout and "no step has a result to show" in said.stdout
    assert not (tmp_path / "out" / "report.html").exists()
    assert said.stdout.rstrip().endswith("run.json")


def test_navigation_beside_wrenches_is_one_log(tmp_path: Path) -> None:
    """The wrench files have no word for yaw or command but their names, and no heading: alone they are no runs."""
    for run in campaign(MOMENTS, noise_deg=0.3):
        heading = np.radians(np.degrees(run.position) % 360.0)
        table(tmp_path / f"{run.name}_nav.csv", {"time_s": run.time, "heading_rad": np.round(heading, 4)})
        other = {"force_x": 0.0 * run.command, "force_y": 0.0 * run.command, "torque_z": run.command}
        table(tmp_path / f"{run.name}_wrench.csv", {"time_s": run.time} | other)
    init(tmp_path)
    data = tomllib.loads((tmp_path / "campaign.toml").read_text(encoding="utf-8"))
    (join,) = data["logs"]["join"]
    assert (join["logs"], join["with"]) == ("*_nav.csv", "*_wrench.csv")
    assert "wrench" not in str({kind: data["logs"][kind] for kind in ("thrusters", "steps", "manoeuvres")})
    text = (tmp_path / "campaign.toml").read_text(encoding="utf-8")
    assert 'tau = "?"' in text and "torque_z" in text


def test_a_file_without_a_heading_is_no_step_run(tmp_path: Path) -> None:
    for run in campaign(MOMENTS[:2], noise_deg=0.3):
        table(
            tmp_path / f"{run.name}.csv",
            {"time_s": run.time, "heading_deg": np.degrees(run.position), "tau": run.command},
        )
    table(tmp_path / "engine.csv", {"time_s": run.time, "tau": run.command, "oil_bar": 0.0 * run.time})
    started = init(tmp_path)
    assert not any("engine" in file.name for files in started.survey.placed.values() for file in files)
    assert any("engine" in one.file for one in started.survey.set_aside)


def test_answers_on_a_terminal(tmp_path: Path) -> None:
    """Each question is put with its evidence; Enter leaves it open."""
    mixed(tmp_path)
    here, there = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "automarine_cli", "init", str(tmp_path)],
        cwd=ROOT,
        stdin=there,
        stdout=there,
        stderr=there,
    )
    os.close(there)
    os.write(here, b"0.2\n\n")
    said = b""
    while True:
        try:
            piece = os.read(here, 65536)
        except OSError:
            break
        said += piece
    os.close(here)
    assert process.wait(timeout=600) == 0
    assert b"metres from the centre line to each thruster" in said and b"arm_m (Enter: later)" in said
    data = tomllib.loads((tmp_path / "campaign.toml").read_text(encoding="utf-8"))
    assert data["vehicle"]["arm_m"] == 0.2
    assert data["thrusters"]["per_test"] == "?"
    with pytest.raises(SettingError, match="1 question is still open"):
        run_campaign(tmp_path / "campaign.toml")


def test_answers_become_values_of_their_kind() -> None:
    text = 'a = "?"  # ? how many\nt = { from = "x", unit = "?" }\n# ? long\nb = "?"\n# c = "?"\nd = "a?"'
    told: list[tuple[str, str]] = []

    def ask(key: str, comment: str) -> str:
        told.append((key, comment))
        return {"a": "2", "b": "q7"}.get(key, "")

    assert answered(text, ask) == text.replace('a = "?"', "a = 2").replace('\nb = "?"', '\nb = "q7"')
    assert [comment for _, comment in told] == ["how many", "", "long"]
