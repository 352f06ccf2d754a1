"""Where fits of surge, sway and yaw start: velocities, sizes and the balance of momentum, as logs show them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from automarine_cli import effects
from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW
from automarine_cli.effects import Commands
from automarine_cli.fits.driven import STEERING_GEAR
from automarine_cli.fits.planar_structure import DECAY_S, NORTH_EAST, OWN, is_read
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run, filled

SLOPE_WINDOW_S = 1.0  # s over which velocities are told from positions


def rough_velocities(run: Run) -> dict[str, Floats]:
    """Surge, sway [m/s] and yaw rate [rad/s] of a run, each (N,): as read, else from places and heading over
    `SLOPE_WINDOW_S`; NaN where neither tells."""
    velocities: dict[str, Floats] = {}
    if is_read(run, YAW.position):
        velocities[YAW.velocity] = _slope(run.time, run.position)
    if all(is_read(run, name) for name in NORTH_EAST):
        north, east = (_slope(run.time, np.asarray(run.channel(name))) for name in NORTH_EAST)
        cosine, sine = np.cos(run.position), np.sin(run.position)
        velocities[SURGE.velocity] = cosine * north + sine * east
        velocities[SWAY.velocity] = cosine * east - sine * north
    for dof in PLANAR.dofs:
        if is_read(run, dof.velocity):
            velocities[dof.velocity] = np.asarray(run.channel(dof.velocity))
    return velocities


def _slope(time: Floats, values: Floats) -> Floats:
    """Central difference over `SLOPE_WINDOW_S`, (N,)."""
    finite = np.isfinite(values)
    ahead, behind = (np.clip(time + side * SLOPE_WINDOW_S / 2, time[0], time[-1]) for side in (1, -1))
    there, back = (np.interp(at, time[finite], values[finite]) for at in (ahead, behind))
    return np.asarray((there - back) / np.maximum(ahead - behind, 1e-9))


RUDDER_ARM_M = 0.1  # m


def rough_sizes(runs: Sequence[Run]) -> dict[str, float]:
    """Orders of size from which fits start, by qualified name: drag that balances the usual force at the usual
    velocity, and an inertia that takes `DECAY_S` to get there; `by_momentum` is nearer where velocities are known."""
    sizes: dict[str, float] = {}
    for dof in PLANAR.dofs:
        forces = np.concatenate([run.command_of(dof) for run in runs])
        columns = [v[dof.velocity] for run in runs if dof.velocity in (v := rough_velocities(run))]
        speeds = np.abs(np.concatenate(columns)) if columns else np.zeros(0)
        speeds = speeds[np.isfinite(speeds)]
        speed = max(float(np.quantile(speeds, 0.9)) if len(speeds) else 0.0, dof.limits.unmoved)
        force = float(np.sqrt(np.mean(forces**2)))
        if force == 0.0 and dof is YAW:  # by a rudder: as much as the thrust ahead gives at a small arm
            force = RUDDER_ARM_M * float(np.sqrt(np.mean(np.concatenate([r.command_of(SURGE) for r in runs]) ** 2)))
        linear = max(force, 1e-3) / speed
        sizes |= {
            dof.parameter("linear"): linear,
            dof.parameter("quadratic"): linear / speed,
            dof.parameter("inertia"): linear * DECAY_S,
        }
    for dof, other in ((SURGE, SWAY), (SWAY, SURGE)):
        if not any(run.command_of(dof).any() for run in runs):  # moved by the others alone
            for role in ("linear", "quadratic", "inertia"):
                sizes[dof.parameter(role)] = sizes[other.parameter(role)]
    return sizes


MOMENTUM_S = 5.0  # over which what forces sum up to is compared with the change of momentum
HULL_KG_M3 = 10.0  # mass with added mass, ahead, over the cube of the length, as of tankers and of slender AUVs


def usual_gyration(ahead: float) -> float:
    """Square of the radius of gyration in yaw [m²], for the mass abeam, of a hull of usual proportions: a quarter of
    the length, which follows from the mass ahead [kg] (a 7 m model of a tanker: 3.1 for 2.8)."""
    return ((ahead / HULL_KG_M3) ** (1.0 / 3.0) / 4.0) ** 2


def by_momentum(runs: Sequence[Run], names: Sequence[str]) -> dict[str, float]:
    """Values from which fits start of those parameters of a model that are called `names`, by least squares; without
    motions whose inertia, and without drags that, come out below zero.

    Over windows of `MOMENTUM_S` the forces sum up to the change of momentum, in axes that turn, and to what drag,
    couplings and rudder take. Motions with a logged force come first; the others take their inertias as known. Where no
    moment is logged the inertia is that of usual proportions.
    """
    balances, sizes = [momentum_balance(run) for run in runs], dict[str, float]()
    driven = {dof.name: any(run.command_of(dof).any() for run in runs) for dof in PLANAR.dofs}
    for dof in sorted(PLANAR.dofs, key=lambda dof: not driven[dof.name]):
        own, inertia = f"{dof.name}.", dof.parameter("inertia")
        if dof is YAW and not driven[dof.name] and (ahead := sizes.get(SURGE.parameter("inertia"))):
            sizes[inertia] = sizes.get(SWAY.parameter("inertia"), ahead) * usual_gyration(ahead)
        columns = {name: np.concatenate([each[dof.name][name] for each in balances]) for name in balances[0][dof.name]}
        force = columns.pop(dof.command) - sum(sizes[name] * columns[name] for name in columns if name in sizes)
        if not (free := [name for name in columns if name in names and name not in sizes]):
            continue
        solution = np.linalg.lstsq(np.stack([columns[name] for name in free], axis=1), force)[0].tolist()
        values = {name: value for name, value in zip(free, solution) if value > 0 or name not in OWN}
        if inertia in sizes or inertia in values:
            sizes |= {name: value for name, value in values.items() if name.startswith(own)}
    return sizes


def momentum_balance(run: Run) -> dict[str, dict[str, Floats]]:
    """Sums over each window of a run, (W,), for surge, sway and yaw: what parameters multiply, by qualified name, and
    the command. A velocity that is not read counts as zero."""
    rough, time = rough_velocities(run), run.time
    u, v, r = (filled(time, rough.get(dof.velocity, 0.0 * time)) for dof in PLANAR.dofs)
    length = min(MOMENTUM_S, time[-1] - time[0])
    first = np.searchsorted(time, np.arange(time[0], time[-1] - 0.999 * length, 0.5 * length))
    last = np.minimum(np.searchsorted(time, time[first] + length), len(time) - 1)

    def over(values: Floats) -> Floats:
        total = cumulative_trapezoid(values, time, initial=0.0)
        return np.asarray(total[last] - total[first])

    rudder, passing = np.asarray(run.extras.get("rudder", 0.0 * time)), u * np.abs(u)
    steering = -over(rudder * passing)
    balances = {
        SURGE.name: {
            "surge.m_u": u[last] - u[first], "sway.m_v": -over(v * r), "surge.X_uu": over(passing),
            "surge.rudder-drag.X_deltadelta": over(rudder**2 * passing),
        },
        SWAY.name: {
            "surge.m_u": over(u * r), "sway.m_v": v[last] - v[first], "sway.Y_vv": over(v * np.abs(v)),
            "sway.rudder.Y_delta": steering,
        },
        YAW.name: {
            "surge.m_u": -over(u * v), "sway.m_v": over(u * v), "yaw.I_r": r[last] - r[first],
            "yaw.k_rr": over(r * np.abs(r)), "yaw.rudder.N_delta": steering, "yaw.N_ur": over(np.abs(u) * r),
            "yaw.N_v": over(v), "yaw.N_uv": over(np.abs(u) * v),
        },
    }  # fmt: skip
    return {dof.name: {**balances[dof.name], dof.command: over(run.command_of(dof))} for dof in PLANAR.dofs}


def unbalanced(runs: Sequence[Run], sizes: Mapping[str, float]) -> float:
    """Sum over sway and yaw of the logarithm of the mean square of what momenta leave over by these `sizes` of
    parameters, as a share of all that goes in; infinity where these are none."""
    balances, total = [momentum_balance(run) for run in runs], 0.0
    for dof in (SWAY, YAW):
        columns = {name: np.concatenate([b[dof.name][name] for b in balances]) for name in balances[0][dof.name]}
        force = columns.pop(dof.command)
        parts = np.stack([sizes.get(name, 0.0) * column for name, column in columns.items()])
        left_over, size = np.mean((force - parts.sum(axis=0)) ** 2), np.mean(np.abs(parts).sum(axis=0) ** 2)
        total += float(np.log(left_over / size)) if size > 0 and left_over > 0 else np.inf
    return total


def put_over(run: Run, gear: tuple[float, ...]) -> Run:
    """The run with the angle that a steering gear gives its rudder."""
    angle, length = run.extras["rudder"], np.diff(run.time, append=run.time[-1])
    commands = Commands(
        angle[None, None], run.time[None, None], length[None, None], angle[None, :1], np.zeros((1, 1)), {}
    )
    values = tuple(np.full((1, 1, 1), value) for value in gear)
    return replace(run, extras={**run.extras, "rudder": effects.get(STEERING_GEAR).deliver(commands, values)[0, 0]})
