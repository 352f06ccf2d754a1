"""The result of `verify`: what became of the files of a result, and of its inputs."""

from dataclasses import asdict, dataclass

from automarine_cli.report.sections import Sections, sections
from automarine_cli.text import printable


@dataclass(frozen=True)
class Change:
    """One file that is not as recorded: `what` is changed, missing or extra; inputs may be not-found too."""

    file: str
    what: str
    why: str


@dataclass(frozen=True)
class FolderVerified:
    folder: str
    command: str
    files: int
    outputs: tuple[Change, ...]
    inputs_recorded: int
    inputs_whole: int
    inputs: tuple[Change, ...]

    @property
    def whole(self) -> bool:
        """Whether nothing changed; inputs that nobody pointed at and that were not found do not count."""
        return not self.outputs and all(change.what == "not-found" for change in self.inputs)

    @property
    def sentence(self) -> str:
        good = self.files - sum(change.what != "extra" for change in self.outputs)
        return (
            f"{self.folder} ({self.command}): {good} of {self.files} files as written, "
            f"{self.inputs_whole} of {self.inputs_recorded} inputs found as recorded"
        )

    def changes(self) -> list[str]:
        lines = [f"{self.folder}/{change.file}: {change.why}" for change in self.outputs]
        lines += [f"{self.folder}: input {change.file}: {change.why}" for change in self.inputs]
        return [printable(line) for line in lines]


@dataclass(frozen=True)
class Verification:
    folders: tuple[FolderVerified, ...]

    @property
    def whole(self) -> bool:
        return all(folder.whole for folder in self.folders)

    def to_json(self) -> dict[str, object]:
        folders = [{**asdict(folder), "whole": folder.whole} for folder in self.folders]
        return {"schema": "automarine/verification/1", "whole": self.whole, "folders": folders}


@sections.register
def _(result: Verification) -> Sections:
    return Sections([folder.sentence for folder in result.folders])
