"""A file of any format becomes a `LogTable` of canonical columns in SI units; and what commands ask of one."""

import re
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, YAW, Dof, Motion
from automarine_cli.errors import LogError
from automarine_cli.logs import columns as naming
from automarine_cli.logs import formats
from automarine_cli.logs.columns import BY, CANONICAL, LABELS, RUN, THRUSTERS, Canonical, ColumnMap, ColumnRule
from automarine_cli.logs.find import ENDINGS, format_of
from automarine_cli.logs.formats import LOGGED, CommandOrigin, Format, LogFile, RawLog
from automarine_cli.logs.parquet import read_table
from automarine_cli.logs.streams import joined
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.text import listed, printable, quoted


@dataclass(frozen=True)
class Labels:
    """A column of words: `names` in order of appearance, `code` (N,) which each row has (-1: none)."""

    names: tuple[str, ...]
    code: NDArray[np.int64]


@dataclass(frozen=True)
class LogTable:
    """One log file, read: `columns` of canonical quantities in SI units, (N,) each, NaN where missing; positions wrap
    as logged, control signals keep the file's unit. `units` tell newtons from a normalised force; `extras` are other
    columns of numbers under the file's names, `names` all columns, `rows` 1-based numbers in the file. `labels` are the
    columns of `LABELS`, `words` others of few words; `holds` and `origin` as in `RawLog`."""

    source: str
    columns: Mapping[str, Floats]
    rows: NDArray[np.int64]
    labels: Mapping[str, Labels] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    dof: Dof = field(kw_only=True)
    extras: Mapping[str, Floats] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    holds: tuple[str, ...] = ()
    origin: CommandOrigin = LOGGED
    words: Mapping[str, Labels] = field(default_factory=dict)

    @property
    def run(self) -> NDArray[np.str_] | None:
        """The name of each row's run, shape (N,), or None where the file is one run."""
        runs = self.labels.get(RUN)
        return None if runs is None else np.array(runs.names)[runs.code]

    @property
    def moment_unit(self) -> str:
        return self.units.get(self.dof.command, "")

    def __len__(self) -> int:
        return len(self.rows)


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
    """Read one log of a motion (None: that its columns show), or of a `motion` of several degrees of freedom. Raises
    LogError with file, row, column, what was found, what was expected and what to do; see also `require`."""
    columns, source = (columns or ColumnMap()).of(file.path), file.name
    raw = whole_log(file, columns)
    if dof is None:
        mapped = (name for name, rule in columns.columns.items() if rule.source in {*raw.names, *raw.also})
        dof = naming.motion_of(raw.names, mapped)
    foreign = naming.foreign(dof, motion, naming.quantities_of((*raw.names, *columns.columns)))
    uses, notes = _assigned(raw, columns, source, foreign)
    used = {raw.names[use.index] for use in uses} | {columns.source_of(name) for name in (RUN, BY)}
    used |= {raw.names[index] for use in uses for name in use.rule.sources if (index := raw.place(name)) is not None}
    extras: dict[str, Floats] = {}
    for i, (name, array) in enumerate(zip(raw.names, raw.arrays)):
        if name and name not in used and raw.is_numeric(i):
            values = array.to_numpy()
            extras[printable(name)] = np.where(np.isinf(values), np.nan, values)
    values_of = {use.canonical.quantity: _values(raw, use, source, notes) for use in uses}
    units = {use.canonical.quantity: _unit(use, values_of[use.canonical.quantity]) for use in uses}
    quantities = values_of.keys()
    if dof is YAW and "rudder" in quantities and dof.command not in quantities and not naming.driven(dof, quantities):
        # nothing else turns it: the rudder is the command; in the plane it acts beside none
        values_of[dof.command] = values_of["rudder"] * (1.0 if motion is None else 0.0)
        units[dof.command] = STEERED if motion is None else dof.units.forces[1]
        if line := likely_line(raw.names, dof.command):
            notes.append(f"the rudder is all that steers. If a column is a moment beside it, write {line} {GIVE_IT}")
    if dof in naming.FLAT_FINNED:
        if naming.ELEVATOR in quantities:
            values_of["rudder"] = values_of.pop(naming.ELEVATOR)
        elif line := likely_line(raw.names, naming.ELEVATOR):
            notes.append(f"no fin turns it. If a column is the angle of one, write {line} {GIVE_IT}")
    words = categorical_columns(raw, {*used, *(columns.source_of(name) for name in LABELS)})
    return LogTable(
        source, values_of, raw.rows, labels_of(raw, columns, source), units, extras, raw.names, (*raw.notes, *notes),
        raw.holds, raw.origin, words, dof=dof,
    )  # fmt: skip


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
    """The columns of a file as they stand. Raises LogError for what is no file, or holds nothing."""
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
            f"{name}: {len(twice)} column name{'s' if len(twice) > 1 else ''} given more than once "
            f"({listed(twice)}); expected each once. Rename or delete one in the header"
        )
    return raw


def _format_of_file(path: Path, name: str) -> Format:
    """The format of a path. Raises LogError where it is no file with bytes in it, OSError where that is not known."""
    form = format_of(path.name)
    if form is None:
        raise LogError(f"{name}: unknown log format; give a file that ends in {ENDINGS}")
    if path.is_file() and path.stat().st_size:
        return form
    troubles = (
        ("a broken link", "Copy the log here", path.is_symlink() and not path.exists()),
        ("a directory", "Rename it", path.is_dir()),
        ("the file is empty", "Copy it again", path.is_file()),
        ("not a regular file", "Rename it", True),
    )
    trouble, mend = next((trouble, mend) for trouble, mend, applies in troubles if applies)
    raise LogError(f"{name}: {trouble}; expected a {form.name} file. {mend}, or leave it out")


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


def _assigned(raw: RawLog, columns: ColumnMap, source: str, foreign: frozenset[str]) -> tuple[list[_Use], list[str]]:
    """Which column serves which quantity; rules of the map come before names of the file that are not `foreign`."""
    mapped: dict[str, list[_Use]] = {}
    missing: dict[str, str] = {}
    for name, rule in columns.columns.items():
        if name in LABELS:
            continue
        canonical = CANONICAL[name]
        places = [raw.place(column) for column in rule.sources]
        if (place := places[0]) is not None and None not in places:
            mapped.setdefault(canonical.quantity, []).append(_Use(canonical, place, rule))
        else:
            lost = rule.sources[places.index(None)]
            why = f"the column map names {quoted(lost)} for {name}; the file has no such column"
            missing[canonical.quantity] = why
    by_name: dict[str, list[_Use]] = {}
    for name, canonical in CANONICAL.items():
        if name in foreign or canonical.quantity in mapped or (place := raw.place(name)) is None:
            continue
        # a column `time` of plain numbers has no unit: it is not taken as the clock
        if name != "time" or not raw.is_numeric(place):
            by_name.setdefault(canonical.quantity, []).append(_Use(canonical, place, ColumnRule(name)))
    used = mapped | by_name
    for quantity, uses in used.items():
        if len(uses) > 1:
            names = " and ".join(use.rule.source for use in uses[:2])
            raise LogError(
                f"{source}: columns {names} both hold the {quantity}; expected one. Choose with a line such "
                f'as {uses[0].canonical.name} = "{uses[0].rule.source}" {GIVE_IT}'
            )
    moves = any(dof.position in used for dof in DOFS.values())  # one map may serve runs and thruster tests
    idle = {*used, *(("n", "force") if moves else ())}
    notes = [why for quantity, why in missing.items() if quantity not in idle]
    return [use for uses in used.values() for use in uses], notes


def _unit(use: _Use, values: Floats) -> str:
    """The unit of a column: for a control signal the one that its rule or its name tells; no pulse is negative."""
    unit = use.canonical.unit or use.rule.unit or naming.unit_in(use.rule.source)
    signed = use.rule.subtract == 0.0 and bool(np.any(values < 0) and np.any(values > 0))
    return "" if unit == "us" and use.rule.unit is None and signed else unit


def _refusal(raw: RawLog, use: _Use, source: str, row: int, text: str, expected: str) -> LogError:
    column = printable(raw.names[use.index])
    return LogError(f"{source}, row {raw.rows[row]}, column {column}: found {text}, expected {expected}")


def _values(raw: RawLog, use: _Use, source: str, notes: list[str]) -> Floats:
    """One canonical column in SI units, shape (N,); what to know of its reading goes to the notes."""
    array, rule = raw.arrays[use.index], use.rule
    unit, stamped, factor = rule.unit or use.canonical.unit, pa.types.is_timestamp(array.type), 1.0
    if use.canonical.quantity == "time" and (unit == naming.TIMESTAMP or stamped):
        values = _seconds(raw, use, source, notes)
    elif raw.is_numeric(use.index):
        values, factor = array.to_numpy(), use.canonical.factor(unit)
    else:
        row, text = (0, "a time") if stamped else formats.first_not_a_number(array, raw.decimal)
        raise _refusal(raw, use, source, row, quoted(text), f"a number. {OR_EMPTY}")
    if (infinite := np.isinf(values)).any():
        row = int(np.argmax(infinite))
        raise _refusal(raw, use, source, row, "an infinite value", f"a finite number. {OR_EMPTY}")
    values = values - rule.subtract
    if (other := rule.sign_from) is not None:
        index = raw.place(other.source)
        if index is None or not raw.is_numeric(index):
            trouble = "no such column" if index is None else "words in it, expected numbers"
            raise LogError(
                f"{source}: {use.canonical.name} takes its sign from {quoted(other.source)}; the file has {trouble}. "
                "Correct sign_from in the column map"
            )
        values = np.abs(values) * other.sign * np.sign(raw.arrays[index].to_numpy() - other.subtract)
    values = rule.scale * values
    for part in rule.plus:
        values = values + part.scale * (_numbers(raw, part.source, source) - part.subtract)
    values = rule.sign * factor * (values + rule.offset)
    for name in rule.times:
        values = values * _numbers(raw, name, source)
    return values


def _numbers(raw: RawLog, name: str, source: str) -> Floats:
    """Another column that a rule takes, in its own unit, shape (N,). Raises LogError for words and infinite values."""
    index = raw.place(name)
    assert index is not None  # else the rule does not apply: see `_assigned`
    return _values(raw, _Use(CANONICAL["n"], index, ColumnRule(name)), source, [])


def _seconds(raw: RawLog, use: _Use, source: str, notes: list[str]) -> Floats:
    """A column of calendar or clock times [s]. Raises LogError where a cell is none, or day and month are open."""
    array, column = raw.arrays[use.index], printable(raw.names[use.index])
    if raw.is_numeric(use.index):
        raise LogError(
            f"{source}, column {column}: found numbers, expected timestamps such as 2024-05-01T12:00:00.5; say their "
            f'unit with time_s = "{column}" (or time_ms, time_us) {GIVE_IT}'
        )
    stamps = formats.read_stamps(array, use.rule.day_first)
    if stamps is None:
        row, text = formats.first_not_a_stamp(array, use.rule.day_first)
        stamp = "a timestamp such as 2024-05-01T12:00:00.5, all with a time zone or all without. Correct the cell"
        raise _refusal(raw, use, source, row, quoted(text), stamp)
    if stamps.open:
        text = quoted(formats.decoded(array[0].as_py()))
        raise LogError(
            f"{source}, column {column}: found {text}, in which the day or the month may come first; say which with "
            f'time = {{ from = "{column}", day_first = true }} (or false) {GIVE_IT}'
        )
    if stamps.kind in ("dates, day first", "dates, month first") and use.rule.day_first is None:
        notes.append(f"column {column}: {stamps.kind}")
    return stamps.seconds


def columns_of(table: LogTable, first: int, stop: int) -> dict[str, Floats | list[str]]:
    """Return rows `first` to `stop - 1` under the canonical names (in degrees, in the unit of the moment or force, else
    in SI units), then every other column, then mode and arming."""
    rows = slice(first, stop)
    columns: dict[str, Floats | list[str]] = {}
    for quantity in dict.fromkeys(canonical.quantity for canonical in CANONICAL.values()):
        if quantity in table.columns and not (quantity == table.dof.command and table.moment_unit == STEERED):
            command = quantity == table.dof.command
            names = [n for n in naming.names_of(quantity) if not command or CANONICAL[n].unit == table.moment_unit]
            name = next((n for n in names if "_deg" in n or command), None)
            name = name or next(n for n in names if CANONICAL[n].factor() == 1)
            plain = table.columns[quantity][rows] / CANONICAL[name].factor()
            columns[name] = np.round(plain, 9) if "_deg" in name else plain  # radians and back leave rounding behind
    columns |= {name: c[rows] for name, c in table.extras.items() if name not in CANONICAL and name not in LABELS}
    for name in (naming.MODE, naming.ARMED):
        if labels := table.labels.get(name):
            words = [*labels.names, ""]
            columns[name] = [words[code] for code in labels.code[rows]]
    return columns


def csv_text(columns: Mapping[str, Floats | Sequence[str]], comment: str) -> str:
    """Return the columns as CSV behind a line of comment: every digit that a number has, a missing one empty."""
    import pandas as pd  # here, as whoever only reads logs needs none of it

    frame, number = pd.DataFrame(dict(columns)), lambda value: repr(float(value)).removesuffix(".0")
    return f"# {comment}\n" + frame.to_csv(index=False, lineterminator="\n", float_format=number)


MAX_NAMES, MIN_ROWS = 40, 3  # of a column of words that may split a table, and the rows of a name on the mean
RUN_WORDS = {"run", "trial", "test", "session", "series", "experiment"}
PART_WORDS = {"thruster", "motor", "propeller", "unit", "serial", "name", "label", "id"}


def labels_of(raw: RawLog, columns: ColumnMap, source: str) -> dict[str, Labels]:
    """Return the columns of `LABELS`. Raises LogError with the row for an empty cell of what names runs or parts."""
    labels = {}
    for label in LABELS:
        if (index := raw.place(columns.source_of(label))) is None:
            continue
        array, column = raw.arrays[index], printable(raw.names[index])
        if label in (RUN, BY) and array.null_count:
            row = raw.rows[int(np.flatnonzero(pc.is_null(array).to_numpy())[0])]
            raise LogError(
                f"{source}, row {row}, column {column}: nothing named; expected a name in every row. Complete it"
            )
        labels[label] = _labels(array)
    return labels


def categorical_columns(raw: RawLog, used: Container[str]) -> dict[str, Labels]:
    """Columns of words that may name runs or parts: MIN_ROWS rows a name, two to MAX_NAMES names; none in `used`."""
    columns = {} if raw.holds else {name: c for name, c in zip(raw.names, raw.arrays) if name and name not in used}
    return {
        printable(name): _labels(array)
        for name, array in columns.items()
        if not (pa.types.is_floating(array.type) or pa.types.is_timestamp(array.type) or array.null_count)
        and 2 <= pc.count_distinct(array).as_py() <= min(MAX_NAMES, len(array) // MIN_ROWS)
    }


def splitting(names: Iterable[str], bollard: bool) -> dict[str, str]:
    """Return the line of a column map for the first column of few words whose name says what it splits by."""
    key, called = (BY, PART_WORDS) if bollard else (RUN, RUN_WORDS)
    return next(({key: name} for name in names if set(re.findall("[a-z]+", name.lower())) & called), {})


def _labels(array: pa.ChunkedArray) -> Labels:
    coded: Any = pc.dictionary_encode(array).unify_dictionaries().combine_chunks()
    coded = coded if isinstance(coded, pa.Array) else coded.chunk(0)
    words = [_word(value) for value in coded.dictionary.to_pylist()]
    # 7 and 7.0 are one name
    places = {name: i for i, name in enumerate(dict.fromkeys(word for word in words if word is not None))}
    code = np.array([-1 if word is None else places[word] for word in [*words, None]], dtype=np.int64)
    return Labels(tuple(places), code[pc.fill_null(coded.indices, -1).to_numpy()])


def _word(value: object) -> str | None:
    if isinstance(value, float):
        return None if value != value else str(int(value)) if value.is_integer() else str(value)
    return printable(formats.decoded(value) if isinstance(value, bytes) else str(value))


def require(table: LogTable, quantities: Sequence[str], alternative: str = "") -> None:
    """Raise LogError for a table that lacks one of the quantities, with what to write in a column map; `alternative` is
    a sentence on what else would serve."""
    lacking = [quantity for quantity in quantities if quantity not in table.columns]
    if not lacking:
        return
    missing = f"{table.source}: no {' and '.join(map(naming.called, lacking))}"
    if table.origin.why_not and set(lacking) & {dof.command for dof in DOFS.values()}:
        raise LogError(f"{missing}; {table.origin.why_not}")
    lines = [line for quantity in lacking if (line := likely_line(table.names, quantity))]
    hint = " and ".join(lines or [f'{naming.names_of(lacking[0])[0]} = "NAME"'])
    holds = f" in a file that holds {listed(table.holds)}" if table.holds else ""
    raise LogError(
        f"{missing}; found the columns {listed(table.names)}{holds}; expected {'; '.join(map(_expected, lacking))}. "
        + "".join(f"{note[0].upper()}{note[1:]}. " for note in _unmet(table, lacking))
        + alternative
        + (_meant_for(table, lacking) or f"If a column of another name is meant, write {hint} {GIVE_IT}")
    )


def _unmet(table: LogTable, quantities: Sequence[str]) -> list[str]:
    """What the column map names for these quantities and the file does not have."""
    names = [name for quantity in quantities for name in naming.names_of(quantity)]
    return [note for note in table.notes if any(f" for {name};" in note for name in names)]


def is_let_go(table: LogTable) -> bool:
    """Tell whether no column of a log is, or may be meant as, a command: then nobody drove the vehicle."""
    dof, quantities = table.dof, table.columns.keys() | naming.quantities_of(table.names)
    possible = {*THRUSTERS, "rudder", *(other.command for other in DOFS.values())}
    required, free = (dof.command, *dof.thrusters), _free(table.names)
    unknown = not (quantities & possible or table.origin.why_not or _unmet(table, required))
    return unknown and not any(naming.likely_column(quantity, free) for quantity in required)


def require_motion(table: LogTable, commanded: bool = True) -> None:
    """Refuse a table without time, position (or velocity), or, if it has to be `commanded`, command of its motion."""
    dof, free = table.dof, _free(table.names)
    by_name = naming.likely_column(dof.position, free) is None and naming.likely_column(dof.velocity, free) is not None
    velocity = dof.position not in table.columns and (dof.velocity in table.columns or by_name)
    by_thrusters = dof.command not in table.columns and {*dof.thrusters} & set(table.columns)
    commands = dof.thrusters if by_thrusters else (dof.command,) if commanded and not dof.restoring else ()
    require(table, ("time", dof.velocity if velocity else dof.position, *commands))


def require_thruster(table: LogTable) -> None:
    require(table, ("n", "force"))


def is_thruster_test(table: LogTable) -> bool:
    return means_thruster_test(table.columns.keys(), table.names, table.dof)


def means_thruster_test(quantities: Set[str], names: Sequence[str], dof: Dof) -> bool:
    """Tell whether a log of these quantities, in columns of these names, is or seems meant as a thruster test."""
    commanded = dof.command in quantities or naming.driven(dof, quantities)
    if dof.position in quantities or (dof.velocity in quantities and commanded):
        return False
    free = _free(names)
    return "force" in quantities or (
        naming.likely_column("force", free) is not None and naming.likely_column(dof.position, free) is None
    )


def likely_line(names: Sequence[str], quantity: str) -> str:
    """Return the line of a column map for the column of these `names` that may be meant by a quantity, empty where
    none is; pulses to thrusters rest at 1500 us."""
    column = naming.likely_column(quantity, _free(names))
    if column is None:
        return ""
    key, name = naming.likely_canonical(quantity, column), printable(column)
    pulses = quantity in THRUSTERS and naming.unit_in(column) == "us"
    return f'{key} = {{ from = "{name}", subtract = 1500 }}' if pulses else f'{key} = "{name}"'


def _meant_for(table: LogTable, lacking: Sequence[str]) -> str:
    """What the table is instead, and the command that reads it; empty where its columns make no whole log."""
    if set(lacking) == {"time"}:
        return ""
    quantities = naming.quantities_of(table.names)
    for dof in naming.motions_in(quantities):
        return f"This is a log of {dof.name}: give it to automarine fit-{dof.name}"
    return "This is a thruster test: give it to automarine fit-thrusters" if quantities >= {"n", "force"} else ""


def _expected(quantity: str) -> str:
    names = " or ".join(naming.names_of(quantity))
    thrusters = next((dof.thrusters for dof in DOFS.values() if dof.command == quantity), ())
    both = "both " if len(thrusters) > 1 else ""
    return f"{names} or {both}{' and '.join(thrusters)}" if thrusters else names


def _free(names: Sequence[str]) -> list[str]:
    """The columns without a meaning of their own; a `time` of plain numbers has none."""
    return [name for name in names if name and (name not in CANONICAL or name == "time")]
