"""Dives of which the wishes are known: what a vehicle's software makes of them, motor by motor, and its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from vehicle_logs import Dive, dive

from automarine_cli.logs.mixing import FRAME_MIXING
from automarine_cli.quantities import Floats

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
    for motor, (roll, pitch, yaw, up, ahead, abeam) in enumerate(FRAME_MIXING[frame][1]):
        thrust = roll * wished.get("roll", none) + pitch * wished.get("pitch", none) + yaw * wished["tau"]
        thrust = thrust - up * wished.get("Z", none) + ahead * wished.get("X", none) + abeam * wished.get("Y", none)
        out[motor] = np.clip(np.trunc(1500 + 400 * np.clip(directions[motor] * thrust, -1, 1)), 1100, 1900)
    return out


def sub_parameters(frame: int, directions: Sequence[int] = DIRECTIONS) -> dict[str, float]:
    """The parameters of ArduSub that have a part in it."""
    count = len(FRAME_MIXING.get(frame, FRAME_MIXING[2])[1])
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
