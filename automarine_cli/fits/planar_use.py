"""Of what use a planar model is: predictions of runs left out of its fit, beside constants and yaw alone."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automarine_cli.dofs import SURGE, SWAY, YAW
from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.kalman import Followed
from automarine_cli.filters.prediction import HORIZONS, Predicted, free_run, predict
from automarine_cli.fits.driven import driven_problem
from automarine_cli.fits.driven_fit import Worth, fit_driven, left_out_predictions, worth_of
from automarine_cli.fits.driven_use import judged_of
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
HEADING, PLACE = "heading", "place"
UNITS = {HEADING: YAW.units.shown, PLACE: "m", SURGE.velocity: "m/s", SWAY.velocity: "m/s"}
"""What is predicted, in the units of people."""
KEYS = {PLACE: ("place", "m"), SURGE.velocity: ("surge", "m_s"), SWAY.velocity: ("sway", "m_s")}


@dataclass(frozen=True)
class Forecasts:
    """What a fit predicts of runs left out of it: of the `heading`, and what that is worth by quantity and horizon
    (`worth`: heading [rad], the place on the water [m], or the speeds [m/s] where no positions are logged)."""

    heading: tuple[Predicted, ...] = field(repr=False)
    worth: Mapping[str, tuple[Worth, ...]]

    @property
    def score(self) -> float:
        """Mean logarithm of the errors as shares of what the better constant misses by, over quantities and horizons;
        infinite where predictions run away, zero where there are none."""
        shares = [one.error / min(one.constant_rate, one.constant) for each in self.worth.values() for one in each]
        score = float(np.mean(np.log(np.maximum(shares, 1e-9)))) if shares else 0.0
        return score if np.isfinite(score) else np.inf

    @property
    def beaten(self) -> Iterator[tuple[str, Worth]]:
        """Quantities that a constant predicts better over the horizon that decides."""
        judged = ((name, judged_of(each)) for name, each in self.worth.items())
        return ((name, one) for name, one in judged if one is not None and not one.of_use)


@dataclass(frozen=True)
class PlanarUse:
    """What a planar model is worth: its `forecasts`, and the heading by the best model of yaw alone (`yaw_only`, none
    where the runs do not carry one). For people to look at: `predictions` of the heading on the nodes of the `course`,
    and each channel of the `free` runs from the first filtered state on, (R, K + 1), not a number before that."""

    forecasts: Forecasts
    yaw_only: tuple[Worth, ...]
    runs: int
    course: Course = field(repr=False)
    free: dict[str, Floats] = field(repr=False)

    @property
    def predictions(self) -> tuple[Predicted, ...]:
        """Of the heading."""
        return self.forecasts.heading

    @property
    def of_use(self) -> bool:
        """Whether no constant predicts better; what cannot be judged counts as of use."""
        return next(self.forecasts.beaten, None) is None

    @property
    def sentences(self) -> tuple[str, ...]:
        """Of what use the model is, and what the coupling is worth."""
        heading = judged_of(self.forecasts.worth[HEADING])
        if heading is None:
            return ("The runs are too short to judge predictions.",)
        whose = "runs left out of the fit" if self.runs > 1 else "the run of the fit"
        beaten = [_beside(name, one) for name, one in self.forecasts.beaten]
        first = (
            f"This model is not usable: it predicts {'; and '.join(beaten)} ({whose}). Do not simulate or control "
            "with it."
            if beaten
            else f"The model predicts {_beside(HEADING, heading)} ({whose})."
        )
        alone = judged_of(self.yaw_only)
        if alone is None:
            return (first, "A model of yaw alone could not be fitted to these runs: no comparison.")
        return (first, f"A model of yaw alone predicts the heading to {YAW.shown(alone.error):.3g} deg.")

    def to_json(self) -> dict[str, object]:
        """For the result file: one entry a horizon, errors as root mean squares."""
        alone = {one.horizon: one.error for one in self.yaw_only}
        others = [
            (*KEYS[name], one) for name, each in self.forecasts.worth.items() if name != HEADING for one in each
        ]  # fmt: skip
        return {
            "left_out_runs": [
                {
                    **one.to_json(YAW),
                    "yaw_only_rmse_deg": float(YAW.shown(alone[one.horizon])) if one.horizon in alone else None,
                    **{
                        key: value
                        for name, unit, other in others
                        if other.horizon == one.horizon
                        for key, value in _json(name, unit, other)
                    },
                }
                for one in self.forecasts.worth[HEADING]
            ],
            "of_use": self.of_use,
            "says": list(self.sentences),
        }


def shown(name: str, value: float) -> float:
    """A quantity in its unit of UNITS."""
    return float(YAW.shown(value)) if name == HEADING else value


def _beside(name: str, one: Worth) -> str:
    """How far ahead, to what, and by how much the constants miss."""
    error, rate, still = (f"{shown(name, x):.3g}" for x in (one.error, one.constant_rate, one.constant))
    what = "place" if name == PLACE else name if name == HEADING else f"{name} speed"
    changing = "acceleration" if name in (SURGE.velocity, SWAY.velocity) else "rate"
    return (
        f"the {what} {one.horizon:g} s ahead to {error} {UNITS[name]} where a constant {changing} misses by {rate} and "
        f"a constant {what.removeprefix('surge ').removeprefix('sway ')} by {still}"
    )


def _json(name: str, unit: str, one: Worth) -> Iterator[tuple[str, float]]:
    yield f"{name}_rmse_{unit}", one.error
    yield f"constant_rate_{name}_{unit}", one.constant_rate
    yield f"constant_{name}_{unit}", one.constant


def forecasts_of(problem: DrivenProblem, found: InnovationsFit, alone: bool = False) -> Forecasts:
    """Predictions of each run by the parameters that the other runs give, of all that is judged; by the model `alone`,
    where neither the disturbance nor the run's gain that the filter takes for true is carried on."""
    course = problem.course
    at = {one.quantity: c for c, one in enumerate(course.channels)}
    placed = set(PLACES) <= at.keys()
    names = [YAW.position, *(PLACES if placed else [n for n in (SURGE.velocity, SWAY.velocity) if n in at])]
    each: list[list[tuple[Predicted, ...]]] = []
    for r in range(len(course.names)):
        theta = problem.natural(found.left_out[r])
        own, noises = course.only(r), problem.noises(theta[None])
        followed = problem.follow(found.left_out[r][None], True, own)
        if alone:
            followed = of_model_alone(followed)
        of_run = (
            predict(problem.model, own, theta[: found.parameters], noises, channel=at[name], followed=followed)
            for name in names
        )
        each.append([tuple(replace(piece, run=piece.run + r) for piece in pieces) for pieces in of_run])
    heading, *others = (_joined([of_run[i] for of_run in each]) for i in range(len(names)))
    with np.errstate(over="ignore", invalid="ignore"):  # where predictions run away
        worth = {name: worth_of(one) for name, one in zip(names[1:], others)}
        if placed:
            worth = {PLACE: _distances(list(worth.values()))}
        return Forecasts(heading, {HEADING: worth_of(heading), **worth})


def of_model_alone(followed: Followed) -> Followed:
    """States without disturbances and with gains of one, as fits to forecasts take them."""
    assert followed.states is not None
    states = followed.states.copy()
    states[[*followed.places.pushed, followed.places.gain]] = 0.0
    return replace(followed, states=states)


def planar_use(runs: Sequence[Run], problem: DrivenProblem, found: InnovationsFit, forecasts: Forecasts) -> PlanarUse:
    """Judge a fit, of which the `forecasts` are."""
    course = problem.course
    at = {one.quantity: c for c, one in enumerate(course.channels)}
    model, noises = problem.model, problem.noises(found.theta[None])
    drawn = [name for name in (YAW.position, *PLACES) if name in at]
    return PlanarUse(
        forecasts,
        _yaw_only(runs, tuple(name for name in (YAW.position, YAW.velocity) if name in at)),
        len(runs),
        course,
        {name: free_run(model, course, found.of_model, noises, at[name]) for name in drawn},
    )


def _joined(each: Sequence[tuple[Predicted, ...]]) -> tuple[Predicted, ...]:
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
