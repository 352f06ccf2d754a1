"""Results in a folder appear whole or not at all: filled beside the target, then renamed; old ones stay until then.

While a process writes to `NAME`, it holds a lock in `.NAME.automarine` beside it, and fills the folder `new` in there;
`old` holds the former results between two renames. The lock ends with the process: the next one tidies up what a killed
one left.
"""

import contextlib
import hashlib
import os
import platform
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path, PurePath, PurePosixPath
from typing import NamedTuple

from automarine_cli import __version__
from automarine_cli.errors import OutputError, SettingError, one_sentence
from automarine_cli.pipeline.records import Codec, Source, json_text, plain, read_mapping, schema_in

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MAX_FOREIGN_FILES = 1000  # files of others in a folder that may be replaced by a rename: not a home, not a project
MANIFEST, MANIFEST_SCHEMAS = "manifest.json", "automarine/manifest/"
MANIFEST_SCHEMA = f"{MANIFEST_SCHEMAS}1"
LIBRARIES = ("click", "numpy", "scipy", "pandas", "pyarrow", "matplotlib")


class Input(NamedTuple):
    """A file that a command reads: what results call it, where it is, and as what it was given."""

    name: str
    path: Source
    role: str = "log"  # or hold_out, model, thrusters, columns, specification


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


def read_manifest(path: Path) -> Manifest:
    """Return the manifest at `path`. Raises SettingError with the key's path for one that is not automarine's."""
    data = read_mapping(path)
    if not (schema := str(data.get("schema"))).startswith(MANIFEST_SCHEMAS):
        raise SettingError(f"{path.name}: is no manifest of automarine; expected the {MANIFEST} in a folder of results")
    if schema != MANIFEST_SCHEMA:
        raise SettingError(f"{path.name}: schema is {schema!r}; expected {MANIFEST_SCHEMA!r}, what this version writes")
    return Codec(path.name).read(Manifest, data)


def is_manifest(path: Path) -> bool:
    """Whether there is a file that says it is a manifest of automarine, of whatever version."""
    return schema_in(path).startswith(MANIFEST_SCHEMAS)


def manifest_of(folder: Path) -> Manifest | None:
    """Return the manifest of a folder of results; None where there is none, or none that this version reads."""
    with contextlib.suppress(SettingError):
        return read_manifest(folder / MANIFEST)
    return None


def versions_here() -> dict[str, str]:
    libraries = {name: metadata.version(name) for name in LIBRARIES}
    return {"automarine": __version__, "python": platform.python_version(), **libraries}


def sha256(path: Source) -> str:
    """Return the SHA-256 of a file's content; empty for what cannot be opened, such as a log that was set aside."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return ""


def recorded(
    *, command: str, options: Mapping[str, object], seed: int | None, inputs: Sequence[Input]
) -> dict[str, object]:
    """Return what a manifest says of all that results depend on, without places on this machine."""
    versions = dict(versions_here())
    return {
        "schema": MANIFEST_SCHEMA, "automarine": versions.pop("automarine"), "libraries": versions, "command": command,
        "options": _without_places(plain(options)), "seed": seed,
        "inputs": [{"file": file.name, "role": file.role, "sha256": sha256(file.path) or None} for file in inputs],
    }  # fmt: skip


def _without_places(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_places(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_places(entry) for entry in value]
    return PurePath(value).name if isinstance(value, str) and PurePath(value).is_absolute() else value


class ResultFolder:
    """The folder under construction: everything written here appears together at the end."""

    def __init__(self, out: Path, new: Path, occupied: Path | None) -> None:
        self._out, self._new, self._occupied = out, new, occupied
        self.hashes: dict[str, str] = {}
        self.warnings: list[str] = []

    def write(self, name: str, content: bytes | str | Mapping[str, object]) -> None:
        """Write one file, a mapping as JSON; `name` is relative, with forward slashes. Raises OutputError if the disk
        refuses, or a file of that name that is not ours would be replaced."""
        if {"..", ".", ""} & {*name.split("/")} or "\\" in name or name in self.hashes:
            raise ValueError(f"result file {name!r}: expected a new relative name")
        if self._occupied is not None and (self._occupied / name).exists():
            raise OutputError(f"{self._out} already holds a file {name}; give --overwrite to replace it")
        text = json_text(content) if isinstance(content, Mapping) else content
        data = text.encode("utf-8") if isinstance(text, str) else text
        with one_sentence(self._out):
            (self._new / name).parent.mkdir(parents=True, exist_ok=True)
            (self._new / name).write_bytes(data)
        self.hashes[name] = hashlib.sha256(data).hexdigest()

    def warn(self, sentence: str) -> None:
        """Say in the manifest what could not be made."""
        self.warnings.append(sentence)


@contextlib.contextmanager
def result_folder(
    out: Path, *, command: str, options: Mapping[str, object], inputs: Sequence[Input],
    seed: int | None, overwrite: bool,
) -> Iterator[ResultFolder]:  # fmt: skip
    """Write the results of `command` into the folder `out`, whole or not at all. `inputs` are the files read, each with
    the short name that results use and its role (without one: a log); `options` and `seed` must hold all else that the
    results depend on. On leaving without an error the manifest is added and the whole folder takes the place of the
    former one; what others put there stays. Raises OutputError if `out` holds results and `overwrite` is false, is a
    file, is being written to by another, or cannot be written."""
    refuse_unfit(out)
    target = Path(os.path.realpath(out))
    work = target.with_name(f".{target.name}.automarine")
    new, old = work / "new", work / "old"
    missing = [parent for parent in target.parents if not parent.exists()]
    with one_sentence(out):
        lock = _locked(work, target.name)
    try:
        with one_sentence(out):
            _put_back(old, target)
            for stale in (new, old):
                shutil.rmtree(stale, ignore_errors=True)
            new.mkdir()
            replaced = _replaced(target, out, command, overwrite)
            record = recorded(command=command, options=options, seed=seed, inputs=inputs)
        folder = ResultFolder(out, new, target if not (replaced or overwrite) else None)
        yield folder
        record["outputs"] = [{"file": name, "sha256": sha} for name, sha in sorted(folder.hashes.items())]
        if folder.warnings:
            record["warnings"] = folder.warnings
        with one_sentence(out):
            (new / MANIFEST).write_text(json_text(record), encoding="utf-8")
            _carry_over(target, new, _replaced(target, out, command, overwrite))  # again: it may be there by now
            if target.exists():
                target.rename(old)
            new.rename(target)
    finally:
        _put_back(old, target)
        shutil.rmtree(work, ignore_errors=True)
        os.close(lock)
        for parent in missing:  # those that stay empty
            with contextlib.suppress(OSError):
                parent.rmdir()


def _locked(work: Path, name: str) -> int:
    """Return the open file whose lock lets this process alone write. Raises OutputError while another one does."""
    work.mkdir(parents=True, exist_ok=True)
    lock = os.open(work / "lock", os.O_CREAT | os.O_RDWR)
    with contextlib.suppress(BlockingIOError, FileNotFoundError):
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(lock), (work / "lock").stat()):  # else its owner has just taken it away
            return lock
    os.close(lock)
    raise OutputError(f"another automarine is writing results to {name}; wait until it has ended")


def _put_back(old: Path, target: Path) -> None:
    """Undo the first of two renames where the second was not made."""
    if old.is_dir() and not target.exists():
        old.rename(target)


def _replaced(target: Path, out: Path, command: str, overwrite: bool) -> set[str]:
    """Return the names in `target` that new results replace; none where there are no results. Raises OutputError."""
    if not (target / MANIFEST).exists():
        done = {path.parent for path in target.rglob(MANIFEST) if is_manifest(path)}  # results of steps of a campaign
        count = sum(not done & {path, *path.parents} for path in target.rglob("*"))
        if count > MAX_FOREIGN_FILES:
            raise OutputError(f"{out} holds {count} other files; give a folder inside it with -o")
        return set()
    if (manifest := manifest_of(target)) is None:
        raise OutputError(f"{out} holds a {MANIFEST} of another tool or version (not automarine's); give another -o")
    if not overwrite:
        raise OutputError(
            f"{out} already holds results of {manifest.command}; give --overwrite to replace them, or another folder "
            "with -o"
        )
    # results of another command stay
    return {MANIFEST, *(entry.file for entry in manifest.outputs if manifest.command == command)}


def _carry_over(target: Path, new: Path, replaced: set[str]) -> None:
    """Link (or copy) what `target` holds into `new`, except names in `replaced` and names already there."""

    def leave(folder: str, names: list[str]) -> set[str]:
        inside = Path(folder).relative_to(target)
        return {name for name in names if (inside / name).as_posix() in replaced or (new / inside / name).is_file()}

    def link(source: str, copied: str) -> None:
        try:
            os.link(source, copied)
        except (OSError, NotImplementedError):
            shutil.copy2(source, copied)

    if target.exists():
        shutil.copytree(target, new, symlinks=True, ignore=leave, copy_function=link, dirs_exist_ok=True)


def refuse_unfit(out: Path) -> None:
    """Raise OutputError for a folder that can never be replaced as a whole: rather before the work than after."""
    target, current = Path(os.path.realpath(out)), Path.cwd()
    with one_sentence(out):
        nearest = next(path for path in (target, *target.parents) if path.exists())
        if not nearest.is_dir():
            raise OutputError(f"{nearest.name} is a file; give a folder for the results after -o")
        if target in (current, *current.parents) or os.path.ismount(target):
            raise OutputError(
                f"{target.name or target} is the folder this command runs in (or holds it, or is a mounted disk) "
                "and cannot be replaced as a whole; give a folder inside it, for example -o results"
            )
        if nearest == target and not (os.access(target, os.W_OK) and target.stat().st_mode & 0o222):
            raise OutputError(f"{target.name} is read-only; choose another folder with -o, or allow writing to it")


def refuse_existing(target: Path, *, overwrite: bool) -> None:
    """Raise OutputError for a file that is there already unless `overwrite`, and for a folder."""
    if target.is_dir():
        raise OutputError(f"{target} is a folder; give the name of a file after -o")
    if target.exists() and not overwrite:
        raise OutputError(f"{target} is there already; give --overwrite to replace it, or another name with -o")


def write_whole(target: Path, text: str) -> None:
    """Write one file that stands alone, whole or not at all. Raises OutputError."""
    with one_sentence(target.parent):
        put_whole(target, text)


def put_whole(target: Path, text: str) -> None:
    """Write a file beside its place, to the disk itself, then put it there. Raises OSError, and leaves nothing then."""
    new = target.with_name(f".{target.name}.automarine-new")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with new.open("wb") as file:
            file.write(text.encode("utf-8"))
            file.flush()
            os.fsync(file.fileno())
        new.replace(target)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise
