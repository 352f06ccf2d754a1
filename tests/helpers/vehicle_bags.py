"""The dive of `vehicle_logs` as ROS bags, by the writers of rosbags: ROS 1, ROS 2 in sqlite and in MCAP."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from vehicle_logs import Dive

MODES = {19: "MANUAL", 2: "ALT_HOLD"}
STATE = "\n".join(
    ("std_msgs/Header header", "bool connected", "bool armed", "bool guided", "bool manual_input", "string mode",
     "uint8 system_status")
)  # fmt: skip


def bag(suffix: str, dive: Dive, without: tuple[str, ...] = (), start: float = 1.7e9, skew: float = 0.0) -> bytes:
    """A bag of the dive: /imu/data and /battery with header stamps, /odom, commands of std_msgs without; recorded a
    little late, by a clock that is `skew` s ahead.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    one = suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(STATE, "mavros_msgs/msg/State"))
    rows = sorted(_messages(store.types, dive, start, one), key=lambda row: row[0])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / (f"made{suffix}" if one else "made")
        with _writer(path, suffix) as writer:
            links: dict[str, Any] = {}
            for at, topic, message in rows:
                if topic in without:
                    continue
                if topic not in links:
                    links[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
                pack = store.serialize_ros1 if one else store.serialize_cdr
                late = 0.004 if topic == "/imu/data" else 0.0
                stamp = round((at + skew + late) * 1e9)
                writer.write(links[topic], stamp, bytes(pack(message, message.__msgtype__)))
        file = path if one else next(path.glob(f"*{suffix}"))
        return file.read_bytes()


def _writer(path: Path, suffix: str) -> Any:
    if suffix == ".bag":
        from rosbags.rosbag1 import Writer

        return Writer(path)
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    return Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3)


def _messages(types: Any, dive: Dive, start: float, one: bool) -> list[tuple[float, str, Any]]:
    def header(at: float) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](int(at), round((at - int(at)) * 1e9))
        return types["std_msgs/msg/Header"](*([0] if one else []), stamp=stamp, frame_id="base_link")

    vector, nine, six = types["geometry_msgs/msg/Vector3"], np.zeros(9), np.zeros(36)
    rows: list[tuple[float, str, Any]] = []
    for t, psi, rate in zip(dive.time + start, dive.heading, dive.rate):
        half = (np.pi / 2 - np.deg2rad(psi)) / 2  # from east, counter-clockwise
        facing = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(half), np.cos(half))
        turning = vector(0.0, 0.0, -np.deg2rad(rate))
        imu = types["sensor_msgs/msg/Imu"](header(t), facing, nine, turning, nine, vector(0.0, 0.0, 9.8), nine)
        rows.append((t, "/imu/data", imu))
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), facing)
        twist = types["geometry_msgs/msg/Twist"](vector(0.5, -0.25, 0.0), turning)
        odometry = types["nav_msgs/msg/Odometry"](
            header(t - 0.03), "base_link", types["geometry_msgs/msg/PoseWithCovariance"](pose, six),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, six),
        )  # fmt: skip
        rows.append((t, "/odom", odometry))
    number, many = types["std_msgs/msg/Float64"], types["std_msgs/msg/Float64MultiArray"]
    layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
    for t, port, stbd in zip(dive.command_time + start, dive.port, dive.stbd):
        rows.append((t, "/thruster/port", number(port)))
        rows.append((t, "/thrusters", many(layout, np.array([port, stbd]))))
    battery = types["sensor_msgs/msg/BatteryState"]
    for t, volt in zip(dive.voltage_time + start, dive.voltage):
        empty = np.zeros(0, np.float32)
        rows.append((t, "/battery", battery(header(t), volt, *[0.0] * 6, 0, 0, 0, True, empty, empty, "", "")))
    state = types["mavros_msgs/msg/State"]
    for t, mode, armed in dive.states():
        rows.append((t + start, "/mavros/state", state(header(t + start), True, armed, False, True, MODES[mode], 0)))
    return rows
