"""Does a cleaned run make sense at all? Sentences for runs that cannot be what their columns say."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import YAW, Dof
from automarine_cli.runs.noise import median

Floats = NDArray[np.float64]
FEWEST_SAMPLES = 8
LEAST_STUCK = 20  # samples of one exact heading
SLOWEST = 5.0  # s between samples; nobody logs a yaw test more slowly
FASTEST = 2e-4  # s between samples
LARGEST_MOMENT = 1e12  # of either unit; beyond it arithmetic overflows
LARGEST_HEADING = 1000 * 2 * np.pi
FARTHEST = 500.0  # m; no test that this is for goes as far
FASTEST_TURN = 8 * np.pi  # rad/s; four turns a second
RADIANS_AS_DEGREES = 2 * np.pi * np.pi / 180  # a whole turn in radians, read as degrees
DEGREES_AS_RADIANS = 360.0


def clock_trouble(time: Floats) -> str | None:
    """Why a clock, shape (N,), cannot be one of a yaw test, or None."""
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
    """Why a position as logged, shape (N,), cannot be one of this motion, or None."""
    if dof.wraps:
        return heading_trouble(time, position)
    largest = median(np.abs(position - position[0]))
    if largest <= FARTHEST:
        return None
    name = dof.position
    return (
        f"units look wrong: a {name} of {largest:.3g} m. If it is in millimetres, say so with --columns, such as "
        f'{name}_m = {{ from = "{name}", unit = "mm" }}'
    )


def heading_trouble(time: Floats, heading: Floats) -> str | None:
    """Why a heading as logged, shape (N,) [rad], cannot be one, or None."""
    largest = float(np.abs(heading).max())
    if largest > LARGEST_HEADING and median(np.abs(heading)) > LARGEST_HEADING:
        return (
            f"units look wrong: a heading of {np.rad2deg(largest):.3g} degrees. "
            "Check which column is the heading"
        )
    span, jumps = float(np.ptp(heading)), np.abs(np.diff(heading))
    if _wraps_at(RADIANS_AS_DEGREES, span, jumps):
        return (
            "units look wrong: the heading wraps at 2 pi where it should at 360 degrees. "
            'If it is in radians, name it heading_rad, or say unit = "rad" with --columns'
        )
    if _wraps_at(DEGREES_AS_RADIANS, span, jumps):
        return (
            "units look wrong: the heading wraps at 360 where it should at 2 pi radians. "
            'If it is in degrees, name it heading_deg, or say unit = "deg" with --columns'
        )
    speed = median(jumps / np.diff(time)) if span > 4 * np.pi else 0.0
    if speed > FASTEST_TURN:
        return (
            f"units look wrong: the heading changes by {speed:.3g} rad/s. If it is in degrees, "
            'name it heading_deg, or say unit = "deg" with --columns'
        )
    return None


def command_trouble(command: Floats, name: str) -> str | None:
    """Why a moment or thruster command, shape (N,), cannot be one, or None."""
    largest = float(np.abs(command).max(initial=0.0))
    if largest <= LARGEST_MOMENT:
        return None
    return f"units look wrong: a {name} of {largest:.3g}. Check which column is the {name}"


def _wraps_at(turn: float, span: float, jumps: Floats) -> bool:
    """Whether a heading stays within one `turn` [rad] and jumps by most of it, smooth otherwise."""
    return bool(span <= 1.001 * turn and jumps.max() > 0.75 * turn and median(jumps) < 0.05 * turn)


def stuck(heading: Floats, command: Floats, dof: Dof = YAW) -> str | None:
    """Why a heading that repeats one value while a moment acts does not serve, or None."""
    acting = command != 0
    if not acting.any():
        return None
    longest, at = longest_repeat(heading, acting)
    if longest >= max(LEAST_STUCK, acting.sum() / 2):
        where = dof.shown(at) % 360 if dof.wraps else dof.shown(at)
        return dof.say(
            f"compass stuck: {longest} samples of exactly {where:.6g} degrees while a moment "
            "acts. Check the compass and its cable, or whether the vehicle was held"
        )
    return None


def longest_repeat(heading: Floats, where: NDArray[np.bool_]) -> tuple[int, float]:
    """Length and value of the longest stretch of one exact heading among the samples `where`."""
    same = np.diff(heading) == 0
    if not same.any():
        return 1, float(heading[0])
    same &= where[1:] & where[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return 1, float(heading[0])
    best = int(np.argmax(stops - starts))
    return int(stops[best] - starts[best]) + 1, float(heading[starts[best]])
