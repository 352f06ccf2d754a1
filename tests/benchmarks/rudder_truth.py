"""Vehicles of Nomoto's first order by an independent program, shipmmg (MIT): are K and T in their intervals?

A boat of two metres makes a 10/10 and a 20/20 zigzag, a turning circle and its pull-out at each of three speeds; K and
T follow from the speed. Headings have noise of 0.5 degrees, ten a second. Each fit of model 1 gives K and T with their
95 % intervals; a 15/15 zigzag left out gives overshoot angles, which the truth has without noise. Writes rudder.json.

Usage: python tests/benchmarks/rudder_truth.py [--out DIR] [--seeds N] [--jobs N]   (needs shipmmg)
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import arguments
import numpy as np
import pandas as pd
from shipmmg.kt import KTParams, simulate_kt, zigzag_test_kt

from automarine_cli.dofs import YAW
from automarine_cli.filters.course import make_course
from automarine_cli.fits import driven
from automarine_cli.fits.characteristics import answer_to_rudder, overshoots
from automarine_cli.models.parameter import NOTHING_KNOWN
from automarine_cli.runs.half_turn import start_at_rest
from automarine_cli.runs.load import load_runs

LENGTH_M, K_PRIME, T_PRIME = 2.0, 1.5, 0.8
SPEEDS_M_S = (0.8, 1.2, 1.8)
STEP_S, EVERY = 0.05, 2  # of shipmmg; steps of a row
RATE = np.deg2rad(20.0)  # rad/s of the rudder
NOISE_DEG, LENGTH_S = 0.5, 40.0


def log_of(truth: KTParams, angle_deg: float, noise: np.random.Generator | None, turn: bool = False) -> pd.DataFrame:
    """Log a zigzag, or a turning circle whose rudder goes back after half of the time."""
    time, angle = np.arange(0.0, LENGTH_S, STEP_S), np.deg2rad(angle_deg)
    if turn:
        rudder = np.minimum(RATE * time, angle) - np.minimum(RATE * np.maximum(time - LENGTH_S / 2, 0.0), angle)
    else:
        zigzag, _ = zigzag_test_kt(truth, angle, angle, time.tolist(), δ_rad_rate=RATE, max_step=STEP_S)
        rudder = np.array(zigzag)
    # Without max_step the integrator steps over what the rudder does, and a zigzag's rates stand still at each execute.
    rate = simulate_kt(truth, time.tolist(), rudder.tolist(), max_step=STEP_S).sol(time)[0]
    heading = np.rad2deg(np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * STEP_S)]))
    rows = slice(None, None, EVERY)
    shown = heading[rows] + (0.0 if noise is None else NOISE_DEG * noise.standard_normal(len(heading[rows])))
    return pd.DataFrame({"time_s": time[rows], "rudder_deg": np.rad2deg(rudder)[rows], "heading_deg": shown % 360})


def fitted(item: tuple[float, int]) -> dict[str, Any]:
    """One boat: K, T and their intervals beside the truth, and overshoot angles [deg] of log and model."""
    speed, seed = item
    truth, noise = KTParams(K=K_PRIME * speed / LENGTH_M, T=T_PRIME * LENGTH_M / speed), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as scratch:
        folder, left_out = Path(scratch) / "fitted", Path(scratch) / "left_out"
        folder.mkdir()
        left_out.mkdir()
        for name, angle, turn in (("z10", 10.0, False), ("z20", 20.0, False), ("circle", 15.0, True)):
            log_of(truth, angle, noise, turn).to_csv(folder / f"{name}.csv", index=False)
        log_of(truth, 15.0, None).to_csv(left_out / "z15.csv", index=False)
        runs, others = (tuple(load_runs([each], dof=YAW).runs) for each in (folder, left_out))
    course = make_course(runs, start_at_rest(runs))
    [(fit, why)] = driven.fit_driven_models([("1", ())], runs, course, NOTHING_KNOWN)
    if fit is None:
        return {"speed_m_s": speed, "seed": seed, "refused": why}
    nomoto = answer_to_rudder(runs, fit, None, fit.model, float(course.fastest[0]))
    row: dict[str, Any] = {"speed_m_s": speed, "seed": seed}
    for name, value, estimate in (("K", truth.K, nomoto.gain), ("T", truth.T, nomoto.time)):
        row[name] = {"truth": value, "value": estimate.value, "ci95": list(estimate.ci95)}
    row["overshoots_deg"] = np.rad2deg([pair for run in others for pair in overshoots(fit.model, run)]).tolist()
    return row


def main() -> None:
    chosen = arguments.options(__doc__, out=Path("out"), seeds=14, jobs=2)
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(chosen.jobs) as pool:
        for row in pool.map(fitted, product(SPEEDS_M_S, range(chosen.seeds))):
            rows.append(row)
            arguments.write_json(chosen.out / "rudder.json", {"schema": "automarine/rudder-truth/1", "rows": rows})
            print(len(rows), row.get("refused", ""), file=sys.stderr, flush=True)
    good = [row for row in rows if "K" in row]
    for name in ("K", "T"):
        inside = [row[name]["ci95"][0] <= row[name]["truth"] <= row[name]["ci95"][1] for row in good]
        error = [row[name]["value"] / row[name]["truth"] - 1.0 for row in good]
        print(
            f"{name}: {sum(inside)} of {len(inside)} intervals hold the truth, mean error {100 * np.mean(error):.2f} %"
        )
    logged, modelled = np.concatenate([row["overshoots_deg"] for row in good]).T
    miss = np.sqrt(np.mean((logged - modelled) ** 2))
    print(f"overshoots left out: {len(logged)}, {logged.mean():.2f} degrees on the mean, missed by {miss:.2f}")


if __name__ == "__main__":
    main()
