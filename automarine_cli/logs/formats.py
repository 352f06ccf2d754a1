"""What log files are, and what a format makes of one: a `RawLog`; and how cells of text become numbers or times.

To add a format, write one file here with `read(path, name, columns) -> RawLog` and `FORMAT = Format("what people call
it", (".suffix",), read)`, and name it in `FORMATS` of `find.py`. Streams, each on its own clock, become one table by
`streams.on_one_clock`; a library that not everybody has is imported within `read`, by `streams.needed`.
`tests/helpers/reader_contract.py` tests it."""

import contextlib
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.pipeline.records import Document, Source
from automarine_cli.quantities import Floats
from automarine_cli.text import plural

MAX_COLUMNS = 30_000
MAX_UNPACKED, MAX_TIMES = 64 << 20, 100  # bytes; times the file


@dataclass(frozen=True)
class LogFile:
    """One log: where it is, what results call it, and whether it was named on the command line (unreadable, it is
    refused) or found (it is set aside). A table in memory has its `content`, as a Parquet file would."""

    path: Path
    name: str
    named: bool
    content: bytes | None = field(default=None, repr=False)

    @property
    def source(self) -> Source:
        return self.path if self.content is None else Document(self.name, self.content)


@dataclass(frozen=True)
class CommandOrigin:
    """Outputs and mixing of which commands were made, or why these tell none (continues `no yaw moment;`)."""

    made_from: str = ""
    why_not: str = ""


LOGGED = CommandOrigin()


@dataclass(frozen=True)
class RawLog:
    """A file as its format gives it: column names, one Arrow array each (N,), and row numbers for messages.

    An array is float64 (null where missing), timestamp, or binary text with `decimal` between whole and fraction.
    `also` holds other names of columns (name -> column), `holds` the messages or topics of the file."""

    names: tuple[str, ...]
    arrays: tuple[pa.ChunkedArray, ...]
    rows: NDArray[np.int64]
    decimal: str = "."
    also: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    holds: tuple[str, ...] = ()
    origin: CommandOrigin = LOGGED

    def place(self, name: str) -> int | None:
        """The number of the column of this name, or other name; None for none."""
        name = name if name in self.names else self.also.get(name, name)
        return self.names.index(name) if name in self.names else None

    def is_numeric(self, index: int) -> bool:
        return bool(pa.types.is_floating(self.arrays[index].type))


@dataclass(frozen=True)
class Format:
    """One log format: `read(path, name, columns)` takes the name to use in messages and the column map, and raises
    LogError. Where others use the suffixes too, a file found in a folder has to begin with one of `begins`."""

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, str, ColumnMap], RawLog]
    begins: tuple[bytes, ...] = ()


def most_unpacked(path: Path) -> int:
    """The most bytes that a packed file may unpack to: what grows more is made to fill the memory."""
    return max(MAX_UNPACKED, MAX_TIMES * path.stat().st_size)


def too_well_packed(name: str) -> LogError:
    return LogError(f"{name}: unpacks to more than {MAX_TIMES} times its size, which no log does; check its content")


def too_many_columns(where: str, count: int) -> LogError:
    return LogError(f"{where}: found {count} columns, expected at most {MAX_COLUMNS}; check separators and line ends")


def refuse_empty(content: object, source: str, content_name: str) -> None:
    if not content:
        raise LogError(
            f"{source}: found no {content_name}, expected some from its extension; copy the file again, or rename it"
        )


def skipped(count: int, thing: str, why: str) -> tuple[str, ...]:
    """The note on what of a file was not read, none for nothing."""
    return (f"{plural(count, thing)} skipped: {why}",) if count else ()


EMPTY = ("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE)


def is_number(cell: str, decimal: str = ".") -> bool:
    return NUMBER.fullmatch(cell.replace(decimal, ".") if decimal == "," else cell) is not None


def text_of(content: bytes) -> str:
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def decoded(cell: bytes | str | None) -> str:
    """A cell as text without blanks around it."""
    return (text_of(cell) if isinstance(cell, bytes) else cell or "").strip()


def plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    """Text cells without blanks around them, missing ones null. Raises pyarrow.ArrowInvalid if not UTF-8."""
    trimmed = pc.utf8_trim_whitespace(pc.cast(array, pa.string()))
    return pc.if_else(pc.is_in(trimmed, value_set=pa.array(EMPTY)), pa.scalar(None, pa.string()), trimmed)


def numbers(array: pa.ChunkedArray, decimal: str = ".") -> pa.ChunkedArray | None:
    """Text cells as float64, or None where at least one is not a number."""
    try:
        cells = plain(array)
        if decimal == ",":
            if pc.any(pc.match_substring(cells, ".")).as_py():
                return None
            cells = pc.replace_substring(cells, ",", ".", max_replacements=1)
        return pc.cast(pc.replace_substring_regex(cells, r"^\+", ""), pa.float64())
    except pa.ArrowInvalid:
        return None


def first_not_a_number(array: pa.ChunkedArray, decimal: str = ".") -> tuple[int, str]:
    """Index and text of the first cell that keeps a text column from being numbers."""
    texts = [decoded(cell) for cell in array.to_pylist()]
    i = next((i for i, text in enumerate(texts) if text not in EMPTY and not is_number(text, decimal)), 0)
    return i, texts[i]


DAY, HOUR = 86400.0, 3600.0
_SHAPE = (
    r"^(?:(?P<date>\d{1,4}[./-]\d{1,2}[./-]\d{1,4})(?:[T,]? +|T))?"
    r"(?P<clock>\d{1,2}:\d{2}(?::\d{2})?(?:[.,]\d+)?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?$"
)


@dataclass(frozen=True)
class Stamps:
    """Times of a column [s], (N,), NaN where missing: since 1970 (UTC), of bare clock times since midnight. `kind` says
    how they are written; `open` that day and month may be exchanged."""

    seconds: Floats
    kind: str
    open: bool = False


def read_stamps(array: pa.ChunkedArray, day_first: bool | None = None) -> Stamps | None:
    """Read the times of a column, typed or text; None where a cell is none. Day or month first: as `day_first` says,
    else as a number above 12 shows; dots are day first where nothing speaks against it. A clock goes on past
    midnight."""
    typed = array if pa.types.is_timestamp(array.type) else _parsed(array)
    if typed is not None:
        return Stamps(_seconds(typed), "timestamps")
    try:
        cells = plain(array)
    except pa.ArrowInvalid:
        return None
    parts = pc.extract_regex(cells, _SHAPE)
    if pc.any(pc.and_(pc.is_valid(cells), pc.is_null(parts))).as_py():
        return None
    date, clock, half = (pc.struct_field(parts, name) for name in ("date", "clock", "half"))
    seconds, again = _clock(clock, half)
    dated = pc.not_equal(date, "")
    if not pc.any(dated).as_py():
        return Stamps(_past_midnight(seconds, again), "clock times")
    if not pc.all(dated).as_py():
        return None
    import pandas as pd  # here, as clocks in seconds need none of it

    days = pc.replace_substring_regex(date, "[.-]", "/")
    year = "%y" if pc.all(pc.match_substring_regex(days, r"/\d\d$")).as_py() else "%Y"
    ways = []
    for first, kind, form in (
        (None, "year", "%Y/%m/%d"), (True, "day", f"%d/%m/{year}"), (False, "month", f"%m/%d/{year}"),
    ):  # fmt: skip
        if first is None or day_first in (None, first):
            with contextlib.suppress(ValueError):
                since = pd.to_datetime(days.to_pandas(), format=form) - pd.Timestamp(0)
                ways.append(Stamps(since.dt.total_seconds().to_numpy() + seconds, f"dates, {kind} first"))
    if len(ways) < 2:
        return ways[0] if ways else None
    return replace(ways[0], open=not pc.any(pc.match_substring(date, ".")).as_py())


def first_not_a_stamp(array: pa.ChunkedArray, day_first: bool | None) -> tuple[int, str]:
    """Index and text of the first cell that keeps a column from being times, or from being like those before."""
    i = bisect_left(range(len(array)), True, key=lambda last: read_stamps(array.slice(0, last + 1), day_first) is None)
    return i, decoded(array[i].as_py())


def _clock(clock: Any, half: Any) -> tuple[Floats, float]:
    """Seconds since midnight of every cell, and after how many they begin again; 20:15.4 is minutes and seconds."""
    import pandas as pd

    text = pc.replace_substring(clock, ",", ".")
    short = pc.equal(pc.count_substring(text, ":"), 1)
    hourly = bool(pc.all(short).as_py() and pc.any(pc.match_substring_regex(text, r"\.0*[1-9]")).as_py())
    filled = pc.binary_join_element_wise("0:" if hourly else "", text, "" if hourly else ":00", "")
    cells = pc.if_else(short, filled, text).to_pandas()
    seconds = pd.to_timedelta(cells, errors="coerce").dt.total_seconds().to_numpy()
    halves = pc.utf8_lower(half).to_numpy()
    seconds = np.where(np.isin(halves, ["a", "p"]), seconds % (DAY / 2) + DAY / 2 * (halves == "p"), seconds)
    return seconds, HOUR if hourly else DAY


def _past_midnight(clock: Floats, again: float) -> Floats:
    finite = np.isfinite(clock)
    seconds = clock.copy()
    seconds[finite] += again * np.cumsum(np.diff(clock[finite], prepend=clock[finite][:1]) < -again / 2)
    return seconds


def _seconds(array: pa.ChunkedArray) -> Floats:
    exact = pc.cast(array, pa.timestamp("ns", getattr(array.type, "tz", None)), safe=False)
    stamps: Any = pc.cast(exact, pa.int64())
    nanoseconds = pc.fill_null(stamps, 0).to_numpy().astype(np.int64)
    seconds = (nanoseconds // 10**9).astype(np.float64) + (nanoseconds % 10**9) / 1e9
    seconds[np.asarray(pc.is_null(stamps))] = np.nan
    return seconds


def _parsed(array: pa.ChunkedArray) -> pa.ChunkedArray | None:
    """ISO 8601 text as timestamps; a decimal comma will do, as Python's logging writes it."""
    for comma in (False, True):
        for kind in (pa.timestamp("ns"), pa.timestamp("ns", tz="UTC")):
            try:
                cells = plain(array)
                return pc.cast(pc.replace_substring(cells, ",", ".") if comma else cells, kind)
            except pa.ArrowInvalid:
                continue
    return None
