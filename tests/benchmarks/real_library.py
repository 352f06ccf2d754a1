"""What `make real` asks of the library, one function a thing: fit, predict from known states, run freely, diagnose."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from identified import identify
from numpy.typing import NDArray
from real_baseline import HORIZONS, Anchors

from automarine_cli.comparison.simulated_runs import free_runs, roll
from automarine_cli.diagnosis.diagnose import diagnose_runs
from automarine_cli.errors import AutomarineError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.kalman import carried, follow, shown_channel
from automarine_cli.fits.driven import by_model_alone, driven_problem
from automarine_cli.fits.innovations import DrivenProblem, InnovationsFit
from automarine_cli.models.model import Model
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import start_at_rest
from automarine_cli.runs.run import Run


@dataclass(frozen=True)
class Fitted:
    """One model fitted to a half: `offset` is the instant of its commands [sample intervals], `driven` the fit by
    innovations where it is one."""

    model: Model
    driven: InnovationsFit | None

    def on(self, runs: Sequence[Run]) -> tuple[DrivenProblem, Course]:
        """The likelihood of other runs, and these as the filter has them."""
        channels = None if self.driven is None else tuple(self.driven.readings)
        at_rest = start_at_rest(runs)
        course = make_course(runs, at_rest, self.model.signals, channels=channels)
        return driven_problem(self.model, course), course


def tool_fits(runs: Sequence[Run]) -> tuple[dict[str, Fitted], str]:
    """The paper's models by number, fitted as `fit-yaw` and its kin fit such logs, and the number preferred. Raises
    FitError, RunError."""
    result = identify(runs, fit_to="whole-runs")
    models = {}
    for number, each in result.output_error.items():
        driven = each.mixed if isinstance(each.mixed, InnovationsFit) else None  # which has the delay itself
        models[number] = Fitted(each.model if driven else each.answering, driven)
    return models, result.preference.number


def tool_predictions(fitted: Fitted, runs: Sequence[Run], anchors: Anchors) -> Floats:
    """Positions predicted from the anchors at the horizons (A, H) [base units], not finite past a run's end; of driven
    fits from the filtered state."""
    if fitted.driven is not None:
        return _from_filtered_states(fitted, fitted.driven, runs, anchors)
    pieces = []
    for i, k in zip(anchors.run, anchors.sample):
        stop = int(np.searchsorted(runs[i].time, runs[i].time[k] + HORIZONS[-1])) + 1
        pieces.append(runs[i].cut(k, min(stop, len(runs[i]))))
    shown = roll(fitted.model, pieces, anchors.position, anchors.rate).position[0]
    return np.array([
        np.interp(np.array(HORIZONS), run.time - run.time[0], row[: len(run)], right=np.nan)
        for run, row in zip(pieces, shown)
    ])  # fmt: skip


def _from_filtered_states(fitted: Fitted, fit: InnovationsFit, runs: Sequence[Run], anchors: Anchors) -> Floats:
    problem, course = fitted.on(runs)
    noises, channel = problem.noises(fit.theta[None]), shown_channel(course)
    followed = follow(fitted.model, course.unthinned, fit.of_model[None], noises, keep=True)
    if by_model_alone(runs):
        assert followed.states is not None
        followed.states[[*followed.places.pushed, followed.places.gain]] = 0.0
    begin = np.array([runs[i].time[k] - runs[i].time[0] for i, k in zip(anchors.run, anchors.sample)])
    at = predictions(fitted.model, course, fit.of_model, noises, followed, [channel], anchors.run, begin)
    ahead = at(np.array(HORIZONS), np.nan)[0]
    if channel.counts:
        return ahead
    # a sum of velocities, to which the filter is not tied, begins where the anchors say
    return ahead + (anchors.position[:, None] - at(np.zeros(1), None)[0])


def predictions(
    model: Any, course: Course, values: Floats, noises: Any, followed: Any, channels: Sequence[Any],
    run: NDArray[np.int64], begin: Floats,
) -> Callable[[Floats, float | None], Floats]:  # fmt: skip
    """What the filter predicts of channels from its states at `begin` (A,) [s since the run's first sample] on: a
    function of times ahead (H,), and of the value past a run's end, that gives (C, A, H)."""
    assert followed.states is not None
    ends = np.array([int((length > 0).sum()) for length in course.length])
    clock = np.where(np.arange(course.time.shape[1]) <= ends[:, None], course.time, np.inf)
    origin = np.array([np.searchsorted(clock[i], t + 1e-9) - 1 for i, t in zip(run, begin)])
    last = np.array([min(np.searchsorted(clock[i], t + HORIZONS[-1] + 1.0), ends[i]) for i, t in zip(run, begin)])
    states = followed.states[:, 0]
    paths = carried(model, course, values[None], noises, states, channels, run, origin, last)[:, 0]

    def at(ahead: Floats, past: float | None) -> Floats:
        return np.array([
            [np.interp(t + ahead, clock[i, o : e + 1], path[: e - o + 1], right=past)
             for i, t, o, e, path in zip(run, begin, origin, last, rows)]
            for rows in paths
        ])  # fmt: skip

    return at


def tool_free_run(fitted: Fitted, runs: Sequence[Run]) -> float:
    """Root mean square error of the free runs from start to end [base unit]."""
    errors = np.concatenate([run.error for run in free_runs(fitted.model, runs)])
    return float(np.sqrt(np.mean(errors**2)))


def tool_diagnosis(fitted: Fitted, runs: Sequence[Run], held_out: Sequence[Run]) -> str:
    """What `diagnose` says of the model and one half: a verdict and names, or the refusal."""
    try:
        result = diagnose_runs(runs, fitted.model, hold_out=held_out)
    except AutomarineError as refusal:
        return f"refused: {refusal}"
    return f"{result.verdict}: {', '.join(effect.name for effect in result.effects)}".removesuffix(": ")
