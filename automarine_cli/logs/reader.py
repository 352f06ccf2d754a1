"""`read_log`: a file of any format becomes a `LogTable` of canonical columns in SI units."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import (
    CANONICAL,
    COMMANDS,
    RUN,
    TIMESTAMP,
    Canonical,
    likely_canonical,
    likely_column,
    names_of,
)
from automarine_cli.logs.columns import ColumnMap, ColumnRule
from automarine_cli.logs.find import LogFile
from automarine_cli.logs.formats import RawLog, format_of, suffixes
from automarine_cli.logs.table import Floats, LogTable
from automarine_cli.logs.text import decoded, first_not_a_number, first_not_a_timestamp, seconds_of_timestamps
from automarine_cli.logs.words import listed, printable, quoted


@dataclass(frozen=True)
class _Use:
    """One quantity taken from one column of the file."""

    canonical: Canonical
    index: int
    rule: ColumnRule


def read_log(file: LogFile, columns: ColumnMap | None = None) -> LogTable:
    """Read one log.

    Raises LogError with file, row, column, what was found, what was expected and what to do. Columns that a command
    cannot do without are asked for afterwards, with `require`.
    """
    columns = ColumnMap() if columns is None else columns
    raw = _read_raw(file)
    _check_names(raw, file.name)
    uses, notes = _assigned(raw, columns, file.name)
    run_index = _run_column(raw, columns)
    used = {use.index for use in uses} | ({run_index} if run_index is not None else set())
    extras: dict[str, Floats] = {}
    for i, (name, array) in enumerate(zip(raw.names, raw.arrays)):
        if i not in used and name and pa.types.is_floating(array.type):
            extras[name] = _finite_or_nan(array.to_numpy().copy(), name, notes)
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


def require(table: LogTable, quantities: Sequence[str]) -> None:
    """Refuse a table that lacks one of the quantities (names as in `LogTable.columns`).

    Raises LogError that lists the columns found and says what to write in the `--columns` file.
    """
    for quantity in quantities:
        if quantity not in table.columns:
            raise LogError(_lacking(table, quantity))


def require_yaw(table: LogTable) -> None:
    """Refuse a table that is no yaw log: time, heading, and a moment or both thruster commands."""
    require(table, ("time", "heading"))
    if "moment" not in table.columns and not {"n_port", "n_stbd"} <= set(table.columns):
        one = next((q for q in ("n_port", "n_stbd") if q not in table.columns and
                    {"n_port", "n_stbd"} & set(table.columns)), "moment")
        raise LogError(_lacking(table, one))


def require_thruster(table: LogTable) -> None:
    """Refuse a table that is no thruster test: control signal and force."""
    require(table, ("n", "force"))


def is_thruster_test(table: LogTable) -> bool:
    """Whether the table looks like a thruster test rather than a yaw log."""
    return "heading" not in table.columns and {"n", "force"} <= set(table.columns)


def _read_raw(file: LogFile) -> RawLog:
    name, path = file.name, file.path
    form = format_of(path.name)
    if form is None:
        raise LogError(f"{name}: not a log by its name; expected one that ends in {', '.join(sorted(suffixes()))}")
    try:
        if path.is_symlink() and not path.exists():
            raise LogError(f"{name}: a link that leads nowhere; expected a {form.name} file")
        if not path.is_file():
            raise LogError(f"{name}: {'a directory' if path.is_dir() else 'no regular file'}; "
                           f"expected a {form.name} file")
        if path.stat().st_size == 0:
            raise LogError(f"{name}: the file is empty; expected a {form.name} file with a header and rows")
        raw = form.read(path, name)
    except OSError as error:
        raise LogError(f"{name}: cannot be opened ({error.strerror or error}); check that it exists and "
                       "that you may read it") from None
    except MemoryError:
        raise LogError(f"{name}: does not fit into memory; split it into several logs") from None
    if len(raw.rows) == 0:
        raise LogError(f"{name}: a header without rows (columns {listed(raw.names)}); expected at least one row")
    return raw


def _check_names(raw: RawLog, source: str) -> None:
    twice = [name for name, count in Counter(raw.names).items() if count > 1 and name]
    if twice:
        raise LogError(f"{source}: {len(twice)} column name{'s' * (len(twice) > 1)} given more than once "
                       f"({listed(twice)}); expected each once. Rename or delete one in the header")


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
            notes.append(f"the column map names {quoted(rule.source)} for {name}; the file has no such column")
    named: dict[str, list[_Use]] = {}
    for name, canonical in CANONICAL.items():
        # a column `time` of plain numbers has no unit: it is not taken as the clock
        if name in places and canonical.quantity not in mapped and not (name == "time" and _floats(raw, places[name])):
            named.setdefault(canonical.quantity, []).append(_Use(canonical, places[name], ColumnRule(name)))
    for quantity, uses in (mapped | named).items():
        if len(uses) > 1:
            both = " and ".join(use.rule.source for use in uses[:2])
            raise LogError(f"{source}: columns {both} both hold the {quantity}; expected one. Choose with a line such "
                           f'as {uses[0].canonical.name} = "{uses[0].rule.source}" under [columns] in a file and '
                           "give it with --columns FILE.toml")
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
        row, found = first_not_a_number(array, raw.decimal) if not pa.types.is_timestamp(array.type) else (0, "a time")
        raise LogError(f"{source}, row {raw.rows[row]}, column {printable(column)}: found {quoted(found)}, "
                       "expected a number. Correct the cell, or leave it empty if the value is missing")
    if (bad := np.flatnonzero(np.isinf(values))).size:
        raise LogError(f"{source}, row {raw.rows[bad[0]]}, column {printable(column)}: found an infinite value, "
                       "expected a finite number. Correct the cell, or leave it empty if the value is missing")
    rule = use.rule
    return rule.sign * factor * (rule.scale * values + rule.offset)


def _no_timestamps(raw: RawLog, use: _Use, source: str) -> str:
    column = printable(raw.names[use.index])
    if _floats(raw, use.index):
        return (f'{source}, column {column}: found numbers, expected timestamps such as 2024-05-01T12:00:00.5; '
                f'say their unit with time_s = "{column}" (or time_ms, time_us) under [columns] in a file and give '
                "it with --columns FILE.toml")
    row, found = first_not_a_timestamp(raw.arrays[use.index])
    return (f"{source}, row {raw.rows[row]}, column {column}: found {quoted(found)}, expected a timestamp such as "
            "2024-05-01T12:00:00.5, all with a time zone or all without. Correct the cell")


def _finite_or_nan(values: Floats, name: str, notes: list[str]) -> Floats:
    infinite = np.isinf(values)
    if infinite.any():
        notes.append(f"column {printable(name)}: {int(infinite.sum())} infinite values are treated as missing")
        values[infinite] = np.nan
    return values


def _run_column(raw: RawLog, columns: ColumnMap) -> int | None:
    rule = columns.columns.get(RUN)
    wanted = RUN if rule is None else rule.source
    return raw.names.index(wanted) if wanted in raw.names else None


def _run_names(raw: RawLog, index: int, source: str) -> np.ndarray:
    """The name of each row's run, shape (N,)."""
    array = raw.arrays[index]
    if array.null_count:
        row = int(np.flatnonzero(pc.is_null(array).to_numpy())[0])
        raise LogError(f"{source}, row {raw.rows[row]}, column {printable(raw.names[index])}: no run named; "
                       "expected the name or number of the run in every row")
    coded = pc.dictionary_encode(array).unify_dictionaries()
    values = coded.chunk(0).dictionary.to_pylist() if coded.num_chunks else []
    names = [f"{value:g}" if isinstance(value, float) else printable(decoded(value)) if isinstance(value, (bytes, str))
             else str(value) for value in values]
    codes = np.concatenate([chunk.indices.to_numpy() for chunk in coded.chunks])
    return np.array(names)[codes]


def _lacking(table: LogTable, quantity: str) -> str:
    """The sentence for a quantity that the file does not have."""
    what = {"moment": "yaw moment", "n": "control signal", "n_port": "port thruster command",
            "n_stbd": "starboard thruster command"}.get(quantity, quantity.replace("_", " "))
    expected = " or ".join(names_of(quantity))
    if quantity == "moment":
        expected += ", or n_port and n_stbd"
    free = [name for name in table.names if name and name not in CANONICAL or name == "time"]
    guess = likely_column(quantity, free)
    if guess is not None:
        example = f'{likely_canonical(quantity, guess)} = "{printable(guess)}"'
        hint = f"If {quoted(guess)} is meant, write {example}"
    else:
        hint = f'Write a line such as {names_of(quantity)[0]} = "NAME"'
    missing = [note for note in table.notes if any(f" for {name};" in note for name in names_of(quantity))]
    return (f"{table.source}: no {what}; found the columns {listed(table.names)}; expected {expected}. "
            + "".join(f"{note[0].upper()}{note[1:]}. " for note in missing)
            + f"{hint} under [columns] in a file and give it with --columns FILE.toml")
