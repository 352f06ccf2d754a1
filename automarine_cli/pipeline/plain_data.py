"""Files of plain data that people hand in (models, maps, specifications, column maps): JSON or TOML, nothing
executed.

What such a file may cost is bounded before anything looks at it: its size, how deep it is nested, the size of
its whole numbers, the dots of a TOML key (the standard library takes time with the square of their number).
"""

import io
import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.words import LONGEST, printable, quoted

# A model is a few kilobytes, with ten thousand runs set aside a few megabytes; TOML is written by hand.
MOST_BYTES = {"JSON": 16_000_000, "TOML": 1_000_000}
MOST_VALUES = 1_000_000
DEEPEST = 40  # tables in tables; ours are six deep
LARGEST_WHOLE = 10**300  # beyond it a whole number is no float any more
MOST_DOTS = 40  # parts of one dotted TOML key
_DOT = re.compile(r"[^\s.][ \t]*\.")

Kind = Literal["JSON", "TOML"]


@dataclass(frozen=True)
class Document:
    """A file that is on no disk: the name and the bytes that a result of Python would have been written as."""

    name: str
    content: bytes

    def open(self, mode: Literal["rb"]) -> io.BufferedReader | io.BytesIO:
        """Its bytes as a stream, as `Path.open`."""
        return io.BytesIO(self.content)

    def read_bytes(self) -> bytes:
        """Its bytes, as `Path.read_bytes`."""
        return self.content


Source = Path | Document
"""What a model, a map or a diagnosis is read from."""


class Unsound(ValueError):
    """What the parsers let pass and we do not."""


def read_plain(
    path: Source, kind: Kind, refuse: type[AutomarineError], *, most: int | None = None
) -> dict[str, object]:
    """The table (JSON: object) in a file.

    Raises `refuse` with the file, and the key's path where there is one, for a file that cannot be read, is not
    UTF-8, not sound JSON or TOML, of more than `most` bytes, nested too deep, or holds a key twice, more
    than a million values, a number that is not finite (JSON) or a whole number that no computation can use.
    """
    name = printable(path.name)
    text = _text(path, name, refuse, MOST_BYTES[kind] if most is None else most)
    if kind == "JSON" and not text.strip():
        raise refuse(f"{name}: the file is empty; expected JSON")
    try:
        data = _parsed(text, kind)
    except RecursionError:
        raise refuse(f"{name}: not valid {kind}: nested too deep") from None
    except (Unsound, json.JSONDecodeError, tomllib.TOMLDecodeError) as problem:
        raise refuse(f"{name}: not valid {kind}: {printable(str(problem))[:300]}") from None
    except ValueError:  # the interpreter's own limit
        raise refuse(f"{name}: not valid {kind}: a whole number of thousands of digits") from None
    for count, (value, place) in enumerate(everything(data), 1):
        if (why := _trouble(value, place, kind)) is not None:
            raise refuse(f"{name}: {in_words(place)}{why}")
        if count > MOST_VALUES:
            raise refuse(f"{name}: holds more than {MOST_VALUES} values; expected a file of a few kilobytes")
    if not isinstance(data, dict):
        raise refuse(f"{name}: found {told(data)}, expected an object with named keys")
    return data


def schema_in(source: object) -> str:
    """The schema that a JSON file says it has; empty where there is none, or nothing that can be read."""
    try:
        return str(read_plain(source, "JSON", AutomarineError).get("schema")) if isinstance(source, Source) else ""
    except AutomarineError:
        return ""


def told(value: object) -> str:
    """A value found, in words, short enough for one line."""
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "an object"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    if isinstance(value, str) and len(value) > LONGEST:
        value = value[:LONGEST] + "..."
    text = printable(json.dumps(value, ensure_ascii=False, default=str))
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def _text(path: Source, name: str, refuse: type[AutomarineError], most: int) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)  # what has no end (a device) must not fill the memory
    except OSError as problem:
        raise refuse(f"{name}: cannot be read ({problem.strerror or problem})") from None
    if len(content) > most:
        raise refuse(f"{name}: more than {most} bytes; expected a file of a few kilobytes")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise refuse(f"{name}: expected UTF-8 text, found other bytes; save it as UTF-8") from None


def _parsed(text: str, kind: Kind) -> object:
    """The data. Raises ValueError or RecursionError."""
    if kind == "JSON":
        return json.loads(text, object_pairs_hook=_once)
    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") > MOST_DOTS and _most_dots(line) > MOST_DOTS:
            raise Unsound(f"a key of more than {MOST_DOTS} parts (at line {number})")
    return tomllib.loads(text)


def _most_dots(line: str) -> int:
    """The most dots, each after something else, in a piece of a line that may be one key."""
    return max(len(_DOT.findall(piece)) for piece in re.split("[,=#]", line))


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise Unsound(f"the key {quoted(twice)} is given more than once")
    return table


def everything(data: object) -> Iterator[tuple[object, tuple[object, ...]]]:
    """Every value with its place (keys and numbers of list entries from the outside in), outer ones first."""
    yield data, ()
    waiting: list[tuple[tuple[object, ...], Iterator[tuple[object, object]]]] = [((), iter(_entries(data)))]
    while waiting:
        place, entries = waiting[-1]
        for key, value in entries:
            yield value, (*place, key)
            if isinstance(value, (dict, list)):
                waiting.append(((*place, key), iter(_entries(value))))
                break
        else:
            waiting.pop()


def _entries(data: object) -> Iterable[tuple[object, object]]:
    if isinstance(data, dict):
        return data.items()
    return enumerate(data) if isinstance(data, list) else ()


def _trouble(value: object, place: tuple[object, ...], kind: Kind) -> str | None:
    """Why a value cannot stay, or None."""
    if isinstance(value, float):
        if kind == "JSON" and not math.isfinite(value):
            return f"found {told(value)}, expected a finite number"
    elif isinstance(value, int):
        if abs(value) > LARGEST_WHOLE:
            return "found a whole number of more than 300 digits, expected a smaller one"
    elif len(place) > DEEPEST and isinstance(value, (dict, list)):
        return f"nested more than {DEEPEST} deep"
    return None


def in_words(place: tuple[object, ...]) -> str:
    """`models.3.k_rr: `, or nothing at the top; a long path is shortened."""
    parts = [f"[{part}]" if isinstance(part, int) else f".{printable(str(part)[:LONGEST])}" for part in place]
    text = "".join(parts).removeprefix(".")
    return f"{text if len(text) <= 2 * LONGEST else text[: 2 * LONGEST] + '...'}: " if text else ""
