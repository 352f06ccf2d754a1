"""The dive of `vehicle_logs` as BlueOS's recorder writes it: MCAP, MAVLink messages as JSON, and video beside it."""

import io
import json
from typing import Any

import numpy as np
from vehicle_logs import Dive, mavlink_of

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
    """Time, sender, name and fields: those of the telemetry, what has a name as the recorder writes it."""
    rows: list[tuple[float, tuple[int, int], str, dict[str, Any]]] = []
    for t, link, message in mavlink_of(dive):
        fields, who = message.to_dict(), (link.srcSystem, link.srcComponent)
        name = fields.pop("mavpackettype")
        if name == "HEARTBEAT":
            kind = {"type": "MAV_TYPE_SUBMARINE" if fields.pop("type") == 12 else "MAV_TYPE_GCS"}
            bits = WORDS if fields["base_mode"] >= 128 else WORDS.partition(" | ")[2]
            fields |= {"mavtype": kind, "base_mode": bits if spelled else {"bits": fields["base_mode"]}}
            rows.append((t, who, "HEARTBEAT/mavtype", kind))
        elif name == "PARAM_VALUE":
            fields["param_type"] = {"type": "MAV_PARAM_TYPE_REAL32"}
            fields["param_id"] = fields["param_id"] if spelled else [*fields["param_id"].ljust(16, "\0")]
        rows.append((t, who, name, fields))
    for t in dive.time[::3]:
        rows.append((t, (1, 1), "extra/range", {"distance": float(t), "beams": [1.0, 2.0, {"snr": float(t) / 2}]}))
    return rows
