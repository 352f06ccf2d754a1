"""The figure of `fit-thrusters`: measured thrust, the chosen map and the square law, residuals."""

import numpy as np
from matplotlib.figure import Figure

from automarine_cli.report.figures.style import COLOURS, PAGE_IN, above_residuals, house_style
from automarine_cli.report.tables import interval, number
from automarine_cli.thrusters.result import ThrusterFit


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
    for square in (True, False) if chosen != "square" else (False,):
        colour = COLOURS["vermilion" if square else "blue"]
        label, line = ("square law", "--") if square else (f"chosen: {chosen} law", "-")
        label += sizes * (square or chosen == "square")
        thrust.plot(along, pooled.fitted(along, square=square), color=colour, ls=line, label=label, zorder=3)
        residual = force - pooled.fitted(n, square=square)
        residuals.plot(n, residual, "o", color=colour, mfc="none" if square else colour)
    error = number(pooled.percent(pooled.chosen.rmse), 2)
    thrust.set_title(f"{chosen.capitalize()} law: R² {pooled.chosen_r2:.4f}, error {error} % of full scale", loc="left")
    thrust.legend(loc="upper left")
    return figure
