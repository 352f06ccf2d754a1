"""Comma, semicolon or tab separated text, plain or gzip-compressed, read by pyarrow; what that refuses is looked
through again, to say in which row the trouble is."""

import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs import formats
from automarine_cli.logs.columns import RUN, ColumnMap
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.text import plural, quoted

DELIMITERS = (";", "\t", ",")  # a tie goes to the first: with ; and tab the comma may be the decimal one
SAMPLE_LINES = 6
BLOCK = 1 << 20  # bytes
SIGNATURES = {
    b"\x1f\x8b": "is gzip-compressed; expected plain text (name it .csv.gz)",
    b"PAR1": "is a Parquet file; expected plain text (name it .parquet)",
    b"PK\x03\x04": "is a zip archive or spreadsheet; expected plain text (name a workbook .xlsx, or export it as CSV)",
    b"\xff\xfe": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
    b"\xfe\xff": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
}
_CONTROL = bytes(c for c in range(32) if c not in b"\t\n\v\f\r")
_BINARY = (4096, 0.02)  # bytes looked at, and the share of control characters from which it is no text
_BLANK = re.compile(rb"^(?:[ \t]+|[ \t]*#[^\n]*)$", re.MULTILINE)
_DECIMAL_MARK = re.compile(rb'(?<![^;\t\n" ])[+-]?\d*([.,])\d+(?:[eE][+-]?\d+)?(?![^;\t\n" ])')


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a CSV file. Raises LogError with the row for anything that is not a table of cells."""
    return read_text(_text(path, name), name, columns)


def read_text(text: bytes, name: str, columns: ColumnMap) -> RawLog:
    """Read a table of text with line feeds between its lines. Raises LogError as `read` does."""
    data, starts, rows = _lines(text)
    if not len(rows):
        raise LogError(
            f"{name}: no header and no rows; expected a line of column names. Copy the log again, or leave it out"
        )
    first = [data[starts[row] : starts[row + 1] - 1] for row in rows[: SAMPLE_LINES + 1]]
    names, delimiter = _header(first, f"{name}, row {rows[0] + 1}")
    if len(rows) == 1:
        return RawLog(names, (pa.chunked_array([], pa.float64()),) * len(names), rows[1:])
    decimal, body = ".", pa.py_buffer(data).slice(starts[rows[1]])
    block = max(BLOCK, 2 * int(np.diff(starts).max()))  # a row must fit into a block
    if delimiter != ",":
        marks = Counter(_DECIMAL_MARK.findall(data, starts[rows[1]], starts[rows[1]] + BLOCK))
        decimal = "," if marks[b","] > marks[b"."] else "."
    keys, run = [str(i) for i in range(len(names))], columns.source_of(RUN)
    words = {key for key, column in zip(keys, names) if column == run}  # the run 01 is not 1
    for line in first[1:]:
        cells = zip(keys, map(str.strip, _cells(formats.text_of(line), delimiter)))
        words |= {key for key, c in cells if not (formats.is_number(c, decimal) or c in formats.EMPTY)}
    for texts in (words, {*keys}):  # a number may turn into words later
        try:
            table = arrow_csv.read_csv(
                pa.BufferReader(body),
                read_options=arrow_csv.ReadOptions(column_names=keys, block_size=block, use_threads=body.size > BLOCK),
                parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
                convert_options=arrow_csv.ConvertOptions(
                    column_types={key: pa.binary() if key in texts else pa.float64() for key in keys},
                    decimal_point=decimal, null_values=[*formats.EMPTY], strings_can_be_null=True, check_utf8=False,
                ),
            )  # fmt: skip
            break
        except pa.ArrowInvalid as error:
            if "CSV conversion error" not in str(error):
                raise _no_table(data, rows, name, len(names), delimiter, error) from None
    if table.num_rows != len(rows) - 1:
        raise _no_table(data, rows, name, len(names), delimiter, None)
    arrays = list(table.columns)
    for i, key in enumerate(keys):
        if key in texts and names[i] != run and (numbers := formats.numbers(arrays[i], decimal)) is not None:
            arrays[i] = numbers
    return RawLog(names, tuple(arrays), rows[1:] + 1, decimal)


FORMAT = Format("CSV", (".csv", ".csv.gz", ".tsv", ".tsv.gz"), read)


def _unpacked(path: Path, name: str) -> bytes:
    limit = formats.most_unpacked(path)
    try:
        with gzip.open(path) as file:
            data = file.read(limit + 1)
    except (EOFError, gzip.BadGzipFile, zlib.error):
        formats.refuse_empty(path.read_bytes().startswith(b"\x1f\x8b"), name, "gzip data")
        raise LogError(f"{name}: the gzip data is damaged or cut short; copy the file again") from None
    if len(data) > limit:
        raise formats.too_well_packed(name)
    return data


def _text(path: Path, name: str) -> bytes:
    """Plain text with line feeds between its lines."""
    data = path.read_bytes() if not path.name.lower().endswith(".gz") else _unpacked(path, name)
    for signature, problem in SIGNATURES.items():
        if data.startswith(signature):
            raise LogError(f"{name}: {problem}")
    data = data.removeprefix(b"\xef\xbb\xbf")
    damaged = "The file is binary or was damaged while it was written; copy it again, or give the log as text"
    if (nul := data.find(b"\0")) >= 0:
        row = data.count(b"\n", 0, nul) + 1
        raise LogError(f"{name}, row {row}: found a NUL byte, expected text. {damaged}")
    start = data[: _BINARY[0]]
    if len(start) - len(start.translate(None, _CONTROL)) > _BINARY[1] * len(start):
        raise LogError(f"{name}: found binary data, expected a table of text. {damaged}")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n") if b"\n" in data else data.replace(b"\r", b"\n")
    return b"#" + data if data[:4].lower() == b"sep=" else data  # a spreadsheet's hint; the delimiter shows anyway


def _lines(data: bytes) -> tuple[bytes, NDArray[np.int64], NDArray[np.int64]]:
    """Return the text without comments and blanks in lines of their own; where its lines begin, and one more would; and
    the numbers from 0 of those that are not empty."""
    text = np.frombuffer(data, dtype=np.uint8)
    starts = np.concatenate([[0], np.flatnonzero(text == ord("\n")) + 1, [len(data) + 1]])
    begins = text[starts[starts < len(text)]].tobytes()
    if any(mark in begins for mark in (b"#", b" ", b"\t")) and (full := _BLANK.sub(b"", data)) != data:
        return _lines(full)
    return data, starts, np.flatnonzero(np.diff(starts) > 1)


def _header(lines: Sequence[bytes], where: str) -> tuple[tuple[str, ...], str]:
    """Return the names of the columns, and what separates them from each other, by the first lines. Raises LogError."""
    header, *rows = (formats.text_of(line).strip(" ") for line in lines)
    delimiter, best = ",", (0.0, 0)
    for mark in DELIMITERS:  # that gives the header and most rows the same number of cells, more than one
        count = len(_cells(header, mark))
        share = sum(len(_cells(row, mark)) == count for row in rows) / len(rows) if rows else 1.0
        if count > 1 and (share, count) > best:
            delimiter, best = mark, (share, count)
    names = tuple(cell.strip() for cell in _cells(header, delimiter))
    if len(names) > formats.MAX_COLUMNS:
        raise formats.too_many_columns(where, len(names))
    if any(names) and all(formats.is_number(cell) or not cell for cell in names):
        raise LogError(
            f"{where}: found numbers ({quoted(header)}), expected column names; "
            "write a header such as time_s,heading_deg,tau above the rows"
        )
    if len(names) == 1 and len(header.split()) > 2:
        raise LogError(
            f"{where}: cells seem to be separated by blanks ({quoted(header)}); "
            "expected commas, semicolons or tabs. Write one of these between them"
        )
    return names, delimiter


def _cells(line: str, delimiter: str) -> list[str]:
    if '"' not in line:
        return [cell.lstrip(" ") for cell in line.split(delimiter)]
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return line.split(delimiter)


def _no_table(
    data: bytes, rows: NDArray[np.int64], name: str, expected: int, delimiter: str, error: Exception | None
) -> LogError:
    """The refusal with the first row of too few or too many cells; without an error for a quoted cell that runs over a
    line end, which pyarrow takes for one row."""
    lines = data.split(b"\n")
    for row in rows[1:]:
        text = lines[row].decode("latin-1")
        if error is None and text.count('"') % 2:
            return LogError(
                f"{name}, row {row + 1}: found a quoted cell that runs over the line end, expected each row on one "
                "line. Close the quote or take the line break out"
            )
        if error is not None and (cells := len(_cells(text, delimiter))) != expected:
            return LogError(
                f"{name}, row {row + 1}: found {plural(cells, 'cell')}, expected {expected} as in the header "
                f"(row {rows[0] + 1}); the row is {quoted(text)}. Complete or delete this row"
            )
    return LogError(f"{name}: not a table of cells ({quoted(str(error))}); check its quotes and line ends")
