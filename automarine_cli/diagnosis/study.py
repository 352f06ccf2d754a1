"""What a diagnosis looks at: runs, how they start, the base model; and the likelihood of any model on them."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import DRAG, FIRST_KNOTS, KNOTS, MOMENT, PREFIX, Learned, kind_of, roughness
from automarine_cli.errors import FitError
from automarine_cli.filters.course import SLOW_ANSWER_S, SLOW_STEP_S, Course, make_course
from automarine_cli.filters.kalman import FilterResult, Noises, Predicted, predict
from automarine_cli.filters.readings import MIN_STEP_S, answers_more
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.driven import base_starts, driven_problem, mostly_steps, shows_disturbance, starts_near
from automarine_cli.fits.innovations import DrivenProblem, Fit, InnovationsFit, fit_innovations, fits_of
from automarine_cli.fits.linear_mixed import GAIN, START_VELOCITY, SWITCHES
from automarine_cli.fits.mixed_model import MixedFit, Problem, derivatives, fit_mixed
from automarine_cli.fits.whole_runs import instant, left_out_changes, run_covariance, varying_terms, whole_run_problem
from automarine_cli.models.model import COMMAND_DELAY, Model, Term
from automarine_cli.models.parameter import Parameters, Prior
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import segments, start_at_rest
from automarine_cli.runs.run import Run, position_noise, with_later_commands
from automarine_cli.simulation.batch import Batch, make_batch
from automarine_cli.simulation.rollout import step_for

FIT_ROUNDS = 25
SETTLED_SHARE = 0.02  # of a standard error, within which a fit has settled: its evidence is exact to a few 1e-4
MIN_STEP_DEVIANCE = 0.3  # of a whole step with which a candidate's fit ends: its evidence is exact to some tenths
FEIGNED = 0.03  # deviance for each reading, twice what effects gained in made loops with an unlogged gyro
GAP_HORIZON_S = 5.0  # seconds ahead over which driven runs show the gap

MOVING_SHARE = 1.0 / 25.0  # of the vehicle's time constant, over which commands that change all the time are averaged
HALF_WAY = 3.0  # way [m] after which a vehicle that goes along a line has stirred the water

# A controller's limit cycle: command and position that swing together, as a loop with a lag or a dead-band does. A wave
# would show in the position first, and the command would answer it; in a limit cycle neither comes from outside. The
# two cannot be distinguished by their period, so that there a periodic disturbance is the last thing to believe.
SPECTRUM_STEP_S, SEGMENT = 0.25, 30.0  # of the spectra [s]
SLOWEST, QUICKEST = 15.0, 1.0  # periods [s] at which loops of small vehicles swing
MIN_CYCLE_SHARE = 0.4  # of the command's variance that one period has to hold, and coherence of command and position
PERIOD_TOLERANCE = 0.25  # share by which another period may differ from that of a cycle and still be the same


@dataclass(frozen=True)
class LimitCycle:
    """Command and position swing together with a `period` [s]: the `share` of the command's variance there, their
    `coherence`, and the `phase` of the position behind the command [rad]."""

    period: float
    share: float
    coherence: float
    phase: float

    def holds(self, period: float) -> bool:
        return abs(period / self.period - 1.0) < PERIOD_TOLERANCE

    def to_json(self) -> dict[str, float]:
        return {
            "period_s": self.period, "share_of_command": self.share, "coherence": self.coherence,
            "phase_behind_command_deg": float(np.degrees(self.phase)),
        }  # fmt: skip

    def sentence(self, dof: Dof) -> str:
        force, position = dof.words.force, dof.words.position
        return (
            f"Command and {position} swing together every {self.period:.2g} s ({100 * self.share:.0f} % of the "
            f"commanded {force}), the {position} {np.degrees(self.phase):.0f} degrees of the cycle behind the {force}: "
            "a limit cycle of the controller. A lag, a delay or a dead-band makes one; a periodic disturbance of that "
            "period is not believed."
        )


def limit_cycle(runs: Sequence[Run]) -> LimitCycle | None:
    """The limit cycle that most of the runs show, from spectra averaged over runs (Welch 1967, IEEE Trans. Audio
    Electroacoustics 15:70); None where there is none, or the runs are too short to show one."""
    from scipy import signal  # here, as it loads half of scipy and only driven runs need it

    length = int(SEGMENT / SPECTRUM_STEP_S)
    settings: dict[str, Any] = {"fs": 1.0 / SPECTRUM_STEP_S, "nperseg": length, "detrend": "linear"}
    frequency = np.fft.rfftfreq(length, SPECTRUM_STEP_S)
    spectra = np.zeros((3, len(frequency)), dtype=complex)  # of the command, of the position, across
    for run in runs:
        time = np.arange(run.time[0], run.time[-1], SPECTRUM_STEP_S)
        if len(time) >= length:
            command, position = (np.interp(time, run.time, column) for column in (run.command, run.position))
            pairs = ((command, command), (position, position), (command, position))
            spectra += len(time) * np.array([signal.csd(x, y, **settings)[1] for x, y in pairs])
    power, positions, cross = spectra[0].real, spectra[1].real, spectra[2]
    if not np.any(power):
        return None
    may = (frequency >= 1.0 / SLOWEST) & (frequency <= 1.0 / QUICKEST)
    peak = int(np.argmax(np.where(may, power, -1.0)))
    in_peak = np.abs(frequency / frequency[peak] - 1.0) < PERIOD_TOLERANCE
    share = float(power[in_peak].sum() / power.sum())
    coherence = float(np.abs(cross[peak]) ** 2 / max(power[peak] * positions[peak], 1e-300))
    inside = 0 < peak < len(power) - 1 and power[peak] > 2.0 * np.median(power[may])
    if not inside or share < MIN_CYCLE_SHARE or coherence < MIN_CYCLE_SHARE:
        return None
    return LimitCycle(float(1.0 / frequency[peak]), share, coherence, float(-np.angle(cross[peak])) % (2.0 * np.pi))


# Learned curves in a fit: their values have a Gaussian prior, whose spread is where the marginal likelihood is largest,
# by the curvature of the fit that was made (Laplace's approximation; Wood 2011, J. R. Stat. Soc. B 73:3).
SPREADS = np.geomspace(3e-4, 1.0, 15)  # spreads that are tried
FIRM = 100.0  # times the spread's own precision with which a curve keeps away from what other terms of the model are


def learned_term(model: Model) -> int | None:
    """Place of the model's learned term among its terms; None without one."""
    return next((i for i, term in enumerate(model.terms) if term.name.startswith(PREFIX)), None)


def places(model: Model) -> NDArray[np.int64]:
    """Places of a learned curve's values in theta, (KNOTS,); none without a curve."""
    at = learned_term(model)
    if at is None:
        return np.arange(0)
    return 1 + sum(len(term.values) for term in model.terms[:at]) + FIRST_KNOTS + np.arange(KNOTS)


def precision(model: Model, spread: float | None = None) -> Floats:
    """Prior precision of the values of the model's learned curve, (KNOTS, KNOTS), at a spread, its own if None."""
    at = learned_term(model)
    assert at is not None
    overlap, effect = elsewhere(model, model.terms[at]), effects.get(model.terms[at].name)
    assert isinstance(effect, Learned)
    spread = model.terms[at].values[FIRST_KNOTS - 1] if spread is None else spread
    return (roughness(bool(effect.variable.turn)) + FIRM**2 * overlap.T @ overlap) / spread**2


def elsewhere(model: Model, term: Term) -> Floats:
    """Curves (n, KNOTS) of unit length that other terms of the model are already: drag over the speed, a gain common to
    all runs, a constant force, what turns the vehicle back, linear drag; and what would jump at a standstill."""
    effect = effects.get(term.name)
    assert isinstance(effect, Learned)
    kind, sized = kind_of(term.values), effect.variable.sized
    present, at, rows = {other.name for other in model.terms}, np.linspace(0.0, 1.0, KNOTS), []
    level = {DRAG: "linear-drag", MOMENT: "bias-moment"}
    if kind not in level or (not sized and level[kind] in present):
        rows.append(np.ones(KNOTS))
        if kind == MOMENT and "restoring-moment" in present and effect.variable.uses_absolute:
            low, high = term.values[:2]
            rows.append(np.sin(low + (high - low) * at))
    elif sized:
        powers = {"linear-drag": 1, "quadratic-drag": 2, "cubic-drag": 3}
        rows += [np.eye(KNOTS)[0], *(at**power for name, power in powers.items() if name in present)]
    return np.array([row / np.linalg.norm(row) for row in rows]).reshape(-1, KNOTS)


def smoothed_curve(model: Model, parameters: Parameters) -> Parameters:
    """Return the parameters with that precision of the values of the model's curve, if it has one."""
    if learned_term(model) is None:
        return parameters
    matrix, at = np.zeros((len(parameters), len(parameters))), places(model)
    matrix[np.ix_(at, at)] = precision(model)
    return replace(parameters, smooth=matrix)


def smoothed(fit: Fit, model: Model) -> tuple[float, float]:
    """The spread of largest marginal likelihood by the curvature of a fit of `model`, and the curve's effective number
    of parameters at the spread that was fitted."""
    at, fitted = places(model), precision(model)
    spread = fit.covariance[np.ix_(at, at)]
    stiff = np.linalg.inv(spread)
    pull = stiff @ fit.theta[at]
    data = stiff - fitted
    likely = []  # twice the log marginal likelihood under each prior, but for what is the same of all
    for prior in (precision(model, s) for s in SPREADS):
        log_det = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(data + prior)[1]
        likely.append(float(pull @ np.linalg.solve(data + prior, pull) + log_det))
    return float(SPREADS[int(np.argmax(likely))]), float(KNOTS - np.trace(spread @ fitted))


@dataclass(frozen=True)
class DiagnosisProblem:
    """Runs with a base model.

    Runs that are `driven` are judged by the innovations of a filter, in which a disturbance is a process (see
    fits/innovations.py): a controller in the loop, wind, waves, wash. The others are simulated whole, and nothing but
    noise, gains and instants differs between a run and its simulation. `channels` are the sensors that count, None for
    the position alone; gaps are looked at in the position either way. `is_early`: the commands of `runs` are a sample
    later than the logs have them."""

    runs: tuple[Run, ...]
    base: Model
    driven: bool
    signals: tuple[str, ...]
    channels: tuple[str, ...] | None = None
    is_early: bool = False

    def with_later_commands(self) -> "DiagnosisProblem":
        """Return the same of logs that have every command a sample before it acts."""
        return replace(self, runs=tuple(map(with_later_commands, self.runs)), is_early=True)

    @cached_property
    def batch(self) -> Batch:
        largest = max(float(np.abs(run.command).max()) for run in self.runs)
        answer, step = self.base.fastest(largest), step_for(self.base, largest)
        usual, settled = (0.2, SLOW_STEP_S) if answer > SLOW_ANSWER_S else (0.1, step)
        return make_batch(
            self.runs, min(usual, step), self.signals, channels=self.channels, settled_step=settled,
            moving_step=min(usual, MOVING_SHARE * answer),
        )  # fmt: skip

    @cached_property
    def time(self) -> Floats:
        """Time of each sample since the run's first one [s], (R, N), also while somebody held the vehicle."""
        if not self.base.dof.has_constant:
            return self.batch.time
        time = np.zeros(self.batch.seen.shape)
        for row, run in zip(time, self.runs):
            row[: len(run)] = run.time - run.time[0]
        return time

    @cached_property
    def at_rest(self) -> NDArray[np.bool_]:
        return start_at_rest(self.runs)

    @cached_property
    def commanded(self) -> bool:
        """Whether there is a command in any run: free decays have none."""
        return bool(self.batch.force.any())

    @cached_property
    def commands_return(self) -> bool:
        """Whether any command falls without going to the other side while readings go on."""
        levels = ([command for *_, command in segments(run.command[:-1])] for run in self.runs)
        pairs = (pair for of_run in levels for pair in pairwise(of_run))
        return any(before * after >= 0.0 and abs(after) < abs(before) for before, after in pairs)

    @cached_property
    def largest(self) -> float:
        """Largest command [N m or N]; without any the largest moment that the base meets in these runs."""
        if self.commanded:
            return float(np.abs(self.batch.force).max())
        linear, quadratic = self.base.drag()
        swing = max(float(np.abs(np.sin(run.position)).max()) for run in self.runs)
        return self.base.restoring * swing + (linear + quadratic * self.fastest) * self.fastest

    @cached_property
    def fastest(self) -> float:
        """Largest |yaw rate| of the runs [rad/s], each as the mean over a second."""
        grids = [(run, np.arange(run.time[0], run.time[-1], 1.0)) for run in self.runs]
        steps = [np.diff(np.interp(grid, run.time, run.position)) for run, grid in grids]
        return float(np.abs(np.concatenate(steps)).max(initial=0.0))

    def reference(self, kind: str) -> float:
        """Value of a parameter that the logs fix (see `effects.Parameter.reference`)."""
        if kind == "moment":
            return self.largest
        if kind == "clock":
            return float(self.batch.start.min())
        return float(np.mean([np.abs(run.extras[kind]).mean() for run in self.runs]))

    @cached_property
    def logger_delay(self) -> float:
        """Half a sample interval [s]: a delay up to that is the logger's convention, none of the vehicle."""
        return 0.5 * float(np.median([run.sample_period for run in self.runs]))

    @cached_property
    def slowest(self) -> float:
        """Longest period [s] of what varies from run to run: what does not come twice in a quarter of the runs could be
        anything."""
        return float(np.quantile([run.time[-1] - run.time[0] for run in self.runs], 0.75)) / 2.0

    @cached_property
    def turns_back(self) -> NDArray[np.bool_]:
        """Which runs turn as far back as stirs water, half a turn, after as much the other way, (R,); in a motion
        along a line HALF_WAY metres."""
        far = np.pi if self.base.dof.wraps else HALF_WAY
        turned = []
        for run in self.runs:
            rise = np.maximum.accumulate(run.position - np.minimum.accumulate(run.position))
            fall = np.maximum.accumulate(np.maximum.accumulate(run.position) - run.position)
            turned.append(min(rise[-1], fall[-1]) >= far)
        return np.array(turned)

    @cached_property
    def position_counts(self) -> bool:
        """Whether positions are evidence, and do not stand in for a sensor that the logs lack."""
        return self.batch.channels[0].counts

    @cached_property
    def sensor_floor(self) -> float:
        """Noise of the first sensor that counts, estimated without a model, root mean square over runs."""
        channel = next(channel for channel in self.batch.channels if channel.counts)
        rows = [row for row in zip(self.runs, channel.values, channel.seen) if row[2].any()]
        squares = [position_noise(run.time[mask[: len(run)]], values[mask]) ** 2 for run, values, mask in rows]
        return float(np.sqrt(np.average(squares, weights=[observed.sum() for *_, observed in rows]))) if rows else 0.0

    @cached_property
    def floor(self) -> float:
        """What noise leaves of the positions, root mean square over runs [rad]: their own, or, where they are the sum
        of velocities, that of the sum."""
        if self.position_counts:
            return self.sensor_floor
        length = np.mean([len(run) * run.sample_period**2 for run in self.runs])
        return float(self.sensor_floor * np.sqrt(length / 6.0))

    def residual(self, fitted: Floats) -> Floats:
        """Measured less fitted positions (R, N), zero in the padding, of readings `fitted` of all channels; where
        there are velocities only, the sum of what is left of these."""
        width = self.batch.seen.shape[1]
        if not self.position_counts:
            channel = self.batch.channels[1]
            residual = np.where(channel.seen, channel.values - fitted[..., width : 2 * width], 0.0)
            steps = 0.5 * (residual[:, 1:] + residual[:, :-1]) * np.diff(self.time, axis=1)
            summed = np.cumsum(steps, axis=1)
            return np.where(self.batch.seen, np.concatenate([0.0 * residual[:, :1], summed], axis=1), 0.0)
        return np.where(self.batch.seen, self.batch.position - fitted[..., :width], 0.0)

    @cached_property
    def course(self) -> Course:
        return make_course(self.runs, self.at_rest, self.signals, channels=self.channels)

    @cached_property
    def feigned(self) -> float:
        """Deviance that an effect can gain by itself where commands tell of readings that the log lacks, else zero."""
        answered = sum(float(np.ptp(run.time)) / max(run.sample_period, MIN_STEP_S) for run in self.runs)
        return FEIGNED * answered if self.driven and answers_more(self.runs, self.course.sensors) else 0.0

    @cached_property
    def cycle(self) -> LimitCycle | None:
        return limit_cycle(self.runs) if self.driven else None

    def driven_problem(self, model: Model) -> DrivenProblem:
        problem = driven_problem(model, self.course, latest=self.logger_delay, slowest=self.slowest)
        return replace(problem, parameters=self._informed(model, problem.parameters))

    def problem(self, model: Model, disturbed: bool = False) -> Problem:
        """Likelihood of runs that are not driven under `model`, any set of effects together; theta ends with the z
        of the instant that all switches share in their sample intervals: a longer delay is an effect."""
        dropped = {new.name for old, new in zip(self.base.terms, model.terms) if new.values == (0.0,) != old.values}
        parameters = model.parameters(
            log_drag=True, least_delay=self.logger_delay, longest_period=self.slowest, dropped=dropped
        )
        problem = whole_run_problem(model, parameters, self.batch, self.at_rest, confined=True, disturbed=disturbed)
        return replace(problem, parameters=self._informed(model, problem.parameters))

    def _informed(self, model: Model, parameters: Parameters) -> Parameters:
        """Return the parameters with what is known of them beside the logs: those that the base holds fixed, and that
        the model's curve is smooth."""
        priors = {name: Prior(value) for name, value in self.base.values.items() if name in self.base.fixed}
        return smoothed_curve(model, parameters.informed({**parameters.priors, **priors}))

    def fit(
        self, model: Model, values: Floats | None = None, warm_start: Fit | None = None, iterations: int = FIT_ROUNDS,
        least_gain: float = MIN_STEP_DEVIANCE,
    ) -> Fit:  # fmt: skip
        """Joint maximum likelihood of the model on all runs, from `values` of its parameters or its own; once.

        `warm_start` is a fit of a similar model of which everything else is a good start: runs that are simulated whole
        are then fitted until a step gains less than `least_gain`."""
        values = model.theta if values is None else values
        key = (model, values.tobytes(), warm_start, iterations, least_gain)
        if key not in self._fits:
            self._fits[key] = self._fitted(model, values, warm_start, iterations, least_gain)
        return self._fits[key]

    def fits_beside(
        self, models: Sequence[Model], values: Sequence[Floats], warm_starts: Sequence[Fit], iterations: int
    ) -> list[Fit | None]:
        """The same of several models of driven runs, side by side; None where a start leads nowhere."""
        problems = [self.driven_problem(model) for model in models]
        starts = [starts_near(of, [theta], fit.of_chance) for of, theta, fit in zip(problems, values, warm_starts)]
        keys = [(m, v.tobytes(), s, iterations, MIN_STEP_DEVIANCE) for m, v, s in zip(models, values, warm_starts)]
        new = [i for i, key in enumerate(keys) if key not in self._fits]
        brief, most = iterations < FIT_ROUNDS, min(iterations, FIT_ROUNDS)
        fits = fits_of([problems[i] for i in new], [starts[i] for i in new], most, brief) if new else []
        self._fits.update((keys[i], fit) for i, fit in zip(new, fits) if fit is not None)
        return [self._fits.get(key) for key in keys]

    def _fitted(self, model: Model, values: Floats, warm_start: Fit | None, iterations: int, least_gain: float) -> Fit:
        if self.driven:
            driven = self.driven_problem(model)
            if warm_start is not None:
                starts = starts_near(driven, [values], warm_start.of_chance)
                return fit_innovations(driven, starts, min(iterations, FIT_ROUNDS), iterations < FIT_ROUNDS)
            return fit_innovations(driven, np.concatenate([base_starts(driven), starts_near(driven, [values], {})]))
        problem = self.problem(model)
        delay, begin = 0.0, {START_VELOCITY: 1.0, GAIN: 0.03, SWITCHES: 0.7}
        settings: dict[str, Any] = {"noise": max(2 * self.sensor_floor, 1e-4), "iterations": FIT_ROUNDS}
        if warm_start is not None and not warm_start.driven:
            delay = warm_start.value(COMMAND_DELAY)
            begin |= dict(zip(warm_start.effects.factor_names, warm_start.factors))
            run_effects = warm_start.effects.carried(warm_start.run_effects, problem.effects)
            settings = {"noise": warm_start.noises, "iterations": iterations, "run_effects": run_effects}
            settings["least_gain"] = least_gain
        factors = np.array([begin.get(name, 0.02) for name in problem.effects.factor_names])
        return fit_mixed(problem, np.append(values, delay), factors=factors, settled=SETTLED_SHARE, **settings)

    @cached_property
    def _fits(self) -> dict[tuple[object, ...], Fit]:
        return {}

    @cached_property
    def _covariances(self) -> dict[Fit, Floats]:
        return {}

    @cached_property
    def _predictions(self) -> dict[Fit, tuple[Predicted, ...]]:
        return {}

    @cached_property
    def _responses(self) -> dict[Fit, tuple[Floats, Floats]]:
        return {}

    def responses_of(self, model: Model, fit: MixedFit) -> tuple[Floats, Floats]:
        """Readings (R, N) of these runs as a fit to others has them, and their log densities (R,), worked out once a
        fit."""
        if fit not in self._responses:
            self._responses[fit] = run_effects_given(self.problem(model), fit.theta, fit.variances)
        return self._responses[fit]

    def covariance(self, model: Model, fit: Fit) -> Floats:
        """Covariance of a fit's phi with the run as the unit, (p, p); worked out once a fit.

        It is exact where instants are confined to their sample intervals; of driven runs the linearised jackknife."""
        if fit not in self._covariances:
            changes = None
            if not fit.driven and learned_term(model) is None:
                with suppress(FitError, np.linalg.LinAlgError):
                    changes = left_out_changes(self.problem(model), fit)
            self._covariances[fit] = run_covariance(fit, changes)
        return self._covariances[fit]

    def deviances(self, model: Model, fit: Fit, phi: Floats) -> Floats:
        """Deviances (P,), up to a constant, under phi (P, p), with the fit's own run effects."""
        if fit.driven:
            return -2.0 * self.driven_problem(model).value(phi)
        problem, effects = self.problem(model), np.tile(fit.run_effects, (len(phi), 1, 1))
        fitted = problem.response(problem.parameters.natural(phi), effects)
        return problem.squares(problem.residual(fitted), fit.variances).sum(axis=1)

    def command_delay(self, fit: Fit) -> float:
        """Give the command delay [s] of a fit to these runs as files have it."""
        delay = float(fit.of_chance[COMMAND_DELAY])
        return delay if fit.driven else 2.0 * self.logger_delay * float(instant(np.array(delay)) + self.is_early)

    def predictions(self, model: Model, fit: InnovationsFit) -> tuple[Predicted, ...]:
        """What the model predicts of these runs, from the filtered state, over each of HORIZONS, worked out once a fit;
        the fit may be one to other runs."""

        if fit not in self._predictions:
            noises = self.driven_problem(model).noises(fit.theta[None])
            (self._predictions[fit],) = predict(model, self.course, fit.of_model, noises)
        return self._predictions[fit]

    def with_fitted_values(self, model: Model, fit: Fit) -> Model:
        """The fitted model; effects that vary from run to run tell the amplitude that the runs' own share."""
        model = model.with_theta(fit.of_model)
        for name in varying_terms(model):
            size = 1.0 if self.driven else self.largest
            amplitude = float(np.sqrt(2.0) * fit.factor(name) * size)
            terms = tuple(replace(t, values=(amplitude, *t.values[1:])) if t.name == name else t for t in model.terms)
            model = replace(model, terms=terms)
        return model


def study_of(
    runs: Sequence[Run], base: Model, channels: tuple[str, ...] | None = None, driven: bool = False
) -> DiagnosisProblem:
    """A study of `runs`; whether they are driven, the fit of their base says, else the evidence.

    Runs without any command show ratios to the inertia, which stays what it is."""
    inertia = base.dof.parameter("inertia")
    if inertia not in base.fixed and not any(np.any(run.command) for run in runs):
        base = replace(base, fixed=(*base.fixed, inertia))
    driven = driven or (not mostly_steps(runs) and shows_disturbance(runs, base, start_at_rest(runs), channels))
    have = set.intersection(*(set(run.extras) for run in runs))
    needed = {name for effect in effects.names() for name in effects.get(effect).needs} & have
    return DiagnosisProblem(tuple(runs), base, driven, tuple(sorted({*needed, *base.signals})), channels=channels)


def judged(predictions: Sequence[Predicted]) -> Predicted:
    """The predictions over the horizon that shows the gap, or the longest below it that any run is long enough for."""
    some = [prediction for prediction in predictions if len(prediction.error) and prediction.horizon <= GAP_HORIZON_S]
    return some[-1] if some else predictions[0]


def missed(study: DiagnosisProblem, model: Model, fit: InnovationsFit) -> Floats:
    """Measured less predicted positions (R, N) of driven runs over the shortest horizon that readings allow, which
    shows what is missing before disturbances do, at the times when predictions begin, zero where none.

    What a controller commands and the vehicle does in between answer what made an error: by chance only what was before
    is independent of it."""
    predictions = study.predictions(model, fit)
    prediction = next((p for p in predictions if len(p.error)), predictions[0])
    out = np.zeros(study.batch.seen.shape)
    for r, (row, run) in enumerate(zip(out, study.runs)):
        of_run = prediction.run == r
        if of_run.any():
            when = study.course.time[r, prediction.origin[of_run]]
            row[: len(run)] = np.interp(run.time - run.time[0], when, prediction.error[of_run], left=0.0, right=0.0)
    return out


def missing_push(followed: FilterResult, noises: Noises, course: Course, reading: NDArray[np.bool_]) -> Floats:
    """Accelerations (D, R, K + 1) of the steady pushes that correct the filter from each node with a `reading` to the
    next. By chance that is independent of all that was known at the node, whatever a controller answers."""
    assert followed.states is not None
    pushed = followed.states[list(followed.places.pushed), 0]
    out, time_constant = np.zeros_like(pushed), noises.time[:, :1]
    for r, row in enumerate(reading):
        at = np.flatnonzero(row)
        lasting = np.exp(-np.diff(course.time[r, at]) / time_constant)
        news = pushed[:, r, at[1:]] - lasting * pushed[:, r, at[:-1]]
        out[:, r, at[:-1]] = news / np.maximum(1.0 - lasting, 1e-9)
    return out


def filtered(study: DiagnosisProblem, model: Model, fit: InnovationsFit) -> Floats:
    """Positions and velocities of driven runs as the filter knows them from the readings until each sample, and the
    moment or force that is missing then: (3, R, N)."""
    problem = study.driven_problem(model)
    followed = problem.follow(fit.phi[None], keep=True)
    assert followed.states is not None
    places, out = followed.places, np.zeros((3, *study.batch.seen.shape))
    reading, noises = study.course.channels[0].seen, problem.noises(fit.theta[None])
    missing = fit.theta[0] * missing_push(followed, noises, study.course, reading)
    nodes = np.stack([*followed.states[[places.position[0], places.velocity[0]], 0], missing[0]])
    for r, run in enumerate(study.runs):
        at = np.searchsorted(study.course.time[r], run.time - run.time[0] + 1e-9, side="right") - 1
        out[:, r, : len(run)] = nodes[:, r, at]
    return out


def log_density(study: DiagnosisProblem, model: Model, fit: Fit) -> Floats:
    """Log density of each run of `study` (R,) under a fit to others; of runs that are simulated whole linearised at the
    run effects' posterior means as fits are."""
    if fit.driven:
        return study.driven_problem(model).follow(fit.phi[None]).log_density[0]
    return study.responses_of(model, fit)[1]


def run_effects_given(problem: Problem, theta: Floats, variances: Floats, rounds: int = 12) -> tuple[Floats, Floats]:
    """Posterior means of the run effects of runs that were not fitted: the headings with them (R, N), and the log
    density of each run (R,) about them.

    `theta` (p,) and `variances` come from other runs. Each round linearises about the last run effects and takes, run
    by run, the share of the step that fits best, so that no run can wander."""
    scale, simulated = problem.effects.deviation(variances), problem.response
    shares, none = np.array([1.0, 0.5, 0.2])[:, None, None], np.zeros(0)

    def response(nothing: Floats, b: Floats) -> Floats:
        return simulated(np.tile(theta, (len(b), 1)), b)

    single = problem.paired

    def paired(nothing: Floats, b: Floats, rows: NDArray[np.int64]) -> Floats:
        assert single is not None
        return single(np.tile(theta, (len(b), 1)), b, rows)

    # nothing else is left to be fitted
    problem = replace(problem, response=response, paired=single and paired, parameters=Parameters(()))

    def costs(fitted: Floats, b: Floats) -> Floats:
        penalty = np.divide(b, scale, out=np.zeros_like(b), where=scale > 0) ** 2
        cost = problem.squares(problem.residual(fitted), variances) + penalty.sum(axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    b = np.zeros_like(problem.effects.scale)
    for _ in range(rounds):
        fitted, by_theta, by_run = derivatives(problem, none, b)
        gram = problem.gram(by_theta, by_run, fitted, b)
        step = linear_mixed.posterior_mean(gram, problem.effects, variances, none) - b
        trials = b + shares * step
        trial_costs = np.stack([costs(h, e) for h, e in zip(response(none, trials), trials)])
        best, now = trial_costs.argmin(axis=0), costs(fitted, b)
        better = trial_costs.min(axis=0) < now * (1.0 - 1e-6)
        if not better.any():
            break
        b = np.where(better[:, None], trials[best, np.arange(len(b))], b)
    else:
        fitted, by_theta, by_run = derivatives(problem, none, b)
        gram = problem.gram(by_theta, by_run, fitted, b)
    weighted = linear_mixed.weigh(gram, problem.effects, variances)
    return fitted, linear_mixed.predictive(gram, weighted, np.zeros((len(b), 0)))
