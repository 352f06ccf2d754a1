"""Speed of whole commands, as processes, in turns with an anchor each that loads the same libraries and does the least
that anybody must do, or a fixed piece of work on small arrays where there is no such least; what counts is processor
time with figures and files, which a user waits for on a busy machine. A ratio that leaves its band makes `make bench`
fail. A first round, which compiles modules, does not count."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from blind_cases import Case
from blind_frozen import DRIVEN, campaign_of, logged
from campaigns import BOTH_SIDES, NOISE
from made_runs import INERTIA, K_RR

from automarine_cli.models.model import response
from automarine_cli.pipeline.parallel import Progress
from automarine_cli.report.tables import Table

SAMPLES, MANY, FEW = 250, 2000, 72
"""Samples a run; runs that are checked and fitted; runs that are diagnosed."""
LIBRARIES = "import click, numpy, scipy.optimize, pandas, matplotlib.figure, pyarrow.csv as csv, glob, sys"
READING = f"{LIBRARIES}; [csv.read_csv(name) for name in sorted(glob.glob(sys.argv[1] + '/*.csv'))]"
WORK = "import numpy as np; x = np.ones(1000); any(np.sqrt(x * x + 1.0) is None for _ in range(1_000_000))"
HIDDEN = {"steps": Case(("dead-band",), "large", "full", 0, runs=FEW), "driven": Case((), DRIVEN, DRIVEN, 0)}
"""Campaigns of the blind benchmark whose diagnosis is timed: with eight manoeuvres, and 14 runs under a controller."""


def cases(folder: Path) -> dict[str, tuple[tuple[str, ...], tuple[str, ...], float, float]]:
    """A command line and its anchor (arguments of python), and the band in which their ratio is expected."""
    many, few = str(folder / "many"), str(folder / "few")
    tool = ("-m", "automarine_cli")
    out = ("-q", "--overwrite", "-o", str(folder / "out"))

    def diagnose(logs: str) -> tuple[str, ...]:
        model = folder / f"{logs}_model" / "yaw_model.json"
        return (*tool, "diagnose", str(folder / logs), "--model", str(model), *out)

    diagnosis = diagnose("few")
    return {
        "--help": ((*tool, "--help"), ("-c", "import click"), 0.5, 2.5),
        f"check, {MANY} files": ((*tool, "check", many, *out), ("-c", READING, many), 7.0, 28.0),
        f"fit-yaw, {MANY} files": ((*tool, "fit-yaw", many, *out), ("-c", READING, many), 5.5, 22.0),
        f"diagnose, {FEW} runs": (diagnosis, ("-c", READING, few), 1.0, 10.0),
        # what the second process loads is all that two cost more; by the clock they are faster
        f"diagnose, {FEW} runs, two processes": ((*diagnosis, "--jobs", "2"), diagnosis, 0.8, 2.0),
        f"diagnose, dead band, {FEW} runs and 8 manoeuvres": (diagnose("steps"), ("-c", WORK), 6.0, 24.0),
        "diagnose, 14 driven runs": (diagnose("driven"), ("-c", WORK), 7.0, 28.0),
    }


def commands(repeats: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Ratios of processor time, medians of `repeats`; result "outside" names those that left their bands."""
    rows, results = [], dict[str, Any]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, count in (("many", MANY), ("few", FEW)):
            (folder / name).mkdir()
            for i in range(count):
                arrow_csv.write_csv(run_table(i), folder / name / f"run_{i:05d}.csv")
        for name, case in HIDDEN.items():
            (folder / name).mkdir()
            for run in campaign_of(case)[0]:
                logged(run).to_csv(folder / name / f"{run.name}.csv", index=False)
        for name in ("few", *HIDDEN):
            seconds("-m", "automarine_cli", "fit-yaw", str(folder / name), "-q", "-o", str(folder / f"{name}_model"))
        every = cases(folder)
        for name, (command, anchor, low, high) in every.items():
            taken = np.array([[seconds(*line) for line in (command, anchor)] for _ in range(1 + repeats)])[1:]
            took, least = np.median(taken, axis=0)
            ratio = float(np.median(taken[:, 0] / taken[:, 1]))
            inside = low <= ratio <= high
            rows.append({
                "command": name, "s": f"{took:.2f}", "anchor s": f"{least:.2f}", "ratio": f"{ratio:.2f}",
                "expected": f"{low:g} to {high:g}", "": "" if inside else "outside",
            })  # fmt: skip
            results[name] = {"command_s": took, "anchor_s": least, "ratio": ratio, "inside": inside}
            progress("whole commands", len(rows), len(every))
    results["outside"] = [name for name, result in results.items() if not result["inside"]]
    note = "Processor time of whole processes, medians; the anchor loads the same libraries and reads the same files."
    return [Table.of("Whole commands", rows, [note])], results


def run_table(number: int) -> pa.Table:
    """One run: rest, then a step of a moment that depends on `number`; as a logger rounds it."""
    random = np.random.default_rng([17, number])
    rest, rate_hz, moment = 2.0, SAMPLES / 20.0, BOTH_SIDES[number % len(BOTH_SIDES)]
    clock = np.arange(SAMPLES) / rate_hz
    heading, _ = response(clock - rest - random.uniform() / rate_hz, moment, INERTIA, 0.0, K_RR)
    noisy = np.degrees(heading + NOISE * random.standard_normal(len(clock))) + random.uniform(0, 360)
    stamps = np.round(clock + 30.0 * number, 3)  # one clock for the whole campaign
    tau = np.where(clock > rest, moment, 0.0)
    return pa.table({"time_s": stamps, "heading_deg": np.round(noisy % 360.0, 3), "tau": tau})


def seconds(*arguments: str) -> float:
    """Processor time [s] of a python process with these arguments, and of all that it starts."""
    compiled = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = os.times()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=compiled)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system
