"""`read_log`: a file of any format becomes a `LogTable` of canonical columns in SI units."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import CANONICAL, RUN, TIMESTAMP, Canonical
from automarine_cli.logs.columns import ColumnMap, ColumnRule
from automarine_cli.logs.find import LogFile
from automarine_cli.logs.formats import RawLog, format_of, suffixes
from automarine_cli.logs.table import Floats, LogTable
from automarine_cli.logs.text import decoded, first_not_a_number, first_not_a_timestamp, seconds_of_timestamps
from automarine_cli.pipeline.words import listed, printable, quoted

LONGEST_RUN_NAME = 100  # characters; every row of a log carries the name of its run


@dataclass(frozen=True)
class _Use:
    """One quantity taken from one column of the file."""

    canonical: Canonical
    index: int
    rule: ColumnRule


def read_log(file: LogFile, columns: ColumnMap | None = None) -> LogTable:
    """Read one log.

    Raises LogError with file, row, column, what was found, what was expected and what to do. Columns that a
    command cannot do without are asked for afterwards, with `require`.
    """
    columns = ColumnMap() if columns is None else columns
    raw = _read_raw(file, frozenset({_run_source(columns)}))
    _check_names(raw, file.name)
    uses, notes = _assigned(raw, columns, file.name)
    run_index = _run_column(raw, columns)
    used = {use.index for use in uses} | ({run_index} if run_index is not None else set())
    extras: dict[str, Floats] = {}
    for i, (name, array) in enumerate(zip(raw.names, raw.arrays)):
        if i not in used and name and pa.types.is_floating(array.type):
            extras[printable(name)] = _finite_or_nan(array.to_numpy().copy(), name, notes)
    moment = next((use.canonical.unit for use in uses if use.canonical.quantity == "moment"), None)
    return LogTable(
        source=file.name,
        columns={use.canonical.quantity: _values(raw, use, file.name) for use in uses},
        rows=raw.rows,
        run=None if run_index is None else _run_names(raw, run_index, file.name),
        moment_unit=moment,
        extras=extras,
        names=raw.names,
        notes=tuple(notes),
    )


def _read_raw(file: LogFile, text: frozenset[str]) -> RawLog:
    name, path = file.name, file.path
    form = format_of(path.name)
    if form is None:
        raise LogError(
            f"{name}: not a log by its name; expected one that ends in {', '.join(sorted(suffixes()))}"
        )
    try:
        if path.is_symlink() and not path.exists():
            raise LogError(f"{name}: a link that leads nowhere; expected a {form.name} file")
        if not path.is_file():
            raise LogError(
                f"{name}: {'a directory' if path.is_dir() else 'no regular file'}; "
                f"expected a {form.name} file"
            )
        if path.stat().st_size == 0:
            raise LogError(f"{name}: the file is empty; expected a {form.name} file with a header and rows")
        with path.open("rb"):  # a file that may not be read is told from one that is not sound
            pass
        raw = form.read(path, name, text)
    except OSError as error:
        raise LogError(
            f"{name}: cannot be opened ({error.strerror or error}); check that it exists and "
            "that you may read it"
        ) from None
    except MemoryError:
        raise LogError(f"{name}: does not fit into memory; split it into several logs") from None
    if len(raw.rows) == 0:
        raise LogError(
            f"{name}: a header without rows (columns {listed(raw.names)}); expected at least one row"
        )
    return raw


def _check_names(raw: RawLog, source: str) -> None:
    twice = [name for name, count in Counter(raw.names).items() if count > 1 and name]
    if twice:
        raise LogError(
            f"{source}: {len(twice)} column name{'s' * (len(twice) > 1)} given more than once "
            f"({listed(twice)}); expected each once. Rename or delete one in the header"
        )


def _assigned(raw: RawLog, columns: ColumnMap, source: str) -> tuple[list[_Use], list[str]]:
    """Which column serves which quantity; rules of the map come before names of the file."""
    places = {name: i for i, name in enumerate(raw.names) if name}
    mapped: dict[str, list[_Use]] = {}
    notes: list[str] = []
    for name, rule in columns.columns.items():
        if name == RUN:
            continue
        canonical = CANONICAL[name]
        if rule.source in places:
            mapped.setdefault(canonical.quantity, []).append(_Use(canonical, places[rule.source], rule))
        else:
            notes.append(
                f"the column map names {quoted(rule.source)} for {name}; the file has no such column"
            )
    named: dict[str, list[_Use]] = {}
    for name, canonical in CANONICAL.items():
        # a column `time` of plain numbers has no unit: it is not taken as the clock
        if (
            name in places
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
        values = array.to_numpy().astype(np.float64)
        factor = use.canonical.factor(unit)
    else:
        row, found = (
            first_not_a_number(array, raw.decimal) if not pa.types.is_timestamp(array.type) else (0, "a time")
        )
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {printable(column)}: found {quoted(found)}, "
            "expected a number. Correct the cell, or leave it empty if the value is missing"
        )
    if (bad := np.flatnonzero(np.isinf(values))).size:
        raise LogError(
            f"{source}, row {raw.rows[bad[0]]}, column {printable(column)}: found an infinite value, "
            "expected a finite number. Correct the cell, or leave it empty if the value is missing"
        )
    rule = use.rule
    return rule.sign * factor * (rule.scale * values + rule.offset)


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
        notes.append(
            f"column {printable(name)}: {int(infinite.sum())} infinite values are treated as missing"
        )
        values[infinite] = np.nan
    return values


def _run_source(columns: ColumnMap) -> str:
    return columns.columns[RUN].source if RUN in columns.columns else RUN


def _run_column(raw: RawLog, columns: ColumnMap) -> int | None:
    wanted = _run_source(columns)
    return raw.names.index(wanted) if wanted in raw.names else None


def _run_names(raw: RawLog, index: int, source: str) -> NDArray[np.str_]:
    """The name of each row's run, shape (N,)."""
    array = raw.arrays[index]
    if array.null_count:
        row = int(np.flatnonzero(pc.is_null(array).to_numpy())[0])
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {printable(raw.names[index])}: no run named; "
            "expected the name or number of the run in every row"
        )
    coded: Any = pc.dictionary_encode(array.combine_chunks()) if array.num_chunks > 1 else array.chunk(0)
    coded = coded if pa.types.is_dictionary(coded.type) else pc.dictionary_encode(coded)
    names = [_run_name(value) for value in coded.dictionary.to_pylist()]
    if (long := next((i for i, name in enumerate(names) if len(name) > LONGEST_RUN_NAME), None)) is not None:
        row = int(np.flatnonzero(coded.indices.to_numpy() == long)[0])
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {printable(raw.names[index])}: found {quoted(names[long])} of "
            f"{len(names[long])} characters, expected the name of a run of at most {LONGEST_RUN_NAME}. "
            "Shorten it, or check which column names the runs"
        )
    return np.array(names)[coded.indices.to_numpy()]


def _run_name(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return printable(decoded(value) if isinstance(value, bytes) else str(value))
