"""Torn files before the readers, as many as one likes: a right answer or one clear sentence.

    python tests/benchmarks/reliability.py --inputs 20000 --seed 1 --jobs 2

Every input is a good file with one to four things done to its bytes (`tests/helpers/fuzzing.py`); a few hundred are in
`make test`. One in fifty goes through a whole command, `fit-thrusters`, `fit-yaw` or `validate`, as a torn log or
model among good ones. A defect is another exception than a refusal, a crash of the interpreter, more than twenty
seconds, another number than Python's own csv and float read, or an answer with a NaN. The same seed tries the same
inputs.
"""

# ruff: noqa: E402 - the folder of the tests has to be on the path first

import argparse
import collections
import functools
import gzip
import multiprocessing as mp
import resource
import signal
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "helpers"), str(TESTS), str(TESTS.parent)]

from broken_logs.make import csv_of, good_table
from click.testing import CliRunner
from fuzzing import KINDS, Kind, case, outcome

from automarine_cli.commands import automarine
from automarine_cli.errors import AutomarineError

PATIENCE_S = 20  # one input may take
CHUNK = 250  # inputs of one process
MOMENTS = (-1.2, -0.8, -0.3, 0.3, 0.8, 1.2)


@dataclass
class Tally:
    """What became of the inputs of one kind."""

    outcomes: collections.Counter[str] = field(default_factory=collections.Counter)
    slowest_s: float = 0.0
    memory_MB: float = 0.0
    defects: list[str] = field(default_factory=list)


def command(*arguments: object) -> None:
    """A whole command in this process. Raises AutomarineError where it refuses, AssertionError for a defect."""
    found = CliRunner().invoke(automarine, [str(argument) for argument in arguments])
    assert found.exit_code in (0, 1), f"exit status {found.exit_code}: {found.stderr[-300:]}"
    assert "defect" not in found.stderr and "Traceback" not in found.stderr, found.stderr[-300:]
    if found.exit_code:
        lines = [line for line in found.stderr.splitlines() if line.startswith("Error: ")]
        assert len(lines) == 1, found.stderr
        raise AutomarineError(lines[0])


def campaign(folder: Path) -> Path:
    """Good logs in a folder of their own."""
    good = folder / "good"
    if not good.is_dir():
        good.mkdir()
        for seed, moment in enumerate(MOMENTS):
            (good / f"tau_{moment:+}.csv").write_bytes(csv_of(good_table(moment, seed)))
    return good


def fit_yaw(path: Path) -> None:
    """`fit-yaw` of good logs and the torn one, which is found, not named."""
    torn = campaign(path.parent) / path.name
    torn.write_bytes(path.read_bytes())
    command("fit-yaw", torn.parent)


def validate(path: Path) -> None:
    """`validate` of a good log with the torn model."""
    log = campaign(path.parent) / "tau_+0.8.csv"
    command("validate", log, "--model", path)


def fit_thrusters(path: Path) -> None:
    """`fit-thrusters` of the torn log alone."""
    command("fit-thrusters", path)


COMMANDS = {
    "fit-thrusters with a torn CSV": Kind(KINDS["thruster test"].good, ".csv", fit_thrusters),
    "fit-yaw with a torn CSV": Kind(KINDS["CSV"].good, ".csv", fit_yaw),
    "fit-yaw with a torn Parquet": Kind(KINDS["Parquet"].good, ".parquet", fit_yaw),
    "validate with a torn model": Kind(KINDS["yaw model"].good, ".json", validate),
}
SOURCES = dict(zip(COMMANDS, ("thruster test", "CSV", "Parquet", "yaw model")))


def work(name: str, numbers: range, seed: int, at: Any, answers: Any) -> None:
    """In a process of its own: these inputs of one kind; sends the tally."""
    kind, source = KINDS.get(name) or COMMANDS[name], SOURCES.get(name, name)
    tally = Tally()

    def too_long(number: int, frame: object) -> None:
        raise TimeoutError(f"more than {PATIENCE_S} s")

    signal.signal(signal.SIGALRM, too_long)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"torn{kind.suffix}")
        good = kind.good()
        path.write_bytes(gzip.compress(good) if "before gzip" in name else good)
        assert outcome(kind, path) == "read", f"the good {name} is refused"
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in numbers:
            at.value = number
            path.write_bytes(case(source, number, seed))
            began = time.perf_counter()
            signal.alarm(PATIENCE_S)
            try:
                found = outcome(kind, path)
            except BaseException as defect:
                ours = [f for f in traceback.extract_tb(defect.__traceback__) if "automarine_cli" in f.filename]
                where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""
                words = " ".join(str(defect).split())[:200]
                tally.defects.append(f"{name} {number}: {type(defect).__name__} {where} {words}")
                found = "defect"
            signal.alarm(0)
            tally.outcomes[found] += 1
            tally.slowest_s = max(tally.slowest_s, time.perf_counter() - began)
        tally.memory_MB = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    answers.send(tally)


def chunk(task: tuple[str, range], seed: int) -> tuple[str, Tally]:
    """One process; what kills it is a defect of the input at which it was."""
    name, numbers = task
    spawn = mp.get_context("spawn")
    here, there = spawn.Pipe(duplex=False)
    at = spawn.Value("l", numbers.start)
    process = spawn.Process(target=work, args=(name, numbers, seed, at, there))
    process.start()
    there.close()
    try:
        tally = here.recv()
    except EOFError:
        process.join()
        tally = Tally(collections.Counter(defect=1))
        tally.defects.append(f"{name} {at.value}: the process ended with {process.exitcode}")
    process.join()
    return name, tally


def main() -> int:
    """Try, count, print; exit status 1 if there was a defect."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=20_000, help="files to tear in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    each = {name: -(-asked.inputs * 49 // (50 * len(KINDS))) for name in KINDS}
    each |= {name: -(-asked.inputs // (50 * len(COMMANDS))) for name in COMMANDS}
    tasks = [
        (name, range(first, min(first + CHUNK, count)))
        for name, count in each.items()
        for first in range(0, count, CHUNK)
    ]
    total: dict[str, Tally] = {name: Tally() for name in each}
    with ThreadPoolExecutor(asked.jobs) as pool:
        for name, tally in pool.map(functools.partial(chunk, seed=asked.seed), tasks):
            total[name].outcomes += tally.outcomes
            total[name].slowest_s = max(total[name].slowest_s, tally.slowest_s)
            total[name].memory_MB = max(total[name].memory_MB, tally.memory_MB)
            total[name].defects += tally.defects
            for defect in tally.defects:
                print(f"DEFECT {defect}", flush=True)
    report(total, asked.seed)
    return int(any(tally.defects for tally in total.values()))


def report(total: dict[str, Tally], seed: int) -> None:
    print(f"{'kind':30}{'inputs':>9}{'read':>9}{'refused':>9}{'defects':>9}{'slowest s':>11}{'memory MB':>11}")
    for name, tally in total.items():
        counts = tally.outcomes
        print(
            f"{name:30}{counts.total():9}{counts['read']:9}{counts['refused']:9}{counts['defect']:9}"
            f"{tally.slowest_s:11.2f}{tally.memory_MB:11.0f}"
        )
    everything = sum((tally.outcomes for tally in total.values()), collections.Counter())
    print(
        f"{everything.total()} inputs tried (seed {seed}): {everything['read']} read, {everything['refused']} refused "
        f"in one sentence, {everything['defect']} defects"
    )


if __name__ == "__main__":
    sys.exit(main())
