"""The figure of `validate`, the source paper's Fig. 10: positions, their errors and the command of one run."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.comparison.simulated_runs import FreeRun
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.style import (
    COLOURS,
    MEASURED,
    MODEL_COLOURS,
    MODEL_LINES,
    PAGE_IN,
    house_style,
    new_figure,
)
from automarine_cli.report.tables import number
from automarine_cli.runs.clean import GAP_IN_PERIODS

LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller


@house_style
def validation_figure(free: Mapping[str, FreeRun], floor: float) -> Figure:
    """One run: `free` holds its free run under each model, `floor` is the noise of its position [deg or cm]."""
    run = next(iter(free.values())).run
    dof = run.dof
    figure, axes = new_figure(3, 1, PAGE_IN, 6.0, sharex=True, height_ratios=(2.0, 1.3, 0.9))
    positions, errors, command = axes[:, 0]
    time, measured = run.time - run.time[0], dof.shown(run.position)
    size = 3.0 if len(run) <= CROWD else 1.5
    positions.plot(time, measured, "o", color=MEASURED, markersize=size, label="measured", zorder=2)
    shown = {model: one for model, one in free.items() if not one.diverged}
    for model, one in shown.items():
        error = dof.shown(one.error)
        style = {"color": MODEL_COLOURS[model], "linestyle": MODEL_LINES[model], "zorder": 4 if model == "2" else 3}
        label = f"model {model}: rmse {number(float(np.sqrt(np.mean(error**2))), 2)} {dof.units.shown}"
        positions.plot(*_broken(time, dof.shown(one.position), run.sample_period), label=label, **style)
        errors.plot(*_broken(time, error, run.sample_period), linewidth=1.0, **style)
    for model in (model for model in free if model not in shown):
        label = f"model {model} diverges"
        positions.plot([], [], color=MODEL_COLOURS[model], linestyle=MODEL_LINES[model], label=label)
    low, high = float(measured.min()), float(measured.max())
    span, most = max(high - low, 1.0), max(3 * floor, 0.5)
    _limits(positions, [dof.shown(one.position) for one in shown.values()], low, high, 2 * span)
    _limits(errors, [dof.shown(one.error) for one in shown.values()], -most, most, 2 * span)
    errors.axhline(0.0, color="0.4", linewidth=0.7, zorder=1)
    if floor > 0:
        band = f"± 2 × noise level of {number(floor, 2)} {dof.units.shown}"
        errors.axhspan(-2 * floor, 2 * floor, color="0.92", linewidth=0, zorder=0, label=band)
    command.axhline(0.0, color="0.4", linewidth=0.7, zorder=1)
    command.plot(*_broken(time, run.command, run.sample_period), color=COLOURS["green"], drawstyle="steps-mid")
    letters, unit = dof.symbols, dof.units.shown
    positions.set_ylabel(f"{dof.position.capitalize()} ${letters.position_math}$ [{unit}]")
    errors.set_ylabel(f"Measured − simulated [{unit}]")
    command.set_ylabel(f"{dof.words.force.capitalize()} ${letters.force_math}$ [{run.moment_unit}]")
    command.set_xlabel("Time from the start of the run [s]")
    positions.set_title(_short(run.name), parse_math=False)
    command.set_xlim(0.0, float(time[-1]))
    command.margins(y=0.15)
    handles = [handle for panel in (positions, errors) for handle in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.align_ylabels()
    return figure


def _broken(time: Floats, values: Floats, period: float) -> tuple[Floats, Floats]:
    """The line with a break in every gap of the log."""
    at = np.flatnonzero(np.diff(time) > GAP_IN_PERIODS * period) + 1
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan)


def _limits(axes: Axes, lines: list[Floats], low: float, high: float, reach: float) -> None:
    """Limits that hold `low` to `high`, and the lines as far as they come within `reach` of that."""
    inside = np.concatenate([[low, high], *(np.clip(line, low - reach, high + reach) for line in lines)])
    margin = 0.05 * float(max(np.ptp(inside), 1e-6))
    axes.set_ylim(float(inside.min()) - margin, float(inside.max()) + margin)


def _short(name: str) -> str:
    return name if len(name) <= LONGEST_TITLE else f"{name[: LONGEST_TITLE - 1]}…"
