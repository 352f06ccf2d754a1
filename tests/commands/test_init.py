"""`automarine init`: what columns are taken for, also in folders of other people; it asks where it is not sure, and its
campaign runs."""

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from made_campaigns import campaign
from small_campaign import make_small_campaign

from automarine_cli.commands.check import check
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs.columns import read_column_map
from automarine_cli.logs.recognise import places_of
from automarine_cli.report.campaign import CampaignRun
from automarine_cli.report.campaign_file import NewCampaign
from automarine_cli.runs.run import Run

Column = Callable[[Run], Any]
MOMENTS = (0.4, -0.4, 0.8, -0.8)
TIME: dict[str, Column] = {"time_s": lambda run: run.time}
HEADING: dict[str, Column] = {"heading_deg": lambda run: np.rad2deg(run.position) % 360}
MOMENT: dict[str, Column] = {"tau": lambda run: run.command}
CANONICAL = TIME | HEADING | MOMENT


def write_table(path: Path, columns: Mapping[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*np.broadcast_arrays(*columns.values())))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def write_logs(folder: Path, columns: Mapping[str, Column], moments: tuple[float, ...] = MOMENTS) -> Path:
    """Step runs of known truth as CSV files, each column made of the run."""
    for run in campaign(moments, noise_deg=0.3):
        write_table(folder / f"{run.name}.csv", {name: column(run) for name, column in columns.items()})
    return folder


def started(folder: Path, **how: Any) -> tuple[NewCampaign, dict[str, Any]]:
    """What `init` makes of a folder, and the data in its campaign file."""
    result = init(folder, overwrite=True, figure_formats=(), **how)
    return result, tomllib.loads(result.text)


def answer(folder: Path, answers: Mapping[str, str]) -> Path:
    """The campaign file of a folder, its questions answered."""
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    for key, value in answers.items():
        text, count = re.subn(rf'^({key} = .*)"\?"', rf"\g<1>{value}", text, flags=re.MULTILINE)
        assert count == 1, key
    file.write_text(text, encoding="utf-8")
    return file


RADIANS: Column = lambda run: (run.position + np.pi) % (2 * np.pi) - np.pi  # noqa: E731
RATE: Column = lambda run: np.gradient(run.position, run.time)  # noqa: E731
ROTATIONS: dict[str, tuple[dict[str, Column], dict[str, Any], tuple[str, ...], tuple[str, ...]]] = {
    "canonical": (
        CANONICAL, {}, (),
        ("# heading_deg", "wraps at 360; turns with the moment in 4 of 4 steps", "4 runs, -0.800 to 0.800 nu"),
    ),
    "other names and units": (
        {"T (ms)": lambda run: 1000 * run.time, "Yaw (rad)": RADIANS, "tau_Nm": MOMENT["tau"]},
        {"time_ms": "T (ms)", "heading_rad": "Yaw (rad)"}, (), ("wraps at 2 pi", "100 from sample to sample"),
    ),
    "a unit that contradicts its range": (
        CANONICAL | {"heading_deg": lambda run: run.position % (2 * np.pi)},
        {"heading_deg": {"from": "heading_deg", "unit": "?"}}, ("columns.heading_deg.unit",),
        ("# ? the name says deg, the range says rad; seen: 0",),
    ),
    "a sign that contradicts the moment": (
        CANONICAL | {"heading_deg": lambda run: np.rad2deg(-run.position) % 360},
        {"heading_deg": {"from": "heading_deg", "sign": "?"}}, ("columns.heading_deg.sign",),
        ("turns with the moment in 0 of 4 steps",),
    ),
    "a moment without a unit": (
        TIME | HEADING | {"torque": MOMENT["tau"]}, {"tau": "?"}, ("columns.tau",),
        ('(then tau_Nm = "torque") or normalised (then tau = "torque")?',),
    ),
    "no heading": (
        TIME | {"q7": HEADING["heading_deg"]} | MOMENT, {"heading_deg": "?"}, ("columns.heading_deg",),
        ("no column looks like the heading; the logs have time_s, q7, tau",
         "4 logs; 4 of them show what they are once the questions are answered"),
    ),
    "a yaw rate whose name tells the unit": (
        CANONICAL | {"yaw_rate_radps": RATE}, {"yaw_rate_rad_s": "yaw_rate_radps"}, (), (),
    ),
    "a yaw rate without a unit, slow": (
        CANONICAL | {"yaw_rate": RATE}, {}, (),
        ('\n# yaw_rate_rad_s = "yaw_rate"  #', "rad/s, not in deg/s? Then take the # before its line away"),
    ),
    "a yaw rate without a unit, fast": (
        CANONICAL | {"gyro_z": lambda run: np.rad2deg(RATE(run))}, {}, (), ('\n# yaw_rate_deg_s = "gyro_z"  #',),
    ),
    "thruster commands": (
        TIME | HEADING | {"port": lambda run: run.command, "stbd": lambda run: -run.command},
        {"n_port": "port", "n_stbd": "stbd"}, ("vehicle.arm_m", "thrusters.map"), ('moment = "thrusters"',),
    ),
    "pulses and a light": (
        TIME | HEADING | {
            "C1": lambda run: 1500 + 400 * run.command, "C2": lambda run: 1500 - 400 * run.command,
            "light": lambda run: 1100 + 0 * run.time,
        },
        {"tau": "?"}, ("columns.tau",),
        ('such as C1, C2 are written n_port = { from = "C1", subtract = 1500 }',),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROTATIONS)
def test_columns_of_runs(tmp_path: Path, name: str) -> None:
    columns, rules, questions, texts = ROTATIONS[name]
    write_logs(tmp_path / "logs", columns)
    result, data = started(tmp_path)
    assert (data["columns"], result.questions) == (rules, questions)
    assert [text for text in texts if text not in result.text] == []
    assert data["logs"]["steps"] == ["logs"]  # by the likelier reading, where there is a question
    if name == "a sign that contradicts the moment":
        file = answer(tmp_path, {"heading_deg": "-1"})
        assert run_campaign(file, out=tmp_path / "out", until="check").says["check"] == "4 logs, 4 runs"


@pytest.mark.parametrize(("name", "rules"), [("time", {}), ("Timestamp", {"time": "Timestamp"})])
def test_timestamps_are_a_clock(tmp_path: Path, name: str, rules: dict[str, str]) -> None:
    def stamps(run: Run) -> list[str]:
        return [f"2026-05-01T12:{int(t) // 60:02d}:{t % 60:06.3f}" for t in run.time + 9]

    write_logs(tmp_path / "logs", {name: stamps} | HEADING | MOMENT)
    result, data = started(tmp_path)
    assert (result.questions, data["columns"], data["logs"]["steps"]) == ((), rules, ["logs"])


PWM = np.arange(1100.0, 1901.0, 25.0)
AHEAD, ASTERN = 3.0e-4, 2.3e-4  # N per us squared
FORCE = np.where(PWM > 1500, AHEAD, -ASTERN) * (PWM - 1500) ** 2
KGF = FORCE / 9.80665
PERCENT = (PWM - 1100) / 8
PULSES = {"from": "PWM_us", "unit": "us", "subtract": 1500}
HALF = {"from": "throttle_pct", "subtract": 50.0}
SIGNALS: list[tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]] = [
    # pulses; the neutral by the sign of the force; the same under a name without a unit
    ({"PWM_us": PWM, "force_kgf": KGF}, {"n": PULSES}, ()),
    ({"cmd": PWM, "force_N": FORCE}, {"n": PULSES | {"from": "cmd"}}, ()),
    # pulses of a wide range, and of a name that says no more than the unit
    ({"PWM_us": 1500 + 2.25 * (PWM - 1500), "force_kgf": KGF}, {"n": PULSES}, ()),
    ({"input (us)": PWM[18:], "force_N": FORCE[18:]}, {"n": PULSES | {"from": "input (us)"}}, ()),
    # unsigned speed, directed by the force; signed speed
    ({"rpm": np.round(9.5 * np.abs(PWM - 1500)), "force_N": FORCE}, {"n": {"from": "rpm", "sign_from": "force_N"}}, ()),
    ({"RPM": PWM - 1500, "Force (Kg f)": KGF}, {"n": "RPM", "force_kgf": "Force (Kg f)"}, ()),
    # a force of one sign, directed by the command
    ({"PWM_us": PWM, "thrust_kg": np.abs(KGF)},
     {"n": PULSES, "force_kgf": {"from": "thrust_kg", "sign_from": {"from": "PWM_us", "subtract": 1500}}}, ()),
    # percent about 50; from 0, ahead only; of both ways with a force of one sign
    ({"throttle_pct": PERCENT, "load_N": FORCE}, {"n": HALF, "force_N": "load_N"}, ()),
    ({"throttle_pct": PERCENT, "load_N": PERCENT**2 / 78}, {"n": "throttle_pct", "force_N": "load_N"}, ()),
    ({"throttle_pct": PERCENT, "load_N": np.abs(FORCE)},
     {"n": HALF, "force_N": {"from": "load_N", "sign_from": HALF}}, ()),
    # thrust is a throttle where another column is the force, and asked about where none is
    ({"thrust": (PWM - 1500) / 400, "load_kg": KGF}, {"n": "thrust", "force_kgf": "load_kg"}, ()),
    ({"PWM_us": PWM, "thrust": (PWM - 1500) / 400}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    # volts of a load cell are no supply and no force; a supply under load is
    ({"PWM_us": PWM, "load_V": 0.013 + 1e-4 * FORCE}, {"n": PULSES, "force_N": "?"}, ("columns.force_N",)),
    ({"PWM_us": PWM, "force_N": FORCE, "v_load_V": 16 - 0.01 * np.abs(FORCE)},
     {"n": PULSES, "voltage_V": "v_load_V"}, ()),
    # a load without a unit; ahead is logged as negative force
    ({"PWM_us": PWM, "load": FORCE}, {"n": PULSES, "force_N": {"from": "load", "unit": "?"}},
     ("columns.force_N.unit",)),
    ({"PWM_us": PWM, "force_N": -FORCE}, {"n": PULSES, "force_N": {"from": "force_N", "sign": "?"}},
     ("columns.force_N.sign",)),
]  # fmt: skip


@pytest.mark.parametrize(("columns", "rules", "questions"), SIGNALS, ids=[" ".join(case[0]) for case in SIGNALS])
def test_signals(tmp_path: Path, columns: dict[str, Any], rules: dict[str, Any], questions: tuple[str, ...]) -> None:
    write_table(tmp_path / "bench" / "a.csv", columns)
    result, data = started(tmp_path)
    assert data["columns"] == rules and data["logs"]["thrusters"] == ["bench"]
    assert result.questions == (*questions, "thrusters.per_test")
    if questions and "sign" not in questions[0]:
        return  # there is no force
    file = answer(tmp_path, {"per_test": "1"} | ({"force_N": "-1"} if questions else {}))
    done = run_campaign(file, out=tmp_path / "out", until="fit-thrusters")
    assert "R² 1.000" in done.says["fit-thrusters"] or "R² 0.99" in done.says["fit-thrusters"]


@pytest.mark.parametrize(
    ("wanted", "others", "places"),
    [
        (["a/1.csv", "a/2.csv"], ["b/1.csv"], ["a"]),
        (["a/x/1.csv", "a/y/2.csv"], ["b/1.csv"], ["a"]),
        (["1.csv", "2.csv"], [], ["*.csv"]),
        (["1.csv", "2.csv"], ["3.parquet"], ["*.csv"]),
        (["a/tau_1.csv", "a/tau_2.csv"], ["a/coast_1.csv", "tau_1.csv"], ["a/tau_*"]),
        (["tau_+0.5.csv", "tau_-0.5.csv"], ["coast_+0.5.csv"], ["tau_*"]),
        (["x.csv"], ["y.csv"], ["x.csv"]),
        (["[1].csv", "[2].csv"], ["y.csv"], ["[1].csv", "[2].csv"]),
    ],
)
def test_places_mean_exactly_what_is_wanted(wanted: list[str], others: list[str], places: list[str]) -> None:
    assert places_of(wanted, [*wanted, *others]) == places


# `automarine init` on whole folders, of other people too: it is sure only where it can be, and its campaign runs.


ARM = 0.2  # m
SIX = (0.4, -0.4, 0.7, -0.7, 1.0, -1.0)


def command(side: float) -> Column:
    """What the thruster of one side is sent [us about neutral]."""

    def column(run):  # type: ignore[no-untyped-def]
        force = side * run.command / ARM / 2
        return np.sign(force) * np.round(np.sqrt(np.abs(force) / np.where(force > 0, AHEAD, ASTERN)), 1)

    return column


PORT, STBD = command(1.0), command(-1.0)


def inertia(result: CampaignRun) -> float:
    return float(result.says["fit-yaw"].rpartition("I_r ")[2].split()[0])


def test_each_run_is_drawn_next_to_the_file_unless_nobody_wants_figures(
    tmp_path: Path, run: Callable[..., Result]
) -> None:
    logs, file = write_logs(tmp_path / "pool", CANONICAL), tmp_path / "day.toml"
    said = run("init", logs, "-o", file)
    pictures = tmp_path / "day_runs"
    assert f"1 page of figures in {pictures}." in " ".join(said.stdout.split())
    assert {path.name for path in pictures.iterdir()} == {"yaw_runs_1.png", "manifest.json"}
    file.unlink()
    refused = run("init", logs, "-o", file)
    assert refused.exit_code == 1 and "day_runs" in refused.stderr and not file.exists()
    other = tmp_path / "bare.toml"
    assert "figures" not in run("init", logs, "-o", other, "--figures", "none").stdout
    assert other.exists() and not other.with_name("bare_runs").exists()


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
    write_logs(tmp_path / "logs", TIME | HEADING | sides, SIX)
    result, data = started(tmp_path)
    assert data["thrusters"] == {"map": "newtons"} and result.questions == ("vehicle.arm_m",)
    done = run_campaign(answer(tmp_path, {"arm_m": str(ARM)}), out=tmp_path / "out", until="fit-yaw")
    assert inertia(done) == pytest.approx(1.018, rel=0.08)


def test_results_are_no_logs_and_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    pool = tmp_path / "pool"
    write_logs(pool / "steps", CANONICAL, SIX)
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
    write_logs(tmp_path / "runs", TIME | {"q7": HEADING["heading_deg"], "torque": lambda run: run.command}, SIX)
    file = tmp_path / "campaign.toml"
    head = 'schema = "automarine/campaign/1"\n[vehicle]\narm_m = 0.3\n[thrusters]\nper_test = "?"\n[columns]\n'
    file.write_text(head + 'heading_deg = "q7"\ntau = "?"\n', encoding="utf-8")
    with pytest.raises(LogError, match=r"campaign\.toml: columns\.tau still open"):
        check([tmp_path / "runs"], columns=file)
    file.write_text(head + 'heading_deg = "q7"\ntau = "torque"\n', encoding="utf-8")
    assert len(check([tmp_path / "runs"], columns=file).runs) == len(SIX)
    assert read_column_map(file).defaults == {"arm_m": 0.3}


def test_what_a_column_map_says_is_not_asked(tmp_path: Path) -> None:
    write_logs(
        tmp_path / "runs",
        TIME | {"q7": lambda run: -np.rad2deg(run.position) % 360, "torque": lambda run: run.command},
        SIX,
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
    write_logs(folder / "runs", columns, SIX)


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
    for i, run in enumerate(campaign(SIX, noise_deg=0.3, period=0.05)):
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
    assert len(result.survey.placed["steps"]) == len(SIX)
    assert data["columns"]["time_s"] == "t" and data["columns"]["n_port"] == "port_cmd"
    thrusters = fit_thrusters(write_table(tmp_path / "bench" / "a.txt.csv", {"n": PWM - 1500, "force_N": FORCE}))
    (tmp_path / "map.json").write_text(json.dumps(thrusters.to_json()), encoding="utf-8")
    file, out = answer(tmp_path, {"arm_m": str(ARM), "map": '"map.json"'}), tmp_path / "out"
    done = run_campaign(file, out=out, until="fit-yaw")
    assert [step.did for step in done.steps] == ["done", "skipped", "done"]
    assert done.says["check"] == f"{len(SIX)} logs, {len(SIX)} runs"
    assert "joined to the clock of" in (out / "check" / "check.json").read_text(encoding="utf-8")
    assert inertia(done) == pytest.approx(1.018, rel=0.08)
    assert run_campaign(file, out=out, until="check").steps[0].did == "kept"
    changed = tmp_path / "cmd_0.csv"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert run_campaign(file, out=out, until="check").steps[0].did == "done"
