"""Runs of a vehicle with two thrusters whose commands are logged, of known gains: own equations, fine steps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import YAW
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.map import Curve, ThrusterMap

Floats = NDArray[np.float64]
Gains = tuple[float, float, float, float]

MAP = ThrusterMap("square", Curve(4.0), Curve(2.5))
ARM, INERTIA, K_RR = 0.25, 1.1, 1.3
FINE = 0.01  # s, of the integrator
PERIOD = 0.1  # s, of the log
NAMES = ("forward", "backward", "direction")


def gains_of(forward: float, backward: float, direction: float) -> Gains:
    """Of port forward and backward, starboard forward and backward; written out apart from the library."""
    return (
        (1 + direction) * (1 + forward),
        (1 - direction) * (1 + backward),
        (1 + direction) * (1 - forward),
        (1 - direction) * (1 - backward),
    )


def plans(count: int, seed: int) -> list[list[tuple[float, float, float]]]:
    """Runs of four stretches each of (n_port, n_stbd, seconds): spins, single thrusters, way on, coasting."""
    random = np.random.default_rng(seed)
    found = []
    for i in range(count):
        size = random.uniform(0.3, 1.0, 4) * np.where(random.random(4) < 0.5, 1.0, -1.0)
        kinds = ((1, -1), (1, 0), (0, 1), (1, 0.5), (0.4, 1), (1, -0.3))
        chosen = [kinds[k] for k in random.permutation(len(kinds))[:3]]
        run = [(p * s, q * s, random.uniform(3.0, 6.0)) for (p, q), s in zip(chosen, size)]
        found.append([(0.0, 0.0, 1.5), *run, *([(0.0, 0.0, 4.0)] if i % 2 else [])])
    return found


def spins(count: int, seed: int) -> list[list[tuple[float, float, float]]]:
    """Runs in which both thrusters turn equally fast, opposite ways."""
    random = np.random.default_rng(seed)
    sizes = random.uniform(0.3, 1.0, (count, 2)) * np.where(random.random((count, 2)) < 0.5, 1.0, -1.0)
    return [[(0.0, 0.0, 1.5), (a, -a, 6.0), (b, -b, 5.0)] for a, b in sizes]


def twin(
    plans: Sequence[Sequence[tuple[float, float, float]]],
    gains: Gains = (1.0, 1.0, 1.0, 1.0),
    *,
    seed: int = 0,
    noise_deg: float = 0.5,
    scatter: float = 0.02,
    bias: float = 0.0,
    asymmetry: float = 0.0,
    width: float = 0.0,
    limit: float = np.inf,
) -> list[Run]:
    """The runs as logged, with headings and thruster commands, without a moment."""
    random, found = np.random.default_rng(seed), []
    for number, plan in enumerate(plans):
        ends = np.cumsum([seconds for *_, seconds in plan])
        late = random.uniform(0.0, PERIOD)  # the commands change somewhere between two samples
        fine = np.arange(0.0, ends[-1] - PERIOD, FINE)
        which = np.searchsorted(ends, fine + late, side="right")
        port, stbd = (np.array([one[k] for one in plan])[which] for k in (0, 1))
        thrust = [
            np.where(n > 0, 4.0 * g * n**2, -2.5 * h * n**2) for n, g, h in ((port, *gains[:2]), (stbd, *gains[2:]))
        ]
        thrust = [  # dead-band and limit [N m] of each thruster by itself
            np.sign(f) * np.minimum(np.maximum(np.abs(f) - width / ARM, 0.0), limit / ARM) for f in thrust
        ]
        tau = ARM * (thrust[0] - thrust[1]) * np.exp(scatter * random.standard_normal())
        tau = tau * (1.0 + asymmetry * np.sign(tau)) + bias
        heading, rate = np.zeros(len(fine)), 0.0
        for m in range(len(fine) - 1):
            middle = rate + 0.5 * FINE * (tau[m] - K_RR * abs(rate) * rate) / INERTIA
            heading[m + 1] = heading[m] + FINE * middle
            rate += FINE * (tau[m] - K_RR * abs(middle) * middle) / INERTIA
        every = round(PERIOD / FINE)
        shown = (
            random.uniform(-3, 3)
            + heading[::every]
            + np.deg2rad(noise_deg) * random.standard_normal(len(heading[::every]))
        )
        extras = {"n_port": port[::every], "n_stbd": stbd[::every]}
        name = f"twin_{number:02d}"
        time = 60.0 * number + fine[::every]
        found.append(Run(name, f"{name}.csv", time, shown, None, "", extras, dof=YAW))
    return found


def swapped(run: Run) -> Run:
    """The same run in the mirror: the thrusters change places."""
    extras = {"n_port": run.extras["n_stbd"], "n_stbd": run.extras["n_port"]}
    return replace(run, position=-run.position, extras=extras)
