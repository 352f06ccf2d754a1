"""Comma, semicolon or tab separated text, plain or gzip-compressed, read by pyarrow.

The normal case touches no row in Python: the head is looked at, the body goes to pyarrow as it is. Only what
pyarrow refuses is looked through again, to say in which row and column the trouble is.
"""

import csv
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import RUN
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.csv_head import Head
from automarine_cli.logs.csv_text import PIECE, Text, read_text
from automarine_cli.logs.formats import Format, Problem, RawLog
from automarine_cli.logs.log_file import LogFile
from automarine_cli.logs.text import MISSING, numbers
from automarine_cli.pipeline.words import quoted

CODED = pa.dictionary(pa.int32(), pa.binary())  # the run of each row: few words, many times


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a CSV file. Raises LogError with the row for anything that is not a table of cells."""
    (found,) = read_together([LogFile(path, name, named=True)], columns)
    if not isinstance(found, RawLog):
        raise found
    return found


def read_together(files: Sequence[LogFile], columns: ColumnMap) -> Iterator[RawLog | Problem]:
    """Read CSV files; those in a row that have one header are read as one table, for most of what a small file takes is
    to begin with it. What is wrong with a file stands in its place."""
    text = frozenset({columns.source_of(RUN)})  # 01 is not 1
    alike: list[Text] = []
    for file in files:
        try:
            one = read_text(file.path, file.name, text, alike[-1] if alike else None)
        except (LogError, OSError, MemoryError) as problem:
            yield from _joined(alike)
            yield problem
            alike = []
            continue
        if alike and not one.joins(alike[-1]):
            yield from _joined(alike)
            alike = []
        alike.append(one)
    yield from _joined(alike)


FORMAT = Format("CSV", (".csv", ".csv.gz", ".tsv", ".tsv.gz"), read, together=read_together)


def _joined(texts: Sequence[Text]) -> list[RawLog | Problem]:
    """The columns of files of one header, or what is wrong with those that are no tables of cells."""
    if not texts:
        return []
    head, alone = texts[0].head, len(texts) == 1
    kinds: list[pa.DataType] = [pa.float64() if number else pa.binary() for number in head.numeric]
    coded = [CODED if name in head.text else kind for name, kind in zip(head.names, kinds)]
    edges = np.cumsum([0, *(len(one.rows) for one in texts)])
    try:
        table = _arrow(texts[0].body if alone else _one_below_the_other(texts), head, coded)
        if table.num_rows == edges[-1]:
            parts = ([column.slice(a, b - a) for column in table.columns] for a, b in pairwise(edges.tolist()))
            return [RawLog(head.names, tuple(part), one.rows, head.decimal) for one, part in zip(texts, parts)]
        if alone:
            return [_open_quote(texts[0].data, head, texts[0].name)]
    except pa.ArrowInvalid as error:
        if alone:
            return [_slowly(texts[0], error)]
    except MemoryError as problem:
        if alone:
            return [problem]
    return [found for one in texts for found in _joined([one])]


def _one_below_the_other(texts: Sequence[Text]) -> pa.Buffer:
    pieces = []
    for one in texts:
        pieces.append(one.data[one.head.body :] if one.head.body else one.data)
        if pieces[-1] and not pieces[-1].endswith(b"\n"):
            pieces.append(b"\n")
    return pa.py_buffer(b"".join(pieces))


def _slowly(one: Text, error: pa.ArrowInvalid) -> RawLog | LogError:
    """A file that pyarrow refused at first sight."""
    if "CSV conversion error" not in str(error):
        return _ragged(one.data, one.head, one.name, error)
    try:
        table = _converted(one.body, one.data, one.head, one.name)
    except LogError as problem:
        return problem
    if table.num_rows != len(one.rows):
        return _open_quote(one.data, one.head, one.name)
    return RawLog(one.head.names, tuple(table.columns), one.rows, one.head.decimal)


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
