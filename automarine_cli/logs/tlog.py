"""MAVLink telemetry logs of a ground station (.tlog): ATTITUDE, SERVO_OUTPUT_RAW, SYS_STATUS, HEARTBEAT.

Each packet stands behind eight bytes of the ground station's clock. The vehicle's own stamps are kept where a message
has them: the station's hold the delays of the link. All messages of one kind are unpacked, and their checksums
looked at, at once. Source: MAVLink 1 and 2, packet serialisation; CRC-16/MCRF4XX.
"""

import re
from collections.abc import Mapping
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

STAMP = 8  # bytes in front of each packet: microseconds since 1970, big-endian
HEADS = {0xFE: 6, 0xFD: 10}  # the first byte of MAVLink 1 and 2 -> bytes of the header
SIGNED, SIGNATURE = 0x01, 13
MAV_MODE_ARMED = 128
TAKEN = {
    "ATTITUDE": {"yaw": "heading_rad", "yawspeed": "yaw_rate_rad_s"},
    "SYS_STATUS": {"voltage_battery": "voltage_V"},
}
SERVOS = "SERVO_OUTPUT_RAW"
OWN_CLOCK = {"time_boot_ms": 1e3, "time_usec": 1e6}  # counts a second since the vehicle started
NO_VOLTAGE = 65535  # mV, says the protocol
COUNTER = 2**32 / 1e6  # s after which 32 bits of microseconds are full
CALENDAR = 1e8  # s; a larger stamp counts from 1970
RESTARTED = 1.0  # s by which the vehicle's clock steps back when it starts anew
Message = dict[str, NDArray[Any]]


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a telemetry log. Raises LogError for what is none, and where it holds no attitude."""
    known = needed("pymavlink.dialects.v20.ardupilotmega", "ardupilot", name, "MAVLink logs").mavlink_map
    with unsound_is_refused(name, "telemetry"):
        messages, bad = _messages(path.read_bytes(), known)
        refuse_empty(messages, name, "MAVLink packets")
        notes = skipped(bad, "packet", "wrong checksum")
        return on_one_clock(recording(messages, columns, notes), columns, name)


FORMAT = Format("MAVLink telemetry", (".tlog",), read)


def _messages(data: bytes, known: Mapping[int, Any]) -> tuple[dict[str, Message], int]:
    """Fields of the vehicle's messages by name, with the station's clock as `received` [s]; how many are damaged."""
    places = _indexed(data, known)
    content = np.frombuffer(data + bytes(300), dtype=np.uint8)  # a short payload ends in zeros that are not sent
    messages, bad = {}, 0
    for number, starts in sorted(places.items()):
        kind = known[number]
        packets = _Packets(content, np.array(starts))
        good = packets.sound(kind.crc_extra)
        bad += len(starts) - int(np.count_nonzero(good))
        if good.any():
            messages[kind.msgname] = _Packets(content, packets.at[good]).fields(kind)
    return of_the_vehicle(messages), bad


def _indexed(data: bytes, known: Mapping[int, Any]) -> dict[int, list[int]]:
    places: dict[int, list[int]] = {}
    at, end = 0, len(data)
    while at + STAMP + 8 <= end:
        head = HEADS.get(data[at + STAMP])
        if head is None or at + STAMP + head > end:
            at += 1
            continue
        packet = at + STAMP
        number = data[packet + 5] if head == 6 else int.from_bytes(data[packet + 7 : packet + 10], "little")
        length = head + data[packet + 1] + 2
        if head == 10 and data[packet + 2] & SIGNED:
            length += SIGNATURE
        after = packet + length
        if after > end or (after + STAMP < end and data[after + STAMP] not in HEADS):
            at += 1  # no packet follows: this was none, or the next is damaged
            continue
        if number in known:
            places.setdefault(number, []).append(at)
        at = after
    return places


class _Packets:
    """Packets of one kind: `whole` are the bytes of the file, `at` where the stamps begin, shape (N,)."""

    def __init__(self, whole: NDArray[np.uint8], at: NDArray[np.int64]) -> None:
        self.whole, self.at = whole, at
        self.head = np.where(whole[at + STAMP] == 0xFD, 10, 6)
        self.length = whole[at + STAMP + 1].astype(np.int64)

    def _bytes(self, start: NDArray[np.int64], count: int) -> NDArray[np.uint8]:
        return self.whole[np.minimum((self.at + start)[:, None] + np.arange(count), len(self.whole) - 1)]

    def sound(self, extra: int) -> NDArray[np.bool_]:
        """Whether the checksum is right, shape (N,): over all but the first byte, then the kind's own byte."""
        size = self.head - 1 + self.length
        content = self._bytes(np.full(len(self.at), STAMP + 1), int(size.max()) + 1)
        content[np.arange(len(size)), size] = extra
        crc = np.full(len(size), 0xFFFF, dtype=np.uint16)
        for i in range(content.shape[1]):
            byte = content[:, i] ^ (crc & 0xFF).astype(np.uint8)
            byte ^= byte << 4
            wide = byte.astype(np.uint16)
            crc = np.where(i <= size, (crc >> 8) ^ (wide << 8) ^ (wide << 3) ^ (wide >> 4), crc)
        written = self._bytes(STAMP + self.head + self.length, 2).astype(np.uint16)
        return crc == written[:, 0] | written[:, 1] << 8

    def fields(self, kind: Any) -> Message:
        types = re.findall(r"(\d*)(\D)", kind.unpacker.format[1:])  # I16sB: I, 16s, B
        layout = np.dtype([(key, _type(*parts)) for key, parts in zip(kind.ordered_fieldnames, types)])
        content = self._bytes(STAMP + self.head, layout.itemsize)
        content[np.arange(layout.itemsize) >= self.length[:, None]] = 0
        table = np.ascontiguousarray(content).view(layout)[:, 0]
        stamps = np.ascontiguousarray(self._bytes(np.zeros(len(self.at), np.int64), STAMP)).view(">u8")[:, 0]
        sender = self.whole[self.at + STAMP + np.where(self.head == 10, 5, 3)].astype(np.int64) << 8
        component = self.whole[self.at + STAMP + np.where(self.head == 10, 6, 4)]
        columns = {
            key: np.char.decode(table[key], "latin-1") if layout[key].kind == "S" else table[key].astype(np.float64)
            for key in kind.ordered_fieldnames
            if layout[key].kind in "iufS"
        }
        return {"received": stamps / 1e6, "sender": sender + component, **columns}


def _type(count: str, character: str) -> str:
    """The numpy type of a field; an array of numbers counts as bytes, which are not looked at."""
    if count:
        return f"S{count}" if character == "s" else f"V{int(count) * np.dtype(character).itemsize}"
    return f"<{np.dtype(character).str[1:]}"


def of_the_vehicle(found: dict[str, Message]) -> dict[str, Message]:
    """Only what the sender of most attitudes says: the ground station and other vehicles talk too."""
    senders = found["ATTITUDE"]["sender"] if "ATTITUDE" in found else np.concatenate(
        [message["sender"] for message in found.values()] or [np.zeros(1, np.int64)]
    )  # fmt: skip
    who = np.bincount(senders).argmax()
    chosen = {name: message["sender"] == who for name, message in found.items()}
    return {
        name: {key: values[chosen[name]] for key, values in message.items() if key != "sender"}
        for name, message in found.items()
        if chosen[name].any()
    }


def recording(messages: Mapping[str, Message], columns: ColumnMap, notes: tuple[str, ...]) -> Recording:
    """What a vehicle's messages hold: by name, with when each was `received` [s], in whatever file they are."""
    starts, values, states = _starts(messages), messages.get("PARAM_VALUE"), []
    known = parameters(values["param_id"], values["received"], values["param_value"]) if values else {}
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
    return recorded(messages, partial(_clock, starts), stamps, TAKEN, SERVOS, known, columns, states, notes)


def _starts(messages: Mapping[str, Message]) -> tuple[Floats, Floats]:
    """When on the station's clock each start of the vehicle was first heard of [s], and when it was [s], as the packet
    tells that was quickest on its way."""
    message = messages.get("ATTITUDE", {})
    if "time_boot_ms" not in message:
        return np.zeros(0), np.zeros(0)
    boot, received = message["time_boot_ms"] / 1e3, message["received"]
    first = np.concatenate([[0], np.flatnonzero(np.diff(boot) < -RESTARTED) + 1])
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
