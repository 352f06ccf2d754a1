"""Step runs, whole or trimmed to their first half-turn: their likelihood by the closed-form response of models 1 to 3,
and their default estimate.

    y_ij = psi0_i + G(t_ij - t_mid,i - d - s_i; I, k_r, k_rr, tau_i exp(u_i)) + noise
    psi0_i flat,  u_i ~ N(0, g²),  s_i ~ N(0, f² h_i²/12)

t_mid,i is the middle of the sample interval h_i in which the command switched, d the command delay [s], one for all
runs; s_i is where in its interval the switch of run i was, u_i the logarithm of its gain. The scatters g and f are
estimated by restricted likelihood (see mixed_model.py).

The estimate is that of whole steps with a command delay, or of their first half-turns where the rest disagrees. Whole
steps tell three times as much of the drag as first half-turns, as long as nothing comes later that the model lacks:
water that turns with the vehicle, a tether, a compass that deviates. Both parts are fitted, and tests on them decide
which one answers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.dofs import Dof
from automarine_cli.fits.linear_mixed import GAIN, START_POSITION, SWITCHES, Block, RunEffects, bias_of
from automarine_cli.fits.mixed_model import MixedFit, Problem, derivatives, fit_mixed, jackknife, slots_of
from automarine_cli.fits.preference import Preference, prefer
from automarine_cli.fits.whole_runs import OutputErrorFit, fit_by_direction, result_of
from automarine_cli.models.model import COMMAND_DELAY, MAX_DELAY_S, Model, base_roles, main_drag, response_slopes
from automarine_cli.models.parameter import NOTHING_KNOWN, NUISANCE, Parameter, Parameters, Priors
from automarine_cli.pipeline.parallel import Each
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MAX_REST_SAMPLES, HalfTurn
from automarine_cli.simulation.batch import Channel, padded


@dataclass(frozen=True)
class StepData:
    """R steps padded to N samples, rest before the step included.

    `time` (R, N) [s] since the middle of the interval in which the command switched, `observed` (R, N), `moment` (R,)
    [`unit`], `interval` (R,) [s] width of the interval of the switch. `channels` are the readings that are fitted,
    first the position [rad or m] less the start position's first guess.
    """

    names: tuple[str, ...]
    time: Floats
    observed: NDArray[np.bool_]
    moment: Floats
    interval: Floats
    dof: Dof
    unit: str
    channels: tuple[Channel, ...]

    @property
    def heading(self) -> Floats:
        """Positions (R, N), zero in the padding."""
        return self.channels[0].values

    @property
    def half_interval(self) -> float:
        """Half the usual sample interval [s]: what a command delay may be by the logger's convention alone."""
        return 0.5 * float(np.median(self.interval))

    def some(self, runs: NDArray[np.int64]) -> "StepData":
        """The same of some of the runs."""
        rows = {name: getattr(self, name)[runs] for name in ("time", "observed", "moment", "interval")}
        channels = tuple(replace(c, values=c.values[runs], seen=c.seen[runs]) for c in self.channels)
        return replace(self, names=tuple(self.names[i] for i in runs), channels=channels, **rows)


def data_of_steps(turns: Sequence[HalfTurn], channels: Sequence[str] | None = None, *, whole: bool = False) -> StepData:
    """Lay steps out with the rest before them, of the `channels` named (None: the position alone): their first
    half-turns, or `whole` ones, until the command changes.

    The command of a log that begins with the moment already on is taken to have switched at its first sample, any
    other in the middle of the interval in which it did. Along a line a step ends where its trim ends. Of runs whose
    position does not count it stands in for a sensor that their logs lack.
    """
    dof, columns = turns[0].step.run.dof, list[list[Floats]]()
    for turn in turns:
        run, step = turn.step.run, turn.step
        before = step.rest or slice(step.first, step.first)
        zero = step.switch_to if step.begins_log else step.switch_mid
        fitted = slice(step.first, step.stop) if whole and dof.wraps else turn.kept
        parts = slice(max(before.start, before.stop - MAX_REST_SAMPLES), before.stop), fitted
        velocity = run.channel(dof.velocity)
        velocity = np.full(len(run), np.nan) if velocity is None else velocity
        of_run = run.time - zero, run.position - turn.start_position, velocity
        columns.append([np.concatenate([column[part] for part in parts]) for column in of_run])
    times, headings, velocities = zip(*columns)
    intervals = [turn.step.switch_to - turn.step.switch_from for turn in turns]
    names, moments, unit = [turn.name for turn in turns], [turn.moment for turn in turns], turns[0].step.run.moment_unit
    data = step_data(names, times, headings, moments, intervals, dof, unit)
    if channels is None or dof.velocity not in channels:
        return data
    counts = np.array([dof.position in channels and not turn.step.run.summed_up for turn in turns])
    (position,), width = data.channels, data.time.shape[1]
    seen = position.seen & counts[:, None] if counts.any() else position.seen
    rates, finite = ([form(velocity) for velocity in velocities] for form in (np.nan_to_num, np.isfinite))
    rate = Channel(dof.velocity, 0, True, padded(rates, width), padded(finite, width))
    return replace(data, channels=(replace(position, seen=seen, counts=bool(counts.any())), rate))


def step_data(
    names: Sequence[str], times: Sequence[Floats], headings: Sequence[Floats], moments: Sequence[float],
    intervals: Sequence[float], dof: Dof, unit: str = "nu",
) -> StepData:  # fmt: skip
    """Pad runs, given as time since the middle of the switch interval [s] and heading less start heading [rad]."""
    width = max(map(len, times))
    observed = padded([np.ones(len(time), dtype=bool) for time in times], width)
    position = Channel(dof.position, 0, False, padded(headings, width), observed)
    moment, interval = np.array(moments, dtype=float), np.array(intervals, dtype=float)
    return StepData(tuple(names), padded(times, width), observed, moment, interval, dof, unit, (position,))


MIN_SHARE = 0.01  # of the drag that is left one way, however much it differs: none would drive the vehicle


def step_problem(
    data: StepData, model: str, priors: Priors = NOTHING_KNOWN, sided: bool = False,
    delays: tuple[float, float] | None = None,
) -> Problem:  # fmt: skip
    """Likelihood of the steps under model "1", "2" or "3"; `sided` with a drag that differs between the ways.

    theta is (the parameters of `base_roles`, the command delay [s] within `delays`, by default from half a sample
    interval before the middle of the one in which the command switched to MAX_DELAY_S after it). Run effects are start
    position, log gain of the moment, where in its interval the run's command switched [s], and the bias of a velocity
    sensor.
    """
    roles, main = base_roles(model, data.dof, sided), main_drag(model)
    start = Model.base(model, 1.0, np.ones(len(roles) - 1), data.unit, data.dof)
    entries = start.parameters(log_drag=True, signed_drag=True)
    ones, limits = np.ones((len(data.moment), 1)), data.dof.limits
    blocks = RunEffects((
        Block(START_POSITION, limits.position_sd * ones),
        Block(GAIN, ones, (1e-4, 1.0)),
        Block(SWITCHES, data.interval[:, None] / np.sqrt(12.0), (1e-3, 1.0)),
        *(Block(bias_of(c.quantity), limits.bias_sd * ones) for c in data.channels if c.velocity),
    ))  # fmt: skip
    moment, searched = data.moment[:, None], (*roles, COMMAND_DELAY)

    def slopes(theta: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
        value, delay = dict(zip(roles, theta)), theta[-1]
        gained = moment * np.exp(blocks.of(b, GAIN))
        force = gained + value.get("constant", 0.0)
        drag = {role: np.full_like(force, value.get(role, 0.0)) for role in ("linear", "quadratic")}
        aside = np.sign(force) * value.get("difference", 0.0)
        inside = aside > (MIN_SHARE - 1.0) * drag[main]
        drag[main] = np.where(inside, drag[main] + aside, MIN_SHARE * drag[main])
        time = data.time - delay - blocks.of(b, SWITCHES)
        answers = response_slopes(time, force, value["inertia"], drag["linear"], drag["quadratic"])
        none, rows = np.zeros_like(data.time), []
        for channel in data.channels:
            of = answers[channel.velocity]
            share = {"linear": none + 1.0, "quadratic": none + 1.0, main: np.where(inside, 1.0, MIN_SHARE)}
            by = {
                "inertia": of.log_inertia / value["inertia"],
                "linear": of.linear * share["linear"],
                "quadratic": of.quadratic * share["quadratic"],
                "constant": of.log_force / force,
                "difference": getattr(of, main) * np.sign(force) * inside,
                COMMAND_DELAY: -of.time,
                GAIN: of.log_force * gained / force,
                SWITCHES: -of.time,
                bias_of(channel.quantity) if channel.velocity else START_POSITION: none + 1.0,
            }
            own = blocks.of(b, bias_of(channel.quantity) if channel.velocity else START_POSITION)
            columns = [np.stack([by.get(name, none) for name in part], axis=2) for part in (searched, blocks.names)]
            rows.append((of.value + own, *columns))
        readings, by_theta, by_run = (np.concatenate(part, axis=1) for part in zip(*rows))
        return readings, by_theta, by_run

    def response(theta: Floats, b: Floats) -> Floats:
        return np.stack([slopes(values, effects)[0] for values, effects in zip(theta, b)])

    measured, observed = (np.concatenate(part, axis=1) for part in zip(*((c.values, c.seen) for c in data.channels)))
    earliest, latest = delays or (-data.half_interval, MAX_DELAY_S)
    parameters = Parameters((*entries, Parameter(COMMAND_DELAY, 0.0, earliest, latest, role=NUISANCE, unit="s")))
    return Problem(
        response, measured, observed, blocks, parameters.informed(priors), slots_of(data.channels), slopes=slopes
    )


MIN_P_PARAMETERS, MIN_P_BENDS = 0.0005, 0.0005
"""p-values of two tests below which whole steps are given up. A half-turn's drag is so uncertain, and a rejection picks
its tail so surely, that they have to be tiny."""
MIN_P_PUSH = 0.001  # p-value of a push that grows below which whole steps are freed of it
FADING_S = 5.0  # time in which thrust that fades under load does so: between those of batteries and of motors
MAX_NOISE_RATIO, MAX_COLOUR = 1.06, 0.3
"""Noise of whole steps over that of half-turns; 1.04 was the largest of 720 sound campaigns. Where neighbouring
readings of half-turns are correlated by more than the second, shorter parts have less noise by themselves."""
MIN_DELAY_STDERRS = 4.0  # by which half-turns of disturbed runs have to show a delay before they may have one
MIN_RUNS_TESTED = 6  # from which on the scatter over runs serves for the tests
MAX_STARTING_RUNS = 200  # that a fit to many begins with: it is so near that a step or two on all runs end it
START_NOISE, START_FACTORS = 0.02, (0.03, 0.5)  # of a fit: noise [base unit], scatter of the gain, share of the jitter


STIRRED, FADING = "stirred", "fading"


@dataclass(frozen=True)
class Consistency:
    """Tests of whole steps against their first half-turns, each with the run as the unit.

    `p_parameters` is that of the difference of inertia and drags (Hausman 1978, Econometrica 46:1251), `p_bends` of
    bends of the heading beyond half a turn, `p_push` of pushes that grow along a step: STIRRED in proportion to how
    long and far the vehicle has turned, as by water that turns with it, FADING with the load, as thrust that sags.
    `noise_ratio` is the noise of whole steps over that of half-turns, `colour` the correlation of neighbouring readings
    in the noise of half-turns.
    """

    p_parameters: float
    p_bends: float
    p_push: Mapping[str, float]
    noise_ratio: float
    colour: float

    @property
    def agrees(self) -> bool:
        """Whether whole steps carry the answer, if need be freed of a push."""
        return self.p_parameters >= MIN_P_PARAMETERS and self.p_bends >= MIN_P_BENDS and not self.noisier

    @property
    def noisier(self) -> bool:
        """Whether whole steps leave more noise than half-turns do."""
        return self.noise_ratio > MAX_NOISE_RATIO and self.colour <= MAX_COLOUR

    @property
    def push(self) -> str:
        """The push of which whole steps have to be freed; empty for none."""
        name = min(self.p_push, key=lambda push: self.p_push[push], default="")
        return name if self.agrees and name and self.p_push[name] < MIN_P_PUSH else ""

    def to_json(self) -> dict[str, object]:
        pushes = {f"p_{name}": p for name, p in self.p_push.items()}
        tests = {"p_parameters": self.p_parameters, "p_bends": self.p_bends, **pushes}
        noise = {"noise_ratio": self.noise_ratio, "noise_correlation": self.colour}
        return {"agrees": self.agrees, "freed_of": self.push or None, **tests, **noise}


@dataclass(frozen=True)
class StepAnswer:
    """Fits by model to `data`, the model preferred, and the tests, None where there was nothing to compare."""

    fits: Mapping[str, OutputErrorFit]
    preference: Preference
    data: StepData
    consistency: Consistency | None


Start = Mapping[str, float]
"""Values by role to begin from; the command delay under its own name."""


def fit_whole_or_half(
    whole: StepData, half: StepData, starts: Mapping[str, Start], priors: Priors, two_way: bool, map_jobs: Each
) -> StepAnswer:
    """Fit whole steps, and take first half-turns in their place where the rest of the steps disagrees with them.

    `starts` gives values to begin from by model, `two_way` says whether both ways were gone. Where both data are the
    same, as along a line, there is nothing to compare. Raises FitError where the data cannot carry a fit.
    """
    fit = partial(fit_step_model, priors=priors, two_way=two_way)
    fits = dict(zip(starts, map_jobs(partial(fit, data=whole, starts=starts), [*starts], "fitting models")))
    preference = prefer(fits)
    if np.array_equal(whole.observed.sum(axis=1), half.observed.sum(axis=1)):
        return StepAnswer(fits, preference, whole, None)
    best = fits[preference.number]
    rival = fit(best.number, data=half, starts={best.number: values_of(best)})
    assert not best.mixed.driven and not rival.mixed.driven
    problem = step_problem(whole, best.number, priors, "difference" in best.roles)
    tests = compare(whole, problem, best.mixed, half, rival.mixed)
    if tests.push:
        fits = {model: freed_of(tests.push, whole, fit, priors) for model, fit in fits.items()}
    if tests.agrees:
        return StepAnswer(fits, preference, whole, tests)
    from_whole = {model: values_of(fit) for model, fit in fits.items()}
    return fit_halves(half, from_whole, priors, two_way, map_jobs, tests)


def fit_halves(
    half: StepData, starts: Mapping[str, Start], priors: Priors, two_way: bool, map_jobs: Each,
    tests: Consistency | None = None,
) -> StepAnswer:  # fmt: skip
    """Fit first half-turns, with a command delay only where they show one beyond doubt."""
    fit = partial(fit_step_model, data=half, starts=starts, priors=priors, two_way=two_way, doubtful=True)
    fits = dict(zip(starts, map_jobs(fit, [*starts], "fitting models")))
    return StepAnswer(fits, prefer(fits), half, tests)


def values_of(fit: OutputErrorFit) -> Start:
    """Values of a fit by role, with its command delay."""
    return {**dict(zip(fit.roles, fit.mixed.of_model)), COMMAND_DELAY: fit.delay.value}


def fit_step_model(
    model: str, data: StepData, starts: Mapping[str, Start], *, priors: Priors, two_way: bool,
    doubtful: bool = False,
) -> OutputErrorFit:  # fmt: skip
    def fit(sided: bool) -> OutputErrorFit:
        mixed = fit_causal(data, model, starts[model], priors, sided)
        if doubtful:
            mixed = without_doubtful_delay(data, model, mixed, priors, sided)
        inertia, *drags = mixed.of_model
        return result_of(model, Model.base(model, inertia, drags, data.unit, data.dof), mixed)

    return fit_by_direction(fit, data.dof, two_way)


def fit_causal(data: StepData, model: str, start: Start, priors: Priors, sided: bool = False) -> MixedFit:
    """Fit one model to steps with a command delay that causality allows.

    Where switches are spread over a share f of their intervals, their mean is no earlier than (1 - f)/2 before the
    middle of the interval: f = 1 where the command runs apart from the logger, 0 where both share a clock.
    """
    theta = np.array([*(start.get(role, 0.0) for role in base_roles(model, data.dof, sided)), start[COMMAND_DELAY]])
    factors = np.array(START_FACTORS)
    fit = fit_mixed(step_problem(starting(data), model, priors, sided), theta, noise=START_NOISE, factors=factors)
    if len(data.moment) > MAX_STARTING_RUNS:
        fit = fit_mixed(step_problem(data, model, priors, sided), fit.theta, noise=fit.noises, factors=fit.factors)
    earliest = -_convention(data, fit)
    if fit.value(COMMAND_DELAY) >= earliest - 1e-9 * data.half_interval or COMMAND_DELAY in priors:
        return fit
    return _again(step_problem(data, model, priors, sided, (earliest, MAX_DELAY_S)), fit)


def starting(data: StepData) -> StepData:
    """Give the runs with which a fit begins: all, or some that are spread over many."""
    runs = len(data.moment)
    return data if runs <= MAX_STARTING_RUNS else data.some(np.linspace(0, runs - 1, MAX_STARTING_RUNS).astype(int))


def without_doubtful_delay(data: StepData, model: str, fit: MixedFit, priors: Priors, sided: bool = False) -> MixedFit:
    """Give the fit with a delay within the logger's convention, unless it shows a longer one beyond doubt."""
    latest, delay, place = _convention(data, fit), fit.value(COMMAND_DELAY), fit.names.index(COMMAND_DELAY)
    doubt = MIN_DELAY_STDERRS * float(np.sqrt(fit.covariance[place, place]))
    if delay <= latest + 1e-9 or delay - latest > doubt or COMMAND_DELAY in priors:
        return fit
    return _again(step_problem(data, model, priors, sided, (-latest, latest)), fit)


def _convention(data: StepData, fit: MixedFit) -> float:
    """Half of the share of the sample interval in which no switch is [s]."""
    return data.half_interval * (1.0 - min(fit.factor(SWITCHES), 1.0))


def _again(problem: Problem, fit: MixedFit) -> MixedFit:
    theta = np.clip(fit.theta, *problem.parameters.bounds.T)
    return fit_mixed(problem, theta, noise=fit.noises, factors=fit.factors, run_effects=fit.run_effects)


def compare(whole: StepData, problem: Problem, fit: MixedFit, half: StepData, rival: MixedFit) -> Consistency:
    """Test whole steps, and the fit of their problem, against the fit of the same model to their first half-turns."""
    turned, way = _turned(whole, problem, fit), np.sign(whole.moment)[:, None]
    beyond, p_bends, p_push = np.maximum(np.abs(turned) / whole.dof.limits.trim - 1.0, 0.0), 1.0, dict[str, float]()
    if beyond.any() and problem.slots[0].counts:
        bends = np.stack([way * beyond, way * beyond**2, beyond], axis=2)
        if len(whole.moment) >= MIN_RUNS_TESTED:
            score = _scores(problem, fit, bends).score
            scaled = score / np.maximum(score.std(axis=0, ddof=1), 1e-300)
            p_bends = hotelling_test(scaled.mean(axis=0), np.atleast_2d(np.cov(scaled.T)) / len(score), len(score))
        pushes = {name: _scores(problem, fit, push_of(name, whole, turned)) for name in (STIRRED, FADING)}
        p_push = {name: push_test(scores) for name, scores in pushes.items()}
    residual = np.where(half.observed, half.heading - rival.reading(half.dof.position), 0.0)
    colour = float((residual[:, 1:] * residual[:, :-1]).sum() / max((residual**2).sum(), 1e-300))
    ratio = float(fit.noise / max(rival.noise, 1e-300))
    return Consistency(difference_test(fit, rival), p_bends, p_push, ratio, colour)


def _turned(data: StepData, problem: Problem, fit: MixedFit) -> Floats:
    """Angle or way (R, N) that each run has gone since its step, as fitted."""
    position = next(slot.part for slot in problem.slots if slot.name == data.dof.position)
    return np.where(data.observed, fit.fitted[:, position] - fit.run_effects[:, :1], 0.0)


def push_of(name: str, data: StepData, turned: Floats) -> Floats:
    """What a small push STIRRED or FADING does to the heading, up to its size, (R, N, 1), by the angle `turned`.

    To first order, after the start, a torque changes the rate by its share of twice the drag, and the heading by the
    integral of that. Stirred water pushes in proportion to the angle turned; thrust that fades does so as
    |tau| (1 - exp(-t/FADING_S)).
    """
    if name == STIRRED:
        growth = turned * np.maximum(np.diff(data.time, axis=1, prepend=data.time[:, :1]), 0.0)
    else:
        fade = -np.expm1(-np.maximum(data.time, 0.0) / FADING_S)
        growth = np.diff(turned, axis=1, prepend=turned[:, :1]) * fade * np.abs(data.moment)[:, None]
    return np.where(data.observed, np.cumsum(growth, axis=1), 0.0)[:, :, None]


def freed_of(push: str, data: StepData, fit: OutputErrorFit, priors: Priors) -> OutputErrorFit:
    """Give the fit with a push of unknown size beside its model, to first order: what it explains is taken off."""
    mixed = fit.mixed
    assert not mixed.driven
    problem = step_problem(data, fit.number, priors, "difference" in fit.roles)
    scores = _scores(problem, mixed, push_of(push, data, _turned(data, problem, mixed)))
    certainty = scores.information.sum(axis=0)[0, 0]
    if not certainty > 0.0:
        return fit
    size = scores.score.sum() / certainty
    without = (scores.score.sum() - scores.score[:, 0]) / (certainty - scores.information[:, 0, 0])
    phi, lean = mixed.phi - size * scores.lean[:, 0], scores.lean[:, 0]
    freed = replace(
        mixed, phi=phi, theta=problem.parameters.natural(phi), left_out=mixed.left_out - np.outer(without, lean),
        covariance=mixed.covariance + np.outer(lean, lean) / certainty,
    )  # fmt: skip
    return replace(result_of(fit.number, fit.model, freed), ways=fit.ways)


def difference_test(whole: MixedFit, half: MixedFit) -> float:
    """p-value of the difference of inertia and drags between two fits of one model, by the jackknife over runs; of few
    runs by the likelihood of the shorter data."""
    names = [name for name in whole.names if name in half.names and name != COMMAND_DELAY]
    at, there = ([fit.names.index(name) for name in names] for fit in (whole, half))
    apart, runs, count = half.phi[there] - whole.phi[at], len(whole.left_out), len(names)
    if runs < max(MIN_RUNS_TESTED, count + 2):
        square = float(apart @ np.linalg.pinv(half.covariance[np.ix_(there, there)], hermitian=True) @ apart)
        return float(special.chdtrc(count, square))
    return hotelling_test(apart, jackknife(half.left_out[:, there] - whole.left_out[:, at]), runs)


def hotelling_test(mean: Floats, covariance: Floats, runs: int) -> float:
    """p-value of a `mean` (k,) of zero, by its covariance (k, k) over so many runs (Hotelling's T²)."""
    square, count = float(mean @ np.linalg.pinv(covariance, hermitian=True) @ mean), len(mean)
    return float(special.fdtrc(count, runs - count, square * (runs - count) / count / (runs - 1)))


@dataclass(frozen=True)
class Scores:
    """Each run's `score` (R, m) by shifts of the readings that the model lacks, freed of the model's parameters and of
    the run's own effects, its `information` (R, m, m), and `lean` (p, m), by how much the parameters phi would move
    with shifts of unit size."""

    score: Floats
    information: Floats
    lean: Floats


def _scores(problem: Problem, fit: MixedFit, shifts: Floats) -> Scores:
    """Work out the scores by `shifts` (R, N, m) of the first channel."""
    fitted, by_phi, by_run = derivatives(problem, fit.phi, fit.run_effects)
    residual = problem.residual(fitted) + np.einsum("rnq,rq->rn", by_run, fit.run_effects)
    full, scale = np.zeros((*fitted.shape, shifts.shape[2])), np.ones(fitted.shape[1])
    full[:, problem.slots[0].part] = shifts
    for slot, noise in zip(problem.counted, fit.noises):
        scale[slot.part] = 1.0 / noise
    free = np.setdiff1d(np.flatnonzero(np.diagonal(fit.covariance) > 0.0), fit.at_bound)
    p, m = len(free), shifts.shape[2]
    columns = np.concatenate([by_phi[:, :, free], full, residual[:, :, None]], axis=2)
    columns = np.where(problem.observed[:, :, None], columns, 0.0) * scale[:, None]
    by_effects = by_run * scale[:, None] * problem.effects.deviation(fit.variances)[:, None]
    shared = np.swapaxes(by_effects, 1, 2) @ columns
    kernel = np.eye(by_effects.shape[2]) + np.swapaxes(by_effects, 1, 2) @ by_effects
    gram = np.swapaxes(columns, 1, 2) @ columns - np.swapaxes(shared, 1, 2) @ np.linalg.solve(kernel, shared)
    total = gram.sum(axis=0)
    move = np.linalg.pinv(total[:p, :p], rcond=1e-13, hermitian=True) @ total[:p, p : p + m]
    back = np.concatenate([-move, np.eye(m)])  # of parameters and shifts together, to what only the shifts explain
    gram_of = gram[:, : p + m, : p + m]
    lean = np.zeros((len(fit.phi), m))
    lean[free] = move
    return Scores(gram[:, : p + m, -1] @ back, np.swapaxes(back, 0, 1) @ gram_of @ back, lean)


def push_test(scores: Scores) -> float:
    """p-value of one push common to all runs, by the likelihood's certainty of it, scaled by how far the runs disagree
    on it beyond that, as coloured noise lets them."""
    score, certainty = scores.score[:, 0], np.maximum(scores.information[:, 0, 0], 1e-300)
    size = score.sum() / certainty.sum()
    between = float(((score - certainty * size) ** 2 / certainty).sum()) / (len(score) - 1)
    return float(special.fdtrc(1, len(score) - 1, size * score.sum() / max(between, 1e-300)))
