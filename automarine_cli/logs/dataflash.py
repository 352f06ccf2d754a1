"""ArduPilot dataflash logs (ArduSub, Rover): heading of ATT, yaw rate of RATE or IMU, RCOU, BAT, MODE, arming.

A log is a row of messages, each 0xA3 0x95 and its type; FMT messages say how the others are laid out. All messages
of one type are unpacked at once. Source: ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog, refuse_empty, skipped
from automarine_cli.logs.mixing import parameters, recorded
from automarine_cli.logs.streams import Recording, Stream, arming, mode_names, needed, on_one_clock, unsound_is_refused
from automarine_cli.quantities import Floats

DATAFLASH_HEAD = b"\xa3\x95"
FMT, FMT_LENGTH = 0x80, 89
LAYOUT = np.dtype(
    [("head", "V3"), ("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)
SECONDS = {"TimeUS": 1e6, "TimeMS": 1e3}  # counts a second
ARMING, DISARM_EVENT = (10, 11, 15), 11  # events
INSTANCE = ("I", "Instance", "Inst")  # the byte that tells several sensors of one kind apart (a PID's I is none)
MESSAGE_COLUMNS = {"ATT": {"Yaw": "heading_deg"}, "RATE": {"Y": "yaw_rate_deg_s"}, "BAT": {"Volt": "voltage_V"}}
# messages of which fields are taken under canonical names, and what serves where they are not
INSTEAD = {"RATE": ("IMU", {"GyrZ": "yaw_rate_rad_s"}), "BAT": ("CURR", {"Volt": "voltage_V"})}
VEHICLE_TYPES = {"ArduSub": 12, "ArduRover": 10, "ArduCopter": 2, "ArduPlane": 1, "Blimp": 7}  # MAV_TYPE
Message = Mapping[str, NDArray[Any]]
Characters = Mapping[str, tuple[str, float | None, type]]  # of formats: numpy's type, factor
Layout = tuple[str, np.dtype[Any], dict[str, float | None]]  # name, bytes and factors of a message


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a dataflash log. Raises LogError for what is none, and where it holds no heading."""
    library = needed("pymavlink.DFReader", "ardupilot", name, "ArduPilot logs")
    with unsound_is_refused(name, "dataflash"):
        messages, lost = _messages(path.read_bytes(), library.FORMAT_TO_STRUCT)
        refuse_empty(messages, name, "ArduPilot dataflash messages")
        return on_one_clock(_recording(messages, columns, skipped(lost, "byte", "not a message")), columns, name)


FORMAT = Format("ArduPilot dataflash", (".bin",), read, begins=(DATAFLASH_HEAD,))


def _messages(data: bytes, characters: Characters) -> tuple[dict[str, Message], int]:
    """Fields of messages by name, each sensor of a kind on its own (BAT, BAT[1]); how many bytes are no messages."""
    layouts, places, lost = _indexed(data, characters)
    content = np.frombuffer(data, dtype=np.uint8)
    messages: dict[str, Message] = {}
    for kind, (name, layout, factors) in layouts.items():
        if kind == FMT or not places[kind]:
            continue
        rows = content[np.array(places[kind])[:, None] + np.arange(layout.itemsize)]
        table = np.ascontiguousarray(rows).view(layout)[:, 0]
        fields = {key: _field(table[key], factor) for key, factor in factors.items()}
        one_of = next((key for key in INSTANCE if key in fields and layout[key] == np.uint8), None)
        if one_of is None:
            messages[name] = fields
            continue
        for number in np.unique(fields[one_of]):
            same = fields[one_of] == number
            label = f"{name}[{number:g}]" if number else name
            messages[label] = {key: values[same] for key, values in fields.items() if key != one_of}
    return messages, lost


def _indexed(data: bytes, characters: Characters) -> tuple[dict[int, Layout], dict[int, list[int]], int]:
    """Layouts by type, where the messages of each begin, and how many bytes are none."""
    layouts: dict[int, Layout] = {FMT: ("FMT", LAYOUT, {})}
    places: dict[int, list[int]] = {FMT: []}
    lengths, at, end, lost = {FMT: FMT_LENGTH}, 0, len(data), 0
    while at + 3 <= end:
        length = lengths.get(data[at + 2]) if data[at] == 0xA3 and data[at + 1] == 0x95 else None
        if length is None or at + length > end:
            further = data.find(DATAFLASH_HEAD, at + 1)
            further = end if further < 0 else further
            lost += further - at if length is None else 0  # a message cut off by the end is no damage
            at = further
            continue
        kind = data[at + 2]
        if kind == FMT:
            new = np.frombuffer(data, LAYOUT, 1, at)[0]
            number, layout = int(new["type"]), _layout(new, characters)
            if layout is not None and number not in lengths:
                lengths[number], layouts[number], places[number] = int(new["length"]), layout, []
        places[kind].append(at)
        at += length
    return layouts, places, lost


def _layout(new: Any, characters: Characters) -> Layout | None:
    """The layout of messages that a FMT message tells; None where it makes no sense."""
    name, form = new["name"].decode("latin-1"), new["format"].decode("latin-1")
    keys = [key for key in new["columns"].decode("latin-1").split(",") if key]
    decodable = all(character in characters for character in form)
    if not decodable or len(keys) != len(form) or len(set(keys)) < len(keys) or not re.fullmatch(r"\w+", name):
        return None
    kinds = [characters[character] for character in form]
    parts = [("head", "V3")] + [
        (key, f"S{kind[0][:-1]}" if kind[0].endswith("s") else f"<{np.dtype(kind[0]).str[1:]}")
        for key, kind in zip(keys, kinds)
    ]
    layout = np.dtype(parts)
    return (name, layout, {k: kind[1] for k, kind in zip(keys, kinds)}) if layout.itemsize == new["length"] else None


def _field(values: NDArray[Any], factor: float | None) -> NDArray[Any]:
    """float64, exact to the hundredth where the file counts hundredths; or words."""
    if values.dtype.kind == "S":
        return np.char.decode(values, "latin-1")
    plain = values.astype(np.float64)
    return plain if factor is None else plain / round(1 / factor)


def _recording(messages: Mapping[str, Message], columns: ColumnMap, notes: tuple[str, ...]) -> Recording:
    names = MESSAGE_COLUMNS | {other: fields for name, (other, fields) in INSTEAD.items() if name not in messages}
    changes = messages.get("PARM", {})
    clock = _clock(changes) if {"Name", "Value"} <= changes.keys() else None
    history = () if clock is None else parameters(changes["Name"], clock, changes["Value"])
    holds = [f"{name} ({len(next(iter(message.values())))})" for name, message in messages.items()]
    return recorded(messages, _clock, SECONDS, names, "RCOU", history, columns, _states(messages), holds, notes)


def _clock(fields: Message) -> Floats | None:
    """Seconds since the vehicle started, shape (N,), or None for a message without a stamp."""
    return next((fields[key] / rate for key, rate in SECONDS.items() if key in fields), None)


def _states(messages: Mapping[str, Message]) -> list[Stream]:
    """The flight mode, and whether the vehicle is armed: by ARM, in older logs by the events 10, 11 and 15."""
    texts = " ".join(messages.get("MSG", {}).get("Message", ())[:50])
    vehicle = next((number for word, number in VEHICLE_TYPES.items() if word in texts), VEHICLE_TYPES["ArduSub"])
    mode, arm, event = (messages.get(name, {}) for name in ("MODE", "ARM", "EV"))
    changes = []
    if "Mode" in mode:
        changes.append((mode, {"mode": mode_names(mode["Mode"], vehicle)}))
    if "ArmState" in arm:
        changes.append((arm, {"armed": arming(arm["ArmState"] > 0)}))
    elif "Id" in event:
        arms = np.isin(event["Id"], ARMING)
        event = {key: values[arms] for key, values in event.items()}
        changes.append((event, {"armed": arming(event["Id"] != DISARM_EVENT)}))
    clocked = ((_clock(fields), state) for fields, state in changes)
    return [Stream("MODE", time, state, lasting=True) for time, state in clocked if time is not None]
