"""The figure of `fit-thrusters`: measured thrust, the chosen map and the square law, residuals."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, legend, new_figure
from automarine_cli.thrusters.fit import Analysis
from automarine_cli.thrusters.result import ThrusterFit

SHADES = ("#000000", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#D55E00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "h", "*", "p")
DASHES = (0, (5, 1.5))
CROWD = 60  # more points than this are drawn smaller
SQUARE = "square"


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Thrust and residuals of one thruster against its control signal; one marker a voltage."""
    figure, axes = new_figure(2, 1, PAGE_IN * 0.8, 5.6, sharex=True, height_ratios=(2.2, 1.0))
    thrust, rest = axes[:, 0]
    separate = len(result.voltages) > 1 and _apart(result)
    _measured(thrust, result)
    if separate:
        _maps_by_voltage(thrust, result)
        _residuals_by_voltage(rest, result)
    else:
        _maps(thrust, result.analysis)
        _residuals(rest, result)
    thrust.set_ylabel("Thrust of one thruster [N]")
    rest.set_ylabel("Measured − fitted [N]")
    rest.set_xlabel(f"Control signal n [{result.analysis.n_unit or 'unit as logged'}]")
    legend(thrust, loc="upper left")
    if len(rest.get_legend_handles_labels()[0]) > 1:
        legend(rest, loc="best", ncols=2)
    return figure


def _apart(result: ThrusterFit) -> bool:
    """Whether one map cannot serve all voltages: its error is over three times that of a map for each."""
    pooled = result.analysis.chosen.rmse
    separate = np.sqrt(np.mean([one.selection.chosen.rmse**2 for _, one in result.voltages]))
    return bool(pooled > 3.0 * separate)


def _groups(result: ThrusterFit) -> list[tuple[str, NDArray[np.bool_], str, str]]:
    """Label, mask, colour and marker of what is drawn alike: each voltage, or everything."""
    points = result.points
    if len(result.voltages) < 2:
        return [("measured", np.ones(len(points), dtype=bool), COLOURS["black"], "o")]
    volts = np.array([volts for volts, _ in result.voltages])
    nearest = np.argmin(np.abs(np.log(points.voltage)[:, None] - np.log(volts)[None, :]), axis=1)
    return [
        (f"{value:.4g} V", nearest == index, SHADES[index % len(SHADES)], MARKERS[index % len(MARKERS)])
        for index, value in enumerate(volts)
    ]


def _measured(axes: Axes, result: ThrusterFit) -> None:
    """Points with the spread of their samples; those that weigh less as crosses."""
    points = result.points
    crowded = len(points) > CROWD
    good = points.flag == ""
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    for label, here, colour, marker in _groups(result):
        shown = here & good
        spread = np.where(np.isfinite(points.spread), points.spread, 0.0)[shown]
        known = bool(np.any(spread))
        axes.errorbar(
            points.n[shown],
            points.force[shown],
            yerr=spread if known else None,
            fmt=marker,
            color=colour,
            markersize=2.0 if crowded else 4.0,
            elinewidth=0.8,
            capsize=2.0,
            linestyle="none",
            label=label + (" ± standard deviation of samples" if known else ""),
            alpha=0.45 if crowded else 1.0,
            zorder=2,
        )
    if not np.all(good):
        style: dict[str, Any] = {"markersize": 6.0, "markeredgewidth": 1.4, "zorder": 4}
        label = "outlier from its neighbours"
        axes.plot(points.n[~good], points.force[~good], "x", color=COLOURS["vermilion"], label=label, **style)


def _chosen(analysis: Analysis) -> str:
    """Name of the chosen form in a legend."""
    name = analysis.chosen.form.name
    return "square law (chosen)" if name == SQUARE else f"chosen: {name}"


def _line(axes: Axes, analysis: Analysis, square: bool, **style: Any) -> None:
    """One map over the range that it was measured in, both directions that it has."""
    n = analysis.points.n
    along = np.linspace(float(np.min(n, initial=0.0)), float(np.max(n, initial=0.0)), 801, dtype=float)
    axes.plot(along, analysis.fitted(along, square=square), zorder=3, **style)


def _maps(axes: Axes, analysis: Analysis) -> None:
    """The chosen map, and the square law where that is another one."""
    if analysis.chosen.form.name != SQUARE:
        _line(axes, analysis, True, color=COLOURS["vermilion"], linestyle=DASHES, label="square law")
    _line(axes, analysis, False, color=COLOURS["blue"], label=_chosen(analysis))


def _maps_by_voltage(axes: Axes, result: ThrusterFit) -> None:
    """Chosen map (full) and square law (thin, dashed) of each voltage in its colour."""
    for index, (_, one) in enumerate(result.voltages):
        colour = SHADES[index % len(SHADES)]
        labels = ("_", "_") if index else ("square law at each voltage", "chosen map at each voltage")
        _line(axes, one, True, color=colour, linestyle=DASHES, linewidth=0.7, label=labels[0])
        _line(axes, one, False, color=colour, label=labels[1])


def _residuals(axes: Axes, result: ThrusterFit) -> None:
    """Residuals of the chosen map (filled) and of the square law (open)."""
    points, analysis = result.points, result.analysis
    good = points.flag == ""
    size = 2.0 if len(points) > CROWD else 3.5
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    if analysis.chosen.form.name != SQUARE:
        rest = (points.force - analysis.fitted(points.n, square=True))[good]
        style: dict[str, Any] = {"markerfacecolor": "none", "markeredgewidth": 0.7, "markersize": size + 1.0}
        axes.plot(points.n[good], rest, "o", color=COLOURS["vermilion"], label="square law", **style)
    rest = (points.force - analysis.fitted(points.n))[good]
    axes.plot(points.n[good], rest, "o", color=COLOURS["blue"], markersize=size, label=_chosen(analysis))


def _residuals_by_voltage(axes: Axes, result: ThrusterFit) -> None:
    """Residuals of each voltage's own chosen map."""
    points = result.points
    good = points.flag == ""
    size = 2.0 if len(points) > CROWD else 3.5
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    for (_, here, colour, marker), (_, one) in zip(_groups(result), result.voltages):
        n, force = points.n[here & good], points.force[here & good]
        axes.plot(n, force - one.fitted(n), marker, color=colour, markersize=size)
