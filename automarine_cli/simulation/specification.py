"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1).

An unknown key, a value that makes no sense and an effect that is not in the library are refused with the key's
path. The kinds of runs are in `run_groups`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.pipeline.plain_data import everything, in_words, told
from automarine_cli.pipeline.recipe import from_mapping, read_mapping
from automarine_cli.pipeline.words import printable
from automarine_cli.simulation.checks import at_least_zero, between, positive, safe_path
from automarine_cli.simulation.run_groups import Format, Levels, RunGroup, group_from, levels_of
from automarine_cli.simulation.vehicle import ForceVehicle, Vehicle

SCHEMA = "automarine/simulation/1"
SMALLEST, LARGEST = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows
MOST_JITTER = 0.3  # of a sample period: the clock must keep rising


@dataclass(frozen=True)
class EffectSetting:
    """One effect of the library with a value for each of its parameters."""

    name: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        try:
            effect = library.get(self.name)
        except ModelError as problem:
            raise SettingError(str(problem)) from None
        if effect.needs:
            raise SettingError(
                f"effect {self.name!r} needs the column {effect.needs[0]!r}, which simulated runs lack; leave it out"
            )
        names = [parameter.name_in(YAW) for parameter in effect.parameters]
        allowed = ", ".join(names)
        for name in self.values:
            if name not in names:
                raise SettingError(f"effect {self.name!r} has no parameter {name!r}; it has {allowed}")
        for name in (p.name_in(YAW) for p in effect.parameters if not p.choices):
            if name not in self.values:
                raise SettingError(
                    f"effect {self.name!r} needs its parameter {name!r} (of {allowed}); give it"
                )

    @property
    def ordered(self) -> tuple[float, ...]:
        """The values in the effect's own order."""
        return tuple(self.values.get(p.name_in(YAW), p.start) for p in library.get(self.name).parameters)


@dataclass(frozen=True)
class Logger:
    """What the logger does to the truth.

    `rate_hz` samples a second; `noise_deg` white noise of the heading and `quantisation_deg` its resolution;
    `dropout` share of the samples lost; `clock_jitter_s` standard deviation of the sampling instants around
    an even clock (the stamps are right); `glitch` share of the samples that are off by `glitch_deg` to either side;
    `wrap` of the heading; `rate_noise_deg_s` adds a column with the yaw rate, as a gyro reads it, and that noise;
    `rate_bias_deg_s` is the standard deviation of what it reads at standstill, drawn for each run.
    """

    rate_hz: float = 10.0
    noise_deg: float = 0.0
    quantisation_deg: float = 0.0
    dropout: float = 0.0
    clock_jitter_s: float = 0.0
    glitch: float = 0.0
    glitch_deg: float = 90.0
    wrap: Literal["0..360", "-180..180", "none"] = "0..360"
    rate_noise_deg_s: float | None = None
    rate_bias_deg_s: float | None = None

    def __post_init__(self) -> None:
        positive(self, "rate_hz")
        at_least_zero(self, "noise_deg", "quantisation_deg", "clock_jitter_s", "glitch_deg")
        at_least_zero(self, "rate_noise_deg_s", "rate_bias_deg_s")
        between(self, 0.0, 0.9, "dropout", "glitch")
        if self.rate_noise_deg_s is None and self.rate_bias_deg_s is not None:
            raise SettingError(
                "rate_bias_deg_s is of the rates logged; expected rate_noise_deg_s with it (0 for none)"
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

    `gain` is the standard deviation of the logarithm of the moment delivered over the moment commanded;
    `moment` that of a constant moment [moment unit] added in each run, redrawn until it is at most
    `moment_most` of the run's smallest commanded moment (who sees his vehicle turn the wrong way makes the run
    again); `heading_zero_deg` that of the compass's zero; `start_heading_deg` one heading, a list that the
    runs take in turn, or "random".
    """

    gain: float = 0.0
    moment: float = 0.0
    moment_most: float | None = None
    heading_zero_deg: float = 0.0
    start_heading_deg: float | tuple[float, ...] | Literal["random"] = "random"

    def __post_init__(self) -> None:
        at_least_zero(self, "gain", "moment", "heading_zero_deg")
        if self.moment_most is not None:
            positive(self, "moment_most")
        if self.start_heading_deg == ():
            raise SettingError("start_heading_deg is an empty list; expected at least one heading")


@dataclass(frozen=True)
class Schedule:
    """How the campaign is run: one clock over all runs, which follow each other after `wait_between_s`.

    Each run has `rest_before_s` and `rest_after_s` of zero moment in its log. `held`: someone holds the vehicle
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
    seed: int = 0
    effects: tuple[EffectSetting, ...] = ()
    logger: Logger = field(default_factory=Logger)
    scatter: Scatter = field(default_factory=Scatter)
    campaign: Schedule = field(default_factory=Schedule)
    runs: tuple[RunGroup, ...] = ()
    bollard: Bollard | None = None
    source: str = "specification"

    def __post_init__(self) -> None:
        at_least_zero(self, "seed")

    def model(self) -> YawModel:
        """The true model: the vehicle's drag and the effects, in their order."""
        terms = tuple(Term(name, (value,), own=True) for name, value in self.vehicle.terms)
        model = YawModel(self.vehicle.I_r, terms, self.vehicle.moment_unit, self.vehicle.dof)
        for effect in self.effects:
            model = model.with_effect(effect.name, effect.ordered)
        return model

    def with_effect(self, name: str, **values: float) -> "Specification":
        """The same campaign with one more effect, parameters by name. Raises SettingError."""
        return replace(self, effects=(*self.effects, EffectSetting(name, values)))


@dataclass(frozen=True)
class _Raw:
    """The file's top level, before kinds of runs and effects are told apart."""

    schema: str
    vehicle: Vehicle
    seed: int = 0
    effects: tuple[object, ...] = ()
    logger: Logger = field(default_factory=Logger)
    scatter: Scatter = field(default_factory=Scatter)
    campaign: Schedule = field(default_factory=Schedule)
    runs: tuple[object, ...] = ()
    bollard: Bollard | None = None


@dataclass(frozen=True)
class _RawForce(_Raw):
    vehicle: ForceVehicle = field()


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
    if dof.wraps:
        return _specification(mapping, where, _Raw)
    if wrong := dof.misnamed(mapping):
        raise SettingError(f"{where}: unknown key {wrong!r}; in {dof.name} it is {dof.key(wrong)!r}")
    try:
        return _specification(_with_defaults(dof.plain(mapping), dof), where, _RawForce)
    except SettingError as problem:
        raise SettingError(where + dof.say(str(problem).removeprefix(where))) from None


def _with_defaults(mapping: Mapping[str, object], dof: Dof) -> dict[str, object]:
    """The data of a translation with what goes without saying there: nothing wraps, and who sinks or rises is held."""
    own: dict[str, dict[str, object]] = {
        "logger": {"wrap": "none", "glitch_deg": 1.0},
        "scatter": {"start_heading_deg": 0.0},
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


def _specification(mapping: Mapping[str, object], where: str, form: type[_Raw]) -> Specification:
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
    raw = from_mapping(form, mapping, where)
    if not raw.runs and raw.bollard is None:
        raise SettingError(f"{where}: nothing to simulate; expected [[runs]] or [bollard]")
    return Specification(
        vehicle=raw.vehicle,
        seed=raw.seed,
        effects=tuple(_effect(one, f"{where}: effects[{i}]") for i, one in enumerate(raw.effects)),
        logger=raw.logger,
        scatter=raw.scatter,
        campaign=raw.campaign,
        runs=tuple(group_from(one, f"{where}: runs[{i}]") for i, one in enumerate(raw.runs)),
        bollard=raw.bollard,
        source=where,
    )


def _effect(table: object, where: str) -> EffectSetting:
    """An effect's table: its name, and every other key a parameter."""
    if not isinstance(table, Mapping) or "name" not in table:
        raise SettingError(f"{where}: expected a table with name = one of {', '.join(library.names())}")
    values = {key: value for key, value in table.items() if key != "name"}
    return from_mapping(EffectSetting, {"name": table["name"], "values": values}, where)
