"""The head of a CSV file: where the header is, what separates cells, which columns look like numbers."""

import csv
import re
from dataclasses import dataclass, field

from automarine_cli.errors import LogError
from automarine_cli.logs.formats import MOST_COLUMNS, too_many_columns
from automarine_cli.logs.text import decoded, is_missing, is_number
from automarine_cli.pipeline.words import quoted

DELIMITERS = (";", "\t", ",")  # a tie goes to the first: with ; and tab the comma may be the decimal one
SAMPLE_LINES = 8  # at each of three places
LONGEST_HEADER = 10_000_000  # bytes
MOST_EMPTY = 10_000  # lines looked at for these, empty ones among them
MOST_CELLS = 100_000  # looked at; a log of thousands of columns shows itself in fewer lines
_PLAIN = re.compile(r"-?\d+(\.\d+)?(,-?\d+(\.\d+)?)*")  # numbers and nothing else
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Head:
    """`line`: 1-based line of the header; `body`: byte at which the line after it starts; `numeric`: one flag
    a column, whether the first rows hold numbers only; `longest`: bytes of the longest line looked at.
    """

    names: tuple[str, ...]
    line: int
    body: int
    delimiter: str
    decimal: str
    numeric: tuple[bool, ...]
    longest: int = field(compare=False)
    text: frozenset[str] = frozenset()

    @property
    def only_numbers(self) -> bool:
        """Whether nothing but numbers stands between commas, so that a file with this header is read as this one."""
        every = all(flag or name in self.text for flag, name in zip(self.numeric, self.names))
        return every and self.delimiter == "," and not any(";" in name or "\t" in name for name in self.names)


def read_head(data: bytes, name: str, text: frozenset[str] = frozenset()) -> Head:
    """Look at the first lines of a CSV file whose comments are emptied. Raises LogError where there is no
    header.
    """
    line, start, end = _first_line(data)
    if start == len(data):
        raise LogError(
            f"{name}: no header and no rows; expected a line of column names. Copy the log again, or leave it out"
        )
    if end - start > LONGEST_HEADER:
        raise LogError(
            f"{name}, row {line}: found {end - start} bytes in one line, expected a line of column "
            "names. Check the line ends"
        )
    header = _text(data[start:end])
    sample = _sample(data, end + 1)
    delimiter = _delimiter(header, sample)
    names = tuple(cell.strip() for cell in _cells(header, delimiter))
    if len(names) > MOST_COLUMNS:
        raise LogError(too_many_columns(f"{name}, row {line}", len(names)))
    if any(names) and all(is_number(cell) or not cell for cell in names):
        raise LogError(
            f"{name}, row {line}: found numbers ({quoted(header)}), expected column names; "
            "write a header such as time_s,heading_deg,tau above the rows"
        )
    if len(names) == 1 and len(header.split()) > 2:
        raise LogError(
            f"{name}, row {line}: cells seem to be separated by blanks ({quoted(header)}); "
            "expected commas, semicolons or tabs. Write one of these between them"
        )
    every = -(-len(sample) // max(4, MOST_CELLS // len(names)))
    rows = [[cell.strip() for cell in _cells(line, delimiter)] for line in sample[::every]] if sample else []
    decimal = "," if delimiter != "," and _decimal_comma(rows) else "."
    return Head(
        names,
        line,
        min(end + 1, len(data)),
        delimiter,
        decimal,
        tuple(flag and column not in text for flag, column in zip(_numeric(rows, len(names), decimal), names)),
        max(len(line_text) for line_text in (header, *sample)),
        text,
    )


def _first_line(data: bytes) -> tuple[int, int, int]:
    """Number, start and end of the first line that is not empty."""
    start, line = 0, 1
    while start < len(data):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        if data[start:end].strip():
            return line, start, end
        start, line = end + 1, line + 1
    return line, len(data), len(data)


def _sample(data: bytes, start: int) -> list[str]:
    """The first rows, and some from the middle and the end of the file, where an integer column shows its
    fractions.
    """
    lines: list[str] = []
    for place, position in enumerate((start, (start + len(data)) // 2, max(start, len(data) - 4096)), 1):
        first = position if position == start else data.find(b"\n", position) + 1
        for _ in range(MOST_EMPTY):
            if not 0 < first < len(data) or len(lines) >= place * SAMPLE_LINES:
                break
            end = data.find(b"\n", first)
            end = len(data) if end < 0 else end
            if data[first:end].strip():
                lines.append(_text(data[first:end]))
            first = end + 1
        if len(data) - start < 4096 and lines:
            break
    return lines


def _text(line: bytes) -> str:
    return decoded(line.removesuffix(b"\r")) if b"\t" not in line else _keeping_tabs(line)


def _keeping_tabs(line: bytes) -> str:
    try:
        return line.decode("utf-8").strip("\r\n ")
    except UnicodeDecodeError:
        return line.decode("latin-1").strip("\r\n ")


def _cells(line: str, delimiter: str) -> list[str]:
    if '"' not in line and "\r" not in line:
        return [cell.lstrip(" ") for cell in line.split(delimiter)] if line else []
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return line.split(delimiter)


def _count(line: str, delimiter: str) -> int:
    return len(_cells(line, delimiter)) if '"' in line or "\r" in line else line.count(delimiter) + 1


def _delimiter(header: str, sample: list[str]) -> str:
    """The separator that gives the header and most rows the same number of cells, more than one."""
    best, score = ",", (0.0, 0)
    for delimiter in DELIMITERS:
        count = len(_cells(header, delimiter))
        if count > 1:
            agree = sum(_count(line, delimiter) == count for line in sample)
            share = agree / len(sample) if sample else 1.0
            if (share, count) > score:
                best, score = delimiter, (share, count)
    return best


def _decimal_comma(rows: list[list[str]]) -> bool:
    if not any("," in cell for row in rows for cell in row):
        return False
    commas = sum(_DECIMAL_COMMA.fullmatch(cell) is not None for row in rows for cell in row)
    points = sum("." in cell and is_number(cell) for row in rows for cell in row)
    return commas > points


def _numeric(rows: list[list[str]], columns: int, decimal: str) -> tuple[bool, ...]:
    """One flag a column: number or missing in all rows looked at."""
    if decimal == "." and all(map(_PLAIN.fullmatch, map(",".join, rows))):  # nearly all logs
        return (True,) * columns
    flags = [True] * columns
    for row in rows:
        for i, cell in enumerate(row[:columns]):
            flags[i] = flags[i] and (is_missing(cell) or is_number(cell, decimal))
    return tuple(flags)
