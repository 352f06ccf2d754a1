"""Arguments of the command line become the log files they mean, in an order that never changes."""

import glob
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NoReturn

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import LogFile, format_of, suffix_of, suffixes
from automarine_cli.pipeline.words import printable, quoted

Logs = Sequence[str | Path | LogFile]  # Files, directories and globs, or logs found already


def find_logs(arguments: Logs) -> list[LogFile]:
    """The logs meant by files, directories (searched recursively) and globs; each file once.

    In name order, the files of a folder before the folders in it, whatever the order of the arguments: a shell
    sorts by the rules of the user's language, and results must not depend on that.
    Raises LogError for a file that does not exist or is no log, and for a directory or glob without logs.
    """
    if not arguments:
        raise LogError("no logs given; name log files, directories or quoted globs")
    found: dict[str, LogFile] = {}
    resolved = cache(Path.resolve)  # of folders; most hold many logs
    for argument in arguments:
        for log in [argument] if isinstance(argument, LogFile) else _meant_by(str(argument)):
            key = f"{resolved(log.path.parent)}/{log.path.name}"
            if key not in found or _claim(log) > _claim(found[key]):
                found[key] = log
    return sorted(_told_apart(list(found.values())), key=_place)


def whole_logs(files: Sequence[LogFile], columns: ColumnMap) -> tuple[LogFile, ...]:
    """The logs without the files that `columns` joins to others of them."""
    if not columns.join:
        return tuple(files)
    joined = {_key(path) for file in files for path in _beside(file, columns)}
    return tuple(file for file in files if _key(file.path) not in joined)


def with_joined(files: Sequence[LogFile], columns: ColumnMap) -> list[LogFile]:
    """The logs and the files that `columns` joins to them, each file once."""
    return find_logs([*files, *(LogFile(path, printable(path.name), False) for file in files
                                for path in _beside(file, columns))]) if columns.join else list(files)  # fmt: skip


def _beside(file: LogFile, columns: ColumnMap) -> list[Path]:
    """The files joined to a log, none where one is missing: whoever reads it says so."""
    try:
        return list(columns.beside(file.path))
    except LogError:
        return []


def _key(path: Path) -> str:
    """What tells one file, whatever way it was named."""
    return str(path.parent.resolve() / path.name)


def _claim(log: LogFile) -> tuple[bool, int, str]:
    """Which of two ways to give one file counts: being named itself, then the one that says more."""
    return log.named, len(log.name), log.name


def _place(log: LogFile) -> list[tuple[bool, str]]:
    parts = log.name.split("/")
    return [(True, part) for part in parts[:-1]] + [(False, parts[-1])]


def _meant_by(argument: str) -> list[LogFile]:
    path = Path(argument)
    endings = ", ".join(sorted(suffixes()))
    if path.is_dir():
        logs = list(_inside(path))
        if not logs:
            raise LogError(f"{quoted(argument)}: no logs in this directory; give files that end in {endings}")
        return logs
    if os.path.lexists(path):
        if suffix_of(path.name) is None:
            raise LogError(f"{quoted(path.name)}: unknown log format; give a file that ends in {endings}")
        return [LogFile(path, printable(path.name), named=True)]
    if glob.has_magic(argument):
        return _matching(argument, endings)
    raise LogError(f"{quoted(argument)}: no such file or directory; check the spelling and the folder you are in")


def _inside(folder: Path, prefix: str | None = None) -> Iterator[LogFile]:
    """Logs under a directory; links to directories and hidden files or folders are left out."""
    prefix = folder.resolve().name if prefix is None else prefix
    for here, folders, files in os.walk(folder, onerror=_refuse_closed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        above = Path(here)
        inner = [*([prefix] if prefix else []), *above.relative_to(folder).parts]
        for name in sorted(files):
            if not name.startswith(".") and _begins_as_a_log(path := above / name):
                yield LogFile(path, printable("/".join([*inner, name])), named=False)


def _begins_as_a_log(path: Path) -> bool:
    """Whether a file has the ending of a log and, where others use that too, also a log's first bytes."""
    form = format_of(path.name)
    if form is None or not form.begins or not path.is_file() or not os.access(path, os.R_OK):
        return form is not None
    with path.open("rb") as file:
        first = file.read(max(map(len, form.begins)))
    return not first or first.startswith(form.begins)


def _refuse_closed(problem: OSError) -> NoReturn:
    """Logs in a directory that cannot be listed would be passed over in silence."""
    raise LogError(
        f"{quoted(str(problem.filename))}: the directory cannot be listed ({problem.strerror}), so its logs "
        "would be missed; make it readable, or name the logs that are meant"
    )


def _matching(pattern: str, endings: str) -> list[LogFile]:
    """Logs that match a glob, named from its first folder with a wildcard on; links to folders are not
    followed.
    """
    parts = Path(pattern).parts
    first = next(i for i, part in enumerate(parts) if glob.has_magic(part))
    fixed = Path(*parts[:first])
    try:
        matches = sorted(fixed.glob("/".join(parts[first:])))
    except ValueError:
        raise LogError(f"{quoted(pattern)}: ** stands for whole folders; write **/ and then a name") from None
    logs: list[LogFile] = []
    for path in matches:
        inner = path.relative_to(fixed)
        if any(part.startswith(".") for part in inner.parts):
            continue
        if path.is_dir():
            logs += [] if "**" in pattern else _inside(path, prefix=inner.as_posix())
        elif suffix_of(path.name) is not None:
            logs.append(LogFile(path, printable(inner.as_posix()), named=False))
    if not logs:
        raise LogError(f"{quoted(pattern)}: no logs match; give files that end in {endings}")
    return logs


def _told_apart(logs: list[LogFile]) -> list[LogFile]:
    """Files of one name get the folders above them in front until all names differ."""
    for _ in range(64):
        times = Counter(log.name for log in logs)
        twice = {name for name, count in times.items() if count > 1}
        if not twice:
            break
        logs = [_with_folder(log) if log.name in twice else log for log in logs]
    return logs


def _with_folder(log: LogFile) -> LogFile:
    parts = log.path.resolve().parts
    depth = log.name.count("/") + 2
    return replace(log, name=printable("/".join(parts[-depth:]))) if depth <= len(parts) else log
