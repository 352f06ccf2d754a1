"""What a planar model lacks: couplings, a current, or what stands between command and moment, named by evidence.

Each candidate is added to the model and everything is fitted again by innovations. It counts where its deviance gains
more than a penalty and a head start, run by run beyond chance, and where runs that no fit saw are more likely with it.
"""

from collections.abc import Iterator, Mapping, Sequence
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
from automarine_cli.fits.planar_likelihood import PlanarLikelihood, Promise
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
SMALL = 0.02
"""Share of its usual size at which an actuator effect is as good as none."""
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
    """An effect by its name, the parameters that it adds, and the model with it, which begins as the model without it,
    or so near to that that slopes are those there."""

    name: str
    added: tuple[str, ...]
    model: Tied


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

    def rivals(self, best: "Contender") -> bool:
        """Whether the best one does not lead by more than the head start, and run by run beyond chance."""
        behind = _fit(best.found).density - _fit(self.found).density
        return best.surplus - self.surplus < HEAD_START or not _steady(behind)


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
        values = tuple(p.off + (not p.held) * SMALL * p.scaled(p.start, largest) for p in effect.parameters)
        term = Term(name, values)
        names = [n for n, held in zip(parameters_of(YAW, term), effect.held(values)) if not held]
        wider = replace(model, yaw=(*model.yaw, term))
        yield Candidate(name, tuple(names), Tied(wider, (*base.free, *names), base.ties))


def find_missing(
    stored: StoredPlanar, runs: Sequence[Run], kept: Sequence[Run], seen: Observed
) -> PlanarSearch:
    """Diagnose a model on `runs`, with `kept` ones that are never fitted. Raises RunError for too few of either."""
    if len(runs) < 2 or not kept:
        raise RunError(f"{len(runs) + len(kept)} runs are too few for a diagnosis; give three or more")
    likelihood, other = PlanarLikelihood(tuple(runs), seen), PlanarLikelihood(tuple(kept), seen)
    before = here = likelihood.estimate(*_begin(stored, seen))
    steps: list[Step] = []
    suspected: list[Contender] = []
    while len(steps) < MOST:
        tried = [
            _contender(one, likelihood.estimate(*likelihood.toward(one.model, here, promise), True), here, other)
            for one, promise in _promising(likelihood, here, seen)
        ]
        here, tried = _on_the_best_summit(likelihood, here, tried, other)
        before = before if steps else here
        good = sorted((one for one in tried if one.borne_out), key=lambda one: -one.surplus)
        if not good:
            suspected = [one for one in tried if one.evident]
            break
        best, *rest = good
        here = likelihood.estimate(best.candidate.model, best.found)
        near = tuple(one for one in rest if one.rivals(best))
        steps.append(Step(replace(best, found=here), near))
    return PlanarSearch(
        before,
        tuple(steps),
        tuple(suspected),
        (_worth(likelihood, before), _worth(likelihood, here)),
        (_worth(other, before), _worth(other, here)),
    )


def _begin(stored: StoredPlanar, seen: Observed) -> tuple[Tied, Estimated | None]:
    """The stored model, and with what its fit knew of what is random, if it says so: from there one start is enough."""
    base, random = base_of(stored, seen), stored.data.get("random")
    if not isinstance(random, Mapping) or not random:
        return base, None
    sizes = {str(name): float(size) for name, size in random.items() if isinstance(size, (int, float))}
    return base, Estimated(base, np.zeros((0, 0)), 0.0, 0, random=sizes)


def _promising(
    likelihood: PlanarLikelihood, here: Estimated, seen: Observed
) -> list[tuple[Candidate, Promise]]:
    """The candidates that are worth a fit, those whose score promises to pass the bar, with what they promise."""
    largest = float(np.abs(likelihood.course.held[-1]).max()) or 1.0
    every = list(candidates(here.model, seen, largest))
    if not every:
        return []
    wide = here.model
    for one in every:
        wide = next(c.model for c in candidates(wide, seen, largest) if c.added == one.added)
    promised = likelihood.promises(wide, here, [one.added for one in every])
    return [(one, promise) for one, promise in zip(every, promised) if 2.0 * promise.gain > HEAD_START]


def _contender(one: Candidate, found: Estimated, here: Estimated, other: PlanarLikelihood) -> Contender:
    gained = _fit(found).density - _fit(here).density
    penalty = len(one.added) * float(np.log(len(gained)))
    held_out = _density(other, found) - _density(other, here)
    return Contender(one, found, 2.0 * float(gained.sum()) - penalty, _steady(gained), held_out)


def _steady(gained: Floats) -> bool:
    """Whether the mean of what runs gain (R,) is beyond chance."""
    return float(gained.mean()) > ERRORS * float(np.std(gained, ddof=1) / np.sqrt(len(gained)))


def _on_the_best_summit(
    likelihood: PlanarLikelihood, here: Estimated, tried: list[Contender], other: PlanarLikelihood
) -> tuple[Estimated, list[Contender]]:
    """The model, refitted from where the best contender ended if that is likelier, and the contenders beside it: what
    lets the search out of a lesser summit of the likelihood is no evidence for an effect."""
    if not any(one.evident for one in tried):
        return here, tried
    found = max(tried, key=lambda one: one.surplus).found
    model = here.model.with_theta([found.known[name] for name in here.model.free])
    again = likelihood.estimate(model, found, True)
    if again.log_likelihood <= here.log_likelihood:
        return here, tried
    again = likelihood.estimate(again.model, again)
    return again, [_contender(one.candidate, one.found, again, other) for one in tried]


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
