"""A curve of the thrust against the size of the command that hides in the gains of single runs.

Where each run has commands of one size, a gain a run follows any curve of the thrust: no residual shows it, and a
dead-band or an exponent alone leaves most of it to the gains. So both are fitted together.
"""

import numpy as np

from automarine_cli.diagnosis.refits import trial_of
from automarine_cli.diagnosis.study import Fit, Study
from automarine_cli.diagnosis.trials import CURVE, Trial
from automarine_cli.errors import FitError
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

LARGE, STEEP, SURE = 0.1, 0.2, 5.0
"""Scatter of the gains, exponent by which they go with the size of the command, and its standard errors, from which
both are no chance and no trifle."""
SETTLES = 1.0 / 3.0
"""Share of the scatter that may stay where something explains it."""
WIDTHS = (0.1, 0.5)
"""Dead-bands that fits begin with, in shares of the smallest command."""


def gain_exponent(study: Study, fit: Fit) -> Estimate | None:
    """With which power of the command's size (root mean square while there is one) the gains of single runs go; None
    where the runs have commands of one size, or a disturbance hides their gains."""
    if study.driven:
        return None
    size = _sizes(study)
    used = np.isfinite(size)
    x, y = np.log(size[used]), fit.own(GAIN)[used, 0]
    dof = len(x) - 2
    spread = float(((x - x.mean()) ** 2).sum()) if dof > 0 else 0.0
    if spread < 0.05:
        return None
    slope = float(((x - x.mean()) * y).sum()) / spread
    left = y - y.mean() - slope * (x - x.mean())
    return Estimate.from_stderr(slope, float(np.sqrt((left**2).sum() / dof / spread)), dof, "1")


def _sizes(study: Study) -> Floats:
    driving = (run.command[run.command != 0.0] for run in study.runs)
    return np.array([np.sqrt(np.mean(one**2)) if len(one) else np.nan for one in driving])


def curved(study: Study, base: Trial) -> Trial | None:
    """The base with a dead-band and an exponent of the thrust, fitted together, where the gains of its runs go with the
    size of the command and do so no longer with both; None where not."""
    steep = gain_exponent(study, base.fit)
    scatter = base.fit.factor(GAIN)
    if steep is None or scatter < LARGE or abs(steep.value) < max(STEEP, SURE * steep.stderr):
        return None
    smallest, found = float(np.nanmin(_sizes(study))), list[Trial]()
    for share in WIDTHS:
        model = base.model.with_effect("dead-band", (share * smallest, 0.0, 0.5))
        model = model.with_effect("thrust-exponent", (1.0 + steep.value, study.reference("moment")))
        try:
            found.append(trial_of(study, model, (*base.added, *CURVE), study.fit(model, model.theta, base.fit)))
        except (FitError, np.linalg.LinAlgError):
            continue
    best = min(found, key=lambda trial: trial.evidence, default=None)
    return best if best is not None and settles(best, base) and best.evidence < base.evidence else None


def settles(trial: Trial, base: Trial) -> bool:
    """Whether a trial explains most of what the gains of the base scatter by."""
    return trial.fit.factor(GAIN) < SETTLES * base.fit.factor(GAIN)
