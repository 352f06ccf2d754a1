"""Steps of one constant moment or force, and the first half-turn of each: |psi - psi0| <= pi.

Walls, tether and the vehicle's own wake spoil what comes after half a turn (the source paper's section 3.2). To end at
the first noisy sample beyond pi biases the drag by about 0.1 %: the samples within three standard deviations before pi
are dropped as well."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.checks import is_slow, longest_repeat, undriven
from automarine_cli.runs.load import Mask
from automarine_cli.runs.run import ExcludedRun, Run, filled, position_noise, slope
from automarine_cli.text import plural

SAME_MOMENT = 1e-6  # of the run's largest moment: moments closer than this are one
MIN_STEP_SAMPLES = 5  # a shorter stretch of one moment is part of a changing command
MIN_REST_SAMPLES = 2
SHORT_REST_SAMPLES = 10
SLOW_RATE_SHARE = 0.1  # of the mean rate of the step: a slower start counts as standing still
REST_STDERRS = 4.0  # standard errors
TOGETHER_STDERRS = 3.0  # standard errors of the mean of all steps that begin their logs


@dataclass(frozen=True)
class Step:
    """Samples `first` to `stop - 1` of `run` hold the constant `moment` [the run's unit].

    The command switched somewhere in (`switch_from`, `switch_to`] [s, campaign clock]: after the sample before, or one
    sample period before a log that begins with the moment on. `rest` are the samples at zero moment before it during
    which the vehicle stood still, `start_position` [rad or m] their mean (None: there are none). `start_rate` [rad/s or
    m/s] is what rate it seems to start with."""

    run: Run
    first: int
    stop: int
    moment: float
    rest: slice | None
    from_rest: bool
    start_rate: float

    @property
    def switch_from(self) -> float:
        run = self.run
        return float(run.time[self.first - 1] if self.first else run.time[0] - run.sample_period)

    @property
    def switch_to(self) -> float:
        return float(self.run.time[self.first])

    @property
    def switch_mid(self) -> float:
        """Middle of the interval in which the command switched [s]."""
        return (self.switch_from + self.switch_to) / 2

    @property
    def start_position(self) -> float | None:
        return None if self.rest is None else float(self.run.position[self.rest].mean())

    @property
    def begins_log(self) -> bool:
        return self.first == 0


ALREADY_ON = "the log begins with the {force} already on: its switch is taken within the sample period before"


def find_steps(run: Run) -> tuple[Step, ...]:
    """Find the stretches of one constant moment other than 0, in order. Raises RunError without a moment."""
    least = _least_change(run.command)
    stretches = ((a, b, moment) for a, b, moment in segments(run.command) if moment != 0 and b - a >= MIN_STEP_SAMPLES)
    return tuple(_step(run, first, stop, moment, least) for first, stop, moment in stretches)


def segments(moment: Floats) -> list[tuple[int, int, float]]:
    """(first, stop, moment) of every stretch of one constant moment, in order; a hair around 0 is 0."""
    if not len(moment):
        return []
    least = _least_change(moment)
    first = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(moment)) > least) + 1])
    value = np.where(np.abs(moment[first]) > least, moment[first], 0.0)
    return list(zip(first.tolist(), [*first[1:].tolist(), len(moment)], value.tolist()))


def _least_change(moment: Floats) -> float:
    return SAME_MOMENT * float(np.abs(moment).max(initial=0.0))


def _step(run: Run, first: int, stop: int, moment: float, least: float) -> Step:
    rest_from, pace = _rest(run, first, stop, least)
    rate = 0.0
    from_rest = rest_from < first
    if not from_rest:
        rate, doubt = start_motion(run.time[first:stop], run.position[first:stop], run.noise, run.dof.limits.start)
        # too little before the step to tell: its own start decides
        from_rest = first < SHORT_REST_SAMPLES and abs(rate) <= SLOW_RATE_SHARE * abs(pace) + REST_STDERRS * doubt
    return Step(run, first, stop, moment, slice(rest_from, first) if rest_from < first else None, from_rest, rate)


def _rest(run: Run, first: int, stop: int, least: float) -> tuple[int, float]:
    """First sample of the longest stretch of zero moment (under a constant force: of any one) before the samples
    `first` to `stop` - 1 without a slope of the position, `first` for none; and the mean rate of these samples [rad/s
    or m/s]."""
    far = np.abs(run.position[first:stop] - run.position[first]) > run.dof.limits.trim
    last = first + int(np.argmax(far)) if far.any() else stop - 1  # as far as a step is followed at most
    pace = 0.0
    if last > first:
        pace = float((run.position[last] - run.position[first]) / (run.time[last] - run.time[first]))
    idle = run.command[first - 1] if run.dof.has_constant and first else 0.0
    acting = np.flatnonzero(np.abs(run.command[:first] - idle) > least)
    length, most = first - (int(acting[-1]) + 1 if acting.size else 0), SLOW_RATE_SHARE * abs(pace)
    while length >= MIN_REST_SAMPLES:
        start = first - length
        rate, error = slope(run.time[start:first], run.position[start:first])
        doubt = REST_STDERRS * error * run.noise
        # where the log begins with no command, nothing moved the vehicle before
        if abs(rate) <= doubt + 0.2 * most and (doubt <= most or (start == 0 and abs(idle) <= least)):
            return start, pace
        length = int(0.7 * length)
    return first, pace


START_S = 1.0  # length of a piece that shows a rate; a command shows within two of them


def commanded_before(run: Run, dof: Dof) -> float:
    """Return what was commanded before the first sample [unit of the command].

    Nothing where a vehicle at rest gives way to the first command, for its log begins with that; else the first one.
    """
    first = float(run.command_of(dof)[0])
    if dof is run.dof:
        step = next(iter(find_steps(run)), None)
        if step and step.begins_log and step.from_rest:
            return 0.0
    return 0.0 if first != 0.0 and not dof.has_constant and _sets_off(run, dof) else first


def _sets_off(run: Run, dof: Dof) -> bool:
    """Whether a motion begins with the log, by its velocities if they are logged, else by its position."""
    velocity, since = run.channel(dof.velocity), run.time - run.time[0]
    have = np.zeros(len(run), dtype=bool) if velocity is None else np.isfinite(velocity)
    if velocity is not None and have.any():
        begin, pace = abs(float(velocity[have][0])), float(np.abs(velocity[have]).max())
        later = float(np.interp(2.0 * START_S, since[have], velocity[have]))
    elif dof is run.dof and since[-1] >= 2.0 * START_S:
        count = max(MIN_STEP_SAMPLES, int(np.searchsorted(since, 0.5 * START_S)))
        straight, error = slope(since[:count], run.position[:count])
        bent, doubt = start_motion(run.time, run.position, run.noise, dof.limits.start)  # where a few samples are far
        begin = max(0.0, min(abs(straight) - 2.0 * error * run.noise, abs(bent) - doubt))
        rates = np.diff(np.interp(np.arange(0.0, since[-1], START_S), since, run.position)) / START_S
        later, pace = float(rates[min(1, len(rates) - 1)]), float(np.abs(rates).max())
    else:
        return False
    gained = later * np.sign(run.command_of(dof)[0])
    return bool(begin <= SLOW_RATE_SHARE * pace < gained)


def released(run: Run) -> int:
    """The first sample of a new command before which the vehicle stands still from the start of the run on; else 0."""
    for first, stop, _ in segments(run.command)[1:2]:
        start, _ = _rest(run, first, stop, _least_change(run.command))
        return first if start < first and start <= 2 else 0
    return 0


MIN_P_REST = 1e-3  # of what vehicles at rest would show
LEAST_DRIFT = 0.002  # of a run's mean slope: a rest's slope is never told better


def start_at_rest(runs: Sequence[Run]) -> NDArray[np.bool_]:
    """Which runs (R,) begin with the vehicle standing still at zero moment, or where a constant force acts at any.

    None does where all rests together show a motion that is too slow for each to show: what pushes a vehicle that
    nobody holds has begun before its log. By slopes of positions and velocities, whatever the bias of their sensor.
    """
    if runs and runs[0].dof.has_constant:
        return np.array([released(run) > 0 for run in runs])
    firsts = [next(iter(find_steps(run)), None) for run in runs]
    pauses = [step.rest if step and step.rest and step.rest.start <= 2 else None for step in firsts]
    z = np.array([z for run, pause in zip(runs, pauses) if pause for z in _drifts(run, pause)])
    to_one_side = special.erfc(abs(z.sum()) / np.sqrt(2.0 * max(len(z), 1)))
    moves = min(special.chdtrc(max(len(z), 1), z @ z), to_one_side) < MIN_P_REST
    return np.array([pause is not None and not moves for pause in pauses], dtype=bool)


def _drifts(run: Run, pause: slice) -> list[float]:
    """Slopes of the position and, where it is logged, the velocity over a pause, in standard errors."""
    time, velocity, drifts = run.time[pause], run.channel(run.dof.velocity), list[float]()
    for readings in (run.position, velocity):
        if readings is None or len(time) <= MIN_REST_SAMPLES or not np.isfinite(readings[pause]).all():
            continue
        noise = run.noise if readings is run.position else position_noise(run.time, filled(run.time, readings))
        rate, error = slope(time, readings[pause])
        least = LEAST_DRIFT * float(np.ptp(readings)) / (run.time[-1] - run.time[0])
        drifts.append(rate / max(error * noise, least) if rate else 0.0)
    return drifts


def start_motion(
    time: Floats, position: Floats, sigma: float, way: float, at: float | None = None
) -> tuple[float, float]:
    """Estimate the rate [rad/s or m/s] `at` a time [s], the first sample's if None, and its standard error, by a
    parabola through what moved less than `way` [rad or m], at least 6 samples. `sigma` [rad or m] is the noise."""
    count = start_length(position, way)
    since, position = time[:count] - (time[0] if at is None else at), position[:count]
    coefficients, covariance = np.polyfit(since, position, min(2, count - 1), cov="unscaled")
    if abs(position[-1] - position[0]) > 2 * way:  # a slow logger sees more than a parabola
        residual = position - np.polyval(coefficients, since)
        sigma = max(sigma, float(np.sqrt(residual @ residual / max(count - 3, 1))))
    return float(coefficients[-2]), sigma * float(np.sqrt(covariance[-2, -2]))


def start_length(position: Floats, way: float) -> int:
    """How many samples belong to the start of a step: those before the position has moved by `way` for good."""
    moved = np.abs(position - position[0]) > way
    lasting = moved[:-1] & moved[1:]  # two in a row: a single sample may be noise
    count = int(np.argmax(lasting)) if lasting.any() else len(position)
    return min(max(count, 6), len(position))


def start_position(step: Step) -> float:
    """Estimate the position at the step [rad or m]: the mean over the rest before it, else a parabola through its start
    at the middle of the switch interval (from a standstill without slope there)."""
    if step.start_position is not None:
        return step.start_position
    position = step.run.position[step.first : step.stop]
    count = start_length(position, step.run.dof.limits.start)
    time = step.run.time[step.first : step.first + count] - step.switch_mid
    if step.from_rest:
        design = np.column_stack([np.ones(count), time**2])
        return float(np.linalg.lstsq(design, position[:count], rcond=None)[0][0])
    return float(np.polyfit(time, position[:count], min(2, count - 1))[-1])


COMMAND_ENDS = "the {force} changed"
NO_STEP = "no step: no constant {force} is held for at least 5 samples. Hold the {force} constant, or fit whole runs"
LOG_ENDS, WINDOW_ENDS = "the log ended", "the window"

MIN_HALF_TURN_SAMPLES = 8
MARGIN_IN_SIGMA = 3.0
MIN_STUCK_STEP_SAMPLES = 10  # samples of one exact position
MAX_RATE_CHANGE = 0.1  # of the last third's rate
MAX_REST_SAMPLES = 200  # of rest before a step that are used; more would say much of slow drifts


@dataclass(frozen=True)
class Trim:
    """How far a step is followed [rad or m]: `reach` from its start (None: half a turn, or as its motion has it), and
    only between the positions `low` and `high`."""

    reach: float | None = None
    low: float = -math.inf
    high: float = math.inf

    def beyond(self, position: Floats, zero: float, noise: float, dof: Dof) -> Mask:
        """Which positions (N,) are no longer followed; the ends of a window are as sure as the noise lets them be."""
        far = np.abs(position - zero) > (dof.limits.trim if self.reach is None else self.reach)
        margin = MARGIN_IN_SIGMA * noise
        return np.asarray(far | (position < self.low - margin) | (position > self.high + margin))

    def of_whole(self, run: Run) -> Run:
        """A whole run of a translation as far as it is followed."""
        out = self.beyond(run.position, float(run.position[0]), run.noise, run.dof)
        return run.cut(0, int(np.argmax(out))) if not run.dof.wraps and out.any() else run

    def ended(self, dof: Dof) -> str:
        return dof.words.reach if dof.wraps or self.reach is not None else WINDOW_ENDS


UNTRIMMED = Trim()


@dataclass(frozen=True)
class HalfTurn:
    """The samples `kept` of a step, their `time` [s, campaign clock] and `position` [rad or m]; `start_position` psi0;
    what it was `cut_by`, the signed way `turned`, whether the rate was `steady`; `why` it is set aside, or empty. The
    run is followed for `ends` samples."""

    step: Step
    time: Floats
    position: Floats
    kept: slice
    start_position: float
    moment: float
    cut_by: str
    turned: float
    steady: bool
    ends: int
    why: str

    @property
    def moved(self) -> bool:
        """Whether the vehicle went further than standing still looks like."""
        return abs(self.turned) >= max(self.step.run.dof.limits.unmoved, 5 * self.step.run.noise)

    @property
    def name(self) -> str:
        return self.step.run.name

    @property
    def looked_at(self) -> tuple[int, int]:
        """Samples that sensors are judged by and figures show: some of the rest, and as much after."""
        step = self.step
        begin = max(step.first if step.rest is None else step.rest.start, step.first - MAX_REST_SAMPLES)
        return begin, min(step.stop, 2 * self.kept.stop - step.first)

    def of(self, run: Run) -> "HalfTurn":
        """The same of another version of the run, which has the same samples."""
        return replace(self, step=replace(self.step, run=run))


def all_half_turns(run: Run, trim: Trim = UNTRIMMED) -> list[HalfTurn]:
    """Trim every step of a run and judge it, in the order of time. Raises RunError where the run has no moment."""
    return [_half_turn(step, trim) for step in find_steps(run)]


def half_turns(runs: Iterable[Run], trim: Trim = UNTRIMMED) -> tuple[tuple[HalfTurn, ...], tuple[ExcludedRun, ...]]:
    """The first half-turn of every run that serves, and the runs set aside with their reasons; where steps that begin
    their logs are together not from rest, all of these."""
    good, aside = [], []
    for run in runs:
        turns = all_half_turns(run, trim)
        if first := next((turn for turn in turns if not turn.why), None):
            good.append(first)
        else:
            aside.append(ExcludedRun(run.source, run.name, why_none(run, turns)))
    sudden = [turn for turn in good if turn.step.begins_log]
    if why := _under_way(sudden):
        good = [turn for turn in good if not turn.step.begins_log]
        aside += [ExcludedRun(turn.step.run.source, turn.name, why) for turn in sudden]
    return tuple(good), tuple(aside)


def _under_way(turns: Sequence[HalfTurn]) -> str:
    """Why steps that begin their logs are not from rest, or nothing; all together show what each may be too noisy to:
    a rate already at the sample before the log, before which the command cannot have been there."""
    rates, z = list[float](), list[float]()
    for turn in turns:
        step, run, way = turn.step, turn.step.run, np.sign(turn.turned)
        rate, doubt = start_motion(turn.time, turn.position, run.noise, run.dof.limits.start, step.switch_from)
        slow = SLOW_RATE_SHARE * abs(turn.turned) / float(np.ptp(turn.time))
        rates.append(step.start_rate * way)
        z.append((rate * way - slow) / max(doubt, 0.01 * slow))
    if not z or sum(z) <= TOGETHER_STDERRS * math.sqrt(len(z)):
        return ""
    dof = turns[0].step.run.dof
    pace = f"{dof.shown(sum(rates) / len(rates)):.2g} {dof.words.units}/s"
    begin = "begins" if len(z) == 1 else "begin"
    logs = f"{plural(len(z), 'log')} that {begin} with the {dof.words.force} on"
    return f"not from rest: {logs} {begin} at {pace} on average. Start each log before its {dof.words.force}"


def _half_turn(step: Step, trim: Trim) -> HalfTurn:
    run, first = step.run, step.first
    dof, noise, zero = run.dof, run.noise, start_position(step)
    path = run.position[first : step.stop]
    beyond = trim.beyond(path, zero, noise, dof)
    crossed = bool(beyond.any())
    stop = first + _before(path, int(np.argmax(beyond)), noise) if crossed else step.stop
    time, position = run.time[first:stop], run.position[first:stop]
    rate, _ = slope(time[-6:], position[-6:])  # the end is read from the line through the last six samples
    end = position[-6:].mean() + rate * (time[-1] - time[-6:].mean())
    turn = HalfTurn(
        step, time, position, slice(first, stop), zero, step.moment,
        cut_by=trim.ended(dof) if crossed else LOG_ENDS if step.stop == len(run) else dof.fill(COMMAND_ENDS),
        turned=float(end - zero), steady=_is_steady(time, position, noise),
        ends=len(trim.of_whole(run)), why="",
    )  # fmt: skip
    return replace(turn, why=_why_not(turn, crossed))


def _before(path: Floats, crossing: int, noise: float) -> int:
    """How many samples of a step are surely before the end of the half-turn, which it reaches after `crossing`."""
    back = min(10, crossing - 1)
    if back < 1:
        return max(crossing, 1)
    pace = abs(path[crossing - 1] - path[crossing - 1 - back]) / back
    margin = math.ceil(MARGIN_IN_SIGMA * noise / pace) if pace > 0 else crossing
    return max(crossing - margin, min(crossing, MIN_HALF_TURN_SAMPLES))


def _is_steady(time: Floats, position: Floats, noise: float) -> bool:
    """Whether the rate of the last third is that of the third before, within a tenth or the noise."""
    third = len(time) // 3
    if third < 3:
        return False
    late, late_error = slope(time[-third:], position[-third:])
    middle, middle_error = slope(time[-2 * third : -third], position[-2 * third : -third])
    doubt = REST_STDERRS * noise * math.hypot(late_error, middle_error)
    return abs(late - middle) <= max(MAX_RATE_CHANGE * abs(late), doubt)


def _why_not(turn: HalfTurn, crossed: bool) -> str:
    """The sentence for which a half-turn is set aside, or nothing."""
    run, step, count = turn.step.run, turn.step, len(turn.position)
    dof, words, force, steady = run.dof, run.dof.words, run.dof.words.force, turn.steady
    at = f"the step of {turn.moment:.4g} {run.moment_unit}".rstrip()
    size = round(abs(float(dof.shown(turn.turned))))
    way = f"{size} {words.unit if size == 1 else words.units}"
    repeats, _ = longest_repeat(turn.position, np.ones(count, dtype=bool))
    if repeats >= max(MIN_STUCK_STEP_SAMPLES, count / 2) and not is_slow(run.position, repeats):
        same = f"{words.sensor} stuck: {repeats} of {count} samples of {at} show one {words.position}"
        return f"{same}. Check the {words.sensor}, or whether the vehicle was held"
    if count < MIN_HALF_TURN_SAMPLES:
        few = f"too short: {at} has {count} samples ({turn.cut_by}); at least {MIN_HALF_TURN_SAMPLES} are needed"
        return f"{few}. Log faster or hold the {force} longer"
    if not turn.moved:
        why = f"never moved: {way} {words.moved} in {at}. Use a larger {force}, and check thrusters and tether"
        if dof.wraps:
            why += f"; if the {words.position} column is in radians, name it {dof.column(dof.position, 'rad')}"
        return why
    if not step.from_rest:
        rest = "rest before each step" if dof.has_constant else f"rest at zero {force} before each step"
        pace = f"{dof.shown(step.start_rate):.3g} {words.units}/s"
        return f"not from rest: {at} begins at {pace}. Let the vehicle come to {rest}"
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
    ended = "ended before steady" if step.stop == len(run) else f"{force} changed before steady"
    return f"{ended}: {after}, and {settled}. {longer}"


def without_contrary(runs: Sequence[Run]) -> tuple[list[Run], tuple[ExcludedRun, ...]]:
    """Return the runs that may be modelled, and those whose first step drove them far against it though another run,
    pushed by no more to that side, went with it."""
    firsts = [None if run.dof.has_constant else next(iter(find_steps(run)), None) for run in runs]
    turns = {i: _half_turn(step, UNTRIMMED) for i, step in enumerate(firsts) if step is not None and step.from_rest}
    turns = {i: turn for i, turn in turns.items() if abs(turn.turned) >= turn.step.run.dof.limits.least}
    along = [turn for turn in turns.values() if turn.turned * turn.moment > 0]
    smallest = {way: min((abs(t.moment) for t in along if way * t.moment > 0), default=math.inf) for way in (-1.0, 1.0)}
    contrary = {
        i: turn.why
        for i, turn in turns.items()
        if turn.turned * turn.moment < 0
        and smallest[math.copysign(1.0, turn.moment)] <= (1 + SAME_MOMENT) * abs(turn.moment)
    }
    if len(contrary) >= len(along):  # then who is to say which are wrong?
        return list(runs), ()
    aside = tuple(ExcludedRun(runs[i].source, runs[i].name, why) for i, why in contrary.items())
    return [run for i, run in enumerate(runs) if i not in contrary], aside


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
    way = f"the vehicle {dof.words.moved} over {dof.shown(extent):.3g} {dof.units.shown}"
    says = "but under a changing {force}; none that is constant lasts. Hold the {force} constant, or fit whole runs"
    return f"no step: {way}, {dof.fill(says)}"
