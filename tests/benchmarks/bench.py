"""`make bench`: accuracy against the Cramer-Rao bound, coverage of intervals, speed. Prints tables and writes
out/bench.json.

Usage: python tests/benchmarks/bench.py [efficiency] [coverage] [thrusters] [effects] [planning] [tails] [sensors]
       [commands] [simulator] [fit] [reading] [memory]
       [--jobs N] [--campaigns N] [--repeats N] [--full]
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy, and for the processes: each has one core

import argparse
import json
import sys
import time
from pathlib import Path

from commands import commands
from coverage_effects import effect_coverage
from coverage_thrusters import thruster_coverage
from efficiency import efficiency
from interval_coverage import coverage
from planning import planning
from reading import memory, reading
from sensors import sensors
from speed import Result, fit, simulator
from tails import tails

from automarine_cli.commands.terminal import terminal_progress
from automarine_cli.pipeline.parallel import Progress

CAMPAIGNS = {
    "efficiency": 200,
    "coverage": 300,
    "thrusters": 300,
    "effects": 40,
    "planning": 50,
    "tails": 400,
    "sensors": 200,
}
SECTIONS = (
    *CAMPAIGNS, "commands", "simulator", "fit", "reading", "memory",
)  # fmt: skip


def run_section(name: str, jobs: int, campaigns: int | None, repeats: int, full: bool, progress: Progress) -> Result:
    """Tables and plain results of one section."""
    if name in CAMPAIGNS:
        measures = (efficiency, coverage, thruster_coverage, effect_coverage, planning, tails, sensors)
        measure = dict(zip(CAMPAIGNS, measures))[name]
        return measure(campaigns or CAMPAIGNS[name], jobs, progress)
    if name == "reading":
        return reading(repeats, full, progress)
    if name == "memory":
        return memory(full, progress)
    if name == "commands":
        return commands(min(repeats, 3), progress)
    return {"simulator": simulator, "fit": fit}[name](3 * repeats, progress)


def main() -> None:
    """Run the sections asked for, by default all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of {', '.join(SECTIONS)}; default: all")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="processes (default: 2)")
    parser.add_argument(
        "--campaigns",
        type=int,
        help="simulated campaigns a case, instead of 200, 300, 40 (effects), 50 (planning) or 200 (sensors)",
    )
    parser.add_argument("--repeats", type=int, default=5, help="of which the median counts (default: 5)")
    parser.add_argument(
        "--full", action="store_true", help="read 1 GB of CSV, 20,000 files, 100 million samples (needs 5 GB of disk)"
    )
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"), help="default: out/bench.json")
    options = parser.parse_args()
    if unknown := [name for name in options.sections if name not in SECTIONS]:
        parser.error(f"no section {unknown[0]!r}; there are {', '.join(SECTIONS)}")
    results = json.loads(options.out.read_text()) if options.out.exists() and options.sections else {}
    for name in options.sections or SECTIONS:
        begun = time.perf_counter()
        tables, results[name] = run_section(
            name, options.jobs, options.campaigns, options.repeats, options.full, terminal_progress()
        )
        for table in tables:
            print(table.to_text())
        print(f"({name}: {time.perf_counter() - begun:.0f} s)\n", flush=True)
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(results, indent=1, default=float) + "\n")
    print(f"Results are in {options.out}", file=sys.stderr)
    if outside := [name for section in results.values() for name in section.get("outside", ())]:
        sys.exit(f"Slower or faster than expected: {', '.join(outside)}")


if __name__ == "__main__":
    main()
