"""Figures of runs: measured beside simulated (the source paper's Fig. 10), and beside predictions."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.comparison.simulated_runs import FreeRun, free_runs
from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.filters.kalman import shown_channel
from automarine_cli.fits.driven import JUDGED, Use
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.mixed_model import MixedFit
from automarine_cli.fits.planar_fit import PlanarFit, PlanarUse
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.tables import number
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.run import Run

DEGREES = 180.0 / np.pi
LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller
MOST_WHOLE, MOST_DRIVEN = 24, 10  # runs that are drawn
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
    time, off = run.time - run.time[0], {m: dof.shown(each.error) for m, each in free.items() if not each.diverged}
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
        read = run.channel(channel)
        measured = None if free.error_of(channel) is None or read is None else factor * read
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
    assert isinstance(mixed, MixedFit)
    fitted = mixed.reading(dof.position)
    free = [dof.shown(run.error) for run in free_runs(fit.preferred.model, fit.runs, fit.preferred.offset.value)]
    size = np.array([np.sqrt(np.mean(error**2)) for error in free])  # not finite where the model diverges
    order = np.argsort(-np.nan_to_num(size, nan=np.inf), kind="stable")[:MOST_WHOLE]
    figure, axes = style.panels(len(order), 3, 1.5, 1.0, sharey=True)
    noise = float(dof.shown(fit.preferred.noise or mixed.noise))
    for ax, i in zip(axes.flat, order):
        run = fit.runs[i]
        time, rest = run.time - run.time[0], dof.shown(run.position - fitted[i][: len(run)])
        ax.axhspan(-2 * noise, 2 * noise, color=style.MEASURED, alpha=0.3, lw=0, label=f"± 2 × noise of {noise:.2g}")
        ax.plot(time, rest, color=style.COLOURS["sky"], lw=0.8, label="with the run's own thrust and start")
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
    dof, shown, of_motion = fit.dof if isinstance(fit, YawFit) else YAW, fit.runs[:MOST_DRIVEN], isinstance(use, Use)
    placed = isinstance(use, PlanarUse) and set(PLACES) <= use.free.keys()
    ratios = [2.0, 1.0] if of_motion or placed else [1.0]
    size = style.PAGE_IN, 1.3 + 1.6 * len(shown)
    figure, axes = style.new_figure(len(shown), len(ratios), *size, width_ratios=ratios)
    for i, (run, (left, *right)) in enumerate(zip(shown, axes)):
        _predicted(left, run, dof, use, i)
        left.set_ylabel(f"{dof.words.position.capitalize()} {dof.symbols.position_print} [{dof.units.shown}]")
        for ax in right:
            if isinstance(use, Use) and isinstance(fit, YawFit):
                commanded = {"color": "0.6", "lw": 0.6, "label": f"{dof.words.force} commanded"}
                ax.step(run.time - run.time[0], run.command, where="post", **commanded)
                push = {"color": style.COLOURS["green"], "lw": 1.0, "label": "disturbance that was needed"}
                end = int((use.course.length[i] > 0).sum()) + 1
                ax.plot(use.course.time[i, :end], use.disturbance[i, :end], **push)
                ax.set_ylabel(f"{dof.words.force.capitalize()} [{fit.moment_unit}]")
            elif isinstance(use, PlanarUse):
                track(ax, run, 1.5)
                ax.plot(use.free["east"][i], use.free["north"][i], **FREE)
    for ax, label in zip(axes[-1], ("Time in the run [s]", "Time in the run [s]" if of_motion else "East [m]")):
        ax.set_xlabel(label)
    style.legend_below(figure, *axes[0])
    some = "" if len(shown) == len(fit.runs) else f"The first {len(shown)} of {len(fit.runs)} runs. "
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
