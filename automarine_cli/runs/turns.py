"""The half-turns of many runs at once: where each step ends, what of it is kept, and which of them serve."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Indices, Mask, first_where, spread
from automarine_cli.runs.half_turn import (
    COMMAND_ENDS,
    FEWEST_SAMPLES,
    LOG_ENDS,
    MARGIN_IN_SIGMA,
    UNTRIMMED,
    HalfTurn,
    Trim,
    against,
    least_way,
    never_moved,
    not_from_rest,
    stuck,
    too_short,
    too_soon,
    why_none,
)  # fmt: skip
from automarine_cli.runs.joined import Joined, in_batches, slopes
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.runs.sense import longest_repeat
from automarine_cli.runs.steps import Steps, start_position, steps_of

FEWEST_STUCK = 10  # samples of one exact position
STILL_CHANGING = 0.1  # of the last third's rate
SURE = 4.0  # standard errors


@dataclass(frozen=True)
class Turns:
    """The half-turns of `steps`, (S,): one after their last samples in the flat arrays, whether half a turn ended them,
    and others as in `HalfTurn`."""

    steps: Steps
    trim: Trim
    start_position: Floats
    stop: Indices
    crossed: Mask
    steady: Mask
    turned: Floats

    def turn(self, i: int, run: Run, begin: int, why: str = "") -> HalfTurn:
        """Half-turn i in a version of its run that begins with sample `begin` of the flat arrays."""
        step, dof = self.steps.step(i, run, begin), run.dof
        kept = slice(step.first, int(self.stop[i]) - begin)
        cut_by = LOG_ENDS if step.ends_log else dof.fill(COMMAND_ENDS)
        return HalfTurn(
            step=step,
            time=run.time[kept],
            position=run.position[kept],
            kept=kept,
            start_position=float(self.start_position[i]),
            switch_from=step.switch_from,
            switch_to=step.switch_to,
            moment=step.moment,
            cut_by=self.trim.ended(dof) if self.crossed[i] else cut_by,
            turned=float(self.turned[i]),
            noise=float(self.steps.joined.noise[self.steps.run[i]]),
            steady=bool(self.steady[i]),
            why=why,
        )

    def of_run(self, r: int) -> range:
        """Which of them are those of run r, in the order of time."""
        return range(*np.searchsorted(self.steps.run, [r, r + 1]).tolist())

    def in_run(self, r: int) -> list[HalfTurn]:
        """Those of run r itself, in the order of time."""
        joined = self.steps.joined
        return [self.turn(i, joined.runs[r], int(joined.edges[r]), self.why[i]) for i in self.of_run(r)]

    @cached_property
    def firsts(self) -> list[int | None]:
        """The first of each run that serves, (R,), None where none does."""
        serve = reversed([(r, i) for i, (r, why) in enumerate(zip(self.steps.run.tolist(), self.why)) if not why])
        return [*map(dict(serve).get, range(len(self.steps.joined.runs)))]

    @cached_property
    def why(self) -> list[str]:
        """The sentences for which they are set aside, (S,), or nothing."""
        steps, joined, count = self.steps, self.steps.joined, self.stop - self.steps.first
        dof, way = joined.dof, np.abs(self.turned)
        repeats = _most_repeats(joined.position, steps.first, self.stop)
        backward = (self.turned * steps.moment < 0) & (not dof.has_constant)
        reasons = (
            (repeats >= np.maximum(FEWEST_STUCK, count / 2), stuck),
            (count < FEWEST_SAMPLES, too_short),
            (way < least_way(dof, joined.noise[steps.run]), never_moved),
            (~steps.from_rest, not_from_rest),
            (backward, against),
            (~self.crossed & ((way < dof.limits.least) | ~self.steady), too_soon),
        )
        found = [""] * len(count)
        for i in np.flatnonzero(np.any([true for true, _ in reasons], axis=0)).tolist():
            r = steps.run[i]
            turn = self.turn(i, joined.runs[r], int(joined.edges[r]))
            found[i] = next((why for true, tell in reasons if true[i] and (why := tell(turn))), "")
        return found


def turns_of(runs: Sequence[Run], trim: Trim = UNTRIMMED) -> Turns:
    """Every step of some runs of one motion, trimmed to |psi - psi0| <= pi and judged. Trimming what was trimmed
    changes nothing. Raises RunError where a run has no moment.
    """
    steps = steps_of(Joined.of(runs))
    joined, first, dof = steps.joined, steps.first, runs[0].dof
    time, position, noise = joined.time, joined.position, joined.noise[steps.run]
    zero = steps.start_position.copy()
    for i in np.flatnonzero(steps.rest == first).tolist():
        r = steps.run[i]
        zero[i] = start_position(steps.step(i, runs[r], int(joined.edges[r])))
    zeros, noises = (spread(values, first, steps.stop, len(time)) for values in (zero, noise))
    beyond = first_where(trim.beyond(position, zeros, noises, dof), first, steps.stop)
    crossed = beyond < steps.stop
    stop = np.where(crossed, first + _kept(position, first, beyond - first, zero, noise), steps.stop)
    turned = _last_positions(time, position, first, stop) - zero
    return Turns(steps, trim, zero, stop, crossed, _are_steady(time, position, first, stop, noise), turned)


def half_turns(runs: Iterable[Run], trim: Trim = UNTRIMMED) -> tuple[tuple[HalfTurn, ...], tuple[SetAside, ...]]:
    """The first half-turn of every run that serves, and the runs set aside with their reasons."""
    good: list[HalfTurn] = []
    aside: list[SetAside] = []
    for some in in_batches(runs):
        turns = turns_of(some, trim)
        for r, (run, i) in enumerate(zip(some, turns.firsts)):
            if i is not None:
                good.append(turns.turn(i, run, int(turns.steps.joined.edges[r])))
            else:
                aside.append(SetAside(run.source, run.name, why_none(run, turns.in_run(r))))
    return tuple(good), tuple(aside)


def _kept(position: Floats, first: Indices, crossing: Indices, zero: Floats, noise: Floats) -> Indices:
    """How many samples are kept of steps (S,) that half a turn (or what else limits the motion) ends after `crossing`
    samples."""
    back = np.minimum(10, crossing - 1)
    last = np.maximum(first + crossing - 1, 0)
    far, near = position[last] - zero, position[np.maximum(last - back, 0)] - zero
    pace = np.abs(far - near) / np.maximum(back, 1)
    margin = np.where(pace > 0, np.ceil(MARGIN_IN_SIGMA * noise / np.where(pace > 0, pace, 1.0)), crossing)
    kept = np.maximum(crossing - margin, np.minimum(crossing, FEWEST_SAMPLES)).astype(np.int64)
    return np.where(back < 1, np.maximum(crossing, 1), kept)


def _last_positions(time: Floats, position: Floats, first: Indices, stop: Indices) -> Floats:
    """Positions at the last samples of stretches, (S,) [rad or m], from the line through the last six."""
    found, count = np.zeros(len(first)), np.minimum(stop - first, 6)
    for width in set(count.tolist()):
        own = count == width
        places = stop[own, None] + np.arange(-width, 0)
        late, last = time[places], position[places]
        mean = last.mean(axis=1)
        centred = late - late.mean(axis=1)[:, None]
        square = np.vecdot(centred, centred)
        rate = np.vecdot(centred, last - mean[:, None]) / np.where(square > 0, square, np.inf)
        found[own] = mean + rate * centred[:, -1]
    return found


def _are_steady(time: Floats, position: Floats, first: Indices, stop: Indices, noise: Floats) -> Mask:
    """Whether the rates of the last thirds of stretches, (S,), are those of the thirds before, within a tenth or the
    noise."""
    found, third = np.zeros(len(first), dtype=bool), (stop - first) // 3
    own = third >= 3
    stop, third = stop[own], third[own]
    late, late_error = slopes(time, position, stop - third, stop)
    middle, middle_error = slopes(time, position, stop - 2 * third, stop - third)
    change, doubt = np.abs(late - middle), SURE * noise[own] * np.hypot(late_error, middle_error)
    found[own] = (change <= STILL_CHANGING * np.abs(late)) | (change <= doubt)
    return found


def _most_repeats(position: Floats, first: Indices, stop: Indices) -> Indices:
    """How many samples in a row have one exact position at most, in stretches (S,); 1 where these are few."""
    same = np.flatnonzero(position[1:] == position[:-1])
    often = np.searchsorted(same, stop - 1) - np.searchsorted(same, first) >= FEWEST_STUCK - 1
    found = np.ones(len(first), dtype=np.int64)
    for i in np.flatnonzero(often):
        own = position[first[i] : stop[i]]
        found[i] = longest_repeat(own, np.ones(len(own), dtype=bool))[0]
    return found
