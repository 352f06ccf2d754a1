"""What log files are, and what a format makes of one: a `RawLog`.

To add a format, write one file here with a function `read(path, name, columns) -> RawLog` and
`FORMAT = Format("what people call it", (".suffix",), read)`, and name it in `FORMATS` of `find.py`. A file of several
streams, each on its own clock, becomes one table by `streams.on_one_clock`; a library that not everybody has is
imported within `read`, by `streams.needed`. `tests/helpers/reader_contract.py` picks the format up.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.pipeline.records import Document, Source

MOST_COLUMNS = 30_000
MOST_UNPACKED, MOST_TIMES = 64 << 20, 100  # bytes; times the file


@dataclass(frozen=True)
class LogFile:
    """One log: where it is, what results call it (never depends on the working directory), and whether it was
    named on the command line itself (then unreadable means refused) or found (then it is set aside). A table that is
    no file has its `content`, as a Parquet file would."""

    path: Path
    name: str
    named: bool
    content: bytes | None = field(default=None, repr=False)

    @property
    def source(self) -> Source:
        return self.path if self.content is None else Document(self.name, self.content)


@dataclass(frozen=True)
class Origin:
    """Where commands come from that no file holds: of which outputs and by which mixing they were made (`made_from`),
    or why these tell none (`why_not`, a sentence that goes on from `no yaw moment;`). Both empty: of neither.
    """

    made_from: str = ""
    why_not: str = ""


LOGGED = Origin()


@dataclass(frozen=True)
class RawLog:
    """A file as its format gives it: column names, one Arrow array each (shape (N,)), and row numbers for
    messages.

    An array is float64 (null where a value is missing), timestamp, or binary text for whatever is not a
    number. `decimal` is the character between whole and fraction in the text columns. `also` holds other names of
    columns (name -> column), `notes` what a person should know, `holds` the messages or topics of the file,
    `origin` where its commands come from, if they were worked back from what was sent to motors.
    """

    names: tuple[str, ...]
    arrays: tuple[pa.ChunkedArray, ...]
    rows: NDArray[np.int64]
    decimal: str = "."
    also: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    holds: tuple[str, ...] = ()
    origin: Origin = LOGGED

    def place(self, name: str) -> int | None:
        """Return the number of the column of this name, or other name; None for none."""
        name = name if name in self.names else self.also.get(name, name)
        return self.names.index(name) if name in self.names else None

    def is_numeric(self, index: int) -> bool:
        return bool(pa.types.is_floating(self.arrays[index].type))


@dataclass(frozen=True)
class Format:
    """One log format: `read(path, name, columns)` takes the name to use in messages and what the user says of the
    columns, and raises LogError.

    Where other programs use the suffixes too, `begins` are the bytes of which a file begins with one: a file found
    in a folder that begins otherwise is no log.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, str, ColumnMap], RawLog]
    begins: tuple[bytes, ...] = ()


def most_unpacked(path: Path) -> int:
    """Return the most bytes that a packed file may unpack to: what grows more is made to fill the memory."""
    return max(MOST_UNPACKED, MOST_TIMES * path.stat().st_size)


def too_well_packed(name: str) -> LogError:
    return LogError(f"{name}: unpacks to more than {MOST_TIMES} times its size, which no log does; check its content")


def too_many_columns(where: str, count: int) -> LogError:
    return LogError(f"{where}: found {count} columns, expected at most {MOST_COLUMNS}; check separators and line ends")


def refuse_empty(content: object, source: str, what: str) -> None:
    if not content:
        raise LogError(
            f"{source}: found no {what}, expected some from its extension; copy the file again, or rename it"
        )


def skipped(count: int, thing: str, why: str) -> tuple[str, ...]:
    """Return the note on what of a file was not read, none for nothing."""
    return (f"{count} {thing}{'s' * (count != 1)} skipped: {why}",) if count else ()
