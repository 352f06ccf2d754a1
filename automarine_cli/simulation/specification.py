"""What a simulated campaign is made from: frozen settings, to and from TOML (schema automarine/simulation/1), the kinds
of runs, and the streams of random numbers that are drawn for them.

Keys that a motion calls its own way are templates, filled from its record. An unknown key, a value that makes no sense
and an effect that is not in the library are refused with the key's path. A vehicle in the plane has its parameters
under the names that planar_model.json has: "surge.m_u", "sway.Y_vv"."""

import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field
from string import ascii_lowercase
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args, get_type_hints

import numpy as np
from scipy import optimize
from scipy.special import ndtri

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, PLANAR, YAW, Dof, Motion, alone
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.model import CONSTANT, RESTORING, Model, Term, response
from automarine_cli.models.store import PLANAR_MODEL, models_of
from automarine_cli.pipeline.records import FILLER, Codec, Record, everything, key_of, keyed
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate, step_for
from automarine_cli.text import Place, format_value, in_words


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


MIN_DEVIATE = 2.0**-54  # keeps a uniform deviate off zero


def uniform(count: int, seed: int, *words: str) -> Floats:
    """Uniform deviates in [0, 1), shape (count,), of the stream with that key."""
    return _stream(seed, words).random(count)


def normal(count: int, seed: int, *words: str) -> Floats:
    """Standard normal deviates, shape (count,), of the stream with that key."""
    return np.asarray(ndtri(_stream(seed, words).random(count) + MIN_DEVIATE))


def _stream(seed: int, words: tuple[str, ...]) -> np.random.Generator:
    key = hashlib.sha256("\0".join(words).encode()).digest()
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int.from_bytes(key, "big")])))


Format: TypeAlias = Literal["csv", "csv.gz", "parquet"]
Commands: TypeAlias = tuple[tuple[float, ...], ...]
"""Rows of a moment or force for each degree of freedom, and how many seconds it is held."""
MAX_VALUES = 100_000
KIND_LABELS = {"step": "{f}", "coast-down": "coast"}  # what labels begin with where it is not the kind


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
        if (self.to - self.from_) / self.step > MAX_VALUES:
            raise SettingError(f"step is {self.step:g}; that makes more than {MAX_VALUES} values; give a larger step")

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
    """Runs of one kind, where their logs go and what is wrong with them on purpose. Files are `folder/LABEL.format`
    with a letter for the repeat (or `suffix`); with `together` all runs of the group go into the one file of that name,
    distinguished by a column `run`. `wait_after_s` takes the place of the campaign's wait after each of these runs,
    `surge_m_s` is the speed ahead of what a rudder steers, which is logged."""

    kind: Literal["step", "coast-down", "reversal", "sequence", "ramp", "rest", "planar", "zigzag"]
    name: str | None = None
    folder: str = "runs"
    format: Format = "csv"
    together: str | None = None
    repeats: CountAboveZero = 1
    suffix: str | None = None
    fault: Literal["never-moves"] | None = None
    wait_after_s: ZeroOrMore | None = None
    surge_m_s: AboveZero | None = None
    dof: Dof = field(repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        safe_path(self, "name", "folder", "together", "suffix")
        if self.suffix is not None and self.repeats > 1:
            raise SettingError("suffix names a single run; expected repeats = 1 with it")

    def runs(self, model: Any, seed: int) -> Iterator[tuple[str, str, Commands]]:
        """Yield the name of each run, the key of its random streams, and what is commanded."""
        for label, commands in self.cases(model):
            for repeat in range(self.repeats):
                letter = ascii_lowercase[repeat] if self.repeats <= len(ascii_lowercase) else str(repeat + 1)
                name = f"{label}_{self.suffix or (letter if self.repeats > 1 else '')}".rstrip("_")
                key = f"{self.folder}/{name if self.kind == 'planar' else f'{label}#{self.suffix or repeat}'}"
                yield name, key, commands

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        """Yield label and commands of each run, repeats left out."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        return self.name or self.dof.fill(KIND_LABELS.get(self.kind, self.kind))


@dataclass(frozen=True, kw_only=True)
class StepRuns(RunGroup):
    """Each of the `levels` (in a file of yaw `moments`, of a translation `forces`) is held until the base vehicle has
    gone its `way` [unit of logs] (`turn_deg`, `travel_m`), or for `duration_s`. Then a coast-down lets go for
    `coast_s`, and a reversal has the opposite for `back_s`, by default for twice as long."""

    levels: Levels = field(metadata=keyed("{forces}"))
    way: AboveZero | None = field(default=None, metadata=keyed("{way_key}_{log_unit}"))
    duration_s: AboveZero | None = None
    coast_s: AboveZero | None = None
    back_s: AboveZero | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.way is not None and self.dof.restoring:
            raise SettingError(f"{key_of(self, 'way')}: a step of {self.dof.name} ends at an angle; give duration_s")
        if (self.way is None) == (self.duration_s is None):
            raise SettingError(f"expected one of {key_of(self, 'way')} and duration_s")
        if (self.coast_s is None) == (self.kind == "coast-down") or (self.back_s and self.kind != "reversal"):
            raise SettingError(
                f"the kind is {self.kind}; give coast_s to a coast-down alone, and back_s to a reversal alone"
            )
        if 0.0 in levels_of(self.levels):
            name = key_of(self, "levels")
            raise SettingError(f'{name} has a zero; expected other values (a run of kind "rest" has none)')

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        for level in levels_of(self.levels):
            hold = self.duration_s or time_to_turn(self.dof.inner(self.way or 0.0), level, model)
            commands = [(level, hold)]
            if self.coast_s:
                commands.append((0.0, self.coast_s))
            if self.kind == "reversal":
                commands.append((-level, self.back_s or 2.0 * hold))
            yield f"{self.label}_{moment_text(level)}", tuple(commands)


@dataclass(frozen=True, kw_only=True)
class RampRuns(RunGroup):
    """One ramp `from_` one level `to` another in so many `steps`."""

    to: float
    duration_s: AboveZero
    from_: float = 0.0
    steps: CountAboveZero = 20

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        stairs = np.linspace(self.from_, self.to, self.steps + 1)[1:].round(6).tolist()
        yield f"{self.label}_{moment_text(self.to)}", tuple((level, self.duration_s / self.steps) for level in stairs)


@dataclass(frozen=True, kw_only=True)
class RestRuns(RunGroup):
    duration_s: AboveZero

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        yield self.label, ((0.0, self.duration_s),)


@dataclass(frozen=True, kw_only=True)
class SequenceRuns(RunGroup):
    """Any `commands`: levels (of a rudder degrees) and how many seconds they are held; in the plane [X N, Y N, N N m,
    seconds]."""

    commands: Commands

    def __post_init__(self) -> None:
        super().__post_init__()
        forces = ["X", "Y", "N"] if self.kind == PLANAR.name else [self.dof.words.force]
        if not all(len(row) == len(forces) + 1 and row[-1] > 0 for row in self.commands or [()]):
            expected = f"expected at least one [{', '.join(forces)}, seconds], each longer than 0 s"
            raise SettingError(f"commands: {expected}")

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        yield self.label, self.commands


@dataclass(frozen=True, kw_only=True)
class ZigzagRuns(RunGroup):
    """A zigzag for each of `angles_deg`: the rudder goes over by so much, and to the other side each time the heading
    is as far off, so many `swings`; as the true vehicle turns without scatter."""

    angles_deg: tuple[float, ...]
    swings: CountAboveZero = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if not levels_of(self.angles_deg) or not all(0.0 < abs(angle) <= 90.0 for angle in self.angles_deg):
            raise SettingError("angles_deg: expected rudder angles of up to 90 degrees to either side, none of them 0")

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        ahead = {"surge": self.surge_m_s or 0.0}
        cases = [(math.radians(a), math.radians(abs(a)), self.swings, ahead) for a in self.angles_deg]
        for angle, commands in zip(self.angles_deg, zigzags(model, ZIGZAG_RATE_HZ, cases)):
            if not commands:
                raise SettingError(
                    f"angles_deg: with {angle:g} no zigzag ends within {MAX_DRIVEN_S:g} s; give larger angles"
                )
            yield f"{self.label}_{angle:+g}", tuple((math.degrees(rudder), hold) for rudder, hold in commands)


@dataclass(frozen=True, kw_only=True)
class DrawnRuns(RunGroup):
    """Commands in the plane, drawn anew for each run between minus and plus the `largest` of each, held for `hold_s`
    [least, most]."""

    largest: tuple[float, float, float]
    hold_s: tuple[float, float] = (2.0, 5.0)
    duration_s: AboveZero = 40.0

    def __post_init__(self) -> None:
        super().__post_init__()
        least, most = self.hold_s
        if not (0 < least <= min(most, self.duration_s) and self.duration_s <= MAX_VALUES * least):
            expected = f"expected [least, most], both above 0, for 1 to {MAX_VALUES} commands in duration_s"
            raise SettingError(f"hold_s: {expected}")

    def cases(self, model: Model) -> Iterator[tuple[str, Commands]]:
        yield self.label, ()

    def runs(self, model: Any, seed: int) -> Iterator[tuple[str, str, Commands]]:
        for name, key, _ in super().runs(model, seed):
            yield name, key, self._drawn(seed, key)

    def _drawn(self, seed: int, key: str) -> Commands:
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
        return tuple((*row, hold) for row, hold in zip(commands.tolist(), holds))


def moment_text(moment: float) -> str:
    text = f"{moment:+.10g}"
    return text if set(text) & {".", "e"} else f"{text}.0"


def time_to_turn(angle: float, moment: float, model: Model) -> float:
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


ZIGZAG_RATE_HZ = 20.0  # at which a helmsman looks at the heading
MAX_DRIVEN_S = 120.0  # no run is driven for longer: who would wait for it can repeat it


def zigzags(
    model: Model, rate_hz: float, cases: Sequence[tuple[float, float, int, Mapping[str, float]]]
) -> list[tuple[tuple[float, float], ...]]:
    """Return the angle of the rudder [rad] and the seconds of each swing, for each case: the first angle, how far the
    heading goes that way before the rudder goes to the other side [rad], how many swings, and signals that stay as they
    are; none for a case that takes MAX_DRIVEN_S."""
    clock = np.arange(round(MAX_DRIVEN_S * rate_hz) + 1) / rate_hz
    rudders, begins = np.array([np.full(len(clock), first) for first, *_ in cases]), [0] * len(cases)
    swings: list[list[tuple[float, float]]] = [[] for _ in cases]
    step = min(0.1, step_for(model, float(np.abs(rudders).max())))
    for number in range(max(count for _, _, count, _ in cases)):
        held = [{name: np.full(len(clock), value) for name, value in signals.items()} for *_, signals in cases]
        runs = [Run("", "", clock, 0.0 * clock, r, STEERED, {**s, "rudder": r}, dof=YAW) for r, s in zip(rudders, held)]
        for i, heading in enumerate(simulate(model, make_batch(runs, step, model.signals)).position[0]):
            _, until, count, _ = cases[i]
            way, begin = float(rudders[i, begins[i]]), begins[i]
            over = np.flatnonzero(np.sign(way) * heading[begin + 1 :] >= until)
            if number < count and len(swings[i]) == number and len(over):
                begins[i] = begin + 1 + int(over[0])
                swings[i].append((way, (begins[i] - begin) / rate_hz))
                rudders[i, begins[i] :] = -way
    return [tuple(of_case) if len(of_case) == case[2] else () for of_case, case in zip(swings, cases)]


SIMULATION_SCHEMA = "automarine/simulation/1"
MIN_SPECIFIED, MAX_SPECIFIED = 1e-12, 1e12  # of any number: beyond it no vehicle is, and arithmetic overflows


@dataclass(frozen=True)
class Vehicle(Settings):
    """The vehicle: inertia [force s², of a translation per metre], `quadratic` [force s²] and `linear` drag [force s].
    In a file they have the names of the motion: `I_r`, `k_rr` and `k_r`, or `m_u`, `X_uu` and `X_u`; the unit of force
    is `moment_unit` or `force_unit`, "rad" where the angle of a rudder is the command. Who moves along an axis says
    which by `motion`; `difference` is half the quadratic drag one way less that the other way, the positive way first;
    `constant_force` [force] is weight less buoyancy where that acts, positive down, or what makes a list; `restoring`
    [moment] is m g GM of what swings."""

    inertia: AboveZero = field(metadata=keyed("{inertia_symbol}"))
    quadratic: ZeroOrMore = field(default=0.0, metadata=keyed("{quadratic}"))
    linear: ZeroOrMore = field(default=0.0, metadata=keyed("{linear}"))
    force_unit: str = field(default="nu", metadata=keyed("{force}_unit"))
    motion: str | None = None
    difference: float | None = field(default=None, metadata=keyed("{difference}"))
    constant_force: float | None = field(default=None, metadata=keyed("{constant}"))
    restoring: AboveZero | None = field(default=None, metadata=keyed("{restoring}"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = (*self.dof.units.forces[:2], *([STEERED] if self.dof is YAW else []))
        if self.force_unit not in allowed:
            units = ", ".join(map(repr, allowed))
            raise SettingError(
                f"{key_of(self, 'force_unit')}: expected one of {units}, found {format_value(self.force_unit)}"
            )
        if self.linear + self.quadratic == 0:
            keys = f"{key_of(self, 'quadratic')} and {key_of(self, 'linear')}"
            raise SettingError(f"{keys} are both 0; expected a drag, or the vehicle never gets steady")
        if abs(self.difference or 0.0) >= max(self.quadratic, 1e-300):
            names = f"{key_of(self, 'difference')} is not below {key_of(self, 'quadratic')}"
            raise SettingError(f"{names}; expected a drag that brakes both ways")
        if (self.restoring is not None) is not self.dof.restoring:
            those = " and ".join(dof.name for dof in DOFS.values() if dof.restoring)
            expected = f"expected the moment m g GM of {self.dof.name}" if self.dof.restoring else "leave it out"
            raise SettingError(f"{key_of(self, 'restoring')} is of {those}; {expected}")
        if self.constant_force and not self.dof.biased:
            those, key = " and ".join(dof.name for dof in DOFS.values() if dof.has_constant), "constant_force"
            raise SettingError(f'{key_of(self, key)} is of {those}; elsewhere expected the effect "bias-moment"')

    @property
    def model(self) -> Model:
        values = {
            "quadratic-drag": self.quadratic, "linear-drag": self.linear, CONSTANT: self.constant_force,
            "drag-asymmetry": self.difference, RESTORING: self.restoring,
        }  # fmt: skip
        terms = tuple(Term(name, (value,), base=True) for name, value in values.items() if value)
        return Model(alone(self.dof), (self.inertia,), terms, self.force_unit)


@dataclass(frozen=True)
class Logger(Settings):
    """What the logger does to the truth; positions in the unit of the logs, which ends their keys (`noise_deg`).
    `rate_hz` samples a second; `noise` white noise of the position and `wrap` of it; `rate_noise` adds a column with
    the velocity, as a gyro reads it, and that noise; `rate_bias` is the standard deviation of what it reads at
    standstill, drawn for each run."""

    rate_hz: AboveZero = 10.0
    noise: ZeroOrMore = field(default=0.0, metadata=keyed("noise_{log_unit}"))
    wrap: Literal["0..360", "-180..180", "none"] = "none"
    rate_noise: ZeroOrMore | None = field(default=None, metadata=keyed("{speed}_noise_{log_unit}_s"))
    rate_bias: ZeroOrMore | None = field(default=None, metadata=keyed("{speed}_bias_{log_unit}_s"))
    dof: Dof = field(kw_only=True, repr=False, metadata=FILLER)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_noise is None and self.rate_bias is not None:
            bias, expected = key_of(self, "rate_bias"), f"expected {key_of(self, 'rate_noise')} with it (0 for none)"
            raise SettingError(f"{bias} is of the {self.dof.words.speed}s logged; {expected}")

    @property
    def period(self) -> float:
        return 1.0 / self.rate_hz


@dataclass(frozen=True)
class Scatter(Settings):
    """What differs from run to run, drawn anew for each. `gain` is the standard deviation of the logarithm of the
    moment or force delivered over the one commanded; `force` that of a constant moment or force added in each run,
    redrawn until it is at most `force_most` of the run's smallest command (who sees his vehicle go the wrong way makes
    the run again); `zero` [unit of logs] that of the sensor's zero; `start` one position, a list that the runs take in
    turn, or "random". In a file of yaw they are `moment`, `moment_most`, `heading_zero_deg` and `start_heading_deg`."""

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
    """How the campaign is run: one clock over all runs, which follow each other after `wait_between_s`. Each run has
    `rest_before_s` and `rest_after_s` without a command in its log. `held`: someone holds the vehicle still until the
    first change of its command."""

    order: Literal["listed", "random"] = "listed"
    rest_before_s: ZeroOrMore = 3.0
    rest_after_s: ZeroOrMore = 0.0
    wait_between_s: ZeroOrMore = 60.0
    held: bool = False


@dataclass(frozen=True)
class Bollard(Settings):
    """A bollard test: `thrusters_per_test` equal thrusters pull together, thrust a_f n² and -a_b n² each [N]. `levels`
    of the control signal, each measured `repeats` times with noise of `noise_N`, in random order."""

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


@dataclass(frozen=True, kw_only=True)
class PlanarVehicle:
    parameters: Mapping[str, float]
    motion: Literal["planar"] = "planar"


@dataclass(frozen=True, kw_only=True)
class Sensor(Settings):
    """One column: white `noise`, `bias` (standard deviation, drawn for each run) in its unit, and `every_s`, the time
    between its readings, which the logger repeats; None: a reading in every row."""

    noise: ZeroOrMore = 0.0
    bias: ZeroOrMore = 0.0
    every_s: AboveZero | None = None


Sensed: TypeAlias = tuple[Sensor, tuple[str, ...], tuple[str, ...]]
"""The sensor of a column, and the words that name the random streams of its noise and its bias."""


@dataclass(frozen=True, kw_only=True)
class Disturbance(Settings):
    """Standard deviations of the forces [N] and the moment [N m] that nobody logs, and their time constant [s]."""

    surge_N: ZeroOrMore = 0.0
    sway_N: ZeroOrMore = 0.0
    yaw_Nm: ZeroOrMore = 0.0
    time_s: AboveZero = 5.0


OF_A_RUDDER = ("zigzag", "sequence", "rest")  # kinds of runs


@dataclass(frozen=True, kw_only=True)
class Specification(Settings):
    """A campaign of one degree of freedom, with hidden `effects`; or in the plane, with `hidden` parameters and forces
    that nobody logs, and `sensors` by column."""

    schema: str = SIMULATION_SCHEMA
    vehicle: Vehicle | PlanarVehicle
    hidden: Mapping[str, float] = field(default_factory=dict)
    disturbance: Disturbance | None = None
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    logger: Logger
    scatter: Scatter
    campaign: Schedule = Schedule()
    seed: Annotated[int, Limit()] = 0
    effects: tuple[EffectSetting, ...] = ()
    runs: tuple[RunGroup, ...] = ()
    bollard: Bollard | None = None
    source: str = "specification"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.runs and self.bollard is None:
            raise SettingError("nothing to simulate; expected [[runs]] or [bollard]")
        turns = self.motion.turns
        of_others = ("effects",) if turns else ("hidden", "disturbance", "sensors")
        if foreign := [key for key in of_others if getattr(self, key)]:
            raise SettingError(f"{foreign[0]}: runs of {self.motion.name} have none; leave it out")
        if alien := next((group.kind for group in self.runs if (group.kind == "planar") is not turns), None):
            raise SettingError(f"runs: kind {alien!r} is of another motion than {self.motion.name}")
        if other := next((group.kind for group in self.runs if self.steered and group.kind not in OF_A_RUDDER), None):
            raise SettingError(f"runs: kind {other!r} has no rudder; expected {' or '.join(OF_A_RUDDER)}")
        if not self.steered and any(group.kind == "zigzag" or group.surge_m_s for group in self.runs):
            raise SettingError(f'runs: a zigzag and surge_m_s are of a rudder; expected moment_unit = "{STEERED}"')
        logged = {"rudder"} if self.steered else set()
        logged |= {"surge"} if self.runs and all(group.surge_m_s for group in self.runs) else set()
        for i, name in enumerate(setting.name for setting in self.effects):
            if lacking := [column for column in library.get(name).columns if column not in logged]:
                hint = "give surge_m_s to all runs" if self.steered and lacking == ["surge"] else "leave it out"
                needs = f"needs the column {lacking[0]!r}, which simulated runs lack; {hint}"
                raise SettingError(f"effects[{i}]: effect {name!r} {needs}")
        if twice := sorted(set(getattr(self.vehicle, "parameters", ())) & set(self.hidden)):
            raise SettingError(f"hidden: {twice[0]!r} is a parameter of the vehicle too; give it once")
        if unknown := next((name for name in self.sensors if name not in self.columns), None):
            raise SettingError(f"sensors: found {format_value(unknown)}, expected some of {', '.join(self.columns)}")
        if turns and "heading_deg" not in self.sensors:
            raise SettingError("sensors: heading_deg is missing; give it, as every log of motion in the plane has it")
        if turns and (self.logger.noise or self.logger.rate_noise is not None or self.scatter.zero):
            raise SettingError("logger: in the plane noise and bias are of the columns; give them in [sensors]")
        self.model()  # refused where it is none

    @property
    def motion(self) -> Motion:
        return self.vehicle.model.motion if isinstance(self.vehicle, Vehicle) else PLANAR

    @property
    def steered(self) -> bool:
        return self.force_unit == STEERED

    @property
    def columns(self) -> dict[str, Dof]:
        """The columns that sensors may give: positions, then velocities, with the degree of freedom of each."""
        dofs, quantities = self.motion.dofs, self.motion.positions
        places = [d.column(d.position, d.units.log) if q == d.position else f"{q}_m" for d, q in zip(dofs, quantities)]
        rates = [dof.column(dof.velocity, f"{dof.units.log}/s") for dof in dofs]
        return dict(zip([*places, *rates], [*dofs, *dofs]))

    @property
    def force_unit(self) -> str:
        """Unit of the one moment or force; none in the plane, which is in newtons."""
        return self.vehicle.force_unit if isinstance(self.vehicle, Vehicle) else ""

    @property
    def sensed(self) -> dict[str, Sensed]:
        if self.sensors:
            return {name: (sensor, (name,), (name, "bias")) for name, sensor in self.sensors.items()}
        (position, rate), logger = self.columns, self.logger
        zero = Sensor(noise=logger.noise, bias=self.scatter.zero)
        sensors: dict[str, Sensed] = {position: (zero, ("noise",), ("heading zero",))}
        if logger.rate_noise is not None:
            gyro = Sensor(noise=logger.rate_noise, bias=logger.rate_bias or 0.0)
            sensors[rate] = (gyro, ("rate noise",), ("rate bias",))
        return sensors

    def model(self) -> Model:
        """Return the true model, with what is hidden. Raises SettingError."""
        if isinstance(self.vehicle, Vehicle):
            model = self.vehicle.model
            for setting in self.effects:
                model = model.with_effect(setting.name, setting.ordered)
            return model
        parameters = {**self.vehicle.parameters, **self.hidden}
        try:
            model = models_of({"schema": PLANAR_MODEL.schema, "parameters": parameters}, "vehicle").model
        except ModelError as problem:
            raise SettingError(str(problem)) from None
        for term in model.terms:
            if not term.is_cross and (term.effect.needs or term.effect.varies(term.values)):
                raise SettingError(
                    f"{PLANAR.dofs[term.dof].name}.{term.name} cannot be simulated in the plane: it needs a column, or "
                    "a coefficient of its own in each run; leave it out"
                )
        return model


class _Codec(Codec):
    """Reads a vehicle by its motion, and an effect as its name and its parameters."""

    def value(self, hint: Any, value: Any, place: Place = ()) -> Any:
        if hint == Vehicle | PlanarVehicle:
            hint = PlanarVehicle if isinstance(value, Mapping) and value.get("motion") == PLANAR.name else Vehicle
        if hint is RunGroup and isinstance(value, Mapping):
            kind = self.value(get_type_hints(RunGroup)["kind"], value.get("kind"), (*place, "kind"))
            kinds = {"ramp": RampRuns, "rest": RestRuns, "sequence": SequenceRuns, "zigzag": ZigzagRuns}
            kinds[PLANAR.name] = DrawnRuns if "largest" in value else SequenceRuns
            hint = kinds.get(kind, StepRuns)
        if hint is EffectSetting:
            if not isinstance(value, Mapping) or "name" not in value:
                expected = f"a table with name = one of {', '.join(library.names())}"
                raise self.refusal(place, f"found {format_value(value)}, expected {expected}")
            value = {"name": value["name"], "values": {key: entry for key, entry in value.items() if key != "name"}}
        return super().value(hint, value, place)


def specification_from(mapping: Mapping[str, object], where: str = "specification") -> Specification:
    """Read a specification of any motion; `where` names it in messages. Raises SettingError with the key, also for
    another schema and for numbers that no campaign has."""
    if mapping.get("schema") != SIMULATION_SCHEMA:
        schema = format_value(mapping.get("schema"))
        raise SettingError(f'{where}: schema: found {schema}, expected the line schema = "{SIMULATION_SCHEMA}"')
    for value, place in everything(mapping):
        if place == ("seed",) or not isinstance(value, int | float) or not value:
            continue
        if not MIN_SPECIFIED <= abs(value) <= MAX_SPECIFIED:
            sizes = f"{MIN_SPECIFIED:g} to {MAX_SPECIFIED:g}"
            raise SettingError(
                f"{where}: {in_words(place)}found {format_value(value)}, expected 0 or a size of {sizes}"
            )
    vehicle = mapping.get("vehicle")
    motion = vehicle.get("motion", YAW.name) if isinstance(vehicle, Mapping) else YAW.name
    planar = motion == PLANAR.name
    if not isinstance(motion, str) or (dof := YAW if planar else DOFS.get(motion)) is None:
        names = " or ".join((*DOFS, PLANAR.name))
        raise SettingError(f"{where}: vehicle.motion: found {format_value(motion)}, expected {names}")
    log, turns = dof.units.log, dof.wraps  # headings wrap and begin anywhere, and who sinks or rises is held
    table: dict[str, Any] = {**mapping, "source": where}
    defaults: dict[str, dict[str, object]] = {
        "logger": {"wrap": "0..360" if turns else "none"},
        "scatter": {f"start_{dof.position}_{log}": "random" if turns and not planar else 0.0},
        "campaign": {"held": dof.has_constant},
        "vehicle": {} if turns else {dof.symbols.difference: 0.0, dof.symbols.constant: 0.0},
    }
    if planar:  # rests and waits stand beside the rate
        defaults["logger"]["rate_hz"] = 5.0
        logger, rests = table.get("logger", {}), {"rest_before_s": 2.0, "rest_after_s": 2.0, "wait_between_s": 60.0}
        if isinstance(logger, Mapping):
            table["logger"] = {key: value for key, value in logger.items() if key not in rests}
            defaults["campaign"] = {key: logger.get(key, value) for key, value in rests.items()}
        if isinstance(runs := table.get("runs"), list | tuple):
            table["runs"] = [{"kind": PLANAR.name, **run} if isinstance(run, Mapping) else run for run in runs]
    for name, default in defaults.items():
        part = table.get(name, {})
        table[name] = {**default, **part} if isinstance(part, Mapping) else part
    specification: Specification = _Codec(where, dof).read(Specification, table)
    return specification
