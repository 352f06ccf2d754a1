"""How figures look: sized for print, colours that any eye and a grey printer tell apart, same bytes always.

Decorate a function that draws with `@house_style`: it holds for everything drawn inside, whatever the user's
own matplotlib settings say, and leaves them alone afterwards.
"""

import io
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import matplotlib.style
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from automarine_cli.errors import AutomarineError
from automarine_cli.pipeline.parallel import Each
from automarine_cli.pipeline.results_folder import ResultFolder
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.readings import panels as described
from automarine_cli.report.figures.readings import with_readings
from automarine_cli.report.sections import Drawing, figure_file
from automarine_cli.text import printable

# Okabe and Ito (2008), ordered so that neighbours differ in lightness too.
COLOURS = {
    "black": "#000000", "orange": "#E69F00", "blue": "#0072B2", "sky": "#56B4E9", "vermilion": "#D55E00",
    "green": "#009E73", "purple": "#CC79A7", "yellow": "#F0E442", "grey": "#808080",
}  # fmt: skip
MODEL_LINES: dict[str, object] = {"1": (0, (5, 1.5)), "2": (0, (1.2, 1.2)), "3": (0, (5, 1.5, 1.2, 1.5))}
PREFERRED: dict[str, Any] = {"color": COLOURS["blue"], "lw": 1.8, "zorder": 4}
MEASURED_COLOUR = COLOURS["grey"]

TWO_LOOKS: tuple[dict[str, Any], ...] = ({"color": COLOURS["orange"], "ms": 5.0}, {"color": COLOURS["blue"], "ms": 3.0})

PAGE_IN = 7.2  # width of a page [inch]
MAX_SIZES_DRAWN, MAX_RESIDUALS_DRAWN = 30, 3  # whose size is drawn, and whose residuals are
MIN_MARK_PT = 4.0  # of a point in a legend, however small they are drawn
MAX_NAME_BESIDE = 26  # letters that have room beside and above a panel

house_style = matplotlib.style.context(["default", {
    "font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "xtick.labelsize": 7.0, "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0, "figure.titlesize": 9.0, "legend.frameon": True, "legend.framealpha": 0.9,
    "legend.edgecolor": "0.85", "legend.handlelength": 2.6, "axes.grid": True, "axes.axisbelow": True,
    "axes.linewidth": 0.6, "axes.spines.top": False, "axes.spines.right": False, "grid.color": "0.88",
    "grid.linewidth": 0.4, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.linewidth": 1.2,
    "lines.markersize": 3.5, "axes.prop_cycle": cycler(color=list(COLOURS.values())[:-2]), "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
}])  # fmt: skip
"""Decorator (or `with` block once) under which figures are drawn."""


class HouseFigure(Figure):
    """A figure that a notebook shows by itself, in its printed size."""

    def _repr_png_(self) -> tuple[bytes, dict[str, float]]:
        return FIGURE_WRITERS["png"](self), {"width": 100.0 * self.get_figwidth()}


@house_style
def new_figure(
    nrows: int = 1, ncols: int = 1, width_in: float = PAGE_IN, height_in: float = 2.6, **subplots: Any
) -> tuple[Figure, NDArray[Any]]:
    """A figure and its axes, shape (nrows, ncols); `subplots` goes to `Figure.subplots` (`sharex`, ...)."""
    figure = HouseFigure(figsize=(width_in, height_in), layout="constrained")
    axes: NDArray[Any] = np.asarray(figure.subplots(nrows, ncols, squeeze=False, **subplots))
    return figure, axes


@house_style
def _file(kind: str, settings: dict[Any, Any], nameless: Sequence[str], figure: Figure) -> bytes:
    """Return the figure as a file of a kind, the same bytes each time. The layout is found once, for the first file: a
    second search would start where the first one ended and end a hair beside it, and so would every pixel of a colour
    bar."""
    buffer = io.BytesIO()
    with warnings.catch_warnings(), matplotlib.rc_context(settings):
        # the name of a run in letters that the font lacks is drawn as boxes
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        figure.savefig(buffer, format=kind, metadata=dict.fromkeys(nameless))
    figure.set_layout_engine("none")
    return buffer.getvalue()


def _svg(figure: Figure) -> bytes:
    """Return the figure as an SVG with its readings: series have their ids before, panels their places after."""
    described(figure)
    settings = {"svg.hashsalt": "automarine", "svg.fonttype": "none"}  # text stays text
    return with_readings(_file("svg", settings, ("Date", "Creator"), figure), figure)


FIGURE_WRITERS: Mapping[str, Callable[[Figure], bytes]] = {
    "png": partial(_file, "png", {}, ("Software",)),
    "svg": _svg,
    "pdf": partial(_file, "pdf", {"pdf.fonttype": 42}, ("CreationDate", "Creator", "Producer")),
    "slides": partial(_file, "png", {}, ("Software",)),
}
SLIDE_IN, SLIDE_PT, LABEL_PT = (13.33, 7.5), 18.0, 8.0


def above_residuals(width_in: float, height_in: float, labels: tuple[str, str, str]) -> tuple[Figure, Axes, Axes]:
    """A figure with a panel of `labels` x and y, and one of residuals of the third below it."""
    figure, axes = new_figure(2, 1, width_in, height_in, sharex=True, height_ratios=(2.3, 1.0))
    top, bottom = axes[:, 0]
    top.set_ylabel(labels[1])
    bottom.set(xlabel=labels[0], ylabel=labels[2])
    bottom.axhline(0.0, color="0.4", lw=0.6, zorder=1)
    return figure, top, bottom


def legend_below(figure: Figure, *axes: Axes, ncols: int = 3) -> None:
    handles = [handle for ax in axes for handle in ax.get_legend_handles_labels()[0]]
    for mark in figure.legend(handles=handles, loc="outside lower center", ncols=ncols).get_lines():
        mark.set_markersize(max(mark.get_markersize(), MIN_MARK_PT))


@house_style
def panels(count: int, columns: int, row_in: float, beyond_in: float, **subplots: Any) -> tuple[Figure, NDArray[Any]]:
    """Return a page-wide figure with `count` panels, `columns` a row at most, and its axes; those beyond are off."""
    columns = max(min(columns, count), 1)
    rows = max(-(-count // columns), 1)
    figure, axes = new_figure(rows, columns, PAGE_IN, beyond_in + row_in * rows, **subplots)
    for ax in axes.flat[count:]:
        ax.set_axis_off()
    return figure, axes


def model_look(model: str, preferred: str) -> dict[str, Any]:
    """The line of a model: the preferred one bold, the others thin and grey."""
    return PREFERRED if model == preferred else {"color": "0.45", "lw": 0.8, "ls": MODEL_LINES[model], "zorder": 3}


Residuals = tuple[str, Sequence[tuple[Floats, Floats]]]
"""The name of a run, and what each of two models leaves of it: x and error."""


@house_style
def residuals_figure(
    residuals: Sequence[Residuals], labels: Sequence[str], unit: str, floor: float, runs_of: str,
    x_label: str = "time in the run [s]", look: str = "-", beneath: str = "",
) -> Figure:  # fmt: skip
    """Draw what two labelled models leave of the worst runs, and the root mean square of each run, worst first by the
    first model, beside the noise `floor`; errors in the `unit`. The title says what of `runs_of` is left in all, and
    `beneath` stands below it."""
    runs = [(name, lines) for name, lines in residuals if all(len(error) for _, error in lines)]
    sizes = np.array([[np.sqrt(np.mean(error**2)) for _, error in lines] for _, lines in runs]).reshape(-1, 2)
    order = np.argsort(-np.nan_to_num(sizes[:, 0], nan=np.inf), kind="stable")[:MAX_SIZES_DRAWN]
    figure = HouseFigure(figsize=(PAGE_IN, max(4.5, 0.16 * len(order) + 1.2)), layout="constrained")
    places = range(min(len(order), MAX_RESIDUALS_DRAWN) or 1)
    axes: dict[Any, Axes] = figure.subplot_mosaic([[place, "all"] for place in places], width_ratios=(1.6, 1.0))
    for place, i in zip(places, order):
        ax = axes[place]
        ax.sharey(axes[0])
        ax.axhspan(-2.0 * floor, 2.0 * floor, color="0.9", lw=0)
        for line, label, two in zip(runs[i][1], labels, TWO_LOOKS):
            ax.plot(*line, look, lw=0.9, label=label, **two)
        ax.set_title(shortened(runs[i][0], MAX_NAME_BESIDE), parse_math=False)
        ax.set_ylabel(f"error [{unit}]")
    axes[places[-1]].set_xlabel(x_label)
    rows = np.arange(len(order))
    axes["all"].hlines(rows, *np.sort(sizes[order]).T, color="0.7")
    for size, two in zip(sizes[order].T, TWO_LOOKS):
        axes["all"].plot(size, rows, "o", **two)
    axes["all"].axvline(floor, color="0.4", ls=":", label=f"noise of {floor:.2g} {unit}; the band is twice that")
    axes["all"].set_yticks(rows, [shortened(runs[i][0], MAX_NAME_BESIDE) for i in order], parse_math=False)
    axes["all"].invert_yaxis()
    axes["all"].set(xlabel=f"root mean square [{unit}]", xlim=(0.0, 1.05 * float(np.nanmax([*sizes.flat, floor]))))
    legend_below(figure, axes[0], axes["all"])
    every = (np.concatenate([lines[i][1] for _, lines in runs] or [np.zeros(0)]) for i in (0, 1))
    left = [f"{np.sqrt(np.mean(error**2)):.3g} {unit} {label}" for error, label in zip(every, labels) if len(error)]
    figure.suptitle(f"{runs_of}: {', '.join(left)}; noise {floor:.2g} {unit}\n{beneath}".strip())
    return figure


def shortened(name: str, most: int) -> str:
    """Cut a long name of a run at its begin: they differ at their end."""
    return name if len(name) <= most else f"…{name[1 - most :]}"


def limit(axes: Axes, low: float, high: float, reach: float) -> None:
    """Let lines leave the picture where they are further than `reach` from what lies from `low` to `high`."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, low - reach), min(top, high + reach))


def as_slide(figure: Figure) -> Figure:
    """Return the figure as a slide, 16:9, its labels of 18 points and lines as much wider."""
    for text in figure.findobj(Text):
        text.set_fontsize(float(text.get_fontsize()) * SLIDE_PT / LABEL_PT)
    for line in figure.findobj(Line2D):
        line.set_linewidth(2.0 * line.get_linewidth())
    figure.set_size_inches(SLIDE_IN)
    return figure


def write_figures(
    folder: ResultFolder, figures: Mapping[str, Drawing], formats: Sequence[str], each: Each | None = None
) -> None:
    """Write each figure by its name, in each format; each is drawn when the one before is written, or all by `each`."""
    draw, drawings = partial(drawn, formats), list(figures.items())
    for pages in map(draw, drawings) if each is None else each(draw, drawings, "drawing figures"):
        if isinstance(pages, str):
            folder.warn(pages)
            continue
        for name, content in pages.items():
            folder.write(name, content)


def drawn(formats: Sequence[str], drawing: tuple[str, Drawing]) -> dict[str, bytes] | str:
    """Draw a figure into files by name; return a sentence that says why there is none where that fails."""
    name, draw = drawing
    try:
        pages = [kind for kind in formats if kind != "slides"]
        figures = dict.fromkeys(pages, draw() if pages else None)
        figures |= {kind: as_slide(draw()) for kind in formats if kind not in pages}
        return {figure_file(name, kind): FIGURE_WRITERS[kind](figure) for kind, figure in figures.items() if figure}
    except MemoryError:
        raise
    except Exception as problem:
        error = str(problem) if isinstance(problem, AutomarineError) else f"{type(problem).__name__}: {problem}"
        why = printable(" ".join(error.split()).removesuffix(":"))
        return f"The figure {name} could not be drawn ({why}); everything else was written."
