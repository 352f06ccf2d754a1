"""How names, values and places that came from files are shown in one-line messages."""

import json
from collections.abc import Iterable, Mapping

MAX_SHOWN = 12  # names listed in a message; a log may have thousands of columns
MAX_NAME_LETTERS = 60  # characters of one name or cell shown
Place = tuple[object, ...]  # keys and numbers of list entries, from the outside in


def printable(text: str) -> str:
    """The same text on one line: control characters and undecodable bytes are written as escapes."""
    return "".join(letter if letter.isprintable() else _escaped(letter) for letter in text)


def _escaped(letter: str) -> str:
    if "\udc80" <= letter <= "\udcff":  # a byte of a file name that is not UTF-8
        return f"\\x{ord(letter) - 0xDC00:02x}"
    return letter.encode("unicode_escape").decode("ascii")


def quoted(text: str) -> str:
    text = printable(text)
    return f"'{text}'" if len(text) <= MAX_NAME_LETTERS else f"'{text[:MAX_NAME_LETTERS]}...'"


def listed(names: Iterable[str], most: int = MAX_SHOWN) -> str:
    """Names separated by commas; a long list ends with how many more there are."""
    words = [printable(name)[:MAX_NAME_LETTERS] for name in names]
    more = len(words) - most
    return ", ".join(words[:most]) + (f" and {more} more" if more > 0 else "")


def plural(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def in_words(place: Place) -> str:
    """Return `models.3.k_rr: `, or nothing at the top; a long path is shortened."""
    parts = [f"[{part}]" if isinstance(part, int) else f".{printable(str(part)[:MAX_NAME_LETTERS])}" for part in place]
    text = "".join(parts).removeprefix(".")
    return f"{text if len(text) <= 2 * MAX_NAME_LETTERS else text[: 2 * MAX_NAME_LETTERS] + '...'}: " if text else ""


def format_value(value: object) -> str:
    """Return a value in words, short enough for one line."""
    if value is None or isinstance(value, Mapping):
        return "nothing" if value is None else "an object"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    text = printable(json.dumps(value, ensure_ascii=False, default=str))
    return text if len(text) <= MAX_NAME_LETTERS else text[: MAX_NAME_LETTERS - 3] + "..."
