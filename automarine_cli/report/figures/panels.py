"""What a page needs to show values under the pointer: where each panel of a figure lies, and what it measures.

Matplotlib's SVG holds shapes only. `mark` gives the groups of panels, axes and lines names, and `described` adds
the panels as plain data (attribute `data-panels` of the root), so that a script can turn places into values.
"""

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.sax.saxutils import quoteattr

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter

POINTS_PER_INCH = 72
SYMBOLS = {
    r"\psi": "ψ",
    r"\tau": "τ",
    r"\omega": "ω",
    r"\,": " ",
    r"\ln": "ln ",
    r"\cosh": "cosh ",
    r"\sqrt": "√",
}


def mark(figure: Figure) -> None:
    """Name the groups of the SVG: `panel0`, `panel0-x`, `panel0-y`, `panel0-line0` and so on."""
    for i, axes in _panels(figure):
        axes.set_gid(f"panel{i}")
        axes.xaxis.set_gid(f"panel{i}-x")
        axes.yaxis.set_gid(f"panel{i}-y")
        for k, line in enumerate(_lines(axes)):
            line.set_gid(f"panel{i}-line{k}")


def described(svg: bytes, figure: Figure) -> bytes:
    """The SVG with its panels as data; to be called when the layout is settled, which saving does."""
    text = json.dumps([_panel(f"panel{i}", axes, figure) for i, axes in _panels(figure)], ensure_ascii=False)
    attribute = f"<svg data-panels={quoteattr(text)} "
    return svg.replace(b"<svg ", attribute.encode("utf-8", "backslashreplace"), 1)


def plain(label: str) -> str:
    """A label without the marks of mathematics: `Heading $\\psi$ [deg]` is `Heading ψ [deg]`."""
    for mark_up, letter in SYMBOLS.items():
        label = label.replace(mark_up, letter)
    return re.sub(r"[${}\\]", "", label)


def _panels(figure: Figure) -> Iterator[tuple[int, Axes]]:
    """Axes that measure something: no colour bars, none switched off."""
    for i, axes in enumerate(figure.axes):
        if axes.axison and axes.get_label() != "<colorbar>":
            yield i, axes


def _lines(axes: Axes) -> list[Line2D]:
    """Lines in the units of the axes, not those drawn from edge to edge."""
    return [line for line in axes.lines if line.get_transform() == axes.transData]


def _panel(name: str, axes: Axes, figure: Figure) -> dict[str, Any]:
    """Box in the units of the SVG (left, top, right, bottom), limits, labels and lines of one panel."""
    width, height = (POINTS_PER_INCH * inch for inch in figure.get_size_inches())
    place = axes.get_position()
    box = (place.x0 * width, (1 - place.y1) * height, place.x1 * width, (1 - place.y0) * height)
    numbers = all(
        dof.get_scale() == "linear" and type(dof.get_major_formatter()) is ScalarFormatter
        for dof in (axes.xaxis, axes.yaxis)
    )
    labels = [line.get_label() for line in _lines(axes)]
    return {
        "id": name,
        "box": [round(float(side), 3) for side in box],
        "x": [float(f"{limit:.6g}") for limit in axes.get_xlim()],
        "y": [float(f"{limit:.6g}") for limit in axes.get_ylim()],
        "says": [_said(axes, figure, "x"), _said(axes, figure, "y")],
        "zooms": numbers,
        "lines": [plain(str(label)) if not str(label).startswith("_") else "" for label in labels],
    }


def _said(axes: Axes, figure: Figure, way: str) -> str:
    """The label of an axis; of inner panels that of the nearest one below, or to the left, which stands for them."""
    across, along = ("x0", "y0") if way == "x" else ("y0", "x0")
    here = axes.get_position()
    beside = [
        other
        for _, other in _panels(figure)
        if abs(getattr(other.get_position(), across) - getattr(here, across)) < 1e-3
        and getattr(other.get_position(), along) <= getattr(here, along)
    ]
    nearest = sorted(beside, key=lambda other: -getattr(other.get_position(), along))
    labels = (other.get_xlabel() if way == "x" else other.get_ylabel() for other in nearest)
    return plain(" ".join(next((label for label in labels if label), "").split()))
