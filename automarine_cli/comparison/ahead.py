"""What stored models predict from filtered states on driven and disturbed runs, beside somebody who expects no change.

The models' own parameters are held; the sizes of what is random (disturbance, unsteady thrust, scatter of the gain,
noise) are fitted on these very runs, for no file knows the weather of their day.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.rollouts import needed_signals
from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.prediction import predict
from automarine_cli.fits.driven import base_starts, disturbed, driven_problem
from automarine_cli.fits.driven_fit import Worth, worth_of
from automarine_cli.fits.driven_use import judged_of
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations import fit_innovations
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.runs.run import Run


@dataclass(frozen=True)
class Ahead:
    """What each model, by its number, is worth by horizon; `best` is the number of the one that misses least over the
    horizon that decides, None where the runs are too short to tell."""

    worth: Mapping[str, tuple[Worth, ...]]
    best: str | None
    dof: Dof

    @property
    def sentence(self) -> str:
        """One line: of what use the best model is."""
        if self.best is None or (one := judged_of(self.worth[self.best])) is None:
            return "These runs are driven and disturbed, and too short to judge predictions."
        if one.of_use:
            return f"Model {self.best} predicts {one.beside(self.dof)}."
        which = "The model is" if len(self.worth) == 1 else "No model is"
        return (
            f"{which} of use on these runs: model {self.best} predicts {one.beside(self.dof)}. Do not simulate or "
            "control with it; `automarine diagnose` looks for what it lacks."
        )

    def to_json(self) -> dict[str, list[dict[str, object]]]:
        """By model and horizon, in the unit in which people see positions."""
        return {number: [one.to_json(self.dof) for one in worth] for number, worth in self.worth.items()}


def ahead_of(stored: StoredModels, runs: Sequence[Run], channels: tuple[str, ...] | None) -> Ahead | None:
    """Predictions of every model of a file from the filtered states of `runs`; None where the runs are not driven, or
    no filter follows them. `channels` names the quantities that count, None for positions."""
    at_rest = np.array([starts_at_rest(run) for run in runs])
    worth = {}
    try:
        if not disturbed(runs, stored.models[stored.preferred], at_rest, channels):
            return None
        for number, model in stored.models.items():
            worth[number] = _worth(model, runs, at_rest, channels)
    except FitError:  # what the free runs say has to do
        return None
    errors = {number: one.error for number, each in worth.items() if (one := judged_of(each))}
    return Ahead(worth, min(errors, key=lambda number: errors[number], default=None), stored.dof)


def _worth(
    model: YawModel, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> tuple[Worth, ...]:
    """Of one model, by the sizes that the runs themselves give to what is random."""
    course = make_course(runs, at_rest, needed_signals(model), channels=channels)
    problem, own = driven_problem(model, course), len(model.theta)
    held = np.concatenate([np.tile(model.theta[:, None], 2), problem.bounds[own:]])
    problem = replace(problem, bounds=held)
    found = fit_innovations(problem, np.unique(base_starts(problem), axis=0), brief=True)
    return worth_of(predict(model, course, model.theta, problem.noises(found.theta[None])))
