"""Where the filter's steps begin and end, and which samples are readings that tell something new."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import Motion
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import fresh_readings, position_noise
from automarine_cli.runs.run import Run

STEP, LEAST_STEP = 0.25, 0.1
"""Longest step of the filter [s] where readings hang together; and the shortest, where each tells something new: a
controller answers every reading, and the commands would tell of one that was left out."""
LONGEST = 0.15
"""Longest step [s] between samples that are further apart; longer ones are divided."""
APART = 0.5
"""Least time [s] between readings whose noise is below what sensors have: such were filtered, and hang together."""
SMOOTH_GYRO = 0.25
"""Share of a compass' least noise [per s] below which a gyro was filtered, or its rate is derived from headings."""


def least_noise(dof: Dof, velocity: bool) -> float:
    """Give the noise below which readings were filtered or derived [base units, per s of a velocity]; a gyro's may be
    a share of that of a compass per second."""
    return (SMOOTH_GYRO if velocity and dof.wraps else 1.0) * dof.limits.least_noise


def step_of(runs: Sequence[Run], motion: Motion, quantities: Sequence[str]) -> float:
    """LEAST_STEP where any readings are as noisy as sensors are, or there is a gyro; else STEP."""
    for dof, position in zip(motion.dofs, motion.positions):
        for quantity in (position, dof.velocity):
            noises = []
            for run in runs:
                read = run.channel(quantity)
                if quantity in quantities and read is not None:
                    fresh = fresh_readings(read)
                    noises.append(position_noise(run.time[fresh], read[fresh]))
            gyro = dof.wraps and quantity == dof.velocity
            if noises and (gyro or np.median(noises) >= least_noise(dof, quantity == dof.velocity)):
                return LEAST_STEP
    return STEP


def nodes_of(run: Run, step: float, longest: float, quantities: Sequence[str]) -> Floats:
    """Clock of the filter's nodes: samples about `step` apart, intervals divided about `longest`. Where a sensor is
    slower than the log, the samples of the slowest come first."""
    read = [channel for channel in map(run.channel, quantities) if channel is not None]
    slow = min((fresh_readings(one) for one in read), key=np.count_nonzero, default=np.ones(len(run), dtype=bool))
    own = np.append(run.time[slow], np.inf)
    wait = own[np.searchsorted(own, run.time, side="right")] - run.time
    kept, last, firm = [0], run.time[0], run.time[0]
    for i in range(1, len(run)):
        now = run.time[i]
        first = slow[i] and now - firm > 0.999 * step
        if first or (now - last > 0.999 * step and wait[i] > 0.5 * step) or i == len(run) - 1:
            kept.append(i)
            last, firm = now, now if first else firm
    gaps = np.diff(run.time[kept])
    count = np.maximum(np.ceil(gaps / longest - 0.25).astype(int), 1)
    which = np.repeat(np.arange(len(gaps)), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.append(run.time[kept][which] + order * (gaps / count)[which], run.time[-1])


def averaged_over(period: float) -> int:
    """Samples of a log with one each `period` [s] that make one reading: an odd number, of one LEAST_STEP."""
    return 2 * int(0.4999 * LEAST_STEP / max(period, 1e-9)) + 1


def readings_of(time: Floats, read: Floats, node: Floats, floor: float) -> tuple[NDArray[np.int64], Floats, float]:
    """Which nodes have a reading, the readings, and their noise, of which less than `floor` is a filter's.

    Of a sensor that is faster than the filter the samples about a node are averaged, at the time of the node.
    """
    fresh = fresh_readings(read)
    noise = position_noise(time[fresh], read[fresh])
    apart = APART if noise < floor else 0.0
    at = np.searchsorted(node, time - 1e-9)
    at = np.minimum(at, len(node) - 1)
    own = fresh & (np.abs(node[at] - time) < 1e-6)
    kept, last = [], -np.inf
    for i in np.flatnonzero(own):
        if time[i] - last > 0.999 * apart:
            kept.append(i)
            last = time[i]
    if not kept:
        return at[:0], read[:0], noise
    values, size = _averaged(time[fresh], read[fresh], np.searchsorted(np.flatnonzero(fresh), kept))
    return at[kept], values, noise / np.sqrt(size)


def _averaged(time: Floats, read: Floats, at: NDArray[np.int64]) -> tuple[Floats, float]:
    """Means of as many readings before the samples `at` as behind them, within half a LEAST_STEP, carried to the times
    of these samples; and how many readings make one."""
    half = 0.4999 * LEAST_STEP
    back = at - np.searchsorted(time, time[at] - half)
    reach = np.minimum(back, np.searchsorted(time, time[at] + half, side="right") - 1 - at)
    low, high = at - reach, at + reach
    count = high - low + 1
    sums = [np.append(0.0, np.cumsum(x - x[0])) for x in (time, read)]
    mean = [x[0] + (total[high + 1] - total[low]) / count for x, total in zip((time, read), sums)]
    slope = (read[high] - read[low]) / np.where(reach > 0, time[high] - time[low], 1.0)
    values = np.where(reach > 0, mean[1] + slope * (time[at] - mean[0]), read[at])
    return values, float(np.median(count))
