"""Efficiency: the Cramer-Rao bound over the mean square error of inertia and drag, for both estimators."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from bounds import bound, fisher_information
from campaigns import INERTIA, K_RR, NOISE, PERIOD, known_half_turns, make_campaign
from numpy.typing import NDArray

from automarine_cli.fits.half_turns import StepData, half_turn_data
from automarine_cli.fits.known import Known
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.whole_runs import OutputErrorFit, fit_half_turns
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns

Floats = NDArray[np.float64]

TRUTH = (INERTIA, K_RR)
WANTED = 0.9
STREAM = 1

ALL_KNOWN = "ML, start heading, instant and equal gains known"
SCATTER_FREE = "ML, start heading and instant known"
NOTHING_KNOWN = "ML, nothing known"
SEED_METHOD = "paper's method, start heading and instant known"
SEED_UNKNOWN = "paper's method, nothing known"
ESTIMATORS = (ALL_KNOWN, SCATTER_FREE, NOTHING_KNOWN, SEED_METHOD, SEED_UNKNOWN)

BOUND_KNOWN = "start heading and instant known"
BOUND_UNIFORM = "nothing known; each instant uniform in its sample interval"
BOUND_NORMAL = "as the last, but normal with equal variance"
BOUND_OFFSET = "uniform, with the intervals' common offset unknown as well"
BOUNDS = (BOUND_KNOWN, BOUND_UNIFORM, BOUND_NORMAL, BOUND_OFFSET)
OWN_BOUND = dict(zip(ESTIMATORS, (BOUND_KNOWN, BOUND_KNOWN, BOUND_UNIFORM, BOUND_KNOWN, BOUND_UNIFORM), strict=True))


@dataclass(frozen=True)
class Trial:
    """One simulated campaign: relative errors of (I, k) and relative variance bounds, by name."""

    errors: dict[str, Floats]
    bounds: dict[str, Floats]
    converged: bool


def run_trial(index: int) -> Trial:
    """Simulate the campaign of that number and fit it every way."""
    campaign = make_campaign([STREAM, index])
    known = known_half_turns(campaign)
    turns, _ = half_turns(campaign.runs)
    unknown = half_turn_data(turns)
    fits = {
        ALL_KNOWN: _fit(known, Known(start_heading=True, switch_instant=True, gain=True)),
        SCATTER_FREE: _fit(known, Known(start_heading=True, switch_instant=True)),
        NOTHING_KNOWN: _fit(unknown, Known()),
    }
    found = {name: fit.mixed.theta[:2] for name, fit in fits.items()}
    for name, data in ((SEED_METHOD, known), (SEED_UNKNOWN, unknown)):
        seed = fit_velocity_error(data, np.zeros(len(data.moment)))
        found[name] = np.array([seed.inertia["3"].overall.value, seed.drag["3"].drag[1]])
    return Trial(
        {name: values / TRUTH - 1.0 for name, values in found.items()},
        _bounds(known, unknown, np.array([turn.step.switch_mid for turn in turns])),
        all(fit.mixed.converged for fit in fits.values()),
    )


def _fit(data: StepData, known: Known) -> OutputErrorFit:
    return fit_half_turns(data, "3", (1.2 * INERTIA, 0.0, 0.8 * K_RR), "nu", known)


def _bounds(known: StepData, unknown: StepData, middle: Floats) -> dict[str, Floats]:
    information = partial(fisher_information, truth=TRUTH, noise=NOISE, interval=PERIOD)
    first = information(known.time, known.observed, known.moment)
    since = unknown.time + middle[:, None]  # the true switch is at 0
    uniform = information(since, unknown.observed, unknown.moment, instants="uniform")
    normal = information(since, unknown.observed, unknown.moment, instants="gaussian")
    variances = (bound(first), bound(uniform, offset_known=True), bound(normal, offset_known=True), bound(uniform))
    return {name: variance / np.square(TRUTH) for name, variance in zip(BOUNDS, variances)}


def efficiency(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns."""
    trials = ordered_map(run_trial, range(count), jobs, progress=progress, stage="efficiency")
    limits = {name: np.mean([trial.bounds[name] for trial in trials], axis=0) for name in BOUNDS}
    rows, found = [], {}
    for name in ESTIMATORS:
        errors = np.array([trial.errors[name] for trial in trials])
        squares = errors**2
        mse = squares.mean(axis=0)
        ratio = limits[OWN_BOUND[name]] / mse
        doubt = ratio * squares.std(axis=0, ddof=1) / np.sqrt(count) / mse
        bias, sd = errors.mean(axis=0), errors.std(axis=0, ddof=1)
        rows.append((name, *(cell for i in (0, 1) for cell in _cells(bias[i], sd[i], ratio[i], doubt[i]))))
        found[name] = {
            parameter: {
                "bias": bias[i], "sd": sd[i], "bound_sd": np.sqrt(limits[OWN_BOUND[name]][i]),
                "efficiency": ratio[i], "monte_carlo_error": doubt[i],
            }
            for i, parameter in enumerate(("I_r", "k_rr"))
        }  # fmt: skip
    rivals = [found[NOTHING_KNOWN][p]["efficiency"] for p in ("I_r", "k_rr")]
    pair = [found[SCATTER_FREE][p]["efficiency"] for p in ("I_r", "k_rr")]
    notes = (
        f"Required: at least {WANTED} for maximum likelihood with start heading and instant known: "
        f"{'reached' if min(pair) >= WANTED else 'MISSED'} ({pair[0]:.2f} and {pair[1]:.2f}).",
        f"With nothing known it reaches {rivals[0]:.2f} and {rivals[1]:.2f} of the bound for instants uniform in "
        "their intervals, start headings from 3 s of rest.",
        f"Fits that converged: {sum(trial.converged for trial in trials)} of {count}.",
    )
    title = f"Efficiency (bound / mean square error) over {count} campaigns: 48 runs, 10 Hz, 1 degree, no scatter"
    header = ("estimator", "I bias %", "I sd %", "I efficiency", "k bias %", "k sd %", "k efficiency")
    own = Table("Cramer-Rao bounds of the same campaigns", ("known", "I sd %", "k sd %"),
                tuple((name, *(f"{100 * np.sqrt(v):.3f}" for v in limits[name])) for name in BOUNDS))  # fmt: skip
    sds = {name: dict(zip(("I_r", "k_rr"), np.sqrt(limits[name]))) for name in BOUNDS}
    converged = sum(trial.converged for trial in trials)
    results = {"campaigns": count, "bound_sd": sds, "estimators": found, "converged": converged}
    return [own, Table(title, header, tuple(rows), notes=notes)], results


def _cells(bias: float, sd: float, ratio: float, doubt: float) -> tuple[str, str, str]:
    digits = 2 if ratio > 0.2 else 3
    return f"{100 * bias:+.3f}", f"{100 * sd:.3f}", f"{ratio:.{digits}f} ± {doubt:.{digits}f}"
