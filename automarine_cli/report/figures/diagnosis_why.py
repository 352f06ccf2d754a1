"""Why: the evidence of every candidate."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.search import LEVEL
from automarine_cli.diagnosis.verdict import SUSPECTED
from automarine_cli.report.figures.diagnosis_words import AFTER, BEFORE
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, new_figure


@house_style
def why_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the evidence of every candidate in the first round against the threshold."""
    figure, grid = new_figure(1, 1, PAGE_IN, max(3.2, 0.17 * len(diagnosis.found.rounds[0].trials) + 1.2))
    found, first = diagnosis.found, diagnosis.found.rounds[0]
    gains = {trial.added[-1]: first.gain(trial) for trial in first.trials}
    rivals = {rival.name for rival in found.rivals}
    evidence_bars(grid[0, 0], gains, first.threshold, found.final.added, rivals)
    figure.legend(handles=_handles(diagnosis), loc="outside lower center", ncols=4)
    what = "the innovations of driven runs" if diagnosis.study.driven else "the gap"
    figure.suptitle(f"Which missing effect would explain {what}.\nVerdict: {diagnosis.words}")
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


def evidence_bars(
    axes: Axes, gain_of: Mapping[str, float], threshold: float, named: Collection[str], rivals: Collection[str]
) -> None:
    """Draw horizontal bars, best on top, on a scale that is linear up to the threshold and logarithmic beyond."""
    names = sorted(gain_of, key=lambda name: gain_of[name])
    gains = np.array([gain_of[name] for name in names])
    colours = [AFTER if name in named else COLOURS["sky"] if name in rivals else "0.72" for name in names]
    axes.barh(np.arange(len(names)), gains, color=colours, height=0.72)
    axes.axvline(threshold, color=BEFORE, linewidth=1.2, linestyle="--")
    axes.axvline(0.0, color="0.3", linewidth=0.6)
    axes.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    most = max(2.5 * float(gains.max(initial=0.0)), 20.0)
    low = min(float(gains.min(initial=0.0)), 0.0)
    axes.set_xlim(1.2 * low - 1.0, most)
    ticks = [tick for tick in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if 1.2 * low - 1.0 <= tick <= most]
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yticks(np.arange(len(names)), names)
    for label, name in zip(axes.get_yticklabels(), names):
        label.set_fontweight("bold" if name in named else "normal")
    for at, gain in enumerate(gains):
        if gain > 0.4 * threshold:
            axes.annotate(f"{gain:.0f}", (gain, at), (3, 0), textcoords="offset points", va="center", fontsize=6.5)
    axes.set_xlabel("evidence gained over the base model [deviance]")
    axes.grid(False, axis="y")
    axes.margins(y=0.01)
