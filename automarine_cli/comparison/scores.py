"""Scores of simulated runs: sums a run, so that runs pool and resample exactly; intervals over runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.simulated_runs import FreeRun
from automarine_cli.dofs import YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import unbiased_velocity
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.run import Run, position_noise

SMOOTHED = 1.0  # s over which a position is smoothed for its rate
FEWEST_RUNS = 3  # for an interval over runs
DRAWS = 2000  # bootstrap resamples
ALONE = np.ones((1, 1), dtype=np.int64)  # the only resample of one run
RMS, MAX, FIT = "rms", "max", "fit"


class Score(NamedTuple):
    """A size of errors of one kind; its key in files, its heading in tables and what it means are templates."""

    errors: str
    size: str
    key: str
    heading: str
    meaning: str


FREE = "free run: measured less simulated {position} from the start of each run to its end"
ANEW = "{position} error with the state set anew from the smoothed measured {position} at each restart"
LESS = "free run: measured less simulated {rate}"
SHARE = "free run: 100 (1 - |error| / |measured - its mean|)"
SCORES = {
    "rmse": Score("position", RMS, "rmse_{shown_unit}", "rmse {shown_unit}", FREE),
    "max_abs": Score(
        "position", MAX, "max_abs_{shown_unit}", "max {shown_unit}", "free run: the largest {position} error"
    ),
    "fit_percent": Score("position", FIT, "fit_percent", "fit %", SHARE),
    "restarted_rmse": Score(
        "restarted", RMS, "restarted_rmse_{shown_unit}", "restarted rmse {shown_unit}", ANEW
    ),
    "rate_rmse": Score("rate", RMS, "{speed}_rmse_{shown_unit}_s", "{speed} rmse {shown_unit}/s", LESS),
}  # fmt: skip
"""The scores of one degree of freedom."""
PLANAR_SCORES = {
    score.key: score
    for score in (
        Score("heading", RMS, "heading_rmse_deg", "heading deg", YAW.fill(FREE)),
        Score("heading", MAX, "heading_max_abs_deg", "max deg", "free run: the largest heading error"),
        Score(
            "position", RMS, "position_rmse_m", "position m",
            "free run: distance between measured and simulated position",
        ),
        Score("position", MAX, "position_max_abs_m", "max m", "free run: the largest such distance"),
        Score("surge", RMS, "surge_rmse_m_s", "surge m/s", "free run: measured less simulated surge speed"),
        Score("sway", RMS, "sway_rmse_m_s", "sway m/s", "free run: measured less simulated sway speed"),
        Score("yaw_rate", RMS, "yaw_rate_rmse_deg_s", "yaw rate deg/s", YAW.fill(LESS)),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Overall:
    """One score over all runs, with its 95 % interval over runs where there are three or more."""

    value: float | None
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True)
class RunScore:
    """Errors (n,) of one run under one model by kind, in the unit that people see, none at all where the simulation
    diverges; `measured` is the position about its mean."""

    errors: Mapping[str, Floats]

    @property
    def diverged(self) -> bool:
        return not self.errors

    def value(self, name: str) -> float | None:
        """Return the score of that name, None where there is none."""
        return pooled([self], (SCORES | PLANAR_SCORES)[name], ALONE).value

    def of(self, kind: str) -> Floats:
        return self.errors.get(kind, np.zeros(0))


def score(free: FreeRun, restarted: Floats) -> RunScore:
    """Score a free run and its restarted errors (N,) [rad or m]; no restarted score where a restart diverges."""
    if free.diverged:
        return RunScore({})
    dof = free.run.dof
    again = dof.shown(restarted[1:]) if np.all(np.isfinite(restarted)) else np.zeros(0)
    measured = dof.shown(free.run.position)
    return RunScore({
        "position": dof.shown(free.error), "restarted": again, "rate": rate_error(free),
        "measured": measured - measured.mean(),
    })  # fmt: skip


def planar_score(free: FreeRun) -> RunScore:
    """Score a free run in the plane by what its log holds."""
    if free.diverged:
        return RunScore({})
    names = (YAW.position, *(dof.velocity for dof in PLANAR.dofs))
    errors = {"position": free.distance} | {name: free.error_of(name) for name in names}
    scale = {name: YAW.logged(1.0) for name in YAW.channels}
    return RunScore({
        name: scale.get(name, 1.0) * error[np.isfinite(error)] for name, error in errors.items() if error is not None
    })  # fmt: skip


def rate_source(run: Run) -> str:
    """Say where the measured rate of a run comes from."""
    if run.dof.velocity in run.extras:
        return f"{run.dof.words.rate} in the log"
    return f"slope of the {run.dof.position} smoothed over {rate_window(run) * run.sample_period:.3g} s"


def rate_error(free: FreeRun) -> Floats:
    """Return measured less simulated rate, in the unit that people see, as many values as there are.

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
    slopes = [np.zeros(0)]
    for time, error in zip(np.split(run.time, edges), np.split(free.error, edges)):
        even = np.arange(time[0], time[-1] + 1e-6 * period, period)
        if len(even) >= width:
            slopes.append(np.convolve(np.interp(even, time, error), weights, mode="valid"))
    return np.asarray(dof.shown(np.concatenate(slopes)))


def rate_window(run: Run) -> int:
    """Return over how many samples, an odd number, a position is smoothed for its rate: a second, 5 at least."""
    return max(5, 2 * round(SMOOTHED / run.sample_period / 2) + 1)


def noise_floor(run: Run) -> float:
    """Estimate the white noise of the position without a model, in the unit that people see."""
    return float(run.dof.shown(position_noise(run.time, run.position)))


def resamples(runs: int, seed: int) -> NDArray[np.int64]:
    """Draw how often each run is in each bootstrap resample, (DRAWS, runs)."""
    return np.random.default_rng(seed).multinomial(runs, np.full(runs, 1.0 / runs), size=DRAWS)


def overall(
    scores: Sequence[RunScore], drawn: NDArray[np.int64], table: Mapping[str, Score] = SCORES
) -> dict[str, Overall]:  # fmt: skip
    """Score all runs together, `drawn` as from `resamples`; nothing under a model that diverged in any run."""
    diverged = any(run.diverged for run in scores)
    return {name: Overall(None) if diverged else pooled(scores, score, drawn) for name, score in table.items()}


def pooled(scores: Sequence[RunScore], score: Score, drawn: NDArray[np.int64]) -> Overall:
    """Return one score over runs, all samples pooled or the largest error of all."""
    errors = [run.of(score.errors) for run in scores]
    if score.size == MAX:
        return Overall(max((float(np.abs(error).max()) for error in errors if len(error)), default=None))
    below = _squares(scores, "measured") if score.size == FIT else np.array([float(len(error)) for error in errors])
    if below.sum() <= 0:
        return Overall(None)
    root, roots = _roots(_squares(scores, score.errors), below, drawn)
    if score.size == FIT:
        root, roots = 100.0 * (1.0 - root), 100.0 * (1.0 - roots)
    return Overall(root, _interval(roots, int(np.sum(below > 0))))


def lead(better: Sequence[RunScore], worse: Sequence[RunScore], drawn: NDArray[np.int64]) -> Overall:
    """Return by how much the pooled free-run rmse of one model is below another's, over the same resamples."""
    counts = np.array([float(len(run.of("position"))) for run in worse])
    (first, firsts), (second, seconds) = (_roots(_squares(s, "position"), counts, drawn) for s in (worse, better))
    return Overall(first - second, _interval(firsts - seconds, len(better)))


def _squares(scores: Sequence[RunScore], kind: str) -> Floats:
    return np.array([run.of(kind) @ run.of(kind) for run in scores])


def _roots(above: Floats, below: Floats, drawn: NDArray[np.int64]) -> tuple[float, Floats]:
    """Return the root of a ratio of sums over runs, and of each resample of these."""
    sums = drawn @ below
    return float(np.sqrt(above.sum() / below.sum())), np.sqrt((drawn @ above)[sums > 0] / sums[sums > 0])


def _interval(draws: Floats, runs: int) -> tuple[float, float] | None:
    if runs < FEWEST_RUNS:
        return None
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(low), float(high)
