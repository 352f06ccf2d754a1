"""Validation sequences of known truth: scipy's solver drives the paper's vehicle through any list of moments."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from made_runs import INERTIA, K_RR, solved

from automarine_cli.dofs import YAW
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

STEPS = (0.5, -0.8, 0.0, 0.3, -0.3, 1.0)


def sequence_run(
    moments: Sequence[float] = STEPS,
    *,
    hold: float = 4.0,
    rest: float = 2.0,
    period: float = 0.1,
    noise_deg: float = 0.0,
    name: str = "sequence",
    k_r: float = 0.0,
    k_rr: float = K_RR,
    rate0: float = 0.0,
    seed: int = 0,
) -> Run:
    """Rest, then each moment held for `hold` [s]; commands switch halfway between two samples."""
    time, heading, held = _clean(tuple(moments), hold, rest, period, k_r, k_rr, rate0)
    noise = np.deg2rad(noise_deg) * np.random.default_rng(seed).standard_normal(len(time))
    return Run(name, f"{name}.csv", 50.0 + time, 0.4 + heading + noise, held, "nu", dof=YAW)


@cache
def _clean(
    moments: tuple[float, ...], hold: float, rest: float, period: float, k_r: float, k_rr: float, rate0: float
) -> tuple[Floats, Floats, Floats]:
    """Clock, true heading and held moment of a sequence."""
    time = period * np.arange(round((rest + hold * len(moments)) / period) + 1)
    switches = rest + hold * np.arange(len(moments)) - period / 2
    levels = (0.0, *moments) if rest else moments
    starts = (time[0], *switches) if rest else (time[0], *switches[1:])
    heading = solved(starts, levels, time, k_r, k_rr, rate0)
    held = np.array(levels)[np.searchsorted(starts, time, side="right") - 1]
    return time, heading, held


def model_file(path: Path, **changes: object) -> Path:
    """A yaw_model.json written by hand: model 3 is the truth, models 1 and 2 as a fit to it would have them."""

    def estimate(value: float, unit: str) -> dict[str, object]:
        return {"value": value, "stderr": 0.01 * value, "ci95": [0.98 * value, 1.02 * value], "unit": unit}

    inertia, k_r, k_rr = ("I_r", "nu s²"), ("k_r", "nu s"), ("k_rr", "nu s²")
    values = {
        "1": {inertia: 0.7058, k_r: 0.9961},
        "2": {inertia: INERTIA, k_rr: K_RR - 0.03, k_r: 0.03},
        "3": {inertia: INERTIA, k_rr: K_RR},
    }
    data = {
        "schema": "automarine/yaw-model/1",
        "models": {
            number: {name: estimate(value, unit) for (name, unit), value in model.items()}
            for number, model in values.items()
        },
        "preferred": "3",
        "preferred_because": "It is the truth.",
        "moment_unit": "nu",
        "effects": [],
        **changes,
    }
    path.write_text(json.dumps(data), encoding="utf-8")
    return path
