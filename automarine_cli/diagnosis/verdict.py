"""The verdict to which a search is entitled: named, suspected, nothing missing or unexplained."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from automarine_cli.diagnosis.residual_regions import Gap, ResidualRegions, gains_drift, gap, is_autocorrelated, stretch
from automarine_cli.diagnosis.scores import CLAIM_LEVEL
from automarine_cli.diagnosis.search import MAX_EFFECTS, STANDS, WEAK, SearchResult, clear, may_be_nothing, obstacle
from automarine_cli.diagnosis.study import GAP_HORIZON_S, DiagnosisProblem, log_density
from automarine_cli.diagnosis.trials import CandidateFit, without
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import GAIN_CURVE, PREFIX, kind_of
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits.driven import ForecastScore, worth_of
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run

NAMED, SUSPECTED, NOTHING, UNEXPLAINED = "named", "suspected", "nothing-missing", "unexplained"
MIN_DRIFTING_SCATTER = 0.05  # of thrust over runs, from which its drift may stand behind effects of the library
LEFT_OVER = 0.3  # share of the excess variance over the floor that may stay when an effect is named
ASTRAY = 1.1  # growth of the gap on runs held out at which an explanation cannot be right
TIE_WEIGHT = 0.5  # weight against its rivals below which an effect is a tie and no name


@dataclass(frozen=True)
class ForecastGain:
    """What both models predict of a set of runs, the scores before and after by horizon, and what the log density of
    these runs gained."""

    ahead: tuple[tuple[ForecastScore, ForecastScore], ...]
    density_gain: float

    @property
    def longest(self) -> tuple[ForecastScore, ForecastScore]:
        """The scores over GAP_HORIZON_S, or over the longest horizon below it that any run is long enough for."""
        return next((pair for pair in self.ahead if pair[0].horizon == GAP_HORIZON_S), self.ahead[-1])

    def to_json(self, dof: Dof) -> dict[str, object]:
        def entry(before: ForecastScore, after: ForecastScore) -> dict[str, object]:
            constants = {"constant_rate": before.constant_rate, f"constant_{dof.words.position}": before.constant}
            sizes = {"before": before.error, "after": after.error, **constants}
            errors = {f"{name}_{dof.units.shown}": float(dof.shown(size)) for name, size in sizes.items()}
            return {"horizon_s": before.horizon, **errors}

        every = [entry(*pair) for pair in self.ahead]
        return {**entry(*self.longest), "log_density_gain": self.density_gain, "horizons": every}


def outlook_of(before: Sequence[Predicted], after: Sequence[Predicted], density_gain: float) -> ForecastGain | None:
    """Compare predictions by both models; None where runs are too short for any."""
    ahead = tuple(zip(worth_of(before), worth_of(after)))
    return ForecastGain(ahead, density_gain) if ahead else None


DECIDING = 5.0  # horizons [s] up to this have a veto; over longer ones commands answer what no prediction knows


@dataclass(frozen=True)
class JudgedRuns:
    """Runs that were fitted, or held out, with the gap that both models leave in them, not a number where they are too
    short to show one, and of driven ones what both predict."""

    runs: tuple[Run, ...]
    gap: Gap
    outlook: ForecastGain | None = None

    @property
    def shows(self) -> bool:
        return not np.isnan(self.gap.before)

    def misses(self, least: float) -> bool:
        """Whether what the last model predicts is no better than a constant, by more than `least` [rad or m]."""
        after = self.outlook.longest[1] if self.outlook else None
        return after is not None and not after.of_use and not after.error <= least

    def worse(self, dof: Dof) -> str:
        """Say by how much predictions over the longest deciding horizon get worse; empty where they do not."""
        ahead = self.outlook.ahead if self.outlook else ()
        before, after = next((pair for pair in ahead[::-1] if pair[0].horizon <= DECIDING), (None, None))
        if before is None or after is None or after.error < before.error:
            return ""
        return (
            f"predictions {before.horizon:g} s ahead miss by {dof.shown(after.error):.2f} {dof.units.shown} with them "
            f"and by {dof.shown(before.error):.2f} without"
        )


@dataclass(frozen=True)
class Share:
    """What an effect explains by itself, against the model `without` it, in which all else is refitted: the `evidence`
    that is lost [deviance], how often chance would gain as much, the share of thrust by which runs are `steadier` with
    it, whether its size `may_be_nothing` beside the others, why it may only mend the law of another; and of runs held
    out the log odds, the gap, and the log density that is still `unexplained` with all effects (see
    `unexplained_density`)."""

    without: CandidateFit
    evidence: float
    p_value: float
    steadier: float = 0.0
    may_be_nothing: bool = False
    support: float | None = None
    gap: Gap | None = None
    unexplained: float = np.inf
    feigned: str = ""
    mends: str = ""

    def doubt(self, name: str) -> str:
        """Why runs held out do not bear it out by itself, it may be `feigned`, or no more than `mends` a larger effect;
        empty where nothing is so.

        Where something else makes some of them less likely, it may close most of their gap instead."""
        if self.feigned or self.mends:
            return self.feigned or self.mends
        if self.support is None or self.gap is None:
            return ""
        plain = self.gap.before > STANDS * self.gap.floor and self.gap.closed >= 1.0 - MAX_LEFT
        odds, needed = float(np.exp(self.support)), self.p_value / CONFIRMED
        if odds < needed and not plain:
            likely = f"{odds:.2g} times as likely with {name} as without it"
            return f"The held-out runs are {likely}: a name takes at least {needed:.2g}."
        little = self.gap.little(CONTRIBUTES)
        if little and self.steadier < STEADIER and self.support <= self.unexplained:
            return f"{name} by itself {little}"
        return f"The 95 % interval of the size of {name} holds zero." if self.may_be_nothing else ""


def gained_density(runs: DiagnosisProblem, before: CandidateFit, after: CandidateFit) -> Floats:
    """Return the log density that each of the `runs` gains (R,); next to nothing where a simulation runs away."""
    lost, gained = (log_density(runs, trial.model, trial.fit) for trial in (before, after))
    return np.asarray(np.where(np.isfinite(gained), gained, -1e9) - np.where(np.isfinite(lost), lost, -1e9))


def support(gained: Floats) -> float:
    """Sum up the log odds for an effect from runs held out, whose log densities gain so much by it, (R,)."""
    return float(np.clip(gained, -LOUDEST, LOUDEST).sum())


def unexplained_density(runs: DiagnosisProblem, trial: CandidateFit) -> float:
    """Give what is `unexplained` of runs held out; infinite of runs that are not driven, where nothing says so.

    Shares and forecasts are asked where it is more than the names gain: these may then stand for what is missing."""
    if not runs.driven:
        return np.inf
    return runs.driven_problem(trial.model).unexplained(trial.fit.phi)


def shares(result: SearchResult, held_out: DiagnosisProblem | None) -> dict[str, Share]:
    """Work out the share of each effect of the final model, the largest first."""
    study, final, parts = result.study, result.final, dict[str, Share]()
    unexplained = np.inf if held_out is None else unexplained_density(held_out, final)
    for name in final.added:
        reduced = result.base if len(final.added) == 1 else without(study, final, name)
        if reduced is None:
            continue
        parts[name] = Share(
            reduced, reduced.evidence - final.evidence, result.p_values[name],
            steadier=0.0 if study.driven else reduced.fit.factor(GAIN) - final.fit.factor(GAIN),
            may_be_nothing=study.driven and may_be_nothing(study, final, name),
            support=None if held_out is None else support(gained_density(held_out, reduced, final)),
            gap=None if held_out is None else gap(held_out, reduced, final), unexplained=unexplained,
            feigned=_feigned(result, name),
        )  # fmt: skip
    parts = dict(sorted(parts.items(), key=lambda item: -item[1].evidence))
    total = result.base.evidence - final.evidence
    for name, part in list(parts.items())[1:]:
        if part.gap and part.evidence < LAW_ERROR**2 * total and smallness(study.base.dof, part.gap, part):
            gains = f"{name} brings {100 * part.evidence / total:.2g} % of what is gained"
            parts[name] = replace(part, mends=f"{gains}: perhaps the law of {next(iter(parts))} is a little off.")
    return parts


def confirmed(
    result: SearchResult, held_out: DiagnosisProblem
) -> tuple[SearchResult, dict[str, Share], dict[str, str]]:
    """Take those of several effects out of the search that runs held out do not bear out by themselves, one by one, the
    worst first; give the shares of what stays, and why effects taken out that these runs speak for are not named."""
    suspects = dict[str, str]()
    while True:
        parts = shares(result, held_out)
        doubted = {name: part.support or 0.0 for name, part in parts.items() if part.doubt(name)}
        if not doubted or len(result.final.added) < 2 or all(part.feigned for part in parts.values()):
            return result, parts, suspects
        name = min(doubted, key=doubted.__getitem__)
        suspects |= {name: parts[name].doubt(name)} if doubted[name] > 0.0 else {}
        result = replace(
            result, final=parts[name].without,
            rivals={effect: rivals for effect, rivals in result.rivals.items() if effect != name},
            compensating={pair: says for pair, says in result.compensating.items() if name not in pair},
        )  # fmt: skip


def judged_runs(study: DiagnosisProblem, result: SearchResult, fitted: bool = False) -> JudgedRuns:
    """Judge both models of a search on the runs of `study`; `fitted` if both were fitted to these."""
    base, final, outlook = result.base, result.final, None
    first, last = base.fit, final.fit
    if first.driven and last.driven:
        before, after = study.predictions(base.model, first), study.predictions(final.model, last)
        gained = log_density(study, final.model, last) - log_density(study, base.model, first)
        outlook = outlook_of(before, after, float(np.sum(gained)))
    return JudgedRuns(study.runs, gap(study, base, final, fitted), outlook)


MIN_EXCESS_SHARE = 0.05
FLOOR_ERROR = 1.5
"""Residual noise may exceed the floor by this share, or by three standard errors of the floor (FLOOR_ERROR over the
root of the samples), before runs may hold something more."""
MAX_LEFT = 0.5  # share of the gap's variance above the noise, on runs held out, that a name has to close
STEADIER = 0.005  # share of thrust by which its scatter over runs has to fall where the held-out gap does not
LAW_ERROR = 0.14
"""Share by which the law of an effect may be off. What changes positions by less than their noise, and brings less
than the square of this share of all that is gained, may only mend the law of another effect."""
CONFIRMED = 5e-4
"""Largest p-value over odds of a name: how often chance gains as much, over how many times as likely runs held out are
as under the model without it refitted. No effect was fitted to these: by chance the odds have a mean of one, and the
ratio is a p-value itself (Ignatiadis, Wang, Ramdas 2024, Biometrika 111:417)."""
NOTICED, CONTRIBUTES = 0.1, 0.05
"""Shares of the mean square of the held-out error above the noise that names have to close together, of driven runs,
and each by itself, as each may do some of the work of the others. With less the error falls by under a twentieth:
nobody would notice, and another choice of runs to fit changes it as much."""
LOUDEST = 5.0
"""Log density for which a run speaks at most when runs are asked whether they are predicted better: one in which an
effect shows plainly says no more than that."""
MIN_EXCESS_OF_MANY = 0.25
"""Excess variance that the base must leave before as many effects as may be named are believed: small gaps that take
three are rather one effect that the library lacks."""


@dataclass(frozen=True)
class Verdict:
    """What may be said; `result` is the search as far as that holds: without effects where none is named or suspected.

    `why` says what keeps effects from being named, or what is unexplained; `remainder` what stays beside named ones;
    `shares` are those of the effects named or suspected, the largest first."""

    word: str
    result: SearchResult
    why: str = ""
    remainder: str = ""
    shares: Mapping[str, Share] = field(default_factory=dict)

    @property
    def leaves(self) -> CandidateFit:
        """The model that is left behind: the base with what is named, and only that."""
        return self.result.final if self.word == NAMED else self.result.base


def verdict_of(result: SearchResult, where: ResidualRegions, held_out: DiagnosisProblem | None) -> Verdict:
    """Judge a search, whose base model has its gap at `where`.

    A name needs more evidence than chance gives, and runs that are predicted better than without it by more than
    chance: those of `held_out`, which ask each name by itself, and each fitted run from the others. Of driven runs the
    outlook on the runs held out has a veto. What is beyond chance at WEAK only, or is not borne out, is suspected; what
    is both is chance.
    """
    study, last = result.study, result.claim
    judged = None if held_out is None or last is None else judged_runs(held_out, last)
    if not study.driven:
        reason = _unexplained(result, where, judged.gap if judged and last is result else None)
        if reason:
            without_effects = replace(result, final=result.base, p_values={}, rivals={}, doubtful=None)
            return Verdict(UNEXPLAINED, without_effects, f"{reason} {_nearest(result)}")
    parts, suspects = dict[str, Share](), dict[str, str]()
    if last is not None and held_out is not None:
        borne_out, parts, suspects = confirmed(last, held_out)
        if borne_out is not last:
            result = last = borne_out
            judged = judged_runs(held_out, last)
    doubt = "" if last is None else _borne_out(last, held_out, judged)
    if last is None or (last is not result and doubt):
        if not where.regions:
            return Verdict(NOTHING, result)
        reason = f"The error is beyond chance {stretch(where.regions[0])}."
        return Verdict(UNEXPLAINED, result, f"{reason} {_nearest(result)}")
    if last is not result:
        (p_value,) = last.p_values.values()
        doubt = f"Chance would gain as much in {100 * p_value:.1f} of 100 campaigns like this one."
    else:
        doubt = _no_name(result, judged) or doubt
        doubt = doubt or next(filter(None, (part.doubt(name) for name, part in parts.items())), "")
    if doubt:
        return Verdict(SUSPECTED, last, doubt, shares=parts)
    remainder = result.equals
    if judged and not study.driven and judged.gap.exceeds_noise:
        remainder = f"A residual remains: on the held-out runs the gap is {judged.gap.in_noises}."
    if judged and (worse := judged.worse(study.base.dof)):
        remainder += f" Commands that answer disturbances hide it: {worse}."
    if not study.driven and gains_drift(study, result.final):
        scatters = f"scatters by {100 * result.final.fit.factor(GAIN):.2g} % and drifts over the campaign"
        remainder += f" The thrust of single runs {scatters} more than chance allows: something else may change slowly."
    remainder += "".join(f" Only suspected: {name}. {doubt}" for name, doubt in suspects.items())
    return Verdict(NAMED, result, remainder=remainder.lstrip(), shares=parts)


def _no_name(result: SearchResult, judged: JudgedRuns | None) -> str:
    """Why effects that are borne out have no names of their own: two undo each other and leave something on runs held
    out, or rivals are together likelier; empty where neither is so."""
    if result.compensating and (judged is None or judged.gap.exceeds_noise):
        return next(iter(result.compensating.values()))
    for name in result.final.counted:
        if doubt := _feigned(result, name):
            return doubt
        weight = 1.0 / (1.0 + sum((odds := result.odds(name)).values()))
        if weight < TIE_WEIGHT:
            return f"A tie: the runs do not tell {name} ({100 * weight:.0f} %) from {' or '.join(odds)}."
    return ""


def _feigned(result: SearchResult, name: str) -> str:
    """Why an effect may be what commands tell of readings that the log lacks; empty where it is not."""
    least = result.study.feigned
    if not least:
        return ""
    first, total = result.rounds[0], result.base.evidence - result.final.evidence  # of a curve, which no round tries
    gained = next((first.gain(trial) for trial in first.trials if trial.added == (name,)), total)
    if gained >= least:
        return ""
    return (
        f"The commands answer more than is logged, perhaps a gyro, and such loops feign gains of {least:.0f}: "
        f"{name} by itself gains {gained:.0f}. Log all that the controller reads."
    )


def _borne_out(result: SearchResult, held_out: DiagnosisProblem | None, judged: JudgedRuns | None) -> str:
    """Say why runs that were not fitted do not bear effects out; empty where nothing speaks against them."""
    study = result.study
    more = np.zeros(0) if held_out is None else gained_density(held_out, result.base, result.final)
    if study.driven:
        if held_out is None or judged is None:
            little = judged_runs(study, result, fitted=True).gap.little(NOTICED, "the error of the fitted runs")
            return little and f"No run is held out, and what was added {little}"
        if more.sum() <= 0:
            return f"The held-out runs do not confirm it: their log density falls by {-more.sum():.1f}."
        if support(more) > unexplained_density(held_out, result.final):
            return ""
        worse, little = judged.worse(study.base.dof), judged.gap.little(NOTICED)
        return f"The held-out runs do not confirm it: {worse}." if worse else little and f"What was added {little}"
    gained = result.final.fit.predictive - result.base.fit.predictive
    if _beyond_doubt(-more):
        return f"The held-out runs contradict it: {(more < 0).sum()} of {len(more)} are less likely with it."
    gained = np.concatenate([gained, more])
    curves = [term for term in result.final.model.terms if term.name.startswith(PREFIX) and not term.base]
    # a curve is chosen from many; one that scales the thrust shows less, because each run has a gain of its own
    level = CLAIM_LEVEL if any(kind_of(curve.values) != GAIN_CURVE for curve in curves) else WEAK
    if not _beyond_doubt(gained, level):
        return (
            f"Runs that were left out of the fit are not predicted better beyond chance: {(gained > 0).sum()} of "
            f"{len(gained)} are more likely with it, and chance gains as much in more than {100 * level:g} of 100."
        )
    if judged and judged.gap.exceeds_noise and judged.gap.closed < 1.0 - MAX_LEFT:
        return f"Most of the gap of the held-out runs remains: it is {judged.gap.in_noises}."
    steadier = result.base.fit.factor(GAIN) - result.final.fit.factor(GAIN)
    if judged and judged.gap.after >= judged.gap.before and steadier < STEADIER:
        return "The gap of the held-out runs is no smaller with it, and the thrust of the runs is no steadier."
    return ""


def _beyond_doubt(gained: Floats, level: float = WEAK) -> bool:
    """Whether runs gain in the mean (Student's test, the run as the unit); none speaks louder than LOUDEST."""
    errors = float(-special.stdtrit(max(len(gained) - 1, 1), level))
    return len(gained) > 1 and clear(np.clip(gained, -LOUDEST, LOUDEST), errors)


def _unexplained(result: SearchResult, where: ResidualRegions, holdout: Gap | None) -> str:
    """Say why runs that are simulated whole hold something that nothing in the library explains; empty if they do not.

    So are runs whose residuals stand well above the floor and hang together in time, when what was added closes less
    than most of that gap: the candidate then only fits least badly. So are runs whose own gains of thrust wander with
    the campaign's clock, for a gain a run can follow anything that changes slowly, and no residual shows; and runs that
    would take more effects than anybody should believe; and an explanation that leads runs held out astray."""
    study, final = result.study, result.final
    if holdout is not None and holdout.after > ASTRAY * holdout.before:
        return f"What explains the fitted runs makes the held-out runs worse: their gap is {holdout.in_noises}."
    excess = [max((trial.fit.noise / study.sensor_floor) ** 2 - 1.0, 0.0) for trial in (result.base, final)]
    margin = max(MIN_EXCESS_SHARE, 3.0 * FLOOR_ERROR / float(np.sqrt(study.batch.seen.sum())))
    times = final.fit.noise / study.sensor_floor
    closed = bool(final.added) and excess[1] <= LEFT_OVER * excess[0] and times <= STANDS
    if times > 1.0 + margin and not closed and is_autocorrelated(study, final):
        return f"The residual is correlated in time and is {times:.2f} times the noise{_beside(where)}."
    scatter = [trial.fit.factor(GAIN) ** 2 for trial in (result.base, final)]
    unnamed = not final.added or scatter[1] > max(LEFT_OVER * scatter[0], MIN_DRIFTING_SCATTER**2)
    if unnamed and gains_drift(study, final):
        return f"The thrust of single runs drifts over the campaign more than chance allows{_beside(where)}."
    if result.more or (final.count == MAX_EFFECTS and excess[0] < MIN_EXCESS_OF_MANY):
        more = " or more" if result.more else ""
        return f"The runs would take {MAX_EFFECTS} effects{more}, more than they can support."
    return ""


def _beside(where: ResidualRegions) -> str:
    return f", most clearly {stretch(where.regions[0])}" if where.regions else ""


def _nearest(result: SearchResult) -> str:
    study, first, final = result.study, result.rounds[0], result.final
    if not final.added:
        best = max(first.trials, key=first.gain, default=None)
        if best is None or first.gain(best) <= first.threshold:
            return "No effect of the library gains more than chance."
        return (
            f"{best.added[-1]} gains {first.gain(best):.1f} in deviance, where chance reaches {first.threshold:.1f}, "
            f"but {obstacle(study, best, first.before) or 'less than it has to'}."
        )
    dof = study.base.dof
    before, after = (float(dof.shown(trial.fit.noise)) for trial in (result.base, final))
    return (
        f"The best candidate is {' and '.join(final.added)}, with which the residual of the fitted runs is {after:.3g} "
        f"instead of {before:.3g} {dof.words.units}."
    )


def smallness(dof: Dof, runs: Gap, part: Share) -> str:
    """Say that an effect changes the positions by less than their noise; empty where thrust is steadier with it."""
    without_it, with_it = runs.residuals
    observed = with_it[with_it != 0.0]
    change = float(np.sqrt(((without_it - with_it) ** 2).sum() / max(observed.size, 1)))
    if not observed.size or change >= runs.floor or part.steadier >= STEADIER:
        return ""
    change_shown, noise = (f"{dof.shown(size):.2g} {dof.units.shown}" for size in (change, runs.floor))
    return f"It is small: it changes the {dof.words.position} by {change_shown}, and the noise is {noise}."
