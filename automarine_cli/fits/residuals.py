"""What a fit leaves of its readings, in units of their noise: white and normal if model and noise are right."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.fits.driven import Judgement
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit
from automarine_cli.fits.steps import StepData
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run


def standardised_residuals(
    fit: OutputErrorFit, runs: Sequence[Run], data: StepData | None, use: Judgement | None
) -> list[tuple[Floats, Floats]]:
    """Return time [s] and residual over its standard deviation, (n,) each, of every run, of the first sensor that
    counts: innovations of a filter where runs were followed by one, else measured less fitted readings of the steps'
    `data` or of whole `runs`. Empty where neither is to be had."""
    mixed = fit.mixed
    if isinstance(mixed, InnovationsFit):
        if use is None or use.course is None:
            return []
        followed = DrivenProblem(fit.model, use.course, mixed.parameters).follow(mixed.phi[None])
        innovation, variance = followed.innovation[0, 0], followed.variance[0, 0]
        read = variance > 0
        return [(t[at], e[at] / np.sqrt(v[at])) for t, e, v, at in zip(use.course.time, innovation, variance, read)]
    name = mixed.slots[0].name
    noise, fitted = mixed.noise_of[name], mixed.reading(name)
    if data is not None:
        channel = next(channel for channel in data.channels if channel.quantity == name)
        left = (channel.values - fitted) / noise
        return [(time[at], residual[at]) for time, residual, at in zip(data.time, left, channel.seen)]
    residuals = []
    for run, of_run in zip(runs, fitted):
        reading = run.channel(name)
        if reading is not None:
            left = (reading - of_run[: len(run)]) / noise
            at = np.isfinite(left)
            residuals.append((run.time[at] - run.time[0], left[at]))
    return residuals


def autocorrelation(series: Sequence[Floats], lags: int) -> Floats:
    """Return the correlation of values with those 1 to `lags` places later in the same series, pooled over all,
    (lags,); of white noise of N values in all its standard error is 1/sqrt(N)."""
    power = sum(float(values @ values) for values in series)
    products = [sum(float(values[:-lag] @ values[lag:]) for values in series) for lag in range(1, lags + 1)]
    return np.array(products) / max(power, 1e-300)


def correlations(fit: OutputErrorFit) -> tuple[list[str], Floats]:
    """Return the names of the k parameters that were estimated, the command delay among them, and the correlation of
    their errors, (k, k), as the likelihood has it: few runs left out in turn give no good one. Of positive parameters
    it is that of their logarithms."""
    mixed = fit.mixed
    names, deviation = mixed.parameters.names, np.sqrt(np.maximum(np.diagonal(mixed.covariance), 0.0))
    asked = [*range(len(fit.model.theta)), names.index(COMMAND_DELAY)]
    places = [i for i in asked if np.isfinite(deviation[i]) and deviation[i] > 0]
    matrix = mixed.covariance[np.ix_(places, places)] / np.outer(deviation[places], deviation[places])
    return [names[i] for i in places], matrix
