"""Column maps: what they may say, what becomes of the columns, and the key's path for what they may not."""

from pathlib import Path

import numpy as np
import pytest
from reader_contract import log
from tolerances import assert_close

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, LogTable, column_rules, read_column_map, read_log


def written(folder: Path, text: str | bytes) -> Path:
    """A column map file of this text."""
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


def test_a_map_that_gives_the_unit_or_the_scale_is_believed(tmp_path: Path) -> None:
    for value in ('{ from = "heading_deg", unit = "rad" }', '{ from = "heading_deg", scale = 0.0174533 }'):
        names = read_column_map(written(tmp_path, f"[columns]\nheading_rad = {value}\n"))
        assert names.columns["heading_rad"].source == "heading_deg"


def mapped(folder: Path, content: str, **rules: ColumnRule) -> LogTable:
    """The table of this text through a column map."""
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


def test_a_map_wins_over_the_file_and_says_what_it_misses(tmp_path: Path) -> None:
    content = "time_s,heading_deg,heading_rad,yaw,tau\n0,1,2,3,0\n"
    assert mapped(tmp_path, content, heading_rad=ColumnRule("yaw")).columns["heading"][0] == 3
    table = mapped(tmp_path, content, heading_rad=ColumnRule("heading_rad"))
    assert table.columns["heading"][0] == 2 and sorted(table.extras) == ["heading_deg", "yaw"]
    (note,) = mapped(tmp_path, "time_s,heading_deg,tau\n0,1,0\n", voltage_V=ColumnRule("batt")).notes
    assert "'batt' for voltage_V" in note


BENCH = "PWM_us,rpm,load\n1100,3000,-40\n1300,1500,-10\n1500,0,0\n1700,1600,12\n1900,3200,48\n"


def bench(folder: Path, **rules: object) -> LogTable:
    """A bollard test under these rules."""
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
