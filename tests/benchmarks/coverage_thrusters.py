"""Coverage of the intervals of the thruster map: coefficients of equation 2 forward and backward, from bollard tests
fitted by the tool's own workflow."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from interval_coverage import HEADER, Outcome, Trial, failures, misses, summarise, summary_rows

from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table

STREAM = 3
AHEAD, ASTERN = 2.6165e-4, 0.6640e-4  # N per count squared: equation 3 for two thrusters, halved
TOP = 150.0  # counts


@dataclass(frozen=True)
class Case:
    """Levels a direction, records (times that all levels are run through), noise of a reading in per cent of full scale
    ahead, scatter of the gain from reading to reading, and of each record's own gain."""

    levels: int
    records: int
    noise: float
    scatter: float
    drift: float = 0.0

    def __str__(self) -> str:
        text = f"{self.levels} levels, {self.noise:g} % noise, {self.scatter:.0%} scatter"
        if self.records > 1:
            text += f", {self.records} records, {self.drift:.0%} between them"
        return text


SCATTERS = (0.0, 0.03, 0.05, 0.18)
CASES = (
    *(Case(15, 1, 0.5, scatter) for scatter in SCATTERS),
    *(Case(8, 1, 2.0, scatter) for scatter in SCATTERS),
    Case(15, 4, 0.5, 0.03, 0.05),
)


def run_trial(item: tuple[int, Case]) -> Trial:
    """Simulate one bollard test, fit it, and compare both intervals with the truth."""
    index, case = item
    random = np.random.default_rng(
        [STREAM, case.levels, case.records, *(round(1000 * x) for x in (case.noise, case.scatter, case.drift)), index]
    )
    steps = np.linspace(TOP / case.levels, TOP, case.levels)
    with tempfile.TemporaryDirectory() as folder:
        for record in range(case.records):
            n = random.permutation(np.concatenate([-steps, steps]))
            logs = case.scatter * random.standard_normal(len(n)) + case.drift * random.standard_normal()
            gain = np.exp(logs - 0.5 * (case.scatter**2 + case.drift**2))  # of mean one
            force = gain * np.where(n > 0, AHEAD, ASTERN) * np.abs(n) * n
            force += 0.01 * case.noise * AHEAD * TOP**2 * random.standard_normal(len(n))
            rows = "".join(f"{a:.6f},{b:.9f}\n" for a, b in zip(n, force))
            Path(folder, f"record_{record}.csv").write_text("n,force_N\n" + rows)
        try:
            # equation 2 and its intervals do not depend on the form chosen, and choosing one takes the time
            found = fit_thrusters([folder], form="square").analysis.square
        except AutomarineError as refusal:
            return Trial({}, refused=str(refusal))
    truth = {"forward": AHEAD, "backward": ASTERN}
    return Trial({f"a, {side}": Outcome.of(estimate, truth[side]) for side, estimate in found.items()})


def thruster_coverage(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Table and plain results of `count` bollard tests a case."""
    work = [(index, case) for case in CASES for index in range(count)]
    found = ordered_map(run_trial, work, jobs, progress=progress, stage="thrusters")
    rows: list[tuple[str, ...]] = []
    results, outside, remarks = [], [], []
    for i, case in enumerate(CASES):
        trials = found[i * count : (i + 1) * count]
        summary = summarise(trials)
        rows += [(str(case), *row) for row in summary_rows(summary)]
        outside += misses(summary, str(case))
        remarks += failures(trials, str(case))
        results.append({"case": str(case), "intervals": summary})
    verdict = f"Outside 92 to 98 %: {'; '.join(outside)}." if outside else "All are within 92 to 98 %."
    title = f"Coverage of 95 % intervals, thruster coefficients, {count} bollard tests"
    table = Table(title, ("bollard test", *HEADER), tuple(rows), (), (verdict, *remarks))
    return [table], {"campaigns": count, "cases": results}
