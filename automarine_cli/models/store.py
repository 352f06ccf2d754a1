"""Models from files: `yaw_model.json` of a yaw fit, or another motion's; all of it checked.

And `planar_model.json`: the model of surge, sway and yaw together, to and from plain data (automarine/planar-model/1).

    {"schema": "automarine/planar-model/1", "force_unit": "N", "moment_unit": "N m",
     "parameters": {"surge.m_u": ESTIMATE, "surge.X_uu": ESTIMATE, "sway.Y_r": ESTIMATE, "yaw.input-delay.t_d": 0.2,
                    "current.north": ESTIMATE, ...},
     "assumptions": [{"parameter": "sway.m_v", "equals": "surge.m_u", "because": "sentence"}],
     "covariance": {"parameters": [...], "matrix": [[...]]}, "valid_range": {...}}

Every parameter stands under its qualified name, and the names say what the model is made of: a term of drag or an
effect is there if its parameters are. What was not identified is a plain number, and its assumption is told.
"""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import ClassVar

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import DOFS, PLANAR, YAW, Dof
from automarine_cli.effects import Effect
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.model import (
    BASE_TERMS,
    COMMAND_DELAY,
    CURRENT,
    INERTIA_COUPLINGS,
    MAX_DELAY_S,
    PLANAR_FORCES,
    PLANAR_VELOCITIES,
    Model,
    Term,
    base_roles,
)
from automarine_cli.pipeline.records import Codec, ResultKind, ResultRecord, Source, key_of, keyed, read_plain
from automarine_cli.text import MAX_NAME_LETTERS, Place, format_value, printable

MIN_NUMBER, MAX_NUMBER = 1e-30, 1e30  # of any number: beyond it arithmetic overflows
ROLES = ("quadratic", "linear", "inertia", "constant", "restoring", "difference")  # in the order of files


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

    unread: ClassVar[tuple[str, ...]] = ("velocity_error", "sse", "why", "sides", "swing", "warnings", "notes")
    inertia: Given | None = field(default=None, metadata=keyed("{inertia_symbol}"))
    quadratic: Given | None = field(default=None, metadata=keyed("{quadratic}"))
    linear: Given | None = field(default=None, metadata=keyed("{linear}"))
    constant: Given | None = field(default=None, metadata=keyed("{constant}"))
    restoring: Given | None = field(default=None, metadata=keyed("{restoring}"))
    difference: Given | None = field(default=None, metadata=keyed("{difference}"))
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    covariance: Covariance | None = field(default=None, metadata=keyed("output_error/covariance"))
    effects: tuple[AddedEffect, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class ModelFile(ResultRecord):
    """`yaw_model.json`, or that of another motion: models by number."""

    unread: ClassVar[tuple[str, ...]] = (
        "notes", "fitted_to", "driven", "time_constant_s", "consistency", "swing", "ratios",
    )  # fmt: skip
    models: Mapping[str, ModelEntry | None]
    preferred: str
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    command_delay_s: Given | None = None
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
    nomoto: Mapping[str, object] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        there = [number for number, entry in self.models.items() if entry is not None]
        if not there:
            raise SettingError("models: holds no model; expected one or more of 1, 2, 3")
        if self.preferred not in there:
            raise SettingError(
                f"preferred: found {format_value(self.preferred)}, expected one of the models {', '.join(there)}"
            )

    @property
    def chosen(self) -> ModelEntry:
        return self.models[self.preferred] or ModelEntry()

    def main_parameters(self) -> Iterator[tuple[str, Given]]:
        """Drag and inertia of the preferred model that it has, in letters for print."""
        names, entry = self.dof.symbols, self.chosen
        estimates = {names.quadratic: entry.quadratic, names.linear: entry.linear, names.inertia: entry.inertia}
        return ((name, estimate) for name, estimate in estimates.items() if estimate is not None)


MODELS = {
    name: ResultKind(f"{name}_model.json", f"{name}-model", ModelFile, f"fit-{name}", dof) for name, dof in DOFS.items()
}
"""The model file of each motion, by its name."""
DRAG_LAWS = {"1": "linear", "2": "linear + quadratic", "3": "quadratic"}
"""The drag of each model, by its number."""


def named_model(number: str) -> str:
    return f"model {number} ({DRAG_LAWS[number]} drag)" if number in DRAG_LAWS else f"model {number}"


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
    """In the unit in which positions are shown; of thrusters in newtons. None where a free run diverges."""

    before: float | None = field(metadata=keyed("before_{shown_unit}", "before_N"))
    after: float | None = field(metadata=keyed("after_{shown_unit}", "after_N"))
    noise_floor: float = field(metadata=keyed("noise_floor_{shown_unit}", "noise_floor_N"))


@dataclass(frozen=True, kw_only=True)
class DiagnosisFile(ResultRecord):
    """`diagnosis.json`, of a motion, of the plane or of a thruster map: what it adds to the model."""

    verdict: str
    gap: GapEntry = field(metadata=keyed("gap/fitted_runs"))
    gap_held_out: GapEntry | None = field(default=None, metadata=keyed("gap/held_out_runs"))
    from_commands: GapEntry | None = field(default=None, metadata=keyed("from_commands/held_out_runs"))
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
        return "N" if self.of_thrusters else self.dof.units.shown


DIAGNOSIS = ResultKind("diagnosis.json", "diagnosis", DiagnosisFile, "diagnose")


def number_at(number: Given, codec: Codec, place: Place) -> float:
    """Return the value of a number that must be there. Raises ModelError with its `place`."""
    value = number.value
    if value is None:
        raise codec.refusal(place, "found nothing, expected a number")
    if value and not MIN_NUMBER <= abs(value) <= MAX_NUMBER:
        raise codec.refusal(place, f"found {value:g}, expected 0 or a size of {MIN_NUMBER:g} to {MAX_NUMBER:g}")
    return value


@dataclass(frozen=True)
class StoredModels:
    """The models of one file, by number, each with the file's effects and its command delay already in it; in the plane
    there is one, called as the motion.

    `preferred` is the number of the model that the fit prefers; `command_delay` [s] is that of the commands after the
    middle of the sample interval in which they changed; `source` is the file's name, `effects` the names of what was
    added to the drag, `scatter` the share by which thrust differs from run to run, None where the fit cannot know it,
    `random` the sizes of what is random by name.
    """

    models: Mapping[str, Model]
    preferred: str
    command_delay: float
    source: str
    effects: tuple[str, ...] = ()
    scatter: float | None = None
    random: Mapping[str, float] = field(default_factory=dict, repr=False)

    @property
    def model(self) -> Model:
        return self.models[self.preferred]

    @property
    def dof(self) -> Dof:
        return self.model.dof

    @property
    def in_plane(self) -> bool:
        return self.model.motion.turns

    @property
    def undelayed(self) -> Model:
        """The preferred model without its command delay, which fits to more runs estimate anew."""
        return self.model.delayed(-self.command_delay)


def read_model(path: Source) -> StoredModels:
    """Read the models of a `yaw_model.json`, of another motion's, of a `planar_model.json` or `extended_model.json`.

    Raises ModelError with the file and the key's path for anything that is not what the schema says.
    """
    return models_of(read_plain(path, "JSON", ModelError), printable(path.name))


def models_of(data: Mapping[str, object], where: str) -> StoredModels:
    """Return the models in the content of such a file; `where` names it for messages. Raises ModelError."""
    return _planar_of(data, where) if data.get("schema") == PLANAR_MODEL.schema else file_and_models(data, where)[1]


def file_and_models(data: Mapping[str, object], where: str) -> tuple[ModelFile, StoredModels]:
    """All that the content of a file of one motion says, and its models. Raises ModelError."""
    kind = MODELS[motion_of(data).name]
    file, codec = kind.of(data, where), kind.codec(data, where)
    unit, models = _force_unit(file, codec), {}
    added = _effects(file.effects, codec, ("effects",), file.dof)
    for number, entry in file.models.items():
        place = ("models", number)
        if number not in BASE_TERMS:
            raise codec.refusal(place, f"unknown model; known are {', '.join(BASE_TERMS)}")
        if entry is not None:  # null: a model that could not be fitted
            entries = entry.effects  # its values of the same effects
            values = added if entries is None else _effects(entries, codec, (*place, "effects"), file.dof)
            model = _base(number, entry, unit, codec, place, file.dof)
            models[number] = reduce(lambda built, term: built.with_effect(*term), values, model)
    late = _command_delay(file.command_delay_s, codec)
    models = {number: model.delayed(late) for number, model in models.items()}
    names, scatter = tuple(name for name, _ in added), file.gain_scatter.value if file.gain_scatter else None
    random = {name: size.value for name, size in file.random.items() if size.value is not None}
    return file, StoredModels(models, file.preferred, late, codec.name, names, scatter, random)


def motion_of(data: Mapping[str, object]) -> Dof:
    """The motion that a model file's schema names; yaw where it names none."""
    return next((DOFS[name] for name, kind in MODELS.items() if kind.schema == data.get("schema")), YAW)


def model_head(dof: Dof, unit: str) -> dict[str, object]:
    """What every model file begins with; `unit` is that of the command."""
    schema: dict[str, object] = {"schema": MODELS[dof.name].schema}
    return schema | ({} if dof.wraps else {"motion": dof.name}) | {f"{dof.words.force}_unit": unit}


def effects_json(estimates: Mapping[str, Mapping[str, Estimate]]) -> list[dict[str, object]]:
    """The effects beside drag as files hold them, by effect and parameter."""
    return [
        {"name": name, "parameters": {parameter: estimate.to_json() for parameter, estimate in of_effect.items()}}
        for name, of_effect in estimates.items()
    ]


def _force_unit(file: ModelFile, codec: Codec) -> str:
    dof, unit = file.dof, file.force_unit
    if unit is None:
        units = (m.inertia.unit for m in file.models.values() if m is not None and m.inertia is not None)
        unit = next(filter(None, units), None)
        unit = {dof.unit_of("inertia", force): force for force in dof.units.forces}.get(str(unit), unit)
    if unit not in dof.units.forces:
        expected = " or ".join(format_value(force) for force in dof.units.forces)
        raise codec.refusal((key_of(file, "force_unit"),), f"found {format_value(unit)}, expected {expected}")
    return str(unit)


def _base(number: str, entry: ModelEntry, unit: str, codec: Codec, place: Place, dof: Dof) -> Model:
    """Model `number` without effects, what somebody knew exactly fixed. Model 2's linear term may have either sign, as
    in Table 1."""
    numbers: dict[str, Given | None] = {role: getattr(entry, role) for role in ROLES}
    roles = base_roles(number, dof, dof.directional and entry.difference is not None)
    for role, stored in numbers.items():
        if stored is not None and role not in roles:
            drags = [dof.parameters[drag] for drag in ("quadratic", "linear") if drag in roles]
            raise codec.refusal(
                (*place, dof.parameters[role]), f"model {number} has no such term; it has {', '.join(drags)}"
            )
    values = {}
    for role in roles:
        at = (*place, dof.parameters[role])
        if (stored := numbers[role]) is None:
            raise codec.missing(place, dof.parameters[role])
        value = values[role] = number_at(stored, codec, at)
        if role == "inertia" and value <= 0:
            raise codec.refusal(at, f"found {value:g}, expected {dof.words.an_inertia} above zero")
        may_drive = role == "linear" and "quadratic" in roles
        if role in ("linear", "quadratic") and value < 0 and not may_drive:
            raise codec.refusal(at, f"found {value:g}, expected a drag of zero or more")
    inertia = values.pop("inertia")
    exact = [role for role, stored in numbers.items() if stored is not None and stored.known_ and not stored.stderr]
    model = Model.base(number, inertia, list(values.values()), unit, dof)
    return replace(model, fixed=tuple(dof.parameter(role) for role in exact))


def _effects(
    entries: Sequence[AddedEffect], codec: Codec, place: Place, dof: Dof
) -> list[tuple[str, tuple[float, ...]]]:
    added = []
    for i, entry in enumerate(entries):
        at = (*place, i, "parameters")
        if not effects.known(entry.name):
            expected = ", ".join(effects.names())
            raise codec.refusal((*place, i, "name"), f"found {format_value(entry.name)}, expected one of {expected}")
        effect = effects.get(entry.name)
        keys = effect.names_in(dof)
        if alien := next((key for key in entry.parameters if key not in keys), None):
            takes = f"{entry.name} takes {', '.join(keys) or 'none'}"
            raise codec.refusal(at, f"unknown key {format_value(alien)}; {takes}")
        numbers = {key: number_at(number, codec, (*at, key)) for key, number in entry.parameters.items()}
        values = values_of(effect, keys, numbers, codec, at)
        if lacking := effect.lacking(numbers, values, dof):
            raise codec.missing(at, lacking)
        added.append((entry.name, values))
    return added


def values_of(
    effect: Effect, keys: Sequence[str], numbers: Mapping[str, float], codec: Codec, place: Place, free: str = ""
) -> tuple[float, ...]:
    """The values of an effect's parameters, which a file calls `keys`, those of laws it does not use at their start.
    Raises ModelError for one that is missing, or outside its bounds, unless its name is `free`."""
    values = []
    for key, parameter in zip(keys, effect.parameters):
        if key not in numbers and not parameter.optional:
            raise codec.missing(place, key)
        value = numbers.get(key, parameter.start)
        if key in numbers and parameter.name != free and not parameter.lower <= value <= parameter.upper:
            raise codec.refusal((*place, key), f"found {value:g}, expected {parameter.lower:g} to {parameter.upper:g}")
        values.append(value)
    return tuple(values)


PARAMETERS = ("parameters",)
SI_UNITS = {"force_unit": "N", "moment_unit": "N m"}
DRAG_OF_ROLE = {
    "linear": "linear-drag", "quadratic": "quadratic-drag", "cubic": "cubic-drag", "constant": "bias-moment",
    "difference": "drag-asymmetry",
}  # fmt: skip
"""The effect whose one parameter has a letter of its own in a motion, by what it is there (see `Dof.parameters`)."""


@dataclass(frozen=True, kw_only=True)
class PlanarFile(ResultRecord):
    """`planar_model.json`: parameters by qualified name."""

    unread: ClassVar[tuple[str, ...]] = (
        "fitted_to", "assumptions", "valid_range", "channels", "disturbance", "noises", "log_likelihood",
        "structure_because", "estimated", "estimated_because", "effects", "predicts", "parent", "notes", "warnings",
    )  # fmt: skip
    force_unit: str = "N"
    moment_unit: str = "N m"
    parameters: Mapping[str, Given]
    structure: str = ""
    covariance: Covariance | None = None
    command_delay_s: Given | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)


PLANAR_MODEL = ResultKind(f"{PLANAR.name}_model.json", f"{PLANAR.name}-model", PlanarFile, "fit-planar", YAW)


def planar_json(model: Model, estimates: Mapping[str, object] | None = None) -> dict[str, object]:
    """What every file of a planar model begins with; `estimates` by qualified name as plain data, else the number."""
    return {"schema": PLANAR_MODEL.schema, **SI_UNITS, "parameters": {**model.values, **(estimates or {})}}


def _planar_of(data: Mapping[str, object], where: str) -> StoredModels:
    """The model of the plane; parameters that its fit did not estimate are fixed, where the file says."""
    file, codec = PLANAR_MODEL.of(data, where), PLANAR_MODEL.codec(data, where)
    for key, unit in SI_UNITS.items():
        if (stated := getattr(file, key)) != unit:
            raise codec.refusal(
                (key,), f"found {format_value(stated)}, expected {format_value(unit)}: coupled motions are in newtons"
            )
    values = {name: number_at(number, codec, (*PARAMETERS, name)) for name, number in file.parameters.items()}
    unread = dict(values)
    sizes = [dof.parameter("inertia") for dof in PLANAR.dofs]
    for name in sizes:
        if name not in unread:
            raise codec.missing(PARAMETERS, name)
        if (value := unread[name]) <= 0:
            raise codec.refusal((*PARAMETERS, name), f"found {value:g}, expected an inertia above zero")
    couplings = (unread.pop(f"{PLANAR.name}.{name}", 0.0) for name in INERTIA_COUPLINGS)
    masses = (*(unread.pop(name) for name in sizes), *couplings)
    water = [unread.pop(name) for name in CURRENT if name in unread]
    if len(water) == 1:
        lacking = next(name for name in CURRENT if name not in values)
        raise codec.refusal(
            PARAMETERS, f"key {format_value(lacking)} is missing; a current has {' and '.join(CURRENT)}, give both"
        )
    terms: list[Term] = []
    while unread:
        name = next(iter(unread))
        motion, _, short = name.partition(".")
        if motion not in [dof.name for dof in PLANAR.dofs] or not short:
            raise codec.refusal(PARAMETERS, _unknown(name))
        dof = DOFS[motion]
        term = _library_term(dof, short, unread, codec)
        terms.append(_cross(dof, short, unread.pop(name), codec) if term is None else term)
    for place, dof in enumerate(PLANAR.dofs):
        drags = {term.name: term.values[0] for term in terms if term.dof == place}
        if drags.get("linear-drag", 0.0) < 0 and "quadratic-drag" not in drags:
            name, value = dof.parameter("linear"), drags["linear-drag"]
            raise codec.refusal((*PARAMETERS, name), f"found {value:g}, expected a drag of zero or more")
    current = (water[0], water[1]) if water else None
    model = Model(PLANAR, masses, tuple(terms), SI_UNITS["moment_unit"], current)
    (matrix,) = model.inertia_matrix(model.theta[None])
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        entries = ", ".join(f"{name.partition('.')[2]} = {x:g}" for name, x in zip(model.parameter_names, masses))
        raise codec.refusal(
            PARAMETERS,
            f"found an inertia of {entries}; expected a matrix that is positive definite (m_u, m_v and I_r above zero, "
            "and couplings that are small beside them); check the signs of the added masses, which count as positive "
            "where they add",
        )
    if file.covariance is not None:
        fixed = tuple(name for name in model.parameter_names if name not in file.covariance.parameters)
        model = replace(model, fixed=fixed)
    late = _command_delay(file.command_delay_s, codec)
    models = {PLANAR.name: model.delayed(late)}
    return StoredModels(models, PLANAR.name, late, where, random=file.random)


def _command_delay(stored: Given | None, codec: Codec) -> float:
    late = 0.0 if stored is None else number_at(stored, codec, (COMMAND_DELAY,))
    if abs(late) > MAX_DELAY_S:
        raise codec.refusal((COMMAND_DELAY,), f"found {late:g} s, expected at most {MAX_DELAY_S:g} s either way")
    return late


def _library_term(dof: Dof, short: str, unread: dict[str, float], codec: Codec) -> Term | None:
    """The term of the library that a parameter belongs to, its parameters taken out of what is left; None for none."""
    role = {symbol: role for role, symbol in dof.parameters.items()}.get(short, "")
    name = DRAG_OF_ROLE.get(role, short.partition(".")[0])
    if name not in effects.names():
        return None
    effect = effects.get(name)
    if not effect.acts_in(dof):
        raise codec.refusal((*PARAMETERS, f"{dof.name}.{short}"), f"{name} does not act in {dof.name}; leave it out")
    base = role in DRAG_OF_ROLE  # an effect that was added to the motion's equation has its own name
    keys = (dof.parameter(effect.role),) if base else tuple(f"{dof.name}.{name}.{n}" for n in effect.names_in(dof))
    present = unread.keys() & set(keys)
    if f"{dof.name}.{short}" not in keys:
        raise codec.refusal(
            PARAMETERS, f"unknown key {format_value(f'{dof.name}.{short}')}; did you mean {format_value(keys[0])}?"
        )
    values = values_of(effect, keys, unread, codec, PARAMETERS, "{linear}")  # beside quadratic drag it may be negative
    for key in keys:
        unread.pop(key, None)
    symbols = {key.partition(".")[2].removeprefix(f"{name}.") for key in present}
    if not effect.role and (lacking := effect.lacking(symbols, values, dof)):
        raise codec.missing(PARAMETERS, f"{dof.name}.{name}.{lacking}")
    return Term(name, values, base, PLANAR.index(dof))


def _cross(dof: Dof, short: str, value: float, codec: Codec) -> Term:
    try:
        term = Term.cross(short, value)
    except ModelError:
        raise codec.refusal(PARAMETERS, _unknown(f"{dof.name}.{short}")) from None
    if term.dof != PLANAR.index(dof):
        wrong = f"{short} is no derivative of {PLANAR_FORCES[PLANAR.index(dof)]}, the force of {dof.name}"
        raise codec.refusal((*PARAMETERS, f"{dof.name}.{short}"), wrong)
    return term


def _unknown(name: str) -> str:
    parameters = [name for dof in PLANAR.dofs for name in map(dof.parameter, dof.parameters)]
    names = [*parameters, *(f"{PLANAR.name}.{coupling}" for coupling in INERTIA_COUPLINGS), *CURRENT]
    close = difflib.get_close_matches(name[:MAX_NAME_LETTERS], names, n=1, cutoff=0.8)
    hint = f"did you mean {format_value(close[0])}?" if close else (
        f"known are {', '.join(names)}, effects such as yaw.input-delay.t_d, and derivatives by the velocities "
        f"{', '.join(PLANAR_VELOCITIES)} of others, such as sway.Y_r"
    )  # fmt: skip
    return f"unknown key {format_value(name)}; {hint}"
