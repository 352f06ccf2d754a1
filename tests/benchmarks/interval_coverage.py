"""Coverage: how often 95 % intervals hold the truth, for both estimators of a yaw model.

Usage: python tests/benchmarks/interval_coverage.py [--effects | --thrusters] [--campaigns N] [--jobs N]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, and for the processes: each has one core

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from campaigns import INERTIA, K_RR, LARGE, MEDIUM, make_campaign
from numpy.typing import NDArray
from scipy import stats

from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.half_turns import half_turn_data
from automarine_cli.fits.known import Known
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.whole_runs import fit_half_turns
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns

Floats = NDArray[np.float64]

STREAM = 2
LAYOUTS = {"48 runs": LARGE, "24 runs": MEDIUM}
SCATTERS = (0.0, 0.03, 0.05, 0.18)
TRUTH = {"1": (1.2, 0.0), "2": (0.4, 0.9), "3": (0.0, K_RR)}
"""(k_r, k_rr) of the vehicle of each model."""

LOW, HIGH = 0.92, 0.98
UNSCORED = ("ML offset", "ML gain scatter")
"""Reported, not judged: at a bound of their range when there is no offset or no scatter."""


@dataclass(frozen=True)
class Case:
    """A layout of runs, the true model, the noise of the heading [degrees] and the scatter of the runs' gains."""

    layout: str
    model: str
    noise: float
    scatter: float

    @property
    def table(self) -> str:
        """What the cases of one table have in common."""
        return f"model {self.model}, {self.layout}, {self.noise:g} degrees of noise"


CASES = tuple(
    Case(layout, model, noise, scatter)
    for layout in LAYOUTS
    for model, noise, scatters in (
        ("3", 1.0, SCATTERS),
        ("3", 0.5, SCATTERS[:2]),
        ("3", 2.0, SCATTERS[:2]),
        ("1", 1.0, SCATTERS),
        ("2", 1.0, SCATTERS),
    )
    for scatter in scatters
)


@dataclass(frozen=True)
class Outcome:
    """One interval: error and standard error over the truth's size, and whether the interval holds the truth."""

    error: float
    stderr: float
    holds: bool

    @classmethod
    def of(cls, estimate: Estimate, truth: float) -> "Outcome":
        """Of an estimate whose truth is known."""
        size, (low, high) = abs(truth) or 1.0, estimate.ci95
        return cls((estimate.value - truth) / size, estimate.stderr / size, low <= truth <= high)


@dataclass(frozen=True)
class Trial:
    """Every interval of one campaign by name, and whether the fit converged; no intervals where a fit `refused` the
    campaign with that sentence."""

    intervals: dict[str, Outcome]
    converged: bool = True
    refused: str = ""


def run_trial(item: tuple[int, Case]) -> Trial:
    """Simulate one campaign and compare every interval with the truth."""
    index, case = item
    k_r, k_rr = TRUTH[case.model]
    layout = list(LAYOUTS).index(case.layout)
    key = [STREAM, layout, int(case.model), round(1000 * case.scatter), round(1000 * case.noise), index]
    campaign = make_campaign(
        key, LAYOUTS[case.layout], k_r=k_r, k_rr=k_rr, scatter=case.scatter, noise=np.deg2rad(case.noise)
    )
    turns, _ = half_turns(campaign.runs)
    data = half_turn_data(turns)
    truth = {"I_r": INERTIA, "k_rr": k_rr, "k_r": k_r}
    try:
        rough = fit_velocity_error(data, np.zeros(len(data.moment)))
    except FitError as refusal:
        return Trial({}, refused=str(refusal))
    # the start is that of `fits.identify`
    drag = rough.drag["1"].drag[0]
    begin = (rough.inertia["3"].overall.value, drag if case.model == "1" else 0.02 * drag, rough.drag["3"].drag[1])
    fit = fit_half_turns(data, case.model, begin, "nu", Known())
    out = {f"ML {name}": Outcome.of(estimate, truth[name]) for name, estimate in fit.estimates.items()}
    if fit.inertial_turn_angle is not None:
        out["ML I/k"] = Outcome.of(fit.inertial_turn_angle, INERTIA / k_rr)
    out["ML offset"] = Outcome.of(fit.offset, 0.0)
    out["ML gain scatter"] = Outcome.of(fit.gain_scatter, case.scatter)
    for name, estimate in rough.drag[case.model].estimates.items():
        out[f"Table 1 {name}"] = Outcome.of(estimate, truth[name])
    if case.model in rough.inertia:
        out["Table 2 I_r"] = Outcome.of(rough.inertia[case.model].overall, INERTIA)
    return Trial(out, fit.mixed.converged)


def coverage(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns a case."""
    work = [(index, case) for case in CASES for index in range(count)]
    found = ordered_map(run_trial, work, jobs, progress=progress, stage="coverage")
    tables, results, outside, remarks = [], [], [], []
    for name in dict.fromkeys(case.table for case in CASES):
        cases = [case for case in CASES if case.table == name]
        rows: list[tuple[str, ...]] = []
        rules: list[int] = []
        for case in cases:
            trials = [one for (_, other), one in zip(work, found) if other == case]
            summary = summarise(trials)
            rules += [len(rows)] if rows else []
            rows += [(f"{case.scatter:.0%}", *row) for row in summary_rows(summary)]
            where = f"{name}, {case.scatter:.0%} scatter"
            remarks += failures(trials, where)
            outside += misses(summary, where, lambda one: one.startswith("ML") and one not in UNSCORED)
            results.append({"case": name, "scatter": case.scatter, "intervals": summary})
        title = f"Coverage of 95 % intervals, {name}, {count} campaigns"
        tables.append(Table(title, ("scatter", *HEADER), tuple(rows), tuple(rules)))
    verdict = (
        f"Maximum-likelihood intervals outside 92 to 98 %: {'; '.join(outside)}."
        if outside
        else "All maximum-likelihood intervals of I_r, k_rr, k_r, I/k are within 92 to 98 %."
    )
    last = tables.pop()
    tables.append(Table(last.title, last.header, last.rows, last.rules, (verdict, *remarks)))
    return tables, {"campaigns": count, "cases": results}


HEADER = ("interval", "coverage %", "95 % interval of it", "bias %", "sd %", "stderr/sd", "campaigns")


def summarise(trials: Sequence[Trial]) -> dict[str, dict[str, Any]]:
    """By interval: coverage with its exact binomial interval (Clopper and Pearson 1934, Biometrika 26:404), relative
    bias and spread, and root mean square standard error over the spread."""
    names = dict.fromkeys(name for trial in trials for name in trial.intervals)
    summary = {}
    for name in names:
        outcomes = [trial.intervals[name] for trial in trials if name in trial.intervals]
        held, count = sum(one.holds for one in outcomes), len(outcomes)
        errors, stderrs = np.array([(one.error, one.stderr) for one in outcomes]).T
        spread = float(errors.std(ddof=1)) if count > 1 else float("nan")
        exact = stats.binomtest(held, count).proportion_ci(method="exact")
        summary[name] = {
            "coverage": held / count,
            "ci95": [float(exact.low), float(exact.high)],
            "bias": float(errors.mean()),
            "sd": spread,
            "stderr_over_sd": float(np.sqrt(np.mean(stderrs**2))) / spread if spread > 0 else None,
            "campaigns": count,
        }
    return summary


def summary_rows(summary: dict[str, dict[str, Any]]) -> list[tuple[str, ...]]:
    """Cells under HEADER, a row an interval."""
    return [
        (
            name,
            f"{100 * entry['coverage']:.1f}",
            f"{100 * entry['ci95'][0]:.1f} to {100 * entry['ci95'][1]:.1f}",
            f"{100 * entry['bias']:.2f}",
            f"{100 * entry['sd']:.2f}",
            "–" if entry["stderr_over_sd"] is None else f"{entry['stderr_over_sd']:.2f}",
            f"{entry['campaigns']}",
        )
        for name, entry in summary.items()
    ]


def failures(trials: Sequence[Trial], where: str) -> list[str]:
    """Sentences on campaigns that were refused or whose fit did not converge."""
    found = []
    if refused := [trial.refused for trial in trials if trial.refused]:
        found.append(f"Refused: {len(refused)} ({where}): {refused[0]}.")
    if astray := sum(not trial.converged for trial in trials):
        found.append(f"Did not converge: {astray} ({where}).")
    return found


def misses(summary: dict[str, dict[str, Any]], where: str, judged: Any = lambda name: True) -> list[str]:
    """The intervals whose coverage is outside LOW to HIGH."""
    return [
        f"{entry['coverage']:.1%} of {name} ({where})"
        for name, entry in summary.items()
        if judged(name) and not LOW <= entry["coverage"] <= HIGH
    ]


def main() -> None:
    """Run the part asked for and print its tables."""
    from coverage_effects import effect_coverage
    from coverage_thrusters import thruster_coverage

    from automarine_cli.commands.terminal import terminal_progress

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--effects", action="store_true", help="sizes of effects planted in whole runs")
    part.add_argument("--thrusters", action="store_true", help="coefficients of the thruster map")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--campaigns", type=int, default=300, help="simulated campaigns a case (default: 300)")
    options = parser.parse_args()
    measure = effect_coverage if options.effects else thruster_coverage if options.thrusters else coverage
    tables, _ = measure(options.campaigns, options.jobs, terminal_progress())
    for table in tables:
        print(table.to_text())


if __name__ == "__main__":
    main()
