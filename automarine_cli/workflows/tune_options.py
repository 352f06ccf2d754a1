"""Options of `tune`, and what a tuning is made of once they are read and checked."""

from dataclasses import dataclass, field
from pathlib import Path

from automarine_cli.control.authority import authority
from automarine_cli.control.knowledge import EXTENDED, SUPPLY, Knowledge, is_diagnosis, read_knowledge
from automarine_cli.control.members import Bend
from automarine_cli.control.search import Task
from automarine_cli.control.targets import get
from automarine_cli.control.targets.base import Target
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.logs import Logs, given_columns
from automarine_cli.pipeline.records import Source
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.command import reads
from automarine_cli.workflows.moments import map_and_arm
from automarine_cli.workflows.shared import Columns, Drawn

BAND_DEG, BAND_M = 2.0, 0.05
"""Within what a step counts as settled: the field's two degrees of heading, and 5 cm."""
STEP_DEG, STEP_M = 90.0, 1.0


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """The model or diagnosis, the stack, and what the vehicle's whole output gives."""

    model: Source = field(metadata=reads("file"))
    target: str = ""
    step: float | None = None
    load: float = 10.0
    margin: float = 0.75
    full: float | None = None
    thrusters: Source | ThrusterMap | None = field(default=None, metadata=reads("file"))
    arm: float | None = None


@dataclass(frozen=True, kw_only=True)
class TuneOptions(Drawn, Columns, _Asked):
    """`step` in degrees or metres, `load` [%] of the whole output, disk `margin` to keep; `full` moment or force of the
    whole output; `extended` is the model that belongs to a diagnosis, by default the one beside it.

    `delay` [s] that the logs cannot show, `supply` voltage in shares of that of the logs; `present` gains,
    `sample_time` [s] of targets that have none of their own; `check` are logs flown with the gains of a tuning, with
    the column of their `reference`; `seed` draws the vehicles.
    """

    extended: Source | None = field(default=None, metadata=reads("file"))
    delay: float | None = None
    supply: tuple[float, float] = SUPPLY
    present: Source | None = field(default=None, metadata=reads("file"))
    sample_time: float | None = None
    beyond_range: bool = False
    check: Logs = field(default=(), metadata=reads("logs", "log"))
    reference: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        beside = self.model.with_name(EXTENDED) if isinstance(self.model, Path) else None
        if self.extended is None and beside is not None and beside.is_file() and is_diagnosis(self.model):
            object.__setattr__(self, "extended", beside)
        low, high = self.supply
        for name, fine, wanted in (
            ("--margin", 0.0 < self.margin < 2.0, "between 0 and 2"),
            ("--load", 0.0 < self.load < 100.0, "between 0 and 100"),
            ("--step", self.step is None or self.step > 0.0, "above 0"),
            ("--full", self.full is None or self.full > 0.0, "above 0"),
            ("--delay", self.delay is None or 0.0 <= self.delay <= 5.0, "between 0 and 5 s"),
            ("--sample-time", self.sample_time is None or 0.001 <= self.sample_time <= 1.0, "between 0.001 and 1 s"),
            ("--supply", 0.0 < low <= 1.0 <= high < 3.0, "shares below and above 1"),
        ):
            if not fine:
                raise SettingError(f"{name}: found a value that makes no sense; expected {wanted}")


@dataclass(frozen=True)
class TuneSection:
    """The same in a campaign's file: the `target`, and what `tune` has to know beside the model; `thrusters` whether
    the campaign's thruster map is flown, with its dead-band."""

    target: str
    full: float | None = None
    delay: float | None = None
    step: float | None = None
    load: float = 10.0
    margin: float = 0.75
    present: str | None = None
    sample_time: float | None = None
    beyond_range: bool = False
    thrusters: bool = False


@dataclass(frozen=True)
class Ready:
    """Everything that a tuning is made of."""

    asked: TuneOptions
    target: Target
    known: Knowledge
    full: float
    bend: Bend | None
    task: Task


def ready(asked: TuneOptions) -> Ready:
    """What was asked for, read and checked. Raises ModelError or SettingError."""
    known = _known(asked)
    target = get(asked.target, asked.sample_time, asked.beyond_range)
    dof = known.model.dof
    if dof.name not in target.motions:
        raise ModelError(
            f"{known.stored.source} is a model of {dof.name}; {target.name} controls {' or '.join(target.motions)}"
        )
    if asked.thrusters is not None and not dof.levered:
        raise SettingError(f"--thrusters makes turning moments; for {dof.name} give --full with the whole force")
    drive = map_and_arm(asked.thrusters, asked.arm, given_columns(asked.columns), dof)
    full, bend = authority(target, known, asked.full, drive)
    step = asked.step if asked.step is not None else STEP_DEG if dof.wraps else STEP_M
    band = dof.inner(BAND_DEG if dof.wraps else BAND_M)
    task = Task(dof.inner(step), band, asked.load / 100.0, asked.margin, 0.0)
    return Ready(asked, target, known, full, bend, task)


def _known(asked: TuneOptions) -> Knowledge:
    """What the files say."""
    if not is_diagnosis(asked.model):
        return read_knowledge(asked.model, None, asked.delay, asked.supply)
    if asked.extended is None:
        raise ModelError(f"{asked.model.name}: its {EXTENDED} is not beside it; keep both in one folder")
    return read_knowledge(asked.extended, asked.model, asked.delay, asked.supply)
