"""Logs that are no files: tables in memory, as Python hands them over (pandas, pyarrow, polars, columns by name)."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from automarine_cli.errors import LogError
from automarine_cli.logs.find import LogFile, Logs
from automarine_cli.pipeline.words import printable

TABLES = "a file, a folder, a glob, a DataFrame, columns by name ({'time_s': ...}), or a list of these"


def as_logs(given: object, name: str) -> Logs:
    """Logs as a command takes them: places as they are, each table as one log, called `name` and its number, or as the
    key says where tables are given by name. Raises LogError for what is neither."""
    return tuple(_logs(given, name))


def _logs(given: object, name: str) -> Iterator[str | Path | LogFile]:
    if isinstance(given, str | Path | LogFile):
        yield given
    elif _is_table(given):
        yield _log(given, name)
    elif isinstance(given, Mapping) and given and all(_is_table(one) for one in given.values()):
        for key, table in given.items():
            yield _log(table, str(key))
    elif isinstance(given, Sequence) and not isinstance(given, bytes):
        for number, one in enumerate(given, 1):
            yield from _logs(one, f"{name}_{number:0{len(str(len(given)))}d}")
    else:
        raise LogError(f"{name}: found {type(given).__name__}; give {TABLES}")


def _is_table(given: object) -> bool:
    """Whether it is a table, or columns by name."""
    if isinstance(given, Mapping):
        return bool(given) and not any(isinstance(one, str | Path) or _is_table(one) for one in given.values())
    if not hasattr(given, "__arrow_c_stream__"):
        return False
    import pandas as pd  # here, as logs that are files need none of it

    return not isinstance(given, pd.Series)


def _log(given: object, name: str) -> LogFile:
    """A table as a log. Its place is its content, so that a table given twice is one log."""
    import pandas as pd

    try:
        frame = pd.DataFrame(dict(given)) if isinstance(given, Mapping) else given
        table = pa.table(frame)
        content = pa.BufferOutputStream()
        pq.write_table(table, content)
    except (pa.ArrowException, ValueError, TypeError) as problem:
        raise LogError(
            f"{name}: no table of columns of numbers ({printable(str(problem.args[0])).rstrip('.')}); "
            "give columns of one length, each of numbers, times or texts"
        ) from None
    data = content.getvalue().to_pybytes()
    return LogFile(Path("memory", hashlib.sha256(data).hexdigest()), printable(name), True, data)
