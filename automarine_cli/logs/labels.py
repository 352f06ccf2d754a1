"""Columns of words: the runs of a file of many, and the vehicle's mode and arming."""

import re
from collections.abc import Callable, Container, Iterable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from automarine_cli.errors import LogError
from automarine_cli.logs.canonical import ARMED, BY, MODE, RUN
from automarine_cli.logs.cells import decoded
from automarine_cli.logs.columns import ColumnMap
from automarine_cli.logs.formats import RawLog
from automarine_cli.logs.table import Labels
from automarine_cli.pipeline.words import printable, quoted

MOST_NAMES, FEWEST_ROWS = 40, 3  # of a column of words that may split a table, and the rows of a name on the mean
LONGEST_RUN_NAME = 100  # characters; every row of a log carries the name of its run


def run_names(raw: RawLog, columns: ColumnMap, source: str) -> Labels | None:
    """The names of the runs in the order in which they begin, and for each row which it is; None without a column
    of them. Raises LogError with the row for a run without a name, or with one that is too long.
    """
    index = _place(raw, columns, RUN)
    if index is None:
        return None
    array, column = raw.arrays[index], printable(raw.names[index])
    if array.null_count:
        row = int(np.flatnonzero(pc.is_null(array).to_numpy())[0])
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {column}: no run named; "
            "expected the name or number of the run in every row. Complete the column"
        )
    found = _labels(array)
    for i, name in enumerate(found.names):
        if len(name) > LONGEST_RUN_NAME:
            row = int(np.flatnonzero(found.code == i)[0])
            raise LogError(
                f"{source}, row {raw.rows[row]}, column {column}: found {quoted(name)} of "
                f"{len(name)} characters, expected the name of a run of at most {LONGEST_RUN_NAME}. "
                "Shorten it, or check which column names the runs"
            )
    return found


def parts(raw: RawLog, columns: ColumnMap, source: str) -> Labels | None:
    """What each row is of, by the column that the map names with `by`: thrusters in one table; None without one.

    Raises LogError with the row where the column is empty.
    """
    index = _place(raw, columns, BY)
    if index is None:
        return None
    array = raw.arrays[index]
    if array.null_count:
        row = int(np.flatnonzero(pc.is_null(array).to_numpy())[0])
        raise LogError(
            f"{source}, row {raw.rows[row]}, column {printable(raw.names[index])}: nothing named; expected a name in "
            "every row, because the column map splits the table by this column. Complete the column"
        )
    return _labels(array)


RUN_WORDS = {"run", "trial", "test", "session", "series", "experiment"}
PART_WORDS = {"thruster", "motor", "propeller", "unit", "serial", "name", "label", "id"}


def few_words(raw: RawLog, taken: Container[str]) -> dict[str, Labels]:
    """Columns of words that may name runs or parts of a table: of FEWEST_ROWS rows a name and more, two to
    MOST_NAMES names; none of those in `taken`."""
    found = {}
    for name, array in zip(raw.names, raw.arrays):
        words = not (pa.types.is_floating(array.type) or pa.types.is_timestamp(array.type))
        if not name or name in taken or not words or array.null_count or raw.holds:
            continue
        distinct = pc.count_distinct(array).as_py()
        if 2 <= distinct <= min(MOST_NAMES, len(array) // FEWEST_ROWS):
            found[printable(name)] = _labels(array)
    return found


def splitting(names: Iterable[str], bollard: bool) -> dict[str, str]:
    """The line of a column map for the first column of a few words that is called like what it names: the thrusters of
    a bollard test, or runs; {} for none."""
    key, called = (BY, PART_WORDS) if bollard else (RUN, RUN_WORDS)
    return next(({key: name} for name in names if set(re.findall("[a-z]+", name.lower())) & called), {})


def states(raw: RawLog, columns: ColumnMap) -> dict[str, Labels]:
    """Mode and arming, whichever the file tells."""
    places = {name: _place(raw, columns, name) for name in (MODE, ARMED)}
    return {name: _labels(raw.arrays[place]) for name, place in places.items() if place is not None}


def _place(raw: RawLog, columns: ColumnMap, name: str) -> int | None:
    wanted = columns.source_of(name)
    wanted = raw.also.get(wanted, wanted)
    return raw.names.index(wanted) if wanted in raw.names else None


def _labels(array: pa.ChunkedArray) -> Labels:
    values, words = _codes(array)
    edges = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1, [len(values)]])
    begun = values[edges[:-1]].tolist()  # looked at once for each stretch of rows, of which there are few
    named = [words(value) for value in begun]
    places = {name: i for i, name in enumerate(dict.fromkeys(name for name in named if name is not None))}
    code = np.array([-1 if name is None else places[name] for name in named], dtype=np.int64)  # 7 and 7.0 are one name
    return Labels(tuple(places), np.repeat(code, np.diff(edges)))


def _codes(array: pa.ChunkedArray) -> tuple[NDArray[Any], Callable[[Any], str | None]]:
    """Numbers, (N,), and the name that each stands for, None where nothing is named."""
    if pa.types.is_floating(array.type):
        return array.to_numpy(), lambda value: None if value != value else _name(value)
    encoded = array if pa.types.is_dictionary(array.type) else pc.dictionary_encode(array)
    coded: Any = encoded.unify_dictionaries().combine_chunks()
    coded = coded if isinstance(coded, pa.Array) else coded.chunk(0)
    names = [_name(value) for value in coded.dictionary.to_pylist()]
    return pc.fill_null(coded.indices, -1).to_numpy(), lambda value: None if value < 0 else names[value]


def _name(value: object) -> str:
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return printable(decoded(value) if isinstance(value, bytes) else str(value))
