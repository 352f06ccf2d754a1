"""`--columns FILE.toml`: the user's names, units and signs for the canonical columns, and which files are one log."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Literal

from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, ROTATIONS, RUN
from automarine_cli.pipeline.records import Codec, Source, read_plain
from automarine_cli.pipeline.words import listed, printable, quoted

OLDEST = 5.0  # s; a command older than this is none


@dataclass(frozen=True)
class Join:
    """Each of `logs` (a name or the end of a path) is one log `with_` the files whose names have the same letters where
    its stars are.

    Their columns come onto the clock of the log: the previous value is held until the next, or the nearest is taken;
    none is older (or further) than `max_age_s` [s].
    """

    logs: str
    with_: str | tuple[str, ...]
    take: Literal["previous", "nearest"] = "previous"
    max_age_s: float = OLDEST

    def __post_init__(self) -> None:
        stars = self.logs.count("*")
        for other in self.others:
            if other.count("*") not in (0, stars) or not other or not self.logs:
                raise SettingError(
                    f'join of "{self.logs}" with "{other}": expected as many stars in both, or none in the second; a '
                    "star stands for the same letters in both names"
                )
        if not self.max_age_s > 0:
            raise SettingError(f"max_age_s is {self.max_age_s:g}; expected seconds above 0")

    @property
    def others(self) -> tuple[str, ...]:
        """The patterns of the files that are joined."""
        return (self.with_,) if isinstance(self.with_, str) else self.with_

    def beside(self, path: Path) -> tuple[Path, ...]:
        """The files joined to the log at `path`, none where it is not of those meant. Raises LogError for one that is
        not there."""
        depth = len(PurePosixPath(self.logs).parts)
        found = re.fullmatch(_with_stars(self.logs), "/".join(path.absolute().parts[-depth:]))
        if found is None:
            return ()
        names = [_filled(other, found.groups()) for other in self.others]
        base = path.parents[depth - 1] if depth <= len(path.parents) else path.absolute().parents[depth - 1]
        lost = next((name for name in names if not (base / name).is_file()), None)
        if lost is not None:
            raise LogError(
                f"{printable(path.name)}: no {printable(lost)} beside it, which join expects; copy it there, or "
                "correct the names in join"
            )
        return tuple(base / name for name in names)


def matches(path: Path, pattern: str) -> bool:
    """Whether a pattern means a log: its name, the end of its path, or that of a folder it is in."""
    whole = PurePosixPath(path.absolute().as_posix())
    return any(one.match(pattern) for one in (whole, *whole.parents))


def _with_stars(pattern: str) -> str:
    """The regular expression of a pattern in which each star is a group."""
    return "([^/]*)".join(re.escape(part) for part in pattern.split("*"))


def _filled(pattern: str, letters: tuple[str, ...]) -> str:
    stars = iter(letters)
    return re.sub(r"\*", lambda _: next(stars), pattern)


KNOWN_DEFAULTS = ("thrusters_per_test", "arm_m")
TURNING = {quantity for dof in ROTATIONS for quantity in (dof.position, dof.velocity)}
LARGEST_MAP = 200_000  # bytes; a column map is a dozen lines
TABLES = ("columns", "columns_of", "logs", "defaults", "can")
TAKEN = ("from", "unit", "sign", "scale", "offset", "subtract", "sign_from", "day_first")


@dataclass(frozen=True)
class ColumnRule:
    """One line of a column map: value = sign (scale x (the file's value - subtract) + offset), in `unit` (None: the
    name's own).

    With `sign_from` the file's value is a size, and that column (less its own neutral) says which way it counts.
    `day_first` is how dates such as 03/05/2024 are read (None: as the column shows).
    """

    source: str
    unit: str | None = None
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    subtract: float = 0.0
    sign_from: "ColumnRule | None" = None
    day_first: bool | None = None

    def read(self, value: float, factor: float = 1.0) -> float:
        """What a value of the file's own column stands for; `factor` is that of the rule's unit."""
        return self.sign * (self.scale * (value - self.subtract) + self.offset) * factor

    def written(self, value: float, factor: float = 1.0) -> float:
        """A value as the file's own column holds it; `factor` is that of the rule's unit."""
        return (self.sign * value / factor - self.offset) / self.scale + self.subtract


@dataclass(frozen=True)
class ColumnsOf:
    """The column map of some logs, told by names or ends of paths in which a star stands for any letters."""

    logs: tuple[str, ...]
    columns: Mapping[str, ColumnRule]


@dataclass(frozen=True)
class ColumnMap:
    """Canonical name -> rule, defaults for settings, and the DBC that CAN captures are decoded with (a path, or "").

    `ColumnMap()` takes every name as it stands. `columns_of` are logs with a map of their own, `join` says which files
    are one log.
    """

    columns: Mapping[str, ColumnRule] = field(default_factory=dict)
    defaults: Mapping[str, float | str] = field(default_factory=dict)
    source: str = ""
    dbc: str = ""
    columns_of: tuple[ColumnsOf, ...] = ()
    join: tuple[Join, ...] = ()

    def of(self, path: Path) -> "ColumnMap":
        """The map of one log: that of the first of `columns_of` that means it, else the one of all others."""
        own = next((one.columns for one in self.columns_of if any(matches(path, name) for name in one.logs)), None)
        return self if own is None else replace(self, columns=own)

    def beside(self, path: Path) -> dict[Path, Join]:
        """The files that are joined to a log, and how. Raises LogError for one that is not there."""
        return {found: one for one in reversed(self.join) for found in one.beside(path)}

    @property
    def database(self) -> Path | None:
        """The DBC's file, if one is named."""
        return Path(self.dbc) if self.dbc else None

    @property
    def sources(self) -> set[str]:
        """Every column of a file that a rule reads."""
        rules = list(self.columns.values())
        return {one.source for one in (*rules, *(rule.sign_from for rule in rules)) if one is not None}

    def source_of(self, name: str) -> str:
        """The column of the file that a canonical name stands for."""
        return self.columns[name].source if name in self.columns else name


def given_columns(columns: "str | Source | ColumnMap | None") -> ColumnMap:
    """The map that a command was given: itself, its file, or none, for logs in the tool's own names."""
    if isinstance(columns, ColumnMap):
        return columns
    return read_column_map(columns) if columns else ColumnMap()


def read_column_map(path: str | Source) -> ColumnMap:
    """Read a column map (TOML with `[columns]`, `[[columns_of]]`, `[logs]`, `[defaults]` and `[can]`).

    Raises LogError with the key's path for an unknown key, a wrong type or a unit that does not fit.
    """
    path = Path(path) if isinstance(path, str) else path
    name = printable(path.name)
    data = read_plain(path, "TOML", LogError, most=LARGEST_MAP)
    for key in data:
        if key not in TABLES:
            raise LogError(
                f"{name}: unknown key {quoted(key)}; a column map holds [columns], [[columns_of]], [logs], [defaults] "
                "and [can] only; write it below one of them"
            )
    tables = (_table(data.get(key, {}), key, name) for key in ("columns", "defaults", "can", "logs"))
    columns, defaults, can, logs = tables
    if not any(data.values()):
        raise LogError(f'{name}: the column map is empty; write lines such as heading_deg = "yaw" under [columns]')
    for key in logs:
        if key != "join":
            raise LogError(f"{name}: logs.{printable(key)} is not known; [logs] of a column map takes join")
    return ColumnMap(
        columns=column_rules(columns, name),
        defaults={key: _default(name, key, value) for key, value in defaults.items()},
        source=name,
        dbc=database(can, path if isinstance(path, Path) else Path(path.name)),
        columns_of=columns_of(data.get("columns_of", ()), name),
        join=joins(logs.get("join", ()), f"{name}: logs.join"),
    )


def column_rules(columns: Mapping[str, object], name: str) -> dict[str, ColumnRule]:
    """The rules under `[columns]` of the file called `name`. Raises LogError with the key's path."""
    return {key: _rule(name, key, value) for key, value in columns.items()}


def columns_of(tables: object, name: str) -> tuple[ColumnsOf, ...]:
    """The maps under `[[columns_of]]` of the file called `name`. Raises LogError with the key's path."""
    if not isinstance(tables, list | tuple) or not all(isinstance(one, Mapping) for one in tables):
        raise _wrong(f"{name}: columns_of", tables, "tables, each written [[columns_of]]")
    found = []
    for i, one in enumerate(tables):
        logs = (one.get("logs", ()),) if isinstance(one.get("logs"), str) else tuple(one.get("logs", ()))
        if not logs or not all(isinstance(log, str) for log in logs):
            raise LogError(f"{name}: columns_of[{i}].logs is missing; expected the logs that it is of, such as "
                           '["bollard/*.csv"]')  # fmt: skip
        rules = column_rules({key: value for key, value in one.items() if key != "logs"}, name)
        found.append(ColumnsOf(logs, rules))
    return tuple(found)


def joins(given: object, where: str) -> tuple[Join, ...]:
    """What `join` says at the place `where`, one table or several. Raises LogError with the key's path."""
    several = [given] if isinstance(given, Mapping) else given
    found: tuple[Join, ...] = Codec(where, refuse=LogError).value(tuple[Join, ...], several)
    return found


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
        raise _wrong(f"{name}: can.dbc", given, "the place of a DBC file in quotes")
    return str(path.parent.absolute() / given) if given else ""


def _table(table: object, key: str, name: str) -> dict[str, object]:
    if not isinstance(table, dict):
        raise _wrong(f"{name}: {key}", table, f"a table, written [{key}]")
    return table


def _rule(name: str, key: str, value: object) -> ColumnRule:
    where = f"{name}: columns.{printable(key)}"
    if key not in CANONICAL and key not in LABELS:
        raise LogError(f"{where} is no column that automarine knows; known are {', '.join([*CANONICAL, *LABELS])}")
    if isinstance(value, str):
        value = {"from": value}
    if not isinstance(value, Mapping):
        example = '{ from = "yaw", unit = "rad", sign = -1 }'
        raise _wrong(where, value, f"the name of a column in quotes, or a table such as {example}")
    for inner in value:
        if inner not in TAKEN:
            raise LogError(f"{where}.{printable(inner)} is not known; a column takes {', '.join(TAKEN)}")
    source = _source(where, value)
    if "unit" not in value and "scale" not in value and (unit := _other_angle(key, source)):
        raise LogError(
            f"{where} takes {quoted(source)}, whose name says {unit}, for {CANONICAL[key].unit}; write "
            f'{{ from = "{printable(source)}", unit = "{unit}{CANONICAL[key].unit[3:]}" }}'
        )
    if key in LABELS and len(value) > 1:
        what = {RUN: "names runs", BY: "names what each row is of"}.get(key, "is a state")
        raise LogError(f"{where} {what}; unit, sign, scale and offset do not apply; leave them out")
    day_first = value.get("day_first")
    if day_first is not None and key != "time":
        raise LogError(f"{where}.day_first goes with time, a column of dates, only; leave it out")
    if day_first is not None and not isinstance(day_first, bool):
        raise _wrong(f"{where}.day_first", day_first, "true or false")
    return ColumnRule(
        source,
        _unit(where, key, value.get("unit")),
        _sign(where, value),
        _number(f"{where}.scale", value.get("scale", 1.0)),
        _number(f"{where}.offset", value.get("offset", 0.0)),
        _number(f"{where}.subtract", value.get("subtract", 0.0)),
        _sign_from(where, value.get("sign_from")),
        day_first,
    )


def _other_angle(key: str, source: str) -> str:
    """The unit of angles that the name of a column tells, where that is not the key's own; else ""."""
    own = CANONICAL[key].unit[:3] if key in CANONICAL and CANONICAL[key].quantity in TURNING else ""
    words = set(re.split(r"[^a-z]+", source.lower()))
    others = {"deg": ("rad", "radians"), "rad": ("deg", "degrees")}
    return "" if own not in others or not words & set(others[own]) else others[own][0]


def _source(where: str, value: Mapping[str, object]) -> str:
    source = value.get("from")
    if not isinstance(source, str) or not source.strip():
        found = "missing" if source is None else _kind(source)
        raise LogError(f"{where}.from is {found}; expected the name of a column in quotes")
    return source.strip()


def _sign_from(where: str, value: object) -> ColumnRule | None:
    """The column that says which way an unsigned one counts, by its name or with its neutral."""
    if value is None:
        return None
    where = f"{where}.sign_from"
    value = {"from": value} if isinstance(value, str) else value
    if not isinstance(value, Mapping) or set(value) - {"from", "subtract", "sign"}:
        example = '{ from = "pwm", subtract = 1500 }'
        raise _wrong(where, value, f"the name of a column in quotes, or a table such as {example}")
    sign, subtract = _sign(where, value), _number(f"{where}.subtract", value.get("subtract", 0.0))
    return ColumnRule(_source(where, value), sign=sign, subtract=subtract)


def _sign(where: str, value: Mapping[str, object]) -> int:
    sign = value.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise _wrong(f"{where}.sign", sign, "1 or -1")
    return int(sign)


def _unit(where: str, key: str, unit: object) -> str | None:
    if unit is None:
        return None
    known = CANONICAL[key].units()
    if not isinstance(unit, str) or (known and unit not in known):
        raise _wrong(f"{where}.unit", unit, " or ".join(known) if known else "a word in quotes")
    return unit


def _number(where: str, value: object) -> float:
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not good or (where.endswith(".scale") and value == 0):
        raise _wrong(where, value, f"a finite number{' other than 0' * where.endswith('.scale')}")
    return float(value)  # type: ignore[arg-type]


def _default(name: str, key: str, value: object) -> float:
    where = f"{name}: defaults.{printable(key)}"
    if key not in KNOWN_DEFAULTS:
        raise LogError(f"{where} is not known; [defaults] takes {listed(KNOWN_DEFAULTS)}")
    good = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0
    if not good:
        raise _wrong(where, value, "a number above 0")
    return value  # type: ignore[return-value]


def _wrong(where: str, value: object, expected: str) -> LogError:
    return LogError(f"{where} is {_kind(value)}; expected {expected}")


def _kind(value: object) -> str:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return f"{value:g}" if isinstance(value, float) or abs(value) < 10**15 else "a huge number"
    return {dict: "a table", list: "a list"}.get(type(value), "no text or number")  # type: ignore[call-overload]
