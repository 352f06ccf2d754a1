"""`make real` for surge, sway and yaw together: halves exchanged, beside plain least squares of the same structure.

The least squares are written in numpy and scipy alone: from a state every second on, told from the second before, the
equations of surge, sway and yaw are integrated with the logged commands, and the parameters are those that miss heading
and speeds least at one horizon. The library predicts from its filtered state at the same instants.
"""

import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from real_baseline import BEFORE, HORIZONS, STEP, causal_state
from real_sets import RealSet, present
from scipy.optimize import least_squares

from automarine_cli.filters.kalman import carried
from automarine_cli.fits.driven import of_model_alone
from automarine_cli.fits.planar_fit import FORECASTS, PlanarFit, PlanarLikelihood, search
from automarine_cli.fits.planar_structure import Observed, observed
from automarine_cli.logs import ColumnMap
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import load_planar

Floats = NDArray[np.float64]
QUANTITIES = ("heading", "surge", "sway")
UNITS = {"heading": "deg", "surge": "m/s", "sway": "m/s"}
SETS = ("cybership_enterprise", "heavy_rov_sea")
OWN = {"m_u": 0, "m_v": 1, "I_r": 2}
SPAN = 5.0  # a size may leave its start by this factor's logarithm
Row = dict[str, Any]


@dataclass(frozen=True)
class States:
    """A states from which predictions begin: `run` and `time` since its first sample, `state` (A, 4): heading, u, v, r;
    `force` (A, 3, M) the mean commands over each STEP after it, NaN past the run's end; `reached` (A, 3, H)."""

    run: NDArray[np.int64]
    time: Floats
    state: Floats
    force: Floats
    reached: Floats


def states_of(runs: Sequence[Run]) -> States:
    """States every second of all runs that have the longest horizon left."""
    found = [(i, *one) for i, run in enumerate(runs) for one in _states(run)]
    run, *rest = zip(*found)
    return States(np.array(run), *(np.array(one) for one in rest))


def _states(run: Run) -> Iterator[tuple[float, Floats, Floats, Floats]]:
    columns = [run.position, *(np.asarray(run.channel(name)) for name in QUANTITIES[1:])]
    forces = [np.asarray(run.extras[name]) for name in ("force_X", "force_Y")] + [run.command]
    impulses = [np.concatenate([[0.0], np.cumsum(force[:-1] * np.diff(run.time))]) for force in forces]
    speeds = [(run.time[np.isfinite(c)], c[np.isfinite(c)]) for c in columns[1:]]
    for begin in np.arange(run.time[0] + BEFORE, run.time[-1] - HORIZONS[-1], 1.0):
        k = int(np.searchsorted(run.time, begin))
        heading, rate = causal_state(run, k)
        now = []
        for clock, speed in speeds:
            near = slice(
                int(np.searchsorted(clock, run.time[k] - BEFORE)), int(np.searchsorted(clock, run.time[k] + 1e-9))
            )
            line = (
                np.polynomial.polynomial.polyfit(clock[near] - run.time[k], speed[near], 1)
                if near.stop - near.start > 3
                else [speed[max(near.stop - 1, 0)]]
            )
            now.append(float(line[0]))
        grid = run.time[k] + STEP * np.arange(round(HORIZONS[-1] / STEP) + 1)
        force = np.array([np.diff(np.interp(grid, run.time, one)) / STEP for one in impulses])
        ends = run.time[k] + np.array(HORIZONS)
        reached = [np.interp(ends, run.time, run.position), *(np.interp(ends, *one) for one in speeds)]
        yield run.time[k] - run.time[0], np.array([heading, *now, rate]), force, np.array(reached)


def ahead(values: Mapping[str, float], states: States, last: float = HORIZONS[-1]) -> Floats:
    """Heading, u and v at the horizons, (A, 3, H), by Heun's method."""
    m, drags, cross = _model(values)
    inverse = np.linalg.inv(m)

    def rates(state: Floats, force: Floats) -> Floats:
        v = state[:, 1:]
        p = v @ m
        turned = np.stack([-p[:, 1] * v[:, 2], p[:, 0] * v[:, 2], v[:, 0] * p[:, 1] - v[:, 1] * p[:, 0]], axis=1)
        drag = drags[0] * v + drags[1] * np.abs(v) * v
        for row, size, along, value in cross:
            drag[:, row] += value * v[:, along] * (1.0 if size is None else np.abs(v[:, size]))
        return np.column_stack([v[:, 2], (force - drag - turned) @ inverse])

    state, shown = states.state, []
    for i in range(round(last / STEP)):
        first = rates(state, states.force[:, :, i])
        second = rates(np.clip(state + STEP * first, -1e3, 1e3), states.force[:, :, i])
        state = np.clip(state + 0.5 * STEP * (first + second), -1e3, 1e3)
        shown.append(state[:, :3])
    rows = [min(round(h / STEP), len(shown)) - 1 for h in HORIZONS]
    return np.stack([shown[i] for i in rows], axis=2)


def _model(values: Mapping[str, float]) -> tuple[Floats, Floats, list[tuple[int, int | None, int, float]]]:
    """Inertia (3, 3), own drags linear and quadratic (2, 3), other derivatives, from values by short name."""
    m, drags, cross = np.zeros((3, 3)), np.zeros((2, 3)), []
    for name, value in values.items():
        if name in OWN:
            m[OWN[name], OWN[name]] = value
        elif name == "m_vr":
            m[1, 2] = m[2, 1] = value
        else:
            letter, _, along = name.replace("k_", "N_").partition("_")
            row, places = "XYN".index(letter), ["uvr".index(one) for one in along]
            if set(places) == {row}:
                drags[len(places) - 1, row] = value
            else:
                cross.append((row, places[0] if len(places) > 1 else None, places[-1], value))
    return m, drags, cross


def fit_plain(states: States, start: Mapping[str, float], horizon: float) -> dict[str, float]:
    """Least squares of heading and speeds `horizon` seconds ahead, all on the scale of what constants miss."""
    column = HORIZONS.index(horizon)
    goal = states.reached[:, :, column]
    scale = np.sqrt(np.mean((goal - states.state[:, :3]) ** 2, axis=0))
    names = list(start)
    sizes = np.array([max(abs(start[name]), 1e-3) for name in names])
    above = np.array(
        [
            name in OWN
            or (set(name[2:]) <= {"u"} and name[0] == "X")
            or (set(name[2:]) <= {"v"} and name[0] == "Y")
            or name.startswith("k_")
            for name in names
        ]
    )

    def values(z: Floats) -> dict[str, float]:
        return dict(zip(names, np.where(above, sizes * np.exp(np.clip(z, -SPAN, SPAN)), sizes * z).tolist()))

    def misses(z: Floats) -> Floats:
        return ((ahead(values(z), states, horizon)[:, :, column] - goal) / scale).ravel()

    found = []
    for shift in (-1.0, 0.0, 1.0):
        begin = np.where(above, shift * np.isin(names, list(OWN)), [np.sign(start[name]) for name in names])
        found.append(least_squares(misses, begin, x_scale="jac", max_nfev=60))
    return values(min(found, key=lambda one: float(one.cost)).x)


def rms(errors: Floats) -> Floats:
    """Over the states: (3, H), headings in degrees."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)) * np.array([np.rad2deg(1.0), 1.0, 1.0])[:, None])


def tool_ahead(fit: PlanarFit, runs: Sequence[Run], seen: Observed, states: States) -> Floats:
    """What the library predicts at the horizons from its filtered states, (A, 3, H)."""
    likelihood = PlanarLikelihood(tuple(runs), seen)
    problem, found = likelihood.problem(fit.found.model), fit.found.fit
    assert found is not None
    course = likelihood.course
    noises = problem.noises(found.theta[None])
    followed = problem.follow(found.phi[None], keep=True)
    if fit.choice.way == FORECASTS:
        followed = of_model_alone(followed)
    assert followed.states is not None
    ends = np.array([int((length > 0).sum()) for length in course.length])
    clock = np.where(np.arange(course.time.shape[1]) <= ends[:, None], course.time, np.inf)
    origin = np.array([np.searchsorted(clock[i], t + 1e-9) - 1 for i, t in zip(states.run, states.time)])
    last = np.array(
        [min(np.searchsorted(clock[i], t + HORIZONS[-1] + 1.0), ends[i]) for i, t in zip(states.run, states.time)]
    )
    channels = [next(one for one in course.channels if one.quantity == name) for name in QUANTITIES]
    paths = carried(
        problem.model, course, found.of_model[None], noises, followed.states[:, 0], channels, states.run, origin, last
    )[:, 0]  # fmt: skip
    return np.array([
        [np.interp(t + np.array(HORIZONS), clock[i, o : e + 1], path[a, : e - o + 1]) for path in paths]
        for a, (i, t, o, e) in enumerate(zip(states.run, states.time, origin, last))
    ])  # fmt: skip


def fitted(runs: Sequence[Run]) -> PlanarFit:
    """As `fit-planar` fits them."""
    seen = observed(runs)
    likelihood = PlanarLikelihood(tuple(runs), seen)
    tried = search(runs, seen, likelihood)
    return PlanarFit(tried, likelihood.choose(tried), tuple(runs), seen)


def judged(item: tuple[RealSet, str]) -> Row:
    """The row of one half that is fitted: of a set, and which half."""
    one, half = item
    with tempfile.TemporaryDirectory() as folder:
        columns = one.column_map(Path(folder)) or ColumnMap()
        runs = list(load_planar([str(one.path / one.glob)], columns).runs)
    own, kept = one.halved(runs)[:: 1 if half == "A" else -1]
    begun = time.perf_counter()
    row = row_of(one.name, half, fitted(own), own, kept) | {"seconds": round(time.perf_counter() - begun, 1)}
    print(f"{one.name}, planar, half {half}: {row['seconds']} s", file=sys.stderr, flush=True)
    return row


def row_of(name: str, half: str, fit: PlanarFit, own: Sequence[Run], kept: Sequence[Run]) -> Row:
    """What a fit to one half misses by on the other, beside least squares of its structure."""
    seen, learned, tried = fit.observed, states_of(own), states_of(kept)
    start = {one.partition(".")[2]: value for one, value in zip(fit.found.model.free, fit.found.model.theta.tolist())}
    squares = {h: fit_plain(learned, start, h) for h in HORIZONS}
    least = np.stack(
        [rms(ahead(squares[h], tried) - tried.reached)[:, i] for i, h in enumerate(HORIZONS)], axis=1
    )  # fmt: skip
    still = np.repeat(tried.state[:, :3, None], len(HORIZONS), axis=2)
    going = still.copy()
    going[:, 0] += tried.state[:, 3, None] * np.array(HORIZONS)
    return {
        "set": name, "half": half, "structure": str(fit.structure), "way": fit.choice.way,
        "parameters": {key: (one.value, *one.ci95) for key, one in fit.estimates.items()},
        "least_squares": squares[5.0],
        "tool": rms(tool_ahead(fit, kept, seen, tried) - tried.reached).tolist(),
        "least": least.tolist(),
        "constant": np.minimum(rms(still - tried.reached), rms(going - tried.reached)).tolist(),
        "says": list(fit.warnings),
    }  # fmt: skip


def table(rows: Sequence[Row]) -> Table:
    lines = []
    for row in rows:
        for i, name in enumerate(QUANTITIES):
            three = [" / ".join(f"{x:.3g}" for x in row[key][i]) for key in ("tool", "least", "constant")]
            ratio = row["tool"][i][1] / row["least"][i][1]
            lines.append((row["set"], row["half"], row["way"], f"{name}, {UNITS[name]}", *three, f"{ratio:.2f}"))
    header = (
        "data set",
        "fitted half",
        "fitted to",
        "of",
        "now",
        "least squares",
        "better constant",
        "5 s: now / least squares",
    )
    return Table("Surge, sway and yaw together: errors 2 / 5 / 15 s ahead", header, tuple(lines))


def planar_items(only: str = "") -> list[tuple[RealSet, str]]:
    """Every half at hand that is fitted as a whole and has `only` in "set/planar"."""
    sets = {one.name: one for one, _ in present("")}.values()
    return [(one, h) for one in sets if one.name in SETS and only in f"{one.name}/planar" for h in "AB"]


if __name__ == "__main__":
    every = planar_items(sys.argv[1] if len(sys.argv) > 1 else "")
    print(table([judged(item) for item in every]).to_markdown())
