"""`--columns FILE.toml`: the user's names, units and signs for the canonical columns."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, RUN
from automarine_cli.pipeline.plain_data import read_plain
from automarine_cli.pipeline.words import listed, printable, quoted

KNOWN_DEFAULTS = ("thrusters_per_test", "arm_m")
LARGEST_MAP = 200_000  # bytes; a column map is a dozen lines


@dataclass(frozen=True)
class ColumnRule:
    """One line of a column map: value = sign (scale x the file's value + offset), in `unit` (None: the name's
    own).
    """

    source: str
    unit: str | None = None
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ColumnMap:
    """Canonical name -> rule, defaults for settings, and the DBC that CAN captures are decoded with (a path, or "").

    `ColumnMap()` takes every name as it stands.
    """

    columns: Mapping[str, ColumnRule] = field(default_factory=dict)
    defaults: Mapping[str, float | str] = field(default_factory=dict)
    source: str = ""
    dbc: str = ""

    @property
    def database(self) -> Path | None:
        """The DBC's file, if one is named."""
        return Path(self.dbc) if self.dbc else None

    def source_of(self, name: str) -> str:
        """The column of the file that a canonical name stands for."""
        return self.columns[name].source if name in self.columns else name


def given_columns(columns: "str | Path | ColumnMap | None") -> ColumnMap:
    """The map that a command was given: itself, its file, or none, for logs in the tool's own names."""
    if isinstance(columns, ColumnMap):
        return columns
    return read_column_map(columns) if columns else ColumnMap()


def read_column_map(path: str | Path) -> ColumnMap:
    """Read a column map (TOML with `[columns]`, `[defaults]` and `[can]`).

    Raises LogError with the key's path for an unknown key, a wrong type or a unit that does not fit.
    """
    path = Path(path)
    name = printable(path.name)
    data = read_plain(path, "TOML", LogError, most=LARGEST_MAP)
    for key in data:
        if key not in ("columns", "defaults", "can"):
            raise LogError(
                f"{name}: unknown key {quoted(key)}; a column map holds [columns], [defaults] and [can] only; write it "
                "below one of them"
            )
    columns, defaults, can = (_table(data.get(key, {}), key, name) for key in ("columns", "defaults", "can"))
    if not columns and not defaults and not can:
        raise LogError(f'{name}: the column map is empty; write lines such as heading_deg = "yaw" under [columns]')
    return ColumnMap(
        columns=column_rules(columns, name),
        defaults={key: _default(name, key, value) for key, value in defaults.items()},
        source=name,
        dbc=database(can, path),
    )


def column_rules(columns: Mapping[str, object], name: str) -> dict[str, ColumnRule]:
    """The rules under `[columns]` of the file called `name`. Raises LogError with the key's path."""
    return {key: _rule(name, key, value) for key, value in columns.items()}


def database(can: Mapping[str, object], path: Path) -> str:
    """The DBC that `[can]` of the file at `path` names, "" for none. Raises LogError with the key's path."""
    name = printable(path.name)
    for key in can:
        if key != "dbc":
            raise LogError(
                f"{name}: can.{printable(key)} is not known; [can] takes dbc, the file that describes the bus"
            )
    given = can.get("dbc", "")
    if not isinstance(given, str) or (can and not given.strip()):
        raise LogError(f"{name}: can.dbc is {_kind(given)}; expected the place of a DBC file in quotes")
    return str(path.parent.absolute() / given) if given else ""


def _table(table: object, key: str, name: str) -> dict[str, object]:
    if not isinstance(table, dict):
        raise LogError(f"{name}: {key} is {_kind(table)}; expected a table, written [{key}]")
    return table


def _rule(name: str, key: str, value: object) -> ColumnRule:
    where = f"{name}: columns.{printable(key)}"
    if key not in CANONICAL and key not in LABELS:
        raise LogError(f"{where} is no column that automarine knows; known are {', '.join([*CANONICAL, *LABELS])}")
    if isinstance(value, str):
        value = {"from": value}
    if not isinstance(value, dict):
        raise LogError(
            f"{where} is {_kind(value)}; expected the name of a column in quotes, "
            'or a table such as { from = "yaw", unit = "rad", sign = -1 }'
        )
    for inner in value:
        if inner not in ("from", "unit", "sign", "scale", "offset"):
            raise LogError(f"{where}.{printable(inner)} is not known; a column takes from, unit, sign, scale, offset")
    source = value.get("from")
    if not isinstance(source, str) or not source.strip():
        found = "missing" if source is None else _kind(source)
        raise LogError(f"{where}.from is {found}; expected the name of a column in quotes")
    if key in LABELS and len(value) > 1:
        what = {RUN: "names runs", BY: "names what each row is of"}.get(key, "is a state")
        raise LogError(f"{where} {what}; unit, sign, scale and offset do not apply; leave them out")
    sign = value.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise LogError(f"{where}.sign is {_kind(sign)}; expected 1 or -1")
    return ColumnRule(
        source.strip(),
        _unit(where, key, value.get("unit")),
        int(sign),
        _number(f"{where}.scale", value.get("scale", 1.0)),
        _number(f"{where}.offset", value.get("offset", 0.0)),
    )


def _unit(where: str, key: str, unit: object) -> str | None:
    if unit is None:
        return None
    known = CANONICAL[key].units()
    if not isinstance(unit, str) or (known and unit not in known):
        raise LogError(f"{where}.unit is {_kind(unit)}; expected {' or '.join(known) if known else 'a word in quotes'}")
    return unit


def _number(where: str, value: object) -> float:
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not good or (where.endswith(".scale") and value == 0):
        wanted = "a finite number other than 0" if where.endswith(".scale") else "a finite number"
        raise LogError(f"{where} is {_kind(value)}; expected {wanted}")
    return float(value)  # type: ignore[arg-type]


def _default(name: str, key: str, value: object) -> float:
    where = f"{name}: defaults.{printable(key)}"
    if key not in KNOWN_DEFAULTS:
        raise LogError(f"{where} is not known; [defaults] takes {listed(KNOWN_DEFAULTS)}")
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0
    if not good:
        raise LogError(f"{where} is {_kind(value)}; expected a number above 0")
    return value  # type: ignore[return-value]


def _kind(value: object) -> str:
    """What was found, in words."""
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return f"{value:g}" if isinstance(value, float) or abs(value) < 10**15 else "a huge number"
    return {dict: "a table", list: "a list"}.get(type(value), "no text or number")  # type: ignore[call-overload]
