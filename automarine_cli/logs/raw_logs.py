"""Files become columns as they stand, whatever their format; what is no file, or holds nothing, is refused."""

import stat
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import groupby

from automarine_cli.errors import LogError
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import Format, Problem, RawLog, format_of, suffixes
from automarine_cli.logs.log_file import LogFile
from automarine_cli.logs.parquet import read_table
from automarine_cli.pipeline.words import listed


def read_raws(files: Sequence[LogFile], columns: Sequence[ColumnMap]) -> list[RawLog | LogError]:
    """The columns of files as they stand, those of one format and one column map together; the refusal of a file that
    is none, or holds nothing, stands in its place."""
    found: list[RawLog | Problem | None] = [_not_there(file) for file in files]
    sound = (i for i, one in enumerate(found) if one is None)
    for (form, _), group in groupby(sound, key=lambda i: (_form(files[i]), id(columns[i]))):
        places = list(group)
        read = partial(_one_by_one, form) if form is None or form.together is None else form.together
        for i, raw in zip(places, read([files[i] for i in places], columns[places[0]])):
            found[i] = raw
    return [_with_rows(raw, file.name) for raw, file in zip(found, files)]


def _form(file: LogFile) -> Format | None:
    """The format of a file; None for a table that is no file."""
    return None if file.content is not None else format_of(file.path.name)


def _one_by_one(form: Format | None, files: Sequence[LogFile], columns: ColumnMap) -> Iterator[RawLog | Problem]:
    for file in files:
        try:
            if file.content is not None:
                yield read_table(file.content, file.name)
            elif form is not None:
                with file.path.open("rb"):  # a file that may not be read is told from one that is not sound
                    pass
                yield form.read(file.path, file.name, columns)
        except (LogError, OSError, MemoryError) as problem:
            yield problem


def _not_there(file: LogFile) -> Problem | None:
    """The refusal of a path that is no file with bytes in it."""
    name, path, form = file.name, file.path, _form(file)
    if file.content is not None:
        return None
    if form is None:
        return LogError(f"{name}: unknown log format; give a file that ends in {', '.join(sorted(suffixes()))}")
    try:
        state = path.stat()
    except FileNotFoundError:
        if path.is_symlink():
            return LogError(
                f"{name}: a broken link; expected a {form.name} file. Copy the log here, or leave the link out"
            )
        state = None
    except OSError as problem:
        return problem
    if state is None or not stat.S_ISREG(state.st_mode):
        folder = state is not None and stat.S_ISDIR(state.st_mode)
        return LogError(
            f"{name}: {'a directory' if folder else 'not a regular file'}; "
            f"expected a {form.name} file. Rename it, or leave it out"
        )
    if state.st_size == 0:
        return LogError(
            f"{name}: the file is empty; expected a {form.name} file with a header and rows. "
            "Copy it again, or leave it out"
        )
    return None


def _with_rows(raw: RawLog | Problem | None, name: str) -> RawLog | LogError:
    """A file with at least one row and each column once, or why it is refused."""
    if isinstance(raw, LogError):
        return raw
    if isinstance(raw, OSError):
        why = raw.strerror or raw
        return LogError(f"{name}: cannot be opened ({why}); check that it exists and that you may read it")
    if not isinstance(raw, RawLog):
        return LogError(f"{name}: does not fit into memory; split it into several logs")
    if len(raw.rows) == 0:
        return LogError(
            f"{name}: a header without rows (columns {listed(raw.names)}); expected at least one row. "
            "Copy the log again, or leave it out"
        )
    twice = [column for column, count in Counter(raw.names).items() if count > 1 and column]
    if twice:
        return LogError(
            f"{name}: {len(twice)} column name{'s' * (len(twice) > 1)} given more than once "
            f"({listed(twice)}); expected each once. Rename or delete one in the header"
        )
    return raw
