"""Results appear whole or not at all, with a manifest that says what they were made from and by what.

A folder of results is told by its `manifest.json`; how it gets onto the disk is the matter of `staging`.
"""

import contextlib
import copy
import dataclasses
import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeVar

from automarine_cli.errors import OutputError
from automarine_cli.pipeline import staging
from automarine_cli.pipeline.attempts import Attempt, attempted
from automarine_cli.pipeline.codec import to_mapping
from automarine_cli.pipeline.manifest import (
    MANIFEST,
    SCHEMA,
    Input,
    input_entries,
    is_manifest,
    manifests_in,
    versions_here,
)
from automarine_cli.pipeline.plain_data import Document, Source

Made = TypeVar("Made")

MOST_FOREIGN = 1000
MOST_THROUGH = 200  # files written through to the disk one by one; of more, a slow disk would make minutes
# Settings that must not change a result, or that `inputs` says already: never in the manifest.
UNRECORDED = frozenset({"logs", "out", "jobs", "overwrite", "as_json", "json", "progress", "verbose", "quiet"})


def json_text(data: object) -> str:
    """The one JSON of automarine: order kept, indent 1, letters of any alphabet kept, newline at the end.

    Raises OutputError for a value that is not a finite number: a result file never holds NaN.
    """
    try:
        text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False, default=_as_plain) + "\n"
    except ValueError as problem:
        place = _first_not_finite(data) or str(problem)
        raise OutputError(f"{place} is not a finite number; this is a bug, please report it") from None
    # a byte of a file's name that is not UTF-8 has no letter, only an escape
    return re.sub("[\ud800-\udfff]", lambda lone: f"\\u{ord(lone[0]):04x}", text)


def json_document(name: str, data: object) -> Document:
    """A result as the file that it would be written as."""
    return Document(name, json_text(data).encode("utf-8"))


def file_stems(names: Sequence[str]) -> list[str]:
    """A safe, distinct part of a file name for each run name (which may hold slashes, blanks, anything)."""
    stems: list[str] = []
    taken: set[str] = set()
    for name in names:
        stem = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in name).strip(".")[:80] or "run"
        unique, n = stem, 1
        while unique.lower() in taken:  # some file systems do not tell A from a
            n += 1
            unique = f"{stem}_{n}"
        taken.add(unique.lower())
        stems.append(unique)
    return stems


class ResultFolder:
    """The folder under construction: everything written here appears together at the end."""

    def __init__(self, out: Path, stage: Path, forbidden: frozenset[str]) -> None:
        self._out = out
        self._stage = stage
        self._forbidden = forbidden
        self._hashes: dict[str, str] = {}
        self._warnings: list[str] = []
        self._below = ""

    def below(self, name: str) -> "ResultFolder":
        """The same folder, whose files go into the subfolder `name`: for results that another command makes too."""
        inner = copy.copy(self)
        inner._below = f"{self._below}{name}/"
        return inner

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of every file written so far, by name, in name order."""
        return dict(sorted(self._hashes.items()))

    def write(self, name: str, content: bytes | str) -> None:
        """One file; `name` is relative, with forward slashes where it goes into a subfolder.

        Raises OutputError if the disk refuses, or a file of that name that is not ours would be replaced.
        """
        name = f"{self._below}{name}"
        path = PurePosixPath(name)
        inside = path.parts and not path.is_absolute() and ".." not in path.parts and "\\" not in name
        if not inside or name != path.as_posix() or name in self._hashes:
            raise ValueError(f"result file {name!r}: expected a new relative name")
        if name in self._forbidden:
            raise OutputError(f"{self._out} already holds a file {name}; give --overwrite to replace it")
        data = content.encode("utf-8") if isinstance(content, str) else content
        with staging.one_sentence(self._out):
            file = self._stage.joinpath(*path.parts)
            file.parent.mkdir(parents=True, exist_ok=True)
            staging.write(file, data, through=len(self._hashes) < MOST_THROUGH)
        self._hashes[name] = hashlib.sha256(data).hexdigest()

    def write_json(self, name: str, data: object) -> None:
        """One JSON file in the house's form. Raises OutputError, also for NaN and infinity."""
        self.write(name, json_text(data))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what could not be made, in order."""
        return tuple(self._warnings)

    def attempt(self, failure: str, work: Callable[[], Made]) -> Made | None:
        """What `work` makes; where it fails None, and a warning that begins with `failure`: see `attempted`."""
        return self.taken(attempted(failure, work))

    def taken(self, attempt: Attempt[Made]) -> Made | None:
        """What was made; where nothing was None, and the warning is in the manifest."""
        if attempt.warning:
            self._warnings.append(attempt.warning)
        return attempt.made


@contextlib.contextmanager
def result_folder(
    out: Path,
    *,
    command: str,
    options: Mapping[str, object],
    inputs: Sequence[tuple[str, Source] | Input],
    seed: int | None,
    overwrite: bool,
) -> Iterator[ResultFolder]:
    """Write the results of `command` into the folder `out`, whole or not at all.

    `inputs` are the files read, each with the short name that results use and its role (without one: a log).
    `options` and `seed` must hold all else that the results depend on.
    On leaving without an error the manifest is added and the whole folder appears at once; on any error nothing
    of it stays behind. Raises OutputError if `out` holds results and `overwrite` is false, is a file, is being
    written to by another process, or cannot be written.
    """
    target = Path(os.path.realpath(out))
    with staging.one_sentence(out), staging.staged(target) as stage:
        _, forbidden = _inspect(target, out, command, overwrite)
        read = input_entries(inputs)
        folder = ResultFolder(out, stage, forbidden)
        with staging.caller():
            yield folder
        versions = versions_here()
        manifest = {
            "schema": SCHEMA,
            "automarine": versions.pop("automarine"),
            "libraries": versions,
            "command": command,
            "options": recorded_options(options),
            "seed": seed,
            "inputs": read,
            "outputs": [{"file": name, "sha256": sha} for name, sha in folder.hashes.items()],
            **({"warnings": folder.warnings} if folder.warnings else {}),
        }
        folder.write_json(MANIFEST, manifest)
        replaced, _ = _inspect(target, out, command, overwrite)  # again: it may have appeared meanwhile
        staging.carry_over(target, stage, leave=replaced)
        staging.put_in_place(stage, target, through=len(folder.hashes) <= MOST_THROUGH)


def recorded_options(options: Mapping[str, object]) -> dict[str, object]:
    """Options as a manifest records them: those that a result depends on, without places on this machine."""
    return {key: _without_place(value) for key, value in options.items() if key not in UNRECORDED}


def refuse_unfit(out: Path) -> None:
    """Raise OutputError for a folder that results can never be written to: rather before the work than after."""
    with staging.one_sentence(out):
        staging.refuse_unfit(Path(os.path.realpath(out)))


def _inspect(target: Path, out: Path, command: str, overwrite: bool) -> tuple[frozenset[str], frozenset[str]]:
    """Names in `target` that the new results replace, and names that they must not use."""
    if not target.is_dir() or not any(target.iterdir()):
        return frozenset(), frozenset()
    manifest = _read_manifest(target / MANIFEST)
    if manifest is None:
        if (target / MANIFEST).exists():
            raise OutputError(f"{out} holds a {MANIFEST} that is not automarine's; choose another folder with -o")
        ours = [path.parent for path in manifests_in(target)]  # results of the steps of a campaign
        there = {
            path.relative_to(target).as_posix()
            for path in target.rglob("*")
            if not any(place == path or place in path.parents for place in ours)
        }
        if len(there) > MOST_FOREIGN:  # a home or a project: not a folder to be replaced by a rename
            raise OutputError(f"{out} holds {len(there)} other files; give a folder inside it with -o")
        return frozenset(), frozenset() if overwrite else frozenset(there)
    if not overwrite:
        raise OutputError(
            f"{out} already holds results of {manifest.get('command', 'automarine')}; "
            "give --overwrite to replace them, or another folder with -o"
        )
    if manifest.get("command") != command:  # the results of another command stay beside the new ones
        return frozenset({MANIFEST}), frozenset()
    outputs = manifest.get("outputs")
    entries = outputs if isinstance(outputs, list) else []
    names = {entry["file"] for entry in entries if isinstance(entry, dict) and isinstance(entry.get("file"), str)}
    return frozenset(names | {MANIFEST}), frozenset()


def _read_manifest(path: Path) -> dict[str, object] | None:
    """The manifest at `path` if it is automarine's, of whatever version."""
    return json.loads(path.read_text(encoding="utf-8")) if is_manifest(path) else None


def _without_place(value: object) -> object:
    """An option as given, but never with a place on this machine: files are told by their last name."""
    if isinstance(value, PurePath | Document):
        return value.name
    if isinstance(value, str) and PurePath(value).is_absolute():
        return PurePath(value).name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _without_place(to_mapping(value))
    if isinstance(value, Mapping):
        return {str(key): _without_place(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_place(one) for one in value]
    return value


def _as_plain(value: object) -> object:
    """numpy numbers and arrays as plain ones; anything else is a defect of the caller."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def _first_not_finite(data: object, place: str = "result") -> str | None:
    """The path of the first NaN or infinity in nested data."""
    if isinstance(data, float):
        return None if math.isfinite(data) else place
    if isinstance(data, Mapping):
        parts = [(f"{place}.{key}", value) for key, value in data.items()]
    elif isinstance(data, (list, tuple)):
        parts = [(f"{place}[{i}]", value) for i, value in enumerate(data)]
    elif hasattr(data, "tolist"):
        return _first_not_finite(data.tolist(), place)
    else:
        return None
    return next((found for key, value in parts if (found := _first_not_finite(value, key))), None)
