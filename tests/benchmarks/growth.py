"""How time grows: fit-yaw on thousands of runs against reading them, diagnose with runs, samples and candidates."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import many_logs
import numpy as np
from campaigns import BOTH_SIDES, INERTIA, K_RR

from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.diagnosis import search
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.dofs import YAW
from automarine_cli.models.closed_form import response
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import lasting_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report.tables import Table
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run

Result = tuple[list[Table], dict[str, Any]]

MOST_TIMES_READING = 2.0
MOST_EXPONENT = 1.05


def many(repeats: int, progress: Progress) -> Result:
    """`fit_yaw` on 2,000 CSV runs of 1,000 samples, and reading them."""
    taken: dict[str, list[float]] = {"reading to half-turns": [], "fit-yaw, reading included": []}
    with tempfile.TemporaryDirectory() as folder:
        many_logs.small_csv(Path(folder, "logs"), 2000)
        works: Sequence[Callable[[], object]] = (lambda: load_runs([folder], dof=YAW), lambda: fit_yaw([folder]))
        for i in range(repeats):
            for name, work in zip(taken, works):
                taken[name].append(_seconds(work))
            progress("2,000 runs", i + 1, repeats)
    rows = tuple((name, f"{np.median(values):.2f}") for name, values in taken.items())
    read, whole = (float(np.median(values)) for values in taken.values())
    note = f"Ratio {whole / read:.2f}; asked for is at most {MOST_TIMES_READING:g}. Medians of {repeats}."
    table = Table("fit-yaw on 2,000 CSV runs", ("work", "seconds"), rows, notes=(note,))
    return [table], {"reading_s": read, "fit_yaw_s": whole, "ratio": whole / read}


def diagnose(repeats: int, progress: Progress) -> Result:
    """Seconds of a diagnosis where nothing is hidden, by number of runs, samples and candidates; two processes."""
    grown: dict[str, tuple[Sequence[int], Callable[[int], float]]] = {
        "runs (of 250 samples)": ((36, 72, 144, 288), lambda n: _diagnosed(_runs(n, 250))),
        "samples a run (of 72 runs)": ((125, 250, 500, 1000), lambda n: _diagnosed(_runs(72, n))),
        "candidates (72 runs of 250 samples)": ((3, 6, 12, 18), lambda n: _diagnosed(_runs(72, 250), n)),
    }
    rows, results = [], {}
    for name, (sizes, work) in grown.items():
        taken = np.empty((repeats, len(sizes)))
        for i in range(repeats):
            taken[i] = [work(size) for size in sizes]
            progress(name, i + 1, repeats)
        seconds = np.median(taken, axis=0)
        exponent = float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
        told = ", ".join(f"{size}: {s:.1f}" for size, s in zip(sizes, seconds))
        rows.append((name, told, f"{exponent:.2f}"))
        results[name] = {"sizes": list(sizes), "seconds": seconds.tolist(), "exponent": exponent}
    runs = _runs(72, 250)
    alone = np.median([_seconds(lambda: _diagnosed(runs)) for _ in range(repeats)])
    both = np.median([_seconds(lambda: _diagnosed(runs, jobs=2)) for _ in range(repeats)])
    rows.append(("two processes instead of one (72 runs of 250 samples)", f"{alone:.1f}, {both:.1f}", ""))
    results["two_jobs"] = {"one_s": float(alone), "two_s": float(both), "faster": float(alone / both)}
    note = f"Asked for is an exponent of at most {MOST_EXPONENT}. Medians of {repeats}."
    header = ("diagnose by number of", "seconds", "exponent")
    return [Table("Growth of a diagnosis", header, tuple(rows), notes=(note,))], results


def _runs(count: int, samples: int) -> list[Run]:
    """Steps of a known model with a degree of noise, 10 Hz at 250 samples."""
    random = np.random.default_rng([5, count, samples])
    clock = np.linspace(0.0, 25.0, samples, endpoint=False)
    runs = []
    for i in range(count):
        moment = BOTH_SIDES[i % len(BOTH_SIDES)]
        heading, _ = response(clock - 3.0, moment, INERTIA, 0.0, K_RR)
        noisy = heading + np.radians(1.0) * random.standard_normal(samples)
        runs.append(Run(f"run {i}", "simulated", clock, noisy, np.where(clock >= 3.0, moment, 0.0), "nu", dof=YAW))
    return runs


def _diagnosed(runs: list[Run], candidates: int | None = None, jobs: int = 1) -> float:
    """Seconds of one diagnosis, with the first `candidates` of those that apply."""
    model = YawModel.base("3", INERTIA, [K_RR], "nu", YAW)
    whole = search.candidates
    if candidates is not None:
        search.candidates = lambda *given: whole(*given)[:candidates]  # type: ignore[assignment]
    try:
        with lasting_map(jobs) as each:
            return _seconds(lambda: diagnose_runs(runs, model, each=each))
    finally:
        search.candidates = whole


def _seconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun
