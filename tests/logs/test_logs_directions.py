"""Column maps of control signals: a neutral that is subtracted, a sign told by another column, maps of single files."""

from pathlib import Path

import numpy as np
import pytest
from tolerances import assert_close

from automarine_cli.commands.check import check
from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, column_rules, read_column_map, read_log
from automarine_cli.report.sections import sections

BENCH = "PWM_us,rpm,load\n1100,3000,-40\n1300,1500,-10\n1500,0,0\n1700,1600,12\n1900,3200,48\n"


def bench(folder: Path, rules: dict[str, object]) -> dict[str, np.ndarray]:
    """The columns of a bollard test under these rules."""
    (folder / "bench.csv").write_text(BENCH, encoding="utf-8")
    columns = ColumnMap(column_rules(rules, "columns.toml"))
    return dict(read_log(LogFile(folder / "bench.csv", "bench.csv", True), columns, dof=YAW).columns)


def test_a_neutral_is_subtracted_first(tmp_path: Path) -> None:
    rule = {"from": "PWM_us", "subtract": 1500, "scale": 0.0025, "offset": 1, "sign": -1}
    assert_close(bench(tmp_path, {"n": rule})["n"], -(0.0025 * np.arange(-400, 401, 200) + 1), "same arithmetic")


@pytest.mark.parametrize("way", ["load", {"from": "PWM_us", "subtract": 1500}])
def test_another_column_says_the_direction(tmp_path: Path, way: object) -> None:
    found = bench(tmp_path, {"n": {"from": "rpm", "sign_from": way}})
    assert_close(found["n"], [-3000, -1500, 0, 1600, 3200], "same arithmetic")
    turned = way if isinstance(way, dict) else {"from": way}
    mirrored = bench(tmp_path, {"n": {"from": "rpm", "sign_from": {**turned, "sign": -1}}})
    assert_close(mirrored["n"], [3000, 1500, 0, -1600, -3200], "same arithmetic")


def test_a_direction_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"n takes its sign from 'pwm'; the file has no such column\. Correct sign_from"):
        bench(tmp_path, {"n": {"from": "rpm", "sign_from": "pwm"}})


def test_single_files_have_maps_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "a.csv").write_text("time,x,F\n0,1,2\n1000,2,3\n", encoding="utf-8")
    (tmp_path / "run.csv").write_text("time,x,tau\n0,10,1\n0.1,20,1\n", encoding="utf-8")
    text = (
        '[columns]\ntime_s = "time"\nheading_deg = "x"\n[[columns_of]]\nlogs = "bench/*.csv"\ntime_ms = "time"\n'
        'n = "x"\nforce_N = "F"\n'
    )
    (tmp_path / "columns.toml").write_text(text, encoding="utf-8")
    columns = read_column_map(tmp_path / "columns.toml")
    tables = [read_log(LogFile(tmp_path / name, name, True), columns, dof=YAW) for name in ("bench/a.csv", "run.csv")]
    assert tables[0].columns.keys() == {"time", "n", "force"} and tables[0].columns["time"][1] == 1.0
    assert tables[1].columns.keys() == {"time", "heading", "moment"} and tables[1].columns["time"][1] == 0.1


def test_check_tells_a_signal_that_holds_its_neutral_or_lacks_its_sign(tmp_path: Path) -> None:
    (tmp_path / "bench.csv").write_text(BENCH, encoding="utf-8")
    for name, words in (("PWM_us", "from 1100 to 1900, as pulses about 1500 do"), ("rpm", "never negative while the")):
        columns = ColumnMap(column_rules({"n": name, "force_N": "load"}, ""))
        found = check(tmp_path / "bench.csv", columns=columns)
        assert words in found.tests[0].notes[0]
        assert words in sections(found).printed[0].notes[0]
    right = ColumnMap(column_rules({"n": {"from": "PWM_us", "subtract": 1500}, "force_N": "load"}, ""))
    assert check(tmp_path / "bench.csv", columns=right).tests[0].notes == []


@pytest.mark.parametrize(
    ("name", "unit"), [("PWM_us", "us"), ("port rpm", "rpm"), ("throttle_pct", "%"), ("Throttle (%)", "%"), ("u", "")]
)
def test_a_signal_s_unit_is_told_by_its_name(tmp_path: Path, name: str, unit: str) -> None:
    (tmp_path / "a.csv").write_text(f"{name},force_N\n1,2\n2,3\n", encoding="utf-8")
    columns = ColumnMap(column_rules({"n": name}, ""))
    assert read_log(LogFile(tmp_path / "a.csv", "a.csv", True), columns, dof=YAW).units["n"] == unit
