"""Which runs are fitted as driven ones, and the three models on them."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course
from automarine_cli.fits.driven import disturbed, stepped
from automarine_cli.fits.driven_fit import beside_forecasts, fit_driven
from automarine_cli.fits.known import Prior
from automarine_cli.fits.output_error import OutputErrorFit
from automarine_cli.fits.ways import by_way
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

Map = Callable[[Callable[[str], Any], Sequence[str]], Sequence[Any]]

LEAST_WAY = 0.1
"""Share of all that the runs went that has to go each way before drag may differ between the ways."""
STEPS = (0.1, 0.025)
"""Largest simulation steps [s] for whole runs, tried in turn."""


def is_driven(
    runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None, with_effects: Sequence[str]
) -> bool:
    """Whether whole runs are fitted by innovations: where the evidence asks, or effects beside drag are wanted."""
    if with_effects:
        return True
    try:
        rough = rough_model("2", make_batch(runs, STEPS[0]))
        return disturbed(runs, rough, at_rest, channels)
    except FitError:  # what is wrong with them, their fit will say
        return 2 * sum(stepped(run) for run in runs) < len(runs)


def fitted_driven(
    runs: Sequence[Run], course: Course, each: Map, with_effects: Sequence[str], known: Mapping[str, Prior]
) -> tuple[dict[str, OutputErrorFit], dict[str, str]]:
    """The models that driven runs can carry, and why others are not fitted; with none, the first one's refusal."""
    ask = partial(_fit_driven_model, runs=runs, course=course, with_effects=tuple(with_effects), known=known)
    found = dict(zip("123", each(ask, ("1", "2", "3"))))
    kept = {number: one for number, one in found.items() if isinstance(one, OutputErrorFit)}
    if not kept:
        raise next(one for one in found.values() if isinstance(one, FitError))
    return kept, {number: str(one) for number, one in found.items() if isinstance(one, FitError)}


def _fit_driven_model(
    number: str, runs: Sequence[Run], course: Course, with_effects: tuple[str, ...], known: Mapping[str, Prior]
) -> OutputErrorFit | FitError:
    """One model, or why the runs do not carry it; finer steps where it turns out to be fast."""
    batch, both = make_batch(runs, STEPS[0]), both_ways(runs)

    def fit(sided: bool) -> OutputErrorFit:
        return fit_driven(course, rough_model(number, batch, sided), number, sided, with_effects, known)

    try:
        return beside_forecasts(course, by_way(fit, batch.dof, both))
    except FitError as error:
        return error


def both_ways(runs: Sequence[Run]) -> bool:
    """Whether a tenth of all that the runs went, or more, went each way."""
    steps = np.concatenate([np.diff(run.position[:: max(1, round(1.0 / run.sample_period))]) for run in runs])
    gone = float(steps[steps > 0].sum()), float(-steps[steps < 0].sum())
    return min(gone) > LEAST_WAY * sum(gone)
