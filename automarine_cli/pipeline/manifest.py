"""`manifest.json`: what a folder of results was made from, by what, and the hash of everything in it."""

import contextlib
import dataclasses
import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path, PurePath, PurePosixPath
from typing import NamedTuple

from automarine_cli import __version__
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.records import Document, Source, from_mapping, json_text, read_mapping, to_mapping
from automarine_cli.pipeline.words import listed, printable

MANIFEST, SCHEMA = "manifest.json", "automarine/manifest/1"
LIBRARIES = ("click", "numpy", "scipy", "pandas", "pyarrow", "matplotlib")
# Settings that must not change a result, or that `inputs` says already: never in the manifest.
UNRECORDED = frozenset({"logs", "out", "jobs", "overwrite", "as_json", "json", "progress", "verbose", "quiet"})


class Input(NamedTuple):
    """A file that a command reads: what results call it, where it is, and as what it was given."""

    name: str
    path: Source
    role: str = "log"  # or hold_out, model, thrusters, columns, specification


def given_as(**options: object) -> list[Input]:
    """Return those of the options that are files, each with the option's name as its role."""
    return [Input(printable(path.name), path, role) for role, path in options.items() if isinstance(path, Source)]


@dataclass(frozen=True)
class Entry:
    """One file in a manifest. Inputs have a role; one that could not be read (and was set aside) has no hash."""

    file: str
    sha256: str | None = None
    role: str = ""

    def __post_init__(self) -> None:
        path = PurePosixPath(self.file)
        if not path.parts or path.is_absolute() or ".." in path.parts or "\0" in self.file:
            raise SettingError(f"the file name {self.file!r} leads out of the folder; give a manifest of automarine")


@dataclass(frozen=True)
class Manifest:
    """A manifest as read; `libraries` includes python, `warnings` say what could not be made."""

    schema: str
    automarine: str
    command: str
    libraries: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, object] = field(default_factory=dict)
    seed: int | None = None
    inputs: tuple[Entry, ...] = ()
    outputs: tuple[Entry, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.schema != SCHEMA:
            raise SettingError(f"schema is {self.schema!r}; expected {SCHEMA!r}, what this version writes")


def read_manifest(path: Path) -> Manifest:
    """Return the manifest at `path`. Raises SettingError with the key's path for one that is not automarine's."""
    data = read_mapping(path)
    if not _is_ours(data):
        raise SettingError(f"{path.name}: is no manifest of automarine; expected the {MANIFEST} in a folder of results")
    return from_mapping(Manifest, data, path.name)


def _is_ours(data: object) -> bool:
    return isinstance(data, dict) and str(data.get("schema", "")).startswith("automarine/manifest/")


def is_manifest(path: Path) -> bool:
    """Whether there is a file that says it is a manifest of automarine, of whatever version. Raises OSError."""
    try:
        return path.is_file() and _is_ours(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, RecursionError):
        return False


def manifest_of(folder: Path) -> Manifest | None:
    """Return the manifest of a folder of results; None where there is none, or none that this version reads."""
    try:
        return read_manifest(folder / MANIFEST) if is_manifest(folder / MANIFEST) else None
    except (OSError, SettingError):
        return None


def manifests_in(folder: Path) -> Iterator[Path]:
    yield from filter(is_manifest, sorted(folder.rglob(MANIFEST)))


def versions_here() -> dict[str, str]:
    libraries = {name: metadata.version(name) for name in LIBRARIES}
    return {"automarine": __version__, "python": platform.python_version(), **libraries}


def sha256(path: Source) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_if_readable(path: Source) -> str | None:
    """Return the SHA-256 of a file's content; None for what cannot be opened, such as a log that was set aside."""
    with contextlib.suppress(OSError):
        return sha256(path)
    return None


def recorded(
    command: str, options: Mapping[str, object], seed: int | None, inputs: Sequence[tuple[str, Source] | Input]
) -> dict[str, object]:
    """Return what a manifest says of all that results depend on, without places on this machine."""
    versions, files = dict(versions_here()), [Input(*file) for file in inputs]
    return {
        "schema": SCHEMA, "automarine": versions.pop("automarine"), "libraries": versions, "command": command,
        "options": {key: _without_place(value) for key, value in options.items() if key not in UNRECORDED},
        "seed": seed,
        "inputs": [{"file": one.name, "role": one.role, "sha256": sha256_if_readable(one.path)} for one in files],
    }  # fmt: skip


def _without_place(value: object) -> object:
    if isinstance(value, PurePath | Document):
        return value.name
    if isinstance(value, str):
        return PurePath(value).name if PurePath(value).is_absolute() else value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = to_mapping(value)
    if isinstance(value, Mapping):
        return {str(key): _without_place(entry) for key, entry in value.items()}
    return [_without_place(entry) for entry in value] if isinstance(value, list | tuple) else value


def why_made_again(
    folder: Path, *, command: str, options: Mapping[str, object], seed: int | None, inputs: Sequence[Input]
) -> str | None:
    """Return why `command` must run although there is `folder`; None if that holds what would be made again.

    Looked at are, in this order: whether there is a result, versions, settings, inputs, files that somebody changed.
    """
    then = manifest_of(folder)
    if then is None or then.command != command:
        return "no result yet"
    now = from_mapping(Manifest, json.loads(json_text(recorded(command, options, seed, inputs))), MANIFEST)
    before, here = {"automarine": then.automarine, **then.libraries}, versions_here()
    if odd := _different(before, here):
        return "version: " + listed(f"{n} {before.get(n, 'none')} then, {here.get(n, 'none')} now" for n in odd)
    if odd := _different({**then.options, "seed": then.seed}, {**now.options, "seed": now.seed}):
        return f"settings changed: {listed(odd)}"
    old, new = ({(entry.role, entry.file): entry.sha256 for entry in one.inputs} for one in (then, now))
    odd = [name for (role, name), sha in new.items() if old.get((role, name), sha) != sha]
    odd += [f"{name} (new)" for role, name in new if (role, name) not in old]
    odd += [f"{name} (gone)" for role, name in old if (role, name) not in new]
    if odd:
        return f"inputs changed: {listed(odd)}"
    odd = [entry.file for entry in then.outputs if sha256_if_readable(folder / entry.file) != entry.sha256]
    return f"results changed since they were written: {listed(odd)}" if odd else None


def _different(then: Mapping[str, object], now: Mapping[str, object]) -> list[str]:
    return [key for key in {**then, **now} if then.get(key) != now.get(key)]
