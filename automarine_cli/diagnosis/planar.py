"""What a planar model lacks: couplings, a current, or what stands between command and moment, named by evidence.

Each candidate is added to the model and everything is fitted again by innovations. It counts where its deviance gains
more than a penalty and a head start, run by run beyond chance, and where runs that no fit saw are more likely with it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.dofs import SWAY, YAW
from automarine_cli.errors import RunError
from automarine_cli.filters.prediction import predict
from automarine_cli.fits.driven_fit import Worth, worth_of
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.planar_fit import Estimated
from automarine_cli.fits.planar_likelihood import PlanarLikelihood
from automarine_cli.fits.planar_structure import COUPLINGS, Observed, Structure
from automarine_cli.models.planar import derivative, parameters_of
from automarine_cli.models.planar_store import StoredPlanar
from automarine_cli.models.tied import Tied
from automarine_cli.models.yaw_model import Term
from automarine_cli.runs.run import Run

Floats = NDArray[np.float64]

HEAD_START = 10.0
"""Deviance beyond the penalty that an effect has to gain."""
ERRORS = 2.0
"""Standard errors by which the mean gain of a run has to exceed zero."""
MOST = 3
"""Effects that are named at most."""
OF_YAW = ("input-delay", "thruster-lag", "dead-band")
SAYS = {
    "cross-coupling": "The velocity of one motion drives another",
    "munk-moment": "Sway takes more water along than surge, which turns a drifting hull",
    "current": "The water moves",
}


@dataclass(frozen=True)
class Candidate:
    """An effect by its name, the parameters that it adds, and the model with it, `nested` where that begins as the
    model without it."""

    name: str
    added: tuple[str, ...]
    model: Tied
    nested: bool = True


@dataclass(frozen=True)
class Contender:
    """A candidate that was fitted: deviance gained by all runs beyond its penalty, whether run by run beyond chance,
    and log likelihood gained by held-out runs."""

    candidate: Candidate
    found: Estimated
    surplus: float
    steady: bool
    held_out: float

    @property
    def evident(self) -> bool:
        """Whether the fitted runs ask for it."""
        return self.surplus > HEAD_START and self.steady

    @property
    def borne_out(self) -> bool:
        """Whether the held-out runs do not speak against it."""
        return self.evident and self.held_out > 0


@dataclass(frozen=True)
class Step:
    """One effect that was added, with the rivals that are within the head start of it."""

    best: Contender
    rivals: tuple[Contender, ...]


@dataclass(frozen=True)
class PlanarSearch:
    """The model as it was `given`, refitted (`before`), what was added, what the fitted runs ask for but others do not
    bear out, and predictions of the heading by the first and the last model on fitted and on held-out runs."""

    before: Estimated
    steps: tuple[Step, ...]
    suspected: tuple[Contender, ...]
    fitted: tuple[tuple[Worth, ...], tuple[Worth, ...]] = field(repr=False)
    held_out: tuple[tuple[Worth, ...], tuple[Worth, ...]] = field(repr=False)

    @property
    def after(self) -> Estimated:
        """The last model."""
        return self.steps[-1].best.found if self.steps else self.before

    @property
    def verdict(self) -> str:
        """ "named", "suspected" or "nothing-missing"."""
        return "named" if self.steps else "suspected" if self.suspected else "nothing-missing"


def base_of(stored: StoredPlanar, seen: Observed) -> Tied:
    """The stored model with the parameters free that its fit had free, and what the logs do not tell tied.

    Without a fit those are free that are not zero. A mass abeam that equals the mass ahead is tied to it.
    """
    model, covariance = stored.model, stored.data.get("covariance")
    known = set(model.parameter_names)
    ties = {name: tie for name, tie in Structure.simplest(seen).ties.items() if {name, tie[0]} <= known}
    if SWAY.parameter("inertia") not in ties and model.inertia.m_v == model.inertia.m_u:
        ties[SWAY.parameter("inertia")] = ("surge.m_u", 1.0)
    listed = covariance.get("parameters") if isinstance(covariance, dict) else None
    wanted = listed or [name for name, value in zip(model.parameter_names, model.theta) if value]
    return Tied(
        model, tuple(name for name in model.parameter_names if name in wanted and name not in ties), ties
    )


def candidates(base: Tied, seen: Observed, largest: float) -> Iterator[Candidate]:
    """What may be added to a model; `largest` is the largest moment [N m]."""
    model, have = base.model, {term.name for term in base.model.cross}
    for name in COUPLINGS:
        if name in have or not (SWAY in seen.dofs or name == "N_ur"):
            continue
        added = f"{base.motion.dofs[derivative(name)[0]].name}.{name}"
        wider = replace(model, cross=(*model.cross, Term(name, (0.0,))))
        yield Candidate("cross-coupling", (added,), Tied(wider, (*base.free, added), base.ties))
    mass = SWAY.parameter("inertia")
    if mass in base.ties:
        ties = {name: tie for name, tie in base.ties.items() if name != mass}
        yield Candidate("munk-moment", (mass,), Tied(model, (*base.free, mass), ties))
    if model.water is None and seen.over_ground:
        added_both = ("current.north", "current.east")
        wider = replace(model, water=(0.0, 0.0))
        yield Candidate("current", added_both, Tied(wider, (*base.free, *added_both), base.ties))
    for name in OF_YAW:
        if name in {term.name for term in model.yaw}:
            continue
        effect = effects.get(name)
        values = tuple(float(p.off) if p.held else p.scaled(p.start, largest) for p in effect.parameters)
        term = Term(name, values)
        names = [n for n, held in zip(parameters_of(YAW, term), effect.held(values)) if not held]
        wider = replace(model, yaw=(*model.yaw, term))
        yield Candidate(name, tuple(names), Tied(wider, (*base.free, *names), base.ties), nested=False)


def find_missing(
    stored: StoredPlanar, runs: Sequence[Run], kept: Sequence[Run], seen: Observed
) -> PlanarSearch:
    """Diagnose a model on `runs`, with `kept` ones that are never fitted. Raises RunError for too few of either."""
    if len(runs) < 2 or not kept:
        raise RunError(f"{len(runs) + len(kept)} runs are too few for a diagnosis; give three or more")
    likelihood, other = PlanarLikelihood(tuple(runs), seen), PlanarLikelihood(tuple(kept), seen)
    before = here = likelihood.estimate(base_of(stored, seen))
    steps: list[Step] = []
    suspected: list[Contender] = []
    while len(steps) < MOST:
        tried = [
            _contender(one, likelihood.estimate(one.model, here, True), here, other)
            for one in _promising(likelihood, here, seen)
        ]
        good = sorted((one for one in tried if one.borne_out), key=lambda one: -one.surplus)
        if not good:
            suspected = [one for one in tried if one.evident]
            break
        best, *rest = good
        here = likelihood.estimate(best.candidate.model, best.found)
        near = tuple(one for one in rest if best.surplus - one.surplus < HEAD_START)
        steps.append(Step(replace(best, found=here), near))
    return PlanarSearch(
        before,
        tuple(steps),
        tuple(suspected),
        (_worth(likelihood, before), _worth(likelihood, here)),
        (_worth(other, before), _worth(other, here)),
    )


def _promising(likelihood: PlanarLikelihood, here: Estimated, seen: Observed) -> list[Candidate]:
    """The candidates that are worth a fit: of the nested ones those whose score promises to pass the bar."""
    largest = float(np.abs(likelihood.course.held[-1]).max()) or 1.0
    every = list(candidates(here.model, seen, largest))
    nested = [one for one in every if one.nested]
    if not nested:
        return every
    wide = here.model
    for one in nested:
        wide = next(c.model for c in candidates(wide, seen, largest) if c.added == one.added)
    gains = likelihood.gains(wide, here, [one.added for one in nested])
    return [one for one, gain in zip(nested, gains) if 2.0 * gain > HEAD_START] + [
        one for one in every if not one.nested
    ]


def _contender(one: Candidate, found: Estimated, here: Estimated, other: PlanarLikelihood) -> Contender:
    gained = _fit(found).density - _fit(here).density
    error = float(np.std(gained, ddof=1) / np.sqrt(len(gained)))
    penalty = len(one.added) * float(np.log(len(gained)))
    held_out = _density(other, found) - _density(other, here)
    return Contender(
        one, found, 2.0 * float(gained.sum()) - penalty, float(gained.mean()) > ERRORS * error, held_out
    )


def _fit(found: Estimated) -> InnovationsFit:
    assert found.fit is not None
    return found.fit


def _density(other: PlanarLikelihood, found: Estimated) -> float:
    """Log likelihood of runs under an estimate from others."""
    problem = other.problem(found.model)
    density = problem.follow(problem.search(_fit(found).theta)[None]).log_density.sum()
    return float(density) if np.isfinite(density) else -np.inf


def _worth(likelihood: PlanarLikelihood, found: Estimated) -> tuple[Worth, ...]:
    """What an estimate is worth for the heading of a likelihood's runs."""
    problem, theta = likelihood.problem(found.model), _fit(found).theta
    heading = [one.quantity for one in problem.course.channels].index(YAW.position)
    noises = problem.noises(theta[None])
    return worth_of(predict(found.model, problem.course, found.model.theta, noises, channel=heading))
