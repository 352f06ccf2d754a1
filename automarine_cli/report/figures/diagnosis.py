"""Why: the evidence of every candidate."""

import textwrap
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, Row, Variable, Where
from automarine_cli.diagnosis.search import LEVEL
from automarine_cli.diagnosis.study import JUDGED
from automarine_cli.diagnosis.verdict import NAMED, SUSPECTED
from automarine_cli.dofs import Dof
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, legend, new_figure
from automarine_cli.simulation.batch import signals_of

BEFORE, AFTER, MARK = COLOURS["vermilion"], COLOURS["blue"], COLOURS["yellow"]


def in_words(variable: Variable, dof: Dof) -> str:
    """The variable's name and unit for an axis."""
    force = dof.words.force
    others = {
        "time-since-command-change": "time since command changed",
        "time-in-run": "time in the run",
        f"{force}-size": f"size of the {force}",
    }
    name = variable.name if variable.logged else others.get(variable.name, variable.name.replace("-", " "))
    name += ", by run" if variable.of_the_run else ""
    return name + (f" [{variable.unit}]" if variable.unit else "")


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


MOST_RUNS_SHOWN = 4
WIDEST = 104
"""Letters that have room side by side in the title."""


@house_style
def before_after_figure(diagnosis: Diagnosis) -> Figure:
    """Draw telling runs with both models, their errors, and the error by the most telling variable."""
    dof = diagnosis.study.base.dof
    picks = _telling_runs(diagnosis)
    count = max(len(picks), 1)
    figure, grid = new_figure(3, count, PAGE_IN, 6.0, height_ratios=(1.5, 1.2, 1.4))
    errors = [dof.shown(pick[k]) for pick in picks for k in (3, 4)]
    most = 1.08 * max((float(np.abs(e).max()) for e in errors), default=1.0)
    floor = dof.shown(diagnosis.gap.floor)
    ahead = f", {JUDGED:g} s ahead" if diagnosis.study.driven else ""
    for column, (title, time, heading, before, after) in enumerate(picks):
        top, bottom = grid[0, column], grid[1, column]
        if diagnosis.study.driven:  # nothing is predicted before the first filtered state
            before, after = (np.where(missed == 0.0, np.nan, missed) for missed in (before, after))
        measured = dof.shown(heading - heading[0])
        top.plot(time, measured, "o", color=MEASURED, markersize=1.6, label="measured")
        top.plot(
            time, measured - dof.shown(before), color=BEFORE, linewidth=1.0, linestyle="--", label=f"base model{ahead}"
        )
        top.plot(time, measured - dof.shown(after), color=AFTER, linewidth=1.0, label=f"after{ahead}")
        top.set_title(title, fontsize=6.5, parse_math=False)
        bottom.axhspan(-2 * floor, 2 * floor, color="0.9", linewidth=0, label="± 2 × noise")
        bottom.plot(time, dof.shown(before), color=BEFORE, linewidth=0.6)
        bottom.plot(time, dof.shown(after), color=AFTER, linewidth=0.6)
        bottom.set_ylim(-most, most)
        bottom.set_xlabel("time [s]", labelpad=1)
        if column:
            bottom.set_yticklabels([])
    grid[0, 0].set_ylabel(f"{dof.words.moved} [{dof.units.shown}]")
    less = "predicted" if diagnosis.study.driven else "sim."
    grid[1, 0].set_ylabel(f"measured − {less} [{dof.units.shown}]")
    place = grid[0, 0].get_gridspec()
    for axes in grid[2]:
        axes.remove()
    half = max(count // 2, 1)
    _sizes(figure.add_subplot(place[2, :half]), diagnosis)
    if count > 1:
        _by_variable(figure.add_subplot(place[2, half:]), diagnosis)
    figure.suptitle(textwrap.fill(_sizes_in_words(diagnosis), WIDEST))
    handles = [h for axes in (grid[0, 0], grid[1, 0]) for h in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _sizes_in_words(diagnosis: Diagnosis) -> str:
    """The gap before and after on both sets of runs."""
    dof = diagnosis.study.base.dof
    parts = []
    for gap, word in ((diagnosis.gap, "fitted"), (diagnosis.held_out_gap, "held out")):
        if gap is not None:
            parts.append(f"runs {word} {dof.shown(gap.before):.2f} → {dof.shown(gap.after):.2f} {dof.units.shown}")
    names = " and ".join(diagnosis.found.final.added)
    word = "Added" if diagnosis.verdict == NAMED else "With what is only suspected"
    added = f"{word}: {names}" if names else "Nothing added"
    noise = f"{dof.shown(diagnosis.gap.floor):.2f} {dof.units.shown}"
    if diagnosis.study.driven:
        return f"Predictions {JUDGED:g} s ahead from filtered states: {', '.join(parts)}. {added}"
    return f"Gap: {', '.join(parts)} (noise {noise}). {added}"


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
                (f"{name}\n{word}", run.time - run.time[0], run.position, gap.residuals_before[i, :n],
                 gap.residuals_after[i, :n])
            )  # fmt: skip
    return found[:MOST_RUNS_SHOWN]


def _sizes(axes: Axes, diagnosis: Diagnosis) -> None:
    """Gap of every run before against after, on equal axes."""
    dof = diagnosis.study.base.dof
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
            dof.shown(np.sqrt((r**2).sum(axis=1) / count)) for r in (gap.residuals_before, gap.residuals_after)
        )
        fill = AFTER if marker == "o" else "none"
        axes.plot(before, after, marker, color=AFTER, markerfacecolor=fill, markersize=3.5, label=f"runs {word}")
        top = max(top, float(before.max()), float(after.max()))
    axes.plot([0, 1.05 * top], [0, 1.05 * top], color="0.4", linewidth=0.7, linestyle=":")
    axes.axhline(
        dof.shown(diagnosis.gap.floor),
        color="0.5",
        linewidth=0.8,
        linestyle="--",
        label=f"noise of the {dof.words.position}",
    )
    axes.set_xlim(0.0, 1.05 * top)
    axes.set_ylim(0.0, 1.05 * top)
    axes.set_xlabel(f"gap before [{dof.units.shown}]", labelpad=1)
    axes.set_ylabel(f"gap after [{dof.units.shown}]")
    axes.legend(loc="upper left", fontsize=6.5)


def _by_variable(axes: Axes, diagnosis: Diagnosis) -> None:
    """The gap in the bins of the most telling variable, before and after, on one scale."""
    where = diagnosis.where
    at = min(
        range(len(where.variables)),
        key=lambda i: (where.variables[i].p_value, -float(np.abs(where.variables[i].telling.t).max())),
    )
    variable, column = where.variables[at], where.columns[at]
    row = variable.telling
    if column.of_the_run:
        pairs = [where.gain, 100.0 * diagnosis.found.final.fit.own(GAIN)[:, 0]]
        axes.set_ylabel("own thrust [%]")
    else:
        dof = where.dof
        gaps = (diagnosis.gap.residuals_before, diagnosis.gap.residuals_after)
        pairs = [dof.shown(gap * where.sign if row.directed else gap) for gap in gaps]
        along = f"\nalong the {dof.words.force}" if row.directed else ""
        axes.set_ylabel(f"mean gap [{dof.units.shown}]{along}")
    have = np.isfinite(column.values)
    which = np.where(have, np.digitize(np.nan_to_num(column.values), variable.edges[1:-1]), -1)
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    for values, colour, style, label in ((pairs[0], BEFORE, "o--", "before"), (pairs[1], AFTER, "o-", "after")):
        means = np.array(
            [np.mean(values[which == b]) if (which == b).any() else np.nan for b in range(len(variable.middle))]
        )
        axes.plot(variable.middle, means, style, color=colour, markersize=2.5, linewidth=1.0, label=label)
    axes.set_xlabel(in_words(variable, where.dof), labelpad=1, parse_math=False)
    axes.legend(loc="best", fontsize=6.5)


MOST_PANELS = 12
COLUMNS = 4


def where_figure(diagnosis: Diagnosis) -> Figure:
    """Small multiples, one a variable, most significant first, above a heat map of runs by time."""
    return where_panels(diagnosis.where, diagnosis.words)


@house_style
def where_panels(where: Where, words: str, units: str = "runs", less: str = "simulated") -> Figure:
    """The same with the verdict in any `words`; `units` are what chance turns the sign of, `less` is what the measured
    is compared with."""
    shown = sorted(where.variables, key=lambda v: (v.p_value, -float(np.abs(v.telling.t).max())))[:MOST_PANELS]
    rows = -(-len(shown) // COLUMNS)
    heights = (*(1.55 for _ in range(rows)), 2.6)
    figure, grid = new_figure(rows + 1, COLUMNS, PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid[:rows].ravel()
    for axes, variable in zip(panels, shown):
        bins_panel(axes, variable, in_words(variable, where.dof), _look(variable.telling, where.dof))
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    place = grid[rows, 0].get_gridspec()
    for axes in grid[rows]:
        axes.remove()
    heat = figure.add_subplot(place[rows, :])
    _heat_map(figure, heat, where, less)
    out = sum(bool(variable.stands_out.any()) for variable in where.variables)
    told = (
        f"The error depends on {out} of {len(where.variables)} variables (yellow)"
        if out
        else f"The error depends on none of {len(where.variables)} variables"
    )
    figure.legend(handles=where_handles(units), loc="outside lower center", ncols=2)
    figure.suptitle(f"{told}. Verdict: {words}")
    return figure


def where_handles(units: str) -> list[Patch]:
    """Explain the colours of the panels; `units` are those of chance."""
    return [
        Patch(color=MARK, alpha=0.45, label="significant"),
        Patch(color=BEFORE, alpha=0.3, label=f"mean ± 2 standard errors ({units} as units)"),
    ]


NARROWEST = 0.04
"""Share of its panel that a marked region takes at least: a narrower one could not be seen."""


def bins_panel(axes: Axes, variable: Variable, label: str, gap_label: str) -> None:
    """Draw the most telling row of one variable as steps with a band; bins that stand out are shaded."""
    row = variable.telling
    out = bool(variable.stands_out.any())
    wide = NARROWEST * float(variable.edges[-1] - variable.edges[0])
    for begin, end, mark in zip(variable.edges[:-1], variable.edges[1:], variable.stands_out):
        if mark:
            aside = max(wide - (end - begin), 0.0) / 2.0
            axes.axvspan(begin - aside, end + aside, color=MARK, alpha=0.45, linewidth=0, zorder=0)
    have = np.isfinite(row.mean)
    colour = BEFORE if out else "0.45"
    axes.axhline(0.0, color="0.3", linewidth=0.6, zorder=1)
    x = np.where(np.isfinite(variable.middle), variable.middle, 0.5 * (variable.edges[1:] + variable.edges[:-1]))
    axes.fill_between(
        x[have], (row.mean - 2 * row.error)[have], (row.mean + 2 * row.error)[have],
        color=colour, alpha=0.3, linewidth=0,
    )  # fmt: skip
    axes.plot(x[have], row.mean[have], "o-", color=colour, markersize=2.5, linewidth=1.0)
    most = float(np.max(np.abs(row.mean[have]) + 2 * np.nan_to_num(row.error[have]), initial=1e-9))
    axes.set_ylim(-1.15 * most, 1.15 * most)
    span = float(np.ptp(variable.edges))
    axes.set_xlim(float(variable.edges[0]) - 0.02 * span, float(variable.edges[-1]) + 0.02 * span)
    axes.set_xlabel(label, labelpad=1, fontsize=7, parse_math=False)
    axes.set_ylabel(gap_label, labelpad=1, fontsize=6.5)
    axes.set_title(
        f"p = {variable.p_value:.2g}" if out else "within chance",
        fontsize=7, fontweight="bold" if out else "normal", color="black" if out else "0.45", pad=2,
    )  # fmt: skip
    axes.tick_params(labelsize=6)


def _look(row: Row, dof: Dof) -> str:
    """What the vertical axis shows."""
    force = dof.words.force
    if row.kind == SIZE:
        return "log gap of the run"
    if row.unit == "%":
        return "own thrust [%]" + (f" × {dof.words.way}" if row.directed else "")
    word = {THRUST: "gap, equal thrust", dof.words.position: "gap"}.get(row.kind, f"missing {row.kind}")
    return f"{word} [{row.unit}]" + (f"\nalong the {force}" if row.directed else "")


def _heat_map(figure: Figure, axes: Axes, where: Where, less: str) -> None:
    """Residual headings, runs in order of their moment by time."""
    dof = where.dof
    order = np.argsort(where.mean_moment, kind="stable")
    ends = np.where(where.seen, where.time, 0.0).max(axis=1)
    grid = np.linspace(0.0, float(ends.max()), 240)
    image = np.full((len(order), len(grid)), np.nan)
    for line, i in enumerate(order):
        time, gap = where.time[i][where.seen[i]], dof.shown(where.residual[i][where.seen[i]])
        width = max(1, round(len(time) / 60))
        smooth = np.convolve(gap, np.ones(width), "same") / np.convolve(np.ones(len(gap)), np.ones(width), "same")
        image[line] = np.where(grid <= time[-1], np.interp(grid, time, smooth, left=np.nan), np.nan)
    most = max(float(np.nanquantile(np.abs(image), 0.99)), dof.shown(where.floor))
    mesh = axes.imshow(
        image, aspect="auto", origin="lower", cmap="PuOr", vmin=-most, vmax=most, interpolation="nearest",
        extent=(0.0, float(grid[-1]), -0.5, len(order) - 0.5),
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axes, pad=0.01)
    bar.set_label(f"measured − {less} [{dof.units.shown}]", fontsize=7)
    ticks = np.unique(np.linspace(0, len(order) - 1, min(len(order), 7)).round().astype(int))
    axes.set_yticks(ticks, [f"{where.mean_moment[order[i]]:.2g}" for i in ticks])
    axes.set_ylabel(f"runs by mean {dof.words.force} [{where.moment_unit}]")
    axes.set_xlabel("time in the run [s]")
    axes.grid(False)


@house_style
def why_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the evidence of every candidate in the first round against the threshold."""
    figure, grid = new_figure(1, 1, PAGE_IN, max(3.2, 0.17 * len(diagnosis.found.rounds[0].trials) + 1.2))
    found, first = diagnosis.found, diagnosis.found.rounds[0]
    gains = {trial.added[-1]: first.gain(trial) for trial in first.trials}
    rivals = {rival.name for rival in found.rivals}
    evidence_bars(grid[0, 0], gains, first.threshold, found.final.added, rivals)
    figure.legend(handles=_handles(diagnosis), loc="outside lower center", ncols=4)
    what = "the innovations of driven runs" if diagnosis.study.driven else "the gap"
    figure.suptitle(f"Which missing effect would explain {what}.\nVerdict: {diagnosis.words}")
    return figure


def _handles(diagnosis: Diagnosis) -> list[Any]:
    """What the colours of the bars mean, and the threshold."""
    chance = f"threshold ({1000 * LEVEL:.0f} in 1000 by chance)"
    return [
        Patch(color=AFTER, label="suspected" if diagnosis.verdict == SUSPECTED else "named"),
        Patch(color=COLOURS["sky"], label="rival not excluded"),
        Patch(color="0.72", label="not needed"),
        Line2D([], [], linestyle="--", color=BEFORE, label=chance),
    ]


def evidence_bars(
    axes: Axes, gain_of: Mapping[str, float], threshold: float, named: Collection[str], rivals: Collection[str]
) -> None:
    """Draw horizontal bars, best on top, on a scale that is linear up to the threshold and logarithmic beyond."""
    names = sorted(gain_of, key=lambda name: gain_of[name])
    gains = np.array([gain_of[name] for name in names])
    colours = [AFTER if name in named else COLOURS["sky"] if name in rivals else "0.72" for name in names]
    axes.barh(np.arange(len(names)), gains, color=colours, height=0.72)
    axes.axvline(threshold, color=BEFORE, linewidth=1.2, linestyle="--")
    axes.axvline(0.0, color="0.3", linewidth=0.6)
    axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    most = max(2.5 * float(gains.max(initial=0.0)), 20.0)
    low = min(float(gains.min(initial=0.0)), 0.0)
    axes.set_xlim(1.2 * low - 1.0, most)
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if 1.2 * low - 1.0 <= tick <= most]
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yticks(np.arange(len(names)), names)
    for label, name in zip(axes.get_yticklabels(), names):
        label.set_fontweight("bold" if name in named else "normal")
    for at, gain in enumerate(gains):
        if gain > 0.4 * threshold:
            axes.annotate(f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5)
    axes.set_xlabel("evidence gained over the base model [deviance]")
    axes.grid(False, axis="y")
    axes.margins(y=0.01)
