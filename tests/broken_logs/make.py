"""The broken logs that are large, binary or oddly named; the small ones are files in this folder.

`make(folder)` writes every case into `folder`; `expected.toml` says what automarine has to answer to each.
"""

import gzip
import io
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from made_runs import step_run

HERE = Path(__file__).resolve().parent
ODD_NAMES = (
    "quote'and\"quote.csv", "new\nline.csv", "comma, blank.csv", "Größe_タンク.csv", "$(touch x); echo `id` & |.csv",
    "<script>alert(1)</script>.csv".replace("/", "_"), "-o.csv", "%s{0}.csv", "\x1b[31mred.csv",
)  # fmt: skip
"""File names that are a trap for shells, terminals, tables and format strings; what is in them is good."""


def good_table(moment: float = 0.5, seed: int = 0) -> pd.DataFrame:
    """A step run that every command can use, rounded as loggers do."""
    run = step_run(moment, seed=seed)
    table = {"time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, "tau": run.moment}
    return pd.DataFrame(table).round(3)


def csv_of(table: pd.DataFrame) -> bytes:
    """The table as a CSV file."""
    return table.to_csv(index=False, lineterminator="\n").encode()


def parquet_of(table: "pd.DataFrame | Mapping[str, object]", **how: object) -> bytes:
    """The table as a Parquet file."""
    buffer = io.BytesIO()
    made = pa.Table.from_pandas(table, preserve_index=False) if isinstance(table, pd.DataFrame) else pa.table(table)
    pq.write_table(made, buffer, **how)
    return buffer.getvalue()


def _clocks(good: pd.DataFrame) -> dict[str, bytes]:
    backwards = good.copy()
    backwards.loc[40:, "time_s"] -= 30.0
    hour = good.copy()
    hour.loc[40:, "time_s"] += 3600.0
    return {
        "clock_backwards.csv": csv_of(backwards),
        "clock_constant.csv": csv_of(good.assign(time_s=5.0)),
        "clock_in_milliseconds.csv": csv_of(good.assign(time_s=(1000 * good.time_s).round())),
        "hour_long_gap.csv": csv_of(hour),
    }


def _compasses(good: pd.DataFrame) -> dict[str, bytes]:
    turned = (good.heading_deg + 200) % 360
    noise = 90 + np.random.default_rng(1).standard_normal(len(good)).round(3)
    return {
        "radians_called_degrees.csv": csv_of(good.assign(heading_deg=np.deg2rad(turned).round(5))),
        "stuck_compass.csv": csv_of(good.assign(heading_deg=123.5)),
        "absurd_headings.csv": csv_of(good.assign(heading_deg=(1e9 * good.heading_deg).round())),
        "never_moves.csv": csv_of(good.assign(heading_deg=noise)),
    }


def _many_runs(good: pd.DataFrame) -> dict[str, bytes]:
    mirrored = good.assign(heading_deg=(360 - good.heading_deg) % 360, tau=-good.tau)
    both = pd.concat([good.assign(run="whole"), mirrored.head(5).assign(run="cut")])
    return {
        "one_run_cut_short.csv": csv_of(both),
        "one_run_cut_short.parquet": parquet_of(both),
        "same_name/run.csv": csv_of(good),
        "same_name_too/run.csv": csv_of(mirrored),
    }


def _damaged(good: pd.DataFrame) -> dict[str, bytes]:
    packed = gzip.compress(csv_of(good), mtime=0)
    columnar = parquet_of(good)
    random = np.random.default_rng(0).integers(1, 256, 4096, dtype=np.uint8).tobytes()
    rows = 20_000_000
    return {
        "binary.csv": b"\x89BIN\r\n" + random,
        "truncated.csv.gz": packed[: len(packed) // 2],
        "damaged.csv.gz": packed[:200] + bytes(64) + packed[264:],
        "plain_text.csv.gz": csv_of(good),
        "bomb.csv.gz": gzip.compress(b"time_s,heading_deg,tau\n" + b"0,0,0\n" * 12_000_000, 9, mtime=0),
        "truncated.parquet": columnar[: len(columnar) // 2],
        "damaged.parquet": columnar[:-200] + bytes(180) + columnar[-20:],
        "plain_text.parquet": csv_of(good),
        "bomb.parquet": parquet_of({"time_s": np.zeros(rows), "heading_deg": np.zeros(rows), "tau": np.zeros(rows)}),
        "cut_last_row.csv": csv_of(good)[:-12],
    }


def _wide(good: pd.DataFrame) -> dict[str, bytes]:
    names = [f"c{i}" for i in range(20_000)]
    lines = csv_of(good).decode().splitlines()
    wide = [lines[0] + "," + ",".join(names)] + [line + ",0" * len(names) for line in lines[1:]]
    return {
        "twenty_thousand_columns.csv": "\n".join(wide).encode(),
        "twenty_thousand_columns_no_tau.csv": "\n".join(wide[:4]).replace("tau", "c").encode(),
    }


def make(folder: Path) -> Path:
    """Every case in `folder`, which may exist; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(HERE.iterdir()):
        if path.suffix not in (".py", ".toml") and path.is_file():
            shutil.copyfile(path, folder / path.name)
    good = good_table()
    parts = (_clocks, _compasses, _many_runs, _damaged, _wide)
    for name, content in {k: v for part in parts for k, v in part(good).items()}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    for name in ODD_NAMES:
        (folder / name).write_bytes(csv_of(good))
    (folder / "directory.csv").mkdir(exist_ok=True)
    link = folder / "dangling_link.csv"
    if not link.is_symlink():
        link.symlink_to(folder / "nowhere.csv")
    return folder
