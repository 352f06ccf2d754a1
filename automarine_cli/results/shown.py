"""What every result can show of itself to somebody who works in Python: tables, a frame, a figure."""

from typing import Any, ClassVar

from automarine_cli.pipeline.records import Document


class Shown:
    """Base of result classes; their `@dataclass` needs `repr=False`, or its own repr would hide this one."""

    sections_of: ClassVar[Any]
    """Gives `report.sections.Sections` of a result; set there."""

    def __repr__(self) -> str:
        """The tables and sentences that the terminal shows."""
        text: str = self.sections_of(self).text()
        return text

    def _repr_html_(self) -> str:
        """The tables, for notebooks."""
        html: str = self.sections_of(self).html()
        return html

    def to_frame(self) -> Any:
        """Return the numbers as a `pandas.DataFrame`, one row a parameter, run or score."""
        return self.sections_of(self).frame()

    def plot(self, figure: str | None = None) -> Any:
        """Draw a `matplotlib.figure.Figure`, by default the first. Raises SettingError with the names there are."""
        return self.sections_of(self).figure(figure)

    def document(self, option: str) -> Document:
        """Return the file that stands for this result where an option of that name wants one. Raises TypeError."""
        raise TypeError(f"a {type(self).__name__} is no {option}; give the result of a fit, or a file")
