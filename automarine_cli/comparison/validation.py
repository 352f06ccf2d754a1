"""All runs under all models of a file: free and restarted runs, scores, which model does best, what filters predict.

Predictions are from filtered states on driven and disturbed runs, beside somebody who expects no change. The models'
own parameters are held; the sizes of what is random (disturbance, unsteady thrust, scatter of the gain, noise) are
fitted on these very runs, for no file knows the weather of their day.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.comparison.rollouts import needed_signals
from automarine_cli.comparison.scores import (
    Overall,
    RunScore,
    lead,
    noise_floor,
    overall,
    pooled_floor,
    resamples,
    score,
)
from automarine_cli.comparison.simulated_runs import FreeRun, Restarts, find_restarts, free_runs, restarted_errors
from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.prediction import Predicted, predict
from automarine_cli.fits.driven import base_starts, disturbed, driven_problem
from automarine_cli.fits.driven_fit import Worth, worth_of
from automarine_cli.fits.driven_models import STEPS
from automarine_cli.fits.driven_use import judged_of
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations import fit_innovations
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress, counted, silent
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch


@dataclass(frozen=True)
class Scored:
    """One model: its free runs and scores in the order of the runs, and its scores over all of them."""

    free: tuple[FreeRun, ...]
    scores: tuple[RunScore, ...]
    overall: Mapping[str, Overall]

    @property
    def diverged(self) -> tuple[str, ...]:
        """Names of the runs in which the simulation ran away."""
        return tuple(one.run.name for one in self.free if one.diverged)


@dataclass(frozen=True)
class Comparison:
    """What was measured against what each model says, R runs; `floors` are their noise, `floor` that of all, in the
    unit that people see.

    `best` is the number of the model with the smallest free-run error of position over all runs, None where every
    model diverged; `because` is the sentence that says so. `carried` are the effects with a state of their own,
    which a restart takes from the free run.
    """

    runs: tuple[Run, ...]
    restarts: tuple[Restarts, ...]
    models: Mapping[str, Scored]
    floors: tuple[float, ...]
    floor: float
    best: str | None
    because: str
    carried: tuple[str, ...]


def compare(stored: StoredModels, runs: Sequence[Run], seed: int = 0, progress: Progress = silent) -> Comparison:
    """Simulate and score `runs` under every model. Raises RunError as `make_batch`."""
    restarts = [find_restarts(run) for run in runs]
    drawn = resamples(len(runs), seed)
    models: dict[str, Scored] = {}
    for number, model in stored.models.items():
        stage = f"simulating model {number}"
        found = free_runs(model, runs, stored.switch_offset)
        free = list(counted(progress, stage, found, len(runs)))
        again = restarted_errors(model, free, restarts, stored.switch_offset)
        scores = tuple(score(one, errors) for one, errors in zip(free, again))
        models[number] = Scored(tuple(free), scores, overall(scores, drawn))
    sizes = {number: len(model.theta) for number, model in stored.models.items()}
    values = {number: one.overall["rmse"].value for number, one in models.items()}
    ranked = sorted((value, sizes[number], number) for number, value in values.items() if value is not None)
    best = ranked[0][2] if ranked else None
    leads = {
        number: lead(models[best].scores, models[number].scores, drawn)
        for _, _, number in ranked[1:]
        if best is not None
    }
    floors = tuple(noise_floor(run) for run in runs)
    because = _because(best, leads, models, runs[0].dof)
    carried = tuple(name for name in stored.effects if effects.get(name).states)
    return Comparison(tuple(runs), tuple(restarts), models, floors, pooled_floor(runs), best, because, carried)


def _because(best: str | None, leads: Mapping[str, Overall], models: Mapping[str, Scored], dof: Dof) -> str:
    """One sentence: which model follows the runs best, and whether its lead could be chance."""
    if best is None:
        return "No model follows these runs: every simulation diverges."
    parts = []
    for number, gap in leads.items():
        part = f"{_digits(gap.value)} {dof.units.shown} below model {number}"
        if gap.ci95 is not None:
            sure = "" if gap.ci95[0] > 0 else ", which may be chance"
            part += f" (95 % interval {_digits(gap.ci95[0])} to {_digits(gap.ci95[1])} over runs{sure})"
        parts.append(part)
    told = ["; ".join(parts)] if parts else []
    told += [
        f"model {number} diverges in {len(m.diverged)} of {len(m.free)} runs"
        for number, m in models.items()
        if m.diverged
    ]
    tail = f": {'; '.join(told)}" if told else ""
    if len(models) == 1:
        return f"Model {best} is the only one{tail}."
    return f"Model {best} has the smallest free-run {dof.position} error over all runs{tail}."


def _digits(gap: float | None) -> str:
    """A number in a sentence: two digits, all before the point where there are more."""
    value = 0.0 if gap is None else gap
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


@dataclass(frozen=True)
class Ahead:
    """What each model, by its number, is worth by horizon; `preferred` is the number of the one that the fit preferred:
    who has no more logs than these cannot know which does best on them. `by_run` are the errors of each model by
    horizon and run."""

    worth: Mapping[str, tuple[Worth, ...]]
    preferred: str
    dof: Dof
    by_run: Mapping[str, Mapping[float, Mapping[str, float]]]

    @property
    def of_use(self) -> bool:
        """Whether the preferred model predicts better than constants do; what cannot be judged counts as of use."""
        one = judged_of(self.worth.get(self.preferred, ()))
        return one is None or one.of_use

    @property
    def sentence(self) -> str:
        """One line: of what use the preferred model is."""
        judged = {number: one for number, worth in self.worth.items() if (one := judged_of(worth)) is not None}
        if self.preferred not in judged:
            return "These runs are driven and disturbed, and too short to judge predictions."
        one = judged[self.preferred]
        which = f"odel {self.preferred}" + ", which the fit preferred," * (len(self.worth) > 1)
        if one.of_use:
            return f"M{which} predicts {one.beside(self.dof)}."
        none = "The model is of no use" if len(judged) == 1 else "No model is of use"
        if any(other.of_use for other in judged.values()):
            none = f"M{which} is of no use"
            which = "it"
        else:
            which = f"m{which}"
        return (
            f"{none} on these runs: {which} predicts {one.beside(self.dof)}. Do not simulate or "
            "control with it; `automarine diagnose` looks for what it lacks."
        )

    def to_json(self) -> dict[str, list[dict[str, object]]]:
        """By model and horizon, in the unit in which people see positions."""
        dof = self.dof
        return {
            number: [
                one.to_json(dof)
                | {"runs": {run: float(dof.shown(error)) for run, error in self.by_run[number][one.horizon].items()}}
                for one in worth
            ]
            for number, worth in self.worth.items()
        }


def ahead_of(stored: StoredModels, runs: Sequence[Run], channels: tuple[str, ...] | None) -> Ahead | None:
    """Predictions of every model of a file from the filtered states of `runs`; None where the runs are not driven, or
    no filter follows them. `channels` names the quantities that count, None for positions."""
    at_rest = np.array([starts_at_rest(run) for run in runs])
    worth, by_run = {}, {}
    try:
        rough = rough_model("2", make_batch(runs, STEPS[0]))  # what runs are does not hang on the model to be judged
    except FitError:
        rough = stored.models[stored.preferred]
    try:
        if not disturbed(runs, rough, at_rest, channels):
            return None
        for number, model in stored.models.items():
            ahead = _predicted(model, runs, at_rest, channels)
            worth[number] = worth_of(ahead)
            by_run[number] = {one.horizon: _by_run(one, runs) for one in ahead}
    except FitError:  # what the free runs say has to do
        return None
    return Ahead(worth, stored.preferred, stored.dof, by_run)


def _by_run(ahead: Predicted, runs: Sequence[Run]) -> dict[str, float]:
    """Root mean square error of each run that has predictions."""
    sizes = np.sqrt(ahead.by_run(ahead.error, len(runs)))
    return {run.name: float(size) for run, size in zip(runs, sizes) if np.isfinite(size)}


def _predicted(
    model: YawModel, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> tuple[Predicted, ...]:
    """Of one model, by the sizes that the runs themselves give to what is random."""
    course = make_course(runs, at_rest, needed_signals(model), channels=channels)
    problem, own = driven_problem(model, course), len(model.theta)
    held = np.concatenate([np.tile(model.theta[:, None], 2), problem.bounds[own:]])
    problem = replace(problem, bounds=held)
    found = fit_innovations(problem, np.unique(base_starts(problem), axis=0), brief=True)
    return predict(model, course, model.theta, problem.noises(found.theta[None]))
