"""Figures of a yaw fit: half-turns with their trims, drag (the paper's Fig. 7), inertia (Fig. 9), the
collapse, whole runs.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from automarine_cli.fits.half_turns import StepData
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.paper import VelocityErrorFit
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.closed_form import response
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.style import (
    COLOURS,
    MEASURED,
    MODEL_COLOURS,
    MODEL_LINES,
    PAGE_IN,
    house_style,
    legend,
    new_figure,
)
from automarine_cli.runs.half_turn import HalfTurn

FINE = 400
"""Cells a side of an axes within which points count as one: half a marker, at the size that figures have."""
MANY, ENOUGH = 50_000, 40
"""Points of all lines from which on each keeps about so many: among hundreds of lines no more are told apart."""


def lines(ax: Axes, each: Sequence[Floats], **look: Any) -> None:
    """Lines (N, 2) each, as one collection; `look` goes to it. The axes grow to hold them."""
    if sum(map(len, each)) > MANY:
        each = [line[_some(len(line))] for line in each]
    collection = LineCollection([line for line in each if len(line) > 1], capstyle="projecting", **look)
    collection.set_in_layout(False)  # it stays within the axes: to measure every line for the layout takes its time
    ax.add_collection(collection)
    ax.autoscale_view()


def distinct(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Which of the points (N,) are drawn: of those that lie in one cell of a fine grid the last, in their order."""
    if len(x) < 2:
        return np.arange(len(x))
    cells = [np.floor(FINE * (one - one.min()) / max(float(np.ptp(one)), 1e-300)).astype(np.int64) for one in (x, y)]
    key = (cells[0] * (FINE + 1) + cells[1])[::-1]
    return np.sort(len(x) - 1 - np.unique(key, return_index=True)[1])


def _some(count: int) -> NDArray[np.int64]:
    """Places along a line of `count` points, its ends among them."""
    return np.unique(np.linspace(0, count - 1, min(count, ENOUGH)).round().astype(np.int64)) if count else np.arange(0)


MOMENT_MAP = "cividis"
MOST_PANELS = 24  # whole runs that are drawn
MOST_RUNS = 2000  # whose samples are drawn one by one


@house_style
def half_turns_figure(fit: YawFit) -> Figure:
    """Heading against time of every half-turn: kept part coloured by the size of the moment, what follows in
    grey."""
    dof, words = fit.dof, fit.dof.words
    figure, axes = new_figure(1, 2, PAGE_IN, 3.2, sharey=True)
    scale, colours = _moment_scale(np.array([turn.moment for turn in fit.turns]))
    there, back = words.to_ways
    for ax, sign, side in zip(
        axes[0], (-1, 1), (f"{back} (negative {words.force}s)", f"{there} (positive {words.force}s)")
    ):
        own = [turn for turn in fit.turns if np.sign(turn.moment) == sign]
        rest = [_heading(turn, part) for turn in own for part in _left_out(turn)]
        lines(ax, rest, colors="0.82", linewidths=0.7, zorder=1)
        sizes = np.array([abs(turn.moment) for turn in own])
        lines(ax, [_heading(turn, turn.kept) for turn in own], colors=colours(sizes), linewidths=0.9, zorder=2)
        if dof.wraps:
            ax.axhline(sign * 180.0, color=COLOURS["vermilion"], lw=0.9, ls="--", zorder=3)
        ax.set_title(side)
        ax.set_xlabel("Time since the step [s]")
    x = dof.symbols.position_print
    axes[0, 0].set_ylabel(f"{words.position.capitalize()} less start {words.position} {x} − {x}₀ [{dof.units.shown}]")
    axes[0, 1].plot([], [], color="0.82", label="rest, and what was cut")
    if dof.wraps:
        axes[0, 1].plot([], [], color=COLOURS["vermilion"], ls="--", label=words.reach)
    legend(axes[0, 1], loc="lower right")
    figure.colorbar(scale, ax=axes, label=_size_of_force(fit), pad=0.01)
    return figure


def _left_out(turn: HalfTurn) -> tuple[slice, slice]:
    """The rest before a half-turn, and what follows it in the step."""
    first, stop = turn.looked_at
    return slice(first, turn.kept.start + 1), slice(turn.kept.stop - 1, stop)


def _heading(turn: HalfTurn, part: slice) -> Floats:
    """A part of a run as a line, (N, 2): time since the step, position less the start."""
    run, dof = turn.step.run, turn.step.run.dof
    return np.stack(
        [run.time[part] - turn.step.switch_mid, dof.shown(run.position[part]) - dof.shown(turn.start_position)], axis=1
    )


@house_style
def drag_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Steady yaw rate against moment with the three curves of Table 1, residuals below (the paper's Fig.
    7)."""
    dof = fit.dof
    figure, axes = new_figure(2, 1, 4.6, 4.6, sharex=True, height_ratios=(2.4, 1.0))
    top, bottom = axes[:, 0]
    moment, rate = np.array([turn.moment for turn in fit.turns]), seed.tails.rate
    grid = np.linspace(min(moment.min(), 0.0), max(moment.max(), 0.0), 401) * 1.03
    top.plot(moment, dof.shown(rate), "o", mfc="none", mec=MEASURED, mew=0.8, label="measured, one run each", zorder=2)
    for number in ("1", "2", "3"):
        if number not in seed.drag:
            continue
        look: dict[str, object] = {"color": MODEL_COLOURS[number], "zorder": 4 if number == "2" else 3}
        top.plot(
            grid,
            dof.shown(steady_rate(*seed.drag[number].acting(grid))),
            ls=MODEL_LINES[number],
            label=f"model {number}",
            **look,
        )
        shift = (int(number) - 2) * 0.006 * np.ptp(grid)
        bottom.plot(moment + shift, seed.drag[number].residuals, "^os"[int(number) - 1], ms=2.6, mec="none", **look)
    top.set_ylabel(f"Steady {dof.words.rate} {dof.symbols.velocity} [{dof.units.shown}/s]")
    bottom.set_ylabel(f"Residual [{fit.moment_unit}]")
    bottom.set_xlabel(_full_force(fit))
    bottom.axhline(0.0, color="0.4", lw=0.6, zorder=1)
    legend(top, loc="upper left")
    return figure


@house_style
def inertia_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Inertia of each run, mean at each moment, overall by both methods (the paper's Fig. 9)."""
    dof = fit.dof
    models = [number for number in ("1", "3") if number in seed.inertia]
    figure, axes = new_figure(1, len(models), PAGE_IN, 3.0)
    moment = np.array([turn.moment for turn in fit.turns])
    for ax, number in zip(axes[0], models):
        table, ml = seed.inertia[number], fit.output_error[number].estimates[dof.symbols.inertia]
        ax.plot(moment, table.per_run, "o", mfc="none", mec=MEASURED, mew=0.8, label="one run")
        means = sorted(table.per_moment.items())
        ax.plot(
            *np.transpose(means),
            "D",
            ms=4,
            color=COLOURS["vermilion"],
            mec="none",
            label=f"mean at one {dof.words.force}",
        )
        ends = moment.min() * 1.05, moment.max() * 1.05
        for estimate, colour, name in (
            (table.overall, COLOURS["black"], "velocity error"),
            (ml, COLOURS["blue"], "maximum likelihood"),
        ):
            style = "-" if name == "maximum likelihood" else "--"
            ax.hlines(estimate.value, *ends, color=colour, ls=style, lw=1.1, label=f"overall, {name}")
            ax.fill_between(ends, *estimate.ci95, color=colour, alpha=0.15, lw=0)
        spread = np.array([*table.per_run, *ml.ci95])
        low, high = np.percentile(spread, [2, 98])
        ax.set_ylim(min(0.0, low), max(1.1 * high, high + 0.35 * np.ptp([low, high])))
        ax.set_title(f"model {number}")
        ax.set_xlabel(_full_force(fit))
    unit = dof.unit_of("inertia", fit.moment_unit)
    axes[0, 0].set_ylabel(f"{dof.words.full_inertia.capitalize()} ${dof.symbols.inertia}$ [{unit}]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@house_style
def collapse_figure(fit: YawFit, data: StepData) -> Figure:
    """Heading against time times the root of the moment: one curve for all runs if model 3 holds."""
    dof, own = fit.dof, fit.dof.symbols
    figure, axes = new_figure(2, 1, 4.6, 4.6, sharex=True, height_ratios=(2.4, 1.0))
    top, bottom = axes[:, 0]
    model = fit.output_error["3"]
    k_rr, inertia = model.estimates[own.quadratic].value, model.estimates[own.inertia].value
    scale, colours = _moment_scale(data.moment)
    late = model.offset.value * data.interval
    points, runs = [], len(data.moment)
    for i in np.unique(np.linspace(0, runs - 1, min(runs, MOST_RUNS)).round().astype(int)):
        moment = data.moment[i]
        used = data.seen[i] & (data.time[i] >= 0)
        acting, share = _acting(model, float(moment))
        scaled = np.maximum(data.time[i][used] - late[i], 0.0) * np.sqrt(abs(acting) * share)
        turned = np.sign(acting) * data.heading[i][used] * share
        curve = response(scaled, 1.0, inertia, 0.0, k_rr)[0]
        points.append((scaled, dof.shown(turned), dof.shown(turned - curve), np.full(len(scaled), abs(moment))))
    time, turned, off, size = (np.concatenate(column) for column in zip(*points))
    for ax, value in ((top, turned), (bottom, off)):
        seen = distinct(time, value)
        look: dict[str, Any] = {"c": colours(size[seen]), "s": 4.0, "linewidths": 0}
        ax.scatter(time[seen], value[seen], **look).set_in_layout(False)
    grid = np.linspace(0.0, float(time.max(initial=0.0)), 400)
    heavy, drag = own.inertia, own.quadratic_math
    name = rf"$({heavy}/{drag})\,\ln\cosh\,(s\,{drag}^{{1/2}}/{heavy})$"
    top.plot(
        grid, dof.shown(response(grid, 1.0, inertia, 0.0, k_rr)[0]), color=COLOURS["vermilion"], lw=1.4, label=name
    )
    bottom.axhline(0.0, color=COLOURS["vermilion"], lw=1.0)
    x, force, unit = own.position_print, own.force_print, dof.units.shown
    top.set_ylabel(f"{dof.words.position.capitalize()} {dof.words.moved} sgn({force})({x} − {x}₀) [{unit}]")
    bottom.set_ylabel(f"Off the curve [{unit}]")
    bottom.set_xlabel(f"Scaled time s = t √|{force}| [s ({fit.moment_unit})$^{{1/2}}$]")
    legend(top, loc="upper left", title=f"{MOST_RUNS} of {runs} runs are shown" if runs > MOST_RUNS else None)
    figure.colorbar(scale, ax=axes, label=_size_of_force(fit), pad=0.01)
    return figure


def _full_force(fit: YawFit) -> str:
    """What the vehicle is driven by, for an axis."""
    return f"{fit.dof.words.full_force.capitalize()} {fit.dof.symbols.force_print} [{fit.moment_unit}]"


def _size_of_force(fit: YawFit) -> str:
    """The same without its sign, for a colour bar."""
    return f"Size of the {fit.dof.words.force} |{fit.dof.symbols.force_print}| [{fit.moment_unit}]"


def _acting(model: OutputErrorFit, moment: float) -> tuple[float, float]:
    """What a run moves by, and its drag as a share of the middle of both ways: 1 where they do not differ."""
    estimates, own = model.estimates, model.model.dof.symbols
    if own.constant in estimates:
        moment += estimates[own.constant].value
    if own.difference not in estimates:
        return moment, 1.0
    half = estimates[own.difference].value / estimates[own.quadratic].value
    return moment, 1.0 + float(np.sign(moment)) * half


def _moment_scale(moment: Any) -> tuple[Any, Any]:
    """A colour for each size of moment: the mappable for the colour bar, and the function."""
    sizes = np.abs(moment)
    low, high = float(sizes.min()), float(sizes.max())
    scale = matplotlib.cm.ScalarMappable(Normalize(low if high > low else 0.9 * low, high), MOMENT_MAP)
    return scale, scale.to_rgba
