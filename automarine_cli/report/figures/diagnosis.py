"""Figures of diagnoses of motions, the plane and thruster maps: where the gap is, why, and before and after."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.stats import binned_statistic

from automarine_cli.diagnosis.diagnose import NAMED, Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.planar import PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import ResidualRegions, Variable, Where
from automarine_cli.diagnosis.study import HORIZON
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.dofs import YAW, Dof
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style

BEFORE, AFTER, MARK, RIVAL = (style.COLOURS[name] for name in ("vermilion", "blue", "yellow", "sky"))
STATUS = {"named": AFTER, "suspected": AFTER, "rival": RIVAL, "not needed": "0.6", "not fitted": "0.85"}
"""Colours of what became of candidates; the bars of those that were not fitted are promises."""
MOST_VARIABLES, COLUMNS = 12, 4
TIME_BINS, RUN_TICKS = 60, 8  # of the heat map
LONGEST_NAME, LONGEST_LINE = 26, 104  # letters that have room above a panel and in the title


@style.house_style
def where_figure(where: ResidualRegions, words: str) -> Figure:
    """Draw small multiples, one a variable, most significant first, above a heat map of runs by time where there are
    runs; `words` are the verdict."""
    variables = sorted(where.variables, key=lambda v: (v.p_value, -float(np.abs(v.telling.t).max())))[:MOST_VARIABLES]
    columns = max(min(len(variables), COLUMNS), 1)
    heights = [1.55] * max(-(-len(variables) // columns), 1) + [2.6] * isinstance(where, Where)
    figure, grid = style.new_figure(len(heights), columns, style.PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid.ravel()
    for axes, variable in zip(panels, variables):
        _bins(axes, variable)
    for axes in panels[len(variables) :]:
        axes.set_axis_off()
    if isinstance(where, Where):
        _heat_map(figure, style.widened(figure, grid[-1]), where)
    handles = [
        Patch(color=MARK, alpha=0.45, label="significant"),
        Patch(color=BEFORE, alpha=0.3, label="mean ± 2 standard errors"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    out = sum(bool(variable.stands_out.any()) for variable in where.variables)
    depends = f"{out or 'none'} of {len(where.variables)}{' (yellow)' * bool(out)}"
    figure.suptitle(f"Variables on which the error depends: {depends}. Verdict: {words}")
    return figure


def _bins(axes: Axes, variable: Variable) -> None:
    """Draw the most telling row of one variable as steps with a band; bins that stand out are shaded."""
    row, edges, out = variable.telling, variable.edges, bool(variable.stands_out.any())
    for begin, end in zip(edges[:-1][variable.stands_out], edges[1:][variable.stands_out]):
        axes.axvspan(begin, end, color=MARK, alpha=0.45, lw=0.8, zorder=0)  # its edge shows where it is too narrow
    have = np.isfinite(row.mean)
    x, mean, error, colour = variable.middle[have], row.mean[have], row.error[have], BEFORE if out else "0.45"
    axes.axhline(0.0, color="0.3", lw=0.6, zorder=1)
    axes.fill_between(x, mean - 2 * error, mean + 2 * error, color=colour, alpha=0.3, lw=0)
    axes.plot(x, mean, "o-", color=colour, ms=2.5, lw=1.0)
    unit = f" [{variable.unit}]" * bool(variable.unit)

    axes.set_xlabel(f"{variable.name}{unit}", labelpad=1, fontsize=7, parse_math=False)
    along = "\nalong the command" * row.directed
    axes.set_ylabel(f"gap in {row.kind} [{row.unit}]{along}", labelpad=1, fontsize=6.5)
    title = f"p = {variable.p_value:.2g}" if out else "within chance"
    axes.set_title(title, fontsize=7, color="black" if out else "0.45", pad=2)
    axes.tick_params(labelsize=6)


def _heat_map(figure: Figure, axes: Axes, where: Where) -> None:
    """Draw the mean gap in bins of time, a line a run, in the order of the runs' mean commands."""
    dof = where.dof
    order, end = np.argsort(where.mean_moment, kind="stable"), float(where.time[where.observed].max())
    runs = zip(where.time[order], dof.shown(where.residual[order]), where.observed[order])
    image = [binned_statistic(time[has], gap[has], bins=TIME_BINS, range=(0, end))[0] for time, gap, has in runs]
    most = max(float(np.nanquantile(np.abs(image), 0.99)), float(dof.shown(where.floor)))
    extent = (0.0, end, -0.5, len(order) - 0.5)
    mesh = axes.imshow(image, cmap="PuOr", vmin=-most, vmax=most, origin="lower", aspect="auto", extent=extent)
    less = f"predicted {where.ahead:g} s ahead" if where.ahead else "simulated"
    figure.colorbar(mesh, ax=axes, pad=0.01).set_label(f"measured − {less} [{dof.units.shown}]", fontsize=7)
    ticks = range(0, len(order), -(-len(order) // RUN_TICKS))
    axes.set_yticks(ticks, [f"{where.mean_moment[order[i]]:.2g}" for i in ticks])
    axes.set(xlabel="time in the run [s]", ylabel=f"runs by mean {dof.words.force} [{where.moment_unit}]")
    axes.grid(False)


@style.house_style
def why_figure(rows: Sequence[Mapping[str, Any]], threshold: float, line: str, words: str) -> Figure:
    """Draw the evidence of each candidate, a row of the table with its status, against the threshold as horizontal
    bars, best on top, on a scale that is linear up to ten and logarithmic beyond; `line` says what the threshold is."""
    figure, ((axes,),) = style.new_figure(1, 1, style.PAGE_IN, max(3.0, 0.17 * len(rows) + 1.3))
    bars = sorted(rows, key=lambda row: row["evidence gained"])
    gains, colours = [row["evidence gained"] for row in bars], [STATUS[row["is"]] for row in bars]
    drawn = axes.barh(range(len(bars)), gains, color=colours, height=0.72)
    axes.bar_label(drawn, fmt="%.0f", padding=3, fontsize=6.5)
    axes.axvline(threshold, color=BEFORE, lw=1.2, ls="--")
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_yticks(range(len(bars)), [row["effect"] for row in bars], parse_math=False)
    axes.grid(False, axis="y")
    axes.margins(x=0.08, y=0.01)
    axes.set_xlabel("evidence gained over the base model [deviance]")
    words_of = {row["is"] for row in rows}
    handles: list[Any] = [Patch(color=colour, label=word) for word, colour in STATUS.items() if word in words_of]
    handles.append(Line2D([], [], ls="--", color=BEFORE, label=line))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle(f"Which missing effect would explain the gap. Verdict: {words}")
    return figure


Line = tuple[Floats, Floats]


@dataclass(frozen=True)
class Case:
    """A run, or levels of a thruster, in the unit that is shown: what was measured, and by how much the model is off
    before and after, over its own x; what the model says is drawn as `curves` where there are some."""

    title: str
    x: Floats
    measured: Floats
    errors: Sequence[Line]
    curves: Sequence[Line] = ()


@singledispatch
def before_after_figure(result: Any) -> Figure:
    """Draw telling cases of a diagnosis with both models, and their errors on equal axes."""
    raise TypeError(f"no figure of a {type(result).__name__} is drawn before and after")


@style.house_style
def _before_after(
    cases: Sequence[Case], title: str, measures: str, names: tuple[str, str], unit: str, floor: float,
    x_label: str = "time [s]",
) -> Figure:  # fmt: skip
    figure, grid = style.new_figure(2, max(len(cases), 1), style.PAGE_IN, 4.5)
    most = 1.08 * max((float(np.abs(error).max(initial=0.0)) for case in cases for _, error in case.errors), default=0)
    for case, top, bottom in zip(cases, *grid):
        top.plot(case.x, case.measured, "o", color=style.MEASURED, ms=3.0 if case.curves else 1.6, label="measured")
        bottom.axhspan(-2 * floor, 2 * floor, color="0.9", lw=0, label="± 2 × noise")
        bottom.axhline(0.0, color="0.3", lw=0.6)
        curves = case.curves or [(x, np.interp(x, case.x, case.measured) - error) for x, error in case.errors]
        looks = zip((BEFORE, AFTER), ("--", "-"), ("none", AFTER), names)
        for curve, error, (colour, dashes, fill, label) in zip(curves, case.errors, looks):
            top.plot(*curve, color=colour, lw=1.0, ls=dashes, label=label)
            bottom.plot(*error, "o" if case.curves else "-", color=colour, lw=0.7, ms=3.0, mfc=fill)
        low, high = float(case.measured.min()), float(case.measured.max())
        style.limit(top, low, high, 0.5 * (high - low) + 1e-6)
        top.set_title(case.title, fontsize=6.5, parse_math=False)
        bottom.sharex(top)
        bottom.set_ylim(-(most or 1.0), most or 1.0)
        bottom.set_xlabel(x_label, labelpad=1)
    grid[0, 0].set_ylabel(f"{measures} [{unit}]")
    grid[1, 0].set_ylabel(f"measured − modelled [{unit}]")
    style.legend_below(figure, grid[0, 0], grid[1, 0], ncols=5)
    figure.suptitle("\n".join(textwrap.fill(line, LONGEST_LINE) for line in title.split("\n")))
    return figure


def _titled(name: str, word: str) -> str:
    return f"{style.shortened(name, LONGEST_NAME)}\n{word}"


def _largest_and_middle(size: Floats) -> list[int]:
    """The run with the largest gap and the one with the middle gap; those without a gap are neither."""
    order = np.argsort(-size, kind="stable")[: np.isfinite(size).sum()]
    return [int(i) for i in dict.fromkeys(order[[0, len(order) // 2]])] if len(order) else []


@before_after_figure.register
def _(diagnosis: Diagnosis) -> Figure:
    driven, dof = diagnosis.study.driven, diagnosis.study.base.dof
    cases, gaps = list[Case](), list[str]()
    held_out = diagnosis.held_out, diagnosis.held_out_gap, "held out"
    for study, gap, word in ((diagnosis.study, diagnosis.gap, "fitted"), held_out):
        if study is None or gap is None:
            continue
        gaps.append(f"runs {word} {dof.shown(gap.before):.2f} → {dof.shown(gap.after):.2f} {dof.units.shown}")
        residuals = [np.asarray(dof.shown(residual)) for residual in (gap.residuals_before, gap.residuals_after)]
        for i in _largest_and_middle((residuals[0] ** 2).sum(axis=1) / study.batch.seen.sum(axis=1)):
            run = study.runs[i]
            time, off = run.time - run.time[0], [residual[i, : len(run)] for residual in residuals]
            # of driven runs nothing is predicted before the first filtered state
            errors = [(time[have], error[have]) for error in off for have in [(error != 0.0) | (not driven)]]
            cases.append(Case(_titled(run.name, word), time, dof.shown(run.position - run.position[0]), errors))
    floor, ahead = float(dof.shown(diagnosis.gap.floor)), f", {HORIZON:g} s ahead" * driven
    first = f"Predictions {HORIZON:g} s ahead from filtered states" if driven else "Gap"
    title = f"{first}: {', '.join(gaps)} (noise {floor:.2f} {dof.units.shown}). Verdict: {diagnosis.words}"
    return _before_after(
        cases, title, dof.words.moved, (f"base model{ahead}", f"after{ahead}"), dof.units.shown, floor,
    )  # fmt: skip


@before_after_figure.register
def _(search: PlanarSearch) -> Figure:
    """The heading as both models predict it some seconds ahead."""
    runs, time = search.every.runs, search.every.course.time
    ahead = [judged(forecast[YAW.position]) for forecast in search.forecasts]
    gaps, cases = ahead[0].by_run(ahead[0].error, len(runs)), list[Case]()
    for word, first, part in (("fitted", 0, gaps[: search.fitted]), ("held out", search.fitted, gaps[search.fitted :])):
        for r in (first + i for i in _largest_and_middle(part)):
            errors = [(time[r, p.target[p.run == r]], np.asarray(YAW.shown(p.error[p.run == r]))) for p in ahead]
            heading = np.asarray(YAW.shown(runs[r].position))
            cases.append(Case(_titled(runs[r].name, word), runs[r].time - runs[r].time[0], heading, errors))
    return _before_after(
        cases,
        f"Predictions {ahead[0].horizon:g} s ahead, from filtered states, by the commands as they were logged.\n"
        f"Verdict: {search.words}",
        r"heading $\psi$", ("predicted, before", "predicted, after"), YAW.units.shown,
        float(YAW.shown(search.after.noises[YAW.position])),
    )  # fmt: skip


@before_after_figure.register
def _(result: ThrusterDiagnosis) -> Figure:
    cases, n, maps = [], result.data.n, (result.base, result.final)
    curves = [(along, fit.along(along)) for along in [np.linspace(n.min(), n.max(), 801)] for fit in maps]
    gaps = {"fitted": (result.base.data, result.gap), "held out": (result.held_out, result.held_out_gap)}
    for word, (data, gap) in gaps.items():
        if data is not None and gap is not None:
            errors = [(data.n, data.force - fit.thrust(data)) for fit in maps]
            title = f"levels {word}: {gap.before:.3g} → {gap.after:.3g} N"
            cases.append(Case(title, data.n, data.force, errors, curves))
    names = " and ".join(effect.name for effect in result.effects) if result.verdict == NAMED else "nothing"
    return _before_after(
        cases, f"Before: the {result.given.form} map refitted. Added: {names}", "thrust of one thruster",
        ("before", "after"), "N", result.gap.floor, f"control signal n [{result.data.n_unit or 'as logged'}]",
    )  # fmt: skip


@style.house_style
def learned_figure(curve: LearnedCurve, dof: Dof) -> Figure:
    figure, ((axes,),) = style.new_figure(1, 1, 0.62 * style.PAGE_IN, 2.9)
    names = {"moment": dof.words.force, "gain": "change of thrust", "drag": "change of linear drag"}
    scale, unit = (100.0, "%") if curve.kind == "gain" else (1.0, curve.y_unit)
    axes.fill_between(curve.x, scale * curve.low, scale * curve.high, alpha=0.4, lw=0, label="95 % band")
    axes.plot(curve.x, scale * curve.y, label="learned curve")
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    variable = f"{'size of ' * curve.sized}{curve.variable}" + f" [{curve.unit}]" * bool(curve.unit)
    axes.set_xlabel(variable, parse_math=False)
    axes.set_ylabel(f"{names[curve.kind]} [{unit}]", parse_math=False)
    axes.legend()
    return figure
