"""Figures of parameters: of `fit-thrusters` thrust, map and residuals, of `compare` results below one another."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

from automarine_cli.comparison.side_by_side import ComparedResult, Difference
from automarine_cli.estimate import Estimate
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, above_residuals, house_style, panels, shortened
from automarine_cli.report.tables import interval, number
from automarine_cli.thrusters.curves import SplineCurve
from automarine_cli.thrusters.map import SIDES
from automarine_cli.thrusters.result import ThrusterFit

MAX_RESULT_NAME, WIDEST_LABEL = 28, 40  # letters that have room beside and below a panel


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Draw thrust and residuals of one thruster against its control signal, coloured by voltage, and the map."""
    points, pooled, good = result.points, result.analysis, result.points.flag == ""
    unit = {"us": "µs"}.get(pooled.n_unit, pooled.n_unit) or "unit as logged"
    control = f"Control signal n [{unit}]"
    labels = control, "Thrust of one thruster [N]", "Measured − fitted [N]"
    figure, thrust, residuals = above_residuals(PAGE_IN * 0.8, 5.6, labels)
    thrust.axhline(0.0, color="0.6", lw=0.6)
    n, force, spread = points.n[good], points.force[good], np.nan_to_num(points.spread[good])
    look = {"yerr": spread, "label": "measured ± standard deviation"} if spread.any() else {"label": "measured"}
    thrust.errorbar(n, force, fmt="o", color=COLOURS["black"], ms=3.0, capsize=2.0, **look)
    if len(result.voltages) > 1:
        coloured = thrust.scatter(n, force, c=points.voltage[good], cmap="cividis", s=9.0, zorder=3)
        figure.colorbar(coloured, ax=[thrust, residuals], label="Supply voltage [V]", pad=0.01)
    if not np.all(good):
        outlier = points.n[~good], points.force[~good]
        thrust.plot(*outlier, "x", color=COLOURS["vermilion"], ms=6.0, label="outlier from its neighbours")
    laws = {side[0]: law for side, law in pooled.square.items() if law is not None}
    sizes = "".join(f"\n$a_{name}$ {interval(law)} {law.unit.replace('us', 'µs')}" for name, law in laws.items())
    chosen, along = pooled.chosen.form.name, np.linspace(min(0.0, *n), max(0.0, *n), 801)
    law, where = ("", " at levels left out") if pooled.chosen.form.interpolates else (" law", "")
    for square in (True, False) if chosen != "square" else (False,):
        fit = pooled.law if square else pooled.chosen
        colour = COLOURS["vermilion" if square else "blue"]
        label, line = ("square law", "--") if square else (f"chosen: {chosen}{law}", "-")
        label += sizes if square or chosen == "square" else ""
        thrust.plot(along, fit.along(along), color=colour, ls=line, label=label, zorder=3)
        residual = force - fit.along(n)
        residuals.plot(n, residual, "o", color=colour, mfc="none" if square else colour)
    for side, sign in SIDES:
        if isinstance(curve := pooled.chosen.curves.get(side), SplineCurve):
            values = pooled.chosen.estimates[side].values()
            low, high = sign * np.array([value.ci95 for value in values if isinstance(value, Estimate)]).T
            thrust.fill_between(sign * np.array(curve.n[1:]), low, high, color=COLOURS["blue"], alpha=0.25, lw=0)
    error = number(pooled.percent(pooled.chosen.error), 2)
    title = f"{chosen.capitalize()}{law}: R² {pooled.r2(pooled.chosen):.4f}, error {error} % of full scale{where}"
    thrust.set_title(title, loc="left")
    thrust.legend(loc="upper left")
    return figure


@house_style
def compare_figure(sides: Sequence[ComparedResult], differences: Sequence[Difference]) -> Figure:
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
        ax.set_yticks(range(len(sides)), [shortened(side.name, MAX_RESULT_NAME) for side in sides], parse_math=False)
        ax.set_ylim(len(sides) - 0.4, -0.6)
    return figure
