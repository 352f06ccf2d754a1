"""Bollard tests read from logs, the points that they come down to, readings that contradict others, the tare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, Logs, LogTable, find_logs, read_log, require_thruster
from automarine_cli.logs.columns import BY
from automarine_cli.logs.table import Labels, splitting
from automarine_cli.pipeline.parallel import Progress, counted, silent
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import has_bytes, require_usable, unreadable
from automarine_cli.runs.run import ExcludedRun
from automarine_cli.text import listed, quoted


@dataclass(frozen=True)
class Series:
    """One test record as logged: one file, or one `run` of a file; arrays of shape (N,).

    `n` is the control signal [unit as logged], `force` the thrust of all pulling thrusters together [N], `time` [s] and
    `voltage` [V] are None where the log has none; `extras` are its other columns by their own names. `part` is which
    thruster it is of, where a column says (`ThrusterLogs.by`)."""

    source: str
    run: str
    n: Floats
    force: Floats
    time: Floats | None = None
    voltage: Floats | None = None
    extras: Mapping[str, Floats] = field(default_factory=dict)
    part: str = ""

    @property
    def place(self) -> str:
        run = f", run {self.run}" if self.run else ""
        return f"{self.source}{run}, {self.part}" if self.part else f"{self.source}{run}"


@dataclass(frozen=True)
class ThrusterLogs:
    """Test records in file and row order; `missing` counts rows without a value, `n_unit` is the control signal's where
    all logs tell the same, `by` the column that says which thruster a record is of ("" without), `split` whether the
    user named it, `rule` and `command` how all logs read their force and control signal, where a column map says it."""

    records: tuple[Series, ...]
    set_aside: tuple[ExcludedRun, ...]
    inputs: tuple[LogFile, ...]
    missing: int
    n_unit: str = ""
    by: str = ""
    split: bool = False
    rule: ColumnRule = field(default_factory=lambda: ColumnRule("force_N"))
    command: ColumnRule = field(default_factory=lambda: ColumnRule("n"))

    @property
    def used(self) -> int:
        return len({(record.source, record.run, record.part if self.split else "") for record in self.records})

    @property
    def parts(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(record.part for record in self.records if record.part))

    def of(self, part: str) -> "ThrusterLogs":
        return replace(self, records=tuple(r for r in self.records if r.part == part), by="", split=False, set_aside=())


def thrusters_pulling(count: int | None, columns: ColumnMap, usual: int = 1) -> int:
    """Return how many equal thrusters pulled together: `count`, else the column map's default, else the usual one."""
    value = columns.defaults.get("thrusters_per_test", usual) if count is None else count
    if isinstance(value, str) or value != int(value) or value < 1:
        raise SettingError(f"thrusters_per_test is {value!r}; expected a whole number of thrusters, 1 or more")
    return int(value)


def load_thruster_logs(
    logs: Logs, columns: ColumnMap, *, strict: bool = False, progress: Progress = silent
) -> ThrusterLogs:
    """Read every log; one `run` of a file is one record.

    Raises LogError for a log named on the command line that cannot serve, RunError with `strict` or if none is left."""
    files = find_logs(logs)
    records: list[Series] = []
    set_aside: list[ExcludedRun] = []
    missing, units, found_by = 0, set[str](), ""
    for file in counted(progress, "reading", files, len(files)):
        try:
            table = read_log(file, columns, dof=YAW)  # of no motion: columns of others keep their names
            require_thruster(table)
            if BY in columns.columns and BY not in table.labels:
                raise LogError(
                    f"{table.source}: no column {quoted(columns.source_of(BY))}, which the column map names with by; "
                    f"found the columns {listed(table.names)}. Correct the name, or leave the line out"
                )
        except LogError as refusal:
            set_aside.append(unreadable(file, refusal))
            continue
        parts = table.labels.get(BY)
        if parts is None and (name := _name_of_parts(table)):
            parts, found_by = table.words[name], name
        series, incomplete, idle = _records(table, parts)
        records += series
        units.add(table.units.get("n", ""))
        missing += incomplete
        set_aside += idle
    require_usable(records, set_aside, len(files), strict)
    by = columns.source_of(BY) if BY in columns.columns or (any(r.part for r in records) and not found_by) else ""
    unit = units.pop() if len(units) == 1 else ""
    used = tuple(filter(has_bytes, files))
    rules = []
    for key in ("force_N", "n"):
        alike = {columns.of(file.path).columns.get(key) for file in files}
        rules.append((len(alike) == 1 and alike.pop()) or ColumnRule(key))
    return ThrusterLogs(tuple(records), tuple(set_aside), used, missing, unit, by or found_by, bool(by), *rules)


def _name_of_parts(table: LogTable) -> str:
    """The column of words that may say which thruster a row is of, "" for none: one that is called like that, else the
    only one. In a series over time the words come one after the other."""
    blocks = {name: 1 + int(np.count_nonzero(np.diff(labels.code))) for name, labels in table.words.items()}
    at_once = "time" not in table.columns
    may = [name for name, labels in table.words.items() if at_once or blocks[name] <= len(labels.names)]
    return splitting(may, bollard=True).get(BY, may[0] if len(may) == 1 else "")


def _records(table: LogTable, parts: Labels | None) -> tuple[list[Series], int, list[ExcludedRun]]:
    n, force = table.columns["n"], table.columns["force"]
    time, voltage = table.columns.get("time"), table.columns.get("voltage")
    good = np.isfinite(n) & np.isfinite(force) & np.isfinite(n if time is None else time)
    names = np.full(len(table), "") if table.run is None else table.run
    records, idle = [], []
    part_names = np.full(len(table), "") if parts is None else np.array(parts.names)[parts.code]
    pairs = zip(map(str, names), map(str, part_names))
    for name, part in dict.fromkeys(pairs):  # in the order in which they first appear
        rows = (names == name) & (part_names == part) & good
        if not np.any(rows):
            idle.append(ExcludedRun(table.source, name or part, "no row has both a control signal and a force"))
            continue
        clock, volts = (None if column is None else column[rows] for column in (time, voltage))
        if clock is not None and (moving := share_moving(clock, n[rows])) > 0.5:
            idle.append(ExcludedRun(table.source, name or part, DYNAMIC.format(100 * moving)))
            continue
        extras = {key: column[rows] for key, column in table.extras.items()}
        records.append(Series(table.source, name, n[rows], force[rows], clock, volts, extras, part))
    return records, int(np.count_nonzero(~good)), idle


Ints = NDArray[np.int64]

LAG = 0.5  # s, in which the thrust has followed a command
MOVES = 0.15  # standard deviation of the command within that time, share of its range: it does not rest
DYNAMIC = (
    "a dynamic test: in {:.0f} % of the time the command moves on before the thrust can follow; a map needs static "
    "levels, so hold each of eight or more commands, from full astern to full ahead, for some seconds"
)


def share_moving(time: Floats, n: Floats) -> float:
    """Share of the time [s] in which a command, both (N,), does not rest; 0 where samples are too rare to tell."""
    window = ((time - time.min()) // LAG).astype(np.int64)
    _, place, count = np.unique(window, return_inverse=True, return_counts=True)
    deviation = n - (np.bincount(place, n) / count)[place]
    spread = np.sqrt(np.bincount(place, deviation**2) / count)
    return float(np.mean((spread > MOVES * np.ptp(n)) & (count > HANDFUL)))


SAME = 0.004  # commands within this share of full scale are one level
MANY_LEVELS = 24  # more levels than this in a direction are left out and counted several at once
FOLD_COUNT = 20
VOLTAGE_STEP = 0.03  # voltages further apart than this share are two nominal steps
MAX_STEPS = 12  # more voltage steps than this are a drifting supply, not steps


@dataclass(frozen=True)
class Points:
    """Measured points of one thruster, arrays of shape (P,).

    `n` [unit as logged]; `force` [N] of one thruster; `spread` [N] of the `count` samples behind a point, `stderr` [N]
    of their mean (both NaN for a single reading); `when`: time [s] or sample number; `record` numbers the test records;
    `voltage` [V], NaN where not logged, `step` its nominal step (see `voltage_steps`); `raw`: the mean of a plateau;
    `flag`: why a point weighs less than 1, or ""."""

    n: Floats
    force: Floats
    spread: Floats
    count: Ints
    stderr: Floats
    when: Floats
    record: Ints
    voltage: Floats
    step: Ints
    raw: NDArray[np.bool_]
    weight: Floats
    flag: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.n)

    @classmethod
    def measured(cls, n: Floats, force: Floats, when: Floats, voltage: Floats | None, record: int) -> "Points":
        """Single readings of one record, none of them flagged."""
        size, nothing = len(n), np.full(len(n), np.nan)
        return cls(
            n=n, force=force, spread=nothing, count=np.ones(size, dtype=np.int64), stderr=nothing, when=when,
            record=np.full(size, record, dtype=np.int64), voltage=nothing if voltage is None else voltage,
            step=np.full(size, -1), raw=np.zeros(size, dtype=bool), weight=np.ones(size),
            flag=np.full(size, "", dtype="<U120"),
        )  # fmt: skip

    def where(self, mask: NDArray[np.bool_] | Ints) -> Self:
        return replace(self, **{name: x[mask] for name, x in vars(self).items() if isinstance(x, np.ndarray)})

    @property
    def steps(self) -> list[int]:
        """Numbers of the voltage steps, none where the supply has none."""
        return np.unique(self.step[self.step >= 0]).tolist()

    @property
    def n_range(self) -> tuple[float, float] | None:
        """The lowest and the highest control signal, None where there is one only."""
        low, high = float(np.min(self.n, initial=np.inf)), float(np.max(self.n, initial=-np.inf))
        return (low, high) if low < high else None

    @property
    def full_scale(self) -> float:
        """Largest thrust measured [N], flagged points left out."""
        return float(np.max(np.abs(self.force[self.flag == ""]), initial=0.0))


def levels_of(n: Floats) -> Ints:
    """Number of each control signal's level, shape (P,): equal to 0.4 % of full scale is one level."""
    width, first, number = SAME * float(np.max(np.abs(n), initial=0.0)), -np.inf, -1
    level = np.zeros(len(n), dtype=np.int64)
    for index in np.argsort(n, kind="stable"):
        # Zero is a level of its own: a small command is not a tare reading.
        if n[index] - first > width or (n[index] == 0.0) != (first == 0.0):
            number, first = number + 1, float(n[index])
        level[index] = number
    return level


def folds_of(n: Floats) -> Ints:
    """Number what cross-validation leaves out together: a level, shape (P,).

    Closely spaced tables (over 24 levels in a direction) go in 20 folds, each of every twentieth level, so that a form
    is judged between the levels that a map is used between."""
    level = levels_of(n)
    return level if int(level.max(initial=-1)) < MANY_LEVELS else level % FOLD_COUNT


def groups_of(n: Floats) -> Ints:
    """What standard errors count as one: a level, shape (P,).

    Closely spaced tables (over 24 levels in a direction) go in 20 blocks of neighbouring levels: a misfit is alike in
    neighbours, so that one level of 100 is no independent witness."""
    level = levels_of(n)
    count = int(level.max(initial=-1)) + 1
    if count <= MANY_LEVELS:
        return level
    block = np.repeat(np.arange(FOLD_COUNT), [len(part) for part in np.array_split(np.arange(count), FOLD_COUNT)])
    return block[level].astype(np.int64)


def voltage_steps(voltage: Floats) -> Ints:
    """Number of the nominal supply step of each point, shape (P,), rising with the voltage.

    A new step starts where the sorted voltages jump by over 3 %; -1 without a voltage at every point, or where the
    supply drifts without steps."""
    step = np.full(len(voltage), -1)
    if np.all(np.isfinite(voltage) & (voltage > 0)):
        order = np.argsort(voltage, kind="stable")
        size = np.log(voltage[order])
        step[order] = np.cumsum(np.diff(size, prepend=size[:1]) > VOLTAGE_STEP)
    return np.where(step.max(initial=0) < MAX_STEPS, step, -1)


# Limits in shares of full scale, and in robust standard deviations of the readings there; the larger counts.
RISE, RISE_MADS = 0.03, 5.0  # thrust rises with the command: how far it may fall back
SMOOTH, SMOOTH_MADS = 0.05, 8.0  # off the smooth curve through the neighbours
REPEAT_MADS = 6.0  # off the other readings at the same command
END = 0.20  # the highest command has one neighbour only, and thrust may really sag there
SCATTER = 0.15  # share of the thrust itself: two runs may differ by some percent of gain

Outliers = dict[int, tuple[float, float]]  # index -> deviation [N], limit [N]


def flag_contradictions(points: Points, group: Ints | None = None) -> Points:
    """The same points with weights and reasons, each `group` (P,), by default each voltage step, by itself: none is
    dropped.

    Readings beyond their limit have Cauchy's weight 1 / (1 + (deviation / scale)²), scale a third of the limit."""
    weight, flag, group = points.weight.copy(), points.flag.copy(), points.step if group is None else group
    for number in np.unique(group):
        places = np.flatnonzero(group == number)
        for index, (deviation, limit) in _contradictions(points.n[places], points.force[places]).items():
            weight[places[index]] = 1.0 / (1.0 + (3.0 * deviation / limit) ** 2)
            flag[places[index]] = f"outlier: {deviation:.3g} N from neighbouring points"
    return replace(points, weight=weight, flag=flag)


def _contradictions(n: Floats, force: Floats) -> Outliers:
    """What lies beyond readings that scatter evenly, or in proportion to the thrust where the others say so."""
    zero, ahead, astern = n == 0.0, n > 0.0, n < 0.0
    if all(map(np.any, (zero, ahead, astern))):  # the zero reading, if the readings next to it bear it out
        reading = float(np.median(force[zero]))
        if force[astern][np.argmax(n[astern])] <= reading <= force[ahead][np.argmin(n[ahead])]:
            force = force - reading
    scale = float(np.sort(np.abs(force))[-2:].min(initial=np.inf))  # the second largest, as one reading may be wild
    if not np.isfinite(scale) or scale == 0.0:
        return {}
    level, even = levels_of(n), np.ones(len(n))
    if not (outliers := _beyond(n, force, level, scale, even)):
        return outliers
    good = ~np.isin(np.arange(len(n)), list(outliers))
    return _beyond(n, force, level, scale, _unit_of_scatter(n, force, level, good, scale))


def _unit_of_scatter(n: Floats, force: Floats, level: Ints, good: NDArray[np.bool_], scale: float) -> Floats:
    """What each reading's scatter is in proportion to, shape (P,): one, or its thrust as a share of full scale where
    that makes the good readings' deviations from their neighbours likelier (as Laplace's: a mean, not a square)."""
    members, middle, smooth, _, _ = _courses(n, force, level, good, np.ones(len(n)))
    judged = np.isfinite(smooth)
    share = np.maximum(np.abs(np.where(judged, smooth, middle)) / scale, RISE)
    off, thrust = np.abs(middle - smooth)[judged], share[judged]
    if not off.any() or off.mean() <= (off / thrust).mean() * np.exp(np.log(thrust).mean()):
        return np.ones(len(n))
    return np.interp(n, [np.median(n[index]) for index in members], share)


def _beyond(n: Floats, force: Floats, level: Ints, scale: float, unit: Floats) -> Outliers:
    """First what breaks the rise of the curve, then, worst first, what lies off its course or repeats."""
    good = np.ones(len(n), dtype=bool)
    outliers = _falls(n, force, level, scale, unit)
    good[list(outliers)] = False
    for _ in range(len(n) // 4):
        deviation, limit = _off_course(n, force, level, good, scale, unit)
        worst = int(np.argmax(deviation / limit))
        if deviation[worst] <= limit[worst]:
            break
        good[worst] = False
        outliers[worst] = (float(deviation[worst]), float(limit[worst]))
    return outliers


def _falls(n: Floats, force: Floats, level: Ints, scale: float, unit: Floats) -> Outliers:
    """The fewest readings without which thrust rises with the command: the longest rising chain stays."""
    order = np.lexsort((force, n))
    strict = np.isin(np.arange(len(n)), order[_longest_rise(force[order], np.full(len(n), RISE * scale))])
    # The strict chain is smoother than the noise, the whole table rougher where it is contaminated.
    rough, smoother = (_courses(n, force, level, good, unit)[3] for good in (np.ones_like(strict), strict))
    tolerance = np.maximum(RISE * scale, RISE_MADS * min(rough, 2.0 * smoother) * unit)
    on_chain = np.isin(np.arange(len(n)), _longest_rise(force[order], tolerance[order]))
    outliers: Outliers = {}
    for place in np.flatnonzero(~on_chain):
        index = order[place]
        before = force[order[:place][on_chain[:place]]][-1:].tolist()
        after = force[order[place:][on_chain[place:]]][:1].tolist()
        low, high = min(before + after, default=0.0), max(before + after, default=0.0)
        outside = float(max(low - force[index], force[index] - high))
        limit = max(float(tolerance[index]), SCATTER * min(abs(low), abs(high))) if before and after else END * scale
        if outside > limit:
            outliers[int(index)] = (float(abs(force[index] - (low + high) / 2)), limit)
    return outliers


def _longest_rise(force: Floats, tolerance: Floats) -> Ints:
    """Indices of the longest chain in which no reading is lower than the one before by over the tolerance of either."""
    length, parent = np.ones(len(force), dtype=np.int64), np.full(len(force), -1)
    for j in range(1, len(force)):
        reach = np.where(force[:j] <= force[j] + np.maximum(tolerance[:j], tolerance[j]), length[:j], 0)
        # Of equal chains the one with the nearest step.
        best = np.flatnonzero(reach == reach.max())
        if reach[best[0]] > 0:
            nearest = best[np.argmin(np.abs(force[best] - force[j]))]
            length[j], parent[j] = length[nearest] + 1, nearest
    chain = [int(np.argmax(length))]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return np.array(chain[::-1], dtype=np.int64)


def _courses(
    n: Floats, force: Floats, level: Ints, good: NDArray[np.bool_], unit: Floats
) -> tuple[list[Ints], Floats, Floats, float, float]:
    """Indices of each level's readings, their median, what the levels around it say [N], and robust standard deviations
    [N] in the readings' `unit` (P,): about a smooth curve, or of repeats if that is larger, and of repeats alone."""
    members = [np.flatnonzero(good & (level == number)) for number in np.unique(level[good])]
    middle = np.array([np.median(force[index]) for index in members])
    smooth = left_out(np.array([np.median(n[index]) for index in members]), middle)
    # Of three readings or more; the smallest deviation of each level is the median's own and says nothing.
    repeated = ((index, m) for index, m in zip(members, middle) if len(index) >= 3)
    inside = [np.sort(np.abs(force[index] - m) / unit[index])[1:] for index, m in repeated]
    repeats = 1.4826 * float(np.median(np.concatenate(inside))) if inside else 0.0
    off, rough = (np.abs(middle - smooth) / [unit[index[0]] for index in members])[np.isfinite(smooth)], 0.0
    if len(off):
        # Median and lower quartile of a normal sample; in a coarse table half of the levels may stand by a bad one.
        rough = min(1.4826 * float(np.median(off)), 3.139 * float(np.quantile(off, 0.25)))
    return members, middle, smooth, max(rough, repeats), repeats


def _off_course(
    n: Floats, force: Floats, level: Ints, good: NDArray[np.bool_], scale: float, unit: Floats
) -> tuple[Floats, Floats]:
    """Deviation [N] from repeats at the same command or the smooth curve, and its limit, shape (P,)."""
    members, _, smooth, rough, noise = _courses(n, force, level, good, unit)
    repeat = np.maximum(RISE * scale, REPEAT_MADS * noise * unit)
    course = np.maximum(SMOOTH * scale, SMOOTH_MADS * rough * unit)
    deviations, limits = np.zeros(len(n)), np.full(len(n), scale)
    for index, expected in zip(members, smooth):
        for p in index:
            repeats, usual = force[index[index != p]], []
            if len(repeats) >= 2:
                usual.append((float(np.median(repeats)), repeat[p]))
            # A repeat that agrees says that the curve is like that.
            if np.isfinite(expected) and not np.any(np.abs(repeats - force[p]) <= repeat[p]):
                usual.append((float(expected), course[p]))
            for value, least in usual:
                deviation, limit = abs(force[p] - value), max(least, SCATTER * abs(value))
                if deviation * limits[p] > deviations[p] * limit:
                    deviations[p], limits[p] = deviation, limit
    return deviations, limits


def neighbour_weights(place: Floats) -> Floats:
    """Weights (P, P) by which a parabola through three levels on each side tells each level; NaN near zero and ends."""
    weights = np.full((len(place), len(place)), np.nan)
    for j in np.flatnonzero(place):
        side = np.flatnonzero(place * np.sign(place[j]) >= 0)
        low, high = side[side < j][-3:], side[side > j][:3]
        if len(low) >= 2 and len(high) >= 2:
            neighbours = np.concatenate([low, high])
            scaled = (place[neighbours] - place[j]) / np.ptp(place[neighbours])
            weights[j] = 0.0
            weights[j, neighbours] = np.linalg.pinv(np.vander(scaled, 3))[-1]
    return weights


def left_out(place: Floats, middle: Floats) -> Floats:
    """Each level [N] by its neighbours (see `neighbour_weights`), through the root of the thrust: that is nearly
    straight, so that coarse tables stay smooth."""
    straight = neighbour_weights(place) @ (np.sign(middle) * np.sqrt(np.abs(middle)))
    return np.asarray(straight * np.abs(straight))


@dataclass(frozen=True)
class Tare:
    """Zero reading of the load cell, per thruster [N]: mean, standard error, whether it was subtracted."""

    value_N: float = 0.0
    stderr_N: float = 0.0
    readings: int = 0
    drift_N: float = 0.0
    subtracted: bool = False

    @property
    def thrust_stderr(self) -> float:
        """Standard error [N] that it leaves in every thrust."""
        return self.stderr_N if self.subtracted else 0.0

    @property
    def says(self) -> str:
        if self.readings == 0:
            return "No reading at zero command: thrust is taken as logged, without a tare."
        where = f"{self.readings} zero-command reading{'s' if self.readings > 1 else ''}"
        if not self.subtracted:
            return f"The tare of {self.value_N:.4g} N from {where} is within its scatter and was not subtracted."
        drift = f", drifting by {self.drift_N:.3g} N" if self.drift_N else ""
        return f"A tare of {self.value_N:.4g} N from {where}{drift} was subtracted."


def subtract_tare(points: Points) -> tuple[Points, Tare]:
    """Thrust with the zero reading taken off, and what it was.

    A record with its own zero readings uses them (in a raw series linear in time), another the mean of all.
    Those of a table are subtracted only where their mean is over twice its standard error: it is usually tared already,
    and one more noisy reading would be added to every point."""
    zero = (points.n == 0.0) & (points.flag == "")
    if not np.any(zero):
        return points, Tare()
    mean, raw = float(np.mean(points.force[zero])), bool(np.all(points.raw[zero]))
    stderr, count = _tare_error(points, zero, raw), int(np.count_nonzero(zero))
    if not raw and abs(mean) <= 2.0 * stderr:
        return points, Tare(mean, stderr, count)
    offset, drift = np.full(len(points), mean), 0.0
    for record in np.unique(points.record[zero]):
        inside = points.record == record
        resting = points.where(zero & inside)
        if raw:
            order = np.argsort(resting.when, kind="stable")
            offset[inside] = np.interp(points.when[inside], resting.when[order], resting.force[order])
            drift = max(drift, float(np.ptp(resting.force)))
        else:
            offset[inside] = np.mean(resting.force)
    return replace(points, force=points.force - offset), Tare(mean, stderr, count, drift, mean != 0.0)


def _tare_error(points: Points, zero: np.ndarray, raw: bool) -> float:
    """Standard error of the zero reading [N]: from samples, repeats, or the table's own roughness."""
    values = points.force[zero]
    if raw:
        # Between two rests a point leans on both of them, not on the mean of all.
        most = max(np.count_nonzero(zero & (points.record == number)) for number in np.unique(points.record))
        leans_on = min(most, 2) if most > 1 else len(values)
        return float(np.sqrt(np.mean(points.stderr[zero] ** 2) / leans_on))
    if len(values) >= 3:
        return float(np.std(values, ddof=1) / np.sqrt(len(values)))
    good = points.flag == ""
    order = np.argsort(points.n[good], kind="stable")
    residual = points.force[good][order] - left_out(points.n[good][order], points.force[good][order])
    if np.any(np.isfinite(residual)):
        return 1.4826 * float(np.nanmedian(np.abs(residual))) / np.sqrt(len(values))
    # Too few levels to tell how rough the table is: half a percent of full scale.
    return 0.005 * points.full_scale / np.sqrt(len(values))


REST_SPEED_SHARE = 0.005  # of full scale, within which a measured speed is zero
HANDFUL = 5  # up to this many equal commands in sequence are single readings, not a raw series
BATCHES = 10  # batch means: enough for a variance, long enough to outlive the autocorrelation
SPIKE = 8.0  # robust standard deviations beyond which one sample is an electrical spike
MAX_READINGS = 2000  # rows of one record that are judged one by one
SLOW = 0.02  # of the range: how far the command may move within the mean of neighbouring rows
NOISY = 0.02  # command noise up to this share of its range still means "held constant"
SERIES = 200  # rows from which a measured speed may be a series
WINDOWS = (25, 10)  # samples whose mean tells a change of speed; a plateau holds three of them
FRAGMENTS = 3  # a series of commands falls into as many pieces by its values as by its steadiness; a speed in more
UNSTEADY = 0.05  # scatter of a steady speed, share of its range


def reduce_series(records: Sequence[Series], thrusters: int = 1) -> tuple[Points, tuple[str, ...]]:
    """One point for each reading of a table, one for each plateau of a raw series: where non-zero commands are held
    over more than a handful of samples in sequence, or a measured speed is steady for most of the time. The thrust is
    that of one of `thrusters` equal ones that pulled together (equation 3). Then come notes for a person."""
    parts, notes = [], []
    for number, record in enumerate(records):
        edges = (np.flatnonzero(np.diff(record.n) != 0) + 1).tolist()
        segments = list(pairwise([0, *edges, len(record.n)]))  # in which the command is held
        lengths = [stop - start for start, stop in segments if np.any(record.n[start:stop] != 0)]
        typical = np.median(lengths) if lengths else len(record.n)
        steady = _steady(record.n) if len(record.n) >= SERIES else []
        measured = 0 < FRAGMENTS * len(steady) < len(segments)
        if typical <= HANDFUL and not measured:
            parts.append(_readings(record, number))
            continue
        plateaus, unsettled = _plateaus(record, number, steady if measured else segments, measured)
        if unsettled:
            note = f"thrust at n = {', '.join(f'{level:.4g}' for level in unsettled)} was still changing"
            notes.append(f"{record.source}: {note} when the command ended; hold each command longer")
        parts.append(plateaus)
    columns = {name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])}
    columns |= {name: columns[name] / thrusters for name in ("force", "spread", "stderr")}
    columns["step"] = voltage_steps(columns["voltage"])
    return Points(**columns), tuple(notes)


def _steady(n: Floats) -> list[tuple[int, int]]:
    """Half-open index ranges in which a measured speed (N,) is steady, with its noise, its steps and its lag; none
    where they are not most of it, as in a sweep or a table in random order."""
    span = float(np.ptp(n))
    for window in WINDOWS:
        ranges = []
        for start, stop in _between_changes(n, window, span):
            first, second = np.array_split(n[start:stop], 2)
            level = stop - start >= 3 * window and abs(first.mean() - second.mean()) <= NOISY * span
            if level and float(np.std(n[start:stop])) <= UNSTEADY * span:
                ranges.append((start, stop))
        if len(ranges) >= 3 and sum(stop - start for start, stop in ranges) >= 0.5 * len(n):
            return ranges
    return []


def _between_changes(n: Floats, window: int, span: float) -> list[tuple[int, int]]:
    """Ranges between changes of the mean of `window` samples from one window to the next; how much these differ by
    noise alone is read from their smallest differences."""
    total = np.concatenate([[0.0], np.cumsum(n)])
    means = (total[window:] - total[:-window]) / window
    change = np.abs(means[window:] - means[:-window])  # about sample i + window
    limit = max(5.0 * float(np.quantile(change, 0.3)) / 0.385, 0.01 * span)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], change > limit, [False]]).astype(int)))
    ranges, start = [], 0
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist()):
        middle = first + int(np.argmax(change[first:last])) + window
        ranges.append((start, min(first + 2 * window, middle)))
        start = max(last, middle)
    return [*ranges, (start, len(n))]


def settled_from(force: Floats) -> tuple[int, bool]:
    """First sample of the steady part of a plateau, and whether it had settled at all.

    MSER-5 (White 1997, Simulation 69:323): on means of five samples, the cut that gives the smallest standard error of
    the mean of the rest. A cut at the latest place allowed (half of the record) means that it never settled."""
    batch = 5
    count = len(force) // batch
    if count < 6:
        return 0, True
    means = force[: count * batch].reshape(count, batch).mean(axis=1)
    remaining = np.arange(count, 0, -1)
    total = np.cumsum(means[::-1])[::-1]
    squares = np.cumsum((means[::-1] - means.mean()) ** 2)[::-1]
    centre = total / remaining - means.mean()
    score = np.maximum(squares - remaining * centre**2, 0.0) / remaining**2
    latest = count // 2
    cut = int(np.argmin(score[: latest + 1]))
    # at the latest place it has settled if it climbs or falls no more than its own scatter explains
    late = means[latest:] - means[latest:].mean()
    place = np.arange(len(late)) - (len(late) - 1) / 2
    length = float(place @ place)
    slope = float(place @ late) / length
    scatter = np.sqrt(float(np.sum((late - slope * place) ** 2)) / max(len(late) - 2, 1))
    return cut * batch, cut < latest or abs(slope) * np.sqrt(length) <= 6.0 * scatter


def standard_error(force: Floats) -> float:
    """Standard error of the mean of correlated samples, shape (N,), by batch means [unit of force]."""
    if len(force) < 2:
        return float("nan")
    size = max(len(force) // BATCHES, 1)
    count = len(force) // size
    means = force[: count * size].reshape(count, size).mean(axis=1)
    return float(np.std(means, ddof=1) / np.sqrt(count))


def _plateaus(
    record: Series, number: int, segments: list[tuple[int, int]], measured: bool
) -> tuple[Points, list[float]]:
    """One point a plateau, and the commands at which thrust had not settled."""
    pieces, settled = [], []
    for start, stop in segments:
        if stop - start <= HANDFUL:
            continue
        samples = np.arange(start, stop)[~_spikes(record.force[start:stop])]
        cut, rests = settled_from(record.force[samples])
        if measured:  # the speed has a lag of its own
            cut = max(cut, settled_from(record.n[samples])[0])
        pieces.append(samples[cut:])
        settled.append(rests)
    points = _means(record, number, pieces, raw=True)
    return points, points.n[~np.array(settled, dtype=bool)].tolist()


def _means(record: Series, number: int, pieces: Sequence[Ints], *, raw: bool) -> Points:
    """One point for the mean of each of the pieces of a record."""
    time = np.arange(float(len(record.n))) if record.time is None else record.time
    volts = np.full(len(time), np.nan) if record.voltage is None else record.voltage
    rows, least = [], REST_SPEED_SHARE * float(np.max(np.abs(record.n))) if raw else 0.0
    for piece in pieces:
        command, force = record.n[piece], record.force[piece]
        n = float(np.mean(command)) if np.ptp(command) else float(command[0])
        if np.ptp(command) and abs(n) <= least:  # a measured speed at rest
            n = 0.0
        spread = np.std(force, ddof=1) if len(force) > 1 else np.nan
        stderr = standard_error(force) if raw else np.nan
        rows.append((n, force.mean(), spread, len(force), stderr, time[piece].mean(), volts[piece].mean()))
    level, mean, deviation, count, error, when, voltage = np.array(rows, dtype=float).reshape(-1, 7).T
    return replace(
        Points.measured(level, mean, when, voltage, number), spread=deviation, count=count.astype(np.int64),
        stderr=error, raw=np.full(len(rows), raw),
    )  # fmt: skip


def _spikes(force: Floats) -> np.ndarray:
    """Electrical spikes, shape (N,): samples that stand out of their six neighbours and the whole plateau."""
    if len(force) <= 14:
        return np.zeros(len(force), dtype=bool)
    centre = ndimage.median_filter(force, 7, mode="nearest")
    off, away = np.abs(force - centre), np.abs(force - np.median(force))
    return np.asarray((off > SPIKE * 1.4826 * np.median(off)) & (away > SPIKE * 1.4826 * np.median(away)) & (off > 0))


def _readings(record: Series, number: int) -> Points:
    """A table: every row is a point. A long slow sweep goes in means of neighbouring rows."""
    n, size = record.n, -(-len(record.n) // MAX_READINGS)
    if size <= 1 or np.median(np.abs(np.diff(n))) * size > SLOW * np.ptp(n):
        when = np.arange(float(len(n))) if record.time is None else record.time
        return Points.measured(n, record.force, when, record.voltage, number)
    return _means(record, number, np.array_split(np.arange(len(n)), -(-len(n) // size)), raw=False)
