"""When something stands out that no law of the library carries to the noise: learn it as a curve over one variable.

One linearisation scores the curves over all variables at once, a moment of its own and a gain on the thrust each, with
their smoothness by marginal likelihood; Gaussian draws say what the best of them reaches by chance. The leaders are
fitted with everything else, and one is kept that beats chance, predicts runs left out, and that no effect of the
library does as well as.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.learned_scores import Curve, all_signals, gains_follow, scored, with_curve
from automarine_cli.diagnosis.scores import penalty
from automarine_cli.diagnosis.search import BRIEF, REACH, TIE, may_stand
from automarine_cli.diagnosis.smooth import learned_term, places, smoothed
from automarine_cli.diagnosis.study import ITERATIONS, Fit, Study
from automarine_cli.diagnosis.trials import LEVEL, MOST_EFFECTS, Found, Rival, Trial
from automarine_cli.effects.learned import FIRST, PREFIX
from automarine_cli.errors import FitError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Each
from automarine_cli.quantities import Floats

LEADERS, MOST_LEADERS, BEHIND = 4, 6, 0.5
"""So many curves are fitted, or more whose score is this share of the best."""
FAR = 0.2
"""Share of the best gain by which brief fits may be behind that are taken further."""
AS_WELL = 0.02
"""Share of what one effect of the library gains within which it does as well as a curve: its law may be off."""
SETTLES = 2
"""How often the spread is chosen again after a fit."""
SAME_SPREAD = 0.1
"""Difference of the logarithm of two spreads that is none."""


def learn(study: Study, found: Found, seed: int, each: Each, explained: Callable[[Found], bool]) -> Found:
    """What a search found, with a learned curve where something is left that asks for one and a curve explains it.

    `explained` judges an outcome. A model that has its curve is left as it is. Where effects of the library do as
    well as a curve they keep their names, and it is their rival.
    """
    if learned_term(study.base) is not None:
        return found
    wide = replace(study, signals=all_signals(study))
    enough, count = explained(found), len(found.final.counted)
    follows = "" if study.driven else gains_follow(wide, found.final, seed)
    shows = bool(follows) or (count < 2 and bool(count or study.driven) and _shows(wide, found.final, seed))
    if enough and count < 2 and not shows:
        return found  # a law that is only somewhat off keeps its name where nothing beside it shows
    bases, most = [found.base, found.final][: 1 + bool(count)], np.inf
    if enough and count:  # a library that does as well wins
        bases = bases if study.driven or follows else bases[:1]
        gained = found.base.evidence - found.final.evidence
        most = found.final.evidence - max(TIE, AS_WELL * gained * (count == 1))
    chosen, tied = None, tuple[Rival, ...]()
    for base in bases:
        if chosen is None and len(base.counted) < MOST_EFFECTS:
            one = _best(wide, found, base, follows, seed + len(base.added), each)
            if one is None:
                continue
            wins = not any(may_stand(study, trial, base) for trial in _as_good(found, base, one.final))
            chosen = one if wins and one.final.evidence < most and explained(one) else None
            if base is found.base:
                tied = ties(found, one.final)
    if chosen is None:
        return replace(found, rivals=(*found.rivals, *tied))
    needed = {name for term in chosen.final.model.terms for name in effects.get(term.name).needs}
    return replace(chosen, study=replace(study, signals=tuple(sorted({*study.signals, *needed}))))


def ties(found: Found, curve: Trial) -> tuple[Rival, ...]:
    """A curve that does as well as what was found, as a rival of each of its effects."""
    behind = max(curve.evidence - found.final.evidence, 0.0)
    return tuple(Rival(name, curve.added[-1], behind, curve) for name in found.final.added if behind < TIE)


def _as_good(found: Found, base: Trial, curve: Trial) -> list[Trial]:
    """What the search tried of the library beside `base` that does as well as a curve."""
    same = [one for one in found.rounds if one.before.added == base.added]
    return [one for this in same for one in this.trials if one.evidence < curve.evidence + TIE]


def _shows(study: Study, base: Trial, seed: int) -> bool:
    """Whether a curve beside what was found would gain more than chance by its score."""
    try:
        curves, chance = scored(study, base, seed)
    except FitError:
        return False
    return bool(curves) and curves[0].gain > max(chance.threshold(LEVEL), 0.0)


def _best(study: Study, found: Found, base: Trial, follows: str, seed: int, each: Each) -> Found | None:
    """The search's outcome with the best curve beside what `base` has, if one beats chance. A gain over the column that
    the runs' own gains follow is tried whatever its score, in which their scatter stays as large as it is without."""
    try:
        curves, chance = scored(study, base, seed, each)
    except FitError:
        return None
    bar = max(chance.threshold(LEVEL), 0.0)
    least = max(BEHIND * curves[0].gain, 0.0) if curves else 0.0
    leading = [
        one for i, one in enumerate(curves)
        if i < LEADERS or (i < MOST_LEADERS and one.gain > least) or (one.name == PREFIX + follows and one.of_thrust)
    ]  # fmt: skip
    tried = each(partial(_fitted, study, base, BRIEF), leading, "trying curves")
    first = [one for one in tried if one is not None]
    gained = max((base.evidence - one.evidence for one in first), default=0.0)
    running = [one for one in first if base.evidence - one.evidence > gained - max(REACH, FAR * gained)]
    tried = each(partial(_further, study, base), running, "learning curves")
    trials = sorted((one for one in tried if one is not None), key=lambda trial: trial.evidence)
    able = [one for one in trials if base.evidence - one.evidence > bar and may_stand(study, one, base)]
    if not able:
        return None
    best = able[0]
    name, library = best.added[-1], _as_good(found, base, best)
    others = {one.added[-1]: one for one in reversed([*trials, *library]) if one.added[-1] != name}
    rivals = [
        Rival(name, other, max(one.evidence - best.evidence, 0.0), one)
        for other, one in others.items()
        if one.evidence < best.evidence + TIE
    ]
    kept = [rival for rival in found.rivals if rival.replaces in base.added]
    p_value = chance.p_value(base.evidence - best.evidence)
    p_values = {n: p for n, p in found.p_values.items() if n in base.added} | {name: p_value}
    rivals.sort(key=lambda rival: rival.behind)
    undoing = tuple(pair for pair in found.compensating if set(pair.names) <= set(base.added))
    return replace(
        found, study=study, final=best, p_values=p_values, rivals=(*kept, *rivals), more=False, doubtful=None,
        crowd=found.crowd if base.added else "", compensating=undoing,
    )  # fmt: skip


def _fitted(study: Study, base: Trial, iterations: int, curve: Curve) -> Trial | None:
    """The base with a curve, everything refitted."""
    values = np.append(base.fit.of_model, curve.model.terms[-1].values)
    return _trial(study, base, curve.model, values, base.fit, iterations)


def _further(study: Study, base: Trial, trial: Trial) -> Trial | None:
    """The same taken to the end; the spread is chosen again by each fit."""
    for _ in range(1 + SETTLES):
        spread, _ = smoothed(trial.fit, trial.model, study.sensor_floor)
        model = with_curve(trial.model, spread, trial.fit.theta[places(trial.model)])
        again = _trial(study, base, model, model.theta, trial.fit, ITERATIONS)
        if again is None:
            return None
        settled = abs(np.log(spread / trial.model.terms[-1].values[FIRST - 1])) < SAME_SPREAD
        trial = again
        if settled:
            break
    return trial


def _trial(study: Study, base: Trial, model: YawModel, values: Floats, near: Fit, iterations: int) -> Trial | None:
    """A fit of a model with a curve, its effective number of parameters counted."""
    try:
        fit = study.fit(model, values, near, iterations)
        count = smoothed(fit, model, study.sensor_floor)[1]
    except (FitError, np.linalg.LinAlgError):
        return None
    cost = _cost(base) + count * penalty(1, len(study.runs))
    added = (*base.added, model.terms[-1].name)
    return Trial(added, study.told(model, fit), fit, -2.0 * fit.log_likelihood + cost)


def _cost(base: Trial) -> float:
    """What the parameters of a trial cost."""
    return base.evidence + 2.0 * base.fit.log_likelihood
