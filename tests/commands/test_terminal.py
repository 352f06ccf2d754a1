"""What a person sees on a terminal, and a program in a pipe: widths, colours, bars, versions, the tab key."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import Result
from hypothesis import given
from hypothesis import strategies as st
from pseudo_terminal import ESCAPE, PATIENCE_S, on_terminal, without_bars
from repository import ROOT
from small_campaign import make_small_campaign

from automarine_cli.commands.diagnose import foretell
from automarine_cli.commands.terminal import Bar, terminal_progress
from automarine_cli.report.tables import Table, text_table

STEPS = ROOT / "sample_runs" / "hidden_one"


@pytest.mark.parametrize("columns", [60, 200])
def test_tables_fit_the_terminal(columns: int) -> None:
    status, said = on_terminal("check", STEPS, columns=columns, NO_COLOR="1")
    said = without_bars(said)
    assert status == 0
    assert ESCAPE not in said
    lines = said.splitlines()
    assert max(map(len, lines)) <= columns
    assert sum("tau_+0.1 " in line for line in lines) == (1 if columns == 200 else said.count("\nrun "))
    assert {"jitter", "noise", "levels", "turns"} <= set(said.split())


def test_a_terminal_without_a_width_has_80_columns() -> None:
    without, plain = (without_bars(on_terminal("check", STEPS, columns=columns)[1]) for columns in (0, 80))
    assert without == plain


@pytest.mark.slow
def test_colours_only_on_a_terminal(tmp_path: Path) -> None:
    _, shown = on_terminal("check", STEPS)
    assert without_bars(shown).startswith(f"{ESCAPE}1mYaw runs{ESCAPE}0m\n")
    plain = without_bars(on_terminal("check", STEPS, TERM="dumb")[1])
    assert plain.startswith("Yaw runs\n") and ESCAPE not in plain
    status, refused = on_terminal("check", tmp_path)
    assert status == 1
    refused = without_bars(refused)
    head = f"{ESCAPE}31m{ESCAPE}1mError:{ESCAPE}0m "
    assert refused.startswith(head)
    told = refused.removeprefix(head)
    assert len(told.splitlines()) > 1 and max(map(len, told.splitlines())) <= 80
    assert "no logs in this directory; give files that end in" in " ".join(told.split())


@pytest.mark.slow
def test_a_campaign_on_a_terminal_and_in_a_pipe(tmp_path: Path, run: Callable[..., Result]) -> None:
    campaign = make_small_campaign(tmp_path / "pool")
    status, said = on_terminal("run", campaign, "-o", tmp_path / "a", "--until", "fit-thrusters", NO_COLOR="1")
    assert status == 0
    assert re.search(r"2/2 fit-thrusters \[#+\.+\] 1/2", said)
    assert re.search(r"2/2 fit-thrusters: done, \d+ s \(no result yet\)\.\n", said)
    drawn = [line.rpartition("\r")[2] for line in said.split("\n")]
    assert not any("[#" in line for line in drawn)  # every bar was taken away again
    piped = run("run", campaign, "-o", tmp_path / "b", "--until", "fit-thrusters")
    assert re.fullmatch(r"(./2 [\w-]+: done, \d+ s \(no result yet\)\.\n){2}", piped.stderr)
    again = run("run", campaign, "-o", tmp_path / "b", "--until", "fit-thrusters")
    assert [line.partition(" (")[0] for line in again.stderr.splitlines()] == [
        "1/2 check: kept",
        "2/2 fit-thrusters: kept",
    ]
    assert run("run", campaign, "-o", tmp_path / "b", "--until", "fit-thrusters", "-q").stderr == ""
    assert ESCAPE not in piped.stdout
    assert [line.split()[:2] for line in piped.stdout.splitlines()[2:4]] == [
        ["check", "done"],
        ["fit-thrusters", "done"],
    ]


def test_a_table_in_a_pipe_is_as_wide_as_it_is(run: Callable[..., Result]) -> None:
    found = run("check", STEPS)
    assert max(map(len, found.stdout.splitlines())) > 100
    assert ESCAPE not in found.stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_a_command(tmp_path: Path) -> None:
    tool = tmp_path / "automarine"
    tool.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m automarine_cli "$@"\n', encoding="utf-8")
    tool.chmod(0o755)
    script = (
        'eval "$(_AUTOMARINE_COMPLETE=bash_source automarine)"; COMP_WORDS=(automarine fit-y); COMP_CWORD=1; '
        '_automarine_completion automarine; echo "${COMPREPLY[@]}"'
    )
    env = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    found = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, env=env, check=False, timeout=PATIENCE_S
    )
    assert found.stdout.split() == ["fit-yaw"], found.stderr


CELLS = st.text(alphabet="abc 0.[]", max_size=30).map(lambda cell: " ".join(cell.split()))


@given(
    grid=st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(CELLS, min_size=n, max_size=n), min_size=1, max_size=5)),
    width=st.integers(30, 120),
)
def test_fitted_tables_lose_nothing(grid: list[list[str]], width: int) -> None:
    right = [i > 0 for i in range(len(grid[0]))]
    wide = text_table(grid, right, (), None)
    fitted = text_table(grid, right, (), width)
    letters = "".join("".join(row[1:]) for row in grid)
    for letter in "abc0.[]":
        assert "".join(fitted).count(letter) >= letters.count(letter)
    if max(map(len, wide)) <= width:
        assert fitted == wide
    if all(len(word) <= 8 for row in grid for word in row):
        assert max(map(len, fitted)) <= width


def test_an_interval_is_never_broken() -> None:
    table = Table("", ("parameter", "estimate", "remark"), (("k", "1.25 [1.23, 1.27]", "a long remark about it"),))
    said = table.to_text(36)
    assert "[1.23, 1.27]" in said and max(map(len, said.splitlines())) <= 36


def test_what_takes_minutes_is_foretold_in_a_pipe_and_on_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    for progress in (terminal_progress(), Bar()):
        foretell(progress, "the diagnosis", 59.0)
        foretell(progress, "the diagnosis", 230.0)
        progress("fitting", 0, 10)
        assert capsys.readouterr().err == "The diagnosis takes about 4 min.\n"
    with click.Context(click.Command("quiet")) as ctx:
        ctx.meta["automarine.verbosity"] = -1
        foretell(terminal_progress(), "the diagnosis", 230.0)
    assert capsys.readouterr().err == ""
