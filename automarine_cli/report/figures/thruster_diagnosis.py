"""Figures of a diagnosed thruster map: where it goes wrong, why, and the gap before and after."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, legend, new_figure
from automarine_cli.thrusters.bollard_data import BollardData
from automarine_cli.thrusters.diagnosis import ThrusterDiagnosis
from automarine_cli.thrusters.shapes import Fitted
from automarine_cli.thrusters.where import bins_of, gap_against, variables

LABEL = {"n": "Control signal n", "voltage": "Supply voltage", "run-order": "Run order"}
BEFORE, AFTER = COLOURS["vermilion"], COLOURS["blue"]


@house_style
def where_figure(result: ThrusterDiagnosis) -> Figure:
    """The gap of the map as it was against every variable: bins with their spread, regions that stand out shaded."""
    base = result.base
    against = variables(base.data)
    figure, axes = new_figure(len(against), 1, PAGE_IN * 0.8, 2.3 * len(against) + 0.2)
    for panel, (name, (values, unit)) in zip(axes[:, 0], against.items()):
        marked = [region for region in result.where if region.variable == name]
        for index, region in enumerate(marked):
            pad = 0.02 * np.ptp(values) if region.low == region.high else 0.0
            label = "significant" if index == 0 else "_"
            panel.axvspan(region.low - pad, region.high + pad, color=COLOURS["yellow"], alpha=0.45, lw=0, label=label)
        panel.axhline(0.0, color="0.5", linewidth=0.6)
        panel.axhspan(-2 * result.gap.floor, 2 * result.gap.floor, color="0.8", lw=0, label="± 2 × noise level")
        rest = gap_against(base, name)
        panel.plot(values, rest, "o", color=COLOURS["grey"], markersize=2.0, alpha=0.5, label="a level")
        _binned(panel, values, rest)
        shown = "" if unit == "reading" else f" [{unit}]"
        panel.set_xlabel(f"{LABEL[name]}{shown}")
        panel.set_ylabel("Measured − map [N]" if name == "n" else "Pulls more than the map [N]")
    legend(axes[0, 0], loc="best", ncols=2)
    figure.suptitle(f"Where the {result.given.form} map is wrong: {_percent(result, result.gap.before)} of full scale")
    return figure


def _binned(axes: Axes, values: np.ndarray, rest: np.ndarray) -> None:
    """Mean of each bin with two standard errors."""
    place = bins_of(values)
    members = [np.flatnonzero(place == number) for number in np.unique(place)]
    centre = [float(np.mean(values[index])) for index in members]
    mean = [float(np.mean(rest[index])) for index in members]
    error = [
        2.0 * float(np.std(rest[index], ddof=1) / np.sqrt(len(index))) if len(index) > 1 else 0.0 for index in members
    ]
    style: dict[str, Any] = {"color": COLOURS["black"], "markersize": 4.0, "capsize": 2.0, "linewidth": 0.8}
    axes.errorbar(centre, mean, yerr=error, fmt="o-", label="mean of a bin ± 2 standard errors", **style)


@house_style
def why_figure(result: ThrusterDiagnosis) -> Figure:
    """Evidence of every candidate against chance, look by look; and the gap with the curve of what is named."""
    looks = [look for look in result.search.rounds if look.trials]
    figure, axes = new_figure(1, 2, PAGE_IN, 3.6, width_ratios=(1.15, 1.0))
    _evidence(axes[0, 0], result, looks)
    panel, base = axes[0, 1], result.base
    along = np.linspace(base.data.points.n.min(), base.data.points.n.max(), 601)
    panel.axhline(0.0, color="0.5", linewidth=0.6)
    order = np.argsort(base.data.points.n, kind="stable")
    gain = base.gain(base.data)
    n = base.data.points.n
    rest = (base.residual / gain)[order]
    panel.plot(n[order], rest, "o", color=COLOURS["grey"], markersize=2.5, label="measured − map")
    if result.effects:
        extra = np.nan_to_num(result.final.along(along) - base.along(along))
        panel.plot(along, extra, color=AFTER, label="what the named effects add")
    panel.set_xlabel(f"Control signal n [{result.data.n_unit or 'as logged'}]")
    panel.set_ylabel("Gap of the map as it was [N]")
    volts = f" (curve at {result.final.reference:.3g} V)" if result.final.shape.voltage else ""
    panel.set_title(f"The shape of the gap{volts}")
    legend(panel, loc="best")
    return figure


def _evidence(axes: Axes, result: ThrusterDiagnosis, looks: list) -> None:
    """One bar a candidate of each look, as a ratio to what chance reaches."""
    labels, widths, colours = [], [], []
    for number, look in enumerate(looks):
        best: dict[str, tuple[float, bool]] = {}
        for trial in look.trials:
            taken = look.taken is not None and trial.effect == look.taken.effect
            old = best.get(trial.effect, (-np.inf, False))
            best[trial.effect] = (max(old[0], trial.evidence), taken)
        for effect, (evidence, taken) in best.items():
            labels.append(f"{effect} ({number + 1})")
            widths.append(max(evidence, 0.0) / max(look.scores.least_evidence, 1.0))
            colours.append(AFTER if taken else COLOURS["grey"])
    place = np.arange(len(labels))
    axes.barh(place, widths, color=colours, height=0.7)
    axes.axvline(1.0, color=BEFORE, linestyle=(0, (5, 1.5)), label="threshold (1 in 100 by chance)")
    axes.set_yticks(place, labels)
    axes.set_ylim(-0.6, len(labels) + 1.4)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(0.0, 2.0 * max([1.0, *widths]))
    axes.set_xlabel("Evidence over significance threshold")
    axes.set_title("Candidates, look by look (blue: taken)")
    axes.grid(visible=False, axis="y")
    legend(axes, loc="lower right")


@house_style
def before_after_figure(result: ThrusterDiagnosis) -> Figure:
    """Thrust with both maps, and their errors on equal axes, on levels fitted and held out."""
    figure, axes = new_figure(3, 1, PAGE_IN * 0.8, 6.6, sharex=True, height_ratios=(1.8, 1.0, 1.0))
    thrust, before, after = axes[:, 0]
    fitted, held = result.base.data, result.held_out
    _points(thrust, fitted, fitted.points.force, "levels fitted", hollow=False)
    if held is not None:
        _points(thrust, held, held.points.force, "levels held out", hollow=True)
    along = np.linspace(result.data.points.n.min(), result.data.points.n.max(), 801)
    volts = f" at {result.final.reference:.3g} V" if result.final.shape.voltage else ""
    thrust.plot(along, result.base.along(along), color=BEFORE, linestyle=(0, (5, 1.5)), label="before")
    thrust.plot(along, result.final.along(along), color=AFTER, label=f"after{volts}")
    thrust.set_ylabel("Thrust of one thruster [N]")
    legend(thrust, loc="upper left")
    largest = max(_errors(panel, result, found, colour) for panel, found, colour in (
        (before, result.base, BEFORE), (after, result.final, AFTER)))  # fmt: skip
    for panel, word, gap in ((before, "before", result.gap.before), (after, "after", result.gap.after)):
        panel.set_ylim(-1.1 * largest, 1.1 * largest)
        panel.set_ylabel("Error [N]")
        panel.set_title(f"{word}: {gap:.3g} N = {_percent(result, gap)} of full scale", loc="left")
    after.set_xlabel(f"Control signal n [{result.data.n_unit or 'as logged'}]")
    return figure


def _errors(axes: Axes, result: ThrusterDiagnosis, found: Fitted, colour: str) -> float:
    """Residuals of one map; returns the largest [N]."""
    axes.axhspan(-2 * result.gap.floor, 2 * result.gap.floor, color="0.85", lw=0)
    axes.axhline(0.0, color="0.5", linewidth=0.6)
    largest = 0.0
    for data, hollow in ((result.base.data, False), (result.held_out, True)):
        if data is None:
            continue
        rest = data.points.force - found.thrust(data)
        _points(axes, data, rest, "_", hollow=hollow, colour=colour)
        largest = max(largest, float(np.max(np.abs(rest))))
    return largest or 1.0


def _points(
    axes: Axes, data: BollardData, values: np.ndarray, label: str, *, hollow: bool, colour: str = COLOURS["black"]
) -> None:
    style: dict[str, Any] = {"color": colour, "markeredgewidth": 0.7, "zorder": 3 if hollow else 2}
    size, face = 2.0 if len(data.points) > 60 else 3.5, "none" if hollow else colour
    axes.plot(data.points.n, values, "o", markerfacecolor=face, markersize=size + hollow, label=label, **style)
    flagged = data.points.flag != ""
    if np.any(flagged):
        n, own = data.points.n[flagged], values[flagged]
        axes.plot(n, own, "x", color=COLOURS["purple"], markersize=6.0, zorder=4)


def _percent(result: ThrusterDiagnosis, value: float) -> str:
    return f"{result.percent(value):.2g} %"
