"""One continuous position from a sensor that wraps, skips and spikes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import NORMAL, median

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

TURN = 2 * np.pi
SPIKE_IN_SIGMA = 8.0
LONGEST_SPIKE = 2  # samples
LOCAL = 9  # samples; of fewer nothing can be told
ENOUGH = 1000  # second differences
LONGEST_BRIDGE = 60.0  # s; over a longer gap anything may have happened
FASTER = 1.5  # than nearly all of the run: nothing turns so across a gap


def wrapped(angle: Floats, turn: float = TURN) -> Floats:
    """The same angle within half a `turn` to either side; as it is if the position never comes back to itself (`turn`
    is infinite)."""
    return angle - turn * np.ceil(angle / turn - 0.5) if turn < np.inf else angle


def short_steps(position: Floats, dof: Dof) -> Floats:
    """Return the differences of positions (N,) from sample to sample, the short way round, (N - 1,)."""
    steps = position[1:] - position[:-1]
    if dof.wraps:
        far = np.abs(steps) >= dof.turn / 2
        if far.any():
            steps[far] = wrapped(steps[far], dof.turn)
    return steps


def _scatter(steps: Floats) -> float:
    """Robust standard deviation of steps (N - 1,), by their second differences: those of white noise are root three
    times as wide. A thousand of them are enough; 0 for fewer than two steps."""
    if len(steps) < 2:
        return 0.0
    bend = np.abs(np.diff(steps))
    return NORMAL * median(bend[:: 1 + len(bend) // ENOUGH]) / np.sqrt(3.0)


def find_glitches(time: Floats, position: Floats, dof: Dof) -> Mask:
    """Find spikes of one or two samples in a position (N,) [rad or m]: far off both neighbours, which agree.

    A spike stands out against the local rate by eight robust standard deviations and the motion's least spike, and by
    half as much again as the vehicle moves from sample to sample around it; the samples on either side of it
    continue each other. A jump that stays (a stale sensor that catches up) is no spike, nor is a sharp
    reversal.
    """
    bad = np.zeros(len(time), dtype=bool)
    if len(time) < LOCAL:
        return bad
    limits, steps, spans = dof.limits, short_steps(position, dof), np.diff(time)
    bend = np.abs(np.diff(steps))
    # two steps in a row differ by 2/3 of a spike's size or more, less what an uneven clock adds
    share = 0.99 * (2 / 3 - (spans.max() / spans.min() - 1.0) / 1.5)
    everywhere = share < 0.2 or bool(np.abs(steps).max() > limits.large_step)
    ends = np.abs(np.concatenate([steps[:LONGEST_SPIKE], steps[-LONGEST_SPIKE:]])).max() > 0.99 * limits.end_spike
    if not (everywhere or ends or bend.max() > share * limits.spike):
        return bad
    threshold = max(limits.spike, SPIKE_IN_SIGMA * _scatter(steps))
    bent = np.arange(len(time)) if everywhere else np.flatnonzero(bend > share * threshold)
    for width in range(1, LONGEST_SPIKE + 1) if len(bent) else ():
        before = np.unique(np.concatenate([bent - k for k in range(width)]))
        before = before[(before >= 0) & (before < len(time) - 1 - width)]
        after = before + width + 1
        rate = _median_beside(steps / spans, before, after)
        off = [np.abs(_off(time, position, rate, before, before + k, dof)) for k in range(1, width + 2)]
        size, across = np.max(off[:-1], axis=0), off[-1]
        spike = (size > threshold) & (across < threshold) & (size > 3 * across)
        spike &= size > 1.5 * _median_beside(np.abs(steps), before, after)
        spike &= ~np.any([bad[before + k] for k in range(width + 2)], axis=0)
        for k in range(1, width + 1):
            bad[before[spike] + k] = True
    return bad | _end_spikes(time, position, max(threshold, limits.end_spike), dof) if ends else bad


def _median_beside(steps: Floats, before: Indices, after: Indices) -> Floats:
    """The median of the three steps that lead to sample `before` and the three that leave sample `after`, (M,), as far
    as the first and last step."""
    places = np.array([before - 3, before - 2, before - 1, after, after + 1, after + 2])
    values = np.sort(steps[np.clip(places, 0, len(steps) - 1)], axis=0)
    return np.asarray((values[2] + values[3]) / 2)


def _off(time: Floats, position: Floats, rate: Floats, start: Indices, stop: Indices, dof: Dof) -> Floats:
    return wrapped(position[stop] - position[start] - rate * (time[stop] - time[start]), dof.turn)


def _end_spikes(time: Floats, position: Floats, threshold: float, dof: Dof) -> Mask:
    """Spikes at the very first and last samples: far off what the next samples, which agree, lead to."""
    bad = np.zeros(len(time), dtype=bool)
    for order in (np.arange(len(time)), np.arange(len(time))[::-1]):
        for width in range(1, LONGEST_SPIKE + 1):
            inner = order[width : width + 6]
            steps = wrapped(np.diff(position[inner]), dof.turn)
            rate = np.array(np.median(steps / np.diff(time[inner])))
            jump = abs(float(wrapped(position[inner[0]] - position[order[width - 1]], dof.turn)))
            agree = np.abs(_off(time, position, rate, inner[:-1], inner[1:], dof)) < threshold / 4
            far = np.abs(_off(time, position, rate, np.repeat(inner[0], width), order[:width], dof)) > threshold
            # a vehicle at rest that starts to turn is far off as well, but it begins with a small step
            if agree.all() and far.all() and jump > max(threshold, 2 * float(np.median(np.abs(steps)))):
                bad[order[:width]] = True
                break
    return bad


AROUND = 6  # Steps on either side with which a jump is compared
TIMES_FASTER = 3.0  # How much faster than any of them it is
JUMP_IN_SIGMA = 5.0  # Of steps that are noise


def find_jumps(time: Floats, position: Floats, dof: Dof) -> Indices:
    """Find the samples, of a position (N,) [rad or m] without spikes, after which a jump follows that stays.

    A jump is a step beyond noise that is several times faster than every step beside it, on both sides, and that a
    vehicle would need more than the motion's largest acceleration to begin and to end within its span (two parabolas:
    four times the step by the square of the span). A sensor that had stopped catches up over the span since its last
    change. What comes back is no jump, nor is a move, whose rate has to grow and to fall.
    """
    most = dof.limits.acceleration
    steps, spans = short_steps(position, dof), np.diff(time)
    sizes = np.abs(steps)
    large = np.flatnonzero((sizes > dof.limits.jump) & (4.0 * sizes > most * spans**2))
    if not large.size:
        return large
    speeds, least = sizes / spans, max(dof.limits.jump, JUMP_IN_SIGMA * _scatter(steps))
    jumps = []
    for i in large[sizes[large] > least].tolist():
        last = i
        while last > 0 and steps[last - 1] == 0:
            last -= 1
        span = time[i + 1] - time[last]
        before, after = speeds[max(last - AROUND, 0) : last], speeds[i + 1 : i + 1 + AROUND]
        if min(len(before), len(after)) < AROUND // 2:
            continue
        fastest = max(before.max(), after.max())
        if sizes[i] > TIMES_FASTER * fastest * span and 4.0 * sizes[i] > most * span**2:
            jumps.append(i)
    return np.array(jumps, dtype=int)


@dataclass(frozen=True)
class Unwrapped:
    """Position of shape (N,) [rad or m], and after which samples the turn count is unknown (a gap too wide to
    bridge).
    """

    position: Floats
    broken_after: tuple[int, ...]


def unwrap(time: Floats, position: Floats, gaps: Indices, dof: Dof) -> Unwrapped:
    """Unwrap a heading; `gaps` are the samples after which the log has a hole. What never wraps is whole as it is.

    Between samples the shortest way is taken. Across a hole the rates on both sides say how far the vehicle
    turned; if they leave it open by more than a quarter of a turn, and the vehicle was seen fast enough to turn as far
    in that time, the run breaks there. A log that counts turns itself (more than a turn wide, without jumps) is taken
    as it is.
    """
    turn = dof.turn
    if not dof.wraps:
        return Unwrapped(position, ())
    raw = np.diff(position)
    inside = np.ones(len(raw), dtype=bool)
    inside[gaps] = False
    if np.ptp(position) > 1.01 * turn and np.all(np.abs(raw[inside]) < turn / 2):
        return Unwrapped(position, ())
    steps = wrapped(raw, turn)
    fastest = np.inf
    if gaps.size and inside.any():
        fastest = FASTER * float(np.percentile(np.abs(steps[inside]) / np.diff(time)[inside], 99))
    broken = []
    for gap in gaps:
        span = time[gap + 1] - time[gap]
        before, after = _side_rate(time, steps, gap - 1, -1, gaps), _side_rate(time, steps, gap + 1, 1, gaps)
        predicted = span * (before[0] + after[0]) / 2
        doubt = span * min(fastest, abs(after[0] - before[0]) / 2 + before[1] + after[1])
        if doubt > turn / 4 or span > LONGEST_BRIDGE:
            broken.append(int(gap))
        steps[gap] = predicted + wrapped(np.asarray(raw[gap] - predicted), turn)
    turns = np.cumsum(np.round((steps - raw) / turn))
    return Unwrapped(np.concatenate([position[:1], position[1:] + turn * turns]), tuple(broken))


def _side_rate(time: Floats, steps: Floats, start: int, way: int, gaps: Indices) -> tuple[float, float]:
    """Yaw rate [rad/s] and its doubt just beside a gap, from up to eight steps on one side of it."""
    others = set(gaps.tolist())
    indices: list[int] = []
    i = start
    while 0 <= i < len(steps) and i not in others and len(indices) < 8:
        indices.append(i)
        i += way
    if len(indices) < 2:
        return 0.0, np.inf
    chosen = np.array(indices)
    spans = time[chosen + 1] - time[chosen]
    rate = float(steps[chosen].sum() / spans.sum())
    scatter = float(np.std(steps[chosen] - rate * spans))
    return rate, 2 * scatter / float(spans.sum())
