"""Plain data (dict, JSON, TOML) to and from typed records, by their type hints; what does not fit is refused by place.

A record is any frozen dataclass whose fields are `bool`, `int`, `float`, `str`, `Literal[...]`, `object`, `X | None`,
`tuple[X, ...]`, `tuple[X, Y]`, `Mapping[str, X]` or another such dataclass. A field called `from_` is the key `from`;
the key of a `keyed` field is a template, filled by whom the reader gives. A record with a class method `of_number`
takes a plain number too. A record checks its own values in `__post_init__` and raises SettingError with the bare
reason; the place in the file is put in front of it here.
"""

import dataclasses
import difflib
import functools
import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from typing import Any, ClassVar, Literal, Protocol, TypeVar, Union

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.pipeline.plain_data import in_words, told
from automarine_cli.pipeline.words import LONGEST

Place = tuple[object, ...]
"""Keys and numbers of list entries, from the outside in."""

_PLAIN = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


class Record(Protocol):
    """A dataclass."""

    __dataclass_fields__: ClassVar[dict[str, "Field[Any]"]]


Kind = TypeVar("Kind", bound=Record)


class Words(Protocol):
    """Who fills the keys of records, such as the record of a motion."""

    def fill(self, template: str) -> str:
        """The key that a template stands for."""


FILLER: Mapping[str, object] = {"filler": True}
"""Metadata of a field that is in no file: who fills the keys, as given to the codec."""
UNREAD = "unread"
"""Name of the class attribute of records of results that refuse a key that means nothing, as all settings do: keys that
may be there and that nobody reads."""


def keyed(*keys: str) -> Mapping[str, object]:
    """Metadata of a field whose key in files is a template such as "noise_{log_unit}", for the codec's words; of
    several the first that is there is read."""
    return {"keys": keys}


@dataclass(frozen=True)
class Codec:
    """How the data of one file become records.

    `name` is that of the file or table, for messages; `words` fill the keys and become the value of the field marked
    `FILLER`; `refuse` is raised. `writer` is the command that writes such files, where none is named they are settings
    that people write. `others` are words that may be mistaken for these.
    """

    name: str
    words: Words | None = None
    refuse: type[AutomarineError] = SettingError
    writer: str = ""
    others: tuple[Words, ...] = ()

    def refusal(self, place: Place, why: str) -> AutomarineError:
        """The error that names file and place."""
        return self.refuse(f"{self.name}: {in_words(place)}{why}")

    def missing(self, place: Place, key: str, expected: str = "") -> AutomarineError:
        """The error for a key that is not there."""
        then = f"give a file as `automarine {self.writer}` writes it" if self.writer else f"expected {expected}"
        return self.refusal(place, f"key {told(key)} is missing; {then}")

    def read(self, record: type[Kind], data: object, place: Place = ()) -> Kind:
        """The `record` that plain data hold.

        Raises `refuse` with the place for a key that is unknown or missing, or a value of the wrong type.
        """
        if not isinstance(data, Mapping):
            table = "an object with named keys" if self.writer else "a table of settings"
            raise self.refusal(place, f"found {told(data)}, expected {table}")
        known = {field.name: self.keys(field) for field in _fields(record) if "filler" not in field.metadata}
        unread: Sequence[str] | None = getattr(record, UNREAD, None if self.writer else ())
        if unread is not None:
            self._refuse_unknown(record, data, [*(key for keys in known.values() for key in keys), *unread], place)
        values: dict[str, object] = {}
        hints = _hints(record)
        for field in _fields(record):
            if field.name not in known:
                values[field.name] = self.words
                continue
            keys = known[field.name]
            key = next((one for one in keys if one in data), None)
            if key is not None:
                values[field.name] = self.value(hints[field.name], data[key], (*place, key))
            elif field.default is MISSING and field.default_factory is MISSING:
                raise self.missing(place, keys[0], _expected(hints[field.name]))
        try:
            return record(**values)
        except SettingError as problem:
            raise self.refusal(place, str(problem)) from None

    def keys(self, field: "Field[Any]") -> tuple[str, ...]:
        """The keys that stand for a field."""
        return _keys(field, self.words)

    def _refuse_unknown(
        self, record: type[Record], data: Mapping[object, object], known: list[str], place: Place
    ) -> None:
        """Refuse a key that means nothing: it may be meant as one that is read, and must not be passed over."""
        for key in data:
            if key in known:
                continue
            free = [name for name in known if name not in data] if self.writer else known
            twins = {(theirs, ours) for other in self.others for field in _fields(record)
                     for theirs, ours in zip(_keys(field, other), self.keys(field))}  # fmt: skip
            meant = [ours for theirs, ours in twins if theirs == key and ours in free]
            close = meant or difflib.get_close_matches(
                str(key)[:LONGEST], free, n=1, cutoff=0.8 if self.writer else 0.6
            )
            hint = f"did you mean {told(close[0])}?" if close else f"known are {', '.join(known)}"
            raise self.refusal(place, f"unknown key {told(key)}; {hint}")

    def value(self, hint: Any, value: object, place: Place = ()) -> Any:
        """One plain value as the type `hint`, which a record's field may have. Raises `refuse` with the place."""
        origin, args = typing.get_origin(hint), typing.get_args(hint)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if dataclasses.is_dataclass(hint):
            if hasattr(hint, "of_number") and not isinstance(value, Mapping):
                return hint.of_number(self.value(float, value, place))
            return self.read(typing.cast(type[Record], hint), value, place)
        if origin in (Union, types.UnionType):
            return self._one_of(hint, value, place)
        if origin is Literal and value in args and not isinstance(value, bool):
            return value
        if origin is tuple and isinstance(value, list | tuple):
            return self._entries(hint, value, place)
        if isinstance(origin, type) and issubclass(origin, Mapping) and isinstance(value, Mapping):
            return {str(key): self.value(args[1], one, (*place, key)) for key, one in value.items()}
        if hint is float and number:
            try:
                if math.isfinite(found := float(value)):  # type: ignore[arg-type]
                    return found
            except OverflowError:
                pass
            raise self.refusal(place, f"found {told(value)}, expected a finite number")
        if hint in (Any, object) or (hint in (bool, str) and isinstance(value, hint)) or (
            hint is int and isinstance(value, int) and number
        ):  # fmt: skip
            return value
        raise self._wrong(hint, value, place)

    def _one_of(self, hint: Any, value: object, place: Place) -> Any:
        """The first member of a union that takes the value; with a single one beside None its own message is kept."""
        members = [member for member in typing.get_args(hint) if member is not type(None)]
        if value is None and len(members) < len(typing.get_args(hint)):
            return None
        if len(members) == 1:
            return self.value(members[0], value, place)
        for member in members:
            try:
                return self.value(member, value, place)
            except AutomarineError:
                continue
        raise self._wrong(hint, value, place)

    def _entries(self, hint: Any, value: Sequence[object], place: Place) -> tuple[Any, ...]:
        args = typing.get_args(hint)
        if len(args) == 2 and args[1] is Ellipsis:
            args = (args[0],) * len(value)
        elif len(args) != len(value):
            raise self._wrong(hint, value, place)
        return tuple(self.value(arg, one, (*place, i)) for i, (arg, one) in enumerate(zip(args, value)))

    def _wrong(self, hint: object, value: object, place: Place) -> AutomarineError:
        found = "a table" if isinstance(value, Mapping) and not self.writer else told(value)
        return self.refusal(place, f"found {found}, expected {_expected(hint)}")


def to_mapping(record: Record) -> dict[str, object]:
    """Plain data of a record, field order kept; what is None is left out (TOML has no null)."""
    words = words_of(record)
    return {
        _keys(field, words)[0]: _plain(getattr(record, field.name))
        for field in dataclasses.fields(record)
        if getattr(record, field.name) is not None and "filler" not in field.metadata
    }


def key_of(record: Record, name: str) -> str:
    """The key of a record's field, for messages."""
    return _keys(next(field for field in dataclasses.fields(record) if field.name == name), words_of(record))[0]


def words_of(record: Record) -> Words | None:
    """Who fills the keys of a record."""
    return next((getattr(record, one.name) for one in dataclasses.fields(record) if "filler" in one.metadata), None)


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_mapping(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


@functools.cache
def _fields(record: type[Record]) -> "tuple[Field[Any], ...]":
    return tuple(field for field in dataclasses.fields(record) if field.init)


@functools.cache
def _hints(record: type[Record]) -> dict[str, object]:
    return typing.get_type_hints(record)


def _keys(field: "Field[Any]", words: Words | None) -> tuple[str, ...]:
    templates = field.metadata.get("keys", ())
    return tuple(map(words.fill, templates)) if templates and words is not None else (field.name.rstrip("_"),)


def _expected(hint: Any) -> str:
    """A type in words."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint in _PLAIN:
        return _PLAIN[hint]
    if origin in (Union, types.UnionType):
        return " or ".join(_expected(arg) for arg in args if arg is not type(None))
    if origin is Literal:
        return "one of " + ", ".join(repr(arg) for arg in args)
    if origin is tuple:
        one = _expected(args[0]).removeprefix("a ")
        return f"a list, each entry a {one}" if args[-1] is Ellipsis else f"a list of {len(args)} values"
    return "a number" if hasattr(hint, "of_number") else "a table"
