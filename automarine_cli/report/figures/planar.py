"""The figure of a planar validation: heading, track, velocities and commands of one run."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.comparison.planar import DEGREES, PlanarFree
from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.style import COLOURS, MEASURED, PAGE_IN, house_style, new_figure

LONGEST_TITLE = 90
CROWD = 400  # more samples than this are drawn smaller
PANELS = (
    ("heading", r"Heading $\psi$ [deg]", DEGREES), ("surge", "Surge $u$ [m/s]", 1.0), ("sway", "Sway $v$ [m/s]", 1.0),
    ("yaw_rate", "Yaw rate $r$ [deg/s]", DEGREES),
)  # fmt: skip
ROOM = 2.0  # times the span of what was measured by which a line may leave it


@house_style
def planar_figure(free: PlanarFree) -> Figure:
    """One run: measured and simulated by the commands alone, from its start state."""
    run, time = free.run, free.run.time - free.run.time[0]
    figure, axes = new_figure(3, 2, PAGE_IN, 7.0)
    places = (axes[0, 0], axes[1, 0], axes[1, 1], axes[2, 0])
    size = 2.5 if len(run) <= CROWD else 1.2
    for panel, (channel, label, factor) in zip(places, PANELS):
        read = run.channel(channel)
        measured = None if free.error(channel) is None or read is None else factor * read
        if measured is not None:
            panel.plot(time, measured, "o", color=MEASURED, markersize=size, label="measured", zorder=2)
        if not free.diverged and channel in free.simulated:
            line = factor * free.simulated[channel]
            panel.plot(time, line, color=COLOURS["blue"], label="simulated, free run", zorder=3)
            _limit(panel, measured, line)
        panel.set_ylabel(label)
        panel.set_xlabel("Time from the start of the run [s]")
    _track(axes[0, 1], free, size)
    commands = axes[2, 1]
    for dof, colour in ((SURGE, "black"), (SWAY, "green"), (YAW, "orange")):
        unit = dof.units.forces[1]
        label = f"{dof.words.full_force} [{unit}]"
        commands.plot(time, run.command_of(dof), color=COLOURS[colour], drawstyle="steps-mid", label=label)
    commands.set_ylabel("Command [N, N m]")
    commands.set_xlabel("Time from the start of the run [s]")
    title = run.name if len(run.name) <= LONGEST_TITLE else f"{run.name[: LONGEST_TITLE - 1]}…"
    figure.suptitle(f"{title}{': the simulation diverges' * free.diverged}", parse_math=False)
    handles = [*axes[0, 0].get_legend_handles_labels()[0], *commands.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _track(panel: Axes, free: PlanarFree, size: float) -> None:
    """North over east, with equal scales."""
    north, east = (free.run.channel(name) for name in ("north", "east"))
    if free.distance is not None and north is not None and east is not None:
        panel.plot(east, north, "o", color=MEASURED, markersize=size, zorder=2)
    if not free.diverged and {"north", "east"} <= free.simulated.keys():
        panel.plot(free.simulated["east"], free.simulated["north"], color=COLOURS["blue"], zorder=3)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("East [m]")
    panel.set_ylabel("North [m]")


def _limit(panel: Axes, measured: Floats | None, line: Floats) -> None:
    """Limits that hold the measured, and the line as far as it comes near."""
    if measured is None or not np.isfinite(measured).any():
        return
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    reach = ROOM * max(high - low, 1e-3)
    inside = np.concatenate([[low, high], np.clip(line, low - reach, high + reach)])
    margin = 0.05 * max(float(np.ptp(inside)), 1e-6)
    panel.set_ylim(float(inside.min()) - margin, float(inside.max()) + margin)
