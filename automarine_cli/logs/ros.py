"""ROS 1 bags, ROS 2 bags (sqlite, MCAP), and MCAP files with JSON channels as BlueOS records them.

ROS's heading counts from east, counter-clockwise, on axes forward, left and up (REP 103): it is turned, as are yaw rate
and sway, and that is told. A field is named TOPIC.FIELD: `/thruster/port.data`, `/thrusters.data[0]`.

BlueOS records each message of the vehicle as `{"header": {...}, "message": {"type": "ATTITUDE", ...}}` on the topic
mavlink/SYSTEM/COMPONENT/NAME, with its own clock; these are read as a telemetry log is, under the same names
(`ATTITUDE.yaw`). Channels of other encodings are passed over. Sources: mcap.dev/spec; bluerobotics/blueos-recorder,
src/service.rs; bluerobotics/mavlink-server, src/lib/drivers/zenoh/json.rs."""

import contextlib
import json
import re
import struct
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs import streams
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.logs.tlog import MAV_MODE_ARMED, Message, of_the_vehicle, recording, serves
from automarine_cli.quantities import Floats
from automarine_cli.text import listed

ROOT = "mavlink/"
VEHICLE_MAV_TYPES = {"MAV_TYPE_GROUND_ROVER": 10, "MAV_TYPE_SURFACE_BOAT": 11, "MAV_TYPE_SUBMARINE": 12}
ARMED_FLAG = "MAV_MODE_FLAG_SAFETY_ARMED"
Rows = list[tuple[float, dict[str, Any]]]


def _read_json_channels(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read an MCAP file of JSON channels. Raises LogError where it holds no heading."""
    streams.needed("mcap.reader", "blueos", name, "MCAP files with JSON channels")
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    rows: dict[str, Rows] = {}
    counted: Counter[str] = Counter()
    notes: tuple[str, ...] = ()
    with streams.unsound_is_refused(name, "MCAP file's", MEND), path.open("rb") as file:
        try:
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                topic = channel.topic
                counted[topic] += 1
                serves_here = channel.message_encoding == "json" and serves(_mavlink(topic) or topic, columns.sources)
                if serves_here and isinstance(data := json.loads(message.data), dict):
                    rows.setdefault(topic, []).append((message.log_time / 1e9, data))
        except (EndOfFile, struct.error):  # the library unpacks what is left of a record
            if file.read(1):
                raise
            notes = ("the file ends within a chunk: its recorder was stopped; read up to there",)
        by_kind: dict[str, Rows] = {}
        readings = []
        for topic, part in rows.items():
            if kind := _mavlink(topic):
                by_kind.setdefault(kind, []).extend(part)
            else:
                fields = _columns([data for _, data in part], _named(topic, columns.sources))
                readings.append(streams.taken(topic, np.array([at for at, _ in part]), fields, {}, columns))
        messages = {kind: _json_message(sorted(part, key=lambda row: row[0])) for kind, part in by_kind.items()}
        holds = tuple(f"{topic} ({count})" for topic, count in counted.items())
        recorded = recording(of_the_vehicle(messages), columns, holds, notes)
    return streams.on_one_clock(replace(recorded, streams=(*recorded.streams, *readings)), columns, name)


def _mavlink(topic: str) -> str:
    """The message of a topic of MAVLink, "" for another; single fields have topics of their own, which are not read."""
    parts = topic.split("/")
    return parts[3] if topic.startswith(ROOT) and len(parts) == 4 else ""


def _json_message(rows: Rows) -> Message:
    """The fields of one kind of message, with when it was recorded [s] and who sent it."""
    headers = [data.get("header", {}) for _, data in rows]
    sender = [(int(head.get("system_id", 0)) << 8) + int(head.get("component_id", 0)) for head in headers]
    messages = [_plain(data.get("message", {})) for _, data in rows]
    keys = dict.fromkeys(key for message in messages for key in message)
    fields = {key: np.array([message.get(key, np.nan) for message in messages]) for key in keys}
    return {"received": np.array([at for at, _ in rows]), "sender": np.array(sender, dtype=np.int64), **fields}


def _plain(message: Mapping[str, Any]) -> dict[str, float | str]:
    """Numbers and names of a message; what MAVLink counts and JSON spells out becomes the number again."""
    fields: dict[str, float | str] = {}
    for key, value in message.items():
        if key == "mavtype":
            word = value.get("type", "") if isinstance(value, dict) else str(value)
            fields["type"] = float(VEHICLE_MAV_TYPES.get(word, 0))
        elif key == "base_mode":
            bits = value.get("bits", 0) if isinstance(value, dict) else value
            fields[key] = float(MAV_MODE_ARMED * (ARMED_FLAG in bits) if isinstance(bits, str) else bits)
        elif key == "param_id":
            fields[key] = ("".join(value) if isinstance(value, list) else str(value)).rstrip("\0")
        elif isinstance(value, int | float):
            fields[key] = float(value)
    return fields


MCAP = b"\x89MCAP0\r\n"
STANDARD = "std_msgs/msg/"
STATE = "mavros_msgs/msg/State"
BATTERY = "sensor_msgs/msg/BatteryState"
POSES = {  # type -> where its quaternion, angular and linear velocity are; the first that a bag holds is its heading
    "sensor_msgs/msg/Imu": ("orientation", "angular_velocity", ""),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "twist.twist.angular", "twist.twist.linear"),
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "", ""),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.orientation", "", ""),
}
POSE_COLUMNS = {"heading": "heading_rad", "yaw_rate": "yaw_rate_rad_s", "surge": "surge_m_s", "sway": "sway_m_s"}
STAMP_FIELDS = ("header.stamp.sec", "header.stamp.nanosec")
NOT_MEASURED = "orientation_covariance[0]"  # of an Imu without orientation: -1
MEND = "copy the file again, or if its recorder was stopped: rosbag reindex, ros2 bag reindex or mcap recover"
OTHER_CLOCK_S = 1.0  # s between stamps and the recorder's clock, from which they are two clocks
LONGEST_ARRAY = 16  # numbers of an array that become columns
Fields = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Topic:
    """One topic as read: type, fields, the recorder's times and the header's stamps [s], NaN where there is none."""

    name: str
    kind: str
    fields: Fields
    recorded: Floats
    stamped: Floats


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a bag, or an MCAP file of JSON channels. Raises LogError for what is none, and where it holds no heading."""
    profile = _profile(path)
    if profile not in (None, "ros2"):
        return _read_json_channels(path, name, columns)
    ros1 = path.suffix.lower() == ".bag"
    library = streams.needed("rosbags.rosbag1" if ros1 else "rosbags.rosbag2", "ros", name, "ROS bags")
    with streams.unsound_is_refused(name, "bag's", MEND), library.Reader(path) as bag:
        sources = columns.sources
        connections = [link for link in bag.connections if link.msgcount and _wanted(link, sources)]
        topics = list(_topics(bag, connections, ros1, sources))
        holds = {link.topic: f"{link.topic} ({link.msgtype.replace('/msg/', '/')})" for link in bag.connections}
    return streams.on_one_clock(_recording(topics, tuple(holds.values()), columns), columns, name)


FORMAT = Format("ROS bag or MCAP", (".bag", ".db3", ".mcap"), read, begins=(b"#ROSBAG", b"SQLite format 3\0", MCAP))


def _profile(path: Path) -> str | None:
    """What the header of an MCAP file says it is of ("ros2", "" for nothing in particular); None for another file."""
    with path.open("rb") as file:
        head = file.read(64)
    if not head.startswith(MCAP) or head[8:9] != b"\1":
        return None
    length = int.from_bytes(head[17:21], "little")
    return head[21 : 21 + min(length, 40)].decode("latin-1")


def _wanted(link: Any, sources: Iterable[str]) -> bool:
    is_standard = link.msgtype in (*POSES, STATE, BATTERY) or link.msgtype.startswith(STANDARD)
    return is_standard or bool(_named(link.topic, sources))


def _topics(bag: Any, wanted: list[Any], ros1: bool, sources: set[str]) -> Iterable[Topic]:
    """The topics with the numbers and words that serve; messages of one topic in the order of the file."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for link in wanted.copy():
        if link.msgtype not in store.fielddefs and not link.msgdef.data:
            wanted.remove(link)  # older bags do not say what types of one's own hold
        elif link.msgtype not in store.fielddefs:
            idl = link.msgdef.format.name == "IDL"
            types = get_types_from_idl(link.msgdef.data) if idl else get_types_from_msg(link.msgdef.data, link.msgtype)
            store.register({key: value for key, value in types.items() if key not in store.fielddefs})
    deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    topics: dict[str, tuple[str, list[int], list[Any]]] = {}
    if wanted:
        for link, stamp, raw in bag.messages(connections=wanted):
            _, stamps, messages = topics.setdefault(link.topic, (link.msgtype, [], []))
            stamps.append(stamp)
            messages.append(deserialize(raw, link.msgtype))
    for topic, (kind, stamps, messages) in topics.items():
        fields = _columns(messages, [*STAMP_FIELDS, *_usual(kind, messages[0]), *_named(topic, sources)])
        seconds, nanos = (fields.pop(path, None) for path in STAMP_FIELDS)
        none = np.full(len(stamps), np.nan)
        stamped = none if seconds is None or nanos is None else np.where(seconds > 0, seconds + nanos / 1e9, np.nan)
        yield Topic(topic, kind, fields, np.array(stamps, dtype=np.float64) / 1e9, stamped)


def _usual(kind: str, first: Any) -> list[str]:
    """The fields of a type that are looked at without being named: motion, states, plain numbers."""
    if kind in POSES:
        quaternion, angular, linear = POSES[kind]
        parts = [(quaternion, "xyzw"), (angular, "z"), (linear, "xy")]
        return [NOT_MEASURED, *(f"{path}.{axis}" for path, axes in parts if path for axis in axes)]
    if kind.startswith(STANDARD) and isinstance(getattr(first, "data", ""), np.ndarray):
        return [f"data[{i}]" for i in range(min(len(first.data), LONGEST_ARRAY))]
    return {STATE: ["mode", "armed"], BATTERY: ["voltage"]}.get(kind, ["data"] if kind.startswith(STANDARD) else [])


def _named(topic: str, sources: Iterable[str]) -> list[str]:
    return [source.removeprefix(f"{topic}.") for source in sources if source.startswith(f"{topic}.")]


def _columns(messages: list[Any], paths: Iterable[str]) -> Fields:
    """The fields of numbers or words at paths such as `pose.x` or `data[3]`, (N,), NaN where a message lacks one."""
    fields: Fields = {}
    for path in paths:
        keys = re.findall(r"[^.\[\]]+", path)
        values = [_inside(message, keys) for message in messages]
        if any(value is not None for value in values):
            with contextlib.suppress(TypeError, ValueError):  # neither numbers nor words
                column = np.array(values)
                fields[path] = column if column.dtype.kind == "U" else column.astype(np.float64)
    return {path: column for path, column in fields.items() if column.ndim == 1}


def _inside(value: Any, keys: list[str]) -> Any:
    for key in keys:
        try:
            by_place = isinstance(value, list | np.ndarray)
            value = value[int(key)] if by_place else value[key] if isinstance(value, dict) else getattr(value, key)
        except (AttributeError, LookupError, ValueError):
            return None
    return value


def _recording(topics: list[Topic], holds: tuple[str, ...], columns: ColumnMap) -> streams.Recording:
    motions = {topic.name: _motion(topic) for topic in topics if topic.kind in POSES}
    turning = [topic for topic in topics if "heading" in motions.get(topic.name, {})]
    turning.sort(key=lambda topic: list(POSES).index(topic.kind))  # among those of one type the bag's order
    shift, notes = _clocks(turning)
    readings = []
    free = {**POSE_COLUMNS, "voltage": "voltage_V"}  # of several sensors of one kind the first serves
    for topic in [*turning, *(topic for topic in topics if topic not in turning)]:
        time = np.where(np.isnan(topic.stamped), topic.recorded + shift, topic.stamped)
        motion = motions.get(topic.name, {})
        names = {key: name for key, name in free.items() if key in motion or (topic.kind, key) == (BATTERY, "voltage")}
        free = {key: name for key, name in free.items() if key not in names}
        fields = {**topic.fields, **motion}
        readings.append(streams.taken(topic.name, time, fields, names, columns, keep=topic.kind.startswith(STANDARD)))
        if topic.kind == STATE:
            states = {"mode": fields["mode"], "armed": streams.arming(fields["armed"] > 0)}
            readings.append(streams.Stream(topic.name, time, states, lasting=True))
    serving = {stream.name for stream in readings if stream.columns}
    if unstamped := [topic.name for topic in topics if np.isnan(topic.stamped).any() and topic.name in serving]:
        notes.append(f"without stamps of their own, at the time of recording: {listed(unstamped)}")
    if turning:
        unused = f", not of {listed(topic.name for topic in turning[1:])}" if len(turning) > 1 else ""
        turned = "turned from ROS's east, north, up and forward, left, up to clockwise from north"
        notes.insert(0, f"heading of {turning[0].name}{unused}, {turned}")
    return streams.Recording(readings, holds, tuple(notes))


def _motion(topic: Topic) -> Fields:
    """Heading [rad], yaw rate [rad/s], surge and sway [m/s] by our signs, whichever the type has."""
    quaternion, angular, linear = POSES[topic.kind]
    x, y, z, w = (topic.fields[f"{quaternion}.{dof}"] for dof in "xyzw")
    channels = {}
    yaw = streams.yaw_of(w, x, y, z)
    yaw[topic.fields.get(NOT_MEASURED, np.zeros(len(yaw))) == -1] = np.nan
    if not np.isnan(yaw).all():
        channels["heading"] = (np.pi / 2 - yaw) % (2 * np.pi)
    if angular:
        channels["yaw_rate"] = -topic.fields[f"{angular}.z"]
    if linear:
        channels |= {"surge": topic.fields[f"{linear}.x"], "sway": -topic.fields[f"{linear}.y"]}
    return channels


def _clocks(turning: list[Topic]) -> tuple[float, list[str]]:
    """What takes the recorder's times to the clock of the heading's stamps [s], and a note where they are two."""
    apart = turning[0].stamped - turning[0].recorded if turning else np.zeros(0)
    shift = float(np.median(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else 0.0
    if abs(shift) < OTHER_CLOCK_S:
        return 0.0, []
    return shift, [f"the stamps are {shift:+.3f} s from the recorder's clock; its times are moved by that"]
