"""Most runs have nothing to clean: a few looks at all samples of all of them say so, and spare the rest."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Indices, Mask
from automarine_cli.runs.sense import FASTEST, FEWEST_SAMPLES, LARGEST_COMMAND, LEAST_STUCK, RADIANS_AS_DEGREES, SLOWEST
from automarine_cli.runs.unwrap import LOCAL, Track, find_spikes

MOST_UNEVEN = 1.5
"""Longest over shortest time between samples of a plain run."""


def plain_positions(
    time: Floats, position: Floats, commands: Sequence[Floats], edges: Indices, dof: Dof
) -> tuple[Mask, Floats]:
    """Which of several runs one behind the other, (R,), cleaning would leave as they are but for the turns of their
    positions, and these positions, (N,), unwrapped; samples `edges[r]` to `edges[r + 1] - 1` are those of run r.

    Every condition is at least as strict as the one that the thorough way asks: no value missing, a clock that rises
    evenly, a position of a sensible size and speed without jumps, spikes or standstill of the sensor, commands of a
    sensible size.
    """
    starts, limits, track = edges[:-1], dof.limits, Track(time, position, edges, dof)

    def lowest(values: Floats) -> Floats:
        return np.minimum.reduceat(values, starts)

    def highest(values: Floats) -> Floats:
        return np.maximum.reduceat(values, starts)

    plain = np.diff(edges) >= max(FEWEST_SAMPLES, LOCAL)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # a missing value passes no comparison
        shortest, longest = lowest(track.spans), highest(track.spans)
        plain &= (shortest >= FASTEST) & (longest < SLOWEST) & (longest <= MOST_UNEVEN * shortest)
        for command in commands:
            plain &= (highest(command) <= LARGEST_COMMAND) & (lowest(command) >= -LARGEST_COMMAND)
        low, high = lowest(position), highest(position)
        span = high - low
        plain &= (np.maximum(high, -low) if dof.wraps else span) <= limits.far
        still = track.raw == 0
        still[edges[1:] - 1] = False
        plain &= np.diff(np.searchsorted(np.flatnonzero(still), edges)) < LEAST_STUCK - 1
        largest = np.maximum(highest(track.steps), -lowest(track.steps))
        plain &= largest <= min(limits.jump, limits.end_spike)
        if dof.wraps:
            plain &= (span > RADIANS_AS_DEGREES * 1.01) & (span < 2 * dof.turn)
        else:
            plain &= largest <= limits.fast * shortest
        if not plain.any():
            return plain, position
        spikes = np.searchsorted(np.flatnonzero(find_spikes(track, plain)), edges)
    return plain & (np.diff(spikes) == 0), _unwrapped(track, plain)


def _unwrapped(track: Track, plain: Mask) -> Floats:
    """The positions (N,) without the turns of the runs that are `plain`, (R,)."""
    turned, edges = track.turned, track.edges
    run = np.searchsorted(edges, turned, side="right") - 1
    turned, run = turned[plain[run]], run[plain[run]]
    if not turned.size:
        return track.position
    turns, own = track.steps[turned] - track.raw[turned], np.flatnonzero(np.diff(run)) + 1
    levels = np.concatenate([np.cumsum(one) for one in np.split(turns, own)])
    every = np.zeros(len(turned) + len(edges))  # after each turn, and from the start of each run on
    begins = np.concatenate([turned + 1, edges])
    order = np.argsort(begins, kind="stable")
    every[: len(turned)] = levels
    return track.position + np.repeat(every[order], np.diff(begins[order], append=len(track.position)))
