"""`verify`: are the files of a folder of results, and the inputs, still what its manifest recorded?"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.manifest import MANIFEST, Entry, Manifest, manifests_in, read_manifest, sha256_if_readable
from automarine_cli.pipeline.words import printable

SCHEMA = "automarine/verification/1"
NOT_RESULTS = (".DS_Store", "Thumbs.db", "desktop.ini")  # what file managers leave in any folder


@dataclass(frozen=True)
class Change:
    """One file that is not as recorded: `what` is changed, missing or extra; inputs may be not-found too."""

    file: str
    what: str
    why: str


@dataclass(frozen=True)
class FolderVerified:
    """What became of one folder of results since it was written."""

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

    def sentence(self) -> str:
        """What is whole, in one line."""
        good = self.files - sum(change.what != "extra" for change in self.outputs)
        return (
            f"{self.folder} ({self.command}): {good} of {self.files} files as written, "
            f"{self.inputs_whole} of {self.inputs_recorded} inputs found as recorded"
        )

    def changes(self) -> list[str]:
        """A line for each file that is not as recorded."""
        lines = [f"{self.folder}/{change.file}: {change.why}" for change in self.outputs]
        lines += [f"{self.folder}: input {change.file}: {change.why}" for change in self.inputs]
        return [printable(line) for line in lines]


@dataclass(frozen=True)
class Verification:
    """Every folder that was verified."""

    folders: tuple[FolderVerified, ...]

    @property
    def whole(self) -> bool:
        """Whether nothing changed anywhere."""
        return all(folder.whole for folder in self.folders)

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/verification/1."""
        folders = [{**asdict(folder), "whole": folder.whole} for folder in self.folders]
        return {"schema": SCHEMA, "whole": self.whole, "folders": folders}


def verify(folders: Sequence[Path], *, inputs: Sequence[Path] = ()) -> Verification:
    """Recompute the hashes of the manifests in `folders` and below them.

    Inputs are looked for under `inputs` and must be there; without it under the working directory and beside
    each folder, and those not found are told only. Raises SettingError where there is no manifest, or a broken one.
    """
    return Verification(tuple(one for folder in folders for one in _inside(folder, inputs)))


def _inside(folder: Path, inputs: Sequence[Path]) -> list[FolderVerified]:
    try:
        found = list(manifests_in(folder))
    except OSError as problem:
        raise SettingError(
            f"{folder}: cannot be read ({problem.strerror}); make it readable, or give another folder"
        ) from None
    if (folder / MANIFEST).is_file() and folder / MANIFEST not in found:
        read_manifest(folder / MANIFEST)  # says what is wrong with it
    if not found:
        raise SettingError(f"{folder}: no {MANIFEST} of automarine here or in a folder below; give a folder of results")
    places = [path.parent for path in found]
    return [_verified(place, read_manifest(place / MANIFEST), places, inputs) for place in places]


def _verified(folder: Path, manifest: Manifest, places: Sequence[Path], inputs: Sequence[Path]) -> FolderVerified:
    recorded = {entry.file: entry.sha256 for entry in manifest.outputs}
    changes = []
    for name, sha256 in recorded.items():
        if not (folder / name).is_file():
            changes.append(Change(name, "missing", "missing"))
        elif sha256_if_readable(folder / name) != sha256:
            changes.append(Change(name, "changed", "changed since it was written"))
    others = [place for place in places if place != folder and folder in place.parents]
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        ours = name in recorded or name == MANIFEST or path.name in NOT_RESULTS
        if not ours and not path.is_dir() and not any(place in path.parents for place in others):
            changes.append(Change(name, "extra", "extra: not among the files that were written"))
    sought = list(_find_inputs(manifest.inputs, inputs or _likely(folder)))
    where = f"under {', '.join(str(place) for place in inputs)}" if inputs else "here or beside the results"
    bad = []
    for one in sought:
        if one.changed is not None:
            bad.append(Change(one.entry.file, "changed", f"changed; {one.changed} has other content"))
        elif one.path is None:
            bad.append(Change(one.entry.file, "missing" if inputs else "not-found", f"not found {where}"))
    return FolderVerified(
        str(folder), manifest.command, len(recorded), tuple(changes),
        len(sought), len(sought) - len(bad), tuple(bad),
    )  # fmt: skip


class Sought(NamedTuple):
    """A recorded input: `path` holds what was read then; else `changed` is a file of that whole name, if any."""

    entry: Entry
    path: Path | None
    changed: Path | None


def _find_inputs(entries: Sequence[Entry], folders: Sequence[Path]) -> Iterator[Sought]:
    """Yield where each recorded input is under the folders, hidden ones left out, by its name and content."""
    named: dict[str, list[Path]] = {}
    for here, inside, files in (at for one in folders for at in os.walk(one if one.is_dir() else one.parent)):
        inside[:] = sorted(name for name in inside if not name.startswith("."))
        for name in sorted(files):
            named.setdefault(printable(name), []).append(Path(here, name))
    for entry in entries:
        paths = named.get(PurePosixPath(entry.file).name, [])
        alike = [path for path in paths if printable(path.resolve().as_posix()).endswith(f"/{entry.file}")]
        same = next((path for path in [*alike, *paths] if entry.sha256 in (None, sha256_if_readable(path))), None)
        yield Sought(entry, same, alike[0] if alike and same is None else None)


def _likely(folder: Path) -> list[Path]:
    """Where inputs may be when nobody says: the working directory, and the folder that holds the results."""
    here, beside = Path(), folder.resolve().parent
    return [here] if Path.cwd() == beside or Path.cwd() in beside.parents else [here, beside]
