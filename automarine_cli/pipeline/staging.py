"""How a folder gets onto the disk at once: filled beside the target, then the two change places.

Siblings of the target while a process works: `.NAME.automarine-lock`, which only one process holds;
`.NAME.automarine-new`, the folder under construction; and, where the system cannot exchange two folders in one
step, `.NAME.automarine-old`, the former folder between two renames. A kill at any instant leaves the old folder
or the new one under the target's name (or, in that last case, the old one beside it, put back by the next run).
Whoever holds the lock clears away what killed processes left.
"""

import contextlib
import ctypes
import errno
import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from automarine_cli.errors import OutputError
from automarine_cli.pipeline.interrupts import held_back, last_chore
from automarine_cli.pipeline.lock import HeldElsewhereError, held, is_held

ROOM, RIGHT = "Make room, or choose another folder with -o", "Choose a folder that you may write to with -o"
ADVICE = {errno.ENOSPC: ROOM, errno.EDQUOT: ROOM, errno.EROFS: RIGHT, errno.EACCES: RIGHT, errno.EPERM: RIGHT}
AT_FDCWD = -100  # Linux: relative to the working directory
RENAME_EXCHANGE = 2  # Linux, linux/fs.h
RENAME_SWAP = 2  # macOS, sys/stdio.h
TEMPORARY = re.compile(r"\..+\.automarine-(lock|new|old)")


class _CallersError(Exception):
    """Carries an OSError of the caller's own code past `one_sentence`."""


@contextlib.contextmanager
def one_sentence(out: Path) -> Iterator[None]:
    """Trouble with the disk becomes an OutputError; trouble in the caller's own code passes unchanged."""
    try:
        yield
    except _CallersError as wrapped:
        assert wrapped.__cause__ is not None
        raise wrapped.__cause__ from None
    except OSError as problem:
        reason = problem.strerror or type(problem).__name__
        advice = ADVICE.get(problem.errno or 0, "Choose another folder with -o")
        raise OutputError(
            f"results cannot be written to {out}: {reason[:1].lower()}{reason[1:]}; nothing was changed there. {advice}"
        ) from None


@contextlib.contextmanager
def caller() -> Iterator[None]:
    """Marks the part of a `one_sentence` block whose OSErrors are not about the results."""
    try:
        yield
    except OSError as problem:
        raise _CallersError from problem


@contextlib.contextmanager
def staged(target: Path) -> Iterator[Path]:
    """A new empty folder beside `target`; removed on the way out unless it was put in place.

    Nobody else writes to `target` meanwhile. Raises OutputError if somebody does already, or if the target
    cannot be replaced as a whole.
    """
    refuse_unfit(target)
    made = [parent for parent in target.parents if not parent.exists()]
    stage, done = _sibling(target, "new"), False
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with _alone(target):
            try:
                _clear_leftovers(target)
                stage.mkdir()
                with last_chore(partial(_leave, target)):
                    yield stage
                done = True
            finally:
                with held_back():
                    _remove(stage)
    finally:
        if not done:
            for parent in made:
                with contextlib.suppress(OSError):
                    parent.rmdir()


def write(file: Path, data: bytes, *, through: bool) -> None:
    """Write a new file, `through` to the disk itself: then what the disk refuses it refuses now. Raises OSError."""
    with file.open("xb") as stream:
        stream.write(data)
        stream.flush()
        if through:
            os.fsync(stream.fileno())


def carry_over(target: Path, stage: Path, leave: frozenset[str]) -> None:
    """Link (or copy) what `target` holds into `stage`, except names in `leave` and names already there."""
    if not target.is_dir():
        return
    for folder, subfolders, files in os.walk(target, topdown=False, onerror=_refuse):
        inside = Path(folder).relative_to(target)
        if any(TEMPORARY.fullmatch(part) for part in inside.parts):
            continue
        links = [name for name in subfolders if (Path(folder) / name).is_symlink()]
        for name in files + links:
            relative = inside / name
            ours = relative.as_posix() in leave or TEMPORARY.fullmatch(name)
            if not ours and not (stage / relative).exists():
                (stage / relative).parent.mkdir(parents=True, exist_ok=True)
                _link_or_copy(Path(folder) / name, stage / relative)
        if not subfolders and not files:
            (stage / inside).mkdir(parents=True, exist_ok=True)
        if (stage / inside).is_dir():
            shutil.copymode(folder, stage / inside)


def _refuse(problem: OSError) -> None:
    """A folder that is there and cannot be looked into is not passed over: what it holds would be lost."""
    if not isinstance(problem, FileNotFoundError):
        raise problem


def put_in_place(stage: Path, target: Path, *, through: bool) -> None:
    """Make `stage` the folder `target`, at once; a former folder there goes. On an error it is still there.

    With `through` every file was written through to the disk; otherwise the whole disk is told to catch up.
    """
    if not through and hasattr(os, "sync"):
        os.sync()
    sync_folder(stage)
    with held_back():
        if not target.exists():
            stage.rename(target)
        elif not exchanged(stage, target):
            _by_two_renames(stage, target)
    with contextlib.suppress(OSError):  # the results are in place; only a power cut could still undo that
        sync_folder(target.parent)


def _by_two_renames(stage: Path, target: Path) -> None:
    old = _sibling(target, "old")
    try:
        target.rename(old)
        stage.rename(target)
    except BaseException:
        if old.exists() and not target.exists():
            old.rename(target)
        raise
    _remove(old)


def refuse_unfit(target: Path) -> None:
    """Raise OutputError for a target that can never be replaced as a whole."""
    nearest = next(path for path in (target, *target.parents) if path.exists())
    if not nearest.is_dir():
        raise OutputError(f"{nearest.name} is a file; give a folder for the results after -o")
    here = Path.cwd()
    if target == here or target in here.parents or os.path.ismount(target):
        raise OutputError(
            f"{target.name or target} is the folder this command runs in (or holds it, or is a mounted disk) "
            "and cannot be replaced as a whole; give a folder inside it, for example -o results"
        )
    if target.exists() and not (os.access(target, os.W_OK) and target.stat().st_mode & 0o222):
        raise OutputError(f"{target.name} is read-only; choose another folder with -o, or allow writing to this one")


@contextlib.contextmanager
def _alone(target: Path) -> Iterator[None]:
    """Hold the lock of `target`. Raises OutputError if it, or a folder above or in it, is being written to."""
    try:
        with held(_sibling(target, "lock")):
            above = (parent for parent in target.parents if parent.name and is_held(_sibling(parent, "lock")))
            inside = (place for place in _locks_in(target) if is_held(place))
            busy = next(above, None) or next(inside, None)
            if busy is not None:
                raise HeldElsewhereError
            yield
    except HeldElsewhereError:
        raise OutputError(
            f"another automarine is writing results to {target.name} (or to a folder above or in it); "
            "wait until it has ended, or choose another folder with -o"
        ) from None


def _locks_in(target: Path) -> Iterator[Path]:
    for folder, _, files in os.walk(target, onerror=_refuse):
        yield from (Path(folder) / name for name in files if name.endswith(".automarine-lock"))


def _sibling(target: Path, role: str) -> Path:
    return target.with_name(f".{target.name}.automarine-{role}")


def _clear_leftovers(target: Path) -> None:
    """Put a stranded old folder back and remove what killed processes left beside `target`."""
    old = _sibling(target, "old")
    if old.is_dir() and not target.exists():
        old.rename(target)
    _remove(old)
    _remove(_sibling(target, "new"))


def _leave(target: Path) -> None:
    """As if this process had never worked on `target`."""
    _clear_leftovers(target)
    _sibling(target, "lock").unlink(missing_ok=True)


def _remove(folder: Path) -> None:
    """Remove a folder if it is there, also where parts of it are closed to writing."""
    shutil.rmtree(folder, ignore_errors=True)
    if folder.is_dir():
        for here, _, _ in os.walk(folder):
            with contextlib.suppress(OSError):
                Path(here).chmod(stat.S_IRWXU)
        shutil.rmtree(folder, ignore_errors=True)


def sync_folder(folder: Path) -> None:
    """See that the names in a folder outlast a power cut, where the system can do that."""
    if os.name == "nt":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _link_or_copy(source: Path, destination: Path) -> None:
    try:
        os.link(source, destination, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, destination, follow_symlinks=False)


def exchanged(one: Path, other: Path) -> bool:
    """Whether the two paths have changed places in one step, so that nobody ever sees neither; False where system or
    file system cannot do that."""
    first, second = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform.startswith("linux"):
            return library.renameat2(AT_FDCWD, first, AT_FDCWD, second, RENAME_EXCHANGE) == 0
        if sys.platform == "darwin":
            return library.renamex_np(first, second, RENAME_SWAP) == 0
    except (AttributeError, OSError, TypeError):  # a C library that does not know the call, or none at all
        return False
    return False
