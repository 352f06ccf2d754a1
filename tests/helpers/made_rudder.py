"""Boats with a rudder by an integrator of their own: zigzags at any speed, whose truth is known."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from automarine_cli.dofs import YAW
from automarine_cli.quantities import STEERED
from automarine_cli.runs.run import Run

STEP, EVERY = 0.02, 10  # s; steps of a row
RUDDER_RATE = np.deg2rad(20.0)  # per s
SPEED_LOSS = 0.5  # m/s² per (rad/s)²
SPEED_TIME = 4.0  # s in which the speed comes back
MEMORY_TIME = 3.0  # s
SPEED, ERROR = 1.2, 0.03  # of models: m/s at which they are fitted; standard errors as shares


def estimate(value: float, unit: str, share: float = ERROR) -> dict[str, object]:
    error = abs(share * value)
    return {"value": value, "stderr": error, "ci95": [value - 2 * error, value + 2 * error], "unit": unit}


@dataclass(frozen=True)
class Boat:
    """r' = effect delta u|u| - damping u r - quadratic r|r| - memory (r - past), past' = (r - past)/3 s; positive
    rudder turns to port where `side` is -1."""

    effect: float = 0.8
    damping: float = 0.9
    quadratic: float = 0.0
    side: int = 1
    memory: float = 0.0

    def zigzag(self, speed: float, angle_deg: float, seed: int, length_s: float = 40.0) -> pd.DataFrame:
        """Log a zigzag whose rudder goes over at a heading as large as its angle, with noise of 0.5 degrees."""
        random = np.random.default_rng(seed)
        size, start = np.deg2rad(angle_deg), random.uniform(0.0, 360.0)
        psi = r = rudder = past = 0.0
        u, order, rows = speed, size, []
        for k in range(round(length_s / STEP)):
            if order * psi > 0 and abs(psi) >= size:
                order = -order
            asked = order if k * STEP >= 2.0 else 0.0
            rudder += float(np.clip(asked - rudder, -RUDDER_RATE * STEP, RUDDER_RATE * STEP))
            if k % EVERY == 0:
                heading = (start + np.rad2deg(psi) + 0.5 * random.standard_normal()) % 360
                rows.append((k * STEP, self.side * np.rad2deg(rudder), heading, u + 0.01 * random.standard_normal()))
            before = r
            middle = r + 0.5 * STEP * self._slope(r, rudder, u, past)
            r += STEP * self._slope(middle, rudder, u, past)
            past += STEP * (0.5 * (before + r) - past) / MEMORY_TIME
            psi += 0.5 * STEP * (before + r)
            u += STEP * ((speed - u) / SPEED_TIME - SPEED_LOSS * r * r)
        return pd.DataFrame(rows, columns=["time_s", "rudder_deg", "heading_deg", "surge_m_s"]).round(4)

    def _slope(self, r: float, rudder: float, u: float, past: float) -> float:
        drag = self.damping * u * r + self.quadratic * r * abs(r) + self.memory * (r - past)
        return self.effect * rudder * u * abs(u) - drag

    def write(self, folder: Path, speed: bool = True, seed: int = 0) -> Path:
        """Write zigzags at three speeds, with or without the speed."""
        folder.mkdir(parents=True, exist_ok=True)
        for i, (u, angle) in enumerate(((0.8, 20.0), (1.2, 10.0), (1.6, 15.0))):
            log = self.zigzag(u if speed else 1.2, angle, 10 * seed + i)
            log.drop(columns=[] if speed else ["surge_m_s"]).to_csv(folder / f"zigzag_{i}.csv", index=False)
        return folder

    def model(self, seed: int = 0, noise_deg: float = 0.02) -> dict[str, Any]:
        """Content of a model of the boat, each parameter wrong by a draw of its standard error."""
        draw = 1.0 + ERROR * np.random.default_rng(seed).standard_normal(3)
        per_moment = 1.0 / (self.effect * SPEED**2)
        inertia, quadratic, coupling = per_moment * draw * np.array([1.0, self.quadratic, -self.damping])
        drag = {"I_r": estimate(inertia, "rad s²"), "k_rr": estimate(quadratic, "rad s²")}
        inflow = {"race": estimate(0.0, "1") | {"stderr": 0.01}, "U": estimate(SPEED, "m/s", 0.0)}
        coupled = {"c": estimate(coupling, "rad s²/m")}
        return {
            "schema": "automarine/yaw-model/1", "moment_unit": "rad", "preferred": "3", "gain_scatter": 0.01,
            "heading_noise_deg": noise_deg, "models": {"3": drag},
            "effects": [
                {"name": "rudder-inflow", "parameters": inflow}, {"name": "cross-coupling", "parameters": coupled},
            ],
            "valid_range": {"moment": [-0.35, 0.35], "yaw_rate_rad_s": None},
            "command_delay_s": estimate(0.0, "s") | {"stderr": 0.002},
            "nomoto": {"speed_m_s": SPEED, "positive_rudder_turns_to": "starboard" if self.side > 0 else "port"},
        }  # fmt: skip


QUICK_INERTIA, QUICK_LINEAR, QUICK_QUADRATIC = 1.0 / 2.6, 1.0 / 2.6, 1.55 / 2.6  # rad s², rad s, rad s²


def quick_zigzag(seed: int, side: float = 1.0, late: float = 0.0, gear: float = 0.0) -> Run:
    """Log a zigzag at 5 Hz of a boat that answers in half a second: the rudder goes over with a sample, follows its
    command with the time constant `gear` [s], and the gyro is read `late` [s], or below zero the heading."""
    random, step, every = np.random.default_rng(seed), 0.002, 100
    psi, r, angle, rudder = 0.0, 0.0, 0.0, side * 0.35
    faded = np.exp(-step / gear) if gear else 0.0
    states, commands = list[tuple[float, float]](), list[float]()
    for k in range(30 * 500):
        if k % every == 0:
            rudder = -np.sign(rudder) * 0.35 if rudder * psi > 0.1 else rudder
            commands.append(rudder)
        states.append((psi, r))
        angle = rudder + faded * (angle - rudder)
        pull = (angle - QUICK_LINEAR * r - QUICK_QUADRATIC * r * abs(r)) / QUICK_INERTIA
        psi, r = psi + step * (r + 0.5 * step * pull), r + step * pull
    clock, read = step * np.arange(len(states)), step * every * np.arange(len(commands))
    heading, gyro = (
        np.interp(read - by, clock, column)
        for by, column in zip((max(-late, 0.0), max(late, 0.0)), np.transpose(states))
    )
    heading, gyro = (
        x + np.deg2rad(0.3) * random.standard_normal(len(read)) for x in (random.uniform(-3.0, 3.0) + heading, gyro)
    )
    return Run(f"run_{seed}", "made.csv", read, heading, np.array(commands), STEERED, {"yaw_rate": gyro}, dof=YAW)


if __name__ == "__main__":
    Boat().write(Path("sample_runs") / "rudder")
