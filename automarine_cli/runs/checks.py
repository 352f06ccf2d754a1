"""Is a run what its columns say, and did its commands move it? A check returns a sentence, or None where all is well.

Without a command drag only slows a vehicle down, a current carries it slowly, and a constant force takes it one way:
what gathers speed again and again with nothing commanded was moved by something that the log does not hold.

Where no thruster is at a limit, control allocation is one law, tau = sum c_i |n_i|^p sgn(n_i), with c_i of each way.
Fitted there, it says what the thrusters gave at their limits. Source: Fossen (2021), Handbook of Marine Craft
Hydrodynamics and Motion Control, second edition."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.pipeline.records import FILLER, to_mapping
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import LOGGED_COMMAND, ExcludedRun, Run, median
from automarine_cli.text import listed, plural

MIN_RUN_SAMPLES = 8
MIN_STUCK_SAMPLES = 20  # samples of one exact position
MAX_HELD_RATIO = 4.0  # as long as other values: a sensor that answers seldom is not stuck
MAX_PERIOD_S = 5.0  # s between samples; nobody logs a test more slowly
MIN_PERIOD_S = 2e-4  # s between samples
WAY_S = 1.0  # s over which a way is measured: it is longer than its noise
RADIANS_AS_DEGREES = 2 * np.pi * np.pi / 180  # a whole turn in radians, read as degrees
DEGREES_AS_RADIANS = 360.0
# how the reasons begin that prove the unit of a column
IN_OTHER_UNITS = tuple(f"units look wrong: the {dof.position} " for dof in DOFS.values() if dof.wraps)


def clock_trouble(time: Floats) -> str | None:
    """Why a clock, shape (N,), cannot be one of a test, or None."""
    count = len(time)
    if count > 1 and np.ptp(time) == 0:
        still = f"units look wrong: the clock stands still at {time[0]:.10g} s in all {count} rows"
        return f"{still}; expected a rising clock. Look at the time column, or map another with --columns"
    if count < MIN_RUN_SAMPLES:
        few = f"only {plural(count, 'sample')} left; at least {MIN_RUN_SAMPLES} are needed"
        return f"{few}. Check that the log was not cut short"
    period = median(np.diff(time))
    if MIN_PERIOD_S <= period < MAX_PERIOD_S:
        return None
    units, names = ("seconds", "time_s") if period < MIN_PERIOD_S else ("milli- or microseconds", "time_ms or time_us")
    trouble = f"{period:.4g} s between samples. If the clock counts {units}"
    return f"units look wrong: {trouble}, name it {names}, or say so with --columns"


def beyond(position: Floats, dof: Dof) -> NDArray[np.bool_]:
    """Tell which positions, (N,), no vehicle reaches: what some sensors say instead of nothing."""
    return np.asarray(np.abs(position - (0.0 if dof.wraps else median(position))) > dof.limits.far)


def position_trouble(time: Floats, position: Floats, dof: Dof) -> str | None:
    """Return why a position as logged, shape (N,) [rad or m], cannot be one of this motion, or None."""
    if dof.wraps:
        return _angle_trouble(time, position, dof)
    rules = {"m": ("millimetres", "mm"), "rad": ("degrees", "deg")}
    name, column = dof.position, dof.column(dof.position, dof.units.log)
    largest = median(np.abs(position - position[0]))
    later = np.interp(time + WAY_S, time, position)
    fastest = float(np.percentile(np.abs(later - position), 90)) / WAY_S
    if largest <= dof.limits.far and fastest <= dof.limits.fast:
        return None
    size = f"the {name} changes by {fastest:.3g} {dof.units.base}/s"
    size = f"a {name} of {largest:.3g} {dof.units.base}" if largest > dof.limits.far else size
    units, unit = rules[dof.units.base]
    rule = f'{column} = {{ from = "{name}", unit = "{unit}" }}'
    return f"units look wrong: {size}. If it is in {units}, say so with --columns, such as {rule}"


def _angle_trouble(time: Floats, angle: Floats, dof: Dof) -> str | None:
    name, limits = dof.position, dof.limits
    largest = float(np.abs(angle).max())
    if largest > limits.far and median(np.abs(angle)) > limits.far:
        wrong = f"units look wrong: a {name} of {dof.shown(largest):.3g} {dof.words.units}"
        return f"{wrong}. Check which column is the {name}"
    span, jumps = float(np.ptp(angle)), np.abs(np.diff(angle))

    def wraps_at(turn: float) -> bool:
        """Whether it stays within a turn, jumps by most of it, and is smooth otherwise."""
        return bool(span <= 1.001 * turn and jumps.max() > 0.75 * turn and median(jumps) < 0.05 * turn)

    unit, units = "deg", "degrees"
    if wraps_at(RADIANS_AS_DEGREES):
        unit, units, trouble = "rad", "radians", "wraps at 2 pi where it should at 360 degrees"
    elif wraps_at(DEGREES_AS_RADIANS):
        trouble = "wraps at 360 where it should at 2 pi radians"
    elif span > 2 * dof.turn and (speed := median(jumps / np.diff(time))) > limits.fast:
        trouble = f"changes by {speed:.3g} rad/s"
    else:
        return None
    mend = f'name it {dof.column(name, unit)}, or say unit = "{unit}" with --columns'
    return f"units look wrong: the {name} {trouble}. If it is in {units}, {mend}"


def stuck(position: Floats, command: Floats, dof: Dof) -> str | None:
    """Why a position that repeats one value while a command acts is unusable, or None."""
    acting, words = command != 0, dof.words
    if not acting.any():
        return None
    longest, at = longest_repeat(position, acting)
    if longest < max(MIN_STUCK_SAMPLES, acting.sum() / 2) or is_slow(position, longest):
        return None
    where = dof.shown(at) % 360 if dof.wraps else dof.shown(at)
    return (
        f"{words.sensor} stuck: {longest} samples of exactly {where:.6g} {words.units} while a {words.force} acts. "
        f"Check the {words.sensor} and its cable, or whether the vehicle was held"
    )


def is_slow(position: Floats, repeats: int) -> bool:
    """Tell whether `repeats` of one value are how a slow sensor works: other values are held for about as long."""
    edges = np.flatnonzero(np.diff(position)) + 1
    lengths = np.sort(np.diff(np.concatenate([[0], edges, [len(position)]])))[:-1]
    # each sample asks how long its own value stays
    return bool(len(lengths) and repeats <= MAX_HELD_RATIO * np.median(np.repeat(lengths, lengths)))


def longest_repeat(position: Floats, where: NDArray[np.bool_]) -> tuple[int, float]:
    """Length and value of the longest stretch of one exact position among the samples `where`."""
    same = (np.diff(position) == 0) & where[1:] & where[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same, [0]])))
    lengths = np.append(edges[1::2] - edges[::2], 0)
    best = int(np.argmax(lengths))
    return int(lengths[best]) + 1, float(position[edges[2 * best] if lengths[best] else 0])


SAME_PUSH_RATIO = 1.25  # pushes of one size: steps that end at one angle are logged a sample more or less
STILL_PIECE_S = 1.0  # positions are averaged over pieces of about this length, so that noise is no motion


def without_stuck(runs: Sequence[Run]) -> tuple[list[Run], tuple[ExcludedRun, ...]]:
    """Return the runs that may be modelled, and those of one constant moment that never moved, though another run did,
    pushed no harder to that side and no further: a command within a dead band moves no run."""
    moved = [run for run in runs if _moved(run)]
    good, aside = [], []
    for run in runs:
        free = run.dof.has_constant or _moved(run)  # under a constant force the smaller command may be what moves
        other = None if free else _moved_by_no_more(run, moved)
        if other is None:
            good.append(run)
            continue
        size = np.abs(run.command).max() * np.sign(run.command.sum())
        why = (
            f"never moved under a {run.dof.words.force} of {size:.4g} {run.moment_unit}, though run {other.name} "
            "did under no more; check thrusters and tether, and make the run again"
        )
        aside.append(ExcludedRun(run.source, run.name, why))
    return good, tuple(aside)


def _moved(run: Run) -> bool:
    """Whether the mean positions of its pieces differ by more than noise would make them."""
    count = max(1, min(len(run) // 3, int((run.time[-1] - run.time[0]) / STILL_PIECE_S)))
    means = [float(piece.mean()) for piece in np.array_split(run.position, count)]
    return max(means) - min(means) >= max(run.dof.limits.unmoved, 5 * run.noise)


def _push(run: Run) -> float:
    """Largest moment times the squared time that one acts: the way without drag, but for the inertia."""
    acting = float(np.sum(np.diff(run.time)[run.command[:-1] != 0]))
    return float(np.abs(run.command).max()) * acting**2


def _moved_by_no_more(run: Run, moved: Sequence[Run]) -> Run | None:
    """A run that moved under moments to the side of this run's only, none larger, that push it no further."""
    acting = np.unique(run.command[run.command != 0])
    if len(acting) != 1:
        return None
    size, side = abs(acting[0]), float(np.sign(acting[0]))
    for other in moved:
        same = other.moment_unit == run.moment_unit and np.abs(other.command).max() <= size * (1 + 1e-9)
        if same and np.all(side * other.command >= 0) and 0 < _push(other) <= SAME_PUSH_RATIO * _push(run):
            return other
    return None


SPEED_PIECE_S = 3.0  # over which speeds are taken: shorter than a manoeuvre, as long as waves rock
ECHO_S = 4.0  # after a command, in which delays, thrusters and water may still act on it
UNDRIVEN_TIMES = 3  # times that speed is gathered with nothing commanded
UNDRIVEN_SHARE = 0.8  # of all speed gathered
MIN_WAYS = 1.5  # times the least way of a step
SPEED_SIGMAS = 8.0  # standard deviations of the position


def without_undriven(runs: Sequence[Run]) -> tuple[list[Run], tuple[ExcludedRun, ...]]:
    """The runs that their commands may have moved, and those that something else did."""
    reasons = [(run, undriven(run)) for run in runs]
    aside = tuple(ExcludedRun(run.source, run.name, why) for run, why in reasons if why)
    return [run for run, why in reasons if why is None], aside


def undriven(run: Run) -> str | None:
    """Say why the commands of a run cannot have moved it, or None. Raises RunError where it has none.

    Mean speeds of pieces are compared with those of the pieces before. Speed is gathered with nothing commanded where
    no command acts in either or shortly before: nearly all of it, several times, both ways under a constant force."""
    dof, extent = run.dof, float(np.ptp(run.position))
    if dof.restoring:  # weight and buoyancy make speed by themselves
        return None
    pieces = max(1, int((run.time[-1] - run.time[0]) / SPEED_PIECE_S))
    edges = np.linspace(run.time[0], run.time[-1], pieces + 1)
    speed = np.diff(np.interp(edges, run.time, run.position)) / np.diff(edges)
    before, after = speed[:-1], speed[1:]
    gained = np.maximum(np.abs(after) - np.maximum(before * np.sign(after), 0.0), 0.0)
    gained[gained < max(dof.limits.start, SPEED_SIGMAS * run.noise) / SPEED_PIECE_S] = 0.0
    acting = run.time[run.acting]
    idle = np.searchsorted(acting, edges[:-2] - ECHO_S) == np.searchsorted(acting, edges[2:], side="right")
    alone = idle & (gained > 0)
    there, back = _times(alone & (after > 0)), _times(alone & (after < 0))
    one_way = dof.has_constant and min(there, back) == 0
    little = extent < MIN_WAYS * dof.limits.least or there + back < UNDRIVEN_TIMES
    if little or one_way or gained[alone].sum() < UNDRIVEN_SHARE * gained.sum():
        return None
    words, unit = dof.words, dof.units.shown
    return (
        f"the {words.force} commanded is 0 in {100 * np.mean(run.command == 0):.3g} % of the log, while the vehicle "
        f"{words.moved} over {dof.shown(extent):.0f} {unit} at up to {dof.shown(np.abs(speed).max()):.2g} {unit}/s and "
        f"gathered speed {there + back} times with nothing commanded: something that this log does not hold moved it, "
        f"such as another console or a hand. Expected the {words.force} that moved it: log the commands that reach the "
        "thrusters, or map their columns with --columns"
    )


MAX_COAST_SHARE = 0.8  # of its first speed that a run may have left at its end to show drag
MAX_REGAINED_SHARE = 0.25  # of its first speed that a run may gather again, or have the other way


def coasts(run: Run) -> bool:
    """Whether a run without a command slows down from a speed of its own, or swings, which shows drag over inertia."""
    if run.dof.restoring:
        return still(run) is None
    ends = max(1, min(round(SPEED_PIECE_S / run.sample_period), len(run) // 4))
    way, last = run.position[ends] - run.position[0], run.position[-1] - run.position[-1 - ends]
    last = last * np.sign(way) if run.dof.has_constant else abs(last)  # a constant force may turn it round
    least = max(run.dof.limits.start, SPEED_SIGMAS * run.noise)
    return bool(abs(way) > least and last < MAX_COAST_SHARE * abs(way))


def let_go(run: Run) -> Run | None:
    """Return a run without a command from where it is fastest on: a hand that pushes the vehicle is no drag. None where
    it does not slow down from there on, as by drag alone."""
    count = max(2, min(round(STILL_PIECE_S / run.sample_period), len(run) // 10))
    speed = np.abs(run.position[count:] - run.position[:-count]) / (run.time[count:] - run.time[:-count])
    fastest = int(np.argmax(speed))
    run = run.cut(0 if speed[0] >= MAX_COAST_SHARE * speed[fastest] else fastest + count, len(run))
    if len(run) < MIN_RUN_SAMPLES or not coasts(run):
        return None
    speed = np.diff(run.position[::count]) / np.diff(run.time[::count])
    speed = speed * np.sign(speed[0])
    again = [np.max(speed - np.minimum.accumulate(speed)), 0.0 if run.dof.has_constant else -speed.min()]
    doubt = SPEED_SIGMAS * run.noise / (count * run.sample_period)
    return run if max(again) <= MAX_REGAINED_SHARE * speed[0] + doubt else None


OFF_SIGMAS = 4.0  # of the noise at which a vehicle is off its rest
HIGH_SHARE, HIGH_SIGMAS = 0.9, 2.0  # of its largest angle, less noise, at which it turns back, or is held
HEELED_QUARTERS = 3.0  # times the way down from there, after which no free swing rises any more
GROWN_SHARE, GROWN_SIGMAS = 0.1, 6.0  # of the largest swing, and of the noise, by which a hand makes swings grow


def decays(run: Run) -> tuple[Run, ...]:
    """Return the free decays of a run without a command, each from where the vehicle is let go on: what rises slowly or
    stays up longer than its way down takes is held by a hand. The run as it is where no hand shows."""
    off = run.position - median(run.position[len(run) // 2 :])
    aside = np.flatnonzero(np.abs(off) > OFF_SIGMAS * run.noise)
    edges = np.array([0, *aside[1:][np.diff(np.sign(off[aside])) != 0], len(run)])
    peaks = np.maximum.reduceat(np.abs(off), edges[:-1])
    grown = max(GROWN_SHARE * float(peaks.max()), GROWN_SIGMAS * run.noise)
    begins, starts, lowest = [0], [0], 0.0
    for begin, end, peak in zip(edges, edges[1:], peaks):
        high = begin + np.flatnonzero(np.abs(off[begin:end]) >= HIGH_SHARE * peak - HIGH_SIGMAS * run.noise)
        start, rises, falls, crosses = run.time[[begin, high[0], high[-1], min(end, len(run) - 1)]]
        by_hand = max(falls - rises, (rises - start) / HEELED_QUARTERS) > crosses - falls
        if by_hand and peak > lowest + grown:
            if begin == 0 or (starts == [0] and peaks[0] <= grown):  # nothing swings before
                begins, starts = [], []
            begins, starts, lowest = [*begins, int(begin)], [*starts, int(high[-1])], peak
        lowest = min(lowest, peak) if begin else peak
    parts = [run.cut(start, stop) for start, stop in zip(starts, [*begins[1:], len(run)])]
    return tuple(replace(part, name=f"{run.name}.{i}") for i, part in enumerate(parts, 1)) if parts[1:] else (*parts,)


def still(run: Run) -> str | None:
    """Say why a run of a vehicle that weight turns back shows no swing, or None."""
    size, words = float(np.ptp(run.position)), run.dof.words
    if size > max(2.0 * run.dof.limits.start, SPEED_SIGMAS * run.noise):
        return None
    return (
        f"no {words.step}: the {words.position} changes by {run.dof.shown(size):.2g} {words.units}; let the vehicle go "
        "from a larger angle"
    )


def _times(true: NDArray[np.bool_]) -> int:
    return int(np.sum(true[1:] & ~true[:-1]) + true[:1].sum())


Mask = NDArray[np.bool_]

THRUSTER_COLUMN = re.compile(r"(n|rpm|thruster)_\w+|thruster\d+")  # command or speed of one thruster
EXPONENTS = (2.0, 1.5, 1.0)  # Of thrust against speed, of normalised commands against thrust, and between
MAX_LAW_RESIDUAL = 0.01  # Share of the commands' root mean square that a law leaves of them; more is no law
MIN_SHORTFALL = 0.01  # Share of the largest command from which on what was given is not what was asked
MIN_LIMIT_SAMPLES = 3  # Samples at one largest value that make it a limit, and samples that fall short


@dataclass(frozen=True)
class Commanded:
    """Total command (N,) [`unit`] of a degree of freedom, and commands (N, T) of its thrusters `names`."""

    dof: Dof
    unit: str
    names: tuple[str, ...]
    total: Floats
    single: Floats


@dataclass(frozen=True)
class AllocationLimit:
    """What the thrusters did not give: `share` of the samples; in the worst what was `asked` and `given` [`unit`], and
    the commands of the `thrusters` at their limits."""

    dof: Dof = field(metadata=FILLER)
    unit: str
    share: float
    asked: float
    given: float
    thrusters: Mapping[str, float]

    @property
    def sentence(self) -> str:
        percent = f"{100 * self.share:.2g}" if self.share < 0.1 else f"{100 * self.share:.0f}"
        stops = listed(f"{name} at its limit of {limit:.4g}" for name, limit in self.thrusters.items())
        return (
            f"the thrusters cannot give the {self.dof.words.full_force} commanded in {percent} % of the samples: at "
            f"worst {self.asked:.4g} {self.unit} was asked and {self.given:.4g} {self.unit} given, with {stops}; fits "
            "use what was given"
        )

    @property
    def warning(self) -> str:
        return f"T{self.sentence[1:]}."

    def to_json(self) -> dict[str, object]:
        return {"command": self.dof.command} | to_mapping(self)


@dataclass(frozen=True)
class AllocationLaw:
    """An allocation: coefficients (2 T,) of every thruster ahead and astern, the exponent, and the commands (T,) at
    their limits, infinite where they never were."""

    names: tuple[str, ...]
    coefficients: Floats
    exponent: float
    low: Floats
    high: Floats
    tolerance: float

    def delivered(self, single: Floats) -> Floats:
        """What thrusters give under commands (N, T), (N,)."""
        return _terms(single, self.exponent) @ self.coefficients

    def short(self, total: Floats, single: Floats) -> Mask:
        """Which samples (N,) ask for what thrusters at a limit do not give."""
        at_limit = (_at(single, self.low, self.high)).any(axis=1)
        return np.asarray(at_limit & (np.abs(total - self.delivered(single)) > self.tolerance))


def commanded(run: Run) -> list[Commanded]:
    """The total commands of a run that single thrusters stand beside."""
    names = tuple(sorted(name for name in run.extras if THRUSTER_COLUMN.fullmatch(name)))
    if not names:
        return []
    single = np.stack([run.extras[name] for name in names], axis=1)
    totals = {dof: run.extras[dof.command] for dof in DOFS.values() if dof.command in run.extras}
    total = run.extras.get(LOGGED_COMMAND, run.moment)
    totals |= {run.dof: total} if total is not None else {}
    return [
        Commanded(dof, run.moment_unit if dof is run.dof else dof.units.forces[1], names, total, single)
        for dof, total in totals.items()
        if np.isfinite(total).all()
    ]


def laws_of(runs: Sequence[Sequence[Commanded]]) -> Iterator[tuple[AllocationLaw, dict[int, Commanded]]]:
    """The allocation of each degree of freedom of which runs show one, with what these ask, by their numbers."""
    for dof in DOFS.values():
        commands = {i: part for i, parts in enumerate(runs) for part in parts if part.dof is dof}
        if law := _law([*commands.values()]):
            yield law, commands


def _law(several: Sequence[Commanded]) -> AllocationLaw | None:
    """The allocation of one degree of freedom over several runs; None where the logs show none, or no limit."""
    if len({part.names for part in several}) != 1:
        return None
    total, single = _together(several)
    sound = np.isfinite(single).all(axis=1)
    total, single = total[sound], single[sound]
    if not total.any():
        return None
    low, high = _limits(single, np.minimum), _limits(single, np.maximum)
    free = ~_at(single, low, high).any(axis=1)
    if free.all() or not total[free].any():
        return None
    distinct = len(np.unique(single[free], axis=0))
    laws = []
    for exponent in EXPONENTS:
        terms = _terms(single[free], exponent)
        # thrusters that always pull together are taken to give alike: the least norm of terms of one size
        size = np.sqrt(np.mean(terms**2, axis=0))
        scale = np.where(size > 0, size, 1.0)
        scaled, _, rank, _ = np.linalg.lstsq(terms / scale, total[free], rcond=1e-6)
        coefficients = scaled / scale
        residual = float(np.sqrt(np.mean((total[free] - terms @ coefficients) ** 2)))
        if distinct > 2 * rank and residual <= MAX_LAW_RESIDUAL * float(np.sqrt(np.mean(total[free] ** 2))):
            tolerance = max(MIN_SHORTFALL * float(np.abs(total).max()), 10.0 * residual)
            laws.append((residual, AllocationLaw(several[0].names, coefficients, exponent, low, high, tolerance)))
    return min(laws, key=lambda pair: pair[0])[1] if laws else None


def _together(several: Sequence[Commanded]) -> tuple[Floats, Floats]:
    return np.concatenate([part.total for part in several]), np.concatenate([part.single for part in several])


def limit_of(law: AllocationLaw, several: Sequence[Commanded]) -> AllocationLimit | None:
    """What runs ask of the thrusters beyond their limits, None where that is nothing."""
    total, single = _together(several)
    short = law.short(total, single)
    if np.count_nonzero(short) < MIN_LIMIT_SAMPLES:
        return None
    delivered = law.delivered(single)
    worst = int(np.argmax(np.where(short, np.abs(total - delivered), 0.0)))
    sizes = np.abs((_terms(single[[worst]], law.exponent) * law.coefficients).reshape(2, -1).sum(axis=0))
    limited = _at(single[[worst]], law.low, law.high)[0] & (sizes > 0.1 * law.tolerance)
    thrusters = {name: float(n) for name, n, at_limit in zip(law.names, single[worst], limited) if at_limit}
    dof, unit = several[0].dof, several[0].unit
    return AllocationLimit(dof, unit, float(short.mean()), float(total[worst]), float(delivered[worst]), thrusters)


def within_limits(runs: Sequence[Run]) -> tuple[list[Run], tuple[AllocationLimit, ...]]:
    """Return runs driven by what their thrusters gave, and what all of them asked beyond the limits."""
    limited, limits = list(runs), []
    for law, commands in laws_of([commanded(run) for run in runs]):
        limit = limit_of(law, [*commands.values()])
        if limit is None:
            continue
        limits.append(limit)
        for i, part in commands.items():
            short, run = law.short(part.total, part.single), limited[i]
            if of_run := limit_of(law, [part]):
                run = run.noted(of_run.sentence)
            total = np.where(short, law.delivered(part.single), part.total)
            if part.dof is not run.dof:
                run = replace(run, extras={**run.extras, part.dof.command: total})
            elif LOGGED_COMMAND not in run.extras:
                run = replace(run, moment=total)
            limited[i] = run
    return limited, tuple(limits)


def _terms(single: Floats, exponent: float) -> Floats:
    """Regressors (N, 2 T): |n|^p sgn(n) of each thruster where it drives ahead, then where it drives astern."""
    power = np.sign(single) * np.abs(single) ** exponent
    return np.concatenate([np.maximum(power, 0.0), np.minimum(power, 0.0)], axis=1)


def _limits(single: Floats, end: np.ufunc) -> Floats:
    limit = end(end.reduce(single, axis=0), 0.0)
    plateau = (np.abs(single - limit) <= 1e-9 * np.abs(limit)).sum(axis=0) >= MIN_LIMIT_SAMPLES
    return np.asarray(np.where(plateau & (limit != 0), limit, np.inf if end is np.maximum else -np.inf))


def _at(single: Floats, low: Floats, high: Floats) -> Mask:
    """Which thrusters are at a limit, (N, T)."""
    with np.errstate(invalid="ignore"):
        return np.asarray((single <= low * (1 - 1e-9)) | (single >= high * (1 - 1e-9)))
