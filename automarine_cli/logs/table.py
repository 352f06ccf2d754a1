"""What every log becomes, whatever its format; and rows of it as a log of its own that is read without a column map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.logs.canonical import CANONICAL, LABELS, names_of
from automarine_cli.logs.formats import LOGGED, Origin
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
        """The name of each row's run, shape (N,), or None where the file is one run."""
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
