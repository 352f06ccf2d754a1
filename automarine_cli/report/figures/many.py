"""Many runs in one picture: drawn as one collection, less what no eye resolves."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from automarine_cli.quantities import Floats

FINE = 400
"""Cells a side of an axes within which points count as one: half a marker, at the size that figures have."""
MANY, ENOUGH = 50_000, 40
"""Points of all lines from which on each keeps about so many: among hundreds of lines no more are told apart."""


def lines(ax: Axes, each: Sequence[Floats], **look: Any) -> None:
    """Lines (N, 2) each, as one collection; `look` goes to it. The axes grow to hold them."""
    if sum(map(len, each)) > MANY:
        each = [line[_some(len(line))] for line in each]
    collection = LineCollection([line for line in each if len(line) > 1], capstyle="projecting", **look)
    collection.set_in_layout(False)  # it stays within the axes: to measure every line for the layout takes its time
    ax.add_collection(collection)
    ax.autoscale_view()


def distinct(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Which of the points (N,) are drawn: of those that lie in one cell of a fine grid the last, in their order."""
    if len(x) < 2:
        return np.arange(len(x))
    cells = [np.floor(FINE * (one - one.min()) / max(float(np.ptp(one)), 1e-300)).astype(np.int64) for one in (x, y)]
    key = (cells[0] * (FINE + 1) + cells[1])[::-1]
    return np.sort(len(x) - 1 - np.unique(key, return_index=True)[1])


def _some(count: int) -> NDArray[np.int64]:
    """Places along a line of `count` points, its ends among them."""
    return np.unique(np.linspace(0, count - 1, min(count, ENOUGH)).round().astype(np.int64)) if count else np.arange(0)
