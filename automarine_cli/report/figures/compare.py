"""The figure of `compare`: every parameter with its interval, one result below the other."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from automarine_cli.comparison.side_by_side import Side
from automarine_cli.report.figures.style import COLOURS, house_style, panels, shortened

MARKS = "os^Dv<>p"
SHADES = ("black", "blue", "vermilion", "green", "purple", "orange", "sky")
LONGEST_NAME = 28
WIDEST_LABEL = 40  # letters that have room below a panel


@house_style
def compare_figure(sides: Sequence[Side]) -> Figure:
    """Draw a panel for each parameter; the interval of the first result goes on as a band."""
    names = list(dict.fromkeys(name for side in sides for name in side.parameters))
    figure, axes = panels(len(names), 2 if len(names) == 4 else 3, 0.75 + 0.24 * len(sides), 0.0, sharey=True)
    places = range(len(sides), 0, -1)
    for ax, name in zip(axes.flat, names):
        for i, (side, y) in enumerate(zip(sides, places)):
            if (estimate := side.parameters.get(name)) is None:
                continue
            look = {"color": COLOURS[SHADES[i % len(SHADES)]], "marker": MARKS[i % len(MARKS)]}
            ax.plot([*estimate.ci95], [y, y], color=look["color"], lw=1.6)
            ax.plot([estimate.value], [y], ls="", ms=5, label=side.name.replace("$", r"\$"), **look)
            if i == 0:
                ax.axvspan(*estimate.ci95, color="0.92", lw=0, zorder=0)
        unit = next(side.parameters[name].unit for side in sides if name in side.parameters)
        label = f" [{unit}]" if unit not in ("", "1") else ""
        below = len(name + label) > WIDEST_LABEL
        ax.set_xlabel(name + (label.replace(" ", "\n", 1) if below else label), parse_math=False)
        ax.grid(visible=False, axis="y")
    for ax in axes[:, 0]:
        ax.set_yticks(list(places), [shortened(side.name, LONGEST_NAME) for side in sides], parse_math=False)
        ax.set_ylim(0.4, len(sides) + 0.6)
    return figure
