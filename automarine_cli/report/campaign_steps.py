"""The folders that a campaign's report is made from: what each step left, read and checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from automarine_cli.dofs import YAW, Dof
from automarine_cli.errors import OutputError
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.results.estimate import Estimate, Given
from automarine_cli.results.kinds import ResultKind
from automarine_cli.results.records import ResultRecord

Kept = TypeVar("Kept", bound=ResultRecord, covariant=True)


def folder_of(dof: Dof, step: str) -> str:
    """The folder of "validation" or "diagnosis" of a motion; those of yaw, which every campaign has, need no name."""
    return step if dof is YAW else f"{dof.name}_{step}"


@dataclass(frozen=True)
class StepFolder:
    """The folder of a step, its name, what kind of result it holds, and whether every campaign has it."""

    name: str
    step: str
    kind: ResultKind[ResultRecord]
    always: bool


@dataclass(frozen=True)
class StepResult(Generic[Kept]):
    """What one step left: its folder, what its result file holds, and its manifest (None if there is none)."""

    name: str
    folder: Path
    file: Kept
    manifest: Manifest | None

    @property
    def dof(self) -> Dof:
        """The motion that it is of."""
        return self.file.dof

    def known(self, given: Given, place: str) -> Estimate:
        """An estimate of the result file. Raises ModelError with its place if it is none."""
        return given.known(f"{self.name}: {place}")

    def text(self, name: str) -> str:
        """A text file of the folder; empty if it is not there."""
        path = self.folder / name
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


@dataclass(frozen=True)
class Steps:
    """The steps that are there, by folder name in their order, and those that might be."""

    found: Mapping[str, StepResult[ResultRecord]]
    places: Sequence[StepFolder]

    def get(self, name: str, record: type[Kept]) -> StepResult[Kept] | None:
        """A step's result of a kind, if it is there."""
        step = self.found.get(name)
        if step is None or not isinstance(step.file, record):
            return None
        return StepResult(step.name, step.folder, step.file, step.manifest)

    @property
    def missing(self) -> list[str]:
        """Folders of every campaign that are not there."""
        return [one.name for one in self.places if one.always and one.name not in self.found]


def read_steps(folder: Path, places: Sequence[StepFolder]) -> Steps:
    """The steps that are there. Raises OutputError if there is none, or for a file that automarine did not write so."""
    found = {}
    for one in places:
        path = folder / one.name / one.kind.file
        if path.is_file():
            file, manifest = one.kind.read(path, f"{one.name}/{path.name}", OutputError), path.with_name(MANIFEST)
            known = read_manifest(manifest) if manifest.is_file() else None
            found[one.name] = StepResult(one.name, folder / one.name, file, known)
    if not found:
        usual = ", ".join(one.name for one in places if one.always)
        raise OutputError(
            f"{folder}: none of the folders {usual} with results is here; give a folder that "
            "automarine run made, or write the results of single commands into folders of these names"
        )
    return Steps(found, places)
