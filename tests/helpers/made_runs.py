"""Runs of a vehicle whose truth is known: the closed-form response of model 3 with white noise."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from automarine_cli.dofs import YAW
from automarine_cli.models.model import response
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

INERTIA, K_RR = 1.018, 1.257  # the source paper's Tables 1 and 2


def step_heading(time: Floats, moment: float, *, heading0: float = 0.7, rate0: float = 0.0) -> Floats:
    """True heading [rad] at `time` (N,) [s] after the step."""
    if rate0:
        return heading0 + solved((0.0,), (moment,), time, 0.0, K_RR, rate0)
    return heading0 + response(time, np.full(len(time), moment), INERTIA, 0.0, K_RR)[0]


def solved(
    switches: Sequence[float], moments: Sequence[float], time: Floats, k_r: float, k_rr: float, rate0: float
) -> Floats:
    """True heading [rad] at `time` (N,) for moments held from each of `switches` [s], by scipy's solver; before the
    first switch the vehicle turns at `rate0` [rad/s]."""
    state, heading = np.array([0.0, rate0]), rate0 * (time - switches[0])
    bounds = [*switches, time[-1] + 1.0]
    for begin, end, moment in zip(bounds[:-1], bounds[1:], moments):
        here = (time >= begin) & (time < end)
        found = solve_ivp(
            lambda t, y, tau: [y[1], (tau - (k_r + k_rr * abs(y[1])) * y[1]) / INERTIA],
            (begin, end),
            state,
            args=(moment,),
            t_eval=np.append(time[here], end),
            rtol=1e-9,
            atol=1e-11,
        )
        heading[here], state = found.y[0, :-1], found.y[:, -1]
    return heading


def step_run(
    moment: float = 0.5,
    *,
    rest: float = 2.0,
    length: float | None = None,
    noise_deg: float = 1.0,
    phase: float = 0.37,
    rate0: float = 0.0,
    clock: float = 100.0,
    seed: int = 0,
) -> Run:
    """A step to `moment` after `rest` [s]; by default it lasts for a little more than half a turn.

    The command switches at `clock`, `phase` of a sample period before the first sample that shows it.
    """
    period = 0.1
    length = 5.2 * INERTIA / np.sqrt(abs(moment) * K_RR) if length is None else length
    time = period * (np.arange(-round(rest / period), round(length / period)) + phase)
    noise = np.deg2rad(noise_deg) * np.random.default_rng(seed).standard_normal(len(time))
    heading = step_heading(time, moment, rate0=rate0) + noise
    return Run("run", "run.csv", clock + time, heading, np.where(time > 0, moment, 0.0), "nu", dof=YAW)


def mirrored(run: Run) -> Run:
    """The same run turning the other way."""
    assert run.moment is not None
    return Run(run.name, run.source, run.time, -run.position, -run.moment, run.moment_unit, dof=YAW)


def written(run: Run, path: Path, **columns: Mapping[str, object]) -> Path:
    """The run as a CSV log with a wrapped heading; `columns` replace or add."""
    table = {"time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, "tau": run.moment, **columns}
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(table).to_csv(path, index=False)
    return path
