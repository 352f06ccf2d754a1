"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1), the kinds
of runs, and the streams of random numbers that are drawn for them.

Keys that a motion calls its own way are templates, filled from its record; a new kind of runs is one class. An unknown
key, a value that makes no sense and an effect that is not in the library are refused with the key's path. Motion in the
plane has tables of its own, with parameters under the names that planar_model.json has: "surge.m_u", "sway.Y_vv"."""

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field
from string import ascii_lowercase
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args, get_type_hints

import numpy as np
from scipy import optimize
from scipy.special import ndtri

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR, Motion
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.store import PLANAR_MODEL, planar_from_json
from automarine_cli.models.yaw_model import CONSTANT, Term, YawModel, response
from automarine_cli.pipeline.records import FILLER, Codec, Record, everything, key_of, keyed
from automarine_cli.quantities import Floats
from automarine_cli.text import Place, in_words, told


@dataclass(frozen=True)
class Limit:
    """What the annotation of a setting says of its value."""

    low: float = 0.0
    high: float = math.inf
    above: bool = False  # `low` itself is refused

    def refuses(self, value: float) -> bool:
        return not self.low <= value <= self.high or (self.above and value == self.low)

    def __str__(self) -> str:
        if self.above:
            return "more than 0"
        return "0 or more" if self == Limit() else f"{self.low:g} to {self.high:g}"


AboveZero: TypeAlias = Annotated[float, Limit(above=True)]
ZeroOrMore: TypeAlias = Annotated[float, Limit()]
CountAboveZero: TypeAlias = Annotated[int, Limit(above=True)]


class Settings:
    """Base of settings that are refused where a value is beyond the limit of its annotation; None is fine."""

    __dataclass_fields__: ClassVar[dict[str, "Field[Any]"]]

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(type(self), include_extras=True).items():
            # also of `AboveZero | None`
            limits = [part.__metadata__[0] for part in (hint, *get_args(hint)) if hasattr(part, "__metadata__")]
            value = getattr(self, name) if limits else None
            if value is not None and limits[0].refuses(value):
                raise SettingError(f"{key_of(self, name)} is {value:g}; expected {limits[0]}")


def safe_path(settings: Record, *names: str) -> None:
    """Refuse a name for files that could lead out of the result folder, or that some system cannot write."""
    for name in names:
        value = getattr(settings, name)
        part = r"[A-Za-z0-9+_-][A-Za-z0-9+_.-]*(?<!\.)"
        if value is not None and not re.fullmatch(f"{part}(/{part})*", value):
            expected = "expected a name of letters, digits and - + _ . (folders with /)"
            raise SettingError(f"{key_of(settings, name)} is {value!r}; {expected}")


TINY = 2.0**-54  # keeps a uniform deviate off zero


def uniform(count: int, seed: int, *words: str) -> Floats:
    """Uniform deviates in [0, 1), shape (count,), of the stream with that key."""
    return _stream(seed, words).random(count)


def normal(count: int, seed: int, *words: str) -> Floats:
    """Standard normal deviates, shape (count,), of the stream with that key."""
    return np.asarray(ndtri(_stream(seed, words).random(count) + TINY))


def _stream(seed: int, words: tuple[str, ...]) -> np.random.Generator:
    key = hashlib.sha256("\0".join(words).encode()).digest()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int.from_bytes(key, "big")])))


Format: TypeAlias = Literal["csv", "csv.gz", "parquet"]
Commands: TypeAlias = tuple[tuple[float, float], ...]

Run: TypeAlias = tuple[str, str, tuple[tuple[Any, float], ...]]
"""Its name, the key of its random streams, and what is commanded."""
MOST_LEVELS = 100_000
LABELS = {"step": "{f}", "coast-down": "coast"}  # what labels begin with where it is not the kind


@dataclass(frozen=True)
class Range(Settings):
    """Values from one to the other in equal steps, both ends included, without zero."""

    from_: float
    to: float
    step: AboveZero

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.to < self.from_:
            raise SettingError(f"to is {self.to:g}; expected at least from, {self.from_:g}")
        if (self.to - self.from_) / self.step > MOST_LEVELS:
            raise SettingError(f"step is {self.step:g}; that makes more than {MOST_LEVELS} values; give a larger step")

    @property
    def values(self) -> tuple[float, ...]:
        count = int((self.to - self.from_) / self.step + 1e-9) + 1
        every = (round(self.from_ + i * self.step, 10) for i in range(count))  # three steps of 0.1 are 0.3
        return tuple(value for value in every if value != 0)


Levels: TypeAlias = tuple[float, ...] | Range


def levels_of(levels: Levels) -> tuple[float, ...]:
    values = levels.values if isinstance(levels, Range) else levels
    if not values:
        raise SettingError("no values are left in the list or range of levels; expected at least one")
    return values


@dataclass(frozen=True, kw_only=True)
class RunGroup(Settings):
    """What all kinds share: where the logs go and what is wrong with them on purpose.

    Files are `folder/LABEL.format` with a letter for the repeat (or `suffix`); with `together` all runs of the
    group go into the one file of that name, distinguished by a column `run`. `wait_after_s` takes the place of the
    campaign's wait after each of these runs."""

    kind: str
    name: str | None = None
    folder: str = "runs"
    format: Format = "csv"
    together: str | None = None
    repeats: CountAboveZero = 1
    suffix: str | None = None
    fault: Literal["never-moves"] | None = None
    wait_after_s: ZeroOrMore | None = None
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        safe_path(self, "name", "folder", "together", "suffix")
        if self.suffix is not None and self.repeats > 1:
            raise SettingError("suffix names a single run; expected repeats = 1 with it")

    def runs(self, model: Any, seed: int) -> Iterator[Run]:
        for label, commands in self.cases(model):
            for repeat in range(self.repeats):
                key = f"{self.folder}/{label}#{self.suffix or repeat}"
                yield named(label, repeat, self.repeats, self.suffix), key, commands

    @property
    def base(self) -> str:
        return self.name or self.dof.fill(LABELS.get(self.kind, self.kind))

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        """Label and commands of each run, repeats left out."""
        raise NotImplementedError


def named(label: str, repeat: int, repeats: int, suffix: str | None = None) -> str:
    """Return the name of a run: its label, and a letter (or number) where there are several."""
    letter = ascii_lowercase[repeat] if repeats <= len(ascii_lowercase) else str(repeat + 1)
    return f"{label}_{suffix or (letter if repeats > 1 else '')}".rstrip("_")


@dataclass(frozen=True, kw_only=True)
class StepRuns(RunGroup):
    """One constant moment or force, each of `levels`, held until the base vehicle has gone its `way` [unit of logs], or
    for `duration_s`. In a file of yaw they are `moments` and `turn_deg`, of a translation `forces` and `travel_m`.

    A coast-down lets go for `coast_s`; a reversal has the opposite for `back_s`, by default for twice as long."""

    kind: Literal["step", "coast-down", "reversal"] = "step"
    levels: Levels = field(metadata=keyed("{forces}"))
    way: AboveZero | None = field(default=None, metadata=keyed("{way_key}_{log_unit}"))
    duration_s: AboveZero | None = None
    coast_s: AboveZero | None = None
    back_s: AboveZero | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.kind == "coast-down") is (self.coast_s is None) or (self.back_s and self.kind != "reversal"):
            raise SettingError("expected coast_s with coast-downs, back_s with reversals, and none of both with steps")
        if (self.way is None) == (self.duration_s is None):
            raise SettingError(f"expected one of {key_of(self, 'way')} and duration_s")
        if 0.0 in levels_of(self.levels):
            name = key_of(self, "levels")
            raise SettingError(f'{name} has a zero; expected other values (a run of kind "rest" has none)')

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        for moment in levels_of(self.levels):
            way = self.dof.inner(self.way or 0.0)
            hold = time_to_turn(way, moment, model) if self.duration_s is None else self.duration_s
            commands = [(moment, hold)]
            if self.coast_s:
                commands.append((0.0, self.coast_s))
            if self.kind == "reversal":
                commands.append((-moment, self.back_s or 2.0 * hold))
            yield f"{self.base}_{moment_text(moment)}", tuple(commands)


@dataclass(frozen=True, kw_only=True)
class SequenceRuns(RunGroup):
    """Any `commands`, each [moment or force, seconds], like the source paper's figure 10."""

    kind: Literal["sequence"] = "sequence"
    commands: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.commands or min(seconds for _, seconds in self.commands) <= 0:
            force = self.dof.words.force
            raise SettingError(f"commands: expected at least one [{force}, seconds], each longer than 0 s")

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        yield self.base, self.commands


@dataclass(frozen=True, kw_only=True)
class RampRuns(RunGroup):
    """The command goes from `from_` to `to` in `steps` equal stairs over `duration_s`."""

    kind: Literal["ramp"] = "ramp"
    to: float
    duration_s: AboveZero
    from_: float = 0.0
    steps: CountAboveZero = 20

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        stairs = np.linspace(self.from_, self.to, self.steps + 1)[1:].round(6).tolist()
        yield f"{self.base}_{moment_text(self.to)}", tuple((moment, self.duration_s / self.steps) for moment in stairs)


@dataclass(frozen=True, kw_only=True)
class RestRuns(RunGroup):
    kind: Literal["rest"] = "rest"
    duration_s: AboveZero

    def cases(self, model: YawModel) -> Iterator[tuple[str, Commands]]:
        yield self.base, ((0.0, self.duration_s),)


@dataclass(frozen=True, kw_only=True)
class PlanarRuns(RunGroup):
    """Runs of one kind in the plane: `commands` one after the other as [X N, Y N, N N m, seconds]; or drawn anew for
    each of the `repeats`, between minus and plus the `largest` of each, held for `hold_s` [least, most], over
    `duration_s`."""

    kind: Literal["planar"] = "planar"
    name: str
    fault: None = None
    commands: tuple[tuple[float, float, float, float], ...] = ()
    largest: tuple[float, float, float] | None = None
    hold_s: tuple[float, float] = (2.0, 5.0)
    duration_s: AboveZero = 40.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.commands) == (self.largest is not None):
            raise SettingError("expected one of commands = [[X, Y, N, seconds], ...] and largest = [X, Y, N]")
        if any(seconds <= 0 for *_, seconds in self.commands):
            raise SettingError("commands: expected each longer than 0 s")
        if not 0 < self.hold_s[0] <= self.hold_s[1]:
            raise SettingError("hold_s: expected [least, most], both above 0")

    @property
    def length(self) -> float:
        return sum(seconds for *_, seconds in self.commands) if self.commands else self.duration_s

    @property
    def shortest(self) -> float:
        return min((seconds for *_, seconds in self.commands), default=min(self.hold_s[0], self.duration_s))

    def runs(self, model: Any, seed: int) -> Iterator[Run]:
        for repeat in range(self.repeats):
            name = named(self.name, repeat, self.repeats, self.suffix)
            key = f"{self.folder}/{name}"
            drawn = self._drawn(seed, key) if self.largest else [(row[:3], row[3]) for row in self.commands]
            yield name, key, tuple(drawn)

    def _drawn(self, seed: int, key: str) -> list[tuple[tuple[float, ...], float]]:
        least, most = self.hold_s
        holds: list[float] = []
        for share in uniform(int(self.duration_s / least) + 1, seed, key, "hold"):
            remaining = self.duration_s - sum(holds)
            if remaining < least:
                break
            hold = least + (most - least) * float(share)
            holds.append(remaining if remaining - hold < least else hold)
        draw = np.stack([uniform(len(holds), seed, key, "command", dof.name) for dof in PLANAR.dofs], axis=1)
        commands = np.round((2.0 * draw - 1.0) * np.array(self.largest), 3) + 0.0
        return [(tuple(row), hold) for row, hold in zip(commands.tolist(), holds)]


KINDS: Mapping[str, type[RunGroup]] = {
    **dict.fromkeys(("step", "coast-down", "reversal"), StepRuns),
    "sequence": SequenceRuns,
    "ramp": RampRuns,
    "rest": RestRuns,
}


def moment_text(moment: float) -> str:
    text = f"{moment:+.10g}"
    return text if set(text) & {".", "e"} else f"{text}.0"


def time_to_turn(angle: float, moment: float, model: YawModel) -> float:
    """Return the time [s] in which the vehicle goes `angle` [rad or m] from rest under a constant moment or force."""
    net = abs(moment + sum(term.values[0] for term in model.terms if term.name == CONSTANT))
    if net == 0:
        force = model.dof.words.force
        raise SettingError(f"{force}s holds {moment:g}, which the constant force balances; expected others")
    drag = model.drag()

    def turned(time: float) -> float:
        return float(response(time, net, model.inertia, *drag)[0])

    high = 1.0
    while turned(high) < angle:
        high *= 2.0
    return float(optimize.brentq(lambda time: turned(time) - angle, 0.0, high, xtol=1e-14))


SCHEMA = "automarine/simulation/1"
SMALLEST, LARGEST = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows
MOST_JITTER = 0.3  # of a sample period: the clock must keep rising
PLANAR_SENSORS = ("heading_deg", "yaw_rate_deg_s", "surge_m_s", "sway_m_s", "north_m", "east_m")
MOST_PLANAR_SAMPLES = 20_000_000
TOO_MANY_SAMPLES = (
    "{:.3g} samples would be made; expected at most {:.0g}. Ask for fewer or shorter runs, or a lower rate_hz"
)


@dataclass(frozen=True)
class Vehicle(Settings):
    """The vehicle: inertia [force s², of a translation per metre], `quadratic` [force s²] and `linear` drag [force s].

    In a file they have the names of the motion: `I_r`, `k_rr` and `k_r`, or `m_u`, `X_uu` and `X_u`; the unit of force
    is `moment_unit` or `force_unit`. Who moves along an axis says which by `motion`; `difference` is half the quadratic
    drag one way less that the other way, the positive way first; `constant_force` [force] is weight less buoyancy where
    that acts, positive down."""

    inertia: AboveZero = field(metadata=keyed("{inertia_symbol}"))
    quadratic: ZeroOrMore = field(default=0.0, metadata=keyed("{quadratic}"))
    linear: ZeroOrMore = field(default=0.0, metadata=keyed("{linear}"))
    force_unit: str = field(default="nu", metadata=keyed("{force}_unit"))
    motion: str | None = None
    difference: float | None = field(default=None, metadata=keyed("{difference}"))
    constant_force: float | None = field(default=None, metadata=keyed("{constant}"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.force_unit not in self.dof.units.forces:
            units = ", ".join(map(repr, self.dof.units.forces))
            raise SettingError(f"{key_of(self, 'force_unit')}: expected one of {units}, found {told(self.force_unit)}")
        if self.linear + self.quadratic == 0:
            keys = f"{key_of(self, 'quadratic')} and {key_of(self, 'linear')}"
            raise SettingError(f"{keys} are both 0; expected a drag, or the vehicle never gets steady")
        if abs(self.difference or 0.0) >= max(self.quadratic, 1e-300):
            names = f"{key_of(self, 'difference')} is not below {key_of(self, 'quadratic')}"
            raise SettingError(f"{names}; expected a drag that brakes both ways")
        if self.constant_force and not self.dof.has_constant:
            those, key = " and ".join(dof.name for dof in DOFS.values() if dof.has_constant), "constant_force"
            raise SettingError(f'{key_of(self, key)} is of {those}; elsewhere expected the effect "bias-moment"')

    @property
    def model(self) -> YawModel:
        values = {
            "quadratic-drag": self.quadratic, "linear-drag": self.linear, CONSTANT: self.constant_force,
            "drag-asymmetry": self.difference,
        }  # fmt: skip
        terms = tuple(Term(name, (value,), base=True) for name, value in values.items() if value)
        return YawModel(self.inertia, terms, self.force_unit, self.dof)


@dataclass(frozen=True)
class Logger(Settings):
    """What the logger does to the truth; positions in the unit of the logs, which ends their keys (`noise_deg`).

    `rate_hz` samples a second; `noise` white noise of the position and `quantisation` its resolution;
    `dropout` share of the samples lost; `clock_jitter_s` standard deviation of the sampling instants around
    an even clock (the stamps are right); `glitch` share of the samples that are off by `glitch_size` to either side;
    `wrap` of the position; `rate_noise` adds a column with the velocity, as a gyro reads it, and that noise;
    `rate_bias` is the standard deviation of what it reads at standstill, drawn for each run."""

    rate_hz: AboveZero = 10.0
    noise: ZeroOrMore = field(default=0.0, metadata=keyed("noise_{log_unit}"))
    quantisation: ZeroOrMore = field(default=0.0, metadata=keyed("quantisation_{log_unit}"))
    dropout: Annotated[float, Limit(0.0, 0.9)] = 0.0
    clock_jitter_s: ZeroOrMore = 0.0
    glitch: Annotated[float, Limit(0.0, 0.9)] = 0.0
    glitch_size: ZeroOrMore = field(default=0.0, metadata=keyed("glitch_{log_unit}"))
    wrap: Literal["0..360", "-180..180", "none"] = "none"
    rate_noise: ZeroOrMore | None = field(default=None, metadata=keyed("{speed}_noise_{log_unit}_s"))
    rate_bias: ZeroOrMore | None = field(default=None, metadata=keyed("{speed}_bias_{log_unit}_s"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_noise is None and self.rate_bias is not None:
            bias, expected = key_of(self, "rate_bias"), f"expected {key_of(self, 'rate_noise')} with it (0 for none)"
            raise SettingError(f"{bias} is of the {self.dof.words.speed}s logged; {expected}")
        if self.clock_jitter_s > (most := MOST_JITTER * self.period):
            expected = f"expected at most {MOST_JITTER:g} of the sample period, {most:g} s"
            raise SettingError(f"clock_jitter_s is {self.clock_jitter_s:g}; {expected}")

    @property
    def period(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class Scatter(Settings):
    """What differs from run to run, drawn anew for each.

    `gain` is the standard deviation of the logarithm of the moment or force delivered over the one commanded;
    `force` that of a constant moment or force added in each run, redrawn until it is at most
    `force_most` of the run's smallest command (who sees his vehicle go the wrong way makes the run
    again); `zero` [unit of logs] that of the sensor's zero; `start` one position, a list that the
    runs take in turn, or "random". In a file of yaw they are `moment`, `moment_most`, `heading_zero_deg` and
    `start_heading_deg`."""

    gain: ZeroOrMore = 0.0
    force: ZeroOrMore = field(default=0.0, metadata=keyed("{force}"))
    force_most: AboveZero | None = field(default=None, metadata=keyed("{force}_most"))
    zero: ZeroOrMore = field(default=0.0, metadata=keyed("{position}_zero_{log_unit}"))
    start: float | tuple[float, ...] | Literal["random"] = field(
        default=0.0, metadata=keyed("start_{position}_{log_unit}")
    )
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == ():
            raise SettingError(f"{key_of(self, 'start')} is an empty list; expected at least one {self.dof.position}")


@dataclass(frozen=True)
class Schedule(Settings):
    """How the campaign is run: one clock over all runs, which follow each other after `wait_between_s`.

    Each run has `rest_before_s` and `rest_after_s` without a command in its log. `held`: someone holds the vehicle
    still until the first change of its command."""

    order: Literal["listed", "random"] = "listed"
    rest_before_s: ZeroOrMore = 3.0
    rest_after_s: ZeroOrMore = 0.0
    wait_between_s: ZeroOrMore = 60.0
    held: bool = False


@dataclass(frozen=True)
class Bollard(Settings):
    """A bollard test: `thrusters_per_test` equal thrusters pull together, thrust a_f n² and -a_b n² each [N].

    `levels` of the control signal, each measured `repeats` times with noise of `noise_N`, in random order."""

    a_f: AboveZero
    a_b: AboveZero
    levels: Levels
    thrusters_per_test: CountAboveZero = 1
    repeats: CountAboveZero = 1
    noise_N: ZeroOrMore = 0.0
    folder: str = "thrusters"
    name: str = "bollard"
    format: Format = "csv"

    def __post_init__(self) -> None:
        super().__post_init__()
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
        if unknown := next((name for name in self.values if name not in names), None):
            raise SettingError(f"effect {self.name!r} has no parameter {unknown!r}; it has {allowed}")
        if lacking := effect.lacking(self.values, self.ordered, self.dof):
            raise SettingError(f"effect {self.name!r} needs its parameter {lacking!r} (of {allowed}); give it")

    @property
    def ordered(self) -> tuple[float, ...]:
        effect = library.get(self.name)
        pairs = zip(effect.names_in(self.dof), effect.parameters)
        return tuple(self.values.get(name, parameter.start) for name, parameter in pairs)


@dataclass(frozen=True)
class Specification(Settings):
    vehicle: Vehicle
    logger: Logger
    scatter: Scatter
    campaign: Schedule = field(default_factory=Schedule)
    seed: Annotated[int, Limit()] = 0
    effects: tuple[EffectSetting, ...] = ()
    runs: tuple[RunGroup, ...] = ()
    bollard: Bollard | None = None
    source: str = "specification"
    schema: str = SCHEMA

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.runs and self.bollard is None:
            raise SettingError("nothing to simulate; expected [[runs]] or [bollard]")

    @property
    def motion(self) -> Motion:
        return self.vehicle.model.motion

    def model(self) -> YawModel:
        model = self.vehicle.model
        for effect in self.effects:
            model = model.with_effect(effect.name, effect.ordered)
        return model


@dataclass(frozen=True, kw_only=True)
class PlanarVehicle:
    motion: Literal["planar"] = "planar"
    parameters: Mapping[str, float]
    model: ClassVar[None] = None


@dataclass(frozen=True, kw_only=True)
class Sensor(Settings):
    """One column: white `noise`, `bias` (standard deviation, drawn for each run) in its unit, and `every_s`, the time
    between its readings, which the logger repeats; None: a reading in every row."""

    noise: ZeroOrMore = 0.0
    bias: ZeroOrMore = 0.0
    every_s: AboveZero | None = None


@dataclass(frozen=True, kw_only=True)
class Disturbance(Settings):
    """Standard deviations of the forces [N] and the moment [N m] that nobody logs, and their time constant [s]."""

    surge_N: ZeroOrMore = 0.0
    sway_N: ZeroOrMore = 0.0
    yaw_Nm: ZeroOrMore = 0.0
    time_s: AboveZero = 5.0


@dataclass(frozen=True, kw_only=True)
class PlanarLogger(Settings):
    """How often a row is written, and how long the vehicle rests before the first command and after the last."""

    rate_hz: AboveZero = 5.0
    rest_before_s: ZeroOrMore = 2.0
    rest_after_s: ZeroOrMore = 2.0
    wait_between_s: ZeroOrMore = 60.0
    order: ClassVar[str] = "listed"
    held: ClassVar[bool] = False
    clock_jitter_s: ClassVar[float] = 0.0

    @property
    def period(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True, kw_only=True)
class PlanarScatter(Settings):
    """`gain`: standard deviation of the logarithm of what is delivered over what is commanded, drawn for each run;
    `start` heading where runs begin, "random" for anywhere."""

    gain: ZeroOrMore = 0.0
    start: float | Literal["random"] = field(default=0.0, metadata=keyed("start_{position}_{log_unit}"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)


@dataclass(frozen=True, kw_only=True)
class PlanarSpecification(Settings):
    schema: str
    vehicle: PlanarVehicle
    hidden: Mapping[str, float] = field(default_factory=dict)
    disturbance: Disturbance = Disturbance()
    sensors: Mapping[str, Sensor]
    logger: PlanarLogger = PlanarLogger()
    scatter: PlanarScatter = PlanarScatter(dof=YAW)
    runs: tuple[PlanarRuns, ...]
    seed: Annotated[int, Limit()] = 0
    source: str = "specification"
    motion: ClassVar[Motion] = PLANAR
    effects: ClassVar[tuple[()]] = ()
    bollard: ClassVar[None] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = [name for name in self.sensors if name not in PLANAR_SENSORS]
        if unknown or not self.sensors:
            wrong = told(unknown[0]) if unknown else "none"
            raise SettingError(f"sensors: found {wrong}, expected some of {', '.join(PLANAR_SENSORS)}")
        if "heading_deg" not in self.sensors:
            raise SettingError("sensors: heading_deg is missing; give it, as every log of motion in the plane has it")
        twice = sorted(set(self.vehicle.parameters) & set(self.hidden))
        if twice:
            raise SettingError(f"hidden: {twice[0]!r} is a parameter of the vehicle too; give it once")
        places = [f"{group.folder}/{group.name}" for group in self.runs]
        if not places or len(set(places)) < len(places):
            raise SettingError("runs: expected at least one [[runs]], each with a name of its own")
        samples = self.logger.rate_hz * sum(group.repeats * group.length for group in self.runs)
        if samples > MOST_PLANAR_SAMPLES:
            raise SettingError(f"runs: {TOO_MANY_SAMPLES.format(samples, MOST_PLANAR_SAMPLES)}")
        shortest, least = min(group.shortest for group in self.runs), 2.0 / self.logger.rate_hz
        if shortest < least:
            expected = f"expected at least two samples, {least:g} s"
            raise SettingError(f"runs: a command is held for {shortest:g} s; {expected}")
        self.model()  # refused where it is none

    @property
    def campaign(self) -> PlanarLogger:
        return self.logger

    def model(self) -> PlanarModel:
        """Return the true model, with what is hidden. Raises SettingError."""
        parameters = {**self.vehicle.parameters, **self.hidden}
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


class _KindsCodec(Codec):
    """Reads the vehicle, the runs and the effects of one degree of freedom by what they say they are."""

    def read(self, record: type[Any], data: object, place: Place = ()) -> Any:
        table = data if isinstance(data, Mapping) else {}
        if record is RunGroup:
            kind = table.get("kind")
            if not isinstance(kind, str) or kind not in KINDS:
                raise self.refusal(place, f"kind is {kind!r}; expected one of {', '.join(KINDS)}")
            record = KINDS[kind]
        elif record is EffectSetting:
            if "name" not in table:
                expected = f"a table with name = one of {', '.join(library.names())}"
                raise self.refusal(place, f"found {told(data)}, expected {expected}")
            values = {key: value for key, value in table.items() if key != "name"}
            data = {"name": table["name"], "values": values}
        return super().read(record, data, place)


def specification_from(mapping: Mapping[str, object], where: str = "specification") -> AnySpecification:
    """Read a specification of any motion; `where` names it in messages. Raises SettingError with the key."""
    _refuse_unlikely(mapping, where)
    vehicle, table = mapping.get("vehicle"), {**mapping, "source": where}
    motion = vehicle.get("motion", YAW.name) if isinstance(vehicle, Mapping) else YAW.name
    if motion == PLANAR.name:
        return Codec(where, YAW).read(PlanarSpecification, table)
    if not isinstance(motion, str) or (dof := DOFS.get(motion)) is None:
        raise SettingError(f"{where}: vehicle.motion: found {told(motion)}, expected {' or '.join(DOFS)}")
    log, turns = dof.units.log, dof.wraps  # headings wrap and begin anywhere, and who sinks or rises is held
    defaults: dict[str, dict[str, object]] = {
        "logger": {"wrap": "0..360" if turns else "none", f"glitch_{log}": 90.0 if turns else 1.0},
        "scatter": {f"start_{dof.position}_{log}": "random" if turns else 0.0},
        "campaign": {"held": dof.has_constant},
        "vehicle": {} if turns else {dof.symbols.difference: 0.0, dof.symbols.constant: 0.0},
    }
    for name, default in defaults.items():
        part = mapping.get(name, {})
        table[name] = {**default, **part} if isinstance(part, Mapping) else part
    specification: Specification = _KindsCodec(where, dof).read(Specification, table)
    return specification


def _refuse_unlikely(mapping: Mapping[str, object], where: str) -> None:
    """Refuse another schema, and numbers that no campaign has. Raises SettingError with the key's path."""
    if mapping.get("schema") != SCHEMA:
        schema = told(mapping.get("schema"))
        raise SettingError(f'{where}: schema: found {schema}, expected the line schema = "{SCHEMA}"')
    for value, place in everything(mapping):
        if isinstance(value, int | float) and value and place != ("seed",) and not SMALLEST <= abs(value) <= LARGEST:
            sizes = f"{SMALLEST:g} to {LARGEST:g}"
            raise SettingError(f"{where}: {in_words(place)}found {told(value)}, expected 0 or a size of {sizes}")
