"""The columns that automarine knows, by canonical name, and the user's own names for them (`--columns FILE.toml`)."""

import difflib
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from automarine_cli.dofs import DOFS, HEAVE, PITCH, YAW, Dof, Motion
from automarine_cli.dofs.dof import DEGREE
from automarine_cli.errors import LogError, SettingError
from automarine_cli.pipeline.records import Codec, Source, everything, keyed, read_plain
from automarine_cli.text import in_words, listed, printable, quoted

STANDARD_GRAVITY = 9.80665  # m/s², exact by definition: 1 kgf in newtons
POUND_FORCE = 4.4482216152605  # N, exact by definition

NORMALISED = "nu"  # the unit of a normalised moment or force
TIMESTAMP = "timestamp"  # the unit of a column of calendar times

FORCES = {"N": 1.0, "kgf": STANDARD_GRAVITY, "gf": STANDARD_GRAVITY / 1000, "lbf": POUND_FORCE}
TORQUES = {"N m": 1.0, "Nm": 1.0}
ANGLES, ANGULAR_RATES = {"deg": DEGREE, "rad": 1.0}, {"deg/s": DEGREE, "rad/s": 1.0}
LENGTHS, SPEEDS = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "ft": 0.3048}, {"m/s": 1.0, "cm/s": 0.01, "kn": 1852 / 3600}
VELOCITIES = ("surge", "sway", "heave")  # of the vehicle's body, which tests of every motion may log
PLACES = ("north", "east", "lat", "lon")  # on the water, which logs of motion in the plane may hold
ELEVATOR = "elevator"
FLAT_FINNED = (HEAVE, PITCH)
"""A fin that lies flat, and the motions of which it is the rudder."""
ROTATIONS = tuple(dof for dof in DOFS.values() if dof.angular)


@dataclass(frozen=True)
class Signal:
    """A logged quantity that effects read: the unit of each of its `columns`, SI factors of all `units`, the `words`
    by which people call it. Tests make it from its `usual` value, how far it goes to both sides of that (`swing`) and
    its `sign` in a mirrored run, -1 of what changes sides. What is `commanded` acts as late as commands do."""

    columns: Mapping[str, str]
    units: Mapping[str, float]
    usual: float
    swing: float
    sign: int = 1
    words: tuple[str, ...] = ()
    commanded: bool = False


SIGNALS: Mapping[str, Signal] = {
    "voltage": Signal(
        {"voltage_V": "V"}, {"V": 1.0, "mV": 1e-3}, 12.0, 1.9,
        words=("voltage", "volts", "battery_voltage", "vbat", "battery", "bat", "nominal_voltage_v"),
    ),
    "rudder": Signal(
        {"rudder_deg": "deg", "rudder_rad": "rad"}, ANGLES, 0.0, 0.5, -1,
        words=("rudder", "rudder_deg", "rudder_rad", "rudder_angle", "steering_angle", "fin"),
        commanded=True,
    ),
    "surge": Signal({"surge_m_s": "m/s"}, SPEEDS, 0.0, 0.4),
    "sway": Signal({"sway_m_s": "m/s"}, SPEEDS, 0.0, 0.2, -1),
    "force_X": Signal({}, FORCES, 0.0, 0.6, commanded=True),  # its columns are those of surge's command
}  # fmt: skip
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, TIMESTAMP: 1.0},
    "force": FORCES,
    **{quantity: signal.units for quantity, signal in SIGNALS.items()},
    ELEVATOR: ANGLES,
    **dict.fromkeys(VELOCITIES, SPEEDS),
    **dict.fromkeys(PLACES[:2], LENGTHS),
    "lat": {"deg": DEGREE},
    "lon": {"deg": DEGREE},
    **{
        quantity: units
        for dof in DOFS.values()
        for quantity, units in zip(
            (dof.position, dof.velocity, dof.command),
            (ANGLES, ANGULAR_RATES, TORQUES) if dof.angular else (LENGTHS, SPEEDS, FORCES),
        )
    },
}
MAX_LOOKED_AT, LONGEST_GUESSED = 1000, 60  # columns, and characters of a name, in which one may be guessed
# control signals keep the file's own unit
THRUSTERS = ("n", *dict.fromkeys(name for dof in DOFS.values() for name in dof.thrusters))

# Units of control signals, and the words in names of columns that tell them
SIGNAL_UNITS = {
    "us": ("us", "usec", "microseconds", "pwm", "pulse"),
    "rpm": ("rpm",),
    "rev/s": ("rps", "rev_s", "hz"),
    "%": ("percent", "pct", "perc", "%"),
}


PULSES = (800, 1500, 2200)  # us: shortest, neutral, longest pulse of a hobby servo or thruster
EVERY_PULSE = (500, 2500)  # us, which some drivers take


def unit_in(name: str) -> str:
    """The unit of a control signal that the name of its column tells, "" for none."""
    plain = f"_{re.sub(r'[^a-z0-9%]+', '_', name.lower())}_".replace("%", "_%_")
    return next((unit for unit, words in SIGNAL_UNITS.items() if any(f"_{word}_" in plain for word in words)), "")


@dataclass(frozen=True)
class Canonical:
    name: str
    quantity: str
    unit: str

    def factor(self, unit: str | None = None) -> float:
        """What a value is multiplied by to be in SI units (a control signal: 1)."""
        unitless = self.quantity in THRUSTERS or self.unit == NORMALISED
        return 1.0 if unitless else UNITS[self.quantity][unit or self.unit]

    def units(self) -> tuple[str, ...]:
        """Units that a column map may give to this column; empty: any word."""
        if self.unit == NORMALISED:  # normalised moments and forces have no factor to newtons
            return (NORMALISED,)
        return tuple(UNITS.get(self.quantity, ()))


def _of_motions(dofs: Collection[Dof], *quantities: str) -> Iterator[tuple[str, str, str]]:
    """The columns of these quantities ("position", ...) and the thrusters of motions: names, what they hold, units."""
    of_each = [(getattr(dof, which), dof) for which in quantities for dof in dofs]
    yield from ((name, quantity, unit) for quantity, dof in of_each for name, unit in dof.columns[quantity])
    yield from ((name, name, "") for dof in dofs for name in dof.thrusters)


_ALL = (
    ("time_s", "time", "s"),
    ("time_ms", "time", "ms"),
    ("time_us", "time", "us"),
    ("time", "time", TIMESTAMP),
    *_of_motions([YAW], "position", "velocity", "command"),
    *((name, quantity, unit) for quantity, signal in SIGNALS.items() for name, unit in signal.columns.items()),
    *((f"{ELEVATOR}_{unit}", ELEVATOR, unit) for unit in ANGLES),
    *((f"{name}_m_s", name, "m/s") for name in VELOCITIES),
    *_of_motions([dof for dof in DOFS.values() if not dof.angular], "velocity", "position", "command"),
    *_of_motions([dof for dof in ROTATIONS if dof is not YAW], "position", "velocity", "command"),
    ("north_m", "north", "m"),
    ("east_m", "east", "m"),
    ("lat_deg", "lat", "deg"),
    ("lon_deg", "lon", "deg"),
    ("n", "n", ""),
    ("force_N", "force", "N"),
    ("force_kgf", "force", "kgf"),
    ("force_lbf", "force", "lbf"),
)
CANONICAL: Mapping[str, Canonical] = {name: Canonical(name, *rest) for name, *rest in _ALL}
RUN, MODE, ARMED, BY = "run", "mode", "armed", "by"
LABELS = (RUN, MODE, ARMED, BY)  # columns of words, not of numbers


def foreign(dof: Dof, motion: Motion | None, quantities: Set[str]) -> frozenset[str]:
    """Names of columns of other motions than `dof` or `motion`, under which a log may hold something else. A thrust in
    newtons is none where a log holds a rudder among its `quantities`, which may stand in the race of that thrust."""
    names = {dof.position, dof.velocity, dof.command, *dof.thrusters}
    if motion is not None:
        names |= {name for member in motion.dofs for name in (member.velocity, member.command)} | set(PLACES)
    strangers = {name for member in DOFS.values() for name in (member.position, member.command, *member.thrusters)}
    aside = {member.velocity for member in DOFS.values() if not member.horizontal}
    strangers = (strangers | aside | set(PLACES)) - names
    raced = SIGNALS.keys() if "rudder" in quantities else ()
    return frozenset(
        name for name, of in CANONICAL.items()
        if of.quantity in strangers and (of.quantity not in raced or of.unit == NORMALISED)
    )  # fmt: skip


def motions_in(quantities: Set[str]) -> list[Dof]:
    """List the motions of which a log with these quantities is whole, those with a command first; of roll or pitch
    alone it needs none."""
    complete = [
        dof
        for dof in DOFS.values()
        if dof.position in quantities and (dof.command in quantities or driven(dof, quantities))
    ]
    if not any(dof.position in quantities for dof in DOFS.values() if not dof.restoring):  # a free decay has no command
        complete = [dof for dof in DOFS.values() if dof.position in quantities]
    places = {dof.position: i for i, dof in reversed(list(enumerate(complete)))}
    return sorted(complete, key=lambda dof: (places[dof.position], dof.command not in quantities))


def quantities_of(names: Iterable[str]) -> set[str]:
    return {CANONICAL[name].quantity for name in names if name in CANONICAL}


def driven(dof: Dof, quantities: Set[str]) -> bool:
    return bool(dof.thrusters) and quantities >= set(dof.thrusters)


def motion_of(names: Iterable[str], mapped: Iterable[str]) -> Dof:
    """The motion that a log is of, by its column names and the canonical names mapped to; yaw where it may be that."""
    quantities = quantities_of((*names, *mapped))
    begun = (dof for dof in DOFS.values() if {dof.position, dof.command} & quantities)
    return next(iter(motions_in(quantities)), None) or next(begun, YAW)


# Words by which people call a quantity, the usual one first.
WORDS: Mapping[str, Sequence[str]] = {
    "time": ("t", "time", "timestamp", "seconds", "secs", "clock", "stamp", "millis", "zeit", "uhrzeit", "datetime"),
    "n": ("n", "cmd", "command", "n_rev_s", "effort", "throttle", "thruster_input", "pwm", "rpm", "esc", "pulse"),
    "force": ("force", "thrust", "load", "newtons", "pull", "mean_force", "total_force"),
    **{quantity: signal.words for quantity, signal in SIGNALS.items()},
    ELEVATOR: ("elevator", "elevator_angle", "stern_plane", "sternplane", "stern_plane_angle", "fin", "fin_angle"),
    **{
        quantity: [
            word
            for called in ("plain_names", "nicknames")
            for other in DOFS.values()
            for word in getattr(other, called).get(quantity, ())
        ]
        for dof in DOFS.values()
        for quantity in (*dof.plain_names, *dof.nicknames)
    },
}


_CALLED = {
    "n": "control signal",
    **{dof.command: dof.words.full_force for dof in DOFS.values()},
    **{name: f"{name} speed" for name in VELOCITIES},
    **{name: f"{mount} thruster command" for dof in DOFS.values() for name, mount in zip(dof.thrusters, dof.mounts)},
}


def called(quantity: str) -> str:
    return _CALLED.get(quantity, quantity.replace("_", " "))


def names_of(quantity: str) -> tuple[str, ...]:
    return tuple(name for name, canonical in CANONICAL.items() if canonical.quantity == quantity)


RATE_WORDS = ("rate", "speed", "velocity", "vel", "gyro", "radps", "dps", "radsec", "degps")
"""Words in names of columns that are how fast something changes, and so no position."""
WISH_WORDS = {
    "setpoint", "sp", "ref", "reference", "cmd", "command", "desired", "des", "target", "goal", "demand", "err",
    "error",
}  # fmt: skip
"""Words in names of columns that hold what a motion should be, or what is left to it."""
SWING_DOFS = tuple(dof for dof in DOFS.values() if dof.restoring)  # words in names of their columns begin with theirs


def other_axis(name: str, quantity: str = "") -> bool:
    """Whether a name is of roll or pitch, and the `quantity` that is looked for is not."""
    axes = tuple(dof.name for dof in SWING_DOFS if quantity not in (dof.position, dof.velocity, dof.command))
    return any(word.startswith(axes) for word in re.split(r"[^a-z]+", name.lower()))


def likely_column(quantity: str, names: Iterable[str]) -> str | None:
    """Suggest the column that may be meant by a quantity, by its usual words first; None for nothing near."""
    words = (*WORDS.get(quantity, ()), *(name.lower() for name in names_of(quantity)))
    moved = [dof for dof in DOFS.values() if quantity in (dof.position, dof.velocity)]
    aside = {*(WISH_WORDS if moved else ()), *(RATE_WORDS if quantity in {dof.position for dof in moved} else ())}
    plain_words = {word for dof in moved for word in dof.plain_names.get(quantity, ())} - {"psi"}  # a pressure too
    best, score = None, 0.75
    for name in islice(names, MAX_LOOKED_AT):
        if len(name) > LONGEST_GUESSED:
            continue
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
        if other_axis(name, quantity) or aside & set(plain.split("_")):
            continue
        alike = [difflib.SequenceMatcher(None, plain, word).ratio() for word in words]
        likeness = max(alike) - 1e-6 * alike.index(max(alike))
        if any(len(word) > 2 and plain.startswith(word + "_") for word in words):
            likeness = max(likeness, 0.9)
        elif any(f"_{word}_" in f"_{plain}_" for word in plain_words):  # imu.yaw
            likeness = max(likeness, 0.85)
        if plain and likeness > score:
            best, score = name, likeness
    return best


def likely_canonical(quantity: str, column: str) -> str:
    """The canonical name to propose for a column of the file, with the unit that its name shows."""
    choices, words = names_of(quantity), ("rad", "deg", "kgf", "lbf", "ms", "milli", "us", "Nm")
    endings = ("_ms" if word == "milli" else f"_{word}" for word in words if word.lower() in column.lower())
    return next((name for end in endings for name in choices if name.endswith((end, f"{end}_s"))), choices[0])


MAX_COMMAND_AGE_S = 5.0  # s; a command older than this is none


@dataclass(frozen=True)
class Join:
    """Each of `logs` (a name or the end of a path) is one log `with_` the files with the same letters for its stars.
    Their columns come onto its clock: the previous value, or the nearest, no further than `max_age_s` [s]."""

    logs: str
    with_: str | tuple[str, ...]
    take: Literal["previous", "nearest"] = "previous"
    max_age_s: float = MAX_COMMAND_AGE_S

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
        pattern = re.escape(self.logs).replace(r"\*", "([^/]*)")
        match = re.fullmatch(pattern, "/".join(path.absolute().parts[-depth:]))
        base = path.absolute().parents[depth - 1]
        return () if match is None else tuple(base / _filled(other, match.groups()) for other in self.others)

    def beside(self, path: Path) -> tuple[Path, ...]:
        """Return the files joined to the log at `path`. Raises LogError for one that is not there."""
        places = self.places(path)
        if lost := next((place for place in places if not place.is_file()), None):
            raise LogError(
                f"{printable(path.name)}: no {printable(lost.name)} beside it, which join expects; copy it there, or "
                "correct the names in join"
            )
        return places


def _filled(pattern: str, letters: Iterable[str]) -> str:
    remaining = iter(letters)
    return re.sub(r"\*", lambda _: next(remaining), pattern)


def matches(path: Path, pattern: str) -> bool:
    """Whether a pattern means a log: its name, the end of its path, or that of a folder it is in."""
    return any(part.match(pattern) for part in (path.absolute(), *path.absolute().parents))


OPEN = "?"  # a value that a person still has to give
LARGEST_MAP = 200_000  # bytes; a column map is a dozen lines


@dataclass(frozen=True)
class ColumnRule:
    """One line of a column map: value = sign (scale x (the file's value - subtract) + offset), in `unit` (None: the
    name's). With `sign_from` the file's value is a size, and that column says its sign. `plus` are columns to add, each
    with its scale and what is subtracted; the sum is multiplied by each of `times`. `day_first` is how dates are
    read."""

    source: str = field(metadata=keyed("from"))
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    offset: float = 0.0
    subtract: float = 0.0
    sign_from: "ColumnRule | None" = None
    plus: tuple["ColumnRule", ...] = ()
    times: tuple[str, ...] = ()
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

    @property
    def sources(self) -> tuple[str, ...]:
        """Columns of the file that its value is made of."""
        return (self.source, *(rule.source for rule in self.plus), *self.times)

    @property
    def of_one(self) -> bool:
        """Whether a single column of the file holds the value, so that it can be written as well."""
        return self.sign_from is None and len(self.sources) == 1

    def read(self, value: float, factor: float = 1.0) -> float:
        """What a value of the file's own column stands for; `factor` is that of the rule's unit."""
        return self.sign * (self.scale * (value - self.subtract) + self.offset) * factor

    def written(self, value: float, factor: float = 1.0) -> float:
        """Return a value as the file's own column holds it; `factor` is that of the rule's unit."""
        return (self.sign * value / factor - self.offset) / self.scale + self.subtract


@dataclass(frozen=True)
class ColumnsOf:
    """The column map of some logs: names or ends of paths in which a star stands for any letters."""

    logs: tuple[str, ...]
    columns: Mapping[str, ColumnRule]


@dataclass(frozen=True)
class ColumnMap:
    """Rules by canonical name, defaults for settings, the path of the DBC of CAN captures (or ""); `columns_of` are
    logs with a map of their own, `join` says which files are one log. `ColumnMap()` takes every name as it stands."""

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
        return {name for rule in rules for name in rule.sources} | {
            rule.sign_from.source for rule in rules if rule.sign_from
        }

    def source_of(self, name: str) -> str:
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
    """Read a column map (TOML). Raises LogError with the key's path for a wrong key, type or unit."""
    path = Path(path) if isinstance(path, str) else path
    name = printable(path.name)
    data = read_plain(path, "TOML", LogError, most=LARGEST_MAP)
    if str(data.get("schema")).startswith("automarine/campaign/"):
        data = _of_campaign(data, name)
    if not any(data.values()):
        raise LogError(f'{name}: the column map is empty; write lines such as heading_deg = "yaw" under [columns]')
    return replace(column_map(data, name, path.parent if isinstance(path, Path) else None), source=name)


def open_questions(data: object) -> list[str]:
    """The keys of a campaign that a person still has to answer."""
    return [in_words(place).removesuffix(": ") for value, place in everything(data) if value == OPEN]


def _of_campaign(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The column map in a campaign file, with its arm and thrusters for each test; its other settings are not read."""
    tables = {key: data[key] for key in ("columns", "columns_of", "can") if key in data}
    parts = (data.get(key) for key in ("logs", "thrusters", "vehicle"))
    logs, thrusters, vehicle = (part if isinstance(part, Mapping) else {} for part in parts)
    tables |= {"logs": {"join": logs["join"]}} if "join" in logs else {}
    pairs = (("arm_m", vehicle.get("arm_m")), ("thrusters_per_test", thrusters.get("per_test")))
    if questions := open_questions(tables):
        raise LogError(f'{name}: {listed(questions)} still open; write the values in place of "{OPEN}"')
    return tables | {"defaults": {key: value for key, value in pairs if value not in (None, OPEN)}}


def column_map(data: Mapping[str, object], name: str, home: Path | None = None) -> ColumnMap:
    """The map in the tables of the file called `name`, whose DBC is named from the folder `home`. Raises LogError."""
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
    """The rules under `[columns]` of the file called `name`. Raises LogError with the key's path."""
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
    rule = codec.read(ColumnRule, _summed(codec, _written_out(value), place), place)
    canonical = CANONICAL.get(key)
    if canonical is None:
        if rule != ColumnRule(rule.source):
            raise codec.refusal(place, "a column of words; unit, sign, scale and offset do not apply; leave them out")
        return rule
    units = canonical.units()
    if rule.unit is not None and units and rule.unit not in units:
        raise codec.refusal((*place, "unit"), f"found {quoted(rule.unit)}, expected {' or '.join(units)}")
    turning = (quantity for dof in ROTATIONS for quantity in (dof.position, dof.velocity))
    if rule.unit is None and rule.scale == 1 and canonical.quantity in turning:
        angle, words = canonical.unit[:3], set(re.split(r"[^a-z]+", rule.source.lower()))
        unit, called = {"deg": ("rad", {"rad", "radians"}), "rad": ("deg", {"deg", "degrees"})}[angle]
        if words & called:
            mend = f'{{ from = "{printable(rule.source)}", unit = "{unit}{canonical.unit[3:]}" }}'
            why = f"takes {quoted(rule.source)}, whose name says {unit}, for {canonical.unit}; write {mend}"
            raise codec.refusal(place, why)
    if rule.day_first is not None and key != "time":
        raise codec.refusal((*place, "day_first"), "goes with time, a column of dates, only; leave it out")
    return rule


def _summed(codec: Codec, value: object, place: tuple[object, ...]) -> object:
    """A rule with `plus` for the columns after the first of a list; scale and subtract are lists, or alike for all."""
    if not isinstance(value, Mapping):
        return value
    if "plus" in value:
        raise codec.refusal(place, 'unknown key "plus"; write the columns as a list, such as from = ["left", "right"]')
    table = {**value, "times": [value["times"]]} if isinstance(value.get("times"), str) else dict(value)
    sources = table.get("from")
    if not isinstance(sources, list):
        return table
    names = [name.strip() for name in codec.value(tuple[str, ...], sources, (*place, "from"))]
    lists: dict[str, Sequence[object]] = {"from": names}
    for key in ("scale", "subtract"):
        if key in table:
            numbers = table[key] if isinstance(table[key], list) else [table[key]] * len(names)
            if len(numbers) != len(names):
                trouble = f"found {len(numbers)} numbers for {len(names)} columns; expected one each, or one for all"
                raise codec.refusal((*place, key), trouble)
            lists[key] = numbers
    rules = [dict(zip(lists, values)) for values in zip(*lists.values())]
    if not rules:
        raise codec.refusal((*place, "from"), "found no column, expected one or more names in quotes")
    return table | rules[0] | {"plus": rules[1:]}


def _written_out(value: object) -> object:
    """A rule as a table, names of columns without blanks around them: the name alone stands for a table as well."""
    if not isinstance(value, Mapping):
        return {"from": value.strip()} if isinstance(value, str) else value
    table = {**value, "from": value["from"].strip()} if isinstance(value.get("from"), str) else dict(value)
    return table | ({"sign_from": _written_out(value["sign_from"])} if "sign_from" in value else {})
