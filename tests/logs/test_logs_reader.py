"""Logs as people and loggers really write them: read right, or refused with the exact sentence."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reader_contract import log, refusal

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, LogTable, read_log, require, require_motion

# The same two samples, 0 s at 1.5 degrees and 0.1 s at 2 degrees, with moments 0 and 1.
TWO_SAMPLES = {
    "plain": b"time_s,heading_deg,tau\n0,1.5,0\n0.1,2,1\n",
    "no newline at the end": b"time_s,heading_deg,tau\n0,1.5,0\n0.1,2,1",
    "byte-order mark and CRLF": b"\xef\xbb\xbftime_s,heading_deg,tau\r\n0,1.5,0\r\n0.1,2,1\r\n",
    "carriage returns only": b"time_s,heading_deg,tau\r0,1.5,0\r0.1,2,1\r",
    "semicolons and decimal commas": b"time_s;heading_deg;tau\n0;1,5;0\n0,1;2;1\n",
    "semicolons and decimal points": b"time_s;heading_deg;tau\n0;1.5;0\n0.1;2;1\n",
    "tabs": b"time_s\theading_deg\ttau\n0\t1.5\t0\n0.1\t2\t1\n",
    "tabs and decimal commas": b"time_s\theading_deg\ttau\n0\t1,5\t0\n0,1\t2\t1\n",
    "blanks and tabs around names and cells": b" time_s ,\theading_deg\t, tau\n 0 , 1.5 , 0\n 0.1,\t2,1 \n",
    "quotes": b'"time_s","heading_deg","tau","note"\n"0","1.5","0","a, b"\n0.1,2,1,"say ""c"""\n',
    "delimiter at the end": b"time_s,heading_deg,tau,\n0,1.5,0,\n0.1,2,1,\n",
    "a spreadsheet's hint": b"sep=;\ntime_s;heading_deg;tau\n0;1,5;0\n0,1;2;1\n",
    "signs and exponents": b"time_s,heading_deg,tau\n-0,+1.5e0,0.\n1E-1,.2e1,+1\n",
    "columns nobody asked for": b"note,time_s,heading_deg,tau,state\na,0,1.5,0,up\nb,0.1,2,1,down\n",
    "Latin-1": "time_s,heading_deg,tau,note \xb0\n0,1.5,0,\xe9\n0.1,2,1,\xfc\n".encode("latin-1"),
}


@pytest.mark.parametrize("content", TWO_SAMPLES.values(), ids=TWO_SAMPLES.keys())
def test_one_table_in_many_spellings(tmp_path: Path, content: bytes) -> None:
    table = read_log(log(tmp_path, content), dof=YAW)
    np.testing.assert_allclose(table.columns["time"], [0, 0.1], rtol=1e-15)
    np.testing.assert_allclose(np.rad2deg(table.columns["heading"]), [1.5, 2], rtol=1e-15)
    np.testing.assert_array_equal(table.columns["moment"], [0, 1])


def test_row_numbers_are_those_of_the_file(tmp_path: Path) -> None:
    text = "# a, b\n\n#c\ntime_s,heading_deg,tau\n# d\n0,1,0\n   \n\n  # e,f,g\n0.1,2,1\n\t\n0.2,3,1\n# end"
    for ending in ("\n", "\r\n"):
        table = read_log(log(tmp_path, text.replace("\n", ending).encode()), dof=YAW)
        assert list(table.rows) == [6, 10, 12]
        assert table.names == ("time_s", "heading_deg", "tau")


def test_missing_values_are_nan(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"time_s,heading_deg,tau\n0,nan,0\n0.1, ,NA\n,3,null\n"), dof=YAW)
    assert [int(np.isnan(table.columns[name]).sum()) for name in ("time", "heading", "moment")] == [1, 2, 2]


def late(cell: bytes, row: int = 1000) -> bytes:
    """A long semicolon table of whole numbers with one other cell far from both ends."""
    rows = [b"%d;%d;0" % (i, i) for i in range(3000)]
    rows[row] = b"%d;%s;0" % (row, cell)
    return b"time_s;heading_deg;tau\n" + b"\n".join(rows) + b"\n"


@pytest.mark.parametrize(("cell", "value"), [(b"1000.5", 1000.5), (b"1000,5", 1000.5), (b"", np.nan)])
def test_what_the_head_does_not_show_is_read_right(tmp_path: Path, cell: bytes, value: float) -> None:
    table = read_log(log(tmp_path, late(cell)), dof=YAW)
    np.testing.assert_allclose(np.rad2deg(table.columns["heading"][999:1002]), [999, value, 1001])


def test_a_column_nobody_asked_for_may_turn_into_text(tmp_path: Path) -> None:
    content = late(b"7").replace(b"tau", b"tau;state").replace(b";0\n", b";0;1\n")
    table = read_log(log(tmp_path, content.replace(b"1000;7;0;1", b"1000;7;0;lost")), dof=YAW)
    assert len(table) == 3000 and dict(table.extras) == {}


def test_units_become_si(tmp_path: Path) -> None:
    header = "time_ms,heading_rad,yaw_rate_deg_s,tau_Nm,voltage_V,surge_m_s,sway_m_s,n,force_kgf\n"
    table = read_log(log(tmp_path, (header + "250,0.5,90,-2,12.5,0.25,-0.25,1500,2\n").encode()), dof=YAW)
    values = {name: float(column[0]) for name, column in table.columns.items()}
    assert values == pytest.approx(
        {"time": 0.25, "heading": 0.5, "yaw_rate": np.pi / 2, "moment": -2, "voltage": 12.5, "surge": 0.25,
         "sway": -0.25, "n": 1500, "force": 19.6133}, rel=1e-15)  # fmt: skip
    assert table.moment_unit == "N m"


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_timestamps(tmp_path: Path, zone: str) -> None:
    rows = "".join(f"2024-05-01T12:00:0{s}{zone},1,0\n" for s in ("0.25", "0.5", "1"))
    table = read_log(log(tmp_path, f"time,heading_deg,tau\n{rows}".encode()), dof=YAW)
    hours = 10 if zone == "+02:00" else 12
    assert table.columns["time"][0] == 1714521600 + 3600 * hours + 0.25
    np.testing.assert_allclose(np.diff(table.columns["time"]), [0.25, 0.5])


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_parquet_types(tmp_path: Path, unit: str) -> None:
    stamp = 1_700_000_000 * {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    table = pa.table({
        "time": pa.array([stamp, None], pa.timestamp(unit, "UTC")),
        "heading_deg": pa.array([90, None], pa.int16()),
        "tau": pa.array([0.5, 1.0], pa.float32()),
        "on": [True, False],
        "state": pa.array(["a", "b"]).dictionary_encode(),
        "matrix": [[1, 2], [3]],
        "run": pa.array([7, 7], pa.int32()),
    })  # fmt: skip
    path = tmp_path / "log.parquet"
    pq.write_table(table, path)
    read = read_log(LogFile(path, path.name, True), dof=YAW)
    assert read.columns["time"][0] == 1_700_000_000 and np.isnan(read.columns["time"][1])
    assert read.columns["heading"][0] == pytest.approx(np.pi / 2) and np.isnan(read.columns["heading"][1])
    assert list(read.extras) == ["on"] and list(read.extras["on"]) == [1, 0]
    assert read.run is not None and list(read.run) == ["7", "7"]
    assert list(read.rows) == [1, 2]


def test_run_names_keep_their_zeros(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"time_s,heading_deg,tau,run\n0,1,0, 01\n1,2,0,1\n2,2,2,b c\n"), dof=YAW)
    assert table.run is not None and list(table.run) == ["01", "1", "b c"]


def mapped(content: bytes, folder: Path, **rules: ColumnRule) -> LogTable:
    """The table of these bytes through a column map."""
    return read_log(log(folder, content), ColumnMap(rules), dof=YAW)


def test_column_map_names_units_and_signs(tmp_path: Path) -> None:
    table = mapped(
        b"t,yaw,rudder,trial\n100,1.5,10,a\n200,2,20,a\n",
        tmp_path,
        time_s=ColumnRule("t", unit="ms"),
        heading_deg=ColumnRule("yaw", unit="rad", sign=-1),
        tau_Nm=ColumnRule("rudder", scale=0.5, offset=1),
        run=ColumnRule("trial"),
    )
    np.testing.assert_allclose(table.columns["time"], [0.1, 0.2])
    np.testing.assert_array_equal(table.columns["heading"], [-1.5, -2])
    np.testing.assert_array_equal(table.columns["moment"], [6, 11])
    assert table.run is not None and set(table.run) == {"a"} and dict(table.extras) == {}


def test_column_map_wins_over_the_file_and_chooses_between_two(tmp_path: Path) -> None:
    content = b"time_s,heading_deg,heading_rad,yaw,tau\n0,1,2,3,0\n"
    assert mapped(content, tmp_path, heading_rad=ColumnRule("yaw")).columns["heading"][0] == 3
    table = mapped(content, tmp_path, heading_rad=ColumnRule("heading_rad"))
    assert table.columns["heading"][0] == 2 and sorted(table.extras) == ["heading_deg", "yaw"]


def test_a_mapped_column_that_is_not_there_is_told(tmp_path: Path) -> None:
    table = mapped(b"time_s,heading_deg,tau\n0,1,0\n", tmp_path, voltage_V=ColumnRule("batt"))
    assert table.notes == ("the column map names 'batt' for voltage_V; the file has no such column",)


# content -> the sentence after the name of the file
REFUSED = {
    b"": ": the file is empty; expected a CSV file with a header and rows. Copy it again, or leave it out",
    b"\n\n# only\n": ": no header and no rows; expected a line of column names. Copy the log again, or leave it out",
    b"time_s,tau\n": ": a header without rows (columns time_s, tau); expected at least one row. "
    "Copy the log again, or leave it out",
    b"0,1,2\n0.1,2,3\n": ", row 1: found numbers ('0,1,2'), expected column names; write a header such as "
    "time_s,heading_deg,tau above the rows",
    b"time_s heading_deg tau\n0 1 2\n": ", row 1: cells seem to be separated by blanks "
    "('time_s heading_deg tau'); expected commas, semicolons or tabs. Write one of these between them",
    b"time_s,tau\n0,1\n\n0.1\n": ", row 4: found 1 cell, expected 2 as in the header (row 1); the row "
    "is '0.1'. "
    "Complete or delete this row",
    b"#\ntime_s,tau\n0,1,2\n": ", row 3: found 3 cells, expected 2 as in the header (row 2); the row is "
    "'0,1,2'. "
    "Complete or delete this row",
    b"time_s,tau\n0,1\n0.1,x\n": ", row 3, column tau: found 'x', expected a number. "
    "Correct the cell, or leave it empty if the value is missing",
    b"time_s,tau\n0,1\n0.1,0x10\n": ", row 3, column tau: found '0x10', expected a number. "
    "Correct the cell, or leave it empty if the value is missing",
    b"time_s;tau\n0;1\n0,1;1.234,5\n": ", row 3, column tau: found '1.234,5', expected a number. "
    "Correct the cell, or leave it empty if the value is missing",
    b"time_s,tau\n0,1\n\n0.1,-inf\n": ", row 4, column tau: found an infinite value, expected a finite "
    "number. "
    "Correct the cell, or leave it empty if the value is missing",
    b"time_s,tau,tau\n0,1,2\n": ": 1 column name given more than once (tau); expected each once. "
    "Rename or delete one in the header",
    b"time_s,heading_deg,heading_rad\n0,1,2\n": ": columns heading_deg and heading_rad both hold the "
    "heading; "
    'expected one. Choose with a line such as heading_deg = "heading_deg" under [columns] in a file and '
    "give it "
    "with --columns FILE.toml",
    b"time_s,tau\n0,1\n0.1,\0\n": ", row 3: found a NUL byte, expected text. The file is binary or was "
    "damaged "
    "while it was written; copy it again, or give the log as text",
    "time_s,tau\n0,1\n".encode("utf-16"): ": is UTF-16 text; expected UTF-8 (save it as UTF-8)",
    b"PK\x03\x04...": ": is a zip archive or spreadsheet; expected plain text (export it as CSV)",
    b"\x1f\x8b...": ": is gzip-compressed; expected plain text (name it .csv.gz)",
    b'time_s,note\n0,"a\nb"\n1,c\n': ", row 2: found a quoted cell that runs over the line end, "
    "expected each row on "
    "one line. Close the quote or take the line break out",
    b"time,tau\n2024-05-01T12:00:00Z,1\nsoon,2\n": ", row 3, column time: found 'soon', expected a "
    "timestamp such "
    "as 2024-05-01T12:00:00.5, all with a time zone or all without. Correct the cell",
    b"time_s,tau,run\n0,1,a\n1,1,\n": ", row 3, column run: no run named; expected the name or number "
    "of the run "
    "in every row. Complete the column",
}


@pytest.mark.parametrize(("content", "sentence"), REFUSED.items(), ids=[s[:40] for s in REFUSED.values()])
def test_refused_with_this_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    assert refusal(log(tmp_path, content)) == "log.csv" + sentence


def test_what_a_yaw_log_lacks_is_said_at_once(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"t,Heading_deg,depth\n0,1,2\n"), dof=YAW)
    with pytest.raises(LogError) as refused:
        require_motion(table)
    assert str(refused.value) == (
        "log.csv: no time, heading and yaw moment; found the columns t, Heading_deg, depth; expected "
        "time_s or "
        "time_ms or time_us or time; heading_deg or heading_rad; tau or tau_Nm or both n_port and "
        "n_stbd. If 't' and "
        '\'Heading_deg\' are meant, write time_s = "t" and heading_deg = "Heading_deg" under [columns] '
        "in a file "
        "and give it with --columns FILE.toml"
    )


@pytest.mark.parametrize(
    ("quantity", "column", "line"),
    [
        ("heading", "yaw_rad", 'heading_rad = "yaw_rad"'),
        ("heading", "yaw_deg", 'heading_deg = "yaw_deg"'),
        ("time", "time", 'time_s = "time"'),
        ("moment", "tau_N_nominal_Nm", 'tau_Nm = "tau_N_nominal_Nm"'),
        ("force", "force_n", 'force_N = "force_n"'),
        ("n", "cmd", 'n = "cmd"'),
        ("n_port", "port_cmd", 'n_port = "port_cmd"'),
    ],
)
def test_a_near_name_is_suggested_not_guessed(tmp_path: Path, quantity: str, column: str, line: str) -> None:
    table = read_log(log(tmp_path, f"{column},depth\n0,1\n".encode()), dof=YAW)
    assert quantity not in table.columns
    with pytest.raises(LogError, match="meant, write") as refused:
        require(table, [quantity])
    assert f"write {line} under [columns]" in str(refused.value)


def test_twenty_thousand_columns(tmp_path: Path) -> None:
    names = ["time_s", "heading_deg", "tau", *(f"c{i}" for i in range(20_000))]
    row = ",".join(["1"] * len(names))
    table = read_log(log(tmp_path, "\n".join([",".join(names), row, row, ""]).encode()), dof=YAW)
    assert len(table) == 2 and len(table.extras) == 20_000
    short = refusal(log(tmp_path, "\n".join([",".join(names), row, "1,2", ""]).encode(), "short.csv"))
    assert short.startswith("short.csv, row 3: found 2 cells, expected 20003 as in the header (row 1)")


# content -> the sentence; what would take minutes and gigabytes is told before
TOO_MUCH = {
    ", row 1: found 40000 columns, expected at most 30000; check separators and line ends": b"," * 39_999 + b"\n1\n",
    ", row 1: found 10000001 bytes in one line, expected a line of column names. Check the line ends": b"a" * 10_000_001
    + b"\n1\n",
    ": a header without rows (columns time_s, tau); expected at least one row. "
    "Copy the log again, or leave it out": b"time_s,tau\n" + b"\n" * 9_000_000,
}


@pytest.mark.parametrize(("sentence", "content"), TOO_MUCH.items(), ids=[s[:40] for s in TOO_MUCH])
def test_too_much_of_something(tmp_path: Path, sentence: str, content: bytes) -> None:
    assert refusal(log(tmp_path, content)) == "log.csv" + sentence


def test_rows_keep_their_numbers_among_empty_lines(tmp_path: Path) -> None:
    lines = ["", "1,2", "", "", "3,4", "5,6", "", "", "", "7,8", ""]
    for ending in ("\n", "\r\n"):
        table = read_log(log(tmp_path, ending.join(["time_s,tau", *lines]).encode()), dof=YAW)
        assert list(table.rows) == [3, 6, 7, 11] and list(table.columns["moment"]) == [2, 4, 6, 8]


def test_the_name_of_a_run_is_short(tmp_path: Path) -> None:
    content = b"time_s,tau,run\n0,1,a\n1,2," + b"b" * 101 + b"\n"
    assert refusal(log(tmp_path, content)) == (
        f"log.csv, row 3, column run: found '{'b' * 60}...' of 101 characters, expected the name of a run of at most "
        "100. Shorten it, or check which column names the runs"
    )


def test_things_that_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "link.csv").symlink_to(tmp_path / "nowhere.csv")
    sentences = [refusal(LogFile(tmp_path / name, name, True)) for name in ("folder.csv", "link.csv", "no.csv")]
    assert sentences == [
        "folder.csv: a directory; expected a CSV file. Rename it, or leave it out",
        "link.csv: a broken link; expected a CSV file. Copy the log here, or leave the link out",
        "no.csv: not a regular file; expected a CSV file. Rename it, or leave it out",
    ]


@given(
    values=st.lists(st.tuples(*[st.floats(-1e6, 1e6, allow_nan=False)] * 2), min_size=1, max_size=20),
    separator=st.sampled_from([",", ";", "\t"]),
    comma=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]),
    marks=st.lists(st.sampled_from(["# note; with, all\tof them", "", "   "]), max_size=4),
)
def test_any_table_survives_any_spelling(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[tuple[float, float]],
    separator: str,
    comma: bool,
    ending: str,
    marks: list[str],
) -> None:
    lines = [separator.join(["time_s", "tau"])] + [f"{a!r}{separator}{b!r}" for a, b in values]
    if comma and separator != ",":
        lines = [line.replace(".", ",") for line in lines]
    for k, mark in enumerate(marks):
        lines.insert((3 * k) % (len(lines) + 1), mark)
    table = read_log(log(tmp_path_factory.mktemp("logs"), ending.join(lines).encode()), dof=YAW)
    assert list(zip(table.columns["time"], table.columns["moment"])) == values
    numbered = [i for i, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    assert list(table.rows) == numbered[1:]
