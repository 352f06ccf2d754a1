"""Kills, faults and interrupts, as many as one likes, counted: are old results whole, or new ones, after each?

    python tests/benchmarks/interruptions.py --kills 200 --interrupts 40

Steps: a process that replaces results is killed at each file-system call in turn, and each call fails in turn for four
reasons (`helpers/torn_writes.py`), with folders exchanged in one step and with two renames. Kills: the real command is
killed at random moments. Interrupts: Ctrl-C and SIGTERM at random moments of commands with two processes; counted
are those that end with status 130 and one sentence and leave nothing, and how long the slowest took. A few of each
are in `make test-all`.
"""

# ruff: noqa: E402 - the folder of the tests has to be on the path first

import argparse
import collections
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "helpers"), str(TESTS.parent)]

from repository import SAMPLE_RUNS
from struck_commands import SENTENCE, KilledCommand, start, strike


def steps() -> dict[str, dict[str, int]]:
    """Every step killed and failing in turn."""
    found = {}
    for what in ("kill", "fault"):
        for how in ("exchange", "rename"):
            with tempfile.TemporaryDirectory() as folder:
                made = subprocess.run(
                    [sys.executable, str(TESTS / "helpers" / "torn_writes.py"), folder, what, how],
                    capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": str(TESTS.parent)},
                )  # fmt: skip
            found[f"{what}, {how}"] = json.loads(made.stdout)
            print(f"each step, {what}, {how}: {found[f'{what}, {how}']}", flush=True)
    return found


def kills(times: int, seed: int) -> dict[str, int]:
    """The real command killed at random moments; raises AssertionError for torn results."""
    with tempfile.TemporaryDirectory() as folder:
        killed = KilledCommand(Path(folder), seed)
        counts = collections.Counter(killed.kill() for _ in range(times))
        killed.next_run()
    print(f"the command killed: {times} times, {dict(counts)} results whole afterwards, 0 torn", flush=True)
    return dict(counts)


def interrupts(times: int, seed: int) -> list[dict[str, object]]:
    """Commands with two processes interrupted at random moments."""
    chance, found = random.Random(seed), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hidden = str(SAMPLE_RUNS / "hidden_one")
        start(["fit-yaw", hidden, "--fit-to", "whole-runs", "-o", "model"], folder).communicate()
        model = ["--model", "model/yaw_model.json"]
        commands = [
            ["fit-yaw", str(SAMPLE_RUNS / "steps")],
            ["validate", hidden, *model],
            ["diagnose", hidden, *model],
            ["simulate", str(SAMPLE_RUNS / "campaign.toml")],
        ]
        for number in range(times):
            command = [*commands[number % len(commands)], "-o", "out", "--overwrite", "--jobs", "2"]
            how = chance.choice([signal.SIGINT, signal.SIGTERM])
            after = chance.uniform(0.05, {"diagnose": 20.0, "simulate": 0.6}.get(command[0], 4.0))
            end = strike(command, folder, after, how)
            left = sorted(path.name for path in folder.iterdir() if path.name.startswith("."))
            orderly = end.status == 0 or (end.status, end.said) == (130, SENTENCE)
            entry = {"command": command[0], "signal": how.name, "after_s": round(after, 2), "status": end.status,
                     "took_s": round(end.took_s, 2), "orderly": orderly and not left, "said": end.said}  # fmt: skip
            found.append(entry)
            if not entry["orderly"] or end.took_s > 1.0:
                print(entry, flush=True)
    struck = [entry for entry in found if entry["status"] != 0]
    slowest = max((float(str(entry["took_s"])) for entry in struck), default=0.0)
    orderly = sum(bool(entry["orderly"]) for entry in struck)
    print(f"interrupted: {len(struck)} of {times} before the end; {orderly} orderly, the slowest took {slowest} s")
    return found


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--interrupts", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="write the counts into this JSON file")
    options = parser.parse_args()
    begun = time.monotonic()
    found = {
        "steps": steps(),
        "kills": kills(options.kills, options.seed),
        "interrupts": interrupts(options.interrupts, options.seed),
    }
    print(f"({time.monotonic() - begun:.0f} s)")
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
