"""`manifest.json`: what a folder of results was made from, by what, and the hash of everything in it."""

import contextlib
import functools
import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from automarine_cli import __version__
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.plain_data import Source
from automarine_cli.pipeline.recipe import from_mapping, read_mapping
from automarine_cli.pipeline.words import printable

MANIFEST = "manifest.json"
SCHEMA = "automarine/manifest/1"
LIBRARIES = ("click", "numpy", "scipy", "pandas", "pyarrow", "matplotlib")


class Input(NamedTuple):
    """A file that a command reads: what results call it, where it is, and as what it was given."""

    name: str
    path: Source
    role: str = "log"  # or hold_out, model, thrusters, columns, specification


def given_as(**options: object) -> list[Input]:
    """Those of the options that are files, each with the option's name as its role."""
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
            raise SettingError(
                f"the file name {self.file!r} leads out of the folder; give a manifest as automarine wrote it"
            )


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

    @property
    def versions(self) -> dict[str, str]:
        """Versions of automarine and of everything below it when the results were made."""
        return {"automarine": self.automarine, **self.libraries}


def read_manifest(path: Path) -> Manifest:
    """The manifest at `path`. Raises SettingError with the key's path for one that is not automarine's."""
    data = read_mapping(path)
    if not str(data.get("schema", "")).startswith("automarine/manifest/"):
        raise SettingError(f"{path.name}: is no manifest of automarine; expected the {MANIFEST} in a folder of results")
    return from_mapping(Manifest, data, path.name)


def versions_here() -> dict[str, str]:
    """Versions of automarine and of everything below it, as `Manifest.versions`."""
    return {"automarine": __version__, "python": platform.python_version(), **dict(_library_versions())}


@functools.cache
def _library_versions() -> tuple[tuple[str, str], ...]:
    return tuple((name, metadata.version(name)) for name in LIBRARIES)


def input_entries(inputs: Sequence[tuple[str, Source] | Input]) -> list[dict[str, object]]:
    """The list under `"inputs"`: name, role and hash of each file read."""
    files = (Input(*one) for one in inputs)
    return [{"file": file.name, "role": file.role, "sha256": sha256_if_readable(file.path)} for file in files]


def sha256(path: Source) -> str:
    """SHA-256 of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_if_readable(path: Source) -> str | None:
    """SHA-256 of a file's content; None for what cannot be opened, such as a log that was set aside for that."""
    with contextlib.suppress(OSError):
        return sha256(path)
    return None


def manifests_in(folder: Path) -> Iterator[Path]:
    """Manifests of automarine in a folder and below it, in name order."""
    found = sorted(folder.rglob(MANIFEST))
    yield from (path for path in found if is_manifest(path))


def is_manifest(path: Path) -> bool:
    """Whether there is a file that says it is a manifest of automarine, of whatever version. Raises OSError."""
    if not path.is_file():
        return False
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return False
    return isinstance(data, dict) and str(data.get("schema", "")).startswith("automarine/manifest/")
