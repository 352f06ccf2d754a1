"""Results in a folder appear whole or not at all: filled beside the target, then renamed; old ones stay until then.

While a process writes to `NAME`, it holds a lock in `.NAME.automarine` beside it, and fills the folder `new` in there;
`old` holds the former results between two renames. The lock ends with the process: the next one tidies up what a killed
one left.
"""

import contextlib
import errno
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from automarine_cli.errors import AutomarineError, OutputError
from automarine_cli.pipeline.manifest import MANIFEST, Input, manifest_of, manifests_in, recorded
from automarine_cli.pipeline.records import Source, json_text
from automarine_cli.pipeline.words import printable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

Made = TypeVar("Made")
Attempt = tuple[Made | None, str]
"""What was made; or None, and a sentence that says why."""

MOST_FOREIGN = 1000  # files of others in a folder that may be replaced by a rename: not a home, not a project


def attempted(failure: str, work: Callable[[], Made]) -> Attempt[Made]:
    """Do what results can do without; `failure` begins the sentence on why there is none."""
    try:
        return work(), ""
    except MemoryError:
        raise
    except Exception as problem:
        kind = "" if isinstance(problem, AutomarineError) else f"{type(problem).__name__}: "
        why = printable(" ".join(f"{kind}{problem}".split()).removesuffix(":"))
        return None, f"{failure} ({why}); everything else was written."


def file_stems(names: Sequence[str]) -> list[str]:
    """Return a safe, distinct part of a file name for each run name (which may hold slashes, blanks, anything)."""
    stems: dict[str, str] = {}  # by lower case: some file systems do not tell A from a
    for name in names:
        stem = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in name).strip(".")[:80] or "run"
        unique, n = stem, 1
        while unique.lower() in stems:
            unique, n = f"{stem}_{n + 1}", n + 1
        stems[unique.lower()] = unique
    return list(stems.values())


class ResultFolder:
    """The folder under construction: everything written here appears together at the end."""

    def __init__(self, out: Path, new: Path, occupied: Path | None) -> None:
        self._out, self._new, self._occupied = out, new, occupied
        self.hashes: dict[str, str] = {}
        self.warnings: list[str] = []

    def write(self, name: str, content: bytes | str) -> None:
        """Write one file; `name` is relative, with forward slashes. Raises OutputError if the disk refuses, or a file
        of that name that is not ours would be replaced."""
        if {"..", ".", ""} & {*name.split("/")} or "\\" in name or name in self.hashes:
            raise ValueError(f"result file {name!r}: expected a new relative name")
        if self._occupied is not None and (self._occupied / name).exists():
            raise OutputError(f"{self._out} already holds a file {name}; give --overwrite to replace it")
        data = content.encode("utf-8") if isinstance(content, str) else content
        with one_sentence(self._out):
            (self._new / name).parent.mkdir(parents=True, exist_ok=True)
            (self._new / name).write_bytes(data)
        self.hashes[name] = hashlib.sha256(data).hexdigest()

    def write_json(self, name: str, data: object) -> None:
        self.write(name, json_text(data))

    def taken(self, attempt: Attempt[Made]) -> Made | None:
        """Return what was `attempted`; where nothing was made None, and the warning is in the manifest."""
        self.warnings += filter(None, attempt[1:])
        return attempt[0]


@contextlib.contextmanager
def result_folder(
    out: Path, *, command: str, options: Mapping[str, object], inputs: Sequence[tuple[str, Source] | Input],
    seed: int | None, overwrite: bool,
) -> Iterator[ResultFolder]:  # fmt: skip
    """Write the results of `command` into the folder `out`, whole or not at all.

    `inputs` are the files read, each with the short name that results use and its role (without one: a log);
    `options` and `seed` must hold all else that the results depend on. On leaving without an error the manifest is
    added and the whole folder takes the place of the former one; what others put there stays. Raises OutputError if
    `out` holds results and `overwrite` is false, is a file, is being written to by another, or cannot be written.
    """
    refuse_unfit(out)
    target = Path(os.path.realpath(out))
    beside = target.with_name(f".{target.name}.automarine")
    new, old = beside / "new", beside / "old"
    missing = [parent for parent in target.parents if not parent.exists()]
    with one_sentence(out):
        lock = _locked(beside, target.name)
    try:
        with one_sentence(out):
            _put_back(old, target)
            for left in (new, old):
                shutil.rmtree(left, ignore_errors=True)
            new.mkdir()
            replaced = _replaced(target, out, command, overwrite)
            record = recorded(command, options, seed, inputs)
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
        shutil.rmtree(beside, ignore_errors=True)
        os.close(lock)
        for parent in missing:  # those that stay empty
            with contextlib.suppress(OSError):
                parent.rmdir()


def _locked(beside: Path, name: str) -> int:
    """Return the open file whose lock lets this process alone write. Raises OutputError while another one does."""
    beside.mkdir(parents=True, exist_ok=True)
    lock = os.open(beside / "lock", os.O_CREAT | os.O_RDWR)
    with contextlib.suppress(BlockingIOError, FileNotFoundError):
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(lock), (beside / "lock").stat()):  # else its owner has just taken it away
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
        ours = {path.parent for path in manifests_in(target)}  # results of the steps of a campaign
        count = sum(not ours & {path, *path.parents} for path in target.rglob("*"))
        if count > MOST_FOREIGN:
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
    target, here = Path(os.path.realpath(out)), Path.cwd()
    with one_sentence(out):
        nearest = next(path for path in (target, *target.parents) if path.exists())
        if not nearest.is_dir():
            raise OutputError(f"{nearest.name} is a file; give a folder for the results after -o")
        if target in (here, *here.parents) or os.path.ismount(target):
            raise OutputError(
                f"{target.name or target} is the folder this command runs in (or holds it, or is a mounted disk) "
                "and cannot be replaced as a whole; give a folder inside it, for example -o results"
            )
        if nearest == target and not (os.access(target, os.W_OK) and target.stat().st_mode & 0o222):
            raise OutputError(f"{target.name} is read-only; choose another folder with -o, or allow writing to it")


@contextlib.contextmanager
def one_sentence(out: Path) -> Iterator[None]:
    """Turn trouble with the disk into an OutputError."""
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or type(problem).__name__
        room = ", or make room" if problem.errno in (errno.ENOSPC, errno.EDQUOT) else ""
        raise OutputError(
            f"results cannot be written to {out}: {reason[:1].lower()}{reason[1:]}; nothing was changed there. "
            f"Choose another folder with -o{room}"
        ) from None


def refuse_existing(target: Path, *, overwrite: bool) -> None:
    """Raise OutputError for a file that is there already unless `overwrite`, and for a folder."""
    if target.is_dir():
        raise OutputError(f"{target} is a folder; give the name of a file after -o")
    if target.exists() and not overwrite:
        raise OutputError(f"{target} is there already; give --overwrite to replace it, or another name with -o")


def write_whole(target: Path, text: str) -> None:
    """Write one file that stands alone beside its place, to the disk itself, then put it there. Raises OutputError."""
    new = target.with_name(f".{target.name}.automarine-new")
    with one_sentence(target.parent):
        target.parent.mkdir(parents=True, exist_ok=True)
        with new.open("wb") as file:
            file.write(text.encode("utf-8"))
            file.flush()
            os.fsync(file.fileno())
        new.replace(target)
