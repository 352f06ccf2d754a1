"""Apache Parquet, read by pyarrow; only columns of numbers, text and times are looked at."""

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs import formats
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog

_INDEX = "__index_level_"  # what pandas writes beside the columns
_MAGIC = b"PAR1"
_CELL = 8  # bytes of a number once read


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a Parquet file. Raises LogError for anything that pyarrow cannot read."""
    with path.open("rb") as file:
        formats.refuse_empty(file.read(len(_MAGIC)) == _MAGIC, name, "Parquet data")
    try:
        return _read(path, name, formats.most_unpacked(path))
    except (pa.ArrowException, OSError, MemoryError, ValueError, KeyError, OverflowError, RecursionError):
        raise LogError(f"{name}: the Parquet data is damaged or cut short; copy the file again") from None


FORMAT = Format("Parquet", (".parquet",), read)


def read_table(content: bytes, name: str) -> RawLog:
    """Read a table that was in memory before, of whatever size. Raises LogError for too many columns."""
    return _read(pa.BufferReader(content), name, math.inf)


def _read(source: Path | pa.BufferReader, name: str, limit: float) -> RawLog:
    with pq.ParquetFile(source) as file:
        if file.metadata.num_columns > formats.MAX_COLUMNS:
            raise formats.too_many_columns(name, file.metadata.num_columns)
        names = [field.name for field in file.schema_arrow if _readable(field)]
        rows = file.metadata.num_rows
        if len(set(names)) < len(names):
            return RawLog(tuple(names), (), np.arange(1, min(rows, 1) + 1))
        if rows * max(1, len(names)) * _CELL > limit:
            raise formats.too_well_packed(name)
        table = file.read(columns=names)
    table.validate(full=True)
    arrays = tuple(_plain(table[column]) for column in names)
    return RawLog(tuple(n.strip() for n in names), arrays, np.arange(1, table.num_rows + 1))


def _is_text(kind: pa.DataType) -> bool:
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_binary(kind))


def _readable(field: pa.Field) -> bool:
    kind, is_ = field.type.value_type if pa.types.is_dictionary(field.type) else field.type, pa.types
    tests = (is_.is_integer, is_.is_floating, is_.is_boolean, is_.is_decimal, _is_text, is_.is_timestamp)
    return any(test(kind) for test in tests) and not field.name.startswith(_INDEX)


def _plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    if pa.types.is_dictionary(array.type):
        array = pc.cast(array, array.type.value_type)
    if pa.types.is_timestamp(array.type):
        return array
    if _is_text(array.type):
        return pc.cast(array, pa.binary())
    if pa.types.is_boolean(array.type):
        array = pc.cast(array, pa.int8())
    return pc.cast(array, pa.float64(), safe=False)
