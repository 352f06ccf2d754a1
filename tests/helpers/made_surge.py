"""Steps ahead and astern of a vehicle in water that pushes it, by an integrator that is not the library's."""

import numpy as np

from automarine_cli.dofs import SURGE
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

MASS, LINEAR, QUADRATIC = 28.0, 6.0, 25.0  # kg, N s/m, N s²/m²
THRUSTS = (6.0, 10.0, 15.0, 20.0, 26.0, 32.0, 40.0, 50.0)  # N
REST_S, RUN_S, PERIOD_S, INNER_S = 2.0, 14.0, 0.1, 0.01
MEMORY_S = 5.0  # of the force that wanders
NOISES = (0.02, 0.01)  # of distance [m] and speed [m/s]


def steps(seed: int, push: float = 0.0, cubic: float = 0.0) -> list[Run]:
    """Each thrust ahead and astern from rest, beside a force that wanders by `push` [N] and a cubic drag [N s³/m³]."""
    random = np.random.default_rng(seed)
    thrust = np.array([*THRUSTS, *(-thrust for thrust in THRUSTS)])
    time, inner = np.arange(0.0, RUN_S, PERIOD_S), round(PERIOD_S / INNER_S)
    fade = np.exp(-INNER_S / MEMORY_S)
    force, distance, speed = push * random.standard_normal(len(thrust)), 0.0 * thrust, 0.0 * thrust
    distances, speeds = np.zeros((2, len(thrust), len(time)))

    def slope(speed: Floats, commanded: Floats) -> Floats:
        drag = LINEAR * speed + QUADRATIC * np.abs(speed) * speed + cubic * speed**3
        return np.asarray((commanded + force - drag) / MASS)

    for k in range(len(time)):
        distances[:, k], speeds[:, k] = distance, speed
        commanded = thrust * (k * PERIOD_S > REST_S - 1e-9)
        for _ in range(inner):
            first = slope(speed, commanded)
            second = slope(speed + 0.5 * INNER_S * first, commanded)
            third = slope(speed + 0.5 * INNER_S * second, commanded)
            fourth = slope(speed + INNER_S * third, commanded)
            distance = distance + INNER_S * (speed + INNER_S / 6.0 * (first + second + third))
            speed = speed + INNER_S / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
            force = fade * force + np.sqrt(1.0 - fade**2) * push * random.standard_normal(len(thrust))
    distances += NOISES[0] * random.standard_normal(distances.shape)
    speeds += NOISES[1] * random.standard_normal(speeds.shape)
    return [
        Run(
            f"run_{i:02d}", "made", time + 40.0 * i, distances[i], np.where(time > REST_S - 1e-9, thrust[i], 0.0), "N",
            extras={"surge": speeds[i]}, dof=SURGE,
        )
        for i in range(len(thrust))
    ]  # fmt: skip
