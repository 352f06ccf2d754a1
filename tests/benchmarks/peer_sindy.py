"""PySINDy: sparse regression of the right-hand side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import peers_names
import peers_predict
import pysindy as ps
from real_baseline import Plain
from scipy.signal import savgol_filter

from automarine_cli.runs.run import Run

TITLE, PACKAGE = "PySINDy", "pysindy"
GIVEN = (
    "Rate by a Savitzky-Golay filter (0.5 s). Weak form over windows of 4 s, as documented for noise, with `STLSQ` "
    "and the best lag of 0 to 3 samples. No intervals. Names: filtered terms, `SSR` to at most nine, then the sparsest "
    "model within 3 % of the best on held-out runs."
)


def fit(folder: Path) -> dict[str, list[float]]:
    """Inertia and drag; no intervals."""
    fits = []
    for lag in range(4):
        rates, commands = [], []
        for path in sorted(folder.glob("*.csv")):
            log = pd.read_csv(path)
            heading = np.unwrap(np.radians(log["heading_deg"]))
            period = float(np.median(np.diff(log["time_s"])))
            n, window = round(4 / period), round(0.5 / period) // 2 * 2 + 1
            rate = savgol_filter(heading, window, 2, deriv=1, delta=period)
            held = (log["tau"].shift(lag, fill_value=0) + log["tau"].shift(lag + 1, fill_value=0)) / 2
            for i in range(0, len(rate) - n + 1, n // 2):
                rates.append(rate[i : i + n, None])
                commands.append(held.to_numpy()[i : i + n, None])
        grid = period * np.arange(n)
        weak = {"spatiotemporal_grid": grid, "is_uniform": True, "K": 4, "H_xt": 0.485 * grid[-1]}
        drag = ps.CustomLibrary([lambda r: r * abs(r)], [lambda r: f"{r}|{r}|"])
        libraries = [ps.WeakPDELibrary(function_library=each, **weak) for each in (drag, ps.IdentityLibrary())]
        library = ps.GeneralizedLibrary(libraries, inputs_per_library=[[0], [1]])
        model = ps.SINDy(optimizer=ps.STLSQ(threshold=0.05), feature_library=library)
        model.fit(rates, t=grid, u=commands, feature_names=["r", "tau"])
        fits.append((model.score(rates, t=grid, u=commands), *model.coefficients()[0]))
    _, b, a = max(fits)
    return {"I_r": [1 / a], "k_rr": [-b / a]}


MOST = 9  # terms


def answer(place: Path) -> dict[str, Any]:
    """What is missing: the sparsest model that predicts the runs held out, every fourth, within 3 % of the best."""
    table, which = peers_names.table_of(place)
    target, spread = table.pop("acceleration").to_numpy(), table.std().replace(0.0, 1.0)
    scaled, unseen = (table / spread).to_numpy() * target.std(), np.array(which) % 4 == 3
    found = []
    for terms in range(MOST, 1, -1):
        rank = ps.SSR(max_iter=table.shape[1] - terms, alpha=1e-6, criteria="model_residual")
        model = ps.SINDy(optimizer=rank, feature_library=ps.IdentityLibrary())
        seen = scaled[~unseen]
        model.fit(seen[:, :1], t=1.0, x_dot=target[~unseen, None], u=seen[:, 1:])
        weights = model.coefficients()[0]
        found.append((float(np.mean((target - scaled @ weights)[unseen] ** 2)), weights))
    least = min(missed for missed, _ in found)
    kept = next(weights for missed, weights in reversed(found) if missed <= 1.03 * least)
    chosen = [name for name, weight in zip(map(str, table), kept) if weight]
    return peers_names.answer_of([name for name in chosen if name not in ("command", "drag")])


def motion(runs: Sequence[Run]) -> Plain:
    """Inertia and drag of driven logs, by terms of command, rate, its square and, where one acts, a constant."""
    table, acceleration = peers_predict.derivatives(runs)
    target, spread = acceleration.to_numpy(), table.std().replace(0.0, 1.0).to_numpy()
    optimizer = ps.STLSQ(threshold=0.02, normalize_columns=True)
    model = ps.SINDy(optimizer=optimizer, feature_library=ps.IdentityLibrary())
    columns = table.to_numpy() / spread
    model.fit(columns[:, :1], t=1.0, x_dot=target[:, None], u=columns[:, 1:])
    weights = model.coefficients()[0] / spread
    return peers_predict.plain_of(dict(zip(map(str, table), weights)))
