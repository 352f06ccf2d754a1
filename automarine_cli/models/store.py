"""Models from files: `yaw_model.json` of a yaw fit, or another motion's; all of it checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

from automarine_cli import effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.effects import Effect
from automarine_cli.errors import ModelError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel, base_roles
from automarine_cli.pipeline.records import Codec, Place, Source, key_of, read_plain, told
from automarine_cli.pipeline.result_files import MODELS, AddedEffect, ModelEntry, ModelFile
from automarine_cli.pipeline.words import printable

LATEST_SWITCH = 0.5  # of a sample interval: beyond it another sample would show the command first
SMALLEST, LARGEST = 1e-30, 1e30  # of any number: beyond it arithmetic overflows
ROLES = ("inertia", "quadratic", "linear", "constant", "difference")


def number_at(given: Given, codec: Codec, place: Place) -> float:
    """Return the value of a number that must be there. Raises ModelError with its `place`."""
    value = given.value
    if value is None:
        raise codec.refusal(place, "found nothing, expected a number")
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise codec.refusal(place, f"found {value:g}, expected 0 or a size of {SMALLEST:g} to {LARGEST:g}")
    return value


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
    return file_and_models(read_plain(path, "JSON", ModelError), printable(path.name))[1]


def file_and_models(data: Mapping[str, object], where: str) -> tuple[ModelFile, StoredModels]:
    """All that the content of such a file says, and its models; `where` names it for messages. Raises ModelError."""
    kind = MODELS[motion_of(data).name]
    file = kind.of(data, where)
    return file, _models(file, kind.codec(data, where))


def motion_of(data: Mapping[str, object]) -> Dof:
    """The motion that a model file's schema names; yaw where it names none."""
    return next((DOFS[name] for name, one in MODELS.items() if one.schema == data.get("schema")), YAW)


def model_head(dof: Dof, unit: str) -> dict[str, object]:
    """What every model file begins with; `unit` is that of the command."""
    schema: dict[str, object] = {"schema": MODELS[dof.name].schema}
    return schema | ({} if dof.wraps else {"motion": dof.name}) | {f"{dof.words.force}_unit": unit}


def effects_json(estimates: Mapping[str, Mapping[str, Estimate]]) -> list[dict[str, object]]:
    """The effects beside drag as files hold them, by effect and parameter."""
    return [
        {"name": name, "parameters": {parameter: one.to_json() for parameter, one in of_effect.items()}}
        for name, of_effect in estimates.items()
    ]


def _models(file: ModelFile, codec: Codec) -> StoredModels:
    unit, models = _force_unit(file, codec), {}
    added = _effects(file.effects, codec, ("effects",), file.dof)
    for number, entry in file.models.items():
        place = ("models", number)
        if number not in BASE_TERMS:
            raise codec.refusal(place, f"unknown model; known are {', '.join(BASE_TERMS)}")
        if entry is not None:  # null: a model that could not be fitted
            own = entry.effects  # its own values of the same effects
            values = added if own is None else _effects(own, codec, (*place, "effects"), file.dof)
            model = _base(number, entry, unit, codec, place, file.dof)
            models[number] = reduce(lambda one, term: one.with_effect(*term), values, model)
    offset = ("switch_offset",)
    late = 0.0 if file.switch_offset is None else number_at(file.switch_offset, codec, offset)
    if abs(late) > LATEST_SWITCH:
        raise codec.refusal(
            offset,
            f"found {late:g}, expected a share of a sample interval between -{LATEST_SWITCH} and {LATEST_SWITCH}",
        )
    return StoredModels(models, file.preferred, unit, late, codec.name, file.dof, tuple(name for name, _ in added))


def _force_unit(file: ModelFile, codec: Codec) -> str:
    dof, unit = file.dof, file.force_unit
    if unit is None:
        units = (one.inertia.unit for one in file.models.values() if one is not None and one.inertia is not None)
        unit = next(filter(None, units), None)
        unit = {dof.unit_of("inertia", force): force for force in dof.units.forces}.get(str(unit), unit)
    if unit not in dof.units.forces:
        expected = " or ".join(told(one) for one in dof.units.forces)
        raise codec.refusal((key_of(file, "force_unit"),), f"found {told(unit)}, expected {expected}")
    return str(unit)


def _base(number: str, entry: ModelEntry, unit: str, codec: Codec, place: Place, dof: Dof) -> YawModel:
    """Model `number` without effects. Model 2's linear term may have either sign, as in Table 1."""
    given: dict[str, Given | None] = {role: getattr(entry, role) for role in ROLES}
    roles = base_roles(number, dof, dof.directional and entry.difference is not None)
    for role, one in given.items():
        if one is not None and role not in roles:
            drags = [dof.parameters[one] for one in ("quadratic", "linear") if one in roles]
            raise codec.refusal(
                (*place, dof.parameters[role]), f"model {number} has no such term; it has {', '.join(drags)}"
            )
    values = {}
    for role in roles:
        at = (*place, dof.parameters[role])
        if (one := given[role]) is None:
            raise codec.missing(place, dof.parameters[role])
        value = values[role] = number_at(one, codec, at)
        if role == "inertia" and value <= 0:
            raise codec.refusal(at, f"found {value:g}, expected {dof.words.an_inertia} above zero")
        may_drive = role == "linear" and "quadratic" in roles
        if role in ("linear", "quadratic") and value < 0 and not may_drive:
            raise codec.refusal(at, f"found {value:g}, expected a drag of zero or more")
    inertia = values.pop("inertia")
    return YawModel.base(number, inertia, list(values.values()), unit, dof)


def _effects(
    entries: Sequence[AddedEffect], codec: Codec, place: Place, dof: Dof
) -> list[tuple[str, tuple[float, ...]]]:
    found = []
    for i, entry in enumerate(entries):
        at = (*place, i)
        if not effects.known(entry.name):
            expected = ", ".join(effects.names())
            raise codec.refusal((*at, "name"), f"found {told(entry.name)}, expected one of {expected}")
        found.append((entry.name, _parameters(entry, codec, (*at, "parameters"), dof)))
    return found


def _parameters(entry: AddedEffect, codec: Codec, place: Place, dof: Dof) -> tuple[float, ...]:
    effect = effects.get(entry.name)
    keys = effect.names_in(dof)
    for key in entry.parameters:
        if key not in keys:
            raise codec.refusal(place, f"unknown key {told(key)}; {entry.name} takes {', '.join(keys) or 'none'}")
    given = {key: number_at(one, codec, (*place, key)) for key, one in entry.parameters.items()}
    values = values_of(effect, keys, given, codec, place)
    if lacking := effect.lacking(given, values, dof):
        raise codec.missing(place, lacking)
    return values


def values_of(
    effect: Effect, keys: Sequence[str], given: Mapping[str, float], codec: Codec, place: Place, free: str = ""
) -> tuple[float, ...]:
    """The values of an effect's parameters, which a file calls `keys`, those of laws it does not use at their start.
    Raises ModelError for one that is missing, or outside its bounds, unless its name is `free`."""
    values = []
    for key, parameter in zip(keys, effect.parameters):
        if key not in given and not parameter.optional:
            raise codec.missing(place, key)
        value = given.get(key, parameter.start)
        if key in given and parameter.name != free and not parameter.lower <= value <= parameter.upper:
            raise codec.refusal((*place, key), f"found {value:g}, expected {parameter.lower:g} to {parameter.upper:g}")
        values.append(value)
    return tuple(values)
