"""What every log becomes, whatever its format: `LogTable`; its columns of words; and what a command asks of it."""

import re
from collections.abc import Container, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import (
    ARMED,
    BY,
    CANONICAL,
    COMMANDS,
    LABELS,
    MODE,
    RUN,
    called,
    driven,
    likely_canonical,
    likely_column,
    motions_in,
    names_of,
    unit_in,
)
from automarine_cli.logs.cells import decoded
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import LOGGED, Origin, RawLog
from automarine_cli.pipeline.words import listed, printable, quoted
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Labels:
    """A column of words: the `names` in the order in which they first appear, and `code`, shape (N,), which of them
    each row has (-1: none)."""

    names: tuple[str, ...]
    code: NDArray[np.int64]


@dataclass(frozen=True)
class LogTable:
    """One log file, read: canonical columns in SI units, each of shape (N,).

    `columns` holds the canonical quantities that the file has, under these names:
    `time` [s], `heading` [rad, as logged: wrapped or not], `yaw_rate` [rad/s], `moment` [`moment_unit`],
    `n_port`, `n_stbd`, `n` [the file's own unit], `voltage` [V], `surge`, `sway` [m/s], `force` [N]; in a log of
    another motion (`dof`) its position [m] and force (see `dofs.Dof`) [`moment_unit`] in place of heading and moment;
    every other numeric column stays in `extras` under the file's own name. In a log of motion in the plane `columns`
    also holds velocities and commands of its other degrees of freedom, `north` and `east` [m], `lat` and `lon` [rad].
    `units` are those of the columns' names: what tells newtons from a normalised force.
    A missing value is NaN. `rows` are 1-based line numbers in the file (Parquet: row numbers), for messages.
    `names` are all column names of the file, `notes` what a person should know about the reading. In a file of several
    runs `run_names` are theirs in the order in which they begin, and `run_code` says for each row which it is.
    `states` are the vehicle's mode and arming where the file tells them, `holds` the messages or topics of the file,
    `origin` where its commands come from, if they were worked back from what was sent to motors. `parts` are what each
    row is of where the column map says (`by`), `words` other columns of few words, which may name runs or parts.
    """

    source: str
    columns: Mapping[str, Floats]
    rows: NDArray[np.int64]
    run_names: tuple[str, ...] = ()
    run_code: NDArray[np.int64] | None = None
    moment_unit: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    dof: Dof = field(kw_only=True)
    extras: Mapping[str, Floats] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    states: Mapping[str, Labels] = field(default_factory=dict)
    holds: tuple[str, ...] = ()
    origin: Origin = LOGGED
    parts: Labels | None = None
    words: Mapping[str, Labels] = field(default_factory=dict)

    @property
    def run(self) -> NDArray[np.str_] | None:
        """Return the name of each row's run, shape (N,), or None where the file is one run."""
        return None if self.run_code is None else np.array(self.run_names)[self.run_code]

    def __len__(self) -> int:
        return len(self.rows)


DECIMALS = 9  # of degrees: the way to radians and back leaves rounding behind


def columns_of(table: LogTable, first: int, stop: int) -> dict[str, Floats | list[str]]:
    """Rows `first` to `stop - 1` under the canonical names, then every other column, then mode and arming.

    A column that would have a canonical name, but was not read as that, is left out: it would be taken for it.
    """
    rows = slice(first, stop)
    found: dict[str, Floats | list[str]] = {}
    for quantity in dict.fromkeys(canonical.quantity for canonical in CANONICAL.values()):
        if quantity in table.columns:
            name = _name_of(quantity, table)
            plain = table.columns[quantity][rows] / CANONICAL[name].factor()
            found[name] = np.round(plain, DECIMALS) if "_deg" in name else plain
    for name, values in table.extras.items():
        if name not in CANONICAL and name not in LABELS:
            found[name] = values[rows]
    for name, labels in table.states.items():
        words = [*labels.names, ""]
        found[name] = [words[code] for code in labels.code[rows]]
    return found


def _name_of(quantity: str, table: LogTable) -> str:
    """The name that a quantity is written under: in degrees, in the unit of the moment or force, else in SI units."""
    names = names_of(quantity)
    if quantity == table.dof.command:
        return next(name for name in names if CANONICAL[name].unit == table.moment_unit)
    degrees = (name for name in names if "_deg" in name)
    return next(degrees, None) or next(name for name in names if CANONICAL[name].factor() == 1)


def csv_text(columns: dict[str, Floats | list[str]], comment: str) -> str:
    """Return the columns as CSV behind a line of comment: every digit that a number has, a missing one empty."""
    import pandas as pd  # here, as whoever only reads logs needs none of it

    frame, number = pd.DataFrame(columns), lambda value: repr(float(value)).removesuffix(".0")
    return f"# {comment}\n" + frame.to_csv(index=False, lineterminator="\n", float_format=number)


MOST_NAMES, FEWEST_ROWS = 40, 3  # of a column of words that may split a table, and the rows of a name on the mean
LONGEST_RUN_NAME = 100  # characters; every row of a log carries the name of its run
REQUIRED = {
    RUN: "no run named; expected the name or number of the run in every row",
    BY: "nothing named; expected a name in every row, because the column map splits the table by this column",
}
RUN_WORDS = {"run", "trial", "test", "session", "series", "experiment"}
PART_WORDS = {"thruster", "motor", "propeller", "unit", "serial", "name", "label", "id"}


def split_by(raw: RawLog, columns: ColumnMap, source: str, label: str) -> Labels | None:
    """Return what the column `label` names in each row: RUN the runs, BY the parts of a table, such as thrusters; None
    without that column. Raises LogError with the row where it is empty, or the name of a run is too long."""
    index = raw.place(columns.source_of(label))
    if index is None:
        return None
    array, column = raw.arrays[index], printable(raw.names[index])
    if array.null_count:
        row = raw.rows[int(np.flatnonzero(pc.is_null(array).to_numpy())[0])]
        raise LogError(f"{source}, row {row}, column {column}: {REQUIRED[label]}. Complete the column")
    labels = _labels(array)
    long = next((i for i, name in enumerate(labels.names) if len(name) > LONGEST_RUN_NAME), None)
    if label == RUN and long is not None:
        row, name = int(np.flatnonzero(labels.code == long)[0]), labels.names[long]
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {column}: found {quoted(name)} of {len(name)} characters, expected "
            f"the name of a run of at most {LONGEST_RUN_NAME}. Shorten it, or check which column names the runs"
        )
    return labels


def few_words(raw: RawLog, taken: Container[str]) -> dict[str, Labels]:
    """Return columns of words that may name runs or parts of a table: of FEWEST_ROWS rows a name and more, two to
    MOST_NAMES names; none of those in `taken`."""
    found = {}
    for name, array in zip(raw.names, raw.arrays):
        words = not (pa.types.is_floating(array.type) or pa.types.is_timestamp(array.type))
        if not name or name in taken or not words or array.null_count or raw.holds:
            continue
        if 2 <= pc.count_distinct(array).as_py() <= min(MOST_NAMES, len(array) // FEWEST_ROWS):
            found[printable(name)] = _labels(array)
    return found


def splitting(names: Iterable[str], bollard: bool) -> dict[str, str]:
    """Return the line of a column map for the first column of a few words that is called like what it names: the
    thrusters of a bollard test, or runs; {} for none."""
    key, called = (BY, PART_WORDS) if bollard else (RUN, RUN_WORDS)
    return next(({key: name} for name in names if set(re.findall("[a-z]+", name.lower())) & called), {})


def states(raw: RawLog, columns: ColumnMap) -> dict[str, Labels]:
    """Return mode and arming, whichever the file tells."""
    places = {name: raw.place(columns.source_of(name)) for name in (MODE, ARMED)}
    return {name: _labels(raw.arrays[place]) for name, place in places.items() if place is not None}


def _labels(array: pa.ChunkedArray) -> Labels:
    coded: Any = pc.dictionary_encode(array).unify_dictionaries().combine_chunks()
    coded = coded if isinstance(coded, pa.Array) else coded.chunk(0)
    words = [_word(value) for value in coded.dictionary.to_pylist()]
    places = {
        name: i for i, name in enumerate(dict.fromkeys(word for word in words if word is not None))
    }  # 7 and 7.0 are one name
    code = np.array([-1 if word is None else places[word] for word in [*words, None]], dtype=np.int64)
    return Labels(tuple(places), code[pc.fill_null(coded.indices, -1).to_numpy()])


def _word(value: object) -> str | None:
    if isinstance(value, float):
        return None if value != value else str(int(value)) if value.is_integer() else str(value)
    return printable(decoded(value) if isinstance(value, bytes) else str(value))


def require(table: LogTable, quantities: Sequence[str]) -> None:
    """Refuse a table that lacks one of the quantities (names as in `LogTable.columns`).

    Raises LogError that lists the columns found and says what to write in the `--columns` file.
    """
    lacking = [quantity for quantity in quantities if quantity not in table.columns]
    if not lacking:
        return
    missing = f"{table.source}: no {_and([called(quantity) for quantity in lacking])}"
    if table.origin.why_not and set(lacking) & {dof.command for dof in DOFS.values()}:
        raise LogError(f"{missing}; {table.origin.why_not}")
    guesses = {quantity: guess for quantity in lacking if (guess := _guess(table, quantity)) is not None}
    hint = f'If it has another name, write a line such as {names_of(lacking[0])[0]} = "NAME"'
    if guesses:
        lines = " and ".join(_line(quantity, guess) for quantity, guess in guesses.items())
        hint = (
            f"If {_and([*map(quoted, guesses.values())])} {'is' if len(guesses) == 1 else 'are'} meant, write {lines}"
        )
    holds = f" in a file that holds {listed(table.holds)}" if table.holds else ""
    unmet = [note for note in table.notes if any(f" for {n};" in note for q in lacking for n in names_of(q))]
    raise LogError(
        f"{missing}; found the columns {listed(table.names)}{holds}; expected {'; '.join(map(_expected, lacking))}. "
        + "".join(f"{note[0].upper()}{note[1:]}. " for note in unmet)
        + (_meant_for(table, lacking) or f"{hint} under [columns] in a file and give it with --columns FILE.toml")
    )


def require_motion(table: LogTable) -> None:
    """Refuse a table that is no log of its motion: time, position (or velocity, which can be summed up), and a moment
    or force or every thruster command."""
    dof = table.dof
    by_name = _guess(table, dof.position) is None and _guess(table, dof.velocity) is not None
    velocity = dof.position not in table.columns and (is_velocity_only(table) or by_name)
    commands: tuple[str, ...] = (dof.command,)
    if dof.command not in table.columns and any(side in table.columns for side in dof.thrusters):
        commands = dof.thrusters
    require(table, ("time", dof.velocity if velocity else dof.position, *commands))


def is_velocity_only(table: LogTable) -> bool:
    """Return whether the table holds the velocity of its motion but not the position."""
    return table.dof.position not in table.columns and table.dof.velocity in table.columns


def require_thruster(table: LogTable) -> None:
    """Refuse a table that is no thruster test: control signal and force."""
    require(table, ("n", "force"))


def is_thruster_test(table: LogTable) -> bool:
    """Return whether the table is, or seems meant as, a thruster test rather than a log of a motion."""
    return means_thruster_test(table.columns.keys(), table.names, table.dof)


def means_thruster_test(held: Set[str], names: Sequence[str], dof: Dof) -> bool:
    """Return the same of a log of a motion that holds these quantities in columns of these names."""
    commanded = dof.command in held or driven(dof, held)
    if dof.position in held or (dof.velocity in held and commanded):
        return False
    free = _free(names)
    return "force" in held or (likely_column("force", free) is not None and likely_column(dof.position, free) is None)


def _line(quantity: str, column: str) -> str:
    """The line of a column map for a column; pulses to thrusters rest at 1500 us."""
    key, name = likely_canonical(quantity, column), printable(column)
    pulses = quantity in COMMANDS and unit_in(column) == "us"
    return f'{key} = {{ from = "{name}", subtract = 1500 }}' if pulses else f'{key} = "{name}"'


def _meant_for(table: LogTable, lacking: Sequence[str]) -> str:
    """What the table is instead, and the command that reads it; empty where its columns make no whole log."""
    if set(lacking) == {"time"}:
        return ""
    held = {CANONICAL[name].quantity for name in table.names if name in CANONICAL}
    for dof in motions_in(held):
        return f"This is a log of {dof.name}: give it to automarine fit-{dof.name}"
    return "This is a thruster test: give it to automarine fit-thrusters" if held >= {"n", "force"} else ""


def _expected(quantity: str) -> str:
    names = " or ".join(names_of(quantity))
    thrusters = next((dof.thrusters for dof in DOFS.values() if dof.command == quantity), ())
    return f"{names} or {'both ' * (len(thrusters) > 1)}{' and '.join(thrusters)}" if thrusters else names


def _guess(table: LogTable, quantity: str) -> str | None:
    return likely_column(quantity, _free(table.names))


def _free(names: Sequence[str]) -> list[str]:
    """The columns without a meaning of their own; a `time` of plain numbers has none."""
    return [name for name in names if name and (name not in CANONICAL or name == "time")]


def _and(words: Sequence[str]) -> str:
    return " and ".join([*filter(None, [", ".join(words[:-1])]), words[-1]])
