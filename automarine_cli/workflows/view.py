"""How the results of a command are shown: at the terminal, and to somebody who works in Python."""

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.report.html.markdown import to_html
from automarine_cli.report.tables import Table

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")
Row = dict[str, object]
Figures = Mapping[str, Callable[[], Any]]
"""Figures by name, drawn when they are called for."""

WIDTH = 110  # letters of a line at the prompt


@dataclass(frozen=True)
class View(Generic[Result]):
    """How one kind of result is shown: tables and sentences for the terminal, a few lines and rows of numbers for
    Python, and figures, of which the first is drawn where none is asked for."""

    says: Callable[[Result], Sequence[Table | str]]
    lines: Callable[[Result], Iterator[str]]
    rows: Callable[[Result], Iterator[Row]] = lambda result: iter(())
    figures: Callable[[Result], Figures] = lambda result: {}

    def text(self, result: Result) -> str:
        """A few lines: what it is, and the numbers that matter."""
        return "\n".join(part for line in self.lines(result) for part in _wrapped(line))

    def frame(self, result: Result) -> "pd.DataFrame":
        """The numbers, one row a parameter, run or score."""
        import pandas as pd  # here, as most commands make no table of these

        return pd.DataFrame(list(self.rows(result)))

    def html(self, result: Result) -> str:
        """The tables as HTML in which everything that came from files is escaped."""
        tables = [one.to_markdown() for one in self.says(result) if isinstance(one, Table)]
        return to_html("\n".join(tables), lambda place, said: "").html

    def figure(self, result: Result, what: str | None) -> Any:
        """One of the result's figures. Raises SettingError with those that there are."""
        drawn = self.figures(result)
        if not drawn:
            raise SettingError(f"a {type(result).__name__} has no figure; fit or validate its runs, and plot that")
        name = next(iter(drawn)) if what is None else what
        if name not in drawn:
            raise SettingError(f"there is no figure {name!r}; known are {', '.join(drawn)}")
        return drawn[name]()


def _wrapped(line: str) -> list[str]:
    inner = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(line, WIDTH, subsequent_indent=inner, break_on_hyphens=False, drop_whitespace=True) or [""]
