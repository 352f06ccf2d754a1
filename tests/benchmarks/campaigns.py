"""Simulated step campaigns with known truth for the benchmarks, apart from the tool's own simulator."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from made_runs import INERTIA, K_RR

from automarine_cli.dofs import YAW
from automarine_cli.fits.steps import StepData, step_data
from automarine_cli.models.model import response
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run

NOISE = np.deg2rad(1.0)
PERIOD = 0.1  # s
REST = 30  # samples before the step
BOTH_SIDES = tuple(sign * m / 10 for m in range(1, 13) for sign in (-1, 1))
LARGE = 2 * BOTH_SIDES
"""48 runs: |tau| 0.1 to 1.2 to both sides, two each."""


@dataclass(frozen=True)
class Campaign:
    """R runs and their truth: start headings (R,) [rad]; every command switched at time 0."""

    runs: tuple[Run, ...]
    start_heading: Floats


def make_campaign(
    seed: Sequence[int],
    moments: Sequence[float] = LARGE,
    *,
    k_r: float = 0.0,
    k_rr: float = K_RR,
    scatter: float = 0.0,
    noise: float = NOISE,
) -> Campaign:
    """Rest, then a step of each moment held past half a turn; the log's clock begins anywhere in a period.

    `scatter` is the standard deviation of the logarithm of each run's moment delivered over commanded, `noise` that of
    the heading [rad].
    """
    random = np.random.default_rng(seed)
    start = random.uniform(-np.pi, np.pi, len(moments))
    runs = []
    for i, (moment, heading0) in enumerate(zip(moments, start)):
        delivered = moment * np.exp(scatter * random.standard_normal())
        last = round(_length(abs(moment), k_r, k_rr) / PERIOD)
        time = PERIOD * (np.arange(-REST, last, dtype=float) + random.uniform())
        turned, _ = response(time, delivered, INERTIA, k_r, k_rr)
        noisy = heading0 + turned + noise * random.standard_normal(len(time))
        runs.append(Run(f"run {i}", "simulated", time, noisy, np.where(time > 0, moment, 0.0), "nu", dof=YAW))
    return Campaign(tuple(runs), start)


def _length(moment: float, k_r: float, k_rr: float) -> float:
    """Duration [s] of a step that passes half a turn, with gains of the thrust to spare."""
    if k_rr == 0.0:
        return 1.6 * np.pi * k_r / moment + 2.0 * INERTIA / k_r
    return 8.0 * INERTIA / np.sqrt(moment * k_rr) * (1.0 + k_r / np.sqrt(moment * k_rr))


def known_half_turns(campaign: Campaign) -> StepData:
    """The half-turns by the tool's own rule, without rest, on the true instant and start heading."""
    turns, _ = half_turns(campaign.runs)
    zero = {run.name: heading for run, heading in zip(campaign.runs, campaign.start_heading)}
    return step_data(
        [turn.name for turn in turns],
        [turn.time for turn in turns],
        [turn.position - zero[turn.name] for turn in turns],
        [turn.moment for turn in turns],
        [turn.step.switch_to - turn.step.switch_from for turn in turns],
        YAW,
    )
