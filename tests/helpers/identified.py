"""The models of runs that were made here, without a file in between."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from automarine_cli.errors import FitError, RunError
from automarine_cli.filters.course import Course
from automarine_cli.fits.driven import driven_fits
from automarine_cli.fits.identify import YawFit, identify_turns
from automarine_cli.fits.whole_runs import OutputErrorFit
from automarine_cli.models.model import Model
from automarine_cli.models.parameter import NOTHING_KNOWN, Priors
from automarine_cli.report.fit_report import warnings_of
from automarine_cli.runs.channels import AUTO
from automarine_cli.runs.half_turn import UNTRIMMED, Trim, half_turns
from automarine_cli.runs.run import Run


def identify(runs: Sequence[Run], fit_to: str = "auto", trim: Trim = UNTRIMMED, channels: str = AUTO) -> YawFit:
    """`identify_turns` of the steps of `runs`, which are followed as far as `trim` says."""
    if not runs:
        raise RunError("there are no runs to fit; give at least one")
    turns, set_aside = half_turns(runs, trim)
    fit = identify_turns(runs[0].dof, turns, set_aside, runs, fit_to, map_jobs=as_sent, channels=channels)
    return replace(fit, warnings=warnings_of(fit))


def driven_fit(course: Course, rough: Model, number: str, priors: Priors = NOTHING_KNOWN) -> OutputErrorFit:
    """One model fitted to driven runs. Raises FitError with why they do not carry it."""
    [(fit, why)] = driven_fits(course, [number], priors, [rough])
    if fit is None:
        raise FitError(why)
    return fit


def as_sent(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
    """Map in this process what `--jobs 2` would send to others."""
    return [pickle.loads(pickle.dumps(function))(item) for item in items]
