"""Inputs nobody would write: good files with their bytes torn, and the judges before which they come.

A judge reads a file the way the commands do. It returns whether the file was read; a refusal is an
AutomarineError with one printable line. Anything else is a defect: another exception, a hang, an answer that
differs from what a slow and simple reader says.
"""

import csv
import gzip
import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from broken_logs.make import csv_of, good_table, parquet_of
from made_link import MODEL_FILE
from reader_contract import RECORDERS
from small_campaign import SPECIFICATION
from specified import read_specification
from vehicle_logs import dive

from automarine_cli.commands.check import check
from automarine_cli.dofs import YAW
from automarine_cli.errors import AutomarineError
from automarine_cli.logs import ColumnMap, LogFile, LogTable, read_column_map, read_log
from automarine_cli.logs.formats import EMPTY
from automarine_cli.models.model import Model
from automarine_cli.models.store import read_model
from automarine_cli.pipeline.records import json_text
from automarine_cli.simulation.campaign import make_plans
from automarine_cli.thrusters.map import ThrusterMap

TOKENS = (
    b'"', b"'", b",", b";", b"\t", b"\n", b"\r", b"\r\n", b"\0", b"\xff", b"\xef\xbb\xbf", b"#", b"-", b"+", b".",
    b"e", b"1e999", b"-1e999", b"nan", b"inf", b"0x1", b"1_0", b"9" * 400, b"[" * 300, b"{" * 300, b"]", b"}", b":",
    b"null", b"true", b"NaN", b"-0", b"1e-320", b"\xe2\x80\x8b", b"$x$", b"<b>", b"=1+1", b"PAR1", b"\x1f\x8b", b"_",
)  # fmt: skip
"""What is dropped into files: the words that mean something to some reader."""


def torn(content: bytes, rng: random.Random) -> bytes:
    """Pieces of the bytes flipped, deleted, doubled, cut off or made another word; or, as often, other digits alone."""
    data, gently = bytearray(content), rng.random() < 0.5
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        place, length = rng.randrange(len(data) + 1), rng.choice((1, 1, 2, 8, 40, 400))
        block, word = data[place : place + length], rng.choice(TOKENS)
        flipped = bytes(byte ^ 1 << rng.randrange(8) for byte in block[:1]) + block[1:]
        if not gently:
            data[place : place + length] = rng.choice((flipped, b"", block * 2, block * 50, word, word + block))
            del data[place if rng.random() < 0.15 else len(data) :]
        elif digits := [i for i, byte in enumerate(data) if 0x30 <= byte <= 0x39]:
            data[rng.choice(digits)] = rng.choice(b"0123456789012345678901234567890123456789.-e,")
    return bytes(data)


def _yaw_log() -> bytes:
    return csv_of(good_table().assign(depth_m=1.5, run="r"))


def _thruster_test() -> bytes:
    levels = [n for n in range(-80, 81, 20) if n] * 3
    rows = (f"{n},{0.001 * n * abs(n) + 0.01 * (i % 7 - 3):.3f},{16 - i % 2}" for i, n in enumerate(levels))
    return "\n".join(("n,force_N,voltage_V", *rows, "")).encode()


def _yaw_model() -> bytes:
    effect = {"name": "bias-moment", "parameters": {"b": {"value": 0.02}}}
    return json.dumps(MODEL_FILE | {"effects": [effect], "command_delay_s": {"value": 0.1}}, indent=1).encode()


THRUSTER_MAP = b"""{
 "schema": "automarine/thruster-map/1", "form": "dead-band-saturation", "n_unit": "rev/s",
 "forward": {"a": {"value": 1.5}}, "backward": {"a": null}, "r2": 0.99,
 "parameters": {
  "forward": {"a": {"value": 1.5}, "n_0": {"value": 0.1}, "n_sat": {"value": null}},
  "backward": {"a": 1.1}
 }
}
"""
COLUMN_MAP = b"""[columns]
time_s = { from = "time_s", unit = "ms", offset = 0.5 }
heading_deg = { from = "heading_deg", unit = "rad", sign = -1 }
tau_Nm = { from = "tau", scale = 2.5 }
run = "run"
[defaults]
thrusters_per_test = 2
arm_m = 0.44
"""


def judge_log(path: Path, columns: ColumnMap | None = None) -> None:
    """A log or recording as `check` looks at it; a CSV file also beside the simple reader."""
    json_text(check([path], columns=columns).to_json())
    if path.suffix in (".csv", ".gz"):
        agrees_with_simple_reader(path)


def agrees_with_simple_reader(path: Path) -> None:
    """If Python's csv and float understand the whole file, they say the same numbers. Raises AssertionError."""
    content = path.read_bytes()
    try:
        text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode("utf-8")
        lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
        rows = [[cell.strip() for cell in row] for row in csv.reader(lines)]
        numbers = [[np.nan if cell in EMPTY else float(cell) for cell in row[:3]] for row in rows[1:]]
        simple = np.array(numbers, dtype=float)
    except (ValueError, csv.Error, EOFError, OSError):
        return
    if rows[0][:3] != ["time_s", "heading_deg", "tau"] or simple.ndim != 2 or len({len(row) for row in rows}) > 1:
        return
    table: LogTable = read_log(LogFile(path, path.name, True), dof=YAW)
    read = np.column_stack([table.columns["time"], np.rad2deg(table.columns["heading"]), table.columns["moment"]])
    np.testing.assert_allclose(read, simple, rtol=1e-14, atol=1e-300)


def judge_model(path: Path) -> None:
    """A yaw model: read, and every number in it finite."""
    stored = read_model(path)
    assert all(isinstance(model, Model) and np.isfinite(model.theta).all() for model in stored.models.values())


def judge_map(path: Path) -> None:
    """A thruster map: read, and asked for a thrust both ways."""
    found = ThrusterMap.load(path)
    assert not np.isnan(found.force(np.array([0.0, 0.5]))).any()


def judge_columns(path: Path) -> None:
    """A column map: read, and a log read with it."""
    columns = read_column_map(path)
    log = path.with_name("with_columns.csv")
    if not log.exists():
        log.write_bytes(_yaw_log())
    read_log(LogFile(log, log.name, True), columns, dof=YAW)


def judge_specification(path: Path) -> None:
    """A specification: read, and its runs planned."""
    specification = read_specification(path)
    specification.model()
    make_plans(specification, specification.seed)


@dataclass(frozen=True)
class Kind:
    """One kind of file: what a good one holds, how its name ends, and who reads it."""

    good: Callable[[], bytes]
    suffix: str
    judge: Callable[[Path], None]
    cases: int = 30


KINDS = {
    "CSV": Kind(_yaw_log, ".csv", judge_log),
    "CSV, gzip": Kind(lambda: gzip.compress(_yaw_log(), mtime=0), ".csv.gz", judge_log),
    "CSV, torn before gzip": Kind(_yaw_log, ".csv.gz", judge_log),
    "Parquet": Kind(lambda: parquet_of(good_table().assign(run="r")), ".parquet", judge_log),
    "thruster test": Kind(_thruster_test, ".csv", judge_log),
    "yaw model": Kind(_yaw_model, ".json", judge_model),
    "thruster map": Kind(lambda: THRUSTER_MAP, ".json", judge_map),
    "column map": Kind(lambda: COLUMN_MAP, ".toml", judge_columns),
    "specification": Kind(SPECIFICATION.encode, ".toml", judge_specification),
    **{  # of vehicles whose libraries are installed, read with the names that their columns have
        f"recording {suffix}": Kind(
            cache(partial(recorder.write, dive())), suffix, partial(judge_log, columns=recorder.columns), 12
        )
        for suffix, recorder in RECORDERS.items()
        if find_spec(recorder.package) is not None
    },
}


def outcome(kind: Kind, path: Path) -> str:
    """`read` or `refused`. Raises whatever is a defect, AssertionError for a refusal that is not one line."""
    try:
        kind.judge(path)
    except AutomarineError as refusal:
        assert str(refusal).isprintable(), f"not one printable line: {refusal!s}"
        assert len(str(refusal)) < 4000, f"{len(str(refusal))} characters"
        return "refused"
    return "read"


def case(name: str, number: int, seed: int) -> bytes:
    """The torn file of this kind and number: the same on every machine."""
    kind = KINDS[name]
    content = torn(kind.good(), random.Random(f"{name}/{seed}/{number}"))
    return gzip.compress(content, mtime=0) if name == "CSV, torn before gzip" else content
