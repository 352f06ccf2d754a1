"""Coverage of driven runs: how often the 95 % intervals of inertia and drag hold the truth of campaigns that a heading
controller steers in disturbed water, by the estimator that the fit prefers.

Disturbances are 10 and 30 % of the largest command, compasses white or smoothed by their own filter. The runs come from
equations of their own (tests/helpers/made_driven.py).

Usage: python tests/benchmarks/driven_coverage.py [--campaigns N] [--jobs N]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, and for the processes: each has one core

import argparse
from dataclasses import replace

import numpy as np
from interval_coverage import HEADER, Outcome, Trial, summarise, summary_rows
from made_driven import Sea, steered

from automarine_cli.errors import FitError
from automarine_cli.filters.course import make_course
from automarine_cli.fits.driven import beside_forecasts, fit_driven, widened
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

RUNS, LENGTH = 5, 40.0
SEAS = {"10 %": 0.1, "30 %": 0.3}
SMOOTHING = 3  # samples, of a compass that filters


def smooth(run: Run) -> Run:
    """The run as a compass shows it that averages its last readings."""
    shown = np.cumsum(np.pad(run.position, (SMOOTHING, 0), mode="edge"))
    return replace(run, position=(shown[SMOOTHING:] - shown[:-SMOOTHING]) / SMOOTHING)


def trial(index: int) -> Trial:
    """Fit one campaign: by turns a size of disturbance, every other pair with a compass that smooths."""
    sea = Sea(size=list(SEAS.values())[index % 2])
    runs = steered(RUNS, 1000 + index, sea, length=LENGTH)
    if index % 4 >= 2:
        runs = [smooth(run) for run in runs]
    course, batch = make_course(runs, np.ones(RUNS, dtype=bool)), make_batch(runs, 0.1)
    try:
        fit, proposed = widened(course, beside_forecasts(course, fit_driven(course, rough_model("3", batch), "3")))
    except FitError as refusal:
        return Trial({}, refused=str(refusal))
    by = "least squares" if fit.estimator.startswith("by least") else "innovations"
    kind = f"{list(SEAS)[index % 2]}, {'smoothed' if index % 4 >= 2 else 'white'}"
    found = {"I_r": Outcome.of(fit.estimates["I_r"], sea.inertia), "k_rr": Outcome.of(fit.estimates["k_rr"], sea.k_rr)}
    kind += ", widened" if proposed else ""
    split = {f"{name}, {kind}": one for name, one in found.items()}
    return Trial({**found, **split, **{f"{name}, by {by}": one for name, one in found.items()}}, fit.mixed.converged)


def main() -> None:
    """All campaigns, then the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--campaigns", type=int, default=40, help="simulated campaigns (default: 40)")
    options = parser.parse_args()
    trials = ordered_map(trial, list(range(options.campaigns)), options.jobs)
    rows = tuple(summary_rows(summarise(trials)))
    refused = sum(bool(one.refused) for one in trials)
    note = (f"{refused} campaigns refused.",)
    print(Table("Coverage of 95 % intervals, driven runs", HEADER, rows, notes=note).to_text())


if __name__ == "__main__":
    main()
