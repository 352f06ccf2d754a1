"""A whole diagnosis, and its result, of one motion or the plane."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import special

from automarine_cli import effects
from automarine_cli.diagnosis.learned_curve import curve_of, learn, learn_at_once, sentence
from automarine_cli.diagnosis.residual_regions import Gap, ResidualRegions, find_where, gap, gap_from_commands
from automarine_cli.diagnosis.scores import fitted_parameters, penalty
from automarine_cli.diagnosis.search import STANDS, SearchResult, SearchStep, gain_exponent, is_of_early_logs, search
from automarine_cli.diagnosis.study import DiagnosisProblem, LimitCycle, study_of
from automarine_cli.diagnosis.trials import TIE, CandidateFit, all_refitted, along_edge, attempt_on, edges_of, variants
from automarine_cli.diagnosis.verdict import (
    NAMED,
    SUSPECTED,
    UNEXPLAINED,
    JudgedRuns,
    Share,
    Verdict,
    judged_runs,
    shares,
    smallness,
    verdict_of,
)
from automarine_cli.dofs import YAW, Dof, Motion
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import TooFewRunsError
from automarine_cli.estimate import Estimate
from automarine_cli.fits.characteristics import steering_json, steering_of
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
from automarine_cli.quantities import STEERED
from automarine_cli.runs.channels import AUTO, NOTHING_TO_CHOOSE, ChannelChoice, choose_channels
from automarine_cli.runs.run import ExcludedRun, Run, runs_json, with_later_commands


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
