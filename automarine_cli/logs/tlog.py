"""MAVLink telemetry logs of a ground station (.tlog): ATTITUDE, SERVO_OUTPUT_RAW, SYS_STATUS, HEARTBEAT.

Each packet stands behind eight bytes of the ground station's clock, which holds the delays of the link: the vehicle's
own stamps are used where there are some. Only packets that serve are unpacked, by pymavlink. Source: MAVLink 1 and
2."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog, refuse_empty, skipped
from automarine_cli.logs.mixing import parameters, recorded
from automarine_cli.logs.streams import Recording, Stream, arming, mode_names, needed, on_one_clock, unsound_is_refused
from automarine_cli.quantities import Floats

STAMP_BYTES = 8  # bytes in front of each packet: microseconds since 1970, big-endian
HEADS = {0xFE: 6, 0xFD: 10}  # the first byte of MAVLink 1 and 2 -> bytes of the header
SIGNED, SIGNATURE = 0x01, 13
MAV_MODE_ARMED = 128
TAKEN = {
    "ATTITUDE": {"yaw": "heading_rad", "yawspeed": "yaw_rate_rad_s"},
    "SYS_STATUS": {"voltage_battery": "voltage_V"},
}
SERVOS = "SERVO_OUTPUT_RAW"
DEFAULT_MESSAGES = (*TAKEN, SERVOS, "HEARTBEAT", "PARAM_VALUE")  # messages that are looked at without being named
OWN_CLOCK = {"time_boot_ms": 1e3, "time_usec": 1e6}  # counts a second since the vehicle started
NO_VOLTAGE = 65535  # mV, says the protocol
COUNTER = 2**32 / 1e6  # s after which 32 bits of microseconds are full
CALENDAR = 1e8  # s; a larger stamp counts from 1970
RESTART_STEP_S = 1.0  # s by which the vehicle's clock steps back when it starts anew
Message = dict[str, NDArray[Any]]


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a telemetry log. Raises LogError for what is none, and where it holds no attitude."""
    dialect = needed("pymavlink.dialects.v20.ardupilotmega", "ardupilot", name, "MAVLink logs")
    with unsound_is_refused(name, "telemetry"):
        messages, counted, bad = _messages(path.read_bytes(), columns.sources, dialect)
        refuse_empty(counted, name, "MAVLink packets")
        notes = skipped(bad, "packet", "wrong checksum")
        holds = [f"{kind} ({count})" for kind, count in counted.items()]
        return on_one_clock(recording(messages, columns, holds, notes), columns, name)


FORMAT = Format("MAVLink telemetry", (".tlog",), read)


def serves(kind: str, sources: Iterable[str]) -> bool:
    """Whether messages of this kind are looked at: always, or as a column map names a field of theirs."""
    return kind in DEFAULT_MESSAGES or any(source.startswith(f"{kind}.") for source in sources)


def _messages(data: bytes, sources: Iterable[str], dialect: Any) -> tuple[dict[str, Message], Counter[str], int]:
    """Fields of messages that serve, `received` [s] by the station's clock; counts of all kinds, and of damaged."""
    decode, kinds = dialect.MAVLink(None).decode, dialect.mavlink_map
    serving = {number for number, kind in kinds.items() if serves(kind.msgname, sources)}
    rows: dict[int, list[tuple[float, Any]]] = {}
    counted, bad = Counter[int](), 0
    for at, after, number in _packets(data):
        counted[number] += 1
        if number in serving:
            try:
                message = decode(bytearray(data[at + STAMP_BYTES : after]))
            except dialect.MAVError:
                bad += 1
                continue
            rows.setdefault(number, []).append((int.from_bytes(data[at : at + STAMP_BYTES], "big") / 1e6, message))
    messages = {kinds[number].msgname: _fields(kinds[number].fieldnames, part) for number, part in rows.items()}
    by_name = Counter({kinds[number].msgname: count for number, count in counted.items() if number in kinds})
    return of_the_vehicle(messages), by_name, bad


def _packets(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Where each packet's stamp begins, where the packet ends, and the number of its message."""
    at, end = 0, len(data)
    while at + STAMP_BYTES + 8 <= end:
        head = HEADS.get(data[at + STAMP_BYTES])
        if head is None or at + STAMP_BYTES + head > end:
            at += 1
            continue
        packet = at + STAMP_BYTES
        number = data[packet + 5] if head == 6 else int.from_bytes(data[packet + 7 : packet + 10], "little")
        signature = SIGNATURE if head == 10 and data[packet + 2] & SIGNED else 0
        after = packet + head + data[packet + 1] + 2 + signature
        if after > end or (after + STAMP_BYTES < end and data[after + STAMP_BYTES] not in HEADS):
            at += 1  # no packet follows: this was none, or the next is damaged
            continue
        yield at, after, number
        at = after


def _fields(names: Iterable[str], rows: list[tuple[float, Any]]) -> Message:
    """The numbers and words of one kind of message, with when it was received [s] and who sent it."""
    senders = [(message.get_srcSystem() << 8) + message.get_srcComponent() for _, message in rows]
    fields: Message = {"received": np.array([received for received, _ in rows]), "sender": np.array(senders)}
    for name in names:
        values = np.array([getattr(message, name) for _, message in rows])
        if values.ndim == 1:  # an array of numbers is not looked at
            fields[name] = values if values.dtype.kind == "U" else values.astype(np.float64)
    return fields


def of_the_vehicle(messages: dict[str, Message]) -> dict[str, Message]:
    """Only what the sender of most attitudes says: the ground station and other vehicles talk too."""
    senders = messages["ATTITUDE"]["sender"] if "ATTITUDE" in messages else np.concatenate(
        [message["sender"] for message in messages.values()] or [np.zeros(1, np.int64)]
    )  # fmt: skip
    who = np.bincount(senders).argmax()
    chosen = {name: message["sender"] == who for name, message in messages.items()}
    return {
        name: {key: values[chosen[name]] for key, values in message.items() if key != "sender"}
        for name, message in messages.items()
        if chosen[name].any()
    }


def recording(
    messages: Mapping[str, Message], columns: ColumnMap, holds: Sequence[str], notes: tuple[str, ...]
) -> Recording:
    """What a vehicle's messages hold: by name, with when each was `received` [s], in whatever file they are."""
    starts, values, states = _starts(messages), messages.get("PARAM_VALUE"), []
    history = parameters(values["param_id"], values["received"], values["param_value"]) if values else ()
    if "SYS_STATUS" in messages:
        volts = messages["SYS_STATUS"]["voltage_battery"]
        supply = {**messages["SYS_STATUS"], "voltage_battery": np.where(volts == NO_VOLTAGE, np.nan, volts / 1e3)}
        messages = {**messages, "SYS_STATUS": supply}
    if "HEARTBEAT" in messages:
        beat = messages["HEARTBEAT"]
        state = {
            "mode": mode_names(beat["custom_mode"], int(np.median(beat["type"]))),
            "armed": arming(beat["base_mode"].astype(int) & MAV_MODE_ARMED > 0),
        }
        states.append(Stream("HEARTBEAT", beat["received"], state, lasting=True))
    stamps = {*OWN_CLOCK, "received"}
    return recorded(messages, partial(_clock, starts), stamps, TAKEN, SERVOS, history, columns, states, holds, notes)


def _starts(messages: Mapping[str, Message]) -> tuple[Floats, Floats]:
    """When each start of the vehicle was first heard of, and when it was, on the station's clock [s]."""
    message = messages.get("ATTITUDE", {})
    if "time_boot_ms" not in message:
        return np.zeros(0), np.zeros(0)
    boot, received = message["time_boot_ms"] / 1e3, message["received"]
    first = np.concatenate([[0], np.flatnonzero(np.diff(boot) < -RESTART_STEP_S) + 1])
    return received[first], np.minimum.reduceat(received - boot, first)


def _clock(starts: tuple[Floats, Floats], message: Mapping[str, NDArray[Any]]) -> Floats:
    """Seconds since 1970, shape (N,), by the vehicle's stamps where there are some."""
    heard, started = starts
    stamps = next((message[key] / rate for key, rate in OWN_CLOCK.items() if key in message), None)
    if stamps is None or not len(started) or stamps.max() > CALENDAR:
        return message["received"]
    start = started[np.maximum(np.searchsorted(heard, message["received"], side="right") - 1, 0)]
    turns = np.round((message["received"] - start - stamps) / COUNTER)  # a counter of microseconds begins anew
    return start + stamps + COUNTER * turns
