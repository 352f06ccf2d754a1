"""Efficiency: the Cramer-Rao bound over the mean square error of inertia and drag, for both estimators.

The bound of model 3 has its own algebra. With x = sqrt(|tau| k) t/I the heading is psi0 + sgn(tau) (I/k) ln cosh x, so

    dpsi/dI = sgn(tau) (ln cosh x - x tanh x)/k,       dpsi/dk = sgn(tau) (I/k²) (x tanh x/2 - ln cosh x),
    dpsi/dt0 = -sgn(tau) sqrt(|tau|/k) tanh x,         all zero before the step.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from campaigns import NOISE, PERIOD, known_half_turns, make_campaign
from made_runs import INERTIA, K_RR
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from automarine_cli.fits.linear_mixed import GAIN, START_POSITION, SWITCHES, RunEffects
from automarine_cli.fits.mixed_model import MixedFit, fit_mixed
from automarine_cli.fits.paper import fit_velocity_error
from automarine_cli.fits.steps import StepData, data_of_steps, step_problem
from automarine_cli.models.parameter import Parameters
from automarine_cli.pipeline.parallel import Progress, ordered_map
from automarine_cli.quantities import Floats
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns

TRUTH = (INERTIA, K_RR)
REQUIRED = 0.9
STREAM = 1

ALL_KNOWN = "ML, start heading, instant and equal gains known"
SCATTER_FREE = "ML, start heading and instant known"
NOTHING_KNOWN = "ML, nothing known"
SEED_METHOD = "paper's method, start heading and instant known"
SEED_UNKNOWN = "paper's method, nothing known"
EXACT = {ALL_KNOWN: True, SCATTER_FREE: True, NOTHING_KNOWN: False, SEED_METHOD: True, SEED_UNKNOWN: False}
"""The estimators; whether their bound is that of a known start heading and instant, or of an instant uniform in its
sample interval."""


def bound(time: Floats, observed: NDArray[np.bool_], moment: Floats, exact: bool) -> Floats:
    """Smallest variances of unbiased estimates of I and k as shares of their squares, (2,).

    `time` (R, N) [s] since the true switch, `observed` (R, N), `moment` (R,). Where not all is known `exact`ly, each
    run's start heading is free (samples with negative time are its rest), and its instant lies anywhere in a sample
    interval: the information is that in the marginal density, the response being linear in the instant.
    """
    inertia, k = TRUTH
    side = np.sign(moment)[:, None] * observed
    size = np.abs(moment)[:, None]
    x = np.sqrt(size * k) * np.maximum(time, 0.0) / inertia
    grown = log_cosh(x)
    by_inertia = side * (grown - x * np.tanh(x)) / k
    by_drag = side * inertia / k**2 * (x * np.tanh(x) / 2.0 - grown)
    columns = np.stack([by_inertia, by_drag], axis=2) / NOISE
    by_instant = -side * np.sqrt(size / k) * np.tanh(x) / NOISE
    total = np.zeros((2, 2))
    for i, mask in enumerate(observed):
        j, v = columns[i][mask], by_instant[i][mask]
        if exact:
            total += j.T @ j
            continue
        j, v = j - j.mean(axis=0), v - v.mean()
        slope = j.T @ v / (v @ v)  # how the run's estimated instant moves with (I, k)
        rest = j - np.outer(v, slope)
        total += rest.T @ rest + location_information(1.0 / np.sqrt(v @ v), PERIOD) * np.outer(slope, slope)
    return np.asarray(np.diagonal(np.linalg.inv(total)) / np.square(TRUTH))


def log_cosh(x: Floats) -> Floats:
    """ln cosh x of x that is not negative."""
    return np.asarray(x - np.log(2.0) + np.log1p(np.exp(-2.0 * x)))


def location_information(sd: float, width: float) -> float:
    """Information on the centre in one reading with normal error `sd` of a point drawn uniformly from a `width` around
    that centre: the integral of g'²/g of the density g = (Phi(a) - Phi(b))/width."""
    x = np.linspace(-8.0 * sd, width / 2.0 + 8.0 * sd, 20001) - width / 2.0  # the left edge is enough
    x = x[x <= 0.0]
    low, high = (x + width / 2.0) / sd, (x - width / 2.0) / sd
    density = np.exp(log_ndtr(low)) - ndtr(high)
    slope = (np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)) / np.sqrt(2.0 * np.pi) / sd
    return float(2.0 * np.trapezoid(slope**2 / np.maximum(density, 1e-300), x) / width)


@dataclass(frozen=True)
class Trial:
    """One simulated campaign: relative errors of (I, k) by estimator, and relative variance bounds."""

    errors: dict[str, Floats]
    bounds: dict[bool, Floats]
    converged: bool


def run_trial(index: int) -> Trial:
    """Simulate the campaign of that number and fit it every way."""
    campaign = make_campaign([STREAM, index])
    informed = known_half_turns(campaign)
    turns, _ = half_turns(campaign.runs)
    blind = data_of_steps(turns)
    fits = {
        ALL_KNOWN: _fit(informed, START_POSITION, SWITCHES, GAIN),
        SCATTER_FREE: _fit(informed, START_POSITION, SWITCHES),
        NOTHING_KNOWN: _fit(blind),
    }
    estimates = {name: fit.theta[:2] for name, fit in fits.items()}
    for name, data in ((SEED_METHOD, informed), (SEED_UNKNOWN, blind)):
        seed = fit_velocity_error(data, np.zeros(len(data.moment)))
        estimates[name] = np.array([seed.inertia["3"].overall.value, seed.drag["3"].drag[1]])
    since = blind.time + np.array([turn.step.switch_mid for turn in turns])[:, None]  # the true switch is at 0
    bounds = {
        True: bound(informed.time, informed.observed, informed.moment, exact=True),
        False: bound(since, blind.observed, blind.moment, exact=False),
    }
    errors = {name: values / TRUTH - 1.0 for name, values in estimates.items()}
    return Trial(errors, bounds, all(fit.converged for fit in fits.values()))


def _fit(data: StepData, *known: str) -> MixedFit:
    """Model 3, with what differs from run to run known where it is named."""
    problem, begin = step_problem(data, "3"), np.array([1.2 * INERTIA, 0.8 * K_RR, 0.0])
    effects = RunEffects(tuple(replace(b, scale=(b.name not in known) * b.scale) for b in problem.effects.blocks))
    *of_model, delay = problem.parameters
    if SWITCHES in known:
        problem = replace(problem, parameters=Parameters((*of_model, delay.at(0.0))))
    return fit_mixed(replace(problem, effects=effects), begin, noise=0.02, factors=np.array([0.03, 0.5]))


def efficiency(count: int, jobs: int, progress: Progress) -> tuple[list[Table], dict[str, Any]]:
    """Tables and plain results of `count` campaigns."""
    trials = ordered_map(run_trial, range(count), jobs, progress=progress, stage="efficiency")
    rows, ratios = [], {}
    for name, exact in EXACT.items():
        errors = np.array([trial.errors[name] for trial in trials])
        limit, mse = np.mean([trial.bounds[exact] for trial in trials], axis=0), (errors**2).mean(axis=0)
        ratio = ratios[name] = limit / mse
        doubt = ratio * (errors**2).std(axis=0, ddof=1) / np.sqrt(count) / mse
        bias, sd = 100 * errors.mean(axis=0), 100 * errors.std(axis=0, ddof=1)
        row: dict[str, Any] = {"estimator": name}
        for i, p in enumerate("Ik"):
            row |= {f"{p} bias %": bias[i], f"{p} sd %": sd[i], f"{p} bound %": 100 * np.sqrt(limit[i]),
                    f"{p} efficiency": ratio[i], f"{p} ±": doubt[i]}  # fmt: skip
        rows.append(row)
    reached = min(ratios[SCATTER_FREE])
    notes = (
        f"Required: at least {REQUIRED} for maximum likelihood with start heading and instant known: "
        f"{'reached' if reached >= REQUIRED else 'MISSED'} ({reached:.2f}).",
        "± is the Monte-Carlo error; with nothing known the bound is that of instants uniform in their intervals.",
        f"Fits that converged: {sum(trial.converged for trial in trials)} of {count}.",
    )
    title = f"Efficiency (bound / mean square error) over {count} campaigns: 48 runs, 10 Hz, 1 degree, no scatter"
    return [Table.of(title, rows, notes)], {"campaigns": count, "estimators": rows}
