"""What a vector figure tells of itself: its panels with their axes, and the series in them, as data in the SVG. The
page's script reads it: a series is found by its id, and the drawing gives the points."""

import json
import re
import unicodedata
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

POINTS_PER_INCH = 72.0  # an SVG counts in points
SAME_PLACE = 1e-3  # of a figure: panels whose edges differ by less stand in one row or column


def with_readings(svg: bytes, figure: Figure) -> bytes:
    """Put the readings of a drawn figure, whose series have their ids, at the end of its SVG."""
    before, end, after = svg.rpartition(b"</svg>")
    text = escape(json.dumps(panels(figure), separators=(",", ":")), quote=False)
    return b"".join([before, f' <metadata id="readings">{text}</metadata>\n'.encode(), end, after])


def panels(figure: Figure) -> list[dict[str, Any]]:
    """List the panels with series: box from the upper left [pt], both axes, series. Every series of lines and points
    gets an id, the same at each call; bars, of which there are few, have their points here."""
    width, height = POINTS_PER_INCH * figure.get_size_inches()
    looks, described = _legend(figure), list[dict[str, Any]]()
    for number, ax in enumerate(figure.axes, 1):
        place = ax.get_position()
        axes = {side: _axis(ax, side, figure) for side in ("x", "y")}
        if series := list(_series(ax, number, looks)):
            box = [place.x0 * width, (1.0 - place.y1) * height, place.width * width, place.height * height]
            described.append({"box": [round(float(edge), 3) for edge in box], **axes, "series": series})
    return described


def _axis(ax: Axes, side: str, figure: Figure) -> dict[str, Any]:
    """Tell where an axis begins and ends, and its label: where it has none, that of another panel in its row or
    column. Ticks with words give these."""
    axis: Axis = getattr(ax, f"{side}axis")
    ends = [float(end) for end in getattr(ax, f"get_{side}lim")()]
    edges = {other: other.get_position().get_points()[:, "xy".index(side)] for other in figure.axes}
    adjacent = (other for other in figure.axes if np.allclose(edges[other], edges[ax], atol=SAME_PLACE))
    labels = (getattr(other, f"get_{side}label")() for other in (ax, *adjacent))
    told: dict[str, Any] = {"ends": ends, "label": _plain(next(filter(None, labels), side))}
    if axis.get_scale() == "log":
        told["log"] = True
    if isinstance(axis.get_major_formatter(), FuncFormatter):  # which matplotlib sets where ticks are words
        told["words"] = {f"{at:g}": tick.get_text() for at, tick in zip(axis.get_ticklocs(), axis.get_ticklabels())}
    return told


def _series(ax: Axes, number: int, looks: Mapping[object, str]) -> Iterator[dict[str, Any]]:
    bars = [series for series in ax.containers if isinstance(series, BarContainer)]
    inside = {series[0]: str(series.get_label()) for series in ax.containers if isinstance(series, ErrorbarContainer)}
    drawn: list[Artist] = [line for line in ax.lines if line.get_transform() == ax.transData]
    kinds = LineCollection, PathCollection
    drawn += [series for series in ax.collections if isinstance(series, kinds) and _name(series)]
    for place, artist in enumerate(drawn):
        artist.set_gid(f"series_{number}_{place}")
        name = inside.get(artist, _name(artist))
        yield {"id": artist.get_gid(), "name": _plain(name or looks.get(_look(artist), ""))}
    for series in bars:
        along, up = (1.0, 0.5) if series.orientation == "horizontal" else (0.5, 1.0)
        ends = ((bar.get_x() + along * bar.get_width(), bar.get_y() + up * bar.get_height()) for bar in series.patches)
        yield {"name": _plain(_name(series)), "at": [[float(x), float(y)] for x, y in ends]}


def _name(series: Artist | BarContainer) -> str:
    """The label of a series; those that begin with a line are matplotlib's own."""
    label = str(series.get_label())
    return "" if label.startswith("_") else label


def _look(artist: Artist) -> object:
    """Colour and dashes of a line, by which a legend tells it from others; None of anything else."""
    if not isinstance(artist, Line2D):
        return None
    return to_hex(artist.get_color()), str(artist.get_linestyle()), str(artist.get_marker())


def _legend(figure: Figure) -> dict[object, str]:
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes)]
    texts = [
        (_look(handle), text.get_text())
        for legend in legends
        if isinstance(legend, Legend)
        for handle, text in zip(legend.legend_handles, legend.get_texts())
        if handle is not None
    ]
    return {look: text for look, text in texts if look is not None}


def _plain(label: str) -> str:
    """Return a label with its formulas as text: ψ for $\\psi$, k_rr for $k_{rr}$."""
    return re.sub(r"[${}]", "", re.sub(r"\\([a-z]+)", _greek, label)) if "$" in label else label


def _greek(command: re.Match[str]) -> str:
    try:
        return unicodedata.lookup(f"GREEK SMALL LETTER {command[1].upper()}")
    except KeyError:  # another command, or a name from a log
        return command[0]
