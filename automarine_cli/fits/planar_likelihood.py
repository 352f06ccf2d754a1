"""The likelihood of planar models: which parameters are searched how, where fits start, and what an estimate is."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import YAW
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import FitError
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits.forecast_error import fit_forecasts, with_chance
from automarine_cli.fits.innovations import ITERATIONS, InnovationsFit, fit_innovations
from automarine_cli.fits.innovations_problem import DrivenProblem, Randomness, randomness
from automarine_cli.fits.known import Prior
from automarine_cli.fits.linear_mixed import bounded_solution
from automarine_cli.fits.output_error import run_covariance
from automarine_cli.fits.planar_fit import FORECASTS, LIKELIHOOD, WAYS, Choice, Estimated, Tried
from automarine_cli.fits.planar_structure import Observed, Structure, rough_sizes
from automarine_cli.fits.planar_use import HEADING, Forecasts, forecasts_of, planar_use
from automarine_cli.models.planar import FORCES, VELOCITIES
from automarine_cli.models.tied import Tied
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

INERTIAS = (0.5, 1.0, 2.0)
"""Shares of rough inertias from which a first fit starts."""
SIZES = (0.02, 0.2)
"""Disturbances, as shares of the acceleration of the largest command, to start from."""
BRIEF = 6
"""Iterations of a brief fit."""
WORTH_IT = 0.02
"""Share of the errors of predictions that is worth another estimator or structure."""
FASTEST_WATER = 5.0
"""m/s; no tidal current of a place where vehicles are tested is faster."""


@dataclass(frozen=True)
class Promise:
    """What more parameters promise: a `gain` in log likelihood, and all parameters by name where it is expected."""

    gain: float
    theta: Mapping[str, float]


@dataclass(frozen=True)
class PlanarLikelihood:
    """Fits of planar models to `runs`, of which the logs hold what is `seen`; `known` are parameters that are known
    beforehand, by qualified name."""

    runs: tuple[Run, ...]
    seen: Observed
    known: Mapping[str, Prior] = field(default_factory=dict)
    rough: Mapping[str, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "rough", rough_sizes(self.runs))

    @cached_property
    def course(self) -> Course:
        """The runs as the filter takes them."""
        moving = np.zeros(len(self.runs), dtype=bool)  # the first readings tell who is at rest
        return make_course(self.runs, moving, motion=PLANAR, channels=self.seen.channels)

    def problem(self, model: Tied) -> DrivenProblem:
        """The likelihood of a model: inertias on a logarithmic scale, own drags zero or more, couplings of any sign."""
        searched = [_searched(name, self.rough, self.course) for name in model.free]
        random = self._random(model)
        bounds, positive, scale = zip(*searched)
        return DrivenProblem(
            model,
            self.course,
            (*model.free, *(one.name for one in random)),
            np.array([*bounds, *((one.lower, one.upper) for one in random)]),
            np.array([*positive, *[True] * len(random)]),
            np.array([*scale, *[1.0] * len(random)]),
            random,
        ).informed(self.known)

    def starts(self, problem: DrivenProblem, near: Estimated | None) -> Floats:
        """Where a fit begins, (S, p): about the model's own values, with what is known of the random ones."""
        model = problem.model
        assert isinstance(model, Tied)
        middle = {one.name: one.median for one in problem.random}
        if near is not None:
            rest = [near.random.get(name, value) for name, value in middle.items()]
            starts = [[*model.theta, *rest]]
        else:
            heavy = np.array([name.endswith(("m_u", "m_v", "I_r")) for name in model.free])
            starts = []
            for inertia, size in product(INERTIAS, SIZES):
                pushed = {
                    name: size / 0.05 * value / inertia if name.endswith("disturbance") else value
                    for name, value in middle.items()
                }
                starts.append([*np.where(heavy, inertia * model.theta, model.theta), *pushed.values()])
        return np.clip(np.array(starts), problem.bounds[:, 0], problem.bounds[:, 1])

    def estimate(self, model: Tied, near: Estimated | None = None, brief: bool = False) -> Estimated:
        """The model fitted, from its own values, or from what was found `near` it; a `brief` fit ends early, and leaves
        no run out. Raises FitError where no start leads anywhere."""
        problem = self.problem(model)
        iterations = BRIEF if brief else ITERATIONS
        return self._estimated(model, fit_innovations(problem, self.starts(problem, near), iterations, brief))

    def by_forecasts(self, near: Estimated) -> Estimated:
        """The model of an estimate fitted to forecasts over seconds, from states that are smoothed `near` it. Raises
        FitError where no run is long enough."""
        assert near.fit is not None
        problem = self.problem(near.model)
        starts = np.concatenate([near.fit.theta[None], self.starts(problem, None)])
        found = fit_forecasts(problem, near.fit.phi, starts)
        return self._estimated(near.model, with_chance(problem, found))

    def _estimated(self, model: Tied, found: InnovationsFit) -> Estimated:
        """The estimate of a fit, with the run as the unit of its errors."""
        own = slice(0, found.parameters)
        slopes = np.where(found.positive[own], found.theta[own], 1.0)
        random = found.of_chance
        return Estimated(
            model.with_theta(found.of_model),
            run_covariance(found)[own, own] * np.outer(slopes, slopes),
            found.log_likelihood,
            sum(found.read.values()),
            found.noise_of,
            {
                dof.name: {
                    "size": random[f"{dof.name}.disturbance"],
                    "time_s": random[f"{dof.name}.disturbance-time"],
                    "thrust_noise": random[f"{dof.name}.thrust-noise"],
                }
                for dof in self.seen.dofs
            },
            found.converged,
            random,
            found,
        )

    def choose(self, tried: Sequence[Tried]) -> Choice:
        """The best structure and the simplest one, by innovations and by forecasts over seconds: what predicts runs
        left out best. The best structure by innovations is left for what predicts better by a share of WORTH_IT.

        Where disturbances are as large as the commands, or sensors are smoothed, one reading after the other tells
        little of what the commands do: whatever answers within a reading or two then goes for the disturbance.
        """
        simplest = Structure.simplest(self.seen)
        fitted: list[tuple[Tried, str, Forecasts]] = []
        for one in dict.fromkeys((0, next((i for i, t in enumerate(tried) if t.structure == simplest), 0))):
            for way in WAYS:
                with suppress(FitError):
                    own = tried[one]
                    found = own.found if way == LIKELIHOOD else self.by_forecasts(own.found)
                    assert found.fit is not None
                    judged = forecasts_of(self.problem(found.model), found.fit, way == FORECASTS)
                    if np.isfinite(judged.score) or not fitted:
                        fitted.append((replace(own, found=found), way, judged))
        best = min(fitted, key=lambda each: each[2].score)
        chosen = fitted[0] if fitted[0][2].score - best[2].score < WORTH_IT else best
        found = chosen[0].found
        assert found.fit is not None
        use = planar_use(self.runs, self.problem(found.model), found.fit, chosen[2])
        return Choice(chosen[0], chosen[1], use, _because(chosen, fitted, simplest))

    def gains(self, wide: Tied, near: Estimated, added: Sequence[tuple[str, ...]]) -> list[float]:
        """The gain in log likelihood to be expected of each group of free parameters of `wide` beside those of an
        estimate `near` it, of which it has the values."""
        return [one.gain for one in self.promises(wide, near, added)]

    def promises(self, wide: Tied, near: Estimated, added: Sequence[tuple[str, ...]]) -> list["Promise"]:
        """What each group of free parameters of `wide` is to be expected to gain beside those of an estimate `near` it,
        and where: half of the score statistic within bounds, Rao (1948), doi 10.1017/S0305004100023987."""
        problem = self.problem(wide)
        (phi,) = problem.search(self.starts(problem, near))
        (slopes,) = problem.slopes(phi[None])
        gradient = slopes.gradient.sum(axis=0) + problem.prior_gradient(phi)
        hessian = slopes.information.sum(axis=0) + problem.prior_information
        names = [problem.names[i] for i in problem.free]
        limits, here = problem.limits[problem.free], phi[problem.free]
        free = {*near.model.free, *near.random}

        def promise(more: tuple[str, ...]) -> Promise:
            own = np.array([name in free or name in more for name in names])
            h, g = hessian[np.ix_(own, own)], gradient[own]
            step = bounded_solution(h, g + h @ here[own], here[own], limits[own]) - here[own]
            there = phi.copy()
            there[problem.free[own]] += step
            theta = dict(zip(problem.names, problem.natural(there).tolist()))
            return Promise(float(g @ step - 0.5 * step @ h @ step), theta)

        without = promise(()).gain
        return [replace(one, gain=one.gain - without) for one in map(promise, added)]

    def toward(self, model: Tied, near: Estimated, promised: "Promise") -> tuple[Tied, Estimated]:
        """The model, and what is random `near` it, as promised, where that is likelier than as they are."""
        problem = self.problem(model)
        (start,) = self.starts(problem, near)
        there = np.array([promised.theta.get(name, value) for name, value in zip(problem.names, start)])
        value, reached = problem.value(problem.search(np.stack([start, there])))
        if not reached > value:
            return model, near
        random = dict(zip(problem.names, there.tolist()))
        return model.with_theta(there[: len(model.free)]), replace(near, random=random)

    def _random(self, model: Tied) -> tuple[Randomness, ...]:
        """What is random; of a degree of freedom of which nothing is read, next to nothing."""
        m = np.diagonal(model.model.inertia.matrix)
        forces = [_usual(self.rough, dof.name) for dof in PLANAR.dofs]
        largest = np.abs(self.course.held).max(axis=(1, 2))
        pushes = np.maximum(largest, forces) / np.maximum(m, 1e-9)
        found = randomness(self.course, pushes.tolist(), (), quiet=False)
        unread = tuple(f"{dof.name}." for dof in PLANAR.dofs if dof not in self.seen.dofs)
        return tuple(replace(one, upper=one.lower) if one.name.startswith(unread) else one for one in found)


def _because(
    chosen: tuple[Tried, str, Forecasts], fitted: Sequence[tuple[Tried, str, Forecasts]], simplest: Structure
) -> str:
    """Which fit is preferred, and by how much."""
    more = []
    for one, way, judged in fitted:
        share = float(np.expm1(judged.score - chosen[2].score))
        if judged is not chosen[2]:
            which = "of the simplest structure " if one.structure == simplest != chosen[0].structure else ""
            more.append(f"one {which}{WAYS[way]} by {100 * abs(share):.0f} % {'more' if share >= 0 else 'less'}")
    own = f"Fitted {WAYS[chosen[1]]}"
    if not more or not chosen[2].worth[HEADING]:
        return f"{own}."
    return f"{own}. Of runs left out, 2 to 15 s ahead, other fits miss: {'; '.join(more)}."


def _usual(rough: Mapping[str, float], dof: str) -> float:
    """Usual force along a degree of freedom, by its rough drags."""
    linear, quadratic = _drags(rough, dof)
    return linear**2 / quadratic


def _drags(rough: Mapping[str, float], dof: str) -> tuple[float, float]:
    own = next(one for one in PLANAR.dofs if one.name == dof)
    return rough[own.parameter("linear")], rough[own.parameter("quadratic")]


def _speed(rough: Mapping[str, float], letter: str) -> float:
    """Usual velocity u, v or r."""
    linear, quadratic = _drags(rough, PLANAR.dofs[VELOCITIES.index(letter)].name)
    return linear / quadratic


def _searched(name: str, rough: Mapping[str, float], course: Course) -> tuple[tuple[float, float], bool, float]:
    """Bounds of a parameter by its qualified name, whether it is searched on a logarithmic scale, a small step."""
    where, _, own = name.partition(".")
    if where == "current":
        return (-FASTEST_WATER, FASTEST_WATER), False, 0.05
    if where == PLANAR.name:  # inertia that couples
        return (-np.inf, np.inf), False, 0.1 * rough[YAW.parameter("inertia")] / 1.0
    if name in [dof.parameter("inertia") for dof in PLANAR.dofs]:
        return (1e-6, np.inf), True, 1.0
    if name in rough:  # own drag
        return (0.0, np.inf), False, 0.1 * rough[name]
    if "." in own:  # of an effect of the library
        effect_name, _, parameter = own.partition(".")
        effect = effects.get(effect_name)
        dof = next(one for one in PLANAR.dofs if one.name == where)
        found = next(p for p, n in zip(effect.parameters, effect.names_in(dof)) if n == parameter)
        largest = float(np.abs(course.held[PLANAR.index(dof)]).max()) or 1.0
        return (found.lower, found.upper), found.log, max(found.scaled(found.start, largest), 1e-6)
    if own[0] in FORCES and own[1:2] == "_":  # coupling
        size = _usual(rough, PLANAR.dofs[FORCES.index(own[0])].name)
        for letter in own[2:]:
            size /= _speed(rough, letter)
        return (-np.inf, np.inf), False, 0.1 * size
    return (-np.inf, np.inf), False, 0.01 * _usual(rough, where)
