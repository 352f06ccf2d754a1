"""Of what use a model of driven runs is: whether it predicts better than somebody who expects no change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.filters.course import Course
from automarine_cli.filters.prediction import Predicted, free_run
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.driven_fit import COMPARED, Worth, left_out_predictions, whole_predictions, worth_of
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.output_error import OutputErrorFit, Preference
from automarine_cli.quantities import Floats

JUDGED = 5.0
"""Seconds ahead over which a model has to be of use."""
LARGE = 1.0
"""Times the commands, both as root mean squares, from which on a disturbance is said to be as large as they are."""


@dataclass(frozen=True)
class Judgement:
    """What the preferred model is worth, by horizon, on each of so many `runs` by a fit to the others."""

    worth: tuple[Worth, ...]
    runs: int

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
        alone = self.runs == 1
        of = "the run that was fitted: others may be predicted worse" if alone else "runs left out of the fit"
        if one.of_use:
            return f"The model predicts {one.beside(dof)} ({of})."
        return (
            f"This model is not usable: it predicts {one.beside(dof)} ({of}). Do not simulate or control with it; "
            "`automarine diagnose` looks for what it lacks."
        )

    def warnings(self, dof: Dof) -> tuple[str, ...]:
        """What a person must know first."""
        return () if self.of_use else (self.sentence(dof),)


@dataclass(frozen=True)
class Use(Judgement):
    """The same of driven runs, and what the evidence would add (`proposed`, the deviance gained, by effect). For people
    to look at: the `predictions` on the nodes of the `course`, the `free` run of each from its first filtered state on
    (R, K + 1), not a number before that, and the `disturbance` that the filter saw (R, K + 1), a moment or force;
    `large` is a sentence where that is as large as the commands."""

    proposed: Mapping[str, float]
    course: Course = field(repr=False)
    predictions: tuple[Predicted, ...] = field(repr=False)
    free: Floats = field(repr=False)
    disturbance: Floats = field(repr=False)
    large: str = ""

    def warnings(self, dof: Dof) -> tuple[str, ...]:
        """What a person must know first."""
        found = super().warnings(dof) + ((self.large,) if self.large else ())
        if not self.proposed:
            return found
        names = ",".join(self.proposed)
        asks = "; ".join(
            f"{name} ({effects.get(name).card(dof).says.rstrip('.').lower()}) gains {gain:.0f} in deviance"
            for name, gain in self.proposed.items()
        )
        need = f"The data need more than drag: {asks}. The intervals allow for it; fit it with --with {names}."
        return (*found, need)


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
    """The model that predicts runs left out of its fit best, over COMPARED seconds; the best of those with the fewest
    parameters if one of them does not differ by two standard errors over runs. None where the runs are too short, or
    one alone, to tell.

    Likelihood would weigh what happens within a reading or two; where none of the models has the law of nature, that is
    not what they are used for. Over longer horizons the logged command answers disturbances that no model knows of.
    """
    judged = {number: [p for p in one if p.horizon in COMPARED] for number, one in ahead.items()}
    runs = max((len(fit.mixed.left_out) for fit in fits.values()), default=0)
    if runs < 2 or any(not len(p.error) for one in judged.values() for p in one):
        return None
    sizes = {number: np.array([p.rmse() for p in one]) for number, one in judged.items()}
    least = np.min(list(sizes.values()), axis=0)
    squares = {
        number: np.mean([p.by_run(p.error, runs) / size**2 for p, size in zip(one, least)], axis=0)
        for number, one in judged.items()
    }
    score = {number: float(np.mean((size / least) ** 2)) for number, size in sizes.items()}
    best = min(score, key=lambda number: score[number])
    parameters = {number: len(fit.model.theta) for number, fit in fits.items()}

    def level(number: str) -> bool:
        worse = squares[number] - squares[best]
        worse = worse[np.isfinite(worse)]
        error = float(np.std(worse, ddof=1)) / np.sqrt(len(worse)) if len(worse) > 1 else np.inf
        return bool(worse.mean() <= 2.0 * error)

    fewest = min(parameters[number] for number in score if number == best or level(number))
    chosen = min((n for n in score if parameters[n] == fewest), key=lambda number: score[number])
    told = [f"{_errors(sizes[chosen], dof)} {dof.units.shown}"]
    told += [f"model {number} {_errors(size, dof)}" for number, size in sorted(sizes.items()) if number != chosen]
    how = "best" if chosen == best else "as well as any with more parameters"
    over = " and ".join(f"{horizon:g}" for horizon in COMPARED)
    return Preference(
        chosen, f"Model {chosen} predicts runs left out of the fit {how} {over} s ahead, to {', '.join(told)}."
    )


def _errors(sizes: Floats, dof: Dof) -> str:
    return " and ".join(f"{dof.shown(size):.3g}" for size in sizes)


def large_disturbance(course: Course, fit: OutputErrorFit) -> str:
    """A sentence where what pushes the vehicle is as large as the commands; else empty."""
    found, dof = fit.mixed, fit.model.dof
    assert isinstance(found, InnovationsFit)
    size = fit.model.inertia * found.value(f"{dof.name}.disturbance")
    commands = float(np.sqrt(np.sum(course.held[0] ** 2 * course.width) / np.sum(course.width)))
    if size < LARGE * commands:
        return ""
    unit, force = fit.model.moment_unit, dof.words.force
    return (
        f"The disturbance is as large as the commands: a {force} of {size:.3g} {unit} where {commands:.3g} {unit} are "
        f"commanded (root mean squares). Add runs with larger commands; {dof.words.inertia} and drag may be wrong by "
        "more than their intervals."
    )


def judged_whole(course: Course, fit: OutputErrorFit) -> Judgement:
    """Judge a fit of runs that were simulated whole, by the same predictions."""
    return Judgement(worth_of(whole_predictions(course, fit)), len(course.names))


def use_of(
    course: Course, fit: OutputErrorFit, predictions: tuple[Predicted, ...], proposed: Mapping[str, float]
) -> Use:
    """Judge a fit of driven runs on each run by the others; `proposed` is what it lacks."""
    found = fit.mixed
    assert isinstance(found, InnovationsFit)
    problem = driven_problem(fit.model, course)
    followed = problem.follow(found.phi[None], keep=True)
    assert followed.states is not None
    return Use(
        worth_of(predictions),
        len(course.names),
        proposed,
        course,
        predictions,
        free_run(fit.model, course, found.of_model, problem.noises(found.theta[None])),
        fit.model.inertia * followed.states[followed.places.pushed[0], 0],
        large_disturbance(course, fit),
    )
