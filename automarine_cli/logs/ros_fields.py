"""The numbers and words in a ROS message of any type: where each is, and how it is got."""

from collections.abc import Callable, Iterator, Mapping
from operator import attrgetter
from typing import Any

Getter = Callable[[Any], Any]
LONGEST_ARRAY = 16  # numbers of an array that become columns
DEEPEST = 6  # messages within messages
NUMBERS = ("bool", "float", "int", "uint", "octet", "byte", "char")
NAN = float("nan")


def getters(
    types: Mapping[str, Any], kind: str, first: Any, wanted: Callable[[str], bool]
) -> dict[str, Getter]:
    """Path -> getter, for every wanted number and word of a message type; `first` shows how long its arrays are."""
    return {path: get for path, get in _inside(types, kind, "", first, 0) if wanted(path)}


def _inside(
    types: Mapping[str, Any], kind: str, prefix: str, first: Any, depth: int
) -> Iterator[tuple[str, Getter]]:
    for name, (node, about) in types[kind][1]:
        path = f"{prefix}{name}"
        if node.name == "BASE" and (about[0].startswith(NUMBERS) or about[0] == "string"):
            yield path, attrgetter(path)
        elif node.name == "NAME" and depth < DEEPEST:
            yield from _inside(types, about, f"{path}.", first, depth + 1)
        elif node.name in ("ARRAY", "SEQUENCE"):
            (inner, what), _ = about
            if inner.name == "BASE" and what[0].startswith(NUMBERS):
                values = attrgetter(path)(first)
                yield from (
                    (f"{path}[{i}]", _element(path, i)) for i in range(min(len(values), LONGEST_ARRAY))
                )


def _element(path: str, i: int) -> Getter:
    whole = attrgetter(path)

    def get(message: Any) -> Any:
        values = whole(message)
        return values[i] if i < len(values) else NAN

    return get
