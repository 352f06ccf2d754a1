"""What log files are, and the registry of their formats: every `Format` in a module of this folder is one.

To add a format, write one file here with a function `read(path, name, columns) -> RawLog` and
`FORMAT = Format("what people call it", (".suffix",), read)`; nothing else is needed. A file of several streams,
each on its own clock, becomes one table by `streams.on_one_clock`; a library that not everybody has is imported
within `read`, by `streams.needed`. `tests/helpers/reader_contract.py` picks the format up.
"""

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

import automarine_cli.logs as folder
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
        """What its bytes are read from."""
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
    """The most bytes that a packed file may unpack to: what grows more is made to fill the memory."""
    return max(MOST_UNPACKED, MOST_TIMES * path.stat().st_size)


def too_well_packed(name: str) -> str:
    """The sentence for a file that would unpack to more."""
    return f"{name}: unpacks to more than {MOST_TIMES} times its size, which no log does; check its content"


def too_many_columns(where: str, count: int) -> str:
    """The sentence for a table that is wider than any log."""
    return f"{where}: found {count} columns, expected at most {MOST_COLUMNS}; check separators and line ends"


@cache
def formats() -> tuple[Format, ...]:
    """All formats, in the name order of their modules."""
    modules = sorted(module.name for module in pkgutil.iter_modules(folder.__path__))
    loaded = (importlib.import_module(f"{folder.__name__}.{name}") for name in modules if name != "formats")
    return tuple(found for module in loaded for found in vars(module).values() if isinstance(found, Format))


@cache
def suffixes() -> tuple[str, ...]:
    """All file name endings that are logs, longest first."""
    return tuple(sorted((s for f in formats() for s in f.suffixes), key=lambda s: (-len(s), s)))


def suffix_of(name: str) -> str | None:
    """The known ending of a file name (case does not matter), or None."""
    lower = name.lower()
    return next((s for s in suffixes() if lower.endswith(s)), None)


def stem_of(name: str) -> str:
    """A file name without the ending of its format."""
    suffix = suffix_of(name)
    return name if suffix is None else name[: -len(suffix)]


def format_of(name: str) -> Format | None:
    """The format of a file name, or None."""
    suffix = suffix_of(name)
    return next((f for f in formats() if suffix in f.suffixes), None)
