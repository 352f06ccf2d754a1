"""Models from files: `yaw_model.json` of a yaw fit, or another motion's; all of it checked."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from automarine_cli import effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import ModelError
from automarine_cli.models.entries import needed, number_at, object_at
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel, base_roles
from automarine_cli.pipeline.plain_data import Source, read_plain
from automarine_cli.pipeline.plain_data import told as _told
from automarine_cli.pipeline.words import LONGEST, printable

LATEST_SWITCH = 0.5  # of a sample interval: beyond it another sample would show the command first


@dataclass(frozen=True)
class StoredModels:
    """The models of one file, by number, each with the file's effects already in it.

    `preferred` is the number of the model that the fit prefers; `moment_unit` is that of the motion `dof`;
    `switch_offset` is the share of a sample interval by which commands act later than the middle of the
    interval before the sample that first shows them (the logger's convention); `source` is the file's name,
    `effects` the names of what was added to the drag.
    """

    models: Mapping[str, YawModel]
    preferred: str
    moment_unit: str
    switch_offset: float
    source: str
    dof: Dof
    effects: tuple[str, ...] = ()


def load_yaw_models(path: Source) -> StoredModels:
    """The models of a `yaw_model.json`, of another motion's `..._model.json`, or of an `extended_model.json`.

    Raises ModelError with the file and the key's path for anything that is not what the schema says.
    """
    return yaw_models_from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def yaw_models_from_json(data: object, where: str = "yaw model") -> StoredModels:
    """The models in the content of a `yaw_model.json`, or of another motion's; `where` names it for messages.

    Raises ModelError.
    """
    top = object_at(data, where)
    dof = _checked_schema(top, where)
    _refuse_unknown(top, _file_keys, where, dof)
    entries = object_at(needed(top, "models", where, dof.name), f"{where}: models")
    unit = _force_unit(top, entries, where, dof)
    added = _effects(top.get("effects", []), f"{where}: effects", dof)
    models = {}
    for number, entry in entries.items():
        if number not in BASE_TERMS:
            name = printable(number[:LONGEST])
            raise ModelError(f"{where}: models.{name}: unknown model; known are {', '.join(BASE_TERMS)}")
        if entry is not None:  # null: a model that could not be fitted
            place = f"{where}: models.{number}"
            own = entry.get("effects") if isinstance(entry, Mapping) else None  # its own values of the same effects
            values = added if own is None else _effects(own, f"{place}.effects", dof)
            models[number] = _with_effects(_base(number, entry, unit, place, dof), values)
    if not models:
        raise ModelError(f"{where}: models: holds no model; expected one or more of {', '.join(BASE_TERMS)}")
    preferred = needed(top, "preferred", where, dof.name)
    if not isinstance(preferred, str) or preferred not in models:
        raise ModelError(
            f"{where}: preferred: found {_told(preferred)}, expected one of the file's models ({', '.join(models)})"
        )
    offset = top.get("switch_offset")
    late = 0.0 if offset is None else number_at(offset, f"{where}: switch_offset", dof.name)
    if abs(late) > LATEST_SWITCH:
        raise ModelError(
            f"{where}: switch_offset: found {late:g}, expected a share of a sample interval "
            f"between -{LATEST_SWITCH} and {LATEST_SWITCH}"
        )
    names = tuple(name for name, _ in added)
    return StoredModels(models, preferred, unit, late, where, dof, names)


def model_json(
    dof: Dof,
    *,
    unit: str,
    fitted_to: str,
    models: Mapping[str, Mapping[str, object]],
    preferred: str,
    because: str,
    ratio: Mapping[str, object] | None,
    valid_range: Mapping[str, object] | None,
    effects: Sequence[Mapping[str, object]],
) -> dict[str, object]:
    """What every model file begins with: models by number, the preferred one and why, the ratio of inertia to quadratic
    drag, the range that it was fitted in, and the effects beside drag."""
    return {
        "schema": schema_of(dof),
        **({} if dof.wraps else {"motion": dof.name}),
        f"{dof.words.force}_unit": unit,
        "fitted_to": fitted_to,
        "models": models,
        "preferred": preferred,
        "preferred_because": because,
        dof.ratio_key: ratio,
        "valid_range": valid_range,
        "effects": effects,
    }


def schema_of(dof: Dof) -> str:
    """The schema of a motion's model file."""
    return f"automarine/{dof.name}-model/1"


def _file_keys(dof: Dof) -> tuple[str, ...]:
    """What `fit-yaw`, its like and `diagnose` write, the first ones being read. Any other key is a slip of somebody's
    hand."""
    return (
        "schema", "models", "preferred", f"{dof.words.force}_unit", "switch_offset", "effects",
        "fitted_to", "preferred_because", dof.ratio_key, "gain_scatter",
        f"{dof.words.position}_noise_{dof.units.key}", "valid_range", "warnings", "runs", "parent", "notes", "channels",
        "driven", "random", "prediction", *(() if dof.wraps else ("motion", "buoyancy")),
    )  # fmt: skip


def _model_keys(dof: Dof) -> tuple[str, ...]:
    """The same of one model."""
    own = dof.symbols
    return (
        own.inertia, own.quadratic, own.linear, dof.ratio_key, "output_error", "velocity_error", "sse", "why",
        "warnings", "notes", "effects", *(() if dof.wraps else (own.constant, own.difference, "sides")),
    )  # fmt: skip


def _effect_keys(dof: Dof) -> tuple[str, ...]:
    """The same of one effect, alike in all motions."""
    return ("name", "parameters", "says", "confidence", "p_value", "rivals")


def _checked_schema(top: Mapping[str, object], where: str) -> Dof:
    """The motion that the file's schema says."""
    schema = top.get("schema")
    dof = next((one for one in DOFS.values() if schema_of(one) == schema), None)
    if dof is None:
        hint = "give the yaw_model.json that `automarine fit-yaw` writes"
        if isinstance(schema, str) and schema.startswith("automarine/thruster-map/"):
            hint = f"this is a thruster map; {hint}"
        raise ModelError(f"{where}: schema: found {_told(schema)}, expected {_told(schema_of(YAW))}; {hint}")
    return dof


def _refuse_unknown(entry: Mapping[str, object], keys: Callable[[Dof], tuple[str, ...]], where: str, dof: Dof) -> None:
    """Refuse a key that means nothing: it may be meant as one that is read, and must not be passed over."""
    known = keys(dof)
    for key in entry:
        if key not in known:
            absent = [name for name in known if name not in entry]
            twins = (pair for other in DOFS.values() for pair in zip(keys(other), known))
            meant = [own for name, own in twins if name == key and own in absent]
            close = meant or difflib.get_close_matches(key[:LONGEST], absent, n=1, cutoff=0.8)
            hint = f"did you mean {_told(close[0])}?" if close else f"known are {', '.join(known)}"
            raise ModelError(f"{where}: unknown key {_told(key)}; {hint}")


def _force_unit(top: Mapping[str, object], entries: Mapping[str, object], where: str, dof: Dof) -> str:
    """The unit of moment or force: said by the file, or told by the unit of an inertia."""
    key = f"{dof.words.force}_unit"
    unit = top.get(key)
    if unit is None:
        inertias = [entry.get(dof.symbols.inertia) for entry in entries.values() if isinstance(entry, Mapping)]
        units = [one.get("unit") for one in inertias if isinstance(one, Mapping)]
        unit = next((one for one in units if isinstance(one, str)), None)
        unit = {dof.unit_of("inertia", force): force for force in dof.units.forces}.get(str(unit), unit)
    if unit not in dof.units.forces:
        expected = " or ".join(_told(one) for one in dof.units.forces)
        raise ModelError(f"{where}: {key}: found {_told(unit)}, expected {expected}")
    return str(unit)


def _base(number: str, data: object, unit: str, where: str, dof: Dof) -> YawModel:
    """Model `number` without effects. Model 2's linear term may have either sign, as in Table 1."""
    entry = object_at(data, where)
    _refuse_unknown(entry, _model_keys, where, dof)
    sided = dof.directional and entry.get(dof.symbols.difference) is not None
    roles = base_roles(number, dof, sided)
    for role in ("linear", "quadratic"):
        name = dof.parameters[role]
        if entry.get(name) is not None and role not in roles:
            drags = [dof.parameters[one] for one in ("quadratic", "linear") if one in roles]
            raise ModelError(f"{where}.{name}: model {number} has no such term; it has {', '.join(drags)}")
    values = {}
    for role in roles:
        name = dof.parameters[role]
        value = values[role] = number_at(needed(entry, name, where, dof.name), f"{where}.{name}", dof.name)
        if role == "inertia" and value <= 0:
            raise ModelError(f"{where}.{name}: found {value:g}, expected {dof.words.an_inertia} above zero")
        may_drive = role == "linear" and "quadratic" in roles
        if role in ("linear", "quadratic") and value < 0 and not may_drive:
            raise ModelError(f"{where}.{name}: found {value:g}, expected a drag of zero or more")
    inertia = values.pop("inertia")
    return YawModel.base(number, inertia, list(values.values()), unit, dof)


def _effects(data: object, where: str, dof: Dof) -> list[tuple[str, tuple[float, ...]]]:
    """Name and values of each effect of the file."""
    if not isinstance(data, list):
        raise ModelError(f"{where}: found {_told(data)}, expected a list")
    found = []
    for i, item in enumerate(data):
        place = f"{where}[{i}]"
        entry = object_at(item, place)
        _refuse_unknown(entry, _effect_keys, place, dof)
        name = needed(entry, "name", place, dof.name)
        if not isinstance(name, str) or not effects.known(name):
            raise ModelError(f"{place}.name: found {_told(name)}, expected one of {', '.join(effects.names())}")
        given = object_at(needed(entry, "parameters", place, dof.name), f"{place}.parameters")
        found.append((name, _parameters(name, given, f"{place}.parameters", dof)))
    return found


def _parameters(name: str, given: Mapping[str, object], where: str, dof: Dof) -> tuple[float, ...]:
    wanted = {parameter.name_in(dof): parameter for parameter in effects.get(name).parameters}
    for key in given:
        if key not in wanted:
            raise ModelError(f"{where}: unknown key {_told(key)}; {name} takes {', '.join(wanted) or 'none'}")
    values = []
    for key, parameter in wanted.items():
        if parameter.optional and key not in given:
            values.append(parameter.start)
            continue
        value = number_at(needed(given, key, where, dof.name), f"{where}.{key}", dof.name)
        if not parameter.lower <= value <= parameter.upper:
            raise ModelError(f"{where}.{key}: found {value:g}, expected {parameter.lower:g} to {parameter.upper:g}")
        values.append(value)
    if lacking := effects.get(name).lacking(given, values, dof):
        needed(given, lacking, where, dof.name)
    return tuple(values)


def _with_effects(model: YawModel, added: list[tuple[str, tuple[float, ...]]]) -> YawModel:
    for name, values in added:
        model = model.with_effect(name, values)
    return model
