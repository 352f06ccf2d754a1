"""What `make real` asks of the library, one function a thing: fit, predict from known states, run freely, likelihood,
diagnose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from identified import identify
from numpy.typing import NDArray
from real_baseline import HORIZONS, Anchors

from automarine_cli.comparison.simulated_runs import free_runs, roll
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.kalman import carried, follow, shown_channel
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """One model fitted to a half: `offset` is the instant of its commands [sample intervals], `driven` the fit by
    innovations where it is one."""

    model: YawModel
    offset: float = 0.0
    driven: InnovationsFit | None = None

    def on(self, runs: Sequence[Run]) -> tuple[DrivenProblem, Course]:
        """The likelihood of other runs, and these as the filter has them."""
        channels = None if self.driven is None else tuple(self.driven.readings)
        course = make_course(runs, np.array([starts_at_rest(run) for run in runs]), channels=channels)
        return driven_problem(self.model, course), course


@dataclass(frozen=True)
class Fits:
    """The models fitted to one half, by number, and the one preferred."""

    models: dict[str, Fitted]
    preferred: str


def tool_fits(runs: Sequence[Run]) -> Fits:
    """The paper's models fitted as `fit-yaw` and its kin fit such logs. Raises FitError, RunError."""
    found = identify(runs, fit_to="whole-runs")
    models = {
        number: Fitted(one.model, one.offset.value, one.mixed if isinstance(one.mixed, InnovationsFit) else None)
        for number, one in found.output_error.items()
    }
    return Fits(models, found.preference.number)


def tool_predictions(fitted: Fitted, runs: Sequence[Run], anchors: Anchors) -> Floats:
    """Positions predicted from the anchors at the horizons (A, H) [base units], not finite past a run's end; of driven
    fits from the filtered state."""
    if fitted.driven is not None:
        return _from_filtered_states(fitted, fitted.driven, runs, anchors)
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


def _from_filtered_states(fitted: Fitted, found: InnovationsFit, runs: Sequence[Run], anchors: Anchors) -> Floats:
    problem, course = fitted.on(runs)
    noises = problem.noises(found.theta[None])
    followed = follow(fitted.model, course.unthinned, found.of_model[None], noises, keep=True)
    assert followed.states is not None
    begin = np.array([runs[i].time[k] - runs[i].time[0] for i, k in zip(anchors.run, anchors.sample)])
    ends = np.array([int((length > 0).sum()) for length in course.length])
    time = np.where(np.arange(course.time.shape[1]) <= ends[:, None], course.time, np.inf)
    origin = np.array([np.searchsorted(time[i], t + 1e-9) - 1 for i, t in zip(anchors.run, begin)])
    last = np.array(
        [min(np.searchsorted(time[i], t + HORIZONS[-1] + 1.0), ends[i]) for i, t in zip(anchors.run, begin)]
    )
    path = carried(
        fitted.model, course, found.of_model[None], noises, followed.states[:, 0], [shown_channel(course)],
        np.asarray(anchors.run), origin, last,
    )[0, 0]  # fmt: skip
    rows = [
        np.interp(t + np.array(HORIZONS), time[i, o : e + 1], row[: e - o + 1], right=np.nan)
        for i, t, o, e, row in zip(anchors.run, begin, origin, last, path)
    ]
    if shown_channel(course).counts:
        return np.array(rows)
    here = [  # a sum of velocities, to which the filter is not tied: it begins where the anchors say
        np.interp(t, time[i, o : e + 1], row[: e - o + 1])
        for i, t, o, e, row in zip(anchors.run, begin, origin, last, path)
    ]
    return np.array(rows) + (np.asarray(anchors.position) - here)[:, None]


def tool_free_run(fitted: Fitted, runs: Sequence[Run]) -> float:
    """Root mean square error of the free runs from start to end [base unit]."""
    errors = np.concatenate([one.error for one in free_runs(fitted.model, runs, fitted.offset)])
    return float(np.sqrt(np.mean(errors**2)))


def tool_log_likelihood(fitted: Fitted, runs: Sequence[Run]) -> float | None:
    """Log density of runs that were not fitted, under the fit to the others; None for fits to whole runs, which have
    none."""
    if fitted.driven is None:
        return None
    problem, _ = fitted.on(runs)
    return float(problem.follow(fitted.driven.phi[None]).log_density.sum())


def tool_diagnosis(fitted: Fitted, runs: Sequence[Run], kept: Sequence[Run]) -> str:
    """What `diagnose` says of the model and one half, told nothing of the other: a verdict and names. Raises FitError,
    RunError."""
    found = diagnose_runs(runs, fitted.model, hold_out=kept)
    return f"{found.verdict}: {', '.join(effect.name for effect in found.effects)}".removesuffix(": ")
