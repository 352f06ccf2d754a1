"""The figure of `plan`: precision against minutes in the pool."""

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from automarine_cli.planning.campaign import Campaign
from automarine_cli.planning.candidates import KINDS
from automarine_cli.report.figures.style import COLOURS, house_style, legend_below, panels

MOST_PANELS = 4
NARROW = 5.0  # highest over lowest value up to which even ticks suit a logarithmic axis
TICKS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
FEWEST_RUNS = 3  # below which a curve is not drawn: nothing is known yet
MARKS = dict(zip(KINDS, "os^DvxP"))


@house_style
def plan_figure(campaign: Campaign) -> Figure:
    """Draw a panel for each parameter: the plan run by run, the paper's grid, and one run more of each kind."""
    names, dof = list(campaign.plan.stderr_percent)[:MOST_PANELS], campaign.fitting.model.dof
    own, length = dof.symbols, dof.words.inertial_length
    math = {own.quadratic: own.quadratic_math, own.linear: own.linear, own.inertia: own.inertia}
    math[length] = f"{own.inertia}/{own.quadratic_math}"
    figure, axes = panels(len(names), 3 if len(names) <= 3 else 2, 2.2, 0.6, sharex=True)
    for ax, name in zip(axes.flat, names):
        for curve, colour, line in ((campaign.plan, "blue", "-"), (campaign.grid, "orange", (0, (5, 1.5)))):
            minutes, percent = curve.minutes[FEWEST_RUNS - 1 :], curve.stderr_percent[name][FEWEST_RUNS - 1 :]
            ax.plot(minutes, percent, color=COLOURS[colour], ls=line, marker=".", ms=3, label=curve.campaign)
        for curve in campaign.more:
            mark, label = MARKS[curve.campaign], f"plan and one {curve.campaign}"
            look = {"color": COLOURS["vermilion"], "mfc": "none" if mark != "x" else None, "label": label}
            ax.plot(curve.minutes, curve.stderr_percent[name], ls="", marker=mark, ms=4, **look)
        ax.set_yscale("log")
        low, high = ax.get_ylim()
        ax.yaxis.set_major_locator(MaxNLocator(5) if high < NARROW * low else LogLocator(subs=TICKS))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_title(f"${math[name]}$" if name in math else name.replace("_", " "), loc="left")
        ax.set_ylabel("standard error [%]")
    for ax in axes.flat[max(0, len(names) - axes.shape[1]) : len(names)]:
        ax.set_xlabel("minutes in the pool")
        ax.tick_params(labelbottom=True)
    legend_below(figure, axes.flat[0], ncols=4)
    return figure
