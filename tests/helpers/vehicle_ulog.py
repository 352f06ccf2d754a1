"""The dive of `vehicle_logs` as a PX4 log, written by the file format's own description."""

import struct

import numpy as np
from numpy.typing import NDArray
from vehicle_logs import Dive

Floats = NDArray[np.float64]

TOPICS = {  # name: message id, fields, struct
    "vehicle_attitude": (0, "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;", "QQ4f"),
    "vehicle_angular_velocity": (1, "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", "QQ3f"),
    "actuator_motors": (2, "uint64_t timestamp;float[12] control;", "Q12f"),
    "battery_status": (3, "uint64_t timestamp;float voltage_v;", "Qf"),
    "vehicle_status": (4, "uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;", "QBB"),
    "vehicle_torque_setpoint": (6, "uint64_t timestamp;float[3] xyz;", "Q3f"),
    "vehicle_thrust_setpoint": (7, "uint64_t timestamp;float[3] xyz;", "Q3f"),
    "actuator_outputs": (5, "uint64_t timestamp;uint32_t noutputs;float[4] output;", "QI4f"),
}
STATES = {19: 0, 2: 1}  # ArduSub's MANUAL and ALT_HOLD -> PX4's MANUAL and ALTCTL


def ulog(
    dive: Dive,
    without: tuple[str, ...] = ("vehicle_torque_setpoint", "vehicle_thrust_setpoint"),
    dropouts: tuple[tuple[float, int], ...] = (),
    delay: float = 0.003,
    setpoints: Floats | None = None,
) -> bytes:
    """A PX4 log (.ulg); motors as -1 to 1 about 1500 us, NaN while disarmed. Drop-outs are (time, milliseconds).

    What a sensor says is told `delay` s after it was read. `setpoints` are yaw moment and three forces at the times of
    the commands, shape (4, commands).
    """
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + _message("B", bytes(40)))
    for _, name, value in dive.parameters:
        key = f"float {name}".encode()
        out += _message("P", struct.pack("<B", len(key)) + key + struct.pack("<f", value))
    named = {name: about for name, about in TOPICS.items() if name not in without}
    for name, (_, fields, _) in named.items():
        out += _message("F", f"{name}:{fields}".encode())
    for name, (number, _, _) in named.items():
        out += _message("A", struct.pack("<BH", 0, number) + name.encode())
    rows: list[tuple[float, str, tuple[object, ...]]] = []
    for t, psi, rate in zip(dive.time, dive.heading, dive.rate):
        half = np.deg2rad(psi) / 2
        read = round(t * 1e6)
        rows.append((t + delay, "vehicle_attitude", (read, np.cos(half), 0.0, 0.0, np.sin(half))))
        rows.append((t + delay, "vehicle_angular_velocity", (read, 0.0, 0.0, np.deg2rad(rate))))
    sent = (np.array([dive.port, dive.stbd]) - 1500) / 400 if dive.outputs is None else dive.outputs  # -1 to 1
    stopped = np.where(sent == 0, np.nan, sent).T
    unused = [np.nan] * (12 - len(sent))
    rows += [(t, "actuator_motors", (*motors, *unused)) for t, motors in zip(dive.command_time, stopped)]
    if setpoints is not None:
        for t, (yaw, *force) in zip(dive.command_time, setpoints.T):
            rows += [(t, "vehicle_torque_setpoint", (0.0, 0.0, yaw)), (t, "vehicle_thrust_setpoint", tuple(force))]
    for t, port, stbd in zip(dive.command_time, dive.port, dive.stbd):
        rows.append((t, "actuator_outputs", (2, port, stbd, 0.0, 0.0)))
    rows += [(t, "battery_status", (volt,)) for t, volt in zip(dive.voltage_time, dive.voltage)]
    for t, mode, armed in dive.states():
        rows.append((t, "vehicle_status", (STATES[mode], 2 if armed else 1)))
    rows += [(t, "dropout", (length,)) for t, length in dropouts]
    for t, name, values in sorted(rows, key=lambda row: row[0]):
        if name == "dropout":
            out += _message("O", struct.pack("<H", *values))
        elif name not in without:
            number, _, form = TOPICS[name]
            out += _message("D", struct.pack(f"<H{form}", number, round(t * 1e6), *values))
    return bytes(out)


def _message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content
