"""Jumps of a position that no vehicle makes: samples are missing that the clock does not miss, or a sensor slips."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.runs.unwrap import scatter_of_steps, wrapped

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

AROUND = 6
"""Steps on either side with which a jump is compared."""
TIMES_FASTER = 3.0
"""How much faster than any of them it is."""
JUMP_IN_SIGMA = 5.0
"""Of steps that are noise."""


def find_jumps(time: Floats, position: Floats, dof: Dof) -> Indices:
    """After which samples, of a position (N,) [rad or m] without spikes, a jump follows that stays.

    A jump is a step beyond noise that is several times faster than every step beside it, on both sides, and that a
    vehicle would need more than the motion's largest acceleration to begin and to end within its span (two parabolas:
    four times the step by the square of the span). A sensor that had stopped catches up over the span since its last
    change. What comes back is no jump, nor is a move, whose rate has to grow and to fall.
    """
    most = dof.limits.acceleration
    steps, spans = wrapped(np.diff(position), dof.turn), np.diff(time)
    speeds, least = np.abs(steps) / spans, dof.limits.jump
    if len(steps) > 1:
        least = max(least, JUMP_IN_SIGMA * scatter_of_steps(np.abs(np.diff(steps))))
    found = []
    for i in np.flatnonzero((np.abs(steps) > least) & (4.0 * speeds > most * spans)):
        last = int(i)
        while last > 0 and steps[last - 1] == 0:
            last -= 1
        span = time[i + 1] - time[last]
        before, after = speeds[max(last - AROUND, 0) : last], speeds[i + 1 : i + 1 + AROUND]
        if min(len(before), len(after)) < AROUND // 2:
            continue
        size, fastest = abs(steps[i]), max(before.max(), after.max())
        if size > TIMES_FASTER * fastest * span and 4.0 * size > most * span**2:
            found.append(int(i))
    return np.array(found, dtype=int)
