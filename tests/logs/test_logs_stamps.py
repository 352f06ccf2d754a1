"""Times as spreadsheets and loggers write them: dates by country, clock times of the day, and what is left open."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from tolerances import assert_close

from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, column_rules, read_log
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Stamps, first_not_a_stamp, read_stamps


def stamps(*cells: str, day_first: bool | None = None) -> Stamps | None:
    """The times of these cells."""
    return read_stamps(pa.chunked_array([pa.array([cell.encode() for cell in cells])]), day_first)


def since_1970(*when: float) -> float:
    """Seconds of a calendar time, worked out by the standard library."""
    year, month, day, hour, minute, second = when
    whole = datetime(int(year), int(month), int(day), int(hour), int(minute), tzinfo=UTC)
    return whole.timestamp() + second


@pytest.mark.parametrize(
    ("first", "second", "kind", "open_still"),
    [
        ("03.05.2024 14:00:20,200", "03.05.2024 14:00:20,300", "day first", False),  # dots
        ("13/05/2024 14:00:20.2", "13/05/2024 14:00:20.3", "day first", False),
        ("05/13/2024 02:00:20.2 PM", "05/13/2024 02:00:20.3 PM", "month first", False),
        ("03/05/2024 14:00:20.2", "03/05/2024 14:00:20.3", "day first", True),
        ("03/05/2024 23:59:59.9", "04/05/2024 00:00:00.0", "day first", False),  # a night without a gap
        ("05/03/2024 23:59:59.9", "05/04/2024 00:00:00.0", "month first", False),
        ("12/04/2024 10:00:00", "01/05/2024 10:00:00", "day first", False),  # a clock that rises
        ("2024-05-03 14:00:20,200", "2024-05-03 14:00:20,300", "iso", False),
        ("2024/05/03 14:00:20.2", "2024/05/03 14:00:20.3", "year first", False),
        ("14:00:20.2", "14:00:20.3", "clock", False),
        ("00:20.2", "00:20.3", "clock", False),
    ],
)
def test_the_column_decides(first: str, second: str, kind: str, open_still: bool) -> None:
    found = stamps(first, "", second)
    assert found is not None
    assert (found.kind, found.open) == (kind, open_still)
    assert np.isnan(found.seconds[1])
    assert found.seconds[2] > found.seconds[0]


def test_seconds_are_those_of_the_calendar() -> None:
    for cell, when in (
        ("03.05.2024 14:00:20,25", (2024, 5, 3, 14, 0, 20.25)),
        ("5/13/2024 12:00:20 AM", (2024, 5, 13, 0, 0, 20)),
        ("13/05/24 12:00:20 pm", (2024, 5, 13, 12, 0, 20)),
        ("2024/02/29 01:02:03.5", (2024, 2, 29, 1, 2, 3.5)),
    ):
        found = stamps(cell)
        assert found is not None
        assert_close(found.seconds, [since_1970(*when)], "same arithmetic")


def test_a_setting_decides_what_is_open() -> None:
    both = [stamps("03/05/2024 14:00:20", day_first=first) for first in (True, False)]
    assert [found and (found.kind, found.open) for found in both] == [("day first", False), ("month first", False)]
    assert both[0] and both[1]
    assert_close(both[0].seconds, [since_1970(2024, 5, 3, 14, 0, 20)], "same arithmetic")
    assert_close(both[1].seconds, [since_1970(2024, 3, 5, 14, 0, 20)], "same arithmetic")


def test_a_clock_goes_on_past_midnight() -> None:
    found = stamps("23:59:59.5", "", "00:00:00.5", "00:00:01,5", "23:59:59", "00:00:00")
    assert found is not None
    assert_close(found.seconds[[0, 2, 3, 4, 5]], [86399.5, 86400.5, 86401.5, 172799, 172800], "same arithmetic")
    hours_gone = stamps("59:59.5", "00:00.5")
    assert hours_gone is not None
    assert_close(hours_gone.seconds, [3599.5, 3600.5], "same arithmetic")


@pytest.mark.parametrize(
    "cells", [("31.02.2024 10:00:00",), ("10:00:00", "noon"), ("13/13/2024 10:00:00",), ("1", "2")]
)
def test_what_is_no_time(cells: tuple[str, ...]) -> None:
    assert stamps(*cells) is None
    array = pa.chunked_array([pa.array([cell.encode() for cell in cells])])
    assert first_not_a_stamp(array, None)[1] in cells


def log(folder: Path, times: list[str], name: str = "Zeit") -> LogFile:
    """A log of a turn with these times."""
    path = folder / "run.csv"
    rows = [f"{time};{i};0,5" for i, time in enumerate(times)]
    path.write_text("\n".join([f"{name};heading_deg;tau", *rows]) + "\n", encoding="utf-8")
    return LogFile(path, "run.csv", True)


def test_a_log_with_dates_is_read_and_says_how(tmp_path: Path) -> None:
    columns = ColumnMap(column_rules({"time": "Zeit"}, "columns.toml"))
    file = log(tmp_path, [f"03.05.2024 14:00:2{i},250" for i in range(5)])
    table = read_log(file, columns, dof=None)
    assert_close(np.diff(table.columns["time"]), np.ones(4), "same arithmetic")
    assert table.notes == ("column Zeit: dates are read with the day first",)


def test_an_open_date_is_refused_with_the_setting(tmp_path: Path) -> None:
    file = log(tmp_path, [f"03/05/2024 14:00:2{i}" for i in range(5)])
    columns = ColumnMap(column_rules({"time": "Zeit"}, "columns.toml"))
    with pytest.raises(LogError) as refused:
        read_log(file, columns, dof=None)
    assert str(refused.value) == (
        "run.csv, column Zeit: found '03/05/2024 14:00:20', in which the day or the month may come first; say which "
        'with time = { from = "Zeit", day_first = true } (or false) under [columns] in a file and give it with '
        "--columns FILE.toml"
    )
    said = ColumnMap(column_rules({"time": {"from": "Zeit", "day_first": False}}, "columns.toml"))
    table = read_log(file, said, dof=None)
    assert table.notes == ()
    assert_close(table.columns["time"][0], since_1970(2024, 3, 5, 14, 0, 20), "same arithmetic")
