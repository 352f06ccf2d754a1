"""Most runs have nothing to clean: a few looks at all of their samples say so, and spare the rest."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.sense import FASTEST, FEWEST_SAMPLES, LARGEST_COMMAND, LEAST_STUCK, RADIANS_AS_DEGREES, SLOWEST
from automarine_cli.runs.unwrap import LOCAL, find_spikes, wrapped

MOST_UNEVEN = 1.5
"""Longest over shortest time between samples of a plain run."""


def plain_position(time: Floats, position: Floats, commands: Sequence[Floats], dof: Dof) -> Floats | None:
    """The position, (N,), unwrapped, of a run that cleaning would leave as it is otherwise; else None.

    Every condition is at least as strict as the one that the thorough way asks: no value missing, a clock that rises
    evenly, a position of a sensible size and speed without jumps, spikes or standstill of the sensor, commands of a
    sensible size.
    """
    if len(time) < max(FEWEST_SAMPLES, LOCAL) or not np.isfinite(time.sum() + position.sum()):
        return None
    spans = time[1:] - time[:-1]
    shortest, longest = spans.min(), spans.max()
    if not (shortest >= FASTEST and longest < SLOWEST and longest <= MOST_UNEVEN * shortest):
        return None
    for command in commands:
        if not (command.max() <= LARGEST_COMMAND and command.min() >= -LARGEST_COMMAND):  # nor of a missing one
            return None
    low, high = position.min(), position.max()
    span = high - low
    if (max(high, -low) if dof.wraps else span) > dof.limits.far:
        return None
    if dof.wraps and not RADIANS_AS_DEGREES * 1.01 < span < 2 * dof.turn:
        return None
    raw = position[1:] - position[:-1]
    if np.count_nonzero(raw) < len(raw) - LEAST_STUCK + 2:
        return None
    steps, turned = raw, np.zeros(0, dtype=int)
    if dof.wraps and (turned := np.flatnonzero(np.abs(raw) > dof.turn / 2)).size:
        steps = raw.copy()
        steps[turned] = wrapped(raw[turned], dof.turn)
    bend = np.abs(steps[1:] - steps[:-1])
    if max(steps.max(), -steps.min()) > min(dof.limits.jump, dof.limits.end_spike, dof.limits.fast * shortest):
        return None
    if find_spikes(time, position, steps, spans, bend, dof).any():
        return None
    if not turned.size:
        return position
    turns = np.zeros(len(position))
    turns[turned + 1] = steps[turned] - raw[turned]
    return position + np.cumsum(turns)
