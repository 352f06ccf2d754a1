"""MCAP files with JSON channels, as BlueOS records them: MAVLink messages as JSON, and any other JSON by its topic.

BlueOS's recorder writes each message of the vehicle as `{"header": {...}, "message": {"type": "ATTITUDE", ...}}` on the
topic mavlink/SYSTEM/COMPONENT/NAME, with its own clock; these are read as the telemetry log of a ground station is,
under the same names (`ATTITUDE.yaw`). A field of any other topic is named TOPIC.FIELD. Channels of other encodings,
such as video, are passed over. Sources: mcap.dev/spec; bluerobotics/blueos-recorder, src/service.rs;
bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs.
"""

import json
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import RawLog
from automarine_cli.logs.streams import Recording, on_one_clock, taken
from automarine_cli.logs.tlog import MAV_MODE_ARMED, Message, of_the_vehicle, recording
from automarine_cli.logs.vehicles import needed, unsound_is_refused

OWN = ("ATTITUDE", "SERVO_OUTPUT_RAW", "SYS_STATUS", "HEARTBEAT", "PARAM_VALUE")  # what is always looked at
ROOT = "mavlink/"
VEHICLES = {"MAV_TYPE_GROUND_ROVER": 10, "MAV_TYPE_SURFACE_BOAT": 11, "MAV_TYPE_SUBMARINE": 12}
ARMED = "MAV_MODE_FLAG_SAFETY_ARMED"
DEEPEST = 4  # objects within objects
Rows = list[tuple[float, dict[str, Any]]]


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read an MCAP file of JSON channels. Raises LogError where it holds no heading."""
    needed("mcap.reader", "blueos", name, "MCAP files with JSON channels")
    with unsound_is_refused(name, "MCAP file's", "copy the file again, or if its recorder was stopped: mcap recover"):
        asked = {rule.source for rule in columns.columns.values()}
        rows: dict[str, Rows] = {}
        counted: Counter[str] = Counter()
        whole = True
        for topic, encoding, stamp, data in _records(path):
            if topic is None:
                whole = False
                break
            counted[topic] += 1
            if encoding == "json" and _wanted(topic, asked):
                found = json.loads(data)
                if isinstance(found, dict):
                    rows.setdefault(topic, []).append((stamp / 1e9, found))
        notes = () if whole else ("the file ends within a chunk: its recorder was stopped; read up to there",)
        holds = tuple(f"{topic} ({count})" for topic, count in counted.items())
        told = _recording(rows, columns, notes, holds)
    return on_one_clock(told, columns, name)


def _records(path: Path) -> Iterator[tuple[str | None, str, int, bytes]]:
    """Topic, encoding, the recorder's time [ns] and content of each message in the order of the file; a last one of no
    topic where the file is cut off."""
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    with path.open("rb") as file:
        try:
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                yield channel.topic, channel.message_encoding, message.log_time, message.data
        except (EndOfFile, struct.error):  # the library unpacks what is left of a record
            if file.read(1):
                raise
            yield None, "", 0, b""


def _mavlink(topic: str) -> str:
    """The message of a topic of MAVLink, "" for another; single fields have topics of their own, which are not read."""
    parts = topic.split("/")
    return parts[3] if topic.startswith(ROOT) and len(parts) == 4 else ""


def _wanted(topic: str, asked: set[str]) -> bool:
    name = _mavlink(topic)
    return name in OWN or any(source.startswith((f"{topic}.", f"{name}." if name else f"{topic}.")) for source in asked)


def _recording(
    rows: Mapping[str, Rows], columns: ColumnMap, notes: tuple[str, ...], holds: tuple[str, ...]
) -> Recording:
    by_kind: dict[str, Rows] = {}
    streams = []
    for topic, told in rows.items():
        if _mavlink(topic):
            by_kind.setdefault(_mavlink(topic), []).extend(told)
        else:
            time = np.array([at for at, _ in told])
            streams.append(taken(topic, time, _columns([_flat(one) for _, one in told]), {}, columns))
    messages = {kind: _message(sorted(told, key=lambda row: row[0])) for kind, told in by_kind.items()}
    found = recording(of_the_vehicle(messages), columns, notes) if messages else Recording((), "", ())
    used = (*found.streams, *(stream for stream in streams if stream is not None))
    return Recording(used, "topics", holds, found.notes or notes, found.origin)


def _message(rows: Rows) -> Message:
    """The fields of one kind of message, with when it was recorded [s] and who sent it."""
    headers = [one.get("header", {}) for _, one in rows]
    sender = [(int(one.get("system_id", 0)) << 8) + int(one.get("component_id", 0)) for one in headers]
    fields = _columns([_plain(one.get("message", {})) for _, one in rows])
    return {"received": np.array([at for at, _ in rows]), "sender": np.array(sender, dtype=np.int64), **fields}


def _plain(message: Mapping[str, Any]) -> dict[str, float | str]:
    """Numbers and names of a message; what MAVLink counts and JSON spells out becomes the number again."""
    told: dict[str, float | str] = {}
    for key, value in message.items():
        if key == "mavtype":
            word = value.get("type", "") if isinstance(value, dict) else str(value)
            told["type"] = float(VEHICLES.get(word, 0))
        elif key == "base_mode":
            bits = value.get("bits", 0) if isinstance(value, dict) else value
            told[key] = float(MAV_MODE_ARMED * (ARMED in bits) if isinstance(bits, str) else bits)
        elif key == "param_id":
            told[key] = ("".join(value) if isinstance(value, list) else str(value)).rstrip("\0")
        elif isinstance(value, int | float):
            told[key] = float(value)
    return told


def _flat(value: object, prefix: str = "", depth: int = 0) -> dict[str, float | str]:
    """`{"a": {"b": [1, 2]}}` as a.b[0] and a.b[1]: the numbers, and words."""
    if isinstance(value, bool | int | float):
        return {prefix: float(value)}
    if isinstance(value, str):
        return {prefix: value}
    inner: Mapping[str, object] = {}
    if isinstance(value, dict):
        inner = {f"{prefix}.{key}" if prefix else str(key): one for key, one in value.items()}
    elif isinstance(value, list):
        inner = {f"{prefix}[{i}]": one for i, one in enumerate(value)}
    found: dict[str, float | str] = {}
    for path, one in inner.items() if depth < DEEPEST else ():
        found |= _flat(one, path, depth + 1)
    return found


def _columns(rows: list[dict[str, float | str]]) -> Message:
    """One array a field that is a number, or a word, in every row that has it; a number that is missing is NaN."""
    found: Message = {}
    for key in dict.fromkeys(key for row in rows for key in row):
        values = [row.get(key) for row in rows]
        if all(isinstance(value, float) or value is None for value in values):
            found[key] = np.array(values, dtype=np.float64)
        elif all(isinstance(value, str) for value in values):
            found[key] = np.array(values, dtype=str)
    return found
