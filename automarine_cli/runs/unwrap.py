"""One continuous position from a sensor that wraps, skips and spikes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Indices, Mask, between, edges_of, medians
from automarine_cli.runs.noise import NORMAL

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


@dataclass(frozen=True)
class Track:
    """Positions of several runs one behind the other, (N,) [rad or m], and how they go from sample to sample; samples
    `edges[r]` to `edges[r + 1] - 1` are those of run r."""

    time: Floats
    position: Floats
    edges: Indices
    dof: Dof

    @classmethod
    def of_one(cls, time: Floats, position: Floats, dof: Dof) -> "Track":
        """That of one run."""
        return cls(time, position, np.array([0, len(time)]), dof)

    @cached_property
    def spans(self) -> Floats:
        """Times between samples [s], as of `flat.between`."""
        return between(self.time, self.edges)

    @cached_property
    def raw(self) -> Floats:
        """Differences of positions, as of `flat.between`."""
        return between(self.position, self.edges)

    @cached_property
    def turned(self) -> Indices:
        """The samples after which the position wraps."""
        far = np.abs(self.raw) >= self.dof.turn / 2
        far[self.edges[1:] - 1] = False
        return np.flatnonzero(far)

    @cached_property
    def steps(self) -> Floats:
        """The same differences the shortest way round."""
        if not self.turned.size:
            return self.raw
        steps = self.raw.copy()
        steps[self.turned] = wrapped(self.raw[self.turned], self.dof.turn)
        steps[self.edges[1:] - 1] = steps[self.edges[1:] - 2]
        return steps

    @cached_property
    def bend(self) -> Floats:
        """How much each step differs from the next; 0 after the last two samples of each run."""
        bend = np.zeros(len(self.steps))
        np.abs(np.subtract(self.steps[1:], self.steps[:-1], out=bend[:-1]), out=bend[:-1])
        bend[self.edges[1:] - 1] = 0.0
        return bend

    def larger(self, steps: Floats, size: float) -> Indices:
        """After which samples a step is larger than `size`, either way."""
        far = np.abs(steps) > size
        far[self.edges[1:] - 1] = False
        return np.flatnonzero(far)

    def scatter(self, asked: Mask) -> Floats:
        """Standard deviation of the steps that are noise, of the runs `asked` for, (R,), of more than two samples; 0 of
        others. By the sizes of second differences: those of white noise are root three times as wide as its steps. A
        thousand of them are enough."""
        first, stop = self.edges[:-1][asked], self.edges[1:][asked] - 2
        every = 1 + (stop - first) // ENOUGH
        some = [self.bend[a:b:c] for a, b, c in zip(first.tolist(), stop.tolist(), every.tolist())]
        edges = edges_of([len(one) for one in some])
        scatter = np.zeros(len(asked))
        scatter[asked] = NORMAL * medians(np.concatenate([self.bend[:0], *some]), edges[:-1], edges[1:]) / np.sqrt(3.0)
        return scatter

    def least_spikes(self, asked: Mask) -> Floats:
        """From what size on [rad or m] a sample may be a spike, in the runs `asked` for, (R,)."""
        return np.maximum(self.dof.limits.spike, SPIKE_IN_SIGMA * self.scatter(asked))


def find_glitches(time: Floats, position: Floats, dof: Dof) -> Mask:
    """Which samples of a position [rad or m], shape (N,), are spikes of one or two samples: far off both neighbours,
    which agree.

    A spike stands out against the local rate by eight robust standard deviations and the motion's least spike, and by
    half as much again as the vehicle moves from sample to sample around it; the samples on either side of it
    continue each other. A jump that stays (a stale sensor that catches up) is no spike, nor is a sharp
    reversal.
    """
    if len(time) < LOCAL:
        return np.zeros(len(time), dtype=bool)
    track, every = Track.of_one(time, position, dof), np.ones(1, dtype=bool)
    bad = find_spikes(track, every)
    if not _jumps_at_ends(position, dof):
        return bad
    return bad | _ends(track, max(float(track.least_spikes(every)[0]), dof.limits.end_spike))


def find_spikes(track: Track, asked: Mask) -> Mask:
    """The spikes, (N,), that are not at an end, in those of several runs that are `asked` for, (R,)."""
    bad, starts, limits = np.zeros(len(track.time), dtype=bool), track.edges[:-1], track.dof.limits
    share = 2 / 3 - (np.maximum.reduceat(track.spans, starts) / np.minimum.reduceat(track.spans, starts) - 1.0) / 1.5
    large = track.larger(track.steps, limits.large_step)
    several = np.diff(np.searchsorted(large, track.edges))
    # by the least size, of which the scatter makes no more
    asked = asked & (
        (np.maximum.reduceat(track.bend, starts) > 0.99 * share * limits.spike) | (several > 0) | (share < 0.2)
    )
    if not asked.any():
        return bad
    thresholds = track.least_spikes(asked)
    large = large[asked[np.searchsorted(track.edges, large, side="right") - 1]]
    least = np.where(asked, np.where((share < 0.2) | (several > 2), -1.0, 0.99 * share * thresholds), np.inf)
    bent = np.flatnonzero(track.bend > np.repeat(least, np.diff(track.edges)))
    for width in range(1, LONGEST_SPIKE + 1):
        before, run = _suspects(track, bent, large, width)
        if not before.size:
            continue
        after, threshold, ends = before + width + 1, thresholds[run], (starts[run], track.edges[1:][run] - 2)
        rate = _median_beside(track.steps, before, after, ends, track.spans)
        across = np.abs(_off(track, rate, before, after))
        off = np.abs(_off(track, rate, before, before + 1))
        for k in range(2, width + 1):
            off = np.maximum(off, np.abs(_off(track, rate, before, before + k)))
        spike = (off > threshold) & (across < threshold) & (off > 3 * across)
        if not spike.any():
            continue
        before, after, off, ends = before[spike], after[spike], off[spike], (ends[0][spike], ends[1][spike])
        spike = off > 1.5 * _median_beside(np.abs(track.steps), before, after, ends)
        spike &= ~np.any([bad[before + k] for k in range(width + 2)], axis=0)
        for k in range(1, width + 1):
            bad[before[spike] + k] = True
    return bad


def _suspects(track: Track, bent: Indices, large: Indices, width: int) -> tuple[Indices, Indices]:
    """The samples, shape (M,), that a spike of `width` samples may follow, and their runs: a look at differences of
    steps spares the medians of nearly all samples of a log, and leaves out none that is a spike.

    With X the steps less the local rate r, a spike has |X1 + ... + Xk| = off > threshold for some k <= width,
    |X1 + ... + X(width + 1)| < off / 3, and |r| span < off / 1.5 (the median of |step| around). Then two steps in a row
    differ by 4/3 off or more if one sample is off, by 2/3 off if two are, less what an uneven clock adds: such samples
    are `bent`. That holds where no sum of steps passes half a turn, which samples with `large` steps may do, and is
    asked of the rest in full.
    """
    edges = track.edges
    found = np.concatenate([bent, large, large - 1])
    run = np.searchsorted(edges, np.concatenate([bent, large, large]), side="right") - 1
    found, run = np.concatenate([found - k for k in range(width)]), np.tile(run, width)
    if large.size:  # at the ends of the log a step stands for its missing neighbours too
        ends = np.unique(run[-len(large) :])
        last = edges[1:][ends] - 1 - width
        near = [*(edges[ends] + k for k in range(4)), *(last - k for k in range(1, 5))]
        found, run = np.concatenate([found, *near]), np.concatenate([run, np.tile(ends, 8)])
    inside = (found >= edges[run]) & (found < edges[run + 1] - 1 - width)
    found, first = np.unique(found[inside], return_index=True)
    return found, run[inside][first]


def _median_beside(
    steps: Floats, before: Indices, after: Indices, ends: tuple[Indices, Indices], spans: Floats | None = None
) -> Floats:
    """The median of the three steps that lead to sample `before` and the three that leave sample `after`, (M,), as far
    as the first and last step of their run; of their rates where the `spans` of the steps are given."""
    places = np.array([before - 3, before - 2, before - 1, after, after + 1, after + 2])
    inside = np.minimum(np.maximum(places, ends[0]), ends[1])
    values = steps[inside] if spans is None else steps[inside] / spans[inside]
    values.sort(axis=0)
    return np.asarray((values[2] + values[3]) / 2)


def _off(track: Track, rate: Floats, here: Indices, there: Indices) -> Floats:
    """How far the position `there` is from that `here` carried on at `rate`, modulo a turn."""
    time, position = track.time, track.position
    return wrapped(position[there] - position[here] - rate * (time[there] - time[here]), track.dof.turn)


def _jumps_at_ends(position: Floats, dof: Dof) -> bool:
    """Whether any of the first or last steps is large enough for a spike there: only one side can be compared with."""
    near = LONGEST_SPIKE + 1
    steps = np.concatenate([np.diff(position[:near]), np.diff(position[-near:])])
    return bool(np.abs(wrapped(steps, dof.turn)).max() > 0.99 * dof.limits.end_spike)


def _ends(track: Track, threshold: float) -> Mask:
    """Spikes at the very first and last samples of one run: far off what the next samples, which agree, lead to."""
    time, position, turn, count = track.time, track.position, track.dof.turn, len(track.time)
    bad = np.zeros(count, dtype=bool)
    for order in (np.arange(count), np.arange(count)[::-1]):
        for width in range(1, LONGEST_SPIKE + 1):
            inner = order[width : width + 6]
            steps = wrapped(np.diff(position[inner]), turn)
            rate = np.array(np.median(steps / np.diff(time[inner])))
            jump = abs(float(wrapped(position[inner[0]] - position[order[width - 1]], turn)))
            agree = np.abs(_off(track, rate, inner[:-1], inner[1:])) < threshold / 4
            far = np.abs(_off(track, rate, np.repeat(inner[0], width), order[:width])) > threshold
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
