"""The figure of a planar fit: of each run its heading with predictions, and its track."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.dofs import YAW
from automarine_cli.fits.driven import JUDGED
from automarine_cli.fits.planar_fit import PlanarUse
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure
from automarine_cli.runs.run import Run

MOST_RUNS = 8
ROW_IN = 1.7
FREE: dict[str, Any] = {"color": COLOURS["blue"], "lw": 0.9, "ls": (0, (4, 1.5))}


@house_style
def planar_runs_figure(runs: Sequence[Run], use: PlanarUse) -> Figure:
    """Of each run its heading with predictions of the model fitted to the other runs and the free run of the model, and
    beside it the track, where positions are logged."""
    shown, placed = min(len(runs), MOST_RUNS), set(PLACES) <= use.free.keys()
    ratios = [2.0, 1.0] if placed else [1.0]
    figure, axes = new_figure(shown, len(ratios), PAGE_IN, 1.3 + ROW_IN * shown, width_ratios=ratios)
    for i, run in enumerate(runs[:shown]):
        _heading(axes[i, 0], run, use, i)
        if placed:
            _track(axes[i, 1], run, use, i)
    axes[-1, 0].set_xlabel("Time in the run [s]")
    if placed:
        axes[-1, 1].set_xlabel("East [m]")
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    figure.suptitle(
        "Predictions and free runs start from filtered states, which know the readings until then;\n"
        "after that they follow the commands alone",
        fontsize=7.5,
    )
    return figure


def _heading(axes: Axes, run: Run, use: PlanarUse, i: int) -> None:
    time = use.course.time[i]
    measured = YAW.shown(run.position)
    axes.plot(run.time - run.time[0], measured, color=MEASURED, lw=2.2, label="measured")
    ahead = next(one for one in use.predictions if one.horizon == JUDGED)
    target = ahead.target[ahead.run == i]
    (channel,) = (one for one in use.course.channels if one.quantity == YAW.position)
    predicted = channel.values[i, target] - ahead.error[ahead.run == i]
    axes.plot(
        time[target], YAW.shown(predicted), ".", color=COLOURS["vermilion"], ms=2.2,
        label=f"predicted {JUDGED:g} s ahead{', run left out of the fit' * (use.runs > 1)}",
    )  # fmt: skip
    axes.plot(time, YAW.shown(use.free[YAW.position][i]), **FREE, label="free run of the model")
    low, high = float(measured.min()), float(measured.max())
    reach = 0.5 * (high - low) + 1e-6
    axes.set_ylim(low - reach, high + reach)  # a free run may leave the picture
    axes.set_title(run.name, parse_math=False)
    axes.set_ylabel("Heading [deg]")


def _track(axes: Axes, run: Run, use: PlanarUse, i: int) -> None:
    north, east = (run.channel(name) for name in PLACES)
    if north is not None and east is not None:
        axes.plot(east, north, ".", color=MEASURED, ms=1.5)
    axes.plot(use.free["east"][i], use.free["north"][i], **FREE)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_ylabel("North [m]")
