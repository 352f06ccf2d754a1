"""Maximum likelihood of models 1 to 3 on headings: estimates with intervals over runs, and which model the
evidence prefers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import Dof
from automarine_cli.fits.influence import covariance_of_changes, degrees_of_freedom, left_out_changes
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.mixed_model import MixedFit, Problem, fit_mixed
from automarine_cli.fits.mixed_problem import SWITCH
from automarine_cli.fits.nodes import COUNTS
from automarine_cli.fits.outcome import Outcome
from automarine_cli.fits.run_effects import DISTURBANCE, GAIN, SWITCHES
from automarine_cli.fits.step_problem import step_problem
from automarine_cli.fits.step_response import StepData, density, instant
from automarine_cli.fits.ways import Ways
from automarine_cli.fits.whole_runs import rough_model, whole_run_problem, without_gain
from automarine_cli.models.yaw_model import YawModel, base_names, base_roles, main_drag
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.simulation.batch import Batch

ENOUGH_RUNS = 8
"""From this many runs on, standard errors are the jackknife's alone; with fewer the larger of it and the
likelihood's."""

MANY_RUNS, ITERATIONS_OF_MANY = 400, 20
"""More runs than these are fitted in two steps, some and then all, of which the second needs few iterations."""

MOST_GROWTH = 1e6
"""Of a standard error by leaving runs out; beyond it the runs say nothing at all."""


@dataclass(frozen=True)
class OutputErrorFit:
    """One model fitted to headings by maximum likelihood.

    `estimates` by parameter name, `inertial_turn_angle` I/k_rr [rad] (models 2 and 3), `offset` of the command's
    instant [sample intervals], `gain_scatter` run to run (relative), `noise` of the positions [rad] (None where they do
    not count), `covariance` (p, p) of phi (logarithms of positive parameters) with the run as the unit, `start` (p,)
    the theta that the search began with; `ways` the drag of each way where that was asked. `estimator` says by what the
    parameters were estimated, and of driven runs why; `by_forecasts` is True where that is least squares of forecasts.
    """

    number: str
    model: YawModel
    estimates: Mapping[str, Estimate]
    inertial_turn_angle: Estimate | None
    offset: Estimate
    gain_scatter: Estimate
    noise: float | None
    mixed: Outcome
    covariance: Floats
    start: Floats
    ways: Ways | None = None
    estimator: str = ""
    by_forecasts: bool = False


@dataclass(frozen=True)
class Preference:
    """Which model the runs prefer, and the sentence that says why."""

    number: str
    because: str


def fit_half_turns(
    data: StepData,
    number: str,
    start: tuple[float, float, float],
    moment_unit: str,
    known: Known,
    constant: float = 0.0,
    sided: bool = False,
) -> OutputErrorFit:
    """Fit one model to half-turns; `start` is inertia, linear and quadratic drag to begin from, wherever found.

    Of motions that have them also a `constant` force and, if `sided`, the difference of drag between the ways.
    """
    begins = {**dict(zip(("inertia", "linear", "quadratic"), start)), "constant": constant, "difference": 0.0}
    begin = np.array([*(begins[role] for role in base_roles(number, data.dof, sided)), 0.0])
    problem, mixed = _fit_at_nodes(data, number, known, begin, sided)
    return _outcome(number, problem, mixed, begin, moment_unit, data.dof, sided, of_half_turns=True)


def _fit_at_nodes(data: StepData, number: str, known: Known, begin: Floats, sided: bool) -> tuple[Problem, MixedFit]:
    """The fit to all samples, by as few nodes a run as show its answer exactly, or by the samples where none do.

    That of very many runs begins where that of some of them ended.
    """
    whole, theta = step_problem(data, number, known, sided=sided), begin
    start: dict[str, Any] = {"noise": 0.02, "factors": np.array([0.03, 0.5])}
    if len(data.names) > MANY_RUNS:
        first = _fit_at_nodes(data.some(MANY_RUNS // 2), number, known, begin, sided)[1]
        theta = np.append(first.of_model, begin[-1])  # of instants few runs say little
        start |= {"noise": first.noises, "iterations": ITERATIONS_OF_MANY}
    for count in COUNTS:
        nodes = data.nodes(count)
        if nodes is None:
            break
        problem = step_problem(data, number, known, nodes, sided)
        mixed = fit_mixed(problem, theta, **start)
        shown = (
            one.show(mixed.reading(channel.quantity), channel.seen.sum(axis=1))
            for one, channel in zip(nodes, data.channels)
        )
        if all(shown):
            readings = whole.readings(mixed.phi, mixed.run_effects)
            return problem, replace(mixed, fitted=readings, slots=whole.slots)
        theta = mixed.theta
    return whole, fit_mixed(whole, theta, **start)


def fit_whole_runs(
    batch: Batch, number: str, at_rest: NDArray[np.bool_], sided: bool = False, known: Known = NOTHING_KNOWN
) -> OutputErrorFit:
    """Fit one model to whole runs by simulation: first without a random gain, then with it from there.

    One run alone cannot tell its gain from the vehicle's, so none is taken to scatter. Raises FitError where no start
    leads anywhere.
    """
    alone = len(batch.names) == 1
    rough, dof = rough_model(number, batch, sided), batch.dof
    problem = whole_run_problem(rough, batch, at_rest).informed(known.parameters)
    pooled = without_gain(problem)
    begins = {GAIN: 0.01, SWITCHES: 0.5, DISTURBANCE: 0.03}
    factors = np.array([begins[name] for name in problem.effects.factor_names])
    begin = np.append(rough.theta, 0.0)
    if alone:
        only = fit_mixed(pooled, begin, noise=0.05, factors=factors)
        return _outcome(number, pooled, only, begin, batch.moment_unit, dof, sided, of_half_turns=False)
    first = fit_mixed(pooled, begin, noise=0.05, factors=factors, iterations=20, settled=0.05)
    little = 0.2 if known.parameters else 0.02  # what is known may ask for other thrusts than the logs tell
    best = fit_mixed(
        problem,
        first.theta,
        noise=first.noises,
        factors=np.array([little if name == GAIN else first.factor(name) for name in first.effects.factor_names]),
        run_effects=first.run_effects,
    )
    return _outcome(number, problem, best, begin, batch.moment_unit, dof, sided, of_half_turns=False)


def run_covariance(mixed: Outcome, problem: Problem | None = None) -> Floats:
    """Covariance of phi with the run as the unit (see ENOUGH_RUNS), (p, p).

    Given the `problem` that was fitted, it is exact where instants are confined to their sample intervals (see
    influence.py); without, it is the linearised jackknife, which is too wide there.
    """
    runs = len(mixed.left_out)
    if runs < 2:
        return mixed.covariance
    jackknife = mixed.jackknife_covariance
    if problem is not None and isinstance(mixed, MixedFit):
        jackknife = covariance_of_changes(left_out_changes(problem, mixed))
    jackknife = jackknife + mixed.error_of_known
    if runs >= ENOUGH_RUNS:
        return jackknife
    likely, between = (np.sqrt(np.maximum(np.diagonal(c), 0.0)) for c in (mixed.covariance, jackknife))
    ratio = np.divide(between, likely, out=np.ones_like(between), where=likely > 0)  # none at a bound
    grow = np.clip(ratio, 1.0, MOST_GROWTH)
    return mixed.covariance * np.outer(grow, grow)


def run_dof(mixed: Outcome, direction: Floats) -> float:
    """Degrees of freedom of the variance along `direction` (p,) of phi that `run_covariance` tells."""
    runs = len(mixed.left_out)
    return degrees_of_freedom(mixed, direction) if runs >= ENOUGH_RUNS else float(max(runs - 1, 1))


def estimate_of(mixed: Outcome, covariance: Floats, i: int, unit: str, dof: float | None = None) -> Estimate:
    """One parameter; the interval of a positive one is formed on its logarithm. `dof` is that of `run_dof` if None."""
    stderr = float(np.sqrt(max(covariance[i, i], 0.0)))
    form = Estimate.from_log if mixed.positive[i] else Estimate.from_stderr
    found = form(float(mixed.theta[i]), stderr, dof or run_dof(mixed, np.eye(len(mixed.theta))[i]), unit)
    known = mixed.names[i] in mixed.known
    return replace(found, known=known, at_bound=i in mixed.at_bound and not known)


def _outcome(
    number: str,
    problem: Problem,
    mixed: MixedFit,
    start: Floats,
    moment_unit: str,
    dof: Dof,
    sided: bool,
    *,
    of_half_turns: bool,
) -> OutputErrorFit:
    covariance = run_covariance(mixed, problem if of_half_turns else None)
    alone = float(problem.count.sum() - len(mixed.theta)) if len(problem.measured) == 1 else None
    axes = np.eye(len(mixed.theta))
    roles, names = base_roles(number, dof, sided), base_names(number, dof, sided)
    at = {role: mixed.names.index(dof.parameter(role)) for role in roles}
    like = {"difference": main_drag(number)}
    estimates = {
        name: estimate_of(mixed, covariance, at[role], dof.unit_of(like.get(role, role), moment_unit), alone)
        for role, name in zip(roles, names)
    }
    turn = None
    stuck = at.get("quadratic") in mixed.at_bound and dof.parameter("quadratic") not in mixed.known
    if "quadratic" in roles and not stuck:
        i, k = at["inertia"], at["quadratic"]
        stderr = float(np.sqrt(covariance[i, i] + covariance[k, k] - 2 * covariance[i, k]))
        freedom = alone or run_dof(mixed, axes[i] - axes[k])
        turn = Estimate.from_log(mixed.theta[i] / mixed.theta[k], stderr, freedom, dof.unit_of("ratio"))
    if problem.effects.of(problem.effects.scale, GAIN).any():
        low, high = mixed.factor_interval(GAIN)
        scatter = Estimate(mixed.factor(GAIN), (high - low) / 3.92, (low, high), "1")
    else:  # known to be none, or not to be told from one run
        scatter = Estimate(0.0, 0.0, (0.0, 0.0), "1")
    offset = estimate_of(mixed, covariance, mixed.names.index(SWITCH), "sample interval", alone)
    if of_half_turns:
        offset = _in_interval(offset)
    model = YawModel.base(number, mixed.theta[0], mixed.of_model[1:], moment_unit, dof)
    return OutputErrorFit(
        number, model, estimates, turn, offset, scatter, mixed.noise_of.get(dof.position), mixed, covariance, start
    )


def _in_interval(z: Estimate) -> Estimate:
    """The instant in sample intervals of a z of half-turns, see `step_response.instant`."""
    value, low, high = instant(np.array([z.value, *z.ci95]))
    return Estimate(float(value), float(density(np.array(z.value))) * z.stderr, (float(low), float(high)), z.unit)


def prefer(fits: Mapping[str, OutputErrorFit]) -> Preference:
    """The model whose left-out runs are predicted best; of two that do not differ, the simpler.

    Evidence is the log density of each run under the fit to the others, summed over runs; a difference
    counts when it exceeds two of its standard errors over runs (Vehtari, Gelman and Gabry 2017, Statistics
    and Computing 27:1413).
    """
    parameters = {number: len(fit.model.theta) - 1 for number, fit in fits.items()}
    if all(len(fit.mixed.predictive) == 1 for fit in fits.values()):
        return _prefer_in_one_run(fits, parameters)
    totals = {number: float(fit.mixed.predictive.sum()) for number, fit in fits.items()}
    best = max(totals, key=lambda number: totals[number])
    chosen, parts = best, []
    for number in sorted(fits, key=lambda n: parameters[n]):
        gap, error = _lead(fits[best], fits[number])
        if number != best and parameters[number] < parameters[chosen] and gap <= 2.0 * error:
            chosen = number
    for number in sorted(fits):
        gap, error = _lead(fits[chosen], fits[number])
        if number == chosen:
            continue
        if gap < 0:
            parts.append(f"model {number} leads by {-gap:.1f} ± {error:.1f}, not enough to justify another parameter")
        elif gap <= 2.0 * error:
            more = ", which has more parameters" if parameters[number] > parameters[chosen] else ""
            parts.append(f"it is level with model {number}{more} ({gap:.1f} ± {error:.1f})")
        else:
            parts.append(f"it leads model {number} by {gap:.1f} ± {error:.1f}")
    because = f"Model {chosen} predicts runs left out of the fit best or as well as any simpler one: in log density "
    return Preference(chosen, because + " and ".join(parts) + ".")


def _prefer_in_one_run(fits: Mapping[str, OutputErrorFit], parameters: Mapping[str, int]) -> Preference:
    """Akaike's criterion: with one run there is none to predict."""
    cost = {number: 2.0 * (parameters[number] - fit.mixed.log_likelihood) for number, fit in fits.items()}
    best = min(sorted(fits), key=lambda number: cost[number])
    others = [
        f"model {number}'s is higher by {cost[number] - cost[best]:.1f}" for number in sorted(fits) if number != best
    ]
    return Preference(
        best,
        f"With one run there is no cross-validation; by Akaike's criterion model {best} is best, "
        f"{' and '.join(others)}.",
    )


def _lead(a: OutputErrorFit, b: OutputErrorFit) -> tuple[float, float]:
    """How much better a predicts left-out runs than b, and the standard error of that over runs."""
    difference = a.mixed.predictive - b.mixed.predictive
    error = np.sqrt(len(difference)) * np.std(difference, ddof=1) if len(difference) > 1 else np.inf
    return float(difference.sum()), float(error)
