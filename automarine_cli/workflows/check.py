"""`automarine check`: what is in the logs, what of it serves, and what is wrong with the rest."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import (
    ColumnMap,
    LogFile,
    find_logs,
    given_columns,
    is_thruster_test,
    read_log,
    require_thruster,
)
from automarine_cli.pipeline.manifest import Input, given_as
from automarine_cli.pipeline.outputs import result_folder
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.shown import Shown
from automarine_cli.report.check_tables import run_tables, thruster_test_table
from automarine_cli.report.tables import Table
from automarine_cli.runs.load import has_bytes, none_left, refused_by_strict, runs_of_table, unreadable
from automarine_cli.runs.look import RunSeen, ThrusterTestSeen, look_at_run, look_at_tests, with_limits
from automarine_cli.runs.run import NAMED_APART, SetAside, names_apart

FILES = ("check.json", "check.md")


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """Everything `check` found, in the order of the files."""

    runs: tuple[RunSeen, ...]
    tests: tuple[ThrusterTestSeen, ...]
    set_aside: tuple[SetAside, ...]
    logs: int

    def to_json(self) -> dict[str, object]:
        """The result: schema automarine/check/1."""
        return {
            "schema": "automarine/check/1",
            "logs": self.logs,
            "runs": {
                "used": len(self.runs) + len(self.tests),
                "set_aside": [asdict(run) for run in self.set_aside],
            },
            **{f"{dof.name}_runs": self._seen(dof) for dof in DOFS.values() if dof is YAW or self._seen(dof)},
            "thruster_tests": [asdict(test) for test in self.tests],
        }

    def tables(self) -> tuple[Table, ...]:
        """One table for the runs of each motion, one for the thruster tests, whichever there are."""
        return tuple(
            table for table in (*run_tables(self.runs), thruster_test_table(self.tests)) if table.rows
        )

    def _seen(self, dof: Dof) -> list[dict[str, object]]:
        return [run.to_json() for run in self.runs if run.dof is dof]


def check(
    logs: Sequence[str | Path],
    *,
    columns: ColumnMap | Path | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    strict: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> Check:
    """Look at logs of all motions and thruster tests, which may be mixed; writes what it found if `out` is given.

    Raises LogError or RunError as `load_runs`: for a named log that cannot be read, with `strict` for what
    would be set aside, and where nothing is left; OutputError.
    """
    names = given_columns(columns)
    files = find_logs(logs)
    if out is None:
        return _look(files, names, strict, jobs, progress)
    inputs = [Input(file.name, file.path) for file in files if has_bytes(file)] + given_as(
        columns=columns, dbc=names.database
    )
    options = {"columns": columns, "strict": strict}
    with result_folder(
        out, command="check", options=options, inputs=inputs, seed=None, overwrite=overwrite
    ) as folder:
        result = _look(files, names, strict, jobs, progress)
        folder.write_json("check.json", result.to_json())
        folder.write("check.md", "\n".join(table.to_markdown() for table in result.tables()))
    return result


def _look(files: Sequence[LogFile], names: ColumnMap, strict: bool, jobs: int, progress: Progress) -> Check:
    found = ordered_map(
        partial(_look_at, columns=names), files, jobs, progress=progress, stage="looking at logs"
    )
    aside = [run for _, _, bad in found for run in bad]
    runs = [run for good, _, _ in found for run in good]
    tests = tuple(test for _, seen, _ in found for test in seen)
    if strict and aside:
        raise refused_by_strict(aside[0])
    if not runs and not tests:
        raise none_left(len(files), aside)
    apart = names_apart([(run.run, run.file) for run in runs])
    seen = [
        run if run.run == name else replace(run, run=name, notes=[*run.notes, NAMED_APART])
        for run, name in zip(with_limits(runs), apart)
    ]
    return Check(tuple(seen), tests, tuple(aside), len(files))


def _look_at(
    file: LogFile, columns: ColumnMap
) -> tuple[list[RunSeen], list[ThrusterTestSeen], list[SetAside]]:
    """What is seen of the runs and thruster tests of one file, and what is set aside; its samples are not kept."""
    try:
        table = read_log(file, columns, dof=None)
        if is_thruster_test(table):
            require_thruster(table)
            return [], *look_at_tests(table)
    except LogError as error:
        if file.named:
            raise
        return [], [], [unreadable(file, error)]
    runs, aside = runs_of_table(table, file)
    return [look_at_run(run) for run in runs], [], aside
