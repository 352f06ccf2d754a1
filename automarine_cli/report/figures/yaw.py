"""Figures of the fit of steps: each step with its trims, drag (the paper's Fig. 7), inertia (Fig. 9), the collapse."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from automarine_cli.fits.half_turns import StepData
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.paper import VelocityErrorFit
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.yaw_model import response, steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.runs.half_turn import HalfTurn

MOST_RUNS = 2000  # whose samples are drawn one by one


@style.house_style
def half_turns_figure(fit: YawFit) -> Figure:
    """Draw the position of every step over time: the part that was fitted coloured by its force, the rest in grey."""
    dof, words = fit.dof, fit.dof.words
    figure, axes = style.new_figure(1, 2, style.PAGE_IN, 3.2, sharey=True)
    scale, colours = _moment_scale(np.array([turn.moment for turn in fit.turns]))
    for ax, sign, way, side in zip(axes[0], (-1, 1), words.to_ways[::-1], ("negative", "positive")):
        turns = [turn for turn in fit.turns if np.sign(turn.moment) == sign]
        ends = [(t, slice(t.looked_at[0], t.kept.start + 1), slice(t.kept.stop - 1, t.looked_at[1])) for t in turns]
        rest = [_position(turn, part) for turn, *parts in ends for part in parts]
        _lines(ax, rest, colors="0.82", linewidths=0.7, zorder=1)
        sizes = np.array([abs(turn.moment) for turn in turns])
        _lines(ax, [_position(turn, turn.kept) for turn in turns], colors=colours(sizes), linewidths=0.9, zorder=2)
        if dof.wraps:
            ax.axhline(sign * 180.0, color=style.COLOURS["vermilion"], lw=0.9, ls="--", zorder=3)
        ax.set(title=f"{way} ({side} {words.force}s)", xlabel="Time since the step [s]")
    x = dof.symbols.position_print
    axes[0, 0].set_ylabel(f"{words.position.capitalize()} less start {words.position} {x} − {x}₀ [{dof.units.shown}]")
    axes[0, 1].plot([], [], color="0.82", label="rest, and what was cut")
    if dof.wraps:
        axes[0, 1].plot([], [], color=style.COLOURS["vermilion"], ls="--", label=words.reach)
    axes[0, 1].legend(loc="lower right")
    figure.colorbar(scale, ax=axes, label=_size_of_force(fit), pad=0.01)
    return figure


def _position(turn: HalfTurn, part: slice) -> Floats:
    """A part of a run as a line, (N, 2): time since the step, position less the start."""
    run, dof = turn.step.run, turn.step.run.dof
    moved = dof.shown(run.position[part]) - dof.shown(turn.start_position)
    return np.stack([run.time[part] - turn.step.switch_mid, moved], axis=1)


def _lines(ax: Axes, lines: Sequence[Floats], **look: Any) -> None:
    collection = LineCollection([line for line in lines if len(line) > 1], capstyle="projecting", **look)
    collection.set_in_layout(False)  # it stays within the axes: to measure every line for the layout takes its time
    ax.add_collection(collection)
    ax.autoscale_view()


@style.house_style
def drag_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Draw steady velocity against force with the three curves of Table 1, residuals below (the paper's Fig. 7)."""
    dof, moment = fit.dof, np.array([turn.moment for turn in fit.turns])
    rate = f"Steady {dof.words.rate} {dof.symbols.velocity} [{dof.units.shown}/s]"
    labels = _full_force(fit), rate, f"Residual [{fit.moment_unit}]"
    figure, top, bottom = style.above_residuals(4.6, 4.6, labels)
    points: dict[str, Any] = {"mfc": "none", "mec": style.MEASURED, "mew": 0.8, "zorder": 2}
    top.plot(moment, dof.shown(seed.tails.rate), "o", label="measured, one run each", **points)
    grid = np.linspace(min(moment.min(), 0.0), max(moment.max(), 0.0), 401) * 1.03
    for i, number in enumerate("123"):
        if (drag := seed.drag.get(number)) is None:
            continue
        look: dict[str, Any] = {"color": style.MODEL_COLOURS[number], "zorder": 4 if number == "2" else 3}
        curve = dof.shown(steady_rate(*drag.acting(grid)))
        top.plot(grid, curve, ls=style.MODEL_LINES[number], label=f"model {number}", **look)
        shift = (i - 1) * 0.006 * np.ptp(grid)  # so that none hides another
        bottom.plot(moment + shift, drag.residuals, "^os"[i], ms=2.6, mec="none", **look)
    top.legend(loc="upper left")
    return figure


@style.house_style
def inertia_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Draw the inertia of each run, its mean at each force, and over all by both methods (the paper's Fig. 9)."""
    dof = fit.dof
    models = [number for number in ("1", "3") if number in seed.inertia]
    figure, axes = style.new_figure(1, len(models), style.PAGE_IN, 3.0)
    moment = np.array([turn.moment for turn in fit.turns])
    for ax, number in zip(axes[0], models):
        table, ml = seed.inertia[number], fit.output_error[number].estimates[dof.symbols.inertia]
        ax.plot(moment, table.per_run, "o", mfc="none", mec=style.MEASURED, mew=0.8, label="one run")
        means, label = np.transpose(sorted(table.per_moment.items())), f"mean at one {dof.words.force}"
        ax.plot(*means, "D", ms=4, color=style.COLOURS["vermilion"], mec="none", label=label)
        ends = moment.min() * 1.05, moment.max() * 1.05
        methods = (table.overall, "black", "--", "velocity error"), (ml, "blue", "-", "maximum likelihood")
        for estimate, colour, line, name in methods:
            ax.hlines(estimate.value, *ends, color=style.COLOURS[colour], ls=line, lw=1.1, label=f"overall, {name}")
            ax.fill_between(ends, *estimate.ci95, color=style.COLOURS[colour], alpha=0.15, lw=0)
        spread = np.array([*table.per_run, *ml.ci95])
        low, high = np.percentile(spread, [2, 98])
        ax.set_ylim(min(0.0, low), max(1.1 * high, high + 0.35 * np.ptp([low, high])))
        ax.set(title=f"model {number}", xlabel=_full_force(fit))
    unit = dof.unit_of("inertia", fit.moment_unit)
    axes[0, 0].set_ylabel(f"{dof.words.full_inertia.capitalize()} ${dof.symbols.inertia}$ [{unit}]")
    style.legend_below(figure, axes[0, 0], ncols=4)
    return figure


@style.house_style
def collapse_figure(fit: YawFit, data: StepData) -> Figure:
    """Draw position against time times the root of the force: one curve for all runs if model 3 holds."""
    dof, own, model = fit.dof, fit.dof.symbols, fit.output_error["3"]
    x, force, unit = own.position_print, own.force_print, dof.units.shown
    figure, top, bottom = style.above_residuals(4.6, 4.6, (
        f"Scaled time s = t √|{force}| [s ({fit.moment_unit})$^{{1/2}}$]",
        f"{dof.words.position.capitalize()} {dof.words.moved} sgn({force})({x} − {x}₀) [{unit}]",
        f"Off the curve [{unit}]",
    ))  # fmt: skip
    k_rr, inertia = model.estimates[own.quadratic].value, model.estimates[own.inertia].value
    scale, colours = _moment_scale(data.moment)
    late = model.offset.value * data.interval
    points, runs = [], len(data.moment)
    for i in np.unique(np.linspace(0, runs - 1, min(runs, MOST_RUNS)).round().astype(int)):
        moment = data.moment[i]
        used = data.observed[i] & (data.time[i] >= 0)
        acting, share = _acting(model, float(moment))
        scaled = np.maximum(data.time[i][used] - late[i], 0.0) * np.sqrt(abs(acting) * share)
        turned = np.sign(acting) * data.heading[i][used] * share
        curve = response(scaled, 1.0, inertia, 0.0, k_rr)[0]
        points.append((scaled, dof.shown(turned), dof.shown(turned - curve), np.full(len(scaled), abs(moment))))
    time, turned, off, size = (np.concatenate(column) for column in zip(*points))
    for ax, value in ((top, turned), (bottom, off)):
        ax.scatter(time, value, c=colours(size), s=4.0, linewidths=0).set_in_layout(False)
    grid = np.linspace(0.0, float(time.max(initial=0.0)), 400)
    heavy, drag = own.inertia, own.quadratic_math
    name = rf"$({heavy}/{drag})\,\ln\cosh\,(s\,{drag}^{{1/2}}/{heavy})$"
    alike = dof.shown(response(grid, 1.0, inertia, 0.0, k_rr)[0])
    top.plot(grid, alike, color=style.COLOURS["vermilion"], lw=1.4, label=name)
    top.legend(loc="upper left", title=f"{MOST_RUNS} of {runs} runs are shown" if runs > MOST_RUNS else None)
    figure.colorbar(scale, ax=[top, bottom], label=_size_of_force(fit), pad=0.01)
    return figure


def _full_force(fit: YawFit) -> str:
    return f"{fit.dof.words.full_force.capitalize()} {fit.dof.symbols.force_print} [{fit.moment_unit}]"


def _size_of_force(fit: YawFit) -> str:
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
    sizes = np.abs(moment)
    low, high = float(sizes.min()), float(sizes.max())
    scale = matplotlib.cm.ScalarMappable(Normalize(low if high > low else 0.9 * low, high), "cividis")
    return scale, scale.to_rgba
