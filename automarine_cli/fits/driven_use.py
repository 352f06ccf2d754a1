"""Of what use a model of driven runs is: whether it predicts better than somebody who expects no change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.filters.course import Course
from automarine_cli.filters.prediction import Predicted, free_run
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.driven_fit import Worth, left_out_predictions, proposals, worth_of
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.output_error import OutputErrorFit

Floats = NDArray[np.float64]

JUDGED = 5.0
"""Seconds ahead over which a model has to be of use."""


@dataclass(frozen=True)
class Use:
    """What the preferred model is worth on runs left out of its fit, by horizon; what the evidence would add to it
    (`proposed`, the deviance gained, by effect). For people to look at: the `predictions` on the nodes of the `course`,
    the `free` run of each from its first filtered state on (R, K + 1), not a number before that, and the `disturbance`
    that the filter saw (R, K + 1), a moment or force."""

    worth: tuple[Worth, ...]
    proposed: Mapping[str, float]
    course: Course = field(repr=False)
    predictions: tuple[Predicted, ...] = field(repr=False)
    free: Floats = field(repr=False)
    disturbance: Floats = field(repr=False)

    @property
    def judged(self) -> Worth | None:
        """Over the horizon that decides, or the longest below it."""
        return judged_of(self.worth)

    @property
    def of_use(self) -> bool:
        """Whether the model predicts better than constants do; what cannot be judged counts as of use."""
        return self.judged is None or self.judged.of_use

    def sentence(self, dof: Dof) -> str:
        """One line: of what use the model is."""
        one = self.judged
        if one is None:
            return "The runs are too short to judge predictions."
        if one.of_use:
            return f"The model predicts {one.beside(dof)} (runs left out of the fit)."
        return (
            f"This model is of no use: it predicts {one.beside(dof)} (runs left out of the fit). Do not simulate or "
            "control with it; `automarine diagnose` looks for what it lacks."
        )

    def warnings(self, dof: Dof) -> tuple[str, ...]:
        """What a person must know first."""
        found = () if self.of_use else (self.sentence(dof),)
        if not self.proposed:
            return found
        names = ",".join(self.proposed)
        asks = "; ".join(
            f"{name} ({effects.get(name).card(dof).says.rstrip('.').lower()}) gains {gain:.0f} in deviance"
            for name, gain in self.proposed.items()
        )
        return (*found, f"The evidence asks for more than drag: {asks}. Fit it with --with {names}.")


def judged_of(worth: Sequence[Worth]) -> Worth | None:
    """What decides of several horizons: JUDGED, or the longest below it."""
    return max((one for one in worth if one.horizon <= JUDGED), key=lambda w: w.horizon, default=None)


def use_of(course: Course, fit: OutputErrorFit) -> Use:
    """Judge a fit of driven runs on each run by the others."""
    found = fit.mixed
    assert isinstance(found, InnovationsFit)
    problem = driven_problem(fit.model, course)
    predictions = left_out_predictions(problem, found)
    followed = problem.follow(found.phi[None], keep=True)
    assert followed.states is not None
    return Use(
        worth_of(predictions),
        proposals(course, fit),
        course,
        predictions,
        free_run(fit.model, course, found.of_model, problem.noises(found.theta[None])),
        fit.model.inertia * followed.states[followed.places.pushed[0], 0],
    )
