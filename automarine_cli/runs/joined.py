"""Runs one behind the other in flat arrays: all are looked at together, and a run costs no more than its samples."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Indices, cut_out, edges_of, together
from automarine_cli.runs.noise import position_noises
from automarine_cli.runs.run import NOISE_FROM, Run


@dataclass(frozen=True)
class Joined:
    """Runs of one motion, none of them empty: samples `edges[r]` to `edges[r + 1] - 1` of `time`, `position` and
    `command`, (N,), are those of run r."""

    runs: Sequence[Run]
    edges: Indices
    time: Floats
    position: Floats
    command: Floats

    @classmethod
    def of(cls, runs: Sequence[Run]) -> "Joined":
        """Some runs, at least one, joined. Raises RunError where one has no moment."""
        columns = ([run.time for run in runs], [run.position for run in runs], [run.command for run in runs])
        return cls(runs, edges_of([len(run) for run in runs]), *map(np.concatenate, columns))

    @property
    def dof(self) -> Dof:
        """The motion."""
        return self.runs[0].dof

    @cached_property
    def noise(self) -> Floats:
        """The noise of each run as in `Run.noise`, (R,) [rad or m]."""
        first = self.edges[:-1]
        stop = np.minimum(first + NOISE_FROM, self.edges[1:])
        time, position = (cut_out(values, first, stop) for values in (self.time, self.position))
        return position_noises(time, position, edges_of(stop - first))


def in_batches(runs: Iterable[Run]) -> Iterator[Sequence[Run]]:
    """The runs in order, as many of one motion at a time as are looked at together."""
    for _, own in groupby(runs, key=lambda run: run.dof.name):
        every = list(own)
        yield from (every[a:b] for a, b in together(edges_of([len(run) for run in every])))


def slopes(time: Floats, position: Floats, first: Indices, stop: Indices) -> tuple[Floats, Floats]:
    """`noise.slope` of every stretch `first` to `stop - 1`, (S,), none empty, of times and positions (N,)."""
    lengths, starts = stop - first, edges_of(stop - first)[:-1]
    if not len(lengths):
        return np.zeros(0), np.zeros(0)

    def centred(values: Floats) -> Floats:
        own = cut_out(values, first, stop)
        return own - np.repeat(np.add.reduceat(own, starts) / lengths, lengths)

    times = centred(time)
    square = np.add.reduceat(times * times, starts)
    with np.errstate(divide="ignore"):
        error = 1 / np.sqrt(square)
    return np.add.reduceat(times * centred(position), starts) / np.where(square > 0, square, np.inf), error
