"""Figures of a diagnosed thruster map: where it goes wrong, why, and the gap before and after."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.diagnosis_where import bins_panel, where_handles
from automarine_cli.report.figures.diagnosis_why import evidence_bars
from automarine_cli.report.figures.diagnosis_words import AFTER, BEFORE
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, legend, new_figure
from automarine_cli.thrusters.family import ALPHA, BollardData, Fitted

LABEL = {"n": "control signal n", "voltage": "supply voltage", "run-order": "run order"}


@house_style
def where_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw the gap of the map in the bins of every variable; bins that stand out are shaded."""
    variables = result.where.variables
    figure, grid = new_figure(1, max(len(variables), 1), PAGE_IN, 2.6)
    for axes, variable in zip(grid[0], variables):
        unit = f" [{variable.unit}]" if variable.unit else ""
        row = variable.telling
        gap = "log gap" if row.unit == "log" else "along the thrust [N]" if row.directed else "measured − map [N]"
        bins_panel(axes, variable, LABEL[variable.name] + unit, gap)
    figure.legend(handles=where_handles("points"), loc="outside lower center", ncols=2)
    share = f"{result.percent(result.gap.before):.2g} % of full scale"
    figure.suptitle(f"Where the {result.given.form} map is wrong: {share}")
    return figure


@house_style
def why_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw the evidence of every candidate of the first step against the threshold."""
    first = result.search.steps[0]
    best: dict[str, float] = {}
    for candidate in first.candidates:
        best[candidate.effect] = max(best.get(candidate.effect, -np.inf), candidate.gain)
    named = {effect.name for effect in result.effects}
    rivals = {rival.name for effect in result.effects for rival in effect.rivals}
    figure, grid = new_figure(1, 1, PAGE_IN * 0.8, 2.8)
    evidence_bars(grid[0, 0], best, first.threshold, named, rivals)
    handles = [
        Patch(color=AFTER, label="named or suspected"),
        Patch(color="0.72", label="not needed"),
        Line2D([], [], linestyle="--", color=BEFORE, label=f"threshold ({1000 * ALPHA:.0f} in 1000 by chance)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    words = " and ".join(effect.name for effect in result.effects) or result.verdict.replace("-", " ")
    figure.suptitle(f"Which missing effect would explain the gap. Verdict: {words}")
    return figure


@house_style
def before_after_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw thrust with both maps, and their errors on equal axes, on levels fitted and held out."""
    figure, grid = new_figure(3, 1, PAGE_IN * 0.8, 6.6, sharex=True, height_ratios=(1.8, 1.0, 1.0))
    thrust, *errors = grid[:, 0]
    sets = [(result.base.data, False), *([] if result.held_out is None else [(result.held_out, True)])]
    for data, held_out in sets:
        _points(thrust, data, data.points.force, held_out, "black", f"levels {'held out' if held_out else 'fitted'}")
    along = np.linspace(result.data.points.n.min(), result.data.points.n.max(), 801)
    thrust.plot(along, result.base.along(along), color=BEFORE, linestyle="--", label="before")
    volts = f" at {result.final.reference:.3g} V" if result.final.shape.voltage else ""
    thrust.plot(along, result.final.along(along), color=AFTER, label=f"after{volts}")
    thrust.set_ylabel("thrust of one thruster [N]")
    legend(thrust, loc="upper left")
    maps: list[tuple[str, Fitted, str, float]] = [
        ("before", result.base, BEFORE, result.gap.before), ("after", result.final, AFTER, result.gap.after),
    ]  # fmt: skip
    rests = [data.points.force - fit.thrust(data) for _, fit, _, _ in maps for data, _ in sets]
    most = 1.1 * max(float(np.abs(rest).max()) for rest in rests) or 1.0
    for axes, (word, fit, colour, gap) in zip(errors, maps):
        axes.axhspan(-2 * result.gap.floor, 2 * result.gap.floor, color="0.85", lw=0)
        axes.axhline(0.0, color="0.5", linewidth=0.6)
        for data, held_out in sets:
            _points(axes, data, data.points.force - fit.thrust(data), held_out, colour, "_")
        axes.set_ylim(-most, most)
        axes.set_ylabel("error [N]")
        axes.set_title(f"{word}: {gap:.3g} N = {result.percent(gap):.2g} % of full scale", loc="left")
    errors[1].set_xlabel(f"control signal n [{result.data.n_unit or 'as logged'}]")
    return figure


def _points(axes: Axes, data: BollardData, values: Floats, held_out: bool, colour: str, label: str) -> None:
    style: dict[str, Any] = {"color": colour, "markeredgewidth": 0.7, "zorder": 3 if held_out else 2}
    size, face = 2.0 if len(data.points) > 60 else 3.5, "none" if held_out else colour
    axes.plot(data.points.n, values, "o", markerfacecolor=face, markersize=size + held_out, label=label, **style)
    flagged = data.points.flag != ""
    if np.any(flagged):
        axes.plot(data.points.n[flagged], values[flagged], "x", color=COLOURS["purple"], markersize=6.0, zorder=4)
