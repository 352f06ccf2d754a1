"""What a velocity sensor adds to its readings in one run, told by the position."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.runs.noise import position_noise, slope
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]

FEWEST = 8
"""Readings."""


def unbiased_velocity(run: Run) -> Floats | None:
    """The velocity logged, (N,), less its bias, by which its sum runs away from the position; NaN where there is no
    reading, None where there are hardly any."""
    read = run.extras.get(run.dof.velocity)
    if read is None:
        return None
    good = np.isfinite(read)
    if good.sum() < FEWEST:
        return None
    time, velocity = run.time[good], read[good]
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    return np.asarray(read - slope(time, summed - run.position[good])[0])


def velocity_noise(run: Run) -> float:
    """Noise of the velocity logged, apart from any model; zero where there is none."""
    read = run.extras.get(run.dof.velocity)
    if read is None:
        return 0.0
    good = np.isfinite(read)
    return position_noise(run.time[good], read[good])
