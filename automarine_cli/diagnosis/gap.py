"""How far simulation and measurement are apart, before and after, on runs fitted and on runs held out."""

from dataclasses import dataclass

import numpy as np

from automarine_cli.diagnosis.given import missed, run_effects_given
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.dofs import Dof
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.quantities import Floats


@dataclass(frozen=True)
class Gap:
    """Root mean square of measured less simulated heading [rad] over all samples of a set of runs.

    Each run's own start heading, start rate, thrust gain and switch instants are taken at their posterior means: what
    is left is what the model lacks, and noise. `floor` is the noise of the heading estimated without a model.
    `residuals_before` and `residuals_after` (R, N) are the headings' own, zero in the padding.
    """

    before: float
    after: float
    floor: float
    residuals_before: Floats
    residuals_after: Floats

    def above(self, size: float) -> float:
        """By how much a gap's mean square is above the noise [rad²]."""
        return size**2 - self.floor**2

    @property
    def in_noises(self) -> str:
        """Both in units of the noise, in words."""
        floor = max(self.floor, 1e-12)
        return f"{self.after / floor:.1f} times the noise, and was {self.before / floor:.1f} times"

    def to_json(self, dof: Dof) -> dict[str, float]:
        """The contract's form, in the unit in which people see positions."""
        key = dof.units.key
        return {
            f"before_{key}": float(dof.shown(self.before)),
            f"after_{key}": float(dof.shown(self.after)),
            f"noise_floor_{key}": float(dof.shown(self.floor)),
        }


def gap(study: Study, base: Trial, final: Trial, fitted: bool = False) -> Gap:
    """The gap of the base and of the final model on the runs of `study`; `fitted` if both were fitted to these."""
    before, after = residuals(study, base, fitted), residuals(study, final, fitted)
    return Gap(_size(study, before), _size(study, after), study.floor, before, after)


def residuals(study: Study, trial: Trial, fitted: bool = False) -> Floats:
    """Measured less simulated headings (R, N) [rad] with each run's own effects at their posterior means; of driven
    runs measured less predicted ones, JUDGED seconds ahead from the filtered state."""
    if isinstance(trial.fit, InnovationsFit):
        return missed(study, trial.model, trial.fit)
    problem = study.problem(trial.model)
    if fitted:
        return study.residual(trial.fit.fitted)
    simulated = run_effects_given(problem, problem.search(trial.fit.theta), trial.fit.variances)[1]
    return study.residual(simulated)


def _size(study: Study, residual: Floats) -> float:
    shown = study.batch.seen if not study.driven else residual != 0.0
    return float(np.sqrt((residual**2).sum() / max(int(shown.sum()), 1)))
