"""The bytes of a CSV file as text: comments emptied, what is no text refused, the line numbers of the rows."""

import gzip
import re
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.csv_head import Head, read_head
from automarine_cli.logs.formats import most_unpacked, too_well_packed

_EMPTIED = re.compile(rb"^[ \t]*(?:#[^\r\n]*)?(?=\r?$)", re.MULTILINE)  # comments and lines of blanks
_SIGNATURES = {
    b"\x1f\x8b": "is gzip-compressed; expected plain text (name it .csv.gz)",
    b"PAR1": "is a Parquet file; expected plain text (name it .parquet)",
    b"PK\x03\x04": "is a zip archive or spreadsheet; expected plain text (export it as CSV)",
    b"\xff\xfe": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
    b"\xfe\xff": "is UTF-16 text; expected UTF-8 (save it as UTF-8)",
}
MOST_COMMENTS = 1_000_000  # lines
PIECE = 4 << 20  # bytes
CACHED = 1 << 17  # bytes that stay in the processor while they are looked at
_CONTROL = bytes(c for c in range(32) if c not in b"\t\n\v\f\r")
_BINARY = (4096, 0.02)  # bytes looked at, and the share of control characters from which it is no text


@dataclass(frozen=True)
class Text:
    """A file as text: its `data` prepared, what its first lines show, and the line numbers of its rows. `regular`: no
    line needed a second look."""

    name: str
    data: bytes
    head: Head
    rows: NDArray[np.int64]
    regular: bool

    @property
    def body(self) -> pa.Buffer:
        """What stands below the header."""
        return pa.py_buffer(self.data).slice(self.head.body)

    def head_of(self, data: bytes) -> Head | None:
        """The head of another file if it is this one's, and numbers between commas are all that its columns can be."""
        header = self.data[: self.head.body]
        same = self.regular and self.head.only_numbers and header.endswith(b"\n") and data.startswith(header)
        return self.head if same else None

    def joins(self, other: "Text") -> bool:
        """Whether the rows of both make one table, as far as their beginnings show."""
        return self.regular and other.regular and self.head == other.head


def read_text(path: Path, name: str, text: frozenset[str], before: "Text | None") -> Text:
    """A file whose columns called as in `text` are words; `before` is read before it. Raises LogError, OSError."""
    data, ends = _prepared(_content(path, name), name)
    head = before.head_of(data) if before is not None and ends >= 0 else None
    head = head or read_head(data, name, text)
    return Text(name, data, head, _line_numbers(data, head, ends), ends >= 0)


def _content(path: Path, name: str) -> bytes:
    if not path.name.lower().endswith(".gz"):
        return path.read_bytes()
    limit = most_unpacked(path)
    try:
        with path.open("rb") as packed:
            if packed.read(2) != b"\x1f\x8b":
                raise LogError(
                    f"{name}: found no gzip data, expected some from its extension; drop .gz from the name if "
                    "it is plain text"
                )
        with gzip.open(path) as file:
            data = file.read(limit + 1)
    except EOFError:
        raise LogError(f"{name}: the gzip data ends too early; the file was cut short, copy it again") from None
    except (gzip.BadGzipFile, zlib.error):
        raise LogError(f"{name}: the gzip data is damaged inside; copy the file again") from None
    if len(data) > limit:
        raise LogError(too_well_packed(name))
    return data


def _prepared(data: bytes, name: str) -> tuple[bytes, int]:
    """Plain text with comments and lines of blanks emptied (the line numbers stay as they are), and its line ends
    if no line needed a second look, else -1.
    """
    for signature, what in _SIGNATURES.items():
        if data.startswith(signature):
            raise LogError(f"{name}: {what}")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if (nul := data.find(b"\0")) >= 0:
        row = data.count(b"\n", 0, nul) + 1
        raise LogError(
            f"{name}, row {row}: found a NUL byte, expected text. The file is binary or was damaged "
            "while it was written; copy it again, or give the log as text"
        )
    head = data[: _BINARY[0]]
    if len(head) - len(head.translate(None, _CONTROL)) > _BINARY[1] * len(head):
        raise LogError(
            f"{name}: found binary data, expected a table of text. The file is binary or was damaged "
            "while it was written; copy it again, or give the log as text"
        )
    if b"\r" in data and b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if data[:4].lower() == b"sep=":  # a spreadsheet's hint; the delimiter shows anyway
        data = b"#" + data
    ends = _ends_of_full_lines(data)
    if ends >= 0:
        return data, ends
    starts = (b"#", b" ", b"\t")
    if data.startswith(starts) or any(b"\n" + start in data for start in starts):
        data, lines = _EMPTIED.subn(b"", data, count=MOST_COMMENTS)
        if lines == MOST_COMMENTS:
            raise LogError(
                f"{name}: {MOST_COMMENTS} lines of comments or blanks; expected a table of numbers. Take them out"
            )
    return data, -1


def _ends_of_full_lines(data: bytes) -> int:
    """How many line ends there are, or -1 if a line begins with a blank, #, a quote or a line end; but a header of
    quoted names is usual."""
    if data[:1] <= b"#" and not (data[:1] == b'"' and data[: data.find(b"\n")].count(b'"') % 2 == 0):
        return -1
    text, count = np.frombuffer(data, dtype=np.uint8), 0
    for start in range(0, len(text), CACHED):
        here = text[start : start + CACHED + 1]  # one more: what follows a line end
        ends = here[:-1] == ord("\n")
        if np.any(ends & (here[1:] <= ord("#"))):
            return -1
        count += int(np.count_nonzero(ends))
    return count + data.endswith(b"\n")


def _line_numbers(data: bytes, head: Head, ends: int) -> NDArray[np.int64]:
    """1-based line numbers of the rows of the body: of its lines that are not empty. `ends` as of `_prepared`."""
    if ends >= 0:
        count = ends - data.count(b"\n", 0, head.body) + (head.body < len(data) and not data.endswith(b"\n"))
        return np.arange(head.line + 1, head.line + 1 + count, dtype=np.int64)
    body = memoryview(data)[head.body :]
    first_empty = body[:1] == b"\n" or body[:2] == b"\r\n"
    if not first_empty and data.find(b"\n\n", head.body) < 0 and data.find(b"\n\r\n", head.body) < 0:
        count = data.count(b"\n", head.body) + (len(body) > 0 and body[-1] != ord("\n"))
        return head.line + 1 + np.arange(count, dtype=np.int64)
    # in pieces: a file of nothing but line ends must not take many times its size
    text = np.frombuffer(b"\n\n" + data[head.body :].rstrip(b"\r\n") + b"\n", dtype=np.uint8)
    rows, before = [np.zeros(0, dtype=np.int64)], head.line + 1
    for start in range(2, len(text), PIECE):
        here = text[start : start + PIECE]
        one, two = text[start - 1 : start - 1 + len(here)], text[start - 2 : start - 2 + len(here)]
        ended = here == ord("\n")
        full = ended & (one != ord("\n")) & ~((one == ord("\r")) & (two == ord("\n")))
        at = np.flatnonzero(full)
        rows.append(before + np.cumsum(ended, dtype=np.int64)[at] - 1)
        before += int(ended.sum())
    return np.concatenate(rows)
