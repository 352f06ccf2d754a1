"""Whole runs simulated under any model: closed-loop driving, sequences, runs with effects that half-turns
cannot show.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations import Fit, InnovationsFit
from automarine_cli.fits.linear_mixed import (
    DISTURBANCE,
    GAIN,
    START_POSITION,
    START_VELOCITY,
    SWITCHES,
    Block,
    Grams,
    RunEffects,
    bias_of,
)
from automarine_cli.fits.mixed_model import MixedFit, Problem, derivatives, fit_mixed, jackknife, slots_of
from automarine_cli.models.model import COMMAND_DELAY, MAX_DELAY_S, MAX_EARLY_HALF_SAMPLES, Model, main_drag
from automarine_cli.models.parameter import NOTHING_KNOWN, NUISANCE, Parameter, Parameters, Prior, Priors
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import start_motion
from automarine_cli.simulation.batch import Batch
from automarine_cli.simulation.rollout import Start, simulate

STEP_STDERRS = 0.1  # of differences, in standard errors of a parameter or posterior ones of a run effect
MAX_STEP = 1.0  # longest of these steps on a logarithm: nothing is known of a parameter that may be further off
MIN_STIFFNESS = 1e-8
"""Smallest eigenvalue, with every parameter in units of its own curvature, of equations that fix a solution."""


def left_out_changes(problem: Problem, fit: MixedFit) -> Floats:
    """Change of phi when each run is left out, (R, p); zero for parameters at a bound.

    `problem` is the one that was fitted. Where the equations do not fix the solution, the changes are those of the
    linearised problem. Raises FitError where the response is not finite beside the solution.
    """
    variances = fit.variances
    runs, count = fit.left_out.shape
    identified = np.flatnonzero(np.diagonal(fit.covariance) > 0.0)  # what no sample shows stays where it is
    free = np.setdiff1d(identified, fit.at_bound)
    moved = np.zeros((runs, count))
    if not len(free):
        return moved
    pull, stiffness = _pull_and_stiffness(problem, fit, variances, free)
    total = stiffness.sum(axis=0)
    if problem.prior is not None:
        total = total + problem.prior[1][np.ix_(free, free)]
    scale = linear_mixed.curvature_scale(total)
    if np.linalg.eigvals(total / np.outer(scale, scale)).real.min() <= MIN_STIFFNESS:
        return fit.left_out - fit.phi
    inverse = np.linalg.pinv((total - stiffness) / np.outer(scale, scale), rcond=1e-9)
    moved[:, free] = -(inverse @ (pull / scale)[:, :, None])[:, :, 0] / scale
    return moved


def degrees_of_freedom(fit: Fit, direction: Floats) -> float:
    """Of the jackknife's variance along `direction` (p,) of phi: about how many runs carry it, less one.

    Satterthwaite's approximation for runs that pull by their expected variances v_i, (sum v_i)²/sum v_i² (Bell and
    McCaffrey 2002, Survey Methodology 28:169). Where two runs show a parameter, their own spread says little of it.
    """
    free = np.setdiff1d(np.arange(len(fit.phi)), fit.at_bound)
    return runs_that_carry(fit.information[:, free[:, None], free], direction[free])


def runs_that_carry(information: Floats, direction: Floats) -> float:
    """The same of runs whose information (R, p, p) is known, along `direction` (p,)."""
    reach = linear_mixed.covariance_of(information.sum(axis=0)) @ direction
    share = np.einsum("p,rpk,k->r", reach, information, reach)
    runs = len(share)
    square = float((share**2).sum())
    carried = float(share.sum()) ** 2 / square if square > 0.0 else float(runs)
    return max(carried * (runs - 1) / runs, 1.0)


def _pull_and_stiffness(
    problem: Problem, fit: MixedFit, variances: Floats, free: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """g_i (R, p) and A_i (R, p, p) of the free parameters at the solution."""
    scale = problem.effects.deviation(variances)
    acts = np.flatnonzero(scale.any(axis=0))
    gram = _about(problem, fit.phi, fit.run_effects)
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    aside = STEP_STDERRS * np.sqrt(np.diagonal(fit.covariance))[free]
    aside = np.where(fit.parameters.log[free], np.minimum(aside, MAX_STEP), aside)
    reach = STEP_STDERRS * np.sqrt(np.maximum(weighted.remaining, 1e-6))  # in prior standard deviations
    none = np.zeros_like(scale)

    def slope(phi: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Central differences of g and m for a change of phi and of the run effects, (R, free) and (R, acts)."""
        sides = []
        for sign in (1.0, -1.0):
            shifted = _about(problem, fit.phi + sign * phi, fit.run_effects + sign * b)
            pull = linear_mixed.weigh(shifted, problem.effects, variances).gradient
            pooled = shifted.at(variances)
            mean = scale * pooled.vw / np.exp(2.0 * variances[0])
            mean -= np.divide(pooled.present, scale, out=np.zeros_like(scale), where=scale > 0)
            sides.append((pull[:, free], mean[:, acts]))
        return 0.5 * (sides[0][0] - sides[1][0]), 0.5 * (sides[0][1] - sides[1][1])

    axes = np.eye(len(fit.phi))[free]
    by_phi = [slope(h * dof, none) for h, dof in zip(aside, axes)]
    pull_phi, mean_phi = (np.stack(part, axis=2) / aside for part in zip(*by_phi))
    if not len(acts):
        return weighted.gradient[:, free], -pull_phi
    by_run = [slope(0.0 * fit.phi, reach * scale * (np.arange(scale.shape[1]) == k)) for k in acts]
    pull_run, mean_run = (np.stack(part, axis=2) / reach[:, None, acts] for part in zip(*by_run))
    absent = scale[:, acts] == 0.0  # such an effect stays where it is
    mean_run -= absent[:, :, None] * np.eye(len(acts))
    follows = -np.linalg.solve(mean_run, mean_phi)  # d b_i / d phi, in prior standard deviations
    return weighted.gradient[:, free], -(pull_phi + pull_run @ follows)


def _about(problem: Problem, phi: Floats, b: Floats) -> Grams:
    fitted, by_phi, by_run = derivatives(problem, phi, b)
    return problem.gram(by_phi, by_run, fitted, b, phi)


MAX_SWITCH_Z = 2.5  # of the instant that all switches share: 99 % of a sample interval
AGAINST = 0.2  # share of the impulses that a balance with everything negative must explain to show that a sign is wrong


def whole_run_problem(
    model: Model, parameters: Parameters, batch: Batch, at_rest: NDArray[np.bool_], confined: bool = False,
    disturbed: bool = True,
) -> Problem:  # fmt: skip
    """Likelihood of whole runs by simulation, of all channels of the batch.

    theta is (the model's `parameters`, the command delay [s] from MAX_EARLY_HALF_SAMPLES before the middle of the
    interval in which a command changed to MAX_DELAY_S after it). A run's own switches may leave their intervals, for on
    a lake thrusters lag. If `confined`, every switch stays in its interval, for more is an effect's to say: where in it
    is `instant` of a z common to all, which is then the last entry of theta, and one of its own. Run effects are start
    position [base unit, relative to the first sample], start velocity (where `at_rest` (R,) is false; its scatter is
    estimated), log gain of the moment delivered, where in its interval each change of command was, and a disturbance
    held over each window of the batch: wind, waves, tether and whatever the model lacks. Its size is estimated; it is
    zero in a quiet pool, and without it a minute of free running on a lake would say nothing of the vehicle, because
    positions integrate every disturbance; unless `disturbed` there is none. It is an acceleration, so that a common
    gain scales inertia and drag and nothing else. Then come the biases of velocity sensors, and last the coefficients
    of effects that vary from run to run, in the model's order, each effect's with a factor of its own on the largest
    moment.
    """
    first = batch.position[:, :1]
    varying = varying_terms(model)
    blocks = RunEffects(_blocks(batch, at_rest, confined, disturbed, varying))

    inertia, last = model.index(model.dof.parameter("inertia")), len(parameters)

    @lru_cache(maxsize=1)
    def of_runs(rows: tuple[int, ...]) -> Batch:
        return batch.of_runs(np.array(rows))

    def readings(theta: Floats, b: Floats, rows: NDArray[np.int64] | None = None) -> Floats:
        own = rows is not None
        runs, at = (of_runs(tuple(rows)), first[rows, 0]) if rows is not None else (batch, first[:, 0])
        sets = theta[None] if own else theta[:, None]
        accelerations, delay = blocks.of(b, DISTURBANCE), sets[..., last, None]
        of_run = blocks.of(b, SWITCHES)
        if confined:
            of_run = runs.interval * instant(delay + of_run)
        start = Start(
            at + blocks.of(b, START_POSITION)[..., 0],
            blocks.of(b, START_VELOCITY)[..., 0],
            blocks.of(b, GAIN)[..., 0],
            of_run,  # a step may run backwards
            sets[..., inertia, None] * accelerations if accelerations.any() else None,
            {name: blocks.of(b, name) for name in varying},
            command_delay=None if confined else delay,
        )
        trajectory = simulate(model, runs, theta[:, :last], start, own)
        if len(batch.channels) == 1:
            return trajectory.position
        predicted = [trajectory.reading(channel) for channel in batch.channels]
        for i, channel in enumerate(batch.channels):
            if channel.velocity:
                predicted[i] = predicted[i] + blocks.of(b, bias_of(channel.quantity))
        return np.concatenate(predicted, axis=2)

    ends = (-MAX_EARLY_HALF_SAMPLES * batch.half_interval, MAX_DELAY_S if batch.half_interval else 0.0)
    if confined:
        ends = (-MAX_SWITCH_Z, MAX_SWITCH_Z)
    delay = Parameter(COMMAND_DELAY, 0.0, *ends, role=NUISANCE, unit="s")
    searched = Parameters((*parameters, delay), priors={COMMAND_DELAY: Prior(0.0, 1.0)} if confined else {})
    measured, observed = (np.concatenate(part, axis=1) for part in zip(*((c.values, c.seen) for c in batch.channels)))

    def paired(theta: Floats, b: Floats, rows: NDArray[np.int64]) -> Floats:
        return readings(theta, b[None], rows)[0]

    learned = any(term.name.startswith(PREFIX) for term in model.terms)  # its curve is worked out once a run and set
    slots = slots_of(batch.channels)
    return Problem(readings, measured, observed, blocks, searched, slots, paired=None if learned else paired)


def instant(z: Floats) -> Floats:
    """Say where in its sample interval a command switched, -1/2 to 1/2, for a standard normal z: uniform in it."""
    return np.asarray(special.ndtr(z) - 0.5)


def _blocks(
    batch: Batch, at_rest: NDArray[np.bool_], confined: bool, disturbed: bool, varying: Sequence[str]
) -> tuple[Block, ...]:
    runs, limits = len(at_rest), batch.dof.limits
    ones = np.ones((runs, 1))
    lasts = batch.window.max(axis=1, initial=0, where=batch.length > 0)
    windows = (np.arange(batch.windows if disturbed else 0) <= lasts[:, None]).astype(float)
    switches = (batch.interval > 0).astype(float) if confined else batch.interval / np.sqrt(12.0)
    largest = float(np.abs(batch.force).max()) or 1.0
    starts = (1e-4, 1.0) if np.count_nonzero(~at_rest) > 1 else None  # else a law that forgets how runs began gains
    return (
        Block(START_POSITION, limits.position_sd * ones),
        Block(START_VELOCITY, np.where(at_rest[:, None], 0.0, limits.velocity_sd), starts),
        Block(GAIN, ones, (1e-4, 0.3)),
        Block(SWITCHES, switches, (1e-3, 1.0)),
        Block(DISTURBANCE, windows, (1e-5, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in batch.channels if c.velocity),
        *(Block(name, largest * np.ones((runs, effects.get(name).per_run)), (1e-4, 1.0)) for name in varying),
    )


def varying_terms(model: Model) -> list[str]:
    """Names of the model's effects of which every run has coefficients of its own."""
    return [term.name for term in model.terms if effects.get(term.name).varies(term.values)]


def swing_rate(time: Floats, position: Floats) -> float:
    """Give the circular frequency [rad/s] of the largest peak of a position's spectrum, at least a swing a run."""
    even = np.linspace(time[0], time[-1], len(time))
    swing = np.interp(even, time, position)
    power = np.abs(np.fft.rfft(swing - np.median(swing), PADDED * len(even)))
    peak = float(np.argmax(power)) / (PADDED * len(even) * (even[1] - even[0]))
    return 2.0 * np.pi * max(peak, 1.0 / float(even[-1] - even[0]))


PADDED = 8  # times the length of a run to which its spectrum is padded
SWING_WINDOWS = 8.0  # in a swing, over which its momentum is balanced
ROUGH_DAMPING = 0.02  # damping ratio of a swing, for which the balance gives none


def rough_model(number: str, batch: Batch, sided: bool = False, inertia: float = 1.0) -> Model:
    """Start values for model "1", "2" or "3": least squares of the momentum balance over windows of about a
    second, or parts of a swing.

    I (r2 - r1) + k_rr ∫|r|r dt + k_r ∫r dt = ∫tau dt (and a constant force times t, if there is one, less G ∫sin phi
    dt where weight and buoyancy turn the vehicle back), with rates from differences of the heading over the same
    windows. Where no moment acts, all of it is over the `inertia`, which is taken to be that. Raises FitError where
    inertia and drag come out negative and the balance holds well enough to be sure: then a sign is wrong.
    """
    rows, sides, rates, dof = [], [], [], batch.dof
    for i in range(len(batch.names)):
        observed = batch.seen[i]
        time, position = batch.time[i][observed], batch.position[i][observed]
        clock = np.concatenate([[0.0], np.cumsum(batch.length[i])])
        impulse = np.concatenate([[0.0], np.cumsum(batch.length[i] * batch.force[0, i])])
        window = max(time[-1] / 200.0, min(1.0, time[-1] / 8.0))
        if dof.restoring:
            rates.append(swing_rate(time, position))
            window = max(2.0 * np.pi / (SWING_WINDOWS * rates[-1]), 2.0 * float(np.median(np.diff(time))))
        knots = np.arange(time[0], time[-1], window)
        way = np.interp(knots, time, position)
        rate = np.diff(way) / window
        middle = 0.5 * (knots[1:] + knots[:-1])
        swing = np.diff(rate)
        push = np.diff(np.interp(middle, clock, impulse))
        mean = 0.5 * (rate[1:] + rate[:-1])
        turned = window * np.sin(way[1:-1]) if dof.restoring else 0.0 * mean
        on, always = window * np.abs(mean) * mean, np.full(len(mean), -window)
        rows.append(np.stack([swing, on, window * mean, always, turned], axis=1))
        sides.append(push)
    x, y = np.concatenate(rows), np.concatenate(sides)
    of_base = {"1": [0, 2], "2": [0, 1, 2], "3": [0, 1]}[number]
    keep = [*of_base, *([3] if dof.biased else []), *([4] if dof.restoring else [])]
    if not np.any(batch.force):
        return _rough_decay(number, batch, x[:, keep], rates, inertia, sided)
    values = np.linalg.lstsq(x[:, keep], y, rcond=None)[0] if len(y) >= len(keep) else np.ones(len(keep))
    misfit = np.sum((y - x[:, keep] @ values) ** 2)
    values, constant = values[: len(of_base)], values[len(of_base) :].tolist()
    if np.all(values < 0) and misfit < (1.0 - AGAINST) * np.sum(y**2):
        says = (
            "the {positions} {move} against the {force}: {inertia} and drag would be negative. If the {position} "
            "counts {other_way}, or the {force} does"
        )
        column = batch.dof.column(batch.dof.position, batch.dof.units.log)
        raise FitError(
            f"{batch.dof.fill(says)}, map it with sign = -1 in the --columns file or the campaign: under [columns] "
            f'{column} = {{ from = "NAME", sign = -1 }}'
        )
    scale = float(np.abs(batch.force).max()) or 1.0
    values = np.where(values > 1e-3 * scale, values, 0.3 * scale)
    if dof.restoring:
        constant[1] = constant[1] if constant[1] > 0.0 else values[0] * float(np.median(rates)) ** 2
    asymmetry = [0.0] if sided else []
    return Model.base(number, values[0], [*values[1:], *constant, *asymmetry], batch.moment_unit, batch.dof)


def _rough_decay(number: str, batch: Batch, x: Floats, rates: Sequence[float], inertia: float, sided: bool) -> Model:
    """The same from the columns `x` of the balance of free decays, those that swing at the `rates` [rad/s]."""
    values = np.linalg.lstsq(x[:, 1:], -x[:, 0], rcond=None)[0]
    rate = float(np.median(rates or [1.0]))
    usual = [2.0 * ROUGH_DAMPING * rate, ROUGH_DAMPING]  # linear drag, quadratic drag
    least = usual[:1] if number == "1" else usual[::-1][: 1 + (number == "2")]
    drag = [value if value > small else small for value, small in zip(values, least)]
    remaining = [*values[len(drag) : len(drag) + batch.dof.biased], *([rate**2] if rates else [])]
    asymmetry = [0.0] if sided else []
    return Model.base(
        number, inertia, inertia * np.array([*drag, *remaining, *asymmetry]), batch.moment_unit, batch.dof
    )


MAX_P_WAYS = 0.05  # p-value below which the two ways are told apart


@dataclass(frozen=True)
class Ways:
    """The drag of each way (`role`, linear or quadratic, is what differs), the ratio of inertia to quadratic drag of
    each [m] where the model has one, and the test of their difference."""

    dof: Dof
    role: str
    drag: Mapping[str, Estimate]
    distance: Mapping[str, Estimate]
    p_value: float

    @property
    def differ(self) -> bool:
        return self.p_value < MAX_P_WAYS

    def to_json(self) -> dict[str, object]:
        entries = {way: {self.dof.parameters[self.role]: estimate.to_json()} for way, estimate in self.drag.items()}
        for way, estimate in self.distance.items():
            entries[way][self.dof.ratio_key] = estimate.to_json()
        return {"differ": self.differ, "p_value": self.p_value, **entries}


def fit_by_direction(fit: "Callable[[bool], OutputErrorFit]", dof: Dof, two_way: bool) -> "OutputErrorFit":
    """The fit with drag by way where that differs, else pooled; `fit` takes which, `two_way` whether both were gone."""
    if not (dof.directional and two_way):
        return fit(False)
    try:
        apart = fit(True)
    except FitError:  # a model that is far off may run away with one way more than with both together
        return fit(False)
    ways = directional_drag(apart)
    return replace(apart if ways.differ else fit(False), ways=ways)


def directional_drag(fit: "OutputErrorFit") -> Ways:
    """The drag of each way, and the test, from a fit of both: theta holds their middle and half their difference."""
    dof, names, role = fit.model.dof, list(fit.estimates), main_drag(fit.number)
    symbols = dof.symbols
    main = dof.parameters[role]
    i, j, of_inertia = (names.index(name) for name in (main, symbols.difference, symbols.inertia))
    middle, half, covariance = fit.estimates[main].value, fit.estimates[symbols.difference].value, fit.covariance
    runs, axes = len(fit.mixed.left_out), np.eye(len(fit.mixed.theta))
    scale = middle if fit.mixed.parameters.log[i] else 1.0

    def freedom(direction: np.ndarray) -> float:
        return degrees_of_freedom(fit.mixed, direction) if runs > 2 else 1.0

    drag, distance = {}, {}
    for way, sign in zip(dof.words.ways, (1.0, -1.0)):
        value, slope = middle + sign * half, scale * axes[i] + sign * axes[j]
        size = max(value, 1e-3 * middle, 1e-300)
        deviation = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        drag[way] = Estimate.from_log(value, deviation / size, freedom(slope), fit.estimates[main].unit)
        if role == "quadratic" and value > 1e-3 * middle:  # drag that is nothing one way has no ratio
            ratio, inertia = axes[of_inertia] - slope / size, fit.estimates[symbols.inertia].value
            spread = float(np.sqrt(max(ratio @ covariance @ ratio, 0.0)))
            distance[way] = Estimate.from_log(inertia / size, spread, freedom(ratio), dof.unit_of("ratio"))
    error = float(np.sqrt(max(covariance[j, j], 1e-300)))
    return Ways(dof, role, drag, distance, float(2.0 * special.stdtr(freedom(axes[j]), -abs(half) / error)))


MIN_JACKKNIFE_RUNS, ENOUGH_RUNS = 8, 16
MIN_JACKKNIFE_DOF = 3.0
"""From ENOUGH_RUNS on standard errors are the jackknife's alone; with fewer they are at least the likelihood's, for the
spread of ten runs is now and then far too small. With less than MIN_JACKKNIFE_RUNS, or so few degrees of freedom, the
likelihood tells what goes together: a run that shows a parameter alone leaves nothing to resample."""

MAX_GROWTH = 1e6  # of a standard error by leaving runs out; beyond it the runs say nothing at all


@dataclass(frozen=True)
class OutputErrorFit:
    """One model, with its values, fitted to positions by maximum likelihood, or by the share `to_forecasts` of the way
    from there to least squares of forecasts.

    `covariance` (p, p) is that of phi with the run as the unit, `scatters` says whether the thrust may from run to run;
    `ways` the drag of each way where that was asked. `estimator` says by what the parameters of driven runs were
    estimated and why, `proposed` what the evidence would add (the deviance gained, by effect).
    """

    number: str
    model: Model
    mixed: Fit
    covariance: Floats
    scatters: bool = True
    ways: Ways | None = None
    estimator: str = ""
    to_forecasts: float = 0.0
    proposed: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def delay(self) -> Estimate:
        """Of the command [s], after the middle of the sample interval in which it changed."""
        return estimate_of(self.mixed, self.covariance, self.mixed.names.index(COMMAND_DELAY))

    @property
    def answering(self) -> Model:
        """The model with its command delay, as it answers commands."""
        return self.model.delayed(self.delay.value)

    @property
    def roles(self) -> tuple[str, ...]:
        """What the parameters of the motion's own equation are (see `Dof.parameters`)."""
        return ("inertia", *(effects.get(term.name).role for term in self.model.terms if term.base))

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Inertia, drag and constant force by their letters."""
        letters = self.model.dof.parameters
        return {letters[role]: estimate_of(self.mixed, self.covariance, self._place(role)) for role in self.roles}

    @cached_property
    def by_name(self) -> dict[str, Estimate]:
        """Every parameter of the model that was estimated or follows one, by qualified name."""
        estimates, parameters, fixed = dict[str, Estimate](), self.mixed.parameters, set(self.model.fixed)
        for term in self.model.terms:  # laws of effects and what only others use
            fixed |= {name for name, stays in zip(self.model.names_of(term), term.effect.held(term.values)) if stays}
        for i, parameter in enumerate(parameters[parameters.of_model]):
            if parameter.tie is not None:
                source, factor = parameter.tie
                of = estimate_of(self.mixed, self.covariance, parameters.names.index(source))
                estimates[parameter.name] = of.scaled(factor, parameter.unit)
            elif parameter.name not in fixed:
                estimates[parameter.name] = estimate_of(self.mixed, self.covariance, i)
        return estimates

    @cached_property
    def inertial_turn_angle(self) -> Estimate | None:
        """Inertia over quadratic drag [base unit]; None of a model without that, or where it stands at a bound."""
        if "quadratic" not in self.roles:
            return None
        i, k, mixed = self._place("inertia"), self._place("quadratic"), self.mixed
        if mixed.theta[k] <= 0 or (k in mixed.at_bound and mixed.names[k] not in mixed.parameters.priors):
            return None
        return ratio_of(mixed, self.covariance, i, k, self.model.dof.unit_of("ratio"))

    @cached_property
    def gain_scatter(self) -> Estimate:
        """By how much the thrust scatters from run to run, relative."""
        mixed, name = self.mixed, "gain-scatter"
        size, (low, high) = (mixed.factor(GAIN), mixed.factor_interval(GAIN)) if self.scatters else (0.0, (0.0, 0.0))
        bound = name in mixed.names and mixed.names.index(name) in mixed.at_bound
        return Estimate(size, (high - low) / 3.92, (low, high), "1", at_bound=bound)

    @property
    def noise(self) -> float | None:
        """Of the positions [base unit]; None where they do not count."""
        return self.mixed.noise_of.get(self.model.dof.position)

    def _place(self, role: str) -> int:
        return self.mixed.names.index(self.model.dof.parameter(role))


FIRST_WAYS = 3.0  # times the beginning of a step, over which the first speed of a run is taken
START_SCATTERS = {START_VELOCITY: 1.0, GAIN: 0.01, SWITCHES: 0.5, DISTURBANCE: 0.03}  # from which fits begin


def fit_whole_runs(
    batch: Batch, number: str, at_rest: NDArray[np.bool_], sided: bool = False, priors: Priors = NOTHING_KNOWN
) -> OutputErrorFit:
    """Fit one model to whole runs by simulation: first without a random gain, then with it from there.

    One driven run alone cannot tell its gain from the vehicle's, and free decays have none. Raises FitError where no
    start leads anywhere.
    """
    alone = np.count_nonzero(np.any(batch.force[0] != 0.0, axis=1)) <= 1
    prior_inertia = priors.get(batch.dof.parameter("inertia"))
    rough = rough_model(number, batch, sided, prior_inertia.value if prior_inertia else 1.0)
    parameters = rough.parameters(log_drag=True, signed_drag=True)
    problem = whole_run_problem(rough, parameters, batch, at_rest).informed(priors)
    pooled = replace(problem, effects=problem.effects.without(GAIN))
    factors = np.array([START_SCATTERS[name] for name in problem.effects.factor_names])
    begin, moving = np.append(rough.theta, 0.0), _first_speeds(batch, problem.effects)
    if alone:
        only = fit_mixed(pooled, begin, noise=0.05, factors=factors, run_effects=moving)
        return result_of(number, rough, only, scatters=False)
    first = fit_mixed(pooled, begin, noise=0.05, factors=factors, run_effects=moving, iterations=20, settled=0.05)
    little = 0.2 if priors else 0.02  # what is known may ask for other thrusts than the logs tell
    best = fit_mixed(
        problem,
        first.theta,
        noise=first.noises,
        factors=np.array([little if name == GAIN else first.factor(name) for name in first.effects.factor_names]),
        run_effects=first.run_effects,
    )
    return result_of(number, rough, best)


def _first_speeds(batch: Batch, blocks: RunEffects) -> Floats:
    """Run effects from which a fit starts, (R, q): runs without a command move at first, or drag would do nothing."""
    effects = np.zeros_like(blocks.scale)
    for i in np.flatnonzero(~np.any(batch.force[0] != 0.0, axis=1)) if not batch.dof.restoring else ():
        observed = batch.seen[i]
        way = FIRST_WAYS * batch.dof.limits.start
        speed, _ = start_motion(batch.time[i][observed], batch.position[i][observed], 0.0, way)
        blocks.of(effects, START_VELOCITY)[i] = speed
    return effects


def run_covariance(mixed: Fit, changes: Floats | None = None) -> Floats:
    """Covariance of phi with the run as the unit (see MIN_JACKKNIFE_RUNS), (p, p).

    Given the `changes` (R, p) of `left_out_changes`, it is exact where instants are confined to their sample intervals;
    without, it is the linearised jackknife, which is too wide there.
    """
    if len(mixed.left_out) < 2:
        return mixed.covariance
    by_runs = jackknife(mixed.left_out if changes is None else changes) + mixed.error_of_known
    few = np.array([_few_carry(mixed, axis) for axis in np.eye(len(mixed.phi))])
    likely, between = (np.sqrt(np.maximum(np.diagonal(c), 0.0)) for c in (mixed.inside_bounds, by_runs))
    if not few[mixed.parameters.of_model].any():
        ratio = np.divide(likely, between, out=np.ones_like(between), where=between > 0)
        grow = np.clip(ratio, 1.0, MAX_GROWTH if len(mixed.left_out) < ENOUGH_RUNS else 1.0)
        return by_runs * np.outer(grow, grow) + mixed.of_bounds
    ratio = np.divide(between, likely, out=np.ones_like(between), where=likely > 0)  # none at a bound
    grow = np.clip(ratio, few.astype(float), MAX_GROWTH)
    return mixed.inside_bounds * np.outer(grow, grow) + mixed.of_bounds


def _few_carry(mixed: Fit, direction: Floats) -> bool:
    """Whether too few runs show what lies along `direction` (p,) of phi for their spread to tell its error."""
    return len(mixed.left_out) < MIN_JACKKNIFE_RUNS or degrees_of_freedom(mixed, direction) < MIN_JACKKNIFE_DOF


def run_dof(mixed: Fit, direction: Floats) -> float:
    """Degrees of freedom of the variance along `direction` (p,) of phi that `run_covariance` tells; of one run its
    readings less its parameters. Few runs that scatter by no more than forecasts within them explain (below the median
    of F, so that the test rather errs to their side) have those of the forecasts."""
    runs = len(mixed.left_out)
    if runs == 1:
        return float(sum(mixed.readings.values()) - len(mixed.theta))
    if not _few_carry(mixed, direction):
        return degrees_of_freedom(mixed, direction)
    of_model = not direction[mixed.parameters.of_model.stop :].any()
    within = mixed.forecasts if isinstance(mixed, InnovationsFit) and of_model else 0.0
    if within > runs - 1:
        of_runs, likely = (direction @ c @ direction for c in (jackknife(mixed.left_out), mixed.inside_bounds))
        if of_runs <= likely * special.fdtri(runs - 1, within, 0.5):
            return within
    return float(runs - 1)


def covariance_json(
    names: Sequence[str], theta: Floats, positive: NDArray[np.bool_], covariance: Floats
) -> dict[str, object] | None:
    """Covariance of the first parameters of theta (p,), named, from that of phi (p, p), in which positive ones are
    logarithms; in the products of the parameters' units. None where it is not finite."""
    count = len(names)
    scale = np.where(positive, theta, 1.0)[:count]
    matrix = covariance[:count, :count] * np.outer(scale, scale)
    return {"parameters": list(names), "matrix": matrix.tolist()} if np.all(np.isfinite(matrix)) else None


def estimate_of(mixed: Fit, covariance: Floats, i: int) -> Estimate:
    """One parameter; the interval of a positive one is formed on its logarithm."""
    stderr = float(np.sqrt(max(covariance[i, i], 0.0)))
    form = Estimate.from_log if mixed.parameters.log[i] else Estimate.from_stderr
    dof, unit = run_dof(mixed, np.eye(len(mixed.theta))[i]), mixed.parameters[i].unit
    estimate = form(float(mixed.theta[i]), stderr, dof, unit)
    assumed = mixed.names[i] in mixed.parameters.priors
    if not (at_bound := i in mixed.at_bound and not assumed):
        return replace(estimate, known=assumed)
    low, high = np.clip(estimate.ci95, *mixed.parameters.bounds[i]) + 0.0  # no negative zero
    return replace(estimate, ci95=(float(low), float(high)), at_bound=at_bound)


def ratio_of(mixed: Fit, covariance: Floats, i: int, k: int, unit: str, dof: float | None = None) -> Estimate:
    """Parameter i over parameter k, each searched on its logarithm or not; `dof` is that of `run_dof` if None."""
    axes = np.eye(len(mixed.theta))
    of_i, of_k = (axes[j] if mixed.parameters.log[j] else axes[j] / mixed.theta[j] for j in (i, k))
    direction = of_i - of_k
    stderr = float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))
    return Estimate.from_log(mixed.theta[i] / mixed.theta[k], stderr, dof or run_dof(mixed, direction), unit)


def result_of(number: str, model: Model, mixed: Fit, scatters: bool = True) -> OutputErrorFit:
    """Give the result of a fit of `model`; `scatters` is false where the runs' gains are known not to differ."""
    return OutputErrorFit(number, model.with_theta(mixed.of_model), mixed, run_covariance(mixed), scatters)
