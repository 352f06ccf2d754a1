"""Stretches of samples in flat arrays: several runs one behind the other, or parts of them, looked at together."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


TOGETHER = 1 << 18
"""Samples that are looked at together: some of their columns stay in the processor."""


def together(edges: Indices) -> Iterator[tuple[int, int]]:
    """The first run, and one after the last, of as many runs at a time as are looked at together, by their `edges`."""
    first = 0
    while first < len(edges) - 1:
        stop = max(first + 1, int(np.searchsorted(edges, edges[first] + TOGETHER, side="right")) - 1)
        yield first, stop
        first = stop


def edges_of(lengths: Sequence[int] | Indices) -> Indices:
    """Where stretches of these lengths begin and end, one behind the other, (S + 1,)."""
    return np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(lengths, dtype=np.int64)])


def cut_out(values: Floats, first: Indices, stop: Indices) -> Floats:
    """The samples of stretches `first` to `stop - 1`, (S,), of values (N,), one behind the other."""
    return np.concatenate([values[:0], *(values[a:b] for a, b in zip(first.tolist(), stop.tolist()))])


def spread(values: Floats, first: Indices, stop: Indices, count: int) -> Floats:
    """Samples (`count`,) that have the values (S,) of the stretches `first` to `stop - 1` they are in, 0 elsewhere."""
    every = np.zeros(2 * len(first) + 1)
    every[1::2] = values
    edges = np.concatenate([[0], np.stack([first, stop], axis=1).ravel(), [count]])
    return np.repeat(every, np.diff(edges))


def first_where(true: Mask, first: Indices, stop: Indices) -> Indices:
    """Where each stretch `first` to `stop - 1`, (S,), has its first sample that is true, of (N,); else `stop`."""
    turns = np.append(np.flatnonzero(true[1:] & ~true[:-1]) + 1, len(true))
    return np.where(true[first], first, np.minimum(turns[np.searchsorted(turns, first, side="right")], stop))


def between(values: Floats, edges: Indices) -> Floats:
    """The differences from each sample to the next, (N,), of runs `edges[r]` to `edges[r + 1] - 1`; after the last
    sample of a run stands the one before once more."""
    found = np.empty_like(values)
    np.subtract(values[1:], values[:-1], out=found[:-1])
    found[edges[1:] - 1] = found[edges[1:] - 2]
    return found


def medians(values: Floats, first: Indices, stop: Indices) -> Floats:
    """The medians of stretches `first` to `stop - 1`, (S,), none empty, of numbers (N,), none of them missing."""
    found, count = np.zeros(len(first)), stop - first
    for length in set(count.tolist()):
        own, half = count == length, length // 2
        middle = [half] if length % 2 else [half - 1, half]
        rows = np.stack([values[a : a + length] for a in first[own].tolist()])
        rows.partition(middle, axis=1)
        found[own] = rows[:, middle].sum(axis=1) / len(middle)
    return found
