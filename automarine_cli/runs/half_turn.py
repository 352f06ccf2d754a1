"""The first half-turn of a step: |psi - psi0| <= pi, both directions alike; what was kept, what cut it, why
not used.

Walls, tether and the vehicle's own wake spoil what comes after half a turn (the source paper's section 3.2),
so each run is trimmed to it. Ending at the first noisy sample beyond pi would let the noise choose the last
sample, which biases the drag by about 0.1 %: the samples within three standard deviations before pi are
dropped as well.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import is_slow, longest_repeat, undriven
from automarine_cli.runs.clean import Mask
from automarine_cli.runs.noise import slope
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.runs.steps import Step, find_steps, start_position

COMMAND_ENDS = "the {force} changed"
NO_STEP = "no step: no constant {force} is held for at least 5 samples. Hold the {force} constant, or fit whole runs"
LOG_ENDS, WINDOW = "the log ended", "the window"

FEWEST_SAMPLES = 8
MARGIN_IN_SIGMA = 3.0
FEWEST_STUCK = 10  # samples of one exact position
STILL_CHANGING = 0.1  # of the last third's rate
SURE = 4.0  # standard errors
MOST_REST = 200
"""Samples of rest before a step that are used; more would say little of the start and much of slow drifts."""


@dataclass(frozen=True)
class Trim:
    """How far a step is followed [rad or m]: `reach` from its start (None: as its motion has it, half a turn in yaw),
    and only while the position is between `low` and `high`.
    """

    reach: float | None = None
    low: float = -math.inf
    high: float = math.inf

    def beyond(self, position: Floats, zero: float, noise: float, dof: Dof) -> Mask:
        """Tell which positions (N,) are no longer followed; the ends of a window are as sure as the noise lets them
        be."""
        far = np.abs(position - zero) > (dof.limits.trim if self.reach is None else self.reach)
        margin = MARGIN_IN_SIGMA * noise
        return np.asarray(far | (position < self.low - margin) | (position > self.high + margin))

    def of_whole(self, run: Run) -> Run:
        """A whole run of a translation as far as it is followed."""
        out = self.beyond(run.position, float(run.position[0]), run.noise, run.dof)
        return run.cut(0, int(np.argmax(out))) if not run.dof.wraps and out.any() else run

    def ended(self, dof: Dof) -> str:
        """What ended a step that was cut, in words."""
        return dof.words.reach if dof.wraps or self.reach is not None else WINDOW


UNTRIMMED = Trim()


@dataclass(frozen=True)
class HalfTurn:
    """What is kept of a step: `kept` are its samples in the run, `time` [s, campaign clock] and `position`
    [rad or m] theirs.

    `start_position` [rad or m] is psi0; the switch lies in (`switch_from`, `switch_to`] [s]; `cut_by` is what ended
    it, in words; `turned` [rad or m] the signed way from psi0 to the end; `noise` [rad or m] of the position; `steady`
    whether the rate had settled. `why` is empty, or the sentence for which the half-turn is set aside.
    """

    step: Step
    time: Floats
    position: Floats
    kept: slice
    start_position: float
    switch_from: float
    switch_to: float
    moment: float
    cut_by: str
    turned: float
    noise: float
    steady: bool
    why: str

    @property
    def serves(self) -> bool:
        return not self.why

    @property
    def moved(self) -> bool:
        """Whether the vehicle went further than standing still looks like."""
        return abs(self.turned) >= max(self.step.run.dof.limits.still, 5 * self.noise)

    @property
    def name(self) -> str:
        return self.step.run.name

    @property
    def looked_at(self) -> tuple[int, int]:
        """Where begins and ends what sensors are judged by and figures show: some of the rest, and as much after."""
        step = self.step
        begin = max(step.first if step.rest is None else step.rest.start, step.first - MOST_REST)
        return begin, min(step.stop, 2 * self.kept.stop - step.first)

    def of(self, run: Run) -> "HalfTurn":
        """Return the same of another version of the run, which has the same samples."""
        return replace(self, step=replace(self.step, run=run))


def all_half_turns(run: Run, trim: Trim = UNTRIMMED) -> list[HalfTurn]:
    """Trim every step of a run to |psi - psi0| <= pi and judge it, in the order of time. Raises RunError where the run
    has no moment."""
    return [_half_turn(step, trim) for step in find_steps(run)]


def half_turns(runs: Iterable[Run], trim: Trim = UNTRIMMED) -> tuple[tuple[HalfTurn, ...], tuple[SetAside, ...]]:
    """Return the first half-turn of every run that serves, and the runs set aside with their reasons."""
    good: list[HalfTurn] = []
    aside: list[SetAside] = []
    for run in runs:
        turns = all_half_turns(run, trim)
        if first := next((turn for turn in turns if turn.serves), None):
            good.append(first)
        else:
            aside.append(SetAside(run.source, run.name, why_none(run, turns)))
    return tuple(good), tuple(aside)


def _half_turn(step: Step, trim: Trim) -> HalfTurn:
    run, first = step.run, step.first
    dof, noise, zero = run.dof, run.noise, start_position(step)
    held = run.position[first : step.stop]
    beyond = trim.beyond(held, zero, noise, dof)
    crossed, stop = bool(beyond.any()), step.stop
    if crossed:
        stop = first + _kept_samples(held, int(np.argmax(beyond)), noise)
    time, position = run.time[first:stop], run.position[first:stop]
    last = slice(max(first, stop - 6), stop)  # the end is read from the line through the last six samples
    rate, _ = slope(run.time[last], run.position[last])
    end = run.position[last].mean() + rate * (run.time[stop - 1] - run.time[last].mean())
    turn = HalfTurn(
        step=step,
        time=time,
        position=position,
        kept=slice(first, stop),
        start_position=zero,
        switch_from=step.switch_from,
        switch_to=step.switch_to,
        moment=step.moment,
        cut_by=trim.ended(dof) if crossed else LOG_ENDS if step.ends_log else dof.fill(COMMAND_ENDS),
        turned=float(end - zero),
        noise=noise,
        steady=_is_steady(time, position, noise),
        why="",
    )
    return replace(turn, why=_why_not(turn, crossed))


def _kept_samples(position: Floats, crossing: int, noise: float) -> int:
    """How many samples are kept of a step that half a turn (or what else limits the motion) ends after `crossing`
    samples."""
    back = min(10, crossing - 1)
    if back < 1:
        return max(crossing, 1)
    pace = abs(position[crossing - 1] - position[crossing - 1 - back]) / back
    margin = math.ceil(MARGIN_IN_SIGMA * noise / pace) if pace > 0 else crossing
    return max(crossing - margin, min(crossing, FEWEST_SAMPLES))


def _is_steady(time: Floats, position: Floats, noise: float) -> bool:
    """Whether the rate of the last third is that of the third before, within a tenth or the noise."""
    third = len(time) // 3
    if third < 3:
        return False
    late, late_error = slope(time[-third:], position[-third:])
    middle, middle_error = slope(time[-2 * third : -third], position[-2 * third : -third])
    change, doubt = abs(late - middle), SURE * noise * math.hypot(late_error, middle_error)
    return change <= STILL_CHANGING * abs(late) or change <= doubt


def _why_not(turn: HalfTurn, crossed: bool) -> str:
    """The sentence for which a half-turn is set aside, or nothing."""
    run, step, count = turn.step.run, turn.step, len(turn.position)
    dof, words, force, steady = run.dof, run.dof.words, run.dof.words.force, turn.steady
    at = f"the step of {turn.moment:.4g} {run.moment_unit}".rstrip()
    shown = round(abs(float(dof.shown(turn.turned))))
    way = f"{shown} {words.unit if shown == 1 else words.units}"
    repeats, _ = longest_repeat(turn.position, np.ones(count, dtype=bool))
    if repeats >= max(FEWEST_STUCK, count / 2) and not is_slow(run.position, repeats):
        return (
            f"{words.sensor} stuck: {repeats} of {count} samples of {at} show one {words.position}. "
            f"Check the {words.sensor}, or whether the vehicle was held"
        )
    if count < FEWEST_SAMPLES:
        return (
            f"too short: {at} has {count} samples ({turn.cut_by}); at least {FEWEST_SAMPLES} are needed. Log faster or "
            f"hold the {force} longer"
        )
    if not turn.moved:
        why = f"never moved: {way} {words.moved} in {at}. Use a larger {force}, and check thrusters and tether"
        radians = dof.column(dof.position, "rad") if dof.wraps else ""
        return why + f"; if the {words.position} column is in radians, name it {radians}" * dof.wraps
    if not step.from_rest:
        return (
            f"not from rest: {at} begins at {dof.shown(step.start_rate):.3g} {words.units}/s. Let the vehicle come to "
            f"rest{f' at zero {force}' * (not dof.has_constant)} before each step"
        )
    if turn.turned * turn.moment < 0 and not dof.has_constant:
        return (
            f"units look wrong: {at} {words.moved} the vehicle {way} against it. If the {words.position} counts "
            f"{words.other_way}, map it with sign = -1 in the --columns file or the campaign: under [columns] "
            f'{dof.column(dof.position, dof.units.log)} = {{ from = "NAME", sign = -1 }}'
        )
    if crossed or (abs(turn.turned) >= dof.limits.least and steady):
        return ""
    longer = f"Hold each {force} for {words.reach if dof.wraps else 'longer'}"
    after = f"{turn.cut_by} after {way} of {at}"
    if not dof.wraps and steady:
        return f"ended too soon: {after}. {longer}"
    settled = f"its {words.speed} was still changing" if not steady else f"{words.reach} was not near"
    ended = "ended before steady" if step.ends_log else f"{force} changed before steady"
    return f"{ended}: {after}, and {settled}. {longer}"


def why_none(run: Run, turns: Sequence[HalfTurn]) -> str:
    """Why none of the steps of a run serves: its commands did not move it, or what the first lacks that did."""
    if why := undriven(run):
        return why
    dof, extent = run.dof, float(np.ptp(run.position))
    if not turns:
        return dof.fill(NO_STEP)
    first = next((turn for turn in turns if turn.moved), turns[0])
    if first.moved or extent < dof.limits.least:
        return first.why
    words, unit = dof.words, dof.units.shown
    return (
        f"no step: the vehicle {words.moved} over {dof.shown(extent):.3g} {unit}, but under a changing {words.force}; "
        f"none that is constant lasts. Hold the {words.force} constant, or fit whole runs"
    )
