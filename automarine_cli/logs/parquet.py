"""Apache Parquet, read by pyarrow; only columns of numbers, text and times are looked at. And logs that are no files:
tables in memory, as Python hands them over (pandas, pyarrow, polars, columns by name).
"""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.find import LogFile, Logs
from automarine_cli.logs.formats import MOST_COLUMNS, Format, RawLog, most_unpacked, too_many_columns, too_well_packed
from automarine_cli.pipeline.words import printable

_INDEX = "__index_level_"  # what pandas writes beside the columns
_MAGIC = b"PAR1"
_CELL = 8  # bytes of a number once read


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a Parquet file. Raises LogError for anything that pyarrow cannot read."""
    _refuse_foreign(path, name)
    try:
        return _read(path, name, most_unpacked(path))
    except (pa.ArrowException, OSError, MemoryError, ValueError, KeyError, OverflowError, RecursionError):
        raise LogError(f"{name}: the Parquet data is damaged inside; copy the file again") from None


FORMAT = Format("Parquet", (".parquet",), read)


def _refuse_foreign(path: Path, name: str) -> None:
    """Refuse a file that does not begin and end as Parquet does."""
    with path.open("rb") as file:
        begins = file.read(4) == _MAGIC
        file.seek(max(0, path.stat().st_size - 4))
        ends = file.read(4) == _MAGIC
    if not begins:
        raise LogError(
            f"{name}: found no Parquet data, expected some from its extension; if it is text, name it .csv or .tsv"
        )
    if not ends or path.stat().st_size < 12:
        raise LogError(f"{name}: the Parquet data ends too early; the file was cut short, copy it again")


def read_table(content: bytes, name: str) -> RawLog:
    """Read a table that was in memory before, of whatever size. Raises LogError for too many columns."""
    return _read(pa.BufferReader(content), name, math.inf)


def _read(path: Path | pa.BufferReader, name: str, limit: float) -> RawLog:
    with pq.ParquetFile(path) as file:
        if file.metadata.num_columns > MOST_COLUMNS:
            raise LogError(too_many_columns(name, file.metadata.num_columns))
        kept = [field for field in file.schema_arrow if _readable(field)]
        names = [field.name for field in kept]
        rows = file.metadata.num_rows
        if len(set(names)) < len(names):
            return RawLog(tuple(names), (), np.arange(1, min(rows, 1) + 1))
        if rows * max(1, len(names)) * _CELL > limit:
            raise LogError(too_well_packed(name))
    # text stays a dictionary until its length is known: a word of a megabyte may stand in every row
    words = [field.name for field in kept if _is_text(field.type)]
    with pq.ParquetFile(path, read_dictionary=words) as file:
        table = file.read(columns=names)
    table.validate(full=True)
    if sum(_text_bytes(table[word]) for word in words) > limit:
        raise LogError(too_well_packed(name))
    arrays = tuple(_plain(table[column]) for column in names)
    return RawLog(tuple(n.strip() for n in names), arrays, np.arange(1, table.num_rows + 1))


def _is_text(kind: pa.DataType) -> bool:
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_binary(kind))


def _text_bytes(column: Any) -> int:
    """Bytes of a text column with each cell written out."""
    total = 0
    for chunk in column.chunks:
        if pa.types.is_dictionary(chunk.type):
            times = np.bincount(chunk.indices.drop_null().to_numpy(), minlength=len(chunk.dictionary))
            lengths: Any = pc.fill_null(pc.binary_length(chunk.dictionary), 0)
            total += int(times @ lengths.to_numpy().astype(np.int64))
        else:
            total += chunk.nbytes
    return total


def _readable(field: pa.Field) -> bool:
    kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
    tests = (
        pa.types.is_integer,
        pa.types.is_floating,
        pa.types.is_boolean,
        pa.types.is_decimal,
        _is_text,
        pa.types.is_timestamp,
    )
    return any(test(kind) for test in tests) and not field.name.startswith(_INDEX)


def _plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    """float64, timestamp or binary text."""
    if pa.types.is_dictionary(array.type):
        array = pc.cast(array, array.type.value_type)
    if pa.types.is_timestamp(array.type):
        return array
    if _is_text(array.type):
        return pc.cast(array, pa.binary())
    if pa.types.is_boolean(array.type):
        array = pc.cast(array, pa.int8())
    return pc.cast(array, pa.float64(), safe=False)


TABLES = "a file, a folder, a glob, a DataFrame, columns by name ({'time_s': ...}), or a list of these"


def as_logs(given: object, name: str) -> Logs:
    """Logs as a command takes them: places as they are, each table as one log, called `name` and its number, or as the
    key says where tables are given by name. Raises LogError for what is neither."""
    return tuple(_logs(given, name))


def _logs(given: object, name: str) -> Iterator[str | Path | LogFile]:
    if isinstance(given, str | Path | LogFile):
        yield given
    elif _is_table(given):
        yield _log(given, name)
    elif isinstance(given, Mapping) and given and all(_is_table(one) for one in given.values()):
        for key, table in given.items():
            yield _log(table, str(key))
    elif isinstance(given, Sequence) and not isinstance(given, bytes):
        for number, one in enumerate(given, 1):
            yield from _logs(one, f"{name}_{number:0{len(str(len(given)))}d}")
    else:
        raise LogError(f"{name}: found {type(given).__name__}; give {TABLES}")


def _is_table(given: object) -> bool:
    """Whether it is a table, or columns by name."""
    if isinstance(given, Mapping):
        return bool(given) and not any(isinstance(one, str | Path) or _is_table(one) for one in given.values())
    if not hasattr(given, "__arrow_c_stream__"):
        return False
    import pandas as pd  # here, as logs that are files need none of it

    return not isinstance(given, pd.Series)


def _log(given: object, name: str) -> LogFile:
    """A table as a log. Its place is its content, so that a table given twice is one log."""
    import pandas as pd

    try:
        frame = pd.DataFrame(dict(given)) if isinstance(given, Mapping) else given
        table = pa.table(frame)
        content = pa.BufferOutputStream()
        pq.write_table(table, content)
    except (pa.ArrowException, ValueError, TypeError) as problem:
        raise LogError(
            f"{name}: no table of columns of numbers ({printable(str(problem.args[0])).rstrip('.')}); "
            "give columns of one length, each of numbers, times or texts"
        ) from None
    data = content.getvalue().to_pybytes()
    return LogFile(Path("memory", hashlib.sha256(data).hexdigest()), printable(name), True, data)
