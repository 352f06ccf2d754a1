"""Logs of vehicles as their own software writes them, made of one known truth: the writers of the format tests."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Dive:
    """What a vehicle does: heading at 10 Hz turning clockwise through north, commands at 4 Hz, voltage at 2 Hz.

    `time` [s], `heading` [deg, unwrapped], `rate` [deg/s]; commands are PWM [us] of two thrusters. Modes and arming
    are (time, state). `outputs` are pulses [us] of eight outputs in place of the two, shape (8, commands), and
    `parameters` are (time, name, value).
    """

    time: Floats
    heading: Floats
    rate: Floats
    command_time: Floats
    port: Floats
    stbd: Floats
    voltage_time: Floats
    voltage: Floats
    modes: tuple[tuple[float, int], ...] = ((0.5, 19), (12.0, 2))
    arming: tuple[tuple[float, bool], ...] = ((0.5, False), (2.0, True), (18.0, False))
    outputs: Floats | None = None
    parameters: tuple[tuple[float, str, float], ...] = ()

    @property
    def pulses(self) -> Floats:
        """What is sent to eight outputs, shape (commands, 8); 0 where nothing is connected."""
        none = np.zeros((5, len(self.port)))
        two = np.vstack([self.port, self.stbd, np.full(len(self.port), 1500.0), none])
        return (two if self.outputs is None else self.outputs).T.astype(int)

    def states(self) -> Iterator[tuple[float, int, bool]]:
        """Time, mode and arming, twice a second."""
        for t in np.arange(self.modes[0][0], self.time[-1], 0.5) if self.modes else ():
            yield t, *([state for since, state in told if since <= t][-1] for told in (self.modes, self.arming))

    def commands_at(self, time: Floats) -> tuple[Floats, Floats]:
        """What the two commands are at the given times: the last one sent."""
        place = np.searchsorted(self.command_time, time, side="right") - 1
        return self.port[place], self.stbd[place]


def dive(mirrored: bool = False) -> Dive:
    """Twenty seconds: rest, a turn to the right from 350 degrees on, rest (mirrored: to the left)."""
    sign = -1.0 if mirrored else 1.0
    time = 1.0 + np.arange(200) / 10
    rate = np.where((time > 4.96) & (time < 14.96), 15.0, 0.0)
    heading = 350.0 + np.cumsum(rate) / 10
    commands = 0.92 + np.arange(82) / 4
    on = np.where((commands > 4.8) & (commands < 14.8), 100.0, 0.0)
    voltage = 0.73 + np.arange(42) / 2
    return Dive(
        time, 350 + sign * (heading - 350), sign * rate, commands, 1500 + sign * on, 1500 - sign * on,
        voltage, 16.0 - 0.01 * np.arange(42),
    )  # fmt: skip


FORMATS = {  # name: type, characters, columns
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "ATT": (10, "QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "RATE": (11, "Qfff", "TimeUS,YDes,Y,YOut"),
    "RCOU": (12, "QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
    "BAT": (13, "QBff", "TimeUS,Instance,Volt,Curr"),
    "MODE": (14, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ARM": (15, "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
    "MSG": (16, "QZ", "TimeUS,Message"),
    "EV": (17, "QB", "TimeUS,Id"),
    "PARM": (20, "QNf", "TimeUS,Name,Value"),
    "IMU": (18, "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
}
CODES = dict(zip("QcCfHBMIZnN", ("Q", "h", "H", "f", "H", "B", "b", "I", "64s", "4s", "16s")))


def dataflash(dive: Dive, without: tuple[str, ...] = ("EV", "IMU")) -> bytes:
    """An ArduSub dataflash log (.bin): its FMT messages, then everything in the order of time."""
    out = bytearray()
    for name, (kind, form, columns) in FORMATS.items():
        if name not in without:
            length = 3 + struct.calcsize("<" + "".join(CODES[c] for c in form))
            out += _message("FMT", kind, length, name.encode(), form.encode(), columns.encode())
    rows: list[tuple[float, str, tuple[object, ...]]] = [(0.1, "MSG", (b"ArduSub V4.1.0 (4ad3a7de)",))]
    for t, psi, rate in zip(dive.time, dive.heading, dive.rate):
        rows.append((t, "ATT", (0, 0, 0, 0, 0, round(psi % 360 * 100) % 36000, 0, 0)))
        rows.append((t - 0.02, "RATE", (0.0, rate, 0.0)))
        rows += [(t - 0.02, "IMU", (i, 0.0, 0.0, np.deg2rad(rate) + i)) for i in (0, 1)]
    rows += [(t, "RCOU", tuple(pulses)) for t, pulses in zip(dive.command_time, dive.pulses.tolist())]
    rows += [(t, "PARM", (name.encode(), value)) for t, name, value in dive.parameters]
    for t, volt in zip(dive.voltage_time, dive.voltage):
        rows += [(t, "BAT", (0, volt, 3.0)), (t, "BAT", (1, 5.0, 0.1))]
    rows += [(t, "MODE", (mode, mode, 1)) for t, mode in dive.modes]
    rows += [(t, "ARM", (int(armed), 0, 0, 0)) for t, armed in dive.arming]
    rows += [(t, "EV", (10 if armed else 11,)) for t, armed in dive.arming]
    for t, name, values in sorted(rows, key=lambda row: row[0]):
        if name not in without:
            out += _message(name, round(t * 1e6), *values)
    return bytes(out)


def _message(name: str, *values: object) -> bytes:
    kind, form, _ = FORMATS[name]
    return b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(CODES[c] for c in form), *values)


def mavlink_of(dive: Dive) -> list[tuple[float, Any, Any]]:
    """Time, sender and message of all that is said on the link, in the order of time, by pymavlink.

    The ground station itself and a second vehicle talk in between.
    """
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    vehicle, station, other = (mavlink.MAVLink(None, srcSystem=system, srcComponent=1) for system in (1, 255, 2))
    rows: list[tuple[float, Any, Any]] = []
    for t, psi, rate in zip(dive.time, dive.heading, dive.rate):
        yaw = float(np.deg2rad((psi + 180) % 360 - 180))
        attitude = mavlink.MAVLink_attitude_message(round(t * 1e3), 0, 0, yaw, 0, 0, float(np.deg2rad(rate)))
        rows.append((t, vehicle, attitude))
        if round(t * 10) % 5 == 0:
            rows.append((t, other, mavlink.MAVLink_attitude_message(round(t * 1e3), 0, 0, 1.0, 0, 0, 0)))
    for t, name, value in dive.parameters:
        rows.append((t, vehicle, mavlink.MAVLink_param_value_message(name.encode(), value, 9, 500, 1)))
    for t, servos in zip(dive.command_time, dive.pulses.tolist()):
        rows.append((t, vehicle, mavlink.MAVLink_servo_output_raw_message(round(t * 1e6) % 2**32, 0, *servos)))
    for t, volt in zip(dive.voltage_time, dive.voltage):
        status = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, round(volt * 1e3), -1, -1, 0, 0, 0, 0, 0, 0)
        rows.append((t, vehicle, status))
    for t, mode, armed in dive.states():
        rows.append((t, vehicle, mavlink.MAVLink_heartbeat_message(12, 3, 1 + 128 * armed, mode, 4, 3)))
        rows.append((t, station, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    return sorted(rows, key=lambda row: row[0])


def telemetry(dive: Dive, without: tuple[str, ...] = (), start: float = 1.7e9, delay: float = 0.05) -> bytes:
    """The telemetry log (.tlog) that a ground station keeps of it; packets come up to `delay` s late."""
    rows, out = mavlink_of(dive), bytearray()
    late = np.random.default_rng(1).uniform(0, delay, len(rows))
    late[:3] = 0
    for (t, sender, message), wait in zip(rows, late):
        if message.get_type() not in without:
            out += struct.pack(">Q", round((start + t + wait) * 1e6)) + message.pack(sender)
    return bytes(out)
