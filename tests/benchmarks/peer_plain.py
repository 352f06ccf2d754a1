"""A plain script, as one writes it in an afternoon: scipy's `least_squares` over `solve_ivp`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from real_baseline import HORIZONS, Plain, anchors_of, fit_plain
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from automarine_cli.runs.run import Run

TITLE, PACKAGE = "plain script", "scipy"
GIVEN = (
    "Whole runs. Free: `I_r`, `k_rr`, one delay, each start heading. Start values 2, 2, 0, tolerance 1e-6. Intervals "
    "from the Jacobian. Predictions: least squares for each horizon separately."
)


def fit(folder: Path) -> dict[str, list[float]]:
    """Inertia and drag, each with its 95 % interval."""
    runs = []
    for path in sorted(folder.glob("*.csv")):
        log = pd.read_csv(path)
        heading = np.unwrap(np.radians(log["heading_deg"]))
        step = int(np.argmax(log["tau"] != 0))
        time = (log["time_s"] - log["time_s"][step]).to_numpy()
        runs.append((time, log["tau"][step], heading))

    def misses(guess):  # type: ignore[no-untyped-def]
        inertia, drag, delay = guess
        out = []
        for time, tau, heading in runs:
            found = solve_ivp(
                lambda t, y, tau: [y[1], (tau - drag * abs(y[1]) * y[1]) / inertia],
                (0, time[-1] + 1), [0, 0], args=(tau,), dense_output=True, rtol=1e-6, atol=1e-8,
            )  # fmt: skip
            miss = found.sol(np.clip(time - delay, 0, None))[0] - heading
            out.append(miss - miss.mean())
        return np.concatenate(out)

    best = least_squares(misses, [2, 2, 0], bounds=([0.01, 0.01, -0.5], [100, 100, 0.5]), x_scale="jac")
    variance = 2 * best.cost / (len(best.fun) - 3) * np.linalg.inv(best.jac.T @ best.jac).diagonal()
    half = 1.96 * np.sqrt(variance)
    return {name: [best.x[i], best.x[i] - half[i], best.x[i] + half[i]] for i, name in enumerate(("I_r", "k_rr"))}


def motion(runs: Sequence[Run]) -> list[Plain]:
    """Inertia and drag of driven logs, fitted to each horizon by itself: the least squares of `make real`."""
    learned = anchors_of(runs)
    return [fit_plain(learned, "2", horizon, runs[0].dof.has_constant) for horizon in HORIZONS]
