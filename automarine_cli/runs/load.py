"""Logs of a campaign become runs: the clock rises, the position is unwrapped, what is dropped is counted, what is
unusable is set aside with its reason.

Runs of motion in the plane hold heading and moment as in yaw, and as `extras`, where logged, `north` and `east` [m],
`surge` and `sway` [m/s], `yaw_rate` [rad/s], `force_X` and `force_Y` [N]; NaN without a reading of its own."""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW, Dof
from automarine_cli.errors import ExcludedRun, FitError, LogError, RunError
from automarine_cli.logs import ColumnMap, LogFile, Logs, LogTable, find_logs, read_log
from automarine_cli.logs.columns import RUN, driven, names_of
from automarine_cli.logs.table import GIVE_IT, is_let_go, likely_line, require, require_motion
from automarine_cli.pipeline.parallel import Progress, ordered_map, silent
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs import checks
from automarine_cli.runs.run import NORMAL, Run, fresh_readings, median, named_apart, own_name, slope, summed
from automarine_cli.text import plural

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

GAP_IN_PERIODS = 3.0 + 1e-6  # more than three periods, clocks being rounded
MAX_COMMAND = 1e12  # of any unit; beyond it arithmetic overflows
MAX_REPEATED_STAMPS = 0.2  # of the rows: more repeated stamps than this are no accident
COUNTS = ("rows", "missing", "duplicates", "glitches", "gaps", "jumps")
MIN_PART_S = 5.0  # s; what is left between two jumps has to be worth fitting a start of its own


class NotUsable(RunError):
    pass


def clean(table: LogTable, chosen: Indices, name: str) -> tuple[Run, ...]:
    """Clean the rows `chosen` (N,) of a run: drop and count rows without time, position or command, repeated stamps and
    spikes; split it at wide gaps. Raises RunError where the clock steps back, NotUsable for an unusable run, LogError
    for one without a command in which nothing slows down."""
    dof = table.dof
    summed = dof.position not in table.columns  # of a velocity
    by_thrusters = dof.command not in table.columns and driven(dof, table.columns.keys())
    commands = dof.thrusters if by_thrusters else (dof.command,) if dof.command in table.columns else ()
    measured = dof.velocity if summed else dof.position
    rows, counts = table.rows[chosen], dict.fromkeys(COUNTS, 0)
    counts["rows"] = len(rows)
    columns = {key: values[chosen] for key, values in {**table.extras, **table.columns}.items()}
    missing = np.any([np.isnan(columns[key]) for key in ("time", measured, *commands)], axis=0)
    counts["missing"] = int(np.count_nonzero(missing))
    columns, rows = _only(columns, ~missing), rows[~missing]
    if counts["missing"] and not len(rows):
        what = measured.replace("_", " ")
        _refuse(f"no row has time, {what} and command ({counts['missing']} rows lack one); check the columns")
    fresh = _rising(columns["time"], rows, table, name)
    if len(rows) > 1 and not fresh[1:].any():
        _refuse(checks.clock_trouble(columns["time"]))
    counts["duplicates"] = len(fresh) - int(np.count_nonzero(fresh))
    columns = _only(columns, fresh)
    _refuse(checks.clock_trouble(columns["time"]))
    for key in commands:
        if (largest := float(np.abs(columns[key]).max(initial=0.0))) > MAX_COMMAND:
            what = dof.words.force if key == dof.command else "thruster command"
            _refuse(f"units look wrong: a {what} of {largest:.3g}. Check which column is the {what}")
    if not summed:
        time, position = columns["time"], columns[dof.position]
        _refuse(checks.position_trouble(time, position, dof))
        glitch = find_glitches(time, position, dof) | checks.beyond(position, dof)
        counts["glitches"] = int(np.count_nonzero(glitch))
        columns = _only(columns, ~glitch)
        _refuse(checks.clock_trouble(columns["time"]))
    if not commands:
        columns[dof.command] = np.zeros(len(columns["time"]))
    notes = table.notes
    if counts["duplicates"] > MAX_REPEATED_STAMPS * counts["rows"]:
        stamps = f"{counts['duplicates']} of {counts['rows']} stamps"
        notes += (f"{stamps} repeat the one before: the clock is coarser than the log",)
    run = Run(
        name, table.source, columns.pop("time"), columns.pop(dof.position, np.zeros(0)), columns.pop(dof.command, None),
        table.moment_unit, columns, counts, notes, table.notes, dof=dof,
    )  # fmt: skip
    if not summed:
        _refuse(checks.stuck(run.position, _any_command(run), dof))
    parts = _bridged(_summed_up(run, likely_line(table.names, dof.position)) if summed else run)
    if dof.restoring and not (np.any(_any_command(run)) or np.any(np.nan_to_num(run.extras.get("rudder", 0.0)))):
        free = [(decay, len(decay) < len(part)) for part in parts for decay in checks.decays(part)]
        return tuple(decay.noted(NO_HAND) if cut else decay for decay, cut in free)
    if not commands:
        return parts if dof.restoring else _let_go(parts, table)
    return tuple(piece for part in parts for piece in _pieces(part))


PIECE_S, PIECE_SAMPLES = 60.0, 300  # that a piece of a long run has at least
FEWEST_PIECES, MOST_PIECES = 4, 30  # fewer would tell less of their scatter than the run as it is
STILL_S = 2.0  # over which a run moves least where it is cut


def _pieces(run: Run) -> tuple[Run, ...]:
    """Cut a long run near even parts, where it moves least: all are followed at once, and each can be left out. A run
    stays whole where no command acts in one of its pieces, or something else moved it."""
    duration = run.time[-1] - run.time[0]
    count = int(min(duration // PIECE_S, len(run) // PIECE_SAMPLES, MOST_PIECES))
    if count < FEWEST_PIECES:
        return (run,)
    width = max(round(STILL_S / run.sample_period), 1)
    moved, spacing, edges = np.abs(run.position[width:] - run.position[:-width]), len(run) / count, [0]
    for number in range(1, count):
        first, last = (round((number + side) * spacing) for side in (-0.1, 0.1))
        edges.append(first + width // 2 + int(np.argmin(moved[first : max(last - width, first + 1)])))
    commands = _any_command(run)
    idle = not np.logical_or.reduceat(commands != 0, edges).all()
    if idle or checks.undriven(replace(run, moment=commands)) is not None:
        return (run,)
    return _cut(run.noted(f"cut into {count} pieces of about {duration / count:.0f} s"), [*edges, len(run)])


LET_GO = "no command in the log: the vehicle coasts, from its fastest on"
NO_HAND = "cut to where the vehicle is let go: until then a hand holds it"


def _let_go(parts: tuple[Run, ...], table: LogTable) -> tuple[Run, ...]:
    """The parts of a run without a command in which the vehicle slows down. Raises LogError where there is none."""
    coasting = tuple(part.noted(LET_GO) for run in parts if (part := checks.let_go(run)) is not None)
    if not coasting:
        moves = table.dof.fill("A log without a {force} serves if the vehicle slows down in it; here it does not. ")
        require(table, (table.dof.command,), moves)
    return coasting


def _summed_up(run: Run, line: str) -> Run:
    dof, velocity = run.dof, run.extras[run.dof.velocity]
    fresh = fresh_readings(velocity)  # a held reading is as old as it is long held
    instant = np.interp(run.time, run.time[fresh], velocity[fresh])
    position = summed(run.time, instant - standstill(run.time, instant, _any_command(run), dof))
    note = f"no {dof.words.position} in the log: the {dof.words.rate} is summed up to trim by and to look at"
    note += f". If a column of another name is the {dof.words.position}, write {line} {GIVE_IT}" if line else ""
    return replace(run, position=position, summed_up=True).noted(note)


def _only(columns: Mapping[str, Floats], rows: Mask) -> dict[str, Floats]:
    return {key: values[rows] for key, values in columns.items()}


def _refuse(why: str | None) -> None:
    if why is not None:
        raise NotUsable(why)


def _rising(time: Floats, rows: Indices, table: LogTable, name: str) -> Mask:
    """Which samples have a new stamp. Raises RunError where the clock steps back."""
    steps = np.diff(time)
    if (steps < 0).any():
        i = int(np.argmax(steps < 0))
        before, after = np.searchsorted(table.rows, rows[i : i + 2])
        other = [name for name, labels in table.words.items() if labels.code[before] != labels.code[after]]
        remedy = "If two runs share the file, tell them apart by a column run"
        if other:
            remedy = f'The column {other[0]} changes there: if it names runs, write run = "{other[0]}" {GIVE_IT}'
        raise RunError(
            f"{table.source}, row {rows[i + 1]}, run {name!r}: the clock steps back from {time[i]:.10g} s to "
            f"{time[i + 1]:.10g} s; expected a rising clock. {remedy}; else sort or correct the rows"
        )
    return np.concatenate([[True], steps > 0])[: len(time)]


def _any_command(run: Run) -> Floats:
    """Something that is not zero while any thruster works, shape (N,)."""
    if run.moment is not None:
        return run.moment
    return np.asarray(sum(np.abs(run.extras[name]) for name in run.dof.thrusters))


def _bridged(run: Run) -> tuple[Run, ...]:
    """Unwrap the position; gaps that can be bridged are flagged, at the others and at jumps the run is split."""
    steps, dof, words, notes = np.diff(run.time), run.dof, run.dof.words, run.notes
    gaps = np.flatnonzero(steps > GAP_IN_PERIODS * median(steps))
    position, broken = unwrap(run.time, run.position, gaps, dof)
    widest = f"{steps[gaps].max():.3g} s" if gaps.size else ""
    if (jumps := np.setdiff1d(find_jumps(run.time, run.position, dof), gaps)).size:
        sizes = dof.shown(np.abs(wrapped(np.diff(run.position)[jumps], dof.turn)))
        notes += (
            f"split at {plural(len(jumps), 'jump')} of up to {sizes.max():.0f} {words.units} from one sample to the "
            f"next, which no vehicle makes: samples are missing there, or the {words.sensor} slipped",
        )
    if broken:
        lost = f"across which the {words.position} cannot be followed"
        notes += (f"split at {plural(len(broken), 'gap')} of up to {widest}, {lost}",)
    elif gaps.size:
        bridged = f", bridged by the {words.speed}s beside them" if dof.wraps else ""
        notes += (f"{plural(gaps.size, 'gap')} of up to {widest}{bridged}",)
    edges = [0, *(int(i) + 1 for i in sorted({*broken, *jumps})), len(run)]
    run, parts = replace(run, position=position, notes=notes), []
    for part, (start, stop) in zip(_cut(run, edges), pairwise(edges)):
        inner = int(((gaps >= start) & (gaps < stop - 1)).sum())
        beside = int((start - 1 in jumps) + (stop - 1 in jumps))
        parts.append(replace(part, counts={**part.counts, "gaps": inner, "jumps": beside}))
    return tuple(parts)


def _cut(run: Run, edges: Sequence[int]) -> tuple[Run, ...]:
    """Cut a run at these samples into parts with numbers, where there are several; its counts stay with the first."""
    names = [f"{run.name}.{number}" for number in range(1, len(edges))] if len(edges) > 2 else [run.name]
    counts = [run.counts, *[dict.fromkeys(COUNTS, 0)] * len(names)]
    ranges = zip(pairwise(edges), names, counts)
    return tuple(replace(run.cut(*part), name=name, counts=counted) for part, name, counted in ranges)


MIN_STANDSTILL = 5  # Samples of a standstill
TREND_STDERRS = 4.0  # Standard errors within which the readings of a standstill show no trend


def standstill(time: Floats, velocity: Floats, command: Floats, dof: Dof) -> float:
    """Return what the sensor reads before the first command if the vehicle stands still there; else zero."""
    acting = command != (command[0] if dof.has_constant else 0.0)
    first = int(np.argmax(acting)) if acting.any() else 0
    if first < MIN_STANDSTILL:
        return 0.0
    readings = velocity[:first]
    trend, doubt = slope(time[:first], readings)
    steps = np.diff(readings)
    noise = NORMAL * median(np.abs(steps - median(steps))) / np.sqrt(2.0)
    level, steady = median(readings), abs(trend) <= TREND_STDERRS * doubt * noise + 1e-12
    return level if steady and abs(level) <= 3.0 * dof.limits.bias_sd else 0.0


SPIKE_IN_SIGMA = 8.0
MAX_SPIKE_SAMPLES = 2  # samples
MIN_SPIKE_SAMPLES = 9  # samples; of fewer nothing can be told
MAX_BRIDGE_S = 60.0  # s; over a longer gap anything may have happened
GAP_RATE_RATIO = 1.5  # than nearly all of the run: nothing turns so across a gap


def wrapped(angle: Floats, turn: float) -> Floats:
    """The same angle within half a `turn` to either side; as it is where `turn` is infinite."""
    return angle - turn * np.ceil(angle / turn - 0.5) if turn < np.inf else angle


def _scatter(steps: Floats) -> float:
    """Robust standard deviation of steps (N - 1,), by their second differences; 0 for fewer than two steps."""
    return NORMAL * median(np.abs(np.diff(steps))) / np.sqrt(3.0) if len(steps) > 1 else 0.0


@np.errstate(over="ignore")  # a reading may be as large as numbers go; what is beyond reason goes by another rule
def find_glitches(time: Floats, position: Floats, dof: Dof) -> Mask:
    """Find spikes of one or two samples in a position (N,) [rad or m]: far off both neighbours, which agree.

    A spike stands out against the local rate by eight robust standard deviations and the motion's least spike, and by
    half as much again as the vehicle moves around it. A jump that stays is no spike, nor is a sharp reversal."""
    bad = np.zeros(len(time), dtype=bool)
    if len(time) < MIN_SPIKE_SAMPLES:
        return bad
    steps, spans = wrapped(np.diff(position), dof.turn), np.diff(time)
    threshold = max(dof.limits.spike, SPIKE_IN_SIGMA * _scatter(steps))
    if MAX_SPIKE_SAMPLES * float(np.abs(steps).max()) * (1.0 + spans.max() / spans.min()) <= threshold:
        return bad  # no samples that near to each other can be that far off
    for width in range(1, MAX_SPIKE_SAMPLES + 1):
        before = np.arange(len(time) - 1 - width)
        after = before + width + 1
        rate = _median_beside(steps / spans, before, after)
        off = [np.abs(_off(time, position, rate, before, before + k, dof)) for k in range(1, width + 2)]
        size, across = np.max(off[:-1], axis=0), off[-1]
        spike = (size > threshold) & (across < threshold) & (size > 3 * across)
        spike &= size > 1.5 * _median_beside(np.abs(steps), before, after)
        spike &= ~np.any([bad[before + k] for k in range(width + 2)], axis=0)
        for k in range(1, width + 1):
            bad[before[spike] + k] = True
    return bad | _end_spikes(time, position, max(threshold, dof.limits.end_spike), dof)


def _median_beside(steps: Floats, before: Indices, after: Indices) -> Floats:
    """Median of the three steps that lead to sample `before` and the three that leave sample `after`, (M,)."""
    places = np.array([before - 3, before - 2, before - 1, after, after + 1, after + 2])
    values = np.sort(steps[np.clip(places, 0, len(steps) - 1)], axis=0)
    return np.asarray((values[2] + values[3]) / 2)


def _off(time: Floats, position: Floats, rate: Floats, start: Indices, stop: Indices, dof: Dof) -> Floats:
    return wrapped(position[stop] - position[start] - rate * (time[stop] - time[start]), dof.turn)


def _end_spikes(time: Floats, position: Floats, threshold: float, dof: Dof) -> Mask:
    """Spikes at the very first and last samples: far off what the next samples, which agree, lead to."""
    bad = np.zeros(len(time), dtype=bool)
    for order in (np.arange(len(time)), np.arange(len(time))[::-1]):
        for width in range(1, MAX_SPIKE_SAMPLES + 1):
            inner = order[width : width + 6]
            steps = wrapped(np.diff(position[inner]), dof.turn)
            rate = np.array(median(steps / np.diff(time[inner])))
            jump = abs(float(wrapped(position[inner[0]] - position[order[width - 1]], dof.turn)))
            agree = np.abs(_off(time, position, rate, inner[:-1], inner[1:], dof)) < threshold / 4
            far = np.abs(_off(time, position, rate, np.repeat(inner[0], width), order[:width], dof)) > threshold
            # a vehicle at rest that starts to turn is far off as well, but it begins with a small step
            if agree.all() and far.all() and jump > max(threshold, 2 * median(np.abs(steps))):
                bad[order[:width]] = True
                break
    return bad


JUMP_NEIGHBOURS = 6  # Steps on either side with which a jump is compared
MIN_JUMP_RATIO = 3.0  # How much faster than any of them it is
JUMP_IN_SIGMA = 5.0  # Of steps that are noise


def find_jumps(time: Floats, position: Floats, dof: Dof) -> Indices:
    """Find the samples, of a position (N,) [rad or m] without spikes, after which a jump follows that stays.

    A jump is a step beyond noise, several times faster than every step on both sides, for which a vehicle would need
    more than the motion's largest acceleration (two parabolas: four times the step by the square of the span). A sensor
    that had stopped catches up over the span since its last change."""
    most = dof.limits.acceleration
    steps, spans = wrapped(np.diff(position), dof.turn), np.diff(time)
    sizes, moved = np.abs(steps), np.flatnonzero(steps)
    speeds, least = sizes / spans, max(dof.limits.jump, JUMP_IN_SIGMA * _scatter(steps))
    jumps = []
    for i in np.flatnonzero((sizes > least) & (4.0 * sizes > most * spans**2)).tolist():
        before_it = moved[moved < i]
        last = int(before_it[-1]) + 1 if len(before_it) else 0
        span = time[i + 1] - time[last]
        before, after = speeds[max(last - JUMP_NEIGHBOURS, 0) : last], speeds[i + 1 : i + 1 + JUMP_NEIGHBOURS]
        if min(len(before), len(after)) < JUMP_NEIGHBOURS // 2:
            continue
        fastest = max(before.max(), after.max())
        if sizes[i] > MIN_JUMP_RATIO * fastest * span and 4.0 * sizes[i] > most * span**2:
            jumps.append(i)
    return np.array(jumps, dtype=int)


def unwrap(time: Floats, position: Floats, gaps: Indices, dof: Dof) -> tuple[Floats, tuple[int, ...]]:
    """Unwrap a heading (N,) [rad] with holes after the samples `gaps`. Return it, and the gaps at which the turn count
    is unknown: where the rates on both sides leave it open by more than a quarter of a turn, and the vehicle was seen
    fast enough to turn as far. A log that counts turns itself, and what never wraps, stays as it is."""
    turn, raw = dof.turn, np.diff(position)
    inside = np.ones(len(raw), dtype=bool)
    inside[gaps] = False
    if not dof.wraps or (np.ptp(position) > 1.01 * turn and np.all(np.abs(raw[inside]) < turn / 2)):
        return position, ()
    steps = wrapped(raw, turn)
    fastest = np.inf
    if gaps.size and inside.any():
        fastest = GAP_RATE_RATIO * float(np.percentile(np.abs(steps[inside]) / np.diff(time)[inside], 99))
    broken = []
    for gap in gaps:
        span = time[gap + 1] - time[gap]
        before, after = _side_rate(time, steps, gap - 1, -1, gaps), _side_rate(time, steps, gap + 1, 1, gaps)
        predicted = span * (before[0] + after[0]) / 2
        doubt = span * min(fastest, abs(after[0] - before[0]) / 2 + before[1] + after[1])
        if doubt > turn / 4 or span > MAX_BRIDGE_S:
            broken.append(int(gap))
        steps[gap] = predicted + wrapped(np.asarray(raw[gap] - predicted), turn)
    turns = np.cumsum(np.round((steps - raw) / turn))
    return np.concatenate([position[:1], position[1:] + turn * turns]), tuple(broken)


def _side_rate(time: Floats, steps: Floats, start: int, way: int, gaps: Indices) -> tuple[float, float]:
    """Yaw rate [rad/s] and its doubt just beside a gap, from up to eight steps on one side of it."""
    within = np.arange(start, start + 8 * way, way)
    inside = (within >= 0) & (within < len(steps)) & ~np.isin(within, gaps)
    chosen = within[np.logical_and.accumulate(inside)]
    if len(chosen) < 2:
        return 0.0, np.inf
    spans = time[chosen + 1] - time[chosen]
    rate = float(steps[chosen].sum() / spans.sum())
    scatter = float(np.std(steps[chosen] - rate * spans))
    return rate, 2 * scatter / float(spans.sum())


OfOneLog = tuple[list[Run], list[ExcludedRun]]
ANGLE_SLACK = 1.001

MAX_REASONS = 3  # reasons shown when nothing is left
PARALLEL_FROM_LOGS = 3000  # logs; to start processes takes longer than to read fewer


@dataclass(frozen=True)
class LoadedRuns:
    """The runs of a campaign, in file order; what was set aside; the files read; commands beyond limits."""

    runs: tuple[Run, ...]
    set_aside: tuple[ExcludedRun, ...]
    inputs: tuple[LogFile, ...]
    limits: tuple[checks.AllocationLimit, ...] = ()


def load_runs(
    logs: Logs, columns: ColumnMap | None = None, *, dof: Dof, planar: bool = False, strict: bool = False,
    progress: Progress = silent, jobs: int = 1,
) -> LoadedRuns:  # fmt: skip
    """Read and clean the logs of a motion (`planar`: in the plane) meant by files, directories and globs, on `jobs`
    processes. Raises LogError or RunError for a log named on the command line that cannot be read right, for anything
    that would be set aside if `strict`, and if no run is left."""
    files = find_logs(logs)
    work = partial(read_runs, columns=columns, dof=dof, planar=planar)
    runs: list[Run] = []
    aside: list[ExcludedRun] = []
    jobs = jobs if len(files) > PARALLEL_FROM_LOGS else 1
    for good, bad in ordered_map(work, files, jobs, progress=progress, stage="reading logs"):
        runs += good
        aside += bad
    require_usable(runs, aside, len(files), strict)
    _refuse_other_units(aside, runs, {file.name: (columns or ColumnMap()).of(file.path).columns for file in files})
    runs = named_apart(_decays_in_one_unit(runs))
    _refuse_two_units(runs)
    runs = to_starboard(runs)
    limited, limits = checks.within_limits(runs)
    return LoadedRuns(tuple(limited), tuple(aside), tuple(filter(has_bytes, files)), limits)


def _refuse_other_units(aside: Sequence[ExcludedRun], runs: Sequence[Run], maps: Mapping[str, object]) -> None:
    """Raise RunError where a log proves that a column of angles is in another unit than it was read in, and most runs
    of other logs with the same rules (`maps` by file) look so too: they are as wrong, and only smoother."""
    proof = next((run for run in aside if run.why.startswith(checks.IN_OTHER_UNITS)), None)
    if proof is None:
        return
    others = [run for run in runs if maps[run.source] == maps[proof.file]]
    radians = "wraps at 2 pi where" in proof.why  # that are called degrees; the other proofs are of the contrary
    turn = checks.RADIANS_AS_DEGREES if radians else 2 * np.pi
    turns = {run.source: float(np.ptp(run.position)) / turn for run in others}
    alike = sum(0.5 < turn <= ANGLE_SLACK if radians else turn > ANGLE_SLACK for turn in turns.values())
    if alike > 0.5 * len(turns):
        raise RunError(
            f"{proof.file}, run {proof.run!r}: {proof.why}. The same column of {plural(alike, 'other log')} looks so "
            "too, and nothing was used; where only one log differs, give it a map of its own under [[columns_of]]"
        )


PIECES_OF_A_RUN = (16, 32, 64, 128)  # of which one is long beside the noise and short beside the turns
TO_PORT = "positive rudder turns to port: the command is the rudder angle with its sign changed"


def to_starboard(runs: Sequence[Run]) -> list[Run]:
    """Return the runs, those of a rudder that turns to port where it is positive with a command of the other sign.

    Over pieces of the runs the change of the rate is put down to the rudder and the rate, by least squares; the length
    of piece that tells the rudder's share most clearly says its sign.
    """
    steered = [run for run in runs if run.moment is not None and run.moment_unit == STEERED]
    shares = []
    for count in PIECES_OF_A_RUN if steered else ():
        rows = []
        for run in steered:
            knots = np.linspace(run.time[0], run.time[-1], count + 1)
            angle, way = (np.interp(knots, run.time, x) for x in (summed(run.time, run.command), run.position))
            rate, rudder = np.diff(way) / np.diff(knots), np.diff(angle)
            rows.append(np.stack([np.diff(rate), 0.5 * (rudder[1:] + rudder[:-1]), np.diff(knots[1:]) * rate[:-1]]))
        change, *terms = np.concatenate(rows, axis=1)
        x = np.stack(terms, axis=1)
        inverse = np.linalg.pinv(x.T @ x)
        size = inverse @ x.T @ change
        error = np.sqrt(max(float(np.sum((change - x @ size) ** 2)), 1e-30) * max(inverse[0, 0], 1e-30))
        shares.append(float(size[0] / error))
    if not shares or max(shares, key=abs) >= 0:
        return list(runs)
    return [
        run.with_moment(-run.command, STEERED).noted(TO_PORT) if run.moment_unit == STEERED else run for run in runs
    ]


def has_bytes(file: LogFile) -> bool:
    """Whether a log has bytes to hash: a link that leads nowhere has none."""
    return file.content is not None or (file.path.is_file() and os.access(file.path, os.R_OK))


def require_usable(usable: Sized, aside: Sequence[ExcludedRun], logs: int, strict: bool) -> None:
    """Raise RunError for the first set aside if `strict`, and with the first reasons if nothing is usable."""
    if strict and aside:
        first = aside[0]
        raise RunError(f"{first.file}, run {first.run!r}: {first.why} (refused because of --strict)")
    if not usable:
        files = {run.why: run.file for run in reversed(aside)}
        reasons = [f"{file}: {why}" for why, file in reversed(files.items())][:MAX_REASONS]
        more = f" (and {len(aside) - len(reasons)} more)" if len(aside) > len(reasons) else ""
        raise RunError(f"no usable run in {plural(logs, 'log')}: {'; '.join(reasons)}{more}")


@contextlib.contextmanager
def append_exclusions(aside: Sequence[ExcludedRun]) -> Iterator[None]:
    """Whoever is refused for want of runs is also told how many were set aside before, and why the first was."""
    try:
        yield
    except (FitError, RunError) as refusal:
        if not aside:
            raise
        why = f"{aside[0].file}, run {aside[0].run!r}: {aside[0].why}"
        before = f"1 run was set aside before: {why}"
        if len(aside) > 1:
            before = f"{len(aside)} runs were set aside before, the first: {why}"
        raise type(refusal)(f"{refusal} ({before})") from None


def read_runs(file: LogFile, columns: ColumnMap | None = None, *, dof: Dof, planar: bool = False) -> OfOneLog:
    """Read the runs of a log of a motion, and those set aside. Raises LogError or RunError if the log was named and is
    unreadable, or, of motion in the plane, drives nothing but the heading."""
    try:
        table = read_log(file, columns, dof=dof, motion=PLANAR if planar else None)
        runs, aside = runs_of_table(file, _with_forces(table) if planar else table)
    except LogError as error:
        return [], [unreadable(file, error)]
    return [_on_the_water(run) for run in runs] if planar else runs, aside


def unreadable(file: LogFile, error: Exception, run: str | None = None) -> ExcludedRun:
    """A log, or a run of it, that was found and cannot be read right. Raises the error where the log was named."""
    if file.named:
        raise error
    why = str(error).removeprefix(file.name).lstrip(":, ")  # the result has the file's name in a field of its own
    return ExcludedRun(file.name, own_name(file.name) if run is None else run, why)


def runs_of_table(file: LogFile, table: LogTable) -> OfOneLog:
    """Return the runs of a table, and those set aside. Raises LogError or RunError for a named log that is unusable."""
    require_motion(table, commanded=len(table) < checks.MIN_RUN_SAMPLES or not is_let_go(table))
    runs: list[Run] = []
    aside: list[ExcludedRun] = []
    for name, rows in rows_of_runs(table):
        try:
            parts = clean(table, rows, name)
        except RunError as error:
            usable = not isinstance(error, NotUsable)
            aside.append(unreadable(file, error, name) if usable else ExcludedRun(file.name, name, str(error)))
            continue
        for part in parts:
            why = checks.clock_trouble(part.time) if len(parts) > 1 else None
            length = float(np.ptp(part.time))
            if why is None and part.counts["jumps"] and length < MIN_PART_S:
                left = f"only {length:.2g} s are left beside a jump of the {part.dof.position}"
                why = f"{left}; at least {MIN_PART_S:g} s are needed"
            if why is None:
                runs.append(part)
            else:
                aside.append(ExcludedRun(file.name, part.name, f"{why} ({part.notes[-1]})"))
    return runs, aside


def rows_of_runs(table: LogTable) -> Iterator[tuple[str, Indices]]:
    """The names of the runs of a table, in the order in which they begin, and the rows of each."""
    if (runs := table.labels.get(RUN)) is None:
        return iter([(own_name(table.source), np.arange(len(table)))])
    order = np.argsort(runs.code, kind="stable")  # runs may take turns
    return zip(runs.names, np.split(order, np.searchsorted(runs.code[order], np.arange(1, len(runs.names)))))


def _decays_in_one_unit(runs: Sequence[Run]) -> list[Run]:
    """Return the runs, those in which no moment acts in the unit of those in which one does, else in the one that a
    column has, else in the second one."""
    acting = sorted((run for run in runs if run.moment_unit), key=lambda run: not np.any(run.moment))
    unit = acting[0].moment_unit if acting else runs[0].dof.units.forces[1]
    idle = (run.moment is not None and not np.any(run.moment) for run in runs)
    return [replace(run, moment_unit=unit) if rests else run for run, rests in zip(runs, idle)]


def _refuse_two_units(runs: Sequence[Run]) -> None:
    """Raise RunError where normalised commands and others are mixed."""
    units = {run.moment_unit: run for run in runs if run.moment is not None}
    if len(units) > 1:
        first, second = list(units.values())[:2]
        raise RunError(
            f"{first.source} gives its {first.dof.words.force} in {first.moment_unit}, {second.source} in "
            f"{second.moment_unit}; expected one unit in a campaign. Analyse them apart, or map both "
            f"columns to {' or to '.join(names_of(first.dof.command))} with --columns"
        )


EQUATORIAL_RADIUS, FLATTENING = 6_378_137.0, 1 / 298.257223563  # m; World Geodetic System 1984
SENSORS = (("north", "east"), ("surge",), ("sway",), ("yaw_rate",))  # Quantities that come out of one sensor each


def local_plane(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """Convert latitudes and longitudes [rad] (N,), some NaN, to metres north and east of the first fix; 0, 0 is none.

    Radii of curvature at the first fix (WGS 84; Fossen 2021, chapter 2): within 0.2 m a kilometre away."""
    none = ~(np.isfinite(latitude) & np.isfinite(longitude)) | ((latitude == 0) & (longitude == 0))
    if none.all():
        return np.full(len(none), np.nan), np.full(len(none), np.nan)
    first = int(np.argmin(none))
    eccentricity2 = FLATTENING * (2.0 - FLATTENING)
    below = 1.0 - eccentricity2 * np.sin(latitude[first]) ** 2
    prime_vertical = EQUATORIAL_RADIUS / np.sqrt(below)
    meridian = prime_vertical * (1.0 - eccentricity2) / below
    east = (longitude - longitude[first] + np.pi) % (2.0 * np.pi) - np.pi  # across the date line too
    north = meridian * (latitude - latitude[first])
    east = prime_vertical * np.cos(latitude[first]) * east
    return np.where(none, np.nan, north), np.where(none, np.nan, east)


def _with_forces(table: LogTable) -> LogTable:
    """The table without headings where a force is missing, so that `clean` drops these rows. Raises LogError for one
    that drives only the heading, or in normalised units."""
    for dof in PLANAR.dofs:
        newtons = dof.units.forces[1]
        if (unit := table.units.get(dof.command, newtons)) != newtons:
            name = dof.column(dof.command, unit)
            raise LogError(
                f"{table.source}: {dof.command.replace('_', ' ')} is normalised ({name}); motions that are coupled "
                f"need newtons and newton metres. Map it with a scale, such as {dof.column(dof.command, newtons)} = "
                f'{{ from = "{name}", scale = 40 }}, in a --columns file'
            )
    forces = [table.columns[dof.command] for dof in (SURGE, SWAY) if dof.command in table.columns]
    if not forces and not driven(YAW, table.columns.keys()):
        names = " or ".join(dof.column(dof.command, "N") for dof in (SURGE, SWAY))
        raise LogError(
            f"{table.source}: no force in the log ({names}), by which surge and sway are driven; name its column "
            "with --columns, or give the log to automarine fit-yaw"
        )
    heading = table.columns.get(YAW.position)
    if heading is None:
        return table
    lacking = np.any([np.zeros(len(table), dtype=bool), *map(np.isnan, forces)], axis=0)
    return replace(table, columns={**table.columns, YAW.position: np.where(lacking, np.nan, heading)})


def _on_the_water(run: Run) -> Run:
    """A run of motion in the plane with places in metres, and without what a slow sensor repeats."""
    extras = dict(run.extras)
    if {"lat", "lon"} <= extras.keys() and not {"north", "east"} <= extras.keys():
        extras["north"], extras["east"] = local_plane(extras.pop("lat"), extras.pop("lon"))
    notes = []
    for names in SENSORS:
        if not extras.keys() >= {*names}:
            continue
        if (again := repeats(*(extras[name] for name in names))).any():
            share = f"{' and '.join(names).replace('_', ' ')}: {100 * float(again.mean()):.0f} % of the rows"
            notes.append(f"{share} repeat the reading before them, as of a slow sensor, and do not count")
            extras |= {name: np.where(again, np.nan, extras[name]) for name in names}
    return replace(run, extras=extras).noted(*notes)


MIN_CHANGES = 8  # Changes of a value that tell anything of its sensor
FINE_STEP_RATIO = 5.0  # Of the median step to the smallest: two readings in a row are then hardly ever equal
COARSE_STEP_RATIO = 2.0  # The same below which a value that stands may as well be one that creeps
CHANCE_REPEATS = 0.1  # Share of repeats below which they are chance, and cost nothing
MAX_ADJACENT_CHANGES = 0.1  # share of changes next to each other, up to which a coarse sensor counts as held


def repeats(*columns: Floats) -> Mask:
    """Tell which rows (N,) repeat the reading before; `columns` (N,) come out of one sensor, NaN where it is silent.

    None where it is read in every row: a coarse one may give a number twice. The first row of a held one is a repeat
    too, for nobody knows how old its reading is."""
    values = np.stack(columns)
    sound = np.all(np.isfinite(values), axis=0)
    repeated = np.zeros(values.shape[1], dtype=bool)
    steps = np.abs(np.diff(values[:, sound], axis=1))
    changed, sizes = np.any(steps > 0, axis=0), steps[steps > 0]
    if np.count_nonzero(changed) < MIN_CHANGES or changed.mean() > 1 - CHANCE_REPEATS:
        return repeated
    coarseness, spans = float(np.median(sizes) / sizes.min()), np.diff(np.flatnonzero(changed))
    often = np.median(spans) >= 2 and np.mean(spans == 1) <= MAX_ADJACENT_CHANGES
    if coarseness >= FINE_STEP_RATIO or (coarseness >= COARSE_STEP_RATIO and often):
        repeated[sound] = np.concatenate([[True], ~changed])
    return repeated
