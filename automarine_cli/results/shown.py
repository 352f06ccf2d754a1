"""What every result can show of itself to somebody who works in Python: a few lines, a frame, a figure.

How each kind is shown its command says, which lists it here; the results themselves stay plain data.
"""

from typing import Any, ClassVar

from automarine_cli.pipeline.records import Document


class Shown:
    """Base of result classes; their `@dataclass` needs `repr=False`, or its own repr would hide this one."""

    views: ClassVar[dict[type, Any]] = {}
    """A `View` of the commands, by the kind of result."""

    def __repr__(self) -> str:
        """A few lines: what it is, and the numbers that matter with their intervals."""
        return str(self.view.text(self))

    def _repr_html_(self) -> str:
        """The tables, for notebooks."""
        return str(self.view.html(self))

    def to_frame(self) -> Any:
        """The numbers as a `pandas.DataFrame`, one row a parameter, run or score."""
        return self.view.frame(self)

    def plot(self, what: str | None = None) -> Any:
        """A `matplotlib.figure.Figure`; `what` chooses where there are several. Raises SettingError for another."""
        return self.view.figure(self, what)

    def document(self, option: str) -> Document:
        """The file that stands for this result where an option of that name wants one. Raises TypeError for none."""
        raise TypeError(f"a {type(self).__name__} is no {option}; give the result of a fit, or a file")

    @property
    def view(self) -> Any:
        """How results of this kind are shown."""
        return self.views[type(self)]
