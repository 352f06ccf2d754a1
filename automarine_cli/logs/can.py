"""CAN captures, decoded with a DBC: ASC and BLF of Vector's tools, SLCAN of a serial converter, candump -L of Linux.

The column map names the DBC, relative to itself, and the signals as MESSAGE.SIGNAL:

    [can]
    dbc = "vehicle.dbc"
    [columns]
    heading_deg = "Compass.Heading"

SLCAN (.slcan) is the text that a CAN-to-serial converter sends, one frame a line: `t12380011223344556677ABCD` is a
frame of identifier 0x123 with 8 bytes and, after them, the converter's clock in milliseconds, which begins anew every
minute. A capture may have the time of its arrival in seconds in front of each line; as lines wait for one another, the
converter's own clock is used where there is one. Source: the LAWICEL protocol.
"""

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import LABELS, ColumnMap
from automarine_cli.logs.formats import Format, RawLog, refuse_empty, skipped
from automarine_cli.logs.streams import Recording, Stream, named, needed, on_one_clock, unsound_is_refused
from automarine_cli.quantities import Floats
from automarine_cli.text import listed, printable

SLCAN_LINE = re.compile(
    rb"\s*(?:\(?(\d+\.\d+)\)?[\s,]+)?(?:t([0-9A-Fa-f]{3})|T([0-9A-Fa-f]{8}))([0-8])([0-9A-Fa-f]*)\s*"
)
FRAME = re.compile(rb"(?:^|[\s,])[tT][0-9A-Fa-f]{4}")
CLOCK_DIGITS = "ABCD"  # four digits
CLOCK_PERIOD_S = 60.0  # s after which the converter's clock begins anew


OBJECT, OBJECT_HEAD = b"LOBJ", 16  # how an object in a BLF file begins, and bytes of its shortest header
Name = tuple[int, bool]  # identifier, and whether it is an extended one
Captured = tuple[Floats, list[Name], list[bytes]]  # times [s], names and data of frames


def read_slcan(content: bytes, source: str) -> tuple[Captured, int]:
    """Return the frames of a capture, and how many lines only look like frames. Raises LogError without times."""
    rows, bad = [], 0
    for line in re.split(rb"[\r\n\a]+", content):
        match = SLCAN_LINE.fullmatch(line)
        digits = 2 * int(match[4]) if match else 0
        if match is None or len(match[5]) not in (digits, digits + len(CLOCK_DIGITS)):
            bad += FRAME.search(line) is not None
            continue
        data, stamp = match[5][:digits], match[5][digits:]
        clock = int(stamp, 16) / 1e3 if stamp else np.nan
        name = int(match[2] or match[3], 16), match[2] is None
        rows.append((float(match[1] or "nan"), clock, name, bytes.fromhex(data.decode())))
    arrived, clocks = (np.array([row[i] for row in rows], dtype=np.float64) for i in (0, 1))
    return (_time(arrived, clocks, source), [row[2] for row in rows], [row[3] for row in rows]), bad


def _time(arrived: Floats, clock: Floats, source: str) -> Floats:
    """Seconds of each frame, rising over the minutes."""
    if not len(clock):
        return clock
    if np.isnan(clock).any():
        if np.isnan(arrived).any():
            raise LogError(
                f"{source}: the frames have no time; let the converter add it (command Z1), or write the time of "
                "arrival in seconds in front of each line"
            )
        return arrived
    if np.isnan(arrived).any():
        return clock + CLOCK_PERIOD_S * np.cumsum(np.diff(clock, prepend=clock[:1]) < 0)
    passed = (arrived - arrived[0]) - (clock - clock[0])
    return arrived[0] + clock - clock[0] + CLOCK_PERIOD_S * np.round(passed / CLOCK_PERIOD_S)


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read an ASC, BLF, SLCAN or candump capture. Raises LogError for what is none, and without a DBC."""
    reader = {".slcan": _slcan, ".log": _candump}.get(path.suffix.lower(), _vector)
    needed("can", "can", name, "CAN captures")
    needed("cantools", "can", name, "DBC files")
    with unsound_is_refused(name, "CAN"):
        (time, names, frames), notes = reader(path, name)
    refuse_empty(names, name, "CAN frames")
    places: dict[Name, list[int]] = {}
    for i, key in enumerate(names):
        places.setdefault(key, []).append(i)
    messages = {(m.frame_id, m.is_extended_frame): m for m in messages_of(columns)} if columns.dbc else {}
    unknown = [f"0x{key[0]:x} ({len(at)})" for key, at in sorted(places.items()) if key not in messages]
    if not columns.dbc:
        raise LogError(
            f"{name}: CAN frames are decoded with a DBC; found the identifiers {listed(unknown)}. Write the DBC and "
            'the signals in a file, [can] with dbc = "vehicle.dbc" and [columns] with heading_deg = "MESSAGE.SIGNAL", '
            "and give it with --columns FILE.toml"
        )
    decoded = {messages[key]: at for key, at in places.items() if key in messages}
    streams = [s for m, at in decoded.items() for s in _streams(m, time[at], [frames[i] for i in at], columns)]
    holds = (*(f"{message.name} ({len(at)})" for message, at in decoded.items()), *unknown)
    return on_one_clock(Recording(streams, holds, notes), columns, name)


CANDUMP = Format("candump", (".log",), read, begins=(b"(",))
FORMAT = Format("CAN capture", (".asc", ".blf", ".slcan"), read, begins=(b"LOGG", b"date", b"Date", b"t", b"T", b"("))


def frames_of(messages: Any) -> tuple[Captured, bool]:
    """The data frames that a reader of python-can gives, and whether it came to the end."""
    frames: list[tuple[float, Name, bytes]] = []
    sound = True
    try:
        for frame in messages:
            if not (frame.is_error_frame or frame.is_remote_frame):
                frames.append((frame.timestamp, (frame.arbitration_id, frame.is_extended_id), bytes(frame.data)))
    except Exception:
        sound = False
    return (np.array([f[0] for f in frames]), [f[1] for f in frames], [f[2] for f in frames]), sound


def _vector(path: Path, name: str) -> tuple[Captured, tuple[str, ...]]:
    import can

    if path.suffix.lower() == ".asc":
        with path.open(encoding="latin-1") as text:
            captured, sound = frames_of(can.ASCReader(text))
    else:
        with path.open("rb") as binary:
            captured, sound = frames_of(_guarded(can.BLFReader)(binary))
    return captured, () if sound else ("the capture is cut short or damaged: frames after that are not read",)


def _guarded(reader: Any) -> Any:
    """A BLF reader that ends at an object which says it is shorter than its own header: python-can's stays there."""

    class Guarded(reader):
        def _parse_data(self, data: bytes) -> Iterator[Any]:
            at = data.find(OBJECT)
            while at >= 0:
                size = int.from_bytes(data[at + 8 : at + 12], "little")
                if size < OBJECT_HEAD and at + 12 <= len(data):
                    raise ValueError("an object of no length")
                at = data.find(OBJECT, at + len(OBJECT))
            yield from super()._parse_data(data)

    return Guarded


def _slcan(path: Path, name: str) -> tuple[Captured, tuple[str, ...]]:
    captured, bad = read_slcan(path.read_bytes(), name)
    return captured, skipped(bad, "line", "not a CAN frame")


def messages_of(columns: ColumnMap) -> list[Any]:
    """Every message of the DBC that a column map names, as cantools knows it. Raises LogError for what is none."""
    library = needed("cantools", "can", columns.source or "the column map", "DBC files")
    name = printable(Path(columns.dbc).name)
    try:
        return list(library.database.load_file(columns.dbc, database_format="dbc", strict=False).messages)
    except Exception as problem:
        reason = printable((getattr(problem, "strerror", None) or str(problem)).partition("\n")[0])
        raise LogError(
            f"{name}: is not a readable DBC ({reason}); give its place relative to the column map, or export it again"
        ) from None


def _streams(message: Any, time: Floats, frames: list[bytes], columns: ColumnMap) -> Iterator[Stream]:
    """The signals of a message, if the column map names one of them: those of each multiplexer value on their own."""
    if not any(f"{message.name}.{signal.name}" in columns.sources for signal in message.signals):
        return
    from cantools.database.utils import start_bit

    fitting = [signal for signal in message.signals if start_bit(signal) + signal.length <= 8 * message.length]
    if len(fitting) < len(message.signals):  # a DBC in use may describe more than a frame holds
        identity = message.frame_id, message.name, message.length
        message = type(message)(*identity, fitting, is_extended_frame=message.is_extended_frame, strict=False)
    words = {columns.columns[label].source for label in LABELS if label in columns.columns}
    good = np.array([len(frame) >= message.length for frame in frames])
    rows = [_decoded(message, frame[: message.length]) for frame, fits in zip(frames, good) if fits]
    groups: dict[tuple[str, tuple[int, ...]], list[Any]] = {}
    for signal in message.signals:
        if any(signal.name in row for row in rows):
            key = (signal.multiplexer_signal or "", tuple(signal.multiplexer_ids or ()))
            groups.setdefault(key, []).append(signal)
    for (switch, ids), signals in groups.items():
        chosen = np.array([signals[0].name in row for row in rows])
        values = {}
        for signal in signals:
            name, numbers = f"{message.name}.{signal.name}", [row[signal.name] for row in rows if signal.name in row]
            column: Any = np.array(numbers, dtype=np.float64)
            if name in words:  # a value without a word stays a number
                column = named(np.rint((column - signal.offset) / signal.scale), signal.choices or {})
            values[name] = column
        which = f" ({switch} {listed(map(str, ids))})" if switch else ""
        yield Stream(f"{message.name}{which}", time[good][chosen], values)


def _decoded(message: Any, frame: bytes) -> Mapping[str, float]:
    try:
        return dict(message.decode(frame, decode_choices=False))
    except Exception:  # a multiplexer value that the DBC does not know
        return {}


CANDUMP_LINE = re.compile(
    r"\(\d+\.\d+\) +\S+ +(?:[0-9A-F]{3}|[0-9A-F]{8})#(?:#[0-9A-F])?(?:R\d?|(?:[0-9A-F]{2})*)(?: [RT])?", re.I
)


def _candump(path: Path, name: str) -> tuple[Captured, tuple[str, ...]]:
    import can

    lines = [line.strip() for line in path.read_text("latin-1").splitlines() if line.strip()]
    good = [line for line in lines if CANDUMP_LINE.fullmatch(line)]
    captured, _ = frames_of(can.CanutilsLogReader(io.StringIO("\n".join(good))))
    return captured, skipped(len(lines) - len(good), "line", "not a CAN frame")
