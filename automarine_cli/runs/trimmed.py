"""What a fit to half-turns keeps of a run: the samples of its half-turn and a little around it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.runs.allocation_limits import SINGLE
from automarine_cli.runs.half_turn import UNTRIMMED, HalfTurn, Trim, why_none
from automarine_cli.runs.joined import in_batches
from automarine_cli.runs.run import ASKED, Run
from automarine_cli.runs.turns import Turns, turns_of

MOST_REST = 200
"""Samples of rest before a step that are used; more would say little of the start and much of slow drifts."""


@dataclass(frozen=True)
class Trimmed:
    """A run of which only its half-turn is kept, with some of the rest before it and of what follows (for figures);
    of a run without one nothing but its name, and `why`.
    """

    run: Run
    turn: HalfTurn | None
    why: str

    def of(self, run: Run) -> "Trimmed":
        """The same under the name of `run`."""
        if run is self.run:
            return self
        return Trimmed(run, None if self.turn is None else self.turn.of(run), self.why)


def trimmed(runs: Sequence[Run], trim: Trim = UNTRIMMED) -> list[Trimmed]:
    """Keep of each run what a fit to half-turns needs. Raises RunError where a run has no moment."""
    return [one for some in in_batches(runs) for one in _trimmed(some, turns_of(some, trim))]


def _trimmed(runs: Sequence[Run], turns: Turns) -> Iterator[Trimmed]:
    steps, edges = turns.steps, turns.steps.joined.edges.tolist()
    begin = np.maximum(steps.rest, steps.first - MOST_REST)
    end = np.minimum(steps.stop, 2 * turns.stop - steps.first)
    for r, (run, i) in enumerate(zip(runs, turns.firsts)):
        if i is None:
            yield Trimmed(_copied(run, 0, 0), None, why_none(run, turns.in_run(r)))
            continue
        short = _copied(run, int(begin[i]) - edges[r], int(end[i]) - edges[r])
        yield Trimmed(short, turns.turn(i, short, int(begin[i])), "")


def _copied(run: Run, start: int, stop: int) -> Run:
    """Samples start:stop of what sensors of the motion and thrusters say: the rest need not stay in memory."""
    time, position = (column[start:stop].copy() for column in (run.time, run.position))
    moment = None if run.moment is None else run.moment[start:stop].copy()
    kept = (name for name in run.extras if name in (run.dof.velocity, ASKED) or SINGLE.fullmatch(name))
    extras = {name: run.extras[name][start:stop].copy() for name in kept}
    return Run(
        run.name, run.source, time, position, moment, run.moment_unit, extras, run.counts, run.notes, run.reading,
        run.summed_up, run.commanded, dof=run.dof,
    )  # fmt: skip
