"""Simulated runs become log files: CSV, CSV in gzip, Parquet; CSV is the same bytes on every machine."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.quantities import Floats
from automarine_cli.simulation.campaign import DECIMALS, MOMENT_DECIMALS, SimulatedRun
from automarine_cli.simulation.specification import PlanarSpecification, Specification

Column: TypeAlias = Floats | Sequence[str]
STORED = 65535  # bytes in one block of a gzip file that is stored as it is
PLACES = dict.fromkeys(("n", *(name for dof in DOFS.values() for name, _ in dof.columns[dof.command])), None)
"""Decimals of a column in CSV; None: as many as the number has. Every other column has `DECIMALS`."""


def label(specification: Specification | PlanarSpecification, seed: int) -> str:
    """The sentence that every file begins with."""
    return f"Simulated by automarine from {specification.source}, seed {seed}: no measurement."


def runs_by_file(runs: Sequence[SimulatedRun]) -> dict[str, list[SimulatedRun]]:
    """Sort the runs by the name of the log that they are in, in the order of the specification."""
    files: dict[str, list[SimulatedRun]] = {}
    for run in sorted(runs, key=lambda run: run.plan.turn):
        files.setdefault(run.plan.file, []).append(run)
    return files


def log_of(runs: Sequence[SimulatedRun], specification: Specification, seed: int) -> bytes:
    """Return the content of the log of these runs."""
    dof, group = specification.vehicle.dof, runs[0].plan.group
    moment = dof.column(dof.command, specification.vehicle.force_unit)
    parts = [_columns(run, moment, dof) for run in runs]
    columns: dict[str, Column] = {}
    if group.together is not None:
        columns["run"] = [run.plan.name for run, part in zip(runs, parts) for _ in range(len(part["time_s"]))]
    columns |= {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return log_bytes(columns, group.format, label(specification, seed))


def _columns(run: SimulatedRun, moment: str, dof: Dof) -> dict[str, Floats]:
    log = run.log
    columns = {"time_s": log.time_s, dof.column(dof.position, dof.units.log): log.position, moment: log.moment}
    if log.rate is not None:
        columns[dof.column(dof.velocity, f"{dof.units.log}/s")] = log.rate
    return columns


def log_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """One log in the format "csv", "csv.gz" or "parquet"; `comment` goes first, or into Parquet's metadata."""
    if format == "parquet":
        return parquet_bytes(columns, comment)
    head = [f"# {comment}", ",".join(columns)]
    rows = map(",".join, zip(*(_cells(name, column) for name, column in columns.items())))
    text = "\n".join(chain(head, rows)) + "\n"
    return text.encode() if format == "csv" else gzip_bytes(text.encode())


def parquet_bytes(columns: Mapping[str, Column], comment: str) -> bytes:
    """One log as Parquet, `comment` in its metadata; the same bytes with the same version of pyarrow."""
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(columns), metadata={"comment": comment}), sink)
    return bytes(sink.getvalue().to_pybytes())


def _cells(name: str, column: Column) -> Iterator[str]:
    if not isinstance(column, np.ndarray):
        return iter(column)
    places = PLACES.get(name, DECIMALS)
    if places is None:
        return (_shortest(value) for value in column.tolist())
    return (f"{value:.{places}f}" for value in column.tolist())


def _shortest(value: float) -> str:
    """A number without needless zeros."""
    return f"{value:.{MOMENT_DECIMALS}f}".rstrip("0").rstrip(".")


def gzip_bytes(data: bytes) -> bytes:
    """A gzip file that holds the data as they are: what a compressor makes of them changes with its version."""
    blocks = [data[i : i + STORED] for i in range(0, len(data), STORED)] or [b""]
    out = bytearray(b"\x1f\x8b\x08\0\0\0\0\0\0\xff")  # deflate, no time, no operating system
    for i, block in enumerate(blocks):
        last = i + 1 == len(blocks)
        out += struct.pack("<BHH", last, len(block), len(block) ^ 0xFFFF) + block
    return bytes(out) + struct.pack("<II", zlib.crc32(data), len(data) & 0xFFFFFFFF)
