"""Scores of simulated runs: sums a run, so that runs pool and resample exactly; intervals over runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.rollouts import State
from automarine_cli.comparison.simulated_runs import FreeRun
from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity
from automarine_cli.runs.clean import GAP_IN_PERIODS
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run

SMOOTHED = 1.0  # s over which a position is smoothed for its rate
FEWEST_RUNS = 3  # for an interval over runs
DRAWS = 2000  # bootstrap resamples
SCORES = ("rmse", "max_abs", "fit_percent", "restarted_rmse", "rate_rmse")
"""The scores; `score_key` says what they are called in files."""

SUMMED = ("rmse", "restarted_rmse", "rate_rmse")  # those that are roots of mean squares


def score_key(score: str, dof: Dof) -> str:
    units = dof.units
    if score == "rate_rmse":
        return f"{dof.words.speed}_rmse_{units.rate_key}"
    return score if score == "fit_percent" else f"{score}_{units.key}"


@dataclass(frozen=True)
class RunScore:
    """One run under one model: sums of squares, in the unit that people see, with their numbers of samples.

    `spread` is the sum of squares of the measured position about its mean, `worst` the largest error. All
    are 0 where the simulation `diverged`; a count of 0 says that the run has no such score.
    """

    start: State
    diverged: bool
    worst: float
    squares: Mapping[str, float]
    counts: Mapping[str, int]
    spread: float

    def value(self, name: str) -> float | None:
        """The score of that name (see SCORES), None where there is none."""
        if self.diverged:
            return None
        if name == "max_abs":
            return self.worst
        if name == "fit_percent":
            return fit_percent(self.squares["rmse"], self.spread)
        count = self.counts[name]
        return float(np.sqrt(self.squares[name] / count)) if count else None


def fit_percent(square: float, spread: float) -> float | None:
    """100 (1 - |error|/|measured - mean|) from sums of squares; None for a position that never changed."""
    return float(100.0 * (1.0 - np.sqrt(square / spread))) if spread > 0 else None


def score(free: FreeRun, restarted: Floats) -> RunScore:
    """Score a free run and its restarted errors (N,) [rad or m]; no restarted score where a restart diverges."""
    if free.diverged:
        nothing = dict.fromkeys(SUMMED, 0)
        return RunScore(free.start, True, 0.0, nothing, nothing, 0.0)
    dof = free.run.dof
    error = dof.shown(free.error)
    again = dof.shown(restarted[1:]) if np.all(np.isfinite(restarted)) else np.zeros(0)
    measured = dof.shown(free.run.position)
    rate = rate_error(free)
    columns = dict(zip(SUMMED, (error, again, rate)))
    return RunScore(
        start=free.start,
        diverged=False,
        worst=float(np.abs(error).max()),
        squares={name: float(column @ column) for name, column in columns.items()},
        counts={name: len(column) for name, column in columns.items()},
        spread=float(np.sum((measured - measured.mean()) ** 2)),
    )


def rate_source(run: Run) -> str:
    """Where the measured rate of a run comes from, in words."""
    if run.dof.velocity in run.extras:
        return f"{run.dof.words.rate} in the log"
    return f"slope of the {run.dof.position} smoothed over {rate_window(run) * run.sample_period:.3g} s"


def rate_error(free: FreeRun) -> Floats:
    """Measured less simulated rate, in the unit that people see, as many values as there are.

    With a rate in the log, less its bias, at the samples that have one; otherwise both positions are treated alike,
    put on an even grid and differentiated by Savitzky and Golay's parabola, never across a gap.
    """
    run, dof = free.run, free.run.dof
    read = unbiased_velocity(run)
    if read is not None:
        return np.asarray(dof.shown((read - free.rate)[~np.isnan(read)]))
    period, width = run.sample_period, rate_window(run)
    arm = np.arange(width // 2, -width // 2, -1)  # the parabola's slope, as `np.convolve` takes weights
    weights = arm / (arm @ arm) / period
    edges = np.flatnonzero(np.diff(run.time) > GAP_IN_PERIODS * period) + 1
    slopes = []
    for time, error in zip(np.split(run.time, edges), np.split(free.error, edges)):
        even = np.arange(time[0], time[-1] + 1e-6 * period, period)
        if len(even) >= width:
            slopes.append(np.convolve(np.interp(even, time, error), weights, mode="valid"))
    return np.asarray(dof.shown(np.concatenate(slopes))) if slopes else np.zeros(0)


def rate_window(run: Run) -> int:
    """Samples, an odd number, over which a position is smoothed for its rate: about a second, 5 at least."""
    return max(5, 2 * round(SMOOTHED / run.sample_period / 2) + 1)


def noise_floor(run: Run) -> float:
    """White noise of the position, in the unit that people see, estimated without a model."""
    return float(run.dof.shown(position_noise(run.time, run.position)))


def pooled_floor(runs: Sequence[Run]) -> float:
    """Noise level of all runs together, weighted as a pooled rmse is."""
    sizes = np.array([len(run) for run in runs])
    floors = np.array([noise_floor(run) for run in runs])
    return float(np.sqrt(sizes @ floors**2 / sizes.sum()))


@dataclass(frozen=True)
class Overall:
    """One score over all runs, with its 95 % interval over runs where there are three or more."""

    value: float | None
    ci95: tuple[float, float] | None = None


def resamples(runs: int, seed: int) -> NDArray[np.int64]:
    """How often each run is drawn in each bootstrap resample, (DRAWS, runs)."""
    generator = np.random.default_rng(seed)
    return generator.multinomial(runs, np.full(runs, 1.0 / runs), size=DRAWS)


def overall(scores: Sequence[RunScore], drawn: NDArray[np.int64]) -> dict[str, Overall]:
    """Every score over all runs: all samples pooled, the largest error of all.

    `drawn` as from `resamples`. Nothing is scored under a model that diverged in any run.
    """
    if any(one.diverged for one in scores):
        return {name: Overall(None) for name in SCORES}
    found = {"max_abs": Overall(max(one.worst for one in scores))}
    for name in SUMMED:
        squares = np.array([one.squares[name] for one in scores])
        counts = np.array([one.counts[name] for one in scores], dtype=float)
        found[name] = _ratio(squares, counts, drawn)
    squares = np.array([one.squares["rmse"] for one in scores])
    shares = _ratio(squares, np.array([one.spread for one in scores]), drawn)
    found["fit_percent"] = Overall(
        None if shares.value is None else 100.0 * (1.0 - shares.value),
        None if shares.ci95 is None else (100.0 * (1.0 - shares.ci95[1]), 100.0 * (1.0 - shares.ci95[0])),
    )
    return {name: found[name] for name in SCORES}


def lead(better: Sequence[RunScore], worse: Sequence[RunScore], drawn: NDArray[np.int64]) -> Overall:
    """By how much the pooled free-run rmse of one model is below another's, over the same resamples."""
    counts = np.array([one.counts["rmse"] for one in better], dtype=float)
    roots = []
    for scores in (worse, better):
        squares = np.array([one.squares["rmse"] for one in scores])
        roots.append((np.sqrt(squares.sum() / counts.sum()), np.sqrt(drawn @ squares / (drawn @ counts))))
    (first, many_first), (second, many_second) = roots
    return Overall(float(first - second), _interval(many_first - many_second, len(better)))


def _ratio(above: Floats, below: Floats, drawn: NDArray[np.int64]) -> Overall:
    """Root of a ratio of sums, and its interval over runs."""
    if below.sum() <= 0:
        return Overall(None)
    sums = drawn @ below
    roots = np.sqrt((drawn @ above)[sums > 0] / sums[sums > 0])
    return Overall(float(np.sqrt(above.sum() / below.sum())), _interval(roots, int(np.sum(below > 0))))


def _interval(draws: Floats, runs: int) -> tuple[float, float] | None:
    if runs < FEWEST_RUNS:
        return None
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(low), float(high)
