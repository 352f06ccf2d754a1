"""PX4 logs (.ulg): heading of vehicle_attitude, vehicle_angular_velocity, motors, battery, mode and arming.

PX4's axes are north, east, down and forward, right, down, so that its signs are ours. Source: the ULog file format and
the message definitions of PX4-Autopilot.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog
from automarine_cli.logs.streams import Recording, Stream, on_one_clock, taken
from automarine_cli.logs.vehicles import arming, named, needed, unsound_is_refused, yaw_of
from automarine_cli.quantities import Floats

HEAD = b"ULog\x01\x12\x35"
TAKEN = {
    "vehicle_attitude": {"heading": "heading_rad"},
    "vehicle_angular_velocity": {"xyz[2]": "yaw_rate_rad_s"},
    "battery_status": {"voltage_v": "voltage_V"},
}
BEFORE = {"yawspeed": "yaw_rate_rad_s"}  # where older logs have the yaw rate, in vehicle_attitude
MOTORS = ("actuator_motors", "actuator_outputs")  # commands -1 to 1; in older logs what goes to the drivers [us]
MODES = {
    0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 10: "ACRO",
    12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD", 15: "STAB", 17: "AUTO_TAKEOFF", 18: "AUTO_LAND",
}  # fmt: skip
ARMED = 2  # arming_state
Topics = Mapping[str, Mapping[str, NDArray[Any]]]


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a PX4 log. Raises LogError for what is none, and where it holds no attitude."""
    library = needed("pyulog", "px4", name, "PX4 logs")
    with path.open("rb") as file, unsound_is_refused(name, "ULog"):
        if file.read(len(HEAD)) != HEAD:
            raise LogError(
                f"{name}: found no PX4 log (ULog), expected one from its extension; copy the file again, or rename it"
            )
        file.seek(0)
        log = library.ULog(file, None, True)
        topics = {
            f"{one.name}[{one.multi_id}]" if one.multi_id else one.name: one.data
            for one in log.data_list
            if "timestamp" in one.data and len(one.data["timestamp"])
        }
        found = _recording(topics, _notes(log), columns)
    return on_one_clock(found, columns, name)


FORMAT = Format("PX4 ULog", (".ulg",), read, begins=(HEAD,))


def _notes(log: Any) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    if log.dropouts:
        lengths = np.array([one.duration for one in log.dropouts], dtype=np.float64)
        many = "s" * (len(lengths) != 1)
        notes = (
            f"{len(lengths)} drop-out{many} of the logger of up to {lengths.max():g} ms, {lengths.sum():g} ms in all",
        )
    return (*notes, "damaged data were skipped") if log.file_corruption else notes


def _recording(topics: Topics, notes: tuple[str, ...], columns: ColumnMap) -> Recording:
    streams: list[Stream | None] = []
    motors = next((name for name in MOTORS if name in topics), "")
    for name, data in topics.items():
        fields = {key: np.asarray(values, dtype=np.float64) for key, values in data.items()}
        own = TAKEN.get(name, {})
        if name == "vehicle_attitude":
            w, x, y, z = (fields[f"q[{i}]"] for i in range(4))
            fields["heading"] = yaw_of(w, x, y, z) % (2 * np.pi)
            own = own if "vehicle_angular_velocity" in topics else own | BEFORE
        commands = bool(motors) and name.partition("[")[0] == motors
        if commands:
            fields = _commands(fields)
        streams.append(taken(name, _clock(data, name in TAKEN), fields, own, columns, keep=commands))
    if "vehicle_status" in topics:
        status = topics["vehicle_status"]
        mode, armed = named(status["nav_state"], MODES, "mode {}"), arming(status["arming_state"] == ARMED)
        streams.append(Stream("vehicle_status", _clock(status), {"mode": mode, "armed": armed}, lasting=True))
    holds = tuple(f"{name} ({len(data['timestamp'])})" for name, data in topics.items())
    return Recording([stream for stream in streams if stream is not None], "topics", holds, notes)


def _clock(data: Mapping[str, NDArray[Any]], sampled: bool = False) -> Floats:
    """Seconds since the vehicle started, shape (N,): when a sensor was read, if that is told, else when it was told."""
    stamps = data.get("timestamp_sample", data["timestamp"]) if sampled else data["timestamp"]
    return np.asarray(stamps if np.all(stamps > 0) else data["timestamp"], dtype=np.float64) / 1e6


def _commands(fields: Mapping[str, Floats]) -> dict[str, Floats]:
    """Commands of the motors that are there; PX4 says by NaN that a motor is stopped."""
    named = {key: values for key, values in fields.items() if key.startswith(("control[", "output["))}
    return {key: np.nan_to_num(values) for key, values in named.items() if np.any(np.nan_to_num(values))}
