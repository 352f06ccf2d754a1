"""`automarine check`: what is in the logs, what of it serves, and what is wrong with the rest."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain, islice

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import LogError
from automarine_cli.logs import (
    ColumnMap,
    LogFile,
    find_logs,
    given_columns,
    is_thruster_test,
    read_logs,
    require_thruster,
)
from automarine_cli.logs.find import in_parcels
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.report import outcomes
from automarine_cli.report.check_tables import run_tables, thruster_test_table
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import CHECK
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.load import none_left, refused_by_strict, runs_of_tables
from automarine_cli.runs.look import RunSeen, ThrusterTestSeen, look_at_runs, look_at_tests, with_limits
from automarine_cli.runs.run import NAMED_APART, SetAside, names_apart
from automarine_cli.workflows.command import Command, ReadBack, Runner
from automarine_cli.workflows.shared import Columns, OfLogs, counted
from automarine_cli.workflows.view import Row, View

SeenInLog = tuple[list[RunSeen], list[ThrusterTestSeen], list[SetAside]]


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
            "schema": CHECK.schema,
            "logs": self.logs,
            "runs": runs_json(len(self.runs) + len(self.tests), self.set_aside),
            **{f"{dof.name}_runs": self._seen(dof) for dof in DOFS.values() if dof is YAW or self._seen(dof)},
            "thruster_tests": [asdict(test) for test in self.tests],
        }

    def tables(self) -> tuple[Table, ...]:
        """One table for the runs of each motion, one for the thruster tests, whichever there are."""
        return tuple(table for table in (*run_tables(self.runs), thruster_test_table(self.tests)) if table.rows)

    def _seen(self, dof: Dof) -> list[dict[str, object]]:
        return [run.to_json() for run in self.runs if run.dof is dof]


@dataclass(frozen=True, kw_only=True)
class CheckOptions(Columns, OfLogs):
    """Logs to look at, and whether what would be set aside is refused."""

    strict: bool = False


def _check(asked: CheckOptions, runner: Runner) -> Check:
    """Look at logs of all motions and thruster tests, which may be mixed.

    Raises LogError or RunError as `load_runs`: for a named log that cannot be read, with `strict` for what
    would be set aside, and where nothing is left; OutputError.
    """
    names, files = given_columns(asked.columns), find_logs(asked.logs)
    return runner.results(asked, lambda: _look(files, names, asked.strict, runner.jobs, runner.progress), _write)


def _write(folder: ResultFolder, result: Check) -> None:
    folder.write_json("check.json", result.to_json())
    folder.write("check.md", "\n".join(table.to_markdown() for table in result.tables()))


def _look(files: Sequence[LogFile], names: ColumnMap, strict: bool, jobs: int, progress: Progress) -> Check:
    look = partial(_look_at, columns=names)
    found = [*chain(*ordered_map(look, in_parcels(files), jobs, progress=progress, stage="looking at logs"))]
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


def _look_at(files: Sequence[LogFile], columns: ColumnMap) -> list[SeenInLog]:
    """What is seen of the runs and thruster tests of each file, and what is set aside; their samples are not kept."""
    tables = read_logs(files, columns, dof=None)
    found: dict[int, SeenInLog] = {}
    for i, table in enumerate(tables):
        if isinstance(table, LogError) or not is_thruster_test(table):
            continue
        try:
            require_thruster(table)
            found[i] = [], *look_at_tests(table)
        except LogError as error:
            tables[i] = error
    left = [i for i in range(len(files)) if i not in found]
    read = list(runs_of_tables([files[i] for i in left], [tables[i] for i in left]))
    seen = look_at_runs(run for runs, _ in read for run in runs)
    found |= {i: ([*islice(seen, len(runs))], [], aside) for i, (runs, aside) in zip(left, read)}
    return [found[i] for i in range(len(files))]


def _lines(result: Check) -> Iterator[str]:
    runs, tests = counted(len(result.runs), "yaw run"), counted(len(result.tests), "thruster test")
    yield f"Checked {counted(result.logs, 'log')}: {runs}, {tests}; {len(result.set_aside)} set aside"
    yield from (f"  {one.file}, run {one.run}: {one.why}" for one in result.set_aside)


def _rows(result: Check) -> Iterator[Row]:
    yield from ({"kind": "yaw run"} | run.to_json() for run in result.runs if run.dof is YAW)
    yield from ({"kind": "thruster test"} | asdict(test) for test in result.tests)


check = Command(
    "check", CheckOptions, _check, {Check: View(Check.tables, _lines, _rows)},
    files=lambda result: ("check.json", "check.md"), kept=ReadBack(CHECK, outcomes.of_check),
)  # fmt: skip
