"""Dives of which the wishes are known: what a vehicle's software makes of them, motor by motor, and its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from vehicle_logs import Dive, dive

from automarine_cli.logs.mixing import FRAMES

Floats = NDArray[np.float64]
WISHED = ("tau", "X", "Y", "Z")
DIRECTIONS = (-1, -1, 1, 1, -1, 1, 1, -1)  # of a BlueROV2 Heavy as it is delivered


def wishes(count: int, seed: int, most: float = 0.3) -> dict[str, Floats]:
    """Random wishes of every motion, small enough that no motor comes to its end; roll and pitch as well."""
    drawn = np.random.default_rng(seed).uniform(-most, most, (6, count))
    drawn[4:] /= 4
    return dict(zip((*WISHED, "roll", "pitch"), drawn))


def mixed(wished: Mapping[str, Floats], frame: int, directions: Sequence[int] = DIRECTIONS) -> Floats:
    """What ArduSub's `output_armed_stabilizing` and `calc_thrust_to_pwm` send [us], shape (8, N); 0: no motor."""
    none = np.zeros(len(wished["tau"]))
    out = np.zeros((8, len(none)))
    for motor, (roll, pitch, yaw, up, ahead, abeam) in enumerate(FRAMES[frame][1]):
        thrust = roll * wished.get("roll", none) + pitch * wished.get("pitch", none) + yaw * wished["tau"]
        thrust = thrust - up * wished.get("Z", none) + ahead * wished.get("X", none) + abeam * wished.get("Y", none)
        out[motor] = np.clip(np.trunc(1500 + 400 * np.clip(directions[motor] * thrust, -1, 1)), 1100, 1900)
    return out


def sub_parameters(frame: int, directions: Sequence[int] = DIRECTIONS) -> dict[str, float]:
    """The parameters of ArduSub that have a part in it."""
    count = len(FRAMES.get(frame, FRAMES[2])[1])
    told = {"FRAME_CONFIG": float(frame)}
    told |= {f"SERVO{n}_FUNCTION": 32.0 + n if n <= count else 0.0 for n in range(1, 9)}
    return told | {f"MOT_{n}_DIRECTION": float(directions[n - 1]) for n in range(1, count + 1)}


def told(parameters: Mapping[str, float], at: float = 0.6) -> tuple[tuple[float, str, float], ...]:
    """Parameters as a dive tells them, all at one time."""
    return tuple((at, name, value) for name, value in parameters.items())


def sub_dive(wished: Mapping[str, Floats], frame: int = 2, **changed: float) -> Dive:
    """The dive of `vehicle_logs` with the outputs of these wishes and the parameters that belong to them."""
    first = dive()
    return replace(first, outputs=mixed(wished, frame), parameters=told(sub_parameters(frame) | changed))


def stepped(seed: int, mirrored: bool = False) -> tuple[Dive, Floats]:
    """Steps to both sides over four minutes by a known yaw model, and the commanded moment; wishes beside it."""
    draw = np.random.default_rng(seed)
    levels = draw.permutation([0.15, -0.15, 0.25, -0.25, 0.35, -0.35, 0.45, -0.45]) * (-1 if mirrored else 1)
    time, k_rr, I_r = np.arange(0, 240, 0.1), 1.2, 0.8
    tau = np.where(time % 30 < 20, levels[(time // 30).astype(int)], 0.0)
    tau = np.trunc(400 * tau) / 400
    rate = np.zeros(len(time))
    heading = np.zeros(len(time))
    for i in range(1, len(time)):
        r, psi = rate[i - 1], heading[i - 1]
        for _ in range(20):
            mid = r + 0.0025 * (tau[i - 1] - k_rr * r * abs(r)) / I_r
            r, psi = r + 0.005 * (tau[i - 1] - k_rr * mid * abs(mid)) / I_r, psi + 0.005 * mid
        rate[i], heading[i] = r, psi
    noise = draw.normal(0, 0.05, len(time))
    wished = {"tau": tau, "X": 0.2 * np.sin(time / 7), "Y": 0 * time, "Z": 0.1 * np.cos(time / 5)}
    made = Dive(
        time + 1, np.rad2deg(heading) + noise, np.rad2deg(rate), time + 1, 0 * time, 0 * time, time[::5] + 1,
        16 + 0 * time[::5], outputs=mixed(wished, 2), parameters=told(sub_parameters(2)),
        modes=((0.5, 19),), arming=((0.5, False), (0.8, True)),
    )  # fmt: skip
    return made, tau
