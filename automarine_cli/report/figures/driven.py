"""Driven runs: what was measured, what the model predicts of them, and the disturbance that it needed."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.filters.kalman import shown_channel
from automarine_cli.fits.driven import JUDGED, Use
from automarine_cli.fits.identify import YawFit
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure

MOST_RUNS, COLUMNS = 12, 3


@house_style
def driven_runs_figure(fit: YawFit, use: Use) -> Figure:
    """Of each run its position with predictions of the model fitted to the other runs and the free run of the preferred
    model, and below these the disturbance beside the command."""
    dof, shown = fit.dof, min(len(fit.runs), MOST_RUNS)
    columns = min(COLUMNS, shown)
    rows = -(-shown // columns)
    figure, axes = new_figure(2 * rows, columns, PAGE_IN, 0.9 + 2.6 * rows, height_ratios=[2.0, 1.0] * rows)
    for i in range(rows * columns):
        top, bottom = axes[2 * (i // columns), i % columns], axes[2 * (i // columns) + 1, i % columns]
        if i >= shown:
            top.set_axis_off()
            bottom.set_axis_off()
            continue
        _positions(top, fit, use, i)
        _forces(bottom, fit, use, i)
        bottom.sharex(top)
    for row in range(rows):
        axes[2 * row, 0].set_ylabel(
            f"{dof.words.position.capitalize()} {dof.symbols.position_print} [{dof.units.shown}]"
        )
        axes[2 * row + 1, 0].set_ylabel(f"{dof.words.force.capitalize()}\n[{fit.moment_unit}]")
    for column in range(columns):
        axes[-1, column].set_xlabel("Time in the run [s]")
    handles = [*zip(*axes[0, 0].get_legend_handles_labels()), *zip(*axes[1, 0].get_legend_handles_labels())]
    figure.legend([one for one, _ in handles], [name for _, name in handles], loc="outside lower center", ncols=3)
    some = "" if shown == len(fit.runs) else f"The first {shown} of {len(fit.runs)} runs. "
    figure.suptitle(
        f"{some}Model {fit.preference.number}: predictions start from filtered states, which know the readings until "
        "then;\nthe disturbance is what the filter makes of the runs, no measurement",
        fontsize=7.5,
    )
    return figure


def _positions(axes: Axes, fit: YawFit, use: Use, i: int) -> None:
    dof, run, time = fit.dof, fit.runs[i], use.course.time[i]
    axes.plot(run.time - run.time[0], dof.shown(run.position), color=MEASURED, lw=2.2, label="measured")
    ahead = next((one for one in use.predictions if one.horizon == JUDGED), None)
    if ahead is not None:
        own = ahead.run == i
        measured = shown_channel(use.course).values[i, ahead.target[own]]
        axes.plot(
            time[ahead.target[own]], dof.shown(measured - ahead.error[own]), ".", color=COLOURS["vermilion"],
            ms=2.2, label=f"predicted {JUDGED:g} s ahead, run left out of the fit",
        )  # fmt: skip
    axes.plot(
        time, dof.shown(use.free[i]), color=COLOURS["blue"], lw=0.9, ls=(0, (4, 1.5)),
        label="free run of the model",
    )  # fmt: skip
    measured = dof.shown(run.position)
    middle, half = 0.5 * (measured.max() + measured.min()), 0.5 * float(np.ptp(measured))
    axes.set_ylim(middle - 2.0 * half - 1e-6, middle + 2.0 * half + 1e-6)  # a free run may leave the picture
    axes.set_title(run.name, parse_math=False)
    axes.tick_params(labelbottom=False)


def _forces(axes: Axes, fit: YawFit, use: Use, i: int) -> None:
    run, end = fit.runs[i], int((use.course.length[i] > 0).sum()) + 1
    command = fit.dof.words.force
    axes.step(run.time - run.time[0], run.command, where="post", color="0.6", lw=0.6, label=f"{command} commanded")
    axes.plot(
        use.course.time[i, :end], use.disturbance[i, :end], color=COLOURS["green"], lw=1.0,
        label="disturbance that was needed",
    )  # fmt: skip
