"""Figures of `plan`, precision against minutes in the pool, and of `tune`: step and load with the bands of present and
new gains, and steps as they were flown."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from automarine_cli.dofs import Dof
from automarine_cli.planning.campaign import Plan
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, legend_below, new_figure, panels

if TYPE_CHECKING:  # a plan needs no controllers
    from automarine_cli.control.tuning import FlownStep, Tuning

MAX_PANELS = 4
MIN_WIDTH_RATIO = 1.1  # how many times wider intervals would be
MIN_RUNS_DRAWN = 3  # below which a curve is not drawn: nothing is known yet
GAIN_LOOKS = {"present": ("orange", (0, (5, 1.5))), "new": ("blue", "-")}
MAX_STEPS_DRAWN = 4
MAX_RUNAWAY_STEPS = 3.0  # steps beyond which a flight that runs away is not followed


@house_style
def plan_figure(plan: Plan) -> Figure:
    """Draw a panel for each parameter, run by run."""
    names, minutes = list(plan.errors)[:MAX_PANELS], plan.minutes
    figure, axes = panels(len(names), 3 if len(names) <= 3 else 2, 2.2, 0.6)
    half = int(np.searchsorted(minutes, 0.5 * minutes[-1]))
    wider = max(plan.errors[name][half] / plan.errors[name][-1] for name in names)
    advice = "Play the whole plan" if wider > MIN_WIDTH_RATIO else "Half of the plan is enough"
    time = f"after {minutes[half]:.0f} of {minutes[-1]:.0f} minutes"
    figure.suptitle(f"{advice}: {time} intervals are up to {wider:.2g} times as wide")
    for ax, name in zip(axes.flat, names):
        percent, drawn = plan.errors[name], slice(MIN_RUNS_DRAWN - 1, None)
        ax.plot(minutes[drawn], percent[drawn], color=COLOURS["blue"], marker="o", markevery=[-1])
        ax.set_title(f"{name}: {percent[-1]:.2g} %", loc="left", parse_math=False)
        ax.set(xlabel="minutes in the pool", ylabel="standard error [%]", ylim=(0.0, None))
    return figure


@house_style
def tuning_figure(tuning: "Tuning") -> Figure:
    """Draw what follows a step, and a load from the start, all over the crowd."""
    figure, axes = new_figure(1, 2, PAGE_IN, 2.7)
    dof, task = tuning.nominal.dof, tuning.task
    way = dof.shown(task.step)
    outcomes = {name: of for name, of in (("new", tuning.new), ("present", tuning.old)) if of is not None}
    step, load = list[str](), list[str]()
    for of in outcomes.values():
        figures = of.margins.disk, of.scores.settling, dof.shown(of.scores.error), dof.shown(of.scores.left)
        disk, time, most, left = (float(np.quantile(x, 0.5, method="inverted_cdf")) for x in figures)
        settles = f"settles after {time:.3g} s" if np.isfinite(time) else "never settles"
        step.append(f"disk margin {disk:.2g}, {settles}")
        load.append(f"up to {most:.3g}{dof.units.mark}, {left:.2g}{dof.units.mark} left")
    load[0] += f" after {task.recovery:g} s"
    titles = ["\nbefore: ".join(words) for words in (step, load)]
    for i, title in enumerate((titles[0][0].upper() + titles[0][1:], f"{100 * task.load:g} % load: {titles[1]}")):
        for name, outcome in outcomes.items():
            (colour, line), clock, reach = GAIN_LOOKS[name], outcome.flight.time, MAX_RUNAWAY_STEPS * way
            flown = np.clip(np.nan_to_num(dof.shown(outcome.flight.position[:, i]), nan=reach), -reach, reach)
            low, middle, high = np.quantile(flown, [0.025, 0.5, 0.975], axis=0)
            label = f"{name}, 95 %"
            axes[0, i].fill_between(clock, low, high, color=COLOURS[colour], alpha=0.25, lw=0, label=label)
            axes[0, i].plot(clock, middle, color=COLOURS[colour], ls=line, lw=1.0, label=f"{name}, median")
        axes[0, i].set_title(title, loc="left")
        position = f"{dof.words.position.capitalize()} [{dof.units.shown}]"
        axes[0, i].set(xlim=(0.0, task.recovery), xlabel="Time [s]", ylabel=position)
    axes[0, 0].axhline(way, color="0.4", lw=0.6, ls=":")
    legend_below(figure, axes[0, 0], ncols=4)
    return figure


@house_style
def flown_figure(steps: Sequence["FlownStep"], dof: Dof) -> Figure:
    """Draw the first steps of a log as flown, and the bands that were promised."""
    drawn = steps[:MAX_STEPS_DRAWN]
    figure, axes = new_figure(1, len(drawn), PAGE_IN, 2.6)
    for ax, step in zip(axes[0], drawn):
        low, high = dof.shown(step.low), dof.shown(step.high)
        ax.fill_between(step.time, low, high, color=COLOURS["sky"], alpha=0.6, lw=1.0, label="promised, 95 %")
        ax.plot(step.time, dof.shown(step.position), ".", color=COLOURS["black"], ms=1.5, label="flown")
        ax.plot(step.time, dof.shown(step.reference), color="0.4", lw=0.6, ls=":")
        held = "as promised" if step.held else "not as promised"
        ax.set_title(f"{step.run}, {step.begins:.0f} s\n{held}", loc="left", parse_math=False)
        ax.set_xlabel("Time [s]")
    axes[0, 0].set_ylabel(f"{dof.words.position.capitalize()} [{dof.units.shown}]")
    axes[0, 0].legend(loc="lower right")
    return figure
