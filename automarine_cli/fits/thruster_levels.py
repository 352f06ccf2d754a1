"""Which points of a bollard test share a command, share a voltage, are left out together."""

import numpy as np

from automarine_cli.fits.thruster_points import Floats, Ints

SAME = 0.004  # commands within this share of full scale are one level
MANY = 24  # more levels than this in a direction are left out in blocks of neighbours
BLOCKS = 20
STEP = 0.03  # voltages further apart than this share are two nominal steps
MOST_STEPS = 12  # more voltage steps than this are a drifting supply, not steps


def levels_of(n: Floats) -> Ints:
    """Number of each control signal's level, shape (P,): equal to 0.4 % of full scale is one level."""
    order = np.argsort(n, kind="stable")
    width = SAME * float(np.max(np.abs(n), initial=0.0))
    level, first = np.zeros(len(n), dtype=np.int64), -np.inf
    number = -1
    for index in order:
        # Zero is a level of its own: a small command is not a tare reading.
        if n[index] - first > width or (n[index] == 0.0) != (first == 0.0):
            number, first = number + 1, float(n[index])
        level[index] = number
    return level


def groups_of(n: Floats) -> Ints:
    """What cross-validation leaves out together and what standard errors count as one: a level, shape (P,).

    Closely spaced tables (over 24 levels in a direction) go in 20 blocks of neighbouring levels: a misfit is
    alike in neighbours, so that one level of 100 is no independent witness.
    """
    level = levels_of(n)
    count = int(level.max(initial=-1)) + 1
    if count <= MANY:
        return level
    block = np.repeat(np.arange(BLOCKS), [len(part) for part in np.array_split(np.arange(count), BLOCKS)])
    return block[level].astype(np.int64)


def voltage_steps(voltage: Floats) -> Ints | None:
    """Number of the nominal supply step of each point, shape (P,), rising with the voltage.

    A new step starts where the sorted voltages jump by over 3 %; None without a voltage at every point, or
    where the supply drifts without steps.
    """
    if len(voltage) == 0 or not np.all(np.isfinite(voltage)) or np.any(voltage <= 0):
        return None
    order = np.argsort(voltage, kind="stable")
    jumps = np.diff(np.log(voltage[order])) > STEP
    step = np.zeros(len(voltage), dtype=np.int64)
    step[order[1:]] = np.cumsum(jumps)
    return step if int(step.max()) < MOST_STEPS else None
