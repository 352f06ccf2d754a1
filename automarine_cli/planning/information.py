"""What is known before a campaign, and what runs that are not yet made would tell: the likelihood of `fit-yaw` or of
`diagnose` on them, its Fisher information, and the intervals that a fit to them would report.

Run i adds  J_i' R_i^-1 J_i  to the information on the parameters, with J_i the derivatives of its headings and
R_i = s² 1 + V_i D_i V_i' the covariance of its noise and of what differs from run to run: start heading, gain of the
thrust, instants of the changes (fits/linear_mixed.py). It needs no measurement, and adds up over runs (Fedorov 1972).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.diagnosis.study import DiagnosisProblem
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import ModelError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.filters.course import make_course
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.driven import driven_problem, starts_near
from automarine_cli.fits.innovations import DrivenProblem
from automarine_cli.fits.linear_mixed import GAIN, START_VELOCITY, SWITCHES
from automarine_cli.fits.mixed_model import Problem, derivatives
from automarine_cli.fits.whole_runs import MIN_JACKKNIFE_RUNS, runs_that_carry, varying_terms, whole_run_problem
from automarine_cli.models.model import BASE_TERMS, COMMAND_DELAY, DELAY, Model
from automarine_cli.models.parameter import Parameters
from automarine_cli.models.store import DIAGNOSIS, DiagnosisFile, ModelFile, StoredModels, file_and_models
from automarine_cli.pipeline.records import Source, read_plain
from automarine_cli.planning.candidates import PaperRun
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs.half_turn import start_at_rest
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate, step_for
from automarine_cli.text import format_value, printable

Fit = Literal["whole-runs", "diagnosis"]

HELD_OUT_SHARE = 0.25  # share of the runs that `diagnose` does not fit, where no others are given to be held out
QUIET_DISTURBANCE = 1e-5  # disturbance moment of a pool, as a factor of the fits: none
ANGLE = "inertial turn angle"
DERIVED = (ANGLE, "K", "T")  # that are made of other parameters
MIN_INTERVAL_RUNS = 3  # runs below which no interval is told
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(3)
"""Where in its sample interval a command changes is averaged over, for fits that confine it to that interval."""
LOOSE_STDERR = 3.0
"""Standard deviation of a parameter before any run, in its own size: the first choices must not divide by 0."""


@dataclass(frozen=True)
class PlannedLog:
    """What a log on paper looks like: `rate` [Hz], `rest` [s] of zero moment first, `unit` of the moment, `voltage` [V]
    of the supply or None where the logs have no such column; of `channels` only a velocity is a column of its own. What
    is steered goes at a `speed` [m/s] where its candidate has none."""

    dof: Dof
    unit: str
    rate: float
    rest: float
    voltage: float | None
    channels: tuple[str, ...] | None
    speed: float | None = None

    @property
    def signals(self) -> tuple[str, ...]:
        return (*(() if self.voltage is None else ("voltage",)), *(() if self.speed is None else ("surge", "rudder")))

    def run(self, candidate: PaperRun) -> Run:
        """Make the run that the logger would bring home; its heading, still to be measured, stands still.

        A command shows from the first sample at or after its instant, as in simulated campaigns."""
        lengths = [self.rest, *(seconds for _, seconds in candidate.commands)]
        ends = np.round(np.cumsum(lengths) * self.rate).astype(int)
        moment = np.zeros(int(ends[-1]))
        for (level, _), begin, end in zip(candidate.commands, ends[:-1], ends[1:]):
            moment[begin:end] = level
        time = candidate.clock + np.arange(len(moment)) / self.rate
        heading = np.full(len(moment), np.deg2rad(candidate.start_heading))
        volts = candidate.voltage if candidate.voltage is not None else self.voltage
        extras = {} if volts is None else {"voltage": np.full(len(moment), volts)}
        if self.speed is not None:
            extras |= {"surge": np.full(len(moment), candidate.speed or self.speed), "rudder": moment}
        if self.dof.velocity in (self.channels or ()):
            extras[self.dof.velocity] = np.zeros(len(moment))
        return Run(candidate.label, "plan", time, heading, moment, self.unit, extras, dof=self.dof)


@dataclass(frozen=True)
class Estimand:
    """What an interval is told of, along a `direction` (p,) of the search's coordinates: a parameter, or a ratio."""

    value: float
    on_log: bool
    unit: str
    direction: Floats

    @property
    def relative(self) -> Floats:
        """The direction in shares of the value where that is not told on the logarithm (in ones for zero)."""
        return self.direction if self.on_log else self.direction / (abs(self.value) or 1.0)


@dataclass(frozen=True)
class Fitting:
    """A model, the fit that its parameters are wanted from, and what is known of the logs.

    `noise` of the heading [rad], `scatter` of the thrust from run to run, `rate` [Hz] of the logger, `rest` [s] before
    each run, `voltage` [V] where the logs have it; `frame` is the drag about which runs are laid out, by default the
    model's own; `rate_noise` [per s] of a velocity sensor, None without. Where something is `random` (by the names of
    driven fits, in base units), runs are fitted by the innovations of a filter. `explained_by` names the effect of the
    model for which it stands beside another explanation, `command_delay` [s] is that of the model's file, `speed` [m/s]
    that of a steered vehicle's logs."""

    model: Model
    fit: Fit
    noise: float
    scatter: float
    rate: float = 10.0
    rest: float = 3.0
    voltage: float | None = None
    frame: Model | None = None
    rate_noise: float | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    explained_by: str = ""
    command_delay: float = 0.0
    speed: float | None = None

    @cached_property
    def base(self) -> Model:
        """The drag alone that the model begins with."""
        names = tuple(term.name for term in self.model.terms)
        size = max(len(drag) for drag in BASE_TERMS.values() if names[: len(drag)] == drag)
        return self.frame or replace(self.model, terms=self.model.terms[:size])

    @property
    def steered(self) -> bool:
        return self.model.moment_unit == STEERED

    @property
    def fitted(self) -> float:
        """Share of the runs that is fitted: `diagnose` holds a quarter out to judge by."""
        return 1.0 - HELD_OUT_SHARE if self.fit == "diagnosis" else 1.0

    @cached_property
    def logger(self) -> PlannedLog:
        dof, unit = self.model.dof, self.model.moment_unit
        channels = None if self.rate_noise is None else dof.channels
        return PlannedLog(dof, unit, self.rate, self.rest, self.voltage, channels, self.speed)

    def problem(self, candidates: Sequence[PaperRun]) -> Problem:
        """Set up the likelihood of the candidates' runs; theta ends with the command delay."""
        runs = [self.logger.run(candidate) for candidate in candidates]
        if self.fit == "diagnosis":
            signals, channels = self.logger.signals, self.logger.channels
            return DiagnosisProblem(tuple(runs), self.base, False, signals, channels=channels).problem(self.model)
        largest = max(float(np.abs(run.command).max()) for run in runs)
        step = min(0.1, step_for(self.model, largest))
        batch = make_batch(runs, step, self.model.signals, channels=self.logger.channels)
        # drag that is zero has no logarithm: that of a steered vehicle is often all in its coupling with the speed
        none = [term.name for term in self.model.terms if term.base and self.steered and not any(term.values)]
        parameters = self.model.parameters(log_drag=True, signed_drag=True, dropped=none)
        return whole_run_problem(self.model, parameters, batch, start_at_rest(runs))

    def driven(self, candidates: Sequence[PaperRun]) -> tuple[DrivenProblem, Floats]:
        """Set up the likelihood of the candidates' runs where something is random, and its phi; what they read is what
        the model gives without any of it, and one draw of the sensors' noise."""
        dof, runs = self.model.dof, [self.logger.run(candidate) for candidate in candidates]
        largest, draw = max(float(np.abs(run.command).max()) for run in runs), np.random.default_rng(0)
        batch = make_batch(runs, min(0.1, step_for(self.model, largest)), self.logger.signals)
        rolled, noisy = simulate(self.model, batch), []
        for run, *states in zip(runs, rolled.position[0], rolled.velocity[0]):
            sizes = (self.noise, self.rate_noise or 0.0)
            position, rate = (x[: len(run)] + size * draw.standard_normal(len(run)) for x, size in zip(states, sizes))
            rates = {dof.velocity: rate} if self.logger.channels else {}
            noisy.append(replace(run, position=position, extras={**run.extras, **rates}))
        at_rest = start_at_rest(runs)
        course = make_course(noisy, at_rest, self.logger.signals, channels=self.logger.channels)
        problem = driven_problem(self.model, course)
        return problem, problem.parameters.search(starts_near(problem, [self.model.theta], dict(self.random)))[0]

    @cached_property
    def parameters(self) -> Parameters:
        """Parameters of the model and the command delay after them, as the fit searches them."""
        return self.problem([PaperRun("step", "any", ((1.0, 3.0),))]).parameters

    def phi(self, problem: Problem) -> Floats:
        """Return where the likelihood is looked at, in the search's coordinates."""
        delay = 0.0 if self.fit == "diagnosis" else np.clip(self.command_delay, *problem.parameters.bounds[-1])
        return problem.parameters.search(np.append(self.model.theta, delay))

    def variances(self, problem: Problem) -> Floats:
        """Return logarithms of noise and factors, as the linear half of the mixed model takes them."""
        run_effects = problem.effects
        least = run_effects.limits[run_effects.factor_names.index(GAIN)][0]
        factors = {START_VELOCITY: 1.0, GAIN: max(self.scatter, least), SWITCHES: 1.0}
        for name in varying_terms(self.model):
            amplitude = next(term.values[0] for term in self.model.terms if term.name == name)
            largest = float(run_effects.of(run_effects.scale, name).max())
            factors[name] = max(amplitude / (np.sqrt(2.0) * largest), QUIET_DISTURBANCE)
        noises = [self.noise] if self.rate_noise is None else [self.noise, self.rate_noise]
        return np.log([*noises, *(factors.get(name, QUIET_DISTURBANCE) for name in run_effects.factor_names)])

    @cached_property
    def estimands(self) -> dict[str, Estimand]:
        """What intervals are told of, by name: every free parameter but the delay, and inertia over quadratic drag.

        Parameters of an effect beside the drag begin with the effect's name."""
        symbols, estimands = self.model.dof.symbols, dict[str, Estimand]()
        drag = len(self.model.theta) - sum(len(term.values) for term in self.model.terms[len(self.base.terms) :])
        for k, axis in zip(self.parameters.free[:-1].tolist(), np.eye(len(self.parameters.free))):
            parameter = self.parameters[k]
            of, _, name = parameter.name.partition(".")
            label = name if k < drag else f"{of} {name}"
            estimands[label] = Estimand(parameter.value, parameter.log, parameter.unit, axis)
        if symbols.quadratic in estimands:
            inertia, quadratic = estimands[symbols.inertia], estimands[symbols.quadratic]
            value, unit = inertia.value / quadratic.value, self.model.dof.unit_of("ratio")
            estimands[ANGLE] = Estimand(value, True, unit, inertia.direction - quadratic.direction)
        return estimands | self._nomoto(estimands) if self.steered else estimands

    def _nomoto(self, estimands: Mapping[str, Estimand]) -> dict[str, Estimand]:
        """Gain K = 1/d and time constant T = I/d at the speed, with the damping d = k - c u; none without it."""
        symbols, damping, slope = self.model.dof.symbols, 0.0, np.zeros(len(self.parameters.free))
        for name, factor in ((symbols.linear, 1.0), ("cross-coupling c", -(self.speed or 0.0))):
            if name in estimands:
                of = estimands[name]
                damping += factor * of.value
                slope = slope + factor * of.direction * (of.value if of.on_log else 1.0)
        if damping <= 0.0:
            return {}
        inertia, relative = estimands[symbols.inertia], slope / damping
        time = Estimand(inertia.value / damping, True, "s", inertia.relative - relative)
        return {"K": Estimand(1.0 / damping, True, "1/s", -relative), "T": time}

    @property
    def loose_information(self) -> Floats:
        """Next to no information (p, p) on the free parameters: of each its own size, `LOOSE_STDERR` times over."""
        values = np.append(self.model.theta, 1.0 / self.rate)
        sizes = np.where(self.parameters.log, 1.0, np.maximum(np.abs(values), 1e-3))[self.parameters.free]
        return np.diag(1.0 / (LOOSE_STDERR * sizes) ** 2)

    def information(self, candidates: Sequence[PaperRun]) -> Floats:
        """Return the information of each candidate on the free parameters, in the coordinates of the search, (K, p, p).

        Where a share of the runs is held out of the fit, each counts for what it tells on average."""
        of_runs = self._by_innovations(candidates) if self.random else self._of_problem(self.problem(candidates))
        return self.fitted * of_runs

    def _by_innovations(self, candidates: Sequence[PaperRun]) -> Floats:
        """The same where something is random, whose sizes are fitted too: what is left when all runs together have told
        these (the efficient score), so that it adds up over runs."""
        size, (problem, phi) = len(self.model.theta), self.driven(candidates)
        runs = problem.slopes(phi[None])[0].information
        names = [problem.parameters.names[i] for i in problem.free]
        searched = np.array([*self.model.parameter_names, COMMAND_DELAY])[self.parameters.free]
        at = [names.index(name) for name in searched if name in names]
        nuisance = [i for i in range(len(names)) if i not in at]
        total = runs.sum(axis=0) + problem.prior_information
        back = np.eye(len(names))[at]
        back[:, nuisance] = -np.linalg.solve(total[np.ix_(nuisance, nuisance)], total[np.ix_(nuisance, at)]).T
        natural = phi[: size + 1].copy()
        natural[-1] = 1.0
        positive = np.append(problem.parameters.log[:size], False)
        scale = np.where(self.parameters.log & ~positive, natural, 1.0)[self.parameters.free]
        back *= scale[:, None]
        return np.asarray(back @ runs @ back.T)

    def _of_problem(self, problem: Problem) -> Floats:
        variances, phi, free = self.variances(problem), self.phi(problem), self.parameters.free
        if self.fit == "whole-runs":  # instants may leave their interval, and the headings are linear in them
            return _at(problem, phi, np.zeros_like(problem.effects.scale), variances, free)
        total = np.zeros(())
        for node, weight in zip(NODES, WEIGHTS / WEIGHTS.sum()):
            b = np.zeros_like(problem.effects.scale)
            problem.effects.of(b, SWITCHES)[...] = node
            total = total + weight * _at(problem, phi, b * (problem.effects.scale > 0), variances, free)
        return total

    def predicted(self, per_run: Floats) -> dict[str, Estimate]:
        """Predict the estimates that a fit would report: the model's values, with these runs' (R, p, p) intervals."""
        per_run = moving(per_run)
        dof = dict.fromkeys(self.estimands, float(max(len(per_run) - 1, 1)))
        if len(per_run) >= MIN_JACKKNIFE_RUNS:
            dof = {name: runs_that_carry(per_run, of.direction) for name, of in self.estimands.items()}
        return self.estimates(reported_covariance(per_run), dof)

    def estimates(self, covariance: Floats, dof: Mapping[str, float]) -> dict[str, Estimate]:
        """Make estimates with this covariance (p, p) of the search's coordinates, as fits tell them."""
        estimates = {}
        for name, of in self.estimands.items():
            form = Estimate.from_log if of.on_log else Estimate.from_stderr
            estimates[name] = form(of.value, stderr_along(covariance, of.direction), dof[name], of.unit)
        return estimates


def _at(problem: Problem, phi: Floats, b: Floats, variances: Floats, free: NDArray[np.int64]) -> Floats:
    headings, by_phi, by_run = derivatives(problem, phi, b)
    gram = problem.inner(by_phi, by_run, 0.0 * headings).keep(free)
    return linear_mixed.weigh(gram, problem.effects, variances).hessian


def reported_covariance(per_run: Floats) -> Floats:
    """Return the covariance (p, p) that a fit to runs of these informations (R, p, p) reports, on average: from
    MIN_JACKKNIFE_RUNS on the jackknife over runs, (R - 1)/R sum (A - A_i)^-1 A_i A^-1, as run i moves the solution by
    (A - A_i)^-1 g_i, and g_i has covariance A_i - A_i A^-1 A_i; with fewer the larger of it and the likelihood's."""
    total = per_run.sum(axis=0)
    inverse = linear_mixed.covariance_of(total)
    runs = len(per_run)
    if runs < MIN_INTERVAL_RUNS:
        return inverse
    without = np.array([linear_mixed.covariance_of(total - information) for information in per_run])
    jackknife = (runs - 1) / runs * np.sum(without @ per_run, axis=0) @ inverse
    jackknife = 0.5 * (jackknife + jackknife.T)
    if runs >= MIN_JACKKNIFE_RUNS:
        return np.asarray(jackknife)
    grow = np.sqrt(np.maximum(np.diagonal(jackknife) / np.maximum(np.diagonal(inverse), 1e-300), 1.0))
    return np.asarray(inverse * np.outer(grow, grow))


def moving(per_run: Floats) -> Floats:
    """Drop the runs that say nothing of the parameters: fits set rest records aside."""
    return per_run[np.any(per_run != 0.0, axis=(1, 2))]


def stderr_along(covariance: Floats, direction: Floats) -> float:
    return float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))


@dataclass(frozen=True)
class Intervals:
    """Intervals to narrow: the worth of `counts` (K,), how often each candidate is run, is the mean logarithm by which
    the standard errors of the `wanted` directions (p, m) have come down, until all are below the `goal` if there is
    one; `information` (K, p, p) of the candidates, `known` (p, p) beforehand."""

    information: Floats
    known: Floats
    wanted: Floats
    goal: float | None = None

    def scores(self, counts: Floats, extras: NDArray[np.int64] | None = None) -> Floats:
        """Return the worth with one more run, each of `extras` (B,) in turn, (B,); as it is, (1,)."""
        spread = self._spread(counts, extras)
        unit = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        shape = np.linalg.slogdet(spread / unit[:, :, None] / unit[:, None, :])[1]
        return np.asarray(-(np.log(unit).sum(axis=1) + 0.5 * shape) / self.wanted.shape[1])

    def reached(self, counts: Floats) -> bool:
        if self.goal is None:
            return False
        return bool(np.all(np.sqrt(np.diagonal(self._spread(counts, None)[0])) <= self.goal))

    def _spread(self, counts: Floats, extras: NDArray[np.int64] | None) -> Floats:
        """Covariance (B, m, m) of the wanted directions as the jackknife over runs tells it: see
        `reported_covariance`. A parameter that hangs on a single run is not known."""
        base = np.tensordot(counts, self.information, axes=1) + self.known
        more = np.zeros((1, *base.shape)) if extras is None else self.information[extras]
        after = base + more
        inverse = np.linalg.inv(after)
        ran = np.flatnonzero(counts)
        moves = np.linalg.inv(after[:, None] - self.information[ran]) @ self.information[ran]
        total = inverse @ self.known + np.tensordot(moves, counts[ran], axes=((1,), (0,)))
        covariance = (total + np.linalg.inv(after - more) @ more) @ inverse
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        return np.asarray(self.wanted.T @ covariance @ self.wanted)


USUAL_NOISE_DEG, USUAL_SCATTER = 1.0, 0.03  # of a compass in a pool, of the thrust of small motors
NO_RIVALS = "The diagnosis leaves no rivals open to split, so the runs are chosen to narrow the intervals."


@dataclass(frozen=True)
class Ambiguity:
    """An effect that a diagnosis named, and another that its runs cannot exclude."""

    effect: str
    rival: str


@dataclass(frozen=True)
class PriorResults:
    """The model with all that is believed to act, its estimates by label, the logs' noise [degrees] and scatter (usual
    ones where the file does not say), how many runs were fitted, open doubts, a gyro's noise; what is `random` in
    driven runs, by name, in base units; the command delay [s], which is no effect of the model; effects that the fit
    `proposed` and no diagnosis judged, with their deviance; of what is steered the mean `speed` of its logs [m/s] and
    the `side` of positive rudder (1 to starboard), None where the file does not say."""

    stored: StoredModels
    model: Model
    now: Mapping[str, Estimate]
    noise_deg: float
    scatter: float
    used: int
    doubts: tuple[Ambiguity, ...] = ()
    notes: tuple[str, ...] = ()
    rate_noise_deg_s: float | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)
    file: ModelFile | None = None
    diagnosis: DiagnosisFile | None = None
    command_delay: float = 0.0
    speed: float | None = None
    side: int | None = None


def read_prior_results(model: Source, diagnosis: Source | None) -> PriorResults:
    name = printable(model.name)
    file, stored = file_and_models(read_plain(model, "JSON", ModelError), name)
    chosen, late = stored.undelayed, stored.command_delay
    entry, symbols = file.chosen, file.dof.symbols
    drag = {symbols.inertia: entry.inertia, symbols.quadratic: entry.quadratic, symbols.linear: entry.linear}
    added = {f"{effect.name} {n}": entry for effect in file.effects for n, entry in effect.parameters.items()}
    now = _some({**drag, ANGLE: entry.ratio or file.ratio, **added}) | _nomoto_now(file.nomoto.get("first_order"))
    spread = file.gain_scatter.value if file.gain_scatter else None
    notes: tuple[str, ...] = ()
    doubts: tuple[Ambiguity, ...] = ()
    judged, unit = None, stored.model.moment_unit
    if diagnosis is not None:
        judged, new_effects, estimates, open_rivals = _read_diagnosis(diagnosis, stored)
        new_effects = {effect: values for effect, values in new_effects.items() if effect not in stored.effects}
        base = _some({name: moved.after for name, moved in judged.base.items()}) if new_effects else {}
        if base:
            at = [base[n].value if n in base else v for n, v in zip(chosen.short_names, chosen.theta)]
            chosen = chosen.with_theta(at)
        for effect, values in new_effects.items():
            chosen = chosen.with_effect(effect, values)
        late = late if DELAY not in new_effects else 0.0  # which is the same delay
        now = {**now, **base, **estimates}
        if new_effects:
            now.pop(ANGLE, None)
        doubts = tuple(doubt for doubt in open_rivals if not lacking(doubt.rival, unit))
        unlogged = [(doubt.rival, lacking(doubt.rival, unit)[0]) for doubt in open_rivals if doubt not in doubts]
        needs = "{} is left open: it needs the column {!r}, which planned runs do not have."
        notes = (*(needs.format(*rival) for rival in unlogged), *(() if doubts else (NO_RIVALS,)))
    out = "{} is left out: it acts by the column {!r}, which planned runs, on the spot, do not have."
    absent = [(term.name, lacking(term.name, unit)) for term in chosen.terms]
    notes += tuple(out.format(effect, columns[0]) for effect, columns in absent if columns)
    chosen = replace(chosen, terms=tuple(term for term in chosen.terms if not lacking(term.name, unit)))
    rates = (sensor.noise for sensor in file.channels if sensor.used and sensor.quantity == stored.dof.velocity)
    rate = next((noise.value for noise in rates if noise is not None), None)
    random = {name: entry.value for name, entry in file.random.items() if entry.value is not None}
    noise, scatter, rate = (value if value is not None and value > 0 else None for value in (file.noise, spread, rate))
    return PriorResults(
        stored, chosen, now, noise or USUAL_NOISE_DEG, scatter or USUAL_SCATTER, file.runs.used, doubts, notes, rate,
        random, {} if diagnosis is not None else file.proposed, file, judged, late, *_steered(file, chosen),
    )  # fmt: skip


def _nomoto_now(first_order: object) -> dict[str, Estimate]:
    """Sizes of K and T as the file of a steered vehicle tells them."""
    entries = first_order if isinstance(first_order, Mapping) else {}
    ends = {name: sorted(map(abs, entry["ci95"])) for name, entry in entries.items()}
    return {
        name: Estimate(abs(entry["value"]), entry["stderr"], (ends[name][0], ends[name][1]), entry["unit"])
        for name, entry in entries.items()
    }


def _steered(file: ModelFile, model: Model) -> tuple[float | None, int | None]:
    """The speed [m/s] and the side of positive rudder of a steered vehicle; None where its file does not say."""
    usual = [term.values[1] for term in model.terms if term.name == "rudder-inflow"]
    speeds = [value for value in (*usual, file.nomoto.get("speed_m_s")) if isinstance(value, float)]
    sides = {"starboard": 1, "port": -1}
    return next(iter(speeds), None), sides.get(str(file.nomoto.get("positive_rudder_turns_to")))


def covariance_now(fitting: Fitting, now: Mapping[str, Estimate]) -> Floats | None:
    """Return the covariance (p, p) of the search's coordinates as the model's file tells it, without the delay; None
    where a parameter has no standard error.

    Files hold no correlations; that of inertia and quadratic drag follows from the interval of their ratio."""
    names = [name for name in fitting.estimands if name not in DERIVED]
    if any(name not in now or not now[name].stderr > 0 for name in names):
        return None
    size = {n: now[n].stderr / (abs(now[n].value) if fitting.estimands[n].on_log else 1.0) for n in names}
    covariance = np.diag([size[n] ** 2 for n in names])
    symbols = fitting.model.dof.symbols
    if ANGLE in now and symbols.quadratic in names:
        i, k = names.index(symbols.inertia), names.index(symbols.quadratic)
        relative = now[ANGLE].stderr / now[ANGLE].value
        shared = 0.5 * (size[symbols.inertia] ** 2 + size[symbols.quadratic] ** 2 - relative**2)
        most = 0.999 * size[symbols.inertia] * size[symbols.quadratic]
        covariance[i, k] = covariance[k, i] = float(np.clip(shared, -most, most))
    return covariance


def information_now(fitting: Fitting, covariance: Floats | None) -> Floats:
    """Return the information (p, p) before the campaign: the earlier runs' by their covariance, else next to none."""
    loose = fitting.loose_information
    loose[-1, -1] = 1.0 if fitting.fit == "diagnosis" else 12.0 * fitting.rate**2  # anywhere in a sample interval
    if covariance is not None:
        loose[:-1, :-1] += np.linalg.inv(covariance)
    return loose


def wanted_directions(fitting: Fitting, names: tuple[str, ...]) -> Floats:
    """Return the directions (p, m) whose intervals count, of `names` or all. Raises ModelError for another name."""
    estimands = fitting.estimands
    for name in names:
        if name not in estimands:
            raise ModelError(f"the model has no parameter {name!r} to plan for; it has {', '.join(estimands)}")
    return np.stack([estimands[name].relative for name in names or [n for n in estimands if n not in DERIVED]], axis=1)


def lacking(effect: str, unit: str) -> list[str]:
    """List the columns that an effect needs and planned runs do not have; a vehicle with a rudder has way on."""
    there = ("voltage", *(("surge", "rudder") if unit == STEERED else ()))
    return [need for need in effects.get(effect).columns if need not in there]


def _some(entries: Mapping[str, Given | None]) -> dict[str, Estimate]:
    """Those of which the interval is known; a file written by hand may have none."""
    return {name: entry.estimate for name, entry in entries.items() if entry is not None and entry.estimate is not None}


def _read_diagnosis(
    path: Source, stored: StoredModels
) -> tuple[DiagnosisFile, dict[str, tuple[float, ...]], dict[str, Estimate], list[Ambiguity]]:
    """The file, the effects with their values, estimates by label, and what is open."""
    file, force, where = DIAGNOSIS.read(path), stored.dof.words.force, printable(path.name)
    if file.dof is not stored.dof or file.force_unit is None:
        raise ModelError(
            f"{where}: expected what `automarine diagnose` writes of {stored.dof.name} runs, diagnosis.json"
        )
    if file.force_unit != stored.model.moment_unit:
        raise ModelError(
            f"{where}: a diagnosis of {force}s in {format_value(file.force_unit)}, but {stored.source} is a model of "
            f"{force}s in {stored.model.moment_unit}; give the diagnosis of this model"
        )
    values_by_effect, estimates, doubts = dict[str, tuple[float, ...]](), dict[str, Given | None](), []
    for i, entry in enumerate(file.effects):
        name = _known(entry.name, f"{where}: effects[{i}]")
        values, effect = [], effects.get(name)
        for key, parameter in zip(effect.names_in(stored.dof), effect.parameters):
            number = estimates[f"{name} {key}"] = entry.parameters.get(key)
            estimate = number and number.estimate
            if not estimate and not parameter.optional:
                raise ModelError(f"{where}: effects[{i}].parameters: {key} has no value; expected an estimate")
            values.append(estimate.value if estimate else parameter.start)
        values_by_effect[name] = tuple(values)
        for j, rival in enumerate(entry.rivals):
            if not rival.name.startswith(PREFIX):  # a curve that was not fitted has no size to look for
                doubts.append(Ambiguity(name, _known(rival.name, f"{where}: effects[{i}].rivals[{j}]")))
    return file, values_by_effect, _some(estimates), doubts


def _known(name: str, where: str) -> str:
    if name not in effects.names() and not name.startswith(PREFIX):
        raise ModelError(f"{where}: name: found {format_value(name)}, expected one of {', '.join(effects.names())}")
    return name
