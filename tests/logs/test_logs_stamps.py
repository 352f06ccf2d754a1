"""Times as spreadsheets and loggers write them: dates by country, clock times of the day, and what is left open."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from reader_contract import log
from tolerances import assert_close

from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, LogTable, column_rules, read_log
from automarine_cli.logs.formats import Stamps, first_not_a_stamp, read_stamps


def cells_of(*cells: str) -> pa.ChunkedArray:
    return pa.chunked_array([pa.array([cell.encode() for cell in cells])])


def stamps(*cells: str, day_first: bool | None = None) -> Stamps:
    """The times of these cells."""
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
