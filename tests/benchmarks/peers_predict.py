"""Prediction of real logs, halves exchanged: each tool fits one half and predicts the other 2, 5 and 15 s ahead.

automarine predicts from its own filtered state; every other tool from the state that the second before shows, by
inertia and drag of its own fit. All get the runs as automarine reads them, jumps of the compass mended.
"""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import peer_automarine
import real_baseline as plain
import real_library as library
from real_sets import RealSet, present
from scipy.ndimage import gaussian_filter1d

from automarine_cli.runs.run import Run

Row = dict[str, Any]
WIDE = 0.5  # s, of the filter of derivatives
EVERY = 0.5  # s between rows of a regression


def cells(titles: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Tool, set, motion, which half is fitted; the dearest first."""
    return [(t, each.name, motion, half) for t in titles for each, motion in present() for half in "AB"]


def predicted(cell: tuple[str, str, str, str], peer: ModuleType) -> Row:
    """Errors at the horizons on the half held out [shown unit]."""
    _, name, motion, half = cell
    real_set: RealSet = next(each for each, moved in present(f"{name}/{motion}") if moved == motion)
    with tempfile.TemporaryDirectory() as scratch, np.errstate(over="ignore", invalid="ignore"):
        runs, _ = real_set.load(motion, Path(scratch))
        fitted, held_out = real_set.halved(runs)[:: 1 if half == "A" else -1]
        anchors, dof = plain.anchors_of(held_out), held_out[0].dof
        if peer is peer_automarine:
            models, preferred = library.tool_fits(fitted)
            ahead = library.tool_predictions(models[preferred], held_out, anchors)
        else:
            made = peer.motion(fitted)
            fits = made if isinstance(made, list) else [made] * len(plain.HORIZONS)
            ahead = np.stack([fit.ahead(anchors)[:, i] for i, fit in enumerate(fits)], axis=1)
        errors = [round(float(dof.shown(e)), 4) for e in plain.by_horizon(ahead - anchors.reached)]
    return {"rmse": errors, "unit": dof.units.shown, "measured": real_set.measured}


def derivatives(runs: Sequence[Run]) -> tuple[pd.DataFrame, pd.Series]:
    """Filtered command, rate, its square and, where one acts, a constant, and the acceleration; the rate is the gyro's
    or log's where there is one."""
    rows = []
    for run in runs:
        period = float(np.median(np.diff(run.time)))
        grid, wide = np.arange(run.time[0], run.time[-1], period), WIDE / period
        position, force = np.interp(grid, run.time, run.position), np.interp(grid, run.time, run.command)
        read = run.extras.get(run.dof.velocity)
        if read is None or not np.isfinite(read).all():
            rate = gaussian_filter1d(position, max(wide / 2, 1.0), order=1, truncate=6) / period
        else:
            rate = np.interp(grid, run.time, read)
        terms = {"force": force, "linear": -rate, "quadratic": -rate * np.abs(rate)}
        terms |= {"constant": np.ones(len(grid))} if run.dof.has_constant else {}
        table = pd.DataFrame({name: gaussian_filter1d(term, wide, truncate=6) for name, term in terms.items()})
        table["acceleration"] = gaussian_filter1d(rate, wide, order=1, truncate=6) / period
        edge = min(round(3.5 * wide), len(grid) // 4)
        rows.append(table[edge : len(grid) - edge : max(round(EVERY / period), 1)])
    table = pd.concat(rows, ignore_index=True)
    return table, table.pop("acceleration")


def plain_of(weights: Mapping[str, float]) -> plain.Plain:
    """Inertia and drag of the weights of an acceleration's terms."""
    per_force = weights["force"]
    if per_force <= 0:
        raise ValueError("the inertia is not positive")
    linear, quadratic, push = (weights.get(name, 0.0) / per_force for name in ("linear", "quadratic", "constant"))
    return plain.Plain("2", 1 / per_force, linear, quadratic, push)


def summary(done: Mapping[str, Row], titles: Sequence[str]) -> list[Row]:
    """Per tool and horizon: its error over the best tool's, the median of all halves, and how often it is the best."""
    halves = dict.fromkeys(key.split(" | ", 1)[1] for key in done)
    whole = [h for h in halves if all(f"{title} | {h}" in done for title in titles)]
    errors = np.array([
        [done[f"{title} | {h}"].get("rmse", [np.inf] * len(plain.HORIZONS)) for h in whole] for title in titles
    ])  # fmt: skip
    errors = np.where(np.isfinite(errors), errors, np.inf)
    if not whole:
        return []
    relative, best = errors / errors.min(axis=0), errors.argmin(axis=0)
    return [
        {
            "tool": title, "halves": len(whole),
            "ratio": [round(float(np.median(column)), 4) for column in relative[i].T],
            "worst": [float(column.max()) for column in relative[i].T],
            "best": [int(np.sum(best[:, h] == i)) for h in range(len(plain.HORIZONS))],
            "failed": int(np.sum(~np.isfinite(errors[i, :, 0]))),
        }
        for i, title in enumerate(titles)
    ]  # fmt: skip
