"""`make bench`: accuracy against the Cramer-Rao bound, coverage of intervals, speed.

Prints tables and writes out/bench.json. Sections (default: all): efficiency, coverage, thrusters, effects (simulated
campaigns, by default 200, 300, 300 and 40 a case), commands (medians of --repeats).

Usage: python tests/benchmarks/bench.py [SECTION ...] [--jobs N] [--campaigns N] [--repeats N] [--out FILE]
"""

import json
import sys
import time
from pathlib import Path

import arguments
from efficiency import efficiency
from interval_coverage import coverage
from speed import commands

from automarine_cli.commands.terminal import terminal_progress

CAMPAIGNS = {"efficiency": 200, "coverage": 300, "thrusters": 300, "effects": 40}
SECTIONS = (*CAMPAIGNS, "commands")


def main() -> None:
    sections = {"nargs": "*", "metavar": "SECTION", "help": f"of {', '.join(SECTIONS)}; default: all"}
    chosen = arguments.options(
        __doc__, {"sections": sections}, jobs=2, campaigns=0, repeats=3, out=Path("out/bench.json")
    )
    if unknown := [name for name in chosen.sections if name not in SECTIONS]:
        sys.exit(f"no section {unknown[0]!r}; there are {', '.join(SECTIONS)}")
    results = json.loads(chosen.out.read_text()) if chosen.out.exists() and chosen.sections else {}
    for name in chosen.sections or SECTIONS:
        begun, progress = time.perf_counter(), terminal_progress()
        count = chosen.campaigns or CAMPAIGNS.get(name, 0)
        tables, results[name] = (
            commands(chosen.repeats, progress) if name == "commands"
            else efficiency(count, chosen.jobs, progress) if name == "efficiency"
            else coverage(name, count, chosen.jobs, progress)
        )  # fmt: skip
        for table in tables:
            print(table.to_text())
        print(f"({name}: {time.perf_counter() - begun:.0f} s)\n", flush=True)
        arguments.write_json(chosen.out, results)
    print(f"Results are in {chosen.out}", file=sys.stderr)
    if outside := [name for section in results.values() for name in section.get("outside", ())]:
        sys.exit(f"Slower or faster than expected: {', '.join(outside)}")


if __name__ == "__main__":
    main()
