"""A Parquet file whose bytes depend on nothing but its content.

The libraries write their own version into each file, so that the same table has other bytes after the next
update. Simulated logs are promised byte for byte: this is the plainest Parquet there is, required columns of
doubles or texts, plain encoding, no compression. Source: the Apache Parquet format, metadata in Thrift's compact
protocol.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Column: TypeAlias = NDArray[np.float64] | Sequence[str]
Field: TypeAlias = tuple[int, bytes]
"""Compact-protocol type of a value, and its bytes."""

MAGIC = b"PAR1"
ROWS_PER_GROUP = 1 << 20
DOUBLE, BYTE_ARRAY = 5, 6
PLAIN, RLE = 0, 3
REQUIRED, UTF8, UNCOMPRESSED, DATA_PAGE = 0, 0, 0, 0
I32, I64, BINARY, LIST, STRUCT = 5, 6, 8, 9, 12


def parquet_bytes(columns: Mapping[str, Column], metadata: Mapping[str, str], writer: str) -> bytes:
    """The file with these columns, all of one length, in their order; `writer` is who made it."""
    rows = len(next(iter(columns.values())))
    out = bytearray(MAGIC)
    groups = []
    for first in range(0, rows, ROWS_PER_GROUP):
        count = min(ROWS_PER_GROUP, rows - first)
        begin, chunks = len(out), []
        for name, column in columns.items():
            offset = len(out)
            out += _page(column[first : first + count], count)
            chunks.append(_chunk(name, column, count, offset, len(out) - offset))
        group = _struct({1: _list(chunks), 2: _int(I64, len(out) - begin), 3: _int(I64, count)})
        groups.append(group)
    leaves = [_leaf(name, column) for name, column in columns.items()]
    root = _struct({4: _text("schema"), 5: _int(I32, len(columns))})
    pairs = [_struct({1: _text(key), 2: _text(value)}) for key, value in metadata.items()]
    footer: dict[int, Field] = {
        1: _int(I32, 1),
        2: _list([root, *leaves]),
        3: _int(I64, rows),
        4: _list(groups),
        5: _list(pairs),
        6: _text(writer),
    }
    _, end = _struct(footer)
    return bytes(out) + end + struct.pack("<I", len(end)) + MAGIC


def _kind(column: Column) -> int:
    return DOUBLE if isinstance(column, np.ndarray) else BYTE_ARRAY


def _page(values: Column, count: int) -> bytes:
    """One data page, header included."""
    data = b"".join(_plain(values))
    about = _struct({1: _int(I32, count), 2: _int(I32, PLAIN), 3: _int(I32, RLE), 4: _int(I32, RLE)})
    size = _int(I32, len(data))
    _, header = _struct({1: _int(I32, DATA_PAGE), 2: size, 3: size, 5: about})
    return header + data


def _plain(values: Column) -> Iterator[bytes]:
    if isinstance(values, np.ndarray):
        yield values.astype("<f8").tobytes()
        return
    for text in values:
        encoded = text.encode()
        yield struct.pack("<I", len(encoded)) + encoded


def _leaf(name: str, column: Column) -> Field:
    fields = {1: _int(I32, _kind(column)), 3: _int(I32, REQUIRED), 4: _text(name)}
    return _struct(fields | ({6: _int(I32, UTF8)} if _kind(column) == BYTE_ARRAY else {}))


def _chunk(name: str, column: Column, count: int, offset: int, size: int) -> Field:
    about = {
        1: _int(I32, _kind(column)),
        2: _list([_int(I32, PLAIN)]),
        3: _list([_text(name)]),
        4: _int(I32, UNCOMPRESSED),
        5: _int(I64, count),
        6: _int(I64, size),
        7: _int(I64, size),
        9: _int(I64, offset),
    }
    return _struct({2: _int(I64, offset), 3: _struct(about)})


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out) + bytes([value])


def _int(kind: int, value: int) -> Field:
    return kind, _varint(2 * value)  # zigzag; nothing here is negative


def _text(value: str) -> Field:
    encoded = value.encode()
    return BINARY, _varint(len(encoded)) + encoded


def _list(values: Sequence[Field]) -> Field:
    kind = values[0][0] if values else STRUCT
    head = bytes([len(values) << 4 | kind]) if len(values) < 15 else bytes([0xF0 | kind]) + _varint(len(values))
    return LIST, head + b"".join(data for _, data in values)


def _struct(fields: Mapping[int, Field]) -> Field:
    """Fields by their number, rising, no gap wider than 15."""
    out, last = bytearray(), 0
    for number, (kind, data) in fields.items():
        out.append((number - last) << 4 | kind)
        out += data
        last = number
    return STRUCT, bytes(out) + b"\0"
