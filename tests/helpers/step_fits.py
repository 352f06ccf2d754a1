"""One model fitted to step data, as `fit-yaw` fits it, from start values of one's choice."""

from automarine_cli.fits.steps import StepData, fit_step_model
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import COMMAND_DELAY
from automarine_cli.models.parameter import NOTHING_KNOWN, Priors


def fitted_steps(
    data: StepData, number: str, start: tuple[float, float, float], known: Priors = NOTHING_KNOWN
) -> OutputErrorFit:
    """Model `number` from `start`: inertia, linear and quadratic drag."""
    begin = {**dict(zip(("inertia", "linear", "quadratic"), start)), COMMAND_DELAY: 0.0}
    return fit_step_model(number, data, {number: begin}, priors=known, two_way=False)
