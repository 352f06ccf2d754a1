"""Campaigns of step runs and of moving runs with known truth, for the tests of the yaw fits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from made_runs import INERTIA, K_RR
from made_sequences import solved
from scipy import optimize

from automarine_cli.dofs import YAW
from automarine_cli.models.model import response
from automarine_cli.runs.run import Run


@dataclass(frozen=True)
class Vehicle:
    """The truth: I_r, k_r, k_rr."""

    inertia: float = INERTIA
    k_r: float = 0.0
    k_rr: float = K_RR


PAPER = Vehicle()
ODD_MOMENTS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.1)
"""Half of the paper's moments: enough for a fit, quick to fit."""


def both_ways(sizes: Sequence[float]) -> list[float]:
    """Each size of moment to starboard and to port."""
    return [sign * size for size in sizes for sign in (1.0, -1.0)]


def time_to_turn(angle: float, moment: float, vehicle: Vehicle = PAPER) -> float:
    """Time [s] from rest to a turned angle [rad]."""

    def short_of(t: float) -> float:
        return float(response(t, abs(moment), vehicle.inertia, vehicle.k_r, vehicle.k_rr)[0]) - angle

    longest = 1.0
    while short_of(longest) < 0:
        longest *= 2.0
    return float(optimize.brentq(short_of, 0.0, longest))


def campaign(
    moments: Sequence[float] = tuple(both_ways(ODD_MOMENTS)),
    *,
    seed: int = 0,
    vehicle: Vehicle = PAPER,
    noise_deg: float = 1.0,
    gain_scatter: float = 0.0,
    period: float = 0.1,
    uneven: float = 0.0,
    rest: float = 2.0,
    turn: float = 1.15 * np.pi,
    unit: str = "nu",
    gyro_deg_s: float | None = None,
    bias_deg_s: float = 1.0,
) -> list[Run]:
    """One run a moment from rest at any heading through `turn` [rad]; the command switches anywhere between two
    samples.

    `uneven` is the share of the period by which samples wander; `rest` 0 makes logs that begin with the step on. A gyro
    with a noise of `gyro_deg_s` has a bias of its own in each run.
    """
    rng = np.random.default_rng(seed)
    runs = []
    for i, moment in enumerate(moments):
        length = time_to_turn(turn, moment, vehicle)
        count = np.arange(-round(rest / period), int(np.ceil(length / period)) + 1)
        time = period * (count + rng.uniform() + uneven * rng.uniform(-0.5, 0.5, len(count)))
        time = time[time > 0] if rest == 0 else time
        delivered = moment * np.exp(gain_scatter * rng.standard_normal())
        turned, rate = response(time, delivered, vehicle.inertia, vehicle.k_r, vehicle.k_rr)
        heading = rng.uniform(-np.pi, np.pi) + turned + np.deg2rad(noise_deg) * rng.standard_normal(len(time))
        command = np.where(time > 0, moment, 0.0)
        extras = {}
        if gyro_deg_s is not None:
            noise = gyro_deg_s * rng.standard_normal(len(time)) + bias_deg_s * rng.standard_normal()
            extras = {"yaw_rate": rate + np.deg2rad(noise)}
        runs.append(Run(f"run_{i:02d}", "made.csv", 60.0 * i + time, heading, command, unit, extras, dof=YAW))
    return runs


def rescaled(runs: Sequence[Run], factor: float, unit: str = "nu") -> list[Run]:
    """The same runs with their moments told in another unit."""
    return [run.with_moment(factor * run.command, unit) for run in runs]


def shifted(runs: Sequence[Run], seconds: float) -> list[Run]:
    """The same runs by a clock that runs ahead."""
    return [replace(run, time=run.time + seconds) for run in runs]


def moving_run(seed: int, *, length: float = 25.0) -> tuple[Run, float, float]:
    """A run of piecewise constant moments that begins while the vehicle turns: run, true start heading and rate.

    Solved by scipy, not by the package. Commands change in the middle between two samples.
    """
    rng, period = np.random.default_rng(seed), 0.2
    edges = np.cumsum(rng.uniform(1.0, 3.0, int(length)))
    edges = period * (np.round(edges / period) + 0.5)
    levels = rng.uniform(-1.2, 1.2, len(edges) + 1)
    start, rate = rng.uniform(-1.0, 1.0), rng.uniform(0.2, 0.6) * rng.choice((-1.0, 1.0))

    time = np.arange(0.0, length, period)
    truth = start + solved((0.0, *edges[edges < time[-1]]), levels, time, 0.0, K_RR, rate)
    heading = truth + np.deg2rad(0.5) * rng.standard_normal(len(time))
    command = levels[np.searchsorted(edges, time, side="right")]
    return (Run(f"moving_{seed}", "moving.csv", 50.0 * seed + time, heading, command, "nu", dof=YAW), start, rate)
