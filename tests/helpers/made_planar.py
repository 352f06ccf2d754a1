"""Planar motion of known truth, written without the package: `solved` integrates any vehicle by its momentum, linear
in earth axes and angular about its own origin, in which no Coriolis force appears."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from automarine_cli.dofs import PLANAR, YAW
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.models.model import Model, Term
from automarine_cli.models.store import DRAG_OF_ROLE
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run


@dataclass(frozen=True)
class Craft:
    """A vehicle as numbers: inertia and damping matrices (3, 3) by linear, by |own| and by |u|, |v|, |r|; current
    (2,)."""

    inertia: Floats
    linear: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    by_own: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    by_surge: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    by_sway: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    by_rate: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    current: Floats = field(default_factory=lambda: np.zeros(2))

    def drag(self, flow: Floats) -> Floats:
        """Resistance (3,) to velocities through the water (3,)."""
        size = np.abs(flow)
        quadratic = self.by_own * size + self.by_surge * size[0] + self.by_sway * size[1] + self.by_rate * size[2]
        return (self.linear + quadratic) @ flow

    def in_current(self, current: tuple[float, float] | None) -> "Craft":
        """The same vehicle in a current north and east [m/s]; None for still water."""
        return replace(self, current=np.array(current or (0.0, 0.0)))

    def mirrored(self) -> "Craft":
        sides = np.outer([1, -1, -1], [1, -1, -1])
        changed = {
            name: sides * getattr(self, name)
            for name in ("inertia", "linear", "by_own", "by_surge", "by_sway", "by_rate")
        }
        return replace(self, **changed, current=self.current * (1, -1))


def turned(heading: float) -> Floats:
    """Body axes to earth axes, (2, 2)."""
    return np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])


def solved(craft: Craft, run: Run, position: Sequence[float], velocity: Sequence[float]) -> tuple[Floats, Floats]:
    """Positions (north, east, heading) and velocities over ground in body axes, both (N, 3), at the samples of a run
    whose commands change halfway between two samples."""
    heading = position[2]
    flow = np.array(velocity) - [*(turned(heading).T @ craft.current), 0.0]
    momentum = craft.inertia @ flow
    start = [*position, *(turned(heading) @ momentum[:2]), momentum[2]]

    def rates(_: float, state: Floats, force: Floats) -> Floats:
        axes = turned(state[2])
        along = axes.T @ state[3:5]
        u, v, r = np.linalg.solve(craft.inertia, [*along, state[5]])
        x, y, n = force - craft.drag(np.array([u, v, r]))
        lever = u * along[1] - v * along[0]  # the origin moves, and takes its angular momentum along
        return np.array([*(axes @ [u, v] + craft.current), r, *(axes @ [x, y]), n - lever])

    assert run.moment is not None
    force = np.column_stack([run.extras["force_X"], run.extras["force_Y"], run.moment])
    changes = 1 + np.flatnonzero(np.any(force[1:] != force[:-1], axis=1))
    edges = [run.time[0], *(run.time[changes - 1] + run.time[changes]) / 2, run.time[-1]]
    states, state = np.empty((len(run), len(start))), np.array(start, dtype=float)
    for begin, end, held in zip(edges[:-1], edges[1:], force[[0, *changes]]):
        here = (run.time >= begin) & (run.time <= end)
        times = np.union1d(run.time[here], end)
        solution = solve_ivp(rates, (begin, end), state, "DOP853", times, args=(held,), rtol=1e-11, atol=1e-12)
        states[here], state = solution.y[:, : here.sum()].T, solution.y[:, -1]
    axes = np.array([turned(one) for one in states[:, 2]])
    along = np.einsum("nji,nj->ni", axes, states[:, 3:5])
    flow = np.linalg.solve(craft.inertia, np.column_stack([along, states[:, 5]])[..., None])[..., 0]
    return states[:, :3], flow + np.column_stack([np.einsum("nji,j->ni", axes, craft.current), 0 * flow[:, 2]])


def planar_run(time: Floats, x: Floats, y: Floats, moment: Floats, name: str = "run") -> Run:
    """A run with commands (N,) [N, N, N m] and no measurement."""
    force = {"force_X": np.array(x, dtype=float), "force_Y": np.array(y, dtype=float)}
    held = np.array(moment, dtype=float)
    return Run(name, f"{name}.csv", time, np.zeros(len(time)), held, "N m", force, dof=YAW)


def driven(seed: int = 0, length: float = 12.0, period: float = 0.1) -> Run:
    """A run with commands that change every two seconds or so, at random."""
    rng, time = np.random.default_rng(seed), 50.0 + period * np.arange(round(length / period) + 1)
    held = np.searchsorted(np.cumsum(rng.uniform(1.0, 3.0, 20)), time - time[0])
    x, y, n = (size * rng.uniform(-1, 1, 21)[held] for size in (30.0, 15.0, 8.0))
    return planar_run(time, x, y, n, f"driven_{seed}")


BARE = Craft(np.diag([20.0, 20.0, 2.6]), by_own=np.diag([18.0, 60.0, 4.0]))
"""Quadratic drag, and as much water taken along abeam as ahead."""
HIDDEN = {
    "nothing": BARE,
    "N_ur": replace(BARE, by_surge=np.diag([0.0, 0.0, 2.5])),
    "N_v": replace(BARE, linear=np.array([[0, 0, 0], [0, 0, 0], [0, 4.0, 0]])),
    "Y_r": replace(BARE, linear=np.array([[0, 0, 0], [0, 0, 4.0], [0, 0, 0]])),
    "munk-moment": replace(BARE, inertia=np.diag([20.0, 32.0, 2.6])),
    "current": BARE.in_current((0.15, -0.1)),
}
"""What a model of the bare craft lacks."""
NOISE = {"heading": 0.01, "north": 0.02, "east": 0.02, "surge": 0.01, "sway": 0.01}
"""rad, m, m/s."""
GYRO_NOISE = 0.005  # rad/s
MIRRORED = ("heading", "sway", "east", "force_Y")


ARM_M = 0.3


def of_two_thrusters(run: Run) -> Run:
    """The run with what each of two thrusters ARM_M off the centre line gives of its force ahead and its moment."""
    port, stbd = thrusts(run)
    ways = np.maximum(port, 0.0), np.minimum(port, 0.0), -np.maximum(stbd, 0.0), -np.minimum(stbd, 0.0)
    parts = {name: ARM_M * force for name, force in zip(PARTS, ways)}
    return replace(run, extras={**run.extras, **parts, "arm": np.full(len(run), ARM_M)})


def thrusts(run: Run) -> tuple[Floats, Floats]:
    """Forces of the thrusters to port and starboard [N], (N,)."""
    assert run.moment is not None
    ahead, turning = run.extras["force_X"], run.moment / ARM_M
    return 0.5 * (ahead + turning), 0.5 * (ahead - turning)


def delivered(run: Run, gains: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0), dead_N: float = 0.0) -> Run:
    """The run with forces of thrusters that give these `gains` of what is commanded, port ahead and astern, starboard
    ahead and astern, less a dead band [N]."""

    def thrust(force: Floats, ahead: float, astern: float) -> Floats:
        force = force - np.clip(force, -dead_N, dead_N)
        return np.where(force > 0, ahead, astern) * force

    port, stbd = (thrust(force, *pair) for force, pair in zip(thrusts(run), (gains[:2], gains[2:])))
    return replace(run, moment=ARM_M * (port - stbd), extras={**run.extras, "force_X": port + stbd})


FINE = 10  # steps of a sample in which thrust that lags is held


def campaign(
    craft: Craft, seed: int, runs: int, length: float, channels: Sequence[str] = tuple(NOISE), mirror: bool = False,
    lag_s: float = 0.0, dead_Nm: float = 0.0, given: Callable[[Run], Run] = lambda run: run, compass_s: float = 0.0,
) -> list[Run]:  # fmt: skip
    """Runs from rest with noisy readings and 2 % scatter of the thrust, which lags by `lag_s` and lacks moments of
    `dead_Nm`, or is what is `given` for a run's commands; with `mirror` port and starboard exchanged. The compass is of
    first order in `compass_s`; a `yaw_rate` among the channels is of a gyro."""
    how = channels, mirror, lag_s, dead_Nm, given, compass_s
    return [made_run(craft, 100 * seed + i, length, *how) for i in range(runs)]


def lagging(run: Run, lag_s: float) -> Run:
    """The run in fine steps, with thrust of first order behind its commands, as its mean over each step."""
    step = run.sample_period / FINE
    sample = (np.arange(FINE * (len(run) - 1) + 1) + FINE // 2) // FINE
    left = np.exp(-step / lag_s)

    def late(command: Floats) -> Floats:
        out, now = np.empty(len(sample)), 0.0
        for k, held in enumerate(command[sample]):
            out[k] = held + (now - held) * (1.0 - left) * lag_s / step
            now = held + (now - held) * left
        return out

    assert run.moment is not None
    extras = {name: late(column) for name, column in run.extras.items()}
    time = run.time[0] + step * np.arange(len(sample))
    return replace(run, time=time, position=0.0 * time, moment=late(run.moment), extras=extras)


def spinning_up(run: Run, lag_s: float) -> Run:
    """The run in fine steps, with two thrusters whose propellers are of first order behind their commands."""
    port, stbd = (np.sign(force) * np.sqrt(np.abs(force)) for force in thrusts(run))
    slow = lagging(replace(run, moment=port, extras={"force_X": stbd}), lag_s)
    assert slow.moment is not None
    port, stbd = (speed * np.abs(speed) for speed in (slow.moment, slow.extras["force_X"]))
    sway = run.extras["force_Y"][(np.arange(len(slow)) + FINE // 2) // FINE]
    return replace(slow, moment=ARM_M * (port - stbd), extras={"force_X": port + stbd, "force_Y": sway})


def made_run(
    craft: Craft, seed: int, length: float, channels: Sequence[str], mirror: bool, lag_s: float = 0.0,
    dead_Nm: float = 0.0, given: Callable[[Run], Run] = lambda run: run, compass_s: float = 0.0,
) -> Run:  # fmt: skip
    run, rng = driven(seed, length, 0.2), np.random.default_rng([seed, 14])
    gain = np.exp(0.02 * rng.standard_normal())
    thrust = given(run)
    assert thrust.moment is not None
    moment = thrust.moment - np.clip(thrust.moment, -dead_Nm, dead_Nm)
    true = replace(thrust, moment=gain * moment, extras={k: gain * x for k, x in thrust.extras.items()})
    true = lagging(true, lag_s) if lag_s else true
    every = (len(true) - 1) // (len(run) - 1)
    positions, velocities = (rows[::every] for rows in solved(craft, true, (0, 0, 0.3), (0, 0, 0)))
    columns = dict(zip(("north", "east", "heading", "surge", "sway", "yaw_rate"), [*positions.T, *velocities.T]))
    columns["heading"] = behind(columns["heading"], run.sample_period, compass_s)
    noise = {**NOISE, **({"yaw_rate": GYRO_NOISE} if "yaw_rate" in channels else {})}
    read = {name: columns[name] + size * rng.standard_normal(len(run)) for name, size in noise.items()}
    read = {name: read[name] for name in channels} | dict(run.extras)
    if mirror:
        read |= {name: -read[name] for name in MIRRORED if name in read}
        run = replace(run, moment=-run.moment)
    return replace(run, position=read.pop("heading"), extras=read)


def behind(readings: Floats, period: float, lag_s: float, parts: int = 200) -> Floats:
    """What a sensor of first order shows of readings (N,), which are straight between two, in small steps."""
    if not lag_s:
        return readings
    true = np.interp(np.arange(parts * (len(readings) - 1) + 1) / parts, np.arange(len(readings)), readings)
    shown, left = np.empty_like(true), np.exp(-period / parts / lag_s)
    shown[0] = now = true[0]
    for k, middle in enumerate(0.5 * (true[1:] + true[:-1])):
        shown[k + 1] = now = middle + (now - middle) * left
    return shown[::parts]


def log(run: Run, folder: Path, name: str = "", **columns: object) -> Path:
    table = {
        "time_s": run.time, "heading_deg": np.rad2deg(run.position) % 360, "tau_Nm": run.moment,
        "force_X_N": run.extras["force_X"], "force_Y_N": run.extras["force_Y"],
        **{f"{name}_m": run.extras[name] for name in ("north", "east") if name in run.extras},
        **{f"{name}_m_s": run.extras[name] for name in ("surge", "sway") if name in run.extras}, **columns,
    }  # fmt: skip
    path = folder / f"{name or run.name}.csv"
    pd.DataFrame({key: column for key, column in table.items() if column is not None}).to_csv(path, index=False)
    return path


Terms = tuple[Term, ...]


def planar_model(
    *masses: float, surge: Terms = (), sway: Terms = (), yaw: Terms = (), cross: Terms = (),
    water: tuple[float, float] | None = None,
) -> Model:  # fmt: skip
    """A model of the plane: m_u, m_v, I_r, then what couples them, m_vr, m_ur and m_uv."""
    letters = DRAG_OF_ROLE.values()
    terms = [replace(t, dof=i, base=t.name in letters) for i, own in enumerate((surge, sway, yaw)) for t in own]
    terms += [Term.cross(term.name, *term.values) for term in cross]
    return Model(PLANAR, (*masses, 0.0, 0.0, 0.0)[:6], tuple(terms), "N m", water)


def quadratic_drags(*masses: float, drags: Sequence[float], name: str = "quadratic-drag") -> Model:
    """A model of one kind of drag in each motion."""
    surge, sway, yaw = ((Term(name, (drag,)),) for drag in drags)
    return planar_model(*masses, surge=surge, sway=sway, yaw=yaw)


FULL = planar_model(
    20.0, 32.0, 2.6, 1.5, -0.7, 0.9,
    surge=(Term("linear-drag", (3.0,)), Term("quadratic-drag", (18.0,))),
    sway=(Term("quadratic-drag", (40.0,)), Term("linear-drag", (5.0,))),
    yaw=(
        Term("linear-drag", (0.6,)), Term("quadratic-drag", (2.5,)), Term("bias-moment", (0.1,)),
        Term("input-delay", (0.2, 0.0, 0.1)),
    ),
    cross=(
        Term("Y_r", (1.2,)), Term("N_v", (0.8,)), Term("N_vv", (1.7,)), Term("Y_rr", (0.9,)), Term("N_vr", (2.2,)),
        Term("Y_rv", (1.1,)), Term("X_v", (0.4,)),
    ),
    water=(0.25, -0.15),
)  # fmt: skip
"""A vehicle with every kind of term, alike on no side."""
