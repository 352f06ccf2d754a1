"""Jumps of the heading that no vehicle makes: samples are missing that the clock does not miss, or a compass slips."""

import numpy as np
from numpy.typing import NDArray

from automarine_cli.runs.unwrap import TURN, wrapped

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LEAST_JUMP = np.deg2rad(15)
AROUND = 6
"""Steps on either side with which a jump is compared."""
TIMES_FASTER = 3.0
"""How much faster than any of them it is."""
FASTEST_SWING = 60.0
"""Acceleration [rad/s²] that no vehicle reaches which yaw tests are made with: a small one has a moment of 10 N m on
0.2 kg m²."""


def find_jumps(time: Floats, heading: Floats, turn: float = TURN) -> Indices:
    """After which samples, of a heading (N,) [rad] without spikes, a jump follows that stays.

    A jump is a step that is several times faster than every step beside it, on both sides, and that a vehicle would
    need more than FASTEST_SWING to begin and to end within its span (two parabolas: four times the step by the
    square of the span). A compass that had stopped catches up over the span since its last change. What comes back
    is no jump, nor is a turn, whose rate has to grow and to fall.
    """
    steps, spans = wrapped(np.diff(heading), turn), np.diff(time)
    speeds = np.abs(steps) / spans
    found = []
    for i in np.flatnonzero((np.abs(steps) > LEAST_JUMP) & (4.0 * speeds > FASTEST_SWING * spans)):
        last = int(i)
        while last > 0 and steps[last - 1] == 0:
            last -= 1
        span = time[i + 1] - time[last]
        before, after = speeds[max(last - AROUND, 0) : last], speeds[i + 1 : i + 1 + AROUND]
        if min(len(before), len(after)) < AROUND // 2:
            continue
        size, fastest = abs(steps[i]), max(before.max(), after.max())
        if size > TIMES_FASTER * fastest * span and 4.0 * size > FASTEST_SWING * span**2:
            found.append(int(i))
    return np.array(found, dtype=int)
