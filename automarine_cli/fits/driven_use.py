"""Of what use a model of driven runs is: whether it predicts better than somebody who expects no change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.filters.course import Course
from automarine_cli.filters.prediction import Predicted, free_run
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.driven_fit import Worth, left_out_predictions, proposals, worth_of
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.output_error import OutputErrorFit, Preference
from automarine_cli.quantities import Floats

JUDGED, PREFERRED = 5.0, 2.0
"""Seconds ahead over which a model has to be of use, and over which one is preferred to another."""


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
        alone = len(self.course.names) == 1
        of = "the run that was fitted: others may be predicted worse" if alone else "runs left out of the fit"
        if one.of_use:
            return f"The model predicts {one.beside(dof)} ({of})."
        return (
            f"This model is not usable: it predicts {one.beside(dof)} ({of}). Do not simulate or control with it; "
            "`automarine diagnose` looks for what it lacks."
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
        return (*found, f"The data need more than drag: {asks}. Fit it with --with {names}.")


def judged_of(worth: Sequence[Worth]) -> Worth | None:
    """What decides of several horizons: JUDGED, or the longest below it."""
    return max((one for one in worth if one.horizon <= JUDGED), key=lambda w: w.horizon, default=None)


def left_out(course: Course, fits: Mapping[str, OutputErrorFit]) -> dict[str, tuple[Predicted, ...]]:
    """Predictions of each driven run by each model fitted to the other runs."""
    found = {}
    for number, fit in fits.items():
        assert isinstance(fit.mixed, InnovationsFit)
        found[number] = left_out_predictions(driven_problem(fit.model, course), fit.mixed)
    return found


def prefer_driven(
    fits: Mapping[str, OutputErrorFit], ahead: Mapping[str, tuple[Predicted, ...]], dof: Dof
) -> Preference | None:
    """The model that predicts runs left out of its fit best, PREFERRED seconds ahead; of two that do not differ by two
    standard errors over runs, the simpler. None where the runs are too short, or one alone, to tell.

    Likelihood would weigh what happens within a reading or two; where none of the models has the law of nature, that is
    not what they are used for. Over longer horizons the logged command answers disturbances that no model knows of.
    """
    judged = {number: next((p for p in one if p.horizon == PREFERRED), None) for number, one in ahead.items()}
    runs = max((len(fit.mixed.left_out) for fit in fits.values()), default=0)
    if runs < 2 or any(one is None or not len(one.error) for one in judged.values()):
        return None
    squares = {number: one.by_run(one.error, runs) for number, one in judged.items() if one is not None}
    sizes = {number: one.rmse() for number, one in judged.items() if one is not None}
    best = min(sizes, key=lambda number: sizes[number])
    chosen = best
    parameters = {number: len(fit.model.theta) for number, fit in fits.items()}
    for number in sorted(sizes, key=lambda n: parameters[n]):
        worse = squares[number] - squares[best]
        worse = worse[np.isfinite(worse)]
        error = float(np.std(worse, ddof=1)) / np.sqrt(len(worse)) if len(worse) > 1 else np.inf
        if parameters[number] < parameters[chosen] and worse.mean() <= 2.0 * error:
            chosen = number
    told = [f"{dof.shown(sizes[chosen]):.3g} {dof.units.shown}"]
    told += [f"model {number} {dof.shown(size):.3g}" for number, size in sorted(sizes.items()) if number != chosen]
    how = "best" if chosen == best else "as well as any with more parameters"
    return Preference(
        chosen, f"Model {chosen} predicts runs left out of the fit {how} {PREFERRED:g} s ahead, to {', '.join(told)}."
    )


def use_of(course: Course, fit: OutputErrorFit, predictions: tuple[Predicted, ...]) -> Use:
    """Judge a fit of driven runs on each run by the others."""
    found = fit.mixed
    assert isinstance(found, InnovationsFit)
    problem = driven_problem(fit.model, course)
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
