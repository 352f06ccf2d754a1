"""What was learned, to be shown: the curve with its band, and what the verdict says of it."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.residual_regions import is_autocorrelated
from automarine_cli.diagnosis.scores import CLAIM_LEVEL, DRAWS, CandidateShape, penalty, project, score_information
from automarine_cli.diagnosis.search import (
    FORETELLS,
    MAX_EFFECTS,
    RIVAL_RANGE,
    STANDS,
    TO_THE_NOISE,
    Rivals,
    SearchResult,
    SearchStep,
    nearest,
    obstacle,
)
from automarine_cli.diagnosis.study import SPREADS, DiagnosisProblem, learned_term, places, precision, smoothed
from automarine_cli.diagnosis.trials import SEARCH_BRIEF, TIE, CandidateFit, all_refitted, attempt_with, refitted
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import (
    DRAG,
    FIRST_KNOTS,
    GAIN_CURVE,
    KINDS,
    KNOTS,
    MOMENT,
    PREFIX,
    TIME,
    Learned,
    basis,
    hyphened,
    kind_of,
    scale_of,
)
from automarine_cli.errors import FitError
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.stepwise import Chance
from automarine_cli.models.model import Model
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.quantities import CLOCK, SINCE, Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import signals_of

TRIED = 0.02  # value at which each knot is tried, a share of the largest moment or of the thrust
MIN_RUNS_COMPARED = 10  # runs from which their gains may be compared with a column
STANDS_FOR = 0.9  # correlation with the campaign's clock from which a column only stands for time
FOLLOWS = 0.01  # chance below which the gains of runs follow a column
POWERS = (1, 3, 6, 9)  # highest powers of a column by which gains are then explained: from a line to two waves
DEALS = 2000  # orders in which runs are dealt to tell what chance explains


def scored(
    study: DiagnosisProblem, base: CandidateFit, seed: int, map_fn: Each = alone
) -> tuple[list[tuple[float, Model]], Chance]:
    """All curves that these runs can show, best first, and what the best of them gains by chance, (DRAWS,): the
    deviance that each gains by its score, with its parameters counted, and the model where a fit should start."""
    models = candidates(study, base.model)
    names = list(dict.fromkeys(model.terms[-1].name for model in models))  # models come effect by effect
    try:
        of_runs = score_information(study, base.model, base.fit, names, list(map(_probe, models)), map_fn)
        information, pull = (every.sum(axis=0) for every in project(*of_runs, base.fit))
    except FitError:
        return [], Chance(np.zeros(DRAWS))
    information, pull = information / TRIED**2, pull / TRIED
    values, vectors = np.linalg.eigh(information)
    random = np.random.default_rng(seed)
    draws = random.standard_normal((DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    curves, null = [], np.full(DRAWS, -np.inf)
    for number, model in enumerate(models):
        block = slice(number * KNOTS, (number + 1) * KNOTS)
        tried = np.concatenate([pull[None, block], draws[:, block]])
        gain, curve, spread = _gains(information[block, block], tried, model, len(study.runs))
        null = np.maximum(null, gain[1:])
        curves.append((float(gain[0]), with_curve(model, spread, np.clip(curve, -1.0, 1.0))))
    return sorted(curves, key=lambda pair: -pair[0]), Chance(null)


def _gains(information: Floats, pulls: Floats, model: Model, runs: int) -> tuple[Floats, Floats, float]:
    """Evidence gained (n,) by a curve of each score in `pulls` (n, KNOTS), each at its own likeliest spread; the first
    one's values and spread."""
    likely, gains, curves = [], [], []
    for spread in SPREADS:
        prior = precision(model, float(spread))
        inverse = np.linalg.inv(information + prior)
        curve = pulls @ inverse
        log_det = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(inverse)[1]
        likely.append((pulls * curve).sum(axis=1) + log_det)
        drop = 2.0 * (pulls * curve).sum(axis=1) - np.einsum("nk,kj,nj->n", curve, information, curve)
        gains.append(drop - float(np.trace(inverse @ information)) * penalty(1, runs))
        curves.append(curve[0])
    at = np.argmax(likely, axis=0)
    return np.stack(gains)[at, np.arange(len(pulls))], curves[at[0]], float(SPREADS[at[0]])


def _probe(model: Model) -> CandidateShape:
    term = model.terms[-1]
    rows = np.tile(term.values, (KNOTS, 1))
    rows[np.arange(KNOTS), FIRST_KNOTS + np.arange(KNOTS)] = TRIED
    return CandidateShape(term.name, rows, tuple(range(FIRST_KNOTS, FIRST_KNOTS + KNOTS)), False)


def candidates(study: DiagnosisProblem, model: Model) -> list[Model]:
    """The model with a flat curve over each variable that the runs show, of each kind."""
    models = []
    for name, (low, high) in ranges(study).items():
        effect = effects.get(PREFIX + name)
        assert isinstance(effect, Learned)
        if effect.acts_in(model.dof) and (study.position_counts or not effect.uses_absolute):
            for kind in effect.variable.kinds:
                if kind == GAIN_CURVE and not study.commanded:
                    continue
                values = [low, high, study.largest, 1.0, *[0.0] * KNOTS, float(KINDS.index(kind))]
                models.append(model.with_effect(effect.name, values))
    return models


def ranges(study: DiagnosisProblem) -> dict[str, tuple[float, float]]:
    """Every variable over which a curve may run, with its ends."""
    dof, batch = study.base.dof, study.batch
    way = np.where(batch.seen, batch.position - batch.position[:, :1], 0.0)
    intervals = {
        hyphened(dof.words.rate): (0.0, study.fastest),
        hyphened(dof.words.force): (0.0, study.largest if study.commanded else 0.0),
        TIME: (0.0, float(batch.time.max())),
    }
    if dof.restoring:
        angles = batch.position[batch.seen]
        intervals[dof.words.position] = (float(angles.min()), float(angles.max()))
    else:
        intervals[hyphened(dof.words.travelled)] = (float(way.min()), float(way.max()))
    if dof.wraps:
        intervals[dof.words.position] = (0.0, dof.turn)
    clock = np.concatenate(signals_of(study.runs, CLOCK))
    for name in (CLOCK, SINCE, *_columns(study.runs, dof)):
        values = np.concatenate(signals_of(study.runs, name))
        if len(study.runs) >= MIN_RUNS_COMPARED or not _alike(values, clock):
            intervals[name] = (float(values.min()), float(values.max()))
    return {name: (low, high) for name, (low, high) in intervals.items() if high - low > 1e-9 * max(abs(high), 1e-9)}


SETPOINT = re.compile(r"set_?point|desired|target|reference|demand", re.IGNORECASE)


def _alike(values: Floats, clock: Floats) -> bool:
    """Whether a column only stands for time: what changes from run to run of a few goes with the clock by chance."""
    spread = float(np.std(values) * np.std(clock))
    return spread > 0 and abs(float(np.cov(values, clock, ddof=0)[0, 1])) > STANDS_FOR * spread


def _columns(runs: Sequence[Run], dof: Dof) -> list[str]:
    """Logged columns with a value in every row of every run, but for those that measure the motion itself or say what a
    controller is after, which moves nothing but through the command."""
    shared = set.intersection(*(set(run.extras) for run in runs)) - {dof.velocity, dof.command, *dof.thrusters}
    physical = (name for name in shared if not SETPOINT.search(name))
    return sorted(n for n in physical if all(np.isfinite(run.extras[n]).all() for run in runs))


def with_curve(model: Model, spread: float, curve: Floats) -> Model:
    *terms, last = model.terms
    values = (*last.values[: FIRST_KNOTS - 1], spread, *(float(v) for v in curve), last.values[-1])
    return replace(model, terms=(*terms, replace(last, values=values)))


def gains_follow(study: DiagnosisProblem, trial: CandidateFit, seed: int) -> str:
    """The column that the runs' own gains follow; empty where they follow none beyond a chance of FOLLOWS.

    Its mean in each run counts: least squares of the gains on its powers up to each of POWERS, the best of all columns
    by Fisher's test, compared with that of runs dealt in another order (`seed`)."""
    gains, runs = trial.fit.effects_of(linear_mixed.GAIN)[:, 0], study.runs
    if len(runs) < MIN_RUNS_COMPARED or np.ptp(gains) < 1e-9:
        return ""
    random, follows = np.random.default_rng(seed), ""
    dealt = np.array([gains, *(random.permutation(gains) for _ in range(DEALS))]) - gains.mean()
    total, best = float((dealt[0] ** 2).sum()), np.ones(1 + DEALS)
    for name in _columns(runs, study.base.dof):
        means = np.array([float(np.mean(values)) for values in signals_of(runs, name)])
        if np.ptp(means) > 1e-9 * max(float(np.abs(means).max()), 1e-9):
            powers = np.vander(2.0 * (means - means.min()) / np.ptp(means) - 1.0, POWERS[-1] + 1, increasing=True)
            axes = np.linalg.qr(powers)[0][:, 1:]  # its powers less what lower ones are already
            share = np.cumsum((dealt @ axes) ** 2, axis=1) / total
            for count in [count for count in POWERS if 3 * count < len(runs)]:
                free = len(runs) - count - 1
                explained, noise = share[:, count - 1] / count, np.maximum(1.0 - share[:, count - 1], 1e-12) / free
                chance = special.fdtrc(count, free, explained / noise)
                follows = name if chance[0] < best[0] else follows
                best = np.minimum(best, chance)
    return follows if (best[1:] <= best[0]).mean() < FOLLOWS else ""


CURVES_FITTED = 4
MAX_CURVES_FITTED, MIN_SCORE_SHARE = 6, 0.5  # where more have this share of the best score
BRIEF_GAIN_SHARE = 0.2  # share of the best gain by which brief fits may be behind that are taken further
EFFECT_GAIN_SHARE = 0.02  # of the gain of one effect, within which it does as well as a curve: its law may be off
AT_ONCE = 2.0  # times what any effect gains, by which a curve ends a search after its first look
SPREAD_ROUNDS = 2  # how often the spread is chosen again after a fit
SAME_SPREAD = 0.1  # difference of the logarithm of two spreads that is none


def _with_signals(study: DiagnosisProblem, *names: str) -> DiagnosisProblem:
    return replace(study, signals=tuple(sorted({*study.signals, *names})))


def learn_at_once(study: DiagnosisProblem, first: SearchStep, seed: int, map_fn: Each) -> SearchResult | None:
    """The outcome after the first look if a curve over a logged column alone leaves no more than noise and gains
    AT_ONCE times what any effect does, which no effects together are worth trying against; None if not."""
    base, columns = first.before, _columns(study.runs, study.base.dof)
    gained = max(map(first.gain, first.trials), default=0.0)
    if study.driven or not columns or learned_term(study.base) is not None:
        return None
    wide = _with_signals(study, CLOCK, SINCE, *columns)
    over, best_score = {PREFIX + name for name in columns}, first.scores.ranked[0].penalised
    if not any(m.terms[-1].name in over and gain > best_score for gain, m in scored(wide, base, seed, map_fn)[0]):
        return None
    result = SearchResult(study, base, base, (first,), {}, {})
    best = _best(wide, result, base, "", base.evidence - AT_ONCE * gained, seed, map_fn)
    if best is None or best.final.added[-1] not in over or base.evidence - best.final.evidence < AT_ONCE * gained:
        return None
    silent = best.final.fit.noise <= TO_THE_NOISE * study.sensor_floor
    return replace(best, study=_with_signals(study, *best.final.model.signals)) if silent else None


def learn(
    study: DiagnosisProblem, result: SearchResult, seed: int, map_fn: Each, explained: Callable[[SearchResult], bool]
) -> SearchResult:
    """What a search found, with a learned curve where something is left that asks for one and a curve explains it.

    `explained` judges an outcome. A model that has its curve is left as it is. Where effects of the library do as well
    as a curve they keep their names, and it is their rival."""
    if learned_term(study.base) is not None:
        return result
    wide = _with_signals(study, CLOCK, SINCE, *_columns(study.runs, study.base.dof))
    enough, count = explained(result), result.final.count
    follows = "" if study.driven else gains_follow(wide, result.final, seed)
    shows = bool(follows) or (count < 2 and bool(count or study.driven) and _shows(wide, result.final, seed))
    if enough and count < 2 and not shows:
        return result  # a law that is only somewhat off keeps its name where nothing beside it shows
    bases, most = [result.base, result.final][: 1 + bool(count)], np.inf
    if enough and count:  # a library that does as well wins
        bases = bases if study.driven or follows else bases[:1]
        gained = result.base.evidence - result.final.evidence
        most = result.final.evidence - max(TIE, EFFECT_GAIN_SHARE * gained * (count == 1))
    tied: Rivals = {}
    for base in bases:
        best = _best(wide, result, base, follows, most, seed, map_fn) if base.count < MAX_EFFECTS else None
        if best is None:
            continue
        wins = all(obstacle(study, trial, base) for trial in _as_good(result, base, best.final))
        if wins and best.final.evidence < most and explained(best):
            return replace(best, study=_with_signals(study, *best.final.model.signals))
        if base is result.base:
            tied = ties(result, best.final)
    rivals = {name: {**result.rivals.get(name, {}), **tied.get(name, {})} for name in result.p_values}
    return replace(result, rivals=rivals)


def ties(result: SearchResult, curve: CandidateFit) -> Rivals:
    """A curve that does as well as what was found, as a rival of each of its effects."""
    behind = max(curve.evidence - result.final.evidence, 0.0)
    return {name: nearest({curve.added[-1]: behind}) for name in result.final.added}


def _as_good(result: SearchResult, base: CandidateFit, curve: CandidateFit) -> list[CandidateFit]:
    """What the search tried of the library beside `base` that does as well as a curve."""
    steps = [step for step in result.rounds if step.before.added == base.added]
    return [trial for step in steps for trial in step.trials if trial.evidence < curve.evidence + TIE]


def _shows(study: DiagnosisProblem, base: CandidateFit, seed: int) -> bool:
    """Whether a curve beside what was found would gain more than chance by its score."""
    curves, chance = scored(study, base, seed)
    return bool(curves) and curves[0][0] > max(chance.threshold(CLAIM_LEVEL), 0.0)


def _best(
    study: DiagnosisProblem, result: SearchResult, base: CandidateFit, follows: str, most: float, seed: int,
    map_fn: Each,
) -> SearchResult | None:  # fmt: skip
    """The search's outcome with the best curve beside what `base` has, if one beats chance. A gain over the column that
    the runs' own gains follow is tried whatever its score, in which their scatter stays as large as it is without. What
    a score, of driven runs, or a brief fit leaves too far above an evidence of `most` is not fitted to its end."""
    curves, chance = scored(study, base, seed + len(base.added), map_fn)
    bar = max(chance.threshold(CLAIM_LEVEL), 0.0)
    least = max(MIN_SCORE_SHARE * curves[0][0], 0.0) if curves else 0.0
    reach = (base.evidence - most - RIVAL_RANGE) / FORETELLS if study.driven else -np.inf
    leading = [
        model for i, (gain, model) in enumerate(curves)
        if (gain > reach and (i < CURVES_FITTED or (i < MAX_CURVES_FITTED and gain > least)))
        or ((term := model.terms[-1]).name == PREFIX + follows and kind_of(term.values) == GAIN_CURVE)
    ]  # fmt: skip
    starts = [(model.terms[-1].name, np.array(model.terms[-1].values)) for model in leading]
    attempts = [attempt_with(base, start) for start in starts]
    tried = all_refitted(study, attempts, SEARCH_BRIEF, map_fn, "trying curves")
    gains = [(base.evidence - trial.evidence, trial) for trial in tried if trial is not None]
    gained = max((gain for gain, _ in gains), default=0.0)
    needed = max(gained, base.evidence - most) - max(RIVAL_RANGE, BRIEF_GAIN_SHARE * gained)
    running = [t for gain, t in gains if gain + t.fit.promised > needed and may_explain(study, t)]
    tried = map_fn(partial(_further, study), running, "learning curves")
    trials = sorted((trial for trial in tried if trial is not None), key=lambda trial: trial.evidence)
    admissible = [t for t in trials if base.evidence - t.evidence > bar and not obstacle(study, t, base)]
    if not admissible:
        return None
    best = admissible[0]
    name, library = best.added[-1], _as_good(result, base, best)
    behind = {t.added[-1]: max(t.evidence - best.evidence, 0.0) for t in reversed([*trials, *library])}
    behind.pop(name)
    rivals = {n: of for n, of in result.rivals.items() if n in base.added} | {name: nearest(behind)}
    p_value = chance.p_value(base.evidence - best.evidence)
    p_values = {n: p for n, p in result.p_values.items() if n in base.added} | {name: p_value}
    undoing = {pair: says for pair, says in result.compensating.items() if set(pair) <= set(base.added)}
    return replace(
        result, study=study, final=best, p_values=p_values, rivals=rivals, more=False, doubtful=None,
        compensating=undoing,
    )  # fmt: skip


def may_explain(study: DiagnosisProblem, trial: CandidateFit) -> bool:
    """Whether a brief fit may come to leave STANDS times the noise, if it gains FORETELLS times what its equations
    promise, or leaves residuals that do not hang together."""
    if trial.fit.driven:
        return True
    readings = float(study.batch.seen.sum())
    reached = trial.fit.noise * np.exp(-0.5 * FORETELLS * trial.fit.promised / readings)
    return bool(reached < STANDS * study.sensor_floor) or not is_autocorrelated(study, trial)


def _further(study: DiagnosisProblem, trial: CandidateFit) -> CandidateFit | None:
    """The same taken to the end; the spread is chosen again by each fit."""
    for _ in range(1 + SPREAD_ROUNDS):
        spread, _ = smoothed(trial.fit, trial.model)
        model = with_curve(trial.model, spread, trial.fit.theta[places(trial.model)])
        again = refitted(study, model, trial.added, model.theta, trial.fit)
        if again is None or abs(np.log(spread / trial.model.terms[-1].values[FIRST_KNOTS - 1])) < SAME_SPREAD:
            return again
        trial = again
    return trial


POINTS = 61  # places at which a curve is told


@dataclass(frozen=True)
class LearnedCurve:
    """A curve over `variable` [`unit`]: `y` (POINTS,) at `x` [`y_unit`], with its 95 % band from `low` to `high`.

    It is in the gauge of the fit: of a gain the mean is in inertia and drag, of a moment over the speed what drag of
    the model would do is in that."""

    variable: str
    unit: str
    kind: str
    y_unit: str
    x: Floats
    y: Floats
    low: Floats
    high: Floats
    sized: bool

    def to_json(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "sized"}


def curve_of(trial: CandidateFit) -> LearnedCurve | None:
    inside = learned_term(trial.model)
    if inside is None:
        return None
    model, term = trial.model, trial.model.terms[inside]
    effect = effects.get(term.name)
    assert isinstance(effect, Learned)
    low, high = term.values[:2]
    kind, variable, scale = kind_of(term.values), effect.variable, scale_of(term.values)
    y_unit = {MOMENT: "{force}", GAIN_CURVE: "1", DRAG: "{force} s{/x}"}[kind]
    at = places(model)
    covariance, values = trial.fit.covariance[np.ix_(at, at)], trial.fit.theta[at]
    x = np.linspace(low, high, POINTS)
    shape = basis(x, low, high, closed=bool(variable.turn))
    y = shape @ values * scale
    half = special.ndtri(0.975) * scale * np.sqrt(np.einsum("nk,kj,nj->n", shape, covariance, shape))
    units = [model.dof.unit_in(unit, model.moment_unit) for unit in (variable.unit, y_unit)]
    return LearnedCurve(
        term.name.removeprefix(PREFIX), units[0], kind, units[1], x, y, y - half, y + half, variable.sized
    )


def sentence(curve: LearnedCurve, result: SearchResult) -> str:
    words = result.final.model.dof.words
    size = f"{100 * np.ptp(curve.y):.2g} %" if curve.kind == GAIN_CURVE else f"{np.ptp(curve.y):.2g} {curve.y_unit}"
    cause, which = {
        MOMENT: (f"A {words.force}", "it differs"),
        GAIN_CURVE: ("The thrust", "it differs"),
        DRAG: ("The drag", f"what it has in proportion to the {words.rate} differs"),
    }[curve.kind]
    return f"{cause} depends on {curve.variable}: {which} by {size} over its range; no effect of the library does this."
