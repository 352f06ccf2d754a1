"""Captures of Linux's candump -L (.log), decoded as those of `can`."""

import io
import re
from pathlib import Path

from automarine_cli.logs.can import Captured, decoded, frames_of
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, RawLog

LINE = re.compile(
    r"\(\d+\.\d+\) +\S+ +(?:[0-9A-F]{3}|[0-9A-F]{8})#(?:#[0-9A-F])?(?:R\d?|(?:[0-9A-F]{2})*)(?: [RT])?", re.I
)


def read(path: Path, name: str, columns: ColumnMap) -> RawLog:
    """Read a candump capture. Raises LogError as `can.read`."""
    return decoded(path, name, columns, _candump)


FORMAT = Format("candump", (".log",), read, begins=(b"(",))


def _candump(path: Path, name: str) -> tuple[Captured, tuple[str, ...]]:
    import can

    lines = [line.strip() for line in path.read_text("latin-1").splitlines() if line.strip()]
    good = [line for line in lines if LINE.fullmatch(line)]
    bad = len(lines) - len(good)
    captured, _ = frames_of(can.CanutilsLogReader(io.StringIO("\n".join(good))))
    return captured, (f"{bad} line{'s' * (bad != 1)} skipped: not a CAN frame",) if bad else ()
