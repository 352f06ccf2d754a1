"""Models from files: `yaw_model.json` of a yaw fit, or another motion's; all of it checked. What a diagnosis adds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import ClassVar

from automarine_cli import effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.effects import Effect
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel, base_roles
from automarine_cli.pipeline.records import Codec, Place, Source, key_of, keyed, read_plain, told
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.pipeline.words import printable

LATEST_SWITCH = 0.5  # of a sample interval: beyond it another sample would show the command first
SMALLEST, LARGEST = 1e-30, 1e30  # of any number: beyond it arithmetic overflows
ROLES = ("inertia", "quadratic", "linear", "constant", "difference")


@dataclass(frozen=True)
class Sensor:
    """Whether a sensor counts: how noisy it is, or why not."""

    quantity: str
    used: bool
    noise: Estimate | None = None
    why: str | None = None


@dataclass(frozen=True)
class Covariance:
    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Use:
    """Whether a model predicts better than somebody who expects no change, and the sentences that say so."""

    of_use: bool = True
    says: tuple[str, ...] | str = ()

    @property
    def refusal(self) -> str:
        """Why the model is not to be used; empty where it is of use."""
        sentences = (self.says,) if isinstance(self.says, str) else self.says
        return "" if self.of_use or not sentences else sentences[0]


@dataclass(frozen=True)
class AddedEffect:
    unread: ClassVar[tuple[str, ...]] = ("says", "confidence", "p_value", "rivals")
    name: str
    parameters: Mapping[str, Given]


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """One of the models of a file; None is what it does not have."""

    unread: ClassVar[tuple[str, ...]] = ("velocity_error", "sse", "why", "sides", "warnings", "notes")
    inertia: Given | None = field(default=None, metadata=keyed("{inertia_symbol}"))
    quadratic: Given | None = field(default=None, metadata=keyed("{quadratic}"))
    linear: Given | None = field(default=None, metadata=keyed("{linear}"))
    constant: Given | None = field(default=None, metadata=keyed("{constant}"))
    difference: Given | None = field(default=None, metadata=keyed("{difference}"))
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    covariance: Covariance | None = field(default=None, metadata=keyed("output_error/covariance"))
    effects: tuple[AddedEffect, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class ModelFile(ResultRecord):
    """`yaw_model.json`, or that of another motion: models by number."""

    unread: ClassVar[tuple[str, ...]] = ("notes", "fitted_to", "driven", "time_constant_s")
    models: Mapping[str, ModelEntry | None]
    preferred: str
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    switch_offset: Given | None = None
    effects: tuple[AddedEffect, ...] = ()
    preferred_because: str = ""
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    gain_scatter: Given | None = None
    gain_exponent: Given | None = None
    noise: float | None = field(default=None, metadata=keyed("{position}_noise_{shown_unit}"))
    force_range: tuple[float, float] | None = field(default=None, metadata=keyed("valid_range/{force}"))
    velocity_range: tuple[float, float] | None = field(default=None, metadata=keyed("valid_range/{velocity_key}"))
    parent_file: str = field(default="", metadata=keyed("parent/file"))
    parent_sha256: str = field(default="", metadata=keyed("parent/sha256"))
    channels: tuple[Sensor, ...] = ()
    random: Mapping[str, Given] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)
    buoyancy: Mapping[str, object] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        there = [number for number, entry in self.models.items() if entry is not None]
        if not there:
            raise SettingError("models: holds no model; expected one or more of 1, 2, 3")
        if self.preferred not in there:
            raise SettingError(
                f"preferred: found {told(self.preferred)}, expected one of the file's models ({', '.join(there)})"
            )

    @property
    def chosen(self) -> ModelEntry:
        return self.models[self.preferred] or ModelEntry()

    def main_parameters(self) -> Iterator[tuple[str, Given]]:
        """Drag and inertia of the preferred model that it has, in letters for print."""
        own, entry = self.dof.symbols, self.chosen
        found = {own.quadratic_print: entry.quadratic, own.linear: entry.linear, own.inertia: entry.inertia}
        return ((name, given) for name, given in found.items() if given is not None)


MODELS = {
    name: ResultKind(f"{name}_model.json", f"{name}-model", ModelFile, f"fit-{name}", dof) for name, dof in DOFS.items()
}
"""The model file of each motion, by its name."""


@dataclass(frozen=True)
class FoundEffect:
    """An effect that a diagnosis named or suspects, and those that cannot be excluded."""

    name: str
    parameters: Mapping[str, Given] = field(default_factory=dict)
    rivals: tuple["FoundEffect", ...] = ()
    split_by: str = ""


@dataclass(frozen=True)
class Tried:
    name: str
    gain: float


@dataclass(frozen=True)
class Moved:
    after: Given


@dataclass(frozen=True, kw_only=True)
class GapEntry:
    """Of the runs that were fitted, in the unit in which positions are shown; of thrusters in newtons."""

    before: float = field(metadata=keyed("before_{shown_unit}", "before_N"))
    after: float = field(metadata=keyed("after_{shown_unit}", "after_N"))
    noise_floor: float = field(metadata=keyed("noise_floor_{shown_unit}", "noise_floor_N"))


@dataclass(frozen=True, kw_only=True)
class DiagnosisFile(ResultRecord):
    """`diagnosis.json`, of a motion, of the plane or of a thruster map: what it adds to the model."""

    verdict: str
    gap: GapEntry = field(metadata=keyed("gap/fitted_runs"))
    model: str = ""
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    effects: tuple[FoundEffect, ...] = ()
    base: Mapping[str, Moved] = field(default_factory=dict)
    candidates: tuple[Tried, ...] = ()
    threshold: float | None = None
    smallest_visible: Mapping[str, float] = field(default_factory=dict)

    @property
    def of_thrusters(self) -> bool:
        return self.model == "thruster-map"

    @property
    def unit(self) -> str:
        return "N" if self.of_thrusters else self.dof.units.key


DIAGNOSIS = ResultKind("diagnosis.json", "diagnosis", DiagnosisFile, "diagnose")


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
