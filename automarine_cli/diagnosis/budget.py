"""Where the gap comes from: noise, scatter between runs, each effect, and what is left over, in shares of one."""

import numpy as np

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.given import missed
from automarine_cli.diagnosis.study import Study, without_scatter
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.dofs import Dof
from automarine_cli.fits.innovations import InnovationsFit

SCATTER, LEFT = "scatter between runs", "left over"


def noise_of(dof: Dof) -> str:
    """What the noise is called."""
    return f"noise of the {dof.words.position}"


def budget(diagnosis: Diagnosis) -> dict[str, float]:
    """Shares of the mean square of measured less base-model headings on the runs fitted; they sum to one.

    The whole is taken with all runs alike but for their start heading and rate, and for what an effect of the model
    lets vary from run to run. Effects are added in the order in
    which they were found, everything refitted; what the runs' own gains, instants and disturbances then explain is
    scatter. A step that does not lessen the gap has a share of zero.
    """
    study, found = diagnosis.study, diagnosis.found
    stages = [found.base, *_stages(study, found.base, found.final)]
    squares = [_alike(study, trial) for trial in stages]
    level = whole = max(squares[0], diagnosis.gap.after**2, 1e-300)
    shares: dict[str, float] = {}
    for name, square in zip(found.final.added, squares[1:]):
        lower = min(level, max(square, 0.0))
        shares[name] = (level - lower) / whole
        level = lower
    after = min(diagnosis.gap.after**2, level)
    noise = min(study.floor**2, after)
    return {
        noise_of(study.base.dof): noise / whole,
        SCATTER: (level - after) / whole,
        **shares,
        LEFT: (after - noise) / whole,
    }


def _stages(study: Study, base: Trial, final: Trial) -> list[Trial]:
    """The base with one effect, two, ..., each refitted; the last is `final` itself."""
    own, stages = len(study.base.terms), []
    for count in range(1, len(final.added)):
        model = base.model
        for term in final.model.terms[own : own + count]:
            model = model.with_effect(term.name, term.values)
        fit = study.fit(model, model.theta, final.fit)
        stages.append(Trial(final.added[:count], study.told(model, fit), fit, np.nan))
    return [*stages, final] if final.added else []


def _alike(study: Study, trial: Trial) -> float:
    """Mean square gap [rad²] when nothing differs between runs but their starts and what an effect lets vary."""
    if isinstance(trial.fit, InnovationsFit):
        left = missed(study, trial.model, trial.fit)
        return float((left**2).sum() / max(int((left != 0.0).sum()), 1))
    problem = study.problem(trial.model)
    left = study.residual(problem.readings(trial.fit.phi, without_scatter(trial.fit)))
    return float((left**2).sum() / study.batch.seen.sum())
