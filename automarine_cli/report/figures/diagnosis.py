"""Figures of diagnoses of motions, the plane and thruster maps: where the gap is, why, and before and after."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from automarine_cli.diagnosis.diagnose import NAMED, SUSPECTED, Diagnosis, Gap
from automarine_cli.diagnosis.learned_curve import LearnedCurve
from automarine_cli.diagnosis.planar import HEAD_START, PlanarSearch, judged
from automarine_cli.diagnosis.residual_regions import SIZE, THRUST, Row, Variable, Where
from automarine_cli.diagnosis.search import LEVEL
from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.diagnosis.thruster_map import ThrusterDiagnosis
from automarine_cli.dofs import YAW, Dof
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.figures.runs import track
from automarine_cli.simulation.batch import signals_of
from automarine_cli.thrusters.family import ALPHA, BollardData

BEFORE, AFTER, MARK, RIVAL = (style.COLOURS[name] for name in ("vermilion", "blue", "yellow", "sky"))
NOT_NEEDED, TRIED, PROMISED = "0.72", "0.55", "0.85"
MOST_PANELS, COLUMNS = 12, 4
MOST_RUNS_SHOWN = 4
WIDEST = 104  # letters that have room side by side in the title
NARROWEST = 0.04  # share of its panel that a marked region takes at least: a narrower one could not be seen
OF_THE_RUN = 0.1  # share of its range that a variable may vary by within runs and still be shown as one value a run
LABEL = {"n": "control signal n", "voltage": "supply voltage", "run-order": "run order"}


def in_words(variable: Variable, dof: Dof) -> str:
    others = {
        "time-since-command-change": "time since command changed", "time-in-run": "time in the run",
        f"{dof.words.force}-size": f"size of the {dof.words.force}",
    }  # fmt: skip
    name = variable.name if variable.logged else others.get(variable.name, variable.name.replace("-", " "))
    return name + ", by run" * variable.of_the_run + (f" [{variable.unit}]" if variable.unit else "")


@style.house_style
def where_figure(where: Where, words: str, units: str = "runs", less: str = "simulated") -> Figure:
    """Draw small multiples, one a variable, most significant first, above a heat map of runs by time; `words` are the
    verdict, `units` are what chance turns the sign of, `less` is what the measured is compared with."""
    shown = sorted(where.variables, key=_by_significance)[:MOST_PANELS]
    rows = -(-len(shown) // COLUMNS)
    heights = (*[1.55] * rows, 2.6)
    figure, grid = style.new_figure(rows + 1, COLUMNS, style.PAGE_IN, sum(heights) + 0.5, height_ratios=heights)
    panels = grid[:rows].ravel()
    for axes, variable in zip(panels, shown):
        _bins(axes, variable, in_words(variable, where.dof), _gap_of(variable.telling, where.dof))
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    (heat,) = style.span(figure, grid[rows], slice(None))
    _heat_map(figure, heat, where, less)
    out = sum(bool(variable.stands_out.any()) for variable in where.variables)
    _explain_bins(figure, units)
    depends = f"{out or 'none'} of {len(where.variables)} variables{' (yellow)' * bool(out)}"
    figure.suptitle(f"The error depends on {depends}. Verdict: {words}")
    return figure


def _by_significance(variable: Variable) -> tuple[float, float]:
    return variable.p_value, -float(np.abs(variable.telling.t).max())


@style.house_style
def thruster_where_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw the gap of the map in the bins of every variable; bins that stand out are shaded."""
    variables = result.where.variables
    figure, grid = style.new_figure(1, max(len(variables), 1), style.PAGE_IN, 2.6)
    for axes, variable in zip(grid[0], variables):
        unit, row = f" [{variable.unit}]" * bool(variable.unit), variable.telling
        gap = "log gap" if row.unit == "log" else "along the thrust [N]" if row.directed else "measured − map [N]"
        _bins(axes, variable, LABEL[variable.name] + unit, gap)
    _explain_bins(figure, "points")
    share = result.percent(result.gap.before)
    figure.suptitle(f"Where the {result.given.form} map is wrong: {share:.2g} % of full scale")
    return figure


def _explain_bins(figure: Figure, units: str) -> None:
    handles = [
        Patch(color=MARK, alpha=0.45, label="significant"),
        Patch(color=BEFORE, alpha=0.3, label=f"mean ± 2 standard errors ({units} as units)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)


def _bins(axes: Axes, variable: Variable, label: str, gap_label: str) -> None:
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
    axes.set_xlabel(label, labelpad=1, fontsize=7, parse_math=False)
    axes.set_ylabel(gap_label, labelpad=1, fontsize=6.5)
    axes.set_title(
        f"p = {variable.p_value:.2g}" if out else "within chance",
        fontsize=7, fontweight="bold" if out else "normal", color="black" if out else "0.45", pad=2,
    )  # fmt: skip
    axes.tick_params(labelsize=6)


def _gap_of(row: Row, dof: Dof) -> str:
    force = dof.words.force
    if row.kind == SIZE:
        return "log gap of the run"
    if row.unit == "%":
        return "own thrust [%]" + (f" × {dof.words.way}" if row.directed else "")
    word = {THRUST: "gap, equal thrust", dof.words.position: "gap"}.get(row.kind, f"missing {row.kind}")
    return f"{word} [{row.unit}]" + (f"\nalong the {force}" if row.directed else "")


def _heat_map(figure: Figure, axes: Axes, where: Where, less: str) -> None:
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


Look = Mapping[str, tuple[float, str]]
"""What each candidate gains over the model in one look at them, and its colour."""


def _look(gains: Mapping[str, float], named: Sequence[str], rivals: Sequence[str]) -> Look:
    colours = dict.fromkeys(rivals, RIVAL) | dict.fromkeys(named, AFTER)
    return {name: (gain, colours.get(name, NOT_NEEDED)) for name, gain in gains.items()}


def why_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the evidence of every candidate in the first round against the threshold."""
    found, first = diagnosis.found, diagnosis.found.rounds[0]
    gains = {trial.added[-1]: first.gain(trial) for trial in first.trials}
    look = _look(gains, found.final.added, [rival.name for rival in found.rivals])
    what = "the innovations of driven runs" if diagnosis.study.driven else "the gap"
    best = "suspected" if diagnosis.verdict == SUSPECTED else "named"
    return evidence_figure(
        [look], first.threshold, {best: AFTER, "rival not excluded": RIVAL, "not needed": NOT_NEEDED},
        f"threshold ({1000 * LEVEL:.0f} in 1000 by chance)",
        f"Which missing effect would explain {what}.\nVerdict: {diagnosis.words}",
    )  # fmt: skip


def thruster_why_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw the evidence of every candidate of the first step, in the better direction, against the threshold."""
    first, names = result.search.steps[0], [effect.name for effect in result.effects]
    gains = {trial.effect: trial.gain for trial in sorted(first.candidates, key=lambda candidate: candidate.gain)}
    look = _look(gains, names, [rival.name for effect in result.effects for rival in effect.rivals])
    words = " and ".join(names) or result.verdict.replace("-", " ")
    return evidence_figure(
        [look], first.threshold, {"named or suspected": AFTER, "not needed": NOT_NEEDED},
        f"threshold ({1000 * ALPHA:.0f} in 1000 by chance)",
        f"Which missing effect would explain the gap. Verdict: {words}",
    )  # fmt: skip


def planar_why_figure(search: PlanarSearch) -> Figure:
    """Draw the deviance that each candidate gains, of those that were fitted, or is promised to gain, look by look."""
    looks = []
    for look in search.steps or search.rounds[:1]:
        fitted = {contender.candidate.added: contender for contender in look.tried}
        rivals = {rival.candidate.added for rival in look.rivals}
        best = look.best.candidate.added if look.best else None
        gains: dict[str, tuple[float, str]] = {}
        for candidate, promised in look.promised:
            added = candidate.added
            gain, colour = (fitted[added].surplus, TRIED) if added in fitted else (promised, PROMISED)
            gains[candidate.label] = gain, AFTER if added == best else RIVAL if added in rivals else colour
        looks.append(gains)
    marks = {"named": AFTER, "rival not excluded": RIVAL, "fitted, not needed": TRIED,
              "not fitted: promised": PROMISED}  # fmt: skip
    title = f"Which missing effect would explain the innovations. Verdict: {search.words}"
    return evidence_figure(looks, HEAD_START, marks, "threshold", title, "deviance gained beyond the penalty")


@style.house_style
def evidence_figure(
    looks: Sequence[Look], threshold: float, marks: Mapping[str, str], line: str, title: str,
    label: str = "evidence gained over the base model [deviance]",
) -> Figure:  # fmt: skip
    """Draw horizontal bars, best on top, on a scale that is linear up to ten and logarithmic beyond."""
    counts = [max(len(look), 1) for look in looks]
    height = max(3.0, 0.17 * sum(counts) + 1.3 + 0.4 * (len(looks) - 1))
    figure, grid = style.new_figure(len(looks), 1, style.PAGE_IN, height, height_ratios=counts, sharex=True)
    every = np.array([0.0, *(gain for look in looks for gain, _ in look.values())])
    low, high = 1.2 * float(every.min()) - 1.0, max(2.5 * float(every.max()), 20.0)
    for number, (axes, look) in enumerate(zip(grid[:, 0], looks), 1):
        names = sorted(look, key=lambda name: look[name][0])
        gains, colours = [look[name][0] for name in names], [look[name][1] for name in names]
        axes.barh(np.arange(len(names)), gains, color=colours, height=0.72)
        axes.axvline(threshold, color=BEFORE, lw=1.2, ls="--")
        axes.axvline(0.0, color="0.3", lw=0.6)
        axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
        axes.set_yticks(np.arange(len(names)), names, parse_math=False)
        for text, colour in zip(axes.get_yticklabels(), colours):
            text.set_fontweight("bold" if colour == AFTER else "normal")
        for at, gain in enumerate(gains):
            if gain > 0.4 * threshold:
                axes.annotate(f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5)
        axes.grid(False, axis="y")
        axes.margins(y=0.01)
        if len(looks) > 1:
            axes.set_title(f"Look {number}")
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if low <= tick <= high]
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel(label)
    handles = [Patch(color=colour, label=word) for word, colour in marks.items()]
    handles.append(Line2D([], [], ls="--", color=BEFORE, label=line))  # type: ignore[arg-type]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    figure.suptitle(title)
    return figure


@dataclass(frozen=True)
class Telling:
    """A run that tells much, in the unit that is shown: what was measured, and of the model before and after the time,
    what it says and how far that is off."""

    title: str
    time: Floats
    measured: Floats
    lines: Sequence[tuple[Floats, Floats, Floats]]


Sizes = tuple[str, Floats, Floats]
"""Which runs, and the gap of each before and after."""


def _titled(name: str, word: str) -> str:
    return f"{name if len(name) <= 26 else f'…{name[-25:]}'}\n{word}"  # names of runs differ at their end


def _two_of(size: Floats, among: NDArray[np.int64]) -> list[int]:
    """The run with the largest and the one with the middle gap."""
    order = among[np.argsort(-size[among], kind="stable")]
    return list(dict.fromkeys([int(order[0]), int(order[len(order) // 2])])) if len(order) else []


def _beside_each_other(
    runs: Sequence[Telling], dof: Dof, labels: tuple[str, str], axis: str, less: str, floor: float = 0.0, rows: int = 3
) -> tuple[Figure, NDArray[np.object_]]:
    """Draw runs with both models, and their errors; the last of `rows` are left for the caller."""
    figure, grid = style.new_figure(
        rows, max(len(runs), 1), style.PAGE_IN, 2.0 * rows, height_ratios=[1.5, 1.2, *[1.4] * (rows - 2)]
    )
    most = 1.08 * max((float(np.nanmax(np.abs(error))) for run in runs for _, _, error in run.lines), default=1)
    for column, run in enumerate(runs):
        top, bottom = grid[0, column], grid[1, column]
        top.plot(run.time, run.measured, "o", color=style.MEASURED, ms=1.6, label="measured")
        if floor:
            bottom.axhspan(-2 * floor, 2 * floor, color="0.9", lw=0, label="± 2 × noise")
        for (time, modelled, error), colour, dashes, label in zip(run.lines, (BEFORE, AFTER), ("--", "-"), labels):
            top.plot(time, modelled, color=colour, lw=1.0, ls=dashes, label=label)
            bottom.plot(time, error, color=colour, lw=0.7)
        bottom.axhline(0.0, color="0.3", lw=0.6)
        low, high = float(run.measured.min()), float(run.measured.max())
        style.limit(
            top, low, high, 0.5 * (high - low), [modelled[np.isfinite(modelled)] for _, modelled, _ in run.lines]
        )
        top.set_title(run.title, fontsize=6.5, parse_math=False)
        bottom.sharex(top)
        bottom.set_ylim(-most, most)
        bottom.set_xlabel("time [s]", labelpad=1)
        if column:
            bottom.set_yticklabels([])
    grid[0, 0].set_ylabel(f"{axis} [{dof.units.shown}]")
    grid[1, 0].set_ylabel(f"measured − {less} [{dof.units.shown}]")
    style.legend_below(figure, grid[0, 0], grid[1, 0], ncols=4)
    return figure, grid


def _sizes(axes: Axes, groups: Sequence[Sizes], dof: Dof, floor: float = 0.0) -> None:
    """Draw the gap of every run before against after, on equal axes."""
    for (word, before, after), marker, fill in zip(groups, "os", (AFTER, "none")):
        axes.plot(before, after, marker, color=AFTER, mfc=fill, ms=3.5, label=f"runs {word}")
    top = 1.05 * max((float(np.nanmax(gaps)) for _, *pair in groups for gaps in pair if len(gaps)), default=1.0)
    axes.plot([0, top], [0, top], color="0.4", lw=0.7, ls=":")
    if floor:
        axes.axhline(floor, color="0.5", lw=0.8, ls="--", label=f"noise of the {dof.words.position}")
    axes.set(xlim=(0.0, top), ylim=(0.0, top), ylabel=f"gap after [{dof.units.shown}]")
    axes.set_xlabel(f"gap before [{dof.units.shown}]", labelpad=1)
    axes.legend(loc="upper left", fontsize=6.5)


def sets_of(diagnosis: Diagnosis) -> list[tuple[Study, Gap, str]]:
    """List the runs fitted and, where there are some, those held out, with the gap of each."""
    sets = (diagnosis.study, diagnosis.gap, "fitted"), (diagnosis.held_out, diagnosis.held_out_gap, "held out")
    return [(study, gap, word) for study, gap, word in sets if study is not None and gap is not None]


@style.house_style
def before_after_figure(diagnosis: Diagnosis) -> Figure:
    """Draw telling runs with both models, their errors, and the error by the most telling variable."""
    driven, dof = diagnosis.study.driven, diagnosis.study.base.dof
    runs, groups = list[Telling](), list[Sizes]()
    for study, gap, word in sets_of(diagnosis):
        both = gap.residuals_before, gap.residuals_after
        size = [np.sqrt((rest**2).sum(axis=1) / study.batch.seen.sum(axis=1)) for rest in both]
        groups.append((word, np.asarray(dof.shown(size[0])), np.asarray(dof.shown(size[1]))))
        for i in _two_of(size[0], np.arange(len(study.runs))):
            run, n = study.runs[i], len(study.runs[i])
            time, measured = run.time - run.time[0], dof.shown(run.position - run.position[0])
            off = [dof.shown(rest[i, :n]) for rest in both]
            if driven:  # nothing is predicted before the first filtered state
                off = [np.where(error == 0.0, np.nan, error) for error in off]
            lines = [(time, measured - error, error) for error in off]
            runs.append(Telling(_titled(run.name, word), time, measured, lines))
    ahead, floor = f", {JUDGED:g} s ahead" * driven, float(dof.shown(diagnosis.gap.floor))
    figure, grid = _beside_each_other(
        runs[:MOST_RUNS_SHOWN], dof, (f"base model{ahead}", f"after{ahead}"), dof.words.moved,
        "predicted" if driven else "sim.", floor,
    )  # fmt: skip
    half = max(len(grid[2]) // 2, 1)
    parts = [slice(None, half), *([slice(half, None)] if len(grid[2]) > 1 else [])]
    left, *right = style.span(figure, grid[2], *parts)
    _sizes(left, groups, dof, floor)
    for axes in right:
        _by_variable(axes, diagnosis)
    figure.suptitle(textwrap.fill(_sizes_in_words(diagnosis), WIDEST))
    return figure


def _sizes_in_words(diagnosis: Diagnosis) -> str:
    dof = diagnosis.study.base.dof
    parts = ", ".join(
        f"runs {word} {dof.shown(gap.before):.2f} → {dof.shown(gap.after):.2f} {dof.units.shown}"
        for _, gap, word in sets_of(diagnosis)
    )
    names = " and ".join(diagnosis.found.final.added)
    word = "Added" if diagnosis.verdict == NAMED else "With what is only suspected"
    added = f"{word}: {names}" if names else "Nothing added"
    if diagnosis.study.driven:
        return f"Predictions {JUDGED:g} s ahead from filtered states: {parts}. {added}"
    return f"Gap: {parts} (noise {dof.shown(diagnosis.gap.floor):.2f} {dof.units.shown}). {added}"


@style.house_style
def planar_before_after_figure(search: PlanarSearch) -> Figure:
    """Draw telling runs with the heading, and the track where places are logged, as both models predict them some
    seconds ahead; the errors of the heading; and those of every run, before against after, on equal axes."""
    count, course = len(search.every.runs), search.every.course
    ahead = [judged(forecast[YAW.position]) for forecast in search.foretold]
    sizes = [np.asarray(YAW.shown(np.sqrt(each.by_run(each.error, count)))) for each in ahead]
    values = {channel.quantity: channel.values for channel in course.channels}
    known = np.flatnonzero(np.isfinite(sizes[0]))
    groups = {"fitted": known[known < search.fitted], "held out": known[known >= search.fitted]}
    picks = {r: word for word, group in groups.items() for r in _two_of(sizes[0], group)}
    runs = []
    for r, word in picks.items():
        run, lines = search.every.runs[r], list[tuple[Floats, Floats, Floats]]()
        for predicted in ahead:
            target, error = predicted.target[predicted.run == r], predicted.error[predicted.run == r]
            modelled = values[YAW.position][r, target] - error
            lines.append((course.time[r, target], np.asarray(YAW.shown(modelled)), np.asarray(YAW.shown(error))))
        measured = np.asarray(YAW.shown(run.position))
        runs.append(Telling(_titled(run.name, word), run.time - run.time[0], measured, lines))
    placed = set(PLACES) <= search.foretold[0].keys()
    labels = "predicted, before", "predicted, after"
    figure, grid = _beside_each_other(runs, YAW, labels, r"heading $\psi$", "predicted", rows=3 + placed)
    for axes, r in zip(grid[2], picks if placed else ()):
        _track_of(axes, search, values, r)
    (last,) = style.span(figure, grid[-1], slice(None))
    _sizes(last, [(word, *(size[group] for size in sizes)) for word, group in groups.items()], YAW)  # type: ignore[misc]
    last.set_box_aspect(1.0)
    figure.suptitle(
        f"Predictions {ahead[0].horizon:g} s ahead, from filtered states, by the commands as they were logged.\n"
        f"Added: {search.words if search.named else 'nothing'}"
    )
    return figure


def _track_of(axes: Axes, search: PlanarSearch, values: Mapping[str, Floats], r: int) -> None:
    """Draw places as they were measured and predicted; what is predicted far from the measured leaves the picture."""
    track(axes, search.every.runs[r], 1.5)
    axes.autoscale(False)
    for forecast, colour in zip(search.foretold, (BEFORE, AFTER)):
        places = {name: judged(forecast[name]) for name in PLACES}
        of_run = places["north"].run == r
        line = {name: values[name][r, at.target[of_run]] - at.error[of_run] for name, at in places.items()}
        axes.plot(line["east"], line["north"], ".", color=colour, ms=1.5)
    axes.set_xlabel("East [m]")


@style.house_style
def thruster_before_after_figure(result: ThrusterDiagnosis) -> Figure:
    """Draw thrust with both maps, and their errors on equal axes, on levels fitted and held out."""
    figure, grid = style.new_figure(3, 1, style.PAGE_IN * 0.8, 6.6, sharex=True, height_ratios=(1.8, 1.0, 1.0))
    thrust, *errors = grid[:, 0]
    sets = [(result.base.data, False), *([] if result.held_out is None else [(result.held_out, True)])]
    for data, held_out in sets:
        _points(thrust, data, data.points.force, held_out, "black", f"levels {'held out' if held_out else 'fitted'}")
    along = np.linspace(result.data.points.n.min(), result.data.points.n.max(), 801)
    thrust.plot(along, result.base.along(along), color=BEFORE, ls="--", label="before")
    volts = f" at {result.final.reference:.3g} V" if result.final.shape.voltage else ""
    thrust.plot(along, result.final.along(along), color=AFTER, label=f"after{volts}")
    thrust.set_ylabel("thrust of one thruster [N]")
    style.legend(thrust, loc="upper left")
    maps = (("before", result.base, BEFORE, result.gap.before), ("after", result.final, AFTER, result.gap.after))
    rests = [data.points.force - fit.thrust(data) for _, fit, _, _ in maps for data, _ in sets]
    most = 1.1 * max(float(np.abs(rest).max()) for rest in rests) or 1.0
    for axes, (word, fit, colour, gap) in zip(errors, maps):
        axes.axhspan(-2 * result.gap.floor, 2 * result.gap.floor, color="0.85", lw=0)
        axes.axhline(0.0, color="0.5", lw=0.6)
        for data, held_out in sets:
            _points(axes, data, data.points.force - fit.thrust(data), held_out, colour, "_")
        axes.set(ylim=(-most, most), ylabel="error [N]")
        axes.set_title(f"{word}: {gap:.3g} N = {result.percent(gap):.2g} % of full scale", loc="left")
    errors[1].set_xlabel(f"control signal n [{result.data.n_unit or 'as logged'}]")
    return figure


def _points(axes: Axes, data: BollardData, values: Floats, held_out: bool, colour: str, label: str) -> None:
    size, face = (2.0 if len(data.points) > 60 else 3.5) + held_out, "none" if held_out else colour
    axes.plot(data.points.n, values, "o", color=colour, mfc=face, mew=0.7, ms=size, zorder=2 + held_out, label=label)
    flagged = data.points.flag != ""
    if np.any(flagged):
        axes.plot(data.points.n[flagged], values[flagged], "x", color=style.COLOURS["purple"], ms=6.0, zorder=4)


def _by_variable(axes: Axes, diagnosis: Diagnosis) -> None:
    where, dof = diagnosis.where, diagnosis.where.dof
    variable, column = min(zip(where.variables, where.columns), key=lambda pair: _by_significance(pair[0]))
    row = variable.telling
    if column.of_the_run:
        pairs = [where.gain, 100.0 * diagnosis.found.final.fit.own(GAIN)[:, 0]]
        axes.set_ylabel("own thrust [%]")
    else:
        gaps = (diagnosis.gap.residuals_before, diagnosis.gap.residuals_after)
        pairs = [dof.shown(gap * where.sign if row.directed else gap) for gap in gaps]
        along = f"\nalong the {dof.words.force}" if row.directed else ""
        axes.set_ylabel(f"mean gap [{dof.units.shown}]{along}")
    have = np.isfinite(column.values)
    which = np.where(have, np.digitize(np.nan_to_num(column.values), variable.edges[1:-1]), -1)
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    for values, colour, form, label in zip(pairs, (BEFORE, AFTER), ("o--", "o-"), ("before", "after")):
        bins = (values[which == b] for b in range(len(variable.middle)))
        means = [np.mean(inside) if len(inside) else np.nan for inside in bins]
        axes.plot(variable.middle, means, form, color=colour, markersize=2.5, linewidth=1.0, label=label)
    axes.set_xlabel(in_words(variable, dof), labelpad=1, parse_math=False)
    axes.legend(loc="best", fontsize=6.5)


@style.house_style
def learned_figure(diagnosis: Diagnosis, curve: LearnedCurve) -> Figure:
    """The curve over its variable, with its 95 % band."""
    figure, grid = style.new_figure(1, 1, 0.62 * style.PAGE_IN, 2.9)
    axes, gain = grid[0, 0], curve.kind == "gain"
    scale = 100.0 if gain else 1.0
    if gain:
        _thrust_of_runs(axes, diagnosis, curve)
    low, high = scale * curve.low, scale * curve.high
    axes.fill_between(curve.x, low, high, color=style.COLOURS["sky"], alpha=0.4, lw=0, label="95 % band")
    axes.plot(curve.x, scale * curve.y, color=style.COLOURS["blue"], label="learned curve")
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    unit, size = f" [{curve.unit}]" * bool(curve.unit), "size of " * curve.sized
    axes.set_xlabel(f"{size}{curve.variable}{unit}", parse_math=False)
    word = diagnosis.study.base.dof.words.force if curve.kind == "moment" else "change of linear drag"
    axes.set_ylabel("change of thrust [%]" if gain else f"{word} [{curve.y_unit}]", parse_math=False)
    style.legend(axes)
    return figure


def _thrust_of_runs(axes: Axes, diagnosis: Diagnosis, curve: LearnedCurve) -> None:
    """Each run's own thrust under the base model, where the variable has about one value a run."""
    study = diagnosis.study
    values = signals_of(study.runs, curve.variable) if curve.needs else []
    if not values or max(float(np.ptp(v)) for v in values) > OF_THE_RUN * float(np.ptp(curve.x)):
        return
    own = 100.0 * diagnosis.found.base.fit.own(GAIN)[:, 0]
    mean = np.array([float(v.mean()) for v in values])
    level = np.mean(own - 100.0 * np.interp(mean, curve.x, curve.y))
    axes.plot(mean, own - level, "o", color=style.MEASURED, markersize=3.5, label="thrust of each run, base model")
