"""Recorded inputs are found again: by name under given folders, and told by their content."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.pipeline.manifest import Entry, sha256_if_readable
from automarine_cli.pipeline.words import printable


@dataclass(frozen=True)
class Sought:
    """One recorded input: `path` holds what was read then; else `changed` is the file of that whole name, if any."""

    entry: Entry
    path: Path | None = None
    changed: Path | None = None


def find_inputs(entries: Sequence[Entry], folders: Sequence[Path]) -> tuple[Sought, ...]:
    """Each recorded input under the folders (searched recursively; hidden folders and links are left out).

    A file must bear the recorded name. Of several, one with the recorded content counts, and of those the one
    that has more of the recorded folders above it. What was recorded without a hash is taken by its name.
    """
    wanted = {_last(entry) for entry in entries}
    named: dict[str, list[Path]] = {}
    for path in _files(folders):
        if printable(path.name) in wanted:
            named.setdefault(printable(path.name), []).append(path)
    hashes: dict[Path, str | None] = {}
    return tuple(_sought(entry, named.get(_last(entry), []), hashes) for entry in entries)


def _sought(entry: Entry, candidates: list[Path], hashes: dict[Path, str | None]) -> Sought:
    likely = sorted(candidates, key=lambda path: (-_shared(entry, path), len(path.parts), str(path)))
    for path in likely:
        if path not in hashes:
            hashes[path] = sha256_if_readable(path)
        if entry.sha256 is None or hashes[path] == entry.sha256:
            return Sought(entry, path)
    of_that_name = (path for path in likely if _shared(entry, path) == len(entry.file.split("/")))
    return Sought(entry, changed=next(of_that_name, None))


def _files(folders: Sequence[Path]) -> Iterator[Path]:
    for given in folders:
        if given.is_file():
            yield given
        for here, inside, files in os.walk(given):
            inside[:] = sorted(name for name in inside if not name.startswith("."))
            yield from (Path(here, name) for name in sorted(files))


def _last(entry: Entry) -> str:
    return entry.file.rpartition("/")[2]


def _shared(entry: Entry, path: Path) -> int:
    """How many parts of the recorded name stand at the end of the path."""
    recorded, there = entry.file.split("/")[::-1], [printable(part) for part in path.resolve().parts[::-1]]
    same = [one == other for one, other in zip(recorded, there)]
    return [*same, False].index(False)
