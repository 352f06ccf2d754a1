"""Frozen settings to and from plain data (dict, TOML, JSON); what does not fit is refused by key.

A recipe is any frozen dataclass whose fields are `bool`, `int`, `float`, `str`, `Literal[...]`, `X | None`,
`tuple[X, ...]`, `tuple[X, Y]`, `Mapping[str, X]` or another such dataclass. A field called `from_` is the key
`from`; the key of a `keyed` field is a template, filled by whom the reader gives. A recipe checks its own values in
`__post_init__` and raises SettingError with the bare reason; the place in the file is put in front of it here.
"""

import dataclasses
import difflib
import json
import math
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, Union

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.plain_data import read_plain, told
from automarine_cli.pipeline.words import LONGEST, printable

Recipe = TypeVar("Recipe")

_PLAIN = {bool: "true or false", int: "a whole number", float: "a number", str: "a text in quotes"}


class Words(Protocol):
    """Who fills the keys of recipes, such as the record of a motion."""

    def fill(self, template: str) -> str:
        """The key that a template stands for."""


FILLER: Mapping[str, Any] = {"filler": True}
"""Metadata of a field that is in no file: who fills the keys, as given to `from_mapping`."""


def keyed(key: str) -> Mapping[str, Any]:
    """Metadata of a field whose key in files is a template such as "noise_{log_unit}", for the recipe's filler."""
    return {"key": key}


def key_of(recipe: object, name: str) -> str:
    """The key of a recipe's field, for messages."""
    return _key(_field(type(recipe), name), _words_of(recipe))


def from_mapping(cls: type[Recipe], mapping: object, where: str, words: Words | None = None) -> Recipe:
    """The recipe `cls` held by plain data; `where` names the file or table for messages, `words` fill the keys and
    become the value of the field marked `FILLER`.

    Raises SettingError with the key's path for an unknown key, a missing one, or a value of the wrong type.
    """
    if not isinstance(mapping, Mapping):
        raise SettingError(f"{where}: expected a table of settings, found {_found(mapping)}")
    every = [field for field in dataclasses.fields(cls) if field.init]  # type: ignore[arg-type]
    fields = {_key(field, words): field for field in every if "filler" not in field.metadata}
    for key in mapping:
        if key not in fields:
            close = difflib.get_close_matches(str(key)[:LONGEST], fields, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise SettingError(f"{where}: unknown key {_key_in_words(key)}{hint}; allowed keys: {', '.join(fields)}")
    hints = typing.get_type_hints(cls)
    values: dict[str, Any] = {field.name: words for field in every if "filler" in field.metadata}
    for key, field in fields.items():
        if key in mapping:
            values[field.name] = _convert(hints[field.name], mapping[key], f"{where}: {key}", words)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise SettingError(f"{where}: key {key!r} is missing; expected {_expected(hints[field.name])}")
    try:
        return cls(**values)
    except SettingError as problem:
        raise SettingError(f"{where}: {problem}") from None


def to_mapping(recipe: object) -> dict[str, Any]:
    """Plain data of a recipe, field order kept; settings that are None are left out (TOML has no null)."""
    words = _words_of(recipe)
    return {
        _key(field, words): _plain(getattr(recipe, field.name))
        for field in dataclasses.fields(recipe)  # type: ignore[arg-type]
        if getattr(recipe, field.name) is not None and "filler" not in field.metadata
    }


def read_mapping(path: Path) -> dict[str, Any]:
    """The table in a TOML or JSON file (distinguished by the extension `.json`). Raises SettingError."""
    return read_plain(path, "JSON" if path.suffix == ".json" else "TOML", SettingError)


def converted(hint: Any, value: object, where: str) -> Any:
    """One plain value as the type `hint`, which a recipe's field may have. Raises SettingError at `where`."""
    return _convert(hint, value, where)


def toml_text(mapping: Mapping[str, Any], prefix: str = "") -> str:
    """Plain data as TOML: values first, then tables, then arrays of tables; read back it is the same data."""
    values, tables = [], []
    for key, value in mapping.items():
        name = prefix + _toml_key(key)
        if isinstance(value, Mapping):
            tables.append(f"\n[{name}]\n" + toml_text(value, f"{name}."))
        elif isinstance(value, (list, tuple)) and value and all(isinstance(one, Mapping) for one in value):
            tables += [f"\n[[{name}]]\n" + toml_text(one, f"{name}.") for one in value]
        else:
            values.append(f"{_toml_key(key)} = {_toml_value(value)}\n")
    return "".join(values + tables)


def toml_line(key: str, value: object) -> str:
    """`key = value` on one line, a table as an inline one."""
    return f"{_toml_key(key)} = {_toml_value(value)}"


def _field(cls: type[Any], name: str) -> "dataclasses.Field[Any]":
    return next(field for field in dataclasses.fields(cls) if field.name == name)


def _key(field: "dataclasses.Field[Any]", words: Words | None) -> str:
    template = field.metadata.get("key")
    return field.name.rstrip("_") if template is None or words is None else words.fill(template)


def _words_of(recipe: object) -> Words | None:
    """Who fills the keys of a recipe."""
    fields = dataclasses.fields(recipe)  # type: ignore[arg-type]
    return next((getattr(recipe, field.name) for field in fields if "filler" in field.metadata), None)


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value):
        return to_mapping(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value


def _convert(hint: Any, value: object, where: str, words: Words | None = None) -> Any:
    """`value` as the type `hint`, or SettingError at the place `where`."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return from_mapping(hint, value, where, words)  # type: ignore[arg-type]
    if origin in (Union, types.UnionType):
        return _convert_union(hint, value, where, words)
    if origin is Literal and value in args and not isinstance(value, bool):
        return value
    if origin is tuple and isinstance(value, (list, tuple)):
        return _convert_tuple(hint, value, where, words)
    if isinstance(origin, type) and issubclass(origin, Mapping) and isinstance(value, Mapping):
        return {
            str(key): _convert(args[1], one, f"{where}.{printable(str(key)[:LONGEST])}", words)
            for key, one in value.items()
        }
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    if hint in (bool, str) and isinstance(value, hint):
        return value
    if hint is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if hint in (Any, object):
        return value
    raise SettingError(f"{where}: expected {_expected(hint)}, found {_found(value)}")


def _convert_union(hint: Any, value: object, where: str, words: Words | None) -> Any:
    """The first member that takes the value; with a single member beside None its own message is kept."""
    members = [member for member in typing.get_args(hint) if member is not type(None)]
    if value is None and len(members) < len(typing.get_args(hint)):
        return None
    if len(members) == 1:
        return _convert(members[0], value, where, words)
    for member in members:
        try:
            return _convert(member, value, where, words)
        except SettingError:
            continue
    raise SettingError(f"{where}: expected {_expected(hint)}, found {_found(value)}")


def _convert_tuple(hint: Any, value: Sequence[object], where: str, words: Words | None) -> tuple[Any, ...]:
    args = typing.get_args(hint)
    if len(args) == 2 and args[1] is Ellipsis:
        args = (args[0],) * len(value)
    elif len(args) != len(value):
        raise SettingError(f"{where}: expected {_expected(hint)}, found {len(value)} values")
    return tuple(_convert(arg, one, f"{where}[{i}]", words) for i, (arg, one) in enumerate(zip(args, value)))


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
    return "a table"


def _found(value: object) -> str:
    """A value in words, short enough for one line."""
    return "a table" if isinstance(value, Mapping) else told(value)


def _key_in_words(key: object) -> str:
    """A key in quotes, on one line, shortened."""
    text = printable(str(key)[:LONGEST])
    return f"'{text}{'...' * (len(str(key)) > LONGEST)}'"


def _toml_key(key: str) -> str:
    bare = key and all(c.isascii() and (c.isalnum() or c in "-_") for c in key)
    return key if bare else _toml_text(key)


def _toml_text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # TOML wants that one escaped too


def _toml_value(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_toml_key(k)} = {_toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml_value(one) for one in value) + "]"
    if isinstance(value, str):
        return _toml_text(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)) and math.isfinite(value):
        return repr(value)
    raise SettingError(f"{_found(value)} cannot be written as TOML; give numbers, words, lists or tables")
