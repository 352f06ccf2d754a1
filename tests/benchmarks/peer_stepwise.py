"""Linear regression of the yaw acceleration by statsmodels."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import peers_names
import peers_predict
import statsmodels.api as sm
from real_baseline import Plain
from scipy.ndimage import gaussian_filter1d

from automarine_cli.runs.run import Run

TITLE, PACKAGE = "regression", "statsmodels"
GIVEN = (
    "Rate by a Gaussian filter of 0.15 s; acceleration, command and terms by the same one of 1.2 s. Best lag of -0.1 "
    "to 0.5 s. `OLS` on one sample in 1.2 s. Names: filters of 0.1 and 0.5 s, terms added while "
    "the BIC falls."
)


def fit(folder: Path) -> dict[str, list[float]]:
    """Inertia and drag, each with its 95 % interval."""
    fits = []
    for lag in np.arange(-0.1, 0.51, 0.05):
        rows = []
        for path in sorted(folder.glob("*.csv")):
            log = pd.read_csv(path)
            heading = np.unwrap(np.radians(log["heading_deg"]))
            period = float(np.median(np.diff(log["time_s"])))
            wide = 1.2 / period
            rate = gaussian_filter1d(heading, 0.15 / period, order=1, truncate=6) / period
            tau = np.interp(log["time_s"] - lag - period / 2, log["time_s"], log["tau"])
            rows.append(pd.DataFrame({
                "acceleration": gaussian_filter1d(heading, wide, order=2, truncate=6) / period**2,
                "tau": gaussian_filter1d(tau, wide, truncate=6),
                "drag": gaussian_filter1d(-rate * abs(rate), wide, truncate=6),
            })[round(3 * wide) : -round(3 * wide) : round(wide)])  # fmt: skip
        table = pd.concat(rows)
        found = sm.OLS(table["acceleration"], table[["tau", "drag"]]).fit()
        fits.append(found)
    found = min(fits, key=lambda each: each.ssr)
    a, b = found.params
    v = found.cov_params().to_numpy()
    half = 1.96 * np.sqrt([v[0, 0] / a**4, (v[1, 1] - 2 * b / a * v[0, 1] + (b / a) ** 2 * v[0, 0]) / a**2])
    return {name: [x, x - h, x + h] for name, x, h in zip(("I_r", "k_rr"), (1 / a, b / a), half)}


def answer(place: Path) -> dict[str, Any]:
    """What is missing: terms are added while that lowers the BIC."""
    table, _ = peers_names.table_of(place)
    target = table.pop("acceleration")
    chosen, rest = ["command", "drag"], [str(name) for name in table if name not in ("command", "drag")]
    best = sm.OLS(target, table[chosen]).fit().bic
    while rest:
        tried = {name: sm.OLS(target, table[[*chosen, name]]).fit().bic for name in rest}
        name = min(tried, key=tried.__getitem__)
        if tried[name] >= best:
            break
        chosen, rest, best = [*chosen, name], [each for each in rest if each != name], tried[name]
    return peers_names.answer_of(chosen[2:])


def motion(runs: Sequence[Run]) -> Plain:
    """Inertia and drag of driven logs."""
    table, target = peers_predict.derivatives(runs)
    return peers_predict.plain_of(sm.OLS(target, table).fit().params.to_dict())
