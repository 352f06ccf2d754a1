"""What a simulated campaign of motion in the plane is made from: frozen settings, to and from TOML.

[vehicle]     motion = "planar", and parameters under the names that planar_model.json has: "surge.m_u", "sway.Y_vv"
[hidden]      more of them, which a model may not know of: "yaw.N_v", "current.north", "yaw.dead-band.width"
[disturbance] forces that nobody logs: Ornstein-Uhlenbeck processes, one for each degree of freedom
[sensors]     a table for each column that is logged: its noise, its bias, and how often it reads
[[runs]]      commands as [X, Y, N, seconds], or drawn at random
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from automarine_cli import effects
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import planar_from_json
from automarine_cli.pipeline.records import from_mapping, told
from automarine_cli.results.kinds import PLANAR_MODEL
from automarine_cli.simulation.checks import at_least_zero, positive, safe_path
from automarine_cli.simulation.run_groups import Format
from automarine_cli.simulation.specification import refuse_unlikely

SENSORS = ("heading_deg", "yaw_rate_deg_s", "surge_m_s", "sway_m_s", "north_m", "east_m")
MOST_RUNS, MOST_SAMPLES = 10_000, 20_000_000


@dataclass(frozen=True, kw_only=True)
class PlanarVehicle:
    """The vehicle: parameters by qualified name."""

    motion: Literal["planar"] = "planar"
    parameters: Mapping[str, float]


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
        """In the order of the motion."""
        return self.surge_N, self.sway_N, self.yaw_Nm


@dataclass(frozen=True, kw_only=True)
class PlanarLogger:
    """How often a row is written, and how long the vehicle rests before the first command and after the last."""

    rate_hz: float = 5.0
    rest_before_s: float = 2.0
    rest_after_s: float = 2.0
    wait_between_s: float = 60.0

    def __post_init__(self) -> None:
        positive(self, "rate_hz")
        at_least_zero(self, "rest_before_s", "rest_after_s", "wait_between_s")


@dataclass(frozen=True, kw_only=True)
class PlanarScatter:
    """`gain`: standard deviation of the logarithm of what is delivered over what is commanded, drawn for each run;
    `start_heading_deg` where runs begin, "random" for anywhere."""

    gain: float = 0.0
    start_heading_deg: float | Literal["random"] = 0.0

    def __post_init__(self) -> None:
        at_least_zero(self, "gain")


@dataclass(frozen=True, kw_only=True)
class PlanarRuns:
    """Runs of one kind: `commands` one after the other as [X N, Y N, N N m, seconds]; or drawn anew for each of the
    `repeats`, between minus and plus the `largest` of each, held for `hold_s` [least, most], over `duration_s`."""

    name: str
    folder: str = "runs"
    format: Format = "csv"
    repeats: int = 1
    commands: tuple[tuple[float, float, float, float], ...] = ()
    largest: tuple[float, float, float] | None = None
    hold_s: tuple[float, float] = (2.0, 5.0)
    duration_s: float = 40.0

    def __post_init__(self) -> None:
        safe_path(self, "name", "folder")
        positive(self, "repeats", "duration_s")
        if bool(self.commands) == (self.largest is not None):
            raise SettingError("expected one of commands = [[X, Y, N, seconds], ...] and largest = [X, Y, N]")
        if any(seconds <= 0 for *_, seconds in self.commands):
            raise SettingError("commands: expected each longer than 0 s")
        if not 0 < self.hold_s[0] <= self.hold_s[1]:
            raise SettingError("hold_s: expected [least, most], both above 0")

    @property
    def length(self) -> float:
        """Time [s] for which anything is commanded."""
        return sum(seconds for *_, seconds in self.commands) if self.commands else self.duration_s

    @property
    def shortest(self) -> float:
        """The shortest time [s] for which a command is held."""
        return min((seconds for *_, seconds in self.commands), default=min(self.hold_s[0], self.duration_s))


@dataclass(frozen=True, kw_only=True)
class PlanarSpecification:
    """A whole campaign; `source` is the name of the file that it was read from, for the logs' first line."""

    schema: str
    vehicle: PlanarVehicle
    hidden: Mapping[str, float] = field(default_factory=dict)
    disturbance: Disturbance = Disturbance()
    sensors: Mapping[str, Sensor]
    logger: PlanarLogger = PlanarLogger()
    scatter: PlanarScatter = PlanarScatter()
    runs: tuple[PlanarRuns, ...]
    seed: int = 0
    source: str = "specification"

    def __post_init__(self) -> None:
        at_least_zero(self, "seed")
        unknown = [name for name in self.sensors if name not in SENSORS]
        if unknown or not self.sensors:
            found = told(unknown[0]) if unknown else "none"
            raise SettingError(f"sensors: found {found}, expected some of {', '.join(SENSORS)}")
        if "heading_deg" not in self.sensors:
            raise SettingError("sensors: heading_deg is missing; give it, as every log of motion in the plane has it")
        twice = sorted(set(self.vehicle.parameters) & set(self.hidden))
        if twice:
            raise SettingError(f"hidden: {twice[0]!r} is a parameter of the vehicle too; give it once")
        places = [f"{one.folder}/{one.name}" for one in self.runs]
        if not places or len(set(places)) < len(places):
            raise SettingError("runs: expected at least one [[runs]], each with a name of its own")
        if sum(one.repeats for one in self.runs) > MOST_RUNS:
            raise SettingError(f"runs: more than {MOST_RUNS} would be made; ask for fewer")
        samples = self.logger.rate_hz * sum(one.repeats * one.length for one in self.runs)
        if samples > MOST_SAMPLES:
            raise SettingError(
                f"runs: {samples:.3g} samples would be made; expected at most {MOST_SAMPLES:.0g}. Ask for fewer or "
                "shorter runs, or a lower rate_hz"
            )
        shortest = min(one.shortest for one in self.runs)
        if shortest * self.logger.rate_hz < 2.0:
            raise SettingError(
                f"runs: a command is held for {shortest:g} s; expected at least two samples, "
                f"{2.0 / self.logger.rate_hz:g} s"
            )
        self.model()  # refused where it is none

    def model(self, hidden: bool = True) -> PlanarModel:
        """The true model, or what a model knows of it without what is `hidden`. Raises SettingError."""
        parameters = {**self.vehicle.parameters, **(self.hidden if hidden else {})}
        try:
            model = planar_from_json({"schema": PLANAR_MODEL.schema, "parameters": parameters}, "vehicle").model
        except ModelError as problem:
            raise SettingError(str(problem)) from None
        for dof, terms in zip(PLANAR.dofs, (model.surge, model.sway, model.yaw)):
            for term in terms:
                effect = effects.get(term.name)
                if effect.needs or effect.varies(term.values):
                    raise SettingError(
                        f"{dof.name}.{term.name} cannot be simulated in the plane: it needs a column, or a coefficient "
                        "of its own in each run; leave it out"
                    )
        return model


def is_planar(mapping: Mapping[str, object]) -> bool:
    """Whether plain data are a specification of motion in the plane."""
    vehicle = mapping.get("vehicle")
    return isinstance(vehicle, Mapping) and vehicle.get("motion") == PLANAR.name


def planar_specification_from(mapping: Mapping[str, object], where: str) -> PlanarSpecification:
    """The specification held by plain data; `where` names it in messages. Raises SettingError with the key's path."""
    refuse_unlikely(mapping, where)
    return from_mapping(PlanarSpecification, {**mapping, "source": where}, where)
