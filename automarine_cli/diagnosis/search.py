"""Which effects are missing from a model of motion: a stepwise search, judged by the likelihood of whole runs.

Every judgement compares simulations of whole runs with everything refitted together (`DiagnosisProblem.fit`); the
scores of one linearisation only say where fits start and what chance reaches. Evidence is the marginal likelihood with
Schwarz's penalty, the run as the unit; the threshold is what the best of all candidates reaches in a share
CLAIM_LEVEL of campaigns in which nothing is missing; runs predicted from the others have a veto.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.scores import (
    CLAIM_LEVEL,
    Score,
    Scores,
    candidate_shapes,
    candidates,
    drag_drives,
    fitted_parameters,
    law_of,
    penalty,
    score,
)
from automarine_cli.diagnosis.study import FIT_ROUNDS, MIN_STEP_DEVIANCE, DiagnosisProblem, Fit
from automarine_cli.diagnosis.trials import (
    BASE_DRAG,
    CURVE,
    FINE,
    FINE_ITERATIONS,
    SEARCH_BRIEF,
    SETTLED_EVIDENCE,
    TIE,
    Attempt,
    CandidateFit,
    all_refitted,
    attempt_on,
    attempt_with,
    candidate_fit,
    in_law,
    refitted,
    settled,
    shapes_by_law,
    with_values,
    without,
)
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.stepwise import Judge, stepwise_search
from automarine_cli.fits.whole_runs import estimate_of, run_covariance, run_dof
from automarine_cli.models.model import Model
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.quantities import Floats

WEAK = 0.05  # the same of what is suspected
CLEAR = 2.0  # standard errors over runs by which runs have to gain in the mean
MAX_EFFECTS = 3
STANDS = 1.3  # times the floor above which a remainder is said, and correlated residuals are unexplained


@dataclass(frozen=True)
class SearchStep:
    """One round of the search: the scores, every candidate's full fit, and the threshold on the gain in evidence."""

    before: CandidateFit
    scores: Scores
    trials: tuple[CandidateFit, ...]
    threshold: float

    def gain(self, trial: CandidateFit) -> float:
        """In deviance. What was given up far from its end may be switched off: all that it costs are its parameters."""
        last = trial.model.terms[-1]
        least = -penalty(fitted_parameters(last.name, last.values), len(trial.fit.predictive))
        return max(self.before.evidence - trial.evidence, least)

    def p_value(self, trial: CandidateFit) -> float:
        return self.scores.p_value(self.gain(trial))


Rivals = Mapping[str, Mapping[str, float]]
"""For each effect what the runs cannot exclude in its place, and how far behind that is (deviance), nearest first."""


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search: the study as judged, base and final model, rounds, p-value of each effect added, rivals.

    `more` says that after MAX_EFFECTS effects another candidate would still beat chance; `doubtful` is the outcome if
    what chance reaches in WEAK of all campaigns were enough, where nothing was added. `compensating` has a sentence for
    each pair of final effects of which each undoes most of what the other does: neither has earned its name. `equals`
    is a sentence where runs held out decided between laws or sizes."""

    study: DiagnosisProblem
    base: CandidateFit
    final: CandidateFit
    rounds: tuple[SearchStep, ...]
    p_values: dict[str, float]
    rivals: Rivals
    more: bool = False
    doubtful: "SearchResult | None" = None
    compensating: Mapping[tuple[str, ...], str] = field(default_factory=dict)
    equals: str = ""

    @property
    def claim(self) -> "SearchResult | None":
        """What may be claimed: the outcome, or the doubtful one where it adds nothing."""
        return self if self.final.added else self.doubtful

    def odds(self, name: str) -> dict[str, float]:
        """Odds of each rival of an effect of the final model against it."""
        return {rival: float(np.exp(-0.5 * behind)) for rival, behind in self.rivals.get(name, {}).items()}


def error_of_mean(values: Floats) -> float:
    return float(np.std(values, ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else np.inf


def clear(gains: Floats, errors: float = CLEAR) -> bool:
    """Whether gains in log density (R,) are more than so many standard errors above nothing in the mean."""
    return len(gains) > 1 and bool(gains.mean() > errors * error_of_mean(gains))


PAIR_LEAD = 10.0  # evidence (in deviance) by which several effects have to be better than one
LAW_ITERATIONS = 6  # iterations that tell whether a fit comes near the several effects
WITHIN = 0.3  # share of what the several gain that such a brief fit may lack to be taken to its end
OPPOSED = 0.8  # correlation of sizes from which two effects count as of opposite pull
USELESS = 0.5  # share of a pair's gain below which either alone is useless: two of their own gain at least half


def single_effect_alternative(
    study: DiagnosisProblem, current: CandidateFit, first: SearchStep, map_fn: Each
) -> CandidateFit:
    """The single effect that does as well as the several of `current`; or `current`.

    It has to do better than each of them alone. Every law of the effects added, of what they are mistaken for and of
    the leaders of the first round is fitted, unless the first round did."""
    if len(current.counted) < 2:
        return current
    base: CandidateFit | None = first.before
    if current.added != current.counted:  # the drag put right stays
        base = without(study, current, *current.counted)
    if base is None:
        return current
    trials = first.trials if base is first.before else ()
    evidences = {trial.law: trial.evidence for trial in trials}
    laws = [law_of(term.name, term.values) for term in current.model.terms if term.name in current.counted]
    lone = min((evidences[law] for law in laws if law in evidences), default=np.inf)
    needed = base.evidence - current.evidence - PAIR_LEAD if study.driven else -np.inf  # innovations cost seconds
    can = [s.effect for s in first.scores.ranked if FORETELLS * s.drop > needed]
    tried = {trial.added[-1] for trial in first.trials}
    suspects = dict.fromkeys([*current.counted, *(name for name in can[:6] if name in tried)])
    suspects |= dict.fromkeys(look for name in current.counted for look in effects.get(name).mistaken_for)
    work = [
        (name, shapes[len(shapes) // 2])
        for name in suspects if name in can and name not in base.added
        for law, shapes in shapes_by_law(study, name).items() if law not in evidences
    ]  # fmt: skip
    brief = all_refitted(study, [attempt_with(base, start) for start in work], LAW_ITERATIONS, map_fn, "trying laws")
    limit = base.evidence - (1.0 - WITHIN) * (base.evidence - current.evidence)
    close = [t for t in (*trials, *brief) if t is not None and t.evidence < max(limit, current.evidence + PAIR_LEAD)]
    unsettled = [t for t in close if not t.fit.converged]
    onward = [attempt_on(trial) for trial in unsettled]
    settled = all_refitted(study, onward, FIT_ROUNDS, map_fn, "fitting one instead of several")
    admissible = [
        t for t in (*(t for t in close if t.fit.converged), *settled)
        if t is not None and t.evidence <= current.evidence + PAIR_LEAD and t.evidence < lone
        and not obstacle(study, t, base)
    ]  # fmt: skip
    return min(admissible, key=lambda trial: trial.evidence, default=current)


def compensating(study: DiagnosisProblem, base: CandidateFit, final: CandidateFit) -> dict[tuple[str, ...], str]:
    """The pairs of effects of `final` of which each undoes what the other does, with a sentence: their sizes go
    together and neither gains much alone."""
    if len(final.counted) < 2:
        return {}
    covariance, pairs = study.covariance(final.model, final.fit), dict[tuple[str, ...], str]()
    for pair in combinations(final.counted, 2):
        together = _correlation(final, covariance, pair)
        if together < OPPOSED:
            continue
        first, second = (without(study, final, name) for name in pair)
        neither = base if final.added == pair else without(study, final, *pair)
        if first is None or second is None or neither is None:
            continue
        gained = neither.evidence - final.evidence
        alone = (neither.evidence - min(first.evidence, second.evidence)) / max(gained, 1e-9)
        if alone < USELESS:
            pairs[pair] = (
                f"{' and '.join(pair)} undo each other (correlation {together:.2f}; alone either gains at most "
                f"{100 * max(alone, 0.0):.0f} % of what both do): together they may stand for one law that is not in "
                "the library."
            )
    return pairs


def _correlation(final: CandidateFit, covariance: Floats, pair: tuple[str, str]) -> float:
    """Largest correlation of two effects' fitted parameters, both counted away from nothing: opposite pull is
    positive."""
    names = final.model.parameter_names
    off = [final.model.inertia] + [o for t in final.model.terms for o in effects.get(t.name).off]
    size = final.model.theta - np.array(off)
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    first, second = (
        [i for i, name in enumerate(names) if name.startswith(f"{effect}.") and spread[i] > 0] for effect in pair
    )
    pairs = [(i, j, np.sign(size[i] * size[j]) or 1.0) for i, j in product(first, second)]
    return max((float(sign * covariance[i, j] / (spread[i] * spread[j])) for i, j, sign in pairs), default=0.0)


MIN_GAIN_SCATTER = 0.1  # from which the scatter of the runs' gains is no trifle
MIN_GAIN_EXPONENT, MIN_GAIN_EXPONENT_STDERRS = 0.2, 5.0  # by which gains go with the size of the command, beyond chance
MAX_SCATTER_SHARE = 1.0 / 3.0  # share of the scatter that may stay where something explains it
WIDTHS = (0.1, 0.5)  # dead-bands that fits begin with, in shares of the smallest command


def gain_exponent(study: DiagnosisProblem, fit: Fit) -> Estimate | None:
    """With which power of the command's size (root mean square while there is one) the gains of single runs go; None
    where the runs have commands of one size, or a disturbance hides their gains."""
    if study.driven:
        return None
    size = _sizes(study)
    used = np.isfinite(size)
    x, y = np.log(size[used]), fit.effects_of(GAIN)[used, 0]
    dof = len(x) - 2
    spread = float(((x - x.mean()) ** 2).sum()) if dof > 0 else 0.0
    if spread < 0.05:
        return None
    slope = float(((x - x.mean()) * y).sum()) / spread
    residual = y - y.mean() - slope * (x - x.mean())
    return Estimate.from_stderr(slope, float(np.sqrt((residual**2).sum() / dof / spread)), dof, "1")


def _sizes(study: DiagnosisProblem) -> Floats:
    driving = (run.command[run.command != 0.0] for run in study.runs)
    return np.array([np.sqrt(np.mean(command**2)) if len(command) else np.nan for command in driving])


def curved(study: DiagnosisProblem, base: CandidateFit) -> CandidateFit | None:
    """The base with a dead-band and an exponent of the thrust, fitted together, where the gains of its runs go with the
    size of the command and do so no longer with both; None where not."""
    steep = gain_exponent(study, base.fit)
    if steep is None or base.fit.factor(GAIN) < MIN_GAIN_SCATTER:
        return None
    if abs(steep.value) < max(MIN_GAIN_EXPONENT, MIN_GAIN_EXPONENT_STDERRS * steep.stderr):
        return None
    smallest, best = float(np.nanmin(_sizes(study))), None
    for share in WIDTHS:
        model = base.model.with_effect("dead-band", (share * smallest, 0.0, 0.5))
        model = model.with_effect("thrust-exponent", (1.0 + steep.value, study.reference("moment")))
        trial = refitted(study, model, (*base.added, *CURVE), model.theta, base.fit)
        if trial is not None and (best is None or trial.evidence < best.evidence):
            best = trial
    return best if best is not None and settles(best, base) and best.evidence < base.evidence else None


def settles(trial: CandidateFit, base: CandidateFit) -> bool:
    """Whether a trial explains most of what the gains of the base scatter by."""
    return trial.fit.factor(GAIN) < MAX_SCATTER_SHARE * base.fit.factor(GAIN)


LEADERS = 6  # candidates that are fitted in every case: the first by their scores
ALWAYS_FITTED = 2  # of these those that are fitted whatever their scores, and tell what the others have to reach
FORETELLS = 4.0  # times its score that a fit gains at most, but for look-alikes; of driven runs twice at most
LIKELY = 0.1  # share of the best score from which the others are fitted
RUNNING = ((0.5, 6), (0.9, FIT_ROUNDS))
"""Who is fitted further, and how far: candidates with this share of the best gain, or within RIVAL_RANGE of it; fits
that far behind never catch up."""
LAW_GAIN_SHARE = 0.1  # of what an effect gains by its best law, that another of its laws may lack to be fitted on
MIN_EXTRA_SHARE = 0.1  # of all evidence gained, by an effect beyond MAX_EFFECTS: runs are then unexplained
MIN_RELATIVE_GAIN = 1e-3  # of the evidence gained; nothing is added for less: laws and logs are no better
MINOR_EFFECT_SHARE = 0.05  # of all evidence gained; less, and one of MAX_EFFECTS mends the form of another
TO_THE_NOISE = 1.05  # times the floor down to which an effect leaves no doubt about the drag of the base
PERIODIC, PERIOD = "periodic-disturbance", 2  # the effect that a limit cycle imitates, and the place of its period
MAX_PERIOD_RATIO = 2.0  # of the ends of a period's 95 % interval: what is not known as well has no period
VALLEY = 1000.0
"""Gain of the best candidate from which, if it leaves more than STANDS times the noise, its laws are fitted from many
starts: in so large a gap a fit may stop in a valley far from the truth."""
STARTS_OF_LAW = 6  # shapes of each law from which it is fitted: periods are many, and the score has looked at each
CLIMBERS = 4  # fits from many starts that are taken to their end
SURPLUS = 2.0  # deviance that a fit may gain beyond twice what its equations promise
RIVAL_RANGE = 60.0  # candidates this far behind the best by a full fit are no rivals of it

Fits = dict[tuple[object, ...], CandidateFit]
"""The best fit of each law."""


@dataclass(frozen=True)
class MotionSearch(Judge[CandidateFit, SearchStep]):
    """Candidates judged by whole runs simulated with everything refitted; `map_fn` maps a function over them."""

    study: DiagnosisProblem
    seed: int
    map_fn: Each
    most = MAX_EFFECTS + 1  # the drag put right counts for nothing
    looks: list[tuple[float, SearchStep]] = field(default_factory=list)  # by the evidence of the model that came
    fuller: dict[frozenset[str], CandidateFit] = field(default_factory=dict)  # by what was left of it

    def look(self, model: CandidateFit, number: int) -> SearchStep:
        """Score all candidates in all their laws, fit those in the running to the end, and rank them, unless the model
        was looked at before, as what is left without the last effect was."""
        for came, earlier in self.looks:
            behind = min(abs(evidence - model.evidence) for evidence in (came, earlier.before.evidence))
            if set(earlier.before.added) == set(model.added) and behind < 2.0 * SETTLED_EVIDENCE:
                return earlier
        study, current = self.study, settled(self.study, drag_right(self.study, model), FINE)
        names = candidates(study, current.model)
        scores = score(study, current.model, current.fit, names, self.seed + number, self.map_fn)
        chance = max(scores.threshold(CLAIM_LEVEL), 0.0)
        fits = self._leaders(current, self._put_back(current), scores, chance, first_step=number == 0)
        fits |= self._as_promised(current, fits, scores)
        bar = max(scores.threshold(WEAK), 0.0) if number == 0 else chance
        for share, iterations in RUNNING:
            fits |= self._further(current, fits, bar, share, iterations)
        fits |= self._from_many_starts(current, fits)
        fits |= self._beside_missing_drag(current, fits, bar)
        possible = [trial for trial in fits.values() if not drag_drives(trial.model, study.fastest)]
        ranking = sorted(_best_law(possible).values(), key=lambda trial: trial.evidence)
        current = self._from_elsewhere(current, [t for t in ranking[:3] if current.evidence - t.evidence > bar])
        # a law that may not stand does not keep another law of its effect from it, unless it says that the log is late
        standing = _best_law(possible, lambda trial: not obstacle(study, trial, current))
        of_log = [not study.driven and may_be_the_log(study, trial) for trial in ranking]
        ranking = [t if late else standing.get(t.added[-1], t) for t, late in zip(ranking, of_log)]
        step = SearchStep(current, scores, tuple(sorted(ranking, key=lambda t: t.evidence)), chance)
        self.looks.append((model.evidence, step))
        return step

    def admissible(self, look: SearchStep, first: SearchStep) -> list[CandidateFit]:
        """The drag of the base comes first unless another effect reaches the noise without it: beside a wrong drag
        everything is named that mends it, a curve of the thrust too, which comes first where only gains show it."""
        current = look.before
        least = max(look.threshold, MIN_RELATIVE_GAIN * first.gain(current))
        admissible = [t for t in look.trials if look.gain(t) > least and not obstacle(self.study, t, current)]
        admissible.sort(key=lambda trial: trial.evidence)
        if admissible and not self.study.driven and not self.reaches_noise(admissible[0], TO_THE_NOISE):
            admissible.sort(key=lambda trial: trial.added[-1] not in BASE_DRAG)
        if look is first and not (admissible and settles(admissible[0], current)):
            curve, hidden = curved(self.study, current), self.reaches_noise(current, STANDS)
            if curve is not None and (hidden or not admissible or curve.evidence < admissible[0].evidence):
                admissible = [curve, *admissible]
        return admissible if look is first or self.may_reach_noise(look, admissible) else []

    def may_reach_noise(self, look: SearchStep, trials: Sequence[CandidateFit]) -> bool:
        """Whether all effects that may still be added could leave STANDS times the noise, if each gained FORETELLS
        times what the best of `trials` does: where not, more of them explain nothing."""
        if self.study.driven or not trials:
            return True
        gained = FORETELLS * (MAX_EFFECTS - look.before.count) * max(look.gain(trial) for trial in trials)
        reached = look.before.fit.noise * np.exp(-0.5 * gained / float(self.study.batch.seen.sum()))
        return bool(reached < STANDS * self.study.sensor_floor)

    def reaches_noise(self, trial: CandidateFit, times: float) -> bool:
        return trial.fit.noise <= times * self.study.sensor_floor

    def full(self, model: CandidateFit) -> bool:
        return model.count == MAX_EFFECTS

    def added(self, model: CandidateFit) -> tuple[str, ...]:
        return model.counted

    def alone(self, model: CandidateFit) -> bool:
        return len(model.added) < 2

    def without(self, model: CandidateFit, name: str) -> CandidateFit | None:
        reduced = without(self.study, model, name)
        if reduced is not None:
            reduced = self._in_other_laws(reduced)
            self.fuller[frozenset(reduced.added)] = model
        return reduced

    def _in_other_laws(self, trial: CandidateFit) -> CandidateFit:
        """The best of a trial of runs that are simulated whole with one of its effects in another law: what was taken
        out may have stood for what the law lacks."""
        if self.study.driven:
            return trial
        attempts = list[Attempt]()
        for place, term in enumerate(trial.model.terms):
            if not term.base and not term.name.startswith(PREFIX):
                by_law = shapes_by_law(self.study, term.name)
                by_law.pop(law_of(term.name, term.values), None)
                attempts += [attempt_on(trial, in_law(trial, shapes[-1], place)) for shapes in by_law.values()]
        refits = [*filter(None, all_refitted(self.study, attempts, SEARCH_BRIEF, self.map_fn, "trying laws"))]
        least = min([trial.evidence - TIE, *(refit.evidence + RIVAL_RANGE for refit in refits)])
        leaders = [settled(self.study, refit, FINE) for refit in refits if refit.evidence < least]
        return min([trial, *leaders], key=lambda trial: trial.evidence)

    def better(self, current: CandidateFit, reduced: CandidateFit, look: SearchStep, first: SearchStep) -> CandidateFit:
        ranked = sorted((current, *look.trials), key=lambda trial: trial.evidence)
        best = next(trial for trial in ranked if trial is current or not obstacle(self.study, trial, reduced))
        if reduced.evidence - best.evidence <= max(look.threshold, MIN_RELATIVE_GAIN * first.gain(reduced)):
            return reduced
        return best if best.evidence < current.evidence - 2.0 * MIN_STEP_DEVIANCE else current

    def _put_back(self, current: CandidateFit) -> Fits:
        """The fit with the effect that was taken out to come to `current`, which the others have to reach."""
        fuller = self.fuller.get(frozenset(current.added))
        if fuller is None or len(out := set(fuller.added) - set(current.added)) != 1:
            return {}
        term = next(term for term in fuller.model.terms if term.name in out)
        model = current.model.with_effect(term.name, term.values)
        trial = refitted(self.study, model, (*current.added, term.name), _carried(model, fuller), fuller.fit)
        return {} if trial is None else {trial.law: trial}

    def _leaders(self, current: CandidateFit, fits: Fits, scores: Scores, chance: float, first_step: bool) -> Fits:
        """Beside the `fits` at hand fit the first candidates briefly, those whose scores say that they may reach what
        the best gains: twice as many while nothing has been added, a third where no score is beyond `chance`; and what
        is mistaken for the best, as scores miss what begins with a threshold and a tie must be seen."""
        best = scores.ranked[0].penalised if scores.ranked else 0.0
        leaders = (2 * LEADERS if first_step else LEADERS) if best > chance else LEADERS // (1 if first_step else 3)
        least = max(LIKELY * best, chance)
        first = [s for i, s in enumerate(scores.ranked) if i < leaders or s.penalised > least]

        def may_reach(of: Score, gained: float) -> bool:
            """Whether a fit is worth its hundred simulations, where the best one gains so much."""
            if self.study.driven and of.penalised + of.drop < scores.threshold(WEAK):
                return False
            return FORETELLS * of.drop > (RUNNING[0][0] if first_step else 1.0) * gained - RIVAL_RANGE

        ranked, tried = first[:ALWAYS_FITTED], set[str]()
        while ranked:
            starts = ((s.effect, start) for s in ranked for start in (s.start, *s.other_starts))
            work = [(name, start) for name, start in starts if law_of(name, start) not in fits]
            attempts = [attempt_with(current, start) for start in work]
            trials = all_refitted(self.study, attempts, SEARCH_BRIEF, self.map_fn, "trying effects")
            fits |= {trial.law: trial for trial in trials if trial is not None}
            tried |= {s.effect for s in ranked}
            leader = min(fits.values(), key=lambda trial: trial.evidence, default=current)
            gained = current.evidence - leader.evidence
            alike = effects.look_alikes(leader.added[-1]) if gained > chance else set[str]()
            further = {s.effect for s in first if may_reach(s, max(gained, best))} | alike
            ranked = [s for s in scores.ranked if s.effect in further - tried]
        return fits

    def _as_promised(self, current: CandidateFit, fits: Fits, scores: Scores) -> Fits:
        """Fit laws again that gained less than their scores promised, from where the best law of the effect ended."""
        leaders, gains = _best_law(fits.values()), {law: current.evidence - t.evidence for law, t in fits.items()}
        attempts = [
            attempt_on(leaders[of.effect], in_law(leaders[of.effect], of.start)) for of in scores.ranked
            if (law := law_of(of.effect, of.start)) in gains
            and gains[law] < min(of.penalised, gains[leaders[of.effect].law])
        ]  # fmt: skip
        again = all_refitted(self.study, attempts, SEARCH_BRIEF, self.map_fn, "trying effects")
        return {t.law: t for t in again if t is not None and t.evidence < fits[t.law].evidence}

    def _further(self, current: CandidateFit, fits: Fits, chance: float, share: float, iterations: int) -> Fits:
        """Fit those further that have this share of the best gain, or are within RIVAL_RANGE of it, and may still come
        to gain more than `chance` or near the best; another law of an effect not from so far behind its best."""
        best = min((trial.evidence for trial in fits.values()), default=0.0)
        least = best + max(RIVAL_RANGE, (1.0 - share) * (current.evidence - best))
        promises = {law: np.inf if trial.fit.driven else trial.fit.promised for law, trial in fits.items()}
        gained = max((current.evidence - trial.evidence + promises[law] for law, trial in fits.items()), default=0.0)
        needed = current.evidence - (min(chance, gained - TIE) if gained > chance else chance)
        running = []
        for first in _best_law(fits.values()).values():
            behind = first.evidence + max(RIVAL_RANGE, LAW_GAIN_SHARE * (current.evidence - first.evidence))
            laws = [trial for trial in fits.values() if trial.added[-1] == first.added[-1] and not trial.fit.converged]
            running += [
                trial for trial in laws
                if trial.evidence < min(least, behind) and trial.evidence - 2.0 * promises[trial.law] - SURPLUS < needed
            ]  # fmt: skip
        onward = [attempt_on(trial) for trial in running]
        again = all_refitted(self.study, onward, iterations, self.map_fn, "fitting")
        return {trial.law: trial for trial in again if trial is not None}

    def _from_many_starts(self, current: CandidateFit, done: Fits) -> Fits:
        """Find better fits of the best candidate's laws, if one may stand in a valley: from every shape, and from where
        its best law ended. Of driven runs only a dead time may: in a closed loop half of it is likely, too."""
        study, map_fn = self.study, self.map_fn
        best = min(done.values(), key=lambda trial: trial.evidence, default=current)
        if best is current or current.evidence - best.evidence < VALLEY:
            return {}
        name = best.added[-1]
        if not (effects.get(name).delays if study.driven else not self.reaches_noise(best, STANDS)):
            return {}
        by_law = shapes_by_law(study, name)
        shapes = [shape for some in by_law.values() for shape in some[:: -(-len(some) // STARTS_OF_LAW)]]
        attempts = [attempt_with(current, (name, shape)) for shape in shapes]
        attempts += [attempt_on(best, in_law(best, some[-1])) for some in by_law.values()]
        fits = all_refitted(study, attempts, SEARCH_BRIEF, map_fn, "more starts")
        climbers = sorted((trial for trial in fits if trial is not None), key=lambda trial: trial.evidence)[:CLIMBERS]
        within = best.evidence + RIVAL_RANGE
        climbers = [trial for trial in climbers if trial.evidence - FORETELLS * trial.fit.promised < within]
        climbers += [best] if not best.fit.converged else []
        onward = [attempt_on(trial) for trial in climbers]
        ended = all_refitted(study, onward, FINE_ITERATIONS, map_fn, "fitting")
        ranked = sorted((trial for trial in ended if trial is not None), key=lambda trial: -trial.evidence)
        better = {trial.law: trial for trial in ranked}
        return {law: t for law, t in better.items() if law not in done or t.evidence < done[law].evidence}

    def _beside_missing_drag(self, current: CandidateFit, fits: Fits, bar: float) -> Fits:
        """The candidates near the best where a drag term that the base lacks gains more than TIE beside them, though
        nothing alone: without its cubic drag a vehicle seems to have no linear drag either."""
        gaining = {trial.added[-1] for trial in fits.values() if trial.evidence < current.evidence - bar}
        missing = set(BASE_DRAG) - {term.name for term in current.model.terms} - gaining
        if self.study.driven or not missing or not fits:
            return {}
        limit = min(min(trial.evidence for trial in fits.values()) + RIVAL_RANGE, current.evidence - bar)
        leaders = [t for t in _best_law(fits.values()).values() if t.evidence < limit and t.added[-1] not in BASE_DRAG]
        attempts = []
        for trial, name in product(leaders, sorted(missing)):
            term = trial.model.terms[-1]
            model = current.model.with_effect(name, candidate_shapes(self.study, name)[0].values[0])
            model = model.with_effect(term.name, term.values)
            attempts.append((model, (*current.added, name, term.name), _carried(model, trial), trial.fit))
        again = all_refitted(self.study, attempts, FIT_ROUNDS, self.map_fn, "fitting")
        return {t.law: t for t in again if t is not None and t.evidence < fits[t.law].evidence - TIE}

    def _from_elsewhere(self, current: CandidateFit, trials: Sequence[CandidateFit]) -> CandidateFit:
        """Fit the current model again from where the best trials ended, if that is better: a candidate must not win by
        leading the base out of a valley in which its own fit had stopped."""
        size, trials = len(current.model.theta), trials if self.study.driven else trials[:1]
        attempts = [(current.model, current.added, trial.fit.of_model[:size], trial.fit) for trial in trials]
        for again in all_refitted(self.study, attempts, FIT_ROUNDS, alone, "", FINE):
            if again is not None and again.evidence < current.evidence - SETTLED_EVIDENCE:
                current = again
        return current


def _carried(model: Model, trial: CandidateFit) -> Floats:
    """The model's parameters (k,) as the fit of a trial has them, and its own where that has none."""
    fitted = dict(zip(trial.model.parameter_names, trial.fit.of_model))
    return np.array([fitted.get(name, value) for name, value in zip(model.parameter_names, model.theta)])


def search(study: DiagnosisProblem, seed: int, map_fn: Each, goes_on: Callable[[SearchStep], bool]) -> SearchResult:
    """Find what is missing; `map_fn` maps a function over candidates, in processes or not."""
    judge = MotionSearch(study, seed, map_fn)
    outcome = stepwise_search(judge, candidate_fit(study, study.base, (), study.fit(study.base)), goes_on)
    current, rounds, around = drag_right(study, outcome.final), outcome.looks, outcome.around
    base = rounds[0].before
    alone = min(judge.admissible(rounds[0], rounds[0]), key=lambda trial: trial.evidence, default=current)
    if len(current.counted) == 1 and alone.evidence < current.evidence:
        current, around = alone, {alone.added[0]: rounds[0]}
    p_values = {t.added[-1]: this.p_value(t) for this in rounds for t in judge.admissible(this, rounds[0])}
    p_values |= {name: this.p_value(current) for name, this in around.items()}
    more = False
    if current.count == MAX_EFFECTS:
        total, next_gain = base.evidence - current.evidence, _next_gain(study, current, seed)
        more = next_gain > MIN_EXTRA_SHARE * total
        if 0.0 < next_gain <= MIN_EXTRA_SHARE * total:
            # where even MAX_EFFECTS leave something small, those that hold little mend the form of another one's law
            for name, this in sorted(around.items(), key=lambda item: item[1].before.evidence):
                if this.gain(current) < MINOR_EFFECT_SHARE * total and len(current.counted) > 1:
                    current = without(study, current, name) or current
            around = {name: this for name, this in around.items() if name in current.added}
    single = single_effect_alternative(study, current, rounds[0], map_fn)
    if single is not current:
        current, more, around = single, False, {single.counted[0]: rounds[0]}
        p_values[current.counted[0]] = rounds[0].p_value(current)
    current = settled(study, current, 0.0) if current.added else current
    names = {name: p_values.get(name, CLAIM_LEVEL) for name in current.added}
    result = SearchResult(
        study, base, without_idle_drag(study, current), rounds, names, _rivals(current, around), more,
        compensating=compensating(study, base, current),
    )  # fmt: skip
    return result if current.added else replace(result, doubtful=_doubtful(result))


def drag_right(study: DiagnosisProblem, current: CandidateFit) -> CandidateFit:
    """A model of effects with the drag of its base put right: a term that they ask for is added, one that nothing asks
    for any more is taken out."""
    if current.counted == current.added and (not current.added or current.added[0] in BASE_DRAG):
        return current
    have = {term.name for term in study.base.terms}
    for name in [name for name in BASE_DRAG if name not in have]:
        if name in current.added:
            other = without(study, current, name)
            if other is not None and other.evidence - current.evidence < TIE:
                current = other
        else:
            other = refitted(study, *attempt_with(current, (name, candidate_shapes(study, name)[0].values[0])))
            if other is not None and current.evidence - other.evidence > TIE and not obstacle(study, other, current):
                current = other
    return current


def without_idle_drag(study: DiagnosisProblem, current: CandidateFit) -> CandidateFit:
    """The model with a drag term of the base held at nothing, where the drag put right leaves it nothing to do."""
    if study.driven or not set(BASE_DRAG) & set(current.added):
        return current
    cost = penalty(1, len(study.runs))
    for term in [term for term in current.model.terms if term.base and term.name in BASE_DRAG]:
        idle = refitted(study, *attempt_on(current, with_values(current.model, term, [0.0])))
        current = current if idle is None or idle.evidence > current.evidence + cost else idle
    return current


def _doubtful(result: SearchResult) -> SearchResult | None:
    """What would be added if what chance reaches in WEAK of all campaigns were enough."""
    first = result.rounds[0]
    least = max(first.scores.threshold(WEAK), 0.0)
    admissible = [t for t in first.trials if first.gain(t) > least and not obstacle(result.study, t, result.base)]
    best = min(admissible, key=lambda trial: trial.evidence, default=None)
    if best is None:
        return None
    (name,) = best.added
    return replace(result, final=best, p_values={name: first.p_value(best)}, rivals=_rivals(best, {name: first}))


def _next_gain(study: DiagnosisProblem, current: CandidateFit, seed: int) -> float:
    """What the best candidate beyond the current model would gain by its score; zero where that is within chance."""
    try:
        scores = score(study, current.model, current.fit, candidates(study, current.model), seed)
    except FitError:
        return 0.0
    best = scores.ranked[0].penalised if scores.ranked else 0.0
    return best if best > max(scores.threshold(CLAIM_LEVEL), 0.0) else 0.0


def _best_law(
    trials: Iterable[CandidateFit], may_stand: Callable[[CandidateFit], bool] = lambda trial: True
) -> dict[str, CandidateFit]:
    best: dict[str, CandidateFit] = {}
    for trial in sorted(trials, key=lambda trial: trial.evidence):
        if trial.added[-1] not in best and may_stand(trial):
            best[trial.added[-1]] = trial
    return best


def obstacle(study: DiagnosisProblem, trial: CandidateFit, current: CandidateFit) -> str:
    """What keeps a trial's last effect from being added to `current`, in words; empty where nothing does.

    Runs left out of the fit have to be predicted better with it, and its size must be its own: one that only a bound
    stops says that the runs want something else. What may be late by half a sample only is no more than a shift of the
    instants at which commands switch, which no log shows. Of driven runs the gain has to repeat itself from run to run:
    its mean is more than CLEAR standard errors, for moving water over the runs that turn back; the interval of its size
    must not hold nothing; and nothing that comes with the period of a controller's limit cycle stands."""
    if float(trial.fit.predictive.sum()) <= float(current.fit.predictive.sum()):
        return "runs left out of the fit are not predicted better with it"
    term, end = trial.model.terms[-1], len(trial.model.theta)
    effect, places = effects.get(term.name), range(end - len(term.values), end)
    if trial.fit.driven and current.fit.driven:
        gained = trial.fit.density - current.fit.density
        if not clear(gained):
            return "its gain does not repeat itself from run to run"
        if effect.place is effects.Place.WATER and not clear(gained[study.turns_back]):
            return "the runs that turn back do not show it"
    if study.cycle is not None and term.name == PERIODIC and study.cycle.holds(term.values[PERIOD]):
        return "its period is that of the controller's limit cycle"
    if term.name == PERIODIC:
        shortest, longest = estimate_of(trial.fit, run_covariance(trial.fit), places[PERIOD]).ci95
        if longest > MAX_PERIOD_RATIO * shortest:
            return f"its period may be {shortest:.2g} s or {longest:.2g} s: what wanders does as well"
    fixed = np.array(effect.held(term.values)) | np.array(effect.placed(term.values))
    stopped = any(
        i in trial.fit.at_bound and value != p.off and not stays and (not p.scan or effect.varies(term.values))
        for i, p, value, stays in zip(places, effect.parameters, term.values, fixed)
    )
    if stopped:
        return "its size goes to the limit of what is allowed"
    if study.driven:
        return "the 95 % interval of its size holds zero" if may_be_nothing(study, trial, term.name) else ""
    shifts = may_be_the_log(study, trial)
    return "a lag of half a sample is a shift of the instants at which commands switch" if shifts else ""


MIN_EXACT_WIDTH = 0.25  # of the width of a lag's linearised interval: as narrow as its exact one may be


def may_be_the_log(study: DiagnosisProblem, trial: CandidateFit) -> bool:
    """Whether a trial's last effect makes nothing later than a logger may, by half a sample: it is shorter than a whole
    one, and its 95 % interval holds a half. The exact one, which takes long, is asked for where it can decide."""
    term, end = trial.model.terms[-1], len(trial.model.theta)
    effect, places = effects.get(term.name), range(end - len(term.values), end)
    late = effect.late(term.values)
    if not study.logger_delay < late < 2.0 * study.logger_delay:
        return late <= study.logger_delay

    def least(covariance: Floats) -> float:
        return effect.late([estimate_of(trial.fit, covariance, i).ci95[0] for i in places])

    surely = late - MIN_EXACT_WIDTH * (late - least(run_covariance(trial.fit))) <= study.logger_delay
    return surely or least(study.covariance(trial.model, trial.fit)) <= study.logger_delay


def is_of_early_logs(study: DiagnosisProblem, look: SearchStep) -> bool:
    """Whether what explains most is no more than commands that are logged up to a sample before they act."""
    if study.driven or study.is_early or not look.trials:
        return False
    best = look.trials[0]
    delays = effects.get(best.added[-1]).delays
    return delays and look.gain(best) > look.threshold and may_be_the_log(study, best)


def may_be_nothing(study: DiagnosisProblem, trial: CandidateFit, name: str) -> bool:
    """Whether the sizes of an effect of a trial, all together, are within their errors of nothing.

    Wald's test with the run as the unit; of one size that is whether its 95 % interval holds zero. Sizes at a bound say
    nothing, nor do those on a logarithm, which has no zero, or without limit where they do nothing."""
    effect, fit = effects.get(name), trial.fit
    term = next(term for term in trial.model.terms if term.name == name)
    first = trial.model.index(f"{name}.{effect.names_in(trial.model.dof)[0]}")
    fixed = np.array(effect.shapes) | np.array(effect.held(term.values)) | np.isinf(effect.off)
    sizes = first + np.flatnonzero(~fixed & ~fit.parameters.log[first : first + len(term.values)])
    sizes = np.setdiff1d(sizes, fit.at_bound)
    if not len(sizes) or effect.varies(term.values) or isinstance(effect, Learned):
        return False
    away = fit.theta[sizes] - np.array(effect.off)[sizes - first]
    covariance = study.covariance(trial.model, fit)[np.ix_(sizes, sizes)]
    dof = min(run_dof(fit, axis) for axis in np.eye(len(fit.theta))[sizes])
    wald = float(away @ np.linalg.pinv(covariance) @ away) / len(sizes)
    return float(special.fdtrc(len(sizes), dof, wald)) > WEAK


def _rivals(final: CandidateFit, around: Mapping[str, SearchStep]) -> Rivals:
    """What could stand in each effect's place without losing more than TIE."""
    return {
        name: nearest({t.added[-1]: _behind(this, t, final) for t in this.trials if t.added[-1] != name})
        for name, this in around.items()
    }


def nearest(behind: Mapping[str, float]) -> dict[str, float]:
    """Those that are less than TIE behind, the nearest first."""
    return {name: size for name, size in sorted(behind.items(), key=lambda pair: pair[1]) if size < TIE}


def _behind(this: SearchStep, rival: CandidateFit, final: CandidateFit) -> float:
    """How far a rival is behind in evidence. Of driven runs that is not more than the square of the mean difference of
    a run in its standard errors over runs, if the rival gains beyond chance itself: a few runs may decide by chance."""
    behind = max(rival.evidence - final.evidence, 0.0)
    if not (rival.fit.driven and final.fit.driven):
        return behind
    ahead = final.fit.density - rival.fit.density
    error = error_of_mean(ahead)
    clearly = (float(ahead.mean()) / error) ** 2 if error > 0 else np.inf
    if this.gain(rival) > this.threshold and clearly < CLEAR**2:
        return min(behind, clearly)
    return behind
