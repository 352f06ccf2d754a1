"""What every result can show of itself to somebody who works in Python: a few lines, a frame, a figure.

How each kind of result looks is told in `workflows.views`, the one place that knows tables, frames and figures;
it is loaded when something is to be shown, so that the results themselves stay plain data.
"""

from importlib import import_module
from typing import Any

VIEWS = "automarine_cli.workflows.views"


class Shown:
    """Base of result classes; their `@dataclass` needs `repr=False`, or its own repr would hide this one."""

    def __repr__(self) -> str:
        """A few lines: what it is, and the numbers that matter with their intervals."""
        return "\n".join(import_module(VIEWS).lines(self))

    def _repr_html_(self) -> str:
        """The tables, for notebooks."""
        return str(import_module(VIEWS).html(self))

    def to_frame(self) -> Any:
        """The numbers as a `pandas.DataFrame`, one row a parameter, run or score."""
        return import_module(VIEWS).frame(self)

    def plot(self, what: str | None = None) -> Any:
        """A `matplotlib.figure.Figure`; `what` chooses where there are several. Raises SettingError for another."""
        return import_module(VIEWS).figure(self, what)
