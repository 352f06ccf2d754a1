"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1).

Keys that a motion calls its own way are templates, filled from its record; the kinds of runs are in `run_groups`. An
unknown key, a value that makes no sense and an effect that is not in the library are refused with the key's path.
Motion in the plane has tables of its own:

[vehicle]     motion = "planar", and parameters under the names that planar_model.json has: "surge.m_u", "sway.Y_vv"
[hidden]      more of them, which a model may not know of: "yaw.N_v", "current.north", "yaw.dead-band.width"
[disturbance] forces that nobody logs: Ornstein-Uhlenbeck processes, one for each degree of freedom
[sensors]     a table for each column that is logged: its noise, its bias, and how often it reads
[[runs]]      commands as [X, Y, N, seconds], or drawn at random
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, TypeAlias

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR, Motion
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import planar_from_json
from automarine_cli.models.yaw_model import CONSTANT, Term, YawModel
from automarine_cli.pipeline.records import FILLER, Codec, Place, everything, in_words, key_of, keyed, told
from automarine_cli.pipeline.result_files import PLANAR_MODEL
from automarine_cli.simulation.checks import at_least_zero, between, positive, safe_path
from automarine_cli.simulation.run_groups import Format, Levels, PlanarRuns, RunGroup, group_from, levels_of

SCHEMA = "automarine/simulation/1"
SMALLEST, LARGEST = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows
MOST_JITTER = 0.3  # of a sample period: the clock must keep rising
PLANAR_SENSORS = ("heading_deg", "yaw_rate_deg_s", "surge_m_s", "sway_m_s", "north_m", "east_m")
MOST_PLANAR_RUNS, MOST_PLANAR_SAMPLES = 10_000, 20_000_000


@dataclass(frozen=True)
class Vehicle:
    """The vehicle: inertia [force s², of a translation per metre], `quadratic` [force s²] and `linear` drag [force s].

    In a file they have the names of the motion: `I_r`, `k_rr` and `k_r`, or `m_u`, `X_uu` and `X_u`; the unit of force
    is `moment_unit` or `force_unit`.
    """

    inertia: float = field(metadata=keyed("{inertia_symbol}"))
    quadratic: float = field(default=0.0, metadata=keyed("{quadratic}"))
    linear: float = field(default=0.0, metadata=keyed("{linear}"))
    force_unit: str = field(default="nu", metadata=keyed("{force}_unit"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        positive(self, "inertia")
        at_least_zero(self, "quadratic", "linear")
        if self.force_unit not in self.dof.units.forces:
            raise SettingError(
                f"{key_of(self, 'force_unit')}: expected one of {', '.join(map(repr, self.dof.units.forces))}, "
                f"found {told(self.force_unit)}"
            )
        if self.linear + self.quadratic == 0:
            both = f"{key_of(self, 'quadratic')} and {key_of(self, 'linear')}"
            raise SettingError(f"{both} are both 0; expected a drag, or the vehicle never gets steady")

    @property
    def terms(self) -> list[tuple[str, float]]:
        """Effects that the vehicle is made of, with their one value."""
        return [("quadratic-drag", self.quadratic), ("linear-drag", self.linear)]

    @property
    def model(self) -> YawModel:
        terms = tuple(Term(name, (value,), own=True) for name, value in self.terms if value)
        return YawModel(self.inertia, terms, self.force_unit, self.dof)


@dataclass(frozen=True)
class TranslatingVehicle(Vehicle):
    """A vehicle that moves along one of its axes: `motion` is which.

    `difference` is half the quadratic drag one way less that the other way, the positive way first; `constant_force`
    [force] is weight less buoyancy where that acts, positive down.
    """

    motion: str = ""
    difference: float = field(default=0.0, metadata=keyed("{difference}"))
    constant_force: float = field(default=0.0, metadata=keyed("{constant}"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.difference) >= max(self.quadratic, 1e-300):
            names = f"{key_of(self, 'difference')} is not below {key_of(self, 'quadratic')}"
            raise SettingError(f"{names}; expected a drag that brakes both ways")
        if self.constant_force and not self.dof.has_constant:
            those = " and ".join(dof.name for dof in DOFS.values() if dof.has_constant)
            raise SettingError(
                f'{key_of(self, "constant_force")} is of {those}; elsewhere expected the effect "bias-moment"'
            )

    @property
    def terms(self) -> list[tuple[str, float]]:
        return [*super().terms, (CONSTANT, self.constant_force), ("drag-asymmetry", self.difference)]


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
        at_least_zero(self, "noise", "quantisation", "clock_jitter_s", "glitch_size", "rate_noise", "rate_bias")
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
            raise SettingError(f"{key_of(self, 'start')} is an empty list; expected at least one {self.dof.position}")


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
        return f"{self.folder}/{self.name}.{self.format}"


@dataclass(frozen=True)
class EffectSetting:
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

    @property
    def motion(self) -> Motion:
        return self.model().motion

    def model(self) -> YawModel:
        """Return the true model: the vehicle's drag and the effects, in their order."""
        model = self.vehicle.model
        for effect in self.effects:
            model = model.with_effect(effect.name, effect.ordered)
        return model

    def with_effect(self, name: str, **values: float) -> "Specification":
        """Return the campaign with one more effect, parameters by name. Raises SettingError."""
        return replace(self, effects=(*self.effects, EffectSetting(name, values, dof=self.vehicle.dof)))


@dataclass(frozen=True, kw_only=True)
class PlanarVehicle:
    motion: Literal["planar"] = "planar"
    parameters: Mapping[str, float]
    model: ClassVar[None] = None


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One column: white `noise`, `bias` (standard deviation, drawn for each run) in its unit, and `every_s`, the time
    between its readings, which the logger repeats; None: a reading in every row."""

    noise: float = 0.0
    bias: float = 0.0
    every_s: float | None = None

    def __post_init__(self) -> None:
        at_least_zero(self, "noise", "bias")
        positive(self, "every_s")


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Standard deviations of the forces [N] and the moment [N m] that nobody logs, and their time constant [s]."""

    surge_N: float = 0.0
    sway_N: float = 0.0
    yaw_Nm: float = 0.0
    time_s: float = 5.0

    def __post_init__(self) -> None:
        at_least_zero(self, "surge_N", "sway_N", "yaw_Nm")
        positive(self, "time_s")

    @property
    def sizes(self) -> tuple[float, float, float]:
        return self.surge_N, self.sway_N, self.yaw_Nm


@dataclass(frozen=True, kw_only=True)
class PlanarLogger:
    """How often a row is written, and how long the vehicle rests before the first command and after the last."""

    rate_hz: float = 5.0
    rest_before_s: float = 2.0
    rest_after_s: float = 2.0
    wait_between_s: float = 60.0
    order: ClassVar[str] = "listed"
    held: ClassVar[bool] = False
    clock_jitter_s: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        positive(self, "rate_hz")
        at_least_zero(self, "rest_before_s", "rest_after_s", "wait_between_s")

    @property
    def period(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True, kw_only=True)
class PlanarScatter:
    """`gain`: standard deviation of the logarithm of what is delivered over what is commanded, drawn for each run;
    `start` heading where runs begin, "random" for anywhere."""

    gain: float = 0.0
    start: float | Literal["random"] = field(default=0.0, metadata=keyed("start_{position}_{log_unit}"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        at_least_zero(self, "gain")


@dataclass(frozen=True, kw_only=True)
class PlanarSpecification:
    """A whole campaign; `source` is the name of the file that it was read from, for the logs' first line."""

    schema: str
    vehicle: PlanarVehicle
    hidden: Mapping[str, float] = field(default_factory=dict)
    disturbance: Disturbance = Disturbance()
    sensors: Mapping[str, Sensor]
    logger: PlanarLogger = PlanarLogger()
    scatter: PlanarScatter = PlanarScatter(dof=YAW)
    runs: tuple[PlanarRuns, ...]
    seed: int = 0
    source: str = "specification"
    motion: ClassVar[Motion] = PLANAR
    effects: ClassVar[tuple[()]] = ()
    bollard: ClassVar[None] = None

    def __post_init__(self) -> None:
        at_least_zero(self, "seed")
        unknown = [name for name in self.sensors if name not in PLANAR_SENSORS]
        if unknown or not self.sensors:
            found = told(unknown[0]) if unknown else "none"
            raise SettingError(f"sensors: found {found}, expected some of {', '.join(PLANAR_SENSORS)}")
        if "heading_deg" not in self.sensors:
            raise SettingError("sensors: heading_deg is missing; give it, as every log of motion in the plane has it")
        twice = sorted(set(self.vehicle.parameters) & set(self.hidden))
        if twice:
            raise SettingError(f"hidden: {twice[0]!r} is a parameter of the vehicle too; give it once")
        places = [f"{group.folder}/{group.name}" for group in self.runs]
        if not places or len(set(places)) < len(places):
            raise SettingError("runs: expected at least one [[runs]], each with a name of its own")
        if sum(group.repeats for group in self.runs) > MOST_PLANAR_RUNS:
            raise SettingError(f"runs: more than {MOST_PLANAR_RUNS} would be made; ask for fewer")
        samples = self.logger.rate_hz * sum(group.repeats * group.length for group in self.runs)
        if samples > MOST_PLANAR_SAMPLES:
            raise SettingError(
                f"runs: {samples:.3g} samples would be made; expected at most {MOST_PLANAR_SAMPLES:.0g}. Ask for fewer "
                "or shorter runs, or a lower rate_hz"
            )
        shortest = min(group.shortest for group in self.runs)
        if shortest * self.logger.rate_hz < 2.0:
            raise SettingError(
                f"runs: a command is held for {shortest:g} s; expected at least two samples, "
                f"{2.0 / self.logger.rate_hz:g} s"
            )
        self.model()  # refused where it is none

    @property
    def campaign(self) -> PlanarLogger:
        return self.logger

    def model(self, hidden: bool = True) -> PlanarModel:
        """Return the true model, or what a model knows of it without what is `hidden`. Raises SettingError."""
        parameters = {**self.vehicle.parameters, **(self.hidden if hidden else {})}
        try:
            model = planar_from_json({"schema": PLANAR_MODEL.schema, "parameters": parameters}, "vehicle").model
        except ModelError as problem:
            raise SettingError(str(problem)) from None
        for dof, terms in zip(PLANAR.dofs, (model.surge, model.sway, model.yaw)):
            for term in terms:
                effect = library.get(term.name)
                if effect.needs or effect.varies(term.values):
                    raise SettingError(
                        f"{dof.name}.{term.name} cannot be simulated in the plane: it needs a column, or a coefficient "
                        "of its own in each run; leave it out"
                    )
        return model


AnySpecification: TypeAlias = Specification | PlanarSpecification


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


def specification_from(mapping: Mapping[str, object], where: str = "specification") -> AnySpecification:
    """Read a specification of any motion; `where` names it in messages. Raises SettingError with the key.

    Headings wrap and begin anywhere, and who sinks or rises is held: that goes without saying.
    """
    vehicle = mapping.get("vehicle")
    motion = vehicle.get("motion", YAW.name) if isinstance(vehicle, Mapping) else YAW.name
    if motion == PLANAR.name:
        _refuse_unlikely(mapping, where)
        return Codec(where, YAW).read(PlanarSpecification, {**mapping, "source": where})
    dof = DOFS.get(motion) if isinstance(motion, str) else None
    if dof is None:
        raise SettingError(f"{where}: vehicle.motion: found {told(motion)}, expected {' or '.join(DOFS)}")
    log, turns = dof.units.log, dof.wraps
    defaults: dict[str, dict[str, object]] = {
        "logger": {"wrap": "0..360" if turns else "none", f"glitch_{log}": 90.0 if turns else 1.0},
        "scatter": {f"start_{dof.position}_{log}": "random" if turns else 0.0},
        "campaign": {"held": dof.has_constant},
    }
    tables = {key: mapping.get(key, {}) for key in defaults}
    mapping = {
        **mapping,
        **{name: {**defaults[name], **part} if isinstance(part, Mapping) else part for name, part in tables.items()},
    }
    _refuse_unlikely(mapping, where)
    codec = Codec(where, dof, others=tuple(DOFS.values()))
    base = codec.read(Vehicle if turns else TranslatingVehicle, mapping.get("vehicle"), ("vehicle",))
    raw = codec.read(_Raw, mapping)
    if not raw.runs and raw.bollard is None:
        raise SettingError(f"{where}: nothing to simulate; expected [[runs]] or [bollard]")
    effects = tuple(_effect(table, codec, ("effects", i)) for i, table in enumerate(raw.effects))
    runs = tuple(group_from(table, codec, ("runs", i)) for i, table in enumerate(raw.runs))
    return Specification(base, raw.logger, raw.scatter, raw.campaign, raw.seed, effects, runs, raw.bollard, where)


def _refuse_unlikely(mapping: Mapping[str, object], where: str) -> None:
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


def _effect(table: object, codec: Codec, place: Place) -> EffectSetting:
    """An effect's table: its name, and every other key a parameter."""
    if not isinstance(table, Mapping) or "name" not in table:
        raise codec.refusal(
            place, f"found {told(table)}, expected a table with name = one of {', '.join(library.names())}"
        )
    values = {key: value for key, value in table.items() if key != "name"}
    return codec.read(EffectSetting, {"name": table["name"], "values": values}, place)
