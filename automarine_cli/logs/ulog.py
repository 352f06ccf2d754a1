"""PX4 logs (.ulg): heading of vehicle_attitude, vehicle_angular_velocity, motors, battery, mode and arming.

PX4's signs are ours. Moment and forces are worked back from the motors, to which PX4 sends the pseudo-inverse of what
each does by place, axis and thrust (`CA_ROTORn_PX`, ...), scaled so that the most moved motor follows a yaw command of
1 by 1, and the motors on the mean a thrust of 1 by 1. Sources: the ULog file format; PX4-Autopilot,
src/modules/control_allocator, ActuatorEffectivenessRotors.cpp and ControlAllocationPseudoInverse.cpp."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs import mixing, streams
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog, refuse_empty
from automarine_cli.quantities import Floats

ULOG_HEAD = b"ULog\x01\x12\x35"
TOPIC_COLUMNS = {
    "vehicle_attitude": {"heading": "heading_rad"},
    "vehicle_angular_velocity": {"xyz[2]": "yaw_rate_rad_s"},
    "battery_status": {"voltage_v": "voltage_V"},
}
BEFORE = {"yawspeed": "yaw_rate_rad_s"}  # where older logs have the yaw rate, in vehicle_attitude
MOTOR_TOPICS = ("actuator_motors", "actuator_outputs")  # commands -1 to 1; in older logs what goes to the drivers [us]
TORQUE = "vehicle_torque_setpoint"
SETPOINTS = {TORQUE: {"xyz[2]": "tau"}, "vehicle_thrust_setpoint": {"xyz[0]": "X", "xyz[1]": "Y", "xyz[2]": "Z"}}
MODES = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 10: "ACRO",
    12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD", 15: "STAB", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND",
}  # fmt: skip
ARMED_STATE = 2  # arming_state
Fields = Mapping[str, Mapping[str, str]]  # topic -> field -> canonical name
NO_FIELDS: Fields = {}
Topics = Mapping[str, Mapping[str, NDArray[Any]]]


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a PX4 log. Raises LogError for what is none, and where it holds no attitude."""
    library = streams.needed("pyulog", "px4", name, "PX4 logs")
    with path.open("rb") as file, streams.unsound_is_refused(name, "ULog"):
        refuse_empty(file.read(len(ULOG_HEAD)) == ULOG_HEAD, name, "PX4 log (ULog)")
        file.seek(0)
        log = library.ULog(file, None, True)
        topics = {
            f"{topic.name}[{topic.multi_id}]" if topic.multi_id else topic.name: topic.data
            for topic in log.data_list
            if "timestamp" in topic.data and len(topic.data["timestamp"])
        }
        recording = _recording(topics, _notes(log), columns, _parameters(log))
    return streams.on_one_clock(recording, columns, name)


FORMAT = Format("PX4 ULog", (".ulg",), read, begins=(ULOG_HEAD,))


def _notes(log: Any) -> tuple[str, ...]:
    lengths = [dropout.duration for dropout in log.dropouts]
    dropouts = f"drop-outs of the logger: {len(lengths)}, the longest {max(lengths, default=0):g} ms" if lengths else ""
    return tuple(filter(None, (dropouts, "damaged data were skipped" if log.file_corruption else "")))


def _recording(
    topics: Topics, notes: tuple[str, ...], columns: ColumnMap, history: mixing.Parameters
) -> streams.Recording:
    readings = []
    motors = next((name for name in MOTOR_TOPICS if name in topics), "")
    demand, wished = (mixing.Demand(), NO_FIELDS) if mixing.is_commanded_by(columns) else _demand(topics, history)
    for name, data in topics.items():
        fields = {key: np.asarray(values, dtype=np.float64) for key, values in data.items()}
        names = {**TOPIC_COLUMNS, **wished}.get(name, {})
        if name == "vehicle_attitude":
            w, x, y, z = (fields[f"q[{i}]"] for i in range(4))
            fields["heading"] = streams.yaw_of(w, x, y, z) % (2 * np.pi)
            names = names if "vehicle_angular_velocity" in topics else {**names, **BEFORE}
        commands = bool(motors) and name.partition("[")[0] == motors
        if commands:  # PX4 says by NaN that a motor is stopped
            fields = {key: np.nan_to_num(c) for key, c in fields.items() if key.startswith(("control[", "output["))}
            fields = {key: values for key, values in fields.items() if np.any(values)}
        stream = streams.taken(name, _clock(data, name in TOPIC_COLUMNS), fields, names, columns, keep=commands)
        if name == MOTOR_TOPICS[0] and stream.columns:
            stream = replace(stream, columns={**stream.columns, **demand.columns})
        readings.append(stream)
    if "vehicle_status" in topics:
        status = topics["vehicle_status"]
        armed = streams.arming(status["arming_state"] == ARMED_STATE)
        states = {"mode": streams.named(status["nav_state"], MODES, "mode {}"), "armed": armed}
        readings.append(streams.Stream("vehicle_status", _clock(status), states, lasting=True))
    holds = tuple(f"{name} ({len(data['timestamp'])})" for name, data in topics.items())
    return streams.Recording(readings, holds, (*demand.notes, *notes), demand.origin)


def _demand(topics: Topics, history: mixing.Parameters) -> tuple[mixing.Demand, Fields]:
    """What PX4 asked of the vehicle, by the motors; else its own setpoints, as fields to take by topic."""
    demand = mixing.Demand()
    if MOTOR_TOPICS[0] in topics:
        data = topics[MOTOR_TOPICS[0]]
        sent = {
            int(key[8:-1]): np.nan_to_num(np.asarray(values, dtype=np.float64))
            for key, values in data.items()
            if key.startswith("control[")
        }
        demand = mixing.worked_back(MOTOR_TOPICS[0], _clock(data), sent, history, _by_places)
    wished = {topic: fields for topic, fields in SETPOINTS.items() if topic in topics}
    if demand.columns or TORQUE not in wished:
        return demand, NO_FIELDS
    names = [name for fields in wished.values() for name in fields.values()]
    note = f"commands {mixing.meaning(names)} are {' and '.join(wished)}, before limits of the motors"
    return mixing.Demand(notes=(note,)), wished


def _by_places(source: str, sent: mixing.Channels, values: mixing.Values) -> mixing.Part:
    """How motors are read by their places, axes and thrust coefficients, as PX4 mixes them. Raises Unclear."""
    if "CA_ROTOR_COUNT" not in values:
        mixing.refuse_lacking(source, ["CA_ROTOR_COUNT"])
    rotors = [i for i in range(int(values["CA_ROTOR_COUNT"])) if i in sent]
    keys = [[f"CA_ROTOR{i}_{key}" for key in ("PX", "PY", "PZ", "AX", "AY", "AZ", "CT", "KM")] for i in rotors]
    mixing.refuse_lacking(source, [key for eight in keys for key in eight if key not in values])
    if not rotors:
        raise mixing.Unclear(f"PX4 mixes no motors by their places here (CA_ROTOR_COUNT is 0); {mixing.ELSE}")
    table = np.array([[values[key] for key in eight] for eight in keys])
    place, axis, coefficient, ratio = table[:, :3], table[:, 3:6], table[:, 6:7], table[:, 7:]
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    effect = np.hstack([coefficient * (np.cross(place, axis) - ratio * axis), coefficient * axis]).T
    mix = np.linalg.pinv(effect)
    scale = np.append(np.full(3, mix[:, 2].max()), np.full(3, np.linalg.norm(mix[:, 3:], axis=1).mean()))
    observable = np.abs(effect @ mix - np.eye(6)).max(axis=1) < mixing.WISH_ERROR
    ones, rows = np.ones(len(rotors)), [2, 3, 4, 5]
    how = "PX4's mixing of motors at their places (CA_ROTORn)"
    return mixing.Part(how, tuple(rotors), -ones, 0 * ones, ones, (scale[:, None] * effect)[rows], observable[rows])


def _parameters(log: Any) -> mixing.Parameters:
    """The parameters of the allocation: at the start of the log, and where they changed."""
    changes = [(log.start_timestamp, name, value) for name, value in log.initial_parameters.items()]
    changes += log.changed_parameters
    return [(time / 1e6, name, float(value)) for time, name, value in changes if name.startswith("CA_ROTOR")]


def _clock(data: Mapping[str, NDArray[Any]], sampled: bool = False) -> Floats:
    """Seconds since the vehicle started, shape (N,): when a sensor was read, if that is told, else when it was told."""
    stamps = data.get("timestamp_sample", data["timestamp"]) if sampled else data["timestamp"]
    return np.asarray(stamps if np.all(stamps > 0) else data["timestamp"], dtype=np.float64) / 1e6
