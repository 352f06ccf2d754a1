"""Before and after: headings, errors, and error by the most telling variable."""

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.study import JUDGED
from automarine_cli.diagnosis.verdict import NAMED
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.diagnosis_words import AFTER, BEFORE, in_words
from automarine_cli.report.figures.style import MEASURED, PAGE_IN, house_style, new_figure

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
