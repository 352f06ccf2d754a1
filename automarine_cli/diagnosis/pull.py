"""How the runs pull at what a model lacks: information and scores of probes, by either likelihood."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from automarine_cli.diagnosis.study import Fit, Study
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.innovations_problem import Slopes, innovations_of
from automarine_cli.fits.mixed_model import MixedFit, derivatives
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Each
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Pull:
    """Each run's information (R, m, m) on the parameters of a model and of all probes, and its score (R, m)."""

    hessian: Floats
    gradient: Floats


@dataclass(frozen=True)
class Probe:
    """One shape of a candidate: parameter values (m, k) whose responses span what it can do at that shape; `sized` are
    the parameters that the rows differ in."""

    effect: str
    values: Floats
    sized: tuple[int, ...]
    one_sided: bool


def pull_of(study: Study, model: YawModel, fit: Fit, names: Sequence[str], every: Sequence[Probe], each: Each) -> Pull:
    """Each run's information and score in the model's parameters and, after them, the sizes of all probes; `each` maps
    a function over the candidates, in processes or not."""
    if isinstance(fit, InnovationsFit):
        return _of_driven(study, model, fit, names, every)
    return _of_whole(study, model, fit, names, every, each)


def _of_whole(
    study: Study, model: YawModel, fit: MixedFit, names: Sequence[str], every: Sequence[Probe], each: Each
) -> Pull:
    """Each run's normal equations in the model's parameters and, after them, the sizes of all probes."""
    problem = study.problem(model)
    fitted, by_phi, by_run = derivatives(problem, fit.phi, fit.run_effects)
    values = [np.concatenate([probe.values for probe in every if probe.effect == name]) for name in names]
    work = list(zip(names, values))
    columns = np.concatenate(each(partial(_responses, study, model, fit), work, "looking at effects")) - fitted
    columns = np.where(problem.seen, columns, 0.0)
    sane = np.isfinite(columns).all(axis=(1, 2), keepdims=True)
    columns = np.where(sane, columns, 0.0)  # a probe that runs away says nothing
    j = np.concatenate([by_phi, np.moveaxis(columns, 0, 2)], axis=2)
    data = problem.residual(fitted) + np.einsum("rnq,rq->rn", by_run, fit.run_effects)
    weighted = linear_mixed.weigh(problem.inner(j, by_run, data), problem.effects, fit.variances)
    return Pull(weighted.hessian, weighted.gradient)


def _of_driven(
    study: Study, model: YawModel, fit: InnovationsFit, names: Sequence[str], every: Sequence[Probe]
) -> Pull:
    """The same of driven runs: what each probe changes in the innovations and in their variances."""
    problem = study.driven_problem(model)
    whole, own = slice(None), len(fit.of_model)
    found = [innovations_of(problem.follow(problem.moved(fit.phi)), whole, problem.steps(fit.phi))]
    for name in names:
        values = np.concatenate([probe.values for probe in every if probe.effect == name])
        wider = study.driven_problem(model.with_effect(name, values[0]))
        theta = np.tile(fit.theta, (len(values), 1))
        theta = np.concatenate([theta[:, :own], values, theta[:, own:]], axis=1)
        if len(wider.random) > len(problem.random):  # what an effect may let vary has a score of its own
            theta = np.concatenate([theta, np.full((len(values), 1), 1e-9)], axis=1)
        found.append(innovations_of(wider.follow(wider.search(theta)), whole, 1.0, found[0]))
    slopes = Slopes.of(found)
    free, count = problem.free, len(fit.phi)
    places = np.concatenate([free, np.arange(count, count + slopes.gradient.shape[1] - len(free))])
    hessian = np.zeros((len(study.runs), places[-1] + 1, places[-1] + 1))
    gradient = np.zeros(hessian.shape[:2])
    hessian[:, places[:, None], places] = slopes.information
    gradient[:, places] = slopes.gradient
    return Pull(hessian, gradient)


def _responses(study: Study, model: YawModel, fit: MixedFit, candidate: tuple[str, Floats]) -> Floats:
    """Headings (m, R, N) of the fitted model with a candidate added at each of its values (m, k)."""
    name, values = candidate
    problem = study.problem(model.with_effect(name, values[0]))
    count, own = len(values), fit.effects.carried(fit.run_effects, problem.effects)
    theta = np.concatenate([np.tile(fit.of_model, (count, 1)), values, np.full((count, 1), fit.value(SWITCH))], axis=1)
    return problem.response(theta, np.tile(own, (count, 1, 1)))
