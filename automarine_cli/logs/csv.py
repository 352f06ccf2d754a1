"""Comma, semicolon or tab separated text, plain or gzip-compressed, read by pyarrow.

The normal case touches no row in Python: the head is looked at, the body goes to pyarrow as it is. Only what
pyarrow refuses is looked through again, to say in which row and column the trouble is.
"""

import csv
import gzip
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import RUN
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.csv_head import Head, read_head
from automarine_cli.logs.formats import Format, RawLog, most_unpacked, too_well_packed
from automarine_cli.logs.text import MISSING, numbers
from automarine_cli.pipeline.words import quoted

_EMPTIED = re.compile(rb"^[ \t]*(?:#[^\r\n]*)?(?=\r?$)", re.MULTILINE)  # comments and lines of blanks
_SIGNATURES = {
    b"\x1f\x8b": "is gzip-compressed; expected plain text (name it .csv.gz)",
    b"PAR1": "is a Parquet file; expected plain text (name it .parquet)",
    b"PK\x03\x04": "is a zip archive or spreadsheet; expected plain text (export it as CSV)",
    b"\xff\xfe": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
    b"\xfe\xff": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
}
MOST_COMMENTS = 1_000_000  # lines
CODED = pa.dictionary(pa.int32(), pa.binary())  # the run of each row: few words, many times
PIECE = 4 << 20  # bytes
CACHED = 1 << 17  # bytes that stay in the processor while they are looked at
_CONTROL = bytes(c for c in range(32) if c not in b"\t\n\v\f\r")
_BINARY = (4096, 0.02)  # bytes looked at, and the share of control characters from which it is no text


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a CSV file. Raises LogError with the row for anything that is not a table of cells."""
    text = frozenset({columns.source_of(RUN)})  # 01 is not 1
    data, plain = _prepared(_content(path, name), name)
    head = read_head(data, name, text)
    body = pa.py_buffer(data).slice(head.body)
    rows = _line_numbers(data, head, plain)
    try:
        kinds: list[pa.DataType] = [pa.float64() if number else pa.binary() for number in head.numeric]
        coded = [CODED if name in text else kind for name, kind in zip(head.names, kinds)]
        table = _arrow(body, head, coded)
    except pa.ArrowInvalid as error:
        if "CSV conversion error" not in str(error):
            raise _ragged(data, head, name, error) from None
        table = _converted(body, data, head, name)
    if table.num_rows != len(rows):
        raise _open_quote(data, head, name)
    return RawLog(head.names, tuple(table.columns), rows, head.decimal)


FORMAT = Format("CSV", (".csv", ".csv.gz", ".tsv", ".tsv.gz"), read)


def _content(path: Path, name: str) -> bytes:
    if not path.name.lower().endswith(".gz"):
        return path.read_bytes()
    limit = most_unpacked(path)
    try:
        with path.open("rb") as packed:
            if packed.read(2) != b"\x1f\x8b":
                raise LogError(
                    f"{name}: found no gzip data, expected some from its extension; drop .gz from the name if "
                    "it is plain text"
                )
        with gzip.open(path) as file:
            data = file.read(limit + 1)
    except EOFError:
        raise LogError(f"{name}: the gzip data ends too early; the file was cut short, copy it again") from None
    except (gzip.BadGzipFile, zlib.error):
        raise LogError(f"{name}: the gzip data is damaged inside; copy the file again") from None
    if len(data) > limit:
        raise LogError(too_well_packed(name))
    return data


def _prepared(data: bytes, name: str) -> tuple[bytes, int]:
    """Plain text with comments and lines of blanks emptied (the line numbers stay as they are), and its line ends
    if no line needed a second look, else -1.
    """
    for signature, what in _SIGNATURES.items():
        if data.startswith(signature):
            raise LogError(f"{name}: {what}")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if (nul := data.find(b"\0")) >= 0:
        row = data.count(b"\n", 0, nul) + 1
        raise LogError(
            f"{name}, row {row}: found a NUL byte, expected text. The file is binary or was damaged "
            "while it was written; copy it again, or give the log as text"
        )
    head = data[: _BINARY[0]]
    if len(head) - len(head.translate(None, _CONTROL)) > _BINARY[1] * len(head):
        raise LogError(
            f"{name}: found binary data, expected a table of text. The file is binary or was damaged "
            "while it was written; copy it again, or give the log as text"
        )
    if b"\r" in data and b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if data[:4].lower() == b"sep=":  # a spreadsheet's hint; the delimiter shows anyway
        data = b"#" + data
    ends = _ends_of_full_lines(data)
    if ends >= 0:
        return data, ends
    starts = (b"#", b" ", b"\t")
    if data.startswith(starts) or any(b"\n" + start in data for start in starts):
        data, lines = _EMPTIED.subn(b"", data, count=MOST_COMMENTS)
        if lines == MOST_COMMENTS:
            raise LogError(
                f"{name}: {MOST_COMMENTS} lines of comments or blanks; expected a table of numbers. Take them out"
            )
    return data, -1


def _ends_of_full_lines(data: bytes) -> int:
    """How many line ends there are, or -1 if a line begins with a blank, #, a quote or a line end; but a header of
    quoted names is usual."""
    if data[:1] <= b"#" and not (data[:1] == b'"' and data[: data.find(b"\n")].count(b'"') % 2 == 0):
        return -1
    text, count = np.frombuffer(data, dtype=np.uint8), 0
    for start in range(0, len(text), CACHED):
        here = text[start : start + CACHED + 1]  # one more: what follows a line end
        ends = here[:-1] == ord("\n")
        if np.any(ends & (here[1:] <= ord("#"))):
            return -1
        count += int(np.count_nonzero(ends))
    return count + data.endswith(b"\n")


def _line_numbers(data: bytes, head: Head, ends: int) -> NDArray[np.int64]:
    """1-based line numbers of the rows of the body: of its lines that are not empty. `ends` as of `_prepared`."""
    if ends >= 0:
        count = ends - data.count(b"\n", 0, head.body) + (head.body < len(data) and not data.endswith(b"\n"))
        return np.arange(head.line + 1, head.line + 1 + count, dtype=np.int64)
    body = memoryview(data)[head.body :]
    first_empty = body[:1] == b"\n" or body[:2] == b"\r\n"
    if not first_empty and data.find(b"\n\n", head.body) < 0 and data.find(b"\n\r\n", head.body) < 0:
        count = data.count(b"\n", head.body) + (len(body) > 0 and body[-1] != ord("\n"))
        return head.line + 1 + np.arange(count, dtype=np.int64)
    # in pieces: a file of nothing but line ends must not take many times its size
    text = np.frombuffer(b"\n\n" + data[head.body :].rstrip(b"\r\n") + b"\n", dtype=np.uint8)
    rows, before = [np.zeros(0, dtype=np.int64)], head.line + 1
    for start in range(2, len(text), PIECE):
        here = text[start : start + PIECE]
        one, two = text[start - 1 : start - 1 + len(here)], text[start - 2 : start - 2 + len(here)]
        ended = here == ord("\n")
        full = ended & (one != ord("\n")) & ~((one == ord("\r")) & (two == ord("\n")))
        at = np.flatnonzero(full)
        rows.append(before + np.cumsum(ended, dtype=np.int64)[at] - 1)
        before += int(ended.sum())
    return np.concatenate(rows)


def _arrow(body: pa.Buffer, head: Head, types: list[pa.DataType]) -> pa.Table:
    keys = [str(i) for i in range(len(types))]
    if not body.size:
        return pa.table({key: pa.array([], kind) for key, kind in zip(keys, types)})
    source: Any = pa.BufferReader(body)
    return arrow_csv.read_csv(
        source,
        read_options=arrow_csv.ReadOptions(
            column_names=keys, block_size=_block_size(body, head), use_threads=body.size > PIECE
        ),
        parse_options=arrow_csv.ParseOptions(delimiter=head.delimiter),
        convert_options=arrow_csv.ConvertOptions(
            column_types=dict(zip(keys, types)),
            decimal_point=head.decimal,
            null_values=list(MISSING),
            strings_can_be_null=True,
            check_utf8=False,
        ),
    )


def _block_size(body: pa.Buffer, head: Head) -> int:
    """Bytes a block: a row must fit into it, however many columns it has."""
    return max(1 << 20, 64 * len(head.names), min(body.size, 4 * head.longest))


def _converted(body: pa.Buffer, data: bytes, head: Head, name: str) -> pa.Table:
    """Slower: all cells as text, then numbers where a whole column is numbers."""
    try:
        table = _arrow(body, head, [pa.binary()] * len(head.names))
    except pa.ArrowInvalid as error:
        raise _ragged(data, head, name, error) from None
    decimals = (head.decimal,) if head.delimiter == "," or head.decimal == "," else (".", ",")
    tried = [_as_numbers(table, head, decimal) for decimal in decimals]
    return max(tried, key=lambda found: sum(pa.types.is_floating(kind) for kind in found.schema.types))


def _as_numbers(table: pa.Table, head: Head, decimal: str) -> pa.Table:
    """The same table of text, with numbers where all cells of a column are numbers."""
    for i, column in enumerate(table.columns):
        values = None if head.names[i] in head.text else numbers(column, decimal)
        if values is not None:
            table = table.set_column(i, str(i), values)
    return table


def _open_quote(data: bytes, head: Head, name: str) -> LogError:
    """The refusal for a quoted cell that runs over a line end, which would shift all row numbers."""
    lines = data[head.body :].split(b"\n")
    row = head.line + 1 + next((i for i, line in enumerate(lines) if line.count(b'"') % 2), 0)
    return LogError(
        f"{name}, row {row}: found a quoted cell that runs over the line end, expected each row on one line. "
        "Close the quote or take the line break out"
    )


def _ragged(data: bytes, head: Head, name: str, error: Exception) -> LogError:
    """The refusal for a body that is no table: the first row with too few or too many cells."""
    expected = len(head.names)
    for i, line in enumerate(data[head.body :].split(b"\n")):
        text = line.removesuffix(b"\r").decode("latin-1")
        if not text:
            continue
        try:
            cells = len(next(csv.reader([text], delimiter=head.delimiter)))
        except (csv.Error, StopIteration):
            cells = -1
        if cells != expected:
            found = f"{cells} cell{'s' * (cells != 1)}" if cells >= 0 else "a cell that does not end"
            return LogError(
                f"{name}, row {head.line + 1 + i}: found {found}, expected {expected} as in the header "
                f"(row {head.line}); the row is {quoted(text)}. Complete or delete this row"
            )
    return LogError(f"{name}: not a table of cells ({quoted(str(error))}); check its quotes and line ends")
