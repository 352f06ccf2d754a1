"""How the runs of a campaign will be fitted: the likelihood of `fit-yaw` or of `diagnose` on runs that are not yet
made.

Noise, scatter and what differs from run to run are those that the fits estimate; here they are given.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from automarine_cli.diagnosis.study import Study
from automarine_cli.dofs import Dof
from automarine_cli.filters.course import make_course
from automarine_cli.fits.driven import driven_problem, starts_near
from automarine_cli.fits.identify import starts_at_rest
from automarine_cli.fits.innovations_problem import DrivenProblem
from automarine_cli.fits.mixed_model import Problem
from automarine_cli.fits.run_effects import GAIN, SWITCHES
from automarine_cli.fits.step_problem import step_problem
from automarine_cli.fits.step_response import step_data
from automarine_cli.fits.whole_runs import varying_terms, whole_run_problem
from automarine_cli.models.closed_form import response
from automarine_cli.models.yaw_model import BASE_TERMS, Term, YawModel
from automarine_cli.planning.candidates import Candidate
from automarine_cli.quantities import Floats
from automarine_cli.runs.half_turn import MARGIN_IN_SIGMA, MOST_REST
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import WINDOW, Batch, make_batch
from automarine_cli.simulation.rollout import Start, simulate, step_for

Fit = Literal["whole-runs", "half-turns", "diagnosis"]

HELD_OUT = 0.25
"""Share of the runs that `diagnose` does not fit, where no others are given to be held out."""
QUIET = 1e-5
"""Disturbance moment of a pool, as a factor of the fits: none."""


@dataclass(frozen=True)
class Logger:
    """What a log on paper looks like: `rate` [Hz], `rest` [s] of zero moment first, `unit` of the moment, `voltage` [V]
    of the supply or None where the logs have no such column; of `channels` only a velocity is a column of its own."""

    dof: Dof
    unit: str
    rate: float
    rest: float
    voltage: float | None
    channels: tuple[str, ...] | None

    @property
    def signals(self) -> tuple[str, ...]:
        """The columns beside position and command."""
        return () if self.voltage is None else ("voltage",)

    def run(self, candidate: Candidate) -> Run:
        """The run that the logger would bring home; its heading, still to be measured, stands still.

        A command shows from the first sample at or after its instant, as in simulated campaigns.
        """
        lengths = [self.rest, *(seconds for _, seconds in candidate.commands)]
        ends = np.round(np.cumsum(lengths) * self.rate).astype(int)
        moment = np.zeros(int(ends[-1]))
        for (level, _), begin, end in zip(candidate.commands, ends[:-1], ends[1:]):
            moment[begin:end] = level
        time = candidate.clock + np.arange(len(moment)) / self.rate
        heading = np.full(len(moment), np.deg2rad(candidate.start_heading))
        volts = candidate.voltage if candidate.voltage is not None else self.voltage
        extras = {} if volts is None else {"voltage": np.full(len(moment), volts)}
        if self.dof.velocity in (self.channels or ()):
            extras[self.dof.velocity] = np.zeros(len(moment))
        return Run(candidate.label, "plan", time, heading, moment, self.unit, extras, dof=self.dof)


def alike(candidates: Sequence[Candidate]) -> dict[str, list[int]]:
    """Places of the candidates of each kind: laid out together, none is padded to the length of a slow ramp."""
    groups: dict[str, list[int]] = {}
    for place, candidate in enumerate(candidates):
        groups.setdefault(candidate.kind, []).append(place)
    return groups


@dataclass(frozen=True)
class Fitting:
    """A model, the fit that its parameters are wanted from, and what is known of the logs.

    `noise` of the heading [rad], `scatter` of the thrust from run to run, `rate` [Hz] of the logger, `rest` [s] before
    each run, `voltage` [V] of the supply where the logs have that column. `frame` is the drag about which runs are laid
    out, by default the model's own: given, it is the same for models that are tried one after the other. `rate_noise`
    [per s] is that of a velocity sensor, None where the logs have none. Where something is `random` (disturbance, noise
    of the thrust: by the names of driven fits, in base units), runs are fitted by the innovations of a filter.
    """

    model: YawModel
    fit: Fit
    noise: float
    scatter: float
    rate: float = 10.0
    rest: float = 3.0
    voltage: float | None = None
    frame: YawModel | None = None
    rate_noise: float | None = None
    random: Mapping[str, float] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...] | None:
        """The sensors that count, None for the position alone."""
        return None if self.rate_noise is None else self.model.dof.channels

    @cached_property
    def base(self) -> YawModel:
        """The model's drag alone, which every fit has."""
        return self.frame or replace(self.model, terms=self.model.terms[: len(BASE_TERMS[self.number])])

    @cached_property
    def number(self) -> str:
        """ "1", "2" or "3", by the drag terms that the model begins with."""
        names = tuple(term.name for term in self.model.terms)
        return max((n for n, own in BASE_TERMS.items() if names[: len(own)] == own), key=lambda n: len(BASE_TERMS[n]))

    @property
    def fitted(self) -> float:
        """Share of the runs that is fitted: `diagnose` holds a quarter out to judge by."""
        return 1.0 - HELD_OUT if self.fit == "diagnosis" else 1.0

    @cached_property
    def logger(self) -> Logger:
        """How the runs will be logged."""
        model = self.model
        return Logger(model.dof, model.moment_unit, self.rate, self.rest, self.voltage, self.channels)

    def problem(self, candidates: Sequence[Candidate]) -> Problem:
        """The likelihood of the candidates' runs; theta ends with the common instant of the switches."""
        if self.fit == "half-turns":
            return self._half_turns(candidates)
        if self.fit == "diagnosis":
            drag = (self.base.inertia, self.base.terms)
            return _study(tuple(candidates), drag, self.logger).problem(self.model)
        runs = [self.logger.run(one) for one in candidates]
        largest = max(float(np.abs(run.command).max()) for run in runs)
        batch = make_batch(runs, min(0.1, step_for(self.model, largest)), channels=self.channels)
        return whole_run_problem(self.model, batch, np.array([starts_at_rest(run) for run in runs]))

    def driven(self, candidates: Sequence[Candidate]) -> tuple[DrivenProblem, Floats]:
        """The likelihood of the candidates' runs where something is random, and its phi; the readings are one draw of
        it, for a filter learns from what it did not expect too."""
        dof, runs = self.model.dof, [self.logger.run(one) for one in candidates]
        largest, drawn = max(float(np.abs(run.command).max()) for run in runs), np.random.default_rng(0)
        batch = make_batch(runs, min(0.1, step_for(self.model, largest)), self.logger.signals)
        shown = simulate(self.model, batch, start=self._drawn(batch, drawn))
        states = dict(zip(dof.channels, (shown.position[0], shown.velocity[0])))
        sizes, noisy = dict(zip(dof.channels, (self.noise, self.rate_noise or 0.0))), []
        for i, run in enumerate(runs):
            read = {
                name: states[name][i, : len(run)] + sizes[name] * drawn.standard_normal(len(run))
                for name in self.channels or (dof.position,)
            }
            noisy.append(replace(run, position=read.pop(dof.position), extras={**run.extras, **read}))
        at_rest = np.array([starts_at_rest(run) for run in runs])
        course = make_course(noisy, at_rest, self.logger.signals, channels=self.channels)
        problem = driven_problem(self.model, course)
        return problem, problem.search(starts_near(problem, [self.model.theta], dict(self.random)))[0]

    def _drawn(self, batch: Batch, drawn: np.random.Generator) -> Start:
        """What differs from run to run, drawn by the sizes of what is `random`, held over the batch's windows."""
        size, lasting, thrust = (
            self.random.get(f"{self.model.dof.name}.{name}", least)
            for name, least in (("disturbance", 0.0), ("disturbance-time", 1.0), ("thrust-noise", 0.0))
        )
        runs, windows = len(batch.names), batch.windows
        held = batch.length[..., None] * (batch.window[..., None] == np.arange(windows))
        pushed = np.einsum("rm,rmw->rw", np.abs(batch.force[0]), held) / np.maximum(held.sum(axis=1), 1e-9)
        keep = np.exp(-WINDOW / lasting)
        fresh = size * drawn.standard_normal((runs, windows))
        for w in range(1, windows):
            fresh[:, w] = keep * fresh[:, w - 1] + np.sqrt(1.0 - keep**2) * fresh[:, w]
        uneven = thrust * pushed / np.sqrt(WINDOW) * drawn.standard_normal((runs, windows))
        return Start(
            batch.position[:, 0],
            log_gain=self.scatter * drawn.standard_normal((1, runs)),
            disturbance=(self.model.inertia * fresh + uneven)[None],
        )

    def _half_turns(self, candidates: Sequence[Candidate]) -> Problem:
        """As `fit-yaw` trims them: from the rest to the first half-turn, less three standard deviations."""
        drag = self.model.drag()
        names, moments, intervals = list[str](), list[float](), list[float]()
        times, headings, velocities = list[Floats](), list[Floats](), list[Floats]()
        for one in candidates:
            run = self.logger.run(one)
            first = int(np.argmax(run.command != 0))
            time = np.asarray((np.arange(len(run)) - first + 0.5) / self.rate)
            heading, velocity = response(time, one.commands[0][0], self.model.inertia, *drag)
            kept = (np.abs(heading) <= np.pi - MARGIN_IN_SIGMA * self.noise) & (
                np.arange(len(run)) >= first - MOST_REST
            )
            names.append(one.label)
            times.append(time[kept])
            headings.append(heading[kept])
            velocities.append(velocity[kept])
            moments.append(one.commands[0][0])
            intervals.append(1.0 / self.rate)
        data = step_data(names, times, headings, moments, intervals, self.model.dof)
        return step_problem(data if self.rate_noise is None else data.rated(velocities), self.number)

    @cached_property
    def on_log(self) -> tuple[bool, ...]:
        """Which parameters, and the switches' instant after them, are searched and told on the logarithm."""
        return tuple(bool(one) for one in self.problem([Candidate("step", "any", ((1.0, 3.0),))]).positive)

    def phi(self, problem: Problem) -> Floats:
        """Where the likelihood is looked at: the model's parameters in the search's coordinates, switches in the
        middle of their intervals."""
        return problem.search(np.append(self.model.theta, 0.0))

    def variances(self, problem: Problem) -> Floats:
        """Logarithms of noise and factors, as the linear half of the mixed model takes them."""
        own = problem.effects
        factors = {GAIN: max(self.scatter, own.limits[own.factor_names.index(GAIN)][0]), SWITCHES: 1.0}
        for name in varying_terms(self.model):
            amplitude = next(term.values[0] for term in self.model.terms if term.name == name)
            largest = float(own.of(own.scale, name).max())
            factors[name] = max(amplitude / (np.sqrt(2.0) * largest), QUIET)
        noises = [self.noise] if self.rate_noise is None else [self.noise, self.rate_noise]
        return np.log([*noises, *(factors.get(name, QUIET) for name in own.factor_names)])


@lru_cache(maxsize=64)
def _study(candidates: tuple[Candidate, ...], drag: tuple[float, tuple[Term, ...]], logger: Logger) -> Study:
    """The candidates as a diagnosis would have them; kept, since many models are tried on the same runs."""
    base = YawModel(*drag, logger.unit, logger.dof)
    runs = tuple(logger.run(one) for one in candidates)
    return Study(runs, base, False, logger.signals, channels=logger.channels)
