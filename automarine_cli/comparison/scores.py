"""Scores of simulated runs: sums a run, so that runs pool and resample exactly; intervals over runs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.simulated_runs import FreeRun
from automarine_cli.dofs import YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.run import Run, position_noise

SMOOTHED = 1.0  # s over which a position is smoothed for its rate
FEWEST_RUNS = 3  # for an interval over runs
DRAWS = 2000  # bootstrap resamples
NOTHING = np.zeros(0)
RMS, MAX, FIT = "rms", "max", "fit"


class Score(NamedTuple):
    """The size of errors of a kind, and what that means."""

    errors: str
    size: str
    meaning: str


FREE = "free run: measured less simulated {position} from the start of each run to its end"
ANEW = "{position} error with the state set anew from the smoothed measured {position} at each restart"
SCORES = {
    "rmse": Score("position", RMS, FREE),
    "max_abs": Score("position", MAX, "free run: the largest {position} error"),
    "fit_percent": Score("position", FIT, "free run: 100 (1 - |error| / |measured - its mean|)"),
    "restarted_rmse": Score("restarted", RMS, ANEW),
    "rate_rmse": Score("rate", RMS, "free run: measured less simulated {rate}"),
}
"""The scores of one degree of freedom; `score_key` says what they are called in files."""
PLANAR_SCORES = {
    "heading_rmse_deg": Score("heading", RMS, YAW.fill(FREE)),
    "heading_max_abs_deg": Score("heading", MAX, "free run: the largest heading error"),
    "position_rmse_m": Score("position", RMS, "free run: distance between measured and simulated position"),
    "position_max_abs_m": Score("position", MAX, "free run: the largest such distance"),
    "surge_rmse_m_s": Score("surge", RMS, "free run: measured less simulated surge speed"),
    "sway_rmse_m_s": Score("sway", RMS, "free run: measured less simulated sway speed"),
    "yaw_rate_rmse_deg_s": Score("yaw_rate", RMS, "free run: measured less simulated yaw rate"),
}
KNOWN = {**SCORES, **PLANAR_SCORES}


def score_key(score: str, dof: Dof) -> str:
    units = dof.units
    if score == "rate_rmse":
        return f"{dof.words.speed}_rmse_{units.rate_key}"
    return score if score == "fit_percent" else f"{score}_{units.key}"


@dataclass(frozen=True)
class RunScore:
    """Errors (n,) of one run under one model by kind, in the unit that people see, none at all where the simulation
    diverges; `spread` is the sum of squares of the measured position about its mean."""

    errors: Mapping[str, Floats]
    spread: float = 0.0

    @property
    def diverged(self) -> bool:
        return not self.errors

    def value(self, name: str) -> float | None:
        """The score of that name, None where there is none."""
        score = KNOWN[name]
        error = self.errors.get(score.errors, NOTHING)
        if not len(error):
            return None
        if score.size == MAX:
            return float(np.abs(error).max())
        square = float(error @ error)
        return fit_percent(square, self.spread) if score.size == FIT else float(np.sqrt(square / len(error)))


def fit_percent(square: float, spread: float) -> float | None:
    """100 (1 - |error|/|measured - mean|) from sums of squares; None for a position that never changed."""
    return float(100.0 * (1.0 - np.sqrt(square / spread))) if spread > 0 else None


def score(free: FreeRun, restarted: Floats) -> RunScore:
    """Score a free run and its restarted errors (N,) [rad or m]; no restarted score where a restart diverges."""
    if free.diverged:
        return RunScore({})
    dof = free.run.dof
    again = dof.shown(restarted[1:]) if np.all(np.isfinite(restarted)) else NOTHING
    measured = dof.shown(free.run.position)
    errors = {"position": dof.shown(free.error), "restarted": again, "rate": rate_error(free)}
    return RunScore(errors, float(np.sum((measured - measured.mean()) ** 2)))


def planar_score(free: FreeRun) -> RunScore:
    """Score a free run in the plane by what its log holds."""
    if free.diverged:
        return RunScore({})
    names = (YAW.position, *(dof.velocity for dof in PLANAR.dofs))
    errors = {"position": free.distance} | {name: free.error_of(name) for name in names}
    scale = {name: YAW.logged(1.0) for name in (YAW.position, YAW.velocity)}
    return RunScore({
        name: scale.get(name, 1.0) * error[np.isfinite(error)] for name, error in errors.items() if error is not None
    })  # fmt: skip


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
    return float(np.sqrt(np.average([noise_floor(run) ** 2 for run in runs], weights=[len(run) for run in runs])))


@dataclass(frozen=True)
class Overall:
    """One score over all runs, with its 95 % interval over runs where there are three or more."""

    value: float | None
    ci95: tuple[float, float] | None = None


def resamples(runs: int, seed: int) -> NDArray[np.int64]:
    """How often each run is drawn in each bootstrap resample, (DRAWS, runs)."""
    generator = np.random.default_rng(seed)
    return generator.multinomial(runs, np.full(runs, 1.0 / runs), size=DRAWS)


def overall(
    scores: Sequence[RunScore], drawn: NDArray[np.int64], names: Iterable[str] = SCORES
) -> dict[str, Overall]:  # fmt: skip
    """Every score over all runs: all samples pooled, the largest error of all.

    `drawn` as from `resamples`. Nothing is scored under a model that diverged in any run.
    """
    if any(one.diverged for one in scores):
        return {name: Overall(None) for name in names}
    found = {}
    for name in names:
        kind, size, _ = KNOWN[name]
        squares, counts = _sums(scores, kind)
        if size == RMS:
            found[name] = _ratio(squares, counts, drawn)
        elif size == MAX:
            found[name] = Overall(max((x for one in scores if (x := one.value(name)) is not None), default=None))
        else:
            share = _ratio(squares, np.array([one.spread for one in scores]), drawn)
            found[name] = Overall(
                None if share.value is None else 100.0 * (1.0 - share.value),
                None if share.ci95 is None else (100.0 * (1.0 - share.ci95[1]), 100.0 * (1.0 - share.ci95[0])),
            )
    return found


def _sums(scores: Sequence[RunScore], kind: str) -> tuple[Floats, Floats]:
    """Sums of squares of the errors of each run, and their numbers."""
    errors = [one.errors.get(kind, NOTHING) for one in scores]
    return np.array([error @ error for error in errors]), np.array([len(error) for error in errors], dtype=float)


def lead(better: Sequence[RunScore], worse: Sequence[RunScore], drawn: NDArray[np.int64]) -> Overall:
    """By how much the pooled free-run rmse of one model is below another's, over the same resamples."""
    roots = []
    for scores in (worse, better):
        squares, counts = _sums(scores, SCORES["rmse"].errors)
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
