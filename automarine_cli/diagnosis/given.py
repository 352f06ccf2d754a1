"""Runs under parameters of others: their own effects, what is left of their positions, what disturbs them."""

from collections.abc import Sequence

import numpy as np

from automarine_cli.diagnosis.search import Trial
from automarine_cli.diagnosis.study import JUDGED, Study
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.mixed_model import Problem, derivatives
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.quantities import Floats


def missed(study: Study, model: YawModel, fit: InnovationsFit) -> Floats:
    """Measured less predicted positions (R, N) of driven runs, predicted JUDGED seconds before; zero where none was."""
    found = next(one for one in study.predictions(model, fit) if one.horizon == JUDGED)
    each = [found.run == r for r in range(len(study.runs))]
    when = [study.course.time[r, found.target[own]] for r, own in enumerate(each)]
    return _at_samples(study, [found.error[own] for own in each], when)


def disturbance(study: Study, model: YawModel, fit: InnovationsFit) -> Floats:
    """The disturbing moment or force that the filter sees at each sample of driven runs, (R, N)."""
    followed = study.driven_problem(model).follow(fit.phi[None], keep=True)
    assert followed.states is not None
    pushed = followed.states[followed.places.pushed[0], 0]
    ends = [int((length > 0).sum()) + 1 for length in study.course.length]
    times = [t[:end] for t, end in zip(study.course.time, ends)]
    return fit.theta[0] * _at_samples(study, [row[:end] for row, end in zip(pushed, ends)], times)


def _at_samples(study: Study, values: Sequence[Floats], at: Sequence[Floats]) -> Floats:
    """What is known of each run at some times [s since its first sample], at all its samples (R, N): straight lines
    between, zero before the first and in the padding."""
    out = np.zeros(study.batch.seen.shape)
    for row, run, value, when in zip(out, study.runs, values, at):
        if len(when):
            time = run.time - run.time[0]
            row[: len(run)] = np.where(time >= when[0] - 1e-9, np.interp(time, when, value), 0.0)
    return out


def log_density(study: Study, trial: Trial) -> Floats:
    """Log density of each run of `study` (R,) under a trial that was fitted to others, linearised at the run effects'
    posterior means as fits are."""
    if isinstance(trial.fit, InnovationsFit):
        return study.log_density(trial.model, trial.fit)
    problem, variances = study.problem(trial.model), trial.fit.variances
    phi = problem.search(trial.fit.theta)
    b, _ = run_effects_given(problem, phi, variances)
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    gram = problem.gram(by_phi, by_run, fitted, b)
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    return linear_mixed.predictive(gram, weighted, np.zeros((len(b), len(phi))))


def run_effects_given(problem: Problem, phi: Floats, variances: Floats, rounds: int = 12) -> tuple[Floats, Floats]:
    """Posterior means of the run effects (R, q) of runs that were not fitted, and the headings with them (R, N).

    `phi` and `variances` come from other runs. Each round linearises about the last run effects and takes, run by
    run, the share of the step that fits best, so that no run can wander.
    """
    scale = problem.effects.deviation(variances)
    shares = np.array([1.0, 0.5, 0.2])[:, None, None]

    def costs(fitted: Floats, b: Floats) -> Floats:
        penalty = np.divide(b, scale, out=np.zeros_like(b), where=scale > 0) ** 2
        found = problem.squares(problem.residual(fitted), variances) + penalty.sum(axis=-1)
        return np.where(np.isfinite(found), found, np.inf)

    b = np.zeros_like(problem.effects.scale)
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    for _ in range(rounds):
        data = problem.residual(fitted) + by_phi @ phi + np.einsum("rnq,rq->rn", by_run, b)
        gram = problem.inner(by_phi, by_run, data)
        step = linear_mixed.posterior_mean(gram, problem.effects, variances, phi) - b
        trials = b + shares * step
        tried = problem.response(np.tile(problem.natural(phi), (len(trials), 1)), trials)
        found = np.stack([costs(h, e) for h, e in zip(tried, trials)])
        best, now = found.argmin(axis=0), costs(fitted, b)
        better = found.min(axis=0) < now * (1.0 - 1e-6)
        if not better.any():
            break
        runs = np.arange(len(b))
        b = np.where(better[:, None], trials[best, runs], b)
        fitted, by_phi, by_run = derivatives(problem, phi, b)
    return b, fitted
