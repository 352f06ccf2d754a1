"""The fit of surge, sway and yaw together: which structure the logs ask for, its parameters, and what they rest on."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW
from automarine_cli.effects import Place
from automarine_cli.effects.rudder_race import RudderRace
from automarine_cli.effects.sensor_lag import SensorLag
from automarine_cli.effects.thruster_dead_band import ThrusterDeadBand
from automarine_cli.effects.thruster_imbalance import ARM, PARTS, ThrusterImbalance, acts_singly
from automarine_cli.effects.thruster_lag import OF_EACH
from automarine_cli.effects.thruster_limit import ThrusterLimit
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits.driven import (
    MIN_PROPOSED_GAIN,
    PLACE,
    STEERING_GEAR,
    THRUSTER_LAG,
    ForecastScore,
    Judgement,
    large_disturbance,
    left_out_predictions,
    start_of,
    starts_near,
    worth_of,
)
from automarine_cli.fits.innovations import (
    ITERATIONS,
    SETTLED_GAIN,
    DrivenProblem,
    Fit,
    fit_innovations,
    fits_of,
    randomness,
)
from automarine_cli.fits.linear_mixed import bounded_solution
from automarine_cli.fits.planar_start import (
    by_momentum,
    put_over,
    rough_sizes,
    rough_velocities,
    unbalanced,
    usual_gyration,
)
from automarine_cli.fits.planar_structure import (
    NORTH_EAST,
    OWN,
    SKEW,
    Candidate,
    Family,
    Observed,
    candidates,
    inertia_tied,
    structure_of,
    widest,
)
from automarine_cli.fits.stepwise import Judge, stepwise_search
from automarine_cli.fits.whole_runs import OutputErrorFit, covariance_json, result_of
from automarine_cli.models.model import COMMAND_DELAY, Model, Term
from automarine_cli.models.parameter import Parameter, Parameters, Priors
from automarine_cli.models.store import planar_json
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ExcludedRun, Run, runs_json

DEAD_BAND, STALL = "dead-band", "rudder-stall"
ACTUATORS = (
    (THRUSTER_LAG, 0), (THRUSTER_LAG, OF_EACH), (THRUSTER_LAG, 1), (DEAD_BAND, 0), (ThrusterDeadBand.name, 0),
    (ThrusterLimit.name, 0), (ThrusterImbalance.name, 0), (SensorLag.name, 0), (STEERING_GEAR, 0), (STEERING_GEAR, 1),
    (STALL, 0),
)  # fmt: skip
"""What may stand between command and reading, each in one law: a lag in propeller speed, that of each of two thrusters
if these are logged, or in thrust; a dead band, of the force or of each thruster; what else these may do; a heading that
is read late; a steering gear with a largest rate, or with a lag as well; a rudder that stalls."""
OF_RUDDERS = (STEERING_GEAR, STALL)
OF_BOTH = ((THRUSTER_LAG, 0), (DEAD_BAND, 0))  # what each of two thrusters does by itself where these are logged
LAGS = (THRUSTER_LAG, SensorLag.name)  # a delay stands for them as long as they are not known
STALL_SHARE = 0.65  # of the largest angle, from which a stall starts
GEARS = (
    tuple((float(rate), 0.0, 1.0) for rate in np.geomspace(0.05, 3.2, 25)),
    tuple((5.0, 1.0, float(lag)) for lag in np.geomspace(0.05, 1.6, 21)),
)
"""Steering gears from which a fit may start, by law: largest rate [rad/s], law, time constant [s]."""
START_LAG_S = 0.01  # from which a lag starts at least
IDLE_SHARE = 0.05  # of its usual size at which nothing is left of it
STEADY_LEVEL = 0.975  # at which the mean gain of a run has to exceed zero, by Student's t


Begin = tuple[Model, Mapping[str, float]]
"""Where a fit begins: a model, and the sizes of what is random."""


def forecasts_of(problem: DrivenProblem, fit: Fit) -> Judgement:
    """Predictions of each run by the parameters that the other runs give, of all that is judged."""
    at = {channel.quantity: c for c, channel in enumerate(problem.course.channels)}
    placed = set(NORTH_EAST) <= at.keys()
    names = [YAW.position, *(NORTH_EAST if placed else [n for n in (SURGE.velocity, SWAY.velocity) if n in at])]
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


MAX_NEIGHBOURS_FITTED = 2  # neighbours of a structure that are fitted, at most
ROUGHLY = 0.3  # gain in log likelihood to be expected below which a search goes on; what is chosen is fitted to its end
HOW = "by the innovations of a filter"


def price_of(fit: OutputErrorFit) -> float:
    """Give what a parameter has to gain in deviance; Schwarz (1978), doi 10.1214/aos/1176344136."""
    return float(np.log(max(sum(fit.mixed.readings.values()), 2)))


def criterion(fit: OutputErrorFit) -> float:
    """Give the Bayesian information criterion, the smaller the better."""
    return float(-2.0 * fit.mixed.log_likelihood + len(fit.model.free) * price_of(fit))


def model_content(fit: OutputErrorFit) -> dict[str, object]:
    """Give what every file of a planar model that was fitted holds: parameters with their intervals, and the covariance
    of the free ones with the run as the unit."""
    at = [fit.model.index(name) for name in fit.model.free]
    log, covariance = fit.mixed.parameters.log[at], fit.covariance[np.ix_(at, at)]
    return {
        **planar_json(fit.model, {name: estimate.to_json() for name, estimate in fit.by_name.items()}),
        "covariance": covariance_json(fit.model.free, fit.mixed.theta[at], log, covariance),
    }


@dataclass(frozen=True)
class Promise:
    """What more parameters promise: a `gain` in log likelihood, and all parameters by name where it is expected."""

    gain: float
    theta: Mapping[str, float]


def as_promised(candidate: Candidate, promise: Promise, fit: OutputErrorFit) -> bool:
    """Whether a linear drag is promised as the candidate has it: beside a quadratic one, of which most stays then, or
    in its place; true of every other candidate."""
    quadratic = dict(zip(OWN[1::3], OWN[2::3])).get(candidate.added[0])
    if quadratic not in fit.model.free:
        return True
    stays = promise.theta[quadratic] > 0.5 * fit.model.values[quadratic]
    return stays == (quadratic in candidate.model.free)


def both(leaders: Sequence[tuple[Candidate, Promise]], model: Model, family: Family) -> list[tuple[Candidate, Promise]]:
    """Return what two leading candidates for a `model` make together, and where it begins; nothing if they are two ways
    to have the same."""
    (first, promise), (second, more) = leaders
    wanted = {*first.model.free, *second.added} - ({*model.free} - {*second.model.free})
    theta = {**promise.theta, **{name: more.theta[name] for name in second.added}}
    together = [candidate for candidate in family(first.model) if {*candidate.model.free} == wanted]
    return [(candidate, Promise(promise.gain + more.gain, theta)) for candidate in together]


@dataclass(frozen=True)
class Round:
    """One look for what a model lacks: the model `before`, and the best one that was fitted, if any was."""

    before: OutputErrorFit
    best: OutputErrorFit | None


@dataclass(frozen=True)
class ByEvidence(Judge[OutputErrorFit, Round]):
    """Takes what improves the information criterion; `tried` collects what was fitted, by structure.

    Those candidates are fitted briefly that promise most by the slope and curvature of the likelihood, two of them also
    together, and the best to the end. Where none promises enough, linear drags take the place of quadratic ones: a
    slope tells little of what such an exchange gains.
    """

    likelihood: "PlanarLikelihood"
    tried: dict[str, OutputErrorFit] = field(default_factory=dict)
    most = 50

    def look(self, model: OutputErrorFit, number: int) -> Round:
        likelihood, price = self.likelihood, price_of(model)
        self.tried.setdefault(likelihood.structure_of(model.model), model)
        worth, swaps = list[tuple[float, Candidate, Promise]](), list[tuple[float, Candidate, Promise]]()
        for candidate, promise in likelihood.promised(model, likelihood.family):
            if likelihood.structure_of(candidate.model) in self.tried:
                continue
            more = len(candidate.model.free) - len(model.model.free)
            entry = 2.0 * promise.gain - price * more, candidate, promise
            if 2.0 * promise.gain > price * len(candidate.added) and as_promised(candidate, promise, model):
                worth.append(entry)
            elif more < len(candidate.added):
                swaps.append(entry)
        worth.sort(key=lambda entry: -entry[0])
        leaders = [(candidate, promise) for _, candidate, promise in worth[:MAX_NEIGHBOURS_FITTED] or swaps]
        together = both(leaders, model.model, likelihood.family) if len(worth) > 1 else []
        brief = likelihood.tried([*leaders, *together], model, NEIGHBOUR_ITERATIONS)
        best = min((estimated for _, estimated in brief), key=criterion, default=None)
        singly = [estimated for candidate, estimated in brief if candidate in [leader for leader, _ in leaders]]
        self.tried.update({likelihood.structure_of(estimated.model): estimated for estimated in singly})
        if best is not None and (worth or criterion(best) < criterion(model)):
            best = likelihood.estimate(best.model, best.mixed.of_chance, settled=ROUGHLY)
            self.tried[likelihood.structure_of(best.model)] = best
        return Round(model, best)

    def admissible(self, look: Round, first: Round) -> list[OutputErrorFit]:
        return [look.best] if look.best is not None and criterion(look.best) < criterion(look.before) else []


def with_actuators(likelihood: "PlanarLikelihood", base: OutputErrorFit) -> OutputErrorFit:
    """The fit with what stands between command and force, if the evidence asks for it, and in the mean of runs; else
    `base`."""
    tried, runs = likelihood.actuated(base, NEIGHBOUR_ITERATIONS), len(likelihood.runs)
    if not tried or runs < 2:
        return base
    best = min((estimated for _, estimated in tried), key=criterion)
    gained = best.mixed.density - base.mixed.density
    doubt = special.stdtrit(runs - 1, STEADY_LEVEL) * gained.std(ddof=1) / np.sqrt(runs)
    if gained.mean() <= doubt or criterion(best) > criterion(base) - MIN_PROPOSED_GAIN:
        return base
    return likelihood.estimate(best.model, best.mixed.of_chance, settled=ROUGHLY)


def search(likelihood: "PlanarLikelihood") -> tuple[OutputErrorFit, ...]:
    """Return what was tried, the best one first, then in the order of their criterion, from the simplest model on."""
    judge, base = ByEvidence(likelihood), likelihood.estimate(likelihood.simplest, settled=ROUGHLY)
    while (wide := with_actuators(likelihood, base)) is not base:
        judge.tried[likelihood.structure_of(base.model)], base = base, wide
    stepwise_search(judge, base)
    return tuple(sorted([*judge.tried.values(), *without_needless(likelihood, judge.tried.values())], key=criterion))


def without_needless(likelihood: "PlanarLikelihood", tried: Iterable[OutputErrorFit]) -> Iterator[OutputErrorFit]:
    """Fit the best of what was `tried` without an actuator's term that the evidence asked for before it knew the hull,
    and does not any more; until it asks for all."""
    best: OutputErrorFit | None = min(tried, key=criterion)
    while best is not None:
        model, random = best.model, best.mixed.of_chance
        added = [term for term in model.terms if term.name in {*dict(ACTUATORS)} - {*likelihood.with_effects}]
        fewer = [(replace(model, terms=tuple(t for t in model.terms if t is not term)), random) for term in added]
        fits = [fit for fit in likelihood.brief(fewer, NEIGHBOUR_ITERATIONS) if fit is not None]
        best = min((fit for fit in fits if criterion(fit) < criterion(best)), key=criterion, default=None)
        if best is not None:
            yield best


@dataclass(frozen=True, repr=False)
class PlanarFit(Shown):
    """A model of surge, sway and yaw together. `best` is the fit, `estimates` its parameters by name, `model` and
    `structure` what it contains, `use` what it predicts, `valid_range` where it was fitted, `fitted_because` and
    `because` the sentences that say why. `tried` are all models, the likeliest first. `runs` are those fitted,
    `observed` the sensors, `set_aside` the runs left out, each with its reason; `of_logs` are warnings of what was
    logged; `priors` were known beforehand; `warnings` are what a report says. `to_json()` is
    planar_model.json.

    Frame, a row per parameter: `parameter`, `value`, `stderr`, `low`, `high`, `unit`.

    Keys: `schema`, `force_unit`, `moment_unit`, `parameters`, `covariance`, `command_delay_s`, `fitted_to`,
    `structure`, `structure_because`, `estimated`, `estimated_because`, `assumptions`, `channels`, `random`,
    `prediction`, `log_likelihood`, `valid_range`, `warnings`, `runs`.
    """

    tried: tuple[OutputErrorFit, ...]
    best: OutputErrorFit
    use: Judgement
    fitted_because: str
    runs: tuple[Run, ...]
    observed: Observed
    set_aside: tuple[ExcludedRun, ...] = ()
    of_logs: tuple[str, ...] = ()
    priors: Priors = field(default_factory=dict)

    @property
    def structure(self) -> str:
        return structure_of(self.model, self.observed)

    @property
    def model(self) -> Model:
        return self.best.model

    @property
    def estimates(self) -> dict[str, Estimate]:
        return self.best.by_name

    @property
    def because(self) -> str:
        if len(self.tried) == 1:
            return "No other structure was tried."
        first, second = (structure_of(estimated.model, self.observed) for estimated in self.tried[:2])
        which = "this one" if first == self.structure else first
        behind = f"{second}, is {criterion(self.tried[1]) - criterion(self.tried[0]):.1f} behind"
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
        return {
            **model_content(self.best),
            COMMAND_DELAY: self.best.delay.to_json(),
            "fitted_to": "whole runs",
            "structure": self.structure,
            "structure_because": self.because,
            "estimated": HOW,
            "estimated_because": self.fitted_because,
            "assumptions": [asdict(assumption) for assumption in self.observed.assumptions(self.model)],
            "channels": list(self.observed.channels),
            "random": {name: size for name, size in self.best.mixed.of_chance.items() if name != COMMAND_DELAY},
            "prediction": self.use.to_json(YAW),
            "log_likelihood": self.best.mixed.log_likelihood,
            "valid_range": self.valid_range,
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.runs), self.set_aside, self.runs),
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        sentences = [*self.use.warnings(YAW)]
        if not self.best.mixed.converged:
            sentences.append("The fit did not converge; give more or longer runs.")
        for term in self.model.terms:
            if isinstance(term.effect, ThrusterImbalance):
                least, *_, most = sorted(term.effect.gains(*term.values))
                sentences.append(
                    f"The thrusters pull {least:.2f} to {most:.2f} times what their map says, if the mean of that is "
                    "right; else all masses and drags are off alike. Test each thruster ahead and astern."
                )
        tied = {name for name, *_ in self.model.ties}
        masses = {name: self.estimates[name] for dof in PLANAR.dofs if (name := dof.parameter("inertia")) not in tied}
        loose = [name for name, mass in masses.items() if mass.stderr > 0.5 * abs(mass.value)]
        if loose:
            names = f"The logs hardly determine {', '.join(loose)}: the standard error is more than half the value"
            sentences.append(f"{names}. Add runs in which the commands change more often.")
        return (*self.of_logs, *sentences)


INERTIAS = (0.5, 1.0, 2.0)  # shares of rough inertias from which a first fit starts
SIZES = (0.02, 0.2)  # disturbances, as shares of the acceleration of the largest command, to start from
NEIGHBOUR_ITERATIONS = 4  # iterations of a brief fit
GEAR_ITERATIONS = 16  # with a steering gear, which changes what the hull is taken for
WORTH_IT = 0.02  # share of the errors of predictions that is worth another structure


@dataclass(frozen=True)
class PlanarLikelihood:
    """Fits of planar models to `runs`, of which the logs hold what is `observed`; `priors` are parameters that are
    known beforehand, by qualified name."""

    runs: tuple[Run, ...]
    observed: Observed
    priors: Priors = field(default_factory=dict)
    with_effects: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()

    @cached_property
    def simplest(self) -> Model:
        """The model with which a search begins, with the effects that were asked for in each motion that is read."""
        model = self.observed.simplest(self.rough)
        for name, (place, dof) in product(self.with_effects, enumerate(PLANAR.dofs)):
            effect = effects.get(name)
            law = OF_EACH if name == THRUSTER_LAG and ARM in self.course.signals else 0
            start = tuple(start_of(name, self.course, place, law))
            idle = effect.place is Place.ACTUATOR and not effect.acts_on and place not in self.commanded
            idle |= acts_singly(effect, start) and dof is not YAW  # it acts on both motions
            if effect.acts_in(dof) and dof in self.observed.dofs and not idle:
                model = model.with_term(Term(name, start, dof=place))
        if SKEW in self.priors:
            model = replace(model, fixed=tuple(name for name in model.fixed if name != SKEW))
        sizes = by_momentum(self.runs, model.free)
        model = model.with_theta([sizes.get(name, value) for name, value in model.values.items()])
        inertia = YAW.parameter("inertia")
        if not self.observed.rudder_alone or inertia in self.priors:
            return model
        return inertia_tied(model, usual_gyration(model.masses[0]))

    @cached_property
    def rough(self) -> dict[str, float]:
        return rough_sizes(self.runs)

    def structure_of(self, model: Model) -> str:
        return structure_of(model, self.observed)

    def family(self, model: Model) -> Iterator[Candidate]:
        return candidates(model, self.observed, self.rough)

    @cached_property
    def course(self) -> Course:
        moving = np.zeros(len(self.runs), dtype=bool)  # the first readings tell who is at rest
        columns = {*self.signals, *(need for name in self.with_effects for need in effects.get(name).needs)}
        columns |= {*RudderRace.needs} if "rudder" in columns else set()
        columns |= {*PARTS, ARM} if all(ARM in run.extras for run in self.runs) else set()
        signals = sorted(columns - {dof.velocity for dof in PLANAR.dofs})
        return make_course(self.runs, moving, signals, motion=PLANAR, channels=self.observed.channels)

    def problem(self, model: Model) -> DrivenProblem:
        largest = np.abs(self.course.commanded).max(axis=(1, 2))
        parameters = Parameters((*model.parameters(np.where(largest > 0, largest, 1.0)), *self._random))
        return DrivenProblem(model, self.course, parameters.informed(self.priors))

    def starts(self, problem: DrivenProblem, random: Mapping[str, float] | None) -> Floats:
        """Where a fit begins, (S, p): about the model's own values, with what is known of the `random` ones."""
        model = problem.model
        middle = {chance.name: chance.value for chance in problem.parameters.nuisance}
        if random is not None:
            return starts_near(problem, [model.theta], random)
        heavy = np.array([parameter.role == "inertia" for parameter in problem.parameters[problem.parameters.of_model]])
        starts = []
        for inertia, size in product(INERTIAS, SIZES):
            pushed = {
                name: size / 0.05 * value / inertia if name.endswith("disturbance") else value
                for name, value in middle.items()
            }
            starts.append([*np.where(heavy, inertia * model.theta, model.theta), *pushed.values()])
        return problem.parameters.within(starts)

    def estimate(
        self, model: Model, random: Mapping[str, float] | None = None, iterations: int = ITERATIONS,
        settled: float = SETTLED_GAIN,
    ) -> OutputErrorFit:  # fmt: skip
        """The model fitted, from its own values and what is known of the `random` ones; one of few `iterations` leaves
        no run out. Raises FitError where no start leads anywhere."""
        problem = self.problem(model)
        starts, brief = self.starts(problem, random), iterations < ITERATIONS
        return result_of("", model, fit_innovations(problem, starts, iterations, brief, settled))

    def choose(self, tried: Sequence[OutputErrorFit]) -> tuple[OutputErrorFit, Judgement, str]:
        """The likeliest structure, with its predictions, and why. Where disturbances are as large as the commands, or
        it predicts no better than constants, the one that predicts runs left out best, if by a share of WORTH_IT.

        There one reading after the other tells little of what the commands do: whatever answers within a reading or
        two goes for the disturbance. Elsewhere a likelihood tells structures apart better than predictions of few runs.
        """

        def judged(fit: OutputErrorFit) -> tuple[OutputErrorFit, Judgement]:
            return fit, forecasts_of(self.problem(fit.model), fit.mixed)

        def finished(fit: OutputErrorFit) -> tuple[OutputErrorFit, Judgement]:
            return judged(self.estimate(fit.model, fit.mixed.of_chance))

        chosen = finished(tried[0])
        doubtful = chosen[1].large or chosen[1].score >= 0.0
        others = map(judged, tried[1:] if doubtful else tried[1:2])
        rival = min(others, key=lambda pair: pair[1].score, default=chosen)
        if doubtful and chosen[1].score - rival[1].score >= WORTH_IT:
            chosen, rival = sorted((chosen, finished(rival[0])), key=lambda pair: pair[1].score)
        scores = chosen[1].score, rival[1].score
        if not np.isfinite(scores[0]):  # a model whose predictions run away has no known parameters
            chosen = replace(chosen[0], covariance=np.full_like(chosen[0].covariance, np.inf)), chosen[1]
        if len(tried) == 1 or not chosen[1].worth[YAW.position] or not np.isfinite(scores[1]):
            return (*chosen, f"Fitted {HOW}.")
        share = float(np.expm1(scores[1] - scores[0]))
        misses = f"{100 * abs(share):.0f} % {'more' if share >= 0 else 'less'}"
        return (*chosen, f"Fitted {HOW}: of runs left out, 2 to 15 s ahead, the next best fit misses by {misses}.")

    @np.errstate(over="ignore", invalid="ignore")  # where a fit ran away
    def promises(self, wide: Model, neighbour: OutputErrorFit, added: Sequence[tuple[str, ...]]) -> list[Promise]:
        """What each group of free parameters of `wide` is to be expected to gain beside those of an estimated
        `neighbour`, and where: half of the score statistic within bounds, Rao (1948), doi 10.1017/S0305004100023987."""
        problem = self.problem(wide)
        (phi,) = problem.parameters.search(self.starts(problem, neighbour.mixed.of_chance))
        (slopes,) = problem.slopes(phi[None])
        point = problem.point(phi, slopes)
        names = [problem.parameters.names[i] for i in problem.free]
        free = {*neighbour.model.free, *neighbour.mixed.of_chance}
        limits, origin = problem.parameters.limits[problem.free], phi[problem.free]

        def promise(more: tuple[str, ...]) -> Promise:
            chosen = np.array([name in free or name in more for name in names])
            h, g = point.curvature[np.ix_(chosen, chosen)], point.gradient[chosen]
            step = bounded_solution(h, g + h @ origin[chosen], limits[chosen]) - origin[chosen]
            there = phi.copy()
            there[problem.free[chosen]] += step
            theta = dict(zip(problem.parameters.names, problem.parameters.natural(there).tolist()))
            return Promise(float(g @ step - 0.5 * step @ h @ step), theta)

        without = promise(()).gain
        return [replace(expected, gain=expected.gain - without) for expected in map(promise, added)]

    def promised(self, current: OutputErrorFit, family: Family) -> list[tuple[Candidate, Promise]]:
        """The candidates for a model with what their scores promise, all of one pass of the filter."""
        every = list(family(current.model))
        wide = widest(current.model, family)
        return list(zip(every, self.promises(wide, current, [candidate.added for candidate in every])))

    def tried(
        self, promised: Sequence[tuple[Candidate, Promise]], current: OutputErrorFit, iterations: int
    ) -> list[tuple[Candidate, OutputErrorFit]]:
        """Candidates fitted briefly side by side, each from where it promises most; those that lead anywhere."""
        begins = [self.toward(candidate.model, current.mixed.of_chance, promise) for candidate, promise in promised]
        fits = zip(promised, self.brief(begins, iterations))
        return [(candidate, fit) for (candidate, _), fit in fits if fit is not None]

    def brief(self, begins: Sequence[Begin], iterations: int) -> list[OutputErrorFit | None]:
        """Models fitted briefly side by side, each from its own values and those of what is random; None for one that
        leads nowhere."""
        problems = [self.problem(model) for model, _ in begins]
        starts = [self.starts(problem, random) for problem, (_, random) in zip(problems, begins)]
        fits = fits_of(problems, starts, iterations, brief=True)
        return [None if fit is None else result_of("", model, fit) for (model, _), fit in zip(begins, fits)]

    def actuated(self, fit: OutputErrorFit, iterations: int) -> list[tuple[Candidate, OutputErrorFit]]:
        """The model with each of ACTUATORS that it lacks, in all motions whose command changes, fitted briefly. Also
        without the motions in which nothing is left of it.

        A slope tells nothing of a lag where a delay stands for it: it begins with the delay's time in its place."""
        course, model, chances = self.course, fit.model, fit.mixed.of_chance
        delay, at_once = fit.delay.value, {**chances, COMMAND_DELAY: min(fit.delay.value, self.course.half_width)}
        lacking, begins = list[tuple[str, int]](), list[Begin]()
        for name, law in ACTUATORS:
            if name in [term.name for term in model.terms] or not (places := self._acting(model, name, law)):
                continue
            wide = model
            for i in places:
                first, *more = start_of(name, course, i, law)
                first *= STALL_SHARE if name == STALL else 1.0
                first = max(delay, START_LAG_S) if name in LAGS else first
                wide = wide.with_term(Term(name, (first, *more), dof=i))
            if name == STEERING_GEAR and (wide := self._geared(model, law)) is model:
                continue
            lacking.append((name, law))
            begins.append((wide, at_once if name in (*LAGS, STEERING_GEAR) else chances))
        thrusters = sum(name not in OF_RUDDERS for name, _ in lacking)  # they come first
        fits = list(zip(lacking, self.brief(begins[:thrusters], iterations)))
        fits += zip(lacking[thrusters:], self.brief(begins[thrusters:], max(iterations, GEAR_ITERATIONS)))
        fewer = [(law, self.without_idle(of.model, law[0]), of.mixed.of_chance) for law, of in fits if of is not None]
        fewer = [
            (law, of, random) for law, of, random in fewer
            if 0 < len(of.terms) - len(model.terms) < len(self._acting(model, *law))
        ]  # fmt: skip
        fits += zip([law for law, *_ in fewer], self.brief([(of, random) for _, of, random in fewer], iterations))
        return [(Candidate.of_terms(name, of.model), of) for (name, _), of in fits if of is not None]

    def _geared(self, model: Model, law: int) -> Model:
        """The model with a steering gear, of GEARS that whose rudder balances the momentum of the runs best, and the
        hull that does so: beside a gear it is another one than without. The model itself where none does so better than
        the rudder as it is logged."""
        trials = []
        for gear in GEARS[law]:
            runs = [put_over(run, gear) for run in self.runs]
            sizes = by_momentum(runs, model.free)
            trials.append((unbalanced(runs, sizes), gear, sizes))
        least, gear, sizes = min(trials)
        if least >= unbalanced(self.runs, by_momentum(self.runs, model.free)):
            return model
        inertia, values = YAW.parameter("inertia"), model.values
        scale = values[inertia] / sizes.get(inertia, values[inertia])
        sizes = {name: (scale if name.startswith("yaw.") else 1.0) * size for name, size in sizes.items()}
        theta = [value if name in self.priors else sizes.get(name, value) for name, value in values.items()]
        return model.with_theta(theta).with_term(Term(STEERING_GEAR, gear, dof=PLANAR.index(YAW)))

    def _acting(self, model: Model, name: str, law: int) -> list[int]:
        """Places of the motions in which runs may show what acts on commands: those whose command changes, of a dead
        band those whose command is zero at times or changes sides, of what a rudder, a compass or single thrusters do
        that of the heading."""
        if name == SensorLag.name:
            return [PLANAR.index(YAW)]
        if name in OF_RUDDERS:
            return [PLANAR.index(YAW)] if "rudder" in [term.name for term in model.terms] else []
        singly = ARM in self.course.signals
        if acts_singly(effects.get(name), start_of(name, self.course, law=law)):
            return [PLANAR.index(YAW)] if singly else []
        if singly and (name, law) in OF_BOTH:
            return []
        if name == DEAD_BAND:
            return [i for i, of in self.commanded.items() if of.min() <= 0.0 <= of.max()]
        return [*self.commanded]

    @cached_property
    def commanded(self) -> dict[int, Floats]:
        """The commands of all runs, by the places of those motions whose command changes."""
        commands = [np.concatenate([run.command_of(dof) for run in self.runs]) for dof in PLANAR.dofs]
        return {i: command for i, command in enumerate(commands) if np.ptp(command)}

    def without_idle(self, model: Model, name: str) -> Model:
        """The model without what is called `name` in motions in which nothing is left of it."""
        if acts_singly(effects.get(name)):
            return model
        least = {i: IDLE_SHARE * start_of(name, self.course, i)[0] for i in range(len(PLANAR.dofs))}
        return replace(model, terms=tuple(t for t in model.terms if t.name != name or t.values[0] >= least[t.dof]))

    def toward(self, model: Model, random: Mapping[str, float], promised: Promise) -> tuple[Model, Mapping[str, float]]:
        """The model, and what is `random`, as promised, where that is likelier than as they are."""
        problem = self.problem(model)
        (start,) = self.starts(problem, random)
        there = np.array([promised.theta.get(name, value) for name, value in zip(problem.parameters.names, start)])
        if not np.isfinite(there).all():
            return model, random
        phis = problem.parameters.search(np.stack([start, there]))
        value, reached = problem.value(phis)
        if not reached > value:
            return model, random
        there = problem.parameters.natural(phis[1])
        of_model = there[problem.parameters.of_model]
        return model.with_theta(of_model), dict(zip(problem.parameters.names, there.tolist()))

    @cached_property
    def _random(self) -> tuple[Parameter, ...]:
        """What is random, within the same bounds for all models; next to nothing of what is not read."""
        m = np.diagonal(self.simplest.inertia_matrix(self.simplest.theta[None])[0])
        rough = self.rough
        forces = [rough[dof.parameter("linear")] ** 2 / rough[dof.parameter("quadratic")] for dof in PLANAR.dofs]
        largest = np.abs(self.course.commanded).max(axis=(1, 2))
        pushes = np.maximum(largest, forces) / np.maximum(m, 1e-9)
        chances = randomness(self.course, pushes.tolist(), (), quiet=False)
        unread = tuple(f"{dof.name}." for dof in PLANAR.dofs if dof not in self.observed.dofs)
        return tuple(replace(c, upper=c.lower) if c.name.startswith(unread) else c for c in chances)
