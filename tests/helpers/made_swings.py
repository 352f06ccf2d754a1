"""Swings of known truth in roll and pitch, which scipy integrates."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from automarine_cli.dofs import ROLL, Dof
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

TRUTH = {"inertia": 1.9, "linear": 0.30, "quadratic": 0.90, "restoring": 12.0, "constant": 0.2}
ANGLES = (0.5, -0.5, 0.35, -0.35, 0.25, -0.25)
NOISE = np.radians(0.2)
PERIOD_S = 0.05


def decay(
    angle: float, seed: int, dof: Dof = ROLL, rate: float = 0.0, moment: float = 0.0,
    truth: Mapping[str, float] = TRUTH, stiffening: float = 0.0,
) -> Run:  # fmt: skip
    """A run of 12 s that starts at an `angle` [rad] and `rate` [rad/s]; a `moment` acts on it for 5 s after 2 s.

    The restoring moment grows with 1 + `stiffening` times the square of the angle."""

    def slope(time: float, state: Floats) -> list[float]:
        at, swing = state
        drag = truth["linear"] * swing + truth["quadratic"] * abs(swing) * swing
        acting = moment * (1.975 < time < 6.975)
        back = truth["restoring"] * np.sin(at) * (1.0 + stiffening * at**2)
        return [swing, (acting + truth["constant"] - drag - back) / truth["inertia"]]

    time = PERIOD_S * np.arange(240)
    path = solve_ivp(slope, (0.0, 12.0), [angle, rate], t_eval=time, rtol=1e-9, atol=1e-11, max_step=0.05).y[0]
    noisy = path + NOISE * np.random.default_rng(seed).standard_normal(len(time))
    command = np.where((time > 1.999) & (time < 6.999), moment, 0.0)
    return Run(f"run_{seed}", f"run_{seed}.csv", time, noisy, command, "N m", dof=dof)


def decays(seed: int, dof: Dof = ROLL, count: int = len(ANGLES), stiffening: float = 0.0) -> list[Run]:
    return [decay(angle, 10 * seed + i, dof, stiffening=stiffening) for i, angle in enumerate(ANGLES[:count])]


def heeled(run: Run, rise_s: float, hold_s: float) -> Floats:
    """Positions of a run before which a hand heels the vehicle from upright, and holds it."""
    rise, hold = (np.arange(round(length / PERIOD_S)) for length in (rise_s, hold_s))
    start = float(np.mean(run.position[:2]))
    before = np.append(0.5 * start * (1.0 - np.cos(np.pi * rise / max(len(rise), 1))), start + 0.0 * hold)
    return np.append(before + NOISE * np.random.default_rng(len(before)).standard_normal(len(before)), run.position)


def write_swings(path: Path, position: Floats) -> None:
    rows = (f"{PERIOD_S * i:.3f},{np.degrees(angle):.4f}" for i, angle in enumerate(position))
    path.write_text("\n".join(["time_s,roll_deg", *rows]) + "\n")
