"""The campaign file that `init` writes and `run` follows: which logs there are, and settings of the commands.

A section has the settings of its command by their names, which are converted as the command line's, and beside them a
few keys of its own: which logs, where moment or force come from. Paths are relative to the file.
"""

import difflib
import glob
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automarine_cli.commands import load
from automarine_cli.dofs import ALL_BUT_YAW, DOFS, PLANAR, YAW
from automarine_cli.errors import AutomarineError, LogError, SettingError
from automarine_cli.pipeline.records import read_mapping
from automarine_cli.text import format_value, listed, printable

if TYPE_CHECKING:
    from automarine_cli.logs import ColumnMap, LogFile
    from automarine_cli.pipeline.records import Source
    from automarine_cli.report.campaign import CampaignStep

LOG_KINDS = {
    "thrusters": "thruster tests", "steps": "step runs", "manoeuvres": "manoeuvres", "validation": "validation runs",
    "runs": "runs",
}  # fmt: skip
"""Of logs, as messages call them."""
OF_MOTION = ("steps", "manoeuvres", "validation")
KEYS = {
    "": ("schema", "title", "seed", "strict", "columns", "columns_of", "can"),
    "vehicle": ("name", "arm_m", "supply_V"),
    "logs": ("thrusters", *OF_MOTION, "join"),
    "thrusters": ("map", "per_test"),
    YAW.name: ("moment",),
    **dict.fromkeys(ALL_BUT_YAW, (*OF_MOTION, "force")),
    PLANAR.name: ("runs", "validation", "force"),
    "tune": ("thrusters",),
}
"""The keys of each section that are no settings of its command."""
COMMAND_OF = {"thrusters": "fit-thrusters", "tune": "tune", **{name: f"fit-{name}" for name in (*DOFS, PLANAR.name)}}
"""The command of each section that has settings of it."""
GIVEN = {"logs", "hold_out", "model", "extended", "columns", "thrusters", "thrusters_per_test", "arm", "strict", "seed",
         "check", "reference"}  # fmt: skip
"""Settings that the campaign as a whole gives its commands."""


class NothingToDoError(AutomarineError):
    """A step of a campaign that has nothing to do, and why."""


EXPECTED: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    **dict.fromkeys(("schema", "title", "name", "map"), ("a text", lambda value: isinstance(value, str))),
    **dict.fromkeys(LOG_KINDS, ("a list of texts", lambda value: isinstance(value, list) and
                                all(isinstance(entry, str) for entry in value))),
    **dict.fromkeys(("moment", "force"), ('"logged" or "thrusters"', lambda value: value in ("logged", "thrusters"))),
    **dict.fromkeys(("arm_m", "supply_V"), ("a number above 0", lambda value: isinstance(value, int | float) and
                                            value is not True and 0 < value < math.inf)),
    **dict.fromkeys(("columns", "can"), ("a table", lambda value: isinstance(value, Mapping))),
    "tune.thrusters": ("true or false", lambda value: isinstance(value, bool)),
}  # fmt: skip
"""What the value of a key must be, and whether it is."""


@dataclass(frozen=True)
class Campaign:
    """A campaign: its file, its sections by name with converted settings, and the column map of its logs."""

    path: Path
    sections: Mapping[str, Mapping[str, Any]]
    columns: "ColumnMap"

    @property
    def title(self) -> str:
        title: str = self.sections[""].get("title") or self.sections["vehicle"].get("name") or self.path.stem
        return title

    @property
    def beside(self) -> "dict[str, Source]":
        """Files that it needs beside its logs, by role: a thruster map, the DBC of CAN logs, the vehicle's gains."""
        every = {
            "thrusters": self.sections["thrusters"].get("map"),
            "dbc": self.columns.database,
            "present": self.sections.get("tune", {}).get("present"),
        }
        return {role: path for role, path in every.items() if path is not None}

    def has(self, step: "CampaignStep") -> bool:
        return step.always or step.section in self.sections

    def every_log(self) -> "list[LogFile]":
        sections = ("logs", *ALL_BUT_YAW, PLANAR.name)
        return [log for section in sections for log in self.logs(section, *LOG_KINDS)]

    def logs(self, section: str, *kinds: str) -> "list[LogFile]":
        """List the logs of these kinds together. Raises SettingError with the key for logs that are not there."""
        from automarine_cli.logs import find_logs, whole_logs

        places: list[str] = []
        for kind in kinds:
            entries = [self._place(entry) for entry in self.sections.get(section, {}).get(kind, ())]
            try:
                places += entries if not entries or find_logs(entries) else []
            except LogError as problem:
                raise SettingError(f"{printable(self.path.name)}: {section}.{kind}: {problem}") from None
        return list(whole_logs(find_logs(places), self.columns)) if places else []

    def _place(self, entry: str) -> str:
        base = str(self.path.parent)
        place = self.path.parent / entry
        if place.exists() or not glob.has_magic(base):
            return str(place)
        return str(Path(glob.escape(base), entry))

    def plan(self, step: "CampaignStep", out: Path) -> dict[str, Any]:
        """Complete the settings of a step's command, with results in `out`. Raises NothingToDoError."""
        from automarine_cli.diagnosis.verdict import NAMED
        from automarine_cli.models.store import DIAGNOSIS

        work, section = load(step.kind.writer), self.sections.get(step.section, {})
        settings = {key: value for key, value in section.items() if key not in KEYS.get(step.section, ())}
        if step.section == "thrusters" and "per_test" in section:
            settings["thrusters_per_test"] = section["per_test"]
        settings |= {key: self.sections[""][key] for key in ("seed", "strict") if key in self.sections[""]}
        motion = YAW.name if step.section == "tune" else step.section
        if step.kind.writer == "check":
            settings |= {"logs": self.every_log(), "columns": self.columns}
        elif step.logs:
            key = "logs" if step.section in ("thrusters", YAW.name) else step.section
            logs = next((logs for kinds in step.logs if (logs := self.logs(key, *kinds))), None)
            if logs is None:
                kinds = " and no ".join(LOG_KINDS[kind] for alternative in step.logs for kind in alternative)
                of_motion = f" of {motion} motion" if key == motion else ""
                raise NothingToDoError(f"the campaign names no {kinds}{of_motion}")
            settings |= {"logs": logs, "columns": self.columns, "hold_out": self.logs(key, "validation")}
        if step.models:
            model = next((place for name in step.models if (place := out / name).is_file()), None)
            if step.final and (model is None or DIAGNOSIS.read(model.with_name(DIAGNOSIS.file)).verdict != NAMED):
                raise NothingToDoError("no effect was named: the fitted model is the final one")
            if model is None:
                raise NothingToDoError(f"it needs the {motion} model, and fit-{motion} gave none")
            settings["model"] = model
        if section.get("moment", section.get("force")) == "thrusters" or section.get("thrusters") is True:
            fitted = out / "thrusters" / "thrusters.json"
            settings["thrusters"] = self.beside.get("thrusters", fitted if fitted.is_file() else None)
            if settings["thrusters"] is None:
                raise NothingToDoError("it needs the thruster map, and fit-thrusters gave none")
            if motion not in ALL_BUT_YAW:
                settings["arm"] = self.sections["vehicle"].get("arm_m")
        return work.settings({key: value for key, value in settings.items() if key in work.names})


def read_campaign(path: Path) -> Campaign:
    """Read a campaign from a TOML file. Raises SettingError with the key's path for an unknown key, a wrong value, or a
    question that is still open, and LogError for a column rule that makes no sense."""
    from automarine_cli.logs.columns import OPEN, column_map, open_questions
    from automarine_cli.report.campaign_file import SCHEMA

    data, name = read_mapping(path), printable(path.name)
    questions = open_questions(data)
    if questions:
        many = len(questions) > 1
        raise SettingError(
            f"{name}: {len(questions)} question{'s are' if many else ' is'} still open: {listed(questions)}; "
            f'write the value{"s" if many else ""} in place of "{OPEN}" (the comment beside each says what was '
            "seen), or delete the line if it does not apply"
        )
    try:
        tables = {key: data.pop(key) for key in list(data) if key in KEYS}
        sections: dict[str, dict[str, Any]] = {"vehicle": {}, "logs": {}, "thrusters": {}, YAW.name: {}}
        for section, table in {**tables, "": data}.items():
            sections[section] = dict(_read(section, table, path.parent))
        top = sections[""]
        if top.get("schema") != SCHEMA:
            raise SettingError(f"schema is {top.get('schema')!r}; expected {SCHEMA!r}")
        _refuse_gaps(sections)
    except SettingError as problem:
        raise SettingError(f"{name}: {problem}") from None
    tables = {key: top[key] for key in ("columns", "columns_of", "can") if key in top}
    join = {"join": sections["logs"].get("join", ())}
    return Campaign(path, sections, column_map({**tables, "logs": join}, name, path.parent))


def _read(section: str, table: object, home: Path) -> Iterable[tuple[str, Any]]:
    """The keys of a section with converted values. Raises SettingError with the key's path."""
    if not isinstance(table, Mapping):
        raise SettingError(f"{section}: found {format_value(table)}, expected a table")
    work = load(COMMAND_OF[section]) if section in COMMAND_OF else None
    keys = [*KEYS[section], *(work.names - GIVEN if work else ()), *(() if section else (key for key in KEYS if key))]
    for key, value in table.items():
        where = f"{section}.{key}".removeprefix(".")
        if key not in keys:
            option = f"--{key}".replace("_", "-")
            called = [str(param.name) for param in (work.own if work else ()) if option in param.opts]
            close = [name for name in called if name in keys] or difflib.get_close_matches(str(key), keys, n=1)
            hint = f"did you mean {format_value(close[0])}?" if close else f"known are {', '.join(keys)}"
            place = f"{section}: " if section else ""
            raise SettingError(f"{place}unknown key {format_value(key)}; {hint}")
        expected, fits = EXPECTED.get(where) or EXPECTED.get(key) or ("", lambda value: True)
        if not fits(value):
            raise SettingError(f"{where}: found {format_value(value)}, expected {expected}")
        if key == "map" and value == "newtons":  # the commands are thrusts
            from automarine_cli.thrusters.map import ThrusterMap

            value = ThrusterMap.of_newtons()
        elif key == "map" or (work and key in work.files and isinstance(value, str)):
            value = home / value
            if not value.is_file():
                raise SettingError(f"{where}: there is no file {printable(value.name)}; give it relative to this file")
        if key in ("seed", "strict"):
            yield key, _converted(load("validate"), key, value, where)
        elif key == "per_test":
            yield key, _converted(load("fit-thrusters"), "thrusters_per_test", value, where)
        elif work is not None and key not in KEYS[section]:
            yield key, _converted(work, key, value, where)
        else:
            yield key, value


def _converted(work: Any, name: str, value: Any, where: str) -> Any:
    """A setting of a command. Raises SettingError with its path in the file."""
    if isinstance(value, Mapping):  # known = { I_r = [915, 50] }, as the command line has it
        parts = {key: part if isinstance(part, list) else [part] for key, part in value.items()}
        value = [f"{key}={'±'.join(map(str, part))}" for key, part in parts.items()]
    try:
        return work.convert(name, value)
    except SettingError as problem:
        why = str(problem)
        begins = why.startswith((f"{name} ", f"{name}:"))
        raise SettingError(where + (why.removeprefix(name) if begins else f": {why}")) from None


def _refuse_gaps(sections: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise SettingError for a campaign without logs, and for commands of thrusters that nothing makes moments of."""
    logs, thrusters, arm = sections["logs"], sections["thrusters"], sections["vehicle"].get("arm_m")
    with_logs = [section for name, section in sections.items() if "steps" in KEYS[name] or "runs" in KEYS[name]]
    if not any(section.get(kind) for section in with_logs for kind in LOG_KINDS if kind != "validation"):
        raise SettingError("logs: no logs are named; give thrusters, steps or manoeuvres")
    if thrusters.get("map") and logs.get("thrusters"):
        raise SettingError("thrusters.map and logs.thrusters are both given; expected one of them")
    if "tune" in sections and not sections["tune"].get("target"):
        raise SettingError("tune.target is missing; give the controller, such as ardusub")
    for name, key in ((YAW.name, "moment"), (PLANAR.name, "force")):
        if sections.get(name, {}).get(key) == "thrusters" and arm is None:
            raise SettingError(f'{name}.{key} is "thrusters", which needs vehicle.arm_m; give it in metres')
    if sections[YAW.name].get("moment") == "thrusters" and not thrusters.get("map") and not logs.get("thrusters"):
        raise SettingError(
            'yaw.moment is "thrusters", which needs logs.thrusters (bollard tests) or thrusters.map; give one of them'
        )
