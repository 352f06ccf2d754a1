"""From the truth to the log: what a logger with a rate, a clock, sensors and losses makes of a run."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.simulation.plans import Plan
from automarine_cli.simulation.settings import Logger
from automarine_cli.simulation.streams import normal, uniform

DECIMALS = 3  # of seconds, degrees and metres in every log
MOMENT_DECIMALS = 6
EARLY_END = 40.0 / 60.0  # of the least way: where a run that ends early ends
STUCK_AFTER = 5  # samples of the step before the sensor sticks


@dataclass(frozen=True)
class Log:
    """What is in one run's log: `time_s`, `position`, `moment` (of a translation the force) and perhaps `rate`, shape
    (N,), in the unit of logs, rounded.

    `lost` samples were dropped, `glitches` left in.
    """

    time_s: Floats
    position: Floats
    moment: Floats
    rate: Floats | None
    lost: int
    glitches: int


def sample_times(plan: Plan, logger: Logger, seed: int) -> Floats:
    """Instants of the samples since the run's nominal first one [s], shape (N,); never falling."""
    even = np.asarray(np.arange(plan.samples) * logger.period, dtype=np.float64)
    if logger.clock_jitter_s == 0:
        return even
    off = logger.clock_jitter_s * normal(plan.samples, seed, plan.key, "clock")
    return np.asarray(even + np.clip(off, -0.45 * logger.period, 0.45 * logger.period))


def switch_times(plan: Plan, logger: Logger, seed: int) -> Floats:
    """Instants at which the commands change [s], each anywhere within the sample interval before it shows."""
    share = uniform(len(plan.changes), seed, plan.key, "switch")
    return np.asarray((np.array(plan.changes, dtype=float) - share) * logger.period)


def commanded(time: Floats, switches: Floats, moments: tuple[float, ...]) -> Floats:
    """The command in force at each `time` [s]: nothing before the first switch."""
    return np.concatenate([[0.0], moments])[np.searchsorted(switches, time, side="right")]


def log_run(
    plan: Plan, logger: Logger, seed: int, time: Floats, position: Floats, rate: Floats, switches: Floats, dof: Dof
) -> Log:
    """The log of a run whose sensors would read `position` [rad or m] and `rate` [rad/s or m/s] at `time` [s since
    its first sample] without noise, all of shape (N,).
    """
    count = len(time)
    reading = dof.logged(position) + logger.noise * normal(count, seed, plan.key, "noise")
    glitch = uniform(count, seed, plan.key, "glitch") < logger.glitch
    side = np.where(uniform(count, seed, plan.key, "glitch side") < 0.5, -1.0, 1.0)
    reading = reading + np.where(glitch, side * logger.glitch_size, 0.0)
    moment = commanded(time, switches, plan.moments)
    kept = uniform(count, seed, plan.key, "lost") >= logger.dropout
    lost = int(np.count_nonzero(~kept))
    if plan.group.fault == "stuck-compass" and plan.changes:
        stuck = min(plan.changes[0] + STUCK_AFTER, count - 1)
        reading[stuck:] = reading[stuck]
    if plan.group.fault == "ends-early":
        beyond = np.abs(position - position[0]) > EARLY_END * dof.limits.least
        kept[int(np.argmax(beyond)) if beyond.any() else count // 2 :] = False
    sensed = None
    if logger.rate_noise is not None:
        noise = logger.rate_noise * normal(count, seed, plan.key, "rate noise")
        sensed = _rounded(dof.logged(rate) + noise, DECIMALS)[kept]
    return Log(
        time_s=_rounded(plan.start + time, DECIMALS)[kept],
        position=_wrapped(reading, logger)[kept],
        moment=_rounded(moment, MOMENT_DECIMALS)[kept],
        rate=sensed,
        lost=lost,
        glitches=int(np.count_nonzero(glitch & kept)),
    )


def _wrapped(reading: Floats, logger: Logger) -> Floats:
    """Quantised, wrapped and rounded as the sensor says it."""
    if logger.quantisation > 0:
        reading = np.round(reading / logger.quantisation) * logger.quantisation
    if logger.wrap == "none":
        return _rounded(reading, DECIMALS)
    low = 0.0 if logger.wrap == "0..360" else -180.0
    wrapped = _rounded((reading - low) % 360.0, DECIMALS)
    return _rounded(np.where(wrapped >= 360.0, 0.0, wrapped) + low, DECIMALS)


def _rounded(values: Floats, decimals: int) -> Floats:
    """Rounded, and no negative zeros."""
    return np.asarray(np.round(values, decimals) + 0.0)
