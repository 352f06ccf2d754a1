"""Coverage: how often 95 % intervals hold the truth, for both estimators, and what is wrong where they do not."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from campaigns import INERTIA, K_RR, LARGE, SMALL, make_campaign
from numpy.typing import NDArray
from scipy import stats

from automarine_cli.errors import FitError
from automarine_cli.fits.estimate import Estimate
from automarine_cli.fits.output_error import OutputErrorFit, fit_half_turns
from automarine_cli.fits.step_response import Known, half_turn_data
from automarine_cli.fits.velocity_error import fit_velocity_error
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns

Floats = NDArray[np.float64]

STREAM = 2
LAYOUTS = {"48 runs": LARGE, "12 runs": SMALL}
SCATTERS = (0.0, 0.03, 0.05, 0.18)
TRUE_K_R = {"2": 0.05, "3": 0.0}
LOW, HIGH = 0.92, 0.98


@dataclass(frozen=True)
class Case:
    """A layout of runs, the true model, and the scatter of the runs' gains."""

    layout: str
    model: str
    scatter: float


@dataclass(frozen=True)
class Outcome:
    """One interval: error and standard error over the truth's size, whether the interval holds the truth, and
    whether one formed with the likelihood's covariance would (None where there is none)."""

    error: float
    stderr: float
    holds: bool
    by_likelihood: bool | None


@dataclass(frozen=True)
class Trial:
    """Every interval of one campaign by name, and whether the maximum-likelihood fit converged; no intervals where
    the paper's method, from which it starts, `refused` the campaign with that sentence."""

    intervals: dict[str, Outcome]
    converged: bool = False
    refused: str = ""


def run_trial(item: tuple[int, Case]) -> Trial:
    """Simulate one campaign and compare every interval with the truth."""
    index, case = item
    k_r = TRUE_K_R[case.model]
    key = [STREAM, list(LAYOUTS).index(case.layout), int(case.model), round(1000 * case.scatter), index]
    campaign = make_campaign(key, LAYOUTS[case.layout], k_r=k_r, scatter=case.scatter)
    turns, _ = half_turns(campaign.runs)
    data = half_turn_data(turns)
    truth = {"I_r": INERTIA, "k_rr": K_RR, "k_r": k_r}
    try:
        rough = fit_velocity_error(data, np.zeros(len(data.moment)))
    except FitError as refusal:
        return Trial({}, refused=str(refusal))
    # the start is that of `fits.identify`
    start = (rough.inertia["3"].overall.value, 0.02 * rough.drag["1"].drag[0], rough.drag["3"].drag[1])
    fit = fit_half_turns(data, case.model, start, "nu", Known())
    out = {
        f"ML {name}": _outcome(estimate, truth[name], _by_likelihood(fit, i, truth[name]))
        for i, (name, estimate) in enumerate(fit.estimates.items())
    }
    if fit.inertial_turn_angle is not None:
        out["ML I/k"] = _outcome(fit.inertial_turn_angle, INERTIA / K_RR, None)
    out["ML offset"] = _outcome(fit.offset, 0.0, None)
    out["ML gain scatter"] = _outcome(fit.gain_scatter, case.scatter, None)
    for name, estimate in rough.drag[case.model].estimates.items():
        out[f"Table 1 {name}"] = _outcome(estimate, truth[name], None)
    out["Table 2 I_r"] = _outcome(rough.inertia[case.model].overall, INERTIA, None)
    return Trial(out, fit.mixed.converged)


def _outcome(estimate: Estimate, truth: float, by_likelihood: bool | None) -> Outcome:
    size = truth or 1.0
    low, high = estimate.ci95
    return Outcome(
        (estimate.value - truth) / size, estimate.stderr / size, low <= truth <= high, by_likelihood
    )


def _by_likelihood(fit: OutputErrorFit, i: int, truth: float) -> bool:
    """Whether an interval from the likelihood's covariance, with the same degrees of freedom, holds the truth."""
    mixed = fit.mixed
    half = stats.t.ppf(0.975, len(mixed.left_out) - 1) * np.sqrt(mixed.covariance[i, i])
    target = np.log(truth) if mixed.positive[i] else truth
    return bool(abs(mixed.phi[i] - target) <= half)


def coverage(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns a case."""
    cases = [Case(*one) for one in itertools.product(LAYOUTS, ("3", "2"), SCATTERS)]
    work = [(index, case) for case in cases for index in range(count)]
    found = ordered_map(run_trial, work, jobs, progress=progress, stage="coverage")
    tables: list[Table] = []
    results: list[dict[str, Any]] = []
    remarks: list[str] = []
    for layout, model in itertools.product(LAYOUTS, ("3", "2")):
        rows = []
        for scatter in SCATTERS:
            case = Case(layout, model, scatter)
            where = f"{layout}, model {model}, {scatter:.0%} scatter"
            trials = [one for (_, other), one in zip(work, found) if other == case]
            fitted = [one for one in trials if not one.refused]
            if len(fitted) < count:
                sentence = next(one.refused for one in trials if one.refused)
                remarks.append(f"Refused by the paper's method: {count - len(fitted)} ({where}): {sentence}.")
            if astray := sum(not one.converged for one in fitted):
                remarks.append(f"Maximum likelihood did not converge: {astray} ({where}).")
            summary = {
                name: summarise([one.intervals[name] for one in fitted]) for name in fitted[0].intervals
            }
            rows += [(f"{scatter:.0%}", name, *_cells(entry)) for name, entry in summary.items()]
            results.append({"layout": layout, "model": model, "scatter": scatter,
                            "fitted": len(fitted), "intervals": summary})  # fmt: skip
        header = ("scatter", "interval", "coverage %", "bias %", "sd %", "stderr/sd", "by likelihood %")
        truth = ", truth k_r = 0.05" if model == "2" else ""
        each = len(rows) // len(SCATTERS)
        rules = tuple(range(each, len(rows), each))
        title = (
            f"Coverage of 95 % intervals, model {model}{truth}, {layout}, nothing known, {count} campaigns"
        )
        tables.append(Table(title, header, tuple(rows), rules))
    worst = sqrt_error(count)
    note = f"Wanted: 92 to 98 %. Monte-Carlo error of a coverage of 95 %: ±{100 * worst:.1f} %."
    outside = [
        f"{entry['coverage']:.1%} of {name} ({result['layout']}, model {result['model']}, "
        f"{result['scatter']:.0%} scatter)"
        for result in results
        for name, entry in result["intervals"].items()
        if name.startswith("ML") and name not in UNSCORED and not LOW <= entry["coverage"] <= HIGH
    ]
    verdict = "All maximum-likelihood intervals of I_r, k_rr, k_r, I/k are within 92 to 98 %."
    if outside:
        verdict = f"Maximum-likelihood intervals outside: {'; '.join(outside)}."
    notes = (note, verdict, *remarks)
    last = tables.pop()
    tables.append(Table(last.title, last.header, last.rows, last.rules, notes))
    return tables, {"campaigns": count, "cases": results}


UNSCORED = ("ML offset", "ML gain scatter")


def sqrt_error(count: int) -> float:
    """Monte-Carlo standard error of a coverage of 95 %."""
    return float(np.sqrt(0.95 * 0.05 / count))


def summarise(outcomes: list[Outcome]) -> dict[str, Any]:
    """Coverage, relative bias and spread, and root mean square standard error over the spread."""
    errors = np.array([one.error for one in outcomes])
    stderrs = np.array([one.stderr for one in outcomes])
    other = [one.by_likelihood for one in outcomes if one.by_likelihood is not None]
    return {
        "coverage": float(np.mean([one.holds for one in outcomes])),
        "bias": float(errors.mean()),
        "sd": float(errors.std(ddof=1)),
        "stderr_over_sd": float(np.sqrt(np.mean(stderrs**2)) / errors.std(ddof=1)),
        "by_likelihood": float(np.mean(other)) if other else None,
    }


def _cells(entry: dict[str, Any]) -> tuple[str, ...]:
    digits = (1, 2, 2)
    first = [f"{100 * entry[name]:.{d}f}" for name, d in zip(("coverage", "bias", "sd"), digits)]
    other = entry["by_likelihood"]
    return (*first, f"{entry['stderr_over_sd']:.2f}", "–" if other is None else f"{100 * other:.1f}")
