"""Settings in frozen dataclasses to and from TOML and JSON, by the codec; what does not fit is refused by key."""

import json
import math
from collections.abc import Mapping
from pathlib import Path

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.codec import Codec, Kind, Words
from automarine_cli.pipeline.plain_data import read_plain, told


def from_mapping(cls: type[Kind], mapping: object, where: str, words: Words | None = None) -> Kind:
    """The settings `cls` held by plain data; `where` names the file or table for messages, `words` fill the keys.

    Raises SettingError with the key's path for an unknown key, a missing one, or a value of the wrong type.
    """
    return Codec(where, words).read(cls, mapping)


def read_mapping(path: Path) -> dict[str, object]:
    """The table in a TOML or JSON file (distinguished by the extension `.json`). Raises SettingError."""
    return read_plain(path, "JSON" if path.suffix == ".json" else "TOML", SettingError)


def toml_text(mapping: Mapping[str, object], prefix: str = "") -> str:
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
    raise SettingError(f"{told(value)} cannot be written as TOML; give numbers, words, lists or tables")
