"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1).

An unknown key, a value that makes no sense and an effect that is not in the library are refused with the key's
path. The kinds of runs are in `run_groups`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.pipeline.records import FILLER, Codec, Place, everything, in_words, told
from automarine_cli.simulation.checks import at_least_zero
from automarine_cli.simulation.run_groups import RunGroup, group_from
from automarine_cli.simulation.settings import Bollard, Logger, Scatter, Schedule
from automarine_cli.simulation.vehicle import TranslatingVehicle, Vehicle

SCHEMA = "automarine/simulation/1"
SMALLEST, LARGEST = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows


@dataclass(frozen=True)
class EffectSetting:
    """One effect of the library with a value for each of its parameters."""

    name: str
    values: Mapping[str, float]
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        try:
            effect = library.get(self.name)
        except ModelError as problem:
            raise SettingError(str(problem)) from None
        if effect.needs:
            raise SettingError(
                f"effect {self.name!r} needs the column {effect.columns[0]!r}, which simulated runs lack; leave it out"
            )
        names = effect.names_in(self.dof)
        allowed = ", ".join(names)
        for name in self.values:
            if name not in names:
                raise SettingError(f"effect {self.name!r} has no parameter {name!r}; it has {allowed}")
        if lacking := effect.lacking(self.values, self.ordered, self.dof):
            raise SettingError(f"effect {self.name!r} needs its parameter {lacking!r} (of {allowed}); give it")

    @property
    def ordered(self) -> tuple[float, ...]:
        """The values in the effect's own order."""
        effect = library.get(self.name)
        named = zip(effect.names_in(self.dof), effect.parameters)
        return tuple(self.values.get(name, parameter.start) for name, parameter in named)


@dataclass(frozen=True)
class Specification:
    """A whole campaign; `source` is the name of the file that it was read from, for the logs' first line."""

    vehicle: Vehicle
    logger: Logger
    scatter: Scatter
    campaign: Schedule = field(default_factory=Schedule)
    seed: int = 0
    effects: tuple[EffectSetting, ...] = ()
    runs: tuple[RunGroup, ...] = ()
    bollard: Bollard | None = None
    source: str = "specification"

    def __post_init__(self) -> None:
        at_least_zero(self, "seed")

    def model(self) -> YawModel:
        """The true model: the vehicle's drag and the effects, in their order."""
        vehicle = self.vehicle
        terms = tuple(Term(name, (value,), own=True) for name, value in vehicle.terms)
        model = YawModel(vehicle.inertia, terms, vehicle.force_unit, vehicle.dof)
        for effect in self.effects:
            model = model.with_effect(effect.name, effect.ordered)
        return model

    def with_effect(self, name: str, **values: float) -> "Specification":
        """The same campaign with one more effect, parameters by name. Raises SettingError."""
        return replace(self, effects=(*self.effects, EffectSetting(name, values, dof=self.vehicle.dof)))


@dataclass(frozen=True, kw_only=True)
class _Raw:
    """The file's top level, before kinds of vehicles, runs and effects are told apart."""

    schema: str
    vehicle: object
    seed: int = 0
    effects: tuple[object, ...] = ()
    logger: Logger
    scatter: Scatter
    campaign: Schedule
    runs: tuple[object, ...] = ()
    bollard: Bollard | None = None


def specification_from(mapping: Mapping[str, object], where: str = "specification") -> Specification:
    """The specification held by plain data; `where` names it in messages. Raises SettingError."""
    vehicle = mapping.get("vehicle")
    motion = vehicle.get("motion", YAW.name) if isinstance(vehicle, Mapping) else YAW.name
    dof = DOFS.get(motion) if isinstance(motion, str) else None
    if dof is None:
        raise SettingError(f"{where}: vehicle.motion: found {told(motion)}, expected {' or '.join(DOFS)}")
    return _specification(_with_defaults(mapping, dof), where, dof)


def _with_defaults(mapping: Mapping[str, object], dof: Dof) -> dict[str, object]:
    """The data with what goes without saying: headings wrap and begin anywhere, and who sinks or rises is held."""
    log, turns = dof.units.log, dof.wraps
    own: dict[str, dict[str, object]] = {
        "logger": {"wrap": "0..360" if turns else "none", f"glitch_{log}": 90.0 if turns else 1.0},
        "scatter": {f"start_{dof.position}_{log}": "random" if turns else 0.0},
        "campaign": {"held": dof.has_constant},
    }
    given = {key: mapping.get(key, {}) for key in own}
    return {
        **mapping,
        **{key: {**own[key], **table} if isinstance(table, Mapping) else table for key, table in given.items()},
    }


def refuse_unlikely(mapping: Mapping[str, object], where: str) -> None:
    """Refuse another schema, and numbers that no campaign has. Raises SettingError with the key's path."""
    if mapping.get("schema") != SCHEMA:
        raise SettingError(
            f'{where}: schema: found {told(mapping.get("schema"))}, expected the line schema = "{SCHEMA}"'
        )
    for value, place in everything(mapping):
        number = isinstance(value, (int, float)) and value and place != ("seed",)
        if number and not SMALLEST <= abs(value) <= LARGEST:  # type: ignore[arg-type]
            raise SettingError(
                f"{where}: {in_words(place)}found {told(value)}, expected 0 or a size of {SMALLEST:g} to {LARGEST:g}"
            )


def _specification(mapping: Mapping[str, object], where: str, dof: Dof) -> Specification:
    refuse_unlikely(mapping, where)
    codec = Codec(where, dof, others=tuple(DOFS.values()))
    vehicle = codec.read(Vehicle if dof.wraps else TranslatingVehicle, mapping.get("vehicle"), ("vehicle",))
    raw = codec.read(_Raw, mapping)
    if not raw.runs and raw.bollard is None:
        raise SettingError(f"{where}: nothing to simulate; expected [[runs]] or [bollard]")
    return Specification(
        vehicle=vehicle,
        seed=raw.seed,
        effects=tuple(_effect(one, codec, ("effects", i)) for i, one in enumerate(raw.effects)),
        logger=raw.logger,
        scatter=raw.scatter,
        campaign=raw.campaign,
        runs=tuple(group_from(one, codec, ("runs", i)) for i, one in enumerate(raw.runs)),
        bollard=raw.bollard,
        source=where,
    )


def _effect(table: object, codec: Codec, place: Place) -> EffectSetting:
    """An effect's table: its name, and every other key a parameter."""
    if not isinstance(table, Mapping) or "name" not in table:
        raise codec.refusal(
            place, f"found {told(table)}, expected a table with name = one of {', '.join(library.names())}"
        )
    values = {key: value for key, value in table.items() if key != "name"}
    return codec.read(EffectSetting, {"name": table["name"], "values": values}, place)
