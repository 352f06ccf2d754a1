"""Which effects are missing from a model of motion: a stepwise search, judged by the likelihood of whole runs.

Every judgement compares simulations of whole runs with everything refitted together (Study.fit); the scores of one
linearisation only say where fits start and what chance reaches. Evidence is the marginal likelihood with Schwarz's
penalty, the run as the unit; the threshold is what the best of all candidates reaches in a share LEVEL of campaigns
in which nothing is missing; runs predicted from the others have a veto.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.scores import (
    Probe,
    Scores,
    candidates,
    drag_drives,
    fitted_parameters,
    law_of,
    penalty,
    probes,
    score,
)
from automarine_cli.diagnosis.study import ITERATIONS, Fit, Study
from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.stepwise import Judge, discover
from automarine_cli.models.yaw_model import BASE_TERMS, YawModel
from automarine_cli.pipeline.parallel import Each
from automarine_cli.quantities import Floats

LEVEL = 0.005  # share of campaigns with nothing missing in which something may still be claimed
WEAK = 0.05  # the same of what is suspected
CLEAR = 2.0  # standard errors over runs by which runs have to gain in the mean
MOST_EFFECTS = 3
STANDS = 1.3
"""Times the floor above which what is left is said, and above which residuals that hang together are unexplained,
however much larger they were before."""


DRAG = BASE_TERMS["2"]  # effects that put the drag of the base right
CURVE = ("dead-band", "thrust-exponent")
"""What together is the curve of the thrust against its command, and counts as one effect."""


@dataclass(frozen=True)
class Trial:
    """A model with its fit; `evidence` is in deviance, smaller is better."""

    added: tuple[str, ...]
    model: YawModel
    fit: Fit
    evidence: float

    @property
    def counted(self) -> tuple[str, ...]:
        """The effects added, without what puts the drag of the base right beside others."""
        return tuple(name for name in self.added if name not in DRAG) or self.added

    @property
    def count(self) -> int:
        return len(self.counted) - (set(CURVE) <= set(self.counted))

    @property
    def law(self) -> tuple[object, ...]:
        """The effect added last, and the choices in its values."""
        return law_of(self.added[-1], self.model.terms[-1].values)


@dataclass(frozen=True)
class Round:
    """One round of the search: the scores, every candidate's full fit, and the threshold on the gain in evidence."""

    before: Trial
    scores: Scores
    trials: tuple[Trial, ...]
    threshold: float

    def gain(self, trial: Trial) -> float:
        return self.before.evidence - trial.evidence


@dataclass(frozen=True)
class Rival:
    """An explanation that the runs cannot exclude: what it replaces, how far behind it is (deviance), its fit."""

    replaces: str
    name: str
    behind: float
    trial: Trial


@dataclass(frozen=True)
class Compensating:
    """Two effects of opposite pull: the correlation of their sizes, and the largest share of what both gain that one of
    them gains alone."""

    names: tuple[str, str]
    correlation: float
    alone: float

    @property
    def says(self) -> str:
        return (
            f"{' and '.join(self.names)} undo each other (correlation {self.correlation:.2f}; alone either gains at "
            f"most {100 * self.alone:.0f}% of what both do): together they may stand for one law that is not in the "
            "library."
        )


@dataclass(frozen=True)
class Found:
    """Outcome of a search: the study as judged, base and final model, rounds, p-value of each effect added, rivals.

    `more` says that after MOST_EFFECTS effects another candidate would still beat chance; `doubtful` is the outcome if
    what chance reaches in WEAK of all campaigns were enough, where nothing was added. `crowd` is a sentence where one
    effect took the place of several that had been added, `compensating` has the pairs of final effects of which each
    undoes most of what the other does: neither has earned its name. `equals` is a sentence where runs held out decided
    between laws or sizes."""

    study: Study
    base: Trial
    final: Trial
    rounds: tuple[Round, ...]
    p_values: dict[str, float]
    rivals: tuple[Rival, ...]
    more: bool = False
    doubtful: "Found | None" = None
    crowd: str = ""
    compensating: tuple["Compensating", ...] = ()
    equals: str = ""

    def odds(self, name: str) -> dict[str, float]:
        """Odds of each rival of an effect of the final model against it."""
        return {rival.name: float(np.exp(-0.5 * rival.behind)) for rival in self.rivals if rival.replaces == name}


def error_of_mean(values: Floats) -> float:
    return float(np.std(values, ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else np.inf


def clear(gains: Floats, errors: float = CLEAR) -> bool:
    """Whether gains in log density (R,) are more than so many standard errors above nothing in the mean."""
    return bool(gains.mean() > errors * error_of_mean(gains))


def trial_of(study: Study, model: YawModel, added: tuple[str, ...], fit: Fit) -> Trial:
    """A fit as a trial: the fitted model, and its evidence with the penalty for what was added."""
    model = study.told(model, fit)
    more = model.terms[len(study.base.terms) :]
    cost = penalty(sum(fitted_parameters(term.name, term.values) for term in more), len(study.runs))
    return Trial(added, model, fit, -2.0 * fit.log_likelihood + cost)


def refitted(
    study: Study, model: YawModel, added: tuple[str, ...], values: Floats, near: Fit, iterations: int = ITERATIONS
) -> Trial | None:
    """A model fitted from `values` of its parameters; None where no fit is found."""
    try:
        return trial_of(study, model, added, study.fit(model, values, near, iterations))
    except (FitError, np.linalg.LinAlgError):
        return None


def add_effect(
    study: Study, current: Trial, candidate: tuple[str, Floats], iterations: int = ITERATIONS
) -> Trial | None:
    """The current model with one more effect, everything refitted; None where no fit is found."""
    name, start = candidate
    model, values = current.model.with_effect(name, start), np.concatenate([current.fit.of_model, start])
    return refitted(study, model, (*current.added, name), values, current.fit, iterations)


def go_on(study: Study, trial: Trial, iterations: int) -> Trial | None:
    return refitted(study, trial.model, trial.added, trial.fit.of_model, trial.fit, iterations)


def variants(study: Study, trial: Trial) -> list[YawModel]:
    """A trial's model with each effect that was added in every shape of every law of it."""
    return [
        replace(trial.model, terms=tuple(replace(t, values=shape) if t is term else t for t in trial.model.terms))
        for term in trial.model.terms[len(study.base.terms) :]
        for shape in dict.fromkeys(tuple(map(float, probe.values[-1])) for probe in probes(study, term.name))
        if len(effects.get(term.name).parameters) > 1
    ]


def varied(study: Study, trial: Trial, iterations: int, model: YawModel) -> Trial | None:
    """A variant of a trial's model, refitted from where the trial ended; None where no fit is found."""
    return refitted(study, model, trial.added, model.theta, trial.fit, iterations)


def without(study: Study, trial: Trial, out: str) -> Trial | None:
    """The trial's model with one effect taken out, refitted."""
    base, model = len(study.base.terms), trial.model
    kept = [term for term in model.terms[base:] if term.name != out]
    model = replace(model, terms=(*model.terms[:base], *kept))
    return refitted(study, model, tuple(term.name for term in kept), model.theta, trial.fit)


AS_WELL = 10.0  # evidence (in deviance) by which several effects have to be better than one
BRIEF = 6  # iterations that tell whether a fit comes near the several effects
WITHIN = 0.3  # share of what the several gain that such a brief fit may lack to be taken to its end
OPPOSED = 0.8  # correlation of sizes from which two effects count as of opposite pull
USELESS = 0.5
"""Share of what a pair gains below which either alone counts as useless: two of their own gain at least half."""


def one_instead(study: Study, current: Trial, first: Round, each: Each) -> tuple[Trial, str]:
    """The single effect that does as well as the several of `current`, with a sentence; or `current` and no sentence.

    It has to do better than each of them alone. Every law of the effects added, of what they are mistaken for and of
    the leaders of the first round is fitted, unless the first round did."""
    if len(current.counted) < 2:
        return current, ""
    base: Trial | None = first.before
    if current.added != current.counted:  # the drag put right stays
        base = current
        for name in current.counted:
            base = base and without(study, base, name)
    if base is None:
        return current, ""
    trials = first.trials if base is first.before else ()
    known = {trial.law: trial.evidence for trial in trials}
    own = [law_of(term.name, term.values) for term in current.model.terms if term.name in current.counted]
    lone = min((known[law] for law in own if law in known), default=np.inf)
    can = [s.effect for s in first.scores.ranked]
    asked = dict.fromkeys([*current.counted, *can[:6]])
    asked |= dict.fromkeys(look for name in current.counted for look in effects.get(name).mistaken_for)
    work = [
        (name, probe.values[-1])
        for name in asked if name in can and name not in base.added
        for probe in _one_a_law(study, name)
        if law_of(name, probe.values[-1]) not in known
    ]  # fmt: skip
    brief = each(partial(add_effect, study, base, iterations=BRIEF), work, "trying laws")
    near = base.evidence - (1.0 - WITHIN) * (base.evidence - current.evidence)
    close = [t for t in (*trials, *brief) if t is not None and t.evidence < max(near, current.evidence + AS_WELL)]
    unsettled = [t for t in close if not t.fit.converged]
    settled = each(partial(go_on, study, iterations=ITERATIONS), unsettled, "fitting one instead of several")
    able = [
        t for t in (*(t for t in close if t.fit.converged), *settled)
        if t is not None and t.evidence <= current.evidence + AS_WELL and t.evidence < lone
        and may_stand(study, t, base)
    ]  # fmt: skip
    if not able:
        return current, ""
    best = min(able, key=lambda trial: trial.evidence)
    return best, f"{best.added[-1]} alone does as well as {' and '.join(current.counted)} together."


def _one_a_law(study: Study, name: str) -> list[Probe]:
    """The middle one of the shapes of each law."""
    laws: dict[tuple[object, ...], list[Probe]] = {}
    for probe in probes(study, name):
        laws.setdefault(law_of(name, probe.values[-1]), []).append(probe)
    return [shapes[len(shapes) // 2] for shapes in laws.values()]


def compensating(study: Study, base: Trial, final: Trial) -> tuple[Compensating, ...]:
    """The pairs of effects of `final` of which each undoes what the other does: their sizes go together and neither
    gains much alone."""
    if len(final.counted) < 2:
        return ()
    covariance, found = study.covariance(final.model, final.fit), []
    for pair in combinations(final.counted, 2):
        together = _correlation(final, covariance, pair)
        if together < OPPOSED:
            continue
        one, other = (without(study, final, name) for name in pair)
        neither = base if final.added == pair else (one and without(study, one, pair[1]))
        if one is None or other is None or neither is None:
            continue
        gained = neither.evidence - final.evidence
        alone = (neither.evidence - min(one.evidence, other.evidence)) / max(gained, 1e-9)
        if alone < USELESS:
            found.append(Compensating(pair, together, max(alone, 0.0)))
    return tuple(found)


def _correlation(final: Trial, covariance: Floats, pair: tuple[str, str]) -> float:
    """Largest correlation of two effects' fitted parameters, both counted away from nothing: opposite pull is
    positive."""
    names = final.model.parameter_names
    off = [final.model.inertia] + [o for t in final.model.terms for o in effects.get(t.name).off]
    size = final.model.theta - np.array(off)
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    one, other = (
        [i for i, name in enumerate(names) if name.startswith(f"{effect}.") and spread[i] > 0] for effect in pair
    )
    both = [(i, j, np.sign(size[i] * size[j]) or 1.0) for i, j in product(one, other)]
    return max((float(sign * covariance[i, j] / (spread[i] * spread[j])) for i, j, sign in both), default=0.0)


LARGE, STEEP, SURE = 0.1, 0.2, 5.0
"""Scatter of the gains, exponent by which they go with the size of the command, and its standard errors, from which
both are no chance and no trifle."""
SETTLES = 1.0 / 3.0  # share of the scatter that may stay where something explains it
WIDTHS = (0.1, 0.5)  # dead-bands that fits begin with, in shares of the smallest command


def gain_exponent(study: Study, fit: Fit) -> Estimate | None:
    """With which power of the command's size (root mean square while there is one) the gains of single runs go; None
    where the runs have commands of one size, or a disturbance hides their gains."""
    if study.driven:
        return None
    size = _sizes(study)
    used = np.isfinite(size)
    x, y = np.log(size[used]), fit.own(GAIN)[used, 0]
    dof = len(x) - 2
    spread = float(((x - x.mean()) ** 2).sum()) if dof > 0 else 0.0
    if spread < 0.05:
        return None
    slope = float(((x - x.mean()) * y).sum()) / spread
    left = y - y.mean() - slope * (x - x.mean())
    return Estimate.from_stderr(slope, float(np.sqrt((left**2).sum() / dof / spread)), dof, "1")


def _sizes(study: Study) -> Floats:
    driving = (run.command[run.command != 0.0] for run in study.runs)
    return np.array([np.sqrt(np.mean(one**2)) if len(one) else np.nan for one in driving])


def curved(study: Study, base: Trial) -> Trial | None:
    """The base with a dead-band and an exponent of the thrust, fitted together, where the gains of its runs go with the
    size of the command and do so no longer with both; None where not."""
    steep = gain_exponent(study, base.fit)
    scatter = base.fit.factor(GAIN)
    if steep is None or scatter < LARGE or abs(steep.value) < max(STEEP, SURE * steep.stderr):
        return None
    smallest, best = float(np.nanmin(_sizes(study))), None
    for share in WIDTHS:
        model = base.model.with_effect("dead-band", (share * smallest, 0.0, 0.5))
        model = model.with_effect("thrust-exponent", (1.0 + steep.value, study.reference("moment")))
        trial = refitted(study, model, (*base.added, *CURVE), model.theta, base.fit)
        if trial is not None and (best is None or trial.evidence < best.evidence):
            best = trial
    return best if best is not None and settles(best, base) and best.evidence < base.evidence else None


def settles(trial: Trial, base: Trial) -> bool:
    """Whether a trial explains most of what the gains of the base scatter by."""
    return trial.fit.factor(GAIN) < SETTLES * base.fit.factor(GAIN)


TIE = 10.0  # difference of evidence (in deviance) below which two explanations count as tied
LEADERS = 6  # candidates that are fitted in every case: the first by their scores
LIKELY = 0.1  # share of the best score from which the others are fitted
SEARCH_BRIEF = 4  # iterations that every candidate's fit gets; only those in the running are fitted to the end
RUNNING = ((0.5, 6), (0.9, ITERATIONS))
"""Who is fitted further, and how far: candidates with this share of the best gain, or within REACH of it; fits that far
behind never catch up."""
LAWS = 0.1  # share of what an effect gains by its best law that another of its laws may lack to be fitted further
MATTERS = 0.1
"""Share of all evidence gained that an effect beyond MOST_EFFECTS would have to gain for the runs to be unexplained."""
TRUST = 1e-3
"""Share of the evidence already gained below which nothing more is added: laws and logs are no better than that."""
TRIFLE = 0.05
"""Share of all evidence gained below which one of MOST_EFFECTS effects counts as mending the form of another."""
TO_THE_NOISE = 1.05  # times the floor down to which an effect leaves no doubt about the drag of the base
SETTLED_EVIDENCE = 0.5  # gain in evidence below which a swap is not worth another look: fits are settled to less
PERIODIC, PERIOD = "periodic-disturbance", 2  # the effect that a limit cycle imitates, and the place of its period
VALLEY = 1000.0
"""Gain of the best candidate from which, if it leaves more than STANDS times the noise, its laws are fitted from many
starts: in so large a gap a fit may stop in a valley far from the truth."""
CLIMBERS = 4  # fits from many starts that are taken to their end
REACH = 60.0  # candidates this far behind the best by a full fit are no rivals of it


@dataclass(frozen=True)
class _Runs(Judge[Trial, Round]):
    """Candidates judged by whole runs simulated with everything refitted; `each` maps a function over them."""

    study: Study
    seed: int
    each: Each
    most = MOST_EFFECTS + 1  # the drag put right counts for nothing

    def look(self, model: Trial, number: int) -> Round:
        model = drag_right(self.study, model)
        return _round(self.study, model, self.seed + number, self.each, whole=number == 0)

    def able(self, look: Round, first: Round) -> list[Trial]:
        """The drag of the base comes first unless another effect reaches the noise without it: beside a wrong drag
        everything is named that mends it, a curve of the thrust too, which comes first where only gains show it."""
        current = look.before
        least = max(look.threshold, TRUST * (first.before.evidence - current.evidence))
        able = [t for t in look.trials if look.gain(t) > least and may_stand(self.study, t, current)]
        able.sort(key=lambda trial: trial.evidence)
        if able and not self.study.driven and able[0].fit.noise > TO_THE_NOISE * self.study.sensor_floor:
            able.sort(key=lambda trial: trial.added[-1] not in DRAG)
        if look is first and not (able and settles(able[0], current)):
            curve, hidden = curved(self.study, current), current.fit.noise <= STANDS * self.study.sensor_floor
            if curve is not None and (hidden or not able or curve.evidence < able[0].evidence):
                able = [curve, *able]
        return able

    def full(self, model: Trial) -> bool:
        return model.count == MOST_EFFECTS

    def added(self, model: Trial) -> tuple[str, ...]:
        return model.counted

    def alone(self, model: Trial) -> bool:
        return len(model.added) < 2

    def without(self, model: Trial, name: str) -> Trial | None:
        return without(self.study, model, name)

    def better(self, current: Trial, left: Trial, look: Round, first: Round) -> Trial:
        able = [trial for trial in look.trials if may_stand(self.study, trial, left)]
        best = min((*able, current), key=lambda trial: trial.evidence)
        least = max(look.threshold, TRUST * (first.before.evidence - left.evidence))
        if left.evidence - best.evidence <= least:
            return left
        return best if best.evidence < current.evidence - SETTLED_EVIDENCE else current


def search(study: Study, seed: int, each: Each) -> Found:
    """Find what is missing; `each` maps a function over candidates, in processes or not."""
    judge = _Runs(study, seed, each)
    outcome = discover(judge, trial_of(study, study.base, (), study.fit(study.base)))
    current, rounds, around = drag_right(study, outcome.final), outcome.looks, outcome.around
    base = rounds[0].before
    alone = min(judge.able(rounds[0], rounds[0]), key=lambda trial: trial.evidence, default=current)
    if len(current.counted) == 1 and alone.evidence < current.evidence:
        current, around = alone, {alone.added[0]: rounds[0]}
    p_values = {
        trial.added[-1]: this.scores.p_value(this.gain(trial))
        for this in rounds
        for trial in judge.able(this, rounds[0])
    }
    for name, this in around.items():
        p_values[name] = this.scores.p_value(this.before.evidence - current.evidence)
    more = False
    if current.count == MOST_EFFECTS:
        total, next_gain = base.evidence - current.evidence, _next_gain(study, current, seed)
        more = next_gain > MATTERS * total
        if 0.0 < next_gain <= MATTERS * total:
            current, around = _without_menders(study, current, around, TRIFLE * total)
    current, crowd = one_instead(study, current, rounds[0], each)
    if crowd:
        around, more = {current.counted[0]: rounds[0]}, False
        p_values[current.counted[0]] = rounds[0].scores.p_value(rounds[0].gain(current))
    names = {name: p_values.get(name, LEVEL) for name in current.added}
    found = Found(
        study, base, without_idle_drag(study, current), rounds, names, _rivals(current, around), more,
        crowd=crowd, compensating=compensating(study, base, current),
    )  # fmt: skip
    return found if current.added else replace(found, doubtful=_doubtful(found))


def drag_right(study: Study, current: Trial) -> Trial:
    """A model of effects with the drag of its base put right: a term that they ask for is added, one that nothing asks
    for any more is taken out."""
    if current.counted == current.added and (not current.added or current.added[0] in DRAG):
        return current
    have = {term.name for term in study.base.terms}
    for name in [name for name in DRAG if name not in have]:
        if name in current.added:
            other = without(study, current, name)
            if other is not None and other.evidence - current.evidence < TIE:
                current = other
        else:
            other = add_effect(study, current, (name, probes(study, name)[0].values[0]))
            if other is not None and current.evidence - other.evidence > TIE and may_stand(study, other, current):
                current = other
    return current


def without_idle_drag(study: Study, current: Trial) -> Trial:
    """The model with a drag term of the base held at nothing, where the drag put right leaves it nothing to do."""
    if study.driven or not set(DRAG) & set(current.added):
        return current
    cost = penalty(1, len(study.runs))
    for term in [term for term in current.model.terms if term.base and term.name in DRAG]:
        terms = (replace(other, values=(0.0,)) if other is term else other for other in current.model.terms)
        idle = varied(study, current, ITERATIONS, replace(current.model, terms=tuple(terms)))
        current = current if idle is None or idle.evidence > current.evidence + cost else idle
    return current


def _doubtful(found: Found) -> Found | None:
    """What would be added if what chance reaches in WEAK of all campaigns were enough."""
    first = found.rounds[0]
    least = max(first.scores.threshold(WEAK), 0.0)
    able = [t for t in first.trials if first.gain(t) > least and may_stand(found.study, t, found.base)]
    best = min(able, key=lambda trial: trial.evidence, default=None)
    if best is None:
        return None
    (name,), p_value = best.added, first.scores.p_value(first.gain(best))
    return replace(found, final=best, p_values={name: p_value}, rivals=_rivals(best, {name: first}))


def _next_gain(study: Study, current: Trial, seed: int) -> float:
    """What the best candidate beyond the current model would gain by its score; zero where that is within chance."""
    try:
        scores = score(study, current.model, current.fit, candidates(study, current.model), seed)
    except FitError:
        return 0.0
    best = scores.ranked[0].penalised if scores.ranked else 0.0
    return best if best > max(scores.threshold(LEVEL), 0.0) else 0.0


def _without_menders(
    study: Study, current: Trial, around: dict[str, Round], trifle: float
) -> tuple[Trial, dict[str, Round]]:
    """Take out effects that hold no more evidence than `trifle`: where even MOST_EFFECTS leave something small,
    they mend the form of another one's law."""
    for name, this in sorted(around.items(), key=lambda item: item[1].before.evidence):
        if this.before.evidence - current.evidence < trifle and len(current.counted) > 1:
            current = without(study, current, name) or current
    return current, {name: this for name, this in around.items() if name in current.added}


def _round(study: Study, current: Trial, seed: int, each: Each, whole: bool) -> Round:
    """Score all candidates in all their laws, fit the leaders: twice as many while nothing has been added, and a third
    where no score is beyond chance."""
    scores = score(study, current.model, current.fit, candidates(study, current.model), seed, each)
    likely = max(0.0, LIKELY * scores.ranked[0].penalised) if scores.ranked else 0.0
    chance = max(scores.threshold(LEVEL), 0.0)
    beyond = bool(scores.ranked) and scores.ranked[0].penalised > chance
    leaders = (2 * LEADERS if whole else LEADERS) if beyond else LEADERS // (1 if whole else 3)
    ranked = [s for i, s in enumerate(scores.ranked) if i < leaders or s.penalised > max(likely, chance)]
    done, tried = dict[tuple[object, ...], Trial](), set[str]()
    while ranked:
        work = [(s.effect, start) for s in ranked for start in (s.start, *s.others)]
        found = each(partial(add_effect, study, current, iterations=SEARCH_BRIEF), work, "trying effects")
        done |= {trial.law: trial for trial in found if trial is not None}
        tried |= {s.effect for s in ranked}
        leader = min(done.values(), key=lambda trial: trial.evidence, default=current)
        if current.evidence - leader.evidence <= chance:
            break
        alike = effects.look_alikes(leader.added[-1])  # scores miss what begins with a threshold; a tie must be seen
        ranked = [s for s in scores.ranked if s.effect in alike - tried]
    for share, iterations in RUNNING:
        best = min((trial.evidence for trial in done.values()), default=0.0)
        least = best + max(REACH, (1.0 - share) * (current.evidence - best))
        first = _best_law(done.values())
        # another law of an effect is not fitted further from so far behind its best
        behind = {name: t.evidence + max(REACH, LAWS * (current.evidence - t.evidence)) for name, t in first.items()}
        running = [t for t in done.values() if t.evidence < min(least, behind[t.added[-1]]) and not t.fit.converged]
        again = each(partial(go_on, study, iterations=iterations), running, "fitting")
        done |= {trial.law: trial for trial in again if trial is not None}
    done |= _from_many_starts(study, current, done, each)
    possible = [trial for trial in done.values() if not drag_drives(trial.model, study.fastest)]
    ranking = sorted(_best_law(possible).values(), key=lambda trial: trial.evidence)
    current = _from_elsewhere(study, current, ranking[:3])
    # a law that may not stand does not keep another law of its effect from it
    standing = _best_law(t for t in possible if may_stand(study, t, current))
    ranking = [standing.get(trial.added[-1], trial) for trial in ranking]
    return Round(current, scores, tuple(sorted(ranking, key=lambda trial: trial.evidence)), chance)


def _from_many_starts(
    study: Study, current: Trial, done: Mapping[tuple[object, ...], Trial], each: Each
) -> dict[tuple[object, ...], Trial]:
    """Better fits of the best candidate's laws, if one may stand in a valley: from every shape, and from where its best
    law ended."""
    best = min(done.values(), key=lambda trial: trial.evidence, default=current)
    gained = current.evidence - best.evidence
    if study.driven or gained < VALLEY or best.fit.noise <= STANDS * study.sensor_floor:
        return {}
    name, term = best.added[-1], best.model.terms[-1]
    shapes = [probe.values[-1] for probe in probes(study, name)]
    by_law = {law_of(name, shape): shape for shape in shapes}
    of_law = [bool(p.choices or p.laws) for p in effects.get(name).parameters]
    others = [
        replace(best.model, terms=(*best.model.terms[:-1], replace(term, values=tuple(map(float, values)))))
        for values in (np.where(of_law, shape, term.values) for shape in by_law.values())
    ]
    begin = partial(add_effect, study, current, iterations=SEARCH_BRIEF)
    found = [
        *each(begin, [(name, shape) for shape in shapes], "more starts"),
        *each(partial(varied, study, best, SEARCH_BRIEF), others, "more starts"),
    ]
    climbers = sorted((trial for trial in found if trial is not None), key=lambda trial: trial.evidence)[:CLIMBERS]
    climbers += [best] if not best.fit.converged else []
    ended = each(partial(go_on, study, iterations=2 * ITERATIONS), climbers, "fitting")
    ranked = sorted((trial for trial in ended if trial is not None), key=lambda trial: -trial.evidence)
    better = {trial.law: trial for trial in ranked}
    return {law: t for law, t in better.items() if law not in done or t.evidence < done[law].evidence}


def _best_law(trials: Iterable[Trial]) -> dict[str, Trial]:
    best: dict[str, Trial] = {}
    for trial in sorted(trials, key=lambda trial: trial.evidence):
        best.setdefault(trial.added[-1], trial)
    return best


def _from_elsewhere(study: Study, current: Trial, trials: Sequence[Trial]) -> Trial:
    """The current model fitted again from where the best trials ended, if that is better: a candidate must not win by
    leading the base out of a valley in which its own fit had stopped."""
    for trial in trials if study.driven else trials[:1]:
        values = trial.fit.of_model[: len(current.model.theta)]
        again = refitted(study, current.model, current.added, values, trial.fit)
        if again is not None and again.evidence < current.evidence - SETTLED_EVIDENCE:
            current = again
    return current


def may_stand(study: Study, trial: Trial, current: Trial) -> bool:
    """Whether nothing keeps a trial's last effect from being added to `current`; see `obstacle`."""
    return not obstacle(study, trial, current)


def obstacle(study: Study, trial: Trial, current: Trial) -> str:
    """What keeps a trial's last effect from being added to `current`, in words; empty where nothing does.

    Runs left out of the fit have to be predicted better with it, and its size must be its own: one that only a bound
    stops says that the runs want something else. What is late by less than a sample is no more than a shift of the
    instants at which commands switch, which no log shows. Of driven runs the gain has to repeat itself from run to run:
    its mean is more than CLEAR standard errors, for moving water over the runs that turn back; and nothing that comes
    with the period of a controller's limit cycle stands."""
    if float(trial.fit.predictive.sum()) <= float(current.fit.predictive.sum()):
        return "runs left out of the fit are not predicted better with it"
    term, end = trial.model.terms[-1], len(trial.model.theta)
    effect, places = effects.get(term.name), range(end - len(term.values), end)
    if isinstance(trial.fit, InnovationsFit) and isinstance(current.fit, InnovationsFit):
        gained = trial.fit.density - current.fit.density
        if not clear(gained):
            return "its gain does not repeat itself from run to run"
        if effect.place is effects.Place.WATER and not clear(gained[study.turns_back]):
            return "the runs that turn back do not show it"
    elif effect.late(term.values) < 2.0 * study.logger_delay:
        return "a lag of less than a sample is a shift of the instants at which commands switch"
    if study.cycle is not None and term.name == PERIODIC and study.cycle.holds(term.values[PERIOD]):
        return "its period is that of the controller's limit cycle"
    stopped = any(
        i in trial.fit.at_bound and value != p.off and not held and (not p.scan or effect.varies(term.values))
        for i, p, value, held in zip(places, effect.parameters, term.values, effect.held(term.values))
    )
    return "its size goes to the limit of what is allowed" if stopped else ""


def _rivals(final: Trial, around: Mapping[str, Round]) -> tuple[Rival, ...]:
    """What could stand in each effect's place without losing more than TIE."""
    found = [
        Rival(name, trial.added[-1], behind, trial)
        for name, this in around.items()
        for trial in this.trials
        if trial.added[-1] != name and (behind := _behind(this, trial, final)) < TIE
    ]
    return tuple(sorted(found, key=lambda rival: rival.behind))


def _behind(this: Round, rival: Trial, final: Trial) -> float:
    """How far a rival is behind in evidence. Of driven runs that is not more than the square of the mean difference of
    a run in its standard errors over runs, if the rival gains beyond chance itself: a few runs may decide by chance."""
    behind = max(rival.evidence - final.evidence, 0.0)
    if not (isinstance(rival.fit, InnovationsFit) and isinstance(final.fit, InnovationsFit)):
        return behind
    ahead = final.fit.density - rival.fit.density
    error = error_of_mean(ahead)
    clearly = (float(ahead.mean()) / error) ** 2 if error > 0 else np.inf
    if this.gain(rival) > this.threshold and clearly < CLEAR**2:
        return min(behind, clearly)
    return behind
