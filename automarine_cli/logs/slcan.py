"""SLCAN captures (.slcan): the text that a CAN-to-serial converter sends, one frame a line.

`t12380011223344556677ABCD` is a frame of identifier 0x123 with 8 bytes and, after them, the converter's clock in
milliseconds, which begins anew every minute (switched on by its command Z1). A capture may have the time of its
arrival in seconds in front of each line. A serial line of 138.24 kbit/s needs 1.9 ms for such a line, and lines wait
for one another: the converter's own clock is used where there is one. Source: the LAWICEL protocol.
"""

import re

import numpy as np

from automarine_cli.errors import LogError
from automarine_cli.quantities import Floats

LINE = re.compile(rb"\s*(?:\(?(\d+\.\d+)\)?[\s,]+)?(?:t([0-9A-Fa-f]{3})|T([0-9A-Fa-f]{8}))([0-8])([0-9A-Fa-f]*)\s*")
FRAME = re.compile(rb"(?:^|[\s,])[tT][0-9A-Fa-f]{4}")
STAMP = "ABCD"  # four digits
MINUTE = 60.0  # s after which the converter's clock begins anew


def read_slcan(content: bytes, source: str) -> tuple[Floats, list[tuple[int, bool]], list[bytes], int]:
    """Times [s], (identifier, extended) and data of each frame; how many lines that look like frames are none.

    Raises LogError where the frames have no time.
    """
    arrived: list[float] = []
    clock: list[float] = []
    names: list[tuple[int, bool]] = []
    frames: list[bytes] = []
    bad = 0
    for line in re.split(rb"[\r\n\a]+", content):
        match = LINE.fullmatch(line)
        whole = 2 * int(match[4]) if match else 0
        if match is None or len(match[5]) not in (whole, whole + len(STAMP)):
            bad += FRAME.search(line) is not None
            continue
        data, stamp = match[5][:whole], match[5][whole:]
        arrived.append(float(match[1]) if match[1] else np.nan)
        clock.append(int(stamp, 16) / 1e3 if stamp else np.nan)
        names.append((int(match[2] or match[3], 16), match[2] is None))
        frames.append(bytes.fromhex(data.decode()))
    return _time(np.array(arrived), np.array(clock), source), names, frames, bad


def _time(arrived: Floats, clock: Floats, source: str) -> Floats:
    """Seconds of each frame, rising over the minutes."""
    if not len(clock):
        return clock
    if np.isnan(clock).any():
        if np.isnan(arrived).any():
            raise LogError(
                f"{source}: the frames have no time; let the converter add it (command Z1), or write the time of "
                "arrival in seconds in front of each line"
            )
        return arrived
    if np.isnan(arrived).any():
        return clock + MINUTE * np.concatenate([[0], np.cumsum(np.diff(clock) < 0)])
    passed = (arrived - arrived[0]) - (clock - clock[0])
    return arrived[0] + clock - clock[0] + MINUTE * np.round(passed / MINUTE)
