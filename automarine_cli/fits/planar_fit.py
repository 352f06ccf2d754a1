"""The fit of surge, sway and yaw together: which structure the logs ask for, its parameters, and what they rest on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits.driven import (
    PLACE,
    ForecastScore,
    Judgement,
    large_disturbance,
    left_out_predictions,
    starts_near,
    worth_of,
)
from automarine_cli.fits.innovations import ITERATIONS, DrivenProblem, InnovationsFit, fit_innovations, randomness
from automarine_cli.fits.known import NOTHING_KNOWN, Known
from automarine_cli.fits.linear_mixed import bounded_solution
from automarine_cli.fits.planar_structure import PLACES, Observed, Structure, rough_sizes, rough_velocities
from automarine_cli.fits.whole_runs import estimate_of, run_covariance, run_dof
from automarine_cli.models.parameter import Parameter, Parameters, Prior
from automarine_cli.models.planar import FORCES, VELOCITIES, PlanarModel, Tied
from automarine_cli.models.store import planar_json, units
from automarine_cli.models.yaw_model import COMMAND_DELAY
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ExcludedRun, Run, runs_json


def forecasts_of(problem: DrivenProblem, fit: InnovationsFit) -> Judgement:
    """Predictions of each run by the parameters that the other runs give, of all that is judged."""
    at = {channel.quantity: c for c, channel in enumerate(problem.course.channels)}
    placed = set(PLACES) <= at.keys()
    names = [YAW.position, *(PLACES if placed else [n for n in (SURGE.velocity, SWAY.velocity) if n in at])]
    heading, *remaining = left_out_predictions(problem, fit, [at[name] for name in names], thinned=True)
    with np.errstate(over="ignore", invalid="ignore"):  # where predictions run away
        worth = {name: worth_of(predicted) for name, predicted in zip(names[1:], remaining)}
        if placed:
            worth = {PLACE: _distances(list(worth.values()))}
    (inertia,) = problem.model.inertia_matrix(fit.of_model[None])
    large = large_disturbance(problem.course, np.diagonal(inertia), fit.of_chance)
    runs = len(problem.course.names)
    return Judgement({YAW.position: worth_of(heading), **worth}, runs, heading, problem.course, large=large)


def _distances(by_axis: Sequence[tuple[ForecastScore, ...]]) -> tuple[ForecastScore, ...]:
    """Root mean squares of distances on the water, from those along its axes."""
    sizes = ("error", "constant_rate", "constant")
    return tuple(
        replace(
            north,
            count=min(north.count, east.count),
            **{name: float(np.hypot(getattr(north, name), getattr(east, name))) for name in sizes},
        )
        for north, east in zip(*by_axis)
    )


FULLY = 3  # neighbours of a structure that are fitted, at most
HOW = "by the innovations of a filter"


@dataclass(frozen=True)
class Estimated:
    """What a `fit` found for one model: values in `model`, `covariance` (f, f) of its free parameters with the run as
    the unit."""

    model: Tied
    covariance: Floats = field(repr=False)
    fit: InnovationsFit = field(repr=False)

    @property
    def random(self) -> dict[str, float]:
        """Sizes of what is random, by name."""
        return self.fit.of_chance

    @cached_property
    def delay(self) -> Estimate:
        """Command delay [s] after the middle of the sample interval in which a command changed."""
        fit, place = self.fit, self.fit.names.index(COMMAND_DELAY)
        return estimate_of(
            fit, run_covariance(fit), place, "s", None if len(fit.left_out) > 1 else float(self.readings)
        )

    @property
    def readings(self) -> int:
        return sum(self.fit.readings.values())

    @property
    def known(self) -> dict[str, float]:
        """Values of all parameters of the model by qualified name."""
        return dict(zip(self.model.model.parameter_names, self.model.model.theta.tolist()))

    def estimates(self, runs: int, prior: Known = NOTHING_KNOWN) -> dict[str, Estimate]:
        """Every parameter that was identified in so many `runs` or follows one, by qualified name."""
        spread, model, fit = self.model.spread, self.model.model, self.fit
        deviation = np.sqrt(np.einsum("pf,fg,pg->p", spread, self.covariance, spread))
        unit, estimates = units(model), {}
        for name, value, error, row in zip(model.parameter_names, model.theta.tolist(), deviation.tolist(), spread):
            if not row.any():
                continue
            i, freedom = int(np.argmax(np.abs(row))), float(self.readings - len(self.model.free))
            if runs > 1:
                freedom = run_dof(fit, np.eye(len(fit.theta))[i])
            if fit.parameters.log[i]:
                estimate = Estimate.from_log(value, error / value, freedom, unit[name])
            else:
                estimate = Estimate.from_stderr(value, error, freedom, unit[name])
            before = name in prior.parameters
            estimates[name] = replace(estimate, known=before, at_bound=i in fit.at_bound and not before)
        return estimates

    @property
    def criterion(self) -> float:
        """Bayesian information criterion, the smaller the better; Schwarz (1978), doi 10.1214/aos/1176344136."""
        return float(-2.0 * self.fit.log_likelihood + len(self.model.free) * np.log(max(self.readings, 2)))


@dataclass(frozen=True)
class Tried:
    structure: Structure
    estimated: Estimated


def search(estimator: "PlanarLikelihood") -> tuple[Tried, ...]:
    """Structures that were tried, the best one first, then in the order of their criterion.

    From the simplest one on, those neighbours are fitted briefly that promise most by the slope and curvature of the
    likelihood; the best of them is fitted to the end and taken as long as it is better.
    """
    simplest = Structure.simplest(estimator.observed)
    best = Tried(simplest, estimator.estimate(simplest.model(estimator.rough)))
    tried = {str(simplest): best}
    while True:
        new = [structure for structure in best.structure.neighbours() if str(structure) not in tried]
        chosen = [
            Tried(structure, estimator.estimate(*estimator.toward(model, best.estimated.random, promise), BRIEF))
            for structure, model, promise in _promising(best, new, estimator)
        ]
        tried |= {str(trial.structure): trial for trial in chosen}
        better = min(chosen, key=lambda trial: trial.estimated.criterion, default=best)
        if better is not best:
            better = replace(better, estimated=estimator.estimate(better.estimated.model, better.estimated.random))
            tried[str(better.structure)] = better
        if better.estimated.criterion >= best.estimated.criterion:
            return tuple(sorted(tried.values(), key=lambda trial: trial.estimated.criterion))
        best = better


def _promising(
    best: Tried, new: Sequence[Structure], estimator: "PlanarLikelihood"
) -> list[tuple[Structure, Tied, "Promise"]]:
    """The neighbours of the best structure that promise to be better, with their models and what they promise.

    What a law of drag gains in place of another is at most what it gains beside it.
    """
    values, rough = best.estimated.known, estimator.rough
    models = [structure.beside(values, rough) for structure in new]
    added = [tuple(name for name in model.free if name not in best.estimated.model.free) for model in models]
    promises = estimator.promises(best.structure.widest.beside(values, rough), best.estimated, added)
    have, price = len(best.estimated.model.free), np.log(max(best.estimated.readings, 2))
    promised = [
        2.0 * promise.gain - price * (len(model.free) - have) if 2.0 * promise.gain > price * len(names) else -np.inf
        for promise, model, names in zip(promises, models, added)
    ]
    order = np.argsort(promised)[::-1][:FULLY]
    return [(new[i], models[i], promises[i]) for i in order if np.isfinite(promised[i])]


@dataclass(frozen=True, repr=False)
class PlanarFit(Shown):
    """The structures that were `tried` on `runs`, the likeliest one first, and the `best`: of what `use` it is, and the
    sentence that says why (`fitted_because`); what was set aside; sentences on what thrusters at their `limits` did not
    give; the `prior`: what was known beforehand."""

    tried: tuple[Tried, ...]
    best: Tried
    use: Judgement
    fitted_because: str
    runs: tuple[Run, ...]
    observed: Observed
    set_aside: tuple[ExcludedRun, ...] = ()
    limits: tuple[str, ...] = ()
    prior: Known = NOTHING_KNOWN

    @property
    def found(self) -> Estimated:
        return self.best.estimated

    @property
    def structure(self) -> Structure:
        return self.best.structure

    @property
    def model(self) -> PlanarModel:
        return self.found.model.model

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        return self.found.estimates(len(self.runs), self.prior)

    @property
    def because(self) -> str:
        if len(self.tried) == 1:
            return "No other structure was tried."
        first, second = self.tried[:2]
        which = "this one" if first.structure == self.structure else f"{first.structure}"
        behind = f"{second.structure}, is {second.estimated.criterion - first.estimated.criterion:.1f} behind"
        best = f"{which} has the best evidence (Bayesian information criterion)"
        return f"Of {len(self.tried)} structures {best}; the next, {behind}."

    @cached_property
    def valid_range(self) -> dict[str, list[float]]:
        """Smallest and largest velocity and command of the runs, by keys such as surge_m_s and force_X_N."""
        ranges: dict[str, list[float]] = {}
        rough = [rough_velocities(run) for run in self.runs]
        for dof in PLANAR.dofs:
            columns = [rates[dof.velocity] for rates in rough if dof.velocity in rates]
            if columns:
                velocities = np.concatenate(columns)
                ranges[dof.velocity_key] = [float(np.nanmin(velocities)), float(np.nanmax(velocities))]
            commands = np.concatenate([run.command_of(dof) for run in self.runs])
            column = dof.column(dof.command, dof.units.forces[1])
            ranges[column] = [float(commands.min()), float(commands.max())]
        return ranges

    def document(self, option: str) -> Document:
        return json_document("planar_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        estimates = {name: estimate.to_json() for name, estimate in self.estimates.items()}
        fit, free = self.found.fit, self.found.model.free
        return {
            **planar_json(self.model, estimates),
            COMMAND_DELAY: self.found.delay.to_json(),
            "fitted_to": "whole runs",
            "structure": str(self.structure),
            "structure_because": self.because,
            "estimated": HOW,
            "estimated_because": self.fitted_because,
            "assumptions": [asdict(assumption) for assumption in self.structure.assumptions],
            "channels": list(self.observed.channels),
            "random": {name: size for name, size in self.found.random.items() if name != COMMAND_DELAY},
            "prediction": self.use.to_json(YAW),
            "log_likelihood": fit.log_likelihood,
            "covariance": {"parameters": list(free), "matrix": self.found.covariance.tolist()},
            "valid_range": self.valid_range,
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.runs), self.set_aside, self.runs),
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        sentences = [*self.use.warnings(YAW)]
        if not self.found.fit.converged:
            sentences.append("The fit did not converge; give more or longer runs.")
        loose = [
            name
            for name, estimate in self.estimates.items()
            if name.partition(".")[2] in ("m_u", "m_v", "I_r") and estimate.stderr > 0.5 * abs(estimate.value)
        ]
        if loose:
            sentences.append(
                f"The logs hardly determine {', '.join(loose)}: the standard error is more than half the value. Add "
                "runs in which the commands change more often."
            )
        return (*sentences, *self.limits)


INERTIAS = (0.5, 1.0, 2.0)  # shares of rough inertias from which a first fit starts
SIZES = (0.02, 0.2)  # disturbances, as shares of the acceleration of the largest command, to start from
BRIEF = 4  # iterations of a brief fit
WORTH_IT = 0.02  # share of the errors of predictions that is worth another estimator or structure
FASTEST_WATER = 5.0  # m/s; no tidal current of a place where vehicles are tested is faster


@dataclass(frozen=True)
class Promise:
    """What more parameters promise: a `gain` in log likelihood, and all parameters by name where it is expected."""

    gain: float
    theta: Mapping[str, float]


@dataclass(frozen=True)
class PlanarLikelihood:
    """Fits of planar models to `runs`, of which the logs hold what is `observed`; `priors` are parameters that are
    known beforehand, by qualified name."""

    runs: tuple[Run, ...]
    observed: Observed
    priors: Mapping[str, Prior] = field(default_factory=dict)

    @cached_property
    def rough(self) -> dict[str, float]:
        return rough_sizes(self.runs)

    @cached_property
    def course(self) -> Course:
        moving = np.zeros(len(self.runs), dtype=bool)  # the first readings tell who is at rest
        return make_course(self.runs, moving, motion=PLANAR, channels=self.observed.channels)

    def problem(self, model: Tied) -> DrivenProblem:
        """The likelihood of a model: inertias on a logarithmic scale, own drags zero or more, couplings of any sign."""
        searched = [_searched(name, value, self.rough, self.course) for name, value in zip(model.free, model.theta)]
        parameters = Parameters((*searched, *self._random(model)))
        return DrivenProblem(model, self.course, parameters.informed(self.priors))

    def starts(self, problem: DrivenProblem, random: Mapping[str, float] | None) -> Floats:
        """Where a fit begins, (S, p): about the model's own values, with what is known of the `random` ones."""
        model = problem.model
        assert isinstance(model, Tied)
        middle = {chance.name: chance.value for chance in problem.parameters.nuisance}
        if random is not None:
            return starts_near(problem, [model.theta], random)
        heavy = np.array([name.endswith(("m_u", "m_v", "I_r")) for name in model.free])
        starts = []
        for inertia, size in product(INERTIAS, SIZES):
            pushed = {
                name: size / 0.05 * value / inertia if name.endswith("disturbance") else value
                for name, value in middle.items()
            }
            starts.append([*np.where(heavy, inertia * model.theta, model.theta), *pushed.values()])
        return problem.parameters.within(starts)

    def estimate(
        self, model: Tied, random: Mapping[str, float] | None = None, iterations: int = ITERATIONS
    ) -> Estimated:
        """The model fitted, from its own values and what is known of the `random` ones; one of few `iterations` leaves
        no run out. Raises FitError where no start leads anywhere."""
        problem = self.problem(model)
        starts, brief = self.starts(problem, random), iterations < ITERATIONS
        return _estimated(model, fit_innovations(problem, starts, iterations, brief))

    def choose(self, tried: Sequence[Tried]) -> tuple[Tried, Judgement, str]:
        """The best structure, or the simplest one where that predicts runs left out better by a share of WORTH_IT, with
        its predictions, and why.

        Where disturbances are as large as the commands, or sensors are smoothed, one reading after the other tells
        little of what the commands do: whatever answers within a reading or two then goes for the disturbance.
        """
        simplest = next((trial for trial in tried if trial.structure == Structure.simplest(self.observed)), tried[0])
        chosen, rival = (
            (trial, forecasts_of(self.problem(trial.estimated.model), trial.estimated.fit))
            for trial in (tried[0], simplest)
        )
        if chosen[1].score - rival[1].score >= WORTH_IT:
            chosen, rival = rival, chosen
        scores = chosen[1].score, rival[1].score
        if simplest is tried[0] or not chosen[1].worth[YAW.position] or not np.isfinite(scores[1]):
            return (*chosen, f"Fitted {HOW}.")
        share = float(np.expm1(scores[1] - scores[0]))
        misses = f"{100 * abs(share):.0f} % {'more' if share >= 0 else 'less'}"
        return (*chosen, f"Fitted {HOW}: of runs left out, 2 to 15 s ahead, the next best fit misses by {misses}.")

    def promises(self, wide: Tied, neighbour: Estimated, added: Sequence[tuple[str, ...]]) -> list[Promise]:
        """What each group of free parameters of `wide` is to be expected to gain beside those of an estimated
        `neighbour`, and where: half of the score statistic within bounds, Rao (1948), doi 10.1017/S0305004100023987."""
        problem = self.problem(wide)
        (phi,) = problem.parameters.search(self.starts(problem, neighbour.random))
        (slopes,) = problem.slopes(phi[None])
        gradient = slopes.gradient.sum(axis=0) + problem.prior_gradient(phi)
        hessian = slopes.information.sum(axis=0) + problem.prior_information
        names, free = [problem.parameters.names[i] for i in problem.free], {*neighbour.model.free, *neighbour.random}
        limits, origin = problem.parameters.limits[problem.free], phi[problem.free]

        def promise(more: tuple[str, ...]) -> Promise:
            chosen = np.array([name in free or name in more for name in names])
            h, g = hessian[np.ix_(chosen, chosen)], gradient[chosen]
            step = bounded_solution(h, g + h @ origin[chosen], limits[chosen]) - origin[chosen]
            there = phi.copy()
            there[problem.free[chosen]] += step
            theta = dict(zip(problem.parameters.names, problem.parameters.natural(there).tolist()))
            return Promise(float(g @ step - 0.5 * step @ h @ step), theta)

        without = promise(()).gain
        return [replace(expected, gain=expected.gain - without) for expected in map(promise, added)]

    def toward(self, model: Tied, random: Mapping[str, float], promised: Promise) -> tuple[Tied, Mapping[str, float]]:
        """The model, and what is `random`, as promised, where that is likelier than as they are."""
        problem = self.problem(model)
        (start,) = self.starts(problem, random)
        there = np.array([promised.theta.get(name, value) for name, value in zip(problem.parameters.names, start)])
        value, reached = problem.value(problem.parameters.search(np.stack([start, there])))
        if not reached > value:
            return model, random
        return model.with_theta(there[: len(model.free)]), dict(zip(problem.parameters.names, there.tolist()))

    def _random(self, model: Tied) -> tuple[Parameter, ...]:
        """What is random; of a degree of freedom of which nothing is read, next to nothing."""
        m = np.diagonal(model.model.inertia.matrix)
        forces = [_usual(self.rough, dof)[0] for dof in PLANAR.dofs]
        largest = np.abs(self.course.commanded).max(axis=(1, 2))
        pushes = np.maximum(largest, forces) / np.maximum(m, 1e-9)
        chances = randomness(self.course, pushes.tolist(), (), quiet=False)
        unread = tuple(f"{dof.name}." for dof in PLANAR.dofs if dof not in self.observed.dofs)
        return tuple(replace(c, upper=c.lower) if c.name.startswith(unread) else c for c in chances)


def _estimated(model: Tied, fit: InnovationsFit) -> Estimated:
    of_model = fit.parameters.of_model
    slopes = np.where(fit.parameters.log[of_model], fit.theta[of_model], 1.0)
    covariance = run_covariance(fit)[of_model, of_model] * np.outer(slopes, slopes)
    return Estimated(model.with_theta(fit.of_model), covariance, fit)


def _usual(rough: Mapping[str, float], dof: Dof) -> tuple[float, float]:
    """Usual force and speed along a degree of freedom, by its rough drags."""
    linear, quadratic = rough[dof.parameter("linear")], rough[dof.parameter("quadratic")]
    return linear**2 / quadratic, linear / quadratic


def _searched(name: str, value: float, rough: Mapping[str, float], course: Course) -> Parameter:
    """A parameter by its qualified name, as it is searched."""
    where, _, short = name.partition(".")
    if where == "current":
        return Parameter(name, value, -FASTEST_WATER, FASTEST_WATER, step=0.05)
    if where == PLANAR.name:  # inertia that couples
        return Parameter(name, value, step=0.1 * rough[YAW.parameter("inertia")])
    if name in [dof.parameter("inertia") for dof in PLANAR.dofs]:
        return Parameter(name, value, 1e-6, log=True, role="inertia")
    if name in rough:  # own drag
        return Parameter(name, value, 0.0, step=0.1 * rough[name])
    if "." in short:  # of an effect of the library
        effect_name, _, symbol = short.partition(".")
        effect, dof = effects.get(effect_name), DOFS[where]
        law = next(p for p, n in zip(effect.parameters, effect.names_in(dof)) if n == symbol)
        largest = float(np.abs(course.commanded[PLANAR.index(dof)]).max()) or 1.0
        return Parameter(name, value, law.lower, law.upper, law.log, max(law.scaled(law.start, largest), 1e-6))
    if short[0] in FORCES and short[1:2] == "_":  # coupling
        size, _ = _usual(rough, PLANAR.dofs[FORCES.index(short[0])])
        for letter in short[2:]:
            size /= _usual(rough, PLANAR.dofs[VELOCITIES.index(letter)])[1]
        return Parameter(name, value, step=0.1 * size)
    return Parameter(name, value, step=0.01 * _usual(rough, DOFS[where])[0])
