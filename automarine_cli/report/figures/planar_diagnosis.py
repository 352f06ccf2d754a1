"""Figures of a planar diagnosis: why an effect is named, and predictions before and after it was added."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.diagnosis.planar import HEAD_START, PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import Where
from automarine_cli.dofs import YAW
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.report.figures.diagnosis_where import where_panels
from automarine_cli.report.figures.diagnosis_words import AFTER, BEFORE
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure

MOST_RUNS = 4
RIVAL, TRIED, PROMISED = COLOURS["sky"], "0.55", "0.85"


def where_figure(search: PlanarSearch, where: Where) -> Figure:
    """The gap against each variable, and a heat map."""
    ahead = judged(search.foretold[0][YAW.position]).horizon
    return where_panels(where, search.words, "stretches of runs", f"predicted {ahead:g} s ahead")


@house_style
def why_figure(search: PlanarSearch) -> Figure:
    """The deviance that each candidate gains, of those that were fitted, or is promised to gain, look by look."""
    shown = search.steps or search.rounds[:1]
    count = sum(len(one.promised) for one in shown)
    figure, axes = new_figure(
        len(shown), 1, PAGE_IN, 1.3 + 0.19 * count + 0.5 * len(shown),
        height_ratios=[max(len(one.promised), 1) for one in shown], sharex=True,
    )  # fmt: skip
    for number, (panel, one) in enumerate(zip(axes[:, 0], shown)):
        fitted = {each.candidate.added: each for each in one.tried}
        gains = {c.added: fitted[c.added].surplus if c.added in fitted else gain for c, gain in one.promised}
        order = sorted(one.promised, key=lambda each: gains[each[0].added])
        rivals = {each.candidate.added for each in one.rivals}
        best = one.best.candidate.added if one.best else None
        colours = [
            AFTER if c.added == best else RIVAL if c.added in rivals else TRIED if c.added in fitted else PROMISED
            for c, _ in order
        ]
        place = np.arange(len(order))
        panel.barh(place, [gains[c.added] for c, _ in order], color=colours, height=0.72)
        panel.set_yticks(place, [c.label for c, _ in order], fontsize=6.5)
        panel.axvline(HEAD_START, color=BEFORE, linewidth=1.2, linestyle="--")
        panel.axvline(0.0, color="0.3", linewidth=0.6)
        panel.set_xscale("symlog", linthresh=10.0, linscale=1.0)
        panel.grid(visible=False, axis="y")
        if len(shown) > 1:
            panel.set_title(f"Look {number + 1}", fontsize=7.5)
    axes[-1, 0].set_xlabel("Deviance gained beyond the penalty")
    handles = [
        Patch(color=AFTER, label="named"),
        Patch(color=RIVAL, label="rival not excluded"),
        Patch(color=TRIED, label="fitted, not needed"),
        Patch(color=PROMISED, label="not fitted: as its score promises"),
        Line2D([], [], linestyle="--", color=BEFORE, label="bar"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5)
    figure.suptitle(f"Which missing effect would explain the innovations. Verdict: {search.words}")
    return figure


@house_style
def before_after_figure(search: PlanarSearch) -> Figure:
    """Telling runs with the heading, and the track where places are logged, as both models predict them some seconds
    ahead; the errors of the heading; and those of every run, before against after, on equal axes."""
    picks = _telling(search)
    placed = set(PLACES) <= search.foretold[0].keys()
    rows = 3 if placed else 2
    ratios = [1.4, 1.0, 1.5][:rows]
    figure, grid = new_figure(rows + 1, len(picks), PAGE_IN, 2.0 * rows + 2.9, height_ratios=[*ratios, 1.5])
    ahead = [judged(each[YAW.position]) for each in search.foretold]
    most = 1.08 * float(YAW.shown(max(np.abs(one.error[np.isin(one.run, picks)]).max() for one in ahead)))
    for column, r in enumerate(picks):
        _heading(grid[0, column], grid[1, column], search, ahead, r)
        grid[1, column].set_ylim(-most, most)
        grid[1, column].sharex(grid[0, column])
        grid[1, column].set_xlabel("Time in the run [s]", labelpad=1)
        if column:
            grid[1, column].set_yticklabels([])
        if placed:
            _track(grid[2, column], search, r)
    grid[0, 0].set_ylabel(r"Heading $\psi$ [deg]")
    grid[1, 0].set_ylabel("Measured −\npredicted [deg]")
    if placed:
        grid[2, 0].set_ylabel("North [m]")
    place = grid[0, 0].get_gridspec()
    for axes in grid[rows]:
        axes.remove()
    _sizes(figure.add_subplot(place[rows, :]), search, ahead)
    figure.suptitle(
        f"Predictions {ahead[0].horizon:g} s ahead, from filtered states, by the commands as they were logged.\n"
        f"Added: {search.words if search.named else 'nothing'}"
    )
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure


def _telling(search: PlanarSearch) -> list[int]:
    """Up to two runs held out and two fitted: of each the one with the largest and the one with the middle gap."""
    found, count = judged(search.foretold[0][YAW.position]), len(search.every.runs)
    size = np.nan_to_num(found.by_run(found.error, count), nan=-1.0)
    picks: list[int] = []
    for group in (np.arange(search.fitted), np.arange(search.fitted, count)):
        order = group[np.argsort(-size[group], kind="stable")]
        picks += [r for r in dict.fromkeys([int(order[0]), int(order[len(order) // 2])]) if size[r] >= 0]
    return picks[:MOST_RUNS]


def _heading(top: Axes, bottom: Axes, search: PlanarSearch, ahead: Sequence[Predicted], r: int) -> None:
    course, run = search.every.course, search.every.runs[r]
    (channel,) = (one for one in course.channels if one.quantity == YAW.position)
    measured = YAW.shown(run.position)
    top.plot(run.time - run.time[0], measured, color=MEASURED, lw=3.0, label="measured")
    for one, colour, word in zip(ahead, (BEFORE, AFTER), ("before", "after")):
        target = one.target[one.run == r]
        time, error = course.time[r, target], one.error[one.run == r]
        top.plot(
            time, YAW.shown(channel.values[r, target] - error), ".", color=colour, ms=1.5, label=f"predicted, {word}"
        )
        bottom.plot(time, YAW.shown(error), color=colour, lw=0.8)
    bottom.axhline(0.0, color="0.3", linewidth=0.6)
    low, high = float(measured.min()), float(measured.max())
    reach = 0.5 * (high - low) + 1e-6
    top.set_ylim(low - reach, high + reach)  # a prediction may leave the picture
    word = "held out" if r >= search.fitted else "fitted"
    top.set_title(
        f"{run.name if len(run.name) <= 26 else '…' + run.name[-25:]}\n{word}", fontsize=6.5, parse_math=False
    )


def _track(axes: Axes, search: PlanarSearch, r: int) -> None:
    """Places as they were measured and predicted; the axes are those of the measured, with room about it."""
    run, values = search.every.runs[r], {one.quantity: one.values[r] for one in search.every.course.channels}
    north, east = (run.channel(name) for name in PLACES)
    if north is None or east is None:
        axes.set_axis_off()
        return
    axes.plot(east, north, ".", color=MEASURED, ms=1.5)
    for each, colour in zip(search.foretold, (BEFORE, AFTER)):
        n, e = (judged(each[name]) for name in PLACES)
        own = n.run == r
        shown = [values[name][one.target[own]] - one.error[own] for name, one in zip(PLACES, (n, e))]
        axes.plot(shown[1], shown[0], ".", color=colour, ms=1.5)
    middle = [0.5 * float(np.nanmin(x) + np.nanmax(x)) for x in (east, north)]
    reach = 0.65 * max(float(np.nanmax(x) - np.nanmin(x)) for x in (east, north)) + 1e-6
    axes.set_xlim(middle[0] - reach, middle[0] + reach)
    axes.set_ylim(middle[1] - reach, middle[1] + reach)
    axes.set_box_aspect(1.0)
    axes.set_xlabel("East [m]", labelpad=1)


def _sizes(axes: Axes, search: PlanarSearch, ahead: Sequence[Predicted]) -> None:
    """Gap of every run before against after, on equal axes."""
    count = len(search.every.runs)
    before, after = (np.asarray(YAW.shown(np.sqrt(one.by_run(one.error, count)))) for one in ahead)
    for own, marker, fill, word in (
        (slice(0, search.fitted), "o", AFTER, "fitted"), (slice(search.fitted, count), "s", "none", "held out"),
    ):  # fmt: skip
        axes.plot(
            before[own], after[own], marker, color=AFTER, markerfacecolor=fill, markersize=3.5, label=f"runs {word}"
        )
    top = 1.08 * float(np.nanmax([before, after]))
    axes.plot([0, top], [0, top], color="0.4", linewidth=0.7, linestyle=":", label="no change")
    axes.set_xlim(0.0, top)
    axes.set_ylim(0.0, top)
    axes.set_box_aspect(1.0)
    axes.set_xlabel("Gap before, root mean square of a run [deg]", labelpad=1)
    axes.set_ylabel("Gap after [deg]")
    axes.legend(loc="center left", bbox_to_anchor=(1.05, 0.5), fontsize=6.5)
