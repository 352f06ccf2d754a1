"""What the records of all result files share. A record holds the keys that somebody reads, under the names of their
motion; what else a file holds is passed over.
"""

from dataclasses import dataclass, field

from automarine_cli.dofs import Dof
from automarine_cli.pipeline.codec import FILLER
from automarine_cli.results.estimate import Estimate
from automarine_cli.runs.run import SetAside


@dataclass(frozen=True)
class RunsUsed:
    """How many runs were used, and which were not."""

    used: int = 0
    set_aside: tuple[SetAside, ...] = ()


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
