"""`read_log`: a file of any format becomes a `LogTable` of canonical columns in SI units."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import Motion
from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, RUN, TIMESTAMP, Canonical, foreign, motion_of
from automarine_cli.logs.columns import ColumnMap, ColumnRule
from automarine_cli.logs.find import LogFile
from automarine_cli.logs.formats import RawLog, format_of, suffixes
from automarine_cli.logs.labels import few_words, parts, run_names, states
from automarine_cli.logs.parquet import read_table
from automarine_cli.logs.table import LogTable
from automarine_cli.logs.text import first_not_a_number, first_not_a_timestamp, seconds_of_timestamps
from automarine_cli.pipeline.words import listed, printable, quoted
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class _Use:
    """One quantity taken from one column of the file."""

    canonical: Canonical
    index: int
    rule: ColumnRule


def read_log(
    file: LogFile, columns: ColumnMap | None = None, *, dof: Dof | None, motion: Motion | None = None
) -> LogTable:
    """Read one log of a motion; None: of the motion that its columns show. With a `motion` of several degrees of
    freedom, `dof` among them, the columns of all of them are read.

    Raises LogError with file, row, column, what was found, what was expected and what to do. Columns that a
    command cannot do without are asked for afterwards, with `require`.
    """
    columns = ColumnMap() if columns is None else columns
    raw = _read_raw(file, columns)
    _check_names(raw, file.name)
    if dof is None:
        mapped = (name for name, rule in columns.columns.items() if rule.source in {*raw.names, *raw.also})
        dof = motion_of(raw.names, mapped)
    uses, notes = _assigned(raw, columns, file.name, foreign(dof, motion))
    runs = run_names(raw, columns, file.name)
    used = {raw.names[use.index] for use in uses} | {columns.source_of(name) for name in (RUN, BY)}
    extras: dict[str, Floats] = {}
    for name, array in zip(raw.names, raw.arrays):
        if name and name not in used and pa.types.is_floating(array.type):
            extras[printable(name)] = _finite_or_nan(array.to_numpy(), name, notes)
    moment = next((use.canonical.unit for use in uses if use.canonical.quantity == dof.command), None)
    return LogTable(
        source=file.name,
        columns={use.canonical.quantity: _values(raw, use, file.name) for use in uses},
        rows=raw.rows,
        run_names=runs.names if runs else (),
        run_code=runs.code if runs else None,
        moment_unit=moment,
        units={use.canonical.quantity: use.canonical.unit for use in uses},
        extras=extras,
        names=raw.names,
        notes=(*raw.notes, *notes),
        states=states(raw, columns),
        holds=raw.holds,
        origin=raw.origin,
        parts=parts(raw, columns, file.name),
        words=few_words(raw, {columns.source_of(name) for name in LABELS}),
        dof=dof,
    )


def _read_raw(file: LogFile, columns: ColumnMap) -> RawLog:
    name, path = file.name, file.path
    if file.content is not None:
        return _with_rows(read_table(file.content, name), name)
    form = format_of(path.name)
    if form is None:
        raise LogError(f"{name}: unknown log format; give a file that ends in {', '.join(sorted(suffixes()))}")
    try:
        if path.is_symlink() and not path.exists():
            raise LogError(
                f"{name}: a broken link; expected a {form.name} file. Copy the log here, or leave the link out"
            )
        if not path.is_file():
            raise LogError(
                f"{name}: {'a directory' if path.is_dir() else 'not a regular file'}; "
                f"expected a {form.name} file. Rename it, or leave it out"
            )
        if path.stat().st_size == 0:
            raise LogError(
                f"{name}: the file is empty; expected a {form.name} file with a header and rows. "
                "Copy it again, or leave it out"
            )
        with path.open("rb"):  # a file that may not be read is told from one that is not sound
            pass
        raw = form.read(path, name, columns)
    except OSError as error:
        raise LogError(
            f"{name}: cannot be opened ({error.strerror or error}); check that it exists and that you may read it"
        ) from None
    except MemoryError:
        raise LogError(f"{name}: does not fit into memory; split it into several logs") from None
    return _with_rows(raw, name)


def _with_rows(raw: RawLog, name: str) -> RawLog:
    if len(raw.rows) == 0:
        raise LogError(
            f"{name}: a header without rows (columns {listed(raw.names)}); expected at least one row. "
            "Copy the log again, or leave it out"
        )
    return raw


def _check_names(raw: RawLog, source: str) -> None:
    twice = [name for name, count in Counter(raw.names).items() if count > 1 and name]
    if twice:
        raise LogError(
            f"{source}: {len(twice)} column name{'s' * (len(twice) > 1)} given more than once "
            f"({listed(twice)}); expected each once. Rename or delete one in the header"
        )


def _assigned(raw: RawLog, columns: ColumnMap, source: str, others: frozenset[str]) -> tuple[list[_Use], list[str]]:
    """Which column serves which quantity; rules of the map come before names of the file. By those names `others` are
    not read."""
    own = {name: i for i, name in enumerate(raw.names) if name}
    places = {name: own[column] for name, column in raw.also.items()} | own
    mapped: dict[str, list[_Use]] = {}
    notes: list[str] = []
    for name, rule in columns.columns.items():
        if name in LABELS:
            continue
        canonical = CANONICAL[name]
        if rule.source in places:
            mapped.setdefault(canonical.quantity, []).append(_Use(canonical, places[rule.source], rule))
        else:
            notes.append(f"the column map names {quoted(rule.source)} for {name}; the file has no such column")
    named: dict[str, list[_Use]] = {}
    for name, canonical in CANONICAL.items():
        # a column `time` of plain numbers has no unit: it is not taken as the clock
        if (
            name in places
            and canonical.quantity not in others
            and canonical.quantity not in mapped
            and not (name == "time" and _floats(raw, places[name]))
        ):
            named.setdefault(canonical.quantity, []).append(_Use(canonical, places[name], ColumnRule(name)))
    for quantity, uses in (mapped | named).items():
        if len(uses) > 1:
            both = " and ".join(use.rule.source for use in uses[:2])
            raise LogError(
                f"{source}: columns {both} both hold the {quantity}; expected one. Choose with a line such "
                f'as {uses[0].canonical.name} = "{uses[0].rule.source}" under [columns] in a file and '
                "give it with --columns FILE.toml"
            )
    return [use for uses in (mapped | named).values() for use in uses], notes


def _floats(raw: RawLog, index: int) -> bool:
    return bool(pa.types.is_floating(raw.arrays[index].type))


def _values(raw: RawLog, use: _Use, source: str) -> Floats:
    """One canonical column in SI units, shape (N,)."""
    array, column = raw.arrays[use.index], raw.names[use.index]
    unit = use.canonical.unit if use.rule.unit is None else use.rule.unit
    stamps = use.canonical.quantity == "time" and (unit == TIMESTAMP or pa.types.is_timestamp(array.type))
    if stamps:
        values = seconds_of_timestamps(array) if not _floats(raw, use.index) else None
        factor = 1.0
        if values is None:
            raise LogError(_no_timestamps(raw, use, source))
    elif _floats(raw, use.index):
        values = array.to_numpy()
        factor = use.canonical.factor(unit)
    else:
        row, found = first_not_a_number(array, raw.decimal) if not pa.types.is_timestamp(array.type) else (0, "a time")
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {printable(column)}: found {quoted(found)}, "
            "expected a number. Correct the cell, or leave it empty if the value is missing"
        )
    if (infinite := np.isinf(values)).any():
        raise LogError(
            f"{source}, row {raw.rows[int(np.argmax(infinite))]}, column {printable(column)}: found an infinite value, "
            "expected a finite number. Correct the cell, or leave it empty if the value is missing"
        )
    rule = use.rule
    if rule.scale != 1 or rule.offset != 0:
        values = rule.scale * values + rule.offset
    return values if rule.sign * factor == 1 else rule.sign * factor * values


def _no_timestamps(raw: RawLog, use: _Use, source: str) -> str:
    column = printable(raw.names[use.index])
    if _floats(raw, use.index):
        return (
            f"{source}, column {column}: found numbers, expected timestamps such as "
            f'2024-05-01T12:00:00.5; say their unit with time_s = "{column}" (or time_ms, time_us) under '
            "[columns] in a file and give it with --columns FILE.toml"
        )
    row, found = first_not_a_timestamp(raw.arrays[use.index])
    return (
        f"{source}, row {raw.rows[row]}, column {column}: found {quoted(found)}, expected a timestamp "
        "such as 2024-05-01T12:00:00.5, all with a time zone or all without. Correct the cell"
    )


def _finite_or_nan(values: Floats, name: str, notes: list[str]) -> Floats:
    infinite = np.isinf(values)
    if infinite.any():
        notes.append(f"column {printable(name)}: {int(infinite.sum())} infinite values are treated as missing")
        return np.where(infinite, np.nan, values)
    return values
