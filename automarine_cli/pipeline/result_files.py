"""Result files read back: a record of what readers need of each, its schema, the command that writes it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Generic, TypeVar, cast

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import AutomarineError, ModelError, SettingError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.pipeline.records import FILLER, Codec, Record, Source, keyed, read_plain, told
from automarine_cli.pipeline.words import printable


@dataclass(frozen=True)
class SetAside:
    """A run that was left out, and why: goes to standard error and into every result."""

    file: str
    run: str
    why: str


@dataclass(frozen=True)
class LogReading:
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
    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class AddedEffect:
    unread: ClassVar[tuple[str, ...]] = ("says", "confidence", "p_value", "rivals")
    name: str
    parameters: Mapping[str, Given]


@dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """One of the models of a file; None is what it does not have."""

    unread: ClassVar[tuple[str, ...]] = ("velocity_error", "sse", "why", "sides", "warnings", "notes")
    inertia: Given | None = field(default=None, metadata=keyed("{inertia_symbol}"))
    quadratic: Given | None = field(default=None, metadata=keyed("{quadratic}"))
    linear: Given | None = field(default=None, metadata=keyed("{linear}"))
    constant: Given | None = field(default=None, metadata=keyed("{constant}"))
    difference: Given | None = field(default=None, metadata=keyed("{difference}"))
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    covariance: Covariance | None = field(default=None, metadata=keyed("output_error/covariance"))
    effects: tuple[AddedEffect, ...] | None = None


@dataclass(frozen=True)
class Use:
    """Whether a model predicts better than somebody who expects no change, and the sentences that say so."""

    of_use: bool = True
    says: tuple[str, ...] | str = ()

    @property
    def refusal(self) -> str:
        """Why the model is not to be used; empty where it is of use."""
        said = (self.says,) if isinstance(self.says, str) else self.says
        return "" if self.of_use or not said else said[0]


@dataclass(frozen=True, kw_only=True)
class ModelFile(ResultRecord):
    """`yaw_model.json`, or that of another motion: models by number."""

    unread: ClassVar[tuple[str, ...]] = ("notes", "fitted_to", "driven", "time_constant_s")
    models: Mapping[str, ModelEntry | None]
    preferred: str
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    switch_offset: Given | None = None
    effects: tuple[AddedEffect, ...] = ()
    preferred_because: str = ""
    ratio: Given | None = field(default=None, metadata=keyed("{ratio_key}"))
    gain_scatter: Given | None = None
    gain_exponent: Given | None = None
    noise: float | None = field(default=None, metadata=keyed("{position}_noise_{shown_unit}"))
    force_range: tuple[float, float] | None = field(default=None, metadata=keyed("valid_range/{force}"))
    velocity_range: tuple[float, float] | None = field(default=None, metadata=keyed("valid_range/{velocity_key}"))
    parent_file: str = field(default="", metadata=keyed("parent/file"))
    parent_sha256: str = field(default="", metadata=keyed("parent/sha256"))
    channels: tuple[Sensor, ...] = ()
    random: Mapping[str, Given] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)
    buoyancy: Mapping[str, object] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        there = [number for number, entry in self.models.items() if entry is not None]
        if not there:
            raise SettingError("models: holds no model; expected one or more of 1, 2, 3")
        if self.preferred not in there:
            raise SettingError(
                f"preferred: found {told(self.preferred)}, expected one of the file's models ({', '.join(there)})"
            )

    @property
    def chosen(self) -> ModelEntry:
        return self.models[self.preferred] or ModelEntry()

    def main_parameters(self) -> Iterator[tuple[str, Given]]:
        """Drag and inertia of the preferred model that it has, in letters for print."""
        own, entry = self.dof.symbols, self.chosen
        found = {own.quadratic_print: entry.quadratic, own.linear: entry.linear, own.inertia: entry.inertia}
        return ((name, given) for name, given in found.items() if given is not None)


@dataclass(frozen=True, kw_only=True)
class PlanarFile(ResultRecord):
    """`planar_model.json`: parameters by qualified name."""

    unread: ClassVar[tuple[str, ...]] = (
        "fitted_to", "assumptions", "valid_range", "channels", "disturbance", "noises", "log_likelihood",
        "structure_because", "estimated", "estimated_because", "effects", "predicts", "parent", "notes", "warnings",
    )  # fmt: skip
    force_unit: str = "N"
    moment_unit: str = "N m"
    parameters: Mapping[str, Given]
    structure: str = ""
    covariance: Covariance | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)


@dataclass(frozen=True)
class CurveEntry:
    unread: ClassVar[tuple[str, ...]] = ()
    a: Given | None = None
    p: Given | None = None
    n_0: Given | None = None
    n_sat: Given | None = None


@dataclass(frozen=True)
class Curves:
    unread: ClassVar[tuple[str, ...]] = ()
    forward: CurveEntry | None = None
    backward: CurveEntry | None = None


@dataclass(frozen=True)
class VoltagePower:
    thrust_at_fixed_n: Given | None = None


@dataclass(frozen=True, kw_only=True)
class ThrusterFile(ResultRecord):
    """`thrusters.json`: a thruster map."""

    unread: ClassVar[tuple[str, ...]] = (
        "per_test", "r2", "rmse_N", "rmse_all_points_N", "rmse_percent_of_full_scale", "cv_rmse_N", "forms",
        "chosen_because", "tare", "flagged", "voltages", "notes", "points", "by",
    )  # fmt: skip
    a_forward: Given | None = field(default=None, metadata=keyed("forward/a"))
    a_backward: Given | None = field(default=None, metadata=keyed("backward/a"))
    form: str
    parameters: Curves
    n_unit: str = ""
    n_range: tuple[float, float] | None = None
    thrusters_per_test: int | None = None
    full_scale_N: float | None = None
    chosen: str = field(default="", metadata=keyed("chosen/form"))
    r2: float | None = field(default=None, metadata=keyed("chosen/r2"))
    rmse_percent: float | None = field(default=None, metadata=keyed("chosen/rmse_percent_of_full_scale"))
    voltage_range_V: tuple[float, float] | None = None
    voltage_exponent: Mapping[str, VoltagePower | float | None] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class CheckFile(ResultRecord):
    """`check.json`: what is in the logs."""

    logs: int
    yaw_runs: tuple[Mapping[str, object], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Score:
    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}", "heading_rmse_deg"))
    ci95: tuple[float, float] | None = field(default=None, metadata=keyed("rmse_{shown_unit}_ci95"))
    restarted: float | None = field(default=None, metadata=keyed("restarted_rmse_{shown_unit}"))
    runs: Mapping[str, "Score"] = field(default_factory=dict)


@dataclass(frozen=True)
class Foreseen:
    horizon_s: float
    runs: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ValidationFile(ResultRecord):
    """`validation.json`: the models of a file against measured runs; of a planar model there is one, and no fit."""

    models: Mapping[str, Score]
    best: str
    preferred_by_fit: str = ""
    noise_floor: float | None = field(default=None, metadata=keyed("noise_floor_{shown_unit}"))
    use: Use = field(default_factory=Use)
    logs: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    prediction: Mapping[str, tuple[Foreseen, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.best not in self.models:
            raise SettingError(f"best: found {told(self.best)}, expected one of {', '.join(self.models)}")


@dataclass(frozen=True)
class Tried:
    name: str
    gain: float


@dataclass(frozen=True)
class FoundEffect:
    """An effect that a diagnosis named or suspects, and those that cannot be excluded."""

    name: str
    parameters: Mapping[str, Given] = field(default_factory=dict)
    rivals: tuple["FoundEffect", ...] = ()
    split_by: str = ""


@dataclass(frozen=True, kw_only=True)
class TuningFile(ResultRecord):
    """`tuning.json`: what became of the gains of a target."""

    verdict: str
    target: str


@dataclass(frozen=True)
class Moved:
    after: Given


def _gap(name: str) -> float:
    """The gap of the runs that were fitted, in the unit in which positions are shown; of thrusters in newtons."""
    keys = keyed(f"gap/fitted_runs/{name}_{{shown_unit}}", f"gap/fitted_runs/{name}_N")
    return cast(float, field(metadata=keys))


@dataclass(frozen=True, kw_only=True)
class DiagnosisFile(ResultRecord):
    """`diagnosis.json`, of a motion, of the plane or of a thruster map."""

    verdict: str
    before: float = _gap("before")
    after: float = _gap("after")
    noise_floor: float = _gap("noise_floor")
    model: str = ""
    force_unit: str | None = field(default=None, metadata=keyed("{force}_unit"))
    effects: tuple[FoundEffect, ...] = ()
    base: Mapping[str, Moved] = field(default_factory=dict)
    candidates: tuple[Tried, ...] = ()
    threshold: float | None = None
    smallest_visible: Mapping[str, float] = field(default_factory=dict)

    @property
    def of_thrusters(self) -> bool:
        return self.model == "thruster-map"

    @property
    def unit(self) -> str:
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


@dataclass(frozen=True, kw_only=True)
class PlanFile(ResultRecord):
    """`plan.json`: what the vehicle plays of it."""

    moment_unit: str
    rate_hz: float = field(metadata=keyed("limits/logger/rate_hz"))
    rest_s: float = field(metadata=keyed("limits/runs/rest_before_s"))
    battery: Mapping[str, object] = field(metadata=keyed("limits/battery"))
    supply: Mapping[str, object]
    planned: tuple[Mapping[str, object], ...]


Read = TypeVar("Read", bound=Record, covariant=True)


@dataclass(frozen=True)
class ResultKind(Generic[Read]):
    """A kind of result: its file, its schema, the record of what is in it, what people call it, the command that
    writes it, and the motion that its keys are of (None where the file says)."""

    file: str
    schema: str
    record: type[Read]
    words: str
    writer: str
    dof: Dof | None = None

    def read(self, path: Source, name: str = "", refuse: type[AutomarineError] = ModelError) -> Read:
        """What the file at `path` holds, called `name` in messages. Raises `refuse` with file and place."""
        return self.of(read_plain(path, "JSON", refuse), name or printable(path.name), refuse)

    def of(self, data: object, name: str, refuse: type[AutomarineError] = ModelError) -> Read:
        if not isinstance(data, Mapping):
            raise refuse(f"{name}: found {told(data)}, expected an object with named keys")
        if (schema := data.get("schema")) != self.schema:
            other = next((f"this is {one.words}; " for one in KINDS if one.schema == schema), "")
            raise refuse(
                f"{name}: schema: found {told(schema)}, expected {told(self.schema)}; {other}give the {self.file} that "
                f"`automarine {self.writer}` writes"
            )
        return self.codec(data, name, refuse).read(self.record, data)

    def codec(self, data: Mapping[str, object], name: str, refuse: type[AutomarineError] = ModelError) -> Codec:
        """How the data become records, in the words of their motion."""
        dof = self.dof or DOFS.get(str(data.get("motion")), YAW)
        return Codec(name, dof, refuse, self.writer, tuple(DOFS.values()))


MODELS = {
    name: ResultKind(
        f"{name}_model.json", f"automarine/{name}-model/1", ModelFile, f"a {name} model", f"fit-{name}", dof
    )
    for name, dof in DOFS.items()
}
"""The model of each motion, by its name."""
PLANAR_MODEL = ResultKind(
    f"{PLANAR.name}_model.json", f"automarine/{PLANAR.name}-model/1", PlanarFile, "a planar model", "fit-planar", YAW
)
THRUSTER_MAP = ResultKind(
    "thrusters.json", "automarine/thruster-map/1", ThrusterFile, "a thruster map", "fit-thrusters", YAW
)
CHECK = ResultKind("check.json", "automarine/check/1", CheckFile, "a look at the logs", "check", YAW)
VALIDATION = ResultKind("validation.json", "automarine/validation/1", ValidationFile, "a validation", "validate")
DIAGNOSIS = ResultKind("diagnosis.json", "automarine/diagnosis/1", DiagnosisFile, "a diagnosis", "diagnose")
TUNING = ResultKind("tuning.json", "automarine/tuning/1", TuningFile, "a tuning", "tune")
PLAN = ResultKind("plan.json", "automarine/plan/1", PlanFile, "a plan", "plan", YAW)
RUN = ResultKind("run.json", "automarine/run/1", RunFile, "a campaign", "run", YAW)
KINDS: tuple[ResultKind[ResultRecord], ...] = (
    *MODELS.values(), PLANAR_MODEL, THRUSTER_MAP, CHECK, VALIDATION, DIAGNOSIS, TUNING, PLAN,
)  # fmt: skip
