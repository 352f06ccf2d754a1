"""Column maps: what they may say, what becomes of the columns, and the key's path for what they may not."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from reader_contract import log
from tolerances import assert_close

from automarine_cli.commands.check import check
from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs import (
    ColumnMap,
    ColumnRule,
    LogFile,
    LogTable,
    column_rules,
    find_logs,
    read_column_map,
    read_log,
    whole_logs,
)
from automarine_cli.logs.columns import ColumnsOf, Join


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "columns.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_the_contract_s_example(tmp_path: Path) -> None:
    text = """[columns]
    time_s = "t"
    heading_deg = { from = "yaw", unit = "rad", sign = -1 }
    tau_Nm = "rudder_deg"
    n = { from = " rpm ", unit = "rpm", scale = 2, offset = 1.5 }
    [defaults]
    thrusters_per_test = 2
    arm_m = 0.44
    """
    columns = read_column_map(written(tmp_path, text))
    assert dict(columns.columns) == {
        "time_s": ColumnRule("t"), "heading_deg": ColumnRule("yaw", "rad", -1), "tau_Nm": ColumnRule("rudder_deg"),
        "n": ColumnRule("rpm", "rpm", 1, 2.0, 1.5),
    }  # fmt: skip
    assert dict(columns.defaults) == {"thrusters_per_test": 2, "arm_m": 0.44}


REFUSED = {  # the place, what was found, what was expected
    "": ("heading_deg", "under [columns]"),
    "time_s = 't'": ("time_s", "columns_of, logs, defaults, can"),
    "[columns]\nyaw = 'a'": ("columns.yaw:", "known are time_s, time_ms", "force_lbf, run, mode, armed, by"),
    "[columns]\ntau = 1": ("columns.tau:", 'a column in quotes, or a table such as { from = "yaw"'),
    "[columns]\ntau = ''": ("columns.tau:", "from is ''", "a column in quotes"),
    "[columns]\ntau = { unit = 'nu' }": ("columns.tau:", 'key "from" is missing'),
    "[columns]\nn = { from = 'a', sign_from = { from = 'b', unit = 'us' } }": ("columns.n:", "from, subtract and sign"),
    "[columns]\ntau = { from = 'a', day_first = true }": ("columns.tau.day_first:", "goes with time", "leave it out"),
    "[[columns_of]]\nn = 'a'": ("columns_of[0].logs: missing", '["bollard/*.csv"]'),
    "[logs]\njoin = { logs = 'a' }": ("logs.join[0]:", 'key "with" is missing'),
    "[logs]\njoin = { logs = 'nav_*', with = '*_cmd_*' }": ("logs.join[0]:", '"*_cmd_*"', "as many stars in both"),
    "[columns]\ntau = { from = 'a', unit = 'N m' }": ("columns.tau.unit: found 'N m'", "expected nu"),
    "[columns]\nheading_deg = { from = 'a', unit = 'grad' }": ("columns.heading_deg.unit: found 'grad'", "deg or rad"),
    "[columns]\ntau = { from = 'a', scale = 0 }": ("columns.tau:", "scale is 0", "other than 0"),
    "[columns]\nrun = { from = 'a', sign = -1 }": ("columns.run:", "a column of words", "leave them out"),
    "[columns]\nheading_rad = 'heading_deg'": ("heading_rad", 'write { from = "heading_deg", unit = "deg" }'),
    "[columns]\nheading_deg = 'yaw_rad'": ("heading_deg", "name says rad, for deg"),
    "[columns]\nyaw_rate_rad_s = 'gyro_deg_s'": ("yaw_rate_rad_s", 'unit = "deg/s" }'),
    "[columns]\ntau = { from = ['a', 'b'], scale = [1, 2, 3] }": ("tau.scale: found 3 numbers for 2", "one for all"),
    "[columns]\ntau = { from = ['a', 'b'], scale = [1, 0] }": ("columns.tau", "scale is 0"),
    "[columns]\ntau = { from = [] }": ("columns.tau.from: found no column",),
    "[columns]\ntau = { from = 'a', plus = [] }": ("columns.tau:", 'from = ["left", "right"]'),
    "[can]\ndbc = ' '": ("can.dbc: found no name", "a DBC file in quotes"),
    "[defaults]\narm_m = -1": ("defaults:", "arm_m is -1", "above 0"),
    b"[columns": ("not valid TOML: ",),
    b"#" * 2_000_000: ("more than 200000 bytes", "a file of a few kilobytes"),
}


@pytest.mark.parametrize(("text", "parts"), REFUSED.items(), ids=[str(text[-40:]) for text in REFUSED])
def test_refused_with_the_key_s_path(tmp_path: Path, text: str | bytes, parts: tuple[str, ...]) -> None:
    with pytest.raises(LogError) as refused:
        read_column_map(written(tmp_path, text))
    assert str(refused.value).startswith("columns.toml: ") and str(refused.value).isprintable()
    assert [part for part in parts if part not in str(refused.value)] == []


def mapped(folder: Path, content: str, **rules: ColumnRule) -> LogTable:
    return read_log(log(folder, content.encode()), ColumnMap(rules), dof=YAW)


def test_names_units_and_signs(tmp_path: Path) -> None:
    table = mapped(
        tmp_path,
        "t,yaw,rudder,trial\n100,1.5,10,a\n200,2,20,a\n",
        time_s=ColumnRule("t", unit="ms"),
        heading_deg=ColumnRule("yaw", unit="rad", sign=-1),
        tau_Nm=ColumnRule("rudder", scale=0.5, offset=1),
        run=ColumnRule("trial"),
    )
    np.testing.assert_allclose(table.columns["time"], [0.1, 0.2])
    np.testing.assert_array_equal(table.columns["heading"], [-1.5, -2])
    np.testing.assert_array_equal(table.columns["moment"], [6, 11])
    assert table.run is not None and set(table.run) == {"a"} and dict(table.extras) == {}


BENCH = "PWM_us,rpm,load\n1100,3000,-40\n1300,1500,-10\n1500,0,0\n1700,1600,12\n1900,3200,48\n"


def bench(folder: Path, **rules: object) -> LogTable:
    return read_log(log(folder, BENCH.encode()), ColumnMap(column_rules(rules, "columns.toml")), dof=YAW)


def test_a_neutral_is_subtracted_first(tmp_path: Path) -> None:
    rule = {"from": "PWM_us", "subtract": 1500, "scale": 0.0025, "offset": 1, "sign": -1}
    assert_close(bench(tmp_path, n=rule).columns["n"], -(0.0025 * np.arange(-400, 401, 200) + 1), "same arithmetic")


@pytest.mark.parametrize("way", [{"from": "load"}, {"from": "PWM_us", "subtract": 1500}])
@pytest.mark.parametrize("sign", [1, -1])
def test_another_column_says_the_direction(tmp_path: Path, way: dict[str, object], sign: int) -> None:
    table = bench(tmp_path, n={"from": "rpm", "sign_from": {**way, "sign": sign}})
    assert_close(table.columns["n"], sign * np.array([-3000, -1500, 0, 1600, 3200]), "same arithmetic")
    with pytest.raises(LogError, match=r"n takes its sign from 'pwm'; .*\. Correct sign_from"):
        bench(tmp_path, n={"from": "rpm", "sign_from": "pwm"})


def test_sums_differences_and_products(tmp_path: Path) -> None:
    """Each in the tool's own unit; columns that a rule is made of are no columns of their own beside it."""
    rules = {"from": [" rpm", "load"], "scale": [0.5, -2], "subtract": [100, 1], "offset": 3, "sign": -1}
    table = bench(tmp_path, tau_Nm=rules)
    rpm, load = np.array([3000, 1500, 0, 1600, 3200]), np.array([-40, -10, 0, 12, 48])
    assert_close(table.columns["moment"], -(0.5 * (rpm - 100) - 2 * (load - 1) + 3), "same arithmetic")
    assert set(table.extras) == {"PWM_us"} and table.units["moment"] == "N m"
    assert_close(bench(tmp_path, tau_Nm={"from": ["rpm", "load"]}).columns["moment"], rpm + load, "same arithmetic")
    alike = bench(tmp_path, tau_Nm={"from": ["rpm", "load"], "scale": 0.1, "times": "load"})
    assert_close(alike.columns["moment"], 0.1 * (rpm + load) * load, "same arithmetic")
    squared = bench(tmp_path, tau={"from": "rpm", "times": ["load", "load"]})
    assert_close(squared.columns["moment"], rpm * load**2.0, "same arithmetic")
    rule = bench(tmp_path, tau={"from": "rpm", "times": "speed"})
    assert "moment" not in rule.columns and "names 'speed' for tau; the file has no such column" in rule.notes[0]


def test_single_files_have_maps_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "a.csv").write_text("time,x,F\n0,1,2\n1000,2,3\n", encoding="utf-8")
    (tmp_path / "run.csv").write_text("time,x,tau\n0,10,1\n0.1,20,1\n", encoding="utf-8")
    text = (
        '[columns]\ntime_s = "time"\nheading_deg = "x"\n[[columns_of]]\nlogs = "bench/*.csv"\ntime_ms = "time"\n'
        'n = "x"\nforce_N = "F"\n'
    )
    columns = read_column_map(written(tmp_path, text))
    tables = [read_log(LogFile(tmp_path / name, name, True), columns, dof=YAW) for name in ("bench/a.csv", "run.csv")]
    assert tables[0].columns.keys() == {"time", "n", "force"} and tables[0].columns["time"][1] == 1.0
    assert tables[1].columns.keys() == {"time", "heading", "moment"} and tables[1].columns["time"][1] == 0.1


@pytest.mark.parametrize(
    ("rule", "unit"),
    [("PWM_us", "us"), ("port rpm", "rpm"), ("Throttle (%)", "%"), ("u", ""), ("pwm", "")],  # a signed one is no pulse
)
def test_a_signal_s_unit_is_told_by_its_name(tmp_path: Path, rule: str, unit: str) -> None:
    rows = "-255,-1\n255,1\n" if rule == "pwm" else "1,1\n2,2\n"
    columns = ColumnMap(column_rules({"n": rule}, ""))
    assert read_log(log(tmp_path, f"{rule},force_N\n{rows}".encode()), columns, dof=YAW).units["n"] == unit


# A navigation file and a command file of one run are one log


JOIN = Join("nav_*.csv", "cmd_*.csv")
RULES = column_rules({"time_s": "stamp", "n_port": "port_cmd", "n_stbd": "stbd_cmd"}, "")


def write(path: Path, columns: Mapping[str, object]) -> LogFile:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*(list(values) for values in columns.values()))  # type: ignore[call-overload]
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n", encoding="utf-8")
    return LogFile(path, path.name, True)


def pair(folder: Path, name: str = "01") -> LogFile:
    """Navigation at 10 Hz for 8 s, commands at 2 Hz that change at 2.05 s and end after 6 s."""
    time, sent = (np.round(np.arange(*span), 3) for span in ((0, 8, 0.1), (0.05, 6.1, 0.5)))
    command = np.where(sent >= 2.0, 40.0, 0.0)
    commands = {"stamp": sent + 100, "port_cmd": command, "stbd_cmd": -command, "light": sent}
    write(folder / f"cmd_{name}.csv", commands)
    moved = np.cumsum(np.where(time > 2.0, 3.0, 0.0))
    return write(folder / f"nav_{name}.csv", {"stamp": time + 100, "heading_deg": moved, "light": 0 * time})


@pytest.mark.parametrize(("take", "lag"), [("previous", 0.0), ("nearest", 0.25)])
def test_commands_are_held_and_their_age_told(tmp_path: Path, take: str, lag: float) -> None:
    join = Join("nav_*.csv", "cmd_*.csv", take, 1.0)  # type: ignore[arg-type]
    table = read_log(pair(tmp_path), ColumnMap(RULES, join=(join,)), dof=None)
    time, port = table.columns["time"] - 100.0, table.columns["n_port"]
    assert np.isnan(port[time < 0.05 - lag]).all()
    assert (port[(time >= 2.05 - lag + 1e-6) & (time < 7.0)] == 40).all()
    assert (port[(time >= 0.06) & (time < 2.05 - lag - 1e-6)] == 0).all()
    assert np.isnan(port[time > 7.06]).all()  # older than a second: none
    assert np.array_equal(table.columns["n_stbd"], -port, equal_nan=True)
    assert (table.extras["light"] == 0).all() and table.rows[0] == 2  # the log's own
    (note,) = table.notes
    assert [part for part in ("clock of nav_01.csv: cmd_01.csv 0.", "at most", "none in") if part not in note] == []


def test_what_cannot_be_joined_is_refused(tmp_path: Path) -> None:
    file = pair(tmp_path)
    with pytest.raises(LogError, match=r"cmd_01\.csv: no time, by which it is joined; found the columns stamp"):
        read_log(file, ColumnMap(RULES, columns_of=(ColumnsOf(("cmd_*",), {}),), join=(JOIN,)), dof=None)
    write(tmp_path / "cmd_01.csv", {"stamp": [1.0, 2.0], "port_cmd": [0, 1], "stbd_cmd": [0, 1]})
    with pytest.raises(LogError, match=r"^nav_01\.csv and cmd_01\.csv.* from 100 to 107\.9 s, from 1 to 2 s: .* 5 s\."):
        read_log(file, ColumnMap(RULES, join=(JOIN,)), dof=None)
    (tmp_path / "cmd_01.csv").unlink()
    with pytest.raises(LogError, match=r"nav_01\.csv: no cmd_01\.csv beside it, which join expects"):
        read_log(file, ColumnMap(RULES, join=(JOIN,)), dof=None)
    with pytest.raises(SettingError, match="max_age_s is 0; expected seconds above 0"):
        Join("a", "b", max_age_s=0.0)


def test_commands_in_a_file_are_no_log_of_their_own(tmp_path: Path) -> None:
    for name in ("01", "02"):
        pair(tmp_path / "day", name)
    path = tmp_path / "columns.toml"
    path.write_text(
        '[columns]\ntime_s = "stamp"\nn_port = "port_cmd"\nn_stbd = "stbd_cmd"\n'
        '[logs]\njoin = { logs = "nav_*.csv", with = "cmd_*.csv", max_age_s = 1 }\n'
    )
    columns = read_column_map(path)
    assert columns.join == (Join("nav_*.csv", "cmd_*.csv", max_age_s=1.0),)
    files = whole_logs(find_logs([tmp_path / "day"]), columns)
    assert [file.path.name for file in files] == ["nav_01.csv", "nav_02.csv"]
    runs = check(tmp_path / "day", columns=path, strict=True).runs
    assert [run.run for run in runs] == ["nav_01", "nav_02"]
    assert any(note.startswith("joined to the clock of day/nav_01.csv") for note in runs[0].notes)
    # what is joined is an input all the same, also where only the log was named
    settings = check.settings({"logs": [tmp_path / "day" / "nav_01.csv"], "columns": path})
    assert [file.name for file in check.inputs(settings) if file.role == "log"] == ["cmd_01.csv", "nav_01.csv"]
