"""Where the gap is: small multiples, one a variable, and a heat map of runs by time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, Row, Variable, Where
from automarine_cli.dofs import Dof
from automarine_cli.report.figures.diagnosis_words import BEFORE, MARK, in_words
from automarine_cli.report.figures.style import PAGE_IN, house_style, new_figure

MOST_PANELS = 12
COLUMNS = 4


def where_figure(diagnosis: Diagnosis) -> Figure:
    """Small multiples, one a variable, most significant first, above a heat map of runs by time."""
    return where_panels(diagnosis.where, diagnosis.words)


@house_style
def where_panels(where: Where, words: str, units: str = "runs", less: str = "simulated") -> Figure:
    """The same with the verdict in any `words`; `units` are what chance turns the sign of, `less` is what the measured
    is compared with."""
    shown = sorted(where.variables, key=lambda v: (v.p_value, -float(np.abs(v.telling.t).max())))[:MOST_PANELS]
    rows = -(-len(shown) // COLUMNS)
    heights = (*(1.55 for _ in range(rows)), 2.6)
    figure, grid = new_figure(rows + 1, COLUMNS, PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid[:rows].ravel()
    for axes, variable in zip(panels, shown):
        bins_panel(axes, variable, in_words(variable, where.dof), _look(variable.telling, where.dof))
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    place = grid[rows, 0].get_gridspec()
    for axes in grid[rows]:
        axes.remove()
    heat = figure.add_subplot(place[rows, :])
    _heat_map(figure, heat, where, less)
    out = sum(bool(variable.stands_out.any()) for variable in where.variables)
    told = (
        f"The error depends on {out} of {len(where.variables)} variables (yellow)"
        if out
        else f"The error depends on none of {len(where.variables)} variables"
    )
    figure.legend(handles=where_handles(units), loc="outside lower center", ncols=2)
    figure.suptitle(f"{told}. Verdict: {words}")
    return figure


def where_handles(units: str) -> list[Patch]:
    """Explain the colours of the panels; `units` are those of chance."""
    return [
        Patch(color=MARK, alpha=0.45, label="significant"),
        Patch(color=BEFORE, alpha=0.3, label=f"mean ± 2 standard errors ({units} as units)"),
    ]


NARROWEST = 0.04
"""Share of its panel that a marked region takes at least: a narrower one could not be seen."""


def bins_panel(axes: Axes, variable: Variable, label: str, gap_label: str) -> None:
    """Draw the most telling row of one variable as steps with a band; bins that stand out are shaded."""
    row = variable.telling
    out = bool(variable.stands_out.any())
    wide = NARROWEST * float(variable.edges[-1] - variable.edges[0])
    for begin, end, mark in zip(variable.edges[:-1], variable.edges[1:], variable.stands_out):
        if mark:
            aside = max(wide - (end - begin), 0.0) / 2.0
            axes.axvspan(begin - aside, end + aside, color=MARK, alpha=0.45, linewidth=0, zorder=0)
    have = np.isfinite(row.mean)
    colour = BEFORE if out else "0.45"
    axes.axhline(0.0, color="0.3", linewidth=0.6, zorder=1)
    x = np.where(np.isfinite(variable.middle), variable.middle, 0.5 * (variable.edges[1:] + variable.edges[:-1]))
    axes.fill_between(
        x[have], (row.mean - 2 * row.error)[have], (row.mean + 2 * row.error)[have],
        color=colour, alpha=0.3, linewidth=0,
    )  # fmt: skip
    axes.plot(x[have], row.mean[have], "o-", color=colour, markersize=2.5, linewidth=1.0)
    most = float(np.max(np.abs(row.mean[have]) + 2 * np.nan_to_num(row.error[have]), initial=1e-9))
    axes.set_ylim(-1.15 * most, 1.15 * most)
    span = float(np.ptp(variable.edges))
    axes.set_xlim(float(variable.edges[0]) - 0.02 * span, float(variable.edges[-1]) + 0.02 * span)
    axes.set_xlabel(label, labelpad=1, fontsize=7, parse_math=False)
    axes.set_ylabel(gap_label, labelpad=1, fontsize=6.5)
    axes.set_title(
        f"p = {variable.p_value:.2g}" if out else "within chance",
        fontsize=7, fontweight="bold" if out else "normal", color="black" if out else "0.45", pad=2,
    )  # fmt: skip
    axes.tick_params(labelsize=6)


def _look(row: Row, dof: Dof) -> str:
    """What the vertical axis shows."""
    force = dof.words.force
    if row.kind == SIZE:
        return "log gap of the run"
    if row.unit == "%":
        return "own thrust [%]" + (f" × {dof.words.way}" if row.directed else "")
    word = {THRUST: "gap, equal thrust", dof.words.position: "gap"}.get(row.kind, f"missing {row.kind}")
    return f"{word} [{row.unit}]" + (f"\nalong the {force}" if row.directed else "")


def _heat_map(figure: Figure, axes: Axes, where: Where, less: str) -> None:
    """Residual headings, runs in order of their moment by time."""
    dof = where.dof
    order = np.argsort(where.mean_moment, kind="stable")
    ends = np.where(where.seen, where.time, 0.0).max(axis=1)
    grid = np.linspace(0.0, float(ends.max()), 240)
    image = np.full((len(order), len(grid)), np.nan)
    for line, i in enumerate(order):
        time, gap = where.time[i][where.seen[i]], dof.shown(where.residual[i][where.seen[i]])
        width = max(1, round(len(time) / 60))
        smooth = np.convolve(gap, np.ones(width), "same") / np.convolve(np.ones(len(gap)), np.ones(width), "same")
        image[line] = np.where(grid <= time[-1], np.interp(grid, time, smooth, left=np.nan), np.nan)
    most = max(float(np.nanquantile(np.abs(image), 0.99)), dof.shown(where.floor))
    mesh = axes.imshow(
        image, aspect="auto", origin="lower", cmap="PuOr", vmin=-most, vmax=most, interpolation="nearest",
        extent=(0.0, float(grid[-1]), -0.5, len(order) - 0.5),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axes, pad=0.01)
    bar.set_label(f"measured − {less} [{dof.units.shown}]", fontsize=7)
    ticks = np.unique(np.linspace(0, len(order) - 1, min(len(order), 7)).round().astype(int))
    axes.set_yticks(ticks, [f"{where.mean_moment[order[i]]:.2g}" for i in ticks])
    axes.set_ylabel(f"runs by mean {dof.words.force} [{where.moment_unit}]")
    axes.set_xlabel("time in the run [s]")
    axes.grid(False)
