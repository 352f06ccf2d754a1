"""Records of bollard tests: read from logs with missing values dropped and counted, or simulated."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.errors import LogError
from automarine_cli.logs import ColumnMap, ColumnRule, LogFile, Logs, LogTable, find_logs, read_log, require_thruster
from automarine_cli.logs.canonical import BY
from automarine_cli.logs.labels import splitting
from automarine_cli.logs.table import Labels
from automarine_cli.pipeline.progress import Progress, counted, silent
from automarine_cli.pipeline.words import listed, quoted
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import has_bytes, none_left, refused_by_strict, unreadable
from automarine_cli.runs.run import SetAside
from automarine_cli.simulation.run_groups import levels_of
from automarine_cli.simulation.specification import Bollard
from automarine_cli.simulation.streams import normal, uniform
from automarine_cli.thrusters.forms import Curve
from automarine_cli.thrusters.map import ThrusterMap

FORCE_DECIMALS = 3


@dataclass(frozen=True)
class Series:
    """One test record as logged: one file, or one `run` of a file; arrays of shape (N,).

    `n` is the control signal [unit as logged], `force` the thrust of all pulling thrusters together [N],
    `time` [s] and `voltage` [V] are None where the log has none; `extras` are its other columns by their own names.
    `part` is which thruster it is of, where a column says (`ThrusterLogs.by`).
    """

    source: str
    run: str
    n: Floats
    force: Floats
    time: Floats | None = None
    voltage: Floats | None = None
    extras: Mapping[str, Floats] = field(default_factory=dict)
    part: str = ""

    @property
    def place(self) -> str:
        """File, run and part, for people."""
        run = f", run {self.run}" if self.run else ""
        return f"{self.source}{run}, {self.part}" if self.part else f"{self.source}{run}"


@dataclass(frozen=True)
class ThrusterLogs:
    """Test records in file and row order, what was set aside, files read, rows with missing values; the unit of the
    control signal where all logs tell the same, else "".

    `by` is the column that says which thruster a record is of, "" without; `asked` whether the user named it, else it
    was found: a column of a few words in every table.
    """

    records: tuple[Series, ...]
    set_aside: tuple[SetAside, ...]
    inputs: tuple[LogFile, ...]
    missing: int
    n_unit: str = ""
    by: str = ""
    asked: bool = False
    rule: ColumnRule | None = None
    """How all logs read their force, where a column map says it."""

    @property
    def used(self) -> int:
        """How many runs there are; parts that nobody asked for count as one."""
        return len({(one.source, one.run, one.part if self.asked else "") for one in self.records})

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts in the order in which they first appear."""
        return tuple(dict.fromkeys(record.part for record in self.records if record.part))

    def of(self, part: str) -> "ThrusterLogs":
        """The records of one part, as logs of their own."""
        return replace(self, records=tuple(r for r in self.records if r.part == part), by="", asked=False, set_aside=())


def load_thruster_logs(
    logs: Logs, columns: ColumnMap, *, strict: bool = False, progress: Progress = silent
) -> ThrusterLogs:
    """Read every log; one `run` of a file is one record.

    Raises LogError for a log named on the command line that cannot serve, RunError with `strict` or if none
    is left.
    """
    files = find_logs(logs)
    records: list[Series] = []
    set_aside: list[SetAside] = []
    missing, units, found_by = 0, set[str](), ""
    for file in counted(progress, "reading", files, len(files)):
        try:
            table = read_log(file, columns, dof=YAW)  # of no motion: columns of others keep their names
            require_thruster(table)
            _require_parts(table, columns)
        except LogError as refusal:
            if file.named:
                raise
            set_aside.append(unreadable(file, refusal))
            continue
        parts = table.parts
        if parts is None and (name := _name_of_parts(table)):
            parts, found_by = table.words[name], name
        found, gone, idle = _records(table, parts)
        records += found
        units.add(table.units.get("n", ""))
        missing += gone
        set_aside += idle
    if strict and set_aside:
        raise refused_by_strict(set_aside[0])
    if not records:
        raise none_left(len(files), set_aside)
    asked = columns.source_of(BY) if BY in columns.columns or (any(r.part for r in records) and not found_by) else ""
    unit = units.pop() if len(units) == 1 else ""
    used = tuple(filter(has_bytes, files))
    rules = {columns.of(file.path).columns.get("force_N") for file in files}
    rule = rules.pop() if len(rules) == 1 else None
    return ThrusterLogs(tuple(records), tuple(set_aside), used, missing, unit, asked or found_by, bool(asked), rule)


def _require_parts(table: LogTable, columns: ColumnMap) -> None:
    """Raise LogError where the column that the map names with `by` is not in the table."""
    if BY in columns.columns and table.parts is None:
        raise LogError(
            f"{table.source}: no column {quoted(columns.source_of(BY))}, which the column map names with by; found the "
            f"columns {listed(table.names)}. Correct the name, or leave the line out"
        )


def _name_of_parts(table: LogTable) -> str:
    """The column of words that may say which thruster a row is of, "" for none: one that is called like that, else the
    only one. In a series over time the words come one after the other."""
    blocks = {name: 1 + int(np.count_nonzero(np.diff(labels.code))) for name, labels in table.words.items()}
    may = [name for name, one in table.words.items() if "time" not in table.columns or blocks[name] <= len(one.names)]
    return splitting(may, bollard=True).get(BY, may[0] if len(may) == 1 else "")


def _records(table: LogTable, parts: Labels | None) -> tuple[list[Series], int, list[SetAside]]:
    n, force = table.columns["n"], table.columns["force"]
    time, voltage = table.columns.get("time"), table.columns.get("voltage")
    good = np.isfinite(n) & np.isfinite(force)
    if time is not None:
        good &= np.isfinite(time)
    names = np.full(len(table), "") if table.run is None else table.run
    records, idle = [], []
    part_names = np.full(len(table), "") if parts is None else np.array(parts.names)[parts.code]
    both = zip(map(str, names), map(str, part_names))
    for name, part in dict.fromkeys(both):  # in the order in which they first appear
        here = (names == name) & (part_names == part) & good
        if not np.any(here):
            idle.append(SetAside(table.source, name or part, "no row has both a control signal and a force"))
            continue
        clock, volts = (None if column is None else column[here] for column in (time, voltage))
        extras = {key: column[here] for key, column in table.extras.items()}
        records.append(Series(table.source, name, n[here], force[here], clock, volts, extras, part))
    return records, int(np.count_nonzero(~good)), idle


def bollard_columns(bollard: Bollard, seed: int) -> dict[str, Floats]:
    """`n` and `force_N` of all thrusters of a test together, shape (levels x repeats,), in random order."""
    levels = np.repeat(np.array(levels_of(bollard.levels)), bollard.repeats)
    order = np.argsort(uniform(len(levels), seed, bollard.file, "order"), kind="stable")
    thrusters = ThrusterMap("square", Curve(bollard.a_f), Curve(bollard.a_b))
    pull = bollard.thrusters_per_test * thrusters.force(levels)
    measured = pull + bollard.noise_N * normal(len(levels), seed, bollard.file, "noise")
    return {"n": levels[order], "force_N": (np.round(measured, FORCE_DECIMALS) + 0.0)[order]}
