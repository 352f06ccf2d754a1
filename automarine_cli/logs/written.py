"""Rows of a log, written as a log of its own that is read without a column map."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.logs.canonical import CANONICAL, LABELS, names_of
from automarine_cli.logs.table import Floats, LogTable

DECIMALS = 9  # of degrees: the way to radians and back leaves rounding behind


def columns_of(table: LogTable, first: int, stop: int) -> dict[str, Floats | list[str]]:
    """Rows `first` to `stop - 1` under the canonical names, then every other column, then mode and arming.

    A column that would have a canonical name, but was not read as that, is left out: it would be taken for it.
    """
    rows = slice(first, stop)
    found: dict[str, Floats | list[str]] = {}
    for quantity in dict.fromkeys(one.quantity for one in CANONICAL.values()):
        if quantity in table.columns:
            name, values = _name_of(quantity, table), table.columns[quantity][rows]
            plain = values / CANONICAL[name].factor()
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
    """The columns as CSV behind a line of comment: every digit that a number has, a missing one empty."""
    names = ",".join(_quoted(name) for name in columns)
    rows = zip(*([_quoted(v) for v in c] if isinstance(c, list) else _cells(c) for c in columns.values()))
    return "\n".join([f"# {comment}", names, *map(",".join, rows), ""])


def _cells(values: Floats) -> Sequence[str]:
    return ["" if value != value else repr(value).removesuffix(".0") for value in values.tolist()]


def _quoted(text: str) -> str:
    special = any(character in text for character in ',"\n\r;\t') or text[:1] in ("#", " ")
    return '"' + text.replace('"', '""') + '"' if special else text
