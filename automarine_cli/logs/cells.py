"""Cells of text: which are missing, which are numbers, and which are times.

Calendar and clock times of a column become seconds: ISO 8601, dates such as 03.05.2024, bare clock times.
"""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from automarine_cli.quantities import Floats

MISSING = ("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE)


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell, blanks stripped, is a number with this decimal character."""
    return NUMBER.fullmatch(cell.replace(decimal, ".") if decimal == "," else cell) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell, blanks stripped, says that there is no value."""
    return cell in MISSING


def decoded(cell: bytes | str | None) -> str:
    """A cell as text without blanks around it; bytes that are not UTF-8 are read as Latin-1."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell.strip()
    try:
        return cell.decode("utf-8").strip()
    except UnicodeDecodeError:
        return cell.decode("latin-1").strip()


def plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    """Text cells without blanks around them, missing ones null. Raises pyarrow.ArrowInvalid if not UTF-8."""
    trimmed = pc.utf8_trim_whitespace(pc.cast(array, pa.string()))
    return pc.if_else(pc.is_in(trimmed, value_set=pa.array(MISSING)), pa.scalar(None, pa.string()), trimmed)


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
    for start in range(0, len(array), 65536):
        for i, cell in enumerate(array.slice(start, 65536).to_pylist()):
            text = decoded(cell)
            if not is_missing(text) and not is_number(text, decimal):
                return start + i, text
    return 0, decoded(array[0].as_py())


DAY, HOUR = 86400.0, 3600.0
_SHAPE = (
    r"^(?:(?P<one>\d{1,4})(?P<dot>[./-])(?P<two>\d{1,2})[./-](?P<three>\d{1,4})(?:[T,]? +|T))?"
    r"(?P<first>\d{1,2}):(?P<second>\d{2})(?::(?P<third>\d{2}))?(?P<part>[.,]\d+)?(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?$"
)
KINDS = {
    "iso": "timestamps",
    "year first": "dates, year first",
    "day first": "dates, day first",
    "month first": "dates, month first",
    "clock": "clock times",
}


@dataclass(frozen=True)
class Stamps:
    """Times of a column [s], shape (N,), a missing one NaN: since 1970 (UTC; without a zone taken as UTC), of bare
    clock times since midnight. `kind` is one of `KINDS`; `open` says that day and month may as well be exchanged."""

    seconds: Floats
    kind: str
    open: bool = False


def read_stamps(array: pa.ChunkedArray, day_first: bool | None = None) -> Stamps | None:
    """The times of a column, typed or text; None where a cell is none.

    Day or month first: as `day_first` says, else as the dates show (a number above 12, a clock that rises, a night
    passed without a gap); dots are day first where nothing speaks against it. A clock goes on past midnight.
    A float64 holds a present-day stamp to a quarter of a microsecond.
    """
    typed = array if pa.types.is_timestamp(array.type) else _parsed(array)
    if typed is not None:
        return Stamps(_seconds(typed), "iso")
    try:
        cells = plain(array)
    except pa.ArrowInvalid:
        return None
    found = pc.extract_regex(cells, _SHAPE)
    if pc.any(pc.and_(pc.is_valid(cells), pc.is_null(found))).as_py():
        return None
    part = {name: _column(found, name) for name in ("first", "second", "third", "one", "two", "three")}
    clock, again = _clock(found, part)
    dated = np.isfinite(part["one"])
    if not dated.any():
        return Stamps(_past_midnight(clock, again), "clock")
    if not dated[np.isfinite(clock)].all():
        return None
    if part["one"][dated].min() > 31:  # a year
        days = _days(part["one"], part["two"], part["three"])
        return None if days is None else Stamps(days * DAY + clock, "year first")
    ways = {True: (part["two"], part["one"]), False: (part["one"], part["two"])}
    good = {}
    for first, (month, day) in ways.items():
        days = _days(part["three"], month, day) if day_first in (None, first) else None
        if days is not None:
            good[first] = Stamps(days * DAY + clock, "day first" if first else "month first")
    if len(good) < 2:
        return next(iter(good.values()), None)
    dots = "." in pc.unique(pc.struct_field(found, "dot")).to_pylist()
    chosen = _rising(good) or (good[True] if dots else None)
    return replace(good[True], open=True) if chosen is None else chosen


def first_not_a_stamp(array: pa.ChunkedArray, day_first: bool | None) -> tuple[int, str]:
    """Index and text of the first cell that keeps a column from being times."""
    for start in range(0, len(array), 65536):
        part = array.slice(start, 65536)
        if read_stamps(part, day_first) is None:
            for i in range(len(part)):
                if read_stamps(part.slice(i, 1), day_first) is None:
                    return start + i, decoded(part[i].as_py())
    return 0, decoded(array[0].as_py())  # dates or zones given in some cells and not in others


def _rising(ways: dict[bool, Stamps]) -> Stamps | None:
    """The only reading whose clock rises, or the only one that passes midnight without a gap; None where both do."""
    steps = {first: np.diff(one.seconds[np.isfinite(one.seconds)]) for first, one in ways.items()}
    for good in (lambda step: (step >= 0).all(), lambda step: step.max(initial=0.0) < HOUR):
        fits = [first for first, step in steps.items() if good(step)]
        if len(fits) == 1:
            return ways[fits[0]]
    return None


def _column(found: Any, name: str) -> Floats:
    """One group of the pattern as numbers, NaN where it is not there."""
    text = pc.struct_field(found, name)
    number = pc.cast(pc.if_else(pc.equal(text, ""), pa.scalar(None, pa.string()), text), pa.float64())
    return np.asarray(number.to_numpy())


def _clock(found: Any, part: dict[str, Floats]) -> tuple[Floats, float]:
    """Seconds since midnight of every cell, and after how many they begin again; 20:15.4 is minutes and seconds."""
    fraction = pc.struct_field(found, "part")
    text = pc.if_else(pc.equal(fraction, ""), "0", pc.replace_substring(fraction, ",", "."))
    rest = np.asarray(pc.cast(text, pa.float64()).to_numpy())
    if np.isnan(part["third"]).all() and (rest > 0).any():
        return 60.0 * part["first"] + part["second"] + rest, HOUR
    half = pc.utf8_lower(pc.struct_field(found, "half")).to_numpy()
    hours = np.where(np.isin(half, ["a", "p"]), part["first"] % 12 + 12.0 * (half == "p"), part["first"])
    return HOUR * hours + 60.0 * part["second"] + np.nan_to_num(part["third"]) + rest, DAY


def _past_midnight(clock: Floats, again: float) -> Floats:
    """A clock that goes on where it begins again."""
    known = np.isfinite(clock)
    seconds = clock.copy()
    seconds[known] += again * np.cumsum(np.diff(clock[known], prepend=clock[known][:1]) < -again / 2)
    return seconds


def _days(year: Floats, month: Floats, day: Floats) -> Floats | None:
    """Days since 1970, NaN where there is no date; None where one is in no calendar."""
    known = np.isfinite(year)
    years = np.where(year[known] < 100, year[known] + 2000, year[known]).astype(int)
    months, days = month[known].astype(int), day[known].astype(int)
    if not ((months >= 1) & (months <= 12) & (days >= 1)).all():
        return None
    first = (years - 1970).astype("datetime64[Y]").astype("datetime64[M]") + (months - 1)
    dates = first.astype("datetime64[D]") + (days - 1)
    if (dates.astype("datetime64[M]") != first).any():
        return None
    found = np.full(len(year), np.nan)
    found[known] = dates.astype(np.int64)
    return found


def _seconds(array: pa.ChunkedArray) -> Floats:
    exact = pc.cast(array, pa.timestamp("ns", getattr(array.type, "tz", None)), safe=False)
    stamps: Any = pc.cast(exact, pa.int64())
    whole = pc.fill_null(stamps, 0).to_numpy().astype(np.int64)
    seconds = (whole // 10**9).astype(np.float64) + (whole % 10**9) / 1e9
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
