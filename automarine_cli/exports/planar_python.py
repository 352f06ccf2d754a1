"""Plain Python of a planar model: one file with numpy that simulates surge, sway and yaw together, as we do."""

from automarine_cli.exports.base import Written, commented, number
from automarine_cli.exports.planar import MEANING, PlanarSubject
from automarine_cli.models.planar import VELOCITIES

FILE = '''{head}import numpy as np

M = np.array([{inertia}])  # kg, kg m, kg m^2: rigid and added together
CURRENT = {current}  # m/s north, east: the water of the runs
{constants}

def simulate(time, X, Y, N, north=0.0, east=0.0, psi=0.0, u=0.0, v=0.0, r=0.0, current=CURRENT):
    """Positions (north, east [m], psi [rad]) and velocities over ground (u, v [m/s], r [rad/s]) at `time` [s], (n, 3)
    both, under forces `X`, `Y` [N] and a moment `N` [N m], all (n,).

    Element i of a command holds from time[i] to time[i + 1]. {axes}
    """
    time = np.asarray(time, float)
    tau = np.stack([np.broadcast_to(np.asarray(one, float), time.shape) for one in (X, Y, N)], axis=1)
    inverse = np.linalg.inv(M)

    def water(psi):
        c, s = np.cos(psi), np.sin(psi)
        return np.array([{water}, 0.0])

    def slope(state, force):
        psi, (u, v, r) = state[2], state[3:]
        p = M @ state[3:]
        c_nu = np.array([-p[1] * r, p[0] * r, p[1] * u - p[0] * v])
        drag = np.array([
{drags}
        ])
        ground = state[3:] + water(psi)
        c, s = np.cos(psi), np.sin(psi)
        moved = np.array([{moved}, ground[2]])
        return np.concatenate([moved, inverse @ (force - c_nu - drag)])

    state = np.array([north, east, psi, u, v, r], float)
    state[3:] -= water(psi)
    found = [state]
    for i in range(len(time) - 1):
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / {step})))
        h = (time[i + 1] - time[i]) / steps
        for _ in range(steps):
            a = slope(state, tau[i])
            b = slope(state + h / 2 * a, tau[i])
            c = slope(state + h / 2 * b, tau[i])
            state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c, tau[i]))
        found.append(state)
    found = np.array(found)
    over_ground = np.array([row[3:] + water(row[2]) for row in found])
    return found[:, :3], over_ground
'''
STEP = 0.02  # s: the longest step of the integrator
AXES = {
    "NED": "u ahead, v to starboard, r clockwise; psi clockwise from north.",
    "ENU": "u ahead, v to port, r anticlockwise; psi anticlockwise from east.",
}
WATER = {
    "NED": "c * current[0] + s * current[1], c * current[1] - s * current[0]",
    "ENU": "c * current[1] + s * current[0], c * current[0] - s * current[1]",
}
MOVED = {
    "NED": "c * ground[0] - s * ground[1], s * ground[0] + c * ground[1]",
    "ENU": "s * ground[0] + c * ground[1], c * ground[0] - s * ground[1]",
}
"""Rates of north and east by the velocities in the vehicle's axes."""


def write(subject: PlanarSubject) -> Written:
    """The text of the file."""
    rows = [", ".join(number(one) for one in line) for line in subject.inertia]
    sums: list[list[str]] = [[], [], []]
    constants = []
    for name, places, value in subject.drags():
        along = VELOCITIES[places[-1]]
        size = f" * abs({VELOCITIES[places[1]]})" if len(places) == 3 else ""
        sums[places[0]].append(f"{name.upper()}{size} * {along}")
        constants.append(f"{name.upper()} = {number(value)}  # {MEANING.get(name, 'coupling')}")
    for i, value in enumerate(subject.constant.tolist()):
        if value:
            sums[i].append(f"- {'XYN'[i]}_0")
            constants.append(f"{'XYN'[i]}_0 = {number(value)}  # always acts")
    drags = "\n".join(f"            {_sum(one)}," for one in sums)
    north, east = subject.water or (0.0, 0.0)
    text = FILE.format(
        head=commented(subject.head(), "#"),
        inertia=", ".join(f"[{row}]" for row in rows),
        current=f"({number(north)}, {number(east)})",
        constants="\n".join(constants) + "\n" * bool(constants),
        drags=drags,
        step=number(STEP),
        axes=AXES[subject.frame],
        water=WATER[subject.frame],
        moved=MOVED[subject.frame],
    )
    return Written(text, subject.about_water())


def _sum(parts: list[str]) -> str:
    """A sum of terms, some of which bring their sign along."""
    return " + ".join(parts).replace("+ - ", "- ") or "0.0"
