"""A new command is two files: put into the folders of commands, it is told, carried out, repeated and compared."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from small_campaign import make_small_campaign

import automarine_cli as am
from automarine_cli import cli, workflows
from automarine_cli.errors import LogError
from automarine_cli.workflows.command import commands

CLI = '''
"""`automarine count-rows`: logs in, how long they are out."""

import click

from automarine_cli.cli import options


@click.command("count-rows", short_help="How long the runs are.")
@options.logs_argument
@options.columns_option
@click.option("--least", type=int, default=0, help="Leave out runs with fewer rows.")
@options.ending("jobs")
def count_rows(**given: object) -> object:
    """Count the rows of every run.

    Example:
      automarine count-rows sample_runs/steps
    """
    from automarine_cli.workflows.count_rows import count_rows as command

    return options.perform(command, given)
'''
WORKFLOW = '''
"""`count-rows`: how long the runs are."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.results.estimate import Estimate
from automarine_cli.logs import given_columns
from automarine_cli.results.shown import Shown
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import ResultKind
from automarine_cli.results.records import ResultRecord
from automarine_cli.runs.load import load_runs
from automarine_cli.workflows.command import Command, ReadBack
from automarine_cli.workflows.shared import Columns, OfLogs
from automarine_cli.workflows.view import View

SCHEMA = "automarine/row-count/1"


@dataclass(frozen=True, repr=False)
class RowCount(Shown):
    rows: tuple[int, ...]

    def to_json(self):
        half = float(np.std(self.rows))
        mean = Estimate(float(np.mean(self.rows)), half, (self.rows[0] - half, self.rows[0] + half), "1")
        return {"schema": SCHEMA, "rows": mean.to_json(), "runs": {"used": len(self.rows), "set_aside": []}}

    def tables(self):
        return [Table("Rows", ("rows",), tuple((str(one),) for one in self.rows))]


@dataclass(frozen=True, kw_only=True)
class CountOptions(Columns, OfLogs):
    least: int = 0


def _count(asked, runner):
    """Count the rows of every run."""
    campaign = load_runs(asked.logs, given_columns(asked.columns), dof=YAW)

    def write(folder, result):
        folder.write_json("rows.json", result.to_json())
        folder.write("rows.md", result.tables()[0].to_markdown())

    def work():
        return RowCount(tuple(len(run) for run in campaign.runs if len(run) >= asked.least))

    return runner.results(asked, work, write)


@dataclass(frozen=True, kw_only=True)
class RowFile(ResultRecord):
    rows: Estimate


def _contents(file, models):
    return {"rows a run": file.rows}, {"schema": file.schema}


count_rows = Command(
    "count-rows", CountOptions, _count, {RowCount: View(RowCount.tables, lambda result: iter(["rows"]))},
    files=lambda result: ("rows.json", "rows.md"), section="rows.md",
    kept=ReadBack(ResultKind("rows.json", SCHEMA, RowFile, "a count of rows", "count-rows", YAW), contents=_contents),
)
'''

Run = Callable[..., Result]


@pytest.fixture
def pool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with logs, and the two files of the command among ours."""
    for package, text in ((cli, CLI), (workflows, WORKFLOW)):
        folder = tmp_path / package.__name__
        folder.mkdir()
        (folder / "count_rows.py").write_text(text)
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])
    make_small_campaign(tmp_path / "logs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_two_files_make_a_command(pool: Path, run: Run) -> None:
    assert "count-rows     How long the runs are." in run("--help").stdout
    assert "--least" in run("count-rows", "--help").stdout
    found = run("count-rows", "logs/steps", "--least", "3", "-o", "all/count-rows")
    assert found.exit_code == 0 and "Results are in all/count-rows: rows.json, rows.md" in found.stdout
    manifest = json.loads(Path("all/count-rows/manifest.json").read_text())
    assert manifest["options"] == {"columns": None, "least": 3} and manifest["command"] == "count-rows"
    assert {entry["role"] for entry in manifest["inputs"]} == {"log"}
    refused = run("count-rows", "logs/steps", "-o", "all/count-rows")
    assert refused.exit_code == 1 and "--overwrite" in refused.stderr


def test_it_is_verified_compared_and_reported(pool: Path, run: Run) -> None:
    for name in ("all/count-rows", "other"):
        assert run("count-rows", "logs/steps", "-o", name).exit_code == 0
    assert run("verify", "other").exit_code == 0
    beside = run("compare", "all/count-rows", "other")
    assert beside.exit_code == 0 and "rows a run" in beside.stdout
    assert run("check", "logs", "-o", "all/check").exit_code == 0
    assert run("report", "all").exit_code == 0
    assert "## Count rows" in Path("all/report.md").read_text()


def test_python_has_it(pool: Path) -> None:
    command = commands()["count-rows"]
    assert command is am.count_rows and command.__doc__ == "Count the rows of every run."
    result = am.count_rows("logs/steps", least=1)
    assert repr(result) == "rows" and "<table>" in result._repr_html_() and len(result.rows) > 1
    with pytest.raises(LogError):
        am.count_rows("nowhere")
    with pytest.raises(TypeError, match="most"):
        am.count_rows("logs/steps", most=1)
