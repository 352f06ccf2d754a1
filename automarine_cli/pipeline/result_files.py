"""Result files read back: a record of what readers need of each, its schema, the command that writes it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Generic, TypeVar

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


@dataclass(frozen=True)
class Likeliest:
    """What the fit by maximum likelihood says beside its parameters."""

    covariance: Covariance | None = None


@dataclass(frozen=True)
class AddedEffect:
    """An effect of a model, parameters by name."""

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
    output_error: Likeliest | None = None
    effects: tuple[AddedEffect, ...] | None = None


@dataclass(frozen=True)
class ValidRange:
    """Smallest and largest force and velocity of what was fitted."""

    force: tuple[float, float] | None = field(default=None, metadata=keyed("{force}"))
    velocity: tuple[float, float] | None = field(default=None, metadata=keyed("{velocity_key}"))


@dataclass(frozen=True)
class Parent:
    """The file that a model grew from."""

    file: str
    sha256: str


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
    valid_range: ValidRange | None = None
    parent: Parent | None = None
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
        """The preferred model."""
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
        "structure_because", "estimated", "estimated_because", "effects", "predicts", "parent", "notes",
    )  # fmt: skip
    force_unit: str = "N"
    moment_unit: str = "N m"
    parameters: Mapping[str, Given]
    structure: str = ""
    covariance: Covariance | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SquareLaw:
    """The square law of one direction; None where it was not measured."""

    a: Given | None = None


@dataclass(frozen=True)
class CurveEntry:
    """The parameters of one direction's curve."""

    unread: ClassVar[tuple[str, ...]] = ()
    a: Given | None = None
    p: Given | None = None
    n_0: Given | None = None
    n_sat: Given | None = None

    @property
    def named(self) -> dict[str, Given]:
        """Those that there are, by name."""
        return {name: one for name, one in vars(self).items() if one is not None}


@dataclass(frozen=True)
class Curves:
    """Both directions."""

    unread: ClassVar[tuple[str, ...]] = ()
    forward: CurveEntry | None = None
    backward: CurveEntry | None = None


@dataclass(frozen=True)
class FormEntry:
    """A form of the curve, and how well it fits."""

    form: str = ""
    equation: str = ""
    r2: float | None = None
    rmse_percent_of_full_scale: float | None = None


@dataclass(frozen=True)
class VoltagePower:
    """How the thrust of one direction grows with the voltage."""

    thrust_at_fixed_n: Given | None = None


@dataclass(frozen=True, kw_only=True)
class ThrusterFile(ResultRecord):
    """`thrusters.json`: a thruster map."""

    unread: ClassVar[tuple[str, ...]] = (
        "per_test", "r2", "rmse_N", "rmse_all_points_N", "cv_rmse_N", "chosen_because", "tare", "flagged",
        "voltages", "notes", "points", "by",
    )  # fmt: skip
    forward: SquareLaw
    backward: SquareLaw
    form: str
    parameters: Curves
    n_unit: str = ""
    n_range: tuple[float, float] | None = None
    full_scale_N: float | None = None
    rmse_percent_of_full_scale: float | None = None
    forms: tuple[FormEntry, ...] = ()
    chosen: FormEntry | None = None
    thrusters_per_test: int | None = None
    voltage_range_V: tuple[float, float] | None = None
    voltage_exponent: Mapping[str, VoltagePower | float | None] = field(default_factory=dict)


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
    runs: Mapping[str, "Score"] = field(default_factory=dict)


@dataclass(frozen=True)
class Foreseen:
    """How well one model predicts so many seconds ahead: over all runs, and each."""

    horizon_s: float
    rmse: float = field(metadata=keyed("rmse_{shown_unit}"))
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
class Tried:
    """An effect that a diagnosis tried alone, and what it gained."""

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
    candidates: tuple[Tried, ...] = ()
    threshold: float | None = None
    smallest_visible: Mapping[str, float] = field(default_factory=dict)

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
        """What plain data hold. Raises `refuse` with the place."""
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
    *MODELS.values(),
    PLANAR_MODEL,
    THRUSTER_MAP,
    CHECK,
    VALIDATION,
    DIAGNOSIS,
    TUNING,
    PLAN,
)
