"""One continuous position from a sensor that wraps, skips and spikes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import NORMAL, median

Indices = NDArray[np.int64]
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


def find_glitches(time: Floats, position: Floats, dof: Dof) -> NDArray[np.bool_]:
    """Which samples of a position [rad or m], shape (N,), are spikes of one or two samples: far off both neighbours,
    which agree.

    A spike stands out against the local rate by eight robust standard deviations and the motion's least spike, and by
    half as much again as the vehicle moves from sample to sample around it; the samples on either side of it
    continue each other. A jump that stays (a stale sensor that catches up) is no spike, nor is a sharp
    reversal.
    """
    count = len(time)
    bad = np.zeros(count, dtype=bool)
    if count < LOCAL:
        return bad
    steps, spans = wrapped(np.diff(position), dof.turn), np.diff(time)
    bend = np.abs(np.diff(steps))
    bad = find_spikes(time, position, steps, spans, bend, dof)
    if not _jumps_at_ends(position, dof):
        return bad
    return bad | _ends(time, position, max(spike_threshold(bend, dof), dof.limits.end_spike), dof.turn)


def find_spikes(
    time: Floats, position: Floats, steps: Floats, spans: Floats, bend: Floats, dof: Dof
) -> NDArray[np.bool_]:
    """The spikes, (N,), that are not at an end; `steps` and `spans` (N-1,) are those of position and time, `bend`
    (N-2,) the sizes of the differences of the steps."""
    bad, turn, threshold = np.zeros(len(time), dtype=bool), dof.turn, spike_threshold(bend, dof)
    for width in range(1, LONGEST_SPIKE + 1):
        before = _suspects(steps, spans, bend, width, threshold, dof.limits.large_step)
        if not before.size:
            continue
        after = before + width + 1
        rate = _median_beside(steps, before, after, spans)
        across = np.abs(_off(time, position, rate, before, after, turn))
        off = np.abs(_off(time, position, rate, before, before + 1, turn))
        for k in range(2, width + 1):
            off = np.maximum(off, np.abs(_off(time, position, rate, before, before + k, turn)))
        spike = (off > threshold) & (across < threshold) & (off > 3 * across)
        if not spike.any():
            continue
        around = _median_beside(np.abs(steps), before, after)
        spike &= off > 1.5 * around
        spike &= ~np.any([bad[before + k] for k in range(width + 2)], axis=0)
        for k in range(1, width + 1):
            bad[before[spike] + k] = True
    return bad


def spike_threshold(bend: Floats, dof: Dof) -> float:
    """From what size on [rad or m] a sample may be a spike, by the sizes of second differences, (M,), of a position."""
    return max(dof.limits.spike, SPIKE_IN_SIGMA * scatter_of_steps(bend))


def scatter_of_steps(bend: Floats) -> float:
    """Standard deviation of the steps of a position that are noise, by the sizes of its second differences, (M,).

    Those of white noise are root three times as wide as its steps. A thousand of them are enough.
    """
    some = bend[:: 1 + len(bend) // ENOUGH]
    return float(NORMAL * median(some) / np.sqrt(3.0))


def _suspects(steps: Floats, spans: Floats, bend: Floats, width: int, threshold: float, large_step: float) -> Indices:
    """The samples, shape (M,), that a spike of `width` samples may follow: a look at differences of steps spares
    the medians of nearly all samples of a log, and leaves out none that is a spike.

    With X the steps less the local rate r, a spike has |X1 + ... + Xk| = off > threshold for some k <= width,
    |X1 + ... + X(width + 1)| < off / 3, and |r| span < off / 1.5 (the median of |step| around). Then two steps in a row
    differ by 4/3 off or more if one sample is off, by 2/3 off if two are, less what an uneven clock adds. That holds
    where no sum of steps passes half a turn, and is asked of the rest in full.
    """
    share = 2 / 3 - (float(spans.max() / spans.min()) - 1.0) / 1.5
    last = len(steps) - width
    largest = max(float(steps.max()), -float(steps.min()))
    large = np.flatnonzero(np.abs(steps) > large_step) if largest > large_step else np.zeros(0, dtype=int)
    if share < 0.2 or len(large) > 2:
        return np.arange(last)
    suspect = np.concatenate([np.flatnonzero(bend > 0.99 * share * threshold), large, large - 1])
    found = np.unique(np.concatenate([suspect - k for k in range(width)])) if suspect.size else suspect
    if large.size:  # at the ends of the log a step stands for its missing neighbours too
        found = np.union1d(found, [*range(4), *range(last - 4, last)])
    return found[(found >= 0) & (found < last)]


def _median_beside(steps: Floats, before: Indices, after: Indices, spans: Floats | None = None) -> Floats:
    """The median of the three steps that lead to sample `before` and the three that leave sample `after`, (M,); of
    their rates where the `spans` of the steps are given."""
    places = np.array([before - 3, before - 2, before - 1, after, after + 1, after + 2])
    inside = np.minimum(np.maximum(places, 0), len(steps) - 1)
    values = steps[inside] if spans is None else steps[inside] / spans[inside]
    values.sort(axis=0)
    return np.asarray((values[2] + values[3]) / 2)


def _off(time: Floats, position: Floats, rate: Floats, here: Indices, there: Indices, turn: float) -> Floats:
    """How far `position[there]` is from `position[here]` carried on at `rate`, modulo a turn."""
    return wrapped(position[there] - position[here] - rate * (time[there] - time[here]), turn)


def _jumps_at_ends(position: Floats, dof: Dof) -> bool:
    """Whether any of the first or last steps is large enough for a spike there: only one side can be compared with."""
    near = LONGEST_SPIKE + 1
    steps = np.concatenate([np.diff(position[:near]), np.diff(position[-near:])])
    return bool(np.abs(wrapped(steps, dof.turn)).max() > 0.99 * dof.limits.end_spike)


def _ends(time: Floats, position: Floats, threshold: float, turn: float) -> NDArray[np.bool_]:
    """Spikes at the very first and last samples: far off what the next samples, which agree, lead to."""
    count = len(time)
    bad = np.zeros(count, dtype=bool)
    for order in (np.arange(count), np.arange(count)[::-1]):
        for width in range(1, LONGEST_SPIKE + 1):
            inner = order[width : width + 6]
            steps = wrapped(np.diff(position[inner]), turn)
            rate = np.array(np.median(steps / np.diff(time[inner])))
            jump = abs(float(wrapped(position[inner[0]] - position[order[width - 1]], turn)))
            agree = np.abs(_off(time, position, rate, inner[:-1], inner[1:], turn)) < threshold / 4
            far = np.abs(_off(time, position, rate, np.repeat(inner[0], width), order[:width], turn)) > threshold
            # a vehicle at rest that starts to turn is far off as well, but it begins with a small step
            if agree.all() and far.all() and jump > max(threshold, 2 * float(np.median(np.abs(steps)))):
                bad[order[:width]] = True
                break
    return bad


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
        return Unwrapped(position.copy(), ())
    raw = np.diff(position)
    inside = np.ones(len(raw), dtype=bool)
    inside[gaps] = False
    if np.ptp(position) > 1.01 * turn and np.all(np.abs(raw[inside]) < turn / 2):
        return Unwrapped(position.copy(), ())
    steps = wrapped(raw, turn)
    rates = np.abs(steps[inside]) / np.diff(time)[inside]
    fastest = FASTER * float(np.percentile(rates, 99)) if rates.size else np.inf
    broken = []
    for gap in gaps:
        span = time[gap + 1] - time[gap]
        before, after = _side_rate(time, steps, gap - 1, -1, gaps), _side_rate(time, steps, gap + 1, 1, gaps)
        predicted = span * (before[0] + after[0]) / 2
        doubt = span * min(fastest, abs(after[0] - before[0]) / 2 + before[1] + after[1])
        if doubt > turn / 4 or span > LONGEST_BRIDGE:
            broken.append(int(gap))
        steps[gap] = predicted + wrapped(np.asarray(raw[gap] - predicted), turn)
    return Unwrapped(position[0] + np.concatenate([[0.0], np.cumsum(steps)]), tuple(broken))


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
