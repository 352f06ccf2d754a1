"""`automarine init`: what a folder of logs is taken for, and that it asks where it is not sure."""

import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from made_campaigns import campaign
from numpy.typing import NDArray
from small_campaign import make_small_campaign

from automarine_cli.commands.campaign import read_campaign
from automarine_cli.commands.init import init
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import LogError, OutputError, SettingError
from automarine_cli.logs.recognise import Span, places_of, recognise, words_of
from automarine_cli.report.campaign_file import NewCampaign
from automarine_cli.runs.run import Run

Column = Callable[[Run], NDArray[np.float64]]
MOMENTS = (0.4, -0.4, 0.8, -0.8)
CANONICAL: Mapping[str, Column] = {
    "time_s": lambda run: run.time,
    "heading_deg": lambda run: np.rad2deg(run.position) % 360,
    "tau": lambda run: run.command,
}


def write_logs(folder: Path, columns: Mapping[str, Column], moments: tuple[float, ...] = MOMENTS) -> Path:
    """Step runs as CSV files whose columns are called and made as `columns` say."""
    folder.mkdir(parents=True)
    for run in campaign(moments):
        table = np.column_stack([column(run) for column in columns.values()])
        head = ",".join(columns)
        np.savetxt(folder / f"{run.name}.csv", table, delimiter=",", header=head, comments="", fmt="%.6g")
    return folder


def asked(folder: Path, **how: Any) -> tuple[NewCampaign, dict[str, Any]]:
    """What `init` makes of a folder, and the data in its campaign file."""
    found = init(folder, **how)
    return found, tomllib.loads(found.text)


def test_what_is_named_canonically_needs_no_question(tmp_path: Path) -> None:
    write_logs(tmp_path / "pool" / "steps", CANONICAL)
    found, data = asked(tmp_path / "pool")
    assert found.questions == ()
    assert data["logs"] == {"thrusters": [], "steps": ["steps"], "manoeuvres": [], "validation": []}
    assert data["columns"] == {}
    assert "# heading_deg" in found.text and "wraps at 360; turns with the moment in 4 of 4 steps" in found.text
    assert "4 runs, -0.800 to 0.800 nu" in found.text
    known = read_campaign(tmp_path / "pool" / "campaign.toml")
    assert [file.name for file in known.logs("logs", "steps")] == [f"steps/run_0{i}.csv" for i in range(4)]


def test_ranges_are_those_of_all_logs(tmp_path: Path) -> None:
    write_logs(tmp_path / "pool" / "steps", CANONICAL)
    write_logs(tmp_path / "pool" / "more", {**CANONICAL, "spare": CANONICAL["tau"]}, (1.2, -1.1))
    found, data = asked(tmp_path / "pool")
    assert data["logs"]["steps"] == ["more", "steps"]
    assert "# tau                                        # as named: -1.1 to 1.2\n" in found.text


def test_a_whole_campaign_with_one_question(tmp_path: Path, run: Callable[..., Result]) -> None:
    file = make_small_campaign(tmp_path / "pool")
    file.unlink()
    said = run("init", tmp_path / "pool")
    assert said.exit_code == 0, said.stderr
    assert "1 question to answer: thrusters.per_test." in said.stdout
    assert said.stdout.endswith(f"automarine run {file} -o results\n")
    text = file.read_text(encoding="utf-8")
    assert tomllib.loads(text)["logs"] == {
        "thrusters": ["thrusters"], "steps": ["steps"], "manoeuvres": ["driving"], "validation": ["validation"],
    }  # fmt: skip
    with pytest.raises(SettingError, match=r"campaign\.toml: 1 question is still open: thrusters\.per_test"):
        run_campaign(file, until="check")
    file.write_text(text.replace('per_test = "?"', "per_test = 2"), encoding="utf-8")
    found = run_campaign(file, out=tmp_path / "out", until="fit-thrusters")
    assert [one.did for one in found.steps] == ["done", "done"]


def test_other_names_and_units_are_recognised(tmp_path: Path) -> None:
    def wrapped(run: Run) -> NDArray[np.float64]:
        return (run.position + np.pi) % (2 * np.pi) - np.pi

    other = {"T (ms)": lambda run: 1000 * run.time, "Yaw (rad)": wrapped, "tau_Nm": lambda run: run.command}
    write_logs(tmp_path / "pool" / "logs", other)
    found, data = asked(tmp_path / "pool")
    assert found.questions == ()
    assert data["columns"] == {"time_ms": "T (ms)", "heading_rad": "Yaw (rad)"}
    assert "wraps at 2 pi" in found.text
    assert "0.100" not in str(data) and "100 from sample to sample" in found.text
    assert data["logs"]["steps"] == ["logs"]


def test_a_unit_that_contradicts_its_range_is_asked_about(tmp_path: Path) -> None:
    wrong = {**CANONICAL, "heading_deg": lambda run: run.position % (2 * np.pi)}
    write_logs(tmp_path / "pool" / "logs", wrong)
    found, data = asked(tmp_path / "pool")
    assert found.questions == ("columns.heading_deg.unit",)
    assert data["columns"]["heading_deg"] == {"from": "heading_deg", "unit": "?"}
    assert "# ? the name says deg, the range says rad; seen: 0" in found.text


def test_a_heading_that_hardly_moved_is_asked_about(tmp_path: Path) -> None:
    straight = {**CANONICAL, "heading_deg": lambda run: run.position - run.position[0]}
    write_logs(tmp_path / "pool" / "logs", straight)
    _, data = asked(tmp_path / "pool")
    assert data["columns"]["heading_deg"] == {"from": "heading_deg", "unit": "?"}


def test_a_sign_that_contradicts_the_moment_is_asked_about(tmp_path: Path) -> None:
    mirrored = {**CANONICAL, "heading_deg": lambda run: np.rad2deg(-run.position) % 360}
    write_logs(tmp_path / "pool" / "logs", mirrored)
    found, data = asked(tmp_path / "pool")
    assert data["columns"]["heading_deg"] == {"from": "heading_deg", "sign": "?"}
    assert "turns with the moment in 0 of 4 steps" in found.text
    file = tmp_path / "pool" / "campaign.toml"
    file.write_text(found.text.replace('sign = "?"', "sign = -1"), encoding="utf-8")
    fitted = run_campaign(file, out=tmp_path / "out", until="check")
    assert fitted.says["check"] == "4 logs, 4 runs"


def test_what_a_moment_is_in_is_asked(tmp_path: Path) -> None:
    renamed = {"time_s": CANONICAL["time_s"], "heading_deg": CANONICAL["heading_deg"], "torque": CANONICAL["tau"]}
    write_logs(tmp_path / "pool" / "logs", renamed)
    found, data = asked(tmp_path / "pool")
    assert data["columns"] == {"tau": "?"}
    assert '(then tau_Nm = "torque") or normalised (then tau = "torque")?' in found.text
    assert data["logs"]["steps"] == ["logs"]  # the likelier reading was used to look at the runs


def test_a_column_that_is_not_there_is_asked_about(tmp_path: Path) -> None:
    odd = {"time_s": CANONICAL["time_s"], "q7": CANONICAL["heading_deg"], "tau": CANONICAL["tau"]}
    write_logs(tmp_path / "pool" / "logs", odd)
    found, data = asked(tmp_path / "pool")
    assert data["columns"] == {"heading_deg": "?"}
    assert "no column looks like the heading; the logs have time_s, q7, tau" in found.text
    assert data["logs"]["steps"] == ["logs"]  # placed all the same: they show what they are once it is answered
    assert "4 logs; 4 of them show what they are once the questions are answered" in found.text


def test_thruster_commands_ask_for_arm_and_map(tmp_path: Path) -> None:
    driven = {
        "time_s": CANONICAL["time_s"], "heading_deg": CANONICAL["heading_deg"],
        "port": lambda run: run.command, "stbd": lambda run: -run.command,
    }  # fmt: skip
    write_logs(tmp_path / "pool" / "logs", driven)
    found, data = asked(tmp_path / "pool")
    assert data["columns"] == {"n_port": "port", "n_stbd": "stbd"}
    assert data["yaw"]["moment"] == "thrusters"
    assert found.questions == ("vehicle.arm_m", "thrusters.map")


def test_thruster_tests_and_their_units(tmp_path: Path) -> None:
    (tmp_path / "bench").mkdir()
    lines = [f"{n},{0.01 * n * abs(n)},{v}" for n in range(-5, 6) for v in (12, 16)]
    (tmp_path / "bench" / "a.csv").write_text("\n".join(["RPM,Force (Kg f),volts", *lines]), encoding="utf-8")
    found, data = asked(tmp_path)
    assert data["columns"] == {"n": "RPM", "force_kgf": "Force (Kg f)", "voltage_V": "volts"}
    assert found.questions == ("thrusters.per_test",)
    assert data["logs"]["thrusters"] == ["bench"]
    (tmp_path / "bench" / "a.csv").write_text("\n".join(["RPM,load,volts", *lines]), encoding="utf-8")
    _, data = asked(tmp_path, overwrite=True)
    assert data["columns"]["force_N"] == {"from": "load", "unit": "?"}


def test_results_are_no_logs_and_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    pool = tmp_path / "pool"
    write_logs(pool / "steps", CANONICAL)
    init(pool)
    run_campaign(pool / "campaign.toml", out=pool / "out", until="fit-yaw")
    assert (pool / "out" / "yaw" / "runs.parquet").exists()
    (pool / "broken.csv").write_text("time_s,heading_deg,tau\n0,x,1\n", encoding="utf-8")
    found, data = asked(pool, overwrite=True)
    assert data["logs"]["steps"] == ["steps"]
    assert found.to_json()["logs"] == 4
    assert "# Not used: 1\n#   pool/broken.csv, run broken: row 2, column heading_deg: found 'x'" in found.text
    with pytest.raises(LogError, match="the only logs here are in folders of results"):
        init(pool / "out")


def test_nothing_is_replaced_without_being_told(tmp_path: Path, run: Callable[..., Result]) -> None:
    write_logs(tmp_path / "logs", CANONICAL)
    first = init(tmp_path)
    with pytest.raises(OutputError, match=r"campaign\.toml is there already; give --overwrite"):
        init(tmp_path)
    assert init(tmp_path, overwrite=True).text == first.text
    elsewhere = init(tmp_path, out=tmp_path / "a" / "b" / "c.toml")
    assert tomllib.loads(elsewhere.text)["logs"]["steps"] == ["../../logs"]
    assert read_campaign(tmp_path / "a" / "b" / "c.toml").logs("logs", "steps")
    (tmp_path / "empty").mkdir()
    refused = run("init", tmp_path / "empty")
    assert refused.exit_code == 1 and "no logs in this directory" in refused.stderr


def test_names_cannot_leave_their_comment(tmp_path: Path) -> None:
    write_logs(tmp_path / "steps", CANONICAL)
    bad = tmp_path / 'x"]\nstrict = true\n#.csv'
    bad.write_text("time_s,heading_deg,tau\n", encoding="utf-8")
    _, data = asked(tmp_path)
    assert "strict" not in data
    assert set(data) == {"schema", "title", "vehicle", "logs", "columns", "yaw"}


@pytest.mark.parametrize(
    ("name", "step", "key", "sure"),
    [
        ("t", 0.1, "time_s", True),
        ("t", 100.0, "time_ms", True),
        ("t", 1e5, "time_us", True),
        ("time_ms", 100.0, "time_ms", True),
        ("time_s", 100.0, "time_s", False),
        ("t", 1e9, "time_s", False),
        ("stamp_us", 20000.0, "time_us", True),
    ],
)
def test_clocks(name: str, step: float, key: str, sure: bool) -> None:
    found = recognise("time", [name], {name: Span(0.0, 100 * step, step, 3 * step)})
    assert found is not None
    assert (found.key, not found.open) == (key, sure)


@pytest.mark.parametrize("name", ["time", "Timestamp"])
def test_timestamps_are_a_clock_and_plain_numbers_called_time_are_judged(tmp_path: Path, name: str) -> None:
    logs = write_logs(tmp_path / "logs", {"time": CANONICAL["time_s"], **CANONICAL})
    for log in logs.iterdir():
        _, *rows = log.read_text(encoding="utf-8").splitlines()
        cells = [row.split(",") for row in rows]
        stamped = [f"2026-05-01T12:{int(float(c[1]) + 9) // 60:02d}:{(float(c[1]) + 9) % 60:06.3f}" for c in cells]
        lines = [f"{name},heading_deg,tau", *(",".join([t, *c[2:]]) for t, c in zip(stamped, cells))]
        log.write_text("\n".join(lines), encoding="utf-8")
    found, data = asked(tmp_path)
    assert (found.questions, data["columns"]) == ((), {} if name == "time" else {"time": "Timestamp"})
    assert data["logs"]["steps"] == ["logs"]
    write_logs(tmp_path / "b" / "logs", {"time": CANONICAL["time_s"], **dict(list(CANONICAL.items())[1:])})
    _, data = asked(tmp_path / "b")
    assert data["columns"] == {"time_s": "time"}


def test_words_of_a_name() -> None:
    assert words_of("Force (Kg f)") == ["force", "kgf"]
    assert words_of("Yaw-Rate[deg/s]") == ["yaw", "rate", "deg", "s"]


@pytest.mark.parametrize(
    ("wanted", "others", "places"),
    [
        (["a/1.csv", "a/2.csv"], ["b/1.csv"], ["a"]),
        (["a/x/1.csv", "a/y/2.csv"], ["b/1.csv"], ["a"]),
        (["1.csv", "2.csv"], [], ["*.csv"]),
        (["1.csv", "2.csv"], ["3.parquet"], ["*.csv"]),
        (["tau_1.csv", "tau_2.csv"], ["coast_1.csv"], ["tau_*"]),
        (["a/tau_1.csv", "a/tau_2.csv"], ["a/coast_1.csv", "tau_1.csv"], ["a/tau_*"]),
        (["tau_+0.5.csv", "tau_-0.5.csv"], ["coast_+0.5.csv"], ["tau_*"]),
        (["x.csv"], ["y.csv"], ["x.csv"]),
        (["[1].csv", "[2].csv"], ["y.csv"], ["[1].csv", "[2].csv"]),
    ],
)
def test_places_mean_exactly_what_is_wanted(wanted: list[str], others: list[str], places: list[str]) -> None:
    assert places_of(wanted, [*wanted, *others]) == places


def test_pulses_to_thrusters_are_told_with_their_neutral(tmp_path: Path) -> None:
    columns = {name: CANONICAL[name] for name in ("time_s", "heading_deg")}
    columns |= {"C1": lambda run: 1500 + 400 * run.command, "C2": lambda run: 1500 - 400 * run.command}
    columns["light"] = lambda run: 1100 + 0 * run.time
    write_logs(tmp_path / "pool" / "logs", columns)
    found, data = asked(tmp_path / "pool")
    assert data["columns"] == {"tau": "?"} and "light" not in found.text.partition("pulses about")[2][:30]
    assert 'such as C1, C2 are written n_port = { from = "C1", subtract = 1500 }' in found.text
