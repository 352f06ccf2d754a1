"""Tables 1 and 2 by the paper's method: errors and coverage over campaigns of 72 runs, and where the tails start.

Usage: python tests/benchmarks/tails.py [--campaigns N] [--jobs N]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, and for the processes: each has one core

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from campaigns import BOTH_SIDES, INERTIA, make_campaign
from interval_coverage import HEADER, LOW, Outcome, misses, summarise, summary_rows
from interval_coverage import Trial as Intervals

from automarine_cli.fits.half_turns import half_turn_data
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns

STREAM = 9
RUNS = 3 * BOTH_SIDES
K_RR = 1.240
SCATTERS = (0.0, 0.03, 0.05)
FIRST = 10
"""Campaigns of which every one is judged."""

DRAG, LINEAR, INERTIA_3 = "k_rr of model 3", "k_r of model 2", "I_r of model 3"
PLAIN = "k_r of model 2, plain least squares"
ALLOWED = {DRAG: 0.02, INERTIA_3: 0.05}


@dataclass(frozen=True)
class Trial:
    """One campaign: its intervals, where its tails start [degrees], k_r of model 2 with nothing taken off."""

    intervals: Intervals
    tail_from: float
    plain: float


def run_trial(item: tuple[int, float]) -> Trial:
    """Simulate one campaign and put it through the paper's method."""
    index, scatter = item
    campaign = make_campaign([STREAM, round(1000 * scatter), index], RUNS, k_rr=K_RR, scatter=scatter)
    data = half_turn_data(half_turns(campaign.runs)[0])
    fit = fit_velocity_error(data, np.zeros(len(data.moment)))
    two = fit.drag["2"]
    found = {
        DRAG: Outcome.of(fit.drag["3"].estimates["k_rr"], K_RR),
        LINEAR: Outcome.of(two.estimates["k_r"], 0.0),
        INERTIA_3: Outcome.of(fit.inertia["3"].overall, INERTIA),
        "k_rr of model 2": Outcome.of(two.estimates["k_rr"], K_RR),
        "I_r of model 2": Outcome.of(fit.inertia["2"].overall, INERTIA),
    }
    plain = two.drag[0] - two.dilution["k_r"]
    return Trial(Intervals(found), float(np.degrees(fit.tail_from)), plain)


def tails(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns at each scatter."""
    work = [(index, scatter) for scatter in SCATTERS for index in range(count)]
    trials = ordered_map(run_trial, work, jobs, progress=progress, stage="tails")
    rows: list[tuple[str, ...]] = []
    rules: list[int] = []
    outside: list[str] = []
    notes, results = [], []
    for scatter in SCATTERS:
        these = [trial for (_, other), trial in zip(work, trials) if other == scatter]
        summary = summarise([trial.intervals for trial in these])
        rules += [len(rows)] if rows else []
        rows += [(f"{scatter:.0%}", *row) for row in summary_rows(summary)]
        outside += misses(summary, f"{scatter:.0%} scatter")
        worst = {name: max(abs(one.intervals.intervals[name].error) for one in these[:FIRST]) for name in ALLOWED}
        starts = [one.tail_from for one in these]
        plain = float(np.mean([one.plain for one in these]))
        told = ", ".join(
            f"{name} {100 * worst[name]:.2f} % ({'within' if worst[name] <= ALLOWED[name] else 'BEYOND'} "
            f"{100 * ALLOWED[name]:.0f} %)"
            for name in ALLOWED
        )
        notes.append(
            f"{scatter:.0%} scatter: tails from {np.median(starts):.0f} degrees ({min(starts):.0f} to "
            f"{max(starts):.0f}); worst of the first {FIRST} campaigns: {told}; {PLAIN}: {plain:+.4f} on average."
        )
        results.append(
            {"scatter": scatter, "intervals": summary, "worst": worst, "tail_from": starts, "plain_k_r": plain}
        )
    notes.append(
        f"Intervals outside {LOW:.0%} to 98 %: {'; '.join(outside) or 'none'}. "
        "k_r of model 2 is in hundredths of a nu s, all others in percent."
    )
    title = f"The paper's method over {count} campaigns of {len(RUNS)} runs: 10 Hz, 1 degree"
    table = Table(title, ("scatter", *HEADER), tuple(rows), tuple(rules), tuple(notes))
    return [table], {"campaigns": count, "cases": results}


def main() -> None:
    from automarine_cli.commands.terminal import terminal_progress

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--campaigns", type=int, default=400, help="campaigns a scatter (default: 400)")
    options = parser.parse_args()
    for table in tails(options.campaigns, options.jobs, terminal_progress())[0]:
        print(table.to_text())


if __name__ == "__main__":
    main()
