"""What was learned: the curve with its band, and what the runs show of it themselves."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, legend, new_figure
from automarine_cli.simulation.batch import signals_of

OF_THE_RUN = 0.1
"""A column that varies within runs by less than this share of its range has one value a run, near enough to show."""


@house_style
def learned_figure(diagnosis: Diagnosis, curve: LearnedCurve) -> Figure:
    """The curve over its variable, with its 95 % band."""
    figure, grid = new_figure(1, 1, 0.62 * PAGE_IN, 2.9)
    axes, gain = grid[0, 0], curve.kind == "gain"
    scale = 100.0 if gain else 1.0
    if gain:
        _runs(axes, diagnosis, curve)
    axes.fill_between(
        curve.x, scale * curve.low, scale * curve.high, color=COLOURS["sky"], alpha=0.4, linewidth=0,
        label="95 % band",
    )  # fmt: skip
    axes.plot(curve.x, scale * curve.y, color=COLOURS["blue"], label="learned curve")
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    unit, size = f" [{curve.unit}]" if curve.unit else "", "size of " * curve.sized
    axes.set_xlabel(f"{size}{curve.variable}{unit}", parse_math=False)
    word = diagnosis.study.base.dof.words.force if curve.kind == "moment" else "change of linear drag"
    axes.set_ylabel("change of thrust [%]" if gain else f"{word} [{curve.y_unit}]", parse_math=False)
    legend(axes)
    return figure


def _runs(axes: Axes, diagnosis: Diagnosis, curve: LearnedCurve) -> None:
    """Each run's own thrust under the base model, where the variable has about one value a run."""
    study = diagnosis.study
    values = signals_of(study.runs, curve.variable) if curve.needs else []
    if not values or max(float(np.ptp(v)) for v in values) > OF_THE_RUN * float(np.ptp(curve.x)):
        return
    own = 100.0 * diagnosis.found.base.fit.own(GAIN)[:, 0]
    mean = np.array([float(v.mean()) for v in values])
    level = np.mean(own - 100.0 * np.interp(mean, curve.x, curve.y))
    axes.plot(mean, own - level, "o", color=MEASURED, markersize=3.5, label="thrust of each run, base model")
