"""Options that several commands have, and pieces of what they show; a command's record is made of these."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.pipeline.records import Document, Source
from automarine_cli.report.figures.files import refuse_unknown
from automarine_cli.report.tables import interval
from automarine_cli.results.estimate import Estimate
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.command import SELDOM, reads
from automarine_cli.workflows.view import Row


@dataclass(frozen=True, kw_only=True)
class OfLogs:
    """The logs, and what their columns are called."""

    logs: Logs = field(metadata=reads("logs", "log"))


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The file of the model that is judged, or a fit."""

    model: Source = field(metadata=reads("file"))


@dataclass(frozen=True, kw_only=True)
class Columns:
    """What the columns of the logs are called."""

    columns: Path | Document | ColumnMap | None = field(default=None, metadata=reads("file"))


@dataclass(frozen=True, kw_only=True)
class Thrusters(Columns):
    """The map that makes moments or forces of thruster commands."""

    thrusters: Source | ThrusterMap | None = field(default=None, metadata=reads("file"))


@dataclass(frozen=True, kw_only=True)
class Lever(Thrusters):
    """The same with the lever arm [m] of two thrusters."""

    arm: float | None = None


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Formats of the figures (png, svg, pdf). Raises SettingError for another."""

    figure_formats: tuple[str, ...] = ("png",)

    def __post_init__(self) -> None:
        refuse_unknown(self.figure_formats)


@dataclass(frozen=True, kw_only=True)
class Ending(Drawn):
    """The same, and whether what would be set aside is refused."""

    strict: bool = False


@dataclass(frozen=True, kw_only=True)
class Beforehand:
    """What is known of the parameters beforehand. Raises SettingError for what is none."""

    known: Known = field(default=NOTHING_KNOWN, metadata=SELDOM)

    def __post_init__(self) -> None:
        object.__setattr__(self, "known", Known.of(self.known))
        super().__post_init__()  # type: ignore[misc]


def counted(count: int, what: str) -> str:
    """A count and what is counted: 1 run, 2 runs."""
    return f"{count} {what}{'s' * (count != 1)}"


def numbers(estimate: Estimate) -> Row:
    """An estimate as the cells of a row."""
    low, high = estimate.ci95
    return {"value": estimate.value, "stderr": estimate.stderr, "low": low, "high": high, "unit": estimate.unit}


def aligned(estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Names, numbers with their intervals, units: one line each."""
    width = max((len(name) for name in estimates), default=0)
    for name, one in estimates.items():
        unit = "" if one.unit in ("", "1") else f" {one.unit}"
        yield f"  {name:<{width}}  {interval(one)}{unit}"
