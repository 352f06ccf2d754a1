"""A navigation file and a command file of one run are one log, by their names and clocks."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from automarine_cli.commands.check import check
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs import ColumnMap, LogFile, column_rules, find_logs, read_column_map, read_log, whole_logs
from automarine_cli.logs.columns import ColumnsOf, Join, matches

JOIN = Join("nav_*.csv", "cmd_*.csv")
RULES = column_rules({"time_s": "stamp", "n_port": "port_cmd", "n_stbd": "stbd_cmd"}, "")


def write(path: Path, columns: Mapping[str, object]) -> LogFile:
    """A CSV file of these columns."""
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


def test_which_files_belong_together(tmp_path: Path) -> None:
    for name in ("cmd/7.csv", "run_7_cmd.csv", "all.csv"):
        write(tmp_path / name, {"t": []})

    def beside(join: Join, name: str) -> list[str]:
        return [path.relative_to(tmp_path).as_posix() for path in join.beside(tmp_path / name)]

    assert beside(Join("nav/*.csv", "cmd/*.csv"), "nav/7.csv") == ["cmd/7.csv"]
    assert beside(Join("*_nav.csv", ("*_cmd.csv", "all.csv")), "run_7_nav.csv") == ["run_7_cmd.csv", "all.csv"]
    assert beside(Join("*_nav.csv", "*_cmd.csv"), "run_7_cmd.csv") == []
    assert matches(Path("/x/bench/deep/a.csv"), "bench") and matches(Path("/x/bench/a.csv"), "bench/*.csv")
    assert not matches(Path("/x/runs/a.csv"), "bench/*.csv")
