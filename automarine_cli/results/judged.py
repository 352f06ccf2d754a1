"""Files of results about logs and models: check, validation, diagnosis, and the run of a campaign."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import keyed, told
from automarine_cli.results.estimate import Given
from automarine_cli.results.models import Use
from automarine_cli.results.records import ResultRecord


@dataclass(frozen=True)
class RunChecked:
    """What a fit would keep of a run; None where no step serves."""

    step: object = field(default=None, metadata=keyed("half_turn", "step"))


@dataclass(frozen=True, kw_only=True)
class CheckFile(ResultRecord):
    """`check.json`: what is in the logs."""

    logs: int
    yaw_runs: tuple[RunChecked, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Score:
    """How far one model's simulation of all runs is from what was measured."""

    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}", "heading_rmse_deg"))
    ci95: tuple[float, float] | None = field(default=None, metadata=keyed("rmse_{shown_unit}_ci95"))
    restarted: float | None = field(default=None, metadata=keyed("restarted_rmse_{shown_unit}"))
    runs: Mapping[str, "RunErrors"] = field(default_factory=dict)


@dataclass(frozen=True)
class RunErrors:
    """How far one model is from one run: simulated from its start, and restarted."""

    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}", "heading_rmse_deg"))
    restarted: float | None = field(default=None, metadata=keyed("restarted_rmse_{shown_unit}"))


@dataclass(frozen=True)
class Foreseen:
    """How well one model predicts so many seconds ahead: over all runs, and each."""

    horizon_s: float
    rmse: float = field(metadata=keyed("rmse_{shown_unit}"))
    runs: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LogSeen:
    """One of the logs."""

    samples: int = 0


@dataclass(frozen=True, kw_only=True)
class ValidationFile(ResultRecord):
    """`validation.json`: the models of a file against measured runs; of a planar model there is one, and no fit."""

    models: Mapping[str, Score]
    best: str
    preferred_by_fit: str = ""
    noise_floor: float | None = field(default=None, metadata=keyed("noise_floor_{shown_unit}"))
    use: Use = field(default_factory=Use)
    logs: Mapping[str, LogSeen] = field(default_factory=dict)
    prediction: Mapping[str, tuple[Foreseen, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.best not in self.models:
            raise SettingError(f"best: found {told(self.best)}, expected one of {', '.join(self.models)}")


@dataclass(frozen=True, kw_only=True)
class GapSize:
    """The gap before and after, in the unit in which positions are shown; of thrusters in newtons."""

    before: float = field(metadata=keyed("before_{shown_unit}", "before_N"))
    after: float = field(metadata=keyed("after_{shown_unit}", "after_N"))
    noise_floor: float = field(metadata=keyed("noise_floor_{shown_unit}", "noise_floor_N"))


@dataclass(frozen=True)
class Gaps:
    """The gap on the runs that were fitted."""

    fitted_runs: GapSize


@dataclass(frozen=True)
class Named:
    """An effect by its name."""

    name: str


@dataclass(frozen=True)
class FoundEffect:
    """An effect that a diagnosis named or suspects, and those that cannot be excluded."""

    name: str
    parameters: Mapping[str, Given] = field(default_factory=dict)
    rivals: tuple[Named, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TuningFile(ResultRecord):
    """`tuning.json`: what became of the gains of a target."""

    verdict: str
    target: str


@dataclass(frozen=True)
class Moved:
    """A parameter before and after what was missing was added."""

    after: Given


@dataclass(frozen=True, kw_only=True)
class DiagnosisFile(ResultRecord):
    """`diagnosis.json`, of a motion, of the plane or of a thruster map."""

    verdict: str
    gap: Gaps
    why: str = ""
    model: str = ""
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    effects: tuple[FoundEffect, ...] = ()
    base: Mapping[str, Moved] = field(default_factory=dict)

    @property
    def of_thrusters(self) -> bool:
        """Whether it is of a thruster map."""
        return self.model == "thruster-map"

    @property
    def unit(self) -> str:
        """The unit of the gap."""
        return "N" if self.of_thrusters else self.dof.units.key


@dataclass(frozen=True)
class StepDone:
    """A step of a campaign: its folder and the hash of its manifest, which holds those of all its files; or why it was
    skipped or refused."""

    step: str
    folder: str | None = None
    manifest_sha256: str | None = None
    skipped: str | None = None
    refused: str | None = None


@dataclass(frozen=True)
class RunFile:
    """`run.json`: what `run` left beside the report."""

    schema: str
    title: str = ""
    campaign: str = ""
    steps: tuple[StepDone, ...] = ()
    cautions: tuple[str, ...] = ()
