"""ROS 1 bags and ROS 2 bags (sqlite, MCAP): heading and yaw rate of Imu, Odometry or a pose, and any field by name.

ROS says where a vehicle points as an angle from east, counter-clockwise, on axes forward, left and up (REP 103); here
the heading counts clockwise from north, and yaw rate and sway are positive to starboard. The signs are turned, and
that is told. A field is named TOPIC.FIELD: `/thruster/port.data`, `/thrusters.data[0]`, `/imu/data.heading`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs import mcap_json
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.logs.streams import Recording, Stream, on_one_clock, taken
from automarine_cli.logs.vehicles import arming, needed, unsound_is_refused, yaw_of
from automarine_cli.pipeline.words import listed, quoted
from automarine_cli.quantities import Floats

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
OWN = {"heading": "heading_rad", "yaw_rate": "yaw_rate_rad_s", "surge": "surge_m_s", "sway": "sway_m_s"}
NOT_MEASURED = "orientation_covariance[0]"  # of an Imu without orientation: -1
MEND = "copy the file again, or if its recorder was stopped: rosbag reindex, ros2 bag reindex or mcap recover"
OTHER_CLOCK = 1.0  # s between stamps and the recorder's clock, from which they are two clocks
Getter = Callable[[Any], Any]
LONGEST_ARRAY = 16  # numbers of an array that become columns
DEEPEST = 6  # messages within messages
NUMBERS = ("bool", "float", "int", "uint", "octet", "byte", "char")
NAN = float("nan")
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
    if profile == "ros1":
        raise LogError(
            f"{name}: an MCAP file of the profile {quoted(profile)}, expected one of ros2 or of JSON channels; record "
            "a ROS 2 bag, or write its signals as CSV"
        )
    if profile not in (None, "ros2"):
        return mcap_json.read(path, name, columns)
    one = path.suffix.lower() == ".bag"
    library = needed("rosbags.rosbag1" if one else "rosbags.rosbag2", "ros", name, "ROS bags")
    with unsound_is_refused(name, "bag's", MEND), library.Reader(path) as bag:
        asked = columns.sources
        wanted = [link for link in bag.connections if link.msgcount and _wanted(link, asked)]
        topics = list(_topics(bag, wanted, one, asked))
        holds = {link.topic: f"{link.topic} ({link.msgtype.replace('/msg/', '/')})" for link in bag.connections}
    return on_one_clock(_recording(topics, tuple(holds.values()), columns), columns, name)


FORMAT = Format("ROS bag or MCAP", (".bag", ".db3", ".mcap"), read, begins=(b"#ROSBAG", b"SQLite format 3\0", MCAP))


def _profile(path: Path) -> str | None:
    """What the header of an MCAP file says it is of ("ros2", "" for nothing in particular); None for another file."""
    with path.open("rb") as file:
        head = file.read(64)
    if not head.startswith(MCAP) or head[8:9] != b"\1":
        return None
    length = int.from_bytes(head[17:21], "little")
    return head[21 : 21 + min(length, 40)].decode("latin-1")


def _wanted(link: Any, asked: Iterable[str]) -> bool:
    known = link.msgtype in (*POSES, STATE, BATTERY) or link.msgtype.startswith(STANDARD)
    return known or any(source.startswith(f"{link.topic}.") for source in asked)


def _topics(bag: Any, wanted: list[Any], one: bool, asked: set[str]) -> Iterable[Topic]:
    """The topics with the numbers and words that serve; messages of one topic in the order of the file."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    for link in wanted.copy():
        if link.msgtype not in store.fielddefs and not link.msgdef.data:
            wanted.remove(link)  # older bags do not say what types of one's own hold
        elif link.msgtype not in store.fielddefs:
            idl = link.msgdef.format.name == "IDL"
            types = get_types_from_idl(link.msgdef.data) if idl else get_types_from_msg(link.msgdef.data, link.msgtype)
            store.register({key: value for key, value in types.items() if key not in store.fielddefs})
    read_one = store.deserialize_ros1 if one else store.deserialize_cdr
    found: dict[str, tuple[str, list[int], list[Any]]] = {}
    if wanted:
        for link, stamp, raw in bag.messages(connections=wanted):
            _, stamps, messages = found.setdefault(link.topic, (link.msgtype, [], []))
            stamps.append(stamp)
            messages.append(read_one(raw, link.msgtype))
    for topic, (kind, stamps, messages) in found.items():
        serves = partial(_serves, topic, kind, asked)
        fields = _columns(getters(store.fielddefs, kind, messages[0], serves), messages)
        seconds, rest = fields.pop("header.stamp.sec", None), fields.pop("header.stamp.nanosec", None)
        none = np.full(len(stamps), np.nan)
        stamped = none if seconds is None or rest is None else np.where(seconds > 0, seconds + rest / 1e9, np.nan)
        yield Topic(topic, kind, fields, np.array(stamps, dtype=np.float64) / 1e9, stamped)


def _serves(topic: str, kind: str, asked: set[str], path: str) -> bool:
    """Whether a field of a message is looked at: stamps, motion, states, whatever is asked for, plain numbers."""
    if path.startswith("header.stamp.") or f"{topic}.{path}" in asked:
        return True
    if kind in POSES:
        return path == NOT_MEASURED or path.rpartition(".")[0] in POSES[kind]
    own = {STATE: ("mode", "armed"), BATTERY: ("voltage",)}
    return path in own[kind] if kind in own else kind.startswith(STANDARD) and not path.startswith("layout.")


def _columns(found: Mapping[str, Getter], messages: list[Any]) -> Fields:
    columns = {name: np.array([get(message) for message in messages]) for name, get in found.items()}
    return {name: c if c.dtype.kind == "U" else c.astype(np.float64) for name, c in columns.items()}


def _recording(topics: list[Topic], holds: tuple[str, ...], columns: ColumnMap) -> Recording:
    motions = {topic.name: _motion(topic) for topic in topics if topic.kind in POSES}
    turning = [topic for topic in topics if "heading" in motions.get(topic.name, {})]
    turning.sort(key=lambda topic: list(POSES).index(topic.kind))  # among those of one type the bag's order
    shift, notes = _clocks(turning)
    streams: list[Stream | None] = []
    given: set[str] = set()
    for topic in [*turning, *(one for one in topics if one not in turning)]:
        time = np.where(np.isnan(topic.stamped), topic.recorded + shift, topic.stamped)
        own = {key: name for key, name in OWN.items() if key in motions.get(topic.name, {}) and key not in given}
        given |= set(own)
        if topic.kind == BATTERY and "voltage" not in given:
            own["voltage"] = "voltage_V"
            given.add("voltage")
        fields = {**topic.fields, **motions.get(topic.name, {})}
        keep = topic.kind.startswith(STANDARD)
        streams.append(taken(topic.name, time, fields, own, columns, keep=keep))
        if topic.kind == STATE:
            states = {"mode": fields["mode"], "armed": arming(fields["armed"] > 0)}
            streams.append(Stream(topic.name, time, states, lasting=True))
    used = [stream for stream in streams if stream is not None]
    names = {stream.name for stream in used}
    unstamped = [one.name for one in topics if np.isnan(one.stamped).any() and one.name in names]
    if unstamped:
        notes.append(f"without stamps of their own, at the time of recording: {listed(unstamped)}")
    if turning:
        others = f", not of {listed(one.name for one in turning[1:])}" if len(turning) > 1 else ""
        turned = "turned from ROS's east, north, up and forward, left, up to clockwise from north"
        notes.insert(0, f"heading of {turning[0].name}{others}, {turned}")
    return Recording(used, "topics", holds, tuple(notes))


def _motion(topic: Topic) -> Fields:
    """Heading [rad], yaw rate [rad/s], surge and sway [m/s] by our signs, whichever the type has."""
    quaternion, angular, linear = POSES[topic.kind]
    x, y, z, w = (topic.fields[f"{quaternion}.{dof}"] for dof in "xyzw")
    found = {}
    yaw = yaw_of(w, x, y, z)
    yaw[topic.fields.get(NOT_MEASURED, np.zeros(len(yaw))) == -1] = np.nan
    if not np.isnan(yaw).all():
        found["heading"] = (np.pi / 2 - yaw) % (2 * np.pi)
    if angular:
        found["yaw_rate"] = -topic.fields[f"{angular}.z"]
    if linear:
        found |= {"surge": topic.fields[f"{linear}.x"], "sway": -topic.fields[f"{linear}.y"]}
    return found


def _clocks(turning: list[Topic]) -> tuple[float, list[str]]:
    """What takes the recorder's times to the clock of the heading's stamps [s], and a note where they are two."""
    if not turning or np.isnan(turning[0].stamped).all():
        return 0.0, []
    shift = float(np.nanmedian(turning[0].stamped - turning[0].recorded))
    if abs(shift) < OTHER_CLOCK:
        return 0.0, []
    return shift, [f"the stamps are {shift:+.3f} s from the recorder's clock; its times are moved by that"]


def getters(types: Mapping[str, Any], kind: str, first: Any, wanted: Callable[[str], bool]) -> dict[str, Getter]:
    """Path -> getter, for every wanted number and word of a message type; `first` shows how long its arrays are."""
    return {path: get for path, get in _inside(types, kind, "", first, 0) if wanted(path)}


def _inside(types: Mapping[str, Any], kind: str, prefix: str, first: Any, depth: int) -> Iterator[tuple[str, Getter]]:
    for name, (node, about) in types[kind][1]:
        path = f"{prefix}{name}"
        if node.name == "BASE" and (about[0].startswith(NUMBERS) or about[0] == "string"):
            yield path, attrgetter(path)
        elif node.name == "NAME" and depth < DEEPEST:
            yield from _inside(types, about, f"{path}.", first, depth + 1)
        elif node.name in ("ARRAY", "SEQUENCE"):
            (inner, what), _ = about
            if inner.name == "BASE" and what[0].startswith(NUMBERS):
                values = attrgetter(path)(first)
                yield from ((f"{path}[{i}]", _element(path, i)) for i in range(min(len(values), LONGEST_ARRAY)))


def _element(path: str, i: int) -> Getter:
    whole = attrgetter(path)

    def get(message: Any) -> Any:
        values = whole(message)
        return values[i] if i < len(values) else NAN

    return get
