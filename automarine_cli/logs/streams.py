"""Streams of messages, each on its own clock, become one table on the clock of the heading.

Every value is held until the next, but what moves on meanwhile (`MOTION`); how old values are is told. Beside it what
logs of vehicles' own computers share: libraries that not everybody has, directions, names of states."""

import contextlib
import importlib
import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS
from automarine_cli.errors import LogError
from automarine_cli.logs.columns import CANONICAL, VELOCITIES, ColumnMap, Join, motion_of, names_of, quantities_of
from automarine_cli.logs.formats import LOGGED, CommandOrigin, RawLog, decoded
from automarine_cli.quantities import Floats
from automarine_cli.text import listed, plural, printable


def needed(module: str, extra: str, source: str, content_name: str) -> ModuleType:
    """The module of a library that the extra `extra` brings. Raises LogError that says how to install it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # theirs are none of the user's
            return importlib.import_module(module)
    except ImportError:
        raise LogError(
            f"{source}: {content_name} are read by {module.partition('.')[0]}, which is not installed; "
            f"say pip install 'automarine[{extra}]'"
        ) from None


@contextlib.contextmanager
def unsound_is_refused(source: str, content_name: str, mend: str = "copy the file again") -> Iterator[None]:
    """Whatever a library raises or prints over a damaged file becomes one LogError. An interrupt stays one."""
    try:
        quiet = io.StringIO()
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (LogError, MemoryError):
        raise
    except Exception as problem:
        if isinstance(problem, OSError) and problem.errno is not None:
            raise
        raise LogError(f"{source}: the {content_name} data is damaged inside; {mend}") from None


def yaw_of(w: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """Return the yaw [rad] of unit quaternions, (N,), -pi to pi (Diebel 2006, eq. 290); NaN for zeros or NaN."""
    yaw = np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)
    with np.errstate(invalid="ignore"):
        return np.where(w**2 + x**2 + y**2 + z**2 > 0.5, yaw, np.nan)


def mode_names(codes: NDArray[Any], vehicle: int) -> NDArray[np.str_]:
    """Names of flight modes, shape (N,), for a MAV_TYPE; a mode without a name keeps its number."""
    names: Mapping[int, object] = {}
    with contextlib.suppress(ImportError):  # a log that needs no pymavlink otherwise
        from pymavlink.mavutil import mode_mapping_bynumber

        names = mode_mapping_bynumber(vehicle) or {}
    return named(codes, names, "mode {}")


def named(codes: NDArray[Any], names: Mapping[int, object], other: str = "{}") -> NDArray[np.str_]:
    """The name of each code, shape (N,); one without a name keeps its number, told by `other`."""
    distinct, at = np.unique(codes, return_inverse=True)
    return np.array([str(names.get(int(code), other.format(int(code)))) for code in distinct], dtype=str)[at]


def arming(armed: NDArray[np.bool_]) -> NDArray[np.str_]:
    return np.where(armed, "armed", "disarmed")


LIKE_A_POSE = re.compile("pose|imu|odom|head|yaw|compass|attitude|orient|quat|ahrs", re.IGNORECASE)
TOPICS = 60  # topics


class NoHeading(LogError):
    """A recording, of a `source`, without a heading: what it `holds`, or what those that are `many` do."""

    def __init__(self, source: str, holds: Sequence[str], many: bool = False) -> None:
        super().__init__(source, holds, many)
        self.source, self.holds, self.many = source, holds, many

    def __str__(self) -> str:
        topics = listed(sorted(self.holds, key=lambda name: not LIKE_A_POSE.search(name.partition(" (")[0])), TOPICS)
        return (
            f"{self.source}: no heading in it; found {'in it and others ' if self.many else ''}{topics or 'nothing'}. "
            "If one of these holds the heading, name its field with a line such as "
            'heading_deg = "NAME.FIELD" under [columns] in a file and give it with --columns FILE.toml'
        )


PAUSE_S = 5.0  # s without a heading: the recorder stood still
# what moves on between two messages: no position that wraps
MOTION = {*VELOCITIES, *(q for dof in DOFS.values() for q in dof.channels if q != dof.position or not dof.wraps)}


@dataclass(frozen=True)
class Stream:
    """The messages of one kind: `time` [s] and columns, (N,) each, of numbers or of words. `also` says what the file
    calls canonical columns; a `lasting` stream tells changes of a state, whose age means nothing. No value is taken
    that is older than `oldest` [s]; with `nearest` the next one may be taken too."""

    name: str
    time: Floats
    columns: Mapping[str, NDArray[Any]]
    also: Mapping[str, str] = field(default_factory=dict)
    lasting: bool = False
    oldest: float = np.inf
    nearest: bool = False


@dataclass(frozen=True)
class Recording:
    """What a format finds in a file: its streams, and as in `RawLog`."""

    streams: Sequence[Stream]
    holds: tuple[str, ...]
    notes: tuple[str, ...] = ()
    origin: CommandOrigin = LOGGED


def taken(
    name: str, time: Floats, fields: Mapping[str, NDArray[Any]], names: Mapping[str, str], columns: ColumnMap,
    keep: bool = False,
) -> Stream:  # fmt: skip
    """Make a stream of the fields of a message that serve: `names` (field -> name), unless the column map takes that
    quantity from elsewhere, and as NAME.FIELD what it names, or with `keep` all."""
    sources = columns.sources
    mapped = {CANONICAL[key].quantity for key in columns.columns if key in CANONICAL}
    used, also = {}, {}
    for key, values in fields.items():
        full, canonical = f"{name}.{key}", names.get(key)
        if canonical is not None and (full in sources or CANONICAL[canonical].quantity not in mapped):
            used[canonical], also[full] = values, canonical
        elif full in sources or keep:
            used[full] = values
    return Stream(name, time, used, also)


def on_one_clock(recording: Recording, columns: ColumnMap, source: str) -> RawLog:
    """Bring all streams onto the clock of the one that holds the heading (in a thruster test: the force). Raises
    LogError that lists what the file holds where there is neither."""
    streams = [stream for stream in recording.streams if len(stream.time) and stream.columns]
    also = {name: column for stream in reversed(streams) for name, column in stream.also.items()}
    bollard = _is_bollard(streams, also, columns)
    if bollard:  # nothing turns in it, though a compass may have been on
        headings = names_of("heading")
        plain = ({name: c for name, c in stream.columns.items() if name not in headings} for stream in streams)
        streams = [replace(stream, columns=remaining) for stream, remaining in zip(streams, plain) if remaining]
        also = {name: column for name, column in also.items() if column not in headings}
    master = _master(streams, also, columns, bollard)
    if master is None:
        raise NoHeading(source, recording.holds)
    arrays: dict[str, pa.ChunkedArray] = {"time_s": _array(master.time)}
    ages, moving = [], _moving(columns)
    for stream in [master, *(stream for stream in streams if stream is not master)]:
        last = _held(stream, master)
        for name, values in stream.columns.items():
            moves = stream is not master and name in moving
            arrays.setdefault(name, _brought(stream, values, master, last, moves))
        if stream is not master and not stream.lasting:
            ages.append(_age(stream, master, last, moving.issuperset(stream.columns)))
    clocks = (f"on the clock of {printable(master.name)}, last values held: {'; '.join(ages)}",) if ages else ()
    return RawLog(
        tuple(arrays), tuple(arrays.values()), np.arange(1, len(master.time) + 1),
        also=also, notes=(*recording.notes, *clocks), holds=recording.holds, origin=recording.origin,
    )  # fmt: skip


def _master(streams: Sequence[Stream], also: Mapping[str, str], columns: ColumnMap, bollard: bool) -> Stream | None:
    names = (name for stream in streams for name in stream.columns)
    motion = (motion_of(names, columns.columns).position, "heading")
    for quantity in ("force",) if bollard else (*motion, "force"):
        mapped = [columns.columns[name].source for name in names_of(quantity) if name in columns.columns]
        for name in [*(also.get(source, source) for source in mapped), *names_of(quantity)]:
            for stream in streams:
                if name in stream.columns:
                    return stream
    return None


def _is_bollard(streams: Sequence[Stream], also: Mapping[str, str], columns: ColumnMap) -> bool:
    there = {name for stream in streams for name in stream.columns} | set(also)
    quantities = quantities_of(name for name, rule in columns.columns.items() if rule.source in there)
    commands = {name for dof in DOFS.values() for name in (dof.command, *dof.thrusters)}
    return quantities >= {"n", "force"} and not quantities & commands


def _held(stream: Stream, master: Stream) -> NDArray[np.int64]:
    """For each row the last message of the stream until then, -1 before the first; shape (N,)."""
    if stream is master:
        return np.arange(len(master.time))
    order = np.argsort(stream.time, kind="stable")
    time = stream.time[order]
    place = np.searchsorted(time, master.time, side="right") - 1
    if stream.nearest:
        after = np.minimum(place + 1, len(time) - 1)
        place = np.where((place < 0) | (time[after] - master.time < master.time - time[place]), after, place)
    valid = (place >= 0) & (np.abs(master.time - time[place]) <= stream.oldest)
    if not stream.lasting:  # what was sent before the recording paused says nothing of after
        valid &= stream.time[order[place]] > _paused(master.time)
    return np.where(valid, order[place], -1)


def _paused(time: Floats) -> Floats:
    """For each row since when a message is of the time after the last pause [s], -inf without one; shape (N,)."""
    last = np.full(len(time), -np.inf)
    after = np.flatnonzero(np.diff(time) > PAUSE_S) + 1
    last[after] = time[after] - PAUSE_S
    return np.maximum.accumulate(last)


def _brought(
    stream: Stream, values: NDArray[Any], master: Stream, latest: NDArray[np.int64], moves: bool
) -> pa.ChunkedArray:
    if values.dtype.kind == "f":
        if moves and np.all(np.diff(stream.time) >= 0):
            values = np.interp(master.time, stream.time, values)
            return _array(np.where(latest >= 0, values, np.nan))
        return _array(np.where(latest >= 0, values[latest], np.nan))
    words, code = np.unique(values.astype(str), return_inverse=True)
    rows = pa.array(np.maximum(code[latest], 0), mask=latest < 0)
    return pa.chunked_array([pa.array([word.encode() for word in words]).take(rows)])


def _array(values: Floats) -> pa.ChunkedArray:
    return pa.chunked_array([pa.array(values, pa.float64())])


def _age(stream: Stream, master: Stream, latest: NDArray[np.int64], interpolated: bool) -> str:
    name, valid = printable(stream.name), latest >= 0
    if not valid.any():
        return f"{name} begins only after the last row"
    age = np.abs(master.time[valid] - stream.time[latest[valid]])
    late = len(latest) - int(np.count_nonzero(valid))
    lacking = f", none in {plural(late, 'row')}" if late else ""
    how = ", interpolated" if interpolated else ""
    return f"{name} {np.median(age):.2g} s old in the median, {age.max():.2g} s at most{lacking}{how}"


def joined(
    raw: RawLog, clock: tuple[str, Floats], other: RawLog, theirs: tuple[str, Floats], names: tuple[str, str],
    columns: ColumnMap, join: Join,
) -> RawLog:  # fmt: skip
    """Add columns of another file, held as `join` says. Raises LogError where the clocks [s], (N,), never meet."""
    (column, time), master = theirs, Stream(names[0], clock[1], {})
    sound = np.isfinite(time)
    stream = Stream(names[1], time[sound], {}, oldest=join.max_age_s, nearest=join.take == "nearest")
    last = _held(stream, master) if sound.any() else np.full(len(master.time), -1)
    if not (last >= 0).any():
        clocks = [at[np.isfinite(at)] for at in (master.time, time)]
        ends = (f"from {at.min():.10g} to {at.max():.10g} s" for at in clocks if len(at))
        raise LogError(
            f"{names[0]} and {names[1]}, which is joined to it, run {listed(ends)}: their clocks do not meet within "
            f"{join.max_age_s:g} s. Correct the names in join, or one clock by an offset under [[columns_of]]"
        )
    moving, arrays = _moving(columns), {}
    for name, array in zip(other.names, other.arrays):
        if name and name != column and name not in raw.names and not pa.types.is_timestamp(array.type):
            number = pa.types.is_floating(array.type)
            values = array.to_numpy() if number else np.array([decoded(cell) for cell in array.to_pylist()], dtype=str)
            arrays[name] = _brought(stream, values[sound], master, last, name in moving)
    note = f"joined to the clock of {printable(names[0])}: {_age(stream, master, last, moving.issuperset(arrays))}"
    return replace(raw, names=(*raw.names, *arrays), arrays=(*raw.arrays, *arrays.values()), notes=(*raw.notes, note))


def _moving(columns: ColumnMap) -> set[str]:
    """Columns that hold motion, which goes on between two messages: by their names, and by what they are mapped to."""
    names = {name for name, canonical in CANONICAL.items() if canonical.quantity in MOTION}
    return names | {columns.columns[name].source for name in names & set(columns.columns)}
