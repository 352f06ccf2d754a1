"""Figures of runs: logs as they are; steps with their trims, drag (the paper's Fig. 7), inertia (Fig. 9), the collapse;
measured beside simulated (Fig. 10), and beside predictions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from automarine_cli.comparison.prediction import Column, PredictedRun
from automarine_cli.comparison.simulated_runs import FreeRun, free_runs, planar_free_runs
from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.estimate import Estimate
from automarine_cli.fits.driven import Judgement
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.paper import VelocityErrorFit
from automarine_cli.fits.planar_fit import PlanarFit
from automarine_cli.fits.planar_structure import NORTH_EAST
from automarine_cli.fits.preference import COMPARISON_HORIZONS_S
from automarine_cli.fits.steps import StepData
from automarine_cli.models.model import response, steady_rate
from automarine_cli.models.store import DRAG_LAWS, StoredModels, named_model
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.tables import interval, number
from automarine_cli.runs.half_turn import HalfTurn
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.look import RunSeen
from automarine_cli.runs.run import Run
from automarine_cli.text import plural

DEG_PER_RAD = 180.0 / np.pi
MAX_TITLE_LETTERS = 60
LOGS_IN_A_ROW, MAX_NAME_OF_LOG = 4, 24
MAX_TRACKS = 12
QUANTITIES = {
    "heading": (r"Heading $\psi$ [deg]", DEG_PER_RAD), "surge": ("Surge $u$ [m/s]", 1.0),
    "sway": ("Sway $v$ [m/s]", 1.0), "yaw_rate": ("Yaw rate $r$ [deg/s]", DEG_PER_RAD),
}  # fmt: skip
MEASURED_POINTS: dict[str, Any] = {"color": style.MEASURED_COLOUR, "ms": 1.5, "mew": 0.0, "label": "measured"}
TIME_LABEL = "Time from the start of the run [s]"


@style.house_style
def validation_figure(free: Mapping[str, FreeRun], stored: StoredModels, floor: float) -> Figure:
    """Draw one run: `free` holds its free run under each model, `floor` is the noise of its position [deg or cm]. The
    scales are those of the model that the `stored` ones prefer."""
    preferred, added = stored.preferred, f" with {' and '.join(stored.effects)}" if stored.effects else ""
    run = next(iter(free.values())).run
    dof, letters, unit, measured = run.dof, run.dof.symbols, run.dof.units.shown, run.dof.shown(run.position)
    figure, axes = style.new_figure(3, 1, style.PAGE_IN, 6.0, sharex=True, height_ratios=(2.0, 1.3, 0.9))
    positions, errors, command = axes[:, 0]
    positions.plot(run.time - run.time[0], measured, "o", **MEASURED_POINTS)
    for model, simulated in free.items():
        if model == "2" != preferred and "3" in free:  # 3 would hide it
            continue
        error = np.where(simulated.diverged, np.nan, dof.shown(simulated.error))
        rmse = "diverges" if simulated.diverged else f"rmse {number(float(np.sqrt(np.mean(error**2))), 2)} {unit}"
        look = style.model_look(model, preferred)
        positions.plot(*_with_gaps(run, measured - error), label=f"{named_model(model)}{added}: {rmse}", **look)
        errors.plot(*_with_gaps(run, error), **look)
    error = dof.shown(free[preferred].error)
    finding, reach = "diverges", float(np.ptp(measured)) + 1.0
    if not free[preferred].diverged:
        largest = float(np.abs(error).max())
        finding, reach = f"drifts up to {number(largest, 2)} {unit}", 0.3 * largest + 3.0 * floor
        style.limit(errors, float(error.min()), float(error.max()), reach)
    style.limit(positions, float(measured.min()), float(measured.max()), max(reach, 0.2 * float(np.ptp(measured))))
    name = style.shortened(run.name, MAX_TITLE_LETTERS)
    title = f"{name}: model {preferred}{added} {finding}; {dof.position} noise {number(floor, 2)} {unit}"
    errors.axhspan(-2 * floor, 2 * floor, color="0.92", lw=0, zorder=0, label=f"twice the {dof.position} noise")
    _draw_commands(command, run, run.time, in_plane=False)
    positions.set_ylabel(f"{dof.position.capitalize()} ${letters.position_math}$ [{unit}]")
    positions.set_title(title, loc="left", parse_math=False)
    errors.set_ylabel(f"Measured − simulated [{unit}]")
    command.set_xlabel(TIME_LABEL)
    style.legend_below(figure, positions, errors)
    figure.align_ylabels()
    return figure


def _with_gaps(run: Run, values: Floats) -> tuple[Floats, Floats]:
    time = run.time - run.time[0]
    at = np.flatnonzero(np.diff(time) > GAP_IN_PERIODS * run.sample_period) + 1
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan)


@style.house_style
def prediction_figure(predicted: PredictedRun, shown: Mapping[str, Column]) -> Figure:
    """Draw what the commands of a run do, each quantity with its band, and what was measured where the log has it."""
    run, dof, in_plane = predicted.run, predicted.run.dof, len(shown) > len(predicted.run.dof.channels)
    time = run.time - run.time[0]
    if in_plane:
        figure, grid = style.new_figure(3, 2, style.PAGE_IN, 7.0)
        track, commands = grid[0, 1], grid[2, 1]
        panels = dict(zip(QUANTITIES, (grid[0, 0], grid[1, 0], grid[1, 1], grid[2, 0])))
        _draw_end_of_track(track, predicted)
    else:
        figure, grid = style.new_figure(3, 1, style.PAGE_IN, 5.6, sharex=True, height_ratios=(2.0, 1.3, 0.9))
        panels, commands = dict(zip(shown, grid[:2, 0])), grid[2, 0]
    for quantity, panel in panels.items():
        values, low, high = shown[quantity].factor * predicted.bands[quantity]
        panel.fill_between(time, low, high, color=style.COLOURS["sky"], alpha=0.45, lw=0, label="95 % band")
        panel.plot(*_with_gaps(run, values), label="predicted", **style.PREFERRED)
        reading = run.channel(quantity)
        if reading is not None and np.any(reading) and not (run.summed_up and quantity == dof.position):
            panel.plot(time, shown[quantity].factor * reading, "o", **MEASURED_POINTS)
        panel.set_ylabel(f"{quantity.replace('_', ' ').capitalize()} [{shown[quantity].unit}]")
    _draw_commands(commands, run, time, in_plane)
    for panel in (*(panels.values() if in_plane else ()), commands):
        panel.set_xlabel(TIME_LABEL)
    value, low, high = shown[dof.position].factor * predicted.bands[dof.position][:, -1]
    end = interval(Estimate(value, (high - low) / 4.0, (low, high), shown[dof.position].unit))
    name, seconds = style.shortened(run.name, MAX_TITLE_LETTERS), number(float(time[-1]), 3)
    what = f"the {dof.position} is {end} {shown[dof.position].unit}"
    figure.suptitle(f"{name}: after {seconds} s {what}", parse_math=False)
    style.legend_below(figure, panels[dof.position], *([commands] if in_plane else []))
    figure.align_ylabels()
    return figure


def _draw_end_of_track(panel: Axes, predicted: PredictedRun) -> None:
    """Draw a track on the water, with the band of its end, and what was measured."""
    north, east = (predicted.bands[name] for name in NORTH_EAST)
    read = [predicted.run.channel(name) for name in NORTH_EAST]
    if read[0] is not None and read[1] is not None:
        panel.plot(read[1], read[0], "o", **MEASURED_POINTS)
    panel.plot(east[0], north[0], **style.PREFERRED)
    up, across = (np.abs(band[1:, -1:] - band[0, -1]) for band in (north, east))
    look: dict[str, Any] = {"fmt": "o", "color": style.COLOURS["blue"], "ms": 3.0, "capsize": 2.5, "zorder": 5}
    panel.errorbar(east[0, -1:], north[0, -1:], up, across, **look)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set(xlabel="East [m]", ylabel="North [m]")


def _draw_commands(panel: Axes, run: Run, time: Floats, in_plane: bool) -> None:
    """Draw what is commanded: in the plane both forces and the moment."""
    panel.axhline(0.0, color="0.4", lw=0.7, zorder=1)
    if not in_plane:
        panel.plot(*_with_gaps(run, run.command), color=style.COLOURS["green"], drawstyle="steps-mid")
        panel.set_ylabel(f"{run.dof.words.force.capitalize()} ${run.dof.symbols.force_math}$ [{run.moment_unit}]")
        return
    for dof, colour in ((SURGE, "black"), (SWAY, "green"), (YAW, "orange")):
        label = f"{dof.words.full_force} [{dof.units.forces[1]}]"
        panel.step(time, run.command_of(dof), where="mid", color=style.COLOURS[colour], label=label)
    rudder = run.extras.get("rudder")
    if rudder is not None:
        degrees = DEG_PER_RAD * rudder
        panel.step(time, degrees, where="mid", color=style.COLOURS["vermilion"], label="rudder [deg]")
    panel.set_ylabel("Command [N, N m]" if rudder is None else "Command [N, N m, deg]")


@style.house_style
def planar_figure(free: FreeRun) -> Figure:
    """Draw one run in the plane: measured and simulated by the commands alone, from its start state."""
    run, simulated, time = free.run, {} if free.diverged else free.simulated, free.run.time - free.run.time[0]
    figure, axes = style.new_figure(3, 2, style.PAGE_IN, 7.0)
    places, commands = axes[0, 1], axes[2, 1]
    for panel, (channel, (label, factor)) in zip((axes[0, 0], axes[1, 0], axes[1, 1], axes[2, 0]), QUANTITIES.items()):
        reading = run.channel(channel)
        if reading is not None and free.error_of(channel) is not None:
            panel.plot(time, factor * reading, "o", **MEASURED_POINTS)
        if channel in simulated:
            look = {"label": "simulated, free run", **style.PREFERRED}
            panel.plot(*_with_gaps(run, factor * simulated[channel]), **look)
        panel.set(ylabel=label, xlabel=TIME_LABEL)
    north, east = (run.channel(name) for name in NORTH_EAST)
    if free.distance is not None and north is not None and east is not None:
        places.plot(east, north, "o", **MEASURED_POINTS)
    if set(NORTH_EAST) <= simulated.keys():
        places.plot(simulated["east"], simulated["north"], **style.PREFERRED)
    places.set_aspect("equal", adjustable="datalim")
    places.set(xlabel="East [m]", ylabel="North [m]")
    _draw_commands(commands, run, time, in_plane=True)
    commands.set_xlabel(TIME_LABEL)
    title = style.shortened(run.name, MAX_TITLE_LETTERS)
    if free.diverged:
        title += ": the simulation diverges"
    elif (error := free.error_of(YAW.position)) is not None:
        drift = number(np.nanmax(np.abs(error)) * DEG_PER_RAD, 2)
        title += f": by the commands alone the heading drifts up to {drift} deg"
    figure.suptitle(title, parse_math=False)
    style.legend_below(figure, axes[0, 0], commands)
    return figure


@style.house_style
def tracks_figure(fit: PlanarFit) -> Figure:
    """Draw the first fitted runs as measured and as simulated by the commands alone: tracks on the water where these
    were logged, and the speeds ahead and aside below each."""
    runs = fit.runs[:MAX_TRACKS]
    parts = ("track", "speeds") if fit.observed.over_ground else ("speeds",)
    columns = min(len(runs), LOGS_IN_A_ROW)
    rows, heights = -(-len(runs) // columns), {"track": 1.5, "speeds": 1.0}
    figure, axes = style.new_figure(
        len(parts) * rows, columns, style.PAGE_IN, 0.9 + (2.9 if len(parts) == 2 else 1.5) * rows,
        height_ratios=[heights[part] for part in parts] * rows,
    )  # fmt: skip
    for panel in axes[-len(parts) :, len(runs) - columns * (rows - 1) :].flat:
        panel.set_axis_off()
    for i, free in enumerate(planar_free_runs(fit.best.answering, runs)):
        row, column = len(parts) * (i // columns), i % columns
        run, time, simulated = free.run, free.run.time - free.run.time[0], {} if free.diverged else free.simulated
        speeds = axes[row + len(parts) - 1, column]
        for dof, colour in ((SURGE, "blue"), (SWAY, "orange")):
            reading = run.channel(dof.velocity)
            if reading is not None and np.isfinite(reading).any():
                speeds.plot(time, reading, "o", color=style.COLOURS[colour], ms=2.2, mew=0.0)
            if simulated:
                speeds.plot(*_with_gaps(run, simulated[dof.velocity]), color=style.COLOURS[colour], lw=1.0)
        if row + len(parts) >= len(axes) or i + columns >= len(runs):
            speeds.set_xlabel("Time [s]", fontsize=7.0)
        north, east = (run.channel(name) for name in NORTH_EAST)
        if len(parts) == 2 and north is not None and east is not None:
            track = axes[row, column]
            track.plot(east, north, "o", color=style.MEASURED_COLOUR, ms=1.5, mew=0.0)
            if set(NORTH_EAST) <= simulated.keys():
                track.plot(simulated["east"], simulated["north"], color=style.COLOURS["black"], lw=1.0)
            track.set_aspect("equal", adjustable="datalim")
            track.set_xlabel("East [m]", fontsize=7.0)
        axes[row, column].set_title(style.shortened(run.name, MAX_NAME_OF_LOG), parse_math=False, fontsize=7.0)
        if column == 0:
            speeds.set_ylabel("Speed [m/s]", fontsize=7.0)
            if len(parts) == 2:
                axes[row, column].set_ylabel("North [m]", fontsize=7.0)
    looks = {"track": "black", "surge": "blue", "sway": "orange"}
    handles = [Line2D([], [], color=style.COLOURS[colour], label=label) for label, colour in looks.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    which = "" if len(runs) == len(fit.runs) else f" (the first {len(runs)} of {len(fit.runs)})"
    figure.suptitle(f"Fitted runs{which}: dots measured, lines simulated by the commands alone")
    return figure


def whole_runs_figure(fit: YawFit) -> Figure:
    """Draw what is left of each whole run from the commands alone, as anybody else would simulate it, and with its own
    thrust, start and unknown pushes, as it was fitted: the pushes absorb what the model lacks."""
    dof, mixed, residuals = fit.dof, fit.preferred.mixed, list[style.Residuals]()
    fitted = mixed.reading(dof.position)
    for i, free in enumerate(free_runs(fit.preferred.answering, fit.runs)):
        run, errors = free.run, (free.error, free.run.position - fitted[i][: len(free.run)])
        residuals.append((run.name, [(run.time - run.time[0], dof.shown(error)) for error in errors]))
    labels, title = ("from the commands alone", "with own thrust and unknown pushes"), f"Model {fit.preference.number}"
    noise = float(dof.shown(fit.preferred.noise or mixed.noise))
    return style.residuals_figure(residuals, labels, dof.units.shown, noise, title)


def driven_runs_figure(runs: Sequence[Run], use: Judgement, noise: float) -> Figure:
    """Draw errors of positions that the model fitted to the other runs predicts from filtered states, beside the
    `noise` of the position's sensor."""
    assert use.course is not None
    dof, time, residuals = runs[0].dof, use.course.time, list[style.Residuals]()
    ahead = sorted((p for p in use.predictions if p.horizon in COMPARISON_HORIZONS_S), key=lambda p: -p.horizon)
    for i, run in enumerate(runs):
        lines = [(time[i][p.target[p.run == i]], np.asarray(dof.shown(p.error[p.run == i]))) for p in ahead]
        residuals.append((run.name, lines))
    labels = [f"predicted {p.horizon:g} s ahead" for p in ahead]
    title = f"{dof.words.position.capitalize()} error{' of runs held out' if use.runs > 1 else ''}"
    return style.residuals_figure(residuals, labels, dof.units.shown, float(dof.shown(noise)), title)


USABLE: dict[str, Any] = {"color": style.COLOURS["blue"], "lw": 1.8}
MANOEUVRE: dict[str, Any] = {"color": style.COLOURS["orange"], "lw": 1.2}
REST_LINE: dict[str, Any] = {"color": "0.55", "lw": 0.6}  # widths that a grey printer tells apart


@style.house_style
def logs_figure(runs: Sequence[RunSeen]) -> Figure:
    """Draw runs of one motion as they were logged, position above command: what a fit of steps uses in blue, what only
    fits of whole runs use in orange, the rest and what is set aside, with its reason, in grey."""
    dof = runs[0].dof
    columns = min(len(runs), LOGS_IN_A_ROW)
    rows = -(-len(runs) // columns)
    height = 0.9 + 1.7 * rows
    figure, axes = style.new_figure(2 * rows, columns, style.PAGE_IN, height, height_ratios=(2.2, 1.0) * rows)
    for i in range(rows * columns):
        position, command = axes[2 * (i // columns) : 2 * (i // columns) + 2, i % columns]
        if i >= len(runs):
            position.set_axis_off()
            command.set_axis_off()
            continue
        run, trace = runs[i], runs[i].trace
        whole = run.kind == "manoeuvre" and not trace.used.any()
        position.plot(trace.time, trace.position, **(MANOEUVRE if whole else REST_LINE))
        position.plot(trace.time, np.where(trace.used, trace.position, np.nan), **USABLE)
        command.plot(trace.time, trace.command, lw=0.9, color=style.COLOURS["green"], drawstyle="steps-mid")
        position.sharex(command)
        position.tick_params(labelbottom=False)
        why = "" if trace.used.any() or whole or run.why is None else f"\n{run.why.split(':')[0]}"
        position.set_title(f"{style.shortened(run.run, MAX_NAME_OF_LOG)}{why}", parse_math=False, fontsize=7.0)
        if i % columns == 0:
            position.set_ylabel(f"{dof.words.position.capitalize()} [{dof.units.shown}]", fontsize=7.0)
            command.set_ylabel(f"${dof.symbols.force_math}$ [{run.moment_unit}]", fontsize=7.0)
        if i + columns >= len(runs):
            command.set_xlabel("Time [s]", fontsize=7.0)
    labels = f"usable {dof.words.step}", "manoeuvre, for fits of whole runs", "the rest"
    handles = [Line2D([], [], label=label, **look) for label, look in zip(labels, (USABLE, MANOEUVRE, REST_LINE))]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.suptitle(f"{plural(len(runs), f'{dof.name} run')} as logged")
    figure.align_ylabels()
    return figure


@style.house_style
def half_turns_figure(fit: YawFit) -> Figure:
    """Draw the position of every step over time: the part that was fitted coloured by its force, the rest in grey."""
    dof, words = fit.dof, fit.dof.words
    figure, ((ax,),) = style.new_figure(1, 1, style.PAGE_IN, 4.0)
    looked_at = [_position(turn, slice(*turn.looked_at)) for turn in fit.turns]
    _lines(ax, looked_at, colors="0.82", linewidths=0.7, zorder=1, label="rest, and what was cut")
    parts = [slice(t.step.first, t.step.stop) if fit.whole_steps and dof.wraps else t.kept for t in fit.turns]
    fitted, sizes = list(map(_position, fit.turns, parts)), [abs(turn.moment) for turn in fit.turns]
    drawn = _lines(ax, fitted, array=sizes, cmap="cividis", linewidths=0.9, zorder=2)
    if dof.wraps:
        look: dict[str, Any] = {"color": style.COLOURS["vermilion"], "ls": "--", "label": words.reach}
        ax.hlines((-180.0, 180.0), 0.0, 1.0, transform=ax.get_yaxis_transform(), **look)
    x = dof.symbols.position_print
    ylabel = f"{words.position.capitalize()} minus start {words.position} {x} − {x}₀ [{dof.units.shown}]"
    ax.set(xlabel="Time since the step [s]", ylabel=ylabel)
    ax.set_title(f"Fitted (in colour): {fit.fitted_to} of {plural(len(fitted), 'run')}", loc="left")
    style.legend_below(figure, ax)
    figure.colorbar(drawn, label=_size_of_force(fit), pad=0.01)
    return figure


def _position(turn: HalfTurn, part: slice) -> Floats:
    """A part of a run as a line, (N, 2): time since the step, position less the start."""
    run, dof = turn.step.run, turn.step.run.dof
    moved = dof.shown(run.position[part]) - dof.shown(turn.start_position)
    return np.stack([run.time[part] - turn.step.switch_mid, moved], axis=1)


def _lines(ax: Axes, lines: Sequence[Floats], **look: Any) -> LineCollection:
    collection = LineCollection(lines, capstyle="projecting", **look)
    collection.set_in_layout(False)  # it stays within the axes: to measure every line for the layout takes its time
    ax.add_collection(collection)
    ax.autoscale_view()
    return collection


@style.house_style
def drag_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Draw steady velocity against force with the curves of Table 1, residuals below (the paper's Fig. 7)."""
    dof, moment = fit.dof, np.array([turn.moment for turn in fit.turns])
    rate = f"Steady {dof.words.rate} {dof.symbols.velocity} [{dof.units.shown}/s]"
    labels = _full_force(fit), rate, f"Residual [{fit.moment_unit}]"
    figure, top, bottom = style.above_residuals(style.PAGE_IN, 5.2, labels)
    look: dict[str, Any] = {"mfc": "none", "mec": style.MEASURED_COLOUR, "label": "measured, one run each"}
    top.plot(moment, dof.shown(seed.tails.rate), "o", **look)
    grid = np.linspace(min(moment.min(), 0.0), max(moment.max(), 0.0), 401) * 1.03
    preferred, left, sym = fit.preferred.number, dict[str, float](), dof.symbols
    letters, v = {sym.linear: sym.linear, sym.quadratic: sym.quadratic_math}, sym.velocity
    terms = {sym.linear: rf"{sym.linear}\,{v}", sym.quadratic: rf"{sym.quadratic_math}\,|{v}|\,{v}"}
    shown = [model for model in DRAG_LAWS if model in seed.drag and (model != "2" or model == preferred)]  # 3 hides it
    for model, drag in ((model, seed.drag[model]) for model in shown):
        there = {name: drag.estimates[name] for name in letters if name in drag.estimates}
        sizes = ", ".join(f"${letters[name]}$ {interval(estimate)} {estimate.unit}" for name, estimate in there.items())
        label = f"model {model}: ${sym.force_math} = {' + '.join(terms[name] for name in there)}$ with {sizes}"
        look = style.model_look(model, preferred)
        top.plot(grid, dof.shown(steady_rate(*drag.acting(grid))), label=label, **look)
        marker = {"marker": "o" if model == preferred else "x", "mfc": "none", "color": look["color"]}
        bottom.plot(moment, drag.residuals, ls="", ms=3.0, zorder=look["zorder"], **marker)
        left[model] = float(np.sqrt(np.mean(drag.residuals**2)))
    said = dict.fromkeys(model for model in (preferred, max(left, key=left.__getitem__)) if model in left)
    texts = [f"{DRAG_LAWS[model]} drag leaves {number(left[model], 2)} {fit.moment_unit}" for model in said]
    title = ", ".join(texts)
    top.set_title(f"{title[0].upper()}{title[1:]} (least squares of the steady rates)", loc="left")
    style.legend_below(figure, top, ncols=1)
    return figure


@style.house_style
def inertia_figure(fit: YawFit, seed: VelocityErrorFit) -> Figure:
    """Draw the inertia of each run, its mean at each force, and over all by both methods (the paper's Fig. 9)."""
    dof = fit.dof
    models = [model for model in ("1", "3") if model in seed.inertia]
    figure, axes = style.new_figure(1, len(models), style.PAGE_IN, 3.0, sharey=True)
    moment = np.array([turn.moment for turn in fit.turns])
    for ax, model in zip(axes[0], models):
        table, ml = seed.inertia[model], fit.output_error[model].estimates[dof.symbols.inertia]
        ax.plot(moment, table.per_run / ml.value, "o", mfc="none", mec="0.3", mew=0.8, zorder=3, label="one run")
        at, means = np.transpose(sorted(table.per_moment.items()))
        look: dict[str, Any] = {"color": style.COLOURS["orange"], "label": f"mean at one {dof.words.force}"}
        ax.plot(at, means / ml.value, "D", ms=6, mec="none", **look)
        ends = moment.min() * 1.05, moment.max() * 1.05
        methods = (table.overall, "black", "--", "velocity error"), (ml, "blue", "-", "maximum likelihood")
        for estimate, colour, line, name in methods:
            look = {"color": style.COLOURS[colour], "ls": line, "label": f"overall, {name}"}
            ax.hlines(estimate.value / ml.value, *ends, lw=1.1, **look)
            low, high = (end / ml.value for end in estimate.ci95)
            ax.fill_between(ends, low, high, color=style.COLOURS[colour], alpha=0.15, lw=0)
        spread = f"means differ by a factor of {number(float(means.max() / means.min()), 2)}"
        said = f"{DRAG_LAWS[model].capitalize()} drag: {spread}" if means.min() > 0 else named_model(model).capitalize()
        ax.set_title(f"{said}\n${dof.symbols.inertia}$ {interval(ml)} {ml.unit}", loc="left")
        ax.set(xlabel=_full_force(fit), ylim=(min(0.0, ax.get_ylim()[0]), None))
    axes[0, 0].set_ylabel(f"${dof.symbols.inertia}$ of one run [× fitted ${dof.symbols.inertia}$]")
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
    constant, difference = (getattr(model.estimates.get(name), "value", 0.0) for name in (sym.constant, sym.difference))
    points = []
    for i, moment in enumerate(data.moment):
        used, acting = data.observed[i] & (data.time[i] >= 0), float(moment) + constant
        share = 1.0 + float(np.sign(acting)) * difference / k_rr  # of the drag of this way in the middle of both
        scaled = np.maximum(data.time[i][used] - model.delay.value, 0.0) * np.sqrt(abs(acting) * share)
        turned = np.sign(acting) * data.heading[i][used] * share
        curve = response(scaled, 1.0, inertia, 0.0, k_rr)[0]
        points.append((scaled, dof.shown(turned), dof.shown(turned - curve), np.full(len(scaled), abs(moment))))
    time, turned, off, size = (np.concatenate(column) for column in zip(*points))
    for ax, value in ((top, turned), (bottom, off)):
        drawn = ax.scatter(time, value, c=size, cmap="cividis", s=4.0, linewidths=0)
    grid = np.linspace(0.0, float(time.max(initial=0.0)), 400)
    alike = dof.shown(response(grid, 1.0, inertia, 0.0, k_rr)[0])
    top.plot(grid, alike, color=style.COLOURS["vermilion"], lw=1.4, label=named_model("3"))
    rms, ways = number(float(np.sqrt(np.mean(off**2))), 2), ", each way with its own drag" if difference else ""
    scatter = f"thrust scatters by {100 * fit.preferred.gain_scatter.value:.1f} %"
    top.set_title(f"All runs on one curve{ways}: {rms} {unit} off it\n({scatter})", loc="left")
    top.legend(loc="upper left")
    figure.colorbar(drawn, ax=[top, bottom], label=_size_of_force(fit), pad=0.01)
    return figure


def _full_force(fit: YawFit) -> str:
    return f"{fit.dof.words.full_force.capitalize()} {fit.dof.symbols.force_print} [{fit.moment_unit}]"


def _size_of_force(fit: YawFit) -> str:
    return f"Size of the {fit.dof.words.force} |{fit.dof.symbols.force_print}| [{fit.moment_unit}]"
