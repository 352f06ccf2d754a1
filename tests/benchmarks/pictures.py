"""`make pictures`: the figures of the README and its pages, made by the tool from sample_runs, small enough for a page.

Usage: python tests/benchmarks/pictures.py [FOLDER]
"""

import io
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from effect_families import families, picture_of
from made_runs import INERTIA, K_RR
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image
from pool_day import ARM, write_pool_day
from repository import ROOT, SAMPLE_RUNS

from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.fit_motion import fit_yaw
from automarine_cli.commands.fit_thrusters import fit_thrusters
from automarine_cli.commands.init import init
from automarine_cli.commands.validate import validate
from automarine_cli.dofs import SURGE, YAW, Dof
from automarine_cli.effects import Effect
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import Floats
from automarine_cli.report.figures.parameters import thruster_figure
from automarine_cli.report.figures.runs import drag_figure, half_turns_figure, inertia_figure, validation_figure
from automarine_cli.report.figures.style import COLOURS as PALETTE
from automarine_cli.report.figures.style import house_style, panels
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate
from automarine_cli.thrusters.map import parts_of

HIDDEN = SAMPLE_RUNS / "hidden_one"
VALIDATED = "there_and_back.csv"
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
    for name in ("where", "why", "before_after"):
        yield name, result.plot(name)
    after = of_run(HIDDEN / VALIDATED, folder / "diagnosis" / "extended_model.json")
    for same, ax in zip(before.axes[:2], after.axes):
        ax.set_ylim(same.get_ylim())
    yield "after", after

    # a day in other people's columns: the thrusters' curve, and the half-turns that the moment made of it explains
    day, written, columns = write_pool_day(folder / "pool_day"), folder / "pool.toml", folder / "columns.toml"
    init(day, out=written)
    answered = written.read_text().replace('arm_m = "?"', f"arm_m = {ARM}").replace('per_test = "?"', "per_test = 1")
    columns.write_text(answered[answered.index("[columns]") : answered.index("[thrusters]")])
    thrusters = fit_thrusters([day / "bollard_T200.csv"], columns=columns)
    yield "pool_thrusters", thruster_figure(thrusters)
    fit = fit_yaw([day / "run_*.csv"], columns=columns, thrusters=thrusters, arm=ARM)
    yield "pool_half_turns", half_turns_figure(fit)


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
    clock = panel.start + time
    run = Run("run", "run.csv", clock, np.zeros_like(time), port + starboard, "nu", extras, dof=panel.dof)
    surge = panel.dof is SURGE
    values = {"1": (0.6,), "2": (10.0, 20.0), "3": (K_RR,)}[panel.base]
    model = Model.base(panel.base, 20.0 if surge else INERTIA, values, "nu", panel.dof)
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
