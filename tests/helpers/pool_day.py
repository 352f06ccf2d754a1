"""A day at the pool as somebody else would bring it home: a bollard table in pulses, step runs of a spreadsheet with
semicolons, decimal commas and dates. The vehicle is known; it is integrated here, by no code of the tool."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
INERTIA, QUADRATIC, ARM = 0.71, 1.1, 0.22  # N m s², N m s², m
NEUTRAL, REACH = 1500, 400  # us
STEPS = (60, 120, 180, 240, 300, 360)  # us off neutral
BEGINS = datetime(2024, 5, 3, 14, 0, 20)


def thrust(pulse: Floats | float) -> Floats:
    """Thrust [N] of one thruster by its pulse [us]: a dead band, more ahead than astern."""
    effort = (np.asarray(pulse, dtype=float) - NEUTRAL) / REACH
    size = np.maximum(np.abs(effort) - 0.06, 0.0) ** 1.8
    return np.sign(effort) * np.where(effort > 0, 50.0, 38.0) * size


def write_pool_day(folder: Path, seed: int = 1) -> Path:
    """Write the day's files into `folder`."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    _write_bollard(folder / "bollard_T200.csv", rng)
    for number, (size, way) in enumerate((size, way) for size in STEPS for way in (1, -1)):
        _write_run(folder / f"run_{number:02d}.csv", way * size, 60.0 * number, rng)
    return folder


def _write_bollard(path: Path, rng: np.random.Generator) -> None:
    """Two seconds at each of 17 pulses; the speed is logged without its sign."""
    lines, time = ["Time (s),PWM_us,rpm,Load_N,Voltage"], 0.0
    for pulse in range(NEUTRAL - REACH, NEUTRAL + REACH + 1, 50):
        for _ in range(40):
            rpm, load = abs(pulse - NEUTRAL) * 9 + rng.normal(0, 5), float(thrust(pulse)) + rng.normal(0, 0.3)
            lines.append(f"{time:.2f},{pulse},{abs(rpm):.0f},{load:.3f},{15.8 + rng.normal(0, 0.02):.2f}")
            time += 0.05
    path.write_text("\n".join(lines) + "\n")


def _write_run(path: Path, off: int, clock: float, rng: np.random.Generator) -> None:
    """One step from rest, until the vehicle has turned by about two thirds of a turn."""
    port, starboard = NEUTRAL + off, NEUTRAL - off
    moment = ARM * float(thrust(port) - thrust(starboard))
    time = np.arange(0.03, 13.9, 0.1)
    heading = np.rad2deg(_turned(moment, time)) + 360 * rng.uniform() + rng.normal(0, 0.8, len(time))
    last = int(np.argmax(np.abs(heading - heading[0]) > 230)) or len(time)
    rows = []
    for at, angle in zip(time[:last], heading[:last]):
        stamp = BEGINS + timedelta(seconds=clock + float(at))
        sent = (port, starboard) if at > 2 else (NEUTRAL, NEUTRAL)
        rows.append(
            f"{stamp:%d.%m.%Y %H:%M:%S},{stamp.microsecond // 1000:03d};{sent[0]};{sent[1]};"
            + f"{angle % 360:.1f}".replace(".", ",")
        )
    path.write_text("timestamp;port_us;stbd_us;compass\n" + "\n".join(rows) + "\n")


def _turned(moment: float, time: Floats) -> Floats:
    """Angle [rad] under a moment [N m] that comes on at two seconds."""

    def rates(t: float, y: Floats) -> list[float]:
        return [y[1], ((moment if t > 2 else 0.0) - QUADRATIC * abs(y[1]) * y[1]) / INERTIA]

    found: Callable[[Floats], Floats] = solve_ivp(rates, (0, 14), [0.0, 0.0], max_step=0.02, dense_output=True).sol
    return found(time)[0]
