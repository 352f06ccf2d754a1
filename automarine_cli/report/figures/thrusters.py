"""The figure of `fit-thrusters`: measured thrust, the chosen map and the square law, residuals."""

import numpy as np
from matplotlib.figure import Figure

from automarine_cli.report.figures.style import COLOURS, PAGE_IN, above_residuals, house_style
from automarine_cli.thrusters.result import ThrusterFit


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Draw thrust and residuals of one thruster against its control signal, coloured by voltage, and the map."""
    points, pooled, good = result.points, result.analysis, result.points.flag == ""
    control = f"Control signal n [{pooled.n_unit or 'unit as logged'}]"
    labels = control, "Thrust of one thruster [N]", "Measured − fitted [N]"
    figure, thrust, residuals = above_residuals(PAGE_IN * 0.8, 5.6, labels)
    thrust.axhline(0.0, color="0.6", lw=0.6)
    n, force, spread = points.n[good], points.force[good], np.nan_to_num(points.spread[good])
    measured = "measured ± standard deviation"
    thrust.errorbar(n, force, spread, fmt="o", color=COLOURS["black"], ms=3.0, capsize=2.0, label=measured)
    if len(result.voltages) > 1:
        coloured = thrust.scatter(n, force, c=points.voltage[good], cmap="cividis", s=9.0, zorder=3)
        figure.colorbar(coloured, ax=[thrust, residuals], label="Supply voltage [V]", pad=0.01)
    if not np.all(good):
        outlier = points.n[~good], points.force[~good]
        thrust.plot(*outlier, "x", color=COLOURS["vermilion"], ms=6.0, label="outlier from its neighbours")
    chosen, along = pooled.chosen.form.name, np.linspace(min(0.0, *n), max(0.0, *n), 801)
    for square in (True, False) if chosen != "square" else (False,):
        colour = COLOURS["vermilion" if square else "blue"]
        label, line = ("square law", "--") if square else (f"chosen: {chosen}", "-")
        thrust.plot(along, pooled.fitted(along, square=square), color=colour, ls=line, label=label, zorder=3)
        residual = force - pooled.fitted(n, square=square)
        residuals.plot(n, residual, "o", color=colour, mfc="none" if square else colour)
    thrust.legend(loc="upper left")
    return figure
