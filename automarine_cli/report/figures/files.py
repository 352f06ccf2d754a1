"""Figures into a folder of results: drawn last and one by one, and one that cannot be drawn is a warning there."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from matplotlib.figure import Figure

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import Each
from automarine_cli.pipeline.results_folder import Attempt, ResultFolder, attempted
from automarine_cli.report.figures.style import FORMATS

Draw = Callable[[], Figure]
Files = tuple[tuple[str, bytes], ...]
"""Names and contents."""


def refuse_unknown(formats: Sequence[str]) -> None:
    """Raise SettingError for a format of figures that there is not: before any work is done."""
    for kind in formats:
        if kind not in FORMATS:
            raise SettingError(f"figure format {kind!r} is not known; known are {', '.join(FORMATS)}")


def drawn(name: str, draw: Draw, formats: Sequence[str]) -> Attempt[Files]:
    """The figure as `name.format` in each format."""

    def work() -> Files:
        figure = draw()
        return tuple((f"{name}.{kind}", FORMATS[kind](figure)) for kind in formats)

    return attempted(f"The figure {name} could not be drawn", work)


def write_figure(folder: ResultFolder, figure: Attempt[Files]) -> None:
    """The figure's files into the folder, or the warning that there are none."""
    for name, content in folder.taken(figure) or ():
        folder.write(name, content)


def write_figures(
    folder: ResultFolder, figures: Mapping[str, Draw], formats: Sequence[str], each: Each | None = None
) -> None:
    """Each figure by its name, in each format; each is drawn when the one before is written, or all by `each`."""
    if each is None:
        for name, draw in figures.items():
            write_figure(folder, drawn(name, draw, formats))
    else:
        for figure in each(partial(_drawn, formats), list(figures.items()), "drawing figures"):
            write_figure(folder, figure)


def _drawn(formats: Sequence[str], figure: tuple[str, Draw]) -> Attempt[Files]:
    return drawn(*figure, formats)
