"""`make pictures`: the figures of the README and its pages, made by the tool from sample_runs, small enough for a page.

Usage: python tests/benchmarks/pictures.py [FOLDER]
"""

import io
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import peer_automarine
import peer_plain
from effect_families import families, picture_of
from made_runs import INERTIA, K_RR
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from peers_fit import write as write_campaign
from PIL import Image
from pool_day import ARM, write_pool_day
from repository import ROOT, SAMPLE_RUNS

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.validate import validate
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.dofs import SURGE, YAW, Dof
from automarine_cli.effects import Effect
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import follow, predict
from automarine_cli.fits.driven import base_starts, driven_problem
from automarine_cli.fits.identify import YawFit
from automarine_cli.fits.innovations import fit_innovations
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.report.figures.parameters import thruster_figure
from automarine_cli.report.figures.runs import drag_figure, half_turns_figure, inertia_figure, validation_figure
from automarine_cli.report.figures.style import COLOURS as PALETTE
from automarine_cli.report.figures.style import house_style, panels
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate
from automarine_cli.thrusters.map import parts_of

HIDDEN = SAMPLE_RUNS / "hidden_one"
VALIDATED = "there_and_back.csv"
PEERS = Path(__file__).with_name("peers.json")
DPI, COLOURS = 120, 128


def pictures(folder: Path) -> Iterator[tuple[str, Figure]]:
    """Each figure with its name; what is fitted on the way goes into `folder`."""
    yield "signs", signs_figure()
    for family, members in families().items():
        yield picture_of(family), gallery_figure(members)
    yield "thrusters", thruster_figure(fit_thrusters([SAMPLE_RUNS / "thrusters"], thrusters_per_test=2))

    # the campaign in which nothing is hidden: drag, inertia, one validation run
    fit = fit_yaw([SAMPLE_RUNS / "steps"], out=folder / "yaw")
    assert fit.velocity_error_fit is not None
    yield "drag", drag_figure(fit, fit.velocity_error_fit)
    yield "inertia", inertia_figure(fit, fit.velocity_error_fit)
    yield "validation", of_run(SAMPLE_RUNS / "validation" / VALIDATED, folder / "yaw" / "yaw_model.json")

    # the campaign with a hidden effect: a run before, where the gap is, why, and after
    model = folder / "hidden" / "yaw_model.json"
    fit_yaw([HIDDEN], fit_to="whole-runs", out=model.parent)
    before = of_run(HIDDEN / VALIDATED, model)
    yield "before", before
    result = diagnose([HIDDEN], model=model, out=folder / "diagnosis")
    for name in ("where", "why"):
        yield name, result.plot(name)
    yield "swirl", found_figure(result)
    after = of_run(HIDDEN / VALIDATED, folder / "diagnosis" / "extended_model.json")
    for same, ax in zip(before.axes[:2], after.axes):
        ax.set_ylim(same.get_ylim())
    yield "after", after

    # a real boat, and what thrust that scatters does to a plain script
    yield "forecasts", forecasts_figure()
    yield "real_fans", fans_figure(fit_yaw([REAL]))
    yield "scatter_intervals", intervals_figure()

    # a day in other people's columns: the thrusters' curve, and the half-turns that the moment made of it explains
    day, written, columns = write_pool_day(folder / "pool_day"), folder / "pool.toml", folder / "columns.toml"
    init(day, out=written)
    answered = written.read_text().replace('arm_m = "?"', f"arm_m = {ARM}").replace('per_test = "?"', "per_test = 1")
    columns.write_text(answered[answered.index("[columns]") : answered.index("[thrusters]")])
    thrusters = fit_thrusters([day / "bollard_T200.csv"], columns=columns)
    yield "pool_thrusters", thruster_figure(thrusters)
    fit = fit_yaw([day / "run_*.csv"], columns=columns, thrusters=thrusters, arm=ARM)
    yield "pool_half_turns", half_turns_figure(fit)


@house_style
def found_figure(result: Diagnosis) -> Figure:
    """Draw the run held out in which the first model is worst, with its own thrust, under the first and the final
    model, what both leave of it, and the evidence of effects."""
    assert result.held_out is not None and result.from_commands is not None
    runs, own, alone = result.held_out.runs, result.held_out.gap, result.from_commands
    worst = int(np.argmax([np.mean(errors**2) for errors in own.residuals[0]]))
    run = runs[worst]
    time, measured = run.time - run.time[0], np.rad2deg(run.position)
    figure = Figure((7.2, 4.4), layout="constrained")
    axes = figure.subplot_mosaic([["heading", "why"], ["error", "why"]], width_ratios=(1.9, 1.0), height_ratios=(2, 1))
    axes["heading"].plot(time, measured, label="measured", color="0.7", lw=3.5)
    looks = (("first model", PALETTE["orange"], "--"), ("with water-swirl", PALETTE["blue"], "-"))
    for residuals, (label, colour, line) in zip(own.residuals, looks):
        error = np.rad2deg(residuals[worst][: len(run)])
        axes["heading"].plot(time, measured - error, label=label, color=colour, ls=line, lw=1.4)
        axes["error"].plot(time, error, color=colour, ls=line, lw=1.2)
    axes["error"].axhline(0.0, color="0.4", lw=0.7)
    axes["heading"].set(ylabel="heading [deg]", title=f"Held-out run {run.name}, with its own thrust")
    axes["heading"].legend()
    axes["error"].set(xlabel="time in the run [s]", ylabel="error [deg]")
    best = sorted(result.candidates, key=lambda row: -float(str(row["gain"])))[:6][::-1]
    colours = [PALETTE["blue"] if row is best[-1] else "0.65" for row in best]
    axes["why"].barh([str(row["name"]) for row in best], [float(str(row["gain"])) for row in best], color=colours)
    axes["why"].axvline(result.threshold, color="0.2", ls="--", lw=1.0)
    axes["why"].set(xlabel="evidence (deviance)", title="Chance ends at the dashed line", xscale="log")
    before, after = np.rad2deg([own.before, own.after])
    figure.suptitle(
        f"It found the swirl. Error of {len(runs)} held-out runs: {before:.1f}° → {after:.1f}° with each run's own "
        f"thrust,\n{alone.before:.1f}° → {alone.after:.1f}° from the commands alone"
    )
    return figure


VEHICLES = {
    "kingfisher_lake": "lake boat", "heavy_rov_sea": "work ROV at sea", "cybership_enterprise": "model ship",
    "kvlcc2_zigzag": "model tanker", "vtec_usv_payload": "pool boat", "bolt_auv_pool": "pool AUV",
    "minerva_hil_simulated": "ROV, simulated",
}  # fmt: skip
PREDICTORS = {
    "tool": ("this tool", {"marker": "o", "color": PALETTE["blue"], "ms": 5}),
    "least_squares": (
        "least squares 5 s ahead", {"marker": "D", "color": PALETTE["vermilion"], "mfc": "none", "ms": 8, "mew": 1.2},
    ),
    "constant_rate": ("constant speed or turn rate", {"marker": "x", "color": "0.5", "ms": 6, "mew": 1.6}),
}  # fmt: skip
TICKS = (1, 2, 5, 10, 20, 50, 100)


@house_style
def forecasts_figure() -> Figure:
    """Draw errors 5 s ahead on measured logs as dots, a row for each vehicle and motion, in it the two halves."""
    every = json.loads(Path(__file__).with_name("forecasts.json").read_text(encoding="utf-8"))
    panels_of = {"heading": [row for row in every if row["motion"] == "yaw"]}
    panels_of["position"] = [row for row in every if row["motion"] != "yaw"]
    figure = Figure((5.6, 5.2), layout="constrained")
    axes = figure.subplots(2, 1, height_ratios=[len(rows) for rows in panels_of.values()])
    for ax, (quantity, rows) in zip(axes, panels_of.items()):
        places = [k // 2 + 0.36 * (k % 2) - 0.18 for k in range(len(rows))]
        for name, (label, look) in PREDICTORS.items():
            ax.plot([row[name][1] for row in rows], places, linestyle="none", label=label, **look)
        names = [", ".join((VEHICLES[row["set"]], *[row["motion"]] * (quantity != "heading"))) for row in rows[::2]]
        ax.set(xscale="log", ylim=(len(names) - 0.5, -0.5), yticks=range(len(names)), yticklabels=names)
        ax.set_xlabel(f"rms error of the {quantity} 5 s ahead [{rows[0]['unit']}]")
        low, high = ax.get_xlim()
        ax.set_xticks([tick for tick in TICKS if low < tick < high])
        ax.set_xticks([], minor=True)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.grid(axis="y", visible=False)
        for row in range(1, len(names)):
            ax.axhline(row - 0.5, color="0.88", linewidth=0.6)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


REAL, LEFT_OUT = SAMPLE_RUNS / "real_boat", SAMPLE_RUNS / "real_boat_validation"
AHEAD_S, FAN_EVERY_S = 5.0, 6.0


@house_style
def fans_figure(fit: YawFit) -> Figure:
    """Draw a real run that was left out: predictions 5 s ahead from filtered states with their band, and those of a
    constant rate; beside it errors of tools on real logs, as shares of the best, from peers.json."""
    (run,) = load_runs([LEFT_OUT], dof=YAW).runs
    model, time = fit.preferred.answering, run.time - run.time[0]
    origins = np.arange(FAN_EVERY_S, time[-1] - AHEAD_S, FAN_EVERY_S)
    course = make_course([run], np.array([False]), model.signals)
    problem = driven_problem(model, course)
    problem = replace(problem, parameters=problem.parameters.fixed_at(model.theta))
    noises = problem.noises(fit_innovations(problem, np.unique(base_starts(problem), axis=0), brief=True).theta[None])
    (ahead,) = [p for p in predict(model, course, model.theta, noises)[0] if p.horizon == AHEAD_S]
    copies = make_course([run] * len(origins), np.zeros(len(origins), dtype=bool), model.signals).unthinned
    blind = [replace(c, seen=c.seen & (copies.time <= origins[:, None])) for c in copies.channels]
    trace: list[tuple[Floats, ...]] = []
    follow(model, replace(copies, channels=tuple(blind)), model.theta[None], noises, trace=trace)
    mean, variance = (np.array([step[k][(0,) * (k + 1)][0] for step in trace]).T for k in (0, 1))  # (fans, nodes)
    figure = Figure((7.2, 3.6), layout="constrained")
    axes, beside = figure.subplots(1, 2, width_ratios=(2.9, 1.0))
    axes.plot(time, np.rad2deg(run.position), color="0.68", lw=3.2, label="measured")
    inside = []
    for fan, origin in enumerate(origins):
        nodes = copies.time[fan, :-1]
        on = np.flatnonzero((nodes >= origin) & (nodes <= origin + AHEAD_S + 1e-6))
        middle, half = np.rad2deg(mean[fan, on]), 1.96 * np.rad2deg(np.sqrt(variance[fan, on]))
        label = {} if fan else {"label": "predicted 5 s ahead, 95 % band"}
        axes.fill_between(nodes[on], middle - half, middle + half, color=PALETTE["sky"], alpha=0.5, lw=0)
        axes.plot(nodes[on], middle, color=PALETTE["blue"], lw=1.6, **label)
        back = time[(time <= origin + 1e-6)]
        rate = np.polyfit(back[-5:], np.rad2deg(run.position[: len(back)][-5:]), 1)[0]
        label = {} if fan else {"label": "constant rate"}
        straight = np.rad2deg(run.position[len(back) - 1]) + rate * (nodes[on] - origin)
        axes.plot(nodes[on], straight, color=PALETTE["vermilion"], lw=1.1, ls="--", **label)
        measured = np.interp(nodes[on][-1], time, np.rad2deg(run.position))
        inside.append(abs(measured - middle[-1]) <= half[-1])
    low, high = np.rad2deg([run.position.min(), run.position.max()])
    axes.set(ylim=(low - 70, high + 70), xlabel="time in the run [s]", ylabel="heading [deg]")
    errors = [np.rad2deg(ahead.rmse(values)) for values in (None, ahead.constant_rate)]
    axes.set_title(
        f"Model ship, run left out: {errors[0]:.0f}° off after 5 s, constant rate {errors[1]:.0f}°;\n"
        f"{sum(inside)} of {len(inside)} bands hold what was measured", loc="left",
    )  # fmt: skip
    axes.legend(loc="lower left", ncols=2, fontsize=6.5)
    rows = json.loads(PEERS.read_text(encoding="utf-8"))["predict"][::-1]
    for k, row in enumerate(rows):
        colour = PALETTE["blue"] if row["tool"] == "automarine" else "0.45"
        beside.plot([row["ratio"][1], row["worst"][1]], [k, k], color=colour, lw=1.2)
        beside.plot(row["ratio"][1], k, "o", color=colour)
        beside.plot(row["worst"][1], k, "|", color=colour, ms=9, mew=2)
    beside.set_yticks(range(len(rows)), [row["tool"] for row in rows])
    beside.set(xlabel="error / error of best tool", title=f"{rows[0]['halves']} halves, 5 s ahead:\nmedian and worst")
    return figure


CAMPAIGNS, RUNS_EACH = 15, 24


@house_style
def intervals_figure() -> Figure:
    """Draw the intervals of inertia that a plain script and this tool give to the same campaigns, thrust of which
    scatters from run to run."""
    figure = Figure((7.2, 3.0), layout="constrained")
    panels_of = figure.subplots(1, 2, sharex=True, sharey=True)
    for ax, peer in zip(panels_of, (peer_plain, peer_automarine)):
        found = []
        for seed in range(CAMPAIGNS):
            with TemporaryDirectory() as folder:
                write_campaign(Path(folder), "scatter", RUNS_EACH, seed)
                found.append(peer.fit(Path(folder))["I_r"])
        holds = [low <= INERTIA <= high for _, low, high in found]
        for k, ((value, low, high), right) in enumerate(zip(found, holds)):
            colour = PALETTE["blue"] if right else PALETTE["vermilion"]
            ax.plot([low, high], [k, k], color=colour, lw=2.2, ls="-" if right else (0, (1.5, 0.8)))
            ax.plot(value, k, "o" if right else "x", color=colour, ms=4)
        ax.axvline(INERTIA, color="0.2", lw=1.0)
        ax.set(title=f"{peer.TITLE}: {sum(holds)} of {CAMPAIGNS} contain the truth", xlabel="inertia I_r [nu s²]")
    panels_of[0].set(ylabel="campaign of 24 runs", yticks=[])
    figure.suptitle(
        "When thrust scatters (3 % from run to run), a script is wrong and sure: 95 % intervals, the truth as a line"
    )
    return figure


HULL = [(0.0, 1.0), (0.45, 0.45), (0.45, -0.9), (-0.45, -0.9), (-0.45, 0.45)]  # from above, the bow up
ARROW = {"arrowstyle": "-|>", "mutation_scale": 16, "linewidth": 2}


@house_style
def signs_figure() -> Figure:
    """Draw the positive directions from above: of automarine, and of ROS."""
    figure = Figure((7.0, 3.2), layout="constrained")
    titles = ("automarine, SNAME, PX4: clockwise from north", "ROS: counter-clockwise from east")
    for ax, side, title, across, third in zip(
        figure.subplots(1, 2), (1, -1), titles,
        ("v, Y\nto starboard", "v, Y\nto port"), ("w, Z: down, into the page", "w, Z: up, out of the page"),
    ):  # fmt: skip
        ax.set(title=title, xlim=(-2.3, 2.3), ylim=(-1.5, 2.4), aspect="equal")
        ax.axis("off")
        ax.add_patch(Polygon(HULL, facecolor="0.9", edgecolor="0.3"))
        ax.annotate("", (0, 1.8), (0, 0), arrowprops={"color": "C0", **ARROW})
        ax.annotate("", (side * 1.4, 0), (0, 0), arrowprops={"color": "C0", **ARROW})
        bent = {"color": "C1", "connectionstyle": f"arc3,rad={-side * 0.5}"}
        ax.annotate("", (side * 0.9, 1.0), (-side * 0.9, 1.0), arrowprops=bent | ARROW)
        ax.text(0, 1.9, "u, X: ahead", ha="center")
        ax.text(side * 1.5, 0, across, ha="left" if side > 0 else "right", va="center")
        ax.text(side * 1.0, 0.95, "ψ, r, τ\npositive", ha="left" if side > 0 else "right", va="center", color="C1")
        ax.plot(0, 0, marker="x" if side > 0 else "o", color="0.3", markersize=8)
        ax.text(0, -1.3, third, ha="center")
    return figure


Plan = Sequence[tuple[float, float]]
RATE, HEADING, LOGGED_RATE = "rate [°/s]", "heading [°]", "heading rate [°/s]"
STAIRS: Plan = ((0.3, 6.0), (0.6, 6.0), (0.9, 6.0), (1.2, 6.0))
BOTH_WAYS: Plan = ((0.6, 8.0), (-0.6, 10.0))
COAST: Plan = ((0.8, 5.0), (0.0, 12.0))
SQUARE: Plan = ((0.6, 2.0), (-0.6, 2.0)) * 3
REST: Plan = ((0.0, 30.0),)
RAMP: Plan = tuple((round(level, 3), 0.5) for level in np.linspace(0.2, -0.2, 61))


@dataclass(frozen=True)
class Panel:
    """A run that reveals an effect, and the effect's values: the plan is (moment, seconds), that of the port thruster
    where there is one of `starboard`. Drawn is what is `shown` of it, `since` one time `until` another [s]. `signals`
    are logged columns over time; `start` [s] is the campaign's clock; `base` is the number of the paper's model."""

    run: str
    plan: Plan
    values: tuple[float, ...]
    shown: str = RATE
    since: float = 0.0
    until: float | None = None
    starboard: Plan | None = None
    signals: Mapping[str, Callable[[Floats], Floats]] = field(default_factory=dict)
    start: float = 0.0
    dof: Dof = YAW
    base: str = "3"


def zigzag(time: Floats) -> Floats:
    """A rudder that goes from 0.3 rad on one side to the other every four seconds."""
    return np.where(np.sin(2.0 * np.pi * time / 8.0) >= 0.0, 0.3, -0.3)


GALLERY = {
    "backlash": Panel("up, half down, off", ((0.3, 7.0), (0.6, 7.0), (0.3, 7.0), (0.0, 9.0)), (0.08,)),
    "battery-sag": Panel("a step, an hour later", ((0.6, 10.0),), (0.3, 0.05, 1.2, 0.0), start=3600.0),
    "rudder": Panel(
        "zigzag under way", ((0.0, 20.0),), (1.2,), signals={"rudder": zigzag, "surge": lambda time: 1.0 + 0.0 * time}
    ),
    "rudder-drag": Panel("zigzag under way", ((1.0, 30.0),), (60.0,), signals={"rudder": zigzag}, dof=SURGE, base="2"),
    "rudder-inflow": Panel(
        "the same at half the speed",
        SQUARE,
        (0.2, 1.0),
        signals={"rudder": zigzag, "surge": lambda time: np.where(time < 9.0, 1.0, 0.5)},
    ),
    "rudder-offset": Panel("square wave of the rudder", SQUARE, (0.15,), signals={"rudder": zigzag}, until=20.0),
    "rudder-race": Panel(
        "zigzag, twice the thrust later",
        ((0.0, 20.0),),
        (0.8,),
        signals={"rudder": zigzag, "force_X": lambda time: np.where(time < 9.0, 0.5, 1.0)},
    ),
    "rudder-rate": Panel("square wave of the rudder", SQUARE, (0.5,), signals={"rudder": zigzag}, until=9.0),
    "rudder-stall": Panel("rising angles", STAIRS, (0.6, 1.0), signals={"rudder": zigzag}),
    "dead-band": Panel("slow ramp through zero", RAMP, (0.06,)),
    "input-delay": Panel("start of a step", ((0.6, 2.0),), (0.3,), since=0.5, until=2.5),
    "saturation": Panel("rising steps", STAIRS, (0.7,)),
    "thrust-asymmetry": Panel("same moment both ways", BOTH_WAYS, (0.15,)),
    "thrust-exponent": Panel("rising steps", STAIRS, (1.5, 1.2)),
    "thruster-lag": Panel("square wave", SQUARE, (0.5,), until=9.0),
    "voltage-exponent": Panel(
        "step, 13 V falls to 10 V",
        ((0.6, 30.0),),
        (1.2, 13.0),
        signals={"voltage": lambda time: 13.0 - 3.0 * np.clip((time - 5.0) / 20.0, 0.0, 1.0)},
    ),
    "thruster-dead-band": Panel(
        "port steady, starboard small",
        ((0.4, 24.0),),
        (0.06,),
        starboard=((0.0, 8.0), (0.05, 4.0), (-0.05, 4.0), (0.05, 4.0), (-0.05, 4.0)),
    ),
    "thruster-imbalance": Panel(
        "port alone, then starboard alone",
        ((0.4, 8.0), (0.0, 8.0)),
        (0.2, 0.2, 0.0),
        starboard=((0.0, 8.0), (0.4, 8.0)),
    ),
    "thruster-limit": Panel(
        "port rises, starboard small", ((0.2, 6.0), (0.5, 6.0), (0.8, 6.0)), (0.4,), starboard=((0.1, 18.0),)
    ),
    "coulomb-drag": Panel("coast-down", COAST, (0.06,)),
    "cubic-drag": Panel("rising steps", STAIRS, (0.5,)),
    "drag-asymmetry": Panel("same moment both ways", BOTH_WAYS, (0.3,)),
    "linear-drag": Panel("coast-down", COAST, (0.3,)),
    "linear-drag-asymmetry": Panel(
        "surge: same force both ways", ((10.0, 15.0), (-10.0, 20.0)), (4.0,), shown="speed [m/s]", dof=SURGE, base="2"
    ),
    "quadratic-drag": Panel("rising steps", STAIRS, (0.6,), base="1"),
    "bias-moment": Panel("rest record", REST, (0.02,)),
    "cross-coupling": Panel(
        "step, way on after 8 s",
        ((0.4, 20.0),),
        (0.4,),
        signals={"surge": lambda time: np.clip((time - 8.0) / 3.0, 0.0, 1.0)},
    ),
    "heading-moment": Panel("turns at a small moment", ((0.15, 60.0),), (0.05, 0.0)),
    "history-force": Panel("square wave", SQUARE, (0.8, 2.0)),
    "periodic-disturbance": Panel("rest record", REST, (0.06, 0.0, 3.0)),
    "tether-spring": Panel("long turn, then release", ((0.3, 25.0), (0.0, 25.0)), (0.02,)),
    "thrust-loss": Panel("reversal at speed", ((1.0, 5.0), (-1.0, 7.0)), (0.3,)),
    "wall": Panel("turns at a small moment", ((0.3, 40.0),), (0.5, 0.0)),
    "water-swirl": Panel("long turn, then reversal", ((0.6, 20.0), (-0.6, 12.0), (0.0, 12.0)), (0.3, 10.0)),
    "compass-deviation": Panel("turns at a small moment", ((0.3, 40.0),), (0.12, 0.0, 0.0, 0.0), shown=LOGGED_RATE),
    "current-deviation": Panel("short pulse", ((0.6, 1.0), (0.0, 2.0)), (0.15, 0.0, 1.2), shown=HEADING, until=3.0),
    "gyro-drift": Panel("rest record", REST, (0.003,), shown=HEADING),
    "sensor-lag": Panel("square wave", SQUARE, (0.4,), shown=HEADING, until=9.0),
}
REST_BEFORE, EVERY = 1.0, 0.05  # s


@house_style
def gallery_figure(members: Sequence[Effect]) -> Figure:
    """Draw what each effect does to a run that reveals it: in grey without the effect, in blue with it."""
    figure, axes = panels(len(members), 2 if len(members) == 4 else 3, 1.75, 0.1)
    for ax, effect in zip(axes.flat, members):
        panel = GALLERY[effect.name]
        time, without = gallery_run(effect, panel, acts=False)
        seen = (time >= panel.since) & (time <= (panel.until or time[-1]))
        ax.plot(time[seen], without[seen], color=PALETTE["grey"], lw=2.4)
        ax.plot(time[seen], gallery_run(effect, panel, acts=True)[1][seen], color=PALETTE["blue"], lw=1.4)
        ax.set_title(f"{effect.name}\n{panel.run}", fontsize=9.5)
        ax.set(xlabel="time [s]", ylabel=panel.shown)
        ax.locator_params(nbins=5)
    return figure


def gallery_run(effect: Effect, panel: Panel, acts: bool) -> tuple[Floats, Floats]:
    """Time [s] of a panel's run, and what is shown of it, of the paper's vehicle with or without the effect."""
    time = np.arange(0.0, REST_BEFORE + sum(seconds for _, seconds in panel.plan), EVERY)
    port, starboard = (held(time, plan) for plan in (panel.plan, panel.starboard or ()))
    extras = {name: column(time) for name, column in panel.signals.items()}
    if panel.starboard is not None:
        extras |= parts_of([port, starboard], panel.dof)
    clock, surge, unit = panel.start + time, panel.dof is SURGE, STEERED if effect.acts_on else "nu"
    run = Run("run", "run.csv", clock, np.zeros_like(time), port + starboard, unit, extras, dof=panel.dof)
    values = {"1": (0.6,), "2": (10.0, 20.0), "3": (K_RR,)}[panel.base]
    model = Model.base(panel.base, 20.0 if surge else INERTIA, values, unit, panel.dof)
    model = model.with_effect(effect.name, panel.values) if acts else model
    found = simulate(model, make_batch([run], EVERY, effect.needs))
    if panel.shown == HEADING:
        return time, np.rad2deg(found.position[0, 0])
    if panel.shown == LOGGED_RATE:
        return time, np.rad2deg(np.gradient(found.position[0, 0], EVERY))
    return time, found.velocity[0, 0] if surge else np.rad2deg(found.velocity[0, 0])


def held(time: Floats, plan: Plan) -> Floats:
    """The command at each time: nothing in the rest before the plan."""
    ends = REST_BEFORE + np.cumsum([0.0, *(seconds for _, seconds in plan)])
    levels = np.array([0.0, *(level for level, _ in plan), 0.0])
    return np.asarray(levels[np.searchsorted(ends, time, side="right")])


def of_run(log: Path, model: Path) -> Figure:
    """A log and what the models of a file make of its commands."""
    result = validate([log], model=model)
    assert isinstance(result.stored, StoredModels)
    free = {name: scored.free[0] for name, scored in result.models.items()}
    return validation_figure(free, result.stored, result.floors[0])


@house_style
def small_png(figure: Figure) -> bytes:
    """The figure as PNG of few colours, the same bytes each time."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI, metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / ".github" / "pictures"
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        for name, figure in pictures(Path(folder)):
            content = small_png(figure)
            (out / f"{name}.png").write_bytes(content)
            print(f"{name}.png: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
