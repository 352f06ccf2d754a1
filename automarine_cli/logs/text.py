"""Cells of text: which are missing, which are numbers."""

import re

import pyarrow as pa
import pyarrow.compute as pc

MISSING = ("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE)


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell, blanks stripped, is a number with this decimal character."""
    return NUMBER.fullmatch(cell.replace(decimal, ".") if decimal == "," else cell) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell, blanks stripped, says that there is no value."""
    return cell in MISSING


def decoded(cell: bytes | str | None) -> str:
    """A cell as text without blanks around it; bytes that are not UTF-8 are read as Latin-1."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell.strip()
    try:
        return cell.decode("utf-8").strip()
    except UnicodeDecodeError:
        return cell.decode("latin-1").strip()


def plain(array: pa.ChunkedArray) -> pa.ChunkedArray:
    """Text cells without blanks around them, missing ones null. Raises pyarrow.ArrowInvalid if not UTF-8."""
    trimmed = pc.utf8_trim_whitespace(pc.cast(array, pa.string()))
    return pc.if_else(pc.is_in(trimmed, value_set=pa.array(MISSING)), pa.scalar(None, pa.string()), trimmed)


def numbers(array: pa.ChunkedArray, decimal: str = ".") -> pa.ChunkedArray | None:
    """Text cells as float64, or None where at least one is not a number."""
    try:
        cells = plain(array)
        if decimal == ",":
            if pc.any(pc.match_substring(cells, ".")).as_py():
                return None
            cells = pc.replace_substring(cells, ",", ".", max_replacements=1)
        return pc.cast(pc.replace_substring_regex(cells, r"^\+", ""), pa.float64())
    except pa.ArrowInvalid:
        return None


def first_not_a_number(array: pa.ChunkedArray, decimal: str = ".") -> tuple[int, str]:
    """Index and text of the first cell that keeps a text column from being numbers."""
    for start in range(0, len(array), 65536):
        for i, cell in enumerate(array.slice(start, 65536).to_pylist()):
            text = decoded(cell)
            if not is_missing(text) and not is_number(text, decimal):
                return start + i, text
    return 0, decoded(array[0].as_py())
