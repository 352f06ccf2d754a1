"""`plan.json`: the runs of the next campaign, as far as who drives them reads it."""

from dataclasses import dataclass

from automarine_cli.results.records import ResultRecord


@dataclass(frozen=True)
class Planned:
    """A run: `commands` (moment, seconds) as they are written, after the rest at its start heading."""

    name: str
    commands: object
    start_heading_deg: float
    wait_s: float


@dataclass(frozen=True)
class Drawn:
    """Current always, and more at the largest moment."""

    idle_A: float
    full_A: float
    at_moment: float


@dataclass(frozen=True)
class Stored:
    """The battery."""

    charge_Ah: float
    reserve_percent: float


@dataclass(frozen=True)
class Rest:
    """What every run begins with."""

    rest_before_s: float


@dataclass(frozen=True)
class Rate:
    """How often is logged."""

    rate_hz: float


@dataclass(frozen=True)
class PlanLimits:
    """What the pool day allows."""

    runs: Rest
    logger: Rate
    battery: Stored


@dataclass(frozen=True, kw_only=True)
class PlanFile(ResultRecord):
    """The file."""

    moment_unit: str
    limits: PlanLimits
    supply: Drawn
    planned: tuple[Planned, ...]
