"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1).

An unknown key, a value that makes no sense and an effect that is not in the library are refused with the key's
path. The kinds of runs are in `run_groups`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Literal

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.pipeline.plain_data import everything, in_words, told
from automarine_cli.pipeline.recipe import FILLER, from_mapping, key_of, keyed, read_mapping
from automarine_cli.pipeline.words import printable
from automarine_cli.simulation.checks import at_least_zero, between, positive, safe_path
from automarine_cli.simulation.run_groups import KINDS, Format, Levels, RunGroup, group_from, levels_of
from automarine_cli.simulation.vehicle import TranslatingVehicle, Vehicle

SCHEMA = "automarine/simulation/1"
SMALLEST, LARGEST = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows
MOST_JITTER = 0.3  # of a sample period: the clock must keep rising


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
                f"effect {self.name!r} needs the column {effect.needs[0]!r}, which simulated runs lack; leave it out"
            )
        names = effect.names_in(self.dof)
        allowed = ", ".join(names)
        for name in self.values:
            if name not in names:
                raise SettingError(f"effect {self.name!r} has no parameter {name!r}; it has {allowed}")
        for name, parameter in zip(names, effect.parameters):
            if name not in self.values and not parameter.choices:
                raise SettingError(
                    f"effect {self.name!r} needs its parameter {name!r} (of {allowed}); give it"
                )

    @property
    def ordered(self) -> tuple[float, ...]:
        """The values in the effect's own order."""
        effect = library.get(self.name)
        named = zip(effect.names_in(self.dof), effect.parameters)
        return tuple(self.values.get(name, parameter.start) for name, parameter in named)


@dataclass(frozen=True)
class Logger:
    """What the logger does to the truth; positions in the unit of the logs, which ends their keys (`noise_deg`).

    `rate_hz` samples a second; `noise` white noise of the position and `quantisation` its resolution;
    `dropout` share of the samples lost; `clock_jitter_s` standard deviation of the sampling instants around
    an even clock (the stamps are right); `glitch` share of the samples that are off by `glitch_size` to either side;
    `wrap` of the position; `rate_noise` adds a column with the velocity, as a gyro reads it, and that noise;
    `rate_bias` is the standard deviation of what it reads at standstill, drawn for each run.
    """

    rate_hz: float = 10.0
    noise: float = field(default=0.0, metadata=keyed("noise_{log_unit}"))
    quantisation: float = field(default=0.0, metadata=keyed("quantisation_{log_unit}"))
    dropout: float = 0.0
    clock_jitter_s: float = 0.0
    glitch: float = 0.0
    glitch_size: float = field(default=0.0, metadata=keyed("glitch_{log_unit}"))
    wrap: Literal["0..360", "-180..180", "none"] = "none"
    rate_noise: float | None = field(default=None, metadata=keyed("{speed}_noise_{log_unit}_s"))
    rate_bias: float | None = field(default=None, metadata=keyed("{speed}_bias_{log_unit}_s"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        positive(self, "rate_hz")
        at_least_zero(
            self, "noise", "quantisation", "clock_jitter_s", "glitch_size", "rate_noise", "rate_bias"
        )
        between(self, 0.0, 0.9, "dropout", "glitch")
        if self.rate_noise is None and self.rate_bias is not None:
            raise SettingError(
                f"{key_of(self, 'rate_bias')} is of the {self.dof.words.speed}s logged; expected "
                f"{key_of(self, 'rate_noise')} with it (0 for none)"
            )
        if self.clock_jitter_s > MOST_JITTER * self.period:
            raise SettingError(
                f"clock_jitter_s is {self.clock_jitter_s:g}; expected at most {MOST_JITTER:g} of the sample "
                f"period, {MOST_JITTER * self.period:g} s"
            )

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class Scatter:
    """What differs from run to run, drawn anew for each.

    `gain` is the standard deviation of the logarithm of the moment or force delivered over the one commanded;
    `force` that of a constant moment or force added in each run, redrawn until it is at most
    `force_most` of the run's smallest command (who sees his vehicle go the wrong way makes the run
    again); `zero` [unit of logs] that of the sensor's zero; `start` one position, a list that the
    runs take in turn, or "random". In a file of yaw they are `moment`, `moment_most`, `heading_zero_deg` and
    `start_heading_deg`.
    """

    gain: float = 0.0
    force: float = field(default=0.0, metadata=keyed("{force}"))
    force_most: float | None = field(default=None, metadata=keyed("{force}_most"))
    zero: float = field(default=0.0, metadata=keyed("{position}_zero_{log_unit}"))
    start: float | tuple[float, ...] | Literal["random"] = field(
        default=0.0, metadata=keyed("start_{position}_{log_unit}")
    )
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        at_least_zero(self, "gain", "force", "zero")
        if self.force_most is not None:
            positive(self, "force_most")
        if self.start == ():
            raise SettingError(
                f"{key_of(self, 'start')} is an empty list; expected at least one {self.dof.position}"
            )


@dataclass(frozen=True)
class Schedule:
    """How the campaign is run: one clock over all runs, which follow each other after `wait_between_s`.

    Each run has `rest_before_s` and `rest_after_s` without a command in its log. `held`: someone holds the vehicle
    still until the first change of its command.
    """

    order: Literal["listed", "random"] = "listed"
    rest_before_s: float = 3.0
    rest_after_s: float = 0.0
    wait_between_s: float = 60.0
    held: bool = False

    def __post_init__(self) -> None:
        at_least_zero(self, "rest_before_s", "rest_after_s", "wait_between_s")


@dataclass(frozen=True)
class Bollard:
    """A bollard test: `thrusters_per_test` equal thrusters pull together, thrust a_f n² and -a_b n² each [N].

    `levels` of the control signal, each measured `repeats` times with noise of `noise_N`, in random order.
    """

    a_f: float
    a_b: float
    levels: Levels
    thrusters_per_test: int = 1
    repeats: int = 1
    noise_N: float = 0.0
    folder: str = "thrusters"
    name: str = "bollard"
    format: Format = "csv"

    def __post_init__(self) -> None:
        positive(self, "a_f", "a_b", "thrusters_per_test", "repeats")
        at_least_zero(self, "noise_N")
        safe_path(self, "folder", "name")
        levels_of(self.levels)

    @property
    def file(self) -> str:
        """Where the log is, from the campaign's folder."""
        return f"{self.folder}/{self.name}.{self.format}"


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


def read_specification(path: Path) -> Specification:
    """The specification in a TOML (or JSON) file. Raises SettingError with file and key."""
    return specification_from(read_mapping(path), printable(path.name))


def specification_from(mapping: Mapping[str, object], where: str = "specification") -> Specification:
    """The specification held by plain data; `where` names it in messages. Raises SettingError."""
    vehicle = mapping.get("vehicle")
    motion = vehicle.get("motion", YAW.name) if isinstance(vehicle, Mapping) else YAW.name
    dof = DOFS.get(motion) if isinstance(motion, str) else None
    if dof is None:
        raise SettingError(f"{where}: vehicle.motion: found {told(motion)}, expected {' or '.join(DOFS)}")
    if wrong := _of_another(mapping, dof):
        raise SettingError(f"{where}: unknown key {wrong[0]!r}; in {dof.name} it is {wrong[1]!r}")
    return _specification(_with_defaults(mapping, dof), where, dof)


def _of_another(mapping: Mapping[str, object], dof: Dof) -> tuple[str, str] | None:
    """A key by which another motion calls what this one calls otherwise, and what it is here."""
    recipes = (Vehicle, TranslatingVehicle, Logger, Scatter, *KINDS.values())
    templates = {one.metadata["key"] for recipe in recipes for one in fields(recipe) if "key" in one.metadata}
    here = {dof.fill(template) for template in templates}
    others = {one.fill(template): dof.fill(template) for template in templates for one in DOFS.values()}
    places = (place for _, place in everything(mapping) if place and place[0] != "effects")
    keys = (key for place in places if isinstance(key := place[-1], str))
    return next(((key, others[key]) for key in keys if key in others and key not in here), None)


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
        **{
            key: {**own[key], **table} if isinstance(table, Mapping) else table
            for key, table in given.items()
        },
    }


def _specification(mapping: Mapping[str, object], where: str, dof: Dof) -> Specification:
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
    raw = from_mapping(_Raw, mapping, where, dof)
    kind = Vehicle if dof.wraps else TranslatingVehicle
    vehicle = from_mapping(kind, raw.vehicle, f"{where}: vehicle", dof)
    if not raw.runs and raw.bollard is None:
        raise SettingError(f"{where}: nothing to simulate; expected [[runs]] or [bollard]")
    return Specification(
        vehicle=vehicle,
        seed=raw.seed,
        effects=tuple(_effect(one, f"{where}: effects[{i}]", dof) for i, one in enumerate(raw.effects)),
        logger=raw.logger,
        scatter=raw.scatter,
        campaign=raw.campaign,
        runs=tuple(group_from(one, f"{where}: runs[{i}]", dof) for i, one in enumerate(raw.runs)),
        bollard=raw.bollard,
        source=where,
    )


def _effect(table: object, where: str, dof: Dof) -> EffectSetting:
    """An effect's table: its name, and every other key a parameter."""
    if not isinstance(table, Mapping) or "name" not in table:
        raise SettingError(f"{where}: expected a table with name = one of {', '.join(library.names())}")
    values = {key: value for key, value in table.items() if key != "name"}
    return from_mapping(EffectSetting, {"name": table["name"], "values": values}, where, dof)
