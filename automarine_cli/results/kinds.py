"""The kinds of result files: what each is called, how its schema begins, and the one way to read it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import AutomarineError, ModelError
from automarine_cli.pipeline.records import Codec, Record, Source, read_plain, told
from automarine_cli.pipeline.words import printable
from automarine_cli.results.files import (
    CheckFile,
    DiagnosisFile,
    ModelFile,
    PlanarFile,
    PlanFile,
    ResultRecord,
    RunFile,
    ThrusterFile,
    TuningFile,
    ValidationFile,
)

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
