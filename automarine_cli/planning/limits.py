"""What a day at the pool allows: frozen settings, from TOML (schema automarine/plan-limits/1), and a file to begin
with.

An unknown key and a value that makes no sense are refused with the key's path.
"""

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Literal

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import from_mapping, read_mapping
from automarine_cli.simulation.checks import at_least_zero, between, positive

SCHEMA = "automarine/plan-limits/1"
KINDS = ("step", "coast-down", "reversal", "slow-ramp", "long-turn", "rest", "other-voltage")
LEAST_TURN = 30.0
MOST_LEVELS, MOST_RUNS = 20, 500


@dataclass(frozen=True)
class Pool:
    minutes: float = 60.0
    runs: int = 24
    motion_s: float | None = None
    wait_s: float = 60.0
    wait_after_long_turn_s: float = 180.0
    turn_deg: float = 180.0
    start_headings_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0)

    def __post_init__(self) -> None:
        positive(self, "minutes", "motion_s")
        between(self, 2, MOST_RUNS, "runs")
        at_least_zero(self, "wait_s", "wait_after_long_turn_s")
        between(self, LEAST_TURN, 3600.0, "turn_deg")
        if not self.start_headings_deg:
            raise SettingError("start_headings_deg is an empty list; expected at least one heading")


@dataclass(frozen=True)
class Moments:
    largest: float | None = None
    levels: int = 6

    def __post_init__(self) -> None:
        positive(self, "largest")
        between(self, 2, MOST_LEVELS, "levels")


@dataclass(frozen=True)
class Runs:
    kinds: tuple[str, ...] = KINDS
    rest_before_s: float = 3.0
    most_alike: int = 4
    of_one_size_percent: float = 50.0
    repeat_first_last: bool = True
    voltages_V: tuple[float, ...] = ()
    fit: Literal["whole-runs", "half-turns"] = "whole-runs"

    def __post_init__(self) -> None:
        between(self, 1.0, 60.0, "rest_before_s")
        between(self, 2, MOST_RUNS, "most_alike")
        between(self, 1.0, 100.0, "of_one_size_percent")
        for kind in self.kinds:
            if kind not in KINDS:
                raise SettingError(f"kinds names {kind!r}; expected some of {', '.join(KINDS)}")
        if "step" not in self.kinds:
            raise SettingError(f"kinds is {list(self.kinds)}; expected 'step' among them, every campaign needs steps")
        for volts in self.voltages_V:
            if volts <= 0:
                raise SettingError(f"voltages_V holds {volts:g}; expected voltages above 0")


@dataclass(frozen=True)
class Logger:
    rate_hz: float = 10.0
    noise_deg: float | None = None
    rate_noise_deg_s: float | None = None
    gain_scatter: float | None = None

    def __post_init__(self) -> None:
        between(self, 0.5, 1000.0, "rate_hz")
        positive(self, "noise_deg", "rate_noise_deg_s")
        at_least_zero(self, "gain_scatter")


@dataclass(frozen=True)
class Battery:
    volts: float = 24.0
    charge_Ah: float = 2.9
    idle_A: float = 0.3
    full_A: float = 6.0
    reserve_percent: float = 20.0

    def __post_init__(self) -> None:
        positive(self, "volts", "charge_Ah")
        at_least_zero(self, "idle_A", "full_A")
        between(self, 0.0, 95.0, "reserve_percent")


@dataclass(frozen=True)
class Thrusters:
    largest_command: float | None = None
    pairing: Literal["equal-thrust", "equal-command"] = "equal-thrust"
    nu_in_Nm: float | None = None

    def __post_init__(self) -> None:
        positive(self, "largest_command", "nu_in_Nm")


@dataclass(frozen=True)
class Goal:
    half_width_percent: float | None = None
    evidence: float = 20.0
    use_earlier_runs: bool = True

    def __post_init__(self) -> None:
        positive(self, "half_width_percent", "evidence")


@dataclass(frozen=True)
class Limits:
    schema: str = SCHEMA
    pool: Pool = field(default_factory=Pool)
    moments: Moments = field(default_factory=Moments)
    runs: Runs = field(default_factory=Runs)
    logger: Logger = field(default_factory=Logger)
    battery: Battery = field(default_factory=Battery)
    thrusters: Thrusters = field(default_factory=Thrusters)
    goal: Goal = field(default_factory=Goal)

    def __post_init__(self) -> None:
        if self.schema != SCHEMA:
            raise SettingError(f'schema is {self.schema!r}; expected the line schema = "{SCHEMA}"')


def example_limits() -> str:
    """Return a file to begin with: every setting with its default."""
    return files("automarine_cli.planning").joinpath("limits.toml").read_text(encoding="utf-8")


def read_limits(path: Path) -> Limits:
    """The limits in a TOML (or JSON) file. Raises SettingError with file and key."""
    return from_mapping(Limits, read_mapping(path), path.name)
