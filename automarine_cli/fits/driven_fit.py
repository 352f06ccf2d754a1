"""Models 1 to 3 fitted to driven and disturbed runs, and what they are worth on runs that were left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course
from automarine_cli.filters.prediction import HORIZONS, Predicted, predict
from automarine_cli.fits.driven import base_starts, driven_problem, starts_near
from automarine_cli.fits.forecast_error import fit_forecasts, with_chance
from automarine_cli.fits.innovations import InnovationsFit, fit_innovations
from automarine_cli.fits.innovations_problem import DrivenProblem
from automarine_cli.fits.known import Prior
from automarine_cli.fits.outcome import natural_of, search_of
from automarine_cli.fits.output_error import OutputErrorFit, estimate_of, run_covariance, run_dof
from automarine_cli.fits.ways import ways_of
from automarine_cli.models.yaw_model import YawModel, base_names, base_roles, main_drag
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

SLOWEST, QUICKEST = 600.0, 1e-3
"""Seconds in which no vehicle answers its thrusters, or has answered them: inertia over the drag at the largest
command."""
HEAD_START = 10.0
"""Deviance, beyond the penalty of its parameters, that an effect has to gain before it is proposed."""
BRIEF = 10
"""Iterations of a fit of gains and noise alone."""
COMPARED, CLEARLY, LEVEL = (2.0, 5.0), 0.02, 0.1
"""Seconds ahead over which estimators are compared, and the shares by which the second one has to be better, or may be
worse."""
PROPOSED = ("input-delay", "dead-band")
"""Effects with which models of driven logs may begin, if the evidence asks."""
WIDENED = ("estimates", "inertial_turn_angle", "covariance")  # what of a fit shows its intervals


@dataclass(frozen=True)
class Worth:
    """What a model is worth over one horizon [s]: root mean square errors of positions of runs that were left out of
    its fit [rad or m], beside those of a constant rate and of a constant position, and over how many predictions."""

    horizon: float
    error: float
    constant_rate: float
    constant: float
    count: int

    @property
    def of_use(self) -> bool:
        """Whether the model predicts better than both constants do."""
        return self.error < min(self.constant_rate, self.constant)

    def beside(self, dof: Dof) -> str:
        """How far ahead, to what, and by how much the constants miss: the end of a sentence."""
        error, rate, still = (f"{dof.shown(x):.3g}" for x in (self.error, self.constant_rate, self.constant))
        return (
            f"{self.horizon:g} s ahead to {error} {dof.units.shown} where a constant {dof.words.speed} misses by "
            f"{rate} and a constant {dof.words.position} by {still}"
        )

    def to_json(self, dof: Dof) -> dict[str, object]:
        """For a result file, in the unit in which people see positions."""
        key = dof.units.key
        return {
            "horizon_s": self.horizon,
            f"rmse_{key}": float(dof.shown(self.error)),
            f"constant_rate_{key}": float(dof.shown(self.constant_rate)),
            f"constant_{dof.words.position}_{key}": float(dof.shown(self.constant)),
            "predictions": self.count,
        }


def fit_driven(
    course: Course,
    rough: YawModel,
    number: str,
    sided: bool = False,
    with_effects: Sequence[str] = (),
    known: Mapping[str, Prior] | None = None,
) -> OutputErrorFit:
    """Fit one model to driven runs, from `rough` values; `with_effects` names what it has beside its drag, `known` what
    is known beforehand.

    Raises FitError where the runs leave inertia or drag open, or give them sizes that no vehicle has.
    """
    model = rough
    largest = float(np.abs(course.held).max()) or 1.0
    for name in with_effects:
        model = model.with_effect(name, _start(name, largest))
    problem = driven_problem(model, course).informed(known or {})
    found = fit_innovations(problem, base_starts(problem))
    _refuse_runaways(model.with_theta(found.of_model), found, course)
    return _outcome(problem, found, number, sided)


def beside_forecasts(course: Course, likely: OutputErrorFit) -> OutputErrorFit:
    """The better one of two estimates of the same model: the `likely` one by innovations, or that of least squares of
    forecasts.

    Judged are predictions of runs left out. Commands that answer a disturbance tell of it, which flatters least squares
    over long horizons and biases them, innovations not. So least squares have to be better by CLEARLY over each of
    COMPARED, or at least as good but for LEVEL with an inertia that survives leaving runs out better; the square of the
    difference of both is then added to the covariance.
    """
    found, dof = likely.mixed, likely.model.dof
    assert isinstance(found, InnovationsFit)
    problem = driven_problem(likely.model, course).informed(found.known)
    starts = np.concatenate([found.theta[None], base_starts(problem)])
    try:
        plain = with_chance(problem, fit_forecasts(problem, found.phi, starts))
        _refuse_runaways(likely.model.with_theta(plain.of_model), plain, course)
    except FitError:
        return likely
    errors = {
        name: [one.rmse() for one in left_out_predictions(problem, fit) if one.horizon in COMPARED and len(one.error)]
        for name, fit in (("least squares of forecasts", plain), ("innovations", found))
    }
    squares, likelihood = errors.values()
    if not squares or not all(np.isfinite(squares)):
        return likely
    better = all(a < (1.0 - CLEARLY) * b for a, b in zip(squares, likelihood))
    level = all(a < (1.0 + LEVEL) * b for a, b in zip(squares, likelihood))
    surer = bool(run_covariance(plain)[0, 0] < run_covariance(found)[0, 0])
    better = better or (level and surer)
    names = list(errors) if better else list(errors)[::-1]
    fits = (plain, found) if better else (found, plain)
    shown = [" and ".join(f"{dof.shown(one):.3g}" for one in errors[name]) for name in names]
    sizes = [f"{fit.theta[0]:.3g}" for fit in fits]
    ahead = " and ".join(f"{h:g}" for h in COMPARED[: len(squares)])
    says = (
        f"by {names[0]}: runs left out are predicted {ahead} s ahead to {shown[0]} {dof.units.shown}, by {names[1]} to "
        f"{shown[1]} ({dof.parameters['inertia']} is {sizes[0]} by the first and {sizes[1]} by the second)"
    )
    if not better:
        return replace(likely, estimator=says)
    covariance, own = run_covariance(plain).copy(), plain.parameters
    quantiles = [special.stdtrit(run_dof(plain, axis), 0.975) for axis in np.eye(len(plain.phi))[:own]]
    bias = (plain.phi[:own] - found.phi[:own]) * special.ndtri(0.975) / quantiles
    covariance[:own, :own] += np.outer(bias, bias)  # one of the two is biased, by so much on any number of runs
    best = _outcome(problem, plain, likely.number, _is_sided(likely), covariance)
    ways = None if likely.ways is None else ways_of(best, dof) if _is_sided(likely) else likely.ways
    return replace(best, estimator=says, by_forecasts=True, ways=ways)


def _is_sided(fit: OutputErrorFit) -> bool:
    """Whether the model has a drag of each way."""
    return fit.model.dof.symbols.difference in fit.estimates


def _start(name: str, largest: float) -> list[float]:
    """Where a fit of an effect starts, for logs whose largest command is `largest`."""
    own = effects.get(name).parameters
    return [p.off if p.held else p.scaled(p.start, largest) for p in own]


def _refuse_runaways(model: YawModel, found: InnovationsFit, course: Course) -> None:
    """A fit that ran away is no model. Raises FitError with what the runs lack."""
    dof, largest = course.motion.dofs[0], float(np.abs(course.held).max())
    linear, quadratic = model.drag()
    slowness = model.fastest(largest)
    deviation = float(np.sqrt(max(run_covariance(found)[0, 0], 0.0)))
    if linear <= 0 and quadratic <= 0:
        what = f"no drag is left of it ({', '.join(model.short_names[1:])} at zero)"
    elif not QUICKEST < slowness < SLOWEST:
        what = f"it would answer its thrusters within {slowness:.2g} s"
    elif found.names[0] not in found.known and (0 in found.at_bound or deviation <= 0.0 or deviation > np.log(3.0)):
        what = f"{dof.words.an_inertia} of {model.inertia:.3g} is as likely as one of three times that"
    else:
        return
    raise FitError(
        dof.fill(
            f"these runs do not determine the model: {what}. They hold too little {{moving}} that the {{force}} "
            "made; add "
            "runs with larger and quicker commands to both sides, best without a controller in the loop, and check "
            "that the logged commands are those of this vehicle"
        )
    )


def _outcome(
    problem: DrivenProblem, found: InnovationsFit, number: str, sided: bool, covariance: Floats | None = None
) -> OutputErrorFit:
    base = problem.model
    assert isinstance(base, YawModel)
    dof, unit = base.dof, base.moment_unit
    covariance = run_covariance(found) if covariance is None else covariance
    runs = len(found.left_out)
    alone = float(sum(found.read.values()) - len(found.theta)) if runs == 1 else None
    roles, names = base_roles(number, dof, sided), base_names(number, dof, sided)
    at = {role: found.names.index(dof.parameter(role)) for role in roles}
    like = {"difference": main_drag(number)}
    estimates = {
        name: estimate_of(found, covariance, at[role], dof.unit_of(like.get(role, role), unit), alone)
        for role, name in zip(roles, names)
    }
    turn = None
    quadratic = dof.parameter("quadratic")
    stuck = at.get("quadratic") in found.at_bound and quadratic not in found.known
    if "quadratic" in roles and found.theta[at["quadratic"]] > 0 and not stuck:
        turn = _ratio(found, covariance, at["inertia"], at["quadratic"], alone, dof)
    low, high = found.factor_interval("gain")
    bound = found.names.index("gain-scatter") in found.at_bound
    none = Estimate(0.0, 0.0, (0.0, 0.0), "sample interval")
    scatter = Estimate(found.factor("gain"), (high - low) / 3.92, (low, high), "1", at_bound=bound)
    return OutputErrorFit(
        number,
        base.with_theta(found.of_model),
        estimates,
        turn,
        none,
        scatter,
        found.noise_of.get(dof.position),
        found,
        covariance,
        np.array([*base.theta, *[0.0] * len(problem.random)]),
    )


def _ratio(found: InnovationsFit, covariance: Floats, i: int, k: int, alone: float | None, dof: Dof) -> Estimate:
    """Inertia over quadratic drag; the inertia is searched on its logarithm, the drag is not."""
    direction = np.eye(len(found.theta))[i] - np.eye(len(found.theta))[k] / found.theta[k]
    stderr = float(np.sqrt(max(direction @ covariance @ direction, 0.0)))
    freedom = alone or run_dof(found, direction)
    return Estimate.from_log(found.theta[i] / found.theta[k], stderr, freedom, dof.unit_of("ratio"))


def left_out_predictions(problem: DrivenProblem, found: InnovationsFit) -> tuple[Predicted, ...]:
    """Predictions of each run by the parameters that the other runs give, of the first channel, over each horizon."""
    each: list[tuple[Predicted, ...]] = []
    for r in range(len(problem.course.names)):
        theta = problem.natural(found.left_out[r])
        own = problem.course.only(r)
        pieces = predict(problem.model, own, theta[: found.parameters], problem.noises(theta[None]))
        each.append(tuple(replace(piece, run=piece.run + r) for piece in pieces))
    return tuple(_joined([pieces[i] for pieces in each]) for i in range(len(HORIZONS)))


def whole_predictions(course: Course, fit: OutputErrorFit) -> tuple[Predicted, ...]:
    """The same by a fit of runs that were simulated whole, beside which only gains and noise are random; none where no
    filter follows the runs."""
    problem, own = driven_problem(fit.model, course, quiet=True), len(fit.model.theta)
    bounds, mixed = problem.bounds.copy(), fit.mixed
    bounds[:own] = fit.model.theta[:, None]
    start = np.append(fit.model.theta, [one.median for one in problem.random])
    try:
        found = fit_innovations(replace(problem, bounds=bounds), start[None], BRIEF, brief=True)
    except FitError:
        return ()
    left_out = np.tile(found.phi, (len(course.names), 1))
    without = natural_of(mixed.left_out[:, :own], mixed.positive[:own])
    left_out[:, :own] = search_of(np.clip(without, *problem.bounds[:own].T), problem.positive[:own])
    return left_out_predictions(problem, replace(found, left_out=left_out))


def worth_of(predictions: Sequence[Predicted]) -> tuple[Worth, ...]:
    """What predictions are worth, by horizon; those of which there are none are left out."""
    return tuple(
        Worth(one.horizon, one.rmse(), one.rmse(one.constant_rate), one.rmse(one.constant), len(one.error))
        for one in predictions
        if len(one.error)
    )


def widened(course: Course, fit: OutputErrorFit) -> tuple[OutputErrorFit, dict[str, float]]:
    """The fit with intervals that allow for what it lacks, and the deviance gained by each of PROPOSED that the
    evidence asks for.

    The square of the shift by which the best of them moves the parameters is added to their covariance.
    """
    narrow = fit.mixed
    if not isinstance(narrow, InnovationsFit):
        return fit, {}
    problem = driven_problem(fit.model, course).informed(narrow.known)
    likelihood, own = narrow.log_likelihood, len(fit.model.theta)
    if fit.by_forecasts:
        likelihood = fit_innovations(problem, narrow.theta[None], brief=True).log_likelihood
    have, gains, shifts = {term.name for term in fit.model.terms}, {}, {}
    largest = float(np.abs(course.held).max()) or 1.0
    for name in PROPOSED:
        if name in have:
            continue
        start = _start(name, largest)
        wider = driven_problem(fit.model.with_effect(name, start), course).informed(narrow.known)
        theta = np.array([*narrow.of_model, *start])
        wide = fit_innovations(wider, starts_near(wider, [theta], narrow.of_chance), brief=True)
        gain = 2.0 * (wide.log_likelihood - likelihood)
        if gain > HEAD_START + np.log(max(len(course.names), 2)):
            phi = fit_forecasts(wider, wide.phi, wide.theta[None]).phi if fit.by_forecasts else wide.phi
            gains[name], shifts[name] = gain, phi[:own] - narrow.phi[:own]
    if not gains:
        return fit, {}
    covariance = fit.covariance.copy()
    shift = shifts[max(gains, key=lambda name: gains[name])]
    covariance[:own, :own] += np.outer(shift, shift)
    wider_fit = _outcome(problem, narrow, fit.number, _is_sided(fit), covariance)
    return replace(fit, **{name: getattr(wider_fit, name) for name in WIDENED}), gains


def _joined(pieces: Sequence[Predicted]) -> Predicted:
    return Predicted(
        pieces[0].horizon,
        np.concatenate([piece.run for piece in pieces]),
        np.concatenate([piece.origin for piece in pieces]),
        np.concatenate([piece.target for piece in pieces]),
        np.concatenate([piece.error for piece in pieces]),
        np.concatenate([piece.constant_rate for piece in pieces]),
        np.concatenate([piece.constant for piece in pieces]),
    )
