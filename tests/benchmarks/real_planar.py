"""`make real` for surge, sway and yaw together: halves exchanged, beside plain least squares of the same structure.

The least squares are written in numpy and scipy alone: from a state every second on, as the second before shows it, the
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
import pandas as pd
from numpy.polynomial.polynomial import polyfit
from numpy.typing import NDArray
from real_baseline import BEFORE, HORIZONS, STEP, causal_state, mean_force
from real_library import predictions
from real_sets import RealSet, present
from scipy.optimize import least_squares

from automarine_cli.fits.driven import THRUSTER_LAG
from automarine_cli.fits.planar_fit import PlanarFit, PlanarLikelihood, search
from automarine_cli.fits.planar_structure import observed
from automarine_cli.logs import ColumnMap, read_column_map
from automarine_cli.quantities import Floats
from automarine_cli.report.tables import Table
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import load_planar

UNITS = {"heading": "deg", "surge": "m/s", "sway": "m/s"}
SETS = {"cybership_enterprise": (), "heavy_rov_sea": (), "kvlcc2_zigzag": ("rudder", "rudder-drag")}
"""Sets whose runs are fitted as a whole, with the effects that are asked for."""
TANKER = "kvlcc2_zigzag"
TANKER_COLUMNS = """[columns]
rudder_deg = { from = "rudder_deg", sign = -1 }
yaw_rate_deg_s = "yaw_rate_degps"
force_X_N = { from = "prop_rps", scale = 3.4 }
"""
INERTIAS = {"m_u": 0, "m_v": 1, "I_r": 2}
STEERING = ("X_deltadelta", "Y_delta", "Y_deltaX", "N_delta", "N_deltaX")
POSITIVE = {*INERTIAS, "X_u", "X_uu", "Y_v", "Y_vv", "k_r", "k_rr"}
SPAN = 5.0  # a size may leave its start by this factor's logarithm
Row = dict[str, Any]


@dataclass(frozen=True)
class States:
    """A states from which predictions begin: `run` and `time` since its first sample, `state` (A, 4): heading, u, v, r;
    `force` (A, 4, M) the mean commands and rudder over each STEP after it; `reached` (A, 3, H)."""

    run: NDArray[np.int64]
    time: Floats
    state: Floats
    force: Floats
    reached: Floats


def states_of(runs: Sequence[Run]) -> States:
    """States every second of all runs that have the longest horizon left."""
    return States(*map(np.array, zip(*((i, *state) for i, run in enumerate(runs) for state in _states(run)))))


def _states(run: Run) -> Iterator[tuple[float, Floats, Floats, Floats]]:
    rudder = run.extras.get("rudder", np.zeros(len(run)))
    forces = [*(np.asarray(run.extras[name]) for name in ("force_X", "force_Y")), run.command, rudder]
    speeds = [np.asarray(run.channel(name)) for name in ("surge", "sway")]
    logged = [(run.time[np.isfinite(speed)], speed[np.isfinite(speed)]) for speed in speeds]
    for begin in np.arange(run.time[0] + BEFORE, run.time[-1] - HORIZONS[-1], 1.0):
        k = int(np.searchsorted(run.time, begin))
        heading, rate = causal_state(run, k)
        now = []
        for clock, speed in logged:
            first, stop = np.searchsorted(clock, [run.time[k] - BEFORE, run.time[k] + 1e-9])
            near = slice(first, stop)
            enough = stop - first > 3
            now.append(polyfit(clock[near] - run.time[k], speed[near], 1)[0] if enough else speed[max(stop - 1, 0)])
        ends = run.time[k] + np.array(HORIZONS)
        reached = [np.interp(ends, run.time, run.position), *(np.interp(ends, *each) for each in logged)]
        force = np.array([mean_force(run, k, each)[1] for each in forces])
        yield run.time[k] - run.time[0], np.array([heading, *now, rate]), force, np.array(reached)


def ahead(values: Mapping[str, float], states: States, last: float = HORIZONS[-1]) -> Floats:
    """Heading, u and v at the horizons, (A, 3, H), by Heun's method."""
    m, drags, cross = _model(values)
    inverse = np.linalg.inv(m)
    steering = {name: values.get(name, 0.0) for name in STEERING}

    def rates(state: Floats, commands: Floats) -> Floats:
        v, force, rudder = state[:, 1:], commands[:, :3].copy(), commands[:, 3]
        passing = v[:, 0] * np.abs(v[:, 0])
        force[:, 0] -= steering["X_deltadelta"] * rudder**2 * passing
        force[:, 1] += rudder * (steering["Y_delta"] * passing + steering["Y_deltaX"] * commands[:, 0])
        force[:, 2] += rudder * (steering["N_delta"] * passing + steering["N_deltaX"] * commands[:, 0])
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
    return np.stack([shown[min(round(h / STEP), len(shown)) - 1] for h in HORIZONS], axis=2)


def _model(values: Mapping[str, float]) -> tuple[Floats, Floats, list[tuple[int, int | None, int, float]]]:
    """Inertia (3, 3), drags of each motion linear and quadratic (2, 3), other derivatives, from values by name."""
    m, drags, cross = np.zeros((3, 3)), np.zeros((2, 3)), []
    for name, value in values.items():
        if name in INERTIAS:
            m[INERTIAS[name], INERTIAS[name]] = value
        elif name == "m_vr":
            m[1, 2] = m[2, 1] = value
        elif name not in STEERING:
            letter, _, along = name.replace("k_", "N_").partition("_")
            row, places = "XYN".index(letter), ["uvr".index(each) for each in along]
            if set(places) == {row}:
                drags[len(places) - 1, row] = value
            else:
                cross.append((row, places[0] if len(places) > 1 else None, places[-1], value))
    return m, drags, cross


def fit_plain(
    states: States, start: Mapping[str, float], horizon: float, known: Mapping[str, float]
) -> dict[str, float]:
    """Least squares of heading and speeds `horizon` seconds ahead, all on the scale of what constants miss, beside
    parameters that are `known`."""
    column = HORIZONS.index(horizon)
    goal = states.reached[:, :, column]
    scale = np.sqrt(np.mean((goal - states.state[:, :3]) ** 2, axis=0))
    names = list(start)
    sizes = np.array([max(abs(start[name]), 1e-3) for name in names])
    above = np.isin(names, list(POSITIVE))

    def values(z: Floats) -> dict[str, float]:
        chosen = np.where(above, sizes * np.exp(np.clip(z, -SPAN, SPAN)), sizes * z).tolist()
        return {**known, **dict(zip(names, chosen))}

    def misses(z: Floats) -> Floats:
        return ((ahead(values(z), states, horizon)[:, :, column] - goal) / scale).ravel()

    solutions = []
    for shift in (-1.0, 0.0, 1.0):
        begin = np.where(above, shift * np.isin(names, list(INERTIAS)), [np.sign(start[name]) for name in names])
        solutions.append(least_squares(misses, begin, x_scale="jac", max_nfev=60))
    return values(min(solutions, key=lambda solution: float(solution.cost)).x)


def rms(errors: Floats) -> Floats:
    """Over the states: (3, H), headings in degrees."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)) * np.array([np.rad2deg(1.0), 1.0, 1.0])[:, None])


def tool_ahead(fit: PlanarFit, runs: Sequence[Run], states: States) -> Floats:
    """What the library predicts at the horizons from its filtered states, (A, 3, H)."""
    likelihood = PlanarLikelihood(tuple(runs), fit.observed, signals=fit.best.model.signals)
    problem, estimate = likelihood.problem(fit.best.model), fit.best.mixed
    course = likelihood.course
    followed = problem.follow(estimate.phi[None], keep=True)
    channels = [next(each for each in course.channels if each.quantity == name) for name in UNITS]
    noises = problem.noises(estimate.theta[None])
    at = predictions(problem.model, course, estimate.of_model, noises, followed, channels, states.run, states.time)
    return at(np.array(HORIZONS), None).transpose(1, 0, 2)


def runs_of(real_set: RealSet) -> list[Run]:
    """Its runs. The tanker's logged speeds lie along and across its first course; its thrust is what the MMG
    model of that ship has at the speed of approach."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if real_set.name != TANKER:
            columns = real_set.column_map(folder) or ColumnMap()
            return list(load_planar([str(real_set.path / real_set.glob)], columns).runs)
        for log in real_set.path.glob(real_set.glob):
            table = pd.read_csv(log)
            heading, along, across = np.deg2rad(table["heading_deg"]), table["u_mps"], table["v_mps"]
            cosine, sine = np.cos(heading), np.sin(heading)
            speeds = {"surge_m_s": along * cosine + across * sine, "sway_m_s": across * cosine - along * sine}
            table.assign(**speeds).drop(columns=["u_mps", "v_mps"]).to_csv(folder / log.stem, index=False)
        (folder / "columns.toml").write_text(TANKER_COLUMNS)
        return list(load_planar([folder], read_column_map(folder / "columns.toml")).runs)


def judged(item: tuple[RealSet, str]) -> Row:
    """The row of one half that is fitted: what a fit to it misses by on the other, beside least squares of its
    structure."""
    real_set, half = item
    runs = runs_of(real_set)
    fitted, held_out = real_set.halved(runs)[:: 1 if half == "A" else -1]
    begun = time.perf_counter()
    channels = observed(fitted)
    likelihood = PlanarLikelihood(tuple(fitted), channels, with_effects=SETS[real_set.name])
    tried = search(likelihood)
    fit = PlanarFit(tried, *likelihood.choose(tried), tuple(fitted), channels)
    learned, states = states_of(fitted), states_of(held_out)
    values, tied = fit.best.model.values, [name for name, _, _ in fit.best.model.ties]
    known, start = (
        {n.rpartition(".")[2]: values[n] for n in fit.estimates if (n in tied) is of and THRUSTER_LAG not in n}
        for of in (True, False)
    )  # the script's thrusters do not lag
    squares = [fit_plain(learned, start, h, known) for h in HORIZONS]
    least = [rms(ahead(values, states) - states.reached)[:, i] for i, values in enumerate(squares)]
    still = np.repeat(states.state[:, :3, None], len(HORIZONS), axis=2)
    going = still.copy()
    going[:, 0] += states.state[:, 3, None] * np.array(HORIZONS)
    row = {
        "set": real_set.name, "half": half, "structure": fit.structure,
        "parameters": {key: (estimate.value, *estimate.ci95) for key, estimate in fit.estimates.items()},
        "least_squares": squares[HORIZONS.index(5.0)],
        "tool": rms(tool_ahead(fit, held_out, states) - states.reached).tolist(),
        "least": np.stack(least, axis=1).tolist(),
        "constant": np.minimum(rms(still - states.reached), rms(going - states.reached)).tolist(),
        "says": list(fit.warnings), "seconds": round(time.perf_counter() - begun, 1),
    }  # fmt: skip
    print(f"{real_set.name}, planar, half {half}: {row['seconds']} s", file=sys.stderr, flush=True)
    return row


def table(rows: Sequence[Row]) -> Table:
    columns = {"now": "tool", "least squares": "least", "better constant": "constant"}
    lines = [
        {"data set": row["set"], "fitted half": row["half"], "of": f"{name}, {unit}",
         **{column: " / ".join(f"{x:.3g}" for x in row[key][i]) for column, key in columns.items()},
         "5 s: now / least squares": f"{row['tool'][i][1] / row['least'][i][1]:.2f}"}
        for row in rows
        for i, (name, unit) in enumerate(UNITS.items())
    ]  # fmt: skip
    return Table.of("Surge, sway and yaw together: errors 2 / 5 / 15 s ahead", lines)


def planar_items(only: str = "") -> list[tuple[RealSet, str]]:
    """Every half at hand that is fitted as a whole and has `only` in "set/planar"."""
    sets = {real_set.name: real_set for real_set, _ in present("")}.values()
    return [(each, half) for each in sets if each.name in SETS and only in f"{each.name}/planar" for half in "AB"]
