"""The dive of `vehicle_logs` as BlueOS's recorder writes it: MCAP, MAVLink messages as JSON, and video beside it."""

import io
import json
from typing import Any

import numpy as np
from vehicle_logs import Dive

WORDS = "MAV_MODE_FLAG_SAFETY_ARMED | MAV_MODE_FLAG_CUSTOM_MODE_ENABLED"


def recorded(
    dive: Dive, without: tuple[str, ...] = (), start: float = 1.7e9, delay: float = 0.05, spelled: bool = True
) -> bytes:
    """An MCAP file of the dive; messages are recorded up to `delay` s late. Numbers that have names are `spelled` as
    mavlink-server does, or told as mavlink2rest does."""
    from mcap.writer import Writer

    rows = sorted(_messages(dive, spelled), key=lambda row: row[0])
    late = np.random.default_rng(1).uniform(0, delay, len(rows))
    late[:3] = 0
    out = io.BytesIO()
    writer = Writer(out, chunk_size=20_000)
    writer.start(profile="", library="mcap-rs")
    links: dict[str, int] = {}
    video = writer.register_channel("video/1/stream", "cdr", writer.register_schema("CompressedVideo", "ros2msg", b""))
    writer.add_message(video, round((start + 1) * 1e9), b"\x00\x01\x00\x00", round((start + 1) * 1e9))
    for (at, sender, name, fields), wait in zip(rows, late):
        topic = f"mavlink/{sender[0]}/{sender[1]}/{name}"
        if topic in without or name in without:
            continue
        header = {"system_id": sender[0], "component_id": sender[1], "sequence": 0}
        content = {"header": header, "message": {"type": name, **fields}} if "/" not in name else fields
        for one in (topic, "mavlink/out") if "/" not in name else (topic,):
            if one not in links:
                schema = writer.register_schema(one.replace("/", "."), "jsonschema", b'{"type": "object"}')
                links[one] = writer.register_channel(one, "json", schema)
            stamp = round((start + at + wait) * 1e9)
            writer.add_message(links[one], stamp, json.dumps(content).encode(), stamp)
    writer.finish()
    return out.getvalue()


def _messages(dive: Dive, spelled: bool) -> list[tuple[float, tuple[int, int], str, dict[str, Any]]]:
    vehicle, station, other = (1, 1), (255, 0), (2, 1)
    rows: list[tuple[float, tuple[int, int], str, dict[str, Any]]] = []
    for t, psi, rate in zip(dive.time, dive.heading, dive.rate):
        yaw = float(np.deg2rad((psi + 180) % 360 - 180))
        told = {"time_boot_ms": round(t * 1e3), "roll": 0.0, "yaw": yaw, "yawspeed": float(np.deg2rad(rate))}
        rows.append((t, vehicle, "ATTITUDE", told))
        if round(t * 10) % 5 == 0:
            rows.append((t, other, "ATTITUDE", told | {"yaw": 1.0}))
    for t, pulses in zip(dive.command_time, dive.pulses.tolist()):
        told = {
            "time_usec": round(t * 1e6) % 2**32,
            "port": 0,
            **{f"servo{n + 1}_raw": p for n, p in enumerate(pulses)},
        }
        rows.append((t, vehicle, "SERVO_OUTPUT_RAW", told))
    for t, volt in zip(dive.voltage_time, dive.voltage):
        rows.append((t, vehicle, "SYS_STATUS", {"voltage_battery": round(volt * 1e3), "load": 0}))
    for t, name, value in dive.parameters:
        told = {"param_id": name if spelled else [*name.ljust(16, "\0")], "param_value": value}
        rows.append((t, vehicle, "PARAM_VALUE", told | {"param_type": {"type": "MAV_PARAM_TYPE_REAL32"}}))
    for t, mode, armed in dive.states():
        bits = (WORDS if armed else WORDS.partition(" | ")[2]) if spelled else {"bits": 1 + 128 * armed}
        beat = {"custom_mode": mode, "mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "base_mode": bits}
        rows.append((t, vehicle, "HEARTBEAT", beat))
        rows.append((t, vehicle, "HEARTBEAT/mavtype", beat["mavtype"]))
        rows.append(
            (t, station, "HEARTBEAT", {"custom_mode": 0, "mavtype": {"type": "MAV_TYPE_GCS"}, "base_mode": bits})
        )
    for t in dive.time[::3]:
        rows.append((t, vehicle, "extra/range", {"distance": float(t), "beams": [1.0, 2.0, {"snr": float(t) / 2}]}))
    return rows
