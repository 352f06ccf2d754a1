"""Figures of diagnoses of motions, the plane and thruster maps: where the gap is, why, and before and after."""

import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, singledispatch
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from automarine_cli.diagnosis.diagnose import NAMED, Diagnosis
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.planar import PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, ResidualRegions, Row, Variable, Where
from automarine_cli.diagnosis.study import HORIZON
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.dofs import YAW, Dof
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.figures.runs import track

BEFORE, AFTER, MARK, RIVAL = (style.COLOURS[name] for name in ("vermilion", "blue", "yellow", "sky"))
STATUS = {"named": AFTER, "suspected": AFTER, "rival": RIVAL, "not needed": "0.6", "not fitted": "0.85"}
"""Colours of what became of candidates; the bars of those that were not fitted are promises."""
MOST_PANELS, COLUMNS = 12, 4
MOST_RUNS_SHOWN = 4
WIDEST = 104  # letters that have room side by side in the title
NARROWEST = 0.04  # share of its panel that a marked region takes at least: a narrower one could not be seen
LABEL = {
    "n": "control signal n", "voltage": "supply voltage", "time-in-run": "time in the run",
    "time-since-command-change": "time since command changed",
}  # fmt: skip


def in_words(variable: Variable) -> str:
    name = variable.name
    if not variable.logged:
        name = re.sub(r"(.+)-size$", r"size of the \1", LABEL.get(name, name)).replace("-", " ")
    return name + ", by run" * variable.of_the_run + f" [{variable.unit}]" * bool(variable.unit)


@style.house_style
def where_figure(looked: ResidualRegions, words: str, units: str = "runs") -> Figure:
    """Draw small multiples, one a variable, most significant first, above a heat map of runs by time where there are
    runs; `words` are the verdict, `units` are what chance turns."""
    dof = looked.dof if isinstance(looked, Where) else None
    variables = sorted(looked.variables, key=_by_significance)[:MOST_PANELS]
    columns = COLUMNS if dof else max(min(len(variables), COLUMNS), 1)
    heights = [1.55 if dof else 2.2] * max(-(-len(variables) // columns), 1)
    rows = len(heights)
    heights += [2.6] * bool(dof)
    figure, grid = style.new_figure(len(heights), columns, style.PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid[:rows].ravel()
    for axes, variable in zip(panels, variables):
        _bins(axes, variable, dof)
    for axes in panels[len(variables) :]:
        axes.set_axis_off()
    if isinstance(looked, Where):
        (heat,) = style.span(figure, grid[rows], slice(None))
        _heat_map(figure, heat, looked)
    handles = [
        Patch(color=MARK, alpha=0.45, label="significant"),
        Patch(color=BEFORE, alpha=0.3, label=f"mean ± 2 standard errors ({units} as units)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    out = sum(bool(variable.stands_out.any()) for variable in looked.variables)
    many = f"{len(looked.variables)} variable{'s' * (len(looked.variables) != 1)}"
    depends = f"{out or 'none'} of {many}{' (yellow)' * bool(out)}"
    figure.suptitle(f"The error depends on {depends}. Verdict: {words}")
    return figure


def _by_significance(variable: Variable) -> tuple[float, float]:
    return variable.p_value, -float(np.abs(variable.telling.t).max())


def _bins(axes: Axes, variable: Variable, dof: Dof | None) -> None:
    """Draw the most telling row of one variable as steps with a band; bins that stand out are shaded."""
    row, edges, out = variable.telling, variable.edges, bool(variable.stands_out.any())
    reach = float(np.ptp(edges))
    for begin, end in zip(edges[:-1][variable.stands_out], edges[1:][variable.stands_out]):
        aside = max(NARROWEST * reach - (end - begin), 0.0) / 2.0
        axes.axvspan(begin - aside, end + aside, color=MARK, alpha=0.45, lw=0, zorder=0)
    have = np.isfinite(row.mean)
    colour = BEFORE if out else "0.45"
    axes.axhline(0.0, color="0.3", lw=0.6, zorder=1)
    x = np.where(np.isfinite(variable.middle), variable.middle, 0.5 * (edges[1:] + edges[:-1]))
    low, high = (row.mean - 2 * row.error)[have], (row.mean + 2 * row.error)[have]
    axes.fill_between(x[have], low, high, color=colour, alpha=0.3, lw=0)
    axes.plot(x[have], row.mean[have], "o-", color=colour, ms=2.5, lw=1.0)
    most = float(np.max(np.abs(row.mean[have]) + 2 * np.nan_to_num(row.error[have]), initial=1e-9))
    axes.set_ylim(-1.15 * most, 1.15 * most)
    axes.set_xlim(float(edges[0]) - 0.02 * reach, float(edges[-1]) + 0.02 * reach)
    label = in_words(variable) if dof else in_words(variable).replace(", by run", "")
    axes.set_xlabel(label, labelpad=1, fontsize=7, parse_math=False)
    axes.set_ylabel(_gap_of(row, dof), labelpad=1, fontsize=6.5)
    weight, ink = ("bold", "black") if out else ("normal", "0.45")
    title = f"p = {variable.p_value:.2g}" if out else "within chance"
    axes.set_title(title, fontsize=7, fontweight=weight, color=ink, pad=2)
    axes.tick_params(labelsize=6)


def _gap_of(row: Row, dof: Dof | None) -> str:
    if row.kind == SIZE:
        return "log size of the gap"
    if dof is None:
        return f"measured − map [{row.unit}]" + "\nalong the thrust" * row.directed
    if row.unit == "%":
        return "own thrust [%]" + f" × {dof.words.way}" * row.directed
    word = {THRUST: "gap, equal thrust", dof.words.position: "gap"}.get(row.kind, f"missing {row.kind}")
    return f"{word} [{row.unit}]" + f"\nalong the {dof.words.force}" * row.directed


def _heat_map(figure: Figure, axes: Axes, where: Where) -> None:
    dof = where.dof
    less = f"predicted {where.ahead:g} s ahead" if where.ahead else "simulated"
    order = np.argsort(where.mean_moment, kind="stable")
    ends = np.where(where.observed, where.time, 0.0).max(axis=1)
    grid = np.linspace(0.0, float(ends.max()), 240)
    image = np.full((len(order), len(grid)), np.nan)
    for line, i in enumerate(order):
        time, gap = where.time[i][where.observed[i]], dof.shown(where.residual[i][where.observed[i]])
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


@style.house_style
def why_figure(rows: Sequence[Mapping[str, Any]], threshold: float, line: str, words: str) -> Figure:
    """Draw the evidence of each candidate, a row of the table with its status, against the threshold as horizontal
    bars, best on top, on a scale that is linear up to ten and logarithmic beyond; `line` says what the threshold is."""
    figure, ((axes,),) = style.new_figure(1, 1, style.PAGE_IN, max(3.0, 0.17 * len(rows) + 1.3))
    bars = sorted(rows, key=lambda row: row["evidence gained"])
    gains, colours = [row["evidence gained"] for row in bars], [STATUS[row["is"]] for row in bars]
    axes.barh(range(len(bars)), gains, color=colours, height=0.72)
    axes.axvline(threshold, color=BEFORE, lw=1.2, ls="--")
    axes.axvline(0.0, color="0.3", lw=0.6)
    axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    axes.set_yticks(range(len(bars)), [row["effect"] for row in bars], parse_math=False)
    for at, (text, gain, colour) in enumerate(zip(axes.get_yticklabels(), gains, colours)):
        text.set_fontweight("bold" if colour == AFTER else "normal")
        if gain > 0.4 * threshold:
            axes.annotate(f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5)
    axes.grid(False, axis="y")
    axes.margins(y=0.01)
    low, high = 1.2 * min([0.0, *gains]) - 1.0, max([20.0, *(2.5 * gain for gain in gains)])
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if low <= tick <= high]
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("evidence gained over the base model [deviance]")
    words_of = {row["is"] for row in rows}
    handles: list[Any] = [Patch(color=colour, label=word) for word, colour in STATUS.items() if word in words_of]
    handles.append(Line2D([], [], ls="--", color=BEFORE, label=line))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle(f"Which missing effect would explain the gap. Verdict: {words}")
    return figure


Line = tuple[Floats, Floats]
Draw = Callable[[Axes], None]
Sizes = tuple[str, Floats, Floats]
"""Which runs, and the gap of each before and after."""


@dataclass(frozen=True)
class Case:
    """A run, or levels of a thruster, in the unit that is shown: what was measured, and by how much the model is off
    before and after, over its own x; what the model says is drawn as `curves` where there are some."""

    title: str
    x: Floats
    measured: Floats
    errors: Sequence[Line]
    curves: Sequence[Line] = ()
    doubtful: NDArray[np.bool_] | None = None


@singledispatch
def before_after_figure(result: Any) -> Figure:
    """Draw telling cases of a diagnosis with both models, their errors on equal axes and, of runs, the gap of each."""
    raise TypeError(f"no figure of a {type(result).__name__} is drawn before and after")


@style.house_style
def _before_after(
    cases: Sequence[Case], title: str, measures: str, names: tuple[str, str], unit: str, floor: float,
    x_label: str = "time [s]", sizes: Sequence[Sizes] = (), beside: Draw | None = None, tracks: Sequence[Draw] = (),
) -> Figure:  # fmt: skip
    heights = [1.5, 1.2] + [1.4] * bool(tracks) + [1.4] * bool(sizes)
    columns = max(len(cases), 1)
    height = 2.0 * max(len(heights), 2.5)
    figure, grid = style.new_figure(len(heights), columns, style.PAGE_IN, height, height_ratios=heights)
    most = 1.08 * max((float(np.abs(error).max(initial=0.0)) for case in cases for _, error in case.errors), default=0)
    for case, top, bottom in zip(cases, *grid[:2]):
        top.plot(case.x, case.measured, "o", color=style.MEASURED, ms=3.0 if case.curves else 1.6, label="measured")
        bottom.axhspan(-2 * floor, 2 * floor, color="0.9", lw=0, label="± 2 × noise")
        bottom.axhline(0.0, color="0.3", lw=0.6)
        curves = case.curves or [(x, np.interp(x, case.x, case.measured) - error) for x, error in case.errors]
        looks = zip((BEFORE, AFTER), ("--", "-"), ("none", AFTER), names)
        for curve, error, (colour, dashes, fill, label) in zip(curves, case.errors, looks):
            top.plot(*curve, color=colour, lw=1.0, ls=dashes, label=label)
            bottom.plot(*error, "o" if case.curves else "-", color=colour, lw=0.7, ms=3.0, mfc=fill)
        if case.doubtful is not None and case.doubtful.any():
            doubtful = case.x[case.doubtful], case.measured[case.doubtful]
            top.plot(*doubtful, "x", color="black", ms=6.0, zorder=4, label="little weight")
        low, high = float(case.measured.min()), float(case.measured.max())
        style.limit(top, low, high, 0.5 * (high - low), [y[np.isfinite(y)] for _, y in curves])
        top.set_title(case.title, fontsize=6.5, parse_math=False)
        bottom.sharex(top)
        bottom.set_ylim(-(most or 1.0), most or 1.0)
        bottom.set_xlabel(x_label, labelpad=1)
    for axes in grid[1, 1:]:
        axes.set_yticklabels([])
    grid[0, 0].set_ylabel(f"{measures} [{unit}]")
    grid[1, 0].set_ylabel(f"measured − modelled [{unit}]")
    for axes, draw in zip(grid[2:].flat, tracks):
        draw(axes)
    if sizes:
        half = max(columns // 2, 1) if beside else columns
        parts = [slice(None, half)] + [slice(half, None)] * (half < columns)
        left, *right = style.span(figure, grid[-1], *parts)
        _sizes(left, sizes, unit, floor)
        if beside and right:
            beside(right[0])
        elif not beside:
            left.set_box_aspect(1.0)
    style.legend_below(figure, grid[0, 0], grid[1, 0], ncols=5)
    figure.suptitle("\n".join(textwrap.fill(line, WIDEST) for line in title.split("\n")))
    return figure


def _sizes(axes: Axes, groups: Sequence[Sizes], unit: str, floor: float) -> None:
    """Draw the gap of every run before against after, on equal axes."""
    for (word, before, after), marker, fill in zip(groups, "os", (AFTER, "none")):
        axes.plot(before, after, marker, color=AFTER, mfc=fill, ms=3.5, label=f"runs {word}")
    top = 1.05 * max((float(np.nanmax(gaps)) for _, *pair in groups for gaps in pair if len(gaps)), default=1.0)
    axes.plot([0, top], [0, top], color="0.4", lw=0.7, ls=":")
    axes.axhline(floor, color="0.5", lw=0.8, ls="--", label="noise")
    axes.set(xlim=(0.0, top), ylim=(0.0, top), ylabel=f"gap after [{unit}]")
    axes.set_xlabel(f"gap before [{unit}]", labelpad=1)
    axes.legend(loc="upper left", fontsize=6.5)


def _titled(name: str, word: str) -> str:
    return f"{name if len(name) <= 26 else f'…{name[-25:]}'}\n{word}"  # names of runs differ at their end


def _two_of(size: Floats, among: NDArray[np.int64]) -> list[int]:
    """The run with the largest and the one with the middle gap."""
    order = among[np.argsort(-size[among], kind="stable")]
    return list(dict.fromkeys([int(order[0]), int(order[len(order) // 2])])) if len(order) else []


@before_after_figure.register
def _(diagnosis: Diagnosis) -> Figure:
    driven, dof = diagnosis.study.driven, diagnosis.study.base.dof
    cases, sizes, gaps = list[Case](), list[tuple[str, Floats, Floats]](), list[str]()
    held_out = diagnosis.held_out, diagnosis.held_out_gap, "held out"
    for study, gap, word in ((diagnosis.study, diagnosis.gap, "fitted"), held_out):
        if study is None or gap is None:
            continue
        gaps.append(f"runs {word} {dof.shown(gap.before):.2f} → {dof.shown(gap.after):.2f} {dof.units.shown}")
        residuals = [np.asarray(dof.shown(residual)) for residual in (gap.residuals_before, gap.residuals_after)]
        before, after = (np.sqrt((residual**2).sum(axis=1) / study.batch.seen.sum(axis=1)) for residual in residuals)
        sizes.append((word, before, after))
        for i in _two_of(before, np.arange(len(study.runs))):
            run = study.runs[i]
            time, off = run.time - run.time[0], [residual[i, : len(run)] for residual in residuals]
            # of driven runs nothing is predicted before the first filtered state
            errors = [(time[have], error[have]) for error in off for have in [(error != 0.0) | (not driven)]]
            cases.append(Case(_titled(run.name, word), time, dof.shown(run.position - run.position[0]), errors))
    floor, ahead = float(dof.shown(diagnosis.gap.floor)), f", {HORIZON:g} s ahead" * driven
    first = f"Predictions {HORIZON:g} s ahead from filtered states" if driven else "Gap"
    word = "Added" if diagnosis.verdict == NAMED else "With what is only suspected"
    names = f"{word}: {' and '.join(diagnosis.result.final.added)}" if diagnosis.result.final.added else "Nothing added"
    return _before_after(
        cases[:MOST_RUNS_SHOWN], f"{first}: {', '.join(gaps)} (noise {floor:.2f} {dof.units.shown}). {names}",
        dof.words.moved, (f"base model{ahead}", f"after{ahead}"), dof.units.shown, floor, sizes=sizes,
        beside=partial(_by_variable, diagnosis),
    )  # fmt: skip


@before_after_figure.register
def _(search: PlanarSearch) -> Figure:
    """The heading, and the track where places are logged, as both models predict them some seconds ahead."""
    runs, course = search.every.runs, search.every.course
    ahead = [judged(forecast[YAW.position]) for forecast in search.forecasts]
    sizes = [np.asarray(YAW.shown(np.sqrt(each.by_run(each.error, len(runs))))) for each in ahead]
    values = {channel.quantity: channel.values for channel in course.channels}
    finite = np.flatnonzero(np.isfinite(sizes[0]))
    groups = {"fitted": finite[finite < search.fitted], "held out": finite[finite >= search.fitted]}
    picks = {r: word for word, group in groups.items() for r in _two_of(sizes[0], group)}
    cases = [
        Case(
            _titled(runs[r].name, word), runs[r].time - runs[r].time[0], np.asarray(YAW.shown(runs[r].position)),
            [(course.time[r, p.target[p.run == r]], np.asarray(YAW.shown(p.error[p.run == r]))) for p in ahead],
        )
        for r, word in picks.items()
    ]  # fmt: skip
    placed = set(PLACES) <= search.forecasts[0].keys()
    return _before_after(
        cases,
        f"Predictions {ahead[0].horizon:g} s ahead, from filtered states, by the commands as they were logged.\n"
        f"Added: {search.words if search.named else 'nothing'}",
        r"heading $\psi$", ("predicted, before", "predicted, after"), YAW.units.shown,
        float(YAW.shown(search.after.noises[YAW.position])),
        sizes=[(word, sizes[0][group], sizes[1][group]) for word, group in groups.items()],
        tracks=[partial(_track_of, search, values, r) for r in picks if placed],
    )  # fmt: skip


def _track_of(search: PlanarSearch, values: Mapping[str, Floats], r: int, axes: Axes) -> None:
    """Draw places as they were measured and predicted; what is predicted far from the measured leaves the picture."""
    track(axes, search.every.runs[r], 1.5)
    axes.autoscale_view()  # now: it waits until something is drawn, and would then be off
    axes.autoscale(False)
    for forecast, colour in zip(search.forecasts, (BEFORE, AFTER)):
        places = {name: judged(forecast[name]) for name in PLACES}
        of_run = places["north"].run == r
        line = {name: values[name][r, at.target[of_run]] - at.error[of_run] for name, at in places.items()}
        axes.plot(line["east"], line["north"], ".", color=colour, ms=1.5)
    axes.set_xlabel("East [m]")


@before_after_figure.register
def _(result: ThrusterDiagnosis) -> Figure:
    cases, n, maps = [], result.data.n, (result.base, result.final)
    curves = [(along, fit.along(along)) for along in [np.linspace(n.min(), n.max(), 801)] for fit in maps]
    gaps = {"fitted": (result.base.data, result.gap), "held out": (result.held_out, result.held_out_gap)}
    for word, (data, gap) in gaps.items():
        if data is not None and gap is not None:
            points, percent = data, f"{result.percent(gap.after):.2g} % of full scale"
            title = f"levels {word}: {gap.before:.3g} → {gap.after:.3g} N = {percent}"
            errors = [(points.n, points.force - fit.thrust(data)) for fit in maps]
            cases.append(Case(title, points.n, points.force, errors, curves, points.flag != ""))
    volts = f" at {result.final.reference:.3g} V" if result.final.shape.voltage else ""
    names = " and ".join(effect.name for effect in result.effects) if result.verdict == NAMED else "nothing"
    return _before_after(
        cases, f"Before: the {result.given.form} map refitted. Added: {names}",
        "thrust of one thruster", ("before", f"after{volts}"), "N", result.gap.floor,
        f"control signal n [{result.data.n_unit or 'as logged'}]",
    )  # fmt: skip


def _by_variable(diagnosis: Diagnosis, axes: Axes) -> None:
    where, dof = diagnosis.where, diagnosis.where.dof
    variable, column = min(zip(where.variables, where.columns), key=lambda pair: _by_significance(pair[0]))
    row = variable.telling
    if column.of_the_run:
        pairs = [where.gain, 100.0 * diagnosis.result.final.fit.own(GAIN)[:, 0]]
        axes.set_ylabel("own thrust [%]")
    else:
        gaps = (diagnosis.gap.residuals_before, diagnosis.gap.residuals_after)
        pairs = [dof.shown(gap * where.sign if row.directed else gap) for gap in gaps]
        axes.set_ylabel(f"mean gap [{dof.units.shown}]" + f"\nalong the {dof.words.force}" * row.directed)
    have = np.isfinite(column.values)
    which = np.where(have, np.digitize(np.nan_to_num(column.values), variable.edges[1:-1]), -1)
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    for values, colour, form, label in zip(pairs, (BEFORE, AFTER), ("o--", "o-"), ("before", "after")):
        bins = (values[which == b] for b in range(len(variable.middle)))
        means = [np.mean(inside) if len(inside) else np.nan for inside in bins]
        axes.plot(variable.middle, means, form, color=colour, markersize=2.5, linewidth=1.0, label=label)
    axes.set_xlabel(in_words(variable), labelpad=1, parse_math=False)
    axes.legend(loc="best", fontsize=6.5)


@style.house_style
def learned_figure(diagnosis: Diagnosis, curve: LearnedCurve) -> Figure:
    figure, grid = style.new_figure(1, 1, 0.62 * style.PAGE_IN, 2.9)
    axes, gain = grid[0, 0], curve.kind == "gain"
    scale, word = (100.0, "change of thrust [%]") if gain else (1.0, f"change of linear drag [{curve.y_unit}]")
    if curve.kind == "moment":
        word = f"{diagnosis.study.base.dof.words.force} [{curve.y_unit}]"
    low, high = scale * curve.low, scale * curve.high
    axes.fill_between(curve.x, low, high, color=style.COLOURS["sky"], alpha=0.4, lw=0, label="95 % band")
    axes.plot(curve.x, scale * curve.y, color=style.COLOURS["blue"], label="learned curve")
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    unit = f" [{curve.unit}]" * bool(curve.unit)
    axes.set_xlabel(f"{'size of ' * curve.sized}{curve.variable}{unit}", parse_math=False)
    axes.set_ylabel(word, parse_math=False)
    axes.legend()
    return figure
