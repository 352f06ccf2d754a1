"""The models of runs that were made here, without a file in between."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from automarine_cli.errors import RunError
from automarine_cli.fits.identify import YawFit, identify_turns
from automarine_cli.report.fit_report import warnings_of
from automarine_cli.runs.channels import AUTO
from automarine_cli.runs.half_turn import UNTRIMMED, Trim, half_turns
from automarine_cli.runs.run import Run


def identify(runs: Sequence[Run], fit_to: str = "auto", trim: Trim = UNTRIMMED, channels: str = AUTO) -> YawFit:
    """`identify_turns` of the steps of `runs`, which are followed as far as `trim` says."""
    if not runs:
        raise RunError("there are no runs to fit; give at least one")
    turns, set_aside = half_turns(runs, trim)
    fit = identify_turns(runs[0].dof, turns, set_aside, lambda: runs, fit_to, map_jobs=as_sent, channels=channels)
    return replace(fit, warnings=warnings_of(fit))


def as_sent(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
    """Map in this process what `--jobs 2` would send to others."""
    return [pickle.loads(pickle.dumps(function))(item) for item in items]
