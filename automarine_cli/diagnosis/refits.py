"""Models refitted with one effect more or less, as trials of a search."""

from dataclasses import replace

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.scores import fitted_parameters, penalty, probes
from automarine_cli.diagnosis.study import ITERATIONS, Fit, Study
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.errors import FitError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats


def trial_of(study: Study, model: YawModel, added: tuple[str, ...], fit: Fit) -> Trial:
    """A fit as a trial: the fitted model, and its evidence with the penalty for what was added."""
    model = study.told(model, fit)
    own = model.terms[len(study.base.terms) :]
    cost = penalty(sum(fitted_parameters(term.name, term.values) for term in own), len(study.runs))
    return Trial(added, model, fit, -2.0 * fit.log_likelihood + cost)


def add_effect(
    study: Study, current: Trial, candidate: tuple[str, Floats], iterations: int = ITERATIONS
) -> Trial | None:
    """The current model with one more effect, everything refitted; None where no fit is found."""
    name, start = candidate
    values = np.concatenate([current.fit.of_model, start])
    return _fitted(study, current, current.model.with_effect(name, start), values, current.fit, iterations)


def go_on(study: Study, current: Trial, trial: Trial, iterations: int) -> Trial | None:
    """A trial's fit taken further from where it stands."""
    return _fitted(study, current, trial.model, trial.fit.of_model, trial.fit, iterations)


def _fitted(study: Study, current: Trial, model: YawModel, values: Floats, near: Fit, iterations: int) -> Trial | None:
    try:
        fit = study.fit(model, values, near, iterations)
    except (FitError, np.linalg.LinAlgError):
        return None
    return trial_of(study, model, (*current.added, model.terms[-1].name), fit)


def variants(study: Study, trial: Trial) -> list[YawModel]:
    """A trial's model with each effect that was added in every shape of every law of it."""
    return [
        replace(trial.model, terms=tuple(replace(t, values=shape) if t is term else t for t in trial.model.terms))
        for term in trial.model.terms[len(study.base.terms) :]
        for shape in dict.fromkeys(tuple(map(float, probe.values[-1])) for probe in probes(study, term.name))
        if len(effects.get(term.name).parameters) > 1
    ]


def varied(study: Study, trial: Trial, iterations: int, model: YawModel) -> Trial | None:
    """A variant of a trial's model, refitted from where the trial ended; None where no fit is found."""
    try:
        return trial_of(study, model, trial.added, study.fit(model, model.theta, trial.fit, iterations))
    except (FitError, np.linalg.LinAlgError):
        return None


def without(study: Study, trial: Trial, out: str) -> Trial | None:
    """The trial's model with one effect taken out, refitted."""
    own = len(study.base.terms)
    kept = [term for term in trial.model.terms[own:] if term.name != out]
    model = study.base.with_theta(trial.model.theta[: len(study.base.theta)])
    for term in kept:
        model = model.with_effect(term.name, term.values)
    try:
        fit = study.fit(model, model.theta, trial.fit)
    except (FitError, np.linalg.LinAlgError):
        return None
    return trial_of(study, model, tuple(term.name for term in kept), fit)
