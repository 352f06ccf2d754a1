"""Models from files: `yaw_model.json` of a yaw fit, `thrusters.json` of a thruster fit; all of it checked."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from automarine_cli import effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import ModelError
from automarine_cli.models.thruster_map import ThrusterMap
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel
from automarine_cli.pipeline.plain_data import read_plain
from automarine_cli.pipeline.plain_data import told as _told
from automarine_cli.pipeline.words import LONGEST, printable

SCHEMA = "automarine/yaw-model/1"
SMALLEST, LARGEST = 1e-30, 1e30  # of any number: beyond it arithmetic overflows
DRAG_NAMES = {"linear-drag": "k_r", "quadratic-drag": "k_rr"}
LATEST_SWITCH = 0.5  # of a sample interval: beyond it another sample would show the command first
# What `fit-yaw` and `diagnose` write; of it `_READ` is read. Any other key is a slip of somebody's hand.
_READ = ("schema", "models", "preferred", "moment_unit", "switch_offset", "effects")
_TOP = (
    *_READ,
    *(
        "fitted_to",
        "preferred_because",
        "inertial_turn_angle_rad",
        "gain_scatter",
        "heading_noise_deg",
        "valid_range",
    ),
    *("warnings", "runs", "parent", "notes"),
)
_MODEL = (
    *("I_r", "k_rr", "k_r", "inertial_turn_angle_rad", "output_error", "velocity_error", "sse", "why"),
    *("warnings", "notes"),
)
CONSTANT, DIFFERENCE = "constant_force", "half_difference"
"""Keys of what only translations have: the constant force, and half the difference of drag between the two ways."""
ON_FORCE = ("buoyancy",)
_EFFECT = ("name", "parameters", "says", "confidence", "p_value", "rivals")


@dataclass(frozen=True)
class StoredModels:
    """The yaw models of one file, by number, each with the file's effects already in it.

    `preferred` is the number of the model that the fit prefers; `moment_unit` is "nu" or "N m";
    `switch_offset` is the share of a sample interval by which commands act later than the middle of the
    interval before the sample that first shows them (the logger's convention); `source` is the file's name,
    `effects` the names of what was added to the drag.
    """

    models: Mapping[str, YawModel]
    preferred: str
    moment_unit: str
    switch_offset: float
    source: str
    effects: tuple[str, ...] = ()
    dof: Dof = YAW


def load_yaw_models(path: Path) -> StoredModels:
    """The models of a `yaw_model.json`, `surge_model.json`, `heave_model.json` or `extended_model.json`.

    Raises ModelError with the file and the key's path for anything that is not what the schema says.
    """
    return yaw_models_from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def load_thruster_map(path: Path) -> ThrusterMap:
    """The map of a `thrusters.json`. Raises ModelError with the file and the key's path."""
    return ThrusterMap.from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def yaw_models_from_json(data: object, where: str = "yaw model") -> StoredModels:
    """The models in the content of a `yaw_model.json`, or of another motion's; `where` names it for messages.

    Raises ModelError.
    """
    top = _object(data, where)
    dof = _checked_schema(top, where)
    if wrong := dof.misnamed(top):
        raise ModelError(f"{where}: unknown key {_told(wrong)}; in {dof.name} it is {_told(dof.key(wrong))}")
    try:
        return _models(dof.plain(top), where, dof)
    except ModelError as error:
        place, _, rest = str(error).partition(where)  # a file may be called as it likes
        raise ModelError(f"{place}{where}{dof.say(rest)}") from None


def _models(top: Mapping[str, object], where: str, dof: Dof) -> StoredModels:
    """The models of a motion, under yaw's keys."""
    _refuse_unknown(top, _TOP if dof.wraps else (*_TOP, "motion", *ON_FORCE), where)
    entries = _object(_needed(top, "models", where), f"{where}: models")
    unit = _moment_unit(top, entries, where, dof)
    added = _effects(top.get("effects", []), f"{where}: effects")
    models = {}
    for number, entry in entries.items():
        if number not in BASE_TERMS:
            name = printable(number[:LONGEST])
            raise ModelError(f"{where}: models.{name}: unknown model; known are {', '.join(BASE_TERMS)}")
        if entry is not None:  # null: a model that could not be fitted
            models[number] = _with_effects(
                _base(number, entry, unit, f"{where}: models.{number}", dof), added
            )
    if not models:
        raise ModelError(f"{where}: models: holds no model; expected one or more of {', '.join(BASE_TERMS)}")
    preferred = _needed(top, "preferred", where)
    if not isinstance(preferred, str) or preferred not in models:
        raise ModelError(
            f"{where}: preferred: found {_told(preferred)}, expected one of the file's models "
            f"({', '.join(models)})"
        )
    offset = top.get("switch_offset")
    late = 0.0 if offset is None else _number(offset, f"{where}: switch_offset")
    if abs(late) > LATEST_SWITCH:
        raise ModelError(
            f"{where}: switch_offset: found {late:g}, expected a share of a sample interval "
            f"between -{LATEST_SWITCH} and {LATEST_SWITCH}"
        )
    names = tuple(name for name, _ in added)
    return StoredModels(models, preferred, unit, late, where, names, dof)


def schema_of(dof: Dof) -> str:
    """The schema of a motion's model file."""
    return f"automarine/{dof.name}-model/1"


def _checked_schema(top: Mapping[str, object], where: str) -> Dof:
    """The motion that the file's schema says."""
    schema = top.get("schema")
    dof = next((one for one in DOFS.values() if schema_of(one) == schema), None)
    if dof is None:
        hint = "give the yaw_model.json that `automarine fit-yaw` writes"
        if isinstance(schema, str) and schema.startswith("automarine/thruster-map/"):
            hint = f"this is a thruster map; {hint}"
        raise ModelError(f"{where}: schema: found {_told(schema)}, expected {_told(SCHEMA)}; {hint}")
    return dof


def _refuse_unknown(entry: Mapping[str, object], known: tuple[str, ...], where: str) -> None:
    """Refuse a key that means nothing: it may be meant as one that is read, and must not be passed over."""
    for key in entry:
        if key not in known:
            absent = [name for name in known if name not in entry]
            close = difflib.get_close_matches(key[:LONGEST], absent, n=1, cutoff=0.8)
            hint = f"did you mean {_told(close[0])}?" if close else f"known are {', '.join(known)}"
            raise ModelError(f"{where}: unknown key {_told(key)}; {hint}")


def _moment_unit(top: Mapping[str, object], entries: Mapping[str, object], where: str, dof: Dof) -> str:
    """The moment's unit: said by the file, or in yaw told by the unit of an inertia."""
    unit = top.get("moment_unit")
    if unit is None and dof.wraps:
        inertias = [entry.get("I_r") for entry in entries.values() if isinstance(entry, Mapping)]
        units = [one.get("unit") for one in inertias if isinstance(one, Mapping)]
        unit = next((one.removesuffix(" s²") for one in units if isinstance(one, str)), None)
    if unit not in dof.units.forces:
        expected = " or ".join(_told(one) for one in dof.units.forces)
        raise ModelError(f"{where}: moment_unit: found {_told(unit)}, expected {expected}")
    return str(unit)


def _base(number: str, data: object, unit: str, where: str, dof: Dof) -> YawModel:
    """Model `number` without effects. Model 2's linear term may have either sign, as in Table 1."""
    entry = _object(data, where)
    _refuse_unknown(entry, _MODEL if dof.wraps else (*_MODEL, CONSTANT, DIFFERENCE, "sides"), where)
    drags = [DRAG_NAMES[term] for term in BASE_TERMS[number]]
    for name in DRAG_NAMES.values():
        if entry.get(name) is not None and name not in drags:
            raise ModelError(f"{where}.{name}: model {number} has no such term; it has {', '.join(drags)}")
    inertia = _number(_needed(entry, "I_r", where), f"{where}.I_r")
    if inertia <= 0:
        raise ModelError(f"{where}.I_r: found {inertia:g}, expected an inertia above zero")
    values = []
    for name in drags:
        value = _number(_needed(entry, name, where), f"{where}.{name}")
        if value < 0 and not (number == "2" and name == "k_r"):
            raise ModelError(f"{where}.{name}: found {value:g}, expected a drag of zero or more")
        values.append(value)
    if dof.has_constant:
        values.append(_number(_needed(entry, CONSTANT, where), f"{where}.{CONSTANT}"))
    if dof.directional and entry.get(DIFFERENCE) is not None:
        values.append(_number(entry[DIFFERENCE], f"{where}.{DIFFERENCE}"))
    return YawModel.base(number, inertia, values, unit, dof)


def _effects(data: object, where: str) -> list[tuple[str, tuple[float, ...]]]:
    """Name and values of each effect of the file."""
    if not isinstance(data, list):
        raise ModelError(f"{where}: found {_told(data)}, expected a list")
    found = []
    for i, item in enumerate(data):
        place = f"{where}[{i}]"
        entry = _object(item, place)
        _refuse_unknown(entry, _EFFECT, place)
        name = _needed(entry, "name", place)
        if not isinstance(name, str) or name not in effects.names():
            raise ModelError(
                f"{place}.name: found {_told(name)}, expected one of {', '.join(effects.names())}"
            )
        given = _object(_needed(entry, "parameters", place), f"{place}.parameters")
        found.append((name, _parameters(name, given, f"{place}.parameters")))
    return found


def _parameters(name: str, given: Mapping[str, object], where: str) -> tuple[float, ...]:
    wanted = effects.get(name).parameters
    names = ", ".join(parameter.name for parameter in wanted) or "none"
    for key in given:
        if key not in {parameter.name for parameter in wanted}:
            raise ModelError(f"{where}: unknown key {_told(key)}; {name} takes {names}")
    values = []
    for parameter in wanted:
        if parameter.choices and parameter.name not in given:
            values.append(parameter.start)
            continue
        value = _number(_needed(given, parameter.name, where), f"{where}.{parameter.name}")
        if not parameter.lower <= value <= parameter.upper:
            raise ModelError(
                f"{where}.{parameter.name}: found {value:g}, expected {parameter.lower:g} to "
                f"{parameter.upper:g}"
            )
        values.append(value)
    return tuple(values)


def _with_effects(model: YawModel, added: list[tuple[str, tuple[float, ...]]]) -> YawModel:
    for name, values in added:
        model = model.with_effect(name, values)
    return model


def _number(data: object, where: str) -> float:
    """A finite number: an estimate's `value`, or plain."""
    if isinstance(data, Mapping):
        where, data = f"{where}.value", _needed(data, "value", where)
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise ModelError(f"{where}: found {_told(data)}, expected a number")
    try:
        value = float(data)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {_told(data)}, expected a finite number")
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise ModelError(f"{where}: found {_told(data)}, expected 0 or a size of {SMALLEST:g} to {LARGEST:g}")
    return value


def _object(data: object, where: str) -> Mapping[str, object]:
    if not isinstance(data, Mapping):
        raise ModelError(f"{where}: found {_told(data)}, expected an object with named keys")
    return data


def _needed(data: Mapping[str, object], key: str, where: str) -> object:
    if key not in data:
        raise ModelError(
            f"{where}: key {_told(key)} is missing; give a file as `automarine fit-yaw` writes it"
        )
    return data[key]
