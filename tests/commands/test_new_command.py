"""A new command is a file of `commands`, a line of its table, and the sections of its result."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from click.testing import Result

import automarine_cli as am
from automarine_cli import commands
from automarine_cli.commands import options
from automarine_cli.commands.command import command, option
from automarine_cli.errors import LogError, SettingError
from automarine_cli.pipeline.records import Shown
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table

NAME = "count-rows"


@dataclass(frozen=True, repr=False)
class RowCount(Shown):
    rows: tuple[int, ...]

    def to_json(self) -> dict[str, Any]:
        return {"rows": list(self.rows), "runs": {"used": len(self.rows), "set_aside": []}}


@pytest.fixture
def pool(small_day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with logs, and the command among ours."""
    monkeypatch.setitem(commands.COMMANDS["Logs"], NAME, "How long the runs are.")
    monkeypatch.setattr(am, "__all__", [*am.__all__, "count_rows"])

    @command(NAME, report="row_count", figures=False)
    @options.logs
    @options.columns
    @option("--least", type=int, default=0, help="Leave out runs with fewer rows.")
    @options.ending(options.jobs)
    def count_rows(logs: Any, columns: Any, least: int) -> RowCount:
        """Count the rows of every run."""
        from automarine_cli.dofs import YAW
        from automarine_cli.logs import given_columns
        from automarine_cli.runs.load import load_runs

        runs = load_runs(logs, given_columns(columns), dof=YAW).runs
        return RowCount(tuple(len(run) for run in runs if len(run) >= least))

    for name, value in (("commands.count_rows", count_rows), ("report.row_count", None)):
        module = ModuleType(f"automarine_cli.{name}")
        setattr(module, name.partition(".")[2], value)
        monkeypatch.setitem(sys.modules, module.__name__, module)
    shutil.copytree(small_day / "pool", tmp_path / "logs")
    monkeypatch.chdir(tmp_path)


@sections.register
def _(result: RowCount) -> Sections:
    table = Table("Rows", ("rows",), tuple((str(count),) for count in result.rows))
    files = {"rows.json": result.to_json(), "rows.md": table.to_markdown()}
    return Sections([table], files, listed=tuple(files), rows=[{"rows": count} for count in result.rows])


@pytest.mark.usefixtures("pool")
def test_the_terminal_and_python_have_it(run: Callable[..., Result], monkeypatch: pytest.MonkeyPatch) -> None:
    assert "count-rows  How long the runs are." in run("--help").stdout
    assert "--least" in run(NAME, "--help").stdout
    result = run(NAME, "logs/steps", "--least", "3", "-o", "rows")
    assert result.exit_code == 0 and "Results are in rows: rows.json, rows.md" in result.stdout
    manifest = json.loads(Path("rows/manifest.json").read_text())
    assert manifest["options"] == {"columns": None, "least": 3} and manifest["command"] == NAME
    assert {entry["role"] for entry in manifest["inputs"]} == {"log"}
    refused = run(NAME, "logs/steps", "-o", "rows")
    assert refused.exit_code == 1 and "--overwrite" in refused.stderr
    assert run("verify", "rows").exit_code == 0
    count = am.count_rows("logs/steps", least=1)
    monkeypatch.delitem(vars(am), "count_rows")
    assert repr(count).startswith("Rows\n") and "<table>" in count._repr_html_()
    assert list(count.to_frame()["rows"]) == list(count.rows) and len(count.rows) > 1
    count_rows = commands.load(NAME)
    assert count_rows.__doc__ == "Count the rows of every run."
    with pytest.raises(LogError):
        count_rows("nowhere")
    with pytest.raises(TypeError, match="most"):
        count_rows("logs/steps", most=1)
    with pytest.raises(SettingError, match="least is 'few'"):
        count_rows("logs/steps", least="few")
