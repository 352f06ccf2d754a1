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
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import slope
from automarine_cli.runs.run import Run, SetAside
from automarine_cli.runs.sense import is_slow, longest_repeat
from automarine_cli.runs.steps import Step, find_steps, start_position
from automarine_cli.runs.undriven import undriven

COMMAND_ENDS = "the {force} changed"
LOG_ENDS, WINDOW = "the log ended", "the window"

FEWEST_SAMPLES = 8
MARGIN_IN_SIGMA = 3.0
STILL_CHANGING = 0.1  # of the last third's rate
SURE = 4.0  # standard errors


@dataclass(frozen=True)
class Trim:
    """How far a step is followed [rad or m]: `reach` from its start (None: as its motion has it, half a turn in yaw),
    and only while the position is between `low` and `high`.
    """

    reach: float | None = None
    low: float = -math.inf
    high: float = math.inf

    def beyond(self, position: Floats, zero: float, noise: float, dof: Dof) -> NDArray[np.bool_]:
        """Which samples, (N,), are no longer followed; the ends of a window are as sure as the noise lets them be."""
        far = np.abs(position - zero) > (dof.limits.trim if self.reach is None else self.reach)
        if math.isinf(self.low) and math.isinf(self.high):
            return np.asarray(far)
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
        """Whether the half-turn can be used for a fit."""
        return not self.why

    @property
    def moved(self) -> bool:
        """Whether the vehicle went further than standing still looks like."""
        return abs(self.turned) >= least_way(self.step.run.dof, self.noise)

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.step.run.name

    def of(self, run: Run) -> "HalfTurn":
        """The same of another version of the run, with the same samples."""
        return self if run is self.step.run else replace(self, step=replace(self.step, run=run))


def half_turn(run: Run, step: Step, trim: Trim = UNTRIMMED) -> HalfTurn:
    """Trim a step to |psi - psi0| <= pi and judge it. Trimming what was trimmed changes nothing."""
    noise = run.noise
    zero = start_position(step)
    whole = run.position[step.segment]
    stop, crossed = _end(whole - zero, trim.beyond(whole, zero, noise, run.dof), noise)
    kept = slice(step.first, step.first + stop)
    cut_by = trim.ended(run.dof) if crossed else LOG_ENDS if step.ends_log else run.dof.fill(COMMAND_ENDS)
    time, position = run.time[kept], run.position[kept]
    steady = _is_steady(time, position, noise)
    turned = _last_position(time, position) - zero
    return HalfTurn(
        step=step,
        time=time,
        position=position,
        kept=kept,
        start_position=zero,
        switch_from=step.switch_from,
        switch_to=step.switch_to,
        moment=step.moment,
        cut_by=cut_by,
        turned=turned,
        noise=noise,
        steady=steady,
        why=_why_not(step, position, turned, noise, cut_by, steady, crossed),
    )


def half_turns(runs: Iterable[Run], trim: Trim = UNTRIMMED) -> tuple[tuple[HalfTurn, ...], tuple[SetAside, ...]]:
    """The first half-turn of every run that serves, and the runs set aside with their reasons."""
    good: list[HalfTurn] = []
    aside: list[SetAside] = []
    for run in runs:
        turn, why = first_half_turn(run, trim)
        if turn is not None:
            good.append(turn)
        else:
            aside.append(SetAside(run.source, run.name, why))
    return tuple(good), tuple(aside)


def first_half_turn(run: Run, trim: Trim = UNTRIMMED) -> tuple[HalfTurn | None, str]:
    """Of a run with several steps the first that serves; if none does, None and why."""
    turns = []
    for step in find_steps(run):
        turns.append(half_turn(run, step, trim))
        if turns[-1].serves:
            return turns[-1], ""
    return None, why_none(run, turns)


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


NO_STEP = "no step: no constant {force} is held for at least 5 samples. Hold the {force} constant, or fit whole runs"


def least_way(dof: Dof, noise: float) -> float:
    """How far [rad or m] a vehicle that does not stand still goes at least."""
    return max(dof.limits.still, 5 * noise)


def _end(turned: Floats, beyond: NDArray[np.bool_], noise: float) -> tuple[int, bool]:
    """Number of samples kept, and whether half a turn (or what else limits the motion) ended them."""
    if not beyond.any():
        return len(turned), False
    crossing = int(np.argmax(beyond))
    back = min(10, crossing - 1)
    if back < 1:
        return max(crossing, 1), True
    pace = abs(turned[crossing - 1] - turned[crossing - 1 - back]) / back
    margin = math.ceil(MARGIN_IN_SIGMA * noise / pace) if pace > 0 else crossing
    return max(crossing - margin, min(crossing, FEWEST_SAMPLES)), True


def _last_position(time: Floats, position: Floats) -> float:
    """Position at the last sample [rad or m], from the line through the last six."""
    late, last = time[-6:], position[-6:]
    rate, _ = slope(late, last)
    return float(last.mean() + rate * (late[-1] - late.mean()))


def _is_steady(time: Floats, position: Floats, noise: float) -> bool:
    """Whether the rate of the last third is that of the third before, within a tenth or the noise."""
    third = len(time) // 3
    if third < 3:
        return False
    late, late_error = slope(time[-third:], position[-third:])
    middle, middle_error = slope(time[-2 * third : -third], position[-2 * third : -third])
    change = abs(late - middle)
    return change <= STILL_CHANGING * abs(late) or change <= SURE * noise * math.hypot(late_error, middle_error)


def _why_not(
    step: Step, position: Floats, turned: float, noise: float, cut_by: str, steady: bool, crossed: bool
) -> str:
    """The sentence for which a half-turn is set aside, or nothing."""
    dof, words = step.run.dof, step.run.dof.words
    whole = round(abs(float(dof.shown(turned))))
    way = f"{whole} {words.unit if whole == 1 else words.units}"
    at = f"the step of {step.moment:.4g} {step.run.moment_unit}".rstrip()
    repeats, _ = longest_repeat(position, np.ones(len(position), dtype=bool))
    if repeats >= max(10, len(position) / 2) and not is_slow(step.run.position, repeats):
        return (
            f"{words.sensor} stuck: {repeats} of {len(position)} samples of {at} show one {words.position}. "
            f"Check the {words.sensor}, or whether the vehicle was held"
        )
    if len(position) < FEWEST_SAMPLES:
        return (
            f"too short: {at} has {len(position)} samples ({cut_by}); at least {FEWEST_SAMPLES} are needed. "
            f"Log faster or hold the {words.force} longer"
        )
    if abs(turned) < least_way(dof, noise):
        radians = (
            f"; if the {words.position} column is in radians, name it {dof.column(dof.position, 'rad')}"
            if dof.wraps
            else ""
        )
        return (
            f"never moved: {way} {words.moved} in {at}. Use a larger {words.force}, and check thrusters and "
            f"tether{radians}"
        )
    if not step.from_rest:
        return (
            f"not from rest: {at} begins at {dof.shown(step.start_rate):.3g} {words.units}/s. "
            f"Let the vehicle come to rest{f' at zero {words.force}' * (not dof.has_constant)} before each step"
        )
    if turned * step.moment < 0 and not dof.has_constant:
        return (
            f"units look wrong: {at} {words.moved} the vehicle {way} against it. If the {words.position} counts "
            f"{words.other_way}, map it with sign = -1 in the --columns file"
        )
    if not crossed and (abs(turned) < dof.limits.least or not steady):
        longer = f"Hold each {words.force} for {words.reach if dof.wraps else 'longer'}"
        if not dof.wraps and steady:
            return f"ended too soon: {cut_by} after {way} of {at}. {longer}"
        settled = f"its {words.speed} was still changing" if not steady else f"{words.reach} was not near"
        ended = "ended before steady" if step.ends_log else f"{words.force} changed before steady"
        return f"{ended}: {cut_by} after {way} of {at}, and {settled}. {longer}"
    return ""
