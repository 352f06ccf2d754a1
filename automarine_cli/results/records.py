"""What the records of all result files share. A record holds the keys that somebody reads, under the names of their
motion; what else a file holds is passed over.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from automarine_cli.dofs import Dof
from automarine_cli.pipeline.records import FILLER, to_mapping
from automarine_cli.results.estimate import Estimate
from automarine_cli.runs.run import Run, SetAside, command_warnings


@dataclass(frozen=True)
class LogReading:
    """What to know of the reading of a log."""

    file: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class RunsUsed:
    """How many runs were used, which were not, what to know of the reading of their logs, and how thruster commands do
    not fit their map (None for nothing)."""

    used: int = 0
    set_aside: tuple[SetAside, ...] = ()
    readings: tuple[LogReading, ...] | None = None
    commands: tuple[str, ...] | None = None


def runs_json(used: int, set_aside: Iterable[SetAside], runs: Sequence[Run] = ()) -> dict[str, object]:
    """The `runs` of a result file; `runs` are those of which the logs may have been read in a way to be told."""
    told = {run.source: run.reading for run in runs if run.reading}
    readings = tuple(LogReading(file, tuple(notes)) for file, notes in told.items())
    return to_mapping(RunsUsed(used, tuple(set_aside), readings or None, command_warnings(runs) or None))


@dataclass(frozen=True, kw_only=True)
class ResultRecord:
    """What every result file has: its schema, the motion (yaw where none is named), and the runs."""

    schema: str
    motion: str = ""
    runs: RunsUsed = RunsUsed()
    dof: Dof = field(metadata=FILLER)


@dataclass(frozen=True)
class Sensor:
    """Whether a sensor counts: how noisy it is, or why not."""

    quantity: str
    used: bool
    noise: Estimate | None = None
    why: str | None = None


@dataclass(frozen=True)
class Covariance:
    """A covariance matrix and the names of its rows."""

    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
