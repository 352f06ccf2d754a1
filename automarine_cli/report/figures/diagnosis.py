"""The figures of `diagnose`: where the gap is, why (evidence and naming key), and before and after."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from automarine_cli.diagnosis.bins import Row, Variable
from automarine_cli.diagnosis.budget import LEFT, NOISE, SCATTER
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.naming_key import NamingKey
from automarine_cli.diagnosis.where import Where
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure

Floats = NDArray[np.float64]

BEFORE, AFTER, MARK = COLOURS["vermilion"], COLOURS["blue"], COLOURS["yellow"]
MOST_PANELS = 12
COLUMNS = 4
NAMES = {
    "time-since-command-change": "time since command changed", "time-in-run": "time in the run",
    "turned-angle": "turned angle", "yaw-rate": "yaw rate", "start-heading": "start heading",
    "run-order": "run order", "campaign-clock": "campaign clock", "moment-size": "size of the moment",
}  # fmt: skip
QUANTITIES = {"heading": "heading", "thrust": "heading, equal thrust", "moment": "moment"}
MOST_RUNS_SHOWN = 4


@house_style
def where_figure(where: Where, diagnosis: Diagnosis) -> Figure:
    """Small multiples, one a variable, most significant first, above a heat map of runs by time."""
    shown = sorted(where.variables, key=lambda v: (v.p_value, -float(np.abs(v.telling.t).max())))[
        :MOST_PANELS
    ]
    rows = -(-len(shown) // COLUMNS)
    heights = (*(1.55 for _ in range(rows)), 2.6)
    figure, grid = new_figure(rows + 1, COLUMNS, PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid[:rows].ravel()
    for axes, variable in zip(panels, shown):
        _bins(axes, variable)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    place = grid[rows, 0].get_gridspec()
    for axes in grid[rows]:
        axes.remove()
    heat = figure.add_subplot(place[rows, :])
    _heat_map(figure, heat, where)
    out = sum(bool(variable.stands_out.any()) for variable in where.variables)
    said = (
        f"The gap stands out against {out} of {len(where.variables)} variables (yellow)"
        if out
        else f"The gap stands out against none of {len(where.variables)} variables"
    )
    handles = [
        Patch(color=MARK, alpha=0.45, label="stands out against chance"),
        Patch(color=BEFORE, alpha=0.3, label="mean ± 2 standard errors (runs as units)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    figure.suptitle(f"{said}. Verdict: {_verdict(diagnosis)}")
    return figure


def _verdict(diagnosis: Diagnosis) -> str:
    """The verdict in a few words."""
    if diagnosis.verdict == "named":
        return " and ".join(diagnosis.found.final.added)
    return diagnosis.verdict.replace("-", " ")


def _bins(axes: Axes, variable: Variable) -> None:
    """The most telling row of one variable as steps with a band; bins that stand out are shaded."""
    row = variable.telling
    out = bool(variable.stands_out.any())
    for begin, end, mark in zip(variable.edges[:-1], variable.edges[1:], variable.stands_out):
        if mark:
            axes.axvspan(begin, end, color=MARK, alpha=0.45, linewidth=0, zorder=0)
    have = np.isfinite(row.mean)
    colour = BEFORE if out else "0.45"
    axes.axhline(0.0, color="0.3", linewidth=0.6, zorder=1)
    x = np.where(
        np.isfinite(variable.middle), variable.middle, 0.5 * (variable.edges[1:] + variable.edges[:-1])
    )
    axes.fill_between(
        x[have], (row.mean - 2 * row.error)[have], (row.mean + 2 * row.error)[have],
        color=colour, alpha=0.3, linewidth=0,
    )  # fmt: skip
    axes.plot(x[have], row.mean[have], "o-", color=colour, markersize=2.5, linewidth=1.0)
    most = float(np.max(np.abs(row.mean[have]) + 2 * np.nan_to_num(row.error[have]), initial=1e-9))
    axes.set_ylim(-1.15 * most, 1.15 * most)
    span = float(np.ptp(variable.edges))
    axes.set_xlim(float(variable.edges[0]) - 0.02 * span, float(variable.edges[-1]) + 0.02 * span)
    name = NAMES.get(variable.name, variable.name.replace("-", " ")) + (
        ", by run" if variable.of_the_run else ""
    )
    unit = f" [{variable.unit}]" if variable.unit else ""
    axes.set_xlabel(f"{name}{unit}", labelpad=1, fontsize=7, parse_math=False)
    axes.set_ylabel(_look(row), labelpad=1, fontsize=6.5)
    axes.set_title(
        f"p = {variable.p_value:.2g}" if out else "within chance",
        fontsize=7, fontweight="bold" if out else "normal", color="black" if out else "0.45", pad=2,
    )  # fmt: skip
    axes.tick_params(labelsize=6)


def _look(row: Row) -> str:
    """What the vertical axis shows."""
    if row.kind == "size":
        return "log gap of the run"
    if row.unit == "%":
        return "own thrust [%]" + (" × side" if row.directed else "")
    word = {"heading": "gap", "thrust": "gap, equal thrust", "moment": "missing moment"}[row.kind]
    return f"{word} [{row.unit}]" + ("\nalong the moment" if row.directed else "")


def _heat_map(figure: Figure, axes: Axes, where: Where) -> None:
    """Residual headings, runs in order of their moment by time."""
    order = np.argsort(where.mean_moment, kind="stable")
    ends = np.where(where.seen, where.time, 0.0).max(axis=1)
    grid = np.linspace(0.0, float(ends.max()), 240)
    image = np.full((len(order), len(grid)), np.nan)
    for line, i in enumerate(order):
        time, gap = where.time[i][where.seen[i]], np.degrees(where.residual[i][where.seen[i]])
        width = max(1, round(len(time) / 60))
        smooth = np.convolve(gap, np.ones(width), "same") / np.convolve(
            np.ones(len(gap)), np.ones(width), "same"
        )
        image[line] = np.where(grid <= time[-1], np.interp(grid, time, smooth), np.nan)
    most = max(float(np.nanquantile(np.abs(image), 0.99)), np.degrees(where.floor))
    mesh = axes.imshow(
        image, aspect="auto", origin="lower", cmap="PuOr", vmin=-most, vmax=most, interpolation="nearest",
        extent=(0.0, float(grid[-1]), -0.5, len(order) - 0.5),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axes, pad=0.01)
    bar.set_label("measured − simulated [deg]", fontsize=7)
    ticks = np.unique(np.linspace(0, len(order) - 1, min(len(order), 7)).round().astype(int))
    axes.set_yticks(ticks, [f"{where.mean_moment[order[i]]:.2g}" for i in ticks])
    axes.set_ylabel(f"runs by mean moment [{where.moment_unit}]")
    axes.set_xlabel("time in the run [s]")
    axes.grid(False)


@house_style
def why_figure(diagnosis: Diagnosis, key: NamingKey) -> Figure:
    """Evidence of every candidate in the first round against the threshold, and the naming key."""
    count = len(diagnosis.found.rounds[0].trials)
    figure, grid = new_figure(2, 2, PAGE_IN, max(4.2, 0.17 * count + 1.2), width_ratios=(1.25, 1.0))
    place = grid[0, 0].get_gridspec()
    for axes in grid[:, 0]:
        axes.remove()
    _evidence(figure.add_subplot(place[:, 0]), diagnosis)
    named = bool(diagnosis.found.final.added)
    _key(grid[0, 1], key, "k", "drag over thrust, k", key.log_k, key.log_k_error, key.predicted_k, named)
    _key(grid[1, 1], key, "I/k", "inertia over drag, I / k", key.log_ratio, key.log_ratio_error,
         key.predicted_ratio, named)  # fmt: skip
    grid[1, 1].set_xlabel(f"size of the moment [{key.unit}]")
    handles = [
        Patch(color=AFTER, label="named"),
        Patch(color=COLOURS["sky"], label="rival not excluded"),
        Patch(color="0.72", label="not needed"),
        Line2D([], [], linestyle="--", color=BEFORE, label="reached by chance in 2 of 100 campaigns"),
        *grid[0, 1].get_legend_handles_labels()[0],
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    figure.suptitle(f"Which missing effect would explain the gap. Verdict: {_verdict(diagnosis)}")
    return figure


def _evidence(axes: Axes, diagnosis: Diagnosis) -> None:
    """Horizontal bars, best on top, on a scale that is linear up to the threshold and logarithmic beyond."""
    found, first = diagnosis.found, diagnosis.found.rounds[0]
    trials = sorted(first.trials, key=first.gain)
    gains = np.array([first.gain(trial) for trial in trials])
    names = [trial.added[-1] for trial in trials]
    rivals = {rival.name for rival in found.rivals}
    colours = [
        AFTER if name in found.final.added else COLOURS["sky"] if name in rivals else "0.72" for name in names
    ]
    axes.barh(np.arange(len(trials)), gains, color=colours, height=0.72)
    axes.axvline(first.threshold, color=BEFORE, linewidth=1.2, linestyle="--")
    axes.axvline(0.0, color="0.3", linewidth=0.6)
    axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    most = max(2.5 * float(gains.max(initial=0.0)), 20.0)
    low = min(float(gains.min(initial=0.0)), 0.0)
    axes.set_xlim(1.2 * low - 1.0, most)
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if 1.2 * low - 1.0 <= tick <= most]
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yticks(np.arange(len(trials)), names)
    for label, name in zip(axes.get_yticklabels(), names):
        label.set_fontweight("bold" if name in found.final.added else "normal")
    for at, gain in enumerate(gains):
        if gain > 0.4 * first.threshold:
            axes.annotate(
                f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5
            )
    axes.set_xlabel("evidence gained over the base model [deviance]")
    axes.grid(False, axis="y")
    axes.margins(y=0.01)


def _key(
    axes: Axes,
    key: NamingKey,
    quantity: str,
    title: str,
    log: Floats,
    error: Floats,
    predicted: Floats,
    named: bool,
) -> None:
    """One drift: every run's own value against the size of its moment, with what the final model predicts."""
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    have = np.isfinite(key.moment)
    for side, marker, colour, name in (
        (1, ">", COLOURS["orange"], "to starboard"),
        (-1, "<", COLOURS["green"], "to port"),
    ):
        here = have & (np.sign(key.moment) == side)
        axes.errorbar(
            np.abs(key.moment[here]), 100 * log[here], 200 * error[here], fmt=marker, color=colour, markersize=3.5,
            elinewidth=0.5, alpha=0.75, label=f"runs {name}", zorder=2,
        )  # fmt: skip
        if named and here.any():
            sizes = np.unique(np.round(np.abs(key.moment[here]), 9))
            curve = [np.median(predicted[here & np.isclose(np.abs(key.moment), size)]) for size in sizes]
            label = "final model predicts" if side == 1 else None
            axes.plot(
                sizes,
                100 * np.array(curve),
                "-",
                color=AFTER,
                linewidth=1.6,
                alpha=0.9,
                label=label,
                zorder=3,
            )
    best = key.best(quantity)
    note = "no drift with the moment beyond chance"
    if best is not None and best.p_value < 0.01:
        note = textwrap.fill(f"drifts as |moment|^{best.power:g}, {best.parity}: {best.means}", 52)
    axes.set_title(f"{title}\n{note}", fontsize=7)
    axes.set_ylabel("against the base fit [%]")
    values = 100 * np.concatenate([log[have], predicted[have] if named else np.zeros(0)])
    if len(values):
        low, high = np.quantile(values, [0.02, 0.98])
        margin = 0.25 * max(high - low, 2.0)
        axes.set_ylim(min(low, 0.0) - margin, max(high, 0.0) + margin)


@house_style
def before_after_figure(diagnosis: Diagnosis, where: Where, shares: Mapping[str, float]) -> Figure:
    """Telling runs with both models, their errors, the error by the most telling variable, and the budget."""
    picks = _telling_runs(diagnosis)
    count = max(len(picks), 1)
    figure, grid = new_figure(4, count, PAGE_IN, 7.0, height_ratios=(1.5, 1.2, 1.4, 0.75))
    errors = [np.degrees(pick[k]) for pick in picks for k in (3, 4)]
    most = 1.08 * max((float(np.abs(e).max()) for e in errors), default=1.0)
    floor = np.degrees(diagnosis.gap.floor)
    for column, (title, time, heading, before, after) in enumerate(picks):
        top, bottom = grid[0, column], grid[1, column]
        measured = np.degrees(heading - heading[0])
        top.plot(time, measured, "o", color=MEASURED, markersize=1.6, label="measured")
        top.plot(
            time,
            measured - np.degrees(before),
            color=BEFORE,
            linewidth=1.0,
            linestyle="--",
            label="base model",
        )
        top.plot(time, measured - np.degrees(after), color=AFTER, linewidth=1.0, label="after")
        top.set_title(title, fontsize=6.5, parse_math=False)
        bottom.axhspan(-2 * floor, 2 * floor, color="0.9", linewidth=0, label="± 2 × noise")
        bottom.plot(time, np.degrees(before), color=BEFORE, linewidth=0.6)
        bottom.plot(time, np.degrees(after), color=AFTER, linewidth=0.6)
        bottom.set_ylim(-most, most)
        bottom.set_xlabel("time [s]", labelpad=1)
        if column:
            bottom.set_yticklabels([])
    grid[0, 0].set_ylabel("turned [deg]")
    grid[1, 0].set_ylabel("measured − sim. [deg]")
    place = grid[0, 0].get_gridspec()
    for axes in grid[2:].ravel():
        axes.remove()
    half = max(count // 2, 1)
    _sizes(figure.add_subplot(place[2, :half]), diagnosis)
    if count > 1:
        _by_variable(figure.add_subplot(place[2, half:]), diagnosis, where)
    _budget(figure.add_subplot(place[3, :]), shares)
    handles = [h for axes in (grid[0, 0], grid[1, 0]) for h in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


Pick = tuple[str, Floats, Floats, Floats, Floats]


def _telling_runs(diagnosis: Diagnosis) -> list[Pick]:
    """Up to two fitted and two held-out runs: of each the one with the most and the one with the middle gap."""
    found: list[Pick] = []
    for study, gap, word in (
        (diagnosis.study, diagnosis.gap, "fitted"),
        (diagnosis.held_out, diagnosis.held_out_gap, "held out"),
    ):
        if study is None or gap is None or not study.runs:
            continue
        size = (gap.residuals_before**2).sum(axis=1) / study.batch.seen.sum(axis=1)
        order = np.argsort(-size, kind="stable")
        for i in dict.fromkeys([int(order[0]), int(order[len(order) // 2])]):
            run, n = study.runs[i], len(study.runs[i])
            name = run.name if len(run.name) <= 26 else f"…{run.name[-25:]}"
            found.append(
                (f"{name}\n{word}", run.time - run.time[0], run.heading, gap.residuals_before[i, :n],
                 gap.residuals_after[i, :n])
            )  # fmt: skip
    return found[:MOST_RUNS_SHOWN]


def _sizes(axes: Axes, diagnosis: Diagnosis) -> None:
    """Gap of every run before against after, on equal axes."""
    pairs = [
        (diagnosis.study, diagnosis.gap, "o", "fitted"),
        (diagnosis.held_out, diagnosis.held_out_gap, "s", "held out"),
    ]
    top = 0.0
    for study, gap, marker, word in pairs:
        if study is None or gap is None or not study.runs:
            continue
        count = study.batch.seen.sum(axis=1)
        before, after = (
            np.degrees(np.sqrt((r**2).sum(axis=1) / count))
            for r in (gap.residuals_before, gap.residuals_after)
        )
        fill = AFTER if marker == "o" else "none"
        axes.plot(
            before, after, marker, color=AFTER, markerfacecolor=fill, markersize=3.5, label=f"runs {word}"
        )
        top = max(top, float(before.max()), float(after.max()))
    axes.plot([0, 1.05 * top], [0, 1.05 * top], color="0.4", linewidth=0.7, linestyle=":")
    axes.axhline(
        np.degrees(diagnosis.gap.floor),
        color="0.5",
        linewidth=0.8,
        linestyle="--",
        label="noise of the heading",
    )
    axes.set_xlim(0.0, 1.05 * top)
    axes.set_ylim(0.0, 1.05 * top)
    axes.set_xlabel("gap before [deg]", labelpad=1)
    axes.set_ylabel("gap after [deg]")
    axes.legend(loc="upper left", fontsize=6.5)


def _by_variable(axes: Axes, diagnosis: Diagnosis, where: Where) -> None:
    """The gap in the bins of the most telling variable, before and after, on one scale."""
    at = min(
        range(len(where.variables)),
        key=lambda i: (where.variables[i].p_value, -float(np.abs(where.variables[i].telling.t).max())),
    )
    variable, column = where.variables[at], where.columns[at]
    row = variable.telling
    if column.of_the_run:
        pairs = [where.gain, 100.0 * diagnosis.found.final.fit.run_effects[:, 2]]
        axes.set_ylabel("own thrust [%]")
    else:
        gaps = (diagnosis.gap.residuals_before, diagnosis.gap.residuals_after)
        pairs = [np.degrees(gap * where.sign if row.directed else gap) for gap in gaps]
        axes.set_ylabel("mean gap [deg]" + ("\nalong the moment" if row.directed else ""))
    have = np.isfinite(column.values)
    which = np.where(have, np.digitize(np.nan_to_num(column.values), variable.edges[1:-1]), -1)
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    for values, colour, style, label in (
        (pairs[0], BEFORE, "o--", "before"),
        (pairs[1], AFTER, "o-", "after"),
    ):
        means = np.array(
            [
                np.mean(values[which == b]) if (which == b).any() else np.nan
                for b in range(len(variable.middle))
            ]
        )
        axes.plot(variable.middle, means, style, color=colour, markersize=2.5, linewidth=1.0, label=label)
    unit = f" [{variable.unit}]" if variable.unit else ""
    axes.set_xlabel(
        NAMES.get(variable.name, variable.name.replace("-", " ")) + unit, labelpad=1, parse_math=False
    )
    axes.legend(loc="best", fontsize=6.5)


def _budget(axes: Axes, shares: Mapping[str, float]) -> None:
    """One stacked bar of the whole gap."""
    fixed = {NOISE: "0.6", SCATTER: "0.82", LEFT: COLOURS["black"]}
    others = [COLOURS[name] for name in ("blue", "sky", "green")]
    at, used = 0.0, 0
    for name, share in shares.items():
        colour = fixed.get(name) or others[used % 3]
        used += name not in fixed
        axes.barh(0, 100 * share, left=at, color=colour, height=0.6, label=f"{name} {100 * share:.1f} %")
        at += 100 * share
    axes.set_xlim(0.0, 100.0)
    axes.set_yticks([])
    axes.set_xlabel(
        "share of the mean square gap of the base model, all runs with equal thrust [%]", labelpad=1
    )
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(shares), fontsize=6.5, frameon=False)
    axes.grid(False)
