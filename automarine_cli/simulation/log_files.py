"""Simulated runs become log files: CSV, CSV in gzip, Parquet; CSV is the same bytes on every machine."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.dofs import DOFS
from automarine_cli.quantities import Floats
from automarine_cli.simulation.campaign import DECIMALS, MOMENT_DECIMALS, SimulatedRun
from automarine_cli.simulation.specification import AnySpecification

Column: TypeAlias = Floats | Sequence[str]
STORED = 65535  # bytes in one block of a gzip file that is stored as it is
PLACES = dict.fromkeys(("n", *(name for dof in DOFS.values() for name, _ in dof.columns[dof.command])), None)
"""Decimals of a column in CSV; None: as many as the number has. Every other column has `DECIMALS`."""


def label(specification: AnySpecification, seed: int) -> str:
    return f"Simulated by automarine from {specification.source}, seed {seed}: no measurement."


def runs_by_file(runs: Sequence[SimulatedRun]) -> dict[str, list[SimulatedRun]]:
    """Sort the runs by the name of the log that they are in, in the order of the specification."""
    files: dict[str, list[SimulatedRun]] = {}
    for run in sorted(runs, key=lambda run: run.plan.turn):
        files.setdefault(run.plan.file, []).append(run)
    return files


def log_of(runs: Sequence[SimulatedRun], specification: AnySpecification, seed: int) -> bytes:
    group, columns = runs[0].plan.group, dict[str, Column]()
    if group.together is not None:
        columns["run"] = [run.plan.name for run in runs for _ in run.columns["time_s"]]
    columns |= {name: np.concatenate([run.columns[name] for run in runs]) for name in runs[0].columns}
    return log_bytes(columns, group.format, label(specification, seed))


def log_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """One log in the format "csv", "csv.gz" or "parquet"; `comment` goes first, or into Parquet's metadata."""
    if format == "parquet":
        return parquet_bytes(columns, comment)
    head = [f"# {comment}", ",".join(columns)]
    rows = map(",".join, zip(*(_cells(name, column) for name, column in columns.items())))
    text = "\n".join(chain(head, rows)) + "\n"
    return text.encode() if format == "csv" else gzip_bytes(text.encode())


def parquet_bytes(columns: Mapping[str, Column], comment: str) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(columns), metadata={"comment": comment}), sink)
    return bytes(sink.getvalue().to_pybytes())


def _cells(name: str, column: Column) -> Iterator[str]:
    if not isinstance(column, np.ndarray):
        return iter(column)
    if PLACES.get(name, DECIMALS) is None:
        return (f"{value:.{MOMENT_DECIMALS}f}".rstrip("0").rstrip(".") for value in column.tolist())
    return (f"{value:.{DECIMALS}f}" for value in column.tolist())


def gzip_bytes(data: bytes) -> bytes:
    """A gzip file that holds the data as they are: what a compressor makes of them changes with its version."""
    blocks = [data[i : i + STORED] for i in range(0, len(data), STORED)] or [b""]
    out = bytearray(b"\x1f\x8b\x08\0\0\0\0\0\0\xff")  # deflate, no time, no operating system
    for i, block in enumerate(blocks):
        last = i + 1 == len(blocks)
        out += struct.pack("<BHH", last, len(block), len(block) ^ 0xFFFF) + block
    return bytes(out) + struct.pack("<II", zlib.crc32(data), len(data) & 0xFFFFFFFF)
