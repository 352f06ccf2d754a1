"""Whole commands as processes, in turns with an anchor each; a ratio that leaves its band makes `make bench` fail.

Processor time of the process and of what it starts, figures and files included: what a user waits for on a busy
machine. The anchor loads the same libraries and does the least that anybody must do; it is what makes figures of
different machines comparable. A first round, which compiles modules, does not count.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import many_logs
import numpy as np
import pyarrow.csv as arrow_csv

from automarine_cli.pipeline.parallel import Progress
from automarine_cli.report.tables import Table

Result = tuple[list[Table], dict[str, Any]]
RUNS, SAMPLES = 2000, 250
DIAGNOSED = 72
LIBRARIES = "import click, numpy, scipy.optimize, pandas, matplotlib.figure, pyarrow.csv as csv, glob, sys"
READING = f"{LIBRARIES}; [csv.read_csv(name) for name in sorted(glob.glob(sys.argv[1] + '/*.csv'))]"


@dataclass(frozen=True)
class Case:
    """A command line and its anchor (arguments of python), and the band in which their ratio is expected."""

    name: str
    command: tuple[str, ...]
    anchor: tuple[str, ...]
    low: float
    high: float


def cases(folder: Path) -> Iterator[Case]:
    """What is measured, on the logs in `folder`."""
    many, few = str(folder / "many"), str(folder / "few")
    tool = ("-m", "automarine_cli")
    out = ("-q", "--overwrite", "-o", str(folder / "out"))
    yield Case("--help", (*tool, "--help"), ("-c", "import click"), 0.9, 2.5)
    yield Case(f"check, {RUNS} files", (*tool, "check", many, *out), ("-c", READING, many), 1.0, 3.0)
    yield Case(f"fit-yaw, {RUNS} files", (*tool, "fit-yaw", many, *out), ("-c", READING, many), 1.0, 5.0)
    model = ("--model", str(folder / "model" / "yaw_model.json"))
    diagnosis = (*tool, "diagnose", few, *model, *out)
    yield Case(f"diagnose, {DIAGNOSED} runs", diagnosis, ("-c", READING, few), 1.0, 10.0)
    # what the second process loads is all that two cost more; by the clock they are faster
    yield Case(f"diagnose, {DIAGNOSED} runs, two processes", (*diagnosis, "--jobs", "2"), diagnosis, 0.8, 1.5)


def commands(repeats: int, progress: Progress) -> Result:
    """Ratios of processor time, medians of `repeats`; result "outside" names those that left their bands."""
    rows, found = [], dict[str, Any]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, count in (("many", RUNS), ("few", DIAGNOSED)):
            (folder / name).mkdir()
            for i in range(count):
                table = many_logs.run_table(i, rate_hz=SAMPLES / 20.0)
                arrow_csv.write_csv(table, folder / name / f"run_{i:05d}.csv")
        seconds("-m", "automarine_cli", "fit-yaw", str(folder / "few"), "-q", "-o", str(folder / "model"))
        every = list(cases(folder))
        for case in every:
            rounds = [[seconds(*case.command), seconds(*case.anchor)] for _ in range(1 + repeats)]
            taken = np.array(rounds[1:])
            command, anchor = np.median(taken, axis=0)
            ratio = float(np.median(taken[:, 0] / taken[:, 1]))
            inside = case.low <= ratio <= case.high
            band = f"{case.low:g} to {case.high:g}"
            rows.append(
                (case.name, f"{command:.2f}", f"{anchor:.2f}", f"{ratio:.2f}", band, "" if inside else "outside")
            )
            found[case.name] = {"command_s": command, "anchor_s": anchor, "ratio": ratio, "inside": inside}
            progress("whole commands", len(rows), len(every))
    note = "Processor time of whole processes, medians; the anchor loads the same libraries and reads the same files."
    header = ("command", "s", "anchor s", "ratio", "expected", "")
    found["outside"] = [name for name, one in found.items() if not one["inside"]]
    return [Table("Whole commands", header, tuple(rows), notes=(note,))], found


def seconds(*arguments: str) -> float:
    """Processor time [s] of a python process with these arguments, and of all that it starts."""
    compiled = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = os.times()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=compiled)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system
