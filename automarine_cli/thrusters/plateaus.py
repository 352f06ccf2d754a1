"""Raw load-cell series -> points: transient dropped, mean of each constant command with its error."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.thrusters.bollard_data import Points, Series, join

HANDFUL = 5  # up to this many equal commands in sequence are single readings, not a raw series
BATCHES = 10  # batch means: enough for a variance, long enough to outlive the autocorrelation
SPIKE = 8.0  # robust standard deviations beyond which one sample is an electrical spike
MOST_READINGS = 2000  # rows of one record that are judged one by one
SLOW = 0.02  # of the range: how far the command may move within the mean of neighbouring rows
NOISY = 0.02  # command noise up to this share of its range still means "held constant"
SERIES = 200  # rows from which a measured speed may be a series
WINDOWS = (25, 10)  # samples whose mean tells a change of speed; a plateau holds three of them
FRAGMENTS = 3  # a series of commands falls into as many pieces by its values as by its steadiness; a speed in more
UNSTEADY = 0.05  # scatter of a steady speed, share of its range


@dataclass(frozen=True)
class Reduction:
    """Points found in the records, and what was left out on the way (samples; notes for a person)."""

    points: Points
    samples: int
    plateaus: int
    dropped: dict[str, int]
    notes: tuple[str, ...]


def reduce_series(records: list[Series]) -> Reduction:
    """One point for each reading of a table, one for each plateau of a raw series.

    A record is a raw series when its non-zero commands are held over more than a handful of samples in sequence, or
    when its measured speed is steady for most of the time."""
    parts, dropped, notes = [], {"transient": 0, "drop_out": 0, "spike": 0, "too_short": 0}, []
    for number, record in enumerate(records):
        segments = constant_segments(record.n)
        lengths = [stop - start for start, stop in segments if np.any(record.n[start:stop] != 0)]
        typical = np.median(lengths) if lengths else len(record.n)
        steady = _steady(record.n) if len(record.n) >= SERIES else []
        measured = 0 < FRAGMENTS * len(steady) < len(segments)
        if typical <= HANDFUL and not measured:
            parts.append(_readings(record, number))
            continue
        plateaus, unsettled = _plateaus(record, number, steady if measured else segments, measured, dropped)
        if unsettled:
            levels = ", ".join(f"{level:.4g}" for level in unsettled)
            notes.append(
                f"{record.source}: thrust at n = {levels} was still changing when the command ended; "
                "hold each command longer"
            )
        if plateaus is not None:
            parts.append(plateaus)
    points = join(parts) if parts else join([_readings(Series("", "", np.empty(0), np.empty(0)), 0)])
    samples = sum(len(record.n) for record in records)
    return Reduction(points, samples, int(np.count_nonzero(points.raw)), dropped, tuple(notes))


def constant_segments(n: Floats) -> list[tuple[int, int]]:
    """Half-open index ranges in which the command, shape (N,), is held.

    A measured speed carries noise: its size is taken from second differences, which a steady sweep does not have."""
    if len(n) == 0:
        return []
    span = float(np.max(np.abs(n)))
    noise = 1.4826 * float(np.median(np.abs(np.diff(n, 2)))) / np.sqrt(6.0) if len(n) > 2 else 0.0
    if noise == 0.0 or noise > NOISY * span:
        edges = np.flatnonzero(np.diff(n) != 0) + 1
    else:
        edges = _noisy_edges(n, 6.0 * noise)
    bounds = [0, *edges.tolist(), len(n)]
    return list(pairwise(bounds))


def _noisy_edges(n: Floats, tolerance: float) -> np.ndarray:
    """Where the command leaves the running mean of its segment by more than the tolerance."""
    edges, mean, held = [], float(n[0]), 1
    for index in range(1, len(n)):
        value = float(n[index])
        if abs(value - mean) > tolerance:
            edges.append(index)
            mean, held = value, 1
        else:
            held += 1
            mean += (value - mean) / held
    return np.array(edges, dtype=int)


def _steady(n: Floats) -> list[tuple[int, int]]:
    """Half-open index ranges in which a measured speed (N,) is steady, with its noise, its steps and its lag; none
    where they are not most of it, as in a sweep or a table in random order."""
    span = float(np.ptp(n))
    for window in WINDOWS:
        found = [
            (start, stop)
            for start, stop in _between_changes(n, window, span)
            if stop - start >= 3 * window and _level_throughout(n[start:stop], span)
        ]
        if len(found) >= 3 and sum(stop - start for start, stop in found) >= 0.5 * len(n):
            return found
    return []


def _between_changes(n: Floats, window: int, span: float) -> list[tuple[int, int]]:
    """Ranges between changes of the mean of `window` samples from one window to the next; how much these differ by
    noise alone is read from their smallest differences."""
    total = np.concatenate([[0.0], np.cumsum(n)])
    means = (total[window:] - total[:-window]) / window
    change = np.abs(means[window:] - means[:-window])  # about sample i + window
    limit = max(5.0 * float(np.quantile(change, 0.3)) / 0.385, 0.01 * span)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], change > limit, [False]]).astype(int)))
    ranges, start = [], 0
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist()):
        middle = first + int(np.argmax(change[first:last])) + window
        ranges.append((start, min(first + 2 * window, middle)))
        start = max(last, middle)
    return [*ranges, (start, len(n))]


def _level_throughout(n: Floats, span: float) -> bool:
    halves = np.array_split(n, 2)
    return abs(halves[0].mean() - halves[1].mean()) <= NOISY * span and float(np.std(n)) <= UNSTEADY * span


def settled_from(force: Floats) -> tuple[int, bool]:
    """First sample of the steady part of a plateau, and whether it had settled at all.

    MSER-5 (White 1997, Simulation 69:323): on means of five samples, the cut that gives the smallest standard error of
    the mean of the rest. A cut at the latest place allowed (half of the record) means that it never settled."""
    batch = 5
    count = len(force) // batch
    if count < 6:
        return 0, True
    means = force[: count * batch].reshape(count, batch).mean(axis=1)
    remaining = np.arange(count, 0, -1)
    total = np.cumsum(means[::-1])[::-1]
    squares = np.cumsum((means[::-1] - means.mean()) ** 2)[::-1]
    centre = total / remaining - means.mean()
    score = np.maximum(squares - remaining * centre**2, 0.0) / remaining**2
    latest = count // 2
    cut = int(np.argmin(score[: latest + 1]))
    if cut < latest:
        return cut * batch, True
    return cut * batch, not _trend(means[latest:])


def _trend(means: Floats) -> bool:
    """Whether a series of batch means still climbs or falls by more than its own scatter explains."""
    place = np.arange(len(means)) - (len(means) - 1) / 2
    slope = float(place @ means / (place @ place))
    rest = means - means.mean() - slope * place
    scatter = np.sqrt(float(rest @ rest) / max(len(means) - 2, 1))
    return abs(slope) * np.sqrt(float(place @ place)) > 6.0 * scatter


def standard_error(force: Floats) -> float:
    """Standard error of the mean of correlated samples, shape (N,), by batch means [unit of force]."""
    if len(force) < 2:
        return float("nan")
    size = max(len(force) // BATCHES, 1)
    count = len(force) // size
    means = force[: count * size].reshape(count, size).mean(axis=1)
    return float(np.std(means, ddof=1) / np.sqrt(count))


def _plateaus(
    record: Series, number: int, segments: list[tuple[int, int]], measured: bool, counts: dict[str, int]
) -> tuple[Points | None, list[float]]:
    """One point a plateau, and the commands at which thrust had not settled; `counts` what is left out."""
    if measured:
        counts["transient"] += len(record.n) - sum(stop - start for start, stop in segments)
    rows, unsettled = [], []
    for held in _bridged(record.n, segments, counts):
        if len(held) <= HANDFUL:
            counts["too_short"] += len(held)
            continue
        spike = _spikes(record.force[held])
        counts["spike"] += int(np.count_nonzero(spike))
        held = held[~spike]
        cut, settled = settled_from(record.force[held])
        if measured:  # the speed has a lag of its own
            cut = max(cut, settled_from(record.n[held])[0])
        counts["transient"] += cut
        held = held[cut:]
        n, force = _level(record.n, held), record.force[held]
        unsettled += [] if settled else [n]
        clock = np.mean(held if record.time is None else record.time[held])
        volts = np.nan if record.voltage is None else np.mean(record.voltage[held])
        rows.append((n, force.mean(), np.std(force, ddof=1), len(force), standard_error(force), clock, volts))
    if not rows:
        return None, unsettled
    level, mean, spread, count, stderr, when, voltage = np.array(rows, dtype=float).T
    points = replace(
        Points.measured(level, mean, when, voltage, number), spread=spread, count=count.astype(np.int64),
        stderr=stderr, raw=np.ones(len(rows), dtype=bool),
    )  # fmt: skip
    return points, unsettled


def _spikes(force: Floats) -> np.ndarray:
    """Electrical spikes, shape (N,): samples that stand out of their six neighbours and the whole plateau."""
    window = 7
    if len(force) <= 2 * window:
        return np.zeros(len(force), dtype=bool)
    around = np.median(np.lib.stride_tricks.sliding_window_view(force, window), axis=1)
    # The first samples are the transient's; the last are judged by the last whole window.
    centre = np.concatenate([force[:3], around, np.full(3, around[-1])])
    off = np.abs(force - centre)
    whole = np.abs(force - np.median(force))
    return np.asarray((off > SPIKE * 1.4826 * np.median(off)) & (whole > SPIKE * 1.4826 * np.median(whole)) & (off > 0))


def _bridged(n: Floats, segments: list[tuple[int, int]], counts: dict[str, int]) -> list[np.ndarray]:
    """Sample numbers of each held command; a blink of another value inside one command is a drop-out."""
    span = float(np.max(np.abs(n)))
    held: list[np.ndarray] = []
    blink = 0
    for start, stop in segments:
        here = np.arange(start, stop)
        if len(here) <= HANDFUL:
            held.append(here)
            blink += 1
            continue
        long_before = held[-1 - blink] if len(held) > blink else None
        between = int(sum(len(part) for part in held[len(held) - blink :]))
        same = long_before is not None and abs(np.median(n[long_before]) - np.median(n[here])) <= 0.01 * span
        if long_before is not None and same and 0 < between <= HANDFUL:
            counts["drop_out"] += between
            held[len(held) - blink - 1 :] = [np.concatenate([long_before, here])]
        else:
            held.append(here)
        blink = 0
    return held


def _level(n: Floats, held: np.ndarray) -> float:
    """The command of a plateau; a measured speed within 0.5 % of full scale of zero is zero."""
    if np.ptp(n[held]) == 0:
        return float(n[held[0]])
    level = float(np.mean(n[held]))
    return 0.0 if abs(level) <= 0.005 * float(np.max(np.abs(n))) else level


def _readings(record: Series, number: int) -> Points:
    """A table: every row is a point. A long slow sweep goes in means of neighbouring rows."""
    n, force, voltage = record.n, record.force, record.voltage
    when = np.arange(len(n), dtype=float) if record.time is None else record.time
    size = -(-len(n) // MOST_READINGS)
    if size <= 1 or np.median(np.abs(np.diff(n))) * size > SLOW * np.ptp(n):
        return Points.measured(n, force, when, voltage, number)
    blocks = np.array_split(np.arange(len(n)), -(-len(n) // size))
    columns = (n, force, when) if voltage is None else (n, force, when, voltage)
    level, thrust, middle, *volts = (np.array([np.mean(column[block]) for block in blocks]) for column in columns)
    return replace(
        Points.measured(level, thrust, middle, volts[0] if volts else None, number),
        spread=np.array([np.std(force[block], ddof=1) if len(block) > 1 else np.nan for block in blocks]),
        count=np.array([len(block) for block in blocks], dtype=np.int64),
    )
