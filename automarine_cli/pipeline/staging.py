"""How a folder gets onto the disk at once: filled beside the target, put in place by a rename.

Siblings of the target while process N works: `.NAME.automarine-N-new` is under construction,
`.NAME.automarine-N-old` is the former folder between the two renames of a replacement. A kill at any instant
leaves the old folder, the new one or none under the target's name; the next run puts a stranded old folder
back and clears away what dead processes left.
"""

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from automarine_cli.errors import OutputError


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
        raise OutputError(
            f"results cannot be written to {out}: {reason[:1].lower()}{reason[1:]}; nothing was changed "
            "there. Make room or choose another folder with -o"
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

    Raises OutputError if the target cannot be replaced as a whole.
    """
    _refuse_unfit(target)
    made = [parent for parent in target.parents if not parent.exists()]
    stage = None
    done = False
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _clear_leftovers(target)
        stage = _sibling(target, "new")
        stage.mkdir()
        yield stage
        done = True
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)
        if not done:
            for parent in made:
                with contextlib.suppress(OSError):
                    parent.rmdir()


def carry_over(target: Path, stage: Path, leave: frozenset[str]) -> None:
    """Link (or copy) what `target` holds into `stage`, except names in `leave` and names already there."""
    if not target.is_dir():
        return
    for folder, subfolders, files in os.walk(target, topdown=False):
        inside = Path(folder).relative_to(target)
        links = [name for name in subfolders if (Path(folder) / name).is_symlink()]
        for name in files + links:
            relative = inside / name
            if relative.as_posix() not in leave and not (stage / relative).exists():
                (stage / relative).parent.mkdir(parents=True, exist_ok=True)
                _link_or_copy(Path(folder) / name, stage / relative)
        if not subfolders and not files:
            (stage / inside).mkdir(parents=True, exist_ok=True)
        if (stage / inside).is_dir():
            shutil.copymode(folder, stage / inside)


def put_in_place(stage: Path, target: Path) -> None:
    """Make `stage` the folder `target`; a former folder there goes. On an error the former folder is back."""
    if not target.exists():
        stage.rename(target)
        return
    old = _sibling(target, "old")
    try:
        target.rename(old)
        stage.rename(target)
    except BaseException:
        if old.exists() and not target.exists():
            old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _refuse_unfit(target: Path) -> None:
    nearest = next(path for path in (target, *target.parents) if path.exists())
    if not nearest.is_dir():
        raise OutputError(f"{nearest.name} is a file; expected a folder for the results after -o")
    here = Path.cwd()
    if target == here or target in here.parents or os.path.ismount(target):
        raise OutputError(
            f"{target.name or target} is the folder this command runs in (or holds it, or is a mounted disk) "
            "and cannot be replaced as a whole; give a folder inside it, for example -o results"
        )


def _sibling(target: Path, role: str) -> Path:
    """A name beside `target` that no other process uses."""
    count = 0
    while True:
        suffix = f"-{count}" if count else ""
        path = target.with_name(f".{target.name}.automarine-{os.getpid()}-{role}{suffix}")
        if not path.exists():
            return path
        count += 1


def _clear_leftovers(target: Path) -> None:
    """Put a stranded old folder back and remove what dead processes left beside `target`."""
    prefix = f".{target.name}.automarine-"
    left = [path for path in sorted(target.parent.iterdir()) if path.name.startswith(prefix)]
    for path in left:
        number, _, role = path.name.removeprefix(prefix).partition("-")
        if not number.isdigit():
            continue
        stranded = role.startswith("old") and not target.exists()
        if _is_alive(int(number)):
            if stranded and int(number) != os.getpid():
                raise OutputError(
                    f"another automarine is just replacing {target.name} (see {path.name}); try again"
                )
        elif stranded:
            path.rename(target)
        else:
            shutil.rmtree(path, ignore_errors=True)


def _is_alive(number: int) -> bool:
    if os.name == "nt":  # signal 0 would end the process there; leftovers stay
        return True
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _link_or_copy(source: Path, destination: Path) -> None:
    try:
        os.link(source, destination, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, destination, follow_symlinks=False)
