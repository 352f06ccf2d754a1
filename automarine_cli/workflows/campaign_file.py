"""The campaign file that `init` writes and `run` follows: plain data, paths relative to the file itself."""

import glob
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Any, Literal

from automarine_cli.dofs import DOFS, SURGE, TRANSLATIONS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import LogError, SettingError
from automarine_cli.fits.known import Known
from automarine_cli.fits.tails import asked_tail
from automarine_cli.logs import ColumnMap, LogFile, column_rules, find_logs, whole_logs
from automarine_cli.logs.columns import columns_of, database
from automarine_cli.logs.join import Join
from automarine_cli.pipeline.records import everything, from_mapping, in_words, read_mapping
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.runs.channels import AUTO, wanted_channels
from automarine_cli.workflows.tune_options import TuneSection

SCHEMA = "automarine/campaign/1"
OPEN = "?"  # a value that a person still has to give
Beforehand = Mapping[str, float | tuple[float, float]]
"""Parameters that are known beforehand, by name: a value, or one and its standard error."""


@dataclass(frozen=True)
class Vehicle:
    """What is known of the vehicle: lever arm of its two thrusters [m], supply voltage [V]."""

    name: str = ""
    arm_m: float | None = None
    supply_V: float | None = None

    def __post_init__(self) -> None:
        for key in ("arm_m", "supply_V"):
            value = getattr(self, key)
            if value is not None and value <= 0:
                raise SettingError(f"{key} is {value:g}; expected a number above 0")


KINDS = ("thrusters", "steps", "manoeuvres", "validation")
"""Of the logs under `[logs]`."""


@dataclass(frozen=True)
class Logs:
    """Files, folders and globs of each kind of log; `join` says which files are one log, as in a column map."""

    thrusters: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()
    manoeuvres: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    join: Join | tuple[Join, ...] = ()


@dataclass(frozen=True)
class Thrusters:
    """How the bollard tests are read; `map` is a thruster map that is at hand instead of tests."""

    per_test: int | None = None
    form: str = "auto"
    map: str | None = None

    def __post_init__(self) -> None:
        if self.per_test is not None and self.per_test < 1:
            raise SettingError(f"per_test is {self.per_test}; expected 1 or more thrusters")


@dataclass(frozen=True)
class Yaw:
    """Where the moment comes from, what of the runs is fitted, from which turned angle [degrees] on a half-turn is
    taken for steady, and which sensors count (`runs.channels`)."""

    moment: Literal["logged", "thrusters"] = "logged"
    fit_to: Literal["auto", "half-turns", "whole-runs"] = "auto"
    tail: float | None = None
    channels: str = AUTO
    known: Beforehand = field(default_factory=dict)

    def __post_init__(self) -> None:
        asked_tail(self.tail, YAW)
        Known.of(self.known)

    @property
    def logged(self) -> bool:
        """Whether the logs hold the moment itself."""
        return self.moment == "logged"


@dataclass(frozen=True)
class Force:
    """Logs of a translation, where their force comes from, what of the runs is fitted, from which distance [m] on a
    step is taken for steady, and which sensors count."""

    steps: tuple[str, ...] = ()
    manoeuvres: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    force: Literal["logged", "thrusters"] = "logged"
    fit_to: Literal["auto", "steps", "whole-runs"] = "auto"
    tail: float | None = None
    channels: str = AUTO
    known: Beforehand = field(default_factory=dict)

    def __post_init__(self) -> None:
        asked_tail(self.tail, SURGE)
        Known.of(self.known)

    @property
    def logged(self) -> bool:
        """Whether the logs hold the force itself."""
        return self.force == "logged"


@dataclass(frozen=True)
class Followed(Force):
    """How far a step is followed [m], before the wall is felt."""

    within: float | None = None


@dataclass(frozen=True)
class Windowed(Force):
    """Between which depths [m] a step is followed."""

    depths: tuple[float, float] | None = None


@dataclass(frozen=True)
class Together:
    """Logs of surge, sway and yaw together, and where their forces come from."""

    runs: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    force: Literal["logged", "thrusters"] = "logged"
    known: Beforehand = field(default_factory=dict)

    def __post_init__(self) -> None:
        Known.of(self.known)

    @property
    def logged(self) -> bool:
        """Whether the logs hold the forces themselves."""
        return self.force == "logged"


@dataclass(frozen=True)
class Settings:
    """A campaign: its logs, how to read them, and the settings of the steps; those of translations are added below."""

    schema: str
    logs: Logs = Logs()
    title: str = ""
    vehicle: Vehicle = Vehicle()
    columns: Mapping[str, object] = field(default_factory=dict)
    columns_of: tuple[Mapping[str, Any], ...] = ()
    can: Mapping[str, object] = field(default_factory=dict)
    thrusters: Thrusters = Thrusters()
    yaw: Yaw = Yaw()
    planar: Together | None = None
    tune: TuneSection | None = None
    seed: int = 0
    strict: bool = False

    def __post_init__(self) -> None:
        if self.schema != SCHEMA:
            raise SettingError(f"schema is {self.schema!r}; expected {SCHEMA!r}")
        if self.seed < 0:
            raise SettingError(f"seed is {self.seed}; expected 0 or more")
        sections: dict[str, Yaw | Force] = {YAW.name: self.yaw, **self.forces}
        for motion, one in sections.items():
            wanted_channels(one.channels, DOFS[motion], f"{motion}.channels")
        of_forces = [one.steps or one.manoeuvres for one in self.forces.values()]
        of_forces += [self.planar.runs] if self.planar else []
        if not any((self.logs.thrusters, self.logs.steps, self.logs.manoeuvres, *of_forces)):
            raise SettingError("logs: no logs are named; give thrusters, steps or manoeuvres")
        if self.thrusters.map is not None and self.logs.thrusters:
            raise SettingError("thrusters.map and logs.thrusters are both given; expected one of them")
        if self.yaw.moment == "thrusters":
            if self.vehicle.arm_m is None:
                raise SettingError('yaw.moment is "thrusters", which needs vehicle.arm_m; give it in metres')
            if self.thrusters.map is None and not self.logs.thrusters:
                raise SettingError(
                    'yaw.moment is "thrusters", which needs logs.thrusters (bollard tests) or '
                    "thrusters.map; give one of them"
                )
        if self.planar is not None and not self.planar.logged and self.vehicle.arm_m is None:
            raise SettingError('planar.force is "thrusters", which needs vehicle.arm_m; give it in metres')

    @property
    def forces(self) -> dict[str, Force]:
        """The translations that the campaign has logs of, by name."""
        sections = {name: getattr(self, name, None) for name in TRANSLATIONS}
        return {name: one for name, one in sections.items() if one is not None}


def _section(dof: Dof) -> tuple[str, Any, Any]:
    """The field of a translation: its table, if the campaign has one."""
    return dof.name, (Windowed if dof.windowed else Followed) | None, field(default=None)


CampaignFile = make_dataclass(
    "CampaignFile",
    map(_section, TRANSLATIONS.values()),
    bases=(Settings,),
    frozen=True,
    namespace={"__module__": __name__},
)
"""`Settings` with a table for each translation."""


@dataclass(frozen=True)
class Campaign:
    """A campaign as `run` needs it: the settings, the column map, and where the logs are."""

    path: Path
    asked: Settings
    columns: ColumnMap

    @property
    def title(self) -> str:
        """What the report is called."""
        return self.asked.title or self.asked.vehicle.name or self.path.stem

    @property
    def map(self) -> Path | None:
        """The thruster map that is at hand, if one is."""
        return None if self.asked.thrusters.map is None else self.path.parent / self.asked.thrusters.map

    @property
    def forces(self) -> dict[str, Force]:
        """The translations that the campaign has logs of, by name."""
        return self.asked.forces

    def settings(self, motion: str) -> Yaw | Force | Together:
        """The settings of a motion that the campaign has."""
        if self.asked.planar is not None and motion == PLANAR.name:
            return self.asked.planar
        return self.asked.yaw if motion == YAW.name else self.forces[motion]

    @property
    def beside(self) -> dict[str, Path]:
        """Files that it needs beside its logs, by role: a thruster map, the DBC of CAN logs, the vehicle's gains."""
        own = self.asked.tune.present if self.asked.tune else None
        present = None if own is None else self.path.parent / own
        every = {"thrusters": self.map, "dbc": self.columns.database, "present": present}
        return {role: path for role, path in every.items() if path is not None}

    def every_log(self) -> list[LogFile]:
        """The logs of all kinds and motions."""
        found = self.files(*KINDS)
        for motion in self.forces:
            found += self.files("steps", "manoeuvres", "validation", motion=motion)
        if self.asked.planar:
            found += self.files("runs", "validation", motion=PLANAR.name)
        return found

    def files(self, *kinds: str, motion: str = YAW.name) -> list[LogFile]:
        """The logs of these kinds together, of one `motion`. Raises SettingError with the key for logs that are not
        there."""
        found: list[str] = []
        key = "logs" if motion == YAW.name else motion
        section = getattr(self.asked, key)
        for kind in kinds:
            places = [self._place(one) for one in getattr(section, kind)]
            try:
                found += places if not places or find_logs(places) else []
            except LogError as problem:
                raise SettingError(f"{printable(self.path.name)}: {key}.{kind}: {problem}") from None
        return list(whole_logs(find_logs(found), self.columns)) if found else []

    def _place(self, entry: str) -> str:
        base = str(self.path.parent)
        whole = self.path.parent / entry
        if whole.exists() or not glob.has_magic(base):
            return str(whole)
        return str(Path(glob.escape(base), entry))


def read_campaign(path: Path) -> Campaign:
    """The campaign in a TOML file.

    Raises SettingError with the key's path for an unknown key, a value of the wrong type, or a question that is
    still open, and LogError for a column rule that makes no sense.
    """
    data = read_mapping(path)
    name = printable(path.name)
    open_still = open_questions(data)
    if open_still:
        many = len(open_still) > 1
        raise SettingError(
            f"{name}: {len(open_still)} question{'s are' if many else ' is'} still open: {listed(open_still)}; "
            f'write the value{"s" if many else ""} in place of "{OPEN}" (the comment beside each says what was '
            "seen), or delete the line if it does not apply"
        )
    asked: Settings = from_mapping(CampaignFile, data, name)
    join = asked.logs.join if isinstance(asked.logs.join, tuple) else (asked.logs.join,)
    own = columns_of(asked.columns_of, name)
    return Campaign(
        path, asked, ColumnMap(column_rules(asked.columns, name), {}, "", database(asked.can, path), own, join)
    )


def open_questions(data: object) -> list[str]:
    """Paths of the keys whose value is still a question mark."""
    places: Iterable[tuple[object, ...]] = (place for value, place in everything(data) if value == OPEN)
    return [in_words(place).removesuffix(": ") for place in places]
