"""Reading: files to trimmed half-turns against pandas that merely reads the same files; memory."""

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import many_logs
import numpy as np
import pandas as pd

from automarine_cli.dofs import YAW
from automarine_cli.pipeline.parallel import Progress
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.load import load_runs

Result = tuple[list[Table], dict[str, Any]]

MODERATE = {"few large CSV": 60_000_000, "many small CSV": 600, "Parquet": 5_000_000}
FULL = {"few large CSV": 1_000_000_000, "many small CSV": 20_000, "Parquet": 100_000_000}
"""Bytes, files of 1,000 samples, samples."""

MAKERS: dict[str, Callable[[Path, int], list[Path]]] = {
    "few large CSV": many_logs.large_csv,
    "many small CSV": many_logs.small_csv,
    "Parquet": many_logs.parquet,
}
REQUIRED = 1.0
EXPECTED = {"few large CSV": 5.5, "many small CSV": 3.5, "Parquet": 9.0}
"""Ratios of processor time above which `make bench` fails."""
MEMORY_REQUIRED = 1.2


def merely_read(files: Sequence[Path]) -> None:
    """What pandas needs for the files alone."""
    for file in files:
        pd.read_csv(file) if file.suffix == ".csv" else pd.read_parquet(file)


def reading(repeats: int, full: bool, progress: Progress) -> Result:
    """Wall and processor time of both ways, in turns so that both see the same machine."""
    rows, results = [], dict[str, Any]()
    for name, size in (FULL if full else MODERATE).items():
        with tempfile.TemporaryDirectory() as folder:
            files = MAKERS[name](Path(folder, "logs"), size)
            merely_read(files[:2])
            ways: dict[str, Callable[[], object]] = {
                "pandas": lambda files=files: merely_read(files),  # type: ignore[misc]
                "automarine": lambda folder=folder: half_turns(load_runs([folder], dof=YAW).runs),  # type: ignore[misc]
                "automarine, 2 jobs": lambda folder=folder: half_turns(load_runs([folder], jobs=2, dof=YAW).runs),  # type: ignore[misc]
            }
            taken: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
            for i in range(repeats):
                for way, work in ways.items():
                    taken[way].append(_seconds(work))
                progress(f"reading {name}", i + 1, repeats)
            size_mb = sum(file.stat().st_size for file in files) / 1e6
        wall, cpu = ({way: float(np.median([t[k] for t in taken[way]])) for way in ways} for k in (0, 1))
        ratio, cpu_ratio = wall["automarine"] / wall["pandas"], cpu["automarine"] / cpu["pandas"]
        speed_up = wall["automarine"] / wall["automarine, 2 jobs"]
        rows.append(
            (f"{name} ({len(files)} files, {size_mb:.0f} MB)", f"{wall['pandas']:.2f}", f"{wall['automarine']:.2f}",
             f"{ratio:.1f}", f"{cpu_ratio:.1f}", f"{speed_up:.2f}")
        )  # fmt: skip
        results[name] = {"files": len(files), "megabytes": size_mb, "wall_s": wall, "processor_s": cpu,
                         "ratio": ratio, "processor_ratio": cpu_ratio, "two_jobs_faster": speed_up}  # fmt: skip
    results["outside"] = [name for name, most in EXPECTED.items() if results[name]["processor_ratio"] > most]
    header = ("logs", "pandas [s]", "to half-turns [s]", "ratio", "ratio of processor time", "2 jobs are faster by")
    notes = (f"Medians of {repeats}; asked for is a ratio of at most {REQUIRED}.",)
    return [Table("Reading", header, tuple(rows), notes=notes)], results


def memory(full: bool, progress: Progress) -> Result:
    """Largest memory of a process that reads a campaign, and one of ten times its runs."""
    few = 2000 if full else 150
    rows, results = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for count in (few, 10 * few):
            many_logs.small_csv(Path(folder, str(count)), count)
        for step, (name, code) in enumerate(READERS.items(), 1):
            peaks = [_peak_mb(code, str(Path(folder, str(count)))) for count in (few, 10 * few)]
            ratio = peaks[1] / peaks[0]
            rows.append((name, f"{peaks[0]:.0f}", f"{peaks[1]:.0f}", f"{ratio:.2f}"))
            results[name] = {"runs": [few, 10 * few], "peak_mb": peaks, "ratio": ratio}
            progress("memory", step, len(READERS))
    header = ("work", f"{few} runs [MB]", f"{10 * few} runs [MB]", "ratio")
    notes = (f"Of runs of 1,000 samples, one a file; asked for is a ratio of at most {MEMORY_REQUIRED}.",)
    return [Table("Largest memory of the process", header, tuple(rows), notes=notes)], results


_START = "import sys; sys.path.insert(0, sys.argv[2])\n"
READERS = {
    "imports alone": _START + "import automarine_cli.commands.fit_motion",
    "every run in turn": _START
    + "import automarine_cli.commands.fit_motion\n"
    + "from automarine_cli.logs import find_logs\nfrom automarine_cli.dofs import YAW\n"
    + "from automarine_cli.runs.load import read_runs\n"
    + "print(sum(len(runs) for file in find_logs(sys.argv[1:2]) for runs in read_runs(file, dof=YAW)[:1]))",
    "half-turns of all runs": _START
    + "import automarine_cli.commands.fit_motion\n"
    + "from automarine_cli.dofs import YAW\nfrom automarine_cli.runs.load import load_runs\n"
    + "from automarine_cli.runs.half_turn import half_turns\n"
    + "print(sum(map(len, half_turns(load_runs(sys.argv[1:2], dof=YAW).runs))))",
    "check": _START + "from automarine_cli.commands.check import check\nprint(check(sys.argv[1:2]).logs)",
}


def _peak_mb(code: str, folder: str) -> float:
    tail = "\nprint([line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')][0])"
    return int(_child(code + tail, folder).splitlines()[-1]) / 1024  # kB; ru_maxrss would count the parent's too


def _child(code: str, folder: str) -> str:
    root = str(Path(__file__).parents[2])
    done = subprocess.run([sys.executable, "-c", code, folder, root], check=True, capture_output=True, text=True)
    return done.stdout


def _seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Wall and processor seconds, those of finished children included."""

    def processor() -> float:
        uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(use.ru_utime + use.ru_stime for use in uses)

    wall, cpu = time.perf_counter(), processor()
    work()
    return time.perf_counter() - wall, processor() - cpu
