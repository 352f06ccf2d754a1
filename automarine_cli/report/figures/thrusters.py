"""The figure of `fit-thrusters`: measured thrust, the chosen map and the square law, residuals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from automarine_cli.report.figures.style import COLOURS, PAGE_IN, above_residuals, house_style
from automarine_cli.thrusters.fit import Analysis
from automarine_cli.thrusters.result import ThrusterFit

SHADES = ("#000000", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#D55E00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "h", "*", "p")
DASHES = (0, (5, 1.5))
CROWD = 60  # more points than this are drawn smaller
WORSE = 3.0  # times the error of a map for each voltage, beyond which one map cannot serve all

Group = tuple[str, NDArray[np.bool_], str, str]
"""Points that are drawn alike, each voltage or all: label, mask, colour and marker."""


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Draw thrust and residuals of one thruster against its control signal; one marker a voltage, and a map of each
    voltage where one map cannot serve all."""
    points, pooled, groups = result.points, result.analysis, _groups(result)
    labels = (
        f"Control signal n [{pooled.n_unit or 'unit as logged'}]",
        "Thrust of one thruster [N]",
        "Measured − fitted [N]",
    )
    figure, thrust, residuals = above_residuals(PAGE_IN * 0.8, 5.6, labels)
    thrust.axhline(0.0, color="0.6", lw=0.6)
    good, size = points.flag == "", 2.0 if len(points) > CROWD else 3.5
    _measured(thrust, result, groups)

    def draw(analysis: Analysis, square: bool, drawn: NDArray[np.bool_] | None, form: str, **look: Any) -> None:
        line: dict[str, Any] = {"ls": DASHES, "lw": 0.7} if square else {}
        hollow: dict[str, Any] = {"mfc": "none", "mew": 0.7} if square else {}
        measured = analysis.points.n
        along = np.linspace(float(np.min(measured, initial=0.0)), float(np.max(measured, initial=0.0)), 801)
        thrust.plot(along, analysis.fitted(along, square=square), zorder=3, **line, **look)
        if drawn is not None:
            n = points.n[drawn & good]
            residual = points.force[drawn & good] - analysis.fitted(n, square=square)
            residuals.plot(n, residual, form, ms=size + square, **hollow, **look)

    separate = [analysis.chosen.rmse**2 for _, analysis in result.voltages]
    if len(separate) > 1 and pooled.chosen.rmse > WORSE * np.sqrt(np.mean(separate)):
        for i, ((_, drawn, colour, marker), (_, analysis)) in enumerate(zip(groups, result.voltages)):
            names = ("_", "_") if i else ("square law at each voltage", "chosen map at each voltage")
            draw(analysis, True, None, marker, color=colour, label=names[0])
            draw(analysis, False, drawn, marker, color=colour, label=names[1])
    else:
        name, every = pooled.chosen.form.name, np.ones(len(points), dtype=bool)
        if name != "square":
            draw(pooled, True, every, "o", color=COLOURS["vermilion"], label="square law")
        label = "square law (chosen)" if name == "square" else f"chosen: {name}"
        draw(pooled, False, every, "o", color=COLOURS["blue"], label=label)
    thrust.legend(loc="upper left")
    if len(residuals.get_legend_handles_labels()[0]) > 1:
        residuals.legend(loc="best", ncols=2)
    return figure


def _groups(result: ThrusterFit) -> list[Group]:
    points = result.points
    if len(result.voltages) < 2:
        return [("measured", np.ones(len(points), dtype=bool), COLOURS["black"], "o")]
    volts = np.array([volts for volts, _ in result.voltages])
    nearest = np.argmin(np.abs(np.log(points.voltage)[:, None] - np.log(volts)[None, :]), axis=1)
    return [
        (f"{value:.4g} V", nearest == index, SHADES[index % len(SHADES)], MARKERS[index % len(MARKERS)])
        for index, value in enumerate(volts)
    ]


def _measured(axes: Axes, result: ThrusterFit, groups: Sequence[Group]) -> None:
    """Points with the spread of their samples; those that weigh less as crosses."""
    points, good = result.points, result.points.flag == ""
    size, alpha = (2.0, 0.45) if len(points) > CROWD else (4.0, 1.0)
    for label, mask, colour, marker in groups:
        drawn = mask & good
        spread = np.where(np.isfinite(points.spread), points.spread, 0.0)[drawn]
        has_spread = bool(np.any(spread))
        axes.errorbar(
            points.n[drawn], points.force[drawn], yerr=spread if has_spread else None, fmt=marker, color=colour,
            markersize=size, elinewidth=0.8, capsize=2.0, linestyle="none", alpha=alpha, zorder=2,
            label=label + " ± standard deviation of samples" * has_spread,
        )  # fmt: skip
    if not np.all(good):
        style: dict[str, Any] = {"markersize": 6.0, "markeredgewidth": 1.4, "zorder": 4}
        label = "outlier from its neighbours"
        axes.plot(points.n[~good], points.force[~good], "x", color=COLOURS["vermilion"], label=label, **style)
