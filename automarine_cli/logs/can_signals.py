"""Signals of CAN frames by the description of a DBC: all frames of one message at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.logs.table import Floats

Bits = NDArray[np.uint8]


def bits_of(frames: list[bytes], length: int) -> Bits:
    """The bits of frames of at least `length` bytes, shape (N, 8 length): bit i of byte b at 8 b + i, lowest first."""
    data = np.frombuffer(b"".join(frame[:length] for frame in frames), dtype=np.uint8)
    return np.unpackbits(data.reshape(len(frames), length), axis=1, bitorder="little")


def places_of(signal: Any) -> NDArray[np.int64]:
    """Where the bits of a signal are, the lowest first.

    Intel's signals (little-endian) run upwards from their start; Motorola's (big-endian) begin with their highest bit,
    run down to the end of the byte and go on at the top of the next.
    """
    if signal.byte_order == "little_endian":
        return signal.start + np.arange(signal.length)
    byte, bit = divmod(signal.start, 8)
    upwards = 8 * byte + 7 - bit + np.arange(signal.length)  # counted with the highest bit of each byte first
    return (8 * (upwards // 8) + 7 - upwards % 8)[::-1]


def raw_of(bits: Bits, signal: Any) -> NDArray[Any]:
    """The numbers that a signal holds in each frame, before scale and offset, shape (N,): integers or floats."""
    weights = np.uint64(1) << np.arange(signal.length, dtype=np.uint64)
    whole = (bits[:, places_of(signal)].astype(np.uint64) * weights).sum(axis=1, dtype=np.uint64)
    if signal.is_float:
        size = signal.length // 8
        return whole.astype(f"<u{size}").view(f"<f{size}")
    if not signal.is_signed:
        return whole
    up = np.uint64(64 - signal.length)  # the sign is carried down from the top
    return (whole << up).view(np.int64) >> up.astype(np.int64)


def values_of(bits: Bits, signal: Any) -> Floats:
    """Physical values of a signal, shape (N,), in its own unit."""
    return raw_of(bits, signal).astype(np.float64) * float(signal.scale) + float(signal.offset)


def words_of(bits: Bits, signal: Any) -> NDArray[np.str_]:
    """The words that a DBC gives to the values of a signal, shape (N,); a value without one stays a number."""
    codes, at = np.unique(raw_of(bits, signal), return_inverse=True)
    known = {} if signal.choices is None else signal.choices
    return np.array([str(known.get(int(code), int(code))) for code in codes], dtype=str)[at]
