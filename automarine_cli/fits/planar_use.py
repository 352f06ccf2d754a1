"""Of what use a planar model is: predictions of runs left out of its fit, beside constants and yaw alone."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automarine_cli.dofs import YAW
from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.prediction import HORIZONS, Predicted, free_run, predict
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.driven_fit import Worth, fit_driven, left_out_predictions, worth_of
from automarine_cli.fits.driven_use import JUDGED
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.innovations_problem import DrivenProblem
from automarine_cli.fits.output_error import OutputErrorFit, prefer
from automarine_cli.fits.planar_structure import PLACES
from automarine_cli.fits.whole_runs import rough_model
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch

STEP = 0.25
"""Step [s] of the balance from which the yaw model starts."""


@dataclass(frozen=True)
class PlanarUse:
    """What a planar model is worth by horizon: for the `heading` [rad], for the `place` on the water [m], distances,
    none where no positions are logged, and for the heading by the best model of yaw alone (`yaw_only`, none where the
    runs do not carry one). For people to look at: the `predictions` of the heading on the nodes of the `course`, and
    each channel of the `free` runs from the first filtered state on, (R, K + 1), not a number before that."""

    heading: tuple[Worth, ...]
    place: tuple[Worth, ...]
    yaw_only: tuple[Worth, ...]
    runs: int
    course: Course = field(repr=False)
    predictions: tuple[Predicted, ...] = field(repr=False)
    free: dict[str, Floats] = field(repr=False)

    @property
    def of_use(self) -> bool:
        """Whether the model predicts the heading better than constants do; what cannot be judged counts as of use."""
        judged = _judged(self.heading)
        return judged is None or judged.of_use

    @property
    def sentences(self) -> tuple[str, ...]:
        """Of what use the model is, and what the coupling is worth."""
        one = _judged(self.heading)
        if one is None:
            return ("The runs are too short to judge predictions.",)
        error, rate, still = (f"{YAW.shown(x):.3g}" for x in (one.error, one.constant_rate, one.constant))
        whose = "runs left out of the fit" if self.runs > 1 else "the run of the fit"
        beside = (
            f"the heading {one.horizon:g} s ahead to {error} deg where a constant rate misses by {rate} and a "
            f"constant heading by {still} ({whose})"
        )
        first = (
            f"The model predicts {beside}."
            if one.of_use
            else f"This model is not usable: it predicts {beside}. Do not simulate or control with it."
        )
        alone = _judged(self.yaw_only)
        if alone is None:
            return (first, "A model of yaw alone could not be fitted to these runs: no comparison.")
        return (first, f"A model of yaw alone predicts it to {YAW.shown(alone.error):.3g} deg.")

    def to_json(self) -> dict[str, object]:
        """For the result file: one entry a horizon, errors as root mean squares."""
        alone = {one.horizon: one.error for one in self.yaw_only}
        place = {one.horizon: one for one in self.place}
        return {
            "left_out_runs": [
                {
                    **one.to_json(YAW),
                    "yaw_only_rmse_deg": float(YAW.shown(alone[one.horizon])) if one.horizon in alone else None,
                    **(_place_json(place[one.horizon]) if one.horizon in place else {}),
                }
                for one in self.heading
            ],
            "of_use": self.of_use,
            "says": list(self.sentences),
        }


def _judged(worth: Sequence[Worth]) -> Worth | None:
    """Over the horizon that decides, or the longest below it."""
    return max((one for one in worth if one.horizon <= JUDGED), key=lambda one: one.horizon, default=None)


def _place_json(one: Worth) -> dict[str, float]:
    return {"place_rmse_m": one.error, "constant_rate_place_m": one.constant_rate, "constant_place_m": one.constant}


def planar_use(runs: Sequence[Run], problem: DrivenProblem, found: InnovationsFit) -> PlanarUse:
    """Judge a fit on each run by the others."""
    course = problem.course
    at = {one.quantity: c for c, one in enumerate(course.channels)}
    heading = _left_out(problem, found, at[YAW.position])
    placed = [_left_out(problem, found, at[name]) for name in PLACES if name in at]
    model, noises = problem.model, problem.noises(found.theta[None])
    shown = [name for name in (YAW.position, *PLACES) if name in at]
    return PlanarUse(
        worth_of(heading),
        _distances([worth_of(one) for one in placed]) if len(placed) == len(PLACES) else (),
        _yaw_only(runs, tuple(name for name in (YAW.position, YAW.velocity) if name in at)),
        len(runs),
        course,
        heading,
        {name: free_run(model, course, found.of_model, noises, at[name]) for name in shown},
    )


def _left_out(problem: DrivenProblem, found: InnovationsFit, channel: int) -> tuple[Predicted, ...]:
    """Predictions of a channel of each run by the parameters that the other runs give, over each horizon."""
    each: list[tuple[Predicted, ...]] = []
    for r in range(len(problem.course.names)):
        theta = problem.natural(found.left_out[r])
        pieces = predict(
            problem.model, problem.course.only(r), theta[: found.parameters], problem.noises(theta[None]),
            channel=channel,
        )  # fmt: skip
        each.append(tuple(replace(piece, run=piece.run + r) for piece in pieces))
    names = ("run", "origin", "target", "error", "constant_rate", "constant")
    return tuple(
        Predicted(HORIZONS[i], *(np.concatenate([getattr(one[i], name) for one in each]) for name in names))
        for i in range(len(HORIZONS))
    )


def _distances(each: Sequence[tuple[Worth, ...]]) -> tuple[Worth, ...]:
    """Root mean squares of distances on the water, from those along its axes."""
    return tuple(
        Worth(
            north.horizon,
            float(np.hypot(north.error, east.error)),
            float(np.hypot(north.constant_rate, east.constant_rate)),
            float(np.hypot(north.constant, east.constant)),
            min(north.count, east.count),
        )
        for north, east in zip(*each)
    )


def _yaw_only(runs: Sequence[Run], channels: tuple[str, ...]) -> tuple[Worth, ...]:
    """What the best model of yaw alone is worth on the same runs."""
    course = make_course(runs, np.zeros(len(runs), dtype=bool), channels=channels)
    batch = make_batch(runs, STEP)
    fits: dict[str, OutputErrorFit] = {}
    for number in ("1", "2", "3"):
        try:
            fits[number] = fit_driven(course, rough_model(number, batch), number)
        except FitError:
            continue
    if not fits:
        return ()
    best = fits[prefer(fits).number]
    assert isinstance(best.mixed, InnovationsFit)
    return worth_of(left_out_predictions(driven_problem(best.model, course), best.mixed))
