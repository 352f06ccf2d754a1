"""The dive of `vehicle_logs` on a CAN bus: a DBC, and captures by the writers of python-can (SLCAN by our own)."""

import tempfile
from pathlib import Path
from typing import Any

from vehicle_logs import Dive

DBC = Path(__file__).with_name("vehicle.dbc")
COLUMNS = """
heading_deg = "Compass.Heading"
yaw_rate_deg_s = "Compass.YawRate"
n_port = { from = "Thrusters.Port", scale = 0.0025, offset = -3.75 }
n_stbd = { from = "Thrusters.Stbd", scale = 0.0025, offset = -3.75 }
voltage_V = "Battery.Volt"
mode = "State.Mode"
armed = "State.Armed"
"""


def frames(dive: Dive, without: tuple[str, ...] = ()) -> list[tuple[float, Any, bytes]]:
    """Time, message and data of every frame, by cantools."""
    import cantools

    bus = cantools.database.load_file(DBC)
    rows: list[tuple[float, str, dict[str, Any]]] = []
    for t, psi, rate in zip(dive.time, dive.heading, dive.rate):
        rows.append((t, "Compass", {"Heading": round(psi % 360, 2) % 360, "YawRate": rate}))
    for t, port, stbd in zip(dive.command_time, dive.port, dive.stbd):
        rows.append((t, "Thrusters", {"Port": port, "Stbd": stbd, "Depth": -0.5}))
    for t, volt in zip(dive.voltage_time, dive.voltage):
        rows += [(t, "Battery", {"Which": 0, "Volt": volt}), (t, "Battery", {"Which": 1, "Amps": -3.0})]
    for t, mode, armed in dive.states():
        rows.append((t, "State", {"Mode": mode, "Armed": int(armed)}))
    rows = [row for row in rows if row[1] not in without]
    messages = {one.name: one for one in bus.messages}
    return [(t, messages[name], messages[name].encode(values)) for t, name, values in sorted(rows, key=lambda r: r[0])]


def capture(suffix: str, dive: Dive, without: tuple[str, ...] = ()) -> bytes:
    """A capture of the dive; a frame that no DBC tells of stands among the others."""
    sent = frames(dive, without)
    if suffix == ".slcan":
        return slcan(sent)
    import can

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"made{suffix}"
        writers = {".asc": can.ASCWriter, ".blf": can.BLFWriter, ".log": can.CanutilsLogWriter}
        with writers[suffix](path) as writer:
            for at, message, data in sent:
                extended = message.is_extended_frame
                writer.on_message_received(
                    can.Message(at, message.frame_id, is_extended_id=extended, data=data, channel=0, is_rx=True)
                )
        return path.read_bytes()


def slcan(sent: list[tuple[float, Any, bytes]], host: float | None = None, clock: bool = True) -> bytes:
    """What a converter sends, with its clock of one minute; `host` [s] is where times in front begin."""
    out = []
    for at, message, data in sent:
        name = f"T{message.frame_id:08X}" if message.is_extended_frame else f"t{message.frame_id:03X}"
        stamp = f"{round(at * 1e3) % 60000:04X}" if clock else ""
        front = f"{at + host + 0.003:.6f} " if host is not None else ""
        out.append(f"{front}{name}{len(data)}{data.hex().upper()}{stamp}")
    return ("\r".join([*out, ""])).encode()
