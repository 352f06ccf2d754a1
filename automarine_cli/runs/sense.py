"""Does a cleaned run make sense at all? Sentences for runs that cannot be what their columns say."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import median

FEWEST_SAMPLES = 8
LEAST_STUCK = 20  # samples of one exact position
TIMES_HELD = 4.0  # as long as other values: a sensor that answers seldom is not stuck
SLOWEST = 5.0  # s between samples; nobody logs a test more slowly
FASTEST = 2e-4  # s between samples
LARGEST_COMMAND = 1e12  # of any unit; beyond it arithmetic overflows
WHILE = 1.0  # s over which a way is measured: it is longer than its noise
RADIANS_AS_DEGREES = 2 * np.pi * np.pi / 180  # a whole turn in radians, read as degrees
DEGREES_AS_RADIANS = 360.0
IN_OTHER_UNITS = tuple(f"units look wrong: the {dof.position} " for dof in DOFS.values() if dof.wraps)
"""How the reasons begin that prove the unit of a column, and so of that column in all logs."""


def clock_trouble(time: Floats) -> str | None:
    """Why a clock, shape (N,), cannot be one of a test, or None."""
    if len(time) > 1 and np.ptp(time) == 0:
        return (
            f"units look wrong: the clock stands still at {time[0]:.10g} s in all {len(time)} rows; expected a rising "
            "clock. Look at the time column, or map another with --columns"
        )
    if len(time) < FEWEST_SAMPLES:
        return (
            f"only {len(time)} sample{'s' * (len(time) != 1)} left; at least {FEWEST_SAMPLES} are needed. "
            "Check that the log was not cut short"
        )
    period = median(np.diff(time))
    if period >= SLOWEST:
        return (
            f"units look wrong: {period:.4g} s between samples. If the clock counts milliseconds or "
            "microseconds, name it time_ms or time_us, or say so with --columns"
        )
    if period < FASTEST:
        return (
            f"units look wrong: {period:.3g} s between samples. If the clock counts seconds, name it time_s, "
            "or say so with --columns"
        )
    return None


def position_trouble(time: Floats, position: Floats, dof: Dof) -> str | None:
    """Why a position as logged, shape (N,) [rad or m], cannot be one of this motion, or None."""
    return _angle_trouble(time, position, dof) if dof.wraps else _way_trouble(time, position, dof)


def beyond(position: Floats, dof: Dof) -> NDArray[np.bool_]:
    """Which positions, (N,), are further than any vehicle gets: what some sensors say instead of nothing. Ways count
    from the middle one, since they may be measured from anywhere."""
    return np.asarray(np.abs(position - (0.0 if dof.wraps else median(position))) > dof.limits.far)


def _way_trouble(time: Floats, position: Floats, dof: Dof) -> str | None:
    name, column = dof.position, dof.column(dof.position, dof.units.log)
    largest = median(np.abs(position - position[0]))
    later = np.interp(time + WHILE, time, position)
    fastest = float(np.percentile(np.abs(later - position), 90)) / WHILE
    if largest > dof.limits.far:
        found = f"a {name} of {largest:.3g} {dof.units.base}"
    elif fastest > dof.limits.fast:
        found = f"the {name} changes by {fastest:.3g} {dof.units.base}/s"
    else:
        return None
    return (
        f"units look wrong: {found}. If it is in millimetres, say so with --columns, such as "
        f'{column} = {{ from = "{name}", unit = "mm" }}'
    )


def _angle_trouble(time: Floats, angle: Floats, dof: Dof) -> str | None:
    name, limits = dof.position, dof.limits
    degrees, radians = dof.column(name, "deg"), dof.column(name, "rad")
    largest = float(np.abs(angle).max())
    if largest > limits.far and median(np.abs(angle)) > limits.far:
        return (
            f"units look wrong: a {name} of {dof.shown(largest):.3g} {dof.words.units}. "
            f"Check which column is the {name}"
        )
    span, jumps = float(np.ptp(angle)), np.abs(np.diff(angle))
    if _wraps_at(RADIANS_AS_DEGREES, span, jumps):
        return (
            f"units look wrong: the {name} wraps at 2 pi where it should at 360 degrees. "
            f'If it is in radians, name it {radians}, or say unit = "rad" with --columns'
        )
    if _wraps_at(DEGREES_AS_RADIANS, span, jumps):
        return (
            f"units look wrong: the {name} wraps at 360 where it should at 2 pi radians. "
            f'If it is in degrees, name it {degrees}, or say unit = "deg" with --columns'
        )
    speed = median(jumps / np.diff(time)) if span > 2 * dof.turn else 0.0
    if speed > limits.fast:
        return (
            f"units look wrong: the {name} changes by {speed:.3g} rad/s. If it is in degrees, "
            f'name it {degrees}, or say unit = "deg" with --columns'
        )
    return None


def command_trouble(command: Floats, name: str) -> str | None:
    """Why a moment, force or thruster command, shape (N,), cannot be one, or None."""
    largest = float(np.abs(command).max(initial=0.0))
    if largest <= LARGEST_COMMAND:
        return None
    return f"units look wrong: a {name} of {largest:.3g}. Check which column is the {name}"


def _wraps_at(turn: float, span: float, jumps: Floats) -> bool:
    """Whether an angle stays within one `turn` [rad] and jumps by most of it, smooth otherwise."""
    return bool(span <= 1.001 * turn and jumps.max() > 0.75 * turn and median(jumps) < 0.05 * turn)


def stuck(position: Floats, command: Floats, dof: Dof) -> str | None:
    """Why a position that repeats one value while a command acts is unusable, or None."""
    acting = command != 0
    if not acting.any():
        return None
    longest, at = longest_repeat(position, acting)
    if longest >= max(LEAST_STUCK, acting.sum() / 2) and not is_slow(position, longest):
        where = dof.shown(at) % 360 if dof.wraps else dof.shown(at)
        words = dof.words
        return (
            f"{words.sensor} stuck: {longest} samples of exactly {where:.6g} {words.units} while a {words.force} acts. "
            f"Check the {words.sensor} and its cable, or whether the vehicle was held"
        )
    return None


def is_slow(position: Floats, repeats: int) -> bool:
    """Whether `repeats` of one value are how the sensor works: it answers more seldom than the log asks, so that the
    other values of the run, (N,), are held for about as long."""
    edges = np.flatnonzero(np.diff(position)) + 1
    held = np.sort(np.diff(np.concatenate([[0], edges, [len(position)]])))[:-1]
    if not len(held):
        return False
    usual = np.repeat(held, held)  # each sample asks how long its own value stays
    return bool(repeats <= TIMES_HELD * np.median(usual))


def longest_repeat(position: Floats, where: NDArray[np.bool_]) -> tuple[int, float]:
    """Length and value of the longest stretch of one exact position among the samples `where`."""
    same = np.diff(position) == 0
    if not same.any():
        return 1, float(position[0])
    same &= where[1:] & where[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return 1, float(position[0])
    best = int(np.argmax(stops - starts))
    return int(stops[best] - starts[best]) + 1, float(position[starts[best]])
