"""Logs as people and loggers really write them: read right, or refused with row, column and remedy."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reader_contract import log, refusal
from tolerances import assert_close

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, column_rules, read_log, require_motion
from automarine_cli.logs.formats import Stamps, first_not_a_stamp, read_stamps

# The same two samples, 0 s at 1.5 degrees and 0.1 s at 2 degrees, with moments 0 and 1.
TWO_SAMPLES = {
    "no newline at the end": b"time_s,heading_deg,tau\n0,1.5,0\n0.1,2,1",
    "byte-order mark and CRLF": b"\xef\xbb\xbftime_s,heading_deg,tau\r\n0,1.5,0\r\n0.1,2,1\r\n",
    "carriage returns only": b"time_s,heading_deg,tau\r0,1.5,0\r0.1,2,1\r",
    "semicolons and decimal commas": b"time_s;heading_deg;tau\n0;1,5;0\n0,1;2;1\n",
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
def test_two_samples_in_many_spellings(tmp_path: Path, content: bytes) -> None:
    table = read_log(log(tmp_path, content), dof=YAW)
    np.testing.assert_allclose(table.columns["time"], [0, 0.1], rtol=1e-15)
    np.testing.assert_allclose(np.rad2deg(table.columns["heading"]), [1.5, 2], rtol=1e-15)
    np.testing.assert_array_equal(table.columns["moment"], [0, 1])


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_row_numbers_are_those_of_the_file(tmp_path: Path, ending: str) -> None:
    text = "# a, b\n\n#c\ntime_s,heading_deg,tau\n# d\n0,1,0\n   \n\n  # e,f,g\n0.1,2,1\n\t\n0.2,3,1\n0.3,4,1\n# end"
    table = read_log(log(tmp_path, text.replace("\n", ending).encode()), dof=YAW)
    assert list(table.rows) == [6, 10, 12, 13]
    assert table.names == ("time_s", "heading_deg", "tau")


def test_missing_values_are_nan(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"time_s,heading_deg,tau\n0,nan,0\n0.1, ,NA\n,3,null\n"), dof=YAW)
    assert [int(np.isnan(table.columns[name]).sum()) for name in ("time", "heading", "moment")] == [1, 2, 2]


def late(cell: bytes) -> bytes:
    """A long semicolon table of whole numbers with another cell far from both ends."""
    rows = [b"%d;%d;0" % (i, i) for i in range(3000)]
    rows[1000] = b"1000;%s;0" % cell
    return b"time_s;heading_deg;tau\n" + b"\n".join(rows) + b"\n"


@pytest.mark.parametrize(("cell", "value"), [(b"1000.5", 1000.5), (b"1000,5", 1000.5), (b"", np.nan)])
def test_what_the_head_does_not_show_is_read_right(tmp_path: Path, cell: bytes, value: float) -> None:
    table = read_log(log(tmp_path, late(cell)), dof=YAW)
    np.testing.assert_allclose(np.rad2deg(table.columns["heading"][999:1002]), [999, value, 1001])


def test_units_become_si(tmp_path: Path) -> None:
    header = "time_ms,heading_rad,yaw_rate_deg_s,tau_Nm,voltage_V,surge_m_s,sway_m_s,n,force_kgf\n"
    table = read_log(log(tmp_path, (header + "250,0.5,90,-2,12.5,0.25,-0.25,1500,2\n").encode()), dof=YAW)
    values = {name: float(column[0]) for name, column in table.columns.items()}
    assert values == pytest.approx(
        {"time": 0.25, "heading": 0.5, "yaw_rate": np.pi / 2, "moment": -2, "voltage": 12.5, "surge": 0.25,
         "sway": -0.25, "n": 1500, "force": 19.6133}, rel=1e-15)  # fmt: skip
    assert table.moment_unit == "N m"


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_parquet_types(tmp_path: Path, unit: str) -> None:
    stamp = 1_700_000_000 * {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({
        "time": pa.array([stamp, None], pa.timestamp(unit, "UTC")),
        "heading_deg": pa.array([90, None], pa.int16()),
        "tau": pa.array([0.5, 1.0], pa.float32()),
        "on": [True, False],
        "state": pa.array(["a", "b"]).dictionary_encode(),
        "matrix": [[1, 2], [3]],
        "run": pa.array([7, 7], pa.int32()),
    }), path)  # fmt: skip
    table = read_log(LogFile(path, path.name, True), dof=YAW)
    assert table.columns["time"][0] == 1_700_000_000 and np.isnan(table.columns["time"][1])
    assert table.columns["heading"][0] == pytest.approx(np.pi / 2) and np.isnan(table.columns["heading"][1])
    assert list(table.extras) == ["on"] and list(table.extras["on"]) == [1, 0]
    assert table.run is not None and list(table.run) == ["7", "7"]
    assert list(table.rows) == [1, 2]


def test_run_names_keep_their_zeros(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"time_s,heading_deg,tau,run\n0,1,0, 01\n1,2,0,1\n2,2,2,b c\n"), dof=YAW)
    assert table.run is not None and list(table.run) == ["01", "1", "b c"]


# content -> what is said after the name of the file, and the remedy; more such logs are in broken_logs
REFUSED = {
    b"time_s heading_deg tau\n0 1 2\n": (", row 1: cells seem to be separated by blanks", "Write one of these"),
    b"#\ntime_s,tau\n0,1\n\n0.1\n": (", row 5: found 1 cell, expected 2 as in the header (row 2)", "this row"),
    b"time_s,tau\n0,1\n0.1,0x10\n": (", row 3, column tau: found '0x10'", "Correct the cell"),
    b"time_s;tau\n0;1\n0,1;1.234,5\n": (", row 3, column tau: found '1.234,5'", "Correct the cell"),
    b"PK\x03\x04...": (": is a zip archive or spreadsheet", "export it as CSV"),
    b"\x1f\x8b...": (": is gzip-compressed", "name it .csv.gz"),
    # what would take minutes and gigabytes is refused before
    b"," * 39_999 + b"\n1\n": (", row 1: found 40000 columns, expected at most 30000", "check separators"),
    b"time_s,tau\n" + b"\n" * 9_000_000: (": a header without rows (columns time_s, tau)", "Copy the log again"),
}


@pytest.mark.parametrize(("content", "parts"), REFUSED.items(), ids=[parts[0][:40] for parts in REFUSED.values()])
def test_refused_with_row_column_and_remedy(tmp_path: Path, content: bytes, parts: tuple[str, str]) -> None:
    sentence = refusal(log(tmp_path, content))
    assert sentence.startswith("log.csv" + parts[0]) and parts[1] in sentence, sentence


def test_what_a_yaw_log_lacks_is_said_at_once(tmp_path: Path) -> None:
    table = read_log(log(tmp_path, b"t,Heading_deg,depth\n0,1,2\n"), dof=YAW)
    with pytest.raises(LogError) as refused:
        require_motion(table)
    for part in (
        "log.csv: no time and heading and yaw moment; found the columns t, Heading_deg, depth",
        "time_s or time_ms or time_us or time; heading_deg or heading_rad; tau or tau_Nm or both n_port and n_stbd",
        'time_s = "t" and heading_deg = "Heading_deg" under [columns]', "--columns FILE.toml",
    ):  # fmt: skip
        assert part in str(refused.value)


@given(
    values=st.lists(st.tuples(*[st.floats(-1e6, 1e6, allow_nan=False)] * 2), min_size=1, max_size=20),
    spelling=st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]),
    ending=st.sampled_from(["\n", "\r\n"]),
    marks=st.lists(st.sampled_from(["# note; with, all\tof them", "", "   "]), max_size=4),
)
def test_any_table_survives_any_spelling(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[tuple[float, float]], spelling: tuple[str, str], ending: str, marks: list[str],
) -> None:  # fmt: skip
    separator, point = spelling
    lines = [separator.join(["time_s", "tau"])]
    lines += [f"{a!r}{separator}{b!r}".replace(".", point) for a, b in values]
    for k, mark in enumerate(marks):
        lines.insert((3 * k) % (len(lines) + 1), mark)
    table = read_log(log(tmp_path_factory.mktemp("logs"), ending.join(lines).encode()), dof=YAW)
    assert list(zip(table.columns["time"], table.columns["moment"])) == values
    numbered = [i for i, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    assert list(table.rows) == numbered[1:]


# Times as spreadsheets and loggers write them


def cells_of(*cells: str) -> pa.ChunkedArray:
    return pa.chunked_array([pa.array([cell.encode() for cell in cells])])


def stamps(*cells: str, day_first: bool | None = None) -> Stamps:
    times = read_stamps(cells_of(*cells), day_first)
    assert times is not None
    return times


@pytest.mark.parametrize(
    ("first", "second", "kind", "open_still"),
    [
        ("03.05.2024 14:00:20,200", "03.05.2024 14:00:20,300", "dates, day first", False),  # dots
        ("13/05/2024 14:00:20.2", "13/05/2024 14:00:20.3", "dates, day first", False),
        ("05/13/2024 02:00:20.2 PM", "05/13/2024 02:00:20.3 PM", "dates, month first", False),
        ("03/05/2024 14:00:20.2", "03/05/2024 14:00:20.3", "dates, day first", True),
        ("2024-05-03 14:00:20,200", "2024-05-03 14:00:20,300", "timestamps", False),
        ("2024/05/03 14:00:20.2", "2024/05/03 14:00:20.3", "dates, year first", False),
        ("14:00:20.2", "14:00:20.3", "clock times", False),
        ("00:20.2", "00:20.3", "clock times", False),
    ],
)
def test_the_column_decides(first: str, second: str, kind: str, open_still: bool) -> None:
    times = stamps(first, "", second)
    assert (times.kind, times.open) == (kind, open_still)
    assert np.isnan(times.seconds[1]) and times.seconds[2] > times.seconds[0]


@pytest.mark.parametrize(
    ("cell", "when", "day_first"),
    [
        ("03.05.2024 14:00:20,25", (2024, 5, 3, 14, 0, 20, 250_000), None),
        ("5/13/2024 12:00:20 AM", (2024, 5, 13, 0, 0, 20), None),
        ("13/05/24 12:00:20 pm", (2024, 5, 13, 12, 0, 20), None),
        ("2024/02/29 01:02:03.5", (2024, 2, 29, 1, 2, 3, 500_000), None),
        ("2024-05-01T12:00:00.25", (2024, 5, 1, 12, 0, 0, 250_000), None),
        ("2024-05-01T12:00:00.5+02:00", (2024, 5, 1, 10, 0, 0, 500_000), None),
        ("03/05/2024 14:00:20", (2024, 5, 3, 14, 0, 20), True),  # a setting decides what is open
        ("03/05/2024 14:00:20", (2024, 3, 5, 14, 0, 20), False),
    ],
)
def test_seconds_are_those_of_the_calendar(cell: str, when: tuple[int, ...], day_first: bool | None) -> None:
    times = stamps(cell, day_first=day_first)
    assert_close(times.seconds, [datetime(*when, tzinfo=UTC).timestamp()], "same arithmetic")  # type: ignore[misc,arg-type]
    assert not times.open


def test_a_clock_goes_on_past_midnight_and_past_the_hour() -> None:
    times = stamps("23:59:59.5", "", "00:00:00.5", "00:00:01,5", "23:59:59", "00:00:00")
    assert_close(times.seconds[[0, 2, 3, 4, 5]], [86399.5, 86400.5, 86401.5, 172799, 172800], "same arithmetic")
    assert_close(stamps("59:59.5", "00:00.5").seconds, [3599.5, 3600.5], "same arithmetic")


@pytest.mark.parametrize(
    "cells", [("31.02.2024 10:00:00",), ("10:00:00", "noon"), ("13/13/2024 10:00:00",), ("1", "2")]
)
def test_what_is_no_time(cells: tuple[str, ...]) -> None:
    assert read_stamps(cells_of(*cells), None) is None
    assert first_not_a_stamp(cells_of(*cells), None)[1] in cells
    assert read_stamps(pa.chunked_array([pa.array([b"10:00:00", b"\xe9t\xe9"])]), None) is None  # not even UTF-8


def read(folder: Path, date: str, **rule: object) -> LogTable:
    """A log of five seconds of that day."""
    rows = [f"{date} 14:00:2{i},250;{i};0,5" for i in range(5)]
    content = "\n".join(["Zeit;heading_deg;tau", *rows, ""]).encode()
    columns = ColumnMap(column_rules({"time": {"from": "Zeit", **rule}}, "columns.toml"))
    return read_log(log(folder, content), columns, dof=None)


def test_a_log_with_dates_says_how_they_are_read_and_an_open_date_is_refused(tmp_path: Path) -> None:
    table = read(tmp_path, "03.05.2024")
    assert_close(np.diff(table.columns["time"]), np.ones(4), "same arithmetic")
    assert table.notes == ("column Zeit: dates, day first",)
    with pytest.raises(LogError) as refused:
        read(tmp_path, "03/05/2024")
    for part in ("log.csv, column Zeit: found '03/05/2024 14:00:20", "day_first = true } (or false)", "--columns"):
        assert part in str(refused.value)
    table = read(tmp_path, "03/05/2024", day_first=False)
    assert table.notes == ()
    assert table.columns["time"][0] == datetime(2024, 3, 5, 14, 0, 20, 250_000, tzinfo=UTC).timestamp()
