"""A whole diagnosis, its result, of one motion or the plane, and the verdict to which a search is entitled: named,
suspected, nothing missing or unexplained."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.learned_curve import curve_of, learn, learn_at_once, sentence
from automarine_cli.diagnosis.residual_regions import (
    Gap,
    ResidualRegions,
    find_where,
    gains_drift,
    gap,
    gap_from_commands,
    is_autocorrelated,
    stretch,
)
from automarine_cli.diagnosis.scores import CLAIM_LEVEL, fitted_parameters, penalty
from automarine_cli.diagnosis.search import (
    MAX_EFFECTS,
    STANDS,
    TIE,
    WEAK,
    CandidateFit,
    SearchResult,
    SearchStep,
    all_refitted,
    along_edge,
    attempt_on,
    clear,
    edges_of,
    gain_exponent,
    is_of_early_logs,
    may_be_nothing,
    obstacle,
    search,
    variants,
    without,
)
from automarine_cli.diagnosis.study import GAP_HORIZON_S, DiagnosisProblem, LimitCycle, log_density, study_of
from automarine_cli.dofs import YAW, Dof, Motion
from automarine_cli.effects.learned import GAIN_CURVE, PREFIX, kind_of
from automarine_cli.errors import TooFewRunsError
from automarine_cli.estimate import Estimate
from automarine_cli.filters.kalman import MAX_Z, Predicted
from automarine_cli.fits.characteristics import steering_json, steering_of
from automarine_cli.fits.driven import ForecastScore, worth_of
from automarine_cli.fits.identify import valid_range
from automarine_cli.fits.innovations import channel_noises, channels_json, random_estimates
from automarine_cli.fits.linear_mixed import GAIN
from automarine_cli.fits.mixed_model import CHI2_95
from automarine_cli.fits.stepwise import NamedRival
from automarine_cli.fits.whole_runs import covariance_json, estimate_of, ratio_of, varying_terms
from automarine_cli.models.model import COMMAND_DELAY, Model
from automarine_cli.models.store import DIAGNOSIS, ROLES, effects_json, model_head
from automarine_cli.pipeline.parallel import Each, alone
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.run import ExcludedRun, Run, runs_json, with_later_commands

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


@dataclass(frozen=True)
class NamedEffect:
    """An effect that is missing from the base model, with its parameters, how sure that is, and its rivals.

    `law` says in which form it acts, where nature has more than one; `learned` is the curve (`LearnedCurve`) of one
    that was learned, `label` the name with what it adds, where the name alone does not tell. `evidence` [deviance] and
    the log odds of runs held out are against the model without it alone (`Share`)."""

    name: str
    law: str
    says: str
    parameters: Mapping[str, Any]  # Estimate, or Given of a thruster curve's at its bound
    confidence: float
    p_value: float | None
    rivals: tuple[NamedRival, ...]
    learned: Any = None
    label: str = ""
    evidence: float | None = None
    held_out_log_odds: float | None = None

    @property
    def title(self) -> str:
        return self.label or self.name

    def to_json(self) -> dict[str, object]:
        plain = {
            **vars(self),
            "parameters": {name: value.to_json() for name, value in self.parameters.items()},
            "rivals": [_without_blanks(vars(rival)) for rival in self.rivals],
            "learned": self.learned and self.learned.to_json(),
        }
        return _without_blanks(plain)


def _without_blanks(fields: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None and value != ""}


def listed_rivals(rivals: Sequence[NamedRival], share: float = 1.0) -> tuple[float, tuple[NamedRival, ...]]:
    """Weigh an effect among rivals whose `confidence` is their odds against it, together `share`; give its weight, and
    the rivals with theirs."""
    weight = share / (1.0 + sum(rival.confidence for rival in rivals))
    return weight, tuple(replace(rival, confidence=weight * rival.confidence) for rival in rivals)


def diagnosis_json(
    of: Mapping[str, object], why: str, effects: Iterable[NamedEffect], where: ResidualRegions,
    gaps: Mapping[str, Gap | None], unit: str, convert: Callable[[float], float] = float,
) -> dict[str, object]:  # fmt: skip
    """Begin the diagnosis.json of any family, after what it is `of`: why, effects, regions and gaps in `unit`."""
    return {
        "schema": DIAGNOSIS.schema,
        **of,
        **({"why": why} if why else {}),
        "effects": [effect.to_json() for effect in effects],
        "where": [region.to_json(unit) for region in where.regions],
        "gap": {name: gap and gap.to_json(unit, convert) for name, gap in gaps.items()},
    }


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


@dataclass(frozen=True, repr=False, kw_only=True)
class Diagnosis(Shown):
    """What a diagnosis of a model of one `motion`, or of the plane, found; errors are in the unit of `dof`.

    `verdict` is "named", "suspected", "nothing-missing" or "unexplained". `why` says what keeps effects from being
    named, or what is unexplained, `remainder` what stays with named ones. `effects` are those that are named or
    suspected; `where` is the error of the base model; `search` is the outcome as far as the verdict holds, with all
    `candidates` and the `threshold` of evidence. `fitted` are the errors of the runs fitted, `held_out` those of the
    rest, None where too few runs were left to hold any out, and so is `from_commands`, the error of these runs by the
    commands alone; `decisive` is the one that decides. `base` has the parameters of the base model before and after,
    `extended` is the base model with the effects named, refitted together, and `extended_model(file)` the same as a
    file's content. Of one motion `number` is that of the model, `moment_unit` its unit, `detectable` has the smallest
    sizes that would have been named, `noises` and `channels` are its sensors, `gain_scatter` is the share by which
    thrust differs from run to run, before and after. `driven` says that a controller or pilot reacted, `cycle` the
    oscillation of that loop or None. The base stands in the file `parent`; `set_aside` are the runs left out.
    `to_json()` is diagnosis.json.

    Frame, a row per effect and parameter: `effect`, `confidence`, `parameter`, `value`, `stderr`, `low`, `high`,
    `unit`.

    Keys: `schema`, `verdict`, `effects`, `where`, `gap`, `from_commands`, `model`, `moment_unit`, `candidates`,
    `threshold`, `base`, `smallest_visible`, `open_water`, `held_out`, `runs`.
    """

    motion: Motion
    dof: Dof
    search: Any
    verdict: str
    why: str
    effects: tuple[NamedEffect, ...]
    where: ResidualRegions
    fitted: JudgedRuns
    held_out: JudgedRuns | None
    candidates: Sequence[Mapping[str, object]]
    threshold: float
    base: Mapping[str, tuple[Estimate, Estimate]]
    extended: Mapping[str, object]
    driven: bool = True
    remainder: str = ""
    from_commands: Gap | None = None
    number: str = ""
    moment_unit: str = ""
    cycle: LimitCycle | None = None
    detectable: Mapping[str, float] = field(default_factory=dict)
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    noises: Mapping[str, Estimate] = field(default_factory=dict)
    gain_scatter: tuple[float, float] = (0.0, 0.0)
    set_aside: tuple[ExcludedRun, ...] = ()
    parent: object = ""

    @property
    def decisive(self) -> JudgedRuns:
        """The runs whose error the verdict tells: those held out, if they show one."""
        return self.held_out if self.held_out and self.held_out.shows else self.fitted

    def document(self, option: str) -> Document:
        if option == "diagnosis":
            return json_document("diagnosis.json", self.to_json())
        return json_document("extended_model.json", self.extended_model())

    def extended_model(self) -> dict[str, object]:
        """Return the base model with the effects named: `validate` and `diagnose` take it."""
        return {**self.extended, "parent": self.parent}

    def to_json(self) -> dict[str, object]:
        dof, plane, free = self.dof, self.motion.turns, self.from_commands
        held_out = self.held_out.runs if self.held_out else ()
        parts = {"fitted_runs": self.fitted, "held_out_runs": self.held_out}
        gaps = {name: part.gap if part and part.shows else None for name, part in parts.items()}
        outlooks = {name: part and part.outlook and part.outlook.to_json(dof) for name, part in parts.items()}
        of = {**({} if self.motion.name == YAW.name else {"motion": self.motion.name}), "verdict": self.verdict}
        model = {"model": self.number, f"{dof.words.force}_unit": self.moment_unit}
        sensors = {
            "smallest_visible": self.detectable, "open_water": self.driven, **channels_json(self.channels, self.noises),
        }  # fmt: skip
        return {
            **diagnosis_json(of, self.why, self.effects, self.where, gaps, dof.units.shown, dof.shown),
            **({} if self.driven else {"from_commands": {"held_out_runs": free and free.to_json(dof.units.shown)}}),
            **({"left": self.remainder} if self.remainder else {}),
            **({} if plane else model),
            **({} if self.cycle is None else {"limit_cycle": self.cycle.to_json()}),
            **({"prediction": outlooks} if any(outlooks.values()) else {}),
            "candidates": list(self.candidates),
            "threshold": self.threshold,
            "base": {
                name: {"before": before.to_json(), "after": after.to_json()}
                for name, (before, after) in self.base.items()
            },
            **({} if plane else sensors),
            "held_out": [run.name for run in held_out],
            "runs": runs_json(len(self.fitted.runs), self.set_aside, (*self.fitted.runs, *held_out)),
        }


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


def whitening_gain(innovation: Floats, variance: Floats, time: Floats) -> float:
    """Give the log density that innovations (R, K) with their variance, zero where nothing was read, would gain if each
    were predicted from those of MEMORY_S before it, less one for each coefficient (Akaike 1974, IEEE Trans. Automat.
    Contr. 19:716). White ones gain nothing, or less."""
    runs, steps = [], [MEMORY_S]
    for errors, variances, clock in zip(innovation, variance, time):
        at = np.flatnonzero(variances > 0)
        runs.append(np.clip(errors[at] / np.sqrt(variances[at]), -MAX_Z, MAX_Z))
        steps.extend(np.diff(clock[at]))
    order = max(round(MEMORY_S / float(np.median(steps))), 1)
    windows = [np.lib.stride_tricks.sliding_window_view(white, order + 1) for white in runs if len(white) > order]
    if not windows:
        return 0.0
    before, now = np.split(np.concatenate(windows), [order], axis=1)
    if len(now) <= 2 * order:  # too few to tell
        return np.inf
    remaining = now - before @ np.linalg.lstsq(before, now, rcond=None)[0]
    return 0.5 * len(now) * float(np.log((now**2).sum() / (remaining**2).sum())) - order


def unexplained_density(runs: DiagnosisProblem, trial: CandidateFit) -> float:
    """Give the log density that runs held out would gain if all that their readings foretell were explained; infinite
    of runs that are not driven, where nothing says so."""
    if not runs.driven:
        return np.inf
    followed = runs.driven_problem(trial.model).follow(trial.fit.phi[None])
    channels = zip(followed.innovation[:, 0], followed.variance[:, 0])
    return sum(whitening_gain(*channel, runs.course.time) for channel in channels)


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


def parameter_estimates(study: DiagnosisProblem, trial: CandidateFit, name: str) -> dict[str, Estimate]:
    """Estimates of one effect's parameters with the run as the unit, by their names in files."""
    estimates = _estimates(study, trial)
    return {p: estimates[trial.model.index(f"{name}.{p}")] for p in effects.get(name).names_in(trial.model.dof)}


def base_estimates(study: DiagnosisProblem, trial: CandidateFit) -> dict[str, Estimate]:
    return dict(zip(study.base.short_names, _estimates(study, trial)))


def _estimates(study: DiagnosisProblem, trial: CandidateFit) -> list[Estimate]:
    model, covariance = trial.model, study.covariance(trial.model, trial.fit)
    estimates = [estimate_of(trial.fit, covariance, i) for i in range(len(model.theta))]
    for place in edges_of(model):
        estimates[place] = _edge_estimate(study, trial, place)
    scale = float(np.sqrt(2.0) * (1.0 if study.driven else study.largest))
    for name in varying_terms(model):  # the amplitude of which every run has a share, by the likelihood of their spread
        low, high = (scale * end for end in trial.fit.factor_interval(name))
        value, error = scale * trial.fit.factor(name), (high - low) / (2.0 * float(special.ndtri(0.975)))
        place = model.index(f"{name}.{effects.get(name).names_in(model.dof)[0]}")
        estimates[place] = Estimate(value, error, (low, high), model.moment_unit)
    return estimates


def _edge_estimate(study: DiagnosisProblem, trial: CandidateFit, i: int) -> Estimate:
    """Estimate an edge by the places between which the deviance stays below that of the ends of a 95 % interval."""
    places, deviance = along_edge(study, trial, i)
    middle = len(places) // 2
    out = np.flatnonzero(deviance > deviance[middle] + CHI2_95)
    low = float(places[out[out < middle].max(initial=0)])
    high = float(places[out[out > middle].min(initial=len(places) - 1)])
    return Estimate(float(places[middle]), (high - low) / 12.0**0.5, (low, high), trial.fit.parameters[i].unit)


def detectable(result: SearchResult) -> dict[str, float]:
    """Smallest size of each candidate's first parameter that these runs would have shown four times in five."""
    last, runs, sizes = result.rounds[-1], len(result.study.runs), {}
    for score in last.scores.ranked:
        needed = last.threshold + penalty(fitted_parameters(score.effect), runs)
        sizes[score.effect] = score.unit_size * float(np.sqrt(max(needed, 1.0)) + special.ndtri(0.8))
    return sizes


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
MEMORY_S = 2.0
"""Time over which innovations of driven runs are predicted from those before. Shares and forecasts are asked where that
gains more log density than the names do: these may then stand for what is missing. Where innovations are white, all
that is left is chance, which no model closes, and the odds of names are what they say. Forecasts along commands that
answer disturbances are biased against true effects, innovations are not (Forssell, Ljung 1999, Automatica 35:1215)."""
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


def named_effects(result: SearchResult, parts: Mapping[str, Share]) -> tuple[NamedEffect, ...]:
    """List the effects of the final model, the one that explains most first, each with its rivals and what their cards
    say would tell them apart; a learned one with its curve, and a sentence that says whether it is thrust or a
    moment."""
    study, entries, curve = result.study, list[NamedEffect](), curve_of(result.final)
    dof = study.base.dof
    for name in (*parts, *(name for name in result.final.added if name not in parts)):
        effect, p_value, part = effects.get(name), result.p_values[name], parts.get(name)
        odds = [NamedRival(rival, odd, split_by(name, rival, dof)) for rival, odd in result.odds(name).items()]
        weight, rivals = listed_rivals(odds)
        parameters = parameter_estimates(study, result.final, name)
        pairs = zip(effect.parameters, parameters.values())
        law = ", ".join(p.choices[round(estimate.value)] for p, estimate in pairs if p.choices)
        learned = curve if curve is not None and name == PREFIX + curve.variable else None
        says = effect.card(dof).says if learned is None else sentence(learned, result)
        confidence = weight * (1.0 - p_value)
        entry = NamedEffect(name, law, says, parameters, confidence, p_value, rivals, learned)
        if part is not None:
            runs = part.gap or gap(study, part.without, result.final, fitted=True)
            says = f"{says} {smallness(dof, runs, part)}".rstrip()
            entry = replace(entry, says=says, evidence=part.evidence, held_out_log_odds=part.support)
        entries.append(entry)
    return tuple(entries)


def smallness(dof: Dof, runs: Gap, part: Share) -> str:
    """Say that an effect changes the positions by less than their noise; empty where thrust is steadier with it."""
    without_it, with_it = runs.residuals
    observed = with_it[with_it != 0.0]
    change = float(np.sqrt(((without_it - with_it) ** 2).sum() / max(observed.size, 1)))
    if not observed.size or change >= runs.floor or part.steadier >= STEADIER:
        return ""
    change_shown, noise = (f"{dof.shown(size):.2g} {dof.units.shown}" for size in (change, runs.floor))
    return f"It is small: it changes the {dof.words.position} by {change_shown}, and the noise is {noise}."


def split_by(name: str, rival: str, dof: Dof) -> str:
    """Say what tells `name` from `rival`: the text of the effect that lists the other among its look-alikes."""
    effect = effects.get(name)
    return (effect if rival in effect.mistaken_for else effects.get(rival)).card(dof).separated_by


MIN_RUNS = 4
MIN_TO_HOLD_OUT = 8
SHORT = 5  # iterations of a law or size that may equal the final one: those that get there do so soon


def _law_by_held_out(result: SearchResult, held_out: DiagnosisProblem, map_fn: Each) -> SearchResult:
    """The law and size that runs held out follow best, of those that the fitted runs do not tell apart: where all their
    commands lie on one side of an edge, its place must not decide whether there is one."""
    study, final = result.study, result.final
    if study.driven or not final.added or final.fit.noise > STANDS * study.sensor_floor:
        return result
    if not gap(held_out, result.base, final).exceeds_noise:
        return result
    attempts = [attempt_on(final, model) for model in variants(study, final)]
    tried = all_refitted(study, attempts, SHORT, map_fn, "trying laws on the runs held out")
    equal = [trial for trial in tried if trial is not None and trial.evidence < final.evidence + TIE]
    best = min([final, *equal], key=lambda trial: gap(held_out, result.base, trial).after)
    says = "The fitted runs leave its law or size open; these are what the runs held out follow best."
    return result if best is final else replace(result, final=best, equals=says)


def split_off(runs: Sequence[Run], seed: int, fewest: int = MIN_TO_HOLD_OUT) -> tuple[list[Run], list[Run]]:
    """Runs to fit and a quarter to hold out, spread over the moments: one drawn from every four neighbours in moment.

    All are fitted where there are fewer than the `fewest` runs that can spare some."""
    if len(runs) < fewest:
        return list(runs), []
    mean = [float(np.mean(run.command[run.command != 0])) if np.any(run.command != 0) else 0.0 for run in runs]
    order = sorted(range(len(runs)), key=lambda i: (mean[i], runs[i].name))
    random = np.random.default_rng(seed)
    out = {order[i + int(random.integers(4))] for i in range(0, len(order) - 3, 4)}
    return [run for i, run in enumerate(runs) if i not in out], [runs[i] for i in sorted(out)]


def diagnose_runs(
    runs: Sequence[Run], base: Model, *, hold_out: Sequence[Run] | None = None, seed: int = 0, map_fn: Each = alone,
    channels: str = AUTO, number: str = "3", driven: bool = False,
    goes_on: Callable[[], None] = lambda: None,
) -> Diagnosis:  # fmt: skip
    """Diagnose `base`, model `number` of its file, on `runs`; `hold_out` None draws a quarter of the runs, `channels`
    says which sensors count (`runs.channels.choose_channels`), `driven` that the base was fitted with a disturbance,
    `goes_on` is called after a first look that asks for more. Raises RunError for too few runs."""
    runs = [run for run in runs if len(run) >= 20]
    chosen = choose_channels([*runs, *(hold_out or ())], base.dof, channels, late_position=True)
    runs, out = ([chosen.cleaned(run) for run in some] for some in (runs, hold_out or ()))
    fitted, unfitted = split_off(runs, seed) if hold_out is None else (runs, out)
    if len(fitted) < MIN_RUNS:
        plural = " is" if len(fitted) == 1 else "s are"
        raise TooFewRunsError(
            f"{len(fitted)} run{plural} too few to tell a missing effect from chance; give at least {MIN_RUNS}"
        )
    study = study_of(fitted, base, chosen.names, driven)
    return _diagnose_study(study, unfitted, seed, map_fn, chosen, number, goes_on)


def _diagnose_study(
    study: DiagnosisProblem, unfitted: Sequence[Run], seed: int, map_fn: Each, chosen: ChannelChoice, number: str,
    goes_on: Callable[[], None],
) -> Diagnosis:  # fmt: skip
    """Search what a study lacks and judge it on the runs held out."""
    base = study.base
    at_once: SearchResult | None = None

    def search_on(first: SearchStep) -> bool:
        nonlocal at_once
        if is_of_early_logs(study, first):
            return False
        at_once = learn_at_once(study, first, seed, map_fn)
        if at_once is None:
            goes_on()
        return at_once is None

    searched = search(study, seed, map_fn, search_on)
    if any(is_of_early_logs(study, look) for look in searched.rounds):
        later = [with_later_commands(run) for run in unfitted]
        return _diagnose_study(study.with_later_commands(), later, seed, map_fn, chosen, number, goes_on)
    where = find_where(searched.study, searched.base, seed)

    def explained(outcome: SearchResult) -> bool:
        return verdict_of(outcome, where, None).word != UNEXPLAINED

    def verdict_on(outcome: SearchResult) -> tuple[SearchResult, DiagnosisProblem | None, Verdict]:
        held_out = replace(outcome.study, runs=tuple(unfitted)) if unfitted else None
        outcome = outcome if held_out is None else _law_by_held_out(outcome, held_out, map_fn)
        return outcome, held_out, verdict_of(outcome, where, held_out)

    learned = at_once or learn(searched.study, searched, seed, map_fn, explained)
    result, held_out, verdict = verdict_on(learned)
    if verdict.word != NAMED and searched.final.added and learned.final is not searched.final:
        answer = verdict_on(searched)  # what the library has, where the runs held out do not confirm a curve
        if answer[-1].word == NAMED:
            result, held_out, verdict = answer
    study, base_fit, final, first = result.study, verdict.result.base, verdict.result.final, verdict.result.rounds[0]
    before, after = (base_estimates(study, trial) for trial in (base_fit, verdict.leaves))
    listed = verdict.word in (NAMED, SUSPECTED)
    parts = verdict.shares or (shares(verdict.result, held_out) if listed else {})
    free = gap_from_commands(study, [chosen.believed(run) for run in unfitted], base_fit, final, seed)
    return Diagnosis(
        motion=base.motion, dof=base.dof, search=verdict.result, verdict=verdict.word, why=verdict.why,
        effects=named_effects(verdict.result, parts) if listed else (), where=where,
        fitted=judged_runs(study, verdict.result, fitted=True),
        held_out=None if held_out is None else judged_runs(held_out, verdict.result),
        candidates=[
            {"name": trial.added[-1], "gain": first.gain(trial)}
            for trial in sorted(first.trials, key=lambda trial: -first.gain(trial))
        ],
        threshold=first.threshold, base={name: (before[name], after[name]) for name in before},
        extended=_extended_model(study, verdict.leaves, number), driven=study.driven, remainder=verdict.remainder,
        from_commands=free, number=number, moment_unit=base.moment_unit, cycle=study.cycle,
        detectable={name: size for name, size in detectable(result).items() if np.isfinite(size)},
        channels=chosen, noises=channel_noises(final.fit, base.dof),
        gain_scatter=(base_fit.fit.factor(GAIN), final.fit.factor(GAIN)),
    )  # fmt: skip


def _extended_model(study: DiagnosisProblem, trial: CandidateFit, number: str) -> dict[str, object]:
    """Give the content of the file of the base model, number `number` of its file, with the effects of a trial."""
    base, model, dof, fit = base_estimates(study, trial), trial.model, study.base.dof, trial.fit
    roles = [role for role in ROLES if role in dof.parameters]
    base_names = {role: dof.parameters[role] for role in roles if dof.parameter(role) in model.parameter_names}
    drag = {name: base[name].to_json() for name in base_names.values()}
    ratio, covariance = None, study.covariance(model, fit)
    likeliest = drag | {"covariance": covariance_json(model.short_names, fit.theta, fit.parameters.log, covariance)}
    if "quadratic" in base_names and base[base_names["quadratic"]].value > 0:
        i, k = (model.index(dof.parameter(role)) for role in ("inertia", "quadratic"))
        ratio = ratio_of(fit, covariance, i, k, dof.unit_of("ratio"), len(study.runs) - 1).to_json()
    added = {term.name: parameter_estimates(study, trial, term.name) for term in model.terms if not term.base}
    exponent = gain_exponent(study, fit)
    ends = (end for run in study.runs for end in (run.command.min(), run.command.max()))
    driven = {"driven": True, "random": random_estimates(fit, covariance, dof)} if fit.driven else {}
    steered = study.base.moment_unit == STEERED
    return {
        **model_head(dof, study.base.moment_unit),
        "fitted_to": "whole runs",
        "models": {number: {**drag, "output_error": likeliest, "velocity_error": None, "sse": None}},
        "preferred": number,
        "preferred_because": f"Model {number} was the base of the diagnosis.",
        dof.ratio_key: ratio,
        "valid_range": valid_range(ends, model),
        "effects": effects_json(added),
        COMMAND_DELAY: study.command_delay(fit),
        f"{dof.words.position}_noise_{dof.units.shown}": float(dof.shown(fit.noise)) if study.position_counts else None,
        **driven,
        **({"nomoto": steering_json(*steering_of(study.runs))} if steered else {}),
        "gain_scatter": float(fit.factor(GAIN)),
        "gain_exponent": exponent and exponent.to_json(),
    }
