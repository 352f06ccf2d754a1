"""Runs of a vehicle that a controller steers in disturbed water, with a known truth: own equations, fine steps."""

from dataclasses import dataclass, replace

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

FINE = 0.005  # s, of the integrator


@dataclass(frozen=True)
class Sea:
    """The truth: I_r, k_r, k_rr, delay [s] of the command; disturbing acceleration [rad/s²] and its time constant [s];
    white noise of the thrust as a share of it [s^1/2], log scatter of the thrust from run to run, compass [deg]; by
    which share `warmth` the thrust is more at 24 than at 4 degrees of the water, as a tanh (then it is logged)."""

    inertia: float = 1.0
    k_r: float = 0.0
    k_rr: float = 1.2
    delay: float = 0.0
    size: float = 0.1
    lasting: float = 2.0
    thrust: float = 0.02
    scatter: float = 0.03
    noise_deg: float = 1.0
    warmth: float = 0.0


def steered(
    count: int,
    seed: int = 0,
    sea: Sea | None = None,
    *,
    length: float = 50.0,
    period: float = 0.25,
    held: float = 6.0,
    free: bool = False,
) -> list[Run]:
    """Runs from rest of a controller that is asked for a new heading every `held` [s]; `free` ones have moments for
    that.

    It reads the noisy compass at each sample, and its command changes halfway to the next one.
    """
    sea, rng = sea or Sea(), np.random.default_rng(seed)
    samples, inner, late = round(length / period) + 1, round(period / FINE), round(sea.delay / FINE)
    asked = rng.uniform(-1.0, 1.0, (samples, count))[np.arange(samples) // round(held / period)]
    noise = np.deg2rad(sea.noise_deg) * rng.standard_normal((samples, count))
    gain = np.exp(sea.scatter * rng.standard_normal(count))
    heading, rate = rng.uniform(-1.0, 1.0, count), np.zeros(count)
    pushed, keep = sea.size * rng.standard_normal(count), np.exp(-FINE / sea.lasting)
    shown, commands = np.zeros((samples, count)), np.zeros((samples + 1, count))
    applied = np.zeros((samples * inner, count))
    warm = 14.0 + 10.0 * np.sin(period * np.arange(samples)[:, None] / 9.0 + np.arange(count))
    stronger = 1.0 + 0.5 * sea.warmth * np.tanh((warm - 14.0) / 4.0)
    for k in range(samples):
        shown[k] = heading + noise[k]
        steering = 1.5 * (1.5 * asked[k] - shown[k]) - 0.8 * (shown[k] - shown[max(k - 1, 0)]) / period
        commands[k + 1] = asked[k] if free else np.clip(steering, -1.0, 1.0)
        for m in range(k * inner, (k + 1) * inner):
            applied[m] = commands[k + (2 * (m - k * inner) >= inner)]
            thrust = gain * stronger[k] * applied[m - late] / sea.inertia if m >= late else 0.0 * gain
            fresh = keep * pushed + sea.size * np.sqrt(1.0 - keep**2) * rng.standard_normal(count)
            kick = sea.thrust * np.abs(thrust) * rng.standard_normal(count) / np.sqrt(FINE)
            drive = thrust + 0.5 * (pushed + fresh) + kick
            middle = rate + 0.5 * FINE * (drive - _drag(rate, sea))
            swift = rate + FINE * (drive - _drag(middle, sea))
            heading, rate, pushed = heading + 0.5 * FINE * (rate + swift), swift, fresh
    time = period * np.arange(samples)
    extras = [{"water_temp_C": warm[:, i]} if sea.warmth else {} for i in range(count)]
    return [
        Run(f"driven_{i}", "driven.csv", 100.0 * i + time, shown[:, i], commands[:-1, i], "nu", extras[i], dof=YAW)
        for i in range(count)
    ]


def _drag(rate: Floats, sea: Sea) -> Floats:
    """Deceleration [rad/s²]."""
    return (sea.k_r * rate + sea.k_rr * np.abs(rate) * rate) / sea.inertia


def turned(run: Run) -> Run:
    """The same run to the other side."""
    return replace(run, position=-run.position, moment=-run.command)
