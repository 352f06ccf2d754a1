"""The figure of a planar validation: heading, track, velocities and commands of one run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.comparison.planar import DEGREES, PlanarFree
from automarine_cli.diagnosis.planar import HEAD_START, PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import Where
from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.driven import JUDGED
from automarine_cli.fits.planar_fit import PlanarUse
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.diagnosis import AFTER, BEFORE, where_panels
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure
from automarine_cli.runs.run import Run

LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller
PANELS = (
    ("heading", r"Heading $\psi$ [deg]", DEGREES), ("surge", "Surge $u$ [m/s]", 1.0), ("sway", "Sway $v$ [m/s]", 1.0),
    ("yaw_rate", "Yaw rate $r$ [deg/s]", DEGREES),
)  # fmt: skip
ROOM = 2.0  # times the span of what was measured by which a line may leave it


@house_style
def planar_figure(free: PlanarFree) -> Figure:
    """One run: measured and simulated by the commands alone, from its start state."""
    run, time = free.run, free.run.time - free.run.time[0]
    figure, axes = new_figure(3, 2, PAGE_IN, 7.0)
    places = (axes[0, 0], axes[1, 0], axes[1, 1], axes[2, 0])
    size = 2.5 if len(run) <= CROWD else 1.2
    for panel, (channel, label, factor) in zip(places, PANELS):
        read = run.channel(channel)
        measured = None if free.error(channel) is None or read is None else factor * read
        if measured is not None:
            panel.plot(time, measured, "o", color=MEASURED, markersize=size, label="measured", zorder=2)
        if not free.diverged and channel in free.simulated:
            line = factor * free.simulated[channel]
            panel.plot(time, line, color=COLOURS["blue"], label="simulated, free run", zorder=3)
            _limit(panel, measured, line)
        panel.set_ylabel(label)
        panel.set_xlabel("Time from the start of the run [s]")
    _track(axes[0, 1], free, size)
    commands = axes[2, 1]
    for dof, colour in ((SURGE, "black"), (SWAY, "green"), (YAW, "orange")):
        unit = dof.units.forces[1]
        label = f"{dof.words.full_force} [{unit}]"
        commands.plot(time, run.command_of(dof), color=COLOURS[colour], drawstyle="steps-mid", label=label)
    commands.set_ylabel("Command [N, N m]")
    commands.set_xlabel("Time from the start of the run [s]")
    title = run.name if len(run.name) <= LONGEST_TITLE else f"{run.name[: LONGEST_TITLE - 1]}…"
    figure.suptitle(f"{title}{': the simulation diverges' * free.diverged}", parse_math=False)
    handles = [*axes[0, 0].get_legend_handles_labels()[0], *commands.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _track(panel: Axes, free: PlanarFree, size: float) -> None:
    """North over east, with equal scales."""
    north, east = (free.run.channel(name) for name in ("north", "east"))
    if free.distance is not None and north is not None and east is not None:
        panel.plot(east, north, "o", color=MEASURED, markersize=size, zorder=2)
    if not free.diverged and {"north", "east"} <= free.simulated.keys():
        panel.plot(free.simulated["east"], free.simulated["north"], color=COLOURS["blue"], zorder=3)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("East [m]")
    panel.set_ylabel("North [m]")


def _limit(panel: Axes, measured: Floats | None, line: Floats) -> None:
    """Limits that hold the measured, and the line as far as it comes near."""
    if measured is None or not np.isfinite(measured).any():
        return
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    reach = ROOM * max(high - low, 1e-3)
    inside = np.concatenate([[low, high], np.clip(line, low - reach, high + reach)])
    margin = 0.05 * max(float(np.ptp(inside)), 1e-6)
    panel.set_ylim(float(inside.min()) - margin, float(inside.max()) + margin)


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
            _track_of_runs(axes[i, 1], run, use, i)
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


def _track_of_runs(axes: Axes, run: Run, use: PlanarUse, i: int) -> None:
    north, east = (run.channel(name) for name in PLACES)
    if north is not None and east is not None:
        axes.plot(east, north, ".", color=MEASURED, ms=1.5)
    axes.plot(use.free["east"][i], use.free["north"][i], **FREE)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_ylabel("North [m]")


PLANAR_DIAGNOSIS_MOST_RUNS = 4
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
        _heading_of(grid[0, column], grid[1, column], search, ahead, r)
        grid[1, column].set_ylim(-most, most)
        grid[1, column].sharex(grid[0, column])
        grid[1, column].set_xlabel("Time in the run [s]", labelpad=1)
        if column:
            grid[1, column].set_yticklabels([])
        if placed:
            _track_of(grid[2, column], search, r)
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
    return picks[:PLANAR_DIAGNOSIS_MOST_RUNS]


def _heading_of(top: Axes, bottom: Axes, search: PlanarSearch, ahead: Sequence[Predicted], r: int) -> None:
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


def _track_of(axes: Axes, search: PlanarSearch, r: int) -> None:
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
