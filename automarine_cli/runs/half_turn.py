"""The first half-turn of a step: |psi - psi0| <= pi, both directions alike; what was kept, what cut it, why
not used.

Walls, tether and the vehicle's own wake spoil what comes after half a turn (the source paper's section 3.2),
so each run is trimmed to it. Ending at the first noisy sample beyond pi would let the noise choose the last
sample, which biases the drag by about 0.1 %: the samples within three standard deviations before pi are
dropped as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.flat import Mask
from automarine_cli.runs.run import Run
from automarine_cli.runs.sense import is_slow, longest_repeat
from automarine_cli.runs.steps import Step
from automarine_cli.runs.undriven import undriven

COMMAND_ENDS = "the {force} changed"
LOG_ENDS, WINDOW = "the log ended", "the window"

FEWEST_SAMPLES = 8
MARGIN_IN_SIGMA = 3.0


@dataclass(frozen=True)
class Trim:
    """How far a step is followed [rad or m]: `reach` from its start (None: as its motion has it, half a turn in yaw),
    and only while the position is between `low` and `high`.
    """

    reach: float | None = None
    low: float = -math.inf
    high: float = math.inf

    def beyond(self, position: Floats, zero: Floats, noise: Floats, dof: Dof) -> Mask:
        """Which samples, all (N,), are no longer followed; the ends of a window are as sure as the noise lets them
        be."""
        far = np.abs(position - zero) > (dof.limits.trim if self.reach is None else self.reach)
        if math.isinf(self.low) and math.isinf(self.high):
            return np.asarray(far)
        margin = MARGIN_IN_SIGMA * noise
        return np.asarray(far | (position < self.low - margin) | (position > self.high + margin))

    def of_whole(self, run: Run) -> Run:
        """A whole run of a translation as far as it is followed."""
        out = self.beyond(run.position, run.position[:1], np.array([run.noise]), run.dof)
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
        return bool(abs(self.turned) >= least_way(self.step.run.dof, self.noise))

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.step.run.name

    def of(self, run: Run) -> "HalfTurn":
        """The same of another version of the run, with the same samples."""
        return self if run is self.step.run else replace(self, step=replace(self.step, run=run))


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


def least_way(dof: Dof, noise: Floats | float) -> Floats:
    """How far [rad or m] a vehicle that does not stand still goes at least, shape of the `noise` [rad or m]."""
    return np.maximum(dof.limits.still, 5 * noise)


def _at(turn: HalfTurn) -> str:
    return f"the step of {turn.moment:.4g} {turn.step.run.moment_unit}".rstrip()


def _way(turn: HalfTurn) -> str:
    words = turn.step.run.dof.words
    whole = round(abs(float(turn.step.run.dof.shown(turn.turned))))
    return f"{whole} {words.unit if whole == 1 else words.units}"


def stuck(turn: HalfTurn) -> str:
    """The sensor showed one position; empty where it is only slow."""
    words, count = turn.step.run.dof.words, len(turn.position)
    repeats, _ = longest_repeat(turn.position, np.ones(count, dtype=bool))
    if is_slow(turn.step.run.position, repeats):
        return ""
    return (
        f"{words.sensor} stuck: {repeats} of {count} samples of {_at(turn)} show one {words.position}. "
        f"Check the {words.sensor}, or whether the vehicle was held"
    )


def too_short(turn: HalfTurn) -> str:
    """Too few samples."""
    return (
        f"too short: {_at(turn)} has {len(turn.position)} samples ({turn.cut_by}); at least {FEWEST_SAMPLES} are "
        f"needed. Log faster or hold the {turn.step.run.dof.words.force} longer"
    )


def never_moved(turn: HalfTurn) -> str:
    """The vehicle stood still."""
    dof, words = turn.step.run.dof, turn.step.run.dof.words
    radians = (
        f"; if the {words.position} column is in radians, name it {dof.column(dof.position, 'rad')}"
        if dof.wraps else ""
    )  # fmt: skip
    return (
        f"never moved: {_way(turn)} {words.moved} in {_at(turn)}. Use a larger {words.force}, and check thrusters and "
        f"tether{radians}"
    )


def not_from_rest(turn: HalfTurn) -> str:
    """It moved already."""
    dof, words = turn.step.run.dof, turn.step.run.dof.words
    return (
        f"not from rest: {_at(turn)} begins at {dof.shown(turn.step.start_rate):.3g} {words.units}/s. "
        f"Let the vehicle come to rest{f' at zero {words.force}' * (not dof.has_constant)} before each step"
    )


def against(turn: HalfTurn) -> str:
    """It went against its command."""
    dof, words = turn.step.run.dof, turn.step.run.dof.words
    return (
        f"units look wrong: {_at(turn)} {words.moved} the vehicle {_way(turn)} against it. If the {words.position} "
        f"counts {words.other_way}, map it with sign = -1 in the --columns file or the campaign: under [columns] "
        f'{dof.column(dof.position, dof.units.log)} = {{ from = "NAME", sign = -1 }}'
    )


def too_soon(turn: HalfTurn) -> str:
    """It did not go far enough."""
    dof, words, steady = turn.step.run.dof, turn.step.run.dof.words, turn.steady
    longer = f"Hold each {words.force} for {words.reach if dof.wraps else 'longer'}"
    after = f"{turn.cut_by} after {_way(turn)} of {_at(turn)}"
    if not dof.wraps and steady:
        return f"ended too soon: {after}. {longer}"
    settled = f"its {words.speed} was still changing" if not steady else f"{words.reach} was not near"
    ended = "ended before steady" if turn.step.ends_log else f"{words.force} changed before steady"
    return f"{ended}: {after}, and {settled}. {longer}"
