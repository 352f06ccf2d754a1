"""Figures of diagnoses of motions, the plane and thruster maps: where the gap is, why, and before and after."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.residual_regions import ResidualRegions, Variable
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.dofs import Dof
from automarine_cli.report.figures import style
from automarine_cli.report.tables import number

STATUS = {"named": "blue", "suspected": "blue", "rival": "sky", "not needed": "grey", "not fitted": "yellow"}
"""Colours of what became of candidates; the bars of those that were not fitted are promises."""
BEFORE_AFTER = ("before", "after")
MAX_VARIABLES, MAX_CANDIDATES, MAX_TITLE_LINE = 6, 24, 104


@style.house_style
def where_figure(where: ResidualRegions) -> Figure:
    """Draw the gap against each variable that stands out, or where there is none the one that is nearest to it."""
    variables = sorted(where.variables, key=lambda v: (v.p_value, -float(np.abs(v.telling.t).max())))
    out = [variable for variable in variables if variable.stands_out.any()]
    drawn = (out or variables[:1])[:MAX_VARIABLES]
    figure, axes = style.panels(len(drawn), 3 if len(drawn) == 3 else 2, 2.1, 0.8)
    for ax, variable in zip(axes.flat, drawn):
        _bins(ax, variable)
    style.legend_below(figure, axes.flat[0])
    names = dict.fromkeys(_words(variable) for variable in out)
    rest = dict.fromkeys(_words(variable) for variable in variables if _words(variable) not in names)
    finding = f"The gap depends on {', '.join(names) or 'nothing beyond chance'}"
    lines = (fill(line, MAX_TITLE_LINE) for line in (finding, f"Within chance: {', '.join(rest) or 'none'}"))
    figure.suptitle("\n".join(lines), parse_math=False)
    return figure


def _words(variable: Variable) -> str:
    return variable.column.name.replace("-", " ")


def _bins(axes: Axes, variable: Variable) -> None:
    """Draw the most telling row of one variable; bins that stand out are shaded."""
    row, edges, out = variable.telling, variable.edges, variable.stands_out
    if out.any():
        pale = 1.0 - 0.45 * (1.0 - np.array(to_rgb(style.COLOURS["yellow"])))
        look: dict[str, Any] = {"color": pale, "ec": pale, "lw": 3.0, "zorder": 0.5, "label": "significant"}
        axes.bar(edges[:-1][out], 1.0, np.diff(edges)[out], align="edge", transform=axes.get_xaxis_transform(), **look)
    axes.axhline(0.0, color="0.3", lw=0.6)
    look = {"color": style.COLOURS["vermilion"], "capsize": 2.0, "label": "mean ± 2 standard errors"}
    axes.errorbar(variable.middle, row.mean, 2.0 * row.error, fmt="o-", **look)
    axes.set_xlabel(f"{_words(variable)} [{variable.column.unit}]".removesuffix(" []"), parse_math=False)
    axes.set_ylabel(f"gap in {row.kind} [{row.unit}]" + ("\nalong the command" if row.directed else ""))


@style.house_style
def why_figure(rows: Sequence[Mapping[str, Any]], threshold: float, line: str) -> Figure:
    """Draw the evidence of candidates, rows of the table with their status, against the threshold, best on top: the
    MAX_CANDIDATES best, and all with a name; `line` says what the threshold is."""
    fewer = [row for i, row in enumerate(rows) if i < MAX_CANDIDATES or not row["is"].startswith("not ")]
    more, rows = len(rows) - len(fewer), fewer
    figure, ((axes,),) = style.new_figure(1, 1, style.PAGE_IN, max(2.2, 0.17 * len(rows) + 1.3))
    for status, colour in STATUS.items():
        gains = {place: row["evidence gained"] for place, row in enumerate(rows) if row["is"] == status}
        if gains:
            bars = axes.barh([*gains], [*gains.values()], color=style.COLOURS[colour], label=status)
            axes.bar_label(bars, fmt="%.0f", padding=3, fontsize=6.5)
    axes.axvline(threshold, color=style.COLOURS["vermilion"], ls="--", label=line)
    axes.set_yticks(range(len(rows)), [row["effect"] for row in rows], parse_math=False)
    axes.invert_yaxis()
    axes.margins(x=0.08, y=0.01)
    less = f"; {more} more candidates gain less" if more else ""
    axes.set_xlabel(f"evidence gained over the base model [deviance]{less}")
    best = ", ".join(f"{row['effect']} {row['evidence gained']:.0f}" for row in rows[:2])
    axes.set_title(f"Evidence: {best or 'none'}; needed {number(threshold, 3)}", loc="left", parse_math=False)
    style.legend_below(figure, axes, ncols=5)
    return figure


def before_after(diagnosis: Diagnosis, alone: str = "") -> Figure:
    """Draw what both models leave of the runs; `alone` says what they leave from the commands alone."""
    part, dof, plane, residuals = diagnosis.decisive, diagnosis.dof, diagnosis.motion.turns, list[style.Residuals]()
    gap = part.gap
    for r, run in enumerate(part.runs):
        of_run: Any = (r, slice(len(run))) if gap.targets is None else gap.targets[0] == r
        clock = run.time - run.time[0] if gap.targets is None else gap.targets[1][of_run]
        residuals.append((run.name, [(clock, np.asarray(dof.shown(errors[of_run]))) for errors in gap.residuals]))
    state = "" if plane else " from filtered states"
    how = f"predicted {gap.horizon:g} s ahead{state}" if diagnosis.driven else "with their own thrust and start"
    title = f"{'Headings of runs' if plane else 'Runs'} {'fitted' if part is diagnosis.fitted else 'held out'}, {how}"
    floor = float(dof.shown(gap.floor))
    return style.residuals_figure(residuals, BEFORE_AFTER, dof.units.shown, floor, title, beneath=alone)


def thruster_before_after(result: ThrusterDiagnosis) -> Figure:
    parts = {"levels fitted": result.base.data, "levels held out": result.held_out}
    residuals = [
        (name, [(data.n, data.force - fit.thrust(data)) for fit in (result.base, result.final)])
        for name, data in parts.items()
        if data is not None
    ]
    control = f"control signal n [{result.data.n_unit or 'as logged'}]"
    title = f"Thrust; before is the {result.given.form} map refitted"
    return style.residuals_figure(residuals, BEFORE_AFTER, "N", result.gap.floor, title, control, "o")


@style.house_style
def learned_figure(curve: LearnedCurve, dof: Dof) -> Figure:
    figure, ((axes,),) = style.new_figure(1, 1, 0.62 * style.PAGE_IN, 2.9)
    names = {"moment": dof.words.force, "gain": "change of thrust", "drag": "change of linear drag"}
    scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
    axes.fill_between(curve.x, scale * curve.low, scale * curve.high, alpha=0.4, lw=0, label="95 % band")
    axes.plot(curve.x, scale * curve.y, label="learned curve")
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    variable = f"{'size of ' if curve.sized else ''}{curve.variable} [{curve.unit}]".removesuffix(" []")
    axes.set_xlabel(variable, parse_math=False)
    axes.set_ylabel(f"{names[curve.kind]} [{unit}]", parse_math=False)
    axes.set_title(f"No effect of the library is like it: {curve.kind} by {variable}", loc="left", parse_math=False)
    axes.legend()
    return figure
