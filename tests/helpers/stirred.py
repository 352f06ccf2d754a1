"""Steps with their coast-downs in stirred water, by an integrator of its own, and what late or wrong sensors read."""

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.runs.run import Run

INERTIA, K_R, K_RR, LARGEST = 4.2, 1.1, 6.5, 4.5  # N m s², N m s, N m s², N m
SHARES = (0.12, 0.25, 0.5, 0.8)
STEP_S, STIRRED_S = 0.002, 8.0
ON_S, OFF_S, END_S = 2.0, 14.0, 22.0


def steps_in_water(
    push: float = 0.0, *, constant: float = 0.0, thrust_lag: float = 0.0, heading_late: float = 0.0,
    gyro_late: float = 0.0, gyro_scale: float = 1.0, gyro_bias: float = 0.0, seed: int = 1, period: float = 0.1,
) -> list[Run]:  # fmt: skip
    """Two runs of each moment to either side; a moment of standard deviation `push` [N m] that lasts STIRRED_S acts on
    them, and a `constant` one, from a second before the log on. Thrust takes `thrust_lag` [s], of first order. Switches
    come with a sample."""
    rng = np.random.default_rng(seed)
    size = LARGEST * np.repeat([side * share for share in SHARES for side in (1.0, -1.0)], 2)
    time = STEP_S * np.arange(round(END_S / STEP_S) + 1)
    on = (time > ON_S - 1e-9) & (time < OFF_S - 1e-9)
    heading, rate = np.zeros((2, len(time), len(size)))
    heading[0] = rng.uniform(-np.pi, np.pi, len(size))
    pushing, thrust = push * rng.standard_normal(len(size)), np.zeros(len(size))
    fade = np.exp(-STEP_S / STIRRED_S)
    for k in range(len(time) - 1):
        late = np.exp(-STEP_S / thrust_lag) if thrust_lag else 0.0
        thrust = late * thrust + (1.0 - late) * size * on[k]

        def pull(r: np.ndarray, acts: np.ndarray = thrust + pushing + constant) -> np.ndarray:
            return (acts - K_R * r - K_RR * r * np.abs(r)) / INERTIA

        middle = rate[k] + 0.5 * STEP_S * pull(rate[k])
        rate[k + 1] = rate[k] + STEP_S * pull(middle)
        heading[k + 1] = heading[k] + STEP_S * middle
        pushing = fade * pushing + push * np.sqrt(1.0 - fade**2) * rng.standard_normal(len(size))
    read, runs = np.arange(1.0, END_S - 1.0, period), []
    for i, of_run in enumerate(size):
        angle, speed = (
            np.interp(read - late, time, of[:, i]) for of, late in ((heading, heading_late), (rate, gyro_late))
        )
        noise = np.deg2rad([[0.3], [0.4]]) * rng.standard_normal((2, len(read)))
        command = np.where((read > ON_S - 1e-9) & (read < OFF_S - 1e-9), of_run, 0.0)
        extras = {"yaw_rate": gyro_scale * speed + gyro_bias + noise[1]}
        runs.append(Run(f"run_{i:02d}", "made.csv", 60.0 * i + read, angle + noise[0], command, "N m", extras, dof=YAW))
    return runs


def controlled(
    thrust_lag: float = 0.0, delay: float = 0.0, seed: int = 1, noise: float = 0.3, gyro: bool = True,
    length: float = 60.0,
) -> list[Run]:  # fmt: skip
    """Eight runs of `length` [s] in which a controller holds headings that change every eight seconds, by noisy sensors
    at 10 Hz and in slow pushes; commands act `delay` [s] late, thrust takes `thrust_lag` [s]. Without a `gyro` it
    filters differences of the headings, whose `noise` is in degrees."""
    rng, step, period, count = np.random.default_rng(seed), 0.01, 0.1, 8
    heading, rate, thrust = rng.uniform(-1.0, 1.0, count), np.zeros(count), np.zeros(count)
    pushing, wanted, fade = 0.1 * rng.standard_normal(count), heading.copy(), np.exp(-step / STIRRED_S)
    follows = -np.expm1(-step / thrust_lag) if thrust_lag else 1.0
    waiting, logged = [np.zeros(count)] * round(delay / step), []
    for k in range(round(length / step)):
        if k % round(8.0 / step) == 0:
            wanted = heading + rng.uniform(-1.5, 1.5, count)
        if k % round(period / step) == 0:
            angle, measured = (
                x + np.deg2rad(n) * rng.standard_normal(count) for x, n in ((heading, noise), (rate, 0.4))
            )
            last = logged[-1] if logged else (angle, 0.0 * angle)
            speed = measured if gyro else last[1] + 0.4 * ((angle - last[0]) / period - last[1])
            command = np.clip(4.0 * (wanted - angle) - 3.0 * speed, -LARGEST, LARGEST)
            logged.append((angle, speed, command))
        waiting.append(command)
        thrust = thrust + follows * (waiting.pop(0) - thrust)
        pushing = fade * pushing + 0.1 * np.sqrt(1.0 - fade**2) * rng.standard_normal(count)
        rate = rate + step * (thrust + pushing - K_R * rate - K_RR * rate * np.abs(rate)) / INERTIA
        heading = heading + step * rate
    angles, speeds, commands = np.array(logged).transpose(1, 2, 0)
    time = period * np.arange(len(logged))
    return [
        Run(
            f"run_{i:02d}",
            "made.csv",
            100.0 * i + time,
            angles[i],
            commands[i],
            "N m",
            {"yaw_rate": speeds[i]} if gyro else {},
            dof=YAW,
        )
        for i in range(count)
    ]
