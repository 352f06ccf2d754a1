"""What every log format must do, one judge for all: a new format is judged by adding one writer here."""

import gzip
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs import LogFile, LogTable, read_log
from automarine_cli.logs.formats import formats

Columns = dict[str, list[float] | list[str]]


def _text(separator: str) -> Callable[[Columns], bytes]:
    return lambda columns: pd.DataFrame(columns).to_csv(index=False, sep=separator).encode()


def _packed(separator: str) -> Callable[[Columns], bytes]:
    return lambda columns: gzip.compress(_text(separator)(columns), mtime=0)


def _parquet(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer)
    return buffer.getvalue()


WRITERS: dict[str, Callable[[Columns], bytes]] = {
    ".csv": _text(","),
    ".csv.gz": _packed(","),
    ".tsv": _text("\t"),
    ".tsv.gz": _packed("\t"),
    ".parquet": _parquet,
}
SUFFIXES = sorted(suffix for form in formats() for suffix in form.suffixes)

YAW: Columns = {
    "time_s": [round(0.1 * i, 1) for i in range(40)],
    "heading_deg": [0.0] * 10 + [0.5 * i * i for i in range(30)],
    "tau": [0.0] * 10 + [0.5] * 30,
    "water_temperature": [20.25 - 0.5 * (i % 7) for i in range(40)],
    "run": ["07"] * 40,
}


def log(folder: Path, content: bytes, name: str = "log.csv", *, named: bool = True) -> LogFile:
    """A log file of these bytes."""
    path = folder / name
    path.write_bytes(content)
    return LogFile(path, name, named)


def refusal(file: LogFile) -> str:
    """The sentence with which a log is refused; the test fails if it is read."""
    try:
        table = read_log(file)
    except LogError as error:
        return str(error)
    raise AssertionError(f"{file.name} was read: {len(table)} rows of {list(table.columns)}")


def judge_good_file(folder: Path, suffix: str) -> None:
    """What was written comes back in SI units, with row numbers and the columns nobody asked for."""
    table = read_log(log(folder, WRITERS[suffix](YAW), f"good{suffix}"))
    first = 1 if suffix == ".parquet" else 2
    assert isinstance(table, LogTable)
    assert sorted(table.columns) == ["heading", "moment", "time"]
    np.testing.assert_allclose(table.columns["time"], YAW["time_s"], rtol=1e-15)
    np.testing.assert_allclose(table.columns["heading"], np.deg2rad(np.array(YAW["heading_deg"])), rtol=1e-15)
    np.testing.assert_array_equal(table.columns["moment"], YAW["tau"])
    np.testing.assert_array_equal(table.extras["water_temperature"], YAW["water_temperature"])
    assert list(table.rows) == list(range(first, first + 40))
    assert table.run is not None and set(table.run) == {"07"}
    assert table.moment_unit == "nu"
    assert table.names == tuple(YAW)


def judge_bad_files(folder: Path, suffix: str) -> None:
    """Whatever is no log is refused in one printable line that begins with the file's name."""
    good = WRITERS[suffix](YAW)
    text = suffix in (".csv", ".tsv")
    bad = {
        "empty": b"",
        "cut": good[:-30].rsplit(b"\n", 1)[0] + b"\n1" if text else good[: len(good) // 2],
        "random": bytes(np.random.default_rng(1).integers(0, 256, 4096, dtype=np.uint8)),
        "zeros": bytes(4096),
    }
    for name, content in bad.items():
        sentence = refusal(log(folder, content, f"{name}{suffix}"))
        assert sentence.startswith(f"{name}{suffix}") and sentence.isprintable(), sentence
