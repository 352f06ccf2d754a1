"""`read_log`: a file of any format becomes a `LogTable` of canonical columns in SI units."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.dofs.motion import Motion
from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import BY, CANONICAL, LABELS, RUN, TIMESTAMP, Canonical, foreign, motion_of, unit_in
from automarine_cli.logs.cells import decoded, first_not_a_number, first_not_a_stamp, read_stamps
from automarine_cli.logs.columns import ColumnMap, ColumnRule
from automarine_cli.logs.find import ENDINGS, format_of
from automarine_cli.logs.formats import Format, LogFile, RawLog
from automarine_cli.logs.parquet import read_table
from automarine_cli.logs.streams import joined
from automarine_cli.logs.table import LogTable, few_words, split_by, states
from automarine_cli.pipeline.words import listed, printable, quoted
from automarine_cli.quantities import Floats

GIVE_IT = "under [columns] in a file and give it with --columns FILE.toml"
OR_EMPTY = "Correct the cell, or leave it empty if the value is missing"


@dataclass(frozen=True)
class _Use:
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
    columns, source = (columns or ColumnMap()).of(file.path), file.name
    raw = whole_log(file, columns)
    if dof is None:
        mapped = (name for name, rule in columns.columns.items() if rule.source in {*raw.names, *raw.also})
        dof = motion_of(raw.names, mapped)
    uses, notes = _assigned(raw, columns, source, foreign(dof, motion))
    runs = split_by(raw, columns, source, RUN)
    used = {raw.names[use.index] for use in uses} | {columns.source_of(name) for name in (RUN, BY)}
    extras: dict[str, Floats] = {}
    for i, (name, array) in enumerate(zip(raw.names, raw.arrays)):
        if name and name not in used and raw.is_numeric(i):
            values = array.to_numpy()
            if (infinite := np.isinf(values)).any():
                notes.append(f"column {printable(name)}: {int(infinite.sum())} infinite values are treated as missing")
                values = np.where(infinite, np.nan, values)
            extras[printable(name)] = values
    found = {use.canonical.quantity: _values(raw, use, source, notes) for use in uses}
    return LogTable(
        source=source,
        columns=found,
        rows=raw.rows,
        run_names=runs.names if runs else (),
        run_code=runs.code if runs else None,
        moment_unit=next((use.canonical.unit for use in uses if use.canonical.quantity == dof.command), None),
        units={use.canonical.quantity: _unit(use, found[use.canonical.quantity]) for use in uses},
        extras=extras,
        names=raw.names,
        notes=(*raw.notes, *notes),
        states=states(raw, columns),
        holds=raw.holds,
        origin=raw.origin,
        parts=split_by(raw, columns, source, BY),
        words=few_words(raw, {*used, *(columns.source_of(name) for name in LABELS)}),
        dof=dof,
    )


def whole_log(file: LogFile, columns: ColumnMap) -> RawLog:
    """Read the columns of a log and of the files that `columns` joins to it, on its clock. Raises LogError."""
    raw = _read_raw(file, columns)
    for path, join in columns.beside(file.path).items():
        other = LogFile(path, printable(path.name), file.named)
        rules = columns.of(path)
        theirs = _read_raw(other, rules)
        clock = _clock(raw, columns, file.name)
        raw = joined(raw, clock, theirs, _clock(theirs, rules, other.name), (file.name, other.name), columns, join)
    return raw


def _read_raw(file: LogFile, columns: ColumnMap) -> RawLog:
    """The columns of a file as they stand, whatever its format. Raises LogError for what is no file, or holds
    nothing."""
    name, path = file.name, file.path
    try:
        if file.content is not None:
            raw = read_table(file.content, name)
        else:
            form = _format_of_file(path, name)
            with path.open("rb"):  # a file that may not be read is told from one that is not sound
                pass
            raw = form.read(path, name, columns)
    except OSError as problem:
        why = problem.strerror or problem
        raise LogError(f"{name}: cannot be opened ({why}); check that it exists and that you may read it") from None
    except MemoryError:
        raise LogError(f"{name}: does not fit into memory; split it into several logs") from None
    if len(raw.rows) == 0:
        raise LogError(
            f"{name}: a header without rows (columns {listed(raw.names)}); expected at least one row. "
            "Copy the log again, or leave it out"
        )
    if twice := [column for column, count in Counter(raw.names).items() if count > 1 and column]:
        raise LogError(
            f"{name}: {len(twice)} column name{'s' * (len(twice) > 1)} given more than once "
            f"({listed(twice)}); expected each once. Rename or delete one in the header"
        )
    return raw


def _format_of_file(path: Path, name: str) -> Format:
    """The format of a path. Raises LogError where it is no file with bytes in it, OSError where that is not known."""
    form = format_of(path.name)
    if form is None:
        raise LogError(f"{name}: unknown log format; give a file that ends in {ENDINGS}")
    if path.is_symlink() and not path.exists():
        trouble = f"a broken link; expected a {form.name} file. Copy the log here, or leave the link out"
    elif path.is_dir() or not path.is_file():
        what = "a directory" if path.is_dir() else "not a regular file"
        trouble = f"{what}; expected a {form.name} file. Rename it, or leave it out"
    elif path.stat().st_size == 0:
        trouble = (
            f"the file is empty; expected a {form.name} file with a header and rows. Copy it again, or leave it out"
        )
    else:
        return form
    raise LogError(f"{name}: {trouble}")


def _clock(raw: RawLog, columns: ColumnMap, source: str) -> tuple[str, Floats]:
    """The column of times of a file and its seconds. Raises LogError where there is none."""
    uses, _ = _assigned(raw, columns, source, frozenset())
    use = next((use for use in uses if use.canonical.quantity == "time"), None)
    if use is None:
        raise LogError(
            f"{source}: no time, by which it is joined; found the columns {listed(raw.names)}. Name it, such as time_s "
            f'= "NAME", under [[columns_of]] with logs = ["{source.rpartition("/")[2]}"] in the column map'
        )
    return raw.names[use.index], _values(raw, use, source, [])


def _assigned(raw: RawLog, columns: ColumnMap, source: str, others: frozenset[str]) -> tuple[list[_Use], list[str]]:
    """Which column serves which quantity; rules of the map come before names of the file. By those names `others` are
    not read."""
    mapped: dict[str, list[_Use]] = {}
    missing: dict[str, str] = {}
    for name, rule in columns.columns.items():
        if name in LABELS:
            continue
        canonical = CANONICAL[name]
        if rule.source and (place := raw.place(rule.source)) is not None:
            mapped.setdefault(canonical.quantity, []).append(_Use(canonical, place, rule))
        else:
            why = f"the column map names {quoted(rule.source)} for {name}; the file has no such column"
            missing[canonical.quantity] = why
    named: dict[str, list[_Use]] = {}
    for name, canonical in CANONICAL.items():
        if canonical.quantity in others or canonical.quantity in mapped or (place := raw.place(name)) is None:
            continue
        # a column `time` of plain numbers has no unit: it is not taken as the clock
        if name != "time" or not raw.is_numeric(place):
            named.setdefault(canonical.quantity, []).append(_Use(canonical, place, ColumnRule(name)))
    used = mapped | named
    for quantity, uses in used.items():
        if len(uses) > 1:
            both = " and ".join(use.rule.source for use in uses[:2])
            raise LogError(
                f"{source}: columns {both} both hold the {quantity}; expected one. Choose with a line such "
                f'as {uses[0].canonical.name} = "{uses[0].rule.source}" {GIVE_IT}'
            )
    moves = any(dof.position in used for dof in DOFS.values())  # one map may serve runs and thruster tests
    idle = {*used, *(("n", "force") if moves else ())}
    notes = [why for quantity, why in missing.items() if quantity not in idle]
    return [use for uses in used.values() for use in uses], notes


def _unit(use: _Use, values: Floats) -> str:
    """The unit of a column: for a control signal the one that its rule or its name tells; no pulse is negative."""
    unit = use.canonical.unit or use.rule.unit or unit_in(use.rule.source)
    signed = use.rule.subtract == 0.0 and bool(np.any(values < 0) and np.any(values > 0))
    return "" if unit == "us" and use.rule.unit is None and signed else unit


def _values(raw: RawLog, use: _Use, source: str, notes: list[str]) -> Floats:
    """One canonical column in SI units, shape (N,); what to know of its reading goes to the notes."""
    array, column, rule = raw.arrays[use.index], printable(raw.names[use.index]), use.rule
    unit, stamped = rule.unit or use.canonical.unit, pa.types.is_timestamp(array.type)
    factor = 1.0
    if use.canonical.quantity == "time" and (unit == TIMESTAMP or stamped):
        values = _seconds(raw, use, source, notes)
    elif raw.is_numeric(use.index):
        values, factor = array.to_numpy(), use.canonical.factor(unit)
    else:
        row, found = (0, "a time") if stamped else first_not_a_number(array, raw.decimal)
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {column}: found {quoted(found)}, expected a number. {OR_EMPTY}"
        )
    if (infinite := np.isinf(values)).any():
        raise LogError(
            f"{source}, row {raw.rows[int(np.argmax(infinite))]}, column {column}: found an infinite value, "
            f"expected a finite number. {OR_EMPTY}"
        )
    if rule.subtract != 0:
        values = values - rule.subtract
    if rule.sign_from is not None:
        values = np.abs(values) * _signs(raw, use, rule.sign_from, source)
    if rule.scale != 1 or rule.offset != 0:
        values = rule.scale * values + rule.offset
    return values if rule.sign * factor == 1 else rule.sign * factor * values


def _signs(raw: RawLog, use: _Use, rule: ColumnRule, source: str) -> Floats:
    """Which way an unsigned column counts, 1, 0 or -1, shape (N,)."""
    index = raw.place(rule.source)
    if index is None or not raw.is_numeric(index):
        found = "no such column" if index is None else "words in it, expected numbers"
        raise LogError(
            f"{source}: {use.canonical.name} takes its sign from {quoted(rule.source)}; the file has {found}. Correct "
            "sign_from in the column map"
        )
    return rule.sign * np.sign(raw.arrays[index].to_numpy() - rule.subtract)


def _seconds(raw: RawLog, use: _Use, source: str, notes: list[str]) -> Floats:
    """A column of calendar or clock times [s]. Raises LogError where a cell is none, and where nothing says whether
    the day or the month comes first."""
    array, column = raw.arrays[use.index], printable(raw.names[use.index])
    if raw.is_numeric(use.index):
        raise LogError(
            f"{source}, column {column}: found numbers, expected timestamps such as 2024-05-01T12:00:00.5; say their "
            f'unit with time_s = "{column}" (or time_ms, time_us) {GIVE_IT}'
        )
    stamps = read_stamps(array, use.rule.day_first)
    if stamps is None:
        row, found = first_not_a_stamp(array, use.rule.day_first)
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {column}: found {quoted(found)}, expected a timestamp "
            "such as 2024-05-01T12:00:00.5, all with a time zone or all without. Correct the cell"
        )
    if stamps.open:
        text = quoted(decoded(array[0].as_py()))
        raise LogError(
            f"{source}, column {column}: found {text}, in which the day or the month may come first; say which with "
            f'time = {{ from = "{column}", day_first = true }} (or false) {GIVE_IT}'
        )
    if stamps.kind in ("day first", "month first") and use.rule.day_first is None:
        notes.append(f"column {column}: dates are read with the {stamps.kind}")
    return stamps.seconds
