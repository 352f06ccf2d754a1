"""What a planar model lacks: couplings, a current, or what stands between command and moment, named by evidence.

Each candidate is added to the model and everything is fitted again by innovations. It counts where its deviance gains
more than a penalty and a head start, run by run beyond chance, and where runs that no fit saw are more likely with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from automarine_cli.diagnosis.outlook import Outlook, outlook_of
from automarine_cli.diagnosis.planar_candidates import Candidate, base_of, candidates
from automarine_cli.diagnosis.verdict import NAMED, NOTHING, SUSPECTED, UNEXPLAINED, stretch
from automarine_cli.diagnosis.where import Where
from automarine_cli.dofs import YAW
from automarine_cli.errors import TooFewRunsError
from automarine_cli.filters.prediction import Predicted, predict
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.planar_fit import Choice, Estimated, PlanarFit, Tried
from automarine_cli.fits.planar_likelihood import PlanarLikelihood, Promise
from automarine_cli.fits.planar_structure import PLACES, Observed, Structure
from automarine_cli.fits.stepwise import Judge, discover
from automarine_cli.models.planar_store import StoredPlanar, planar_json
from automarine_cli.models.tied import Tied
from automarine_cli.pipeline.records import Document, json_document
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate
from automarine_cli.results.kinds import DIAGNOSIS
from automarine_cli.results.records import runs_json
from automarine_cli.results.shown import Shown
from automarine_cli.runs.run import Run, SetAside

FEWEST_RUNS = 4
"""Runs of which one is held out: those of motion in the plane are few and long."""
HEAD_START = 10.0
"""Deviance beyond the penalty that an effect has to gain."""
ERRORS = 2.0
"""Standard errors by which the mean gain of a run has to exceed zero."""
FULLY = 4
"""Candidates of a round that are fitted at most, those that promise most."""
MOST = 3
"""Effects that are named at most."""


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
        behind = fit_of(best.found).density - fit_of(self.found).density
        return best.surplus - self.surplus < HEAD_START or not _steady(behind)


@dataclass(frozen=True)
class Round:
    """One look for an effect: the model that was looked at, the surplus that each candidate's score promised, those
    that were fitted, the `best` if one was taken, and its rivals."""

    before: Estimated
    promised: tuple[tuple[Candidate, float], ...]
    tried: tuple[Contender, ...]
    best: Contender | None
    rivals: tuple[Contender, ...]


Foretold = Mapping[str, tuple[Predicted, ...]]
"""Predictions over each horizon of what is measured of heading and place, by quantity."""


@dataclass(frozen=True)
class PlanarSearch:
    """The model as it was given, refitted (`before`), and the rounds of the search.

    `every` has all runs, those fitted before those held out, `fitted` says how many were fitted. By the first and the
    last model there are predictions (`foretold`) and the runs' log densities (`density`, (R,) each). `where` has the
    gap of the first one, once somebody looked.
    """

    before: Estimated
    rounds: tuple[Round, ...]
    every: PlanarLikelihood = field(repr=False)
    fitted: int
    foretold: tuple[Foretold, Foretold] = field(repr=False)
    density: tuple[Floats, Floats] = field(repr=False)
    where: Where | None = field(default=None, repr=False)

    @property
    def steps(self) -> tuple[Round, ...]:
        """The rounds in which an effect was added."""
        return tuple(one for one in self.rounds if one.best is not None)

    @property
    def named(self) -> tuple[Contender, ...]:
        """What was added."""
        return tuple(one.best for one in self.rounds if one.best is not None)

    @property
    def suspected(self) -> tuple[Contender, ...]:
        """What the fitted runs ask for but others do not bear out."""
        return tuple(one for one in self.rounds[-1].tried if one.evident and self.rounds[-1].best is None)

    @property
    def after(self) -> Estimated:
        """The last model."""
        return self.named[-1].found if self.named else self.before

    @property
    def verdict(self) -> str:
        """ "named", "suspected", "unexplained" where the gap stands out all the same, or "nothing-missing"."""
        if self.named or self.suspected:
            return NAMED if self.named else SUSPECTED
        return UNEXPLAINED if self.where is not None and self.where.regions else NOTHING

    @property
    def passed_over(self) -> Contender | None:
        """The candidate of the last round that gains most and yet was not taken, where one gains enough."""
        last = self.rounds[-1]
        able = [one for one in last.tried if one.surplus > HEAD_START and last.best is None]
        return max(able, key=lambda one: one.surplus, default=None)

    @property
    def words(self) -> str:
        """The verdict in a few words."""
        names = " and ".join(contender.candidate.label for contender in self.named or self.suspected)
        return {NAMED: names, SUSPECTED: f"suspected {names}"}.get(self.verdict, self.verdict.replace("-", " "))

    @property
    def why(self) -> str:
        """Why effects are suspected only, or where the gap stands out that no effect explains; else empty."""
        if self.suspected:
            names = " or ".join(contender.candidate.label for contender in self.suspected)
            return f"The fitted runs ask for {names}, but the likelihood of held-out runs does not improve with it."
        if self.verdict != UNEXPLAINED or self.where is None:
            return ""
        most = self.passed_over
        passed = (
            "No candidate gains more than chance."
            if most is None
            else f"The best candidate, {most.candidate.label}, gains {most.surplus:.0f} in deviance, but not in the "
            f"mean of runs by {ERRORS:g} standard errors."
        )
        return f"The error is beyond chance {stretch(self.where.regions[0])}. {passed}"

    def outlook(self, held_out: bool) -> Outlook | None:
        """What both models predict of the heading of the runs that were fitted, or of those held out; None where these
        are too short."""

        def part(one: Predicted) -> Predicted:
            own = (one.run >= self.fitted) == held_out
            names = ("run", "origin", "target", "error", "constant_rate", "constant")
            return Predicted(one.horizon, *(getattr(one, name)[own] for name in names))

        before, after = ([part(one) for one in each[YAW.position]] for each in self.foretold)
        own = slice(self.fitted, None) if held_out else slice(self.fitted)
        gained = float((self.density[1] - self.density[0])[own].sum())
        return outlook_of(before, after, gained)


@dataclass(frozen=True)
class _Planar(Judge[Estimated, Round]):
    """Candidates judged by innovations of the fitted runs, and by the density of the `other` runs."""

    likelihood: PlanarLikelihood
    other: PlanarLikelihood
    seen: Observed
    most = MOST

    def look(self, model: Estimated, number: int) -> Round:
        likelihood, other, runs = self.likelihood, self.other, len(self.likelihood.runs)
        promised = _promised(likelihood, model, self.seen)
        tried = [
            _contender(one, likelihood.estimate(*likelihood.toward(one.model, model, promise), True), model, other)
            for one, promise in sorted(promised, key=lambda each: -each[1].gain)[:FULLY]
            if 2.0 * promise.gain > HEAD_START
        ]
        model, tried = _on_the_best_summit(likelihood, model, tried, other)
        good = sorted((one for one in tried if one.borne_out), key=lambda one: -one.surplus)
        surplus = tuple((one, 2.0 * promise.gain - _penalty(one, runs)) for one, promise in promised)
        if not good:
            return Round(model, surplus, tuple(tried), None, ())
        best, *rest = good
        found = likelihood.estimate(best.candidate.model, best.found)
        near = tuple(one for one in rest if one.rivals(best))
        return Round(model, surplus, tuple(tried), replace(best, found=found), near)

    def able(self, look: Round, first: Round) -> list[Estimated]:
        return [] if look.best is None else [look.best.found]


def find_missing(stored: StoredPlanar, runs: Sequence[Run], kept: Sequence[Run], seen: Observed) -> PlanarSearch:
    """Diagnose a model on `runs`, with `kept` ones that are never fitted. Raises RunError for too few of either."""
    if len(runs) < 2 or not kept:
        raise TooFewRunsError(f"{len(runs) + len(kept)} runs are too few for a diagnosis; give three or more")
    likelihood, other = PlanarLikelihood(tuple(runs), seen), PlanarLikelihood(tuple(kept), seen)
    outcome = discover(_Planar(likelihood, other, seen), likelihood.estimate(*_begin(stored, seen)))
    rounds, before, here = outcome.looks, outcome.looks[0].before, outcome.final
    if rounds[-1].best is not None and here is rounds[-1].before:
        # nothing can be looked for beside the last one: it is not taken
        rounds = (*rounds[:-1], replace(rounds[-1], best=None, rivals=()))
    every = PlanarLikelihood((*runs, *kept), seen)
    return PlanarSearch(
        before, rounds, every, len(runs),
        (foretold(every, before), foretold(every, here)), (_densities(every, before), _densities(every, here)),
    )  # fmt: skip


def _begin(stored: StoredPlanar, seen: Observed) -> tuple[Tied, Estimated]:
    """The stored model, and what its fit knew of what is random, if it says so: one start is enough for what somebody
    took for the vehicle."""
    base = base_of(stored, seen)
    return base, Estimated(base, np.zeros((0, 0)), 0.0, 0, random=stored.random)


def _promised(likelihood: PlanarLikelihood, here: Estimated, seen: Observed) -> list[tuple[Candidate, Promise]]:
    """The candidates with what their scores promise, all of one pass of the filter."""
    largest = float(np.abs(likelihood.course.held[-1]).max()) or 1.0
    every = list(candidates(here.model, seen, largest))
    wide = here.model
    for one in every:
        wide = next(c.model for c in candidates(wide, seen, largest) if c.added == one.added)
    return list(zip(every, likelihood.promises(wide, here, [one.added for one in every])))


def _contender(one: Candidate, found: Estimated, here: Estimated, other: PlanarLikelihood) -> Contender:
    gained = fit_of(found).density - fit_of(here).density
    held_out = _density(other, found) - _density(other, here)
    return Contender(one, found, 2.0 * float(gained.sum()) - _penalty(one, len(gained)), _steady(gained), held_out)


def _penalty(one: Candidate, runs: int) -> float:
    return len(one.added) * float(np.log(runs))


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


def fit_of(found: Estimated) -> InnovationsFit:
    """What innovations made of an estimate."""
    assert found.fit is not None
    return found.fit


def _density(other: PlanarLikelihood, found: Estimated) -> float:
    """Log likelihood of runs under an estimate from others."""
    density = float(_densities(other, found).sum())
    return density if np.isfinite(density) else -np.inf


def _densities(likelihood: PlanarLikelihood, found: Estimated) -> Floats:
    """Log density of each run under an estimate, (R,)."""
    problem = likelihood.problem(found.model)
    return problem.follow(problem.search(fit_of(found).theta)[None]).log_density[0]


def foretold(likelihood: PlanarLikelihood, found: Estimated) -> Foretold:
    """What an estimate, of these runs or of others, predicts of heading and place of a likelihood's runs."""
    problem, fit = likelihood.problem(found.model), fit_of(found)
    noises = problem.noises(fit.theta[None])
    return {
        one.quantity: predict(found.model, problem.course, fit.of_model, noises, channel=c)
        for c, one in enumerate(problem.course.channels)
        if one.quantity in (YAW.position, *PLACES)
    }


@dataclass(frozen=True, repr=False)
class PlanarDiagnosis(Shown):
    """The diagnosis of a stored planar model on `runs`, with others held out: the search, what the logs observe, the
    runs left out, and the hash of the model's file."""

    search: PlanarSearch
    runs: tuple[Run, ...]
    held_out: tuple[Run, ...]
    observed: Observed
    set_aside: tuple[SetAside, ...]
    parent_sha256: str

    @cached_property
    def estimates(self) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
        """Parameters of the first and the last model, by qualified name."""
        return self._estimates(self.search.before), self._estimates(self.search.after)

    def _estimates(self, estimated: Estimated) -> dict[str, Estimate]:
        tried = Tried(Structure.simplest(self.observed), estimated)
        return PlanarFit((tried,), Choice(tried), self.runs, self.observed).estimates

    def estimates_of(self, contender: Contender) -> dict[str, Estimate]:
        """Return the parameters that an effect adds."""
        estimates = self._estimates(contender.found)
        return {name: estimates[name] for name in contender.candidate.added}

    def document(self, option: str) -> Document:
        """Return the diagnosis where one is wanted, else the extended model."""
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def extended_model(self) -> dict[str, object]:
        """Return the model with what was named, and what is random as fitted: schema automarine/planar-model/1."""
        after = self.search.after
        return {
            **planar_json(after.model.model, {name: one.to_json() for name, one in self.estimates[1].items()}),
            "effects": [contender.candidate.name for contender in self.search.named],
            "random": dict(after.random),
            "covariance": {"parameters": list(after.model.free), "matrix": after.covariance.tolist()},
            "parent": self.parent_sha256,
        }

    def to_json(self) -> dict[str, object]:
        """Return the content of diagnosis.json: schema automarine/diagnosis/1."""
        search, (before, after) = self.search, self.estimates
        listed = [(step.best, step.rivals) for step in search.steps if step.best is not None]
        first = search.rounds[0]
        fitted = {contender.candidate.added: contender.surplus for contender in first.tried}
        gains = [(candidate, fitted.get(candidate.added, promise)) for candidate, promise in first.promised]
        outlooks = {"fitted_runs": search.outlook(False), "held_out_runs": search.outlook(True)}
        return {
            "schema": DIAGNOSIS.schema,
            "motion": "planar",
            "verdict": search.verdict,
            **({"why": search.why} if search.why else {}),
            "effects": [self._effect_json(*one) for one in listed or [(suspect, ()) for suspect in search.suspected]],
            "where": [region.to_json(YAW.units.key) for region in search.where.regions] if search.where else [],
            "gap": {name: self._gap_json(outlook) for name, outlook in outlooks.items()},
            "prediction": {name: outlook and outlook.to_json(YAW) for name, outlook in outlooks.items()},
            "candidates": [
                {
                    "name": candidate.name, "parameters": list(candidate.added), "gain": gain,
                    "fitted": candidate.added in fitted,
                }
                for candidate, gain in sorted(gains, key=lambda pair: -pair[1])
            ],
            "threshold": HEAD_START,
            "base": {
                name: {"before": before[name].to_json(), "after": after[name].to_json()}
                for name in before
                if name in after
            },
            "held_out": [run.name for run in self.held_out],
            "runs": runs_json(len(self.runs), self.set_aside, [*self.runs, *self.held_out]),
        }  # fmt: skip

    def _effect_json(self, contender: Contender, rivals: Sequence[Contender]) -> dict[str, object]:
        """A named or suspected effect, with its odds among its rivals."""
        weights = np.exp([0.5 * (rival.surplus - contender.surplus) for rival in rivals])
        total = 1.0 + float(np.sum(weights))
        return {
            "name": contender.candidate.name,
            "law": "surge, sway and yaw",
            "says": contender.candidate.says,
            "parameters": {name: estimate.to_json() for name, estimate in self.estimates_of(contender).items()},
            "confidence": 1.0 / total,
            "deviance_gained": contender.surplus,
            "held_out_log_likelihood_gained": contender.held_out,
            "rivals": [
                {
                    "name": rival.candidate.name,
                    "confidence": float(weight) / total,
                    "says": rival.candidate.says,
                    "split_by": rival.candidate.split_by,
                }
                for rival, weight in zip(rivals, weights)
            ],
        }

    def _gap_json(self, outlook: Outlook | None) -> dict[str, float] | None:
        """The error of the heading over the horizon that decides, beside the noise of its readings."""
        if outlook is None:
            return None
        judged = outlook.judged or outlook.ahead[-1]
        return {
            "before_deg": float(YAW.shown(judged.before)),
            "after_deg": float(YAW.shown(judged.after)),
            "noise_floor_deg": float(YAW.shown(self.search.after.noises[YAW.position])),
            "horizon_s": judged.horizon,
        }
