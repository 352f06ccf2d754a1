"""What a diagnosis estimates: parameters of effects and of the base with the run as the unit, and the smallest sizes
that would have shown."""

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.scores import fitted_parameters, penalty
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import Found, Trial
from automarine_cli.fits.output_error import estimate_of
from automarine_cli.fits.whole_runs import varying_terms
from automarine_cli.results.estimate import Estimate


def parameter_estimates(study: Study, trial: Trial, name: str) -> dict[str, Estimate]:
    """Estimates of one effect's parameters with the run as the unit, by their names in files."""
    found = _estimates(study, trial)
    own = effects.get(name).names_in(trial.model.dof)
    return {one: found[trial.model.index(f"{name}.{one}")] for one in own}


def base_estimates(study: Study, trial: Trial) -> dict[str, Estimate]:
    """Estimates of the base model's parameters, inertia first, by their names in files."""
    return dict(zip(study.base.short_names, _estimates(study, trial)))


def _estimates(study: Study, trial: Trial) -> list[Estimate]:
    """Estimates of a model's parameters, in the order of theta."""
    model, covariance = trial.model, study.covariance(trial.model, trial.fit)
    units = [model.dof.unit_of("inertia", model.moment_unit)]
    for term in model.terms:
        units += [p.unit for p in effects.get(term.name).card(model.dof, model.moment_unit).parameters]
    found = [estimate_of(trial.fit, covariance, i, unit) for i, unit in enumerate(units)]
    for varying in varying_terms(model):
        size = effects.get(varying).names_in(model.dof)[0]
        found[model.index(f"{varying}.{size}")] = _amplitude(study, trial, varying)
    return found


def _amplitude(study: Study, trial: Trial, name: str) -> Estimate:
    """Amplitude of what every run has a share of its own of, from the likelihood of their spread."""
    scale = float(np.sqrt(2.0) * (1.0 if study.driven else study.largest))
    low, high = (scale * end for end in trial.fit.factor_interval(name))
    value, unit = scale * trial.fit.factor(name), trial.model.moment_unit
    return Estimate(value, (high - low) / (2.0 * float(special.ndtri(0.975))), (low, high), unit)


def detectable(study: Study, found: Found) -> dict[str, float]:
    """Smallest size of each candidate's first parameter that these runs would have shown four times in five."""
    last = found.rounds[-1]
    sizes = {}
    for score in last.scores.ranked:
        needed = last.threshold + penalty(fitted_parameters(score.effect), len(study.runs))
        sizes[score.effect] = float(score.unit_size) * float(np.sqrt(max(needed, 1.0)) + special.ndtri(0.8))
    return sizes
