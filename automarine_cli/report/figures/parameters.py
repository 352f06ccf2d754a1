"""Figures of parameters: what a fit leaves, and how its parameters hang together; thrust and map of `fit-thrusters`,
results of `compare`, precision against minutes in the pool of `plan`, step and load with the bands of present and new
gains of `tune`."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from automarine_cli.comparison.side_by_side import ComparedResult, Difference
from automarine_cli.dofs import Dof
from automarine_cli.estimate import Estimate
from automarine_cli.fits.characteristics import autocorrelation, correlations, standardised_residuals
from automarine_cli.fits.driven import Judgement
from automarine_cli.fits.steps import StepData
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.planning.campaign import Plan
from automarine_cli.report.figures import style
from automarine_cli.report.figures.style import COLOURS, PAGE_IN, house_style, new_figure, shortened
from automarine_cli.report.tables import in_math, interval, number
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.curves import SplineCurve
from automarine_cli.thrusters.map import SIDES
from automarine_cli.thrusters.result import ThrusterFit

if TYPE_CHECKING:  # a plan needs no controllers
    from automarine_cli.control.tuning import FlownStep, Tuning

MAX_RESULT_NAME, WIDEST_LABEL = 28, 40  # letters that have room beside and below a panel
MAX_PANELS = 4
MAX_WRITTEN, MAX_LARGE, MAX_LABEL = 9, 4, 16  # parameters whose correlations are written, in large; letters of a name
MAX_LAGS, MAX_POINTS_DRAWN, MAX_RESIDUAL = 40, 4000, 5.0  # samples; of residuals over time; in units of the noise
MIN_WIDTH_RATIO = 1.1  # how many times wider intervals would be
MIN_RUNS_DRAWN = 3  # below which a curve is not drawn: nothing is known yet
GAIN_LOOKS = {"present": ("orange", (0, (5, 1.5))), "new": ("blue", "-")}
MAX_STEPS_DRAWN = 4
MAX_RUNAWAY_STEPS = 3.0  # steps beyond which a flight that runs away is not followed


@house_style
def thruster_figure(result: ThrusterFit) -> Figure:
    """Draw thrust and residuals of one thruster against its control signal, coloured by voltage, and the map."""
    points, pooled, good = result.points, result.analysis, result.points.flag == ""
    unit = {"us": "µs"}.get(pooled.n_unit, pooled.n_unit) or "unit as logged"
    labels = f"Control signal n [{unit}]", "Thrust of one thruster [N]", "Measured − fitted [N]"
    figure, thrust, residuals = style.above_residuals(PAGE_IN * 0.8, 5.6, labels)
    thrust.axhline(0.0, color="0.6", lw=0.6)
    n, force, spread = points.n[good], points.force[good], np.nan_to_num(points.spread[good])
    look = {"yerr": spread, "label": "measured ± standard deviation"} if spread.any() else {"label": "measured"}
    thrust.errorbar(n, force, fmt="o", color=COLOURS["black"], ms=3.0, capsize=2.0, **look)
    if len(result.voltages) > 1:
        coloured = thrust.scatter(n, force, c=points.voltage[good], cmap="cividis", s=9.0, zorder=3)
        figure.colorbar(coloured, ax=[thrust, residuals], label="Supply voltage [V]", pad=0.01)
    if not np.all(good):
        outlier = points.n[~good], points.force[~good]
        thrust.plot(*outlier, "x", color=COLOURS["vermilion"], ms=6.0, label="outlier from its neighbours")
    laws = {side[0]: law for side, law in pooled.square.items() if law is not None}
    sizes = "".join(f"\n$a_{name}$ {interval(law)} {law.unit.replace('us', 'µs')}" for name, law in laws.items())
    chosen, along = pooled.chosen.form.name, np.linspace(min(0.0, *n), max(0.0, *n), 801)
    law, where = ("", " at levels left out") if pooled.chosen.form.interpolates else (" law", "")
    for square in (True, False) if chosen != "square" else (False,):
        fit = pooled.law if square else pooled.chosen
        colour = COLOURS["vermilion" if square else "blue"]
        label, line = ("square law", "--") if square else (f"chosen: {chosen}{law}", "-")
        label += sizes if square or chosen == "square" else ""
        thrust.plot(along, fit.along(along), color=colour, ls=line, label=label, zorder=3)
        residuals.plot(n, force - fit.along(n), "o", color=colour, mfc="none" if square else colour)
    for side, sign in SIDES:
        if isinstance(curve := pooled.chosen.curves.get(side), SplineCurve):
            values = pooled.chosen.estimates[side].values()
            low, high = sign * np.array([value.ci95 for value in values if isinstance(value, Estimate)]).T
            thrust.fill_between(sign * np.array(curve.n[1:]), low, high, color=COLOURS["blue"], alpha=0.25, lw=0)
    error = number(pooled.percent(pooled.chosen.error), 2)
    title = f"{chosen.capitalize()}{law}: error {error} % of full scale{where}, R² {pooled.r2(pooled.chosen):.4f}"
    thrust.set_title(title, loc="left")
    thrust.legend(loc="upper left")
    return figure


@house_style
def residuals_figure(
    fit: OutputErrorFit, runs: Sequence[Run], data: StepData | None = None, use: Judgement | None = None
) -> Figure:
    """Draw the residuals of a fit over time, their autocorrelation and distribution, and the correlation of the
    parameters; see `standardised_residuals`."""
    residuals = [(time, left) for time, left in standardised_residuals(fit, runs, data, use) if len(left) > 1]
    names, matrix = correlations(fit)
    figure, axes = new_figure(2, 2, PAGE_IN, 5.4)
    (over_time, lagged), (spread, pairs) = axes
    left = np.concatenate([values for _, values in residuals] or [np.zeros(0)])
    said = list[str]()
    if len(left):
        clock = np.concatenate([time for time, _ in residuals])
        some = slice(None, None, -(-len(left) // MAX_POINTS_DRAWN))
        over_time.axhspan(-2.0, 2.0, color="0.92", lw=0, zorder=0)
        over_time.plot(clock[some], left[some], ".", color=COLOURS["blue"], ms=1.5, mew=0.0)
        shortest = min(len(values) for _, values in residuals)
        lags = np.arange(1, min(MAX_LAGS, shortest - 1) + 1)
        interval_s = float(np.median(np.concatenate([np.diff(time) for time, _ in residuals])))
        acf = autocorrelation([values for _, values in residuals], len(lags))
        band = 1.96 / np.sqrt(len(left))
        lagged.axhspan(-band, band, color="0.88", lw=0, zorder=0, label="95 % of white noise")
        lagged.vlines(lags * interval_s, 0.0, acf, color=COLOURS["blue"], lw=1.2, label="residuals")
        lagged.axhline(0.0, color="0.4", lw=0.6)
        lagged.set_ylim(min(-0.3, 1.1 * float(acf.min())), max(0.5, 1.1 * float(acf.max())))
        lagged.legend(loc="upper right")
        edges = np.linspace(-MAX_RESIDUAL, MAX_RESIDUAL, 51)
        shown = np.clip(left, -MAX_RESIDUAL, MAX_RESIDUAL)
        spread.hist(shown, edges, density=True, color=COLOURS["sky"], label="residuals")
        normal = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
        spread.plot(edges, normal, color=COLOURS["black"], lw=1.0, label="normal")
        spread.legend(loc="upper right")
        said.append(f"residuals {np.sqrt(np.mean(left**2)):.2f} times the noise, neighbours correlate by {acf[0]:.2f}")
    over_time.set(title="Residuals over time", xlabel="Time [s]", ylabel="Residual [× noise]")
    lagged.set(title="Autocorrelation", xlabel="Lag [s]", ylabel="Correlation [1]")
    spread.set(
        title="Distribution; the outermost bars hold all beyond", xlabel="Residual [× noise]", ylabel="Density [1]"
    )
    drawn = pairs.imshow(matrix, cmap="PuOr", vmin=-1.0, vmax=1.0)
    short = (shortened(name.rpartition(".")[2], MAX_LABEL) for name in names)
    labels = ["delay" if name == COMMAND_DELAY else in_math(label) for name, label in zip(names, short)]
    pairs.set_xticks(range(len(names)), labels, rotation=90)
    pairs.set_yticks(range(len(names)), labels)
    pairs.grid(visible=False)
    pairs.set_title("Correlation of the parameters' errors")
    if len(names) <= MAX_WRITTEN:
        for i, j in np.ndindex(matrix.shape):
            light = np.dot(drawn.to_rgba(matrix[i, j])[:3], (0.299, 0.587, 0.114))  # Rec. 601
            size, ink = 8.0 if len(names) <= MAX_LARGE else 5.5, "white" if light < 0.5 else "black"
            pairs.text(j, i, f"{matrix[i, j]:.2f}", ha="center", va="center", fontsize=size, color=ink)
    figure.colorbar(drawn, ax=pairs, label="Correlation [1]")
    if len(names) > 1:
        i, j = np.unravel_index(np.argmax(np.abs(np.triu(matrix, 1))), matrix.shape)
        said.append(f"{labels[i]} and {labels[j]} correlate by {matrix[i, j]:.2f}")
    title = "; ".join(said) or "one parameter"
    figure.suptitle(f"{title[0].upper()}{title[1:]}")
    return figure


@house_style
def compare_figure(sides: Sequence[ComparedResult], differences: Sequence[Difference]) -> Figure:
    """Draw a panel for each parameter; the interval of the first result goes on as a band."""
    names = list(dict.fromkeys(name for side in sides for name in side.parameters))
    figure, axes = style.panels(len(names), 3, 0.75 + 0.32 * len(sides), 0.0, sharey=True)
    for ax, name in zip(axes.flat, names):
        apart = {difference.of: difference for difference in differences if difference.parameter == name}
        for i, side in enumerate(sides):
            if (estimate := side.parameters.get(name)) is None:
                continue
            ax.plot(estimate.ci95, [i, i], color=COLOURS["blue"], lw=1.6)
            ax.plot([estimate.value], [i], "o", color=COLOURS["blue"], ms=5)
            if i == 0:
                ax.axvspan(*estimate.ci95, color="0.92", lw=0, zorder=0)
            if (verdict := apart.get(side.name)) is not None:
                says = f"{verdict.verdict}, p = {number(verdict.p_value, 2)}"
                look = {"ha": "center", "va": "bottom", "fontsize": 7, "transform": ax.get_yaxis_transform()}
                ax.text(0.5, i - 0.22, says, **look)
            ax.set_xlabel(fill(in_math(f"{name} [{estimate.unit}]".removesuffix(" [1]")), WIDEST_LABEL))
        ax.grid(visible=False, axis="y")
    for ax in axes[:, 0]:
        ax.set_yticks(range(len(sides)), [shortened(side.name, MAX_RESULT_NAME) for side in sides], parse_math=False)
        ax.set_ylim(len(sides) - 0.4, -0.6)
    return figure


@house_style
def plan_figure(plan: Plan) -> Figure:
    """Draw a panel for each parameter, run by run."""
    names, minutes = list(plan.errors)[:MAX_PANELS], plan.minutes
    figure, axes = style.panels(len(names), 3 if len(names) <= 3 else 2, 2.2, 0.6)
    half = int(np.searchsorted(minutes, 0.5 * minutes[-1]))
    wider = max(plan.errors[name][half] / plan.errors[name][-1] for name in names)
    advice = "Play the whole plan" if wider > MIN_WIDTH_RATIO else "Half of the plan is enough"
    time = f"after {minutes[half]:.0f} of {minutes[-1]:.0f} minutes"
    figure.suptitle(f"{advice}: {time} intervals are up to {wider:.2g} times as wide")
    for ax, name in zip(axes.flat, names):
        percent, drawn = plan.errors[name], slice(MIN_RUNS_DRAWN - 1, None)
        ax.plot(minutes[drawn], percent[drawn], color=COLOURS["blue"], marker="o", markevery=[-1])
        ax.set_title(in_math(f"{name}: {percent[-1]:.2g} %"), loc="left")
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
            axes[0, i].fill_between(clock, low, high, color=COLOURS[colour], alpha=0.25, lw=0, label=f"{name}, 95 %")
            axes[0, i].plot(clock, middle, color=COLOURS[colour], ls=line, lw=1.0, label=f"{name}, median")
        axes[0, i].set_title(title, loc="left")
        position = f"{dof.words.position.capitalize()} [{dof.units.shown}]"
        axes[0, i].set(xlim=(0.0, task.recovery), xlabel="Time [s]", ylabel=position)
    axes[0, 0].axhline(way, color="0.4", lw=0.6, ls=":")
    style.legend_below(figure, axes[0, 0], ncols=4)
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
