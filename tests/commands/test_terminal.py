"""What a person sees on a terminal, and a program in a pipe: widths, colours, bars, a piped file."""

import time
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import Result
from hypothesis import given
from hypothesis import strategies as st
from pseudo_terminal import ESCAPE, on_terminal, without_bars
from repository import SAMPLE_RUNS

from automarine_cli.commands.diagnose import FIRST_LOOKS, foretell
from automarine_cli.commands.terminal import Bar, terminal_progress
from automarine_cli.report.tables import Table, text_table

Run = Callable[..., Result]
STEPS = SAMPLE_RUNS / "hidden_one"


@pytest.mark.parametrize(
    ("columns", "least", "most"),
    [(60, 40, 60), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((200, 100, 200), (0, 61, 80)))],
)
def test_tables_fit_the_terminal(columns: int, least: int, most: int) -> None:
    """One that tells no width has 80 columns."""
    status, printed = on_terminal("check", "-v", STEPS, columns=columns, NO_COLOR="1")
    printed = without_bars(printed)
    assert status == 0 and ESCAPE not in printed
    assert least <= max(map(len, printed.splitlines())) <= most
    assert printed.count("tau_+0.1 ") == (1 if columns == 200 else printed.count("\nrun "))
    assert {"jitter", "noise", "levels", "turns"} <= set(printed.split())


def test_a_table_in_a_pipe_is_as_wide_as_it_is(run: Run) -> None:
    result = run("check", "-v", STEPS)
    assert max(map(len, result.stdout.splitlines())) > 100
    assert ESCAPE not in result.stdout


@pytest.mark.slow
def test_colours_only_on_a_terminal(tmp_path: Path) -> None:
    assert f"\n{ESCAPE}1mYaw runs{ESCAPE}0m\n" in without_bars(on_terminal("check", "-v", STEPS)[1])
    plain = without_bars(on_terminal("check", "-v", STEPS, TERM="dumb")[1])
    assert "\nYaw runs\n" in plain and ESCAPE not in plain
    status, refused = on_terminal("check", tmp_path)
    head, refused = f"{ESCAPE}31m{ESCAPE}1mError:{ESCAPE}0m ", without_bars(refused)
    assert status == 1 and refused.startswith(head)
    lines = refused.removeprefix(head).splitlines()
    assert len(lines) > 1 and max(map(len, lines)) <= 80
    assert "no logs in this directory; give files that end in" in " ".join(" ".join(lines).split())


CELLS = st.text(alphabet="abc 0.[]", max_size=30).map(lambda cell: " ".join(cell.split()))


@given(
    grid=st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(CELLS, min_size=n, max_size=n), min_size=1, max_size=5)),
    width=st.integers(30, 120),
)
def test_fitted_tables_lose_nothing(grid: list[list[str]], width: int) -> None:
    right = [i > 0 for i in range(len(grid[0]))]
    wide, fitted = (text_table(grid, right, (), limit) for limit in (None, width))
    letters = "".join("".join(row[1:]) for row in grid)
    for letter in "abc0.[]":
        assert "".join(fitted).count(letter) >= letters.count(letter)
    if max(map(len, wide)) <= width:
        assert fitted == wide
    if all(len(word) <= 8 for row in grid for word in row):
        assert max(map(len, fitted)) <= width


def test_an_interval_is_never_broken() -> None:
    table = Table("", ("parameter", "estimate", "remark"), (("k", "1.25 [1.23, 1.27]", "a long remark about it"),))
    text = table.to_text(36)
    assert "[1.23, 1.27]" in text and max(map(len, text.splitlines())) <= 36


def test_what_does_not_fit_is_named_or_follows_below() -> None:
    table = Table("", ("parameter", "estimate", "remark"), (("k", "1.25 [1.23, 1.27]", "unforeseeable"),))
    brief, full = table.to_text(30, full=False), table.to_text(30)
    assert "unforeseeable" not in brief and brief.splitlines()[-1] == "With -v also: remark."
    assert "unforeseeable" in full and full.count("parameter") == 2


def test_what_takes_minutes_is_foretold_in_a_pipe_and_on_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    for progress in (terminal_progress(), Bar()):
        foretell(progress, time.monotonic() - 59.0 / FIRST_LOOKS)
        foretell(progress, time.monotonic() - 230.0 / FIRST_LOOKS)
        progress("fitting", 0, 10)
        assert capsys.readouterr().err == "The diagnosis takes about 4 min.\n"
    with click.Context(click.Command("quiet")) as ctx:
        ctx.meta["automarine.verbosity"] = -1
        foretell(terminal_progress(), time.monotonic() - 230.0 / FIRST_LOOKS)
    assert capsys.readouterr().err == ""
