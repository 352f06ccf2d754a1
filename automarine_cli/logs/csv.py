"""Comma, semicolon or tab separated text, plain or gzip-compressed, read by pyarrow.

The head is looked at, the body goes to pyarrow as it is. Only what pyarrow refuses is looked through again, to say in
which row and column the trouble is.
"""

import csv
import gzip
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import RUN
from automarine_cli.logs.cells import MISSING, is_missing, is_number, numbers
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import MOST_COLUMNS, Format, RawLog, most_unpacked, too_many_columns, too_well_packed
from automarine_cli.pipeline.words import quoted

DELIMITERS = (";", "\t", ",")  # a tie goes to the first: with ; and tab the comma may be the decimal one
SAMPLE_LINES = 6
LONGEST_HEADER = 10_000_000  # bytes
MOST_COMMENTS = 1_000_000  # lines
MOST_CELLS = 100_000  # looked at; a log of thousands of columns shows itself in fewer lines
PIECE = 4 << 20  # bytes
SIGNATURES = {
    b"\x1f\x8b": "is gzip-compressed; expected plain text (name it .csv.gz)",
    b"PAR1": "is a Parquet file; expected plain text (name it .parquet)",
    b"PK\x03\x04": "is a zip archive or spreadsheet; expected plain text (export it as CSV)",
    b"\xff\xfe": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
    b"\xfe\xff": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
}
_CONTROL = bytes(c for c in range(32) if c not in b"\t\n\v\f\r")
_BINARY = (4096, 0.02)  # bytes looked at, and the share of control characters from which it is no text
_EMPTIED = re.compile(rb"^[ \t]*(?:#[^\r\n]*)?(?=\r?$)", re.MULTILINE)  # comments and lines of blanks
_FULL = re.compile(rb"\S")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
Ends = NDArray[np.int64]


@dataclass(frozen=True)
class _Head:
    """`line`: 1-based line of the header; `body`: byte at which the line after it starts; `types`: of the columns, as
    far as the first rows show them; `longest`: bytes of the longest line looked at."""

    names: tuple[str, ...]
    line: int
    body: int
    delimiter: str
    decimal: str
    types: tuple[pa.DataType, ...]
    longest: int


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a CSV file. Raises LogError with the row for anything that is not a table of cells."""
    data, ends = _text(path, name)
    head = _head(data, name, columns.source_of(RUN))  # 01 is not 1
    rows = _row_numbers(data, ends, head)
    body = pa.py_buffer(data).slice(head.body)
    try:
        table = _arrow(body, head, head.types)
    except pa.ArrowInvalid as error:
        if "CSV conversion error" not in str(error):
            raise _no_table(data, head, name, error) from None
        table = _converted(body, data, head, name, columns.source_of(RUN))
    if table.num_rows != len(rows):
        raise _no_table(data, head, name, None)
    return RawLog(head.names, tuple(table.columns), rows, head.decimal)


FORMAT = Format("CSV", (".csv", ".csv.gz", ".tsv", ".tsv.gz"), read)


def _content(path: Path, name: str) -> bytes:
    data = path.read_bytes()
    if not path.name.lower().endswith(".gz"):
        return data
    if not data.startswith(b"\x1f\x8b"):
        raise LogError(
            f"{name}: found no gzip data, expected some from its extension; drop .gz from the name if it is plain text"
        )
    limit = most_unpacked(path)
    try:
        with gzip.open(path) as file:
            data = file.read(limit + 1)
    except EOFError:
        raise LogError(f"{name}: the gzip data ends too early; the file was cut short, copy it again") from None
    except (gzip.BadGzipFile, zlib.error):
        raise LogError(f"{name}: the gzip data is damaged inside; copy the file again") from None
    if len(data) > limit:
        raise too_well_packed(name)
    return data


def _text(path: Path, name: str) -> tuple[bytes, Ends]:
    """Plain text with comments and lines of blanks emptied (the line numbers stay as they are), and where its lines
    end."""
    data = _content(path, name)
    for signature, what in SIGNATURES.items():
        if data.startswith(signature):
            raise LogError(f"{name}: {what}")
    data = data.removeprefix(b"\xef\xbb\xbf")
    damaged = "The file is binary or was damaged while it was written; copy it again, or give the log as text"
    if (nul := data.find(b"\0")) >= 0:
        row = data.count(b"\n", 0, nul) + 1
        raise LogError(f"{name}, row {row}: found a NUL byte, expected text. {damaged}")
    start = data[: _BINARY[0]]
    if len(start) - len(start.translate(None, _CONTROL)) > _BINARY[1] * len(start):
        raise LogError(f"{name}: found binary data, expected a table of text. {damaged}")
    if b"\r" in data and b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if data[:4].lower() == b"sep=":  # a spreadsheet's hint; the delimiter shows anyway
        data = b"#" + data
    ends = _line_ends(data)
    text = np.frombuffer(data, dtype=np.uint8)
    first = text[ends[: -1 if data.endswith(b"\n") else None] + 1]
    if data[:1] in (b"#", b" ", b"\t") or np.any((first == ord("#")) | (first == ord(" ")) | (first == ord("\t"))):
        data, lines = _EMPTIED.subn(b"", data, count=MOST_COMMENTS)
        if lines == MOST_COMMENTS:
            raise LogError(
                f"{name}: {MOST_COMMENTS} lines of comments or blanks; expected a table of numbers. Take them out"
            )
        ends = _line_ends(data)
    return data, ends


def _line_ends(data: bytes) -> Ends:
    return np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n"))


def _row_numbers(data: bytes, ends: Ends, head: _Head) -> NDArray[np.int64]:
    """1-based line numbers of the rows of the body: of its lines that are not empty."""
    ends = ends[head.line - 1 :]
    if head.body < len(data) and not data.endswith(b"\n"):
        ends = np.append(ends, len(data))
    length = np.diff(ends) - 1
    empty = length == 0
    if (short := np.flatnonzero(length == 1)).size:
        empty[short] = np.frombuffer(data, dtype=np.uint8)[ends[short] + 1] == ord("\r")
    return head.line + 1 + np.flatnonzero(~empty)


def _head(data: bytes, name: str, text: str) -> _Head:
    """Look at the first lines of a CSV file whose comments are emptied; the column called `text` is of words."""
    lines = list(_full_lines(data))
    if not lines:
        raise LogError(
            f"{name}: no header and no rows; expected a line of column names. Copy the log again, or leave it out"
        )
    start, end = lines[0]
    line = data.count(b"\n", 0, start) + 1
    if end - start > LONGEST_HEADER:
        raise LogError(
            f"{name}, row {line}: found {end - start} bytes in one line, expected a line of column names. Check the "
            "line ends"
        )
    header, *sample = (_decoded(data[a:b]) for a, b in lines)
    delimiter = _delimiter(header, sample)
    names = tuple(cell.strip() for cell in _cells(header, delimiter))
    if len(names) > MOST_COLUMNS:
        raise too_many_columns(f"{name}, row {line}", len(names))
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
    sample = sample[: max(2, MOST_CELLS // max(1, len(names)))]
    rows = [[cell.strip() for cell in _cells(line, delimiter)] for line in sample]
    cells = [cell for row in rows for cell in row]
    commas = sum(_DECIMAL_COMMA.fullmatch(cell) is not None for cell in cells)
    points = sum("." in cell and is_number(cell) for cell in cells)
    decimal = "," if delimiter != "," and commas > points else "."
    words = {i for row in rows for i, cell in enumerate(row) if not (is_number(cell, decimal) or is_missing(cell))}
    types = tuple(pa.binary() if i in words or name == text else pa.float64() for i, name in enumerate(names))
    return _Head(names, line, min(end + 1, len(data)), delimiter, decimal, types, max(b - a for a, b in lines))


def _full_lines(data: bytes) -> list[tuple[int, int]]:
    """Where the header and the first rows begin and end: lines that are not empty."""
    lines: list[tuple[int, int]] = []
    end = 0
    while len(lines) <= SAMPLE_LINES and (full := _FULL.search(data, end)):
        start = data.rfind(b"\n", 0, full.start()) + 1
        end = data.find(b"\n", full.start())
        end = len(data) if end < 0 else end
        lines.append((start, end))
    return lines


def _decoded(line: bytes) -> str:
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


def _delimiter(header: str, sample: list[str]) -> str:
    """The separator that gives the header and most rows the same number of cells, more than one."""
    best, score = ",", (0.0, 0)
    for delimiter in DELIMITERS:
        count = len(_cells(header, delimiter))
        if count > 1:
            agree = sum(len(_cells(line, delimiter)) == count for line in sample)
            share = agree / len(sample) if sample else 1.0
            if (share, count) > score:
                best, score = delimiter, (share, count)
    return best


def _arrow(body: pa.Buffer, head: _Head, types: tuple[pa.DataType, ...]) -> pa.Table:
    keys = [str(i) for i in range(len(types))]
    if not body.size:
        return pa.table({key: pa.array([], kind) for key, kind in zip(keys, types)})
    # a row must fit into a block, however many columns it has
    block = max(1 << 20, 64 * len(head.names), min(body.size, 4 * head.longest))
    source: Any = pa.BufferReader(body)
    return arrow_csv.read_csv(
        source,
        read_options=arrow_csv.ReadOptions(column_names=keys, block_size=block, use_threads=body.size > PIECE),
        parse_options=arrow_csv.ParseOptions(delimiter=head.delimiter),
        convert_options=arrow_csv.ConvertOptions(
            column_types=dict(zip(keys, types)),
            decimal_point=head.decimal,
            null_values=list(MISSING),
            strings_can_be_null=True,
            check_utf8=False,
        ),
    )


def _converted(body: pa.Buffer, data: bytes, head: _Head, name: str, text: str) -> pa.Table:
    """Slower: all cells as text, then numbers where a whole column is numbers."""
    try:
        words = _arrow(body, head, (pa.binary(),) * len(head.names))
    except pa.ArrowInvalid as error:
        raise _no_table(data, head, name, error) from None
    tables = []
    for decimal in (head.decimal,) if head.delimiter == "," or head.decimal == "," else (".", ","):
        table, count = words, 0
        for i, column in enumerate(words.columns):
            values = None if head.names[i] == text else numbers(column, decimal)
            if values is not None:
                table, count = table.set_column(i, str(i), values), count + 1
        tables.append((count, table))
    return max(tables, key=lambda pair: pair[0])[1]


def _no_table(data: bytes, head: _Head, name: str, error: Exception | None) -> LogError:
    """The refusal for a body that is no table, with the first row of too few or too many cells; without an error for a
    quoted cell that runs over a line end, which would shift all row numbers."""
    expected = len(head.names)
    for row, line in enumerate(data[head.body :].split(b"\n"), head.line + 1):
        text = line.removesuffix(b"\r").decode("latin-1")
        if error is None and text.count('"') % 2:
            return LogError(
                f"{name}, row {row}: found a quoted cell that runs over the line end, expected each row on one line. "
                "Close the quote or take the line break out"
            )
        if error is None or not text:
            continue
        try:
            cells = len(next(csv.reader([text], delimiter=head.delimiter)))
        except (csv.Error, StopIteration):
            cells = -1
        if cells != expected:
            found = f"{cells} cell{'s' * (cells != 1)}" if cells >= 0 else "a cell that does not end"
            return LogError(
                f"{name}, row {row}: found {found}, expected {expected} as in the header "
                f"(row {head.line}); the row is {quoted(text)}. Complete or delete this row"
            )
    return LogError(f"{name}: not a table of cells ({quoted(str(error))}); check its quotes and line ends")
