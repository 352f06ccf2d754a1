"""What a fit to half-turns keeps of a run: the samples of its half-turn and a little around it."""

from dataclasses import dataclass, replace

from automarine_cli.runs.allocation_limits import SINGLE
from automarine_cli.runs.half_turn import UNTRIMMED, HalfTurn, Trim, first_half_turn
from automarine_cli.runs.run import ASKED, Run

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


def trimmed(run: Run, trim: Trim = UNTRIMMED) -> Trimmed:
    """Keep of a run what a fit to half-turns needs. Raises RunError where the run has no moment."""
    turn, why = first_half_turn(run, trim)
    if turn is None:
        return Trimmed(_copied(run, 0, 0), None, why)
    step, kept = turn.step, turn.kept
    rest = step.rest and slice(max(step.rest.start, step.rest.stop - MOST_REST), step.rest.stop)
    start = kept.start if rest is None else rest.start
    stop = min(step.stop, kept.stop + len(turn.time))
    short = _copied(run, start, stop)
    step = replace(
        step,
        run=short,
        first=step.first - start,
        stop=stop - start,
        rest=None if rest is None else slice(0, rest.stop - start),
    )
    kept = slice(kept.start - start, kept.stop - start)
    return Trimmed(short, replace(turn, step=step, time=short.time[kept], position=short.position[kept], kept=kept), "")


def _copied(run: Run, start: int, stop: int) -> Run:
    """Samples start:stop of what sensors of the motion and thrusters say: the rest need not stay in memory."""
    time, position = (column[start:stop].copy() for column in (run.time, run.position))
    moment = None if run.moment is None else run.moment[start:stop].copy()
    kept = (name for name in run.extras if name in (run.dof.velocity, ASKED) or SINGLE.fullmatch(name))
    extras = {name: run.extras[name][start:stop].copy() for name in kept}
    return replace(run, time=time, position=position, moment=moment, extras=extras)
