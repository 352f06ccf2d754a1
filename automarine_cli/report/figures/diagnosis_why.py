"""Why: the evidence of every candidate, and the naming key."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.naming_key import NamingKey
from automarine_cli.diagnosis.trials import LEVEL
from automarine_cli.diagnosis.verdict import SUSPECTED
from automarine_cli.dofs import Dof
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.diagnosis_words import AFTER, BEFORE, verdict
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, new_figure


@house_style
def why_figure(diagnosis: Diagnosis, key: NamingKey | None) -> Figure:
    """Evidence of every candidate in the first round against the threshold, and the naming key, if there is one."""
    count = len(diagnosis.found.rounds[0].trials)
    if diagnosis.study.driven:  # no steps, and no naming key
        return _evidence_alone(diagnosis, count)
    figure, grid = new_figure(2, 2, PAGE_IN, max(4.2, 0.17 * count + 1.2), width_ratios=(1.25, 1.0))
    place = grid[0, 0].get_gridspec()
    for axes in grid[:, 0]:
        axes.remove()
    _evidence(figure.add_subplot(place[:, 0]), diagnosis)
    _drifts(grid[0, 1], grid[1, 1], key, diagnosis.study.base.dof, bool(diagnosis.found.final.added))
    handles = [*_handles(diagnosis), *grid[0, 1].get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    figure.suptitle(f"Which missing effect would explain the gap. Verdict: {verdict(diagnosis)}")
    return figure


def _evidence_alone(diagnosis: Diagnosis, count: int) -> Figure:
    """The evidence of every candidate on driven runs."""
    figure, grid = new_figure(1, 1, PAGE_IN, max(3.2, 0.17 * count + 1.2))
    _evidence(grid[0, 0], diagnosis)
    figure.legend(handles=_handles(diagnosis), loc="outside lower center", ncols=4)
    figure.suptitle(
        f"Which missing effect would explain the innovations of driven runs.\nVerdict: {verdict(diagnosis)}"
    )
    return figure


def _handles(diagnosis: Diagnosis) -> list[Any]:
    """What the colours of the bars mean, and the threshold."""
    chance = f"threshold ({1000 * LEVEL:.0f} in 1000 by chance)"
    return [
        Patch(color=AFTER, label="suspected" if diagnosis.verdict == SUSPECTED else "named"),
        Patch(color=COLOURS["sky"], label="rival not excluded"),
        Patch(color="0.72", label="not needed"),
        Line2D([], [], linestyle="--", color=BEFORE, label=chance),
    ]


def _evidence(axes: Axes, diagnosis: Diagnosis) -> None:
    """Horizontal bars, best on top, on a scale that is linear up to the threshold and logarithmic beyond."""
    found, first = diagnosis.found, diagnosis.found.rounds[0]
    trials = sorted(first.trials, key=first.gain)
    gains = np.array([first.gain(trial) for trial in trials])
    names = [trial.added[-1] for trial in trials]
    rivals = {rival.name for rival in found.rivals}
    colours = [AFTER if name in found.final.added else COLOURS["sky"] if name in rivals else "0.72" for name in names]
    axes.barh(np.arange(len(trials)), gains, color=colours, height=0.72)
    axes.axvline(first.threshold, color=BEFORE, linewidth=1.2, linestyle="--")
    axes.axvline(0.0, color="0.3", linewidth=0.6)
    axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    most = max(2.5 * float(gains.max(initial=0.0)), 20.0)
    low = min(float(gains.min(initial=0.0)), 0.0)
    axes.set_xlim(1.2 * low - 1.0, most)
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if 1.2 * low - 1.0 <= tick <= most]
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yticks(np.arange(len(trials)), names)
    for label, name in zip(axes.get_yticklabels(), names):
        label.set_fontweight("bold" if name in found.final.added else "normal")
    for at, gain in enumerate(gains):
        if gain > 0.4 * first.threshold:
            axes.annotate(f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5)
    axes.set_xlabel("evidence gained over the base model [deviance]")
    axes.grid(False, axis="y")
    axes.margins(y=0.01)


def _drifts(top: Axes, bottom: Axes, key: NamingKey | None, dof: Dof, named: bool) -> None:
    """Both drifts of the naming key, one above the other."""
    if key is None:
        for axes in (top, bottom):
            axes.set_axis_off()
        top.set_title("the naming key could not be computed", fontsize=7)
        return
    _key(top, dof, key, "k", "drag over thrust, k", key.log_k, key.log_k_error, key.predicted_k, named)
    _key(bottom, dof, key, "I/k", f"{dof.words.inertia} over drag, I / k", key.log_ratio, key.log_ratio_error,
         key.predicted_ratio, named)  # fmt: skip
    bottom.set_xlabel(f"size of the {dof.words.force} [{key.unit}]")


def _key(
    axes: Axes,
    dof: Dof,
    key: NamingKey,
    quantity: str,
    title: str,
    log: Floats,
    error: Floats,
    predicted: Floats,
    named: bool,
) -> None:
    """One drift: every run's own value against the size of its moment, with what the final model predicts."""
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    have = np.isfinite(key.moment)
    there, back = dof.words.to_ways
    for side, marker, colour, name in ((1, ">", COLOURS["green"], there), (-1, "<", COLOURS["vermilion"], back)):
        here = have & (np.sign(key.moment) == side)
        axes.errorbar(
            np.abs(key.moment[here]), 100 * log[here], 200 * error[here], fmt=marker, color=colour, markersize=3.5,
            elinewidth=0.5, alpha=0.75, label=f"runs {name}", zorder=2,
        )  # fmt: skip
        if named and here.any():
            sizes = np.unique(np.round(np.abs(key.moment[here]), 9))
            at = [here & np.isclose(np.abs(key.moment), size) for size in sizes]
            curve = [np.average(predicted[these], weights=1.0 / (error[these] ** 2 + 1e-8)) for these in at]
            label = "final model predicts" if side == 1 else None
            axes.plot(sizes, 100 * np.array(curve), "-", color=AFTER, linewidth=1.6, alpha=0.9, label=label, zorder=3)
    best = key.best(quantity)
    force = dof.words.force
    note = f"no drift with the {force} beyond chance"
    if best is not None and best.p_value < 0.01:
        note = textwrap.fill(f"drifts as |{force}|^{best.power:g}, {best.parity}: {best.means}", 52)
    axes.set_title(f"{title}\n{note}", fontsize=7)
    axes.set_ylabel("against the base fit [%]")
    values = 100 * np.concatenate([log[have], predicted[have] if named else np.zeros(0)])
    if len(values):
        low, high = np.quantile(values, [0.02, 0.98])
        margin = 0.25 * max(high - low, 2.0)
        axes.set_ylim(min(low, 0.0) - margin, max(high, 0.0) + margin)
