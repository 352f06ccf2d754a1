"""Many log files quickly: step runs of the closed form with a degree of noise, as small CSV files, as few large
ones, or as Parquet."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as pq
from campaigns import BOTH_SIDES, INERTIA, K_RR, NOISE

from automarine_cli.models.yaw_model import response

REST_S = 2.0


def run_table(number: int, rate_hz: float = 50.0, seconds: float = 20.0) -> pa.Table:
    """One run: rest, then a step of a moment that depends on `number`; as a logger rounds it."""
    random = np.random.default_rng([17, number])
    moment = BOTH_SIDES[number % len(BOTH_SIDES)]
    time = np.arange(round(rate_hz * seconds)) / rate_hz
    heading, _ = response(time - REST_S - random.uniform() / rate_hz, moment, INERTIA, 0.0, K_RR)
    noisy = np.degrees(heading + NOISE * random.standard_normal(len(time))) + random.uniform(0, 360)
    stamps = np.round(time + 30.0 * number, 3)  # one clock for the whole campaign
    tau = np.where(time > REST_S, moment, 0.0)
    return pa.table({"time_s": stamps, "heading_deg": np.round(noisy % 360.0, 3), "tau": tau})


def small_csv(folder: Path, count: int) -> list[Path]:
    """`count` files of one run each (1,000 samples)."""
    folder.mkdir(parents=True)
    for i in range(count):
        arrow_csv.write_csv(run_table(i), folder / f"run_{i:05d}.csv")
    return sorted(folder.iterdir())


def large_csv(folder: Path, total_bytes: int, files: int = 4) -> list[Path]:
    """Files of many runs of 5,000 samples, `total_bytes` together, the runs distinguished by a column."""
    folder.mkdir(parents=True)
    runs = _endless(5000)
    for i in range(files):
        path = folder / f"day_{i}.csv"
        with path.open("wb") as file:
            while file.tell() < total_bytes / files:
                options = arrow_csv.WriteOptions(quoting_style="none", include_header=file.tell() == 0)
                arrow_csv.write_csv(next(runs), file, options)
    return sorted(folder.iterdir())


def parquet(folder: Path, samples: int, files: int = 10) -> list[Path]:
    """Files of many runs of 5,000 samples, `samples` together."""
    folder.mkdir(parents=True)
    runs = _endless(5000)
    each = max(1, round(samples / files / 5000))
    for i in range(files):
        tables = [next(runs) for _ in range(each)]
        pq.write_table(pa.concat_tables(tables), folder / f"day_{i}.parquet")
    return sorted(folder.iterdir())


def _endless(samples: int) -> Iterator[pa.Table]:
    number = 0
    while True:
        table = run_table(number, samples / 20.0)
        yield table.append_column("run", pa.array(np.full(samples, number), pa.int32()))
        number += 1
