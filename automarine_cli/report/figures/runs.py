"""Figures of runs: measured beside simulated (the source paper's Fig. 10), and beside predictions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.comparison.simulated_runs import FreeRun, free_runs
from automarine_cli.dofs import SURGE, SWAY, YAW, Dof
from automarine_cli.filters.course import Channel
from automarine_cli.filters.kalman import shown_channel
from automarine_cli.fits.driven import JUDGED, Use
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.mixed_model import MixedFit
from automarine_cli.fits.planar_fit import PlanarUse
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.quantities import Floats
from automarine_cli.report.figures import style
from automarine_cli.report.tables import number
from automarine_cli.runs.load import GAP_IN_PERIODS
from automarine_cli.runs.run import Run

DEGREES = 180.0 / np.pi
LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller
MOST_WHOLE, MOST_DRIVEN, MOST_PLANAR = 24, 12, 8  # runs that are drawn
ROOM = 2.0  # times the span of what was measured by which a line may leave it
FREE: dict[str, Any] = {"color": style.COLOURS["blue"], "lw": 0.9, "ls": (0, (4, 1.5))}
QUANTITIES = (
    ("heading", r"Heading $\psi$ [deg]", DEGREES), ("surge", "Surge $u$ [m/s]", 1.0), ("sway", "Sway $v$ [m/s]", 1.0),
    ("yaw_rate", "Yaw rate $r$ [deg/s]", DEGREES),
)  # fmt: skip


@style.house_style
def validation_figure(free: Mapping[str, FreeRun], floor: float) -> Figure:
    """Draw one run: `free` holds its free run under each model, `floor` is the noise of its position [deg or cm]."""
    run = next(iter(free.values())).run
    dof, letters, unit = run.dof, run.dof.symbols, run.dof.units.shown
    figure, axes = style.new_figure(3, 1, style.PAGE_IN, 6.0, sharex=True, height_ratios=(2.0, 1.3, 0.9))
    positions, errors, command = axes[:, 0]
    time, measured = run.time - run.time[0], dof.shown(run.position)
    positions.plot(time, measured, "o", color=style.MEASURED, ms=3.0 if len(run) <= CROWD else 1.5, label="measured")
    simulated = {m: (dof.shown(r.position), dof.shown(r.error)) for m, r in free.items() if not r.diverged}
    for model, (position, error) in simulated.items():
        label = f"model {model}: rmse {number(float(np.sqrt(np.mean(error**2))), 2)} {unit}"
        positions.plot(*_with_gaps(time, position, run.sample_period), label=label, **_style(model))
        errors.plot(*_with_gaps(time, error, run.sample_period), lw=1.0, **_style(model))
    for model in (model for model in free if model not in simulated):
        positions.plot([], [], label=f"model {model} diverges", **_style(model))
    low, high = float(measured.min()), float(measured.max())
    reach, most = 2 * max(high - low, 1.0), max(3 * floor, 0.5)
    style.limit(positions, low, high, reach, [position for position, _ in simulated.values()])
    style.limit(errors, -most, most, reach, [error for _, error in simulated.values()])
    errors.axhline(0.0, color="0.4", lw=0.7, zorder=1)
    if floor > 0:
        band = f"± 2 × noise level of {number(floor, 2)} {unit}"
        errors.axhspan(-2 * floor, 2 * floor, color="0.92", lw=0, zorder=0, label=band)
    command.axhline(0.0, color="0.4", lw=0.7, zorder=1)
    command.plot(*_with_gaps(time, run.command, run.sample_period), color=style.COLOURS["green"], drawstyle="steps-mid")
    positions.set_ylabel(f"{dof.position.capitalize()} ${letters.position_math}$ [{unit}]")
    positions.set_title(style.shortened(run.name, LONGEST_TITLE), parse_math=False)
    errors.set_ylabel(f"Measured − simulated [{unit}]")
    force = f"{dof.words.force.capitalize()} ${letters.force_math}$ [{run.moment_unit}]"
    command.set(ylabel=force, xlabel="Time from the start of the run [s]", xlim=(0.0, float(time[-1])))
    command.margins(y=0.15)
    style.legend_below(figure, positions, errors)
    figure.align_ylabels()
    return figure


def _style(model: str) -> dict[str, Any]:
    return {"color": style.MODEL_COLOURS[model], "ls": style.MODEL_LINES[model], "zorder": 4 if model == "2" else 3}


def _with_gaps(time: Floats, values: Floats, period: float) -> tuple[Floats, Floats]:
    at = np.flatnonzero(np.diff(time) > GAP_IN_PERIODS * period) + 1
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan)


@style.house_style
def planar_figure(free: FreeRun) -> Figure:
    """Draw one run in the plane: measured and simulated by the commands alone, from its start state."""
    run, time = free.run, free.run.time - free.run.time[0]
    figure, axes = style.new_figure(3, 2, style.PAGE_IN, 7.0)
    size = 2.5 if len(run) <= CROWD else 1.2
    for panel, (channel, label, factor) in zip((axes[0, 0], axes[1, 0], axes[1, 1], axes[2, 0]), QUANTITIES):
        read = run.channel(channel)
        measured = None if free.error_of(channel) is None or read is None else factor * read
        if measured is not None:
            panel.plot(time, measured, "o", color=style.MEASURED, ms=size, label="measured", zorder=2)
        if not free.diverged and channel in free.simulated:
            line = factor * free.simulated[channel]
            panel.plot(time, line, color=style.COLOURS["blue"], label="simulated, free run", zorder=3)
            if measured is not None and np.isfinite(measured).any():
                low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
                style.limit(panel, low, high, ROOM * max(high - low, 1e-3), [line])
        panel.set(ylabel=label, xlabel="Time from the start of the run [s]")
    simulated = not free.diverged and set(PLACES) <= free.simulated.keys()
    track(axes[0, 1], run if free.distance is not None else None, size)
    if simulated:
        axes[0, 1].plot(free.simulated["east"], free.simulated["north"], color=style.COLOURS["blue"], zorder=3)
    axes[0, 1].set(xlabel="East [m]")
    for dof, colour in ((SURGE, "black"), (SWAY, "green"), (YAW, "orange")):
        label = f"{dof.words.full_force} [{dof.units.forces[1]}]"
        axes[2, 1].plot(time, run.command_of(dof), color=style.COLOURS[colour], drawstyle="steps-mid", label=label)
    axes[2, 1].set(ylabel="Command [N, N m]", xlabel="Time from the start of the run [s]")
    diverges = ": the simulation diverges" * free.diverged
    figure.suptitle(f"{style.shortened(run.name, LONGEST_TITLE)}{diverges}", parse_math=False)
    style.legend_below(figure, axes[0, 0], axes[2, 1])
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
def driven_runs_figure(fit: YawFit, use: Use) -> Figure:
    """Draw of each run its position with predictions of the model fitted to the other runs and the free run of the
    preferred model, and below these the disturbance beside the command."""
    dof, shown = fit.dof, min(len(fit.runs), MOST_DRIVEN)
    columns = min(3, shown)
    rows = -(-shown // columns)
    figure, axes = style.new_figure(2 * rows, columns, style.PAGE_IN, 0.9 + 2.6 * rows, height_ratios=[2.0, 1.0] * rows)
    tops, bottoms = axes[::2].ravel(), axes[1::2].ravel()
    for ax in (*tops[shown:], *bottoms[shown:]):
        ax.set_axis_off()
    for i, (run, top, bottom) in enumerate(zip(fit.runs[:shown], tops, bottoms)):
        time, end = use.course.time[i], int((use.course.length[i] > 0).sum()) + 1
        _predicted(top, run, dof, use, shown_channel(use.course), use.free[i], i, True)
        top.tick_params(labelbottom=False)
        label = f"{dof.words.force} commanded"
        bottom.step(run.time - run.time[0], run.command, where="post", color="0.6", lw=0.6, label=label)
        push = {"color": style.COLOURS["green"], "lw": 1.0, "label": "disturbance that was needed"}
        bottom.plot(time[:end], use.disturbance[i, :end], **push)
        bottom.sharex(top)
    for top, bottom in axes[:, 0].reshape(-1, 2):
        top.set_ylabel(f"{dof.words.position.capitalize()} {dof.symbols.position_print} [{dof.units.shown}]")
        bottom.set_ylabel(f"{dof.words.force.capitalize()}\n[{fit.moment_unit}]")
    for ax in axes[-1]:
        ax.set_xlabel("Time in the run [s]")
    style.legend_below(figure, tops[0], bottoms[0])
    some = "" if shown == len(fit.runs) else f"The first {shown} of {len(fit.runs)} runs. "
    figure.suptitle(
        f"{some}Model {fit.preference.number}: predictions start from filtered states, which know the readings until "
        "then;\nthe disturbance is what the filter makes of the runs, no measurement",
        fontsize=7.5,
    )
    return figure


@style.house_style
def planar_runs_figure(runs: Sequence[Run], use: PlanarUse) -> Figure:
    """Draw of each run its heading with predictions of the model fitted to the other runs and the free run of the
    model, and beside it the track, where positions are logged."""
    shown, placed = min(len(runs), MOST_PLANAR), set(PLACES) <= use.free.keys()
    ratios = [2.0, 1.0] if placed else [1.0]
    figure, axes = style.new_figure(shown, len(ratios), style.PAGE_IN, 1.3 + 1.7 * shown, width_ratios=ratios)
    (channel,) = (channel for channel in use.course.channels if channel.quantity == YAW.position)
    for i, run in enumerate(runs[:shown]):
        _predicted(axes[i, 0], run, YAW, use, channel, use.free[YAW.position][i], i, use.runs > 1)
        axes[i, 0].set_ylabel("Heading [deg]")
        if placed:
            track(axes[i, 1], run, 1.5)
            axes[i, 1].plot(use.free["east"][i], use.free["north"][i], **FREE)
    for ax, label in zip(axes[-1], ("Time in the run [s]", "East [m]")):
        ax.set_xlabel(label)
    style.legend_below(figure, axes[0, 0])
    figure.suptitle(
        "Predictions and free runs start from filtered states, which know the readings until then;\n"
        "after that they follow the commands alone",
        fontsize=7.5,
    )
    return figure


def _predicted(
    axes: Axes, run: Run, dof: Dof, use: Use | PlanarUse, channel: Channel, free: Floats, i: int, left_out: bool
) -> None:
    """Draw what was measured, predicted from filtered states, and the free run, which may leave the picture."""
    measured, time = dof.shown(run.position), use.course.time[i]
    axes.plot(run.time - run.time[0], measured, color=style.MEASURED, lw=2.2, label="measured")
    if (ahead := next((ahead for ahead in use.predictions if ahead.horizon == JUDGED), None)) is not None:
        target, error = ahead.target[ahead.run == i], ahead.error[ahead.run == i]
        label = f"predicted {JUDGED:g} s ahead{', run left out of the fit' * left_out}"
        predicted = dof.shown(channel.values[i, target] - error)
        axes.plot(time[target], predicted, ".", color=style.COLOURS["vermilion"], ms=2.2, label=label)
    axes.plot(time, dof.shown(free), label="free run of the model", **FREE)
    reach = 0.5 * float(np.ptp(measured)) + 1e-6
    axes.set_ylim(float(measured.min()) - reach, float(measured.max()) + reach)
    axes.set_title(run.name, parse_math=False)
