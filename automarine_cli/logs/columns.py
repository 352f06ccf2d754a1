"""`--columns FILE.toml`: the user's names, units and signs for the canonical columns, and which files are one log."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Literal

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError, SettingError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, ROTATIONS, RUN
from automarine_cli.pipeline.records import Codec, Source, keyed, read_plain
from automarine_cli.pipeline.words import printable, quoted

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
        for other in self.others:
            if other.count("*") not in (0, self.logs.count("*")) or not other or not self.logs:
                raise SettingError(
                    f'join of "{self.logs}" with "{other}": expected as many stars in both, or none in the second; a '
                    "star stands for the same letters in both names"
                )
        if not self.max_age_s > 0:
            raise SettingError(f"max_age_s is {self.max_age_s:g}; expected seconds above 0")

    @property
    def others(self) -> tuple[str, ...]:
        return (self.with_,) if isinstance(self.with_, str) else self.with_

    def places(self, path: Path) -> tuple[Path, ...]:
        """Return where the files joined to the log at `path` should be; none where it is not of those meant."""
        depth = len(PurePosixPath(self.logs).parts)
        stars = "([^/]*)".join(re.escape(part) for part in self.logs.split("*"))
        match = re.fullmatch(stars, "/".join(path.absolute().parts[-depth:]))
        if match is None:
            return ()
        parts = [(other.split("*"), [*match.groups()[: other.count("*")], ""]) for other in self.others]
        base = path.parents[depth - 1] if depth <= len(path.parents) else path.absolute().parents[depth - 1]
        return tuple(base / "".join(text + letters for text, letters in zip(*part)) for part in parts)

    def beside(self, path: Path) -> tuple[Path, ...]:
        """Return the files joined to the log at `path`. Raises LogError for one that is not there."""
        places = self.places(path)
        if lost := next((place for place in places if not place.is_file()), None):
            raise LogError(
                f"{printable(path.name)}: no {printable(lost.name)} beside it, which join expects; copy it there, or "
                "correct the names in join"
            )
        return places


def matches(path: Path, pattern: str) -> bool:
    """Return whether a pattern means a log: its name, the end of its path, or that of a folder it is in."""
    place = PurePosixPath(path.absolute().as_posix())
    return any(part.match(pattern) for part in (place, *place.parents))


TURNING = {quantity for dof in ROTATIONS for quantity in (dof.position, dof.velocity)}
LARGEST_MAP = 200_000  # bytes; a column map is a dozen lines


@dataclass(frozen=True)
class ColumnRule:
    """One line of a column map: value = sign (scale x (the file's value - subtract) + offset), in `unit` (None: the
    name's own).

    With `sign_from` the file's value is a size, and that column (less its own neutral) says which way it counts.
    `day_first` is how dates such as 03/05/2024 are read (None: as the column shows).
    """

    source: str = field(metadata=keyed("from"))
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    offset: float = 0.0
    subtract: float = 0.0
    sign_from: "ColumnRule | None" = None
    day_first: bool | None = None

    def __post_init__(self) -> None:
        if not self.source.strip():
            raise SettingError(f"from is {quoted(self.source)}; expected the name of a column in quotes")
        if self.scale == 0:
            raise SettingError("scale is 0; expected a number other than 0")
        other = self.sign_from
        if other is not None and other != ColumnRule(other.source, sign=other.sign, subtract=other.subtract):
            raise SettingError(
                'sign_from takes from, subtract and sign only, such as { from = "pwm", subtract = 1500 }'
            )

    def read(self, value: float, factor: float = 1.0) -> float:
        """Return what a value of the file's own column stands for; `factor` is that of the rule's unit."""
        return self.sign * (self.scale * (value - self.subtract) + self.offset) * factor

    def written(self, value: float, factor: float = 1.0) -> float:
        """Return a value as the file's own column holds it; `factor` is that of the rule's unit."""
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
    defaults: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    dbc: str = ""
    columns_of: tuple[ColumnsOf, ...] = ()
    join: tuple[Join, ...] = ()

    def of(self, path: Path) -> "ColumnMap":
        """Return the map of one log: that of the first of `columns_of` that means it, else the one of all others."""
        groups = (group for group in self.columns_of if any(matches(path, name) for name in group.logs))
        return next((replace(self, columns=group.columns) for group in groups), self)

    def beside(self, path: Path) -> dict[Path, Join]:
        """Return the files that are joined to a log, and how. Raises LogError for one that is not there."""
        return {other: join for join in reversed(self.join) for other in join.beside(path)}

    @property
    def database(self) -> Path | None:
        return Path(self.dbc) if self.dbc else None

    @property
    def sources(self) -> set[str]:
        """Every column of a file that a rule reads."""
        rules = self.columns.values()
        return {rule.source for rule in rules} | {rule.sign_from.source for rule in rules if rule.sign_from}

    def source_of(self, name: str) -> str:
        """Return the column of the file that a canonical name stands for."""
        return self.columns[name].source if name in self.columns else name


@dataclass(frozen=True)
class _Defaults:
    thrusters_per_test: float | None = None
    arm_m: float | None = None

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if value is not None and not value > 0:
                raise SettingError(f"{key} is {value:g}; expected a number above 0")


@dataclass(frozen=True)
class _Can:
    dbc: str = ""


@dataclass(frozen=True)
class _Logs:
    join: object = ()


@dataclass(frozen=True)
class _Tables:
    """What stands in the file of a column map; rules and joins are read afterwards, as they may be written short."""

    columns: Mapping[str, object] = field(default_factory=dict)
    columns_of: tuple[Mapping[str, object], ...] = ()
    logs: _Logs = field(default_factory=_Logs)
    defaults: _Defaults = field(default_factory=_Defaults)
    can: _Can | None = None


def given_columns(columns: "str | Source | ColumnMap | None") -> ColumnMap:
    """Return the map that a command was given: itself, its file, or none, for logs in the tool's own names."""
    if isinstance(columns, ColumnMap):
        return columns
    return read_column_map(columns) if columns else ColumnMap()


def read_column_map(path: str | Source) -> ColumnMap:
    """Read a column map (TOML with `[columns]`, `[[columns_of]]`, `[logs]`, `[defaults]` and `[can]`). Raises LogError
    with the key's path for an unknown key, a wrong type or a unit that does not fit."""
    path = Path(path) if isinstance(path, str) else path
    name = printable(path.name)
    data = read_plain(path, "TOML", LogError, most=LARGEST_MAP)
    if not any(data.values()):
        raise LogError(f'{name}: the column map is empty; write lines such as heading_deg = "yaw" under [columns]')
    return replace(column_map(data, name, path.parent if isinstance(path, Path) else None), source=name)


def column_map(data: Mapping[str, object], name: str, home: Path | None = None) -> ColumnMap:
    """Return the map in the tables of the file called `name`, whose DBC is named from the folder `home`. Raises
    LogError with the key's path."""
    codec = Codec(name, YAW, LogError)
    tables = codec.read(_Tables, data)
    if tables.can and not tables.can.dbc.strip():
        raise codec.refusal(("can", "dbc"), "found no name, expected the place of a DBC file in quotes")
    groups = []
    for i, group in enumerate(tables.columns_of):
        place, logs = ("columns_of", i), group.get("logs", ())
        logs = codec.value(tuple[str, ...], [logs] if isinstance(logs, str) else logs, (*place, "logs"))
        if not logs:
            raise codec.refusal((*place, "logs"), 'missing; expected the logs that it is of, such as ["bollard/*.csv"]')
        groups.append(ColumnsOf(logs, _rules(codec, {key: group[key] for key in group if key != "logs"}, place)))
    join = [tables.logs.join] if isinstance(tables.logs.join, Mapping) else tables.logs.join
    return ColumnMap(
        columns=_rules(codec, tables.columns, ("columns",)),
        defaults={key: value for key, value in asdict(tables.defaults).items() if value is not None},
        dbc=str((home or Path()).absolute() / tables.can.dbc) if tables.can else "",
        columns_of=tuple(groups),
        join=codec.value(tuple[Join, ...], join, ("logs", "join")),
    )


def column_rules(columns: Mapping[str, object], name: str) -> dict[str, ColumnRule]:
    """Return the rules under `[columns]` of the file called `name`. Raises LogError with the key's path."""
    return _rules(Codec(name, YAW, LogError), columns, ("columns",))


def _rules(codec: Codec, columns: Mapping[str, object], place: tuple[object, ...]) -> dict[str, ColumnRule]:
    return {key: _rule(codec, key, value, (*place, key)) for key, value in columns.items()}


def _rule(codec: Codec, key: str, value: object, place: tuple[object, ...]) -> ColumnRule:
    if key not in CANONICAL and key not in LABELS:
        names = ", ".join([*CANONICAL, *LABELS])
        raise codec.refusal(place, f"no column that automarine knows; known are {names}")
    if not isinstance(value, str | Mapping):
        example = '{ from = "yaw", unit = "rad", sign = -1 }'
        raise codec.refusal(place, f"expected the name of a column in quotes, or a table such as {example}")
    rule = codec.read(ColumnRule, _written_out(value), place)
    canonical = CANONICAL.get(key)
    if canonical is None:
        if rule != ColumnRule(rule.source):
            what = {RUN: "names runs", BY: "names what each row is of"}.get(key, "is a state")
            raise codec.refusal(place, f"{what}; unit, sign, scale and offset do not apply; leave them out")
        return rule
    known = canonical.units()
    if rule.unit is not None and known and rule.unit not in known:
        raise codec.refusal((*place, "unit"), f"found {quoted(rule.unit)}, expected {' or '.join(known)}")
    if rule.unit is None and rule.scale == 1 and canonical.quantity in TURNING:
        angle, words = canonical.unit[:3], set(re.split(r"[^a-z]+", rule.source.lower()))
        unit, called = {"deg": ("rad", {"rad", "radians"}), "rad": ("deg", {"deg", "degrees"})}[angle]
        if words & called:
            mend = f'{{ from = "{printable(rule.source)}", unit = "{unit}{canonical.unit[3:]}" }}'
            why = f"takes {quoted(rule.source)}, whose name says {unit}, for {canonical.unit}; write {mend}"
            raise codec.refusal(place, why)
    if rule.day_first is not None and key != "time":
        raise codec.refusal((*place, "day_first"), "goes with time, a column of dates, only; leave it out")
    return rule


def _written_out(value: object) -> object:
    """A rule as a table, names of columns without blanks around them: the name alone stands for a table as well."""
    if isinstance(value, str):
        return {"from": value.strip()}
    if isinstance(value, Mapping):
        parts = {"from": lambda name: name.strip() if isinstance(name, str) else name, "sign_from": _written_out}
        return {key: parts.get(key, lambda part: part)(part) for key, part in value.items()}
    return value
