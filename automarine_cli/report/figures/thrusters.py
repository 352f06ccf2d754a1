"""The figure of `fit-thrusters`: measured thrust, the chosen map and the square law, residuals."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from automarine_cli.fits.thruster_analysis import Analysis
from automarine_cli.fits.thruster_result import ThrusterFit
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, legend, new_figure

SHADES = ("#000000", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#D55E00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "h", "*", "p")
CROWD = 60  # more points than this are drawn smaller


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Thrust and residuals of one thruster against its control signal; one marker a voltage."""
    figure, axes = new_figure(2, 1, PAGE_IN * 0.8, 5.6, sharex=True, height_ratios=(2.2, 1.0))
    thrust, rest = axes[:, 0]
    separate = len(result.voltages) > 1 and _apart(result)
    _measured(thrust, result)
    analysis = result.analysis
    if separate:
        for index, (_, one) in enumerate(result.voltages):
            first, colour = index == 0, SHADES[index % len(SHADES)]
            _line(
                thrust,
                one,
                True,
                0.7,
                color=colour,
                linestyle=(0, (4, 1.5)),
                label="square law at each voltage" if first else "_",
            )
            _line(thrust, one, False, 1.3, color=colour, label="chosen map at each voltage" if first else "_")
    else:
        _line(
            thrust,
            analysis,
            True,
            1.3,
            color=COLOURS["vermilion"],
            linestyle=(0, (5, 1.5)),
            label="square law",
        )
        _line(
            thrust,
            analysis,
            False,
            1.3,
            color=COLOURS["blue"],
            label=f"chosen: {analysis.selection.chosen.form.name}",
        )
    _residuals(rest, result, separate)
    unit = analysis.n_unit or "unit as logged"
    thrust.set_ylabel("Thrust of one thruster [N]")
    rest.set_ylabel("Measured − fitted [N]")
    rest.set_xlabel(f"Control signal n [{unit}]")
    legend(thrust, loc="upper left")
    legend(rest, loc="best", ncols=2)
    return figure


def _apart(result: ThrusterFit) -> bool:
    """Whether one map cannot serve all voltages: its error is over three times that of a map for each."""
    pooled = result.analysis.selection.chosen.rmse
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
    points = result.points
    size = 2.0 if len(points) > CROWD else 4.0
    good = points.flag == ""
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    for label, here, colour, marker in _groups(result):
        shown = here & good
        spread = np.where(np.isfinite(points.spread), points.spread, 0.0)
        axes.errorbar(
            points.n[shown],
            points.force[shown],
            yerr=spread[shown] if np.any(spread[shown]) else None,
            fmt=marker,
            color=colour,
            markersize=size,
            elinewidth=0.8,
            capsize=2.0,
            linestyle="none",
            label=label + (" ± standard deviation of samples" if np.any(spread[shown]) else ""),
            alpha=0.45 if len(points) > CROWD else 1.0,
            zorder=2,
        )
    if not np.all(good):
        axes.plot(
            points.n[~good],
            points.force[~good],
            "x",
            color=COLOURS["vermilion"],
            markersize=6.0,
            markeredgewidth=1.4,
            linestyle="none",
            label="contradicts its neighbours",
            zorder=4,
        )


def _line(axes: Axes, analysis: Analysis, square: bool, width: float, **style: Any) -> None:
    """One map over the range that it was measured in, both directions that it has."""
    n = analysis.points.n
    along = np.linspace(float(np.min(n, initial=0.0)), float(np.max(n, initial=0.0)), 801, dtype=float)
    axes.plot(along, analysis.fitted(along, square=square), linewidth=width, zorder=3, **style)


def _residuals(axes: Axes, result: ThrusterFit, separate: bool) -> None:
    """Residuals of chosen map (filled) and square law (open), or of each voltage's own chosen map."""
    points, analysis = result.points, result.analysis
    good = points.flag == ""
    size = 2.0 if len(points) > CROWD else 3.5
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    if not separate:
        square = points.force - analysis.fitted(points.n, square=True)
        axes.plot(
            points.n[good],
            square[good],
            "o",
            color=COLOURS["vermilion"],
            markerfacecolor="none",
            markeredgewidth=0.7,
            markersize=size + 1.0,
            linestyle="none",
            label="square law",
        )
        chosen = points.force - analysis.fitted(points.n)
        axes.plot(
            points.n[good],
            chosen[good],
            "o",
            color=COLOURS["blue"],
            markersize=size,
            linestyle="none",
            label=f"chosen: {analysis.selection.chosen.form.name}",
        )
        return
    for (_, here, colour, marker), (_, one) in zip(_groups(result), result.voltages):
        shown = here & good
        axes.plot(
            points.n[shown],
            points.force[shown] - one.fitted(points.n[shown]),
            marker,
            color=colour,
            markersize=size,
            linestyle="none",
        )
