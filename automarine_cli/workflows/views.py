"""How results look in Python: lines for the prompt, tables for notebooks, frames and figures; `Shown` asks for them."""

import textwrap
from typing import Any

import pandas as pd

from automarine_cli.errors import SettingError
from automarine_cli.report.html.markdown import to_html
from automarine_cli.report.tables import Table
from automarine_cli.workflows.view_kinds import VIEWS, View

WIDTH = 110  # letters of a line at the prompt


def lines(result: object) -> list[str]:
    """A few lines: what it is, and the numbers that matter."""
    return [part for line in _view(result).lines(result) for part in _wrapped(line)]


def frame(result: object) -> pd.DataFrame:
    """The numbers, one row a parameter, run or score."""
    return pd.DataFrame(list(_view(result).rows(result)))


def html(result: object) -> str:
    """The tables, or the sentences, as HTML in which everything that came from files is escaped."""
    tables = [table for table in _view(result).tables(result) if isinstance(table, Table)]
    return to_html("\n".join(table.to_markdown() for table in tables), lambda place, said: "").html


def figure(result: object, what: str | None) -> Any:
    """One of the result's figures. Raises SettingError with those that there are."""
    drawn = _view(result).figures(result)
    if not drawn:
        raise SettingError(
            f"a {type(result).__name__} has no figure; fit or validate its runs, and plot that"
        )
    name = next(iter(drawn)) if what is None else what
    if name not in drawn:
        raise SettingError(f"there is no figure {name!r}; known are {', '.join(drawn)}")
    return drawn[name]()


def _view(result: object) -> View:
    return next(view for kind, view in VIEWS.items() if isinstance(result, kind))


def _wrapped(line: str) -> list[str]:
    inner = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(
        line, WIDTH, subsequent_indent=inner, break_on_hyphens=False, drop_whitespace=True
    ) or [""]
