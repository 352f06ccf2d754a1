"""Arguments of a command become the logs that they mean, in an order that never changes; the formats of these."""

import glob
import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs.can import CANDUMP
from automarine_cli.logs.can import FORMAT as CAN
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.csv import FORMAT as CSV
from automarine_cli.logs.dataflash import FORMAT as DATAFLASH
from automarine_cli.logs.formats import Format, LogFile
from automarine_cli.logs.parquet import FORMAT as PARQUET
from automarine_cli.logs.ros import FORMAT as ROS
from automarine_cli.logs.tlog import FORMAT as TELEMETRY
from automarine_cli.logs.ulog import FORMAT as ULOG
from automarine_cli.logs.xlsx import FORMAT as EXCEL
from automarine_cli.text import printable, quoted

FORMATS = (CAN, CANDUMP, CSV, DATAFLASH, EXCEL, PARQUET, ROS, TELEMETRY, ULOG)
FORMAT_OF = {suffix: form for form in FORMATS for suffix in form.suffixes}
ENDINGS = ", ".join(sorted(FORMAT_OF))
SAVE_AS = {
    ".mat": "in MATLAB save a table with writetable(T, 'log.csv')",
    **dict.fromkeys((".xls", ".ods"), "save the sheet as .xlsx or .csv"),
}
"""What to do with files of other programs, by how they end."""
Logs = Sequence[str | Path | LogFile]  # Files, directories and globs, or logs found already
TABLES = "a file, a folder, a glob, a DataFrame, columns by name ({'time_s': ...}), or a list of these"


def suffix_of(name: str) -> str | None:
    return max(filter(name.lower().endswith, FORMAT_OF), key=len, default=None)


def stem_of(name: str) -> str:
    return name[: len(name) - len(suffix_of(name) or "")]


def format_of(name: str) -> Format | None:
    return FORMAT_OF.get(suffix_of(name) or "")


def find_logs(arguments: Logs) -> list[LogFile]:
    """Find the logs meant by files, directories (searched recursively) and globs; each file once.

    In name order, whatever the order of the arguments: a shell sorts by the user's language, and results must not
    depend on that. Raises LogError for a file that does not exist or is no log, and for a place without logs."""
    if not arguments:
        raise LogError("no logs given; name log files, directories or quoted globs")
    logs: dict[str, LogFile] = {}
    for argument in arguments:
        for log in [argument] if isinstance(argument, LogFile) else _meant_by(str(argument)):
            key = _key(log.path)  # of two ways to give a file counts the one that names it, then the one that says more
            logs[key] = max(logs.get(key, log), log, key=lambda log: (log.named, len(log.name), log.name))
    for _ in range(64):  # logs of one name get the names of their folders in front
        times = Counter(log.name for log in logs.values())
        if len(times) == len(logs):
            break
        logs = {key: _with_folder(log) if times[log.name] > 1 else log for key, log in logs.items()}
    return sorted(logs.values(), key=_place)


def whole_logs(files: Sequence[LogFile], columns: ColumnMap) -> tuple[LogFile, ...]:
    """The logs without the files that `columns` joins to others of them."""
    joined = {_key(path) for file in files for path in _joined_to(file, columns)}
    return tuple(file for file in files if _key(file.path) not in joined)


def with_joined(files: Sequence[LogFile], columns: ColumnMap) -> list[LogFile]:
    """The logs and the files that `columns` joins to them, each file once."""
    joined = [LogFile(path, printable(path.name), False) for file in files for path in _joined_to(file, columns)]
    return find_logs([*files, *joined]) if columns.join else list(files)


def _joined_to(file: LogFile, columns: ColumnMap) -> list[Path]:
    """The files joined to a log, none where one is missing: whoever reads it says so."""
    try:
        return list(columns.beside(file.path))
    except LogError:
        return []


def _key(path: Path) -> str:
    return str(path.parent.resolve() / path.name)


def _place(log: LogFile) -> list[tuple[bool, str]]:
    parts = log.name.split("/")
    return [(True, part) for part in parts[:-1]] + [(False, parts[-1])]


def _meant_by(argument: str) -> list[LogFile]:
    path = Path(argument)
    if path.is_dir():
        if logs := list(_inside(path)):
            return logs
        raise LogError(f"{quoted(argument)}: no logs in this directory; give files that end in {_endings(path)}")
    if os.path.lexists(path):
        if suffix_of(path.name) is None:
            raise LogError(f"{quoted(path.name)}: unknown log format; give a file that ends in {_endings(path)}")
        return [LogFile(path, printable(path.name), named=True)]
    if glob.has_magic(argument):
        return _matching(argument)
    raise LogError(f"{quoted(argument)}: no such file or directory; check the spelling and the folder you are in")


def _endings(path: Path) -> str:
    """How logs end, and how files of other programs, this one or in this folder, become logs."""
    ends = (inside.suffix.lower() for inside in (path, *path.rglob("*")))
    return "; ".join([ENDINGS, *dict.fromkeys(SAVE_AS[end] for end in ends if end in SAVE_AS)])


def _inside(folder: Path, prefix: str | None = None) -> Iterator[LogFile]:
    """Logs under a directory; links to directories and hidden files or folders are left out."""
    prefix = folder.resolve().name if prefix is None else prefix
    for top, folders, files in os.walk(folder, onerror=_refuse_closed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        inner = [*([prefix] if prefix else []), *Path(top).relative_to(folder).parts]
        for name in sorted(files):
            if not name.startswith(".") and _begins_as_a_log(path := Path(top) / name):
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


def _matching(pattern: str) -> list[LogFile]:
    """Logs that match a glob, named from its first folder with a wildcard on; links to folders are not followed."""
    parts = Path(pattern).parts
    first = next(i for i, part in enumerate(parts) if glob.has_magic(part))
    fixed = Path(*parts[:first])
    try:
        matches = sorted(fixed.glob("/".join(parts[first:])))
    except ValueError:
        raise LogError(f"{quoted(pattern)}: ** stands for whole folders; write **/ and then a name") from None
    logs: list[LogFile] = []
    for path, inner in ((path, path.relative_to(fixed)) for path in matches):
        if any(part.startswith(".") for part in inner.parts):
            continue
        if path.is_dir():
            logs += [] if "**" in pattern else _inside(path, prefix=inner.as_posix())
        elif suffix_of(path.name) is not None:
            logs.append(LogFile(path, printable(inner.as_posix()), named=False))
    if not logs:
        raise LogError(f"{quoted(pattern)}: no logs match; give files that end in {ENDINGS}")
    return logs


def _with_folder(log: LogFile) -> LogFile:
    parts = log.path.resolve().parts
    depth = log.name.count("/") + 2
    return replace(log, name=printable("/".join(parts[-depth:]))) if depth <= len(parts) else log


def as_logs(logs: object, name: str) -> Logs:
    """Take places as they are, and each table in memory (pandas, pyarrow, polars, columns by name) as one log, called
    `name` and its number, or by its key. Raises LogError for what is neither."""
    if isinstance(logs, str | Path | LogFile):
        return (logs,)
    if _is_table(logs):
        return (_log(logs, name),)
    if isinstance(logs, Mapping) and logs and all(map(_is_table, logs.values())):
        return tuple(_log(table, str(key)) for key, table in logs.items())
    if isinstance(logs, Sequence) and not isinstance(logs, bytes):
        names = (f"{name}_{number:0{len(str(len(logs)))}d}" for number in range(1, len(logs) + 1))
        return tuple(log for part, name in zip(logs, names) for log in as_logs(part, name))
    raise LogError(f"{name}: found {type(logs).__name__}; give {TABLES}")


def _is_table(data: object) -> bool:
    if isinstance(data, Mapping):
        return bool(data) and not any(isinstance(part, str | Path) or _is_table(part) for part in data.values())
    if not hasattr(data, "__arrow_c_stream__"):
        return False
    import pandas as pd  # here, as logs that are files need none of it

    return not isinstance(data, pd.Series)


def _log(table: object, name: str) -> LogFile:
    """A table as a log. Its place is its content, so that a table given twice is one log."""
    import pandas as pd

    content = pa.BufferOutputStream()
    try:
        pq.write_table(pa.table(pd.DataFrame(dict(table)) if isinstance(table, Mapping) else table), content)
    except (pa.ArrowException, ValueError, TypeError) as problem:
        raise LogError(
            f"{name}: no table of columns of numbers ({printable(str(problem.args[0])).rstrip('.')}); "
            "give columns of one length, each of numbers, times or texts"
        ) from None
    data = content.getvalue().to_pybytes()
    return LogFile(Path("memory", hashlib.sha256(data).hexdigest()), printable(name), True, data)
