"""Models with an effect more, fitted to whole runs: everything refitted together, edges moved to their places."""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.scores import candidate_shapes, fitted_parameters, law_of, penalty
from automarine_cli.diagnosis.study import FIT_ROUNDS, MIN_STEP_DEVIANCE, DiagnosisProblem, Fit, smoothed
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.errors import FitError
from automarine_cli.filters.kalman import alike
from automarine_cli.models.model import BASE_TERMS, Model, Term
from automarine_cli.pipeline.parallel import Each
from automarine_cli.quantities import Floats

BASE_DRAG = BASE_TERMS["2"]  # effects that put the drag of the base right
CURVE = ("dead-band", "thrust-exponent")  # together the curve of the thrust, which counts as one effect


@dataclass(frozen=True)
class CandidateFit:
    """A model with its fit; `evidence` is in deviance, smaller is better."""

    added: tuple[str, ...]
    model: Model
    fit: Fit
    evidence: float

    @property
    def counted(self) -> tuple[str, ...]:
        """The effects added, without what puts the drag of the base right beside others."""
        return tuple(name for name in self.added if name not in BASE_DRAG) or self.added

    @property
    def count(self) -> int:
        return len(self.counted) - (set(CURVE) <= set(self.counted))

    @property
    def law(self) -> tuple[object, ...]:
        return law_of(self.added[-1], self.model.terms[-1].values)


def candidate_fit(study: DiagnosisProblem, model: Model, added: tuple[str, ...], fit: Fit) -> CandidateFit:
    """The fit with its evidence, that of the point at which it stopped; of a learned curve the effective number of
    parameters counts."""
    model = study.with_fitted_values(model, fit)
    counts = [
        smoothed(fit, model)[1] if term.name.startswith(PREFIX) else fitted_parameters(term.name, term.values)
        for term in model.terms[len(study.base.terms) :]
    ]
    evidence = -2.0 * fit.log_likelihood + penalty(sum(counts), len(study.runs))
    return CandidateFit(added, model, fit, evidence + fit.promised)


Attempt = tuple[Model, tuple[str, ...], Floats, Fit]
"""A model to be fitted, what was added to it, values from which it starts, and a fit that knows everything else."""


def attempt_with(current: CandidateFit, candidate: tuple[str, Floats]) -> Attempt:
    """A model with an effect more, from these values of its parameters."""
    name, start = candidate
    values = np.concatenate([current.fit.of_model, start])
    return current.model.with_effect(name, start), (*current.added, name), values, current.fit


def attempt_on(trial: CandidateFit, model: Model | None = None) -> Attempt:
    """A trial from where it is, or from the values of a `model` with the same terms."""
    model, values = (trial.model, trial.fit.of_model) if model is None else (model, model.theta)
    return model, trial.added, values, trial.fit


def refitted(
    study: DiagnosisProblem, model: Model, added: tuple[str, ...], values: Floats, warm_start: Fit,
    iterations: int = FIT_ROUNDS, least_gain: float = MIN_STEP_DEVIANCE,
) -> CandidateFit | None:  # fmt: skip
    try:
        return candidate_fit(study, model, added, study.fit(model, values, warm_start, iterations, least_gain))
    except (FitError, np.linalg.LinAlgError):
        return None


def all_refitted(
    study: DiagnosisProblem, attempts: Sequence[Attempt], iterations: int, map_fn: Each, stage: str,
    least_gain: float = MIN_STEP_DEVIANCE,
) -> list[CandidateFit | None]:  # fmt: skip
    """Fit each attempt as `refitted` does; those of driven runs side by side that one filter may follow."""
    sizes = [(1 + len(fit.theta)) * len(study.runs) for *_, fit in attempts]
    groups = alike([model for model, *_ in attempts], sizes) if study.driven else [[i] for i in range(len(attempts))]
    batches = [[attempts[i] for i in group] for group in groups]
    fits = map_fn(partial(_side_by_side, study, iterations, least_gain), batches, stage)
    by_place = {i: trial for group, trials in zip(groups, fits) for i, trial in zip(group, trials)}
    return [by_place[i] for i in range(len(attempts))]


def _side_by_side(
    study: DiagnosisProblem, iterations: int, least_gain: float, attempts: Sequence[Attempt]
) -> list[CandidateFit | None]:
    trials = list[CandidateFit | None]()
    if len(attempts) > 1:
        models, every_added, values, starts = zip(*attempts)
        with contextlib.suppress(np.linalg.LinAlgError):  # of one of them: then each alone
            fits = zip(models, every_added, study.fits_beside(models, values, starts, iterations))
            trials = [None if fit is None else candidate_fit(study, model, added, fit) for model, added, fit in fits]
    trials = trials or [refitted(study, *attempt, iterations, least_gain) for attempt in attempts]
    return [trial and placed(study, trial, iterations, least_gain) for trial in trials]


EDGES = 1.04 ** np.arange(-40.0, 41.0)  # times an edge: places that are tried for it
DIVERGED = 1e99  # deviance of a simulation that runs away
EDGE_ROUNDS = 4  # in which edges and what is fitted beside them settle


def edges_of(model: Model, first: int = 0) -> list[int]:
    """Places of the model's parameters that are edges of its effects, from its `first` term on."""
    terms = model.terms[first:]
    flags = {name: edge for t in terms for name, edge in zip(model.names_of(t), t.effect.placed(t.values))}
    return [i for i, name in enumerate(model.parameter_names) if flags.get(name)]


def along_edge(study: DiagnosisProblem, trial: CandidateFit, i: int) -> tuple[Floats, Floats]:
    """Places (P,) of an edge, parameter i, the trial's in the middle, and deviances (P,), all else as fitted."""
    thetas = np.tile(trial.fit.theta, (len(EDGES), 1))
    thetas[:, i] *= EDGES
    deviances = study.deviances(trial.model, trial.fit, trial.fit.parameters.search(thetas))
    return thetas[:, i], np.nan_to_num(deviances, nan=DIVERGED, posinf=DIVERGED)


def _with_edge(trial: CandidateFit, i: int, place: float) -> Model:
    values = trial.fit.of_model.copy()
    values[i] = place
    return trial.model.with_theta(values)


def placed(study: DiagnosisProblem, trial: CandidateFit, iterations: int, least_gain: float) -> CandidateFit:
    """Move the edges of a trial to where the likelihood is highest with all else as fitted, or over the next command to
    either side, and fit all else again, as long as that gains; a brief fit has them where it began."""
    for _ in range(EDGE_ROUNDS if iterations > SEARCH_BRIEF else 0):
        tried = list[CandidateFit | None]()
        for i in edges_of(trial.model, len(study.base.terms)):
            places, deviance = along_edge(study, trial, i)
            # the deviance is level between two commands
            level = np.cumsum(np.abs(np.diff(deviance, prepend=deviance[0])) > SETTLED_EVIDENCE)
            at = level[len(EDGES) // 2]
            for k in sorted({level[deviance.argmin()], at - 1, at + 1} & {*level} - {at}):
                attempt = attempt_on(trial, _with_edge(trial, i, np.median(places[level == k])))
                tried.append(refitted(study, *attempt, iterations, least_gain))
        better = [t for t in tried if t is not None and t.evidence < trial.evidence - SETTLED_EVIDENCE]
        if not better:
            break
        trial = min(better, key=lambda trial: trial.evidence)
    return trial


def settled(study: DiagnosisProblem, trial: CandidateFit, least_gain: float) -> CandidateFit:
    """Fit a trial of runs that are simulated whole until a step gains less than `least_gain`."""
    if study.driven:
        return trial
    values = trial.fit.of_model
    return refitted(study, trial.model, trial.added, values, trial.fit, FINE_ITERATIONS, least_gain) or trial


def with_values(model: Model, term: Term, values: Iterable[float]) -> Model:
    """Return the model with other values of one of its terms."""
    changed = replace(term, values=tuple(map(float, values)))
    return replace(model, terms=tuple(changed if other is term else other for other in model.terms))


def shapes_by_law(study: DiagnosisProblem, name: str) -> dict[tuple[object, ...], list[Floats]]:
    """The values of an effect's parameters from which each of its laws is fitted."""
    by_law: dict[tuple[object, ...], list[Floats]] = {}
    for shape in candidate_shapes(study, name):
        by_law.setdefault(law_of(name, shape.values[-1]), []).append(shape.values[-1])
    return by_law


def in_law(trial: CandidateFit, start: Floats, place: int = -1) -> Model:
    """Return a trial's model with the term in `place` in the law of a `start` (k,) of it, and as large as it is."""
    term = trial.model.terms[place]
    of_law = [bool(p.choices or p.laws) for p in effects.get(term.name).parameters]
    return with_values(trial.model, term, np.where(of_law, start, term.values))


def variants(study: DiagnosisProblem, trial: CandidateFit) -> list[Model]:
    """List a trial's model with each effect that was added in every shape of every law of it; a curve has one. One with
    edges is listed once a law, and with its edges wherever they are as likely."""
    models: dict[tuple[float, ...], Model] = {}
    for term in trial.model.terms[len(study.base.terms) :]:
        effect = effects.get(term.name)
        if len(effect.parameters) > 1 and not isinstance(effect, Learned):
            shapes = [probe.values[-1] for probe in candidate_shapes(study, term.name)]
            if any(effect.placed(term.values)):
                shapes.sort(key=lambda values: -abs(values[0] - term.values[0]))
                shapes = list({law_of(term.name, values): values for values in shapes}.values())  # the nearest of each
            for values in shapes:
                model = with_values(trial.model, term, values)
                models.setdefault(tuple(model.theta), model)
    for i in edges_of(trial.model, len(study.base.terms)):
        places, deviance = along_edge(study, trial, i)
        for place in places[deviance < deviance[len(places) // 2] + TIE]:
            model = _with_edge(trial, i, place)
            models.setdefault(tuple(model.theta), model)
    return list(models.values())


def without(study: DiagnosisProblem, trial: CandidateFit, *out: str) -> CandidateFit | None:
    base, model = len(study.base.terms), trial.model
    remaining = [term for term in model.terms[base:] if term.name not in out]
    drag = [b if set(out) & set(BASE_DRAG) and t.values == (0.0,) else t for b, t in zip(study.base.terms, model.terms)]
    model = replace(model, terms=(*drag, *remaining))
    return refitted(study, model, tuple(term.name for term in remaining), model.theta, trial.fit)


TIE = 10.0  # difference of evidence (in deviance) below which two explanations count as tied


SEARCH_BRIEF = 4  # iterations that every candidate's fit gets; only those in the running are fitted to the end


FINE, FINE_ITERATIONS = 0.1, 50  # least gain of a step, and iterations, of what candidates are compared with
SETTLED_EVIDENCE = 0.5  # gain in evidence below which another fit of the same model is no better
