"""The figure of `compare`: every parameter with its interval, one result below the other."""

from collections.abc import Sequence
from textwrap import fill

from matplotlib.figure import Figure

from automarine_cli.comparison.side_by_side import Difference, Side
from automarine_cli.report.figures.style import COLOURS, house_style, panels, shortened
from automarine_cli.report.tables import number

LONGEST_NAME, WIDEST_LABEL = 28, 40  # letters that have room beside and below a panel


@house_style
def compare_figure(sides: Sequence[Side], differences: Sequence[Difference]) -> Figure:
    """Draw a panel for each parameter; the interval of the first result goes on as a band."""
    names = list(dict.fromkeys(name for side in sides for name in side.parameters))
    figure, axes = panels(len(names), 3, 0.75 + 0.32 * len(sides), 0.0, sharey=True)
    for ax, name in zip(axes.flat, names):
        apart = {difference.of: difference for difference in differences if difference.parameter == name}
        for i, side in enumerate(sides):
            if (estimate := side.parameters.get(name)) is None:
                continue
            ax.plot(estimate.ci95, [i, i], color=COLOURS["blue"], lw=1.6)
            ax.plot([estimate.value], [i], "o", color=COLOURS["blue"], ms=5)
            if i == 0:
                ax.axvspan(*estimate.ci95, color="0.92", lw=0, zorder=0)
            if (verdict := apart.get(side.name)) is not None:
                says = f"{verdict.verdict}, p = {number(verdict.p_value, 2)}"
                look = {"ha": "center", "va": "bottom", "fontsize": 7, "transform": ax.get_yaxis_transform()}
                ax.text(0.5, i - 0.22, says, **look)
            ax.set_xlabel(fill(f"{name} [{estimate.unit}]".removesuffix(" [1]"), WIDEST_LABEL), parse_math=False)
        ax.grid(visible=False, axis="y")
    for ax in axes[:, 0]:
        ax.set_yticks(range(len(sides)), [shortened(side.name, LONGEST_NAME) for side in sides], parse_math=False)
        ax.set_ylim(len(sides) - 0.4, -0.6)
    return figure
