"""Figures of runs: steps with their trims, drag (the paper's Fig. 7), inertia (Fig. 9), the collapse; measured beside
simulated (Fig. 10), and beside predictions."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from automarine_cli.comparison.simulated_runs import FreeRun, free_runs
from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.filters.kalman import shown_channel
from automarine_cli.fits.driven import JUDGED, Use
from automarine_cli.fits.half_turns import StepData
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.paper import VelocityErrorFit
from automarine_cli.fits.planar_fit import PlanarFit, PlanarUse
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.yaw_model import response, steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.tables import number
from automarine_cli.runs.half_turn import HalfTurn
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.run import Run

DEGREES = 180.0 / np.pi
LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller
MOST_WHOLE, MOST_DRIVEN = 24, 10  # runs that are drawn
MOST_COLLAPSED = 2000  # whose samples are drawn one by one
FREE: dict[str, Any] = {"color": style.COLOURS["blue"], "lw": 0.9, "ls": (0, (4, 1.5))}
QUANTITIES = {
    "heading": (r"Heading $\psi$ [deg]", DEGREES), "surge": ("Surge $u$ [m/s]", 1.0), "sway": ("Sway $v$ [m/s]", 1.0),
    "yaw_rate": ("Yaw rate $r$ [deg/s]", DEGREES),
}  # fmt: skip
TIME = "Time from the start of the run [s]"


@style.house_style
def validation_figure(free: Mapping[str, FreeRun], floor: float) -> Figure:
    """Draw one run: `free` holds its free run under each model, `floor` is the noise of its position [deg or cm]."""
    run = next(iter(free.values())).run
    dof, letters, unit = run.dof, run.dof.symbols, run.dof.units.shown
    figure, axes = style.new_figure(3, 1, style.PAGE_IN, 6.0, sharex=True, height_ratios=(2.0, 1.3, 0.9))
    positions, errors, command = axes[:, 0]
    time, off = (run.time - run.time[0], {m: dof.shown(sim.error) for m, sim in free.items() if not sim.diverged})
    labels = {m: f"model {m}: rmse {number(float(np.sqrt(np.mean(error**2))), 2)} {unit}" for m, error in off.items()}
    lines = {m: (labels[m], dof.shown(free[m].position)) for m in off}
    _measured_and_simulated(positions, run, dof.shown(run.position), lines, 2.0, least=1.0)
    for model, error in off.items():
        errors.plot(*_with_gaps(run, error), lw=1.0, **_style(model))
    for model in [model for model in free if model not in off]:
        positions.plot([], [], label=f"model {model} diverges", **_style(model))
    most = max(3 * floor, 0.5)
    style.limit(errors, -most, most, 2.0 * max(float(np.ptp(dof.shown(run.position))), 1.0), [*off.values()])
    errors.axhline(0.0, color="0.4", lw=0.7, zorder=1)
    if floor > 0:
        band = f"± 2 × noise level of {number(floor, 2)} {unit}"
        errors.axhspan(-2 * floor, 2 * floor, color="0.92", lw=0, zorder=0, label=band)
    command.axhline(0.0, color="0.4", lw=0.7, zorder=1)
    command.plot(*_with_gaps(run, run.command), color=style.COLOURS["green"], drawstyle="steps-mid")
    positions.set_ylabel(f"{dof.position.capitalize()} ${letters.position_math}$ [{unit}]")
    positions.set_title(style.shortened(run.name, LONGEST_TITLE), parse_math=False)
    errors.set_ylabel(f"Measured − simulated [{unit}]")
    force = f"{dof.words.force.capitalize()} ${letters.force_math}$ [{run.moment_unit}]"
    command.set(ylabel=force, xlabel=TIME, xlim=(0.0, float(time[-1])))
    command.margins(y=0.15)
    style.legend_below(figure, positions, errors)
    figure.align_ylabels()
    return figure


def _measured_and_simulated(
    axes: Axes, run: Run, measured: Floats | None, lines: Mapping[str, tuple[str, Floats]], reach: float, least: float
) -> None:
    """Draw what was measured and the labelled lines of models; within `reach` times its span, `least` at least."""
    if measured is not None:
        size = 3.0 if len(run) <= CROWD else 1.5
        axes.plot(run.time - run.time[0], measured, "o", color=style.MEASURED, ms=size, label="measured", zorder=2)
    for model, (label, line) in lines.items():
        axes.plot(*_with_gaps(run, line), label=label, **_style(model))
    if measured is not None and np.isfinite(measured).any():
        low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
        style.limit(axes, low, high, reach * max(high - low, least), [line for _, line in lines.values()])


def _style(model: str) -> dict[str, Any]:
    return {"color": style.MODEL_COLOURS[model], "ls": style.MODEL_LINES[model], "zorder": 4 if model == "2" else 3}


def _with_gaps(run: Run, values: Floats) -> tuple[Floats, Floats]:
    time = run.time - run.time[0]
    at = np.flatnonzero(np.diff(time) > GAP_IN_PERIODS * run.sample_period) + 1
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan)


@style.house_style
def planar_figure(free: FreeRun) -> Figure:
    """Draw one run in the plane: measured and simulated by the commands alone, from its start state."""
    run, simulated = free.run, {} if free.diverged else free.simulated
    figure, axes = style.new_figure(3, 2, style.PAGE_IN, 7.0)
    places, commands = axes[0, 1], axes[2, 1]
    for panel, (channel, (label, factor)) in zip((axes[0, 0], axes[1, 0], axes[1, 1], axes[2, 0]), QUANTITIES.items()):
        reading = run.channel(channel)
        measured = None if free.error_of(channel) is None or reading is None else factor * reading
        lines = {"3": ("simulated, free run", factor * simulated[channel])} if channel in simulated else {}
        _measured_and_simulated(panel, run, measured, lines, 2.0, least=1e-3)
        panel.set(ylabel=label, xlabel=TIME)
    track(places, run if free.distance is not None else None, 2.5 if len(run) <= CROWD else 1.2)
    if set(PLACES) <= simulated.keys():
        places.plot(simulated["east"], simulated["north"], **_style("3"))
    places.set_xlabel("East [m]")
    for dof, colour in ((SURGE, "black"), (SWAY, "green"), (YAW, "orange")):
        label = f"{dof.words.full_force} [{dof.units.forces[1]}]"
        look = {"color": style.COLOURS[colour], "drawstyle": "steps-mid", "label": label}
        commands.plot(run.time - run.time[0], run.command_of(dof), **look)
    commands.set(ylabel="Command [N, N m]", xlabel=TIME)
    diverges = ": the simulation diverges" * free.diverged
    figure.suptitle(f"{style.shortened(run.name, LONGEST_TITLE)}{diverges}", parse_math=False)
    style.legend_below(figure, axes[0, 0], commands)
    return figure


def track(axes: Axes, run: Run | None, size: float) -> None:
    if run is not None:
        north, east = (run.channel(name) for name in PLACES)
        if north is not None and east is not None:
            axes.plot(east, north, "o", mew=0.0, color=style.MEASURED, ms=size, zorder=2)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_ylabel("North [m]")


@style.house_style
def whole_runs_figure(fit: YawFit) -> Figure:
    """Draw what is left of each whole run, the worst first: by the commands alone, as anybody else would simulate it,
    and with the run's own thrust and start, as it was fitted; against the noise."""
    dof, mixed, model = fit.dof, fit.preferred.mixed, fit.preference.number
    fitted = mixed.reading(dof.position)
    free = [dof.shown(run.error) for run in free_runs(fit.preferred.model, fit.runs, fit.preferred.offset.value)]
    size = np.array([np.sqrt(np.mean(error**2)) for error in free])  # not finite where the model diverges
    order = np.argsort(-np.nan_to_num(size, nan=np.inf), kind="stable")[:MOST_WHOLE]
    figure, axes = style.panels(len(order), 3, 1.5, 1.0, sharey=True)
    noise = float(dof.shown(fit.preferred.noise or mixed.noise))
    for ax, i in zip(axes.flat, order):
        run = fit.runs[i]
        time, residual = run.time - run.time[0], dof.shown(run.position - fitted[i][: len(run)])
        ax.axhspan(-2 * noise, 2 * noise, color=style.MEASURED, alpha=0.3, lw=0, label=f"± 2 × noise of {noise:.2g}")
        ax.plot(time, residual, color=style.COLOURS["sky"], lw=0.8, label="with the run's own thrust and start")
        ax.plot(time, free[i], lw=1.1, label=f"model {model} by the commands alone", **_style(model))
        rms = f"{size[i]:.3g} {dof.units.shown} rms" if np.isfinite(size[i]) else "diverges"
        ax.set_title(f"{run.name}: {rms}", parse_math=False)  # a name may hold dollar signs
    for ax in axes[-1]:
        ax.set_xlabel("Time in the run [s]")
    for ax in axes[:, 0]:
        ax.set_ylabel(f"Measured less\nsimulated [{dof.units.shown}]")
    style.legend_below(figure, axes[0, 0])
    how_many = f"the worst {len(order)} of {len(free)} runs" if len(order) < len(free) else f"all {len(free)} runs"
    figure.suptitle(f"What is left of {how_many}, the worst first")
    return figure


@style.house_style
def driven_runs_figure(fit: YawFit | PlanarFit, use: Use | PlanarUse) -> Figure:
    """Draw of each run its position with predictions of the model fitted to the other runs and the free run of the
    model; beside it the disturbance and the command, or in the plane the track where positions are logged."""
    dof, drawn, of_motion = fit.runs[0].dof, fit.runs[:MOST_DRIVEN], isinstance(use, Use)
    placed = isinstance(use, PlanarUse) and set(PLACES) <= use.free.keys()
    ratios = [2.0, 1.0] if of_motion or placed else [1.0]
    size = style.PAGE_IN, 1.3 + 1.6 * len(drawn)
    figure, axes = style.new_figure(len(drawn), len(ratios), *size, width_ratios=ratios)
    for i, (run, (positions, *right)) in enumerate(zip(drawn, axes)):
        _predicted(positions, run, dof, use, i)
        positions.set_ylabel(f"{dof.words.position.capitalize()} {dof.symbols.position_print} [{dof.units.shown}]")
        for ax in right:
            if isinstance(use, Use):
                commanded = {"color": "0.6", "lw": 0.6, "label": f"{dof.words.force} commanded"}
                ax.step(run.time - run.time[0], run.command, where="post", **commanded)
                push = {"color": style.COLOURS["green"], "lw": 1.0, "label": "disturbance that was needed"}
                end = int((use.course.length[i] > 0).sum()) + 1
                ax.plot(use.course.time[i, :end], use.disturbance[i, :end], **push)
                ax.set_ylabel(f"{dof.words.force.capitalize()} [{run.moment_unit}]")
            elif isinstance(use, PlanarUse):
                track(ax, run, 1.5)
                ax.plot(use.free["east"][i], use.free["north"][i], **FREE)
    for ax, label in zip(axes[-1], ("Time in the run [s]", "Time in the run [s]" if of_motion else "East [m]")):
        ax.set_xlabel(label)
    style.legend_below(figure, *axes[0])
    some = "" if len(drawn) == len(fit.runs) else f"The first {len(drawn)} of {len(fit.runs)} runs. "
    figure.suptitle(
        f"{some}Predictions and free runs start from filtered states, which know the readings until then;\n"
        f"after that they follow the commands alone{'. Disturbances are no measurement' * of_motion}",
        fontsize=7.5,
    )
    return figure


def _predicted(axes: Axes, run: Run, dof: Dof, use: Use | PlanarUse, i: int) -> None:
    """Draw what was measured, predicted from filtered states, and the free run, which may leave the picture."""
    measured, time = dof.shown(run.position), use.course.time[i]
    free = use.free[dof.position][i] if isinstance(use, PlanarUse) else use.free[i]
    quantities = [channel.quantity for channel in use.course.channels]
    values = shown_channel(use.course, quantities.index(dof.position) if isinstance(use, PlanarUse) else 0).values[i]
    axes.plot(run.time - run.time[0], measured, color=style.MEASURED, lw=2.2, label="measured")
    if (ahead := next((ahead for ahead in use.predictions if ahead.horizon == JUDGED), None)) is not None:
        target, error = ahead.target[ahead.run == i], ahead.error[ahead.run == i]
        label = f"predicted {JUDGED:g} s ahead{', run left out of the fit' * (use.runs > 1)}"
        predicted = dof.shown(values[target] - error)
        axes.plot(time[target], predicted, ".", color=style.COLOURS["vermilion"], ms=2.2, label=label)
    axes.plot(time, dof.shown(free), label="free run of the model", **FREE)
    reach = 0.5 * float(np.ptp(measured)) + 1e-6
    axes.set_ylim(float(measured.min()) - reach, float(measured.max()) + reach)
    axes.set_title(run.name, parse_math=False)


@style.house_style
def half_turns_figure(fit: YawFit) -> Figure:
    """Draw the position of every step over time: the part that was fitted coloured by its force, the rest in grey."""
    dof, words = fit.dof, fit.dof.words
    figure, axes = style.new_figure(1, 2, style.PAGE_IN, 3.2, sharey=True)
    scale, colours = _moment_scale(np.array([turn.moment for turn in fit.turns]))
    for ax, sign, way, side in zip(axes[0], (-1, 1), words.to_ways[::-1], ("negative", "positive")):
        turns = [turn for turn in fit.turns if np.sign(turn.moment) == sign]
        ends = [(t, slice(t.looked_at[0], t.kept.start + 1), slice(t.kept.stop - 1, t.looked_at[1])) for t in turns]
        cut = [_position(turn, part) for turn, *parts in ends for part in parts]
        _lines(ax, cut, colors="0.82", linewidths=0.7, zorder=1)
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
    for i, model in enumerate("123"):
        if (drag := seed.drag.get(model)) is None:
            continue
        look: dict[str, Any] = {"color": style.MODEL_COLOURS[model], "zorder": 4 if model == "2" else 3}
        curve = dof.shown(steady_rate(*drag.acting(grid)))
        top.plot(grid, curve, ls=style.MODEL_LINES[model], label=f"model {model}", **look)
        shift = (i - 1) * 0.006 * np.ptp(grid)  # so that none hides another
        bottom.plot(moment + shift, drag.residuals, "^os"[i], ms=2.6, mec="none", **look)
    top.legend(loc="upper left")
    return figure


@style.house_style
def inertia_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Draw the inertia of each run, its mean at each force, and over all by both methods (the paper's Fig. 9)."""
    dof = fit.dof
    models = [model for model in ("1", "3") if model in seed.inertia]
    figure, axes = style.new_figure(1, len(models), style.PAGE_IN, 3.0)
    moment = np.array([turn.moment for turn in fit.turns])
    for ax, model in zip(axes[0], models):
        table, ml = seed.inertia[model], fit.output_error[model].estimates[dof.symbols.inertia]
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
        ax.set(title=f"model {model}", xlabel=_full_force(fit))
    unit = dof.unit_of("inertia", fit.moment_unit)
    axes[0, 0].set_ylabel(f"{dof.words.full_inertia.capitalize()} ${dof.symbols.inertia}$ [{unit}]")
    style.legend_below(figure, axes[0, 0], ncols=4)
    return figure


@style.house_style
def collapse_figure(fit: YawFit, data: StepData) -> Figure:
    """Draw position against time times the root of the force: one curve for all runs if model 3 holds."""
    dof, sym, model = fit.dof, fit.dof.symbols, fit.output_error["3"]
    x, force, unit = sym.position_print, sym.force_print, dof.units.shown
    figure, top, bottom = style.above_residuals(4.6, 4.6, (
        f"Scaled time s = t √|{force}| [s ({fit.moment_unit})$^{{1/2}}$]",
        f"{dof.words.position.capitalize()} {dof.words.moved} sgn({force})({x} − {x}₀) [{unit}]",
        f"Off the curve [{unit}]",
    ))  # fmt: skip
    k_rr, inertia = model.estimates[sym.quadratic].value, model.estimates[sym.inertia].value
    scale, colours = _moment_scale(data.moment)
    late = model.offset.value * data.interval
    points, runs = [], len(data.moment)
    for i in np.unique(np.linspace(0, runs - 1, min(runs, MOST_COLLAPSED)).round().astype(int)):
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
    heavy, drag = sym.inertia, sym.quadratic_math
    name = rf"$({heavy}/{drag})\,\ln\cosh\,(s\,{drag}^{{1/2}}/{heavy})$"
    alike = dof.shown(response(grid, 1.0, inertia, 0.0, k_rr)[0])
    top.plot(grid, alike, color=style.COLOURS["vermilion"], lw=1.4, label=name)
    top.legend(loc="upper left", title=f"{MOST_COLLAPSED} of {runs} runs are shown" if runs > MOST_COLLAPSED else None)
    figure.colorbar(scale, ax=[top, bottom], label=_size_of_force(fit), pad=0.01)
    return figure


def _full_force(fit: YawFit) -> str:
    return f"{fit.dof.words.full_force.capitalize()} {fit.dof.symbols.force_print} [{fit.moment_unit}]"


def _size_of_force(fit: YawFit) -> str:
    return f"Size of the {fit.dof.words.force} |{fit.dof.symbols.force_print}| [{fit.moment_unit}]"


def _acting(model: OutputErrorFit, moment: float) -> tuple[float, float]:
    """What a run moves by, and its drag as a share of the middle of both ways: 1 where they do not differ."""
    estimates, sym = model.estimates, model.model.dof.symbols
    if sym.constant in estimates:
        moment += estimates[sym.constant].value
    if sym.difference not in estimates:
        return moment, 1.0
    half = estimates[sym.difference].value / estimates[sym.quadratic].value
    return moment, 1.0 + float(np.sign(moment)) * half


def _moment_scale(moment: Any) -> tuple[Any, Any]:
    sizes = np.abs(moment)
    low, high = float(sizes.min()), float(sizes.max())
    scale = matplotlib.cm.ScalarMappable(Normalize(low if high > low else 0.9 * low, high), "cividis")
    return scale, scale.to_rgba
