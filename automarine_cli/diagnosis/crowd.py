"""Whether several effects are one in disguise: a single one, under any law, that does as well; and effects that undo
each other.

A sum of library effects can draw nearly any curve, so that two or three of them with sizes of opposite pull beat every
single one for as long as the right law of the right effect has not been tried from a good start.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.pull import Probe
from automarine_cli.diagnosis.refits import add_effect, go_on, without
from automarine_cli.diagnosis.scores import law_of, probes
from automarine_cli.diagnosis.study import ITERATIONS, Study
from automarine_cli.diagnosis.trials import Compensating, Round, Trial
from automarine_cli.quantities import Floats

AS_WELL = 10.0
"""Evidence (in deviance) by which several effects have to be better than one."""
BRIEF = 6
"""Iterations that tell whether a fit comes near the several effects."""
WITHIN = 0.3
"""Share of what the several gain that such a brief fit may lack to be taken to its end."""
OPPOSED = 0.8
"""Correlation of sizes from which two effects count as of opposite pull."""
USELESS = 0.5
"""Share of what a pair gains below which either alone counts as useless: two of their own gain at least half."""

Each = Callable[[Callable[[Any], "Trial | None"], Sequence[Any], str], Sequence["Trial | None"]]
Stands = Callable[..., bool]


def one_instead(study: Study, current: Trial, first: Round, each: Each, may_stand: Stands) -> tuple[Trial, str]:
    """The single effect that does as well as the several of `current`, with a sentence; or `current` and no sentence.

    It has to do better than each of them alone. Every law of the effects added, of what they are mistaken for and of
    the leaders of the first round is fitted, unless the first round did.
    """
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
    known = {law_of(t.added[-1], t.model.terms[-1].values): t.evidence for t in trials}
    own = [law_of(term.name, term.values) for term in current.model.terms if term.name in current.counted]
    lone = min((known[law] for law in own if law in known), default=np.inf)
    asked = dict.fromkeys([*current.counted, *(s.effect for s in first.scores.ranked[:6])])
    asked |= dict.fromkeys(look for name in current.counted for look in effects.get(name).mistaken_for)
    can = {s.effect for s in first.scores.ranked}
    work = [
        (name, probe.values[-1])
        for name in asked if name in can and name not in base.added
        for probe in _one_a_law(study, name)
        if law_of(name, probe.values[-1]) not in known
    ]  # fmt: skip
    singles = [*trials, *_fits(each(partial(add_effect, study, base, iterations=BRIEF), work, "trying laws"))]
    near = base.evidence - (1.0 - WITHIN) * (base.evidence - current.evidence)
    close = [t for t in singles if t.evidence < max(near, current.evidence + AS_WELL)]
    unsettled = [t for t in close if not t.fit.converged]
    settled = each(partial(go_on, study, base, iterations=ITERATIONS), unsettled, "fitting one instead of several")
    able = [
        t for t in (*(t for t in close if t.fit.converged), *_fits(settled))
        if t.evidence <= current.evidence + AS_WELL and t.evidence < lone and may_stand(study, t, base)
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


def _fits(trials: Sequence[Trial | None]) -> list[Trial]:
    return [trial for trial in trials if trial is not None]


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
    places = [[i for i, name in enumerate(names) if name.startswith(f"{one}.")] for one in pair]
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    best = 0.0
    for i in places[0]:
        for j in places[1]:
            if spread[i] > 0 and spread[j] > 0:
                sign = float(np.sign(size[i] * size[j]) or 1.0)
                best = max(best, sign * float(covariance[i, j]) / float(spread[i] * spread[j]))
    return best
