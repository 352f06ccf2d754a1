"""`manifest.json`: what a folder of results was made from, by what, and the hash of everything in it."""

import contextlib
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
from automarine_cli.pipeline.records import Codec, Source, json_text, plain, read_mapping, schema_in
from automarine_cli.pipeline.words import listed, printable

MANIFEST, OURS = "manifest.json", "automarine/manifest/"
SCHEMA = f"{OURS}1"
LIBRARIES = ("click", "numpy", "scipy", "pandas", "pyarrow", "matplotlib")


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
    if not str(data.get("schema")).startswith(OURS):
        raise SettingError(f"{path.name}: is no manifest of automarine; expected the {MANIFEST} in a folder of results")
    return Codec(path.name).read(Manifest, data)


def is_manifest(path: Path) -> bool:
    """Whether there is a file that says it is a manifest of automarine, of whatever version."""
    return schema_in(path).startswith(OURS)


def manifest_of(folder: Path) -> Manifest | None:
    """Return the manifest of a folder of results; None where there is none, or none that this version reads."""
    with contextlib.suppress(SettingError):
        return read_manifest(folder / MANIFEST)
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
        "options": _without_places(plain(options)), "seed": seed,
        "inputs": [{"file": one.name, "role": one.role, "sha256": sha256_if_readable(one.path)} for one in files],
    }  # fmt: skip


def _without_places(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_places(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_places(entry) for entry in value]
    return PurePath(value).name if isinstance(value, str) and PurePath(value).is_absolute() else value


def why_made_again(
    folder: Path, *, command: str, options: Mapping[str, object], seed: int | None, inputs: Sequence[Input]
) -> str | None:
    """Return why `command` must run although there is `folder`; None if that holds what would be made again."""
    then = manifest_of(folder)
    if then is None or then.command != command:
        return "no result yet"
    now = Codec(MANIFEST).read(Manifest, json.loads(json_text(recorded(command, options, seed, inputs))))
    before, after = ({"automarine": one.automarine, **one.libraries} for one in (then, now))
    hashes = {entry.file: sha256_if_readable(folder / entry.file) for entry in then.outputs}
    changes = {
        "version": [f"{n} {before.get(n, 'none')} then, {after.get(n, 'none')} now" for n in _changed(before, after)],
        "settings changed": _changed({**then.options, "seed": then.seed}, {**now.options, "seed": now.seed}),
        "inputs changed": _changed(_inputs(then), _inputs(now)),
        "results changed since they were written": _changed({e.file: e.sha256 for e in then.outputs}, hashes),
    }
    return next((f"{what}: {listed(names)}" for what, names in changes.items() if names), None)


def _inputs(manifest: Manifest) -> dict[str, str | None]:
    return {f"{e.file}{'' if e.role == 'log' else f' as {e.role}'}": e.sha256 for e in manifest.inputs}


def _changed(then: Mapping[str, object], now: Mapping[str, object]) -> list[str]:
    """Return the names of what is not the same, and which of them are new or gone."""
    return [
        name + " (new)" * (name not in then) + " (gone)" * (name not in now)
        for name in {**then, **now}
        if name not in then or name not in now or then[name] != now[name]
    ]
