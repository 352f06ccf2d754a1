"""Apache Parquet, read by pyarrow; only columns of numbers, text and times are looked at."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.pipeline.words import printable

_INDEX = "__index_level_"  # what pandas writes beside the columns


def read(path: Path, name: str, text: frozenset[str] = frozenset()) -> RawLog:
    """Read a Parquet file. Raises LogError for anything that pyarrow cannot read."""
    try:
        with pq.ParquetFile(path) as file:
            schema = file.schema_arrow
            kept = [i for i, field in enumerate(schema) if _readable(field)]
            names = [schema.names[i] for i in kept]
            if len(set(names)) < len(names):
                return RawLog(tuple(names), (), np.arange(1, file.metadata.num_rows + 1))
            table = file.read(columns=names)
            table.validate(full=True)
            arrays = tuple(_plain(table[column]) for column in names)
    except (pa.ArrowException, OSError, MemoryError, ValueError, KeyError) as error:
        raise LogError(
            f"{name}: not a sound Parquet file ({_first_words(error)}); "
            "it was cut short or damaged, copy it again"
        ) from None
    return RawLog(tuple(n.strip() for n in names), arrays, np.arange(1, table.num_rows + 1))


FORMAT = Format("Parquet", (".parquet",), read)


def _readable(field: pa.Field) -> bool:
    kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
    tests = (
        pa.types.is_integer,
        pa.types.is_floating,
        pa.types.is_boolean,
        pa.types.is_decimal,
        pa.types.is_string,
        pa.types.is_large_string,
        pa.types.is_binary,
        pa.types.is_timestamp,
    )
    return any(test(kind) for test in tests) and not field.name.startswith(_INDEX)


def _plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    """float64, timestamp or binary text."""
    if pa.types.is_dictionary(array.type):
        array = pc.cast(array, array.type.value_type)
    if pa.types.is_timestamp(array.type):
        return array
    if (
        pa.types.is_string(array.type)
        or pa.types.is_large_string(array.type)
        or pa.types.is_binary(array.type)
    ):
        return pc.cast(array, pa.binary())
    if pa.types.is_boolean(array.type):
        array = pc.cast(array, pa.int8())
    return pc.cast(array, pa.float64(), safe=False)


def _first_words(error: BaseException) -> str:
    words = printable(str(error).strip().split("\n")[0])
    return words[:120] if words else type(error).__name__
