"""Coverage of the plane's parameters on closed loops: a twin-hull boat of 32 kg in surge and 53 in sway, added mass in
both, keeps a speed and turns to and fro, under a disturbance as large as a third of its thrust that lasts 8 s, with a
thrust that differs by 5 % from run to run and comes 0.1 s late. The controllers answer noisy readings. The equations
and the integrator (Heun) are of this file. Prints errors, their standard errors and how often 95 % intervals hold the
truth.

Usage: python tests/benchmarks/planar_loops.py [--campaigns N] [--rate HZ] [--seed N]
"""

import arguments
import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.fits.planar_fit import PlanarLikelihood
from automarine_cli.fits.planar_structure import observed
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

TRUTH = {"surge.m_u": 32.0, "sway.m_v": 53.0, "yaw.I_r": 6.9, "surge.X_uu": 25.0, "sway.Y_vv": 200.0, "yaw.k_rr": 10.0}
MASSES, DRAGS = np.array(list(TRUTH.values())).reshape(2, 3)
RUNS, DURATION_S, DELAY_S, SPEED_M_S = 10, 14.0, 0.1, 0.7
DISTURBANCE, LASTING_S = 0.3 * np.array([20.0, 10.0, 4.0]), 8.0  # N, N, N m
NOISE = {"heading": 0.0035, "yaw_rate": 0.01, "surge": 0.02, "sway": 0.02, "north": 0.01, "east": 0.01}
STEPS = 5  # of the integrator between two samples


def acceleration(velocity: Floats, force: Floats) -> Floats:
    (u, v, r), (m_u, m_v, _) = velocity, MASSES
    coriolis = np.array([-m_v * v * r, m_u * u * r, (m_v - m_u) * u * v])
    return np.asarray((force - DRAGS * np.abs(velocity) * velocity - coriolis) / MASSES)


def closed_loop(name: str, rate: float, random: np.random.Generator) -> Run:
    """One run of the boat under its two controllers, of surge speed and yaw rate."""
    count, step = int(DURATION_S * rate) + 1, 1.0 / rate
    time: Floats = np.arange(count) / rate
    late = round(DELAY_S * rate)
    noise = {quantity: size * random.standard_normal(count) for quantity, size in NOISE.items()}
    disturbance, gain = DISTURBANCE * random.standard_normal(3), 1.0 + 0.05 * random.standard_normal(3)
    rates = 0.4 * np.where(np.sin(2.0 * np.pi * time / random.uniform(6.0, 14.0)) < 0.0, -1.0, 1.0)
    commands, places, velocities = np.zeros((3, count, 3))
    place, velocity, summed = np.array([0.0, 0.0, random.uniform(-3.0, 3.0)]), np.zeros(3), np.zeros(2)
    for i in range(count):
        places[i], velocities[i] = place, velocity
        error = np.array([SPEED_M_S - velocity[0] - noise["surge"][i], rates[i] - velocity[2] - noise["yaw_rate"][i]])
        summed += step * error
        ahead = 60.0 * error[0] + 20.0 * summed[0] + DRAGS[0] * SPEED_M_S**2
        turning = 25.0 * error[1] + 10.0 * summed[1]
        commands[i] = np.clip(ahead, -40.0, 40.0), 0.0, np.clip(turning, -8.0, 8.0)
        thrust = gain * commands[i - late] if i >= late else np.zeros(3)
        for _ in range(STEPS):
            dt = step / STEPS
            pushes = np.sqrt(2.0 * dt / LASTING_S) * random.standard_normal(3)
            disturbance = (1.0 - dt / LASTING_S) * disturbance + DISTURBANCE * pushes
            first = acceleration(velocity, thrust + disturbance)
            after = velocity + 0.5 * dt * (first + acceleration(velocity + dt * first, thrust + disturbance))
            u, v, r = 0.5 * (velocity + after)
            cos, sin = np.cos(place[2]), np.sin(place[2])
            place, velocity = place + dt * np.array([cos * u - sin * v, sin * u + cos * v, r]), after
    logged = {"north": places[:, 0], "east": places[:, 1], "surge": velocities[:, 0], "sway": velocities[:, 1],
              "yaw_rate": velocities[:, 2]}  # fmt: skip
    extras = {quantity: values + noise[quantity] for quantity, values in logged.items()}
    extras |= {"force_X": commands[:, 0], "force_Y": commands[:, 1]}
    return Run(
        name, f"{name}.csv", time, np.asarray(places[:, 2] + noise["heading"]), commands[:, 2], "N m", extras, dof=YAW
    )


def errors(seed: int, rate: float) -> Floats:
    """Error and standard error, over the truth, and whether the interval holds it, of each parameter, (6, 3)."""
    random = np.random.default_rng(seed)
    runs = [closed_loop(f"run_{i}", rate, random) for i in range(RUNS)]
    channels = observed(runs)
    likelihood = PlanarLikelihood(tuple(runs), channels)
    estimates = likelihood.estimate(channels.simplest(likelihood.rough)).by_name
    rows = [(estimates[name], truth) for name, truth in TRUTH.items()]
    return np.array([(e.value / t - 1.0, e.stderr / t, e.ci95[0] <= t <= e.ci95[1]) for e, t in rows])


def main() -> None:
    settings = arguments.options(__doc__, campaigns=40, rate=20, seed=200)
    seeds = range(settings.seed, settings.seed + settings.campaigns)
    trials = np.stack([errors(seed, float(settings.rate)) for seed in seeds])
    for name, (error, stderr, holds) in zip(TRUTH, np.moveaxis(trials, 0, 2)):
        rms, bias = 100.0 * np.sqrt(np.mean(error**2)), 100.0 * np.mean(error)
        expected, coverage = 100.0 * np.median(stderr), 100.0 * np.mean(holds)
        print(
            f"{name}: rms {rms:.1f} %, bias {bias:+.1f} %, standard error {expected:.1f} %, coverage {coverage:.0f} %"
        )


if __name__ == "__main__":
    main()
