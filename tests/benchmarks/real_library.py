"""What `make real` asks of the library, one function a thing: fit, predict from known states, run freely, likelihood,
diagnose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from real_baseline import HORIZONS, Anchors

from automarine_cli.comparison.residuals import free_runs
from automarine_cli.comparison.rollouts import roll
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.fits.identify import identify
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """One model fitted to a half: `offset` is the instant of its commands [sample intervals]."""

    model: YawModel
    offset: float = 0.0


@dataclass(frozen=True)
class Fits:
    """The models fitted to one half, by number, and the one preferred."""

    models: dict[str, Fitted]
    preferred: str


def library_fits(runs: Sequence[Run]) -> Fits:
    """The paper's models fitted as `fit-yaw` and its kin fit such logs. Raises FitError, RunError."""
    found = identify(runs, fit_to="whole-runs")
    models = {number: Fitted(one.model, one.offset.value) for number, one in found.output_error.items()}
    return Fits(models, found.preference.number)


def library_predictions(fitted: Fitted, runs: Sequence[Run], anchors: Anchors) -> Floats:
    """Positions predicted from the anchors at the horizons (A, H) [base units], not finite past a run's end."""
    pieces = []
    for i, k in zip(anchors.run, anchors.sample):
        run = runs[i]
        stop = int(np.searchsorted(run.time, run.time[k] + HORIZONS[-1])) + 1
        pieces.append(run.cut(k, min(stop, len(run))))
    shown = roll(fitted.model, pieces, anchors.position, anchors.rate, fitted.offset).position[0]
    rows = [
        np.interp(np.array(HORIZONS), run.time - run.time[0], row[: len(run)], right=np.nan)
        for run, row in zip(pieces, shown)
    ]
    return np.array(rows)


def library_free_run(fitted: Fitted, runs: Sequence[Run]) -> float:
    """Root mean square error of the free runs from start to end [base unit]."""
    errors = np.concatenate([one.error for one in free_runs(fitted.model, runs, fitted.offset)])
    return float(np.sqrt(np.mean(errors**2)))


def library_log_likelihood(fitted: Fitted, runs: Sequence[Run]) -> float | None:
    """Log density of runs that were not fitted, under the fit to the others; None: the fit of whole runs has none."""
    return None


def library_diagnosis(fitted: Fitted, runs: Sequence[Run], kept: Sequence[Run]) -> str:
    """What `diagnose` says of the model and one half, told nothing of the other: a verdict and names. Raises FitError,
    RunError."""
    found = diagnose_runs(runs, fitted.model, hold_out=kept)
    return f"{found.verdict}: {', '.join(effect.name for effect in found.effects)}".removesuffix(": ")
