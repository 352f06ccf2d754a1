"""Fits side by side: campaigns with a known truth as CSV files, the Cramer-Rao bound of each, time of the whole job."""

import inspect
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import peer_automarine
from campaigns import NOISE, PERIOD, REST
from efficiency import location_information, log_cosh
from made_runs import INERTIA, K_RR

from automarine_cli.models.model import response
from automarine_cli.quantities import Floats

Row = dict[str, Any]

TRUTH = {"I_r": INERTIA, "k_rr": K_RR}
KINDS = ("clean", "scatter", "between", "delay")
SIZES = (12, 24, 72)
SCATTER, DELAY = 0.03, 0.25  # of the thrust from run to run; s
TIMED = 3


def moments_of(runs: int) -> list[float]:
    """Commands from 0.1 to 1.2 to both sides."""
    sizes = np.tile(np.linspace(0.1, 1.2, min(runs // 2, 12)), -(-runs // 24))
    return [side * size for size in sizes for side in (-1, 1)]


def write(folder: Path, kind: str, runs: int, seed: int) -> Floats:
    """The logs of a campaign: three seconds of rest, then a step through about a turn. Returns the bound, (2,)."""
    random = np.random.default_rng([KINDS.index(kind), runs, seed])
    courses = []
    for i, moment in enumerate(moments_of(runs)):
        last = round(8.0 * INERTIA / np.sqrt(abs(moment) * K_RR) / PERIOD)
        clock = PERIOD * np.arange(-REST, last)
        late = {"between": -PERIOD * random.uniform(), "delay": DELAY}.get(kind, 0.0)
        gain = np.exp(SCATTER * random.standard_normal()) if kind == "scatter" else 1.0
        turned, _ = response(clock - late, gain * moment, INERTIA, 0.0, K_RR)
        heading = np.degrees(random.uniform(-np.pi, np.pi) + turned + NOISE * random.standard_normal(len(clock)))
        stamps = (clock - clock[0] + 60.0 * i).round(3)
        tau = np.where(clock > -1e-9, moment, 0.0).round(4)
        log = pd.DataFrame({"time_s": stamps, "heading_deg": heading.round(3) % 360.0, "tau": tau})
        log.to_csv(folder / f"run_{i:02d}.csv", index=False)
        courses.append((clock - late, moment))
    return bound_of(courses, kind)


def bound_of(courses: Sequence[tuple[Floats, float]], kind: str) -> Floats:
    """Smallest standard deviations of unbiased estimates of I and k as shares of them, (2,).

    Start headings are free, and one delay of all runs. Instants lie anywhere in their sample interval where the switch
    is `between` samples. Where thrust scatters it is the bound of the mixed model, its size known.
    """
    total = np.zeros((3, 3))
    for clock, moment in courses:
        x = np.sqrt(abs(moment) * K_RR) * np.maximum(clock, 0.0) / INERTIA
        grown, bend = log_cosh(x), x * np.tanh(x)
        rate = np.sqrt(abs(moment) / K_RR) * np.tanh(x)
        columns = np.stack([(grown - bend) / K_RR, INERTIA / K_RR**2 * (bend / 2 - grown), -rate], axis=1)
        gained = INERTIA / K_RR * bend / 2
        columns, gained = columns - columns.mean(axis=0), gained - gained.mean()
        own = SCATTER * gained if kind == "scatter" else 0.0 * gained
        seen = columns.T @ own
        told = (columns.T @ columns - np.outer(seen, seen) / (NOISE**2 + own @ own)) / NOISE**2
        if kind == "between":  # of the delay only what a point drawn from its interval tells of the interval's middle
            moves = told[:, 2] / told[2, 2]
            known = location_information(1.0 / np.sqrt(told[2, 2]), PERIOD)
            told = told - np.outer(told[:, 2], moves) + known * np.outer(moves, moves)
        total += told
    return np.sqrt(np.diagonal(np.linalg.inv(total))[:2]) / list(TRUTH.values())


def cells(titles: Sequence[str], campaigns: int) -> list[tuple[str, str, int, int]]:
    """All that is to be fitted: tool, kind, runs, seed; every tool in turn, so that what there is can be compared."""
    return [(t, kind, runs, s) for s in range(campaigns) for runs in SIZES[::-1] for kind in KINDS for t in titles]


def fitted(cell: tuple[str, str, int, int], peer: ModuleType) -> Row:
    """Errors in units of the bound, and whether intervals hold the truth (None without one)."""
    _, kind, runs, seed = cell
    with tempfile.TemporaryDirectory() as folder:
        least = write(Path(folder), kind, runs, seed)
        found = peer.fit(Path(folder))
    row: Row = {}
    for limit, (name, truth) in zip(least, TRUTH.items()):
        value, *ends = found[name]
        row[name] = {"error": (value / truth - 1.0) / limit, "holds": ends[0] <= truth <= ends[1] if ends else None}
    return row


def timed(title: str, peer: ModuleType, runs: int) -> list[float]:
    """Seconds of the whole job, as a process, from the files of a campaign to numbers."""
    took = []
    with tempfile.TemporaryDirectory() as place:
        logs, out = Path(place, "logs"), Path(place, "out")
        logs.mkdir()
        write(logs, "clean", runs, 0)
        line = [sys.executable, "-W", "ignore", "-c", f"{alone(peer)}\nfit(Path({str(logs)!r}))"]
        if peer is peer_automarine:
            line = [sys.executable, "-m", "automarine_cli", "fit-yaw", str(logs), "-o", str(out), "-q", "--overwrite"]
            line += ["--figures", "none"]
        for _ in range(TIMED):
            begun = time.perf_counter()
            subprocess.run(line, check=True, capture_output=True)
            took.append(time.perf_counter() - begun)
    return took


def alone(peer: ModuleType) -> str:
    """A tool's script as a user has it: its libraries and its function from files to numbers, nothing of ours."""
    head = inspect.getsource(peer).split("\n\n\ndef ")[0].splitlines()
    kept = [line for line in head if not re.match(r"(from|import) (peers_|real_|automarine)", line)]
    return "\n".join(kept) + "\n\n\n" + inspect.getsource(peer.fit)


def lines_of(peer: ModuleType) -> int:
    """Lines that a user writes: those of the function from files to numbers, without its docstring."""
    if hasattr(peer, "LINES"):
        return int(peer.LINES)
    code = inspect.getsource(peer.fit).splitlines()
    more = str(getattr(peer, "VEHICLE", "")).strip().splitlines()
    return sum(bool(line.strip()) for line in [*code, *more]) - 1


def summary(done: dict[str, Row], titles: Sequence[str]) -> list[Row]:
    """Bias and spread in units of the bound and coverage, of each tool, kind and number of runs."""
    rows = []
    for title in titles:
        for kind in KINDS:
            for runs in SIZES:
                some = [row for key, row in done.items() if key.startswith(f"{title} | {kind} | {runs} |")]
                good = [row for row in some if "failed" not in row]
                if not good:
                    continue
                row: Row = {"tool": title, "kind": kind, "runs": runs, "campaigns": len(some)}
                row["failed"] = len(some) - len(good)
                for name in TRUTH:
                    errors = np.array([each[name]["error"] for each in good])
                    holds = [each[name]["holds"] for each in good]
                    row[name] = {
                        "bias": errors.mean(), "sd": errors.std(ddof=1) if len(errors) > 1 else None,
                        "rms": float(np.sqrt(np.mean(errors**2))),
                        "coverage": None if None in holds else 100.0 * float(np.mean(holds)),
                    }  # fmt: skip
                rows.append(row)
    return rows
