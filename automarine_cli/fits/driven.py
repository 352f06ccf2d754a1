"""A model of one motion on driven runs: how its parameters are searched, where fits start, of what use it is."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.effects.base import ODD
from automarine_cli.errors import FitError, SettingError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.filters.kalman import HORIZONS, Predicted, predict
from automarine_cli.fits.forecast_error import ForecastFit, fit_forecasts, with_chance
from automarine_cli.fits.innovations import NO_START, DrivenProblem, Fit, InnovationsFit, fits_of, randomness
from automarine_cli.fits.linear_mixed import DISTURBANCE, GAIN
from automarine_cli.fits.mixed_model import MixedFit, fit_mixed
from automarine_cli.fits.preference import COMPARISON_HORIZONS_S, STEERED_HORIZONS_S, forecast_losses, is_ahead
from automarine_cli.fits.whole_runs import (
    START_SCATTERS,
    OutputErrorFit,
    directional_drag,
    fit_by_direction,
    result_of,
    rough_model,
    run_covariance,
    run_dof,
    whole_run_problem,
)
from automarine_cli.models.model import COMMAND_DELAY, MAX_DELAY_S, Model, base_roles
from automarine_cli.models.parameter import Parameters, Priors
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs.half_turn import segments
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import Batch, make_batch

START_INERTIAS, START_DRAGS = (0.3, 1.0, 3.0), (0.3, 1.0, 3.0)  # shares of rough values, to start from
START_DISTURBANCES, START_THRUST_NOISES = (0.02, 0.2), (0.005, 0.1)
"""Disturbances, as shares of the acceleration of the largest command, and noises of thrust, to start from."""
START_DELAYS = (0.0, 0.2, 0.4)  # s, between which the likelihood of commands that change all the time has maxima


MIN_DISTURBANCE_GAIN = 10.0  # deviance beyond its penalty that a disturbance has to gain
MAX_RUNS_TRIED = 16  # runs that show whether there is one
MIN_HELD_S, MIN_HELD_SHARE = 1.0, 0.8  # for which a run holds its command; share of the run that this makes
MAX_STEP_SEGMENTS = 5  # stretches of one command of a run of steps: rest, a step, rest, one back, rest


def driven_problem(
    model: Model, course: Course, *, latest: float = MAX_DELAY_S, slowest: float = np.inf, quiet: bool = False
) -> DrivenProblem:
    """Likelihood of `model` on `course`, with a command delay up to `latest` [s], from which on effects have delays.

    What varies from run to run has periods of at most `slowest` [s]. `quiet`: see `randomness`."""
    largest = float(np.abs(course.commanded).max()) or 1.0
    least = latest if latest < MAX_DELAY_S else -np.inf
    searched = model.parameters(largest, least_delay=least, longest_period=slowest)
    varying = [term.name for term in model.terms if effects.get(term.name).varies(term.values)]
    pushes = [largest / max(model.inertia, 1e-9)]
    delayed = any(effects.get(term.name).delays for term in model.terms)
    random = randomness(course, pushes, varying, quiet, 0.0 if delayed else latest)
    return DrivenProblem(model, course, Parameters((*searched, *random)))


def parse_effects(names: Sequence[str], *dofs: Dof) -> tuple[str, ...]:
    """Return the effects that a fit of these motions is to have beside drag.

    Raises SettingError for what is none, or belongs to the drag.
    """
    every = [effects.get(name) for name in effects.names()] if names else []
    in_plane = len(dofs) > 1  # in the plane the rudder is a signal, of which no command is made
    every = [of for of in every if any(map(of.acts_in, dofs)) and not (in_plane and of.steered)]
    may = [of.name for of in every if not of.role or (in_plane and of.parity == ODD)]  # hulls are alike on both sides
    for name in names:
        if name not in may:
            raise SettingError(f"with is {name!r}; expected effects such as {', '.join(may)}, with commas between")
    return tuple(dict.fromkeys(names))


def base_starts(problem: DrivenProblem) -> Floats:
    """Starts of a base model about its own values, (S, p). One that answers within a step of the filter, whose
    arithmetic would run away, is slowed down first."""
    model = problem.model
    assert isinstance(model, Model)
    starts, middle = [], [chance.value for chance in problem.parameters.nuisance]
    linear, quadratic = model.drag()
    slope = linear + 2.0 * quadratic * float(problem.course.fastest[0])
    swings = np.array([entry.role == "restoring" for entry in problem.parameters[1 : len(model.theta)]])
    middling = max(model.inertia, float(problem.course.length.max()) * slope)
    push = float(np.abs(problem.course.commanded).max()) / max(middling, 1e-9)
    place = next(i for i, chance in enumerate(problem.parameters.nuisance) if chance.name == COMMAND_DELAY)
    latest = 0.0 if problem.course.moment_unit == STEERED else max(problem.parameters.nuisance[place].upper, 0.0)
    delays = [delay for delay in START_DELAYS if delay <= latest]
    sizes = START_INERTIAS, START_DRAGS, START_DISTURBANCES, START_THRUST_NOISES, delays
    for inertia, drag, size, unsteady, delay in product(*sizes):
        random = [size * push / inertia, middle[1], unsteady, *middle[3:]]
        random[place] = delay
        shares = np.where(swings, inertia, drag)  # a period is known better than inertia
        starts.append([inertia * middling, *(shares * model.theta[1:]), *random])
    return problem.parameters.within(starts)


def starts_near(problem: DrivenProblem, thetas: Sequence[Floats], random: Mapping[str, float]) -> Floats:
    """Starts (S, p) from values of the model's parameters and what is known of the random ones."""
    chances = [random.get(chance.name, chance.value) for chance in problem.parameters.nuisance]
    return problem.parameters.within([[*theta, *chances] for theta in thetas])


def holds_commands(run: Run) -> bool:
    """Whether a run holds its command for MIN_HELD_S seconds at a time, nearly all of the time."""
    durations = [run.time[stop - 1] - run.time[first] for first, stop, _ in segments(run.command)]
    return sum(length for length in durations if length >= MIN_HELD_S) > MIN_HELD_SHARE * (run.time[-1] - run.time[0])


def mostly_held(runs: Sequence[Run]) -> bool:
    """Whether half of the runs hold their commands."""
    return 2 * sum(holds_commands(run) for run in runs) >= len(runs)


def mostly_steps(runs: Sequence[Run]) -> bool:
    """Whether half of the runs hold few commands, a step or two. What differs between such runs in a pool is in their
    gains, and a disturbance would absorb just what a diagnosis looks for."""
    return 2 * sum(holds_commands(run) and len(segments(run.command)) <= MAX_STEP_SEGMENTS for run in runs) >= len(runs)


def by_model_alone(runs: Sequence[Run]) -> bool:
    """Whether the model alone forecasts: held commands answer nothing within a forecast, and a disturbance that a
    filter carries on is then mostly what the model lacks. A rudder's commands answer the heading."""
    return runs[0].moment_unit != STEERED and mostly_held(runs)


def shows_disturbance(
    runs: Sequence[Run], base: Model, at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> bool:
    """Whether the evidence asks for a disturbance that is a process, or for unsteady thrust: the deviance of a model
    with both drags, with these and without, is compared."""
    some = np.unique(np.linspace(0, len(runs) - 1, min(len(runs), MAX_RUNS_TRIED)).astype(int))
    course = make_course([runs[i] for i in some], at_rest[some], channels=channels)
    drags = dict(zip(("linear", "quadratic"), base.drag()))
    values = [drags.get(role, 0.0) for role in base_roles("2", base.dof)[1:]]
    model = Model.base("2", base.inertia, values, base.moment_unit, base.dof)
    problems = [driven_problem(model, course, quiet=quiet) for quiet in (False, True)]
    free, quiet = fits_of(problems, [base_starts(problems[0])] * 2, brief=True)
    if free is None or quiet is None:
        raise FitError(NO_START)
    gain = 2.0 * (free.log_likelihood - quiet.log_likelihood)
    return bool(gain > 3.0 * np.log(max(len(some), 2)) + MIN_DISTURBANCE_GAIN)


MAX_ANSWER_S, MIN_ANSWER_S = 600.0, 1e-3
"""Seconds in which no vehicle answers its thrusters, or has answered them: inertia over the drag at the largest
command."""
MIN_PROPOSED_GAIN = 10.0  # deviance beyond its penalty that an effect has to gain to be proposed
BRIEF_ITERATIONS = 10  # of fits of gains and noise alone, or of lags, which are close to their end by then or nowhere
MIN_GAIN_SHARE, MAX_LOSS = 0.02, 0.10  # by which forecasts of the second estimator have to be better, or may be worse
PROPOSED = ("dead-band",)  # effects with which models of driven logs may begin, if the evidence asks
STEERING_GEAR = "rudder-rate"
PROPOSED_OF_RUDDER = (STEERING_GEAR, "rudder-offset")
THRUSTER_LAG, MIN_LATE_STDERRS = "thruster-lag", 4.0  # looked for where commands are late beyond half a sample
BRIEF_STDERRS = 0.05  # within which its fits end


@dataclass(frozen=True)
class ForecastScore:
    """What a model is worth over one horizon [s]: root mean square errors of positions of runs that were left out of
    its fit [rad or m], beside those of a constant rate and of a constant position, and over how many predictions."""

    horizon: float
    error: float
    constant_rate: float
    constant: float
    count: int

    @property
    def of_use(self) -> bool:
        return self.error < min(self.constant_rate, self.constant)

    def sentence(self, begin: str, on: str, dof: Dof, rate: str = "", place: str = "", unit: str = "") -> str:
        """Say how far ahead it predicts, `on` which runs, and by how much the constants miss. Of positions of a motion,
        or of what has this `unit` and is called so."""
        sizes = (self.error, self.constant_rate, self.constant)
        error, moving, standing = (f"{x if unit else dof.shown(x):.3g}" for x in sizes)
        how_far = f"to {error} {unit or dof.units.shown}" if np.isfinite(self.error) else "without any bound"
        return (
            f"{begin} {self.horizon:g} s ahead {how_far}{on}. A constant "
            f"{rate or dof.words.speed} misses by {moving}, a constant {place or dof.words.position} by {standing}."
        )

    def to_json(self, dof: Dof) -> dict[str, object]:
        key = dof.units.shown
        return {
            "horizon_s": self.horizon,
            f"rmse_{key}": float(dof.shown(self.error)),
            f"constant_rate_{key}": float(dof.shown(self.constant_rate)),
            f"constant_{dof.words.position}_{key}": float(dof.shown(self.constant)),
            "predictions": self.count,
        }


FitOrReason = tuple[OutputErrorFit | None, str]  # a fit, or why the runs do not carry it
FITTING, FORECASTING, COMPARING = "fitting models", "fitting forecasts", "comparing estimates"


def driven_fits(course: Course, numbers: Sequence[str], priors: Priors, roughs: Sequence[Model]) -> list[FitOrReason]:
    """Fit several models to driven runs side by side, each from its `rough` values. None where the runs leave inertia
    or drag open, or give them sizes that no vehicle has."""
    problems, attempts = [driven_problem(model, course).informed(priors) for model in roughs], list[FitOrReason]()
    starts = [np.concatenate(rows) for rows in zip(map(base_starts, problems), _gear_starts(problems, priors))]
    for number, rough, fit in zip(numbers, roughs, fits_of(problems, starts)):
        why = NO_START if fit is None else _runaway(rough.with_theta(fit.of_model), fit, course)
        attempts.append((None, why) if fit is None or why else (result_of(number, rough, fit), ""))
    return attempts


def _gear_starts(problems: Sequence[DrivenProblem], priors: Priors) -> list[Floats]:
    """Further starts (S, p) of models with a steering gear: the fit without it, with gears of several rates. A slow
    gear on a strong rudder is a summit of its own."""
    starts = [np.empty((0, len(problem.parameters))) for problem in problems]
    geared = [i for i, problem in enumerate(problems) if any(t.name == STEERING_GEAR for t in problem.model.terms)]
    models, rate = [problems[i].model for i in geared], effects.get(STEERING_GEAR).parameters[0]
    bare = [replace(m, terms=tuple(term for term in m.terms if term.name != STEERING_GEAR)) for m in models]
    plain = [driven_problem(model, problems[i].course).informed(priors) for i, model in zip(geared, bare)]
    for i, fit in zip(geared, fits_of(plain, [*map(base_starts, plain)], brief=True)):
        if fit is not None:
            names, values = problems[i].model.parameter_names, dict(zip(fit.names, fit.of_model.tolist()))
            theta = [values.get(name, start) for name, start in zip(names, problems[i].model.theta)]
            thetas = np.tile(theta, (len(rate.scan), 1))
            thetas[:, names.index(f"{STEERING_GEAR}.{rate.name}")] *= np.array(rate.scan) / rate.start
            starts[i] = starts_near(problems[i], list(thetas), fit.of_chance)
    return starts


INNOVATIONS, FORECASTS, MIDDLE = "innovations", "least squares of forecasts", "the middle of both"
SHARES = {FORECASTS: 1.0, MIDDLE: 0.5}  # of the way from innovations to least squares


def beside_forecasts(
    course: Course, likely: Sequence[OutputErrorFit], is_held: bool = False, map_jobs: Each = alone
) -> list[OutputErrorFit]:
    """The better one of two estimates of each model, the `likely` one by innovations and that of least squares of
    forecasts, or their middle.

    Judged are predictions of runs left out. Commands that answer a disturbance tell of it, which flatters least
    squares over long horizons and biases them, innovations not. So least squares have to be better by
    MIN_GAIN_SHARE over each of COMPARISON_HORIZONS_S, or at least as good but for MAX_LOSS with an inertia that
    survives leaving runs out better; and never count where innovations rule their inertia out. Innovations stay
    there and where their lead is no chance. Else, and where it predicts better than least squares, the middle is
    taken (of the logarithms of what is positive): of two estimates that err in different ways it is never far from
    the better one. The square of the way from innovations is added to the covariance, for one of the two is biased by
    so much on any number of runs. Commands that are held (`is_held`) answer nothing within a forecast: the estimate
    counts with which the model alone forecasts better. What is steered leaves forecasts for a clear lead over longer
    horizons.
    """
    estimates = [{INNOVATIONS: fit.mixed} for fit in likely]
    attempts = list[tuple[int, str, ForecastFit]]()
    for i, least in enumerate(map_jobs(partial(_least_misses, course), likely, FORECASTING)):
        if least is not None:
            innovations = estimates[i][INNOVATIONS]
            stderr = np.sqrt(run_covariance(innovations)[0, 0])
            reach = stderr * special.stdtrit(run_dof(innovations, np.eye(len(innovations.phi))[0]), 0.975)
            attempts.append((i, FORECASTS, least))
            if is_held or abs(least.phi[0] - innovations.phi[0]) <= reach:
                attempts.append((i, MIDDLE, least.towards(innovations)))
    problems = [_informed(course, likely[i]) for i, *_ in attempts]
    for (i, name, _), fit in zip(attempts, with_chance(problems, [least for *_, least in attempts])):
        if fit is not None:
            estimates[i][name] = fit
    return map_jobs(partial(_best_of, course, is_held), list(zip(likely, estimates)), COMPARING)


def _informed(course: Course, fit: OutputErrorFit) -> DrivenProblem:
    return driven_problem(fit.model, course).informed(fit.mixed.parameters.priors)


def _least_misses(course: Course, likely: OutputErrorFit) -> ForecastFit | None:
    """The least squares of forecasts of a model; None where no run is long enough, or no start leads anywhere."""
    problem = _informed(course, likely)
    starts = np.concatenate([likely.mixed.theta[None], base_starts(problem)])
    try:
        return fit_forecasts(problem, likely.mixed.phi, starts)
    except FitError:
        return None


def _best_of(
    course: Course, is_held: bool, estimates: tuple[OutputErrorFit, dict[str, InnovationsFit]]
) -> OutputErrorFit:
    """Choose one of the estimates of a model, see `beside_forecasts`; there is no middle where innovations rule out the
    inertia of forecasts."""
    likely, fits = estimates
    plain, innovations = fits.get(FORECASTS), fits[INNOVATIONS]
    if plain is None or _runaway(likely.model.with_theta(plain.of_model), plain, course):
        return likely
    problem, dof, count = _informed(course, likely), likely.model.dof, len(likely.model.theta)
    steered = course.moment_unit == STEERED
    over = STEERED_HORIZONS_S if steered else COMPARISON_HORIZONS_S
    ask = partial(left_out_predictions, problem, alone=is_held and not steered, horizons=over)
    ahead = {name: ask(fit)[0] for name, fit in fits.items()}
    sizes = {name: [p.rmse() for p in predicted if len(p.error)] for name, predicted in ahead.items()}
    if not sizes[FORECASTS] or not np.all(np.isfinite(sizes[FORECASTS])):
        return likely
    losses = forecast_losses(ahead, len(course.names), over)
    pairs = list(zip(sizes[FORECASTS], sizes[INNOVATIONS]))
    better = all(a < (1.0 - MIN_GAIN_SHARE) * b for a, b in pairs)
    level = all(a < (1.0 + MAX_LOSS) * b for a, b in pairs)
    better = better or (level and bool(run_covariance(plain)[0, 0] < run_covariance(innovations)[0, 0]))
    if is_held and losses is not None:
        better = bool(losses[FORECASTS].sum() < losses[INNOVATIONS].sum())
    if steered:  # forecasts reach over the answer of its hull
        chosen = INNOVATIONS if losses and is_ahead(losses[INNOVATIONS], losses[FORECASTS]) else FORECASTS
    elif MIDDLE not in fits or (losses is None and not better):
        chosen = INNOVATIONS
    elif losses is None or (better and losses[FORECASTS].sum() <= losses[MIDDLE].sum()):
        chosen = FORECASTS
    else:
        chosen = MIDDLE if better or not is_ahead(losses[INNOVATIONS], losses[FORECASTS]) else INNOVATIONS
    horizons = " and ".join(f"{h:g}" for h in over[: len(pairs)])
    errors = {name: " and ".join(f"{dof.shown(x):.3g}" for x in of_fit) for name, of_fit in sizes.items()}
    rivals = [
        f"by {name} to {errors[name]} ({dof.parameters['inertia']} {fit.theta[0]:.3g})"
        for name, fit in fits.items()
        if name != chosen
    ]
    says = (
        f"by {chosen}: runs left out are predicted {horizons} s ahead to {errors[chosen]} {dof.units.shown} "
        f"({dof.parameters['inertia']} {fits[chosen].theta[0]:.3g}), {', '.join(rivals)}"
    )
    if chosen == INNOVATIONS:
        return replace(likely, estimator=says)
    fit = fits[chosen]
    covariance = _with_bias(run_covariance(fit), fit, SHARES[chosen] * (plain.phi - innovations.phi)[:count])
    model = likely.model.with_theta(fit.of_model)
    best = replace(likely, model=model, mixed=fit, covariance=covariance, estimator=says, to_forecasts=SHARES[chosen])
    return replace(best, ways=directional_drag(best)) if "difference" in best.roles else best


def _with_bias(covariance: Floats, fit: Fit, bias: Floats) -> Floats:
    """The covariance (p, p) with the square of what is biased by so much (m,) however few or many runs there are."""
    count = len(bias)
    quantiles = [special.stdtrit(run_dof(fit, axis), 0.975) for axis in np.eye(len(fit.phi))[:count]]
    widened, bias = covariance.copy(), bias * special.ndtri(0.975) / quantiles
    widened[:count, :count] += np.outer(bias, bias)
    return widened


def start_of(name: str, course: Course, place: int = 0, law: int = 0) -> list[float]:
    """Give values from which the fit of an effect in one of its laws starts, on the degree of freedom in that place;
    what others refer to is that of the logs."""
    effect = effects.get(name)
    acted_on = course.signals.get(effect.acts_on, course.commanded[place])
    parameters, largest = effect.parameters, float(np.abs(acted_on).max()) or 1.0
    logged = {signal: float(column[course.width > 0].mean()) for signal, column in course.signals.items()}
    references = {"moment": largest, "clock": float(course.start.min()), **logged}
    return [
        float(law) if p.choices else references.get(p.reference, p.off) if p.held else p.scaled(p.start, largest)
        for p in parameters
    ]


def starts_in_likeliest_laws(names: Sequence[str], course: Course, batch: Batch, priors: Priors) -> list[list[float]]:
    """Values from which the fits of effects start, each in its law, those under which the runs are likeliest beside
    both drags (Akaike's criterion)."""
    several = list(product(*([start_of(name, course, law=i) for i in laws_of(name, course)] for name in names)))
    if len(several) == 1:
        return list(several[0])
    rough = rough_model("2", batch)
    models = [reduce(lambda model, of: model.with_effect(*of), zip(names, starts), rough) for starts in several]
    problems = [driven_problem(model, course).informed(priors) for model in models]
    fits = fits_of(problems, [*map(base_starts, problems)], brief=True)
    scores = [-np.inf if fit is None else fit.log_likelihood - len(of.free) for of, fit in zip(problems, fits)]
    return list(several[int(np.argmax(scores))])


def laws_of(name: str, course: Course) -> Sequence[int]:
    """The laws that a fit chooses from: of what differs from run to run, or reads further columns, one alone."""
    effect = effects.get(name)
    return [effect.law_of(course.signals)] if effect.per_run or effect.columns else effect.laws_of(effect.needs)


def _runaway(model: Model, fit: Fit, course: Course) -> str:
    """What the runs lack where a fit ran away and is no model; else empty."""
    dof, largest = course.motion.dofs[0], float(np.abs(course.commanded).max())
    linear, quadratic = model.drag()
    slowness = model.fastest(largest)
    deviation = float(np.sqrt(max(run_covariance(fit)[0, 0], 0.0)))
    coupled = any(term.name == "cross-coupling" for term in model.terms)  # the speed ahead may be all that damps it
    if linear <= 0 and quadratic <= 0 and not coupled:
        reason = f"no drag is left of it ({', '.join(model.short_names[1:])} at zero)"
    elif not (coupled or MIN_ANSWER_S < slowness < MAX_ANSWER_S):
        reason = f"it would answer its thrusters within {slowness:.2g} s"
    elif fit.names[0] not in fit.parameters.priors and (0 in fit.at_bound or not 0.0 < deviation <= np.log(3.0)):
        reason = f"{dof.words.an_inertia} of {model.inertia:.3g} is as likely as one of three times that"
    else:
        return ""
    says = (
        "They hold too little {moving} that the {force} made; add runs with larger and quicker commands to both sides, "
        "best without a controller in the loop, and check that the logged commands are those of this vehicle"
    )
    return f"these runs do not determine the model: {reason}. {dof.fill(says)}"


RUNS_A_PASS = 16  # runs that one filter follows by as many fits, of which those without their own run count


def left_out_predictions(
    problem: DrivenProblem, fit: Fit, channels: Sequence[int] = (0,), *, thinned: bool = False, alone: bool = False,
    horizons: Sequence[float] = HORIZONS,
) -> list[tuple[Predicted, ...]]:  # fmt: skip
    """Predictions of each run by the parameters that the other runs give, of each channel over each horizon [s].

    States follow all readings, or those that are `thinned`. The model predicts with the disturbance and the gain that
    the filter believes in, or `alone`, as whoever simulates it does.
    """
    by_run, runs = [], np.arange(len(problem.course.names))
    for group in np.split(runs, runs[RUNS_A_PASS::RUNS_A_PASS]):
        course = problem.course.some(np.isin(runs, group))
        together = problem.follow(fit.left_out[group], True, course if thinned else course.unthinned)
        for i, r in enumerate(group):
            of_run, theta = problem.course.some(runs == r), problem.parameters.natural(fit.left_out[r])
            model, noises, followed = theta[: len(fit.of_model)], problem.noises(theta[None]), together.of(i, i)
            by_run.append(predict(problem.model, of_run, model, noises, channels, followed, alone, horizons))
    return [tuple(map(_joined, zip(*of_channel))) for of_channel in zip(*by_run)]


def predictions_of(course: Course, fit: OutputErrorFit, alone: bool = False) -> tuple[Predicted, ...]:
    """The predictions of each run by a fit to the others, see `left_out_predictions`."""
    return left_out_predictions(driven_problem(fit.model, course), fit.mixed, alone=alone)[0]


def _joined(pieces: Sequence[Predicted]) -> Predicted:
    names = ("origin", "target", "error", "constant_rate", "constant")
    run = np.concatenate([piece.run + r for r, piece in enumerate(pieces)])
    joined = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in names)
    return Predicted(pieces[0].horizon, run, *joined)


def whole_predictions(
    course: Course, fits: Sequence[OutputErrorFit], alone: bool = False
) -> list[tuple[Predicted, ...]]:
    """The same by fits of runs simulated whole; none where no filter follows. What is random is fitted freely: one
    that knows no disturbance would not follow a vehicle whose model lacks something."""
    problems = [driven_problem(fit.model, course) for fit in fits]
    fixed = [replace(p, parameters=p.parameters.fixed_at(fit.model.theta)) for p, fit in zip(problems, fits)]
    followed = fits_of(fixed, [p.parameters.theta[None] for p in fixed], BRIEF_ITERATIONS, brief=True)
    predictions = list[tuple[Predicted, ...]]()
    for fit, problem, innovations in zip(fits, problems, followed):
        if innovations is None:
            predictions.append(())
            continue
        mixed, random = fit.mixed.parameters, innovations.theta[len(fit.model.theta) :]
        without = mixed.natural(fit.mixed.left_out)[:, mixed.of_model]
        left_out = problem.parameters.search(problem.parameters.within([[*of_model, *random] for of_model in without]))
        predictions += left_out_predictions(problem, replace(innovations, left_out=left_out), alone=alone)
    return predictions


def worth_of(predictions: Sequence[Predicted]) -> tuple[ForecastScore, ...]:
    """What predictions are worth, by horizon; those of which there are none are left out."""
    return tuple(
        ForecastScore(p.horizon, p.rmse(), p.rmse(p.constant_rate), p.rmse(p.constant), len(p.error))
        for p in predictions
        if len(p.error)
    )


def inflate_for_missing(course: Course, fit: OutputErrorFit) -> OutputErrorFit:
    """The fit with intervals that allow for what it lacks, and each of PROPOSED that the evidence asks for; where
    commands come late, thrusters that lag in place of a delay as well, in any law.

    The square of the way to where innovations put the parameters beside the best of them is added to their covariance.
    """
    narrow, count, have = fit.mixed, len(fit.model.theta), {term.name for term in fit.model.terms}
    steered = course.moment_unit == STEERED
    of_rudder = PROPOSED_OF_RUDDER if steered or "rudder" in course.signals else ()
    names = [name for name in (*PROPOSED, *of_rudder) if effects.get(name).steered in (None, steered)]
    tried = [(name, start_of(name, course), narrow.of_chance) for name in names if name not in have]
    if THRUSTER_LAG not in have and comes_late(fit, course.half_width):
        at_once = {**narrow.of_chance, COMMAND_DELAY: 0.0}
        tried += [(THRUSTER_LAG, start, at_once) for start in lags_like(fit.delay.value, course)]
    if not tried:
        return fit
    problems, starts = list[DrivenProblem](), list[Floats]()
    for name, start, chances in tried:
        wider = driven_problem(fit.model.with_effect(name, start), course).informed(narrow.parameters.priors)
        problems.append(wider)
        starts.append(starts_near(wider, [np.array([*narrow.of_model, *start])], chances))
    if fit.to_forecasts:  # at which innovations are not most likely
        problems, starts = [*problems, _informed(course, fit)], [*starts, narrow.theta[None]]
    fits = fits_of(problems, starts, brief=True)
    likelihood = ((fits[-1] if fit.to_forecasts else None) or narrow).log_likelihood
    gains, shifts = dict[str, float](), dict[str, Floats]()
    for (name, *_), wide in zip(tried, fits):
        gain = 2.0 * (wide.log_likelihood - likelihood) if wide else 0.0
        if wide and gain > max(gains.get(name, 0.0), MIN_PROPOSED_GAIN + np.log(max(len(course.names), 2))):
            gains[name], shifts[name] = gain, wide.phi[:count] - narrow.phi[:count]
    if not gains:
        return fit
    shift = shifts[max(gains, key=lambda name: gains[name])]
    return replace(fit, covariance=_with_bias(fit.covariance, narrow, shift), proposed=gains)


def lags_like(delay: float, course: Course) -> list[list[float]]:
    """Give the values of thrusters that lag for as long as a `delay` [s], in each law."""
    return [[delay, *start_of(THRUSTER_LAG, course, law=law)[1:]] for law in laws_of(THRUSTER_LAG, course)]


def comes_late(fit: OutputErrorFit, half_sample: float) -> bool:
    """Whether commands act later than half a sample [s] beyond doubt."""
    return fit.delay.value - half_sample >= MIN_LATE_STDERRS * fit.delay.stderr


def inflate_for_lag(
    runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None, fit: OutputErrorFit,
    disturbed: bool = False,
) -> OutputErrorFit:  # fmt: skip
    """The fit of runs to which commands come late, with intervals that allow for thrusters that lag in place of a
    delay, if the evidence asks for them; both are fitted to the runs by simulation."""
    if not comes_late(fit, 0.5 * float(np.median([run.sample_period for run in runs]))):
        return fit
    narrow, count, batch = fit.mixed, len(fit.model.theta), make_batch(runs, MAX_STEPS_S[0], channels=channels)
    course = make_course(runs, at_rest, channels=channels)
    factors = {**START_SCATTERS, GAIN: max(narrow.factor(GAIN), START_SCATTERS[GAIN])}

    def fitted(model: Model, *late: float) -> MixedFit:
        parameters = model.parameters(log_drag=True, signed_drag=True)
        problem = whole_run_problem(model, parameters, batch, at_rest, disturbed=disturbed)
        begins = np.array([factors[name] for name in problem.effects.factor_names])
        theta, informed = np.array([*narrow.of_model, *late]), problem.informed(narrow.parameters.priors)
        return fit_mixed(
            informed, theta, noise=narrow.noise, factors=begins, settled=BRIEF_STDERRS, iterations=BRIEF_ITERATIONS
        )

    lags = list[MixedFit]()
    for late in lags_like(fit.delay.value, course):
        with suppress(FitError):
            lags.append(fitted(fit.model.with_effect(THRUSTER_LAG, late), *late, 0.0))
    gain, best = 0.0, max(lags, key=lambda lag: lag.log_likelihood, default=None)
    with suppress(FitError):
        gain = 2.0 * (best.log_likelihood - fitted(fit.model, fit.delay.value).log_likelihood) if best else 0.0
    if best is None or gain <= MIN_PROPOSED_GAIN + np.log(max(len(runs), 2)):
        return fit
    shift = best.phi[:count] - narrow.phi[:count]
    return replace(fit, covariance=_with_bias(fit.covariance, narrow, shift), proposed={THRUSTER_LAG: gain})


MIN_WAY = 0.1  # share of all that the runs went that has to go each way before drag may differ between the ways
MAX_STEPS_S = (0.1, 0.05, 0.025)  # simulation steps [s] of whole runs; the longest that a model allows is taken


def is_driven(runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None) -> bool:
    """Whether the evidence asks for a fit of whole runs by innovations."""
    try:
        return shows_disturbance(runs, rough_model("2", make_batch(runs, MAX_STEPS_S[0])), at_rest, channels)
    except FitError:  # what is wrong with them, their fit will say
        return not mostly_held(runs)


def fit_driven_models(
    models: Sequence[tuple[str, tuple[str, ...]]], runs: Sequence[Run], course: Course, priors: Priors,
    map_jobs: Each = alone,
) -> list[FitOrReason]:  # fmt: skip
    """Fit models to driven runs, each by its number and what it has beside its drag."""
    batch, two_way, numbers = make_batch(runs, MAX_STEPS_S[0]), both_ways(runs), [number for number, _ in models]

    names = tuple(dict.fromkeys(name for _, with_effects in models for name in with_effects))
    start = dict(zip(names, starts_in_likeliest_laws(names, course, batch, priors)))

    def rough(number: str, with_effects: Sequence[str], sided: bool) -> Model:
        model = rough_model(number, batch, sided)
        for name in with_effects:
            model = model.with_effect(name, start[name])
        return model

    ways = (False, True) if batch.dof.directional and two_way else (False,)
    roughs = [[rough(*number_and_effects, sided) for number_and_effects in models] for sided in ways]
    fits = map_jobs(partial(driven_fits, course, numbers, priors), roughs, FITTING)

    def fit_of(i: int, sided: bool) -> OutputErrorFit:
        fit, why = fits[sided][i]
        if fit is None:
            raise FitError(why)
        return fit

    attempts = list[FitOrReason]()
    for i in range(len(models)):
        try:
            attempts.append((fit_by_direction(partial(fit_of, i), batch.dof, two_way), ""))
        except FitError as error:
            attempts.append((None, str(error)))
    likely = [fit for fit, _ in attempts if fit is not None]
    chosen = iter(beside_forecasts(course, likely, mostly_held(runs), map_jobs))
    return [(None, why) if fit is None else (next(chosen), "") for fit, why in attempts]


MIN_DRIVEN_GAIN = 0.2  # share of the error of forecasts that innovations have to take off runs of held commands


def predicts_better(course: Course, quiet: OutputErrorFit, fit: OutputErrorFit) -> bool:
    """Whether a `fit` by innovations, the preferred one, forecasts runs left out better than the preferred `quiet` one.

    Of runs of held commands the evidence alone does not decide: an effect that a model lacks looks like a disturbance,
    and there predicts hardly better.
    """
    losses = _losses_of(course, quiet, fit)
    return losses is not None and bool(losses["driven"].sum() < (1.0 - MIN_DRIVEN_GAIN) ** 2 * losses["quiet"].sum())


def predicts_as_well(course: Course, quiet: OutputErrorFit, fit: OutputErrorFit) -> bool:
    """Whether a `fit` by innovations forecasts runs left out no worse than a `quiet` one, but by chance."""
    losses = _losses_of(course, quiet, fit)
    return losses is not None and not is_ahead(losses["quiet"], losses["driven"])


def _losses_of(course: Course, quiet: OutputErrorFit, fit: OutputErrorFit) -> dict[str, Floats] | None:
    (ahead_quiet,) = whole_predictions(course, [quiet], alone=True)
    ahead = {"quiet": ahead_quiet, "driven": predictions_of(course, fit, alone=True)}
    return forecast_losses(ahead, len(course.names))


def both_ways(runs: Sequence[Run]) -> bool:
    steps = np.concatenate([np.diff(run.position[:: max(1, round(1.0 / run.sample_period))]) for run in runs])
    distances = float(steps[steps > 0].sum()), float(-steps[steps < 0].sum())
    return min(distances) > MIN_WAY * sum(distances)


JUDGED_HORIZON_S = 5.0  # seconds ahead over which a model has to be of use
LARGE_SHARE = {False: 1.0, True: 0.5}
"""Times the commands, both as root mean squares, from which on a disturbance is said to be as large as they are: of one
motion, and in the plane."""


@dataclass(frozen=True)
class Judgement:
    """What the preferred model is worth, by quantity and horizon, on each of so many `runs` by a fit to the others: of
    positions of one motion, or of heading and either place on the water or speeds. `large` is a sentence where
    something else than the commands pushes hard; `biased` are predictions along commands that answer disturbances.

    For people to look at, where a filter followed the runs: `predictions` of the position on the nodes of the `course`.
    """

    worth: Mapping[str, tuple[ForecastScore, ...]]
    runs: int
    predictions: tuple[Predicted, ...] = field(default=(), repr=False)
    course: Course | None = field(default=None, repr=False)
    large: str = ""
    biased: bool = False

    @property
    def beaten(self) -> dict[str, ForecastScore]:
        """Quantities that a constant predicts better over the horizon that decides."""
        judged = {name: judged_of(scores) for name, scores in self.worth.items()}
        return {name: score for name, score in judged.items() if score is not None and not score.of_use}

    @property
    def of_use(self) -> bool:
        """Whether no constant predicts better; what cannot be judged, or only with a bias, counts as of use."""
        return self.biased or not self.beaten

    @property
    def score(self) -> float:
        """Mean logarithm of the errors as shares of what the better constant misses by, over quantities and horizons;
        infinite where predictions run away, zero where there are none."""
        shares = [s.error / min(s.constant_rate, s.constant) for scores in self.worth.values() for s in scores]
        score = float(np.mean(np.log(np.maximum(shares, 1e-9)))) if shares else 0.0
        return score if np.isfinite(score) else np.inf

    def sentence(self, dof: Dof, model: str = "", on: str = "") -> str:
        """Say how far off the `model` is ahead, `on` which runs; by default on those that its fit left out."""
        first, scores = next(iter(self.worth.items()))
        if (judged := judged_of(scores)) is None:
            return "The runs are too short to judge predictions."
        alone = self.runs == 1
        on = on or ("the run that was fitted: others may be predicted worse" if alone else "held out")
        if self.of_use:
            says = self._forecast(f"{model or 'The model'} predicts", f" ({on})", first, judged, dof)
            return f"{says} {FLATTERED}" if self.beaten else says
        worse = " ".join(self._forecast("It predicts", "", name, score, dof) for name, score in self.beaten.items())
        return (
            f"{model or 'This model'} is not usable ({on}). {worse} Do not simulate or control with it; "
            "`automarine diagnose` looks for what it lacks."
        )

    def _forecast(self, begin: str, on: str, name: str, score: ForecastScore, dof: Dof) -> str:
        if len(self.worth) == 1:
            return score.sentence(begin, on, dof)
        words = {dof.position: (name,), PLACE: (name, "rate", name, "m")}
        quantity, *rivals = words.get(name, (f"{name} speed", "acceleration", "speed", "m/s"))
        return score.sentence(f"{begin} the {quantity}", on, dof, *rivals)

    def warnings(self, dof: Dof) -> tuple[str, ...]:
        return (*([] if self.of_use else [self.sentence(dof)]), *filter(None, [self.large]))

    def to_json(self, dof: Dof) -> dict[str, object]:
        """For the result file: one entry a horizon, errors as root mean squares."""
        entries = {score.horizon: score.to_json(dof) for score in self.worth[dof.position]}
        for name, scores in self.worth.items():
            unit = unit_of_quantity(name, dof).replace("/", "_")
            for score in scores if name != dof.position else ():
                sizes = {f"{name}_rmse": score.error, f"constant_rate_{name}": score.constant_rate}
                sizes |= {f"constant_{name}": score.constant}
                entries.get(score.horizon, {}).update({f"{key}_{unit}": size for key, size in sizes.items()})
        return {"left_out_runs": [*entries.values()], "of_use": self.of_use, "says": self.sentence(dof)}


FLATTERED = "That is no judgement: commands that answer disturbances flatter constants."
PLACE = "place"  # on the water, both axes together


def unit_of_quantity(name: str, dof: Dof) -> str:
    """In which people see a quantity that is judged: a position of the motion, a place on the water or a speed."""
    return {dof.position: dof.units.shown, PLACE: "m"}.get(name, "m/s")


def judged_of(worth: Sequence[ForecastScore]) -> ForecastScore | None:
    """What decides of several horizons: JUDGED_HORIZON_S, or the longest below it."""
    return max((score for score in worth if score.horizon <= JUDGED_HORIZON_S), key=lambda w: w.horizon, default=None)


MIN_PUSH_SHARE = 0.005  # of the largest command, from which on a push is no chance; hidden effects make 0.03 to 0.1


def unknown_push(fit: OutputErrorFit, runs: Sequence[Run]) -> str:
    """A sentence where noise and scattered thrust do not explain runs that were fitted whole; else empty."""
    dof, of = fit.model.dof, max(float(np.abs(run.command).max()) for run in runs) / fit.model.inertia
    if of == 0.0 or fit.mixed.factor_interval(DISTURBANCE)[0] < MIN_PUSH_SHARE * of:
        return ""
    return (
        f"Noise and thrust scatter do not explain these runs: a push of {100 * fit.mixed.factor(DISTURBANCE) / of:.2g} "
        f"% of the largest {dof.words.force} is left. {dof.words.inertia.capitalize()} and drag may be wrong. Find the "
        f"missing effect with `automarine diagnose LOGS --model {dof.name}_model.json`."
    )


def large_disturbance(course: Course, inertia: Floats, random: Mapping[str, float]) -> str:
    """A sentence where what pushes the vehicle is as large as the commands; else empty. `inertia` (D,) is that of each
    motion, `random` the sizes of what is random by name."""
    usual = np.sqrt(np.sum(course.commanded**2 * course.width, axis=(1, 2)) / np.sum(course.width))
    listed, plane = [], course.motion.turns
    for dof, of_motion, commands in zip(course.motion.dofs, inertia, usual):
        size = of_motion * random[f"{dof.name}.disturbance"]
        if size >= LARGE_SHARE[plane] * commands > 0.0:
            unit = dof.units.forces[1] if plane else course.moment_unit
            listed.append(f"{dof.words.full_force} {size:.3g} of {commands:.3g} {unit}")
    if not listed:
        return ""
    return (
        f"The disturbance is {'more than half ' if plane else ''}as large as the commands: {', '.join(listed)} (root "
        "mean squares). It may answer for what they do. Add runs with larger commands; inertia and drag may be wrong "
        "by more than their intervals."
    )
