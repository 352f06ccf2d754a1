"""Readings of a sensor as a filter takes them: which count as independent, how noisy they are, means of fast ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from automarine_cli.dofs import Motion
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import NORMAL, Run, fresh_readings, median, position_noise

MIN_STEP_S = 0.05
"""Step [s] between readings that each tell something new: a controller answers each, and the commands would tell of
those left out."""
INDEPENDENT = 0.7
"""Share of the noise of every other reading that all of them have at least where each tells something new: filtered
readings differ less from their neighbours."""
MIN_APART_S = 0.5
"""Least time [s] between readings whose noise is below what sensors have: such were filtered, and hang together."""
SMOOTH_GYRO = 0.25
"""Share of a compass' least noise [per s] below which a gyro was filtered, or its rate is derived from headings."""
MIN_ANSWER, ANSWER_SAMPLES = 0.2, 2
"""Correlation of the noise of readings with that of commands, at most so many samples before or later, from which on a
controller answers each reading."""
RECALLED, LIMITED, ROUNDS = 3, 0.999, 10
"""Samples that a controller recalls, the share of the largest command from which on it is at a limit, and rounds of a
robust fit."""
UNLOGGED = 0.1  # size of the changes that readings do not explain, in those by their noise, from which on they lack
GLITCH = 4.5  # times the usual size, from which on changes are cut
LEAST_SHARE, QUIETEST = 0.5, 0.01
"""Share of the noise of answered readings that a fit finds at least; and of the usual floor, as below it they are of
a simulation."""


@dataclass(frozen=True)
class Readings:
    """What the readings of a quantity are like, as medians of the runs: their `noise` [base units, per s of a velocity]
    and the time `swing` [s] in which they change by their own size. `floor` is the noise below which they were filtered
    or derived, and count thinned; they are `answered` where their noise is in the commands."""

    quantity: str
    dof: int
    velocity: bool
    noise: float
    swing: float
    floor: float
    independent: bool
    answered: bool

    @property
    def thinned(self) -> bool:
        return self.noise < self.floor

    @classmethod
    def of(cls, runs: Sequence[Run], quantity: str, dof: int, motion: Motion) -> "Readings":
        """Measure the readings of runs. Independent ones that commands answer all count, however quiet they are."""
        velocity = quantity == motion.dofs[dof].velocity
        usual = (SMOOTH_GYRO if velocity and motion.dofs[dof].angular else 1.0) * motion.dofs[dof].limits.least_noise
        measures = list[list[float]]()
        for run in runs:
            if (readings := run.channel(quantity)) is not None:
                fresh = np.flatnonzero(fresh_readings(readings))
                every, other = (position_noise(run.time[at], readings[at]) for at in (fresh, fresh[::2]))
                slopes = np.diff(readings[fresh]) / np.diff(run.time[fresh])
                swing = float(np.std(readings[fresh]) / np.std(slopes)) if slopes.any() else 0.0
                answers = [_answers(run.command_of(each)[fresh], readings[fresh]) for each in motion.dofs]
                measures.append([every, other, swing, *np.concatenate(answers)])
        noise, other, swing, *answer = np.median(measures or [[0.0, 0.0, 0.0, 0.0]], axis=0).tolist()
        independent, answered = noise > INDEPENDENT * other, max(map(abs, answer)) > MIN_ANSWER
        floor = float(np.clip(LEAST_SHARE * noise, QUIETEST * usual, usual)) if independent and answered else usual
        return cls(quantity, dof, velocity, noise, swing, floor, independent, answered)


def _answers(command: Floats, readings: Floats) -> Floats:
    """Correlations of the noise of readings (N,) with that of a command (N,), so many samples before to later as
    ANSWER_SAMPLES; zero where the command is held. Fourth differences leave what is smooth out."""
    if len(readings) < 4 * ANSWER_SAMPLES:
        return np.zeros(2 * ANSWER_SAMPLES + 1)
    noise, answer = map(_rough_part, (readings, command))
    products = np.correlate(np.pad(answer, ANSWER_SAMPLES), noise)
    return np.asarray(products / (np.sqrt((noise @ noise) * (answer @ answer)) or 1.0))


def _rough_part(values: Floats) -> Floats:
    rough = np.diff(values, 4)
    most = GLITCH * median(np.abs(rough))
    return np.clip(rough, -most, most)


def answers_more(runs: Sequence[Run], sensors: Sequence[Readings]) -> bool:
    """Whether commands that answer the readings of one motion answer more than these, a gyro that is not logged.

    Their changes are told from the three before and those of the readings: what is left stands against what the noise
    of the readings makes of them. Least squares of absolute sizes, for wishes of a pilot come at once.
    """
    if not any(sensor.answered for sensor in sensors):
        return False
    rows, changes = list[Floats](), list[Floats]()
    for run in runs:
        channels = [run.command, *(c for sensor in sensors if (c := run.channel(sensor.quantity)) is not None)]
        if len(channels) <= len(sensors) or len(run) < RECALLED + 2:
            continue
        usable = np.isfinite(channels).all(axis=0) & (np.abs(run.command) < LIMITED * np.abs(run.command).max())
        steps = sliding_window_view(np.diff(channels, axis=1), RECALLED + 1, axis=1)
        steps = steps[:, sliding_window_view(usable, RECALLED + 2).all(axis=1)]
        rows.append(np.concatenate([steps[0, :, :-1], *steps[1:]], axis=1))
        changes.append(steps[0, :, -1])
    if sum(map(len, rows)) < 10 * (RECALLED + (RECALLED + 1) * len(sensors)):
        return False
    row, change = np.concatenate(rows), np.concatenate(changes)
    weight = np.ones(len(row))
    for _ in range(ROUNDS):
        answer = np.linalg.lstsq(row * weight[:, None], change * weight, rcond=None)[0]
        error = np.abs(change - row @ answer)
        weight = np.maximum(error, median(error) + 1e-12) ** -0.5
    by_sensor = np.split(answer[RECALLED:], len(sensors))
    through = [sensor.noise * np.linalg.norm(np.convolve(by, [1.0, -1.0])) for sensor, by in zip(sensors, by_sensor)]
    return bool(NORMAL * median(error) > UNLOGGED * np.linalg.norm(through))


def averaged_over(period: float) -> int:
    """Samples of a log with one each `period` [s] that make one reading: an odd number, of one MIN_STEP_S."""
    return 2 * int(0.4999 * MIN_STEP_S / max(period, 1e-9)) + 1


def readings_of(time: Floats, readings: Floats, node: Floats, floor: float) -> tuple[NDArray[np.int64], Floats, float]:
    """Which nodes have a reading, the readings, and their noise, of which less than `floor` is a filter's.

    Of a sensor that is faster than the filter the samples about a node are averaged, at the time of the node.
    """
    fresh = fresh_readings(readings)
    noise = position_noise(time[fresh], readings[fresh])
    apart = MIN_APART_S if noise < floor else 0.0
    at = np.searchsorted(node, time - 1e-9)
    at = np.minimum(at, len(node) - 1)
    close = fresh & (np.abs(node[at] - time) < 1e-6)
    chosen, last = [], -np.inf
    for i in np.flatnonzero(close):
        if time[i] - last > 0.999 * apart:
            chosen.append(i)
            last = time[i]
    if not chosen:
        return at[:0], readings[:0], noise
    values, size = _averaged(time[fresh], readings[fresh], np.searchsorted(np.flatnonzero(fresh), chosen))
    return at[chosen], values, noise / np.sqrt(size)


def _averaged(time: Floats, readings: Floats, at: NDArray[np.int64]) -> tuple[Floats, float]:
    """Means of as many readings before the samples `at` as behind them, within half a MIN_STEP_S, carried to the times
    of these samples; and how many readings make one."""
    half = 0.4999 * MIN_STEP_S
    back = at - np.searchsorted(time, time[at] - half)
    reach = np.minimum(back, np.searchsorted(time, time[at] + half, side="right") - 1 - at)
    low, high = at - reach, at + reach
    count = high - low + 1
    sums = [np.append(0.0, np.cumsum(x - x[0])) for x in (time, readings)]
    mean = [x[0] + (total[high + 1] - total[low]) / count for x, total in zip((time, readings), sums)]
    slope = (readings[high] - readings[low]) / np.where(reach > 0, time[high] - time[low], 1.0)
    values = np.where(reach > 0, mean[1] + slope * (time[at] - mean[0]), readings[at])
    return values, float(np.median(count))
