"""Simulated runs become log files: CSV, CSV in gzip, Parquet; the same bytes on every machine."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.quantities import Floats
from automarine_cli.simulation.campaign import DECIMALS, MOMENT_DECIMALS, PlanarMade, SimulatedRun
from automarine_cli.simulation.parquet_bytes import Column, parquet_bytes
from automarine_cli.simulation.specification import Specification

STORED = 65535  # bytes in one block of a gzip file that is stored as it is
PLACES = dict.fromkeys(("n", *(name for dof in DOFS.values() for name, _ in dof.columns[dof.command])), None)
"""Decimals of a column in CSV; None: as many as the number has. Every other column has `DECIMALS`."""


def label(specification: Specification, seed: int) -> str:
    """The sentence that every file begins with."""
    return f"Simulated by automarine from {specification.source}, seed {seed}: no measurement."


def run_logs(runs: Sequence[SimulatedRun], specification: Specification, seed: int) -> Iterator[tuple[str, bytes]]:
    """Name and content of every log of the runs, in the order of the specification."""
    files: dict[str, list[SimulatedRun]] = {}
    for run in sorted(runs, key=lambda run: run.plan.turn):
        files.setdefault(run.plan.file, []).append(run)
    dof = specification.vehicle.dof
    moment = dof.column(dof.command, specification.vehicle.force_unit)
    for file, members in files.items():
        group = members[0].plan.group
        parts = [_columns(run, moment, dof) for run in members]
        columns: dict[str, Column] = {}
        if group.together is not None:
            members_of = zip(members, parts)
            columns["run"] = [run.plan.name for run, part in members_of for _ in range(len(part["time_s"]))]
        columns |= {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        yield file, log_bytes(columns, group.format, label(specification, seed))


def planar_logs(made: Sequence[PlanarMade], comment: str) -> Iterator[tuple[str, bytes]]:
    """Name and content of every log of a campaign in the plane."""
    for run in made:
        yield run.file, log_bytes(run.columns, run.group.format, comment)


def _columns(run: SimulatedRun, moment: str, dof: Dof) -> dict[str, Floats]:
    log = run.log
    columns = {"time_s": log.time_s, dof.column(dof.position, dof.units.log): log.position, moment: log.moment}
    if log.rate is not None:
        columns[dof.column(dof.velocity, f"{dof.units.log}/s")] = log.rate
    return columns


def log_bytes(columns: Mapping[str, Column], format: str, comment: str) -> bytes:
    """One log in the format "csv", "csv.gz" or "parquet"; `comment` goes first, or into Parquet's metadata."""
    if format == "parquet":
        return parquet_bytes(columns, {"comment": comment}, "automarine")
    head = [f"# {comment}", ",".join(columns)]
    rows = map(",".join, zip(*(_cells(name, column) for name, column in columns.items())))
    text = "\n".join(chain(head, rows)) + "\n"
    return text.encode() if format == "csv" else gzip_bytes(text.encode())


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
