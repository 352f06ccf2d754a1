"""Result files read back: what all of them hold, and how one becomes the record that its writer's room declares."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import AutomarineError, ModelError
from automarine_cli.pipeline.records import FILLER, Codec, Record, Source, read_plain, told
from automarine_cli.pipeline.words import printable


@dataclass(frozen=True)
class SetAside:
    """A run that was left out, and why: goes to standard error and into every result."""

    file: str
    run: str
    why: str


@dataclass(frozen=True)
class RunsUsed:
    used: int = 0
    set_aside: tuple[SetAside, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ResultRecord:
    """What every result file has: its schema, the motion (yaw where none is named), and the runs."""

    schema: str
    motion: str = ""
    runs: RunsUsed = RunsUsed()
    dof: Dof = field(metadata=FILLER)


Read = TypeVar("Read", bound=Record, covariant=True)


@dataclass(frozen=True)
class ResultKind(Generic[Read]):
    """A kind of result: its file, its name in the schema, the record of what is in it, the command that writes it, and
    the motion that its keys are of (None where the file says)."""

    file: str
    name: str
    record: type[Read]
    writer: str
    dof: Dof | None = None

    @property
    def schema(self) -> str:
        return f"automarine/{self.name}/1"

    def read(self, path: Source, name: str = "", refuse: type[AutomarineError] = ModelError) -> Read:
        """What the file at `path` holds, called `name` in messages. Raises `refuse` with file and place."""
        return self.of(read_plain(path, "JSON", refuse), name or printable(path.name), refuse)

    def of(self, data: object, name: str, refuse: type[AutomarineError] = ModelError) -> Read:
        if not isinstance(data, Mapping):
            raise refuse(f"{name}: found {told(data)}, expected an object with named keys")
        if (schema := data.get("schema")) != self.schema:
            parts = str(schema).split("/")
            other = parts[1].replace("-", " ") if len(parts) == 3 and parts[1] != self.name else ""
            this = f"this is a {printable(other)}; " if other else ""
            raise refuse(
                f"{name}: schema: found {told(schema)}, expected {told(self.schema)}; {this}give the {self.file} that "
                f"`automarine {self.writer}` writes"
            )
        return self.codec(data, name, refuse).read(self.record, data)

    def codec(self, data: Mapping[str, object], name: str, refuse: type[AutomarineError] = ModelError) -> Codec:
        """How the data become records, in the words of their motion."""
        dof = self.dof or DOFS.get(str(data.get("motion")), YAW)
        return Codec(name, dof, refuse, self.writer)
